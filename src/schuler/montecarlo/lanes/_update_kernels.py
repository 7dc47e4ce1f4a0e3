"""Measurement updates of several runs in lock-step: rows of H, innovation, correction, feedback, in lanes.

The twin of ``filtering.kernels.update`` for positions and velocities of an antenna. Where a measurement fails its gate
in some lanes, its gains become zero there; there is no branch on the value of a lane. Arrays as in
``filtering.kernels.covariance``.
"""
# mypy: disallow-untyped-defs=False, disallow-incomplete-defs=False
# mypy: disallow-untyped-calls=False, check-untyped-defs=False

from __future__ import annotations

import math

from schuler.filtering.kernels.gate import FORGET, TOO_LARGE
from schuler.filtering.kernels.update import POSITION
from schuler.filtering.kernels.vector import where_at_most
from schuler.jit import inlined, kernel
from schuler.montecarlo.lanes._shared_kernels import dcm, gram, ned_axes, spread_estimates

BIG = 1e300


@inlined
def antenna_rows(kind, z, lever, nav, reg, h, sens, ptab, cross, omega, U, H, Hp, y):
    """Rows of H, and predicted minus measured, of a position or velocity; see ``measurement_rows``.

    Columns 3 to 5 of ``H`` are those of the states from 6 on (position) or 3 on (velocity).
    """
    c00, c01, c02, c10, c11, c12, c20, c21, c22 = dcm(nav)
    l0, l1, l2 = lever[0], lever[1], lever[2]
    L0, L1, L2 = c00 * l0 + c01 * l1 + c02 * l2, c10 * l0 + c11 * l1 + c12 * l2, c20 * l0 + c21 * l1 + c22 * l2
    if kind == POSITION:
        d0, d1, d2 = nav[7] + L0 - z[0], nav[8] + L1 - z[1], nav[9] + L2 - z[2]
        for i in range(3):
            u0, u1, u2 = U[i, 0], U[i, 1], U[i, 2]
            H[i, 0], H[i, 1], H[i, 2] = L1 * u2 - L2 * u1, L2 * u0 - L0 * u2, L0 * u1 - L1 * u0
            H[i, 3], H[i, 4], H[i, 5] = u0, u1, u2
            y[i] = u0 * d0 + u1 * d1 + u2 * d2
        return
    k = 1.0 / h if h > 0.0 else 0.0
    w0, w1, w2 = k * reg[4], k * reg[5], k * reg[6]
    x0, x1, x2 = w1 * l2 - w2 * l1, w2 * l0 - w0 * l2, w0 * l1 - w1 * l0
    M0, M1, M2 = c00 * x0 + c01 * x1 + c02 * x2, c10 * x0 + c11 * x1 + c12 * x2, c20 * x0 + c21 * x1 + c22 * x2
    v0, v1, v2 = nav[4] + M0 + omega * L1, nav[5] + M1 - omega * L0, nav[6] + M2
    has_lever = l0 != 0.0 or l1 != 0.0 or l2 != 0.0
    for i in range(3):
        u0, u1, u2 = U[i, 0], U[i, 1], U[i, 2]
        y[i] = u0 * v0 + u1 * v1 + u2 * v2 - z[i]
        e0, e1 = -omega * u1, omega * u0  # omega_ie x u
        H[i, 0] = M1 * u2 - M2 * u1 - L2 * e1
        H[i, 1] = M2 * u0 - M0 * u2 + L2 * e0
        H[i, 2] = M0 * u1 - M1 * u0 + L0 * e1 - L1 * e0
        H[i, 3], H[i, 4], H[i, 5] = u0, u1, u2
        if has_lever:
            t0, t1, t2 = u0 * c00 + u1 * c10 + u2 * c20, u0 * c01 + u1 * c11 + u2 * c21, u0 * c02 + u1 * c12 + u2 * c22
            s0, s1, s2 = l1 * t2 - l2 * t1, l2 * t0 - l0 * t2, l0 * t1 - l1 * t0
            rate_columns(Hp, i, s0, s1, s2, k, reg, sens, ptab, cross)


