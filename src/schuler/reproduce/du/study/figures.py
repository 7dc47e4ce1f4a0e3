"""Figures of rotating IMUs: modulated biases, chapter 3, tests at rest and driving, calibration, singular values."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from schuler import frames
from schuler.arrays import FloatArray
from schuler.plotting import figure as content
from schuler.plotting.figure import Figure, Item, Line, Markers, Panel, Span
from schuler.reproduce.du.study.floor import noise_growth
from schuler.units import DEG, DEG_PER_HR, PPM

if TYPE_CHECKING:
    from schuler.observability import LinearSystem
    from schuler.recording.trajectory import Trajectory
    from schuler.reproduce.du.study.accuracy import CalibrationAccuracy, CalibrationTrials
    from schuler.reproduce.du.study.fixed_errors import Chapter3
    from schuler.reproduce.du.study.kinematic import KinematicTest
    from schuler.reproduce.du.study.outages import RotaryComparison
    from schuler.reproduce.du.study.static import StaticTest
    from schuler.rotary.free_navigation import ErrorHistory
    from schuler.rotary.modulated_errors import Modulation
    from schuler.simulation.motion import Motion


_AXES = ("axis_x", "axis_y", "axis_z")
_SCHEMES = {None: ("mean", "conventional"), "X": ("axis_x", "about X"), "Y": ("axis_y", "about Y"),
            "Z": ("axis_z", "about Z")}  # fmt: skip
_WAYS = {"conventional": ("mean", "conventional"), "I": ("smoothed", "strategy I"), "II": ("filtered", "strategy II")}
_NAMES = {"conventional": ("mean", "conventional"), "rotary": ("filtered", "rotary"), **_WAYS}


def chapter3_figure(simulation: Chapter3, *, bias: Chapter3 | None = None) -> Figure:
    """Attitude errors about E, N, U (pitch, roll, azimuth at rest) and velocity errors, schemes overlaid.

    Parameters
    ----------
    simulation : Chapter3
    bias : Chapter3, optional
        Its conventional run is drawn as a reference, as figures 3.7 to 3.10 of the thesis do.
    """
    runs = {_SCHEMES[axis]: run for axis, run in simulation.runs.items()}
    if bias is not None:
        runs[("reference", "conventional, biases only")] = bias.runs[None]
    walk = simulation.random_walk
    caption = "Estimate minus truth, of one run."
    if simulation.noise:
        caption += " Shaded: 1 sigma of the noise of the gyroscopes alone."
    title = f"{simulation.case}, {simulation.rate / DEG:g} deg/s" + (", with noise" if simulation.noise else "")
    panels = _history_panels(runs, walk=walk if simulation.noise else 0.0)
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
        Random walk of the gyroscopes: what it makes of attitude and horizontal velocity is shaded. [rad/sqrt(s)]
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
    from schuler.reproduce.du.study.metrics import UNITS, index, mean_interval

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


_LEAST = 1e-12  # of what is drawn on a logarithmic axis
_ROLES = ("filtered", "smoothed", "case_3", "case_4")
_SIDES = (("conventional", "mean", "reference_band"), ("rotary", "filtered", "sigma"))


def modulated_biases(
    modulations: Mapping[str, Modulation],
) -> Figure:
    """A bias in navigation axes and its mean from the start, for several vehicles.

    Parameters
    ----------
    modulations : mapping of str to Modulation
        By label, up to four.
    """
    panels = []
    for what, words in (("bias_n", ""), ("mean_n", "mean ")):
        for k, axis in enumerate(("north", "east", "down")):
            items = tuple(
                content.line(m.t, getattr(m, what)[:, k] / DEG_PER_HR, role, label)
                for (label, m), role in zip(modulations.items(), _ROLES, strict=False)
            )
            limits = content.view([item.y for item in items], least=1.0)
            panels.append(Panel("time [s]", f"{words}{axis} [deg/h]", items, y_limits=limits))
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


def drive_attitude(of: RotaryComparison) -> Figure:
    """Errors of roll, pitch and azimuth over a drive, the first run, with the 1-sigma that the filters claim.

    Parameters
    ----------
    of : RotaryComparison
    """
    panels = []
    for label, part in (("roll", 0), ("pitch", 1), ("azimuth", 2)):
        items: list[Item] = [Span(a, b, "outage", "GNSS withheld") for a, b in of.rotary.drive.outages]
        lines = []
        for name, role, band in _SIDES:
            runs = getattr(of, name)
            c, s = np.cos(runs.yaw), np.sin(runs.yaw)
            e, sigma = runs.records.error[0] / DEG, runs.records.sigma[0] / DEG
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
