"""Covariance of several runs in lock-step: the propagation and update of the engine, in lanes.

The same transition as in ``_covariance_kernels``, accumulated another way. There, nine elements for each of m
parameters grow at every sample; but a parameter is (axis, regressor), so that all of them follow from sums over samples
of regressors times attitude. Those are stored sample by sample and summed when the covariance is propagated, in
registers: a fifth of the work. With e = -c rho the attitude error that a unit of a gyroscope parameter leaves in an
interval (c the axis in Earth-fixed axes, rho the regressor's integral), dv the velocity increment and t the time since
the last propagation, summation by parts gives::

    psi = sum e
    v   = sum (psi_mid x dv)   = psi x a - sum e x a_mid       a = sum dv
    r   = T v - sum (psi_mid x dv) t_mid = T v - psi x b + sum e x b_mid      b = sum dv t_mid

Arrays of lanes: ``P[n, n]``, of which the columns of the parameters in the rows of the navigation states are not used;
``past[k, N_PAST]`` what is kept of each interval, by the columns below. The m = n - 9 parameters are all sensor
parameters, in threes. Other arrays as in ``_covariance_kernels``.
"""
# mypy: disallow-untyped-defs=False, disallow-incomplete-defs=False
# mypy: disallow-untyped-calls=False, check-untyped-defs=False

from __future__ import annotations

import math

from schuler.jit import inlined, kernel
from schuler.montecarlo.lanes._shared_kernels import dcm, transition

# Columns of `past`: integrals of the regressors (time, force, rate), time and force once more times mid time, attitude
# at mid interval row by row, its columns x a_mid, and x b_mid.
PAST_T, PAST_C, PAST_A, PAST_B, N_PAST = 7, 11, 20, 29, 38


@inlined
def gram(X, i, Y, j, rows):
    """``X[:, i:i + 3]' Y[:, j:j + 3]`` over some rows, itself row by row."""
    s00 = s01 = s02 = s10 = s11 = s12 = s20 = s21 = s22 = 0.0
    for t in rows:
        x0, x1, x2 = X[t, i], X[t, i + 1], X[t, i + 2]
        y0, y1, y2 = Y[t, j], Y[t, j + 1], Y[t, j + 2]
        s00 += x0 * y0
        s01 += x0 * y1
        s02 += x0 * y2
        s10 += x1 * y0
        s11 += x1 * y1
        s12 += x1 * y2
        s20 += x2 * y0
        s21 += x2 * y1
        s22 += x2 * y2
    return s00, s01, s02, s10, s11, s12, s20, s21, s22


