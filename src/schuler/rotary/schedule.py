"""Schedule of a rotating IMU: its attitude in the body as a function of time, ``C_bs(t)``, with exact derivatives."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from schuler.arrays import ArrayLike, FloatArray, as_floats, readonly
from schuler.exceptions import InputError
from schuler.plotting.notebook import Abridged
from schuler.rotary import gimbals
from schuler.rotary.profiles import AngleProfile


@dataclass(frozen=True, eq=False, repr=False)
class Schedule(Abridged):
    """How a platform of one or several axes turns an IMU.

    Attributes
    ----------
    axes : ndarray, shape (m, 3)
        Unit vectors of the axes at zero angles, outermost first, body axes.
    profiles : tuple of AngleProfile
        One for each axis.
    C_mount : ndarray, shape (3, 3)
        IMU axes to the innermost frame of the platform; identity unless the IMU is mounted askew.
    name : str
        For tables and figures.
    """

    axes: FloatArray
    profiles: tuple[AngleProfile, ...]
    C_mount: FloatArray = field(default_factory=lambda: np.eye(3))
    name: str = ""

    def __post_init__(self) -> None:
        axes = as_floats(self.axes, "Schedule.axes", (None, 3))
        if len(axes) == 0 or len(axes) != len(self.profiles):
            raise InputError(f"expected a profile for each axis, got {len(axes)} axes and {len(self.profiles)}")
        axes = np.stack([gimbals.axis_vector(u) for u in axes])
        C = as_floats(self.C_mount, "Schedule.C_mount", (3, 3))
        if not np.allclose(C @ C.T, np.eye(3), atol=1e-9) or np.linalg.det(C) < 0.0:
            raise InputError("Schedule.C_mount: expected a rotation matrix (orthonormal, determinant +1)")
        object.__setattr__(self, "axes", readonly(axes))
        object.__setattr__(self, "profiles", tuple(self.profiles))
        object.__setattr__(self, "C_mount", readonly(C.copy()))

    def angles(self, t: ArrayLike) -> FloatArray:
        """Angles at times (n,). Shape (n, m). [rad]"""
        return self._all(t)[0]

    def rates(self, t: ArrayLike) -> FloatArray:
        """Their time derivatives; after a jump, where there is one. Shape (n, m). [rad/s]"""
        return self._all(t)[1]

    def accelerations(self, t: ArrayLike) -> FloatArray:
        """Second time derivatives. Shape (n, m). [rad/s^2]"""
        return self._all(t)[2]

    def C_bs(self, t: ArrayLike) -> FloatArray:
        """Attitude of the IMU in the body at times (n,): ``v_b = C_bs @ v_s``. Shape (n, 3, 3)."""
        return gimbals.C_bs(self.axes, self.angles(t), self.C_mount)

    def omega_bs_s(self, t: ArrayLike) -> FloatArray:
        """Angular rate of the IMU relative to the body, IMU axes. Shape (n, 3). [rad/s]"""
        angles, rates, _ = self._all(t)
        return gimbals.omega_bs_s(self.axes, angles, rates, self.C_mount)

    def alpha_bs_s(self, t: ArrayLike) -> FloatArray:
        """Time derivative of :meth:`omega_bs_s` in IMU axes. Shape (n, 3). [rad/s^2]"""
        return gimbals.alpha_bs_s(self.axes, *self._all(t), self.C_mount)

    def breakpoints(self, start: float, stop: float) -> FloatArray:
        """Times within ``(start, stop)`` at which a rate or an acceleration jumps. Shape (b,). [s]"""
        times = np.unique(np.concatenate([p.breakpoints(start, stop) for p in self.profiles]))
        return times[np.concatenate(([True], np.diff(times) > 1e-9))] if len(times) else times

    def delayed(self, delay: float) -> Schedule:
        """The same after standing still for ``delay`` seconds, as for the mean of a gyroscope before the start."""
        return replace(self, profiles=tuple(p.delayed(delay) for p in self.profiles))

    def mounted(self, C_mount: ArrayLike) -> Schedule:
        """The same with an IMU whose axes are turned in the innermost frame by ``C_mount`` (3, 3)."""
        return replace(self, C_mount=as_floats(C_mount, "C_mount", (3, 3)))

    def lever_arm_s(self, t: ArrayLike, l_b: ArrayLike) -> tuple[FloatArray, FloatArray]:
        """A lever arm fixed in the body, seen in the turning axes of the IMU.

        Parameters
        ----------
        t : array_like, shape (n,)
            [s]
        l_b : array_like, shape (3,)
            From the IMU (the point where the axes meet) to the antenna, body axes. [m]

        Returns
        -------
        l_s, l_s_rate : ndarray, shape (n, 3)
            ``C_sb l_b`` [m] and its time derivative ``-omega_bs_s x l_s`` [m/s].
        """
        l_s: FloatArray = np.einsum("nji,j->ni", self.C_bs(t), as_floats(l_b, "l_b", (3,)))
        return l_s, -np.cross(self.omega_bs_s(t), l_s)

    def _all(self, t: ArrayLike) -> tuple[FloatArray, FloatArray, FloatArray]:
        t = as_floats(t, "t", (None,))
        angle, rate, acceleration = (
            np.stack(part, axis=-1) for part in zip(*(p.at(t) for p in self.profiles), strict=True)
        )
        return angle, rate, acceleration


def stacked(*schedules: Schedule, name: str = "") -> Schedule:
    """Platforms that carry one another, the outermost first; all turn at the same time.

    Raises
    ------
    InputError
        If an outer one has a mounting of its own.
    """
    if not schedules:
        raise InputError("expected at least one schedule")
    if any(not np.array_equal(s.C_mount, np.eye(3)) for s in schedules[:-1]):
        raise InputError("only the innermost schedule can have a mounting; turn its axes instead")
    return Schedule(
        np.concatenate([s.axes for s in schedules]),
        tuple(p for s in schedules for p in s.profiles),
        schedules[-1].C_mount,
        name or " in ".join(s.name for s in reversed(schedules) if s.name),
    )
