"""Compiled fixed-interval smoother: the backward pass over the nodes a forward run has kept.

Modified Bryson-Frazier form of the Rauch-Tung-Striebel smoother: the adjoint ``lam`` and its information ``Lam`` run
backwards through the same transitions and updates the filter used, and no covariance is inverted.

With the update ``dx = W' e``, ``P - W' W``, ``G = L^-1 H`` of the filter (error = estimate - truth)::

    across an update:      lam <- lam - G' (W lam) - G' e      Lam <- (I - G' W) Lam (I - W' G) + G' G
    across a transition:   lam <- Phi' lam                     Lam <- Phi' Lam Phi
    smoothed state:        x + P lam                           covariance P - P Lam P      (before the update)

The information is carried as a square root, ``Lam = Y' Y``. Across an update Lam can fall by nine orders of magnitude
(a centimetre fix after hundreds of metres of outage), and what is left of P - P Lam P is as small: multiplied out, this
costs all digits and gives negative variances. The square root keeps half of them. Since parameters do not depend on
the navigation states, only nine of its rows change in a transition.

References
----------
Bierman (1973), Int. J. Control 18(3), 625-639; Gelb (1974), section 5.2. The square root is ours.
"""

from __future__ import annotations

import math

import numpy as np

from schuler.filtering.filter_arrays import SmootherNodes
from schuler.filtering.kernels.axes import TURNED, turn_back
from schuler.filtering.kernels.covariance import PAD, padded, transition
from schuler.filtering.kernels.update import BEGUN
from schuler.jit import inlined, kernel, over_states, prepare
from schuler.mechanization.kernels import half_angle


@inlined
def root_update(Y, Z, W, G, E, R, v, t, n, wide):
    """Square root of ``(I - G' W) Y' Y (I - W' G) + G' G``, in place.

    The rows ``[Y (I - W' G); G]`` are ``[Y; 0] + [-Y W'; I] G``. Rotations first turn the second bracket into
    ``[0; R]``, so that nothing is ever subtracted from Y; reflections then fold the three rows left over into it.
    Rows of Y from 9 on are upper triangular before and after.
    """
    for i in range(n):
        row = Y[i]
        for a in range(3):
            w, s = W[a], 0.0
            for j in range(n):
                s -= row[j] * w[j]
            E[i, a] = s
    for a in range(3):
        z = Z[a]
        for j in range(wide):
            z[j] = 0.0
        for b in range(3):
            R[a, b] = 1.0 if a == b else 0.0
    for i in range(n - 1, -1, -1):  # upwards, or the triangle would fill
        row = Y[i]
        for a in range(3):
            x = E[i, a]
            if x == 0.0:
                continue
            z, h = Z[a], math.hypot(R[a, a], x)
            c, s = R[a, a] / h, x / h
            R[a, a] = h
            for b in range(a + 1, 3):
                x, y = E[i, b], R[a, b]
                E[i, b], R[a, b] = c * x - s * y, s * x + c * y
            for j in range(wide):
                x, y = row[j], z[j]
                row[j], z[j] = c * x - s * y, s * x + c * y
    for a in range(3):
        z = Z[a]
        for b in range(a, 3):
            g, s = G[b], R[a, b]
            for j in range(n):
                z[j] += s * g[j]
    for k in range(n):
        row = Y[k]
        below = max(9, k + 1)  # rows k + 1 .. below - 1 have something in column k
        d = row[k]
        s = d * d
        for i in range(k + 1, below):
            v[i] = Y[i, k]
            s += v[i] * v[i]
        z0, z1, z2 = Z[0, k], Z[1, k], Z[2, k]
        s += z0 * z0 + z1 * z1 + z2 * z2
        if s < 1e-280:  # nothing there; and the reciprocal of a smaller one is infinite
            continue
        r = -math.copysign(math.sqrt(s), d)
        d -= r
        b = -1.0 / (r * d)
        p, q, o = Z[0], Z[1], Z[2]
        for j in range(wide):
            t[j] = d * row[j] + z0 * p[j] + z1 * q[j] + z2 * o[j]
        for i in range(k + 1, below):
            other, x = Y[i], v[i]
            for j in range(wide):
                t[j] += x * other[j]
        for j in range(wide):
            x = b * t[j]
            t[j] = x
            row[j] -= d * x
            p[j] -= z0 * x
            q[j] -= z1 * x
            o[j] -= z2 * x
        p[k] = q[k] = o[k] = 0.0
        for i in range(k + 1, below):
            other, x = Y[i], v[i]
            for j in range(wide):
                other[j] -= x * t[j]
            other[k] = 0.0


