"""MATLAB files of the navigation toolboxes NaveGo and PSINS, loaded once their names have shown what they are."""

from __future__ import annotations

import warnings
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np

from schuler.arrays import FloatArray
from schuler.exceptions import FileFormatError, MissingExtraError
from schuler.recording.formats import mat_peek
from schuler.recording.io.hints import ReadHints
from schuler.recording.recording import Recording

#: Hints that take a file as a table of arrays, whatever its names look like.
_AS_ARRAYS = ("columns", "units", "variable", "scale", "rate")


def as_arrays(path: Path, hints: ReadHints) -> Recording | None:
    """The file read as arrays by name, where the user describes it as such and names no format; else ``None``."""
    if hints.format is not None or not set(hints.given()) & set(_AS_ARRAYS):
        return None
    from schuler.recording.io.matlab import read_matlab

    return read_matlab(path, hints)


def load(path: Path, names: Iterable[str]) -> dict[str, Any]:
    """Variables of a MATLAB 5 file: arrays, and structures as dictionaries.

    Raises
    ------
    FileFormatError
        If the file is damaged.
    """
    try:
        from scipy.io import loadmat
    except ImportError as error:
        raise MissingExtraError("scipy", "all", "reading MATLAB files") from error
    mat_peek.check_sizes(path)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        try:
            contents = loadmat(str(path), variable_names=list(names))
        # a damaged file makes the parser fail in ways that are not listed anywhere
        except Exception as error:
            raise FileFormatError(f"cannot be read as a MATLAB file ({error}); is it complete?", path) from error
    return {name: _plain(value) for name, value in contents.items() if not name.startswith("__")}


def _plain(value: Any) -> Any:
    if isinstance(value, np.ndarray) and value.dtype.names is not None and value.size == 1:
        return {name: _plain(value.ravel()[0][name]) for name in value.dtype.names}
    return value


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
