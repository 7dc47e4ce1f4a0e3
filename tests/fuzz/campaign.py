"""Campaigns of damaged logs over all targets: worker processes, counts, findings, and seeds made small.

A worker reads one damaged log after the other and writes down which one it is at; a process that dies, asks for too
much memory or does not come back is a finding like an exception.
"""

import json
import multiprocessing
import sys
import time
import traceback
from contextlib import suppress
from dataclasses import asdict, dataclass, field
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

MEMORY_MB = 1000.0  # that a log of some kilobytes may ask for beyond what the process has
SILENT_S = 60.0  # without a sign of a worker it is taken to be caught in a library
TURN_S = (4.0, 30.0)  # of processor time a target has before it is the next one's turn: at first, at most


@dataclass
class Count:
    """Damaged logs of a target."""

    cases: int = 0
    opened: int = 0
    refused: int = 0
    cpu_s: float = 0.0
    findings: int = 0


@dataclass
class Finding:
    """Something that must not be: a foreign exception, no end, an impossible number in silence."""

    target: str
    seed: int
    signature: str
    detail: str
    times: int = 1


@dataclass
class Campaign:
    """Counts by target, and findings by signature."""

    counts: dict[str, Count] = field(default_factory=dict)
    findings: dict[str, Finding] = field(default_factory=dict)

    def note(self, finding: Finding) -> None:
        self.counts.setdefault(finding.target, Count()).findings += 1
        if finding.signature in self.findings:
            self.findings[finding.signature].times += 1
        else:
            self.findings[finding.signature] = finding

    def table(self) -> str:
        """Counts and findings as they are printed."""
        rows = [f"{'target':20s}{'logs':>9s}{'opened':>9s}{'refused':>9s}{'findings':>9s}{'ms/log':>8s}"]
        total = Count()
        for name, c in sorted(self.counts.items()):
            rows.append(_row(name, c))
            for key in ("cases", "opened", "refused", "findings", "cpu_s"):
                setattr(total, key, getattr(total, key) + getattr(c, key))
        rows.append(_row("all", total))
        rows += [
            f"\n{f.times} x {f.signature}\n  first: {f.target}, seed {f.seed}\n{f.detail}"
            for f in self.findings.values()
        ]
        return "\n".join(rows)

    def save(self, path: Path) -> None:
        path.write_text(json.dumps(asdict(self), indent=1))


def _row(name: str, c: Count) -> str:
    each = 1e3 * c.cpu_s / max(c.cases, 1)
    return f"{name:20s}{c.cases:9d}{c.opened:9d}{c.refused:9d}{c.findings:9d}{each:8.2f}"


def signature(name: str, error: BaseException) -> str:
    """What an exception is and where in our code it came about."""
    frames = traceback.extract_tb(error.__traceback__)
    ours = [f for f in frames if "/schuler/" in f.filename and not f.filename.endswith("dispatch.py")]
    where = ours[-1] if ours else frames[-1]
    place = f"{where.filename.rsplit('/schuler/', 1)[-1]}:{where.lineno}"
    message = str(error)
    if message.startswith("impossible"):
        message = message.partition(":")[0] + ":" + message.partition(":")[2].partition(":")[0]
        place = name
    elif "no answer" not in message:
        message = message.splitlines()[0][:60] if message else ""
        message = "".join("#" if c.isdigit() else c for c in message)
    return f"{type(error).__name__} in {place}: {message}"


def work(name: str, first: int, count: int, cpu_s: float, limit_s: float, at: Any, report: Connection) -> None:
    """Body of a worker: damaged logs of a target from seed ``first`` on, ``count`` of them or for some time."""
    _own_paths()
    from tests.fuzz import targets

    with targets.scratch() as folder, targets.unguarded():
        target = targets.make(name, Path(folder) / name)
        target.attempt(0, target.good[0], target.hints, listed=True, used=True)  # what is loaded for it is loaded
        target.opened = target.refused = 0
        _bound_memory()
        began, cpu = time.monotonic(), time.process_time()
        done = 0
        for seed in range(first, first + count):
            at.value = seed
            try:
                case = target.case(seed)
                with targets.limited():
                    target.attempt(*case)
            except BaseException as error:
                trace = "".join(traceback.format_exception(error)[-3:])[-1500:]
                report.send(("finding", asdict(Finding(name, seed, signature(name, error), trace))))
                if isinstance(error, KeyboardInterrupt):
                    raise
            done += 1
            if time.monotonic() - began > limit_s or time.process_time() - cpu > cpu_s:
                break
        report.send(("done", (done, target.opened, target.refused, time.process_time() - cpu)))


def _own_paths() -> None:
    """Where ``pytest`` finds the modules of the tests (``pythonpath`` of pyproject.toml)."""
    root = Path(__file__).parents[2]
    for path in (root, root / "tests" / "support"):
        if str(path) not in sys.path:
            sys.path.insert(0, str(path))


