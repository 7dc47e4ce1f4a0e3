"""Sentences on a run, and the tables of its key numbers, outages and measurements."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from schuler.arrays import FloatArray
from schuler.filtering.kinds import kind_display
from schuler.filtering.measurements import (
    ACCEPTED,
    FORCED,
    GATED,
    GNSS_KINDS,
    POSITION,
    PSEUDORANGE,
    REJECTED,
    RESET_POSITION,
    STATUS,
    UNUSED,
    in_windows,
)
from schuler.navigation.evaluation.consistency import chi_square_band, judged, mean_nis
from schuler.navigation.evaluation.errors import TrajectoryErrors, outage_errors
from schuler.navigation.report.accuracy import separation_share
from schuler.navigation.report.subject import Subject, inside_shares
from schuler.plotting.parts import number

# Claimed and actual sizes may differ by this factor before the words change: a fifth is what a careful tuning reaches.
_SIZE_TOLERANCE = 1.25
_LEAST_INSIDE = 0.97  # least share inside three sigma: errors of one run are correlated, so not 0.997


class Row(NamedTuple):
    """A number of the table: what it is, with its unit, and a text for each solution."""

    name: str
    values: tuple[str, ...]


def judgement(subject: Subject) -> list[str]:
    """Verdict on the run alone, a sentence each: status with its gravest reason, more reasons, causes, remarks."""
    v = subject.result.verdict
    if v.status == "ok":
        sentences = ["OK: nothing in the run contradicts what the filter claims."]
    else:
        first, *more = v.reasons
        sentences = [f"{v.status.upper()}: {first}.", *(f"{reason}." for reason in more)]
        sentences += [f"{lead} {c}." for lead, c in zip(("Likely:", "Or:", "Or:"), v.causes, strict=False)]
    return sentences + [f"Remark: {remark}." for remark in v.remarks]


def verdict(subject: Subject) -> tuple[str, str, str, str]:
    """Accuracy, consistency, behaviour without GNSS, and aids: a sentence each."""
    return _accuracy_sentence(subject), _consistency_sentence(subject), _outage_sentence(subject), aids(subject)


def key_numbers(subject: Subject) -> tuple[tuple[str, ...], list[Row]]:
    """Heads of the value columns and rows of the table of key numbers."""
    heads = tuple(role for role, _ in subject.solutions)
    rows: list[Row] = []

    def add(name: str, values: list[float | None]) -> None:
        if any(v is not None for v in values):
            rows.append(Row(name, tuple(number(v) for v in values)))

    if subject.errors:
        statistics = [e.statistics() for e in subject.errors.values()]
        for key, name in _STATISTICS.items():
            add(name, [s.get(key) for s in statistics])
        if subject.result.outages:
            add("horizontal error with GNSS, RMS [m]", [_rms_with_gnss(e, subject) for e in subject.errors.values()])
            outage_lists = [outage_errors(e, subject.result.outages) for e in subject.errors.values()]
            if outage_lists[0]:
                worst = [np.array([o.max_horizontal for o in f]) for f in outage_lists]
                ends = [np.array([o.end_horizontal for o in f]) for f in outage_lists]
                add("largest horizontal error in an outage, mean [m]", [float(w.mean()) for w in worst])
                add("largest horizontal error in an outage, worst [m]", [float(w.max()) for w in worst])
                add("horizontal error at the end of an outage, RMS [m]", [float(np.sqrt(np.mean(w**2))) for w in ends])
    for name, block, combine in _SIGMAS:
        add(name, [_median(combine(subject.sigma(r, block))) for _, r in subject.solutions])
    if subject.nees is not None:
        rows.append(
            Row(
                "NEES per state, mean (honest: 1) [-]",
                (number(float(np.mean(subject.nees[1]))), *("-",) * (len(heads) - 1)),
            )
        )
    apart = subject.apart
    if apart is not None:
        for block, name in (("dr", "position"), ("dpsi", "attitude")):
            share = number(100.0 * separation_share(subject, apart, block))
            rows.append(
                Row(
                    f"filtered minus smoothed {name}, inside 3 sigma (honest: 99.7) [%]",
                    (share, *("-",) * (len(heads) - 1)),
                )
            )
    for kind in subject.result.innovations.counts():
        inn = subject.result.innovations.of(kind)
        mean, _ = mean_nis(inn)
        if np.isfinite(mean):
            name = f"NIS per axis, {kind_display(kind).text}, mean (honest: 1) [-]"
            rows.append(Row(name, (number(mean), *("-",) * (len(heads) - 1))))
    return heads, rows


def outage_rows(subject: Subject) -> list[tuple[str, ...]]:
    """Rows of a table: number, from, to, then largest and in brackets last horizontal error of each solution."""
    outage_lists = [outage_errors(e, subject.result.outages) for e in subject.errors.values()]
    if not outage_lists:
        return []
    rows = []
    for k, same in enumerate(zip(*outage_lists, strict=True)):
        numbers = [f"{number(o.max_horizontal)} ({number(o.end_horizontal)})" for o in same]
        rows.append(
            (str(k + 1), f"{same[0].start - subject.start:.1f}", f"{same[0].stop - subject.start:.1f}", *numbers)
        )
    return rows


_STATISTICS = {
    "rms_horizontal_m": "horizontal error, RMS [m]",
    "cep50_m": "horizontal error, half of the time below (CEP) [m]",
    "cep95_m": "horizontal error, 95 % of the time below [m]",
    "max_horizontal_m": "horizontal error, largest [m]",
    "rms_vertical_m": "vertical error, RMS [m]",
    "max_vertical_m": "vertical error, largest [m]",
    "rms_velocity_horizontal_m_s": "horizontal velocity error, RMS [m/s]",
    "rms_velocity_vertical_m_s": "vertical velocity error, RMS [m/s]",
    "rms_tilt_deg": "tilt error (roll and pitch), RMS [deg]",
    "rms_heading_deg": "heading error, RMS [deg]",
}


def _level(s: FloatArray) -> FloatArray:
    return np.hypot(s[:, 0], s[:, 1])


def _down(s: FloatArray) -> FloatArray:
    return s[:, 2]


_SIGMAS = (
    ("claimed horizontal 1-sigma, median [m]", "dr", _level),
    ("claimed vertical 1-sigma, median [m]", "dr", _down),
    ("claimed heading 1-sigma, median [deg]", "dpsi", lambda s: np.degrees(s[:, 2])),
)


def _median(values: FloatArray) -> float | None:
    finite = values[np.isfinite(values)]
    return float(np.median(finite)) if len(finite) else None


def _rms_with_gnss(e: TrajectoryErrors, subject: Subject) -> float | None:
    # the very end of an outage is left out too: there the first fix is just about to act
    with_gnss = np.ones(len(e.t), dtype=bool)
    for start, stop in subject.result.outages:
        with_gnss &= (e.t < start) | (e.t > stop)
    return float(np.sqrt(np.mean(e.horizontal[with_gnss] ** 2))) if with_gnss.any() else None


def _sizes(errors: TrajectoryErrors) -> tuple[str, ...]:
    statistics = errors.statistics()
    return tuple(number(statistics[k], "m") for k in ("rms_horizontal_m", "max_horizontal_m", "rms_vertical_m"))


def _accuracy_sentence(subject: Subject) -> str:
    role, result = subject.solutions[0]
    cut = "" if result.complete else "The run was interrupted; up to there, "
    if subject.errors:
        rms, worst, vertical = _sizes(subject.errors[role])
        text = (
            f"against {subject.reference_name} the {role} position is wrong by {rms} horizontally (RMS, at worst "
            f"{worst}) and {vertical} vertically"
        )
        if len(subject.errors) > 1:
            rms, worst, vertical = _sizes(subject.errors["smoothed"])
            text += f"; smoothed, by {rms} (at worst {worst}) and {vertical}"
    elif len(result.t):
        claimed = _level(subject.sigma(result, "dr"))
        text = (
            f"there is no reference to compare with; the {role} solution itself claims a horizontal 1-sigma "
            f"uncertainty of {number(_median(claimed), 'm')} (median) and "
            f"{number(float(np.nanmax(claimed)), 'm')} at worst"
        )
        if np.any(result.innovations.kind == POSITION) and "b_r" not in result.layout:
            text += (
                "; an error that all its fixes share for minutes is not in that, and innovations hardly show it "
                "(gnss.correlated states one)"
            )
    else:
        text = "there is neither a reference nor a record of the uncertainty"
    return (cut + text if cut else text[0].upper() + text[1:]) + "."


def _consistency_sentence(subject: Subject) -> str:
    sizes, words = _normalised_sizes(subject)
    if not sizes:
        return "Nothing was measured that could tell whether the filter's uncertainty is honest."
    role = subject.solutions[0][0]
    shares = float(np.mean(subject.inside_three_sigma[role])) if role in subject.inside_three_sigma else 1.0
    # errors decide before innovations: they are what is claimed
    sized = "errors" if subject.nees is not None else "innovations"
    text = _claim_against_size(sizes[0], sized, shares, subject.result.verdict.status == "ok")
    if shares < _LEAST_INSIDE:
        words.append(f"{100.0 * shares:.0f} % of its position errors lie inside three sigma, where 99.7 % should")
    apart = subject.apart
    share = float("nan") if apart is None else separation_share(subject, apart, "dr")
    if share < _LEAST_INSIDE:
        words.append(
            f"smoothing moved the position by more than three sigma of the difference in {100.0 * (1.0 - share):.0f} % "
            "of the records"
        )
    text += ": " + "; ".join(words)
    inn = subject.result.innovations
    tested, rejected = int(np.sum(np.isfinite(inn.nis))), int(np.sum(inn.status == REJECTED))
    if tested:
        share = 100.0 * rejected / tested
        text += f"; it rejected {rejected} of {tested} measurements" + (
            f" ({share:.0f} %), look at the innovations" if share > 2.0 else ""
        )
    for role, result in subject.solutions:
        bad = int(np.sum(~np.all(np.einsum("kii->ki", result.covariance_e) >= 0.0, axis=1)))
        if bad:
            text += f"; the {role} covariance has negative or unknown variances at {bad} of {len(result.t)} records"
    return text + "."


def _normalised_sizes(subject: Subject) -> tuple[list[float], list[str]]:
    """Roots of mean NEES and mean NIS, as far as they exist, with a phrase on each."""
    sizes, words = [], []
    if subject.nees is not None:
        _, values, degrees = subject.nees
        mean, (low, high) = float(np.mean(values)), chi_square_band(degrees)
        place = "inside" if low <= mean <= high else "above" if mean > high else "below"
        sizes.append(float(np.sqrt(mean)))
        words.append(
            f"its normalised error squared (NEES) averages {number(mean)}, {place} the band {low:.2f} to {high:.2f}"
        )
    inn = subject.result.innovations
    counted = inn.where(judged(inn))
    # constraints on a vehicle have generous sigmas, so GNSS is judged where there is any
    gnss = counted.where(np.isin(counted.kind, GNSS_KINDS))
    mean, source = (gnss.mean_nis(), "GNSS") if len(gnss) else (counted.mean_nis(), "its aids")
    if np.isfinite(mean):
        sizes.append(float(np.sqrt(mean)))
        words.append(f"the normalised innovation squared (NIS) of {source} averages {number(mean)}, where 1 is right")
    return sizes, words


def _claim_against_size(factor: float, sized: str, shares: float, undoubted: bool) -> str:
    """Judgement of the claimed uncertainty by the size of errors or innovations, and the share inside three sigma."""
    if factor > _SIZE_TOLERANCE:
        return f"The filter is too sure of itself, its {sized} being {number(factor)} times what it claims on average"
    if shares < _LEAST_INSIDE:
        return "The filter's uncertainty fits what it was given, but not all of its errors"
    if factor < 1.0 / _SIZE_TOLERANCE:
        return f"The filter is too cautious, its {sized} being only {number(factor)} times what it claims on average"
    if not undoubted:  # an average that fits contradicts no reason for doubt
        return f"The filter's uncertainty fits its {sized} on average"
    return "The filter's uncertainty can be believed"


def _outages_left(subject: Subject) -> tuple[int, int]:
    """In how many outages the north or east error of the first solution left its 3-sigma band, and of how many."""
    role, result = subject.solutions[0]
    e, sigma = subject.errors[role], subject.position_sigma(result)
    left = seen = 0
    for start, stop in result.outages:
        k = (e.t >= start) & (e.t <= stop)
        shares = inside_shares(e.t[k], e.position_n[k, :2], result.t, sigma[:, :2])
        seen += int(np.isfinite(shares).any())
        left += int(np.nanmin(shares) < 1.0) if np.isfinite(shares).any() else 0
    return left, seen


def _outage_sentence(subject: Subject) -> str:
    windows = subject.result.outages
    offered = subject.result.innovations
    placing = offered.where(np.isin(offered.kind, (POSITION, PSEUDORANGE, RESET_POSITION)))
    if not len(placing) and not windows:
        return "No GNSS position was used at all: the error grows for as long as the run lasts."
    if not windows:
        t_used = placing.t[np.isin(placing.status, (ACCEPTED, FORCED))]
        edges = np.concatenate([[subject.result.trajectory.t[0]], t_used, [subject.result.trajectory.t[-1]]])
        pause = f"{np.diff(edges).max():.1f} s" if len(t_used) else "the whole run"
        return f"GNSS was never withheld, so nothing is learnt about outages (longest time without a fix: {pause})."
    lengths = [b - a for a, b in windows]
    length = f"{min(lengths):g}" if max(lengths) - min(lengths) < 0.05 else f"{min(lengths):g} to {max(lengths):g}"
    once = "once" if len(windows) == 1 else f"{len(windows)} times"
    text = f"GNSS was withheld {once} for {length} s"
    outage_lists = {role: outage_errors(e, windows) for role, e in subject.errors.items()}
    parts = []
    for role, list_of in outage_lists.items():
        if list_of:
            worst = np.array([o.max_horizontal for o in list_of])
            some = f"{number(float(worst.mean()), 'm')} on average and {number(float(worst.max()), 'm')} at worst"
            parts.append(f"{some if len(worst) > 1 else number(float(worst.max()), 'm')} ({role})")
    if parts:
        left, seen = _outages_left(subject)
        band = f"; in {left} of {seen} the {next(iter(outage_lists))} error went beyond three sigma" if left else ""
        return f"{text}: the horizontal error grew to {' and to '.join(parts)}{band}."
    during = in_windows(subject.result.t, windows)
    if during.any():
        claimed = _level(subject.sigma(subject.result, "dr"))[during]
        return f"{text}: the claimed horizontal 1-sigma uncertainty grew to {number(float(np.nanmax(claimed)), 'm')}."
    return f"{text}, outside the solution's span or between its records."


def measurement_rows(subject: Subject) -> list[tuple[str, ...]]:
    """Rows of a table: kind, used, rejected, accepted after lock-out, condition not met, outside the run."""
    return [
        (
            kind_display(kind).text,
            str(count[STATUS[ACCEPTED]] + count[STATUS[FORCED]]),
            str(count[STATUS[REJECTED]]),
            str(count[STATUS[FORCED]]),
            str(count[STATUS[GATED]]),
            str(count[STATUS[UNUSED]]),
        )
        for kind, count in subject.result.innovations.counts().items()
    ]


def aids(subject: Subject) -> str:
    """Sentence on the aids: used, rejected, and those whose innovations have another size than predicted."""
    inn = subject.result.innovations
    used_kinds, off = [], []
    for kind, count in inn.counts().items():
        used = count[STATUS[ACCEPTED]] + count[STATUS[FORCED]]
        more = [
            f"{n} {why}"
            for n, why in (
                (count[STATUS[REJECTED]], "rejected"), (count[STATUS[GATED]], "without their condition"),
            )
            if n
        ]  # fmt: skip
        if used or more:
            used_kinds.append(f"{kind_display(kind).text} ({', '.join([f'{used} used', *more])})")
            mean, right = mean_nis(inn.of(kind))
            if not right:
                off.append(
                    f"{kind_display(kind).text} ({'too sure' if mean > 1.0 else 'too cautious'}, {number(mean)})"
                )
    if not used_kinds:
        return "Nothing aided the INS."
    tested = bool(np.isfinite(inn.nis).any())
    verdict_of_nis = "; NIS is " + (f"off for {_enumerated(off)}" if off else "right for each") if tested else ""
    return f"Aids: {', '.join(used_kinds)}{verdict_of_nis}."


def _enumerated(words: list[str]) -> str:
    return words[0] if len(words) == 1 else f"{', '.join(words[:-1])} and {words[-1]}"
