"""Numbers of a free-inertial run: root mean squares over time of the vehicle's errors."""

from __future__ import annotations

import numpy as np

from schuler.arrays import FloatArray
from schuler.exceptions import InputError
from schuler.recording.trajectory import Trajectory
from schuler.rotary.free_navigation import error_history
from schuler.units import DEG

#: Order of :func:`rms_values`; horizontal ones are of both components together.
QUANTITIES = (
    "horizontal_position", "horizontal_velocity", "vertical_position", "vertical_velocity", "roll", "pitch", "azimuth",
)  # fmt: skip
#: Unit for people and its size.
UNITS = {
    "horizontal_position": ("m", 1.0), "horizontal_velocity": ("m_s", 1.0), "vertical_position": ("m", 1.0),
    "vertical_velocity": ("m_s", 1.0), "roll": ("deg", DEG), "pitch": ("deg", DEG), "azimuth": ("deg", DEG),
}  # fmt: skip


def rms_values(solved: Trajectory, true: Trajectory) -> FloatArray:
    """Root mean squares over time, as the thesis quotes its runs.

    Parameters
    ----------
    solved, true : Trajectory
        Of the vehicle, at the same times, with velocity and attitude.

    Returns
    -------
    ndarray, shape (7,)
        In the order of :data:`QUANTITIES`. [m], [m/s], [rad]

    Raises
    ------
    InputError
        If times differ, or velocity or attitude is missing.

    References
    ----------
    Du (2015), section 4.1: HP and HV are root sums of squares of the two horizontal values.
    """
    if len(solved.t) != len(true.t) or np.abs(solved.t - true.t).max() > 1e-6:
        raise InputError("expected two trajectories at the same times; use Trajectory.at")
    for s in (solved, true):
        if s.v_eb_e is None or s.q_eb is None:
            raise InputError("expected velocity and attitude of both trajectories")
    history = error_history(solved, true)
    p, v = (np.mean(x**2, axis=0) for x in (history.position, history.velocity))
    angles = np.mod(solved.rpy_nb - true.rpy_nb + np.pi, 2.0 * np.pi) - np.pi
    return np.asarray(np.sqrt([p[0] + p[1], v[0] + v[1], p[2], v[2], *np.mean(angles**2, axis=0)]))


def index(quantity: str) -> int:
    """Place of a quantity in :data:`QUANTITIES`."""
    if quantity not in QUANTITIES:
        raise InputError(f"quantity: expected one of {', '.join(QUANTITIES)}, got {quantity!r}")
    return QUANTITIES.index(quantity)
