"""Tables of a zip, as apps of phones export them."""

from __future__ import annotations

import zipfile
import zlib
from pathlib import Path

from schuler.exceptions import FileFormatError

MOST_TABLES = 40  # of an export that are looked at
_ROOM, _PACKED = 1 << 26, 200  # what any zip may unpack to [byte], and times its size
# of a damaged zip: its tables, a deflate stream, an unknown method, an encrypted entry, a seek before it, its end
_DAMAGED = (zipfile.BadZipFile, zlib.error, NotImplementedError, RuntimeError, OSError, EOFError)


def zipped_names(head: bytes, path: Path) -> list[str]:
    """Names of the files in a zip; none of a file that is no zip or a damaged one.

    Parameters
    ----------
    head : bytes
        Its first bytes.
    path : Path
    """
    if not head.startswith(b"PK\x03\x04") or path.suffix.lower() != ".zip":
        return []
    try:
        with zipfile.ZipFile(path) as archive:
            return archive.namelist()
    except _DAMAGED:
        return []


def head_in_zip(path: Path, name: str, n: int) -> bytes:
    """First bytes of a file in a zip; none if it is not there or damaged."""
    try:
        with zipfile.ZipFile(path) as archive, archive.open(name) as file:
            return file.read(n)
    except (KeyError, *_DAMAGED):
        return b""


def unzipped_tables(path: Path) -> list[tuple[str, bytes]]:
    """Names and contents of the CSV tables in a zip.

    Parameters
    ----------
    path : Path

    Raises
    ------
    FileFormatError
        If it is damaged, or unpacks to more than a log does.
    """
    try:
        with zipfile.ZipFile(path) as archive:
            entries = [e for e in archive.infolist() if e.filename.endswith(".csv")]
            if sum(e.file_size for e in entries) > max(_ROOM, _PACKED * path.stat().st_size):
                raise FileFormatError("its tables claim more than any log unpacks to", path)
            return [(e.filename, archive.read(e)) for e in entries[:MOST_TABLES]]
    except _DAMAGED as error:
        raise FileFormatError(f"cannot be unpacked ({error}); it must be a complete zip", path) from error
