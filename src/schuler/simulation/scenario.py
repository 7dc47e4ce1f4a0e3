"""Scenarios: a mission in one TOML file, and the recording it gives.

Keys carry their units. A run is reproducible from package version, scenario and seed.
"""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any, Literal, NamedTuple

import numpy as np
from pydantic import Field, ValidationError, model_validator

from schuler import units
from schuler.arguments import explains_arguments
from schuler.exceptions import ConfigError, sentences
from schuler.files import read_toml
from schuler.recording.recording import Metadata, Recording
from schuler.sensors import catalogue
from schuler.sensors.errors import ApplyReport, ImuErrors
from schuler.sensors.spec import ImuSpec, TriadSpec
from schuler.sensors.spec_file import anchored, configured_spec
from schuler.simulation.aid_sections import (
    GnssModelSection,
    HeadingModelSection,
    HeightModelSection,
    NonNegative,
    OdometerModelSection,
    Positive,
    SatellitesSection,
    Section,
    StreamSection,
    Triple,
)
from schuler.simulation.aid_truth import AidTruth
from schuler.simulation.gnss import draw_gnss
from schuler.simulation.imu import IdealImu, faulty_stream, ideal_imu, mounted, simulate_imu
from schuler.simulation.motion import Motion
from schuler.simulation.motion_sections import MotionSection
from schuler.simulation.satellites import PreparedSky, draw_satellites, prepare_sky
from schuler.simulation.scalar_aids import simulate_heading, simulate_height, simulate_odometer
from schuler.timebase import TimeBase, gps_seconds


class ImuModelSection(Section):
    """The simulated IMU."""

    rate_hz: Positive = 100.0
    kind: Literal["increment", "rate"] = "increment"
    catalogue: str | None = None
    spec: str | None = Field(None, description="file of an identified budget, relative to this one")
    gyro: dict[str, float | str] = Field(default_factory=dict)
    accel: dict[str, float | str] = Field(default_factory=dict)
    ideal: bool = Field(False, description="no errors at all")
    temperature_degC: float | None = None
    mount_rpy_deg: Triple = Field((0.0, 0.0, 0.0), description="attitude of the IMU's axes in the vehicle")
    reference_axes: Literal["vehicle", "imu"] = Field("vehicle", description="whose attitude the reference holds")
    stream: StreamSection = StreamSection()

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


class Scenario(Section):
    """A simulated mission.

    Attributes
    ----------
    name : str
    seed : int
        Used where no generator is passed in.
    start_week, start_tow_s
        GPS time of second zero.
    motion, imu, gnss, odometer, heading, barometer, satellites
        Sections; all but the first two are optional.
    """

    name: str = "simulated"
    seed: Annotated[int, Field(ge=0)] = 0
    start_week: int = 2400
    start_tow_s: NonNegative = 0.0
    motion: MotionSection
    imu: ImuModelSection
    gnss: GnssModelSection | None = None
    odometer: OdometerModelSection | None = None
    heading: HeadingModelSection | None = None
    barometer: HeightModelSection | None = None
    satellites: SatellitesSection | None = None

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
        data = read_toml(path, missing="no such scenario file")
        return cls.parse(anchored(data, path), str(path))


class Mission(NamedTuple):
    """A scenario with everything that does not depend on chance, for one run or for thousands.

    Attributes
    ----------
    scenario : Scenario
    motion : Motion
    ideal : IdealImu
        In the IMU's own axes; its ``truth`` is that of the reference.
    spec : ImuSpec or None
        Error budget of the IMU, None for an ideal one.
    sky : PreparedSky, optional
        Satellites and their true ranges.
    """

    scenario: Scenario
    motion: Motion
    ideal: IdealImu
    spec: ImuSpec | None
    sky: PreparedSky | None = None


class Simulation(NamedTuple):
    """A simulated recording with what a real one keeps to itself.

    Attributes
    ----------
    recording : Recording
        Its ``reference`` is the true trajectory of the IMU.
    errors : ImuErrors
        The realisation that was applied.
    report : ApplyReport
        True biases by sample (before samples were lost), clipping.
    aids : AidTruth
        True errors of everything else; their short form is ``recording.metadata.options["truth"]``.
    """

    recording: Recording
    errors: ImuErrors
    report: ApplyReport
    aids: AidTruth


def prepare_mission(scenario: Scenario | dict[str, Any] | Path | str) -> Mission:
    """Motion and ideal IMU output of a scenario (an object, nested dictionaries, or the path of a TOML file)."""
    if not isinstance(scenario, Scenario):
        scenario = Scenario.parse(scenario) if isinstance(scenario, dict) else Scenario.load(scenario)
    motion = scenario.motion.build()
    imu = scenario.imu
    ideal = ideal_imu(motion, imu.rate_hz, kind=imu.kind, earth_rotation=scenario.motion.earth_rotation)
    if any(imu.mount_rpy_deg):
        ideal = mounted(ideal, np.array(imu.mount_rpy_deg) * units.DEG, turn_truth=imu.reference_axes == "imu")
    sky = None
    if scenario.satellites is not None:
        sky = prepare_sky(motion, scenario.satellites.model(), epoch_gps_s=_time(scenario).epoch_gps_s)
    return Mission(scenario, motion, ideal, imu.budget(), sky)


