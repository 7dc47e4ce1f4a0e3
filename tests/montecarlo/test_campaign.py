"""Campaigns on this machine: the same runs however they are done, failures, and words."""

import os
import signal

import numpy as np
import pytest

from schuler.exceptions import InputError, SchulerError
from schuler.montecarlo import Statistics, run_seed
from schuler.montecarlo.engine import campaign


@pytest.fixture
def runs():
    import montecarlo_runs

    return montecarlo_runs


def same(a, b):
    assert a.done == b.done
    assert list(a.statistics) == list(b.statistics)
    for name, s in a.statistics.items():
        for part in ("mean", "m2", "m3", "m4", "low", "high"):
            np.testing.assert_array_equal(getattr(s.moments, part), getattr(b[name].moments, part))
        np.testing.assert_array_equal(s.quantile(0.95), b[name].quantile(0.95))
    np.testing.assert_array_equal(a["track"].covariance, b["track"].covariance)
    assert a.failures == b.failures


KEEP = Statistics(covariance=("track",))


def test_run_k_is_what_its_seed_says(runs):
    got = campaign(runs.values, {"mean": 5.0}, 100, seed=7, workers=1, keep=True)
    for k in (0, 1, 64, 99):
        np.testing.assert_array_equal(got.column("track")[k], runs.values({}, run_seed(7, k))["track"])
    rng = np.random.default_rng(np.random.SeedSequence(7, spawn_key=(99,)))
    assert got.column("x")[99] == 5.0 + rng.standard_normal((4, 3))[0, 0]
    assert got.column("count").dtype == np.int64
    assert got.column("hit").dtype == bool
    # the share of hits is the mean of a bool
    assert float(got["hit"].mean) == np.mean(got.column("hit"))


def test_identical_for_any_number_of_threads_processes_and_batches(runs):
    reference = campaign(runs.values, {}, 500, seed=3, workers=1, batch=500, statistics=KEEP)
    for options in ({"workers": 1, "batch": 7}, {"workers": 1}, {"workers": 2, "pool": "threads"},
                    {"workers": 4, "pool": "threads", "batch": 3}, {"workers": 2, "pool": "processes"}):  # fmt: skip
        same(campaign(runs.values, {}, 500, seed=3, statistics=KEEP, **options), reference)
    for function in (runs.threaded, runs.batched):
        same(campaign(function, {}, 500, seed=3, statistics=KEEP, workers=2, pool="threads"), reference)
    other = campaign(runs.values, {}, 500, seed=4, workers=1, statistics=KEEP)
    assert float(other["x"].mean) != float(reference["x"].mean)


@pytest.mark.slow
def test_identical_for_four_processes(runs):
    reference = campaign(runs.values, {}, 500, seed=3, workers=1, statistics=KEEP)
    same(campaign(runs.values, {}, 500, seed=3, statistics=KEEP, workers=4, batch=11), reference)


def test_the_function_says_whether_threads_do(runs):
    assert campaign(runs.threaded, {}, 20, workers=2).where == "2 threads"
    assert campaign(runs.values, {}, 20, workers=1).where == "this process"


def test_more_runs_go_on_with_the_same_ones(runs):
    few = campaign(runs.values, {}, 70, seed=1, workers=1, keep=True)
    many = campaign(runs.values, {}, 140, seed=1, workers=1, keep=True)
    np.testing.assert_array_equal(many.column("track")[:70], few.column("track"))


@pytest.mark.parametrize("name", ["fails", "batched_failing"])
def test_runs_that_cannot_be_done_are_told_and_left_out(runs, name):
    got = campaign(getattr(runs, name), {}, 70, workers=1, batch=9, keep=True)
    expected_runs = {k for k in range(70) if k % 7 == 3}
    if name == "fails":
        expected_runs |= {k for k in range(70) if k % 7 == 5}
        assert got.failures[5] == "x is not finite"
    assert set(got.failures) == expected_runs
    assert got.failures[3] == "InputError: run 3 cannot be done"
    assert got["x"].n == 70 - len(expected_runs)
    assert got.done == 70
    assert f"{len(expected_runs)} runs could not be done; run 3: InputError" in got.summary()
    assert np.isfinite(got.column("x")).all()


