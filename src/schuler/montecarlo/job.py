"""What a navigation campaign repeats: a simulated mission, a filter, a start, and the times that are looked at."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal, NamedTuple

import numpy as np
from pydantic import Field

from schuler.arrays import FloatArray
from schuler.exceptions import ConfigError, InputError
from schuler.files import read_toml, sha256
from schuler.filtering.initial_state import InitialState
from schuler.filtering.states import StateLayout
from schuler.mechanization.strapdown import NavState
from schuler.navigation.config import NavigationConfig
from schuler.navigation.run import navigate
from schuler.navigation.sections import Config, NonNegative, Positive, Section, Triple
from schuler.navigation.states import imu_spec, state_layout
from schuler.recording.trajectory import FullTrajectory
from schuler.sensors.spec import ImuSpec
from schuler.sensors.spec_file import anchored
from schuler.simulation.scenario import Mission, Scenario, prepare_mission, simulate_mission
from schuler.units import DEG

if TYPE_CHECKING:
    from schuler.montecarlo.lanes.run import LaneScenario

Engine = Literal["auto", "filter", "lanes"]


class StartSection(Section):
    """1-sigma of the errors each run starts with, north, east, down; drawn, and told to the filter."""

    attitude_deg: Triple = (0.1, 0.1, 1.0)
    velocity_m_s: Triple = (0.1, 0.1, 0.1)
    position_m: Triple = (2.0, 2.0, 3.0)


class EvaluationSection(Section):
    """When the runs are looked at."""

    every_s: Positive | None = Field(None, description="spacing; the shortest of 1, 2, 5, 10, ... s with 240 at most")
    settle_s: NonNegative = Field(30.0, description="without a drawn start: first look so long after the alignment")


class CampaignFile(Config):
    """A navigation campaign in one TOML file.

    Attributes
    ----------
    simulation : str or dict
        A scenario as for ``schuler simulate``: its file, relative to this one, or its sections.
    navigation : str or dict, optional
        A configuration as for ``schuler navigate``. Left out, the filter is told the truth about the IMU's
        specification and the lever arm, and has 15 states.
    start : StartSection, optional
        Left out, every run aligns itself.
    evaluation : EvaluationSection
    engine : {"auto", "filter", "lanes"}
        What filters the runs; auto takes lanes where they do all that the mission has, lanes leaves out the rounding of
        the IMU's readings.
    runs, seed : int
        Unless the command says otherwise.
    """

    simulation: str | dict[str, Any]
    navigation: str | dict[str, Any] | None = None
    start: StartSection | None = None
    evaluation: EvaluationSection = EvaluationSection()
    engine: Engine = "auto"
    runs: Annotated[int, Field(ge=1)] = 100
    seed: Annotated[int, Field(ge=0)] = 0


class Plan(NamedTuple):
    """What all runs of a job share, made once a process.

    Attributes
    ----------
    mission : Mission
    config : NavigationConfig
        Without smoothing, records where they are needed.
    spec : ImuSpec
        Specification that the filter believes.
    layout : StateLayout
        Without the states that satellites in view ask for (clocks, ambiguities).
    initial : InitialState, optional
        True state at the start with the covariance that errors are drawn from.
    t : ndarray, shape (k,)
        Times looked at. [s]
    truth : FullTrajectory
        At those times.
    """

    mission: Mission
    config: NavigationConfig
    spec: ImuSpec
    layout: StateLayout
    initial: InitialState | None
    t: FloatArray
    truth: FullTrajectory


@dataclass(frozen=True)
class NavigationJob:
    """The scenario of a navigation campaign, for :func:`~schuler.montecarlo.navigation.navigation_run`.

    Attributes
    ----------
    simulation : Scenario
    navigation : NavigationConfig
    start : StartSection, optional
    evaluation : EvaluationSection
    unrounded : bool
        Lanes may leave out the rounding of the IMU's readings, which they do not have.
    """

    simulation: Scenario
    navigation: NavigationConfig
    start: StartSection | None = None
    evaluation: EvaluationSection = field(default_factory=EvaluationSection)
    unrounded: bool = False

    @property
    def name(self) -> str:
        """Name of the mission."""
        return self.simulation.name

    @cached_property
    def plan(self) -> Plan:
        """What all runs share.

        Raises
        ------
        InputError
            If the mission cannot be navigated as configured, or is too short.
        """
        return _plan(self)

    @cached_property
    def lanes(self) -> LaneScenario | str:
        """The same for runs in lock-step; a sentence if they cannot do it."""
        from schuler.montecarlo.lane_job import lane_scenario

        return lane_scenario(self)

    def __reduce__(self) -> tuple[Any, ...]:
        # without what is prepared: every process makes its own
        return NavigationJob, (self.simulation, self.navigation, self.start, self.evaluation, self.unrounded)

    def fingerprint(self) -> dict[str, Any]:
        """For :func:`~schuler.montecarlo.fingerprint.plain`: files that are named count by their contents."""
        data: dict[str, Any] = {
            "simulation": self.simulation.model_dump(mode="json", exclude_defaults=True),
            "navigation": self.navigation.model_dump(mode="json", exclude_defaults=True),
            "start": None if self.start is None else self.start.model_dump(mode="json"),
            "evaluation": self.evaluation.model_dump(mode="json"),
            "unrounded": self.unrounded,
        }
        for section in (data["simulation"], data["navigation"]):
            imu = section.get("imu", {})
            for key in ("spec", "calibration"):
                if isinstance(imu.get(key), str):
                    imu[key] = {"file": sha256(imu[key])}
        return data


def read_job(
    path: Path | str, navigation: Path | str | None = None, engine: Engine | None = None
) -> tuple[NavigationJob, CampaignFile]:  # fmt: skip
    """Job of a campaign's file, or of a plain scenario as ``schuler simulate`` takes it.

    Parameters
    ----------
    path : Path or str
    navigation : Path or str, optional
        Configuration of the filter, instead of the file's.
    engine : {"auto", "filter", "lanes"}, optional
        Instead of the file's.

    Returns
    -------
    job : NavigationJob
    file : CampaignFile
        With the other entries; their defaults for a plain scenario.

    Raises
    ------
    ConfigError
        Listing every wrong entry.
    """
    path = Path(path)
    data = read_toml(path)
    if "motion" in data:
        simulation = Scenario.load(path)
        file = CampaignFile(simulation={}, seed=simulation.seed)
    else:
        file = CampaignFile.parse(data, str(path))
        simulation = _scenario(file.simulation, path)
    given: Any = file.navigation
    if navigation is not None:
        config = NavigationConfig.load(navigation)
    elif isinstance(given, str):
        config = NavigationConfig.load(path.parent / given)
    elif given is None:
        config = _budgeted_filter(simulation)
    else:
        config = NavigationConfig.parse(anchored(given, path), f"{path}: navigation")
    if engine is not None:
        file = file.model_copy(update={"engine": engine})
    return NavigationJob(simulation, config, file.start, file.evaluation, file.engine == "lanes"), file


def _scenario(given: str | Mapping[str, Any], path: Path) -> Scenario:
    if isinstance(given, str):
        return Scenario.load(path.parent / given)
    return Scenario.parse(anchored(dict(given), path), f"{path}: simulation")


def _budgeted_filter(simulation: Scenario) -> NavigationConfig:
    """A filter that knows the budget and the mounting of what is simulated, and no realisation of it."""
    imu = simulation.imu
    if imu.ideal:
        raise ConfigError("the simulated IMU is ideal: say what the filter is to believe of it (navigation, --config)")
    data: dict[str, Any] = {
        "imu": {
            **({"catalogue": imu.catalogue} if imu.catalogue is not None else {}),
            **({"spec": imu.spec} if imu.spec is not None else {}),
            **({"gyro": imu.gyro, "accel": imu.accel} if imu.gyro else {}),
            "mount_rpy_deg": imu.mount_rpy_deg,
        },
        "filter": {"earth_rotation": simulation.motion.earth_rotation},
    }
    if simulation.gnss is not None:
        data["gnss"] = {"lever_arm_m": simulation.gnss.lever_arm_m}
    elif simulation.satellites is not None:
        data["gnss"] = {"coupling": "tight", "lever_arm_m": simulation.satellites.lever_arm_m}
    return NavigationConfig.parse(data)


_STEPS = (1.0, 2.0, 5.0, 10.0, 20.0, 30.0, 60.0, 120.0, 300.0, 600.0, 1800.0, 3600.0)
_LOOKS = 240  # at most, if nothing else is said


def _plan(job: NavigationJob) -> Plan:
    mission = prepare_mission(job.simulation)
    truth = mission.ideal.truth
    spec = imu_spec(job.navigation)
    begin, end = float(mission.ideal.t[0]), float(mission.ideal.t[-1])
    every = job.evaluation.every_s
    if every is None:
        every = next((s for s in _STEPS if (end - begin) / s <= _LOOKS), _STEPS[-1])
    initial, layout = None, state_layout(job.navigation, spec)
    if job.start is not None:
        initial = _true_start(job.start, truth, begin, layout)
        first, record = begin, every
    else:
        # runs are aligned at one fix or another: looks are at whole steps after the first one's alignment
        record = _fix_period(job.simulation)
        every = max(round(every / record), 1) * record
        pilot = simulate_mission(mission, np.random.default_rng(0))
        aligned = navigate(pilot.recording, _changed(job.navigation, record).untuned()).t[0]
        first = float(aligned) + np.ceil(job.evaluation.settle_s / record - 1e-9) * record - every
    t = first + every * np.arange(1.0, np.floor((end - first) / every + 1e-6) + 1.0)
    if not len(t):
        raise InputError(
            f"the mission of {end - begin:.0f} s ends before the first look at {first + every - begin:.0f} s; take a "
            "shorter evaluation.every_s or settle_s"
        )
    return Plan(mission, _changed(job.navigation, record), spec, layout, initial, t, truth.at(np.minimum(t, end)))


def _true_start(start: StartSection, truth: FullTrajectory, t: float, layout: StateLayout) -> InitialState:
    nav = NavState(t, truth.r_eb_e[0], truth.v_eb_e[0], truth.q_eb[0])
    return InitialState.from_sigmas(
        nav, layout, attitude=np.array(start.attitude_deg) * DEG, velocity=start.velocity_m_s, position=start.position_m
    )


def _fix_period(simulation: Scenario) -> float:
    for section in (simulation.gnss, simulation.satellites):
        if section is not None:
            return 1.0 / section.rate_hz
    raise InputError(
        "without GNSS no run can align itself: give the errors each run starts with, a section [start] of the campaign"
    )


def _changed(config: NavigationConfig, record_s: float) -> NavigationConfig:
    """The configuration without what a campaign throws away."""
    lean = {"smooth": False, "record_s": record_s, "output_rate_hz": 1.0}
    return config.model_copy(update={"filter": config.filter.model_copy(update=lean)})
