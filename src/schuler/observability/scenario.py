"""A filter to be looked at, in one TOML file: motion, turning platform, measurements, states and their priors."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Literal

import numpy as np
from pydantic import Field, model_validator

from schuler import frames, units
from schuler.arrays import FloatArray
from schuler.exceptions import ConfigError
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
from schuler.filtering.states import BLOCKS, StateLayout, StateModel, layout_for
from schuler.navigation.sections import Config, NonNegative, Positive, Section, Triple
from schuler.observability.filter_system import motion_system
from schuler.observability.system import LinearSystem
from schuler.rotary.schedule import Schedule
from schuler.rotary.sections import RotarySection
from schuler.sensors import catalogue
from schuler.sensors.spec import ImuSpec
from schuler.sensors.spec_file import configured_spec
from schuler.simulation.aid_sections import Window
from schuler.simulation.motion import Motion
from schuler.simulation.motion_sections import MotionSection

_STILL = 0.01  # a slower vehicle rests [m/s], [rad/s]


class VelocitySection(Section):
    """Velocity, measured all the time: a turntable that stands, or GNSS velocities alone."""

    sigma_m_s: Positive = 0.01
    rate_hz: Positive = 10.0
    lever_arm_m: Triple = (0.0, 0.0, 0.0)
    outages_s: tuple[Window, ...] = ()


class SolutionSection(Section):
    """GNSS solutions: position, and velocity unless it is left out."""

    rate_hz: Positive = 1.0
    sigma_position_m: Triple = (1.5, 1.5, 3.0)
    sigma_velocity_m_s: Triple | None = (0.05, 0.05, 0.1)
    lever_arm_m: Triple = Field((0.0, 0.0, 0.0), description="from the IMU to the antenna, vehicle axes")
    outages_s: tuple[Window, ...] = ()


class RestSection(Section):
    """Zero-velocity updates where the vehicle rests."""

    sigma_m_s: Positive = 0.02
    rate_hz: Positive = 2.0


class WheelsSection(Section):
    """No slip of the wheels, sideways and up."""

    sigma_m_s: Positive = 0.1
    rate_hz: Positive = 5.0
    min_speed_m_s: Positive = 2.0


class CompassSection(Section):
    """Heading of the vehicle: two antennas, or a compass."""

    sigma_deg: Positive = 0.5
    rate_hz: Positive = 1.0


class PriorSection(Section):
    """1-sigma before the first measurement: the unit observability is measured in. Biases left out: as of the IMU."""

    attitude_deg: Triple = Field((1.0, 1.0, 1.0), description="about north, east, down")
    velocity_m_s: Triple = (0.01, 0.01, 0.01)
    position_m: Triple = (1.0, 1.0, 1.0)
    gyro_bias_deg_h: Positive | None = None
    accel_bias_m_s2: Positive | None = None


class StateSection(Section):
    """Model of a block of states in SI units, instead of the one that follows from the IMU."""

    sigma: Positive
    noise: NonNegative = 0.0
    tau_s: Positive | None = None


class ObservabilityScenario(Config):
    """What is to be looked at.

    Attributes
    ----------
    name : str
    motion : MotionSection
        Motion of the vehicle.
    rotary : RotarySection, optional
        A platform that turns the IMU.
    velocity, gnss, zero_velocity, non_holonomic, heading
        Measurements; those left out are not there.
    imu : str
        Catalogue name or file of a budget: states, priors and noise.
    states : int or tuple of str
        States of the filter: 15, 21, ..., or names of blocks.
    models : dict
        Models of blocks that the IMU says nothing about, such as ``lever``.
    known : tuple of str
        States left out, as if they were known: ``dr``.
    axes : {"ned", "enu"}
        ``enu``: Du's axes, names and signs.
    """

    name: str = "observability"
    motion: MotionSection
    rotary: RotarySection | None = None
    velocity: VelocitySection | None = None
    gnss: SolutionSection | None = None
    zero_velocity: RestSection | None = None
    non_holonomic: WheelsSection | None = None
    heading: CompassSection | None = None
    imu: str
    states: Literal[9, 15, 21, 27, 33, 39, 42] | tuple[str, ...] = 15
    models: dict[str, StateSection] = Field(default_factory=dict)
    prior: PriorSection = PriorSection()
    known: tuple[str, ...] = ()
    axes: Literal["ned", "enu"] = "ned"
    every_s: Positive = Field(1.0, description="spacing of the heat map")

    @model_validator(mode="after")
    def _measured(self) -> ObservabilityScenario:
        kinds = (self.velocity, self.gnss, self.zero_velocity, self.non_holonomic, self.heading)
        if not any(kinds):
            raise ValueError("give at least one measurement: velocity, gnss, zero_velocity, non_holonomic or heading")
        if self.rotary is not None and (self.non_holonomic is not None or self.heading is not None):
            raise ValueError("non_holonomic and heading are in the axes of the vehicle: not with a rotary IMU")
        return self

    @classmethod
    def load(cls, path: Path | str) -> ObservabilityScenario:
        """Checked scenario of a TOML file, to whose folder a budget's file name is relative."""
        data = read_toml(path)
        imu = data.get("imu")
        if isinstance(imu, str) and imu.endswith(".toml"):
            data["imu"] = str(Path(path).resolve().parent / imu)
        return cls.parse(data, str(path))

    def spec(self) -> ImuSpec:
        """Error budget of the IMU."""
        return configured_spec(self.imu) if self.imu.endswith(".toml") else catalogue.spec(self.imu)

    def layout(self) -> StateLayout:
        """States with their models."""
        given = {block: StateModel(m.sigma, m.noise, m.tau_s) for block, m in self.models.items()}
        p = self.prior
        biases = {
            "b_g": None if p.gyro_bias_deg_h is None else p.gyro_bias_deg_h * units.DEG_PER_HR,
            "b_a": p.accel_bias_m_s2,
        }
        spec = self.spec()
        if isinstance(self.states, int):
            fitted = layout_for(spec, self.states).models
        else:
            for block in self.states:
                if block not in given and BLOCKS.get(block, ((-1, 0, 0),))[0][0] < 0:
                    raise ConfigError(f"states: {block} is no error of the IMU: give it a model, [models.{block}]")
            fitted = layout_for(spec, tuple(b for b in self.states if b not in given)).models
            fitted = {b: given.get(b) or fitted[b] for b in self.states}
        models = {**fitted, **given}
        for block, sigma in biases.items():
            if sigma is not None and block in models:
                models[block] = StateModel(sigma, models[block].noise, models[block].tau)
        return StateLayout(models)


