"""Configuration of a foot-mounted run: one TOML file, or the defaults."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import Field

from schuler.navigation.sections import Config, NonNegative, Positive, Section


class PlaceSection(Section):
    """Place of the walk, which foot logs do not hold; only gravity and the Earth's rotation depend on it."""

    lat_deg: Annotated[float, Field(ge=-89.9, le=89.9)] = Field(45.0, description="geodetic latitude")
    lon_deg: Annotated[float, Field(ge=-180.0, le=360.0)] = Field(0.0, description="longitude")
    height_m: float = Field(0.0, description="ellipsoidal height")


class SensorSection(Section):
    """Errors of the sensors as the filter sees them on a shoe, far larger than on a bench; see docs/foot-mounted.md."""

    accel_noise_m_s2_rthz: Positive | None = Field(
        None, description="white noise of specific force; left out: from the motion of the log"
    )
    gyro_noise_deg_s_rthz: Positive | None = Field(
        None, description="white noise of angular rate; left out: from the motion of the log"
    )
    accel_bias_m_s2: Positive = Field(0.03, description="1-sigma bias, states 15 and 21")
    gyro_bias_deg_s: Positive = Field(
        0.1, description="1-sigma bias, states 15 and 21, before the mean rate of the first rest"
    )
    accel_scale: Positive = Field(3e-3, description="1-sigma scale factor, states 21")
    gyro_scale: Positive = Field(3e-3, description="1-sigma scale factor, states 21")
    rate_order: Literal[1, 2, 3] = Field(2, description="rule that integrates rates: held, trapezoid, parabola")
    max_gap_s: Positive = Field(0.1, description="longest pause of the log that is bridged; longer ones are refused")


class DetectorSection(Section):
    """Detection of the rests of the foot."""

    kind: Literal["shoe", "ared", "amv", "magnitude"] = Field(
        "shoe", description="likelihood ratio, angular rate energy, acceleration variance, acceleration magnitude"
    )
    window_s: Positive | None = Field(
        None, description="window of the statistic; left out: 0.025 for shoe and ared, 0.1 for amv, 0.15 for magnitude"
    )
    sigma_accel_m_s2: Positive = Field(0.01, description="specific force that the statistic is relative to")
    sigma_gyro_deg_s: Positive = Field(0.1, description="angular rate that the statistic is relative to")
    threshold: Positive | Literal["motion", "time", "noise"] = Field(
        "motion",
        description="a number; or a share of the mean over a stride; rising since the last rest; from noise at rest",
    )
    ratio: Annotated[float, Field(gt=0.0, lt=1.0)] = Field(0.01, description="motion: share of the mean")
    stillest: NonNegative = Field(
        3.0, description="motion: a stance is also below this multiple of the least value of a stride; 0 leaves it out"
    )
    cycle_s: Positive | None = Field(
        None,
        description="motion: a stride; left out: as the log repeats itself; 1.5 where it does not",
    )
    growth_per_s: Positive = Field(5e4, description="time: rise of the threshold in a second")
    delay_s: NonNegative = Field(0.0, description="time: pause after a rest before it rises")
    floor: NonNegative = Field(2500.0, description="motion, time: smallest threshold, that of a foot of one who stands")
    false_alarm: Annotated[float, Field(gt=0.0, lt=1.0)] = Field(1e-3, description="noise: rests taken for motion")
    margin: Annotated[float, Field(ge=1.0)] = Field(3.0, description="noise: factor on the threshold")
    leave: Annotated[float, Field(ge=1.0)] = Field(1.0, description="a rest ends above this multiple of the threshold")
    min_rest_s: NonNegative = Field(
        0.02, description="shorter rests are left out; not with time, which finds single samples"
    )
    bridge_s: NonNegative = Field(0.0, description="shorter breaks of a rest are closed")

    @property
    def window(self) -> float:
        """The window in effect: accelerations pass through zero in a swing, and rates hardly do. [s]"""
        return (
            {"shoe": 0.025, "ared": 0.025, "amv": 0.1, "magnitude": 0.15}[self.kind]
            if self.window_s is None
            else (self.window_s)
        )


class ZuptSection(Section):
    """Zero velocities of a resting foot."""

    sigma_m_s: Positive = Field(0.03, description="1-sigma velocity of a resting foot, every sample")
    roll_m: NonNegative = Field(0.06, description="adds this times the angular rate: the foot rolls over the ground")
    gate: Annotated[float, Field(gt=0.0, lt=1.0)] | Literal["off"] = Field(
        "off", description="probability with which a good zero velocity passes"
    )
    pivot: bool = Field(True, description="estimate the point of the shoe that rests, instead of taking the IMU")
    pivot_sigma_m: Positive = Field(0.1, description="1-sigma distance of that point from the IMU, each axis")


class FootAlignmentSection(Section):
    """Initial attitude: gravity at the first rest, and a given heading."""

    rest_s: Positive = Field(1.0, description="longest stretch of the first rest used for levelling")
    min_rest_s: Positive = Field(0.1, description="shortest first rest that is accepted")
    tilt_sigma_deg: Positive = Field(0.1, description="1-sigma tilt from sway, beside that from biases")
    heading_deg: float = Field(0.0, description="heading at the start; arbitrary unless measured")
    heading_sigma_deg: Positive = Field(0.001, description="1-sigma; tiny where the heading only names the axes")


class FootFilterSection(Section):
    """States and rates of the filter."""

    states: Literal[9, 15, 21] = Field(15, description="9: navigation; 15: and biases; 21: and scale factors")
    smooth: Literal["walk", "stride", "none"] = Field("walk", description="over all, with a delay of a stride, or not")
    covariance_rate_hz: Positive | None = Field(10.0, description="between rests; at rest every sample")
    record_s: Positive = Field(0.05, description="spacing of covariance records")
    position_sigma_m: Positive = Field(1e-4, description="1-sigma of the start, which is the origin")


class StrideSection(Section):
    """Definition of a stride."""

    min_rest_s: NonNegative = Field(0.05, description="shorter rests do not end a stride")
    min_motion_s: NonNegative = Field(0.1, description="shorter motions do not divide a rest")
    min_length_m: NonNegative = Field(0.1, description="shorter ones are shuffles: listed, but no strides")


class FootConfig(Config):
    """A foot-mounted run; every section has defaults that suit a shoe and walking.

    Attributes
    ----------
    recording : dict
        How the log is read, see docs/reading-data.md; not needed for the files of PyShoe and OpenShoe.
    place, sensor, detector, zupt, alignment, filter, stride
        Sections.
    """

    recording: dict[str, Any] = Field(default_factory=dict)
    place: PlaceSection = PlaceSection()
    sensor: SensorSection = SensorSection()
    detector: DetectorSection = DetectorSection()
    zupt: ZuptSection = ZuptSection()
    alignment: FootAlignmentSection = FootAlignmentSection()
    filter: FootFilterSection = FootFilterSection()
    stride: StrideSection = StrideSection()
