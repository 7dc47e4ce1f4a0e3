"""Foot-mounted navigation on simulated walks: closed form, resting point, both ways of smoothing, honesty, messages."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import walk_cases as wc
from places import EXAMPLES

import schuler
from schuler import frames
from schuler.exceptions import ConfigError, InputError
from schuler.navigation.evaluation.consistency import chi_square_band, nees, state_errors
from schuler.navigation.foot.alignment import acceleration_sigma
from schuler.navigation.foot.config import FootConfig
from schuler.navigation.foot.errors import walk_errors
from schuler.navigation.foot.run import navigate_foot
from schuler.recording.recording import Recording
from schuler.recording.series import ImuSeries
from schuler.simulation.gait import walk

PLAIN = {"place": wc.PLACE, "zupt": {"pivot": False}, "filter": {"states": 9}}
GYRO_N, ACCEL_N = 2e-4, 5e-3  # a good MEMS IMU; the tests' own noise


@pytest.fixture(scope="module")
def square():
    motion = wc.square()
    return motion, wc.increments_log(motion)


@pytest.fixture(scope="module")
def drive_of_town():
    return schuler.simulate(EXAMPLES / "town.toml").need_imu().rates()


def worst(result, motion):
    """Largest difference of position from the truth, both from their start. [m]"""
    truth = frames.ned_from_ecef(motion.state(result.t).r_eb_e, wc.ORIGIN)
    return np.linalg.norm(result.position_n() - (truth - truth[0]), axis=1).max()


# ------------------------------------------------------------------------------------------- closed form


@pytest.mark.parametrize("smooth", ["walk", "stride", "none"])
def test_perfect_data_return_the_walk(square, smooth):
    motion, imu = square
    config = {**PLAIN, "filter": {"states": 9, "smooth": smooth}}
    result = navigate_foot(imu, config, rest=motion.resting(imu.t - 0.5 / wc.RATE))
    # discretisation: 200 Hz of swings with 50 m/s^2; the mechanization alone is off by as much
    assert worst(result, motion) < 3e-4
    assert result.distance == pytest.approx(12 * 1.3, abs=3e-4)
    assert np.abs(result.closure_n).max() < 3e-4
    assert result.smoothing == smooth
    assert len(result.strides) == 12


def test_the_error_falls_with_the_sampling_rate(monkeypatch):
    """Rates sampled at instants and integrated by the trapezoid: second order, so a factor near four."""
    motion, errors = wc.square(), []
    for rate in (100.0, 200.0, 400.0):
        monkeypatch.setattr(wc, "RATE", rate)
        imu = wc.rates_log(motion)
        result = navigate_foot(imu, {**PLAIN, "filter": {"states": 9, "smooth": "none"}}, rest=motion.resting(imu.t))
        errors.append(worst(result, motion))
    # discretisation, where rests begin and end on samples: between first and third order
    assert errors[0] > 2.5 * errors[1] > 6.0 * errors[2], errors


def test_a_walk_that_begins_later_starts_at_its_first_rest(square):
    """Cut off inside a swing, the log begins in motion; the axes of the walk start at the first rest after it."""
    motion, imu = square
    part = imu.between(5.2, imu.t[-1])
    resting = motion.resting(part.t - 0.5 / wc.RATE)
    result = navigate_foot(part, PLAIN, rest=resting)
    assert result.t[0] == pytest.approx(part.t[np.argmax(resting)], abs=1.5 / wc.RATE)
    assert any("first rests" in note for note in result.notes)
    assert result.distance == pytest.approx(11 * 1.3, abs=1e-3)


def test_a_log_that_begins_in_a_run_starts_in_a_stance(square):
    """No rest is as long as alignment.min_rest_s before the end: a stance of 0.08 s begins the walk, not that end."""
    motion = walk(wc.ORIGIN, strides=12, rest=0.08, turn=wc.TURNS)
    part = wc.increments_log(motion).between(5.2, motion.duration)
    resting = motion.resting(part.t - 0.5 / wc.RATE)
    result = navigate_foot(part, PLAIN, rest=resting)
    assert result.t[0] == pytest.approx(part.t[np.argmax(resting)], abs=1.5 / wc.RATE)
    assert result.distance == pytest.approx(11 * 1.3, abs=1e-3)  # discretisation
    # what a change of velocity in 0.08 s can hide is claimed: some 3 deg, where a second at rest levels to 0.1 deg
    tilt = np.sqrt(np.diagonal(result.navigation.covariance[0])[:2])
    assert np.all(tilt > np.radians(0.5))
    assert np.sqrt(np.diagonal(navigate_foot(square[1], PLAIN).navigation.covariance[0])[:2]).max() < np.radians(0.3)


def test_acceleration_in_a_stance_is_a_change_of_velocity_and_what_gravity_misses():
    config, t = FootConfig(), 0.005 * np.arange(1, 11)
    still = ImuSeries(t, np.zeros((10, 3)), np.tile([0.0, 0.0, -9.8], (10, 1)))
    changing = np.sqrt(2.0) * config.zupt.sigma_m_s / 0.05
    assert acceleration_sigma(still, config, 9.8) == pytest.approx(changing, rel=1e-12)
    assert acceleration_sigma(still, config, 10.3) == pytest.approx(np.sqrt(changing**2 + 0.25 - 0.03**2), rel=1e-12)


def test_perfect_data_with_the_detector_return_the_walk(square):
    motion, imu = square
    result = navigate_foot(imu, {"place": wc.PLACE})
    # the detector takes up to 2 cm/s at the ends of swings for rest, for a few samples of each: millimetres
    assert worst(result, motion) < 5e-3
    assert len(result.strides) == 12


def test_the_rate_of_the_foot_while_it_rolls_is_used_to_find_the_resting_point():
    """The foot pitches by 8 deg about a point 10 cm away in every rest: that point is found, and its velocity used."""
    pivot = np.array([0.06, 0.01, 0.08])
    motion = wc.square(roll_over=0.15, pivot_b=pivot)
    imu = wc.increments_log(motion)
    rest = motion.resting(imu.t - 0.5 / wc.RATE)
    quiet = {"sigma_m_s": 0.005, "roll_m": 0.0}
    turning = {**PLAIN, "zupt": {**quiet, "pivot": True}}
    result = navigate_foot(imu, turning, rest=rest)
    ignored = navigate_foot(imu, {**PLAIN, "zupt": {**quiet, "pivot": False}}, rest=rest)
    estimate, sigma = result.pivot_b()
    # forward and down act through the pitch rate; 3 sigma claimed, no noise in the data
    assert np.all(np.abs(estimate - pivot)[[0, 2]] < 3.0 * sigma[[0, 2]] + 1e-3), (estimate, sigma)
    assert np.all(sigma[[0, 2]] < 0.01)
    assert sigma[1] > 0.05  # rolling straight on says nothing of the lateral one but for the turning in swings
    # roll_over reaches 1 rad/s: 10 cm/s of the IMU, taken for none, bend the track
    assert worst(result, motion) < 0.2 * worst(ignored, motion)
    assert ignored.pivot_b() is None
    assert set(result.navigation.innovations.counts()) == {"zero_velocity"}
    assert set(ignored.navigation.innovations.counts()) == {"zero_velocity"}


# ----------------------------------------------------------------------------------------------- smoothing


def test_pieces_of_a_stride_are_the_same_filter(square):
    """Cutting the run at rests changes nothing but where the covariance is propagated."""
    motion, imu = square
    imu = wc.noisy(imu, np.random.default_rng(5), gyro_n=GYRO_N, accel_n=ACCEL_N, b_g=(0.001, -0.001, 0.0005))
    rest = motion.resting(imu.t - 0.5 / wc.RATE)
    exact = {"covariance_rate_hz": None}
    complete = navigate_foot(imu, {"place": wc.PLACE, "filter": {**exact, "smooth": "walk"}}, rest=rest)
    pieces = navigate_foot(imu, {"place": wc.PLACE, "filter": {**exact, "smooth": "stride"}}, rest=rest)
    gap = np.abs(complete.navigation.trajectory.r_eb_e - pieces.navigation.trajectory.r_eb_e).max()
    # the coning correction of the first interval of each piece, which does not know the one before
    assert gap < 1e-5
    at = np.searchsorted(pieces.navigation.t, complete.navigation.t[-1] - 1e-9)
    np.testing.assert_allclose(
        pieces.navigation.sigma("dr")[at], complete.navigation.sigma("dr")[-1], rtol=1e-6
    )  # rounding
    # the last piece knows all that is known: there both are the fixed-interval smoother
    last = slice(-int(2.0 * wc.RATE), None)
    gap = np.abs(complete.smoothed.trajectory.r_eb_e[last] - pieces.smoothed.trajectory.r_eb_e[last]).max()
    assert gap < 1e-5


def test_smoothing_removes_the_jumps_at_contact(square):
    """The filter is corrected when the foot comes to rest; a stride's smoother spreads that over the swing."""
    motion, imu = square
    imu = wc.noisy(imu, np.random.default_rng(9), gyro_n=2e-3, accel_n=0.05)
    rest = motion.resting(imu.t - 0.5 / wc.RATE)
    rms = {}
    for smooth in ("none", "stride", "walk"):
        result = navigate_foot(imu, {"place": wc.PLACE, "filter": {"smooth": smooth}}, rest=rest)
        swing = ~result.rests.mask
        truth = motion.state(result.t).v_eb_e
        v = np.concatenate((truth[:1], result.best.trajectory.v_eb_e))
        rms[smooth] = np.sqrt(np.mean((v - truth)[swing] ** 2))
    assert rms["stride"] < 0.75 * rms["none"]
    assert rms["walk"] < 1.05 * rms["stride"]


