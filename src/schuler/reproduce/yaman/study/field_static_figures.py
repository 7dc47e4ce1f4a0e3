"""Figure of the static test: how far units at rest drift, raw, with calibrated gyroscopes, and calibrated."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from schuler.exceptions import InputError
from schuler.plotting.drawing import draw
from schuler.plotting.figure import Figure, Item, Panel, band, line
from schuler.plotting.parts import number
from schuler.reproduce.yaman.study.field_static_unit import VARIANTS

if TYPE_CHECKING:
    from matplotlib.figure import Figure as MplFigure

    from schuler.reproduce.yaman.study.field_static import Part, StaticDrift

_LOOK = {
    "raw": ("axis_y_band", "axis_y", "raw"),
    "gyro": ("axis_z_band", "axis_z", "gyroscopes calibrated"),
    "full": ("axis_x_band", "axis_x", "calibrated"),
}
_SMALLEST = 1e-3  # drift that a logarithmic axis still shows [m]
_PARTS: tuple[Part, ...] = ("horizontal", "vertical")


def static_figure(found: StaticDrift, *, unit: int | None = None) -> MplFigure:
    """Drift over time, horizontal and vertical.

    Parameters
    ----------
    found : StaticDrift
    unit : int, optional
        Number of one unit, shown by itself; by default medians and quartiles of all.

    Returns
    -------
    matplotlib.figure.Figure

    Raises
    ------
    InputError
        If there is no such unit.
    MissingExtraError
        If matplotlib is not installed (extra ``plot``).

    References
    ----------
    Yaman (2017), Figs. 6.7 to 6.12. Departure: logarithmic, so that raw and calibrated units are in one figure.
    """
    return draw(drift(found, unit))


def drift(found: StaticDrift, unit: int | None = None) -> Figure:
    """Description of the figure, see :func:`static_figure`."""
    if unit is not None and unit not in found.unit:
        raise InputError(f"unit: expected one of {', '.join(str(int(k)) for k in found.unit)}, got {unit!r}")
    rows = np.arange(len(found)) if unit is None else np.flatnonzero(found.unit == unit)
    later = found.t > 0.0  # zero at the start has no logarithm
    t = found.t[later]
    panels = []
    for part in _PARTS:
        bands: list[Item] = []
        lines: list[Item] = []
        for variant in VARIANTS:
            shade, role, label = _LOOK[variant]
            size = np.maximum(found.drift(variant, part)[rows][:, later], _SMALLEST)
            if len(rows) > 1:
                low, middle, high = np.percentile(size, [25.0, 50.0, 75.0], axis=0)
                bands.append(band(t, low, high, shade, "quartiles of the units" if variant == "full" else ""))
            else:
                middle = size[0]
            lines.append(line(t, middle, role, label))
        axes = slice(0, 2) if part == "horizontal" else slice(2, 3)
        variance = np.sum(found.sigma[rows][:, later, axes] ** 2, axis=2)
        predicted = np.maximum(np.sqrt(np.median(variance, axis=0)), _SMALLEST)
        lines.append(line(t, predicted, "reference", "predicted for calibrated, RMS"))
        ends = [number(float(np.median(found.drift(v, part)[rows, -1]))) for v in VARIANTS]
        title = f"{part}: {' / '.join(ends)} m after {found.t[-1]:.0f} s"
        panels.append(Panel("time without aid [s]", "drift [m]", (*bands, *lines), title=title, log=True, height=1.4))
    who = f"{len(found)} units" if unit is None else f"unit {unit}"
    return Figure(
        "static_drift",
        f"At rest, {found.job.field.spec.name}, {who}",
        "Position error of free navigation at rest, levelled with the same readings: raw, with the gyroscopes "
        "calibrated, with both triads calibrated. The median of what is calibrated should run a little below the "
        "prediction, which is a root mean square.",
        tuple(panels),
    )
