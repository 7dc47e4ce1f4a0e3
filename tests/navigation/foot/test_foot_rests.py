"""Rests of a foot: thresholds, hysteresis, hit rates of every detector on a walk whose rests are known."""

from __future__ import annotations

import numpy as np
import pytest
import walk_cases as wc

from schuler.exceptions import InputError
from schuler.navigation.foot.adaptive_threshold import by_motion, by_time_since_rest
from schuler.navigation.foot.config import DetectorSection
from schuler.navigation.foot.rests import find_rests, intervals, rests_of

T = np.arange(400) / 100.0


# --------------------------------------------------------------------------------------------- thresholds


def test_the_threshold_by_motion_is_a_share_of_the_mean():
    constant = np.full(400, 7.0)
    np.testing.assert_allclose(by_motion(T, constant, ratio=0.1, cycle_s=1.0), 0.7, rtol=1e-12)  # rounding
    # a window of one second over a ramp: its middle value
    ramp = T.copy()
    inner = by_motion(T, ramp, ratio=0.5, cycle_s=1.01)[60:-60]
    np.testing.assert_allclose(inner, 0.5 * T[60:-60], rtol=1e-10)
    assert by_motion(T, constant, ratio=0.1, floor=2.0).min() == 2.0
    assert by_motion(T, constant, ratio=0.9, ceiling=3.0).max() == 3.0


def test_the_threshold_by_motion_scales_with_the_statistic():
    """Ten times the energy, ten times the threshold: no other noise figure changes what is found."""
    statistic = np.random.default_rng(0).exponential(size=400)
    np.testing.assert_allclose(by_motion(T, 10.0 * statistic), 10.0 * by_motion(T, statistic), rtol=1e-10)


def test_the_threshold_by_time_rises_and_falls_back():
    statistic = np.full(400, 5.0)
    threshold, rest = by_time_since_rest(T, statistic, growth=10.0)
    # 10 a second reach 5 after half a second, and again after another
    at = T[rest]
    np.testing.assert_allclose(at[0], 0.51, atol=0.011)  # one sample
    np.testing.assert_allclose(np.diff(at), 0.51, atol=0.011)
    assert threshold[0] == 0.0
    _, late = by_time_since_rest(T, statistic, growth=10.0, delay_s=1.0)
    assert T[late][0] == pytest.approx(1.51, abs=0.011)
    _, always = by_time_since_rest(T, statistic, growth=10.0, floor=6.0)
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
        by_motion(T, np.ones(400), **options)
    with pytest.raises(InputError, match="growth"):
        by_time_since_rest(T, np.ones(400), growth=0.0)


# ------------------------------------------------------------------------------------ intervals, hysteresis


def test_short_breaks_are_closed_and_short_rests_left_out():
    mask = np.zeros(400, dtype=bool)
    mask[50:100] = mask[103:150] = mask[300:302] = True
    found = rests_of(T, mask)
    assert found.index.tolist() == [[50, 100], [103, 150], [300, 302]]
    found = rests_of(T, mask, bridge_s=0.03, min_rest_s=0.05)
    assert found.index.tolist() == [[50, 150]]
    assert found.start[0] == T[50]
    assert found.stop[0] == T[149]
    assert found.middle[0] == 99
    # a break of three samples is longer than 0.02 s
    assert len(rests_of(T, mask, bridge_s=0.02)) == 3
    assert intervals(np.ones(3, dtype=bool)).tolist() == [[0, 3]]
    assert len(rests_of(T, np.zeros(400, dtype=bool))) == 0


