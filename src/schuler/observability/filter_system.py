"""Linear systems of real filters: along a motion, or along a navigation run that was made."""

from __future__ import annotations

from dataclasses import replace
from typing import Literal

import numpy as np

from schuler import frames, rotation
from schuler.arrays import ArrayLike, FloatArray, IntArray, as_floats
from schuler.exceptions import InputError
from schuler.filtering.engine import FilterOptions, run, unpack_symmetric
from schuler.filtering.error_model import ecef_from_ned_states
from schuler.filtering.filter_arrays import SmootherNodes
from schuler.filtering.initial_state import InitialState
from schuler.filtering.measurements import RESET_KINDS, MeasurementSchedule
from schuler.filtering.node_parts import whole_nodes
from schuler.filtering.states import StateLayout, StateModel
from schuler.mechanization.strapdown import NavState
from schuler.navigation.result import NavigationResult
from schuler.observability.dynamics import system_matrices, transitions
from schuler.observability.system import LinearSystem, state_names
from schuler.recording.series import ImuSeries
from schuler.simulation.imu import ideal_imu
from schuler.simulation.motion import Motion

_FORCE_ROUNDING = 1e-9  # of the specific force of a motion in Earth-fixed axes of 6e6 m, with a margin [m/s^2]
_LEAST = 1e-13  # variance that can be told from none beside the largest of a measurement
_ENGINE_HZ = 5.0  # of the engine's own transitions: its error stays far below a per mille of a platform's turn


def motion_system(
    motion: Motion,
    schedule: MeasurementSchedule,
    layout: StateLayout,
    *,
    start_sigma: ArrayLike,
    without: tuple[str, ...] = (),
    gyro_psd: float = 0.0,
    accel_psd: float = 0.0,
    earth_rotation: bool = True,
    imu_rate_hz: float = 20.0,
    step: float = 0.2,
    breaks: ArrayLike = (),
    transition: Literal["exact", "engine"] = "exact",
    name: str = "motion",
) -> LinearSystem:
    """The error state of a filter along a motion.

    Parameters
    ----------
    motion : Motion
        Motion of the IMU itself.
    schedule : MeasurementSchedule
        Kinds, times, lever arms and covariances; measured values are not needed, gates are not asked.
    layout : StateLayout
        States and their priors.
    start_sigma : array_like, shape (9,)
        1-sigma of attitude north, east, down [rad], velocity [m/s], position [m].
    without : tuple of str
        States taken as known, such as ``("dr",)``.
    gyro_psd, accel_psd : float
        White noise ``N**2``, for covariances over time. [rad^2/s], [m^2/s^3]
    earth_rotation : bool
    imu_rate_hz : float
        Rate of the ideal increments the engine gets.
    step : float
        Largest step of the exact transitions. [s]
    breaks : array_like, optional
        Moments at which rates jump, see :func:`.dynamics.transitions`. [s]
    transition : {"exact", "engine"}
        By a sixth-order expansion of the system matrix along the motion, or as the engine itself accumulates them.
        Measurement rows are the engine's in both cases.
    name : str

    Returns
    -------
    LinearSystem
        North-east-down. Its ``doubt`` is the difference between two steps, or that of the engine's transitions from
        the exact ones, and what 1e-9 m/s^2 of specific force change: a level that is one to rounding only counts as
        one.

    Raises
    ------
    InputError
        If no measurement lies within the motion, measurements are resets, or a prior is missing.
    """
    if transition not in ("exact", "engine"):
        raise InputError(f"transition: expected 'exact' or 'engine', got {transition!r}")
    nodes, R = _along(motion, schedule, layout, earth_rotation, imu_rate_hz)
    sigma = _priors(start_sigma, layout)
    system, place = _of_nodes(nodes, layout, sigma, name, R)
    psd = system.psd.copy()
    psd[:3], psd[3:6] = gyro_psd, accel_psd
    system = replace(system, psd=psd)

    def matrices(t: FloatArray) -> FloatArray:
        return system_matrices(motion, layout, t, earth_rotation=earth_rotation)

    t = np.minimum(system.t, motion.duration)
    fine = replace(system, step=_turned(transitions(matrices, t, step=0.5 * step, breaks=breaks), place))
    if transition == "exact":
        rough = replace(system, step=_turned(transitions(matrices, t, step=step, breaks=breaks), place))
        system = replace(fine, doubt=np.abs(fine.phi - rough.phi) + _rounded(fine))
    else:
        system = replace(system, doubt=np.abs(fine.phi - system.phi) + _rounded(fine))
    system = replace(system, to_imu=motion.state(t[:1]).C_nb[0])
    return system.without(without) if without else system


