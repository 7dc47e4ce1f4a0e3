"""Figures of a foot-mounted run: the walk, its heights, the detector, the strides, and errors against a reference."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from schuler.exceptions import InputError
from schuler.navigation.foot.result import FootResult
from schuler.plotting import figure as content
from schuler.plotting.drawing import check_formats, draw, save, save_all
from schuler.plotting.figure import Figure, Line, Markers, Panel

if TYPE_CHECKING:
    from matplotlib.figure import Figure as MplFigure

    from schuler.navigation.foot.errors import WalkErrors

_SPANS = 60  # rests are shaded while there are no more than these


def track(result: FootResult, errors: WalkErrors | None = None) -> Figure:
    """The walk in plan, with the footholds; with the reference where there are errors against it."""
    r, rest = result.position_n(), result.rests.middle
    items: list[content.Item] = []
    if errors is not None:
        # both in the axes of the estimate: turn the reference back
        c, s = np.cos(errors.turned), np.sin(errors.turned)
        C = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
        truth = r - errors.position_n @ C
        items.append(content.path(truth[:, 1], truth[:, 0], "reference", "reference"))
    role = "filtered" if result.smoothed is None else "smoothed"
    items.append(content.path(r[:, 1], r[:, 0], role, role))
    items.append(Markers(r[rest, 1], r[rest, 0], "measured", "rests"))
    items.append(Markers(r[:1, 1], r[:1, 0], "start", "start"))
    items.append(Markers(r[-1:, 1], r[-1:, 0], "end", "end"))
    panel = Panel("east [m]", "north [m]", tuple(items), equal=True)
    return Figure("foot_track", "Walk in plan", "The heading of the axes is the one given for the start.", (panel,))


def heights(result: FootResult) -> Figure:
    """Height of the IMU above its start, with its uncertainty; rests shaded."""
    t, r = result.t, result.position_n()
    best = result.best
    sigma = 3.0 * best.sigma("dr")[:, 2]
    up = -np.interp(best.t, t, r[:, 2])
    items = (
        *_shaded(result),
        content.band(
            best.t, up - sigma, up + sigma, "sigma" if result.smoothed is None else "sigma_smoothed", "3-sigma"
        ),
        content.line(t, -r[:, 2], "filtered" if result.smoothed is None else "smoothed", "height"),
    )
    panel = Panel("time [s]", "height [m]", items)
    return Figure("foot_height", "Height", "Height above the start; the foot rests where it is shaded.", (panel,))


def detector(result: FootResult) -> Figure:
    """Statistic and threshold of the detector.

    Raises
    ------
    InputError
        If the rests were given instead of detected.
    """
    rests = result.rests
    if not len(rests.statistic):
        raise InputError("the rests of this walk were given: there is no statistic to show")
    low = np.maximum(rests.statistic, 1e-6)
    items = (
        content.line(rests.t, low, "measured", "statistic"),
        content.line(rests.t, np.maximum(rests.threshold, 1e-6), "model", "threshold"),
        content.markers(rests.t[rests.mask], low[rests.mask], "filtered", "taken for rest"),
    )
    panel = Panel("time [s]", "statistic [1]", items, log=True)
    return Figure("foot_detector", "Detector of rests", rests.method, (panel,))


def strides(result: FootResult) -> Figure:
    """Length, speed and clearance of every stride."""
    s = result.strides
    w = s.walking
    panels = tuple(
        Panel("time [s]", label, (Markers(s.start[w], values[w], "filtered", "stride"),
                                  Markers(s.start[~w], values[~w], "unused", "shorter motion")))
        for label, values in (("length [m]", s.length), ("speed [m/s]", s.speed), ("clearance [m]", s.clearance))
    )  # fmt: skip
    return Figure("foot_strides", "Strides", "From the middle of one rest to the middle of the next.", panels)


def error_figure(result: FootResult, errors: WalkErrors) -> Figure:
    """Horizontal and vertical error with the claimed 3-sigma at the rests."""
    t, at = errors.t, errors.at_rest
    P = errors.covariance_n
    panels = []
    for label, axis in (("north [m]", 0), ("east [m]", 1), ("down [m]", 2)):
        sigma = 3.0 * np.sqrt(P[:, axis, axis])
        items: tuple[content.Item, ...] = (content.line(t, errors.position_n[:, axis], "filtered", "error"),)
        if len(at):
            items = (content.band(t[at], -sigma, sigma, "sigma", "3-sigma at the rests"), *items)
        panels.append(Panel("time [s]", label, items, y_limits=content.view([errors.position_n[:, axis]], [sigma])))
    return Figure("foot_errors", "Errors", "Against the reference, headings made the same.", tuple(panels))


def overview(result: FootResult, errors: WalkErrors | None = None) -> MplFigure:
    """Four panels on one page: plan, height, detector, stride lengths; or errors where a reference gives them.

    Parameters
    ----------
    result : FootResult
    errors : WalkErrors, optional
        Errors from :func:`schuler.navigation.foot.errors.walk_errors`.
    """
    return draw(overview_content(result, errors))


def overview_content(result: FootResult, errors: WalkErrors | None = None) -> Figure:
    """Description of :func:`overview`."""
    chosen = [track(result, errors), heights(result)]
    if len(result.rests.statistic):
        chosen.append(detector(result))
    if errors is not None:
        panel = Panel("time [s]", "horizontal error [m]", (Line(errors.t, errors.horizontal, "filtered", "error"),))
        chosen.append(Figure("foot_horizontal", "Horizontal error", "", (panel,)))
    else:
        chosen.append(strides(result))
    panels = tuple(replace(figure.panels[0], title=figure.title) for figure in chosen)
    caption = "The walk, its heights, the detector of rests, and its strides or its errors."
    return Figure("overview", "Overview", caption, panels, columns=2, linked=False, paper_columns=2)


def save_foot_figures(
    result: FootResult,
    folder: Path | str,
    *,
    errors: WalkErrors | None = None,
    formats: Sequence[str] = ("png", "svg"),
) -> list[Path]:
    """Write all figures there is something to show in; return their paths."""
    check_formats(formats)
    written = save(overview(result, errors), Path(folder) / "foot_overview", formats)
    figures = [track(result, errors), heights(result)]
    if len(result.rests.statistic):
        figures.append(detector(result))
    if len(result.strides):
        figures.append(strides(result))
    if errors is not None:
        figures.append(error_figure(result, errors))
    return written + save_all(figures, folder, formats)


def _shaded(result: FootResult) -> list[content.Item]:
    rests = result.rests
    if len(rests) > _SPANS:
        return []
    pairs = zip(rests.start.tolist(), rests.stop.tolist(), strict=True)
    return [content.Span(a, b, "finding", "rest") for a, b in pairs]
