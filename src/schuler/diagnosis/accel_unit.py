"""Unit of the specific force, and rates or increments: from gravity at rest."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from schuler import units
from schuler.arrays import FloatArray
from schuler.diagnosis.result import Finding
from schuler.standstill.unscaled import UnscaledRests

UNITS = {"m/s^2": 1.0, "g": units.G0, "mg": units.MG, "ug": units.UG, "ft/s^2": units.FT, "cm/s^2": 0.01}
_RATE_OF = {"m/s": "m/s^2", "ft/s": "ft/s^2", "cm/s": "cm/s^2", "rad": "rad/s", "deg": "deg/s", "mrad": "mrad/s"}
_NEAR = 0.06  # relative, for a unit to fit: uncalibrated MEMS sensors are 3 % off
_OFF = 0.04  # relative error at rest that is worth a word


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
        order = np.argsort(norms := np.linalg.norm(rests.accel, axis=1))
        share = np.cumsum(weight[order])
        return float(norms[order][np.searchsorted(share, 0.5 * share[-1])]), True
    return float(np.median(np.linalg.norm(accel, axis=1))), False


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
        return [Finding("no_gravity", "error", text, 0.95, fix, evidence)], Scaling(determined=False, kind=kind)
    need = gravity / level
    loose = 0.02 if rested else 0.05
    if abs(need - 1.0) <= 0.15 + loose:
        if abs(need - 1.0) > _OFF + (0.0 if rested else 0.06):
            text = (
                f"the norm of specific force is {level:.4g} m/s^2 {where}, {100.0 * (level / gravity - 1.0):+.1f} % "
                "off gravity: scale factors or biases need calibration"
            )
            finding = Finding("accel_scale", "warning", text, 0.9, f"scale='accel={need:.5g}'", evidence)
            return [finding], Scaling(need, kind, True)
        return [], Scaling(1.0, kind, True)
    return _unit_findings(need, level, where, interval, kind, stated, evidence, loose)


def _no_gravity(accel: FloatArray, mean: FloatArray, level: float, interval: float) -> bool:
    """A mean lost in the scatter of the log: units do not matter, since only the two are compared."""
    overall = np.linalg.norm(accel.mean(axis=0))
    scatter = float(np.sqrt(np.mean(accel.var(axis=0))))
    return bool(
        overall < 0.5 * scatter and np.linalg.norm(mean) < 0.5 * max(scatter, 0.5 * level) and _mean_is_noise(accel)
    )


def _mean_is_noise(accel: FloatArray) -> bool:
    """No tenth of the log has a mean that stands out of its own scatter, as gravity in any attitude would."""
    parts = np.array_split(accel, 20)
    ratio = [np.linalg.norm(p.mean(axis=0)) / max(float(np.linalg.norm(p.std(axis=0))), 1e-300) for p in parts]
    return bool(np.median(ratio) < 1.0)


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
    if not fits:
        text = (
            f"the norm of specific force is {level:.4g} m/s^2 {where}, where gravity is 9.8: no usual unit makes it "
            "so, the numbers are counts or have a scale of their own"
        )
        fix = f"scale='accel={need:.6g}'" if name == "m/s^2" else f"units='accel=m/s^2', scale='accel={raw:.6g}'"
        fix += " (for calibrations also units='counts,counts')"
        return [Finding("accel_unit", "error", text, 0.8, fix, evidence)], Scaling(need, kind, True)
    _, dist, unit, what = fits[0]
    confidence = 0.97 if len(fits) == 1 else 0.75
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
