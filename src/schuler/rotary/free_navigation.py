"""A vehicle at rest whose IMU has fixed errors and is turned, or not: what a free mechanization then gets wrong.

The errors come out in Du's axes, east north up, so that runs stand beside the thesis and its analytic tables.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from schuler import frames, rotation
from schuler.arrays import ArrayLike, FloatArray, as_vector3
from schuler.mechanization.strapdown import NavState
from schuler.plotting.notebook import Abridged
from schuler.recording.series import ImuSeries
from schuler.recording.trajectory import Trajectory
from schuler.rotary.du_axes import enu_errors, swap_vector
from schuler.rotary.encoder import Platform
from schuler.rotary.mechanization import Route, mechanize_rotating
from schuler.rotary.rotating_imu import RotatingMotion, ideal_rotating_imu, vehicle_truth
from schuler.rotary.schedule import Schedule
from schuler.sensors.errors import ImuErrors
from schuler.simulation.imu import simulate_imu
from schuler.simulation.motion import Motion, StaticMotion


@dataclass(frozen=True, eq=False, repr=False)
class ErrorHistory(Abridged):
    """Errors of a navigation, estimate minus truth, in Du's axes.

    Attributes
    ----------
    t : ndarray, shape (n,)
        [s]
    attitude : ndarray, shape (n, 3)
        About east, north, up: at rest and heading north the errors of pitch, roll and, with the other sign, azimuth;
        see :func:`schuler.rotary.du_axes.enu_errors`. [rad]
    velocity : ndarray, shape (n, 3)
        East, north, up. [m/s]
    position : ndarray, shape (n, 3)
        East, north, up along the axes of the true place. [m]
    """

    t: FloatArray
    attitude: FloatArray
    velocity: FloatArray
    position: FloatArray

    @property
    def horizontal(self) -> FloatArray:
        """Horizontal position error. Shape (n,). [m]"""
        return np.hypot(self.position[:, 0], self.position[:, 1])


def free_run(
    vehicle: Motion,
    schedule: Schedule,
    errors: ImuErrors,
    *,
    rate_hz: float = 100.0,
    rng: np.random.Generator | None = None,
    platform: Platform | None = None,
    route: Route = "sensor",
    offset_m: ArrayLike = (0.0, 0.0, 0.0),
    modelled_offset_m: ArrayLike | None = None,
) -> ErrorHistory:
    """Simulate a rotating IMU on a vehicle and navigate freely from the true start.

    Parameters
    ----------
    vehicle : Motion
    schedule : Schedule
        :func:`schuler.rotary.schemes.fixed` for a conventional IMU.
    errors : ImuErrors
        In the axes of the IMU.
    rate_hz : float
    rng : numpy.random.Generator, optional
        For the noise of the errors, if they have any.
    platform : Platform, optional
        Platform that the mechanization believes in: readings of an encoder; default the truth.
    route
        See :func:`schuler.rotary.mechanization.mechanize_rotating`.
    offset_m, modelled_offset_m : array_like, shape (3,)
        True offset of the IMU from the axis, and that which the mechanization knows of; default the true one. [m]

    Returns
    -------
    ErrorHistory
        Errors of the vehicle, at the ends of the sampling intervals.
    """
    motion = RotatingMotion(vehicle, schedule, as_vector3(offset_m, "offset_m"))
    ideal = ideal_rotating_imu(motion, rate_hz)
    imu: ImuSeries = simulate_imu(ideal, errors, rng or np.random.default_rng(0)).imu
    solved = mechanize_rotating(
        imu.increments(),
        start_of(vehicle),
        platform or schedule,
        route=route,
        offset_m=offset_m if modelled_offset_m is None else modelled_offset_m,
    )
    return error_history(solved, vehicle_truth(motion, imu.t))


def static_run(
    schedule: Schedule,
    errors: ImuErrors,
    *,
    duration: float = 300.0,
    lat: float = 0.25 * np.pi,
    rpy_nb: ArrayLike = (0.0, 0.0, 0.0),
    rate_hz: float = 100.0,
    rng: np.random.Generator | None = None,
) -> ErrorHistory:
    """:func:`free_run` of a vehicle at rest on the ellipsoid: Du's chapter 3.

    Parameters
    ----------
    schedule, errors, rate_hz, rng
        See :func:`free_run`.
    duration : float
        The thesis does not state it; its results fit 300 s. [s]
    lat : float
        Likewise 45 degrees. [rad]
    rpy_nb : array_like, shape (3,)
        [rad]
    """
    vehicle = StaticMotion(np.array([lat, 0.0, 0.0]), as_vector3(rpy_nb, "rpy_nb"), duration)
    return free_run(vehicle, schedule, errors, rate_hz=rate_hz, rng=rng)


def start_of(vehicle: Motion) -> NavState:
    """True state of a motion at zero."""
    s = vehicle.state(np.zeros(1))
    return NavState(0.0, s.r_eb_e[0], s.v_eb_e[0], rotation.quat_from_dcm(s.C_eb[0]))


def error_history(solved: Trajectory, true: Trajectory) -> ErrorHistory:
    """Errors of a trajectory against the true one at the same times, in Du's axes."""
    attitude = enu_errors(solved.C_nb, true.C_nb)
    C_en = frames.C_en(true.llh)
    position: FloatArray = np.einsum("nji,nj->ni", C_en, solved.r_eb_e - true.r_eb_e)
    return ErrorHistory(true.t, attitude, swap_vector(solved.v_eb_n - true.v_eb_n), swap_vector(position))
