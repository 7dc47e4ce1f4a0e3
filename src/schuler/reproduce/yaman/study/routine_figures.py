"""Figures of a routine by hand: what a perfect IMU reads in it, and which way its axes point."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from schuler.plotting.figure import TIME, Figure, Item, Panel, Span, line
from schuler.units import DEG

if TYPE_CHECKING:
    from schuler.recording.series import ImuSeries
    from schuler.simulation.routine_steps import Routine

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
