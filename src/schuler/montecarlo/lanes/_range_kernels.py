"""Updates by single satellites of several runs in lock-step: codes, range rates, carrier phases.

Rows of H are the engine's own text (``_shared_kernels``). A row is zero but for navigation states and a few parameters,
which are the same in all runs. Where a measurement fails its gate in some lanes its gain is zero there; a carrier phase
that fails begins its arc anew in these lanes. There is no branch on the value of a lane. As everywhere in lanes,
columns of parameters in the rows of the navigation states are not kept, see ``_kernels.flush``.
"""
# mypy: disallow-untyped-defs=False, disallow-incomplete-defs=False
# mypy: disallow-untyped-calls=False, check-untyped-defs=False

from __future__ import annotations

import math

from schuler.filtering.kernels.run import SAME_TIME_S
from schuler.filtering.kernels.update import (
    ARC_START,
    AT_AMBIGUITY,
    AT_CLOCK,
    CARRIER_PHASE,
    PSEUDORANGE,
    RANGE_RATE,
)
from schuler.filtering.kernels.vector import where_at_most
from schuler.jit import inlined, kernel
from schuler.montecarlo.lanes._shared_kernels import (
    carrier_phase_row,
    pseudorange_row,
    range_rate_row,
    spread_estimates,
)
from schuler.montecarlo.lanes._update_kernels import BIG, feed_back

OF_RANGES = 10  # first of the counts: three of codes, of range rates, of phases


@inlined
def satellite_row(kind, z, lever, state, model, on_psi, work, used):
    """Row of H and predicted minus true measurement; ``used`` receives the parameters in the row, returns how many.

    The ambiguity of a carrier phase is the last of them.
    """
    nav, est = state.nav, state.est
    H, y, at = work.row, work.y, model.places
    for i in range(H.shape[1]):
        H[0, i] = 0.0
    count = 0
    if kind == RANGE_RATE:
        range_rate_row(
            z, lever, nav, est, work.reg, work.sens, model.table, model.n_sensor, at, model.omega, H, y
        )  # fmt: skip
        used[0] = at[AT_CLOCK] + 1
        count = 1
        if lever[0] != 0.0 or lever[1] != 0.0 or lever[2] != 0.0:
            for k in on_psi:
                used[count] = 9 + k
                count += 1
    elif kind == PSEUDORANGE:
        pseudorange_row(z, lever, nav, est, at, model.omega, H, y)
        used[0] = at[AT_CLOCK]
        count = 1
        group = int(z[4])
        if 0 < group < 4 and at[AT_CLOCK + group] >= 0:
            used[1] = at[AT_CLOCK + group]
            count = 2
    else:
        carrier_phase_row(z, lever, nav, est, at, model.omega, H, y)
        used[0], used[1] = at[AT_CLOCK], at[AT_AMBIGUITY] + int(z[4]) - 1
        count = 2
    return count


@inlined
def covariance_row(P, h, used, count, with_velocity, w):
    """``w = P h`` for a row that is zero but for navigation states and some parameters; returns ``h . w``."""
    n = P.shape[0]
    for j in range(n):
        p = P[j]
        v = h[0] * p[0] + h[1] * p[1] + h[2] * p[2] + h[6] * p[6] + h[7] * p[7] + h[8] * p[8]
        if with_velocity:
            v += h[3] * p[3] + h[4] * p[4] + h[5] * p[5]
        w[j] = v
    for i in range(count):
        x, p = h[used[i]], P[used[i]]
        for j in range(n):
            w[j] += x * p[j]
    s = h[0] * w[0] + h[1] * w[1] + h[2] * w[2] + h[6] * w[6] + h[7] * w[7] + h[8] * w[8]
    if with_velocity:
        s += h[3] * w[3] + h[4] * w[4] + h[5] * w[5]
    for i in range(count):
        s += h[used[i]] * w[used[i]]
    return s


@kernel
def correct_by_one(P, nav, est, w, e, dx, nis, limit):
    """``P -= w w'`` and closed-loop feedback of ``dx = w e``, in the lanes where ``nis <= limit``."""
    n = P.shape[0]
    e = where_at_most(nis, limit, e, 0.0)
    for i in range(n):
        w[i] = where_at_most(nis, limit, w[i], 0.0)
    for i in range(n):
        x, p = w[i], P[i]
        dx[i] = x * e
        for j in range(n if i >= 9 else 9):
            p[j] -= x * w[j]
    feed_back(nav, est, dx)


@kernel
def begin_arc(P, est, i, R, h, y, used, count, w, nis, limit):
    """Begin the arc of ambiguity ``i``, the last of the used parameters, in the lanes where ``nis > limit`` or is NaN.

    As ``filtering.kernels.update.begin_arc``.
    """
    n = P.shape[0]
    v = R + covariance_row(P, h, used, count - 1, False, w)
    p = P[i]
    for j in range(n):
        p[j] = where_at_most(nis, limit, p[j], v if j == i else -w[j])
    for j in range(9, n):
        P[j, i] = p[j]
    est[i - 9] = where_at_most(nis, limit, est[i - 9], est[i - 9] - y)


@kernel
def take_satellite(j, fixes, error, state, model, on_psi, arcs, used, work, counts):
    """Update by measurement ``j`` of a satellite, to whose true value each lane adds an error of its own."""
    nav, est, P = state
    kind, z, R, h, w = fixes.kind[j], fixes.z[j], fixes.R[j, 0], work.row[0], work.w
    count = satellite_row(kind, z, fixes.lever[j], state, model, on_psi, work, used)
    work.y[0] -= error[j]
    y = work.y[0]
    channel = int(z[4]) if kind in (CARRIER_PHASE, ARC_START) else 0
    begins = False
    if channel > 0:
        begins = not (kind == CARRIER_PHASE and abs(arcs[channel - 1] - z[5]) < SAME_TIME_S)
        arcs[channel - 1] = fixes.t[j]
    if begins:
        begin_arc(P, est, used[count - 1], R, h, y, used, count, w, 0.0 * y + 1.0, 0.0 * y)
        return
    k = 1.0 / math.sqrt(R + covariance_row(P, h, used, count, kind == RANGE_RATE, w))
    e = y * k
    nis = e * e
    for i in range(P.shape[0]):
        w[i] *= k
    passes = min(fixes.gate[j], BIG)
    limit = nis * 0.0 + passes
    o = 0 if kind == PSEUDORANGE else 1 if kind == RANGE_RATE else 2
    lockout = float(model.lockout)
    if lockout > 0.0 and passes < BIG:  # where the engine would take it by force, the run is one for the engine
        row = work.range_locks[o]
        less = where_at_most(row, 1.0, 0.0, row - 1.0)
        work.range_locks[o] = where_at_most(nis, passes, less, where_at_most(row, lockout, row, lockout) + 1.0)
        counts[7] = where_at_most(work.range_locks[o], lockout, counts[7], 1.0)
    correct_by_one(P, nav, est, w, e, work.dx, nis, limit)
    if channel > 0:  # a slip: the next phase is tested against this one
        begin_arc(P, est, used[count - 1], R, h, y, used, count, w, nis, limit)
    accepted = where_at_most(nis, limit, 1.0, 0.0)
    o = OF_RANGES + 3 * o
    counts[o] += where_at_most(nis, BIG, nis, 0.0)
    counts[o + 1] += accepted
    counts[o + 2] += 1.0 - accepted
    spread_estimates(est, model.table, model.n_sensor, work.M, work.sens)
