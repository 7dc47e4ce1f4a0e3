"""Compiled replays of a linearised run: the filter's covariance, error sensitivities, covariances of noise by source.

A run is linearised once (``record.py``): transitions between nodes and rows of H. Every IMU, filter and error source
is then a replay through the same nodes with other noise, in the arithmetic of the engine (``_covariance_kernels``).

``acc[k, 8]``, ``place[k, 3]``, ``B[k, 9, s]``   transition into node k, sensor columns of the system replayed
``upd[k]``                                     updates up to and at node k
``H[u, 3, n]``, ``R[u, 9]``, ``dim[u]``           rows, covariance and number of components of every update
``rec[k]``                                     row of the output for node k, or -1
``Q[k, 2, 9]``                                 noise of one axis before and after the transition into node k, or empty
``U[k, 9, e]``, ``V[u, 3, e]``                   what the last e constants add in a transition, and to an update
"""

from __future__ import annotations

import math

import numpy as np

from schuler.filtering.kernels.covariance import PAD, add_half_noise, flush, padded, transition
from schuler.jit import inlined, kernel, prepare


@inlined
def step(P, nav, acc, place, B, Bk, A, work, D, pmod, n_sensor, i_clock, omega, q_imu):
    """Carry a covariance into a node, noise by the trapezoid rule as the engine does."""
    m = P.shape[0] - 9
    for i in range(3):
        nav[7 + i] = place[i]
    for i in range(9):
        for j in range(n_sensor):
            Bk[i, j] = B[i, j]
    add_half_noise(P, nav, acc[0], q_imu, pmod, m)
    flush(P, nav, acc, Bk, A, work, D, pmod, n_sensor, i_clock, omega)
    add_half_noise(P, nav, acc[0], q_imu, pmod, m)


@inlined
def invert(S, d, V):
    """Inverse of the first d <= 3 rows and columns of a symmetric positive matrix by its Cholesky factor."""
    L = np.zeros((3, 3))
    for a in range(d):
        for b in range(a + 1):
            v = S[a, b]
            for k in range(b):
                v -= L[a, k] * L[b, k]
            if a == b:
                L[a, a] = math.sqrt(v)
            else:
                L[a, b] = v / L[b, b]
    W = np.zeros((3, 3))
    for j in range(d):
        for a in range(j, d):
            v = 1.0 if a == j else 0.0
            for k in range(j, a):
                v -= L[a, k] * W[k, j]
            W[a, j] = v / L[a, a]
    for a in range(d):
        for b in range(d):
            v = 0.0
            for k in range(d):
                v += W[k, a] * W[k, b]
            V[a, b] = v


@inlined
def innovation(P, H, R, d, n, wide, W, S):
    """``W = H P`` and ``S = H P H' + R`` of an update of d components."""
    for a in range(d):
        w = W[a]
        for j in range(wide):
            w[j] = 0.0
        for i in range(n):
            h = H[a, i]
            if h != 0.0:
                p = P[i]
                for j in range(wide):
                    w[j] += h * p[j]
    for a in range(d):
        for b in range(d):
            v = R[3 * a + b]
            for i in range(n):
                v += H[b, i] * W[a, i]
            S[a, b] = v


@kernel
def replay_filter(
    acc, place, B, upd, H, R, dim, rec, P, pmod, n_sensor, i_clock, omega, q_imu, K, out_P
):  # fmt: skip
    """Covariance of a filter through all nodes; gains ``K[u, n, 3]`` and records ``out_P[r, n, n]`` are written."""
    n = P.shape[0]
    wide = padded(n)
    nav = np.zeros(10)
    nav[0] = 1.0
    A, work, D = np.zeros((9, 9)), np.zeros((18 + n, PAD)), np.zeros(max(n - 9, 1))
    A[2, 2] = 1.0
    Bk = np.zeros((9, max(n_sensor, 1)))
    W, S, V = np.zeros((3, PAD)), np.zeros((3, 3)), np.zeros((3, 3))
    u = 0
    for k in range(acc.shape[0]):
        if acc[k, 0] > 0.0:
            step(P, nav, acc[k], place[k], B[k], Bk, A, work, D, pmod, n_sensor, i_clock, omega, q_imu)
        while u < upd[k]:
            d = dim[u]
            innovation(P, H[u], R[u], d, n, wide, W, S)
            invert(S, d, V)
            for i in range(n):
                for a in range(d):
                    v = 0.0
                    for b in range(d):
                        v += W[b, i] * V[b, a]
                    K[u, i, a] = v
            for i in range(n):
                p = P[i]
                for a in range(d):
                    g = K[u, i, a]
                    w = W[a]
                    for j in range(wide):
                        p[j] -= g * w[j]
            for i in range(n):
                for j in range(i):
                    v = 0.5 * (P[i, j] + P[j, i])
                    P[i, j] = v
                    P[j, i] = v
            u += 1
        if rec[k] >= 0:
            o = out_P[rec[k]]
            for i in range(n):
                for j in range(n):
                    o[i, j] = P[i, j]


@inlined
def add_axis_noise(C, Q, i_axis):
    """Noise of one axis, on attitude (``i_axis`` 0) or velocity (3)."""
    for i in range(3):
        for j in range(3):
            C[i_axis + i, i_axis + j] += Q[3 * i + j]


