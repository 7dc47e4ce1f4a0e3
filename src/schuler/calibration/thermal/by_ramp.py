"""Result of a temperature ramp: coefficients, tables, hysteresis and what to say about them."""

from __future__ import annotations

from typing import Literal

import numpy as np

from schuler.arrays import ArrayLike, FloatArray
from schuler.calibration.result.parameters import BIAS_A, BIAS_G, unit
from schuler.calibration.result.result import CalibrationResult
from schuler.calibration.thermal import log as thermal_log
from schuler.calibration.thermal import ramp as thermal_ramp
from schuler.calibration.thermal import table as thermal_table
from schuler.calibration.thermal.ramp import Curve
from schuler.calibration.thermal.table import NARROW_SPAN, SMALLEST_SPAN, reference_of, refused
from schuler.exceptions import InputError
from schuler.recording.series import ImuSeries

_FEWEST = 60  # samples of a ramp


def calibrate_ramp(
    imu: ImuSeries,
    degree: int | Literal["auto"],
    reference: float | None,
    step: float | None,
    force: FloatArray | None,
    noise: tuple[ArrayLike, ArrayLike] | None,
) -> CalibrationResult:
    """Calibrate from a ramp; arguments and result as of
    :func:`schuler.calibration.thermal.calibrate.calibrate_thermal`.
    """
    rates = imu.rates()
    if rates.temperature is None:
        raise InputError("imu: expected a log with temperature, got none; name the column when reading")
    if len(rates) < _FEWEST:
        raise InputError(f"imu: expected {_FEWEST} samples or more of a temperature ramp, got {len(rates)}")
    sensor = thermal_log.repaired(rates.temperature)
    Y = np.concatenate((rates.gyro, rates.accel), axis=1)
    bad = thermal_log.spikes(np.concatenate((Y, sensor.T[:, None]), axis=1)) & sensor.use
    use = sensor.use & ~bad
    verdicts = _sensor_verdicts(rates, sensor, int(bad.sum()))
    T, Y = sensor.T[use], Y[use]
    names = (*BIAS_G, *BIAS_A)
    span = float(np.ptp(T)) if len(T) else 0.0
    if len(T) < _FEWEST or span < max(SMALLEST_SPAN, 3.0 * sensor.step):
        sentences = f"the temperature changes by {span:.2g} K only; expected {SMALLEST_SPAN:g} K or more"
        if span == 0.0:
            sentences = "the temperature never changes: a stuck sensor, or no ramp"
        return refused(names, [*verdicts, f"{sentences}; heat and cool the unit over the range it will be used in"])
    T0 = reference_of(reference, float(T.min()), float(T.max()))
    ways = thermal_log.branches(T, max(1.0, 0.05 * span))
    edges = thermal_log.blocks(len(T))
    at = thermal_table.knots(float(T.min()), float(T.max()), step)
    relative = [False] * 3 + [force is None] * 3
    if force is not None:
        Y = Y - np.concatenate((np.zeros(3), force))
    sigma = None
    if noise is not None:
        N = np.concatenate([np.broadcast_to(np.asarray(v, dtype=np.float64), (3,)) for v in noise])
        if not (np.isfinite(N).all() and (N > 0.0).all()):
            raise InputError(f"noise: expected positive densities of gyroscopes and accelerometers, got {noise!r}")
        sigma = N * np.sqrt(rates.rate_hz)
    fit = thermal_ramp.curves(Y, T, ways, edges, T0, degree, at, relative, sigma)
    verdicts += _ramp_verdicts(dict(zip(names, fit, strict=True)), ways, span, force is None)
    values = np.array([0.0 if free else c.x[0] for c, free in zip(fit, relative, strict=True)])
    variances = np.array([np.inf if free else c.covariance[0, 0] for c, free in zip(fit, relative, strict=True)])
    y, blocks_T = thermal_log.means(Y, edges), thermal_log.means(T, edges)
    thermal = {
        "kind": "ramp",
        "reference_temperature": T0,
        "range": [float(T.min()), float(T.max())],
        "degree": {n: c.degree for n, c in zip(names, fit, strict=True)},
        "criterion": {n: c.criterion for n, c in zip(names, fit, strict=True)},
        "coefficients": {n: _coefficients(c, free) for n, c, free in zip(names, fit, relative, strict=True)},
        "covariance": {n: _covariance(c, free) for n, c, free in zip(names, fit, relative, strict=True)},
        "table": {"temperature": at.tolist()} | {n: c.table for n, c in zip(names, fit, strict=True)},
        "hysteresis": {n: c.hysteresis for n, c in zip(names, fit, strict=True)},
        "noise": {n: _noise(c) for n, c in zip(names, fit, strict=True)},
        "branches": [
            {"direction": "heating" if w.direction > 0 else "cooling", "from": w.start, "to": w.stop,
             "samples": int(w.last - w.first)} for w in ways
        ],
        "sensor": {"step": sensor.step, "stuck_samples": sensor.stuck, "spikes": int(bad.sum())},
    }  # fmt: skip
    limited = force is None or bool(verdicts)
    return CalibrationResult(
        "thermal", names, values, np.diag(variances), "full", status="warning" if limited else "ok",
        verdicts=tuple(verdicts), condition=float("nan"), freedom=min(c.freedom for c in fit),
        residuals={
            "gyro": thermal_ramp.residuals(fit[:3], y[:, :3], blocks_T, ways, edges, at, "rad/s"),
            "accel": thermal_ramp.residuals(fit[3:], y[:, 3:], blocks_T, ways, edges, at, "m/s^2"),
        },
        next_pose="soak at several temperatures in six or more poses, to tell scale factor from bias",
        temperature=T0, extra={"thermal": thermal},
    )  # fmt: skip


