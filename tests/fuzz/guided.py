"""Coverage-guided runs of one target with atheris, which keeps what reaches new code and changes it further.

``python -m tests.fuzz --guided`` starts a process a target: libFuzzer ends the process it runs in. Its changes are
those of :mod:`tests.fuzz.mutators` and, half of the time, its own. The good log and the seeds of the corpus are where
it begins. atheris is not among the requirements: ``pip install atheris`` (Linux, macOS; Python 3.11 to 3.13).
"""

import contextlib
import json
import re
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from tests.fuzz import campaign

LARGEST = 6000  # of what libFuzzer makes [byte]; larger good logs are left to the campaign
_STARTED = """
import sys
import atheris
with atheris.instrument_imports(
    include=["schuler.recording.formats", "schuler.recording.io"],
    exclude=["schuler.recording.io._kernels", "schuler.recording._kernels", "schuler.recording.io.child"],
):
    import schuler.recording.io.dispatch
    from schuler.recording.formats import registry
    for name, _ in registry.FORMATS:
        registry.module(name)
from tests.fuzz import guided
guided.body(*sys.argv[1:])
"""


def body(name: str, notice: str, *options: str) -> None:
    """The process of a target: runs until libFuzzer's options end it, findings go to a file."""
    campaign._own_paths()
    import random

    import atheris
    from tests.fuzz import mutators, targets

    findings: dict[str, campaign.Finding] = {}
    with targets.scratch() as folder, targets.unguarded():
        target = targets.make(name, Path(folder) / name)
        seeds = Path(folder) / "seeds"
        seeds.mkdir()
        for k, good in enumerate(target.good):
            (seeds / f"good-{k}").write_bytes(bytes([k]) + good)
        for owner, file, path in targets.corpus():
            members = [member.name for member in target.members]
            if owner == name and file in members:
                (seeds / path.name).write_bytes(bytes([members.index(file)]) + path.read_bytes())
        count = 0

        def run(data: bytes) -> None:
            nonlocal count
            count += 1
            if len(data) < 2:
                return
            try:
                with targets.limited():
                    target.attempt(data[0] % len(target.members), data[1:], target.hints, used=False)
            except KeyboardInterrupt:
                raise
            except BaseException as error:
                key = campaign.signature(name, error)
                if key not in findings:
                    problem = campaign.Finding(name, count, key, repr(data[1:])[:3000])
                    findings[key] = problem
                    with Path(notice).open("a") as stream:
                        stream.write(json.dumps({"signature": key, "member": data[0], "hex": data[1:].hex()}) + "\n")

        def change(data: bytes, most: int, seed: int) -> bytes:
            rng = random.Random(seed)
            if len(data) > 1 and rng.random() < 0.6:
                # what was damaged before may have no structure left to be changed by
                with contextlib.suppress(Exception):
                    return data[:1] + mutators.damage(name, data[1:], seed)[: most - 1]
            return atheris.Mutate(data, most)

        setup = [sys.argv[0], *options, f"-max_len={LARGEST}", "-print_final_stats=1", "-timeout=120",
                 "-rss_limit_mb=3000", "-verbosity=1", str(seeds)]  # fmt: skip
        atheris.Setup(setup, run, custom_mutator=change)
        atheris.Fuzz()


def run(names: list[str], *, minutes: float) -> tuple[int, list[str]]:
    """Guided runs of targets one after the other, each with the same share of the time; runs and findings."""
    total, problem = 0, []
    root = Path(__file__).parents[2]
    print(f"{'target':20s}{'runs':>10s}{'coverage':>10s}{'findings':>10s}{'s':>7s}", flush=True)
    for name in names:
        began = time.monotonic()
        with tempfile.NamedTemporaryFile("w+", suffix=".jsonl") as notice:
            seconds = max(round(60.0 * minutes / len(names)), 1)
            done = subprocess.run(
                [sys.executable, "-c", _STARTED, name, notice.name, f"-max_total_time={seconds}"],
                cwd=root, capture_output=True, text=True, errors="replace", check=False,
            )  # fmt: skip
            lines = [json.loads(line) for line in notice.read().splitlines()]
        runs = re.search(r"stat::number_of_executed_units:\s*(\d+)", done.stderr)
        coverage = re.findall(r"cov: (\d+)", done.stderr)
        total += int(runs[1]) if runs else 0
        print(
            f"{name:20s}{runs[1] if runs else '?':>10s}{coverage[-1] if coverage else '?':>10s}{len(lines):10d}"
            f"{time.monotonic() - began:7.0f}",
            flush=True,
        )
        here = [f"{name}: {line['signature']} ({line['member']}:{line['hex'][:6000]})" for line in lines]
        if runs is None:
            here.append(f"{name}: the process ended with code {done.returncode}: {done.stderr[-1500:]}")
        for finding in here:
            print(finding, flush=True)
        problem += here
    print(f"{'all':20s}{total:10d}")
    return total, problem
