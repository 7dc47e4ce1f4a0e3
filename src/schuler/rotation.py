"""Rotations: direction cosine matrices, quaternions, rotation vectors and Euler angles, for stacks of any shape.

Conventions (docs/conventions.md): ``C_ab`` maps components from ``b`` to ``a``, ``v_a = C_ab @ v_b``, and ``q_ab``
and ``rotvec_ab`` describe the same rotation. Quaternions are Hamilton's, scalar first ``[w, x, y, z]``; ``q`` and
``-q`` are equal. ``rpy_nb`` are roll, pitch, yaw in radians, applied yaw first about z, then pitch about y, then roll
about x (z-y-x); they are for people, no filter state is an Euler angle.

All functions take arrays with any leading axes and return float64.
"""

from __future__ import annotations

import numpy as np

from schuler.arrays import ArrayLike, FloatArray
from schuler.exceptions import InputError


def skew(v: ArrayLike) -> FloatArray:
    """Cross-product matrix ``[v x]``, so that ``skew(a) @ b`` is ``a x b``.

    Parameters
    ----------
    v : array_like, shape (..., 3)

    Returns
    -------
    ndarray, shape (..., 3, 3)
    """
    v = np.asarray(v, dtype=np.float64)
    S = np.zeros((*v.shape, 3))
    S[..., 0, 1], S[..., 0, 2], S[..., 1, 2] = -v[..., 2], v[..., 1], -v[..., 0]
    S[..., 1, 0], S[..., 2, 0], S[..., 2, 1] = v[..., 2], -v[..., 1], v[..., 0]
    return S


def unskew(S: ArrayLike) -> FloatArray:
    """Vector of the antisymmetric part of a matrix: the inverse of :func:`skew`. Shapes (..., 3, 3) to (..., 3)."""
    S = np.asarray(S, dtype=np.float64)
    return 0.5 * np.stack(
        (S[..., 2, 1] - S[..., 1, 2], S[..., 0, 2] - S[..., 2, 0], S[..., 1, 0] - S[..., 0, 1]), axis=-1
    )


def dcm_from_rotvec(rotvec_ab: ArrayLike) -> FloatArray:
    """Direction cosine matrix of a rotation vector (Rodrigues' formula).

    Parameters
    ----------
    rotvec_ab : array_like, shape (..., 3)
        Rotation vector that turns the axes of ``a`` onto those of ``b``. [rad]

    Returns
    -------
    C_ab : ndarray, shape (..., 3, 3)
        Maps components from ``b`` to ``a``. [-]

    Notes
    -----
    ``sinc`` is smooth at zero, so there is no small-angle branch and no threshold.

    References
    ----------
    Groves (2013), eq. (5.73).
    """
    rotvec_ab = np.asarray(rotvec_ab, dtype=np.float64)
    angle = np.linalg.norm(rotvec_ab, axis=-1)[..., None, None]
    S = skew(rotvec_ab)
    first = np.sinc(angle / np.pi)  # sin(x) / x
    second = 0.5 * np.sinc(angle / (2.0 * np.pi)) ** 2  # (1 - cos x) / x^2
    C_ab: FloatArray = np.eye(3) + first * S + second * (S @ S)
    return C_ab


def rotvec_from_dcm(C_ab: ArrayLike) -> FloatArray:
    """Rotation vector of a direction cosine matrix, of length at most pi. Shapes (..., 3, 3) to (..., 3). [rad]

    Notes
    -----
    Goes through the quaternion, which keeps full accuracy near zero and near half a turn, where the trace and the
    antisymmetric part respectively lose it.
    """
    return rotvec_from_quat(quat_from_dcm(C_ab))


def quat_from_rotvec(rotvec_ab: ArrayLike) -> FloatArray:
    """Unit quaternion of a rotation vector. Shapes (..., 3) [rad] to (..., 4).

    References
    ----------
    Groves (2013), eq. (E.28); Stefanisko (2015), eq. (1.6), where the components belong to the rotation vector, not
    to a unit vector as its text says.
    """
    rotvec_ab = np.asarray(rotvec_ab, dtype=np.float64)
    half = 0.5 * np.linalg.norm(rotvec_ab, axis=-1, keepdims=True)
    return np.concatenate((np.cos(half), 0.5 * np.sinc(half / np.pi) * rotvec_ab), axis=-1)


