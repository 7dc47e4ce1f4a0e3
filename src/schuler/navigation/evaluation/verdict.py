"""Verdict on a navigation run from the run alone: whether its solution and its claims can be believed, and why not."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal, NamedTuple

import numpy as np

from schuler import units
from schuler.arrays import FloatArray
from schuler.filtering.kinds import kind_display
from schuler.filtering.measurements import (
    ACCEPTED,
    FIX,
    FORCED,
    GATED,
    GNSS_KINDS,
    KINDS,
    POSITION,
    PSEUDORANGE,
    RANGE_RATE,
    REJECTED,
    RESET_POSITION,
    UNUSED,
    VELOCITY,
    gate_threshold,
)
from schuler.filtering.states import BLOCK_TEXT
from schuler.navigation.evaluation.consistency import judged, matched_satellites
from schuler.navigation.inputs.gnss_faults import LARGER
from schuler.navigation.inputs.imu_noise import NOISIER

if TYPE_CHECKING:
    from schuler.navigation.result import Innovations, NavigationResult

Status = Literal["ok", "doubtful", "failed"]

# Limits: chosen on simulated drives, planted wrecks and the half of the corpus whose names sort odd. A limit of a test
# with a known distribution is far out in its tail, since it stands for what is not modelled, not for chance.
_REJECTED = (0.05, 0.5)  # share of tested GNSS measurements rejected
_NIS = (1.5625, 10.0)  # mean normalised innovation squared: sizes wrong by a quarter; threefold
_REJECTED_AID = 0.2  # the same of other aids, whose conditions are rough
_SLOW = 1.75  # the same of means over ten and more: an error that stays
_LENGTHS = (10, 30, 100)  # innovations in such a mean
_TAIL = 0.99999  # of chi-square
_AFTER_PAUSE = 4.0  # mean normalised square of the first fixes after pauses: errors are twice what is claimed
_HALVES = (6.0, 12.0, 20.0)  # difference of two estimates of one parameter, in sigmas of that difference
_BUDGET = (5.0, 10.0)  # an estimate beyond so many of its sigmas stated beforehand
_IMPOSSIBLE = {"b_a": 1.0, "b_g": 0.1}  # biases that no unit has whose budget does not say so [m/s^2], [rad/s]
_HEADING_DEG = 25.0  # 1-sigma of the attitude beyond which errors are not small angles
_LEAST = 10  # fewer tested measurements of a kind convict nobody
#: Blocks whose models hold for the length of a run; clocks and pressure wander as they please.
_STEADY = ("b_a", "b_g", "S_a", "S_g", "M_a", "M_a6", "M_g", "G_g", "mount", "lever", "lever_v", "odometer", "delay")


@dataclass(frozen=True)
class Verdict:
    """Whether a run can be believed, by the run alone: never by a reference.

    Attributes
    ----------
    status : {"ok", "doubtful", "failed"}
        ``ok``: nothing contradicts the claimed uncertainty. ``doubtful``: errors may exceed it; read the reasons.
        ``failed``: model and measurements contradict each other throughout, the solution is not to be used.
    reasons : tuple of str
        Evidence, the gravest first; empty for ``ok``.
    causes : tuple of str
        What would explain the evidence, the likeliest first, with what to do; empty for ``ok``.
    remarks : tuple of str
        What a user should know although it does not shake the verdict: weak evidence alone, aids that never acted,
        long stretches without a fix.
    """

    status: Status
    reasons: tuple[str, ...] = ()
    causes: tuple[str, ...] = ()
    remarks: tuple[str, ...] = ()

    def summary(self) -> str:
        """The verdict in a few lines of text."""
        lines = [f"verdict: {self.status.upper()}" + ("" if self.reasons else ", nothing contradicts the claims")]
        lines += [f"  - {reason}" for reason in self.reasons]
        if self.causes:
            lines.append(f"  likely: {self.causes[0]}")
            lines += [f"  or: {cause}" for cause in self.causes[1:]]
        return "\n".join([*lines, *(f"  (remark: {remark})" for remark in self.remarks)])

    def to_dict(self) -> dict[str, Any]:
        """Plain dictionary, for JSON."""
        return {
            "status": self.status, "reasons": list(self.reasons), "causes": list(self.causes),
            "remarks": list(self.remarks),
        }  # fmt: skip


class Finding(NamedTuple):
    """A piece of evidence: how grave (-1 only beside other evidence, 0 doubtful, 1 failed), sentence, key, size."""

    grave: int
    sentence: str
    key: str
    size: float = 1.0


def verdict(result: NavigationResult) -> Verdict:
    """Judge a run by its rejections, innovations, parameters and covariance.

    Parameters
    ----------
    result : NavigationResult
        Filtered; of a smoothed one the parameters are not compared between parts of the run.

    Returns
    -------
    Verdict

    Notes
    -----
    Evidence, each against what a filter with right models shows: the share of rejected GNSS measurements; acceptances
    after lock-out; the mean normalised innovation squared (NIS) of each kind; the same of means over ten, which
    stays 1 for white innovations and grows with slow errors; the NIS of the first fix after each pause of GNSS; biases
    beyond the budget; two estimates of a parameter, whose difference has the covariance ``P_1 - P_2`` (plus what the
    model lets it move in between), so that a covariance that shrinks although innovations contradict it is seen;
    attitude never determined; a log noisier than the budget; numbers that are none.

    References
    ----------
    Bar-Shalom, Li, Kirubarajan (2001), section 5.4.2, for tests of innovations.
    """
    findings = [*_numbers(result), *_rejections(result), *_sizes(result), *_pauses(result), *_budgets(result)]
    findings += [*_halves(result), *_attitude(result)]
    findings += [Finding(0, note, "noise") for note in result.notes if note.startswith(NOISIER)]
    findings += [Finding(0, note, "adapted") for note in result.notes if note.startswith(LARGER)]
    # sensor errors that change are the filter's failure only where measurements are rejected too
    if not any(f.key.startswith("rejected") for f in findings):
        findings = [f._replace(grave=min(f.grave, 0)) if f.key.startswith("halves") else f for f in findings]
    findings.sort(key=lambda f: -f.grave)
    remarks = tuple(_remarks(result))
    if not findings or findings[0].grave < 0:
        return Verdict("ok", remarks=(*(f.sentence for f in findings), *remarks))
    status: Status = "failed" if findings[0].grave else "doubtful"
    return Verdict(status, tuple(f.sentence for f in findings), tuple(_causes(result, findings)), remarks)


def _text(code: int) -> str:
    return kind_display(KINDS[code]).text


def _of(inn: Innovations, code: int) -> Innovations:
    return inn.where(inn.kind == code)


def _numbers(result: NavigationResult) -> Iterator[Finding]:
    """Solutions that are no numbers, and covariances that are none."""
    T = result.trajectory
    if not (np.isfinite(T.r_eb_e).all() and np.isfinite(T.q_eb).all()):
        yield Finding(1, "the solution holds values that are not numbers", "numbers")
    variances = np.einsum("kii->ki", result.covariance_e)
    bad = int(np.sum(~np.all(variances >= 0.0, axis=1)))
    if bad:
        yield Finding(1, f"variances are negative or unknown at {bad} of {len(result.t)} records", "numbers")


def _rejections(result: NavigationResult) -> Iterator[Finding]:
    """Measurements turned away in numbers, or let in against the gate."""
    inn = result.innovations
    for code in np.unique(inn.kind).tolist():
        own = _of(inn, code)
        n, out, forced = int(np.isfinite(own.nis).sum()), own.status == REJECTED, own.status == FORCED
        share = float(out.sum()) / max(n, 1)
        from_gnss = code in GNSS_KINDS or code == FIX
        many = n >= _LEAST and share >= (_REJECTED[0] if from_gnss else _REJECTED_AID)
        if not (many or (from_gnss and forced.any())):
            continue
        text = f"{_text(code)}: {int(out.sum())} of {n} rejected ({100.0 * share:.0f} %)"
        text += f", {int(forced.sum())} taken against the gate after a lock-out" if forced.any() else ""
        text += f", the first at {own.t[out | forced][0]:.1f} s"
        yield Finding(int(many and from_gnss and share >= _REJECTED[1]), text, f"rejected {code}", share)


def _sizes(result: NavigationResult) -> Iterator[Finding]:
    """Innovations too large one by one, or as means over ten and thirty."""
    inn = result.innovations
    counted = inn.where(judged(inn))
    for code in np.unique(counted.kind).tolist():
        own = _of(counted, code)
        own = own.where(own.status != FORCED)
        if len(own) < _LEAST:
            continue
        accepted = own.where(own.status == ACCEPTED)
        mean, error = _mean_with_error(own.nis / own.freedom)
        if mean > _NIS[0] and mean - 1.0 > 4.0 * error + 4.0 * np.sqrt(2.0 / own.freedom.sum()):
            grave = int(len(accepted) >= _LEAST and accepted.mean_nis() > _NIS[1])
            text = f"{_text(code)}: innovations are {np.sqrt(mean):.2g} times their predicted size (NIS {mean:.3g})"
            yield Finding(grave, text, f"nis {code}", mean)
        if code in (POSITION, VELOCITY, FIX, PSEUDORANGE, RANGE_RATE):
            series = _by_satellite(result, code) if code in (PSEUDORANGE, RANGE_RATE) else [accepted]
            worst = max((slow_nis(series, length) for length in _LENGTHS), key=lambda pair: pair[0] / pair[1])
            if worst[0] > worst[1]:
                text = (
                    f"{_text(code)}: innovations have one sign for long; their means are {np.sqrt(worst[0]):.2g} times "
                    "the predicted size: an error stays that the filter takes for noise"
                )
                yield Finding(0, text, f"slow {code}", worst[0])


def _mean_with_error(values: FloatArray) -> tuple[float, float]:
    """Mean and its standard error from means of blocks, so that neighbours may be alike."""
    blocks = np.array_split(values, min(20, len(values)))
    means = np.array([b.mean() for b in blocks])
    return float(values.mean()), float(means.std(ddof=1) / np.sqrt(len(means)))


def slow_nis(series: Sequence[Innovations], length: int) -> tuple[float, float]:
    """Mean square of sums of so many normalised innovations over their number, 1 if they are white; and its limit.

    Parameters
    ----------
    series : sequence of Innovations
        Of one kind, each in order of time; of ranges one for each satellite.
    length : int
        Innovations in a sum.

    Returns
    -------
    size, limit : float
        Zero and infinity where there are fewer than three sums.
    """
    sums = []
    for inn in series:
        n = len(inn) // length
        if n:
            z = inn.innovation / np.where(inn.sigma > 0.0, inn.sigma, np.nan)
            parts = z[: n * length, : int(inn.freedom[0])].reshape(n, length, -1)
            sums.append(parts.sum(axis=1) / np.sqrt(length))
    if sum(map(len, sums)) < 3:
        return 0.0, np.inf
    squares = np.concatenate(sums) ** 2
    return float(np.nanmean(squares)), max(_SLOW, gate_threshold(_TAIL, squares.size) / squares.size)


def _by_satellite(result: NavigationResult, code: int) -> list[Innovations]:
    """Accepted innovations of ranges or range rates, satellite by satellite; none where they are not known."""
    if result.ranges is None:
        return []
    own = _of(result.innovations, code)
    value = result.ranges.pseudorange if code == PSEUDORANGE else result.ranges.range_rate
    sat = matched_satellites(own.t, result.ranges, value)
    return [own.where((sat == s) & (own.status == ACCEPTED)) for s in np.unique(sat[sat > 0])]


def _pauses(result: NavigationResult) -> Iterator[Finding]:
    """First fixes after pauses of GNSS against what the inertial solution claimed there."""
    inn = result.innovations
    for code in (POSITION, VELOCITY):
        own = _of(inn, code)
        own = own.where(np.isfinite(own.nis))
        step = np.diff(own.t)
        if len(step) < _LEAST:
            continue
        after = 1 + np.flatnonzero(step > max(3.0, 5.0 * float(np.median(step))))
        if not len(after):
            continue
        first = own.where(after)
        mean = first.mean_nis()
        if mean > max(_AFTER_PAUSE, gate_threshold(_TAIL, 3 * len(first)) / (3 * len(first))):
            text = (
                f"{_text(code)}: after {len(first)} pauses of GNSS the first innovations were {np.sqrt(mean):.2g} "
                "times their predicted size"
            )
            yield Finding(0, text, f"pause {code}", mean)


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
        i = int(np.argmax(np.abs(moved)))
        size = float(np.abs(moved[i])) / max(float(allowed), 1e-300)
        if size <= _BUDGET[0] or np.abs(moved[i]) < 3.0 * sigma[i]:
            continue
        name, unit = BLOCK_TEXT[block]
        impossible = float(np.abs(moved[i])) > _IMPOSSIBLE.get(block, np.inf)
        grave = -1 if size <= _BUDGET[1] else int(impossible)
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
            yield Finding(sum(z_worst > limit for limit in _HALVES) - 2, text, f"halves {block}", z_worst)


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


# --- causes -----------------------------------------------------------------------------------------------------------

_OTHER_MOTION = 10.0  # noise of the IMU enlarged by so much, with biases no budget allows: not noise
_CONTRADICTION = (
    "IMU and GNSS tell of different motions: axes or mounting of the IMU (imu.mount_rpy_deg), clocks that differ "
    "(imu.clock_shift_s), or heading at the start (alignment); schuler check tells them apart"
)
#: Openings of notes on the log that explain a wreck.
_TELLING = ("GNSS velocities seem to be", "GNSS positions jump")


def _causes(result: NavigationResult, findings: list[Finding]) -> list[str]:
    """Explanations of the evidence, the likeliest first: no more than three."""
    size = {f.key: f.size for f in findings}
    causes = [(0.85, note) for note in result.notes if note.startswith(_TELLING)]
    causes += [c for c in (_clock(result), _wrong_fixes(result, size), _wrong_model(result, size)) if c is not None]
    if any(key in size for key in ("numbers",)):
        causes.append((0.9, "states ran away: begin with fewer states, and look at gaps and spikes of the log"))
    if "noise" in size:
        causes.append((0.8, "the budget of the IMU is not this unit's or not its units': imu, schuler allan"))
    for note in (n for n in result.notes if n.startswith(LARGER)):
        factor = note.partition("up to ")[2].partition(" ")[0]
        if "GNSS" in note:
            causes.append((0.55, f"GNSS states accuracies {factor} times too good: gnss.sigma_scale, or the floors"))
            continue
        causes.append((0.55, "the budget of the IMU is too small (imu; filter.tune = true finds one that fits)"))
        if float(factor) >= _OTHER_MOTION and any(key.startswith("budget b_") for key in size):
            causes.append((0.7, _CONTRADICTION))
    slow_v = max(size.get(f"slow {code}", 0.0) for code in (VELOCITY, RANGE_RATE))
    slow_r = max(size.get(f"slow {code}", 0.0) for code in (POSITION, PSEUDORANGE))
    rejected = max((v for k, v in size.items() if k.startswith("rejected")), default=0.0)
    scale = _claims_too_small(result)
    if scale > 1.3:
        causes.append(
            (
                0.75 if not slow_r > 2.0 * scale**2 else 0.3,
                f"GNSS states accuracies {scale:.2g} times too good: gnss.sigma_scale, or the floors",
            )
        )
    if size.get(f"slow {POSITION}", 0.0) > 1.5 * slow_v and rejected < 0.1:
        causes.append(
            (0.6, "GNSS has slow errors that its accuracies leave out: gnss.correlated, or a larger sigma_scale")
        )
    if f"slow {PSEUDORANGE}" in size:
        causes.append((0.6, "atmosphere and reflections make ranges wrong for minutes: a larger gnss.sigma_scale"))
    if slow_v or slow_r or any(k.startswith(("pause", "halves")) for k in size):
        causes.append(
            (
                0.5,
                "the IMU is worse than its budget (imu: noise, vibration, scale factors), or the lever arm "
                "(gnss.lever_arm_m) is wrong",
            )
        )
    aids = [k for k in size if k.startswith(("rejected", "nis")) and int(k.split()[1]) not in (*GNSS_KINDS, FIX)]
    if aids:
        names = " and ".join(dict.fromkeys(_text(int(k.split()[1])) for k in aids))
        causes.append((0.45, f"what {names} assumes does not hold: mount angles, lever arms, sigmas of that aid"))
    if "attitude" in size:
        causes.append((0.7, "the motion does not show the heading: give it (alignment.rpy_deg), or drive turns"))
    if not causes:
        causes.append((0.1, "the IMU or GNSS is worse than it states"))
    return list(dict.fromkeys(text for _, text in sorted(causes, key=lambda c: -c[0])))[:3]


def _clock(result: NavigationResult) -> tuple[float, str] | None:
    """Clocks that differ: velocity innovations that follow the acceleration."""
    own = _of(result.innovations, VELOCITY)
    own = own.where(np.isfinite(own.nis))
    T = result.trajectory
    if len(own) < 3 * _LEAST or len(T.t) < 10:
        return None
    half = 0.5
    before, after = (np.clip(own.t + d, T.t[0], T.t[-1]) for d in (-half, half))
    v = T.v_eb_n
    at = [np.column_stack([np.interp(x, T.t, v[:, i]) for i in range(2)]) for x in (before, after)]
    a = (at[1] - at[0]) / np.maximum(after - before, 1e-9)[:, None]
    e = own.innovation[:, :2]
    # large innovations count by their root: a filter that was thrown off has huge ones for other reasons
    w = 1.0 / np.maximum(np.linalg.norm(e, axis=1), own.sigma[:, :2].mean(axis=1))[:, None]
    power = float(np.sum(w * a * a))
    if power <= 0.0:
        return None
    tau = -float(np.sum(w * e * a)) / power
    explained = 1.0 - float(np.sum(w * (e + tau * a) ** 2) / np.sum(w * e * e))
    if abs(tau) < 0.1 or explained < 0.05:
        return None
    return (
        min(0.4 + 3.0 * explained, 0.95),
        f"clocks that differ: velocity innovations follow the acceleration as if GNSS stamps were {abs(tau):.1g} s or "
        f"more {'late' if tau > 0.0 else 'early'} (imu.clock_shift_s; gnss.delay_sigma_s estimates small ones)",
    )


def _wrong_fixes(result: NavigationResult, size: dict[str, float]) -> tuple[float, str] | None:
    """Wrong fixes: positions rejected while their velocities agree with the IMU."""
    inn = result.innovations
    own = _of(inn, POSITION)
    out = own.status == REJECTED
    velocities = _of(inn, VELOCITY)
    tested = np.isfinite(velocities.nis)
    if f"rejected {POSITION}" not in size or tested.sum() < _LEAST or f"rejected {VELOCITY}" in size:
        return None
    return (
        0.8,
        f"the fixes are wrong between {own.t[out][0]:.1f} and {own.t[out][-1]:.1f} s: their positions contradict "
        "their own velocities, with which the IMU agrees",
    )


def _wrong_model(result: NavigationResult, size: dict[str, float]) -> tuple[float, str] | None:
    """Wrong axes, or a wrong attitude at the start: velocities contradict the IMU from the beginning on."""
    if "back" in size:
        return 0.95, "axes or mounting of the IMU are not forward, right, down: imu.mount_rpy_deg, or the reading hints"
    own = _of(result.innovations, VELOCITY)
    own = own.where(np.isfinite(own.nis))
    biased = max((v for k, v in size.items() if k.startswith("budget b_")), default=0.0)
    share = size.get(f"rejected {VELOCITY}", size.get(f"rejected {POSITION}", 0.0))
    if share < 0.2 or not (biased or len(own)):
        return None
    early = float(np.mean(own.status[: max(_LEAST, len(own) // 5)] == REJECTED)) if len(own) else share
    given = any("(given attitude)" in note for note in result.notes)
    cause = "axes or mounting of the IMU (signs, exchanged axes, imu.mount_rpy_deg)"
    heading = "heading at the start (alignment)"
    first, second = (heading, cause) if given else (cause, heading)
    return 0.4 + 0.3 * early + (0.15 if biased > _BUDGET[1] else 0.0), f"wrong {first}, or {second}"


def _claims_too_small(result: NavigationResult) -> float:
    """Factor by which the typical GNSS innovation exceeds its prediction; medians, so that faults do not count."""
    inn = result.innovations
    sizes = []
    for code in (POSITION, VELOCITY, PSEUDORANGE):
        own = _of(inn, code)
        own = own.where(np.isfinite(own.nis))
        if len(own) >= _LEAST:
            sizes.append(float(np.sqrt(np.median(own.nis) / gate_threshold(0.5, int(own.freedom[0])))))
    # wrong claims of a receiver are wrong throughout; elsewhere positions and velocities suffer differently
    return min(sizes) if sizes and max(sizes) < 3.0 * min(sizes) else 0.0


# --- remarks ----------------------------------------------------------------------------------------------------------

#: Measurements that each configured aid should have made.
_AIDS = {
    "zero_velocity": "zero_velocity", "zero_rate": "zero_rate", "gravity": "gravity", "earth_rate": "earth_rate",
    "non_holonomic": "lateral", "odometer": "speed", "heading": "heading", "barometer": "height", "fixes": "fix",
}  # fmt: skip


def _remarks(result: NavigationResult) -> Iterator[str]:
    """Aids that never acted, and the longest stretch without a position."""
    inn = result.innovations
    acted = {KINDS[int(k)] for k in np.unique(inn.kind[np.isin(inn.status, (ACCEPTED, FORCED))])}
    for aid in result.provenance.get("config", {}).get("aiding", {}):
        kinds = {_AIDS.get(aid, aid), *(("gravity_vector",) if aid == "gravity" else ())}
        kinds |= {"gnss_heading"} if aid == "heading" else set()
        if aid in _AIDS and not acted & kinds:
            own = inn.where(np.isin(inn.kind, [c for c, name in KINDS.items() if name in kinds]))
            why = (
                "it made no measurement"
                if not len(own)
                else ", ".join(
                    f"{int(np.sum(own.status == s))} {word}"
                    for s, word in (
                        (REJECTED, "rejected"),
                        (GATED, "without their condition"),
                        (UNUSED, "outside the run"),
                    )
                    if np.any(own.status == s)
                )
            )
            yield f"aiding.{aid} never acted: {why}"
    placing = np.isin(inn.kind, (POSITION, PSEUDORANGE, RESET_POSITION, FIX)) & np.isin(inn.status, (ACCEPTED, FORCED))
    T = result.trajectory.t
    if not len(T):
        return
    t = inn.t[placing]
    edges = np.concatenate(([T[0]], t, [T[-1]]))
    k = int(np.argmax(np.diff(edges)))
    longest = float(edges[k + 1] - edges[k])
    usual = float(np.median(np.diff(t))) if len(t) > 1 else 0.0
    if longest > max(5.0, 5.0 * usual):
        spread = result.sigma("dr")[:, :2].max(axis=1)
        inside = (result.t >= edges[k]) & (result.t <= edges[k + 1])
        if inside.any():
            yield (
                f"free inertial for up to {longest:.0f} s (from {edges[k]:.1f} s, no position used), where the claimed "
                f"1-sigma position grows to {spread[inside].max():.3g} m"
            )
