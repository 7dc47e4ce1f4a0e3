"""Compiled measurement updates: rows of H, innovation, correction, feedback. Arrays as in ``covariance``."""

from __future__ import annotations

import math

from schuler.earth import WGS84
from schuler.filtering.kernels.covariance import PAD, dcm, padded
from schuler.filtering.kernels.range import ambiguity, multipath, pseudorange, range_rate
from schuler.filtering.kernels.rest import earth_rate, gravity_magnitude, gravity_vector
from schuler.filtering.kernels.vehicle import heading, height, rate_columns, vehicle_velocity, zero_rate
from schuler.jit import apart, borrowing, inlined
from schuler.mechanization.kernels import gravity_e, rotate_by

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
CARRIER_PHASE = 20
ARC_START = 21

(
    AT_LEVER, AT_MOUNT, AT_ODOMETER, AT_LEVER_V, AT_CLOCK, AT_CLOCK_2, AT_CLOCK_3, AT_CLOCK_4, AT_HEADING, AT_BARO,
    AT_B_R, AT_B_V, AT_DELAY, AT_MULTIPATH, AT_AMBIGUITY,
) = range(15)  # order of limits.PLACES  # fmt: skip
BEGUN = -1.0  # elapsed time of a node that is no propagation but the start of an arc of carrier phases


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


@inlined
def clear_rows(H):
    """Rows of H with nothing in them."""
    for i in range(3):
        row = H[i]
        for j in range(PAD):
            row[j] = 0.0


@inlined
def estimated_lever(lever, est, i_lever):
    """Lever arm in body axes with the estimate of its error, where its three states begin at ``i_lever`` (-1: none)."""
    if i_lever >= 0:
        return lever[0] + est[i_lever - 9], lever[1] + est[i_lever - 8], lever[2] + est[i_lever - 7]
    return lever[0], lever[1], lever[2]


@inlined
def turned_by(c, x, y, z):
    """A vector of body axes in Earth-fixed axes; ``c`` as :func:`~.covariance.dcm` gives it."""
    return (
        c[0] * x + c[1] * y + c[2] * z,
        c[3] * x + c[4] * y + c[5] * z,
        c[6] * x + c[7] * y + c[8] * z,
    )


@inlined
def mean_rate(reg):
    """Mean angular rate of the present interval, body axes, and one over its length."""
    k = 1.0 / reg[0] if reg[0] > 0.0 else 0.0
    return k * reg[4], k * reg[5], k * reg[6], k


@inlined
def correlated_error(i, i_error, est, H, y):
    """Add a Gauss-Markov error of the receiver to component ``i`` of a measurement (-1: not estimated)."""
    if i_error >= 0:
        y[i] += est[i_error - 9 + i]
        H[i, i_error + i] = 1.0


@borrowing
def position_rows(z, lever, nav, est, i_lever, i_error, i_delay, H, y, U):
    """Position of an antenna, north, east, down: ``r + C l + delay v``."""
    l0, l1, l2 = estimated_lever(lever, est, i_lever)
    c = dcm(nav)
    L0, L1, L2 = turned_by(c, l0, l1, l2)
    d0, d1, d2 = nav[7] + L0 - z[0], nav[8] + L1 - z[1], nav[9] + L2 - z[2]
    for i in range(3):
        u0, u1, u2 = U[i, 0], U[i, 1], U[i, 2]
        H[i, 0], H[i, 1], H[i, 2] = L1 * u2 - L2 * u1, L2 * u0 - L0 * u2, L0 * u1 - L1 * u0
        H[i, 6], H[i, 7], H[i, 8] = u0, u1, u2
        if i_lever >= 0:
            for a in range(3):
                H[i, i_lever + a] = u0 * c[a] + u1 * c[3 + a] + u2 * c[6 + a]
        y[i] = u0 * d0 + u1 * d1 + u2 * d2
        if i_delay >= 0:  # the fix belongs to a time later by the delay than its stamp says
            delay, speed = est[i_delay - 9], u0 * nav[4] + u1 * nav[5] + u2 * nav[6]
            y[i] += delay * speed
            H[i, i_delay] = speed
            H[i, 3], H[i, 4], H[i, 5] = delay * u0, delay * u1, delay * u2
        correlated_error(i, i_error, est, H, y)
    return 3


