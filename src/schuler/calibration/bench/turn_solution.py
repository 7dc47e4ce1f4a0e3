"""Solution of all methods that turn the unit by known amounts: poses at rest and turns in one adjustment."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import numpy as np

from schuler.arrays import ArrayLike, FloatArray, IntArray, as_floats
from schuler.calibration.bench.faces import (
    Bias,
    Faces,
    checked_latitude,
    face_variance,
    faces_of,
    fit_faces,
    pose_labels,
    tilted,
)
from schuler.calibration.bench.gyro_readings import GyroReadings, gyro_fit, readings_at_rest
from schuler.calibration.bench.halves import halved
from schuler.calibration.bench.joint_result import axis_residuals, bench_result, describe_earth_rate, describe_level
from schuler.calibration.bench.linear_fit import LinearFit
from schuler.calibration.bench.poses import Poses
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


class _Rest(NamedTuple):
    """Poses on faces: what the gyroscopes read there, the accelerometers' fit if there is one, and what to say."""

    poses: Poses
    faces: Faces
    readings: GyroReadings
    accel: LinearFit | None
    residuals: Residuals | None
    level_sigma: float
    remarks: list[str]
    warnings: list[str]

    @property
    def temperature(self) -> float | None:
        """Mean temperature. [degC]"""
        return None if self.poses.temperature is None else float(self.poses.temperature.mean())


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
    if not (np.isfinite(gravity) and gravity > 0.0):
        raise InputError(f"gravity: expected a positive number of m/s^2, got {gravity!r}")
    if latitude is not None:
        checked_latitude(latitude)
    if g_sensitivity and turns.f is None:
        raise InputError(
            "turns: expected their specific force for the g-sensitivity; record it or say g_sensitivity=False"
        )
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
    remarks, warnings = list(notes), []
    also = dict(extra or {})
    at_rest: _Rest | None = None
    if poses is not None and len(poses):
        at_rest = _at_rest(
            poses, gravity, latitude, all_headings, heading_sigma=heading_sigma, level_sigma=level_sigma, bias=bias,
            instability=instability, wanted=accel is None, required=accel_wanted,
        )  # fmt: skip
        remarks += at_rest.remarks
        warnings += at_rest.warnings
        if at_rest.accel is not None:
            also["level_sigma"] = at_rest.level_sigma
    fits: dict[str, LinearFit] = {}
    residuals: dict[str, Residuals] = {}
    if at_rest is not None and at_rest.accel is not None and at_rest.residuals is not None:
        fits["accel"], residuals["accel"] = at_rest.accel, at_rest.residuals
    stated = {name: 0.0 if value is None else value for name, value in sigmas.items()}
    if None in sigmas.values():
        by_hand = float(also.get("level_sigma") or 0.0)
        stated |= _as_level(sigmas, by_hand)
        also |= stated
        if by_hand:
            remarks.append(
                f"turns are whole to {np.sqrt(2.0) * by_hand / DEG:.2g} deg and their axes true to {by_hand / DEG:.2g} "
                "deg, as the faces are level; state angle_sigma and axis_sigma if a fixture does better"
            )
    turning, doubts = readings_of_turns(
        turns, force_in_turns(turns, fits.get("accel"), accel), gravity=gravity, latitude=latitude, axis_n=axis_n,
        instability=instability[0], **stated,
    )  # fmt: skip
    readings = GyroReadings.joined([turning] if at_rest is None else [at_rest.readings, turning])
    if fit is not None and at_rest is not None:
        fits["gyro"] = fit(readings, at_rest.poses, at_rest.faces, turns)
        rows_g: IntArray = np.arange(3 * len(readings))
    else:
        fits["gyro"], rows_g = gyro_fit(
            readings, response=True, g_sensitivity=g_sensitivity, own_axis_only=own_axis_only
        )
    if latitude is None:
        remarks.append(describe_earth_rate(g_sensitivity))
    length = np.maximum(np.linalg.norm(readings.reference, axis=1, keepdims=True), 1e-30)
    residuals["gyro"] = axis_residuals(
        readings.label, fits["gyro"], rows_g, readings.measured - readings.reference, readings.sigma, "rad/s",
        readings.reference / length,
    )  # fmt: skip
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


def _at_rest(
    poses: Poses, gravity: float, latitude: float | None, headings: ArrayLike | None, *, heading_sigma: float,
    level_sigma: float | None, bias: Bias, instability: tuple[float, float], wanted: bool, required: bool,
) -> _Rest:  # fmt: skip
    """Use the poses that lie on faces; the accelerometers are fitted where wanted, if determined or required."""
    faces = faces_of(poses)
    warnings, remarks = tilted(poses, faces), []
    k = np.flatnonzero(faces.usable)
    used, faces = poses.of(k), Faces(faces.axis[k], faces.sign[k], faces.tilt[k], faces.usable[k])
    readings = readings_at_rest(
        used, faces, gravity * faces.up, latitude=latitude,
        headings=None if headings is None else np.asarray(headings)[k], heading_sigma=heading_sigma,
        instability=instability[0],
    )  # fmt: skip
    fit, rows, level = fit_faces(used, faces, gravity, bias=bias, level_sigma=level_sigma, instability=instability[1])
    residuals = None
    if wanted and (required or not fit.confounded):
        sigma = np.sqrt(face_variance(used, faces, gravity, level, instability[1]))
        residuals = axis_residuals(
            pose_labels(used, faces), fit, rows, used.f - gravity * faces.up, sigma, "m/s^2", faces.up
        )
        remarks += describe_level(level) if level_sigma is None else []
        if faces.missing:
            warnings.append(f"only {6 - len(faces.missing)} of the six faces: {', '.join(faces.missing)} missing")
    elif wanted:
        remarks.append("the accelerometers are not calibrated: not at rest on " + ", ".join(faces.missing))
    return _Rest(used, faces, readings, None if residuals is None else fit, residuals, level, remarks, warnings)


def _as_level(sigmas: Mapping[str, float | None], by_hand: float) -> dict[str, float]:
    """Sigmas of turns that nobody states: as level as the faces are; an angle is between two of them. [rad]"""
    return {name: by_hand * (np.sqrt(2.0) if name == "angle_sigma" else 1.0) for name, v in sigmas.items() if v is None}
