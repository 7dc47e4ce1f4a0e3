"""Sections of a scenario for what aids an IMU, and the models in SI that they describe."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field, model_validator

from schuler.gnss.synthetic import RangeErrors, Sector
from schuler.simulation.gnss import GnssFault, GnssModel
from schuler.simulation.imu import StreamFaults
from schuler.simulation.satellites import BlockedSky, RangeFault, SatelliteModel, SkyWindow
from schuler.simulation.scalar_aids import HeadingModel, HeightModel
from schuler.units import DEG

Triple = tuple[float, float, float]
Window = tuple[float, float]
Positive = Annotated[float, Field(gt=0.0)]
NonNegative = Annotated[float, Field(ge=0.0)]
Share = Annotated[float, Field(ge=0.0, lt=1.0)]


class Section(BaseModel):
    """Base of all sections: immutable, nothing unknown."""

    model_config = ConfigDict(extra="forbid", frozen=True)


class StreamSection(Section):
    """Faults of the IMU's stream."""

    gaps_s: tuple[Window, ...] = Field((), description="windows whose samples are lost")
    repeats: Share = Field(0.0, description="share of samples that hold the values of the one before")
    jitter_s: NonNegative = Field(0.0, description="1-sigma of the stamps about their times")
    clock_shift_s: float = Field(0.0, description="added to every stamp")

    def faults(self) -> StreamFaults:
        """Faults in SI."""
        return StreamFaults(
            gaps=self.gaps_s, repeats=self.repeats, jitter=self.jitter_s, clock_shift=self.clock_shift_s
        )


class GnssFaultSection(Section):
    """A time in which the receiver's solutions are wrong and it does not say so."""

    start_s: float
    stop_s: float
    position_m: Triple = Field((0.0, 0.0, 0.0), description="added, north east down")
    velocity_m_s: Triple = Field((0.0, 0.0, 0.0), description="added, north east down")


class GnssModelSection(Section):
    """The simulated receiver's solutions."""

    rate_hz: Positive = 1.0
    sigma_position_m: Triple = (1.5, 1.5, 3.0)
    sigma_velocity_m_s: Triple = (0.05, 0.05, 0.1)
    drift_position_m: Triple = (0.0, 0.0, 0.0)
    drift_velocity_m_s: Triple = (0.0, 0.0, 0.0)
    drift_time_s: Positive = 60.0
    lever_arm_m: Triple = (0.0, 0.0, 0.0)
    first_s: NonNegative = 0.0
    outages_s: tuple[Window, ...] = ()
    latency_s: NonNegative = 0.0
    clock_shift_s: float = 0.0
    reported_position_m: Triple | None = Field(None, description="1-sigma it claims; that of its white errors else")
    reported_velocity_m_s: Triple | None = None
    faults: tuple[GnssFaultSection, ...] = ()
    stale: Share = Field(0.0, description="share of epochs that hold the solution before under their own stamp")
    late: Annotated[float, Field(ge=0.0, le=1.0)] = Field(0.0, description="share of solutions delivered late")
    late_s: NonNegative = Field(0.0, description="by how much more than latency_s")

    def model(self) -> GnssModel:
        """Receiver model in SI."""
        return GnssModel(
            rate_hz=self.rate_hz, sigma_position=self.sigma_position_m, sigma_velocity=self.sigma_velocity_m_s,
            drift_position=self.drift_position_m, drift_velocity=self.drift_velocity_m_s, drift_time=self.drift_time_s,
            lever_arm_b=self.lever_arm_m, first_s=self.first_s, outages=self.outages_s, latency=self.latency_s,
            clock_shift=self.clock_shift_s, reported_position=self.reported_position_m,
            reported_velocity=self.reported_velocity_m_s, stale=self.stale, late=self.late, late_time=self.late_s,
            faults=tuple(GnssFault(f.start_s, f.stop_s, f.position_m, f.velocity_m_s) for f in self.faults),
        )  # fmt: skip


class OdometerModelSection(Section):
    """The simulated odometer."""

    rate_hz: Positive = 10.0
    sigma_m_s: Positive = 0.05
    scale_error: float = Field(0.0, description="relative error of the circumference")
    scale_sigma: NonNegative = Field(0.0, description="1-sigma of a drawn part beside it")
    lever_arm_m: Triple = (0.0, 0.0, 0.0)
    outages_s: tuple[Window, ...] = ()


class HeadingModelSection(Section):
    """The simulated compass, or two antennas."""

    rate_hz: Positive = 1.0
    sigma_deg: Positive = 1.0
    bias_deg: float = Field(0.0, description="constant error")
    bias_sigma_deg: NonNegative = Field(0.0, description="1-sigma of a drawn part beside it")
    drift_deg: NonNegative = Field(0.0, description="1-sigma of a Gauss-Markov error that sigma_deg does not show")
    drift_time_s: Positive = 60.0
    declination_deg: float = Field(0.0, description="subtracted from the true heading, positive east")
    outages_s: tuple[Window, ...] = ()

    def model(self) -> HeadingModel:
        """Model in SI."""
        return HeadingModel(
            rate_hz=self.rate_hz, sigma=self.sigma_deg * DEG, bias=self.bias_deg * DEG,
            bias_sigma=self.bias_sigma_deg * DEG, drift=self.drift_deg * DEG, drift_time=self.drift_time_s,
            declination=self.declination_deg * DEG, outages=self.outages_s,
        )  # fmt: skip


