"""Commands run one after another in one process, so that imports and compiled kernels are there for the second.

``python -m schuler.cli.worker DESCRIPTOR`` is started by :mod:`schuler.studio.worker`, which sends through the socket
of that number a line of JSON for each command, and with it three open files: the job's lock, stdout and stderr.
"""

from __future__ import annotations

import json
import os
import socket
import sys
import traceback
from typing import Any

_LINE = 1 << 16  # bytes that are read at once


def serve(orders: socket.socket) -> None:
    """Carry out commands until the other end of the socket is closed, which it is when the server ends.

    Parameters
    ----------
    orders : socket
        Gives lines ``{"command": [...], "progress": FILE}``.
    """
    import schuler.cli.navigate
    import schuler.navigation.report.document
    import schuler.navigation.run  # noqa: F401 - before it is asked for

    while True:
        received = _received(orders)
        if received is None:
            return
        order, (lock, out, err) = received
        os.environ["SCHULER_PROGRESS"] = order["progress"]
        _carried_out(order["command"], out, err)
        os.close(lock)  # last: whoever finds it free reads the answer


def _received(orders: socket.socket) -> tuple[dict[str, Any], list[int]] | None:
    """Next command and its files, None at the end."""
    data, files, _, _ = socket.recv_fds(orders, _LINE, 3)
    while data and not data.endswith(b"\n"):
        more = orders.recv(_LINE)
        data = data + more if more else b""
    if not data:
        return None
    for number in files:
        os.set_inheritable(number, False)
    return json.loads(data), list(files)


def _carried_out(command: list[str], out: int, err: int) -> None:
    """Run a command as ``python -m schuler`` would, its output into these files, which are closed."""
    from schuler.cli import main

    for target, number in ((1, out), (2, err)):
        os.dup2(number, target)
        os.close(number)
    try:
        main(command)
    except Exception:
        traceback.print_exc()
    finally:
        sys.stdout.flush()
        sys.stderr.flush()
        nowhere = os.open(os.devnull, os.O_RDWR)
        for target in (1, 2):
            os.dup2(nowhere, target)
        os.close(nowhere)


if __name__ == "__main__":
    with socket.socket(fileno=int(sys.argv[1])) as _orders:
        serve(_orders)
