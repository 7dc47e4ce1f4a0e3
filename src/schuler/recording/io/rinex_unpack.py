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

from schuler.exceptions import FileFormatError, InputError
from schuler.recording.io import lines


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
    if head.startswith(b"\x1f\x8b"):
        data = _gunzip(data, path, notes)
    elif head.startswith(b"BZh"):
        try:
            data = bz2.decompress(data)
        except (OSError, ValueError, EOFError) as error:
            raise FileFormatError(f"the bzip2 file is damaged: {error}", path) from error
    elif head.startswith(b"PK\x03\x04"):
        data = _unzip(data, path)
    elif head.startswith(b"\x1f\x9d"):
        data = _by_library(data, path, "compress (.Z)", notes)
    if not data:
        raise FileFormatError("the packed file is empty", path)
    if data[:100].partition(b"\n")[0][60:].startswith(b"CRINEX VERS"):
        data = _by_library(data, path, "Hatanaka's scheme", notes)
    return data


def _gunzip(data: bytes, path: Path, notes: list[str]) -> bytes:
    """All members of a gzip file, as far as they go."""
    parts, rest = [], data
    while rest.startswith(b"\x1f\x8b"):
        member = zlib.decompressobj(wbits=31)
        try:
            parts.append(member.decompress(rest))
        except zlib.error as error:
            raise FileFormatError(f"the gzip file is damaged ({error}); fetch it again", path) from error
        if not member.eof:
            notes.append("The gzip file is cut off; it was read as far as it goes.")
        rest = member.unused_data
    return b"".join(parts)


def _unzip(data: bytes, path: Path) -> bytes:
    try:
        with zipfile.ZipFile(io.BytesIO(data)) as archive:
            names = [name for name in archive.namelist() if not name.endswith("/")]
            if len(names) != 1:
                raise FileFormatError(f"expected one file in the zip, got {len(names)}: unpack it", path)
            return archive.read(names[0])
    except (zipfile.BadZipFile, zlib.error, RuntimeError, NotImplementedError) as error:
        raise FileFormatError(f"the zip file cannot be read: {error}", path) from error


def _by_library(data: bytes, path: Path, how: str, notes: list[str]) -> bytes:
    try:
        hatanaka = importlib.import_module("hatanaka")
    except ImportError as error:
        raise InputError(
            f"{path} is packed with {how}, which needs the library hatanaka: pip install hatanaka, or unpack the file"
        ) from error
    try:
        with warnings.catch_warnings(record=True) as told:
            warnings.simplefilter("always")
            text = bytes(hatanaka.decompress(data))
        notes += [f"On unpacking ({how}): {' '.join(str(w.message).split())}" for w in told]
        return text
    except (hatanaka.HatanakaException, ValueError, OSError) as error:
        first = str(error).strip().partition("\n")[0]
        raise FileFormatError(f"cannot be unpacked ({how}): {first or type(error).__name__}", path) from error
