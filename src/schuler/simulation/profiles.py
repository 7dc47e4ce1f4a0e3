"""Motions people describe in words: way-points with speeds, manoeuvre commands, polynomials through knots.

All of them end in smooth closed forms, so position, velocity, attitude, specific force and angular rate belong to each
other exactly. Speeds, turns and climbs change along ``6 x^5 - 15 x^4 + 10 x^3``, whose first two derivatives vanish at
both ends: acceleration and jerk are continuous.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from schuler import earth, frames
from schuler.arrays import ArrayLike, FloatArray, as_floats, as_vector3
from schuler.exceptions import InputError
from schuler.simulation.motion import LocalMotion, MotionState, check_span, euler_attitude
from schuler.simulation.splines import geodetic_state

_STEEPEST = 1.875  # largest slope of the blend


def blend(x: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Integral, value, first and second derivative of the smooth step on 0..1. Shapes follow the input."""
    return (
        x**4 * (2.5 - x * (3.0 - x)),
        x**3 * (10.0 - x * (15.0 - 6.0 * x)),
        30.0 * x**2 * (1.0 - x) ** 2,
        60.0 * x * (1.0 - x) * (1.0 - 2.0 * x),
    )


@dataclass(frozen=True, slots=True)
class Ramps:
    """A quantity that moves smoothly from one level to the next.

    Attributes
    ----------
    start : ndarray, shape (k + 1,)
        Start of each stretch, and the end of the last. [s]
    level : ndarray, shape (k + 1,)
        Value at those times.
    integral : ndarray, shape (k + 1,)
        Integral of the quantity from zero to those times.
    """

    start: FloatArray
    level: FloatArray
    integral: FloatArray

    @classmethod
    def through(cls, durations: ArrayLike, levels: ArrayLike) -> Ramps:
        """From the k durations [s] between k + 1 levels."""
        d, v = as_floats(durations, "durations", (None,)), as_floats(levels, "levels", (None,))
        start = np.concatenate(([0.0], np.cumsum(d)))
        area = 0.5 * d * (v[:-1] + v[1:])  # the blend is symmetric: its mean is one half
        return cls(start, v, np.concatenate(([0.0], np.cumsum(area))))

    def at(self, t: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        """Integral, value, first and second time derivative at times (n,) within the span."""
        k = np.clip(np.searchsorted(self.start, t, side="right") - 1, 0, len(self.start) - 2)
        T = self.start[k + 1] - self.start[k]
        T = np.where(T > 0.0, T, 1.0)
        x = np.clip((t - self.start[k]) / T, 0.0, 1.0)
        step = self.level[k + 1] - self.level[k]
        i, b, b1, b2 = blend(x)
        return (
            self.integral[k] + self.level[k] * x * T + step * T * i,
            self.level[k] + step * b,
            step * b1 / T,
            step * b2 / T**2,
        )


@dataclass(frozen=True, kw_only=True)
class Waypoint:
    """A point of a route.

    Attributes
    ----------
    llh : ndarray, shape (3,)
        Latitude, longitude [rad], ellipsoidal height [m].
    speed : float
        Speed at the point and along the way to the next one. [m/s]
    stop : float
        Time at rest here; zero passes through. [s]
    """

    llh: FloatArray
    speed: float
    stop: float = 0.0

    def __post_init__(self) -> None:
        object.__setattr__(self, "llh", as_vector3(self.llh, "Waypoint.llh"))
        if not (self.speed > 0.0 and self.stop >= 0.0):
            raise InputError(
                f"a way-point needs a positive speed and stop >= 0, got {self.speed} m/s and {self.stop} s"
            )


@dataclass(frozen=True, slots=True)
class WaypointMotion:
    """Driving or flying along a smooth route; the body's x axis always points along the path.

    Build it with :meth:`through`.
    """

    duration: float
    length: float
    _path: Any = field(repr=False)
    _origin: FloatArray = field(repr=False)
    _speed: Ramps = field(repr=False)
    _roll: Any = field(repr=False)

    @classmethod
    def through(cls, points: Sequence[Waypoint], *, acceleration: float = 1.5, bank: float = 0.0) -> WaypointMotion:
        """Route through way-points.

        Parameters
        ----------
        points : sequence of Waypoint
            At least two, at different places, not at a pole.
        acceleration : float
            Largest acceleration and braking. [m/s^2]
        bank : float
            Share of the coordinated bank angle the body takes in turns: 0 for a car, 1 for an aircraft.

        Raises
        ------
        InputError
            If a leg is too short for the speeds at its ends, or points coincide.

        Notes
        -----
        The path is a cubic spline through the points, re-fitted by a quintic over its own arc length: four times
        continuously differentiable, and run through at the speeds asked for to 1e-4.
        """
        from scipy.interpolate import CubicSpline, make_interp_spline

        if len(points) < 2:
            raise InputError(f"a route needs at least two way-points, got {len(points)}")
        llh = np.array([p.llh for p in points])
        llh[:, 1] = np.unwrap(llh[:, 1])
        origin = llh[0].copy()
        R_N, R_E = earth.radii_of_curvature(origin[0])
        scale = np.array([R_N + origin[2], (R_E + origin[2]) * np.cos(origin[0]), 1.0])
        local = (llh - origin) * scale
        chord = np.linalg.norm(np.diff(local, axis=0), axis=1)
        if np.any(chord < 0.1):
            i = int(np.argmin(chord))
            raise InputError(
                f"way-points {i} and {i + 1} are {chord[i]:.3f} m apart; to pause, use stop at one of them"
            )
        u = np.concatenate(([0.0], np.cumsum(chord)))
        curve: Any = CubicSpline(u, local, bc_type="natural") if len(u) > 2 else make_interp_spline(u, local, k=1)
        dense = np.unique(np.concatenate((np.linspace(0.0, u[-1], max(200, int(u[-1] / 2.0)) + 1), u)))
        s_dense = _arc_length(curve, dense, origin, scale)
        s_points = np.interp(u, dense, s_dense)
        even = np.linspace(0.0, s_dense[-1], max(60, int(s_dense[-1] / 4.0)) + 1)
        path = make_interp_spline(even, curve(np.interp(even, s_dense, dense)) / scale, k=5)
        durations, levels = _speed_profile(points, np.diff(s_points), acceleration)
        speed = Ramps.through(durations, levels)
        roll = None
        motion = cls(float(speed.start[-1]), float(s_dense[-1]), path, origin, speed, None)
        if bank:
            t = np.linspace(0.0, motion.duration, max(12, int(motion.duration / 0.5)) + 1)
            _, v, _, _ = speed.at(t)
            turn = motion._along(t)[4][:, 2]
            roll = make_interp_spline(t, bank * np.arctan(v * turn / 9.81), k=5)
        return cls(motion.duration, motion.length, path, origin, speed, roll)

    def _along(self, t: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray, FloatArray]:
        """Geodetic position with two derivatives, and yaw and pitch of the tangent with their rates."""
        s, v, a, _ = self._speed.at(t)
        s = np.minimum(s, self.length)
        p, p1, p2 = self._path(s) + self._origin, self._path(s, 1), self._path(s, 2)
        tangent = geodetic_state(t, p, p1, p2, np.zeros_like(p), np.zeros_like(p))
        C = frames.C_en(p)
        d = np.einsum("nji,nj->ni", C, tangent.v_eb_e)  # dr/ds north, east, down
        dd = np.einsum("nji,nj->ni", C, tangent.a_eb_e) - np.cross(earth.transport_rate_ned(p[:, 0], p[:, 2], d), d)
        h2 = d[:, 0] ** 2 + d[:, 1] ** 2
        h = np.sqrt(h2)
        yaw, pitch = np.unwrap(np.arctan2(d[:, 1], d[:, 0])), np.arctan2(-d[:, 2], h)
        yaw_s = (d[:, 0] * dd[:, 1] - d[:, 1] * dd[:, 0]) / h2
        h_s = (d[:, 0] * dd[:, 0] + d[:, 1] * dd[:, 1]) / h
        pitch_s = (-dd[:, 2] * h + d[:, 2] * h_s) / (h2 + d[:, 2] ** 2)
        zero = np.zeros_like(yaw)
        return (
            p,
            p1 * v[:, None],
            p2 * v[:, None] ** 2 + p1 * a[:, None],
            np.stack((zero, pitch, yaw), axis=-1),
            np.stack((zero, pitch_s * v, yaw_s * v), axis=-1),
        )

    def state(self, t: FloatArray) -> MotionState:
        """See :class:`~schuler.simulation.motion.Motion`."""
        check_span(t, self.duration)
        llh, rate, accel, rpy, rpy_rate = self._along(t)
        if self._roll is not None:
            rpy[:, 0], rpy_rate[:, 0] = self._roll(t), self._roll(t, 1)
        return geodetic_state(t, llh, rate, accel, rpy, rpy_rate)


def _arc_length(curve: Any, u: FloatArray, origin: FloatArray, scale: FloatArray) -> FloatArray:
    """Length along a curve given in local metres, measured on the ellipsoid; Gauss-Legendre between nodes."""
    x, w = np.polynomial.legendre.leggauss(4)
    at = u[:-1, None] + 0.5 * np.diff(u)[:, None] * (1.0 + x)
    p, d = curve(at.ravel()) / scale + origin, curve(at.ravel(), 1) / scale
    R_N, R_E = earth.radii_of_curvature(p[:, 0])
    v = np.stack(((R_N + p[:, 2]) * d[:, 0], (R_E + p[:, 2]) * np.cos(p[:, 0]) * d[:, 1], d[:, 2]), axis=-1)
    speed = np.linalg.norm(v, axis=1).reshape(at.shape)
    return np.concatenate(([0.0], np.cumsum(0.5 * np.diff(u) * (speed @ w))))


def _speed_profile(points: Sequence[Waypoint], legs: FloatArray, acceleration: float) -> tuple[FloatArray, FloatArray]:
    """Durations and speed levels that cover the legs exactly, stops included."""
    durations: list[float] = []
    levels: list[float] = [0.0 if points[0].stop > 0.0 else points[0].speed]
    last = len(points) - 1
    for i, leg in enumerate(legs):
        if points[i].stop > 0.0:
            durations.append(points[i].stop)
            levels.append(0.0)
        v0 = levels[-1]
        v1 = 0.0 if points[i + 1].stop > 0.0 else points[i + 1].speed if i + 1 < last else points[last].speed
        cruise = points[i].speed

        def change(a: float, b: float) -> tuple[float, float]:
            T = _STEEPEST * abs(b - a) / acceleration
            return T, 0.5 * T * (a + b)

        (T0, d0), (T1, d1) = change(v0, cruise), change(cruise, v1)
        if d0 + d1 > leg:  # too short to reach the cruising speed: lower it until the two changes fit
            low, high = min(v0, v1), cruise
            for _ in range(60):
                cruise = 0.5 * (low + high)
                (T0, d0), (T1, d1) = change(v0, cruise), change(cruise, v1)
                low, high = (cruise, high) if d0 + d1 <= leg else (low, cruise)
            if d0 + d1 > leg * (1.0 + 1e-9):
                raise InputError(
                    f"the leg from way-point {i} to {i + 1} is {leg:.1f} m long, too short to change from {v0:.1f} to "
                    f"{v1:.1f} m/s with {acceleration:.1f} m/s^2; lower the speeds or allow more acceleration"
                )
        if cruise <= 0.0:
            raise InputError(f"way-points {i} and {i + 1} are too close for two stops")
        durations += [T0, (leg - d0 - d1) / cruise, T1]
        levels += [cruise, cruise, v1]
    if points[last].stop > 0.0:
        durations.append(points[last].stop)
        levels.append(0.0)
    d, v = np.array(durations), np.array(levels)
    keep = d > 1e-9
    return d[keep], np.concatenate((v[:1], v[1:][keep]))


@dataclass(frozen=True, kw_only=True)
class Manoeuvre:
    """One command: within its duration go over to a speed, turn, and climb.

    Attributes
    ----------
    duration : float
        [s]
    speed : float, optional
        Horizontal speed at its end; unchanged if left out. [m/s]
    turn : float
        Change of heading, positive to the right. [rad]
    climb : float, optional
        Rate of climb at its end; unchanged if left out. [m/s]
    """

    duration: float
    speed: float | None = None
    turn: float = 0.0
    climb: float | None = None

    def __post_init__(self) -> None:
        if not self.duration > 0.0 or (self.speed is not None and self.speed < 0.0):
            raise InputError(
                f"a manoeuvre needs a positive duration and speed >= 0, got {self.duration} s, {self.speed}"
            )


@dataclass(frozen=True, slots=True)
class ManoeuvreMotion:
    """Motion by commands, one after the other. Build it with :meth:`of`."""

    duration: float
    _position: Any = field(repr=False)
    _origin: FloatArray = field(repr=False)
    _speed: Ramps = field(repr=False)
    _turn: Ramps = field(repr=False)
    _climb: Ramps = field(repr=False)
    _bank: float = field(repr=False)

    @classmethod
    def of(
        cls,
        commands: Sequence[Manoeuvre],
        llh: ArrayLike,
        *,
        heading: float = 0.0,
        speed: float = 0.0,
        bank: float = 1.0,
    ) -> ManoeuvreMotion:
        """Motion from a start by commands.

        Parameters
        ----------
        commands : sequence of Manoeuvre
        llh : array_like, shape (3,)
            Start: latitude, longitude [rad], ellipsoidal height [m].
        heading : float
            Initial heading. [rad]
        speed : float
            Initial horizontal speed. [m/s]
        bank : float
            Share of the coordinated bank angle: 1 for an aircraft, 0 for a car.

        Notes
        -----
        Velocity is closed form; position is its integral over the ellipsoid (collocation), held as a quintic spline
        whose derivatives then are the velocity and acceleration used.
        """
        from scipy.interpolate import make_interp_spline

        if not commands:
            raise InputError("expected at least one manoeuvre")
        llh = as_vector3(llh, "llh")
        durations = [c.duration for c in commands]
        speeds, climbs, headings = [speed], [0.0], [heading]
        for c in commands:
            speeds.append(speeds[-1] if c.speed is None else c.speed)
            climbs.append(climbs[-1] if c.climb is None else c.climb)
            headings.append(headings[-1] + c.turn)
        v, w, psi = (Ramps.through(durations, level) for level in (speeds, climbs, headings))
        total = float(v.start[-1])

        knots = np.linspace(0.0, total, max(12, int(total / 0.1)) + 1)
        step = float(knots[1])
        nodes, inner, weights = _collocation(5)
        t = (knots[:-1, None] + step * nodes).ravel()
        vh, yaw, h = v.at(t)[1], psi.at(t)[1], llh[2] + w.at(t)[0]
        north, east = vh * np.cos(yaw), vh * np.sin(yaw)
        lat = np.full_like(t, llh[0])
        for _ in range(12):  # each pass shrinks the error by the distance over the Earth's radius
            R_N, R_E = earth.radii_of_curvature(lat)
            rates = np.stack((north / (R_N + h), east / ((R_E + h) * np.cos(lat)))).reshape(2, -1, len(nodes))
            ends = np.concatenate((np.zeros((2, 1)), np.cumsum(step * rates @ weights, axis=1)), axis=1)
            before, (dlat, _) = lat, (ends[:, :-1, None] + step * rates @ inner.T).reshape(2, -1)
            lat = llh[0] + dlat
            if np.max(np.abs(lat - before)) < 1e-15:
                break
        offset = np.column_stack((ends.T, w.at(knots)[0]))
        return cls(total, make_interp_spline(knots, offset, k=5), llh, v, psi, w, bank)

    def state(self, t: FloatArray) -> MotionState:
        """See :class:`~schuler.simulation.motion.Motion`."""
        check_span(t, self.duration)
        _, v, v1, _ = self._speed.at(t)
        _, psi, psi1, psi2 = self._turn.at(t)
        _, w, w1, _ = self._climb.at(t)
        flat = np.maximum(v * v + w * w, 1e-12)
        pitch, pitch1 = np.arctan2(w, np.maximum(v, 1e-6)), (w1 * v - w * v1) / flat
        lateral, lateral1 = v * psi1 / 9.81, (v1 * psi1 + v * psi2) / 9.81
        roll, roll1 = self._bank * np.arctan(lateral), self._bank * lateral1 / (1.0 + lateral**2)
        return geodetic_state(
            t,
            self._position(t) + self._origin,
            self._position(t, 1),
            self._position(t, 2),
            np.stack((roll, pitch, psi), axis=-1),
            np.stack((roll1, pitch1, psi1), axis=-1),
        )


def _collocation(n: int) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Gauss-Legendre nodes in 0..1, the integrals of their polynomials up to each of them, and up to 1."""
    x, w = np.polynomial.legendre.leggauss(n)
    nodes, powers = 0.5 * (x + 1.0), np.arange(n)
    inverse = np.linalg.inv(np.vander(nodes, increasing=True))
    inner = (nodes[:, None] ** (powers + 1) / (powers + 1)) @ inverse
    return nodes, inner, 0.5 * w


def polynomial_motion(
    position_knots: ArrayLike,
    position_step: float,
    angle_knots: ArrayLike,
    angle_step: float,
    origin_llh: ArrayLike,
) -> LocalMotion:
    """Motion along polynomials through knots: Stefanisko's ``gendata``.

    Parameters
    ----------
    position_knots : array_like, shape (k, 3)
        North, east, down at equal steps about the origin. [m]
    position_step : float
        [s]
    angle_knots : array_like, shape (j, 3)
        Roll, pitch, yaw at equal steps. [rad]
    angle_step : float
        [s]
    origin_llh : array_like, shape (3,)
        Latitude, longitude [rad], height [m].

    Returns
    -------
    LocalMotion
        As long as the shorter of the two; many knots make the polynomials swing between them (Runge), then use
        :class:`~schuler.simulation.splines.SplineMotion`. The source's world does not turn: pass
        ``earth_rotation=False`` to the functions that take the motion.

    References
    ----------
    Stefanisko (2015), section 4.2. Its figure 4.5, where adding rotation moves the end point, comes from reading the
    accelerations as body components; here position does not depend on attitude.
    """
    A, B = as_floats(position_knots, "position_knots", (None, 3)), as_floats(angle_knots, "angle_knots", (None, 3))
    if len(A) < 2 or len(B) < 2:
        raise InputError(f"expected at least two knots of each, got {len(A)} positions and {len(B)} angles")
    P, Q = _polynomials(A), _polynomials(B)

    def path(t: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        x = t / position_step
        return (
            np.stack([p(x) for p in P], axis=-1),
            np.stack([p.deriv()(x) for p in P], axis=-1) / position_step,
            np.stack([p.deriv(2)(x) for p in P], axis=-1) / position_step**2,
        )

    def angles(t: FloatArray) -> tuple[FloatArray, FloatArray]:
        x = t / angle_step
        return np.stack([p(x) for p in Q], axis=-1), np.stack([p.deriv()(x) for p in Q], axis=-1) / angle_step

    duration = min((len(A) - 1) * position_step, (len(B) - 1) * angle_step)
    return LocalMotion(as_vector3(origin_llh, "origin_llh"), path, euler_attitude(angles), duration)


def _polynomials(knots: FloatArray) -> list[Any]:
    x = np.arange(len(knots), dtype=np.float64)
    return [np.polynomial.Polynomial.fit(x, column, len(knots) - 1) for column in knots.T]
