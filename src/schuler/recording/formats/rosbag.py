"""Bags of ROS 1 (``.bag``, version 2.0) and ROS 2 (a folder with ``metadata.yaml``, or a ``.db3`` file).

The containers are read by rosbags, which needs no ROS; sizes in a ROS 1 bag are checked against the file before. What
is in the messages is read here, see :mod:`.ros_messages`.
"""

from __future__ import annotations

import bz2
import struct
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from schuler.exceptions import FileFormatError, SchulerError
from schuler.recording.formats import mcap, ros_recording, ros_write
from schuler.recording.formats.registry import check_installed
from schuler.recording.formats.ros_messages import LAYOUTS, plain_type
from schuler.recording.formats.ros_recording import Topic
from schuler.recording.io import checks, child
from schuler.recording.io.hints import ReadHints
from schuler.recording.io.streams import Stream
from schuler.recording.recording import Recording

MAGIC = b"#ROSBAG V2.0\n"
_SQLITE = b"SQLite format 3\x00"
_LARGEST_CHUNK = 1 << 28  # writers make chunks of a megabyte; more is damage [byte]
_CHUNK = 5


def sniff(head: bytes, path: Path) -> bool:
    """Whether a file is a bag of ROS 1 or the database of one of ROS 2."""
    return head.startswith(b"#ROSBAG V") or (head.startswith(_SQLITE) and path.suffix.lower() == ".db3")


def sniff_folder(path: Path) -> bool:
    """Whether a folder is a bag of ROS 2."""
    try:
        with (path / "metadata.yaml").open("rb") as stream:
            return b"rosbag2_bagfile_information" in stream.read(4096)
    except OSError:
        return False


def read(path: Path, hints: ReadHints) -> Recording:
    """Recording of a bag, see :func:`schuler.recording.formats.ros_recording.recording_of`."""
    topics, notes = scan(path)
    sources = sorted(p for p in path.iterdir() if p.is_file()) if path.is_dir() else [path]
    return ros_recording.recording_of(path, topics, hints, notes, "a ROS bag", sources)


def contents(path: Path) -> list[Stream]:
    """Topics of the bag."""
    return ros_recording.streams_of(path, scan(path)[0])


def write(recording: Recording, path: Path, storage: str = "sqlite3") -> list[Path]:
    """Write a bag of ROS 2, a folder; see :func:`schuler.recording.formats.ros_write.write_bag`."""
    return ros_write.write_bag(recording, path, storage)


def scan(path: Path) -> tuple[list[Topic], list[str]]:
    """Topics of a bag, with the messages of those types that are read.

    Raises
    ------
    FileFormatError
        If the bag is damaged, cut off, or of another version.
    MissingExtraError
        Without rosbags.
    """
    if not path.is_dir() and _head(path).startswith(b"#ROSBAG V"):
        check_bag1(path)
    check_installed("rosbags", "rosbag", "reading ROS bags")
    if path.is_dir() and (files := sorted(path.glob("*.mcap"))):
        return _joined(files)
    return child.call(extract, path), []


def extract(path: Path) -> list[Topic]:
    """Topics of a bag: everything that rosbags, SQLite and YAML have to do with it.

    Raises
    ------
    FileFormatError
        If the bag is damaged or cut off.
    """
    from rosbags.rosbag1 import Reader as Reader1
    from rosbags.rosbag2 import Reader as Reader2

    one = path.is_file() and path.suffix.lower() != ".db3"
    topics: dict[tuple[str, str], Topic] = {}
    try:
        with Reader1(path) if one else Reader2(path) as reader:
            for connection in reader.connections:
                kind = plain_type(connection.msgtype)
                key = connection.topic, kind
                if key not in topics:
                    topics[key] = Topic(*key, "ros1" if one else "cdr", kind in LAYOUTS)
                topics[key].other += 0 if topics[key].wanted else connection.msgcount
            connections = [c for c in reader.connections if topics[c.topic, plain_type(c.msgtype)].wanted]
            for connection, log_ns, raw in reader.messages(connections=connections) if connections else ():
                topic = topics[connection.topic, plain_type(connection.msgtype)]
                topic.log_ns.append(log_ns)
                topic.raw.append(bytes(raw))
    except SchulerError:
        raise
    # rosbags, SQLite, YAML and the decompressors each have errors of their own
    except Exception as error:
        text = str(error).splitlines()[0] if str(error) else type(error).__name__
        raise FileFormatError(f"cannot be read as a ROS bag ({text[:200]}); is it complete?", path) from error
    return list(topics.values())


