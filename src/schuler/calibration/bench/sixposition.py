"""Six-position test: bias, scale factor and cross-coupling from poses on the six faces of a cube."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal, TypeAlias

import numpy as np

from schuler.arguments import explains_arguments
from schuler.arrays import ArrayLike, FloatArray, IntArray, as_floats
from schuler.calibration.bench.faces import Bias, Faces, checked_latitude, fit_faces
from schuler.calibration.bench.gyro_readings import gyro_fit
from schuler.calibration.bench.halves import halved
from schuler.calibration.bench.joint_result import axis_residuals, bench_result, describe_earth_rate
from schuler.calibration.bench.linear_fit import LinearFit
from schuler.calibration.bench.poses import Poses
from schuler.calibration.bench.poses_on_faces import PosesOnFaces, fit_poses_on_faces
from schuler.calibration.magnetometer.calibrate import estimates_soft_iron, with_poses
from schuler.calibration.result.parameters import AXES, BIAS_A, BIAS_G, MATRIX_A, MATRIX_G, SENSITIVITY
from schuler.calibration.result.result import CalibrationResult, Residuals
from schuler.earth import WGS84
from schuler.exceptions import InputError
from schuler.units import DEG, G0, PPM

Gyro: TypeAlias = Literal["none", "bias", "g-sensitivity", "vertical", "response"]
_ESTIMATED = {
    "none": (),
    "bias": BIAS_G,
    "g-sensitivity": BIAS_G + SENSITIVITY,
    "vertical": BIAS_G + tuple(f"M_g_{a}{a}" for a in AXES),
    "response": BIAS_G + MATRIX_G,
}


@explains_arguments
def calibrate_sixposition(
    poses: Poses,
    *,
    gravity: float = G0,
    improved: bool = True,
    latitude: float | None = None,
    headings: ArrayLike | None = None,
    faces: Sequence[str] | None = None,
    bias: Bias = "all faces",
    level_sigma: float | None = None,
    heading_sigma: float = 0.0,
    gyro: Gyro | None = None,
    instability: tuple[float, float] = (0.0, 0.0),
    halves: bool = True,
    field_strength: float | None = None,
    soft_iron: bool | None = None,
) -> CalibrationResult:
    """Calibrate on the six faces.

    Parameters
    ----------
    poses : Poses
        At least one on each of the six faces, in any order; several on one face are averaged by their weights. A pose
        tilted by more than 20 deg is left out with a warning.
    gravity : float
        Local gravity. [m/s^2]
    improved : bool
        True: bias and all nine elements of M_a (12 parameters). False: bias and scale factor of each axis by itself.
    latitude : float, optional
        For Earth rate. [rad]
    headings : array_like, shape (n,), optional
        Of each pose, see :func:`schuler.calibration.bench.faces.earth_rate_on_faces`. [rad]
    faces : sequence of str, optional
        ``"x up"``, ...; None: found from the specific force.
    bias : {"all faces", "own axis"}
        Of the improved test. "own axis" takes the bias of an axis from the two faces on which it is vertical, where a
        tilt of the fixture counts in second order only; the mean of all six is less noisy, but a tilt counts in full.
    level_sigma : float, optional
        How level the faces are, 1 sigma. [rad] None: zero, or, where the residuals are larger than noise explains,
        estimated from them.
    heading_sigma : float
        1 sigma of the headings. [rad]
    gyro : {"none", "bias", "g-sensitivity", "vertical", "response"}, optional
        What to find out about the gyroscopes: nothing; their bias; bias and g-sensitivity; bias and scale factor from
        the vertical component of Earth rate; bias and all of M_g from the whole of it. None: "response" if latitude
        and headings are given (and ``improved``), "vertical" if the latitude is, else "bias"; "bias" too where the
        means are noisier than a tenth of Earth rate, because M_g would be noise.
    instability : (float, float)
        How much the biases of gyroscope [rad/s] and accelerometer [m/s^2] change from pose to pose, 1 sigma.
    halves : bool
        Hold the claims against halves of the poses, see :mod:`schuler.calibration.bench.halves`.
    field_strength : float, optional
        Strength of the local magnetic field, for the scale of a magnetometer. None: relative. [T]
    soft_iron : bool, optional
        Estimate the soft iron of a magnetometer. None: with nine poses or more.

    Returns
    -------
    CalibrationResult
        Gauge "full": body axes are those of the fixture, x up where a face says so. Refused if a parameter that was
        asked for is not determined.

    Raises
    ------
    InputError
        If gravity is not positive, a name of a face is unknown, headings do not fit the poses, or ``gyro`` needs
        latitude or headings that are missing.

    Notes
    -----
    Standard: ``b = (Y_up + Y_down)/2``, ``S = (Y_up - Y_down)/(2 g) - 1``. Where an axis is not along the fixture's by
    an angle d, its scale factor comes out too small by ``1 - cos d``; the test cannot see d, but the readings of the
    other faces show it, and the verdict says how much it is. Improved: weighted least squares of
    ``Y = b + (I + M) f`` on all readings, the 3 x 4 matrix of Shin and El-Sheimy written as errors.

    A tilted face moves the readings of the two horizontal axes by g times the tilt. With ``level_sigma`` those get
    that much more variance, so that "all faces" goes over into "own axis" where the fixture is the larger error.

    References
    ----------
    Hayal (2010), section 2.4.1.1, eqs. (2.3) to (2.6), with the gyroscopes' reference corrected to the whole vector of
    Earth rate; Titterton and Weston (2004), section 8.3.2.
    """
    if not (np.isfinite(gravity) and gravity > 0.0):
        raise InputError(f"gravity: expected a positive number of m/s^2, got {gravity!r}")
    if bias not in ("all faces", "own axis"):
        raise InputError(f"bias: expected 'all faces' or 'own axis', got {bias!r}")
    mode, notes = _gyro_mode(poses, gyro, improved, latitude, headings)
    if headings is not None:
        headings = as_floats(headings, "headings", (len(poses),))
    options = {
        "gravity": gravity, "improved": improved, "latitude": latitude, "bias": bias, "level_sigma": level_sigma,
        "heading_sigma": heading_sigma, "gyro": mode, "instability": list(instability),
        "headings": None if headings is None else headings.tolist(),
    }  # fmt: skip
    at_rest = fit_poses_on_faces(
        poses, gravity, names=faces, improved=improved, bias=bias, level_sigma=level_sigma, instability=instability[1]
    )
    warnings = at_rest.tilted + at_rest.missing
    notes += at_rest.level
    missing = at_rest.faces.missing
    if not improved:
        warnings += _cosine(at_rest.poses, at_rest.faces, gravity, at_rest.accel)
    fits, residuals = {"accel": at_rest.accel}, {"accel": at_rest.residuals}
    if mode != "none":
        fits["gyro"], residuals["gyro"] = _gyro(at_rest, mode, latitude, headings, heading_sigma, instability[0])
        if latitude is None:
            notes.append(describe_earth_rate(mode == "g-sensitivity"))
        warnings += _too_weak(fits["gyro"])
        if mode == "bias" and fits["gyro"].chi2 > fits["gyro"].limit():
            notes.append("gyro='g-sensitivity' would explain gyroscopes that read differently from face to face")
    asked = (*BIAS_A, *MATRIX_A, *(BIAS_G + MATRIX_G + SENSITIVITY if mode != "none" else ()))
    here = f"put the unit still with {' and with '.join(missing)}" if missing else "put the unit on all six faces"
    result = bench_result(
        "sixposition", fits,
        advice={
            "b_a": here, "M_a": here, "b_g": here, "G_g": here,
            "M_g": f"{here}, with other headings; if the gyroscopes are weak, use a rate table",
        },
        warnings=warnings, notes=notes, residuals=residuals, options=options, names=asked,
        next_pose=here if missing else "",
        temperature=at_rest.temperature,
        extra={"faces": list(at_rest.faces.names), "level_sigma": at_rest.level_sigma},
    )  # fmt: skip
    result = with_poses(result, at_rest.poses, field_strength, soft_iron)
    if not halves:
        return result

    def part(some: Poses, k: IntArray) -> CalibrationResult:
        return calibrate_sixposition(
            some, gravity=gravity, improved=improved, latitude=latitude, bias=bias,
            level_sigma=at_rest.level_sigma, headings=None if headings is None else headings[k],
            heading_sigma=heading_sigma, gyro=mode, instability=instability,
            faces=None if faces is None else [faces[int(i)] for i in k], halves=False,
            field_strength=field_strength, soft_iron=estimates_soft_iron(result),
        )  # fmt: skip

    return halved(result, poses, part)


def _gyro(
    at_rest: PosesOnFaces, mode: Gyro, latitude: float | None, headings: FloatArray | None, heading_sigma: float,
    instability: float,
) -> tuple[LinearFit, Residuals]:  # fmt: skip
    """Fit of the gyroscopes to their readings on the faces, and its residuals."""
    readings = at_rest.readings(latitude, headings, heading_sigma, instability)
    fit, rows = gyro_fit(
        readings,
        response=mode in ("vertical", "response"),
        g_sensitivity=mode == "g-sensitivity",
        own_axis_only=mode == "vertical",
    )
    return fit, axis_residuals(
        readings.label, fit, rows, readings.measured - readings.reference, readings.sigma, "rad/s", at_rest.faces.up
    )


def _gyro_mode(
    poses: Poses, gyro: Gyro | None, improved: bool, latitude: float | None, headings: ArrayLike | None
) -> tuple[Gyro, list[str]]:
    """What to find out about the gyroscopes, and a sentence if that is less than the arguments would allow."""
    if latitude is not None:
        checked_latitude(latitude)
    if gyro is None:
        if latitude is None:
            return "bias", []
        if len(poses) and np.median(poses.sigma_omega) > 0.1 * WGS84.omega_ie:
            return "bias", [
                "the gyroscopes are too noisy for Earth rate to show their scale factors; a rate table or the turns of "
                "calibrate_ferraris do"
            ]
        return ("response" if improved and headings is not None else "vertical"), []
    if gyro not in _ESTIMATED:
        raise InputError(f"gyro: expected one of {', '.join(_ESTIMATED)}, got {gyro!r}")
    if gyro in ("vertical", "response") and latitude is None:
        raise InputError(f"latitude: expected radians for gyro={gyro!r}, because Earth rate is the reference")
    if gyro == "response" and headings is None:
        raise InputError(
            "headings: expected one for each pose, because horizontal axes see the north component of Earth rate; "
            "without them use gyro='vertical'"
        )
    return gyro, []


def _cosine(poses: Poses, faces: Faces, gravity: float, standard: LinearFit) -> list[str]:
    """What the standard test loses because axes are not along the fixture's."""
    full, _, _ = fit_faces(poses, faces, gravity, bias="own axis")
    if not full.determined.all() or not standard.determined.all():
        return []
    at = dict(zip(full.names, full.values, strict=True))
    sigma = dict(zip(standard.names, np.sqrt(np.diag(standard.covariance)), strict=True))
    sentences = []
    for a in AXES:
        cross = [at[f"M_a_{a}{b}"] for b in AXES if b != a]
        angle = float(np.arctan2(np.hypot(*cross), 1.0 + at[f"M_a_{a}{a}"]))
        loss = float(np.cos(angle)) - 1.0
        if abs(loss) > max(sigma[f"M_a_{a}{a}"], PPM):
            sentences.append(
                f"the {a} accelerometer is {angle / DEG:.2g} deg off the fixture's axis, so its scale factor comes out "
                f"{loss / PPM:.0f} ppm (cos - 1) off; the improved test accounts for it"
            )
    return sentences


def _too_weak(fit: LinearFit) -> list[str]:
    weak = [
        n
        for n, v in zip(fit.names, np.diag(fit.covariance), strict=True)
        if n.startswith("M_g") and 0.01 < v < np.inf  # sigma of 10 %
    ]
    if not weak:
        return []
    return [
        f"Earth rate is too weak a reference for these gyroscopes: {', '.join(weak)} known to worse than 10 %; use a "
        "rate table"
    ]
