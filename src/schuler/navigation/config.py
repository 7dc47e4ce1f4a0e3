"""Configuration of a navigation run: one TOML file, checked before anything is read or computed.

Every key that carries a number names its unit. Unknown keys are errors, with the nearest known one.
"""

from __future__ import annotations

from collections.abc import Sequence
from copy import deepcopy
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import Field, field_validator, model_validator

from schuler.files import read_toml
from schuler.navigation.sections import (
    AidingSection,
    Config,
    CorrelatedSection,
    NonNegative,
    Positive,
    PositiveTriple,
    Section,
    TightSection,
    Triple,
    change_entry,
)
from schuler.sensors import catalogue
from schuler.sensors.spec_file import anchored


class ImuSection(Section):
    """The IMU: error budget, mounting, clock."""

    catalogue: str | None = Field(None, description="name in the IMU catalogue")
    spec: str | None = Field(None, description="file of an identified budget, relative to this one")
    gyro: dict[str, float | str] = Field(default_factory=dict, description="data-sheet values, see docs/sensors.md")
    accel: dict[str, float | str] = Field(default_factory=dict, description="data-sheet values, see docs/sensors.md")
    calibration: str | None = Field(
        None, description="file of a calibration of this unit, relative to this one: start of the sensor states"
    )
    calibration_session: Literal["earlier", "same"] = Field(
        "earlier", description="same: the unit stayed on since its calibration; earlier: it was switched on again"
    )
    gyro_repeatability_deg_hr: NonNegative | None = Field(
        None,
        description="1-sigma change of biases from one switch-on to the next; if left out, the turn-on bias",
    )
    accel_repeatability_mg: NonNegative | None = Field(None, description="the same of the accelerometers")
    mount_rpy_deg: Triple = Field((0.0, 0.0, 0.0), description="attitude of the IMU axes in the vehicle: C_bs")
    clock_shift_s: float = Field(0.0, description="added to the IMU's time stamps")
    clock_shift_sigma_s: NonNegative = Field(
        0.0, description="1-sigma of it; what is left is estimated beside a lever arm that nobody stated"
    )
    rate_order: Literal[1, 2, 3] = Field(2, description="rule that integrates rates: held, trapezoid, parabola")
    max_gap_s: Positive = Field(2.0, description="longest pause of the log that is bridged; longer ones part it")

    @model_validator(mode="after")
    def _one_source(self) -> ImuSection:
        sheet = bool(self.gyro or self.accel)
        if (self.catalogue is not None) + (self.spec is not None) + sheet != 1:
            raise ValueError(
                'give either catalogue = "name", spec = "file.toml", or both gyro = {...} and accel = {...}'
            )
        if sheet and not (self.gyro and self.accel):
            raise ValueError("give both gyro = {...} and accel = {...}")
        return self


class GnssSection(Section):
    """Use of GNSS: as solutions (loose, reset) or satellite by satellite (tight)."""

    coupling: Literal["loose", "tight", "reset", "off"] = Field(
        "loose", description="reset: position and velocity are put where GNSS is; off: only for alignment and rest"
    )
    tight: TightSection = TightSection()
    correlated: CorrelatedSection = CorrelatedSection()
    reset_every_s: NonNegative = Field(0.0, description="coupling reset: least time between two; 0 takes every fix")
    every_s: NonNegative = Field(0.0, description="least time between two fixes used; 0 takes every fix")
    lever_sigma_m: NonNegative = Field(0.0, description="1-sigma of the lever arm; 0 does not estimate it")
    delay_sigma_s: NonNegative = Field(
        0.0, description="1-sigma of a time offset of GNSS stamps, estimated; 0 takes them as right"
    )
    lever_arm_m: Triple = Field((0.0, 0.0, 0.0), description="from the IMU to the antenna, forward right down")
    velocity: bool = Field(True, description="use velocities where there are any")
    velocity_delay_s: float = Field(0.0, description="how long before their stamps velocities were valid")
    position_sigma_floor_m: Triple = Field((0.0, 0.0, 0.0), description="smallest 1-sigma N E D that is believed")
    velocity_sigma_floor_m_s: Triple = Field((0.0, 0.0, 0.0), description="smallest 1-sigma N E D that is believed")
    sigma_scale: Positive = Field(1.0, description="factor on the receiver's own 1-sigma values")
    position_sigma_scale: PositiveTriple = Field((1.0, 1.0, 1.0), description="the same N E D of positions, besides")
    velocity_sigma_scale: PositiveTriple = Field((1.0, 1.0, 1.0), description="the same of velocities")
    gate: Annotated[float, Field(gt=0.0, lt=1.0)] | Literal["off"] = Field(
        0.9999, description="probability with which a good fix passes, or off"
    )
    quality: tuple[int, ...] | None = Field(None, description="RTKLIB quality numbers to use; all if left out")

    @model_validator(mode="after")
    def _delay_needs_solutions(self) -> GnssSection:
        if self.delay_sigma_s > 0.0 and self.coupling != "loose":
            raise ValueError(
                f'delay_sigma_s goes with coupling = "loose": with "{self.coupling}" nothing would show the time offset'
            )
        return self


