"""Dependence of the overlapping differences of an Allan variance on each other, for a given noise.

The differences are stationary and normal, and their autocovariance decides how many independent ones they are worth. It
is a combination of values of the *generalised covariance* G(t) of the integrated signal, which every noise has even
where the signal itself has no variance. If the integral is averaged over a window first (modified variance), minus the
second difference of s(t) over the window, with s'' = -G, takes the place of G.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from math import comb, factorial
from typing import TypeAlias

import numpy as np

from schuler.arrays import FloatArray
from schuler.sensors.noise import GaussMarkov, Process, Ramp, RandomWalk, White, terms_of

_ALL_LAGS = 300  # up to here every lag is summed, above a graded selection
_FAR = 2000.0  # samples; lags beyond no longer feel the window of one sample

#: Strength and kind of each part of a noise: the exponent of a power law of unit strength, or a process.
Mixture: TypeAlias = Sequence[tuple[float, int | Process]]


@dataclass(frozen=True, slots=True)
class Differences:
    """Which differences a variance is the mean square of.

    Attributes
    ----------
    order : int
        2 for Allan, 3 for Hadamard (of the integral).
    m : int
        Averaging time in samples.
    n : int
        Samples of the signal.
    overlapping : bool
        Starts at every sample, or only at every m-th.
    modified : bool
        The integral is averaged over m samples first.
    """

    order: int
    m: int
    n: int
    overlapping: bool = True
    modified: bool = False

    @property
    def stride(self) -> int:
        """Distance between starts. [samples]"""
        return 1 if self.overlapping else self.m

    @property
    def count(self) -> int:
        """Number of differences."""
        length = (self.order + self.modified) * self.m - self.modified
        return max(0, (self.n - length) // self.stride + 1)


def power_law_covariance(alpha: int, t: FloatArray, window: float, far: bool) -> FloatArray:
    """G of pure noise ``S(f) ~ f**alpha`` of the rate-like signal, of unit strength.

    Parameters
    ----------
    alpha : int
        2 to -4.
    t : ndarray
        Lags. [samples]
    window : float
        Samples the integral is averaged over: 1, or m for the modified variance.
    far : bool
        Take the limit for lags much longer than the window. It loses no digits, but differs by a polynomial the
        differences remove, so all lags of one sum must use the same form.

    References
    ----------
    Greenhall and Riley, "Uncertainty of stability statistics based on finite differences", PTTI 2003: their s_x.
    """
    if far and alpha <= 0:
        return (3 - alpha) * (2 - alpha) * _s_w(alpha + 2, t)
    near = (2.0 * _s_w(alpha, t) - _s_w(alpha, t - window) - _s_w(alpha, t + window)) / window**2
    if far and alpha == 1:
        return np.where(np.abs(t) < 1e4, near, -2.0 * np.log(np.maximum(np.abs(t), 1.0)) - 3.0)
    return np.asarray(near)


def _s_w(alpha: int, t: FloatArray) -> FloatArray:
    t = np.abs(t)
    sign = 1.0 if alpha in (1, 0, -3, -4) else -1.0
    if alpha % 2 == 0:
        return np.asarray(sign * t ** (3 - alpha))
    return np.asarray(sign * t ** (3 - alpha) * np.log(np.where(t > 0.0, t, 1.0)))


def has_covariance(process: Process) -> bool:
    """Whether the generalised covariance of a process is known here; else only its local slope can be used."""
    return all(isinstance(term, White | RandomWalk | GaussMarkov | Ramp) for term in terms_of(process))


def process_covariance(process: Process, t: FloatArray, window: float) -> FloatArray:
    """G of a single :func:`known` process at lags ``t``, averaged over ``window`` (0: not at all), both in seconds.

    Returns
    -------
    ndarray
        [x^2 s^2]. Zero for a ramp, whose differences do not vary along the record.
    """
    if window == 0.0:
        return _g(process, np.abs(t))
    s = [_s(process, np.abs(u)) for u in (t, t - window, t + window)]
    return np.asarray((2.0 * s[0] - s[1] - s[2]) / window**2)


def _g(process: Process, t: FloatArray) -> FloatArray:
    if isinstance(process, White):
        return -0.5 * process.N**2 * t
    if isinstance(process, RandomWalk):
        return np.asarray(process.K**2 / 12.0 * t**3)
    if isinstance(process, GaussMarkov):
        return -((process.sigma * process.tau) ** 2) * exp_tail(t / process.tau, 2)
    return np.zeros_like(t)


def _s(process: Process, t: FloatArray) -> FloatArray:
    if isinstance(process, White):
        return np.asarray(process.N**2 / 12.0 * t**3)
    if isinstance(process, RandomWalk):
        return np.asarray(-(process.K**2) / 240.0 * t**5)
    if isinstance(process, GaussMarkov):
        # up to z^3/6 - z^2/2 + ..., less the even z^2, which the differences remove
        z = t / process.tau
        return process.sigma**2 * process.tau**4 * (exp_tail(z, 4) + z**3 / 3.0)
    return np.zeros_like(t)


def exp_tail(z: FloatArray, order: int) -> FloatArray:
    """``exp(-z)`` less the first ``order`` (2, 3 or 4) terms of its power series, without cancellation; z >= 0."""
    small = z < (0.03 if order == 2 else 0.5)
    closed = np.expm1(-z) + z
    if order > 2:
        closed = closed - z**2 / 2.0
    if order > 3:
        closed = closed + z**3 / 6.0
    if not np.any(small):
        return np.asarray(closed)
    u = z[small]
    series = np.ones_like(u)
    for k in range(order + (6 if order == 2 else 12), order, -1):
        series = 1.0 - u / k * series
    closed[small] = (-u) ** order / factorial(order) * series
    return np.asarray(closed)


@lru_cache(maxsize=512)
def lags(d: Differences) -> tuple[FloatArray, FloatArray]:
    """Lags between starts [samples] and how many ordered pairs of differences each of them stands for.

    All lags where they are few. Else the sum over lags is a trapezoid rule on a grid that is fine near the multiples of
    m, where the autocovariance has its corners.
    """
    M, m = d.count, d.m
    if not d.overlapping:
        k = np.arange(min(M, 64), dtype=np.float64)
        return k * m, np.where(k == 0.0, 1.0, 2.0) * (M - k)
    top = min(M - 1, 8 * m)
    if top <= _ALL_LAGS:
        k = np.arange(top + 1, dtype=np.float64)
        return k, np.where(k == 0.0, 1.0, 2.0) * (M - k)
    steps = np.unique(np.round(np.geomspace(1.0, 0.5 * m, 24)))
    grid = [np.linspace(0.0, 4.0 * m, 97), np.linspace(4.0 * m, 8.0 * m, 17)]
    grid += [corner * m + side * steps for corner in range(5) for side in (-1.0, 1.0)]
    k = np.unique(np.round(np.concatenate(grid)))
    k = np.append(k[(k >= 0.0) & (k < top)], float(top))
    weight = np.ones_like(k)  # a node stands for itself and half of the integers up to its neighbours
    weight[:-1] += 0.5 * (np.diff(k) - 1.0)
    weight[1:] += 0.5 * (np.diff(k) - 1.0)
    weight *= 2.0
    weight[0] -= 1.0
    return k, weight * (M - k)


def autocovariance(d: Differences, noise: Mixture, dt: float, k: FloatArray) -> FloatArray:
    """Autocovariance of the differences.

    Parameters
    ----------
    d : Differences
    noise : sequence of (strength, exponent or process)
    dt : float
        Sampling interval. [s]
    k : ndarray
        Lags between starts, [samples]; the first must be 0, so that the first result is the variance.

    Returns
    -------
    ndarray
        Autocovariance of the differences of the integral. [x^2 s^2]
    """
    far = float(np.max(k)) + d.order * d.m > _FAR
    j = np.arange(-d.order, d.order + 1)
    factors = np.array([(-1.0) ** int(i) * comb(2 * d.order, d.order + int(i)) for i in j])
    t = np.abs(np.add.outer(j * d.m, k))
    total = np.zeros_like(k)
    for strength, kind in noise:
        for part in terms_of(kind) if isinstance(kind, Process) else (kind,):
            if isinstance(part, Process):
                g = process_covariance(part, t * dt, d.m * dt * d.modified)
            else:
                g = power_law_covariance(part, t, float(d.m if d.modified else 1), far and not d.modified)
            total += strength * (factors @ g)
            total += strength * _ramp(part, d, dt)
    return total


def dof(d: Differences, noise: Mixture, dt: float) -> float:
    """Equivalent degrees of freedom of the mean square of ``d``.

    ``2 mean^2 / variance`` of the mean square, from ``cov(z_i^2, z_j^2) = 2 r^2`` of normal z.

    References
    ----------
    Greenhall and Riley (2003); summed directly, without their tables for long averaging times.
    """
    k, weight = lags(d)
    r = autocovariance(d, noise, dt, k)
    constant = sum(strength * _ramp(kind, d, dt) for strength, kind in noise)  # all that is left at lags beyond
    beyond = (float(d.count) ** 2 - np.sum(weight)) * constant**2
    return max(1.0, float(d.count**2 * r[0] ** 2 / (np.sum(weight * r**2) + beyond)))


def _ramp(kind: int | Process, d: Differences, dt: float) -> float:
    """Variance, and autocovariance at any lag, of the differences of ramps: they are the same along the record."""
    if isinstance(kind, int) or d.order > 2:
        return 0.0
    return float(sum((term.R * (d.m * dt) ** 2) ** 2 for term in terms_of(kind) if isinstance(term, Ramp)))


def shape_quantiles(d: Differences, noise: Mixture, dt: float, p: FloatArray) -> FloatArray:
    """Quantiles of the mean square of ``d`` divided by its mean, at probabilities ``p``.

    The mean square is a quadratic form in normal numbers, so it is distributed like a weighted sum of squares whose
    weights are the eigenvalues of the covariance matrix. Chi-square with the same variance puts too much weight near
    zero: with four averaging times in the record its 2.5 % quantile is half the true one.

    References
    ----------
    Kuonen, "Saddlepoint approximations for distributions of quadratic forms in normal variables", Biometrika 86
    (1999) 929: the tail formula of Lugannani and Rice used here.
    """
    from scipy.linalg import eigvalsh, toeplitz

    step = max(1, min(d.m // 10, (d.count - 1) // 20)) if d.overlapping else 1
    step = max(step, d.count // 300)  # only differences of a ramp are so many and yet few degrees of freedom
    k = np.arange(0, d.count, step, dtype=np.float64) * d.stride
    r = autocovariance(d, noise, dt, k)
    weights = eigvalsh(toeplitz(r / r[0]))
    return weighted_chi_square_quantiles(weights[weights > 1e-5 * weights[-1]], p)


def weighted_chi_square_quantiles(weights: FloatArray, p: FloatArray) -> FloatArray:
    """Quantiles of a weighted mean of squares of independent standard normal numbers, by the saddlepoint formula.

    The error of a probability is at most a tenth of it (one weight), a few per cent with two or more equal ones.
    """
    from scipy.special import ndtr, ndtri

    lam = weights / np.sum(weights)
    if len(lam) == 1:
        from scipy.stats import chi2

        return np.asarray(chi2.ppf(p, 1.0))
    limit = 0.5 / np.max(lam)  # the cumulant generating function ends here
    zeta = limit * np.concatenate((-np.geomspace(1e6, 1e-3, 60), 1.0 - np.geomspace(0.999, 1e-5, 60)))
    d = 1.0 - 2.0 * np.outer(zeta, lam)
    q = np.sum(lam / d, axis=1)
    K = -0.5 * np.sum(np.log(d), axis=1)
    w = np.sign(zeta) * np.sqrt(2.0 * (zeta * q - K))
    v = zeta * np.sqrt(2.0 * np.sum((lam / d) ** 2, axis=1))
    below = ndtri(np.clip(ndtr(w + np.log(v / w) / w), 1e-300, 1.0 - 1e-16))
    return np.asarray(np.exp(np.interp(ndtri(p), below, np.log(q))))
