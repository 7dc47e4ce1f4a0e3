"""The track in plan, and height, speed and attitude over time."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np

from schuler import frames, units
from schuler.arrays import FloatArray, IntArray
from schuler.filtering.measurements import ACCEPTED, FORCED, REJECTED, UNUSED, in_windows
from schuler.navigation.report.backdrop import Backdrop, Window, backdrop_items, graticule, north_arrow
from schuler.navigation.report.subject import WITHHELD, Subject
from schuler.navigation.result import NavigationResult
from schuler.plotting.figure import TIME, Along, Figure, Item, Line, Markers, Panel, Span, Text, band, line, path, view
from schuler.recording.trajectory import Trajectory

#: Label and role of a fix by what became of it; in the order of drawing.
FIXES = {
    UNUSED: ("GNSS fix not used", "unused"),
    ACCEPTED: ("GNSS fix", "measured"),
    WITHHELD: ("GNSS fix withheld", "withheld"),
    FORCED: ("fix accepted after lock-out", "forced"),
    REJECTED: ("GNSS fix rejected", "rejected"),
}
_FIXES_SHOWN = 1500
_SHORTEST = 20.0  # way from which a profile of heights is worth drawing [m]
_KILOMETRES = 3000.0  # way from which it is drawn over kilometres [m]


def outages(subject: Subject) -> list[Span]:
    """Shading for the stretches without GNSS, on a time axis."""
    return [
        Span(float(a), float(b), "outage", "GNSS withheld")
        for a, b in (subject.seconds(window) for window in subject.result.outages)
    ]


def track(subject: Subject) -> Figure:
    """North over east in metres about the first point of the solution, over a map or a graticule."""
    t = subject.result.trajectory.t
    origin = frames.llh_from_ecef(
        _at_reference_point(subject, subject.result.trajectory.samples(np.array([0]))).r_eb_e[0]
    )

    def plan(trajectory: Trajectory) -> FloatArray:
        return trajectory.mapped(lambda part: frames.ned_from_ecef(_at_reference_point(subject, part).r_eb_e, origin))

    items: list[Item] = []
    lost = in_windows(t, subject.result.outages)
    if lost.any():
        ne = np.where(lost[:, None], plan(subject.result.trajectory), np.nan)
        items.append(path(ne[:, 1], ne[:, 0], "outage", "GNSS withheld"))
        del ne  # of a day at 200 Hz it has 400 MB
    items += _fixes(subject, origin)
    if subject.reference is not None and not subject.reference_is_fixes:
        R = subject.reference
        r = _within(R, t).mapped(lambda part: frames.ned_from_ecef(part.r_eb_e, origin))
        items.append(path(r[:, 1], r[:, 0], "reference", "reference"))
        del r
    for role, result in subject.solutions:
        sigma = np.linalg.norm(subject.position_sigma(result)[:, :2], axis=1)
        along: list[tuple[str, Callable[[IntArray], Along]]] = [
            (TIME, lambda k: subject.seconds(t[k])), ("speed [m/s]", partial(_speed_at, result.trajectory)),
        ]  # fmt: skip
        if len(result.t):
            along.append(("1-sigma [m]", partial(_interpolated, t, result.t, sigma)))
        if subject.fix_type(t[:1]) is not None:
            along.append(("fix type", lambda k: np.asarray(subject.fix_type(t[k]))))
        ne = plan(result.trajectory)
        items.append(path(ne[:, 1], ne[:, 0], role, role, along))
        del ne
    ends = plan(subject.result.trajectory.samples(np.array([0, -1] if len(t) > 1 else [0])))
    for k, role in ((0, "start"), (-1, "end")):
        items.append(Markers(ends[[k], 1], ends[[k], 0], role, role))
    caption = (
        f"The way of the {'antenna' if subject.at_antenna else 'IMU'}, a metre being as long to the north as to the "
        "east: the curves should lie on each other, "
    ) + (
        "and where GNSS was withheld they show how far the filtered solution drifts."
        if subject.result.outages
        else "and pass through the GNSS fixes."
    )
    panel, credit = plan_panel(items, origin, subject.map)
    return Figure("track", "Track", caption + credit, (panel,), linked=False)


def plan_panel(items: list[Item], origin: FloatArray, background: Backdrop | None) -> tuple[Panel, str]:
    """Panel of items in metres east and north, with a scale, over a map or a graticule; and what the map is.

    Parameters
    ----------
    items : list of Item
    origin : ndarray, shape (3,)
        Place of zero. [rad, rad, m]
    background : Backdrop, optional

    Returns
    -------
    panel : Panel
    credit : str
        Sentence for the caption, with a blank before it; empty without a map.
    """
    items = [*items, *_scale_bar(items)]
    window = _window(items, origin)
    ground: list[Item] = []
    credit = ""
    if window is not None:
        if background is None:
            ground += graticule(window)
        else:
            ground += backdrop_items(background, window)
            source = f" ({background.credit.rstrip('.')})" if background.credit else ""
            credit = f" Background: {background.name}{source}."
        ground += north_arrow(window)
    limits = (None, None) if window is None else (window.box(1.0)[:2], window.box(1.0)[2:])
    panel = Panel(
        "east [m]", "north [m]", (*ground, *items), x_limits=limits[0], y_limits=limits[1], equal=True, grid=False
    )
    return panel, credit


def profile(subject: Subject) -> Figure | None:
    """Height over the distance travelled; None for a solution that stays where it is."""
    T = subject.result.trajectory
    way = _distance(_at_reference_point(subject, T))
    if not way[-1] > _SHORTEST:
        return None
    kilo = way[-1] > _KILOMETRES
    way = way / (1000.0 if kilo else 1.0)
    items: list[Item] = [
        Span(float(a), float(b), "outage", "GNSS withheld")
        for a, b in (np.interp(w, T.t, way) for w in subject.result.outages)
        if b > a
    ]
    heights: list[FloatArray] = []
    if subject.fixes is not None:
        t, r, status = subject.fixes
        h = frames.llh_from_ecef(r)[:, 2]
        for code, (label, role) in FIXES.items():
            k = np.flatnonzero(status == code)
            if len(k):
                k = k[:: max(1, -(-len(k) // _FIXES_SHOWN))]
                items.append(Markers(np.interp(t[k], T.t, way), h[k], role, label))
    if subject.reference is not None and not subject.reference_is_fixes:
        R = _within(subject.reference, T.t)
        height = _quantity(R, 0)
        heights.append(np.array([height.min(), height.max()]))
        items.append(path(np.interp(R.t, T.t, way), height, "reference", "reference"))
    for role, result in subject.solutions:
        height = result.trajectory.mapped(lambda part: _at_reference_point(subject, part).llh[:, 2].copy())
        heights.append(np.array([height.min(), height.max()]))
        items.append(path(np.interp(result.trajectory.t, T.t, way), height, role, role))
    panel = Panel(
        f"distance travelled [{'km' if kilo else 'm'}]", "height [m]", tuple(items), x_limits=(0.0, float(way[-1])),
        y_limits=view(heights, least=2.0),
    )  # fmt: skip
    caption = (
        "Height above the ellipsoid along the way: places passed twice should have the same height both times, and "
        "without GNSS heights it is the first to drift."
    )
    return Figure("profile", "Height profile", caption, (panel,), linked=False)


def _distance(T: Trajectory) -> FloatArray:
    """Horizontal distance travelled since the first sample. Shape (n,). [m]"""
    origin = frames.llh_from_ecef(T.samples(slice(1)).r_eb_e[0])
    ne = T.mapped(lambda part: frames.ned_from_ecef(part.r_eb_e, origin)[:, :2])
    way = np.zeros(len(ne))
    for rows in T.blocks():
        way[rows.start + 1 : rows.stop + 1] = np.linalg.norm(np.diff(ne[rows.start : rows.stop + 1], axis=0), axis=1)
    np.cumsum(way, out=way)
    return way


def motion(subject: Subject) -> Figure:
    """Height, speed, roll, pitch and heading over time, with three standard deviations of each."""
    names = ("height [m]", "speed [m/s]", "roll [deg]", "pitch [deg]", "heading [deg]")
    bands: list[list[Item]] = [[] for _ in names]
    curves: list[list[Item]] = [[] for _ in names]
    values: list[list[FloatArray]] = [[] for _ in names]
    edges: list[list[FloatArray]] = [[] for _ in names]
    for role, result in subject.solutions:
        T = result.trajectory
        k = np.searchsorted(T.t, result.t - 1e-9).clip(0, len(T.t) - 1)
        own = "sigma" if result is subject.result else "sigma_smoothed"
        for i, three in enumerate(_three_sigma(subject, result, k)):
            y = _quantity(T, i)  # one after the other: of a day at 200 Hz each is 140 MB
            t, low, high = subject.seconds(result.t), y[k] - three, y[k] + three
            edges[i] += [low, high]
            values[i].append(np.array([y.min(), y.max()]))
            x = subject.seconds(T.t)
            if i == 4:
                t, low, high = _unwound(t, low, high)
                x, y = _unwound(x, y)
            bands[i].append(band(t, low, high, own, f"{role} ±3 sigma"))
            curves[i].append(line(x, y, role, role))
    panels = tuple(
        Panel(
            TIME, name, (*outages(subject), *areas, *lines), x_limits=subject.span, y_limits=view(seen, ends),
        )
        for name, areas, lines, seen, ends in zip(names, bands, curves, values, edges, strict=True)
    )  # fmt: skip
    caption = (
        "The motion as the filter saw it: height above the ellipsoid, speed, and attitude (roll: right wing down, "
        "pitch: nose up, heading: from north towards east), with three standard deviations where they are wide enough "
        "to be seen; look here first whether the run is what you think it is."
    )
    return Figure("motion", "Motion", caption, panels)


def _within(T: Trajectory, t: FloatArray) -> Trajectory:
    """The samples of a trajectory from the first to the last of other times."""
    return T.samples(slice(int(np.searchsorted(T.t, t[0])), int(np.searchsorted(T.t, t[-1], side="right"))))


def _quantity(T: Trajectory, i: int) -> FloatArray:
    """Height [m], speed [m/s], roll, pitch or heading within 360 [deg]. Shape (n,)."""
    if i == 0:
        return T.mapped(lambda part: part.llh[:, 2].copy())  # alone, without the other two columns
    if i == 1:
        return T.mapped(lambda part: np.asarray(np.linalg.norm(part.v_eb_n, axis=1)))
    angle = T.mapped(lambda part: part.rpy_nb[:, i - 2] / units.DEG)
    return np.mod(angle, 360.0) if i == 4 else angle


def _speed_at(T: Trajectory, k: IntArray) -> FloatArray:
    return np.asarray(np.linalg.norm(T.samples(k).v_eb_n, axis=1))


def _interpolated(t: FloatArray, records: FloatArray, values: FloatArray, k: IntArray) -> FloatArray:
    return np.interp(t[k], records, values)


def _three_sigma(subject: Subject, result: NavigationResult, k: IntArray) -> tuple[FloatArray, ...]:
    """Three sigma of height, speed, roll, pitch, heading at the records k; tilts near the horizon, uncorrelated."""
    at, row = np.unique(k, return_inverse=True)
    T = result.trajectory.samples(at)
    v_n, yaw = T.v_eb_n[row], T.rpy_nb[row, 2]
    r, v, psi = (3.0 * subject.sigma(result, block) for block in ("dr", "dv", "dpsi"))
    speed = np.linalg.norm(v_n, axis=1)
    way = v_n / np.maximum(speed, 1e-3)[:, None]
    # at rest the speed is the size of an error, whichever way it points
    along = np.where(speed > 0.1, np.linalg.norm(way * v, axis=1), np.linalg.norm(v, axis=1))
    c, s = np.cos(yaw), np.sin(yaw)
    psi = psi / units.DEG
    roll, pitch = np.hypot(c * psi[:, 0], s * psi[:, 1]), np.hypot(s * psi[:, 0], c * psi[:, 1])
    return r[:, 2], along, roll, pitch, psi[:, 2]


def _unwound(x: FloatArray, *columns: FloatArray) -> tuple[FloatArray, ...]:
    """The same, broken where a heading turns through north and jumps from 360 to 0: that is no motion."""
    jump = np.flatnonzero(np.abs(np.diff(columns[0])) > 180.0) + 1
    return (np.insert(x, jump, x[jump]), *(np.insert(y, jump, np.nan) for y in columns))


def _at_reference_point(subject: Subject, trajectory: Trajectory) -> Trajectory:
    return trajectory.moved_by(subject.result.lever_arm_b) if subject.at_antenna else trajectory


def _fixes(subject: Subject, origin: FloatArray) -> list[Item]:
    if subject.fixes is None or not len(subject.fixes[0]):
        return _single_points(subject, origin)
    _, r, status = subject.fixes
    ne = frames.ned_from_ecef(r, origin)
    items: list[Item] = []
    for code, (label, role) in FIXES.items():
        k = np.flatnonzero(status == code)
        k = k[:: max(1, -(-len(k) // _FIXES_SHOWN))]
        if len(k):
            items.append(Markers(ne[k, 1], ne[k, 0], role, label))
    return items


def _single_points(subject: Subject, origin: FloatArray) -> list[Item]:
    """Single-point solutions of a tightly coupled run, which the filter does not use."""
    P, T = subject.points, subject.result.trajectory
    if P is None:
        return []
    k = np.flatnonzero(P.ok & (P.t >= T.t[0]) & (P.t <= T.t[-1]))
    k = k[:: max(1, -(-len(k) // _FIXES_SHOWN))]
    ne = frames.ned_from_ecef(P.r_e[k], origin)
    return [Markers(ne[:, 1], ne[:, 0], "measured", "single-point solution")] if len(k) else []


def _window(items: list[Item], origin: FloatArray) -> Window | None:
    """A square about everything drawn so far."""
    x = np.concatenate([i.x for i in items if isinstance(i, Line | Markers)])
    y = np.concatenate([i.y for i in items if isinstance(i, Line | Markers)])
    west, east, south, north = (float(f(v)) for v in (x, y) for f in (np.nanmin, np.nanmax))
    half = 0.56 * max(east - west, north - south)
    return Window(origin, 0.5 * (west + east), 0.5 * (south + north), half) if half > 0.0 else None


def _scale_bar(items: list[Item]) -> list[Item]:
    """A bar of a round length, a fifth to a half of the width, below the track on the left."""
    x = np.concatenate([i.x for i in items if isinstance(i, Line | Markers)])
    y = np.concatenate([i.y for i in items if isinstance(i, Line | Markers)])
    low, size = float(np.nanmin(x)), max(float(np.nanmax(x) - np.nanmin(x)), float(np.nanmax(y) - np.nanmin(y)))
    if not size > 0.0:
        return []
    power = 10.0 ** np.floor(np.log10(0.4 * size))
    length = float(max(f for f in (1.0, 2.0, 5.0) if f * power <= 0.4 * size) * power)
    below = float(np.nanmin(y)) - 0.07 * size
    text = f"{length / 1000.0:g} km" if length >= 1000.0 else f"{length:g} m"
    return [
        Line(np.array([low, low + length]), np.array([below, below]), "scale"),
        Text(low + 0.5 * length, below, text),
    ]
