"""Intervals at rest: simulated poses, uniform rotation, bad samples, gaps; real logs of hand calibrations."""

import numpy as np
import pytest
import scipy.io

from schuler.exceptions import InputError
from schuler.recording.series import ImuSeries
from schuler.standstill.stationarity import static_intervals
from schuler.standstill.variance_ratio import accel_variance_ratio

G = 9.81


def poses(rng, count=8, rest_s=6.0, turn_s=2.0, rate_hz=100.0, bias=(0.01, -0.02, 0.005), angle=0.5 * np.pi):
    """Rest, turn by ``angle`` about x or z in turn, rest, ...; true intervals at rest. Rates and specific force.

    Turning goes as sin^2 so that it begins and ends gently.
    """
    n_rest, n_turn = int(rest_s * rate_hz), int(turn_s * rate_hz)
    gyro = [np.zeros((n_rest, 3))]
    shape = np.sin(np.pi * (np.arange(n_turn) + 0.5) / n_turn) ** 2
    for k in range(count - 1):
        turn = np.zeros((n_turn, 3))
        turn[:, 0 if k % 2 == 0 else 2] = shape / shape.sum() * angle * rate_hz
        gyro += [turn, np.zeros((n_rest, 3))]
    gyro = np.concatenate(gyro)
    C = np.eye(3)
    accel = np.empty_like(gyro)
    for k, w in enumerate(gyro):
        step = np.linalg.norm(w) / rate_hz
        if step > 0.0:
            u = w / np.linalg.norm(w)
            K = np.array([[0.0, -u[2], u[1]], [u[2], 0.0, -u[0]], [-u[1], u[0], 0.0]])
            C = C @ (np.eye(3) + np.sin(step) * K + (1.0 - np.cos(step)) * K @ K)
        accel[k] = C.T @ (0.0, 0.0, -G)
    t = np.arange(len(gyro)) / rate_hz
    rest = [(k * (rest_s + turn_s), k * (rest_s + turn_s) + rest_s) for k in range(count)]
    gyro = gyro + np.asarray(bias) + 0.003 * rng.standard_normal(gyro.shape)
    accel = accel + 0.02 * rng.standard_normal(gyro.shape)
    return ImuSeries(t, gyro, accel), np.array(rest)


def test_the_variance_ratio_is_that_of_the_window_around_each_sample(rng):
    """Definition, to rounding: ten samples on either side; none at the ends has such a window."""
    f = rng.standard_normal((300, 3)) * np.linspace(1.0, 3.0, 300)[:, None]
    ratio, at_rest = accel_variance_ratio(ImuSeries(np.arange(300) * 0.01, 0.0 * f, f), 0.01, 1.0, 0.2)
    windows = np.lib.stride_tricks.sliding_window_view(f, 21, axis=0).var(axis=-1, ddof=1)
    np.testing.assert_allclose(at_rest, f[:100].var(axis=0, ddof=1), rtol=1e-12)
    exact = np.linalg.norm(windows, axis=1) / np.linalg.norm(at_rest)
    np.testing.assert_allclose(ratio, np.pad(exact, 10, constant_values=np.inf), rtol=1e-9)


def check(intervals, rest, window_s):
    """Every interval lies within a true one and loses at most a window at either end."""
    assert len(intervals) == len(rest)
    assert np.all(intervals.start >= rest[:, 0] - 1e-9)
    assert np.all(intervals.stop <= rest[:, 1] + 1e-9)
    lost = intervals.start[1:] - rest[1:, 0], rest[:-1, 1] - intervals.stop[:-1]
    assert np.max(lost) < 1.1 * window_s + 0.02


@pytest.mark.parametrize("method", ["moving deviation", "glrt", "angular rate energy"])
def test_poses_are_detected_and_turns_are_not(method, rng):
    imu, rest = poses(rng)
    intervals = static_intervals(imu, method=method, window_s=0.5, gravity=G)
    check(intervals, rest, 0.5)
    assert intervals.start[0] == imu.t[0]  # nothing is cut at the ends of the log
    assert intervals.stop[-1] == imu.t[-1]
    assert intervals.mask.sum() == np.diff(intervals.index, axis=1).sum()
    np.testing.assert_allclose(intervals.duration, intervals.stop - intervals.start)
    assert intervals.summary().startswith("8 intervals at rest")


@pytest.mark.parametrize("rate_hz", [10.0, 50.0, 800.0])
def test_poses_are_detected_at_any_rate(rate_hz, rng):
    imu, rest = poses(rng, count=5, rate_hz=rate_hz)
    check(static_intervals(imu, window_s=1.0), rest, 1.0)


