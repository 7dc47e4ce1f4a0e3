"""Compiled error-state filter around the Earth-fixed mechanization: propagate, update, record.

One function, :func:`run_filter`, serves the batch run, the live navigator (one epoch at a time) and Monte Carlo runs
in threads. Its arguments are tuples of arrays by what they are (:mod:`schuler.filtering.filter_arrays`).
"""

from __future__ import annotations

import functools
import math

from schuler.filtering.filter_arrays import (
    Aiding,
    FilterArrays,
    ImuStream,
    Model,
    NodeArrays,
    RecordArrays,
    Settings,
    TrajectoryArrays,
    Workspace,
)
from schuler.filtering.kernels.accumulation import parameter_columns, regressor_integrals, store_interval
from schuler.filtering.kernels.axes import TURNED, turn_axes
from schuler.filtering.kernels.covariance import add_clock_drift, add_half_noise, decay, flush
from schuler.filtering.kernels.gate import ACCEPTED, FORCED, GATED, R_SCALE, REJECTED, judge
from schuler.filtering.kernels.sensor_errors import compensate, spread_estimates
from schuler.filtering.kernels.update import (
    ARC_START,
    AT_AMBIGUITY,
    AT_CLOCK,
    BEGUN,
    CARRIER_PHASE,
    LATERAL,
    RESET_POSITION,
    RESET_VELOCITY,
    SPEED,
    begin_arc,
    correct,
    innovate,
    measurement_rows,
    ned_axes,
    reset,
)
from schuler.jit import apart, borrowing, compile_parts, inlined, prepare, prepare_beside
from schuler.mechanization.kernels import advance_ecef, cut_interval, fit_interval

# Running counts: intervals and samples since the last propagation, measurements, records, nodes, updates, outputs,
# epochs, propagations.
CNT_PAST, CNT_SINCE, CNT_MEAS, CNT_REC, CNT_NODE, CNT_UPD, CNT_OUT, CNT_EPOCH, CNT_FLUSH, N_CNT = range(10)


SAME_TIME_S = 1e-6  # between the last phase of a channel and the one before of its arc


@inlined
def pack(P, out):
    """Lower triangle row by row."""
    o = 0
    for i in range(P.shape[0]):
        p = P[i]
        for j in range(i + 1):
            out[o + j] = p[j]
        o += i + 1


@inlined
def keep_node(P, nav, acc, B, t, cnt, nodes):
    """Store what the smoother needs of one propagation: its time, the predicted covariance and the transition."""
    i = cnt[CNT_NODE]
    if i >= nodes.t.shape[0]:  # a filter that turns about in estimates gone wild; the caller sees it by the counts
        return
    nodes.t[i] = t
    pack(P, nodes.P[i])
    for a in range(8):
        nodes.phi[i, a] = acc[a]
    for a in range(3):
        nodes.phi[i, 8 + a] = nav[7 + a]
    for k in range(B.shape[0]):
        for a in range(9):
            nodes.B[i, a, k] = B[k, a]
    nodes.upd[i] = cnt[CNT_UPD]
    cnt[CNT_NODE] = i + 1


@inlined
def keep_update(W, G, e, d, cnt, nodes):
    """Store what the smoother needs of one update."""
    u = cnt[CNT_UPD]
    for a in range(3):
        w, g = nodes.W[u, a], nodes.G[u, a]
        for i in range(w.shape[0]):
            w[i] = W[a, i] if a < d else 0.0
            g[i] = G[a, i] if a < d else 0.0
        nodes.e[u, a] = e[a] if a < d else 0.0
    cnt[CNT_UPD] = u + 1
    nodes.upd[cnt[CNT_NODE] - 1] = u + 1


@inlined
def propagate(state, model, work, noise, t, nodes):
    """Carry the covariance to the present with its process noise; keep the transition for the smoother.

    Estimates move as their models say: Gauss-Markov states decay, a clock offset grows by its drift.
    """
    P, nav, acc, cnt, D = state.P, state.nav, state.acc, state.counts, work.left
    m, n_sensor, T = P.shape[0] - 9, model.n_sensor, acc[0]
    if n_sensor > 0:
        parameter_columns(
            state.past, cnt[CNT_PAST], acc, state.moment, state.sens, model.table, n_sensor, model.response,
            model.cross, work.N, work.sums, work.B,
        )  # fmt: skip
    decays = decay(state.dynamics, T, D, work.mean)
    add_half_noise(P, nav, T, noise, state.dynamics)
    flush(
        P, nav, acc, work.A, work.B, work.rows, work.turned, D, work.mean, model.on_attitude, n_sensor, decays,
        model.omega,
    )  # fmt: skip
    if decays:
        for k in range(m):
            if D[k] != 1.0:
                state.est[k] *= D[k]
        spread_estimates(state.est, model.table, n_sensor, work.M, state.sens)
    i_clock = model.places[AT_CLOCK]
    if i_clock >= 0:
        state.est[i_clock - 9] += T * state.est[i_clock - 8]
    add_clock_drift(P, i_clock, T)
    add_half_noise(P, nav, T, noise, state.dynamics)
    if nodes.t.shape[0] > 0:
        keep_node(P, nav, acc, work.B, t, cnt, nodes)
    for i in range(8):
        acc[i] = 0.0
    for i in range(3):
        state.moment[i] = 0.0
    cnt[CNT_PAST] = cnt[CNT_SINCE] = 0
    cnt[CNT_FLUSH] += 1


