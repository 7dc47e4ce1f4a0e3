"""Measurements at rest: zero velocity, zero rotation, gravity, Earth rate."""

from __future__ import annotations

import numpy as np

from schuler.arrays import FloatArray
from schuler.exceptions import InputError
from schuler.filtering.measurements import (
    EARTH_RATE,
    GRAVITY,
    GRAVITY_VECTOR,
    ZERO_RATE,
    MeasurementSchedule,
    gate_threshold,
    zero_velocity,
)
from schuler.recording.series import ImuSeries
from schuler.standstill.stationarity import StaticIntervals


def rest_times(intervals: StaticIntervals, rate_hz: float) -> FloatArray:
    """Times within intervals at rest, at a given rate from the start of each. Shape (m,). [s]"""
    if not rate_hz > 0.0:
        raise InputError(f"rate_hz: expected a positive number, got {rate_hz!r}")
    parts = [np.arange(a, b + 1e-9, 1.0 / rate_hz) for a, b in zip(intervals.start, intervals.stop, strict=True)]
    return np.concatenate(parts) if parts else np.empty(0)


def zero_velocities(
    intervals: StaticIntervals, *, sigma: float = 0.02, rate_hz: float = 2.0, gate: float | None = 0.9999
) -> MeasurementSchedule:
    """Zero-velocity updates while at rest.

    Parameters
    ----------
    intervals : StaticIntervals
        Intervals of :func:`schuler.standstill.stationarity.static_intervals`.
    sigma : float
        1-sigma velocity of the vehicle at rest, vibration included. [m/s]
    rate_hz : float
        How often. [Hz]
    gate : float, optional
        Probability with which a correct measurement passes; a detector that errs is caught here.

    References
    ----------
    Yaman (2017), section 4.5, eqs. (4-36)-(4-39); Groves (2013), section 15.3.
    """
    if not sigma > 0.0:
        raise InputError(f"sigma: expected a positive number, got {sigma!r}")
    return zero_velocity(rest_times(intervals, rate_hz), sigma, gate=gate)


def zero_rates(
    imu: ImuSeries,
    intervals: StaticIntervals,
    *,
    sigma_noise: float,
    sigma: float = 0.0,
    block_s: float = 1.0,
    gate: float | None = 0.9999,
) -> MeasurementSchedule:
    """Zero-rotation updates: means of the raw angular rate over blocks at rest.

    Parameters
    ----------
    imu : ImuSeries
    intervals : StaticIntervals
        Rests of this log.
    sigma_noise : float
        Root density N of the gyroscopes: a mean over T has ``N / sqrt(T)``. [rad/s/sqrt(Hz)]
    sigma : float
        1-sigma rotation of the vehicle in the mean over a block. [rad/s]
    block_s : float
        Length of a block. [s]
    gate : float, optional
        Probability with which a correct measurement passes.

    Returns
    -------
    MeasurementSchedule
        Each at the end of its block, when a live filter has it too. Rests shorter than a block give none.

    Raises
    ------
    InputError
        If both sigmas are zero, or the intervals are of another log.

    Notes
    -----
    The noise of a block has also driven the attitude during it; that correlation, by which heading would not
    change at rest, is left out: conservative for heading, right for the biases.
    """
    t, _, rate, length = _blocks(imu, intervals, block_s, sigma_noise, sigma)
    return MeasurementSchedule.of(ZERO_RATE, t, rate, sigma_noise**2 / length + sigma**2, gate=gate_threshold(gate, 3))


