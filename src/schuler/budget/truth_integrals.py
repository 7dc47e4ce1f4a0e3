"""Integrals along the truth that the engine does not keep: noise of single axes, uneven accelerometers."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from schuler import rotation
from schuler.arrays import FloatArray, IntArray
from schuler.recording.series import Increments
from schuler.recording.trajectory import FullTrajectory

_SAME = 1e-7  # times that are one [s]


@dataclass(frozen=True)
class TruthIntegrals:
    """Integrals over the interval into each node, Earth-fixed axes.

    Attributes
    ----------
    spread : ndarray, shape (3, k, 2, 9)
        Of ``c c'`` with the column c of C_eb of each body axis, its weight falling from 1 to 0 over the interval and
        rising from 0 to 1: what unit white noise of that axis adds before and after the transition. [s]
    uneven : ndarray, shape (k, 9, 6)
        Columns of the transition for errors ``|f|`` [m/s^2] of the x, y, z accelerometer, and ``f^2`` [m^2/s^4].
    force : ndarray, shape (k, 3)
        Specific force just before each node, body axes. [m/s^2]
    """

    spread: FloatArray
    uneven: FloatArray
    force: FloatArray


def truth_integrals(increments: Increments, truth: FullTrajectory, t: FloatArray, length: FloatArray) -> TruthIntegrals:
    """Integrate along a true motion.

    Parameters
    ----------
    increments : Increments
        Ideal.
    truth : FullTrajectory
        With attitude.
    t : ndarray, shape (k,)
        Nodes; the first is the start. [s]
    length : ndarray, shape (k,)
        Of the interval into each node, zero where the node only has another update. [s]

    Notes
    -----
    The weights keep the integral and its first moment in time, so a body that turns between two nodes spreads its noise
    as it turns; over the three axes they sum to half the interval each, the trapezoid rule of the engine. Columns
    follow the mid-point rule of ``filtering._covariance_kernels.accumulate`` and carry its minus sign.
    """
    # cut at every sample and every node: the motion is that of one sample, the integral that of one node
    edges = np.concatenate(([increments.start], increments.t))
    near = np.clip(np.searchsorted(edges, t), 1, len(edges) - 1)
    apart = np.minimum(np.abs(t - edges[near - 1]), np.abs(t - edges[near])) > _SAME
    edges = np.sort(np.concatenate((edges, t[apart])))
    middle, h = 0.5 * (edges[1:] + edges[:-1]), np.diff(edges)
    node = np.searchsorted(t, middle)
    kept = (node > 0) & (node < len(t))
    middle, h, node = middle[kept], h[kept], node[kept]
    sample = np.searchsorted(increments.t, middle)
    f = (increments.dv_ib_b / increments.dt[:, None])[sample]
    C = rotation.dcm_from_quat(truth.at(middle).q_eb)
    rest = t[node] - middle  # until the node
    late = 1.0 - np.divide(rest, length[node], out=np.zeros_like(rest), where=length[node] > 0.0)
    spread, uneven = np.zeros((3, len(t), 2, 9)), np.zeros((len(t), 9, 6))
    for axis in range(3):
        c = C[:, :, axis]
        square = (c[:, :, None] * c[:, None, :]).reshape(-1, 9)
        spread[axis, :, 0] = _summed((h * (1.0 - late))[:, None] * square, node, len(t))
        spread[axis, :, 1] = _summed((h * late)[:, None] * square, node, len(t))
        for k, size in ((axis, np.abs(f[:, axis])), (3 + axis, f[:, axis] ** 2)):
            push = -(h * size)[:, None] * c
            uneven[:, 3:6, k] = _summed(push, node, len(t))
            uneven[:, 6:9, k] = _summed(rest[:, None] * push, node, len(t))
    before = np.clip(np.searchsorted(increments.t, t - _SAME), 0, len(increments) - 1)
    return TruthIntegrals(spread, uneven, (increments.dv_ib_b / increments.dt[:, None])[before])


def _summed(values: FloatArray, node: IntArray, count: int) -> FloatArray:
    """Sums over the pieces that end in each node, which stand behind each other."""
    out = np.zeros((count, values.shape[1]))
    if len(node):
        first = np.flatnonzero(np.diff(node, prepend=-1))
        out[node[first]] = np.add.reduceat(values, first, axis=0)
    return out
