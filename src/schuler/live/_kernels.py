"""Compiled parts of a live run: usual samples made ready, usual fixes weighed, solutions, innovations counted.

Each has a twin in Python, which takes what is not usual: ``SamplePreparation``, ``prepared_gnss`` and
``gnss_measurements``, ``NavState``. Arrays are C-contiguous float64.
"""

from __future__ import annotations

import math

import numpy as np

from schuler.earth import WGS84
from schuler.jit import inlined, kernel, prepare

_A = WGS84.a
_B = WGS84.b
_F = WGS84.f
_E2 = WGS84.e2
_NEAR = 1e-6  # of a correlation to its limit, as in ``positive_definite``


@inlined
def _turn(x, i, C):
    """Both triads of a row in other axes."""
    for k in (0, 3):
        a, b, c = x[i, k], x[i, k + 1], x[i, k + 2]
        for j in range(3):
            x[i, k + j] = C[j, 0] * a + C[j, 1] * b + C[j, 2] * c


@inlined
def _largest(x, i, k):
    return max(abs(x[i, k]), abs(x[i, k + 1]), abs(x[i, k + 2]))


@kernel
def take_samples(rows, last, of, factors, axes, before, ring, largest, t, dt, dtheta, dv, unknown, place, x):
    """Samples checked, in vehicle axes and integrated, at ``place`` of the columns; False where one is not usual.

    Nothing but free places of the columns and ``x`` is written then.

    Parameters: raw samples (n, 8) and the stamp before them; numbers in the order of their names below; factors
    to SI (6); axes (2, 3, 3), of the sensor and of the mount; the two samples before (2, 7); the recent samples and
    their largest rates, as in ``RecentSamples``; columns; rate and specific force (n, 6) for the aids.
    """
    n, m = rows.shape[0], ring.shape[0]
    shift, interval, max_gap, missing = of[0], of[1], of[2], of[3]
    max_rate, max_force, fast, hard, keep = of[4], of[5], of[6], of[7], of[8]
    rates, order, si, mounted = of[9] > 0.0, of[10], of[11] > 0.0, of[12] > 0.0
    count = int(of[13])
    per = 1.0 if rates else 1.0 / interval
    then = before[1, 0]
    for i in range(n):
        step = rows[i, 0] - last
        if not 0.0 < step <= max_gap:
            return False
        last = rows[i, 0]
        for k in range(6):
            x[i, k] = rows[i, 1 + k]
        if not si:
            for k in range(6):
                x[i, k] *= factors[k]
            _turn(x, i, axes[0])
        for k in range(3):
            if not (abs(x[i, k]) * per <= max_rate and abs(x[i, 3 + k]) * per <= max_force):
                return False
        if mounted:
            _turn(x, i, axes[1])
        a = place + i
        t[a] = last + shift
        h = t[a] - then
        then = t[a]
        dt[a] = h
        unknown[a, 0] = unknown[a, 1] = 0.0
        if not rates:
            for k in range(3):
                dtheta[a, k], dv[a, k] = x[i, k], x[i, 3 + k]
        elif order == 1.0:
            for k in range(3):
                dtheta[a, k], dv[a, k] = h * x[i, k], h * x[i, 3 + k]
        elif i == 0:
            for k in range(3):
                dtheta[a, k] = 0.5 * h * (before[1, 1 + k] + x[i, k])
                dv[a, k] = 0.5 * h * (before[1, 4 + k] + x[i, 3 + k])
        else:
            for k in range(3):
                dtheta[a, k] = 0.5 * h * (x[i - 1, k] + x[i, k])
                dv[a, k] = 0.5 * h * (x[i - 1, 3 + k] + x[i, 3 + k])
        length = max(h, interval)
        if not (h <= missing * interval and _largest(dtheta, a, 0) <= fast * length):
            return False
        if _largest(dv, a, 0) > hard * length or (rates and (_largest(x, i, 0) > fast or _largest(x, i, 3) > 190.0)):
            return False
    for i in range(max(n - 2, 0), n):
        for k in range(7):
            before[0, k] = before[1, k]
        before[1, 0] = t[place + i]
        for k in range(6):
            before[1, 1 + k] = x[i, k]
    for i in range(n):
        a = place + i
        length = max(dt[a], interval)
        largest[0] = max(_largest(dtheta, a, 0) / length, keep * largest[0])
        largest[1] = max(_largest(dv, a, 0) / length, keep * largest[1])
        row = (count + i) % m
        ring[row, 0], ring[row, 1] = t[a], dt[a]
        for k in range(3):
            ring[row, 2 + k], ring[row, 5 + k] = dtheta[a, k], dv[a, k]
            if not rates:
                x[i, k] /= dt[a]
                x[i, 3 + k] /= dt[a]
    largest[2] = 0.0
    return True


