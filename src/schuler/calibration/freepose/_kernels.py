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


@inlined
def step_integral(t, x, before, i, stop):
    """Integral of the readings of an axis triad over steps i to stop, each with its mean reading."""
    after = 1.0 - before
    s0 = 0.0
    s1 = 0.0
    s2 = 0.0
    for m in range(i, stop):
        dt = t[m + 1] - t[m]
        s0 += dt * (before * x[m, 0] + after * x[m + 1, 0])
        s1 += dt * (before * x[m, 1] + after * x[m + 1, 1])
        s2 += dt * (before * x[m, 2] + after * x[m + 1, 2])
    return s0, s1, s2


@inlined
def times(A, x):
    """A x of a matrix and a tuple of three."""
    return (
        A[0, 0] * x[0] + A[0, 1] * x[1] + A[0, 2] * x[2],
        A[1, 0] * x[0] + A[1, 1] * x[1] + A[1, 2] * x[2],
        A[2, 0] * x[0] + A[2, 1] * x[1] + A[2, 2] * x[2],
    )


@inlined
def less(x, b, h):
    """Difference x - b h of a tuple of three: an integral over h without its bias."""
    return x[0] - b[0] * h, x[1] - b[1] * h, x[2] - b[2] * h


@inlined
def turn_derivative(C, p):
    """D = C Jl(p), row by row: Jl = I + a [p x] + b [p x]^2, [p x]^2 = p p^T - p^2 I."""
    p0, p1, p2 = p
    a, b = turn_coefficients(p0 * p0 + p1 * p1 + p2 * p2)
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
    return (
        C[0] * j00 + C[1] * j10 + C[2] * j20,
        C[0] * j01 + C[1] * j11 + C[2] * j21,
        C[0] * j02 + C[1] * j12 + C[2] * j22,
        C[3] * j00 + C[4] * j10 + C[5] * j20,
        C[3] * j01 + C[4] * j11 + C[5] * j21,
        C[3] * j02 + C[4] * j12 + C[5] * j22,
        C[6] * j00 + C[7] * j10 + C[8] * j20,
        C[6] * j01 + C[7] * j11 + C[8] * j21,
        C[6] * j02 + C[7] * j12 + C[8] * j22,
    )


@inlined
def turned(C, D, p):
    """C exp([p x]) = C + D [p x], row by row."""
    return (
        C[0] + (D[1] * p[2] - D[2] * p[1]),
        C[1] + (D[2] * p[0] - D[0] * p[2]),
        C[2] + (D[0] * p[1] - D[1] * p[0]),
        C[3] + (D[4] * p[2] - D[5] * p[1]),
        C[4] + (D[5] * p[0] - D[3] * p[2]),
        C[5] + (D[3] * p[1] - D[4] * p[0]),
        C[6] + (D[7] * p[2] - D[8] * p[1]),
        C[7] + (D[8] * p[0] - D[6] * p[2]),
        C[8] + (D[6] * p[1] - D[7] * p[0]),
    )


@inlined
def component(c, p, h, f):
    """Element c of (p, h, f), as a choice: an index of a tuple costs 8 %."""
    if c == 0:
        w = p[0]
    elif c == 1:
        w = p[1]
    elif c == 2:
        w = p[2]
    elif c == 3:
        w = h
    elif c == 4:
        w = f[0]
    elif c == 5:
        w = f[1]
    else:
        w = f[2]
    return w


@inlined
def add_scaled(H, c, D, w):
    """H[:, :, c] += D w."""
    H[0, 0, c] += D[0] * w
    H[0, 1, c] += D[1] * w
    H[0, 2, c] += D[2] * w
    H[1, 0, c] += D[3] * w
    H[1, 1, c] += D[4] * w
    H[1, 2, c] += D[5] * w
    H[2, 0, c] += D[6] * w
    H[2, 1, c] += D[7] * w
    H[2, 2, c] += D[8] * w


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
    f = (0.0, 0.0, 0.0)
    for k in range(spans.shape[0]):
        C = (1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0)
        H = H_out[k]
        H[:] = 0.0
        i = spans[k, 0]
        last = spans[k, 1]
        S_out[k] = t[last] - t[i]
        while i < last:
            stop = min(i + stride, last)
            h = t[stop] - t[i]
            y = less(step_integral(t, gyro, before, i, stop), b_g, h)
            if with_f:
                f = times(B_a, less(step_integral(t, accel, before, i, stop), b_a, h))
                g = times(G, f)
                y = (y[0] - g[0], y[1] - g[1], y[2] - g[2])
            phi = times(B_g, y)
            D = turn_derivative(C, phi)
            for c in range(columns):
                add_scaled(H, c, D, component(c, phi, h, f))
            C = turned(C, D, phi)
            i = stop
        for r in range(3):
            for c in range(3):
                C_out[k, r, c] = C[3 * r + c]


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
