"""Commands run in processes of their own, whose state is files: a server that is started anew finds them again.

A job is a folder with ``job.json``, what the command printed, its progress, and a file that the process keeps locked as
long as it lives. Nothing else is remembered: whether it runs, has ended or was killed is read from there.
"""

from __future__ import annotations

import json
import os
import secrets
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, Literal, TypeAlias

from schuler.exceptions import InputError
from schuler.files import write_text
from schuler.studio import worker
from schuler.studio.workspace import JOBS, Workspace

#: Name of the variable with the file that a command's progress is written to.
PROGRESS = "SCHULER_PROGRESS"
State: TypeAlias = Literal["running", "done", "refused", "cancelled", "killed"]
_KEPT = 30  # jobs that have ended
_children: dict[str, subprocess.Popen[bytes]] = {}  # of this server, so that those that have ended are reaped
#: Commands whose answer is waited for: they go to the worker, the others to processes of their own.
_WAITED_FOR = ("navigate", "calibrate", "allan", "budget", "compare")
_workers: dict[Path, tuple[worker.Worker, Path]] = {}  # by root, with the lock of the last job


@dataclass(frozen=True)
class Job:
    """A command in its process.

    Attributes
    ----------
    key : str
    command : tuple of str
        Arguments after ``schuler``.
    out : str
        Folder of the run, from the root on.
    started : float
        Unix time. [s]
    pid : int
    state : {"running", "done", "refused", "cancelled", "killed"}
        ``refused``: the command said why it cannot be carried out; ``killed``: its process ended without a word.
    fraction : float
        Of the filter's work that is done. [0..1]
    message : str
        Last line of what it said on stderr.
    """

    key: str
    command: tuple[str, ...]
    out: str
    started: float
    pid: int
    state: State
    fraction: float
    message: str


def start(workspace: Workspace, command: Sequence[str], out: str) -> Job:
    """Run ``schuler`` with these arguments in the workspace's folder.

    Parameters
    ----------
    workspace : Workspace
    command : sequence of str
    out : str
        Folder that the command writes.

    Raises
    ------
    InputError
        If a job that runs writes to the same folder.
    """
    if any(job.out == out and job.state == "running" for job in jobs(workspace)):
        raise InputError(f"{out}: a run that has not ended writes there: wait for it, or cancel it")
    key = f"{datetime.now(UTC):%Y%m%d-%H%M%S-%f}-{secrets.token_hex(3)}"  # sorts by time, two in a second too
    folder = _place(workspace) / key
    folder.mkdir(parents=True)
    held = os.open(folder / "lock", os.O_CREAT | os.O_RDWR, 0o600)
    try:
        _lock(held)
        with (folder / "stdout").open("wb") as out_file, (folder / "stderr").open("wb") as err_file:
            process = _process(workspace, folder, command, held, out_file.fileno(), err_file.fileno())
    finally:
        os.close(held)  # the lock is the process's from now on
    _children[key] = process
    document = {"command": list(command), "out": out, "started": time.time(), "pid": process.pid}
    write_text(folder / "job.json", json.dumps(document), at_once=True)
    _tidy(workspace)
    current = job(workspace, key)
    assert current is not None
    return current


def prepare(workspace: Workspace) -> None:
    """Start the worker of a folder, unless it is there: a page is open that will want it."""
    kept = _workers.get(workspace.root)
    if kept is None or kept[0].process.poll() is not None:
        if kept is not None:
            kept[0].orders.close()
        _workers[workspace.root] = worker.started(workspace.root), workspace.root / JOBS / "none"


def _process(
    workspace: Workspace, folder: Path, command: Sequence[str], held: int, out: int, err: int
) -> subprocess.Popen[bytes]:
    """Process that carries out a command: the worker, if the command is one for it and it has nothing to do."""
    progress = folder / "progress"
    if command[0] in _WAITED_FOR and "--coach" not in command:
        prepare(workspace)
        kept, lock = _workers[workspace.root]
        if not _alive(lock):
            with suppress(OSError):  # it has ended meanwhile
                kept.send(command, progress, held, out, err)
                _workers[workspace.root] = kept, folder / "lock"
                return kept.process
    return subprocess.Popen(  # noqa: S603 - our own command, its arguments as a list
        [sys.executable, "-m", "schuler", *command], cwd=workspace.root, stdin=subprocess.DEVNULL,
        stdout=out, stderr=err, start_new_session=True, pass_fds=(held,),
        env={**os.environ, PROGRESS: str(progress), "NO_COLOR": "1"},
    )  # fmt: skip


