"""Compiled covariance propagation: the transition of the error state and ``P <- Phi P Phi' + Q``.

Transition over one propagation interval T, columns dpsi, dv, dr, parameters::

    dpsi:  R_e        0            0           B_psi
    dv:    -[a x]     I - 2 W T    G T         B_v       a = sum of dv_e,  W = [omega_ie x],
    dr:    -[s x]     I T - W T^2  I + G T^2/2 B_r       s = double sum,   G = gravity gradient
    p:     0          0            0           S D       (Coriolis also acts on a and s to first order)

``a``, ``s`` and ``B`` come from the IMU samples by the mid-point rule (``accumulation``), so the transition is right
whatever the body does between propagations; only terms of order (omega_ie T)^2 and G T^3 are left out. D is the decay
of Gauss-Markov states; S adds T times a receiver clock's drift to its offset, the only parameters that act on each
other.

The text is compiled for numbers (the filter, replays of budgets) and for lanes (Monte Carlo runs,
``montecarlo.lanes``). In the filter eight columns of the covariance are one lane vector: the function that takes one
column of eight runs takes eight columns of one run.

Arrays (C-contiguous float64 and int64, owned by the caller), with m parameters and n = 9 + m states:

``P[n, PAD]``    covariance of the errors (estimate minus truth): dpsi_e, dv_e, dr_e, parameters; columns from n on are
                 zero and are computed along, since whole vectors cost less than remainders
``acc[8]``       since the last propagation: elapsed time, turned angle, a 3, s 3
``B[m, 9]``      parameter columns of the transition, one parameter a row
``pmod[m, 2]``   1 / correlation time (0: none) and power spectral density of the driving noise
``q_imu[6]``     white-noise power spectral densities, gyro 3 and accelerometer 3
"""

from __future__ import annotations

import math

from schuler.earth import WGS84
from schuler.filtering.kernels.vector import LANES, as_lanes
from schuler.filtering.limits import MAX_STATES
from schuler.jit import borrowing, inlined

_GM = WGS84.GM
_OMEGA_2 = WGS84.omega_ie**2

PAD = MAX_STATES  # row length of covariance arrays
BLOCKS = PAD // LANES


@inlined
def dcm(q):
    """The nine elements of the matrix of a quaternion, row by row."""
    w, x, y, z = q[0], q[1], q[2], q[3]
    return (
        w * w + x * x - y * y - z * z, 2.0 * (x * y - w * z), 2.0 * (x * z + w * y),
        2.0 * (x * y + w * z), w * w - x * x + y * y - z * z, 2.0 * (y * z - w * x),
        2.0 * (x * z - w * y), 2.0 * (y * z + w * x), w * w - x * x - y * y + z * z,
    )  # fmt: skip


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
def gram_two(X, i, Y, j, rows):
    """``X[:, i:i + 3]' Y[:, j:j + 2]`` over some rows, itself row by row."""
    s00 = s01 = s10 = s11 = s20 = s21 = 0.0
    for t in rows:
        x0, x1, x2 = X[t, i], X[t, i + 1], X[t, i + 2]
        y0, y1 = Y[t, j], Y[t, j + 1]
        s00 += x0 * y0
        s01 += x0 * y1
        s10 += x1 * y0
        s11 += x1 * y1
        s20 += x2 * y0
        s21 += x2 * y1
    return s00, s01, s10, s11, s20, s21


@inlined
def gram_one(X, i, Y, j, rows):
    """``X[:, i:i + 3]' Y[:, j]`` over some rows."""
    s0 = s1 = s2 = 0.0
    for t in rows:
        y = Y[t, j]
        s0 += X[t, i] * y
        s1 += X[t, i + 1] * y
        s2 += X[t, i + 2] * y
    return s0, s1, s2


@inlined
def add_parameters(rows, width, i, first, B, y, sources):
    """Add ``B' y`` of some parameters to three rows from ``i`` on, columns from ``first`` to before ``width``."""
    c = first
    while c + 3 <= width:
        s = gram(B, i, y, c, sources)
        for a in range(3):
            row = rows[i + a]
            row[c] += s[3 * a]
            row[c + 1] += s[3 * a + 1]
            row[c + 2] += s[3 * a + 2]
        c += 3
    if c + 2 == width:
        z = gram_two(B, i, y, c, sources)
        for a in range(3):
            row = rows[i + a]
            row[c] += z[2 * a]
            row[c + 1] += z[2 * a + 1]
    elif c + 1 == width:
        u = gram_one(B, i, y, c, sources)
        for a in range(3):
            rows[i + a, c] += u[a]


