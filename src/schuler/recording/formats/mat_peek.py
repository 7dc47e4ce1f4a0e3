"""Names of the variables of a MATLAB 5 file and of the fields of its structures, from a few bytes of each.

Enough to tell whose file it is without loading it. By the description of the format, MathWorks, MAT-File Format
(level 5), chapter 1.
"""

from __future__ import annotations

import struct
import zlib
from dataclasses import dataclass
from pathlib import Path

_HEADER, _MATRIX, _COMPRESSED = 128, 14, 15
_PEEK = 16_384  # bytes of a variable that are looked at, after unpacking
_MOST = 400  # variables
_STRUCT = 2


@dataclass(frozen=True, slots=True)
class Variable:
    """A variable: its size and, of a structure, the names of its fields."""

    name: str
    shape: tuple[int, ...]
    fields: tuple[str, ...] = ()


def variables(path: Path) -> dict[str, Variable]:
    """Variables of a file by their names; what cannot be read is left out. Raises nothing."""
    found: dict[str, Variable] = {}
    try:
        size = path.stat().st_size
        with path.open("rb") as stream:
            header = stream.read(_HEADER)
            if len(header) < _HEADER or not header.startswith(b"MATLAB 5.0") or header[126:] not in (b"IM", b"MI"):
                return {}
            order = "<" if header[126:] == b"IM" else ">"
            at = _HEADER
            while at + 8 <= size and len(found) < _MOST:
                stream.seek(at)
                kind, n = struct.unpack(f"{order}II", stream.read(8))
                data = stream.read(min(n, _PEEK))
                if kind == _COMPRESSED:
                    data = zlib.decompressobj().decompress(data, _PEEK)
                    kind, _ = struct.unpack_from(f"{order}II", data)
                    data = data[8:]
                if kind == _MATRIX and (variable := _variable(data, order)) is not None:
                    found[variable.name] = variable
                at += 8 + n
    except (OSError, struct.error, zlib.error, ValueError, UnicodeDecodeError):
        return found
    return found


def _variable(data: bytes, order: str) -> Variable | None:
    flags, at = _element(data, 0, order)
    dims, at = _element(data, at, order)
    name, at = _element(data, at, order)
    shape = struct.unpack(f"{order}{len(dims) // 4}i", dims[: len(dims) // 4 * 4])
    fields: tuple[str, ...] = ()
    if struct.unpack_from(f"{order}I", flags)[0] & 0xFF == _STRUCT:
        length, at = _element(data, at, order)
        names, _ = _element(data, at, order)
        (width,) = struct.unpack_from(f"{order}i", length)
        if width > 0:
            texts = (names[k : k + width] for k in range(0, len(names), width))
            fields = tuple(text.split(b"\x00")[0].decode("ascii") for text in texts)
    return Variable(name.decode("ascii"), shape, fields)


def _element(data: bytes, at: int, order: str) -> tuple[bytes, int]:
    """Contents of a data element and where the next begins; short ones have their length in the upper half."""
    (first,) = struct.unpack_from(f"{order}I", data, at)
    if first >> 16:
        n = first >> 16
        return data[at + 4 : at + 4 + n], at + 8
    (n,) = struct.unpack_from(f"{order}I", data, at + 4)
    return data[at + 8 : at + 8 + n], at + 8 + (n + 7) // 8 * 8
