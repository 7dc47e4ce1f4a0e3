"""Compiled strapdown: one interval of Earth-fixed or north-east-down mechanization, and loops over a log.

Flat interfaces only (see :mod:`schuler.jit`). The 10-vector ``nav`` is quaternion (4), velocity (3), position (3):
``q_eb, v_eb_e, r_eb_e`` for the Earth-fixed kernel, ``q_nb, v_eb_n, llh`` for the north-east-down one.

Within an interval of length h the sensed rate and specific force are quadratic in time, fixed by this and the two
previous increments: ``omega(s) h = a0 + a1 s + a2 s^2 / 2``, ``f(s) h = b0 + b1 s + b2 s^2 / 2``, ``s`` in 0..1. The
18-vector ``poly`` is (a0, a1, a2, b0, b1, b2). A part of an interval is another such polynomial, so measurements
between IMU samples cut an interval without loss.
"""

from __future__ import annotations

import math

import numpy as np

from schuler.earth import WGS84
from schuler.jit import inlined, kernel, prepare

_A2 = WGS84.a**2
_A = WGS84.a
_E2 = WGS84.e2
_GM = WGS84.GM
_OMEGA_2 = WGS84.omega_ie**2
_J2, _J4, _J6 = WGS84.zonals


@inlined
def gravity_e(x, y, z):
    """Normal gravity in Earth-fixed axes; the NumPy twin is ``earth.gravity_ecef``."""
    i2 = 1.0 / (x * x + y * y + z * z)
    s = z * z * i2
    t = _A2 * i2
    p2 = 1.5 * _J2 * t
    p4 = -0.625 * _J4 * t * t
    p6 = 0.0625 * _J6 * t * t * t
    c = -_GM * i2 * math.sqrt(i2)
    equatorial = (
        1.0
        + p2 * (1.0 - 5.0 * s)
        + p4 * (3.0 - s * (42.0 - 63.0 * s))
        + p6 * (35.0 - s * (945.0 - s * (3465.0 - 3003.0 * s)))
    )
    polar = (
        1.0
        + p2 * (3.0 - 5.0 * s)
        + p4 * (15.0 - s * (70.0 - 63.0 * s))
        + p6 * (245.0 - s * (2205.0 - s * (4851.0 - 3003.0 * s)))
    )
    k = c * equatorial + _OMEGA_2
    return k * x, k * y, c * polar * z


@inlined
def fit_interval(poly, now, before, earlier, h, h1, h2):
    """Quadratic rate and force of an interval through its own increment and the two before it.

    ``now``, ``before``, ``earlier`` are 6-vectors (dtheta, dv) over ``h``, ``h1``, ``h2`` seconds. A zero ``h2`` leaves
    the linear fit of two samples, a zero ``h1`` the constant of one: the start of a log, or the far side of a gap.
    """
    if h2 > 0.0 and abs(h1 - h) < 1e-9 * h and abs(h2 - h) < 1e-9 * h:
        for i in range(6):
            o = i if i < 3 else i + 6
            poly[o] = (2.0 * now[i] + 5.0 * before[i] - earlier[i]) * (1.0 / 6.0)
            poly[o + 3] = now[i] - before[i]
            poly[o + 6] = now[i] - 2.0 * before[i] + earlier[i]
    elif h1 > 0.0:
        # divided differences of the integrals
        u, u1, u2 = 1.0 / h, 1.0 / h1, 0.0
        c, c1, c2 = 1.0 / (h + h1), 0.0, 0.0
        if h2 > 0.0:
            u2, c1, c2 = 1.0 / h2, 1.0 / (h1 + h2), 1.0 / (h + h1 + h2)
        for i in range(6):
            o = i if i < 3 else i + 6
            d2 = (now[i] * u - before[i] * u1) * c
            d3 = (d2 - (before[i] * u1 - earlier[i] * u2) * c1) * c2
            poly[o] = now[i] - h * h * (d2 + h1 * d3)
            poly[o + 3] = 2.0 * h * h * (d2 + (h1 - h) * d3)
            poly[o + 6] = 6.0 * h * h * h * d3
    else:
        for i in range(6):
            o = i if i < 3 else i + 6
            poly[o] = now[i]
            poly[o + 3] = 0.0
            poly[o + 6] = 0.0


