"""Tight coupling in campaigns: lanes and the whole chain say the same, a start is drawn, what is refused."""

from dataclasses import replace

import numpy as np
import pytest
from places import ROOT

from schuler.exceptions import InputError
from schuler.filtering.initial_state import InitialState, with_states
from schuler.filtering.states import StateLayout, StateModel
from schuler.montecarlo import run_seed
from schuler.montecarlo.engine import campaign
from schuler.montecarlo.error_scatter import scatter
from schuler.montecarlo.job import NavigationJob, read_job
from schuler.montecarlo.navigation import lane_runs, navigation_run, runner
from schuler.navigation.config import NavigationConfig
from schuler.navigation.run import prepared_run
from schuler.navigation.states import state_layout
from schuler.simulation.scenario import Scenario, simulate_mission

FILE = ROOT / "examples" / "montecarlo_tight.toml"


@pytest.fixture(scope="module")
def job():
    return read_job(FILE)[0]


def changed(job, simulation=None, navigation=None):
    """A job with other entries, sections of sections as dictionaries."""

    def merged(old, new):
        return old | {k: merged(old.get(k, {}), v) if isinstance(v, dict) else v for k, v in (new or {}).items()}

    scenario = Scenario.parse(merged(job.simulation.model_dump(exclude_defaults=True), simulation))
    config = NavigationConfig.parse(merged(job.navigation.model_dump(exclude_defaults=True), navigation))
    return NavigationJob(scenario, config, job.start, job.evaluation)


def test_the_example_goes_in_lanes_and_is_honest(job):
    assert runner(job)[0] is lane_runs
    result = scatter(campaign(lane_runs, job, 120, seed=2, workers=1), job)
    assert 0.9 < result.nees.mean.mean() < 1.1  # statistical: 120 runs of 206 looks that hang together
    assert abs(result.nis - 1.0) < 0.01
    # three satellites, and none, show
    assert result.claimed[result.at(114.0), 6] > 3.0 * result.claimed[result.at(98.0), 6]


@pytest.mark.parametrize("carrier", ["off", "time-differenced"])
def test_a_run_of_the_whole_chain_claims_what_lanes_claim(job, carrier):
    """Also with an outage of the configuration; 4 %: linearisation at other estimates, one run each."""
    tight = {"gnss": {"tight": {"carrier": carrier, "integrity": False}}, "outages": {"windows_s": [[150.0, 158.0]]}}
    job = changed(job, navigation=tight)
    whole = navigation_run(job, run_seed(1, 0))
    lanes = lane_runs(job, [run_seed(1, 0)])
    for name in ("sigma_position", "sigma_velocity", "sigma_attitude"):
        np.testing.assert_allclose(whole[name][5:], lanes[name][0, 5:], rtol=0.04)
    assert set(whole) == set(lanes)


@pytest.mark.campaign
@pytest.mark.parametrize("carrier", ["off", "time-differenced"])
def test_the_whole_chain_says_the_same_as_lanes(job, carrier):
    """Other random numbers: sigmas agree within the spread of two estimates, 5 standard errors each of 1854."""
    job = changed(job, navigation={"gnss": {"tight": {"carrier": carrier, "carrier_walk_m": 0.001}}})
    n, m = 48, 320
    runs = [campaign(f, job, k, seed=8, workers=1) for f, k in ((navigation_run, n), (lane_runs, m))]
    whole, lanes = (scatter(done, job) for done in runs)
    assert np.all(np.abs(np.log(whole.rms / lanes.rms)) < 5.0 * np.sqrt(0.5 / n + 0.5 / m))
    for name in ("sigma_attitude", "sigma_velocity", "sigma_position"):
        # not their means: where the clock moves by four sigma all phases of an epoch are rejected, in one run of a
        # hundred; 2 %: linearisation, and quantiles of counts in buckets
        claimed = [np.asarray(done[name].quantile(0.5)) for done in runs]
        np.testing.assert_allclose(claimed[0], claimed[1], rtol=0.02)
    nees = whole.nees.mean.mean(), lanes.nees.mean.mean()
    assert abs(nees[0] - nees[1]) < 0.1  # 4.5 standard errors of a mean over 48 runs of some five looks' worth
    assert abs(whole.nis - lanes.nis) < 0.01


