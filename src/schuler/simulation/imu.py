"""Simulated IMU: ideal output along a motion, one realisation of an IMU's errors, faults of its stream of samples."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from schuler import rotation
from schuler.arrays import BoolArray, FloatArray
from schuler.exceptions import InputError
from schuler.recording.series import ImuSeries, Kind
from schuler.recording.trajectory import FullTrajectory
from schuler.sensors.errors import ApplyReport, ImuErrors
from schuler.simulation.motion import Motion, ideal_increments, ideal_rates

_MOST = 1e10  # samples: more than any memory holds


class IdealImu(NamedTuple):
    """Output of a perfect IMU along a motion, and the true trajectory.

    Attributes
    ----------
    kind : {"increment", "rate"}
    rate_hz : float
    t : ndarray, shape (n + 1,)
        Limits of the intervals, which are the samples for rates. [s]
    gyro, accel : ndarray, shape (n, 3) for increments, (n + 1, 3) for rates
        Integrals [rad], [m/s] or rates [rad/s], [m/s^2].
    truth : FullTrajectory
        Position, velocity and attitude of the IMU at ``t``.
    """

    kind: Kind
    rate_hz: float
    t: FloatArray
    gyro: FloatArray
    accel: FloatArray
    truth: FullTrajectory


class SimulatedImu(NamedTuple):
    """IMU series with what is true of it.

    Attributes
    ----------
    imu : ImuSeries
        Body axes.
    report : ApplyReport
        True biases by sample, clipping.
    """

    imu: ImuSeries
    report: ApplyReport


def ideal_imu(motion: Motion, rate_hz: float, *, kind: Kind = "increment", earth_rotation: bool = True) -> IdealImu:
    """Ideal IMU output along a motion.

    Parameters
    ----------
    motion : Motion
    rate_hz : float
        Sampling rate.
    kind : {"increment", "rate"}
        Increments are exact integrals of the motion over each interval; rates are samples at the stamps.
    earth_rotation : bool
        See :func:`schuler.simulation.motion.inertial_quantities`.

    Raises
    ------
    InputError
        If the rate is not positive or the motion holds no two samples.
    """
    if not rate_hz > 0.0:
        raise InputError(f"rate_hz: expected a positive rate, got {rate_hz!r}")
    if motion.duration * rate_hz > _MOST:
        raise InputError(
            f"a motion of {motion.duration:g} s at {rate_hz:g} Hz has more than {_MOST:.0e} samples: lower the rate, "
            "or simulate a part"
        )
    n = int(np.floor(motion.duration * rate_hz + 1e-9))
    if n < 2:
        raise InputError(f"a motion of {motion.duration} s holds no two samples at {rate_hz} Hz")
    t = np.arange(n + 1) / rate_hz
    sensed = ideal_increments if kind == "increment" else ideal_rates
    gyro, accel = sensed(motion, t, earth_rotation=earth_rotation)
    return IdealImu(kind, rate_hz, t, gyro, accel, truth(motion, t))


def mounted(ideal: IdealImu, rpy: FloatArray, *, turn_truth: bool = False) -> IdealImu:
    """The same output in the axes of an IMU that is turned in the vehicle.

    Parameters
    ----------
    ideal : IdealImu
        In the vehicle's axes.
    rpy : ndarray, shape (3,)
        Roll, pitch, yaw of the IMU's axes in the vehicle: ``C_vs`` maps its components to the vehicle's. [rad]
    turn_truth : bool
        Also the attitude of the truth: that of the IMU's axes, not of the vehicle's.
    """
    C_vs, true = rotation.dcm_from_rpy(rpy), ideal.truth
    if turn_truth:
        q_es = rotation.quat_multiply(true.q_eb, rotation.quat_from_dcm(C_vs))
        true = FullTrajectory(true.t, true.r_eb_e, true.v_eb_e, q_es)
    # rows times C_vs: each vector times its transpose, from the vehicle's components to the IMU's
    return ideal._replace(gyro=ideal.gyro @ C_vs, accel=ideal.accel @ C_vs, truth=true)


def simulate_imu(
    ideal: IdealImu, errors: ImuErrors, rng: np.random.Generator, *, temperature: FloatArray | float | None = None
) -> SimulatedImu:
    """One realisation of an IMU's output.

    Parameters
    ----------
    ideal : IdealImu
        Computed once for any number of realisations.
    errors : ImuErrors
        See :meth:`ImuErrors.draw`; :meth:`ImuErrors.none` for an ideal IMU.
    rng : numpy.random.Generator
        For the noise.
    temperature : float or ndarray, shape (n,), optional
        [degC]

    Returns
    -------
    SimulatedImu
    """
    dt = 1.0 / ideal.rate_hz
    if ideal.kind == "increment":
        dtheta, dv, report = errors.apply_increments(ideal.gyro, ideal.accel, dt, rng, temperature)
        return SimulatedImu(ImuSeries(ideal.t[1:], dtheta, dv, "increment"), report)
    gyro, accel, report = errors.apply_rates(ideal.gyro, ideal.accel, dt, rng, temperature)
    return SimulatedImu(ImuSeries(ideal.t, gyro, accel, "rate"), report)


def truth(motion: Motion, t: FloatArray) -> FullTrajectory:
    """True trajectory of a motion at times (n,), in pieces so that hours need no more memory than the result."""
    r, v, q = np.empty((len(t), 3)), np.empty((len(t), 3)), np.empty((len(t), 4))
    for first in range(0, len(t), 32_768):
        part = slice(first, first + 32_768)
        s = motion.state(t[part])
        r[part], v[part], q[part] = s.r_eb_e, s.v_eb_e, s.q_eb
    return FullTrajectory(t, r, v, q)


@dataclass(frozen=True, kw_only=True)
class StreamFaults:
    """Faults of a stream.

    Attributes
    ----------
    gaps : tuple of (start, stop)
        Times whose samples are lost. Of increments the motion in them is lost with them. [s]
    repeats : float
        Probability with which a sample holds the values of the one before under its own stamp.
    jitter : float
        1-sigma of stamps about the times they belong to; at most 0.4 sample intervals are added or taken off. [s]
    clock_shift : float
        Added to every stamp. [s]
    """

    gaps: tuple[tuple[float, float], ...] = ()
    repeats: float = 0.0
    jitter: float = 0.0
    clock_shift: float = 0.0

    def __post_init__(self) -> None:
        if not (0.0 <= self.repeats < 1.0 and self.jitter >= 0.0):
            raise InputError(
                f"expected repeats in 0..1 (1 excluded) and jitter >= 0, got {self.repeats}, {self.jitter}"
            )
        for start, stop in self.gaps:
            if not stop > start:
                raise InputError(f"a gap stops after it starts, got {start}..{stop} s")


class FaultyStream(NamedTuple):
    """A log with faults, which rows of the sound one it kept, and which of its own repeat the one before."""

    imu: ImuSeries
    kept: BoolArray
    repeated: BoolArray


def faulty_stream(imu: ImuSeries, faults: StreamFaults, rng: np.random.Generator) -> FaultyStream:
    """A sound log with the faults of its stream.

    Parameters
    ----------
    imu : ImuSeries
    faults : StreamFaults
    rng : numpy.random.Generator

    Raises
    ------
    InputError
        If fewer than two samples are left.
    """
    repeated = rng.uniform(size=len(imu)) < faults.repeats
    shake = rng.standard_normal(len(imu))
    kept = np.ones(len(imu), dtype=bool)
    for start, stop in faults.gaps:
        kept &= ~((imu.t >= start) & (imu.t < stop))
    if kept.sum() < 2:
        raise InputError("the gaps leave no two IMU samples")
    repeated[0] = False
    source = np.maximum.accumulate(np.where(repeated, 0, np.arange(len(imu))))
    t = imu.t + faults.clock_shift
    if faults.jitter:
        limit = 0.4 * imu.interval
        t = t + np.clip(faults.jitter * shake, -limit, limit)
    temperature = None if imu.temperature is None else imu.temperature[kept]
    magnetometer = None if imu.magnetometer is None else imu.magnetometer[source[kept]]
    log = replace(
        imu, t=t[kept], gyro=imu.gyro[source[kept]], accel=imu.accel[source[kept]], temperature=temperature,
        magnetometer=magnetometer,
    )  # fmt: skip
    return FaultyStream(log, kept, repeated[kept])
