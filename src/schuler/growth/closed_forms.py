"""Closed forms of error growth on a platform at rest: what each error of a sensor makes of heading, velocity, position.

Variances add over independent causes. ``integrals`` counts how often an error is integrated: a gyroscope's once into
heading; an accelerometer's once into velocity and twice into position; a gyroscope's twice into velocity and three
times into position where its tilt turns gravity, then times ``g``.
"""

from __future__ import annotations

from math import factorial

import numpy as np

from schuler.arrays import ArrayLike, FloatArray
from schuler.exceptions import InputError
from schuler.growth.integrals import Start, integral_variance
from schuler.units import G0


def white(integrals: int, t: ArrayLike, N: float) -> FloatArray:
    """Variance of white noise integrated n times: ``N^2 t^(2n - 1) / ((2n - 1) ((n - 1)!)^2)``.

    Parameters
    ----------
    integrals : int
        At least 1.
    t : array_like
        [s]
    N : float
        Root density, two-sided. [unit/sqrt(Hz)]

    Notes
    -----
    Exact for continuous noise at any time: t, t^3/3, t^5/20. Sampled noise that is summed instead of integrated is
    lower by terms of order ``step / t``, see :func:`white_sampled`.

    References
    ----------
    Flenniken (2005), eqs. (3.8), (3.18), (3.28).
    """
    if integrals < 1:
        raise InputError(f"integrals: expected at least one, white noise itself has no variance; got {integrals!r}")
    n = integrals
    return np.asarray(N**2 * _positive(t) ** (2 * n - 1) / ((2 * n - 1) * factorial(n - 1) ** 2))


def white_sampled(t: ArrayLike, step: float, N: float) -> FloatArray:
    """Variance of position from white samples held over each step, exact: ``k^3 / 3 - k / 12`` steps.

    Parameters
    ----------
    t : array_like
        Multiples of ``step``. [s]
    step : float
        [s]
    N : float
        [m/s^2/sqrt(Hz)]

    References
    ----------
    Flenniken (2005), eq. (3.27), whose sum is shifted by one and then holds for Euler's rule only with
    ``- k^2 / 2 + k / 6``.
    """
    k = np.round(_positive(t) / step)
    return np.asarray(step**3 * N**2 * (k**3 / 3.0 - k / 12.0))


def random_walk(integrals: int, t: ArrayLike, K: float) -> FloatArray:
    """Variance of a random walk integrated n times: one integral more than :func:`white`. [unit/sqrt(s)]"""
    return white(integrals + 1, t, K)


def constant(integrals: int, t: ArrayLike, value: float) -> FloatArray:
    """What a constant makes when integrated n times: ``value t^n / n!``; a 1-sigma value gives a 1-sigma error."""
    return np.asarray(value * _positive(t) ** integrals / factorial(integrals))


def gauss_markov(integrals: int, t: ArrayLike, sigma: float, tau: float, start: Start = "stationary") -> FloatArray:
    """Variance of a Gauss-Markov bias integrated n times, see :func:`.integrals.integral_variance`."""
    return integral_variance(integrals, t, sigma, tau, start)


def lateral_white(t: ArrayLike, N_a: float, N_g: float) -> tuple[FloatArray, FloatArray]:
    """Variances of velocity and position across the track: accelerometer noise turned by a wandering heading.

    Parameters
    ----------
    t : array_like
        [s]
    N_a, N_g : float
        Root densities. [m/s^2/sqrt(Hz)], [rad/s/sqrt(Hz)]

    Returns
    -------
    velocity, position : ndarray
        ``N_a^2 N_g^2 t^2 / 2`` and ``t^4 / 12`` of it. [m^2/s^2], [m^2]

    Notes
    -----
    For headings below a third of a radian; beyond, :func:`lateral_white_large`. At rest the accelerometer senses
    nothing but noise; with biases use :func:`lateral`.

    References
    ----------
    Flenniken (2005), eq. (3.41), and (3.51) with 1/12 for the printed 1/8: increments of velocity become more uncertain
    with time.
    """
    t = _positive(t)
    return np.asarray(0.5 * (N_a * N_g * t) ** 2), np.asarray((N_a * N_g * t**2) ** 2 / 12.0)


