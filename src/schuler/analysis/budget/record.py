"""A run linearised along the truth: transitions and measurement rows, once for all IMUs, filters and error sources."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from schuler import earth
from schuler.analysis.budget.truth_integrals import truth_integrals
from schuler.arrays import FloatArray, IntArray
from schuler.exceptions import InputError
from schuler.filtering.engine import FilterOptions, InitialState, run
from schuler.filtering.measurements import DIMENSIONS, RESET_KINDS, MeasurementSchedule
from schuler.filtering.states import BLOCKS, StateLayout, StateModel
from schuler.mechanization.strapdown import NavState
from schuler.recording.series import Increments, Trajectory

#: Sensor blocks that are recorded; every other parameterisation is made of their columns.
SENSOR_BLOCKS = ("b_a", "b_g", "S_a", "S_g", "M_a6", "M_g", "G_g")


@dataclass(frozen=True)
class Linearised:
    """Transitions and measurements along a true trajectory, Earth-fixed axes.

    Attributes
    ----------
    t : ndarray, shape (k,)
        Nodes: every propagation; the first is the start. [s]
    acc : ndarray, shape (k, 8)
        Accumulated transition into each node, see ``filtering._covariance_kernels``.
    place : ndarray, shape (k, 3)
        True position. [m]
    B : ndarray, shape (k, 9, s)
        Sensor columns of the transition.
    upd : ndarray of int, shape (k,)
        Updates up to and at each node.
    H : ndarray, shape (u, 3, n)
        Rows of every update, order of ``layout``.
    R : ndarray, shape (u, 3, 3)
    kind : ndarray of int, shape (u,)
    layout : StateLayout
        All recorded parameters.
    omega : float
        Earth rate used. [rad/s]
    spread, uneven : ndarray, shapes (3, k, 2, 9), (k, 9, 6)
        Noise of single axes and uneven accelerometers, see :class:`.truth_integrals.TruthIntegrals`.
    seen : ndarray, shape (u, 3, 6)
        Rows of the updates for the same uneven accelerometers: not zero where force itself is measured.
    """

    t: FloatArray
    acc: FloatArray
    place: FloatArray
    B: FloatArray
    upd: IntArray
    H: FloatArray
    R: FloatArray
    kind: IntArray
    layout: StateLayout
    omega: float
    spread: FloatArray
    uneven: FloatArray
    seen: FloatArray

    @property
    def dim(self) -> IntArray:
        """Components of every update. Shape (u,)."""
        return np.array([DIMENSIONS[int(k)] for k in self.kind], dtype=np.int64)

    def columns(self, layout: StateLayout) -> IntArray:
        """For every parameter of another layout the recorded parameter that acts the same. Shape (m,)."""
        place = {tuple(row): i for i, row in enumerate(self.layout.table()[: self.layout.n_sensor])}
        found = []
        for block in layout.models:
            for i, row in enumerate(BLOCKS[block]):
                if row[0] >= 0:
                    found.append(place[row])
                elif block in self.layout:
                    found.append(self.layout[block].start - 9 + i)
                else:
                    raise InputError(f"the state block {block} was not recorded; record the run with its aid")
        return np.array(found, dtype=np.int64)


def linearise(
    increments: Increments,
    schedule: MeasurementSchedule,
    truth: Trajectory,
    *,
    others: dict[str, StateModel] | None = None,
    rate_hz: float = 2.0,
    earth_rotation: bool = True,
) -> Linearised:
    """Record a run along the truth.

    Parameters
    ----------
    increments : Increments
        Ideal, of the true motion.
    schedule : MeasurementSchedule
        Measurements that agree with the truth; their covariances are kept, gates are not asked.
    truth : Trajectory
        True motion with velocity and attitude, its first sample at the start of the increments.
    others : dict of str to StateModel, optional
        State blocks of the aids (lever arm, clock, ...).
    rate_hz : float
        Of nodes; updates always have one of their own.
    earth_rotation : bool
        As the ideal increments were made.

    Notes
    -----
    The engine itself runs, with a zero covariance, unit measurement noise and no process noise: its whitened rows are
    then H itself, its gains zero, its state the truth.
    """
    if truth.v_eb_e is None or truth.q_eb is None:
        raise InputError("truth: expected a trajectory with velocity and attitude, got one without")
    if np.isin(schedule.kind, RESET_KINDS).any():
        raise InputError("resets have no memory: a linear covariance needs measurements that are weighed")
    models = {name: StateModel.constant(0.0) for name in SENSOR_BLOCKS}
    layout = StateLayout(models | {n: StateModel.constant(0.0) for n in others or {}})
    n = layout.size
    unit = np.broadcast_to(np.eye(3), schedule.R.shape).copy()
    used = replace(schedule, R=unit, gate=np.where(schedule.gate < 0.0, schedule.gate, np.inf))
    options = FilterOptions(
        covariance_rate_hz=rate_hz, record_s=1e9, output_rate_hz=1e-3, lockout=0, smoother=True,
        earth_rotation=earth_rotation, flush_angle=0.3,
    )  # fmt: skip
    start = NavState(float(truth.t[0]), truth.r_eb_e[0], truth.v_eb_e[0], truth.q_eb[0])
    initial = InitialState(start, np.zeros((n, n)), np.zeros(n - 9))
    done = run(increments, used, initial, layout, np.zeros(3), np.zeros(3), options)
    nodes = done.nodes
    if nodes is None:
        raise KeyboardInterrupt
    taken = done.status == 1
    upd = np.asarray(nodes.upd, dtype=np.int64)
    found = truth_integrals(increments, truth, nodes.t, nodes.phi[:, 0])
    # an error of force acts on a measurement as a bias of its size does
    force = found.force[np.searchsorted(upd, np.arange(len(nodes.G)), side="right")]
    bias = nodes.G[:, :, layout["b_a"]]
    seen = np.concatenate((bias * np.abs(force)[:, None], bias * (force**2)[:, None]), axis=2)
    return Linearised(
        nodes.t, np.ascontiguousarray(nodes.phi[:, :8]), np.ascontiguousarray(nodes.phi[:, 8:]), nodes.B, upd, nodes.G,
        schedule.R[taken], schedule.kind[taken], layout, earth.WGS84.omega_ie if earth_rotation else 0.0, found.spread,
        found.uneven, seen,
    )  # fmt: skip
