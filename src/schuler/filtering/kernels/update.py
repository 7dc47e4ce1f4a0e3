"""Compiled measurement updates: rows of H, innovation, correction, feedback. Arrays as in ``_covariance_kernels``."""

from __future__ import annotations

import math

from schuler.earth import WGS84
from schuler.filtering.kernels.covariance import PAD, dcm, padded
from schuler.filtering.kernels.range import pseudorange, range_rate
from schuler.filtering.kernels.rest import earth_rate, gravity_magnitude, gravity_vector
from schuler.filtering.kernels.vehicle import heading, height, rate_columns, vehicle_velocity, zero_rate
from schuler.jit import borrowing, inlined
from schuler.mechanization.kernels import gravity_e, half_angle

_A = WGS84.a
_B = WGS84.b
_E2 = WGS84.e2

# Measurement kinds; `measurements.py` names them for Python.
POSITION = 1
VELOCITY = 2
ZERO_VELOCITY = 3
LATERAL = 4
VERTICAL = 5
SPEED = 6
ZERO_RATE = 7
PSEUDORANGE = 8
RANGE_RATE = 9
HEADING = 10
HEIGHT = 11
FIX = 12
RESET_POSITION = 13
RESET_VELOCITY = 14
GNSS_HEADING = 15
GRAVITY = 16
GRAVITY_VECTOR = 17
EARTH_RATE = 18
EARTH_RATE_MAGNITUDE = 19

(
    AT_LEVER, AT_MOUNT, AT_ODOMETER, AT_LEVER_V, AT_CLOCK, AT_CLOCK_2, AT_CLOCK_3, AT_CLOCK_4, AT_HEADING, AT_BARO,
    AT_B_R, AT_B_V, AT_DELAY,
) = range(13)  # order of limits.PLACES  # fmt: skip


@inlined
def longitude_direction(x, y, p):
    """Cosine and sine of longitude at distance ``p`` from the axis; at the poles, longitude zero."""
    if p > 0.0:
        return x / p, y / p
    return 1.0, 0.0


@inlined
def ned_axes(r, U):
    """North, east, down unit vectors at an Earth-fixed position as rows of ``U`` (one of Bowring's steps)."""
    x, y, z = r[7], r[8], r[9]
    p = math.sqrt(x * x + y * y)
    t = math.sqrt(_A * _A * z * z + _B * _B * p * p)
    sb, cb = _A * z / t, _B * p / t
    S = z + _E2 / (1.0 - _E2) * _B * sb * sb * sb
    C = p - _E2 * _A * cb * cb * cb
    t = math.sqrt(S * S + C * C)
    sL, cL = S / t, C / t
    cl, sl = longitude_direction(x, y, p)
    U[0, 0], U[0, 1], U[0, 2] = -sL * cl, -sL * sl, cL
    U[1, 0], U[1, 1], U[1, 2] = -sl, cl, 0.0
    U[2, 0], U[2, 1], U[2, 2] = -cL * cl, -cL * sl, -sL


