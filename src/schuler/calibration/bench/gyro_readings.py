"""Mean readings of gyroscopes with the rates that caused them: poses at rest and turns, with Earth rate."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from schuler.arrays import ArrayLike, FloatArray, IntArray
from schuler.calibration.bench.faces import Faces, checked_latitude, earth_rate_on_faces, pose_labels
from schuler.calibration.bench.linear_fit import LinearFit, linear_fit, response_design
from schuler.calibration.bench.poses import Poses
from schuler.calibration.result.parameters import AXES, BIAS_G, MATRIX_G, SENSITIVITY
from schuler.earth import WGS84, earth_rate_ned


@dataclass(frozen=True, eq=False)
class GyroReadings:
    """What three gyroscopes read in the mean, and what they should have read.

    Attributes
    ----------
    label : tuple of str, length n
    measured, reference : ndarray, shape (n, 3)
        Mean rate as measured and as known, inertial, in the axes of the fixture. [rad/s]
    f : ndarray, shape (n, 3)
        Mean specific force, for the g-sensitivity. [m/s^2]
    noise : ndarray, shape (n, 3)
        1-sigma of measured, independent. [rad/s]
    doubt : ndarray, shape (n, 3)
        1-sigma of reference, independent. [rad/s]
    common : ndarray, shape (k, n, 3), k > 0
        Errors of the reference shared by readings: each of the k times one number of standard deviation 1. The first is
        Earth rate along the vertical, zero where the latitude is known. [rad/s]
    """

    label: tuple[str, ...]
    measured: FloatArray
    reference: FloatArray
    f: FloatArray
    noise: FloatArray
    doubt: FloatArray
    common: FloatArray

    def __len__(self) -> int:
        return len(self.label)

    @property
    def sigma(self) -> FloatArray:
        """1-sigma of measured less reference, without what is common. Shape (n, 3). [rad/s]"""
        return np.asarray(np.hypot(self.noise, self.doubt))

    def covariance(self, M: FloatArray) -> FloatArray:
        """Covariance of ``measured.ravel()`` for gyroscopes of response I + M. Shape (3 n, 3 n). [(rad/s)^2]"""
        n, R = len(self), np.eye(3) + M
        c = (self.common @ R.T).reshape(len(self.common), 3 * n)
        S = c.T @ c + np.diag(np.square(self.noise).ravel())
        for k in range(n):
            S[3 * k : 3 * k + 3, 3 * k : 3 * k + 3] += (R * np.square(self.doubt[k])) @ R.T
        return np.asarray(S)

    @staticmethod
    def joined(parts: Sequence[GyroReadings]) -> GyroReadings:
        """One after the other. The first common error, Earth rate along the vertical, is the same in all parts."""
        n = [len(part) for part in parts]
        at = np.cumsum([0, *n])
        shared = np.zeros((1 + sum(len(part.common) - 1 for part in parts), at[-1], 3))
        row = 1
        for part, a, b in zip(parts, at[:-1], at[1:], strict=True):
            shared[0, a:b] = part.common[0]
            shared[row : row + len(part.common) - 1, a:b] = part.common[1:]
            row += len(part.common) - 1
        return GyroReadings(
            tuple(label for part in parts for label in part.label),
            np.concatenate([part.measured for part in parts]),
            np.concatenate([part.reference for part in parts]),
            np.concatenate([part.f for part in parts]),
            np.concatenate([part.noise for part in parts]),
            np.concatenate([part.doubt for part in parts]),
            shared,
        )


def readings_at_rest(
    poses: Poses,
    faces: Faces,
    f: FloatArray,
    *,
    latitude: float | None = None,
    headings: ArrayLike | None = None,
    heading_sigma: float = 0.0,
    instability: float = 0.0,
) -> GyroReadings:
    """Readings at rest, when the gyroscopes see the Earth turn.

    Parameters
    ----------
    poses : Poses
    faces : Faces
        Of these poses.
    f : ndarray, shape (n, 3)
        Specific force in each pose. [m/s^2]
    latitude : float, optional
        [rad]
    headings : array_like, shape (n,), optional
        See :func:`schuler.calibration.bench.faces.earth_rate_on_faces`. [rad]
    heading_sigma : float
        Of the headings. [rad]
    instability : float
        How much a bias changes from pose to pose, 1 sigma. [rad/s]

    Returns
    -------
    GyroReadings
        What is not known of Earth rate is in ``doubt`` and ``common``: without headings its horizontal part, without
        latitude also its vertical part, the sine of the latitude taken as uniform.
    """
    up = faces.up
    across = 1.0 - np.abs(up)
    noise = np.sqrt(np.square(poses.sigma_omega) + instability**2)
    doubt = np.zeros_like(up)
    common = np.zeros((1, *up.shape))
    if latitude is None:
        reference = np.zeros_like(up)
        common[0] = up * WGS84.omega_ie / np.sqrt(3.0)
        doubt = across * WGS84.omega_ie / np.sqrt(3.0)
    else:
        north, _, down = earth_rate_ned(checked_latitude(latitude))
        if headings is None:
            reference = -down * up
            doubt = across * north / np.sqrt(2.0)
        else:
            reference = earth_rate_on_faces(faces, latitude, headings)
            if heading_sigma > 0.0:  # a heading turns the horizontal part about the vertical
                wrong = heading_sigma * np.cross(up, reference)
                common = np.concatenate((common, np.eye(len(up))[:, :, None] * wrong))
    return GyroReadings(tuple(pose_labels(poses, faces)), poses.omega, reference, f, noise, doubt, common)


def gyro_design(readings: GyroReadings, *, response: bool, g_sensitivity: bool) -> tuple[FloatArray, tuple[str, ...]]:
    """Design of ``measured - reference`` and names of its parameters, axis by axis: b, then M, then G.

    Returns
    -------
    A : ndarray, shape (3 n, 3 q)
    names : tuple of str, length 3 q
    """
    columns = [np.ones((len(readings), 1))]
    names = [[b] for b in BIAS_G]
    for wanted, block, family in ((response, readings.reference, MATRIX_G), (g_sensitivity, readings.f, SENSITIVITY)):
        if wanted:
            columns.append(block)
            for i in range(3):
                names[i].extend(family[3 * i : 3 * i + 3])
    return response_design(np.hstack(columns)), tuple(n for row in names for n in row)


def gyro_fit(
    readings: GyroReadings, *, response: bool, g_sensitivity: bool, own_axis_only: bool = False
) -> tuple[LinearFit, IntArray]:
    """Bias, response and g-sensitivity of three gyroscopes by least squares.

    Parameters
    ----------
    readings : GyroReadings
    response : bool
        Estimate M_g, else it is zero.
    g_sensitivity : bool
        Estimate G_g, else it is zero.
    own_axis_only : bool
        Of each reading only the axis along which the reference is largest, and only the diagonals.

    Returns
    -------
    fit : LinearFit
    rows : ndarray of int
        Which of ``measured.ravel()`` were used.

    Notes
    -----
    Errors of the reference reach the readings through the response, so their covariance is taken with that of a first
    solution.
    """
    A, names = gyro_design(readings, response=response, g_sensitivity=g_sensitivity)
    y = (readings.measured - readings.reference).ravel()
    rows: IntArray = np.arange(len(y))
    keep = np.arange(len(names))
    if own_axis_only:
        along = np.abs(readings.reference if response else readings.f).argmax(axis=1)
        rows = 3 * np.arange(len(readings)) + along
        diagonal = {f"{family}_{a}{a}" for family in ("M_g", "G_g") for a in AXES} | set(BIAS_G)
        keep = np.array([j for j, n in enumerate(names) if n in diagonal])
    A, kept = A[rows][:, keep], [names[j] for j in keep]

    def solved(M: FloatArray) -> LinearFit:
        return linear_fit(A, y[rows], readings.covariance(M)[np.ix_(rows, rows)], kept)

    fit = solved(np.zeros((3, 3)))
    if response and (readings.doubt.any() or readings.common.any()):
        at = dict(zip(fit.names, fit.values, strict=True))
        fit = solved(np.array([at.get(n, 0.0) for n in MATRIX_G]).reshape(3, 3))
    return fit, rows
