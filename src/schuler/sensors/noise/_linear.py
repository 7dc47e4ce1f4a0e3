"""Matrices of linear systems driven by white noise."""

from __future__ import annotations

import numpy as np

from schuler.arrays import FloatArray


def diagonal(blocks: list[FloatArray]) -> FloatArray:
    """Block-diagonal matrix; none gives shape (0, 0)."""
    out = np.zeros((sum(len(b) for b in blocks),) * 2)
    at = 0
    for b in blocks:
        out[at : at + len(b), at : at + len(b)] = b
        at += len(b)
    return out


def discretised(F: FloatArray, Q: FloatArray, dt: float) -> tuple[FloatArray, FloatArray]:
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
