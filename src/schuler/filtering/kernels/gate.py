"""Compiled innovation test: which fix is wrong, and when it is the filter that is.

A fix beyond the gate is rejected. What the rejected fixes of a kind say among themselves tells who is wrong:

- after a pause of all fixes, innovations that an inertial drift could have made (``DRIFT`` times the variance that is
  claimed) and that agree with each other: the filter. The second one is taken.
- innovations that grow, or that are hardly beyond the gate, while no velocity contradicts their drift: the filter.
- innovations that jump and stay: the receiver, held off until the filter's own covariance lets them in, or for as long
  as the filter has been right before (twice that, at most ``hold_s``).
- innovations that scatter against each other: the covariance that the receiver states.

Before a fix is taken against the gate the covariance grows to what the innovation shows: of navigation states and IMU
errors in proportion (a drift), or of position or velocity alone (a jump), so that no error is attributed to attitude
and biases that they cannot have made. Noise follows the innovations: where their mean normalised square, exponentially
forgotten, exceeds ``TOO_LARGE``, variances of the IMU's noise grow, or the fixes' where innovations alternate in sign
(Mehra 1970: a gain too high leaves negatively correlated innovations, one too low positively). Well-modelled runs
(chi-square innovations, single outliers) never reach any of this.

Memory ``gates[kind]`` by the indices below; ``gates[0]`` is the filter's own.
"""

from __future__ import annotations

import math

from schuler.filtering.kernels.update import CARRIER_PHASE, POSITION, PSEUDORANGE, RANGE_RATE, VELOCITY, innovate
from schuler.jit import apart, borrowing, inlined

# What became of a measurement.
ACCEPTED = 1
REJECTED = 2
FORCED = 3  # beyond the gate, taken with a covariance enlarged for it
GATED = 4  # a condition of the measurement was not met

# The filter's own memory: factor on the variance of the IMU's noise, its largest so far, time of the last readmission.
SCALE, LARGEST, SINCE = range(3)
# Memory of a kind: rejections in a row (kinds other than fixes: less acceptances), times of the last used, first
# rejected and last rejected, whether the innovations may be the drift of an outage, first normalised innovation;
# differences of successive rejected innovations: count, sum of normalised squares, sum of products of neighbours;
# forgotten means of the normalised innovation squared and of the product with the one before, whether that was used;
# factor on the fixes' variance and its largest so far, 1-sigma of the last fix.
(
    COUNT, USED_AT, FIRST_AT, LAST_AT, DRIFTED, FIRST_NIS, STEPS, STEP_NIS, STEP_PRODUCT, MEAN_NIS, LAGGED,
    AFTER_UPDATE, R_SCALE, R_LARGEST, SIGMA,
) = range(15)  # fmt: skip
# Vectors: first and last rejected innovation, their last difference, last whitened innovation.
FIRST, LAST, STEP, WHITE, N_GATE = 15, 18, 21, 24, 27

DRIFT = 400.0  # variance of an outage's drift over what the filter claims: its noise may be stated 20 times too small
PAUSE_S = 3.0  # without a fix for so long, inertial drift counts [s]
ROUGH = 4.0  # mean normalised square from which differences of innovations do not come from the stated noise
GROWN = 2.5  # an innovation so many times the first one is growing
SLIGHT = 2.0  # times the gate: hardly beyond it
TRUST = 2.0  # a jump is held off for so many times the time since the last readmission
EXCLUDES = 4.0  # 1-sigma of velocity by which it excludes a drift of positions
FORGET = 0.05  # share of a new innovation in their mean
TOO_LARGE, SMALL = 2.0, 0.9  # normalised innovation squared: noise grows, noise shrinks again
ALTERNATING = -0.1  # product of neighbours over the square: the fixes are noisier than they say
GROWTH, MOST_GROWTH, SHRINK = 4.0, 16.0, 0.98
MOST_NOISE, MOST_R = 1e3, 1e6


@inlined
def dot(a, i, b, j, R):
    """Product of two innovations from ``i`` and ``j`` on, each component by its variance in a fix."""
    return a[i] * b[j] / R[0] + a[i + 1] * b[j + 1] / R[4] + a[i + 2] * b[j + 2] / R[8]


