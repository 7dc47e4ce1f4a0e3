"""Compiled rows of H for what gravity and Earth rate say of an IMU at rest. Arrays as in ``covariance``.

``z`` holds means of raw readings over a stretch in which the IMU does not turn: specific force, then (Earth rate) the
angular rate behind it. They are compensated with the present estimates, so that errors of specific force act on the
rate too where a g-sensitivity is estimated.
"""

from __future__ import annotations

import math

from schuler.filtering.kernels.covariance import dcm
from schuler.jit import inlined
from schuler.mechanization.kernels import gravity_e


@inlined
def compensated_force(z, sens):
    """Specific force without the estimated errors, body axes."""
    x, y, w = z[0] - sens[3], z[1] - sens[4], z[2] - sens[5]
    return (
        sens[15] * x + sens[16] * y + sens[17] * w,
        sens[18] * x + sens[19] * y + sens[20] * w,
        sens[21] * x + sens[22] * y + sens[23] * w,
    )


@inlined
def compensated_rate(z, sens, f0, f1, f2):
    """Angular rate without the estimated errors; ``f`` is the compensated specific force. Body axes."""
    x = z[3] - sens[0] - (sens[24] * f0 + sens[25] * f1 + sens[26] * f2)
    y = z[4] - sens[1] - (sens[27] * f0 + sens[28] * f1 + sens[29] * f2)
    w = z[5] - sens[2] - (sens[30] * f0 + sens[31] * f1 + sens[32] * f2)
    return (
        sens[6] * x + sens[7] * y + sens[8] * w,
        sens[9] * x + sens[10] * y + sens[11] * w,
        sens[12] * x + sens[13] * y + sens[14] * w,
    )


@inlined
def force_columns(H, i, d0, d1, d2, f0, f1, f2, sens, ptab, n_sensor):
    """Add to row ``i`` what errors of accelerometer parameters do to ``d . f``."""
    for j in range(n_sensor):
        if ptab[j, 0] == 1:
            a, source = ptab[j, 1], ptab[j, 2]
            r = 1.0 if source == 0 else (f0 if source == 1 else (f1 if source == 2 else f2))
            H[i, 9 + j] -= r * (d0 * sens[15 + a] + d1 * sens[18 + a] + d2 * sens[21 + a])


@inlined
def gravity_magnitude(z, nav, sens, ptab, n_sensor, H, y):
    """The specific force at rest is as large as gravity; ``z[6]`` is gravity, zero takes that of the ellipsoid."""
    f0, f1, f2 = compensated_force(z, sens)
    g = z[6]
    if g == 0.0:
        g0, g1, g2 = gravity_e(nav[7], nav[8], nav[9])
        g = math.sqrt(g0 * g0 + g1 * g1 + g2 * g2)
    size = math.sqrt(f0 * f0 + f1 * f1 + f2 * f2)
    y[0] = size - g
    force_columns(H, 0, f0 / size, f1 / size, f2 / size, f0, f1, f2, sens, ptab, n_sensor)
    return 1


@inlined
def gravity_vector(z, nav, sens, ptab, n_sensor, H, y, U):
    """The specific force at rest, turned by the attitude, is minus gravity: north, east, down.

    ``z[6]`` as for the magnitude; ``z[7]`` 1 leaves the accelerometers' columns out, as if they were perfect.
    """
    f0, f1, f2 = compensated_force(z, sens)
    c00, c01, c02, c10, c11, c12, c20, c21, c22 = dcm(nav)
    e0, e1, e2 = c00 * f0 + c01 * f1 + c02 * f2, c10 * f0 + c11 * f1 + c12 * f2, c20 * f0 + c21 * f1 + c22 * f2
    g0, g1, g2 = gravity_e(nav[7], nav[8], nav[9])
    k = 1.0
    if z[6] != 0.0:
        k = z[6] / math.sqrt(g0 * g0 + g1 * g1 + g2 * g2)
    for i in range(3):
        u0, u1, u2 = U[i, 0], U[i, 1], U[i, 2]
        y[i] = u0 * (e0 + k * g0) + u1 * (e1 + k * g1) + u2 * (e2 + k * g2)
        # -g for C f: the same where both agree, and a tilt that is not yet found tells nothing about heading
        H[i, 0], H[i, 1], H[i, 2] = k * (g2 * u1 - g1 * u2), k * (g0 * u2 - g2 * u0), k * (g1 * u0 - g0 * u1)
        if z[7] == 0.0:
            d0, d1, d2 = (
                u0 * c00 + u1 * c10 + u2 * c20,
                u0 * c01 + u1 * c11 + u2 * c21,
                u0 * c02 + u1 * c12 + u2 * c22,
            )
            force_columns(H, i, d0, d1, d2, f0, f1, f2, sens, ptab, n_sensor)
    return 3


@inlined
def earth_rate(z, nav, sens, ptab, n_sensor, omega, vertical, H, y, U):
    """The rate at rest is the Earth's: its component along the measured vertical, or (as printed) its magnitude."""
    f0, f1, f2 = compensated_force(z, sens)
    w0, w1, w2 = compensated_rate(z, sens, f0, f1, f2)
    size = math.sqrt(f0 * f0 + f1 * f1 + f2 * f2)
    # regressors are the Earth's rate in the body, not the measured one: its noise is in y too and would pass for
    # scale factors
    _, _, _, _, _, _, c20, c21, c22 = dcm(nav)
    e0, e1, e2 = omega * c20, omega * c21, omega * c22
    if vertical:
        u0, u1, u2 = f0 / size, f1 / size, f2 / size
        along = u0 * w0 + u1 * w1 + u2 * w2
        y[0] = along + omega * U[2, 2]  # U[2] points down, Earth rate has only a polar component
        # the vertical turns with errors of the specific force
        e = u0 * e0 + u1 * e1 + u2 * e2
        d0, d1, d2 = (e0 - e * u0) / size, (e1 - e * u1) / size, (e2 - e * u2) / size
        force_columns(H, 0, d0, d1, d2, f0, f1, f2, sens, ptab, n_sensor)
    else:
        along = math.sqrt(w0 * w0 + w1 * w1 + w2 * w2)
        u0, u1, u2 = w0 / along, w1 / along, w2 / along
        y[0] = along - omega
    # u . K_g, and through it u . K_g G_g on the specific force
    k0 = u0 * sens[6] + u1 * sens[9] + u2 * sens[12]
    k1 = u0 * sens[7] + u1 * sens[10] + u2 * sens[13]
    k2 = u0 * sens[8] + u1 * sens[11] + u2 * sens[14]
    for j in range(n_sensor):
        if ptab[j, 0] == 0:
            a, source = ptab[j, 1], ptab[j, 2]
            if source == 0:
                r = 1.0
            elif source < 4:
                r = f0 if source == 1 else (f1 if source == 2 else f2)
            else:
                r = e0 if source == 4 else (e1 if source == 5 else e2)
            H[0, 9 + j] -= r * (k0 if a == 0 else (k1 if a == 1 else k2))
    q0 = -(k0 * sens[24] + k1 * sens[27] + k2 * sens[30])
    q1 = -(k0 * sens[25] + k1 * sens[28] + k2 * sens[31])
    q2 = -(k0 * sens[26] + k1 * sens[29] + k2 * sens[32])
    force_columns(H, 0, q0, q1, q2, f0, f1, f2, sens, ptab, n_sensor)
    return 1
