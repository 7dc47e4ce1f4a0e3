"""MATLAB files of version 4 and 5 to 7: arrays of numbers, texts and single structures, with every size checked first.

SciPy's reader allocates what a file claims and can crash the interpreter on damaged ones, so files that users hand over
are read here. By the description of the format, MathWorks, MAT-File Format (levels 4 and 5), chapter 1. Passed over are
cells, objects, sparse and complex arrays and arrays of structures, none of which holds a log. MATLAB's plain text form
is read as text.
"""

from __future__ import annotations

import math
import mmap
import os
import struct
import zlib
from collections.abc import Collection, Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from schuler.arrays import FloatArray
from schuler.exceptions import FileFormatError
from schuler.recording.io import checks
from schuler.recording.io.hints import ReadHints
from schuler.recording.io.variables import recording_of_arrays
from schuler.recording.recording import Recording

#: An array, a text, or a structure as a dictionary of these.
Value = Any
#: Bytes before the first variable.
HEADER = 128
_MATRIX, _COMPRESSED = 14, 15
_STORED = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 9: "f8", 12: "i8", 13: "u8"}
_CLASSES = {6: "f8", 7: "f4", 8: "i1", 9: "u1", 10: "i2", 11: "u2", 12: "i4", 13: "u4", 14: "i8", 15: "u8"}
_OLD = {0: "f8", 1: "f4", 2: "i4", 3: "i2", 4: "u2", 5: "u1"}
_STRUCT, _CHAR = 2, 4
_COMPLEX = 0x0800
_ROOM = 1 << 26  # what any variable may unpack to [byte]
_PACKED = 50  # times its packed size, beyond that; deflate packs zeros by 1032, logs by 10
_DEEPEST = 8
#: Hints that take a file as a table of arrays, whatever its names look like.
_AS_ARRAYS = ("columns", "units", "variable", "scale", "rate")
_PEEK = 16_384  # bytes of a variable that are looked at, after unpacking
_MOST = 400  # variables


def read_matlab(path: Path, hints: ReadHints) -> Recording:
    """Recording of the arrays of a ``.mat`` file.

    Parameters
    ----------
    path : Path
    hints : ReadHints
        ``columns`` with ``variable``, or names mapped to arrays, see
        :func:`schuler.recording.io.variables.recording_of_arrays`. Arrays inside structures are ``outer.inner``.

    Raises
    ------
    FileFormatError
        If the file is of version 7.3 (HDF5) or damaged, or the arrays are not those named.
    """
    with path.open("rb") as stream:
        head = stream.read(128)
    if head.startswith(b"MATLAB 7.3"):
        raise FileFormatError("MATLAB 7.3 files (HDF5) are not read: save it with save('name.mat', ..., '-v7')", path)
    return recording_of_arrays(path, read_arrays(path), hints, [])


def read_arrays(path: Path) -> dict[str, np.ndarray[Any, np.dtype[Any]]]:
    """Arrays of a file by name, those inside structures as ``outer.inner``; errors as of :func:`load`."""
    arrays: dict[str, np.ndarray[Any, np.dtype[Any]]] = {}
    for name, value in load(path).items():
        _collect(name, value, arrays)
    return arrays


def _collect(name: str, value: Any, arrays: dict[str, np.ndarray[Any, np.dtype[Any]]]) -> None:
    """Arrays of a value, those of structures by ``outer.inner``."""
    if isinstance(value, dict):
        for inner, part in value.items():
            _collect(f"{name}.{inner}", part, arrays)
    elif isinstance(value, np.ndarray):
        arrays[name] = value


