"""Shapes in coloured noise by maximum likelihood: generalised least squares for a grid of noise proportions.

The log is averaged to some hundred blocks. Their covariance is that of white noise, flicker and random walk in
proportions from a grid; shape and proportions are chosen together, since a random walk looks like a trend.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from math import isfinite, sqrt

import numpy as np

from schuler.arrays import ArrayLike, FloatArray
from schuler.exceptions import InputError
from schuler.sensors.noise import NoiseModel, RandomWalk, White, flicker

#: Settling times tried, relative to the length of the log.
SETTLING = (0.02, 0.04, 0.08, 0.15, 0.3, 0.6)
_BLOCKS = 120


@dataclass(frozen=True)
class ShapeFit:
    """Coefficient of a shape, its uncertainty, the noise, the logarithm of the likelihood."""

    value: float
    sigma: float
    likelihood: float
    noise: NoiseModel


@lru_cache(maxsize=4)
def whitening_factors(J: int) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Inverse Cholesky factors of the covariance of J block means for p proportions of noise.

    Returns the factors, shape (p, J, J), logarithms of the determinants (p,) and the proportions (p, 3).

    Each kind is scaled to unit Allan variance at sqrt(J) blocks; the proportions (white, flicker, random walk) are
    powers of ten. The random walk starts at zero, and with a constant in the model that is no restriction.
    """
    i = np.arange(J, dtype=np.float64)
    middle = sqrt(J)
    lag = np.abs(i[:, None] - i)
    # flicker as a sum of Gauss-Markov processes, averaged over blocks, from a block's to a hundred logs' time
    pink, taus = np.zeros((J, J)), np.geomspace(0.3, 100.0 * J, max(8, round(2.0 * np.log10(300.0 * J))))
    for tau in taus:
        a = np.exp(-1.0 / tau)
        across = tau**2 * (1.0 - a) ** 2 / a * np.exp(-lag / tau)
        pink += np.where(lag == 0.0, 2.0 * tau - 2.0 * tau**2 * (1.0 - a), across)
    walk = np.minimum(i[:, None], i) + 0.5
    walk[np.diag_indices(J)] = i + 1.0 / 3.0
    parts = [np.eye(J) * middle, pink * (np.pi / np.log(taus[1] / taus[0])) ** -1 / 0.664**2, walk * 3.0 / middle]
    steps = (0.0, *10.0 ** np.arange(-3.0, 3.01, 0.5))
    weights = np.array([(a, 1.0, b) for a in steps for b in steps])
    L = np.linalg.cholesky(np.einsum("pk,kij->pij", weights, np.array(parts)))
    logdet = 2.0 * np.log(np.diagonal(L, axis1=1, axis2=2)).sum(axis=1)
    return np.ascontiguousarray(np.linalg.inv(L)), logdet, weights


def fit_shapes(y: FloatArray, shapes: FloatArray, duration: float) -> tuple[ShapeFit, list[ShapeFit]]:
    """Most likely constant and noise without a shape, and with each column of ``shapes``, shape (J, k)."""
    J = len(y)
    whiten, logdet, weights = whitening_factors(J)
    data = np.column_stack((np.ones(J), (y - y.mean()) / y.std(), shapes))
    white = (whiten.reshape(-1, J) @ data).reshape(len(weights), J, -1)
    gram = white.transpose(0, 2, 1) @ white
    # what is left of the other columns when the constant has been taken out
    left = gram - gram[:, :, :1] * gram[:, :1, :] / gram[:, :1, :1]
    # a noiseless ramp leaves rounding only, which may be negative
    floor = 1e-20 * left[:, 1, 1]
    fits = [_most_likely(left[:, 1, 1], np.zeros_like(logdet), np.ones_like(logdet), 1, y, duration)]
    for k in range(2, data.shape[1]):
        value = left[:, 1, k] / left[:, k, k]
        squares = np.maximum(left[:, 1, 1] - value * left[:, 1, k], floor)
        fits.append(_most_likely(squares, value, left[:, k, k], 2, y, duration))
    return fits[0], fits[1:]


def _most_likely(
    squares: FloatArray, value: FloatArray, information: FloatArray, parameters: int, y: FloatArray, duration: float
) -> ShapeFit:
    """The proportion of noise with the largest likelihood; ``squares`` sums whitened residuals of y over its spread."""
    J, scale = len(y), float(y.std())
    _, logdet, weights = whitening_factors(J)
    likelihood = -0.5 * (J * np.log(squares / J) + logdet)
    k = int(np.argmax(likelihood))
    variance = float(squares[k]) / (J - parameters)
    sigma = scale * sqrt(variance / float(information[k])) if parameters > 1 else 0.0
    root = scale * sqrt(variance)
    return ShapeFit(
        scale * float(value[k]), sigma, float(likelihood[k]), _noise_of_shares(root, weights[k], duration / J, J)
    )


def _noise_of_shares(root: float, weights: FloatArray, dt: float, J: int) -> NoiseModel:
    """The noise that has these shares of Allan variance at sqrt(J) blocks of dt seconds."""
    w, f, r = (root * sqrt(float(share)) for share in weights)
    tau = sqrt(J) * dt
    return White(w * sqrt(tau)) + flicker(f / 0.664, dt, 100.0 * J * dt) + RandomWalk(r * sqrt(3.0 / tau))


def block_means(
    x: ArrayLike, rate_hz: float, temperature: ArrayLike | None = None
) -> tuple[FloatArray, float, FloatArray | None]:
    """Means of equal blocks of x (and temperature), and the time they cover; missing samples are left out of them."""
    values = np.asarray(x, dtype=np.float64)
    if values.ndim != 1 or len(values) < 200:
        raise InputError(f"x: expected one axis with at least 200 samples, got shape {values.shape}")
    if not (isfinite(rate_hz) and rate_hz > 0.0):
        raise InputError(f"rate_hz: expected a positive number, got {rate_hz}")
    J = min(_BLOCKS, len(values) // 2)
    m = len(values) // J
    parts = values[: J * m].reshape(J, m)
    good = np.isfinite(parts)
    if not good.any(axis=1).all():
        k = int(np.flatnonzero(~good.any(axis=1))[0])
        raise InputError(
            f"x: expected some samples in every {m / rate_hz:.1f} s, but all are missing from {k * m / rate_hz:.1f} s "
            "on; cut the log at the gap"
        )
    y = np.sum(np.where(good, parts, 0.0), axis=1) / good.sum(axis=1)
    if np.ptp(y) == 0.0:
        raise InputError(f"x: expected noise, but every sample reads {y[0]:.6g}")
    if temperature is None:
        return y, J * m / rate_hz, None
    T = np.asarray(temperature, dtype=np.float64)
    if T.shape != values.shape or not np.isfinite(T).all():
        raise InputError(
            f"temperature: expected {len(values)} finite numbers, one for each sample, got shape {T.shape}"
        )
    T = T[: J * m].reshape(J, m)
    return y, J * m / rate_hz, np.sum(np.where(good, T, 0.0), axis=1) / good.sum(axis=1)