@borrowing
def start_gates(gates, t):
    """Memory of a filter that starts at ``t``: nothing seen, noise as stated."""
    for kind in range(gates.shape[0]):
        for i in range(N_GATE):
            gates[kind, i] = 0.0
        gates[kind, USED_AT] = gates[kind, FIRST_AT] = gates[kind, LAST_AT] = -math.inf
        gates[kind, MEAN_NIS] = gates[kind, R_SCALE] = gates[kind, R_LARGEST] = 1.0
        gates[kind, SIGMA] = math.inf
    gates[0, SCALE] = gates[0, LARGEST] = 1.0
    gates[0, SINCE] = t


@inlined
def scale_noise(factor, gates, model, psd, dynamics):
    """Multiply the variance of the IMU's noise, within 1 and ``MOST_NOISE``; the states of others keep theirs."""
    own = gates[0]
    own[SCALE] = min(max(own[SCALE] * factor, 1.0), MOST_NOISE)
    own[LARGEST] = max(own[LARGEST], own[SCALE])
    for i in range(6):
        psd[i] = own[SCALE] * model.psd[i]
    for k in range(model.n_sensor):
        dynamics[k, 1] = own[SCALE] * model.dynamics[k, 1]


@inlined
def scale_fixes(factor, row):
    """Multiply the variance of the fixes of a kind, within 1 and ``MOST_R``."""
    row[R_SCALE] = min(max(row[R_SCALE] * factor, 1.0), MOST_R)
    row[R_LARGEST] = max(row[R_LARGEST], row[R_SCALE])


@apart
def grow_noise(factor, row, state, model):
    """Enlarge the noise that innovations show to be too small: the fixes' where they alternate, or the IMU's."""
    if row[LAGGED] < ALTERNATING * row[MEAN_NIS] or state.gates[0, SCALE] >= MOST_NOISE:
        scale_fixes(GROWTH, row)
    else:
        scale_noise(min(max(factor, GROWTH), MOST_GROWTH), state.gates, model, state.psd, state.dynamics)


@borrowing
def follow(nis, shrunk, e, row, state, model):
    """Take an innovation into the forgotten means, and let the noise follow them; ``shrunk`` is a factor on ``e``."""
    product = 0.0
    for i in range(3):
        product += shrunk * e[i] * row[WHITE + i]
        row[WHITE + i] = shrunk * e[i]
    if row[AFTER_UPDATE] > 0.0:
        row[LAGGED] += FORGET * (product / 3.0 - row[LAGGED])
    row[MEAN_NIS] += FORGET * (nis / 3.0 - row[MEAN_NIS])
    if row[MEAN_NIS] > TOO_LARGE:
        grow_noise(GROWTH, row, state, model)
        row[MEAN_NIS], row[LAGGED] = 1.0, 0.0
    elif row[MEAN_NIS] < SMALL:
        if row[R_SCALE] > 1.0:
            scale_fixes(SHRINK, row)
        if state.gates[0, SCALE] > 1.0:
            scale_noise(SHRINK, state.gates, model, state.psd, state.dynamics)


@borrowing
def enlarge_in_proportion(factor, n, P):
    """Covariance of navigation states and IMU errors (the first ``n``) times a factor: a drift of unknown origin."""
    for i in range(n):
        for j in range(n):
            P[i, j] *= factor


@borrowing
def enlarge_within(factor, P, most, g):
    """The same for satellites, with the receiver's clocks, and no variance beyond ``most``.

    A clock that moves otherwise than stated makes all satellites contradict at once: if it alone kept its variance, all
    of that went into velocity and attitude. Satellites are taken one by one, each with a factor, and what one of them
    does not show would grow without end. ``P + g P g``: what is added is a covariance. ``g`` is workspace.
    """
    n = P.shape[0]
    for i in range(n):
        g[i] = math.sqrt(max(min(factor * P[i, i], most[i]) - P[i, i], 0.0) / P[i, i]) if P[i, i] > 0.0 else 0.0
    for i in range(n):
        if g[i] > 0.0:
            for j in range(n):
                P[i, j] *= 1.0 + g[i] * g[j]


@borrowing
def enlarge_alone(kind, y, velocity, U, P):
    """Covariance of position or velocity larger by an innovation squared, horizontal and vertical: a jump.

    With a position, velocity grows by the square of ``velocity``.
    """
    first = 6 if kind == POSITION else 3
    h, v = y[0] * y[0] + y[1] * y[1], y[2] * y[2]
    for i in range(3):
        for j in range(3):
            P[first + i, first + j] += h * (U[0, i] * U[0, j] + U[1, i] * U[1, j]) + v * U[2, i] * U[2, j]
        if kind == POSITION:
            P[3 + i, 3 + i] += velocity * velocity


