"""Replays of a linearised run for one filter: covariance, gains, and what each error source contributes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from schuler import frames
from schuler.arrays import ArrayLike, BoolArray, FloatArray, IntArray
from schuler.budget.linearisation import Linearised
from schuler.budget.nodes import Nodes
from schuler.exceptions import InputError
from schuler.filtering.engine import filter_model
from schuler.filtering.error_model import ecef_from_ned_states
from schuler.filtering.filter_arrays import Model, Workspace, aligned
from schuler.filtering.limits import MAX_STATES
from schuler.filtering.states import StateLayout


@dataclass(frozen=True)
class FilterReplay:
    """Covariance of a filter along the truth.

    Attributes
    ----------
    t : ndarray, shape (r,)
        Times of the records. [s]
    P : ndarray, shape (r, n, n)
        Navigation errors north, east, down.
    K : ndarray, shape (u, n, 3)
        Gains, Earth-fixed axes.
    node : ndarray of int, shape (k,)
        Record of each node, or -1.
    """

    t: FloatArray
    P: FloatArray
    K: FloatArray
    node: IntArray


@dataclass(frozen=True)
class System:
    """States replayed together: a filter's, and others that it does not correct.

    Attributes
    ----------
    layout : StateLayout
    rows : ndarray of int, shape (n_f,)
        Places of the filter's states.
    """

    layout: StateLayout
    rows: IntArray


def records_at(run: Linearised, times: ArrayLike) -> IntArray:
    """Record of each node: the last node not after each of the times. Shape (k,), -1 for none."""
    wanted = np.unique(np.searchsorted(run.t, np.asarray(times, dtype=np.float64) + 1e-6, side="right") - 1)
    node = np.full(len(run.t), -1, dtype=np.int64)
    wanted = wanted[wanted >= 0]
    node[wanted] = np.arange(len(wanted))
    return node


def replay_filter(
    run: Linearised,
    layout: StateLayout,
    P0: FloatArray,
    gyro_psd: float,
    accel_psd: float,
    node: IntArray,
    *,
    R: FloatArray | None = None,
) -> FilterReplay:
    """Covariance of a filter through a linearised run.

    Parameters
    ----------
    run : Linearised
    layout : StateLayout
        What the filter estimates.
    P0 : ndarray, shape (n, n)
        At the start, navigation errors north, east, down.
    gyro_psd, accel_psd : float
        ``N**2``. [rad^2/s], [m^2/s^3]
    node : ndarray of int, shape (k,)
        From :func:`records_at`.
    R : ndarray, shape (u, 3, 3), optional
        What the filter believes of its measurements; those of the run by default.
    """
    from schuler.budget import _replay_kernels as k

    k.prepare_replay()
    n = layout.size
    P = aligned(n, MAX_STATES)
    T = ecef_from_ned_states(frames.llh_from_ecef(run.place[0]), n)
    P[:, :n] = T @ P0 @ T.T
    K = np.zeros((len(run.H), n, 3))
    count = int(node.max()) + 1
    out = np.empty((count, n, n))
    nodes = _nodes(run, layout, run.R if R is None else R, node)
    model = _model(run, layout, gyro_psd, accel_psd)
    k.replay_filter(nodes, P, model, Workspace.of_size(n, layout.n_sensor), K, out)
    at = node >= 0
    turn = ecef_from_ned_states(frames.llh_from_ecef(run.place[at]), n)
    return FilterReplay(run.t[at], np.swapaxes(turn, 1, 2) @ out @ turn, K, node)


def replay_noise(
    run: Linearised,
    system: System,
    filtered: FilterReplay,
    *,
    gyro_psd: float = 0.0,
    accel_psd: float = 0.0,
    C0: FloatArray | None = None,
    axis: int | None = None,
    driven: int | None = None,
    measured: BoolArray | None = None,
) -> FloatArray:
    """Covariance of the true navigation error from one kind of noise, the filter's gains given. Shape (r, 9, 9).

    Parameters
    ----------
    run : Linearised
    system : System
        Models of the layout are those of the truth that count here; others must have no noise.
    filtered : FilterReplay
    gyro_psd, accel_psd : float
        White noise, if it is what counts.
    axis : {0, 1, 2}, optional
        White noise of this body axis alone, of one triad; all three by default.
    driven : int, optional
        Place of the only state whose driving noise counts; all by default.
    C0 : ndarray, shape (n, n), optional
        Covariance of the true errors at the start, north, east, down; zero by default.
    measured : ndarray of bool, shape (u,), optional
        Updates whose noise counts; none by default.
    """
    from schuler.budget import _replay_kernels as k

    layout = system.layout
    n = layout.size
    C = aligned(n, MAX_STATES)
    if C0 is not None:
        T = ecef_from_ned_states(frames.llh_from_ecef(run.place[0]), n)
        C[:, :n] = T @ C0 @ T.T
    noise = np.zeros((len(run.H), 3, 3))
    if measured is not None:
        noise[measured] = run.R[measured]
    if axis is not None and gyro_psd > 0.0 and accel_psd > 0.0:
        raise InputError("axis: expected white noise of one triad, got that of both; replay them one after the other")
    model = _model(run, layout, gyro_psd, accel_psd)
    if driven is not None:
        model.dynamics[np.arange(n - 9) != driven - 9, 1] = 0.0
    Q = np.zeros((0, 2, 9))
    if axis is not None:
        Q = (gyro_psd + accel_psd) * run.spread[axis]
        model.psd[:] = 0.0
    nodes = _nodes(run, layout, noise, filtered.node)
    out = np.empty((int(filtered.node.max()) + 1, 9, 9))
    k.replay_covariance(
        nodes, C, model, Workspace.of_size(n, layout.n_sensor), Q, 0 if gyro_psd > 0.0 else 3, filtered.K, system.rows,
        out,
    )  # fmt: skip
    turn = _turn(run, filtered.node)
    return np.asarray(np.swapaxes(turn, 1, 2) @ out @ turn)


def replay_constants(
    run: Linearised, system: System, filtered: FilterReplay, X0: FloatArray, uneven: FloatArray | None = None
) -> FloatArray:
    """True navigation error that constant errors make, the filter's gains given. Shape (r, 9, c).

    Parameters
    ----------
    X0 : ndarray, shape (n, c)
        Errors at the start, one column for each source; navigation rows north, east, down.
    uneven : ndarray, shape (6, e), optional
        Asymmetry x, y, z [-] and quadratic error x, y, z [1/(m/s^2)] of accelerometers, of the last e columns.
    """
    from schuler.budget import _replay_kernels as k

    layout = system.layout
    T = ecef_from_ned_states(frames.llh_from_ecef(run.place[0]), layout.size)
    X = np.ascontiguousarray(T @ X0)
    out = np.empty((int(filtered.node.max()) + 1, 9, X.shape[1]))
    sizes = np.zeros((6, 0)) if uneven is None else uneven
    U, V = np.ascontiguousarray(run.uneven @ sizes), np.ascontiguousarray(run.seen @ sizes)
    nodes = _nodes(run, layout, run.R, filtered.node)
    work = Workspace.of_size(layout.size, layout.n_sensor)
    k.replay_columns(nodes, X, U, V, _model(run, layout), work, filtered.K, system.rows, out)
    return np.asarray(np.swapaxes(_turn(run, filtered.node), 1, 2) @ out)


def _nodes(run: Linearised, layout: StateLayout, R: FloatArray, node: IntArray) -> Nodes:
    """Transitions and updates for a layout's own states, with covariances R of the updates."""
    columns = run.columns(layout)
    B = np.ascontiguousarray(run.B[:, :, columns[: layout.n_sensor]])
    states = np.concatenate((np.arange(9), 9 + columns)).astype(np.int64)
    H = np.ascontiguousarray(run.H[:, :, states])
    return Nodes(run.acc, run.place, B, run.upd, H, np.ascontiguousarray(R.reshape(-1, 9)), run.dim, node)


def _model(run: Linearised, layout: StateLayout, gyro_psd: float = 0.0, accel_psd: float = 0.0) -> Model:
    """What a replay believes: dynamics of the layout, equal white noise of all axes."""
    return filter_model(layout, [gyro_psd] * 3, [accel_psd] * 3)._replace(omega=run.omega)


def _turn(run: Linearised, node: IntArray) -> FloatArray:
    return ecef_from_ned_states(frames.llh_from_ecef(run.place[node >= 0]), 9)
