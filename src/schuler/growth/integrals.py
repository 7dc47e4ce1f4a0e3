"""Integrals of a Gauss-Markov process: variances that are exact at any time.

``b`` has standard deviation ``sigma`` and correlation time ``tau``; I1, I2, I3 are its first, second and third integral
from time zero. From a stationary start b is as uncertain at zero as later; from a zero start it has just been
calibrated out.
"""

from __future__ import annotations

from math import factorial
from typing import Literal, TypeAlias

import numpy as np

from schuler.arrays import ArrayLike, FloatArray
from schuler.exceptions import InputError

Start: TypeAlias = Literal["stationary", "zero"]

_TERMS = 26  # of the series below z = 1: the next term is below 1e-27


def integral_variance(order: int, t: ArrayLike, sigma: float, tau: float, start: Start = "stationary") -> FloatArray:
    """Variance of the n-th integral.

    Parameters
    ----------
    order : {0, 1, 2, 3}
        0 is the process itself.
    t : array_like
        Time since the start. [s]
    sigma : float
        [unit]
    tau : float
        [s]
    start : {"stationary", "zero"}

    Returns
    -------
    ndarray
        Shape of ``t``. [(unit s^order)^2]

    Notes
    -----
    Valid for all times. The closed forms cancel for short ones, where a series takes their place: relative error below
    1e-12 everywhere.

    References
    ----------
    Not in Flenniken (2005), which leaves these integrals as future work; derivation in docs/theory/growth.md.
    """
    if order not in (0, 1, 2, 3):
        raise InputError(f"order: expected 0, 1, 2 or 3 integrals, got {order!r}")
    t = _times(t, sigma, tau)
    z = t / tau
    scale = sigma**2 * tau ** (2 * order)
    if order == 0:
        value = np.ones_like(z)
    else:
        small, large = np.minimum(z, 1.0), np.maximum(z, 1.0)
        value = np.where(z < 1.0, _series(order, small), _closed(order, large))
    if start == "zero":
        value = _from_zero(order, z, value)
    elif start != "stationary":
        raise InputError(f"start: expected 'stationary' or 'zero', got {start!r}")
    return np.asarray(scale * value)


def _closed(order: int, z: FloatArray) -> FloatArray:
    e = np.exp(-z)
    if order == 1:
        return 2.0 * (z - 1.0 + e)
    if order == 2:
        return 2.0 * (z**3 / 3.0 - z**2 / 2.0 + 1.0 - (1.0 + z) * e)
    return z**5 / 10.0 - z**4 / 4.0 + z**3 / 3.0 - 2.0 + (z**2 + 2.0 * z + 2.0) * e


def _series(order: int, z: FloatArray) -> FloatArray:
    if order == 1:
        return np.asarray(2.0 * sum((-z) ** k / factorial(k) for k in range(2, _TERMS)))
    if order == 2:
        return np.asarray(2.0 * sum((k - 1) * (-z) ** k / factorial(k) for k in range(4, _TERMS)))
    terms = (
        (-z) ** k * (1.0 / factorial(k - 2) - 2.0 / factorial(k - 1) + 2.0 / factorial(k)) for k in range(6, _TERMS)
    )
    return np.asarray(sum(terms))


def _from_zero(order: int, z: FloatArray, value: FloatArray) -> FloatArray:
    """Less what the bias at the start contributes: the square of the integral of ``exp(-s / tau)``."""
    tiny = z < 0.5
    x = np.where(tiny, 1.0, z)
    e = np.exp(-x)
    h = {0: e, 1: 1.0 - e, 2: x - 1.0 + e, 3: 0.5 * x**2 - x + 1.0 - e}[order]
    # below z = 0.5 the two nearly cancel: leading terms of a random walk of density 2 sigma^2 / tau
    lead = {0: (2.0, 0), 1: (2.0 / 3.0, 1), 2: (0.1, 2), 3: (2.0 / 252.0, 3)}[order]
    n = 2 * lead[1] + 1
    walk = lead[0] * z**n * _decay(order, z)
    return np.where(tiny, walk, value - h**2)


def _decay(order: int, z: FloatArray) -> FloatArray:
    """Ratio of the zero-start variance to that of a random walk, by quadrature of its kernel (smooth, z < 0.5)."""
    x, w = np.polynomial.legendre.leggauss(8)
    s = 0.5 * (x + 1.0)
    u = z[..., None] * s if np.ndim(z) else np.asarray(z) * s
    # response of the n-th integral to an impulse u ago, over u^n / n!
    if order == 0:
        ratio = np.exp(-u)
    else:
        ratio = np.asarray(sum(factorial(order) * (-u) ** k / factorial(k + order) for k in range(18)))
    power = (2 * order + 1) * s ** (2 * order)
    return np.asarray(np.sum(0.5 * w * power * ratio**2, axis=-1))


def _times(t: ArrayLike, sigma: float, tau: float) -> FloatArray:
    times = np.asarray(t, dtype=np.float64)
    if not (np.all(np.isfinite(times)) and np.all(times >= 0.0)):
        raise InputError("t: expected finite times since the start, zero or positive [s]")
    if not (sigma >= 0.0 and tau > 0.0):
        raise InputError(f"expected sigma >= 0 and tau > 0 s, got {sigma!r} and {tau!r}")
    return times
