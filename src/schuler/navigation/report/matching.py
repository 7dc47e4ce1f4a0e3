"""Which entry of one list belongs to which of another: by time, and by place among those of the same time."""

from __future__ import annotations

import numpy as np

from schuler.arrays import FloatArray, IntArray
from schuler.gnss.ranges import Ranges

SAME_TIME = 1e-5  # fixes and measurements closer than this are the same [s]


def matched_satellites(t: FloatArray, ranges: Ranges, value: FloatArray) -> IntArray:
    """Satellite of each innovation, 0 where it is not known.

    The filter works off the ranges of an epoch in their order, so the place among the innovations of one time tells.

    Parameters
    ----------
    t : ndarray, shape (n,)
        Times of the innovations. [s]
    ranges : Ranges
        Those of the run.
    value : ndarray, shape (k,)
        Its pseudoranges or range rates; those not finite were not offered.

    Returns
    -------
    ndarray of int, shape (n,)
        0 in epochs that have another number of ranges than of innovations: then these are other ranges.
    """
    found = np.zeros(len(t), dtype=np.int64)
    rows = np.flatnonzero(ranges.used & np.isfinite(value))
    if not len(rows) or not len(t):
        return found
    epochs, first, many = np.unique(ranges.t[rows], return_index=True, return_counts=True)
    times, begin, count = np.unique(t, return_index=True, return_counts=True)
    k, distance = nearest(times, epochs)
    same = (distance < SAME_TIME) & (many[k] == count)
    place = np.arange(len(t)) - np.repeat(begin, count)
    known = np.repeat(same, count)
    at = (np.repeat(first[k], count) + place)[known]
    found[known] = ranges.sat[rows[at]]
    return found


def nearest(t: FloatArray, among: FloatArray) -> tuple[IntArray, FloatArray]:
    """Index of the nearest of increasing times, and how far it is. Shapes (n,), (n,). [s]"""
    k = np.clip(np.searchsorted(among, t), 1, max(len(among) - 1, 1))
    left = np.clip(k - 1, 0, len(among) - 1)
    right = np.clip(k, 0, len(among) - 1)
    k = np.where(np.abs(among[left] - t) <= np.abs(among[right] - t), left, right)
    return k.astype(np.int64), np.abs(among[k] - t)
