"""Compiled error-state filter around the Earth-fixed mechanization: propagate, update, record.

One function, :func:`run_filter`, serves the batch run, the live navigator (one epoch at a time) and Monte Carlo runs
in threads. Flat interfaces only (see :mod:`schuler.jit`); arrays as in ``_covariance_kernels``, and

``nav[10]``      q_eb, v_eb_e, r_eb_e
``est[m]``       parameter estimates in the order of the layout, sensor parameters (a multiple of three) first
``hist[14]``     two previous raw increments (dtheta, dv) and their durations
``cfg``, ``icfg``, ``cnt``   settings, integer settings and running counts, by the indices below
"""

from __future__ import annotations

import math

import numpy as np

from schuler.filtering.kernels.covariance import (
    PAD,
    accumulate,
    add_half_noise,
    clear,
    compensate,
    flush,
    spread_estimates,
)
from schuler.filtering.kernels.update import (
    AT_CLOCK,
    LATERAL,
    RESET_POSITION,
    RESET_VELOCITY,
    SPEED,
    correct,
    innovate,
    measurement_rows,
    reset,
)
from schuler.filtering.limits import PLACES
from schuler.jit import inlined, kernel, prepare
from schuler.mechanization.kernels import advance_ecef, cut_interval, fit_interval

# What became of a measurement.
UNUSED = 0
ACCEPTED = 1
REJECTED = 2
FORCED = 3

GATED = 4  # a condition of the measurement was not met

CFG_OMEGA, CFG_ANGLE, CFG_RECORD, CFG_NEXT_RECORD, CFG_TIME = 0, 1, 2, 3, 4
CFG_GAP, CFG_GAP_GYRO, CFG_GAP_ACCEL, N_CFG = 5, 6, 7, 8
ICFG_EVERY, ICFG_MATRIX, ICFG_SENSORS, ICFG_LOCKOUT, ICFG_OUT_EVERY, ICFG_LAST, ICFG_AT = 0, 1, 2, 3, 4, 5, 6
N_ICFG = ICFG_AT + len(PLACES)
CNT_SINCE, CNT_MEAS, CNT_REC, CNT_NODE, CNT_UPD, CNT_OUT, CNT_EPOCH, CNT_FLUSH, N_CNT = 0, 1, 2, 3, 4, 5, 6, 7, 8


@inlined
def pack(P, out):
    """Lower triangle row by row."""
    o = 0
    for i in range(P.shape[0]):
        p = P[i]
        for j in range(i + 1):
            out[o + j] = p[j]
        o += i + 1