@inlined
def taken(t, row, e):
    """Memory after a fix that was used."""
    row[COUNT], row[USED_AT], row[AFTER_UPDATE] = 0.0, t, 1.0
    for i in range(3):
        row[WHITE + i] = e[i]


@apart
def repeated(state, work, R, d):
    """Innovation against the covariance as it is now."""
    return innovate(state.P, work.H, work.y, R, d, work.W, work.G, work.e, work.S, work.L)


@apart
def readmit(kind, t, nis, gate, coast, R, state, model, work):
    """Take a fix that a drift of the filter over ``coast`` seconds keeps beyond the gate."""
    y = work.y
    enlarge_in_proportion(min(max(nis / 3.0, 1.0), DRIFT), 9 + model.n_sensor, state.P)
    if repeated(state, work, R, 3) > gate:
        enlarge_alone(kind, y, 2.0 * math.sqrt(y[0] * y[0] + y[1] * y[1] + y[2] * y[2]) / coast, work.U, state.P)
        repeated(state, work, R, 3)
    state.gates[0, SINCE] = t
    taken(t, state.gates[kind], work.e)
    return FORCED


@apart
def jump(kind, t, velocity, R, state, work):
    """Take a fix from which the filter is away by a jump."""
    enlarge_alone(kind, work.y, velocity, work.U, state.P)
    repeated(state, work, R, 3)
    state.gates[0, SINCE] = t
    taken(t, state.gates[kind], work.e)
    return FORCED


@borrowing
def remember(kind, t, nis, gate, other, row, R, state, work):
    """Memory of a fix beyond the gate: how innovations have moved since the first."""
    y, S = work.y, work.S
    if row[COUNT] == 0.0:
        used = row[USED_AT] if other[USED_AT] == t else max(row[USED_AT], other[USED_AT])
        inside = 0.0
        for i in range(3):
            row[FIRST + i], row[STEP + i] = y[i], 0.0
            inside += y[i] * y[i] / (R[4 * i] + DRIFT * (S[i, i] - R[4 * i]))
        row[DRIFTED] = 1.0 if t - used >= PAUSE_S and inside <= gate else 0.0
        row[FIRST_AT], row[FIRST_NIS] = t, nis
        row[STEPS] = row[STEP_NIS] = row[STEP_PRODUCT] = 0.0
    else:
        dt, v, before = t - row[LAST_AT], 0.0, 0.0
        if kind == POSITION:
            v = 4.0 * (state.P[3, 3] + state.P[4, 4] + state.P[5, 5]) / 3.0 * dt * dt
        for i in range(3):
            step = y[i] - row[LAST + i]
            row[STEP_NIS] += step * step / (3.0 * (2.0 * R[4 * i] + v))
            before += step * row[STEP + i] / R[4 * i]
            row[STEP + i] = step
        row[STEP_PRODUCT] += before
        row[STEPS] += 1.0
    row[COUNT] += 1.0
    row[LAST_AT] = t


