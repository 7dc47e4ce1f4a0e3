"""Receiver clocks: what ranges of an epoch have in common, and whole milliseconds by which a clock is set."""

from __future__ import annotations

from itertools import pairwise
from typing import NamedTuple

import numpy as np

from schuler.arrays import BoolArray, FloatArray, IntArray
from schuler.gnss.coarse import ReceiverPlace, epoch_medians, geometric_ranges
from schuler.gnss.satellites import SatelliteStates
from schuler.gnss.signals import SPEED_OF_LIGHT

_IMPLAUSIBLE = 10_000.0  # from the median of its epoch; the coarse position is much better than that [m]
_RESOLUTION_S = 1e-6  # times are corrected in steps of this, so that a disciplined receiver's stay as they are [s]
MILLISECOND = 1e-3 * SPEED_OF_LIGHT  # [m]
LONGEST_GAP_S = 60.0
_FASTEST = 3e4  # [m/s]
_CLEAR = 0.1  # a step is a whole number of milliseconds if it is as near as this to one [ms]


class ReceiverClock(NamedTuple):
    """Range rates (n,) [m/s], outlying ranges (n,), the clock (k,) [m] and its whole milliseconds (k,), by epoch."""

    rate: FloatArray
    outlying: BoolArray
    offset: FloatArray
    steps: IntArray
    notes: list[str]


def receiver_clock(
    range_rate: FloatArray, corrected: FloatArray, states: SatelliteStates, place: ReceiverPlace, epochs: FloatArray,
    epoch: IntArray, usable: BoolArray,
) -> ReceiverClock:  # fmt: skip
    """Range rates of satellites, and the clock that the ranges of an epoch have in common, if the place is known."""
    n, k = len(corrected), len(epochs)
    rate = range_rate + SPEED_OF_LIGHT * states.clock_rate
    if not place.located:
        return ReceiverClock(rate, np.zeros(n, dtype=np.bool_), np.zeros(k), np.zeros(k, dtype=np.int64), [])
    toward = _radial_speed(states, place)
    rate = rate + toward * range_rate / SPEED_OF_LIGHT
    residual = corrected - geometric_ranges(states.r_e, place.r_e)
    clock = epoch_medians(epoch, np.where(usable, residual, np.nan), k)
    drift = epoch_medians(epoch, np.where(usable, rate - toward, np.nan), k)
    steps, irregular = millisecond_steps(epochs, clock, drift)
    outlying = _outlying(residual, clock, epoch, usable)
    return ReceiverClock(rate, outlying, clock, steps, list(_clock_notes(epochs, steps, irregular)))


def millisecond_steps(t: FloatArray, clock: FloatArray, drift: FloatArray) -> tuple[IntArray, IntArray]:
    """Whole milliseconds by which a receiver clock has been set since the first epoch.

    Parameters
    ----------
    t : ndarray, shape (k,)
        Epochs. [s]
    clock : ndarray, shape (k,)
        Receiver clock at each, NaN where unknown; errors of 10 km do not matter. [m]
    drift : ndarray, shape (k,)
        Its rate from Doppler shifts. Where it is NaN, or beyond 100 ppm (a step between two measurements), the rate of
        the previous interval without a step is used. [m/s]

    Returns
    -------
    steps : ndarray of int, shape (k,)
        To be subtracted from the clock, in milliseconds, to make it continuous.
    irregular : ndarray of int
        Epochs at which the clock moved by more than 0.1 ms that is no whole number of milliseconds; left as it is.

    Notes
    -----
    Nothing is looked for across gaps of more than a minute, where a drift alone can make a millisecond.
    """
    steps = np.zeros(len(t), dtype=np.int64)
    irregular = []
    with_clock = np.flatnonzero(np.isfinite(clock))
    usual = 0.0
    for a, b in pairwise(with_clock.tolist()):
        dt, moved = t[b] - t[a], clock[b] - clock[a]
        if not 0.0 < dt <= LONGEST_GAP_S:
            continue
        rates = drift[[a, b]]
        rates = rates[np.abs(rates) < _FASTEST]
        unexpected = (moved - (rates.mean() if len(rates) else usual) * dt) / MILLISECOND
        whole = int(np.round(unexpected))
        if abs(unexpected - whole) > _CLEAR:
            irregular.append(int(b))
        elif whole:
            steps[b:] += whole
        else:
            usual = moved / dt
    return steps, np.array(irregular, dtype=np.int64)


def reception_times(epochs: FloatArray, clock: FloatArray) -> tuple[FloatArray, list[str]]:
    """Times of reception, corrected by the receiver clock [m]; an epoch without one takes that of the epoch before."""
    with_clock = np.flatnonzero(np.isfinite(clock))
    if not len(with_clock):
        return epochs, []
    last = with_clock[np.maximum(np.searchsorted(with_clock, np.arange(len(epochs)), side="right") - 1, 0)]
    t = epochs - np.round(clock[last] / SPEED_OF_LIGHT / _RESOLUTION_S) * _RESOLUTION_S
    if np.any(np.diff(t) <= 0.0):
        return epochs, ["times corrected by the receiver clock would not increase: left as they are"]
    return t, []


def _radial_speed(states: SatelliteStates, place: ReceiverPlace) -> FloatArray:
    """Velocity of the satellites along the line of sight, away from the receiver: ``u . v_sat``. Shape (n,). [m/s]"""
    to_sat = states.r_e - place.r_e
    to_sat /= np.linalg.norm(to_sat, axis=1)[:, None]
    return np.asarray(np.sum(to_sat * states.v_e, axis=1))


def _outlying(residual: FloatArray, clock: FloatArray, epoch: IntArray, usable: BoolArray) -> BoolArray:
    """Residuals far from the clock of their epoch, where four or more tell it. Shape (n,)."""
    alone = usable & np.isfinite(residual)
    off = np.abs(residual - clock[epoch]) > _IMPLAUSIBLE
    return np.asarray(alone & off & (np.bincount(epoch[alone], minlength=len(clock))[epoch] >= 4))


def _clock_notes(epochs: FloatArray, steps: IntArray, irregular: IntArray) -> list[str]:
    notes = []
    jumps = np.flatnonzero(np.diff(steps))
    if len(jumps):
        first = jumps[0]
        notes.append(
            f"the receiver set its clock by whole milliseconds {len(jumps)} times, first by "
            f"{steps[first + 1] - steps[first]:+d} ms at {epochs[first + 1]:.3f} s: taken out"
        )
    if len(irregular):
        notes.append(
            f"the receiver clock moved by more than 0.1 ms, but no whole milliseconds, {len(irregular)} times, first "
            f"at {epochs[irregular[0]]:.3f} s: left as it is"
        )
    return notes
