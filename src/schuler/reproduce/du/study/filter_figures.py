"""Figures of the filters of rotating IMUs: zero velocity on a turntable, standard deviations, outages."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from schuler.arrays import FloatArray
from schuler.exceptions import InputError
from schuler.plotting.figure import Figure, Item, Line, Panel, Span, level, line, view
from schuler.units import DEG, DEG_PER_HR, G0

if TYPE_CHECKING:
    from collections.abc import Callable

    from schuler.reproduce.du.study.outages import RotaryComparison
    from schuler.reproduce.du.study.zupt import ZuptSigmas, ZuptStudy
    from schuler.reproduce.du.study.zupt_runs import ZuptEmulation

_ROLES = ("mean", "axis_x", "axis_y", "axis_z", "case_5")
_SIDES = (("conventional", "mean"), ("rotary", "filtered"))


def zupt_runs(of: ZuptEmulation, imu: str, test: str, run: int = 0) -> Figure:
    """Bias estimates and attitude errors of one run in every case of a test on the turntable.

    Parameters
    ----------
    of : ZuptEmulation
    imu, test : str
        Such as "NAV440", "Z".
    run : int

    Raises
    ------
    InputError
        If there is no such test among the runs.
    """
    matching = [r for r in of.runs if (r.imu, r.test) == (imu, test)]
    if not matching:
        raise InputError(f"no runs of {imu!r}, test {test!r}; there are {sorted({(r.imu, r.test) for r in of.runs})}")
    panels = []
    for name, unit, scale, labels, limit in (
        ("b_a", "m/s^2", 1.0, ("x", "y", "z"), None),
        ("b_g", "deg/h", DEG_PER_HR, ("x", "y", "z"), None),
        ("attitude", "deg", DEG, ("roll", "pitch", "azimuth"), (-5.0, 5.0)),
    ):
        for k, axis in enumerate(labels):
            items: list[Item] = []
            for role, r in zip(_ROLES, matching, strict=False):
                items.append(line(r.t, getattr(r, name)[run, :, k] / scale, role, r.case.name))
            what = "error of" if name == "attitude" else name
            limits = limit if axis == "azimuth" else None
            panels.append(Panel("time [s]", f"{what} {axis} [{unit}]", tuple(items), y_limits=limits))
    caption = (
        "One run in every case; biases b_a of accelerometers and b_g of gyroscopes right, forward, up. What is not "
        "observable stays where it began, or runs away; the azimuth is cut off at 5 deg."
    )
    return Figure("rotary_zupt", f"{imu}: zero velocity, rotation about {test}", caption, tuple(panels), columns=3)


def zupt_sigmas(of: ZuptStudy, imu: str) -> Figure:
    """Standard deviations of zero-velocity filters over time, all cases of an IMU overlaid.

    Parameters
    ----------
    of : ZuptStudy
    imu : str

    Raises
    ------
    InputError
        If there is no such IMU in the study.
    """
    sigmas = [s for s in of.sigmas if s.imu == imu]
    if not sigmas:
        raise InputError(f"imu: expected one of {sorted({s.imu for s in of.sigmas})}, got {imu!r}")
    columns: tuple[tuple[str, Callable[[ZuptSigmas], FloatArray]], ...] = (
        ("tilt east [deg]", lambda s: s.tilt[:, 0] / DEG),
        ("tilt north [deg]", lambda s: s.tilt[:, 1] / DEG),
        ("azimuth [deg]", lambda s: s.azimuth / DEG),
        ("b_a x [m/s^2]", lambda s: s.b_a[:, 0]),
        ("b_a y [m/s^2]", lambda s: s.b_a[:, 1]),
        ("b_a z [m/s^2]", lambda s: s.b_a[:, 2]),
        ("b_g x [deg/h]", lambda s: s.b_g[:, 0] / DEG_PER_HR),
        ("b_g y [deg/h]", lambda s: s.b_g[:, 1] / DEG_PER_HR),
        ("b_g z [deg/h]", lambda s: s.b_g[:, 2] / DEG_PER_HR),
    )
    panels = tuple(
        Panel(
            "time [s]", label,
            tuple(line(s.t, of_case(s), role, s.case.name) for role, s in zip(_ROLES, sigmas, strict=False)), log=True,
        )
        for label, of_case in columns
    )  # fmt: skip
    caption = "1-sigma of a zero-velocity filter. Rotation about a tilted axis shows everything but the azimuth."
    return Figure("rotary_zupt_sigmas", f"{imu}: observability at rest", caption, panels, columns=3)


def sigma_histories(of: RotaryComparison) -> Figure:
    """Standard deviations over the drive, conventional and rotating IMU, as figures 6.3 to 6.6 of the thesis.

    Parameters
    ----------
    of : RotaryComparison
    """
    drive = of.rotary.drive
    panels = []
    for label, block, k, scale in (
        ("tilt north [deg]", "dpsi", 0, DEG),
        ("tilt east [deg]", "dpsi", 1, DEG),
        ("azimuth [deg]", "dpsi", 2, DEG),
        ("b_a forward [m/s^2]", "b_a", 0, 1.0),
        ("b_a right [m/s^2]", "b_a", 1, 1.0),
        ("b_a down [m/s^2]", "b_a", 2, 1.0),
        ("b_g forward [deg/h]", "b_g", 0, DEG_PER_HR),
        ("b_g right [deg/h]", "b_g", 1, DEG_PER_HR),
        ("b_g down [deg/h]", "b_g", 2, DEG_PER_HR),
    ):
        items: list[Item] = [Span(a, b, "outage", "GNSS withheld") for a, b in drive.outages]
        for name, role in _SIDES:
            runs = getattr(of, name)
            items.append(line(runs.records.t, runs.sigmas(block)[:, k] / scale, role, name))
        panels.append(Panel("time [s]", label, tuple(items), log=True))
    caption = (
        "1-sigma that the filters claim; biases b_a of accelerometers and b_g of gyroscopes in the axes of the IMU. "
        "While the car stands, a level rotation hides the horizontal biases; once it accelerates, both IMUs show all."
    )
    return Figure("rotary_sigmas", f"{of.imu.name}: standard deviations", caption, tuple(panels), columns=3)


def outage_errors(of: RotaryComparison, run: int = 0) -> Figure:
    """Errors of roll and pitch and of the horizontal velocity in each outage of one run, as figures 6.9 to 6.14.

    Parameters
    ----------
    of : RotaryComparison
    run : int
    """
    panels = []
    for label, k, scale in (
        ("tilt north [deg]", 0, DEG),
        ("tilt east [deg]", 1, DEG),
        ("v north [m/s]", 3, 1.0),
        ("v east [m/s]", 4, 1.0),
    ):
        for number, (start, stop) in enumerate(of.rotary.drive.outages, start=1):
            items: list[Item] = [level((0.0, stop - start), 0.0, "level")]
            drawn = []
            for name, role in _SIDES:
                records = getattr(of, name).records
                inside = (records.t >= start) & (records.t < stop)
                drawn.append(records.error[run, inside, k] / scale)
                items.append(line(records.t[inside] - start, drawn[-1], role, name))
            panels.append(
                Panel(
                    "time since GNSS was lost [s]", label, tuple(items), title=f"outage {number}", y_limits=view(drawn)
                )
            )  # fmt: skip
    caption = (
        "Estimate minus truth. With the rotating IMU tilts swing with its revolution and stay small; what is left is "
        "the noise of the gyroscopes, which no rotation lowers."
    )
    return Figure("rotary_outages", f"{of.imu.name}: one run in its outages", caption, tuple(panels), columns=3)


def growth(of: RotaryComparison) -> Figure:
    """RMS position and velocity errors against the time since GNSS was lost, with the floor of the noise.

    Parameters
    ----------
    of : RotaryComparison
    """
    N = of.imu.spec.gyro.random_walk
    panels = []
    for quantity, label, power, divisor in (
        ("horizontal_m", "horizontal position [m]", 5, 20.0),
        ("horizontal_m_s", "horizontal velocity [m/s]", 3, 3.0),
    ):
        items: list[Item] = []
        for name, role in _SIDES:
            age, rms = getattr(of, name).curve(quantity)
            items.append(Line(age, rms, role, name))
        floor = G0 * N * np.sqrt(2.0 * age**power / divisor)
        items.append(Line(age, floor, "model", "gyroscope noise alone"))
        panels.append(Panel("time since GNSS was lost [s]", f"RMS {label}", tuple(items), log=True))
    gain = of.gain()
    caption = (
        f"RMS over {len(of.rotary)} runs and all outages. Mean gain of rotation in position {gain.ratio:.2f} (95 %: "
        f"{gain.low:.2f} to {gain.high:.2f})."
    )
    return Figure("rotary_growth", f"{of.imu.name}: errors against the length of an outage", caption, tuple(panels), 2)
