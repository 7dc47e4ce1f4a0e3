"""Poses on the faces of a cube with the accelerometers fitted to them, for all methods that begin so."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from schuler.arrays import FloatArray, IntArray
from schuler.calibration.bench.faces import Bias, Faces, face_variance, faces_of, fit_faces, pose_labels, tilted
from schuler.calibration.bench.gyro_readings import GyroReadings, readings_at_rest
from schuler.calibration.bench.joint_result import axis_residuals, describe_level
from schuler.calibration.bench.linear_fit import LinearFit
from schuler.calibration.bench.poses import Poses
from schuler.calibration.result.result import Residuals


class PosesOnFaces(NamedTuple):
    """Poses that lie on faces, and the accelerometers' fit.

    Attributes
    ----------
    poses, faces : Poses, Faces
        Those not tilted too far, n of them.
    k : ndarray of int, shape (n,)
        Their numbers among the poses given.
    gravity : float
        [m/s^2]
    accel : LinearFit
    residuals : Residuals
        Of the accelerometers. [m/s^2]
    level_sigma : float
        How level the faces are, given or from the residuals. [rad]
    tilted, missing : list of str
        Warnings: poses left out, faces without a pose.
    level : list of str
        Note on the level that came from the residuals.
    """

    poses: Poses
    faces: Faces
    k: IntArray
    gravity: float
    accel: LinearFit
    residuals: Residuals
    level_sigma: float
    tilted: list[str]
    missing: list[str]
    level: list[str]

    @property
    def temperature(self) -> float | None:
        """Mean temperature. [degC]"""
        return None if self.poses.temperature is None else float(self.poses.temperature.mean())

    def readings(
        self, latitude: float | None, headings: FloatArray | None, heading_sigma: float, instability: float
    ) -> GyroReadings:
        """Gyroscope readings, see :func:`schuler.calibration.bench.gyro_readings.readings_at_rest`.

        ``headings`` are those of all poses given, the tilted ones included.
        """
        return readings_at_rest(
            self.poses, self.faces, self.gravity * self.faces.up, latitude=latitude,
            headings=None if headings is None else headings[self.k], heading_sigma=heading_sigma,
            instability=instability,
        )  # fmt: skip


def fit_poses_on_faces(
    poses: Poses,
    gravity: float,
    *,
    names: Sequence[str] | None = None,
    improved: bool = True,
    bias: Bias,
    level_sigma: float | None,
    instability: float,
) -> PosesOnFaces:
    """Assign poses to faces, leave out tilted ones and fit the accelerometers.

    Parameters
    ----------
    poses, gravity, improved, bias, level_sigma
        See :func:`schuler.calibration.bench.sixposition.calibrate_sixposition`.
    names : sequence of str, optional
        See :func:`schuler.calibration.bench.faces.faces_of`.
    instability : float
        How much the biases change from pose to pose, 1 sigma. [m/s^2]

    Returns
    -------
    PosesOnFaces

    Raises
    ------
    InputError
        See :func:`schuler.calibration.bench.faces.faces_of`.
    """
    every = faces_of(poses, names)
    k = np.flatnonzero(every.usable)
    used, faces = poses.of(k), Faces(every.axis[k], every.sign[k], every.tilt[k], every.usable[k])
    fit, rows, level = fit_faces(
        used, faces, gravity, improved=improved, bias=bias, level_sigma=level_sigma, instability=instability
    )
    sigma = np.sqrt(face_variance(used, faces, gravity, level, instability))
    residuals = axis_residuals(
        pose_labels(used, faces), fit, rows, used.f - gravity * faces.up, sigma, "m/s^2", faces.up
    )
    absent = faces.missing
    return PosesOnFaces(
        used, faces, k, gravity, fit, residuals, level, tilted(poses, every),
        [f"only {6 - len(absent)} of the six faces: {', '.join(absent)} missing"] if absent else [],
        describe_level(level) if level_sigma is None else [],
    )  # fmt: skip
