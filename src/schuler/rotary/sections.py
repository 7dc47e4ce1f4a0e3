"""Sections of a scenario for a rotating IMU: its schedule, the platform's encoder and limits, the IMU's place on it."""

from __future__ import annotations

from typing import Annotated, Literal

import numpy as np
from pydantic import Field, model_validator

from schuler import rotation, units
from schuler.arrays import FloatArray
from schuler.navigation.sections import NonNegative, Positive, Section, Triple
from schuler.rotary import schemes
from schuler.rotary.du_axes import du_axis
from schuler.rotary.encoder import Between, Encoder
from schuler.rotary.gimbals import axis_vector
from schuler.rotary.platform_usage import PlatformLimits
from schuler.rotary.rotating_imu import RotatingMotion
from schuler.rotary.schedule import Schedule
from schuler.simulation.motion import Motion

AxisName = Literal["x", "y", "z", "-x", "-y", "-z", "du-X", "du-Y", "du-Z"]
Axis = AxisName | Triple


class MoveSection(Section):
    """One move of a sequence."""

    axis: Annotated[int, Field(ge=0)] = Field(0, description="number of the axis, 0 is the outermost")
    turn_deg: float
    dwell_s: NonNegative = 0.0


#: Entries that each type needs, and those it may have besides; the rest would be ignored and is refused.
_NEEDS: dict[str, tuple[set[str], set[str]]] = {
    "fixed": (set(), {"axis", "angle_deg"}),
    "continuous": ({"rate_deg_s"}, {"axis", "acceleration_deg_s2", "angle_deg"}),
    "reciprocating": (
        {"rate_deg_s"},
        {"axis", "acceleration_deg_s2", "angle_deg", "turn_deg", "both_sides", "dwell_s"},
    ),
    "carousel": ({"rate_deg_s", "limit_deg"}, {"axis", "acceleration_deg_s2"}),
    "dwell": ({"rate_deg_s", "dwell_s"}, {"axis", "acceleration_deg_s2", "positions", "positions_deg", "back"}),
    "dual_axis": ({"rate_deg_s", "dwell_s"}, {"axes", "acceleration_deg_s2", "positions"}),
    "sequence": ({"rate_deg_s", "axes", "moves"}, {"acceleration_deg_s2", "repeat"}),
    "rates": ({"t_s", "rates_deg_s"}, {"axis", "angle_deg", "repeat"}),
}
_ALWAYS = {"type", "start_s", "tilt_axis", "tilt_deg", "mount_rpy_deg"}


