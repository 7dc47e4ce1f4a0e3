"""Edges of rests: ends where the sensor still settles are cut, ends that the search lost are regained.

Half a window of the search is cut from both ends of each interval, and its last window already has some of the turn in
it: 0.45 s of rest are lost at each edge, for which the gyroscopes alone carry the attitude.
"""

from __future__ import annotations

import numpy as np

from schuler.arrays import BoolArray, FloatArray, IntArray
from schuler.recording.series import ImuSeries
from schuler.standstill.consistency import NORMAL, contrasts, time_span
from schuler.standstill.stationarity import StaticIntervals

#: Shortest window: the period of the tremor of a hand (8 to 12 Hz), which is no turning. [s]
SHORTEST_S = 0.1
#: Blocks of the test for settling. [s]
_BLOCK_S = 0.2
#: A longer step of time than this many samples ends a rest.
_JUMP = 1.5


def cut_settling(
    rates: ImuSeries, candidates: StaticIntervals, min_s: float, limit: float, settle_s: float
) -> tuple[IntArray, list[str]]:
    """Cut the blocks at the ends of intervals whose means differ from that of the middle.

    Parameters
    ----------
    rates : ImuSeries
        Of kind "rate".
    candidates : StaticIntervals
    min_s : float
        Intervals of which less is left are refused. [s]
    limit : float
        Standard deviations beyond which a mean differs.
    settle_s : float
        At most so much is cut at each end. [s]

    Returns
    -------
    index : ndarray of int, shape (k, 2)
    reasons : list of str
        A sentence on each interval that is refused, and on the time cut.
    """
    x = np.concatenate((rates.accel, rates.gyro), axis=1)
    dt = rates.interval
    m = max(2, round(_BLOCK_S / dt))
    zones = np.minimum(round(settle_s / dt), np.diff(candidates.index, axis=1)[:, 0] // 4) // m * m
    inner = candidates.index + zones[:, None] * (1, -1)
    sigma = np.concatenate(
        (
            candidates.sigma_f * contrasts(rates.accel, inner, candidates.sigma_f).colour,
            candidates.sigma_w * contrasts(rates.gyro, inner, candidates.sigma_w).colour,
        )
    )
    kept, reasons, cut = [], [], 0
    for (a, b), zone in zip(candidates.index, zones, strict=True):
        middle = x[a + zone : b - zone]
        ends = (x[a : a + zone], x[b - zone : b][::-1])
        first, last = (
            m * _unsettled_blocks(end.reshape(-1, m, 6).mean(axis=1), middle, sigma, m, limit) for end in ends
        )
        if rates.t[b - last - 1] - rates.t[a + first] + dt >= min_s:
            kept.append((a + first, b - last))
            cut += first + last
        else:
            reasons.append(f"refused {time_span(rates, a, b)}: less than {min_s:g} s of it is settled")
    if cut:
        reasons.append(f"{cut * dt:.1f} s cut from the ends of rests, where the sensor still settled")
    return np.array(kept, dtype=np.int64).reshape(-1, 2), reasons


def _unsettled_blocks(blocks: FloatArray, middle: FloatArray, sigma: FloatArray, m: int, limit: float) -> int:
    """Number of blocks of m samples to cut from the end inwards; block means of shape (j, 6), outermost first.

    Each block is compared with the middle by itself, and together with all blocks further in.
    """
    if not len(blocks):
        return 0
    off = blocks - middle.mean(axis=0)
    count = np.arange(len(blocks), 0, -1)[:, None]
    together = np.cumsum(off[::-1], axis=0)[::-1] / count
    differs = np.zeros(len(blocks), dtype=bool)
    for difference, samples in ((off, m), (together, count * m)):
        differs |= np.any(np.abs(difference) > limit * sigma * np.sqrt(1.0 / samples + 1.0 / len(middle)), axis=1)
    return int(np.flatnonzero(differs).max(initial=-1)) + 1


def extend_edges(
    rates: ImuSeries, index: IntArray, *, reach_s: float, limit: float, ends: BoolArray | None = None
) -> IntArray:
    """Move the edges of rests out to where the motion begins.

    Parameters
    ----------
    rates : ImuSeries
        Of kind "rate".
    index : ndarray of int, shape (k, 2)
        Rests: first sample and the one after the last.
    reach_s : float
        Window of the search: the motion it saw begins within this of an edge. [s]
    limit : float
        Standard deviations beyond which a mean differs.
    ends : ndarray of bool, shape (k, 2), optional
        Which edges may be moved; all by default.

    Returns
    -------
    ndarray of int, shape (k, 2)

    Notes
    -----
    Outwards from an edge, sample by sample, the means of specific force and rate over the last 0.1, 0.2, 0.4 ... s are
    compared with the mean of the rest, axis by axis. The first window whose mean differs has the beginning of the
    motion in it and is **left out completely**: a sudden start is seen by the shortest window, and 0.1 s are lost; a
    gentle start is seen by a long window first, and little or nothing is regained. If no mean differs, the search has
    seen something else (a knock, vibration), and the edge stays.

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
    allowed = [limit * _mean_deviation(x, index, means, m) for m in lengths]
    # edges move at most half-way to the next rest, to a jump of time, or to the end of the log
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
            moved[k, 0] -= _samples_at_rest(x[start : a + inside][::-1] - means[k], inside, lengths, allowed)
        if ends is None or ends[k, 1]:
            moved[k, 1] += _samples_at_rest(x[b - inside : stop] - means[k], inside, lengths, allowed)
    return moved


def _mean_deviation(x: FloatArray, index: IntArray, means: FloatArray, m: int) -> FloatArray:
    """Standard deviation of means of m samples about the mean of their rest. Shape (6,)."""
    off = []
    for (a, b), mean in zip(index, means, strict=True):
        parts = (b - a) // m
        off.append(x[a : a + parts * m].reshape(parts, m, 6).mean(axis=1) - mean)
    return np.asarray(NORMAL * np.median(np.abs(np.concatenate(off)), axis=0))


def _samples_at_rest(off: FloatArray, inside: int, lengths: list[int], allowed: list[FloatArray]) -> int:
    """Number of samples at rest beyond the first ``inside``; ``off`` outwards, less the mean of the rest."""
    total = np.vstack((np.zeros(6), np.cumsum(off, axis=0)))
    onset, gained = len(off), 0
    for m, largest in zip(lengths, allowed, strict=True):
        if m > inside:
            break
        mean = (total[inside + 1 :] - total[inside + 1 - m : len(off) + 1 - m]) / m
        differs = np.flatnonzero(np.any(np.abs(mean) > largest, axis=1))
        # a sudden start is seen by all windows at once, and by chance by a longer one a sample sooner
        if len(differs) and (onset == len(off) or differs[0] + lengths[0] // 2 < onset):
            onset = int(differs[0])
            gained = max(0, onset + 1 - m)
    return gained
