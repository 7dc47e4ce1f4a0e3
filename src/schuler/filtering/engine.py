"""The filter engine: one error-state Kalman filter around one strapdown mechanization, for batch and live use.

The state of a filter lives in a few flat arrays (:class:`FilterState`) that one compiled function works on, whether it
is given a whole log or one sample. What the states are and which measurements come is data: a
:class:`~schuler.filtering.states.StateLayout` and a :class:`~schuler.filtering.measurements.MeasurementSchedule`.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Callable
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Any

import numpy as np

from schuler import earth
from schuler.arrays import ArrayLike, FloatArray, as_vector3
from schuler.exceptions import DivergenceError, InputError
from schuler.filtering.error_model import ecef_from_ned_states
from schuler.filtering.filter_arrays import (
    Aiding,
    FilterArrays,
    ImuStream,
    Model,
    NodeArrays,
    RecordArrays,
    Settings,
    SmootherNodes,
    TrajectoryArrays,
    Workspace,
    aligned,
)
from schuler.filtering.initial_state import InitialState
from schuler.filtering.limits import MAX_STATES, MOST_CHANNELS, PLACES
from schuler.filtering.measurements import KINDS, POSITION, RESET_KINDS, VELOCITY, MeasurementSchedule
from schuler.filtering.node_parts import NodeParts, Part
from schuler.filtering.states import StateLayout
from schuler.mechanization.strapdown import NavState
from schuler.plotting.notebook import Abridged
from schuler.recording.io.possible import MAX_SPEED, RADII
from schuler.recording.series import Increments

Progress = Callable[[float], None]

_CHUNK = 200_000  # epochs between two signs of progress, about a tenth of a second
_NODE_BYTES = 1 << 28  # nodes that are kept at a time; to filter a part again costs a hundredth of what a day does


@dataclass(frozen=True, slots=True)
class FilterOptions:
    """How the filter runs; none of these changes what is estimated.

    Attributes
    ----------
    covariance_rate_hz : float, optional
        Rate at which the covariance is propagated with the accumulated transition; None for every IMU sample.
        Measurements always force a propagation to their own time. 10 Hz leaves sigmas unchanged to 1e-3 and states to
        0.01 sigma (tests/filtering/test_decimation.py).
    flush_angle : float
        Accumulated rotation that forces a propagation. [rad]
    record_s : float
        Spacing of the records of covariance and parameters. [s]
    output_rate_hz : float, optional
        Rate of the output trajectory; None for every IMU sample.
    lockout : int
        Rejections of a kind of single numbers (ranges, wheels), less acceptances, after which the next one is accepted
        all the same (and marked), so that an over-confident filter finds back, also one that a few of many satellites
        suit. Positions and velocities are judged by what rejected ones say among themselves
        (``filtering/kernels/gate.py``). 0: nothing beyond the gate is ever used, and noise does not adapt.
    hold_s : float
        Longest time for which positions or velocities that jump and stay are held off. [s]
    adaptive : bool
        The noise of the IMU, and of fixes that scatter, grows where innovations are far larger than they should be.
    smoother : bool
        Keep what the smoother needs: about 1.5 kB (15 states) or 2.9 kB (21) for each propagation.
    earth_rotation : bool
        False for simulations on an Earth that stands still.
    gap_s : float, optional
        Intervals longer than this are pauses that were bridged: over them the rates are unknown by ...
    gap_gyro, gap_accel : float
        ... these 1-sigma values, constant over the pause, all axes. [rad/s], [m/s^2]
    """

    covariance_rate_hz: float | None = 10.0
    flush_angle: float = 0.3
    record_s: float = 1.0
    output_rate_hz: float | None = None
    lockout: int = 10
    hold_s: float = 100.0
    adaptive: bool = True
    smoother: bool = False
    earth_rotation: bool = True
    gap_s: float | None = None
    gap_gyro: float = 0.0
    gap_accel: float = 0.0

    def __post_init__(self) -> None:
        for name in ("covariance_rate_hz", "flush_angle", "record_s", "output_rate_hz", "hold_s", "gap_s"):
            value = getattr(self, name)
            if value is not None and not value > 0.0:
                raise InputError(f"{name}: expected a positive number, got {value!r}")
        if self.lockout < 0:
            raise InputError(f"lockout: expected a count of rejections, 0 for never; got {self.lockout}")


class FilterState:
    """The arrays a running filter consists of. Internal: use :func:`run` or ``Navigator``.

    Parameters
    ----------
    initial : InitialState
    layout : StateLayout
    gyro_psd, accel_psd : array_like, shape (3,)
        White-noise densities ``N**2`` by axis. [rad^2/s], [m^2/s^3]
    options : FilterOptions
    interval : float
        Nominal IMU sample interval, for the rates of options. [s]
    """

    def __init__(
        self,
        initial: InitialState,
        layout: StateLayout,
        gyro_psd: ArrayLike,
        accel_psd: ArrayLike,
        options: FilterOptions,
        interval: float,
    ) -> None:
        from schuler.filtering.kernels import run as k
        from schuler.filtering.kernels.accumulation import N_PAST
        from schuler.filtering.kernels.gate import N_GATE, start_gates
        from schuler.filtering.kernels.sensor_errors import spread_estimates

        n, m = layout.size, len(initial.P)
        if m not in (n, layout.visible.size):
            raise InputError(f"the initial covariance has {m} states, the layout {n}: make both of one layout")
        self.layout, self.options = layout, options
        self.model = filter_model(layout, gyro_psd, accel_psd, options.earth_rotation)
        self.settings = Settings(
            every=_samples(options.covariance_rate_hz, interval),
            flush_angle=float(options.flush_angle),
            record_s=float(options.record_s),
            output_every=_samples(options.output_rate_hz, interval),
            lockout=int(options.lockout),
            hold_s=float(options.hold_s),
            adaptive=bool(options.adaptive),
            gap_s=np.inf if options.gap_s is None else float(options.gap_s),
            gap_gyro=float(options.gap_gyro),
            gap_accel=float(options.gap_accel),
        )
        nav, T = initial.nav, ecef_from_ned_states(initial.nav.llh, m)
        P, P_e = aligned(n, MAX_STATES), T @ initial.P @ T.T
        P[:m, :m] = 0.5 * (P_e + P_e.T)
        P[range(m, n), range(m, n)] = layout.initial_variances()[m - 9 :]
        est = np.zeros(n - 9)
        est[: m - 9] = initial.parameters
        self._arrays = FilterArrays(
            nav=np.concatenate((nav.q_eb, nav.v_eb_e, nav.r_eb_e)),
            est=est,
            P=P,
            sens=np.zeros(33),
            acc=np.zeros(8),
            moment=np.zeros(3),
            before=np.zeros(n - 4),
            past=np.zeros((self.settings.every + 2, N_PAST)),
            history=np.zeros(14),
            times=np.array([nav.t, nav.t + options.record_s]),
            counts=np.zeros(k.N_CNT, dtype=np.int64),
            gates=np.zeros((max(KINDS) + 1, N_GATE)),
            psd=self.model.psd.copy(),
            dynamics=self.model.dynamics.copy(),
            arcs=np.full(MOST_CHANNELS, -np.inf),
        )
        self.work = Workspace.of_size(n, layout.n_sensor)
        _compile_once()
        start_gates(self._arrays.gates, nav.t)
        spread_estimates(self._arrays.est, self.model.table, layout.n_sensor, self.work.M, self._arrays.sens)

    @property
    def arrays(self) -> FilterArrays:
        """State as the kernel takes it, and leaves it."""
        return self._arrays

    @property
    def noise_factors(self) -> tuple[float, float, float]:
        """Largest factors so far on the variances of the IMU's noise, of positions and of velocities."""
        from schuler.filtering.kernels import gate

        own, r, v = (self._arrays.gates[i] for i in (0, POSITION, VELOCITY))
        return float(own[gate.LARGEST]), float(r[gate.R_LARGEST]), float(v[gate.R_LARGEST])

    @property
    def navigation(self) -> NavState:
        """Current navigation state."""
        nav = self._arrays.nav
        return NavState(float(self._arrays.times[0]), nav[7:10].copy(), nav[4:7].copy(), nav[0:4].copy())

    @property
    def is_broken(self) -> bool:
        """Whether its numbers are none: not finite, a variance below zero, a place or speed that nothing has."""
        nav, variances = self._arrays.nav.tolist(), self._arrays.P.diagonal().tolist()
        moves = math.hypot(*nav[4:7]) <= MAX_SPEED and math.hypot(*nav[7:10]) <= RADII[1]  # not so of NaN
        return not (moves and math.isfinite(sum(nav[:4])) and min(variances) >= 0.0)

    @property
    def covariance_e(self) -> FloatArray:
        """Covariance in Earth-fixed axes at its last propagation. Shape (n, n)."""
        n = self.layout.size
        return self._arrays.P[:, :n].copy()


