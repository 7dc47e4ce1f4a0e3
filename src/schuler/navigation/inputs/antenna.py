"""Point that a solution is of: the IMU, or the antenna where nobody stated how far that is from the IMU."""

from __future__ import annotations

import numpy as np

from schuler.arrays import FloatArray, IntArray
from schuler.filtering.measurements import POSITION, PSEUDORANGE, RESET_POSITION
from schuler.filtering.states import StateLayout
from schuler.navigation.config import NavigationConfig

#: Opening of the note on a solution that is the antenna's.
ANTENNA_POINT = "positions are those of the antenna"
_LARGE_M = 1.0  # claim beside which antennas on vehicles and in hands are near enough to the IMU, horizontal 1-sigma


def is_of_antenna(config: NavigationConfig, kinds: IntArray, layout: StateLayout) -> bool:
    """Whether the solution is the antenna's, since its lever arm is neither stated nor estimated.

    Parameters
    ----------
    config : NavigationConfig
    kinds : ndarray of int, shape (m,)
        Kinds of the measurements.
    layout : StateLayout
    """
    placed = np.isin(kinds, (POSITION, PSEUDORANGE, RESET_POSITION)).any()
    return bool(placed and not config.lever_is_stated and "lever" not in layout)


def antenna_note(sigma_m: FloatArray) -> list[str]:
    """A sentence on a solution that is the antenna's, where it claims less than the two may be apart.

    Parameters
    ----------
    sigma_m : ndarray, shape (k, 2)
        Claimed 1-sigma north and east. [m]
    """
    claimed = float(np.median(np.hypot(*sigma_m.T))) if len(sigma_m) else np.inf
    if not claimed < _LARGE_M:
        return []
    return [
        f"{ANTENNA_POINT}, claimed to {claimed:.2g} m: how far that is from the IMU is not stated, and not seen in the "
        "fixes; state gnss.lever_arm_m, [0, 0, 0] where both are in one place"
    ]
