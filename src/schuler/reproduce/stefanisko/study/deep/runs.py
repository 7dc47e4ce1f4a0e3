"""SIMULATION ONLY: one run of the deep architecture, and one of tight coupling over conventional loops.

Deep (ultra-tight, vector) coupling closes the tracking loops through the navigation filter: the oscillators of all
channels are commanded from the corrected inertial solution, and the discriminators' outputs are innovations of the
filter's own pseudoranges and range rates. Non-coherent: correlator outputs go through discriminators, carrier phase and
data bits are not needed. The filter is the one of every other run, fed sample by sample.

References
----------
Groves (2013), section 14.1.4 and 14.3.3; Stefanisko (2015), section 3.1.4.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from schuler import frames
from schuler.arrays import BoolArray, FloatArray
from schuler.exceptions import InputError
from schuler.filtering.engine import FilterOptions, run
from schuler.filtering.measurements import (
    ACCEPTED,
    PSEUDORANGE,
    RANGE_RATE,
    STATUS,
    MeasurementSchedule,
    gate_threshold,
    merged,
)
from schuler.gnss.ranges import predicted_ranges, predicted_rates
from schuler.navigation.evaluation.consistency import attitude_difference, state_errors
from schuler.navigation.navigator import Navigator
from schuler.navigation.result import NavigationResult
from schuler.reproduce.stefanisko.study.deep import discriminators as ts
from schuler.reproduce.stefanisko.study.deep.correlator import ratio_from_dbhz
from schuler.reproduce.stefanisko.study.deep.loops import ScalarLoops, in_reach, track
from schuler.reproduce.stefanisko.study.deep.scene import DeepScene, Draw

_AFTER = 1e-6  # an update is applied so long after the data bit it closes with, in the next IMU interval [s]
_JUMP = 5.0  # sigmas by which the power of an update leaves the mean before it


@dataclass(frozen=True, kw_only=True)
class DeepOptions:
    """Options of the vector loop.

    Attributes
    ----------
    update : float
        Time over which discriminators are averaged before they go to the filter: 0.02 to 1. Averages belong to its
        middle and are used at its end: 0.2 s make NEES 7 % too large where 74 m/s^2 turn attitude errors into velocity
        errors, 0.1 s below 2 %. [s]
    window : float
        Time over which C/N0 is measured, ending with the update. [s]
    least_dbhz : float
        Channels that measure less give nothing to the filter; their oscillators go on being commanded. [dB-Hz]
    kind : {"dot", "power"}
        Code discriminator.
    gate : float, optional
        Probability with which a correct measurement passes; None for no gate.
    """

    update: float = 0.1
    window: float = 1.0
    least_dbhz: float = 12.0
    kind: ts.CodeKind = "dot"
    gate: float | None = 0.9999

    def __post_init__(self) -> None:
        if not 0.02 <= self.update <= 1.0 or not self.window >= self.update:
            raise InputError(
                f"expected an update of 0.02 to 1 s and a window not shorter, got {self.update!r} and {self.window!r} s"
            )


@dataclass(frozen=True)
class ArchitectureRun:
    """One run of one architecture on simulated signals.

    Attributes
    ----------
    architecture : str
    t : ndarray, shape (k,)
        [s]
    position_n, velocity_n : ndarray, shape (k, 3)
        Errors north, east, down. [m], [m/s]
    sigma_n : ndarray, shape (k, 3)
        Claimed 1-sigma of the position. [m]
    nees : ndarray, shape (k,)
        Normalised squared error of all states, per state.
    channel_t : ndarray, shape (j,)
        [s]
    range_error, rate_error : ndarray, shape (j, s)
        Errors of the replicas, estimate minus truth. [m], [m/s]
    on_signal : ndarray of bool, shape (j, s)
        Tracked: replicas within reach of the signal, and for a conventional channel its lock detector content too.
    accepted : float
        Part of the measurements that passed the filter's gate; NaN if there was none.
    """

    architecture: str
    t: FloatArray
    position_n: FloatArray
    velocity_n: FloatArray
    sigma_n: FloatArray
    nees: FloatArray
    channel_t: FloatArray
    range_error: FloatArray
    rate_error: FloatArray
    on_signal: BoolArray
    accepted: float

    @property
    def horizontal(self) -> FloatArray:
        """Horizontal position error. Shape (k,). [m]"""
        return np.hypot(self.position_n[:, 0], self.position_n[:, 1])

    def largest(self, start: float, stop: float) -> float:
        """Largest horizontal error in a window. [m]"""
        return float(self.horizontal[_within(self.t, start, stop)].max())

    def tracked(self, start: float, stop: float) -> float:
        """Part of the channels that tracked all through a window."""
        return float(self.on_signal[_within(self.channel_t, start, stop)].all(axis=0).mean())


def _within(t: FloatArray, start: float, stop: float) -> BoolArray:
    inside = (t >= start) & (t <= stop)
    if not inside.any():
        raise InputError(f"no epoch of this run lies within {start:g}..{stop:g} s; there are {t[0]:g}..{t[-1]:g} s")
    return np.asarray(inside)


def deep_run(
    world: Draw,
    cn0: FloatArray,
    rng: np.random.Generator,
    options: DeepOptions | None = None,
    *,
    scale: float = 1.0,
) -> ArchitectureRun:
    """The vector loop: correlators, discriminators, filter, oscillators, live with :class:`Navigator`.

    Parameters
    ----------
    world : Draw
    cn0 : ndarray, shape (bits, s)
        Ratios, see :func:`schuler.reproduce.stefanisko.study.deep.scene.signal_strength`. [Hz]
    rng : numpy.random.Generator
        Generator of the signals' noise.
    options : DeepOptions, optional
    scale : float
        Factor on the correlators' noise; 0 for exact signals, their claimed variances unchanged.

    Returns
    -------
    ArchitectureRun

    Notes
    -----
    In each data bit the oscillators run on from the range and the rate that the corrected inertial solution had at its
    beginning, with the acceleration it had just before. What they miss during the bit, by jerk, is known afterwards
    from the inertial solution, and is taken out of the discriminators' outputs: innovations refer to the inertial
    solution. They are averaged over the update and applied at its end, in whose time the error of the inertial
    solution hardly changes.
    """
    o = options or DeepOptions()
    scene, cor = world.scene, world.scene.correlator
    bit = cor.signal.bit
    per = round(o.update / bit)
    power = _Power(max(1, round(o.window / (per * bit))), per)
    filter_ = Navigator(
        world.initial, scene.layout, scene.gyro_psd, scene.accel_psd, interval_s=cor.half,
        options=FilterOptions(covariance_rate_hz=None, lockout=0),
    )  # fmt: skip
    log, pseudorange, rate = world.increments, world.pseudorange, world.range_rate
    acceleration = np.zeros(len(scene.sat))
    rows: list[tuple[float, FloatArray, FloatArray, FloatArray, float]] = []
    pieces: list[tuple[FloatArray, FloatArray]] = []
    for first in range(0, scene.bits - per + 1, per):
        a = 2 * first
        b = a + 2 * per
        solution = [_solution(filter_, scene)]
        for k in range(a, b):
            filter_.imu(float(log.t[k]), log.dtheta_ib_b[k], log.dv_ib_b[k])
            solution.append(_solution(filter_, scene))
            if k == a and first > 0:
                rows.append(_errors(filter_, world, k + 1))
        ins, ins_rate = _predicted(np.array(solution), scene, slice(a, b + 1))
        # oscillators: range, rate and acceleration at the start of each bit, carried to its middle
        change = np.diff(ins_rate, axis=0) / cor.half
        ramp = np.concatenate((acceleration[None], change[1:-1:2]))
        acceleration = change[-1]
        osc = ins[:-1:2] + cor.half * (ins_rate[:-1:2] + 0.5 * cor.half * ramp)
        osc_rate = ins_rate[:-1:2] + cor.half * ramp
        e, e_rate = osc - pseudorange[a + 1 : b : 2], osc_rate - rate[a + 1 : b : 2]
        out = ts.bit_outputs(cor, o.kind, cn0[first : first + per], e, e_rate, rng, scale=scale)
        pieces.append((e, e_rate))
        strength = ts.measured_cn0(power.mean_with(out.power.mean(axis=0)), bit)
        usable = strength > ratio_from_dbhz(o.least_dbhz)
        if not usable.any() or b == len(log):
            continue
        c = strength[usable]
        z = ins[-1] - (ins[1::2] - osc).mean(axis=0)
        z_rate = ins_rate[-1] - (ins_rate[1::2] - osc_rate).mean(axis=0)
        z, z_rate = z[usable], z_rate[usable]
        z = z - ts.code_error(cor, o.kind, out.code.mean(axis=0)[usable], c)
        z_rate = z_rate - ts.rate_error(cor, out.cross.mean(axis=0)[usable], c)
        filter_.aid(
            _measurements(
                scene, b, usable, z, z_rate, ts.range_sigma(cor, o.kind, c) / np.sqrt(per),
                ts.rate_sigma(cor, c) / np.sqrt(per), o.gate, _AFTER,
            )
        )  # fmt: skip
    e, e_rate = (np.concatenate(x) for x in zip(*pieces, strict=True))
    t, position, velocity, sigma, squared = (np.array(x) for x in zip(*rows, strict=True))
    status = [x.status == STATUS[ACCEPTED] for x in filter_.outcomes]
    return ArchitectureRun(
        "deep", t, position, velocity, sigma, squared, scene.t[1::2][: len(e)], e, e_rate, in_reach(cor, e, e_rate),
        float(np.mean(status)) if status else np.nan,
    )  # fmt: skip


def tight_run(
    world: Draw,
    cn0: FloatArray,
    rng: np.random.Generator,
    loops: ScalarLoops | None = None,
    *,
    update: float = 1.0,
    gate: float | None = 0.9999,
    scale: float = 1.0,
) -> ArchitectureRun:
    """Tight coupling: conventional loops track each satellite, the filter takes their ranges and range rates.

    Parameters
    ----------
    world, cn0, rng, scale
        As for :func:`deep_run`.
    loops : ScalarLoops, optional
    update : float
        Between two epochs of ranges; the loops' errors are correlated over ``1 / (4 B)``. [s]
    gate : float, optional
        Probability with which a correct measurement passes.
    """
    scalar = loops or ScalarLoops()
    scene, cor = world.scene, world.scene.correlator
    tracked = track(scalar, cor, world.pseudorange, world.range_rate, cn0, rng, scale=scale)
    every = max(1, round(update / cor.signal.bit))
    schedule = []
    for bit in range(every - 1, scene.bits, every):
        usable = tracked.usable[bit]
        if not usable.any():
            continue
        k = 2 * bit + 2
        z = (world.pseudorange[k] + tracked.range_error[bit])[usable]
        z_rate = (world.range_rate[k] + tracked.rate_error[bit])[usable]
        schedule.append(
            _measurements(scene, k, usable, z, z_rate, *scalar.sigmas(cor, tracked.cn0[bit][usable]), gate, 0.0)
        )
    everything = merged(*schedule)
    forward = run(
        world.increments, everything, world.initial, scene.layout, scene.gyro_psd, scene.accel_psd,
        FilterOptions(covariance_rate_hz=None, lockout=0, record_s=0.2),
    )  # fmt: skip
    result = NavigationResult.from_run(forward, everything.t, everything.kind, scene.layout)
    parameters = np.stack([np.interp(result.t, scene.t, x) for x in world.parameters.T], axis=1)
    t, dx, P = state_errors(result, scene.truth, parameters)
    C = frames.C_en(result.states.llh)
    position, velocity = (np.einsum("kji,kj->ki", C, dx[:, i : i + 3]) for i in (6, 3))
    on = tracked.locked & tracked.on_signal(cor)
    return ArchitectureRun(
        "tight", t, position, velocity, result.sigma("dr"), _normalised(dx, P), scene.t[2::2], tracked.range_error,
        tracked.rate_error, on, float(np.mean(forward.status == ACCEPTED)) if len(everything) else np.nan,
    )  # fmt: skip


class _Power:
    """Running mean of the prompt power over some updates, begun anew for channels whose power has jumped."""

    def __init__(self, updates: int, bits: int) -> None:
        self.updates, self.bits = updates, bits
        self.kept: list[FloatArray] = []

    def mean_with(self, latest: FloatArray) -> FloatArray:
        """Mean with the latest update's power. Shape (s,)."""
        if self.kept:
            mean = np.nanmean(self.kept, axis=0)
            # variance of one bit's power, which was A^2 + 2 on average: 4 A^2 + 4
            jumped = np.abs(latest - mean) > _JUMP * np.sqrt(np.maximum(4.0 * mean - 4.0, 4.0) / self.bits)
            self.kept = [np.where(jumped, np.nan, x) for x in self.kept]
        self.kept = [*self.kept, latest][-self.updates :]
        return np.asarray(np.nanmean(self.kept, axis=0))


