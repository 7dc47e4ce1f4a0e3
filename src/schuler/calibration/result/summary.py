"""A calibration in words and as a table of text."""

from __future__ import annotations

import numpy as np

from schuler.calibration.magnetometer.calibrate import magnetometer_words
from schuler.calibration.result.halves import halves_words
from schuler.calibration.result.parameters import GAUGES
from schuler.calibration.result.result import CalibrationResult, Residuals
from schuler.calibration.result.sheet import probability, rounded, sheet
from schuler.units import DEG

_STATUS = {
    "ok": "can be used",
    "warning": "can be used with care",
    "refused": "cannot be used",
}
# A variance of unit weight this improbable, in either direction, says that the noise or the model is not as assumed.
_IMPROBABLE = 1e-3


def summary(result: CalibrationResult) -> str:
    """Parameters with uncertainty in data-sheet units and SI, verdicts, residuals, as text.

    Parameters
    ----------
    result : CalibrationResult

    Returns
    -------
    str
        Some forty lines for a full calibration. The last column is the uncertainty in percent of what it was before.
    """
    lines = [headline(result), *_wrapped(verdicts(result)), ""]
    heads = ("parameter", "value", "1 sigma", "unit", "SI value", "1 sigma", "prior")
    lines.append(f"{heads[0]:<10}{heads[1]:>14}{heads[2]:>16}  {heads[3]:<8}{heads[4]:>15}{heads[5]:>11}{heads[6]:>7}")
    for name, value, spread, unit, si, si_sigma, left in rows(result):
        lines.append(f"{name:<10}{value:>14}{spread:>16}  {unit:<8}{si:>15}{si_sigma:>11}{left:>7}".rstrip())
    lines.append(f"body axes (gauge {result.gauge}): {GAUGES[result.gauge]}")
    lines += [""] + [f"{name}: {text}" for name, text in facts(result)]
    return "\n".join(lines)


def headline(result: CalibrationResult) -> str:
    """Method and whether the result can be used, in one line."""
    return f"{result.method} calibration: {result.status}, {_STATUS[result.status]}"


def verdicts(result: CalibrationResult) -> list[str]:
    """What a reader must know: what is not determined and why, what to do, whether the residuals fit the noise.

    Parameters
    ----------
    result : CalibrationResult

    Returns
    -------
    list of str
        Those of the method; one more for each parameter that is not determined and in none of them, with how far the
        poses came along its axis; one on the variance of unit weight if it is improbable; advice.
    """
    sentences = [_sentence(v) for v in result.verdicts]
    stated = " ".join(result.verdicts)
    lost = [n for n, s in zip(result.names, result.sigma, strict=True) if not np.isfinite(s)]
    sentences += [
        f"{name}, {sheet(name).meaning}, not determined{_reach(result, name)}."
        for name in lost
        if name not in stated and sheet(name).meaning not in stated
    ]
    p = unit_weight_probability(result)
    if p is not None and min(p, 1.0 - p) < _IMPROBABLE:
        v = result.variance_of_unit_weight
        # whether the method has enlarged its uncertainties for it is for the method to say
        why = "it is larger, the unit moved, or the model lacks something" if v > 1.0 else "it is smaller than stated"
        sentences.append(f"Residuals are {np.sqrt(v):.2g} times what the stated noise makes them: {why}.")
    if result.next_pose and result.next_pose not in stated:
        sentences.append(f"Next: {_sentence(result.next_pose)}")
    return sentences


def unit_weight_probability(result: CalibrationResult) -> float | None:
    """Probability of a variance of unit weight as large as this or larger; None without redundancy."""
    from scipy.special import chdtrc

    if result.freedom < 1 or not np.isfinite(result.variance_of_unit_weight):
        return None
    return float(chdtrc(result.freedom, result.variance_of_unit_weight * result.freedom))


