"""Result of temperature soaks: coefficients, a row for each soak, hysteresis and what to say about them."""

from __future__ import annotations

from typing import Any, Literal

import numpy as np

from schuler.arrays import FloatArray
from schuler.calibration.bench.poses import Poses
from schuler.calibration.result.parameters import BIAS_A, BIAS_G, unit
from schuler.calibration.result.result import CalibrationResult, Residuals, Status
from schuler.calibration.thermal import soak as thermal_soak
from schuler.calibration.thermal.ramp import powers
from schuler.calibration.thermal.table import NARROW_SPAN, SMALLEST_SPAN, reference_of, refused

_WAYS = {1: "heating", -1: "cooling", 0: "first"}
_EARTH_RATE = 7.292115e-5  # [rad/s]


def calibrate_soak(
    poses: list[Poses], degree: int | Literal["auto"], reference: float | None, scale: bool | None, g: float
) -> CalibrationResult:
    """Calibrate from soaks; arguments and result as of
    :func:`schuler.calibration.thermal.calibrate.calibrate_thermal`.
    """
    soak = thermal_soak.gathered(poses)
    names = (*BIAS_G, *BIAS_A)
    low, high = float(soak.T.min()), float(soak.T.max())
    if high - low < SMALLEST_SPAN or len(soak.level) < 2:
        sentences = (
            f"the temperatures span {high - low:.2g} K only; expected {SMALLEST_SPAN:g} K or more in two or more soaks"
        )
        return refused(names, [sentences + "; a calibration at one temperature needs no soak"])
    T0, span = reference_of(reference, low, high), high - low
    verdicts: list[str] = []
    m = thermal_soak.distinct(soak.level)
    most = min(m - 1, thermal_soak.HIGHEST_DEGREE)
    if degree != "auto" and degree > most:
        verdicts.append(f"{m} different temperatures allow degree {most}, not {degree}; soak at more of them")
        degree = most
    gaps, common = thermal_soak.gap_columns(soak)
    if not gaps:
        verdicts.append("hysteresis cannot be checked: no temperature was reached both by heating and by cooling")
    gyro = _soak_gyro(soak, degree, most, gaps, T0, span)
    accel = _soak_accel(soak, degree, most, gaps, T0, span, g, scale)
    if accel is None:
        verdicts.append(
            "accelerometer biases: these poses do not determine them; turn the unit so that each axis points up once "
            "and down once at every temperature"
        )
        return refused(names, verdicts)
    fit, d_a, used, Bb, Bs = accel
    freedom = len(soak.f) - len(fit.x)
    vuw = fit.squares / freedom if freedom > 0 else float("nan")
    factor = _inflation(fit.squares, freedom)
    if factor > 1.0:
        verdicts.append(
            f"accelerometers: residuals are {np.sqrt(factor):.1f} times what the noise explains; uncertainties are "
            "enlarged by that; more soaks, a higher degree, or steadier temperatures would tell why"
        )
    if fit.mode == "bias" and scale is None:
        verdicts.append(
            "scale factors: these poses do not determine them; use each axis up and down at every temperature"
        )
    order, x, C, coefficients, covariance, degrees = _packed(fit, factor, gyro, d_a, used, Bb, Bs, span)
    hysteresis = _soak_gaps(fit, factor, gyro, used, Bb, Bs, common, T0, span)
    verdicts += [
        f"{n}: heating and cooling differ by {h['largest']:+.2g} +- {h['sigma']:.1g} {unit(n)} at "
        f"{h['temperature']:.0f} degC; half of it remains after correction"
        for n, h in hysteresis.items() if h["found"]
    ]  # fmt: skip
    thermal = {
        "kind": "soak", "reference_temperature": T0, "range": [low, high], "degree": degrees,
        "criterion": {}, "coefficients": coefficients, "covariance": covariance,
        "table": {"temperature": soak.level.tolist(), "way": [_WAYS[int(w)] for w in soak.way]}
        | gyro["table"] | thermal_soak.plateau_values(soak, g, fit, Bb, Bs),
        "hysteresis": hysteresis,
    }  # fmt: skip
    if high - low < NARROW_SPAN:
        verdicts.append(f"the soaks span {high - low:.1f} K only; do not use the result beyond them")
    before = np.linalg.norm(soak.f, axis=1) - g
    label = tuple(f"pose {k} ({t:.1f} degC)" for k, t in enumerate(soak.T))
    up = soak.f / np.linalg.norm(soak.f, axis=1, keepdims=True)
    status: Status = "warning" if verdicts else "ok"
    return CalibrationResult(
        "thermal", order, x, C, "lower", status=status, verdicts=tuple(verdicts), condition=fit.condition,
        variance_of_unit_weight=vuw, freedom=freedom,
        residuals={"accel": Residuals(label, fit.residual, fit.sigma, "m/s^2", before, up)},
        temperature=T0, extra={"thermal": thermal},
    )  # fmt: skip


