"""Figures of error growth: contributions and total, bounds of a Monte Carlo."""

from __future__ import annotations

from typing import TYPE_CHECKING

from schuler.report import content
from schuler.report.content import Figure, Panel
from schuler.report.figures import draw
from schuler.units import DEG

if TYPE_CHECKING:
    from matplotlib.figure import Figure as MplFigure

    from schuler.analysis.growth.dead_reckoning import Bounds
    from schuler.analysis.growth.totals import Growth

_SHOWN = {"heading": ("heading [deg]", DEG), "velocity": ("velocity [m/s]", 1.0), "position": ("position [m]", 1.0)}
_ROLES = ("system_g", "system_r", "system_e", "system_c", "system_j", "system_i", "system_s", "filtered")


def growth_figure(growth: Growth) -> MplFigure:
    """1-sigma by cause and in all, a panel for each quantity."""
    panels = []
    for quantity, (label, unit) in _SHOWN.items():
        items: list[content.Item] = [content.line(growth.t, growth.total(quantity) / unit, "mean", "total")]
        for i, cause in enumerate(growth.causes):
            part = growth.contributions[quantity][i]
            if part.any():
                items.append(content.line(growth.t, part / unit, _ROLES[i % len(_ROLES)], cause))
        panels.append(Panel("time [s]", label, tuple(items)))
    return draw(Figure("growth", "Growth of errors, 1-sigma", "", tuple(panels), columns=3))


def bounds_figure(bounds: Bounds) -> MplFigure:
    """1-sigma bounds of a Monte Carlo, a panel for each quantity."""
    panels = []
    for name, sigma in bounds.sigma.items():
        angle = name in ("heading", "roll", "pitch")
        unit, label = (DEG, "deg") if angle else (1.0, "m/s" if name.startswith("velocity") else "m")
        items = (
            content.band(bounds.t, -sigma / unit, sigma / unit, "sigma", "1-sigma over runs"),
            content.line(bounds.t, bounds.mean[name] / unit, "filtered", "mean"),
        )
        panels.append(Panel("time [s]", f"{name.replace('_', ' ')} [{label}]", items))
    return draw(Figure("bounds", f"Dead reckoning at rest, {bounds.runs} runs", "", tuple(panels), columns=3))
