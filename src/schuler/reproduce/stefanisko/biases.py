"""Sections 4.3 and 4.4: drift at rest, and what taking the bias out is worth."""

from __future__ import annotations

from functools import cache, partial
from typing import TYPE_CHECKING

import numpy as np

from schuler.arrays import FloatArray
from schuler.reproduce.cells import Cell, against, claimed, digits, shown
from schuler.reproduce.items import Effort, Item, Outcome
from schuler.reproduce.stefanisko.inertial import HARDWARE
from schuler.units import G0, MG

if TYPE_CHECKING:
    from schuler.reproduce.stefanisko.study.bias_removal import BiasStudy

_GRID = 10  # samples of 6 ms between points of a drift curve


@cache
def _removal(effort: Effort) -> BiasStudy:
    from schuler.reproduce.stefanisko.study.bias_removal import bias_study

    return bias_study(effort.runs(100, 400), effort.seed)


@cache
def _tracks(effort: Effort, strategy: str) -> tuple[FloatArray, FloatArray]:
    """Times and positions of some runs over 20 s."""
    from schuler.reproduce.stefanisko.study.bias_removal import corrected_track, resting_log
    from schuler.reproduce.stefanisko.study.experiment import IMU_INTERVAL_S

    n = round(20.0 / IMU_INTERVAL_S)
    tracks = []
    for child in np.random.SeedSequence(effort.seed).spawn(effort.runs(20, 100)):
        log = resting_log(np.random.default_rng(child), 2 * n)
        tracks.append(corrected_track(log, strategy, n * IMU_INTERVAL_S, n * IMU_INTERVAL_S))  # type: ignore[arg-type]
    t = IMU_INTERVAL_S * np.arange(1.0, n + 1.0)
    return t[::_GRID], np.array(tracks)[:, ::_GRID]


def _drift(effort: Effort) -> Outcome:
    """Fig. 4.6: how the error grows, and whether the data sheet explains its size."""
    from schuler.reproduce.stefanisko.study.bias_removal import BIAS_ACCEL
    from schuler.reproduce.stefanisko.study.figures import drift_figure
    from schuler.sensors import catalogue

    t, tracks = _tracks(effort, "none")
    rms = np.sqrt(np.mean(tracks**2, axis=0))
    late = t >= 5.0
    power = [float(np.polyfit(np.log(t[late]), np.log(rms[late, k]), 1)[0]) for k in range(3)]
    cells: list[Cell] = [
        shown(
            f"{axis} after 20 s", float(rms[-1, k]), unit="m", printed=text, why="the constant errors were chosen by it"
        )
        for k, (axis, text) in enumerate(zip(("x", "y", "z"), ("100", "70", "18"), strict=True))
    ]
    sheet = catalogue.entry("MPU-9150").printed["accel_bias_mg"]
    for k, (axis, printed, tolerance) in enumerate(zip("xyz", (100.0, 70.0, 18.0), sheet, strict=True)):
        needed = 2.0 * printed / 20.0**2 / MG
        cells.append(
            claimed(
                f"{axis}: constant error that it takes, over the data sheet's",
                f"{printed:g} m",
                needed / tolerance,
                high=1.05,
                tolerance="printed digits",
                reference="corrected",
            )
        )
        cells.append(
            against(
                f"{axis}: error put into ours",
                needed,
                BIAS_ACCEL[k] / MG,
                relative=0.05,
                unit="mg",
                tolerance="printed digits",
                reference="corrected",
                source="",
            )
        )
        cells.append(
            against(
                f"{axis}: power of time that the error grows with, 5 to 20 s",
                2.0,
                power[k],
                absolute=0.25,
                reference="corrected",
                source="exponentially",
                tolerance="band",
            )
        )
    return Outcome(
        tuple(cells),
        HARDWARE
        + "Constant errors of ours were chosen to explain his drift, so its size says nothing of ours; that the "
        "data sheet allows them does. The error grows with the square of time (and a cube from the gyroscopes), not "
        "exponentially.",
        (partial(drift_figure, t, tracks, "Drift without correction"),),
    )


def _corrected(strategy: str, printed: float, effort: Effort) -> Outcome:
    """Figs. 4.8 and 4.9: one run of his is one of ours, if it is not rare among them."""
    from schuler.reproduce.stefanisko.study.figures import drift_figure

    study = _removal(effort)
    ends = np.abs(study.end_n[strategy])
    rms = study.rms(strategy)
    uncorrected = study.rms("none")
    larger = float(np.mean(ends.max(axis=1) > printed))
    n = len(ends)
    half = 3.0 / np.sqrt(2.0 * n)
    cells: list[Cell] = [
        claimed(
            "RMS after 20 s, worst axis",
            f"{printed:g} m",
            float(rms.max()),
            low=printed / 10.0,
            high=printed * 10.0,
            unit="m",
        ),
        claimed(
            "share of our runs with more on some axis",
            f"{printed:g} m in one run",
            larger,
            low=0.01,
            high=0.99,
            tolerance="statistical",
        ),
        claimed("better than without correction by", "significantly", float((uncorrected / rms).min()), low=10.0),
    ]
    from schuler.reproduce.stefanisko.study.bias_removal import CHECK

    for k, axis in enumerate(("north", "east", "down")):
        reference = CHECK[strategy][k]
        cells.append(
            against(
                f"RMS after 20 s, {axis}",
                reference,
                float(rms[k]),
                unit="m",
                reference="corrected",
                relative=half + 3.0 / np.sqrt(800.0),
                absolute=0.005,
            )
        )
    t, tracks = _tracks(effort, strategy)
    return Outcome(
        tuple(cells),
        HARDWARE + "Numbers are those of an independent check, 400 runs.",
        (partial(drift_figure, t, tracks, f"Drift with {strategy}"),),
    )


