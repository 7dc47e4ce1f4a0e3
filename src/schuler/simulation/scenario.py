"""Scenarios: a mission in one TOML file, and the recording it gives.

Keys carry their units. A run is reproducible from package version, scenario and seed.
"""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import Annotated, Any, Literal, NamedTuple

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator

from schuler import frames, units
from schuler.arrays import FloatArray
from schuler.exceptions import ConfigError
from schuler.faults import sentences
from schuler.recording.recording import Metadata, Recording
from schuler.sensors import catalogue
from schuler.sensors.errors import ApplyReport, ImuErrors
from schuler.sensors.spec import ImuSpec, TriadSpec
from schuler.sensors.spec_file import anchored, configured_spec
from schuler.simulation.aiding import GnssModel, simulate_gnss, simulate_odometer
from schuler.simulation.imu import IdealImu, ideal_imu, simulate_imu
from schuler.simulation.motion import Motion, StaticMotion
from schuler.simulation.profiles import Manoeuvre, ManoeuvreMotion, Waypoint, WaypointMotion, polynomial_motion
from schuler.simulation.splines import SplineMotion
from schuler.timebase import TimeBase, gps_seconds

Triple = tuple[float, float, float]
Positive = Annotated[float, Field(gt=0.0)]
NonNegative = Annotated[float, Field(ge=0.0)]


class _Section(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)


class WaypointSection(_Section):
    """One way-point: north and east of the origin in metres, or latitude and longitude in degrees."""

    north_m: float | None = None
    east_m: float | None = None
    lat_deg: float | None = None
    lon_deg: float | None = None
    height_m: float | None = Field(None, description="ellipsoidal; that of the origin if left out")
    speed_m_s: Positive
    stop_s: NonNegative = 0.0

    @model_validator(mode="after")
    def _one_place(self) -> WaypointSection:
        local, geodetic = (self.north_m, self.east_m), (self.lat_deg, self.lon_deg)
        if (None in local) == (None in geodetic) or (None in local and any(v is not None for v in local)):
            raise ValueError("give north_m and east_m, or lat_deg and lon_deg")
        return self


class ManoeuvreSection(_Section):
    """One command."""

    duration_s: Positive
    speed_m_s: NonNegative | None = None
    turn_deg: float = 0.0
    climb_m_s: float | None = None


class MotionSection(_Section):
    """How the body moves."""

    type: Literal["static", "waypoints", "manoeuvres", "spline", "polynomial"]
    lat_deg: Annotated[float, Field(ge=-90.0, le=90.0)] = Field(description="origin")
    lon_deg: float = Field(description="origin")
    height_m: float = Field(0.0, description="origin, ellipsoidal")
    rpy_deg: Triple = Field((0.0, 0.0, 0.0), description="attitude, static motion")
    duration_s: Positive | None = Field(None, description="static motion")
    waypoints: tuple[WaypointSection, ...] = ()
    acceleration_m_s2: Positive = 1.5
    bank: Annotated[float, Field(ge=0.0, le=1.0)] = Field(0.0, description="share of the coordinated bank angle")
    manoeuvres: tuple[ManoeuvreSection, ...] = ()
    heading_deg: float = Field(0.0, description="initial, manoeuvres")
    speed_m_s: NonNegative = Field(0.0, description="initial, manoeuvres")
    t_s: tuple[float, ...] = Field((), description="times of spline nodes")
    ned_m: tuple[Triple, ...] = Field((), description="spline nodes or polynomial knots, about the origin")
    nodes_rpy_deg: tuple[Triple, ...] = Field((), description="attitudes at spline nodes or polynomial knots")
    step_s: Positive | None = Field(None, description="spacing of polynomial position knots")
    angle_step_s: Positive | None = Field(None, description="spacing of polynomial angle knots")
    earth_rotation: bool = True

    def build(self) -> Motion:
        """The motion itself."""
        origin = np.array([self.lat_deg * units.DEG, self.lon_deg * units.DEG, self.height_m])
        if self.type == "static":
            if self.duration_s is None:
                raise ConfigError("motion: a static motion needs duration_s")
            return StaticMotion(origin, np.array(self.rpy_deg) * units.DEG, self.duration_s)
        if self.type == "waypoints":
            points = [Waypoint(llh=_place(p, origin), speed=p.speed_m_s, stop=p.stop_s) for p in self.waypoints]
            return WaypointMotion.through(points, acceleration=self.acceleration_m_s2, bank=self.bank)
        if self.type == "manoeuvres":
            commands = [
                Manoeuvre(duration=c.duration_s, speed=c.speed_m_s, turn=c.turn_deg * units.DEG, climb=c.climb_m_s)
                for c in self.manoeuvres
            ]
            return ManoeuvreMotion.of(
                commands, origin, heading=self.heading_deg * units.DEG, speed=self.speed_m_s, bank=self.bank
            )
        rpy = np.array(self.nodes_rpy_deg).reshape(-1, 3) * units.DEG
        ned = np.array(self.ned_m).reshape(-1, 3)
        if self.type == "spline":
            llh = frames.llh_from_ecef(frames.ecef_from_ned(ned, origin))
            return SplineMotion.through(np.array(self.t_s), llh, rpy)
        if self.step_s is None or self.angle_step_s is None:
            raise ConfigError("motion: a polynomial motion needs step_s and angle_step_s")
        return polynomial_motion(ned, self.step_s, rpy, self.angle_step_s, origin)


