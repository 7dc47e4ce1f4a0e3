"""Stamps of samples that arrive in bursts: several under one stamp, or stamped one after the other on arrival."""

from __future__ import annotations

import numpy as np

from schuler.arrays import FloatArray, IntArray

_SHORT, _LONG = 0.2, 1.4  # mean intervals: steps within a burst, and from one burst to the next
_BURSTS = 10  # fewer show no rate
_PAUSE = 2.5  # usual burst intervals: a longer step is a pause of the log


def spread_bursts(t: FloatArray) -> tuple[FloatArray, str] | None:
    """Stamps of samples that came in bursts, spread evenly at the rate of the sensor; and a sentence on it.

    Parameters
    ----------
    t : ndarray, shape (n,)
        Stamps that never go back. [s]

    Returns
    -------
    (ndarray, str), optional
        None where the stamps are not of bursts, or no even rate explains them to half a burst.

    Notes
    -----
    The stamp of a burst is taken as the time of its last sample (the driver stamps what it has read). Within a stretch
    without a pause the sensor's rate is constant, so its stamps are the straight line through the bursts' last samples.
    How late all of them are cannot be seen here.
    """
    n, step = len(t), np.diff(t)
    if n < 2 * _BURSTS or not t[-1] > t[0] or np.mean(step < _SHORT * step.mean()) < 0.4 or step.min() < 0.0:
        return None
    scale = np.median(_burst_steps(step))
    whole = step < _PAUSE * scale
    mean = float(step[whole].mean())
    between = step > _LONG * mean
    if np.mean(between | (step < _SHORT * mean)) < 0.95 or np.mean(step < _SHORT * mean) < 0.4:
        return None
    last = np.append(np.flatnonzero(between), n - 1)  # last sample of each burst
    if len(last) < _BURSTS:
        return None
    spread = np.empty(n)
    period = float(np.median(np.diff(t[last])))
    size = float(np.median(np.diff(last)))
    squares = 0.0
    for stretch in np.split(last, np.flatnonzero(np.diff(t[last]) > _PAUSE * period) + 1):
        first = 0 if stretch[0] == last[0] else int(last[np.searchsorted(last, stretch[0]) - 1]) + 1
        rows = np.arange(first, stretch[-1] + 1)
        spread[rows], error = _even_stamps(t, stretch, rows, period / size)
        squares += error
    scatter = float(np.sqrt(squares / len(last)))
    if scatter > 0.5 * period or not np.all(np.diff(spread) > 0.0):
        return None
    rate = 1.0 / float(np.median(np.diff(spread)))
    return spread, (
        f"Samples come in bursts of about {size:g} under one stamp, every {period:.4g} s: their stamps were spread "
        f"evenly ({rate:.6g} Hz), a burst's stamp taken as the time of its last sample; the bursts scatter by "
        f"{scatter:.2g} s about that. A constant lateness cannot be seen here (gnss.delay_sigma_s estimates it)."
    )


def _burst_steps(step: FloatArray) -> FloatArray:
    """Steps above the mean one: from burst to burst, or all of an even log."""
    above = step[step >= step.mean()]
    return above if len(above) else step


def _even_stamps(t: FloatArray, last: IntArray, rows: IntArray, interval: float) -> tuple[FloatArray, float]:
    """Stamps of the rows of a stretch on the line through the last samples of its bursts; squares of their misfit."""
    if len(last) < _BURSTS:
        return t[last[-1]] - interval * (last[-1] - rows), 0.0
    slope, offset = np.polyfit(last - last[0], t[last] - t[last[0]], 1)
    error = t[last] - t[last[0]] - offset - slope * (last - last[0])
    return t[last[0]] + offset + slope * (rows - last[0]), float(error @ error)