@borrowing
def velocity_rows(z, lever, nav, est, reg, sens, ptab, n_sensor, i_lever, i_error, i_delay, omega, H, y, U):
    """Velocity of an antenna, north, east, down: ``v + C (omega_ib x l) - omega_ie x (C l) + delay a``.

    Of a zero-velocity update it is that of the point that rests: axle, sole of a shoe. ``z[3:6]`` is the rate of a
    lever arm that turns in the IMU's axes.
    """
    l0, l1, l2 = estimated_lever(lever, est, i_lever)
    c = dcm(nav)
    L0, L1, L2 = turned_by(c, l0, l1, l2)
    w0, w1, w2, k = mean_rate(reg)
    x0, x1, x2 = w1 * l2 - w2 * l1 + z[3], w2 * l0 - w0 * l2 + z[4], w0 * l1 - w1 * l0 + z[5]
    M0, M1, M2 = turned_by(c, x0, x1, x2)
    v0, v1, v2 = nav[4] + M0 + omega * L1, nav[5] + M1 - omega * L0, nav[6] + M2
    has_lever = l0 != 0.0 or l1 != 0.0 or l2 != 0.0
    for i in range(3):
        u0, u1, u2 = U[i, 0], U[i, 1], U[i, 2]
        y[i] = u0 * v0 + u1 * v1 + u2 * v2 - z[i]
        H[i, 3], H[i, 4], H[i, 5] = u0, u1, u2
        e0, e1 = -omega * u1, omega * u0  # omega_ie x u
        H[i, 0] = M1 * u2 - M2 * u1 - L2 * e1
        H[i, 1] = M2 * u0 - M0 * u2 + L2 * e0
        H[i, 2] = M0 * u1 - M1 * u0 + L0 * e1 - L1 * e0
        t0, t1, t2 = (
            u0 * c[0] + u1 * c[3] + u2 * c[6],
            u0 * c[1] + u1 * c[4] + u2 * c[7],
            u0 * c[2] + u1 * c[5] + u2 * c[8],
        )
        if i_lever >= 0:  # C [omega x] - [omega_ie x] C
            H[i, i_lever] = t1 * w2 - t2 * w1 + (e0 * c[0] + e1 * c[3])
            H[i, i_lever + 1] = t2 * w0 - t0 * w2 + (e0 * c[1] + e1 * c[4])
            H[i, i_lever + 2] = t0 * w1 - t1 * w0 + (e0 * c[2] + e1 * c[5])
        if has_lever:
            s0, s1, s2 = l1 * t2 - l2 * t1, l2 * t0 - l0 * t2, l0 * t1 - l1 * t0
            rate_columns(H, i, s0, s1, s2, k, reg, sens, ptab, n_sensor)
        correlated_error(i, i_error, est, H, y)
    if i_delay >= 0:
        delayed_velocity(nav, est, c, k, reg, i_delay, omega, H, y, U)
    return 3


@inlined
def delayed_velocity(nav, est, c, k, reg, i_delay, omega, H, y, U):
    """Add to a velocity what changes over the receiver's delay: specific force, gravity, Coriolis acceleration.

    Of the IMU; that of an antenna turning about it is left out.
    """
    delay = est[i_delay - 9]
    f0, f1, f2 = turned_by(c, k * reg[1], k * reg[2], k * reg[3])
    a0, a1, a2 = gravity_e(nav[7], nav[8], nav[9])
    a0, a1, a2 = a0 + f0 + 2.0 * omega * nav[5], a1 + f1 - 2.0 * omega * nav[4], a2 + f2
    for i in range(3):
        u0, u1, u2 = U[i, 0], U[i, 1], U[i, 2]
        acceleration = u0 * a0 + u1 * a1 + u2 * a2
        y[i] += delay * acceleration
        H[i, i_delay] = acceleration
        H[i, 0] += delay * (f1 * u2 - f2 * u1)
        H[i, 1] += delay * (f2 * u0 - f0 * u2)
        H[i, 2] += delay * (f0 * u1 - f1 * u0)
        H[i, 3] -= 2.0 * omega * delay * u1
        H[i, 4] += 2.0 * omega * delay * u0


