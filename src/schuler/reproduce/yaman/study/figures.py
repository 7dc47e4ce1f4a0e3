"""Figures of the static test (drift of units at rest, raw and calibrated) and of the routine by hand."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from schuler.exceptions import InputError
from schuler.plotting.drawing import draw
from schuler.plotting.figure import TIME, Figure, Item, Panel, Span, band, line
from schuler.plotting.parts import number
from schuler.reproduce.yaman.study.static_unit import VARIANTS
from schuler.units import DEG

if TYPE_CHECKING:
    from matplotlib.figure import Figure as MplFigure

    from schuler.recording.series import ImuSeries
    from schuler.reproduce.yaman.study.static import Part, StaticDrift
    from schuler.simulation.steps import Routine


_LOOK = {
    "raw": ("axis_y_band", "axis_y", "raw"),
    "gyro": ("axis_z_band", "axis_z", "gyroscopes calibrated"),
    "full": ("axis_x_band", "axis_x", "calibrated"),
}
_SMALLEST = 1e-3  # drift that a logarithmic axis still shows [m]
_PARTS: tuple[Part, ...] = ("horizontal", "vertical")


def static_figure(test: StaticDrift, *, unit: int | None = None) -> MplFigure:
    """Drift over time, horizontal and vertical.

    Parameters
    ----------
    test : StaticDrift
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
    return draw(drift(test, unit))


def drift(test: StaticDrift, unit: int | None = None) -> Figure:
    """Description of the figure, see :func:`static_figure`."""
    if unit is not None and unit not in test.unit:
        raise InputError(f"unit: expected one of {', '.join(str(int(k)) for k in test.unit)}, got {unit!r}")
    rows = np.arange(len(test)) if unit is None else np.flatnonzero(test.unit == unit)
    later = test.t > 0.0  # zero at the start has no logarithm
    t = test.t[later]
    panels = []
    for part in _PARTS:
        bands: list[Item] = []
        lines: list[Item] = []
        for variant in VARIANTS:
            shade, role, label = _LOOK[variant]
            size = np.maximum(test.drift(variant, part)[rows][:, later], _SMALLEST)
            if len(rows) > 1:
                low, middle, high = np.percentile(size, [25.0, 50.0, 75.0], axis=0)
                bands.append(band(t, low, high, shade, "quartiles of the units" if variant == "full" else ""))
            else:
                middle = size[0]
            lines.append(line(t, middle, role, label))
        axes = slice(0, 2) if part == "horizontal" else slice(2, 3)
        variance = np.sum(test.sigma[rows][:, later, axes] ** 2, axis=2)
        predicted = np.maximum(np.sqrt(np.median(variance, axis=0)), _SMALLEST)
        lines.append(line(t, predicted, "reference", "predicted for calibrated, RMS"))
        ends = [number(float(np.median(test.drift(v, part)[rows, -1]))) for v in VARIANTS]
        title = f"{part}: {' / '.join(ends)} m after {test.t[-1]:.0f} s"
        panels.append(Panel("time without aid [s]", "drift [m]", (*bands, *lines), title=title, log=True, height=1.4))
    who = f"{len(test)} units" if unit is None else f"unit {unit}"
    return Figure(
        "static_drift",
        f"At rest, {test.job.field.spec.name}, {who}",
        "Position error of free navigation at rest, levelled with the same readings: raw, with the gyroscopes "
        "calibrated, with both triads calibrated. The median of what is calibrated should run a little below the "
        "prediction, which is a root mean square.",
        tuple(panels),
    )


_AXES = (("x", "axis_x"), ("y", "axis_y"), ("z", "axis_z"))


def readings_figure(imu: ImuSeries) -> Figure:
    """Specific force and angular rate of the three axes over time.

    Parameters
    ----------
    imu : ImuSeries

    Returns
    -------
    Figure

    References
    ----------
    Yaman (2017), Fig. 5.2.
    """
    rates = imu.rates()
    panels = tuple(
        Panel(
            TIME, label, tuple(line(rates.t, values[:, i] / unit, role, axis) for i, (axis, role) in enumerate(_AXES))
        )
        for label, values, unit in (
            ("specific force [m/s^2]", rates.accel, 1.0),
            ("angular rate [deg/s]", rates.gyro, DEG),
        )
    )
    return Figure("readings", "Readings of a perfect IMU", "Gravity goes from axis to axis as each is turned.", panels)


def poses_figure(routine: Routine) -> Figure:
    """Share of each body axis that points up in every rest.

    Parameters
    ----------
    routine : Routine

    Returns
    -------
    Figure

    References
    ----------
    Yaman (2017), Fig. 6.6.
    """
    spans, up = routine.rests, -routine.poses[:, 2, :]
    gap = np.full(len(spans), np.nan)
    t = np.column_stack((spans[:, 0], spans[:, 1], gap)).ravel()
    panels = []
    for i, (axis, role) in enumerate(_AXES):
        y = np.column_stack((up[:, i], up[:, i], gap)).ravel()
        shade: list[Item] = [
            Span(float(a), float(b), "expected", "at rest" if k == 0 else "") for k, (a, b) in enumerate(spans)
        ]
        items = (*shade, line(t, y, role, f"{axis} up"))
        panels.append(Panel(TIME, f"{axis} up [-]", items, y_limits=(-1.1, 1.1), height=0.7))
    return Figure(
        "routine_poses",
        "Poses of the routine",
        "1: the axis points up, -1: down, 0: it is level. Turns lie between the rests.",
        tuple(panels),
    )
