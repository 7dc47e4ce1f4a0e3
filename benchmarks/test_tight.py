"""Tightly coupled filter: IMU epochs per second with a sky of satellites, and the preparation of their ranges."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from schuler.filtering.engine import FilterOptions, run
from schuler.filtering.initial_state import InitialState
from schuler.filtering.states import StateLayout, StateModel
from schuler.gnss.constellation import nominal_orbits
from schuler.gnss.preparation import prepare_ranges
from schuler.gnss.synthetic import RangeErrors, synthetic_ranges
from schuler.navigation.aids.satellite import range_measurements
from schuler.navigation.inputs.satellite_noise import inflate_sigmas
from schuler.navigation.states import clock_models

EPOCH = 1.3e9


@pytest.fixture(scope="module")
def sky(log_1000s):
    """Ranges and range rates of GPS and Galileo at 1 Hz over 1000 s, about fourteen satellites an epoch."""
    motion, _ = log_1000s
    t = np.arange(1.0, 1000.0)
    s = motion.state(t)
    budget = RangeErrors(multipath=0.0, atmosphere=0.0, offsets=(15.0,))
    return synthetic_ranges(
        t, s.r_eb_e, s.v_eb_e, nominal_orbits("GE"), np.random.default_rng(2), budget, epoch_gps_s=EPOCH,
        elevation_mask=0.2,
    )  # fmt: skip


def job(log_1000s, start, noise, ranges):
    models = {"b_a": StateModel.random_walk(0.02, 1e-5), "b_g": StateModel.random_walk(1e-3, 1e-7)}
    models |= clock_models(
        ranges, offset_sigma=1e5, drift_sigma=100.0, offset_noise=0.2, drift_noise=0.2, between_sigma=100.0
    )  # fmt: skip
    lay = StateLayout(models)
    initial = InitialState.from_sigmas(
        start, lay, attitude=[0.005, 0.005, 0.02], velocity=[0.1] * 3, position=[1.0] * 3
    )
    schedule = range_measurements(ranges, [0.0, 0.0, 0.0], gate=None)
    gyro, accel = noise
    return log_1000s[1], schedule, initial, lay, np.full(3, gyro**2), np.full(3, accel**2)


@pytest.mark.benchmark(group="tightly coupled, 100 Hz IMU, 1 Hz ranges and rates")
@pytest.mark.parametrize("satellites", [14, 8, 5])
@pytest.mark.parametrize("smoother", [False, True], ids=["filter", "kept for the smoother"])
def test_tight(benchmark, log_1000s, start, noise, sky, satellites, smoother):
    from schuler.navigation.inputs.satellites import limited

    work = job(log_1000s, start, noise, limited(sky.ranges, 1, satellites))
    options = FilterOptions(smoother=smoother)
    forward = run(*work, options)
    error = forward.r[-1] - log_1000s[0].state(np.array([forward.t[-1]])).r_eb_e[0]
    assert np.linalg.norm(error) < 10.0  # it is a filter that works which is timed
    benchmark.extra_info["epochs"] = len(work[0])
    benchmark.extra_info["updates"] = len(work[1])
    benchmark.pedantic(run, args=(*work, options), rounds=7)


@pytest.mark.benchmark(group="ranges made ready, epochs of fourteen satellites")
@pytest.mark.parametrize("what", ["observations to ranges", "single points and fault detection"])
def test_preparation(benchmark, sky, what):
    observations = sky.observations()
    ephemerides = nominal_orbits("GE").ephemerides(EPOCH, EPOCH + 1000.0)
    benchmark.extra_info["epochs"] = len(sky.clock)
    if what == "observations to ranges":
        benchmark.pedantic(
            prepare_ranges, args=(observations, ephemerides), kwargs={"ionosphere": "none"}, rounds=5, warmup_rounds=1
        )
    else:
        ranges = replace(sky.ranges, notes=())
        benchmark.pedantic(lambda: inflate_sigmas(ranges, []), rounds=5, warmup_rounds=1)
