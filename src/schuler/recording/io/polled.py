"""Samples of an IMU that was read faster than it measures: each once, at even stamps."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from schuler.arrays import FloatArray, IntArray

_REPEATED = 0.1  # least share of rows that repeat the one before
_FEWEST = 200  # samples of a stretch: fewer show no rate
_SMOOTH_S = 5.0  # over which the sensor's clock is taken as even
_ASTRAY = 0.1  # RMS by which even stamps may lie outside the readings' intervals, in intervals of the sensor


def samples_once(t: FloatArray, readings: Sequence[FloatArray]) -> tuple[IntArray, FloatArray, str] | None:
    """Rows with a new sample, the times at which these were ready, and a sentence on it.

    Parameters
    ----------
    t : ndarray, shape (n,)
        Times of the rows, increasing. [s]
    readings : sequence of ndarray, shape (n,)
        All of an IMU's.

    Returns
    -------
    (ndarray, ndarray, str), optional
        None where few rows repeat the one before in every reading, or no even rate explains which.

    Notes
    -----
    A sample became ready between the row that has it first and the row before. A sensor's own clock is even: the stamps
    are the straight line through the middles of these intervals, which follows what the middles do over five seconds.
    A sensor at rest that repeats itself by chance, or one whose samples are missed now and then, fits no such line.
    """
    if len(t) < 2 * _FEWEST:
        return None
    new = np.zeros(len(t), dtype=bool)
    new[0] = True
    for x in readings:
        new[1:] |= x[1:] != x[:-1]
    if np.mean(~new) < _REPEATED:
        return None
    rows = np.flatnonzero(new)
    step = np.diff(t, prepend=2.0 * t[0] - t[1])
    usual = float(np.median(np.diff(t)))
    pauses = np.flatnonzero(step[rows] > 3.0 * usual)
    stamps, squares, interval = np.empty(len(rows)), 0.0, np.inf
    for part in np.split(np.arange(len(rows)), pauses):
        if len(part) < _FEWEST:
            return None
        ready, before = t[rows[part]], t[rows[part]] - np.minimum(step[rows[part]], 3.0 * usual)
        middle, count = 0.5 * (ready + before), np.arange(len(part))
        slope, offset = np.polyfit(count, middle - middle[0], 1)
        line = middle[0] + offset + slope * count
        even = line + _running_mean(middle - line, round(_SMOOTH_S / slope))
        outside = np.maximum(before - even, 0.0) + np.maximum(even - ready, 0.0)
        squares += float(outside @ outside)
        interval = min(interval, float(slope))
        stamps[part] = even
    astray = float(np.sqrt(squares / len(rows)))
    ends_held = t[-1] - t[rows[-1]] > 2.0 * interval  # at rest without noise, or stuck
    if astray > _ASTRAY * interval or ends_held or not np.all(np.diff(stamps) > 0.0):
        return None
    return (
        rows,
        stamps,
        (
            f"The IMU was read faster than it measures: {len(t) - len(rows)} of {len(t)} rows repeat the one before "
            f"and were left out. The others are samples at an even {1.0 / interval:.4g} Hz and are stamped so, up to "
            f"{np.abs(t[rows] - stamps).max() * 1e3:.1f} ms from their rows."
        ),
    )


def _running_mean(x: FloatArray, width: int) -> FloatArray:
    """Mean over so many values around each, over what there is of them at the ends."""
    total = np.concatenate(([0.0], np.cumsum(x)))
    at = np.arange(len(x))
    first, last = np.maximum(at - width // 2, 0), np.minimum(at + width // 2 + 1, len(x))
    return np.asarray((total[last] - total[first]) / (last - first))
