"""Arrays of a linearised run as the compiled replays take them; importable without numba."""

from __future__ import annotations

from typing import NamedTuple

from schuler.arrays import FloatArray, IntArray


class Nodes(NamedTuple):
    """Nodes and updates of a linearised run for the states of one system, Earth-fixed axes."""

    acc: FloatArray  # (k, 8) transition into each node, see filtering.kernels.covariance
    place: FloatArray  # (k, 3) position [m]
    B: FloatArray  # (k, 9, s) sensor columns of the transition
    upd: IntArray  # (k,) updates up to and at each node
    H: FloatArray  # (u, 3, n) rows of every update
    R: FloatArray  # (u, 9) covariance
    dim: IntArray  # (u,) components
    rec: IntArray  # (k,) row of the output, or -1
