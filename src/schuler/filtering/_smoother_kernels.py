"""Compiled fixed-interval smoother: the backward pass over the nodes a forward run has kept.

Modified Bryson-Frazier form of the Rauch-Tung-Striebel smoother: the adjoint ``lam`` and its information ``Lam`` run
backwards through the same transitions and updates the filter used, and no covariance is inverted.

With the update ``dx = W' e``, ``P - W' W``, ``G = L^-1 H`` of the filter (error = estimate - truth)::

    across an update:      lam <- lam - G' (W lam) - G' e      Lam <- (I - G' W) Lam (I - W' G) + G' G
    across a transition:   lam <- Phi' lam                     Lam <- Phi' Lam Phi
    smoothed state:        x + P lam                           covariance P - P Lam P      (before the update)

References
----------
Bierman (1973), Int. J. Control 18(3), 625-639; Gelb (1974), section 5.2.
"""

from __future__ import annotations

import math

import numpy as np

from schuler.filtering._covariance_kernels import _S, _U, PAD, padded, transition
from schuler.jit import inlined, kernel, prepare
from schuler.mechanization._kernels import half_angle_series


@inlined
def transpose_rows(Phi, D, x, o, w, n):
    """``o = Phi' x``: rows of flat arrays PAD long; Phi (9, PAD) are the navigation rows, D the parameter diagonal."""
    for i in range(n):
        a0, a1, a2, a3, a4 = Phi[0, i], Phi[1, i], Phi[2, i], Phi[3, i], Phi[4, i]
        a5, a6, a7, a8 = Phi[5, i], Phi[6, i], Phi[7, i], Phi[8, i]
        t = _U(i) * _S
        if i < 9:
            for j in range(w):
                o[t + j] = (
                    a0 * x[j] + a1 * x[_S + j] + a2 * x[_U(2) * _S + j]
                    + a3 * x[_U(3) * _S + j] + a4 * x[_U(4) * _S + j] + a5 * x[_U(5) * _S + j]
                    + a6 * x[_U(6) * _S + j] + a7 * x[_U(7) * _S + j] + a8 * x[_U(8) * _S + j]
                )  # fmt: skip
        else:
            d = D[i - 9]
            for j in range(w):
                o[t + j] = (
                    d * x[t + j] + a0 * x[j] + a1 * x[_S + j] + a2 * x[_U(2) * _S + j]
                    + a3 * x[_U(3) * _S + j] + a4 * x[_U(4) * _S + j] + a5 * x[_U(5) * _S + j]
                    + a6 * x[_U(6) * _S + j] + a7 * x[_U(7) * _S + j] + a8 * x[_U(8) * _S + j]
                )  # fmt: skip