def test_means_of_the_intervals_are_gravity_and_bias(rng):
    imu, _ = poses(rng, rest_s=10.0)
    intervals = static_intervals(imu)
    omega, f = intervals.means(imu)
    # statistical: 3.5 sigma of the mean of about 800 samples, 48 of them
    np.testing.assert_allclose(np.linalg.norm(f, axis=1), G, atol=4.0 * 0.02 / np.sqrt(800))
    np.testing.assert_allclose(omega, np.tile((0.01, -0.02, 0.005), (8, 1)), atol=4.0 * 0.003 / np.sqrt(800))
    np.testing.assert_allclose(intervals.gyro_bias, (0.01, -0.02, 0.005), atol=2e-3)  # statistical: one window
    with pytest.raises(InputError, match="expected the log of"):
        intervals.means(imu.between(0.0, 5.0))


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_uniform_rotation_is_not_rest(axis, rng):
    """A rate table that turns at 10 deg/s all the time, then rests; the printed detector alone sees no difference."""
    imu, _ = poses(rng, count=1, rest_s=40.0)
    turning = imu.t < 20.0
    rate = np.where(turning, 0.17, 0.0)
    angle = np.cumsum(rate) * 0.01
    f = np.zeros((len(imu), 3))
    a, b = (axis + 1) % 3, (axis + 2) % 3
    if axis == 2:
        f[:, 2] = -G
    else:
        f[:, a], f[:, b] = G * np.sin(angle), G * np.cos(angle)
    gyro = imu.gyro.copy()
    gyro[:, axis] += rate
    log = ImuSeries(imu.t, gyro, imu.accel - (0.0, 0.0, -G) + f)
    for method in ("moving deviation", "printed", "glrt", "acceleration variance"):
        intervals = static_intervals(log, method=method, gravity=G)
        assert len(intervals) == 1
        assert intervals.start[0] > 20.0
    # turning all the time: too fast for a bias, and then nothing rests
    complete = log.between(0.0, 19.0)
    intervals = static_intervals(complete)
    assert len(intervals) == 0
    assert "no interval at rest" in intervals.summary()
    assert any("too fast for a gyro bias" in note for note in intervals.notes)


def test_one_bad_sample_does_not_cut_an_interval_but_a_new_pose_does(rng):
    imu, rest = poses(rng, count=2, rest_s=20.0)
    accel = imu.accel.copy()
    accel[1000] += 5.0
    intervals = static_intervals(ImuSeries(imu.t, imu.gyro, accel))
    check(intervals, rest, 1.0)
    # tilted within one sample by 2 deg: a break no longer than that of a bad sample
    still, _ = poses(rng, count=1, rest_s=20.0)
    jump = np.where(still.t[:, None] > 10.0, (G * np.sin(0.035), 0.0, 0.0), 0.0)
    intervals = static_intervals(ImuSeries(still.t, still.gyro, still.accel + jump))
    assert len(intervals) == 2
    assert intervals.stop[0] < 10.0 < intervals.start[1]


def test_intervals_end_at_gaps(rng):
    imu, _ = poses(rng, count=1, rest_s=20.0)
    keep = (imu.t < 8.0) | (imu.t > 13.0)
    intervals = static_intervals(ImuSeries(imu.t[keep], imu.gyro[keep], imu.accel[keep]))
    assert len(intervals) == 2
    assert intervals.stop[0] < 8.0
    assert intervals.start[1] > 13.0


def test_short_intervals_are_left_out(rng):
    imu, _ = poses(rng, count=4, rest_s=4.0)
    assert len(static_intervals(imu, min_s=1.0)) == 4
    assert len(static_intervals(imu, min_s=3.5)) == 0  # trimmed by half a window on top of the motion's windows


def test_limits_in_units_of_the_sensor(rng):
    """Yaman's way: standard deviations allowed at rest; the statistic is then relative to them."""
    imu, rest = poses(rng)
    intervals = static_intervals(imu, thresholds=(0.05, 0.01))
    check(intervals, rest, 1.0)
    assert intervals.threshold == 1.0
    assert len(static_intervals(imu, thresholds=(0.005, 0.01))) == 0
    with pytest.raises(InputError, match="two limits are for 'moving deviation' and 'printed'"):
        static_intervals(imu, method="glrt", thresholds=(0.05, 0.01))


def test_detection_and_false_alarm_by_monte_carlo():
    """20 logs of 6 poses: every turn of 4 deg is seen, nearly all time at rest is kept."""
    rng = np.random.default_rng(5)
    kept = total = joined = 0
    for _ in range(20):
        imu, rest = poses(rng, count=6, rest_s=5.0, turn_s=0.5, angle=0.07)
        intervals = static_intervals(imu, window_s=0.5)
        kept += intervals.mask.sum()
        total += len(imu)
        joined += len(intervals) != len(rest)
    assert joined == 0
    # at most two half windows and the trimming of 0.25 s at each of ten ends: 6 * 5 - 10 * 0.5 of 32.5 s; the false
    # alarm rate of 1e-3 per window with margin 3 takes nothing that would show
    assert kept / total > (30.0 - 5.5) / 32.5


