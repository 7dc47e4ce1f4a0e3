"""Compiled Monte Carlo runs in lock-step: sensor errors, noise, strapdown and filter of :data:`LANES` runs at once.

The engine's own mechanization, transition and propagation run on lanes (``_shared_kernels``); updates have a twin
(``_update_kernels``). Times, true motion, schedule and filter model are shared by all runs and are plain numbers. No
run depends on its neighbours: there is no branch on the value of a lane. Arguments are tuples of arrays by what they
are (:mod:`schuler.montecarlo.lanes.lane_arrays`).
"""
# mypy: disallow-untyped-defs=False, disallow-incomplete-defs=False
# mypy: disallow-untyped-calls=False, check-untyped-defs=False

from __future__ import annotations

import numpy as np

from schuler.filtering.kernels.accumulation import N_PAST
from schuler.filtering.kernels.covariance import decay
from schuler.filtering.kernels.update import ARC_START, AT_CLOCK, CARRIER_PHASE, POSITION, PSEUDORANGE, RANGE_RATE
from schuler.filtering.kernels.vector import as_lanes, cut, where_at_most
from schuler.filtering.limits import MOST_CHANNELS
from schuler.jit import inlined, kernel, prepare
from schuler.montecarlo.lanes._random_kernels import normals
from schuler.montecarlo.lanes._range_kernels import take_satellite
from schuler.montecarlo.lanes._record_kernels import note
from schuler.montecarlo.lanes._shared_kernels import (
    add_clock_drift,
    add_half_noise,
    advance_ecef,
    compensate,
    cut_interval,
    fit_interval,
    navigation_rows,
    ned_axes,
    parameter_columns,
    regressor_integrals,
    scale_parameters,
    spread_estimates,
    store_interval,
    transition,
    turn_axes,
)
from schuler.montecarlo.lanes._update_kernels import take
from schuler.montecarlo.lanes.lane_arrays import (
    LaneErrors,
    LaneFixes,
    LaneLog,
    LaneModel,
    LaneRecordArrays,
    LaneSky,
    LaneState,
    LaneTruth,
    LaneWorkspace,
)

RECORD = 2

E_BG, E_BA, E_MG, E_MA, E_GG, N_ERRORS = 0, 3, 6, 15, 24, 33

N_COUNTS = 19
_FIXED_ROWS = 533  # of workspace, whatever the states


@inlined
def first_of_dx(n, m):
    """Row of workspace at which the corrections begin."""
    return _FIXED_ROWS + 12 * n + 12 * m


@kernel
def cut_workspace(work, n, m, every, driven):
    """Workspace for n states, m of them parameters, cut from one block so that all of it is aligned."""
    o, at_dx, triangle = _FIXED_ROWS, first_of_dx(n, m), n * (n + 1) // 2
    last = at_dx + 2 * n + triangle + (every + 2) * N_PAST + driven + 1 + 4 + m
    return LaneWorkspace(
        poly=cut(work, 0, (3, 18)),
        increments=cut(work, 54, (3, 6)),
        bias=cut(work, 72, (6,)),
        z=cut(work, 78, (6,)),
        driving=cut(work, at_dx + 2 * n + triangle + (every + 2) * N_PAST, (driven + 1,)),
        reg=cut(work, 84, (7,)),
        acc=cut(work, 91, (8,)),
        moment=cut(work, 99, (3,)),
        past=cut(work, at_dx + 2 * n + triangle, (every + 2, N_PAST)),
        before=cut(work, at_dx + 2 * n + triangle + (every + 2) * N_PAST + driven + 1, (4 + m,)),
        fix=cut(work, 102, (3,)),
        y=cut(work, 105, (3,)),
        e=cut(work, 108, (3,)),
        locks=cut(work, 111, (2,)),
        sens=cut(work, 113, (33,)),
        N=cut(work, 146, (9,)),
        M=cut(work, 155, (2, 3, 3)),
        U=cut(work, 173, (3, 3)),
        H=cut(work, 182, (3, 6)),
        Hp=cut(work, o + 12 * n + 9 * m, (m, 3)),
        A=cut(work, 200, (9, 9)),
        sums=cut(work, 281, (4, 7, 9)),
        B=cut(work, o + 12 * n, (m, 9)),
        W=cut(work, o, (n, 3)),
        turned=cut(work, o + 3 * n, (n, 9)),
        dx=cut(work, at_dx, (n,)),
        zn=cut(work, at_dx + n, (n,)),
        L=cut(work, at_dx + 2 * n, (triangle,)),
        row=cut(work, last, (1, n)),
        w=cut(work, last + n, (n,)),
        range_locks=cut(work, last + 2 * n, (3,)),
    )


