"""Campaigns: runs a second on one worker and on two, of an hour at 100 Hz with 1 Hz GNSS, noise synthesis included.

The example ``examples/montecarlo_hour.toml``; in lanes with threads, and one run at a time with processes. Workers are
started before the clock: what counts for a long campaign is how fast it goes once it runs.
"""

from __future__ import annotations

from pathlib import Path

import pytest

from schuler.montecarlo import run_seed
from schuler.montecarlo.job import read_job
from schuler.montecarlo.navigation import lane_runs, navigation_run
from schuler.montecarlo.store import Span
from schuler.montecarlo.workers import Batches, in_threads

HOUR = Path(__file__).resolve().parents[1] / "examples" / "montecarlo_hour.toml"
EPOCHS = 360_000  # of one run


@pytest.fixture(scope="module")
def hour():
    job, _ = read_job(HOUR)
    lane_runs(job, [run_seed(0, k) for k in range(8)])
    return job


def campaign_of(function, job, workers, runs, batch):
    done = sum(span.runs for span, _ in in_threads((function, job, 0), Batches([Span(0, runs - 1)], workers, batch)))
    assert done == runs


@pytest.mark.benchmark(group="Monte Carlo in lanes: 128 runs of an hour, 15 states")
@pytest.mark.parametrize("workers", [1, 2])
def test_lanes(benchmark, hour, workers):
    benchmark.extra_info["epochs"] = 128 * EPOCHS
    benchmark.pedantic(campaign_of, args=(lane_runs, hour, workers, 128, 16), rounds=3)


@pytest.mark.benchmark(group="Monte Carlo through the whole chain: 8 runs of an hour, 15 states, threads")
@pytest.mark.parametrize("workers", [1, 2])
def test_whole_chain_in_threads(benchmark, hour, workers):
    benchmark.extra_info["epochs"] = 8 * EPOCHS
    benchmark.pedantic(campaign_of, args=(navigation_run, hour, workers, 8, 1), rounds=2)


@pytest.mark.benchmark(group="Monte Carlo on Dask workers of this machine: 256 runs of an hour in lanes, 15 states")
@pytest.mark.parametrize("workers", [1, 2])
def test_dask_workers(benchmark, hour, workers):
    """Whole batches of lanes; ``python -m benchmarks.cluster`` has processor times, single runs and fleets too."""
    pytest.importorskip("distributed")
    from schuler.montecarlo.cluster import LOCAL, connected, on_cluster

    benchmark.extra_info["epochs"] = 256 * EPOCHS
    with connected(LOCAL, workers) as client:

        def run(first, count, size):
            spans = Batches([Span(first, first + count - 1)], workers, size)
            assert sum(s.runs for s, _ in on_cluster((lane_runs, hour, 0), spans, client)) == count

        run(1000, 32 * workers, 8)  # every worker prepares the mission once
        benchmark.pedantic(run, args=(0, 256, 64), rounds=3)