class AlignmentSection(Section):
    """Source of the initial attitude."""

    method: Literal["auto", "course", "gyrocompass", "given"] = Field(
        "auto",
        description="auto: level at rest and take the heading from the course (or in motion); given: rpy_deg",
    )
    rpy_deg: Triple | None = Field(None, description="roll, pitch, yaw for method given")
    sigma_deg: Triple = Field((1.0, 1.0, 3.0), description="1-sigma about N, E, D for method given")
    rest_s: NonNegative = Field(
        300.0, description="longest time at rest, the latest, used for levelling and gyro biases; 0 uses none"
    )
    min_speed_m_s: Positive | None = Field(
        None,
        description="speed from which the course is taken as heading; if left out, 1 m/s, and less where that comes "
        "more than 20 s after the first motion",
    )
    sideslip_deg: NonNegative = Field(1.0, description="1-sigma angle between course and heading")
    tilt_floor_deg: NonNegative = Field(0.2, description="smallest 1-sigma tilt, for vibration and bumps")

    @model_validator(mode="after")
    def _given_needs_angles(self) -> AlignmentSection:
        if (self.method == "given") != (self.rpy_deg is not None):
            raise ValueError('rpy_deg goes with method = "given" and only with it')
        return self


class ModelSection(Section):
    """Stochastic model of one state block in SI units, instead of the one that follows from the IMU."""

    sigma: NonNegative
    noise: NonNegative = 0.0
    tau_s: Positive | None = None


class NoiseSection(Section):
    """Factors on the white noise that the IMU's budget gives, for the filter: an IMU in motion shakes."""

    gyro: Positive = Field(1.0, description="factor on the gyroscopes' root density")
    accel: Positive | PositiveTriple = Field(
        1.0, description="factor on the accelerometers' root density; three numbers: forward, right, down"
    )

    @property
    def accel_axes(self) -> Triple:
        """Factors of the accelerometers forward, right, down."""
        return self.accel if isinstance(self.accel, tuple) else (self.accel,) * 3


class FilterSection(Section):
    """States and rates of the filter."""

    states: Literal[9, 15, 21, 27, 33, 39, 42] | tuple[str, ...] = Field(15, description="number, or names of blocks")
    models: dict[str, ModelSection] = Field(default_factory=dict, description="models of blocks, SI units")
    noise: NoiseSection = NoiseSection()
    tune: bool | Literal["auto"] = Field(
        "auto",
        description="tune noise from the log's own fixes: true, false, auto where innovations contradict what is not "
        "stated by hand, or the IMU is named by its grade",
    )
    covariance_rate_hz: Positive | None = Field(10.0, description="left out: default; see docs")
    full_rate: bool = Field(False, description="propagate the covariance at every IMU sample")
    record_s: Positive = Field(1.0, description="spacing of covariance records")
    output_rate_hz: Positive | None = Field(None, description="rate of the output; every sample if left out")
    lockout: Annotated[int, Field(ge=0)] = Field(
        10, description="rejections of ranges, less acceptances, after which one is accepted; 0: nothing is, ever"
    )
    hold_s: Positive = Field(100.0, description="longest time for which fixes that jump and stay are held off")
    adaptive: bool = Field(True, description="noise grows where innovations show that it is larger than stated")
    smooth: bool = Field(True, description="also compute the smoothed solution")
    earth_rotation: bool = Field(True, description="false for a log simulated on an Earth that stands still")