@inlined
def widen_noise(psd, settings, h, noise):
    """Noise densities over a pause: rates are unknown by a constant, as white noise of the same effect."""
    for i in range(3):
        noise[i] = psd[i] + settings.gap_gyro * settings.gap_gyro * h
        noise[3 + i] = psd[3 + i] + settings.gap_accel * settings.gap_accel * h


@apart
def keep_enlarged(P, nav, acc, B, t, cnt, nodes):
    """Store a covariance that was enlarged at a propagation: a node of its own, no time later and without a transition.

    To the smoother it is process noise.
    """
    for k in range(B.shape[0]):
        for a in range(9):
            B[k, a] = 0.0
    keep_node(P, nav, acc, B, t, cnt, nodes)
    cnt[CNT_FLUSH] += 1


@inlined
def keep_before(state):
    """Keep attitude and parameters before the first update of a time."""
    before, nav, est = state.before, state.nav, state.est
    if before[0] == 0.0:
        before[0] = 1.0
        for i in range(4):
            before[1 + i] = nav[i]
        for i in range(est.shape[0]):
            before[5 + i] = est[i]


@apart
def turn(state, model, work, t, nodes):
    """Carry the covariance to the axes of corrected estimates; to the smoother it is a node of its own."""
    before, nav, est = state.before, state.nav, state.est
    before[0] = 0.0
    turned = False
    for i in range(4):
        turned = turned or before[1 + i] != nav[i]
    for i in range(est.shape[0]):
        turned = turned or before[5 + i] != est[i]
    if not turned:  # a filter without uncertainty, from which rows of H are taken
        return
    ned_axes(nav, work.U)
    turn_axes(
        state.P, nav, est, before[1:5], before[5:], work.U[2], model.table, model.n_sensor, state.sens, work.M,
        work.sums[0], work.B, work.W,
    )  # fmt: skip
    if nodes.t.shape[0] > 0:
        state.acc[0] = TURNED
        keep_node(state.P, nav, state.acc, work.B, t, state.counts, nodes)
        state.acc[0] = 0.0
        state.counts[CNT_FLUSH] += 1


@apart
def start_arc(j, channel, aiding, state, model, work, nodes):
    """Begin an arc with carrier phase ``j``, whose row is in ``work``; to the smoother it is a node of its own.

    In place of the node's sums stands the ambiguity's place, in place of its first update the row of the transition.
    """
    i, cnt = model.places[AT_AMBIGUITY] + channel - 1, state.counts
    begin_arc(state.P, state.est, i, aiding.R[j, 0], work.H, work.y, work.G, work.W)
    state.arcs[channel - 1] = aiding.t[j]
    if nodes.t.shape[0] > 0:
        state.acc[0], state.acc[1] = BEGUN, i
        keep_enlarged(state.P, state.nav, state.acc, work.B, aiding.t[j], cnt, nodes)
        state.acc[0] = state.acc[1] = 0.0
        keep_update(work.W, work.G, work.e, 1, cnt, nodes)


