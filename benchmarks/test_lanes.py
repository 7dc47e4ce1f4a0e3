"""Monte Carlo: runs in lanes beside the engine on one run, epochs a second and core; whole campaigns, runs a second.

    pytest benchmarks/test_lanes.py -s

The campaigns are the target of issue 7: 1 h at 100 Hz with 1 Hz position and velocity, noise synthesis included, all
cores: at least 30 runs a second with 15 states and 20 with 33 on two cores. Epochs of lanes count those of all runs.
"""

from __future__ import annotations

import os
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from schuler.filtering.engine import FilterOptions, run
from schuler.filtering.initial_state import InitialState
from schuler.filtering.states import StateLayout, StateModel
from schuler.mechanization.strapdown import NavState
from schuler.montecarlo.lanes.aiding import true_gnss
from schuler.montecarlo.lanes.errors import LaneErrors
from schuler.montecarlo.lanes.run import LaneScenario, lane_statistics, replay
from schuler.simulation.gnss import GnssModel
from schuler.simulation.imu import IdealImu, ideal_imu
from schuler.simulation.motion import Motion, MotionState
from schuler.simulation.profiles import Manoeuvre, ManoeuvreMotion

GYRO_N, ACCEL_N, LAP_S = 1e-4, 2e-3, 400.0
GNSS = GnssModel(first_s=1.0, lever_arm_b=np.array([1.0, 0.3, -0.8]))


class Repeated:
    """The first ``LAP_S`` seconds of a drive as a motion of its own."""

    duration = LAP_S

    def __init__(self, motion: Motion) -> None:
        self.motion = motion

    def state(self, t: np.ndarray) -> MotionState:
        return self.motion.state(t)


@pytest.fixture(scope="module")
def lap() -> tuple[Motion, IdealImu]:
    manoeuvres = [
        Manoeuvre(duration=8.0, speed=12.0),
        Manoeuvre(duration=7.0, turn=1.5),
        Manoeuvre(duration=6.0, speed=16.0),
        Manoeuvre(duration=9.0, turn=-2.0),
        Manoeuvre(duration=10.0, turn=2.5, speed=8.0),
    ]
    origin = np.array([0.82, 0.14, 450.0])
    motion = Repeated(ManoeuvreMotion.of([Manoeuvre(duration=5.0), *manoeuvres * 11], origin, bank=0.2))
    return motion, ideal_imu(motion, 100.0)


def layout(states: int) -> StateLayout:
    models = {
        "b_a": StateModel.gauss_markov(0.02, 3600.0),
        "b_g": StateModel.gauss_markov(1e-4, 3600.0),
        "S_a": StateModel.constant(1e-3),
        "S_g": StateModel.constant(1e-3),
        "M_a6": StateModel.constant(1e-3),
        "M_g": StateModel.constant(1e-3),
    }
    return StateLayout(dict(list(models.items())[: {15: 2, 21: 4, 33: 6}[states]]))


@pytest.fixture(scope="module")
def scene(lap):
    def of(states: int) -> LaneScenario:
        motion, ideal = lap
        lay, T = layout(states), ideal.truth
        start = InitialState.from_sigmas(
            NavState(0.0, T.r_eb_e[0], T.v_eb_e[0], T.q_eb[0]),
            lay, attitude=[0.002, 0.002, 0.01], velocity=[0.1] * 3, position=[1.0] * 3,
        )  # fmt: skip
        noise = np.full(3, GYRO_N), np.full(3, ACCEL_N)
        errors = LaneErrors.of_layout(lay, *noise, 100.0)
        psd = noise[0] ** 2, noise[1] ** 2
        return LaneScenario(ideal, errors, true_gnss(motion, GNSS), lay, start, *psd, nees=())

    return of


