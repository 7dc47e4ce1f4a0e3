"""Raw input, messages, solutions and events on topics: recorded as an MCAP file, or served to Foxglove.

Posts are made and handed on in a thread of their own; where that falls behind, they are counted and left out, so that
neither a slow disk nor a slow reader holds up the filter.
"""

from __future__ import annotations

import importlib.util
import json
import queue
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any, Protocol

from schuler.exceptions import InputError, MissingExtraError
from schuler.live.address import LOOPBACK, parse_address
from schuler.live.clock import SourceClock
from schuler.live.messages import Event, Message, Solution
from schuler.live.outlets import end_soon
from schuler.live.topics import JSON_TYPES, KINDS, RAW, Bytes, Item, Post, Topics
from schuler.recording.series import Kind

FORMATS = ("mcap", "foxglove")
_WAITING = 50_000  # items that wait to be handed on
_FLUSHED_S = 1.0  # between two writings of what is not on disk yet [s]


class Station(Protocol):
    """Something that takes posts."""

    def post(self, post: Post, log_ns: int) -> None:
        """Take a post that came at a Unix time. [ns]"""
        ...

    def flush(self) -> None:
        """Bring to its place what was taken."""
        ...

    def close(self) -> None:
        """Let go of what is held."""
        ...


class Publisher:
    """Sink of messages, solutions, events and bytes.

    Parameters
    ----------
    station : Station
    clock : SourceClock
    kind : callable
        Kind of the run's IMU, asked for when the first sample comes.

    Attributes
    ----------
    lost : int
        Items that were left out because the station did not follow.
    """

    def __init__(self, station: Station, clock: SourceClock, kind: Callable[[], Kind]) -> None:
        self.lost = 0
        self._station, self._clock, self._kind = station, clock, kind
        self._items: queue.Queue[tuple[int, Item] | None] = queue.Queue(_WAITING)
        self._error: Exception | None = None
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def solution(self, solution: Solution) -> None:
        """Take a solution."""
        self._take(solution)

    def event(self, event: Event) -> None:
        """Take an event."""
        self._take(event)

    def message(self, message: Message) -> None:
        """Take a message of a sensor, in SI, forward, right, down."""
        self._take(message)

    def raw(self, source: int, data: bytes) -> None:
        """Take bytes of the k-th source."""
        self._take(Bytes(source, data))

    def close(self) -> None:
        """Hand on what waits, and let go of the station.

        Raises
        ------
        Exception
            What went wrong while posts were handed on.
        """
        self._items.put(None)
        self._thread.join()
        if self._error is not None:
            raise self._error

    def _take(self, item: Item) -> None:
        try:
            self._items.put_nowait((time.time_ns(), item))
        except queue.Full:
            self.lost += 1

    def _run(self) -> None:
        topics: Topics | None = None
        flushed = time.monotonic()
        while True:
            try:
                entry = self._items.get(timeout=_FLUSHED_S)
                if entry is None:
                    break
                if self._error is None:
                    topics = topics or Topics(self._kind())
                    for post in topics.posts(entry[1], self._clock.base):
                        self._station.post(post, entry[0])
            except queue.Empty:
                pass
            except Exception as error:  # goes on where the sink is closed; the run does not end for it
                self._error = error
            if self._error is None and time.monotonic() - flushed > _FLUSHED_S:
                try:
                    self._station.flush()
                except OSError as error:
                    self._error = error
                flushed = time.monotonic()
        try:
            self._station.close()
        except Exception as error:
            self._error = self._error or error


class McapFile:
    """MCAP file that grows: what was flushed can be read whatever happens to the program.

    Parameters
    ----------
    path : Path
        Must not exist.

    Raises
    ------
    InputError
        If it exists.
    MissingExtraError
        Without mcap and rosbags (extra ``ros``).
    """

    def __init__(self, path: Path) -> None:
        schemas("recording MCAP")
        try:
            from mcap.writer import CompressionType, Writer
        except ImportError as error:
            raise MissingExtraError("mcap", "ros", "recording MCAP") from error
        path.parent.mkdir(parents=True, exist_ok=True)
        if path.exists():
            raise InputError(f"{path} exists: expected the name of a new MCAP file; name another, or remove it")
        self._file = path.open("xb")
        self._writer: Any = Writer(self._file, compression=CompressionType.LZ4)
        self._writer.start(profile="ros2", library="schuler")
        self._channels: dict[str, int] = {}

    def post(self, post: Post, log_ns: int) -> None:
        """See :class:`Station`."""
        if post.topic not in self._channels:
            name, encoding, text = schema_of(post.kind)
            schema = self._writer.register_schema(name, encoding, text)
            self._channels[post.topic] = self._writer.register_channel(post.topic, message_encoding(post.kind), schema)
        self._writer.add_message(self._channels[post.topic], log_ns, post.data, post.stamp_ns)

    def flush(self) -> None:
        """See :class:`Station`."""
        self._writer.flush()

    def close(self) -> None:
        """See :class:`Station`."""
        self._writer.finish()
        self._file.close()


