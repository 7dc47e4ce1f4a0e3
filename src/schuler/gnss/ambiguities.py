"""Integer ambiguities of carrier phases: LAMBDA, success rate, ratio test, fixing of a part."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from schuler.arrays import ArrayLike, FloatArray, IntArray, as_floats
from schuler.exceptions import InputError
from schuler.plotting.notebook import Abridged

_GAIN = 1e-9  # relative, by which an exchange of neighbours must make the later variance smaller: rounding makes none


@dataclass(frozen=True, repr=False)
class AmbiguityFix(Abridged):
    """Outcome of :func:`fix_ambiguities` for n ambiguities, m of whose combinations were looked at.

    Attributes
    ----------
    accepted : bool
        Success rate and ratio are as large as was asked.
    Z : ndarray of int, shape (n, n)
        Decorrelating transformation, see :func:`decorrelate`; the last m columns are the combinations looked at.
    integers : ndarray of int, shape (m,)
        Best integers of ``Z[:, n - m:]^T a``. [cycles]
    norms : ndarray, shape (2,)
        Squared norms of the best and second-best candidates, in units of the variance.
    ratio : float
        Second norm over first; infinite where the first is zero.
    success_rate : float
        Probability that bootstrapping fixes these m right, a lower bound for integer least squares.
    """

    accepted: bool
    Z: IntArray
    integers: IntArray
    norms: FloatArray
    ratio: float
    success_rate: float


def decorrelate(Q: ArrayLike) -> tuple[IntArray, FloatArray, FloatArray]:
    """Unimodular transformation that makes ambiguities nearly uncorrelated, and the factors of their covariance.

    Parameters
    ----------
    Q : array_like, shape (n, n)
        Covariance of the float ambiguities. [cycles^2]

    Returns
    -------
    Z : ndarray of int, shape (n, n)
        The transformed ambiguities are ``Z^T a``.
    L : ndarray, shape (n, n)
        Lower triangular with unit diagonal: ``Z^T Q Z = L^T diag(d) L``.
    d : ndarray, shape (n,)
        Variance of each given those after it; the most precise come last as far as possible. [cycles^2]

    Raises
    ------
    InputError
        If the matrix is not square, not symmetric or not positive definite.

    References
    ----------
    Teunissen, P. J. G. (1995), Journal of Geodesy 70, 65-82; de Jonge, P., Tiberius, C. (1996), LGR Series 12, Delft:
    sections 3.3 to 3.7 (integer Gauss transformations and exchanges of neighbours).
    """
    L, d = _ltdl(_covariance(Q))
    n = len(d)
    Z = np.eye(n)
    j = n - 2
    while j >= 0:
        _subtract(L, Z, j + 1, j)
        exchanged = d[j] + L[j + 1, j] ** 2 * d[j + 1]
        if exchanged < (1.0 - _GAIN) * d[j + 1]:
            for i in range(j + 2, n):  # else multiples grow with every exchange
                _subtract(L, Z, i, j)
            _exchange(L, d, Z, j, exchanged)
            j = min(j + 1, n - 2)
        else:
            j -= 1
    for j in range(n - 2, -1, -1):
        for i in range(j + 1, n):
            _subtract(L, Z, i, j)
    return np.rint(Z).astype(np.int64), L, d


def success_rate(d: ArrayLike) -> float:
    """Probability that integer bootstrapping fixes all ambiguities right: ``prod(2 Phi(1 / (2 sqrt(d_i))) - 1)``.

    Parameters
    ----------
    d : array_like, shape (n,)
        Conditional variances, see :func:`decorrelate`. [cycles^2]

    References
    ----------
    Teunissen, P. J. G. (1998), Journal of Geodesy 72, 606-612.
    """
    from scipy.special import erf

    variance = as_floats(d, "d", (None,))
    if np.any(variance <= 0.0):
        raise InputError(f"d: expected positive variances, got {variance.min()}")
    return float(np.prod(erf(1.0 / np.sqrt(8.0 * variance))))


def integer_least_squares(a: ArrayLike, Q: ArrayLike, *, candidates: int = 2) -> tuple[IntArray, FloatArray]:
    """Integer vectors nearest to float ambiguities in the metric of their covariance (LAMBDA).

    Parameters
    ----------
    a : array_like, shape (n,)
        Float ambiguities. [cycles]
    Q : array_like, shape (n, n)
        Their covariance. [cycles^2]
    candidates : int
        How many of the nearest vectors.

    Returns
    -------
    integers : ndarray of int, shape (candidates, n)
        Best first. [cycles]
    norms : ndarray, shape (candidates,)
        ``(a - z)^T Q^-1 (a - z)`` of each.

    Raises
    ------
    InputError
        If shapes do not agree, or as :func:`decorrelate`.

    Examples
    --------
    >>> Q = [[6.290, 5.978, 0.544], [5.978, 6.292, 2.340], [0.544, 2.340, 6.288]]
    >>> z, norms = integer_least_squares([5.450, 3.100, 2.970], Q)
    >>> z.tolist(), norms.round(4).tolist()
    ([[5, 3, 4], [6, 4, 4]], [0.2183, 0.3073])

    References
    ----------
    Teunissen (1995); Chang, X.-W., Yang, X., Zhou, T. (2005), Journal of Geodesy 79, 552-565: search that begins in the
    middle of each interval and shrinks with every candidate. The example is de Jonge and Tiberius's (1996).
    """
    if candidates < 1:
        raise InputError(f"candidates: expected at least 1, got {candidates}")
    Z, L, d = decorrelate(Q)
    a = as_floats(a, "a", (len(d),))
    whole = np.floor(a)  # a large integer part would cost digits in Z^T a
    z, norms = _search(Z.T @ (a - whole), L, d, candidates)
    back = np.rint(np.linalg.solve(Z.T.astype(np.float64), z.T)).T
    return (back + whole).astype(np.int64), norms


def fix_ambiguities(
    a: ArrayLike,
    Q: ArrayLike,
    *,
    ratio: float = 3.0,
    least_success: float = 0.999,
    partial: bool = True,
) -> AmbiguityFix:
    """Fix ambiguities, or those of their combinations that are precise enough, and test the result.

    Parameters
    ----------
    a : array_like, shape (n,)
        Float ambiguities. [cycles]
    Q : array_like, shape (n, n)
        Their covariance. [cycles^2]
    ratio : float
        Least quotient of the squared norms of the second-best and the best candidate.
    least_success : float
        Least success rate of bootstrapping.
    partial : bool
        Where the success rate of all is too small, take the largest set of the most precise decorrelated combinations
        whose success rate is large enough.

    Returns
    -------
    AmbiguityFix
        Not accepted and empty (m = 0) where no set is precise enough.

    Raises
    ------
    InputError
        If shapes do not agree or thresholds make no sense.

    References
    ----------
    Teunissen, P. J. G., Joosten, P., Tiberius, C. (1999), ION GPS-99, 201-207 (partial fixing by success rate);
    Euler, H.-J., Schaffrin, B. (1991), IAG Symposia 107, 285-295 (ratio).
    """
    if not ratio >= 1.0:
        raise InputError(f"ratio: expected 1 or more, got {ratio}")
    if not 0.0 < least_success < 1.0:
        raise InputError(f"least_success: expected a probability between 0 and 1, got {least_success}")
    Z, L, d = decorrelate(Q)
    a = as_floats(a, "a", (len(d),))
    first = 0
    while first < len(d) and success_rate(d[first:]) < least_success:
        first = first + 1 if partial else len(d)
    if first == len(d):
        return AmbiguityFix(False, Z, np.zeros(0, dtype=np.int64), np.full(2, np.nan), np.nan, np.nan)
    whole = np.floor(a)
    L, d = L[first:, first:], d[first:]
    combinations = Z[:, first:].T
    z, norms = _search(combinations @ (a - whole), L, d, 2)
    quotient = float(norms[1] / norms[0]) if norms[0] > 0.0 else np.inf
    integers = np.rint(z[0] + combinations @ whole).astype(np.int64)
    return AmbiguityFix(quotient >= ratio, Z, integers, norms, quotient, success_rate(d))


def _covariance(Q: ArrayLike) -> FloatArray:
    Q = as_floats(Q, "Q", (None, None))
    if not len(Q) or Q.shape[0] != Q.shape[1]:
        raise InputError(f"Q: expected a square matrix of at least one ambiguity, got shape {Q.shape}")
    if not np.allclose(Q, Q.T, rtol=1e-6, atol=1e-9 * np.abs(Q).max()):
        raise InputError("Q: expected a symmetric matrix")
    return 0.5 * (Q + Q.T)


def _ltdl(Q: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Factors of ``Q = L^T diag(d) L`` by Cholesky's of the matrix with rows and columns reversed."""
    try:
        G = np.linalg.cholesky(Q[::-1, ::-1])[::-1, ::-1].T
    except np.linalg.LinAlgError:
        raise InputError("Q: expected a positive definite matrix; are two ambiguities the same?") from None
    diagonal = np.diag(G).copy()
    return np.ascontiguousarray(G / diagonal[:, None]), diagonal**2


