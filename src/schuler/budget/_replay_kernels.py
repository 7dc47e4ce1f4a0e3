"""Compiled replays of a linearised run: the filter's covariance, error sensitivities, covariances of noise by source.

A run is linearised once (``record.py``): transitions between nodes and rows of H. Every IMU, filter and error source
is then a replay through the same nodes with other noise, in the arithmetic of the engine (``filtering.kernels``).

Nodes are tuples of arrays (``nodes.Nodes``):

``acc[k, 8]``, ``place[k, 3]``, ``B[k, 9, s]``   transition into node k, sensor columns of the system replayed
``upd[k]``                                     updates up to and at node k
``H[u, 3, n]``, ``R[u, 9]``, ``dim[u]``           rows, covariance and number of components of every update
``nodes.rec[k]``                                     row of the output for node k, or -1
``Q[k, 2, 9]``                                 noise of one axis before and after the transition into node k, or empty
``U[k, 9, e]``, ``V[u, 3, e]``                   what the last e constants add in a transition, and to an update
"""

from __future__ import annotations

import math

import numpy as np

from schuler.budget.nodes import Nodes
from schuler.filtering.filter_arrays import Model, Workspace
from schuler.filtering.kernels.covariance import add_clock_drift, add_half_noise, decay, flush, padded, transition
from schuler.filtering.kernels.update import AT_CLOCK
from schuler.jit import inlined, kernel, prepare


@inlined
def propagate(P, nav, acc, place, B, model, work):
    """Carry a covariance into a node, noise by the trapezoid rule as the engine does."""
    T, Bk, n_sensor = acc[0], work.B, model.n_sensor
    for i in range(3):
        nav[7 + i] = place[i]
    for k in range(n_sensor):
        for i in range(9):
            Bk[k, i] = B[i, k]
    decays = decay(model.dynamics, T, work.left, work.mean)
    add_half_noise(P, nav, T, model.psd, model.dynamics)
    flush(
        P, nav, acc, work.A, Bk, work.rows, work.turned, work.left, work.mean, model.on_attitude, n_sensor, decays,
        model.omega,
    )  # fmt: skip
    add_clock_drift(P, model.places[AT_CLOCK], T)
    add_half_noise(P, nav, T, model.psd, model.dynamics)


@inlined
def invert(S, d, L, V):
    """Inverse ``V`` of the first d <= 3 rows and columns of a symmetric positive matrix by its Cholesky factor.

    ``L`` is workspace, and holds the inverse of the factor in the end.
    """
    for a in range(d):
        for b in range(a + 1):
            v = S[a, b]
            for k in range(b):
                v -= L[a, k] * L[b, k]
            if a == b:
                L[a, a] = math.sqrt(v)
            else:
                L[a, b] = v / L[b, b]
    for j in range(d):  # column by column: what is right of it is still the factor
        L[j, j] = 1.0 / L[j, j]
        for a in range(j + 1, d):
            v = 0.0
            for k in range(j, a):
                v -= L[a, k] * L[k, j]
            L[a, j] = v / L[a, a]
    for a in range(d):
        for b in range(d):
            v = 0.0
            for k in range(max(a, b), d):
                v += L[k, a] * L[k, b]
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
def replay_filter(nodes, P, model, work, K, out_P):
    """Covariance of a filter through all nodes; gains ``K[u, n, 3]`` and records ``out_P[r, n, n]`` are written."""
    n = P.shape[0]
    wide = padded(n)
    nav = np.zeros(10)
    nav[0] = 1.0
    W, S, V = work.W, work.S, work.U
    u = 0
    for k in range(nodes.acc.shape[0]):
        if nodes.acc[k, 0] > 0.0:
            propagate(P, nav, nodes.acc[k], nodes.place[k], nodes.B[k], model, work)
        while u < nodes.upd[k]:
            d = nodes.dim[u]
            innovation(P, nodes.H[u], nodes.R[u], d, n, wide, W, S)
            invert(S, d, work.L, V)
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
        if nodes.rec[k] >= 0:
            o = out_P[nodes.rec[k]]
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
def replay_covariance(nodes, C, model, work, Q, i_axis, K, rows, out):
    """Covariance of the true error from one kind of noise, with given gains.

    ``rows`` are the replayed system's places of the filter's states, the rest are not corrected; ``R`` is the noise of
    the updates that counts here, zero for other sources. ``out[r, 9, 9]`` receives the navigation part.
    """
    one_axis = Q.shape[0] > 0
    n, n_f = C.shape[0], K.shape[1]
    nav = np.zeros(10)
    nav[0] = 1.0
    wide = padded(n)
    W, S, G = work.W, work.S, work.G
    u = 0
    for k in range(nodes.acc.shape[0]):
        if nodes.acc[k, 0] > 0.0:
            if one_axis:
                add_axis_noise(C, Q[k, 0], i_axis)
            propagate(C, nav, nodes.acc[k], nodes.place[k], nodes.B[k], model, work)
            if one_axis:
                add_axis_noise(C, Q[k, 1], i_axis)
        while u < nodes.upd[k]:
            d = nodes.dim[u]
            innovation(C, nodes.H[u], nodes.R[u], d, n, wide, W, S)
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
        if nodes.rec[k] >= 0:
            o = out[nodes.rec[k]]
            for i in range(9):
                for j in range(9):
                    o[i, j] = C[i, j]