def test_without_margin_the_share_of_rest_lost_is_the_false_alarm_rate():
    rng = np.random.default_rng(9)
    n = 400_000
    imu = ImuSeries(np.arange(n) / 100.0, 0.003 * rng.standard_normal((n, 3)), 0.02 * rng.standard_normal((n, 3)) + G)
    intervals = static_intervals(imu, margin=1.0, noise=(0.02, 0.003), false_alarm=0.01)
    share = np.mean(intervals.statistic >= intervals.threshold)
    # statistical: 4000 windows that are independent, 3.5 standard errors; overlap makes them a little wider
    assert abs(share - 0.01) < 3.5 * np.sqrt(0.01 / 4000) * 1.5


@pytest.mark.parametrize(
    ("options", "match"),
    [
        ({"min_s": 0.0}, "min_s: expected a positive time"),
        ({"margin": 0.5}, "margin: expected 1 or more"),
        ({"method": "shoe"}, "kind: expected one of"),
        ({"thresholds": -1.0}, "thresholds: expected a positive number"),
        ({"window_s": 5.0}, "windows of 5.0 s; expected at least 10"),
    ],
)
def test_wrong_arguments_are_named(options, match, rng):
    imu, _ = poses(rng, count=1, rest_s=20.0)
    with pytest.raises(InputError, match=match):
        static_intervals(imu, **options)


def xsens(shared_data):
    folder = shared_data / "imu_tk_xsens"
    accel, gyro = np.loadtxt(folder / "xsens_acc.mat"), np.loadtxt(folder / "xsens_gyro.mat")
    return ImuSeries(accel[:, 0], (gyro[:, 1:] - 32768.0) / 4778.0, (accel[:, 1:] - (33124, 33275, 32364)) / 414.0)


@pytest.mark.realdata
@pytest.mark.parametrize("margin", [1.0, 3.0, 10.0])
def test_poses_of_the_xsens_log(shared_data, margin):
    """imu_tk finds 42 to 38 with its multipliers 2 to 10 of the variance."""
    imu = xsens(shared_data)
    intervals = static_intervals(imu, margin=margin)
    assert 37 <= len(intervals) <= 42
    assert intervals.stop[0] > 48.0  # the first 50 s are one
    _, f = intervals.means(imu)
    norm = np.linalg.norm(f, axis=1)  # uncalibrated axes, biases to 0.02 m/s^2
    assert np.all(np.abs(norm - 9.81744) < 0.15)


@pytest.mark.realdata
def test_hand_held_poses(shared_data):
    """good1 has too few for a calibration (nine parameters), good3 about the 14 that imu_tk finds."""
    counts = {}
    for name in ("imu_good1", "imu_good2", "imu_good3"):
        log = np.loadtxt(shared_data / "snu_staticposes" / f"{name}.txt")
        imu = ImuSeries(log[:, 0] - log[0, 0], log[:, 4:7], log[:, 1:4])
        counts[name] = len(static_intervals(imu, window_s=0.5, margin=10.0))
    assert counts["imu_good1"] <= 9
    assert 10 <= counts["imu_good2"] <= 13
    assert 13 <= counts["imu_good3"] <= 15


@pytest.mark.realdata
def test_stances_of_foot_mounted_walks_against_motion_capture(shared_data):
    paths = sorted((shared_data / "pyshoe_vicon").glob("*.mat"))
    assert len(paths) == 8
    for path in paths:
        log = scipy.io.loadmat(path)
        t = log["ts"].ravel()
        imu = ImuSeries(t - t[0], log["imu"][:, 3:], log["imu"][:, :3])
        speed = np.linalg.norm(np.gradient(log["gt"], t, axis=0), axis=1)
        intervals = static_intervals(
            imu, method="glrt", window_s=0.025, min_s=0.1, thresholds=3e4, noise=(0.01, 0.1 * np.pi / 180.0),
            max_rate=1.5, gyro_bias=(0.0, 0.0, 0.0),
        )  # fmt: skip
        assert len(intervals) >= 10
        assert 0.1 < intervals.mask.mean() < 0.6
        assert np.median(speed[intervals.mask]) < 0.03  # m/s, by motion capture; walking goes to 5 m/s at the foot
        assert np.median(speed[~intervals.mask]) > 0.3
