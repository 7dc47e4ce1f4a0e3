"""Page of a baseline between two receivers: verdict, baseline, residuals, cycle slips, satellites."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from schuler.files import write_text
from schuler.gnss.baseline_result import BaselineSolution
from schuler.gnss.signals import SYSTEM_NAMES, satellite_name
from schuler.plotting import parts
from schuler.plotting.figure import TIME, Figure, Item, Panel, line, markers
from schuler.plotting.page import Section, plotly_script, whole_page
from schuler.plotting.table import shown


def residual_figure(b: BaselineSolution) -> Figure:
    """Residuals of code and carrier, ambiguities fixed of all, and cycle slips over time."""
    panels = []
    for name, residual, scale, unit in (
        ("code", b.residual_code, 1.0, "m"), ("carrier", b.residual_carrier, 1e3, "mm"),
    ):  # fmt: skip
        k, s = np.nonzero(np.isfinite(residual))
        items: tuple[Item, ...] = (markers(b.t[k], scale * residual[k, s], "filtered"),) if len(k) else ()
        panels.append(Panel(TIME, f"{name} residual [{unit}]", items))
    counts = (
        line(b.t, b.n_ambiguities.astype(float), "unused", "ambiguities"),
        line(b.t, b.n_fixed.astype(float), "filtered", "fixed combinations"),
    )
    panels.append(Panel(TIME, "combinations [-]", counts))
    names = {one: k for k, one in enumerate(np.unique(b.sat)[::-1].tolist())}
    k, s = np.nonzero(np.isfinite(b.sigma_code))
    where = np.array([names[one] for one in b.sat.tolist()], dtype=float)
    slots: list[Item] = [markers(b.t[k], where[s], "unused", "measured")]
    if b.slipped.any():
        k, s = np.nonzero(b.slipped)
        slots.append(markers(b.t[k], where[s], "rejected", "cycle slip"))
    ticks = tuple((float(place), satellite_name(one)) for one, place in names.items())
    panels.append(Panel(TIME, "", tuple(slots), y_ticks=ticks, y_limits=(-0.5, len(names) - 0.5)))
    caption = (
        "Double differences minus what baseline and ambiguities say, against the highest satellite of each system "
        "and band; below, how many ambiguities there were, and where carriers slipped."
    )
    return Figure("residuals", "Residuals, ambiguities and slips", caption, tuple(panels), columns=2)


def baseline_report(b: BaselineSolution, path: Path | str, title: str = "Baseline") -> Path:
    """Write one self-contained HTML page: verdict, baseline, residuals, slips, satellites, notes."""
    table = b.satellites()
    rows = [[shown(v) for v in row] for row in table.rows]
    systems = sorted({SYSTEM_NAMES[satellite_name(int(one))[0]] for one in b.sat})
    sections = [
        Section("baseline", "Over time", (b.figure(),)),
        Section("residuals", "Residuals and slips", (residual_figure(b),)),
        Section("satellites", "Satellites", (parts.table(", ".join(systems), table.columns, rows),)),
        Section("notes", "Notes", (parts.notes(b.notes),)),
    ]
    verdict = b.verdict
    text = whole_page(
        title, "Baseline", f"Baseline of {parts.number(b.length, 'm')}, {len(b)} epochs",
        [*verdict.summary().splitlines(), b.summary() + "."],
        "Conventions: north, east, down at the base, from the base antenna to the rover antenna; uncertainties are "
        "1-sigma and take errors as white.",
        sections, plotly_script(), tone="" if verdict.status == "ok" else verdict.status,
    )  # fmt: skip
    return write_text(path, text)