def jobs(workspace: Workspace) -> list[Job]:
    """All jobs, the latest first."""
    with suppress(FileNotFoundError):
        listed = (job(workspace, key) for key in sorted(os.listdir(_place(workspace)), reverse=True))
        return [one for one in listed if one is not None]
    return []


def job(workspace: Workspace, key: str) -> Job | None:
    """A job by its key; None if there is none."""
    folder = _place(workspace) / Path(key).name
    try:
        entries: dict[str, Any] = json.loads((folder / "job.json").read_text(encoding="utf-8"))
        command, out = tuple(map(str, entries["command"])), str(entries["out"])
        started, pid = float(entries["started"]), int(entries["pid"])
    except (OSError, ValueError, KeyError, TypeError):
        return None
    if key in _children:
        _children[key].poll()
    fraction = 0.0
    with suppress(OSError, ValueError):
        fraction = float((folder / "progress").read_text(encoding="ascii"))
    last_line = next(reversed(messages(workspace, key)), "")
    state: State
    if _alive(folder / "lock"):
        state = "running"
    elif (folder / "cancelled").exists():
        state = "cancelled"
    elif _answered(folder / "stdout") and (workspace.root / out).is_dir():
        state, fraction = "done", 1.0
    else:
        state = "refused" if last_line.startswith("schuler: ") else "killed"
    return Job(key, command, out, started, pid, state, fraction, last_line.removeprefix("schuler: "))


def latest(workspace: Workspace, *words: str) -> Job | None:
    """The job started last whose command begins with these words, such as its name and its log; empty ones are any."""
    first = tuple(word for word in words if word)
    return next((one for one in jobs(workspace) if one.command[: len(first)] == first), None)


def messages(workspace: Workspace, key: str) -> list[str]:
    """Lines that a job's command has said on stderr so far."""
    try:
        text = (_place(workspace) / Path(key).name / "stderr").read_text(encoding="utf-8", errors="replace")
    except OSError:
        return []
    return text.strip().splitlines()


def answer(workspace: Workspace, key: str) -> dict[str, Any]:
    """JSON that a job's command printed."""
    text = (_place(workspace) / Path(key).name / "stdout").read_text(encoding="utf-8")
    return dict(json.loads(text))


def cancel(workspace: Workspace, key: str) -> None:
    """End a job that runs; what it has written so far is taken away, as of any command that is ended."""
    current = job(workspace, key)
    if current is None or current.state != "running":
        return
    (_place(workspace) / Path(key).name / "cancelled").touch()
    with suppress(ProcessLookupError):
        os.kill(current.pid, signal.SIGTERM)


def interrupt(workspace: Workspace, key: str) -> None:
    """What Ctrl-C is in a terminal: a coach ends, and its command goes on with the log so far."""
    current = job(workspace, key)
    if current is not None and current.state == "running":
        with suppress(ProcessLookupError):
            os.kill(current.pid, signal.SIGINT)


def _place(workspace: Workspace) -> Path:
    return workspace.root / JOBS


def _answered(path: Path) -> bool:
    """Whether a command printed the whole of its JSON; its files get their names after that, all at once."""
    try:
        json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return False
    return True


def _lock(handle: int) -> None:
    import fcntl

    fcntl.flock(handle, fcntl.LOCK_EX)


def _alive(path: Path) -> bool:
    """Whether a process holds the lock; the system lets go of it when the process ends, however it does."""
    import fcntl

    try:
        handle = os.open(path, os.O_RDWR)
    except OSError:
        return False
    try:
        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:
        return True
    else:
        return False
    finally:
        os.close(handle)


def _tidy(workspace: Workspace) -> None:
    """Remove all but the latest jobs that have ended; their runs stay."""
    ended = [one for one in jobs(workspace) if one.state != "running"]
    for one in ended[_KEPT:]:
        shutil.rmtree(_place(workspace) / one.key, ignore_errors=True)
        _children.pop(one.key, None)
