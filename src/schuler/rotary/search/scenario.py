"""A rotating IMU on a mission, in one TOML file: how it is turned, what aids it, and what may be searched."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Field, model_validator

from schuler import units
from schuler.budget.scenario import (
    BudgetGnss,
    BudgetMission,
    BudgetRest,
    BudgetScenario,
    BudgetStart,
    linearised_mission,
    rotation_of_start,
    true_schedule,
)
from schuler.exceptions import ConfigError
from schuler.files import read_toml
from schuler.filtering.measurements import HEIGHT, MeasurementSchedule, merged
from schuler.navigation.config import NavigationConfig
from schuler.navigation.sections import Config, NonNegative, Positive, Section
from schuler.navigation.states import imu_spec
from schuler.rotary.search.evolution import SearchSettings
from schuler.rotary.search.families import SchemeSpace
from schuler.rotary.search.objective import SchemeObjective, scheme_objective
from schuler.rotary.sections import LimitsSection, RotarySection
from schuler.sensors import catalogue
from schuler.sensors.spec import ImuSpec
from schuler.sensors.spec_file import configured_spec
from schuler.simulation.motion_sections import MotionSection

_AxisName = Literal["x", "y", "z"]
_MRAD = 1e-3
_RECORDS = 1200  # of a mission, at most


class ImuSection(Section):
    """The IMU, and what a calibration has left of its errors."""

    name: str = Field(description="in the catalogue, or the file of an identified budget; or any, with what follows")
    gyro: dict[str, float | str] = Field(default_factory=dict, description="data-sheet values, see docs/sensors.md")
    accel: dict[str, float | str] = Field(default_factory=dict, description="data-sheet values, see docs/sensors.md")
    rate_hz: Positive = 100.0
    gyro_bias_deg_h: NonNegative | None = Field(None, description="1-sigma, instead of the budget's turn-on bias")
    accel_bias_m_s2: NonNegative | None = Field(None, description="likewise")
    gyro_scale_ppm: NonNegative | None = Field(None, description="1-sigma, instead of the budget's")
    gyro_misalignment_mrad: NonNegative | None = Field(None, description="likewise")
    gyro_instability_deg_h: NonNegative | None = Field(None, description="instead of the budget's; 0 leaves it out")

    @model_validator(mode="after")
    def _both_triads(self) -> ImuSection:
        if bool(self.gyro) != bool(self.accel):
            raise ValueError("give both gyro = {...} and accel = {...}, or none of them")
        return self

    def source(self) -> dict[str, Any]:
        """The same in the words of a navigation's configuration."""
        if self.gyro:
            return {"gyro": self.gyro, "accel": self.accel}
        return {"spec" if self.name.endswith(".toml") else "catalogue": self.name}

    def spec(self) -> ImuSpec:
        """Error budget.

        Raises
        ------
        InputError, ConfigError
            For a name or an entry that is not known.
        """
        if self.gyro:
            config = NavigationConfig.parse({"imu": self.source()})
            spec = replace(imu_spec(config), name=self.name)
        else:
            spec = configured_spec(self.name) if self.name.endswith(".toml") else catalogue.spec(self.name)
        given = {
            "turn_on_bias": (self.gyro_bias_deg_h, units.DEG_PER_HR),
            "scale_factor": (self.gyro_scale_ppm, units.PPM),
            "misalignment": (self.gyro_misalignment_mrad, _MRAD),
            "bias_instability": (self.gyro_instability_deg_h, units.DEG_PER_HR),
        }
        gyro = replace(spec.gyro, **{k: v * unit for k, (v, unit) in given.items() if v is not None})
        accel = spec.accel
        if self.accel_bias_m_s2 is not None:
            accel = replace(accel, turn_on_bias=self.accel_bias_m_s2)
        return replace(spec, gyro=gyro, accel=accel)


class HeightSection(Section):
    """Heights that aid: a barometer, or the sea; without any the vertical channel runs away within the hour."""

    sigma_m: Positive = 1.0
    rate_hz: Positive = 0.1


class ObjectiveSection(Section):
    """What is to be small."""

    quantity: Literal["horizontal", "vertical", "position", "velocity", "heading", "tilt", "observability"] = Field(
        "horizontal", description="1-sigma of an error; observability: geometric mean of final over initial 1-sigma"
    )
    statistic: Literal["rms", "end", "largest"] = Field("rms", description="of the 1-sigma over the mission")
    when: Literal["all", "outages"] | None = Field(None, description="outages, if there are any, if left out")


class SearchSection(Section):
    """How schemes are searched."""

    axes: tuple[_AxisName, ...] = Field(("x", "y", "z"), description="about which the platform can turn")
    positions: tuple[Annotated[int, Field(ge=2)], ...] = Field(
        (2, 3, 4, 6, 8, 16), description="numbers of even positions that it can dwell at"
    )
    tilt_deg: Annotated[float, Field(ge=0.0, le=90.0)] = Field(
        0.0, description="largest angle by which a single axis may lean from each of them"
    )
    families: tuple[str, ...] = Field((), description="continuous, reciprocating, carousel, dwell, ...; all if empty")
    evaluations: Annotated[int, Field(ge=50)] = 1500
    seed: Annotated[int, Field(ge=0)] = 0