def _soak_gyro(
    soak: thermal_soak.Soak, degree: int | Literal["auto"], most: int, gaps: int, T0: float, span: float
) -> dict[str, Any]:
    """Gyroscope biases by weighted least squares: coefficients, covariance, gaps, tables."""
    sigma = np.sqrt(soak.sigma_omega**2 + _EARTH_RATE**2 / 3.0)
    out: dict[str, Any] = {"x": [], "C": [], "degree": [], "gap": [], "table": {}}
    n = len(soak.T)
    for i in range(3):
        y, w = soak.omega[:, i] / sigma[:, i], 1.0 / sigma[:, i]

        def fitted(d: int, g: int, y: FloatArray = y, w: FloatArray = w) -> tuple[FloatArray, FloatArray, float]:
            A = thermal_soak.bases(soak, T0, span, d, g)[0] * w[:, None]
            x = np.linalg.lstsq(A, y, rcond=None)[0]
            return np.asarray(x), np.asarray(np.linalg.inv(A.T @ A)), float(np.sum((y - A @ x) ** 2))

        if degree == "auto":
            d = min(range(most + 1), key=lambda k: fitted(k, gaps)[2] + (k + 1) * float(np.log(n)))
        else:
            d = degree
        x, C, squares = fitted(d, gaps)
        C = C * _inflation(squares, n - len(x))
        gap = _wald(x[d + 1 :], C[d + 1 :, d + 1 :])
        if gaps and not gap:
            x, C, squares = fitted(d, 0)
            C = C * _inflation(squares, n - len(x))
        out["x"].append(x)
        out["C"].append(C)
        out["degree"].append(d)
        out["gap"].append(gap)
        table: dict[str, list[float]] = {"value": [], "sigma": []}
        for k in range(len(soak.level)):
            here = soak.group == k
            weights = w[here] ** 2
            table["value"].append(float(np.sum(weights * soak.omega[here, i]) / weights.sum()))
            table["sigma"].append(float(weights.sum() ** -0.5))
        out["table"][BIAS_G[i]] = table
    return out


def _soak_accel(
    soak: thermal_soak.Soak,
    degree: int | Literal["auto"],
    most: int,
    gaps: int,
    T0: float,
    span: float,
    g: float,
    scale: bool | None,
) -> tuple[thermal_soak.AccelFit, int, int, FloatArray, FloatArray] | None:
    """The fit, its degree, its gap columns and its bases; None if nothing is determined."""

    def fitted(d: int, m: int, like: thermal_soak.AccelFit | None = None) -> thermal_soak.AccelFit | None:
        return thermal_soak.fit_accel(soak, g, *thermal_soak.bases(soak, T0, span, d, m), scale, like)

    if degree == "auto":
        tried = {k: f for k in range(most + 1) if (f := fitted(k, gaps)) is not None}
        if not tried:
            return None
        d = min(tried, key=lambda k: tried[k].squares + len(tried[k].x) * float(np.log(len(soak.f))))
    else:
        d = degree
    best = fitted(d, gaps)
    while best is None and d > 0:
        d -= 1
        best = fitted(d, gaps)
    if best is None:
        return None
    used = gaps
    if gaps:
        Bb, Bs = thermal_soak.bases(soak, T0, span, d, gaps)
        factor = _inflation(best.squares, len(soak.f) - len(best.x))
        places = [thermal_soak.of_axis(best, "bias", i, Bb, Bs) for i in range(3)]
        parts = [slice(p.start + d + 1, p.stop) for p in places]
        if not any(_wald(best.x[p], factor * best.covariance[p, p]) for p in parts):
            simpler = fitted(d, 0, best)
            if simpler is not None:
                best, used = simpler, 0
    return best, d, used, *thermal_soak.bases(soak, T0, span, d, used)


