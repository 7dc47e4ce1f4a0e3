"""HTML page on single points: track by what became of each epoch, levels, errors, residuals, satellites."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from schuler import frames
from schuler.arrays import BoolArray, FloatArray, IntArray
from schuler.files import write_text
from schuler.gnss.point_evaluation import PointEvaluation
from schuler.gnss.point_result import LINKED, STATUS
from schuler.gnss.signals import SYSTEM_NAMES, SYSTEMS
from schuler.navigation.report.backdrop import Backdrop
from schuler.navigation.report.innovations import system_role, systems_of
from schuler.navigation.report.satellites import satellite_figures
from schuler.navigation.report.track import plan_panel
from schuler.plotting import parts
from schuler.plotting.figure import (
    TIME,
    Figure,
    Item,
    Limits,
    Line,
    Markers,
    Panel,
    band,
    level,
    line,
    markers,
    path,
    view,
)
from schuler.plotting.page import Section, plotly_script, whole_page
from schuler.plotting.table import shown
from schuler.units import DEG

#: Kinds of epochs with a position: status, role and label; in the order of drawing.
_SOLVED = (
    (0, "filtered", "solved and checked"), (LINKED, "smoothed", "solved with its neighbours"),
    (1, "unused", "not checked"),
)  # fmt: skip
#: Status in a word, for an axis.
_SHORT = {
    0: "checked", 1: "unchecked", 2: "too few", 3: "geometry", 4: "diverged", 5: "fault", 6: "rivals", LINKED: "linked",
}  # fmt: skip
_WIDE = 10.0  # largest level over the median, from which one peak would flatten all the rest
_LONGEST_ROUTE_S = 10.0  # pause across which the track is not drawn [s]
_CONVENTIONS = (
    "Conventions: the antenna's place; heights are above the ellipsoid; north, east and down at each place; errors are "
    "point minus reference, residuals measured minus predicted; sigma is one standard deviation as the ranges state "
    "it, right for one epoch: errors of neighbouring epochs are alike. Times are seconds since the first epoch."
)


def points_report(
    evaluation: PointEvaluation,
    path: Path | str,
    *,
    title: str = "Single points",
    provenance: dict[str, Any] | None = None,
    background: Backdrop | None = None,
) -> Path:
    """Write the page; the same bytes for the same arguments.

    Parameters
    ----------
    evaluation : PointEvaluation
    path : Path or str
        The HTML file.
    title : str
    provenance : dict, optional
        What it was made from.
    background : Backdrop, optional
        Map behind the track.
    """
    e, p = evaluation, evaluation.points
    verdict = e.verdict
    solved = p.ok.any()
    sections = [
        Section("positions", "Errors" if e.errors_n is not None else "Positions", (position_figure(e) or "",)),
        Section("levels", "Protection levels", tuple(f or "" for f in (level_figure(e), *_stanford(e)))),
        Section("epochs", "Epochs", (status_figure(e),)),
        Section("satellites", "Satellites", (*satellite_figures(p.screened(e.ranges), p), _satellites(e))),
        Section("residuals", "Residuals", (residual_figure(e) or "",)),
        Section("notes", "Notes", (parts.notes(p.notes),)),
        Section("provenance", "Provenance", (_provenance(provenance),), folded=True),
    ]
    text = whole_page(
        title, "Single points", f"Single points, {int(p.ok.sum())} of {len(p)} epochs, {p.t[-1] - p.t[0]:.0f} s",
        [*verdict.summary().splitlines(), *(f"{s}." for s in e.summary().splitlines())], _CONVENTIONS, sections,
        plotly_script(), tone="" if verdict.status == "ok" else verdict.status,
        leading=point_track(e, background) if solved else None,
    )  # fmt: skip
    return write_text(path, text)


def point_track(evaluation: PointEvaluation, background: Backdrop | None = None) -> Figure:
    """North over east of all positions by what became of them, with the reference; the line takes other colours."""
    p = evaluation.points
    k = np.flatnonzero(p.ok)
    origin = frames.llh_from_ecef(np.median(p.r_e[k], axis=0))
    ned = frames.ned_from_ecef(p.r_e[k], origin)
    t = _seconds(evaluation)[k]
    items: list[Item] = []
    if evaluation.true_r_e is not None:
        seen = np.isfinite(evaluation.true_r_e[:, 0])
        true = frames.ned_from_ecef(evaluation.true_r_e[seen], origin)
        items.append(path(true[:, 1], true[:, 0], "reference", "reference"))
    gap = np.flatnonzero(np.diff(t) > _LONGEST_ROUTE_S) + 1
    row = np.insert(np.arange(len(k)), gap, gap)  # a row of NaN where nothing is drawn across a pause
    north, east = (np.insert(ned[:, i], gap, np.nan) for i in (0, 1))
    colours = {
        TIME: t, "1-sigma, horizontal [m]": np.hypot(*evaluation.sigma_n[k, :2].T),
        "protection level, at most 100 [m]": np.minimum(p.hpl[k], 100.0), "satellites": p.n_used[k].astype(float),
        "PDOP": p.dilution.pdop[k], "status": np.array([STATUS[int(s)].partition(" (")[0] for s in p.status[k]]),
    }  # fmt: skip
    along = [(name, partial(np.take, values[row])) for name, values in colours.items()]
    items.append(path(east, north, "filtered", "track", along))
    for status, role, label in _SOLVED:
        own = np.flatnonzero(p.status[k] == status)
        if len(own):
            own = own[:: -(-len(own) // 1500)]
            items.append(Markers(ned[own, 1], ned[own, 0], role, label))
    panel, credit = plan_panel(items, origin, background)
    caption = (
        "Every position, a metre being as long to the north as to the east, each epoch by itself: scatter is theirs."
    )
    return Figure("track", "Track", caption + credit, (panel,), linked=False)


def position_figure(evaluation: PointEvaluation) -> Figure | None:
    """Errors against the reference, or positions about their median, north, east, down with three sigma, and speed."""
    p, errors = evaluation.points, evaluation.errors_n
    t, span = _seconds(evaluation), _span(evaluation)
    if not p.ok.any():
        return None
    values = errors
    if values is None:
        values = np.full_like(p.r_e, np.nan)
        values[p.ok] = frames.ned_from_ecef(p.r_e[p.ok], frames.llh_from_ecef(np.median(p.r_e[p.ok], axis=0)))
    three = 3.0 * evaluation.sigma_n
    panels = []
    for i, axis in enumerate(("north", "east", "down")):
        about, title = (0.0, "") if errors is not None else (values[:, i], "")
        if errors is not None:
            seen = np.isfinite(errors[:, i])
            inside = np.mean(np.abs(errors[seen, i]) <= three[seen, i]) if seen.any() else np.nan
            title = f"inside ±3 sigma: {100.0 * inside:.1f} %" if seen.any() else ""
        items = (
            band(t, about - three[:, i], about + three[:, i], "sigma", "±3 sigma"), level(span, 0.0, "level"),
            line(t, values[:, i], "filtered", "error" if errors is not None else "position"),
        )  # fmt: skip
        limits = view([values[:, i]], [about - three[:, i], about + three[:, i]])
        panels.append(Panel(TIME, f"{axis} [m]", items, title=title, x_limits=span, y_limits=limits))
    if p.velocity_ok.any():
        v = np.linalg.norm(evaluation.v_n, axis=1)
        panels.append(Panel(TIME, "speed [m/s]", (line(t, v, "filtered", "speed"),), x_limits=span))
    what = "Point minus reference" if errors is not None else "Positions about their median"
    caption = (
        f"{what}, with three standard deviations of one epoch; speed is that of the range rates, by itself."
        if p.velocity_ok.any()
        else f"{what}, with three standard deviations of one epoch."
    )
    return Figure("positions", "Errors" if errors is not None else "Positions", caption, tuple(panels))


def level_figure(evaluation: PointEvaluation) -> Figure | None:
    """Protection levels over time, with the errors where there is a reference; None without a position."""
    p, errors = evaluation.points, evaluation.errors_n
    if not p.ok.any():
        return None
    t, span = _seconds(evaluation), _span(evaluation)
    panels = []
    for name, values, k in (("horizontal", p.hpl, slice(0, 2)), ("vertical", p.vpl, slice(2, 3))):
        size = np.where(p.ok & np.isfinite(values), values, np.nan)
        items: list[Item] = [level(span, evaluation.alert_limit, "level", f"alert limit, {evaluation.alert_limit:g} m")]
        items.append(line(t, size, "largest", "protection level"))
        title = (
            f"{int(np.sum(p.ok & ~np.isfinite(values)))} positions without a level"
            if np.isinf(values[p.ok]).any()
            else ""
        )
        if errors is not None:
            error = np.linalg.norm(errors[:, k], axis=1)
            items.append(line(t, error, "filtered", "error"))
            beyond = error > values
            title = f"error beyond its level at {int(np.sum(beyond))} of {int(np.isfinite(error).sum())} epochs"
            if beyond.any():
                items.append(markers(t[beyond], error[beyond], "rejected", "beyond its level"))
        drawn = np.concatenate([i.y[np.isfinite(i.y)] for i in items if isinstance(i, Line)])
        top = float(drawn.max())
        wide = top > _WIDE * float(np.median(drawn))
        panels.append(
            Panel(
                TIME, f"{name} [m]", tuple(items), title=title, x_limits=span, log=wide,
                y_limits=None if wide else (0.0, 1.05 * top),
            )
        )  # fmt: skip
    caption = (
        "How far off a position may be if one satellite is at fault by any amount and the test passes, but for the "
        "risk asked for; positions without a spare satellite have no level."
    )
    return Figure("levels", "Protection levels", caption, tuple(panels))


def status_figure(evaluation: PointEvaluation) -> Figure:
    """What became of every epoch, and how many ranges fault detection left out."""
    p = evaluation.points
    t, span = _seconds(evaluation), _span(evaluation)
    kinds = np.unique(p.status)[::-1].tolist()
    height = np.array([kinds.index(s) for s in p.status.tolist()], dtype=np.float64)
    items: list[Item] = []
    for good, role, label in ((True, "filtered", "position"), (False, "rejected", "no position")):
        own = p.ok == good
        if own.any():
            items.append(Markers(t[own], height[own], role, label))
    ticks = tuple((float(k), _SHORT[s]) for k, s in enumerate(kinds))
    panels = [
        Panel(
            TIME, "", tuple(items), x_limits=span, y_ticks=ticks, y_limits=(-0.6, len(kinds) - 0.4), grid=False,
            height=0.5 + 0.15 * len(kinds),
        )
    ]  # fmt: skip
    meaning = "; ".join(f"{_SHORT[s]}: {STATUS[s]}" for s in kinds[::-1])
    caption = f"What became of every epoch: {meaning}."
    if p.excluded.any():
        out = np.bincount(p.epoch[p.excluded], minlength=len(p)).astype(np.float64)
        left_out = line(t, out, "rejected", "left out by fault detection")
        panels.append(Panel(TIME, "ranges at fault [-]", (left_out,), x_limits=span))
        caption += " Below, ranges that the others contradict, left out of it."
    return Figure("epochs", "Epochs", caption, tuple(panels))


def residual_figure(evaluation: PointEvaluation) -> Figure | None:
    """Residuals of ranges and range rates over time and elevation, by system; None without a position."""
    p, r = evaluation.points, evaluation.ranges
    used = p.ok[p.epoch] & (p.weight > 0.0) & np.isfinite(p.residual)
    if not used.any():
        return None
    t = (_seconds(evaluation))[p.epoch]
    span = _span(evaluation)
    late = p.ok[p.epoch] & p.excluded & np.isfinite(p.residual)
    moving = p.velocity_ok[p.epoch] & ~p.rate_excluded & np.isfinite(p.rate_residual) & used
    elevation = r.elevation / DEG
    panels = [
        Panel(
            TIME, "residual [m]", (*_by_system(t, p.residual, used, r.sat), *_left_out(t, p.residual, late)),
            x_limits=span, y_limits=_reach(p.residual[used]), title=f"RMS {_rms(p.residual[used]):.2f} m",
        ),
        Panel(
            "elevation [deg]", "residual over sigma [-]",
            tuple(_by_system(elevation, p.residual / r.sigma_range, used & np.isfinite(elevation), r.sat)),
            x_limits=(0.0, 90.0), y_limits=(-5.0, 5.0),
            title=f"RMS {_rms((p.residual / r.sigma_range)[used]):.2f}",
        ),
    ]  # fmt: skip
    if moving.any():
        panels.append(
            Panel(
                TIME, "rate residual [m/s]", tuple(_by_system(t, p.rate_residual, moving, r.sat)), x_limits=span,
                y_limits=_reach(p.rate_residual[moving]), title=f"RMS {_rms(p.rate_residual[moving]):.3f} m/s",
            )
        )  # fmt: skip
    caption = (
        "Measured minus predicted by each epoch's solution: scatter about zero is right, a satellite that stays to one "
        "side has a reflected signal or a wrong message. Crosses were left out; those beyond the axis are not shown."
    )
    return Figure("residuals", "Residuals", caption, tuple(panels), linked=False)


def _by_system(x: FloatArray, y: FloatArray, which: BoolArray, sat: IntArray) -> list[Item]:
    items: list[Item] = []
    for letter in systems_of(sat[which]):
        own = np.flatnonzero(which & (sat // 100 == SYSTEMS.index(letter)))
        own = own[:: -(-len(own) // 2000)]
        items.append(Markers(x[own], y[own], system_role(letter), SYSTEM_NAMES[letter]))
    return items


def _left_out(t: FloatArray, y: FloatArray, which: BoolArray) -> list[Item]:
    return [markers(t[which], y[which], "rejected", "left out")] if which.any() else []


def _reach(values: FloatArray) -> Limits:
    """Limits of an axis about zero that nearly all values are within."""
    top = 1.2 * float(np.quantile(np.abs(values), 0.998)) or 1.0
    return -top, top


def _rms(values: FloatArray) -> float:
    return float(np.sqrt(np.mean(values[np.isfinite(values)] ** 2)))


def _stanford(evaluation: PointEvaluation) -> list[Figure]:
    diagrams = (evaluation.stanford("horizontal"), evaluation.stanford("vertical"))
    return [d.figure() for d in diagrams if d is not None]


def _satellites(evaluation: PointEvaluation) -> str:
    table = evaluation.satellites()
    heads = (
        "satellite", "ranges", "used", "no message", "unhealthy", "low", "weak", "implausible", "at fault",
        "mean residual [m]", "RMS [m]",
    )  # fmt: skip
    rows = [[shown(v) for v in row] for row in table.rows]
    return parts.table("Ranges measured, used in a position, and left out by why; residuals of those used", heads, rows)


def _provenance(provenance: dict[str, Any] | None) -> str:
    rows = parts.provenance_rows(provenance or {})
    return parts.table("What this result was made from", ("item", "value"), rows, numbers=False)


def _seconds(evaluation: PointEvaluation) -> FloatArray:
    t = evaluation.points.t
    return np.asarray(t - t[0])


def _span(evaluation: PointEvaluation) -> Limits:
    t = _seconds(evaluation)
    return 0.0, max(float(t[-1]), 1e-3)
