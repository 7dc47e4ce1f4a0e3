"""What a sensor reads whose bias wanders: integrals over each sample, with the bias at its end."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from schuler.arrays import FloatArray
from schuler.exceptions import InputError
from schuler.reproduce.flenniken.study.heading.filters import gauss_markov_bias


@dataclass(frozen=True)
class BiasTruth:
    """What is true of a sensor: white noise, a wandering bias, a constant one.

    Attributes
    ----------
    N : float
        Root density. [unit/sqrt(Hz)]
    sigma, tau : float
        Gauss-Markov bias, stationary from the start; zero sigma for none. [unit], [s]
    constant : float
        [unit]
    """

    N: float
    sigma: float = 0.0
    tau: float = 1.0
    constant: float = 0.0


def gyro_readings(
    truth: BiasTruth, step: float, count: int, runs: int, rng: np.random.Generator
) -> tuple[FloatArray, FloatArray]:
    """Readings of a sensor at rest, exact over each sample.

    Parameters
    ----------
    truth : BiasTruth
    step : float
        [s]
    count, runs : int
    rng : numpy.random.Generator

    Returns
    -------
    increments : ndarray, shape (count, runs)
        Integral of the reading over each sample. [unit*s]
    bias : ndarray, shape (count, runs)
        True bias, constant part included, at the end of each. [unit]

    Notes
    -----
    The bias and its integral over a sample are drawn jointly from their exact covariance, so that the reading is that
    of a continuous process and not of one held over the sample.
    """
    if not (step > 0.0 and count > 0 and runs > 0):
        raise InputError(f"expected positive step, count and runs, got {step!r}, {count!r}, {runs!r}")
    white = truth.N * np.sqrt(step) * rng.standard_normal((count, runs))
    if truth.sigma == 0.0:
        return white + truth.constant * step, np.full((count, runs), truth.constant)
    # the two-state model has -bias in the heading: its noise is that of the integral with the sign turned
    model = gauss_markov_bias(0.0, truth.sigma, truth.tau, sigma_heading=0.0).discrete(step)
    root = np.linalg.cholesky(model.Qd + np.diag([1e-300, 0.0]))
    e = model.Phi[1, 1]
    b = truth.sigma * rng.standard_normal(runs)
    increments, bias = np.empty((count, runs)), np.empty((count, runs))
    for k in range(count):
        w = root @ rng.standard_normal((2, runs))
        increments[k] = -model.Phi[0, 1] * b - w[0]
        b = e * b + w[1]
        bias[k] = b
    return increments + white + truth.constant * step, bias + truth.constant
