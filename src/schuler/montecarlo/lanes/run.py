"""Monte Carlo runs in lock-step: many noisy runs of one true motion through the filter, in one compiled loop.

Each run has an IMU, an initial error and GNSS noise of its own, and goes through the error-state filter of
:mod:`schuler.filtering.engine`: the same mechanization, transition, process noise and updates. Eight runs share the
instructions (``_kernels``), and noise is made where it is used. A run in which the filter readmits fixes or adapts its
noise (:mod:`schuler.filtering.kernels.gate`) is done again by the engine, from the same numbers. Run k depends on the
seed and on k alone, to the last bit: not on the batch, the place in it, the thread, or the other runs.
"""

from __future__ import annotations

import os
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from typing import Any

import numpy as np

from schuler import earth, frames
from schuler.arrays import FloatArray, IntArray
from schuler.exceptions import InputError
from schuler.filtering.error_model import ecef_from_ned_states
from schuler.filtering.filter_arrays import aligned
from schuler.filtering.limits import PLACES
from schuler.montecarlo.lanes.lane_arrays import (
    LaneErrors,
    LaneFixes,
    LaneLog,
    LaneModel,
    LaneRecordArrays,
    LaneSky,
    LaneState,
    LaneTruth,
)
from schuler.montecarlo.lanes.records import LaneRecords, LaneStatistics
from schuler.montecarlo.lanes.replay import Replay, replay, through_engine
from schuler.montecarlo.lanes.scenario import LARGEST_TURN, LaneScenario, clock_places, draw_run

__all__ = ["LaneScenario", "Replay", "lane_statistics", "replay", "run_lanes"]

Progress = Callable[[float], None]


def run_lanes(
    scenario: LaneScenario,
    runs: int | Sequence[int],
    *,
    seed: int = 0,
    threads: int | None = None,
    progress: Progress | None = None,
) -> LaneRecords:
    """Run a campaign and keep the records of every run.

    Parameters
    ----------
    scenario : LaneScenario
    runs : int or sequence of int
        How many, or their numbers. Multiples of eight waste no lane.
    seed : int
        Run k draws from ``SeedSequence(seed, spawn_key=(k, ...))``.
    threads : int, optional
        Default one for each processor.
    progress : callable, optional
        Called with the fraction done.

    Returns
    -------
    LaneRecords
        In the order of ``runs``; 16 n bytes a record and run.

    Raises
    ------
    InputError
        If there is no run or a number is negative.
    """
    return LaneRecords.joined(list(_batches(scenario, runs, seed, threads, progress)))


def lane_statistics(
    scenario: LaneScenario,
    runs: int | Sequence[int],
    *,
    seed: int = 0,
    threads: int | None = None,
    progress: Progress | None = None,
) -> LaneStatistics:
    """Run a campaign and keep sums alone: memory does not grow with the runs. Parameters as for :func:`run_lanes`.

    Sums are made of eight runs at a time in their order, whatever the threads do.
    """
    total: LaneStatistics | None = None
    for records in _batches(scenario, runs, seed, threads, progress):
        part = records.statistics()
        total = part if total is None else total + part
    assert total is not None
    return total


def _batches(
    scenario: LaneScenario, runs: int | Sequence[int], seed: int, threads: int | None, progress: Progress | None
) -> Iterator[LaneRecords]:
    """Records of eight runs at a time, in order, computed ahead by a few threads."""
    from schuler.filtering.kernels.vector import LANES

    numbers = np.arange(runs) if isinstance(runs, int | np.integer) else np.asarray(runs, dtype=np.int64)
    if numbers.ndim != 1 or len(numbers) == 0 or numbers.min() < 0:
        raise InputError(f"runs: expected a positive count, or run numbers from 0, got {runs!r}")
    prepared = _Prepared(scenario)
    batches = deque(numbers[k : k + LANES] for k in range(0, len(numbers), LANES))
    count, done = len(batches), 0
    workers = threads or os.cpu_count() or 1
    waiting: deque[Future[LaneRecords]] = deque()
    pool = ThreadPoolExecutor(max_workers=workers)
    try:
        while batches or waiting:
            while batches and len(waiting) < workers + 2:
                waiting.append(pool.submit(prepared.run, batches.popleft(), seed))
            yield waiting.popleft().result()
            done += 1
            if progress is not None:
                progress(done / count)
    finally:
        pool.shutdown(cancel_futures=True)