def result_system(
    result: NavigationResult,
    *,
    start_sigma: ArrayLike | None = None,
    without: tuple[str, ...] = (),
    gyro_psd: float = 0.0,
    accel_psd: float = 0.0,
) -> LinearSystem:
    """The error state along a navigation run: real IMU, real aids, every kind of measurement.

    Parameters
    ----------
    result : NavigationResult
        Filtered solution of a run with ``filter.smooth = true``, which keeps transitions and rows.
    start_sigma : array_like, shape (9,), optional
        By default what the run itself began with.
    without : tuple of str
    gyro_psd, accel_psd : float
        ``N**2``, for covariances over time.

    Returns
    -------
    LinearSystem
        North-east-down, from the start of the run.

    Raises
    ------
    InputError
        If the run kept nothing.

    Notes
    -----
    The run keeps ``G = L^-1 H`` and ``W = L^-1 H P`` with ``L L' = H P H' + R``; the noise of the rows ``G`` is then
    ``I - W G'``, by which they are whitened. Corrections of the state act on later transitions, as in the filter
    itself.
    """
    if result._nodes is None:
        raise InputError("this run kept no transitions: navigate with filter.smooth = true, and do not smooth it first")
    nodes = whole_nodes(result._nodes)
    n = result.layout.size
    prior = None
    if start_sigma is None:
        T = ecef_from_ned_states(frames.llh_from_ecef(nodes.phi[0, 8:11]), n)
        prior = T.T @ unpack_symmetric(nodes.P[:1], n)[0] @ T
        sigma = np.sqrt(np.diag(prior))
    else:
        sigma = _priors(start_sigma, result.layout)
    name = str(result.provenance.get("recording", "recording"))
    system, _ = _of_nodes(nodes, result.layout, sigma, name, None)
    psd = system.psd.copy()
    psd[:3], psd[3:6] = gyro_psd, accel_psd
    first = result.trajectory
    if first.q_eb is not None and len(first.q_eb):
        C_ne = frames.C_en(frames.llh_from_ecef(first.r_eb_e[0])).T
        system = replace(system, to_imu=C_ne @ rotation.dcm_from_quat(first.q_eb[0]))
    system = replace(system, psd=psd, prior=prior)
    return system.without(without) if without else system


def _rounded(system: LinearSystem) -> FloatArray:
    """What rounding of the force can have changed in the transitions: tilts turned into velocity and position."""
    attitude = np.abs(system.phi[:, 0:3, :])
    doubt = np.zeros_like(system.phi)
    dt = np.diff(system.t)[:, None, None]
    doubt[1:, 3:6, :] = _FORCE_ROUNDING * np.cumsum(0.5 * dt * (attitude[1:] + attitude[:-1]), axis=0)
    doubt[1:, 6:9, :] = np.cumsum(0.5 * dt * (doubt[1:, 3:6] + doubt[:-1, 3:6]), axis=0)
    return doubt


def _along(
    motion: Motion, schedule: MeasurementSchedule, layout: StateLayout, earth_rotation: bool, imu_rate_hz: float
) -> tuple[SmootherNodes, FloatArray]:
    """The engine itself along the truth: with no covariance its whitened rows are H, and its gains zero."""
    if np.isin(schedule.kind, RESET_KINDS).any():
        raise InputError("resets have no memory: observability needs measurements that are weighed")
    if "ambiguity_1" in layout:
        raise InputError("carrier phases are not part of an observability analysis: leave gnss.tight.carrier")
    ideal = ideal_imu(motion, imu_rate_hz, earth_rotation=earth_rotation)
    truth = ideal.truth
    increments = ImuSeries(ideal.t[1:], ideal.gyro, ideal.accel, "increment").increments()
    start = NavState(float(truth.t[0]), truth.r_eb_e[0], truth.v_eb_e[0], truth.q_eb[0])
    still = StateLayout({block: StateModel.constant(0.0) for block in layout.models})
    unit = np.broadcast_to(np.eye(3), schedule.R.shape).copy()
    gate = np.where(schedule.gate < 0.0, schedule.gate, np.inf)
    options = FilterOptions(
        covariance_rate_hz=_ENGINE_HZ, record_s=1e9, output_rate_hz=1e-3, lockout=0, smoother=True,
        earth_rotation=earth_rotation,
    )  # fmt: skip
    n = layout.size
    initial = InitialState(start, np.zeros((n, n)), np.zeros(n - 9))
    used = replace(schedule, R=unit, gate=gate)
    done = run(increments, used, initial, still, np.zeros(3), np.zeros(3), options)
    assert done.nodes is not None
    nodes = whole_nodes(done.nodes)
    if not len(nodes.G):
        raise InputError("no measurement lies within the motion: there is nothing to observe with")
    return nodes, schedule.R[done.status == 1]


