"""Geometry of one triad: scale factors and three non-orthogonality angles as a lower triangular response matrix.

Axis x of the triad is the x axis of the body, axis y lies in the body's xy plane. From orthogonal axes, y is turned
about z by theta_yz; z is turned about y by theta_zy and then about x by theta_zx. With c, s for cosine and sine the
unit vectors along the sensing axes are the rows of ::

    T = [[1,          0,                     0                   ],
         [-s(th_yz),  c(th_yz),              0                   ],
         [ s(th_zy), -s(th_zx) c(th_zy),     c(th_zx) c(th_zy)   ]]

and the triad reads ``Y = b + M v`` with ``M = diag(1 + s) T``. Angles are always in the order (yz, zx, zy).

References
----------
Hayal (2010), section 3.2, eqs. (3.5) to (3.18). Corrected: s(th_zy) is positive in (3.7), (3.9), (3.10), as follows
from his own rotation (3.8) and as (3.11) to (3.14) have it; -theta_zx in (3.15); tangents instead of cosines in (3.18).
"""

from __future__ import annotations

import numpy as np

from schuler.arrays import ArrayLike, FloatArray, as_floats
from schuler.exceptions import InputError

#: Names of the three angles.
ANGLES = ("yz", "zx", "zy")
#: Parameters of a triad, in the order of arrays of nine.
PARAMETERS = ("b_x", "b_y", "b_z", "s_x", "s_y", "s_z", "theta_yz", "theta_zx", "theta_zy")


def triad_matrix(s: ArrayLike, theta: ArrayLike, *, small_angle: bool = False) -> FloatArray:
    """Response matrix of a triad.

    Parameters
    ----------
    s : array_like, shape (..., 3)
        Scale-factor errors of the axes. [-]
    theta : array_like, shape (..., 3)
        Non-orthogonality (yz, zx, zy). [rad]
    small_angle : bool
        First order in s and theta: ``[[1 + s_x, 0, 0], [-th_yz, 1 + s_y, 0], [th_zy, -th_zx, 1 + s_z]]``.

    Returns
    -------
    ndarray, shape (..., 3, 3)
        ``M = diag(1 + s) T``, lower triangular: the sensor model's ``I + M_a`` in the gauge "lower".

    References
    ----------
    Hayal (2010), eqs. (3.12), (3.15); the latter prints +theta_zx, which contradicts his (3.13) and (3.16).
    """
    s, theta = _last3(s, "s"), _last3(theta, "theta")
    s, theta = np.broadcast_arrays(s, theta)
    M = np.zeros((*s.shape, 3))
    if small_angle:
        for i in range(3):
            M[..., i, i] = 1.0 + s[..., i]
        M[..., 1, 0], M[..., 2, 0], M[..., 2, 1] = -theta[..., 0], theta[..., 2], -theta[..., 1]
        return M
    (yz, zx, zy) = np.moveaxis(theta, -1, 0)
    M[..., 0, 0] = 1.0
    M[..., 1, 0], M[..., 1, 1] = -np.sin(yz), np.cos(yz)
    M[..., 2, 0], M[..., 2, 1] = np.sin(zy), -np.sin(zx) * np.cos(zy)
    M[..., 2, 2] = np.cos(zx) * np.cos(zy)
    return np.asarray((1.0 + s)[..., None] * M)


def triad_inverse(s: ArrayLike, theta: ArrayLike) -> FloatArray:
    """Inverse of :func:`triad_matrix`, in closed form: ``v = triad_inverse @ (Y - b)``. Shape (..., 3, 3).

    Raises
    ------
    InputError
        If a scale-factor error is -1 or below, or an angle is a right angle or more: there is no such triad.

    References
    ----------
    Hayal (2010), eq. (3.14).
    """
    s, theta = np.broadcast_arrays(_last3(s, "s"), _last3(theta, "theta"))
    if (s <= -1.0).any() or (np.abs(theta) >= 0.5 * np.pi).any():
        raise InputError(
            f"s, theta: expected s > -1 and angles within a right angle, got {s.tolist()}, {theta.tolist()}; "
            "check units and the signs of the axes"
        )
    (yz, zx, zy) = np.moveaxis(theta, -1, 0)
    W = np.zeros((*s.shape, 3))
    W[..., 0, 0] = 1.0
    W[..., 1, 0], W[..., 1, 1] = np.tan(yz), 1.0 / np.cos(yz)
    W[..., 2, 0] = np.tan(zx) * np.tan(yz) - np.tan(zy) / np.cos(zx)
    W[..., 2, 1], W[..., 2, 2] = np.tan(zx) / np.cos(yz), 1.0 / (np.cos(zx) * np.cos(zy))
    return np.asarray(W / (1.0 + s)[..., None, :])


