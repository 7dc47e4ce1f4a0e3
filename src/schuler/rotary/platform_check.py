"""A platform on a recording's time axis, and whether the gyroscopes see it turn as it says."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from schuler import units
from schuler.arrays import ArrayLike, FloatArray
from schuler.exceptions import InputError
from schuler.recording.series import ImuSeries, Increments
from schuler.rotary import gimbals
from schuler.rotary.encoder import EncoderReadings, Platform

_FASTEST = 60.0  # no platform turns ten times a second [rad/s]
_TURNING = 0.2  # of the platform's largest rate: faster counts as turning


@dataclass(frozen=True)
class Clocked:
    """A platform on the recording's time axis.

    Attributes
    ----------
    platform : Platform
    zero_s : float
        Time of the recording at which the platform's clock is zero. [s]
    """

    platform: Platform
    zero_s: float

    @property
    def axes(self) -> FloatArray:
        """Unit vectors, outermost first. Shape (m, 3)."""
        return self.platform.axes

    @property
    def C_mount(self) -> FloatArray:
        """IMU axes to the innermost frame. Shape (3, 3)."""
        return self.platform.C_mount

    def angles(self, t: ArrayLike) -> FloatArray:
        """At times of the recording (n,). Shape (n, m). [rad]"""
        return self.platform.angles(np.asarray(t, dtype=np.float64) - self.zero_s)

    def rates(self, t: ArrayLike) -> FloatArray:
        """At times of the recording (n,). Shape (n, m). [rad/s]"""
        return self.platform.rates(np.asarray(t, dtype=np.float64) - self.zero_s)


def covered(imu: ImuSeries, clocked: Clocked, notes: list[str]) -> ImuSeries:
    """The part of the log that the encoder covers; all of it for a schedule.

    Parameters
    ----------
    imu : ImuSeries
    clocked : Clocked
    notes : list of str
        Gets a sentence if the log is cut.

    Raises
    ------
    InputError
        If they have no time in common.
    """
    readings = clocked.platform
    if not isinstance(readings, EncoderReadings):
        return imu
    start, stop = float(readings.t[0]) + clocked.zero_s, float(readings.t[-1]) + clocked.zero_s
    slack = imu.interval if imu.kind == "increment" else 0.0
    keep = (imu.t - slack >= start - 1e-9) & (imu.t <= stop + 1e-9)
    if np.count_nonzero(keep) < 4:
        raise InputError(
            f"the encoder's readings ({start:.3f}..{stop:.3f} s) and the IMU log ({imu.t[0]:.3f}..{imu.t[-1]:.3f} s) "
            "have no time in common: check platform_zero_s"
        )
    if keep.all():
        return imu
    notes.append(f"IMU log cut to the {stop - start:.1f} s that the encoder covers")
    return imu.between(float(imu.t[keep][0]), float(imu.t[keep][-1]))


def check_platform(increments: Increments, platform: Platform) -> None:
    """Refuse a platform whose rotation the gyroscopes do not see.

    Parameters
    ----------
    increments : Increments
        In the axes of the IMU.
    platform : Platform

    Raises
    ------
    InputError
        If, where the platform turns, the readings hold less than half or more than one and a half of its rate: a wrong
        sign, axis, unit, or clock. The vehicle's own turns hardly matter, they come with either sign. Also if it turns
        faster than any platform does, as angles seem to that jump back after a whole turn.
    """
    middle = increments.t - 0.5 * increments.dt
    own = gimbals.omega_bs_s(platform.axes, platform.angles(middle), platform.rates(middle), platform.C_mount)
    size = np.linalg.norm(own, axis=1)
    largest = float(size.max())
    turning = size > _TURNING * largest
    if largest > _FASTEST:
        k = int(np.argmax(size))
        raise InputError(
            f"the platform turns with {largest / units.DEG:.0f} deg/s at {middle[k]:.3f} s; if its angles begin anew "
            "after a whole turn, unwrap them (numpy.unwrap), and check their unit (rad)"
        )
    if largest == 0.0 or float(increments.dt[turning].sum()) < 1.0:
        return
    seen = increments.dtheta_ib_b[turning] / increments.dt[turning, None]
    share = float(np.sum(seen * own[turning]) / np.sum(own[turning] ** 2))
    if 0.5 < share < 1.5:
        return
    hint = (
        "its sign is turned: exchange the axis for its opposite"
        if -1.5 < share < -0.5
        else "check its axis, the unit of its angles (rad) and its clock (platform_zero_s)"
    )
    raise InputError(
        f"the platform turns with up to {largest / units.DEG:.3g} deg/s, but the gyroscopes see {share:+.2f} of that "
        f"about its axis: {hint}"
    )