@inlined
def cut_interval(part, poly, s0, s1):
    """The stretch from ``s0`` to ``s1`` of an interval, as the polynomial of its own unit interval."""
    ds = s1 - s0
    for i in range(6):
        o = i if i < 3 else i + 6
        part[o] = (poly[o] + s0 * (poly[o + 3] + 0.5 * s0 * poly[o + 6])) * ds
        part[o + 3] = (poly[o + 3] + s0 * poly[o + 6]) * ds * ds
        part[o + 6] = poly[o + 6] * ds * ds * ds


@inlined
def rotation_series(m):
    """Series of ``(1 - cos a) / a^2`` and ``(a - sin a) / a^3``, ``m = a^2``: to rounding for angles below 0.5 rad."""
    g1 = 0.5 - m * (1.0 / 24.0 - m * (1.0 / 720.0 - m * (1.0 / 40320.0 - m * (1.0 / 3628800.0 - m / 479001600.0))))
    g2 = 1.0 / 6.0 - m * (1.0 / 120.0 - m * (1.0 / 5040.0 - m * (1.0 / 362880.0 - m / 39916800.0)))
    return g1, g2


@inlined
def rotation_coefficients(m):
    """``(1 - cos a) / a^2`` and ``(a - sin a) / a^3`` of a squared angle: series when small, else closed form.

    Lanes take :func:`rotation_series` always, so that no run depends on its neighbours; runs that turn by more than
    half a radian in a sample are marked as diverged.
    """
    if m < 0.25:
        return rotation_series(m)
    angle = math.sqrt(m)
    return (1.0 - math.cos(angle)) / m, (angle - math.sin(angle)) / (m * angle)


@inlined
def body_integrals(poly):
    """Rotation vector, velocity change and position shape term of an interval, in body axes at its start.

    Coning and sculling of the quadratic model, the exact series of a constant rotation, and the fourth-order terms of
    a rate and a force that change; what is left out is of fifth order in h (derivation in docs/mechanization.md).
    """
    a0x, a0y, a0z, a1x, a1y, a1z, a2x, a2y, a2z = (
        poly[0], poly[1], poly[2], poly[3], poly[4], poly[5], poly[6], poly[7], poly[8]
    )  # fmt: skip
    b0x, b0y, b0z, b1x, b1y, b1z, b2x, b2y, b2z = (
        poly[9], poly[10], poly[11], poly[12], poly[13], poly[14], poly[15], poly[16], poly[17]
    )  # fmt: skip
    c6 = 1.0 / 6.0
    tx, ty, tz = a0x + 0.5 * a1x + c6 * a2x, a0y + 0.5 * a1y + c6 * a2y, a0z + 0.5 * a1z + c6 * a2z
    dx, dy, dz = b0x + 0.5 * b1x + c6 * b2x, b0y + 0.5 * b1y + c6 * b2y, b0z + 0.5 * b1z + c6 * b2z
    # coning: a0 x (a1 / 12 + a2 / 24)
    c12, c24 = 1.0 / 12.0, 1.0 / 24.0
    kx, ky, kz = c12 * a1x + c24 * a2x, c12 * a1y + c24 * a2y, c12 * a1z + c24 * a2z
    px, py, pz = tx + a0y * kz - a0z * ky, ty + a0z * kx - a0x * kz, tz + a0x * ky - a0y * kx
    # sculling: a0 x (b1 / 12 + b2 / 24) + b0 x (a1 / 12 + a2 / 24)
    lx, ly, lz = c12 * b1x + c24 * b2x, c12 * b1y + c24 * b2y, c12 * b1z + c24 * b2z
    wx = a0y * lz - a0z * ly + b0y * kz - b0z * ky
    wy = a0z * lx - a0x * lz + b0z * kx - b0x * kz
    wz = a0x * ly - a0y * lx + b0x * ky - b0y * kx
    # dtheta x dv, dtheta x (dtheta x dv)
    fx, fy, fz = ty * dz - tz * dy, tz * dx - tx * dz, tx * dy - ty * dx
    gx, gy, gz = ty * fz - tz * fy, tz * fx - tx * fz, tx * fy - ty * fx
    g1, g2 = rotation_coefficients(tx * tx + ty * ty + tz * tz)
    # fourth order: (a0 x (a0 x b1) - a1 x (a0 x b0)) / 24
    ex, ey, ez = a0y * b1z - a0z * b1y, a0z * b1x - a0x * b1z, a0x * b1y - a0y * b1x
    hx, hy, hz = a0y * b0z - a0z * b0y, a0z * b0x - a0x * b0z, a0x * b0y - a0y * b0x
    ux = dx + g1 * fx + g2 * gx + wx + c24 * (a0y * ez - a0z * ey - a1y * hz + a1z * hy)
    uy = dy + g1 * fy + g2 * gy + wy + c24 * (a0z * ex - a0x * ez - a1z * hx + a1x * hz)
    uz = dz + g1 * fz + g2 * gz + wz + c24 * (a0x * ey - a0y * ex - a1x * hy + a1y * hx)
    # derivative of the force in non-rotating axes, for the position integral
    jx, jy, jz = b1x + 0.5 * b2x + hx, b1y + 0.5 * b2y + hy, b1z + 0.5 * b2z + hz
    return px, py, pz, ux, uy, uz, jx, jy, jz