def scenario_motion(scenario: ObservabilityScenario) -> tuple[Motion, Motion, Schedule | None]:
    """Motion of the vehicle, of the IMU, and the platform's schedule."""
    vehicle = scenario.motion.build()
    if scenario.rotary is None:
        return vehicle, vehicle, None
    turned = scenario.rotary.build(vehicle)
    return vehicle, turned, turned.schedule


def scenario_system(scenario: ObservabilityScenario | dict[str, Any] | Path | str) -> LinearSystem:
    """Linear system of a scenario: an object, nested dictionaries, or the path of a TOML file.

    Returns
    -------
    LinearSystem
        North-east-down, biases in the IMU's axes.
    """
    if not isinstance(scenario, ObservabilityScenario):
        parse, load = ObservabilityScenario.parse, ObservabilityScenario.load
        scenario = parse(scenario) if isinstance(scenario, dict) else load(scenario)
    vehicle, imu, schedule = scenario_motion(scenario)
    spec, p = scenario.spec(), scenario.prior
    sigma = np.concatenate((np.array(p.attitude_deg) * units.DEG, p.velocity_m_s, p.position_m))
    # the turn between two samples of the ideal IMU stays small
    fastest = 0.0
    if schedule is not None:
        t = np.linspace(0.0, vehicle.duration, 2001)
        fastest = float(np.max(np.linalg.norm(schedule.omega_bs_s(t), axis=1), initial=0.0))
    breaks = () if schedule is None else schedule.breakpoints(0.0, vehicle.duration)
    return motion_system(
        imu, measurements(scenario, vehicle, imu, schedule), scenario.layout(), start_sigma=sigma,
        without=scenario.known, gyro_psd=spec.gyro.random_walk**2, accel_psd=spec.accel.random_walk**2,
        earth_rotation=scenario.motion.earth_rotation, imu_rate_hz=max(20.0, 40.0 * fastest),
        step=min(0.2, 0.1 / max(fastest, 0.1)), breaks=breaks, name=scenario.name,
    )  # fmt: skip


