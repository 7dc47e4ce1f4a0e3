"""Where an IMU with constant errors drifts to at rest, levelled by its own accelerometers: no noise, no calibration."""

from __future__ import annotations

import numpy as np

from schuler import frames
from schuler.arrays import FloatArray
from schuler.calibration.field import Rest, Routine, RoutineMotion
from schuler.exceptions import InputError
from schuler.mechanization.strapdown import mechanize
from schuler.reproduce.yaman.study.field_runs import PLACE
from schuler.reproduce.yaman.study.field_static_unit import levelled
from schuler.sensors.errors import ImuErrors
from schuler.simulation.imu import ideal_imu, simulate_imu


def rest_drift(
    errors: ImuErrors,
    seconds: float = 60.0,
    *,
    level_s: float = 10.0,
    rate_hz: float = 100.0,
    place: tuple[float, float, float] = PLACE,
) -> FloatArray:
    """Position error of free navigation at rest and level.

    Parameters
    ----------
    errors : ImuErrors
        Constant; noise, if there is any, is drawn from a fixed seed.
    seconds, level_s : float
        Free navigation; levelling by the mean specific force before it. [s]
    rate_hz : float
    place : (float, float, float)
        Latitude, longitude [rad], height [m].

    Returns
    -------
    ndarray, shape (3,)
        Estimate minus truth at the end: north, east, down. [m]

    Raises
    ------
    InputError
        If a time is not positive.

    Notes
    -----
    A vertical acceleration error b sinks by ``b t^2 / 2``, a horizontal rate b moves by ``g b t^3 / 6``, a horizontal
    acceleration error hides in the tilt.

    References
    ----------
    Yaman (2017), section 6.2.1: roll and pitch by levelling, heading as told (here north).
    """
    if not (seconds > 0.0 and level_s > 0.0):
        raise InputError(f"rest_drift: expected positive times, got {seconds!r} s after {level_s!r} s of levelling")
    llh = np.array(place)
    ideal = ideal_imu(RoutineMotion(Routine((Rest(level_s + seconds),)), llh), rate_hz)
    imu = simulate_imu(ideal, errors, np.random.default_rng(0)).imu
    nav = levelled(imu, llh, 0.0, level_s)
    track = mechanize(imu.increments().between(nav.t, np.inf), nav)
    return np.asarray((track.r_eb_e[-1] - frames.ecef_from_llh(llh)) @ frames.C_en(llh))