def lateral_white_sampled(t: ArrayLike, step: float, N_a: float, N_g: float) -> tuple[FloatArray, FloatArray]:
    """The same for samples held over each step, exact: ``k (k - 1) / 2`` and ``k (k - 1)(2 k^2 - 2 k - 1) / 24``."""
    k = np.round(_positive(t) / step)
    s = (N_a * N_g) ** 2
    return (
        np.asarray(step**2 * s * k * (k - 1.0) / 2.0),
        np.asarray(step**4 * s * k * (k - 1.0) * (2.0 * k**2 - 2.0 * k - 1.0) / 24.0),
    )


def lateral_white_large(t: ArrayLike, N_a: float, N_g: float) -> tuple[FloatArray, FloatArray]:
    """Variances of velocity across and along the track for any heading error.

    Returns
    -------
    across, along : ndarray
        ``N_a^2`` times the integrals of ``(1 -+ exp(-2 N_g^2 s)) / 2``. [m^2/s^2]
    """
    t, q = _positive(t), 2.0 * N_g**2
    mean = np.where(q * t > 0.0, -np.expm1(-q * t) / np.where(q > 0.0, q, 1.0), t)
    return np.asarray(0.5 * N_a**2 * (t - mean)), np.asarray(0.5 * N_a**2 * (t + mean))


def lateral(
    t: float, accel: tuple[float, float, float], gyro: tuple[float, float, float], *, nodes: int = 60
) -> tuple[float, float]:
    """Variances of velocity and position across the track with noise and Gauss-Markov biases in both sensors.

    Parameters
    ----------
    t : float
        [s]
    accel, gyro : (N, sigma, tau)
        Root density, standard deviation and correlation time, stationary start. SI, [s]
    nodes : int
        Nodes of the quadrature in each direction.

    Returns
    -------
    velocity, position : float
        [m^2/s^2], [m^2]

    Notes
    -----
    ``V = int a psi``, ``P = int (t - s) a psi`` with independent a and psi: the covariance of the product is the
    product of the covariances. For small headings. The double integral is taken over a triangle, on which it is
    smooth.
    """
    N_a, s_a, tau_a = accel
    N_g, s_g, tau_g = gyro
    x, w = np.polynomial.legendre.leggauss(nodes)
    u, w = 0.5 * (x + 1.0), 0.5 * w

    def heading(low: FloatArray, high: FloatArray) -> FloatArray:
        wander = 2.0 * low - tau_g * (
            1.0 - np.exp(-low / tau_g) - np.exp(-high / tau_g) + np.exp(-(high - low) / tau_g)
        )  # fmt: skip
        return np.asarray(N_g**2 * low + s_g**2 * tau_g * wander)

    s = t * u
    diagonal = heading(s, s)
    velocity = N_a**2 * t * float(w @ diagonal)
    position = N_a**2 * t * float(w @ (diagonal * (t - s) ** 2))
    # later time s, earlier time s v: both triangles are equal
    early = s[:, None] * u[None, :]
    both = np.exp(-(s[:, None] - early) / tau_a) * heading(early, np.broadcast_to(s[:, None], early.shape))
    weight = 2.0 * s_a**2 * t * w[:, None] * s[:, None] * w[None, :]
    velocity += float(np.sum(weight * both))
    position += float(np.sum(weight * both * (t - s[:, None]) * (t - early)))
    return velocity, position


def second_order_vertical(t: ArrayLike, sigma_bias: float, gravity: float = G0) -> FloatArray:
    """Mean vertical position error from tilts, second order: ``- g sigma^2 t^4 / 12``.

    The cause is constant gyro biases of 1-sigma ``sigma`` about both horizontal axes. Valid while t is short against
    the bias's correlation time. [m], up positive
    """
    return np.asarray(-gravity * sigma_bias**2 * _positive(t) ** 4 / 12.0)


def _positive(t: ArrayLike) -> FloatArray:
    times = np.asarray(t, dtype=np.float64)
    if not (np.all(np.isfinite(times)) and np.all(times >= 0.0)):
        raise InputError("t: expected finite times since the start, zero or positive [s]")
    return times
