"""Figures of rotating IMUs in free-inertial tests: chapter 3, rates, drives, calibration."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from schuler import frames
from schuler.report import content
from schuler.report.content import Figure, Line, Markers, Panel
from schuler.report.figures import draw
from schuler.units import DEG, DEG_PER_HR

if TYPE_CHECKING:
    from matplotlib.figure import Figure as MplFigure

    from schuler.analysis.rotary.chapter3 import Chapter3
    from schuler.analysis.rotary.kinematic import KinematicTest
    from schuler.analysis.rotary.static import StaticTest
    from schuler.recording.series import Trajectory
    from schuler.rotary.calibration_result import RotationCalibration
    from schuler.rotary.static_run import ErrorHistory

_AXES = ("axis_x", "axis_y", "axis_z")
_SCHEMES = {None: ("mean", "conventional"), "X": ("axis_x", "about X"), "Y": ("axis_y", "about Y"),
            "Z": ("axis_z", "about Z")}  # fmt: skip
_WAYS = {"conventional": ("mean", "conventional"), "I": ("smoothed", "strategy I"), "II": ("filtered", "strategy II")}


def chapter3_figure(found: Chapter3) -> MplFigure:
    """Attitude errors (pitch, roll, azimuth) and velocity errors (E, N, U), all schemes overlaid."""
    runs = {_SCHEMES[axis]: run for axis, run in found.runs.items()}
    title = f"{found.case}, {found.rate / DEG:g} deg/s" + (", with noise" if found.noise else "")
    return draw(Figure("chapter3", title, "", tuple(_history_panels(runs)), columns=3))


def history_figure(runs: dict[str, ErrorHistory], title: str = "Errors at rest") -> MplFigure:
    """The same panels for any named runs, up to four."""
    roles = ("mean", *_AXES)
    named = {(role, name): run for role, (name, run) in zip(roles, runs.items(), strict=False)}
    return draw(Figure("errors", title, "", tuple(_history_panels(named)), columns=3))


def rates_figure(test: StaticTest) -> MplFigure:
    """Means over runs against the rate, by strategy, with the conventional IMU as a level and 95 % bands."""
    from schuler.analysis.rotary.improvement import mean_interval
    from schuler.analysis.rotary.rms import UNITS, index

    x = test.rates / DEG
    limits = (float(x.min()), float(x.max()))
    panels = []
    for quantity in ("horizontal_position", "horizontal_velocity", "roll", "pitch", "azimuth"):
        k, (unit, scale) = index(quantity), UNITS[quantity]
        role, label = _WAYS["conventional"]
        items: list[content.Item] = [
            content.level(limits, float(test.conventional[:, k].mean()) / scale, role, label)
        ]  # fmt: skip
        for strategy, values in test.rotary.items():
            role, label = _WAYS[strategy]
            mean, low, high = (np.array([mean_interval(v[:, k]) for v in values]) / scale).T
            band = "sigma" if strategy == "II" else "sigma_smoothed"
            items += [
                content.band(x, low, high, band),
                content.line(x, mean, role, label),
                Markers(x, mean, role),
            ]
        shown = unit.replace("m_s", "m/s")
        panels.append(
            Panel(
                "rate [deg/s]", f"{quantity.removeprefix('horizontal_')} [{shown}]", tuple(items), log="_" in quantity
            )
        )
    title = f"{test.imu.name} at rest: RMS over {test.duration_s:g} s, means of {test.runs} runs"
    return draw(Figure("rates", title, "", tuple(panels), columns=3))


def kinematic_figure(test: KinematicTest, run: int = 0) -> MplFigure:
    """Tracks, velocity and attitude errors of one run of a drive."""
    from schuler.rotary.static_run import error_history

    solved = test.example(run)
    truth = solved.pop("truth")
    origin = truth.llh[0]
    shown = {"conventional": ("smoothed", "conventional"), "rotary": ("filtered", "rotary")}
    tracks: list[content.Item] = [_track(truth, origin, "reference", "truth")]
    errors = {}
    for name, estimate in solved.items():
        tracks.append(_track(estimate, origin, *shown[name]))
        errors[shown[name]] = error_history(estimate, truth)
    panels = [Panel("east [m]", "north [m]", tuple(tracks), equal=True)]
    history = _history_panels(errors, start=float(truth.t[0]))
    panels += [history[k] for k in (0, 1, 2, 3, 4)]
    title = f"{test.imu.name} driving, rotary at {test.rotary_trial.rate / DEG:g} deg/s, run {run}"
    return draw(Figure("kinematic", title, "", tuple(panels), columns=3, linked=False))


def calibration_figure(found: RotationCalibration) -> MplFigure:
    """Means of stretches with their 1-sigma beside the fitted model, against the rate along the first axis."""
    panels = []
    rate = np.array([s.expected @ found.axes[0] for s in found.stretches])
    error = np.array([s.reading - s.expected for s in found.stretches])
    T = np.array([s.duration for s in found.stretches])
    order = np.argsort(rate)
    model = found.bias + np.array([found.axes @ s.expected for s in found.stretches]) @ found.response
    for i, axis in enumerate("xyz"):
        sigma = found.random_walk[i] / np.sqrt(T) / DEG_PER_HR
        y = error[:, i] / DEG_PER_HR
        x = rate / DEG
        items: list[content.Item] = [
            Line(np.array([a, a]), np.array([b - s, b + s]), "measured")
            for a, b, s in zip(x, y, sigma, strict=True)
        ]  # fmt: skip
        items += [
            Markers(x, y, "measured", "stretches"),
            Line(x[order], model[order, i] / DEG_PER_HR, "filtered", "bias and response"),
        ]
        panels.append(Panel("rate [deg/s]", f"gyroscope {axis} [deg/h]", tuple(items)))
    return draw(Figure("calibration", "Calibration by rotation", "", tuple(panels), columns=3))


def _history_panels(runs: dict[tuple[str, str], ErrorHistory], *, start: float = 0.0) -> list[Panel]:
    """Errors of attitude about E, N, U, then of velocity E, N, U."""
    panels = []
    for what, unit, scale in (("attitude", "deg", DEG), ("velocity", "m/s", 1.0)):
        for i, axis in enumerate("ENU"):
            items = [
                content.line(run.t - start, getattr(run, what)[:, i] / scale, role, label)
                for (role, label), run in runs.items()
            ]
            panels.append(Panel("time [s]", f"{what} {axis} [{unit}]", tuple(items)))
    return panels


def _track(trajectory: Trajectory, origin: np.ndarray, role: str, label: str) -> Line:
    ned = frames.ned_from_ecef(trajectory.r_eb_e, origin)
    return content.path(ned[:, 1], ned[:, 0], role, label)
