"""Compiled covariance propagation: the transition of the error state, accumulated and applied.

Transition over one flush interval T, columns dpsi, dv, dr, parameters::

    dpsi:  R_e        0            0           B_psi
    dv:    -[a x]     I - 2 W T    G T         B_v       a = sum of dv_e,  W = [omega_ie x],
    dr:    -[s x]     I T - W T^2  I + G T^2/2 B_r       s = double sum,   G = gravity gradient
    p:     0          0            0           S D       (Coriolis also acts on a and s to first order)

``a``, ``s`` and ``B`` are accumulated at every IMU sample by the mid-point rule, so the transition is right whatever
the body does between flushes; only terms of order (omega_ie T)^2 and G T^3 are left out. D is the decay of
Gauss-Markov states; S adds T times a receiver clock's drift to its offset, the only parameters that act on each other.

Arrays (C-contiguous float64 and int64, owned by the caller), with m parameters and n = 9 + m states:

``P[n, PAD]``    covariance of the errors (estimate minus truth): dpsi_e, dv_e, dr_e, parameters; columns from n on are
                 zero and are computed along, since whole vectors cost less than remainders
``acc[8]``       since the last flush: elapsed time, turned angle, a 3, s 3;  ``B[9, m]`` its parameter columns
``sens[33]``     estimated sensor errors: b_g 3, b_a 3, inverse of I + M_g 9, of I + M_a 9, G_g 9
``ptab[m, 3]``   sensor (0 gyro, 1 accelerometer, -1 none), axis, regressor (0 time, 1-3 force, 4-6 rate)
``pmod[m, 2]``   1 / correlation time (0: none) and power spectral density of the driving noise
``q_imu[6]``     white-noise power spectral densities, gyro 3 and accelerometer 3
"""

from __future__ import annotations

import math

import numpy as np

from schuler.earth import WGS84
from schuler.filtering.limits import MAX_STATES
from schuler.jit import inlined, kernel

_GM = WGS84.GM
_OMEGA_2 = WGS84.omega_ie**2

PAD = MAX_STATES  # row length of covariance arrays
_S = np.uint64(PAD)
_U = np.uint64  # unsigned indices spare the test for negative ones, which would keep loops from being vectorised


@inlined
def dcm(q):
    """The nine elements of the matrix of a quaternion, row by row."""
    w, x, y, z = q[0], q[1], q[2], q[3]
    return (
        w * w + x * x - y * y - z * z, 2.0 * (x * y - w * z), 2.0 * (x * z + w * y),
        2.0 * (x * y + w * z), w * w - x * x + y * y - z * z, 2.0 * (y * z - w * x),
        2.0 * (x * z - w * y), 2.0 * (y * z + w * x), w * w - x * x - y * y + z * z,
    )  # fmt: skip


@kernel
def spread_estimates(est, ptab, n_sensor, sens):
    """Write the sensor parameters of ``est`` into ``sens``; matrices are inverted here, once per correction."""
    Mg, Ma = np.zeros((3, 3)), np.zeros((3, 3))
    for i in range(6):
        sens[i] = 0.0
    for i in range(9):
        sens[24 + i] = 0.0
    for i in range(3):
        Mg[i, i] = Ma[i, i] = 1.0
    for k in range(n_sensor):
        gyro, i, source = ptab[k, 0] == 0, ptab[k, 1], ptab[k, 2]
        if source == 0:
            sens[i if gyro else 3 + i] += est[k]
        elif gyro and source >= 4:
            Mg[i, source - 4] += est[k]
        elif gyro:
            sens[24 + 3 * i + source - 1] += est[k]
        else:
            Ma[i, source - 1] += est[k]
    invert3(Mg, sens, 6)
    invert3(Ma, sens, 15)


