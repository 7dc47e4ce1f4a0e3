"""What a schedule asks of a platform: angles, rates, accelerations, wear; and whether that is within limits."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from schuler.arrays import FloatArray
from schuler.exceptions import InputError
from schuler.plotting.notebook import Abridged
from schuler.rotary.profiles import AngleProfile
from schuler.rotary.schedule import Schedule


@dataclass(frozen=True, kw_only=True)
class PlatformLimits:
    """What a platform can do; infinite is no limit.

    Attributes
    ----------
    rate : float
        Largest rate of any axis. [rad/s]
    acceleration : float
        [rad/s^2]
    angle : float
        Largest absolute angle: infinite with a slip ring, a number of turns with a cable. [rad]
    axes : int
        Number of axes.
    """

    rate: float = np.inf
    acceleration: float = np.inf
    angle: float = np.inf
    axes: int = 3

    def __post_init__(self) -> None:
        if not (self.rate > 0.0 and self.acceleration > 0.0 and self.angle > 0.0 and self.axes >= 1):
            raise InputError(f"a platform's limits are positive and it has an axis, got {self}")


@dataclass(frozen=True, repr=False)
class PlatformUsage(Abridged):
    """Motion of a platform over a time, by axis.

    Attributes
    ----------
    travel : ndarray, shape (m,)
        Sum of all turning, either way. [rad]
    net_turn : ndarray, shape (m,)
        Angle at the end minus that at the start. [rad]
    largest_angle, largest_rate, largest_acceleration : ndarray, shape (m,)
        Absolute values; the acceleration is infinite where a rate jumps. [rad], [rad/s], [rad/s^2]
    reversals : ndarray of int, shape (m,)
        Changes of the sense of rotation, rests between them left out.
    moving : ndarray, shape (m,)
        Time at a rate other than zero. [s]
    """

    travel: FloatArray
    net_turn: FloatArray
    largest_angle: FloatArray
    largest_rate: FloatArray
    largest_acceleration: FloatArray
    reversals: FloatArray
    moving: FloatArray


def usage(schedule: Schedule, duration: float) -> PlatformUsage:
    """What a schedule asks of its platform, exactly, from its pieces.

    Parameters
    ----------
    schedule : Schedule
    duration : float
        From zero. [s]

    Notes
    -----
    A rate that jumps at zero, a start in full motion, counts as a jump.
    """
    if not (np.isfinite(duration) and duration > 0.0):
        raise InputError(f"duration: expected a positive number of seconds, got {duration!r}")
    columns = np.array([_of_axis(p, duration) for p in schedule.profiles]).T
    return PlatformUsage(*columns)


def _of_axis(profile: AngleProfile, duration: float) -> tuple[float, ...]:
    t0 = np.concatenate(([0.0], profile.breakpoints(0.0, duration)))
    h = np.diff(t0, append=duration)
    # the middle of a piece has its acceleration without doubt about which side of a breakpoint is meant
    angle_m, rate_m, acceleration = profile.at(t0 + 0.5 * h)
    rate_0, rate_1 = rate_m - 0.5 * h * acceleration, rate_m + 0.5 * h * acceleration
    angle_0 = angle_m - 0.5 * h * (rate_m - 0.25 * h * acceleration)
    angle_1 = angle_0 + h * rate_m
    fastest = float(np.max(np.maximum(np.abs(rate_0), np.abs(rate_1))))
    tiny = 1e-9 * max(fastest, 1e-12)
    # a piece may turn round within itself: its vertex. A rate that ends at zero but for rounding does not
    turning = (rate_0 * rate_1 < 0.0) & (np.minimum(np.abs(rate_0), np.abs(rate_1)) > tiny)
    x = np.where(turning, -rate_0 / np.where(turning, acceleration, 1.0), 0.0)
    vertex = angle_0 + x * (rate_0 + 0.5 * acceleration * x)
    travel = np.where(turning, np.abs(vertex - angle_0) + np.abs(angle_1 - vertex), np.abs(angle_1 - angle_0))
    jump = np.abs(rate_0 - np.concatenate(([0.0], rate_1[:-1])))
    sense = np.stack((np.where(turning, np.sign(rate_0), 0.0), np.sign(np.where(turning, rate_1, rate_m)))).T.ravel()
    sense = sense[(np.abs(np.repeat(np.maximum(np.abs(rate_0), np.abs(rate_1)), 2)) > tiny) & (sense != 0.0)]
    moving = np.maximum(np.abs(rate_0), np.abs(rate_1)) > tiny
    return (
        float(np.sum(travel)),
        float(angle_1[-1] - angle_0[0]),
        float(np.max(np.abs(np.concatenate((angle_0, angle_1, vertex))))),
        fastest,
        np.inf if np.any(jump > tiny) else float(np.max(np.abs(acceleration))),
        float(np.count_nonzero(np.diff(sense))),
        float(np.sum(h[moving])),
    )


def within(schedule: Schedule, limits: PlatformLimits, duration: float) -> list[str]:
    """Sentences about every limit that a schedule breaks; an empty list if it keeps them all.

    Parameters
    ----------
    schedule : Schedule
    limits : PlatformLimits
    duration : float
        [s]
    """
    used, broken = usage(schedule, duration), []
    slack = 1.0 + 1e-9
    if len(schedule.axes) > limits.axes:
        broken.append(f"needs {len(schedule.axes)} axes, the platform has {limits.axes}")
    for value, limit, what, unit in (
        (used.largest_rate, limits.rate, "rate", "rad/s"),
        (used.largest_acceleration, limits.acceleration, "acceleration", "rad/s^2"),
        (used.largest_angle, limits.angle, "angle", "rad"),
    ):
        broken += [
            f"axis {k}: {what} of {value[k]:.4g} {unit}, allowed are {limit:.4g}"
            for k in np.flatnonzero(value > limit * slack)
        ]
    return broken
