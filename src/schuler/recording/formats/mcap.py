"""MCAP files: messages of ROS 2, ROS 1 or as JSON, plain or in compressed chunks.

The container is read here, from its specification (mcap.dev/spec): records of an operation code, a length and a
content, every one of which is checked against the file before anything is made of it. It needs no index, so it says
where a file was cut off. Definitions of messages in the file are not used, see :mod:`.ros_messages`.
"""

from __future__ import annotations

import mmap
import struct
import zlib
from pathlib import Path
from typing import Any

from schuler.exceptions import FileFormatError
from schuler.recording.formats import ros_recording, ros_write
from schuler.recording.formats.registry import needs
from schuler.recording.formats.ros_messages import LAYOUTS, plain_type
from schuler.recording.formats.ros_recording import Topic
from schuler.recording.io import checks
from schuler.recording.io.hints import ReadHints
from schuler.recording.io.streams import Stream
from schuler.recording.recording import Recording

MAGIC = b"\x89MCAP0\r\n"
_HEADER, _FOOTER, _SCHEMA, _CHANNEL, _MESSAGE, _CHUNK, _DATA_END = 0x01, 0x02, 0x03, 0x04, 0x05, 0x06, 0x0F
_LARGEST_CHUNK = 1 << 28  # writers make chunks of a megabyte; more is damage [byte]
_ENCODINGS = {"cdr": "cdr", "ros1": "ros1", "json": "json"}


def sniff(head: bytes, path: Path) -> bool:
    """Whether a file starts as MCAP does."""
    return head.startswith(MAGIC)


def read(path: Path, hints: ReadHints) -> Recording:
    """Recording of an MCAP file, see :func:`schuler.recording.formats.ros_recording.read_topics`."""
    cut = hints.allows("truncated")
    topics, notes = scan(path, allow_truncated=cut)
    return ros_recording.recording_of(path, topics, hints, notes, "an MCAP file")


def contents(path: Path) -> list[Stream]:
    """Topics of the file."""
    return ros_recording.streams_of(path, scan(path, allow_truncated=True)[0])


def write(recording: Recording, path: Path) -> list[Path]:
    """Write a recording as ROS 2 messages in one file, see :func:`schuler.recording.formats.ros_write.write_mcap`."""
    return ros_write.write_mcap(recording, path)


def scan(path: Path, *, allow_truncated: bool = False) -> tuple[list[Topic], list[str]]:
    """Topics of a file, with the messages of those types that are read.

    Parameters
    ----------
    path : Path
    allow_truncated : bool
        Take what there is of a file that was cut off, with a note.

    Raises
    ------
    FileFormatError
        At the first record that is damaged or cut off.
    """
    notes: list[str] = []
    size = path.stat().st_size
    if size < len(MAGIC):
        raise FileFormatError(f"expected an MCAP file, got {size} bytes", path)
    schemas: dict[int, tuple[str, str]] = {}
    channels: dict[int, Topic] = {}
    with path.open("rb") as stream, mmap.mmap(stream.fileno(), 0, access=mmap.ACCESS_READ) as data:
        at, ended, unpacked = len(MAGIC), False, 0
        while at < size and not ended:
            if size - at < 9 or size - at - 9 < struct.unpack_from("<Q", data, at + 1)[0]:
                message = f"the file was cut off or is damaged at byte {at} of {size}"
                if not allow_truncated:
                    raise FileFormatError(f"{message}: pass allow='truncated' to read what there is", path)
                notes.append(f"T{message[1:]}; what stands before was read.")
                break
            operation, length = struct.unpack_from("<BQ", data, at)
            content = data[at + 9 : at + 9 + length] if operation in (_SCHEMA, _CHANNEL, _MESSAGE, _CHUNK) else b""
            try:
                if operation == _CHUNK:
                    unpacked += max(struct.unpack_from("<QQQI", content)[2] - len(content), 0)
                    checks.check_unpacked(unpacked, size)
                    _chunk(content, schemas, channels, path)
                else:
                    _record(operation, content, schemas, channels)
            except (struct.error, ValueError, KeyError) as error:
                if isinstance(error, FileFormatError):
                    raise
                raise FileFormatError(f"the record at byte {at} is damaged ({error!r})", path) from error
            ended = operation in (_DATA_END, _FOOTER)
            at += 9 + length
        else:
            if not ended or data[size - len(MAGIC) :] != MAGIC:
                if not allow_truncated:
                    raise FileFormatError("the file ends early: pass allow='truncated' to read what there is", path)
                notes.append("The file ends early; what there is was read.")
    return list(channels.values()), notes


