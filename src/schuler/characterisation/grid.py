"""Stamped samples with gaps on a regular grid."""

from __future__ import annotations

import numpy as np

from schuler.arrays import ArrayLike, FloatArray, as_floats
from schuler.exceptions import InputError


def on_grid(t: ArrayLike, x: ArrayLike, rate_hz: float) -> FloatArray:
    """Put stamped samples on a regular grid, with NaN where none came.

    Parameters
    ----------
    t : array_like, shape (n,)
        Time stamps, increasing. [s]
    x : array_like, shape (n,) or (n, axes)
        Samples; NaN among them stays.
    rate_hz : float
        The true sampling rate. [Hz]

    Returns
    -------
    ndarray, shape (k,) or (k, axes)
        One row for each sampling interval from the first sample to the last.

    Raises
    ------
    InputError
        If two samples fall on one place, or stamps stray from the grid by more than half a sample, by jitter or because
        the rate is another one; the message gives the rate the stamps suggest.

    Notes
    -----
    Steps between stamps are rounded to whole samples one by one, so a gap of any length keeps its length; then the
    stamps are compared with the grid laid through their median. Nothing is interpolated.
    """
    t = as_floats(t, "t", (None,))
    x = np.asarray(x, dtype=np.float64)
    if x.ndim not in (1, 2) or len(x) != len(t):
        raise InputError(f"x: expected one row for each of the {len(t)} stamps, got shape {x.shape}")
    if not (np.isfinite(rate_hz) and rate_hz > 0.0):
        raise InputError(f"rate_hz: expected one positive finite number, got {rate_hz!r}")
    if len(t) < 2:
        raise InputError(f"t: expected at least 2 stamps, got {len(t)}")
    steps = np.diff(t) * rate_hz
    whole = np.round(steps).astype(np.int64)
    suggested = f"the stamps suggest {1.0 / float(np.median(np.diff(t))):.6g} Hz" if np.median(steps) > 0.0 else ""
    if np.any(whole < 1):
        i = int(np.argmax(whole < 1))
        raise InputError(
            f"t: expected stamps about 1 / ({rate_hz:g} Hz) apart, got {steps[i] / rate_hz:.6g} s between samples {i} "
            f"and {i + 1}; sort the samples, drop doubles, or state the true rate ({suggested})"
        )
    place = np.concatenate((np.zeros(1, dtype=np.int64), np.cumsum(whole)))
    stray = (t - t[0]) * rate_hz - place
    stray -= np.median(stray)
    worst = int(np.argmax(np.abs(stray)))
    if abs(stray[worst]) > 0.5:
        raise InputError(
            f"t: expected stamps within half a sample of a grid of {rate_hz:g} Hz, got sample {worst} off by "
            f"{stray[worst]:.2f} samples; state the true rate ({suggested}) or resample"
        )
    if place[-1] > 100 * len(t):
        raise InputError(
            f"t: expected a recording that is mostly there, got {len(t)} samples on {place[-1] + 1} places; "
            "treat its stretches as recordings of their own"
        )
    out = np.full((int(place[-1]) + 1, *x.shape[1:]), np.nan)
    out[place] = x
    return out