@inlined
def remember(past, k, acc, b, nav, dx, dy, dz, poly, h, reg):
    """Keep row ``k`` of what the transition needs of an interval; call it after ``nav`` is advanced.

    The twin of ``accumulate``; ``acc`` is the same without the angle, ``b[3]`` the sum of velocity increments times mid
    time.
    """
    c = dcm(nav)
    row = past[k]
    reg[0] = h
    for i in range(3):
        reg[1 + i] = poly[9 + i] + 0.5 * poly[12 + i] + poly[15 + i] / 6.0
        reg[4 + i] = poly[i] + 0.5 * poly[3 + i] + poly[6 + i] / 6.0
    hh = 0.5 * h
    t = acc[0] + hh
    for i in range(7):
        row[i] = reg[i]
    for i in range(4):
        row[PAST_T + i] = t * reg[i]
    # C at mid interval: turned back by half the increment, to first order
    hx, hy, hz = -0.5 * reg[4], -0.5 * reg[5], -0.5 * reg[6]
    ax, ay, az = acc[2] + 0.5 * dx, acc[3] + 0.5 * dy, acc[4] + 0.5 * dz
    ht = 0.5 * t
    bx, by, bz = b[0] + ht * dx, b[1] + ht * dy, b[2] + ht * dz
    x0, x1, x2 = c[0] + c[1] * hz - c[2] * hy, c[1] + c[2] * hx - c[0] * hz, c[2] + c[0] * hy - c[1] * hx
    y0, y1, y2 = c[3] + c[4] * hz - c[5] * hy, c[4] + c[5] * hx - c[3] * hz, c[5] + c[3] * hy - c[4] * hx
    z0, z1, z2 = c[6] + c[7] * hz - c[8] * hy, c[7] + c[8] * hx - c[6] * hz, c[8] + c[6] * hy - c[7] * hx
    row[PAST_C], row[PAST_C + 1], row[PAST_C + 2] = x0, x1, x2
    row[PAST_C + 3], row[PAST_C + 4], row[PAST_C + 5] = y0, y1, y2
    row[PAST_C + 6], row[PAST_C + 7], row[PAST_C + 8] = z0, z1, z2
    row[PAST_A], row[PAST_A + 1], row[PAST_A + 2] = y0 * az - z0 * ay, y1 * az - z1 * ay, y2 * az - z2 * ay
    row[PAST_A + 3], row[PAST_A + 4], row[PAST_A + 5] = z0 * ax - x0 * az, z1 * ax - x1 * az, z2 * ax - x2 * az
    row[PAST_A + 6], row[PAST_A + 7], row[PAST_A + 8] = x0 * ay - y0 * ax, x1 * ay - y1 * ax, x2 * ay - y2 * ax
    row[PAST_B], row[PAST_B + 1], row[PAST_B + 2] = y0 * bz - z0 * by, y1 * bz - z1 * by, y2 * bz - z2 * by
    row[PAST_B + 3], row[PAST_B + 4], row[PAST_B + 5] = z0 * bx - x0 * bz, z1 * bx - x1 * bz, z2 * bx - x2 * bz
    row[PAST_B + 6], row[PAST_B + 7], row[PAST_B + 8] = x0 * by - y0 * bx, x1 * by - y1 * bx, x2 * by - y2 * bx
    b[0] += t * dx
    b[1] += t * dy
    b[2] += t * dz
    acc[5] += h * acc[2] + hh * dx
    acc[6] += h * acc[3] + hh * dy
    acc[7] += h * acc[4] + hh * dz
    acc[2] += dx
    acc[3] += dy
    acc[4] += dz
    acc[0] += h


@inlined
def sum_source(past, count, source, i, j, out):
    """``out[source, :9]``, of force and rate of all axes: column ``i`` of the past times the nine from ``j`` on."""
    for r in range(3):
        if source == 0:
            s0 = s1 = s2 = 0.0
            for t in range(count):
                x = past[t, i]
                s0 += x * past[t, j + 3 * r]
                s1 += x * past[t, j + 3 * r + 1]
                s2 += x * past[t, j + 3 * r + 2]
            out[0, 3 * r], out[0, 3 * r + 1], out[0, 3 * r + 2] = s0, s1, s2
        else:
            s = gram(past, i, past, j + 3 * r, range(count))
            for a in range(3):
                out[source + a, 3 * r], out[source + a, 3 * r + 1], out[source + a, 3 * r + 2] = (
                    s[3 * a], s[3 * a + 1], s[3 * a + 2]
                )  # fmt: skip


@inlined
def column(X, source, i, sens, o, matrix):
    """Column ``i`` of a summed matrix times the inverse ``sens[o:o + 9]`` of a sensor's response."""
    if matrix:
        k0, k1, k2 = sens[o + i], sens[o + 3 + i], sens[o + 6 + i]
        return (
            X[source, 0] * k0 + X[source, 1] * k1 + X[source, 2] * k2,
            X[source, 3] * k0 + X[source, 4] * k1 + X[source, 5] * k2,
            X[source, 6] * k0 + X[source, 7] * k1 + X[source, 8] * k2,
        )
    return X[source, i], X[source, 3 + i], X[source, 6 + i]