class FoxgloveServer:
    """WebSocket server to which Foxglove connects; slow clients lose messages, oldest first.

    Parameters
    ----------
    host, port : str, int
        Of this machine.

    Raises
    ------
    InputError
        If the port is taken.
    MissingExtraError
        Without foxglove-sdk and rosbags (extra ``foxglove``).
    """

    def __init__(self, host: str = LOOPBACK, port: int = 8765) -> None:
        schemas("serving Foxglove", "foxglove")
        try:
            import foxglove
        except ImportError as error:
            raise MissingExtraError("foxglove", "foxglove", "serving Foxglove") from error
        self._library, self._context = foxglove, foxglove.Context()
        self._channels = {topic: self._channel(topic, kind) for topic, kind in KINDS.items()}
        try:
            self._server = foxglove.start_server(name="schuler", host=host, port=port, context=self._context)
        except RuntimeError as error:
            raise InputError(f"ws://{host}:{port}: cannot listen there: {error}; name another port") from None

    def post(self, post: Post, log_ns: int) -> None:
        """See :class:`Station`."""
        if post.topic not in self._channels:
            self._channels[post.topic] = self._channel(post.topic, post.kind)
        self._channels[post.topic].log(post.data, log_time=log_ns)

    def flush(self) -> None:
        """See :class:`Station`."""

    def close(self) -> None:
        """See :class:`Station`."""
        for channel in self._channels.values():
            channel.close()
        end_soon(self._server.stop)

    def _channel(self, topic: str, kind: str) -> Any:
        name, encoding, text = schema_of(kind)
        schema = self._library.Schema(name=name, encoding=encoding, data=text)
        return self._library.Channel(
            topic, message_encoding=message_encoding(kind), schema=schema, context=self._context
        )


def open_publisher(text: str, clock: SourceClock, kind: Callable[[], Kind]) -> Publisher:
    """Publisher of ``mcap:FILE`` or ``foxglove:ws://HOST:PORT``.

    Raises
    ------
    InputError, MissingExtraError
        See :class:`McapFile` and :class:`FoxgloveServer`.
    """
    format, _, place = text.partition(":")
    if format == "mcap":
        return Publisher(McapFile(Path(place)), clock, kind)
    address = parse_address(place, {"ws": ()}, ("ws",))
    return Publisher(FoxgloveServer(address.host, address.port), clock, kind)


def message_encoding(kind: str) -> str:
    """Encoding of messages of a type, as MCAP and Foxglove call it."""
    return "application/octet-stream" if kind == RAW else "json" if kind in JSON_TYPES else "cdr"


def schemas(purpose: str, extra: str = "ros") -> Any:
    """Definitions of the messages of ROS 2.

    Raises
    ------
    MissingExtraError
        Without rosbags.
    """
    if importlib.util.find_spec("rosbags") is None:
        raise MissingExtraError("rosbags", extra, purpose)
    from rosbags.typesys import Stores, get_typestore

    return get_typestore(Stores.ROS2_HUMBLE)


def schema_of(kind: str) -> tuple[str, str, bytes]:
    """Name, encoding and text of the definition of a type; bytes have none."""
    if kind == RAW:
        return "schuler.Bytes", "", b""
    if kind in JSON_TYPES:
        members = {name: {"type": of} for name, of in JSON_TYPES[kind].items()}
        return kind, "jsonschema", json.dumps({"type": "object", "properties": members}).encode()
    name = kind.replace("/", "/msg/")
    text, _ = schemas("messages of ROS").generate_msgdef(name, ros_version=2)
    return name, "ros2msg", text.encode()
