"""Noise as a linear system: continuous, and exactly sampled.

Both forms give what filters and fits need - Phi and Qd, covariances, spectra, Allan variances, realisations - without a
closed form for the process at hand.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields
from math import pi

import numpy as np

from schuler.arrays import ArrayLike, FloatArray, as_floats, readonly
from schuler.plotting.notebook import Abridged
from schuler.sensors.noise._checks import Shape, count, frequencies, magnitude, positive, shape_of, times


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class StateSpace(Abridged):
    """Noise in continuous time, ``s' = F s + w`` and ``x = H s + v``.

    Attributes
    ----------
    F : ndarray, shape (k, k)
        [1/s]
    Q : ndarray, shape (k, k)
        Two-sided density of the drive w: over a short ``dt`` it adds ``Q dt`` to the covariance of s.
    H : ndarray, shape (k,)
        Output row.
    P0 : ndarray, shape (k, k)
        Covariance of s at the first sample, with mean zero.
    white : float
        Density of v, white noise straight to the output: ``N^2``, variance ``N^2 / dt`` in a mean over ``dt``. [x^2/Hz]
    rounding : float
        Variance ``Q^2`` of white noise on the integral of x at every sample. It has no continuous form; in x it is
        ``(e[k] - e[k-1]) / dt``. [(x s)^2]

    Raises
    ------
    InputError
        If shapes disagree or a value is not finite.
    """

    F: FloatArray
    Q: FloatArray
    H: FloatArray
    P0: FloatArray
    white: float = 0.0
    rounding: float = 0.0

    def __post_init__(self) -> None:
        _freeze(self, "F", ("Q", "P0"))
        magnitude(self.white, "white")
        magnitude(self.rounding, "rounding")

    def discrete(self, dt: float) -> tuple[FloatArray, FloatArray]:
        """Exact transition matrix and covariance of the drive over an interval.

        Parameters
        ----------
        dt : float
            [s]

        Returns
        -------
        Phi, Qd : ndarray, shape (k, k)
            ``s[k+1] = Phi s[k] + u[k]``, ``u ~ N(0, Qd)``, for any ``dt``.

        Raises
        ------
        InputError
            If dt is not positive.

        Notes
        -----
        Van Loan's matrix exponential contains ``exp(-F dt)``, which ruins it where ``dt`` is many time constants. It is
        taken over ``dt / 2^j`` with ``|F| dt / 2^j < 1/2`` and doubled j times by ``Qd <- Phi Qd Phi' + Qd``, a sum of
        positive terms.

        References
        ----------
        Van Loan (1978), IEEE Trans. Automatic Control 23(3), 395-404.
        """
        return discretised(self.F, self.Q, positive(dt, "dt"))

    def sampled(self, dt: float) -> SampledStateSpace:
        """The process sampled every ``dt`` [s]: its states as points, its white noise as means over the interval."""
        Phi, Qd = self.discrete(dt)
        system = SampledStateSpace(Phi, Qd, self.H, self.P0, self.white / dt, dt)
        if self.rounding == 0.0:
            return system
        # states e[k], e[k-1]
        delay, first = np.array([[0.0, 0.0], [1.0, 0.0]]), np.diag([self.rounding, 0.0])
        e = SampledStateSpace(delay, first, np.array([1.0, -1.0]) / dt, self.rounding * np.eye(2), 0.0, dt)
        return SampledStateSpace.sum([system, e], dt)

    def allan_variance(self, tau: ArrayLike) -> FloatArray:
        """Allan variance of the continuous process, clusters being means over ``tau`` [s], exact. [x^2]

        Rounding counts as ``3 Q^2 / tau^2``: the ends of the clusters are samples.
        """
        tau = times(tau)
        out = np.empty(tau.shape)
        k = len(self.H)
        F = np.zeros((k + 1, k + 1))
        F[:k, :k], F[k, :k] = self.F, self.H
        Q = np.zeros_like(F)
        Q[:k, :k] = self.Q
        for i, value in np.ndenumerate(tau):
            T = float(value)
            v = cluster_variance(*discretised(F, Q, T), self.P0)
            out[i] = 0.5 * v / T**2 + self.white / T + 3.0 * self.rounding / T**2
        return out

    def psd(self, f: ArrayLike) -> FloatArray:
        """Two-sided density ``H (j w - F)^-1 Q (j w - F)^-H H' + white`` at frequencies ``f`` [Hz]. [x^2/Hz]

        Rounding is left out, since its density depends on the sampling interval: see :meth:`SampledStateSpace.psd`.
        """
        return density(2j * pi * frequencies(f), self.F, self.Q, self.H) + self.white

    @classmethod
    def sum(cls, parts: Sequence[StateSpace]) -> StateSpace:
        """Independent systems side by side, outputs added; none at all is no noise."""
        F, Q, P0 = (diagonal([getattr(p, name) for p in parts]) for name in ("F", "Q", "P0"))
        H = np.concatenate([np.empty(0), *(p.H for p in parts)])
        return cls(F, Q, H, P0, sum(p.white for p in parts), sum(p.rounding for p in parts))


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class SampledStateSpace(Abridged):
    """Noise at its samples, ``s[k+1] = Phi s[k] + u[k]`` and ``x[k] = H s[k] + v[k]``.

    Attributes
    ----------
    Phi, Qd : ndarray, shape (k, k)
        Transition matrix and covariance of u.
    H : ndarray, shape (k,)
    P0 : ndarray, shape (k, k)
        Covariance of s[0], with mean zero.
    R : float
        Variance of v, white. [x^2]
    dt : float
        Sampling interval. [s]

    Raises
    ------
    InputError
        If shapes disagree, R is negative or dt not positive.
    """

    Phi: FloatArray
    Qd: FloatArray
    H: FloatArray
    P0: FloatArray
    R: float
    dt: float

    def __post_init__(self) -> None:
        _freeze(self, "Phi", ("Qd", "P0"))
        magnitude(self.R, "R")
        positive(self.dt, "dt")

    def covariance(self, n: int) -> FloatArray:
        """Covariance matrix of the first ``n`` samples, shape (n, n). [x^2]"""
        n = count(n, "n")
        out, P, k = np.zeros((n, n)), np.array(self.P0), len(self.H)
        for i in range(n):
            row = P @ self.H
            for j in range(i, n if k else i):
                out[i, j] = out[j, i] = self.H @ row
                row = self.Phi @ row
            P = self.Phi @ P @ self.Phi.T + self.Qd
        out[np.diag_indices(n)] += self.R
        return out

    def sample(self, n: Shape, rng: np.random.Generator) -> FloatArray:
        """Draw samples with these covariances, time along axis 0. [x]

        Parameters
        ----------
        n : int or tuple of int
            Number of samples, or the shape; columns are independent.
        rng : numpy.random.Generator

        Returns
        -------
        ndarray, shape n

        Notes
        -----
        The states are drawn in the unitary basis of the Schur form of Phi, where the recursion is a chain of
        first-order filters; unlike a basis of eigenvectors it is well conditioned for equal roots too.
        """
        from scipy.linalg import schur
        from scipy.signal import lfilter

        shape, k = shape_of(n), len(self.H)
        x = np.zeros(shape)
        if k:
            u = np.tensordot(root(self.Qd), rng.standard_normal((k, *shape)), axes=1)
            u[:, :1] = np.tensordot(root(self.P0), rng.standard_normal((k, *u[:, :1].shape[1:])), axes=1)
            T, U = schur(self.Phi, output="complex")
            drive = np.tensordot(U.conj().T, u, axes=1)
            for i in reversed(range(k)):
                drive[i] = lfilter([1.0], [1.0, -T[i, i]], drive[i], axis=0)
                for j in range(i):
                    drive[j, 1:] += T[j, i] * drive[i, :-1]
            x += np.tensordot(self.H @ U, drive, axes=1).real
        return x + np.sqrt(self.R) * rng.standard_normal(shape) if self.R else x

    def allan_variance(self, m: ArrayLike) -> FloatArray:
        """Allan variance of the series, clusters being means of ``m`` samples, exact. [x^2]

        For a process that is not stationary: of its first two clusters.
        """
        m, k = np.asarray(m), len(self.H)
        out = np.empty(m.shape)
        Phi = np.zeros((k + 1, k + 1))
        Phi[:k, :k], Phi[k, :k], Phi[k, k] = self.Phi, self.H, 1.0
        Q = np.zeros_like(Phi)
        Q[:k, :k] = self.Qd
        for i, size in np.ndenumerate(m):
            size = count(size, "m")
            v = cluster_variance(*repeated(Phi, Q, size), self.P0)
            out[i] = 0.5 * v / size**2 + self.R / size
        return out

    def psd(self, f: ArrayLike) -> FloatArray:
        """Two-sided density of the series at frequencies ``f`` [Hz], periodic in the sampling rate. [x^2/Hz]

        Its mean over one period, times the rate, is the variance; aliases are therefore folded in.
        """
        z = np.exp(2j * pi * frequencies(f) * self.dt)
        return self.dt * (density(z, self.Phi, self.Qd, self.H) + self.R)

    @classmethod
    def sum(cls, parts: Sequence[SampledStateSpace], dt: float) -> SampledStateSpace:
        """Independent systems of the same ``dt`` [s] side by side, outputs added; none at all is no noise."""
        Phi, Qd, P0 = (diagonal([getattr(p, name) for p in parts]) for name in ("Phi", "Qd", "P0"))
        H = np.concatenate([np.empty(0), *(p.H for p in parts)])
        return cls(Phi, Qd, H, P0, sum(p.R for p in parts), dt)


def _freeze(system: StateSpace | SampledStateSpace, first: str, others: tuple[str, ...]) -> None:
    H = as_floats(system.H, "H", (None,))
    shapes = {"H": H.shape} | dict.fromkeys((first, *others), H.shape * 2)
    for entry in fields(system):
        if entry.name in shapes:
            value = as_floats(getattr(system, entry.name), entry.name, shapes[entry.name])
            object.__setattr__(system, entry.name, readonly(value.copy()))


def diagonal(blocks: list[FloatArray]) -> FloatArray:
    """Block-diagonal matrix; none gives shape (0, 0)."""
    out = np.zeros((sum(len(b) for b in blocks),) * 2)
    at = 0
    for b in blocks:
        out[at : at + len(b), at : at + len(b)] = b
        at += len(b)
    return out


def discretised(F: FloatArray, Q: FloatArray, dt: float) -> tuple[FloatArray, FloatArray]:
    """Transition matrix and covariance of the drive over ``dt`` [s]; see :meth:`StateSpace.discrete`."""
    from scipy.linalg import expm

    k = len(F)
    if k == 0:
        return np.zeros((0, 0)), np.zeros((0, 0))
    doublings = max(0, int(np.ceil(np.log2(max(2.0 * dt * float(np.abs(F).sum(axis=1).max()), 1e-300)))))
    h = dt / 2.0**doublings
    # the scale of Q does not enter the exponential, so that 1e-20 is as exact as 1
    scale = float(np.abs(Q).max()) or 1.0
    A = np.zeros((2 * k, 2 * k))
    A[:k, :k], A[:k, k:], A[k:, k:] = -F * h, Q / scale * h, F.T * h
    E = expm(A)
    Phi = E[k:, k:].T
    Qd = scale * Phi @ E[:k, k:]
    for _ in range(doublings):
        Phi, Qd = then(Phi, Qd, Phi, Qd)
    return Phi, 0.5 * (Qd + Qd.T)


def then(Phi: FloatArray, Q: FloatArray, Phi_2: FloatArray, Q_2: FloatArray) -> tuple[FloatArray, FloatArray]:
    """One interval after another."""
    return Phi_2 @ Phi, Phi_2 @ Q @ Phi_2.T + Q_2


def repeated(Phi: FloatArray, Q: FloatArray, m: int) -> tuple[FloatArray, FloatArray]:
    """The same interval m times, by squaring."""
    total = np.eye(len(Phi)), np.zeros_like(Phi)
    while m:
        if m & 1:
            total = then(*total, Phi, Q)
        Phi, Q = then(Phi, Q, Phi, Q)
        m >>= 1
    return total


def cluster_variance(Phi: FloatArray, Q: FloatArray, P0: FloatArray) -> float:
    """Variance of the difference of two successive sums; the last state of Phi, Q is the sum over one cluster."""
    k = len(P0)
    C, E = Phi[k, :k], Phi[:k, :k] - np.eye(k)
    a = E.T @ C  # first state: through the second cluster less the first
    b = np.append(C, -1.0)  # drive of the first cluster
    return float(a @ P0 @ a + b @ Q @ b + Q[k, k])


def density(z: np.ndarray, A: FloatArray, Q: FloatArray, H: FloatArray) -> FloatArray:
    """``H (z - A)^-1 Q (z - A)^-H H'`` at every z."""
    k = len(H)
    if k == 0:
        return np.zeros(np.shape(z))
    g = np.linalg.solve(np.swapaxes(np.multiply.outer(z, np.eye(k)) - A, -1, -2), H[:, None])[..., 0]
    return np.asarray(np.einsum("...i,ij,...j->...", g, Q, g.conj()).real)


def root(P: FloatArray) -> FloatArray:
    """L with ``L L' = P`` for a positive semidefinite P."""
    values, vectors = np.linalg.eigh(P)
    return np.asarray(vectors * np.sqrt(np.maximum(values, 0.0)))
