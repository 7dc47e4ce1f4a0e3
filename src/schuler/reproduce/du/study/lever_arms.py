"""Effect of a turning lever arm and of an IMU off the axis on filters that model them and filters that do not."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any, Literal

import numpy as np

from schuler import frames, rotation
from schuler.arrays import FloatArray
from schuler.exceptions import InputError
from schuler.filtering.engine import FilterOptions, run
from schuler.filtering.initial_state import InitialState
from schuler.filtering.measurements import MeasurementSchedule, gnss_measurements
from schuler.mechanization.strapdown import NavState
from schuler.montecarlo import traits
from schuler.montecarlo.engine import campaign
from schuler.navigation.result import NavigationResult
from schuler.plotting.table import Cell, ResultTable
from schuler.recording.series import Increments
from schuler.recording.trajectory import FullTrajectory
from schuler.reproduce.du.study.drives import long_drive
from schuler.reproduce.du.study.imus import FilterImu
from schuler.reproduce.du.study.integrated import START, IntegratedDrive
from schuler.rotary.aids import in_imu_axes
from schuler.rotary.du_axes import du_axis
from schuler.rotary.filter_start import imu_start
from schuler.rotary.mechanization import rates_at_limits
from schuler.rotary.navigation import vehicle_result
from schuler.rotary.rotating_imu import RotatingMotion, ideal_rotating_imu, vehicle_truth
from schuler.rotary.schedule import Schedule
from schuler.rotary.schemes import continuous, reciprocating
from schuler.sensors.errors import ImuErrors
from schuler.sensors.noise import NoiseModel, White
from schuler.simulation.gnss import GnssModel, simulate_gnss
from schuler.simulation.imu import IdealImu, simulate_imu
from schuler.units import DEG

Variant = Literal["modelled", "no offset", "no lever rate", "lever fixed in the IMU"]

#: What the filter knows: all; nothing of the IMU's offset from the axis; lever arms turn but with no velocity of their
#: own; lever arms stand still in the axes of the IMU.
VARIANTS: tuple[Variant, ...] = ("modelled", "no offset", "no lever rate", "lever fixed in the IMU")
_COLUMNS = ("nis", "nees", "horizontal_m", "horizontal_m_s", "tilt_deg", "heading_deg", "accel_bias_m_s2")


@dataclass(frozen=True)
class LeverCase:
    """A drive with GNSS, an antenna away from the platform and an IMU off its axis.

    Attributes
    ----------
    imu : FilterImu
    rate : float
        About the vertical. [rad/s]
    reverses : bool
        Whole turns there and back with 60 deg/s^2 at the reversals, instead of one sense for ever.
    lever_m : tuple of float
        From the platform's axis to the antenna, vehicle axes. [m]
    offset_m : tuple of float
        From the axis to the accelerometers, IMU axes. [m]
    length_s : float
    """

    imu: FilterImu
    rate: float = 20.0 * DEG
    reverses: bool = False
    lever_m: tuple[float, float, float] = (0.8, 0.3, -1.2)
    offset_m: tuple[float, float, float] = (0.05, 0.0, 0.0)
    length_s: float = 240.0

    @property
    def schedule(self) -> Schedule:
        """Schedule of the platform, after 5 s at rest."""
        if self.reverses:
            return reciprocating(du_axis("Z"), self.rate, acceleration=60.0 * DEG, start=5.0)
        return continuous(du_axis("Z"), self.rate, acceleration=60.0 * DEG, start=5.0)


@traits(threads=True)
def lever_run(case: LeverCase, seed: np.random.SeedSequence) -> dict[str, Any]:
    """One run of a case: the same data through the filter of every variant.

    Returns
    -------
    dict
        For each of ``nis``, ``nees`` (nine navigation states and biases, per degree of freedom), RMS errors of the
        vehicle after a minute, and the length of the accelerometers' bias error at the end: an array over
        :data:`VARIANTS`.
    """
    drive, ideal, truth, motion = _scene(case)
    imu_rng, gnss_rng, start_rng = (np.random.default_rng(s) for s in np.random.SeedSequence(
        seed.entropy, spawn_key=seed.spawn_key).spawn(3))  # fmt: skip
    layout, spec = drive.states, case.imu.spec
    sigma = np.sqrt(layout.initial_variances())
    drawn = sigma * start_rng.standard_normal(len(sigma))
    errors = ImuErrors(
        b_a=drawn[:3], b_g=drawn[3:], gyro_noise=NoiseModel((White(spec.gyro.random_walk),)),
        accel_noise=NoiseModel((White(spec.accel.random_walk),)),
    )  # fmt: skip
    imu = simulate_imu(ideal, errors, imu_rng).imu
    increments = imu.increments()
    accuracy = (case.imu.sigma_gnss,) * 3
    receiver = GnssModel(sigma_position=accuracy, sigma_velocity=accuracy, lever_arm_b=case.lever_m, first_s=0.5)
    fixes = gnss_measurements(simulate_gnss(motion.vehicle, receiver, gnss_rng), case.lever_m, gate=None)
    fixes = fixes.where(fixes.t <= increments.t[-1])
    start = _start(truth, drive, start_rng)
    solutions = [_filtered(case, v, drive, increments, fixes, start, truth, drawn) for v in VARIANTS]
    return {name: np.array([row[k] for row in solutions]) for k, name in enumerate(_COLUMNS)}


def _filtered(
    case: LeverCase,
    variant: Variant,
    drive: IntegratedDrive,
    increments: Increments,
    fixes: MeasurementSchedule,
    start: InitialState,
    truth: FullTrajectory,
    biases: FloatArray,
) -> tuple[float, ...]:
    platform, layout = case.schedule, drive.states
    offset = np.zeros(3) if variant == "no offset" else np.array(case.offset_m)
    rates = rates_at_limits(increments)
    if variant == "lever fixed in the IMU":
        schedule = replace(fixes, lever=fixes.lever - offset)
    else:
        schedule = in_imu_axes(fixes, platform, offset, increments=increments)
    if variant == "no lever rate":
        schedule = replace(schedule, z=np.hstack((schedule.z[:, :3], np.zeros((len(schedule), 5)))))
    at_imu = imu_start(start, platform, offset, rates[0], layout, earth_rotation=True)
    forward = run(increments, schedule, at_imu, layout, *case.imu.psd, FilterOptions(record_s=1.0, output_rate_hz=10.0))
    result = NavigationResult.from_run(forward, schedule.t, schedule.kind, layout)
    result = vehicle_result(result, platform, offset, increments.t, rates[1:])
    e = result.errors(truth).between(60.0, truth.t[-1])
    numbers = e.statistics()
    return (
        result.innovations.mean_nis(),
        float(np.mean(result.nees(truth, biases)[60:])),
        numbers["rms_horizontal_m"],
        numbers["rms_velocity_horizontal_m_s"],
        numbers["rms_tilt_deg"],
        numbers["rms_heading_deg"],
        float(np.linalg.norm(result.parameter("b_a")[-1] - biases[:3])),
    )


@lru_cache(maxsize=4)
def _scene(case: LeverCase) -> tuple[IntegratedDrive, IdealImu, FullTrajectory, RotatingMotion]:
    """Scene that all runs of a case share. Truth at every sample, for records fall between seconds."""
    vehicle = long_drive(case.length_s)
    motion = RotatingMotion(vehicle, case.schedule, np.array(case.offset_m))
    ideal = ideal_rotating_imu(motion, case.imu.spec.rate_hz or 100.0)
    drive = IntegratedDrive(case.imu, case.schedule, (), case.length_s, motion=vehicle)
    return drive, ideal, vehicle_truth(motion, ideal.t), motion


def _start(truth: FullTrajectory, drive: IntegratedDrive, rng: np.random.Generator) -> InitialState:
    """The vehicle's true state with errors as uncertain as it is said to be."""
    C = frames.C_en(truth.llh[0])
    psi, v, r = (C @ (sigma * rng.standard_normal(3)) for sigma in START)
    nav = NavState(
        0.0,
        truth.r_eb_e[0] + r,
        truth.v_eb_e[0] + v,
        rotation.quat_multiply(rotation.quat_from_rotvec(psi), truth.q_eb[0]),
    )
    return InitialState.from_sigmas(nav, drive.states, attitude=START[0], velocity=START[1], position=START[2])


