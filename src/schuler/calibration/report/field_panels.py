"""Panels of a field calibration: estimates and uncertainties over the log, its rests, its innovations."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TypeAlias

import numpy as np

from schuler.arrays import FloatArray
from schuler.calibration.field.calibration import FieldCalibration
from schuler.calibration.field.history import FieldHistory
from schuler.calibration.result.parameters import AXES, in_gauge, vector
from schuler.calibration.result.sheet import sheet
from schuler.filtering.kinds import kind_display
from schuler.plotting.figure import TIME, Band, Figure, Item, Line, Markers, Panel, Span, band, level, line, view
from schuler.sensors.errors import ImuErrors
from schuler.units import DEG_PER_HR, MG

#: True values: an IMU's errors, or SI values by name; what has no name is not drawn.
Truth: TypeAlias = ImuErrors | Mapping[str, float]

TENTH = 0.1
_ROLES = ("axis_x", "axis_y", "axis_z")
_PLACES = ("first", "second", "third")
_UNITS = {"accel": ("mg", MG), "gyro": ("deg/h", DEG_PER_HR)}
_SIZES = {"accel": "specific force less gravity", "gyro": "rate about the vertical less the Earth's"}
#: Families in the order of the figures: accelerometers, then gyroscopes.
_ORDER = ("b_a", "S_a", "M_a", "b_g", "S_g", "M_g", "G_g")


def field_panels(result: FieldCalibration, truth: Truth | None = None) -> list[Figure]:
    """Every figure of a field calibration.

    Parameters
    ----------
    found : FieldCalibration
    truth : ImuErrors or mapping of str to float, optional
        True errors; an :class:`~schuler.sensors.errors.ImuErrors` is brought into the axes of the calibration, a
        mapping has to be in them. SI.
    """
    figures = (
        convergence(result),
        estimates(result, truth),
        rests(result),
        innovations(result),
    )
    return [f for f in figures if f is not None]


def convergence(result: FieldCalibration) -> Figure | None:
    """Square root of the variance over that before the log, a panel for each group of parameters."""
    history = result.history
    if not len(history.t):
        return None
    left = np.maximum(history.normalised, 1e-9)
    low = 0.7 * float(left.min())
    panels = []
    for names in groups(history.names):
        items: list[Item] = [level(_span(history), TENTH, "level", "a tenth")]
        for name, role, label in zip(names, _ROLES, _PLACES, strict=False):
            items.append(line(history.t, left[:, history.names.index(name)], role, label))
        panels.append(
            Panel(
                TIME,
                "left [-]",
                tuple(items),
                title=", ".join(names),
                log=True,
                x_limits=_span(history),
                y_limits=(low, 1.5),
            )
        )
    return Figure(
        "field_convergence",
        "Uncertainty left",
        "One sigma over what was known before the log: a parameter falls where a turn or a pose shows it, and one that "
        "stays at 1 has not been seen; ten times better is below the line.",
        tuple(panels),
        columns=3,
    )


def estimates(result: FieldCalibration, truth: Truth | None = None) -> Figure | None:
    """Estimates with three standard deviations in data-sheet units, and the true values if they are known."""
    history = result.history
    if not len(history.t):
        return None
    true = _true(truth, history.names)
    panels = []
    for names in groups(history.names):
        factor, unit = sheet(names[0]).factor, sheet(names[0]).unit
        bands: list[Item] = []
        lines: list[Item] = []
        values: list[FloatArray] = []
        edges: list[FloatArray] = []
        for name, role, label in zip(names, _ROLES, _PLACES, strict=False):
            i = history.names.index(name)
            value, sigma = history.values[:, i] / factor, history.sigma[:, i] / factor
            edge = value - 3.0 * sigma, value + 3.0 * sigma
            bands.append(band(history.t, *edge, f"{role}_band", f"{label} ±3 sigma"))
            lines.append(line(history.t, value, role, label))
            values.append(value)
            edges += edge
            if name in true:
                lines.append(level(_span(history), true[name] / factor, "reference", "true"))
                values.append(np.array([true[name] / factor]))
        panels.append(
            Panel(
                TIME,
                f"value [{unit}]",
                (*bands, *lines),
                title=", ".join(names),
                x_limits=_span(history),
                y_limits=view(values, edges),
            )
        )
    caption = " and should hold the true value" if true else ""
    return Figure(
        "field_estimates",
        "Estimates over the log",
        "What would have been found from the log up to each time, with three standard deviations: the band narrows "
        f"where the log shows a parameter{caption}.",
        tuple(panels),
        columns=3,
    )


def rests(result: FieldCalibration) -> Figure | None:
    """The log's rests: which way was up, and what the sensors read too much there, uncalibrated and calibrated."""
    middle = 0.5 * (result.rests.start + result.rests.stop)
    shade = [
        Span(float(a), float(b), "expected", "" if k else "at rest")
        for k, (a, b) in enumerate(zip(result.rests.start, result.rests.stop, strict=True))
    ]
    residuals = {n: r for n, r in result.calibration.residuals.items() if n in _UNITS and len(r.value) == len(middle)}
    if not residuals:
        return None
    panels = []
    up = next((r.direction for r in residuals.values() if r.direction is not None), None)
    if up is not None:
        items = [
            Line(*_steps(result.rests.start, result.rests.stop, up[:, i]), role, AXES[i])
            for i, role in enumerate(_ROLES)
        ]
        panels.append(Panel(TIME, "up in body axes [-]", (*shade, *items), y_limits=(-1.08, 1.08)))
    for name, r in residuals.items():
        unit, factor = _UNITS[name]
        floor = max(1e-3 * float(np.median(r.sigma)), 1e-12) / factor  # perfect data leave zeros
        drawn: list[Item] = [*shade]
        if r.before is not None:
            drawn.append(Markers(middle, np.maximum(np.abs(r.before) / factor, floor), "smoothed", "before"))
        drawn.append(Markers(middle, np.maximum(np.abs(r.value) / factor, floor), "filtered", "after"))
        drawn.append(Line(middle, np.maximum(r.sigma / factor, floor), "level", "1 sigma of the mean"))
        before = "" if r.before is None else f"{np.sqrt(np.mean(r.before**2)) / factor:.3g} before, "
        title = f"{_SIZES[name]}: rms {before}{r.rms / factor:.3g} {unit} after"
        panels.append(Panel(TIME, f"[{unit}]", tuple(drawn), title=title, log=True))
    return Figure(
        "field_rests",
        "Rests",
        "Each pose the unit rested in, and how far it reads off there with the uncalibrated sensor and after the "
        "calibration: about as far as noise explains, below two of its sigma in nineteen of twenty rests.",
        tuple(panels),
    )


