"""Packed RINEX files: gzip, bzip2 and zip by Python, compress (.Z) and Hatanaka's scheme by the library hatanaka.

Hatanaka's scheme keeps differences of the numbers from epoch to epoch. The library carries the authors' own program,
which nobody should write again.
"""

from __future__ import annotations

import bz2
import importlib
import io
import warnings
import zipfile
import zlib
from pathlib import Path
from typing import Any

from schuler.exceptions import FileFormatError, InputError
from schuler.recording.io import lines

_ROOM = 1 << 26  # what any file may unpack to [byte]
_PACKED = 50  # times its size, beyond that; RINEX packs by 4, in Hatanaka's scheme by 15


def unpack(path: Path, notes: list[str]) -> bytes:
    """Text of a file however it is packed.

    Raises
    ------
    FileFormatError
        If the file is missing, empty or damaged, or a zip holds more than one file.
    InputError
        If the library hatanaka is needed and not installed.
    """
    head = lines.check_file(path)
    data = path.read_bytes()
    limit = max(_ROOM, _PACKED * len(data))
    if head.startswith(b"\x1f\x8b"):
        data = _gunzip(data, path, notes, limit)
    elif head.startswith(b"BZh"):
        data = _bunzip(data, path, limit)
    elif head.startswith(b"PK\x03\x04"):
        data = _unzip(data, path, limit)
    elif head.startswith(b"\x1f\x9d"):
        data = _uncompress(data, path, limit)
    if not data:
        raise FileFormatError("the packed file is empty", path)
    if data[:100].partition(b"\n")[0][60:].startswith(b"CRINEX VERS"):
        data = _by_library(data, path, "Hatanaka's scheme", notes)
    return data


def _gunzip(data: bytes, path: Path, notes: list[str], limit: int) -> bytes:
    """All members of a gzip file, as far as they go."""
    parts, rest, size = [], data, 0
    while rest.startswith(b"\x1f\x8b"):
        member = zlib.decompressobj(wbits=31)
        try:
            parts.append(member.decompress(rest, limit - size + 1))
        except zlib.error as error:
            raise FileFormatError(f"the gzip file is damaged ({error}); fetch it again", path) from error
        size += len(parts[-1])
        if size > limit:
            raise _too_large(path, limit)
        if not member.eof:
            notes.append("The gzip file is cut off; it was read as far as it goes.")
        rest = member.unused_data
    return b"".join(parts)


def _bunzip(data: bytes, path: Path, limit: int) -> bytes:
    parts, rest, size = [], data, 0
    try:
        while rest:
            stream = bz2.BZ2Decompressor()
            parts.append(stream.decompress(rest, limit - size + 1))
            size += len(parts[-1])
            if size > limit:
                break
            if not stream.eof:
                raise ValueError("it is cut off")
            rest = stream.unused_data
    except (OSError, ValueError, EOFError) as error:
        raise FileFormatError(f"the bzip2 file is damaged: {error}", path) from error
    if size > limit:
        raise _too_large(path, limit)
    return b"".join(parts)


def _unzip(data: bytes, path: Path, limit: int) -> bytes:
    try:
        with zipfile.ZipFile(io.BytesIO(data)) as archive:
            names = [name for name in archive.namelist() if not name.endswith("/")]
            if len(names) != 1:
                raise FileFormatError(f"expected one file in the zip, got {len(names)}: unpack it", path)
            with archive.open(names[0]) as member:
                content = member.read(limit + 1)
    except (zipfile.BadZipFile, zlib.error, RuntimeError, NotImplementedError, OSError, EOFError, ValueError) as error:
        raise FileFormatError(f"the zip file cannot be read: {error}", path) from error
    if len(content) > limit:
        raise _too_large(path, limit)
    return content


def _uncompress(data: bytes, path: Path, limit: int) -> bytes:
    """Unix compress (.Z), by the library that comes with hatanaka."""
    try:
        ncompress = importlib.import_module("ncompress")
    except ImportError as error:
        raise _needs_hatanaka(path, "compress (.Z)") from error
    out = _Bounded()
    out.limit = limit
    try:
        ncompress.decompress(data, out)
    except (ValueError, OSError, RuntimeError) as error:
        if out.full:
            raise _too_large(path, limit) from error
        raise FileFormatError(f"cannot be unpacked (compress (.Z)): {error}", path) from error
    return out.getvalue()


class _Bounded(io.BytesIO):
    """A stream that takes no more than a number of bytes, for a library that asks for nothing but a stream."""

    limit = 0
    full = False

    def write(self, data: Any) -> int:
        if self.tell() + len(data) > self.limit:
            self.full = True
            raise ValueError("more than the limit")
        return super().write(data)


def _too_large(path: Path, limit: int) -> FileFormatError:
    return FileFormatError(f"unpacks to more than {limit / 1e6:.0f} MB, which no RINEX file does: it is damaged", path)


def _needs_hatanaka(path: Path, how: str) -> InputError:
    return InputError(
        f"{path} is packed with {how}, which needs the library hatanaka: pip install hatanaka, or unpack the file"
    )


def _by_library(data: bytes, path: Path, how: str, notes: list[str]) -> bytes:
    try:
        hatanaka = importlib.import_module("hatanaka")
    except ImportError as error:
        raise _needs_hatanaka(path, how) from error
    try:
        with warnings.catch_warnings(record=True) as issued:
            warnings.simplefilter("always")
            text = bytes(hatanaka.decompress(data))
        notes += [f"On unpacking ({how}): {' '.join(str(w.message).split())}" for w in issued]
        return text
    except (hatanaka.HatanakaException, ValueError, OSError) as error:
        first = str(error).strip().partition("\n")[0]
        raise FileFormatError(f"cannot be unpacked ({how}): {first or type(error).__name__}", path) from error
