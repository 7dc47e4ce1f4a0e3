"""One run of a field-calibration campaign: an IMU is drawn, turned by the routine, calibrated, compared with truth."""

from __future__ import annotations

import os
from collections.abc import Callable, Generator, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import lru_cache
from time import process_time
from typing import Literal, TypeAlias, TypeVar

import numpy as np

from schuler.arrays import FloatArray
from schuler.calibration.field.calibration import FieldCalibration, calibrate_field
from schuler.calibration.field.options import FieldOptions
from schuler.calibration.result.parameters import vector
from schuler.exceptions import InputError
from schuler.recording.series import ImuSeries
from schuler.sensors.errors import ImuErrors
from schuler.sensors.spec import ImuSpec
from schuler.simulation.imu import IdealImu, SimulatedImu, ideal_imu, simulate_imu
from schuler.simulation.routine import RoutineMotion, thesis_routine
from schuler.simulation.steps import Routine
from schuler.standstill.rests import given_rests
from schuler.units import DEG

T = TypeVar("T")
RestSource: TypeAlias = Literal["found", "given"]

#: Near Ankara, where the source worked: latitude, longitude [rad], height [m].
PLACE = (39.92 * DEG, 33.2 * DEG, 1000.0)
#: Runs that are worth one more process: it takes some two seconds to start, a run less than half a second.
WORTH = 25
# what linear algebra reads its number of threads from when it is loaded
_THREADS = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS")
# of given rests: what is cut off at both ends, so that no sample of a turn is in [s]
_EDGE_S = 0.1


@dataclass(frozen=True)
class FieldJob:
    """Settings that all runs of a campaign share.

    Attributes
    ----------
    spec : ImuSpec
        Errors are drawn from it, and the calibration is told it.
    routine : Routine
    options : FieldOptions
    rate_hz : float
    place : (float, float, float)
        Latitude, longitude [rad], height [m].
    heading_sigma : float
        1-sigma of the heading that the calibration is told; drawn. [rad]
    rests : {"found", "given"}
        Whether the calibration finds the rests in the log, as it would in the field, or is told them.
    """

    spec: ImuSpec
    routine: Routine = field(default_factory=thesis_routine)
    options: FieldOptions = field(default_factory=FieldOptions)
    rate_hz: float = 100.0
    place: tuple[float, float, float] = PLACE
    heading_sigma: float = 1.0 * DEG
    rests: RestSource = "found"

    def __post_init__(self) -> None:
        if self.rests not in ("found", "given"):
            raise InputError(f"rests: expected 'found' or 'given', got {self.rests!r}")
        if not self.heading_sigma > 0.0:
            raise InputError(f"heading_sigma: expected a positive 1-sigma [rad], got {self.heading_sigma!r}")

    @property
    def ideal(self) -> IdealImu:
        """Readings of a perfect IMU; computed once."""
        return _ideal(self.routine, self.rate_hz, self.place)


@dataclass(frozen=True)
class FieldRun:
    """One run.

    Attributes
    ----------
    names : tuple of str
    modelled, estimate : ndarray, shape (p,)
        Errors put in, and found. SI.
    covariance : ndarray, shape (p, p)
        Claimed by the calibration.
    prior_sigma : ndarray, shape (p,)
    passes : int
    status : str
        Status of the calibration.
    nis : dict of str to float
        Mean normalised innovation squared by kind of measurement.
    cpu_s : float
        Processor time it took, all threads. [s]
    """

    names: tuple[str, ...]
    modelled: FloatArray
    estimate: FloatArray
    covariance: FloatArray
    prior_sigma: FloatArray
    passes: int
    status: str
    nis: dict[str, float]
    cpu_s: float


@lru_cache(maxsize=2)
def _ideal(routine: Routine, rate_hz: float, place: tuple[float, float, float]) -> IdealImu:
    return ideal_imu(RoutineMotion(routine, np.array(place)), rate_hz)


def simulated_unit(job: FieldJob, child: np.random.SeedSequence) -> tuple[SimulatedImu, ImuErrors, float]:
    """Log of one unit, its errors, and the heading somebody told [rad]. The same luck for every grade and option."""
    rng = np.random.default_rng(child)
    errors = ImuErrors.draw(job.spec, rng, gauge="upper")
    simulated = simulate_imu(job.ideal, errors, rng)
    yaw = float(job.routine.rpy_nb[2])
    return simulated, errors, yaw + job.heading_sigma * float(rng.standard_normal())


