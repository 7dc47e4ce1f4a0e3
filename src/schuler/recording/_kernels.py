"""Compiled change of axes of whole trajectories; the NumPy twins are in ``frames`` and ``rotation``."""

from __future__ import annotations

import math

from schuler.earth import WGS84
from schuler.jit import inlined, kernel, prepare

_A = WGS84.a
_B = WGS84.b
_F = WGS84.f
_E2 = WGS84.e2


@inlined
def axes_quaternion(lat, lon):
    """``q_en`` of a place."""
    a, b = 0.5 * lon, -0.5 * (0.5 * math.pi + lat)
    sz, cz, sy, cy = math.sin(a), math.cos(a), math.sin(b), math.cos(b)
    return cz * cy, -sz * sy, cz * sy, sz * cy


@kernel
def geodetic(r, llh):
    """Latitude, longitude, height of Earth-fixed positions (n, 3): two of Bowring's steps, as in ``llh_from_ecef``."""
    for k in range(r.shape[0]):
        x, y, z = r[k, 0], r[k, 1], r[k, 2]
        p = math.sqrt(x * x + y * y)
        S, C = _A * z, _B * p
        for _ in range(2):
            n = 1.0 / math.sqrt(S * S + C * C)
            s, c = S * n, C * n
            S, C = (1.0 - _F) * (z + _E2 / (1.0 - _E2) * _B * s * s * s), p - _E2 * _A * c * c * c
        S /= 1.0 - _F
        n = 1.0 / math.sqrt(S * S + C * C)
        s, c = S * n, C * n
        llh[k, 0] = math.atan2(S, C)
        llh[k, 1] = math.atan2(y + 0.0, x + 0.0)  # no minus zero
        llh[k, 2] = p * c + z * s - _A * math.sqrt(1.0 - _E2 * s * s)


@kernel
def vectors_to_ned(v_e, llh, v_n):
    """North-east-down components of Earth-fixed vectors (n, 3) at places ``llh``."""
    for k in range(v_e.shape[0]):
        sL, cL, sl, cl = math.sin(llh[k, 0]), math.cos(llh[k, 0]), math.sin(llh[k, 1]), math.cos(llh[k, 1])
        x, y, z = v_e[k, 0], v_e[k, 1], v_e[k, 2]
        h = cl * x + sl * y
        v_n[k, 0] = -sL * h + cL * z
        v_n[k, 1] = -sl * x + cl * y
        v_n[k, 2] = -cL * h - sL * z


@kernel
def attitudes_to_ned(q_eb, llh, q_nb):
    """``q_nb`` of ``q_eb`` (n, 4) at places ``llh``."""
    for k in range(q_eb.shape[0]):
        w, x, y, z = axes_quaternion(llh[k, 0], llh[k, 1])
        a, b, c, d = q_eb[k, 0], q_eb[k, 1], q_eb[k, 2], q_eb[k, 3]
        q_nb[k, 0] = w * a + x * b + y * c + z * d
        q_nb[k, 1] = w * b - x * a - y * d + z * c
        q_nb[k, 2] = w * c + x * d - y * a - z * b
        q_nb[k, 3] = w * d - x * c + y * b - z * a


@kernel
def earth_fixed(llh, v_n, rpy, r, v_e, q_eb):
    """Earth-fixed positions, velocities, attitudes of geodetic ones (n, 3); the NumPy twin is Trajectory.from_geodetic.

    ``v_n`` and ``rpy`` have no rows where there are none.
    """
    moves, turns = len(v_n) > 0, len(rpy) > 0
    for k in range(len(llh)):
        lat, lon, h = llh[k, 0], llh[k, 1], llh[k, 2]
        sL, cL, sl, cl = math.sin(lat), math.cos(lat), math.sin(lon), math.cos(lon)
        n = _A / math.sqrt(1.0 - _E2 * sL * sL)
        r[k, 0], r[k, 1], r[k, 2] = (n + h) * cL * cl, (n + h) * cL * sl, ((1.0 - _E2) * n + h) * sL
        if moves:
            north, east, down = v_n[k, 0], v_n[k, 1], v_n[k, 2]
            out = -sL * north - cL * down  # away from the axis
            v_e[k, 0] = cl * out - sl * east
            v_e[k, 1] = sl * out + cl * east
            v_e[k, 2] = cL * north - sL * down
        if turns:
            a, b, c = 0.5 * rpy[k, 0], 0.5 * rpy[k, 1], 0.5 * rpy[k, 2]
            sr, cr, sp, cp, sy, cy = math.sin(a), math.cos(a), math.sin(b), math.cos(b), math.sin(c), math.cos(c)
            bw, bx = cr * cp * cy + sr * sp * sy, sr * cp * cy - cr * sp * sy
            by, bz = cr * sp * cy + sr * cp * sy, cr * cp * sy - sr * sp * cy
            w, x, y, z = axes_quaternion(lat, lon)
            qw = w * bw - x * bx - y * by - z * bz
            sign = -1.0 if qw < 0.0 else 1.0
            q_eb[k, 0] = sign * qw
            q_eb[k, 1] = sign * (w * bx + x * bw + y * bz - z * by)
            q_eb[k, 2] = sign * (w * by - x * bz + y * bw + z * bx)
            q_eb[k, 3] = sign * (w * bz + x * by - y * bx + z * bw)


@inlined
def _deviation(values, k, begin, end):
    """Mean and standard deviation of a column from row to row."""
    mean = 0.0
    for i in range(begin, end):
        mean += values[i, k]
    mean /= end - begin
    square = 0.0
    for i in range(begin, end):
        square += (values[i, k] - mean) ** 2
    return mean, math.sqrt(square / (end - begin))


@kernel
def windows(accel, gyro, size, out):
    """Statistics (10, m) of windows of ``size`` samples; the NumPy twin is in ``io.checks``."""
    half = size // 2
    for k in range(out.shape[1]):
        begin, end = k * size, (k + 1) * size
        early = late = 0.0
        for i in range(begin, end):
            norm = math.sqrt(accel[i, 0] * accel[i, 0] + accel[i, 1] * accel[i, 1] + accel[i, 2] * accel[i, 2])
            if i < begin + half:
                early += norm
            else:
                late += norm
        spread = noise = 0.0
        for j in range(3):
            out[4 + j, k], deviation = _deviation(accel, j, begin, end)
            spread = max(spread, deviation)
            out[7 + j, k], deviation = _deviation(gyro, j, begin, end)
            noise = max(noise, deviation)
        out[0, k] = (early + late) / size
        out[1, k] = abs(early / half - late / (size - half))
        out[2, k], out[3, k] = spread, noise


def prepare_windows() -> None:
    """Compile or load the kernel before it is run."""
    import numba as nb

    m = nb.float64[:, ::1]
    prepare([(windows, (m, m, nb.int64, m))])


def prepare_earth_fixed() -> None:
    """Compile or load the kernel before it is run."""
    import numba as nb

    m = nb.float64[:, ::1]
    prepare([(earth_fixed, (m, m, m, m, m, m))])


def prepare_axes() -> None:
    """Compile or load the kernels before they are run."""
    import numba as nb

    m = nb.float64[:, ::1]
    prepare([(geodetic, (m, m)), (vectors_to_ned, (m, m, m)), (attitudes_to_ned, (m, m, m))])
