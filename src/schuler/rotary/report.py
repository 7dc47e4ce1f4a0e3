"""Figures and HTML page of rotation: schemes, modulated biases, errors, rates, the front of a search, calibration."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from schuler.arrays import ArrayLike, FloatArray
from schuler.budget.covariance import QUANTITIES
from schuler.plotting import figure as content
from schuler.plotting import parts
from schuler.plotting.figure import Figure, Item, Line, Markers, Panel, Text
from schuler.plotting.page import Section, plotly_script, whole_page
from schuler.units import DEG, DEG_PER_HR

if TYPE_CHECKING:
    from schuler.plotting.table import ResultTable
    from schuler.rotary.calibration_result import RotationCalibration
    from schuler.rotary.schedule import Schedule
    from schuler.rotary.search.comparison import ScenarioComparison
    from schuler.rotary.search.search_result import Candidate, SchemeSearch


_AXES = ("axis_x", "axis_y", "axis_z")
_BEHIND = ("axis_x_band", "axis_y_band", "axis_z_band")
_POINTS = 1500
_TURN = 2.0 * np.pi
_ROLES = {"conventional": ("smoothed", "sigma_smoothed"), "rotary": ("filtered", "sigma")}


def scheme_figure(schedule: Schedule, duration: float, name: str = "scheme") -> Figure:
    """Three-dimensional picture of where the axes of the IMU point in the vehicle, and the platform's angles over time.

    Parameters
    ----------
    schedule : Schedule
    duration : float
        Length of the mission; the picture shows one cycle of it. [s]
    name : str
        Name of the figure.
    """
    end = cycle(schedule, duration)
    t = np.linspace(0.0, end, _POINTS)
    C = schedule.C_bs(t)
    items: list[Item] = _sphere()
    for k, (role, behind) in enumerate(zip(_AXES, _BEHIND, strict=True)):
        seen, depth = projected(C[:, :, k])
        for near, look, label in ((False, behind, ""), (True, role, f"IMU {'xyz'[k]}")):
            hidden = (depth >= 0.0) != near
            x, y = seen.T.copy()
            x[hidden] = y[hidden] = np.nan
            items.append(Line(x, y, look, label))
        items.append(Markers(seen[:1, 0], seen[:1, 1], role))
    resting = np.all(np.abs(schedule.rates(t)) < 1e-9, axis=1)
    if resting.any() and not resting.all():
        seen, depth = projected(C[resting, :, 0])
        place = np.unique(np.round(seen[depth >= 0.0], 3), axis=0)
        items.append(Markers(place[:, 0], place[:, 1], "unused", "IMU x at rest"))
    for k, axis in enumerate(schedule.axes):
        ends, _ = projected(np.outer((-1.35, 1.35), axis))
        items.append(Line(ends[:, 0], ends[:, 1], "reference", "axes of the platform" if k == 0 else ""))
        items.append(Text(float(ends[1, 0]), float(ends[1, 1]), f"axis {k}", "right"))
    picture = Panel(
        "", "", tuple(items), "where the IMU's axes point, seen from ahead, right and above; dots: start", equal=True,
        grid=False, bare=True, height=2.4,
    )  # fmt: skip
    shown = min(duration, 4.0 * end)
    t = np.linspace(0.0, shown, _POINTS)
    angles = schedule.angles(t) / DEG
    rates = schedule.rates(t) / DEG
    panels = [picture]
    for label, values, least in (("angle [deg]", angles, 1.0), ("rate [deg/s]", rates, 1.0)):
        lines = [
            content.line(t, values[:, k], _AXES[k], f"axis {k} of the platform") for k in range(values.shape[1])
        ]  # fmt: skip
        limits = content.view([values, np.zeros(1)], least=least)
        panels.append(Panel("time [s]", label, tuple(lines), y_limits=limits))
    caption = "Paths of the IMU's axes on the unit sphere of directions in the vehicle: faint on the far side."
    return Figure(name, f"Scheme: {schedule.name or 'schedule'}", caption, tuple(panels), linked=False)


def projected(v: ArrayLike) -> tuple[FloatArray, FloatArray]:
    """Parallel projection of body directions (n, 3): to the right and up (n, 2), and depth towards the viewer (n,)."""
    v = np.asarray(v, dtype=np.float64)
    viewer = np.array((0.75, 0.5, -0.43))
    viewer /= np.linalg.norm(viewer)
    up = np.array((0.0, 0.0, -1.0)) - viewer * (-viewer[2])
    up /= np.linalg.norm(up)
    right = np.cross(up, viewer)
    return np.stack((v @ right, v @ up), axis=-1), v @ viewer


def modulation_figure(comparison: ScenarioComparison) -> Figure:
    """Biases of the IMU in navigation axes: turning, their running mean, and not turning."""
    panels = []
    words = {"gyro": "gyroscope", "accel": "accelerometer"}
    for what, unit, scale in (("gyro", "deg/h", DEG_PER_HR), ("accel", "m/s^2", 1.0)):
        turning, still = getattr(comparison.rotary, what), getattr(comparison.conventional, what)
        limits = content.view([turning.bias_n / scale, still.bias_n / scale, np.zeros(1)])
        for k, axis in enumerate(("north", "east", "down")):
            items = (
                content.line(turning.t, turning.bias_n[:, k] / scale, "measured", "turning"),
                content.line(still.t, still.bias_n[:, k] / scale, _ROLES["conventional"][0], "not turning"),
                content.line(turning.t, turning.mean_n[:, k] / scale, _ROLES["rotary"][0], "mean so far, turning"),
            )
            panels.append(Panel("time [s]", f"{axis} [{unit}]", items, f"{words[what]} bias", y_limits=limits))
    return Figure(
        "modulation", "Biases of one sigma on every axis, seen in navigation axes",
        "What counts is the mean: a bias along the axis of rotation stays.", tuple(panels), columns=3,
    )  # fmt: skip


def errors_figure(comparison: ScenarioComparison) -> Figure:
    """Errors of attitude, velocity and position of the first run, with the predicted 1-sigma."""
    panels = []
    ned = (1, 0, 2)  # places of east, north, up
    kinds = (("attitude", "deg", DEG), ("velocity", "m/s", 1.0), ("position", "m", 1.0))
    for row, (what, unit, scale) in enumerate(kinds):
        for k, axis in enumerate("ENU"):
            items: list[Item] = []
            for way in comparison.ways:
                area = _ROLES[way.name][1]
                sigma = np.sqrt(np.maximum(way.P[:, 3 * row + ned[k], 3 * row + ned[k]], 0.0)) / scale
                items.append(content.band(way.t, -sigma, sigma, area, f"{way.name}, predicted 1 sigma"))
            for way in comparison.ways:
                if way.histories:
                    h = way.histories[0]
                    items.append(content.line(h.t, getattr(h, what)[:, k] / scale, _ROLES[way.name][0], way.name))
            panels.append(Panel("time [s]", f"{what} {axis} [{unit}]", tuple(items)))
    return Figure(
        "errors", "Errors of the first run",
        "Errors are estimate minus truth, east, north, up (attitude: about these axes). Bands: linear covariance.",
        tuple(panels), columns=3,
    )  # fmt: skip


def rates_figure(comparison: ScenarioComparison) -> Figure | None:
    """Predicted RMS against the rate of the schedule; None if it has no rate."""
    if not len(comparison.rates):
        return None
    x = comparison.rates / DEG
    panels = []
    for quantity, values in comparison.sigma.items():
        _, unit, scale = QUANTITIES[quantity]
        still = comparison.predicted(comparison.conventional, quantity) / scale
        items = (
            content.level((float(x.min()), float(x.max())), still, "smoothed", "conventional"),
            Line(x, values / scale, "filtered", "rotary"),
            Markers(x, values / scale, "filtered"),
        )
        least, most = float(min(values.min() / scale, still)), float(max(values.max() / scale, still))
        wide = least > 0.0 and most > 5.0 * least
        limits = (0.7 * least, 1.4 * most) if wide else (0.0, 1.1 * most)
        panels.append(Panel("rate [deg/s]", f"{quantity} [{unit}]", items, log=wide, y_limits=limits))
    return Figure(
        "rates", "Predicted RMS against the rate", "The scenario's schedule at other rates, all else the same.",
        tuple(panels), columns=2,
    )  # fmt: skip


def front_figure(search: SchemeSearch) -> Figure:
    """Everything that was looked at: error against travel and against reversals, with the front."""
    panels = []
    usable = [c for c in search.candidates if np.isfinite(c.error)]
    named = [c for c in usable if c.source and c.source != "own"]
    own = [c for c in usable if c.source == "own"]
    lowest = min(c.error for c in usable) / search.scale
    highest = max((c.error for c in named), default=lowest * 10.0) / search.scale
    for by, unit, label in (("travel", _TURN, "travel [revolutions]"), ("reversals", 1.0, "reversals [-]")):

        def at(group: list[Candidate], by: str = by, unit: float = unit) -> tuple[FloatArray, FloatArray]:
            return (
                np.array([getattr(c, by) / unit for c in group]), np.array([c.error / search.scale for c in group])
            )  # fmt: skip

        items: list[Item] = [Markers(*at([c for c in usable if not c.source]), "measured", "found")]
        for k in range(1, search.axes + 1):
            front = search.front(by, k)[::-1]
            role = "filtered" if k == search.axes else "smoothed"
            items.append(Line(*at(front), role, f"front, {k} ax{'is' if k == 1 else 'es'}"))
        items.append(Markers(*at(named), "read_off", "of the literature"))
        if own:
            items.append(Markers(*at(own), "start", "own"))
        best = search.best()
        x, y = at([best])
        items.append(Text(float(x[0]), float(y[0]), "best"))
        limits = (0.8 * lowest, 1.5 * highest)
        panels.append(Panel(label, f"[{search.unit}]", tuple(items), search.what, log=True, y_limits=limits))
    return Figure(
        "front", f"{search.imu}: error against the platform's motion",
        "Every dot is a schedule that keeps the platform's limits; none is better than the line in both.",
        tuple(panels), columns=2, linked=False,
    )  # fmt: skip


def calibration_figure(calibration: RotationCalibration) -> Figure:
    """Means of stretches with their 1-sigma beside the fitted model, against the rate along the first axis."""
    panels = []
    rate = np.array([s.expected @ calibration.axes[0] for s in calibration.stretches])
    error = np.array([s.reading - s.expected for s in calibration.stretches])
    T = np.array([s.duration for s in calibration.stretches])
    order = np.argsort(rate)
    model = (
        calibration.bias
        + np.array([calibration.axes @ s.expected for s in calibration.stretches]) @ calibration.response
    )
    for i, axis in enumerate("xyz"):
        sigma = calibration.random_walk[i] / np.sqrt(T) / DEG_PER_HR
        y = error[:, i] / DEG_PER_HR
        x = rate / DEG
        items: list[content.Item] = [
            Line(np.array([a, a]), np.array([b - s, b + s]), "measured")
            for a, b, s in zip(x, y, sigma, strict=True)
        ]  # fmt: skip
        items += [
            Markers(x, y, "measured", "stretches"),
            Line(x[order], model[order, i] / DEG_PER_HR, "filtered", "bias and response"),
        ]
        panels.append(Panel("rate [deg/s]", f"gyroscope {axis} [deg/h]", tuple(items)))
    return Figure("calibration", "Calibration by rotation", "Bars: 1 sigma of a mean.", tuple(panels), columns=3)


def _sphere() -> list[Item]:
    """Outline, equator and the vehicle's own axes."""
    a = np.linspace(0.0, _TURN, 181)
    items: list[Item] = [Line(np.cos(a), np.sin(a), "graticule")]
    circles = (np.stack((np.cos(a), np.sin(a), 0.0 * a), 1), np.stack((np.cos(a), 0.0 * a, np.sin(a)), 1),
               np.stack((0.0 * a, np.cos(a), np.sin(a)), 1))  # fmt: skip
    for circle in circles:
        seen, _ = projected(circle)
        items.append(Line(seen[:, 0], seen[:, 1], "graticule"))
    for axis, word in zip(np.eye(3), ("forward", "right", "down"), strict=True):
        seen, _ = projected(np.outer((0.0, 1.1), axis))
        items += [Line(seen[:, 0], seen[:, 1], "level"), Text(float(seen[1, 0]), float(seen[1, 1]), word)]
    return items


