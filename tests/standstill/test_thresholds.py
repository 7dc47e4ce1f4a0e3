"""Adaptive thresholds and intervals at rest."""

import numpy as np
import pytest

from schuler.exceptions import InputError
from schuler.standstill.gait import gait_threshold
from schuler.standstill.intervals import rests_from_mask, true_runs
from schuler.standstill.thresholds import elapsed_time_threshold

T = np.arange(400) / 100.0


def test_the_threshold_gait_threshold_is_a_share_of_the_mean():
    constant = np.full(400, 7.0)
    np.testing.assert_allclose(gait_threshold(T, constant, ratio=0.1, cycle_s=1.0), 0.7, rtol=1e-12)  # rounding
    # a window of one second over a ramp: its middle value
    ramp = T.copy()
    inner = gait_threshold(T, ramp, ratio=0.5, cycle_s=1.01)[60:-60]
    np.testing.assert_allclose(inner, 0.5 * T[60:-60], rtol=1e-10)
    assert gait_threshold(T, constant, ratio=0.1, floor=2.0).min() == 2.0
    assert gait_threshold(T, constant, ratio=0.9, ceiling=3.0).max() == 3.0


def test_the_threshold_gait_threshold_scales_with_the_statistic():
    """Ten times the energy, ten times the threshold: no other noise figure changes the rests."""
    statistic = np.random.default_rng(0).exponential(size=400)
    np.testing.assert_allclose(gait_threshold(T, 10.0 * statistic), 10.0 * gait_threshold(T, statistic), rtol=1e-10)


def test_elapsed_time_threshold_rises_and_falls_back():
    statistic = np.full(400, 5.0)
    threshold, rest = elapsed_time_threshold(T, statistic, growth=10.0)
    # 10 a second reach 5 after half a second, and again after another
    at = T[rest]
    np.testing.assert_allclose(at[0], 0.51, atol=0.011)  # one sample
    np.testing.assert_allclose(np.diff(at), 0.51, atol=0.011)
    assert threshold[0] == 0.0
    _, late = elapsed_time_threshold(T, statistic, growth=10.0, delay_s=1.0)
    assert T[late][0] == pytest.approx(1.51, abs=0.011)
    _, always = elapsed_time_threshold(T, statistic, growth=10.0, floor=6.0)
    assert always.all()


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"ratio": 0.0}, "ratio"),
        ({"ratio": 1.5}, "below 1"),
        ({"cycle_s": -1.0}, "cycle_s"),
        ({"floor": -1.0}, "floor"),
    ],
)
def test_impossible_settings_of_the_threshold(options, message):
    with pytest.raises(InputError, match=message):
        gait_threshold(T, np.ones(400), **options)
    with pytest.raises(InputError, match="growth"):
        elapsed_time_threshold(T, np.ones(400), growth=0.0)


def test_short_breaks_are_closed_and_short_rests_left_out():
    mask = np.zeros(400, dtype=bool)
    mask[50:100] = mask[103:150] = mask[300:302] = True
    rests = rests_from_mask(T, mask)
    assert rests.index.tolist() == [[50, 100], [103, 150], [300, 302]]
    rests = rests_from_mask(T, mask, bridge_s=0.03, min_rest_s=0.05)
    assert rests.index.tolist() == [[50, 150]]
    assert rests.start[0] == T[50]
    assert rests.stop[0] == T[149]
    assert rests.middle[0] == 99
    # a break of three samples is longer than 0.02 s
    assert len(rests_from_mask(T, mask, bridge_s=0.02)) == 3
    assert true_runs(np.ones(3, dtype=bool)).tolist() == [[0, 3]]
    assert len(rests_from_mask(T, np.zeros(400, dtype=bool))) == 0
