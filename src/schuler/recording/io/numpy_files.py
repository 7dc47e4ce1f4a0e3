"""NumPy files: one array in ``.npy``, named ones in ``.npz``."""

from __future__ import annotations

import warnings
from pathlib import Path

import numpy as np

from schuler.exceptions import FileFormatError
from schuler.recording.io.hints import ReadHints
from schuler.recording.io.variables import recording_of_arrays
from schuler.recording.recording import Recording


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
            # opened here because NumPy leaves a damaged archive open
            with path.open("rb") as stream:
                loaded = np.load(stream, allow_pickle=False)
                if isinstance(loaded, np.ndarray):
                    arrays = {"array": loaded}
                else:
                    with loaded:
                        arrays = {name: loaded[name] for name in loaded.files}
        # a damaged file makes zip and header parsers fail in ways that are not listed anywhere
        except Exception as error:
            raise FileFormatError(
                f"cannot be read as a NumPy file ({error}); it must be complete and hold plain numbers", path
            ) from error
    notes = [f"NumPy reader: {str(warning.message).splitlines()[0]}" for warning in caught]
    return recording_of_arrays(path, {n: a for n, a in arrays.items() if isinstance(a, np.ndarray)}, hints, notes)
