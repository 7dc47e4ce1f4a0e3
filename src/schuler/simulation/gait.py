"""A walking foot in closed form: strides with exact rests between them, for tests of zero-velocity navigation."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from numpy.polynomial import Polynomial

from schuler import frames, rotation
from schuler.arrays import ArrayLike, BoolArray, FloatArray, IntArray, as_floats, as_vector3
from schuler.exceptions import InputError
from schuler.plotting.notebook import Abridged
from schuler.simulation.motion import MotionState, check_span

Curve: TypeAlias = tuple[FloatArray, FloatArray, FloatArray]

_U = Polynomial([0.0, 1.0])
#: From 0 to 1 with three derivatives zero at both ends.
_RISE = 35.0 * _U**4 - 84.0 * _U**5 + 70.0 * _U**6 - 20.0 * _U**7
#: Up to 1 in the middle and back, three derivatives zero at both ends.
_BUMP = 256.0 * _U**4 * (1.0 - _U) ** 4
#: Toe down, then toe up, about 1 in size: what the foot does in a swing.
_TIP = -1024.0 * _U**4 * (1.0 - _U) ** 4 * (1.0 - 2.0 * _U)


@dataclass(frozen=True, repr=False)
class WalkMotion(Abridged):
    """Motion of an IMU on a walking foot. Build it with :func:`walk`.

    Attributes
    ----------
    origin_llh : ndarray, shape (3,)
        Where the foot first stands: latitude, longitude [rad], height [m].
    lift, contact : ndarray, shape (k,)
        Begin and end of each swing. [s]
    foothold_n : ndarray, shape (k + 1, 3)
        Where the resting point of the shoe stands, north, east, down of the origin. [m]
    heading : ndarray, shape (k + 1,)
        Heading of the foot at each foothold. [rad]
    clearance : float
        Height of a swing. [m]
    tip : float
        Pitch of a swing, about. [rad]
    roll_over : float
        Pitch of the foot during a rest, about its resting point. [rad]
    pivot_b : ndarray, shape (3,)
        From the IMU to the resting point, body axes. [m]
    duration : float
        [s]
    """

    origin_llh: FloatArray
    lift: FloatArray
    contact: FloatArray
    foothold_n: FloatArray
    heading: FloatArray
    clearance: float
    tip: float
    roll_over: float
    pivot_b: FloatArray
    duration: float

    def resting(self, t: ArrayLike) -> BoolArray:
        """Whether the shoe's resting point rests at times of shape (n,). [s]"""
        return self._swing(as_floats(t, "t", (None,)))[0] < 0

    def state(self, t: FloatArray) -> MotionState:
        """See :class:`~schuler.simulation.motion.Motion`."""
        check_span(t, self.duration)
        swing, standing, u, length = self._swing(t)
        moving = swing >= 0
        k = np.where(moving, swing, 0)
        step = self.foothold_n[k + 1] - self.foothold_n[k]
        turn = self.heading[k + 1] - self.heading[k]
        s, ds, dds = _scaled(_RISE, u, length, moving)
        up, dup, ddup = _scaled(_BUMP, u, length, moving)
        tip, dtip, ddtip = _scaled(_TIP, u, length, moving)
        roll, droll, ddroll = _scaled(_BUMP, u, length, ~moving & (standing > 0) & (standing < len(self.lift)))
        lifted = np.array([0.0, 0.0, -self.clearance])
        start = np.where(moving[:, None], self.foothold_n[k], self.foothold_n[standing])
        r = start + s[:, None] * step + up[:, None] * lifted
        v, a = ds[:, None] * step + dup[:, None] * lifted, dds[:, None] * step + ddup[:, None] * lifted
        yaw = np.where(moving, self.heading[k], self.heading[standing]) + s * turn
        dyaw, ddyaw = ds * turn, dds * turn
        pitch = self.tip * tip - self.roll_over * roll
        dpitch, ddpitch = self.tip * dtip - self.roll_over * droll, self.tip * ddtip - self.roll_over * ddroll
        zero = np.zeros_like(t)
        C_nb = rotation.dcm_from_rpy(np.stack((zero, pitch, yaw), axis=-1))
        sp, cp = np.sin(pitch), np.cos(pitch)
        omega = np.stack((-dyaw * sp, dpitch, dyaw * cp), axis=-1)
        alpha = np.stack((-ddyaw * sp - dyaw * dpitch * cp, ddpitch, ddyaw * cp - dyaw * dpitch * sp), axis=-1)
        # the IMU: the resting point less its lever arm
        arm = np.broadcast_to(self.pivot_b, omega.shape)
        whirl = np.cross(alpha, arm) + np.cross(omega, np.cross(omega, arm))
        r = r - np.einsum("nij,nj->ni", C_nb, arm)
        v = v - np.einsum("nij,nj->ni", C_nb, np.cross(omega, arm))
        a = a - np.einsum("nij,nj->ni", C_nb, whirl)
        C = frames.C_en(self.origin_llh)
        return MotionState(t, frames.ecef_from_ned(r, self.origin_llh), v @ C.T, a @ C.T, C @ C_nb, omega)

    def _swing(self, t: FloatArray) -> tuple[IntArray, IntArray, FloatArray, FloatArray]:
        """Number of the swing or -1, of the foothold, place in the current phase from 0 to 1, its length [s]."""
        standing = np.searchsorted(self.contact, t, side="right")
        before = np.searchsorted(self.lift, t, side="right") - 1
        swing: IntArray = np.where(before >= standing, before, -1)
        begins = np.concatenate(([0.0], self.contact))
        ends = np.concatenate((self.lift, [self.duration]))
        inner = np.minimum(before, len(self.lift) - 1)
        begin = np.where(swing >= 0, self.lift[inner], begins[standing])
        end = np.where(swing >= 0, self.contact[inner], ends[standing])
        return swing, standing, np.clip((t - begin) / (end - begin), 0.0, 1.0), end - begin


