"""Swings that a rotation leaves in the errors of a run: their period and their size."""

from __future__ import annotations

import numpy as np

from schuler.arrays import ArrayLike, FloatArray, as_floats
from schuler.exceptions import InputError

_PADDING = 8
_LEAST = 16  # samples


def swing_period(t: ArrayLike, x: ArrayLike, *, longest: float | None = None) -> float:
    """Period of the strongest swing of an error that also drifts.

    Parameters
    ----------
    t : array_like, shape (n,)
        Evenly spaced. [s]
    x : array_like, shape (n,)
    longest : float, optional
        Longest period looked for; default a quarter of the record. [s]

    Returns
    -------
    float
        Place of the largest value of the periodogram of the error's rate of change: a random walk, which would hide
        everything else, has none there. Good to ``period^2 / (2 duration)``, half a bin. [s]

    Raises
    ------
    InputError
        If there are fewer than 16 samples, they are not evenly spaced, or no period is short enough.
    """
    t, x = _series(t, x)
    dt = (t[-1] - t[0]) / (len(t) - 1)
    rate = np.diff(x) / dt
    n = len(rate)
    k = np.arange(n)
    rate = rate - np.polynomial.Polynomial.fit(k, rate, 1)(k)
    power = np.abs(np.fft.rfft(rate, _PADDING * n)) ** 2
    frequency = np.fft.rfftfreq(_PADDING * n, dt)
    limit = 0.25 * n * dt if longest is None else longest
    wanted = np.flatnonzero(frequency * limit >= 1.0)
    if not len(wanted):
        raise InputError(f"longest: no period of this record is as short as {limit:g} s")
    return float(1.0 / frequency[wanted[np.argmax(power[wanted])]])


def swing_size(t: ArrayLike, x: ArrayLike, period: float) -> float:
    """Amplitude of the swing of a known period in an error that also drifts.

    Parameters
    ----------
    t : array_like, shape (n,)
        [s]
    x : array_like, shape (n,)
    period : float
        [s]

    Returns
    -------
    float
        Of the sinusoid that is fitted together with a cubic, by least squares. Unit of ``x``.

    Raises
    ------
    InputError
        If there are fewer than 16 samples or the period is not above zero.
    """
    t, x = _series(t, x)
    if not period > 0.0:
        raise InputError(f"period: expected seconds above zero, got {period!r}")
    s = 2.0 * (t - t[0]) / (t[-1] - t[0]) - 1.0
    a = 2.0 * np.pi / period * (t - t[0])
    design = np.stack((np.ones_like(s), s, s**2, s**3, np.cos(a), np.sin(a)), axis=1)
    found = np.linalg.lstsq(design, x, rcond=None)[0]
    return float(np.hypot(found[4], found[5]))


def _series(t: ArrayLike, x: ArrayLike) -> tuple[FloatArray, FloatArray]:
    t, x = as_floats(t, "t", (None,)), as_floats(x, "x", (None,))
    if len(t) < _LEAST or len(x) != len(t):
        raise InputError(f"expected {_LEAST} samples or more, as many times as values; got {len(t)} and {len(x)}")
    step = np.diff(t)
    if step.min() <= 0.0 or np.ptp(step) > 1e-6 * step.mean():
        raise InputError("t: expected evenly spaced times")
    return t, x
