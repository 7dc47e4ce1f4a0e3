"""Accelerometers on the faces of a fixture: response and bias, and how level the faces are."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Literal, TypeAlias

import numpy as np

from schuler.arrays import FloatArray, IntArray
from schuler.calibration.bench.faces import Faces, pose_labels
from schuler.calibration.bench.linear_fit import SUSPICIOUS, LinearFit, linear_fit, response_design
from schuler.calibration.bench.poses import Poses
from schuler.calibration.result.parameters import AXES, BIAS_A, MATRIX_A
from schuler.units import DEG

Bias: TypeAlias = Literal["all faces", "own axis"]
#: The largest tilt of a fixture that is looked for, 1 sigma. [rad]
LARGEST_LEVEL = 0.2


def fit_faces(
    poses: Poses,
    faces: Faces,
    gravity: float,
    *,
    improved: bool = True,
    bias: Bias = "all faces",
    level_sigma: float | None = None,
    instability: float = 0.0,
) -> tuple[LinearFit, IntArray, float]:
    """Bias and response of accelerometers by least squares.

    Parameters
    ----------
    poses, faces, gravity, improved, bias, level_sigma
        See :func:`schuler.calibration.bench.sixposition.calibrate_sixposition`.
    instability : float
        How much the biases change from pose to pose, 1 sigma. [m/s^2]

    Returns
    -------
    fit : LinearFit
    rows : ndarray of int
        Which of ``poses.f.ravel()`` were used.
    level : float
        ``level_sigma``, or what was found for it. [rad]
    """
    up = faces.up
    n = len(poses)
    A = response_design(np.column_stack((np.ones(n), gravity * up)))
    names = [name for i in range(3) for name in (BIAS_A[i], *MATRIX_A[3 * i : 3 * i + 3])]
    y = (poses.f - gravity * up).ravel()

    def variance(level: float) -> FloatArray:
        return face_variance(poses, faces, gravity, level, instability).ravel()

    across = (1.0 - np.abs(up)).ravel()
    level = _level_from_residuals(A, y, variance, names, across) if level_sigma is None else level_sigma
    if not improved:
        rows = np.flatnonzero(up.ravel())
        keep = [j for j, name in enumerate(names) if name in BIAS_A or name[4] == name[5]]
        return linear_fit(A[rows][:, keep], y[rows], variance(level)[rows], [names[j] for j in keep]), rows, level
    if bias == "own axis":
        # an unknown offset of each axis on each pair of faces where it is horizontal keeps them out of its bias
        for j in range(3):
            for i in range(3):
                if i != j and (faces.axis == j).any():
                    column = np.zeros((n, 3))
                    column[faces.axis == j, i] = 1.0
                    A = np.column_stack((A, column.ravel()))
                    names.append(f"_offset_{AXES[i]}{AXES[j]}")
    return linear_fit(A, y, variance(level), names), np.arange(3 * n), level


def face_variance(poses: Poses, faces: Faces, gravity: float, level: float, instability: float = 0.0) -> FloatArray:
    """Variance of mean specific force less that of a level face: noise, instability, tilt. Shape (n, 3). [(m/s^2)^2]

    A tilt d, normal about both horizontal axes, moves horizontal readings by ``g d`` and the vertical one by
    ``g d^2/2``, the square of which is ``2 (g level^2)^2`` in the mean.
    """
    vertical = np.abs(faces.up)
    tilt = (1.0 - vertical) * (gravity * level) ** 2 + vertical * 2.0 * (gravity * level**2) ** 2
    return np.asarray(np.square(poses.sigma_f) + instability**2 + tilt)


def _level_from_residuals(
    A: FloatArray, y: FloatArray, variance: Callable[[float], FloatArray], names: Sequence[str], across: FloatArray
) -> float:
    """Tilt of faces, 1 sigma, that explains the residuals of horizontal axes; zero where noise does.

    A variance component: chi-square of these residuals is set to their redundancy (Foerstner). Residuals of vertical
    axes are left to the test of the whole fit, because tilt moves them in second order only.
    """
    from scipy.optimize import brentq
    from scipy.stats import chi2

    def excess(level: float) -> tuple[float, float]:
        S = variance(level)
        at = linear_fit(A, y, S, names)
        redundancy = float(across @ (1.0 - np.einsum("ij,ji->i", A, at.gain)))
        return float(across @ (at.residuals**2 / S)) - redundancy, redundancy

    too_much, redundancy = excess(0.0)
    if redundancy < 0.5 or too_much + redundancy <= chi2.isf(SUSPICIOUS, redundancy):
        return 0.0
    if excess(LARGEST_LEVEL)[0] > 0.0:
        return LARGEST_LEVEL
    return float(brentq(lambda level: excess(level)[0], 0.0, LARGEST_LEVEL, xtol=1e-9, rtol=1e-3))


def tilted(poses: Poses, faces: Faces) -> list[str]:
    """Sentences on poses that are no faces."""
    return [
        f"{label} leans {faces.tilt[k] / DEG:.0f} deg from the nearest axis and was left out; a multi-position "
        "calibration can use it"
        for k, label in enumerate(pose_labels(poses, faces))
        if not faces.usable[k]
    ]
