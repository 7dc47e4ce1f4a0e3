"""Base of configurations and their sections, and the sections for everything that aids besides GNSS solutions."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any, Literal, Self

from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator

# the class of pydantic models, whose call is theirs alone: it is public in no module
from pydantic._internal._model_construction import ModelMetaclass

from schuler.exceptions import ConfigError, sentences
from schuler.files import read_toml
from schuler.gnss.slow_errors import SlowRangeError

Triple = tuple[float, float, float]
Positive = Annotated[float, Field(gt=0.0)]
PositiveTriple = tuple[Positive, Positive, Positive]
NonNegative = Annotated[float, Field(ge=0.0)]


class Section(BaseModel):
    """Base of all sections: immutable, unknown entries refused."""

    model_config = ConfigDict(extra="forbid", frozen=True)


class _InSentences(ModelMetaclass):
    """Class of configurations: what a call does wrong is said as of a file, not as pydantic lists it."""

    def __call__(cls, *entries: Any, **more: Any) -> Any:  # noqa: N805 - of a class of classes
        if entries:
            name = cls.__name__
            raise ConfigError(
                f"{name}: expected sections by name, {name}(imu={{...}}), got {type(entries[0]).__name__}: take "
                f"{name}.load(path) for a file, {name}.parse(data) for nested dictionaries"
            )
        try:
            return super().__call__(**more)
        except ValidationError as error:
            faults = sentences(error, cls)  # type: ignore[arg-type]
            raise ConfigError(f"{cls.__name__}: " + "; ".join(faults)) from None


class Config(Section, metaclass=_InSentences):
    """Base of complete configurations."""

    @classmethod
    def parse(
        cls, data: dict[str, Any], source: str = "configuration", changed: Sequence[str] = (), by: str = "changes"
    ) -> Self:
        """Checked configuration of nested dictionaries; all faults are reported at once.

        Parameters
        ----------
        data : dict
        source : str
            What faults are reported of, such as a file.
        changed : sequence of str
            Entries that are not of the source, with dots.
        by : str
            What faults of those entries are reported of.

        Raises
        ------
        ConfigError
            Listing every wrong entry with its place.
        """
        try:
            return cls.model_validate(data)
        except ValidationError as error:
            faults = sentences(error, cls)
            own = [f for f in faults if any(f.startswith((f"{name}.", f"{name}:")) for name in changed)]
            of = ((by, own), (source, [f for f in faults if f not in own]))
            raise ConfigError("; ".join(f"{name}: {'; '.join(some)}" for name, some in of if some)) from None

    @classmethod
    def load(cls, path: Path | str) -> Self:
        """Checked configuration of a TOML file; see :meth:`parse`."""
        return cls.parse(read_toml(path), str(path))

    @classmethod
    def checked(cls, source: Self | dict[str, Any] | Path | str) -> Self:
        """Configuration from an object, nested dictionaries, or the path of a TOML file."""
        if isinstance(source, cls):
            return source
        return cls.parse(source) if isinstance(source, dict) else cls.load(source)  # type: ignore[arg-type]


def change_entry(data: dict[str, Any], name: str, value: Any) -> None:
    """Put one entry into nested sections, in place.

    Parameters
    ----------
    data : dict
    name : str
        With dots: ``filter.states``.
    value : Any
        An empty dict keeps what is there and makes an empty section otherwise, None takes the entry out.

    Raises
    ------
    ConfigError
        If a part of the name is no section.
    """
    *sections, last = name.split(".")
    for section in sections:
        data = data.setdefault(section, {})
        if not isinstance(data, dict):
            raise ConfigError(f"{name}: {section} is no section of the configuration")
    if value is None:
        data.pop(last, None)
    elif value == {} and isinstance(data.get(last), dict):
        pass
    else:
        data[last] = value


Gate = Annotated[float, Field(gt=0.0, lt=1.0)] | Literal["off"]


class RestSection(Section):
    """Detection of rest for zero-velocity and zero-rotation updates, gravity and Earth rate."""

    min_s: Positive = Field(1.0, description="shortest rest")
    window_s: Positive = Field(0.5, description="window of the detector")
    margin: Positive = Field(3.0, description="factor on the noise at rest that still counts as rest")
    max_speed_m_s: Positive = Field(0.5, description="GNSS speed above which nothing is at rest, plus its uncertainty")


class ZeroVelocitySection(Section):
    """Zero-velocity updates at rest."""

    sigma_m_s: Positive = Field(0.02, description="1-sigma of what may still move")
    rate_hz: Positive = Field(2.0, description="how often at rest")
    gate: Gate = Field(0.9999, description="probability with which a good update passes, or off")


class ZeroRateSection(Section):
    """Zero-rotation updates at rest."""

    sigma_deg_s: NonNegative = Field(0.02, description="1-sigma of what may still turn, added to the gyro noise")
    block_s: Positive = Field(1.0, description="length of the means")
    gate: Gate = Field(0.9999, description="probability with which a good update passes, or off")


class GravitySection(Section):
    """Mean specific force at rest against gravity; not together with zero-velocity updates, which do the same."""

    form: Literal["magnitude", "vector"] = Field("magnitude", description="vector: its direction too, by the attitude")
    sigma_m_s2: NonNegative = Field(0.005, description="1-sigma of what may still accelerate, added to the noise")
    block_s: Positive = Field(1.0, description="length of the means")
    gate: Gate = Field(0.9999, description="probability with which a good update passes, or off")


class EarthRateSection(Section):
    """Mean rate at rest along the vertical; not together with zero-rotation updates, which have it in them."""

    sigma_deg_s: NonNegative = Field(0.005, description="1-sigma of what may still turn, added to the gyro noise")
    block_s: Positive = Field(1.0, description="length of the means")
    gate: Gate = Field(0.9999, description="probability with which a good update passes, or off")


class NonHolonomicSection(Section):
    """A wheeled vehicle does not slip sideways and stays on the ground."""

    lateral_sigma_m_s: Positive = Field(0.1, description="1-sigma of the velocity across")
    vertical_sigma_m_s: Positive = Field(0.1, description="1-sigma of the velocity up")
    rate_hz: Positive = Field(5.0, description="how often")
    lever_m: Triple = Field((0.0, 0.0, 0.0), description="from the IMU to the middle of the rear axle")
    lever_sigma_m: NonNegative = Field(0.0, description="1-sigma of the lever arm; 0 does not estimate it")
    mount_sigma_deg: NonNegative = Field(2.0, description="1-sigma of the mount angles; 0 does not estimate them")
    min_speed_m_s: NonNegative = Field(0.5, description="slower than this does not count")
    max_turn_rate_deg_s: Positive = Field(20.0, description="lateral: sharper turns do not count")
    max_lateral_m_s2: Positive = Field(4.0, description="lateral: harder turns do not count")
    max_forward_m_s2: Positive = Field(3.0, description="vertical: harder braking does not count")
    unaided_factor: Positive = Field(
        1.0, description="factor on both sigmas later than 15 s after the last fix: slip and mount errors last"
    )
    gate: Gate = Field(0.9999, description="probability with which a good update passes, or off")


class OdometerSection(Section):
    """Wheel speed, from the odometer series of the recording."""

    lever_m: Triple = Field((0.0, 0.0, 0.0), description="from the IMU to the wheel or its axle")
    sigma_m_s: Positive | None = Field(None, description="1-sigma; that of the series if left out")
    scale_sigma: NonNegative = Field(0.02, description="1-sigma of the scale factor; 0 does not estimate it")
    rate_hz: Positive = Field(10.0, description="largest rate used")
    mount_sigma_deg: NonNegative = Field(0.0, description="1-sigma of mount angles; 0 does not estimate them")
    gate: Gate = Field(0.9999, description="probability with which a good update passes, or off")


class HeadingSection(Section):
    """Heading of a magnetometer or two antennas, from the heading series of the recording."""

    declination_deg: float = Field(0.0, description="added to a magnetic heading, positive east")
    from_gnss: bool = Field(False, description="two antennas: stops in outages")
    sigma_deg: Positive | None = Field(None, description="1-sigma; that of the series if left out")
    bias_sigma_deg: NonNegative = Field(0.0, description="1-sigma of a constant bias; 0 does not estimate it")
    gate: Gate = Field(0.9999, description="probability with which a good update passes, or off")


class BarometerSection(Section):
    """Pressure height, from the height series of the recording."""

    sigma_m: Positive | None = Field(None, description="1-sigma; that of the series if left out")
    bias_sigma_m: NonNegative = Field(50.0, description="1-sigma of the bias at first; 0 does not estimate it")
    bias_noise_m: NonNegative = Field(0.05, description="wander of the bias, m per square root of a second")
    lever_m: Triple = Field((0.0, 0.0, 0.0), description="from the IMU to the barometer")
    gate: Gate = Field(0.9999, description="probability with which a good update passes, or off")


class FixesSection(Section):
    """Places that are known: seconds from the start of the recording, degrees, metres."""

    t_s: tuple[float, ...]
    llh_deg: tuple[Triple, ...] = Field(description="latitude, longitude [deg], ellipsoidal height [m]")
    sigma_m: Triple = (0.5, 0.5, 0.5)
    lever_m: Triple = Field((0.0, 0.0, 0.0), description="from the IMU to the point that was there")


class AidingSection(Section):
    """Aids besides GNSS; a section that is left out is not used."""

    rest: RestSection = RestSection()
    zero_velocity: ZeroVelocitySection | None = None
    zero_rate: ZeroRateSection | None = None
    gravity: GravitySection | None = None
    earth_rate: EarthRateSection | None = None
    non_holonomic: NonHolonomicSection | None = None
    odometer: OdometerSection | None = None
    heading: HeadingSection | None = None
    barometer: BarometerSection | None = None
    fixes: FixesSection | None = None

    @model_validator(mode="after")
    def _readings_once(self) -> AidingSection:
        if self.gravity is not None and self.zero_velocity is not None:
            raise ValueError(
                "gravity and zero_velocity compare the same accelerometer readings with gravity; give one of them. "
                "Zero velocity has it all in it, gravity is for those who do without"
            )
        if self.earth_rate is not None and self.zero_rate is not None:
            raise ValueError(
                "earth_rate and zero_rate use the same gyro readings; give one of them. zero_rate has three axes and "
                "needs an attitude, earth_rate the vertical one only"
            )
        return self


class BaseSection(Section):
    """Base station that carrier phases are differenced against."""

    observations: str | None = Field(None, description="log of the base with carriers, relative to this file")
    llh_deg: Triple | None = Field(
        None,
        description="its antenna: latitude, longitude [deg], ellipsoidal height [m]; its single points if left out",
    )
    mark: bool = Field(False, description="llh_deg is the station's mark: its log states how high the antenna is")
    antenna: str | None = Field(None, description="as gnss.tight.antenna, of the base")
    code_sigma_m: Positive | None = Field(
        None,
        description="1-sigma of a strong satellite's code overhead, of one receiver; code less carrier if left out",
    )
    ratio: Annotated[float, Field(ge=1)] = Field(
        3.0, description="least quotient of the second-best integers' norm and the best's"
    )


class TightSection(Section):
    """Raw satellite measurements: which are used, how they are corrected, the receiver's clock."""

    systems: str = Field("GEC", description="letters of the systems used: GPS, Galileo, BeiDou, Q(J)ZSS, GLONASS (R)")
    ionosphere: Literal["klobuchar", "beidou", "galileo", "nequick-g", "maps", "none", "free"] = Field(
        "klobuchar",
        description="klobuchar: GPS's; beidou, galileo, nequick-g: theirs; maps: an IONEX file; free: two bands",
    )
    troposphere: Literal["saastamoinen", "none"] = "saastamoinen"
    elevation_mask_deg: float = Field(10.0, description="satellites lower than this are left out")
    cn0_mask_dbhz: float = Field(25.0, description="weaker signals are left out")
    rates: bool = Field(True, description="also use range rates")
    antenna: str | None = Field(
        None,
        description="type and radome in an ANTEX file of the ephemerides; as the log states if left out; or none",
    )
    carrier: Literal["off", "time-differenced", "rtk"] = Field(
        "off",
        description="time-differenced: also use how carrier phases change between epochs; rtk: against a base, too",
    )
    carrier_sigma_m: Positive | Literal["log"] = Field(
        0.003,
        description="1-sigma of the phase of a strong satellite overhead; log: as satellites show it beside each other",
    )
    carrier_walk_m: NonNegative = Field(
        0.003, description="random walk of a phase within its arc, m per square root of a second"
    )
    base: BaseSection = Field(BaseSection(), description="for carrier = rtk")
    integrity: bool = Field(True, description="snapshot fault detection and exclusion before the filter")
    min_satellites: Annotated[int, Field(ge=1)] = Field(1, description="epochs with fewer are left out")
    max_satellites: Annotated[int, Field(ge=1)] | None = Field(None, description="cut to the highest ones, for tests")
    clock_noise_m: Positive | Literal["log"] = Field(
        0.3,
        description="white frequency noise, m per square root of a second; log: as carriers and range rates show it",
    )
    clock_drift_noise_m_s: Positive = Field(
        0.1, description="random walk of frequency, m/s per square root of a second"
    )
    clock_sigma_m: Positive = Field(100.0, description="1-sigma of the clock offset about the first solution")
    clock_drift_sigma_m_s: Positive = Field(10.0, description="1-sigma of the clock drift about the first solution")
    range_sigma_scale: Positive = Field(1.0, description="factor on the 1-sigma values of pseudoranges")
    rate_sigma_scale: Positive = Field(1.0, description="factor on the 1-sigma values of range rates")
    system_noise_m: NonNegative = Field(0.01, description="wander between systems, m per square root of a second")

    @model_validator(mode="after")
    def _noise_by_carriers(self) -> TightSection:
        for name in ("clock_noise_m", "carrier_sigma_m"):
            if getattr(self, name) == "log" and self.carrier == "off":
                raise ValueError(f'{name} = "log" needs carrier phases: set carrier, or give a number')
        return self


class CorrelatedSection(Section):
    """Slow errors of GNSS as Gauss-Markov states beside the white error: of solutions, or of each satellite."""

    position_sigma_m: NonNegative = Field(0.0, description="1-sigma of the slow position error; 0: none")
    position_tau_s: Positive = Field(100.0, description="its correlation time")
    velocity_sigma_m_s: NonNegative = Field(0.0, description="1-sigma of the slow velocity error; 0: none")
    velocity_tau_s: Positive = Field(20.0, description="its correlation time")

    @property
    def of_ranges(self) -> SlowRangeError:
        """Slow error of pseudoranges in tight coupling."""
        return SlowRangeError(self.position_sigma_m, self.position_tau_s)