@borrowing
def measurement_rows(kind, z, lever, nav, est, reg, sens, ptab, n_sensor, at, omega, H, y, U):
    """Rows ``H`` (3, n) and difference ``y`` = predicted minus measured; returns how many.

    Position: ``r + C l``, velocity: ``v + C (omega_ib x l) - omega_ie x (C l)``, both north, east, down. Other kinds
    are in ``_vehicle_kernels``, ``_rest_kernels`` and ``_range_kernels``. ``reg`` holds the regressors of the current
    interval (integrals of time, force and rate), whose means stand for the instant. ``at`` are the first states of the
    blocks in ``limits.PLACES``, -1 for those not estimated.
    """
    for i in range(3):
        for j in range(PAD):
            H[i, j] = 0.0
    ned_axes(nav, U)
    if kind == ZERO_RATE:
        return zero_rate(z, nav, reg, sens, ptab, n_sensor, omega, H, y)
    if kind >= GRAVITY:
        if kind == GRAVITY:
            return gravity_magnitude(z, nav, sens, ptab, n_sensor, H, y)
        if kind == GRAVITY_VECTOR:
            return gravity_vector(z, nav, sens, ptab, n_sensor, H, y, U)
        return earth_rate(z, nav, sens, ptab, n_sensor, omega, kind == EARTH_RATE, H, y, U)
    if kind in (HEADING, GNSS_HEADING):
        return heading(z, nav, est, at[AT_HEADING], H, y, U)
    l0, l1, l2 = lever[0], lever[1], lever[2]
    if LATERAL <= kind <= SPEED:
        i_lever = at[AT_LEVER_V]
        if i_lever >= 0:
            l0, l1, l2 = l0 + est[i_lever - 9], l1 + est[i_lever - 8], l2 + est[i_lever - 7]
        axis = 0 if kind == SPEED else kind - 3
        return vehicle_velocity(
            axis,
            z,
            l0,
            l1,
            l2,
            nav,
            est,
            reg,
            sens,
            ptab,
            n_sensor,
            at[AT_MOUNT],
            at[AT_ODOMETER],
            i_lever,
            omega,
            H,
            y,
        )
    c00, c01, c02, c10, c11, c12, c20, c21, c22 = dcm(nav)
    i_lever = -1
    if kind != HEIGHT and kind != FIX:  # those have lever arms of their own
        i_lever = at[AT_LEVER_V] if kind == ZERO_VELOCITY else at[AT_LEVER]
        if i_lever >= 0:
            l0, l1, l2 = l0 + est[i_lever - 9], l1 + est[i_lever - 8], l2 + est[i_lever - 7]
    L0, L1, L2 = c00 * l0 + c01 * l1 + c02 * l2, c10 * l0 + c11 * l1 + c12 * l2, c20 * l0 + c21 * l1 + c22 * l2
    if kind == HEIGHT:
        return height(z, L0, L1, L2, nav, est, at[AT_BARO], H, y, U)
    if kind == PSEUDORANGE:
        group = int(z[4])
        other = at[AT_CLOCK + group] if 0 < group < 4 else -1
        return pseudorange(z, L0, L1, L2, nav, est, at[AT_CLOCK], other, i_lever, omega, H, y)
    delay = est[at[AT_DELAY] - 9] if at[AT_DELAY] >= 0 and kind != ZERO_VELOCITY and kind != FIX else 0.0
    has_delay = at[AT_DELAY] >= 0 and kind != ZERO_VELOCITY and kind != FIX
    if kind in (POSITION, FIX, RESET_POSITION):
        d0, d1, d2 = nav[7] + L0 - z[0], nav[8] + L1 - z[1], nav[9] + L2 - z[2]
        correlated = at[AT_B_R] if kind == POSITION else -1
        for i in range(3):
            u0, u1, u2 = U[i, 0], U[i, 1], U[i, 2]
            H[i, 0], H[i, 1], H[i, 2] = L1 * u2 - L2 * u1, L2 * u0 - L0 * u2, L0 * u1 - L1 * u0
            H[i, 6], H[i, 7], H[i, 8] = u0, u1, u2
            if i_lever >= 0:
                H[i, i_lever] = u0 * c00 + u1 * c10 + u2 * c20
                H[i, i_lever + 1] = u0 * c01 + u1 * c11 + u2 * c21
                H[i, i_lever + 2] = u0 * c02 + u1 * c12 + u2 * c22
            y[i] = u0 * d0 + u1 * d1 + u2 * d2
            if has_delay:  # the fix belongs to a time later by ``delay`` than its stamp says
                speed = u0 * nav[4] + u1 * nav[5] + u2 * nav[6]
                y[i] += delay * speed
                H[i, at[AT_DELAY]] = speed
                H[i, 3], H[i, 4], H[i, 5] = delay * u0, delay * u1, delay * u2
            if correlated >= 0:
                y[i] += est[correlated - 9 + i]
                H[i, correlated + i] = 1.0
        return 3
    # velocity of the antenna; of a zero-velocity update that of the point that rests: axle, sole of a shoe
    k = 1.0 / reg[0] if reg[0] > 0.0 else 0.0
    w0, w1, w2 = k * reg[4], k * reg[5], k * reg[6]
    x0, x1, x2 = w1 * l2 - w2 * l1, w2 * l0 - w0 * l2, w0 * l1 - w1 * l0
    if kind != RANGE_RATE:  # a lever arm that turns in the IMU's axes
        x0, x1, x2 = x0 + z[3], x1 + z[4], x2 + z[5]
    M0, M1, M2 = c00 * x0 + c01 * x1 + c02 * x2, c10 * x0 + c11 * x1 + c12 * x2, c20 * x0 + c21 * x1 + c22 * x2
    if kind == RANGE_RATE:
        g0, g1, g2 = range_rate(z, L0, L1, L2, M0, M1, M2, w0, w1, w2, nav, est, at[AT_CLOCK], i_lever, omega, H, y)
        t0, t1, t2 = g0 * c00 + g1 * c10 + g2 * c20, g0 * c01 + g1 * c11 + g2 * c21, g0 * c02 + g1 * c12 + g2 * c22
        if l0 != 0.0 or l1 != 0.0 or l2 != 0.0:
            s0, s1, s2 = l1 * t2 - l2 * t1, l2 * t0 - l0 * t2, l0 * t1 - l1 * t0
            rate_columns(H, 0, s0, s1, s2, k, reg, sens, ptab, n_sensor)
        return 1
    v0, v1, v2 = nav[4] + M0 + omega * L1, nav[5] + M1 - omega * L0, nav[6] + M2
    has_lever = l0 != 0.0 or l1 != 0.0 or l2 != 0.0
    correlated = at[AT_B_V] if kind == VELOCITY else -1
    f0 = f1 = f2 = a0 = a1 = a2 = 0.0
    if has_delay:  # acceleration: specific force, gravity, Coriolis; of the IMU, its turning about it left out
        f0, f1, f2 = k * reg[1], k * reg[2], k * reg[3]
        f0, f1, f2 = c00 * f0 + c01 * f1 + c02 * f2, c10 * f0 + c11 * f1 + c12 * f2, c20 * f0 + c21 * f1 + c22 * f2
        a0, a1, a2 = gravity_e(nav[7], nav[8], nav[9])
        a0, a1, a2 = a0 + f0 + 2.0 * omega * nav[5], a1 + f1 - 2.0 * omega * nav[4], a2 + f2
    for i in range(3):
        u0, u1, u2 = U[i, 0], U[i, 1], U[i, 2]
        y[i] = u0 * v0 + u1 * v1 + u2 * v2 - z[i]
        H[i, 3], H[i, 4], H[i, 5] = u0, u1, u2
        e0, e1 = -omega * u1, omega * u0  # omega_ie x u
        H[i, 0] = M1 * u2 - M2 * u1 - L2 * e1
        H[i, 1] = M2 * u0 - M0 * u2 + L2 * e0
        H[i, 2] = M0 * u1 - M1 * u0 + L0 * e1 - L1 * e0
        t0, t1, t2 = u0 * c00 + u1 * c10 + u2 * c20, u0 * c01 + u1 * c11 + u2 * c21, u0 * c02 + u1 * c12 + u2 * c22
        if i_lever >= 0:
            # C [omega x] - [omega_ie x] C
            H[i, i_lever] = t1 * w2 - t2 * w1 + (e0 * c00 + e1 * c10)
            H[i, i_lever + 1] = t2 * w0 - t0 * w2 + (e0 * c01 + e1 * c11)
            H[i, i_lever + 2] = t0 * w1 - t1 * w0 + (e0 * c02 + e1 * c12)
        if has_lever:
            s0, s1, s2 = l1 * t2 - l2 * t1, l2 * t0 - l0 * t2, l0 * t1 - l1 * t0
            rate_columns(H, i, s0, s1, s2, k, reg, sens, ptab, n_sensor)
        if has_delay:
            y[i] += delay * (u0 * a0 + u1 * a1 + u2 * a2)
            H[i, at[AT_DELAY]] = u0 * a0 + u1 * a1 + u2 * a2
            H[i, 0] += delay * (f1 * u2 - f2 * u1)
            H[i, 1] += delay * (f2 * u0 - f0 * u2)
            H[i, 2] += delay * (f0 * u1 - f1 * u0)
            H[i, 3] -= 2.0 * omega * delay * u1
            H[i, 4] += 2.0 * omega * delay * u0
        if correlated >= 0:
            y[i] += est[correlated - 9 + i]
            H[i, correlated + i] = 1.0
    return 3


