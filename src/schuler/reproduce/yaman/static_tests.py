"""Section 6.2.1: the routine by hand, and three units at rest for a minute. Their recordings are not available."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np

from schuler.reproduce.cells import Cell, against, claimed, shown, transcribed
from schuler.reproduce.items import Effort, Item, Outcome
from schuler.reproduce.yaman.campaigns import static_test

if TYPE_CHECKING:
    from schuler.calibration.report.output_figures import Triad
    from schuler.plotting.figure import Figure
    from schuler.recording.series import ImuSeries

_HARDWARE = "Recorded by the author's units; here units are drawn from their data sheets, so no curve can be compared."
_SECONDS = 60.0


def _fig_6_6(effort: Effort) -> Outcome:
    from schuler.simulation.routine import thesis_routine
    from schuler.simulation.steps import Turn
    from schuler.units import DEG

    routine = thesis_routine()
    turns = [(step, C) for step, C in zip(routine.steps, routine.attitudes[:-1], strict=True) if isinstance(step, Turn)]
    level = [abs(float((C @ step.unit)[2])) < 1e-9 for step, C in turns]
    steps = [abs(step.angle) / DEG for step, _ in turns]
    around = {
        axis: sum(step.angle for (step, _), flat in zip(turns, level, strict=True) if flat and step.axis == axis) / DEG
        for axis in "xyz"
    }
    cells = [
        against("median turn between poses", 45.0, float(np.median(steps)), absolute=2.5, unit="deg", tolerance="read"),
        *(
            claimed(f"turned about {axis} while horizontal", "each axis at least once", float(angle), low=360.0 - 1e-9,
                 unit="deg")
            for axis, angle in around.items()
        ),
        shown("poses that differ", float(_different(routine.poses)), unit="-"),
    ]  # fmt: skip

    def figure() -> Figure:
        from schuler.reproduce.yaman.study.figures import poses_figure

        return poses_figure(routine)

    return Outcome(transcribed(*cells), "Drawings of the poses; roughly 45 deg, by hand.", (figure,))


def _different(poses: np.ndarray) -> int:
    return len(np.unique(np.round(-poses[:, 2, :], 6) + 0.0, axis=0))


# ------------------------------------------------------------------------------------------- sensors before and after


def _calibrated_log(effort: Effort, imu: str) -> tuple[ImuSeries, ImuSeries]:
    """Log of one unit in the routine, raw and calibrated."""
    from schuler.reproduce.yaman.study.runs import FieldJob, calibrated, simulated_unit
    from schuler.reproduce.yaman.study.tables import static_spec

    job = FieldJob(static_spec(imu), rests="given", rate_hz=50.0 if effort.quick else 100.0)
    (log, _), _, heading = simulated_unit(job, np.random.SeedSequence(effort.seed))
    return log, calibrated(job, log, heading).calibration.apply(log)


def _misread(log: ImuSeries) -> np.ndarray:
    """Mean reading of the first ten seconds less what is true there, level: x, y, z. [m/s^2]"""
    from schuler import earth
    from schuler.reproduce.yaman.study.runs import PLACE

    g = earth.gravity_ned(PLACE[0], PLACE[2])
    return np.asarray(log.rates().between(0.0, 9.9).accel.mean(axis=0) + g)


def _output(logs: tuple[ImuSeries, ImuSeries], triad: Triad) -> Callable[[], Figure]:
    def make() -> Figure:
        from schuler.calibration.report.output_figures import outputs

        return outputs(*logs, triad)

    return make


def _fig_6_7(effort: Effort) -> Outcome:
    from schuler.sensors import catalogue
    from schuler.units import G0, MG

    logs = _calibrated_log(effort, "MPU-6000")
    raw, clean = (_misread(log) / MG for log in logs)
    s = catalogue.spec("MPU-6000").accel
    sigma = float(np.hypot(s.turn_on_bias, s.scale_factor * G0)) / MG
    cells = [
        # 100 mg has to be an ordinary draw: between the 2.5 % and 97.5 % points of the size of a normal number
        claimed("z reads gravity wrong by, 1 sigma of the sheet", "about 100 mg", sigma, low=100.0 / 2.241,
             high=100.0 / 0.0313, unit="mg", tolerance="statistical"),
        shown("z of this unit, raw", float(raw[2]), unit="mg"),
        shown("z of this unit, calibrated", float(clean[2]), unit="mg"),
        claimed("wrong in the first pose, all axes, calibrated over raw", "seen to be corrected",
             float(np.linalg.norm(clean) / np.linalg.norm(raw)), high=0.1, unit="-"),
    ]  # fmt: skip
    return Outcome(tuple(cells), _HARDWARE, (_output(logs, "accel"),))


def _fig_6_9(effort: Effort) -> Outcome:
    from schuler.reproduce.yaman.study.tables import VN_200_BIAS
    from schuler.units import DEG

    logs = _calibrated_log(effort, "VN-200")
    raw, clean = (log.rates().gyro.mean(axis=0) / DEG - _turned(effort) for log in logs)
    cells = [
        shown("1-sigma of the gyroscopes' bias put in", VN_200_BIAS / DEG, unit="deg/s", printed="z about 1 deg/s",
              why="was put in"),
        *(
            shown(f"mean rate of {axis} too large, raw", float(b), unit="deg/s")
            for axis, b in zip("xyz", raw, strict=True)
        ),
        claimed("all axes, calibrated over raw", "seen to be corrected",
             float(np.linalg.norm(clean) / np.linalg.norm(raw)), high=0.1, unit="-"),
    ]  # fmt: skip
    return Outcome(tuple(cells), _HARDWARE, (_output(logs, "accel"), _output(logs, "gyro")))


def _turned(effort: Effort) -> np.ndarray:
    """Mean rate of a perfect IMU in the routine. Shape (3,). [deg/s]"""
    from schuler.reproduce.yaman.study.runs import FieldJob
    from schuler.reproduce.yaman.study.tables import static_spec
    from schuler.units import DEG

    ideal = FieldJob(static_spec("VN-200"), rate_hz=50.0 if effort.quick else 100.0).ideal
    return np.asarray(ideal.gyro.sum(axis=0) / (ideal.t[-1] - ideal.t[0]) / DEG)


# ------------------------------------------------------------------------------------------- a minute at rest


def _drift(effort: Effort, imu: str) -> tuple[list[Cell], tuple[Callable[[], Figure], ...]]:
    test = static_test(effort, imu)
    gain = float(np.median(test.improvement()))
    cells = [
        claimed("calibration brings, median unit", "more than an order of magnitude", gain, low=10.0, unit="-"),
        *(
            shown(f"{part}, {variant}, median", float(np.median(test.drift(variant, part)[:, -1])), unit="m")
            for part in ("horizontal", "vertical")
            for variant in ("raw", "gyro", "full")
        ),
    ]

    def figure() -> Figure:
        from schuler.reproduce.yaman.study.figures import drift

        return drift(test)

    return cells, (figure,)


def _fig_6_8(effort: Effort) -> Outcome:
    from schuler.reproduce.yaman.study.static import rest_drift
    from schuler.sensors.errors import ImuErrors
    from schuler.units import MG

    cells, figures = _drift(effort, "MPU-6000")
    test = static_test(effort, "MPU-6000")
    down = float(rest_drift(ImuErrors(b_a=np.array([0.0, 0.0, 100.0 * MG])), _SECONDS)[2])
    gyro, full = (np.median(test.drift(v)[:, -1]) for v in ("gyro", "full"))
    claims = [
        claimed("100 mg on z: vertical error after 60 s", "more than 1 km", down, low=1000.0, unit="m"),
        # the vertical channel is not stable: (t / 570 s)^2 / 6 more
        against(
            "100 mg on z: half a t^2",
            50.0 * MG * _SECONDS**2,
            down,
            relative=2.5e-3,
            unit="m",
            tolerance="band",
            reference="corrected",
        ),
        claimed(
            "gyroscopes calibrated over all calibrated",
            "accelerometer errors dominate",
            float(gyro / full),
            low=2.0,
            unit="-",
        ),
    ]
    return Outcome((*claims, *cells), _HARDWARE, figures)


def _fig_6_11(effort: Effort) -> Outcome:
    from schuler import earth
    from schuler.reproduce.yaman.study.runs import PLACE
    from schuler.reproduce.yaman.study.static import rest_drift
    from schuler.sensors.errors import ImuErrors
    from schuler.units import DEG

    cells, figures = _drift(effort, "VN-200")
    z, y = (rest_drift(ImuErrors(b_g=b * 1.0 * DEG), _SECONDS) for b in (np.eye(3)[2], np.eye(3)[1]))
    small = rest_drift(ImuErrors(b_g=np.array([0.0, 0.1 * DEG, 0.0])), _SECONDS)
    g = float(np.linalg.norm(earth.gravity_ned(PLACE[0], PLACE[2])))
    claims = [
        claimed(
            "1 deg/s on z over the same on y: horizontal error",
            "heading only",
            float(_size(z) / _size(y)),
            high=0.01,
            unit="-",
        ),
        against(
            "0.1 deg/s on y: g b t^3 / 6",
            g * 0.1 * DEG * _SECONDS**3 / 6.0,
            _size(small),
            relative=3e-3,
            unit="m",
            tolerance="band",
            reference="corrected",
        ),
        *_gyroscopes_decide(effort, "VN-200"),
    ]
    return Outcome((*claims, *cells), _HARDWARE, figures)


def _fig_6_12(effort: Effort) -> Outcome:
    cells, figures = _drift(effort, "MTi-G-710")
    return Outcome((*_gyroscopes_decide(effort, "MTi-G-710"), *cells), _HARDWARE, figures)


def _gyroscopes_decide(effort: Effort, imu: str) -> list[Cell]:
    test = static_test(effort, imu)
    raw, gyro = (float(np.median(test.drift(v, "horizontal")[:, -1])) for v in ("raw", "gyro"))
    return [
        claimed("horizontal error left when gyroscopes alone are calibrated", "a horizontal gyroscope's bias dominates",
             gyro / raw, high=0.5, unit="-"),
    ]  # fmt: skip


def _size(error: np.ndarray) -> float:
    return float(np.hypot(error[0], error[1]))


ITEMS = (
    Item("fig-6.6", "Poses of the routine by hand", "exact", _fig_6_6),
    Item("fig-6.7", "MPU-6000: accelerometers raw and calibrated", "hardware", _fig_6_7),
    Item("fig-6.8", "MPU-6000: drift at rest", "hardware", _fig_6_8),
    Item("fig-6.9", "VN-200: readings raw and calibrated", "hardware", _fig_6_9, also=("fig-6.10",)),
    Item("fig-6.11", "VN-200: drift at rest", "hardware", _fig_6_11),
    Item("fig-6.12", "MTi-G-710: drift at rest", "hardware", _fig_6_12),
)
