"""The gait of a foot from its log: the period of its strides, stances however fast it goes."""

from __future__ import annotations

import numpy as np
import pytest
import walk_cases as wc

from schuler.recording.series import ImuSeries
from schuler.simulation.gait import walk
from schuler.standstill.gait import gait_threshold, stride_period

T = np.arange(2000) / 200.0


def pulses(period, level=100.0, stance=1.0, wide=0.2):
    """A statistic that falls from ``level`` to ``stance`` for a share of every period."""
    return np.where((T / period) % 1.0 < wide, stance, level)


@pytest.mark.parametrize("period", [0.72, 1.1, 1.6])
def test_the_period_is_that_of_the_strides(period):
    """Closed form: rates that repeat, with heel strikes that do not."""
    rng = np.random.default_rng(3)
    rate = 3.0 * np.maximum(0.0, np.sin(2.0 * np.pi * T / period)) ** 2 + 0.3 * rng.standard_normal(2000)
    rate[rng.choice(2000, 20)] += 20.0
    imu = ImuSeries(T, np.outer(rate, [0.1, 1.0, 0.2]), np.tile([0.0, 0.0, -9.8], (2000, 1)))
    assert stride_period(imu) == pytest.approx(period, abs=0.05)  # statistical: six strides under noise and strikes


def test_a_walk_in_closed_form_has_the_period_of_its_strides():
    motion = walk(wc.ORIGIN, strides=12)
    imu = wc.rates_log(motion)
    rests = motion.resting(imu.t)
    lifts = imu.t[1:][rests[:-1] & ~rests[1:]]
    assert stride_period(imu) == pytest.approx(float(np.median(np.diff(lifts))), abs=0.02)


def test_what_does_not_repeat_is_no_gait():
    rng = np.random.default_rng(4)
    noise = ImuSeries(T, rng.standard_normal((2000, 3)), rng.standard_normal((2000, 3)))
    assert stride_period(noise) is None
    still = ImuSeries(T, np.zeros((2000, 3)), np.zeros((2000, 3)))
    assert stride_period(still) is None
    assert stride_period(noise.between(0.0, 2.0)) is None


def test_every_stride_has_a_stance_however_fast():
    """A stance of a run is a twentieth of the mean, no share that a walk's slow swing would not have too."""
    run = pulses(0.75, stance=5.0)
    assert not np.any(run < gait_threshold(T, run, cycle_s=0.75))
    stances = run < gait_threshold(T, run, cycle_s=0.75, stillest=3.0)
    assert np.array_equal(stances, run == 5.0)


def test_a_motion_without_stances_has_none():
    """The stillest moment of a stride is no stance where it is more than a tenth of the mean."""
    swing = pulses(0.75, stance=20.0)
    assert not np.any(swing < gait_threshold(T, swing, cycle_s=0.75, stillest=3.0))


def test_stances_scale_with_the_statistic():
    walk_ = pulses(1.2, stance=0.8)
    a = gait_threshold(T, walk_, cycle_s=1.2, stillest=3.0)
    np.testing.assert_allclose(gait_threshold(T, 50.0 * walk_, cycle_s=1.2, stillest=3.0), 50.0 * a, rtol=1e-10)
