"""Ferraris calibration: six faces at rest and one turn about each axis, nothing but a flat table."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Literal, TypeAlias

import numpy as np

from schuler.arguments import explains_arguments
from schuler.arrays import ArrayLike, FloatArray
from schuler.calibration.bench.faces import Bias, Faces
from schuler.calibration.bench.gyro_readings import GyroReadings, gyro_design
from schuler.calibration.bench.linear_fit import LinearFit, from_gain
from schuler.calibration.bench.poses import Poses, poses_of
from schuler.calibration.bench.turn_solution import solve_turns
from schuler.calibration.bench.turns import Turns, turns_of
from schuler.calibration.magnetometer.calibrate import with_poses
from schuler.calibration.result.parameters import AXES
from schuler.calibration.result.result import CalibrationResult
from schuler.exceptions import InputError
from schuler.recording.series import ImuSeries
from schuler.units import G0

Estimator: TypeAlias = Literal["weighted", "ferraris"]
#: Sections of a session: x_p at rest with x up ("parallel"), x_a with x down ("antiparallel"), x_rot the turn about x.
SECTIONS = tuple(f"{a}_{what}" for what in ("p", "a") for a in AXES) + tuple(f"{a}_rot" for a in AXES)


@explains_arguments
def calibrate_ferraris(
    imu: ImuSeries,
    sections: Mapping[str, tuple[float, float]] | None = None,
    *,
    turn_angle: float = 2.0 * np.pi,
    gravity: float = G0,
    g_sensitivity: bool = True,
    latitude: float | None = None,
    noise: tuple[ArrayLike, ArrayLike] | None = None,
    nominal: tuple[float, float] = (1.0, 1.0),
    bias: Bias = "all faces",
    estimator: Estimator = "weighted",
    level_sigma: float | None = None,
    angle_sigma: float | None = None,
    axis_sigma: float | None = None,
    instability: tuple[float, float] = (0.0, 0.0),
    field_strength: float | None = None,
    soft_iron: bool | None = None,
) -> CalibrationResult:
    """Calibrate from six faces and three turns.

    Parameters
    ----------
    imu : ImuSeries
        The session.
    sections : mapping of str to (start, stop), optional
        First and last time of each of :data:`SECTIONS`. [s] None: found by
        :func:`schuler.calibration.bench.turns_in_log.ferraris_sections`, several poses of a face included.
    turn_angle : float
        Angle of each turn about +x, +y, +z, right-handed: negative if the unit was turned clockwise seen from the tip
        of the axis. [rad] Where sections are found, its sign is taken from the gyroscopes.
    gravity : float
        Local gravity. [m/s^2]
    g_sensitivity : bool
        Estimate G_g; False holds it at zero.
    latitude : float, optional
        For Earth rate: the vertical part during rest and turns; the horizontal part stays in the uncertainty, because a
        session knows no headings. [rad]
    noise : (array_like, array_like), optional
        N of gyroscopes [rad/s/sqrt(Hz)] and accelerometers [m/s^2/sqrt(Hz)]. None: from the scatter at rest.
    nominal : (float, float)
        Factors of accelerometer [m/s^2 per unit of the log] and gyroscope [rad/s per unit of the log] for a log in
        counts.
    bias, level_sigma
        See :func:`schuler.calibration.bench.sixposition.calibrate_sixposition`.
    estimator : {"weighted", "ferraris"}
        Of the gyroscopes. "weighted": least squares of all readings. "ferraris": the closed form of the source in the
        steps of imucal: bias as mean of all samples at rest, g-sensitivity from differences, then the turns. It needs
        one pose on each face. Its bias takes up g-sensitivity where the poses are not equally long.
    angle_sigma, axis_sigma : float, optional
        1 sigma of the angle of each turn and of the direction of each axis of turning. None: what the faces say by how
        level they are (``level_sigma``), times sqrt(2) for the angle, whose both ends are put down by hand. [rad]
    instability : (float, float)
        How much the biases of gyroscope [rad/s] and accelerometer [m/s^2] change from section to section, 1 sigma.
    field_strength : float, optional
        Strength of the local magnetic field, for the scale of a magnetometer. None: relative. [T]
    soft_iron : bool, optional
        Estimate the soft iron of a magnetometer. None: with nine poses or more.

    Returns
    -------
    CalibrationResult
        Gauge "full": body axes are normal to the faces.

    Raises
    ------
    InputError
        If a section is missing or too short, or the closed form is asked for where it does not exist.

    Notes
    -----
    The mean rate of a turn is its angle over its duration T; white noise leaves N/sqrt(T) on it, or N sqrt(T) on the
    angle. The bias that a turn is freed from is estimated in the same adjustment, so its uncertainty counts.

    References
    ----------
    Ferraris, Grimaldi, Parvis (1995), Sensors and Materials 7(5); notation of imucal (Kuederle et al. 2022), whose
    ``K R`` is ``(I + M)/nominal`` and whose ``K_ga`` is ``G_g/nominal``.
    """
    from schuler.calibration.bench.turns_in_log import ferraris_sections

    if estimator not in ("weighted", "ferraris"):
        raise InputError(f"estimator: expected 'weighted' or 'ferraris', got {estimator!r}")
    if imu.kind == "increment":
        imu = imu.rates()
    imu = replace(imu, accel=imu.accel * nominal[0], gyro=imu.gyro * nominal[1])
    if sections is None:
        rest_spans, turn_spans, angle, notes = ferraris_sections(imu, turn_angle=abs(turn_angle), gravity=gravity)
    else:
        missing = [name for name in SECTIONS if name not in sections]
        if missing:
            raise InputError(f"sections: expected {', '.join(SECTIONS)}; missing: {', '.join(missing)}")
        rest_spans = [sections[name] for name in SECTIONS[:6]]
        turn_spans = [sections[name] for name in SECTIONS[6:]]
        angle, notes = turn_angle * np.eye(3), ()
    poses = poses_of(imu, rest_spans, noise=noise, gravity=gravity)
    turns = turns_of(imu, turn_spans, angle=angle, noise=_noise(poses) if noise is None else noise[0])
    fit = None
    if estimator == "ferraris":
        if not g_sensitivity or len(poses) != 6 or len(turns) != 3:
            raise InputError(
                f"estimator: 'ferraris' takes six poses, three turns and the g-sensitivity, got {len(poses)} poses and "
                f"{len(turns)} turns; use 'weighted'"
            )
        fit = _closed_form
    result = solve_turns(
        "ferraris", turns, poses, gravity=gravity, g_sensitivity=g_sensitivity, latitude=latitude, headings=None,
        axis_n=None, accel=None, accel_wanted=True, bias=bias, level_sigma=level_sigma, heading_sigma=0.0,
        sigmas={"angle_sigma": angle_sigma, "axis_sigma": axis_sigma}, instability=instability, fit=fit, notes=notes,
        nominal=nominal,
        extra={
            "estimator": estimator,
            "sections": {"rest": [list(s) for s in rest_spans], "turns": [list(s) for s in turn_spans]},
        },
    )  # fmt: skip
    return with_poses(result, replace(poses, f=poses.f / nominal[0]), field_strength, soft_iron)


def _noise(poses: Poses) -> FloatArray:
    """N of the gyroscopes from the uncertainty of means at rest. Shape (3,). [rad/s/sqrt(Hz)]"""
    return np.asarray(np.sqrt(np.mean(np.square(poses.sigma_omega) * poses.duration[:, None], axis=0)))


def _closed_form(readings: GyroReadings, poses: Poses, faces: Faces, turns: Turns) -> LinearFit:
    """Bias, then g-sensitivity, then response, as a matrix that multiplies the readings."""
    if faces.missing:
        raise InputError(f"estimator: 'ferraris' needs one pose on each face; missing: {', '.join(faces.missing)}")
    A, names = gyro_design(readings, response=True, g_sensitivity=True)
    y = (readings.measured - readings.reference).ravel()
    n, rest = len(readings), len(poses)
    index = poses.index
    samples = np.diff(index, axis=1)[:, 0] if index is not None else poses.duration
    # what the source forms of the readings of one axis: a mean, three turns, three differences over 2 g
    H = np.zeros((7, n))
    H[0, :rest] = samples / samples.sum()
    H[1:4, rest:] = np.eye(3)
    for k, up in enumerate(faces.up):
        H[4:, k] = up / (2.0 * np.abs(readings.f[k]).max())
    # ... and what is in them; that the mean also holds G f where poses are not equally long is what the source neglects
    K = H @ np.column_stack((np.ones(n), readings.reference, readings.f))
    K[0, 4:] = 0.0
    row = np.linalg.solve(K, H)
    axes = np.zeros((3, 7, n, 3))
    for i in range(3):
        axes[i, :, :, i] = row
    gain = axes.reshape(21, 3 * n)
    M_g = (gain @ y).reshape(3, 7)[:, 1:4]
    return from_gain(A, y, readings.covariance(M_g), names, gain)
