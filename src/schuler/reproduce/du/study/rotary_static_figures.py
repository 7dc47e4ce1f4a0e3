"""Figures of rotating IMUs in free-inertial tests: chapter 3, rates, drives, calibration."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from schuler import frames
from schuler.plotting import figure as content
from schuler.plotting.figure import Figure, Line, Markers, Panel
from schuler.reproduce.du.study.floor import noise_growth
from schuler.units import DEG

if TYPE_CHECKING:
    from schuler.recording.trajectory import Trajectory
    from schuler.reproduce.du.study.chapter3 import Chapter3
    from schuler.reproduce.du.study.kinematic import KinematicTest
    from schuler.reproduce.du.study.static import StaticTest
    from schuler.rotary.du_axes import DuAxis
    from schuler.rotary.free_navigation import ErrorHistory

_AXES = ("axis_x", "axis_y", "axis_z")
_SCHEMES = {None: ("mean", "conventional"), "X": ("axis_x", "about X"), "Y": ("axis_y", "about Y"),
            "Z": ("axis_z", "about Z")}  # fmt: skip
_WAYS = {"conventional": ("mean", "conventional"), "I": ("smoothed", "strategy I"), "II": ("filtered", "strategy II")}
_NAMES = {"conventional": ("mean", "conventional"), "rotary": ("filtered", "rotary"), **_WAYS}


def chapter3_figure(
    found: Chapter3, axes: Sequence[DuAxis | None] | None = None, *, bias: Chapter3 | None = None
) -> Figure:
    """Attitude errors about E, N, U (pitch, roll, azimuth at rest) and velocity errors, schemes overlaid.

    Parameters
    ----------
    found : Chapter3
    axes : sequence of {"X", "Y", "Z", None}, optional
        Schemes to show; default all.
    bias : Chapter3, optional
        Its conventional run is drawn as a reference, as figures 3.7 to 3.10 of the thesis do.
    """
    chosen = found.runs if axes is None else axes
    runs = {_SCHEMES[axis]: found.runs[axis] for axis in chosen}
    if bias is not None:
        runs[("reference", "conventional, biases only")] = bias.runs[None]
    walk = found.random_walk
    caption = "Estimate minus truth, of one run."
    if found.noise:
        caption += " Shaded: 1 sigma of the noise of the gyroscopes alone."
    title = f"{found.case}, {found.rate / DEG:g} deg/s" + (", with noise" if found.noise else "")
    panels = _history_panels(runs, walk=walk if found.noise else 0.0)
    return Figure("chapter3", title, caption, tuple(panels), columns=3)


def history_figure(
    runs: Mapping[str, ErrorHistory], title: str = "Errors at rest", *, random_walk: float = 0.0
) -> Figure:
    """The same panels for any named runs, up to four.

    Parameters
    ----------
    runs : mapping of str to ErrorHistory
    title : str
    random_walk : float
        Of the gyroscopes: what it makes of attitude and horizontal velocity is shaded. [rad/sqrt(s)]
    """
    roles = iter(("mean", *_AXES))
    named = {_NAMES.get(name, (next(roles), name)): run for name, run in runs.items()}
    start = min((float(run.t[0]) for run in runs.values()), default=0.0)
    panels = _history_panels(named, start=start, walk=random_walk)
    caption = "Estimate minus truth, of one run." + (
        " Shaded: 1 sigma of the noise of the gyroscopes alone." if random_walk else ""
    )
    return Figure("errors", title, caption, tuple(panels), columns=3)


def rates_figure(test: StaticTest, strategies: Sequence[str] | None = None) -> Figure:
    """Means over runs against the rate, by strategy, with the conventional IMU as a level and 95 % bands."""
    from schuler.reproduce.du.study.improvement import mean_interval
    from schuler.reproduce.du.study.rms import UNITS, index

    x = test.rates / DEG
    limits = (float(x.min()), float(x.max()))
    panels = []
    for quantity in ("horizontal_position", "horizontal_velocity", "roll", "pitch", "azimuth"):
        k, (unit, scale) = index(quantity), UNITS[quantity]
        role, label = _WAYS["conventional"]
        mean, low, high = (v / scale for v in mean_interval(test.conventional[:, k]))
        items: list[content.Item] = [
            content.band(limits, [low] * 2, [high] * 2, "reference_band"), content.level(limits, mean, role, label)
        ]  # fmt: skip
        for strategy in test.rotary if strategies is None else strategies:
            role, label = _WAYS[strategy]
            values = test.rotary[strategy]
            mean_, low_, high_ = (np.array([mean_interval(v[:, k]) for v in values]) / scale).T
            band = "sigma" if strategy == "II" else "sigma_smoothed"
            items += [
                content.band(x, low_, high_, band),
                content.line(x, mean_, role, label),
                Markers(x, mean_, role),
            ]
        shown = unit.replace("m_s", "m/s")
        panels.append(
            Panel(
                "rate [deg/s]", f"{quantity.removeprefix('horizontal_')} [{shown}]", tuple(items), log="_" in quantity
            )
        )
    title = f"{test.imu.name} at rest: RMS over {test.duration_s:g} s, means of {test.runs} runs"
    return Figure("rates", title, "Shaded: 95 % intervals of the means.", tuple(panels), columns=3)


def kinematic_figure(test: KinematicTest, run: int = 0) -> Figure:
    """Tracks, velocity and attitude errors of one run of a drive."""
    from schuler.rotary.free_navigation import error_history

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
    history = _history_panels(errors, start=float(truth.t[0]), walk=test.imu.gyro_random_walk)
    panels += [history[k] for k in (0, 1, 2, 3, 4)]
    title = f"{test.imu.name} driving, rotary at {test.rotary_trial.rate / DEG:g} deg/s, run {run}"
    caption = "Estimate minus truth. Shaded: 1 sigma of the noise of the gyroscopes alone."
    return Figure("kinematic", title, caption, tuple(panels), columns=3, linked=False)


def _history_panels(
    runs: Mapping[tuple[str, str], ErrorHistory], *, start: float = 0.0, walk: float = 0.0
) -> list[Panel]:
    """Errors of attitude about E, N, U, then of velocity; what a random walk of the gyroscopes makes is shaded."""
    panels = []
    t = next(iter(runs.values())).t - start
    sigma = dict(zip(("attitude", "velocity"), noise_growth(walk, t), strict=False))
    for what, unit, scale in (("attitude", "deg", DEG), ("velocity", "m/s", 1.0)):
        for i, axis in enumerate("ENU"):
            items: list[content.Item] = []
            if walk and (what, axis) != ("velocity", "U"):
                s = sigma[what] / scale
                items.append(content.band(t, -s, s, "expected", "gyroscope noise alone, 1 sigma"))
            items += [
                content.line(run.t - start, getattr(run, what)[:, i] / scale, role, label)
                for (role, label), run in runs.items()
            ]
            panels.append(Panel("time [s]", f"{what} {axis} [{unit}]", tuple(items)))
    return panels


def _track(trajectory: Trajectory, origin: np.ndarray, role: str, label: str) -> Line:
    ned = frames.ned_from_ecef(trajectory.r_eb_e, origin)
    return content.path(ned[:, 1], ned[:, 0], role, label)