class RotaryScenario(Config):
    """A mission of a rotating IMU.

    Attributes
    ----------
    name : str
    seed : int
        Seed of the simulated runs.
    runs : int
        Number of simulated runs.
    imu : ImuSection
    motion : MotionSection
        Motion of the vehicle.
    rotary : RotarySection
        Schedule, encoder, limits of the platform, offset of the IMU.
    gnss, zero_velocity, height
        Aids; without any the IMU navigates alone.
    start : BudgetStart
    states : int
        States of the filter.
    node_rate_hz : float
        Rate of the covariance.
    objective : ObjectiveSection
    search : SearchSection
    rates_deg_s : tuple of float
        At which the schedule is looked at too.
    """

    name: str = "rotary"
    seed: Annotated[int, Field(ge=0)] = 0
    runs: Annotated[int, Field(ge=1)] = 4
    imu: ImuSection
    motion: MotionSection
    rotary: RotarySection
    gnss: BudgetGnss | None = None
    zero_velocity: BudgetRest | None = None
    height: HeightSection | None = None
    start: BudgetStart = BudgetStart()
    states: Literal[15, 21, 33] = 15
    node_rate_hz: Positive = Field(1.0, description="of the covariance; less for missions of hours")
    objective: ObjectiveSection = ObjectiveSection()
    search: SearchSection = SearchSection()
    rates_deg_s: tuple[Positive, ...] = (5.0, 10.0, 20.0, 30.0, 40.0, 50.0, 60.0, 80.0, 100.0)

    @model_validator(mode="after")
    def _possible(self) -> RotaryScenario:
        if self.gnss is not None and self.gnss.heading_sigma_deg is not None:
            raise ValueError("gnss.heading_sigma_deg: a heading is of the vehicle, not of an IMU that turns on it")
        if self.objective.when == "outages" and (self.gnss is None or not self.gnss.outages_s):
            raise ValueError('objective.when = "outages" needs gnss.outages_s')
        return self

    @classmethod
    def load(cls, path: Path | str) -> RotaryScenario:
        """Checked scenario of a TOML file, to whose folder a budget's file name is relative."""
        data = read_toml(path)
        imu = data.get("imu")
        if isinstance(imu, dict) and isinstance(imu.get("name"), str) and imu["name"].endswith(".toml"):
            data["imu"] = {**imu, "name": str(Path(path).resolve().parent / imu["name"])}
        return cls.parse(data, str(path))

    @property
    def outages(self) -> tuple[tuple[float, float], ...]:
        """[s]"""
        return () if self.gnss is None else self.gnss.outages_s

    @property
    def in_outages(self) -> bool:
        """Whether only outages count."""
        return bool(self.outages) if self.objective.when is None else self.objective.when == "outages"

    @property
    def limits(self) -> LimitsSection:
        """Limits of the platform; 100 deg/s and one axis where none are given."""
        return self.rotary.limits or LimitsSection()

    def mission(self) -> BudgetMission:
        """The vehicle with the IMU fixed to it, linearised."""
        motion = self.motion.build()
        usual = BudgetScenario(motion=self.motion, gnss=self.gnss, zero_velocity=self.zero_velocity)
        aids = [true_schedule(motion, usual)]
        if self.height is not None:
            step = 1.0 / self.height.rate_hz
            t = np.arange(step, motion.duration + 1e-9, step)
            aids.append(MeasurementSchedule.of(HEIGHT, t, motion.state(t).llh[:, 2], self.height.sigma_m**2))
        T = rotation_of_start(motion) * np.array(self.start.attitude_deg) * units.DEG
        sigma = np.concatenate((np.linalg.norm(T, axis=1), self.start.velocity_m_s, self.start.position_m))
        return linearised_mission(
            motion, merged(*aids), sigma, name=self.name, states=self.states, outages=self.outages,
            node_rate_hz=self.node_rate_hz, every_s=max(1.0, motion.duration / _RECORDS),
            earth_rotation=self.motion.earth_rotation,
        )  # fmt: skip

    @property
    def alone(self) -> bool:
        """Whether nothing aids."""
        return self.gnss is None and self.zero_velocity is None and self.height is None

    def scheme_objective(self) -> SchemeObjective:
        """What a search makes small."""
        return scheme_objective(
            self.mission(), self.motion.build(), self.imu.spec(), quantity=self.objective.quantity,
            statistic=self.objective.statistic, in_outages=self.in_outages,
            earth_rotation=self.motion.earth_rotation,
        )  # fmt: skip

    def space(self) -> SchemeSpace:
        """What a search may use."""
        s = self.search
        return SchemeSpace(
            self.limits.build(), self.motion.build().duration, s.axes, s.positions, s.tilt_deg * units.DEG
        )

    def settings(self, **changes: Any) -> SearchSettings:
        """How hard to search; entries given here replace those of the file.

        Raises
        ------
        ConfigError
            If the platform has three axes: schemes of three are not searched.
        """
        if self.limits.axes > 2:
            raise ConfigError("rotary.limits.axes: schemes of one and of two axes are searched, give 1 or 2")
        s = self.search
        given = {"families": s.families, "evaluations": s.evaluations, "seed": s.seed}
        return SearchSettings(axes=self.limits.axes, **{**given, **changes})


def load_rotary(scenario: RotaryScenario | dict[str, Any] | Path | str) -> RotaryScenario:
    """A scenario from an object, nested dictionaries, or the path of a TOML file."""
    if isinstance(scenario, RotaryScenario):
        return scenario
    return RotaryScenario.parse(scenario) if isinstance(scenario, dict) else RotaryScenario.load(scenario)
