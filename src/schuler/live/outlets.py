"""Where lines go: standard output, a file, UDP, clients of a TCP port or WebSocket. None ever holds up the filter."""

from __future__ import annotations

import os
import queue
import socket
import sys
import threading
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any, Protocol

from schuler.exceptions import InputError, MissingExtraError
from schuler.live.address import parse_address

_SCHEMES: dict[str, tuple[str, ...]] = {"udp": (), "tcp": (), "ws": ()}
CLOSED_S = 2.0  # longest wait for clients at the end [s]
_WAITING = 1000  # lines that wait for a client of a WebSocket before it is let go


class Outlet(Protocol):
    """Something that takes lines."""

    def write(self, lines: str) -> None:
        """Take one or more whole lines with their ends."""
        ...

    def close(self) -> None:
        """Let go of what is held."""
        ...


def open_outlet(place: str, beginning: str = "") -> Outlet:
    """Open a place for lines.

    Parameters
    ----------
    place : str
        ``-``, ``udp://HOST:PORT``, ``tcp://HOST:PORT`` or ``ws://HOST:PORT`` (this machine's own address, loopback if
        left out, to which clients connect), or the name of a file, to which lines are appended.
    beginning : str
        What a file that is not empty begins with, if it is one of such lines.

    Raises
    ------
    InputError
        If the address is wrong or taken, or the file is a folder or of something else.
    MissingExtraError
        For a WebSocket without websockets (extra ``live``).
    """
    if place == "-":
        return _StandardOutput()
    if not place.startswith(("udp:", "tcp:", "ws:")):
        return _File(Path(place), beginning)
    address = parse_address(place, _SCHEMES, tuple(_SCHEMES))
    if address.scheme == "udp":
        return _Datagrams(address.host, address.port)
    if address.scheme == "ws":
        return _WebSocketClients(address.host, address.port)
    return _Clients(address.host, address.port)


def end_soon(end: Callable[[], None]) -> None:
    """Let a server end, and go on if it still waits for clients that say nothing after :data:`CLOSED_S`."""
    ending = threading.Thread(target=end, daemon=True)
    ending.start()
    ending.join(CLOSED_S)


class _StandardOutput:
    def write(self, lines: str) -> None:
        sys.stdout.write(lines)
        sys.stdout.flush()

    def close(self) -> None:
        pass


class _File:
    """Appended to line by line: what was written stays there whatever happens."""

    def __init__(self, path: Path, beginning: str) -> None:
        if path.is_dir():
            raise InputError(f"{path}: expected the name of a file, it is a folder: give a file in it")
        if path.is_file():
            with path.open("rb") as file:
                head = file.read(len(beginning)).decode(errors="replace")
            if head and head != beginning:
                raise InputError(
                    f"{path}: expected a new file, or lines of an earlier run that begin with {beginning}, got "
                    f"{head!r}: it is kept as it is, give another name"
                )
        path.parent.mkdir(parents=True, exist_ok=True)
        self._handle = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_APPEND, 0o666)

    def write(self, lines: str) -> None:
        os.write(self._handle, lines.encode())

    def close(self) -> None:
        os.close(self._handle)


class _Datagrams:
    def __init__(self, host: str, port: int) -> None:
        self._to = (host, port)
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.setblocking(False)

    def write(self, lines: str) -> None:
        with suppress(OSError):  # nobody listens, or the network is away
            self._socket.sendto(lines.encode(), self._to)

    def close(self) -> None:
        self._socket.close()


class _Clients:
    """Clients of a port; one that does not read what it gets is let go."""

    def __init__(self, host: str, port: int) -> None:
        self._clients: list[socket.socket] = []
        try:
            self._server = socket.create_server((host, port))
        except OSError as error:
            raise InputError(f"tcp://{host}:{port}: cannot listen there: {error.strerror}; name another port") from None
        self._server.setblocking(False)

    def write(self, lines: str) -> None:
        with suppress(BlockingIOError):
            while True:
                client, _ = self._server.accept()
                client.setblocking(False)
                self._clients.append(client)
        data = lines.encode()
        for client in self._clients.copy():
            try:
                whole = client.send(data) == len(data)
            except OSError:
                whole = False
            if not whole:
                self._clients.remove(client)
                client.close()

    def close(self) -> None:
        for held in (*self._clients, self._server):
            held.close()


class _WebSocketClients:
    """Clients of a WebSocket, each in a thread of its own; one that does not read what it gets is let go."""

    def __init__(self, host: str, port: int) -> None:
        try:
            from websockets.sync.server import serve
        except ImportError as error:
            raise MissingExtraError("websockets", "live", "serving a WebSocket") from error
        self._waiting: dict[Any, queue.Queue[str | None]] = {}
        self._lock = threading.Lock()
        try:
            self._server = serve(
                self._send, host, port, compression=None, open_timeout=CLOSED_S, close_timeout=CLOSED_S
            )
        except OSError as error:
            raise InputError(f"ws://{host}:{port}: cannot listen there: {error.strerror}; name another port") from None
        threading.Thread(target=self._server.serve_forever, daemon=True).start()

    def write(self, lines: str) -> None:
        self._hand_out(lines)

    def close(self) -> None:
        self._hand_out(None)
        end_soon(self._server.shutdown)

    def _hand_out(self, lines: str | None) -> None:
        """Lines, or that there are no more, to every client; one whose queue is full is let go."""
        with self._lock:
            clients = list(self._waiting.items())
        for client, waiting in clients:
            try:
                waiting.put_nowait(lines)
            except queue.Full:
                self._let_go(client)

    def _send(self, client: Any) -> None:
        from websockets.exceptions import ConnectionClosed

        waiting: queue.Queue[str | None] = queue.Queue(_WAITING)
        with self._lock:
            self._waiting[client] = waiting
        with suppress(ConnectionClosed, OSError):
            for lines in iter(waiting.get, None):
                client.send(lines)
        with self._lock:
            self._waiting.pop(client, None)

    def _let_go(self, client: Any) -> None:
        with self._lock:
            self._waiting.pop(client, None)
        with suppress(OSError):
            client.socket.shutdown(socket.SHUT_RDWR)  # wakes the thread that waits for it
