"""One triad calibrated by the multi-position method: adjustment, tests, and parameters of the sensor model."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal, TypeAlias

import numpy as np

from schuler.arrays import BoolArray, FloatArray
from schuler.calibration.bench.adjustment import Adjustment
from schuler.calibration.bench.gauss_helmert import Order, Start, adjust
from schuler.calibration.bench.model_order import OrderTest, order_tests, p_of, recommended
from schuler.calibration.bench.sensor_geometry import PARAMETERS, triad_derivative, triad_matrix, triad_truth
from schuler.calibration.bench.triad_verdicts import ADVISED, ENOUGH_FREEDOM, REJECT, refusal, suspicions, why_not_more
from schuler.calibration.design.plans import words_of
from schuler.calibration.design.pose_advice import next_directions, reasons
from schuler.calibration.result.result import Residuals
from schuler.sensors.spec import TriadSpec

Letter: TypeAlias = Literal["a", "g"]

#: Noise of the means beyond this part of the reference buries it.
LARGEST_NOISE = 0.3
_WHO = {"a": "accelerometers", "g": "gyroscopes"}
_LOWER = ("xx", "yx", "yy", "zx", "zy", "zz")
_PLACES = ((0, 1, 1, 2, 2, 2), (0, 0, 1, 0, 1, 2))


@dataclass(frozen=True, eq=False)
class TriadCalibration:
    """One triad.

    Attributes
    ----------
    names : tuple of str
        Nine: bias, then the lower triangle of M row by row, as ``b_a_x``, ``M_a_yx``.
    values, covariance : ndarray, shape (9,), (9, 9)
        Infinite variances where undetermined.
    held : ndarray of bool, shape (9,)
        Not estimated.
    prior_sigma : dict of str to float
        What the data sheet knows, for comparison.
    prior : dict of str to (value, sigma)
        What entered the adjustment, by names of PARAMETERS.
    adjustment : Adjustment or None
        None if there was nothing to adjust.
    status : {"ok", "warning", "refused"}
    verdicts : tuple of str
    residuals : Residuals or None
    next_pose : str
    extra : dict
        Parameters (b, s, theta), tests.
    """

    names: tuple[str, ...]
    values: FloatArray
    covariance: FloatArray
    held: BoolArray
    prior_sigma: dict[str, float]
    prior: dict[str, tuple[float, float]]
    adjustment: Adjustment | None
    status: Literal["ok", "warning", "refused"]
    verdicts: tuple[str, ...]
    residuals: Residuals | None
    next_pose: str
    extra: dict[str, Any]


def triad_names(which: Letter) -> tuple[str, ...]:
    """Bias and lower triangle of M: ``b_a_x, b_a_y, b_a_z, M_a_xx, M_a_yx, M_a_yy, M_a_zx, M_a_zy, M_a_zz``."""
    return tuple(f"b_{which}_{i}" for i in "xyz") + tuple(f"M_{which}_{ij}" for ij in _LOWER)


def to_model(values: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Values of the sensor model from (b, s, theta), by :func:`triad_names`, and their derivative. (9,), (9, 9)."""
    M, J = triad_matrix(values[3:6], values[6:]) - np.eye(3), np.zeros((9, 9))
    J[:3, :3] = np.eye(3)
    J[3:, 3:] = triad_derivative(values[3:6], values[6:])[_PLACES]
    return np.concatenate((values[:3], M[_PLACES])), J


def prior_of(spec: TriadSpec | None) -> dict[str, float]:
    """1 sigma of (b, s, theta) on a data sheet, by parameter; what it does not state is missing."""
    if spec is None:
        return {}
    sizes = [spec.turn_on_bias] * 3 + [spec.scale_factor] * 3 + [spec.misalignment] * 3
    return {name: size for name, size in zip(PARAMETERS, sizes, strict=True) if size > 0.0}