@apart
def judge_rejected(kind, t, nis, gate, R, settings, state, model, work):
    """What becomes of a position or velocity beyond the gate."""
    gates, y = state.gates, work.y
    row, other = gates[kind], gates[VELOCITY if kind == POSITION else POSITION]
    dt = t - row[LAST_AT]
    last = dot(y, 0, row, LAST, R)
    last_squared = dot(row, LAST, row, LAST, R)
    remember(kind, t, nis, gate, other, row, R, state, work)
    for i in range(3):
        row[LAST + i] = y[i]
    n = row[COUNT]
    if settings.adaptive and n <= 3.0:
        limited = min(nis, gate)
        follow(limited, math.sqrt(limited / nis), work.e, row, state, model)
    row[AFTER_UPDATE] = 0.0
    if n < 2.0:
        return REJECTED
    rough = row[STEP_NIS] / row[STEPS]
    smooth = rough <= ROUGH
    if n >= 4.0 and not smooth and row[STEP_PRODUCT] < 0.0 and settings.adaptive:
        before = row[R_SCALE]
        scale_fixes(rough, row)
        for i in range(9):
            R[i] *= row[R_SCALE] / before
        row[COUNT] = 0.0
        if repeated(state, work, R, 3) > gate:
            return REJECTED
        taken(t, row, work.e)
        return ACCEPTED
    if row[DRIFTED] > 0.0 and (smooth or n >= 4.0):
        return readmit(kind, t, nis, gate, t - row[USED_AT], R, state, model, work)
    squared, first_squared = dot(y, 0, y, 0, R), dot(row, FIRST, row, FIRST, R)
    rate = 0.0
    for i in range(3):
        rate += (y[i] - row[FIRST + i]) * (y[i] - row[FIRST + i])
    rate = math.sqrt(rate) / max(t - row[FIRST_AT], 1e-3)
    agrees = other[USED_AT] >= row[FIRST_AT] and other[COUNT] == 0.0
    agrees = agrees and (kind == VELOCITY or rate > EXCLUDES * other[SIGMA])
    along = last > 0.8 * math.sqrt(squared * last_squared)
    grows = n >= 3.0 and along and min(squared, last_squared) > GROWN * GROWN * first_squared
    drifts = n >= 4.0 and ((not smooth and row[STEP_PRODUCT] >= 0.0) or row[FIRST_NIS] <= SLIGHT * gate)
    if (grows or drifts) and not agrees:
        if settings.adaptive:
            grow_noise(nis / 3.0, row, state, model)
        return readmit(kind, t, nis, gate, t - row[USED_AT], R, state, model, work)
    if n >= 3.0 and smooth and other[COUNT] >= 3.0 and other[STEP_NIS] <= ROUGH * other[STEPS]:
        return readmit(kind, t, nis, gate, t - row[USED_AT], R, state, model, work)
    hold = min(settings.hold_s, TRUST * (row[FIRST_AT] - gates[0, SINCE]))
    if (n >= 4.0 or (n >= 3.0 and smooth)) and t - row[FIRST_AT] >= hold:
        moved = math.sqrt(row[STEP] * row[STEP] + row[STEP + 1] * row[STEP + 1] + row[STEP + 2] * row[STEP + 2])
        return jump(kind, t, moved / max(dt, 1e-3), R, state, work)
    return REJECTED


@borrowing
def judge_fix(kind, t, nis, gate, R, settings, state, model, work):
    """What becomes of a position or velocity."""
    row = state.gates[kind]
    row[SIGMA] = math.sqrt((R[0] + R[4] + R[8]) / 3.0)
    if nis > gate:
        return judge_rejected(kind, t, nis, gate, R, settings, state, model, work)
    if row[COUNT] >= 3.0 and nis > 6.0:  # the gate has opened to a fault or a drift
        return jump(kind, t, 0.0, R, state, work)
    if settings.adaptive:
        follow(nis, 1.0, work.e, row, state, model)
    taken(t, row, work.e)
    return ACCEPTED


@borrowing
def judge(kind, t, nis, d, gate, R, settings, state, model, work):
    """What becomes of a measurement by its normalised innovation; the covariance is enlarged for one that is forced in.

    ``R`` may be changed. Single numbers (ranges, wheels, rest) are counted: after ``lockout`` rejections less
    acceptances one is taken, one of an epoch, since one good satellite does not make up for several that are rejected.
    """
    if nis < 0.0 or not math.isfinite(nis):
        return REJECTED
    if settings.lockout == 0 or gate == math.inf:
        return REJECTED if nis > gate else ACCEPTED
    if kind in (POSITION, VELOCITY):
        return judge_fix(kind, t, nis, gate, R, settings, state, model, work)
    row = state.gates[kind]
    if nis <= gate:
        row[COUNT] = max(row[COUNT] - 1.0, 0.0)
        return ACCEPTED
    row[COUNT] = min(row[COUNT], settings.lockout) + 1.0
    if row[COUNT] <= settings.lockout or row[LAST_AT] == t:
        return REJECTED
    row[LAST_AT] = t
    row[COUNT] = 0.0 if d == 3 else row[COUNT] - 1.0
    if kind in (PSEUDORANGE, RANGE_RATE, CARRIER_PHASE):
        enlarge_within(min(nis / d, DRIFT), state.P, model.most, work.dx)
        repeated(state, work, R, d)
    return FORCED