# ------------------------------------------------------------------------------------------------ honesty


def run_of(seed, motion, ideal, smooth):
    """A walk with biases of both signs drawn from what the filter is told, and the truth of the parameters."""
    rng = np.random.default_rng([11, seed])
    b_a, b_g = 0.03 * rng.standard_normal(3), 0.0017453 * rng.standard_normal(3)
    imu = wc.noisy(ideal, rng, gyro_n=GYRO_N, accel_n=ACCEL_N, b_g=b_g, b_a=b_a)
    config = {
        "place": wc.PLACE,
        "sensor": {"accel_noise_m_s2_rthz": ACCEL_N, "gyro_noise_deg_s_rthz": np.degrees(GYRO_N)},
        # the foot of the simulation rests exactly: a sigma far below what the noise makes of one sample
        "zupt": {"sigma_m_s": 5e-5, "roll_m": 0.0, "pivot": False},
        "filter": {"smooth": smooth, "covariance_rate_hz": None},
    }
    result = navigate_foot(imu, config, rest=motion.resting(imu.t - 0.5 / wc.RATE))
    return result, np.concatenate((b_a, b_g))


@pytest.mark.thinned(3)
@pytest.mark.parametrize(("smooth", "runs"), [("none", 30), ("none", 60), ("walk", 30)])
def test_nees_of_a_walk_is_in_band(square, smooth, runs):
    """NEES over navigation states and biases, at times in swings and at the end."""
    motion, ideal = square
    truth = wc.truth(motion, np.arange(0.0, motion.duration, 1.0 / wc.RATE))
    looks, final = [], []
    for seed in range(runs):
        result, biases = run_of(seed, motion, ideal, smooth)
        values = nees(result.best, truth, biases)
        at = np.searchsorted(result.best.t, [7.25, 10.25, 13.25, 16.2])
        looks.append(values[at])
        _, dx, P = state_errors(result.best, truth, biases)
        final.append(dx[at[-1]] / np.sqrt(np.diag(P[at[-1]])))
    mean = np.mean(looks, axis=0)
    low, high = chi_square_band(15, runs, 0.9999)
    assert np.all((mean > low) & (mean < high)), (low, mean, high)  # statistical: four looks, 99.99 % each
    spread = np.sqrt(np.mean(np.square(final), axis=0))
    assert np.all(np.abs(np.mean(final, axis=0)) < 4.5 / np.sqrt(runs))  # 4.5 standard errors
    assert np.all(np.abs(spread - 1.0) < 4.5 / np.sqrt(2 * runs)), spread