def cycle(schedule: Schedule, duration: float) -> float:
    """Time of one cycle, or in which an endless rotation makes one turn. [s]"""
    ends = [p.cycle[1] for p in schedule.profiles if p.cycle is not None]
    if len(ends) == len(schedule.profiles):
        return float(min(duration, max(ends)))
    t = np.linspace(0.0, duration, 20 * _POINTS)
    turned = np.abs(np.diff(schedule.angles(t), axis=0)).sum(axis=1).cumsum()
    done = int(np.searchsorted(turned, 1.02 * _TURN))
    return float(t[min(done + 1, len(t) - 1)])


def rotary_page(
    path: Path | str,
    comparison: ScenarioComparison,
    search: SchemeSearch | None = None,
    provenance: dict[str, Any] | None = None,
) -> Path:
    """Write the page.

    Parameters
    ----------
    path : Path or str
    comparison : ScenarioComparison
    search : SchemeSearch, optional
    provenance : dict, optional
        Options that it was made from.
    """
    from schuler.files import write_text

    scenario = comparison.scenario
    sections = [
        Section("scheme", "Scheme", (scheme_figure(comparison.rotary.schedule, comparison.rotary.t[-1]),)),
        Section("modulation", "Modulation", (modulation_figure(comparison),)),
        Section("errors", "Errors", (errors_figure(comparison), _html(comparison.table()))),
    ]
    rates = rates_figure(comparison)
    if rates is not None:
        sections.append(Section("rates", "Rates", (rates, _html(comparison.rates_table()))))
    if search is not None:
        sections.append(Section("search", "Search", search_blocks(search)))
    if provenance:
        rows = parts.provenance_rows(provenance)
        made = parts.table("Options", ("entry", "value"), rows, numbers=False)
        sections.append(Section("made", "Made from", (made,)))
    text = whole_page(
        scenario.name, "Rotary INS", f"{scenario.imu.name}, {comparison.rotary.schedule.name or 'rotation'}",
        sentences(comparison, search),
        "Conventions: errors are estimate minus truth, east, north, up; angles and axes of the platform in the "
        "vehicle's axes forward, right, down, right-handed.",
        sections, plotly_script(),
    )  # fmt: skip
    return write_text(path, text)