def _packed(
    fit: thermal_soak.AccelFit,
    factor: float,
    gyro: dict[str, Any],
    d_a: int,
    used: int,
    Bb: FloatArray,
    Bs: FloatArray,
    span: float,
) -> tuple[tuple[str, ...], FloatArray, FloatArray, dict[str, Any], dict[str, Any], dict[str, int]]:
    """Parameters at the reference temperature with their joint covariance, and the coefficients by name."""
    names: list[str] = []
    coefficients: dict[str, Any] = {}
    covariance: dict[str, Any] = {}
    degrees: dict[str, int] = {}
    place: list[int] = []

    def put(name: str, x: FloatArray, C: FloatArray, d: int) -> None:
        units = span ** np.arange(d + 1)
        coefficients[name] = [float(v) for v in x[: d + 1] / units]
        covariance[name] = (C[: d + 1, : d + 1] / np.outer(units, units)).tolist()
        degrees[name] = d

    whats: tuple[Literal["bias", "scale"], ...] = ("bias",) if fit.mode == "bias" else ("bias", "scale")
    for what in whats:
        for i, axis in enumerate("xyz"):
            p = thermal_soak.of_axis(fit, what, i, Bb, Bs)
            name = f"b_a_{axis}" if what == "bias" else f"M_a_{axis}{axis}"
            put(name, fit.x[p], factor * fit.covariance[p, p], d_a)
            names.append(name)
            place.append(p.start)
    if fit.mode == "all":
        for k, name in enumerate(("M_a_yx", "M_a_zx", "M_a_zy")):
            at = len(fit.x) - 3 + k
            put(name, fit.x[at : at + 1], factor * fit.covariance[at : at + 1, at : at + 1], 0)
            names.append(name)
            place.append(at)
    for i, name in enumerate(BIAS_G):
        put(name, gyro["x"][i], gyro["C"][i], gyro["degree"][i])
    n = len(names)
    x = np.concatenate((fit.x[place], [v[0] for v in gyro["x"]]))
    C = np.zeros((n + 3, n + 3))
    C[:n, :n] = factor * fit.covariance[np.ix_(place, place)]
    C[n:, n:] = np.diag([v[0, 0] for v in gyro["C"]])
    return (*names, *BIAS_G), x, C, coefficients, covariance, degrees


def _soak_gaps(
    fit: thermal_soak.AccelFit,
    factor: float,
    gyro: dict[str, Any],
    used: int,
    Bb: FloatArray,
    Bs: FloatArray,
    common: tuple[float, float] | None,
    T0: float,
    span: float,
) -> dict[str, Any]:
    """Difference between heating and cooling of each bias."""
    out: dict[str, Any] = {}
    for i in range(3):
        p = thermal_soak.of_axis(fit, "bias", i, Bb, Bs)
        x, C = fit.x[p][-used:] if used else fit.x[:0], factor * fit.covariance[p, p]
        out[BIAS_A[i]] = _gap_of(x, C[-used:, -used:] if used else C[:0, :0], common, T0, span)
        m = len(gyro["x"][i]) - gyro["degree"][i] - 1
        x, C = gyro["x"][i], gyro["C"][i]
        out[BIAS_G[i]] = _gap_of(x[-m:] if m else x[:0], C[-m:, -m:] if m else C[:0, :0], common, T0, span)
    return out


def _gap_of(x: FloatArray, C: FloatArray, common: tuple[float, float] | None, T0: float, span: float) -> dict[str, Any]:
    if common is None or not len(x):
        return {
            "checked": common is not None, "found": False, "p_value": None, "largest": None, "sigma": None,
            "temperature": None,
        }  # fmt: skip
    T = np.linspace(*common, 51)
    B = powers((T - T0) / span, 0.0, len(x))
    k = int(np.argmax(np.abs(B @ x)))
    p_value = _p_value(x, C)
    return {
        "checked": True, "found": bool(p_value < thermal_soak.FALSE_ALARM), "p_value": p_value,
        "largest": float(B[k] @ x), "sigma": float(np.sqrt(B[k] @ C @ B[k])), "temperature": float(T[k]),
    }  # fmt: skip


def _p_value(x: FloatArray, C: FloatArray) -> float:
    from scipy.stats import chi2

    return float(chi2.sf(float(x @ np.linalg.solve(C, x)), len(x)))


def _wald(x: FloatArray, C: FloatArray) -> bool:
    """Whether coefficients differ from zero beyond their uncertainty."""
    return len(x) > 0 and _p_value(x, C) < thermal_soak.FALSE_ALARM


def _inflation(squares: float, freedom: int) -> float:
    """Factor on a covariance where residuals are larger than the noise explains, else 1."""
    from scipy.stats import chi2

    if freedom < 1 or chi2.sf(squares, freedom) > 1e-3:
        return 1.0
    return max(1.0, squares / freedom)
