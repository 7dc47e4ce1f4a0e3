"""Faces: poses with one axis vertical, gravity and Earth rate in body axes then, and the fit of the accelerometers."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Literal, TypeAlias

import numpy as np

from schuler.arrays import ArrayLike, BoolArray, FloatArray, IntArray, as_floats
from schuler.calibration.bench.linear_fit import SUSPICIOUS, LinearFit, linear_fit, response_design
from schuler.calibration.bench.poses import Poses
from schuler.calibration.result.parameters import AXES, BIAS_A, MATRIX_A
from schuler.earth import earth_rate_ned
from schuler.exceptions import InputError
from schuler.units import DEG

#: A pose further than this from the nearest axis is no face. [rad]
LARGEST_TILT = 20.0 * DEG
#: The six faces in the order of reports.
FACES = tuple(f"{axis} {way}" for axis in AXES for way in ("up", "down"))


@dataclass(frozen=True, eq=False)
class Faces:
    """Which axis points up in each pose.

    Attributes
    ----------
    axis : ndarray of int, shape (n,)
        0, 1, 2 for x, y, z.
    sign : ndarray, shape (n,)
        1 if the axis points up, -1 if down.
    tilt : ndarray, shape (n,)
        Angle between the measured specific force, less a rough bias, and the axis. [rad]
    usable : ndarray of bool, shape (n,)
        Not tilted by more than :data:`LARGEST_TILT`.
    """

    axis: IntArray
    sign: FloatArray
    tilt: FloatArray
    usable: BoolArray

    @property
    def up(self) -> FloatArray:
        """Direction up in the axes of the fixture, unit vectors. Shape (n, 3)."""
        return np.asarray(np.eye(3)[self.axis] * self.sign[:, None])

    @property
    def names(self) -> tuple[str, ...]:
        """Such as ``"x up"``."""
        return tuple(f"{AXES[a]} {'up' if s > 0.0 else 'down'}" for a, s in zip(self.axis, self.sign, strict=True))

    @property
    def missing(self) -> list[str]:
        """Faces without a usable pose."""
        there = {name for name, good in zip(self.names, self.usable, strict=True) if good}
        return [name for name in FACES if name not in there]


def faces_of(poses: Poses, names: Sequence[str] | None = None) -> Faces:
    """Which axis points up, from the specific force.

    Parameters
    ----------
    poses : Poses
    names : sequence of str, optional
        Where the data are not to decide: ``"x up"``, ``"z down"``, ..., one for each pose.

    Returns
    -------
    Faces

    Raises
    ------
    InputError
        If a name is none of :data:`FACES`, or there is not one for each pose.
    """
    if names is not None:
        if len(names) != len(poses) or not set(names) <= set(FACES):
            raise InputError(f"faces: expected {len(poses)} of {', '.join(FACES)}, got {list(names)}")
        axis = np.array([AXES.index(n[0]) for n in names], dtype=np.int64)
        sign = np.array([1.0 if n.endswith("up") else -1.0 for n in names])
        return Faces(axis, sign, np.zeros(len(poses)), np.ones(len(poses), dtype=bool))
    rows = np.arange(len(poses))
    bias = np.zeros(3)
    for _ in range(2):  # once more with the bias that the first guess gives
        f = poses.f - bias
        axis = np.abs(f).argmax(axis=1)
        sign = np.where(f[rows, axis] >= 0.0, 1.0, -1.0)
        for i in range(3):
            sides = [poses.f[(axis == i) & (sign == s), i] for s in (1.0, -1.0)]
            bias[i] = 0.5 * (sides[0].mean() + sides[1].mean()) if all(len(side) for side in sides) else 0.0
    own = np.abs((poses.f - bias)[rows, axis])
    across = np.sqrt(np.maximum(np.square(poses.f - bias).sum(axis=1) - own**2, 0.0))
    tilt = np.arctan2(across, own)
    return Faces(axis.astype(np.int64), sign, tilt, tilt <= LARGEST_TILT)


def earth_rate_on_faces(faces: Faces, latitude: float, headings: ArrayLike) -> FloatArray:
    """Earth rate in the axes of the fixture.

    Parameters
    ----------
    faces : Faces
    latitude : float
        [rad]
    headings : array_like, shape (n,)
        From north towards east, of the next axis after the vertical one in the order x, y, z, x: of y where x is
        vertical, of z where y is, of x where z is. [rad]

    Returns
    -------
    ndarray, shape (n, 3)
        [rad/s]

    Raises
    ------
    InputError
        If there is not one heading for each pose or the latitude is no angle up to 90 deg.

    Notes
    -----
    Hayal's section 2.4.1.1 takes the vertical component for all axes; in a pose with a vertical axis the horizontal
    ones see the north component, so the improved test needs the whole vector and with it the heading.
    """
    psi = as_floats(headings, "headings", (len(faces.axis),))
    omega_n = earth_rate_ned(checked_latitude(latitude))
    out = np.empty((len(psi), 3))
    for k, (a, s) in enumerate(zip(faces.axis, faces.sign, strict=True)):
        C_nb = np.empty((3, 3))
        C_nb[:, a] = (0.0, 0.0, -s)
        C_nb[:, (a + 1) % 3] = (np.cos(psi[k]), np.sin(psi[k]), 0.0)
        C_nb[:, (a + 2) % 3] = np.cross(C_nb[:, a], C_nb[:, (a + 1) % 3])
        out[k] = C_nb.T @ omega_n
    return out


def checked_latitude(latitude: float) -> float:
    """A latitude in radians, or an InputError that reminds of the unit."""
    if not (np.isfinite(latitude) and abs(latitude) <= np.pi / 2):
        raise InputError(
            f"latitude: expected radians between -pi/2 and pi/2, got {latitude!r}; multiply degrees with DEG"
        )
    return float(latitude)


def pose_labels(poses: Poses, faces: Faces) -> list[str]:
    """Such as ``"x up (12.0..15.0 s)"``."""
    return [f"{name} ({a:.1f}..{b:.1f} s)" for name, a, b in zip(faces.names, poses.start, poses.stop, strict=True)]


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