@inlined
def invert3(M, out, o):
    """Inverse of a 3 x 3 matrix by cofactors, written row by row to ``out[o : o + 9]``."""
    c00 = M[1, 1] * M[2, 2] - M[1, 2] * M[2, 1]
    c01 = M[1, 2] * M[2, 0] - M[1, 0] * M[2, 2]
    c02 = M[1, 0] * M[2, 1] - M[1, 1] * M[2, 0]
    d = 1.0 / (M[0, 0] * c00 + M[0, 1] * c01 + M[0, 2] * c02)
    out[o], out[o + 3], out[o + 6] = d * c00, d * c01, d * c02
    out[o + 1] = d * (M[0, 2] * M[2, 1] - M[0, 1] * M[2, 2])
    out[o + 4] = d * (M[0, 0] * M[2, 2] - M[0, 2] * M[2, 0])
    out[o + 7] = d * (M[0, 1] * M[2, 0] - M[0, 0] * M[2, 1])
    out[o + 2] = d * (M[0, 1] * M[1, 2] - M[0, 2] * M[1, 1])
    out[o + 5] = d * (M[0, 2] * M[1, 0] - M[0, 0] * M[1, 2])
    out[o + 8] = d * (M[0, 0] * M[1, 1] - M[0, 1] * M[1, 0])


@inlined
def compensate(poly, raw, sens, h, matrix):
    """Interval polynomial with the estimated sensor errors taken out: the exact inverse of the sensor model."""
    for i in range(18):
        poly[i] = raw[i]
    for i in range(3):
        poly[i] -= sens[i] * h
        poly[9 + i] -= sens[3 + i] * h
    if matrix:
        for o in range(3):
            x, y, z = poly[9 + 3 * o], poly[10 + 3 * o], poly[11 + 3 * o]
            x, y, z = (
                sens[15] * x + sens[16] * y + sens[17] * z,
                sens[18] * x + sens[19] * y + sens[20] * z,
                sens[21] * x + sens[22] * y + sens[23] * z,
            )
            poly[9 + 3 * o], poly[10 + 3 * o], poly[11 + 3 * o] = x, y, z
            p = poly[3 * o] - (sens[24] * x + sens[25] * y + sens[26] * z)
            q = poly[3 * o + 1] - (sens[27] * x + sens[28] * y + sens[29] * z)
            r = poly[3 * o + 2] - (sens[30] * x + sens[31] * y + sens[32] * z)
            poly[3 * o] = sens[6] * p + sens[7] * q + sens[8] * r
            poly[3 * o + 1] = sens[9] * p + sens[10] * q + sens[11] * r
            poly[3 * o + 2] = sens[12] * p + sens[13] * q + sens[14] * r


