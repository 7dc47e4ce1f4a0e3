"""Satellites that contradict a filter throughout: it finds back or says that it does not, and never runs away."""

from __future__ import annotations

from dataclasses import replace

import aided_cases as ac
import filter_cases as cases
import numpy as np
import pytest

from schuler.exceptions import DivergenceError
from schuler.filtering.engine import FilterOptions, FilterState, run
from schuler.filtering.initial_state import InitialState
from schuler.filtering.measurements import ACCEPTED, FORCED, RANGE_RATE, REJECTED
from schuler.filtering.states import StateLayout, StateModel
from schuler.mechanization.strapdown import NavState
from schuler.navigation.navigator import Navigator

CLOCK = ("clock", "clock_drift")
EVERY = FilterOptions(covariance_rate_hz=None)
STIFF = StateModel.random_walk(20.0, 1e-6)  # a frequency that is said not to move


@pytest.fixture(scope="module")
def drive():
    return ac.Drive.of(ac.town(2.0), 120.0)


def with_drift(lay: StateLayout, model: StateModel) -> StateLayout:
    return StateLayout({**lay.models, "clock_drift": model})


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_a_clock_that_is_told_to_stand_still_does_not_carry_the_filter_away(drive, seed):
    """The drift walks by metres a second: 9 m seen.

    Where only navigation and IMU errors were enlarged, and without bounds: 1e14 m and more.
    """
    truth = with_drift(ac.layout(*CLOCK, "clock_2"), StateModel.random_walk(20.0, 0.6))
    all_seen = ac.satellites(ac.sky(drive, "GE", None), gate=0.9999)
    one = ac.filtered(drive, truth, [all_seen], seed, filter_layout=with_drift(truth, STIFF))
    result = one.result
    error = result.errors(one.truth.reference)
    rates = result.innovations.of("range_rate")
    assert (rates.status == FORCED).any()
    assert error.max_horizontal < 20.0
    assert np.sqrt(np.einsum("kii->ki", result.covariance_e)[:, :3]).max() < 1.01  # [rad]
    assert result.verdict.status != "ok"


@pytest.mark.parametrize("factor", [3.0, 30.0, 400.0])
def test_what_an_enlarged_covariance_gains_is_a_covariance_within_bounds(factor):
    """The smoother takes what is added for process noise; what is not near its bound grows by the factor."""
    from schuler.filtering.kernels.gate import enlarge_within

    rng = np.random.default_rng(5)
    A = rng.standard_normal((6, 9))
    P = A @ A.T
    most = np.array([np.inf, 2.0, 1e3, 0.0, 5.0, np.inf]) * P.diagonal()
    larger = P.copy()
    enlarge_within(factor, larger, most, np.empty(6))
    np.testing.assert_array_equal(larger, larger.T)
    assert np.linalg.eigvalsh(larger - P).min() > -1e-12 * factor * P.max()
    limits = np.minimum(factor, np.array([np.inf, 2.0, 1e3, 1.0, 5.0, np.inf]))
    np.testing.assert_allclose(larger.diagonal(), limits * P.diagonal(), rtol=1e-12)
    np.testing.assert_allclose(larger[0, 5], factor * P[0, 5], rtol=1e-12)
    np.testing.assert_array_equal(larger[3], P[3])


def test_bounds_of_an_enlarged_covariance():
    """A radian, ten times what is stated of the IMU; none of what ranges tell; what is not the filter's own stays."""
    lay = ac.layout("clock", "clock_drift", "clock_2", "lever")
    most = lay.largest_variances()
    assert most[:9].tolist() == [1.0] * 3 + [np.inf] * 6
    np.testing.assert_allclose(most[lay["b_g"]], 100.0 * lay.models["b_g"].sigma ** 2)
    assert [most[lay[name]][0] for name in ("clock", "clock_drift", "clock_2", "lever")] == [np.inf] * 3 + [0.0]


def test_one_range_rate_of_an_epoch_is_taken_against_the_gate_and_the_count_ends():
    """Twenty epochs of five that contradict: from the third on one of each. After eleven that fit none is."""
    from schuler.filtering.kernels.gate import judge

    lay = ac.layout(*CLOCK)
    nav = NavState(0.0, np.array([4.2e6, 6e5, 4.7e6]), np.zeros(3), np.array([1.0, 0.0, 0.0, 0.0]))
    start = InitialState(nav, np.eye(lay.size), np.zeros(lay.size - 9))
    f = FilterState(start, lay, *ac.NOISE, EVERY, 0.01)
    f.work.H[:], f.work.y[:] = 0.0, 0.0

    def judged(t, nis):
        return judge(RANGE_RATE, t, nis, 1, 15.0, np.eye(3).ravel(), f.settings, f.arrays, f.model, f.work)

    epochs = [[judged(float(t), 100.0) for _ in range(5)] for t in range(20)]
    assert epochs[:2] == [[REJECTED] * 5] * 2
    assert epochs[2:] == [[FORCED] + [REJECTED] * 4] * 18
    assert [judged(20.0, 1.0) for _ in range(11)] == [ACCEPTED] * 11
    assert judged(21.0, 100.0) == REJECTED


def live_run(drive, spoil=None):
    """Log, measurements, start and a live run from there, with a clock that is told to stand still."""
    truth = ac.Truth(drive, ac.layout(*CLOCK), np.random.default_rng(3))
    schedule = ac.satellites(ac.sky(drive, "G", 8), gate=0.9999, spoil=spoil)(truth)
    lay = with_drift(truth.layout, STIFF)
    initial = ac.initial(truth, lay)
    return truth.log, schedule, initial, Navigator(initial, lay, *ac.NOISE, interval_s=0.01, options=EVERY)


def test_live_finds_back_as_the_batch_run(drive):
    """Lock-outs of range rates by a clock that runs away, to the last bit."""

    def away(ranges):
        return replace(ranges, range_rate=ranges.range_rate + 0.5 * np.maximum(ranges.t - 20.0, 0.0))

    log, schedule, initial, live = live_run(drive, away)
    batch = run(log, schedule, initial, live.layout, *ac.NOISE, EVERY)
    assert ((batch.status == FORCED) & (schedule.kind == RANGE_RATE)).any()
    cases.stream(live, log, schedule)
    np.testing.assert_array_equal(live.state.r_eb_e, batch.r[-1])
    np.testing.assert_array_equal(live.parameters, batch.rec_est[-1])


def test_a_live_run_that_nothing_can_have_made_ends(drive):
    log, schedule, initial, live = live_run(drive)
    fast = replace(initial, nav=replace(initial.nav, v_eb_e=np.array([2e4, 0.0, 0.0])))
    live = Navigator(fast, live.layout, *ac.NOISE, interval_s=0.01)
    with pytest.raises(DivergenceError, match=r"the filter failed at 1\.01. s: .* a speed of 2e\+04 m/s"):
        cases.stream(live, log, schedule)