def _subtract(L: FloatArray, Z: FloatArray, i: int, j: int) -> None:
    """Subtract from ambiguity j the multiple of ambiguity i that leaves ``|L[i, j]| <= 1/2``, in place."""
    multiple = round(L[i, j])
    if multiple:
        L[i:, j] -= multiple * L[i:, i]
        Z[:, j] -= multiple * Z[:, i]


def _exchange(L: FloatArray, d: FloatArray, Z: FloatArray, j: int, exchanged: float) -> None:
    """Exchange ambiguities j and j + 1 in place; ``exchanged`` is the new conditional variance of the latter."""
    eta, slope = d[j] / exchanged, L[j + 1, j]
    coupling = d[j + 1] * slope / exchanged
    d[j], d[j + 1] = eta * d[j + 1], exchanged
    upper, lower = L[j, :j].copy(), L[j + 1, :j].copy()
    L[j, :j], L[j + 1, :j] = lower - slope * upper, eta * upper + coupling * lower
    L[j + 1, j] = coupling
    L[j + 2 :, [j, j + 1]] = L[j + 2 :, [j + 1, j]]
    Z[:, [j, j + 1]] = Z[:, [j + 1, j]]


def _search(z: FloatArray, L: FloatArray, d: FloatArray, candidates: int) -> tuple[FloatArray, FloatArray]:
    """Nearest integer vectors by depth-first search from the last ambiguity, and their squared norms.

    At each level integers are tried from the conditional estimate outwards, in turn on both sides; the bound is the
    norm of the worst candidate kept.
    """
    n = len(z)
    chosen, best = np.zeros((candidates, n)), np.full(candidates, np.inf)
    centre, integer, step, above = np.zeros(n), np.zeros(n), np.zeros(n), np.zeros(n + 1)
    k, descending = n - 1, True
    while True:
        if descending:
            centre[k] = z[k] + (integer[k + 1 :] - centre[k + 1 :]) @ L[k + 1 :, k]
            integer[k] = np.rint(centre[k])
            step[k] = 1.0 if centre[k] >= integer[k] else -1.0
        norm = above[k + 1] + (integer[k] - centre[k]) ** 2 / d[k]
        if norm < best[-1]:
            if k > 0:
                above[k] = norm
                k, descending = k - 1, True
                continue
            place = int(np.searchsorted(best, norm))
            chosen[place:], best[place:] = np.vstack((integer, chosen[place:-1])), np.append(norm, best[place:-1])
        else:
            k += 1
            if k == n:
                return chosen, best
        integer[k] += step[k]
        step[k] = -step[k] - np.sign(step[k])
        descending = False
