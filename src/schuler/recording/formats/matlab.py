"""Recordings of the arrays in MATLAB files up to version 7; MATLAB's plain text form is read as text."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from schuler.exceptions import FileFormatError
from schuler.recording.formats import matlab_file
from schuler.recording.io.hints import ReadHints
from schuler.recording.io.variables import recording_of_arrays
from schuler.recording.recording import Recording


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
    arrays: dict[str, np.ndarray[Any, np.dtype[Any]]] = {}
    for name, value in matlab_file.load(path).items():
        _collect(name, value, arrays)
    return recording_of_arrays(path, arrays, hints, [])


def _collect(name: str, value: Any, arrays: dict[str, np.ndarray[Any, np.dtype[Any]]]) -> None:
    """Arrays of a value, those of structures by ``outer.inner``."""
    if isinstance(value, dict):
        for inner, part in value.items():
            _collect(f"{name}.{inner}", part, arrays)
    elif isinstance(value, np.ndarray):
        arrays[name] = value
