"""Turns between the poses of a hand-rotated log: the vertical carried from one pose to the next by the gyroscopes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from schuler.arrays import FloatArray, IntArray
from schuler.calibration.freepose.accel import UPPER_COLUMN, UPPER_ROW, AccelFit
from schuler.calibration.freepose.weights import pseudo_inverse
from schuler.rotation import skew

#: Samples integrated together for the first solution.
COARSE = 8


@dataclass(frozen=True, eq=False)
class Turns:
    """The log between the poses, and the verticals measured in them.

    Attributes
    ----------
    t, gyro, accel : ndarray
        The log, in its units.
    before : float
        0.5 for samples of rates, 0 for mean rates over intervals.
    spans : ndarray of int, shape (n, 2)
        Last sample of one rest, first of the next.
    pair : ndarray of int, shape (n, 2)
        The two poses.
    up : ndarray, shape (K, 3)
        Calibrated verticals of all poses, unit vectors.
    f : ndarray, shape (K, 3)
        Calibrated specific force of the poses. [m/s^2]
    B_a, b_a : ndarray, shape (3, 3), (3,)
        Specific force is ``B_a (log - b_a)``.
    """

    t: FloatArray
    gyro: FloatArray
    accel: FloatArray
    before: float
    spans: IntArray
    pair: IntArray
    up: FloatArray
    f: FloatArray
    B_a: FloatArray
    b_a: FloatArray


def rotations(
    turns: Turns, spans: IntArray, B_g: FloatArray, b_g: FloatArray, G: FloatArray | None, stride: int = 1
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Rotation over spans of the log, see :func:`schuler.calibration.freepose._kernels.turns`.

    Parameters
    ----------
    turns : Turns
    spans : ndarray of int, shape (n, 2)
    B_g, b_g, G : ndarray, shape (3, 3), (3,), (3, 3)
        Rate is ``B_g (log - b_g - G f)``.
    stride : int
        Samples taken together.

    Returns
    -------
    C : ndarray, shape (n, 3, 3)
        From the axes of the end to those of the start.
    H : ndarray, shape (n, 3, 3, 4 or 7)
        Derivatives are contractions of it; seven columns with G.
    seconds : ndarray, shape (n,)
    """
    from schuler.calibration.freepose import _kernels as kernels

    n, columns = len(spans), 4 if G is None else 7
    C, H, seconds = np.empty((n, 3, 3)), np.empty((n, 3, 3, columns)), np.empty(n)
    kernels.turns(
        turns.t, turns.gyro, turns.accel, spans, turns.before, np.ascontiguousarray(B_g), np.ascontiguousarray(b_g),
        np.zeros((3, 3)) if G is None else np.ascontiguousarray(G), np.ascontiguousarray(turns.B_a),
        np.ascontiguousarray(turns.b_a), stride, columns, C, H, seconds,
    )  # fmt: skip
    return C, H, seconds