def walk(
    origin_llh: ArrayLike,
    *,
    strides: int = 20,
    length: float = 1.3,
    swing: float = 0.45,
    rest: float = 0.55,
    turn: ArrayLike = 0.0,
    heading: float = 0.0,
    climb: float = 0.0,
    clearance: float = 0.12,
    tip: float = 0.7,
    roll_over: float = 0.0,
    pivot_b: ArrayLike = (0.0, 0.0, 0.0),
    stand: float = 5.0,
) -> WalkMotion:
    """A walk of equal strides.

    Parameters
    ----------
    origin_llh : array_like, shape (3,)
        Latitude, longitude [rad], height [m].
    strides : int
    length : float
        Length of a stride. [m]
    swing, rest : float
        Time in the air and on the ground of each stride. [s]
    turn : float or array_like, shape (strides,)
        Change of heading in each stride. [rad]
    heading : float
        At the start. [rad]
    climb : float
        Height gained in a stride. [m]
    clearance, tip, roll_over, pivot_b
        See :class:`WalkMotion`.
    stand : float
        Time at rest before the first stride and after the last. [s]

    Returns
    -------
    WalkMotion
        Three times continuously differentiable; at rest the resting point stands exactly still.

    Raises
    ------
    InputError
        If a time or the number of strides is not positive.
    """
    if strides < 1 or not all(x > 0.0 for x in (swing, rest, stand)):
        raise InputError(f"expected at least one stride and positive times, got {strides}, {swing}, {rest}, {stand}")
    turns = np.broadcast_to(np.asarray(turn, dtype=np.float64), (strides,))
    headings = heading + np.concatenate(([0.0], np.cumsum(turns)))
    course = 0.5 * (headings[:-1] + headings[1:])
    steps = np.stack((length * np.cos(course), length * np.sin(course), np.full(strides, -climb)), axis=1)
    lift: FloatArray = stand + np.arange(strides, dtype=np.float64) * (swing + rest)
    return WalkMotion(
        as_vector3(origin_llh, "origin_llh"), lift, lift + swing,
        np.concatenate((np.zeros((1, 3)), np.cumsum(steps, axis=0))), headings, clearance, tip, roll_over,
        as_vector3(pivot_b, "pivot_b"), float(lift[-1] + swing + stand),
    )  # fmt: skip


def _scaled(curve: Polynomial, u: FloatArray, length: FloatArray, where: BoolArray) -> Curve:
    """A curve and two time derivatives over phases of the given lengths [s], zero elsewhere. Shapes (n,)."""
    values = (curve(u), curve.deriv()(u) / length, curve.deriv(2)(u) / length**2)
    x, dx, ddx = (np.where(where, value, 0.0) for value in values)
    return x, dx, ddx
