"""Compiled rows of H for single satellites: pseudorange, range rate, carrier phase."""

from __future__ import annotations

import math

from schuler.filtering.kernels.covariance import dcm
from schuler.jit import inlined

_C = 299_792_458.0


@inlined
def clock_columns(group, i_clock, other, H):
    """Put the receiver clock into row 0: its offset for every group, and the group's own difference."""
    if i_clock >= 0:
        H[0, i_clock] = 1.0
    if group > 0 and other >= 0:
        H[0, other] = 1.0


@inlined
def pseudorange(z, L0, L1, L2, nav, est, i_clock, other, i_lever, omega, H, y):
    """``|r_sat - r| + omega / c (x_s y - y_s x) + clock``, antenna at ``r + C l``; ``z``: satellite 3, range, group."""
    x, y0, z0 = nav[7] + L0, nav[8] + L1, nav[9] + L2
    d0, d1, d2 = z[0] - x, z[1] - y0, z[2] - z0
    rho = math.sqrt(d0 * d0 + d1 * d1 + d2 * d2)
    k = omega / _C
    g0, g1, g2 = -d0 / rho - k * z[1], -d1 / rho + k * z[0], -d2 / rho
    H[0, 6], H[0, 7], H[0, 8] = g0, g1, g2
    H[0, 0], H[0, 1], H[0, 2] = L1 * g2 - L2 * g1, L2 * g0 - L0 * g2, L0 * g1 - L1 * g0
    y[0] = rho + k * (z[0] * y0 - z[1] * x) - z[3]
    clock_columns(z[4], i_clock, other, H)
    if i_clock >= 0:
        y[0] += est[i_clock - 9]
    if z[4] > 0.0 and other >= 0:
        y[0] += est[other - 9]
    if i_lever >= 0:
        c00, c01, c02, c10, c11, c12, c20, c21, c22 = dcm(nav)
        H[0, i_lever] = g0 * c00 + g1 * c10 + g2 * c20
        H[0, i_lever + 1] = g0 * c01 + g1 * c11 + g2 * c21
        H[0, i_lever + 2] = g0 * c02 + g1 * c12 + g2 * c22
    return 1


@inlined
def multipath(z, est, i_first, H, y):
    """Add the slow error of the satellite's channel to row 0: ``z[5]`` channel, from 1; ``z[6]`` its scale."""
    i = i_first + int(z[5]) - 1
    H[0, i] = z[6]
    y[0] += z[6] * est[i - 9]


@inlined
def ambiguity(z, est, i_first, H, y):
    """Add the ambiguity of a carrier phase to row 0: ``z[4]`` its channel, from 1."""
    i = i_first + int(z[4]) - 1
    H[0, i] = 1.0
    y[0] += est[i - 9]


@inlined
def range_rate(z, L0, L1, L2, M0, M1, M2, w0, w1, w2, nav, est, i_clock, i_lever, omega, H, y):
    """Rate of the above; ``M = C (omega_ib x l)``, ``w`` the rate itself; ``z`` = satellite 3, its velocity 3, rate.

    Returns the gradient with velocity, which is also that with the antenna's motion about the IMU.
    """
    x, y0, z0 = nav[7] + L0, nav[8] + L1, nav[9] + L2
    # antenna: v + C (omega_ib x l) - omega_ie x (C l)
    v0, v1, v2 = nav[4] + M0 + omega * L1, nav[5] + M1 - omega * L0, nav[6] + M2
    d0, d1, d2 = z[0] - x, z[1] - y0, z[2] - z0
    rho = math.sqrt(d0 * d0 + d1 * d1 + d2 * d2)
    e0, e1, e2 = d0 / rho, d1 / rho, d2 / rho
    u0, u1, u2 = z[3] - v0, z[4] - v1, z[5] - v2
    rate = e0 * u0 + e1 * u1 + e2 * u2
    k = omega / _C
    y[0] = rate + k * (z[3] * y0 + z[0] * v1 - z[4] * x - z[1] * v0) - z[6]
    if i_clock >= 0:
        y[0] += est[i_clock - 8]
        H[0, i_clock + 1] = 1.0
    g0, g1, g2 = -e0 - k * z[1], -e1 + k * z[0], -e2
    H[0, 3], H[0, 4], H[0, 5] = g0, g1, g2
    h0, h1, h2 = (rate * e0 - u0) / rho - k * z[4], (rate * e1 - u1) / rho + k * z[3], (rate * e2 - u2) / rho
    H[0, 6], H[0, 7], H[0, 8] = h0, h1, h2
    # psi turns C l in the position, and both parts of the antenna's velocity
    H[0, 0] = L1 * h2 - L2 * h1 + M1 * g2 - M2 * g1 - L2 * omega * g0
    H[0, 1] = L2 * h0 - L0 * h2 + M2 * g0 - M0 * g2 - L2 * omega * g1
    H[0, 2] = L0 * h1 - L1 * h0 + M0 * g1 - M1 * g0 + (L0 * g0 + L1 * g1) * omega
    if i_lever >= 0:
        c00, c01, c02, c10, c11, c12, c20, c21, c22 = dcm(nav)
        t0, t1, t2 = g0 * c00 + g1 * c10 + g2 * c20, g0 * c01 + g1 * c11 + g2 * c21, g0 * c02 + g1 * c12 + g2 * c22
        f0, f1 = h0 - omega * g1, h1 + omega * g0  # g . (-omega_ie x C l) turned round
        H[0, i_lever] = f0 * c00 + f1 * c10 + h2 * c20 + t1 * w2 - t2 * w1
        H[0, i_lever + 1] = f0 * c01 + f1 * c11 + h2 * c21 + t2 * w0 - t0 * w2
        H[0, i_lever + 2] = f0 * c02 + f1 * c12 + h2 * c22 + t0 * w1 - t1 * w0
    return g0, g1, g2