class ScheduleSection(Section):
    """How the platform turns; axes are of the body: x forward, y right, z down, or Du's by ``du-X`` and so on."""

    type: Literal["fixed", "continuous", "reciprocating", "carousel", "dwell", "dual_axis", "sequence", "rates"]
    axis: Axis = Field("z", description="of one axis; a name or a direction")
    axes: tuple[Axis, ...] = Field((), description="of several, outermost first")
    rate_deg_s: float | None = Field(None, description="signed for continuous rotation, the largest rate else")
    acceleration_deg_s2: Positive | None = Field(None, description="the rate jumps if left out")
    start_s: NonNegative = Field(0.0, description="at rest before it")
    angle_deg: float = Field(0.0, description="at the start")
    turn_deg: float = Field(360.0, description="one stroke of a reciprocating rotation")
    both_sides: bool = False
    limit_deg: Positive | None = Field(None, description="largest angle either way of a carousel")
    dwell_s: NonNegative = Field(0.0, description="rest at each position")
    positions: Annotated[int, Field(ge=2)] | None = None
    positions_deg: tuple[float, ...] = Field((), description="positions in the order they are visited")
    back: bool = Field(True, description="a turn forwards, then one backwards")
    moves: tuple[MoveSection, ...] = ()
    repeat: bool = Field(True, description="of a sequence or of rates")
    t_s: tuple[float, ...] = ()
    rates_deg_s: tuple[float, ...] = ()
    tilt_axis: Axis = Field("y", description="of a clamped outer gimbal")
    tilt_deg: float = Field(0.0, description="angle of the outer gimbal")
    mount_rpy_deg: Triple = Field((0.0, 0.0, 0.0), description="of the IMU in the innermost frame")

    @model_validator(mode="after")
    def _entries(self) -> ScheduleSection:
        needs, may = _NEEDS[self.type]
        given = self.model_fields_set
        if missing := sorted(needs - given):
            raise ValueError(f"a schedule of type {self.type} needs {', '.join(missing)}")
        if extra := sorted(given - needs - may - _ALWAYS):
            raise ValueError(f"a schedule of type {self.type} has no {', '.join(extra)}")
        if self.positions is not None and self.positions_deg:
            raise ValueError("give positions or positions_deg")
        if self.type == "dual_axis" and len(self.axes) not in (0, 2):
            raise ValueError("a dual-axis schedule has two axes, the outer first")
        if self.type == "dual_axis" and self.positions not in (None, 4, 8, 16):
            raise ValueError("a dual-axis schedule has 4, 8 or 16 positions; write others as a sequence")
        return self

    def build(self) -> Schedule:
        """The schedule itself."""
        made = self._scheme()
        if self.tilt_deg:
            made = schemes.tilted(made, axis_of(self.tilt_axis), self.tilt_deg * units.DEG)
        if any(self.mount_rpy_deg):
            made = made.mounted(rotation.dcm_from_rpy(np.array(self.mount_rpy_deg) * units.DEG))
        return made

    def _scheme(self) -> Schedule:
        deg, axis, start = units.DEG, axis_of(self.axis), self.start_s
        rate = (self.rate_deg_s or 0.0) * deg
        limit = None if self.acceleration_deg_s2 is None else self.acceleration_deg_s2 * deg
        angle, dwell = self.angle_deg * deg, self.dwell_s
        match self.type:
            case "fixed":
                return schemes.fixed(axis, angle).delayed(start)
            case "continuous":
                return schemes.continuous(axis, rate, acceleration=limit, start=start, angle=angle)
            case "reciprocating":
                return schemes.reciprocating(
                    axis, rate, turn=self.turn_deg * deg, both_sides=self.both_sides, dwell=dwell, acceleration=limit,
                    start=start, angle=angle,
                )  # fmt: skip
            case "carousel":
                assert self.limit_deg is not None
                return schemes.carousel(axis, rate, limit=self.limit_deg * deg, acceleration=limit, start=start)
            case "dwell":
                places = [p * deg for p in self.positions_deg] or self.positions or 4
                return schemes.dwell(
                    axis, places, dwell=dwell, rate=rate, back=self.back, acceleration=limit, start=start
                )
            case "dual_axis":
                outer, inner = self.axes or ("x", "z")
                return schemes.dual_axis(
                    self.positions or 8, dwell=dwell, rate=rate, outer=axis_of(outer), inner=axis_of(inner),
                    acceleration=limit, start=start,
                )  # fmt: skip
            case "sequence":
                moves = [schemes.Move(m.axis, m.turn_deg * deg, m.dwell_s) for m in self.moves]
                axes = [axis_of(a) for a in self.axes]
                return schemes.sequence(axes, moves, rate=rate, acceleration=limit, start=start, repeat=self.repeat)
            case "rates":
                rates = np.array(self.rates_deg_s) * deg
                repeat = self.repeat and "repeat" in self.model_fields_set
                return schemes.from_rates(axis, self.t_s, rates, repeat=repeat, start=start, angle=angle)


class EncoderSection(Section):
    """The platform's encoder."""

    rate_hz: Positive = 50.0
    resolution_deg: NonNegative = 0.0
    noise_deg: NonNegative = 0.0
    time_offset_s: float = Field(0.0, description="readings belong to a moment so much later than their stamp")
    zero_offset_deg: float = 0.0
    between: Between = Field("linear", description="how angles change between readings")

    def build(self) -> Encoder:
        """The encoder in SI."""
        return Encoder(
            interval=1.0 / self.rate_hz, resolution=self.resolution_deg * units.DEG, noise=self.noise_deg * units.DEG,
            time_offset=self.time_offset_s, zero_offset=self.zero_offset_deg * units.DEG,
        )  # fmt: skip


class LimitsSection(Section):
    """What the platform can do."""

    rate_deg_s: Positive = 100.0
    acceleration_deg_s2: Positive | None = Field(None, description="no limit if left out")
    angle_deg: Positive | None = Field(None, description="either way; none with a slip ring")
    axes: Annotated[int, Field(ge=1, le=3)] = 1

    def build(self) -> PlatformLimits:
        """The limits in SI."""
        return PlatformLimits(
            rate=self.rate_deg_s * units.DEG,
            acceleration=np.inf if self.acceleration_deg_s2 is None else self.acceleration_deg_s2 * units.DEG,
            angle=np.inf if self.angle_deg is None else self.angle_deg * units.DEG,
            axes=self.axes,
        )


class RotarySection(Section):
    """A rotating IMU: ``[rotary]`` of a scenario."""

    schedule: ScheduleSection
    encoder: EncoderSection = EncoderSection()
    limits: LimitsSection | None = None
    offset_m: Triple = Field((0.0, 0.0, 0.0), description="from where the axes meet to the IMU, IMU axes")

    def build(self, vehicle: Motion) -> RotatingMotion:
        """The motion of the IMU on a vehicle."""
        return RotatingMotion(vehicle, self.schedule.build(), np.array(self.offset_m))


def axis_of(axis: Axis) -> FloatArray:
    """Direction of an axis of a scenario, body axes. Shape (3,)."""
    if axis == "du-X":
        return du_axis("X")
    if axis == "du-Y":
        return du_axis("Y")
    return du_axis("Z") if axis == "du-Z" else axis_vector(axis)