class _Prepared:
    """Arrays that all batches of a campaign share, and the kernel, compiled."""

    def __init__(self, scenario: LaneScenario) -> None:
        from schuler.montecarlo.lanes import _kernels as k

        self.scenario = scenario
        ideal, layout, options = scenario.ideal, scenario.layout, scenario.options
        n = layout.size
        h = 1.0 / ideal.rate_hz
        t = ideal.t[1:]
        aiding = scenario.aiding
        self.used = (aiding.schedule.t >= ideal.t[0] - 1e-9) & (aiding.schedule.t <= t[-1] + 1e-9)
        aiding = aiding.where(self.used)
        s, M = aiding.schedule, len(aiding)
        rate = options.covariance_rate_hz
        every = 1 if rate is None else max(1, round(1.0 / (rate * h)))
        plan, at = _plan(scenario, every, s.t)
        self.t = t[at]
        truth = ideal.truth
        self.table = scenario.errors.table(layout)
        blocks = np.array([scenario.states(name) for name in scenario.nees], dtype=np.int64).reshape(-1, 2)
        driven = 3 * int(np.sum(self.table[:, 2] > 0.0))
        self.rows = k.work_rows(n, every, driven)
        omega = earth.WGS84.omega_ie if options.earth_rotation else 0.0
        psd = np.concatenate((np.asarray(scenario.gyro_psd), np.asarray(scenario.accel_psd)))
        whole = np.ascontiguousarray
        self.log = LaneLog(whole(ideal.gyro), whole(ideal.accel), whole(t), h, plan)
        self.fixes = LaneFixes(
            whole(s.t), whole(s.kind), whole(s.z), whole(aiding.sigma), whole(aiding.axes().reshape(M, 9)),
            whole(s.R.reshape(M, 9)), whole(s.lever), whole(s.gate),
        )  # fmt: skip
        self.white = scenario.errors.white * np.sqrt(h)
        matrix = any(name[0] in "SMG" for name in layout.models)
        self.model = LaneModel(
            layout.table(),
            layout.n_sensor,
            np.array([layout[name].start if name in layout else -1 for name in PLACES]),
            layout.dynamics(),
            psd,
            omega,
            every,
            options.lockout,
            matrix,
            "G_g" in layout,
            "M_a6" in layout and "M_g" in layout,
        )
        r = truth.r_eb_e[at + 1]
        self.truth = LaneTruth(
            np.concatenate((truth.q_eb[at + 1], truth.v_eb_e[at + 1], r), axis=1),
            np.ascontiguousarray(frames.C_en(frames.llh_from_ecef(r)).reshape(-1, 9)),
            blocks,
        )
        k.prepare_lanes()

    def run(self, numbers: IntArray, seed: int) -> LaneRecords:
        """One batch: as many runs as there are lanes, or fewer, the rest filled up with copies of the last."""
        from schuler.filtering.kernels.vector import LANES
        from schuler.montecarlo.lanes import _kernels as k

        scenario, shown = self.scenario, self.scenario.layout.visible
        n, hidden = shown.size, scenario.layout.size - shown.size
        draws = [draw_run(scenario, run, seed) for run in numbers]
        filled = draws + [draws[-1]] * (LANES - len(draws))
        T = ecef_from_ned_states(np.array([d.initial.nav.llh for d in filled]), n)
        P = T @ scenario.initial.P @ np.swapaxes(T, 1, 2)
        if hidden:
            P = np.pad(P, ((0, 0), (0, hidden), (0, hidden)))
            P[:, range(n, n + hidden), range(n, n + hidden)] = scenario.layout.initial_variances()[n - 9 :]
        nav = [np.concatenate((d.initial.nav.q_eb, d.initial.nav.v_eb_e, d.initial.nav.r_eb_e)) for d in filled]
        wander = np.concatenate(
            (_lanes([d.starts.ravel() for d in filled]), _lanes([d.slopes.ravel() for d in filled]))
        )
        constants = _lanes([d.constants for d in filled])
        streams = np.ascontiguousarray(np.stack([d.streams for d in filled], axis=1))
        errors = LaneErrors(
            constants, self.white, self.table, wander, _lanes([d.parameters for d in filled]), streams,
            bool(np.any(constants[6:])),
        )  # fmt: skip
        start = LaneState(
            _lanes(nav),
            _lanes([np.append(d.initial.parameters, np.zeros(hidden)) for d in filled]),
            _lanes(list(0.5 * (P + np.swapaxes(P, 1, 2)))),
        )
        records = len(self.t)
        places = clock_places(shown)
        sky = LaneSky(np.empty((0, LANES)), np.empty((records, 0, LANES)), places)
        if scenario.aiding.sky is not None:
            drawn = [d.ranges for d in filled if d.ranges is not None]
            clock = _lanes([d.clock_states(shown, self.t) for d in drawn])
            sky = LaneSky(_lanes([d.error[self.used] for d in drawn]), clock, places)
        error, sigma = aligned(records, n, LANES), aligned(records, n, LANES)
        nees, counts = aligned(records, len(scenario.nees), LANES), aligned(k.N_COUNTS, LANES)
        k.run_lanes(
            self.log, self.fixes, errors, sky, start, self.model, self.truth, aligned(self.rows, LANES),
            LaneRecordArrays(error, sigma, nees, counts),
        )  # fmt: skip
        kept = len(numbers)
        for lane in np.flatnonzero(counts[7, :kept] > 0.0):
            through_engine(scenario, int(numbers[lane]), seed, error, sigma, nees, counts, int(lane))
        error, sigma, nees = (np.ascontiguousarray(np.moveaxis(x, 2, 0)[:kept]) for x in (error, sigma, nees))
        # positions and velocities, or codes, range rates and phases of single satellites
        own = counts[:6] if scenario.aiding.sky is None else counts[10:19]
        freedom = 3.0 if scenario.aiding.sky is None else 1.0
        sums = own.reshape(-1, 3, LANES)[:, :, :kept]
        taken = sums[:, 1] + sums[:, 2]
        with np.errstate(invalid="ignore"):
            nis = np.where(taken > 0.0, sums[:, 0] / (freedom * np.maximum(taken, 1.0)), np.nan).T
        finite = np.isfinite(error).all(axis=(1, 2)) & np.isfinite(sigma).all(axis=(1, 2))
        degrees = {name: stop - start for name, (start, stop) in zip(scenario.nees, self.truth.blocks, strict=True)}
        return LaneRecords(
            t=self.t, runs=np.asarray(numbers, dtype=np.int64), error=error, sigma=sigma,
            nees={name: nees[:, :, i] / degrees[name] for i, name in enumerate(scenario.nees)}, nis=nis,
            accepted=np.rint(sums[:, 1]).astype(np.int64).T, rejected=np.rint(sums[:, 2]).astype(np.int64).T,
            diverged=~(finite & (counts[6, :kept] < LARGEST_TURN**2)), layout=shown,
        )  # fmt: skip