def load(path: Path, names: Collection[str] | None = None) -> dict[str, Value]:
    """Variables of a file: arrays as MATLAB has them (two axes), rows of text as str, structures as dictionaries.

    Parameters
    ----------
    path : Path
    names : collection of str, optional
        Variables wanted; all without.

    Raises
    ------
    FileFormatError
        If the file is cut off or damaged, with the byte of the variable; or of version 7.3.
    """
    try:
        with path.open("rb") as stream:
            # mapped, not read: errors keep what their functions held, and a log may be tried several times
            empty = not stream.seek(0, os.SEEK_END)
            data = memoryview(b"" if empty else mmap.mmap(stream.fileno(), 0, access=mmap.ACCESS_READ))
    except OSError as error:
        raise FileFormatError(f"cannot be opened ({error.strerror})", path) from error
    head = bytes(data[:HEADER])
    if head.startswith(b"MATLAB 7.3"):
        raise FileFormatError("is a MATLAB 7.3 file (HDF5) where an older one is expected: save it with '-v7'", path)
    five = head.startswith(b"MATLAB 5.0") or head[124:] in (b"\x00\x01IM", b"\x01\x00MI")
    values: dict[str, Value] = {}
    held = 0
    at = HEADER if five else 0
    if five and len(data) < HEADER:
        raise FileFormatError("cannot be read as a MATLAB file (a header of 128 bytes is cut off)", path)
    order = ">" if five and head[126:] == b"MI" else "<"
    try:
        while at < len(data):
            name, value, after = _next(data, at, order, names) if five else _next_4(data, at, names)
            if value is not None and (names is None or name in names):
                values[name] = value
                held += value.nbytes if isinstance(value, np.ndarray) else 0
                checks.check_unpacked(held, len(data))
            at = after
    except (struct.error, ValueError, zlib.error, MemoryError) as error:
        raise FileFormatError(
            f"cannot be read as a MATLAB file: damaged or cut off in the variable at byte {at} ({error})", path
        ) from error
    return values


def _next(data: memoryview, at: int, order: str, names: Collection[str] | None) -> tuple[str, Value, int]:
    """Name, value and end of the variable at a byte of a file of version 5."""
    kind, n = struct.unpack_from(f"{order}II", data, at)
    if n > len(data) - at - 8:
        raise ValueError(f"claims {n} bytes, {len(data) - at - 8} are left")
    body, after = data[at + 8 : at + 8 + n], at + 8 + n
    if kind == _COMPRESSED:
        limit, unpacker = max(_ROOM, _PACKED * n), zlib.decompressobj()
        kind, claimed = struct.unpack(f"{order}II", unpacker.decompress(body, 8))
        if claimed >= limit - 8:
            raise ValueError(f"{n} packed bytes claim {claimed}, more than {limit}")
        body = memoryview(unpacker.decompress(unpacker.unconsumed_tail, claimed)) if claimed else body[:0]
        if claimed > len(body):
            raise ValueError(f"claims {claimed} bytes, {len(body)} are packed")
        if len(unpacker.decompress(unpacker.unconsumed_tail, 9)) > 8:  # but for padding
            raise ValueError(f"claims {claimed} bytes, more are packed")
    name, value = _matrix(body, order, 0, names) if kind == _MATRIX else ("", None)
    return name, value, after