def check_bag1(path: Path) -> None:
    """Check that every record of a ROS 1 bag lies within the file, before a library believes its sizes.

    Raises
    ------
    FileFormatError
        With the byte where the bag is damaged or was cut off.
    """
    size = path.stat().st_size
    with path.open("rb") as stream:
        if stream.read(len(MAGIC)) != MAGIC:
            raise FileFormatError("only version 2.0 of ROS 1 bags is read: convert it with rosbag fix", path)
        at, unpacked = len(MAGIC), 0
        while at < size:
            try:
                fields, length = _record1(stream, at, size)
                if fields.get(b"op") == bytes([_CHUNK]):
                    unpacked += struct.unpack("<I", fields.get(b"size", b""))[0]
                    checks.check_unpacked(unpacked, size)
                    _check_chunk(stream, fields, length)
            except (struct.error, ValueError, OSError) as error:
                message = f"the bag was cut off or is damaged at byte {at} of {size} ({error})"
                raise FileFormatError(f"{message}: repair it with rosbag reindex", path) from error
            at = stream.tell() + length
            stream.seek(at)


def _record1(stream: Any, at: int, size: int) -> tuple[dict[bytes, bytes], int]:
    """Header of the record at a byte, and the length of its data; the stream then stands at the data."""
    (length,) = struct.unpack("<I", stream.read(4))
    if length > size - at - 8:
        raise ValueError(f"a header of {length} bytes")
    header = stream.read(length)
    fields, k = {}, 0
    while k < length:
        (n,) = struct.unpack_from("<I", header, k)
        name, equals, value = header[k + 4 : k + 4 + n].partition(b"=")
        if n > length - k - 4 or not equals:
            raise ValueError("a field beyond its header")
        fields[name] = value
        k += 4 + n
    (data,) = struct.unpack("<I", stream.read(4))
    if data > size - at - 8 - length:
        raise ValueError(f"{data} bytes of data")
    return fields, data


def _check_chunk(stream: Any, fields: dict[bytes, bytes], length: int) -> None:
    (unpacked,) = struct.unpack("<I", fields.get(b"size", b""))
    if unpacked > _LARGEST_CHUNK:
        raise ValueError(f"a chunk of {unpacked} bytes")
    place = stream.tell()
    if fields.get(b"compression") == b"bz2":
        # bzip2 does not say how much comes out, so it is tried; such bags are few and small
        more = len(bz2.BZ2Decompressor().decompress(stream.read(length), unpacked + 1)) > unpacked
        stream.seek(place)
        if more:
            raise ValueError(f"a chunk that unpacks to more than the {unpacked} bytes it says")
    if fields.get(b"compression") == b"lz4" and length >= 15:
        frame = stream.read(15)
        stream.seek(place)
        # bit 3 of the descriptor: eight bytes that say how much comes out
        if frame[4] & 8 and struct.unpack_from("<Q", frame, 6)[0] > _LARGEST_CHUNK:
            raise ValueError("a packed chunk of impossible size")


def _joined(files: list[Path]) -> tuple[list[Topic], list[str]]:
    """Topics of a bag that is kept in MCAP files, in order."""
    topics: dict[tuple[str, str, str], Topic] = {}
    notes: list[str] = []
    for part, more in _scanned(files):
        notes += more
        for topic in part:
            key = topic.name, topic.kind, topic.encoding
            if key in topics:
                topics[key].log_ns += topic.log_ns
                topics[key].raw += topic.raw
            else:
                topics[key] = topic
    return list(topics.values()), notes


def _scanned(files: list[Path]) -> Iterator[tuple[list[Topic], list[str]]]:
    for file in files:
        yield mcap.scan(file)


def _head(path: Path) -> bytes:
    with path.open("rb") as stream:
        return stream.read(16)