@inlined
def rate_columns(Hp, i, t0, t1, t2, k, reg, sens, ptab, cross):
    """What errors of sensor parameters do to ``t . omega_ib_b``, in column ``i``; as in ``_vehicle_kernels``."""
    for j in range(Hp.shape[0]):
        a, source = ptab[j, 1], ptab[j, 2]
        if ptab[j, 0] == 0:
            v = -(sens[6 + a] * t0 + sens[9 + a] * t1 + sens[12 + a] * t2)
        elif cross:
            f0, f1, f2 = sens[15 + a], sens[18 + a], sens[21 + a]
            p0 = sens[24] * f0 + sens[25] * f1 + sens[26] * f2
            p1 = sens[27] * f0 + sens[28] * f1 + sens[29] * f2
            p2 = sens[30] * f0 + sens[31] * f1 + sens[32] * f2
            g0 = sens[6] * p0 + sens[7] * p1 + sens[8] * p2
            g1 = sens[9] * p0 + sens[10] * p1 + sens[11] * p2
            g2 = sens[12] * p0 + sens[13] * p1 + sens[14] * p2
            v = g0 * t0 + g1 * t1 + g2 * t2
        else:
            continue
        Hp[j, i] = v if source == 0 else v * (k * reg[source])


@kernel
def innovate(P, H, first, Hp, on_psi, lever, y, R, W, e):
    """Whitened innovation of a measurement of three components; nothing is changed yet. Returns e . e.

    ``H[3, 6]`` are its columns for the attitude and for the three states from ``first`` on, ``Hp[m, 3]`` those for the
    parameters (only if ``lever``). ``W[n, 3] = P H' L^-T``. Lanes whose S is not positive definite return NaN.
    """
    n = P.shape[0]
    for j in range(n):
        p, w = P[j], W[j]
        x0, x1, x2, x3, x4, x5 = p[0], p[1], p[2], p[first], p[first + 1], p[first + 2]
        for a in range(3):
            h = H[a]
            w[a] = h[0] * x0 + h[1] * x1 + h[2] * x2 + h[3] * x3 + h[4] * x4 + h[5] * x5
    if lever:
        for c in range(0, n, 3):
            add_gram(W, c, 0, gram(Hp, 0, P[9:], c, on_psi))
    # S = H W + R, lower triangle
    s = gram(Hp, 0, W[9:], 0, on_psi if lever else on_psi[:0])
    x, z = W[:3], W[first : first + 3]
    s00 = R[0] + s[0] + row_times(H[0], x, z, 0)
    s10 = R[3] + s[3] + row_times(H[1], x, z, 0)
    s11 = R[4] + s[4] + row_times(H[1], x, z, 1)
    s20 = R[6] + s[6] + row_times(H[2], x, z, 0)
    s21 = R[7] + s[7] + row_times(H[2], x, z, 1)
    s22 = R[8] + s[8] + row_times(H[2], x, z, 2)
    # its Cholesky factor, the diagonal inverted
    k0 = 1.0 / math.sqrt(s00)
    l10, l20 = s10 * k0, s20 * k0
    k1 = 1.0 / math.sqrt(s11 - l10 * l10)
    l21 = (s21 - l20 * l10) * k1
    k2 = 1.0 / math.sqrt(s22 - l20 * l20 - l21 * l21)
    e0 = y[0] * k0
    e1 = (y[1] - l10 * e0) * k1
    e2 = (y[2] - l20 * e0 - l21 * e1) * k2
    for j in range(n):
        w = W[j]
        w0 = w[0] * k0
        w1 = (w[1] - l10 * w0) * k1
        w[0], w[1], w[2] = w0, w1, (w[2] - l20 * w0 - l21 * w1) * k2
    e[0], e[1], e[2] = e0, e1, e2
    return e0 * e0 + e1 * e1 + e2 * e2


@inlined
def add_gram(X, i, j, s):
    """``X[i:i + 3, j:j + 3]`` plus the transpose of a Gram matrix."""
    for a in range(3):
        x = X[i + a]
        for b in range(3):
            x[j + b] += s[3 * b + a]


@inlined
def row_times(h, x, z, a):
    """A row of H times column ``a`` of the six rows it acts on."""
    return h[0] * x[0, a] + h[1] * x[1, a] + h[2] * x[2, a] + h[3] * z[0, a] + h[4] * z[1, a] + h[5] * z[2, a]


