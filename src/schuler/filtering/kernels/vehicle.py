"""Compiled rows of H for measurements that are no satellite's: vehicle velocity, rest, heading, height.

Errors are estimate minus truth; ``C_hat = exp([psi x]) C``, so a direction ``u`` fixed to the body moves by
``psi x u`` and a body component ``a . C' v`` by ``psi . (u x v)`` with ``u = C a``. Arrays as in ``_update_kernels``.
"""

from __future__ import annotations

import math

from schuler.earth import WGS84
from schuler.filtering.kernels.covariance import dcm
from schuler.jit import inlined

_A = WGS84.a
_E2 = WGS84.e2


@inlined
def rate_columns(H, i, t0, t1, t2, k, reg, sens, ptab, n_sensor):
    """Add to row ``i`` what errors of sensor parameters do to ``t . omega_ib_b``; ``k`` is one over the interval."""
    for j in range(n_sensor):
        a, source = ptab[j, 1], ptab[j, 2]
        r = 1.0 if source == 0 else k * reg[source]
        if ptab[j, 0] == 0:
            H[i, 9 + j] -= r * (sens[6 + a] * t0 + sens[9 + a] * t1 + sens[12 + a] * t2)
        else:
            f0, f1, f2 = sens[15 + a], sens[18 + a], sens[21 + a]
            p0 = sens[24] * f0 + sens[25] * f1 + sens[26] * f2
            p1 = sens[27] * f0 + sens[28] * f1 + sens[29] * f2
            p2 = sens[30] * f0 + sens[31] * f1 + sens[32] * f2
            g0 = sens[6] * p0 + sens[7] * p1 + sens[8] * p2
            g1 = sens[9] * p0 + sens[10] * p1 + sens[11] * p2
            g2 = sens[12] * p0 + sens[13] * p1 + sens[14] * p2
            H[i, 9 + j] += r * (g0 * t0 + g1 * t1 + g2 * t2)


@inlined
def vehicle_velocity(axis, z, l0, l1, l2, nav, est, reg, sens, ptab, n_sensor, i_mount, i_scale, i_lever, omega, H, y):
    """One component of the velocity over ground of a point of the vehicle, in the vehicle's axes.

    ``axis`` 0 is the odometer's: ``(1 + s) v_x``; 1 and 2 are the lateral and vertical components. ``l`` leads from the
    IMU to the point. The attitude of the body axes in the vehicle is pitch and yaw of block ``mount``.
    """
    c00, c01, c02, c10, c11, c12, c20, c21, c22 = dcm(nav)
    k = 1.0 / reg[0] if reg[0] > 0.0 else 0.0
    # rate over ground, body axes: omega_ib - C' omega_ie
    w0, w1, w2 = k * reg[4] - c20 * omega, k * reg[5] - c21 * omega, k * reg[6] - c22 * omega
    x, y0, z0 = nav[4], nav[5], nav[6]
    b0 = c00 * x + c10 * y0 + c20 * z0 + w1 * l2 - w2 * l1
    b1 = c01 * x + c11 * y0 + c21 * z0 + w2 * l0 - w0 * l2
    b2 = c02 * x + c12 * y0 + c22 * z0 + w0 * l1 - w1 * l0
    pitch, yaw = 0.0, 0.0
    if i_mount >= 0:
        pitch, yaw = est[i_mount - 9], est[i_mount - 8]
    sp, cp, sy, cy = math.sin(pitch), math.cos(pitch), math.sin(yaw), math.cos(yaw)
    # the vehicle's axis in the body, and its derivatives with pitch (p) and yaw (q)
    if axis == 0:
        a0, a1, a2 = cy * cp, -sy, cy * sp
        p0, p1, p2 = -cy * sp, 0.0, cy * cp
        q0, q1, q2 = -sy * cp, -cy, -sy * sp
    elif axis == 1:
        a0, a1, a2 = sy * cp, cy, sy * sp
        p0, p1, p2 = -sy * sp, 0.0, sy * cp
        q0, q1, q2 = cy * cp, -sy, cy * sp
    else:
        a0, a1, a2 = -sp, 0.0, cp
        p0, p1, p2 = -cp, 0.0, -sp
        q0 = q1 = q2 = 0.0
    value = a0 * b0 + a1 * b1 + a2 * b2
    s = 1.0
    if axis == 0 and i_scale >= 0:
        s += est[i_scale - 9]
        H[0, i_scale] = value
    y[0] = s * value - z[0]
    u0 = s * (c00 * a0 + c01 * a1 + c02 * a2)
    u1 = s * (c10 * a0 + c11 * a1 + c12 * a2)
    u2 = s * (c20 * a0 + c21 * a1 + c22 * a2)
    H[0, 3], H[0, 4], H[0, 5] = u0, u1, u2
    # m = l x a: the rate enters as omega . m, and its part C' omega_ie turns with psi
    m0, m1, m2 = s * (l1 * a2 - l2 * a1), s * (l2 * a0 - l0 * a2), s * (l0 * a1 - l1 * a0)
    e0, e1 = c00 * m0 + c01 * m1 + c02 * m2, c10 * m0 + c11 * m1 + c12 * m2
    H[0, 0] = u1 * z0 - u2 * y0 - e1 * omega
    H[0, 1] = u2 * x - u0 * z0 + e0 * omega
    H[0, 2] = u0 * y0 - u1 * x
    rate_columns(H, 0, m0, m1, m2, k, reg, sens, ptab, n_sensor)
    if i_lever >= 0:
        H[0, i_lever] = s * (a1 * w2 - a2 * w1)
        H[0, i_lever + 1] = s * (a2 * w0 - a0 * w2)
        H[0, i_lever + 2] = s * (a0 * w1 - a1 * w0)
    if i_mount >= 0:
        H[0, i_mount] = s * (p0 * b0 + p1 * b1 + p2 * b2)
        H[0, i_mount + 1] = s * (q0 * b0 + q1 * b1 + q2 * b2)
    return 1