def work_rows(n: int, every: int, driven: int) -> int:
    """Rows of workspace for n states, a propagation every so many samples, and normals that drive processes."""
    return _FIXED_ROWS + 14 * n + 12 * (n - 9) + n * (n + 1) // 2 + (every + 2) * N_PAST + driven + 3 * n - 1


@kernel
def flush(P, nav, acc, A, B, T, D, mean, on_psi, n_sensor, decays, omega):
    """Carry the covariance over the accumulated transition, as ``filtering.kernels.covariance.flush`` does.

    ``P[n, n]`` is an array of lanes, of which the columns of the parameters in the rows of the navigation states are
    not
    used: by symmetry row c holds what column c would.

    ``T[n, 9]`` is workspace: the navigation rows of the transition times column c of P, as row c.
    """
    n = P.shape[0]
    m = n - 9
    if decays:
        for k in range(n_sensor):
            if mean[k] != 1.0:
                for i in range(9):
                    B[k, i] *= mean[k]
    transition(A, acc, nav, omega)
    navigation_rows(A, B, P.T, P[9:], T.T, n, on_psi, n_sensor, False)  # Phi P
    navigation_rows(A, B, T, T[9:], P.T, 9, on_psi, n_sensor, True)  # Phi P Phi'
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
def biases(errors, process, wander, bias):
    """Biases of a sample: constants and in-run processes."""
    for i in range(6):
        bias[i] = errors[i]
    for p in range(process.shape[0]):
        o = 0 if process[p, 0] == 0.0 else 3
        for i in range(3):
            bias[o + i] += wander[3 * p + i]


@inlined
def sense(now, dtheta, dv, h, errors, bias, sd, z, response):
    """Increments that the sensors report over an interval: ImuErrors.apply_increments in lanes."""
    w0, w1, w2 = dtheta[0], dtheta[1], dtheta[2]
    f0, f1, f2 = dv[0], dv[1], dv[2]
    for i in range(3):
        g = dtheta[i] + h * bias[i] + sd[i] * z[i]
        a = dv[i] + h * bias[3 + i] + sd[3 + i] * z[3 + i]
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


@inlined
def draw_fix(fixes, j, stream, z, fix):
    """Measurement ``j`` with noise of its own in every lane."""
    for i in range(3):
        fix[i] = fixes.z[j, i]
    noise, axes = fixes.noise[j], fixes.axes[j]
    if noise[0] > 0.0 or noise[1] > 0.0 or noise[2] > 0.0:
        normals(stream, z, 2)
        n0, n1, n2 = noise[0] * z[0], noise[1] * z[1], noise[2] * z[2]
        for i in range(3):
            fix[i] += axes[3 * i] * n0 + axes[3 * i + 1] * n1 + axes[3 * i + 2] * n2


