"""Result of a free-pose calibration: parameters of both steps with one covariance, residuals, verdicts."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from schuler.arrays import BoolArray, FloatArray
from schuler.calibration.design.plans import words_of
from schuler.calibration.freepose import motion as freepose_motion
from schuler.calibration.freepose import verdicts
from schuler.calibration.freepose.accel import NAMES, AccelFit, distinct, sphere_start
from schuler.calibration.freepose.bias import RestBias
from schuler.calibration.freepose.gyro import GyroFit
from schuler.calibration.freepose.motion import MotionFit
from schuler.calibration.freepose.rests import Rests
from schuler.calibration.freepose.turns import Turns, direction_noise, vertical_residuals
from schuler.calibration.freepose.weights import largest_reduced_chi2, pseudo_inverse
from schuler.calibration.result.parameters import LINEAR
from schuler.calibration.result.result import CalibrationResult, Residuals, Status
from schuler.files import package_version
from schuler.recording.series import ImuSeries
from schuler.rotation import rotvec_from_dcm
from schuler.units import DEG_PER_HR

#: Elements that the gauge "upper" holds.
HELD = {"M_a_yx": 0.0, "M_a_zx": 0.0, "M_a_zy": 0.0}
#: Median angle between predicted and measured vertical beyond which the gyroscopes do not fit. [rad]
MISFIT = 0.2
#: Arguments that switch the g-sensitivity on and off.
ON, OFF = "g_sensitivity=True", "g_sensitivity=False"


def _provenance(options: dict[str, Any]) -> dict[str, Any]:
    return {"schuler": package_version(), "method": "freepose", "options": options}


def _temperature(imu: ImuSeries) -> float | None:
    return None if imu.temperature is None else float(imu.temperature.mean())


def _held(names: tuple[str, ...]) -> dict[str, float]:
    return HELD | freepose_motion.HELD if freepose_motion.PLACES[0] in names else dict(HELD)


def undetermined(fit: AccelFit) -> list[str]:
    """Accelerometer parameters whose 1-sigma, scatter included, is larger than that of a data sheet."""
    gone, _, _ = verdicts.undetermined_parameters(fit.normal)
    sigma = np.where(gone, np.inf, np.sqrt(np.diag(pseudo_inverse(fit.normal))))
    return [n for n, s in zip(NAMES, sigma, strict=True) if not s < verdicts.USELESS[n[:3]]]


def refused_result(
    rests: Rests | None,
    fit: AccelFit | None,
    factors: tuple[float, float] | None,
    gravity: float,
    imu: ImuSeries,
    names: tuple[str, ...],
    options: dict[str, Any],
) -> CalibrationResult:
    """Result without values, and what to collect next."""
    n = 0 if rests is None else len(rests)
    up = None
    if rests is not None and n >= 4:
        y = rests.accel * (1.0 if factors is None else factors[0])
        f = y - sphere_start(y, gravity)[:3]  # these poses do not determine nine parameters
        up = f / np.linalg.norm(f, axis=1, keepdims=True)
    directions = verdicts.missing_directions(up, max(3, 18 - n))
    if n < 9:
        reason = (
            f"{n} pose{'' if n == 1 else 's'} at rest found; nine accelerometer parameters need nine different poses, "
            "18 or more are good"
        )
    elif fit is not None:
        count = int(distinct(up).sum()) if up is not None else 0
        reason = (
            f"{n} poses at rest found, {count} of them different, which do not determine "
            f"{verdicts.listed(undetermined(fit))}"
        )
    else:
        reason = f"{n} poses at rest found, but their specific forces lie on no ellipsoid: too few different directions"
    advice = f"hold still for {options['min_s'] + 2.0 * options['window_s']:.0f} s in each; put up next: {directions}"
    p_count = len(names)
    return CalibrationResult(
        "freepose", names, np.zeros(p_count), np.diag(np.full(p_count, np.inf)), "upper", _held(names),
        (1.0, 1.0) if factors is None else factors, "refused", (f"Refused: {reason}.", f"Collect: {advice}."),
        float("inf"), next_pose=advice, temperature=_temperature(imu),
        extra={"poses": n, "intervals": _spans(imu, rests)} | _trials(rests), provenance=_provenance(options),
    )  # fmt: skip


def freepose_result(
    imu: ImuSeries,
    rests: Rests,
    accel: AccelFit,
    gyro: GyroFit | None,
    motion: MotionFit | None,
    turns: Turns,
    nominal: tuple[float, float],
    gravity: float,
    sigma_f: FloatArray,
    bias: RestBias,
    names: tuple[str, ...],
    options: dict[str, Any],
) -> CalibrationResult:
    """Result of both steps; without the second if there are too few turns (``gyro`` is None)."""
    fitting = gyro if gyro is not None and _median_miss(gyro) < MISFIT else None
    joint = _join_fits(names, accel, fitting, motion if fitting is not None else None, turns, sigma_f)
    sentences: list[str] = []
    status: Status = "ok"
    if fitting is None:
        joint.values[9:12] = nominal[1] * bias.value
        joint.undetermined[12:] = True
        joint.covariance[9:12, 9:12] = np.diag((nominal[1] * bias.sigma) ** 2)
        status = "warning"
        sentences.append(_uncalibrated_gyroscopes(gyro, turns))
    covariance, lost = joint.covariance, joint.undetermined
    covariance[lost, :] = covariance[:, lost] = 0.0
    covariance[lost, lost] = np.inf
    weak, advice = _weak_parameters(names, covariance, accel, fitting, joint.combinations, gravity, len(turns.spans))
    if weak:
        status = "warning"
        sentences += weak
    if len(rests) - 9 < 3:
        status = "warning"
        sentences.append(f"{len(rests)} poses leave hardly any redundancy: errors of single poses go unnoticed.")
    sentences += _scatter_and_outliers(accel, fitting)
    chi2, freedom = joint.chi2, joint.freedom
    if options["noise"] is not None and freedom > 0 and chi2 / freedom * largest_reduced_chi2(freedom) < 1.0:
        sentences.append(f"Residuals are smaller than the noise stated: variance of unit weight {chi2 / freedom:.2g}.")
    sentences += _changing_bias(bias, nominal[1], asked=options["g_sensitivity_asked"])
    extra: dict[str, Any] = {
        "poses": len(rests), "turns": len(turns.spans), "margin": rests.margin, "intervals": _spans(imu, rests),
        "spread_accel": accel.spread, "seconds_of_bias": bias.seconds,
        "bias_causes": [cause.sentence for cause in bias.causes], **_trials(rests),
    }  # fmt: skip
    residuals = {"accel": _pose_residuals(imu, rests, accel, turns, nominal, gravity)}
    if gyro is not None:
        U, _, Vt = np.linalg.svd(np.eye(3) + gyro.M)
        extra |= {"spread_gyro": gyro.spread, "misalignment_rotvec": rotvec_from_dcm((U @ Vt).T).tolist()}
        residuals["gyro"] = _turn_residuals(imu, gyro, turns, nominal)
    if motion is not None:
        extra["spread_velocity"] = motion.spread
        sigma_v = np.sqrt(3.0 * (motion.sigma**2 + motion.spread**2))
        size = np.linalg.norm(motion.residual, axis=1)
        residuals["velocity"] = Residuals(residuals["gyro"].label, size, sigma_v, "m/s", motion.before)
    return CalibrationResult(
        "freepose", names, joint.values, covariance, "upper", _held(names), nominal, status, tuple(sentences),
        joint.condition if fitting is not None else float("inf"),
        variance_of_unit_weight=chi2 / freedom if freedom > 0 else float("nan"), freedom=freedom, residuals=residuals,
        next_pose=advice, temperature=_temperature(imu), extra=extra, provenance=_provenance(options),
    )  # fmt: skip


class _JointFit(NamedTuple):
    """Parameters of all steps in the order of their names, with one covariance."""

    values: FloatArray
    covariance: FloatArray
    undetermined: BoolArray
    combinations: list[FloatArray]
    condition: float
    chi2: float
    freedom: int


def _join_fits(
    names: tuple[str, ...],
    accel: AccelFit,
    gyro: GyroFit | None,
    motion: MotionFit | None,
    turns: Turns,
    sigma_f: FloatArray,
) -> _JointFit:
    """Join the fits: accelerometers b_a, M_a; gyroscopes b_g, M_g, G_g; places and delay."""
    count, linear = len(names), sum(n in LINEAR for n in names)
    values, covariance, gone = np.zeros(count), np.zeros((count, count)), np.zeros(count, dtype=bool)
    _, to_p = direction_noise(turns, accel, sigma_f)
    values[:9] = accel.p
    covariance[:9, :9] = (to_p * sigma_f.ravel() ** 2) @ to_p.T
    gone[:9], combinations, condition = verdicts.undetermined_parameters(accel.normal)
    chi2, freedom = float(((accel.residual / accel.sigma) ** 2).sum()), len(accel.residual) - 9
    if gyro is not None:
        place = _gyro_places(gyro, linear)
        values[9:12], values[12:21] = gyro.b, gyro.M.ravel()
        values[21:linear] = gyro.G.ravel()[: linear - 21]
        covariance[np.ix_(place, place)] = gyro.covariance
        covariance[np.ix_(place, range(9))] = gyro.cross
        covariance[np.ix_(range(9), place)] = gyro.cross.T
        if 9 not in place:
            covariance[9:12, 9:12] = gyro.bias_covariance
            covariance[np.ix_(place, range(9, 12))] = gyro.bias_cross
            covariance[np.ix_(range(9, 12), place)] = gyro.bias_cross.T
        gone[place], _, condition_g = verdicts.undetermined_parameters(gyro.normal)
        condition = max(condition, condition_g)
        chi2, freedom = chi2 + gyro.chi2, freedom + gyro.freedom
    if motion is not None:
        values[linear:], covariance[linear:, linear:] = motion.values, motion.covariance
        chi2, freedom = chi2 + motion.chi2, freedom + motion.freedom
    return _JointFit(values, covariance, gone, combinations, condition, chi2, freedom)


def _median_miss(gyro: GyroFit) -> float:
    """Median angle between predicted and measured vertical. [rad]"""
    return float(np.median(np.linalg.norm(gyro.residual, axis=1)))


def _uncalibrated_gyroscopes(gyro: GyroFit | None, turns: Turns) -> str:
    if gyro is None:
        return f"The gyroscopes are not calibrated: {len(turns.spans)} turns between rests are too few."
    return (
        f"The gyroscopes are not calibrated: the turns miss the measured verticals by {_median_miss(gyro):.2f} rad "
        "(median); check that both triads have the same axes and signs, and the same clock."
    )


def _weak_parameters(
    names: tuple[str, ...],
    covariance: FloatArray,
    accel: AccelFit,
    gyro: GyroFit | None,
    combinations: list[FloatArray],
    gravity: float,
    turn_count: int,
) -> tuple[list[str], str]:
    """Sentences on undetermined and weak parameters, and advice on the next pose and turns."""
    sigma = np.sqrt(np.diag(covariance))
    useless, diluted = verdicts.weak_accelerometers(names[:9], sigma[:9], accel, gravity)
    finite = np.where(np.isfinite(covariance[:9, :9]), covariance[:9, :9], 0.0)
    for vector in combinations:  # a direction without information is the one to be filled
        finite = finite + 1e6 * np.outer(vector, vector)
    direction, _ = verdicts.next_pose(accel, finite, gravity)
    advice = f"put the unit with {words_of(direction)}"
    sentences = []
    if useless:
        sentences.append(f"{_with_sigma(useless, names, sigma)} not determined by these poses: next {advice}.")
    if diluted:
        sentences.append(
            f"{_with_sigma(diluted, names, sigma)} poorly determined, {verdicts.DILUTION:.0f} times worse or more than "
            f"by as many poses all round: next {advice}."
        )
    if gyro is not None:
        noise = float(np.sqrt(np.mean(gyro.sigma**2) + gyro.spread**2))
        even = noise * np.sqrt(4.5 / turn_count) / 1.5
        linear = sum(n in LINEAR for n in names)
        useless, diluted = verdicts.weak_gyroscopes(names[9:linear], sigma[9:linear], even)
        if useless or diluted:
            todo = verdicts.turn_advice(useless + diluted)
            words = "not determined" if useless else "poorly determined"
            sentences.append(f"{_with_sigma(useless + diluted, names, sigma)} {words} by these turns: {todo}.")
            advice += f"; {todo}"
    return sentences, advice


def _gyro_places(gyro: GyroFit, count: int) -> list[int]:
    """Places of the parameters of a fit (M, b, G) among b_a, M_a, b_g, M_g, G_g."""
    n = len(gyro.covariance)
    return [*range(12, 21), *(range(9, 12) if n > 9 else ()), *range(21, count)]


def _with_sigma(chosen: list[str], names: tuple[str, ...], sigma: FloatArray) -> str:
    parts = [f"{n} (1 sigma {sigma[names.index(n)]:.2g})" if np.isfinite(sigma[names.index(n)]) else n for n in chosen]
    return f"{verdicts.listed(parts)} {'is' if len(parts) == 1 else 'are'}"


def _changing_bias(bias: RestBias, nominal: float, asked: bool | None) -> list[str]:
    """Sentences on a gyroscope bias that changes between rests: by how much, and what explains it."""
    seen = [cause for cause in bias.causes if cause.decisive]
    out = []
    for cause in seen[:1] if not bias.by_force else [c for c in seen if c.name == "g-sensitivity"]:
        if cause.name == "g-sensitivity":
            todo = (
                ("it is estimated; " + f"{OFF} switches it off") if asked is None else "it is estimated"
            ) if bias.by_force else f"{ON} estimates it"  # fmt: skip
        elif cause.name == "temperature":
            todo = "warm the unit up before the log, or calibrate it over temperature (calibrate_thermal)"
        else:
            todo = "let the unit warm up before the log"
        out.append(f"Gyroscope {cause.sentence}; {todo}.")
    sigma = float(np.sqrt(np.mean(bias.scatter.sigma**2))) * nominal
    freedom = bias.scatter.freedom
    if freedom > 0 and bias.scatter.reduced > largest_reduced_chi2(freedom):
        rest = "" if out or not seen else f"; {seen[0].sentence}"
        out.append(
            f"The gyroscope bias changes by {sigma / DEG_PER_HR:.3g} deg/h from rest to rest beyond noise (chi-square "
            f"over degrees of freedom {bias.scatter.reduced:.2g}); that is in its uncertainty{rest}."
        )
    return out


def _scatter_and_outliers(accel: AccelFit, gyro: GyroFit | None) -> list[str]:
    """Sentences on scatter beyond noise and on outliers."""
    out = []
    if accel.spread > 0.0:
        out.append(
            f"Poses scatter by {1e3 * accel.spread:.2g} mm/s^2 beyond noise; that much was added to each, so the "
            "stated uncertainty is what was seen."
        )
    if gyro is not None and gyro.spread > 0.0:
        out.append(f"Turns miss the next vertical by {1e3 * gyro.spread:.2g} mrad beyond noise; added likewise.")
    bad = np.flatnonzero(accel.weight < 0.5)
    if len(bad):
        out.append(f"Pose {', '.join(str(k + 1) for k in bad)} does not fit the others and counts for little.")
    bad = np.flatnonzero(gyro.weight < 0.5) if gyro is not None else bad[:0]
    if len(bad):
        out.append(f"Turn {', '.join(str(k + 1) for k in bad)} does not fit the others and counts for little.")
    return out


def _spans(imu: ImuSeries, rests: Rests | None) -> list[list[float]]:
    if rests is None:
        return []
    return [[float(imu.t[a]), float(imu.t[b - 1])] for a, b in rests.index]


def _trials(rests: Rests | None) -> dict[str, Any]:
    """Trials of the published search, if it detected the rests."""
    return {"tried": [list(one) for one in rests.tried]} if rests is not None and rests.tried else {}


def _pose_residuals(
    imu: ImuSeries, rests: Rests, accel: AccelFit, turns: Turns, nominal: tuple[float, float], gravity: float
) -> Residuals:
    label = tuple(f"pose {k + 1} ({a:.1f}..{b:.1f} s)" for k, (a, b) in enumerate(_spans(imu, rests)))
    before = np.linalg.norm(rests.accel, axis=1) - gravity if nominal[0] == 1.0 else None
    sigma = np.sqrt(accel.sigma**2 + accel.spread**2)
    return Residuals(label, accel.residual, sigma, "m/s^2", before, turns.up)


def _turn_residuals(imu: ImuSeries, gyro: GyroFit, turns: Turns, nominal: tuple[float, float]) -> Residuals:
    label = tuple(
        f"turn {i + 1} to {j + 1} ({imu.t[a]:.1f}..{imu.t[b]:.1f} s)"
        for (i, j), (a, b) in zip(turns.pair, turns.spans, strict=True)
    )
    before = None
    if nominal[1] == 1.0:
        before = np.linalg.norm(vertical_residuals(turns, 1.0, np.zeros((3, 3)), np.zeros(3), None)[0], axis=1)
    sigma = np.sqrt(2.0 * (gyro.sigma**2 + gyro.spread**2))
    return Residuals(label, np.linalg.norm(gyro.residual, axis=1), sigma, "rad", before, turns.up[turns.pair[:, 1]])
