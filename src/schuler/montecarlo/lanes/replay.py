"""The data of one run of a campaign in lanes, made again for the engine."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from schuler import frames
from schuler.arrays import FloatArray
from schuler.filtering.engine import run
from schuler.filtering.error_model import ecef_from_ned_states
from schuler.filtering.filter_arrays import aligned
from schuler.filtering.initial_state import InitialState
from schuler.filtering.measurements import (
    ACCEPTED,
    CARRIER_PHASE,
    FORCED,
    POSITION,
    PSEUDORANGE,
    RANGE_RATE,
    REJECTED,
    VELOCITY,
    ZERO_VELOCITY,
    MeasurementSchedule,
)
from schuler.montecarlo.lanes.scenario import LaneScenario, clock_places, draw_run
from schuler.montecarlo.lanes.sky import with_errors
from schuler.navigation.evaluation.consistency import state_errors
from schuler.navigation.result import NavigationResult
from schuler.recording.series import Increments


class Replay(NamedTuple):
    """One run's data, for the engine: what the IMU reported, the measurements, the start, the true parameters.

    Attributes
    ----------
    increments : Increments
    schedule : MeasurementSchedule
    initial : InitialState
    parameters : ndarray, shape (n, m)
        True values of the layout's parameters during each sample, ambiguities left out.
    """

    increments: Increments
    schedule: MeasurementSchedule
    initial: InitialState
    parameters: FloatArray


def replay(scenario: LaneScenario, number: int, *, seed: int = 0) -> Replay:
    """The data that run ``number`` was made of, to rounding: for a closer look with the engine or the smoother.

    ``engine.run(*replay[:3], scenario.layout, scenario.gyro_psd, scenario.accel_psd, scenario.options)`` repeats it.
    """
    ideal, errors, layout = scenario.ideal, scenario.errors, scenario.layout
    n, h = len(ideal.gyro), 1.0 / ideal.rate_hz
    drawn = draw_run(scenario, number, seed)
    white, wandering, fixes = drawn.streams.reshape(3, 4)
    table = errors.table(layout)
    driven = int(np.sum(table[:, 2] > 0.0))
    z = normals_of(white, 6 * n).reshape(n, 6)
    per_sample = 2 * ((3 * driven + 1) // 2)
    drive = normals_of(wandering, per_sample * (n - 1)).reshape(n - 1, per_sample)
    bias = np.tile(drawn.constants[:6], (n, 1))
    parameters = np.tile(drawn.parameters, (n, 1))
    at = 0
    for (sensor, e, q, place, _), start, slope in zip(table, drawn.starts, drawn.slopes, strict=True):
        steps = np.tile(slope, (n, 1))
        steps[0] = start
        if q > 0.0:
            steps[1:] += q * drive[:, at : at + 3]
            at += 3
        history = _recursion(e, steps)
        bias[:, 3 * int(sensor) : 3 * int(sensor) + 3] += history
        if place >= 0:
            parameters[:, int(place) : int(place) + 3] += history
    if drawn.ranges is not None:
        parameters[:, clock_places(layout)] = drawn.ranges.clock_states(layout, ideal.t[1:])
    M_g, M_a, G_g = drawn.constants[6:].reshape(3, 3, 3)
    root = np.sqrt(h) * errors.white
    dtheta = ideal.gyro + ideal.gyro @ M_g.T + ideal.accel @ G_g.T + h * bias[:, :3] + root[:3] * z[:, :3]
    dv = ideal.accel + ideal.accel @ M_a.T + h * bias[:, 3:] + root[3:] * z[:, 3:]
    aiding = scenario.aiding
    s = aiding.schedule
    values = s.z.copy()
    noisy = aiding.sigma.any(axis=1) & (s.t >= ideal.t[0] - 1e-9) & (s.t <= ideal.t[-1] + 1e-9)
    noise = aiding.sigma[noisy] * normals_of(fixes, 4 * int(noisy.sum())).reshape(-1, 4)[:, :3]
    values[noisy, :3] += np.einsum("nij,nj->ni", aiding.axes()[noisy], noise)
    schedule = MeasurementSchedule(s.t, s.kind, values, s.R, s.lever, s.gate)
    if drawn.ranges is not None:
        schedule = with_errors(schedule, drawn.ranges.error)
    return Replay(Increments(ideal.t[1:], np.diff(ideal.t), dtheta, dv), schedule, drawn.initial, parameters)


def through_engine(
    scenario: LaneScenario,
    number: int,
    seed: int,
    error: FloatArray,
    sigma: FloatArray,
    nees: FloatArray,
    counts: FloatArray,
    lane: int,
) -> None:
    """Put what the engine makes of a run in place of what its lane made.

    Parameters
    ----------
    scenario : LaneScenario
    number, seed : int
        Of the run.
    error, sigma : ndarray, shape (r, n, lanes)
    nees : ndarray, shape (r, names, lanes)
        Not yet per degree of freedom.
    counts : ndarray, shape (N_COUNTS, lanes)
        See ``_kernels.run_lanes``.
    lane : int
    """
    data, layout = replay(scenario, number, seed=seed), scenario.layout
    forward = run(*data[:3], layout, scenario.gyro_psd, scenario.accel_psd, scenario.options)
    result = NavigationResult.from_run(forward, data.schedule.t, data.schedule.kind, layout)
    at = np.searchsorted(data.increments.t, result.t - 1e-6)
    truth = scenario.ideal.truth
    _, dx, P = state_errors(result, truth, data.parameters[at])
    T = ecef_from_ned_states(frames.llh_from_ecef(truth.r_eb_e[at + 1]), dx.shape[1])
    error[:, :, lane] = np.einsum("kji,kj->ki", T, dx)
    sigma[:, :, lane] = np.sqrt(np.einsum("kji,kjl,kli->ki", T, P, T))
    for i, name in enumerate(scenario.nees):
        block = slice(*scenario.states(name))
        nees[:, i, lane] = np.einsum(
            "ki,ki->k", dx[:, block], np.linalg.solve(P[:, block, block], dx[:, block, None])[..., 0]
        )
    for o, kinds in (
        (0, (POSITION,)), (3, (VELOCITY, ZERO_VELOCITY)), (10, (PSEUDORANGE,)), (13, (RANGE_RATE,)),
        (16, (CARRIER_PHASE,)),
    ):  # fmt: skip
        mine = np.isin(data.schedule.kind, kinds)
        used = np.isin(forward.status[mine], (ACCEPTED, FORCED))
        rejected = forward.status[mine] == REJECTED
        nis = forward.nis[mine]
        counts[o : o + 3, lane] = nis[np.isfinite(nis)].sum(), used.sum(), rejected.sum()
    counts[6, lane] = 0.0  # the lane's own turns say nothing of the engine's


def normals_of(stream: npt.NDArray[np.uint64], count: int) -> FloatArray:
    """The first standard normals of a random stream (four 64-bit words), as the kernel draws them. Shape (count,)."""
    from schuler.filtering.kernels.vector import LANES
    from schuler.montecarlo.lanes._random_kernels import draw

    state = np.ones((4, LANES), dtype=np.uint64)
    state[:, 0] = stream
    block = aligned(8192, LANES)
    out = np.empty(count)
    for first in range(0, count, len(block)):
        draw(state, block)
        part = out[first : first + len(block)]
        part[:] = block[: len(part), 0]
    return out


def _recursion(e: float, steps: FloatArray) -> FloatArray:
    """``x[k] = e x[k - 1] + steps[k]`` along the first axis."""
    from scipy.signal import lfilter

    return np.asarray(lfilter([1.0], [1.0, -e], steps, axis=0))
