"""Solution of a free-pose calibration: accelerometers from the poses, gyroscopes from the turns, in their axes."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np

from schuler.arrays import ArrayLike, FloatArray, IntArray
from schuler.calibration.freepose import accel as freepose_accel
from schuler.calibration.freepose.accel import AccelFit, fit_accelerometers
from schuler.calibration.freepose.bias import RestBias, bias_at_rest, bias_in_turns
from schuler.calibration.freepose.gyro import GyroFit, fit_gyroscopes, rescaled
from schuler.calibration.freepose.motion import PLACES, MotionFit, fit_motion
from schuler.calibration.freepose.rests import Rests, pose_means
from schuler.calibration.freepose.result import freepose_result, refused_result, undetermined
from schuler.calibration.freepose.turns import Turns, nominal_scale
from schuler.calibration.magnetometer.calibrate import magnetic_means, with_magnetometer
from schuler.calibration.result.parameters import BIAS_G, MATRIX_G, SENSITIVITY
from schuler.calibration.result.result import CalibrationResult
from schuler.recording.series import ImuSeries
from schuler.standstill.variance_ratio import log_gaps

#: Fewest poses: the parameters of the accelerometers.
FEWEST = 9
#: Largest number of undetermined accelerometer parameters of a result that is not refused.
MOST_UNDETERMINED = 3
#: Fewest poses beyond nine of a result with an undetermined parameter that is not refused.
REDUNDANCY = 3
_FEWEST_TURNS = 6  # good ones left, of which others with lost rates are left out


@dataclass(frozen=True, eq=False)
class HandLog:
    """A log of an IMU that was put down by hand, and what is given about it.

    Attributes
    ----------
    imu : ImuSeries
        Without readings that were held.
    rates : ImuSeries
        The same as rates.
    lost : ndarray of int, shape (n,)
        Samples whose rates were lost.
    gravity : float
        [m/s^2]
    noise : (array_like, array_like) or None
        N of gyroscopes [rad/s/sqrt(Hz)] and accelerometers [m/s^2/sqrt(Hz)]; None: from the log.
    field_strength : float or None
        Of the local magnetic field. [T]
    options : dict
        Of :func:`~schuler.calibration.freepose.calibrate.calibrate_freepose`, as the result keeps them.
    """

    imu: ImuSeries
    rates: ImuSeries
    lost: IntArray
    gravity: float
    noise: tuple[ArrayLike, ArrayLike] | None
    field_strength: float | None
    options: dict[str, Any]

    def sigma_f(self, rests: Rests, factor: float) -> FloatArray:
        """1-sigma noise of the pose means, shape (n, 3). [m/s^2]"""
        N = factor * rests.density_a
        if self.noise is not None:
            N = np.broadcast_to(np.asarray(self.noise[1], dtype=float), (3,))
        return np.asarray(N / np.sqrt(rests.duration)[:, None])

    def refused(
        self, rests: Rests | None, accel: AccelFit | None, factors: tuple[float, float] | None
    ) -> CalibrationResult:
        """Result of a log that has no solution."""
        return refused_result(
            rests, accel, factors, self.gravity, self.rates, parameter_names(self.options), self.options
        )


class CalibratedPoses(NamedTuple):
    """Poses, the accelerometers from them, and the nominal factor of these [m/s^2 per unit of the log]."""

    rests: Rests
    accel: AccelFit
    factor: float


def calibrated_poses(
    log: HandLog, candidates: Iterable[Rests], nominal: float | None
) -> tuple[CalibratedPoses | None, Rests | None]:
    """First step: of several sets of rests the one that determines the accelerometers best.

    Returns
    -------
    CalibratedPoses or None
        That set; None if no set has enough poses on an ellipsoid.
    Rests or None
        The set of most rests.
    """
    best: CalibratedPoses | None = None
    largest: Rests | None = None
    last: CalibratedPoses | None = None
    lowest = np.inf
    p0: FloatArray | None
    for poses in candidates:
        if largest is None or len(poses) > len(largest):
            largest = poses
        if len(poses) < FEWEST:
            continue
        near = last is not None and last.accel.converged and last.accel.spread == 0.0
        if near and last is not None:  # nearly the same poses as before
            p0, factor = last.accel.p, last.factor
        else:
            factor, p0 = freepose_accel.accel_start(poses.accel, log.gravity, nominal)
        if p0 is None:
            continue
        last = _with_accelerometers(log, poses, factor, p0, near)
        score = last.accel.log_determinant
        if np.isfinite(score) and score < lowest:
            best, lowest = last, score
    return best, largest


def _with_accelerometers(
    log: HandLog, rests: Rests, factor: float, start: FloatArray, near: bool = False
) -> CalibratedPoses:
    """Poses with the accelerometers that are fitted to them from a start (9,)."""
    fit = fit_accelerometers(
        factor * rests.accel, log.sigma_f(rests, factor), log.gravity, robust=log.options["robust"], start=start,
        near=near,
    )  # fmt: skip
    return CalibratedPoses(rests, fit, factor)


def solve_part(
    log: HandLog,
    poses: CalibratedPoses,
    which: list[int],
    nominal: tuple[float, float],
    *,
    soft_iron: bool | None,
    start: FloatArray | None,
) -> CalibrationResult:
    """Solution of some of the rests by themselves, from that of all; ``start`` is their M_g, if it is determined."""
    some = pose_means(log.rates, log.rates.interval, np.ascontiguousarray(poses.rests.index[which]), poses.rests.margin)
    if len(some) < FEWEST:
        return log.refused(some, None, nominal)
    of_part = _with_accelerometers(log, some, poses.factor, poses.accel.p)
    return solve_poses(log, of_part, nominal, soft_iron=soft_iron, start=start)


def solve_poses(
    log: HandLog,
    poses: CalibratedPoses,
    factors: tuple[float, float] | None,
    *,
    soft_iron: bool | None,
    start: FloatArray | None = None,
) -> CalibrationResult:
    """All that follows the accelerometers: gyroscopes, magnetometer, result. ``start`` is M_g, if nearly known."""
    weak = undetermined(poses.accel)
    if len(weak) > MOST_UNDETERMINED or (weak and len(poses.rests) < FEWEST + REDUNDANCY):
        return log.refused(poses.rests, poses.accel, factors or (poses.factor, 1.0))
    result = _with_gyroscopes(log, poses, factors, start)
    if (magnetic := magnetic_means(log.rates, poses.rests.index)) is not None:
        labels = result.residuals["accel"].label
        result = with_magnetometer(
            result, poses.rests.accel, *magnetic, labels, field=log.field_strength, soft_iron=soft_iron
        )
    return result


def _with_gyroscopes(
    log: HandLog, poses: CalibratedPoses, factors: tuple[float, float] | None, start: FloatArray | None
) -> CalibrationResult:
    """Second step: gyroscopes in the axes of the calibrated accelerometers, and the result."""
    rests, accel, factor_a = poses
    # a small weight is a larger noise
    sigma_f = np.sqrt((log.sigma_f(rests, factor_a) ** 2 + accel.spread**2) / accel.weight[:, None])
    turns = _turns(log, poses)
    enough = 2 * len(turns.spans) >= _gyro_count(log.options) and bool(log.rates.gyro.any())
    scale = factor_g = 1.0 if factors is None else factors[1]
    if enough and start is None:
        scale = nominal_scale(turns, rests.duration @ rests.gyro / rests.duration.sum())
    if enough and factors is None:
        factor_g = scale
    if log.noise is not None:
        rests = replace(rests, density_g=np.broadcast_to(np.asarray(log.noise[0], dtype=float), (3,)) / factor_g)
    bias = bias_at_rest(log.rates, rests, turns.f, log.options["initial_rest_s"], log.options["g_sensitivity"])
    options = log.options | {"g_sensitivity": bias.by_force, "g_sensitivity_asked": log.options["g_sensitivity"]}
    gyro: GyroFit | None = None
    if enough:
        M = np.eye(3) * (factor_g / scale - 1.0) if start is None else start
        gyro = _gyroscopes(turns, rests, accel, sigma_f, factor_g, bias, options, M, near=start is not None)
        if factors is None and scale != 1.0:
            gain = np.cbrt(np.linalg.det(np.eye(3) + gyro.M))
            rounded = float(f"{scale / gain:.4g}")
            gyro, factor_g = rescaled(gyro, rounded / scale), rounded
    motion: MotionFit | None = None
    if gyro is not None and (options["size_effect"] or options["delay"]):
        N_a = factor_a * rests.density_a if log.noise is None else np.asarray(log.noise[1], dtype=float)
        motion = fit_motion(
            turns, factor_g, gyro, log.gravity, (_rms(factor_g * rests.density_g), _rms(N_a)),
            _rms(sigma_f) / log.gravity, size_effect=options["size_effect"], delay=options["delay"],
            robust=options["robust"],
        )  # fmt: skip
    result = freepose_result(
        log.imu, rests, accel, gyro, motion, turns, (factor_a, factor_g), log.gravity, sigma_f, bias,
        parameter_names(options), options,
    )  # fmt: skip
    return result if log.rates.gyro.any() else _accelerometers_alone(result)


def _gyroscopes(
    turns: Turns,
    rests: Rests,
    accel: AccelFit,
    sigma_f: FloatArray,
    factor: float,
    bias: RestBias,
    options: dict[str, Any],
    M: FloatArray,
    *,
    near: bool,
) -> GyroFit:
    """Gyroscopes from turns, with the bias at rest in units of the log times ``factor``, and its scatter."""
    to_compare = options["rests"] == "tedaldi"  # with programs that weigh all turns alike
    of_all_rests = options["initial_rest_s"] is None and not bias.by_force and not to_compare
    return fit_gyroscopes(
        turns, rests, accel, sigma_f, factor, factor * bias.value, factor * bias.sigma,
        estimate_bias=options["gyro_bias"] == "estimate", g_sensitivity=bias.by_force, robust=options["robust"],
        M=M, near=near, rest_covariance=factor**2 * bias.scatter.rests,
        # that of a turn is the mean of its neighbours
        wander=0.0 if to_compare else np.sqrt(0.5) * factor * _rms(bias.scatter.sigma),
        turn_bias=bias_in_turns(bias.scatter, bias.white, turns.pair).scaled(factor) if of_all_rests else None,
    )  # fmt: skip


def _turns(log: HandLog, poses: CalibratedPoses) -> Turns:
    """The log between the poses; turns across a gap of the log are left out, and with lost rates if enough remain."""
    rests, accel, factor = poses
    rates, lost = log.rates, log.lost
    B = np.linalg.inv(accel.R)
    f = (factor * rests.accel - accel.p[:3]) @ B.T
    spans = np.stack((rests.index[:-1, 1] - 1, rests.index[1:, 0]), axis=1)
    complete = np.ones(len(spans), dtype=bool)
    for gap in log_gaps(rates.t, rates.interval):
        complete &= ~((spans[:, 0] <= gap) & (gap < spans[:, 1]))
    spoiled = np.searchsorted(lost, spans[:, 1]) > np.searchsorted(lost, spans[:, 0])
    good = complete & ~spoiled
    if 2 * good.sum() >= complete.sum() and good.sum() >= _FEWEST_TURNS:
        complete = good
    pair = np.stack((np.arange(len(spans)), np.arange(1, len(spans) + 1)), axis=1)
    up = np.asarray(f / np.linalg.norm(f, axis=1, keepdims=True), dtype=np.float64)
    return Turns(
        rates.t, rates.gyro, rates.accel, 0.5 if log.imu.kind == "rate" else 0.0, np.ascontiguousarray(spans[complete]),
        pair[complete], up, f, np.asarray(factor * B, dtype=np.float64), accel.p[:3] / factor,
    )  # fmt: skip


def _accelerometers_alone(result: CalibrationResult) -> CalibrationResult:
    """The accelerometers of a log that has no gyroscopes."""
    count = len(freepose_accel.NAMES)
    verdicts = tuple(v for v in result.verdicts if "yroscope" not in v)
    weak = any("determined" in v or "redundancy" in v for v in verdicts)
    return replace(
        result, names=result.names[:count], values=result.values[:count], covariance=result.covariance[:count, :count],
        status="warning" if weak else "ok", verdicts=(*verdicts, "The log has no gyroscopes: accelerometers alone."),
        residuals={"accel": result.residuals["accel"]},
        extra={k: v for k, v in result.extra.items() if k not in ("bias_causes", "seconds_of_bias", "turns")},
    )  # fmt: skip


def _rms(x: FloatArray) -> float:
    return float(np.sqrt(np.mean(np.square(x))))


def _gyro_count(options: dict[str, Any]) -> int:
    """Number of parameters that turns must determine."""
    return 9 + 3 * int(options["gyro_bias"] == "estimate")


def parameter_names(options: dict[str, Any]) -> tuple[str, ...]:
    """Names of the parameters that are estimated with these options."""
    families = {"g_sensitivity": SENSITIVITY, "size_effect": PLACES, "delay": ("delay",)}
    chosen = tuple(name for option, family in families.items() if options[option] for name in family)
    return (*freepose_accel.NAMES, *BIAS_G, *MATRIX_G, *chosen)