@kernel
def smooth(node_P, node_phi, node_B, node_upd, upd_W, upd_G, upd_e, pmod, n_sensor, omega, record, minus, plus, rec_P):
    """Run backwards over all nodes.

    Parameters
    ----------
    node_P : float64[k, n (n + 1) / 2]
        Predicted covariances, lower triangles.
    node_phi, node_B, node_upd, upd_W, upd_G, upd_e
        As kept by the filter; updates of node i are ``node_upd[i - 1] .. node_upd[i]``.
    record : int64[k]
        Row of ``rec_P`` for a node's smoothed covariance, or -1.
    minus, plus : float64[k, n]
        Output: what to add to the filter's state before and after the updates of each node (attitude: a rotation
        vector in Earth-fixed axes applied on the left).
    rec_P : float64[r, n (n + 1) / 2]
        Output: smoothed covariances.
    """
    n_nodes = node_P.shape[0]
    n = minus.shape[1]
    m = n - 9
    wide = padded(n)
    lam, c, inj = np.zeros(n), np.zeros(n), np.zeros(n)
    Lam, M, Mt = np.zeros((n, PAD)), np.zeros((n, PAD)), np.zeros((n, PAD))
    V, Phi, A = np.zeros((3, PAD)), np.zeros((9, PAD)), np.zeros((9, 9))
    D, acc, nav = np.ones(max(m, 1)), np.zeros(8), np.zeros(10)
    S, P, X = np.zeros((3, 3)), np.zeros((n, PAD)), np.zeros((n, PAD))
    A[2, 2] = 1.0
    for node in range(n_nodes - 1, -1, -1):
        first = node_upd[node - 1] if node > 0 else 0
        for i in range(n):
            inj[i] = 0.0
        for u in range(node_upd[node] - 1, first - 1, -1):
            W, G, e = upd_W[u], upd_G[u], upd_e[u]
            for a in range(3):
                v = V[a]
                for j in range(wide):
                    v[j] = 0.0
                s = e[a]
                for i in range(n):
                    w = W[a, i]
                    s += w * lam[i]
                    row = Lam[i]
                    for j in range(wide):
                        v[j] += w * row[j]
                c[a] = s
            for a in range(3):
                for b in range(3):
                    s = 1.0 if a == b else 0.0
                    for i in range(n):
                        s += V[a, i] * W[b, i]
                    S[a, b] = s
            for a in range(3):
                g = G[a]
                for i in range(n):
                    lam[i] -= g[i] * c[a]
                    inj[i] += W[a, i] * e[a]
            # U = V - S G / 2, then Lam - G' U - U' G keeps the symmetry
            for a in range(3):
                v = V[a]
                for b in range(3):
                    s = 0.5 * S[a, b]
                    for j in range(n):
                        v[j] -= s * G[b, j]
            for a in range(3):
                g, v = G[a], V[a]
                for i in range(n):
                    row, x, y = Lam[i], g[i], v[i]
                    for j in range(n):
                        row[j] -= x * v[j] + y * g[j]
        packed = node_P[node]
        symv(packed, lam, c, n)
        for i in range(n):
            minus[node, i] = c[i]
            plus[node, i] = c[i] + inj[i]
        if record[node] >= 0:
            unpack(packed, P, n)
            for i in range(n):
                row = X[i]
                for j in range(wide):
                    row[j] = 0.0
                for k in range(n):
                    v, other = P[i, k], Lam[k]
                    for j in range(wide):
                        row[j] += v * other[j]
            out, o = rec_P[record[node]], 0
            for i in range(n):
                for j in range(i + 1):
                    v = P[i, j]
                    for k in range(n):
                        v -= X[i, k] * P[k, j]
                    out[o] = v
                    o += 1
        if node == 0:
            break
        T = node_phi[node, 0]
        for i in range(8):
            acc[i] = node_phi[node, i]
        for i in range(3):
            nav[7 + i] = node_phi[node, 8 + i]
        transition(A, acc, nav, omega)
        for i in range(9):
            p = Phi[i]
            for j in range(9):
                p[j] = A[i, j]
            for k in range(n_sensor):
                p[9 + k] = node_B[node, i, k]
        for k in range(m):
            if pmod[k, 0] > 0.0:
                D[k] = math.exp(-pmod[k, 0] * T)
        for i in range(n):
            s = D[i - 9] * lam[i] if i >= 9 else 0.0
            for k in range(9):
                s += Phi[k, i] * lam[k]
            c[i] = s
        for i in range(n):
            lam[i] = c[i]
        w = _U(wide)
        transpose_rows(Phi, D, Lam.reshape(Lam.size), M.reshape(M.size), w, n)
        for i in range(n):
            for j in range(n):
                Mt[j, i] = M[i, j]
        transpose_rows(Phi, D, Mt.reshape(Mt.size), Lam.reshape(Lam.size), w, n)
    return 0


@inlined
def symv(packed, x, y, n):
    """``y = P x`` with the lower triangle of P."""
    o = 0
    for i in range(n):
        s = 0.0
        for j in range(i):
            p = packed[o + j]
            s += p * x[j]
            y[j] += p * x[i]
        y[i] = s + packed[o + i] * x[i]
        o += i + 1


@inlined
def unpack(packed, P, n):
    """Full symmetric matrix of a lower triangle."""
    o = 0
    for i in range(n):
        for j in range(i + 1):
            P[i, j] = packed[o + j]
            P[j, i] = packed[o + j]
        o += i + 1


@kernel
def apply_corrections(t, q, v, r, node_t, minus, plus):
    """Add the smoother's corrections, interpolated between nodes, to a trajectory in place."""
    j = 0
    last = node_t.shape[0] - 1
    for k in range(t.shape[0]):
        while j < last and node_t[j + 1] <= t[k] + 1e-9:
            j += 1
        s = 0.0
        if j < last:
            s = max(0.0, (t[k] - node_t[j]) / (node_t[j + 1] - node_t[j]))
            if s < 1e-9:
                s = 0.0
        a, b = plus[j], minus[min(j + 1, last)]
        x, y, z = (1.0 - s) * a[0] + s * b[0], (1.0 - s) * a[1] + s * b[1], (1.0 - s) * a[2] + s * b[2]
        c, h = half_angle_series(x, y, z)
        x, y, z = h * x, h * y, h * z
        p = q[k]
        p0, p1, p2, p3 = p[0], p[1], p[2], p[3]
        p[0] = c * p0 - x * p1 - y * p2 - z * p3
        p[1] = c * p1 + x * p0 + y * p3 - z * p2
        p[2] = c * p2 - x * p3 + y * p0 + z * p1
        p[3] = c * p3 + x * p2 - y * p1 + z * p0
        for i in range(3):
            v[k, i] += (1.0 - s) * a[3 + i] + s * b[3 + i]
            r[k, i] += (1.0 - s) * a[6 + i] + s * b[6 + i]


def prepare_smoother() -> None:
    """Compile or load the smoother's kernels before they are timed or run."""
    import numba as nb

    f, m, c, i = nb.float64[::1], nb.float64[:, ::1], nb.float64[:, :, ::1], nb.int64[::1]
    prepare(
        [
            (smooth, (m, m, c, i, c, c, m, m, nb.int64, nb.float64, i, m, m, m)),
            (apply_corrections, (f, m, m, m, f, m, m)),
        ]
    )
