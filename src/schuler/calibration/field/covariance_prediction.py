"""Covariance of the calibration filter over turns and rests that are planned, or of a log, without its innovations."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from schuler import earth, frames, rotation
from schuler.arrays import FloatArray
from schuler.calibration.field.blocks import Blocks
from schuler.calibration.field.held_rests import hold_rests, scale_wander
from schuler.calibration.field.options import FieldOptions
from schuler.calibration.field.problem import FREE_HEADING, TILT_SIGMA, field_layout
from schuler.calibration.field.schedule import FREE_ACCEL, BlockNoise, rest_schedule
from schuler.exceptions import InputError
from schuler.filtering.engine import FilterOptions, run, unpack_symmetric
from schuler.filtering.error_model import ecef_from_ned_states, sensor_matrices
from schuler.filtering.initial_state import InitialState
from schuler.filtering.states import StateLayout
from schuler.mechanization.strapdown import NavState, mechanize
from schuler.plotting.notebook import Abridged
from schuler.recording.series import ImuSeries, Increments
from schuler.simulation.steps import Rest, Step, Turn
from schuler.standstill.stationarity import StaticIntervals

if TYPE_CHECKING:
    from schuler.sensors.spec import ImuSpec

#: Part of a rest that the search for rests cuts, both ends together. [s]
UNUSED_REST_S = 0.2
#: Longest step, longest block of readings, and spacing of the filter's propagations. [s]
_STEP_S, _BLOCK_S, _PROPAGATE_S = 0.25, 2.5, 1.0
_TURN_STEP_S = 0.1  # of the turns of a log [s]


@dataclass(frozen=True, repr=False)
class CovarianceState(Abridged):
    """Attitude and covariance of the calibration filter at some time.

    Attributes
    ----------
    C_nb : ndarray, shape (3, 3)
        Attitude.
    P : ndarray, shape (n, n)
        Covariance of all states of the layout, navigation errors north, east, down.
    prior_sigma : ndarray, shape (p,)
        1-sigma of the parameters before the log.
    layout : StateLayout
    llh : ndarray, shape (3,)
        [rad, rad, m]
    noise : BlockNoise
    gyro_psd : ndarray, shape (3,)
        [rad^2/s]
    options : FieldOptions
    gravity : float
        0 for that of the ellipsoid. [m/s^2]
    secondary_from : float
        Time from which the gravity vector is used, counted from this state. [s]
    """

    C_nb: FloatArray
    P: FloatArray
    prior_sigma: FloatArray
    layout: StateLayout
    llh: FloatArray
    noise: BlockNoise
    gyro_psd: FloatArray
    options: FieldOptions
    gravity: float = 0.0
    secondary_from: float = 0.0

    @property
    def share(self) -> FloatArray:
        """1-sigma of each parameter over that before the log. Shape (p,)."""
        return _share(self.P, self.prior_sigma)


@dataclass(frozen=True, repr=False)
class PredictedCovariance(Abridged):
    """Covariance after a sequence of steps.

    Attributes
    ----------
    t : ndarray, shape (k,)
        Time from the start of the steps; the end comes last. [s]
    share : ndarray, shape (k, p)
        1-sigma of each parameter over that before the log, at these times.
    state : CovarianceState
        State at the end.
    """

    t: FloatArray
    share: FloatArray
    state: CovarianceState


def initial_covariance(
    spec: ImuSpec,
    *,
    latitude: float,
    height: float = 0.0,
    gravity: float | None = None,
    heading_sigma: float = FREE_HEADING,
    options: FieldOptions | None = None,
    layout: StateLayout | None = None,
) -> CovarianceState:
    """State before a log: the specification, and a level sensor to 0.1 rad.

    Parameters
    ----------
    spec : ImuSpec
    latitude, height : float
        [rad], [m]
    gravity : float, optional
        As in :func:`schuler.calibration.field.calibration.calibrate_field`. [m/s^2]
    heading_sigma : float
        [rad]
    options : FieldOptions, optional
    layout : StateLayout, optional
        States in place of the specification's.

    Raises
    ------
    InputError
        If the specification has no noise or nothing to calibrate.
    """
    options = options or FieldOptions()
    layout = layout or field_layout(spec, options)
    if not (spec.accel.random_walk > 0.0 and spec.gyro.random_walk > 0.0):
        raise InputError(f"the specification {spec.name} has no noise: give the random walks of both triads")
    prior = np.sqrt(layout.initial_variances())
    P = np.diag(np.concatenate(([TILT_SIGMA, TILT_SIGMA, heading_sigma], np.full(3, 0.1), np.ones(3), prior)) ** 2)
    noise = BlockNoise(np.full(3, spec.accel.random_walk), np.full(3, spec.gyro.random_walk))
    return CovarianceState(
        np.eye(3), P, prior, layout, np.array([latitude, 0.0, height]), noise, np.full(3, spec.gyro.random_walk**2),
        options, 0.0 if gravity is None else gravity, options.secondary_from_s,
    )  # fmt: skip


def predict_covariance(
    state: CovarianceState, steps: Sequence[Step], every_s: float | None = None
) -> PredictedCovariance:
    """Run the covariance of the filter over turns and rests.

    Parameters
    ----------
    state : CovarianceState
    steps : sequence of Turn and Rest
        At least one rest; turns are uniform, in place, about axes of the body at that time.
    every_s : float, optional
        Spacing of the returned times, to half a second; None: the end only. [s]

    Returns
    -------
    PredictedCovariance

    Notes
    -----
    The readings are those of perfect sensors, so that no innovation moves an estimate and everything is linearised at
    one point. The filter of a real log is not: its estimates wander at first, columns of H with them, and it separates
    what is not separable (at automotive grade its 1-sigma of an accelerometer bias is 54 % of the prior after one rest
    levelled to 0.1 rad, where 90 % is right). When all parameters are observed both agree.
    """
    options = state.options
    nav = NavState.from_geodetic(0.0, state.llh, np.zeros(3), rotation.rpy_from_dcm(state.C_nb))
    increments, blocks, C = _readings(state, nav, steps)
    total, layout = float(increments.t[-1]), state.layout
    form = "vector" if options.earth_rate == "auto" else options.earth_rate
    if form == "vector":
        complete, begin, end = increments, blocks.t - 0.5 * blocks.length, blocks.t + 0.5 * blocks.length
        rests = [blocks.rest == k for k in range(blocks.rest[-1] + 1)]
        spans = np.array([(begin[r].min(), end[r].max()) for r in rests])
        increments, blocks = hold_rests(complete, blocks, spans)
        layout = scale_wander(layout, increments, complete)
    schedule = rest_schedule(
        blocks, state.noise, state.llh, gravity=state.gravity, primary=options.primary, earth_rate=form,
        secondary=options.secondary, secondary_from=state.secondary_from,
    )  # fmt: skip
    n = state.layout.size
    forward = run(
        increments, schedule, InitialState(nav, state.P, np.zeros(n - 9)), layout, state.gyro_psd,
        np.full(3, FREE_ACCEL**2),
        FilterOptions(
            covariance_rate_hz=1.0 / _PROPAGATE_S, record_s=2.0 * total if every_s is None else every_s,
            output_rate_hz=1.0 / total, lockout=0,
        ),
    )  # fmt: skip
    P = unpack_symmetric(forward.rec_P, n)
    T = ecef_from_ned_states(state.llh, n)
    last = T.T @ P[-1] @ T
    after = replace(state, C_nb=C, P=0.5 * (last + last.T), secondary_from=state.secondary_from - total)
    return PredictedCovariance(forward.rec_t.copy(), _share(P, state.prior_sigma), after)


def _readings(state: CovarianceState, nav: NavState, steps: Sequence[Step]) -> tuple[Increments, Blocks, FloatArray]:
    """Increments, blocks of the rests, and the attitude at the end."""
    g, omega_ie = earth.gravity_ned(state.llh[0], state.llh[2]), earth.earth_rate_ned(state.llh[0])
    t = 0.0
    parts, angles, spans = [], [], []
    for step in steps:
        m = max(1, int(np.ceil(step.duration_s / _STEP_S - 1e-9)))
        parts.append((m, step.duration_s / m))
        angles.append(step.angle / m * step.unit if isinstance(step, Turn) else np.zeros(3))
        t += step.duration_s
        if isinstance(step, Rest):
            used = max(step.duration_s - UNUSED_REST_S, 0.1 * step.duration_s)
            spans.append((t - 0.5 * (step.duration_s + used), used))
    count = np.array([m for m, _ in parts])
    d, r = np.repeat([h for _, h in parts], count), np.repeat(np.array(angles), count, axis=0)
    Q, half = rotation.dcm_from_rotvec(r), rotation.dcm_from_rotvec(0.5 * r)
    C = np.empty((len(d), 3, 3))  # at the beginning of each
    C[0] = state.C_nb
    for k in range(len(d) - 1):
        C[k + 1] = C[k] @ Q[k]
    middle = C @ half
    increments = Increments(np.cumsum(d), d, r + d[:, None] * (omega_ie @ middle), d[:, None] * (-g @ middle))
    # attitudes as the filter carries them on, coning of its polynomials included
    C_nb = frames.C_en(state.llh).T @ rotation.dcm_from_quat(mechanize(increments, nav).q_eb)
    blocks = [int(np.ceil(used / _BLOCK_S - 1e-9)) for _, used in spans]
    edges = [start + np.linspace(0.0, used, k + 1) for (start, used), k in zip(spans, blocks, strict=True)]
    when = np.concatenate([0.5 * (e[1:] + e[:-1]) for e in edges])
    C_blocks = C_nb[np.searchsorted(increments.t, when)]
    number = np.repeat(np.arange(len(blocks)), blocks)
    length = np.concatenate([np.diff(e) for e in edges])
    return increments, Blocks(when, length, -g @ C_blocks, omega_ie @ C_blocks, number), C_nb[-1]


def _share(P: FloatArray, prior_sigma: FloatArray) -> FloatArray:
    """1-sigma over that of the prior; zero where the prior has none."""
    sigma = np.sqrt(np.maximum(np.einsum("...ii->...i", P)[..., 9:], 0.0))
    return np.asarray(np.where(prior_sigma > 0.0, sigma / np.where(prior_sigma > 0.0, prior_sigma, 1.0), 0.0))


def covariance_after_log(
    before: CovarianceState,
    imu: ImuSeries,
    rests: StaticIntervals,
    blocks: Blocks,
    values: FloatArray,
    heading: float = 0.0,
) -> CovarianceState:
    """State after a log, from its turns and rests.

    Parameters
    ----------
    before : CovarianceState
        State before the log, with the noise of the log.
    imu : ImuSeries
        Raw readings, SI.
    rests : StaticIntervals
        At least one.
    blocks : Blocks
        Means over the blocks of the rests.
    values : ndarray, shape (p,)
        Parameters; biases of the gyroscopes are taken from the rests.
    heading : float
        Heading of the first rest. [rad]

    Returns
    -------
    CovarianceState
        Attitude and covariance in the last rest.

    Notes
    -----
    Inclinations are those of the accelerometers in each rest, turns between them those of the gyroscopes, made to end
    at the next inclination. Both are off by the errors to be calibrated, 50 mrad by a bias or 1 % of a turn, and so are
    the columns of H: a share of 10 % may be one of 9.5 %.
    """
    _, b_a, M_g, M_a, G_g = sensor_matrices(before.layout, values)
    rates = imu.rates()
    f = np.linalg.solve(np.eye(3) + M_a, (rates.accel - b_a).T).T
    numbers = np.arange(len(rests))
    down = np.array([-f[a:b].mean(axis=0) for a, b in rests.index])
    down /= np.linalg.norm(down, axis=1, keepdims=True)
    raw = np.array([blocks.omega[blocks.rest == k].mean(axis=0) for k in numbers])
    bias = np.median(raw + np.linalg.norm(f[0]) * down @ G_g.T, axis=0)
    omega = np.linalg.solve(np.eye(3) + M_g, (rates.gyro - bias - f @ G_g.T).T).T
    angle = np.cumsum(omega * np.diff(rates.t, prepend=rates.t[0])[:, None], axis=0)
    roll, pitch = np.arctan2(down[0, 1], down[0, 2]), np.arctan2(-down[0, 0], np.hypot(down[0, 1], down[0, 2]))
    C = start = rotation.dcm_from_rpy((roll, pitch, heading))
    steps: list[Step] = []
    for k in numbers:
        b = int(rests.index[k, 1])
        # the readings of the rest are used to its ends; the time that is cut there is taken from the turns
        steps.append(Rest(float(rests.stop[k] - rests.start[k]) + UNUSED_REST_S))
        if k + 1 == len(rests):
            break
        c = int(rests.index[k + 1, 0])
        turn_s = max(float(rests.start[k + 1] - rests.stop[k]) - UNUSED_REST_S, 0.5 * _TURN_STEP_S)
        m = max(1, round(turn_s / _TURN_STEP_S))
        parts = np.diff(angle[np.linspace(b - 1, c, m + 1).round().astype(np.int64)], axis=0)
        parts, C = _closed_on_vertical(C, parts, down[k + 1])
        steps += [_turn(part, turn_s / m) for part in parts]
    return predict_covariance(replace(before, C_nb=start), steps).state


def _closed_on_vertical(C: FloatArray, parts: FloatArray, down: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Parts of a turn from an attitude, corrected to end with the measured vertical; attitude at the end."""
    after = np.empty((len(parts), 3, 3))
    for k, Q in enumerate(rotation.dcm_from_rotvec(parts)):
        after[k] = after[k - 1] @ Q if k else Q
    Q_turn = after[-1]
    axis = np.cross(down, (C @ Q_turn)[2])
    size = np.linalg.norm(axis)
    if size < 1e-12:
        return parts, C @ Q_turn
    correction = np.arctan2(size, down @ (C @ Q_turn)[2]) * axis / size
    return parts + (Q_turn @ correction) @ after / len(parts), C @ Q_turn @ rotation.dcm_from_rotvec(correction)


def _turn(part: FloatArray, duration_s: float) -> Turn:
    angle = float(np.linalg.norm(part))
    return Turn(tuple(part.tolist()), angle, duration_s) if angle > 0.0 else Turn("x", 0.0, duration_s)
