"""Compiled change of the covariance where updates turn axes that nothing measures. Arrays as in ``covariance``.

With cross-couplings of both triads among the states, a rotation theta of body axes and triads together changes no
reading: ``C exp([theta x])`` with responses ``(I + M) exp([theta x])`` is the same motion of the same sensors. As an
error it is ``N theta``: ``C theta`` of the attitude, and ``t x theta`` of each row t of the responses. N depends on
estimates, so an update changes it, and what the covariance knows of other directions would be taken for knowledge of
this one (Huang, Mourikis and Roumeliotis 2010, IJRR 29(5), 502-528): of 0.8 deg of tilt the filter would claim 0.2.
After updates::

    P <- J P J',   J = I + (N - N_before) L,   L N_before = I

L takes theta about horizontal axes from the tilt, and about the vertical from the cross-coupling of the accelerometers:
an error of the heading alone, which rest and straight motion do not measure, and errors of the sensors alone stay as
they are. The choice of L is ours.

What J needs is kept by parameter, ``B[k, :]``: 0-2 row of ``N - N_before``, 3 column of L over the vertical; and in
columns 4-6, over the first nine: ``C - C_before``, horizontal part of L (row by row), vertical in body axes (three).
"""

from __future__ import annotations

from schuler.filtering.kernels.covariance import dcm
from schuler.filtering.kernels.sensor_errors import spread_estimates
from schuler.jit import borrowing, inlined

IN_L, TURN, TILT, VERTICAL = 3, 4, 5, 6  # columns of B
TURNED = -2.0  # elapsed time of a node that is no propagation but this change


@inlined
def response(sensor, source):
    """Row of ``T`` in which a matrix stands: of gyroscopes, accelerometers, g-sensitivity."""
    if sensor == 1:
        return 1
    return 0 if source >= 4 else 2


@inlined
def add_rotation(sign, est, ptab, m, T, B):
    """Add parameter rows of N, times a sign, to ``B``; ``T[3, 9]`` is workspace for the responses."""
    for a in range(3):
        for i in range(9):
            T[a, i] = 1.0 if i % 4 == 0 and a < 2 else 0.0
    for k in range(m):
        if ptab[k, 2] > 0:
            T[response(ptab[k, 0], ptab[k, 2]), 3 * ptab[k, 1] + (ptab[k, 2] - 1) % 3] += est[k]
    for k in range(m):
        if ptab[k, 2] > 0:
            t, o = T[response(ptab[k, 0], ptab[k, 2])], 3 * ptab[k, 1]
            j = (ptab[k, 2] - 1) % 3
            p, q = (j + 1) % 3, (j + 2) % 3
            B[k, q] += sign * t[o + p]
            B[k, p] -= sign * t[o + q]


@inlined
def write_change(nav, est, q, before, down, ptab, m, sens, T, B):
    """Write to ``B`` what J needs; ``q`` and ``before`` are attitude and parameters before, ``sens`` their responses.

    ``down`` is the vertical in Earth-fixed axes.
    """
    old, new = dcm(q), dcm(nav)
    for k in range(m):
        for a in range(9):
            B[k, a] = 0.0
    add_rotation(1.0, est, ptab, m, T, B)
    add_rotation(-1.0, before, ptab, m, T, B)
    for a in range(3):
        B[a, VERTICAL] = old[a] * down[0] + old[3 + a] * down[1] + old[6 + a] * down[2]
    for a in range(3):
        for j in range(3):
            B[3 * a + j, TILT] = old[3 * j + a] - B[a, VERTICAL] * down[j]
    for i in range(9):
        B[i, TURN] = new[i] - old[i]
    for k in range(m):  # half the trace of [d x]' (I + M_a)^-1 dM_a, which is d . theta for dM_a = (I + M_a) [theta x]
        if ptab[k, 0] == 1 and ptab[k, 2] > 0:
            r, j = ptab[k, 1], ptab[k, 2] - 1
            p, q = (j + 1) % 3, (j + 2) % 3
            B[k, IN_L] = 0.5 * (sens[15 + 3 * p + r] * B[q, VERTICAL] - sens[15 + 3 * q + r] * B[p, VERTICAL])


@inlined
def add_turned(P, m, B, R):
    """``P <- J P``; ``R[3, n]`` receives ``L P``."""
    n = P.shape[0]
    for j in range(n):
        v = B[0, IN_L] * P[9, j]
        for k in range(1, m):
            v += B[k, IN_L] * P[9 + k, j]
        for a in range(3):
            R[a, j] = (
                B[a, VERTICAL] * v
                + B[3 * a, TILT] * P[0, j] + B[3 * a + 1, TILT] * P[1, j] + B[3 * a + 2, TILT] * P[2, j]
            )  # fmt: skip
    for i in range(3):
        x, y, z = B[3 * i, TURN], B[3 * i + 1, TURN], B[3 * i + 2, TURN]
        for j in range(n):
            P[i, j] += x * R[0, j] + y * R[1, j] + z * R[2, j]
    for k in range(m):
        x, y, z = B[k, 0], B[k, 1], B[k, 2]
        for j in range(n):
            P[9 + k, j] += x * R[0, j] + y * R[1, j] + z * R[2, j]


@borrowing
def turn_axes(P, nav, est, q, before, down, ptab, m, sens, M, T, B, R):
    """Carry the covariance from attitude ``q`` and parameters ``before`` updates to those after.

    ``T[3, 9]``, ``R[3, n]`` are workspace. ``B`` receives what the smoother needs.
    """
    n = P.shape[0]
    spread_estimates(before, ptab, m, M, sens)
    write_change(nav, est, q, before, down, ptab, m, sens, T, B)
    spread_estimates(est, ptab, m, M, sens)
    add_turned(P, m, B, R)
    for i in range(n):
        for j in range(i):
            x = P[i, j]
            P[i, j] = P[j, i]
            P[j, i] = x
    add_turned(P, m, B, R)
    for i in range(n):
        for j in range(i):
            P[j, i] = P[i, j]


@inlined
def turn_back(B, n_sensor, lam, Y, n, wide):
    """Adjoint and information before the change: ``J' lam`` and ``Y J``, which is triangular no more.

    ``B[9, n_sensor]`` as the smoother keeps it.
    """
    for i in range(-1, n):
        row = lam if i < 0 else Y[i]
        for a in range(3):
            s = 0.0
            for j in range(3):
                s += row[j] * B[TURN, 3 * j + a]
            for k in range(n_sensor):
                s += row[9 + k] * B[a, k]
            B[7, a] = s
        v = 0.0
        for a in range(3):
            s = B[7, a]
            v += s * B[VERTICAL, a]
            for j in range(3):
                row[j] += s * B[TILT, 3 * a + j]
        for k in range(n_sensor):
            row[9 + k] += v * B[IN_L, k]
