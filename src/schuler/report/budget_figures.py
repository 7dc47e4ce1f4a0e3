"""Figures of error budgets and of the choice of an IMU."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from schuler.analysis.budget.covariance import QUANTITIES
from schuler.report import content
from schuler.report.content import Figure, Line, Markers, Panel, Span
from schuler.report.figures import draw

if TYPE_CHECKING:
    from matplotlib.figure import Figure as MplFigure

    from schuler.analysis.budget.budget import ErrorBudget
    from schuler.analysis.budget.choice import ImuChoice
    from schuler.analysis.budget.covariance import LinearCovariance
    from schuler.analysis.budget.scenario import BudgetMission

_SHOWN = 14  # groups in a chart


def budget_figure(budget: ErrorBudget) -> MplFigure:
    """Bars by group, largest above, the total in the end (Flenniken, figure 7.7)."""
    _, unit, scale = QUANTITIES[budget.quantity]
    groups = list(budget.by_group().items())[:_SHOWN]
    entries = [("all", budget.total), *groups][::-1]
    items: list[content.Item] = []
    for y, (name, value) in enumerate(entries):
        role = "mean" if name == "all" else "filtered"
        items.append(Line(np.array([0.0, value / scale]), np.array([y, y], dtype=np.float64), role))
        items.append(Markers(np.array([value / scale]), np.array([float(y)]), role))
    label = f"{budget.quantity}, 1-sigma after {budget.time:g} s [{unit}]"
    panel = Panel(
        label, "", tuple(items), f"{budget.mission}, {budget.imu}",
        y_ticks=tuple((float(y), name) for y, (name, _) in enumerate(entries)), y_limits=(-0.6, len(entries) - 0.4),
        height=1.6,
    )  # fmt: skip
    return draw(Figure("budget", "Error budget", "", (panel,)))


def covariance_figure(found: LinearCovariance, mission: BudgetMission) -> MplFigure:
    """1-sigma of every quantity over the mission, true and as the filter believes, outages shaded."""
    from schuler.analysis.budget.covariance import quantity_sigma

    panels = []
    for name, (_, unit, scale) in QUANTITIES.items():
        items: list[content.Item] = [Span(a, b, "outage", "outage") for a, b in mission.outages]
        items.append(content.line(found.t, found.quantity(name) / scale, "filtered", "true"))
        items.append(content.line(found.t, quantity_sigma(found.believed, name) / scale, "smoothed", "believed"))
        panels.append(Panel("time [s]", f"{name} [{unit}]", tuple(items)))
    return draw(Figure("covariance", f"{found.mission}, {found.imu}: 1-sigma", "", tuple(panels), columns=2))


def choice_figure(choice: ImuChoice) -> MplFigure:
    """Values of all IMUs beside the bound, logarithmic."""
    _, unit, scale = QUANTITIES[choice.requirement.quantity]
    verdicts = choice.verdicts[::-1]
    items: list[content.Item] = []
    for passes, role in ((True, "system_e"), (False, "rejected")):
        chosen = [(v.value / scale, float(y)) for y, v in enumerate(verdicts) if v.passes is passes]
        if chosen:
            x, y = np.array(chosen).T
            items.append(Markers(x, y, role, "passes" if passes else "does not pass"))
    limit = choice.requirement.limit / scale
    items.append(Line(np.array([limit, limit]), np.array([-0.6, len(verdicts) - 0.4]), "reference", "required"))
    panel = Panel(
        f"{choice.requirement.quantity} [{unit}]", "", tuple(items), f"{choice.mission}: {choice.requirement.text}",
        log_x=True, y_ticks=tuple((float(y), v.imu) for y, v in enumerate(verdicts)),
        y_limits=(-0.6, len(verdicts) - 0.4), height=1.8,
    )  # fmt: skip
    return draw(Figure("choice", "Which IMU is good enough", "", (panel,)))
