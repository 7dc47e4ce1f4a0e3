"""Heading filters with a bias constant, Gauss-Markov or both, the position filter, and the sensor's true bias.

Heading error and biases in SI. The gyroscope's reading is the input, so its noise drives the heading.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from schuler.arrays import FloatArray
from schuler.exceptions import InputError
from schuler.reproduce.flenniken.study.heading.linear import LinearModel


def constant_bias(N: float, *, walk: float = 0.0, sigma_heading: float, sigma_bias: float) -> LinearModel:
    """Heading and a constant bias, or one that walks.

    Parameters
    ----------
    N : float
        Root density of the gyroscope's noise. [rad/s/sqrt(Hz)]
    walk : float
        Root density of the bias's random walk; zero lets the filter fall asleep, which the source's text warns of and
        its equation does (eqs. 4.8, 4.26, 4.35). [rad/s/sqrt(s)]
    sigma_heading, sigma_bias : float
        1-sigma at the start. [rad], [rad/s]

    References
    ----------
    Flenniken (2005), eqs. (4.1)-(4.9) with Q corrected (E8).
    """
    return LinearModel(
        ("heading_rad", "bias_rad_s"),
        np.array([[0.0, -1.0], [0.0, 0.0]]), np.array([[1.0], [0.0]]), np.array([[1.0, 0.0]]),
        np.diag([N**2, walk**2]), np.diag([sigma_heading**2, sigma_bias**2]),
    )  # fmt: skip


def gauss_markov_bias(
    N: float, sigma: float, tau: float, *, sigma_heading: float, sigma_bias: float | None = None
) -> LinearModel:
    """Heading and a Gauss-Markov bias.

    Parameters
    ----------
    N : float
        [rad/s/sqrt(Hz)]
    sigma, tau : float
        Standard deviation [rad/s] and correlation time [s] of the bias.
    sigma_heading : float
        [rad]
    sigma_bias : float, optional
        1-sigma of the bias at the start; that of the process by default. [rad/s]

    References
    ----------
    Flenniken (2005), eqs. (4.10)-(4.18) with Q corrected (E8).
    """
    _check(tau)
    start = sigma if sigma_bias is None else sigma_bias
    return LinearModel(
        ("heading_rad", "bias_rad_s"),
        np.array([[0.0, -1.0], [0.0, -1.0 / tau]]), np.array([[1.0], [0.0]]), np.array([[1.0, 0.0]]),
        np.diag([N**2, 2.0 * sigma**2 / tau]), np.diag([sigma_heading**2, start**2]),
    )  # fmt: skip


def split_bias(
    N: float, sigma: float, tau: float, *, walk: float = 0.0, sigma_heading: float, sigma_constant: float
) -> LinearModel:
    """Heading, a Gauss-Markov bias and a constant one beside it: the source's novelty.

    Parameters
    ----------
    N, sigma, tau, sigma_heading : float
        As of :func:`gauss_markov_bias`.
    walk : float
        Root density of the constant part's random walk. [rad/s/sqrt(s)]
    sigma_constant : float
        1-sigma of the constant part at the start. [rad/s]

    Notes
    -----
    Observable, but the split is weak: after T the constant part is known to ``sigma sqrt(2 tau / T)``. It is the sum
    that is estimated well.

    References
    ----------
    Flenniken (2005), eqs. (4.19)-(4.27) with Q corrected (E8, E9).
    """
    _check(tau)
    A = np.array([[0.0, -1.0, -1.0], [0.0, -1.0 / tau, 0.0], [0.0, 0.0, 0.0]])
    return LinearModel(
        ("heading_rad", "bias_wandering_rad_s", "bias_constant_rad_s"),
        A, np.array([[1.0], [0.0], [0.0]]), np.array([[1.0, 0.0, 0.0]]),
        np.diag([N**2, 2.0 * sigma**2 / tau, walk**2]), np.diag([sigma_heading**2, sigma**2, sigma_constant**2]),
    )  # fmt: skip


def position_filter(
    N: float,
    sigma: float,
    tau: float,
    heading: float,
    *,
    sigma_constant: float,
    sigma_velocity: float,
    sigma_position: float,
    walk: float = 0.0,
    heading_sigma: float = 0.0,
    acceleration: float = 0.0,
) -> LinearModel:
    """Velocity and position in the plane from one forward accelerometer, its biases as of :func:`split_bias`.

    Parameters
    ----------
    N : float
        Root density of the accelerometer's noise. [m/s^2/sqrt(Hz)]
    sigma, tau : float
        Sigma and time constant of the Gauss-Markov bias. [m/s^2], [s]
    heading : float
        Taken for known. [rad]
    sigma_constant, sigma_velocity, sigma_position : float
        1-sigma at the start. [m/s^2], [m/s], [m]
    walk : float
        Random walk of the constant bias. [m/s^2/sqrt(s)]
    heading_sigma, acceleration : float
        1-sigma of a heading error [rad] and the size of the accelerations it turns [m/s^2]: their product is added
        across the track as white noise over one second. Zero as in the source, whose filter then believes its
        velocity across the track to a millimetre a second.

    Returns
    -------
    LinearModel
        States ``v_x, v_y, p_x, p_y, bias wandering, bias constant``; x north, y east; the accelerometer reads m/s^2
        (the source's reads g, hence its factors g).

    References
    ----------
    Flenniken (2005), eqs. (4.28)-(4.36), which the text calls five states (E19).
    """
    _check(tau)
    c, s = np.cos(heading), np.sin(heading)
    A = np.zeros((6, 6))
    A[0, 4:] = -c
    A[1, 4:] = -s
    A[2, 0] = A[3, 1] = 1.0
    A[4, 4] = -1.0 / tau
    B = np.array([[c], [s], [0.0], [0.0], [0.0], [0.0]])
    along, across = np.array([c, s]), np.array([-s, c])
    Q = np.zeros((6, 6))
    Q[:2, :2] = N**2 * np.outer(along, along) + (heading_sigma * acceleration) ** 2 * np.outer(across, across)
    Q[4, 4], Q[5, 5] = 2.0 * sigma**2 / tau, walk**2
    P0 = np.diag(np.square([sigma_velocity, sigma_velocity, sigma_position, sigma_position, sigma, sigma_constant]))
    names = ("v_north_m_s", "v_east_m_s", "p_north_m", "p_east_m", "bias_wandering_m_s2", "bias_constant_m_s2")
    return LinearModel(names, A, B, np.eye(4, 6), Q, P0)


def printed_noise(N: float, sigma: float, tau: float, rate_hz: float, reading: str) -> np.ndarray:
    """Process noise over one sample of the two-state filter as its printed Q can be read (E8). Shape (2, 2).

    Parameters
    ----------
    N, sigma, tau : float
        As of :func:`gauss_markov_bias`.
    rate_hz : float
    reading : {"continuous", "sampled"}
        The printed ``diag(sigma_w^2 / sqrt(fs), 2 fs sigma^2 / tau)`` taken for a power spectral density, or for the
        variance of noise held over a sample; ``sigma_w`` is the noise of a sample.
    """
    printed = np.diag([N**2 * rate_hz / np.sqrt(rate_hz), 2.0 * rate_hz * sigma**2 / tau])
    if reading == "continuous":
        return printed / rate_hz
    if reading == "sampled":
        return printed / rate_hz**2
    raise InputError(f"reading: expected 'continuous' or 'sampled', got {reading!r}")


def _check(tau: float) -> None:
    if not tau > 0.0:
        raise InputError(f"tau: expected a positive correlation time [s], got {tau!r}")


@dataclass(frozen=True)
class BiasTruth:
    """True errors of a sensor: white noise, a wandering bias, a constant one.

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
