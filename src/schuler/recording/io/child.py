"""Parsers of other libraries in a process of their own, with limits of time and memory (decision 24).

A damaged file can send compiled code round in circles, where no signal of Python reaches it, or crash it. The process
is started with the first such file, kept for those that follow, and ended when it exceeds a limit.
"""

from __future__ import annotations

import atexit
import json
import os
import pickle
import subprocess
import sys
import threading
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import Any, TypeVar

from schuler.exceptions import FileFormatError, ReaderError, SchulerError

T = TypeVar("T")

LONGEST_S = 5.0  # processor time that any file may take [s]
_PER_BYTE_S = 2e-6  # and by its size: ten times what dispatch.py gives for the slowest format [s]
_SLACK, _WAIT_S = 4.0, 30.0  # clock on the wall: so many times that, and so much, for a loaded machine [s]
_ROOM, _PER_BYTE = 4 << 30, 40  # address space: what any file may take, and times its size [byte]
_START = (
    "import sys, json; sys.path[:] = json.loads(sys.argv[1]); from schuler.recording.io import child; child.serve()"
)
# what linear algebra reads its number of threads from: each reserves address space
_THREADS = dict.fromkeys(("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"), "1")


@dataclass
class _Child:
    """The process, and whose it is: one that was forked from the owner starts its own."""

    process: subprocess.Popen[bytes]
    owner: int


_lock = threading.Lock()
_child: _Child | None = None
_usable = True


def call(function: Callable[..., T], path: Path, *args: Any) -> T:
    """Value of a function of a file, computed in the child process; here, if none can be started.

    Parameters
    ----------
    function : callable
        ``function(path, *args)``, of a module: it is sent by its name.
    path : Path
        The file; its size sets the limits.
    *args
        Further arguments, plain data.

    Raises
    ------
    SchulerError
        As the function raises it.
    FileFormatError
        If it takes longer than any file of that size should, or the library crashes.
    MemoryError
        If it needs more memory than any file of that size should.

    Notes
    -----
    Processor time, memory and crashes are limited on POSIX; on Windows only the time on the wall is. Memory is not on
    macOS, which ignores its limit.
    """
    size = sum(p.stat().st_size for p in path.rglob("*") if p.is_file()) if path.is_dir() else path.stat().st_size
    seconds = LONGEST_S + _PER_BYTE_S * size
    with _lock:
        child = _running()
        if child is None:
            return function(path, *args)
        process, late = child.process, threading.Event()

        def end() -> None:
            late.set()
            process.kill()

        watch = threading.Timer(_SLACK * seconds + _WAIT_S, end)
        watch.daemon = True
        watch.start()
        answered = False
        try:
            request = (function.__module__, function.__qualname__, (path.absolute(), *args), seconds, size)
            fine, value, state = _exchange(process, request)
            answered = True
        except (EOFError, OSError, pickle.UnpicklingError):
            _stop()
            raise _lost(process, late.is_set(), path) from None
        finally:
            watch.cancel()
            if not answered:  # interrupted: the answer of this file must not be taken for the next one's
                _stop()
    if fine:
        answer: T = value
        return answer
    error = value.__new__(value, *state[0])  # not made anew: its arguments are the finished sentence
    error.args = state[0]
    error.__dict__.update(state[1])
    raise error


def _exchange(process: subprocess.Popen[bytes], request: Any) -> Any:
    assert process.stdin is not None
    assert process.stdout is not None
    pickle.dump(request, process.stdin)
    process.stdin.flush()
    return pickle.load(process.stdout)  # noqa: S301 - from the process that was started here


def _running() -> _Child | None:
    """The child, started if there is none; None where that is not possible."""
    global _child, _usable
    if _child is not None and _child.owner == os.getpid() and _child.process.poll() is None:
        return _child
    if not _usable or not sys.executable:
        return None
    try:
        process = subprocess.Popen(  # noqa: S603 - this interpreter
            [sys.executable, "-c", _START, json.dumps([str(p) for p in sys.path])],
            stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, env={**os.environ, **_THREADS},
        )  # fmt: skip
    except OSError:
        _usable = False
        return None
    try:
        assert process.stdout is not None
        pickle.load(process.stdout)  # noqa: S301 - that it has started
    except (EOFError, OSError, pickle.UnpicklingError):
        _usable = False
        process.kill()
        process.communicate()
        return None
    _child = _Child(process, os.getpid())
    return _child


def _stop() -> None:
    """End the child, if it is this process's."""
    global _child
    child, _child = _child, None
    if child is None or child.owner != os.getpid():
        return
    child.process.kill()
    with suppress(OSError, ValueError):
        child.process.communicate()


atexit.register(_stop)


def _lost(process: subprocess.Popen[bytes], late: bool, path: Path) -> FileFormatError:
    import signal

    if late or -(process.returncode or 0) == getattr(signal, "SIGXCPU", None):
        return FileFormatError(
            "reading it came to no end: it is damaged, or the library that reads it has a defect", path
        )
    return ReaderError(
        f"the library that reads it crashed (exit code {process.returncode}): the file is damaged, or the "
        "library has a defect",
        path,
    )


def serve() -> None:
    """Do what comes in on standard input until it is closed: the child's side."""
    import signal

    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C goes to all of a terminal; the parent ends this one
    requests, answers = sys.stdin.buffer, os.fdopen(os.dup(1), "wb")
    quiet = os.open(os.devnull, os.O_WRONLY)
    os.dup2(quiet, 1)  # what libraries print
    sys.stdout = open(os.devnull, "w", encoding="utf-8")  # noqa: SIM115 - as long as the process lives
    answer: tuple[bool, Any, Any] = (True, "started", None)
    while True:
        pickle.dump(answer, answers, protocol=5)
        answers.flush()
        answer = (True, None, None)  # not kept while the next one is read
        try:
            module, name, args, seconds, size = pickle.load(requests)  # noqa: S301 - from the process that started this
        except EOFError:
            return
        limit(seconds, size)
        try:
            answer = (True, getattr(import_module(module), name)(*args), None)
        except (SchulerError, MemoryError, OSError) as error:
            answer = (False, type(error), (error.args, error.__dict__))
        except Exception as error:
            answer = (False, ReaderError, ((f"{args[0]}: {type(error).__name__}: {error}",), {"path": args[0]}))


def limit(seconds: float, size: int) -> None:
    """Limit processor time from here on and address space, where the system can.

    Parameters
    ----------
    seconds : float
        [s]
    size : int
        Of the file. [byte]
    """
    try:
        import resource
    except ImportError:
        return
    used = sum(resource.getrusage(resource.RUSAGE_SELF)[:2])
    for which, value in (
        (resource.RLIMIT_CPU, int(used + seconds) + 1), (resource.RLIMIT_AS, _ROOM + _PER_BYTE * size),
        (resource.RLIMIT_CORE, 0),
    ):  # fmt: skip
        hard = resource.getrlimit(which)[1]
        with suppress(OSError, ValueError):
            resource.setrlimit(which, (value if hard == resource.RLIM_INFINITY else min(value, hard), hard))
