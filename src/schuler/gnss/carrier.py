"""Carrier phases from epoch to epoch: arcs in which an ambiguity is constant, and changes in which it cancels."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from schuler.arrays import FloatArray, IntArray
from schuler.exceptions import InputError
from schuler.gnss.ranges import Ranges
from schuler.gnss.weighting import noise_scale

LONGEST_PAUSE_S = 10.0  # over which a change is taken [s]
DRIFT = 0.001  # of a change: satellites' clocks and orbits, atmosphere, 1-sigma [m/s]


@dataclass(frozen=True)
class CarrierChanges:
    """Changes of carrier phases between consecutive epochs, of satellites in one arc.

    Attributes
    ----------
    now, before : ndarray of int, shape (m,)
        Rows of the ranges at both ends, in order of time.
    change : ndarray, shape (m,)
        Of the corrected carrier range. [m]
    sigma : ndarray, shape (m,)
        1-sigma. [m]
    epochs : ndarray, shape (k,)
        Times at which there are carrier phases: where changes begin and end. [s]
    """

    now: IntArray
    before: IntArray
    change: FloatArray
    sigma: FloatArray
    epochs: FloatArray


def begin_arcs(sat: IntArray, carrier: FloatArray, signal: IntArray, lock: IntArray) -> IntArray:
    """Number the arcs of each satellite as far as the receiver states where they end.

    Parameters
    ----------
    sat : ndarray of int, shape (n,)
        Of rows in order of time.
    carrier : ndarray, shape (n,)
        NaN where there is none.
    signal, lock : ndarray of int, shape (n,)
        As in :class:`schuler.gnss.signal_choice.ChosenSignals`.

    Returns
    -------
    ndarray of int, shape (n,)
        Counts up by satellite: after a row without a carrier, where lock was lost, the signal is another one, or a half
        cycle was or is no longer in doubt.
    """
    order = np.argsort(sat, kind="stable")
    a, b = order[:-1], order[1:]
    new = np.isnan(carrier[a]) | (signal[a] != signal[b]) | ((lock[b] & 1) > 0) | ((lock[a] ^ lock[b]) & 2 > 0)
    arc = np.zeros(len(sat), dtype=np.int64)
    arc[b] = np.cumsum(new)
    return arc


def carrier_changes(ranges: Ranges, sigma: float) -> CarrierChanges:
    """Changes of the carrier phases of satellites in use, over at most ten seconds.

    Parameters
    ----------
    ranges : Ranges
    sigma : float
        1-sigma of a phase of a strong satellite overhead; it grows as noise of codes does. [m]

    Returns
    -------
    CarrierChanges
        The variance is that of both phases and of what drifts meanwhile.

    Raises
    ------
    InputError
        If ``sigma`` is not positive.
    """
    if not sigma > 0.0:
        raise InputError(f"sigma: expected a positive standard deviation of carrier phases in metres, got {sigma}")
    rows = np.flatnonzero(ranges.used & np.isfinite(ranges.carrier_range) & np.isfinite(ranges.r_sat_e).all(axis=1))
    epochs, epoch = np.unique(ranges.t[rows], return_inverse=True)
    order = np.lexsort((epoch, ranges.sat[rows]))
    a, b = order[:-1], order[1:]
    before, now = rows[a], rows[b]
    together = (ranges.sat[before] == ranges.sat[now]) & (ranges.arc[before] == ranges.arc[now])
    together &= (epoch[b] == epoch[a] + 1) & (ranges.t[now] - ranges.t[before] <= LONGEST_PAUSE_S)
    in_time = np.argsort(now[together], kind="stable")
    before, now = before[together][in_time], now[together][in_time]
    scale = noise_scale(ranges.elevation, ranges.cn0, "elevation+cn0")
    noise = sigma * np.hypot(scale[now], scale[before])
    noise = np.hypot(noise, DRIFT * (ranges.t[now] - ranges.t[before]))
    return CarrierChanges(now, before, ranges.carrier_range[now] - ranges.carrier_range[before], noise, epochs)
