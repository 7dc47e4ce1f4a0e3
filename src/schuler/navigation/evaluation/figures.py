"""Figures of comparisons: fans of outages, architectures side by side, filtered against smoothed."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from schuler.exceptions import InputError
from schuler.navigation.evaluation.architectures import Comparison
from schuler.navigation.evaluation.consistency import Separation
from schuler.navigation.evaluation.outages import OutageStatistics
from schuler.plotting.figure import Band, Figure, Item, Line, Panel, Span, band, level, line, view

if TYPE_CHECKING:
    from matplotlib.figure import Figure as MplFigure

AXES = ("north", "east", "down")
_AGE = "time since GNSS was lost [s]"
_MOST_LINES = 40  # more outages than this are not drawn one by one


def fan(statistics: OutageStatistics) -> Figure:
    """Position errors of all outages over their age, with the claimed 3 sigma.

    Parameters
    ----------
    statistics : OutageStatistics

    Returns
    -------
    Figure
        Three axes and the horizontal error; of very many outages every n-th line.
    """
    s = statistics
    if not len(s):
        raise InputError("there is no outage to draw")
    single = range(0, len(s), -(-len(s) // _MOST_LINES))
    panels = []
    for i, axis in enumerate(AXES):
        three = 3.0 * np.sqrt(np.mean(s.cov_n[:, :, i, i], axis=0))
        lines = [Line(s.age, s.error_n[k, :, i], "term", "single outages" if k == 0 else "") for k in single]
        items: list[Item] = [
            Band(s.age, -three, three, "sigma", "claimed ±3 sigma"),
            *lines,
            Line(s.age, s.error_n[:, :, i].mean(axis=0), "mean", "mean error"),
        ]
        limits = view([*(x.y for x in lines), three, -three])
        panels.append(Panel(_AGE, f"{axis} [m]", tuple(items), y_limits=limits))
    horizontal = np.hypot(s.error_n[:, :, 0], s.error_n[:, :, 1])
    claimed = np.sqrt(np.mean(s.cov_n[:, :, 0, 0] + s.cov_n[:, :, 1, 1], axis=0))
    items = [Line(s.age, horizontal[k], "term", "single outages" if k == 0 else "") for k in single]
    items += [
        Line(s.age, np.sqrt(np.mean(horizontal**2, axis=0)), "filtered", "RMS error"),
        Line(s.age, claimed, "model", "RMS error as claimed"),
    ]
    panels.append(Panel(_AGE, "horizontal error [m]", tuple(items)))
    caption = (
        f"Errors of {len(s)} outages from the moment GNSS is lost. An honest filter keeps them inside its band, and "
        "the RMS error near the claimed one."
    )
    return Figure("outage_fan", f"Outages: {s.name}", caption, tuple(panels), columns=2, paper_columns=2)


def architectures(comparison: Comparison, outages: str | None = None) -> Figure:
    """Horizontal error over time, one panel an architecture, all on one logarithmic scale.

    Parameters
    ----------
    comparison : Comparison
    outages : str, optional
        Set of outages; the last one if left out.
    """
    name = list(comparison.windows)[-1] if outages is None else outages
    if name not in comparison.windows:
        raise InputError(f"outages: expected one of {', '.join(comparison.windows)}, got {name!r}")
    rows = [r for r in comparison.rows if r.outages == name and r.errors is not None]
    if not rows:
        raise InputError(f"no architecture has a solution with outages {name!r}")
    every = np.concatenate([r.errors.horizontal for r in rows if r.errors is not None])
    positive = every[every > 0.0]
    limits = (max(float(np.quantile(positive, 0.02)), 1e-4), 1.5 * float(every.max())) if len(positive) else (1e-4, 1.0)
    spans = [Span(a, b, "outage", "GNSS withheld") for a, b in comparison.windows[name]]
    panels = []
    for r in rows:
        assert r.errors is not None
        curve = line(r.errors.t - comparison.start, np.maximum(r.errors.horizontal, limits[0]), "filtered", "filtered")
        panels.append(
            Panel("time [s]", "horizontal [m]", (*spans, curve), title=r.mode.name, y_limits=limits, log=True)
        )
    caption = f"Horizontal distance to {comparison.reference}; all panels have one scale, so heights can be compared."
    return Figure("architectures", f"Architectures: {comparison.recording}", caption, tuple(panels), columns=3)


def separation(apart: Separation) -> Figure:
    """Position, filtered minus smoothed, with the 3-sigma band that an honest filter expects of it."""
    t = apart.t - apart.t[0]
    spans = [Span(a - apart.t[0], b - apart.t[0], "outage", "GNSS withheld") for a, b in apart.outages]
    panels = []
    for i, axis in enumerate(AXES):
        d, three = apart.difference[:, 6 + i], 3.0 * apart.sigma[:, 6 + i]
        inside = 100.0 * float(np.mean(np.abs(d) <= three + 1e-9))
        items: list[Item] = [
            *spans,
            band(t, -three, three, "sigma", "expected ±3 sigma"),
            level((0.0, float(t[-1])), 0.0, "level"),
            line(t, d, "filtered", "filtered minus smoothed"),
        ]
        panels.append(
            Panel(
                "time since the start of the solution [s]", f"{axis} [m]", tuple(items),
                title=f"inside ±3 sigma: {inside:.1f} %", y_limits=view([d], [three, -three]),
            )
        )  # fmt: skip
    caption = (
        "What the smoother, which knows later measurements too, changed in the filtered position. The band is the root "
        "of the difference of the two claimed covariances: beyond it the model is wrong, reference or not."
    )
    return Figure("separation", "Filtered against smoothed", caption, tuple(panels))


def plot_fan(statistics: OutageStatistics) -> MplFigure:
    """:func:`fan` drawn with matplotlib."""
    from schuler.plotting.drawing import draw

    return draw(fan(statistics))


def plot_comparison(comparison: Comparison, outages: str | None = None) -> MplFigure:
    """:func:`architectures` drawn with matplotlib."""
    from schuler.plotting.drawing import draw

    return draw(architectures(comparison, outages))


def plot_separation(apart: Separation) -> MplFigure:
    """:func:`separation` drawn with matplotlib."""
    from schuler.plotting.drawing import draw

    return draw(separation(apart))