def test_position_and_heading_are_not_seen(square):
    """Zero velocities bound velocity and tilt; position and heading only get worse."""
    motion, imu = square
    result = navigate_foot(imu, {"place": wc.PLACE}, rest=motion.resting(imu.t - 0.5 / wc.RATE)).navigation
    at = np.searchsorted(result.t, [4.9, 8.7, 12.7, 16.7, 20.0])
    assert np.all(np.diff(result.sigma("dpsi")[at, 2]) > 0.0)
    # back at the start of a square a turn moves nothing, so the horizontal part need not grow all the time
    assert np.all(np.diff(result.sigma("dr")[at[:-1], 2]) > 0.0)
    assert np.all(result.sigma("dr")[at[1:]] > 3.0 * result.sigma("dr")[at[0]])
    assert np.all(result.sigma("dv")[at] < 0.02)
    assert np.all(result.sigma("dpsi")[at, :2] < 0.02)


def test_a_heading_error_turns_the_walk(square):
    """The heading at the start is a matter of names: given otherwise, the whole walk turns with it and nothing else."""
    motion, imu = square
    rest = motion.resting(imu.t - 0.5 / wc.RATE)
    one = navigate_foot(imu, PLAIN, rest=rest)
    other = navigate_foot(imu, {**PLAIN, "alignment": {"heading_deg": 90.0}}, rest=rest)
    a, b = one.position_n(), other.position_n()
    # Earth rate has another direction in the body: micrometres
    np.testing.assert_allclose(b[:, :2], np.stack((-a[:, 1], a[:, 0]), axis=1), atol=2e-3)
    errors = walk_errors(other, wc.truth(motion, wc.times(motion)))
    assert np.degrees(errors.turned) == pytest.approx(-90.0, abs=0.02)
    assert errors.rms_horizontal < 1e-3


