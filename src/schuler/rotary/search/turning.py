"""Linear covariance of a mission whose IMU a platform turns: the vehicle is linearised once, schedules are replayed.

How errors of navigation grow depends on the vehicle alone. Turning the IMU changes only how its own errors enter: the
sensor columns of the transition. They are integrated here for any schedule, in milliseconds, and everything else of
:mod:`schuler.budget` stays as it is.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from schuler.arrays import FloatArray, IntArray
from schuler.budget.linearisation import Linearised
from schuler.budget.scenario import BudgetMission
from schuler.exceptions import InputError
from schuler.filtering.states import BLOCKS
from schuler.rotary.schedule import Schedule
from schuler.simulation.motion import Motion, inertial_quantities

_PIECE = 0.5  # longest piece of the quadrature under a vehicle that moves [s]
_PIECES = 2000  # in all, under one at rest
_TURN = 0.5  # of the platform in a piece, at most [rad]
_SAME = 1e-7  # times that are one [s]
_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(4)


@dataclass(frozen=True, eq=False)
class TurningMission:
    """A mission of a vehicle, ready to be replayed with an IMU that turns on it.

    Attributes
    ----------
    fixed : BudgetMission
        With the IMU fixed to the vehicle.
    t : ndarray, shape (n,)
        Even steps of what follows. [s]
    table : ndarray, shape (n, 15)
        Motion of the vehicle: ``C_eb`` row by row, specific force and angular rate, body axes.
    force : ndarray, shape (n, 3)
        Integral of the specific force since the start, Earth-fixed axes. [m/s]
    blocks : tuple of str
        Sensor blocks whose columns are made.
    piece : float
        Longest piece of the quadrature. [s]
    """

    fixed: BudgetMission
    t: FloatArray
    table: FloatArray
    force: FloatArray
    blocks: tuple[str, ...]
    piece: float = _PIECE

    def with_schedule(self, schedule: Schedule) -> BudgetMission:
        """The mission with the IMU turning: for ``true_covariance``, ``linear_covariance`` and replays.

        Parameters
        ----------
        schedule : Schedule

        Notes
        -----
        Errors of the platform are not in it, nor is an offset of the IMU from where its axes meet; the aids are as with
        a perfect encoder. White noise is the same about all axes, so that turning does not change it.
        """
        run = self.fixed.run
        B = np.zeros_like(run.B)
        columns = np.flatnonzero(self._wanted())
        B[:, :, columns] = _columns(self, schedule, run.layout.table()[columns])
        H = _turned_rows(self, schedule) if self._levers() else run.H
        return replace(self.fixed, run=replace(run, B=np.ascontiguousarray(B), H=H))

    def _wanted(self) -> FloatArray:
        rows = {row for block in self.blocks for row in BLOCKS[block]}
        return np.array([tuple(r) in rows for r in self.fixed.run.layout.table()])

    def _levers(self) -> bool:
        return bool(np.any(self.fixed.run.H[:, :, self.fixed.run.layout["b_g"]]))


def turning_mission(
    fixed: BudgetMission, motion: Motion, blocks: tuple[str, ...], *, rate_hz: float = 20.0, earth_rotation: bool = True
) -> TurningMission:
    """Prepare a mission for turning IMUs.

    Parameters
    ----------
    fixed : BudgetMission
        Mission of the vehicle with the IMU fixed to it, as from :func:`schuler.budget.scenario.linearised_mission`.
    motion : Motion
        The same of the vehicle.
    blocks : tuple of str
        Sensor blocks that will be asked for: of the filter's states and of the IMU's errors. Biases always are.
    rate_hz : float
        Rate of the table of the vehicle's attitude, between whose entries it changes linearly.
    earth_rotation : bool

    Raises
    ------
    InputError
        For uneven accelerometers, whose errors are not linear in what turning changes.
    """
    if fixed.asymmetry or fixed.quadratic:
        raise InputError("accelerometers with asymmetry or nonlinearity are not among the errors of a turning IMU")
    n = max(int(np.ceil(motion.duration * rate_hz)), 2)
    t = np.linspace(0.0, motion.duration, n + 1)
    state = motion.state(t)
    omega, f = inertial_quantities(state, earth_rotation=earth_rotation)
    table = np.concatenate((state.C_eb.reshape(-1, 9), f, omega), axis=1)
    f_e = np.einsum("nij,nj->ni", state.C_eb, f)
    step = 0.5 * (f_e[1:] + f_e[:-1]) * np.diff(t)[:, None]
    force = np.concatenate((np.zeros((1, 3)), np.cumsum(step, axis=0)))
    rests = bool(np.ptp(table[:, :12], axis=0).max() < 1e-6)
    piece = max(_PIECE, motion.duration / _PIECES) if rests else _PIECE
    return TurningMission(fixed, t, table, force, tuple(dict.fromkeys(("b_a", "b_g", *blocks))), piece)


def _columns(turning: TurningMission, schedule: Schedule, table: IntArray) -> FloatArray:
    """Sensor columns of the transition into each node, by the rule of ``filtering.kernels.accumulation``."""
    run = turning.fixed.run
    edges = _edges(run, schedule, turning.piece)
    h = np.diff(edges)
    at = (edges[:-1, None] + 0.5 * h[:, None] * (1.0 + _NODES)).ravel()
    C_es, f_s, omega_s = _seen(turning, schedule, at)
    regressors = np.concatenate((np.ones((len(at), 1)), f_s, omega_s), axis=1).reshape(len(h), -1, 7)
    C = C_es.reshape(len(h), -1, 9) * (0.5 * h[:, None] * _WEIGHTS)[:, :, None]
    # integrals over each piece of C_es times each regressor: (piece, row, axis, regressor)
    moments = np.matmul(np.swapaxes(C, 1, 2), regressors).reshape(len(h), 3, 3, 7)
    pushed = -moments[:, :, table[:, 1], table[:, 2]]
    gyro = table[:, 0] == 0
    e, w = np.where(gyro, pushed, 0.0), np.where(gyro, 0.0, pushed)
    node = np.searchsorted(run.t, 0.5 * (edges[1:] + edges[:-1]))
    first = np.flatnonzero(np.diff(node, prepend=-1))
    group = np.cumsum(np.diff(node, prepend=-1) != 0) - 1
    dv = np.diff(_at(turning.t, turning.force, edges), axis=0)
    psi = _before(e, first, group) + 0.5 * e
    # dv = psi x dv_e + accelerometer error, column by column
    x, y, z = (dv[:, k, None] for k in range(3))
    w[:, 0] += psi[:, 1] * z - psi[:, 2] * y
    w[:, 1] += psi[:, 2] * x - psi[:, 0] * z
    w[:, 2] += psi[:, 0] * y - psi[:, 1] * x
    moved = h[:, None, None] * (_before(w, first, group) + 0.5 * w)
    B = np.zeros((len(run.t), 9, len(table)))
    for rows, values in ((slice(0, 3), e), (slice(3, 6), w), (slice(6, 9), moved)):
        B[node[first], rows] = np.add.reduceat(values, first, axis=0)
    return B


def _turned_rows(turning: TurningMission, schedule: Schedule) -> FloatArray:
    """Measurement rows with the gyroscope columns that a lever arm has, in the turning axes."""
    run = turning.fixed.run
    node = np.searchsorted(run.upd, np.arange(len(run.H)), side="right")
    t = run.t[node]
    _, f_s, omega_s = _seen(turning, schedule, t)
    H = run.H.copy()
    own = np.matmul(run.H[:, :, run.layout["b_g"]], schedule.C_bs(t))
    regressors = np.concatenate((np.ones((len(t), 1)), f_s, omega_s), axis=1)
    for k, (sensor, axis, source) in enumerate(run.layout.table()):
        if sensor == 0:
            H[:, :, 9 + k] = own[:, :, axis] * regressors[:, None, source]
    return H


def _edges(run: Linearised, schedule: Schedule, piece: float) -> FloatArray:
    """Limits of the pieces: nodes of the run, jumps of the platform, and steps in which it turns little."""
    nodes = np.unique(run.t)
    nodes = nodes[np.concatenate(([True], np.diff(nodes) > _SAME))]
    start, stop = float(nodes[0]), float(nodes[-1])
    breaks = schedule.breakpoints(start, stop)
    limits = np.sort(np.concatenate((nodes, breaks)))
    limits = limits[np.concatenate(([True], np.diff(limits) > _SAME))]
    h = np.diff(limits)
    rates = schedule.rates(np.concatenate((limits[:-1] + 1e-3 * h, limits[1:] - 1e-3 * h)))
    turned = h * np.abs(rates).sum(axis=1).reshape(2, -1).max(axis=0)
    parts = np.maximum(np.ceil(np.maximum(h / piece, turned / _TURN) - 1e-9), 1.0).astype(np.int64)
    edges: FloatArray = np.interp(
        np.arange(int(parts.sum()) + 1), np.concatenate(([0], np.cumsum(parts))), limits
    )  # fmt: skip
    return edges


def _seen(turning: TurningMission, schedule: Schedule, t: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """``C_es``, specific force and inertial rate of the IMU in its own axes. Shapes (n, 3, 3), (n, 3), (n, 3)."""
    row = _at(turning.t, turning.table, t)
    C_bs = schedule.C_bs(t)
    C_es = np.matmul(row[:, :9].reshape(-1, 3, 3), C_bs)
    carried = np.matmul(row[:, None, 9:12], C_bs)[:, 0], np.matmul(row[:, None, 12:15], C_bs)[:, 0]
    return C_es, carried[0], carried[1] + schedule.omega_bs_s(t)


def _at(grid: FloatArray, table: FloatArray, t: FloatArray) -> FloatArray:
    """Linear interpolation of all columns on even steps."""
    x = np.clip((t - grid[0]) / (grid[1] - grid[0]), 0.0, len(grid) - 1.0)
    k = np.minimum(x.astype(np.int64), len(grid) - 2)
    share = (x - k)[:, None]
    return np.asarray((1.0 - share) * table[k] + share * table[k + 1])


def _before(values: FloatArray, first: IntArray, group: IntArray) -> FloatArray:
    """Sums of what came before within each group of pieces."""
    total = np.cumsum(values, axis=0) - values
    return np.asarray(total - total[first][group])
