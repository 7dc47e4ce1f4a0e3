"""Turns of the gyroscopes about the vertical beside those of the course of the fixes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from schuler import earth
from schuler.arrays import FloatArray
from schuler.diagnosis.motion import WindowMeans, motion_of, position_velocity
from schuler.recording.series import GnssSeries, ImuSeries

#: Norm of the mean specific force that is gravity's, so that it tells down, in g.
UPRIGHT = (0.8, 1.2)
_REVERSED = (-1.33, -0.75)  # course over gyro where a sign is reversed
_SURE = 5.0  # sigmas of a gain that tells a sign, ...
_SIGMA = 0.15  # ... and its 1-sigma at most
_NAMED = 0.9  # cosine from which an axis of the IMU is the vertical


@dataclass(frozen=True)
class CourseTurns:
    """How the course of the fixes turns where the gyroscopes turn about the vertical.

    Attributes
    ----------
    gain : ndarray, shape (2,)
        Turn rate of the course over that of the gyroscopes, first and second half of the motion: 1 for a vehicle, near
        0 for a body that points anywhere.
    sigma : ndarray, shape (2,)
        1-sigma of each.
    down : ndarray, shape (3,)
        Unit vector down by the mean specific force, axes of the IMU.
    """

    gain: FloatArray
    sigma: FloatArray
    down: FloatArray

    @property
    def reversed(self) -> bool:
        """Whether either half of the motion shows beyond doubt that the two turn against each other."""
        low, high = _REVERSED
        clear = (np.abs(self.gain) > _SURE * self.sigma) & (self.sigma < _SIGMA)
        return bool(np.all((self.gain > low) & (self.gain < high) & clear))

    @property
    def axis(self) -> str:
        """Axis of the IMU that is the vertical, ``"x"``, ``"y"`` or ``"z"``; empty where none is."""
        k = int(np.argmax(np.abs(self.down)))
        return "xyz"[k] if abs(self.down[k]) > _NAMED else ""


def course_turns(imu: ImuSeries, gnss: GnssSeries) -> CourseTurns | None:
    """Regression of the course's turn rate on that of the gyroscopes about the vertical; None where too little moves.

    Parameters
    ----------
    imu : ImuSeries
    gnss : GnssSeries
        On the same clock. Without velocities the course is that of the positions.

    Notes
    -----
    Down is against the mean specific force of the moving part, whatever the IMU's mounting; a constant bias drops out.
    Gyroscopes are far better than a course, so that the course is regressed on them: its noise widens the gain's sigma
    and does not shrink the gain. One independent sample a window counts; noise of positions alternates from one
    difference to the next, and scatters a gain by half of its sigma. Clocks a second apart smear the gain.
    """
    t, v_n = gnss.t, gnss.v_n
    if v_n is None:
        if len(gnss) < 2:
            return None
        t, v_n = position_velocity(gnss)
    measured = np.isfinite(v_n[:, :2]).all(axis=1)
    t, v_n = t[measured], np.nan_to_num(v_n[measured])
    gravity = float(earth.gravity_somigliana(float(np.median(gnss.llh[:, 0])), float(np.median(gnss.llh[:, 2]))))
    motion = motion_of(t, v_n, gravity)
    if motion is None:
        return None
    y, inside = WindowMeans(imu).at(motion.t, motion.half)
    use = motion.moving & inside
    if np.count_nonzero(use) < 40:
        return None
    y, turn = y[use], motion.turn[use]
    f = y[:, :3].mean(axis=0)
    size = float(np.linalg.norm(f))
    if not UPRIGHT[0] < size / gravity < UPRIGHT[1]:
        return None
    rate = y[:, 3:] @ (-f / size)
    windows = float(np.median(np.diff(motion.t))) / (2.0 * motion.half)  # independent ones a sample
    gain, sigma = np.zeros(2), np.zeros(2)
    for k, (x, z) in enumerate(zip(np.array_split(rate, 2), np.array_split(turn, 2), strict=True)):
        x, z = x - x.mean(), z - z.mean()
        power = float(x @ x)
        if power <= 0.0:
            return None
        gain[k] = float(x @ z) / power
        left = z - gain[k] * x
        sigma[k] = np.sqrt(float(left @ left) / power / max(len(x) * windows, 4.0))
    return CourseTurns(gain, sigma, -f / size)