@inlined
def propagate(state, model, work, kept, T, D, mean, on_psi):
    """Flush the covariance with its process noise; estimates of Gauss-Markov states decay."""
    nav, est, P = state
    n_sensor, i_clock = model.n_sensor, model.places[AT_CLOCK]
    decays = decay(model.dynamics, T, D, mean)
    if n_sensor > 0:
        parameter_columns(
            work.past, kept, work.acc, work.moment, work.sens, model.table, n_sensor, model.matrix, model.cross, work.N,
            work.sums, work.B,
        )  # fmt: skip
    add_half_noise(P, nav, T, model.psd, model.dynamics)
    flush(P, nav, work.acc, work.A, work.B, work.turned, D, mean, on_psi, n_sensor, decays, model.omega)
    if i_clock >= 0:
        est[i_clock - 9] += T * est[i_clock - 8]
        add_clock_drift(P, i_clock, T)
    add_half_noise(P, nav, T, model.psd, model.dynamics)
    if decays:
        for k in range(est.shape[0]):
            if D[k] != 1.0:
                est[k] *= D[k]
        spread_estimates(est, model.table, n_sensor, work.M, work.sens)
    for i in range(8):
        work.acc[i] = 0.0
    for i in range(3):
        work.moment[i] = 0.0


@inlined
def keep_before(state, before):
    """Keep attitude and parameters before the first update of a time."""
    for i in range(4):
        before[i] = state.nav[i]
    for k in range(state.est.shape[0]):
        before[4 + k] = state.est[k]


@inlined
def turn(state, model, work):
    """Carry the covariance to the axes of corrected estimates."""
    nav, est, P = state
    n = P.shape[0]
    for i in range(9):  # not used elsewhere, see `flush`
        for c in range(9, n):
            P[i, c] = P[c, i]
    ned_axes(nav, work.U)
    turn_axes(
        P, nav, est, work.before[:4], work.before[4:], work.U[2], model.table, model.n_sensor, work.sens, work.M,
        work.sums[0], work.B, work.turned.T,
    )  # fmt: skip


@inlined
def update(fixes, j, state, model, work, h_reg, on_psi, counts):
    """Correct the states by measurement ``j``, which stands in ``work.fix``."""
    kind = fixes.kind[j]
    take(
        kind, fixes.lever[j], fixes.R[j], fixes.gate[j], model.lockout, model.omega, work.fix, state.nav, state.est,
        state.P, work.reg, h_reg, work.sens, model.table, on_psi, model.cross, work.U, work.H, work.Hp, work.W, work.y,
        work.e, work.dx, work.M, work.locks, counts, 0 if kind == POSITION else 1, model.n_sensor,
    )  # fmt: skip


