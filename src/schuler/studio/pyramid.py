"""Envelopes of long signals: smallest and largest sample of every stretch, at a cost that does not grow with the log.

A pyramid holds the extremes of blocks of 64 samples, of 512, of 4096 and so on. A window of any length is answered from
the coarsest level whose blocks are no longer than what one column of the screen shows.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from schuler.arrays import FloatArray

FINEST = 64  # samples in a block of the first level: 3 % more memory than the samples take
RATIO = 8  # blocks of a level in one of the next


@dataclass(frozen=True, eq=False)
class Pyramid:
    """Samples and the extremes of their blocks.

    Attributes
    ----------
    y : ndarray, shape (n,)
        Samples, in any unit; NaN is left out of extremes.
    low, high : tuple of ndarray
        Smallest and largest sample of the blocks of each level, the last block of a level may be shorter.
    """

    y: FloatArray
    low: tuple[FloatArray, ...]
    high: tuple[FloatArray, ...]


def pyramid(y: FloatArray) -> Pyramid:
    """Pyramid of samples. Shape (n,)"""
    low: list[FloatArray] = []
    high: list[FloatArray] = []
    lower, upper, step = y, y, FINEST
    while len(lower) > step:
        starts = np.arange(0, len(lower), step)
        lower, upper = np.fmin.reduceat(lower, starts), np.fmax.reduceat(upper, starts)
        low.append(lower)
        high.append(upper)
        step = RATIO
    return Pyramid(y, tuple(low), tuple(high))


def envelope(
    t: FloatArray, p: Pyramid, start: float, stop: float, columns: int
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Smallest and largest sample of stretches of a window.

    Parameters
    ----------
    t : ndarray, shape (n,)
        Times of the samples, ascending. [s]
    p : Pyramid
        Of the samples.
    start, stop : float
        Window; a sample beyond each end belongs to it, so that lines leave it. [s]
    columns : int
        Stretches wanted; there are between a half of them and twice as many, or every sample where there are fewer
        than two a stretch.

    Returns
    -------
    t, low, high : ndarray, shape (k,)
        First time of each stretch, and the extremes of all its samples; low and high are the same where every sample
        is its own stretch. [s], unit of the samples
    """
    first = max(int(np.searchsorted(t, start, side="right")) - 1, 0)
    end = min(int(np.searchsorted(t, stop, side="left")) + 1, len(t))
    if end - first <= 2 * columns:
        y = p.y[first:end]
        return t[first:end], y, y
    each = (end - first) // columns
    sizes = [1, *(FINEST * RATIO**k for k in range(len(p.low)))]
    level = max(k for k, size in enumerate(sizes) if size <= each)
    size = sizes[level]
    lower, upper = (p.y, p.y) if level == 0 else (p.low[level - 1], p.high[level - 1])
    begin, finish = first // size, -(-end // size)  # whole blocks: extremes beside the window do no harm
    starts = np.arange(begin, finish, max(each // size, 1))
    low = np.fmin.reduceat(lower[:finish], starts)
    high = np.fmax.reduceat(upper[:finish], starts)
    return t[starts * size], low, high
