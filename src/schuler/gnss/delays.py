"""Group delays of satellites' signals: what has to be taken from the broadcast clock for a signal of one frequency."""

from __future__ import annotations

import numpy as np

from schuler.arrays import BoolArray, FloatArray, IntArray
from schuler.gnss.satellites import SatelliteStates
from schuler.gnss.signals import BANDS, SYSTEMS

#: 1-sigma of a delay that is not broadcast (differential code biases of satellites scatter by some ns). [m]
UNKNOWN_DELAY = 1.0


def group_delays(states: SatelliteStates, sat: IntArray, bands: IntArray) -> tuple[FloatArray, BoolArray]:
    """Group delay of each signal relative to the broadcast clock.

    Parameters
    ----------
    states : SatelliteStates, n rows
    sat : ndarray of int, shape (n,)
    bands : ndarray of int, shape (n,)
        RINEX band, 1 to 9, of each row.

    Returns
    -------
    delay : ndarray, shape (n,)
        The satellite's clock for this signal is ``clock - delay``. [s]
    known : ndarray of bool, shape (n,)
        False where the message does not broadcast it: the delay of a neighbour is used, or zero; add
        :data:`UNKNOWN_DELAY` to the budget.

    Notes
    -----
    The table is in docs/gnss-models.md. With ``gamma = (f_1/f_2)^2``: GPS and QZSS L1 TGD, L2 gamma TGD (clock of the
    L1/L2 combination). Galileo E1 BGD, E5 gamma BGD of the message's own pair; the second pair of an I/NAV message is
    reached through E1. BeiDou's clock is that of B3I: B1I TGD1, B2I TGD2, B3I none. GLONASS: none broadcast here.

    References
    ----------
    IS-GPS-200, 20.3.3.3.3.2; Galileo OS SIS ICD, 5.1.5; BeiDou B1I ICD, 5.2.4.9; NavIC SIS ICD, 6.2.1.6.
    """
    delay, known = np.zeros(len(sat)), np.zeros(len(sat), dtype=bool)
    system = sat // 100
    first, second = states.group_delay.T

    def put(letter: str, band: int, value: FloatArray, broadcast: bool | BoolArray = True) -> None:
        m = (system == SYSTEMS.index(letter)) & (bands == band)
        good = m & np.isfinite(value)
        delay[good] = value[good]
        known[good] = np.broadcast_to(broadcast, good.shape)[good]

    for letter in "GJ":
        put(letter, 1, first)
        put(letter, 2, _gamma(letter, 1, 2) * first)
        put(letter, 5, first, broadcast=False)  # ISC of L5 is not in the message of 1980
    put("I", 9, first)
    put("I", 5, _gamma("I", 9, 5) * first)
    f = states.f_nav
    own = np.where(f, first, second)
    has_b = ~f | (second != 0.0)  # F/NAV does not broadcast E5b/E1; files write zero
    put("E", 1, own)
    put("E", 5, own - first + _gamma("E", 1, 5) * first)
    put("E", 7, own - second + _gamma("E", 1, 7) * second, has_b)
    put("E", 8, own - 0.5 * (first + second) + _gamma("E", 1, 8) * 0.5 * (first + second), has_b)
    put("E", 6, own, broadcast=False)
    put("C", 2, first)
    put("C", 7, second)
    put("C", 6, np.zeros(len(sat)))
    put("C", 1, first, broadcast=False)
    put("C", 5, np.zeros(len(sat)), broadcast=False)
    put("C", 8, np.zeros(len(sat)), broadcast=False)
    return delay, known


def _gamma(system: str, first: int, second: int) -> float:
    return (BANDS[(system, str(first))] / BANDS[(system, str(second))]) ** 2
