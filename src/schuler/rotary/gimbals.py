"""Kinematics of a platform: from angles about its axes to attitude, angular rate and acceleration of the IMU.

A platform turns the IMU's axes ``s`` in the body ``b`` about m axes, outermost first. Axis k is given in the axes it
has when all angles are zero, where ``s`` and ``b`` coincide (but for a fixed mounting ``C_mount``)::

    C_bs = exp([u_1 x] a_1) exp([u_2 x] a_2) ... C_mount

A positive angle turns the IMU right-handed about the axis: ``omega_bs_s = + rate u`` for one axis.
"""

from __future__ import annotations

import numpy as np

from schuler import rotation
from schuler.arrays import ArrayLike, FloatArray, as_floats
from schuler.exceptions import InputError

_NAMED = {"x": (1.0, 0.0, 0.0), "y": (0.0, 1.0, 0.0), "z": (0.0, 0.0, 1.0)}


def axis_vector(axis: str | ArrayLike) -> FloatArray:
    """Unit vector of an axis of the platform, body axes (forward, right, down). Shape (3,).

    Parameters
    ----------
    axis : {"x", "y", "z", "-x", "-y", "-z"} or array_like, shape (3,)
        A name or any direction. Du's axes X (right), Y (forward), Z (up) are "y", "x" and "-z" here.

    Raises
    ------
    InputError
        If the name is unknown or the vector has no length.
    """
    if isinstance(axis, str):
        if axis.removeprefix("-") not in _NAMED:
            raise InputError(f"axis: expected 'x', 'y', 'z', one of them with a minus, or three numbers, got {axis!r}")
        return np.array(_NAMED[axis.removeprefix("-")]) * (-1.0 if axis.startswith("-") else 1.0)
    vector = as_floats(axis, "axis", (3,))
    length = float(np.linalg.norm(vector))
    if length < 1e-9:
        raise InputError("axis: expected a direction, got a vector of length zero")
    unit: FloatArray = vector / length
    return unit


def C_bs(axes: FloatArray, angles: FloatArray, C_mount: FloatArray | None = None) -> FloatArray:
    """Attitude of the IMU in the body.

    Parameters
    ----------
    axes : ndarray, shape (m, 3)
        Unit vectors, outermost first.
    angles : ndarray, shape (n, m)
        [rad]
    C_mount : ndarray, shape (3, 3), optional
        Mounting of the IMU in the innermost frame; default none.

    Returns
    -------
    ndarray, shape (n, 3, 3)
        ``v_b = C_bs @ v_s``.

    References
    ----------
    Du (2015), eqs. (2.2), (2.3), (3.11): there ``C_b^s`` is the transpose of this.
    """
    C = np.broadcast_to(np.eye(3), (len(angles), 3, 3))
    for k, u in enumerate(axes):
        C = C @ rotation.dcm_from_rotvec(angles[:, k, None] * u)
    return C if C_mount is None else C @ C_mount


def axes_in_s(axes: FloatArray, angles: FloatArray, C_mount: FloatArray | None = None) -> FloatArray:
    """Directions of the platform's axes in the IMU's axes. Shapes (m, 3), (n, m) to (n, m, 3)."""
    n, m = angles.shape
    directions = np.empty((n, m, 3))
    C = np.broadcast_to(np.eye(3) if C_mount is None else C_mount, (n, 3, 3))  # from s to the frame inside axis k
    for k in range(m - 1, -1, -1):
        directions[:, k] = axes[k] @ C
        C = rotation.dcm_from_rotvec(angles[:, k, None] * axes[k]) @ C
    return directions


def omega_bs_s(
    axes: FloatArray, angles: FloatArray, rates: FloatArray, C_mount: FloatArray | None = None
) -> FloatArray:
    """Angular rate of the IMU relative to the body, IMU axes.

    Parameters
    ----------
    axes, angles, C_mount
        See :func:`C_bs`.
    rates : ndarray, shape (n, m)
        Rates of the angles. [rad/s]

    Returns
    -------
    ndarray, shape (n, 3)
        [rad/s]
    """
    omega: FloatArray = np.einsum("nmi,nm->ni", axes_in_s(axes, angles, C_mount), rates)
    return omega


def alpha_bs_s(
    axes: FloatArray,
    angles: FloatArray,
    rates: FloatArray,
    accelerations: FloatArray,
    C_mount: FloatArray | None = None,
) -> FloatArray:
    """Time derivative of :func:`omega_bs_s`, component by component in IMU axes. Shape (n, 3). [rad/s^2]

    Notes
    -----
    An outer axis is carried round, in the IMU's axes, by the rates of all axes inside it.
    """
    w = axes_in_s(axes, angles, C_mount)
    alpha: FloatArray = np.einsum("nmi,nm->ni", w, accelerations)
    inside = np.zeros((len(angles), 3))
    for k in range(len(axes) - 1, -1, -1):
        turning = w[:, k] * rates[:, k, None]
        alpha -= np.cross(inside, turning)
        inside += turning
    return alpha
