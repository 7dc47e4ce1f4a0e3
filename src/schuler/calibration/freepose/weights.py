"""Weights of residuals: less for outliers, a common spread where noise explains too little; inverse normal matrices."""

from __future__ import annotations

import numpy as np

from schuler.arrays import FloatArray
from schuler.exceptions import InputError

#: Normalised size beyond which a residual has less weight. Three sigma of one component: full weight to nearly all good
#: poses (0.3 % loss of efficiency), bounded influence of a bad one.
TURNING = 3.0
#: Normal quantile of the size of residuals beyond which a spread is added: once in twenty logs without need, where
#: waiting for a thousandth let logs claim too little by up to a half.
SPREAD_QUANTILE = 1.64
#: Largest share of outliers that are given less weight; with more the model may be wrong.
MOST_OUTLIERS = 0.2
# median of chi-square over its mean, by number of components
_MEDIAN = {1: 0.4549, 2: 0.6931, 3: 0.7887}


def median(x: FloatArray) -> FloatArray:
    """Median along the first axis; NumPy's own takes ten times as long for as few numbers."""
    y = np.sort(x, axis=0)
    n = len(y)
    return np.asarray(0.5 * (y[(n - 1) // 2] + y[n // 2]))


def outlier_weights(z: FloatArray, components: int) -> FloatArray:
    """Weights of normalised residuals of ``components`` components: 1 up to the turning point, then falling as 1/z^2.

    The influence of an outlier falls as it grows. Huber's weights, falling as 1/z, keep it constant, and were seen to
    leave a pose of large leverage its pull on the fit.

    References
    ----------
    Huber (1964) for the bounded influence; the turning point is for one component and grows with the root of their
    number.
    """
    limit = TURNING * np.sqrt(0.5 + 0.5 * components)
    return np.asarray(np.minimum(1.0, limit / np.maximum(z, 1e-300)) ** 2)


def too_many_outliers(weight: FloatArray) -> bool:
    """Whether more than :data:`MOST_OUTLIERS` have less than half weight."""
    return bool((weight < 0.5).mean() > MOST_OUTLIERS)


def residual_factor(leverage: FloatArray) -> FloatArray:
    """Standard deviation of a residual over that of its error, by leverage: ``sqrt(1 - h)``, at least a fifth."""
    return np.asarray(np.sqrt(np.maximum(1.0 - leverage, 0.04)))


def largest_reduced_chi2(freedom: float, quantile: float = 3.09) -> float:
    """Chi-square over degrees of freedom that is exceeded once in a thousand, or beyond another normal quantile.

    References
    ----------
    Wilson and Hilferty (1931).
    """
    q = 2.0 / (9.0 * freedom)
    return float((1.0 - q + quantile * np.sqrt(q)) ** 3)


def excess_spread(e: FloatArray, sigma: FloatArray, components: int, robust: bool) -> float:
    """Common 1-sigma beside the noise that explains the size of the residuals; 0 where noise does.

    Parameters
    ----------
    e : ndarray, shape (n,)
        Residuals over :func:`residual_factor`; lengths of ``components`` components. [unit]
    sigma : ndarray, shape (n,)
        1 sigma of a component by noise. [unit]
    components : int
    robust : bool
        From the median of the squares; else from their sum.

    Returns
    -------
    float
        Per component. [unit]
    """
    if len(e) == 0:
        return 0.0
    square, noise, freedom = e * e / components, sigma * sigma, components * len(e)
    if robust:
        typical = _MEDIAN[components]
        # the variance of a median is that of 0.37 times as many squares
        if float(median(square / noise)) <= typical * largest_reduced_chi2(max(1.0, 0.37 * freedom), SPREAD_QUANTILE):
            return 0.0
        # half of the ratios square/(noise + extra) lie below their median where half of these lie below extra
        return float(np.sqrt(max(0.0, float(median(square / typical - noise)))))
    if float((square / noise).mean()) <= largest_reduced_chi2(freedom, SPREAD_QUANTILE):
        return 0.0
    extra = 0.0
    for _ in range(60):  # Newton, from below: mean of square/(noise + extra) is convex and falls
        z = square / (noise + extra)
        change = (z.mean() - 1.0) / (z / (noise + extra)).mean()
        extra += change
        if change <= 1e-9 * extra:
            break
    return float(np.sqrt(extra))


def pseudo_inverse(N: FloatArray) -> FloatArray:
    """Inverse of a normal matrix with unit diagonal first; directions without information are left out."""
    d = np.sqrt(np.maximum(np.diag(N), 0.0))
    d[d == 0.0] = 1.0
    values, Q = np.linalg.eigh(N / np.outer(d, d))
    good = values > 1e-12 * values.max()
    inverse = (Q[:, good] / values[good]) @ Q[:, good].T
    with np.errstate(over="ignore"):  # a fit that ran away knows next to nothing: infinite variance
        return np.asarray(inverse / np.outer(d, d))


def propagated(S: FloatArray, variance: FloatArray) -> FloatArray:
    """Covariance ``S diag(variance) S^T``."""
    from schuler.calibration.freepose import _kernels as kernels

    V = np.empty((len(S), len(S)))
    kernels.weighted_square(np.ascontiguousarray(S), variance, V)
    return V


def solve_weighted(V: FloatArray, own: FloatArray, X: FloatArray) -> FloatArray:
    """``(V + diag(own))^-1 X``."""
    from schuler.calibration.freepose import _kernels as kernels

    X = np.array(X, order="C")
    total = V + np.diag(own)
    if not kernels.solve_positive(total, X):
        raise InputError(
            "imu: the covariance of the turns is singular; the log has no noise at all in some pose, give noise="
        )
    return X
