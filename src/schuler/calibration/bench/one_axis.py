"""One axis in a log: its bias and scale factor, from poses up and down or from the rates of a table."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from schuler.arrays import FloatArray
from schuler.calibration.bench.linear_fit import linear_fit
from schuler.calibration.bench.poses import Poses
from schuler.calibration.bench.turns import Turns
from schuler.calibration.result.result import CalibrationResult
from schuler.earth import WGS84
from schuler.exceptions import InputError
from schuler.recording.series import ImuSeries
from schuler.units import DEG, G0

#: How far the axis may be off the vertical or off that of the table: what nobody measured. [rad]
OFF_AXIS = 1.0 * DEG
#: Share of gravity that an axis reads at least where it is taken to be upright.
UPRIGHT = 0.8
#: Probability of a larger scatter by noise alone, below which the scatter counts instead.
CHANCE = 0.05


def only_axis(logs: Sequence[ImuSeries]) -> str | None:
    """The one axis that all logs have readings of, such as ``"gx"``; zeros hold the place of those that are missing."""
    axes = {
        letter + "xyz"[k] for imu in logs for letter, x in (("a", imu.accel), ("g", imu.gyro))
        for k in range(3) if x[:, k].any()
    }  # fmt: skip
    return axes.pop() if len(axes) == 1 else None


def in_all_axes(imu: ImuSeries, axis: str) -> ImuSeries:
    """The log with the readings of its one axis in place of the two that are missing, for the search for rests."""
    k = "xyz".index(axis[1])
    if axis[0] == "a":
        return replace(imu, accel=np.repeat(imu.accel[:, k : k + 1], 3, axis=1))
    return replace(imu, gyro=np.repeat(imu.gyro[:, k : k + 1], 3, axis=1))


def calibrate_axis_upright(poses: Poses, axis: str, *, gravity: float = G0) -> CalibrationResult:
    """Bias and scale factor of one accelerometer that stood upright and upside down.

    Parameters
    ----------
    poses : Poses
        The axis up in one or more of them, down in one or more; where it is neither, a pose is left out.
    axis : str
        ``"ax"``, ``"ay"`` or ``"az"``.
    gravity : float
        Local gravity. [m/s^2]

    Returns
    -------
    CalibrationResult
        ``b_a`` and the diagonal element of ``M_a``. Its sigma has the scatter between the poses and a tilt of
        :data:`OFF_AXIS`.

    Raises
    ------
    InputError
        If the axis was not up and down.
    """
    k = "xyz".index(axis[1])
    reading, sigma = poses.f[:, k], poses.sigma_f[:, k]
    upright = np.abs(reading) > UPRIGHT * gravity
    up, down = int((reading[upright] > 0.0).sum()), int((reading[upright] < 0.0).sum())
    if not (up and down):
        raise InputError(
            f"{axis}: expected rests with the axis up and rests with it down, got {up} and {down} ({len(poses)} rests "
            "in all); one axis says nothing of poses in between, whose tilt it does not know"
        )
    left = f"; {len(poses) - up - down} rests in between were left out" if up + down < len(poses) else ""
    how = f"{up} poses up, {down} down, taken for upright: a tilt of 1 deg (150 ppm) is in the sigmas{left}."
    return _line(
        axis, reading[upright], np.copysign(gravity, reading[upright]), sigma[upright], method="sixposition", how=how,
        unknown=gravity * _lost(),
    )  # fmt: skip


def calibrate_axis_turned(turns: Turns, axis: str, *, rate_sigma: float = 0.0) -> CalibrationResult:
    """Bias and scale factor of one gyroscope that was turned both ways at known rates about its own axis.

    Parameters
    ----------
    turns : Turns
    axis : str
        ``"gx"``, ``"gy"`` or ``"gz"``.
    rate_sigma : float
        1-sigma error of the rates of the table, relative.

    Returns
    -------
    CalibrationResult
        ``b_g`` and the diagonal element of ``M_g``. Where the Earth's rate points is not known to one axis: it is in
        the bias and in its sigma.

    Raises
    ------
    InputError
        If it was turned at one rate only.
    """
    k = "xyz".index(axis[1])
    rate = turns.rate[:, k]
    if len(np.unique(rate)) < 2:
        raise InputError(
            f"{axis}: expected turns both ways or at two rates, to tell bias from scale factor, got {len(rate)} at "
            f"{rate[0] / DEG:.4g} deg/s"
        )
    how = (
        f"{len(rate)} turns about the axis itself: 1 deg off it (150 ppm) is in the sigmas, and so is the Earth's "
        "rate, 15 deg/h at most, which stays in the bias."
    )
    return _line(
        axis, turns.omega[:, k], rate, turns.sigma_omega[:, k], method="ratetable", how=how,
        unknown=WGS84.omega_ie / np.sqrt(3.0), relative=rate_sigma,
    )  # fmt: skip


def _lost() -> float:
    """Share of an input that an axis misses which is :data:`OFF_AXIS` off."""
    return 1.0 - float(np.cos(OFF_AXIS))


def _line(
    axis: str,
    reading: FloatArray,
    reference: FloatArray,
    sigma: FloatArray,
    *,
    method: str,
    how: str,
    unknown: float,
    relative: float = 0.0,
) -> CalibrationResult:
    """``reading - reference = b + M reference``; ``unknown`` and ``relative``: 1 sigma of what readings share."""
    names = (f"b_{axis[0]}_{axis[1]}", f"M_{axis[0]}_{axis[1]}{axis[1]}")
    A = np.column_stack((np.ones(len(reading)), reference))
    white = np.maximum(sigma, 1e-9 * np.abs(reading).max())  # a log without noise has a weight too
    fit = linear_fit(A, reading - reference, white**2, names)
    scatter = 1.0
    if fit.freedom > 0 and fit.chi2 > fit.limit(CHANCE):
        scatter = fit.variance_of_unit_weight * (fit.freedom / (fit.freedom - 2.0) if fit.freedom > 2 else 9.0)
    verdicts = [
        f"One axis, {axis}: its bias and scale factor, from {how}",
        "Its misalignment, cross-coupling and the other axes are not in the log; apply leaves them as they are.",
    ]
    if fit.freedom == 0:
        verdicts.append("Two readings make a straight line, which nothing checks: repeat them.")
    return CalibrationResult(
        method, names, fit.values, fit.covariance * scatter + np.diag([unknown**2, _lost() ** 2 + relative**2]), "full",
        status="ok" if fit.freedom > 0 else "warning", verdicts=tuple(verdicts), condition=fit.condition,
        variance_of_unit_weight=fit.variance_of_unit_weight, freedom=fit.freedom,
    )  # fmt: skip