def gravities(
    imu: ImuSeries,
    intervals: StaticIntervals,
    *,
    sigma_noise: float,
    sigma: float = 0.0,
    vector: bool = False,
    block_s: float = 1.0,
    gate: float | None = 0.9999,
) -> MeasurementSchedule:
    """Gravity at rest: means of the raw specific force over blocks are as large as gravity, or are gravity.

    Parameters
    ----------
    imu, intervals, block_s, gate
        See :func:`zero_rates`.
    sigma_noise : float
        Root density N of the accelerometers. [m/s^2/sqrt(Hz)]
    sigma : float
        1-sigma acceleration of the vehicle in the mean over a block. [m/s^2]
    vector : bool
        North, east and down against the attitude; False: the magnitude only, whatever the attitude.

    Returns
    -------
    MeasurementSchedule
        Each at the end of its block. Gravity is that of the ellipsoid, which the filter navigates with.

    Notes
    -----
    **Not together with zero-velocity updates.** What the velocity gains from one update to the next is the mean
    specific force and gravity between them: these updates compare all three components of the same readings with
    gravity already. Once more, and the filter takes their noise for less than it is.

    Without them the noise of a block is in the velocity too, which satellites see. That correlation is left out; it
    costs little as long as velocities are measured with more than ``sigma_noise sqrt(block_s)``.

    References
    ----------
    Yaman (2017), eqs. (4-44)-(4-50), magnitude; (4-59)-(4-63), vector, all columns kept.
    """
    t, force, rate, length = _blocks(imu, intervals, block_s, sigma_noise, sigma)
    return MeasurementSchedule.of(
        GRAVITY_VECTOR if vector else GRAVITY, t, np.hstack((force, rate)), sigma_noise**2 / length + sigma**2,
        gate=gate_threshold(gate, 3 if vector else 1),
    )  # fmt: skip


def earth_rates(
    imu: ImuSeries,
    intervals: StaticIntervals,
    *,
    sigma_noise: float,
    sigma: float = 0.0,
    block_s: float = 1.0,
    gate: float | None = 0.9999,
) -> MeasurementSchedule:
    """Earth rate at rest: means of the raw rate over blocks, along the measured vertical, are the Earth's.

    Parameters
    ----------
    imu, intervals, sigma_noise, sigma, block_s, gate
        See :func:`zero_rates`; ``sigma`` is the turning about the vertical.

    Returns
    -------
    MeasurementSchedule
        Each at the end of its block.

    Notes
    -----
    The vertical component of :func:`zero_rates`, **not together with them**. It needs neither attitude nor heading, and
    leaves alone what a vehicle on its springs does about the horizontal axes. The noise of a block has driven the
    heading too; that correlation is left out, as there.

    References
    ----------
    Yaman (2017), eqs. (4-51)-(4-57): there the magnitude, whose noise and Earth rate go into the g-sensitivity.
    """
    t, force, rate, length = _blocks(imu, intervals, block_s, sigma_noise, sigma)
    return MeasurementSchedule.of(
        EARTH_RATE, t, np.hstack((force, rate)), sigma_noise**2 / length + sigma**2, gate=gate_threshold(gate, 1)
    )


def _blocks(
    imu: ImuSeries, intervals: StaticIntervals, block_s: float, sigma_noise: float, sigma: float
) -> tuple[FloatArray, FloatArray, FloatArray, float]:
    """Ends of whole blocks at rest, means of specific force and rate in them, shapes (n,), (n, 3), (n, 3); length."""
    if not (block_s > 0.0 and sigma_noise >= 0.0 and sigma >= 0.0 and sigma_noise + sigma > 0.0):
        raise InputError(
            f"expected block_s > 0 and a positive sigma or sigma_noise, got {block_s!r}, {sigma!r}, {sigma_noise!r}"
        )
    if len(imu) != len(intervals.mask):
        raise InputError(
            f"imu: expected the log of {len(intervals.mask)} samples the intervals come from, got {len(imu)}"
        )
    rates = imu.rates()
    W = max(1, round(block_s * rates.rate_hz))
    first = np.array([k for a, b in intervals.index for k in range(int(a), int(b) - W + 1, W)], dtype=np.int64)
    force, rate = (
        np.array([x[k : k + W].mean(axis=0) for k in first]).reshape(-1, 3) for x in (rates.accel, rates.gyro)
    )
    return rates.t[first + W - 1], force, rate, W / rates.rate_hz
