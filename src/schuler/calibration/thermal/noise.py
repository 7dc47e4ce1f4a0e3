"""Least squares of slow logs whose noise is correlated: the noise is found out with it, for many axes at once."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from schuler.arrays import FloatArray

#: Correlation times tried, as shares of the log; beyond a whole log it looks like a random walk.
_TAUS = (0.005, 0.015, 0.05, 0.15, 0.5, 1.5, 5.0, 20.0)
#: Shares of the correlated part in the variance of a block mean; the rest is white.
_SHARES = (0.1, 0.3, 0.6, 0.85, 0.95, 0.99, 0.999)
#: What such slow noise makes of the mean of the whole log cannot be told from the bias and is counted as bias.
_SLOW = 0.5
#: How much likelier white noise alone is than any one of the mixtures, before the data are seen.
_WHITE = 5.0
_FLOOR = 1e-11  # residuals below this share of the range of the data are rounding


@dataclass(frozen=True, eq=False)
class Noise:
    """Noise of the block means of one axis.

    Attributes
    ----------
    W, L : ndarray, shape (J, J)
        Whitener and its inverse: ``R = L L^T``, ``W R W^T = I`` with R the correlation of the block means.
    sigma : float
        Standard deviation of a block mean. [x]
    tau : float
        Correlation time as a share of the log; 0 for white noise.
    share : float
        Of the correlated part in the variance.
    floor : float
        Sum of squares below which residuals are rounding. [x^2]
    """

    W: FloatArray
    L: FloatArray
    sigma: float
    tau: float
    share: float
    floor: float


@dataclass(frozen=True, eq=False)
class LinearFit:
    """Ordinary least squares of one axis, with the uncertainty that correlated noise makes of it.

    Attributes
    ----------
    x : ndarray, shape (p,)
    covariance : ndarray, shape (p, p)
        With the noise that was given.
    squares : float
        Whitened residuals squared of generalised least squares, for comparing models. [x^2]
    residual : ndarray, shape (J,)
        Not whitened. [x]
    """

    x: FloatArray
    covariance: FloatArray
    squares: float
    residual: FloatArray


class Mixture(NamedTuple):
    """White noise and a share of exponentially correlated noise, ``R = (1 - share) I + share K``."""

    tau: float
    share: float
    K: FloatArray
    W: FloatArray
    logdet: float

    def add_to(self, V: FloatArray, variance: float) -> None:
        """Add its covariance to V, in place."""
        V += variance * self.share * self.K
        V[np.diag_indices(len(V))] += variance * (1.0 - self.share)


@lru_cache(maxsize=2)
def mixtures(J: int) -> tuple[Mixture, ...]:
    """Each noise tried, with whitener and log determinant of R, blocks evenly spaced."""
    k = np.arange(J)
    lag = np.abs(k[:, None] - k) / J
    out = [Mixture(0.0, 0.0, np.eye(J), np.eye(J), 0.0)]
    for tau in _TAUS:
        if tau < 0.5 / J:
            continue
        K = np.exp(-lag / tau)
        if tau >= _SLOW:
            K = K - K.mean(axis=0) - K.mean(axis=1)[:, None] + K.mean()
            K = K / np.mean(np.diag(K))
        for share in _SHARES:
            L = np.linalg.cholesky((1.0 - share) * np.eye(J) + share * K)
            out.append(Mixture(tau, share, K, _inverse(L), 2.0 * float(np.log(np.diag(L)).sum())))
    return tuple(out)


def _inverse(L: FloatArray) -> FloatArray:
    """Inverse of a lower triangular matrix, a quarter of the time of a general one."""
    from scipy.linalg.lapack import dtrtri

    return np.ascontiguousarray(dtrtri(L, lower=1)[0])


def noise_of(Y: FloatArray, X: FloatArray) -> list[Noise]:
    """Noise of each axis under a linear model, averaged over what the residuals allow.

    Parameters
    ----------
    Y : ndarray, shape (J, k)
        Block means of k axes.
    X : ndarray, shape (J, p)
        Columns of the fullest model that will be fitted; p < J - 2.

    Returns
    -------
    list of Noise
        Mean of the covariances of 57 mixtures of white and exponentially correlated noise, weighted by their restricted
        likelihoods; ``tau`` and ``share`` are such means too.

    Notes
    -----
    Restricted likelihood, because the model takes many degrees of freedom from slow noise: plain likelihood would find
    the noise whiter than it is. The mean and not the likeliest mixture, because slow noise looks much like the curve
    itself: many mixtures are about as likely, and only some of them make large uncertainties. In simulations 1 sigma is
    0.7 to 1.6 times the true scatter (1.6 for purely white noise). Patterson & Thompson (1971).
    """
    J, p = X.shape
    floor = J * (_FLOOR * np.maximum(np.ptp(Y, axis=0), 1e-300) + 1e-15 * np.abs(Y).max(axis=0) + 1e-60) ** 2
    tried = mixtures(J)
    value, squares = np.empty((len(tried), Y.shape[1])), np.empty((len(tried), Y.shape[1]))
    for k, mixture in enumerate(tried):
        Q, R = np.linalg.qr(mixture.W @ X)
        WY = mixture.W @ Y
        squares[k] = np.maximum(np.sum(WY**2, axis=0) - np.sum((Q.T @ WY) ** 2, axis=0), floor)
        logdet_x = 2.0 * float(np.log(np.abs(np.diag(R))).sum())
        value[k] = -0.5 * ((J - p) * np.log(squares[k]) + mixture.logdet + logdet_x)
    value[0] += np.log(_WHITE)
    weights = np.exp(value - value.max(axis=0))
    weights /= weights.sum(axis=0)
    estimate = []
    for i in range(Y.shape[1]):
        V = np.zeros((J, J))
        for weight, square, mixture in zip(weights[:, i], squares[:, i], tried, strict=True):
            if weight > 1e-4:
                mixture.add_to(V, float(weight * square / (J - p - 2)))
        sigma = float(np.sqrt(V[0, 0]))
        L = np.asarray(np.linalg.cholesky(V / sigma**2))
        tau = float(np.sum(weights[:, i] * [mixture.tau for mixture in tried]))
        share = float(np.sum(weights[:, i] * [mixture.share for mixture in tried]))
        estimate.append(Noise(_inverse(L), L, sigma, tau, share, float(floor[i])))
    return estimate


def white(Y: FloatArray, sigma: FloatArray) -> list[Noise]:
    """Known white noise of each axis: ``sigma`` of the block means, shape (k,). [x]"""
    identity = np.eye(len(Y))
    floor = len(Y) * (_FLOOR * np.ptp(Y, axis=0) + 1e-60) ** 2
    return [Noise(identity, identity, float(s), 0.0, 0.0, float(z)) for s, z in zip(sigma, floor, strict=True)]


def fit(y: FloatArray, X: FloatArray, noise: Noise) -> LinearFit:
    """Least squares with a given noise.

    Parameters
    ----------
    y : ndarray, shape (J,)
    X : ndarray, shape (J, p)
        Of full rank.
    noise : Noise

    Returns
    -------
    LinearFit

    Notes
    -----
    ``x = X^+ y``, ``C = sigma^2 X^+ R X^+^T``. Generalised least squares would be a little more precise if the noise
    were exactly as modelled; where a slow drift is taken for noise it lets the curve leave the data, because it trusts
    changes from block to block more than levels. For comparing models it is used all the same.
    """
    scale = np.linalg.norm(X, axis=0)
    scale = np.where(scale > 0.0, scale, 1.0)
    Q, R = np.linalg.qr(X / scale)
    x = np.linalg.solve(R, Q.T @ y) / scale
    B = noise.sigma * np.linalg.solve(R, Q.T @ noise.L) / scale[:, None]
    whitened, wy = noise.W @ (X / scale), noise.W @ y
    Q, _ = np.linalg.qr(whitened)
    left = wy - Q @ (Q.T @ wy)
    return LinearFit(x, B @ B.T, max(float(left @ left), noise.floor), y - X @ x)


def bic(estimate: LinearFit, noise: Noise, columns: int) -> float:
    """Bayesian information criterion with the noise held: ``squares / sigma^2 + columns ln J``, smaller is better.

    The whitened residuals are independent, so J, the number of blocks, is an honest number of observations.
    """
    return float(estimate.squares / noise.sigma**2 + columns * np.log(len(noise.W)))


def better(smaller: LinearFit, larger: LinearFit, noise: Noise, added: int) -> float:
    """Probability that noise alone makes the larger model that much better: likelihood ratio with the noise held."""
    from scipy.stats import chi2

    return float(chi2.sf(max(smaller.squares - larger.squares, 0.0) / noise.sigma**2, added))
