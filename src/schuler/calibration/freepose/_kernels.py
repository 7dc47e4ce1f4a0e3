"""Loops of a free-pose calibration over samples: moments of intervals, turns between poses.

Arrays are C-contiguous float64 and int64. ``spans`` hold first sample and one past the last.
"""

from __future__ import annotations

from math import cos, sin, sqrt

from numba import float64, int64

from schuler.jit import inlined, kernel, prepare

PARTS = 10


@kernel
def moments(x, spans, mean, variance, coloured):
    """Mean, variance of a sample, and variance of a part's mean times its samples, of each span and axis."""
    for k in range(spans.shape[0]):
        a = spans[k, 0]
        b = spans[k, 1]
        m = (b - a) // PARTS
        for j in range(3):
            total = 0.0
            for i in range(a, b):
                total += x[i, j] - x[a, j]
            mu = total / (b - a)
            q = 0.0
            for i in range(a, b):
                d = x[i, j] - x[a, j] - mu
                q += d * d
            variance[k, j] = q / (b - a - 1)
            s = 0.0
            s2 = 0.0
            for p in range(PARTS):
                part = 0.0
                for i in range(a + p * m, a + (p + 1) * m):
                    part += x[i, j] - x[a, j] - mu
                part /= m
                s += part
                s2 += part * part
            coloured[k, j] = m * max(s2 - s * s / PARTS, 0.0) / (PARTS - 1)
            mean[k, j] = x[a, j] + mu


@inlined
def turn_coefficients(s):
    """(1 - cos x)/x^2 and (x - sin x)/x^3 of s = x^2."""
    if s < 0.1:
        a = 0.5 - s / 24.0 * (1.0 - s / 30.0 * (1.0 - s / 56.0 * (1.0 - s / 90.0 * (1.0 - s / 132.0))))
        b = 1.0 / 6.0 - s / 120.0 * (1.0 - s / 42.0 * (1.0 - s / 72.0 * (1.0 - s / 110.0 * (1.0 - s / 156.0))))
        return a, b
    x = sqrt(s)
    return (1.0 - cos(x)) / s, (x - sin(x)) / (s * x)