def _which_is_best(effort: Effort) -> Outcome:
    """Section 4.4 and conclusion: the mean is best, so the bias is constant."""
    from schuler.reproduce.stefanisko.study.bias_removal import CHECK, STRATEGIES
    from schuler.reproduce.stefanisko.study.experiment import ACCEL_NOISE, GYRO_NOISE

    study = _removal(effort)
    runs = len(study.end_n["none"])
    relative = 3.0 / np.sqrt(2.0 * runs) + 3.0 / np.sqrt(800.0)
    cells: list[Cell] = []
    for name in STRATEGIES:
        rms = study.rms(name)
        for k, axis in enumerate(("north", "east", "down")):
            if name != "none":
                cells.append(
                    against(
                        f"{name}, {axis}",
                        CHECK[name][k],
                        float(rms[k]),
                        unit="m",
                        relative=relative,
                        absolute=0.005,
                        reference="corrected",
                    )
                )
    total = {name: float(np.linalg.norm(study.rms(name))) for name in STRATEGIES}
    inside, outside = total["mean, same stretch"], total["mean, stretch before"]
    moving = total["moving mean, blocks"]
    root = ACCEL_NOISE * np.sqrt(20.0**3 / 12.0)
    down = (float(study.rms("mean, same stretch")[2]), float(study.rms("mean, stretch before")[2]))
    spread = 4.0 / np.sqrt(2.0 * runs)
    cells += [
        claimed("mean of the same stretch over moving mean", "the mean is best", inside / moving, high=1.0),
        claimed("mean of the stretch before over moving mean", "", outside / moving, low=1.0, reference="corrected"),
        against(
            "same stretch, down: N sqrt(T^3 / 12)", root, down[0], relative=spread, unit="m", reference="corrected"
        ),
        against(
            "stretch before, down: N sqrt(7 T^3 / 12)",
            np.sqrt(7.0) * root,
            down[1],
            relative=spread,
            unit="m",
            reference="corrected",
        ),
    ]
    tilt = G0 * GYRO_NOISE * np.sqrt(20.0**5 / 45.0)
    level = float(np.sqrt(np.mean(study.rms("mean, same stretch")[:2] ** 2)))
    cells += [
        digits(
            "accelerometer noise, not corrected: N sqrt(T^3 / 3)", "0.20", 2.0 * root, unit="m", reference="corrected"
        ),
        digits("accelerometer noise, same stretch: N sqrt(T^3 / 12)", "0.10", root, unit="m", reference="corrected"),
        digits("gyroscope noise, same stretch: g N sqrt(T^5 / 45)", "0.23", tilt, unit="m", reference="corrected"),
        against(
            "same stretch, horizontally: both noises",
            float(np.hypot(root, tilt)),
            level,
            unit="m",
            relative=4.0 / np.sqrt(4.0 * runs),
            reference="corrected",
        ),
    ]
    return Outcome(
        tuple(cells),
        "With white noise and constant biases the moving mean has the smaller error, whichever stretch the mean is "
        "taken from; his order (0.13 m and 0.18 m) is that of one run each, with the mean judged on its own data. On "
        "other data the mean is worse by a factor of two. Nothing follows for the bias.",
    )


def _moving_mean(effort: Effort) -> Outcome:
    """Fig. 4.7 and what a moving mean does to true motion: 125 m become 5."""
    from schuler.reproduce.stefanisko.study.bias_removal import moving_mean_removed
    from schuler.reproduce.stefanisko.study.experiment import IMU_INTERVAL_S
    from schuler.reproduce.stefanisko.study.figures import moving_mean_figure

    h, w = IMU_INTERVAL_S, 167
    t = np.asarray(h * np.arange(4000), dtype=np.float64)
    a = np.where(t < 4.0, 2.5, np.where((t > 12.5) & (t < 16.5), -2.5, 0.0))
    true = np.cumsum(np.cumsum(a)) * h**2
    travel = float(true[-1])
    left = moving_mean_removed(np.column_stack((a, a, a)), w, np.zeros(3), before=np.zeros((w, 3)))[:, 0]
    path = np.cumsum(np.cumsum(left)) * h**2
    ramp = 0.01 * np.column_stack((t, t, t))
    lag = float(moving_mean_removed(ramp, w, np.zeros(3), blocks=True)[2 * w : 3 * w, 0].mean()) / 0.01
    return Outcome(
        (
            against(
                "time by which the mean of the second before lags",
                w * h,
                lag,
                relative=0.01,
                unit="s",
                source="1 s",
                tolerance="discretisation",
            ),
            digits("true travel", "125", travel, unit="m", reference="corrected"),
            digits(
                "what a moving mean leaves of it", "5", float(path[round(12.0 / h)]), unit="m", reference="corrected"
            ),
        ),
        "His sketch shows the lag. A moving mean is a high-pass filter: displacement tends to half a window times "
        "the velocity, so it must not be used in motion (section 4.4).",
        (partial(moving_mean_figure, t, true, path),),
    )


ITEMS: tuple[Item, ...] = (
    Item("fig-4.6", "drift at rest without correction", "hardware", _drift),
    Item("fig-4.7", "the moving mean lags, and takes motion out", "exact", _moving_mean),
    Item("fig-4.8", "drift with the mean removed", "hardware", partial(_corrected, "mean, same stretch", 0.13)),
    Item("fig-4.9", "drift with the moving mean removed", "hardware", partial(_corrected, "moving mean, blocks", 0.18)),
    Item("text-4.4", "which correction is best", "statistical", _which_is_best),
)
