"""Figures of Stefanisko's experiments: samples and drift at rest, generated paths, fused errors, sign sets."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from schuler.arrays import FloatArray
from schuler.plotting.figure import Band, Figure, Item, Line, Markers, Panel, Span, band, level, line, path, view
from schuler.reproduce.stefanisko.study.campaign import FigureEightResult
from schuler.reproduce.stefanisko.study.generator import FlatTrack
from schuler.reproduce.stefanisko.study.sign_sets import SignStudy
from schuler.units import DEG

AXES = ("north", "east", "down")
_ROLES = ("axis_x", "axis_y", "axis_z")
#: Errors by figure: title, columns of the result, labels with unit, size of the unit.
_PARTS = {
    "position": (((6, 7, 8), "[m]", 1.0),),
    "velocity": (((3, 4, 5), "[m/s]", 1.0),),
    "rotation": (((0, 1, 2), "[deg]", DEG),),
    "biases": (((9, 10, 11), "accelerometer [m/s^2]", 1.0), ((12, 13, 14), "gyroscope [deg/s]", DEG)),
}


def samples_figure(t: FloatArray, accel: FloatArray, gyro: FloatArray, sigma: tuple[float, float]) -> Figure:
    """Samples of an IMU at rest with the scatter that its data sheet expects.

    Parameters
    ----------
    t : ndarray, shape (n,)
        [s]
    accel, gyro : ndarray, shape (n, 3)
        [m/s^2], [rad/s]
    sigma : tuple of float
        1-sigma of a sample. [m/s^2], [rad/s]
    """
    panels = []
    for x, s, words, size in ((accel, sigma[0], "[m/s^2]", 1.0), (gyro, sigma[1], "[deg/s]", DEG)):
        for i, role in enumerate(_ROLES):
            mean = float(x[:, i].mean()) / size
            two = np.full(2, 2.0 * s / size)
            ends = np.array([t[0], t[-1]])
            items = (
                band(ends, mean - two, mean + two, f"{role}_band", "two sigma of the data sheet"),
                line(t, x[:, i] / size, role, "xyz"[i]),
            )
            panels.append(Panel("time [s]", f"{'xyz'[i]} {words}", items))
    caption = "Ten seconds at rest, level. The accelerometer that points down reads the reaction to gravity."
    return Figure("samples", "IMU at rest", caption, tuple(panels), columns=3)


def track_figure(t: FloatArray, true_r: FloatArray, true_pitch: FloatArray, solution: FlatTrack) -> Figure:
    """Generated and recomputed position and pitch over time; errors in panels of their own.

    Parameters
    ----------
    t : ndarray, shape (n,)
        [s]
    true_r : ndarray, shape (n, 3)
        [m]
    true_pitch : ndarray, shape (n,)
        [rad]
    solution : FlatTrack
        At the same times.
    """
    pitch = np.arctan2(-solution.C_nb[:, 2, 0], solution.C_nb[:, 0, 0])
    panels = []
    for i, axis in enumerate(AXES):
        items = (line(t, true_r[:, i], "reference", "generated"), line(t, solution.r_n[:, i], "filtered", "recomputed"))
        panels.append(Panel("time [s]", f"{axis} [m]", items))
    items = (line(t, true_pitch / DEG, "reference", "generated"), line(t, pitch / DEG, "filtered", "recomputed"))
    panels.append(Panel("time [s]", "pitch [deg]", items))
    off = np.linalg.norm(solution.r_n - true_r, axis=1)
    panels.append(Panel("time [s]", "position error [m]", (line(t, off, "rejected", "discretisation"),)))
    caption = "No sensor errors: what is left is the step of 6 ms. Exact, no statistical uncertainty."
    return Figure("track", "Input and output of the navigation equations", caption, tuple(panels), columns=2)


def paths_figure(paths: Mapping[str, FloatArray]) -> Figure:
    """Paths in plan and from the side.

    Parameters
    ----------
    paths : mapping of str to ndarray, shape (n, 3)
        North, east, down by name. [m]
    """
    panels = []
    for i, j, x, y in ((0, 1, "north [m]", "east [m]"), (0, 2, "north [m]", "down [m]")):
        items: list[Item] = []
        for (name, r), role in zip(paths.items(), ("reference", "filtered", "smoothed", "case_4"), strict=False):
            items += [path(r[:, i], r[:, j], role, name), Markers(r[-1:, i], r[-1:, j], "end")]
        panels.append(Panel(x, y, tuple(items)))
    caption = "Squares are the ends. In a correct generator the path does not depend on the rotation. Exact."
    return Figure("paths", "Path with and without rotation", caption, tuple(panels), columns=2, linked=False)


def drift_figure(t: FloatArray, tracks: FloatArray, title: str) -> Figure:
    """Position of an IMU at rest over the runs.

    Parameters
    ----------
    t : ndarray, shape (n,)
        [s]
    tracks : ndarray, shape (runs, n, 3)
        [m]
    title : str
    """
    panels = []
    rms = np.sqrt(np.mean(tracks**2, axis=0))
    for i, axis in enumerate(AXES):
        mean, spread = tracks[:, :, i].mean(axis=0), 2.0 * tracks[:, :, i].std(axis=0)
        items = (
            band(t, mean - spread, mean + spread, "sigma", "mean of the runs, two sigma"),
            line(t, tracks[0, :, i], "term", "one run"),
            line(t, rms[:, i], "filtered", "RMS of the runs"),
        )
        panels.append(Panel("time [s]", f"{axis} [m]", items))
    return Figure("drift", title, f"INS alone at rest, {len(tracks)} simulated logs.", tuple(panels), columns=3)


def moving_mean_figure(t: FloatArray, true: FloatArray, left: FloatArray) -> Figure:
    """Displacement of a vehicle, and what a moving mean of its accelerometer leaves of it.

    Parameters
    ----------
    t : ndarray, shape (n,)
        [s]
    true, left : ndarray, shape (n,)
        [m]
    """
    panels = [
        Panel("time [s]", f"{words} [m]", (line(t, x, role, words),))
        for x, role, words in ((true, "reference", "true displacement"), (left, "filtered", "displacement left"))
    ]
    caption = "The mean of the second before is subtracted: a high-pass filter. Exact, without noise."
    return Figure("moving_mean", "A moving mean in motion", caption, tuple(panels))


def gnss_figure(
    t: FloatArray, position: FloatArray, velocity: FloatArray, sigma: tuple[FloatArray, FloatArray]
) -> Figure:
    """Fixes at rest about their mean.

    Parameters
    ----------
    t : ndarray, shape (n,)
        [s]
    position, velocity : ndarray, shape (n, 3)
        North, east, down. [m], [m/s]
    sigma : tuple of ndarray, shape (3,)
        Printed 1 sigma of both.
    """
    panels = []
    ends = np.array([t[0], t[-1]])
    for x, s, unit in ((position, sigma[0], "[m]"), (velocity, sigma[1], "[m/s]")):
        for i, axis in enumerate(AXES):
            two = np.full(2, 2.0 * s[i])
            items = (
                Band(ends, -two, two, "expected", "two sigma as printed"),
                Markers(t, x[:, i], "measured", "fixes"),
            )
            panels.append(Panel("time [s]", f"{axis} {unit}", items))
    return Figure("gnss", "Receiver at rest", "Twenty seconds of simulated fixes.", tuple(panels), columns=3)


def fused_figure(result: FigureEightResult, part: str, title: str, gnss_sigma: FloatArray | None = None) -> Figure:
    """Errors of many runs of the filter with what it claims.

    Parameters
    ----------
    result : FigureEightResult
    part : {"position", "velocity", "rotation", "biases"}
    title : str
    gnss_sigma : ndarray, shape (3,), optional
        1 sigma of a fix, for a level to compare with. [m], [m/s]
    """
    t = result.t
    ends = (float(t[0]), float(t[-1]))
    window = result.case.outage_s
    spans = (Span(*window, "outage", "no GNSS"),) if window is not None else ()
    panels = []
    for columns, unit, size in _PARTS[part]:
        for k, i in enumerate(columns):
            e, claimed = result.errors[:, :, i] / size, np.sqrt(np.mean(result.variances[:, :, i], axis=0)) / size
            items: list[Item] = [
                *spans,
                Band(t, -3.0 * claimed, 3.0 * claimed, "sigma", "claimed 3 sigma"),
                *(Line(t, e[j], "term", "single runs" if j == 0 else "") for j in range(min(len(e), 12))),
                Line(t, np.sqrt(np.mean(e**2, axis=0)), "filtered", "RMS of the runs"),
            ]
            if gnss_sigma is not None:
                items.append(level(ends, float(gnss_sigma[k]), "level", "1 sigma of a fix"))
            name = "xyz"[k] if part == "biases" else AXES[k]
            limits = view([e[:12], 3.0 * claimed[len(claimed) // 10 :]])
            panels.append(Panel("time [s]", f"{name} {unit}", tuple(items), y_limits=limits))
    caption = f"{len(result.errors)} simulated runs. An honest filter keeps its errors inside the band."
    return Figure(f"fused_{part}", title, caption, tuple(panels), columns=3)


def sign_figure(study: SignStudy) -> Figure:
    """Position errors and claims by sign set.

    Parameters
    ----------
    study : SignStudy
    """
    panels = []
    for name, e in study.errors.items():
        p = np.linalg.norm(e[:, :, :3], axis=2)
        claimed = np.sqrt(np.mean(study.sigma[name][:, :, 0] ** 2, axis=0))
        items: tuple[Item, ...] = (
            Band(study.t, np.full_like(study.t, 1e-3), 3.0 * claimed, "sigma", "claimed 3 sigma"),
            *(line(study.t, x, "filtered", "runs" if k == 0 else "") for k, x in enumerate(p)),
        )
        panels.append(Panel("time [s]", "position error [m]", items, title=name, log=True, y_limits=(1e-2, 1e6)))
    caption = "The same draws with sets of signs that agree in themselves, and with those printed."
    return Figure("signs", "Signs of the filter", caption, tuple(panels), columns=2)


def zupt_figure(t: FloatArray, bias: FloatArray, sigma: FloatArray, truth: FloatArray) -> Figure:
    """Biases estimated from zero velocities.

    Parameters
    ----------
    t : ndarray, shape (n,)
        [s]
    bias, sigma : ndarray, shape (n, 6)
        Accelerometers [m/s^2], gyroscopes [rad/s].
    truth : ndarray, shape (6,)
    """
    panels = []
    for i in range(6):
        size, unit = (1.0, "accelerometer {} [m/s^2]") if i < 3 else (DEG, "gyroscope {} [deg/s]")
        x, s = bias[:, i] / size, 3.0 * sigma[:, i] / size
        items = (
            band(t, x - s, x + s, "sigma", "claimed 3 sigma"),
            line(t, x, "filtered", "estimate"),
            level((float(t[0]), float(t[-1])), float(truth[i]) / size, "reference", "true"),
        )
        panels.append(
            Panel(
                "time [s]",
                unit.format("xyz"[i % 3]),
                items,
                y_limits=view([x, truth[i : i + 1] / size], [x - s, x + s]),
            )
        )
    caption = "One long rest. What zero velocities do not show keeps its uncertainty."
    return Figure("zupt", "Biases from zero velocities", caption, tuple(panels), columns=3)
