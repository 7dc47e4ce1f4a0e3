"""What is plotted of a calibration: residuals per pose, directions covered, before and after, parameters."""

from __future__ import annotations

import numpy as np

from schuler.arrays import FloatArray
from schuler.calibration.result.result import CalibrationResult, Residuals
from schuler.calibration.result.sheet import sheet
from schuler.plotting.figure import Band, Bars, Figure, Item, Line, Markers, Panel, Picture, Text, level
from schuler.plotting.heat import SIGNED, colours, frame, key
from schuler.units import DEG

OUTLIER = 3.0  # residuals beyond so many sigma are marked
_GRID = 2000  # places asked for their distance to the nearest pose: every 2.5 degrees
_ROLES = ("filtered", "read_off", "smoothed")  # one may lie on the other: dots, rings, dots

_STRONG = 0.9  # correlation of two parameters that is marked


def all_figures(result: CalibrationResult) -> list[Figure]:
    """Every figure there is something to show in: residuals, coverage, before and after, parameters."""
    figures = (residuals(result), coverage(result), before_after(result), parameters(result))
    return [f for f in figures if f is not None]


def residuals(result: CalibrationResult) -> Figure | None:
    """What is left of each pose or turn, on bars of one and two sigma."""
    panels = [_residuals_panel(name, r) for name, r in result.residuals.items() if len(r.value)]
    if not panels:
        return None
    return Figure(
        "residuals",
        "Residuals",
        "Two of three should lie in the darker bars and nineteen of twenty in the lighter ones; many outside mean that "
        "the noise is larger than stated or the model lacks something, one far outside that this pose was disturbed.",
        tuple(panels),
        linked=False,
    )


def coverage(result: CalibrationResult) -> Figure | None:
    """Where the reference pointed, seen from the sensor: all directions in one equal-area map."""
    shown = {n: r.direction for n, r in result.residuals.items() if r.direction is not None and len(r.direction)}
    if not shown:
        return None
    items: list[Item] = list(_graticule())
    for (name, v), role in zip(shown.items(), _ROLES, strict=False):
        items.append(Markers(*_mollweide(v), role, f"poses ({name})"))
    gap, where = largest_gap(np.concatenate(list(shown.values())))
    x, y = _mollweide(where[None, :])
    items.append(Markers(x, y, "rejected", "middle of the largest gap"))
    for text, axis in (("+x", (1, 0, 0)), ("+y", (0, 1, 0)), ("-y", (0, -1, 0)), ("+z", (0, 0, 1)), ("-z", (0, 0, -1))):
        px, py = _mollweide(np.array([axis], dtype=np.float64))
        items.append(Text(float(px[0]), float(py[0]), text))
    ends = np.sqrt(8.0)
    items += [Text(-ends, 0.0, "-x"), Text(ends, 0.0, "-x")]
    title = f"largest gap {gap / DEG:.0f} degrees around ({where[0]:+.2f}, {where[1]:+.2f}, {where[2]:+.2f})"
    panel = Panel(
        "along x and y [-]", "along z [-]", tuple(items), title=title, x_limits=(-3.1, 3.1), equal=True,
    )  # fmt: skip
    return Figure(
        "coverage",
        "Directions covered",
        "Every point is a pose: where the reference pointed in body axes, in an equal-area (Mollweide) map with x in "
        "the middle and z on top. Large empty regions are where the calibration extrapolates.",
        (panel,),
    )


def largest_gap(directions: FloatArray) -> tuple[float, FloatArray]:
    """Angle from the direction furthest from all poses to the nearest of them.

    Parameters
    ----------
    directions : ndarray, shape (n, 3)
        Unit vectors.

    Returns
    -------
    angle : float
        To 2.5 degrees. [rad]
    where : ndarray, shape (3,)
        The middle of the gap, a unit vector.
    """
    # points in equal steps of z, turned by the golden angle each: as even as points on a sphere get
    k = np.arange(_GRID) + 0.5
    z, turn = 1.0 - 2.0 * k / _GRID, k * np.pi * (3.0 - np.sqrt(5.0))
    grid = np.stack([np.sqrt(1.0 - z**2) * np.cos(turn), np.sqrt(1.0 - z**2) * np.sin(turn), z], axis=1)
    nearest = (grid @ directions.T).max(axis=1)
    worst = int(np.argmin(nearest))
    return float(np.arccos(np.clip(nearest[worst], -1.0, 1.0))), np.asarray(grid[worst])


