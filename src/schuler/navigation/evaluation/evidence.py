"""Evidence on a navigation run from the run alone: what contradicts the uncertainty that it claims."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from schuler import units
from schuler.arrays import FloatArray
from schuler.filtering.kinds import kind_display
from schuler.filtering.measurements import (
    ACCEPTED,
    FIX,
    FORCED,
    GNSS_KINDS,
    KINDS,
    POSITION,
    PSEUDORANGE,
    RANGE_RATE,
    REJECTED,
    RESET_KINDS,
    VELOCITY,
    gate_threshold,
)
from schuler.filtering.states import BLOCK_TEXT
from schuler.navigation.evaluation.consistency import judged, matched_satellites
from schuler.navigation.inputs.gnss_faults import LARGER, SLOW_LEFT, UNAIDED_UNTESTED, UNAIDED_WRONG, enlargement
from schuler.navigation.inputs.imu_axes import AGAINST_COURSE
from schuler.navigation.inputs.imu_noise import NO_NOISE, NOISIER
from schuler.navigation.start.heading import HEADING_CONTRADICTED
from schuler.recording.io.checks import norms
from schuler.recording.io.possible import MAX_SPEED, RADII

if TYPE_CHECKING:
    from schuler.navigation.result import Innovations, NavigationResult

# Limits: chosen on simulated drives and planted wrecks, and, to tell what a run cured itself, on half of 140 recordings
# that were cut, thinned, turned and interrupted at random from those of the corpus. A limit of a test with a known
# distribution is far out in its tail, since it stands for what is not modelled, not for chance.
_REJECTED = (0.05, 0.5)  # share of tested GNSS measurements rejected
_NIS = (1.5625, 10.0)  # mean normalised innovation squared: sizes wrong by a quarter; threefold
_REJECTED_AID = 0.2  # the same of other aids, whose conditions are rough
# The same of means over ten and more: an error that stays. A receiver filters its velocities, and positions hold the
# solution beside them.
_SLOW = {POSITION: 3.0, VELOCITY: 8.0}
_SLOW_ELSE = 1.75
_LENGTHS = (10, 30, 100)  # innovations in such a mean
_TAIL = 0.99999  # of chi-square
_ENLARGED = 16.0  # factor on 1-sigma by which a run may have enlarged the noise of the IMU; half of the most
_ENLARGED_GNSS = 2.0  # the same of fixes, of which half of the solution is made
_AFTER_PAUSE = 4.0  # mean normalised square of the first fixes after pauses: errors are twice what is claimed
_HALVES = (6.0, 12.0, 20.0)  # difference of two estimates of one parameter, in sigmas of that difference
_SEARCHED_S = 0.3  # offset of stamps that is none too many for a search [s]
BUDGET = (5.0, 10.0)  # an estimate beyond so many of its sigmas stated beforehand
_IMPOSSIBLE = {"b_a": 1.0, "b_g": 0.1}  # biases that no unit has whose budget does not say so [m/s^2], [rad/s]
_HEADING_DEG = 25.0  # 1-sigma of the attitude beyond which errors are not small angles
_LOOKED_AT = 400  # covariances whose eigenvalues are computed, evenly over the run
_ROUNDING = 1e-6  # negative eigenvalue of a correlation matrix that rounding may make [-]
LEAST = 10  # fewer tested measurements of a kind convict nobody
#: Blocks whose models hold for the length of a run; clocks and pressure wander as they please.
_STEADY = ("b_a", "b_g", "S_a", "S_g", "M_a", "M_a6", "M_g", "G_g", "mount", "lever", "lever_v", "odometer", "delay")


class Finding(NamedTuple):
    """A piece of evidence: how grave (-1 only beside other evidence, 0 doubtful, 1 failed), sentence, key, size."""

    grave: int
    sentence: str
    key: str
    size: float = 1.0


def evidence(result: NavigationResult) -> list[Finding]:
    """What in a run contradicts its claims, the gravest first; see :func:`~.verdict.verdict`.

    Parameters
    ----------
    result : NavigationResult
    """
    if broken := [*_numbers(result)]:
        return broken
    findings = [*_rejections(result), *_sizes(result), *_pauses(result), *_budgets(result)]
    findings += [*_halves(result), *_attitude(result), *_claims(result)]
    # noise beyond the budget is cured where innovations have the size that the run, which enlarged it, predicts
    findings += [Finding(-1, note, "noise") for note in result.notes if note.startswith(NOISIER)]
    for note in result.notes:
        if note.startswith(LARGER):
            factor = enlargement(note)
            cured = factor <= (_ENLARGED_GNSS if "GNSS" in note else _ENLARGED)
            findings.append(Finding(-1 if cured else 0, note, "adapted", factor))
    findings += [Finding(0, note, "slow left") for note in result.notes if note.startswith(SLOW_LEFT)]
    findings += [Finding(0, note, "unaided") for note in result.notes if note.startswith(UNAIDED_WRONG)]
    findings += [Finding(0, note, "untested time") for note in result.notes if note.startswith(UNAIDED_UNTESTED)]
    findings += [Finding(0, note, "no noise") for note in result.notes if note.startswith(NO_NOISE)]
    findings += [Finding(0, n, "against course") for n in result.notes if n.startswith(AGAINST_COURSE)]
    findings += [Finding(0, n, "heading given") for n in result.notes if n.startswith(HEADING_CONTRADICTED)]
    # sensor errors that change are the filter's failure only where measurements are rejected too
    if not any(f.key.startswith("rejected") for f in findings):
        findings = [f._replace(grave=min(f.grave, 0)) if f.key.startswith("halves") else f for f in findings]
    return sorted(findings, key=lambda f: -f.grave)


def kind_text(code: int) -> str:
    """Name of a kind of measurement, for people."""
    return kind_display(KINDS[code]).text


def of_kind(inn: Innovations, code: int) -> Innovations:
    """Innovations of one kind."""
    return inn.where(inn.kind == code)


def _numbers(result: NavigationResult) -> Iterator[Finding]:
    """Solutions that are no numbers, and covariances that are none."""
    T = result.trajectory
    if not (np.isfinite(T.r_eb_e).all() and np.isfinite(T.q_eb).all()):
        yield Finding(1, "the solution holds values that are not numbers", "numbers")
    elif T.v_eb_e is not None and len(T.t):
        v, r = norms(T.v_eb_e), norms(T.r_eb_e)
        impossible = np.flatnonzero((v > MAX_SPEED) | (r > RADII[1]))
        if len(impossible):
            text = f"the solution reaches {v.max():.3g} m/s and {r.max():.3g} m from the Earth's centre, which nothing "
            yield Finding(1, f"{text}does, from {T.t[impossible[0]]:.1f} s on", "numbers")
    variances = np.einsum("kii->ki", result.covariance_e)
    bad = int(np.sum(~np.all(variances >= 0.0, axis=1)))
    if bad:
        yield Finding(1, f"variances are negative or unknown at {bad} of {len(result.t)} records", "numbers")
    elif some := _indefinite(result.filter_covariance_e()):
        yield Finding(1, f"covariances are not positive at {some[0]} of {some[1]} records looked at", "numbers")
    inn = result.innovations
    tested = np.isin(inn.status, (ACCEPTED, REJECTED, FORCED)) & ~np.isin(inn.kind, RESET_KINDS)  # which have no test
    wrong = tested & ~(inn.nis >= 0.0)
    if wrong.any():
        text = f"the normalised square of {int(wrong.sum())} innovations is negative or no number, the first at "
        yield Finding(1, f"{text}{inn.t[wrong][0]:.1f} s: the covariance broke down", "numbers")


def _indefinite(cov: FloatArray) -> tuple[int, int] | None:
    """How many of at most so many covariances have a negative eigenvalue beyond rounding; None if none has."""
    some = cov[np.unique(np.linspace(0, len(cov) - 1, min(len(cov), _LOOKED_AT)).astype(np.int64))]
    sigma = np.sqrt(np.einsum("kii->ki", some))
    scale = np.where(sigma > 0.0, sigma, 1.0)
    values = np.linalg.eigvalsh(some / scale[:, :, None] / scale[:, None, :])
    bad = int(np.sum(values[:, 0] < -_ROUNDING))
    return (bad, len(some)) if bad else None


def _rejections(result: NavigationResult) -> Iterator[Finding]:
    """Measurements turned away in numbers, or let in against the gate."""
    inn = result.innovations
    for code in np.unique(inn.kind).tolist():
        own = of_kind(inn, code)
        n, out, forced = int(np.isfinite(own.nis).sum()), own.status == REJECTED, own.status == FORCED
        share = float(out.sum()) / max(n, 1)
        from_gnss = code in GNSS_KINDS or code == FIX
        many = n >= LEAST and share >= (_REJECTED[0] if from_gnss else _REJECTED_AID)
        if not (many or (from_gnss and forced.any())):
            continue
        # a few in a row that were let in again, and were right: a start or a turn that the filter took a moment over
        few = share < _REJECTED[0] and int(out.sum()) <= LEAST * int(forced.sum())
        text = f"{kind_text(code)}: {int(out.sum())} of {n} rejected ({100.0 * share:.0f} %)"
        text += f", {int(forced.sum())} taken against the gate after a lock-out" if forced.any() else ""
        text += f", the first at {own.t[out | forced][0]:.1f} s"
        grave = -1 if few else int(many and from_gnss and share >= _REJECTED[1])
        yield Finding(grave, text, f"rejected {code}", share)


def _sizes(result: NavigationResult) -> Iterator[Finding]:
    """Innovations too large one by one, or as means over ten and thirty."""
    inn = result.innovations
    counted = inn.where(judged(inn))
    for code in np.unique(counted.kind).tolist():
        own = of_kind(counted, code)
        own = own.where(own.status != FORCED)
        if len(own) < LEAST:
            continue
        accepted = own.where(own.status == ACCEPTED)
        mean, error = _mean_with_error(own.nis / own.freedom)
        if mean > _NIS[0] and mean - 1.0 > 4.0 * error + 4.0 * np.sqrt(2.0 / own.freedom.sum()):
            grave = int(len(accepted) >= LEAST and accepted.mean_nis() > _NIS[1])
            text = f"{kind_text(code)}: innovations are {np.sqrt(mean):.2g} times their predicted size (NIS {mean:.3g})"
            yield Finding(grave, text, f"nis {code}", mean)
        if code in (POSITION, VELOCITY, FIX, PSEUDORANGE, RANGE_RATE):
            series = _by_satellite(result, code) if code in (PSEUDORANGE, RANGE_RATE) else [accepted]
            values = [_normalised(_second_by_second(part)) for part in series]
            least = _SLOW.get(code, _SLOW_ELSE)
            worst = max((slow_nis(values, length, least) for length in _LENGTHS), key=lambda pair: pair[0] / pair[1])
            if worst[0] > worst[1]:
                text = (
                    f"{kind_text(code)}: innovations have one sign for long; their means are {np.sqrt(worst[0]):.2g} "
                    "times the predicted size: an error stays that the filter takes for noise"
                )
                yield Finding(0, text, f"slow {code}", worst[0])


def _mean_with_error(values: FloatArray) -> tuple[float, float]:
    """Mean and its standard error from means of blocks, so that neighbours may be alike."""
    blocks = np.array_split(values, min(20, len(values)))
    means = np.array([b.mean() for b in blocks])
    return float(values.mean()), float(means.std(ddof=1) / np.sqrt(len(means)))


def _second_by_second(inn: Innovations) -> Innovations:
    """One innovation of a kind for each second: errors of a receiver within a second are alike."""
    second = np.floor(inn.t + 1e-6)
    return inn.where(np.append(True, np.diff(second) > 0.0)[: len(second)])


def _normalised(inn: Innovations) -> FloatArray:
    """Innovations of one kind in units of their sigma. Shape (n, f)."""
    columns = int(inn.freedom[0]) if len(inn) else 3
    z: FloatArray = inn.innovation / np.where(inn.sigma > 0.0, inn.sigma, np.nan)
    return z[:, :columns]


def slow_nis(series: Sequence[FloatArray], length: int, least: float = _SLOW_ELSE) -> tuple[float, float]:
    """Mean square of sums of so many normalised innovations over their number, 1 if they are white; and its limit.

    Parameters
    ----------
    series : sequence of ndarray, shapes (n, f)
        Normalised, of one kind, each in order of time; of ranges one for each satellite.
    length : int
        Innovations in a sum.
    least : float
        Smallest limit, however many sums there are.

    Returns
    -------
    size, limit : float
        Zero and infinity where there are fewer than three sums.
    """
    sums = []
    for z in series:
        n = len(z) // length
        if n:
            parts = z[: n * length].reshape(n, length, -1)
            sums.append(parts.sum(axis=1) / np.sqrt(length))
    if sum(map(len, sums)) < 3:
        return 0.0, np.inf
    squares = np.concatenate(sums) ** 2
    return float(np.nanmean(squares)), max(least, gate_threshold(_TAIL, squares.size) / squares.size)


def _by_satellite(result: NavigationResult, code: int) -> list[Innovations]:
    """Accepted innovations of ranges or range rates, satellite by satellite; none where they are not known."""
    if result.ranges is None:
        return []
    own = of_kind(result.innovations, code)
    value = result.ranges.pseudorange if code == PSEUDORANGE else result.ranges.range_rate
    sat = matched_satellites(own.t, result.ranges, value)
    return [own.where((sat == s) & (own.status == ACCEPTED)) for s in np.unique(sat[sat > 0])]


def _pauses(result: NavigationResult) -> Iterator[Finding]:
    """First fixes after pauses of GNSS against what the inertial solution claimed there."""
    inn = result.innovations
    for code in (POSITION, VELOCITY):
        own = of_kind(inn, code)
        own = own.where(np.isfinite(own.nis))
        step = np.diff(own.t)
        if len(step) < LEAST:
            continue
        after = 1 + np.flatnonzero(step > max(3.0, 5.0 * float(np.median(step))))
        if not len(after):
            continue
        first = own.where(after)
        mean = first.mean_nis()
        if mean > max(_AFTER_PAUSE, gate_threshold(_TAIL, 3 * len(first)) / (3 * len(first))):
            text = (
                f"{kind_text(code)}: after {len(first)} pauses of GNSS the first innovations were {np.sqrt(mean):.2g} "
                "times their predicted size"
            )
            yield Finding(0, text, f"pause {code}", mean)


def _claims(result: NavigationResult) -> Iterator[Finding]:
    """Claims that nothing tested, or so large that the last fix would have served as well as the IMU.

    Notes
    -----
    A prediction of variance P that meets a fix of variance R has the innovation variance S = P + R and leaves
    L = P R / S: P and R are the two roots of ``x^2 - S x + S L``. P is the larger one, and adds less than the fix,
    where what the last record carries on to the fix, without the noise in between, is above their geometric mean.
    """
    inn, T = result.innovations, result.trajectory
    tested = int(np.isfinite(inn.nis).sum())
    if 0 < tested < LEAST:
        text = (
            f"measurements that tested the run, from {T.t[0]:.1f} s on: {tested}, too few to tell whether it is right"
        )
        yield Finding(0, text, "untested", LEAST / tested)
    fixes = inn.where((inn.kind == POSITION) & np.isin(inn.status, (ACCEPTED, FORCED)))
    if result.smoothed or len(fixes) < 3:
        return
    variance = np.sum(result.sigma("dr")[:, :2] ** 2, axis=1)
    left = variance[np.minimum(np.searchsorted(result.t, fixes.t, side="right"), len(result.t) - 1)]
    after = T.r_eb_e[np.minimum(np.searchsorted(T.t, fixes.t, side="right"), len(T.t) - 1)]
    travelled = float(np.median(np.linalg.norm(np.diff(after, axis=0), axis=1)))
    k = np.maximum(np.searchsorted(result.t, fixes.t[1:]) - 1, 0)
    P, dt = result.covariance[k], np.maximum(fixes.t[1:] - result.t[k], 0.0)
    carried = variance[k] + sum(2.0 * dt * P[:, 3 + i, 6 + i] + dt**2 * P[:, 3 + i, 3 + i] for i in (0, 1))
    S, L = np.sum(fixes.sigma[1:, :2] ** 2, axis=1), left[1:]
    claim = float(np.sqrt(np.median(0.5 * S * (1.0 + np.sqrt(np.maximum(1.0 - 4.0 * L / S, 0.0))))))
    worse = float(np.median(carried**2 / (S * L))) > 1.0
    if claim > travelled > 2.0 * float(np.sqrt(np.median(left))) and worse:
        text = (
            f"{kind_text(POSITION)}: predicted to {claim:.2g} m (1 sigma, median), and {travelled:.2g} m lie between "
            "one fix and the next: the IMU adds nothing to them"
        )
        yield Finding(0, text, "claims", claim / travelled)


def _budgets(result: NavigationResult) -> Iterator[Finding]:
    """Parameters that end beyond what was stated of them beforehand."""
    if not len(result.t):
        return
    for block, model in result.layout.models.items():
        if block not in _STEADY:
            continue
        value, sigma = result.parameter(block), result.sigma(block)[-1]
        # a calibration starts away from zero
        moved = value[-1] - (value[0] if "calibration" in result.provenance else 0.0)
        allowed = model.sigma if model.tau is None else np.hypot(model.sigma, model.noise * np.sqrt(0.5 * model.tau))
        if block == "delay" and result.fixes_moved_s != 0.0:  # searched for wider than the run may change it
            allowed = max(allowed, _SEARCHED_S)
        i = int(np.argmax(np.abs(moved)))
        size = float(np.abs(moved[i])) / max(float(allowed), 1e-300)
        if size <= BUDGET[0] or np.abs(moved[i]) < 3.0 * sigma[i]:
            continue
        name, unit = BLOCK_TEXT[block]
        impossible = float(np.abs(moved[i])) > _IMPOSSIBLE.get(block, np.inf)
        grave = -1 if size <= BUDGET[1] else int(impossible)
        text = f"{name}: {moved[i]:+.3g} +- {sigma[i]:.2g} {unit}, where {allowed:.2g} was stated beforehand"
        yield Finding(grave, text, f"budget {block}", size)


def _halves(result: NavigationResult) -> Iterator[Finding]:
    """Parameters whose estimates from parts of the run contradict each other."""
    K = len(result.t)
    if result.smoothed or K < 40:
        return
    for block, model in result.layout.models.items():
        if block not in _STEADY:
            continue
        value, variance = result.parameter(block), result.sigma(block) ** 2
        worst: tuple[float, int, int, int] = (0.0, 0, 0, 0)
        for i, j in ((K // 4, K // 2), (K // 2, K - 1), (K // 4, K - 1), (3 * K // 4, K - 1)):
            span = float(result.t[j] - result.t[i])
            wander = model.noise**2 * (
                span if model.tau is None else 0.5 * model.tau * -np.expm1(-2.0 * span / model.tau)
            )
            # what rounding and a covariance that hardly shrinks leave of the difference is no evidence
            allowed = np.abs(variance[i] - variance[j]) + 2.0 * wander + 1e-3 * variance[i]
            z = np.abs(value[j] - value[i]) / np.sqrt(np.maximum(allowed, 1e-300))
            axis = int(np.argmax(z))
            worst = max(worst, (float(z[axis]), axis, i, j))
        z_worst, axis, i, j = worst
        if z_worst > _HALVES[0]:
            name, unit = BLOCK_TEXT[block]
            text = (
                f"{name}: {value[i, axis]:+.3g} at {result.t[i]:.0f} s and {value[j, axis]:+.3g} {unit} at "
                f"{result.t[j]:.0f} s contradict each other by {z_worst:.0f} sigmas"
            )
            # one that the run itself found to be there is a constant, which no noise of the IMU moves
            least = 0 if block == "delay" and result.fixes_moved_s != 0.0 else -1
            grave = max(sum(z_worst > limit for limit in _HALVES) - 2, least)
            yield Finding(grave, text, f"halves {block}", z_worst)


def _attitude(result: NavigationResult) -> Iterator[Finding]:
    """Attitudes that were never determined, and a body on its back."""
    if len(result.t) < 2:
        return
    sigma = result.sigma("dpsi").max(axis=1) / units.DEG
    late = sigma[len(sigma) // 2 :]
    if np.median(late) > _HEADING_DEG:
        text = f"attitude is uncertain by {np.median(late):.0f} deg (1 sigma): errors are no small angles there"
        yield Finding(0, text, "attitude")
    if float(np.median(result.states.C_nb[:, 2, 2])) < -0.7:
        yield Finding(0, "the body travels upside down: its third axis, which should point down, points up", "back")