def vertical_residuals(
    turns: Turns, nominal: float, M: FloatArray, b: FloatArray, G: FloatArray | None, stride: int = 1
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Predicted less measured vertical at the end of each turn, with derivatives.

    Parameters
    ----------
    turns : Turns
    nominal : float
        [rad/s per unit of the log]
    M, b : ndarray, shape (3, 3), (3,)
        ``omega = (I + M)^-1 (nominal y - b - G f)``. [-], [rad/s]
    G : ndarray, shape (3, 3), or None
        [(rad/s)/(m/s^2)]
    stride : int
        Samples taken together; 1 is exact for rates that are constant over a sample interval.

    Returns
    -------
    r : ndarray, shape (n, 3)
        ``C^T up_start - up_end``. [rad]
    J : ndarray, shape (n, 3, 12 or 21)
        Derivatives by M (row by row), b, and G if given. A turn by delta changes ``C^T up`` by ``C^T (up x delta)``.
    C : ndarray, shape (n, 3, 3)
        Rotation of each turn, end to start.
    seconds : ndarray, shape (n,)
    """
    Q = np.asarray(np.linalg.inv(np.eye(3) + M), dtype=np.float64)
    C, H, seconds = rotations(turns, turns.spans, nominal * Q, b / nominal, None if G is None else G / nominal, stride)
    n = len(C)
    up = turns.up[turns.pair[:, 0]]
    r = np.einsum("kji,kj->ki", C, up) - turns.up[turns.pair[:, 1]]
    T = np.einsum("kji,kjl->kil", C, skew(up))
    HQ = -np.einsum("kil,klcq,cm->kimq", T, H, Q)  # by the raw rate of axis m, times q
    parts = [HQ[..., :3].reshape(n, 3, 9), HQ[..., 3]]
    if G is not None:
        parts.append(HQ[..., 4:7].reshape(n, 3, 9))
    return r, np.concatenate(parts, axis=2), C, seconds


def nominal_scale(turns: Turns, bias: FloatArray) -> float:
    """Factor of the gyroscopes [rad/s per unit of the log] whose turns fit the poses best, to 5 %.

    A search on a grid that covers typical turns between 0.1 and 9 rad; 1 is taken if it fits.
    """
    spans = turns.spans[np.linspace(0, len(turns.spans) - 1, min(len(turns.spans), 16)).astype(int)]
    pair = turns.pair[np.linspace(0, len(turns.spans) - 1, min(len(turns.spans), 16)).astype(int)]
    spans = np.ascontiguousarray(spans)

    def cost(factor: float) -> float:
        C, _, _ = rotations(turns, spans, factor * np.eye(3), bias, None, COARSE)
        r = np.einsum("kji,kj->ki", C, turns.up[pair[:, 0]]) - turns.up[pair[:, 1]]
        return float(np.minimum((r * r).sum(axis=1), 1.0).mean())

    if cost(1.0) < 0.03:
        return 1.0
    angles = []
    for a, b in spans:
        step = turns.before * turns.gyro[a:b] + (1.0 - turns.before) * turns.gyro[a + 1 : b + 1] - bias
        angles.append(float(np.linalg.norm((step * np.diff(turns.t[a : b + 1])[:, None]).sum(axis=0))))
    size = max(float(np.median(angles)), 1e-300)
    grid = np.geomspace(0.1, 9.0, 60) / size
    return float(grid[int(np.argmin([cost(float(s)) for s in grid]))])


def tangents(u: FloatArray) -> FloatArray:
    """Two unit vectors across each of n directions. Shape (n, 3, 2)."""
    helper = np.eye(3)[np.argmin(np.abs(u), axis=1)]
    a = np.cross(u, helper)
    a /= np.linalg.norm(a, axis=1, keepdims=True)
    return np.stack((a, np.cross(u, a)), axis=2)


def direction_noise(turns: Turns, accel: AccelFit, sigma_f: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Derivatives of the vertical of each pose and of the accelerometer parameters by all pose means.

    Returns
    -------
    ndarray, shape (K, 3, 3 K)
        d up_k / d mean_j, through the pose itself and through the parameters.
    ndarray, shape (9, 3 K)
        d p / d mean_j.
    """
    n = len(turns.up)
    B = np.linalg.inv(accel.R)
    size = np.linalg.norm(turns.f, axis=1)
    w = turns.up @ B
    to_p = np.zeros((9, n, 3))
    L = -pseudo_inverse(accel.normal) @ accel.inverse_weighted
    to_p[:] = L[:, :, None] * w[None, :, :]
    across = (np.eye(3) - turns.up[:, :, None] * turns.up[:, None, :]) @ B / size[:, None, None]
    by_p = np.empty((n, 3, 9))
    by_p[:, :, :3] = -across
    by_p[:, :, 3:] = -across[:, :, UPPER_ROW] * turns.f[:, None, UPPER_COLUMN]
    out = by_p @ to_p.reshape(9, 3 * n)
    k = np.arange(n)
    out.reshape(n, 3, n, 3)[k, :, k, :] += across
    return out, to_p.reshape(9, 3 * n)


def residual_map(turns: Turns, E: FloatArray, C: FloatArray, up_noise: FloatArray) -> FloatArray:
    """Derivatives of the tangential residuals ``E^T (C^T up_start - up_end)`` by all pose means. Shape (2 n, 3 K)."""
    i, j = turns.pair.T
    moved = np.einsum("kba,kbm->kam", C, up_noise[i]) - up_noise[j]
    return np.asarray(np.einsum("kia,kim->kam", E, moved).reshape(2 * len(E), -1))