@inlined
def zero_rate(z, nav, reg, sens, ptab, n_sensor, omega, H, y):
    """No rotation against the Earth: the compensated mean rate at rest is the Earth's. Body axes.

    ``z`` is the mean of the raw angular rate over a stretch at rest, the regressors are those of the present interval.
    """
    c00, c01, c02, c10, c11, c12, c20, c21, c22 = dcm(nav)
    k = 1.0 / reg[0] if reg[0] > 0.0 else 0.0
    f0, f1, f2 = k * reg[1], k * reg[2], k * reg[3]
    x = z[0] - sens[0] - (sens[24] * f0 + sens[25] * f1 + sens[26] * f2)
    y0 = z[1] - sens[1] - (sens[27] * f0 + sens[28] * f1 + sens[29] * f2)
    z0 = z[2] - sens[2] - (sens[30] * f0 + sens[31] * f1 + sens[32] * f2)
    w0 = sens[6] * x + sens[7] * y0 + sens[8] * z0
    w1 = sens[9] * x + sens[10] * y0 + sens[11] * z0
    w2 = sens[12] * x + sens[13] * y0 + sens[14] * z0
    y[0], y[1], y[2] = w0 - c20 * omega, w1 - c21 * omega, w2 - c22 * omega
    # d(C' omega_ie) = psi . (u x omega_ie), u the body axis
    H[0, 0], H[0, 1] = -c10 * omega, c00 * omega
    H[1, 0], H[1, 1] = -c11 * omega, c01 * omega
    H[2, 0], H[2, 1] = -c12 * omega, c02 * omega
    for j in range(n_sensor):
        a, source = ptab[j, 1], ptab[j, 2]
        if ptab[j, 0] == 0:
            r = 1.0
            if source > 3:
                r = w0 if source == 4 else (w1 if source == 5 else w2)
            elif source > 0:
                r = k * reg[source]
            H[0, 9 + j], H[1, 9 + j], H[2, 9 + j] = -r * sens[6 + a], -r * sens[9 + a], -r * sens[12 + a]
        else:
            r = 1.0 if source == 0 else k * reg[source]
            g0, g1, g2 = sens[15 + a], sens[18 + a], sens[21 + a]
            p0 = sens[24] * g0 + sens[25] * g1 + sens[26] * g2
            p1 = sens[27] * g0 + sens[28] * g1 + sens[29] * g2
            p2 = sens[30] * g0 + sens[31] * g1 + sens[32] * g2
            H[0, 9 + j] = r * (sens[6] * p0 + sens[7] * p1 + sens[8] * p2)
            H[1, 9 + j] = r * (sens[9] * p0 + sens[10] * p1 + sens[11] * p2)
            H[2, 9 + j] = r * (sens[12] * p0 + sens[13] * p1 + sens[14] * p2)
    return 3


@inlined
def heading(z, nav, est, i_bias, H, y, U):
    """Direction of the forward axis in the horizontal plane, from north over east."""
    c00, _, _, c10, _, _, c20, _, _ = dcm(nav)
    north = U[0, 0] * c00 + U[0, 1] * c10 + U[0, 2] * c20
    east = U[1, 0] * c00 + U[1, 1] * c10 + U[1, 2] * c20
    k = 1.0 / (north * north + east * east)
    g0, g1, g2 = north * U[1, 0] - east * U[0, 0], north * U[1, 1] - east * U[0, 1], north * U[1, 2] - east * U[0, 2]
    H[0, 0], H[0, 1], H[0, 2] = k * (c10 * g2 - c20 * g1), k * (c20 * g0 - c00 * g2), k * (c00 * g1 - c10 * g0)
    d = math.atan2(east, north) - z[0]
    if i_bias >= 0:
        d += est[i_bias - 9]
        H[0, i_bias] = 1.0
    y[0] = d - 2.0 * math.pi * math.floor((d + math.pi) / (2.0 * math.pi))
    return 1


@inlined
def height(z, L0, L1, L2, nav, est, i_bias, H, y, U):
    """Height over the ellipsoid of a point of the body, with a bias."""
    x, y0, z0 = nav[7] + L0, nav[8] + L1, nav[9] + L2
    sL, cL = -U[2, 2], U[0, 2]
    # exact on the normal through the IMU; a lever arm leaves (its horizontal part)^2 / 2 R, micrometres
    y[0] = math.sqrt(x * x + y0 * y0) * cL + z0 * sL - _A * math.sqrt(1.0 - _E2 * sL * sL) - z[0]
    u0, u1, u2 = -U[2, 0], -U[2, 1], -U[2, 2]
    H[0, 6], H[0, 7], H[0, 8] = u0, u1, u2
    H[0, 0], H[0, 1], H[0, 2] = L1 * u2 - L2 * u1, L2 * u0 - L0 * u2, L0 * u1 - L1 * u0
    if i_bias >= 0:
        y[0] += est[i_bias - 9]
        H[0, i_bias] = 1.0
    return 1