@functools.cache  # what its arguments' types are takes a sixteenth of the time that short runs take, as those that tune
def _compile_once() -> None:
    """Compile or load the filter's kernels when a process runs it first."""
    from schuler.filtering.kernels.run import prepare_filter

    prepare_filter()


def filter_model(layout: StateLayout, gyro_psd: ArrayLike, accel_psd: ArrayLike, earth_rotation: bool = True) -> Model:
    """What a filter with these states and noise believes, as its kernels take it. Internal.

    Parameters
    ----------
    layout : StateLayout
    gyro_psd, accel_psd : array_like, shape (3,)
        ``N**2`` by axis. [rad^2/s], [m^2/s^3]
    earth_rotation : bool
        False for an Earth that stands still.

    Raises
    ------
    InputError
        If a density is negative.
    """
    psd = np.concatenate((as_vector3(gyro_psd, "gyro_psd"), as_vector3(accel_psd, "accel_psd")))
    if np.any(psd < 0.0):
        raise InputError("noise densities: expected non-negative values of N**2")
    m, cross = layout.size - 9, "G_g" in layout
    table = np.ascontiguousarray(layout.table().reshape(m, 3), dtype=np.int64)
    sensors = table[: layout.n_sensor]
    return Model(
        table=table,
        dynamics=np.ascontiguousarray(layout.dynamics().reshape(m, 2)),
        on_attitude=np.flatnonzero((sensors[:, 0] == 0) | cross),
        places=np.array([layout[name].start if name in layout else -1 for name in PLACES]),
        most=layout.largest_variances(),
        psd=psd,
        n_sensor=layout.n_sensor,
        response=any(name[0] in "SMG" for name in layout.models),
        cross=cross,
        free_axes="M_a6" in layout and "M_g" in layout,
        omega=earth.WGS84.omega_ie if earth_rotation else 0.0,
    )


