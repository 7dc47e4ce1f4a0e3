"""Free-pose calibration: an IMU put down by hand in many poses, nothing known but gravity."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from functools import partial
from typing import Any, Literal, TypeAlias

import numpy as np

from schuler.arrays import ArrayLike, FloatArray, IntArray, as_floats
from schuler.calibration.freepose import accel as freepose_accel
from schuler.calibration.freepose.accel import AccelFit, fit_accelerometers
from schuler.calibration.freepose.bias import bias_at_rest, bias_difference, bias_in_turns
from schuler.calibration.freepose.gyro import GyroFit, fit_gyroscopes, rescaled
from schuler.calibration.freepose.lost_rates import lost_rates
from schuler.calibration.freepose.motion import PLACES, MotionFit, fit_motion
from schuler.calibration.freepose.rests import MARGINS, Rests, pose_means, tedaldi_rests, without_held
from schuler.calibration.freepose.result import freepose_result, refused_result, undetermined
from schuler.calibration.freepose.turns import Turns, nominal_scale
from schuler.calibration.magnetometer.calibrate import estimates_soft_iron, magnetic_means, with_magnetometer
from schuler.calibration.result.halves import checked, halves_of, tried, without_thirds
from schuler.calibration.result.parameters import BIAS_G, MATRIX_G, SENSITIVITY
from schuler.calibration.result.result import CalibrationResult
from schuler.exceptions import InputError
from schuler.recording.series import ImuSeries
from schuler.standstill.variance_ratio import intervals_below, log_gaps, variance_ratio
from schuler.units import G0

Bias: TypeAlias = Literal["rest", "estimate"]
Search: TypeAlias = Literal["auto", "tedaldi"]

#: Fewest poses: the parameters of the accelerometers.
FEWEST = 9
#: Largest number of undetermined accelerometer parameters of a result that is not refused.
MOST_UNDETERMINED = 3
_FEWEST_TURNS = 6  # good ones left, of which others with lost rates are left out
#: Fewest poses beyond nine of a result with an undetermined parameter that is not refused.
REDUNDANCY = 3


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
        options["g_sensitivity"] = g_sensitivity = bool(g_sensitivity)
    imu, held = without_held(imu)
    rates, interval = imu.rates(), imu.interval
    lost, sentences = lost_rates(rates.t, rates.gyro)
    held += sentences
    names = _parameter_names(bool(g_sensitivity), size_effect, delay)

    # 1. Rests, and the accelerometers from them.
    if rests == "tedaldi" and initial_rest_s is not None:
        factor_a = None if factors is None else factors[0]
        candidates = [
            tedaldi_rests(rates, interval, gravity, initial_rest_s, factor=factor_a, window_s=window_s, min_s=min_s)
        ]
    else:
        candidates = _candidate_rests(rates, interval, intervals, initial_rest_s, window_s, min_s)
    best, largest = _accelerometers(candidates, gravity, None if factors is None else factors[0], noise, robust)
    if best is None:
        refused = refused_result(largest, None, factors, gravity, rates, names, options)
        return replace(refused, verdicts=refused.verdicts + held)

    # 2. All else in their axes.
    poses, accel, factor_a = best
    solved = partial(_solved, imu, rates, gravity=gravity, noise=noise, lost=lost, field=field_strength)
    result = solved(poses, accel, factor_a, factors, options=options, soft_iron=soft_iron)
    result = replace(result, verdicts=result.verdicts + held)
    if not halves or rests == "tedaldi" or result.status == "refused":
        return result

    # 3. Parts of the rests by themselves, from the solution of all.
    of_part = options | {"initial_rest_s": None, "g_sensitivity": SENSITIVITY[0] in result.names}
    start = result.errors.M_g if np.isfinite(result.sigma[[n in MATRIX_G for n in result.names]]).all() else None

    def part(which: list[int]) -> CalibrationResult:
        some = pose_means(rates, interval, np.ascontiguousarray(poses.index[which]), poses.margin)
        if len(some) < FEWEST:
            return refused_result(some, None, result.nominal, gravity, rates, names, of_part)
        sigma = _sigma_f(some, noise, factor_a)
        fit = fit_accelerometers(factor_a * some.accel, sigma, gravity, robust=robust, start=accel.p)
        return solved(
            some, fit, factor_a, result.nominal, options=of_part, soft_iron=estimates_soft_iron(result), start=start
        )

    apart = {}
    if gyro_bias == "rest" and initial_rest_s is None and SENSITIVITY[0] not in result.names:
        variance = result.nominal[1] ** 2 * bias_difference(rates, poses, np.arange(len(poses)) % 2 == 0)
        apart = {"odd and even rests": dict(zip(BIAS_G, variance.tolist(), strict=True))}
    return _held_against_parts(result, len(poses), part, apart, lost)


def _accelerometers(
    candidates: Iterable[Rests],
    gravity: float,
    nominal: float | None,
    noise: tuple[ArrayLike, ArrayLike] | None,
    robust: bool,
) -> tuple[tuple[Rests, AccelFit, float] | None, Rests | None]:
    """First step: of several sets of rests the one that determines the accelerometers best.

    Returns
    -------
    tuple of (Rests, AccelFit, float), or None
        That set, the fit and the nominal scale factor; None if no set has enough poses on an ellipsoid.
    Rests or None
        The set of most rests.
    """
    best: tuple[Rests, AccelFit, float] | None = None
    largest: Rests | None = None
    last: tuple[AccelFit, float] | None = None
    lowest = np.inf
    p0: FloatArray | None
    for poses in candidates:
        if largest is None or len(poses) > len(largest):
            largest = poses
        if len(poses) < FEWEST:
            continue
        near = last is not None and last[0].converged and last[0].spread == 0.0
        if near and last is not None:  # nearly the same poses as before
            p0, factor = last[0].p, last[1]
        else:
            factor, p0 = freepose_accel.accel_start(poses.accel, gravity, nominal)
        if p0 is None:
            continue
        sigma = _sigma_f(poses, noise, factor)
        fit = fit_accelerometers(factor * poses.accel, sigma, gravity, robust=robust, start=p0, near=near)
        last = (fit, factor)
        score = _log_determinant(fit)
        if np.isfinite(score) and score < lowest:
            best, lowest = (poses, fit, factor), score
    return best, largest


def _held_against_parts(
    result: CalibrationResult,
    n: int,
    part: Callable[[list[int]], CalibrationResult],
    apart: dict[str, dict[str, float]],
    lost: IntArray,
) -> CalibrationResult:
    """Third step: the claims held against halves of the n rests, or against thirds left out where halves are too few.

    ``apart`` are variances of differences between halves that are known otherwise; ``lost`` are samples that were lost.
    """
    every = list(range(n))
    causes = [
        *(["rates were lost in turns: clipped, or spikes"] if len(lost) else []),
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


def _solved(
    imu: ImuSeries,
    rates: ImuSeries,
    rests: Rests,
    accel: AccelFit,
    factor_a: float,
    factors: tuple[float, float] | None,
    gravity: float,
    noise: tuple[ArrayLike, ArrayLike] | None,
    options: dict[str, Any],
    *,
    lost: IntArray,
    field: float | None,
    soft_iron: bool | None,
    start: FloatArray | None = None,
) -> CalibrationResult:
    """All that follows the accelerometers: gyroscopes, magnetometer, result. ``start`` is M_g, if nearly known."""
    weak = undetermined(accel)
    if len(weak) > MOST_UNDETERMINED or (weak and len(rests) < FEWEST + REDUNDANCY):
        names = _parameter_names(bool(options["g_sensitivity"]), options["size_effect"], options["delay"])
        return refused_result(rests, accel, factors or (factor_a, 1.0), gravity, rates, names, options)
    result = _with_gyroscopes(imu, rates, rests, accel, factor_a, factors, gravity, noise, options, start, lost)
    if (magnetic := magnetic_means(rates, rests.index)) is not None:
        labels = result.residuals["accel"].label
        result = with_magnetometer(result, rests.accel, *magnetic, labels, field=field, soft_iron=soft_iron)
    return result


def _with_gyroscopes(
    imu: ImuSeries,
    rates: ImuSeries,
    rests: Rests,
    accel: AccelFit,
    factor_a: float,
    factors: tuple[float, float] | None,
    gravity: float,
    noise: tuple[ArrayLike, ArrayLike] | None,
    options: dict[str, Any],
    start: FloatArray | None,
    lost: IntArray,
) -> CalibrationResult:
    """Second step: gyroscopes in the axes of the calibrated accelerometers, and the result."""
    # a small weight is a larger noise
    sigma_f = np.sqrt((_sigma_f(rests, noise, factor_a) ** 2 + accel.spread**2) / accel.weight[:, None])
    turns = _turns(imu.kind, rates, rests, accel, factor_a, lost)
    raw_bias = rests.duration @ rests.gyro / rests.duration.sum()
    gyro: GyroFit | None = None
    factor_g = 1.0 if factors is None else factors[1]
    enough = 2 * len(turns.spans) >= _gyro_count(options) and bool(rates.gyro.any())
    if enough:
        scale = nominal_scale(turns, raw_bias) if start is None else factor_g
        factor_g = scale if factors is None else factors[1]
    if noise is not None:
        rests = replace(rests, density_g=np.broadcast_to(np.asarray(noise[0], dtype=float), (3,)) / factor_g)
    bias = bias_at_rest(rates, rests, turns.f, options["initial_rest_s"], options["g_sensitivity"])
    options = options | {"g_sensitivity": bias.by_force, "g_sensitivity_asked": options["g_sensitivity"]}
    names = _parameter_names(bias.by_force, options["size_effect"], options["delay"])
    if enough:
        of_all_rests = options["initial_rest_s"] is None and not bias.by_force and options["rests"] != "tedaldi"
        gyro = fit_gyroscopes(
            turns, rests, accel, sigma_f, factor_g, factor_g * bias.value, factor_g * bias.sigma,
            estimate_bias=options["gyro_bias"] == "estimate", g_sensitivity=bias.by_force, robust=options["robust"],
            M=np.eye(3) * (factor_g / scale - 1.0) if start is None else start, near=start is not None,
            rest_covariance=factor_g**2 * bias.scatter.rests,
            # that of a turn is the mean of its neighbours; programs to compare with weigh all turns alike
            wander=0.0 if options["rests"] == "tedaldi" else np.sqrt(0.5) * factor_g * _rms(bias.scatter.sigma),
            turn_bias=bias_in_turns(bias.scatter, bias.white, turns.pair).scaled(factor_g) if of_all_rests else None,
        )  # fmt: skip
        if factors is None and scale != 1.0:
            gain = np.cbrt(np.linalg.det(np.eye(3) + gyro.M))
            rounded = float(f"{scale / gain:.4g}")
            gyro, factor_g = rescaled(gyro, rounded / scale), rounded
    motion: MotionFit | None = None
    if gyro is not None and (options["size_effect"] or options["delay"]):
        N_a = factor_a * rests.density_a if noise is None else np.asarray(noise[1], dtype=float)
        motion = fit_motion(
            turns, factor_g, gyro, gravity, (_rms(factor_g * rests.density_g), _rms(N_a)), _rms(sigma_f) / gravity,
            size_effect=options["size_effect"], delay=options["delay"], robust=options["robust"],
        )  # fmt: skip
    result = freepose_result(
        imu, rests, accel, gyro, motion, turns, (factor_a, factor_g), gravity, sigma_f, bias, names, options
    )  # fmt: skip
    return result if rates.gyro.any() else _accelerometers_alone(result)


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


def _candidate_rests(
    rates: ImuSeries,
    interval: float,
    intervals: Sequence[tuple[float, float]] | None,
    initial_rest_s: float | None,
    window_s: float,
    min_s: float,
) -> list[Rests]:
    """Different sets of rests, one for each threshold."""
    if intervals is not None:
        spans = as_floats(intervals, "intervals", (None, 2))
        index = np.stack(
            (np.searchsorted(rates.t, spans[:, 0] - 1e-9), np.searchsorted(rates.t, spans[:, 1] + 1e-9)), axis=1
        ).astype(np.int64)
        if (np.diff(index, axis=1) < 20).any() or (index[1:, 0] < index[:-1, 1]).any():
            raise InputError("intervals: expected rests one after another with 20 samples or more in each")
        return [pose_means(rates, interval, np.ascontiguousarray(index), float("nan"))]
    statistic = variance_ratio(rates, interval, window_s, initial_rest_s)
    gaps = log_gaps(rates.t, interval)
    out: list[Rests] = []
    for margin in MARGINS:
        index = intervals_below(rates.t, interval, gaps, statistic, margin, min_s)
        if not out or not np.array_equal(index, out[-1].index):
            out.append(pose_means(rates, interval, index, margin))
    return out


def _sigma_f(rests: Rests, noise: tuple[ArrayLike, ArrayLike] | None, factor: float) -> FloatArray:
    """1-sigma noise of the pose means, shape (n, 3). [m/s^2]"""
    N = factor * rests.density_a if noise is None else np.broadcast_to(np.asarray(noise[1], dtype=float), (3,))
    return np.asarray(N / np.sqrt(rests.duration)[:, None])


def _log_determinant(fit: AccelFit) -> float:
    """Logarithm of the determinant of the covariance; infinite if it is singular."""
    d = np.sqrt(np.diag(fit.normal))
    if not (np.isfinite(d).all() and (d > 0.0).all()):
        return float("inf")
    sign, value = np.linalg.slogdet(fit.normal / np.outer(d, d))
    return float("inf") if sign <= 0 else float(-value - 2.0 * np.log(d).sum())


def _turns(kind: str, rates: ImuSeries, rests: Rests, accel: AccelFit, factor: float, lost: IntArray) -> Turns:
    """The log between the poses; turns across a gap of the log are left out, and with lost rates if enough remain."""
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
        rates.t, rates.gyro, rates.accel, 0.5 if kind == "rate" else 0.0, np.ascontiguousarray(spans[complete]),
        pair[complete], up, f, np.asarray(factor * B, dtype=np.float64), accel.p[:3] / factor,
    )  # fmt: skip


def _parameter_names(g_sensitivity: bool, size_effect: bool, delay: bool) -> tuple[str, ...]:
    optional = ((g_sensitivity, SENSITIVITY), (size_effect, PLACES), (delay, ("delay",)))
    chosen = tuple(name for estimated, family in optional if estimated for name in family)
    return (*freepose_accel.NAMES, *BIAS_G, *MATRIX_G, *chosen)
