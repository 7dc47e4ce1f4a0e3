"""Processes that compile beside this one: kernels wanted later, and parts of a kernel that is compiled here.

Parts come through a pipe, as numba's description of a function and its LLVM code; what is wanted later is left on disk.
"""

from __future__ import annotations

import contextlib
import multiprocessing
import os
import queue
import subprocess
import sys
import threading
from collections.abc import Collection, Hashable, Sequence
from typing import IO

WAIT_FOR_ANOTHER_S = 60.0  # after which a process is taken for a stopped one

_waiting: dict[str, threading.Thread] = {}  # for a process, which may outlive this one
_expected: dict[Hashable, queue.SimpleQueue[bytes]] = {}  # parts on their way
_one_thread_starts = threading.Lock()


def start_beside(name: str, parts: Sequence[Hashable] = ()) -> None:
    """Start ``module:function`` in a process of its own, once; where it fails, this process compiles for itself.

    Parameters
    ----------
    name : str
        ``module:function``.
    parts : sequence of hashable
        Keys of the parts that the function writes by :func:`hand_over`, in this order.
    """
    if os.cpu_count() == 1 or multiprocessing.parent_process() is not None:
        return
    with _one_thread_starts:
        if name not in _waiting:
            _expected.update({part: queue.SimpleQueue() for part in parts})
            waiting = threading.Thread(target=_run, args=(name, [_expected[part] for part in parts]), daemon=True)
            waiting.start()
            _waiting[name] = waiting


def wait_beside(modules: Collection[str]) -> None:
    """Wait for the processes that prepare kernels of these modules."""
    for name, waiting in list(_waiting.items()):
        if name.partition(":")[0] in modules:
            waiting.join()


def part_from_beside(part: Hashable) -> bytes:
    """Data of a part, once it is there; nothing if none was asked for or that process has failed or stopped."""
    expected = _expected.pop(part, None)
    if expected is not None:
        with contextlib.suppress(queue.Empty):
            return expected.get(timeout=WAIT_FOR_ANOTHER_S)
    return b""


def hand_over(data: bytes) -> None:
    """Write a part's data, in a process that :func:`start_beside` began."""
    sys.stdout.buffer.write(len(data).to_bytes(8, "little") + data)
    sys.stdout.buffer.flush()


def _run(name: str, expected: Sequence[queue.SimpleQueue[bytes]]) -> None:
    """Run ``module:function`` in a process of its own to its end, and pass on the parts that it writes."""
    module, function = name.split(":")
    parts = list(expected)
    # it ends at once: a search for cycles among what compiling made, and taking it down, is a second; and what is to
    # take its parts, the longest of all, goes first
    behind = "os.nice(5); " if parts and hasattr(os, "nice") else ""
    script = f"import gc, os; gc.disable(); {behind}from {module} import {function}; {function}(); os._exit(0)"
    with (
        contextlib.suppress(OSError),
        subprocess.Popen(  # noqa: S603 - this Python, a function of this package
            [sys.executable, "-c", script],
            env={**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)},
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE if parts else subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        ) as process,
    ):
        while parts and process.stdout is not None and (data := _part_of(process.stdout)):
            parts.pop(0).put(data)
        _give_up(parts)
    _give_up(parts)


def _give_up(parts: list[queue.SimpleQueue[bytes]]) -> None:
    """Let nobody wait for parts that will not come."""
    while parts:
        parts.pop().put(b"")


def _part_of(stream: IO[bytes]) -> bytes:
    """Next part in a pipe; nothing at its end."""
    length = int.from_bytes(stream.read(8), "little")
    data = stream.read(length)
    return data if len(data) == length else b""
