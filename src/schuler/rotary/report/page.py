"""Page of a rotating IMU: its scheme, what it brings, and which would be better. One self-contained HTML file."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from schuler.budget.covariance import QUANTITIES
from schuler.plotting import parts
from schuler.plotting.figure import Figure
from schuler.plotting.page import Section, plotly_script, whole_page
from schuler.rotary.report.figures import errors_figure, front_figure, modulation_figure, rates_figure, scheme_figure

if TYPE_CHECKING:
    from schuler.plotting.table import ResultTable
    from schuler.rotary.search.comparison import ScenarioComparison
    from schuler.rotary.search.search_result import SchemeSearch


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

    Raises
    ------
    MissingExtraError
        If plotly is not installed (extra ``report``).
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