def simulate_mission(mission: Mission, rng: np.random.Generator | None = None) -> Simulation:
    """One realisation of a mission.

    Parameters
    ----------
    mission : Mission
    rng : numpy.random.Generator, optional
        Default: from the scenario's seed. IMU errors, IMU noise and every aid draw from children of their own, so
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
    time = _time(scenario)
    parts, truth = _solutions(mission, gnss_rng, odometer_rng)
    imu, stream = simulated.imu, scenario.imu.stream
    # children of their own, spawned only where needed: what a generator gives next stays as it was without them
    if stream != StreamSection() or scenario.heading or scenario.barometer or scenario.satellites:
        *others, stream_rng = rng.spawn(4)
        more, true = _other_aids(mission, others)
        parts, truth = parts | more, truth | true
        if stream != StreamSection():
            faulty = faulty_stream(imu, stream.faults(), stream_rng)
            imu, truth["repeated"] = faulty.imu, faulty.repeated
            notes.append(
                f"the IMU's stream was disturbed: {int((~faulty.kept).sum())} samples lost, "
                f"{int(faulty.repeated.sum())} repeated, stamps jittered by {stream.jitter_s:g} s and shifted by "
                f"{stream.clock_shift_s:g} s"
            )
    aids = AidTruth(**truth)
    metadata = Metadata(
        name=scenario.name,
        time=time,
        axes="FRD",
        notes=tuple(notes),
        options={
            "scenario": scenario.model_dump(mode="json", exclude_defaults=True),
            "seed": seed,
            "truth": aids.parameters(errors),
        },
    )
    recording = Recording(imu=imu, **parts, reference=mission.ideal.truth, metadata=metadata)
    return Simulation(recording, errors, simulated.report, aids)


def _solutions(
    mission: Mission, gnss_rng: np.random.Generator, odometer_rng: np.random.Generator
) -> tuple[dict[str, Any], dict[str, Any]]:
    """GNSS solutions and odometer: parts of the recording, and the truth about them."""
    scenario = mission.scenario
    parts: dict[str, Any] = {}
    shift = scenario.imu.stream.clock_shift_s
    truth: dict[str, Any] = {"mount_rpy": np.array(scenario.imu.mount_rpy_deg) * units.DEG}
    if scenario.gnss is not None:
        fixes = draw_gnss(mission.motion, scenario.gnss.model(), gnss_rng)
        parts["gnss"] = fixes.gnss
        truth |= {
            "gnss_drift_position": fixes.drift_position,
            "gnss_drift_velocity": fixes.drift_velocity,
            "gnss_stale": fixes.stale,
            "gnss_delay": shift - scenario.gnss.clock_shift_s,
        }
    elif scenario.satellites is not None:
        truth["gnss_delay"] = shift - scenario.satellites.clock_shift_s
    if (o := scenario.odometer) is not None:
        # a generator of its own for the scale: giving it a spread leaves the noise as it was
        scale = o.scale_error + o.scale_sigma * float(odometer_rng.spawn(1)[0].standard_normal())
        parts["odometer"] = simulate_odometer(
            mission.motion, o.rate_hz, odometer_rng, sigma=o.sigma_m_s, scale_error=scale, lever_arm_b=o.lever_arm_m,
            outages=o.outages_s,
        )  # fmt: skip
        truth["odometer_scale"] = scale
    return parts, truth


def _time(scenario: Scenario) -> TimeBase:
    return TimeBase("gps", gps_seconds(scenario.start_week, scenario.start_tow_s))


def _other_aids(mission: Mission, rngs: list[np.random.Generator]) -> tuple[dict[str, Any], dict[str, Any]]:
    """Heading, height and satellites: parts of the recording, and the truth about them."""
    scenario, motion = mission.scenario, mission.motion
    heading_rng, height_rng, satellites_rng = rngs
    parts: dict[str, Any] = {}
    truth: dict[str, Any] = {}
    if scenario.heading is not None:
        parts["heading"], truth["heading_bias"] = simulate_heading(motion, scenario.heading.model(), heading_rng)
    if scenario.barometer is not None:
        parts["height"], truth["height_bias"] = simulate_height(motion, scenario.barometer.model(), height_rng)
    if scenario.satellites is not None:
        assert mission.sky is not None
        sky = draw_satellites(mission.sky, scenario.satellites.model(), satellites_rng)
        truth["satellites"] = sky
        if scenario.satellites.give == "ranges":
            parts["ranges"] = sky.ranges
        else:
            parts |= {"observations": sky.observations(), "ephemerides": sky.ephemerides}
    return parts, truth


@explains_arguments
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

    Examples
    --------
    >>> recording = schuler.simulate("examples/town.toml")
    >>> recording.imu
    <ImuSeries: ... samples at 100 Hz (increment), ...>
    """
    return simulate_mission(prepare_mission(scenario), rng).recording


def _seed(rng: np.random.Generator) -> Any:
    """Seed of a generator for the metadata: a number, or one with the path of spawned children."""
    sequence = rng.bit_generator.seed_seq
    entropy, path = getattr(sequence, "entropy", None), getattr(sequence, "spawn_key", ())
    return {"entropy": entropy, "spawn_key": list(path)} if path else entropy
