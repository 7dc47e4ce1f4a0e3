"""Arrays that the compiled filter works on, by what they are: tuples with names, for Python and for the kernels.

All arrays are C-contiguous float64 or int64. Plain numbers in these tuples never change during a run. This module does
not import numba.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from schuler.arrays import FloatArray, IntArray
from schuler.filtering.limits import MAX_STATES
from schuler.filtering.measurements import MeasurementSchedule


class ImuStream(NamedTuple):
    """IMU samples, body axes; the last may be the last of the run, after which the covariance is brought up to date."""

    dtheta: FloatArray  # (k, 3) [rad]
    dv: FloatArray  # (k, 3) [m/s]
    dt: FloatArray  # (k,) [s]
    t: FloatArray  # (k,) ends of the intervals [s]
    ends: bool


class Aiding(NamedTuple):
    """Measurements of a :class:`~schuler.filtering.measurements.MeasurementSchedule`, and what became of each."""

    t: FloatArray  # (m,)
    kind: IntArray  # (m,)
    z: FloatArray  # (m, N_VALUES)
    R: FloatArray  # (m, 9)
    lever: FloatArray  # (m, 3)
    gate: FloatArray  # (m,)
    status: IntArray  # (m,)
    nis: FloatArray  # (m,)
    innovation: FloatArray  # (m, 3)
    variance: FloatArray  # (m, 3)

    @classmethod
    def of(cls, s: MeasurementSchedule) -> Aiding:
        """Arrays of a schedule, no measurement used yet."""
        m = len(s)
        given = (s.z, s.R.reshape(m, 9), s.lever)
        z, R, lever = (np.ascontiguousarray(x) for x in given)
        t, gate = np.ascontiguousarray(s.t), np.ascontiguousarray(s.gate)
        kind = np.ascontiguousarray(s.kind, dtype=np.int64)
        empty = np.full((m, 3), np.nan), np.full((m, 3), np.nan)
        return cls(t, kind, z, R, lever, gate, np.zeros(m, dtype=np.int64), np.full(m, np.nan), *empty)


class Model(NamedTuple):
    """What the filter believes: its parameters, their dynamics, the noise of the IMU, the turning Earth."""

    table: IntArray  # (m, 3) sensor, axis, regressor of each parameter
    dynamics: FloatArray  # (m, 2) inverse correlation time, density of the driving noise
    on_attitude: IntArray  # sensor parameters that act on the attitude
    places: IntArray  # first state of each block in limits.PLACES, or -1
    most: FloatArray  # (n,) variances to which those of a filter that is wrong are enlarged at most
    psd: FloatArray  # (6,) white noise of gyroscopes and accelerometers
    n_sensor: int
    response: bool  # scale factors, misalignments or g-sensitivities are estimated
    cross: bool  # g-sensitivities are: accelerometer errors act on the attitude
    free_axes: bool  # cross-couplings of both triads are: the body axes are free, see kernels.axes
    omega: float  # Earth rate [rad/s]


class Settings(NamedTuple):
    """How the filter runs, see :class:`~schuler.filtering.engine.FilterOptions`."""

    every: int  # samples between two propagations of the covariance
    flush_angle: float
    record_s: float
    output_every: int
    lockout: int
    hold_s: float
    adaptive: bool
    gap_s: float
    gap_gyro: float
    gap_accel: float


class FilterArrays(NamedTuple):
    """State of a running filter: everything that one call hands to the next."""

    nav: FloatArray  # (10,) q_eb, v_eb_e, r_eb_e
    est: FloatArray  # (m,) parameter estimates
    P: FloatArray  # (n, PAD) covariance, see kernels.covariance
    sens: FloatArray  # (33,) estimated sensor errors
    acc: FloatArray  # (8,) transition accumulated since the last propagation
    moment: FloatArray  # (3,) velocity increments times mid time
    before: FloatArray  # (5 + m,) 1 after an update, and attitude and parameters before it, see kernels.axes
    past: FloatArray  # (every + 2, N_PAST) intervals since the last propagation
    history: FloatArray  # (14,) two previous increments and their durations
    times: FloatArray  # (2,) of the state, of the next record [s]
    counts: IntArray  # running counts by the indices in kernels.run
    gates: FloatArray  # (kinds, N_GATE) memory of the innovation test, see kernels.gate
    psd: FloatArray  # (6,) the model's, times what innovations showed
    dynamics: FloatArray  # (m, 2) likewise
    arcs: FloatArray  # (MOST_CHANNELS,) time of each channel's last carrier phase [s]


class Workspace(NamedTuple):
    """Memory that kernels write before they read it."""

    poly: FloatArray  # (3, 18) raw, compensated, part of an interval
    increments: FloatArray  # (3, 6) now, before, earlier
    reg: FloatArray  # (7,) integrals of the regressors
    noise: FloatArray  # (6,)
    B: FloatArray  # (n_sensor, 9) parameter columns of the transition
    A: FloatArray  # (9, 9)
    rows: FloatArray  # (9, PAD)
    turned: FloatArray  # (9, PAD)
    left: FloatArray  # (m,) of each parameter after an interval
    mean: FloatArray  # (m,)
    sums: FloatArray  # (4, 7, 9)
    N: FloatArray  # (9,)
    M: FloatArray  # (2, 3, 3)
    H: FloatArray  # (3, PAD)
    W: FloatArray  # (3, PAD)
    G: FloatArray  # (3, PAD)
    y: FloatArray  # (3,)
    e: FloatArray  # (3,)
    S: FloatArray  # (3, 3)
    L: FloatArray  # (3, 3)
    U: FloatArray  # (3, 3)
    dx: FloatArray  # (n,)
    R: FloatArray  # (9,) covariance of the measurement as the filter takes it

    @classmethod
    def of_size(cls, n: int, n_sensor: int) -> Workspace:
        """Workspace for n states, of which n_sensor are errors of the IMU."""
        A = np.zeros((9, 9))
        A[2, 2] = 1.0
        H, W, G = (aligned(3, MAX_STATES) for _ in range(3))
        return cls(
            np.zeros((3, 18)), np.zeros((3, 6)), np.zeros(7), np.zeros(6), np.zeros((n_sensor, 9)), A,
            aligned(9, MAX_STATES), aligned(9, MAX_STATES), np.ones(n - 9), np.ones(n - 9),
            np.zeros((4, 7, 9)), np.zeros(9), np.zeros((2, 3, 3)), H, W, G, np.zeros(3), np.zeros(3),
            np.zeros((3, 3)), np.zeros((3, 3)), np.zeros((3, 3)), np.zeros(n), np.zeros(9),
        )  # fmt: skip


class TrajectoryArrays(NamedTuple):
    """Output trajectory; of length zero, it is not written."""

    t: FloatArray
    q: FloatArray  # (k, 4)
    v: FloatArray  # (k, 3)
    r: FloatArray  # (k, 3)

    @classmethod
    def of_size(cls, k: int) -> TrajectoryArrays:
        """Room for k epochs."""
        return cls(np.empty(k), np.empty((k, 4)), np.empty((k, 3)), np.empty((k, 3)))


class RecordArrays(NamedTuple):
    """Records of state and covariance; of length zero, they are not written."""

    t: FloatArray
    nav: FloatArray  # (k, 10)
    est: FloatArray  # (k, m)
    P: FloatArray  # (k, n (n + 1) / 2) lower triangles

    @classmethod
    def of_size(cls, k: int, n: int) -> RecordArrays:
        """Room for k records of n states."""
        return cls(np.empty(k), np.empty((k, 10)), np.empty((k, n - 9)), np.empty((k, n * (n + 1) // 2)))


class NodeArrays(NamedTuple):
    """What the smoother needs of every propagation and update; of length zero, it is not kept."""

    t: FloatArray  # (k,)
    P: FloatArray  # (k, n (n + 1) / 2) predicted covariance
    phi: FloatArray  # (k, 11) accumulated transition, position
    B: FloatArray  # (k, 9, n_sensor)
    upd: IntArray  # (k,) updates up to and at the node
    W: FloatArray  # (u, 3, n) L^-1 H P
    G: FloatArray  # (u, 3, n) L^-1 H
    e: FloatArray  # (u, 3) whitened innovation

    @classmethod
    def of_size(cls, k: int, u: int, n: int, n_sensor: int) -> NodeArrays:
        """Room for k propagations and u updates of n states."""
        return cls(
            np.empty(k), np.empty((k, n * (n + 1) // 2)), np.empty((k, 11)), np.empty((k, 9, max(n_sensor, 1))),
            np.zeros(k, dtype=np.int64), np.empty((u, 3, n)), np.empty((u, 3, n)), np.empty((u, 3)),
        )  # fmt: skip


class SmootherNodes(NamedTuple):
    """Nodes of a forward run and what else its backward pass needs."""

    t: FloatArray  # (k,), this and the next seven as in :class:`NodeArrays`, cut to what was written
    P: FloatArray
    phi: FloatArray
    B: FloatArray
    upd: IntArray
    W: FloatArray
    G: FloatArray
    e: FloatArray
    pmod: FloatArray  # (m, 2) dynamics of the parameters, see :class:`Model`
    n_sensor: int
    i_clock: int  # first state of a receiver clock, or -1
    omega: float


def nothing_after(n: int) -> FloatArray:
    """What the smoother carries backwards, at the end of a run of n states. Shape (n + 2, PAD)."""
    return np.zeros((n + 2, MAX_STATES))


def aligned(*shape: int) -> FloatArray:
    """Zeros that begin on a cache line, as vectors of eight numbers like it."""
    size = int(np.prod(shape))
    block = np.zeros(size + 8)
    first = (-block.ctypes.data // 8) % 8
    return block[first : first + size].reshape(shape)