@inlined
def half_angle_series(x):
    """Series of ``cos b`` and ``sin b / (2 b)`` of half an angle b, ``x = b^2``: to rounding for b below 0.25 rad."""
    c = 1.0 - x * (0.5 - x * (1.0 / 24.0 - x * (1.0 / 720.0 - x * (1.0 / 40320.0 - x / 3628800.0))))
    s = 0.5 - x * (1.0 / 12.0 - x * (1.0 / 240.0 - x * (1.0 / 10080.0 - x / 725760.0)))
    return c, s


@inlined
def half_angle_coefficients(x):
    """``cos b`` and ``sin b / (2 b)`` of a squared half angle: series when small, else closed form.

    Lanes take :func:`half_angle_series` always, as in :func:`rotation_coefficients`.
    """
    if x < 0.0625:
        return half_angle_series(x)
    half = math.sqrt(x)
    return math.cos(half), 0.5 * math.sin(half) / half


@inlined
def half_angle(px, py, pz):
    """Cosine of half the angle of a rotation vector, and sine of half the angle divided by the angle."""
    return half_angle_coefficients(0.25 * (px * px + py * py + pz * pz))


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


@inlined
def advance_ecef(nav, poly, h, omega_ie):
    """Carry ``nav`` over an interval of ``h`` seconds in Earth-fixed axes; returns the velocity increment there."""
    px, py, pz, ux, uy, uz, jx, jy, jz = body_integrals(poly)
    qw, qx, qy, qz = nav[0], nav[1], nav[2], nav[3]
    vx, vy, vz = nav[4], nav[5], nav[6]
    c11, c12, c13 = qw * qw + qx * qx - qy * qy - qz * qz, 2.0 * (qx * qy - qw * qz), 2.0 * (qx * qz + qw * qy)
    c21, c22, c23 = 2.0 * (qx * qy + qw * qz), qw * qw - qx * qx + qy * qy - qz * qz, 2.0 * (qy * qz - qw * qx)
    c31, c32, c33 = 2.0 * (qx * qz - qw * qy), 2.0 * (qy * qz + qw * qx), qw * qw - qx * qx - qy * qy + qz * qz
    e = 0.5 * omega_ie * h
    # specific force: body to Earth-fixed axes, which turn by 2 e meanwhile
    dx, dy, dz = c11 * ux + c12 * uy + c13 * uz, c21 * ux + c22 * uy + c23 * uz, c31 * ux + c32 * uy + c33 * uz
    hh = 0.5 * h
    gx, gy, gz = gravity_e(nav[7] + hh * vx, nav[8] + hh * vy, nav[9] + hh * vz)
    ix, iy, iz = dx + e * dy + gx * h, dy - e * dx + gy * h, dz + gz * h
    mx, my = vx + 0.5 * ix + 2.0 * e * vy, vy + 0.5 * iy - 2.0 * e * vx  # mid-interval velocity for the Coriolis term
    wx, wy, wz = vx + ix + 4.0 * e * my, vy + iy - 4.0 * e * mx, vz + iz
    k = h / 12.0
    nav[7] += hh * (vx + wx) - k * (c11 * jx + c12 * jy + c13 * jz)
    nav[8] += hh * (vy + wy) - k * (c21 * jx + c22 * jy + c23 * jz)
    nav[9] += hh * (vz + wz) - k * (c31 * jx + c32 * jy + c33 * jz)
    nav[4], nav[5], nav[6] = wx, wy, wz
    c, s = half_angle(px, py, pz)
    sx, sy, sz = s * px, s * py, s * pz
    aw = qw * c - qx * sx - qy * sy - qz * sz
    ax = qw * sx + qx * c + qy * sz - qz * sy
    ay = qw * sy - qx * sz + qy * c + qz * sx
    az = qw * sz + qx * sy - qy * sx + qz * c
    ce, se = half_earth_turn(e)
    bw, bx, by, bz = ce * aw + se * az, ce * ax + se * ay, ce * ay - se * ax, ce * az - se * aw
    n = 1.5 - 0.5 * (bw * bw + bx * bx + by * by + bz * bz)  # first-order renormalisation, enough every interval
    nav[0], nav[1], nav[2], nav[3] = n * bw, n * bx, n * by, n * bz
    return dx, dy, dz