def before_after(result: CalibrationResult) -> Figure | None:
    """How large residuals were before and are after, as histograms over orders of magnitude."""
    panels = []
    for name, r in result.residuals.items():
        if r.before is None or not len(r.value):
            continue
        before, after = (np.abs(v) for v in (r.before, r.value))
        floor = max(1e-3 * float(np.median(r.sigma)), 1e-6 * float(before.max()), 1e-300)
        both = np.maximum(np.concatenate((before, after)), floor)  # perfect data leave zeros
        low, high = np.floor(4.0 * np.log10(both.min())), np.ceil(4.0 * np.log10(both.max()) + 1e-9)
        edges = 10.0 ** (np.arange(low, max(high, low + 1.0) + 1.0) / 4.0)
        items: list[Item] = []
        for values, role, label in ((before, "sigma_smoothed", "before"), (after, "sigma", "after")):
            count, _ = np.histogram(np.maximum(values, floor * (1.0 + 1e-12)), edges)
            x, y = np.repeat(edges, 2)[1:-1], np.repeat(count, 2).astype(np.float64)
            items += [Band(x, np.zeros_like(y), y, role, label), Line(x, y, _LINES[role])]
        rms = float(np.sqrt(np.mean(before**2)))
        title = f"{name}: rms {rms:.3g} {r.unit} before, {r.rms:.3g} {r.unit} after"
        panels.append(Panel(f"size of the residual [{r.unit}]", "number [-]", tuple(items), title=title, log_x=True))
    if not panels:
        return None
    return Figure(
        "before_after",
        "Before and after",
        "How many poses were off by how much with the uncalibrated sensor, and are after the calibration.",
        tuple(panels),
        columns=min(len(panels), 2),
        linked=False,
    )


_LINES = {"sigma": "filtered", "sigma_smoothed": "smoothed"}


def parameters(result: CalibrationResult) -> Figure | None:
    """Parameters with one sigma in data-sheet units, a panel for each kind."""
    families: dict[str, list[str]] = {}
    for name in (*result.names, *result.fixed):
        families.setdefault(sheet(name).family, []).append(name)
    panels = [_parameters_panel(result, family, names) for family, names in families.items()]
    if not panels:
        return None
    return Figure(
        "parameters",
        "Parameters",
        "Estimates with one sigma, which is smaller than the dot where it cannot be seen. Crosses stand for what these "
        "data do not determine, rings for what was held.",
        tuple(panels),
        columns=2,
        linked=False,
    )


def correlation_map(result: CalibrationResult) -> Figure | None:
    """Correlations of all estimated parameters as a heat map; None for fewer than two that are determined."""
    determined = np.flatnonzero(np.isfinite(result.sigma) & (result.sigma > 0.0))
    n = len(determined)
    if n < 2:
        return None
    names = [result.names[i] for i in determined]
    C = result.correlation[np.ix_(determined, determined)]
    picture = Picture(-0.5, n - 0.5, -0.5, n - 0.5, colours(np.repeat(np.repeat(C, 8, axis=0), 8, axis=1), SIGNED))
    first, second = np.triu_indices(n, 1)
    strong = np.abs(C[first, second]) > _STRONG
    x, y = (np.asarray(v, dtype=np.float64) for v in (second[strong], n - 1.0 - first[strong]))
    where = Markers(x, y, "read_off", f"beyond {_STRONG:g}")
    items: tuple[Item, ...] = (picture, frame(picture), *((where,) if strong.any() else ()))
    ticks = tuple((n - 1.0 - i, name) for i, name in enumerate(names))
    panel = Panel(
        "number of the parameter, from above and from the left [-]", "", items, x_limits=(-0.5, n - 0.5),
        y_limits=(-0.5, n - 0.5), grid=False, y_ticks=ticks, height=max(1.0, 0.1 * n),
    )  # fmt: skip
    caption = (
        "Parameters that the log cannot tell apart are strongly correlated: blue below zero, orange above; their sum "
        "or difference is known better than either."
    )
    scale = key("correlation [-]", (-1.0, 1.0), SIGNED)
    return Figure("correlations", "Correlation of the parameters", caption, (panel, scale), linked=False)


