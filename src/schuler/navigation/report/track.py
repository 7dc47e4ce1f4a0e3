"""The track in plan, and height, speed and attitude over time."""

from __future__ import annotations

import numpy as np

from schuler import frames, units
from schuler.arrays import FloatArray, IntArray
from schuler.filtering.measurements import ACCEPTED, FORCED, REJECTED, UNUSED, in_windows
from schuler.navigation.report.backdrop import Window, backdrop_items, graticule, north_arrow
from schuler.navigation.report.subject import WITHHELD, Subject
from schuler.navigation.result import NavigationResult
from schuler.plotting.figure import TIME, Figure, Item, Line, Markers, Panel, Span, Text, band, line, path, view
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
    T = _at_reference_point(subject, subject.result.trajectory)
    origin = frames.llh_from_ecef(T.r_eb_e[0])
    ne = frames.ned_from_ecef(T.r_eb_e, origin)
    items: list[Item] = []
    lost = np.where(in_windows(T.t, subject.result.outages), 1.0, np.nan)
    if np.isfinite(lost).any():
        items.append(path(ne[:, 1] * lost, ne[:, 0] * lost, "outage", "GNSS withheld"))
    items += _fixes(subject, origin)
    if subject.reference is not None and not subject.reference_is_fixes:
        R = subject.reference
        inside = (R.t >= T.t[0]) & (R.t <= T.t[-1])
        r = frames.ned_from_ecef(R.r_eb_e[inside], origin)
        items.append(path(r[:, 1], r[:, 0], "reference", "reference"))
    for role, result in subject.solutions:
        way = _at_reference_point(subject, result.trajectory)
        plan = frames.ned_from_ecef(way.r_eb_e, origin)
        sigma = np.linalg.norm(subject.position_sigma(result)[:, :2], axis=1)
        along = [(TIME, subject.seconds(way.t)), ("speed [m/s]", np.linalg.norm(result.trajectory.v_eb_n, axis=1))]
        along += [("1-sigma [m]", np.interp(way.t, result.t, sigma))] if len(result.t) else []
        items.append(path(plan[:, 1], plan[:, 0], role, role, along))
    for k, role in ((0, "start"), (-1, "end")):
        items.append(Markers(ne[[k], 1], ne[[k], 0], role, role))
    items += _scale_bar(items)
    window = _window(items, origin)
    caption = (
        f"The way of the {'antenna' if subject.at_antenna else 'IMU'}, a metre being as long to the north as to the "
        "east: the curves should lie on each other, "
    ) + (
        "and where GNSS was withheld they show how far the filtered solution drifts."
        if subject.result.outages
        else "and pass through the GNSS fixes."
    )
    ground: list[Item] = []
    if window is not None:
        if subject.map is None:
            ground += graticule(window)
        else:
            ground += backdrop_items(subject.map, window)
            credit = f" ({subject.map.credit.rstrip('.')})" if subject.map.credit else ""
            caption += f" Background: {subject.map.name}{credit}."
        ground += north_arrow(window)
    limits = (None, None) if window is None else (window.box(1.0)[:2], window.box(1.0)[2:])
    panel = Panel(
        "east [m]", "north [m]", (*ground, *items), x_limits=limits[0], y_limits=limits[1], equal=True, grid=False
    )
    return Figure("track", "Track", caption, (panel,), linked=False)


def profile(subject: Subject) -> Figure | None:
    """Height over the distance travelled; None for a solution that stays where it is."""
    T = _at_reference_point(subject, subject.result.trajectory)
    ne = frames.ned_from_ecef(T.r_eb_e, frames.llh_from_ecef(T.r_eb_e[0]))[:, :2]
    way = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(ne, axis=0), axis=1))])
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
        R = subject.reference
        inside = (R.t >= T.t[0]) & (R.t <= T.t[-1])
        heights.append(R.llh[inside, 2])
        items.append(path(np.interp(R.t[inside], T.t, way), heights[-1], "reference", "reference"))
    for role, result in subject.solutions:
        moved = _at_reference_point(subject, result.trajectory)
        heights.append(moved.llh[:, 2])
        items.append(path(np.interp(moved.t, T.t, way), heights[-1], role, role))
    panel = Panel(
        f"distance travelled [{'km' if kilo else 'm'}]", "height [m]", tuple(items), x_limits=(0.0, float(way[-1])),
        y_limits=view(heights, least=2.0),
    )  # fmt: skip
    caption = (
        "Height above the ellipsoid along the way: places passed twice should have the same height both times, and "
        "without GNSS heights it is the first to drift."
    )
    return Figure("profile", "Height profile", caption, (panel,), linked=False)


def motion(subject: Subject) -> Figure:
    """Height, speed, roll, pitch and heading over time, with three standard deviations of each."""
    names = ("height [m]", "speed [m/s]", "roll [deg]", "pitch [deg]", "heading [deg]")
    bands: list[list[Item]] = [[] for _ in names]
    curves: list[list[Item]] = [[] for _ in names]
    values: list[list[FloatArray]] = [[] for _ in names]
    edges: list[list[FloatArray]] = [[] for _ in names]
    for role, result in subject.solutions:
        T = result.trajectory
        rpy = T.rpy_nb / units.DEG
        quantities = (T.llh[:, 2], np.linalg.norm(T.v_eb_n, axis=1), rpy[:, 0], rpy[:, 1], np.mod(rpy[:, 2], 360.0))
        k = np.searchsorted(T.t, result.t - 1e-9).clip(0, len(T.t) - 1)
        own = "sigma" if result is subject.result else "sigma_smoothed"
        for i, (y, three) in enumerate(zip(quantities, _three_sigma(subject, result, k), strict=True)):
            t, low, high = subject.seconds(result.t), y[k] - three, y[k] + three
            edges[i] += [low, high]
            values[i].append(y)
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


def _three_sigma(subject: Subject, result: NavigationResult, k: IntArray) -> tuple[FloatArray, ...]:
    """Three sigma of height, speed, roll, pitch, heading at the records k; tilts near the horizon, uncorrelated."""
    T = result.trajectory
    r, v, psi = (3.0 * subject.sigma(result, block) for block in ("dr", "dv", "dpsi"))
    speed = np.linalg.norm(T.v_eb_n[k], axis=1)
    way = T.v_eb_n[k] / np.maximum(speed, 1e-3)[:, None]
    # at rest the speed is the size of an error, whichever way it points
    along = np.where(speed > 0.1, np.linalg.norm(way * v, axis=1), np.linalg.norm(v, axis=1))
    c, s = np.cos(T.rpy_nb[k, 2]), np.sin(T.rpy_nb[k, 2])
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