@inlined
def _is_covariance(C):
    """Finite, symmetric, of positive variances and far from singular."""
    top = 1.0
    for i in range(3):
        for j in range(3):
            if not math.isfinite(C[i, j]):
                return False
            top = max(top, abs(C[i, j]))
    for i in range(3):
        if not C[i, i] > 0.0:
            return False
        for j in range(i):
            if abs(C[i, j] - C[j, i]) > 1e-9 * top:
                return False
    a, b, c, ab, ac, bc = C[0, 0], C[1, 1], C[2, 2], C[0, 1], C[0, 2], C[1, 2]
    p, q, r = ab * ab / (a * b), ac * ac / (a * c), bc * bc / (b * c)
    return 1.0 + 2.0 * ab * ac * bc / (a * b * c) - (p + q + r) > _NEAR and max(p, q, r) < 1.0 - _NEAR


@inlined
def _weigh(C, row, weights, R):
    """Covariance scaled, and its variances lifted to a floor; weights: factors on 1-sigmas, floors of variances."""
    for i in range(3):
        for j in range(3):
            R[row, i, j] = C[i, j] * weights[i] * weights[j]
    for i in range(3):
        R[row, i, i] += max(weights[3 + i] - R[row, i, i], 0.0)


@kernel
def weigh_fix(llh, cov_r_n, v_n, cov_v_n, limits, weights, z, R):
    """Position, and velocity where ``z`` has a second row, of a fix as measurements; False where it is not usual.

    Parameters: a fix (3), (3, 3); limits of its 1-sigmas: horizontal, height, velocity; weights (2, 6), see ``_weigh``;
    values (k, 8) and covariances (k, 3, 3).
    """
    for i in range(3):
        if not math.isfinite(llh[i]):
            return False
    if abs(llh[0]) > 0.5 * math.pi + 1e-12 or not _is_covariance(cov_r_n):
        return False
    if max(cov_r_n[0, 0], cov_r_n[1, 1]) > limits[0] ** 2 or cov_r_n[2, 2] > limits[1] ** 2:
        return False
    if z.shape[0] > 1:
        for i in range(3):
            if not (math.isfinite(v_n[i]) and cov_v_n[i, i] <= limits[2] ** 2):
                return False
            z[1, i] = v_n[i]
        if not _is_covariance(cov_v_n):
            return False
        _weigh(cov_v_n, 1, weights[1], R)
    _weigh(cov_r_n, 0, weights[0], R)
    sL, cL, sl, cl = math.sin(llh[0]), math.cos(llh[0]), math.sin(llh[1]), math.cos(llh[1])
    n = _A / math.sqrt(1.0 - _E2 * sL * sL)
    p = (n + llh[2]) * cL
    z[0, 0], z[0, 1], z[0, 2] = p * cl, p * sl, ((1.0 - _E2) * n + llh[2]) * sL
    return True