@inlined
def update(j, aiding, state, model, settings, work, nodes):
    """Correct the state by measurement ``j``; returns what became of it."""
    nav, est, P, sens, cnt = state.nav, state.est, state.P, state.sens, state.counts
    kind, z, R = aiding.kind[j], aiding.z[j], work.R
    slow = nav[4] * nav[4] + nav[5] * nav[5] + nav[6] * nav[6] < z[7] * z[7]
    if aiding.gate[j] < 0.0 or (slow and LATERAL <= kind <= SPEED):
        return GATED
    H, y, W, G, e, S, U = work.H, work.y, work.W, work.G, work.e, work.S, work.U
    d = measurement_rows(
        kind, z, aiding.lever[j], nav, est, work.reg, sens, model.table, model.n_sensor, model.places, model.omega,
        H, y, U,
    )  # fmt: skip
    channel = int(z[4]) if kind in (CARRIER_PHASE, ARC_START) else 0
    if channel > 0 and not (kind == CARRIER_PHASE and abs(state.arcs[channel - 1] - z[5]) < SAME_TIME_S):
        start_arc(j, channel, aiding, state, model, work, nodes)  # or the phase before was not there: an outage
        return ACCEPTED if kind == ARC_START else GATED
    for i in range(d):
        aiding.innovation[j, i] = -y[i]
    if kind in (RESET_POSITION, RESET_VELOCITY):
        reset(kind, aiding.R[j], P, nav, y, U)
        return ACCEPTED
    for i in range(9):
        R[i] = state.gates[kind, R_SCALE] * aiding.R[j, i]
    nis = innovate(P, H, y, R, d, W, G, e, S, work.L)
    aiding.nis[j] = nis
    for i in range(d):
        aiding.variance[j, i] = S[i, i]
    status = judge(kind, aiding.t[j], nis, d, aiding.gate[j], R, settings, state, model, work)
    if status == FORCED and nodes.t.shape[0] > 0:
        keep_enlarged(P, nav, state.acc, work.B, aiding.t[j], cnt, nodes)
    if channel > 0:
        state.arcs[channel - 1] = aiding.t[j]
        if status == REJECTED:  # a slip: the next phase is tested against this one
            start_arc(j, channel, aiding, state, model, work, nodes)
    if status != REJECTED:
        if model.free_axes:
            keep_before(state)
        correct(P, nav, est, W, e, d, work.dx)
        spread_estimates(est, model.table, model.n_sensor, work.M, sens)
        if nodes.t.shape[0] > 0:
            keep_update(W, G, e, d, cnt, nodes)
    return status


@inlined
def record_state(state, t, settings, records):
    """Record state and covariance, and set the time of the next record."""
    cnt = state.counts
    r = cnt[CNT_REC]
    if r < records.t.shape[0]:
        records.t[r] = t
        for i in range(10):
            records.nav[r, i] = state.nav[i]
        for i in range(state.est.shape[0]):
            records.est[r, i] = state.est[i]
        pack(state.P, records.P[r])
        cnt[CNT_REC] = r + 1
    while state.times[1] <= t + 1e-9:
        state.times[1] += settings.record_s


@borrowing
def run_filter(stream, aiding, state, model, settings, work, trajectory, records, nodes):
    """Filter a stretch of IMU samples with the measurements that fall into it.

    ``state`` carries everything to the next call: counts of what is written, and of measurements worked off, too.
    """
    nav, sens, acc, cnt, past = state.nav, state.sens, state.acc, state.counts, state.past
    omega, response, reg = model.omega, model.response, work.reg
    raw, poly, part = work.poly[0], work.poly[1], work.poly[2]
    now, before, earlier = work.increments[0], work.increments[1], work.increments[2]
    for i in range(6):
        before[i] = state.history[i]
        earlier[i] = state.history[6 + i]
    h1, h2 = state.history[12], state.history[13]
    n_meas = aiding.t.shape[0]
    last = stream.dt.shape[0] - 1 if stream.ends else -1
    if nodes.t.shape[0] > 0 and cnt[CNT_NODE] == 0:  # the smoother's first node is the start itself
        for i in range(work.B.shape[0]):
            for a in range(9):
                work.B[i, a] = 0.0
        keep_node(state.P, nav, acc, work.B, stream.t[0] - stream.dt[0], cnt, nodes)
    for k in range(stream.dt.shape[0]):
        h, t = stream.dt[k], stream.t[k]
        gap = h > settings.gap_s
        for i in range(3):
            now[i] = stream.dtheta[k, i]
            now[3 + i] = stream.dv[k, i]
        fit_interval(raw, now, before, earlier, h, h1, h2)
        compensate(poly, raw, sens, h, response)
        due = records.t.shape[0] > 0 and (t >= state.times[1] - 1e-9 or k == last)
        noise = state.psd
        s0, sa = 0.0, 0.0  # where in the interval the state is, and where its last piece began
        j = cnt[CNT_MEAS]
        pausing = gap  # first, what was before a pause is propagated with the noise it had
        while (
            True
        ):  # one pass, one call of `propagate`: inlined in three places it takes three times as long to compile
            measured = not pausing and j < n_meas and aiding.t[j] <= t + 1e-9
            to = t - h if pausing else t
            s1 = 0.0 if pausing else 1.0
            if measured:
                to = aiding.t[j]
                s1 = 1.0 - (t - to) / h
                if s1 > 1.0 - 1e-6:
                    s1 = 1.0
            if s1 > s0:
                if state.before[0] != 0.0:
                    turn(state, model, work, state.times[0] if s0 == 0.0 else aiding.t[j - 1], nodes)
                piece = poly
                if s0 > 0.0 or s1 < 1.0:
                    cut_interval(part, poly, s0, s1)
                    piece = part
                hp = (s1 - s0) * h
                fx, fy, fz = advance_ecef(nav, piece, hp, omega)
                store_interval(past, cnt[CNT_PAST], acc, state.moment, nav, fx, fy, fz, piece, hp, reg)
                acc[1] += math.sqrt(reg[4] * reg[4] + reg[5] * reg[5] + reg[6] * reg[6])
                cnt[CNT_PAST] += 1
                sa, s0 = s0, s1
            wanted = pausing or measured
            if not wanted:
                if acc[0] > 0.0:
                    cnt[CNT_SINCE] += 1
                wanted = cnt[CNT_SINCE] >= settings.every or acc[1] > settings.flush_angle or due or gap or k == last
            if wanted and acc[0] > 0.0:
                propagate(state, model, work, noise, to, nodes)
            if pausing:
                compensate(poly, raw, sens, h, response)  # estimates decay
                widen_noise(state.psd, settings, h, work.noise)
                noise, pausing = work.noise, False
                continue
            if not measured:
                break
            status = update(j, aiding, state, model, settings, work, nodes)
            if status in (ACCEPTED, FORCED):
                compensate(poly, raw, sens, h, response)
                if s0 > sa:  # the next measurement of this time sees the corrected rate, not the one before
                    cut_interval(part, poly, sa, s0)
                    regressor_integrals(part, reg)
            aiding.status[j] = status
            j += 1
            cnt[CNT_MEAS] = j
        if due:
            record_state(state, t, settings, records)
        if trajectory.t.shape[0] > 0 and cnt[CNT_EPOCH] % settings.output_every == 0:
            o = cnt[CNT_OUT]
            trajectory.t[o] = t
            q, v, r = trajectory.q[o], trajectory.v[o], trajectory.r[o]
            for i in range(3):
                q[i], v[i], r[i] = nav[i], nav[4 + i], nav[7 + i]
            q[3] = nav[3]
            cnt[CNT_OUT] = o + 1
        cnt[CNT_EPOCH] += 1
        earlier, before, now = before, now, earlier
        h2, h1 = h1, h
        state.times[0] = t
    for i in range(6):
        state.history[i] = before[i]
        state.history[6 + i] = earlier[i]
    state.history[12], state.history[13] = h1, h2
    return 0


