"""What rest says: no velocity, and no rotation but the Earth's."""

from __future__ import annotations

import numpy as np

from schuler.arrays import FloatArray
from schuler.characterisation.stationarity import StaticIntervals
from schuler.exceptions import InputError
from schuler.filtering.measurements import ZERO_RATE, MeasurementSchedule, gate_threshold, zero_velocity
from schuler.recording.series import ImuSeries


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
        Of :func:`schuler.characterisation.stationarity.static_intervals`.
    sigma : float
        1-sigma: what the vehicle may still move, vibration included. [m/s]
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
        Of this log.
    sigma_noise : float
        Root density N of the gyroscopes: a mean over T has ``N / sqrt(T)``. [rad/s/sqrt(Hz)]
    sigma : float
        What the vehicle may still rotate, 1-sigma. [rad/s]
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
        If nothing says how well the rate is known, or the intervals are of another log.

    Notes
    -----
    The noise of a block has also driven the attitude during it; that correlation, which would tell the filter that
    heading does not change at rest, is left out: conservative for heading, right for the biases.
    """
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
    times, means, variance = [], [], []
    for a, b in intervals.index:
        for first in range(int(a), int(b) - W + 1, W):
            times.append(rates.t[first + W - 1])
            means.append(rates.gyro[first : first + W].mean(axis=0))
            variance.append(sigma_noise**2 * rates.rate_hz / W + sigma**2)
    if not times:
        return MeasurementSchedule.empty()
    return MeasurementSchedule.of(
        ZERO_RATE, np.array(times), np.array(means), np.array(variance), gate=gate_threshold(gate, 3)
    )
