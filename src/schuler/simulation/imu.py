"""Simulated IMU: ideal increments or rates of a motion, corrupted by one realisation of an IMU's errors."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from schuler.arrays import FloatArray
from schuler.exceptions import InputError
from schuler.recording.series import ImuSeries, Kind, Trajectory
from schuler.sensors.errors import ApplyReport, ImuErrors
from schuler.simulation.motion import Motion, ideal_increments, ideal_rates


class SimulatedImu(NamedTuple):
    """IMU series with what is true of it.

    Attributes
    ----------
    imu : ImuSeries
        Body axes.
    truth : Trajectory
        Position, velocity, attitude of the IMU at the start and at every sample. n + 1 entries for increments.
    report : ApplyReport
        True biases by sample, clipping.
    """

    imu: ImuSeries
    truth: Trajectory
    report: ApplyReport


def simulate_imu(
    motion: Motion,
    errors: ImuErrors,
    rate_hz: float,
    rng: np.random.Generator,
    *,
    kind: Kind = "increment",
    earth_rotation: bool = True,
    temperature: FloatArray | float | None = None,
) -> SimulatedImu:
    """IMU output along a motion.

    Parameters
    ----------
    motion : Motion
    errors : ImuErrors
        One realisation, see :meth:`ImuErrors.draw`; :meth:`ImuErrors.none` for an ideal IMU.
    rate_hz : float
        Sampling rate.
    rng : numpy.random.Generator
        For the noise.
    kind : {"increment", "rate"}
        Increments are exact integrals of the motion over each interval; rates are samples at the stamps, noise scaled
        for the same rate.
    earth_rotation : bool
        See :func:`schuler.simulation.motion.inertial_quantities`.
    temperature : float or ndarray, shape (n,), optional
        [degC]

    Returns
    -------
    SimulatedImu
    """
    if not rate_hz > 0.0:
        raise InputError(f"rate_hz: expected a positive rate, got {rate_hz!r}")
    n = int(np.floor(motion.duration * rate_hz + 1e-9))
    if n < 2:
        raise InputError(f"a motion of {motion.duration} s holds no two samples at {rate_hz} Hz")
    t = np.arange(n + 1) / rate_hz
    dt = 1.0 / rate_hz
    if kind == "increment":
        dtheta, dv, report = errors.apply_increments(
            *ideal_increments(motion, t, earth_rotation=earth_rotation), dt, rng, temperature
        )
        imu = ImuSeries(t[1:], dtheta, dv, "increment")
    else:
        gyro, accel, report = errors.apply_rates(
            *ideal_rates(motion, t, earth_rotation=earth_rotation), dt, rng, temperature
        )
        imu = ImuSeries(t, gyro, accel, "rate")
    return SimulatedImu(imu, truth(motion, t), report)


def truth(motion: Motion, t: FloatArray) -> Trajectory:
    """True trajectory of a motion at times (n,), in pieces so that hours need no more memory than the result."""
    r, v, q = np.empty((len(t), 3)), np.empty((len(t), 3)), np.empty((len(t), 4))
    for first in range(0, len(t), 32_768):
        part = slice(first, first + 32_768)
        s = motion.state(t[part])
        r[part], v[part], q[part] = s.r_eb_e, s.v_eb_e, s.q_eb
    return Trajectory(t, r, v, q)