@inlined
def pseudorange_row(z, lever, nav, est, at, omega, H, y):
    """Pseudorange of one satellite to an antenna, with the clock of its group."""
    l0, l1, l2 = estimated_lever(lever, est, at[AT_LEVER])
    L0, L1, L2 = turned_by(dcm(nav), l0, l1, l2)
    group = int(z[4])
    i_group = at[AT_CLOCK + group] if 0 < group < 4 else -1
    pseudorange(z, L0, L1, L2, nav, est, at[AT_CLOCK], i_group, at[AT_LEVER], omega, H, y)
    if at[AT_MULTIPATH] >= 0 and z[5] > 0.0:
        multipath(z, est, at[AT_MULTIPATH], H, y)
    return 1


@inlined
def carrier_phase_row(z, lever, nav, est, at, omega, H, y):
    """Carrier phase of one satellite; what its system's clock differs by is in the ambiguity."""
    l0, l1, l2 = estimated_lever(lever, est, at[AT_LEVER])
    L0, L1, L2 = turned_by(dcm(nav), l0, l1, l2)
    pseudorange(z, L0, L1, L2, nav, est, at[AT_CLOCK], -1, at[AT_LEVER], omega, H, y)
    ambiguity(z, est, at[AT_AMBIGUITY], H, y)
    return 1


@inlined
def range_rate_row(z, lever, nav, est, reg, sens, ptab, n_sensor, at, omega, H, y):
    """Range rate of one satellite to an antenna, whose motion about the IMU depends on errors of the rate."""
    l0, l1, l2 = estimated_lever(lever, est, at[AT_LEVER])
    c = dcm(nav)
    L0, L1, L2 = turned_by(c, l0, l1, l2)
    w0, w1, w2, k = mean_rate(reg)
    M0, M1, M2 = turned_by(c, w1 * l2 - w2 * l1, w2 * l0 - w0 * l2, w0 * l1 - w1 * l0)
    g0, g1, g2 = range_rate(
        z, L0, L1, L2, M0, M1, M2, w0, w1, w2, nav, est, at[AT_CLOCK], at[AT_LEVER], omega, H, y
    )  # fmt: skip
    if l0 != 0.0 or l1 != 0.0 or l2 != 0.0:
        t0, t1, t2 = (
            g0 * c[0] + g1 * c[3] + g2 * c[6],
            g0 * c[1] + g1 * c[4] + g2 * c[7],
            g0 * c[2] + g1 * c[5] + g2 * c[8],
        )
        rate_columns(
            H, 0, l1 * t2 - l2 * t1, l2 * t0 - l0 * t2, l0 * t1 - l1 * t0, k, reg, sens, ptab, n_sensor
        )  # fmt: skip
    return 1


@inlined
def vehicle_row(kind, z, lever, nav, est, reg, sens, ptab, n_sensor, at, omega, H, y):
    """Lateral, vertical or forward velocity of a wheeled vehicle at its axle."""
    l0, l1, l2 = estimated_lever(lever, est, at[AT_LEVER_V])
    axis = 0 if kind == SPEED else kind - 3
    return vehicle_velocity(
        axis, z, l0, l1, l2, nav, est, reg, sens, ptab, n_sensor, at[AT_MOUNT], at[AT_ODOMETER], at[AT_LEVER_V],
        omega, H, y,
    )  # fmt: skip