# --------------------------------------------------------------------------------- comparison, messages, summary


def test_walk_errors_by_their_definition(square):
    """A reference that is 3 cm north of the walk after its start: the author's error is 3 cm over root two."""
    motion, imu = square
    result = navigate_foot(imu, PLAIN, rest=motion.resting(imu.t - 0.5 / wc.RATE))
    t = wc.times(motion)
    truth = wc.truth(motion, t)
    moved = frames.ned_from_ecef(truth.r_eb_e, wc.ORIGIN)
    moved[1:, 0] -= 0.03
    shifted = replace(truth, r_eb_e=frames.ecef_from_ned(moved, wc.ORIGIN), v_eb_e=None, _cache={})
    errors = walk_errors(result, shifted, fit="start")
    # a shift along the first stride turns nothing
    assert errors.turned == pytest.approx(0.0, abs=2e-3)
    assert errors.author_error == pytest.approx(0.03 / np.sqrt(2.0), rel=0.05)
    assert errors.rms_horizontal == pytest.approx(0.03, rel=0.05)
    with pytest.raises(InputError, match="does not cover"):
        walk_errors(result, truth.between(1.0, 9.0))
    with pytest.raises(InputError, match="never gets"):
        walk_errors(result, truth, fit_distance_m=100.0)
    with pytest.raises(InputError, match="'start' or 'all'"):
        walk_errors(result, truth, fit="middle")


def test_what_a_user_can_do_wrong(square):
    _, imu = square
    with pytest.raises(InputError, match="mask of shape"):
        navigate_foot(imu, PLAIN, rest=np.ones(10, dtype=bool))
    with pytest.raises(InputError, match="never rests"):
        navigate_foot(imu, PLAIN, rest=np.zeros(len(imu), dtype=bool))
    with pytest.raises(ConfigError, match="detektor"):
        navigate_foot(imu, {"detektor": {}})
    with pytest.raises(ConfigError, match="such configuration file"):
        FootConfig.load("nowhere.toml")
    keep = (imu.t < 8.0) | (imu.t > 8.5)
    with pytest.raises(InputError, match="pauses for"):
        navigate_foot(ImuSeries(imu.t[keep], imu.gyro[keep], imu.accel[keep], imu.kind), PLAIN)


