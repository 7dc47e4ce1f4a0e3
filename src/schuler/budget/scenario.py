"""A mission for budgets in one TOML file: motion, aids and start, no data; and its linearised run."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, Literal

import numpy as np
from pydantic import Field

from schuler import rotation, units
from schuler.arguments import explains_arguments
from schuler.arrays import ArrayLike, FloatArray
from schuler.budget.linearisation import Linearised, linearise
from schuler.exceptions import InputError
from schuler.files import read_toml
from schuler.filtering.measurements import (
    HEADING,
    LATERAL,
    POSITION,
    VELOCITY,
    VERTICAL,
    ZERO_VELOCITY,
    MeasurementSchedule,
    in_windows,
    merged,
)
from schuler.navigation.sections import Config, NonNegative, Positive, Section, Triple, change_entry
from schuler.plotting.notebook import Abridged
from schuler.recording.series import ImuSeries
from schuler.recording.trajectory import FullTrajectory
from schuler.simulation.aid_sections import Window
from schuler.simulation.imu import ideal_imu
from schuler.simulation.motion import Motion
from schuler.simulation.motion_sections import MotionSection

_STILL = 0.01  # a slower body rests [m/s]


class BudgetGnss(Section):
    """GNSS solutions that aid, 1-sigma of their white errors north, east, down."""

    rate_hz: Positive = 1.0
    sigma_position_m: Triple = (1.5, 1.5, 3.0)
    sigma_velocity_m_s: Triple | None = (0.05, 0.05, 0.1)
    lever_arm_m: Triple = (0.0, 0.0, 0.0)
    outages_s: tuple[Window, ...] = ()
    heading_sigma_deg: Positive | None = Field(None, description="two antennas: heading with every solution")


class BudgetRest(Section):
    """Zero-velocity updates where the motion rests."""

    sigma_m_s: Positive = 0.02
    rate_hz: Positive = 2.0


class BudgetWheels(Section):
    """No slip of the wheels, sideways and up."""

    sigma_m_s: Positive = 0.1
    rate_hz: Positive = 5.0
    min_speed_m_s: Positive = 2.0


class BudgetStart(Section):
    """1-sigma at the start: roll, pitch, heading; north, east, down."""

    attitude_deg: Triple = (0.1, 0.1, 1.0)
    velocity_m_s: Triple = (0.05, 0.05, 0.05)
    position_m: Triple = (1.5, 1.5, 3.0)


class BudgetAccelerometer(Section):
    """1-sigma of what specifications of accelerometers have no field for, the same for every IMU."""

    asymmetry_ppm: NonNegative = Field(0.0, description="SFA: scale factor forwards less backwards, half of it")
    quadratic_ppm_g: NonNegative = Field(0.0, description="SFN: error with the square of the specific force")


class BudgetScenario(Config):
    """A mission: where it goes and what aids it.

    Attributes
    ----------
    name : str
    motion : MotionSection
        Motion, as in a simulation.
    gnss, zero_velocity, non_holonomic
        Aids; those left out are not there.
    start : BudgetStart
    accelerometer : BudgetAccelerometer
        Asymmetry and nonlinearity; none by default.
    states : int
        States of the filter; blocks an IMU has no uncertainty for are left out.
    require : tuple of str
        Such as ``horizontal < 10 m @ 60 s outage``, see :mod:`.requirement`.
    """

    name: str = "mission"
    motion: MotionSection
    gnss: BudgetGnss | None = None
    zero_velocity: BudgetRest | None = None
    non_holonomic: BudgetWheels | None = None
    start: BudgetStart = BudgetStart()
    accelerometer: BudgetAccelerometer = BudgetAccelerometer()
    states: Literal[9, 15, 21, 33, 42] = 15
    require: tuple[str, ...] = ()
    imu_rate_hz: Positive = Field(20.0, description="of the ideal increments the run is linearised with")
    node_rate_hz: Positive = Field(2.0, description="of the covariance")
    every_s: Positive = Field(1.0, description="spacing of the records")
    settle_s: NonNegative = Field(0.0, description="requirements count from then on")

    @classmethod
    def load(cls, path: Path | str, changes: Sequence[tuple[str, Any]] = ()) -> BudgetScenario:
        """Checked scenario of a TOML file; all faults at once, as :class:`ConfigError`.

        Parameters
        ----------
        path : Path or str
        changes : sequence of (str, value)
            Entries put over those of the file, such as ``("gnss.outages_s", [[60.0, 90.0]])``.
        """
        data = read_toml(path)
        for name, value in changes:
            change_entry(data, name, value)
        return cls.parse(data, str(path))


@dataclass(frozen=True, repr=False)
class BudgetMission(Abridged):
    """A mission linearised along its true motion, for any number of IMUs.

    Attributes
    ----------
    name : str
    truth : FullTrajectory
    run : Linearised
    times : ndarray, shape (r,)
        Times of the records. [s]
    outages : tuple of (start, stop)
        [s]
    start_sigma : ndarray, shape (9,)
        Attitude error north, east, down [rad], velocity [m/s], position [m].
    states : int or tuple of str
    settle_s : float
        Requirements count from then on.
    asymmetry, quadratic : float
        1-sigma of SFA [-] and SFN [1/(m/s^2)] of all accelerometers: errors ``SFA |f|`` and ``SFN f^2``.
    """

    name: str
    truth: FullTrajectory
    run: Linearised
    times: FloatArray
    outages: tuple[tuple[float, float], ...]
    start_sigma: FloatArray
    states: int | tuple[str, ...] = 15
    settle_s: float = 0.0
    asymmetry: float = 0.0
    quadratic: float = 0.0

    @cached_property
    def duration(self) -> float:
        """[s]"""
        return float(self.truth.t[-1] - self.truth.t[0])


@explains_arguments
def prepare_budget(scenario: BudgetScenario | dict[str, Any] | Path | str) -> BudgetMission:
    """Linearised run of a scenario: an object, nested dictionaries, or the path of a TOML file.

    Examples
    --------
    >>> mission = schuler.prepare_budget("examples/budget_town.toml")
    >>> mission.name
    'town, GNSS lost for a minute'
    """
    if not isinstance(scenario, BudgetScenario):
        scenario = BudgetScenario.parse(scenario) if isinstance(scenario, dict) else BudgetScenario.load(scenario)
    motion = scenario.motion.build()
    schedule = true_schedule(motion, scenario)
    start = scenario.start
    tilt = rotation_of_start(motion) @ np.diag(np.square(np.array(start.attitude_deg) * units.DEG))
    attitude = np.sqrt(np.diag(tilt @ rotation_of_start(motion).T))
    sigma = np.concatenate((attitude, start.velocity_m_s, start.position_m))
    return linearised_mission(
        motion, schedule, sigma, name=scenario.name, states=scenario.states,
        outages=() if scenario.gnss is None else scenario.gnss.outages_s, imu_rate_hz=scenario.imu_rate_hz,
        node_rate_hz=scenario.node_rate_hz, every_s=scenario.every_s, settle_s=scenario.settle_s,
        earth_rotation=scenario.motion.earth_rotation, asymmetry=scenario.accelerometer.asymmetry_ppm * units.PPM,
        quadratic=scenario.accelerometer.quadratic_ppm_g * units.PPM / units.G0,
    )  # fmt: skip


def linearised_mission(
    motion: Motion,
    schedule: MeasurementSchedule,
    start_sigma: ArrayLike,
    *,
    name: str = "mission",
    states: int | tuple[str, ...] = 15,
    outages: tuple[tuple[float, float], ...] = (),
    imu_rate_hz: float = 20.0,
    node_rate_hz: float = 2.0,
    every_s: float = 1.0,
    settle_s: float = 0.0,
    earth_rotation: bool = True,
    asymmetry: float = 0.0,
    quadratic: float = 0.0,
) -> BudgetMission:
    """Any motion with any measurements that agree with it.

    Parameters
    ----------
    motion : Motion
    schedule : MeasurementSchedule
        Values of the truth, covariances of the aids.
    start_sigma : array_like, shape (9,)
        1-sigma of attitude north, east, down [rad], velocity [m/s], position [m].
    name, states, outages, imu_rate_hz, node_rate_hz, every_s, settle_s
        See :class:`BudgetScenario`.
    earth_rotation : bool
    asymmetry, quadratic : float
        See :class:`BudgetMission`.
    """
    ideal = ideal_imu(motion, imu_rate_hz, earth_rotation=earth_rotation)
    truth = ideal.truth
    increments = ImuSeries(ideal.t[1:], ideal.gyro, ideal.accel, "increment").increments()
    sigma = np.asarray(start_sigma, dtype=np.float64)
    if sigma.shape != (9,):
        raise InputError(f"start_sigma: expected nine 1-sigma values, got shape {sigma.shape}")
    run = linearise(increments, schedule, truth, rate_hz=node_rate_hz, earth_rotation=earth_rotation)
    end = float(increments.t[-1])
    times = np.append(np.arange(every_s, end, every_s), end)
    return BudgetMission(name, truth, run, times, outages, sigma, states, settle_s, asymmetry, quadratic)


def true_schedule(motion: Motion, scenario: BudgetScenario) -> MeasurementSchedule:
    """What the aids of a scenario would measure without errors, with their covariances."""
    parts = []
    g = scenario.gnss
    if g is not None:
        t = np.arange(1.0 / g.rate_hz, motion.duration + 1e-9, 1.0 / g.rate_hz)
        t = t[~in_windows(t, g.outages_s)]
        lever, s = np.array(g.lever_arm_m), motion.state(t)
        r = s.r_eb_e + s.C_eb @ lever
        v = s.v_eb_n + np.einsum("nij,nj->ni", s.C_nb, np.cross(s.omega_eb_b, lever))
        parts.append(_vectors(POSITION, t, r, g.sigma_position_m, g.lever_arm_m))
        if g.sigma_velocity_m_s is not None:
            parts.append(_vectors(VELOCITY, t, v, g.sigma_velocity_m_s, g.lever_arm_m))
        if g.heading_sigma_deg is not None:
            heading = motion.state(t).rpy_nb[:, 2]
            parts.append(MeasurementSchedule.of(HEADING, t, heading, (g.heading_sigma_deg * units.DEG) ** 2))
    z, w = scenario.zero_velocity, scenario.non_holonomic
    if z is not None:
        t = np.arange(1.0 / z.rate_hz, motion.duration + 1e-9, 1.0 / z.rate_hz)
        s = motion.state(t)
        still = (np.linalg.norm(s.v_eb_n, axis=1) < _STILL) & (np.linalg.norm(s.omega_eb_b, axis=1) < _STILL)
        parts.append(MeasurementSchedule.of(ZERO_VELOCITY, t[still], np.zeros(int(still.sum())), z.sigma_m_s**2))
    if w is not None:
        t = np.arange(1.0 / w.rate_hz, motion.duration + 1e-9, 1.0 / w.rate_hz)
        s = motion.state(t)
        v_b = np.einsum("nji,nj->ni", s.C_nb, s.v_eb_n)
        moving = np.linalg.norm(s.v_eb_n, axis=1) >= w.min_speed_m_s
        for kind, axis in ((LATERAL, 1), (VERTICAL, 2)):
            parts.append(MeasurementSchedule.of(kind, t[moving], v_b[moving, axis], w.sigma_m_s**2))
    return merged(*parts)


def rotation_of_start(motion: Motion) -> FloatArray:
    """Matrix from errors of roll, pitch and heading to a rotation vector north, east, down, at the start."""
    roll, pitch, yaw = motion.state(np.array([0.0])).rpy_nb[0]
    c, s = np.cos(yaw), np.sin(yaw)
    x = rotation.dcm_from_rpy(np.array([roll, pitch, yaw]))[:, 0]  # roll turns about the forward axis
    return np.column_stack((x, [-s, c, 0.0], [0.0, 0.0, 1.0]))


def _vectors(kind: int, t: FloatArray, z: FloatArray, sigma: Triple, lever: Triple) -> MeasurementSchedule:
    R = np.broadcast_to(np.diag(np.square(sigma)), (len(t), 3, 3))
    return MeasurementSchedule.of(kind, t, z, R, lever)
