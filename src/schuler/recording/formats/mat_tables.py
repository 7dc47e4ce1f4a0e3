"""MATLAB files of the navigation toolboxes NaveGo and PSINS, loaded once their names have shown what they are."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np

from schuler.arrays import FloatArray
from schuler.exceptions import FileFormatError
from schuler.recording.formats import matlab_file
from schuler.recording.io.hints import ReadHints
from schuler.recording.recording import Recording

#: Hints that take a file as a table of arrays, whatever its names look like.
_AS_ARRAYS = ("columns", "units", "variable", "scale", "rate")


def as_arrays(path: Path, hints: ReadHints) -> Recording | None:
    """The file read as arrays by name, where the user describes it as such and names no format; else ``None``."""
    if hints.format is not None or not set(hints.given()) & set(_AS_ARRAYS):
        return None
    from schuler.recording.formats.matlab import read_matlab

    return read_matlab(path, hints)


def load(path: Path, names: Iterable[str]) -> dict[str, Any]:
    """Variables of a MATLAB file up to version 7: arrays, and structures as dictionaries.

    Raises
    ------
    FileFormatError
        If the file is damaged.
    """
    return matlab_file.load(path, frozenset(names))


def vector(value: Any, what: str, path: Path, n: int | None = None) -> FloatArray:
    """Numbers of a vector, whichever way it lies. Shape (n,)."""
    array = _numbers(value, what, path)
    if array.size != max(array.shape, default=0) or (n is not None and array.size != n):
        wanted = "a vector" if n is None else f"{n} numbers"
        raise FileFormatError(f"{what}: expected {wanted}, got the shape {array.shape}", path)
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