def triad_parameters(M: ArrayLike) -> tuple[FloatArray, FloatArray]:
    """Scale-factor errors and angles of a lower triangular response, the inverse of :func:`triad_matrix`.

    Parameters
    ----------
    M : array_like, shape (3, 3)
        ``I + M_a`` in the gauge "lower".

    Returns
    -------
    s, theta : ndarray, shape (3,)
        [-], [rad]

    Raises
    ------
    InputError
        If M is not lower triangular with positive diagonal; bring it into that gauge first
        (:func:`schuler.calibration.result.parameters.in_gauge`).
    """
    M = as_floats(M, "M", (3, 3))
    if np.abs(np.triu(M, 1)).max() > 1e-12 or (np.diag(M) <= 0.0).any():
        raise InputError(
            f"M: expected I + M_a lower triangular with a positive diagonal, got {M.tolist()}; "
            "use in_gauge(errors, 'lower')"
        )
    norm = np.linalg.norm(M, axis=1)
    # sines and cosines instead of T[2, 0] in an arcsine: exact for any size
    T = M / norm[:, None]
    zy = np.arctan2(T[2, 0], np.hypot(T[2, 1], T[2, 2]))
    return norm - 1.0, np.array((np.arctan2(-T[1, 0], T[1, 1]), np.arctan2(-T[2, 1], T[2, 2]), zy))


def triad_derivative(s: ArrayLike, theta: ArrayLike) -> FloatArray:
    """Derivative of :func:`triad_matrix` by (s_x, s_y, s_z, theta_yz, theta_zx, theta_zy). Shape (3, 3, 6)."""
    s, theta = as_floats(s, "s", (3,)), as_floats(theta, "theta", (3,))
    T = triad_matrix(np.zeros(3), theta)
    (yz, zx, zy), k = theta, 1.0 + s
    J = np.zeros((3, 3, 6))
    for i in range(3):
        J[i, :, i] = T[i]
    J[1, :2, 3] = k[1] * np.array((-np.cos(yz), -np.sin(yz)))
    J[2, 1:, 4] = k[2] * np.cos(zy) * np.array((-np.cos(zx), -np.sin(zx)))
    J[2, :, 5] = k[2] * np.array((np.cos(zy), np.sin(zx) * np.sin(zy), -np.cos(zx) * np.sin(zy)))
    return J


def triad_reading(v: ArrayLike, b: ArrayLike, s: ArrayLike, theta: ArrayLike) -> FloatArray:
    """What a triad reads, ``Y = b + M v``, without noise.

    Parameters
    ----------
    v : array_like, shape (..., 3)
        True specific force or rate in body axes. [x]
    b, s, theta : array_like, shape (3,)
        Bias [x], scale-factor errors [-], angles [rad].

    References
    ----------
    Hayal (2010), eqs. (3.13), (3.17).
    """
    v = _last3(v, "v")
    return np.asarray(_last3(b, "b") + v @ triad_matrix(s, theta).T)


def triad_truth(Y: ArrayLike, b: ArrayLike, s: ArrayLike, theta: ArrayLike) -> FloatArray:
    """What a triad was exposed to: the inverse of :func:`triad_reading`, Hayal (2010), eqs. (3.14), (3.18)."""
    return np.asarray((_last3(Y, "Y") - _last3(b, "b")) @ triad_inverse(s, theta).T)


def _last3(value: ArrayLike, name: str) -> FloatArray:
    x = as_floats(value, name)
    if x.ndim == 0 or x.shape[-1] != 3:
        raise InputError(f"{name}: expected shape (..., 3), got {x.shape}")
    return x