def rotvec_from_quat(q_ab: ArrayLike) -> FloatArray:
    """Rotation vector of a unit quaternion, of length at most pi. Shapes (..., 4) to (..., 3). [rad]"""
    q = np.asarray(q_ab, dtype=np.float64)
    q = np.where(q[..., :1] < 0.0, -q, q)
    sine = np.linalg.norm(q[..., 1:], axis=-1, keepdims=True)
    angle = 2.0 * np.arctan2(sine, q[..., :1])
    # angle / sin(angle / 2) tends to 2 / w at zero; atan2 keeps the ratio accurate for every other sine
    scale = np.divide(angle, sine, out=2.0 / np.maximum(q[..., :1], 0.5), where=sine > 1e-150)
    rotvec: FloatArray = scale * q[..., 1:]
    return rotvec


def dcm_from_quat(q_ab: ArrayLike) -> FloatArray:
    """Direction cosine matrix of a unit quaternion. Shapes (..., 4) to (..., 3, 3).

    References
    ----------
    Groves (2013), eq. (2.34) transposed to ``C_ab``; Stefanisko (2015), eq. (1.11).
    """
    w, x, y, z = np.moveaxis(np.asarray(q_ab, dtype=np.float64), -1, 0)
    C = np.empty((*w.shape, 3, 3))
    C[..., 0, 0] = w * w + x * x - y * y - z * z
    C[..., 0, 1] = 2.0 * (x * y - w * z)
    C[..., 0, 2] = 2.0 * (x * z + w * y)
    C[..., 1, 0] = 2.0 * (x * y + w * z)
    C[..., 1, 1] = w * w - x * x + y * y - z * z
    C[..., 1, 2] = 2.0 * (y * z - w * x)
    C[..., 2, 0] = 2.0 * (x * z - w * y)
    C[..., 2, 1] = 2.0 * (y * z + w * x)
    C[..., 2, 2] = w * w - x * x - y * y + z * z
    return C


def quat_from_dcm(C_ab: ArrayLike) -> FloatArray:
    """Unit quaternion of a direction cosine matrix, with ``w >= 0``. Shapes (..., 3, 3) to (..., 4).

    Notes
    -----
    All four components are formed from whichever of them is largest (Shepperd's method), so no rotation is
    ill-conditioned.
    """
    C = np.asarray(C_ab, dtype=np.float64)
    d0, d1, d2 = C[..., 0, 0], C[..., 1, 1], C[..., 2, 2]
    # four times the squares of w, x, y, z
    squares = np.stack((1.0 + d0 + d1 + d2, 1.0 + d0 - d1 - d2, 1.0 - d0 + d1 - d2, 1.0 - d0 - d1 + d2), axis=-1)
    wx, wy, wz = C[..., 2, 1] - C[..., 1, 2], C[..., 0, 2] - C[..., 2, 0], C[..., 1, 0] - C[..., 0, 1]
    xy, xz, yz = C[..., 0, 1] + C[..., 1, 0], C[..., 0, 2] + C[..., 2, 0], C[..., 1, 2] + C[..., 2, 1]
    products = np.stack(
        (
            np.stack((squares[..., 0], wx, wy, wz), axis=-1),
            np.stack((wx, squares[..., 1], xy, xz), axis=-1),
            np.stack((wy, xy, squares[..., 2], yz), axis=-1),
            np.stack((wz, xz, yz, squares[..., 3]), axis=-1),
        ),
        axis=-2,
    )
    largest = np.argmax(squares, axis=-1)
    q = np.take_along_axis(products, largest[..., None, None], axis=-2)[..., 0, :]
    q = q / np.linalg.norm(q, axis=-1, keepdims=True)
    signed: FloatArray = np.where(q[..., :1] < 0.0, -q, q)
    return signed


def quat_multiply(q_ab: ArrayLike, q_bc: ArrayLike) -> FloatArray:
    """Product ``q_ac = q_ab q_bc``: the same order as the matrices, ``C_ac = C_ab @ C_bc``. Shapes (..., 4)."""
    aw, ax, ay, az = np.moveaxis(np.asarray(q_ab, dtype=np.float64), -1, 0)
    bw, bx, by, bz = np.moveaxis(np.asarray(q_bc, dtype=np.float64), -1, 0)
    return np.stack(
        (
            aw * bw - ax * bx - ay * by - az * bz,
            aw * bx + ax * bw + ay * bz - az * by,
            aw * by - ax * bz + ay * bw + az * bx,
            aw * bz + ax * by - ay * bx + az * bw,
        ),
        axis=-1,
    )


