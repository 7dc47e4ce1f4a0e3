"""NumPy files: one array in ``.npy``, named ones in ``.npz``."""

from __future__ import annotations

import math
import warnings
import zipfile
from pathlib import Path
from typing import IO, Any

import numpy as np

from schuler.exceptions import FileFormatError
from schuler.recording.io.hints import ReadHints
from schuler.recording.io.lines import shorten
from schuler.recording.io.variables import recording_of_arrays
from schuler.recording.recording import Recording

_Array = np.ndarray[Any, np.dtype[Any]]
_ROOM = 1 << 26  # what any file may unpack to [byte]
_NAMED = 4  # files of an archive that a message names
_PACKED = 200  # times its size, beyond that; deflate packs zeros by 1032, no log by more than this


def read_numpy(path: Path, hints: ReadHints) -> Recording:
    """Recording of the arrays of a ``.npy`` or ``.npz`` file.

    Parameters
    ----------
    path : Path
    hints : ReadHints
        As for MATLAB files; the array of a ``.npy`` file is called ``array``. Converter counts with an array of
        factors are read with ``scale="NAME"``.

    Raises
    ------
    FileFormatError
        If the file is damaged or holds Python objects, or the arrays are not those named.
    """
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        try:
            arrays = _load(path)
        except FileFormatError:
            raise
        # a damaged file makes zip and header parsers fail in ways that are not listed anywhere
        except Exception as error:
            raise FileFormatError(
                f"cannot be read as a NumPy file ({error}); it must be complete and hold plain numbers", path
            ) from error
    notes = [f"NumPy reader: {str(warning.message).splitlines()[0]}" for warning in caught]
    return recording_of_arrays(path, arrays, hints, notes)


def read_array(path: Path) -> _Array:
    """The array of a ``.npy`` file.

    Parameters
    ----------
    path : Path

    Raises
    ------
    FileFormatError
        If it cannot be read.
    """
    return read_arrays(path)["array"]


def read_arrays(path: Path) -> dict[str, _Array]:
    """Arrays of a ``.npy`` (then called ``array``) or ``.npz`` file by name.

    Parameters
    ----------
    path : Path

    Raises
    ------
    FileFormatError
        If it cannot be read.
    """
    try:
        return _load(path)
    except Exception as error:
        raise FileFormatError(f"cannot be read as a NumPy file ({error})", path) from error


def _load(path: Path) -> dict[str, _Array]:
    """Arrays by name; NumPy allocates what a header claims, so the claim is compared with what is there first."""
    size = path.stat().st_size
    with path.open("rb") as stream:
        if not stream.read(4).startswith(b"PK"):
            stream.seek(0)
            return {"array": _array(stream, size)}
    arrays: dict[str, _Array] = {}
    with zipfile.ZipFile(path) as archive:
        claimed = sum(entry.file_size for entry in archive.infolist())
        if claimed > max(_ROOM, _PACKED * size):
            raise ValueError(f"its arrays claim {claimed} bytes in a file of {size}")
        for entry in archive.infolist():
            if entry.filename.endswith(".npy"):
                with archive.open(entry) as member:
                    arrays[entry.filename.removesuffix(".npy")] = _array(member, entry.file_size)
        if not arrays and (names := [n for n in archive.namelist() if not n.endswith("/")]):
            listed = ", ".join(shorten(name, 40) for name in names[:_NAMED])
            more = f" and {len(names) - _NAMED} more" if len(names) > _NAMED else ""
            raise FileFormatError(
                f"a ZIP archive of {listed}{more}, not of arrays: unpack it, and give the folder", path
            )
    return arrays


def _array(stream: IO[bytes], size: int) -> _Array:
    """The array of a ``.npy`` file of some size [byte]."""
    version = np.lib.format.read_magic(stream)
    readers: dict[Any, Any] = {(1, 0): np.lib.format.read_array_header_1_0, (2, 0): np.lib.format.read_array_header_2_0}
    if version not in readers:
        raise ValueError(f"version {version}, which only structures have")
    shape, fortran, dtype = readers[version](stream)
    count = math.prod(int(length) for length in shape)
    if dtype.hasobject or dtype.kind not in "fiub" or count < 0 or len(shape) > 32:
        raise ValueError(f"an array of {dtype} with the shape {shape}")
    left = size - stream.tell()
    if count * dtype.itemsize > left:
        raise ValueError(f"the shape {shape} claims {count * dtype.itemsize} bytes, {left} are there")
    values = np.frombuffer(stream.read(count * dtype.itemsize), dtype=dtype, count=count)
    return values.reshape(shape, order="F" if fortran else "C")