@kernel
def correct(P, nav, est, W, e, dx, nis, limit):
    """``P -= W W'`` and closed-loop feedback of ``dx = W e``, in the lanes where ``nis <= limit``."""
    n = P.shape[0]
    for a in range(3):
        e[a] = where_at_most(nis, limit, e[a], 0.0)
        for i in range(n):
            W[i, a] = where_at_most(nis, limit, W[i, a], 0.0)
    for i in range(n):
        w0, w1, w2 = W[i, 0], W[i, 1], W[i, 2]
        dx[i] = w0 * e[0] + w1 * e[1] + w2 * e[2]
        p = P[i]
        for j in range(n if i >= 9 else 9):
            p[j] -= w0 * W[j, 0] + w1 * W[j, 1] + w2 * W[j, 2]
    feed_back(nav, est, dx)


@inlined
def feed_back(nav, est, dx):
    """Closed-loop correction of navigation states and parameters by the estimated errors ``dx``."""
    turn(nav, -dx[0], -dx[1], -dx[2])
    for i in range(3):
        nav[4 + i] -= dx[3 + i]
        nav[7 + i] -= dx[6 + i]
    for k in range(est.shape[0]):
        est[k] -= dx[9 + k]


@inlined
def turn(nav, x, y, z):
    """Attitude turned by a rotation vector in Earth-fixed axes; the series of an eighth of it, doubled twice.

    Exact to rounding up to 2 rad, without a branch.
    """
    t = (x * x + y * y + z * z) / 64.0
    c = 1.0 - t * (0.5 - t * (1.0 / 24.0 - t * (1.0 / 720.0 - t * (1.0 / 40320.0 - t / 3628800.0))))
    s = 1.0 - t * (1.0 / 6.0 - t * (1.0 / 120.0 - t * (1.0 / 5040.0 - t / 362880.0)))
    s = s * c
    c = 2.0 * c * c - 1.0
    s = 0.5 * (s * c)
    c = 2.0 * c * c - 1.0
    x, y, z = s * x, s * y, s * z
    q0, q1, q2, q3 = nav[0], nav[1], nav[2], nav[3]
    nav[0] = c * q0 - x * q1 - y * q2 - z * q3
    nav[1] = c * q1 + x * q0 + y * q3 - z * q2
    nav[2] = c * q2 - x * q3 + y * q0 + z * q1
    nav[3] = c * q3 + x * q2 - y * q1 + z * q0


@kernel
def take(
    kind, lever, R, gate, lockout, omega, zm, nav, est, P, reg, h, sens, ptab, on_psi, cross, U, H, Hp, W, y, e, dx, M,
    locks, counts, i, n_sensor,
):  # fmt: skip
    """One measurement update; ``counts`` as :func:`~._kernels.run_lanes` describes them."""
    ned_axes(nav, U)
    antenna_rows(kind, zm, lever, nav, reg, h, sens, ptab, cross, omega, U, H, Hp, y)
    with_lever = kind != POSITION and (lever[0] != 0.0 or lever[1] != 0.0 or lever[2] != 0.0)
    nis = innovate(P, H, 6 if kind == POSITION else 3, Hp, on_psi, with_lever, y, R, W, e)
    passes = min(gate, BIG)
    limit = nis * 0.0 + passes
    if lockout > 0 and passes < BIG:  # where the engine would do more than reject, the run is one for the engine
        locks[i] = where_at_most(nis, passes, 0.0, locks[i] + 1.0)
        counts[8 + i] += FORGET * (where_at_most(nis, passes, nis, passes) / 3.0 - 1.0 - counts[8 + i])
        counts[7] = where_at_most(locks[i], 1.0, counts[7], 1.0)
        counts[7] = where_at_most(counts[8 + i], TOO_LARGE - 1.0, counts[7], 1.0)
    correct(P, nav, est, W, e, dx, nis, limit)
    used = where_at_most(nis, limit, 1.0, 0.0)
    counts[3 * i] += where_at_most(nis, BIG, nis, 0.0)
    counts[3 * i + 1] += used
    counts[3 * i + 2] += 1.0 - used
    spread_estimates(est, ptab, n_sensor, M, sens)
