"""Du's axes and ours: east-north-up with right-forward-up there, north-east-down with forward-right-down here.

The same matrix takes either pair into the other: swap the first two components, change the sign of the third. It is a
proper rotation and its own inverse, so vectors, axial vectors, attitudes and error matrices all go through it, and the
error of attitude keeps its meaning (``C_hat = exp([eps x]) C``). A rotation about Du's Z (up) by ``+rate`` is one
about our z (down) by ``-rate``.
"""

from __future__ import annotations

from typing import Literal

import numpy as np

from schuler.arrays import ArrayLike, FloatArray
from schuler.exceptions import InputError

#: Maps (n, e, d) to (e, n, u) and (f, r, d) to (r, f, u), and back.
SWAP = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])
SWAP.setflags(write=False)

DuAxis = Literal["X", "Y", "Z"]


def swap_vector(v: ArrayLike) -> FloatArray:
    """Components in the other system, either way. Shape (..., 3)."""
    swapped: FloatArray = np.asarray(v, dtype=np.float64) @ SWAP
    return swapped


def swap_matrix(M: ArrayLike) -> FloatArray:
    """Matrix between vectors of one system as matrix between those of the other: ``S M S``. Shape (..., 3, 3).

    For attitudes (``C_nb`` to Du's ``C_b^n`` in ENU and RFU) and for scale factor and installation errors alike.
    """
    swapped: FloatArray = SWAP @ np.asarray(M, dtype=np.float64) @ SWAP
    return swapped


def du_axis(name: DuAxis) -> FloatArray:
    """Du's rotation axis X (right), Y (forward) or Z (up) in our body axes (forward, right, down). Shape (3,).

    Raises
    ------
    InputError
        If the name is another.
    """
    if name not in ("X", "Y", "Z"):
        raise InputError(f"axis: expected 'X', 'Y' or 'Z' of Du's, got {name!r}")
    axis: FloatArray = SWAP["XYZ".index(name)].copy()
    return axis


def installation_matrix(
    xy: float = 0.0, xz: float = 0.0, yx: float = 0.0, yz: float = 0.0, zx: float = 0.0, zy: float = 0.0
) -> FloatArray:
    """Du's installation errors ``N`` (K_ij: output axis i, input axis j) as our off-diagonal ``M``, body axes. [-]

    References
    ----------
    Du (2015), eq. (2.12).
    """
    return swap_matrix([[0.0, xy, xz], [yx, 0.0, yz], [zx, zy, 0.0]])


def scale_matrix(x: float = 0.0, y: float = 0.0, z: float = 0.0) -> FloatArray:
    """Du's scale factor errors ``S = diag(Kx, Ky, Kz)`` as our diagonal ``M``, body axes. [-]"""
    return swap_matrix(np.diag([x, y, z]))


def rpy_from_du(azimuth: ArrayLike, roll: ArrayLike, pitch: ArrayLike, *, printed: bool = False) -> FloatArray:
    """Our roll, pitch, yaw from Du's azimuth, roll and pitch. [rad]

    Parameters
    ----------
    azimuth, roll, pitch : array_like, shape (...)
    printed : bool
        With True the signs of the thesis as printed, where pitch is nose down and roll right wing up and the pitch is
        turned innermost; else the usual ones, which are ours.

    Returns
    -------
    ndarray, shape (..., 3)

    References
    ----------
    Du (2015), eq. (2.1): ``C_b^n = R3(A) R2(r) R1(p)``.
    """
    from schuler import rotation

    A, r, p = np.broadcast_arrays(*(np.asarray(v, dtype=np.float64) for v in (azimuth, roll, pitch)))
    if not printed:
        return np.stack((r, p, A), axis=-1)
    zero = np.zeros_like(A)
    turns = [rotation.dcm_from_rotvec(np.stack(v, axis=-1))
             for v in ((zero, zero, -A), (zero, -r, zero), (-p, zero, zero))]  # fmt: skip
    return rotation.rpy_from_dcm(swap_matrix(turns[0] @ turns[1] @ turns[2]))


def enu_errors(C_nb_estimated: ArrayLike, C_nb_true: ArrayLike) -> FloatArray:
    """Attitude error about east, north, up: the antisymmetric part of ``C_hat C^T``.

    Parameters
    ----------
    C_nb_estimated, C_nb_true : array_like, shape (..., 3, 3)

    Returns
    -------
    ndarray, shape (..., 3)
        For small errors the rotation vector; in general ``sin(angle)`` times its direction. [rad]
    """
    from schuler import rotation

    error = np.asarray(C_nb_estimated) @ np.swapaxes(np.asarray(C_nb_true), -1, -2)
    return swap_vector(rotation.unskew(error))