def _matrix(data: memoryview, order: str, depth: int, names: Collection[str] | None = None) -> tuple[str, Value]:
    if not data:
        return "", np.empty((0, 0))
    if depth > _DEEPEST:
        raise ValueError("structures are nested too deep")
    _, flags, at = _element(data, 0, order)
    (flag,) = struct.unpack_from(f"{order}I", flags)
    what = flag & 0xFF
    if what not in _CLASSES and what not in (_STRUCT, _CHAR):
        _, dims, at = _element(data, at, order)
        _, label, at = _element(data, at, order)
        return bytes(label).decode("latin-1"), None
    _, dims, at = _element(data, at, order)
    _, label, at = _element(data, at, order)
    name = bytes(label).decode("latin-1")
    if names is not None and name not in names:
        return name, None
    shape = struct.unpack(f"{order}{len(dims) // 4}i", dims[: len(dims) // 4 * 4])
    if len(shape) < 2 or min(shape) < 0 or len(shape) > 32:
        raise ValueError(f"{name or 'an array'} claims the shape {shape}")
    count = math.prod(shape)
    if what == _STRUCT:
        return name, _structure(data, at, order, depth, count)
    if count == 0:
        return name, "" if what == _CHAR else np.empty(shape, dtype=_CLASSES[what])
    kind, stored, _ = _element(data, at, order)
    if what == _CHAR:
        return name, _text(kind, stored, order)
    dtype = _STORED.get(kind)
    if dtype is None or len(stored) != count * np.dtype(dtype).itemsize:
        raise ValueError(f"{name or 'an array'} claims the shape {shape} in {len(stored)} bytes")
    try:
        with np.errstate(over="ignore", invalid="raise"):  # beyond single precision it is infinite, and refused so
            values = np.frombuffer(stored, dtype=order + dtype).astype(_CLASSES[what])
    except FloatingPointError as error:
        raise ValueError(f"{name or 'an array'} claims whole numbers and holds others") from error
    return name, None if flag & _COMPLEX else values.reshape(shape, order="F")


def _structure(data: memoryview, at: int, order: str, depth: int, count: int) -> Value:
    """The one element of a structure; ``None`` of an array of structures, which is no part of a log."""
    _, length, at = _element(data, at, order)
    _, labels, at = _element(data, at, order)
    (width,) = struct.unpack_from(f"{order}i", length)
    if width <= 0:
        raise ValueError(f"names of fields claim {width} characters")
    if count != 1:
        return None
    made: dict[str, Value] = {}
    for k in range(0, len(labels) // width * width, width):
        kind, inner, at = _element(data, at, order)
        if kind != _MATRIX:
            raise ValueError("a field of a structure is no array")
        field = bytes(labels[k : k + width]).split(b"\x00")[0].decode("latin-1")
        value = _matrix(inner, order, depth + 1)[1]
        if value is not None:
            made[field] = value
    return made


def _text(kind: int, stored: memoryview, order: str) -> str:
    codecs = {2: "latin-1", 1: "latin-1", 16: "utf-8", 4: "utf-16", 17: "utf-16"}
    codec = codecs.get(kind, "latin-1")
    if codec == "utf-16":
        codec += "-le" if order == "<" else "-be"
    return bytes(stored).decode(codec, errors="replace")


def _element(data: memoryview, at: int, order: str) -> tuple[int, memoryview, int]:
    """Type and contents of a data element, where the next begins; short ones have their length in the upper half."""
    (first,) = struct.unpack_from(f"{order}I", data, at)
    if first >> 16:
        n = first >> 16
        if n > 4:
            raise ValueError(f"a short element claims {n} bytes")
        return first & 0xFFFF, data[at + 4 : at + 4 + n], at + 8
    (n,) = struct.unpack_from(f"{order}I", data, at + 4)
    if n > len(data) - at - 8:
        raise ValueError(f"an element claims {n} bytes, {len(data) - at - 8} are left")
    return first, data[at + 8 : at + 8 + n], at + 8 + (n + 7) // 8 * 8


def _next_4(data: memoryview, at: int, names: Collection[str] | None) -> tuple[str, Value, int]:
    """Name, value and end of the matrix at a byte of a file of version 4."""
    order = "<" if 0 <= struct.unpack_from("<i", data, at)[0] < 5000 else ">"
    mopt, rows, columns, imaginary, n = struct.unpack_from(f"{order}5i", data, at)
    stored, what = _OLD.get(mopt // 10 % 10), mopt % 10
    if not 0 <= mopt < 5000 or stored is None or mopt // 100 % 10 or what > 2 or imaginary not in (0, 1):
        raise ValueError(f"expected a matrix of version 4, got the type {mopt}")
    left = len(data) - at - 20
    if rows < 0 or columns < 0 or not 0 < n <= left:
        raise ValueError(f"claims the shape ({rows}, {columns}) and a name of {n} bytes")
    size = rows * columns * np.dtype(stored).itemsize
    if size * (1 + imaginary) > left - n:
        raise ValueError(f"claims the shape ({rows}, {columns}) in {left - n} bytes")
    start = at + 20 + n
    name = bytes(data[at + 20 : start]).split(b"\x00")[0].decode("latin-1")
    after = start + size * (1 + imaginary)
    if what or imaginary or (names is not None and name not in names):
        return name, None, after
    values = np.frombuffer(data, dtype=order + stored, count=rows * columns, offset=start)
    return name, values.astype(stored).reshape((rows, columns), order="F"), after


def as_arrays(path: Path, hints: ReadHints) -> Recording | None:
    """The file read as arrays by name, where the user describes it as such and names no format; else ``None``."""
    if hints.format is not None or not set(hints.given()) & set(_AS_ARRAYS):
        return None
    return read_matlab(path, hints)


def vector(value: Any, what: str, path: Path, n: int | None = None) -> FloatArray:
    """Numbers of a vector, whichever way it lies. Shape (n,)."""
    array = _numbers(value, what, path)
    if array.size != max(array.shape, default=0) or (n is not None and array.size != n):
        expected = "a vector" if n is None else f"{n} numbers"
        raise FileFormatError(f"{what}: expected {expected}, got the shape {array.shape}", path)
    return array.ravel()


def matrix(value: Any, what: str, path: Path, columns: Iterable[int], n: int | None = None) -> FloatArray:
    """Numbers of a matrix with one of some numbers of columns, and ``n`` rows. Shape (n, k)."""
    array = _numbers(value, what, path)
    allowed = tuple(columns)
    if array.ndim != 2 or array.shape[1] not in allowed or (n is not None and len(array) != n) or not len(array):
        rows = "rows" if n is None else n
        raise FileFormatError(
            f"{what}: expected {rows} x {' or '.join(map(str, allowed))} numbers, got the shape {array.shape}", path
        )
    return array


def _numbers(value: Any, what: str, path: Path) -> FloatArray:
    if not isinstance(value, np.ndarray) or value.dtype.kind not in "fiu" or not value.size:
        raise FileFormatError(f"{what}: expected numbers, got {type(value).__name__} or nothing", path)
    return np.asarray(value, dtype=np.float64)


@dataclass(frozen=True, slots=True)
class Variable:
    """A variable: its size and, of a structure, the names of its fields."""

    name: str
    shape: tuple[int, ...]
    fields: tuple[str, ...] = ()


def variables(path: Path) -> dict[str, Variable]:
    """Variables of a file by their names; what cannot be read is left out. Raises nothing."""
    by_name: dict[str, Variable] = {}
    try:
        size = path.stat().st_size
        with path.open("rb") as stream:
            header = stream.read(HEADER)
            if len(header) < HEADER or not header.startswith(b"MATLAB 5.0") or header[126:] not in (b"IM", b"MI"):
                return {}
            order = "<" if header[126:] == b"IM" else ">"
            at = HEADER
            while at + 8 <= size and len(by_name) < _MOST:
                stream.seek(at)
                kind, n = struct.unpack(f"{order}II", stream.read(8))
                data = stream.read(min(n, _PEEK))
                if kind == _COMPRESSED:
                    data = zlib.decompressobj().decompress(data, _PEEK)
                    kind, _ = struct.unpack_from(f"{order}II", data)
                    data = data[8:]
                if kind == _MATRIX:
                    variable = _variable(memoryview(data), order)
                    by_name[variable.name] = variable
                at += 8 + n
    except (OSError, struct.error, zlib.error, ValueError, UnicodeDecodeError):
        return by_name
    return by_name


def _variable(data: memoryview, order: str) -> Variable:
    _, flags, at = _element(data, 0, order)
    _, dims, at = _element(data, at, order)
    _, name, at = _element(data, at, order)
    shape = struct.unpack(f"{order}{len(dims) // 4}i", dims[: len(dims) // 4 * 4])
    fields: tuple[str, ...] = ()
    if struct.unpack_from(f"{order}I", flags)[0] & 0xFF == _STRUCT:
        _, length, at = _element(data, at, order)
        _, names, _ = _element(data, at, order)
        (width,) = struct.unpack_from(f"{order}i", length)
        if width > 0:
            texts = (bytes(names[k : k + width]) for k in range(0, len(names), width))
            fields = tuple(text.split(b"\x00")[0].decode("ascii") for text in texts)
    return Variable(bytes(name).decode("ascii"), shape, fields)
