"""A temperature ramp made ready: what the temperature sensor can be believed, heating and cooling, spikes, blocks."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from schuler.arrays import BoolArray, FloatArray, IntArray

BLOCKS = 150  # a ramp is slow: more block means say nothing new, and their correlation costs time
_STUCK = 20  # equal values in a row, at least, to be called stuck
_FASTEST = 1.0  # faster changes of temperature are not believed to be heat [K/s]


@dataclass(frozen=True, eq=False)
class Branch:
    """A stretch of a log in which temperature goes one way.

    Attributes
    ----------
    first, last : int
        Samples, ``first:last``.
    direction : int
        +1 heating, -1 cooling.
    start, stop : float
        Temperature at both ends. [degC]
    """

    first: int
    last: int
    direction: int
    start: float
    stop: float


@dataclass(frozen=True, eq=False)
class Repaired:
    """Temperature of a log as it will be used.

    Attributes
    ----------
    T : ndarray, shape (n,)
        With steps of a coarse sensor bridged. [degC]
    use : ndarray of bool, shape (n,)
        Samples whose temperature is believed.
    step : float
        Resolution of the sensor; 0 if it is too fine to matter. [K]
    stuck : int
        Samples at which it stood still while the unit's temperature went on.
    """

    T: FloatArray
    use: BoolArray
    step: float
    stuck: int


def repaired(T: FloatArray) -> Repaired:
    """Bridge the steps of a quantised temperature, and find where the sensor was stuck.

    Parameters
    ----------
    T : ndarray, shape (n,)
        [degC]

    Returns
    -------
    Repaired

    Notes
    -----
    A run of equal values is stuck if it is long and ends or begins with a jump of several steps: the sensor fell behind
    and caught up. A dwell of the chamber has no such jump. Otherwise, where values come in runs, the temperature
    halfway between two of them is passed at the change; between changes it is interpolated.
    """
    n = len(T)
    change = np.flatnonzero(np.diff(T) != 0.0) + 1
    edges = np.concatenate(([0], change, [n])).astype(np.int64)
    length = np.diff(edges)
    jump = np.abs(np.diff(T))[change - 1]
    use = np.ones(n, dtype=bool)
    if not len(jump):
        return Repaired(T, use, 0.0, 0)
    typical = float(np.median(jump))
    stuck = 0
    for k in np.flatnonzero(length >= max(_STUCK, 0.01 * n)):
        around = [jump[k - 1]] if k > 0 else []
        around += [jump[k]] if k < len(jump) else []
        # a fine sensor never gives so many equal values; a coarse one may, but does not then jump
        if max(around) > 5.0 * typical:
            use[edges[k] : edges[k + 1]] = False
            stuck += int(length[k])
    coarse = float(np.median(length)) >= 3.0 or len(np.unique(T)) < 0.05 * n
    if not coarse:
        return Repaired(T, use, 0.0, stuck)
    good = use[change - 1] & use[change]
    knots, values = change[good] - 0.5, 0.5 * (T[change - 1] + T[change])[good]
    if len(knots) < 2:
        return Repaired(T, use, typical, stuck)
    # where it turns, the value of the run itself is reached in the middle of the run; at the ends of the log at the end
    middle = np.flatnonzero((np.diff(values) == 0.0) & (np.diff(knots) > 1.0))
    extra = 0.5 * (knots[middle] + knots[middle + 1])
    level = T[np.round(extra).astype(np.int64)]
    at = np.concatenate(([0.0], knots, extra, [n - 1.0]))
    order = np.argsort(at, kind="stable")
    smooth = np.interp(np.arange(n), at[order], np.concatenate((T[:1], values, level, T[-1:]))[order])
    return Repaired(np.where(use, smooth, T), use, typical, stuck)


def spikes(x: FloatArray) -> BoolArray:
    """Single samples far off their neighbours, any axis. Shape (n,) of x (n, k).

    More than 10 robust standard deviations and 1 % of the range from the median of five, so that neither noise nor a
    ramp or its turning point is taken for one; a step of a coarse output is not either.
    """
    n = len(x)
    bad = np.zeros(n, dtype=bool)
    if n < 9:
        return bad
    window = np.lib.stride_tricks.sliding_window_view(np.pad(x, ((2, 2), (0, 0)), mode="reflect"), 5, axis=0)
    off = np.abs(x - np.median(window, axis=-1))
    around = np.abs(window[..., 4] - window[..., 3]) + np.abs(window[..., 1] - window[..., 0])
    for i in range(x.shape[1]):
        steps = np.abs(np.diff(x[:, i]))
        moving = steps[steps > 0.0]
        if not len(moving):
            continue
        spread = 1.4826 * float(np.median(off[:, i]))
        span = float(np.subtract(*np.percentile(x[:, i], [99.5, 0.5])))
        limit = max(10.0 * spread, 0.01 * span, 3.0 * float(np.median(moving)))
        bad |= off[:, i] > np.maximum(limit, 3.0 * around[:, i])
    return bad


def branches(T: FloatArray, smallest: float) -> list[Branch]:
    """Heating and cooling stretches.

    Parameters
    ----------
    T : ndarray, shape (n,)
        [degC]
    smallest : float
        Turns back by less are wiggles of the same branch. [K]

    Returns
    -------
    list of Branch
        Without a gap from the first sample to the last; none if the temperature changes by less than ``smallest``.
    """
    width = max(1, len(T) // (4 * BLOCKS))
    edges = np.arange(0, len(T), width)
    coarse = np.add.reduceat(T, edges) / np.diff(np.append(edges, len(T)))
    turns: list[int] = []
    way, low, high = 0, 0, 0
    for k in range(1, len(coarse)):
        if way >= 0 and coarse[k] > coarse[high]:
            high = k
        if way <= 0 and coarse[k] < coarse[low]:
            low = k
        if way >= 0 and coarse[high] - coarse[k] > smallest:
            if way > 0 or high > 0:
                turns.append(high)
            way, low = -1, k
        elif way <= 0 and coarse[k] - coarse[low] > smallest:
            if way < 0 or low > 0:
                turns.append(low)
            way, high = 1, k
    if way == 0:
        return []
    places = [0, *(int(edges[k]) + width // 2 for k in dict.fromkeys(turns)), len(T)]
    candidates = []
    for a, b in pairwise(places):
        start, stop = float(T[a]), float(T[b - 1])
        candidates.append(Branch(a, b, 1 if stop > start else -1, start, stop))
    return candidates


def directions(n: int, candidates: list[Branch]) -> FloatArray:
    """+1 heating, -1 cooling, for each of n samples."""
    s = np.zeros(n)
    for branch in candidates:
        s[branch.first : branch.last] = branch.direction
    return s


def blocks(n: int) -> IntArray:
    """First sample of each block of a log of n samples, evenly."""
    J = min(BLOCKS, n)
    return np.unique(np.linspace(0, n, J, endpoint=False).astype(np.int64))


def means(x: FloatArray, edges: IntArray) -> FloatArray:
    """Means over blocks, along axis 0."""
    count = np.diff(np.append(edges, len(x)))
    return np.asarray(np.add.reduceat(x, edges, axis=0) / count.reshape((-1,) + (1,) * (x.ndim - 1)))


def unbelievable_stamps(t: FloatArray, T: FloatArray) -> bool:
    """Whether the stamps make the temperature change faster than any sensor's can."""
    return bool(np.ptp(T) > _FASTEST * max(float(t[-1] - t[0]), 1e-300))