class ImuModelSection(_Section):
    """The simulated IMU."""

    rate_hz: Positive = 100.0
    kind: Literal["increment", "rate"] = "increment"
    catalogue: str | None = None
    spec: str | None = Field(None, description="file of an identified budget, relative to this one")
    gyro: dict[str, float | str] = Field(default_factory=dict)
    accel: dict[str, float | str] = Field(default_factory=dict)
    ideal: bool = Field(False, description="no errors at all")
    temperature_degC: float | None = None

    @model_validator(mode="after")
    def _one_source(self) -> ImuModelSection:
        given = [self.catalogue is not None, self.spec is not None, bool(self.gyro or self.accel), self.ideal]
        if sum(given) != 1 or bool(self.gyro) != bool(self.accel):
            raise ValueError(
                'give one of catalogue = "name", spec = "file.toml", both gyro = {...} and accel = {...}, '
                "or ideal = true"
            )
        return self

    def budget(self) -> ImuSpec | None:
        """Error budget, None for an ideal IMU."""
        if self.ideal:
            return None
        if self.catalogue is not None:
            return catalogue.spec(self.catalogue)
        if self.spec is not None:
            return configured_spec(self.spec)
        return ImuSpec(
            "as configured",
            TriadSpec.gyro(**self.gyro),  # type: ignore[arg-type]
            TriadSpec.accelerometer(**self.accel),  # type: ignore[arg-type]
        )


class GnssModelSection(_Section):
    """The simulated receiver."""

    rate_hz: Positive = 1.0
    sigma_position_m: Triple = (1.5, 1.5, 3.0)
    sigma_velocity_m_s: Triple = (0.05, 0.05, 0.1)
    drift_position_m: Triple = (0.0, 0.0, 0.0)
    drift_velocity_m_s: Triple = (0.0, 0.0, 0.0)
    drift_time_s: Positive = 60.0
    lever_arm_m: Triple = (0.0, 0.0, 0.0)
    first_s: NonNegative = 0.0
    outages_s: tuple[tuple[float, float], ...] = ()
    latency_s: NonNegative = 0.0
    clock_shift_s: float = 0.0

    def model(self) -> GnssModel:
        """Receiver model in SI."""
        return GnssModel(
            rate_hz=self.rate_hz, sigma_position=self.sigma_position_m, sigma_velocity=self.sigma_velocity_m_s,
            drift_position=self.drift_position_m, drift_velocity=self.drift_velocity_m_s, drift_time=self.drift_time_s,
            lever_arm_b=self.lever_arm_m, first_s=self.first_s, outages=self.outages_s, latency=self.latency_s,
            clock_shift=self.clock_shift_s,
        )  # fmt: skip


class OdometerModelSection(_Section):
    """The simulated odometer."""

    rate_hz: Positive = 10.0
    sigma_m_s: Positive = 0.05
    scale_error: float = 0.0
    lever_arm_m: Triple = (0.0, 0.0, 0.0)


class Scenario(_Section):
    """A simulated mission.

    Attributes
    ----------
    name : str
    seed : int
        Used where no generator is passed in.
    start_week, start_tow_s
        GPS time of second zero.
    motion, imu, gnss, odometer
        Sections; GNSS and odometer are optional.
    """

    name: str = "simulated"
    seed: Annotated[int, Field(ge=0)] = 0
    start_week: int = 2400
    start_tow_s: NonNegative = 0.0
    motion: MotionSection
    imu: ImuModelSection
    gnss: GnssModelSection | None = None
    odometer: OdometerModelSection | None = None

    @classmethod
    def parse(cls, data: dict[str, Any], source: str = "scenario") -> Scenario:
        """Checked scenario of nested dictionaries; all faults are reported at once, as :class:`ConfigError`."""
        try:
            return cls.model_validate(data)
        except ValidationError as error:
            raise ConfigError(f"{source}: " + "; ".join(sentences(error, cls))) from None

    @classmethod
    def load(cls, path: Path | str) -> Scenario:
        """Checked scenario of a TOML file, to whose folder ``imu.spec`` is relative; see :meth:`parse`."""
        path = Path(path)
        try:
            data = tomllib.loads(path.read_text(encoding="utf-8"))
        except FileNotFoundError:
            raise ConfigError(f"{path}: no such scenario file") from None
        except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
            raise ConfigError(f"{path}: not a TOML file: {error}") from None
        return cls.parse(anchored(data, path), str(path))


