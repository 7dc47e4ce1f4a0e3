"""Sources of bytes: serial lines, UDP, TCP, WebSockets, MQTT, standard input.

Each is a generator of what has come; it yields nothing (``b""``) when nothing came for :data:`POLL_S`, so that whoever
reads it can look after other things. A source that is lost (a cable pulled, a program restarted) is opened again and
again, first at once, then up to every :data:`LONGEST_WAIT_S`. Only the first failure and the return are reported.
"""

from __future__ import annotations

import os
import queue
import select
import socket
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, closing, contextmanager, suppress
from typing import Any

from schuler.exceptions import InputError, MissingExtraError
from schuler.live.address import Address, parse_address

POLL_S = 0.05  # longest time without a word to whoever reads a source [s]
SHORTEST_WAIT_S, LONGEST_WAIT_S = 0.2, 10.0  # before a lost source is opened again [s]
_CONNECT_S = 5.0  # longest wait for the other side to answer [s]
_BLOCK = 65_536
_BAUD = 115_200
#: Options of every source of bytes: how they are decoded, and on whose clock.
_DECODING = ("format", "part", "columns", "units", "axes", "time", "stamp")
SCHEMES = {
    "replay": ("speed", "raw", *_DECODING),
    "serial": ("baud", "retry", *_DECODING),
    "udp": _DECODING,
    "tcp": ("retry", *_DECODING),
    "ws": ("retry", *_DECODING),
    "mqtt": _DECODING,
    "stdin": _DECODING,
}
NETWORKS = ("udp", "tcp", "ws", "mqtt")
#: Sources whose pieces are whole messages, so that a line needs no line feed.
DATAGRAMS = ("udp", "ws", "mqtt")

Notify = Callable[[str], None]
#: Reads what has come: ``b""`` if nothing came for a while, OSError or EOFError if the other side is gone.
Reader = Callable[[], bytes]


def parse_source(text: str) -> Address:
    """Check the address of a source.

    Raises
    ------
    InputError
        See :func:`schuler.live.address.parse_address`.
    """
    return parse_address(text, SCHEMES, NETWORKS)


def chunks(address: Address, stop: threading.Event, notify: Notify) -> Iterator[bytes]:
    """Bytes of a source as they come.

    Parameters
    ----------
    address : Address
        Of :func:`parse_source`; any scheme but ``replay``.
    stop : Event
        Ends the source when it is set.
    notify : callable
        Called with a sentence when the source is connected or lost.

    Yields
    ------
    bytes
        Empty if nothing came for :data:`POLL_S`.

    Raises
    ------
    InputError
        If the address can never work, such as a UDP port that is taken.
    MissingExtraError
        If the library of a scheme is not installed.
    """
    if address.scheme == "stdin":
        return _standard_input(stop)
    if address.scheme == "udp":
        return _datagrams(address, stop, notify)
    if address.scheme == "mqtt":
        return _subscription(address, stop, notify)
    connect = {"serial": _serial, "tcp": _tcp, "ws": _websocket}[address.scheme](address)
    return _reconnecting(connect, address, stop, notify)


def _reconnecting(
    connect: Callable[[], AbstractContextManager[Reader]], address: Address, stop: threading.Event, notify: Notify
) -> Iterator[bytes]:
    """Bytes of a connection that is opened again whenever it is lost, unless ``retry=0``."""
    again, wait, down = address.number("retry", 1.0) != 0.0, SHORTEST_WAIT_S, False
    while not stop.is_set():
        try:
            with connect() as read:
                if not down:
                    notify("connected")
                while not stop.is_set():
                    data = read()
                    if data and down:
                        notify("connected again")
                        wait, down = SHORTEST_WAIT_S, False
                    yield data
        except (OSError, EOFError) as error:
            reason = getattr(error, "strerror", None) or str(error) or type(error).__name__
            if not again:
                notify(f"ended: {reason}")
                return
            if not down:
                notify(f"lost: {reason}; it is tried again until it answers")
            down = True
            yield b""
            stop.wait(wait)
            wait = min(2.0 * wait, LONGEST_WAIT_S)