def calibrate_triad(
    which: Letter,
    Y: FloatArray,
    sigma: FloatArray,
    rho: FloatArray,
    labels: Sequence[str],
    unit: str,
    order: Order | Literal["auto"],
    *,
    spec: TriadSpec | None = None,
    use_prior: bool = False,
    fixed: Mapping[str, float] | None = None,
    start: Start = "continuation",
) -> TriadCalibration:
    """Adjust, test, and say what came out; see :func:`schuler.calibration.bench.multiposition.calibrate_multiposition`.

    Parameters
    ----------
    which : {"a", "g"}
    Y, sigma : ndarray, shape (n, 3)
        Means and their uncertainty. [x]
    rho : ndarray, shape (n,)
        [x]
    labels : sequence of str
        Of the poses.
    unit : str
    order : {3, 6, 9, "auto"}
        Auto: as many as the readings justify, and where there is a data sheet, as tell more than it.
    spec : TriadSpec, optional
        Data sheet: prior, and judge of what was learnt. Gyroscopes' scale factors and angles that came out worse are
        handed back to it; those of accelerometers never are, because more poses would tell them.
    use_prior : bool
        Add the data sheet as a prior of everything that is estimated.
    fixed : mapping of str to float, optional
        Held parameters, names of :data:`schuler.calibration.bench.sensor_geometry.PARAMETERS`.
    start
        See :func:`schuler.calibration.bench.gauss_helmert.adjust`.
    """
    who, fixed, sheet = _WHO[which], dict(fixed or {}), prior_of(spec)
    remark: list[str] = []
    serious: list[str] = []
    noise = float(np.median(sigma / rho[:, None]))
    if noise > LARGEST_NOISE:
        return _buried(which, Y, sigma, rho, unit, noise, sheet)
    tests: tuple[OrderTest, ...] = ()
    prior = {name: (0.0, s) for name, s in sheet.items() if name not in fixed} if use_prior else {}
    chosen: Order
    if order == "auto":
        tests = order_tests(Y, sigma, rho, fixed=fixed)
        chosen = recommended(tests).order if tests else 3
        # what the data sheet knows better is handed back to it below
        if "s_x" in sheet:
            chosen = 9 if "theta_yz" in sheet or chosen == 9 else 6
        elif tests and chosen < 9:
            remark.append(why_not_more(who, tests, chosen))
    else:
        chosen = order
    fit = adjust(Y, sigma, rho, chosen, prior=prior, fixed=fixed, start=start)
    if which == "g" and chosen > 3 and not use_prior:
        useless = _useless(fit, sheet)
        if useless:
            remark.append(refusal(who, fit, useless, sheet))
            lost = [name for name in useless if fit.undetermined[PARAMETERS.index(name)]]
            remark.extend(f"{who}: {reason}" for reason in reasons(lost, _directions(Y, fit)))
            prior = {name: (0.0, sheet[name]) for name in useless}
            fit = adjust(Y, sigma, rho, chosen, prior=prior, fixed=fixed, start=start)
    undetermined = fit.undetermined
    u = _directions(Y, fit)
    if undetermined.any():
        lost = [name for name, bad in zip(PARAMETERS, undetermined, strict=True) if bad]
        if len(Y) < fit.free.sum() and not prior:
            serious.append(f"{who}: {len(Y)} poses cannot determine {fit.free.sum()} parameters; collect more")
        serious.extend(f"{who}: {reason}" for reason in reasons(lost, u))
    if not fit.converged:
        serious.append(
            f"{who}: the adjustment did not converge in {fit.iterations} iterations; the poses are too much alike or "
            f"the reference is wrong (readings average {np.linalg.norm(Y, axis=1).mean():.4g} {unit}, "
            f"reference {rho.mean():.4g})"
        )
        undetermined = undetermined | fit.free
    suspicious = suspicions(who, fit, undetermined, labels, unit, u) if fit.converged else []
    inflation, global_p = 1.0, p_of(fit)
    if fit.freedom > 0 and global_p < REJECT:
        inflation = fit.variance_of_unit_weight
    values, covariance, held_rows = _as_model(fit, undetermined, inflation)
    advice = ""
    if serious or (fit.freedom < ENOUGH_FREEDOM and not prior):
        advice = _poses_to_add(which, fit, u)
    return TriadCalibration(
        triad_names(which), values, covariance, held_rows, _prior_sigma(which, sheet), prior, fit,
        "refused" if serious else "warning" if suspicious else "ok", (*serious, *suspicious, *remark),
        _residuals(fit, Y, rho, labels, unit, u), advice, _extra(fit, chosen, inflation, tests),
    )  # fmt: skip


def _as_model(fit: Adjustment, undetermined: BoolArray, inflation: float) -> tuple[FloatArray, FloatArray, BoolArray]:
    """Estimate as bias and ``I + M``, its covariance, infinite where undetermined, and which elements were held."""
    values, J = to_model(fit.values)
    stated = np.where(undetermined, 0.0, 1.0)
    covariance = (J * stated) @ np.where(np.isfinite(fit.cofactor), fit.cofactor, 0.0) @ (J * stated).T * inflation
    lost = (np.abs(J[:, undetermined]) > 1e-3).any(axis=1)
    covariance[lost, :] = covariance[:, lost] = 0.0
    covariance[lost, lost] = np.inf
    if not fit.converged:
        values = np.where(lost, 0.0, values)
    return values, covariance, np.asarray(~(np.abs(J[:, fit.free]) > 0.0).any(axis=1))


