"""Free-pose calibration: an IMU put down by hand in many poses, nothing known but gravity."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any, Literal, TypeAlias

import numpy as np

from schuler.arguments import explains_arguments
from schuler.arrays import ArrayLike
from schuler.calibration.freepose.bias import bias_difference
from schuler.calibration.freepose.lost_rates import lost_rates
from schuler.calibration.freepose.rests import candidate_rests, tedaldi_rests, without_held
from schuler.calibration.freepose.solution import (
    FEWEST,
    REDUNDANCY,
    CalibratedPoses,
    HandLog,
    calibrated_poses,
    solve_part,
    solve_poses,
)
from schuler.calibration.magnetometer.calibrate import estimates_soft_iron
from schuler.calibration.result.halves import checked, halves_of, tried, without_thirds
from schuler.calibration.result.parameters import BIAS_G, MATRIX_G, SENSITIVITY
from schuler.calibration.result.result import CalibrationResult
from schuler.exceptions import InputError
from schuler.recording.series import ImuSeries
from schuler.units import G0

Bias: TypeAlias = Literal["rest", "estimate"]
Search: TypeAlias = Literal["auto", "tedaldi"]


@explains_arguments
def calibrate_freepose(
    imu: ImuSeries,
    *,
    gravity: float = G0,
    noise: tuple[ArrayLike, ArrayLike] | None = None,
    initial_rest_s: float | None = None,
    gyro_bias: Bias = "rest",
    g_sensitivity: bool | None = None,
    size_effect: bool = False,
    delay: bool = False,
    robust: bool = True,
    nominal: tuple[float, float] | None = None,
    intervals: Sequence[tuple[float, float]] | None = None,
    rests: Search = "auto",
    window_s: float = 1.0,
    min_s: float = 1.0,
    halves: bool = True,
    field_strength: float | None = None,
    soft_iron: bool | None = None,
) -> CalibrationResult:
    """Calibrate accelerometers and gyroscopes from a log of an IMU that was put down by hand in many poses.

    Parameters
    ----------
    imu : ImuSeries
        Any units, raw counts too: factors of both triads are estimated. Rates or increments.
    gravity : float
        Local gravity. [m/s^2]
    noise : (array_like, array_like), optional
        N of gyroscopes [rad/s/sqrt(Hz)] and accelerometers [m/s^2/sqrt(Hz)], shape () or (3,). None: from the log.
    initial_rest_s : float, optional
        The log begins with so many seconds at rest; they give the noise level of the detector and the gyro bias. None:
        the bias is that of all poses. [s]
    gyro_bias : {"rest", "estimate"}
        Measured at rest, or estimated from the turns. With g-sensitivity it is always estimated.
    g_sensitivity : bool, optional
        Estimate G_g too, from turns and from the rates in all poses. None: if the rates in twelve poses or more follow
        specific force beyond chance, and decisively; a verdict then says so.
    size_effect : bool
        Estimate the places of the accelerometers too, ``r_a_xy`` ..., relative to the x accelerometer.
    delay : bool
        Estimate the delay of the gyroscopes behind the accelerometers too.
    robust : bool
        Less weight for disturbed poses and turns.
    nominal : (float, float), optional
        Factors of accelerometers [m/s^2 per unit of the log] and gyroscopes [rad/s per unit]. None: 1 if the log is in
        SI by the size of gravity and of the turns, else the estimated mean factor, to four digits.
    intervals : sequence of (start, stop), optional
        The rests. None: detected, see Notes. [s]
    rests : {"auto", "tedaldi"}
        Detection of rests: see Notes, or that of the paper,
        :func:`~schuler.calibration.freepose.rests.tedaldi_rests`, which needs ``initial_rest_s``, uses accelerometers
        alone, and ``min_s`` seconds of each rest.
    window_s, min_s : float
        Window of the detector and shortest rest. [s]
    halves : bool
        Hold the claims against halves of the log, see Notes.
    field_strength : float, optional
        Strength of the local magnetic field, for the scale of a magnetometer. None: relative. [T]
    soft_iron : bool, optional
        Estimate the soft iron of a magnetometer. None: with nine poses or more.

    Returns
    -------
    CalibrationResult
        In gauge "upper": body z is the z accelerometer, body y in the plane of y and z accelerometer. ``M_g`` is full,
        in the same axes, so the misalignment of the gyroscopes to the accelerometers is in it. ``refused`` if there
        are fewer than nine poses, they lie on no ellipsoid, or too little is determined; ``warning`` if parameters are
        not determined, named in the verdicts. ``residuals`` hold ``accel`` (magnitude less gravity), ``gyro`` (angle
        between predicted and measured vertical) and, with ``size_effect`` or ``delay``, ``velocity``. With "tedaldi"
        ``extra["tried"]`` has multiple, number of rests and cost [m^2/s^4] of each threshold (infinite: no fit).

    Raises
    ------
    InputError
        If an argument is out of range or the log is shorter than ten windows.

    Notes
    -----
    Readings that no axis changes for 0.2 s were held and are a gap, unless a tenth of the log or more is so.

    Rests: variance of both triads over a moving window, relative to that at rest, below a multiple. The multiples of
    the paper, 2 to 10, are tried and the one kept whose poses determine the accelerometers best (smallest determinant
    of the covariance, scatter included). Accelerometers come first, gyroscopes in their axes second; the covariance of
    the second step carries the first.

    References
    ----------
    Tedaldi, Pretto, Menegatti (2014), A robust and easy to implement method for IMU calibration without external
    equipments, ICRA. Departures: noise weights, robust weights, covariance, analytic derivatives, any start.
    """
    check_options(
        gravity=gravity,
        gyro_bias=gyro_bias,
        nominal=nominal,
        initial_rest_s=initial_rest_s,
        intervals=intervals,
        rests=rests,
        min_s=min_s,
        window_s=window_s,
    )
    factors = None if nominal is None else (float(nominal[0]), float(nominal[1]))
    options = {
        "gravity": gravity, "noise": None if noise is None else [np.asarray(x).tolist() for x in noise],
        "initial_rest_s": initial_rest_s, "gyro_bias": gyro_bias, "g_sensitivity": g_sensitivity,
        "size_effect": size_effect, "delay": delay, "robust": robust,
        "nominal": None if factors is None else list(factors),
        "intervals": None if intervals is None else [list(map(float, x)) for x in intervals], "rests": rests,
        "window_s": window_s, "min_s": min_s,
    }  # fmt: skip
    from schuler.calibration.freepose import _kernels as kernels

    kernels.prepare_freepose()
    if rests == "tedaldi":  # to be compared with other programs, which have none
        options["g_sensitivity"] = bool(g_sensitivity)
    imu, held = without_held(imu)
    rates = imu.rates()
    lost, sentences = lost_rates(rates.t, rates.gyro)
    held += sentences
    log = HandLog(imu, rates, lost, gravity, noise, field_strength, options)

    # 1. Rests, and the accelerometers from them.
    factor_a = None if factors is None else factors[0]
    if rests == "tedaldi" and initial_rest_s is not None:
        candidates = [
            tedaldi_rests(
                rates, rates.interval, gravity, initial_rest_s, factor=factor_a, window_s=window_s, min_s=min_s
            )
        ]
    else:
        candidates = candidate_rests(rates, rates.interval, intervals, initial_rest_s, window_s, min_s)
    poses, largest = calibrated_poses(log, candidates, factor_a)
    if poses is None:
        refused = log.refused(largest, None, factors)
        return replace(refused, verdicts=refused.verdicts + held)

    # 2. All else in their axes.
    result = solve_poses(log, poses, factors, soft_iron=soft_iron)
    result = replace(result, verdicts=result.verdicts + held)
    if not halves or rests == "tedaldi" or result.status == "refused":
        return result

    # 3. Parts of the rests by themselves, from the solution of all.
    return _held_against_parts(result, log, poses)


def _held_against_parts(result: CalibrationResult, log: HandLog, poses: CalibratedPoses) -> CalibrationResult:
    """Third step: the claims held against halves of the rests, or against thirds left out where halves are too few."""
    options, n = log.options, len(poses.rests)
    by_force = SENSITIVITY[0] in result.names
    of_part = replace(log, options=options | {"initial_rest_s": None, "g_sensitivity": by_force})
    start = result.errors.M_g if np.isfinite(result.sigma[[n in MATRIX_G for n in result.names]]).all() else None

    def part(which: list[int]) -> CalibrationResult:
        return solve_part(of_part, poses, which, result.nominal, soft_iron=estimates_soft_iron(result), start=start)

    apart = {}
    if options["gyro_bias"] == "rest" and options["initial_rest_s"] is None and not by_force:
        variance = result.nominal[1] ** 2 * bias_difference(log.rates, poses.rests, np.arange(n) % 2 == 0)
        apart = {"odd and even rests": dict(zip(BIAS_G, variance.tolist(), strict=True))}
    every = list(range(n))
    causes = [
        *(["rates were lost in turns: clipped, or spikes"] if len(log.lost) else []),
        *result.extra.get("bias_causes", []),
    ]
    pairs = {
        name: tried(part, (every[a], every[b])) if n >= 2 * FEWEST else None for name, (a, b) in halves_of(n).items()
    }
    if not any(pairs.values()) and n >= FEWEST + REDUNDANCY:
        thirds = [tried(part, [[i for i in every if i % 3 != k]]) for k in range(3)]
        pairs = without_thirds(result, [of_two[0] for of_two in thirds if of_two])
    needs = f"not compared: it takes twelve rests, eighteen are good, with poses all round; there are {n}"
    return checked(result, pairs, causes=causes, needs=needs, stated=apart)


def check_options(
    *,
    gravity: float = G0,
    gyro_bias: str = "rest",
    nominal: tuple[float, float] | None = None,
    initial_rest_s: float | None = None,
    intervals: Sequence[tuple[float, float]] | None = None,
    rests: str = "auto",
    min_s: float = 1.0,
    window_s: float = 1.0,
    **_: Any,
) -> None:
    """Raise InputError for options of :func:`calibrate_freepose` that are out of range for any log."""
    if not (np.isfinite(gravity) and gravity > 0.0):
        raise InputError(f"gravity: expected a positive number of m/s^2, got {gravity}")
    if gyro_bias not in ("rest", "estimate"):
        raise InputError(f"gyro_bias: expected 'rest' or 'estimate', got {gyro_bias!r}")
    if nominal is not None and (len(nominal) != 2 or not all(np.isfinite(x) and x > 0.0 for x in nominal)):
        raise InputError(f"nominal: expected two positive factors (accelerometers, gyroscopes), got {nominal!r}")
    if initial_rest_s is not None and not initial_rest_s >= 1.0:
        raise InputError(f"initial_rest_s: expected a second or more, got {initial_rest_s}")
    if rests not in ("auto", "tedaldi"):
        raise InputError(f"rests: expected 'auto' or 'tedaldi', got {rests!r}")
    if rests == "tedaldi" and initial_rest_s is None:
        raise InputError(
            "initial_rest_s: expected the seconds at rest that the log begins with, from which rests='tedaldi' takes "
            "the noise, got none"
        )
    if rests == "tedaldi" and intervals is not None:
        raise InputError("rests: expected 'auto' with intervals, which are the rests themselves, got 'tedaldi'")
    for name, value in (("min_s", min_s), ("window_s", window_s)):
        if not (np.isfinite(value) and value > 0.0):
            raise InputError(f"{name}: expected a positive time, got {value} s")
