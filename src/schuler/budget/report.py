"""Figures and HTML page of error budgets and of the choice of an IMU."""

from __future__ import annotations

from collections.abc import Sequence
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from schuler.budget.covariance import BELIEVED, QUANTITIES, quantity_sigma
from schuler.files import write_text
from schuler.plotting import figure as content
from schuler.plotting import parts
from schuler.plotting.drawing import draw
from schuler.plotting.figure import Figure, Line, Markers, Panel, Span
from schuler.plotting.interactive import css_name
from schuler.plotting.page import Section, plotly_script, whole_page
from schuler.plotting.table import ResultTable, shown

if TYPE_CHECKING:
    from matplotlib.figure import Figure as MplFigure

    from schuler.budget.choice import ImuChoice
    from schuler.budget.contributions import ErrorBudget
    from schuler.budget.covariance import LinearCovariance
    from schuler.budget.scenario import BudgetMission


_SHOWN = {False: 14, True: 60}  # groups and parameters in a chart, the rest as one bar
_HEIGHT = {False: 0.1, True: 0.075}  # of a bar, in heights of a usual panel
_WHOSE = {"gyroscope": "filtered", "accelerometer": "smoothed", "start": "system_e", "measurements": "system_j"}


def whose(group: str) -> str:
    """Whose errors a group holds: gyroscope, accelerometer, start, measurements."""
    first = group.partition(" ")[0]
    return {"gyroscope": first, "accelerometer": first, "initial": "start"}.get(first, "measurements")


def role_of(group: str) -> str:
    """The look of a group of errors."""
    return _WHOSE[whose(group)]


def budget_figure(budget: ErrorBudget, *, single: bool = False) -> MplFigure:
    """Bars by group or of every parameter, largest above, the total on top (Flenniken, figure 7.4)."""
    return draw(budget_content(budget, single=single))


def budget_content(budget: ErrorBudget, *, single: bool = False) -> Figure:
    """Description of :func:`budget_figure`."""
    _, unit, scale = QUANTITIES[budget.quantity]
    group = dict(zip(budget.names, budget.groups, strict=True)) if single else {g: g for g in budget.groups}
    entries = [("all", budget.total, "mean", "")]
    sources = list((budget.by_source() if single else budget.by_group()).items())
    shown, small = sources[: _SHOWN[single]], sources[_SHOWN[single] :]
    entries += [(name, value, role_of(group[name]), whose(group[name])) for name, value in shown]
    if small:
        entries.append((f"{len(small)} smaller ones", float(np.linalg.norm([v for _, v in small])), "level", ""))
    entries = entries[::-1]
    items: list[content.Item] = []
    for y, (_, value, role, label) in enumerate(entries):
        items.append(Line(np.array([0.0, value / scale]), np.array([y, y], dtype=np.float64), role, label))
        items.append(Markers(np.array([value / scale]), np.array([float(y)]), role))
    label = f"{budget.quantity}, 1-sigma after {budget.time:g} s [{unit}]"
    panel = Panel(
        label, "", tuple(items), f"{budget.mission}, {budget.imu}",
        y_ticks=tuple((float(y), name) for y, (name, *_) in enumerate(entries)), y_limits=(-0.6, len(entries) - 0.4),
        height=max(0.6, _HEIGHT[single] * len(entries)),
    )  # fmt: skip
    caption = (
        "What each error of the IMU and of the start contributes; squares of the bars add up to that of the total."
    )
    return Figure("budget", "Error budget", caption, (panel,))


def covariance_figure(covariance: LinearCovariance, mission: BudgetMission | None = None) -> MplFigure:
    """1-sigma of every quantity over the mission, true and as the filter believes, outages shaded."""
    return draw(covariance_content(covariance, mission))