def test_summary_and_recording(square):
    _, imu = square
    result = navigate_foot(Recording(imu=imu), {"place": wc.PLACE})
    text = result.summary()
    assert "12 strides" in text
    assert "dead reckoning" in text
    assert "resting point" in text
    assert result.zero_velocities == len(result.navigation.innovations)
    assert len(result.position_n()) == len(result.t) == len(result.rests.mask)


def begun_in_a_swing(square, bias_deg_s, *, stands):
    """The walk from shortly before its first swing, of a unit with gyro biases, with or without its last rest."""
    motion, imu = square
    moving = np.flatnonzero(~motion.resting(imu.t - 0.5 / wc.RATE))
    keep = slice(moving[0] - round(0.15 * wc.RATE), None if stands else moving[-1] + round(0.2 * wc.RATE))
    gyro = imu.gyro[keep] + np.radians(bias_deg_s) / wc.RATE
    return ImuSeries(imu.t[keep], gyro, imu.accel[keep], imu.kind)


@pytest.mark.parametrize("sign", [-1.0, 1.0])
def test_gyro_biases_that_the_strides_contradict_are_allowed_for(square, sign):
    """Two deg/s on every axis and no rest long enough to see them at: the budget grows to them, the run is doubted."""
    late = begun_in_a_swing(square, 2.0 * sign, stands=False)
    result = navigate_foot(late, {"place": wc.PLACE})
    assert any("the strides contradict gyro biases of 0.1 deg/s" in note for note in result.notes)
    assert "the foot never stands for 1 s" in result.verdict.reasons[0]
    bias, sigma = np.degrees(result.best.parameter("b_g")[-1]), np.degrees(result.best.sigma("b_g")[-1])
    # statistical, and what the sampling of the swings adds; the bias about the vertical, hardly seen, is the doubt
    assert np.all((np.abs(bias - 2.0 * sign) < 3.0 * sigma)[:2])
    usual = navigate_foot(square[1], {"place": wc.PLACE})
    assert usual.verdict.status == "ok"
    assert not any("contradict" in note for note in usual.notes)


@pytest.mark.parametrize("sign", [-1.0, 1.0])
def test_a_walk_begun_in_a_swing_takes_its_gyro_biases_from_the_rest_at_its_end(square, sign):
    """Twenty sigmas of the configured bias: a rest of a second counts alone."""
    bias = sign * np.array([2.0, -1.0, 1.5])
    result = navigate_foot(begun_in_a_swing(square, bias, stands=True), {"place": wc.PLACE})
    assert result.verdict.status == "ok"
    # but for the rotation of the Earth, 0.004 deg/s
    np.testing.assert_allclose(np.degrees(result.navigation.parameter("b_g")[0]), bias, atol=0.01)


def test_a_log_without_a_rest_that_tells_gyro_biases_is_doubted(square):
    """Stances of 0.3 s are too short for a scatter."""
    motion, imu = square
    rest = motion.resting(imu.t)
    brief = rest & ~np.roll(rest, round(0.3 * wc.RATE))
    verdict = navigate_foot(imu, {"place": wc.PLACE}, rest=brief).verdict
    assert verdict.status == "doubtful"
    assert "no rest tells the gyro biases" in verdict.reasons[0]
    without = {"place": wc.PLACE, "filter": {"states": 9}}
    assert navigate_foot(imu, without, rest=brief).verdict.status == "ok"  # none to tell


@pytest.mark.campaign
def test_what_is_not_on_a_foot_is_doubted(drive_of_town):
    """A car's log: no stride, and one rest from end to end while it goes through a town."""
    verdict = navigate_foot(drive_of_town.between(0.0, 150.0), {"place": wc.PLACE}).verdict
    assert verdict.status == "doubtful"
    assert "not on a foot" in verdict.reasons[0]


def test_somebody_who_stands_is_not_doubted():
    rng = np.random.default_rng(4)
    t = np.arange(0.0, 20.0, 0.005)
    still = np.array([0.0, 0.0, -9.80665]) + 5e-3 * rng.standard_normal((len(t), 3))
    result = navigate_foot(ImuSeries(t, 1e-3 * rng.standard_normal((len(t), 3)), still), {"place": wc.PLACE})
    assert not result.strides.walking.any()
    assert result.verdict.status == "ok"