@kernel
def run_lanes(log, fixes, errors, sky, start, model, truth, memory, kept_of_runs):
    """Run the lanes over the whole log.

    ``memory[rows, LANES]`` is workspace, see :func:`work_rows`.
    """
    constants, wander, process = as_lanes(errors.constants), as_lanes(errors.wander), errors.process
    state = LaneState(as_lanes(start.nav), as_lanes(start.est), as_lanes(start.P))
    records = LaneRecordArrays(
        as_lanes(kept_of_runs.error), as_lanes(kept_of_runs.sigma), as_lanes(kept_of_runs.nees),
        as_lanes(kept_of_runs.counts),
    )  # fmt: skip
    true, counts = as_lanes(errors.true), records.counts
    range_error, clock = as_lanes(sky.error), as_lanes(sky.clock)
    arcs, used = np.full(MOST_CHANNELS, -np.inf), np.zeros(9 + start.est.shape[0], dtype=np.int64)
    m, n_proc, n_fixes = state.est.shape[0], process.shape[0], fixes.t.shape[0]
    driven = 0
    for p in range(n_proc):
        if process[p, 2] > 0.0:
            driven += 3
    work = cut_workspace(memory, 9 + m, m, model.every, driven)
    first = first_of_dx(9 + m, m)
    dx_f = memory[first : first + 9 + m]
    raw, poly, part, reg, sens = work.poly[0], work.poly[1], work.poly[2], work.reg, work.sens
    now, before, earlier = work.increments[0], work.increments[1], work.increments[2]
    D, mean = np.ones(m), np.ones(m)
    on_psi = np.array([k for k in range(model.n_sensor) if model.table[k, 0] == 0 or model.cross])
    white, wandering, drawn = errors.streams[0:4], errors.streams[4:8], errors.streams[8:12]
    h, omega = log.h, model.omega
    spread_estimates(state.est, model.table, model.n_sensor, work.M, sens)
    work.A[2, 2] = 1.0
    h1 = h2 = 0.0
    T = h_reg = 0.0  # time since the last propagation; length of the interval that `reg` is of
    kept = since = j = r = 0
    corrected = False
    for k in range(log.dtheta.shape[0]):
        t = log.t[k]
        normals(white, work.z, 3)
        if k > 0 and n_proc > 0:
            walk(wandering, work.driving, driven, process, wander)
        biases(constants, process, wander, work.bias)
        sense(now, log.dtheta[k], log.dv[k], h, constants, work.bias, errors.white, work.z, errors.response)
        fit_interval(raw, now, before, earlier, h, h1, h2)
        compensate(poly, raw, sens, h, model.matrix)
        s0, sa = 0.0, 0.0  # where in the interval the states are, and where its last piece began
        while True:  # one pass, one call of `propagate`
            measured = j < n_fixes and fixes.t[j] <= t + 1e-9
            s1 = 1.0
            if measured:
                s1 = 1.0 - (t - fixes.t[j]) / h
                if s1 > 1.0 - 1e-6:
                    s1 = 1.0
            if s1 > s0:
                if corrected:
                    turn(state, model, work)
                    corrected = False
                piece = poly
                if measured or s0 > 0.0:
                    cut_interval(part, poly, s0, s1)
                    piece = part
                h_reg = (s1 - s0) * h
                fx, fy, fz = advance_ecef(state.nav, piece, h_reg, omega)
                store_interval(work.past, kept, work.acc, work.moment, state.nav, fx, fy, fz, piece, h_reg, reg)
                T += h_reg
                kept += 1
                sa, s0 = s0, s1
            if not measured and T > 0.0:
                since += 1
            if T > 0.0 and (measured or since >= model.every or log.plan[k] != 0):
                propagate(state, model, work, kept, T, D, mean, on_psi)
                T = 0.0
                kept = since = 0
            if not measured:
                break
            single = fixes.kind[j] in (PSEUDORANGE, RANGE_RATE, CARRIER_PHASE, ARC_START)
            if not single:
                draw_fix(fixes, j, drawn, work.z, work.fix)
            if fixes.gate[j] >= 0.0:
                if model.free_axes and not corrected:
                    keep_before(state, work.before)
                    corrected = True
                if single:
                    take_satellite(j, fixes, range_error, state, model, on_psi, arcs, used, work, counts)
                else:
                    update(fixes, j, state, model, work, h_reg, on_psi, counts)
                compensate(poly, raw, sens, h, model.matrix)
                if s0 > sa:  # the next measurement of this time sees the corrected rate, not the one before
                    cut_interval(part, poly, sa, s0)
                    regressor_integrals(part, reg)
            j += 1
        turned = reg[4] * reg[4] + reg[5] * reg[5] + reg[6] * reg[6]
        counts[6] = where_at_most(turned, counts[6], counts[6], turned)
        if log.plan[k] == RECORD:
            note(r, truth, start.nav, dx_f, state, true, process, wander, clock[r], sky.clock_at, work, records)
            r += 1
        earlier, before, now = before, now, earlier
        h2, h1 = h1, h


def prepare_lanes() -> None:
    """Compile or load :func:`run_lanes` before it is timed or run."""
    import numba as nb

    x, i, yes = nb.float64, nb.int64, nb.boolean
    f, m, c = x[::1], x[:, ::1], x[:, :, ::1]
    k, km = i[::1], i[:, ::1]

    def of(cls, *types):
        return nb.types.NamedTuple(types, cls)

    types = (
        of(LaneLog, m, m, f, x, k),
        of(LaneFixes, f, k, m, m, m, m, m, f),
        of(LaneErrors, m, f, m, m, m, nb.uint64[:, ::1], yes),
        of(LaneSky, m, c, k),
        of(LaneState, m, m, c),
        of(LaneModel, km, i, k, m, f, x, i, i, yes, yes, yes),
        of(LaneTruth, m, m, km),
        m,
        of(LaneRecordArrays, c, c, c, m),
    )
    prepare([(run_lanes, types)])