@kernel
def run_filter(
    dtheta, dv, dt, t_end,
    m_t, m_kind, m_z, m_R, m_lever, m_gate, m_status, m_nis, m_innov, m_var,
    nav, est, P, sens, acc, B, hist, ptab, pmod, q_imu, cfg, icfg, cnt, locks,
    out_t, out_q, out_v, out_r,
    rec_t, rec_nav, rec_est, rec_P,
    node_t, node_P, node_phi, node_B, node_upd, upd_W, upd_G, upd_e,
):  # fmt: skip
    """Filter a stretch of IMU samples with the measurements that fall into it.

    Output arrays of length zero are not written: covariance records (``rec_*``), smoother nodes (``node_*``,
    ``upd_*``), trajectory (``out_*``). ``cnt`` and ``locks`` carry positions and lock-out counts to the next call.
    """
    n = P.shape[0]
    m = n - 9
    omega = cfg[CFG_OMEGA]
    matrix = icfg[ICFG_MATRIX] != 0
    n_sensor = icfg[ICFG_SENSORS]
    every = icfg[ICFG_EVERY]
    at = icfg[ICFG_AT:]
    raw, poly, part = np.zeros(18), np.zeros(18), np.zeros(18)
    reg, cols = np.zeros(7), np.zeros(27)
    A, work, D = np.zeros((9, 9)), np.zeros((18 + n, PAD)), np.zeros(max(m, 1))
    H, W, G = np.zeros((3, PAD)), np.zeros((3, PAD)), np.zeros((3, PAD))
    y, e, S, U, dx = np.zeros(3), np.zeros(3), np.zeros((3, 3)), np.zeros((3, 3)), np.zeros(n)
    A[2, 2] = 1.0
    now, before, earlier = np.zeros(6), np.zeros(6), np.zeros(6)
    for i in range(6):
        before[i] = hist[i]
        earlier[i] = hist[6 + i]
    h1, h2 = hist[12], hist[13]
    n_meas = m_t.shape[0]
    last = dtheta.shape[0] - 1 if icfg[ICFG_LAST] else -1
    if node_t.shape[0] > 0 and cnt[CNT_NODE] == 0:  # the smoother's first node is the start itself
        keep_node(P, nav, acc, B, n_sensor, t_end[0] - dt[0], cnt, node_t, node_P, node_phi, node_B, node_upd)
    noise, q_gap = q_imu, np.zeros(6)
    for k in range(dtheta.shape[0]):
        h = dt[k]
        t_k = t_end[k]
        gap = h > cfg[CFG_GAP]
        if gap:  # bridged: rates are unknown by a constant over the pause, as white noise of the same effect
            if acc[0] > 0.0:
                propagate(
                    P, nav, est, sens, ptab, acc, B, A, work, D, pmod, n_sensor, at[AT_CLOCK], omega, noise,
                    t_k - h, cnt, node_t, node_P, node_phi, node_B, node_upd,
                )  # fmt: skip
            for i in range(3):
                q_gap[i] = q_imu[i] + cfg[CFG_GAP_GYRO] * cfg[CFG_GAP_GYRO] * h
                q_gap[3 + i] = q_imu[3 + i] + cfg[CFG_GAP_ACCEL] * cfg[CFG_GAP_ACCEL] * h
            noise = q_gap
        for i in range(3):
            now[i] = dtheta[k, i]
            now[3 + i] = dv[k, i]
        fit_interval(raw, now, before, earlier, h, h1, h2)
        compensate(poly, raw, sens, h, matrix)
        s0, sa = 0.0, 0.0
        j = cnt[CNT_MEAS]
        while j < n_meas and m_t[j] <= t_k + 1e-9:
            s1 = 1.0 - (t_k - m_t[j]) / h
            if s1 > 1.0 - 1e-6:
                s1 = 1.0
            if s1 > s0:
                cut_interval(part, poly, s0, s1)
                fx, fy, fz = advance_ecef(nav, part, (s1 - s0) * h, omega)
                accumulate(acc, B, nav, fx, fy, fz, part, (s1 - s0) * h, sens, ptab, n_sensor, matrix, reg, cols)
                sa, s0 = s0, s1
            if acc[0] > 0.0:
                propagate(
                    P, nav, est, sens, ptab, acc, B, A, work, D, pmod, n_sensor, at[AT_CLOCK], omega, noise,
                    m_t[j], cnt, node_t, node_P, node_phi, node_B, node_upd,
                )  # fmt: skip
            kind = m_kind[j]
            if m_gate[j] < 0.0 or (
                LATERAL <= kind <= SPEED and nav[4] * nav[4] + nav[5] * nav[5] + nav[6] * nav[6] < m_z[j, 7] * m_z[j, 7]
            ):
                m_status[j] = GATED
                j += 1
                continue
            d = measurement_rows(kind, m_z[j], m_lever[j], nav, est, reg, sens, ptab, n_sensor, at, omega, H, y, U)
            if kind in (RESET_POSITION, RESET_VELOCITY):
                reset(kind, m_R[j], P, nav, y, U)
                for i in range(d):
                    m_innov[j, i] = -y[i]
                m_status[j] = ACCEPTED
                j += 1
                continue
            nis = innovate(P, H, y, m_R[j], d, W, G, e, S)
            m_nis[j] = nis
            for i in range(d):
                m_innov[j, i] = -y[i]
                m_var[j, i] = S[i, i]
            status = ACCEPTED
            if nis < 0.0 or not math.isfinite(nis):
                status = REJECTED
            elif nis > m_gate[j]:
                locks[kind] += 1
                status = REJECTED
                if icfg[ICFG_LOCKOUT] > 0 and locks[kind] > icfg[ICFG_LOCKOUT]:
                    status = FORCED
            if status != REJECTED:
                # one good satellite does not make up for several that are rejected; a fix forced in has to be borne out
                locks[kind] = 0 if status == FORCED and d == 3 else max(locks[kind] - 1, 0)
                correct(P, nav, est, W, e, d, dx)
                spread_estimates(est, ptab, n_sensor, sens)
                compensate(poly, raw, sens, h, matrix)
                if s0 > sa:  # the next measurement of this time sees the corrected rate, not the one before
                    cut_interval(part, poly, sa, s0)
                    for i in range(3):
                        reg[1 + i] = part[9 + i] + 0.5 * part[12 + i] + part[15 + i] / 6.0
                        reg[4 + i] = part[i] + 0.5 * part[3 + i] + part[6 + i] / 6.0
                if node_t.shape[0] > 0:
                    u = cnt[CNT_UPD]
                    for a in range(3):
                        for i in range(n):
                            upd_W[u, a, i] = W[a, i] if a < d else 0.0
                            upd_G[u, a, i] = G[a, i] if a < d else 0.0
                        upd_e[u, a] = e[a] if a < d else 0.0
                    cnt[CNT_UPD] = u + 1
                    node_upd[cnt[CNT_NODE] - 1] = u + 1
            m_status[j] = status
            j += 1
        cnt[CNT_MEAS] = j
        if s0 == 0.0:
            fx, fy, fz = advance_ecef(nav, poly, h, omega)
            accumulate(acc, B, nav, fx, fy, fz, poly, h, sens, ptab, n_sensor, matrix, reg, cols)
        elif s0 < 1.0:
            cut_interval(part, poly, s0, 1.0)
            fx, fy, fz = advance_ecef(nav, part, (1.0 - s0) * h, omega)
            accumulate(acc, B, nav, fx, fy, fz, part, (1.0 - s0) * h, sens, ptab, n_sensor, matrix, reg, cols)
        if acc[0] > 0.0:
            cnt[CNT_SINCE] += 1
        due = rec_t.shape[0] > 0 and (t_k >= cfg[CFG_NEXT_RECORD] - 1e-9 or k == last)
        if acc[0] > 0.0 and (cnt[CNT_SINCE] >= every or acc[1] > cfg[CFG_ANGLE] or due or gap or k == last):
            propagate(
                P, nav, est, sens, ptab, acc, B, A, work, D, pmod, n_sensor, at[AT_CLOCK], omega, noise,
                t_k, cnt, node_t, node_P, node_phi, node_B, node_upd,
            )  # fmt: skip
        noise = q_imu
        if due:
            r = cnt[CNT_REC]
            if r < rec_t.shape[0]:
                rec_t[r] = t_k
                for i in range(10):
                    rec_nav[r, i] = nav[i]
                for i in range(m):
                    rec_est[r, i] = est[i]
                pack(P, rec_P[r])
                cnt[CNT_REC] = r + 1
            while cfg[CFG_NEXT_RECORD] <= t_k + 1e-9:
                cfg[CFG_NEXT_RECORD] += cfg[CFG_RECORD]
        if out_t.shape[0] > 0 and cnt[CNT_EPOCH] % icfg[ICFG_OUT_EVERY] == 0:
            o = cnt[CNT_OUT]
            out_t[o] = t_k
            q, v, r = out_q[o], out_v[o], out_r[o]
            for i in range(3):
                q[i], v[i], r[i] = nav[i], nav[4 + i], nav[7 + i]
            q[3] = nav[3]
            cnt[CNT_OUT] = o + 1
        cnt[CNT_EPOCH] += 1
        earlier, before, now = before, now, earlier
        h2, h1 = h1, h
        cfg[CFG_TIME] = t_k
    for i in range(6):
        hist[i] = before[i]
        hist[6 + i] = earlier[i]
    hist[12], hist[13] = h1, h2
    return 0