@inlined
def accumulate(acc, B, nav, dx, dy, dz, poly, h, sens, ptab, n_sensor, matrix, reg, cols):
    """Extend the transition by one interval; call it after ``nav`` is advanced.

    ``dx, dy, dz`` is the interval's specific force integral in Earth-fixed axes. ``reg`` (7) receives the integrals of
    the regressors (time, force, rate), ``cols`` (27) the columns that carry a unit of gyro, accelerometer and, through
    G_g, cross error into Earth-fixed axes.
    """
    c = dcm(nav)
    reg[0] = h
    for i in range(3):
        reg[1 + i] = poly[9 + i] + 0.5 * poly[12 + i] + poly[15 + i] / 6.0
        reg[4 + i] = poly[i] + 0.5 * poly[3 + i] + poly[6 + i] / 6.0
    # C at mid interval: turned back by half the increment, to first order
    hx, hy, hz = -0.5 * reg[4], -0.5 * reg[5], -0.5 * reg[6]
    m00, m01, m02 = c[0] + c[1] * hz - c[2] * hy, c[1] + c[2] * hx - c[0] * hz, c[2] + c[0] * hy - c[1] * hx
    m10, m11, m12 = c[3] + c[4] * hz - c[5] * hy, c[4] + c[5] * hx - c[3] * hz, c[5] + c[3] * hy - c[4] * hx
    m20, m21, m22 = c[6] + c[7] * hz - c[8] * hy, c[7] + c[8] * hx - c[6] * hz, c[8] + c[6] * hy - c[7] * hx
    if matrix:
        for i in range(3):
            for o in range(2):
                s = 6 + 9 * o + i
                cols[9 * o + i] = m00 * sens[s] + m01 * sens[s + 3] + m02 * sens[s + 6]
                cols[9 * o + 3 + i] = m10 * sens[s] + m11 * sens[s + 3] + m12 * sens[s + 6]
                cols[9 * o + 6 + i] = m20 * sens[s] + m21 * sens[s + 3] + m22 * sens[s + 6]
        # accelerometer error -> gyro through G_g: -C (I + M_g)^-1 G_g (I + M_a)^-1
        for i in range(3):
            g0 = sens[24] * sens[15 + i] + sens[25] * sens[18 + i] + sens[26] * sens[21 + i]
            g1 = sens[27] * sens[15 + i] + sens[28] * sens[18 + i] + sens[29] * sens[21 + i]
            g2 = sens[30] * sens[15 + i] + sens[31] * sens[18 + i] + sens[32] * sens[21 + i]
            for r in range(3):
                cols[18 + 3 * r + i] = -(cols[3 * r] * g0 + cols[3 * r + 1] * g1 + cols[3 * r + 2] * g2)
    else:
        cols[0], cols[1], cols[2], cols[3], cols[4], cols[5], cols[6], cols[7], cols[8] = (
            m00, m01, m02, m10, m11, m12, m20, m21, m22
        )  # fmt: skip
        for i in range(9):
            cols[9 + i] = cols[i]
    hh = 0.5 * h
    P0, P1, P2 = B[0], B[1], B[2]
    V0, V1, V2 = B[3], B[4], B[5]
    R0, R1, R2 = B[6], B[7], B[8]
    for k in range(n_sensor):
        i = ptab[k, 1]
        d = -reg[ptab[k, 2]]
        if ptab[k, 0] == 0:
            e0, e1, e2 = d * cols[i], d * cols[3 + i], d * cols[6 + i]
            w0 = w1 = w2 = 0.0
        else:
            w0, w1, w2 = d * cols[9 + i], d * cols[12 + i], d * cols[15 + i]
            e0 = e1 = e2 = 0.0
            if matrix:
                e0, e1, e2 = d * cols[18 + i], d * cols[21 + i], d * cols[24 + i]
        p0, p1, p2 = P0[k] + 0.5 * e0, P1[k] + 0.5 * e1, P2[k] + 0.5 * e2
        P0[k] += e0
        P1[k] += e1
        P2[k] += e2
        # dv = psi x dv_e + accelerometer error
        w0 += p1 * dz - p2 * dy
        w1 += p2 * dx - p0 * dz
        w2 += p0 * dy - p1 * dx
        R0[k] += h * V0[k] + hh * w0
        R1[k] += h * V1[k] + hh * w1
        R2[k] += h * V2[k] + hh * w2
        V0[k] += w0
        V1[k] += w1
        V2[k] += w2
    acc[5] += h * acc[2] + hh * dx
    acc[6] += h * acc[3] + hh * dy
    acc[7] += h * acc[4] + hh * dz
    acc[2] += dx
    acc[3] += dy
    acc[4] += dz
    acc[0] += h
    acc[1] += math.sqrt(reg[4] * reg[4] + reg[5] * reg[5] + reg[6] * reg[6])


