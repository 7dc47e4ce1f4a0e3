"""Stamps of a series."""

from __future__ import annotations

import numpy as np

from schuler.arrays import ArrayLike, FloatArray, as_floats
from schuler.exceptions import InputError

#: Stamps closer than this are one. [s]
SAME_TIME = 1e-6


def check_times(t: ArrayLike, name: str) -> FloatArray:
    """Strictly increasing finite times; the message names the first that is not.

    Raises
    ------
    InputError
        If there is no time, or one is not greater than the one before it.
    """
    t = as_floats(t, name, (None,))
    if len(t) == 0:
        raise InputError(f"{name}: expected at least one sample, got none")
    step = np.diff(t)
    if np.any(step <= 0.0):
        k = int(np.flatnonzero(step <= 0.0)[0]) + 1
        what = "repeats" if step[k - 1] == 0.0 else "goes back"
        raise InputError(
            f"{name}: expected increasing times, but sample {k} {what}: {t[k]:.6f} s after {t[k - 1]:.6f} s; "
            "remove repeated samples or sort the log"
        )
    return t