def quat_conjugate(q_ab: ArrayLike) -> FloatArray:
    """The inverse rotation ``q_ba`` of a unit quaternion. Shape (..., 4)."""
    conjugate: FloatArray = np.asarray(q_ab, dtype=np.float64) * np.array([1.0, -1.0, -1.0, -1.0])
    return conjugate


def rotate(q_ab: ArrayLike, v_b: ArrayLike) -> FloatArray:
    """Components in ``a`` of vectors given in ``b``: ``v_a = C_ab v_b``. Shapes (..., 4), (..., 3) to (..., 3)."""
    q, v = np.asarray(q_ab, dtype=np.float64), np.asarray(v_b, dtype=np.float64)
    t = 2.0 * np.cross(q[..., 1:], v)
    rotated: FloatArray = v + q[..., :1] * t + np.cross(q[..., 1:], t)
    return rotated


def dcm_from_rpy(rpy_nb: ArrayLike) -> FloatArray:
    """Direction cosine matrix ``C_nb`` of roll, pitch and yaw.

    Parameters
    ----------
    rpy_nb : array_like, shape (..., 3)
        Roll, pitch, yaw; yaw from north towards east, pitch nose up, roll right wing down. [rad]

    Returns
    -------
    C_nb : ndarray, shape (..., 3, 3)
        Maps body (forward, right, down) to navigation (north, east, down) components.

    References
    ----------
    Groves (2013), eq. (2.22) transposed; Yaman (2017), eq. (2-63) with the row (1,2), (2,2) corrected.
    """
    roll, pitch, yaw = np.moveaxis(np.asarray(rpy_nb, dtype=np.float64), -1, 0)
    sr, cr, sp, cp, sy, cy = np.sin(roll), np.cos(roll), np.sin(pitch), np.cos(pitch), np.sin(yaw), np.cos(yaw)
    C = np.empty((*roll.shape, 3, 3))
    C[..., 0, 0] = cp * cy
    C[..., 0, 1] = -cr * sy + sr * sp * cy
    C[..., 0, 2] = sr * sy + cr * sp * cy
    C[..., 1, 0] = cp * sy
    C[..., 1, 1] = cr * cy + sr * sp * sy
    C[..., 1, 2] = -sr * cy + cr * sp * sy
    C[..., 2, 0] = -sp
    C[..., 2, 1] = sr * cp
    C[..., 2, 2] = cr * cp
    return C


def rpy_from_dcm(C_nb: ArrayLike) -> FloatArray:
    """Roll, pitch, yaw of ``C_nb``; the inverse of :func:`dcm_from_rpy` for pitch within +-90 deg.

    Parameters
    ----------
    C_nb : array_like, shape (..., 3, 3)

    Returns
    -------
    rpy_nb : ndarray, shape (..., 3)
        Roll and yaw in (-pi, pi], pitch in [-pi/2, pi/2]. [rad]

    Notes
    -----
    Within 1e-6 rad of vertical pitch, roll and yaw are one and the same motion: roll is then reported as zero and
    yaw carries all of it, so that ``dcm_from_rpy`` of the result still returns the matrix (to 1e-6).
    """
    C = np.asarray(C_nb, dtype=np.float64)
    pitch = np.arctan2(-C[..., 2, 0], np.hypot(C[..., 2, 1], C[..., 2, 2]))
    lock = np.hypot(C[..., 2, 1], C[..., 2, 2]) < 1e-6
    # adding zero turns -0.0 into 0.0: half a turn is +pi
    roll = np.where(lock, 0.0, np.arctan2(C[..., 2, 1] + 0.0, C[..., 2, 2]))
    yaw = np.where(lock, np.arctan2(0.0 - C[..., 0, 1], C[..., 1, 1]), np.arctan2(C[..., 1, 0] + 0.0, C[..., 0, 0]))
    return np.stack((roll, pitch, yaw), axis=-1)


