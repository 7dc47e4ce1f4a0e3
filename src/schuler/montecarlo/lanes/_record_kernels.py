"""Records of several runs in lock-step: errors against the truth, claimed sigmas, normalised errors, in lanes."""
# mypy: disallow-untyped-defs=False, disallow-incomplete-defs=False
# mypy: disallow-untyped-calls=False, check-untyped-defs=False

from __future__ import annotations

import math

from schuler.filtering.kernels.vector import LANES
from schuler.jit import kernel


@kernel
def normalised(P, dx, first, last, L, z):
    """``dx' P^-1 dx`` of the states from ``first`` to before ``last``, by Cholesky.

    ``L[n (n + 1) / 2]`` and ``z[n]`` are workspace.
    """
    total = 0.0 * dx[0]
    o = 0
    for i in range(last - first):
        p = P[first + i]
        v = dx[first + i]
        q = 0
        for j in range(i):
            s = p[first + j]
            for k in range(j):
                s -= L[o + k] * L[q + k]
            s *= L[q + j]  # the inverse of the diagonal
            L[o + j] = s
            v -= s * z[j]
            q += j + 1
        s = p[first + i]
        for k in range(i):
            s -= L[o + k] * L[o + k]
        L[o + i] = 1.0 / math.sqrt(s)
        z[i] = v * L[o + i]
        total += z[i] * z[i]
        o += i + 1
    return total


@kernel
def note(r, truth, nav_f, dx_f, state, true, process, wander, clock, clock_at, work, records):
    """Record ``r``: errors and sigmas (navigation in north, east, down of the true position) and NEES of blocks.

    ``clock[c]`` are true clock states and ``clock_at`` their places among the parameters.
    ``nav_f`` and ``dx_f`` are ``state.nav`` and ``work.dx`` as plain numbers.
    """
    nav, est, P = state
    dx, C, blocks = work.dx, truth.C_en[r], truth.blocks
    error, sigma = records.error[r], records.sigma[r]
    true_nav = truth.nav[r]
    q0, q1, q2, q3 = true_nav[0], true_nav[1], true_nav[2], true_nav[3]
    for j in range(LANES):  # dq = q_hat q*, its rotation vector
        a, b, c, d = nav_f[0, j], nav_f[1, j], nav_f[2, j], nav_f[3, j]
        w = a * q0 + b * q1 + c * q2 + d * q3
        x, y, v = (
            -a * q1 + b * q0 - c * q3 + d * q2,
            -a * q2 + b * q3 + c * q0 - d * q1,
            -a * q3 - b * q2 + c * q1 + d * q0,
        )
        s = math.sqrt(x * x + y * y + v * v)
        if w < 0.0:
            w, x, y, v = -w, -x, -y, -v
        g = 2.0 * math.atan2(s, w) / s if s > 1e-12 else 2.0
        dx_f[0, j], dx_f[1, j], dx_f[2, j] = g * x, g * y, g * v
    for i in range(6):
        dx[3 + i] = nav[4 + i] - true_nav[4 + i]
    m = error.shape[0] - 9
    for k in range(m):
        dx[9 + k] = est[k] - true[k]
    for p in range(process.shape[0]):
        at = int(process[p, 3])
        if at >= 0:
            for i in range(3):
                dx[9 + at + i] -= wander[3 * p + i]
    for i in range(clock_at.shape[0]):
        dx[9 + clock_at[i]] -= clock[i]
    for b in range(blocks.shape[0]):
        records.nees[r, b] = normalised(P, dx, blocks[b, 0], blocks[b, 1], work.L, work.zn)
    for o in (0, 3, 6):
        for i in range(3):
            c0, c1, c2 = C[i], C[3 + i], C[6 + i]  # column i of C_en
            error[o + i] = c0 * dx[o] + c1 * dx[o + 1] + c2 * dx[o + 2]
            sigma[o + i] = math.sqrt(
                c0 * c0 * P[o, o] + c1 * c1 * P[o + 1, o + 1] + c2 * c2 * P[o + 2, o + 2]
                + 2.0 * (c0 * c1 * P[o + 1, o] + c0 * c2 * P[o + 2, o] + c1 * c2 * P[o + 2, o + 1])
            )  # fmt: skip
    for k in range(m):
        error[9 + k] = dx[9 + k]
        sigma[9 + k] = math.sqrt(P[9 + k, 9 + k])
