"""Satellites: sky plot, use over time with reasons, dilution of precision, signal strength."""

from __future__ import annotations

import numpy as np

from schuler import units
from schuler.arrays import BoolArray, FloatArray, IntArray
from schuler.filtering.measurements import REJECTED
from schuler.gnss.dop import Dilution, dilution
from schuler.gnss.point_result import PointSolution
from schuler.gnss.ranges import REASONS, Ranges
from schuler.gnss.signals import SYSTEM_NAMES, SYSTEMS, satellite_name
from schuler.navigation.report.innovations import SATELLITE_KINDS, system_role, systems_of
from schuler.navigation.report.subject import Subject
from schuler.navigation.report.track import outages
from schuler.plotting.figure import TIME, Figure, Item, Limits, Line, Markers, Panel, Text, line, markers, thin

#: How the reasons against a range are marked.
MARKS = {
    1: "no_message", 2: "unhealthy", 3: "masked", 4: "weak", 5: "implausible", 6: "rejected", 7: "unused",
}  # fmt: skip
_SINGLE = (4, 5, 6)  # reasons that come and go: single marks in the timeline, the others lines
_TRACK = 150  # points kept of each satellite's way over the sky
_EPOCHS = 2000  # epochs whose dilution is computed
_RUNS = 400  # stretches drawn of each satellite
_GAP = np.array([np.nan])
_CELLS = 150  # means of the signal strength over the time axis
_DOP_TOP = 20.0


def satellite_figures(
    ranges: Ranges, points: PointSolution | None = None, subject: Subject | None = None
) -> list[Figure]:
    """Sky plot, satellites over time, numbers with dilutions, signal strengths: as far as there is something to show.

    Parameters
    ----------
    ranges : Ranges
        All rows, those that are not used with their reasons.
    points : PointSolution, optional
        Solutions of these ranges: their dilutions, and how many satellites they used. Without them both are those of
        the ranges themselves.
    subject : Subject, optional
        The navigation run: its time axis, its outages, and what its filter rejected.
    """
    if not len(ranges):
        return []
    figures = [sky(ranges), timeline(ranges, subject), geometry(ranges, points, subject), strengths(ranges, subject)]
    return [f for f in figures if f is not None]


