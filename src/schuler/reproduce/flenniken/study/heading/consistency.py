"""Is the process noise of a heading filter right: its NEES, with the noise as printed or ours."""

from __future__ import annotations

import numpy as np

from schuler.reproduce.flenniken.study.heading.comparison import FIX_PERIOD_S, FIX_SIGMA
from schuler.reproduce.flenniken.study.heading.filters import gauss_markov_bias, printed_noise
from schuler.reproduce.flenniken.study.heading.runs import run_filter
from schuler.reproduce.flenniken.study.heading.truth import BiasTruth, gyro_readings
from schuler.sensors.spec import TriadSpec


def heading_nees(
    gyro: TriadSpec,
    *,
    rate_hz: float = 10.0,
    reading: str | None = None,
    seconds: float = 60.0,
    runs: int = 500,
    seed: int = 0,
) -> float:
    """Mean NEES per state of the two-state filter with a Gauss-Markov bias at the end of some time with fixes.

    Parameters
    ----------
    gyro : TriadSpec
        Its noise and in-run bias are both truth and what the filter believes.
    rate_hz : float
    reading : {"continuous", "sampled"}, optional
        How the printed process noise is read, see :func:`.filters.printed_noise`; ours by default.
    seconds : float
        [s]
    runs, seed : int

    Returns
    -------
    float
        One within ``sqrt(1 / runs)`` if the filter knows how far off it is.

    References
    ----------
    Flenniken (2005), eq. (4.17), against which E8 of its digest.
    """
    N, sigma, tau = gyro.random_walk, gyro.in_run_bias, gyro.in_run_time
    step, count = 1.0 / rate_hz, round(seconds * rate_hz)
    t = step * np.arange(1, count + 1)
    fix = np.abs(t / FIX_PERIOD_S - np.round(t / FIX_PERIOD_S)) < 0.25 * step
    rng = np.random.default_rng(seed)
    increments, bias = gyro_readings(BiasTruth(N, sigma, tau), step, count, runs, rng)
    heading = FIX_SIGMA * rng.standard_normal(runs)  # the filter starts at zero
    fixes = heading + FIX_SIGMA * rng.standard_normal((count, 1, runs))
    model = gauss_markov_bias(N, sigma, tau, sigma_heading=FIX_SIGMA)
    noise = None if reading is None else printed_noise(N, sigma, tau, rate_hz, reading)
    done = run_filter(model, increments, step, fixes, np.array([[FIX_SIGMA**2]]), fix, noise=noise)
    error = done.estimate[-1] - np.stack((heading, bias[-1]))
    return float(np.mean(np.einsum("ir,ij,jr->r", error, np.linalg.inv(done.P[-1]), error)) / 2.0)