@inlined
def half_earth_turn(e):
    """Cosine and sine of half the Earth's turn: ``e`` is below 1e-2 for any interval that makes sense."""
    e2 = e * e
    return 1.0 - 0.5 * e2 * (1.0 - e2 / 12.0), e * (1.0 - e2 / 6.0)


@inlined
def advance_ned(nav, poly, h, omega_ie):
    """Carry ``nav`` over an interval of ``h`` seconds in north-east-down axes. Singular at the poles."""
    px, py, pz, ux, uy, uz, jx, jy, jz = body_integrals(poly)
    qw, qx, qy, qz = nav[0], nav[1], nav[2], nav[3]
    vn, ve, vd = nav[4], nav[5], nav[6]
    lat, height = nav[7], nav[9]
    c11, c12, c13 = qw * qw + qx * qx - qy * qy - qz * qz, 2.0 * (qx * qy - qw * qz), 2.0 * (qx * qz + qw * qy)
    c21, c22, c23 = 2.0 * (qx * qy + qw * qz), qw * qw - qx * qx + qy * qy - qz * qz, 2.0 * (qy * qz - qw * qx)
    c31, c32, c33 = 2.0 * (qx * qz - qw * qy), 2.0 * (qy * qz + qw * qx), qw * qw - qx * qx - qy * qy + qz * qz
    # mid-interval rates and gravity, from velocity and position extrapolated by half the interval
    fn, fe, fd = c11 * ux + c12 * uy + c13 * uz, c21 * ux + c22 * uy + c23 * uz, c31 * ux + c32 * uy + c33 * uz
    s, c = math.sin(lat), math.cos(lat)
    w2 = 1.0 - _E2 * s * s
    r_e = _A / math.sqrt(w2)
    r_n = r_e * (1.0 - _E2) / w2
    hh = 0.5 * h
    # velocity at mid interval, Coriolis of the start included, is enough for terms that are themselves small
    gx, _, gz = gravity_e((r_e + height) * c, 0.0, ((1.0 - _E2) * r_e + height) * s)
    east, north = ve / (r_e + height), vn / (r_n + height)
    wx, wy, wz = 2.0 * omega_ie * c + east, -north, -2.0 * omega_ie * s - east * s / c
    an = (fn / h - s * gx + c * gz) - (wy * vd - wz * ve)
    ae = fe / h - (wz * vn - wx * vd)
    ad = (fd / h - c * gx - s * gz) - (wx * ve - wy * vn)
    mn, me, md = vn + hh * an, ve + hh * ae, vd + hh * ad
    vn_q, vd_q = vn + 0.25 * h * an, vd + 0.25 * h * ad
    lat_m = lat + hh * vn_q / (r_n + height)
    height_m = height - hh * vd_q
    s, c = math.sin(lat_m), math.cos(lat_m)
    w2 = 1.0 - _E2 * s * s
    r_e = _A / math.sqrt(w2)
    r_n = r_e * (1.0 - _E2) / w2
    gx, _, gz = gravity_e((r_e + height_m) * c, 0.0, ((1.0 - _E2) * r_e + height_m) * s)
    east, north = me / (r_e + height_m), mn / (r_n + height_m)
    # rotation of the navigation axes relative to inertial space, and that which acts on velocity
    ix, iy, iz = omega_ie * c + east, -north, -omega_ie * s - east * s / c
    wx, wy, wz = ix + omega_ie * c, iy, iz - omega_ie * s
    dn = fn - hh * (iy * fd - iz * fe) + h * (-s * gx + c * gz) - h * (wy * md - wz * me)
    de = fe - hh * (iz * fn - ix * fd) - h * (wz * mn - wx * md)
    dd = fd - hh * (ix * fe - iy * fn) + h * (-c * gx - s * gz) - h * (wx * me - wy * mn)
    k = h / 12.0
    xn = hh * (2.0 * vn + dn) - k * (c11 * jx + c12 * jy + c13 * jz)
    xe = hh * (2.0 * ve + de) - k * (c21 * jx + c22 * jy + c23 * jz)
    xd = hh * (2.0 * vd + dd) - k * (c31 * jx + c32 * jy + c33 * jz)
    nav[7] = lat + xn / (r_n + height_m)
    nav[8] += xe / ((r_e + height_m) * c)
    nav[9] = height - xd
    nav[4], nav[5], nav[6] = vn + dn, ve + de, vd + dd
    c_, s_ = half_angle(px, py, pz)
    sx, sy, sz = s_ * px, s_ * py, s_ * pz
    aw = qw * c_ - qx * sx - qy * sy - qz * sz
    ax = qw * sx + qx * c_ + qy * sz - qz * sy
    ay = qw * sy - qx * sz + qy * c_ + qz * sx
    az = qw * sz + qx * sy - qy * sx + qz * c_
    zx, zy, zz = -ix * h, -iy * h, -iz * h
    c_, s_ = half_angle(zx, zy, zz)
    zx, zy, zz = s_ * zx, s_ * zy, s_ * zz
    bw = c_ * aw - zx * ax - zy * ay - zz * az
    bx = c_ * ax + zx * aw + zy * az - zz * ay
    by = c_ * ay - zx * az + zy * aw + zz * ax
    bz = c_ * az + zx * ay - zy * ax + zz * aw
    n = 1.5 - 0.5 * (bw * bw + bx * bx + by * by + bz * bz)
    nav[0], nav[1], nav[2], nav[3] = n * bw, n * bx, n * by, n * bz