def _poses_to_add(which: Letter, fit: Adjustment, u: FloatArray) -> str:
    """Sentence on the directions that would determine most beside those measured, u."""
    wanted = next_directions(u, fit.free, max(ENOUGH_FREEDOM + int(fit.free.sum()) - len(u), 1))
    up = "" if which == "a" else " (up stands for along the reference rate)"
    advice = f"{_WHO[which]}{up}: " + "; then ".join(words_of(d) for d in wanted[:ADVISED])
    return advice + (f"; then {len(wanted) - ADVISED} more" if len(wanted) > ADVISED else "")


def _directions(Y: FloatArray, fit: Adjustment) -> FloatArray:
    """Where the reference pointed, unit vectors in body axes; z for a reading of nothing at all."""
    v = triad_truth(Y, fit.values[:3], fit.values[3:6], fit.values[6:])
    length = np.linalg.norm(v, axis=1, keepdims=True)
    return np.asarray(np.where(length > 0.0, v / np.where(length > 0.0, length, 1.0), (0.0, 0.0, 1.0)))


def _useless(fit: Adjustment, sheet: Mapping[str, float]) -> list[str]:
    """Scale factors and angles that came out less certain than the data sheet has them."""
    sigma = np.where(fit.undetermined | (not fit.converged), np.inf, fit.sigma)
    return [
        name for i, name in enumerate(PARAMETERS) if i > 2 and fit.free[i] and name in sheet and sigma[i] > sheet[name]
    ]


def _buried(
    which: Letter, Y: FloatArray, sigma: FloatArray, rho: FloatArray, unit: str, noise: float, sheet: dict[str, float]
) -> TriadCalibration:
    """The reference is lost in the noise: the mean reading is as good a bias as there is, within the reference."""
    P = 1.0 / sigma**2
    mean = np.sum(P * Y, axis=0) / P.sum(axis=0)
    # each axis saw a part of the reference between -rho and rho, uniformly if directions are
    spread = rho.mean() / np.sqrt(3.0)
    values, covariance = np.zeros(9), np.zeros((9, 9))
    values[:3] = mean
    covariance[:3, :3] = np.diag(1.0 / P.sum(axis=0) + spread**2)
    held = np.arange(9) > 2
    remark = (
        f"{_WHO[which]}: the means are uncertain by {noise:.2g} of the reference ({rho.mean():.3g} {unit}), which "
        "buries it: scale factors and angles stay nominal and the bias is the mean over the poses, uncertain by the "
        "reference itself; use a rate table, stay longer, or calibrate by turns by hand between static poses"
    )
    return TriadCalibration(
        triad_names(which), values, covariance, held, _prior_sigma(which, sheet), {}, None, "warning", (remark,), None,
        "", {"b": mean.tolist(), "noise_over_reference": noise},
    )  # fmt: skip


def _residuals(
    fit: Adjustment, Y: FloatArray, rho: FloatArray, labels: Sequence[str], unit: str, u: FloatArray
) -> Residuals:
    before = np.linalg.norm(Y, axis=1) - rho
    return Residuals(tuple(labels), fit.misclosure, fit.misclosure_sigma, unit, before, u)


def _prior_sigma(which: Letter, sheet: Mapping[str, float]) -> dict[str, float]:
    """Data sheet by parameter of the sensor model; to first order an element of M is one of s and theta."""
    first_order = (*PARAMETERS[:4], "theta_yz", "s_y", "theta_zy", "theta_zx", "s_z")
    return {n: sheet[p] for n, p in zip(triad_names(which), first_order, strict=True) if p in sheet}


def _extra(fit: Adjustment, order: int, inflation: float, tests: Sequence[OrderTest]) -> dict[str, Any]:
    return {
        "order": order,
        "parameters": list(PARAMETERS),
        "values": fit.values.tolist(),
        "sigma": (fit.sigma * np.sqrt(inflation)).tolist(),
        "estimated": fit.free.tolist(),
        "variance_of_unit_weight": fit.variance_of_unit_weight,
        "freedom": fit.freedom,
        "inflation": inflation,
        "p_global": p_of(fit),
        "iterations": fit.iterations,
        "converged": fit.converged,
        "orders": [
            {
                "order": t.order, "variance_of_unit_weight": t.adjustment.variance_of_unit_weight,
                "freedom": t.adjustment.freedom, "p_global": t.p_global, "p_previous": t.p_previous, "aic": t.aic,
                "bic": t.bic, "t": _t_values(t.adjustment),
            }
            for t in tests
        ],
    }  # fmt: skip


def _t_values(fit: Adjustment) -> list[float]:
    """Estimates over their uncertainty, zero where nothing was estimated."""
    sigma = np.where(fit.free, fit.sigma, np.inf)
    return [float(t) for t in fit.values / sigma]