def _standard_input(stop: threading.Event) -> Iterator[bytes]:
    handle = sys.stdin.fileno()
    while not stop.is_set():
        if not select.select([handle], [], [], POLL_S)[0]:
            yield b""
            continue
        data = os.read(handle, _BLOCK)
        if not data:
            return
        yield data


def _serial(address: Address) -> Callable[[], AbstractContextManager[Reader]]:
    try:
        import serial
    except ImportError as error:
        raise MissingExtraError("serial", "live", "reading a serial line") from error
    baud = int(address.number("baud", _BAUD))

    @contextmanager
    def connect() -> Iterator[Reader]:
        with closing(serial.Serial(address.path, baud, timeout=POLL_S)) as line:

            def read() -> bytes:
                data: bytes = line.read(max(1, min(line.in_waiting, _BLOCK)))
                return data

            yield read

    return connect


def _tcp(address: Address) -> Callable[[], AbstractContextManager[Reader]]:
    @contextmanager
    def connect() -> Iterator[Reader]:
        with socket.create_connection((address.host, address.port), _CONNECT_S) as connection:
            connection.settimeout(POLL_S)

            def read() -> bytes:
                try:
                    data = connection.recv(_BLOCK)
                except TimeoutError:
                    return b""
                if not data:
                    raise EOFError("the other side closed the connection")
                return data

            yield read

    return connect


def _datagrams(address: Address, stop: threading.Event, notify: Notify) -> Iterator[bytes]:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as port:
        try:
            port.bind((address.host, address.port))
        except OSError as error:
            raise InputError(
                f"{address.text}: cannot listen on {address.host}:{address.port}: {error.strerror}; name another port, "
                "or an address of this machine (0.0.0.0 for all of them)"
            ) from None
        port.settimeout(POLL_S)
        notify(f"listening on {address.host}:{address.port}")
        while not stop.is_set():
            try:
                yield port.recv(_BLOCK)
            except TimeoutError:
                yield b""


def _websocket(address: Address) -> Callable[[], AbstractContextManager[Reader]]:
    try:
        from websockets.exceptions import WebSocketException
        from websockets.sync.client import connect as open_socket
    except ImportError as error:
        raise MissingExtraError("websockets", "live", "reading a WebSocket") from error

    @contextmanager
    def connect() -> Iterator[Reader]:
        try:
            with open_socket(
                f"ws://{address.host}:{address.port}/{address.path}", open_timeout=_CONNECT_S, compression=None
            ) as connection:

                def read() -> bytes:
                    try:
                        data = connection.recv(timeout=POLL_S)
                    except TimeoutError:
                        return b""
                    return data.encode() if isinstance(data, str) else data

                yield read
        except WebSocketException as error:
            raise EOFError(str(error)) from None

    return connect


def _subscription(address: Address, stop: threading.Event, notify: Notify) -> Iterator[bytes]:
    """Payloads of the messages of an MQTT topic; paho connects again by itself."""
    try:
        from paho.mqtt.client import Client
        from paho.mqtt.enums import CallbackAPIVersion
    except ImportError as error:
        raise MissingExtraError("paho.mqtt", "live", "subscribing to an MQTT topic") from error
    if not address.path:
        raise InputError(f"{address.text}: expected mqtt://HOST:PORT/TOPIC, got no topic")
    payloads: queue.SimpleQueue[bytes] = queue.SimpleQueue()

    def subscribe(client: Any, _data: Any, _flags: Any, reason: Any, _properties: Any) -> None:
        if reason.is_failure:
            notify(f"refused: {reason}; it is tried again until it answers")
            return
        client.subscribe(address.path)
        notify("connected")

    client = Client(CallbackAPIVersion.VERSION2)
    client.reconnect_delay_set(1, int(LONGEST_WAIT_S))
    client.on_connect = subscribe
    client.on_disconnect = lambda *_: None if stop.is_set() else notify("lost; it is tried again until it answers")
    client.on_message = lambda _client, _data, message: payloads.put(bytes(message.payload))
    client.connect_async(address.host, address.port)
    client.loop_start()
    try:
        while not stop.is_set():
            try:
                yield payloads.get(timeout=POLL_S)
            except queue.Empty:
                yield b""
    finally:
        with suppress(OSError):
            client.disconnect()
        client.loop_stop()
