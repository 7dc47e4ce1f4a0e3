"""Motion that a GNSS log tells: turn rate, acceleration along and across the course, at evenly spaced times.

No attitude is needed: a vehicle goes where it points, so that the course's rate is the turn rate about the vertical,
and specific force is the change of speed (and the slope) forward and speed times turn rate to the right. What is
compared with them is the mean of IMU samples over the same second, in whatever units and axes: linear regression finds
the rest.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from schuler import frames
from schuler.arrays import BoolArray, FloatArray
from schuler.recording.io.checks import largest
from schuler.recording.series import SENSORS, GnssSeries, ImuSeries

HALF_S = 0.5  # half of the interval that accelerations are means of
MOST = 4000  # epochs looked at
_PAUSE = 5.0  # intervals between samples that are a pause


@dataclass(frozen=True)
class Motion:
    """Turns and accelerations by GNSS.

    Attributes
    ----------
    t : ndarray, shape (n,)
        [s]
    speed : ndarray, shape (n,)
        Horizontal. [m/s]
    forward, right : ndarray, shape (n,)
        Specific force along the course, slope included, and to the right of it. [m/s^2]
    turn : ndarray, shape (n,)
        Rate of the course, positive clockwise. [rad/s]
    moving : ndarray of bool, shape (n,)
        Fast enough for a course.
    half : float
        Half of the interval these are means of. [s]
    slope : ndarray, shape (n,)
        Sine of the angle at which the path climbs.
    """

    t: FloatArray
    speed: FloatArray
    forward: FloatArray
    right: FloatArray
    turn: FloatArray
    moving: BoolArray
    slope: FloatArray
    half: float = HALF_S

    @property
    def enough(self) -> bool:
        """Whether there is motion to compare with: 15 s of it, and turns or changes of speed above noise."""
        if self.moving.sum() < 20:
            return False
        step = float(np.median(np.diff(self.t)))
        busy = self.turn[self.moving].std() > 0.02 or self.forward[self.moving].std() > 0.15
        return bool(self.moving.sum() * step > 15.0 and busy)


def position_velocity(gnss: GnssSeries) -> tuple[FloatArray, FloatArray]:
    """Mean velocity between epochs from positions alone, and the times in the middle. Shapes (n - 1,), (n - 1, 3).

    Of fixes that were held or filled in to a higher rate the first of each counts.
    """
    new = np.concatenate(([True], np.any(np.diff(gnss.llh[:, :2], axis=0) != 0.0, axis=1)))
    if 10 <= np.count_nonzero(new) < 0.85 * len(gnss):
        gnss = gnss.where(new)
    r = frames.ned_from_ecef(frames.ecef_from_llh(gnss.llh), gnss.llh[0])
    # north and down at the first epoch are tilted a little elsewhere: angles of 1e-5 rad for a drive
    dt = np.diff(gnss.t)
    return 0.5 * (gnss.t[1:] + gnss.t[:-1]), np.diff(r, axis=0) / dt[:, None]


def motion_of(t: FloatArray, v_n: FloatArray, gravity: float, half: float = HALF_S) -> Motion | None:
    """Motion of velocities north, east, down; None if there are too few.

    Parameters
    ----------
    t : ndarray, shape (n,)
        [s]
    v_n : ndarray, shape (n, 3)
        [m/s]
    gravity : float
        [m/s^2]
    half : float
        Half of the interval accelerations are taken over. [s]
    """
    if len(t) < 20:
        return None
    interval = float(np.median(np.diff(t)))
    half = max(half, interval)
    step = max(min(0.25, interval), (t[-1] - t[0] - 2.0 * half) / MOST)
    grid = np.arange(t[0] + half, t[-1] - half, max(step, 0.05))
    if len(grid) < 20:
        return None
    # no epoch within reach: an outage
    k = np.clip(np.searchsorted(t, grid), 1, len(t) - 1)
    covered = np.ones(len(grid), dtype=bool)
    for side in (-half, 0.0, half):
        k = np.clip(np.searchsorted(t, grid + side), 1, len(t) - 1)
        covered &= t[k] - t[k - 1] < max(2.5 * interval, 1.5)

    def at(x: FloatArray) -> FloatArray:
        return np.stack([np.interp(x, t, v_n[:, i]) for i in range(3)], axis=1)

    a = (at(grid + half) - at(grid - half)) / (2.0 * half)
    # the mean over the same interval, so that noise and steps of all are alike
    v = (at(grid - half) + 2.0 * at(grid) + at(grid + half)) / 4.0
    speed = np.hypot(v[:, 0], v[:, 1])
    top = float(np.quantile(speed, 0.95))
    least = float(np.clip(0.25 * top, 0.35, 3.0))
    safe = np.maximum(speed, 0.1)
    right = (v[:, 0] * a[:, 1] - v[:, 1] * a[:, 0]) / safe
    slope = -np.clip(v[:, 2] / safe, -0.3, 0.3)
    forward = (v[:, 0] * a[:, 0] + v[:, 1] * a[:, 1]) / safe + gravity * slope
    turn = right / safe
    moving = covered & (speed > least) & (np.abs(turn) < 2.0) & (np.abs(forward) < 15.0) & (np.abs(right) < 15.0)
    return Motion(grid, speed, forward, right, turn, moving, slope, half)


class WindowMeans:
    """Means of IMU samples over windows about given times, from one running integral."""

    def __init__(self, imu: ImuSeries) -> None:
        self.t = imu.t
        self.origin = np.empty(6)
        self.sums = np.zeros((len(self.t), 6))
        mid = self.sums[1:]  # all in place: of a day at 200 Hz each copy is 830 MB
        for k, sensor in enumerate(SENSORS):
            own = slice(3 * k, 3 * k + 3)
            x, out = imu.mean_rates(sensor), mid[:, own]
            self.origin[own] = x.mean(axis=0)
            if imu.kind == "rate":
                np.add(x[1:], x[:-1], out=out)
                out *= 0.5
            else:  # an increment is the mean over the interval that ends at its stamp
                out[:] = x[1:]
            del x
        dt = np.diff(self.t)
        mid -= self.origin
        mid *= dt[:, None]
        np.cumsum(mid, axis=0, out=mid)
        # number of steps before a sample that are a pause of the log
        self.pauses = np.zeros(len(self.t), dtype=np.int64)
        np.cumsum(dt > _PAUSE * imu.interval, out=self.pauses[1:])
        del dt
        mean = (self.t[-1] - self.t[0]) / (len(self.t) - 1)
        off = mean * np.arange(len(self.t))
        off += self.t[0]
        off -= self.t
        # stamps near even ones are found by counting instead of searching
        self.step = float(mean) if largest(off) < 0.4 * mean else 0.0

    def at(self, t: FloatArray, half: float) -> tuple[FloatArray, BoolArray]:
        """Accelerometer and gyro means, shape (n, 6), and whether the log covers each window."""
        a, b = t - half, t + half
        inside = (a >= self.t[0]) & (b <= self.t[-1])
        y = self._integral(b) - self._integral(a)
        return self.origin + y / (2.0 * half), inside

    def without_pause(self, t: FloatArray, half: float) -> BoolArray:
        """Whether there is no pause of the log within each window. Shape (n,)."""
        lo = np.searchsorted(self.t, t - half, side="right") - 1
        hi = np.searchsorted(self.t, t + half, side="left")
        last = len(self.t) - 1
        return np.asarray(self.pauses[np.clip(hi, 0, last)] == self.pauses[np.clip(lo, 0, last)])

    def _integral(self, x: FloatArray) -> FloatArray:
        last = len(self.t) - 2
        if self.step:
            k = np.clip(((x - self.t[0]) / self.step).astype(np.int64), 0, last)
            k = np.clip(k - (self.t[k] > x), 0, last)
            k = np.clip(k + (self.t[k + 1] <= x), 0, last)
        else:
            k = np.clip(np.searchsorted(self.t, x, side="right") - 1, 0, last)
        s = (x - self.t[k]) / (self.t[k + 1] - self.t[k])
        value: FloatArray = self.sums[k] + np.clip(s, 0.0, 1.0)[:, None] * (self.sums[k + 1] - self.sums[k])
        return value