def rows(result: CalibrationResult) -> list[tuple[str, str, str, str, str, str, str]]:
    """Name, value and 1 sigma in data-sheet units, the unit, both in SI, percent left of what was known before."""
    table = []
    observability = result.observability
    for name in (*result.names, *result.fixed):
        value, sigma = result[name]
        s = sheet(name)
        number, spread = rounded(value / s.factor, sigma / s.factor)
        si = "-" if not np.isfinite(sigma) else f"{value:+.6g}"
        si_sigma = "-" if not np.isfinite(sigma) else f"{sigma:.2g}" if name in result.names else "held"
        if name in result.fixed:
            spread = "held"
        left = observability.get(name)
        share = "" if left is None else "100 %" if not np.isfinite(left) else f"{100.0 * left:.2g} %"
        table.append((name, number, spread, s.unit, si, si_sigma, share))
    return table


def facts(result: CalibrationResult) -> list[tuple[str, str]]:
    """Condition, unit weight, residuals, temperature, nominal factors: name and text each."""
    entries = []
    if np.isfinite(result.condition):
        entries.append(("condition number", f"{result.condition:.3g}"))
    p = unit_weight_probability(result)
    if p is not None:
        text = f"{result.variance_of_unit_weight:.3g} with {result.freedom} degrees of freedom, {probability(p)}"
        entries.append(("variance of unit weight", text))
    entries += [(f"residuals {name}", residual_words(r)) for name, r in result.residuals.items() if len(r.value)]
    entries += [("strongest correlation", text) for text in correlations(result, 1)]
    magnetic = magnetometer_words(result)
    if magnetic:
        entries.append(("magnetometer", magnetic))
    agreement = halves_words(result)
    if agreement:
        entries.append(("halves", agreement))
    if result.temperature is not None:
        entries.append(("temperature", f"{result.temperature:.1f} degC"))
    if result.nominal != (1.0, 1.0):
        accel, gyro = result.nominal
        entries.append(("nominal factors", f"{accel:.8g} m/s^2 and {gyro:.8g} rad/s per unit of the log"))
    return entries


def residual_words(r: Residuals) -> str:
    """RMS before and after, the number, and the largest."""
    before = "" if r.before is None else f", before {np.sqrt(np.mean(np.square(r.before))):.3g} {r.unit}"
    k = int(np.argmax(np.abs(r.value / np.where(r.sigma > 0.0, r.sigma, 1.0))))
    largest = f", largest {abs(r.value[k]) / r.sigma[k]:.1f} sigma at {r.label[k]}" if r.sigma[k] > 0.0 else ""
    return f"rms {r.rms:.3g} {r.unit}{before}, {len(r.value)} of them{largest}"


def correlations(result: CalibrationResult, most: int, above: float = 0.9) -> list[str]:
    """The strongest correlations, as ``"b_a_x and M_a_xx +0.97"``; those above ``above``, ``most`` of them at most."""
    C = np.triu(result.correlation, 1)
    order = np.argsort(-np.abs(C), axis=None, kind="stable")[:most]
    pairs = [np.unravel_index(k, C.shape) for k in order if C.size]
    return [f"{result.names[i]} and {result.names[j]} {C[i, j]:+.3f}" for i, j in pairs if abs(C[i, j]) > above]


def _reach(result: CalibrationResult, name: str) -> str:
    """How far the poses came along the axis of an accelerometer's parameter."""
    directions = [r.direction for r in result.residuals.values() if r.direction is not None and len(r.direction)]
    if not directions or name[2:4] != "a_" or name[0] not in "bMQ":
        return ""
    axis = name[-1]
    along = np.abs(np.concatenate(directions)[:, "xyz".index(axis)])
    angle = np.arcsin(min(float(along.max()), 1.0)) / DEG
    return f": no pose with {axis} beyond {angle:.0f} degrees out of the level" if angle < 60.0 else ""


def _sentence(text: str) -> str:
    text = text.strip()
    return text if text.endswith((".", "!", "?")) else f"{text}."


def _wrapped(sentences: list[str]) -> list[str]:
    import textwrap

    return [line for s in sentences for line in textwrap.wrap(s, 100, initial_indent="- ", subsequent_indent="  ")]
