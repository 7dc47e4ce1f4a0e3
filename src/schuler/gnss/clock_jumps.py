"""Receiver clocks that are set by whole milliseconds: where it happened, and by how much."""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from schuler.arrays import FloatArray, IntArray
from schuler.gnss.signals import SPEED_OF_LIGHT

MILLISECOND = 1e-3 * SPEED_OF_LIGHT  # [m]
LONGEST_GAP_S = 60.0
_FASTEST = 3e4  # [m/s]
_CLEAR = 0.1  # a step is a whole number of milliseconds if it is as near as this to one [ms]


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
    known = np.flatnonzero(np.isfinite(clock))
    usual = 0.0
    for a, b in pairwise(known.tolist()):
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