@borrowing
def measurement_rows(kind, z, lever, nav, est, reg, sens, ptab, n_sensor, at, omega, H, y, U):
    """Rows ``H`` (3, n) and difference ``y`` = predicted minus measured; returns how many.

    One function a kind: here, in ``vehicle``, ``rest`` and ``range``. ``reg`` holds the regressors of the current
    interval (integrals of time, force and rate), whose means stand for the instant. ``at`` are the first states of the
    blocks in ``limits.PLACES``, -1 for those not estimated.
    """
    clear_rows(H)
    ned_axes(nav, U)
    if kind in (POSITION, RESET_POSITION):
        i_error = at[AT_B_R] if kind == POSITION else -1
        return position_rows(z, lever, nav, est, at[AT_LEVER], i_error, at[AT_DELAY], H, y, U)
    if kind == FIX:  # of the IMU, or with a lever arm of its own
        return position_rows(z, lever, nav, est, -1, -1, -1, H, y, U)
    if kind in (VELOCITY, RESET_VELOCITY, ZERO_VELOCITY):
        i_lever = at[AT_LEVER_V] if kind == ZERO_VELOCITY else at[AT_LEVER]
        i_error = at[AT_B_V] if kind == VELOCITY else -1
        i_delay = -1 if kind == ZERO_VELOCITY else at[AT_DELAY]
        return velocity_rows(z, lever, nav, est, reg, sens, ptab, n_sensor, i_lever, i_error, i_delay, omega, H, y, U)
    if LATERAL <= kind <= SPEED:
        return vehicle_row(kind, z, lever, nav, est, reg, sens, ptab, n_sensor, at, omega, H, y)
    if kind == PSEUDORANGE:
        return pseudorange_row(z, lever, nav, est, at, omega, H, y)
    if kind in (CARRIER_PHASE, ARC_START):
        return carrier_phase_row(z, lever, nav, est, at, omega, H, y)
    if kind == RANGE_RATE:
        return range_rate_row(z, lever, nav, est, reg, sens, ptab, n_sensor, at, omega, H, y)
    if kind == ZERO_RATE:
        return zero_rate(z, nav, reg, sens, ptab, n_sensor, omega, H, y)
    if kind in (HEADING, GNSS_HEADING):
        return heading(z, nav, est, at[AT_HEADING], H, y, U)
    if kind == HEIGHT:
        L0, L1, L2 = turned_by(dcm(nav), lever[0], lever[1], lever[2])
        return height(z, L0, L1, L2, nav, est, at[AT_BARO], H, y, U)
    if kind == GRAVITY:
        return gravity_magnitude(z, nav, sens, ptab, n_sensor, H, y)
    if kind == GRAVITY_VECTOR:
        return gravity_vector(z, nav, sens, ptab, n_sensor, H, y, U)
    return earth_rate(z, nav, sens, ptab, n_sensor, omega, kind == EARTH_RATE, H, y, U)


@apart
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
def begin_arc(P, est, i, R, H, y, G, W):
    """Make the ambiguity of a carrier phase, state ``i``, what the phase differs from the predicted range by.

    ``H`` and ``y`` are the phase's row and difference, ``R`` its variance. ``P <- T P T' + R``: T is the identity but
    for row ``i``, which is left in ``G``: ``-H`` less the ambiguity itself, so that its error has all correlations of
    that range. Nothing is known of it from before.
    """
    n = P.shape[0]
    est[i - 9] -= y[0]
    g, w = G[0], W[0]
    for j in range(n):
        g[j] = -H[0, j]
        w[j] = 0.0
    g[i] = 0.0
    for k in range(n):
        if g[k] != 0.0:
            p = P[k]
            for j in range(n):
                w[j] += g[k] * p[j]
    v = R
    for j in range(n):
        v += w[j] * g[j]
    for j in range(n):
        P[i, j] = P[j, i] = w[j]
    P[i, i] = v


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