def _solution(filter_: Navigator, scene: DeepScene) -> FloatArray:
    """Position, velocity, clock offset and drift. Shape (8,)."""
    state, c = filter_.state, scene.layout["clock"].start - 9
    return np.concatenate((state.r_eb_e, state.v_eb_e, filter_.parameters[c : c + 2]))


def _predicted(solution: FloatArray, scene: DeepScene, part: slice) -> tuple[FloatArray, FloatArray]:
    """Ranges and rates a solution expects, clock included. (k, s) [m], [m/s]"""
    r_s, v_s = scene.r_sat_e[part], scene.v_sat_e[part]
    r, v = solution[:, None, 0:3], solution[:, None, 3:6]
    ranges, _ = predicted_ranges(r_s, r)
    rates, _ = predicted_rates(r_s, v_s, r, v)
    return ranges + solution[:, 6:7], rates + solution[:, 7:8]


def _measurements(
    scene: DeepScene,
    k: int,
    usable: BoolArray,
    z: FloatArray,
    z_rate: FloatArray,
    sigma: FloatArray,
    sigma_rate: FloatArray,
    gate: float | None,
    after: float,
) -> MeasurementSchedule:
    """Pseudoranges and range rates of the satellites heard, at ``scene.t[k]``."""
    r_s, v_s = scene.r_sat_e[k][usable], scene.v_sat_e[k][usable]
    t = np.full(len(z), scene.t[k] + after)
    threshold = gate_threshold(gate, 1)
    of = MeasurementSchedule.of
    return merged(
        of(PSEUDORANGE, t, np.column_stack((r_s, z)), sigma**2, gate=threshold),
        of(RANGE_RATE, t, np.column_stack((r_s, v_s, z_rate)), sigma_rate**2, gate=threshold),
    )


