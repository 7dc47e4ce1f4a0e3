"""Rests of a foot: hysteresis and hit rates of every detector on a walk with known rests."""

from __future__ import annotations

import numpy as np
import pytest
import walk_cases as wc

from schuler.exceptions import InputError
from schuler.navigation.foot.config import DetectorSection
from schuler.navigation.foot.rests import detect_rests, in_swings
from schuler.standstill.intervals import rests_from_mask


def test_hysteresis_keeps_a_rest_until_the_higher_threshold():
    motion = wc.square()
    imu = wc.noisy(wc.rates_log(motion), np.random.default_rng(2), gyro_n=2e-3, accel_n=0.02)
    statistic = detect_rests(imu, DetectorSection(threshold=1.0), gravity=9.807).statistic
    middle = float(np.median(statistic[motion.resting(imu.t)]))  # passed now and then in every rest
    plain = detect_rests(imu, DetectorSection(threshold=middle, min_rest_s=0.0), gravity=9.807)
    kept = detect_rests(imu, DetectorSection(threshold=middle, min_rest_s=0.0, leave=3.0), gravity=9.807)
    assert np.all(kept.mask[plain.mask])
    assert len(kept) < 0.5 * len(plain)
    assert kept.mask[motion.resting(imu.t)].mean() > plain.mask[motion.resting(imu.t)].mean()


# ----------------------------------------------------------------------------------------------- detectors


def detection_rates(section, seed=1, **motion_options):
    """Share of resting samples detected, and of samples of swings faster than 10 cm/s taken for rest."""
    motion = wc.square(**motion_options)
    imu = wc.noisy(wc.rates_log(motion), np.random.default_rng(seed), gyro_n=1e-4, accel_n=2e-3)
    rests = detect_rests(imu, section, gravity=9.807)
    resting = motion.resting(imu.t)
    fast = ~resting & (np.linalg.norm(motion.state(imu.t).v_eb_e, axis=1) > 0.1)
    return rests.mask[resting].mean(), rests.mask[fast].mean(), rests, motion, imu


@pytest.mark.parametrize("kind", ["shoe", "ared", "amv", "magnitude"])
@pytest.mark.parametrize("threshold", ["motion", 2500.0])
def test_every_detector_finds_the_rests(kind, threshold):
    hit, false_alarm, rests, motion, _ = detection_rates(DetectorSection(kind=kind, threshold=threshold))
    # centred windows of 0.1 and 0.15 s reach out of both ends of a rest of 0.55 s
    assert hit > (0.98 if kind in ("shoe", "ared") else 0.85)
    assert false_alarm < 0.01
    if kind == "shoe":
        assert len(rests) == len(motion.lift) + 1


def test_the_threshold_from_noise_finds_the_rests_of_an_undisturbed_foot():
    """Here rests are exact, so noise alone decides; a real foot is never so still."""
    hit, false_alarm, *_ = detection_rates(
        DetectorSection(threshold="noise", margin=1.0, min_rest_s=0.0, window_s=0.05)
    )
    # false alarm 1e-3 by construction, and half a window at both ends of 12 rests of 110 samples
    assert 0.9 < hit < 1.0
    assert false_alarm == 0.0


def test_the_threshold_by_time_finds_every_stance():
    _, false_alarm, rests, motion, imu = detection_rates(DetectorSection(threshold="time", floor=0.0, min_rest_s=0.0))
    assert false_alarm < 0.01
    for begin, end in zip(motion.contact[:-1], motion.lift[1:], strict=True):
        assert rests.mask[(imu.t > begin) & (imu.t < end)].any()


def test_one_share_serves_a_slow_walk_and_a_run():
    """A threshold by motion finds rests of a foot that never stands still, slowly and fast; no fixed one does both."""
    rolling = {"roll_over": 0.2, "pivot_b": (0.06, 0.0, 0.08)}
    slow = {"swing": 0.9, "rest": 1.3, "length": 0.6, "tip": 0.4, **rolling}
    fast = {"swing": 0.35, "rest": 0.3, "length": 2.0, "tip": 1.2, **rolling}
    for section in (DetectorSection(ratio=0.03), DetectorSection(ratio=0.06)):
        for options in (slow, fast):
            _, false_alarm, rests, motion, imu = detection_rates(section, **options)
            stances = zip(motion.contact[:-1], motion.lift[1:], strict=True)
            seen = [rests.mask[(imu.t > a) & (imu.t < b)].any() for a, b in stances]
            assert all(seen)
            assert false_alarm < 0.06


def test_what_the_noise_needs():
    motion = wc.square()
    imu = wc.rates_log(motion)
    with pytest.raises(InputError, match="never changes"):
        detect_rests(imu, DetectorSection(threshold="noise"), gravity=9.807)
    with pytest.raises(InputError, match="too short"):
        detect_rests(imu.between(0.0, 0.5), DetectorSection(threshold="noise"), gravity=9.807)


@pytest.mark.parametrize(
    ("at", "length", "expected"),
    [
        (0.45, 0.03, [1]),  # in the middle of a swing of 0.8 s
        (0.12, 0.03, []),  # a part of the stance before
        (0.45, 0.2, []),  # too long for a swing
    ],
)
def test_a_moment_in_a_swing_is_no_stance(at, length, expected):
    """Stances of 0.2 s around a swing of 0.8 s in a gait of 1 s, and one more rest."""
    t = np.arange(0.0, 1.2, 0.005)
    mask = (t < 0.1) | (t >= 0.9) | ((t >= at) & (t < at + length))
    assert in_swings(rests_from_mask(t, mask), 1.0).tolist() == expected


def test_two_swings_have_a_stance_between():
    t = np.arange(0.0, 2.2, 0.005)
    mask = (t < 0.1) | (t >= 1.9) | ((t >= 1.0) & (t < 1.03))
    assert in_swings(rests_from_mask(t, mask), 1.0).tolist() == []
    assert in_swings(rests_from_mask(t, t < 0.1), 1.0).tolist() == []