def test_a_defect_ends_the_campaign(runs):
    for options in ({"workers": 1}, {"workers": 2, "pool": "threads"}):
        with pytest.raises(RuntimeError, match="a defect"):
            campaign(runs.defect, {}, 60, **options)


def test_if_no_run_can_be_done_it_says_why(runs):
    with pytest.raises(InputError, match=r"none of the 4 runs could be done; run 0: InputError: no"):
        campaign(nothing, {}, 4, workers=1)


def nothing(scenario, seed):
    raise InputError("no")


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("other_shape", r"run 1[23]: x is float64 of shape \([23],\), but float64 of shape \([23],\) in other runs"),
        ("text", r"run 0: x is of type <U4; expected numbers"),
    ],
)
def test_results_that_cannot_be_kept(runs, name, message):
    with pytest.raises(InputError, match=message):
        campaign(getattr(runs, name), {}, 20, workers=1)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"runs": 0}, "runs: expected a whole number of at least 1, got 0"),
        ({"seed": -1}, "seed: expected a whole number of at least 0"),
        ({"workers": 0}, "workers: expected"),
        ({"batch": 1.5}, "batch: expected"),
        ({"pool": "greenlets"}, "pool: expected 'threads' or 'processes'"),
    ],
)
def test_arguments_out_of_range(runs, options, message):
    with pytest.raises(InputError, match=message):
        campaign(runs.values, {}, **{"runs": 5, "workers": 1, **options})


def test_a_function_that_cannot_be_sent():
    with pytest.raises(InputError, match=r"sent to another process.*workers=1"):
        campaign(lambda scenario, seed: {"x": 1.0}, {}, 5, workers=2)


def test_a_process_that_dies_is_replaced(runs, tmp_path, executions):
    path, count = executions
    scenario = {"flag": str(tmp_path / "died"), "log": str(path)}
    got = campaign(runs.dies_once, scenario, 60, workers=2, batch=4, statistics=KEEP)
    same(got, campaign(runs.values, {}, 60, workers=1, statistics=KEEP))
    assert (tmp_path / "died").exists()
    assert set(count()) == set(range(60))


@pytest.mark.campaign
def test_processes_that_die_again_and_again(runs):
    with pytest.raises(SchulerError, match=r"processes ended 3 times over the runs from (1[0-9]|20) on"):
        campaign(runs.dies_always, {}, 24, workers=2, batch=4)


@pytest.mark.thinned(2)
@pytest.mark.parametrize("pool", ["threads", "processes"])
def test_ctrl_c_keeps_what_is_done(runs, pool, tmp_path):
    def interrupt(fraction):
        if fraction > 0.3:
            os.kill(os.getpid(), signal.SIGINT)

    options = {"workers": 2, "pool": pool, "batch": 4, "store": tmp_path / "s", "statistics": KEEP}
    got = campaign(runs.counted, {"sleep": 0.01}, 100, progress=interrupt, **options)
    assert not got.complete
    assert 30 < got.done < 100
    assert got["x"].n == got.done
    assert "INTERRUPTED" in got.summary()
    assert len(got.column("x")) == got.done
    rest = campaign(runs.counted, {"sleep": 0.01}, 100, **options)
    assert rest.complete
    assert rest.executed == 100 - got.done
    same(rest, campaign(runs.values, {}, 100, workers=1, statistics=KEEP))


def test_progress_goes_from_nothing_to_all(runs):
    seen = []
    campaign(runs.values, {}, 50, workers=1, batch=10, progress=seen.append)
    assert seen == [0.0, 0.2, 0.4, 0.6, 0.8, 1.0]


def test_summary_and_dictionary(runs):
    got = campaign(runs.values, {}, 100, workers=1)
    assert "values, seed 0: 100 of 100 runs, 100 of them now" in got.summary()
    assert "arrays: track (4, 3)" in got.summary()
    data = got.to_dict()
    assert data["statistics"]["x"]["sigma"] == float(got["x"].sigma)
    assert np.shape(data["statistics"]["track"]["q95"]) == (4, 3)
    with pytest.raises(InputError, match=r"no column 'y'; the runs give x, track"):
        _ = got["y"]
    with pytest.raises(InputError, match=r"runs were not kept.*keep=True"):
        got.column("x")