def _chunk(content: bytes, schemas: dict[int, tuple[str, str]], channels: dict[int, Topic], path: Path) -> None:
    _, _, size, checksum = struct.unpack_from("<QQQI", content)
    compression, at = _text(content, 28)
    (length,) = struct.unpack_from("<Q", content, at)
    packed = content[at + 8 :]
    if len(packed) != length:
        raise ValueError(f"{len(packed)} bytes in a chunk of {length}")
    if size > _LARGEST_CHUNK:
        raise ValueError(f"a chunk of {size} bytes")
    records = _unpacked(packed, compression, size, path)
    if len(records) != size:
        raise ValueError(f"{len(records)} bytes unpacked, {size} said")
    if checksum and zlib.crc32(records) != checksum:
        raise ValueError("wrong checksum of a chunk")
    at = 0
    while at < size:
        operation, length = struct.unpack_from("<BQ", records, at)
        at += 9
        if length > size - at:
            raise ValueError(f"a record of {length} bytes in a chunk that ends {size - at} behind")
        _record(operation, records[at : at + length], schemas, channels)
        at += length


def _record(operation: int, content: bytes, schemas: dict[int, tuple[str, str]], channels: dict[int, Topic]) -> None:
    if operation == _MESSAGE:
        number, _, log_ns, _ = struct.unpack_from("<HIQQ", content)
        topic = channels[number]
        topic.log_ns.append(min(log_ns, 2**63 - 1))
        if topic.wanted:
            topic.raw.append(content[22:])
    elif operation == _CHANNEL:
        number, schema = struct.unpack_from("<HH", content)
        if number in channels:
            return  # repeated in every chunk
        name, at = _text(content, 4)
        encoding, _ = _text(content, at)
        kind = plain_type(schemas.get(schema, ("", ""))[0])
        plain = _ENCODINGS.get(encoding)
        channels[number] = Topic(name, kind, plain or encoding, kind in LAYOUTS and plain is not None)
    elif operation == _SCHEMA:
        (number,) = struct.unpack_from("<H", content)
        name, at = _text(content, 2)
        schemas[number] = (name, _text(content, at)[0])


def _unpacked(packed: bytes, compression: str, size: int, path: Path) -> bytes:
    if compression == "":
        return packed
    try:
        if compression == "lz4":
            from lz4.frame import LZ4FrameDecompressor

            return bytes(LZ4FrameDecompressor().decompress(packed, max_length=size + 1))
        if compression == "zstd":
            return _unzstd(packed, size)
    except ImportError as error:
        raise needs(compression, "mcap", "reading compressed MCAP files") from error
    # lz4 raises RuntimeError, zstd an error of its own module
    except Exception as error:
        raise ValueError(f"a chunk that cannot be unpacked: {error}") from error
    raise FileFormatError(f"compression {compression!r} is not known; lz4 and zstd are", path)


def _unzstd(packed: bytes, size: int) -> bytes:
    import sys

    zstd: Any
    if sys.version_info >= (3, 14):
        from compression import zstd  # type: ignore[import-not-found,unused-ignore]
    else:
        from backports import zstd  # type: ignore[import-not-found,no-redef,unused-ignore]
    return bytes(zstd.ZstdDecompressor().decompress(packed, max_length=size + 1))


def _text(content: bytes, at: int) -> tuple[str, int]:
    (length,) = struct.unpack_from("<I", content, at)
    end = at + 4 + length
    if end > len(content):
        raise ValueError("a text reaches beyond its record")
    return content[at + 4 : end].decode("utf-8"), end
