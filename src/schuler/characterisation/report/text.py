"""Sentences and numbers on an identified noise model: what it is, what it means, how far to believe it."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from schuler import units as u
from schuler.arrays import FloatArray
from schuler.characterisation.report.terms import (
    TRIADS,
    agreement,
    chosen,
    gauss_markov_label,
    numbers,
    quantities,
    quantity,
    shares,
    triad_of,
)
from schuler.characterisation.result import AXES, AxisNoise, Estimate, Finding, NoiseIdentification
from schuler.sensors.spec import allan_minimum

_SURE = 8.0  # degrees of freedom: the deviation is known to a quarter
_IN_FULL = 2  # findings of one kind that a summary prints in full
_SEVERITIES = ("refused", "warning", "note")


def summary(identification: NoiseIdentification) -> str:
    """Numbers of all axes as a table in data-sheet units with 95 % intervals, then findings, budget and notes.

    Parameters
    ----------
    identification : NoiseIdentification

    Returns
    -------
    str
        Several lines of at most 120 characters but for long sentences.
    """
    lines = [headline(identification)]
    for triad, title in TRIADS.items():
        axes = [a for a in chosen(identification, None) if triad_of(a) == triad] if identification.axes else []
        if not axes:
            continue
        rows: dict[tuple[str, str], dict[str, str]] = {}
        for axis in axes:
            for label, q, e in numbers(axis):
                rows.setdefault((label, q.sheet), {})[axis.axis] = with_interval(e, q.factor)
            for label, high in axis.limits.items():
                q = quantity(axis, label)
                rows.setdefault((label, q.sheet), {})[axis.axis] = f"below {high / q.factor:.2g}"
        lines.append(f"  {title:<30}" + "".join(f"{a.axis.partition('_')[2]:<29}" for a in axes).rstrip())
        for label, sheet in _ordered(rows):
            cells = "".join(f"{rows[label, sheet].get(a.axis, '-'):<29}" for a in axes)
            lines.append(f"    {label + ' [' + sheet + ']':<28}{cells}".rstrip())
    for name, several in identification.refused.items():
        lines += [f"  refused, {located(name, f)}" for f in several]
    lines += [f"  {line}" for line in _of_each_kind(findings(identification))]
    lines += [f"  {axis}: mean {mean}, spread {spread}" for axis, mean, spread in turn_on_rows(identification)]
    if identification.spec is not None:
        lines.append(identification.spec.summary())
    lines += [f"  - {note}" for note in identification.notes]
    return "\n".join(lines)


def turn_on_rows(identification: NoiseIdentification) -> list[tuple[str, str, str]]:
    """Axis and number of recordings, their mean, and the spread from one switch-on to the next; of three and more."""
    rows = []
    for name, t in identification.turn_on.items():
        q = quantity(identification.axes[name], "x")
        mean, low, high, sigma, least, most = (
            float(v[0]) / q.factor for v in (t.mean, t.mean_low, t.mean_high, t.sigma, t.low, t.high)
        )
        rows.append((
            f"{name} over {t.records} switch-ons [{q.sheet}]", f"{mean:.4g} ({low:.4g} to {high:.4g})",
            f"{sigma:.3g} ({least:.3g} to {most:.3g})",
        ))  # fmt: skip
    return rows


def _of_each_kind(several: Sequence[tuple[str, Finding]]) -> list[str]:
    """Findings but refusals, the first ones of each kind in full, and where there are more of it."""
    kinds: dict[tuple[str, str], list[tuple[str, Finding]]] = {}
    for where, finding in several:
        if finding.severity != "refused":
            kinds.setdefault((finding.severity, finding.code), []).append((where, finding))
    lines = []
    for (severity, code), of_kind in kinds.items():
        lines += [f"{severity}, {located(where, finding)}" for where, finding in of_kind[:_IN_FULL]]
        if rest := [where for where, _ in of_kind[_IN_FULL:]]:
            at = ", ".join(
                f"{where} ({rest.count(where)})" if rest.count(where) > 1 else where for where in dict.fromkeys(rest)
            )
            lines.append(f"{severity}, {len(rest)} more of this kind ({code}): {at}; the report and --json have them")
    return lines


def headline(identification: NoiseIdentification) -> str:
    """Name, length, rate, axes and method in one line."""
    axes = list(identification.axes.values())
    if not axes:
        return f"{identification.name}: no axis could be identified"
    count = "1 axis" if len(axes) == 1 else f"{len(axes)} axes"
    method = ", ".join(sorted({a.method for a in axes if a.method}))
    length, rate = max(a.duration_s for a in axes), axes[0].rate_hz
    text = f"{identification.name}: noise of {count} from {span(length)} at {rate:g} Hz"
    return text + (f", method {method}" if method else "")


def verdict(identification: NoiseIdentification) -> list[str]:
    """Three sentences: how large the noise is, what follows for a user, how far the numbers can be believed."""
    axes = list(identification.axes.values())
    if not axes:
        return [
            f"No axis of {identification.name} could be identified, so there are no numbers.",
            *(located(name, several[0]) for name, several in identification.refused.items() if several),
        ]
    return [*_how_large(axes), _believable(identification)]


def meaning(axis: AxisNoise, label: str) -> str:
    """Meaning of a number of this axis and its consequence, in one sentence.

    Parameters
    ----------
    axis : AxisNoise
    label : str
        As :func:`~schuler.characterisation.report.terms.numbers` gives it: ``N``, ..., ``GM``, ``GM time``.

    Notes
    -----
    Integral of a Gauss-Markov process over T: ``2 sigma^2 tau (T - tau (1 - exp(-T / tau)))``, Gelb (1974), sec. 3.6.
    """
    gyro = triad_of(axis) == "gyro"
    integral, unit = ("angle", "deg") if gyro else ("velocity", "m/s")
    if label.startswith("GM"):
        return _gauss_markov_meaning(axis, label, integral, unit)
    v = axis.terms[label].value / quantity(axis, label).factor
    if label == "N":
        sample = quantity(axis, "sample")
        scatter = axis.terms["N"].value * math.sqrt(axis.rate_hz) / sample.factor
        return (
            f"White noise: after one hour the {integral} of a perfect integration is uncertain by {v:.3g} {unit}, "
            f"after a minute by {v / math.sqrt(60.0):.3g} {unit} (1 sigma); one sample at {axis.rate_hz:g} Hz scatters "
            f"by {scatter:.3g} {sample.sheet}."
        )
    sheet = quantity(axis, "x").sheet
    if label == "B":
        return (
            f"1/f noise: the flat part of the Allan deviation is 0.664 B = {allan_minimum(v):.3g} {sheet}, and no "
            "averaging makes the bias better known than about that."
        )
    if label == "K":
        return (
            f"Within an hour the bias walks away by {v:.3g} {sheet} (1 sigma), in four hours by twice that; this, and "
            "not B, is what other programs call bias random walk."
        )
    if label == "R":
        return f"The bias changes by {v:.3g} {sheet} in every hour; in most logs that is temperature, not noise."
    return (
        f"Rounding of the output: {v:.3g} {quantity(axis, 'Q').sheet} on every integrated {integral}, however long the "
        "integration."
    )


def read_off_rows(axis: AxisNoise) -> list[tuple[str, str, str, str]]:
    """Values read off the curve beside those fitted: quantity, read off, fitted, and why they differ."""
    read, rows = axis.read_off, []
    x = quantity(axis, "x")
    for letter, key, tau in (("N", "N_at_1s", 1.0), ("K", "K_at_3s", 3.0)):
        fitted = axis.terms.get(letter)
        if not _finite(read.get(key)) or (letter == "K" and fitted is None):
            continue
        q = quantity(axis, letter)
        part = shares(axis, tau).get(letter, 0.0)
        why = f"at {tau:g} s the model's variance is {_shares_text(axis, tau)}"
        if fitted is None:
            why += f"; the model has no {letter}"
        elif part < 0.5:
            why += f", so this reading is not {letter}"
        shown = "-" if fitted is None else f"{fitted.value / q.factor:.4g}"
        rows.append((f"{letter}, read at {tau:g} s [{q.sheet}]", f"{read[key] / q.factor:.4g}", shown, why))
    if _finite(read.get("minimum")) and _finite(read.get("minimum_tau_s")):
        tau, B = read["minimum_tau_s"], axis.terms.get("B")
        shown = "-" if B is None else f"{allan_minimum(B.value) / x.factor:.4g}"
        inside = f"at {span(tau)} the model's variance is {_shares_text(axis, tau)}"
        if read["minimum"] < 0.9 * float(axis.fitted([tau])[0]):
            why = f"{inside}; the curve lies below its model there: few averages are left, and the eye takes the lowest"
        elif B is None:
            why = f"{inside}; without a B in the model the minimum is no bias instability"
        else:
            why = f"{inside}; the minimum holds all of it, 0.664 B only its own part"
        rows.append((f"minimum, and 0.664 B [{x.sheet}]", f"{read['minimum'] / x.factor:.4g}", shown, why))
    return rows


def findings(identification: NoiseIdentification) -> list[tuple[str, Finding]]:
    """All findings with the place they are about, the gravest first."""
    several = [("recording", f) for f in identification.findings]
    several += [(name, f) for name, several in identification.refused.items() for f in several]
    several += [(name, f) for name, axis in identification.axes.items() for f in axis.findings]
    once = list(dict.fromkeys(several))
    return sorted(once, key=lambda item: _SEVERITIES.index(item[1].severity))


def rounded(e: Estimate, factor: float = 1.0) -> tuple[str, str, str]:
    """Value, low and high end of the 95 % interval in units of ``factor`` SI, to the digits that mean something."""
    ends = [v / factor for v in (e.value, e.low, e.high)]
    places = _places(*ends)
    small = bool(e.value) and not 1e-3 <= abs(ends[0]) < 1e6
    value, low, high = (_figure(v, places, small) for v in ends)
    return value, low, high


def located(where: str, finding: Finding) -> str:
    """The text of a finding with the axis it is about, unless it begins with it."""
    return finding.text if finding.text.startswith(where) else f"{where}: {finding.text}"


def with_interval(e: Estimate, factor: float = 1.0) -> str:
    """``value (low to high)``."""
    value, low, high = rounded(e, factor)
    return f"{value} ({low} to {high})"


def span(seconds: float) -> str:
    """A duration in the unit people would use."""
    for size, unit in ((u.HR, "h"), (u.MIN, "min")):
        if seconds >= 1.99 * size:
            return f"{seconds / size:.3g} {unit}"
    return f"{seconds:.3g} s"


def _places(value: float, low: float, high: float) -> int:
    """Decimal places: two digits of the half width of the interval, no more than six and no fewer than two in all."""
    first = math.floor(math.log10(abs(value))) if value and math.isfinite(value) else 0
    half = 0.5 * (high - low)
    if not (math.isfinite(half) and half > 0.0):
        return 3 - first
    return int(np.clip(1 - math.floor(math.log10(half)), 1 - first, 5 - first))


def _figure(value: float, places: int, exponent: bool) -> str:
    if not math.isfinite(value):
        return "unknown" if math.isnan(value) else "unbounded"
    if value and exponent:
        digits = max(math.floor(math.log10(abs(value))) + places, 0)
        return f"{value:.{digits}e}"
    return f"{round(value, places):.{max(places, 0)}f}"


def _ordered(rows: dict[tuple[str, str], dict[str, str]]) -> list[tuple[str, str]]:
    return sorted(rows, key=lambda key: ("QNBKRG".index(key[0][0]), key[0]))


def _finite(value: float | None) -> bool:
    return value is not None and math.isfinite(value)


def _shares_text(axis: AxisNoise, tau: float) -> str:
    parts = [f"{100.0 * v:.0f} % {label}" for label, v in shares(axis, tau).items() if v >= 0.005]
    return ", ".join(parts) or "nothing"


def _gauss_markov_meaning(axis: AxisNoise, label: str, integral: str, unit: str) -> str:
    k = next(i for i in range(len(axis.gauss_markov)) if label.split()[0] == gauss_markov_label(axis, i))
    sigma, tau = (e.value for e in axis.gauss_markov[k])
    if label.endswith("time"):
        return f"After {span(tau)} the bias has forgotten 63 % of what it was."
    variance = 2.0 * sigma**2 * tau * (u.HR + tau * math.expm1(-u.HR / tau))
    over = math.sqrt(variance) / (u.DEG if unit == "deg" else 1.0)
    return (
        f"A bias that wanders with this standard deviation; alone it makes the {integral} of an hour's integration "
        f"uncertain by {over:.3g} {unit}. A filter takes the pair as one state."
    )


def _how_large(axes: Sequence[AxisNoise]) -> list[str]:
    large, long = [], []
    for triad, title in TRIADS.items():
        mine = [a for a in axes if triad_of(a) == triad]
        if not mine:
            continue
        q = quantities(triad)
        N = [a.terms["N"].value / q["N"].factor for a in mine if "N" in a.terms]
        white = f"white noise {_range(N)} {q['N'].sheet}" if N else "no white noise found"
        low = [(*_lowest(a), a) for a in mine if np.isfinite(a.curve.deviation).any()]
        if low:
            white += f", lowest Allan deviation {_range([v / q['x'].factor for v, _, _ in low])} {q['x'].sheet}"
            worst, tau, axis = max(low, key=lambda item: item[0])
            end = _long_enough(axis)[-1]
            finite = f"{worst / q['x'].factor:.3g} {q['x'].sheet}"
            at = f"averaging for {span(tau)} finds the {title}'s bias to about {finite} ({axis.axis}, the worst)"
            later = ", and this log is too short to say whether longer would help" if tau > 0.5 * end else ""
            long.append(at + later)
        large.append(f"{title} {white}")
    sentences = [f"Identified over {span(max(a.duration_s for a in axes))}: {'; '.join(large)}."]
    if long:
        text = "; ".join(long)
        sentences.append(f"{text[0].upper()}{text[1:]}.")
    return sentences


def _long_enough(axis: AxisNoise) -> FloatArray:
    """Averaging times at which enough averages are left for a low point to be no chance; all if there are none."""
    c = axis.curve
    finite = np.isfinite(c.deviation)
    kept = finite & (c.edf >= _SURE)
    times: FloatArray = c.tau[kept if kept.any() else finite]
    return times


def _lowest(axis: AxisNoise) -> tuple[float, float]:
    """Smallest deviation among the times that are sure enough, and its averaging time."""
    among = np.isin(axis.curve.tau, _long_enough(axis))
    k = int(np.flatnonzero(among)[np.argmin(axis.curve.deviation[among])])
    return float(axis.curve.deviation[k]), float(axis.curve.tau[k])


def _believable(identification: NoiseIdentification) -> str:
    inside = [v for v in map(agreement, identification.axes.values()) if math.isfinite(v)]
    text = ""
    if inside:
        worst = min(inside)
        text = (
            f"The models stay inside the bounds of the curves at {100.0 * float(np.mean(inside)):.0f} % of the "
            "averaging times"
            + (f" (worst axis {100.0 * worst:.0f} %)" if worst < float(np.mean(inside)) - 0.005 else "")
        )
    severities = [f.severity for _, f in findings(identification)]
    against = []
    if identification.refused:
        names = [n for n in AXES if n in identification.refused] or list(identification.refused)
        against.append(f"{', '.join(names)} {'was' if len(names) == 1 else 'were'} refused")
    if count := severities.count("warning"):
        against.append(f"there {'is 1 warning' if count == 1 else f'are {count} warnings'}")
    if against:
        return f"{text}{', but ' if text else ''}{' and '.join(against)}: read the findings first."
    return f"{text}{', and ' if text else ''}nothing was found that speaks against the recording."


def _range(values: Sequence[float]) -> str:
    low, high = f"{min(values):.3g}", f"{max(values):.3g}"
    return low if low == high else f"{low} to {high}"