@pytest.mark.parametrize("states", [15, 21, 33])
@pytest.mark.parametrize("what", ["lanes, noise included", "engine, noise given"])
def test_one_core(benchmark, scene, states, what):
    benchmark.group = f"Monte Carlo on one core, {states} states"
    scenario = scene(states)
    if what == "lanes, noise included":
        benchmark.extra_info["epochs"] = 16 * len(scenario.ideal.gyro)
        benchmark.pedantic(lane_statistics, args=(scenario, 16), kwargs={"threads": 1}, rounds=5, warmup_rounds=1)
        return
    data = replay(scenario, 0)
    args = (*data[:3], scenario.layout, scenario.gyro_psd, scenario.accel_psd, FilterOptions(record_s=10.0))
    benchmark.extra_info["epochs"] = len(scenario.ideal.gyro)
    benchmark.pedantic(run, args=args, rounds=5, warmup_rounds=1)


@pytest.mark.parametrize("carrier", ["off", "time-differenced"])
@pytest.mark.parametrize("what", ["lanes, noise included", "engine, noise given"])
def test_single_satellites_on_one_core(benchmark, carrier, what):
    """The drive of examples/montecarlo_tight.toml, 206 s; 18 states, with carriers 34."""
    from schuler.montecarlo import read_job

    benchmark.group = f"Monte Carlo with single satellites on one core, carriers {carrier}"
    job, _ = read_job(Path(__file__).parents[1] / "examples" / "montecarlo_tight.toml")
    tight = job.navigation.gnss.tight.model_copy(update={"carrier": carrier})
    config = job.navigation.model_copy(update={"gnss": job.navigation.gnss.model_copy(update={"tight": tight})})
    scenario = replace(job, navigation=config).lanes
    assert isinstance(scenario, LaneScenario)
    if what == "lanes, noise included":
        benchmark.extra_info["epochs"] = 16 * len(scenario.ideal.gyro)
        benchmark.pedantic(lane_statistics, args=(scenario, 16), kwargs={"threads": 1}, rounds=5, warmup_rounds=1)
        return
    data = replay(scenario, 0)
    args = (*data[:3], scenario.layout, scenario.gyro_psd, scenario.accel_psd, FilterOptions(record_s=10.0))
    benchmark.extra_info["epochs"] = len(scenario.ideal.gyro)
    benchmark.pedantic(run, args=args, rounds=5, warmup_rounds=1)


@pytest.mark.parametrize("states", [15, 33])
@pytest.mark.parametrize("threads", [1, 2])
def test_campaign(benchmark, scene, states, threads):
    """Nine of these laps make an hour; the rate printed is that of hours."""
    benchmark.group = f"Monte Carlo campaign, {states} states"
    scenario = scene(states)
    runs = 144
    benchmark.extra_info["epochs"] = runs * len(scenario.ideal.gyro)
    best, spent = np.inf, np.inf
    lane_statistics(scenario, 8)

    def campaign() -> None:
        nonlocal best, spent
        wall, cpu = time.perf_counter(), time.process_time()
        lane_statistics(scenario, runs, threads=threads)
        best, spent = min(best, time.perf_counter() - wall), min(spent, time.process_time() - cpu)

    benchmark.pedantic(campaign, rounds=4)
    hours = runs * LAP_S / 3600.0
    print(
        f"\n{states} states, {threads} thread(s): {hours / best:.1f} runs of 1 h per second, "
        f"{hours / spent:.1f} per second of processor time; load {os.getloadavg()[0]:.1f}"
    )


def test_normals(benchmark):
    """Epochs are single normals."""
    from schuler.filtering.filter_arrays import aligned
    from schuler.montecarlo.lanes._random_kernels import draw

    benchmark.group = "normal random numbers"
    state = np.ascontiguousarray(np.random.default_rng(0).integers(1, 2**63, (4, 8), dtype=np.uint64))
    out = aligned(1200, 8)
    draw(state, out)
    benchmark.extra_info["epochs"] = out.size
    benchmark.pedantic(draw, args=(state, out), rounds=200)


def test_normals_of_numpy(benchmark):
    benchmark.group = "normal random numbers"
    rng, out = np.random.Generator(np.random.SFC64(0)), np.empty(9600)
    benchmark.extra_info["epochs"] = out.size
    benchmark.pedantic(rng.standard_normal, kwargs={"out": out}, rounds=200)
