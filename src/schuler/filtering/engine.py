"""The filter engine: one error-state Kalman filter around one strapdown mechanization, for batch and live use.

The state of a filter lives in a few flat arrays (:class:`FilterState`) that one compiled function works on, whether it
is given a whole log or one sample. What the states are and which measurements come is data: a
:class:`~schuler.filtering.states.StateLayout` and a :class:`~schuler.filtering.measurements.MeasurementSchedule`.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from schuler import earth
from schuler.arrays import ArrayLike, FloatArray, as_floats, as_vector3
from schuler.exceptions import InputError
from schuler.filtering.error_model import ecef_from_ned_states
from schuler.filtering.limits import MAX_STATES, PLACES
from schuler.filtering.measurements import KINDS, RESET_KINDS, MeasurementSchedule
from schuler.filtering.states import StateLayout
from schuler.mechanization.alignment import Alignment
from schuler.mechanization.strapdown import NavState
from schuler.recording.series import Increments

Progress = Callable[[float], None]

_CHUNK = 200_000  # epochs between two signs of progress, about a tenth of a second


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
        Rejections of a kind, less acceptances, after which the next one is accepted all the same (and marked), so that
        an over-confident filter finds back, also one that a few of many satellites suit; 0 never does.
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
    smoother: bool = False
    earth_rotation: bool = True
    gap_s: float | None = None
    gap_gyro: float = 0.0
    gap_accel: float = 0.0

    def __post_init__(self) -> None:
        for name in ("covariance_rate_hz", "flush_angle", "record_s", "output_rate_hz", "gap_s"):
            value = getattr(self, name)
            if value is not None and not value > 0.0:
                raise InputError(f"{name}: expected a positive number, got {value!r}")
        if self.lockout < 0:
            raise InputError(f"lockout: expected a count of rejections, 0 for never; got {self.lockout}")


@dataclass(frozen=True)
class InitialState:
    """Where a filter starts: navigation state, parameter estimates, and the covariance of their errors.

    Attributes
    ----------
    nav : NavState
    P : ndarray, shape (n, n)
        Covariance, navigation errors in north-east-down axes, order of the layout.
    parameters : ndarray, shape (n - 9,)
        Parameter estimates.
    """

    nav: NavState
    P: FloatArray
    parameters: FloatArray

    def __post_init__(self) -> None:
        P = as_floats(self.P, "InitialState.P")
        n = len(P)
        if P.ndim != 2 or P.shape != (n, n) or n < 9:
            raise InputError(f"InitialState.P: expected a square matrix of at least 9 states, got shape {P.shape}")
        if np.any(np.diag(P) < 0.0):
            raise InputError(f"InitialState.P: expected variances of 0 or more, got {np.diag(self.P).min():.3g}")
        sigma = np.sqrt(np.diag(P))
        if np.any(np.abs(P - P.T) > 1e-9 * np.outer(sigma, sigma)):
            raise InputError("InitialState.P: expected a symmetric matrix")
        object.__setattr__(self, "P", 0.5 * (P + P.T))
        object.__setattr__(self, "parameters", as_floats(self.parameters, "InitialState.parameters", (n - 9,)))

    @classmethod
    def from_sigmas(
        cls,
        nav: NavState,
        layout: StateLayout,
        *,
        attitude: ArrayLike,
        velocity: ArrayLike,
        position: ArrayLike,
        parameters: FloatArray | None = None,
    ) -> InitialState:
        """From 1-sigma values.

        Parameters
        ----------
        nav : NavState
        layout : StateLayout
            Its models give the initial uncertainty of the parameters.
        attitude, velocity, position : array_like, shape (3,) or (3, 3)
            1-sigma values north, east, down, or covariances. [rad], [m/s], [m]
        parameters : ndarray, shape (m,), optional
            Parameter estimates, default zero.
        """
        P = np.zeros((layout.size, layout.size))
        for i, (name, value) in enumerate((("attitude", attitude), ("velocity", velocity), ("position", position))):
            block = np.asarray(value, dtype=np.float64)
            part = slice(3 * i, 3 * i + 3)
            P[part, part] = as_floats(block, name, (3, 3)) if block.ndim == 2 else np.diag(as_vector3(value, name) ** 2)
        P[range(9, layout.size), range(9, layout.size)] = layout.initial_variances()
        return cls(nav, P, np.zeros(layout.size - 9) if parameters is None else parameters)

    def aligned(self, alignment: Alignment, layout: StateLayout) -> InitialState:
        """The same state with the covariance of an attitude and of the biases that spoiled it, correlated as they are.

        Parameters
        ----------
        alignment : Alignment
            Where the attitude of ``nav`` came from.
        layout : StateLayout
            Its bias blocks are correlated with the attitude; where it has none, the alignment's own bias sigmas count.
        """
        P = self.P.copy()
        P[:3, :] = P[:, :3] = 0.0
        P[:3, :3] = alignment.cov_noise_n
        for block, psi, sigma in (
            ("b_a", alignment.psi_accel, alignment.sigma_b_a),
            ("b_g", alignment.psi_gyro, alignment.sigma_b_g),
        ):
            part = layout[block] if block in layout else slice(0, 0)
            P_b = P[part, part] if block in layout else sigma**2 * np.eye(3)
            if sigma > 0.0:
                P[:3, :3] += psi @ P_b @ psi.T
                if block in layout:
                    P[:3, part] = psi @ P_b
                    P[part, :3] = P[:3, part].T
        return InitialState(self.nav, P, self.parameters)


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
        from schuler.filtering.kernels import covariance as cov
        from schuler.filtering.kernels import run as run_k

        n = layout.size
        if len(initial.P) != n:
            raise InputError(
                f"the initial covariance has {len(initial.P)} states, the layout {n}: make both of one layout"
            )
        m = n - 9
        T = ecef_from_ned_states(initial.nav.llh, n)
        self.layout, self.options = layout, options
        self.nav = np.concatenate((initial.nav.q_eb, initial.nav.v_eb_e, initial.nav.r_eb_e))
        self.est = initial.parameters.copy()
        self.P = np.zeros((n, MAX_STATES))
        self.P[:, :n] = T @ initial.P @ T.T
        self.P[:, :n] = 0.5 * (self.P[:, :n] + self.P[:, :n].T)
        self.sens = np.zeros(33)
        self.acc, self.B = np.zeros(8), np.zeros((9, max(layout.n_sensor, 1)))
        self.hist = np.zeros(14)
        self.ptab, self.pmod = layout.table(), layout.dynamics()
        if m == 0:
            self.ptab, self.pmod = np.zeros((1, 3), np.int64), np.zeros((1, 2))
        self.q_imu = np.concatenate((as_vector3(gyro_psd, "gyro_psd"), as_vector3(accel_psd, "accel_psd")))
        if np.any(self.q_imu < 0.0):
            raise InputError("noise densities: expected non-negative values of N**2")
        every = (
            1 if options.covariance_rate_hz is None else max(1, round(1.0 / (options.covariance_rate_hz * interval)))
        )
        out_every = 1 if options.output_rate_hz is None else max(1, round(1.0 / (options.output_rate_hz * interval)))
        sources = {name for name in layout.models if name[0] in "SMG"}
        self.cfg = np.zeros(run_k.N_CFG)
        self.cfg[run_k.CFG_OMEGA] = earth.WGS84.omega_ie if options.earth_rotation else 0.0
        self.cfg[run_k.CFG_ANGLE] = options.flush_angle
        self.cfg[run_k.CFG_RECORD] = options.record_s
        self.cfg[run_k.CFG_NEXT_RECORD] = initial.nav.t + options.record_s
        self.cfg[run_k.CFG_TIME] = initial.nav.t
        self.cfg[run_k.CFG_GAP] = np.inf if options.gap_s is None else options.gap_s
        self.cfg[run_k.CFG_GAP_GYRO] = options.gap_gyro
        self.cfg[run_k.CFG_GAP_ACCEL] = options.gap_accel
        self.icfg = np.zeros(run_k.N_ICFG, dtype=np.int64)
        self.icfg[run_k.ICFG_EVERY] = every
        self.icfg[run_k.ICFG_MATRIX] = int(bool(sources))
        self.icfg[run_k.ICFG_SENSORS] = layout.n_sensor
        self.icfg[run_k.ICFG_AT :] = [layout[name].start if name in layout else -1 for name in PLACES]
        self.icfg[run_k.ICFG_LOCKOUT] = options.lockout
        self.icfg[run_k.ICFG_OUT_EVERY] = out_every
        self.cnt = np.zeros(run_k.N_CNT, dtype=np.int64)
        self.locks = np.zeros(max(KINDS) + 1, dtype=np.int64)
        run_k.prepare_filter()
        cov.spread_estimates(self.est, self.ptab, layout.n_sensor, self.sens)

    @property
    def arrays(self) -> tuple[Any, ...]:
        """State, model and settings in the order the kernel takes them."""
        return (
            self.nav, self.est, self.P, self.sens, self.acc, self.B, self.hist, self.ptab, self.pmod, self.q_imu,
            self.cfg, self.icfg, self.cnt, self.locks,
        )  # fmt: skip

    @property
    def navigation(self) -> NavState:
        """Current navigation state."""
        from schuler.filtering.kernels import run as run_k

        return NavState(
            float(self.cfg[run_k.CFG_TIME]), self.nav[7:10].copy(), self.nav[4:7].copy(), self.nav[0:4].copy()
        )

    @property
    def covariance_e(self) -> FloatArray:
        """Covariance in Earth-fixed axes at its last propagation. Shape (n, n)."""
        n = self.layout.size
        return self.P[:, :n].copy()


@dataclass(frozen=True)
class SmootherNodes:
    """What the backward pass needs of a forward run. Internal."""

    t: FloatArray
    P: FloatArray
    phi: FloatArray
    B: FloatArray
    upd: Any
    W: FloatArray
    G: FloatArray
    e: FloatArray
    pmod: FloatArray
    n_sensor: int
    i_clock: int
    omega: float


@dataclass(frozen=True)
class ForwardRun:
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
    nodes: SmootherNodes | None = field(default=None, repr=False)


def run(
    increments: Increments,
    schedule: MeasurementSchedule,
    initial: InitialState,
    layout: StateLayout,
    gyro_psd: ArrayLike,
    accel_psd: ArrayLike,
    options: FilterOptions | None = None,
    progress: Progress | None = None,
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

    Returns
    -------
    ForwardRun
        On Ctrl-C what was computed so far, with ``complete`` False.

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
    n, m, N = layout.size, layout.size - 9, len(increments)
    state = FilterState(initial, layout, gyro_psd, accel_psd, options, float(np.median(increments.dt)))
    in_span = (schedule.t >= increments.start - 1e-9) & (schedule.t <= increments.t[-1] + 1e-9)
    used = schedule.where(in_span)
    M = len(used)
    if options.smoother and np.isin(used.kind, RESET_KINDS).any():
        raise InputError("a run with resets has no memory to smooth over: smoother=False (filter.smooth = false)")
    out_every = int(state.icfg[k.ICFG_OUT_EVERY])
    n_out = (N + out_every - 1) // out_every
    n_rec = int((increments.t[-1] - increments.start) / options.record_s) + 2
    triangle = n * (n + 1) // 2
    n_node = 0
    if options.smoother:
        turned = float(np.linalg.norm(increments.dtheta_ib_b, axis=1).sum())
        n_node = N // int(state.icfg[k.ICFG_EVERY]) + M + n_rec + int(2.0 * turned / options.flush_angle) + 4
        n_node = min(n_node, N + M + 2)
        if options.gap_s is not None:
            n_node += 2 * int(np.sum(increments.dt > options.gap_s))
    n_upd = M if options.smoother else 0
    status = np.zeros(M, dtype=np.int64)
    nis, innovation, variance = np.full(M, np.nan), np.full((M, 3), np.nan), np.full((M, 3), np.nan)
    out = (np.empty(n_out), np.empty((n_out, 4)), np.empty((n_out, 3)), np.empty((n_out, 3)))
    rec = (np.empty(n_rec), np.empty((n_rec, 10)), np.empty((n_rec, m)), np.empty((n_rec, triangle)))
    node = (
        np.empty(n_node), np.empty((n_node, triangle)), np.empty((n_node, 11)),
        np.empty((n_node, 9, max(layout.n_sensor, 1))), np.zeros(n_node, dtype=np.int64),
        np.empty((n_upd, 3, n)), np.empty((n_upd, 3, n)), np.empty((n_upd, 3)),
    )  # fmt: skip
    R = np.ascontiguousarray(used.R.reshape(M, 9))
    complete = True
    try:
        for first in range(0, N, _CHUNK):
            part = slice(first, min(first + _CHUNK, N))
            state.icfg[k.ICFG_LAST] = int(part.stop == N)
            k.run_filter(
                increments.dtheta_ib_b[part], increments.dv_ib_b[part], increments.dt[part], increments.t[part],
                used.t, used.kind, used.z, R, used.lever, used.gate, status, nis, innovation, variance,
                *state.arrays, *out, *rec, *node,
            )  # fmt: skip
            if progress is not None:
                progress(part.stop / N)
    except KeyboardInterrupt:
        complete = False
    cnt = state.cnt
    everywhere = np.zeros(len(schedule), dtype=np.int64)
    everywhere[in_span] = status
    nodes = None
    if options.smoother and complete:
        a, u = int(cnt[k.CNT_NODE]), int(cnt[k.CNT_UPD])
        if a <= int(cnt[k.CNT_FLUSH]):
            raise InputError(
                "the filter diverged: its attitude turns far more than the gyroscopes' readings do. Check units and "
                "axes of the log, and that the specification of the IMU allows for its errors"
            )
        nodes = SmootherNodes(
            t=node[0][:a], P=node[1][:a], phi=node[2][:a], B=node[3][:a], upd=node[4][:a],
            W=node[5][:u], G=node[6][:u], e=node[7][:u],
            pmod=state.pmod, n_sensor=layout.n_sensor,
            i_clock=layout["clock"].start if "clock" in layout else -1, omega=float(state.cfg[k.CFG_OMEGA]),
        )  # fmt: skip
    o, c = int(cnt[k.CNT_OUT]), int(cnt[k.CNT_REC])
    return ForwardRun(
        t=out[0][:o], q=out[1][:o], v=out[2][:o], r=out[3][:o],
        rec_t=rec[0][:c], rec_nav=rec[1][:c], rec_est=rec[2][:c], rec_P=rec[3][:c],
        status=everywhere, nis=_spread(nis, in_span), innovation=_spread(innovation, in_span),
        variance=_spread(variance, in_span),
        epochs=int(cnt[k.CNT_EPOCH]), propagations=int(cnt[k.CNT_FLUSH]), complete=complete, nodes=nodes,
    )  # fmt: skip


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