def _samples(rate_hz: float | None, interval: float) -> int:
    """Samples between two events of a rate; every sample for None."""
    return 1 if rate_hz is None else max(1, round(1.0 / (rate_hz * interval)))


@dataclass(frozen=True, repr=False)
class ForwardRun(Abridged):
    """Raw output of a run, arrays in Earth-fixed axes. Internal: :class:`NavigationResult` is made of it.

    Attributes
    ----------
    t, q, v, r : ndarray
        Output trajectory.
    rec_t, rec_nav, rec_est, rec_P : ndarray
        Records: time, navigation state (10), parameters, packed covariance.
    status, nis, innovation, variance : ndarray
        By measurement.
    complete : bool
        False if the run was interrupted; everything up to then is there.
    noise_factors : tuple of float
        Largest factors by which the variances of the IMU's noise, of positions and of velocities were enlarged.
    """

    t: FloatArray
    q: FloatArray
    v: FloatArray
    r: FloatArray
    rec_t: FloatArray
    rec_nav: FloatArray
    rec_est: FloatArray
    rec_P: FloatArray
    status: Any
    nis: FloatArray
    innovation: FloatArray
    variance: FloatArray
    epochs: int
    propagations: int
    complete: bool
    nodes: SmootherNodes | NodeParts | None = field(default=None, repr=False)
    noise_factors: tuple[float, float, float] = (1.0, 1.0, 1.0)