def measurements(
    scenario: ObservabilityScenario, vehicle: Motion, imu: Motion, schedule: Schedule | None
) -> MeasurementSchedule:
    """What is measured, with the values of the truth and the lever arm as it turns in the IMU's axes."""
    parts = []
    if (v := scenario.velocity) is not None:
        t = _times(v.rate_hz, vehicle.duration, v.outages_s)
        parts.append(_velocities(t, imu, schedule, v.lever_arm_m, (v.sigma_m_s,) * 3))
    if (g := scenario.gnss) is not None:
        t = _times(g.rate_hz, vehicle.duration, g.outages_s)
        lever, _ = _lever(t, schedule, g.lever_arm_m)
        s = imu.state(t)
        r = s.r_eb_e + np.einsum("nij,nj->ni", s.C_eb, lever)
        R = np.broadcast_to(np.diag(np.square(g.sigma_position_m)), (len(t), 3, 3))
        parts.append(MeasurementSchedule.of(POSITION, t, r, R, lever))
        if g.sigma_velocity_m_s is not None:
            parts.append(_velocities(t, imu, schedule, g.lever_arm_m, g.sigma_velocity_m_s))
    if (z := scenario.zero_velocity) is not None:
        t = _times(z.rate_hz, vehicle.duration, ())
        body = vehicle.state(t)
        still = (np.linalg.norm(body.v_eb_n, axis=1) < _STILL) & (np.linalg.norm(body.omega_eb_b, axis=1) < _STILL)
        parts.append(MeasurementSchedule.of(ZERO_VELOCITY, t[still], np.zeros(int(still.sum())), z.sigma_m_s**2))
    if (w := scenario.non_holonomic) is not None:
        t = _times(w.rate_hz, vehicle.duration, ())
        body = vehicle.state(t)
        v_b = np.einsum("nji,nj->ni", body.C_nb, body.v_eb_n)
        moving = np.linalg.norm(body.v_eb_n, axis=1) >= w.min_speed_m_s
        for kind, axis in ((LATERAL, 1), (VERTICAL, 2)):
            parts.append(MeasurementSchedule.of(kind, t[moving], v_b[moving, axis], w.sigma_m_s**2))
    if (h := scenario.heading) is not None:
        t = _times(h.rate_hz, vehicle.duration, ())
        yaw = vehicle.state(t).rpy_nb[:, 2]
        parts.append(MeasurementSchedule.of(HEADING, t, yaw, (h.sigma_deg * units.DEG) ** 2))
    return merged(*parts)


def _times(rate_hz: float, duration: float, outages: tuple[Window, ...]) -> FloatArray:
    t = np.arange(1, int(np.floor(duration * rate_hz + 1e-9)) + 1) / rate_hz
    return np.asarray(t[~in_windows(t, outages)])


def _lever(t: FloatArray, schedule: Schedule | None, lever_b: Triple) -> tuple[FloatArray, FloatArray]:
    """Lever arm in the IMU's axes and its rate there. Shapes (n, 3)."""
    if schedule is None:
        fixed = np.broadcast_to(np.array(lever_b), (len(t), 3))
        return np.ascontiguousarray(fixed), np.zeros((len(t), 3))
    return schedule.lever_arm_s(t, np.array(lever_b))


def _velocities(
    t: FloatArray, imu: Motion, schedule: Schedule | None, lever_b: Triple, sigma: Triple
) -> MeasurementSchedule:
    lever, rate = _lever(t, schedule, lever_b)
    s = imu.state(t)
    moved = np.cross(s.omega_eb_b, lever) + rate
    v_e = s.v_eb_e + np.einsum("nij,nj->ni", s.C_eb, moved)
    v_n = np.einsum("nji,nj->ni", frames.C_en(frames.llh_from_ecef(s.r_eb_e)), v_e)
    R = np.broadcast_to(np.diag(np.square(sigma)), (len(t), 3, 3))
    return MeasurementSchedule.of(VELOCITY, t, np.concatenate((v_n, rate), axis=1), R, lever)
