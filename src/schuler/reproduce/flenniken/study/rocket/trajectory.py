"""Flenniken's trajectory I: a rocket that burns, turns over and falls, on a flat Earth that stands still.

Axes here and in all of :mod:`schuler.reproduce.flenniken.study.rocket` are the thesis's: north, up, east, and for the
body forward, up,
right (those of :mod:`schuler.sensors.triads`). Pitch is positive nose up, a turn about the body's y axis goes left.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from schuler.arrays import ArrayLike, FloatArray, as_floats
from schuler.exceptions import InputError
from schuler.units import DEG, G0

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@dataclass(frozen=True)
class RocketProfile:
    """Flight profile of the rocket; the defaults are the reconstruction T1-R.

    Attributes
    ----------
    pitch : float
        At ignition and until the turn, heading north. [rad]
    final_pitch : float
        After the turn, held to the ground. [rad]
    thrust : float
        Along the body's x axis, constant while it burns; specific force. [m/s^2]
    burn_time : float
        [s]
    turn_start, turn_time : float
        The pitch rate is constant in between. [s]
    gravity : float
        [m/s^2]

    Notes
    -----
    The source's numbers contradict each other: -10 deg/s for 15 s are 150 deg and not the 143 from 55 to -88 deg, a
    peak of 24 km "in 40 seconds" leaves 125 s to fall, and so on (section 7.2). T1-R keeps 8 g, 55 and -88 deg
    and 15 s; it burns 12.5 s so that range and both burnout velocities come near. The 40 are then kilometres.

    References
    ----------
    Flenniken (2005), section 7.2.
    """

    pitch: float = 55.0 * DEG
    final_pitch: float = -88.0 * DEG
    thrust: float = 8.0 * G0
    burn_time: float = 12.5
    turn_start: float = 12.5
    turn_time: float = 15.0
    gravity: float = G0

    def __post_init__(self) -> None:
        for name in ("thrust", "burn_time", "turn_time", "gravity"):
            if not getattr(self, name) > 0.0:
                raise InputError(f"{name}: expected a positive number, got {getattr(self, name)!r}")
        if not self.turn_start >= 0.0:
            raise InputError(f"turn_start: expected a time after ignition, got {self.turn_start!r}")
        if not self.thrust * np.sin(self.pitch) > self.gravity:
            raise InputError(
                f"the rocket does not leave the ground: {self.thrust:g} m/s^2 at {self.pitch / DEG:g} deg against "
                f"{self.gravity:g} m/s^2; raise thrust or pitch"
            )

    @property
    def pitch_rate(self) -> float:
        """During the turn. [rad/s]"""
        return (self.final_pitch - self.pitch) / self.turn_time

    @cached_property
    def events(self) -> tuple[float, ...]:
        """Ignition and the times at which thrust or pitch rate change. [s]"""
        return tuple(sorted({0.0, self.burn_time, self.turn_start, self.turn_start + self.turn_time}))

    @cached_property
    def impact_time(self) -> float:
        """When it is at launch height again. [s]"""
        _, _, _, v, r = (x[0] for x in self.at(self.events[-1]))
        if r[1] <= 0.0:
            raise InputError(
                f"the rocket is {-r[1]:.0f} m below ground when its turn ends at {self.events[-1]:g} s; turn earlier"
            )
        return float(self.events[-1] + (v[1] + np.sqrt(v[1] ** 2 + 2.0 * self.gravity * r[1])) / self.gravity)

    def at(self, t: ArrayLike) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray, FloatArray]:
        """True motion in closed form, also beyond impact.

        Parameters
        ----------
        t : array_like, shape (n,)
            Since ignition; at an event what holds after it. [s]

        Returns
        -------
        pitch, rate, thrust : ndarray, shape (n,)
            [rad], [rad/s], [m/s^2]
        v, r : ndarray, shape (n, 3)
            North, up, east. [m/s], [m]
        """
        t = np.atleast_1d(as_floats(t, "t"))
        if len(t) and t.min() < 0.0:
            raise InputError(f"t: expected times since ignition, got {t.min():g} s")
        pitch, rate, thrust = np.empty(len(t)), np.empty(len(t)), np.empty(len(t))
        v, r = np.zeros((len(t), 3)), np.zeros((len(t), 3))
        v0, r0, g = np.zeros(2), np.zeros(2), np.array([0.0, -self.gravity])
        for start, stop in zip(self.events, (*self.events[1:], np.inf), strict=True):
            turned = np.clip((start - self.turn_start) / self.turn_time, 0.0, 1.0)
            theta = self.pitch + turned * (self.final_pitch - self.pitch)
            w = self.pitch_rate if self.turn_start <= start < self.turn_start + self.turn_time else 0.0
            f = self.thrust if start < self.burn_time else 0.0
            k = (t >= start) & (t < stop)
            tau = t[k] - start
            pitch[k], rate[k], thrust[k] = theta + w * tau, w, f
            once, twice = _direction_integrals(theta, w, tau)
            v[k, :2] = v0 + f * once + g * tau[:, None]
            r[k, :2] = r0 + v0 * tau[:, None] + f * twice + 0.5 * g * tau[:, None] ** 2
            if np.isfinite(stop):
                tau = np.array([stop - start])
                once, twice = _direction_integrals(theta, w, tau)
                r0 = r0 + v0 * tau + f * twice[0] + 0.5 * g * tau**2
                v0 = v0 + f * once[0] + g * tau
        return pitch, rate, thrust, v, r


@dataclass(frozen=True)
class RocketTrajectory:
    """Truth of a flight on a grid of times with the events and the impact on it.

    Attributes
    ----------
    profile : RocketProfile
    t : ndarray, shape (k + 1,)
        [s]
    pitch : ndarray, shape (k + 1,)
        [rad]
    v, r : ndarray, shape (k + 1, 3)
        North, up, east. [m/s], [m]
    middle : ndarray, shape (k,)
        Middles of the steps, at which the sensors are sampled. [s]
    pitch_middle : ndarray, shape (k,)
        [rad]
    rate : ndarray, shape (k, 3)
        Roll, yaw, pitch rate in the middle of each step: about forward, up, right. [rad/s]
    specific_force : ndarray, shape (k, 3)
        What accelerometers sense, forward, up, right; zero in free fall. [m/s^2]
    acceleration : ndarray, shape (k, 3)
        Kinematic acceleration in body axes, which section 7.2 takes for the reading (E24). [m/s^2]
    """

    profile: RocketProfile
    t: FloatArray
    pitch: FloatArray
    v: FloatArray
    r: FloatArray
    middle: FloatArray
    pitch_middle: FloatArray
    rate: FloatArray
    specific_force: FloatArray
    acceleration: FloatArray

    @property
    def dt(self) -> FloatArray:
        """Lengths of the steps; the ones before events and impact may be shorter. Shape (k,). [s]"""
        return np.diff(self.t)

    @property
    def ground(self) -> FloatArray:
        """From a position error at impact to where the computed path meets the ground: downrange, crossrange.

        Shape (2, 3): an error upwards shifts the point along the velocity.
        """
        v = self.v[-1]
        return np.array([[1.0, v[0] / abs(v[1]), 0.0], [0.0, v[2] / abs(v[1]), 1.0]])

    def figures(self) -> dict[str, float]:
        """Burnout, apex and impact: velocities [m/s], lengths [m], times [s]."""
        v = self.profile.at([self.profile.burn_time])[3]
        up = self.v[:, 1]
        k = int(np.flatnonzero(up > 0.0)[-1])
        apex_time = float(self.t[k] + self.dt[k] * up[k] / (up[k] - up[k + 1]))
        apex = self.profile.at([apex_time])[4][0]
        return {
            "burnout_north": float(v[0, 0]), "burnout_up": float(v[0, 1]), "apex_time": apex_time,
            "apex_height": float(apex[1]), "apex_range": float(apex[0]), "impact_time": float(self.t[-1]),
            "impact_range": float(self.r[-1, 0]), "impact_up": float(self.v[-1, 1]),
            "impact_speed": float(np.linalg.norm(self.v[-1])),
        }  # fmt: skip

    def summary(self) -> str:
        """Burnout, apex and impact in words."""
        f = self.figures()
        return (
            f"burnout at {self.profile.burn_time:g} s with {f['burnout_north']:.1f} m/s north and "
            f"{f['burnout_up']:.1f} m/s up; apex {f['apex_height'] / 1e3:.1f} km at {f['apex_time']:.1f} s, "
            f"{f['apex_range'] / 1e3:.1f} km downrange; impact at {f['impact_time']:.2f} s, "
            f"{f['impact_range'] / 1e3:.2f} km, {f['impact_speed']:.0f} m/s"
        )

    def to_dict(self) -> dict[str, Any]:
        """Plain data for JSON."""
        names = ("t", "pitch", "v", "r", "middle", "rate", "specific_force", "acceleration")
        return {**self.figures(), **{name: getattr(self, name).tolist() for name in names}}

    def plot(self) -> Figure:
        """Body accelerations, rates and pitch, velocity, and height over range (matplotlib)."""
        from schuler.plotting.drawing import draw
        from schuler.reproduce.flenniken.study.rocket.figures import trajectory_figure

        return draw(trajectory_figure(self))


def rocket_trajectory(profile: RocketProfile | None = None, *, rate_hz: float = 100.0) -> RocketTrajectory:
    """Truth of a flight from ignition to impact.

    Parameters
    ----------
    profile : RocketProfile, optional
        T1-R by default.
    rate_hz : float
        Rate of the sensors.

    Returns
    -------
    RocketTrajectory

    References
    ----------
    Flenniken (2005), section 7.2, figures 7.1 and 7.2.
    """
    profile = profile or RocketProfile()
    if not rate_hz > 0.0:
        raise InputError(f"rate_hz: expected a positive number, got {rate_hz!r}")
    end = profile.impact_time
    grid = np.arange(round(np.ceil(end * rate_hz))) / rate_hz
    t = np.unique(np.concatenate((grid[grid < end], profile.events, [end])))
    t = t[np.append(np.diff(t) > 1e-9, True)]  # an event beside a sample, not on it, by rounding
    pitch, _, _, v, r = profile.at(t)
    middle = 0.5 * (t[1:] + t[:-1])
    theta, rate, thrust, _, _ = profile.at(middle)
    zero, c, s = np.zeros(len(middle)), np.cos(theta), np.sin(theta)
    force = np.stack((thrust, zero, zero), axis=1)
    gravity = -profile.gravity * np.stack((s, c, zero), axis=1)
    rates = np.stack((zero, zero, rate), axis=1)
    return RocketTrajectory(profile, t, pitch, v, r, middle, theta, rates, force, force + gravity)


def attitude(pitch: FloatArray) -> FloatArray:
    """Body to north-up-east axes at a pitch, heading north, no roll. Shapes (n,) to (n, 3, 3)."""
    C = np.zeros((*pitch.shape, 3, 3))
    C[..., 0, 0] = C[..., 1, 1] = np.cos(pitch)
    C[..., 1, 0] = np.sin(pitch)
    C[..., 0, 1] = -C[..., 1, 0]
    C[..., 2, 2] = 1.0
    return C


def _direction_integrals(theta: float, w: float, tau: FloatArray) -> tuple[FloatArray, FloatArray]:
    """First and second integral over tau of (cos, sin)(theta + w t). Shapes (n, 2)."""
    c, s = np.cos(theta), np.sin(theta)
    if w == 0.0:
        way = np.array([c, s])
        return way * tau[:, None], 0.5 * way * tau[:, None] ** 2
    ce, se = np.cos(theta + w * tau), np.sin(theta + w * tau)
    once = np.stack((se - s, c - ce), axis=1) / w
    twice = np.stack(((c - ce) / w - s * tau, (s - se) / w + c * tau), axis=1) / w
    return once, twice
