"""Where one machine ends: lanes in threads and on Dask workers, fleets; one worker beside two, and fifty machines.

    python -m benchmarks.cluster [--runs 512] [--rounds 3] [--batch 128] [--singles 8] [--units 1000]

Runs of an hour at 100 Hz with 1 Hz GNSS (``examples/montecarlo_hour.toml``). One and two workers take turns, so that a
load from elsewhere meets both; the best of the rounds counts. Processor time is that of the workers inside their
batches: it says what a run costs wherever it is done, on a loaded machine too, while the time on the wall needs an idle
one. The table of machines is a simulation from the sizes and times measured here.
"""

from __future__ import annotations

import argparse
import heapq
import os
import pickle
import subprocess
import sys
import tempfile
import time
import warnings
from collections import deque
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path
from typing import Any

os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np

from schuler.montecarlo import Statistics
from schuler.montecarlo.cluster import LOCAL, connected, on_cluster
from schuler.montecarlo.error_scatter import SHOWN
from schuler.montecarlo.functions import execute, traits
from schuler.montecarlo.job import read_job
from schuler.montecarlo.navigation import lane_runs, navigation_run
from schuler.montecarlo.statistics import Accumulator
from schuler.montecarlo.store import Span, identity_of, opened
from schuler.montecarlo.workers import Batches, Finished, in_threads

HOUR = Path(__file__).resolve().parents[1] / "examples" / "montecarlo_hour.toml"
EPOCHS = 360_000  # of one run
AHEAD = 3  # batches at a worker, as schuler.montecarlo.cluster hands them out
BATCH_S = 4.0  # what a batch takes, as schuler.montecarlo.workers cuts them

#: Does runs from a number on; gives the processor time of the workers. [s]
Way = Callable[[int], float]


@traits(batched=True, threads=True, preferred=8)
def timed_lanes(job: Any, seeds: Any) -> dict[str, Any]:
    """Lanes, and the processor time of the batch in a column of its own."""
    began = time.process_time()
    columns = lane_runs(job, seeds)
    return {**columns, "cpu_s": np.full(len(seeds), (time.process_time() - began) / len(seeds))}


def timed_run(job: Any, seed: Any) -> dict[str, Any]:
    """The same of a single run through the whole chain."""
    began = time.process_time()
    columns = navigation_run(job, seed)
    return {**columns, "cpu_s": time.process_time() - began}


def prepared_rows(path: str, seeds: Any) -> dict[str, Any]:
    """Rows of another batch, read from a file: what it costs to fetch rows, and not to make them."""
    with open(path, "rb") as file:
        columns: dict[str, Any] = pickle.load(file)
    return {name: x[: len(seeds)] for name, x in columns.items()}


traits(batched=True)(prepared_rows)


def drained(finished: Finished) -> float:
    """Take the rows; the processor time of all in the workers. [s]"""
    return sum(float(rows.columns["cpu_s"].sum()) for _, rows in finished)


def compared(
    cases: dict[str, dict[int, Way]], runs: int, rounds: int, epochs: int = EPOCHS
) -> dict[str, float]:  # fmt: skip
    """A line on one worker and two of every case, all taking turns; processor time of a run with one worker. [s]"""
    wall = {(title, workers): np.inf for title, ways in cases.items() for workers in ways}
    cpu = dict(wall)
    for k in range(rounds):
        for title, workers in wall:
            began = time.perf_counter()
            spent = cases[title][workers](1000 * (k + 1))
            wall[title, workers] = min(wall[title, workers], time.perf_counter() - began)
            cpu[title, workers] = min(cpu[title, workers], spent)
    for title in cases:
        (one, two), (a, b) = ([x[title, w] for w in (1, 2)] for x in (wall, cpu))
        print(
            f"{title:<28} one {runs * epochs / one / 1e6:5.1f}, two {runs * epochs / two / 1e6:5.1f} M epochs/s: ratio "
            f"{one / two:.2f}; processor {a / runs * 1e3:.1f}, {b / runs * 1e3:.1f} ms a run; "
            f"load {os.getloadavg()[0]:.1f}",
            flush=True,
        )
    return {title: cpu[title, 1] / runs for title in cases}


