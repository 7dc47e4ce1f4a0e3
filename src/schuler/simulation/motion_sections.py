"""Sections of a scenario for how the body moves."""

from __future__ import annotations

from dataclasses import replace
from typing import Annotated, Literal

import numpy as np
from pydantic import Field, model_validator

from schuler import frames, units
from schuler.arrays import FloatArray
from schuler.exceptions import ConfigError
from schuler.simulation.aid_sections import NonNegative, Positive, Section, Triple
from schuler.simulation.motion import Motion, StaticMotion
from schuler.simulation.profiles import Manoeuvre, ManoeuvreMotion, SplineMotion, polynomial_motion
from schuler.simulation.routine import RoutineMotion, six_face_routine, thesis_routine
from schuler.simulation.steps import Rest, Routine, Step, Turn
from schuler.simulation.waypoints import Waypoint, WaypointMotion


class WaypointSection(Section):
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


class ManoeuvreSection(Section):
    """One command."""

    duration_s: Positive
    speed_m_s: NonNegative | None = None
    turn_deg: float = 0.0
    climb_m_s: float | None = None


class StepSection(Section):
    """One step of a routine: a rest, or a turn about an axis of the body."""

    rest_s: Positive | None = None
    axis: Literal["x", "y", "z"] | Triple | None = None
    turn_deg: float | None = None
    duration_s: Positive | None = Field(None, description="of a turn")

    @model_validator(mode="after")
    def _one_kind(self) -> StepSection:
        turn = (self.axis, self.turn_deg, self.duration_s)
        given = [v is not None for v in turn]
        if (self.rest_s is None and not all(given)) or (self.rest_s is not None and any(given)):
            raise ValueError("give rest_s, or axis, turn_deg and duration_s")
        return self

    def step(self) -> Step:
        """The step itself."""
        if self.rest_s is not None:
            return Rest(self.rest_s)
        assert self.axis is not None
        assert self.turn_deg is not None
        assert self.duration_s is not None
        return Turn(self.axis, self.turn_deg * units.DEG, self.duration_s)


#: Entries that only some types of motion use.
_ENTRIES: dict[str, tuple[str, ...]] = {
    "static": ("rpy_deg", "duration_s"),
    "waypoints": ("waypoints", "acceleration_m_s2", "bank"),
    "manoeuvres": ("manoeuvres", "laps", "heading_deg", "speed_m_s", "bank"),
    "spline": ("t_s", "ned_m", "nodes_rpy_deg"),
    "polynomial": ("ned_m", "nodes_rpy_deg", "step_s", "angle_step_s"),
    "routine": ("rpy_deg", "routine", "dwell_s", "turn_s", "repeats", "steps", "lever_m"),
}


