"""Rate table: bias, response and g-sensitivity of gyroscopes from turns at known rates and poses at rest."""

from __future__ import annotations

import numpy as np

from schuler.arguments import explains_arguments
from schuler.arrays import ArrayLike
from schuler.calibration.bench.faces import Bias
from schuler.calibration.bench.poses import Poses
from schuler.calibration.bench.turn_solution import solve_turns
from schuler.calibration.bench.turns import Turns
from schuler.calibration.result.result import CalibrationResult
from schuler.exceptions import InputError
from schuler.units import DEG, G0

#: A turn further than this from every axis of the unit is of no use to the angle-rate test. [rad]
LARGEST_ANGLE = 5.0 * DEG


@explains_arguments
def calibrate_ratetable(
    turns: Turns,
    poses: Poses | None = None,
    *,
    gravity: float = G0,
    g_sensitivity: bool = True,
    latitude: float | None = None,
    headings: ArrayLike | None = None,
    axis_n: ArrayLike | None = None,
    accel: CalibrationResult | None = None,
    bias: Bias = "all faces",
    level_sigma: float | None = None,
    heading_sigma: float = 0.0,
    rate_sigma: float = 0.0,
    axis_sigma: float = 0.0,
    instability: tuple[float, float] = (0.0, 0.0),
) -> CalibrationResult:
    """Calibrate on a rate table.

    Parameters
    ----------
    turns : Turns
        Best clockwise and counter-clockwise about each axis of the unit; see
        :func:`schuler.calibration.bench.turns_in_log.rate_plateaus` for finding them in a log.
    poses : Poses, optional
        At rest on the faces of the unit, for the accelerometers and the g-sensitivity; other poses are left out.
    gravity : float
        Local gravity. [m/s^2]
    g_sensitivity : bool
        Estimate G_g; False holds it at zero.
    latitude : float, optional
        For Earth rate. [rad]
    headings : array_like, optional
        Of the poses, see :func:`schuler.calibration.bench.faces.earth_rate_on_faces`. [rad]
    axis_n : array_like, shape (n, 3), optional
        Where the axis of each turn points, north, east, down. None: vertical, up or down as the specific force says.
    accel : CalibrationResult, optional
        Calibration of the accelerometers for the specific force during the turns. None: from ``poses``, where they
        suffice, else the specific force as measured.
    bias, level_sigma
        See :func:`schuler.calibration.bench.sixposition.calibrate_sixposition`.
    heading_sigma : float
        1 sigma of the headings. [rad]
    rate_sigma : float
        1 sigma of the rate of the table, relative, in each turn. [-]
    axis_sigma : float
        1 sigma of the direction of each axis of turning in the unit. [rad]
    instability : (float, float)
        How much the biases of gyroscope [rad/s] and accelerometer [m/s^2] change from reading to reading, 1 sigma.

    Returns
    -------
    CalibrationResult
        Parameters of the accelerometers only if ``poses`` determine them. Gauge "full": body axes are those in which
        the rates of the table are given.

    Raises
    ------
    InputError
        If gravity or latitude make no sense, or the g-sensitivity is asked for of turns without specific force.

    Notes
    -----
    Weighted least squares of ``omega_meas = b + (I + M)(omega_table + omega_ie) + G f`` with mean values over each turn
    and pose. For turns both ways, equally long and without Earth rate, this is the closed form: a column of I + M is
    half the difference of the two directions over the rate, ``b + G f`` is half their sum.

    References
    ----------
    Hayal (2010), section 2.4.1.2; Titterton and Weston (2004), section 8.3.3.
    """
    return solve_turns(
        "ratetable", turns, poses, gravity=gravity, g_sensitivity=g_sensitivity, latitude=latitude, headings=headings,
        axis_n=axis_n, accel=accel, accel_wanted=False, bias=bias, level_sigma=level_sigma,
        heading_sigma=heading_sigma, sigmas={"rate_sigma": rate_sigma, "axis_sigma": axis_sigma},
        instability=instability,
    )  # fmt: skip


@explains_arguments
def calibrate_angle_rate(
    turns: Turns,
    *,
    gravity: float = G0,
    latitude: float | None = None,
    axis_n: ArrayLike | None = None,
    rate_sigma: float = 0.0,
    instability: tuple[float, float] = (0.0, 0.0),
) -> CalibrationResult:
    """Angle-rate test: each axis by itself, clockwise and counter-clockwise.

    Parameters
    ----------
    turns : Turns
        Both ways about each axis of the unit.
    gravity, latitude, axis_n, rate_sigma, instability
        See :func:`calibrate_ratetable`.

    Returns
    -------
    CalibrationResult
        ``b = (Y_cw + Y_ccw)/2``, ``S = (Y_cw - Y_ccw)/(2 K) - 1`` of each axis, K the rate of the table; Earth rate
        along the axis is taken out if the latitude is given. The bias holds for the axis as it stood: with g-sensitive
        gyroscopes it contains ``G_ii g``.

    Raises
    ------
    InputError
        If a turn is about no axis of the unit.

    References
    ----------
    Hayal (2010), eqs. (2.3) to (2.6) and section 2.4.1.2.
    """
    off = np.arccos(np.clip(np.abs(turns.axis).max(axis=1), 0.0, 1.0))
    if len(turns) and off.max() > LARGEST_ANGLE:
        k = int(off.argmax())
        raise InputError(
            f"turns: expected turns about the axes of the unit, got {turns.labels[k]}, {off[k] / DEG:.0f} deg off; use "
            "calibrate_ratetable"
        )
    return solve_turns(
        "ratetable", turns, None, gravity=gravity, g_sensitivity=False, latitude=latitude, headings=None,
        axis_n=axis_n, accel=None, accel_wanted=False, bias="all faces", level_sigma=None, heading_sigma=0.0,
        sigmas={"rate_sigma": rate_sigma}, instability=instability, own_axis_only=True,
        notes=("each axis by itself: cross-coupling and g-sensitivity were taken as zero",),
    )  # fmt: skip