def collecting(job: Any, client: Any, batch: int) -> tuple[float, float, float]:
    """What a run costs the process that collects: fetched, counted in statistics, stored. Processor time. [s]"""
    rows = execute(timed_lanes, job, 0, 0, batch - 1)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "rows"
        path.write_bytes(pickle.dumps(dict(rows.columns)))
        count = max(1024 // batch, 2)
        work = (prepared_rows, str(path), 0)
        drained(on_cluster(work, Batches([Span(0, batch - 1)], 1, batch), client))
        began = time.process_time()
        drained(on_cluster(work, Batches([Span(0, count * batch - 1)], 1, batch), client))
        fetched = (time.process_time() - began) / (count * batch)
        accumulator, began = Accumulator(Statistics(quantiles=SHOWN)), time.process_time()
        for k in range(0, 4 * batch, batch):
            accumulator.add(replace(rows, runs=rows.runs + k))
        counted = (time.process_time() - began) / (4 * batch)
        with opened(Path(folder) / "store", identity_of("f", "s", 0, {}), resume=True) as store:
            store.put(Span(0, batch - 1), rows)  # loads pyarrow
            began = time.process_time()
            for k in range(batch, 5 * batch, batch):
                store.put(Span(k, k + batch - 1), replace(rows, runs=rows.runs + k))
            stored = (time.process_time() - began) / (4 * batch)
    print(
        f"a batch of {batch} runs: {len(pickle.dumps(rows)) / batch / 1e3:.1f} kB a run; collecting takes "
        f"{fetched * 1e3:.2f} ms to fetch a run, {counted * 1e3:.2f} for its statistics, {stored * 1e3:.2f} to store it"
    )
    return fetched, counted, stored


def rate(workers: int, batch_s: float, collect_s: float, prepare_s: float = 0.0, horizon_s: float = 600.0) -> float:
    """Batches a second that are collected. Every worker has three at hand and is given another when one was collected.

    Parameters
    ----------
    workers : int
    batch_s : float
        Time of a batch at a worker. [s]
    collect_s : float
        Time of the one process that collects, one batch after the other. [s]
    prepare_s : float
        Before the first batch of a worker. [s]
    horizon_s : float
        [s]
    """
    given = [deque([0.0] * (AHEAD - 1)) for _ in range(workers)]  # times at which batches that wait were given
    events = [(prepare_s + batch_s * (1.0 + w / workers), w) for w in range(workers)]  # not all in step
    heapq.heapify(events)
    free, done = 0.0, 0
    while events[0][0] < horizon_s:
        t, w = heapq.heappop(events)
        free = max(free, t) + collect_s
        done += free < horizon_s
        given[w].append(free)
        heapq.heappush(events, (max(t, given[w].popleft()) + batch_s, w))
    return done / horizon_s


def machines(run_s: float, collect_s: float, row_bytes: float, prepare_s: float, processors: int = 16) -> None:
    """Runs a second of many machines of sixteen processors, in ten minutes."""
    batch = max(min(int(BATCH_S / run_s), 256) // 8 * 8, 8)
    print(f"machines of {processors} processors, batches of {batch} runs of {run_s * 1e3:.1f} ms, "
          f"{collect_s * 1e3:.2f} ms to collect a run, {prepare_s:.1f} s to prepare:")  # fmt: skip
    for count in (1, 2, 3, 5, 10, 20, 50):
        workers = count * processors
        runs = batch * rate(workers, batch * run_s, batch * collect_s, prepare_s)
        print(f"  {count:3d}: {runs:7.0f} runs/s, workers busy {runs * run_s / workers:4.0%}, collecting "
              f"{runs * collect_s:4.0%}, {runs * row_bytes / 1e6:5.0f} MB/s")  # fmt: skip


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--runs", type=int, default=512)
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--batch", type=int, default=128)
    parser.add_argument("--singles", type=int, default=8)
    parser.add_argument("--units", type=int, default=1000)
    given = parser.parse_args()
    warnings.filterwarnings("ignore", "Port .* is already in use")  # by the other of the two clusters

    runs, batch = given.runs, given.batch
    print(f"load {os.getloadavg()[0]:.1f}", flush=True)
    job, _ = read_job(HOUR)
    began = time.process_time()
    assert not isinstance(job.lanes, str)
    prepare = time.process_time() - began
    execute(timed_lanes, job, 0, 0, 7)

    def threads(workers: int) -> Way:
        def way(first: int) -> float:
            began = time.process_time()  # of all threads
            drained(in_threads((timed_lanes, job, 0), Batches([Span(first, first + runs - 1)], workers, batch)))
            return time.process_time() - began

        return way

    with ExitStack() as stack:
        there = {workers: stack.enter_context(connected(LOCAL, workers)) for workers in (1, 2)}
        on_workers(job, there, {w: threads(w) for w in (1, 2)}, prepare, given)
    if given.units:
        rounds = str(max(given.rounds - 1, 1))
        subprocess.run(
            [sys.executable, "-m", "benchmarks.fleets", "--units", str(given.units), "--rounds", rounds], check=True
        )


def on_workers(
    job: Any, there: dict[int, Any], threads: dict[int, Way], prepare: float, given: argparse.Namespace
) -> None:
    """The part that needs a cluster of one worker and one of two."""
    runs, batch = given.runs, given.batch

    def dask(function: Any, count: int, size: int, workers: int) -> Way:
        def way(first: int) -> float:
            batches = Batches([Span(first, first + count - 1)], workers, size)
            return drained(on_cluster((function, job, 0), batches, there[workers]))

        return way

    for workers in there:  # every worker prepares the mission once, and loads the kernels
        dask(timed_lanes, 32 * workers, 8, workers)(0)
    lanes = {w: dask(timed_lanes, runs, batch, w) for w in (1, 2)}
    costs = compared({"lanes in threads": threads, "lanes on Dask workers": lanes}, runs, given.rounds)
    run_s = costs["lanes on Dask workers"]
    print(f"a run on a Dask worker costs {run_s / costs['lanes in threads']:.3f} of the processor time of local lanes")
    if given.singles:
        for workers in there:
            dask(timed_run, 2 * workers, 1, workers)(0)
        singles = {w: dask(timed_run, given.singles, 1, w) for w in (1, 2)}
        compared({"single runs on Dask workers": singles}, given.singles, max(given.rounds - 1, 1))
    collect_s = sum(collecting(job, there[1], batch))
    row_bytes = len(pickle.dumps(execute(timed_lanes, job, 0, 0, 7))) / 8
    machines(run_s, collect_s, row_bytes, prepare)


if __name__ == "__main__":
    from benchmarks import cluster  # workers find functions by their module, which is not __main__

    cluster.main()
