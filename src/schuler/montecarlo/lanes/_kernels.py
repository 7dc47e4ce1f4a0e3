"""Compiled Monte Carlo runs in lock-step: sensor errors, noise, strapdown and filter of :data:`LANES` runs at once.

The engine's own mechanization, transition and propagation run on lanes (``_shared_kernels``); updates have a twin
(``_update_kernels``). Times, true motion, schedule and filter model are shared by all runs and are plain numbers. No
run depends on its neighbours: there is no branch on the value of a lane.

Flat interface (float64 unless said; a last axis LANES is one run each):

``errors[33, LANES]``     b_g, b_a, M_g, M_a, G_g row by row
``process[k, 5]``         in-run bias processes ``x <- e x + q n + s`` by sample: sensor (0 gyroscope, 1 accelerometer),
                          e, q, first parameter they count to, -1 for none, and whether s is not zero
``wander[6 k, LANES]``    their values at the first sample (3 k), and s (3 k)
``streams[12, LANES]``    uint64: random streams of the white noise, of the processes, of the measurements
``plan[n]``               int64, by interval: 1 propagate the covariance at its end, 2 also record
``m_*``                   schedule: time, kind, true value, 1-sigma of its noise, axes of that noise, R, lever arm, gate
"""
# mypy: disallow-untyped-defs=False, disallow-incomplete-defs=False
# mypy: disallow-untyped-calls=False, check-untyped-defs=False

from __future__ import annotations

import numpy as np

from schuler.filtering.kernels.accumulation import N_PAST
from schuler.filtering.kernels.covariance import decay
from schuler.filtering.kernels.update import POSITION
from schuler.filtering.kernels.vector import as_lanes, cut, where_at_most
from schuler.jit import inlined, kernel, prepare
from schuler.montecarlo.lanes._random_kernels import normals
from schuler.montecarlo.lanes._record_kernels import note
from schuler.montecarlo.lanes._shared_kernels import (
    add_half_noise,
    advance_ecef,
    compensate,
    cut_interval,
    fit_interval,
    navigation_rows,
    parameter_columns,
    regressor_integrals,
    scale_parameters,
    spread_estimates,
    store_interval,
    transition,
)
from schuler.montecarlo.lanes._update_kernels import take

RECORD = 2

E_BG, E_BA, E_MG, E_MA, E_GG, N_ERRORS = 0, 3, 6, 15, 24, 33

ICFG_EVERY, ICFG_MATRIX, ICFG_CROSS, ICFG_LOCKOUT, ICFG_RESPONSE, N_ICFG = 0, 1, 2, 3, 4, 5

N_COUNTS = 10
_FIXED_ROWS = 533  # of workspace, whatever the states


@kernel
def flush(P, nav, acc, A, B, T, D, mean, on_psi, decays, omega):
    """Carry the covariance over the accumulated transition, as ``filtering.kernels.covariance.flush`` does.

    ``P[n, n]`` is an array of lanes, of which the columns of the parameters in the rows of the navigation states are
    not
    used: by symmetry row c holds what column c would. The m = n - 9 parameters are all sensor parameters, in threes.

    ``T[n, 9]`` is workspace: the navigation rows of the transition times column c of P, as row c.
    """
    n = P.shape[0]
    m = n - 9
    if decays:
        for k in range(m):
            if mean[k] != 1.0:
                for i in range(9):
                    B[k, i] *= mean[k]
    transition(A, acc, nav, omega)
    navigation_rows(A, B, P.T, P[9:], T.T, n, on_psi, m, False)  # Phi P
    navigation_rows(A, B, T, T[9:], P.T, 9, on_psi, m, True)  # Phi P Phi'
    for a in range(9):
        for b in range(a):
            P[b, a] = P[a, b]
    for c in range(m):
        p, t = P[9 + c], T[9 + c]
        for i in range(9):
            p[i] = t[i] * D[c]
    if decays:
        scale_parameters(P, D)


