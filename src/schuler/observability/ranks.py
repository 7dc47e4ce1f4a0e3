"""How much of an error state measurements see: square root of the Gramian, its singular values, and three ranks."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from schuler.arrays import ArrayLike, BoolArray, FloatArray
from schuler.exceptions import InputError
from schuler.observability.system import LinearSystem
from schuler.plotting.notebook import Abridged

_EPS = float(np.finfo(np.float64).eps)


@dataclass(frozen=True, repr=False)
class Spectrum(Abridged):
    """Singular values of the observability matrix in units of the prior 1-sigmas, and what follows from them.

    Attributes
    ----------
    names : tuple of str
    values : ndarray, shape (n,)
        Descending. A direction of value ``s`` is known from the measurements alone to ``1 / s`` of its prior 1-sigma.
    directions : ndarray, shape (n, n)
        Rows: orthonormal directions in scaled states, order of ``values``.
    sigma : ndarray, shape (n,)
        Scale of the states.
    doubt : float
        Largest change of a singular value that rounding and discretisation can have made.

    Notes
    -----
    None of the three thresholds knows which system it is applied to.

    ``formal``: values above ``doubt``. By Weyl's theorem an error ``E`` of the matrix moves no singular value by more
    than ``||E||``; what is larger is not zero. ``doubt`` is the norm of the difference between two discretisations,
    plus ``n eps s_1`` for rounding.

    ``rank``: that of the Gramian by the rule of ``numpy.linalg.matrix_rank`` and MATLAB's ``rank``: eigenvalues above
    ``n eps`` of the largest. Eigenvalues are squares of ``values``, so it is blind below ``sqrt(n eps)`` = 5e-8 of the
    largest. This is the rank that tables of observability usually show.

    ``useful``: values above 1. The measurements know such a direction better than it was known before.
    """

    names: tuple[str, ...]
    values: FloatArray
    directions: FloatArray
    sigma: FloatArray
    doubt: float

    @property
    def formal(self) -> int:
        """Number of directions seen at all, however weakly."""
        return int(np.sum(self.values > self.doubt))

    @property
    def rank(self) -> int:
        """Rank of the Gramian as double precision has it."""
        if not self.values[0] > 0.0:
            return 0
        return int(np.sum(np.square(self.values / self.values[0]) > len(self.values) * _EPS))

    @property
    def useful(self) -> int:
        """Number of directions that the measurements know better than the prior."""
        return int(np.sum(self.values > 1.0))

    @property
    def condition(self) -> float:
        """Largest over smallest singular value that is not zero."""
        return float(self.values[0] / self.values[self.formal - 1]) if self.formal else float("inf")

    def chosen(self, which: str) -> int:
        """One of the three ranks by name."""
        if which not in ("formal", "rank", "useful"):
            raise InputError(f"rank: expected 'formal', 'rank' or 'useful', got {which!r}")
        return int(getattr(self, which))

    def null_space(self, which: str = "formal") -> FloatArray:
        """Scaled directions that are not seen, rows. Shape (n - rank, n)."""
        return np.asarray(self.directions[self.chosen(which) :])

    def observable(self, which: str = "formal") -> BoolArray:
        """Which states are seen one by one: no unseen direction has a part of them. Shape (n,).

        Notes
        -----
        The unseen subspace itself is known to ``doubt / s_r`` only (Wedin's theorem); parts below that, at least 1e-6,
        count as none. With ``useful`` a state counts as seen if less than a tenth of it is in unseen directions.
        """
        r = self.chosen(which)
        part = np.linalg.norm(self.directions[r:], axis=0)
        if which == "useful":
            return np.asarray(part < _TENTH)
        return np.asarray(part <= max(1e-6, self.blur(r)))

    def blur(self, r: int) -> float:
        """Angle by which the subspace of the first ``r`` directions may be wrong. [rad]"""
        return float(min(10.0 * self.doubt / self.values[r - 1], 0.1)) if r else 0.0


_TENTH = 0.1


def spectrum(system: LinearSystem, *, until: float | None = None) -> Spectrum:
    """Singular values of the observability matrix of all measurements, for the state at the start.

    Parameters
    ----------
    system : LinearSystem
    until : float, optional
        Only measurements up to then. [s]

    Returns
    -------
    Spectrum

    Notes
    -----
    Rows are ``R^-1/2 H_k Phi(t_k, t_0) S`` with ``S`` the prior 1-sigmas; their cross product is the discrete Gramian.
    It is never formed: triangular factors are accumulated, which keeps twice the digits.

    References
    ----------
    Gelb (1974), section 3.5; Ham and Brown (1983) for the scaling by the prior; Golub and Van Loan (2013), sections
    5.2 and 8.6 (Weyl, Wedin).
    """
    used = system if until is None else system.until(until)
    R, doubt = _factor(used, slice(None), np.zeros((0, used.n)), 0.0)
    return _spectrum(used, R, doubt)


def spectra(system: LinearSystem, times: ArrayLike) -> list[Spectrum]:
    """Spectra of the measurements up to each time, in one pass. Times increasing. [s]"""
    times = np.asarray(times, dtype=np.float64)
    if np.any(np.diff(times) <= 0.0):
        raise InputError("times: expected increasing numbers")
    out: list[Spectrum] = []
    R, doubt, first = np.zeros((0, system.n)), 0.0, 0
    at = system.t[system.at]
    for time in times:
        last = int(np.searchsorted(at, time + 1e-9, side="right"))
        R, doubt = _factor(system, slice(first, last), R, doubt)
        out.append(_spectrum(system, R, doubt))
        first = last
    return out


def scaled_rows(system: LinearSystem, part: slice = slice(None)) -> FloatArray:
    """Rows of the observability matrix in units of the prior. Shape (3 u, n)."""
    rows = system.H[part] @ system.phi[system.at[part]] * system.sigma
    return np.asarray(rows.reshape(-1, system.n))


def _factor(system: LinearSystem, part: slice, R: FloatArray, doubt: float) -> tuple[FloatArray, float]:
    """Triangular factor of the rows so far, and the norm of what their transitions may be wrong by."""
    if not len(system.at[part]):
        return R, doubt
    # a bounded number of rows at a time, each block added to the factor of those before
    rows = scaled_rows(system, part)
    for start in range(0, len(rows), 3000):
        R = np.asarray(np.linalg.qr(np.vstack((R, rows[start : start + 3000])), mode="r"))
    if system.doubt is not None:
        E = (np.abs(system.H[part]) @ system.doubt[system.at[part]] * system.sigma).reshape(-1, system.n)
        doubt = float(np.hypot(doubt, np.linalg.norm(E)))
    return R, doubt


def _spectrum(system: LinearSystem, R: FloatArray, doubt: float) -> Spectrum:
    n = system.n
    full = np.zeros((n, n))
    full[: len(R)] = R
    _, s, V = np.linalg.svd(full)
    return Spectrum(system.names, s, V, system.sigma, doubt + n * _EPS * float(s[0]))