def _parameters_panel(result: CalibrationResult, family: str, names: list[str]) -> Panel:
    x = np.arange(1.0, len(names) + 1.0)
    factor = sheet(names[0]).factor
    value, sigma = (np.array(v) / factor for v in zip(*(result[n] for n in names), strict=True))
    lost, held = ~np.isfinite(sigma), np.array([n in result.fixed for n in names])
    value, spread = np.where(lost, 0.0, value), np.where(lost, 0.0, sigma)
    items: list[Item] = [Bars(x, np.where(held, 0.0, value), "unused"), level((0.4, len(names) + 0.6), 0.0, "level")]
    for which, role, label in (
        (~lost & ~held, "filtered", "estimate, 1 sigma"),
        (lost, "rejected", "not determined"),
        (held, "unused", "held"),
    ):  # fmt: skip
        if which.any():
            if role == "filtered":
                items.append(Line(*_bars(x[which], (value - spread)[which], (value + spread)[which]), "filtered"))
            items.append(Markers(x[which], value[which], role, label))
    items += [Text(float(a), max(float(v + s), 0.0), n) for a, v, s, n in zip(x, value, spread, names, strict=True)]
    low, high = float(np.min(value - spread, initial=0.0)), float(np.max(value + spread, initial=0.0))
    room = 0.12 * (high - low) or 1.0
    return Panel(
        "parameter [-]", f"value [{sheet(names[0]).unit}]", tuple(items), title=family,
        x_limits=(0.4, len(names) + 0.6), y_limits=(low - room, high + 2.0 * room),
    )  # fmt: skip


def _residuals_panel(name: str, r: Residuals) -> Panel:
    n = len(r.value)
    x = np.arange(1.0, n + 1.0)
    items: list[Item] = []
    for k in (2.0, 1.0):
        low, high = -k * r.sigma, k * r.sigma
        items.append(Band(*_boxes(x, low, high), "expected", f"{k:.0f} sigma"))
    items.append(level((0.4, n + 0.6), 0.0, "level"))
    far = np.abs(r.value) > OUTLIER * r.sigma
    items.append(Markers(x[~far], r.value[~far], "filtered", "residual"))
    if far.any():
        items.append(Markers(x[far], r.value[far], "rejected", f"beyond {OUTLIER:.0f} sigma"))
    title = f"{name}: rms {r.rms:.3g} {r.unit}"
    return Panel("number [-]", f"residual [{r.unit}]", tuple(items), title=title, x_limits=(0.4, n + 0.6))


def _bars(x: FloatArray, low: FloatArray, high: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Upright strokes as one line that is broken between them."""
    gap = np.full_like(x, np.nan)
    return np.repeat(x, 3), np.stack([low, high, gap], axis=1).ravel()


def _boxes(x: FloatArray, low: FloatArray, high: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Boxes as one band that is broken between them."""
    gap = np.full_like(x, np.nan)
    return (
        np.stack([x - 0.35, x + 0.35, x + 0.5], axis=1).ravel(),
        np.stack([low, low, gap], axis=1).ravel(),
        np.stack([high, high, gap], axis=1).ravel(),
    )


def _mollweide(v: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Equal-area map of directions, x in the middle, z on top: Snyder (1987), eqs. (31-1) to (31-3)."""
    lat, lon = np.arcsin(np.clip(v[:, 2], -1.0, 1.0)), np.arctan2(v[:, 1], v[:, 0])
    return _mapped(lat, lon)


def _mapped(lat: FloatArray, lon: FloatArray) -> tuple[FloatArray, FloatArray]:
    wanted = np.pi * np.sin(lat)
    # 2 theta + sin 2 theta = pi sin lat by halving: Newton's steps vanish at the poles
    low, high = np.full_like(wanted, -np.pi / 2.0), np.full_like(wanted, np.pi / 2.0)
    for _ in range(50):
        theta = 0.5 * (low + high)
        above = 2.0 * theta + np.sin(2.0 * theta) > wanted
        low, high = np.where(above, low, theta), np.where(above, theta, high)
    theta = 0.5 * (low + high)
    return np.asarray(2.0 * np.sqrt(2.0) / np.pi * lon * np.cos(theta)), np.asarray(np.sqrt(2.0) * np.sin(theta))


def _graticule() -> list[Line]:
    """The rim of the map, meridians every 60 degrees and parallels every 30."""
    t = np.linspace(-1.0, 1.0, 61)
    lines = [Line(*_mapped(0.5 * np.pi * t, np.full_like(t, lon)), "term") for lon in np.linspace(-np.pi, np.pi, 7)]
    return lines + [
        Line(*_mapped(np.full_like(t, lat), np.pi * t), "term") for lat in np.linspace(-60.0, 60.0, 5) * DEG
    ]