@inlined
def sense(now, dtheta, dv, k, h, errors, bias, sd, z, response):
    """Increments that the sensors report over interval ``k``: ImuErrors.apply_increments in lanes."""
    w0, w1, w2 = dtheta[k, 0], dtheta[k, 1], dtheta[k, 2]
    f0, f1, f2 = dv[k, 0], dv[k, 1], dv[k, 2]
    for i in range(3):
        g = dtheta[k, i] + h * bias[i] + sd[i] * z[i]
        a = dv[k, i] + h * bias[3 + i] + sd[3 + i] * z[3 + i]
        if response:
            o = E_MG + 3 * i
            g += errors[o] * w0 + errors[o + 1] * w1 + errors[o + 2] * w2
            o = E_GG + 3 * i
            g += errors[o] * f0 + errors[o + 1] * f1 + errors[o + 2] * f2
            o = E_MA + 3 * i
            a += errors[o] * f0 + errors[o + 1] * f1 + errors[o + 2] * f2
        now[i], now[3 + i] = g, a


@inlined
def walk(stream, z, driven, process, wander):
    """The in-run processes one sample on; ``driven`` normals are wanted."""
    if driven > 0:
        normals(stream, z, (driven + 1) // 2)
    o, slopes = 0, 3 * process.shape[0]
    for p in range(process.shape[0]):
        e, q = process[p, 1], process[p, 2]
        for i in range(3):
            x = e * wander[3 * p + i]
            if q > 0.0:
                x += q * z[o + i]
            if process[p, 4] != 0.0:
                x += wander[slopes + 3 * p + i]
            wander[3 * p + i] = x
        if q > 0.0:
            o += 3


@kernel
def run_lanes(
    dtheta, dv, t_end, h, plan, m_t, m_kind, m_z, m_noise, m_axes, m_R, m_lever, m_gate,
    errors_f, sd, process, wander_f, true_f, streams, nav_f, est_f, P_f, ptab, pmod, q_imu, omega, icfg, truth,
    C_en, blocks, work, rec_error_f, rec_sigma_f, rec_nees_f, counts_f,
):  # fmt: skip
    """Run the lanes over the whole log; returns 0, or the rows of workspace wanted if there are others.

    ``nav_f[10]``, ``est_f[m]`` and ``P_f[n, n]`` are the start and become the end. ``true_f[m]`` are the true values of
    the parameters without in-run processes, ``truth[r, 10]`` and ``C_en[r, 9]`` the motion at the records.
    ``counts_f[10]``: sum of normalised innovations, accepted and rejected, of positions, then of velocities; largest
    squared rotation of an interval; 1 if the engine would have readmitted fixes or adapted its noise (two rejections in
    a row, or innovations that stay too large); forgotten mean of the normalised innovations of both kinds, less 1.
    """
    errors, wander, true = as_lanes(errors_f), as_lanes(wander_f), as_lanes(true_f)
    nav, est, P = as_lanes(nav_f), as_lanes(est_f), as_lanes(P_f)
    rec_error, rec_sigma, rec_nees = as_lanes(rec_error_f), as_lanes(rec_sigma_f), as_lanes(rec_nees_f)
    counts = as_lanes(counts_f)
    m, n_proc, n_meas = est.shape[0], process.shape[0], m_t.shape[0]
    n = 9 + m
    every, matrix, cross = icfg[ICFG_EVERY], icfg[ICFG_MATRIX] != 0, icfg[ICFG_CROSS] != 0
    response = icfg[ICFG_RESPONSE] != 0
    driven = 0
    for p in range(n_proc):
        if process[p, 2] > 0.0:
            driven += 3
    # workspace, cut from one block so that all of it is aligned
    raw, poly, part = cut(work, 0, (18,)), cut(work, 18, (18,)), cut(work, 36, (18,))
    now, before, earlier, bias = cut(work, 54, (6,)), cut(work, 60, (6,)), cut(work, 66, (6,)), cut(work, 72, (6,))
    z, reg, acc, b = cut(work, 78, (6,)), cut(work, 84, (7,)), cut(work, 91, (8,)), cut(work, 99, (3,))
    zm, y, e, locks = cut(work, 102, (3,)), cut(work, 105, (3,)), cut(work, 108, (3,)), cut(work, 111, (2,))
    sens, N, M, U = cut(work, 113, (33,)), cut(work, 146, (9,)), cut(work, 155, (2, 3, 3)), cut(work, 173, (3, 3))
    H, A, sums = cut(work, 182, (3, 6)), cut(work, 200, (9, 9)), cut(work, 281, (4, 7, 9))
    o = _FIXED_ROWS
    W, T1 = cut(work, o, (n, 3)), cut(work, o + 3 * n, (n, 9))
    o += 12 * n
    B, Hp = cut(work, o, (m, 9)), cut(work, o + 9 * m, (m, 3))
    o += 12 * m
    dx_f, dx, zn, L = (
        work[o : o + n],
        cut(work, o, (n,)),
        cut(work, o + n, (n,)),
        cut(work, o + 2 * n, (n * (n + 1) // 2,)),
    )
    o += 2 * n + n * (n + 1) // 2
    past, zp = cut(work, o, (every + 2, N_PAST)), cut(work, o + (every + 2) * N_PAST, (driven + 1,))
    o += (every + 2) * N_PAST + driven + 1
    if o != work.shape[0]:
        return o
    D, mean = np.ones(m), np.ones(m)
    on_psi = np.array([k for k in range(m) if ptab[k, 0] == 0 or cross])
    white, wandering, fixes = streams[0:4], streams[4:8], streams[8:12]
    spread_estimates(est, ptab, m, M, sens)
    A[2, 2] = 1.0
    h1 = h2 = 0.0
    T = h_reg = 0.0  # time since the last propagation; length of the interval that `reg` is of
    kept = since = j = r = 0
    for k in range(dtheta.shape[0]):
        t_k = t_end[k]
        normals(white, z, 3)
        if k > 0 and n_proc > 0:
            walk(wandering, zp, driven, process, wander)
        for i in range(6):
            bias[i] = errors[i]
        for p in range(n_proc):
            o = 0 if process[p, 0] == 0.0 else 3
            for i in range(3):
                bias[o + i] += wander[3 * p + i]
        sense(now, dtheta, dv, k, h, errors, bias, sd, z, response)
        fit_interval(raw, now, before, earlier, h, h1, h2)
        compensate(poly, raw, sens, h, matrix)
        s0, sa = 0.0, 0.0
        while j < n_meas and m_t[j] <= t_k + 1e-9:
            s1 = 1.0 - (t_k - m_t[j]) / h
            if s1 > 1.0 - 1e-6:
                s1 = 1.0
            if s1 > s0:
                cut_interval(part, poly, s0, s1)
                fx, fy, fz = advance_ecef(nav, part, (s1 - s0) * h, omega)
                store_interval(past, kept, acc, b, nav, fx, fy, fz, part, (s1 - s0) * h, reg)
                h_reg = (s1 - s0) * h
                T += h_reg
                kept += 1
                sa, s0 = s0, s1
            if T > 0.0:
                propagate(
                    past, kept, T, acc, b, nav, est, sens, ptab, pmod, q_imu, matrix, cross, N, sums, A, B, T1, D, mean,
                    on_psi, M, P, omega,
                )  # fmt: skip
                T = 0.0
                kept = since = 0
            kind = m_kind[j]
            for i in range(3):
                zm[i] = m_z[j, i]
            if m_noise[j, 0] > 0.0 or m_noise[j, 1] > 0.0 or m_noise[j, 2] > 0.0:
                normals(fixes, z, 2)
                n0, n1, n2 = m_noise[j, 0] * z[0], m_noise[j, 1] * z[1], m_noise[j, 2] * z[2]
                for i in range(3):
                    zm[i] += m_axes[j, 3 * i] * n0 + m_axes[j, 3 * i + 1] * n1 + m_axes[j, 3 * i + 2] * n2
            if m_gate[j] >= 0.0:
                take(
                    kind, m_lever[j], m_R[j], m_gate[j], icfg[ICFG_LOCKOUT], omega, zm, nav, est, P, reg, h_reg, sens,
                    ptab, on_psi, cross, U, H, Hp, W, y, e, dx, M, locks, counts, 0 if kind == POSITION else 1,
                )  # fmt: skip
                compensate(poly, raw, sens, h, matrix)
                if s0 > sa:  # the next measurement of this time sees the corrected rate, not the one before
                    cut_interval(part, poly, sa, s0)
                    regressor_integrals(part, reg)
            j += 1
        if s0 == 0.0:
            fx, fy, fz = advance_ecef(nav, poly, h, omega)
            store_interval(past, kept, acc, b, nav, fx, fy, fz, poly, h, reg)
            h_reg = h
            T += h
            kept += 1
        elif s0 < 1.0:
            cut_interval(part, poly, s0, 1.0)
            fx, fy, fz = advance_ecef(nav, part, (1.0 - s0) * h, omega)
            store_interval(past, kept, acc, b, nav, fx, fy, fz, part, (1.0 - s0) * h, reg)
            h_reg = (1.0 - s0) * h
            T += h_reg
            kept += 1
        turned = reg[4] * reg[4] + reg[5] * reg[5] + reg[6] * reg[6]
        counts[6] = where_at_most(turned, counts[6], counts[6], turned)
        if T > 0.0:
            since += 1
        if T > 0.0 and (since >= every or plan[k] != 0):
            propagate(
                past, kept, T, acc, b, nav, est, sens, ptab, pmod, q_imu, matrix, cross, N, sums, A, B, T1, D, mean,
                on_psi, M, P, omega,
            )  # fmt: skip
            T = 0.0
            kept = since = 0
        if plan[k] == RECORD:
            note(
                r, truth[r], C_en[r], nav_f, dx_f, dx, nav, est, true, P, process, wander, blocks, L, zn,
                rec_error, rec_sigma, rec_nees,
            )  # fmt: skip
            r += 1
        earlier, before, now = before, now, earlier
        h2, h1 = h1, h
    return 0


@inlined
def propagate(
    past, kept, T, acc, b, nav, est, sens, ptab, pmod, q_imu, matrix, cross, N, sums, A, B, T1, D, mean, on_psi, M,
    P, omega,
):  # fmt: skip
    """Flush the covariance with its process noise; estimates of Gauss-Markov states decay."""
    m = est.shape[0]
    decays = decay(pmod, T, D, mean)
    if m > 0:
        parameter_columns(past, kept, acc, b, sens, ptab, m, matrix, cross, N, sums, B)
    add_half_noise(P, nav, T, q_imu, pmod)
    flush(P, nav, acc, A, B, T1, D, mean, on_psi, decays, omega)
    add_half_noise(P, nav, T, q_imu, pmod)
    if decays:
        for k in range(m):
            if D[k] != 1.0:
                est[k] *= D[k]
        spread_estimates(est, ptab, m, M, sens)
    for i in range(8):
        acc[i] = 0.0
    for i in range(3):
        b[i] = 0.0


def work_rows(n: int, every: int, driven: int) -> int:
    """Rows of workspace for n states, a propagation every so many samples, and normals that drive processes."""
    return _FIXED_ROWS + 12 * n + 12 * (n - 9) + 2 * n + n * (n + 1) // 2 + (every + 2) * N_PAST + driven + 1


def prepare_lanes() -> None:
    """Compile or load :func:`run_lanes` before it is timed or run."""
    import numba as nb

    f, m, c, x = nb.float64[::1], nb.float64[:, ::1], nb.float64[:, :, ::1], nb.float64
    i, im, um = nb.int64[::1], nb.int64[:, ::1], nb.uint64[:, ::1]
    types = (
        *(m, m, f, x, i),  # increments
        *(f, i, m, m, m, m, m, f),  # measurements
        *(m, f, m, m, m, um),  # errors
        *(m, m, c),  # state
        *(im, m, f, x, i),  # model
        *(m, m, im),  # truth
        *(m, c, c, c, m),  # workspace, records
    )
    prepare([(run_lanes, types)])