@kernel
def replay_covariance(
    acc, place, B, upd, H, R, dim, rec, C, pmod, n_sensor, i_clock, omega, q_imu, Q, i_axis, K, rows, out
):  # fmt: skip
    """Covariance of the true error from one kind of noise, with given gains.

    ``rows`` are the replayed system's places of the filter's states, the rest are not corrected; ``R`` is the noise of
    the updates that counts here, zero for other sources. ``out[r, 9, 9]`` receives the navigation part.
    """
    one_axis = Q.shape[0] > 0
    n, n_f = C.shape[0], K.shape[1]
    nav = np.zeros(10)
    nav[0] = 1.0
    A, work, D = np.zeros((9, 9)), np.zeros((18 + n, PAD)), np.zeros(max(n - 9, 1))
    A[2, 2] = 1.0
    Bk = np.zeros((9, max(n_sensor, 1)))
    wide = padded(n)
    W, S, G = np.zeros((3, PAD)), np.zeros((3, 3)), np.zeros((3, PAD))
    u = 0
    for k in range(acc.shape[0]):
        if acc[k, 0] > 0.0:
            if one_axis:
                add_axis_noise(C, Q[k, 0], i_axis)
            step(C, nav, acc[k], place[k], B[k], Bk, A, work, D, pmod, n_sensor, i_clock, omega, q_imu)
            if one_axis:
                add_axis_noise(C, Q[k, 1], i_axis)
        while u < upd[k]:
            d = dim[u]
            innovation(C, H[u], R[u], d, n, wide, W, S)
            for a in range(d):
                for i in range(n_f):
                    G[a, rows[i]] = K[u, i, a]
            # (I - K H) C (I - K H)' + K R K' = C - K V - (K V)' with V = W - S K' / 2
            for a in range(d):
                w = W[a]
                for b in range(d):
                    v, g = 0.5 * S[a, b], G[b]
                    for j in range(wide):
                        w[j] -= v * g[j]
            for i in range(n):
                c = C[i]
                for a in range(d):
                    x, y, w, g = G[a, i], W[a, i], W[a], G[a]
                    for j in range(wide):
                        c[j] -= x * w[j] + y * g[j]
            u += 1
        if rec[k] >= 0:
            o = out[rec[k]]
            for i in range(9):
                for j in range(9):
                    o[i, j] = C[i, j]


@kernel
def replay_columns(acc, place, B, upd, H, dim, rec, X, U, V, decay, n_sensor, i_clock, omega, K, rows, out):
    """Sensitivities of the true error to constants: columns of ``X[n, c]``, with given gains.

    ``decay`` is the inverse correlation time of each parameter. The last columns belong to constants that are no states
    and act by ``U`` and ``V``. ``out[r, 9, c]`` receives the navigation part.
    """
    n, c, n_f, e_u = X.shape[0], X.shape[1], K.shape[1], U.shape[2]
    first = c - e_u
    nav = np.zeros(10)
    A = np.zeros((9, 9))
    A[2, 2] = 1.0
    N, E = np.zeros((9, c)), np.zeros((3, c))
    u = 0
    for k in range(acc.shape[0]):
        T = acc[k, 0]
        if T > 0.0:
            for i in range(3):
                nav[7 + i] = place[k, i]
            transition(A, acc[k], nav, omega)
            for i in range(9):
                row = N[i]
                for j in range(c):
                    row[j] = 0.0
                for b in range(9):
                    v, x = A[i, b], X[b]
                    if v != 0.0:
                        for j in range(c):
                            row[j] += v * x[j]
                for b in range(n_sensor):
                    v, x = B[k, i, b], X[9 + b]
                    if decay[b] > 0.0:
                        z = decay[b] * T
                        v *= -math.expm1(-z) / z
                    if v != 0.0:
                        for j in range(c):
                            row[j] += v * x[j]
                for j in range(e_u):
                    row[first + j] += U[k, i, j]
            for i in range(9):
                for j in range(c):
                    X[i, j] = N[i, j]
            for b in range(n - 9):
                if decay[b] > 0.0:
                    v, x = math.exp(-decay[b] * T), X[9 + b]
                    for j in range(c):
                        x[j] *= v
            if i_clock >= 0:
                for j in range(c):
                    X[i_clock, j] += T * X[i_clock + 1, j]
        while u < upd[k]:
            d = dim[u]
            for a in range(d):
                e = E[a]
                for j in range(c):
                    e[j] = 0.0 if j < first else V[u, a, j - first]
                for i in range(n):
                    v, x = H[u, a, i], X[i]
                    if v != 0.0:
                        for j in range(c):
                            e[j] += v * x[j]
            for i in range(n_f):
                x = X[rows[i]]
                for a in range(d):
                    v, e = K[u, i, a], E[a]
                    for j in range(c):
                        x[j] -= v * e[j]
            u += 1
        if rec[k] >= 0:
            o = out[rec[k]]
            for i in range(9):
                for j in range(c):
                    o[i, j] = X[i, j]


def prepare_replay() -> None:
    """Compile or load the replays before they are timed or run."""
    import numba as nb

    f, m, c = nb.float64[::1], nb.float64[:, ::1], nb.float64[:, :, ::1]
    i, s, x = nb.int64[::1], nb.int64, nb.float64
    nodes = (m, m, c, i, c, m, i, i)
    prepare(
        [
            (replay_filter, (*nodes, m, m, s, s, x, f, c, c)),
            (replay_covariance, (*nodes, m, m, s, s, x, f, c, s, c, i, c)),
            (replay_columns, (m, m, c, i, c, i, i, m, c, c, f, s, s, x, c, i, c)),
        ]
    )
