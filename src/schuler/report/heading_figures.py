"""Figures of the heading filters."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from schuler.report import content
from schuler.report.content import Figure, Panel, Span
from schuler.report.figures import draw
from schuler.units import DEG

if TYPE_CHECKING:
    from matplotlib.figure import Figure as MplFigure

    from schuler.analysis.heading.comparison import HeadingOutages
    from schuler.analysis.heading.growth import HeadingBound
    from schuler.analysis.heading.runs import FilterRuns
    from schuler.arrays import FloatArray

_ROLES = {
    "constant, asleep": "filtered", "constant, walking": "system_e", "Gauss-Markov": "smoothed", "both": "reference",
}  # fmt: skip


def bound_figure(bound: HeadingBound) -> MplFigure:
    """1-sigma of heading with fixes and without (figures 4.1 and 4.2 of the source)."""
    items = (
        content.line(bound.t, bound.aided / DEG, "filtered", "with fixes"),
        content.line(bound.t, bound.free / DEG, "smoothed", "free integration"),
        content.level((bound.t[0], bound.t[-1]), bound.steady_posterior / DEG, "level", "steady"),
    )
    panel = Panel("time [s]", "1-sigma of heading [deg]", items, log=True)
    return draw(Figure("heading_bound", "Heading with fixes and without", "", (panel,)))


def outage_figure(outages: HeadingOutages) -> MplFigure:
    """RMS heading errors in the outage, a panel for each truth (figures 4.5 to 4.7)."""
    panels = []
    for i, truth in enumerate(outages.truths):
        items = [
            content.line(outages.t, outages.rms[i, j] / DEG, _ROLES[name], name)
            for j, name in enumerate(outages.filters)
        ]
        panels.append(Panel("time into the outage [s]", "RMS of heading [deg]", tuple(items), f"true bias: {truth}"))
    return draw(Figure("heading_outages", "Bias models in an outage", "", tuple(panels), columns=3))


def recorded_figure(found: dict[str, tuple[FloatArray, FilterRuns]], start_s: float = 1800.0) -> MplFigure:
    """One log, all filters: heading error and bias estimate (figures 4.8 to 4.10)."""
    errors: list[content.Item] = []
    biases: list[content.Item] = []
    for name, (error, run) in found.items():
        errors.append(content.line(run.t, error / DEG, _ROLES[name], name))
        total = np.sum(run.estimate[:, 1:, 0], axis=1)
        biases.append(content.line(run.t, total / DEG, _ROLES[name], name))
    last = float(next(iter(found.values()))[1].t[-1])
    span = Span(start_s, last, "outage", "no fixes")
    panels = (
        Panel("time [s]", "heading error [deg]", (span, *errors)),
        Panel("time [s]", "bias estimate [deg/s]", (span, *biases)),
    )
    return draw(Figure("heading_recorded", "One gyroscope, four filters", "", panels))
