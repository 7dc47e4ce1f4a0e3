"""Slow errors of single satellites' ranges: channels for their states, and what they weigh where there is none."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from schuler.arrays import FloatArray, IntArray
from schuler.gnss.ranges import Ranges
from schuler.gnss.weighting import noise_scale

_FORGOTTEN = 5.0  # correlation times after which nothing is left of an error that matters (exp(-5))


class SlowRangeError(NamedTuple):
    """A Gauss-Markov error of each satellite's ranges: multipath, and what models leave of the atmosphere.

    Attributes
    ----------
    sigma : float
        1-sigma overhead, growing with elevation as ``sqrt(0.5 + 0.5 / sin^2 E)``; 0: none. [m]
    tau : float
        Correlation time. [s]
    """

    sigma: float
    tau: float

    def scale(self, ranges: Ranges) -> FloatArray:
        """Error of each range in units of that overhead. Shape (n,)."""
        elevation = np.nan_to_num(ranges.elevation, nan=0.5 * np.pi)
        return noise_scale(elevation, ranges.cn0, "elevation")


def slow_channels(ranges: Ranges, tau: float, most: int) -> IntArray:
    """Channel of each range, a state that only one satellite has at a time.

    Parameters
    ----------
    ranges : Ranges
        Rows that are used and have a pseudorange count.
    tau : float
        Correlation time of the error. [s]
    most : int
        Number of channels.

    Returns
    -------
    ndarray of int, shape (n,)
        From 1; 0 where there is none. A satellite keeps its channel, until it was away for five correlation times and
        another one needs it.
    """
    channel = np.zeros(len(ranges), dtype=np.int64)
    rows = np.flatnonzero(ranges.used & np.isfinite(ranges.pseudorange))
    rows = rows[np.argsort(ranges.t[rows], kind="stable")]
    channel[rows] = channels(ranges.t[rows], ranges.sat[rows], _FORGOTTEN * tau, most)
    return channel


def channels(t: FloatArray, sat: IntArray, kept_s: float, most: int) -> IntArray:
    """Channels of satellites, each of which only one has at a time.

    Parameters
    ----------
    t : ndarray, shape (n,)
        Times, non-decreasing. [s]
    sat : ndarray of int, shape (n,)
    kept_s : float
        Absence after which a channel may go to another satellite. [s]
    most : int
        Number of channels.

    Returns
    -------
    ndarray of int, shape (n,)
        From 1; 0 where there is none.
    """
    channel = np.zeros(len(t), dtype=np.int64)
    owner, seen = [0] * most, [-np.inf] * most
    of: dict[int, int] = {}
    for row, (when, one) in enumerate(zip(t.tolist(), sat.tolist(), strict=True)):
        if one not in of:
            free = next((k for k in range(most) if when - seen[k] > kept_s), None)
            if free is None:
                continue
            of.pop(owner[free], None)
            owner[free], of[one] = one, free
        seen[of[one]] = when
        channel[row] = of[one] + 1
    return channel


def slow_sigmas(ranges: Ranges, slow: SlowRangeError) -> FloatArray:
    """White noise that weighs on a long average as much as the slow error: ``sigma sqrt(coth(dt / 2 tau))``.

    A Gauss-Markov error of 1-sigma ``s``, sampled every ``dt``, weighs like white noise of variance
    ``s^2 (1 + a) / (1 - a)``, ``a = exp(-dt / tau)``. Shape (n,). [m]
    """
    t = np.unique(ranges.t)
    if len(t) < 2 or slow.sigma == 0.0:
        return np.zeros(len(ranges))
    step = float(np.median(np.diff(t)))
    return np.asarray(slow.sigma * slow.scale(ranges) / np.sqrt(np.tanh(0.5 * step / slow.tau)))