@kernel
def replay_columns(nodes, X, U, V, model, work, K, rows, out):
    """Sensitivities of the true error to constants: columns of ``X[n, c]``, with given gains.

    The last columns belong to constants that are no states
    and act by ``U`` and ``V``. ``out[r, 9, c]`` receives the navigation part.
    """
    n, c, n_f, e_u = X.shape[0], X.shape[1], K.shape[1], U.shape[2]
    first = c - e_u
    n_sensor, i_clock, rates, A = model.n_sensor, model.places[AT_CLOCK], model.dynamics, work.A
    nav = np.zeros(10)
    N, E = np.zeros((9, c)), np.zeros((3, c))
    u = 0
    for k in range(nodes.acc.shape[0]):
        T = nodes.acc[k, 0]
        if T > 0.0:
            for i in range(3):
                nav[7 + i] = nodes.place[k, i]
            transition(A, nodes.acc[k], nav, model.omega)
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
                    v, x = nodes.B[k, i, b], X[9 + b]
                    if rates[b, 0] > 0.0:
                        z = rates[b, 0] * T
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
                if rates[b, 0] > 0.0:
                    v, x = math.exp(-rates[b, 0] * T), X[9 + b]
                    for j in range(c):
                        x[j] *= v
            if i_clock >= 0:
                for j in range(c):
                    X[i_clock, j] += T * X[i_clock + 1, j]
        while u < nodes.upd[k]:
            d = nodes.dim[u]
            for a in range(d):
                e = E[a]
                for j in range(c):
                    e[j] = 0.0 if j < first else V[u, a, j - first]
                for i in range(n):
                    v, x = nodes.H[u, a, i], X[i]
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
        if nodes.rec[k] >= 0:
            o = out[nodes.rec[k]]
            for i in range(9):
                for j in range(c):
                    o[i, j] = X[i, j]


def prepare_replay() -> None:
    """Compile or load the replays before they are timed or run."""
    import numba as nb

    x, i = nb.float64, nb.int64
    f, m, c, k, km = x[::1], x[:, ::1], x[:, :, ::1], i[::1], i[:, ::1]

    def of(cls, *types):
        return nb.types.NamedTuple(types, cls)

    nodes = of(Nodes, m, m, c, k, c, m, k, k)
    model = of(Model, km, m, k, k, f, f, i, nb.boolean, nb.boolean, nb.boolean, x)
    work = nb.typeof(Workspace.of_size(9, 1))
    prepare(
        [
            (replay_filter, (nodes, m, model, work, c, c)),
            (replay_covariance, (nodes, m, model, work, c, i, c, k, c)),
            (replay_columns, (nodes, m, c, c, model, work, c, k, c)),
        ]
    )
