"""What a foot's log says itself: noise in proportion to the motion, gyro biases at the first rest, missed stances."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import walk_cases as wc
from benchmarks.corpus.foot import llio

from schuler import units
from schuler.navigation.foot.clipping import clip_sentences, gyro_clips
from schuler.navigation.foot.config import SensorSection
from schuler.navigation.foot.motion import in_motion, motion_level, noise_in_motion, spike_doubts
from schuler.navigation.foot.run import navigate_foot
from schuler.recording.formats import matlab
from schuler.recording.series import ImuSeries

G = 9.807


@pytest.fixture(scope="module")
def square():
    motion = wc.square()
    return motion, wc.rates_log(motion)


def test_a_spike_of_the_transmission_is_doubted(square):
    """30 rad/s in one sample of 5 ms turn the attitude by 8.6 deg; two such samples in a row are a motion."""
    imu = square[1]
    assert spike_doubts(imu) == []
    gyro = imu.gyro.copy()
    gyro[700] += [30.0, 0.0, 0.0]
    (doubt,) = spike_doubts(replace(imu, gyro=gyro))
    assert f"first at {imu.t[700]:.3f} s" in doubt
    assert "8.6 deg" in doubt
    assert navigate_foot(replace(imu, gyro=gyro), {"place": wc.PLACE}).verdict.status == "doubtful"
    gyro[701] += [30.0, 0.0, 0.0]
    assert spike_doubts(replace(imu, gyro=gyro)) == []


def test_noise_grows_with_the_motion(square):
    """Twice the specific force beyond gravity and twice the rate: twice the noise."""
    t = np.arange(4000) / 200.0
    beat = np.sin(2.0 * np.pi * t)
    down = np.array([0.0, 0.0, -1.0])

    def log(times):
        return ImuSeries(t, np.outer(times * 3.0 * beat, [0.0, 1.0, 0.0]), (G + times * 4.0 * beat)[:, None] * down)

    (force, rate), (force_2, rate_2) = motion_level(log(1.0), G), motion_level(log(2.0), G)
    assert (force, rate) == pytest.approx((4.0 / np.sqrt(2.0), 3.0 / np.sqrt(2.0)), rel=1e-3)  # discretisation
    assert (force_2, rate_2) == pytest.approx((2.0 * force, 2.0 * rate), rel=1e-9)
    gyro, accel, note = noise_in_motion(log(1.0), SensorSection(), G)
    gyro_2, accel_2, _ = noise_in_motion(log(2.0), SensorSection(), G)
    assert np.allclose([gyro_2 / gyro, accel_2 / accel], 4.0, rtol=1e-9)
    assert "noise from the motion" in note
    stated = SensorSection(accel_noise_m_s2_rthz=0.02, gyro_noise_deg_s_rthz=0.03)
    gyro, accel, note = noise_in_motion(log(1.0), stated, G)
    assert (gyro[0], accel[0], note) == ((0.03 * units.DEG) ** 2, 0.02**2, "")


def test_standing_has_the_noise_of_a_shuffle():
    t = np.arange(1000) / 200.0
    still = ImuSeries(t, np.zeros((1000, 3)), np.tile([0.0, 0.0, -G], (1000, 1)))
    gyro, accel, _ = noise_in_motion(still, SensorSection(), G)
    assert np.all(gyro > 0.0)
    assert np.all(accel > 0.0)


@pytest.mark.parametrize("sign", [-1.0, 1.0])
def test_gyro_biases_start_from_the_first_rest(square, sign):
    """A bias three times the configured sigma, of either sign, is known to the sway of the first rest."""
    motion, imu = square
    bias = sign * np.array([0.3, -0.25, 0.35]) * units.DEG
    noisy = wc.noisy(imu, np.random.default_rng(6), gyro_n=2e-4, accel_n=5e-3, b_g=bias)
    result = navigate_foot(noisy, {"place": wc.PLACE}, rest=motion.resting(noisy.t))
    first, sigma = result.navigation.parameter("b_g")[0], result.navigation.sigma("b_g")[0]
    assert np.all(sigma < 0.05 * units.DEG)
    assert np.all(np.abs(first - bias) < 4.0 * sigma)  # statistical
    # the prior of 0.1 deg/s draws it towards zero by less than what it claims
    assert np.all(np.abs(first) > 0.8 * np.abs(bias))


def test_missed_stances_are_said_first(square):
    motion, imu = square
    rest = motion.resting(imu.t)
    assert navigate_foot(imu, {"place": wc.PLACE}, rest=rest).verdict.status == "ok"
    change = np.flatnonzero(np.diff(rest.astype(int)))
    some = rest.copy()
    some[change[3] : change[-3]] = False  # nothing between the second and the last rest but one
    verdict = navigate_foot(imu, {"place": wc.PLACE}, rest=some).verdict
    assert verdict.status == "doubtful"
    assert "strides were found where the motion repeats about" in verdict.reasons[0]


def test_a_stride_of_metres_is_doubted(square):
    motion, imu = square
    strides = navigate_foot(imu, {"place": wc.PLACE}, rest=motion.resting(imu.t)).strides
    assert strides.doubts(None) == []
    assert "length of 5.2" in replace(strides, length=4.0 * strides.length).doubts(None)[0]
    assert "clearance" in replace(strides, clearance=10.0 * strides.clearance + 0.3).doubts(None)[0]


def test_one_who_stands_for_most_of_the_log_walks_in_the_rest_of_it(square):
    """A minute of standing before the walk is no motion, and does not count as missed strides."""
    _, imu = square
    still = imu.gyro[:20].mean(axis=0), imu.accel[:20].mean(axis=0)
    n = 12_000
    t = np.concatenate((imu.t, imu.t[-1] + imu.interval * np.arange(1, n + 1)))
    longer = ImuSeries(
        t, *(np.vstack((x, np.tile(s, (n, 1)))) for x, s in zip((imu.gyro, imu.accel), still, strict=True)), imu.kind
    )
    moving = in_motion(longer)
    assert moving[len(imu) + 400 :].sum() == 0
    assert abs(int(moving.sum()) - int(in_motion(imu).sum())) < 300
    assert motion_level(longer, G) == pytest.approx(motion_level(imu, G), rel=0.1)


def test_velocity_left_at_stances_is_doubted(square):
    """Clipped gyros leave more than a stride's speed at every stance, a start in motion some at the first ones only."""
    motion, imu = square
    strides = navigate_foot(imu, {"place": wc.PLACE}, rest=motion.resting(imu.t)).strides
    speed = float(np.median(strides.speed[strides.walking]))
    assert strides.doubts(None, np.full(20, 0.5 * speed)) == []
    assert "stances are missed, or sensors were clipped" in strides.doubts(None, np.full(20, speed))[0]
    late = np.full(20, 0.1)
    assert strides.doubts(None, late) == []
    assert "begin where it stands still" in strides.doubts(None, np.concatenate(([0.6], late)))[0]
    assert strides.doubts(None, np.concatenate((late, [0.6]))) == []  # a shuffle later on


@pytest.mark.realdata
@pytest.mark.parametrize(("number", "largest"), [(34, 0.15), (35, 0.6)])
def test_runs_with_a_moment_like_a_stance_and_with_clipped_gyroscopes(shared_data, number, largest):
    """Ground points of the strides: errors of 0.57 and 0.93 m, NEES 30 and 16 before; clipping is said."""
    row = llio(shared_data, f"llio_foot/SensorConnectData_{number}_LLIO.mat")
    assert row["smoothed"] < largest
    assert row["nees"] < 3.0
    held = matlab.load(shared_data / "llio_foot" / f"SensorConnectData_{number}_LLIO.mat")
    t, imu = np.ravel(held["timestamps"]), np.asarray(held["imu_data"])
    walk = ImuSeries(np.linspace(t[0], t[-1], len(t)), imu[:, 3:].copy(), imu[:, :3].copy())
    clips = gyro_clips(walk)
    notes, doubts = clip_sentences(walk, clips)
    assert set(clips.axis) == {1}
    assert "clipped" in (notes if number == 34 else doubts)[0]
