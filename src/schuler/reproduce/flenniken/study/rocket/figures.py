"""Figures of the rocket: flight, impact scatter, ranking, and what the parameters of the sensors mean."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from schuler.plotting import figure as content
from schuler.plotting.figure import Figure, Line, Markers, Panel, Text
from schuler.units import DEG, KM

if TYPE_CHECKING:
    from schuler.arrays import FloatArray
    from schuler.reproduce.flenniken.study.rocket.budget import ImpactBudget
    from schuler.reproduce.flenniken.study.rocket.scatter import ImpactScatter
    from schuler.reproduce.flenniken.study.rocket.trajectory import RocketTrajectory

_SHOWN = 16  # parameters in a chart
_ROLES = ("filtered", "smoothed", "case_3", "case_4")


def trajectory_figure(trajectory: RocketTrajectory) -> Figure:
    """Sensor readings, attitude, velocity, and height over range: Flenniken (2005), figures 7.1 and 7.2."""
    T = trajectory
    force = [
        content.line(T.middle, T.specific_force[:, 0], "filtered", "specific force, forward"),
        content.line(T.middle, T.acceleration[:, 0], "smoothed", "kinematic acceleration, forward"),
        content.line(T.middle, T.acceleration[:, 1], "case_3", "kinematic acceleration, up"),
    ]
    angles = [
        content.line(T.t, T.pitch / DEG, "filtered", "pitch [deg]"),
        content.line(T.middle, T.rate[:, 2] / DEG, "smoothed", "pitch rate [deg/s]"),
    ]
    speeds = [content.line(T.t, T.v[:, i], role, f"velocity {axis}") for i, axis, role in _NORTH_UP]
    path = content.path(T.r[:, 0] / KM, T.r[:, 1] / KM, "filtered")
    panels = (
        Panel("time [s]", "in body axes [m/s^2]", tuple(force)),
        Panel("time [s]", "[deg], [deg/s]", tuple(angles)),
        Panel("time [s]", "[m/s]", tuple(speeds)),
        Panel("downrange [km]", "height [km]", (path,), equal=True),
    )
    return Figure("rocket_trajectory", "Trajectory I", "", panels, columns=2, linked=False)


_NORTH_UP = ((0, "north", "filtered"), (1, "up", "smoothed"))


def scatter_figure(*scatters: ImpactScatter) -> Figure:
    """Points on the ground with means and ellipses that hold half and 95 % (figure 7.3), a cloud a model."""
    items: list[content.Item] = []
    for scatter, role in zip(scatters, _ROLES, strict=False):
        items.append(Markers(scatter.point[:, 1], scatter.point[:, 0], role, f"{scatter.name}, {scatter.variant}"))
        for share in (0.5, 0.95):
            outline = scatter.ellipse.outline(share)
            items.append(Line(outline[:, 1], outline[:, 0], role))
        items.append(Markers(scatter.mean[1:], scatter.mean[:1], "rejected", "mean"))
    items.append(Markers(np.zeros(1), np.zeros(1), "start", "true impact"))
    panel = Panel("crossrange [m]", "downrange [m]", tuple(items), equal=True)
    return Figure("rocket_scatter", "Computed impact, with ellipses of 50 and 95 %", "", (panel,))


def ranking_figure(budget: ImpactBudget) -> Figure:
    """Bars by parameter, largest above, the totals on top (figure 7.4)."""
    shown = list(zip(budget.names, budget.contribution.tolist(), strict=True))[:_SHOWN]
    entries = [("all on as they are", budget.together), ("all as independent 1-sigmas", budget.sigma), *shown][::-1]
    items: list[content.Item] = []
    for y, (name, value) in enumerate(entries):
        role = "mean" if name.startswith("all ") else "filtered"
        items.append(Line(np.array([0.0, value]), np.array([y, y], dtype=np.float64), role))
        items.append(Markers(np.array([value]), np.array([float(y)]), role))
    panel = Panel(
        "position error at impact [m]", "", tuple(items), budget.variant,
        y_ticks=tuple((float(y), name.replace("_", " ")) for y, (name, _) in enumerate(entries)),
        y_limits=(-0.6, len(entries) - 0.4), height=1.6,
    )  # fmt: skip
    return Figure("rocket_ranking", "Which error moves the impact", "", (panel,))


def error_types_figure() -> Figure:
    """Sketches: output over input of four errors, and how the angles of a triad lie (figures 6.1 to 6.4)."""
    u = np.linspace(-1.0, 1.0, 81)
    curves = {
        "bias": u + 0.3,
        "scale factor": 1.4 * u,
        "asymmetry": u + 0.4 * np.abs(u),
        "nonlinearity": u + 0.4 * u**2,
    }
    panels = [
        Panel(
            "true [-]",
            "read [-]",
            (Line(u, u, "reference", "ideal"), Line(u, y, "filtered", "with the error")),
            name,
            equal=True,
        )
        for name, y in curves.items()
    ]
    angle = 12.0 * DEG
    # both axes turn the same way, or towards each other
    panels.append(_axes("misalignment delta", angle, angle))
    panels.append(_axes("non-orthogonality Delta", angle, -angle))
    return Figure("rocket_error_types", "Errors of the advanced model", "", tuple(panels), columns=2, linked=False)


def _axes(title: str, first: float, second: float) -> Panel:
    def ray(angle: float) -> tuple[FloatArray, FloatArray]:
        return np.array([0.0, np.cos(angle)]), np.array([0.0, np.sin(angle)])

    items: list[content.Item] = [Line(*ray(a), "reference", "body axes") for a in (0.0, np.pi / 2.0)]
    items += [Line(*ray(a), "filtered", "sensing axes") for a in (first, np.pi / 2.0 + second)]
    items += [Text(1.02, 0.0, "x", "right"), Text(0.0, 1.02, "y")]
    return Panel("", "", tuple(items), title, equal=True, bare=True, x_limits=(-0.4, 1.3), y_limits=(-0.2, 1.3))
