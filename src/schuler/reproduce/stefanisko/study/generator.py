"""Stefanisko's trajectory generator and the navigation equations of his simulation: an Earth that is flat and at rest.

The package's own motion and mechanization are :mod:`schuler.simulation.profiles` and
:mod:`schuler.mechanization.strapdown`; these are his, step by step, to see what they do.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, TypeAlias

import numpy as np

from schuler import rotation
from schuler.arrays import ArrayLike, FloatArray, as_floats, as_vector3
from schuler.exceptions import InputError
from schuler.simulation.profiles import polynomial_motion

AccelFrame: TypeAlias = Literal["navigation", "body"]
Attitude: TypeAlias = Literal["exact", "first order"]
#: Gravity of the flat world. [m/s^2]
GRAVITY = 9.81


def gendata(
    position_knots: ArrayLike, position_step: float, angle_knots: ArrayLike, angle_step: float, interval: float,
    k: ArrayLike, *, accel_frame: AccelFrame = "navigation",
) -> FloatArray:  # fmt: skip
    """Error-free samples of an IMU along polynomials through knots.

    Parameters
    ----------
    position_knots : array_like, shape (n, 3)
        North, east, down at equal steps: his matrix A. [m]
    position_step : float
        [s]
    angle_knots : array_like, shape (m, 3)
        Roll, pitch, yaw at equal steps: his matrix B. [rad]
    angle_step : float
        [s]
    interval : float
        Interval of the samples. [s]
    k : array_like of int, shape () or (l,)
        Numbers of the samples, from 0.
    accel_frame : {"navigation", "body"}
        Axes in which the knots' accelerations are taken. ``body``: as if they were those along the turned
        axes, while only gravity is turned; then the path depends on the angles.

    Returns
    -------
    ndarray, shape (6,) or (l, 6)
        Specific force [m/s^2] and angular rate [rad/s], body axes.

    Raises
    ------
    InputError
        If the axes are unknown or a sample lies beyond the knots.

    References
    ----------
    Stefanisko (2015), section 4.2. The degree of his polynomials is not stated; here they go through all knots.
    """
    if accel_frame not in ("navigation", "body"):
        raise InputError(f"accel_frame: expected 'navigation' or 'body', got {accel_frame!r}")
    motion = polynomial_motion(position_knots, position_step, angle_knots, angle_step, np.zeros(3))
    t = interval * np.atleast_1d(np.asarray(k, dtype=np.float64))
    if (t < 0.0).any() or (t > motion.duration + 1e-9).any():
        raise InputError(f"k: expected samples within 0..{motion.duration:g} s, got {t.min():g} to {t.max():g} s")
    _, _, a = motion.path(t)
    C, omega = motion.attitude(t)
    gravity = np.einsum("nji,j->ni", C, (0.0, 0.0, GRAVITY))
    f = (np.einsum("nji,nj->ni", C, a) if accel_frame == "navigation" else a) - gravity
    samples = np.concatenate((f, omega), axis=1)
    return np.asarray(samples[0] if np.ndim(k) == 0 else samples)


@dataclass(frozen=True, eq=False)
class FlatTrack:
    """Solution of the navigation equations, one row a sample and one for the start.

    Attributes
    ----------
    r_n, v_n : ndarray, shape (n + 1, 3)
        [m], [m/s]
    C_nb : ndarray, shape (n + 1, 3, 3)
    """

    r_n: FloatArray
    v_n: FloatArray
    C_nb: FloatArray


def flat_navigation(
    samples: ArrayLike, interval: float, r_n: ArrayLike, v_n: ArrayLike, C_nb: ArrayLike,
    *, attitude: Attitude = "exact",
) -> FlatTrack:  # fmt: skip
    """Integrate samples of :func:`gendata` with his equations, without Coriolis and centrifugal terms.

    Parameters
    ----------
    samples : array_like, shape (n, 6)
        Held over their interval.
    interval : float
        [s]
    r_n, v_n : array_like, shape (3,)
        Start. [m], [m/s]
    C_nb : array_like, shape (3, 3)
        Start.
    attitude : {"exact", "first order"}
        ``exp`` of the rotation vector, or ``C (I + Omega tau)``, which loses orthogonality.

    Returns
    -------
    FlatTrack

    References
    ----------
    Stefanisko (2015), section 4.3: (1.15) or (1.14), (1.18), (1.22) after gravity is taken off (he lists velocity
    first), (1.26).
    """
    x = as_floats(samples, "samples", (None, 6))
    if attitude not in ("exact", "first order"):
        raise InputError(f"attitude: expected 'exact' or 'first order', got {attitude!r}")
    n = len(x)
    r, v, C = np.empty((n + 1, 3)), np.empty((n + 1, 3)), np.empty((n + 1, 3, 3))
    r[0], v[0], C[0] = as_vector3(r_n, "r_n"), as_vector3(v_n, "v_n"), as_floats(C_nb, "C_nb", (3, 3))
    alpha = x[:, 3:] * interval
    turns = rotation.dcm_from_rotvec(alpha) if attitude == "exact" else np.eye(3) + rotation.skew(alpha)
    gravity = np.array((0.0, 0.0, GRAVITY))
    for k in range(n):
        C[k + 1] = C[k] @ turns[k]
        f = 0.5 * (C[k] + C[k + 1]) @ x[k, :3]
        v[k + 1] = v[k] + (f + gravity) * interval
        r[k + 1] = r[k] + 0.5 * (v[k] + v[k + 1]) * interval
    return FlatTrack(r, v, C)


def velocity_from_samples(r_n: ArrayLike, interval: float) -> FloatArray:
    """His initial velocity: the first difference of the positions. Shape (3,). [m/s]

    Parameters
    ----------
    r_n : array_like, shape (>= 2, 3)
        [m]
    interval : float
        [s]

    References
    ----------
    Stefanisko (2015), section 4.3; in error by half the acceleration times the interval.
    """
    r = as_floats(r_n, "r_n", (None, 3))
    if len(r) < 2:
        raise InputError(f"r_n: expected at least two positions, got {len(r)}")
    return np.asarray((r[1] - r[0]) / interval)