class Mission(NamedTuple):
    """A scenario with everything that does not depend on chance, for one run or for thousands.

    Attributes
    ----------
    scenario : Scenario
    motion : Motion
    ideal : IdealImu
    spec : ImuSpec or None
        Error budget of the IMU, None for an ideal one.
    """

    scenario: Scenario
    motion: Motion
    ideal: IdealImu
    spec: ImuSpec | None


class Simulation(NamedTuple):
    """A simulated recording with what a real one keeps to itself.

    Attributes
    ----------
    recording : Recording
        Its ``reference`` is the true trajectory of the IMU.
    errors : ImuErrors
        The realisation that was applied.
    report : ApplyReport
        True biases by sample, clipping.
    """

    recording: Recording
    errors: ImuErrors
    report: ApplyReport


def prepare_mission(scenario: Scenario | dict[str, Any] | Path | str) -> Mission:
    """Motion and ideal IMU output of a scenario (an object, nested dictionaries, or the path of a TOML file)."""
    if not isinstance(scenario, Scenario):
        scenario = Scenario.parse(scenario) if isinstance(scenario, dict) else Scenario.load(scenario)
    motion = scenario.motion.build()
    imu = scenario.imu
    ideal = ideal_imu(motion, imu.rate_hz, kind=imu.kind, earth_rotation=scenario.motion.earth_rotation)
    return Mission(scenario, motion, ideal, imu.budget())


def simulate_mission(mission: Mission, rng: np.random.Generator | None = None) -> Simulation:
    """One realisation of a mission.

    Parameters
    ----------
    mission : Mission
    rng : numpy.random.Generator, optional
        Default: from the scenario's seed. IMU errors, IMU noise, GNSS and odometer draw from children of their own, so
        changing one leaves the others as they were.

    Returns
    -------
    Simulation
    """
    scenario = mission.scenario
    rng = np.random.default_rng(scenario.seed) if rng is None else rng
    seed = _seed(rng)
    errors_rng, imu_rng, gnss_rng, odometer_rng = rng.spawn(4)
    errors = ImuErrors.none() if mission.spec is None else ImuErrors.draw(mission.spec, errors_rng)
    simulated = simulate_imu(mission.ideal, errors, imu_rng, temperature=scenario.imu.temperature_degC)
    notes = ["simulated; the reference is the true trajectory of the IMU"]
    if simulated.report.gyro_clipped.any() or simulated.report.accel_clipped.any():
        notes.append(simulated.report.summary())
    gnss = None if scenario.gnss is None else simulate_gnss(mission.motion, scenario.gnss.model(), gnss_rng)
    odometer = None
    if scenario.odometer is not None:
        o = scenario.odometer
        odometer = simulate_odometer(
            mission.motion, o.rate_hz, odometer_rng, sigma=o.sigma_m_s, scale_error=o.scale_error,
            lever_arm_b=o.lever_arm_m,
        )  # fmt: skip
    metadata = Metadata(
        name=scenario.name,
        time=TimeBase("gps", gps_seconds(scenario.start_week, scenario.start_tow_s)),
        axes="FRD",
        notes=tuple(notes),
        options={"scenario": scenario.model_dump(mode="json", exclude_defaults=True), "seed": seed},
    )
    recording = Recording(simulated.imu, gnss, odometer, mission.ideal.truth, metadata)
    return Simulation(recording, errors, simulated.report)


def simulate(scenario: Scenario | dict[str, Any] | Path | str, rng: np.random.Generator | None = None) -> Recording:
    """Recording of a simulated scenario.

    Parameters
    ----------
    scenario : Scenario, dict, or path of a TOML file
    rng : numpy.random.Generator, optional
        Default: from the scenario's seed.

    Returns
    -------
    Recording
        With the true trajectory of the IMU as its reference; :func:`simulate_mission` also returns the true errors.
    """
    return simulate_mission(prepare_mission(scenario), rng).recording


def _seed(rng: np.random.Generator) -> Any:
    """What a generator was seeded with, to be written down: a number, or one with the path of spawned children."""
    sequence = rng.bit_generator.seed_seq
    entropy, path = getattr(sequence, "entropy", None), getattr(sequence, "spawn_key", ())
    return {"entropy": entropy, "spawn_key": list(path)} if path else entropy


def _place(p: WaypointSection, origin: FloatArray) -> FloatArray:
    height = origin[2] if p.height_m is None else p.height_m
    if p.north_m is not None and p.east_m is not None:
        llh = frames.llh_from_ecef(frames.ecef_from_ned([p.north_m, p.east_m, 0.0], origin))
        return np.array([llh[0], llh[1], height])
    assert p.lat_deg is not None
    assert p.lon_deg is not None
    return np.array([p.lat_deg * units.DEG, p.lon_deg * units.DEG, height])
