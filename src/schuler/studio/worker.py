"""The process that carries out commands a person waits for, kept between them: what is compiled and imported stays.

A command alone pays for the start of Python, imports and the loading of compiled kernels, which takes longer than to
navigate some minutes. The process is :mod:`schuler.cli.worker`; a command runs in it as it does on the command line.
"""

from __future__ import annotations

import json
import os
import socket
import subprocess
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path


@dataclass(frozen=True)
class Worker:
    """A process that waits for commands, or carries one out.

    Attributes
    ----------
    root : Path
        Folder that it runs in.
    process : Popen
    orders : socket
        By which it is told; it ends when this is closed.
    """

    root: Path
    process: subprocess.Popen[bytes]
    orders: socket.socket

    def send(self, command: Sequence[str], progress: Path, lock: int, out: int, err: int) -> None:
        """Have a command carried out.

        Parameters
        ----------
        command : sequence of str
            Arguments after ``schuler``.
        progress : Path
            File that the fraction done is written to.
        lock, out, err : int
            Open files: the first is closed when the command has ended, the others are its output.

        Raises
        ------
        OSError
            If the process has ended.
        """
        line = json.dumps({"command": list(command), "progress": str(progress)}) + "\n"
        data = line.encode()
        sent = socket.send_fds(self.orders, [data], [lock, out, err])
        self.orders.sendall(data[sent:])

    def close(self) -> None:
        """Let the process end, after the command that it carries out."""
        self.orders.close()


def started(root: Path) -> Worker:
    """A process that waits for commands in a folder."""
    ours, theirs = socket.socketpair()
    with theirs:
        process = subprocess.Popen(  # noqa: S603 - our own module
            [sys.executable, "-m", "schuler.cli.worker", str(theirs.fileno())], cwd=root, stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, start_new_session=True, pass_fds=(theirs.fileno(),),
            env={**os.environ, "NO_COLOR": "1"},
        )  # fmt: skip
    return Worker(root, process, ours)