def test_hysteresis_keeps_a_rest_until_the_higher_threshold():
    motion = wc.square()
    imu = wc.noisy(wc.rates_log(motion), np.random.default_rng(2), gyro_n=2e-3, accel_n=0.02)
    statistic = find_rests(imu, DetectorSection(threshold=1.0), gravity=9.807).statistic
    middle = float(np.median(statistic[motion.resting(imu.t)]))  # passed now and then in every rest
    plain = find_rests(imu, DetectorSection(threshold=middle, min_rest_s=0.0), gravity=9.807)
    kept = find_rests(imu, DetectorSection(threshold=middle, min_rest_s=0.0, leave=3.0), gravity=9.807)
    assert np.all(kept.mask[plain.mask])
    assert len(kept) < 0.5 * len(plain)
    assert kept.mask[motion.resting(imu.t)].mean() > plain.mask[motion.resting(imu.t)].mean()


# ----------------------------------------------------------------------------------------------- detectors


def rates_of(section, seed=1, **motion_options):
    """Share of resting samples found, and of samples of swings faster than 10 cm/s taken for rest."""
    motion = wc.square(**motion_options)
    imu = wc.noisy(wc.rates_log(motion), np.random.default_rng(seed), gyro_n=1e-4, accel_n=2e-3)
    found = find_rests(imu, section, gravity=9.807)
    resting = motion.resting(imu.t)
    fast = ~resting & (np.linalg.norm(motion.state(imu.t).v_eb_e, axis=1) > 0.1)
    return found.mask[resting].mean(), found.mask[fast].mean(), found, motion, imu


@pytest.mark.parametrize("kind", ["shoe", "ared", "amv", "magnitude"])
@pytest.mark.parametrize("threshold", ["motion", 2500.0])
def test_every_detector_finds_the_rests(kind, threshold):
    hit, false_alarm, found, motion, _ = rates_of(DetectorSection(kind=kind, threshold=threshold))
    # centred windows of 0.1 and 0.15 s reach out of both ends of a rest of 0.55 s
    assert hit > (0.98 if kind in ("shoe", "ared") else 0.85)
    assert false_alarm < 0.01
    if kind == "shoe":
        assert len(found) == len(motion.lift) + 1


def test_the_threshold_from_noise_finds_the_rests_of_an_undisturbed_foot():
    """Here rests are exact, so noise alone decides; a real foot is never so still."""
    hit, false_alarm, *_ = rates_of(DetectorSection(threshold="noise", margin=1.0, min_rest_s=0.0, window_s=0.05))
    # false alarm 1e-3 by construction, and half a window at both ends of 12 rests of 110 samples
    assert 0.9 < hit < 1.0
    assert false_alarm == 0.0


def test_the_threshold_by_time_finds_every_stance():
    _, false_alarm, found, motion, imu = rates_of(DetectorSection(threshold="time", floor=0.0, min_rest_s=0.0))
    assert false_alarm < 0.01
    for begin, end in zip(motion.contact[:-1], motion.lift[1:], strict=True):
        assert found.mask[(imu.t > begin) & (imu.t < end)].any()


def test_one_share_serves_a_slow_walk_and_a_run():
    """A threshold by motion finds rests of a foot that never stands still, slowly and fast; no fixed one does both."""
    rolling = {"roll_over": 0.2, "pivot_b": (0.06, 0.0, 0.08)}
    slow = {"swing": 0.9, "rest": 1.3, "length": 0.6, "tip": 0.4, **rolling}
    fast = {"swing": 0.35, "rest": 0.3, "length": 2.0, "tip": 1.2, **rolling}
    for section in (DetectorSection(ratio=0.03), DetectorSection(ratio=0.06)):
        for options in (slow, fast):
            _, false_alarm, found, motion, imu = rates_of(section, **options)
            stances = zip(motion.contact[:-1], motion.lift[1:], strict=True)
            seen = [found.mask[(imu.t > a) & (imu.t < b)].any() for a, b in stances]
            assert all(seen)
            assert false_alarm < 0.06


def test_what_the_noise_needs():
    motion = wc.square()
    imu = wc.rates_log(motion)
    with pytest.raises(InputError, match="never changes"):
        find_rests(imu, DetectorSection(threshold="noise"), gravity=9.807)
    with pytest.raises(InputError, match="too short"):
        find_rests(imu.between(0.0, 0.5), DetectorSection(threshold="noise"), gravity=9.807)
