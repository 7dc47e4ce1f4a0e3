"""The rocket on the rotating Earth, as a motion for the simulator and the engine's covariance."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from schuler import earth, frames, rotation
from schuler.arrays import ArrayLike, FloatArray, as_vector3
from schuler.exceptions import InputError
from schuler.reproduce.flenniken.study.rocket.trajectory import RocketProfile
from schuler.simulation.motion import MotionState, check_span

_STEP = 0.5  # of the integration; halving it moves the impact by less than a micrometre [s]
_FAR = 2.0 * earth.WGS84.a  # from the center of the Earth: not to come back [m]


@dataclass(frozen=True, eq=False)
class RocketMotion:
    """A flight integrated in Earth-fixed axes; between its nodes a polynomial of fifth order.

    Attributes
    ----------
    profile : RocketProfile
    origin_llh : ndarray, shape (3,)
        Place of the launch: latitude, longitude [rad], height [m].
    heading : float
        From north to east. [rad]
    t : ndarray, shape (n + 1,)
        Nodes, the events among them. [s]
    r, v : ndarray, shape (n + 1, 3)
        Earth-fixed axes. [m], [m/s]
    a_start, a_stop : ndarray, shape (n, 3)
        Acceleration at the two ends of each piece; it jumps where thrust ends. [m/s^2]
    """

    profile: RocketProfile
    origin_llh: FloatArray
    heading: float
    t: FloatArray
    r: FloatArray
    v: FloatArray
    a_start: FloatArray
    a_stop: FloatArray

    @property
    def duration(self) -> float:
        """From ignition to impact at launch height above the ellipsoid. [s]"""
        return float(self.t[-1])

    def state(self, t: FloatArray) -> MotionState:
        """See :class:`~schuler.simulation.motion.Motion`."""
        check_span(t, self.duration)
        k = np.clip(np.searchsorted(self.t, t, side="right") - 1, 0, len(self.t) - 2)
        r, v, a = _quintic(
            (t - self.t[k])[:, None], (self.t[k + 1] - self.t[k])[:, None],
            (self.r[k], self.v[k], self.a_start[k]), (self.r[k + 1], self.v[k + 1], self.a_stop[k]),
        )  # fmt: skip
        pitch, rate, _, _, _ = self.profile.at(np.maximum(t, 0.0))
        C_eb = _attitude(self.origin_llh, pitch, self.heading)
        zero = np.zeros_like(rate)
        return MotionState(np.asarray(t), r, v, a, C_eb, np.stack((zero, rate, zero), axis=-1))


def rocket_motion(
    profile: RocketProfile | None = None, *, origin_llh: ArrayLike = (0.5, 0.0, 0.0), heading: float = 0.0
) -> RocketMotion:
    """The rocket above a rotating ellipsoid with its gravity.

    Parameters
    ----------
    profile : RocketProfile, optional
        T1-R by default; its gravity is not used. Pitch is counted in the axes of the launch, fixed to the Earth.
    origin_llh : array_like, shape (3,)
        Launch: latitude, longitude [rad], height [m].
    heading : float
        [rad]

    Returns
    -------
    RocketMotion
        After burnout nothing but gravity acts: the specific force is zero, which the flat path is not on a round
        Earth (0.1 m/s^2 would be left of it). Hence range and time are not those of the flat Earth.

    Raises
    ------
    InputError
        If the rocket does not come down within an hour.
    """
    profile = profile or RocketProfile()
    llh = as_vector3(origin_llh, "origin_llh")
    t, r, v = [0.0], [frames.ecef_from_llh(llh)], [np.zeros(3)]
    a_start: list[FloatArray] = []
    a_stop: list[FloatArray] = []
    stops = list(profile.events[1:])
    while True:
        now = t[-1]
        h = _STEP
        if stops and now + h >= stops[0] - 1e-9:
            h = stops.pop(0) - now
        push = np.zeros((3, 3))
        if now < profile.burn_time - 1e-9:
            # the thrust of a step is the one within it, at its ends too
            pitch, _, thrust, _, _ = profile.at([now + 1e-6 * h, now + 0.5 * h, now + (1.0 - 1e-6) * h])
            push = thrust[:, None] * _attitude(llh, pitch, heading)[:, :, 0]
        a, r_end, v_end = _runge_kutta(r[-1], v[-1], h, push)
        t, r, v = [*t, now + h], [*r, r_end], [*v, v_end]
        a_start, a_stop = [*a_start, a], [*a_stop, _acceleration(r_end, v_end, push[2])]
        if not stops and frames.llh_from_ecef(r_end)[2] < llh[2]:
            break
        if t[-1] > 3600.0 or np.linalg.norm(r_end) > _FAR:
            raise InputError("profile: the rocket does not come down within an hour; reduce thrust or burn time")
    last = RocketMotion(
        profile, llh, heading, np.array(t), np.array(r), np.array(v), np.array(a_start), np.array(a_stop)
    )  # fmt: skip
    low, high = t[-2], t[-1]
    for _ in range(50):
        middle = 0.5 * (low + high)
        above = frames.llh_from_ecef(last.state(np.array([middle])).r_eb_e[0])[2] > llh[2]
        low, high = (middle, high) if above else (low, middle)
    end = last.state(np.array([low]))
    nodes = np.append(last.t[:-1], low)
    r_end, v_end = np.vstack((last.r[:-1], end.r_eb_e)), np.vstack((last.v[:-1], end.v_eb_e))
    return RocketMotion(
        profile, llh, heading, nodes, r_end, v_end, last.a_start, np.vstack((last.a_stop[:-1], end.a_eb_e))
    )  # fmt: skip


def _attitude(llh: FloatArray, pitch: FloatArray, heading: float) -> FloatArray:
    rpy = np.zeros((*np.shape(pitch), 3))
    rpy[..., 1], rpy[..., 2] = pitch, heading
    return np.asarray(frames.C_en(llh) @ rotation.dcm_from_rpy(rpy))


def _acceleration(r: FloatArray, v: FloatArray, push: FloatArray) -> FloatArray:
    omega = np.array([0.0, 0.0, earth.WGS84.omega_ie])
    return np.asarray(push + earth.gravity_ecef(r) - 2.0 * np.cross(omega, v))


def _runge_kutta(r: FloatArray, v: FloatArray, h: float, push: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Acceleration at the start, position and velocity at the end of a step; ``push`` at start, middle, end."""
    a1 = _acceleration(r, v, push[0])
    v2 = v + 0.5 * h * a1
    a2 = _acceleration(r + 0.5 * h * v, v2, push[1])
    v3 = v + 0.5 * h * a2
    a3 = _acceleration(r + 0.5 * h * v2, v3, push[1])
    v4 = v + h * a3
    a4 = _acceleration(r + h * v3, v4, push[2])
    return a1, r + h / 6.0 * (v + 2.0 * v2 + 2.0 * v3 + v4), v + h / 6.0 * (a1 + 2.0 * a2 + 2.0 * a3 + a4)


def _quintic(
    tau: FloatArray,
    h: FloatArray,
    start: tuple[FloatArray, FloatArray, FloatArray],
    stop: tuple[FloatArray, FloatArray, FloatArray],
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Position, velocity, acceleration ``tau`` into a piece of length h with those three given at both ends."""
    (r0, v0, a0), (r1, v1, a1) = start, stop
    gap = r1 - (r0 + h * v0 + 0.5 * h**2 * a0)
    speed = h * (v1 - (v0 + h * a0))
    bend = h**2 * (a1 - a0)
    c3, c4, c5 = 10 * gap - 4 * speed + 0.5 * bend, -15 * gap + 7 * speed - bend, 6 * gap - 3 * speed + 0.5 * bend
    s = tau / h
    r = r0 + tau * v0 + 0.5 * tau**2 * a0 + s**3 * (c3 + s * (c4 + s * c5))
    v = v0 + tau * a0 + s**2 * (3.0 * c3 + s * (4.0 * c4 + 5.0 * s * c5)) / h
    a = a0 + s * (6.0 * c3 + s * (12.0 * c4 + 20.0 * s * c5)) / h**2
    return r, v, a