@kernel
def parameter_columns(past, count, acc, b, sens, ptab, m, matrix, cross, N, sums, B):
    """Parameter columns ``B[m, 9]`` of the transition, from what was kept of ``count`` intervals.

    ``sums[4, 7, 9]`` and ``N[9]`` are workspace; ``cross``: accelerometer errors act on the rate through an estimated
    G_g.
    """
    X, XT, XA, XB = sums[0], sums[1], sums[2], sums[3]
    gyro = accel = False
    by_force = by_rate = gyro_by_force = False
    for k in range(m):
        gyro = gyro or ptab[k, 0] == 0
        accel = accel or ptab[k, 0] == 1
        by_force = by_force or 1 <= ptab[k, 2] <= 3
        by_rate = by_rate or ptab[k, 2] >= 4
        gyro_by_force = gyro_by_force or (ptab[k, 0] == 0 and 1 <= ptab[k, 2] <= 3)
    for source in (0, 1, 4):
        if (source == 1 and not by_force) or (source == 4 and not by_rate):
            continue
        sum_source(past, count, source, source, PAST_C, X)
        if source != 4 and accel:
            sum_source(past, count, source, PAST_T + source, PAST_C, XT)
        if source != 1 or gyro_by_force or cross:
            sum_source(past, count, source, source, PAST_A, XA)
            sum_source(past, count, source, source, PAST_B, XB)
    if cross:  # N = (I + M_g)^-1 G_g (I + M_a)^-1
        for i in range(3):
            g0 = sens[24] * sens[15 + i] + sens[25] * sens[18 + i] + sens[26] * sens[21 + i]
            g1 = sens[27] * sens[15 + i] + sens[28] * sens[18 + i] + sens[29] * sens[21 + i]
            g2 = sens[30] * sens[15 + i] + sens[31] * sens[18 + i] + sens[32] * sens[21 + i]
            for r in range(3):
                N[3 * r + i] = sens[6 + 3 * r] * g0 + sens[7 + 3 * r] * g1 + sens[8 + 3 * r] * g2
    T, a0, a1, a2, b0, b1, b2 = acc[0], acc[2], acc[3], acc[4], b[0], b[1], b[2]
    for k in range(m):
        i, source = ptab[k, 1], ptab[k, 2]
        p0 = p1 = p2 = 0.0
        v0 = v1 = v2 = 0.0
        w0 = w1 = w2 = 0.0
        if ptab[k, 0] == 1:
            x0, x1, x2 = column(X, source, i, sens, 15, matrix)
            v0, v1, v2 = -x0, -x1, -x2
            x0, x1, x2 = column(XT, source, i, sens, 15, matrix)
            w0, w1, w2 = -x0, -x1, -x2
        if ptab[k, 0] == 0 or cross:
            if ptab[k, 0] == 0:
                x0, x1, x2 = column(X, source, i, sens, 6, matrix)
                y0, y1, y2 = column(XA, source, i, sens, 6, matrix)
                z0, z1, z2 = column(XB, source, i, sens, 6, matrix)
                p0, p1, p2, y0, y1, y2, z0, z1, z2 = -x0, -x1, -x2, -y0, -y1, -y2, -z0, -z1, -z2
            else:
                p0, p1, p2 = column(X, source, i, N, 0, True)
                y0, y1, y2 = column(XA, source, i, N, 0, True)
                z0, z1, z2 = column(XB, source, i, N, 0, True)
            v0 += p1 * a2 - p2 * a1 - y0
            v1 += p2 * a0 - p0 * a2 - y1
            v2 += p0 * a1 - p1 * a0 - y2
            w0 += p1 * b2 - p2 * b1 - z0
            w1 += p2 * b0 - p0 * b2 - z1
            w2 += p0 * b1 - p1 * b0 - z2
        B[k, 0], B[k, 1], B[k, 2] = p0, p1, p2
        B[k, 3], B[k, 4], B[k, 5] = v0, v1, v2
        B[k, 6], B[k, 7], B[k, 8] = T * v0 - w0, T * v1 - w1, T * v2 - w2


@inlined
def apply_navigation(A, p, q, r, e, f, g, u, v, z):
    """The navigation block of the transition times nine numbers; zeros are left out as in ``transition``."""
    return (
        A[0, 0] * p + A[0, 1] * q,
        A[1, 0] * p + A[1, 1] * q,
        r,
        A[3, 0] * p + A[3, 1] * q + A[3, 2] * r + A[3, 3] * e + A[3, 4] * f + A[3, 6] * u + A[3, 7] * v + A[3, 8] * z,
        A[4, 0] * p + A[4, 1] * q + A[4, 2] * r + A[4, 3] * e + A[4, 4] * f + A[4, 6] * u + A[4, 7] * v + A[4, 8] * z,
        A[5, 0] * p + A[5, 1] * q + A[5, 5] * g + A[5, 6] * u + A[5, 7] * v + A[5, 8] * z,
        A[6, 1] * q + A[6, 2] * r + A[6, 3] * e + A[6, 4] * f + A[6, 6] * u + A[6, 7] * v + A[6, 8] * z,
        A[7, 0] * p + A[7, 2] * r + A[7, 3] * e + A[7, 4] * f + A[7, 6] * u + A[7, 7] * v + A[7, 8] * z,
        A[8, 0] * p + A[8, 1] * q + A[8, 5] * g + A[8, 6] * u + A[8, 7] * v + A[8, 8] * z,
    )