def _coefficients(curve: Curve, free: bool) -> list[float]:
    return [0.0 if free and k == 0 else float(v) for k, v in enumerate(curve.x)]


def _covariance(curve: Curve, free: bool) -> list[list[float]]:
    C = curve.covariance.copy()
    if free:  # the change from the reference temperature, which is zero there by definition
        C[0, :] = C[:, 0] = 0.0
    return [[float(v) for v in row] for row in C]


def _noise(curve: Curve) -> dict[str, float]:
    return {"sigma": curve.noise.sigma, "correlation_share_of_log": curve.noise.tau, "correlated": curve.noise.share}


def _sensor_verdicts(imu: ImuSeries, sensor: thermal_log.Repaired, spikes: int) -> list[str]:
    out = []
    assert imu.temperature is not None
    if thermal_log.unbelievable_stamps(imu.t, imu.temperature):
        out.append(
            f"time stamps: {np.ptp(imu.temperature):.0f} K within {imu.t[-1] - imu.t[0]:.3g} s is not credible; only "
            "the order of the samples was used"
        )
    if sensor.stuck:
        out.append(f"temperature: stuck during {sensor.stuck} samples, which were left out; check the sensor")
    if sensor.step > 0.0:
        out.append(f"temperature: comes in steps of {sensor.step:.2g} K; interpolated between the changes")
    if spikes:
        out.append(f"samples far off their neighbours, left out: {spikes}")
    return out


def _ramp_verdicts(fit: dict[str, Curve], ways: list[thermal_log.Branch], span: float, relative: bool) -> list[str]:
    out = []
    if span < NARROW_SPAN:
        out.append(f"the ramp spans {span:.1f} K only; do not use the result beyond it, and make a wider one")
    checked = [n for n, c in fit.items() if c.hysteresis["checked"]]
    if not checked:
        out.append(
            f"hysteresis cannot be checked: the temperature only {'rises' if ways[0].direction > 0 else 'falls'}; "
            "go back to where the ramp began"
        )
    for name, curve in fit.items():
        h = curve.hysteresis
        if h["found"]:
            out.append(
                f"{name}: heating and cooling differ by {h['largest']:+.2g} +- {h['sigma']:.1g} {unit(name)} at "
                f"{h['temperature']:.0f} degC; half of it remains after correction"
            )
        r = h.get("repeatability")
        size = float(np.ptp([v for v in curve.table["value"] if v is not None]))
        if r and r["beyond_white_noise"] and abs(r["difference"]) > max(0.05 * size, 0.25 * abs(h["largest"] or 0.0)):
            out.append(
                f"{name}: two branches of {r['direction']} differ by {r['difference']:+.2g} {unit(name)}: drift with "
                "time, not only temperature; let the unit warm up, then ramp twice"
            )
        higher = thermal_ramp.strongly_better(curve)
        if higher is not None:
            out.append(f"{name}: degree {curve.degree} leaves structure; degree {higher} describes it (BIC)")
    if relative:
        out.append(
            "b_a: one pose of unknown tilt gives only the change with temperature, and cannot tell bias from scale "
            "factor along the vertical; calibrate at one temperature in many poses, or give f_ib_b"
        )
    return out