@borrowing
def reset(kind, R, P, nav, y, U):
    """Put position or velocity where the measurement says, with its covariance and no memory: no filter update.

    ``y`` is predicted minus measured, north, east, down.
    """
    first = 6 if kind == RESET_POSITION else 3
    n = P.shape[0]
    for i in range(3):
        nav[first + 1 + i] -= U[0, i] * y[0] + U[1, i] * y[1] + U[2, i] * y[2]
        for j in range(n):
            P[first + i, j] = 0.0
            P[j, first + i] = 0.0
    for i in range(3):
        for j in range(3):
            v = 0.0
            for a in range(3):
                for b in range(3):
                    v += U[a, i] * R[3 * a + b] * U[b, j]
            P[first + i, first + j] = v


@borrowing
def innovate(P, H, y, R, d, W, G, e, S, L):
    """Whitened innovation of a measurement of ``d`` <= 3 components; nothing is changed yet.

    ``S = H P H' + R = L L'``; ``W = L^-1 H P``, ``G = L^-1 H``, ``e = L^-1 y``. The update is then ``dx = W' e``,
    ``P - W' W``, the normalised innovation squared is ``e . e``, and the smoother needs W, G and e again.

    Returns
    -------
    float64
        e . e, or -1 if S is not positive definite.
    """
    n = P.shape[0]
    wide = padded(n)
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
        for b in range(a + 1):
            v = R[3 * a + b]
            for i in range(n):
                v += H[a, i] * W[b, i]
            S[a, b] = v
            S[b, a] = v
    nis = 0.0
    for a in range(d):
        for b in range(a + 1):
            v = S[a, b]
            for k in range(b):
                v -= L[a, k] * L[b, k]
            if a == b:
                if not v > 0.0:
                    return -1.0
                L[a, a] = math.sqrt(v)
            else:
                L[a, b] = v / L[b, b]
    for a in range(d):
        g, w, h = G[a], W[a], H[a]
        v = y[a]
        for j in range(wide):
            g[j] = h[j]
        for b in range(a):
            k = L[a, b]
            v -= k * e[b]
            gb, wb = G[b], W[b]
            for j in range(wide):
                g[j] -= k * gb[j]
                w[j] -= k * wb[j]
        k = 1.0 / L[a, a]
        e[a] = v * k
        for j in range(wide):
            g[j] *= k
            w[j] *= k
        nis += e[a] * e[a]
    return nis