class HeightModelSection(Section):
    """The simulated barometer."""

    rate_hz: Positive = 1.0
    sigma_m: Positive = 0.3
    bias_m: float = Field(0.0, description="error at the start")
    bias_sigma_m: NonNegative = Field(0.0, description="1-sigma of a drawn part beside it")
    bias_noise_m: NonNegative = Field(0.0, description="random walk of the bias, m per square root of a second")
    lever_m: Triple = (0.0, 0.0, 0.0)
    outages_s: tuple[Window, ...] = ()

    def model(self) -> HeightModel:
        """Model in SI."""
        return HeightModel(
            rate_hz=self.rate_hz, sigma=self.sigma_m, bias=self.bias_m, bias_sigma=self.bias_sigma_m,
            bias_walk=self.bias_noise_m, lever_b=self.lever_m, outages=self.outages_s,
        )  # fmt: skip


class BlockedSection(Section):
    """A part of the sky that is blocked."""

    azimuth_deg: Window = Field(description="from, to; (350, 10) goes through north")
    below_deg: Annotated[float, Field(gt=0.0, le=90.0)] = 90.0
    start_s: float | None = Field(None, description="from the start if left out")
    stop_s: float | None = Field(None, description="to the end if left out")


class SkySection(Section):
    """A time with few satellites."""

    start_s: float
    stop_s: float
    satellites: Annotated[int, Field(ge=0)] = Field(description="most satellites seen; the highest stay")


class RangeFaultSection(Section):
    """A satellite that is wrong for a time."""

    satellite: str = Field("highest", description="RINEX name, or highest: the highest one when the fault begins")
    start_s: float
    stop_s: float
    step_m: float = 0.0
    ramp_m_s: float = 0.0


class SatellitesSection(Section):
    """The simulated receiver's raw measurements."""

    give: Literal["ranges", "observations"] = Field(
        "ranges", description="observations: as a receiver logs them, with ephemerides, to be prepared first"
    )
    systems: str = "GE"
    rate_hz: Positive = 1.0
    first_s: NonNegative = 0.0
    noise_m: NonNegative = Field(0.5, description="white 1-sigma of ranges at the zenith")
    rate_noise_m_s: NonNegative = 0.05
    multipath_m: NonNegative = Field(0.5, description="1-sigma at the zenith, Gauss-Markov for each satellite")
    multipath_time_s: Positive = 30.0
    atmosphere_m: NonNegative = Field(0.0, description="1-sigma at the zenith of what correction models leave")
    atmosphere_time_s: Positive = 1800.0
    clock_m: float = Field(3e4, description="receiver clock at the start")
    clock_drift_m_s: float = 30.0
    clock_noise_m: NonNegative = Field(0.2, description="white frequency noise, m per square root of a second")
    clock_drift_noise_m_s: NonNegative = Field(
        0.05, description="random walk of frequency, m/s per square root of a second"
    )
    offsets_m: tuple[float, ...] = Field((), description="clock of each further system less that of the first")
    elevation_mask_deg: float = 10.0
    lever_arm_m: Triple = (0.0, 0.0, 0.0)
    blocked: tuple[BlockedSection, ...] = ()
    windows: tuple[SkySection, ...] = ()
    outages_s: tuple[Window, ...] = ()
    faults: tuple[RangeFaultSection, ...] = ()
    clock_jumps_s: tuple[Window, ...] = Field((), description="time and step of the receiver clock, both in seconds")
    clock_shift_s: float = Field(0.0, description="added to the stamps of ranges")
    carrier_noise_m: NonNegative = Field(0.002, description="white 1-sigma of carrier phases at the zenith")
    carrier_walk_m: NonNegative = Field(0.001, description="their random walk, m per square root of a second")
    slips_per_hour: NonNegative = Field(0.0, description="cycle slips of each carrier that nobody states")

    @model_validator(mode="after")
    def _right_time(self) -> SatellitesSection:
        if self.clock_shift_s and self.give == "observations":
            raise ValueError("raw observations carry GPS time itself: shift the IMU instead, imu.stream.clock_shift_s")
        return self

    def model(self) -> SatelliteModel:
        """Model in SI."""
        errors = RangeErrors(
            self.noise_m, self.rate_noise_m_s, self.multipath_m, self.multipath_time_s, self.atmosphere_m,
            self.atmosphere_time_s, self.clock_m, self.clock_drift_m_s, self.clock_noise_m**2,
            self.clock_drift_noise_m_s**2, self.offsets_m, self.carrier_noise_m, self.carrier_walk_m,
        )  # fmt: skip
        infinity = float("inf")
        blocked = tuple(
            BlockedSky(
                Sector(b.azimuth_deg[0] * DEG, b.azimuth_deg[1] * DEG, b.below_deg * DEG),
                -infinity if b.start_s is None else b.start_s,
                infinity if b.stop_s is None else b.stop_s,
            )
            for b in self.blocked
        )
        return SatelliteModel(
            systems=self.systems, rate_hz=self.rate_hz, first_s=self.first_s, errors=errors,
            elevation_mask=self.elevation_mask_deg * DEG, lever_arm_b=self.lever_arm_m, blocked=blocked,
            windows=tuple(SkyWindow(w.start_s, w.stop_s, w.satellites) for w in self.windows), outages=self.outages_s,
            faults=tuple(RangeFault(f.satellite, f.start_s, f.stop_s, f.step_m, f.ramp_m_s) for f in self.faults),
            clock_jumps=self.clock_jumps_s, clock_shift=self.clock_shift_s,
            slips_per_hour=self.slips_per_hour,
        )  # fmt: skip