@kernel
def strapdown(dtheta, dv, dt, nav, omega_ie, ned, out_q, out_v, out_r):
    """Mechanize a log of increments; row k of the outputs is ``nav`` after increment k, ``nav`` ends as the last.

    Parameters
    ----------
    dtheta, dv : float64[n, 3]
    dt : float64[n]
    nav : float64[10]
    omega_ie : float64
    ned : int64
        1 for north-east-down, 0 for Earth-fixed axes.
    out_q, out_v, out_r : float64[n, 4], float64[n, 3], float64[n, 3]
    """
    poly = np.zeros(18)
    now, before, earlier = np.zeros(6), np.zeros(6), np.zeros(6)
    h1 = h2 = 0.0
    for k in range(dtheta.shape[0]):
        h = dt[k]
        for i in range(3):
            now[i] = dtheta[k, i]
            now[3 + i] = dv[k, i]
        fit_interval(poly, now, before, earlier, h, h1, h2)
        if ned:
            advance_ned(nav, poly, h, omega_ie)
        else:
            advance_ecef(nav, poly, h, omega_ie)
        q, v, r = out_q[k], out_v[k], out_r[k]
        for i in range(3):
            q[i], v[i], r[i] = nav[i], nav[4 + i], nav[7 + i]
        q[3] = nav[3]
        earlier, before, now = before, now, earlier
        h2, h1 = h1, h


def prepare_strapdown() -> None:
    """Compile or load :func:`strapdown` before it is timed or run."""
    import numba as nb

    m, v = nb.float64[:, ::1], nb.float64[::1]
    prepare([(strapdown, (m, m, v, v, nb.float64, nb.int64, m, m, m))])