@borrowing
def navigation_rows(A, B, x, y, rows, width, on_psi, n_sensor, lower):
    """Navigation rows of the transition times some columns: ``rows[i, c] = A[i] x[:, c] + B[:, i] y[:, c]``.

    ``x[9, c]`` are navigation states, ``y[m, c]`` parameters. Elements are numbers or lanes: columns of eight runs, or
    eight columns of one run. ``on_psi`` lists the parameters that act on the attitude. With ``lower`` the result is
    symmetric, and parameters are added where c is not left of the three rows' block.
    """
    for c in range(width):
        (
            rows[0, c], rows[1, c], rows[2, c], rows[3, c], rows[4, c], rows[5, c], rows[6, c], rows[7, c], rows[8, c],
        ) = apply_navigation(
            A, x[0, c], x[1, c], x[2, c], x[3, c], x[4, c], x[5, c], x[6, c], x[7, c], x[8, c]
        )  # fmt: skip
    if n_sensor > 0:
        add_parameters(rows, width, 0, 0, B, y, on_psi)
        for i in range(3, 9, 3):
            add_parameters(rows, width, i, i if lower else 0, B, y, range(n_sensor))


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
    for k in range(P.shape[0] - 9):
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


@inlined
def scale_parameters(P, D):
    """Parameter block of the covariance times what is left of each parameter: ``P_pp <- D P_pp D``."""
    m = P.shape[0] - 9
    for i in range(m):
        p = P[9 + i]
        for j in range(m):
            d = D[i] * D[j]
            if d != 1.0:
                p[9 + j] *= d


@inlined
def add_clock_drift(P, i_clock, T):
    """Covariance of a receiver clock's offset that has grown by its drift; ``i_clock`` -1 is no clock."""
    if i_clock >= 0:
        n = P.shape[0]
        a, b = P[i_clock], P[i_clock + 1]
        for j in range(n):
            a[j] += T * b[j]
        for j in range(n):
            P[j, i_clock] += T * P[j, i_clock + 1]


@inlined
def flush(P, nav, acc, A, B, rows, turned, D, mean, on_psi, n_sensor, decays, omega):
    """Carry the covariance over the accumulated transition: ``P <- Phi P Phi'``. Noise is added by the caller.

    ``rows[9, PAD]`` and ``turned[9, PAD]`` are workspace; ``D, mean, decays`` as :func:`decay` leaves them. Parameter
    columns are multiplied by ``mean``.
    """
    n = P.shape[0]
    m = n - 9
    if decays:
        for k in range(n_sensor):
            if mean[k] != 1.0:
                for i in range(9):
                    B[k, i] *= mean[k]
    transition(A, acc, nav, omega)
    blocks = (n + LANES - 1) // LANES
    columns = as_lanes(P.reshape((n, BLOCKS, LANES)))
    parameters = columns[9:]
    navigation_rows(
        A, B, columns, parameters, as_lanes(rows.reshape((9, BLOCKS, LANES))), blocks, on_psi, n_sensor, False
    )  # Phi P
    for k in range(m):  # its parameter columns are by symmetry the parameter rows of P Phi'
        p = P[9 + k]
        for i in range(9):
            p[i] = rows[i, 9 + k]
    for i in range(9):
        for j in range(9):
            turned[j, i] = rows[i, j]
    navigation_rows(
        A, B, as_lanes(turned.reshape((9, BLOCKS, LANES))), parameters, columns, 2, on_psi, n_sensor, False
    )  # Phi P Phi'
    for i in range(9):
        p, r = P[i], rows[i]
        for j in range(i):
            p[j] = P[j, i]
        for j in range(9, n):
            p[j] = r[j]
    if decays:
        for k in range(m):
            d = D[k]
            if d != 1.0:
                p = P[9 + k]
                for i in range(9):
                    p[i] *= d
                    P[i, 9 + k] *= d
        scale_parameters(P, D)