@inlined
def root_transition(Y, Phi, D, n, wide, decays, i_clock, T):
    """``Y <- Y Phi``; Phi (9, PAD) are the navigation rows, the parameters keep to themselves: diagonal D, clock S."""
    if i_clock >= 0:
        for i in range(n):
            Y[i, i_clock + 1] += T * Y[i, i_clock]
    p0, p1, p2, p3, p4, p5, p6, p7, p8 = Phi[0], Phi[1], Phi[2], Phi[3], Phi[4], Phi[5], Phi[6], Phi[7], Phi[8]
    for i in range(9):
        row = Y[i]
        a0, a1, a2, a3, a4 = row[0], row[1], row[2], row[3], row[4]
        a5, a6, a7, a8 = row[5], row[6], row[7], row[8]
        for j in range(9, n):
            row[j] *= D[j - 9]
        for j in range(9):
            row[j] = 0.0
        for j in range(wide):
            row[j] += (
                a0 * p0[j] + a1 * p1[j] + a2 * p2[j] + a3 * p3[j] + a4 * p4[j]
                + a5 * p5[j] + a6 * p6[j] + a7 * p7[j] + a8 * p8[j]
            )  # fmt: skip
    if decays:
        for i in range(9, n):
            row = Y[i]
            for j in range(i, n):
                row[j] *= D[j - 9]


@inlined
def triangularise(Y, v, t, n, wide):
    """Upper triangular square root with the same ``Y' Y``, in place, by reflections."""
    for k in range(n):
        row = Y[k]
        d = row[k]
        s = d * d
        for i in range(k + 1, n):
            v[i] = Y[i, k]
            s += v[i] * v[i]
        if s < 1e-280:
            continue
        r = -math.copysign(math.sqrt(s), d)
        d -= r
        b = -1.0 / (r * d)
        for j in range(wide):
            t[j] = d * row[j]
        for i in range(k + 1, n):
            other, x = Y[i], v[i]
            for j in range(wide):
                t[j] += x * other[j]
        for j in range(wide):
            t[j] *= b
            row[j] -= d * t[j]
        for i in range(k + 1, n):
            other, x = Y[i], v[i]
            for j in range(wide):
                other[j] -= x * t[j]
            other[k] = 0.0


@inlined
def arc_back(k, g, lam, Y, v, t, n, wide):
    """Adjoint and information before an arc began, ``T' lam`` and ``Y T``: row ``k`` of T is ``g`` (``begin_arc``)."""
    s = lam[k]
    lam[k] = 0.0
    for j in range(n):
        lam[j] += s * g[j]
    for i in range(n):
        row = Y[i]
        s = row[k]
        row[k] = 0.0
        for j in range(n):
            row[j] += s * g[j]
    triangularise(Y, v, t, n, wide)


