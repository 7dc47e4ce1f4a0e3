"""Edges of rests: what the search gives away there, and short windows still call rest, is given back.

Half a window of the search is cut from both ends of what it finds, and its last window already has some of the turn in
it: 0.45 s of rest are lost at each edge, and the gyroscopes alone carry the attitude so much longer.
"""

from __future__ import annotations

import numpy as np

from schuler.arrays import BoolArray, FloatArray, IntArray
from schuler.recording.series import ImuSeries

#: Shortest window: the period of the tremor of a hand (8 to 12 Hz), which is no turning. [s]
SHORTEST_S = 0.1
#: From the median of absolute normal deviates to their standard deviation.
_NORMAL = 1.4826
#: A longer step of time than this many samples ends a rest.
_JUMP = 1.5


def regained(
    rates: ImuSeries, index: IntArray, *, reach_s: float, limit: float, ends: BoolArray | None = None
) -> IntArray:
    """Rests with their edges moved out to where the motion begins.

    Parameters
    ----------
    rates : ImuSeries
        Of kind "rate".
    index : ndarray of int, shape (k, 2)
        Rests: first sample and the one after the last.
    reach_s : float
        Window of the search that found them: what it saw begins within that of an edge. [s]
    limit : float
        Standard deviations beyond which a mean is another.
    ends : ndarray of bool, shape (k, 2), optional
        Which edges may be moved; all by default.

    Returns
    -------
    ndarray of int, shape (k, 2)

    Notes
    -----
    Outwards from an edge, sample by sample, the means of specific force and rate over the last 0.1, 0.2, 0.4 ... s are
    compared with the mean of the rest, axis by axis. The first window whose mean is another has the beginning of the
    motion in it and **is given up whole**: a hand that starts suddenly is seen by the shortest, and 0.1 s are lost; one
    that starts gently is seen by a long one first, and little or nothing is regained. If no window sees anything, the
    search has seen something else (a knock, vibration), and the edge stays.

    Standard deviations of the means are those of windows of the same length inside all rests (by the median), so the
    noise need not be white: a hand that sways is compared with its own swaying.
    """
    h = rates.interval
    lengths: list[int] = []
    while SHORTEST_S * 2 ** len(lengths) <= reach_s * (1.0 + 1e-9):
        lengths.append(max(1, round(SHORTEST_S * 2 ** len(lengths) / h)))
    if not lengths or not len(index):
        return index
    x = np.concatenate((rates.accel, rates.gyro), axis=1)
    means = np.array([x[a:b].mean(axis=0) for a, b in index])
    allowed = [limit * _scatter(x, index, means, m) for m in lengths]
    # the way is free half-way to the next rest, to a jump of time, or to the end of the log
    n, jump = len(rates), np.flatnonzero(np.diff(rates.t) > _JUMP * h) + 1
    half = (index[:-1, 1] + index[1:, 0]) // 2
    first, last = np.append(0, half), np.append(half, n)
    moved = index.copy()
    reach = round((reach_s + SHORTEST_S) / h)
    for k, (a, b) in enumerate(index):
        start = max(first[k], a - reach, jump[jump <= a].max(initial=0))
        stop = min(last[k], b + reach, jump[jump >= b].min(initial=n))
        inside = min(max(lengths), b - a)
        if ends is None or ends[k, 0]:
            moved[k, 0] -= _still(x[start : a + inside][::-1] - means[k], inside, lengths, allowed)
        if ends is None or ends[k, 1]:
            moved[k, 1] += _still(x[b - inside : stop] - means[k], inside, lengths, allowed)
    return moved


def _scatter(x: FloatArray, index: IntArray, means: FloatArray, m: int) -> FloatArray:
    """Standard deviation of means of m samples about the mean of their rest. Shape (6,)."""
    off = []
    for (a, b), mean in zip(index, means, strict=True):
        parts = (b - a) // m
        off.append(x[a : a + parts * m].reshape(parts, m, 6).mean(axis=1) - mean)
    return np.asarray(_NORMAL * np.median(np.abs(np.concatenate(off)), axis=0))


def _still(off: FloatArray, inside: int, lengths: list[int], allowed: list[FloatArray]) -> int:
    """How many samples beyond the first ``inside`` are still rest; ``off`` outwards, less the mean of the rest."""
    total = np.vstack((np.zeros(6), np.cumsum(off, axis=0)))
    first, found = len(off), 0
    for m, most in zip(lengths, allowed, strict=True):
        if m > inside:
            break
        mean = (total[inside + 1 :] - total[inside + 1 - m : len(off) + 1 - m]) / m
        seen = np.flatnonzero(np.any(np.abs(mean) > most, axis=1))
        # what begins suddenly is seen by all at once, and by chance by a longer one a sample sooner
        if len(seen) and (first == len(off) or seen[0] + lengths[0] // 2 < first):
            first = int(seen[0])
            found = max(0, first + 1 - m)
    return found
