"""Velocity gained in the turns of a hand-rotated log, with derivatives by size effect and delay.

Arrays are C-contiguous float64 and int64.
"""

from __future__ import annotations

import numpy as np
from numba import float64, int64

from schuler.calibration.freepose._kernels import turn_coefficients
from schuler.jit import inlined, kernel, prepare


@inlined
def step_rate(gyro, i, before, B_g, b_g, out):
    """Calibrated rate of the step from sample i to the next."""
    for r in range(3):
        total = 0.0
        for c in range(3):
            total += B_g[r, c] * (before * gyro[i, c] + (1.0 - before) * gyro[i + 1, c] - b_g[c])
        out[r] = total


@inlined
def turned(C, w, h, E, out):
    """Product ``out = C exp([w h x])``."""
    p0 = w[0] * h
    p1 = w[1] * h
    p2 = w[2] * h
    s = p0 * p0 + p1 * p1 + p2 * p2
    a, b = turn_coefficients(s)
    one = 1.0 - b * s  # sin x / x
    E[0, 0] = 1.0 - a * (p1 * p1 + p2 * p2)
    E[1, 1] = 1.0 - a * (p0 * p0 + p2 * p2)
    E[2, 2] = 1.0 - a * (p0 * p0 + p1 * p1)
    E[0, 1] = a * p0 * p1 - one * p2
    E[1, 0] = a * p0 * p1 + one * p2
    E[0, 2] = a * p0 * p2 + one * p1
    E[2, 0] = a * p0 * p2 - one * p1
    E[1, 2] = a * p1 * p2 - one * p0
    E[2, 1] = a * p1 * p2 + one * p0
    for r in range(3):
        for c in range(3):
            out[r, c] = C[r, 0] * E[0, c] + C[r, 1] * E[1, c] + C[r, 2] * E[2, c]


@kernel
def velocities(t, gyro, accel, spans, before, B_g, b_g, B_a, b_a, places, V_out, S_out, T_out, R_out):
    """Integral of specific force over each span in axes of its start: velocity gained, gravity's reaction included.

    Rates and forces are those of :func:`~schuler.calibration.freepose._kernels.turns` without g-sensitivity;
    ``places[i]`` is where the accelerometer of axis i sits, whose extra ``e_i (omega' x r_i + omega x (omega x r_i))``
    is taken out. The attitude is that of the middle of a step.

    V is the integral; S the integral weighted with time from 0 to 1 over the span; T the derivative of V by a delay of
    the gyroscopes, which turns attitude on by ``omega delay``; R[:, i, j] minus the derivative by ``places[i, j]``.
    """
    after = 1.0 - before
    steps = t.shape[0] - 1
    w = np.empty(3)
    w_last = np.empty(3)
    w_next = np.empty(3)
    f = np.empty(3)
    half = np.empty((3, 3))
    C = np.empty((3, 3))
    Cm = np.empty((3, 3))
    N = np.empty((3, 3))
    for k in range(spans.shape[0]):
        first = spans[k, 0]
        last = spans[k, 1]
        length = t[last] - t[first]
        for r in range(3):  # loops: an assignment of slices is seconds of compiling
            V_out[k, r] = S_out[k, r] = T_out[k, r] = 0.0
            for c in range(3):
                C[r, c] = 1.0 if r == c else 0.0
                for q in range(3):
                    R_out[k, r, c, q] = 0.0
        step_rate(gyro, first - 1 if first > 0 else first, before, B_g, b_g, w_last)
        step_rate(gyro, first, before, B_g, b_g, w)
        for i in range(first, last):
            dt = t[i + 1] - t[i]
            step_rate(gyro, min(i + 1, steps - 1), before, B_g, b_g, w_next)
            for r in range(3):
                f[r] = 0.0
                for c in range(3):
                    f[r] += B_a[r, c] * (before * accel[i, c] + after * accel[i + 1, c] - b_a[c])
            # response of each accelerometer to its place: [omega' x] + omega omega^T - omega^2 I
            d0 = (w_next[0] - w_last[0]) / (2.0 * dt)
            d1 = (w_next[1] - w_last[1]) / (2.0 * dt)
            d2 = (w_next[2] - w_last[2]) / (2.0 * dt)
            square = w[0] * w[0] + w[1] * w[1] + w[2] * w[2]
            for r in range(3):
                for c in range(3):
                    N[r, c] = w[r] * w[c]
                N[r, r] -= square
            N[0, 1] -= d2
            N[0, 2] += d1
            N[1, 0] += d2
            N[1, 2] -= d0
            N[2, 0] -= d1
            N[2, 1] += d0
            for r in range(3):
                for c in range(3):
                    f[r] -= N[r, c] * places[r, c]
            turned(C, w, 0.5 * dt, half, Cm)
            s = (0.5 * (t[i] + t[i + 1]) - t[first]) / length
            x0 = w[1] * f[2] - w[2] * f[1]
            x1 = w[2] * f[0] - w[0] * f[2]
            x2 = w[0] * f[1] - w[1] * f[0]
            for r in range(3):
                u = (Cm[r, 0] * f[0] + Cm[r, 1] * f[1] + Cm[r, 2] * f[2]) * dt
                V_out[k, r] += u
                S_out[k, r] += s * u
                T_out[k, r] += (Cm[r, 0] * x0 + Cm[r, 1] * x1 + Cm[r, 2] * x2) * dt
                for c in range(3):
                    for q in range(3):
                        R_out[k, r, c, q] += Cm[r, c] * N[c, q] * dt
            turned(C, w, dt, half, Cm)
            for r in range(3):
                w_last[r] = w[r]
                w[r] = w_next[r]
                for c in range(3):
                    C[r, c] = Cm[r, c]


def prepare_motion() -> None:
    """Compile or load the kernel, with a word to the user if that takes long."""
    f, m, i = float64[::1], float64[:, ::1], int64[:, ::1]
    types = (f, m, m, i, float64, m, f, m, f, m, m, m, m, float64[:, :, :, ::1])
    prepare([(velocities, types)])