def covariance_content(
    covariance: LinearCovariance, mission: BudgetMission | None = None, name: str = "covariance"
) -> Figure:
    """The same to be drawn in a page, where every figure has a name of its own."""
    from schuler.budget.covariance import quantity_sigma

    panels = []
    outages = () if mission is None else mission.outages
    for quantity, (_, unit, scale) in QUANTITIES.items():
        items: list[content.Item] = [Span(a, b, "outage", "outage") for a, b in outages]
        items.append(content.line(covariance.t, covariance.quantity(quantity) / scale, "filtered", "true"))
        believed = quantity_sigma(covariance.believed, quantity) / scale
        items.append(content.line(covariance.t, believed, "smoothed", "believed"))
        panels.append(Panel("time [s]", f"{quantity} [{unit}]", tuple(items)))
    caption = "True: with all errors of the IMU. Believed: the filter's own covariance."
    return Figure(name, f"{covariance.mission}, {covariance.imu}: 1-sigma", caption, tuple(panels), columns=2)


def choice_figure(choice: ImuChoice) -> MplFigure:
    """Values of all IMUs beside the bound, logarithmic."""
    return draw(choice_content(choice))


def choice_content(choice: ImuChoice, name: str = "choice") -> Figure:
    """Description of :func:`choice_figure`."""
    _, unit, scale = QUANTITIES[choice.requirement.quantity]
    verdicts = choice.verdicts[::-1]
    items: list[content.Item] = []
    looks = (
        (True, "system_e", "passes"),
        (False, "rejected", "does not pass"),
        (None, "unused", "lower bound: unknown"),
    )
    for certain, role, label in looks:
        chosen = [(v.value / scale, float(y)) for y, v in enumerate(verdicts) if v.certain is certain]
        if chosen:
            x, y = np.array(chosen).T
            items.append(Markers(x, y, role, label))
    limit = choice.requirement.limit / scale
    items.append(Line(np.array([limit, limit]), np.array([-0.6, len(verdicts) - 0.4]), "reference", "required"))
    panel = Panel(
        f"{choice.requirement.quantity} [{unit}]", "", tuple(items), f"{choice.mission}: {choice.requirement.text}",
        log_x=True, y_ticks=tuple((float(y), v.imu) for y, v in enumerate(verdicts)),
        y_limits=(-0.6, len(verdicts) - 0.4), height=max(1.8, 0.085 * len(verdicts)),
    )  # fmt: skip
    caption = "The worst 1-sigma of the mission with each IMU, best above; those left of the line are good enough."
    return Figure(name, "Which IMU is good enough", caption, (panel,))


_CONVENTIONS = (
    "Conventions: 1-sigma values of linear covariance, no data and no random numbers. Axes x, y, z are forward, right, "
    "down; two or three components count as the root of their summed variances. Each source is carried through the "
    "same filter by itself; squares add up to the square of the total."
)


def budget_report(
    path: Path | str,
    mission: BudgetMission,
    budgets: Sequence[tuple[LinearCovariance, ErrorBudget]],
    choices: Sequence[ImuChoice] = (),
    provenance: dict[str, Any] | None = None,
) -> Path:
    """Write the page of a mission.

    Parameters
    ----------
    path : Path or str
        The HTML file.
    mission : BudgetMission
    budgets : sequence of (LinearCovariance, ErrorBudget)
        Results for every IMU looked at.
    choices : sequence of ImuChoice
        Results for every requirement.
    provenance : dict, optional
        Scenario and specifications that the page is made from.

    Returns
    -------
    Path
        The file; the same bytes for the same arguments.
    """
    sections = [
        Section(
            f"requirement_{k + 1}",
            choice.requirement.text,
            (choice_content(choice, f"choice_{k + 1}"), _choice(choice)),
        )
        for k, choice in enumerate(choices)
    ]
    for k, (covariance, one) in enumerate(budgets):
        sections.append(
            Section(
                f"budget_{k + 1}",
                f"{one.imu}: {one.quantity} after {one.time:g} s",
                (
                    _bars(one, single=False),
                    parts.folded(f"Every parameter by itself: {len(one.by_source())} sources", _bars(one, single=True)),
                    covariance_content(covariance, mission, f"covariance_{k + 1}"),
                ),
            )
        )
    rows = parts.provenance_rows(provenance or {})
    table = parts.table("What this page is made from", ("entry", "value"), rows, numbers=False)
    sections.append(Section("provenance", "Provenance", (table,)))
    imus = ", ".join(one.imu for _, one in budgets) or "the catalogue"
    text = whole_page(
        mission.name, "Error budget", f"Error budget and choice of an IMU: {imus}", sentences(budgets, choices),
        _CONVENTIONS, sections, plotly_script() if budgets or choices else "",
    )  # fmt: skip
    return write_text(path, text)


