"""Fixed-interval smoothing of a forward run."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from schuler import rotation
from schuler.arrays import FloatArray
from schuler.filtering.engine import unpack_symmetric
from schuler.recording.trajectory import FullTrajectory

if TYPE_CHECKING:
    from schuler.navigation.result import NavigationResult


def smooth_run(
    result: NavigationResult, *, keep: bool = True
) -> tuple[FullTrajectory, FullTrajectory, FloatArray, FloatArray]:
    """Backward pass over the nodes of a forward run.

    Parameters
    ----------
    result : NavigationResult
        The filtered solution, with what the run kept: predicted covariances, transitions and updates at every
        propagation.
    keep : bool
        False to take that out of the result.

    Returns
    -------
    trajectory, states : FullTrajectory
        Smoothed output trajectory and navigation states at the records.
    parameters : ndarray, shape (k, m)
        Smoothed parameter estimates at the records.
    covariance_e : ndarray, shape (k, n, n)
        Smoothed covariance at the records, Earth-fixed axes.

    Notes
    -----
    Corrections are computed at every propagation (10 Hz by default) and interpolated linearly between; over 0.1 s that
    leaves ``a dt^2 / 8`` of the difference of two accelerations, micrometres.
    """
    from schuler.filtering.kernels import smoother as k

    k.prepare_smoother()
    nodes = result._nodes
    assert nodes is not None
    if not keep:
        object.__setattr__(result, "_nodes", None)
    n, shown, n_nodes = nodes.W.shape[2], result.layout.size, len(nodes.t)
    at = np.searchsorted(nodes.t, result.t + 1e-9) - 1  # the last of a time: a covariance enlarged there has two
    record = np.full(n_nodes, -1, dtype=np.int64)
    record[at] = np.arange(len(at))
    minus, plus = np.empty((n_nodes, n)), np.empty((n_nodes, n))
    packed = np.empty((len(result.t), n * (n + 1) // 2))
    k.smooth(nodes, record, minus, plus, packed)
    t_nodes = nodes.t.copy()
    del nodes
    trajectory, states = result.trajectory, result.states
    q, v, r = trajectory.q_eb.copy(), trajectory.v_eb_e.copy(), trajectory.r_eb_e.copy()
    k.apply_corrections(trajectory.t, q, v, r, t_nodes, minus, plus)
    dx = plus[at]
    return (
        FullTrajectory(trajectory.t, r, v, q),
        FullTrajectory(
            states.t,
            states.r_eb_e + dx[:, 6:9],
            states.v_eb_e + dx[:, 3:6],
            rotation.quat_multiply(rotation.quat_from_rotvec(dx[:, 0:3]), states.q_eb),
        ),
        result.parameters + dx[:, 9:shown],
        unpack_symmetric(packed[:, : shown * (shown + 1) // 2], shown),
    )