@kernel
def turns(t, gyro, accel, spans, before, B_g, b_g, G, B_a, b_a, stride, columns, C_out, H_out, S_out):
    """Rotation from the end of each span to its start, with what its derivatives need.

    Step i to i + 1 has the mean rate ``y = before gyro[i] + (1 - before) gyro[i+1]``: 0.5 for samples of rates, 0 for
    means over intervals. Calibrated it is ``omega = B_g (y - b_g - G f)``, ``f = B_a (y_a - b_a)``; it is constant over
    the step (or over ``stride`` steps together), so the rotation is its exponential:

        C <- C exp([phi x]),  phi = omega dt

    and a change dphi turns the result about the axes of the start by ``D dphi``, ``D = C Jl(phi)`` with the left
    Jacobian Jl. Derivatives by all parameters are contractions of

        H[:, :, c] = sum of D q_c dt,  q = (omega_x, omega_y, omega_z, 1, f_x, f_y, f_z)

    of which the first ``columns`` (4 or 7) are kept. S is the sum of dt.
    """
    with_f = columns == 7
    f0 = 0.0
    f1 = 0.0
    f2 = 0.0
    after = 1.0 - before
    for k in range(spans.shape[0]):
        c00 = 1.0
        c01 = 0.0
        c02 = 0.0
        c10 = 0.0
        c11 = 1.0
        c12 = 0.0
        c20 = 0.0
        c21 = 0.0
        c22 = 1.0
        H = H_out[k]
        for r in range(3):
            for c in range(3):
                for q in range(columns):
                    H[r, c, q] = 0.0
        last = spans[k, 1]
        i = spans[k, 0]
        S_out[k] = t[last] - t[i]
        while i < last:
            stop = min(i + stride, last)
            y0 = 0.0
            y1 = 0.0
            y2 = 0.0
            a0 = 0.0
            a1 = 0.0
            a2 = 0.0
            h = t[stop] - t[i]
            for m in range(i, stop):
                dt = t[m + 1] - t[m]
                y0 += dt * (before * gyro[m, 0] + after * gyro[m + 1, 0])
                y1 += dt * (before * gyro[m, 1] + after * gyro[m + 1, 1])
                y2 += dt * (before * gyro[m, 2] + after * gyro[m + 1, 2])
                if with_f:
                    a0 += dt * (before * accel[m, 0] + after * accel[m + 1, 0])
                    a1 += dt * (before * accel[m, 1] + after * accel[m + 1, 1])
                    a2 += dt * (before * accel[m, 2] + after * accel[m + 1, 2])
            i = stop
            y0 -= b_g[0] * h
            y1 -= b_g[1] * h
            y2 -= b_g[2] * h
            if with_f:
                a0 -= b_a[0] * h
                a1 -= b_a[1] * h
                a2 -= b_a[2] * h
                f0 = B_a[0, 0] * a0 + B_a[0, 1] * a1 + B_a[0, 2] * a2
                f1 = B_a[1, 0] * a0 + B_a[1, 1] * a1 + B_a[1, 2] * a2
                f2 = B_a[2, 0] * a0 + B_a[2, 1] * a1 + B_a[2, 2] * a2
                y0 -= G[0, 0] * f0 + G[0, 1] * f1 + G[0, 2] * f2
                y1 -= G[1, 0] * f0 + G[1, 1] * f1 + G[1, 2] * f2
                y2 -= G[2, 0] * f0 + G[2, 1] * f1 + G[2, 2] * f2
            p0 = B_g[0, 0] * y0 + B_g[0, 1] * y1 + B_g[0, 2] * y2
            p1 = B_g[1, 0] * y0 + B_g[1, 1] * y1 + B_g[1, 2] * y2
            p2 = B_g[2, 0] * y0 + B_g[2, 1] * y1 + B_g[2, 2] * y2
            a, b = turn_coefficients(p0 * p0 + p1 * p1 + p2 * p2)
            # Jl = I + a [p x] + b [p x]^2, [p x]^2 = p p^T - p^2 I
            s = 1.0 - b * (p0 * p0 + p1 * p1 + p2 * p2)
            j00 = s + b * p0 * p0
            j11 = s + b * p1 * p1
            j22 = s + b * p2 * p2
            j01 = b * p0 * p1 - a * p2
            j10 = b * p0 * p1 + a * p2
            j02 = b * p0 * p2 + a * p1
            j20 = b * p0 * p2 - a * p1
            j12 = b * p1 * p2 - a * p0
            j21 = b * p1 * p2 + a * p0
            d00 = c00 * j00 + c01 * j10 + c02 * j20
            d01 = c00 * j01 + c01 * j11 + c02 * j21
            d02 = c00 * j02 + c01 * j12 + c02 * j22
            d10 = c10 * j00 + c11 * j10 + c12 * j20
            d11 = c10 * j01 + c11 * j11 + c12 * j21
            d12 = c10 * j02 + c11 * j12 + c12 * j22
            d20 = c20 * j00 + c21 * j10 + c22 * j20
            d21 = c20 * j01 + c21 * j11 + c22 * j21
            d22 = c20 * j02 + c21 * j12 + c22 * j22
            for q in range(columns):
                if q == 0:
                    w = p0
                elif q == 1:
                    w = p1
                elif q == 2:
                    w = p2
                elif q == 3:
                    w = h
                elif q == 4:
                    w = f0
                elif q == 5:
                    w = f1
                else:
                    w = f2
                H[0, 0, q] += d00 * w
                H[0, 1, q] += d01 * w
                H[0, 2, q] += d02 * w
                H[1, 0, q] += d10 * w
                H[1, 1, q] += d11 * w
                H[1, 2, q] += d12 * w
                H[2, 0, q] += d20 * w
                H[2, 1, q] += d21 * w
                H[2, 2, q] += d22 * w
            # C exp([p x]) = C + D [p x]
            c00 += d01 * p2 - d02 * p1
            c01 += d02 * p0 - d00 * p2
            c02 += d00 * p1 - d01 * p0
            c10 += d11 * p2 - d12 * p1
            c11 += d12 * p0 - d10 * p2
            c12 += d10 * p1 - d11 * p0
            c20 += d21 * p2 - d22 * p1
            c21 += d22 * p0 - d20 * p2
            c22 += d20 * p1 - d21 * p0
        C = C_out[k]
        C[0, 0] = c00
        C[0, 1] = c01
        C[0, 2] = c02
        C[1, 0] = c10
        C[1, 1] = c11
        C[1, 2] = c12
        C[2, 0] = c20
        C[2, 1] = c21
        C[2, 2] = c22


@kernel
def weighted_square(S, variance, V):
    """V = S diag(variance) S^T. Plain loops: a threaded library spends more on its threads at this size."""
    n = S.shape[0]
    for i in range(n):
        for j in range(i + 1):
            total = 0.0
            for k in range(S.shape[1]):
                total += S[i, k] * variance[k] * S[j, k]
            V[i, j] = total
            V[j, i] = total


@kernel
def solve_positive(V, X):
    """X <- V^-1 X by Cholesky; V is overwritten. Returns False if V is not positive definite."""
    n = V.shape[0]
    m = X.shape[1]
    for j in range(n):
        for i in range(j, n):
            total = V[i, j]
            for k in range(j):
                total -= V[i, k] * V[j, k]
            if i == j:
                if not total > 0.0:
                    return False
                V[j, j] = sqrt(total)
            else:
                V[i, j] = total / V[j, j]
    for i in range(n):
        for k in range(i):
            for c in range(m):
                X[i, c] -= V[i, k] * X[k, c]
        for c in range(m):
            X[i, c] /= V[i, i]
    for i in range(n - 1, -1, -1):
        for k in range(i + 1, n):
            for c in range(m):
                X[i, c] -= V[k, i] * X[k, c]
        for c in range(m):
            X[i, c] /= V[i, i]
    return True


def prepare_freepose() -> None:
    """Compile or load the kernels, with a word to the user if that takes long."""
    f, m, c, i = float64[::1], float64[:, ::1], float64[:, :, ::1], int64[:, ::1]
    prepare(
        [
            (moments, (m, i, m, m, m)),
            (weighted_square, (m, f, m)),
            (solve_positive, (m, m)),
            (turns, (f, m, m, i, float64, m, f, m, m, f, int64, int64, c, float64[:, :, :, ::1], f)),
        ]
    )