def run(
    increments: Increments,
    schedule: MeasurementSchedule,
    initial: InitialState,
    layout: StateLayout,
    gyro_psd: ArrayLike,
    accel_psd: ArrayLike,
    options: FilterOptions | None = None,
    progress: Progress | None = None,
    *,
    keep_part: bool = False,
) -> ForwardRun:
    """Run the filter forward over a log.

    Parameters
    ----------
    increments : Increments
        Body axes; the first interval begins at the initial state's time.
    schedule : MeasurementSchedule
        Measurements before the start and after the end of the log are left unused and marked so.
    initial : InitialState
    layout : StateLayout
    gyro_psd, accel_psd : array_like, shape (3,)
        ``N**2`` by axis. [rad^2/s], [m^2/s^3]
    options : FilterOptions, optional
    progress : callable, optional
        Called with the fraction done.
    keep_part : bool
        On Ctrl-C return what was computed so far, with ``complete`` False, instead of raising.

    Returns
    -------
    ForwardRun

    Raises
    ------
    InputError
        If the log does not begin where the initial state is; with the smoother's memory also if the filter diverges so
        far that its own rates need more of it than the readings do.
    """
    from schuler.filtering.kernels import run as k

    options = options or FilterOptions()
    if abs(increments.start - initial.nav.t) > 1e-3:
        raise InputError(
            f"the initial state is at {initial.nav.t:.4f} s but the first interval begins at {increments.start:.4f} s: "
            "cut the log there (between), or start at its time"
        )
    n, N = layout.size, len(increments)
    state = FilterState(initial, layout, gyro_psd, accel_psd, options, float(np.median(increments.dt)))
    in_span = (schedule.t >= increments.start - 1e-9) & (schedule.t <= increments.t[-1] + 1e-9)
    used = schedule.where(in_span)
    if options.smoother and np.isin(used.kind, RESET_KINDS).any():
        raise InputError("a run with resets has no memory to smooth over: smoother=False (filter.smooth = false)")
    every = state.settings.output_every
    n_rec = int((increments.t[-1] - increments.start) / options.record_s) + 2
    aiding = Aiding.of(used)
    out = TrajectoryArrays.of_size((N + every - 1) // every)
    if every == 1 and increments.t.flags.writeable:
        out = out._replace(t=increments.t)  # the same numbers: of a day at 200 Hz 140 MB
    rec = RecordArrays.of_size(n_rec, n)
    edges, keeps = _parts(increments, state, used.t, n_rec) if options.smoother else ([0, N], (0, 0))
    node = NodeArrays.of_size(*keeps, n, layout.n_sensor)

    def filter_epochs(first: int, stop: int, out: TrajectoryArrays, rec: RecordArrays) -> None:
        for start in range(first, stop, _CHUNK):
            part = slice(start, min(start + _CHUNK, stop))
            stream = ImuStream(*increments.arrays(part), part.stop == N)
            k.run_filter(stream, aiding, state.arrays, state.model, state.settings, state.work, out, rec, node)
            if progress is not None and len(out.t):
                progress(part.stop / N)

    arrays = state.arrays
    complete, parts, cnt, carried = True, [], arrays.counts, (*arrays, *state.work)
    try:
        for first, stop in pairwise(edges):
            if first > 0:
                cnt[k.CNT_NODE], cnt[k.CNT_UPD], node.upd[0] = 1, 0, 0
            begun, flushed = tuple(x.copy() for x in carried), int(cnt[k.CNT_FLUSH])
            filter_epochs(first, stop, out, rec)
            parts.append(Part(first, stop, begun, int(cnt[k.CNT_NODE]), int(cnt[k.CNT_UPD])))
            if options.smoother and parts[-1].nodes <= int(cnt[k.CNT_FLUSH]) - flushed:
                raise DivergenceError(
                    "the filter diverged: its attitude turns far more than the gyroscopes' readings do. Check units "
                    "and axes of the log, and that the specification of the IMU allows for its errors"
                )
    except KeyboardInterrupt:
        if not keep_part:
            raise  # a caller that does not ask would take a part for the whole
        complete = False
    everywhere = np.zeros(len(schedule), dtype=np.int64)
    everywhere[in_span] = aiding.status
    nodes: SmootherNodes | NodeParts | None = None
    if options.smoother and complete:
        nodes = smoother_nodes(node, parts[-1].nodes, parts[-1].updates, state)
        if len(parts) > 1:
            none = TrajectoryArrays.of_size(0), RecordArrays.of_size(1, n)  # there is one, so that records are due

            def again(first: int, stop: int) -> None:
                node.upd[0] = 0
                filter_epochs(first, stop, *none)

            nodes = NodeParts(parts, n, carried, again, lambda a, u: smoother_nodes(node, a, u, state))
    o, c = int(cnt[k.CNT_OUT]), int(cnt[k.CNT_REC])
    return ForwardRun(
        t=out.t[:o], q=out.q[:o], v=out.v[:o], r=out.r[:o],
        rec_t=rec.t[:c], rec_nav=rec.nav[:c], rec_est=rec.est[:c], rec_P=rec.P[:c],
        status=everywhere, nis=_spread(aiding.nis, in_span), innovation=_spread(aiding.innovation, in_span),
        variance=_spread(aiding.variance, in_span),
        epochs=int(cnt[k.CNT_EPOCH]), propagations=int(cnt[k.CNT_FLUSH]), complete=complete, nodes=nodes,
        noise_factors=state.noise_factors,
    )  # fmt: skip


def smoother_nodes(node: NodeArrays, nodes: int, updates: int, state: FilterState) -> SmootherNodes:
    """What the smoother is given of the first nodes and updates that a filter kept."""
    layout, a, u = state.layout, nodes, updates
    return SmootherNodes(
        t=node.t[:a], P=node.P[:a], phi=node.phi[:a], B=node.B[:a], upd=node.upd[:a],
        W=node.W[:u], G=node.G[:u], e=node.e[:u],
        pmod=state.model.dynamics, n_sensor=layout.n_sensor,
        i_clock=layout["clock"].start if "clock" in layout else -1, omega=state.model.omega,
    )  # fmt: skip


def _parts(
    increments: Increments, state: FilterState, t_used: FloatArray, records: int
) -> tuple[list[int], tuple[int, int]]:
    """Edges of the parts [epochs] whose nodes are kept at a time, and the most nodes and updates of any of them."""
    N, n = len(increments), state.layout.size
    dt, turned = increments.dt, np.empty(N)
    for first in range(0, N, _CHUNK):
        part = slice(first, first + _CHUNK)
        turned[part] = np.linalg.norm(increments.arrays(part)[0], axis=1)
    size = 8 * (n * (n + 1) // 2 + 9 * state.layout.n_sensor + 13)
    bytes_ = size * _most_nodes(dt, turned, state, len(t_used), records)
    step = max(int(_NODE_BYTES / bytes_ * N) // _CHUNK, 1) * _CHUNK if bytes_ > _NODE_BYTES else N
    edges = [*range(0, N, step), N]
    # as the filter takes them, in the first part with those before the start
    updates = np.diff(np.searchsorted(t_used, increments.t[[e - 1 for e in edges[1:]]] + 1e-9, "right"), prepend=0)
    most = 0
    for first, stop, count in zip(edges, edges[1:], updates.tolist(), strict=False):
        part, span = slice(first, stop), increments.t[stop - 1] - increments.t[first]
        due = int(span / state.options.record_s) + 3
        most = max(most, _most_nodes(dt[part], turned[part], state, count, due) + 1)
    return edges, (most, int(updates.max()))


def _most_nodes(dt: FloatArray, turned: FloatArray, state: FilterState, updates: int, records: int) -> int:
    """Propagations and enlarged covariances that a run can need at most, unless its estimates go wild."""
    options, N = state.options, len(dt)
    count = N // state.settings.every + 2 * updates + records + int(2.0 * turned.sum() / options.flush_angle) + 4
    count = min(count, N + 2 * updates + 2) + updates * state.model.free_axes
    if options.gap_s is not None:
        count += 2 * int(np.sum(dt > options.gap_s))
    return count


def _spread(values: FloatArray, where: Any) -> FloatArray:
    """Values of the selected rows among NaN for the others."""
    full = np.full((len(where), *values.shape[1:]), np.nan)
    full[where] = values
    return full


def unpack_symmetric(packed: FloatArray, n: int) -> FloatArray:
    """Symmetric matrices of packed lower triangles. Shapes (k, n (n + 1) / 2) to (k, n, n)."""
    full = np.empty((len(packed), n, n))
    i, j = np.tril_indices(n)
    full[:, i, j] = packed
    full[:, j, i] = packed
    return full