def _bound_memory() -> None:
    with suppress(ImportError, OSError, ValueError):
        import resource

        text = Path("/proc/self/statm").read_text()
        now = int(text.split()[0]) * resource.getpagesize()
        resource.setrlimit(resource.RLIMIT_AS, (now + int(MEMORY_MB * 1e6), resource.RLIM_INFINITY))


def run(
    names: list[str], *, minutes: float, first: int = 0, most: int = 10**9, processes: int = 1, tell: bool = False
) -> Campaign:
    """Damaged logs of targets in turn until the time is over, or each had ``most``.

    Parameters
    ----------
    names : list of str
    minutes : float
        By the clock.
    first : int
        Seed of the first log of each target.
    most : int
        Logs of each target.
    processes : int
    tell : bool
        Print findings as they come.

    Returns
    -------
    Campaign
        Each target has the same processor time, so that of formats that are read fast more logs are tried.
    """
    campaign = Campaign({name: Count() for name in names})
    end = time.monotonic() + 60.0 * minutes
    waiting = [(name, first, TURN_S[0]) for name in names]
    running: list[_Worker] = []
    while True:
        while waiting and len(running) < processes and time.monotonic() < end:
            name, seed, cpu_s = waiting.pop(0)
            running.append(_Worker(name, seed, first + most - seed, cpu_s, end - time.monotonic()))
        if not running:
            return campaign
        time.sleep(0.02)
        for worker in list(running):
            for finding in worker.poll(campaign):
                new = finding.signature not in campaign.findings
                campaign.note(finding)
                if tell and new:
                    print(f"{finding.target} seed {finding.seed}: {finding.signature}", flush=True)
            if worker.ended:
                running.remove(worker)
                if worker.next_seed < first + most and worker.began:
                    waiting.append((worker.name, worker.next_seed, min(2.0 * worker.cpu_s, TURN_S[1])))


class _Worker:
    """A process, and what it told."""

    def __init__(self, name: str, first: int, count: int, cpu_s: float, limit_s: float) -> None:
        context = multiprocessing.get_context("spawn")
        self.name, self.first, self.cpu_s = name, first, cpu_s
        self.at = context.Value("q", first - 1)
        self.pipe, other = context.Pipe(duplex=False)
        self.process = context.Process(
            target=work, args=(name, first, count, cpu_s, limit_s, self.at, other), daemon=True
        )
        self.process.start()
        other.close()
        self.ended, self.next_seed = False, first
        self.seen, self.since = first - 1, time.monotonic()

    @property
    def began(self) -> bool:
        """Whether it read any log at all."""
        return self.next_seed > self.first

    def poll(self, campaign: Campaign) -> list[Finding]:
        """What it found since; its counts go to the campaign."""
        problems = []
        count = campaign.counts[self.name]
        with suppress(EOFError, OSError):
            while self.pipe.poll():
                kind, notice = self.pipe.recv()
                if kind == "finding":
                    problems.append(Finding(**notice))
                    continue
                self.ended, self.next_seed = True, self.first + notice[0]
                for key, value in zip(("cases", "opened", "refused", "cpu_s"), notice, strict=True):
                    setattr(count, key, getattr(count, key) + value)
        seed = self.at.value
        if seed != self.seen:
            self.seen, self.since = seed, time.monotonic()
        alive = self.process.is_alive()
        if self.ended:
            self.process.join()
        elif not alive or time.monotonic() - self.since > SILENT_S:
            message = "no end" if alive else f"the process ended with code {self.process.exitcode}"
            self.process.kill()
            self.process.join()
            problems.append(Finding(self.name, seed, f"{message} in a library, {self.name}", ""))
            count.cases += seed - self.first + 1
            self.ended, self.next_seed = True, seed + 1
        return problems


def smallest(name: str, seed: int, seconds: float = 12.0) -> tuple[str, bytes, str]:
    """The log of a finding made small: its file, its content, and the signature it still has."""
    _own_paths()
    from tests.fuzz import targets

    with targets.scratch() as folder, targets.unguarded():
        target = targets.make(name, Path(folder) / name)
        member, data, hints = target.case(seed)

        def fails(candidate: bytes) -> str | None:
            try:
                with targets.limited():
                    target.attempt(member, candidate, hints)
            except BaseException as error:
                return signature(name, error)
            return None

        wanted = fails(data)
        if wanted is None:
            return target.members[member].name, data, ""
        end = time.monotonic() + seconds
        separator = b"\n" if b"\x00" not in data else b""
        pieces = data.split(separator) if separator else [data[k : k + 4] for k in range(0, len(data), 4)]
        size = max(len(pieces) // 2, 1)
        while size and time.monotonic() < end:
            at = 0
            while at < len(pieces) and time.monotonic() < end:
                less = pieces[:at] + pieces[at + size :]
                if less and fails(separator.join(less)) == wanted:
                    pieces = less
                else:
                    at += size
            size //= 2
        return target.members[member].name, separator.join(pieces), wanted