class OutageSection(Section):
    """Windows in which GNSS is withheld, in seconds from the start of the recording."""

    windows_s: tuple[tuple[float, float], ...] = ()
    every_s: Positive | None = Field(None, description="period of repeated outages")
    length_s: Positive | None = Field(None, description="length of each")
    first_s: NonNegative | None = Field(None, description="start of the first one; default one period")

    @field_validator("windows_s")
    @classmethod
    def _ordered(cls, windows: tuple[tuple[float, float], ...]) -> tuple[tuple[float, float], ...]:
        for start, stop in windows:
            if not stop > start:
                raise ValueError(f"an outage stops after it starts, got {start}..{stop} s")
        return windows

    @model_validator(mode="after")
    def _period_and_length(self) -> OutageSection:
        if (self.every_s is None) != (self.length_s is None):
            raise ValueError("every_s and length_s go together")
        if self.every_s is not None and self.length_s is not None and self.length_s >= self.every_s:
            raise ValueError(f"length_s must be shorter than every_s, got {self.length_s} and {self.every_s}")
        return self

    def resolve(self, start: float, stop: float) -> tuple[tuple[float, float], ...]:
        """Windows on the recording's own time axis; repeated ones end before the recording does."""
        windows = [(start + a, start + b) for a, b in self.windows_s]
        if self.every_s is not None and self.length_s is not None:
            first = self.every_s if self.first_s is None else self.first_s
            while start + first + self.length_s <= stop:
                windows.append((start + first, start + first + self.length_s))
                first += self.every_s
        return tuple(sorted(windows))


class NavigationConfig(Config):
    """A navigation run.

    Attributes
    ----------
    recording : dict
        How the log is read: hints of a single one, or an entry of hints for each part of a folder, see
        docs/reading-data.md.
    imu, gnss, alignment, filter, aiding, outages
        Sections.
    """

    recording: dict[str, Any] = Field(default_factory=dict)
    imu: ImuSection
    gnss: GnssSection = GnssSection()
    alignment: AlignmentSection = AlignmentSection()
    filter: FilterSection = FilterSection()
    aiding: AidingSection = AidingSection()
    outages: OutageSection = OutageSection()

    @property
    def lever_is_stated(self) -> bool:
        """Whether the lever arm of the antenna, or its uncertainty, is stated."""
        return bool(self.gnss.model_fields_set & {"lever_arm_m", "lever_sigma_m"})

    @property
    def noise_is_stated(self) -> bool:
        """Whether noise is stated by hand: an IMU by its numbers, factors on noise, or models of the states."""
        return bool(
            self.imu.catalogue is None
            or self.filter.models
            or self.filter.noise != NoiseSection()
            or self.gnss.model_fields_set & {"sigma_scale", "position_sigma_scale", "velocity_sigma_scale"}
        )

    @property
    def is_named_by_grade(self) -> bool:
        """Whether the IMU is named by its grade: its noise is typical, and no unit's."""
        named = self.imu.catalogue
        return named is not None and catalogue.entry(named).kind == "grade"

    def untuned(self) -> NavigationConfig:
        """The configuration without tuning: noise as it stands here, for campaigns and comparisons."""
        return self.model_copy(update={"filter": self.filter.model_copy(update={"tune": False})})

    @classmethod
    def load(cls, path: Path | str, changes: Sequence[tuple[str, Any]] = (), by: str = "changes") -> NavigationConfig:
        """Checked configuration of a TOML file, whose folder the files it names are relative to.

        Parameters
        ----------
        path : Path or str
        changes : sequence of (str, value)
            Entries put over those of the file, such as ``("filter.states", 21)``; an empty dict keeps what is there
            and makes an empty section otherwise, None takes the entry out.
        by : str
            What faults of these entries are reported of.
        """
        data = read_toml(path)
        for key, value in changes:
            change_entry(data, key, value)
        return cls.parse(_anchored(data, Path(path)), str(path), [key for key, _ in changes], by)


def _anchored(data: dict[str, Any], path: Path) -> dict[str, Any]:
    """Entries whose file names are relative to the file they were read from."""
    folder, data = path.resolve().parent, deepcopy(anchored(data, path))
    for *sections, entry in (("imu", "calibration"), ("gnss", "tight", "base", "observations")):
        place: Any = data
        for name in sections:
            place = place.get(name) if isinstance(place, dict) else None
        if isinstance(place, dict) and isinstance(place.get(entry), str):
            place[entry] = str(folder / place[entry])
    return data