@dataclass(frozen=True, eq=False)
class LeverStudy:
    """Filters that know of levers and offsets, and filters that do not, over many runs.

    Attributes
    ----------
    case : LeverCase
    runs : int
    values : dict of str to ndarray, shape (runs, 4)
        Columns of :func:`lever_run` by run and variant.
    """

    case: LeverCase
    runs: int
    values: dict[str, FloatArray]

    def of(self, variant: Variant, column: str) -> FloatArray:
        """One column of one variant. Shape (runs,)."""
        if variant not in VARIANTS or column not in self.values:
            raise InputError(f"expected one of {VARIANTS} and of {tuple(self.values)}, got {variant!r}, {column!r}")
        return np.asarray(self.values[column][:, VARIANTS.index(variant)])

    def table(self) -> ResultTable:
        """One row a variant: means over the runs."""
        rows: list[tuple[Cell, ...]] = [
            (v, *(float(np.mean(self.of(v, column))) for column in _COLUMNS)) for v in VARIANTS
        ]
        case = self.case
        turning = "turns there and back" if case.reverses else "continuous"
        return ResultTable(
            f"{case.imu.name}, {turning} at {case.rate / DEG:g} deg/s: what the filter knows of levers",
            ("filter", *_COLUMNS),
            tuple(rows),
            (
                f"means over {self.runs} runs of {case.length_s:g} s; antenna {case.lever_m} m from the axis, vehicle "
                f"axes; IMU {case.offset_m} m off it; nis and nees per degree of freedom",
            ),
        )

    def summary(self) -> str:
        """The table as text."""
        return self.table().summary()

    def to_dict(self) -> dict[str, Any]:
        """Plain data for JSON."""
        return self.table().to_dict()


def lever_study(
    case: LeverCase,
    runs: int = 16,
    *,
    seed: int = 0,
    workers: int | None = None,
) -> LeverStudy:
    """Run a case many times, in threads.

    Parameters
    ----------
    case : LeverCase
    runs, seed, workers
        See :func:`schuler.montecarlo.campaign`.

    References
    ----------
    Du (2015) has neither lever arm: antenna and IMU are taken to be at one place, the accelerometers on the axis.
    """
    done = campaign(lever_run, case, runs, seed=seed, workers=workers, keep=True)
    values = {name: np.asarray(done.column(name)) for name in _COLUMNS}
    return LeverStudy(case, len(values["nis"]), values)
