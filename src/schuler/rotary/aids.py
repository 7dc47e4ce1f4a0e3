"""Aiding of an IMU that turns on a platform: what is fixed in the body moves in the axes of the IMU."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from schuler.arrays import ArrayLike, FloatArray, as_vector3
from schuler.exceptions import ConfigError, InputError
from schuler.filtering.measurements import (
    FIX,
    HEIGHT,
    KINDS,
    POSITION,
    RESET_POSITION,
    RESET_VELOCITY,
    VELOCITY,
    ZERO_VELOCITY,
    MeasurementSchedule,
)
from schuler.navigation.config import NavigationConfig
from schuler.recording.series import Increments
from schuler.rotary import gimbals
from schuler.rotary.encoder import Platform

_PLACES = (POSITION, FIX, HEIGHT, RESET_POSITION)
_VELOCITIES = (VELOCITY, ZERO_VELOCITY, RESET_VELOCITY)


def lever_arms(
    platform: Platform, t: ArrayLike, l_b: ArrayLike, rate_t: ArrayLike | None = None
) -> tuple[FloatArray, FloatArray]:
    """Lever arms fixed in the body as the turning IMU sees them.

    Parameters
    ----------
    platform : Platform
        A schedule or the readings of an encoder.
    t : array_like, shape (n,)
        [s]
    l_b : array_like, shape (3,) or (n, 3)
        From the point where the platform's axes meet, body axes. [m]
    rate_t : array_like, shape (n,), optional
        Times at which the platform's rate is taken; default the same. [s]

    Returns
    -------
    l_s, l_s_rate : ndarray, shape (n, 3)
        ``C_sb l_b`` [m] and its derivative ``-omega_bs_s x l_s`` [m/s].
    """
    times = np.asarray(t, dtype=np.float64)
    l_b = np.broadcast_to(np.asarray(l_b, dtype=np.float64), (len(times), 3))
    angles = platform.angles(times)
    l_s: FloatArray = np.einsum("nji,nj->ni", gimbals.C_bs(platform.axes, angles, platform.C_mount), l_b)
    at = times if rate_t is None else np.asarray(rate_t, dtype=np.float64)
    omega = gimbals.omega_bs_s(platform.axes, angles, platform.rates(at), platform.C_mount)
    return l_s, -np.cross(omega, l_s)


def in_imu_axes(
    schedule: MeasurementSchedule,
    platform: Platform,
    offset_m: ArrayLike = (0.0, 0.0, 0.0),
    *,
    increments: Increments | None = None,
) -> MeasurementSchedule:
    """A schedule whose lever arms are in body axes, for a filter that navigates the turning IMU.

    Parameters
    ----------
    schedule : MeasurementSchedule
        Lever arms from the point where the platform's axes meet, body axes.
    platform : Platform
        Must cover the times of the schedule.
    offset_m : array_like, shape (3,)
        From that point to the accelerometers, IMU axes. [m]
    increments : Increments, optional
        The log that is filtered. The engine takes the mean rate of an interval for that at a measurement in it; with
        this the platform's rate is taken in the middle of the same interval, so that the two cancel also while the
        platform accelerates.

    Returns
    -------
    MeasurementSchedule
        Lever arms ``C_sb l_b - offset``; velocities also get their derivative, ``-omega_bs_s x C_sb l_b``, in the
        places that the engine has for it. What is measured then moves with ``C_ns (omega_is_s x l_s + dl_s/dt)``
        relative to the IMU, in which the platform's rate drops out: that of the gyroscopes against the encoder's.

    Raises
    ------
    InputError
        If a measurement is tied to the body's axes in another way than by a lever arm (course, wheels, mean readings
        at rest).
    """
    other = ~np.isin(schedule.kind, _PLACES + _VELOCITIES)
    if other.any():
        names = ", ".join(sorted({KINDS[int(k)] for k in schedule.kind[other]}))
        raise InputError(
            f"a rotating IMU is aided by positions, heights and velocities (GNSS, rest); the filter has no place for "
            f"the platform's angle in: {names}. Leave these aids out"
        )
    if not len(schedule):
        return schedule
    rate_t = schedule.t
    if increments is not None:
        k = np.minimum(np.searchsorted(increments.t, schedule.t - 1e-9), len(increments) - 1)
        rate_t = increments.t[k] - 0.5 * increments.dt[k]
    l_s, rate = lever_arms(platform, schedule.t, schedule.lever, rate_t)
    z = schedule.z.copy()
    moving = np.isin(schedule.kind, _VELOCITIES)
    z[moving, 3:6] += rate[moving]
    return replace(schedule, z=z, lever=np.ascontiguousarray(l_s - as_vector3(offset_m, "offset_m")))


def check_aids(config: NavigationConfig) -> None:
    """Refuse what a rotating IMU cannot be navigated with, before anything is computed.

    Raises
    ------
    ConfigError
        Naming every entry, and what to do.
    """
    aiding, gnss = config.aiding, config.gnss
    wrong = [f"aiding.{name}" for name in ("zero_rate", "gravity", "earth_rate", "non_holonomic", "odometer", "heading")
             if getattr(aiding, name) is not None]  # fmt: skip
    if wrong:
        raise ConfigError(
            f"{', '.join(wrong)}: not for a rotating IMU, these are tied to the axes of a body that it does not share; "
            "leave them out (GNSS, aiding.zero_velocity, fixes and barometer can stay)"
        )
    if gnss.coupling == "tight":
        raise ConfigError(
            'gnss.coupling: "tight" is not for a rotating IMU, range rates have no place for a lever arm that turns; '
            'use "loose"'
        )
    if len(set(config.filter.noise.accel_axes)) > 1:
        raise ConfigError(
            "filter.noise.accel: factors forward, right and down are not for an IMU that turns in the vehicle; "
            "give one number"
        )
    if gnss.lever_sigma_m > 0.0:
        raise ConfigError(
            "gnss.lever_sigma_m: the lever arm is fixed in the body, not in the axes of a rotating IMU, so it cannot "
            "be estimated with it; measure it and leave the entry out"
        )
    if any(config.imu.mount_rpy_deg):
        raise ConfigError(
            "imu.mount_rpy_deg: a rotating IMU is mounted on its platform; give the platform the mounting (C_mount of "
            "the schedule or the encoder's readings) and leave the entry out"
        )
