"""Compiled accumulation of the transition: what IMU samples since the last propagation make of parameter errors.

A parameter is (axis, regressor), so the parameter columns of the transition follow from sums over samples of
regressors times attitude. What those sums need is stored sample by sample and summed when the covariance is propagated,
in registers: a fifth of the work of carrying nine elements of each parameter over every sample. With e = -c rho the
attitude error that a unit of a gyroscope parameter leaves in an interval (c the axis in Earth-fixed axes, rho the
regressor's integral), dv the velocity increment and t the time since the last propagation, summation by parts gives::

    psi = sum e
    v   = sum (psi_mid x dv)   = psi x a - sum e x a_mid       a = sum dv
    r   = T v - sum (psi_mid x dv) t_mid = T v - psi x b + sum e x b_mid      b = sum dv t_mid

The text is compiled for numbers and for lanes. ``past[k, N_PAST]`` is what is stored of each interval, by the columns
below; ``acc[8]`` as in ``covariance``, ``moment[3]`` the sum b of velocity increments times mid time; ``ptab`` and
``sens`` as in ``sensor_errors``.
"""

from __future__ import annotations

from schuler.filtering.kernels.covariance import dcm, gram
from schuler.jit import inlined

# Columns of `past`: integrals of the regressors (time, force, rate), time and force once more times mid time, attitude
# at mid interval row by row, its columns x a_mid, and x b_mid.
PAST_T, PAST_C, PAST_A, PAST_B, N_PAST = 7, 11, 20, 29, 38


@inlined
def regressor_integrals(poly, reg):
    """Integrals of force and rate over an interval, to ``reg[1:7]``."""
    for i in range(3):
        reg[1 + i] = poly[9 + i] + 0.5 * poly[12 + i] + poly[15 + i] / 6.0
        reg[4 + i] = poly[i] + 0.5 * poly[3 + i] + poly[6 + i] / 6.0


@inlined
def store_interval(past, k, acc, moment, nav, dx, dy, dz, poly, h, reg):
    """Store as row ``k`` what the transition needs of an interval, and extend its sums; ``nav`` is advanced already.

    ``dx, dy, dz`` is the interval's specific force integral in Earth-fixed axes; ``reg[7]`` receives the integrals of
    the regressors (time, force, rate).
    """
    c = dcm(nav)
    row = past[k]
    reg[0] = h
    regressor_integrals(poly, reg)
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
    bx, by, bz = moment[0] + ht * dx, moment[1] + ht * dy, moment[2] + ht * dz
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
    moment[0] += t * dx
    moment[1] += t * dy
    moment[2] += t * dz
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


@inlined
def parameter_columns(past, count, acc, moment, sens, ptab, m, matrix, cross, N, sums, B):
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
    T, a0, a1, a2, b0, b1, b2 = acc[0], acc[2], acc[3], acc[4], moment[0], moment[1], moment[2]
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
