"""Weighted linear least squares of a sensor's response, with what the data leave open describe_confounded in words.

All bench methods end here: a reading of axis i is ``b_i + (I + M)_i . reference + ...`` and so linear in the
parameters once the reference is known.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from schuler.arrays import BoolArray, FloatArray, as_floats
from schuler.exceptions import InputError

#: A direction of the normalised design with a smaller singular value is one the data say nothing about. [-]
RANK_TOLERANCE = 1e-10
#: Probability of larger residuals than this without any fault, below which the fit is called suspicious.
SUSPICIOUS = 1e-3


@dataclass(frozen=True, eq=False)
class LinearFit:
    """Solution of ``y = A x + e``, e of covariance S.

    Attributes
    ----------
    names : tuple of str
        Names of x; those beginning with an underscore are nuisances.
    values : ndarray, shape (p,)
        Zero where not determined.
    covariance : ndarray, shape (p, p)
        Of x by the stated S, not scaled by the residuals; infinite variance where not determined.
    determined : ndarray of bool, shape (p,)
    confounded : tuple of tuple of str
        Groups of parameters of which the data show only a combination.
    condition : float
        Condition number of the normal matrix with unit diagonal; infinite if something is not determined.
    gain : ndarray, shape (p, m)
        ``values = gain @ y``.
    residuals : ndarray, shape (m,)
        ``y - A x``.
    freedom : int
        Number of data less rank.
    chi2 : float
        Weighted residuals squared, ``r^T S^-1 r``.
    """

    names: tuple[str, ...]
    values: FloatArray
    covariance: FloatArray
    determined: BoolArray
    confounded: tuple[tuple[str, ...], ...]
    condition: float
    gain: FloatArray
    residuals: FloatArray
    freedom: int
    chi2: float

    @property
    def variance_of_unit_weight(self) -> float:
        """chi2 over freedom; NaN without redundancy."""
        return self.chi2 / self.freedom if self.freedom > 0 else float("nan")

    def limit(self, probability: float = SUSPICIOUS) -> float:
        """chi2 that noise alone exceeds with this probability."""
        from scipy.stats import chi2

        return float(chi2.isf(probability, self.freedom)) if self.freedom > 0 else float("inf")


def linear_fit(A: FloatArray, y: FloatArray, S: FloatArray, names: Sequence[str]) -> LinearFit:
    """Solve ``y = A x + e`` for x by generalised least squares.

    Parameters
    ----------
    A : ndarray, shape (m, p)
        Design.
    y : ndarray, shape (m,)
        Data.
    S : ndarray, shape (m,) or (m, m)
        Variances or covariance of e.
    names : sequence of str, length p

    Returns
    -------
    LinearFit
        Never fails for want of data: what is not determined has infinite variance and the value zero, what is
        determined in spite of that is the same for every solution.

    Raises
    ------
    InputError
        If shapes disagree, a number is not finite, or S is not positive definite.

    Notes
    -----
    Columns are scaled to unit length after weighting, so that radians per second and parts per million do not decide
    about the rank; the null space is read off the singular value decomposition.
    """
    A = as_floats(A, "A", (None, len(names)))
    y = as_floats(y, "y", (len(A),))
    S = as_floats(S, "S")
    if S.shape not in ((len(A),), (len(A), len(A))):
        raise InputError(f"S: expected {len(A)} variances or a covariance of that size, got shape {S.shape}")
    try:
        L = np.linalg.cholesky(S) if S.ndim == 2 else np.diag(np.sqrt(S))
        if not (np.diag(L) > 0.0).all():
            raise np.linalg.LinAlgError
    except np.linalg.LinAlgError as error:
        raise InputError(
            "S: expected positive variances; readings without any noise cannot be weighted, so state the noise"
        ) from error
    white = np.linalg.solve(L, np.column_stack((A, y)))
    B, z = white[:, :-1], white[:, -1]
    length = np.linalg.norm(B, axis=0)
    scale = np.where(length > 0.0, length, 1.0)
    U, s, Vt = np.linalg.svd(B / scale, full_matrices=len(A) < len(names))
    rank = int((s > RANK_TOLERANCE * s[0]).sum()) if len(s) and s[0] > 0.0 else 0
    null = Vt[rank:]
    determined = ~(np.abs(null) > 1e-6).any(axis=0)
    half = (Vt[:rank].T / s[:rank]) / scale[:, None]  # x = half U^T z
    x = half @ (U[:, :rank].T @ z)
    residuals = y - A @ x
    weighted = z - B @ x
    covariance = half @ half.T
    gain = half @ np.linalg.solve(L.T, U[:, :rank]).T
    covariance[~determined, :] = 0.0
    covariance[:, ~determined] = 0.0
    covariance[~determined, ~determined] = np.inf
    complete = rank == len(names)
    return LinearFit(
        names=tuple(names),
        values=np.where(determined, x, 0.0),
        covariance=covariance,
        determined=determined,
        confounded=_groups(null, names),
        condition=float((s[0] / s[-1]) ** 2) if complete and rank else float("inf"),
        gain=np.where(determined[:, None], gain, 0.0),
        residuals=residuals,
        freedom=len(y) - rank,
        chi2=float(weighted @ weighted),
    )


def from_gain(A: FloatArray, y: FloatArray, S: FloatArray, names: Sequence[str], gain: FloatArray) -> LinearFit:
    """The same for an estimator that is linear but not the best: ``x = gain @ y`` with ``gain @ A = I``.

    Parameters
    ----------
    A, y, S, names
        As in :func:`linear_fit`.
    gain : ndarray, shape (p, m)

    Returns
    -------
    LinearFit
        ``chi2`` is that of the best estimator, because only that one follows the chi-square distribution.
    """
    best = linear_fit(A, y, S, names)
    x = gain @ y
    covariance = gain @ (S if S.ndim == 2 else np.diag(S)) @ gain.T
    return LinearFit(
        best.names, x, covariance, np.ones(len(names), dtype=bool), (), best.condition, gain, y - A @ x,
        best.freedom, best.chi2,
    )  # fmt: skip


def response_design(reference: FloatArray) -> FloatArray:
    """Design of three axes that see the same reference, each with parameters of its own.

    Parameters
    ----------
    reference : ndarray, shape (n, q)
        One row for each reading; for a bias and a response the columns are 1, x, y, z.

    Returns
    -------
    ndarray, shape (3 n, 3 q)
        For data ``readings.ravel()``, readings of shape (n, 3); parameters axis by axis.
    """
    n, q = reference.shape
    A = np.zeros((n, 3, 3, q))
    for i in range(3):
        A[:, i, i, :] = reference
    return A.reshape(3 * n, 3 * q)


def describe_confounded(confounded: Sequence[tuple[str, ...]]) -> list[str]:
    """Sentences on parameters of which only a combination is seen."""
    out = []
    for group in confounded:
        names = [n for n in group if not n.startswith("_")]
        if len(names) == 1:
            out.append(f"{names[0]} is not determined: nothing in the data changes with it")
        elif names:
            out.append(f"{', '.join(names[:-1])} and {names[-1]} are not determined one by one, only a combination is")
    return out


def _groups(null: FloatArray, names: Sequence[str]) -> tuple[tuple[str, ...], ...]:
    """Names that occur together in the null space, as connected groups in the order of names."""
    # the projector does not depend on the choice of basis of the null space
    P = np.abs(null.T @ null) > 1e-6
    left = [j for j in range(len(names)) if P[j, j]]
    groups = []
    while left:
        group, border = set(), [left[0]]
        while border:
            j = border.pop()
            if j not in group:
                group.add(j)
                border.extend(k for k in left if P[j, k] and k not in group)
        groups.append(tuple(names[j] for j in sorted(group)))
        left = [j for j in left if j not in group]
    return tuple(groups)
