"""The six-state position filter through an outage."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from schuler.arrays import FloatArray
from schuler.reproduce.flenniken.study.heading.filters import position_filter
from schuler.reproduce.flenniken.study.heading.runs import FilterRuns, run_filter
from schuler.reproduce.flenniken.study.heading.truth import BiasTruth, gyro_readings


@dataclass(frozen=True)
class PositionOutage:
    """Errors of the six-state filter, all runs.

    Attributes
    ----------
    run : FilterRuns
    error : ndarray, shape (k, 5, runs)
        Velocity, position [m/s], [m] north and east, and the sum of the biases [m/s^2], estimate minus truth.
    start_s : float
        Of the outage. [s]
    """

    run: FilterRuns
    error: FloatArray
    start_s: float

    @property
    def rms(self) -> FloatArray:
        """Over the runs. Shape (k, 5)."""
        return np.asarray(np.sqrt(np.mean(self.error**2, axis=2)))


def position_outage(
    truth: BiasTruth,
    *,
    heading: float = 0.6,
    sigma_velocity: float = 0.05,
    sigma_position: float = 1.0,
    sigma_constant: float = 0.2,
    rate_hz: float = 10.0,
    start_s: float = 300.0,
    outage_s: float = 60.0,
    runs: int = 1000,
    seed: int = 0,
) -> PositionOutage:
    """Monte Carlo of the six-state filter at rest: velocity and position fixes each second, then none.

    Parameters
    ----------
    truth : BiasTruth
        Of the accelerometer. [m/s^2]
    heading : float
        Known to the filter. [rad]
    sigma_velocity, sigma_position : float
        1-sigma of a fix. [m/s], [m]
    sigma_constant : float
        What the filter believes of the constant bias at first. [m/s^2]
    rate_hz, start_s, outage_s : float
    runs, seed : int

    References
    ----------
    Flenniken (2005), section 4.6, which has no numbers; separate sigmas for velocity and position, the source has one.
    """
    model = position_filter(
        truth.N, truth.sigma, truth.tau, heading, sigma_constant=sigma_constant, sigma_velocity=sigma_velocity,
        sigma_position=sigma_position,
    )  # fmt: skip
    step, count = 1.0 / rate_hz, round((start_s + outage_s) * rate_hz)
    rng = np.random.default_rng(seed)
    increments, bias = gyro_readings(truth, step, count, runs, rng)
    sigma = np.array([sigma_velocity, sigma_velocity, sigma_position, sigma_position])
    fixes = sigma[:, None] * rng.standard_normal((count, 4, runs))
    t = step * np.arange(1, count + 1)
    fix = (np.abs(t - np.round(t)) < 0.25 * step) & (t <= start_s + 1e-9)
    done = run_filter(model, increments, step, fixes, np.diag(sigma**2), fix)
    total = done.estimate[:, 4] + done.estimate[:, 5] - bias
    return PositionOutage(done, np.concatenate((done.estimate[:, :4], total[:, None]), axis=1), start_s)
