"""Figures of error budgets and of the choice of an IMU."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from schuler.budget.covariance import QUANTITIES
from schuler.plotting import figure as content
from schuler.plotting.drawing import draw
from schuler.plotting.figure import Figure, Line, Markers, Panel, Span

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


def covariance_figure(covariance: LinearCovariance, mission: BudgetMission) -> MplFigure:
    """1-sigma of every quantity over the mission, true and as the filter believes, outages shaded."""
    return draw(covariance_content(covariance, mission))


def covariance_content(covariance: LinearCovariance, mission: BudgetMission, name: str = "covariance") -> Figure:
    """The same to be drawn in a page, where every figure has a name of its own."""
    from schuler.budget.covariance import quantity_sigma

    panels = []
    for quantity, (_, unit, scale) in QUANTITIES.items():
        items: list[content.Item] = [Span(a, b, "outage", "outage") for a, b in mission.outages]
        items.append(content.line(covariance.t, covariance.quantity(quantity) / scale, "filtered", "true"))
        believed = quantity_sigma(covariance.believed, quantity) / scale
        items.append(content.line(covariance.t, believed, "smoothed", "believed"))
        panels.append(Panel("time [s]", f"{quantity} [{unit}]", tuple(items)))
    caption = "True: with all errors of the IMU. Believed: the filter's own covariance."
    return Figure(name, f"{covariance.mission}, {covariance.imu}: 1-sigma", caption, tuple(panels), columns=2)


def choice_figure(choice: ImuChoice) -> MplFigure:
    """Values of all IMUs beside the bound, logarithmic."""
    return draw(choice_content(choice))


def choice_content(choice: ImuChoice) -> Figure:
    """Description of :func:`choice_figure`."""
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
    caption = "The worst 1-sigma of the mission with each IMU, best below; those left of the line are good enough."
    return Figure("choice", "Which IMU is good enough", caption, (panel,))