@inlined
def propagate(
    P, nav, est, sens, ptab, acc, B, A, work, D, pmod, n_sensor, i_clock, omega, q_imu,
    t, cnt, node_t, node_P, node_phi, node_B, node_upd,
):  # fmt: skip
    """Flush the covariance with its process noise and, for the smoother, keep the transition that was used.

    Estimates move as their models say: Gauss-Markov states decay, a clock offset grows by its drift.
    """
    m = P.shape[0] - 9
    add_half_noise(P, nav, acc[0], q_imu, pmod, m)
    flush(P, nav, acc, B, A, work, D, pmod, n_sensor, i_clock, omega)
    add_half_noise(P, nav, acc[0], q_imu, pmod, m)
    decays = False
    for k in range(m):
        if D[k] != 1.0:
            est[k] *= D[k]
            decays = decays or k < n_sensor
    if decays:
        spread_estimates(est, ptab, n_sensor, sens)
    if i_clock >= 0:
        est[i_clock - 9] += acc[0] * est[i_clock - 8]
    if node_t.shape[0] > 0:
        keep_node(P, nav, acc, B, n_sensor, t, cnt, node_t, node_P, node_phi, node_B, node_upd)
    clear(acc, B)
    cnt[CNT_SINCE] = 0
    cnt[CNT_FLUSH] += 1


@inlined
def keep_node(P, nav, acc, B, n_sensor, t, cnt, node_t, node_P, node_phi, node_B, node_upd):
    """Store what the smoother needs of one flush: its time, the predicted covariance and the transition."""
    i = cnt[CNT_NODE]
    if i >= node_t.shape[0]:  # a filter that turns about in estimates gone wild; the caller sees it by the counts
        return
    node_t[i] = t
    pack(P, node_P[i])
    for a in range(8):
        node_phi[i, a] = acc[a]
    for a in range(3):
        node_phi[i, 8 + a] = nav[7 + a]
    for a in range(9):
        for k in range(n_sensor):
            node_B[i, a, k] = B[a, k]
    node_upd[i] = cnt[CNT_UPD]
    cnt[CNT_NODE] = i + 1


def prepare_filter() -> None:
    """Compile or load :func:`run_filter` before it is timed or run."""
    import numba as nb

    f, m, c = nb.float64[::1], nb.float64[:, ::1], nb.float64[:, :, ::1]
    i, im = nb.int64[::1], nb.int64[:, ::1]
    types = (
        *(m, m, f, f),  # increments
        *(f, i, m, m, m, f, i, f, m, m),  # measurements
        *(f, f, m, f, f, m, f, im, m, f, f, i, i, i),  # state, model, settings
        *(f, m, m, m),  # trajectory
        *(f, m, m, m),  # records
        *(f, m, m, c, i, c, c, m),  # smoother
    )
    prepare([(run_filter, types), (spread_estimates, (f, im, nb.int64, f))])
