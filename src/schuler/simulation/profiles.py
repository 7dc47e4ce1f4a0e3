"""Motion profiles: manoeuvre commands, polynomials through knots, splines through nodes; way-points: ``waypoints``.

All of them end in smooth closed forms, so position, velocity, attitude, specific force and angular rate belong to each
other exactly. Speeds, turns and climbs change along ``6 x^5 - 15 x^4 + 10 x^3``, whose first two derivatives vanish at
both ends: acceleration and jerk are continuous.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from schuler import earth
from schuler.arrays import ArrayLike, FloatArray, as_floats, as_vector3
from schuler.exceptions import InputError
from schuler.plotting.notebook import Abridged
from schuler.simulation.motion import LocalMotion, MotionState, check_span, euler_attitude, geodetic_state

#: Largest slope of the blend.
STEEPEST = 1.875


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


@dataclass(frozen=True, slots=True, repr=False)
class ManoeuvreMotion(Abridged):
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
        :class:`~schuler.simulation.profiles.SplineMotion`. The source's world does not turn: pass
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


@dataclass(frozen=True, slots=True, repr=False)
class SplineMotion(Abridged):
    """Motion through positions and attitudes at given times, four times continuously differentiable.

    Build it with :meth:`through`.
    """

    duration: float
    _position: Any = field(repr=False)
    _angles: Any = field(repr=False)
    _origin: FloatArray = field(repr=False)

    @classmethod
    def through(cls, t: ArrayLike, llh: ArrayLike, rpy_nb: ArrayLike) -> SplineMotion:
        """Quintic splines through nodes.

        Parameters
        ----------
        t : array_like, shape (n,)
            Increasing times, the first is zero; at least six. [s]
        llh : array_like, shape (n, 3)
            Latitude, longitude [rad], ellipsoidal height [m]; not at a pole. A step of more than half a turn in
            longitude is read as crossing the antimeridian.
        rpy_nb : array_like, shape (n, 3)
            Roll, pitch, yaw [rad]; yaw steps of more than half a turn are read as going the short way round.

        Raises
        ------
        InputError
            If times do not start at zero and increase, or there are too few nodes.
        """
        from scipy.interpolate import make_interp_spline

        t = as_floats(t, "t", (None,))
        llh = as_floats(llh, "llh", (len(t), 3)).copy()
        rpy = as_floats(rpy_nb, "rpy_nb", (len(t), 3)).copy()
        if len(t) < 6 or t[0] != 0.0 or np.any(np.diff(t) <= 0.0):
            raise InputError("t: expected at least six increasing times that start at 0")
        llh[:, 1] = np.unwrap(llh[:, 1])
        rpy[:, 2] = np.unwrap(rpy[:, 2])
        # differences from the first node keep 1e-16 of a degree, not of a turn
        origin = llh[0].copy()
        return cls(float(t[-1]), make_interp_spline(t, llh - origin, k=5), make_interp_spline(t, rpy, k=5), origin)

    def state(self, t: FloatArray) -> MotionState:
        """See :class:`~schuler.simulation.motion.Motion`."""
        check_span(t, self.duration)
        return geodetic_state(
            t,
            self._position(t) + self._origin,
            self._position(t, 1),
            self._position(t, 2),
            self._angles(t),
            self._angles(t, 1),
        )
