"""Motion through waypoints: a smooth way over the ground with speeds, the vehicle along it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from schuler import earth, frames
from schuler.arrays import FloatArray, as_vector3
from schuler.exceptions import InputError
from schuler.plotting.notebook import Abridged
from schuler.simulation.motion import MotionState, check_span, geodetic_state
from schuler.simulation.profiles import STEEPEST, Ramps


@dataclass(frozen=True, kw_only=True, repr=False)
class Waypoint(Abridged):
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


@dataclass(frozen=True, slots=True, repr=False)
class WaypointMotion(Abridged):
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
            T = STEEPEST * abs(b - a) / acceleration
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