def innovations(result: FieldCalibration) -> Figure | None:
    """Innovations over their own sigma, by kind of measurement."""
    panels = []
    for kind, v in result.innovations.items():
        if not len(v.t):
            continue
        limits = float(v.t[0]), float(v.t[-1])
        items: list[Item] = [
            Band(np.array(limits), np.full(2, -2.0), np.full(2, 2.0), "expected", "±2 sigma"),
            level(limits, 0.0, "level"),
        ]
        for i, axis in enumerate(kind_display(kind).axes):
            items.append(Markers(v.t, v.z[:, i], _ROLES[i], axis))
        title = f"{kind_display(kind).text}: mean square {np.mean(v.z**2):.2f}"
        reach = max(4.0, 1.05 * float(np.abs(v.z).max()))
        panels.append(Panel(TIME, "innovation [sigma]", tuple(items), title=title, y_limits=(-reach, reach)))
    if not panels:
        return None
    return Figure(
        "field_innovations",
        "Innovations",
        "What each second of rest said that was not expected: nineteen of twenty inside of the band and no pattern if "
        "noise and model are right. A mean square above 1 is a hand that is not steady, or noise stated too small.",
        tuple(panels),
    )


def groups(names: tuple[str, ...]) -> list[tuple[str, ...]]:
    """Parameters that share a panel, at most three: a triad's biases, its scale factors, a row of a matrix."""
    result: dict[tuple[int, str], list[str]] = {}
    for name in names:
        diagonal = name[0] == "M" and name[4] == name[5]
        family = f"S{name[1:3]}" if diagonal else name[:3]
        row = name[4] if family in ("M_g", "G_g") else ""
        result.setdefault((_ORDER.index(family), row), []).append(name)
    return [tuple(result[key]) for key in sorted(result)]


def _true(truth: Truth | None, names: tuple[str, ...]) -> dict[str, float]:
    if truth is None:
        return {}
    if isinstance(truth, ImuErrors):
        return dict(zip(names, vector(in_gauge(truth, "upper"), names).tolist(), strict=True))
    return {name: float(truth[name]) for name in names if name in truth}


def _span(history: FieldHistory) -> tuple[float, float]:
    return float(history.t[0]), float(history.t[-1])


def _steps(start: FloatArray, stop: FloatArray, y: FloatArray) -> tuple[FloatArray, FloatArray]:
    """A stroke for each rest, as one line that is broken between them."""
    gap = np.full_like(start, np.nan)
    return np.stack([start, stop, stop], axis=1).ravel(), np.stack([y, y, gap], axis=1).ravel()
