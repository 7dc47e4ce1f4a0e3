"""Scatter of readings between rests: what a bias does beyond white noise, and the covariance that follows."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from schuler.arrays import FloatArray
from schuler.exceptions import InputError

# correlation times that are tried, of the time from the first rest to the last; 0: every rest by itself
_TIMES = (0.0, 0.1, 0.5)
_MEMORY = 0.3  # what a scatter with memory counts beside one without before the log
_SIZES = np.linspace(0.0, 1.0, 25) ** 1.5
_LARGEST = 4.0  # largest scatter that is tried, over the root mean square of the residuals


@dataclass(frozen=True, eq=False)
class RestScatter:
    """Readings of three axes at rest, fitted, with the scatter between rests that they show.

    Attributes
    ----------
    values, covariance : ndarray, shape (q, 3), (3, q, q)
        Coefficients of the design, one column an axis, and their covariance: white noise, scatter between rests, and
        the uncertainty of the scatter itself. [x]
    rests : ndarray, shape (3, n, n)
        Covariance of the readings of each axis. [x^2]
    residual : ndarray, shape (n, 3)
        [x]
    sigma : ndarray, shape (3,)
        Scatter between rests beyond white noise, 1 sigma. [x]
    tau : ndarray, shape (3,)
        Its correlation time; 0 if every rest is by itself. [s]
    chi2, freedom : float, int
        Squared residuals of the fit by white noise alone, of all axes together.
    """

    values: FloatArray
    covariance: FloatArray
    rests: FloatArray
    residual: FloatArray
    sigma: FloatArray
    tau: FloatArray
    chi2: float
    freedom: int

    @property
    def reduced(self) -> float:
        """Chi-square by white noise over degrees of freedom; NaN without redundancy."""
        return self.chi2 / self.freedom if self.freedom > 0 else float("nan")


def rest_scatter(t: FloatArray, means: FloatArray, white: FloatArray, design: FloatArray | None = None) -> RestScatter:
    """Fit mean readings at rest, with white noise and a bias that changes from rest to rest.

    Parameters
    ----------
    t : ndarray, shape (n,)
        Middle of each rest. [s]
    means : ndarray, shape (n, 3)
        Mean readings. [x]
    white : ndarray, shape (n, 3)
        Their 1 sigma by white noise. [x]
    design : ndarray, shape (n, q), optional
        Columns the readings are fitted with. None: a constant.

    Returns
    -------
    RestScatter

    Raises
    ------
    InputError
        If there are not more rests than columns.

    Notes
    -----
    Residuals of an axis have the covariance ``diag(white^2) + s^2 exp(-|t_i - t_j|/tau)``. Scatter s (uniform, or none)
    and correlation time tau (none, and 10 and 50 % of the log) are integrated over with the restricted likelihood
    as weight, so that a scatter seen in few rests counts with its uncertainty, and one that drifts as what is nearly
    common to neighbours. Axes are treated alone. ``rests`` is the mean covariance, times the factor that makes a least
    squares solution with it as uncertain as the integral.

    References
    ----------
    Searle, Casella, McCulloch (1992), Variance Components, section 6.6, for the restricted likelihood; Gelman (2006)
    for the uniform prior of a standard deviation.
    """
    n = len(t)
    A = np.ones((n, 1)) if design is None else np.asarray(design, dtype=np.float64)
    q = A.shape[1]
    if n <= q:
        raise InputError(f"rests: expected more than {q}, got {n}; rest more often")
    white = np.maximum(white, max(1e-12 * float(np.abs(means).max()), 1e-30))  # data without noise have a weight too
    apart = np.abs(t[:, None] - t[None, :])
    length = float(apart.max())
    values, covariance, rests = np.empty((q, 3)), np.empty((3, q, q)), np.empty((3, n, n))
    residual, sigma, tau, chi2 = np.empty((n, 3)), np.empty(3), np.empty(3), 0.0
    shapes = [np.eye(n) if share == 0.0 or length == 0.0 else np.exp(-apart / (share * length)) for share in _TIMES]
    # no scatter and one without memory are alike before the log, one with memory is rarer
    density = np.gradient(_SIZES) / np.gradient(_SIZES).sum()
    prior = np.outer([1.0, *([_MEMORY / (len(_TIMES) - 1)] * (len(_TIMES) - 1))], density)
    prior[0, 0] += 1.0
    for i in range(3):
        w = white[:, i]
        B, y = A / w[:, None], means[:, i] / w
        plain = np.linalg.lstsq(B, y, rcond=None)[0]
        left = y - B @ plain
        chi2 += float(left @ left)
        top = _LARGEST * float(np.sqrt(np.mean((left * w) ** 2) * n / (n - q)))
        s2 = (top * _SIZES) ** 2
        x, C, log_weight = [], [], []
        for R in shapes:
            L, U = np.linalg.eigh(R / np.outer(w, w))
            d = 1.0 / (1.0 + np.maximum(L, 0.0) * s2[:, None])  # (sizes, n): inverse covariance, whitened and turned
            Bu, yu = U.T @ B, U.T @ y
            N = (d @ (Bu[:, :, None] * Bu[:, None, :]).reshape(n, q * q)).reshape(-1, q, q)
            P = np.linalg.inv(N)
            here = (P @ (d @ (Bu * yu[:, None]))[:, :, None])[:, :, 0]
            off = yu - here @ Bu.T
            x.append(here)
            C.append(P)
            log_weight.append(0.5 * (np.log(d).sum(axis=1) - np.linalg.slogdet(N)[1] - (d * off * off).sum(axis=1)))
        log_w = np.array(log_weight) + np.log(prior)
        weight = np.exp(log_w - log_w.max())
        weight /= weight.sum()
        X, P = np.array(x), np.array(C)
        values[:, i] = np.einsum("ts,tsa->a", weight, X)
        about = X - values[:, i]
        covariance[i] = np.einsum("ts,tsab->ab", weight, P) + np.einsum("ts,tsa,tsb->ab", weight, about, about)
        by_shape = weight @ s2
        V = np.diag(w * w) + sum(v * R for v, R in zip(by_shape, shapes, strict=True))
        plug_in = np.linalg.inv(A.T @ np.linalg.solve(V, A))
        rests[i] = V * max(1.0, float(np.mean(np.diag(covariance[i]) / np.diag(plug_in))))
        residual[:, i] = means[:, i] - A @ values[:, i]
        sigma[i] = np.sqrt(weight.sum(axis=0) @ s2)
        tau[i] = length * float(by_shape @ np.array(_TIMES)) / max(float(by_shape.sum()), 1e-300)
    return RestScatter(values, covariance, rests, residual, sigma, tau, chi2, 3 * (n - q))
