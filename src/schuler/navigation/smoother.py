"""Fixed-interval smoothing of a forward run."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Self

import numpy as np
from numpy.typing import NDArray

from schuler import rotation
from schuler.arrays import FloatArray
from schuler.filtering.engine import unpack_symmetric
from schuler.filtering.node_parts import smooth_nodes
from schuler.recording.trajectory import KEPT, FullTrajectory

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
        Smoothed output trajectory, of a long run without ``keep`` a :class:`CorrectedTrajectory`, and navigation states
        at the records.
    parameters : ndarray, shape (k, m)
        Smoothed parameter estimates at the records.
    covariance_e : ndarray, shape (k, n, n)
        Smoothed covariance at the records, Earth-fixed axes.

    Notes
    -----
    Corrections are computed at every propagation (10 Hz by default) and interpolated linearly between; over 0.1 s that
    leaves ``a dt^2 / 8`` of the difference of two accelerations, micrometres.
    """
    nodes, shown = result._nodes, result.layout.size
    assert nodes is not None
    if not keep:
        object.__setattr__(result, "_nodes", None)
    t_nodes, minus, plus, dx, packed = smooth_nodes(nodes, result.t)
    del nodes
    states = result.states
    trajectory: FullTrajectory = CorrectedTrajectory(result.trajectory, t_nodes, minus, plus)
    if keep or len(trajectory) < KEPT:
        trajectory = trajectory.samples(slice(None))
    return (
        trajectory,
        FullTrajectory(
            states.t,
            states.r_eb_e + dx[:, 6:9],
            states.v_eb_e + dx[:, 3:6],
            rotation.quat_multiply(rotation.quat_from_rotvec(dx[:, 0:3]), states.q_eb),
        ),
        result.parameters + dx[:, 9:shown],
        unpack_symmetric(packed[:, : shown * (shown + 1) // 2], shown),
    )


class CorrectedTrajectory(FullTrajectory):
    """A trajectory with a smoother's corrections, made anew when asked for: kept, that of a day at 200 Hz takes 1.4 GB.

    Parameters
    ----------
    filtered : FullTrajectory
    t_nodes : ndarray, shape (k,)
        Times of the corrections. [s]
    minus, plus : ndarray, shape (k, 9)
        Corrections of attitude, velocity and position before and after the measurements of each node, Earth-fixed axes.
    """

    def __init__(self, filtered: FullTrajectory, t_nodes: FloatArray, minus: FloatArray, plus: FloatArray) -> None:
        object.__setattr__(self, "t", filtered.t)
        object.__setattr__(self, "_filtered", filtered)
        object.__setattr__(self, "_corrections", (t_nodes, minus, plus))
        object.__setattr__(self, "_cache", {})

    _filtered: FullTrajectory
    _corrections: tuple[FloatArray, FloatArray, FloatArray]

    @property
    def r_eb_e(self) -> FloatArray:
        """Position. Shape (n, 3). [m]"""
        return self._whole("r_eb_e", 3)

    @property
    def v_eb_e(self) -> FloatArray:
        """Velocity. Shape (n, 3). [m/s]"""
        return self._whole("v_eb_e", 3)

    @property
    def q_eb(self) -> FloatArray:
        """Attitude, body to Earth-fixed axes. Shape (n, 4)."""
        return self._whole("q_eb", 4)

    def _whole(self, name: str, columns: int) -> FloatArray:
        values = np.empty((len(self), columns))
        for rows in self.blocks():
            values[rows] = getattr(self.samples(rows), name)
        return values

    def _samples(self, k: NDArray[Any] | slice, t: FloatArray) -> Self:
        from schuler.filtering.kernels import smoother

        part = self._filtered._samples(k, t)
        r, v, q = part.r_eb_e.copy(), part.v_eb_e.copy(), part.q_eb.copy()
        smoother.apply_corrections(np.ascontiguousarray(self.t[k]), q, v, r, *self._corrections)
        return FullTrajectory(t, r, v, q)  # type: ignore[return-value]