class MotionSection(Section):
    """Motion of the body."""

    type: Literal["static", "waypoints", "manoeuvres", "spline", "polynomial", "routine"]
    lat_deg: Annotated[float, Field(ge=-90.0, le=90.0)] = Field(description="origin")
    lon_deg: float = Field(description="origin")
    height_m: float = Field(0.0, description="origin, ellipsoidal")
    rpy_deg: Triple = Field((0.0, 0.0, 0.0), description="attitude, static motion; the first one of a routine")
    duration_s: Positive | None = Field(None, description="static motion")
    waypoints: tuple[WaypointSection, ...] = ()
    acceleration_m_s2: Positive = 1.5
    bank: Annotated[float, Field(ge=0.0, le=1.0)] = Field(0.0, description="share of the coordinated bank angle")
    manoeuvres: tuple[ManoeuvreSection, ...] = ()
    laps: Annotated[int, Field(ge=1)] = Field(1, description="times the manoeuvres are driven")
    heading_deg: float = Field(0.0, description="initial, manoeuvres")
    speed_m_s: NonNegative = Field(0.0, description="initial, manoeuvres")
    t_s: tuple[float, ...] = Field((), description="times of spline nodes")
    ned_m: tuple[Triple, ...] = Field((), description="spline nodes or polynomial knots, about the origin")
    nodes_rpy_deg: tuple[Triple, ...] = Field((), description="attitudes at spline nodes or polynomial knots")
    step_s: Positive | None = Field(None, description="spacing of polynomial position knots")
    angle_step_s: Positive | None = Field(None, description="spacing of polynomial angle knots")
    routine: Literal["thesis", "six_faces"] = Field("thesis", description="rests and turns for calibration")
    dwell_s: Positive = Field(10.0, description="rests of a routine")
    turn_s: Positive | None = Field(None, description="one turn of a routine: 1.25 by 45 degrees, 2.5 by 90")
    repeats: Annotated[int, Field(ge=1)] | None = Field(None, description="sets of three axes: 2 thesis, 1 six_faces")
    steps: tuple[StepSection, ...] = Field((), description="a routine of one's own instead")
    lever_m: Triple = Field((0.0, 0.0, 0.0), description="from the point a routine turns about to the IMU")
    earth_rotation: bool = True

    @model_validator(mode="after")
    def _of_this_type(self) -> MotionSection:
        every = {name for names in _ENTRIES.values() for name in names}
        for name in sorted(self.model_fields_set & every - set(_ENTRIES[self.type])):
            if getattr(self, name) != type(self).model_fields[name].default:
                types = " or ".join(f'"{kind}"' for kind, names in _ENTRIES.items() if name in names)
                raise ValueError(f'{name} is of type = {types}; a motion of type "{self.type}" does not use it')
        return self

    def build(self) -> Motion:
        """The motion itself."""
        origin = np.array([self.lat_deg * units.DEG, self.lon_deg * units.DEG, self.height_m])
        if self.type == "static":
            if self.duration_s is None:
                raise ConfigError("motion: a static motion needs duration_s")
            return StaticMotion(origin, np.array(self.rpy_deg) * units.DEG, self.duration_s)
        if self.type == "routine":
            return RoutineMotion(self._routine(), origin, self.lever_m)
        if self.type == "waypoints":
            points = [Waypoint(llh=_place(p, origin), speed=p.speed_m_s, stop=p.stop_s) for p in self.waypoints]
            return WaypointMotion.through(points, acceleration=self.acceleration_m_s2, bank=self.bank)
        if self.type == "manoeuvres":
            commands = [
                Manoeuvre(duration=c.duration_s, speed=c.speed_m_s, turn=c.turn_deg * units.DEG, climb=c.climb_m_s)
                for c in self.manoeuvres
            ]
            return ManoeuvreMotion.of(
                commands * self.laps, origin, heading=self.heading_deg * units.DEG, speed=self.speed_m_s, bank=self.bank
            )
        rpy = np.array(self.nodes_rpy_deg).reshape(-1, 3) * units.DEG
        ned = np.array(self.ned_m).reshape(-1, 3)
        if self.type == "spline":
            llh = frames.llh_from_ecef(frames.ecef_from_ned(ned, origin))
            return SplineMotion.through(np.array(self.t_s), llh, rpy)
        if self.step_s is None or self.angle_step_s is None:
            raise ConfigError("motion: a polynomial motion needs step_s and angle_step_s")
        return polynomial_motion(ned, self.step_s, rpy, self.angle_step_s, origin)

    def _routine(self) -> Routine:
        if self.steps:
            routine = Routine(tuple(s.step() for s in self.steps))
        elif self.routine == "thesis":
            routine = thesis_routine(dwell_s=self.dwell_s, turn_s=self.turn_s or 1.25, repeats=self.repeats or 2)
        else:
            routine = six_face_routine(dwell_s=self.dwell_s, turn_s=self.turn_s or 2.5, repeats=self.repeats or 1)
        roll, pitch, yaw = (angle * units.DEG for angle in self.rpy_deg)
        return replace(routine, rpy_nb=(roll, pitch, yaw))


def _place(p: WaypointSection, origin: FloatArray) -> FloatArray:
    height = origin[2] if p.height_m is None else p.height_m
    if p.north_m is not None and p.east_m is not None:
        llh = frames.llh_from_ecef(frames.ecef_from_ned([p.north_m, p.east_m, 0.0], origin))
        return np.array([llh[0], llh[1], height])
    assert p.lat_deg is not None
    assert p.lon_deg is not None
    return np.array([p.lat_deg * units.DEG, p.lon_deg * units.DEG, height])