def quat_from_rpy(rpy_nb: ArrayLike) -> FloatArray:
    """Unit quaternion ``q_nb`` of roll, pitch and yaw [rad]. Shapes (..., 3) to (..., 4)."""
    half = 0.5 * np.asarray(rpy_nb, dtype=np.float64)
    (sr, sp, sy), (cr, cp, cy) = np.moveaxis(np.sin(half), -1, 0), np.moveaxis(np.cos(half), -1, 0)
    return np.stack(
        (
            cr * cp * cy + sr * sp * sy,
            sr * cp * cy - cr * sp * sy,
            cr * sp * cy + sr * cp * sy,
            cr * cp * sy - sr * sp * cy,
        ),
        axis=-1,
    )


def rpy_from_quat(q_nb: ArrayLike) -> FloatArray:
    """Roll, pitch, yaw [rad] of a unit quaternion; see :func:`rpy_from_dcm`. Shapes (..., 4) to (..., 3)."""
    return rpy_from_dcm(dcm_from_quat(q_nb))


def body_rate_from_rpy(rpy_nb: ArrayLike, rpy_rate: ArrayLike) -> FloatArray:
    """Angular rate ``omega_nb_b`` of Euler angles that change at given rates.

    Parameters
    ----------
    rpy_nb : array_like, shape (..., 3)
        Roll, pitch, yaw. [rad]
    rpy_rate : array_like, shape (..., 3)
        Their time derivatives. [rad/s]

    Returns
    -------
    omega_nb_b : ndarray, shape (..., 3)
        Rate of the body relative to the navigation frame, in body axes. [rad/s]

    References
    ----------
    Groves (2013), eq. (2.57).
    """
    roll, pitch, _ = np.moveaxis(np.asarray(rpy_nb, dtype=np.float64), -1, 0)
    roll_rate, pitch_rate, yaw_rate = np.moveaxis(np.asarray(rpy_rate, dtype=np.float64), -1, 0)
    sr, cr, sp, cp = np.sin(roll), np.cos(roll), np.sin(pitch), np.cos(pitch)
    return np.stack(
        (
            roll_rate - yaw_rate * sp,
            pitch_rate * cr + yaw_rate * sr * cp,
            -pitch_rate * sr + yaw_rate * cr * cp,
        ),
        axis=-1,
    )


def orthonormalise(C: ArrayLike) -> FloatArray:
    """Nearest rotation matrix in the least-squares sense (polar factor). Shapes (..., 3, 3)."""
    U, _, Vt = np.linalg.svd(np.asarray(C, dtype=np.float64))
    U = U.copy()
    U[..., :, 2] *= np.linalg.det(U @ Vt)[..., None]
    nearest: FloatArray = U @ Vt
    return nearest


def interpolate_quat(t: ArrayLike, t_nodes: ArrayLike, q_nodes: ArrayLike) -> FloatArray:
    """Attitude between samples, turning at constant rate from one to the next.

    Parameters
    ----------
    t : array_like, shape (m,)
        Times wanted, within the nodes' span; outside it the end attitudes are held. [s]
    t_nodes : array_like, shape (n,)
        Increasing times of the nodes. [s]
    q_nodes : array_like, shape (n, 4)
        Unit quaternions ``q_ab`` at the nodes.

    Returns
    -------
    ndarray, shape (m, 4)
    """
    t, t_nodes, q_nodes = (np.asarray(a, dtype=np.float64) for a in (t, t_nodes, q_nodes))
    if len(t_nodes) == 0 or len(t_nodes) != len(q_nodes):
        raise InputError(f"expected as many attitudes as times, at least one; got {len(q_nodes)} and {len(t_nodes)}")
    if len(t_nodes) == 1:
        return np.broadcast_to(q_nodes[0], (*t.shape, 4)).copy()
    k = np.clip(np.searchsorted(t_nodes, t, side="right") - 1, 0, len(t_nodes) - 2)
    fraction = np.clip((t - t_nodes[k]) / (t_nodes[k + 1] - t_nodes[k]), 0.0, 1.0)
    turn = rotvec_from_quat(quat_multiply(quat_conjugate(q_nodes[k]), q_nodes[k + 1]))
    return quat_multiply(q_nodes[k], quat_from_rotvec(fraction[..., None] * turn))
