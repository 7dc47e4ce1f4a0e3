"""Solution of all methods that turn the unit by known amounts: poses at rest and turns in one adjustment."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from schuler.arrays import ArrayLike, FloatArray, IntArray, as_floats
from schuler.calibration.bench.faces import Bias, Faces, checked_latitude
from schuler.calibration.bench.gyro_readings import GyroReadings, gyro_fit
from schuler.calibration.bench.halves import halved
from schuler.calibration.bench.joint_result import axis_residuals, bench_result, describe_earth_rate
from schuler.calibration.bench.linear_fit import LinearFit
from schuler.calibration.bench.poses import Poses
from schuler.calibration.bench.poses_on_faces import PosesOnFaces, fit_poses_on_faces
from schuler.calibration.bench.turns import Turns, readings_of_turns
from schuler.calibration.result.parameters import BIAS_A, BIAS_G, LINEAR, MATRIX_A, MATRIX_G, SENSITIVITY
from schuler.calibration.result.result import CalibrationResult, Residuals
from schuler.exceptions import InputError
from schuler.units import DEG

#: What determines a family of parameters.
ADVICE = {
    "b_a": "put the unit still on all six faces",
    "M_a": "put the unit still on all six faces",
    "b_g": "add poses at rest, or turn both ways about each axis",
    "M_g": "turn about each of the three axes of the unit, best both ways",
    "G_g": "add poses at rest on all six faces, or turn about each axis with its upper end up and with it down",
}


def solve_turns(
    method: str,
    turns: Turns,
    poses: Poses | None,
    *,
    gravity: float,
    g_sensitivity: bool,
    latitude: float | None,
    headings: ArrayLike | None,
    axis_n: ArrayLike | None,
    accel: CalibrationResult | None,
    accel_wanted: bool,
    bias: Bias,
    level_sigma: float | None,
    heading_sigma: float,
    sigmas: Mapping[str, float | None],
    instability: tuple[float, float],
    own_axis_only: bool = False,
    fit: Callable[[GyroReadings, Poses, Faces, Turns], LinearFit] | None = None,
    notes: tuple[str, ...] = (),
    extra: Mapping[str, Any] | None = None,
    halves: bool = True,
    **rest: Any,
) -> CalibrationResult:
    """See :func:`schuler.calibration.bench.ratetable.calibrate_ratetable`; here only what differs.

    Parameters
    ----------
    method : str
    accel_wanted : bool
        Refuse where the accelerometers are not determined; else leave them out.
    sigmas : mapping of str to float or None
        ``angle_sigma``, ``rate_sigma``, ``axis_sigma`` of :func:`schuler.calibration.bench.turns.readings_of_turns`.
        None: as the faces are level.
    own_axis_only : bool
        Each gyroscope from turns about its own axis only.
    fit : callable, optional
        Another linear estimator of the gyroscopes.
    notes : tuple of str
        Further remarks.
    extra : mapping, optional
        For the result; ``level_sigma`` is added.
    halves : bool
        Hold the claims against halves of the poses; turns are shared by both, so the response is not compared.
    rest
        Further fields of the result.

    Returns
    -------
    CalibrationResult

    Raises
    ------
    InputError
        See there.
    """
    _check(turns, gravity, latitude, g_sensitivity)
    if headings is not None and poses is not None:
        headings = as_floats(headings, "headings", (len(poses),))
    all_headings = None if headings is None else np.asarray(headings)
    options = {
        "gravity": gravity, "g_sensitivity": g_sensitivity, "latitude": latitude, "bias": bias,
        "level_sigma": level_sigma, "heading_sigma": heading_sigma, **sigmas, "instability": list(instability),
        "headings": None if headings is None else np.asarray(headings).tolist(),
        "axis_n": None if axis_n is None else np.asarray(axis_n).tolist(),
        "accel": None if accel is None else accel.provenance,
    }  # fmt: skip
    remarks, warnings, also = list(notes), [], dict(extra or {})
    fits: dict[str, LinearFit] = {}
    residuals: dict[str, Residuals] = {}
    at_rest: PosesOnFaces | None = None
    if poses is not None and len(poses):
        at_rest = fit_poses_on_faces(poses, gravity, bias=bias, level_sigma=level_sigma, instability=instability[1])
        warnings += at_rest.tilted
        if accel is None and (accel_wanted or not at_rest.accel.confounded):
            fits["accel"], residuals["accel"] = at_rest.accel, at_rest.residuals
            also["level_sigma"] = at_rest.level_sigma
            remarks += at_rest.level
            warnings += at_rest.missing
        elif accel is None:
            remarks.append("the accelerometers are not calibrated: not at rest on " + ", ".join(at_rest.faces.missing))
    stated = {name: 0.0 if value is None else value for name, value in sigmas.items()}
    if None in sigmas.values():
        by_hand = float(also.get("level_sigma") or 0.0)
        stated |= _as_level(sigmas, by_hand)
        also |= stated
        remarks += _describe_level_of_turns(by_hand)
    readings, doubts = readings_of_turns(
        turns, force_in_turns(turns, fits.get("accel"), accel), gravity=gravity, latitude=latitude, axis_n=axis_n,
        instability=instability[0], **stated,
    )  # fmt: skip
    if at_rest is not None:
        still = at_rest.readings(latitude, all_headings, heading_sigma, instability[0])
        readings = GyroReadings.joined([still, readings])
    if fit is not None and at_rest is not None:
        fits["gyro"] = fit(readings, at_rest.poses, at_rest.faces, turns)
        rows_g: IntArray = np.arange(3 * len(readings))
    else:
        fits["gyro"], rows_g = gyro_fit(
            readings, response=True, g_sensitivity=g_sensitivity, own_axis_only=own_axis_only
        )
    if latitude is None:
        remarks.append(describe_earth_rate(g_sensitivity))
    residuals["gyro"] = _residuals_of_rates(readings, fits["gyro"], rows_g)
    result = bench_result(
        method, fits, advice=ADVICE, warnings=[*warnings, *doubts], notes=remarks, residuals=residuals, options=options,
        names=LINEAR if "accel" in fits else BIAS_G + MATRIX_G + SENSITIVITY,
        temperature=None if at_rest is None else at_rest.temperature,
        extra=also, **rest,
    )  # fmt: skip
    if not halves or poses is None or not len(poses):
        return result

    # a half of the faces cannot tell how level they are
    level_held = also.get("level_sigma", level_sigma)

    def part(some: Poses, k: IntArray) -> CalibrationResult:
        return solve_turns(
            method, turns, some, gravity=gravity, g_sensitivity=g_sensitivity, latitude=latitude,
            headings=None if all_headings is None else all_headings[k], axis_n=axis_n, accel=accel,
            accel_wanted=accel_wanted, bias=bias, level_sigma=level_held, heading_sigma=heading_sigma, sigmas=stated,
            instability=instability, own_axis_only=own_axis_only, fit=fit, halves=False,
        )  # fmt: skip

    return halved(result, poses, part, shared=("M_g",))


def _check(turns: Turns, gravity: float, latitude: float | None, g_sensitivity: bool) -> None:
    """Refuse what no adjustment can use; see :func:`solve_turns`."""
    if not (np.isfinite(gravity) and gravity > 0.0):
        raise InputError(f"gravity: expected a positive number of m/s^2, got {gravity!r}")
    if latitude is not None:
        checked_latitude(latitude)
    if g_sensitivity and turns.f is None:
        raise InputError(
            "turns: expected their specific force for the g-sensitivity; record it or say g_sensitivity=False"
        )


def force_in_turns(turns: Turns, fit: LinearFit | None, accel: CalibrationResult | None) -> FloatArray | None:
    """Mean specific force of turns, calibrated as far as a calibration is there. Shape (n, 3). [m/s^2]"""
    if turns.f is None:
        return None
    if accel is not None:
        b, M = accel.errors.b_a, accel.errors.M_a
    elif fit is not None and not fit.confounded:
        at = dict(zip(fit.names, fit.values, strict=True))
        b = np.array([at[n] for n in BIAS_A])
        M = np.array([at[n] for n in MATRIX_A]).reshape(3, 3)
    else:
        return turns.f
    return np.asarray(np.linalg.solve(np.eye(3) + M, (turns.f - b).T).T)


def _as_level(sigmas: Mapping[str, float | None], by_hand: float) -> dict[str, float]:
    """Sigmas of turns that nobody states: as level as the faces are; an angle is between two of them. [rad]"""
    return {name: by_hand * (np.sqrt(2.0) if name == "angle_sigma" else 1.0) for name, v in sigmas.items() if v is None}


def _describe_level_of_turns(by_hand: float) -> list[str]:
    """Note on turns that are as level as the faces; none where these are level."""
    if not by_hand:
        return []
    return [
        f"turns are whole to {np.sqrt(2.0) * by_hand / DEG:.2g} deg and their axes true to {by_hand / DEG:.2g} "
        "deg, as the faces are level; state angle_sigma and axis_sigma if a fixture does better"
    ]


def _residuals_of_rates(readings: GyroReadings, fit: LinearFit, rows: IntArray) -> Residuals:
    """Residuals of the gyroscopes, each with the direction of the rate that it should have read."""
    length = np.maximum(np.linalg.norm(readings.reference, axis=1, keepdims=True), 1e-30)
    return axis_residuals(
        readings.label, fit, rows, readings.measured - readings.reference, readings.sigma, "rad/s",
        readings.reference / length,
    )  # fmt: skip