@borrowing
def correct(P, nav, est, W, e, d, dx):
    """Apply the update: ``P -= W' W`` (symmetric to the last bit) and closed-loop feedback of ``dx = W' e``."""
    n = P.shape[0]
    wide = padded(n)
    for j in range(n):
        dx[j] = 0.0
    for a in range(d):
        w = W[a]
        for j in range(n):
            dx[j] += e[a] * w[j]
        for i in range(n):
            p, k = P[i], w[i]
            for j in range(wide):
                p[j] -= k * w[j]
    rotate_by(nav, -dx[0], -dx[1], -dx[2])
    for i in range(3):
        nav[4 + i] -= dx[3 + i]
        nav[7 + i] -= dx[6 + i]
    for k in range(n - 9):
        est[k] -= dx[9 + k]


@inlined
def rotate_by(nav, x, y, z):
    """Attitude turned by a rotation vector in Earth-fixed axes: ``q <- exp(x, y, z) q``."""
    c, s = half_angle(x, y, z)
    x, y, z = s * x, s * y, s * z
    q0, q1, q2, q3 = nav[0], nav[1], nav[2], nav[3]
    nav[0] = c * q0 - x * q1 - y * q2 - z * q3
    nav[1] = c * q1 + x * q0 + y * q3 - z * q2
    nav[2] = c * q2 - x * q3 + y * q0 + z * q1
    nav[3] = c * q3 + x * q2 - y * q1 + z * q0