def sentences(budgets: Sequence[tuple[LinearCovariance, ErrorBudget]], choices: Sequence[ImuChoice]) -> list[str]:
    """Verdict of every requirement, then what every IMU owes its largest share to."""
    return [*(_verdict(c) for c in choices), *(_blame(covariance, one) for covariance, one in budgets)]


_SAYS = {True: "passes", False: "does not pass", None: "is a lower bound, as not all of it is stated"}


def _verdict(choice: ImuChoice) -> str:
    _, unit, scale = QUANTITIES[choice.requirement.quantity]
    passed = [v for v in choice.verdicts if v.certain]
    unknown = sum(v.certain is None for v in choice.verdicts)
    among = f", {unknown} unknown" if unknown else ""
    best = choice.verdicts[0]
    reached = f"{best.imu} reaches {best.value / scale:.3g} {unit}"
    if len(choice.verdicts) == 1:
        return f"{choice.requirement.text}: {reached}, which {_SAYS[best.certain]}."
    return f"{choice.requirement.text}: {len(passed)} of {len(choice.verdicts)} IMUs pass{among}; {reached}."


def _blame(covariance: LinearCovariance, one: ErrorBudget) -> str:
    _, unit, scale = QUANTITIES[one.quantity]
    (first, value), *_ = one.by_group().items()
    text = (
        f"{one.imu}: {one.quantity} is {one.total / scale:.3g} {unit} (1-sigma) after {one.time:g} s, "
        f"{100.0 * value**2 / one.total**2:.0f} % of its variance by {first}."
    )
    at = int(np.argmin(np.abs(covariance.t - one.time)))
    believed = float(quantity_sigma(covariance.believed[at], one.quantity))
    belief = "knows it" if one.total < BELIEVED * believed else f"believes {believed / scale:.3g} {unit}"
    return f"{text} The filter of {covariance.states} states {belief}."


def _choice(choice: ImuChoice) -> str:
    table = choice.table()
    rows = [[shown(v) for v in row] for row in table.rows]
    lines = choice.summary().splitlines()[len(table.summary().splitlines()) :]
    return _table(table, rows) + (parts.bullets(lines) if lines else "")


def _table(table: ResultTable, rows: Sequence[Sequence[str]]) -> str:
    return parts.table(". ".join((table.title, *table.notes)), table.columns, rows)


def _bars(one: ErrorBudget, *, single: bool) -> str:
    """Contributions with a bar each: as long as its share of the total's 1-sigma."""
    group = dict(zip(one.names, one.groups, strict=True)) if single else {g: g for g in one.groups}
    table = one.table(single=single)
    lines = []
    for name, value, share in table.rows:
        role = role_of(group[str(name)]) if name in group else "mean"
        width = (max(float(share or 0.0), 0.0) / 100.0) ** 0.5
        bar = (
            f'<span style="display:inline-block; height:0.7em; width:{100.0 * width:.2f}%; '
            f'background:var({css_name(role)})"></span>'
        )
        lines.append(
            f'<tr><th scope="row">{escape(str(name))}</th><td class="n">{escape(shown(value))}</td>'
            f'<td class="n">{escape(shown(share))}</td><td style="width:45%">{bar}</td></tr>'
        )
    heads = "".join(f'<th scope="col" class="n">{escape(h)}</th>' for h in table.columns[1:])
    caption = escape(". ".join((table.title, *table.notes)))
    return (
        f'<table style="width:100%">\n<caption>{caption}; bars: 1-sigma against that of all.</caption>\n<thead><tr>'
        f'<th scope="col">{escape(table.columns[0])}</th>{heads}<th scope="col"></th></tr></thead>\n<tbody>\n'
        + "\n".join(lines)
        + "\n</tbody>\n</table>"
    )