def sentences(comparison: ScenarioComparison, search: SchemeSearch | None = None) -> list[str]:
    """What it comes to."""
    quantity = comparison.scenario.objective.quantity
    quantity = quantity if quantity in QUANTITIES else "tilt"
    _, unit, scale = QUANTITIES[quantity]
    a, b = (comparison.predicted(way, quantity) / scale for way in comparison.ways)
    s, r = (comparison.simulated(way, quantity) / scale for way in comparison.ways)
    when = "in the outages" if comparison.scenario.in_outages else "over the mission"
    n = len(comparison.rotary.histories)
    better = f"{a / b:.4g} times less" if b < a else f"{b / a:.4g} times more"
    lines = [
        f"With rotation the {quantity} error {when} is expected to be {b:.4g} {unit} RMS, {better} than without "
        f"({a:.4g} {unit}); {n} simulated run{'' if n == 1 else 's'} gave {r:.4g} and {s:.4g} {unit}."
    ]
    if search is not None:
        best = search.best()
        own = next((c for c in search.candidates if c.source == "own"), None)
        text = f"Best of {search.evaluations} schedules: {best.text()}, {best.error / search.scale:.4g} {search.unit}"
        if own is not None and not own.refused:
            text += f"; the scenario's own: {own.error / search.scale:.4g}"
        lines.append(text + ".")
        if not search.complete:
            lines.append("The search was interrupted: this is the best so far.")
    return lines


def search_blocks(search: SchemeSearch) -> tuple[str | Figure, ...]:
    """Front, best schemes with their pictures, tables."""
    blocks: list[str | Figure] = [front_figure(search)]
    for k in range(1, search.axes + 1):
        best = search.best(k)
        if k == 1 or best.axes == k:
            blocks.append(scheme_figure(best.schedule, search.duration, f"best_{k}"))
            blocks.append(parts.folded("For a scenario's file", f"<pre>{best.toml()}</pre>"))
    named = parts.folded("The best and all named schemes", _html(search.table(), numbers=False))
    front = parts.folded("The front", _html(search.front_table(), numbers=False))
    return (*blocks, named, front)


def _html(table: ResultTable, *, numbers: bool = True) -> str:
    from schuler.plotting.table import shown

    rows = [[shown(v) for v in row] for row in table.rows]
    heads = [column.replace("_", " ") for column in table.columns]
    return parts.table(". ".join((table.title, *table.notes)), heads, rows, numbers=numbers)
