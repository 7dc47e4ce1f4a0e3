"""HTML page on the history of a unit: parameters over the dates of its calibrations, and what changed."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from schuler.calibration.result.parameters import AXES
from schuler.calibration.result.sheet import rounded, sheet
from schuler.calibration.result.unit_history import ParameterHistory, UnitHistory
from schuler.files import write_text
from schuler.plotting import parts
from schuler.plotting.figure import Figure, Item, Line, Markers, Panel, level
from schuler.plotting.page import Section, plotly_script, whole_page

_CONVENTIONS = (
    "Conventions: axes are forward, right, down; bars are k = 2, as each calibration claims; dotted lines are means "
    "over all calibrations, weighted by their uncertainties."
)
_LEADING = 3  # panels beside the verdict


def history_report(history: UnitHistory, path: Path | str) -> Path:
    """Write the page of a unit's history; the same bytes for the same arguments.

    Parameters
    ----------
    history : UnitHistory
    path : Path or str
        The HTML file.
    """
    panels = history_panels(history)
    surest = sorted(panels, key=lambda names: min(history.parameters[n].p_corrected for n in names))
    leading = Figure(
        "changes", "Where it changed most" if history.changed else "The largest differences",
        "Bars are two sigma of each calibration.", tuple(panels[names] for names in surest[:_LEADING]),
    )  # fmt: skip
    everything = Figure(
        "parameters", "All parameters", "One panel for each family and sensor; bars are two sigma.",
        tuple(panels.values()), columns=2,
    )  # fmt: skip
    sections = [
        Section("parameters", "Parameters over dates", (everything, _table(history))),
        Section("calibrations", "The calibrations", (_calibrations(history),)),
    ]
    text = whole_page(
        f"unit {history.serial}" if history.serial else "unit", "calibration history",
        f"{history.dates[0]} to {history.dates[-1]}",
        history.sentences(), _CONVENTIONS, sections, plotly_script(),
        tone="doubtful" if history.changed else "", leading=leading,
    )  # fmt: skip
    return write_text(path, text)


def history_panels(history: UnitHistory) -> dict[tuple[str, ...], Panel]:
    """One panel for each family of parameters, of matrices for each row, by the names in it."""
    families: dict[str, list[ParameterHistory]] = {}
    for p in history.parameters.values():
        diagonal = p.name[0] == "M" and p.name[4] == p.name[5]
        row = "" if len(p.name) < 6 or diagonal else f", {p.name[4]}"
        families.setdefault(f"{sheet(p.name).family}{row}", []).append(p)
    label = f"after {history.dates[0]} [d]"
    panels = {}
    for title, members in families.items():
        items: list[Item] = []
        span = max(float(p.day[-1]) for p in members) or 1.0
        ends = (-0.04 * span, 1.04 * span)
        for k, p in enumerate(members):
            s = sheet(p.name)
            axis = p.name[-1] if p.name[-1] in AXES else "x"
            role = f"axis_{axis}"
            x = p.day + 0.01 * span * (k - 1)  # bars beside each other
            y, U = p.value / s.factor, 2.0 * p.sigma / s.factor
            bars = np.column_stack((y - U, y + U, np.full(len(y), np.nan))).ravel()
            items.append(level(ends, p.mean / s.factor, "level"))
            items.append(Line(np.repeat(x, 3), bars, role))
            items.append(Markers(x, y, role, f"along {axis}" if len(p.name) > 5 and "," in title else axis))
        changed = [p.name for p in members if p.changed]
        heading = title + (f": {', '.join(changed)} changed" if changed else "")
        names = tuple(p.name for p in members)
        panels[names] = Panel(label, f"[{sheet(names[0]).unit}]", tuple(items), title=heading, x_limits=ends)
    return panels


def _table(history: UnitHistory) -> str:
    rows = []
    for p in history.parameters.values():
        s = sheet(p.name)
        last, spread = rounded(p.value[-1] / s.factor, p.sigma[-1] / s.factor)
        first = rounded(p.value[0] / s.factor, p.sigma[0] / s.factor)[0]
        step = "-" if len(p.value) < 2 else f"{p.steps[np.argmax(np.abs(p.steps))]:+.1f}"
        sure = "-" if not np.isfinite(p.p_corrected) else f"{p.p_corrected:.2g}"
        rows.append((f"{p.name}: {s.meaning}", first, f"{last} {s.unit}\n± {spread}", step, sure))
    heads = ("parameter", "first", "last, 1 sigma", "largest step [sigma]", "p, corrected")
    return parts.table(f"First and last value. {history.correction}", heads, rows)


def _calibrations(history: UnitHistory) -> str:
    rows = [
        (day, name, r.method, r.status, "-" if r.temperature is None else f"{r.temperature:.1f}")
        for day, name, r in zip(history.dates, history.files, history.calibrations, strict=True)
    ]
    return parts.table("", ("date", "file", "method", "status", "temperature [degC]"), rows, numbers=False)
