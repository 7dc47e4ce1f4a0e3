"""A run linearised along the truth: transitions and measurement rows, once for all IMUs, filters and error sources."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from schuler import earth, rotation
from schuler.arrays import BoolArray, FloatArray, IntArray
from schuler.exceptions import InputError
from schuler.filtering.engine import FilterOptions, run
from schuler.filtering.filter_arrays import SmootherNodes
from schuler.filtering.initial_state import InitialState
from schuler.filtering.measurements import DIMENSIONS, RESET_KINDS, MeasurementSchedule
from schuler.filtering.node_parts import whole_nodes
from schuler.filtering.states import BLOCKS, StateLayout, StateModel
from schuler.mechanization.strapdown import NavState
from schuler.recording.series import Increments
from schuler.recording.trajectory import FullTrajectory

_SAME = 1e-7  # times that are one [s]


@dataclass(frozen=True)
class TruthIntegrals:
    """Integrals over the interval into each node, Earth-fixed axes.

    Attributes
    ----------
    spread : ndarray, shape (3, k, 2, 9)
        Integrals of ``c c'`` with the column c of C_eb of each body axis, its weight falling from 1 to 0 over the
        interval and rising from 0 to 1: what unit white noise of that axis adds before and after the transition. [s]
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
        Length of the interval into each node, zero where the node only has another update. [s]

    Notes
    -----
    The weights keep the integral and its first moment in time, so a body that turns between two nodes spreads its noise
    as it turns; over the three axes they sum to half the interval each, the trapezoid rule of the engine. Columns
    follow the mid-point rule of ``filtering.kernels.accumulation`` and carry its minus sign.
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


#: Sensor blocks that are recorded; every other parameterisation is made of their columns.
SENSOR_BLOCKS = ("b_a", "b_g", "S_a", "S_g", "M_a6", "M_g", "G_g")
#: After which the run starts anew from the truth. [s]
LEG_S = 3600.0


@dataclass(frozen=True)
class Linearised:
    """Transitions and measurements along a true trajectory, Earth-fixed axes.

    Attributes
    ----------
    t : ndarray, shape (k,)
        Nodes: every propagation; the first is the start. [s]
    acc : ndarray, shape (k, 8)
        Accumulated transition into each node, see ``filtering.kernels.covariance``.
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
        Noise of single axes and uneven accelerometers, see :class:`TruthIntegrals`.
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
        places = []
        for block in layout.models:
            for i, row in enumerate(BLOCKS[block]):
                if row[0] >= 0:
                    places.append(place[row])
                elif block in self.layout:
                    places.append(self.layout[block].start - 9 + i)
                else:
                    raise InputError(f"the state block {block} was not recorded; record the run with its aid")
        return np.array(places, dtype=np.int64)


def linearise(
    increments: Increments,
    schedule: MeasurementSchedule,
    truth: FullTrajectory,
    *,
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
    truth : FullTrajectory
        True motion with velocity and attitude, its first sample at the start of the increments.
    rate_hz : float
        Rate of the nodes; updates always have one of their own.
    earth_rotation : bool
        As the ideal increments were made.

    Notes
    -----
    The engine itself runs, with a zero covariance, unit measurement noise and no process noise: its whitened rows are
    then H itself, its gains zero, its state the truth. It starts anew from the truth every hour: nothing corrects its
    height, whose errors of discretisation grow by ``e`` in ten minutes (0.4 m after two hours, 244 m after three).
    """
    if truth.v_eb_e is None or truth.q_eb is None:
        raise InputError("truth: expected a trajectory with velocity and attitude, got one without")
    if np.isin(schedule.kind, RESET_KINDS).any():
        raise InputError("resets have no memory: a linear covariance needs measurements that are weighed")
    layout = StateLayout({name: StateModel.constant(0.0) for name in SENSOR_BLOCKS})
    unit = np.broadcast_to(np.eye(3), schedule.R.shape).copy()
    used = replace(schedule, R=unit, gate=np.where(schedule.gate < 0.0, schedule.gate, np.inf))
    options = FilterOptions(
        covariance_rate_hz=rate_hz, record_s=1e9, output_rate_hz=1e-3, lockout=0, smoother=True,
        earth_rotation=earth_rotation, flush_angle=0.3,
    )  # fmt: skip
    legs = [_leg(part, measured, truth, layout, options) for part, measured in _legs(increments, used)]
    t, phi, B, G = (np.concatenate([getattr(nodes, name) for nodes, _ in legs]) for name in ("t", "phi", "B", "G"))
    before = np.cumsum([0] + [len(nodes.G) for nodes, _ in legs[:-1]])
    upd = np.concatenate([np.asarray(leg.upd, dtype=np.int64) + k for (leg, _), k in zip(legs, before, strict=True)])
    taken = np.concatenate([done for _, done in legs])
    integrals = truth_integrals(increments, truth, t, phi[:, 0])
    # an error of force acts on a measurement as a bias of its size does
    force = integrals.force[np.searchsorted(upd, np.arange(len(G)), side="right")]
    bias = G[:, :, layout["b_a"]]
    seen = np.concatenate((bias * np.abs(force)[:, None], bias * (force**2)[:, None]), axis=2)
    return Linearised(
        t, np.ascontiguousarray(phi[:, :8]), np.ascontiguousarray(phi[:, 8:]), B, upd, G, schedule.R[taken],
        schedule.kind[taken], layout, earth.WGS84.omega_ie if earth_rotation else 0.0, integrals.spread,
        integrals.uneven, seen,
    )  # fmt: skip


def _legs(increments: Increments, schedule: MeasurementSchedule) -> Iterator[tuple[Increments, MeasurementSchedule]]:
    """The run cut into hours. A measurement at a cut belongs to the leg that ends there."""
    turns = np.arange(LEG_S, increments.t[-1] - increments.start - 0.5 * LEG_S, LEG_S)
    cuts = [0, *np.searchsorted(increments.t, increments.start + turns + _SAME), len(increments)]
    begin = -np.inf
    for a, b in pairwise(cuts):
        part = Increments(increments.t[a:b], increments.dt[a:b], increments.dtheta_ib_b[a:b], increments.dv_ib_b[a:b])
        end = np.inf if b == len(increments) else part.t[-1] + _SAME
        yield part, schedule.where((schedule.t > begin) & (schedule.t <= end))
        begin = end


def _leg(
    increments: Increments,
    schedule: MeasurementSchedule,
    truth: FullTrajectory,
    layout: StateLayout,
    options: FilterOptions,
) -> tuple[SmootherNodes, BoolArray]:
    """Nodes of a leg, and which of its measurements were taken."""
    if "ambiguity_1" in layout:
        raise InputError("carrier phases are not part of a budget: leave out gnss.tight.carrier")
    at = truth.at(np.array([increments.start]))
    n = layout.size
    initial = InitialState(
        NavState(increments.start, at.r_eb_e[0], at.v_eb_e[0], at.q_eb[0]), np.zeros((n, n)), np.zeros(n - 9)
    )
    done = run(increments, schedule, initial, layout, np.zeros(3), np.zeros(3), options)
    if done.nodes is None or not done.complete:
        raise KeyboardInterrupt
    return whole_nodes(done.nodes), done.status == 1