def calibrated(job: FieldJob, imu: ImuSeries, heading: float) -> FieldCalibration:
    """Field calibration of one log as the job says."""
    rests = None
    if job.rests == "given":
        rests = given_rests(imu, job.routine.rests + np.array([_EDGE_S, -_EDGE_S]))
    return calibrate_field(
        imu, job.spec, latitude=job.place[0], height=job.place[2], heading=(heading, job.heading_sigma),
        options=job.options, rests=rests, halves=False,
    )  # fmt: skip


def field_run(job: FieldJob, child: np.random.SeedSequence) -> FieldRun | str:
    """One run of a campaign; the reason where the calibration could not be done.

    Notes
    -----
    Where biases wander in the run, those of the last second are the truth: the calibration is valid at its end.
    """
    begin = process_time()
    (imu, report), errors, heading = simulated_unit(job, child)
    try:
        fit = calibrated(job, imu, heading)
    except (InputError, np.linalg.LinAlgError) as error:
        return f"{type(error).__name__}: {error}"
    c = fit.calibration
    modelled = vector(errors, c.names)
    last = max(1, round(job.rate_hz))
    for family, history in (("b_g", report.b_g), ("b_a", report.b_a)):
        b = history[-last:].mean(axis=0)
        for k, axis in enumerate("xyz"):
            if f"{family}_{axis}" in c.names:
                modelled[c.names.index(f"{family}_{axis}")] = b[k]
    prior = np.array([c.prior_sigma[name] for name in c.names])
    nis = {kind: mean for kind, (mean, _) in fit.nis.items()}
    cpu_s = process_time() - begin
    return FieldRun(c.names, modelled, c.values, c.covariance, prior, len(fit.passes), c.status, nis, cpu_s)


def in_parallel(
    work: Callable[[np.random.SeedSequence], T], seed: int, runs: int, workers: int
) -> Generator[tuple[int, T], None, None]:
    """Runs as they finish, each with its number, in this process or in ``workers`` processes that start afresh.

    Run k is given child k of the seed. Whoever stops listening (Ctrl-C) ends the rest: runs under way are waited for,
    half a second, the others dropped.
    """
    children = np.random.SeedSequence(seed).spawn(runs)
    if workers == 1:
        for k, child in enumerate(children):
            yield k, work(child)
        return
    from concurrent.futures import ProcessPoolExecutor, as_completed
    from multiprocessing import get_context

    pool = ProcessPoolExecutor(workers, get_context("spawn"), initializer=_deaf_to_interrupts)
    try:
        with _one_thread_each():
            numbers = {pool.submit(work, child): k for k, child in enumerate(children)}
        for future in as_completed(numbers):
            yield numbers[future], future.result()
    finally:
        pool.shutdown(wait=True, cancel_futures=True)


def run_all(
    work: Callable[[np.random.SeedSequence], T | str],
    seed: int,
    runs: int,
    workers: int,
    least: int,
    progress: Callable[[float], None] | None = None,
) -> tuple[dict[int, T], list[tuple[int, str]], bool]:
    """Runs of :func:`in_parallel` that came to something by their numbers, those that failed with why, and if all ran.

    Ctrl-C ends the rest if the ``least`` number is done, else it is raised.
    """
    done: dict[int, T] = {}
    failed: list[tuple[int, str]] = []
    complete = True
    results = in_parallel(work, seed, runs, workers)
    try:
        for k, result in results:
            if isinstance(result, str):
                failed.append((k, result))
            else:
                done[k] = result
            if progress is not None:
                progress((len(done) + len(failed)) / runs)
    except KeyboardInterrupt:
        complete = False
        if len(done) < least:
            raise
    finally:
        results.close()
    return done, failed, complete


def processes(workers: int | None, runs: int) -> int:
    """Number of processes: as given, else one a processor, fewer for few runs.

    Raises
    ------
    InputError
        If there is nothing to do or nobody to do it.
    """
    if workers is not None and workers < 1:
        raise InputError(f"workers: expected one or more, got {workers}")
    return min(workers or os.cpu_count() or 1, runs if workers else 1 + runs // WORTH)


@contextmanager
def _one_thread_each() -> Iterator[None]:
    """Processes started meanwhile multiply matrices in one thread: they share the processors as it is.

    Two processes with two threads each took twice the time on two processors.
    """
    before = {name: os.environ.get(name) for name in _THREADS}
    os.environ.update(dict.fromkeys(_THREADS, "1"))
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                del os.environ[name]
            else:
                os.environ[name] = value


def _deaf_to_interrupts() -> None:
    """Ctrl-C goes to every process of a terminal; only the one that collects may act on it."""
    import signal

    signal.signal(signal.SIGINT, signal.SIG_IGN)