def prepare_filter() -> None:
    """Compile or load :func:`run_filter` before it is timed or run."""
    import numba as nb

    f, c, km = nb.float64[::1], nb.float64[:, :, ::1], nb.int64[:, ::1]
    prepare(
        [(run_filter, _argument_types()), (spread_estimates, (f, km, nb.int64, c, f))],
        beside="schuler.filtering.kernels.run:prepare_parts_and_smoother",
        parts=_parts(),
    )


def prepare_parts_and_smoother() -> None:
    """Compile what another process that prepares the filter wants: helpers of the filter first, then the smoother."""
    from schuler.filtering.kernels.smoother import prepare_smoother

    compile_parts(_parts())
    prepare_smoother()


@functools.cache
def _parts():
    """Helpers that are a third of the filter's compilation, and their types, in the order in which it comes to them."""
    import numba as nb

    x, i = nb.float64, nb.int64
    f, m, k, km = x[::1], x[:, ::1], i[::1], i[:, ::1]
    _, aiding, state, model, settings, work, _, _, nodes = _argument_types()
    return [
        (measurement_rows, (i, f, f, f, f, f, f, km, i, k, x, m, f, m)),
        (start_arc, (i, i, aiding, state, model, work, nodes)),
        (innovate, (m, m, f, f, i, m, m, f, m, m)),
        (judge, (i, x, x, i, x, f, settings, state, model, work)),
    ]


@functools.cache
def _argument_types():
    """Numba types of the arguments of :func:`run_filter`."""
    import numba as nb

    x, i, yes = nb.float64, nb.int64, nb.boolean
    f, m, c = x[::1], x[:, ::1], x[:, :, ::1]
    k, km = i[::1], i[:, ::1]

    def of(cls, *types):
        return nb.types.NamedTuple(types, cls)

    return (
        of(ImuStream, m, m, f, f, yes),
        of(Aiding, f, k, m, m, m, f, k, f, m, m),
        of(FilterArrays, f, f, m, f, f, f, f, m, f, f, k, m, f, m, f),
        of(Model, km, m, k, k, f, f, i, yes, yes, yes, x),
        of(Settings, i, x, x, i, i, x, yes, x, x, x),
        of(Workspace, m, m, f, f, m, m, m, m, f, f, c, f, c, m, m, m, f, f, m, m, m, f, f),
        of(TrajectoryArrays, f, m, m, m),
        of(RecordArrays, f, m, m, m),
        of(NodeArrays, f, m, m, c, k, c, c, m),
    )


def compile_filter_beside() -> None:
    """Have :func:`run_filter` compiled while a log is simulated or read, unless it is on disk."""
    prepare_beside("schuler.filtering.kernels.run:prepare_filter", run_filter)