@pytest.mark.parametrize(
    ("simulation", "navigation", "words"),
    [
        ({"satellites": {"slips_per_hour": 5.0}}, {}, "has slips_per_hour"),
        ({"satellites": {"clock_jumps_s": [[50.0, 1e-3]]}}, {}, "has clock_jumps"),
        ({"satellites": {"faults": [{"satellite": "highest", "start_s": 20.0, "stop_s": 30.0}]}}, {}, "has faults"),
        ({"satellites": {"give": "observations"}}, {}, "take prepared ranges"),
        ({"satellites": {"lever_arm_m": [0.0, 0.0, 0.0]}}, {}, "need the true lever arm"),
        ({}, {"gnss": {"correlated": {"position_sigma_m": 1.0}}}, "take GNSS as it comes"),
        ({}, {"gnss": {"lever_sigma_m": 0.1}}, "take GNSS as it comes"),
        ({}, {"gnss": {"tight": {"max_satellites": 5}}}, "take all ranges as they are"),
        ({}, {"gnss": {"tight": {"carrier": "time-differenced", "clock_noise_m": "log"}}}, "left to the log"),
    ],
)
def test_what_lanes_do_not_have_goes_through_the_whole_chain(job, simulation, navigation, words):
    other = changed(job, simulation, navigation)
    function, why = runner(other)
    assert function is navigation_run
    assert words in why
    with pytest.raises(InputError, match=words):
        runner(other, "lanes")


def test_without_a_start_every_run_aligns_itself(job):
    assert "do not align themselves" in runner(replace(job, start=None))[1]


def test_a_drawn_start_gets_the_clocks_of_the_first_epoch(job):
    """Receiver clock 30 km off, Galileo's 12 m from that; what is claimed of them is what the configuration says."""
    recording = simulate_mission(job.plan.mission, np.random.default_rng(1)).recording
    start = job.plan.initial
    prepared = prepared_run(recording, job.plan.config, initial=start)
    layout = prepared.layout
    assert len(start.P) == state_layout(job.plan.config, job.plan.spec).size == layout.size - 3
    names = ("clock", "clock_drift", "clock_2")
    values = [float(prepared.initial.parameters[layout[name].start - 9]) for name in names]
    np.testing.assert_allclose(values, [3e4, 30.0, 12.0], atol=8.0)  # statistical: a point of ten satellites and more
    P = prepared.initial.P
    assert P[layout["clock"], layout["clock"]] == pytest.approx(100.0**2)
    np.testing.assert_array_equal(P[:9, :9], start.P[:9, :9])


def test_states_are_added_to_a_start_where_the_layout_has_them():
    small = StateLayout({"b_a": StateModel.constant(0.1), "lever": StateModel.constant(0.2)})
    large = StateLayout({**small.models, "clock": StateModel.constant(3.0), "clock_drift": StateModel.constant(2.0)})
    large = StateLayout({"clock": large.models["clock"], "clock_drift": large.models["clock_drift"], **small.models})
    rng = np.random.default_rng(0)
    A = rng.standard_normal((15, 15))
    from schuler.mechanization.strapdown import NavState

    nav = NavState(0.0, np.array([6.4e6, 0.0, 0.0]), np.zeros(3), np.array([1.0, 0.0, 0.0, 0.0]))
    start = InitialState(nav, A @ A.T, rng.standard_normal(6))
    wide = with_states(start, small, large)
    at = np.r_[0:12, large["lever"]]
    np.testing.assert_array_equal(wide.P[np.ix_(at, at)], start.P)
    np.testing.assert_array_equal(wide.parameters[at[9:] - 9], start.parameters)
    assert wide.P[large["clock"], large["clock"]] == 9.0
    assert not wide.P[large["clock"], :9].any()
