"""Test statistics of standing still: closed forms, their distribution at rest, what each sees and does not see."""

import numpy as np
import pytest
import scipy.io

from schuler.exceptions import InputError
from schuler.recording.series import ImuSeries
from schuler.standstill import detectors, thresholds

G = 9.81
SIGMA_F, SIGMA_W = 0.02, 0.003


def at_rest(n, rng, rate_hz=100.0, sigma_f=SIGMA_F, sigma_w=SIGMA_W, f=(0.0, 0.0, -G)):
    t = np.arange(n) / rate_hz
    gyro, accel = sigma_w * rng.standard_normal((n, 3)), np.asarray(f) + sigma_f * rng.standard_normal((n, 3))
    return ImuSeries(t, gyro, accel)


def evaluate(imu, kind, window_s=0.25, **options):
    return detectors.statistic(imu, kind, window_s, sigma_f=SIGMA_F, sigma_w=SIGMA_W, gravity=G, **options)


@pytest.mark.parametrize("window", [1, 2, 5, 8, 199, 200])
def test_moments_are_those_of_each_window(rng, window):
    x = rng.standard_normal((200, 2)) * (1.0, 1e-3) + (0.0, 50.0)
    mean, variance = detectors.moving_moments(x, window)
    for k in range(200):
        first = min(max(k - (window - 1) // 2, 0), 200 - window)
        part = x[first : first + window]
        np.testing.assert_allclose(mean[k], part.mean(axis=0), rtol=1e-13, atol=1e-14)  # rounding
        np.testing.assert_allclose(variance[k], part.var(axis=0), rtol=1e-9, atol=1e-20)  # rounding


def test_moments_lose_no_digits_in_a_long_log_that_turns_over(rng):
    """Noise of 1 um/s^2 on gravity that changes its sign: a plain cumulative sum of squares has no digit left."""
    n, window = 200_000, 50
    x = np.where(np.arange(n) < n // 2, G, -G) + 1e-6 * rng.standard_normal(n)
    _, variance = detectors.moving_moments(x, window)
    for k in (1000, n // 2 + 1000, n - 1000):
        part = x[k - 24 : k + 26]
        assert variance[k] == pytest.approx(np.var(part - part.mean()), rel=1e-7)  # rounding of x itself: 2e-15 / 1e-6


@pytest.mark.parametrize("window", [1, 7, 8, 60, 199])
def test_a_log_in_parts_has_the_moments_of_the_whole(rng, monkeypatch, window):
    """Windows that reach over from one part into the next included, to the bit."""
    x = rng.standard_normal((200, 3)) + G
    whole = detectors.moving_moments(x, window)
    monkeypatch.setattr(detectors, "_PART", 16)
    for once, parts in zip(whole, detectors.moving_moments(x, window), strict=True):
        np.testing.assert_array_equal(parts, once)


def test_the_statistic_of_a_long_log_takes_memory_of_few_of_its_columns(rng, monkeypatch):
    """A day at 200 Hz: 140 MB a column. The statistic is one, the mean rate another; all windows at once took 50."""
    import tracemalloc

    imu = at_rest(200_000, rng)
    monkeypatch.setattr(detectors, "_PART", 1 << 12)
    tracemalloc.start()
    evaluate(imu, "moving deviation", 1.0)
    peak = tracemalloc.get_traced_memory()[1] / (8 * len(imu))
    tracemalloc.stop()
    assert peak < 5.0


def test_a_window_must_fit():
    with pytest.raises(InputError, match="expected 1 to 10 samples, the length of the log, got 11"):
        detectors.moving_moments(np.zeros(10), 11)


def direct(imu, kind, window):
    """The definitions, window by window."""
    out = []
    for k in range(len(imu) - window + 1):
        f, w = imu.accel[k : k + window], imu.gyro[k : k + window]
        m = f.mean(axis=0)
        terms = {
            "glrt": np.sum((f - G * m / np.linalg.norm(m)) ** 2) / SIGMA_F**2 + np.sum(w**2) / SIGMA_W**2,
            "acceleration variance": np.sum((f - m) ** 2) / SIGMA_F**2,
            "acceleration magnitude": np.sum((np.linalg.norm(f, axis=1) - G) ** 2) / SIGMA_F**2,
            "angular rate energy": np.sum(w**2) / SIGMA_W**2,
            "moving deviation": window
            * max(
                f.var(axis=0).max() / SIGMA_F**2,
                w.var(axis=0).max() / SIGMA_W**2,
                (np.linalg.norm(w.mean(axis=0)) / detectors.MAX_RATE) ** 2,
            ),
            "printed": window
            * max(
                np.linalg.norm(f, axis=1).var() / SIGMA_F**2,
                np.linalg.norm(w, axis=1).var() / SIGMA_W**2,
            ),
        }
        out.append(terms[kind] / window)
    return np.array(out)


@pytest.mark.parametrize("kind", detectors.KINDS)
@pytest.mark.parametrize("rate_hz", [4.0, 100.0, 2000.0])
def test_statistics_are_their_definitions_at_any_rate(kind, rate_hz, rng):
    imu = at_rest(120, rng, rate_hz)
    window = 9
    value = evaluate(imu, kind, window / rate_hz)
    expected = direct(imu, kind, window)
    np.testing.assert_allclose(value[4:-4], expected, rtol=1e-9)  # rounding
    assert np.all(value[:4] == value[4])
    assert np.all(value[-4:] == value[-5])


def test_mean_rate_and_deviation_of_one_pass_are_those_of_two(rng):
    imu, bias, limit = at_rest(700, rng), np.array([0.01, -0.02, 0.005]), 0.03
    value, rate = detectors.moving_deviation(imu, 25, np.full(3, SIGMA_F), np.full(3, SIGMA_W), bias, limit)
    np.testing.assert_array_equal(value, evaluate(imu, "moving deviation", gyro_bias=bias, max_rate=limit))
    np.testing.assert_allclose(rate, detectors.mean_rate(imu, 0.25, bias), rtol=1e-12)  # rounding
    assert np.all(value >= (rate / limit) ** 2)


def test_increments_give_the_same_as_rates(rng):
    imu = at_rest(500, rng)
    increments = ImuSeries(imu.t, imu.gyro * 0.01, imu.accel * 0.01, kind="increment")
    np.testing.assert_allclose(evaluate(increments, "glrt"), evaluate(imu, "glrt"), rtol=1e-6)  # rounding of times


@pytest.mark.thinned(2)
@pytest.mark.parametrize("kind", [k for k in detectors.KINDS if k != "printed"])
@pytest.mark.parametrize("window", [10, 100])
def test_a_window_at_rest_exceeds_the_threshold_as_often_as_stated(kind, window):
    rng = np.random.default_rng(7)
    windows, p = 4000, 0.02
    imu = at_rest(windows * window, rng)
    value = evaluate(imu, kind, window / 100.0)[(window - 1) // 2 :: window][:windows]
    alarms = np.count_nonzero(value > thresholds.threshold(kind, window, p))
    # statistical: independent windows, 3.5 standard errors of a binomial count; the norm's curvature is below 1e-3
    assert abs(alarms - windows * p) < 3.5 * np.sqrt(windows * p * (1.0 - p))


def test_the_printed_deviation_has_at_most_the_stated_rate(rng):
    imu = at_rest(400_000, rng)
    value = evaluate(imu, "printed", 1.0)[49::100]
    assert np.mean(value > thresholds.threshold("printed", 100, 0.02)) < 0.02 + 3.5 * np.sqrt(
        0.02 / 4000
    )  # statistical


def test_noise_at_rest_is_estimated_in_a_log_that_mostly_moves():
    rng = np.random.default_rng(3)
    imu = at_rest(60_000, rng)
    moving = np.arange(60_000) % 6000 > 1800  # 30 % at rest
    shake = rng.standard_normal((60_000, 3)) * moving[:, None]
    imu = ImuSeries(imu.t, imu.gyro + 0.3 * shake, imu.accel + 2.0 * shake)
    sigma_f, sigma_w = thresholds.noise_at_rest(imu, 1.0)
    np.testing.assert_allclose(sigma_f, SIGMA_F, rtol=0.04)  # statistical: a quantile of 180 windows of 100 samples
    np.testing.assert_allclose(sigma_w, SIGMA_W, rtol=0.04)
    all_rest = at_rest(60_000, rng)
    sigma_f, _ = thresholds.noise_at_rest(all_rest, 1.0)
    np.testing.assert_allclose(sigma_f, SIGMA_F, rtol=0.03)  # statistical; without the correction it is 12 % low


def test_noise_at_rest_is_not_below_rounding(rng):
    imu = at_rest(5000, rng, sigma_f=0.001)
    imu = ImuSeries(imu.t, imu.gyro, np.round(imu.accel / 0.03) * 0.03 + 0.03 * (rng.random((5000, 3)) < 1e-3))
    sigma_f, _ = thresholds.noise_at_rest(imu, 1.0)
    np.testing.assert_allclose(sigma_f, 0.03 / np.sqrt(12.0), rtol=1e-9)  # rounding


def test_a_threshold_from_the_log_survives_an_uncalibrated_accelerometer(rng):
    """A bias of 10 sigma adds 100 to the magnitude statistic: the theoretical threshold finds nothing at rest."""
    imu = at_rest(50_000, rng, f=(0.0, 0.0, -G - 0.2))
    value = evaluate(imu, "acceleration magnitude", 1.0)
    assert np.all(value > thresholds.threshold("acceleration magnitude", 100))
    own = thresholds.threshold_from_rest(value, "acceleration magnitude", 100)
    assert np.all(value < own)
    assert own < 200.0


def turning(axis, rate, rng, seconds=10.0):
    """Uniform rotation about a horizontal or the vertical axis."""
    imu = at_rest(int(100 * seconds), rng)
    angle = rate * imu.t
    f = np.zeros_like(imu.accel)
    if axis == "vertical":
        f[:, 2], omega = -G, (0.0, 0.0, rate)
    else:
        f[:, 1], f[:, 2], omega = -G * np.sin(angle), -G * np.cos(angle), (rate, 0.0, 0.0)
    return ImuSeries(imu.t, imu.gyro + omega, imu.accel - (0.0, 0.0, -G) + f)


@pytest.mark.parametrize("axis", ["vertical", "horizontal"])
def test_uniform_rotation_is_motion_but_not_as_printed(axis, rng):
    imu = turning(axis, 0.5, rng)
    assert np.all(evaluate(imu, "moving deviation", 1.0) > 100.0)
    assert np.all(evaluate(imu, "printed", 1.0) < thresholds.threshold("printed", 100, 1e-6))
    assert np.all(evaluate(imu, "glrt", 1.0) > 100.0)
    assert np.all(evaluate(imu, "angular rate energy", 1.0) > 100.0)
    sees = np.all(evaluate(imu, "acceleration variance", 1.0) > 10.0)
    assert sees == (axis == "horizontal")
    assert np.all(evaluate(imu, "acceleration magnitude", 1.0) < 3.0)


def test_a_sensor_that_feels_nothing_is_off_by_gravity():
    """Closed form: no scatter, no rate, and a mean that misses the norm of gravity by all of it. No warning."""
    imu = ImuSeries(np.arange(100) / 100.0, np.zeros((100, 3)), np.zeros((100, 3)))
    np.testing.assert_allclose(evaluate(imu, "glrt"), (G / SIGMA_F) ** 2, rtol=1e-12)  # rounding


def test_a_given_gyro_bias_is_not_motion(rng):
    imu = at_rest(2000, rng)
    biased = ImuSeries(imu.t, imu.gyro + np.array((0.05, -0.02, 0.01)), imu.accel)
    assert evaluate(biased, "moving deviation").min() > 5.0
    np.testing.assert_allclose(
        evaluate(biased, "glrt", gyro_bias=(0.05, -0.02, 0.01)), evaluate(imu, "glrt"), rtol=1e-9
    )  # rounding


def test_detection_rate_of_a_weak_shake_follows_the_noncentral_distribution():
    """Rate energy of a constant rate c: W times the statistic is noncentral chi-square with W c^2 / sigma^2."""
    from scipy.stats import ncx2

    rng, window, windows = np.random.default_rng(11), 20, 4000
    imu = at_rest(window * windows, rng)
    c = 0.35 * SIGMA_W
    value = evaluate(
        ImuSeries(imu.t, imu.gyro + np.array((c, 0.0, 0.0)), imu.accel), "angular rate energy", window / 100.0
    )
    limit = thresholds.threshold("angular rate energy", window, 0.05)
    p = ncx2.sf(window * limit, 3 * window, window * (c / SIGMA_W) ** 2)
    seen = np.count_nonzero(value[(window - 1) // 2 :: window][:windows] > limit)
    assert abs(seen - p * windows) < 3.5 * np.sqrt(windows * p * (1.0 - p))  # statistical


@pytest.mark.parametrize(
    ("change", "match"),
    [
        ({"kind": "shoe"}, "kind: expected one of moving deviation"),
        ({"sigma_f": 0.0}, "sigma_f: expected one positive number or three"),
        ({"sigma_w": (1.0, 2.0)}, "sigma_w: expected one positive number or three"),
        ({"window_s": 100.0}, "the log has only 1000"),
        ({"window_s": -1.0}, "window_s: expected a positive time"),
        ({"max_rate": 0.0}, "max_rate: expected a positive number"),
    ],
)
def test_wrong_arguments_are_named(change, match, rng):
    options = {"kind": "moving deviation", "window_s": 0.25, "sigma_f": 0.02, "sigma_w": 0.003} | change
    with pytest.raises(InputError, match=match):
        detectors.statistic(at_rest(1000, rng), **options)


def test_a_dead_axis_has_no_noise(rng):
    imu = at_rest(5000, rng)
    dead = ImuSeries(imu.t, imu.gyro * (1.0, 0.0, 1.0), imu.accel)
    with pytest.raises(InputError, match="gyro_y: expected noise, but the axis always reads 0"):
        thresholds.noise_at_rest(dead, 1.0)


@pytest.mark.realdata
def test_glrt_agrees_with_the_labels_published_for_foot_mounted_walks(shared_data):
    """Their threshold differs by a constant factor of normalisation; labels agree up to the edges of stances."""
    factors = []
    for path in sorted((shared_data / "pyshoe_vicon").glob("*.mat")):
        log = scipy.io.loadmat(path)
        t = log["ts"].ravel()
        imu = ImuSeries(t - t[0], log["imu"][:, 3:], log["imu"][:, :3])
        labels = log["zv_shoe_opt"].ravel().astype(bool)
        value = detectors.statistic(imu, "glrt", 0.025, sigma_f=0.01, sigma_w=0.1 * np.pi / 180.0)
        limits = np.geomspace(3e3, 1e5, 100)
        agreement = [np.mean((value < limit) == labels) for limit in limits]
        assert max(agreement) > 0.98  # measured: 0.984 to 0.993
        factors.append(float(log["G_shoe_opt"].item()) / limits[int(np.argmax(agreement))])
    assert len(factors) == 8
    assert (
        np.ptp(factors) / np.mean(factors) < 0.15
    )  # the grid of limits, and how flat the agreement is around its best


def test_moving_variance_is_that_of_each_window(rng):
    """Far from zero, too: rounding of sums that start anew every window."""
    from schuler.standstill import _kernels

    W, sigma2 = 8, np.array([1.0, 4.0, 9.0])
    x, out = 1e3 + rng.standard_normal((100, 3)), np.zeros((100, 3))
    _kernels.moving_variance(x, W, sigma2, out)
    windows = np.lib.stride_tricks.sliding_window_view(x, W, axis=0)
    np.testing.assert_allclose(out[W // 2 : W // 2 + len(windows)], windows.var(axis=-1) / (3.0 * sigma2), rtol=1e-9)