@inlined
def padded(n):
    """Columns worth computing for n states: whole vectors of eight, and at least the 24 that LLVM vectorises."""
    return max(24, 8 * ((n + 7) // 8))


@inlined
def transition(A, acc, nav, omega):
    """The 9 x 9 navigation block of the transition; elements that are always zero are never touched."""
    T = acc[0]
    w = omega * T
    A[0, 0] = A[1, 1] = 1.0 - 0.5 * w * w
    A[0, 1], A[1, 0] = w, -w
    # F_s = -[a x] and F_ss = -[s x], with Coriolis after and the turn of the axes before them:
    # velocity rows F_s - 2 W F_ss - (T F_s - F_ss) W, position rows F_ss
    x, y, z = acc[2], acc[3], acc[4]
    p, q, r = acc[5], acc[6], acc[7]
    i, j, k = omega * (T * x - p), omega * (T * y - q), omega * (T * z - r)
    o = 2.0 * omega
    A[3, 0], A[3, 1], A[3, 2] = -k - o * r, z, -y + o * p
    A[4, 0], A[4, 1], A[4, 2] = -z, -k - o * r, x + o * q
    A[5, 0], A[5, 1], A[5, 2] = y + i, -x + j, 0.0
    A[6, 1], A[6, 2] = r, -q
    A[7, 0], A[7, 2] = -r, p
    A[8, 0], A[8, 1] = q, -p
    A[3, 3] = A[4, 4] = 1.0 - 2.0 * w * w
    A[3, 4], A[4, 3] = 2.0 * w, -2.0 * w
    A[5, 5] = 1.0
    A[6, 3] = A[7, 4] = A[8, 5] = T
    A[6, 4], A[7, 3] = w * T, -w * T
    rx, ry, rz = nav[7], nav[8], nav[9]
    i2 = 1.0 / (rx * rx + ry * ry + rz * rz)
    g = T * _GM * i2 * math.sqrt(i2)
    k = 3.0 * g * i2
    c = T * _OMEGA_2 - g
    xx, yy, zz, xy, xz, yz = k * rx * rx + c, k * ry * ry + c, k * rz * rz - g, k * rx * ry, k * rx * rz, k * ry * rz
    A[3, 6], A[3, 7], A[3, 8] = xx, xy, xz
    A[4, 6], A[4, 7], A[4, 8] = xy, yy, yz
    A[5, 6], A[5, 7], A[5, 8] = xz, yz, zz
    h = 0.5 * T
    A[6, 6], A[6, 7], A[6, 8] = 1.0 + h * xx, h * xy, h * xz
    A[7, 6], A[7, 7], A[7, 8] = h * xy, 1.0 + h * yy, h * yz
    A[8, 6], A[8, 7], A[8, 8] = h * xz, h * yz, 1.0 + h * zz


@inlined
def phi_rows(A, B, x, o, w, n_sensor):
    """First nine rows of the transition times the rows of ``x``, written to ``o`` (both flat, rows PAD long)."""
    a, b, c, d = A[0, 0], A[0, 1], A[1, 0], A[1, 1]
    for j in range(w):
        p, q = x[j], x[_S + j]
        o[j] = a * p + b * q
        o[_S + j] = c * p + d * q
        o[_U(2) * _S + j] = x[_U(2) * _S + j]
    for block in range(2):
        i = 3 + 3 * block
        t = _U(i) * _S
        a00, a01, a02 = A[i, 0], A[i, 1], A[i, 2]
        a10, a11, a12 = A[i + 1, 0], A[i + 1, 1], A[i + 1, 2]
        a20, a21, a22 = A[i + 2, 0], A[i + 2, 1], A[i + 2, 2]
        b00, b01, b10, b11, b22 = A[i, 3], A[i, 4], A[i + 1, 3], A[i + 1, 4], A[i + 2, 5]
        c00, c01, c02 = A[i, 6], A[i, 7], A[i, 8]
        c10, c11, c12 = A[i + 1, 6], A[i + 1, 7], A[i + 1, 8]
        c20, c21, c22 = A[i + 2, 6], A[i + 2, 7], A[i + 2, 8]
        for j in range(w):
            p, q, r = x[j], x[_S + j], x[_U(2) * _S + j]
            e, f, g = x[_U(3) * _S + j], x[_U(4) * _S + j], x[_U(5) * _S + j]
            u, v, z = x[_U(6) * _S + j], x[_U(7) * _S + j], x[_U(8) * _S + j]
            o[t + j] = a00 * p + a01 * q + a02 * r + b00 * e + b01 * f + c00 * u + c01 * v + c02 * z
            o[t + _S + j] = a10 * p + a11 * q + a12 * r + b10 * e + b11 * f + c10 * u + c11 * v + c12 * z
            o[t + _U(2) * _S + j] = a20 * p + a21 * q + a22 * r + b22 * g + c20 * u + c21 * v + c22 * z
    for k in range(0, n_sensor, 3):
        y = _U(9 + k) * _S
        b00, b01, b02 = B[0, k], B[0, k + 1], B[0, k + 2]
        b10, b11, b12 = B[1, k], B[1, k + 1], B[1, k + 2]
        b20, b21, b22 = B[2, k], B[2, k + 1], B[2, k + 2]
        b30, b31, b32 = B[3, k], B[3, k + 1], B[3, k + 2]
        b40, b41, b42 = B[4, k], B[4, k + 1], B[4, k + 2]
        b50, b51, b52 = B[5, k], B[5, k + 1], B[5, k + 2]
        b60, b61, b62 = B[6, k], B[6, k + 1], B[6, k + 2]
        b70, b71, b72 = B[7, k], B[7, k + 1], B[7, k + 2]
        b80, b81, b82 = B[8, k], B[8, k + 1], B[8, k + 2]
        for j in range(w):
            p, q, r = x[y + j], x[y + _S + j], x[y + _U(2) * _S + j]
            o[j] += b00 * p + b01 * q + b02 * r
            o[_S + j] += b10 * p + b11 * q + b12 * r
            o[_U(2) * _S + j] += b20 * p + b21 * q + b22 * r
            o[_U(3) * _S + j] += b30 * p + b31 * q + b32 * r
            o[_U(4) * _S + j] += b40 * p + b41 * q + b42 * r
            o[_U(5) * _S + j] += b50 * p + b51 * q + b52 * r
            o[_U(6) * _S + j] += b60 * p + b61 * q + b62 * r
            o[_U(7) * _S + j] += b70 * p + b71 * q + b72 * r
            o[_U(8) * _S + j] += b80 * p + b81 * q + b82 * r


@inlined
def add_half_noise(P, nav, T, q_imu, pmod, m):
    """Half the process noise of an interval: added before and after the transition it is the trapezoid rule."""
    h = 0.5 * T
    if q_imu[0] == q_imu[1] == q_imu[2] and q_imu[3] == q_imu[4] == q_imu[5]:
        for i in range(3):
            P[i, i] += h * q_imu[0]
            P[3 + i, 3 + i] += h * q_imu[3]
    else:
        c = dcm(nav)
        for i in range(3):
            for j in range(3):
                g, f = 0.0, 0.0
                for a in range(3):
                    g += c[3 * i + a] * q_imu[a] * c[3 * j + a]
                    f += c[3 * i + a] * q_imu[3 + a] * c[3 * j + a]
                P[i, j] += h * g
                P[3 + i, 3 + j] += h * f
    for k in range(m):
        P[9 + k, 9 + k] += h * pmod[k, 1]


@kernel
def flush(P, nav, acc, B, A, work, D, pmod, n_sensor, i_clock, omega):
    """Carry the covariance over the accumulated transition: ``P <- Phi P Phi'``. Noise is added by the caller.

    ``i_clock`` is the state of the clock offset, -1 for none. ``work`` is (18 + n, PAD) and zero beyond column n; only
    navigation rows are ever multiplied.
    """
    n = P.shape[0]
    m = n - 9
    T = acc[0]
    decays = False
    for k in range(m):
        D[k] = 1.0
        if pmod[k, 0] > 0.0:
            x = pmod[k, 0] * T
            if x < 0.01:  # (1 - exp(-x)) / x: the mean of the decaying error over the interval
                mean = 1.0 - x * (0.5 - x * (1.0 / 6.0 - x * (1.0 / 24.0 - x / 120.0)))
            else:
                mean = -math.expm1(-x) / x
            D[k] = 1.0 - x * mean
            decays = True
            if k < n_sensor:
                for i in range(9):
                    B[i, k] *= mean
    transition(A, acc, nav, omega)
    flat = work.reshape(work.size)
    T1, O9, Z = flat[: 9 * PAD], flat[9 * PAD : 18 * PAD], flat[18 * PAD :]
    phi_rows(A, B, P.reshape(P.size), T1, _U(padded(n)), n_sensor)
    for j in range(n):
        z = work[18 + j]
        for i in range(9):
            z[i] = work[i, j]
    phi_rows(A, B, Z, O9, _U(24), n_sensor)
    for i in range(9):
        p, o = P[i], work[9 + i]
        for j in range(9):
            p[j] = 0.5 * (o[j] + work[9 + j, i])
        t = work[i]
        for k in range(m):
            v = t[9 + k] * D[k]
            p[9 + k] = v
            P[9 + k, i] = v
    if decays:
        for k in range(m):
            p, d = P[9 + k], D[k]
            for j in range(m):
                p[9 + j] *= d * D[j]
    if i_clock >= 0:  # the clock's offset grows by its drift
        a, b = P[i_clock], P[i_clock + 1]
        for j in range(n):
            a[j] += T * b[j]
        for j in range(n):
            P[j, i_clock] += T * P[j, i_clock + 1]


@inlined
def clear(acc, B):
    """Start a new transition."""
    for i in range(8):
        acc[i] = 0.0
    for i in range(9):
        for k in range(B.shape[1]):
            B[i, k] = 0.0