def _of_nodes(
    nodes: SmootherNodes, layout: StateLayout, sigma: FloatArray, name: str, R: FloatArray | None
) -> tuple[LinearSystem, FloatArray]:
    """System and places of its nodes; ``R`` is the covariance of the rows, None for those of a filter's own run."""
    from schuler.filtering.kernels import covariance as k
    from schuler.filtering.kernels.axes import TURNED

    n, count = layout.size, len(nodes.t)
    decay = layout.dynamics()[:, 0] if n > 9 else np.zeros(0)
    step = np.broadcast_to(np.eye(n), (count, n, n)).copy()
    A, nav = np.zeros((9, 9)), np.zeros(10)
    A[2, 2] = 1.0
    change = np.eye(n)  # after the measurements of a node: a part of the next transition
    for i in range(count):
        acc = np.ascontiguousarray(nodes.phi[i, :8])
        if acc[0] == TURNED:
            change = change_of_axes(nodes.B[i], n) @ change
        if not acc[0] > 0.0:
            continue
        nav[7:10] = nodes.phi[i, 8:11]
        k.transition(A, acc, nav, nodes.omega)
        x = decay * acc[0]
        mean = np.where(x > 0.0, -np.expm1(-x) / np.where(x > 0.0, x, 1.0), 1.0)
        step[i, :9, :9] = A
        step[i, :9, 9 : 9 + layout.n_sensor] = nodes.B[i][:, : layout.n_sensor] * mean[: layout.n_sensor]
        step[i, range(9, n), range(9, n)] = np.exp(-x)
        if nodes.i_clock >= 0:
            step[i, nodes.i_clock, nodes.i_clock + 1] = acc[0]
        step[i] = step[i] @ change
        change = np.eye(n)
    G = np.array(nodes.G[:, :, :n])
    if R is None:  # what is left of the unit covariance of innovations is the measurement's own
        R = np.eye(3) - nodes.W[:, :, :n] @ np.swapaxes(G, 1, 2)
    H = _whitened(G, 0.5 * (R + np.swapaxes(R, 1, 2)))
    at = np.searchsorted(np.asarray(nodes.upd), np.arange(len(H)), side="right")
    place = np.array(nodes.phi[:, 8:11])
    t, step, at, place = _merged(np.array(nodes.t), step, at, place)
    T = ecef_from_ned_states(frames.llh_from_ecef(place), n)
    psd = np.concatenate((np.zeros(9), layout.dynamics()[:, 1] if n > 9 else np.zeros(0)))
    sizes = {block: layout[block].stop - layout[block].start for block in layout.blocks}
    system = LinearSystem(
        state_names(sizes), t, _turned(step, place), H @ T[at], at, sigma, psd, to_imu=np.eye(3), name=name
    )
    return system, place


def _whitened(H: FloatArray, R: FloatArray) -> FloatArray:
    """Rows whose noise has unit covariance; single numbers have it in the first place only."""
    out = np.zeros_like(H)
    for i, (rows, cov) in enumerate(zip(H, R, strict=True)):
        used = int(np.max(np.flatnonzero(np.any(rows != 0.0, axis=1)), initial=0)) + 1
        values, vectors = np.linalg.eigh(cov[:used, :used])
        floor = _LEAST * float(np.trace(cov[:used, :used]))
        root = vectors / np.sqrt(np.maximum(values, floor))
        out[i, :used] = root @ vectors.T @ rows[:used]
    return out


def change_of_axes(B: FloatArray, n: int) -> FloatArray:
    """Matrix J of a node at which updates turned the body axes, see ``filtering.kernels.axes``. Shape (n, n)."""
    from schuler.filtering.kernels.axes import IN_L, TILT, TURN, VERTICAL

    D, L, parameters = np.zeros((n, 3)), np.zeros((3, n)), slice(9, 9 + B.shape[1])
    D[:3], D[parameters] = B[TURN, :9].reshape(3, 3), B[:3].T
    L[:, :3], L[:, parameters] = B[TILT, :9].reshape(3, 3), np.outer(B[VERTICAL, :3], B[IN_L])
    return np.asarray(np.eye(n) + D @ L)


def _merged(
    t: FloatArray, step: FloatArray, at: IntArray, place: FloatArray
) -> tuple[FloatArray, FloatArray, IntArray, FloatArray]:
    """One node at a time: those at the same moment are put together."""
    new = np.concatenate(([True], np.diff(t) > 1e-9))
    if new.all():
        return t, step, at, place
    to = np.cumsum(new) - 1
    out = step[new].copy()
    for i in np.flatnonzero(~new):
        out[to[i]] = step[i] @ out[to[i]]
    last = np.append(np.flatnonzero(new)[1:] - 1, len(t) - 1)
    return t[new], out, to[at], place[last]


def _turned(step: FloatArray, place: FloatArray) -> FloatArray:
    """Transitions in Earth-fixed axes turned into north-east-down of both ends."""
    T = ecef_from_ned_states(frames.llh_from_ecef(place), step.shape[-1])
    out = np.swapaxes(T, 1, 2) @ step @ T[np.maximum(np.arange(len(T)) - 1, 0)]
    return np.asarray(out)


def _priors(start_sigma: ArrayLike, layout: StateLayout) -> FloatArray:
    start = as_floats(start_sigma, "start_sigma", (9,))
    return np.concatenate((start, np.sqrt(layout.initial_variances()) if layout.size > 9 else np.zeros(0)))