def _plan(scenario: LaneScenario, every: int, fixes: FloatArray) -> tuple[IntArray, IntArray]:
    """What happens at the end of each interval (0, 1 propagate, 2 record as well), and the intervals with a record.

    The flush angle counts the true motion, so that all runs propagate at the same times.
    """
    t, options = scenario.ideal.t[1:], scenario.options
    plan = np.zeros(len(t), dtype=np.int64)
    angle = np.linalg.norm(scenario.ideal.gyro, axis=1)
    window = np.convolve(angle, np.ones(every + 1), "valid") if len(angle) > every else angle.sum()[None]
    if window.max() > options.flush_angle:
        turned, since, j = 0.0, 0, 0
        for k in range(len(t)):
            part = 1.0  # of this interval, since the last fix in it
            while j < len(fixes) and fixes[j] <= t[k] + 1e-9:
                turned, since, part = 0.0, 0, max(0.0, (t[k] - fixes[j]) * scenario.ideal.rate_hz)
                j += 1
            if part > 1e-6:
                turned, since = turned + part * angle[k], since + 1
            if turned > options.flush_angle:
                plan[k] = 1
            if plan[k] or since >= every:
                turned, since = 0.0, 0
    due = np.arange(scenario.ideal.t[0] + options.record_s, t[-1], options.record_s)
    records = np.unique(np.append(np.searchsorted(t, due - 1e-9), len(t) - 1))
    plan[records] = 2
    return plan, records


def _lanes(rows: list[Any]) -> FloatArray:
    """One array by run as one array whose last axis are the runs."""
    stacked = np.stack([np.asarray(row, dtype=np.float64) for row in rows], axis=-1)
    out = aligned(*stacked.shape)
    out[...] = stacked
    return out
