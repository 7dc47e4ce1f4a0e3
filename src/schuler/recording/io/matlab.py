"""MATLAB files up to version 7 by SciPy; MATLAB's plain text form is read as text."""

from __future__ import annotations

import warnings
from pathlib import Path
from typing import Any

import numpy as np

from schuler.exceptions import FileFormatError, MissingExtraError
from schuler.recording.formats.mat_peek import check_sizes
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
    if head.startswith(b"MATLAB 5.0"):
        check_sizes(path)
    try:
        from scipy.io import loadmat
    except ImportError as error:
        raise MissingExtraError("scipy", "all", "reading MATLAB files") from error
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        try:
            contents = loadmat(str(path))
        # a damaged file makes the parser fail in ways that are not listed anywhere
        except Exception as error:
            raise FileFormatError(f"cannot be read as a MATLAB file ({error}); is it complete?", path) from error
    notes = [f"MATLAB reader: {str(warning.message).splitlines()[0]}" for warning in caught]
    arrays: dict[str, np.ndarray[Any, np.dtype[Any]]] = {}
    for name, value in contents.items():
        if not name.startswith("__"):
            _collect(name, value, arrays)
    return recording_of_arrays(path, arrays, hints, notes)


def _collect(name: str, value: Any, arrays: dict[str, np.ndarray[Any, np.dtype[Any]]]) -> None:
    """Arrays of a value, those of single structures by ``outer.inner``."""
    if not isinstance(value, np.ndarray) or name.count(".") > 4:
        return
    if value.dtype.names is not None:
        if value.size == 1:
            for inner in value.dtype.names:
                _collect(f"{name}.{inner}", value.ravel()[0][inner], arrays)
    elif value.dtype.kind in "fiu":
        arrays[name] = value
