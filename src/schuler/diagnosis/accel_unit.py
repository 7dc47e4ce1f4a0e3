"""Unit of the specific force, and rates or increments: from gravity at rest.

Without rest gravity is bounded only: a sample is in the median no shorter than about gravity, since shaking adds to it,
and means over some seconds are no longer than some gravities, to which only a foot that swings about the hip gets.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from schuler import units
from schuler.arrays import FloatArray
from schuler.diagnosis.result import Finding
from schuler.recording.io.checks import norms
from schuler.standstill.unscaled import UnscaledRests

UNITS = {"m/s^2": 1.0, "g": units.G0, "mg": units.MG, "ug": units.UG, "ft/s^2": units.FT, "cm/s^2": 0.01}
_RATE_OF = {"m/s": "m/s^2", "ft/s": "ft/s^2", "cm/s": "cm/s^2", "rad": "rad/s", "deg": "deg/s", "mrad": "mrad/s"}
_NEAR = 0.06  # relative, for a unit to fit: uncalibrated MEMS sensors are 3 % off
_NEAR_COUNTS = 0.05  # the same for counts in a g, whose rivals are a factor of two away
_COUNTS_LOG2 = (8, 14)
_OFF = 0.04  # relative error at rest that is worth a word
_LEAST_REST_S = 3.0  # rest in which a few per cent are worth a word
_BOUNDS = (0.7, 2.5)  # least median norm, largest norm of means, of gravity, of a body that never rests
_MEAN_S = 5.0  # means of a moving body are taken over so long
_STEADY_S = 0.25  # windows in which even a running foot is steady now and then


@dataclass(frozen=True)
class Scaling:
    """Factor and kind with which the numbers of a sensor become SI rates.

    Attributes
    ----------
    factor : float
        Multiply by it.
    kind : {"rate", "increment"}
        What the log really holds.
    known : bool
        Whether there was evidence.
    """

    factor: float = 1.0
    kind: str = "rate"
    determined: bool = False


def stated_factor(options: dict[str, Any], group: str) -> tuple[str, float]:
    """Unit stated for a group of columns when the log was read, and its factor; SI if none was."""
    from schuler.exceptions import SchulerError
    from schuler.recording.io.hint_texts import parse_units

    si = {"accel": "m/s^2", "gyro": "rad/s"}[group]
    entries = [options, *(o for o in options.values() if isinstance(o, dict))]
    for entry in entries:
        text = entry.get("units")
        if not isinstance(text, str):
            continue
        try:
            unit = parse_units(text, entry.get("kind", "rate")).get(group)
        except SchulerError:
            continue
        if unit is not None:
            try:
                value = units.parse_unit(unit).factor
            except SchulerError:
                value = 1.0
            # increments are told by the unit of their rate
            unit = _RATE_OF.get(unit, unit.removesuffix("*s")) if entry.get("kind") == "increment" else unit
            return unit, value
    return si, 1.0


def level_at_rest(accel: FloatArray, rests: UnscaledRests) -> tuple[float, bool]:
    """Norm of the specific force at rest, or the median of all if there is no rest; and whether there was one."""
    if len(rests):
        weight = rests.t[:, 1] - rests.t[:, 0]
        # a face of an uncalibrated sensor may be off: the median over rests
        order = np.argsort(sizes := np.linalg.norm(rests.accel, axis=1))
        share = np.cumsum(weight[order])
        return float(sizes[order][np.searchsorted(share, 0.5 * share[-1])]), True
    return float(np.median(norms(accel), overwrite_input=True)), False


def accel_unit(
    accel: FloatArray, rests: UnscaledRests, interval: float, kind: str, gravity: float, stated: tuple[str, float]
) -> tuple[list[Finding], Scaling]:
    """Findings ``accel_unit``, ``accel_scale``, ``kind``, ``no_gravity``, and what makes the numbers right.

    Parameters
    ----------
    accel : ndarray, shape (n, 3)
        Mean specific force over the samples as read.
    rests : UnscaledRests
        Rests of the same log.
    interval : float
        [s]
    kind : {"rate", "increment"}
        What the log was said to hold.
    gravity : float
        At the place. [m/s^2]
    stated : (str, float)
        Unit stated, and its factor.
    """
    level, rested = level_at_rest(accel, rests)
    bounds = (level, level) if rested else (_norm_of_means(accel, interval), level)
    evidence: dict[str, Any] = {"norm_m_s2": level, "gravity_m_s2": gravity, "rest_s": rests.seconds}
    where = f"over {rests.seconds:.0f} s of rest" if rested else "in the median (no rest was found)"
    if level <= 0.0:
        return [Finding("dead_axis", "error", "the accelerometer shows zero throughout", 1.0, "", evidence)], Scaling()
    mean = rests.accel.mean(axis=0) if rested else accel.mean(axis=0)
    if _no_gravity(accel, mean, level, interval):
        text = (
            f"the mean specific force is only {np.linalg.norm(mean):.3g} m/s^2 and no larger than its noise: gravity "
            "was taken out (linear acceleration of a phone or a filter), and nothing can be navigated from that"
        )
        fix = "export the raw accelerometer (a phone's 'accelerometer with g', not 'linear acceleration')"
        # as it stands the log may hold gravity, if its norm is large enough
        sure = 0.98 if level < 0.5 * gravity else 0.8
        return [Finding("no_gravity", "error", text, sure, fix, evidence)], Scaling(determined=False, kind=kind)
    if not rested:
        return _without_rest(bounds, interval, kind, gravity, stated, evidence)
    need = gravity / level
    loose = 0.02
    if abs(need - 1.0) <= 0.15 + loose:
        if abs(need - 1.0) > _OFF and rests.seconds > _LEAST_REST_S:
            text = (
                f"the norm of specific force is {level:.4g} m/s^2 {where}, {100.0 * (level / gravity - 1.0):+.1f} % "
                "off gravity: scale factors or biases need calibration"
            )
            finding = Finding("accel_scale", "warning", text, 0.9, f"scale='accel={need:.5g}'", evidence)
            return [finding], Scaling(need, kind, True)
        return [], Scaling(1.0, kind, True)
    return _unit_findings(need, level, where, interval, kind, stated, evidence, loose)


def _norm_of_means(accel: FloatArray, interval: float) -> float:
    """Median norm of the means over some seconds."""
    per = min(max(10, round(_MEAN_S / interval)), len(accel))
    m = len(accel) // per
    means = accel[: m * per].reshape(m, per, 3).mean(axis=1)
    return float(np.median(np.linalg.norm(means, axis=1)))


def _without_rest(
    bounds: tuple[float, float],
    interval: float,
    kind: str,
    gravity: float,
    stated: tuple[str, float],
    evidence: dict[str, Any],
) -> tuple[list[Finding], Scaling]:
    """Finding on the unit of a log in which nothing rests: none while gravity lies between its bounds.

    Parameters
    ----------
    bounds : (float, float)
        Norm of means over some seconds, and median norm of a sample, as read.
    interval, kind, gravity, stated, evidence
        See :func:`accel_unit`.
    """
    low, high = gravity * _BOUNDS[0] / bounds[1], gravity * _BOUNDS[1] / max(bounds[0], 1e-300)
    evidence = {**evidence, "norm_of_means_m_s2": bounds[0], "factor_between": [low, high]}
    if low <= 1.0 <= high:
        # means and samples of one norm, that of gravity: smooth motion
        smooth = bounds[0] > 0.9 * bounds[1] and abs(bounds[1] / gravity - 1.0) < 0.2
        return [], Scaling(1.0, kind, smooth)
    name, factor = stated
    other = "rate" if kind == "increment" else "increment"
    by_kind = interval if kind == "increment" else 1.0 / interval
    options = [
        (0.0 if unit in ("m/s^2", "g") else 0.3, value, unit, kind) for unit, value in UNITS.items() if unit != name
    ]
    options.append((0.2, UNITS.get(name, 1.0) * by_kind, name, other))
    fits = sorted((cost, unit, what, value) for cost, value, unit, what in options if low <= value / factor <= high)
    sure = 0.98 if max(low, 1.0 / high) > 3.0 else 0.9
    text = (
        f"nothing rests, yet specific force has a norm of {bounds[1]:.4g} m/s^2 in the median and its means over "
        f"{_MEAN_S:.0f} s one of {bounds[0]:.4g} m/s^2, which gravity cannot be"
    )
    if not fits:
        text += ": no usual unit makes it so, the numbers are counts or have a scale of their own"
        fix = "the scale of the data sheet, scale='accel=...' (for calibrations units='counts,counts')"
        scaling = Scaling(float(np.sqrt(low * high)), kind, True)
        return [Finding("accel_unit", "error", text, min(sure, 0.95), fix, evidence)], scaling
    _, unit, what, value = fits[0]
    rivals = "".join(f"; or {u} as {w}s" for _, u, w, _ in fits[1:2])
    scaling = Scaling(value / factor, what, True)
    if what != kind:
        text += f": the log holds {what}s, not {kind}s{rivals}"
        fix = "kind='increment', units='m/s,rad' (or their units)" if what == "increment" else "kind='rate'"
        return [Finding("kind", "error", text, sure, fix, evidence)], scaling
    text += f": the numbers are {unit}, not {name}{rivals}"
    fix = f"units='{unit},...' (or units='accel={unit}')"
    return [Finding("accel_unit", "error", text, sure, fix, evidence)], scaling


def _no_gravity(accel: FloatArray, mean: FloatArray, level: float, interval: float) -> bool:
    """A mean lost in the scatter of the log: units do not matter, since only the two are compared."""
    overall = np.linalg.norm(accel.mean(axis=0))
    scatter = float(np.sqrt(np.mean(accel.var(axis=0))))
    lost = overall < 0.5 * scatter and np.linalg.norm(mean) < 0.5 * max(scatter, 0.5 * level) and _mean_is_noise(accel)
    return bool(lost and not _gravity_shows(accel, interval))


def _gravity_shows(accel: FloatArray, interval: float) -> bool:
    """Whether the steadiest quarter of short windows has means of one norm, as gravity in any attitude has."""
    per = max(5, round(_STEADY_S / interval))
    m = len(accel) // per
    if m < 20:
        return True
    y = accel[: m * per].reshape(m, per, 3)
    steady = np.argsort(y.std(axis=1).max(axis=1))[: m // 4]
    norm = np.linalg.norm(y.mean(axis=1)[steady], axis=1)
    low, middle, high = np.quantile(norm, (0.1, 0.5, 0.9))
    return bool(high - low < 0.7 * middle and middle > 0.3 * np.median(norms(accel), overwrite_input=True))


def _mean_is_noise(accel: FloatArray) -> bool:
    """No tenth of the log has a mean that stands out of its own scatter, as gravity in any attitude would."""
    if len(accel) < 40:  # twentieths of one sample have no scatter
        return False
    parts = np.array_split(accel, 20)
    ratio = [np.linalg.norm(p.mean(axis=0)) / max(float(np.linalg.norm(p.std(axis=0))), 1e-300) for p in parts]
    return bool(np.median(ratio) < 1.0)


def _counts_in_g(scale: float) -> int | None:
    """The power of two that a scale comes near, from 8 bits over 1 g to 16 over 2 g; None where none is near. [1/g]

    The norm at rest has the bias in it, which is 0.08 g at most on the data sheets of cheap sensors.
    """
    power = round(float(np.log2(units.G0 / scale)))
    near = abs(np.log(units.G0 / scale / 2.0**power)) < _NEAR_COUNTS
    return 2**power if near and _COUNTS_LOG2[0] <= power <= _COUNTS_LOG2[1] else None


def _unit_findings(
    need: float,
    level: float,
    where: str,
    interval: float,
    kind: str,
    stated: tuple[str, float],
    evidence: dict[str, Any],
    loose: float,
) -> tuple[list[Finding], Scaling]:
    name, factor = stated
    raw = need * factor  # makes the numbers of the file SI
    other = "rate" if kind == "increment" else "increment"
    by_kind = interval if kind == "increment" else 1.0 / interval
    options: list[tuple[float, float, str, str]] = []  # cost, distance, unit, kind
    for unit, value in UNITS.items():
        usual = 0.0 if unit in ("m/s^2", "g") else 0.3
        if unit != name:
            options.append((usual, abs(np.log(raw / value)), unit, kind))
        # a kind that is wrong with the unit as stated is likelier than both wrong
        likely = 0.0 if kind == "increment" else 0.2
        options.append((likely if unit == name else 0.8 + usual, abs(np.log(raw / (value * by_kind))), unit, other))
    fits = sorted((cost + dist / _NEAR, dist, unit, what) for cost, dist, unit, what in options if dist < _NEAR + loose)
    # half as much again is an aircraft's in a turn that never ends, which looks like rest
    sure = 0.99 if abs(np.log(need)) > 0.6 else 0.9
    if not fits:
        text = (
            f"the norm of specific force is {level:.4g} m/s^2 {where}, where gravity is 9.8: no usual unit makes it "
            "so, the numbers are counts or have a scale of their own"
        )
        if (lsb := _counts_in_g(raw)) is not None:
            text += f" ({lsb} counts in a g, but for the bias)"
            raw, need = units.G0 / lsb, units.G0 / lsb / factor
        fix = f"scale='accel={need:.6g}'" if name == "m/s^2" else f"units='accel=m/s^2', scale='accel={raw:.6g}'"
        fix += " (for calibrations also units='counts,counts')"
        return [Finding("accel_unit", "error", text, sure, fix, evidence)], Scaling(need, kind, True)
    _, dist, unit, what = fits[0]
    confidence = sure
    rivals = "".join(f"; or {u} as {w}s" for _, _, u, w in fits[1:2])
    findings = []
    evidence = {**evidence, "factor": need, "distance": dist, "fits": [f"{u} {w}" for _, _, u, w in fits]}
    if what != kind:
        text = (
            f"the norm of specific force is {level:.4g} m/s^2 {where}, which times 9.8/{level:.3g} = "
            f"{'1/interval' if kind == 'rate' else 'the interval'} is gravity: the log holds {what}s, not {kind}s"
            f"{rivals}"
        )
        fix = "kind='increment', units='m/s,rad' (or their units)" if what == "increment" else "kind='rate'"
        findings.append(Finding("kind", "error", text, confidence, fix, evidence))
    if unit != name:
        text = (
            f"the norm of specific force is {level:.4g} m/s^2 {where}, where gravity is 9.8: the numbers are {unit}, "
            f"not {name}{rivals if what == kind else ''}"
        )
        fix = f"units='{unit},...' (or units='accel={unit}')" if what == "rate" else f"units='accel={unit}*s'"
        findings.append(Finding("accel_unit", "error", text, confidence, fix, evidence))
    return findings, Scaling(need, what, True)