def sky(ranges: Ranges) -> Figure | None:
    """Ways of the satellites over the sky, zenith in the middle, north up; None without directions."""
    finite = np.isfinite(ranges.elevation) & np.isfinite(ranges.azimuth)
    if not finite.any():
        return None
    x, y = _on_the_disc(ranges.elevation, ranges.azimuth)
    items: list[Item] = _disc()
    for letter in systems_of(ranges.sat[finite]):
        xs: list[FloatArray] = []
        ys: list[FloatArray] = []
        for s in np.unique(ranges.sat[finite & (ranges.sat // 100 == SYSTEMS.index(letter))]).tolist():
            k = np.flatnonzero(finite & (ranges.sat == s))
            # where it was lost for a while the way is not drawn through
            k = k[thin([x[k], y[k]], _TRACK)]
            xs += [x[k], _GAP]
            ys += [y[k], _GAP]
            items.append(Text(float(x[k[-1]]), float(y[k[-1]]) + 0.005, satellite_name(s)))
        x_way, y_way = np.concatenate(xs), np.concatenate(ys)
        items.append(Line(x_way, y_way, system_role(letter), SYSTEM_NAMES[letter]))
        last = np.flatnonzero(np.isnan(x_way)) - 1
        items.append(Markers(x_way[last], y_way[last], system_role(letter), SYSTEM_NAMES[letter]))
    for reason in sorted(set(REASONS) - {0}):
        role = MARKS.get(reason, "unused")
        k = np.flatnonzero(finite & (ranges.reason == reason))
        if len(k):
            k = k[:: -(-len(k) // 600)]
            items.append(Markers(x[k], y[k], role, REASONS[reason]))
    caption = (
        "Each satellite's way, its name where it was last: zenith in the middle, horizon outside, rings every 30 deg "
        f"of elevation. {_left_out(ranges)}"
    )
    limits = (-1.12, 1.12)
    panel = Panel("east", "north", tuple(items), equal=True, bare=True, x_limits=limits, y_limits=limits, grid=False)
    return Figure("sky", "Satellites in the sky", caption, (panel,), linked=False)


def timeline(ranges: Ranges, subject: Subject | None = None) -> Figure:
    """A row for each satellite: when its ranges were used, left out and why, or rejected by the filter."""
    t = _seconds(ranges.t, subject)
    span = _span(t, subject)
    numbers = np.unique(ranges.sat)[::-1]
    row = {int(s): k for k, s in enumerate(numbers)}
    items: list[Item] = list(outages(subject)) if subject is not None else []
    step = usual_step(ranges.t)
    for letter in systems_of(ranges.sat):
        own = [s for s in numbers.tolist() if s // 100 == SYSTEMS.index(letter)]
        parts = [stretches(t, ranges.used & (ranges.sat == s), float(row[s]), step) for s in own]
        x, y = (np.concatenate([p[i] for p in parts]) for i in range(2))
        if np.isfinite(x).any():
            items.append(Line(x, y, system_role(letter), f"{SYSTEM_NAMES[letter]}, used"))
    place = np.array([row[int(s)] for s in numbers[::-1]], dtype=np.float64)[np.searchsorted(numbers[::-1], ranges.sat)]
    for reason in sorted(set(REASONS) - {0}):
        role = MARKS.get(reason, "unused")
        k = np.flatnonzero(ranges.reason == reason)
        if len(k):
            if reason not in _SINGLE:
                own = ranges.reason == reason
                parts = [stretches(t, own & (ranges.sat == s), float(row[int(s)]), step) for s in numbers]
                x, y = (np.concatenate([p[i] for p in parts]) for i in range(2))
                items.append(Line(x, y, role, REASONS[reason]))
                continue
            k = spread_out(t, place, k, span)
            items.append(Markers(t[k], place[k], role, REASONS[reason]))
    items += _rejected(subject, row, span)
    panel = Panel(
        TIME, "satellite", tuple(items), x_limits=span, y_limits=(-0.8, len(numbers) - 0.2), grid=False,
        y_ticks=tuple((float(k), satellite_name(int(s))) for k, s in enumerate(numbers)),
        height=float(np.clip(0.11 * len(numbers), 1.0, 4.0)),
    )  # fmt: skip
    caption = f"When each satellite was used: a line; marks say why not. {_left_out(ranges)}"
    return Figure("satellites", "Satellites over time", caption, (panel,))


def geometry(ranges: Ranges, points: PointSolution | None = None, subject: Subject | None = None) -> Figure:
    """Number of satellites used, in all and by system, and dilutions of precision."""
    epochs, index = np.unique(ranges.t, return_inverse=True)
    index = np.asarray(index).reshape(-1)
    t = _seconds(epochs, subject)
    span = _span(t, subject)
    shade: list[Item] = list(outages(subject)) if subject is not None else []
    counts: list[Item] = []
    most = 0
    for letter in systems_of(ranges.sat[ranges.used]):
        own = ranges.used & (ranges.sat // 100 == SYSTEMS.index(letter))
        counts.append(
            line(t, np.bincount(index[own], minlength=len(epochs)), system_role(letter), SYSTEM_NAMES[letter])
        )
    total = np.bincount(index[ranges.used], minlength=len(epochs))
    most = int(total.max(initial=0))
    counts.append(line(t, total, "mean", "all"))
    at, dops = _dilutions(ranges, points, epochs, index)
    x = _seconds(at, subject)
    curves = [
        line(x, np.where(np.isfinite(values), values, np.nan), role, name)
        for name, values, role in (
            ("HDOP", dops.hdop, "axis_x"), ("VDOP", dops.vdop, "axis_y"), ("PDOP", dops.pdop, "axis_z"),
        )
    ]  # fmt: skip
    finite = dops.pdop[np.isfinite(dops.pdop)]
    top = min(_DOP_TOP, 1.15 * float(finite.max())) if len(finite) else _DOP_TOP
    beyond = int(np.sum(finite > top))
    none = float(np.mean(~np.isfinite(dops.pdop)))
    title = f"PDOP, median: {np.median(finite):.1f}" if len(finite) else "no epoch has enough satellites"
    title += f"; {beyond} epochs beyond the axis" if beyond else ""
    title += f"; no position from {100.0 * none:.1f} % of the epochs alone" if none and len(finite) else ""
    panels = (
        Panel(TIME, "satellites used [-]", (*shade, *counts), x_limits=span, y_limits=(0.0, most + 1.0)),
        Panel(TIME, "dilution [-]", (*shade, *curves), title=title, x_limits=span, y_limits=(0.0, top)),
    )
    caption = (
        "Satellites used at each epoch, and by how much their geometry magnifies range errors into horizontal (H), "
        "vertical (V) and whole position errors (P): above about six a fix of its own is poor."
    )
    return Figure("dilution", "Number of satellites and dilution of precision", caption, panels)


def strengths(ranges: Ranges, subject: Subject | None = None) -> Figure | None:
    """Signal strength over time and over elevation; None where the receiver tells none."""
    finite = np.isfinite(ranges.cn0)
    if not finite.any():
        return None
    t = _seconds(ranges.t, subject)
    span = _span(t, subject)
    over_time: list[Item] = list(outages(subject)) if subject is not None else []
    over_elevation: list[Item] = []
    for letter in systems_of(ranges.sat[finite]):
        role, label = system_role(letter), SYSTEM_NAMES[letter]
        own = finite & (ranges.sat // 100 == SYSTEMS.index(letter))
        xs: list[FloatArray] = []
        ys: list[FloatArray] = []
        for s in np.unique(ranges.sat[own]).tolist():
            k = own & (ranges.sat == s)
            x, y = _means(t[k], ranges.cn0[k], span)
            xs += [x, _GAP]
            ys += [y, _GAP]
        over_time.append(Line(np.concatenate(xs), np.concatenate(ys), role, label))
        k = np.flatnonzero(own & np.isfinite(ranges.elevation))
        k = k[:: max(1, len(k) // 1500)]
        over_elevation.append(markers(ranges.elevation[k] / units.DEG, ranges.cn0[k], role, label))
    panels = (
        Panel(TIME, "C/N0 [dB-Hz]", tuple(over_time), x_limits=span),
        Panel("elevation [deg]", "C/N0 [dB-Hz]", tuple(over_elevation), x_limits=(0.0, 90.0)),
    )
    caption = (
        "Carrier to noise density of each satellite: means over a hundred-and-fiftieth of the time, and single values "
        "over elevation. Under open sky it rises smoothly with elevation; points far below the others are blocked or "
        "reflected signals."
    )
    return Figure("strength", "Signal strength", caption, panels, linked=False)


def _dilutions(
    ranges: Ranges, points: PointSolution | None, epochs: FloatArray, index: IntArray
) -> tuple[FloatArray, Dilution]:
    """Times and dilutions: of the point solutions, or of the ranges used at evenly spread epochs."""
    if points is not None and len(points):
        return points.t, points.dilution
    chosen = np.unique(np.linspace(0, len(epochs) - 1, min(len(epochs), _EPOCHS)).round().astype(np.int64))
    place = np.full(len(epochs), -1)
    place[chosen] = np.arange(len(chosen))
    k = np.flatnonzero(ranges.used & np.isfinite(ranges.elevation) & (place[index] >= 0))
    row = place[index[k]]
    count = np.bincount(row, minlength=len(chosen))
    column = np.arange(len(k)) - np.repeat(np.cumsum(count) - count, count)
    width = max(int(count.max(initial=0)), 1)
    u, used = np.zeros((len(chosen), width, 3)), np.zeros((len(chosen), width), dtype=bool)
    group = np.zeros((len(chosen), width), dtype=np.int64)
    e, a = ranges.elevation[k], ranges.azimuth[k]
    u[row, column] = np.column_stack((np.cos(e) * np.cos(a), np.cos(e) * np.sin(a), -np.sin(e)))
    used[row, column], group[row, column] = True, ranges.group[k]
    return epochs[chosen], dilution(u, used, group)


def _means(t: FloatArray, values: FloatArray, span: Limits) -> tuple[FloatArray, FloatArray]:
    """Means over a hundred-and-fiftieth of the time axis each, NaN where there is none between others."""
    cell = np.floor(_CELLS * (t - span[0]) / (span[1] - span[0])).astype(np.int64)
    first, last = int(cell.min()), int(cell.max())
    count = np.bincount(cell - first, minlength=last - first + 1)
    total = np.bincount(cell - first, weights=values, minlength=last - first + 1)
    middle = span[0] + (np.arange(first, last + 1) + 0.5) * (span[1] - span[0]) / _CELLS
    return middle, np.where(count > 0, total / np.maximum(count, 1), np.nan)


def _rejected(subject: Subject | None, row: dict[int, int], span: Limits) -> list[Item]:
    """Ranges and range rates that the filter rejected."""
    if subject is None:
        return []
    items: list[Item] = []
    for kind, role in zip(SATELLITE_KINDS, ("filter_range", "filter_rate"), strict=True):
        inn, sat = subject.result.innovations.of(kind), subject.satellite_of(kind)
        k = np.flatnonzero((inn.status == REJECTED) & np.isin(sat, list(row)))
        if len(k):
            t, place = subject.seconds(inn.t), np.array([row.get(int(s), -1) for s in sat], dtype=np.float64)
            k = spread_out(t, place, k, span)
            items.append(Markers(t[k], place[k], role, f"{kind.replace('_', ' ')} rejected by the filter"))
    return items


def _left_out(ranges: Ranges) -> str:
    """Number of ranges left out, by reason."""
    counts = [(REASONS[r], int(np.sum(ranges.reason == r))) for r in REASONS if r]
    reasons = [f"{n} {text}" for text, n in counts if n]
    n = int(ranges.used.sum())
    return f"Of {len(ranges)} ranges {n} are used" + (f"; left out: {', '.join(reasons)}." if reasons else ".")


def _disc() -> list[Item]:
    """Rings every 30 degrees of elevation, the compass cross, and their words."""
    a = np.linspace(0.0, 2.0 * np.pi, 73)
    items: list[Item] = [Line(r * np.sin(a), r * np.cos(a), "graticule") for r in (1.0 / 3.0, 2.0 / 3.0, 1.0)]
    across, middle = np.array([-1.0, 1.0]), np.zeros(2)
    items += [Line(across, middle, "graticule"), Line(middle, across, "graticule")]
    items += [Text(x, y - 0.025, w) for x, y, w in ((0, 1.03, "N"), (1.06, 0, "E"), (0, -1.08, "S"), (-1.06, 0, "W"))]
    items += [Text(0.02, r, f"{e}°", "right") for r, e in ((1.0 / 3.0, 60), (2.0 / 3.0, 30))]
    return items


def _on_the_disc(elevation: FloatArray, azimuth: FloatArray) -> tuple[FloatArray, FloatArray]:
    """East and north on a disc of radius one, elevation falling evenly from the middle to the rim."""
    r = 1.0 - elevation / (90.0 * units.DEG)
    return r * np.sin(azimuth), r * np.cos(azimuth)


def _seconds(t: FloatArray, subject: Subject | None) -> FloatArray:
    return t - t[0] if subject is None else subject.seconds(t)


def _span(t: FloatArray, subject: Subject | None) -> Limits:
    return (float(t[0]), max(float(t[-1]), float(t[0]) + 1e-3)) if subject is None else subject.span


def usual_step(t: FloatArray) -> float:
    """Usual time between epochs. [s]"""
    steps = np.diff(np.unique(t))
    return float(np.median(steps)) if len(steps) else 1.0


def stretches(t: FloatArray, used: BoolArray, height: float, step: float) -> tuple[FloatArray, FloatArray]:
    """A horizontal line wherever something is used without a pause, with a NaN between two of them."""
    when = t[used]
    if not len(when):
        return np.empty(0), np.empty(0)
    pause = np.diff(when)
    least = max(2.5 * step, (when[-1] - when[0]) / _RUNS)  # shorter pauses could not be seen
    cut = np.flatnonzero(pause > least)
    begin, end = np.concatenate(([0], cut + 1)), np.concatenate((cut, [len(when) - 1]))
    x = np.column_stack((when[begin] - 0.5 * step, when[end] + 0.5 * step, np.full(len(begin), np.nan))).ravel()
    return x, np.where(np.isnan(x), np.nan, height)


def spread_out(t: FloatArray, place: FloatArray, k: IntArray, span: Limits) -> IntArray:
    """At most one of the marks in each three-hundredth of the time axis and each row."""
    cell = np.floor(300.0 * (t[k] - span[0]) / (span[1] - span[0])).astype(np.int64)
    _, first = np.unique(np.column_stack((place[k].astype(np.int64), cell)), axis=0, return_index=True)
    return np.asarray(k[np.sort(first)])