@kernel
def geodetic_solution(nav, P, out):
    """Latitude, longitude, height, velocity, roll, pitch, yaw and 1-sigmas of a state, north-east-down.

    Parameters: attitude, velocity, position Earth-fixed (10); covariance with these errors first; out (6, 3): place,
    velocity, angles, 1-sigma of position, velocity, attitude.
    """
    x, y, z = nav[7], nav[8], nav[9]
    p = math.sqrt(x * x + y * y)
    S, C = _A * z, _B * p
    for _ in range(2):
        n = math.sqrt(S * S + C * C)
        s, c = S / n, C / n
        S, C = (1.0 - _F) * (z + _E2 / (1.0 - _E2) * _B * s * s * s), p - _E2 * _A * c * c * c
    S /= 1.0 - _F
    n = math.sqrt(S * S + C * C)
    sL, cL = S / n, C / n
    lon = math.atan2(y + 0.0, x + 0.0)  # no minus zero
    out[0, 0], out[0, 1] = math.atan2(S, C), lon
    out[0, 2] = p * cL + z * sL - _A * math.sqrt(1.0 - _E2 * sL * sL)
    sl, cl = math.sin(lon), math.cos(lon)
    C_en = np.empty((3, 3))
    C_en[0, 0], C_en[0, 1], C_en[0, 2] = -sL * cl, -sl, -cL * cl
    C_en[1, 0], C_en[1, 1], C_en[1, 2] = -sL * sl, cl, -cL * sl
    C_en[2, 0], C_en[2, 1], C_en[2, 2] = cL, 0.0, -sL
    norm = math.sqrt(nav[0] * nav[0] + nav[1] * nav[1] + nav[2] * nav[2] + nav[3] * nav[3])
    q, u, v, w = nav[0] / norm, nav[1] / norm, nav[2] / norm, nav[3] / norm
    C_eb = np.empty((3, 3))
    C_eb[0, 0], C_eb[1, 1], C_eb[2, 2] = q * q + u * u - v * v - w * w, q * q - u * u + v * v - w * w, 1.0
    C_eb[2, 2] = q * q - u * u - v * v + w * w
    C_eb[0, 1], C_eb[0, 2] = 2.0 * (u * v - q * w), 2.0 * (u * w + q * v)
    C_eb[1, 0], C_eb[1, 2] = 2.0 * (u * v + q * w), 2.0 * (v * w - q * u)
    C_eb[2, 0], C_eb[2, 1] = 2.0 * (u * w - q * v), 2.0 * (v * w + q * u)
    C_nb = np.zeros((3, 3))
    for i in range(3):
        out[1, i] = C_en[0, i] * nav[4] + C_en[1, i] * nav[5] + C_en[2, i] * nav[6]
        for j in range(3):
            for k in range(3):
                C_nb[i, j] += C_en[k, i] * C_eb[k, j]
    level = math.sqrt(C_nb[2, 1] ** 2 + C_nb[2, 2] ** 2)
    out[2, 1] = math.atan2(-C_nb[2, 0], level)
    if level < 1e-6:  # roll and yaw are one motion
        out[2, 0], out[2, 2] = 0.0, math.atan2(0.0 - C_nb[0, 1], C_nb[1, 1])
    else:
        out[2, 0] = math.atan2(C_nb[2, 1] + 0.0, C_nb[2, 2])
        out[2, 2] = math.atan2(C_nb[1, 0] + 0.0, C_nb[0, 0])
    for block in range(3):  # attitude, velocity, position
        for i in range(3):
            variance = 0.0
            for j in range(3):
                for k in range(3):
                    variance += C_en[j, i] * P[3 * block + j, 3 * block + k] * C_en[k, i]
            out[5 - block, i] = math.sqrt(max(variance, 0.0))


@kernel
def count_innovations(t, kind, status, nis, since, sorts, accepted, forced, rejected, out, used):
    """Innovations from a time on added up: judged ones used, refused, their squares, forced; and times of positions.

    ``sorts`` (kinds, 3): whether a kind is judged, whether it places the vehicle, by what its squares are divided.
    ``out``: number used or refused, refused, squares of the used, used, forced, number of times in ``used``.
    """
    for i in range(t.shape[0]):
        if t[i] < since:
            continue
        s, k = status[i], int(kind[i])
        if sorts[k, 1] > 0.0 and s in (accepted, forced):
            used[int(out[5])] = t[i]
            out[5] += 1.0
        if sorts[k, 0] == 0.0 or s not in (accepted, forced, rejected):
            continue
        out[0] += 1.0
        if s == rejected:
            out[1] += 1.0
        elif s == accepted:
            out[2] += nis[i] / sorts[k, 2]
            out[3] += 1.0
        else:
            out[4] += 1.0


@kernel
def usual_step(t):
    """Median of the steps between times (n,), n at least 2."""
    m = t.shape[0] - 1
    steps = np.empty(m)
    for i in range(m):
        steps[i] = t[i + 1] - t[i]
    steps.sort()
    return 0.5 * (steps[(m - 1) // 2] + steps[m // 2])


def prepare_live() -> None:
    """Compile or load what a live run calls."""
    from numba import float64, int64

    f, m, c, k, x = float64[::1], float64[:, ::1], float64[:, :, ::1], int64[::1], float64
    prepare(
        [
            (take_samples, (m, x, f, f, c, m, m, f, f, f, m, m, m, int64, m)),
            (weigh_fix, (f, m, f, m, f, m, m, c)),
            (geodetic_solution, (f, m, m)),
            (count_innovations, (f, k, k, f, x, m, int64, int64, int64, f, f)),
            (usual_step, (f,)),
        ]
    )