@over_states
def smooth(nodes, record, minus, plus, rec_x, rec_P, carry, begins):
    """Run backwards over all nodes of a run, or of a part of it.

    Parameters
    ----------
    nodes : SmootherNodes
        As kept by the filter; updates of node i are ``upd[i - 1] .. upd[i]``.
    record : int64[k]
        Row of ``rec_x`` and ``rec_P`` for a node, or -1.
    minus, plus : float64[k, 9]
        Output: what to add to attitude (a rotation vector in Earth-fixed axes applied on the left), velocity and
        position before and after the updates of each node.
    rec_x : float64[r, n]
        Output: what to add to all states, after the updates.
    rec_P : float64[r, n (n + 1) / 2]
        Output: smoothed covariances.
    carry : float64[n + 2, PAD]
        Root of the information, adjoint, and sum of the updates of the last node that are known already; left as they
        are for the part before. See ``nothing_after``.
    begins : bool
        The first node begins the run. If not, it is the last of the part before, and only its updates are here.
    """
    n_nodes, n_sensor, i_clock, pmod = nodes.t.shape[0], nodes.n_sensor, nodes.i_clock, nodes.pmod
    n = nodes.W.shape[2]
    m = n - 9
    wide = padded(n)
    Y, lam, inj, c = carry[:n], carry[n, :n], carry[n + 1, :n], np.zeros(n)
    Z, E, R = np.zeros((3, PAD)), np.zeros((n, 3)), np.zeros((3, 3))
    v, t = np.zeros(n), np.zeros(PAD)
    Phi, A = np.zeros((9, PAD)), np.zeros((9, 9))
    D, acc, nav = np.ones(max(m, 1)), np.zeros(8), np.zeros(10)
    P, X = np.zeros((n, PAD)), np.zeros((n, PAD))
    A[2, 2] = 1.0
    for node in range(n_nodes - 1, -1, -1):
        first = nodes.upd[node - 1] if node > 0 else 0
        begun = node > 0 and nodes.phi[node, 0] == BEGUN
        if begun:
            first += 1  # the row of the transition
        if node < n_nodes - 1:
            for i in range(n):
                inj[i] = 0.0
        for u in range(nodes.upd[node] - 1, first - 1, -1):
            W, G, e = nodes.W[u], nodes.G[u], nodes.e[u]
            for a in range(3):
                s = e[a]
                for i in range(n):
                    s += W[a, i] * lam[i]
                c[a] = s
            for a in range(3):
                for i in range(n):
                    lam[i] -= G[a, i] * c[a]
                    inj[i] += W[a, i] * e[a]
            root_update(Y, Z, W, G, E, R, v, t, n, wide)
        if node == 0 and not begins:
            break
        packed = nodes.P[node]
        symv(packed, lam, c, n)
        for i in range(9):
            minus[node, i] = c[i]
            plus[node, i] = c[i] + inj[i]
        if record[node] >= 0:
            for i in range(n):
                rec_x[record[node], i] = c[i] + inj[i]
            unpack(packed, P, n)
            for i in range(n):
                row, y = X[i], Y[i]
                for j in range(wide):
                    row[j] = 0.0
                for k in range(i if i >= 9 else 0, n):
                    x, p = y[k], P[k]
                    for j in range(wide):
                        row[j] += x * p[j]
            for k in range(n):
                row = X[k]
                for i in range(n):
                    x, p = row[i], P[i]
                    for j in range(wide):
                        p[j] -= x * row[j]
            out, o = rec_P[record[node]], 0
            for i in range(n):
                for j in range(i + 1):
                    out[o] = P[i, j]
                    o += 1
        if node == 0:
            break
        T = nodes.phi[node, 0]
        if T == TURNED:
            turn_back(nodes.B[node], n_sensor, lam, Y, n, wide)
            triangularise(Y, v, t, n, wide)
            continue
        if begun:
            arc_back(int(nodes.phi[node, 1]), nodes.G[first - 1, 0], lam, Y, v, t, n, wide)
            continue
        for i in range(8):
            acc[i] = nodes.phi[node, i]
        for i in range(3):
            nav[7 + i] = nodes.phi[node, 8 + i]
        transition(A, acc, nav, nodes.omega)
        for i in range(9):
            p = Phi[i]
            for j in range(9):
                p[j] = A[i, j]
            for k in range(n_sensor):
                p[9 + k] = nodes.B[node, i, k]
        decays = False
        for k in range(m):
            if pmod[k, 0] > 0.0:
                D[k] = math.exp(-pmod[k, 0] * T)
                decays = True
        if i_clock >= 0:
            lam[i_clock + 1] += T * lam[i_clock]
        for i in range(n):
            s = D[i - 9] * lam[i] if i >= 9 else 0.0
            for k in range(9):
                s += Phi[k, i] * lam[k]
            c[i] = s
        for i in range(n):
            lam[i] = c[i]
        root_transition(Y, Phi, D, n, wide, decays, i_clock, T)
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
        c, h = half_angle(x, y, z)
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
    nodes = nb.types.NamedTuple((f, m, m, c, i, c, c, m, m, nb.int64, nb.int64, nb.float64), SmootherNodes)
    prepare(
        [
            (smooth, (nodes, i, m, m, m, m, m, nb.boolean)),
            (apply_corrections, (f, m, m, m, f, m, m)),
        ]
    )