@inlined
def add_half_noise(P, nav, T, q_imu, pmod):
    """Half the process noise of an interval: added before and after the transition it is the trapezoid rule."""
    h = 0.5 * T
    if q_imu[0] == q_imu[1] == q_imu[2] and q_imu[3] == q_imu[4] == q_imu[5]:
        for i in range(3):
            P[i, i] += h * q_imu[0]
            P[3 + i, 3 + i] += h * q_imu[3]
    else:
        c = dcm(nav)
        for o in (0, 3):
            for i in range(3):
                for j in range(3):
                    g = c[3 * i] * c[3 * j] * q_imu[o]
                    g += c[3 * i + 1] * c[3 * j + 1] * q_imu[o + 1]
                    g += c[3 * i + 2] * c[3 * j + 2] * q_imu[o + 2]
                    P[o + i, o + j] += h * g
    for k in range(pmod.shape[0]):
        if pmod[k, 1] > 0.0:
            P[9 + k, 9 + k] += h * pmod[k, 1]


@inlined
def decay(pmod, T, D, mean):
    """Over ``T`` seconds what is left of each Gauss-Markov state, and its mean meanwhile; returns if any decays."""
    decays = False
    for k in range(pmod.shape[0]):
        D[k], mean[k] = 1.0, 1.0
        if pmod[k, 0] > 0.0:
            x = pmod[k, 0] * T
            if x < 0.01:
                mean[k] = 1.0 - x * (0.5 - x * (1.0 / 6.0 - x * (1.0 / 24.0 - x / 120.0)))
            else:
                mean[k] = -math.expm1(-x) / x
            D[k] = 1.0 - x * mean[k]
            decays = True
    return decays


@kernel
def flush(P, nav, acc, A, B, T, D, mean, on_psi, decays, omega):
    """Carry the covariance over the accumulated transition; the twin of ``_covariance_kernels.flush``.

    ``T[n, 9]`` is workspace: the navigation rows of the transition times column c of P, as row c. ``on_psi`` lists the
    parameters that act on the attitude.
    """
    n = P.shape[0]
    m = n - 9
    if decays:
        for k in range(m):
            if mean[k] != 1.0:
                for i in range(9):
                    B[k, i] *= mean[k]
    transition(A, acc, nav, omega)
    parameters = P[9:]
    for c in range(n):
        p, t = P[c], T[c]
        t[0], t[1], t[2], t[3], t[4], t[5], t[6], t[7], t[8] = apply_navigation(
            A, p[0], p[1], p[2], p[3], p[4], p[5], p[6], p[7], p[8]
        )
    for c in range(0, n, 3):
        add_gram(T, c, 0, gram(B, 0, parameters, c, on_psi))
        add_gram(T, c, 3, gram(B, 3, parameters, c, range(m)))
        add_gram(T, c, 6, gram(B, 6, parameters, c, range(m)))
    for a in range(9):
        p = P[a]
        p[0], p[1], p[2], p[3], p[4], p[5], p[6], p[7], p[8] = apply_navigation(
            A, T[0, a], T[1, a], T[2, a], T[3, a], T[4, a], T[5, a], T[6, a], T[7, a], T[8, a]
        )
    for r in range(0, 9, 3):
        add_gram(P, r, 0, gram(B, 0, T[9:], r, on_psi))
        for q in range(3, r + 3, 3):
            add_gram(P, r, q, gram(B, q, T[9:], r, range(m)))
    for a in range(9):
        for b in range(a):
            P[b, a] = P[a, b]
    for c in range(m):
        p, t = P[9 + c], T[9 + c]
        for i in range(9):
            p[i] = t[i] * D[c]
    if decays:
        for i in range(m):
            p = P[9 + i]
            for j in range(m):
                d = D[i] * D[j]
                if d != 1.0:
                    p[9 + j] *= d


@inlined
def add_gram(X, i, j, s):
    """``X[i:i + 3, j:j + 3]`` plus the transpose of a Gram matrix."""
    for a in range(3):
        x = X[i + a]
        for b in range(3):
            x[j + b] += s[3 * b + a]
