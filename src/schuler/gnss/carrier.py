"""Carrier phases: arcs in which an ambiguity is constant, and changes from epoch to epoch in which it cancels."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from schuler.arrays import FloatArray, IntArray
from schuler.exceptions import InputError
from schuler.gnss.ranges import Ranges
from schuler.gnss.slow_errors import channels
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
    """

    now: IntArray
    before: IntArray
    change: FloatArray
    sigma: FloatArray


@dataclass(frozen=True)
class CarrierPhases:
    """Carrier phases of satellites in use, each with the channel of its ambiguity.

    Attributes
    ----------
    row : ndarray of int, shape (m,)
        Rows of the ranges, in order of time.
    before : ndarray of int, shape (m,)
        Row of the phase before in the same arc, at the epoch before; -1 where an arc begins.
    sigma : ndarray, shape (m,)
        1-sigma of white noise. [m]
    channel : ndarray of int, shape (m,)
        From 1; 0 where there are more satellites than channels.
    """

    row: IntArray
    before: IntArray
    sigma: FloatArray
    channel: IntArray


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
    p = carrier_phases(ranges, sigma, 0)
    linked = p.before >= 0
    now, before = p.row[linked], p.before[linked]
    scale = noise_scale(ranges.elevation, ranges.cn0, "elevation+cn0")
    noise = sigma * np.hypot(scale[now], scale[before])
    noise = np.hypot(noise, DRIFT * (ranges.t[now] - ranges.t[before]))
    return CarrierChanges(now, before, ranges.carrier_range[now] - ranges.carrier_range[before], noise)


def carrier_phases(ranges: Ranges, sigma: float, most: int) -> CarrierPhases:
    """Carrier phases of satellites in use, linked to the phases before in their arcs.

    Parameters
    ----------
    ranges : Ranges
    sigma : float
        1-sigma of a phase of a strong satellite overhead; it grows as noise of codes does. [m]
    most : int
        Number of channels. A satellite keeps its own until it was away for ten seconds, over which an arc may go on.

    Raises
    ------
    InputError
        If ``sigma`` is not positive.
    """
    if not sigma > 0.0:
        raise InputError(f"sigma: expected a positive standard deviation of carrier phases in metres, got {sigma}")
    rows = np.flatnonzero(ranges.used & np.isfinite(ranges.carrier_range) & np.isfinite(ranges.r_sat_e).all(axis=1))
    rows = rows[np.argsort(ranges.t[rows], kind="stable")]
    _, epoch = np.unique(ranges.t[rows], return_inverse=True)
    order = np.lexsort((epoch, ranges.sat[rows]))
    a, b = order[:-1], order[1:]
    together = (ranges.sat[rows[a]] == ranges.sat[rows[b]]) & (ranges.arc[rows[a]] == ranges.arc[rows[b]])
    together &= (epoch[b] == epoch[a] + 1) & (ranges.t[rows[b]] - ranges.t[rows[a]] <= LONGEST_PAUSE_S)
    before = np.full(len(rows), -1, dtype=np.int64)
    before[b[together]] = rows[a[together]]
    scale = noise_scale(ranges.elevation[rows], ranges.cn0[rows], "elevation+cn0")
    channel = channels(ranges.t[rows], ranges.sat[rows], LONGEST_PAUSE_S, most)
    return CarrierPhases(rows, before, sigma * scale, channel)