def _errors(filter_: Navigator, world: Draw, k: int) -> tuple[float, FloatArray, FloatArray, FloatArray, float]:
    """Time, errors of position and velocity, claimed sigma, NEES of a live filter, right after an update."""
    truth, state = world.scene.truth, filter_.state
    C = frames.C_en(state.llh)
    attitude = attitude_difference(state.q_eb[None], truth.q_eb[k : k + 1])[0] @ C
    velocity, position = (state.v_eb_e - truth.v_eb_e[k]) @ C, (state.r_eb_e - truth.r_eb_e[k]) @ C
    dx = np.concatenate((attitude, velocity, position, filter_.parameters - world.parameters[k]))
    P = filter_.covariance
    return state.t, position, velocity, np.sqrt(np.diag(P)[6:9]), float(_normalised(dx[None], P[None])[0])


def _normalised(dx: FloatArray, P: FloatArray) -> FloatArray:
    """Normalised squared error per state. (k,)"""
    sigma = np.sqrt(np.einsum("kii->ki", P))
    u = dx / sigma
    weighed = np.linalg.solve(P / (sigma[:, :, None] * sigma[:, None, :]), u[:, :, None])[:, :, 0]
    return np.asarray(np.einsum("ki,ki->k", u, weighed) / dx.shape[1])
