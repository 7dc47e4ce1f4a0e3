"""Figures of rotating IMUs that the thesis has and no other page needs: modulated biases, drives, errors with GNSS."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

from schuler import frames
from schuler.arrays import FloatArray
from schuler.plotting import figure as content
from schuler.plotting.figure import Figure, Item, Markers, Panel, Span
from schuler.units import DEG, DEG_PER_HR, PPM

if TYPE_CHECKING:
    from schuler.observability import LinearSystem
    from schuler.reproduce.du.study.accuracy import CalibrationTrials
    from schuler.reproduce.du.study.calibration_accuracy import CalibrationAccuracy
    from schuler.reproduce.du.study.outages import RotaryComparison
    from schuler.rotary.modulated_errors import Modulation
    from schuler.simulation.motion import Motion

_LEAST = 1e-12  # of what is drawn on a logarithmic axis
_ROLES = ("filtered", "smoothed", "case_3", "case_4")
_SIDES = (("conventional", "mean", "reference_band"), ("rotary", "filtered", "sigma"))


def modulated_biases(found: Mapping[str, Modulation], *, scale: float = DEG_PER_HR, unit: str = "deg/h") -> Figure:
    """A bias in navigation axes and its mean from the start, for several vehicles.

    Parameters
    ----------
    found : mapping of str to Modulation
        By label, up to four.
    scale : float
        Size of the unit.
    unit : str
    """
    panels = []
    for what, words in (("bias_n", ""), ("mean_n", "mean ")):
        for k, axis in enumerate(("north", "east", "down")):
            items = tuple(
                content.line(m.t, getattr(m, what)[:, k] / scale, role, label)
                for (label, m), role in zip(found.items(), _ROLES, strict=False)
            )
            limits = content.view([item.y for item in items], least=1.0)
            panels.append(Panel("time [s]", f"{words}{axis} [{unit}]", items, y_limits=limits))
    caption = (
        "Below the mean since the start, which is what navigation feels. It goes to zero only if the IMU turns in "
        "navigation axes."
    )
    return Figure("modulated_biases", "A constant bias of a turning IMU", caption, tuple(panels), columns=3)


def drive_figure(motion: Motion, title: str) -> Figure:
    """Track, speed and heading of a drive."""
    t = np.arange(0.0, motion.duration, 0.5)
    state = motion.state(t)
    ned = frames.ned_from_ecef(state.r_eb_e, state.llh[0])
    heading = np.unwrap(state.rpy_nb[:, 2]) / DEG
    speed = np.linalg.norm(state.v_eb_n, axis=1)
    panels = (
        Panel(
            "east [m]", "north [m]",
            (
                content.path(ned[:, 1], ned[:, 0], "filtered", "track"),
                Markers(ned[:1, 1], ned[:1, 0], "start", "start"),
            ),
            equal=True,
        ),
        Panel("time [s]", "speed [m/s]", (content.line(t, speed, "filtered"),)),
        Panel("time [s]", "heading [deg]", (content.line(t, heading, "filtered"),)),
    )  # fmt: skip
    return Figure(
        "drive",
        title,
        "The order of the manoeuvres is ours; the heading is not wrapped.",
        panels,
        columns=3,
        linked=False,
    )


def drive_attitude(of: RotaryComparison, run: int = 0) -> Figure:
    """Errors of roll, pitch and azimuth over a drive, one run, with the 1-sigma that the filters claim.

    Parameters
    ----------
    of : RotaryComparison
    run : int
    """
    panels = []
    for label, part in (("roll", 0), ("pitch", 1), ("azimuth", 2)):
        items: list[Item] = [Span(a, b, "outage", "GNSS withheld") for a, b in of.rotary.drive.outages]
        lines = []
        for name, role, band in _SIDES:
            runs = getattr(of, name)
            c, s = np.cos(runs.yaw), np.sin(runs.yaw)
            e, sigma = runs.records.error[run] / DEG, runs.records.sigma[run] / DEG
            error = (c * e[:, 0] + s * e[:, 1], c * e[:, 1] - s * e[:, 0], e[:, 2])[part]
            claimed = (np.hypot(c * sigma[:, 0], s * sigma[:, 1]), np.hypot(c * sigma[:, 1], s * sigma[:, 0]),
                       sigma[:, 2])[part]  # fmt: skip
            items.append(content.band(runs.records.t, -claimed, claimed, band, f"{name}: 1 sigma"))
            lines.append(content.line(runs.records.t, error, role, name))
        panels.append(Panel("time [s]", f"{label} [deg]", (*items, *lines)))
    caption = "Estimate minus truth of one run, and 1 sigma that the filter claims (tilts taken as independent)."
    return Figure("rotary_attitude", f"{of.imu.name}: attitude over the drive", caption, tuple(panels), columns=1)


def singular_values(system: LinearSystem, title: str, *, points: int = 30) -> Figure:
    """Singular values of the measurements so far, in units of the prior.

    Parameters
    ----------
    system : LinearSystem
    title : str
        How the IMU turns.
    points : int
        Moments at which they are computed.
    """
    from schuler.observability import spectra

    ends = (float(system.t[0]), float(system.t[-1]))
    t = np.linspace(*ends, points + 1)[1:]
    values = np.array([s.values for s in spectra(system, t)])
    items: list[Item] = [
        content.line(t, np.maximum(values[:, k], _LEAST), "filtered", "singular values" if k == 0 else "")
        for k in range(values.shape[1])
    ]
    items.append(content.level(ends, 1.0, "reference", "as the prior"))
    panel = Panel("time [s]", "singular value [1 / prior sigma]", tuple(items), log=True, y_limits=(1e-4, 1e8))
    caption = "A direction above the line is known better than before; what is cut off below is not determined."
    return Figure("singular_values", f"What velocity determines, IMU {title}", caption, (panel,))


def accuracy_figure(
    predicted: Mapping[str, list[CalibrationAccuracy]], achieved: Mapping[str, CalibrationTrials] | None = None
) -> Figure:
    """Accuracy of a calibration by rotation against the rate, by the thesis's formula and with the noise it forgets.

    Parameters
    ----------
    predicted : mapping of str to list of CalibrationAccuracy
        By IMU.
    achieved : mapping of str to CalibrationTrials, optional
        Trials, with two standard errors.
    """
    panels = []
    for imu, row in predicted.items():
        rates = np.array([a.rate for a in row]) / DEG
        items: list[Item] = [
            content.line(rates, _column(row, "response_source"), "smoothed", "formula of the thesis"),
            content.line(rates, _column(row, "response"), "filtered", "with the noise of the bias"),
        ]
        trial = (achieved or {}).get(imu)
        if trial is not None:
            x = trial.errors["response"] / PPM
            rms = float(np.sqrt(np.mean(x**2)))
            half = 2.0 * rms / np.sqrt(2.0 * x.size)
            at = np.full(2, abs(trial.predicted.rate) / DEG)
            items += [
                content.Line(at, np.array([rms - half, rms + half]), "read_off"),
                Markers(at[:1], np.array([rms]), "read_off", f"{len(x)} trials, 2 standard errors"),
            ]
        panels.append(Panel("rate [deg/s]", "1 sigma [ppm]", tuple(items), imu, log=True))
    return Figure(
        "calibration_accuracy",
        "Calibration by rotation",
        "1 sigma of scale factor and installation errors; 60 s at rest and 60 s turning.",
        tuple(panels),
        columns=2,
    )


def _column(row: list[CalibrationAccuracy], name: str) -> FloatArray:
    return np.array([getattr(a, name) for a in row]) / PPM
