"""The manual route on synthetic logs of the thesis's sensors, and what the length of a record does to its numbers."""

import numpy as np
import pytest

from schuler import units as u
from schuler.characterisation.correlation import finite_record
from schuler.characterisation.manual import allan_valley, identify_manually
from schuler.exceptions import InputError
from schuler.sensors import GaussMarkov, White

AQRS = (0.0237 * u.DEG, 0.054 * u.DEG, 1171.0)  # N, sigma_b, tau
RECORD = 3 * 3600.0


@pytest.mark.parametrize(
    ("N", "sigma_b", "tau", "at", "digits"),
    [
        (0.0237, 0.054, 1171.0, 18.6, 0.05),
        (0.021, 0.054, 1171.0, 16.5, 0.05),
        (0.025, 0.05, 1000.0, 19.7, 0.05),
        (9.5e-6, 8.5e-5, 700.0, 3.6, 0.05),
    ],
)
def test_the_minima_of_the_thesis_sensors(N, sigma_b, tau, at, digits):
    """Digest 6.1; printed digits. The closed form sqrt(3) N / K holds to the order of its time over tau."""
    valley, _ = allan_valley(N, sigma_b, tau)
    assert valley == pytest.approx(at, abs=digits)
    assert valley == pytest.approx(np.sqrt(3.0) * N / (sigma_b * np.sqrt(2.0 / tau)), rel=2.0 * valley / tau)


def test_the_depth_of_the_minima():
    assert allan_valley(0.0237, 0.054, 1171.0)[1] == pytest.approx(0.0078, abs=5e-5)  # printed digits
    assert allan_valley(9.5e-6, 8.5e-5, 700.0)[1] == pytest.approx(7.1e-6, abs=5e-8)


def test_a_curve_without_a_minimum():
    with pytest.raises(InputError, match=r"covers the bias of 1 with tau = 1 s: no minimum"):
        allan_valley(100.0, 1.0, 1.0)


def test_the_formulas_of_the_thesis():
    """4.3: standard error of the mean 0.0237 deg/s = 85 deg/h, for 3 h of the AQRS; printed digits."""
    r = finite_record(RECORD, 1171.0)
    assert 0.054 * r.mean_sigma == pytest.approx(0.0237, abs=5e-5)
    assert 0.054 * 3600.0 * r.mean_sigma == pytest.approx(85.0, abs=0.5)
    z = RECORD / 1171.0
    assert r.variance_ratio == pytest.approx(1 - 2 / z * (1 - (1 - np.exp(-z)) / z), rel=1e-12)  # rounding


@pytest.mark.parametrize("z", [9.9e-4, 1.01e-3, 1e-6])
def test_short_records_keep_their_digits(z):
    """Variance z/3 of sigma^2 (a random walk about its own mean): next term of the series -z^2/12, rounding 1e-16/z."""
    assert finite_record(z, 1.0).variance_ratio == pytest.approx(z / 3.0, rel=z / 3.0 + 1e-9)


@pytest.mark.parametrize("column", [0, 1, 2])
def test_percentiles_are_continued_beyond_the_simulated_ones(column):
    z = np.geomspace(1e-3, 1e5, 400)
    tau = np.array([finite_record(v, 1.0).tau_ratio[column] for v in z])
    sigma = np.array([finite_record(v, 1.0).sigma_ratio[column] for v in z])
    assert np.abs(np.diff(np.log(tau))).max() < 0.05  # no steps
    assert np.abs(np.diff(np.log(sigma))).max() < 0.05
    assert tau[-1] == pytest.approx(1.0, abs=0.02)
    assert sigma[-1] == pytest.approx(1.0, abs=0.01)


@pytest.mark.campaign
@pytest.mark.thinned(4)
@pytest.mark.parametrize(("z", "runs"), [(0.6, 1500), (9.22, 1500), (40.0, 1000), (150.0, 600)])
def test_percentiles_hold_for_simulated_records(z, runs):
    """Shares below the 5, 50 and 95 % points.

    Binomial: 3.5 standard errors, the table's own included, and 1 % for curvature between its points.
    """
    rng = np.random.default_rng(round(100 * z))
    n = 3000
    x = GaussMarkov(1.0, 1.0).sample((n, runs), z / n, rng)
    x -= x.mean(axis=0)
    spectrum = np.abs(np.fft.rfft(x, 2 * n, axis=0)) ** 2
    R = np.fft.irfft(spectrum, axis=0)[:n]
    tau = np.argmax(R / R[0] <= np.exp(-1.0), axis=0) * z / n
    expected = finite_record(z, 1.0)
    for valley, points in ((tau, expected.tau_ratio), (x.std(axis=0), expected.sigma_ratio)):
        for share, point in zip((0.05, 0.5, 0.95), points, strict=True):
            se = np.sqrt(share * (1 - share) * (1 / runs + 1 / 6000))
            assert np.mean(valley < point) == pytest.approx(share, abs=3.5 * se + 0.01), (share, point)


@pytest.fixture(scope="module", params=[100, pytest.param(300, marks=pytest.mark.campaign)])
def campaign(request):
    """Records of 3 h of the AQRS, at 1 Hz to be quick."""
    rng = np.random.default_rng(20051216)
    model = White(AQRS[0]) + GaussMarkov(*AQRS[1:])
    return [identify_manually(model.sample(round(RECORD), 1.0, rng), 1.0) for _ in range(request.param)]


@pytest.mark.campaign
@pytest.mark.thinned(3)
@pytest.mark.parametrize(("share", "tau"), [(0.05, 349.0), (0.5, 672.0), (0.95, 1427.0)])
def test_the_correlation_time_scatters_as_in_simulated_records(campaign, share, tau):
    """4.3: median 672 s, 90 % within 349 and 1427 s, from 400 records. Binomial shares, 3 standard errors of both."""
    se = np.sqrt(share * (1 - share) * (1 / len(campaign) + 1 / 400))
    assert np.mean([r.tau.value < tau for r in campaign]) == pytest.approx(share, abs=3 * se)


@pytest.mark.campaign
def test_the_standard_deviation_is_short_as_in_simulated_records(campaign):
    """4.3: 0.87 of the true one in the mean; 3 standard errors of both campaigns and half a printed digit."""
    ratio = np.array([r.sigma_b.value for r in campaign]) / AQRS[1]
    se = ratio.std() * np.sqrt(1 / len(campaign) + 1 / 400)
    assert ratio.mean() == pytest.approx(0.87, abs=3 * se + 0.005)
    for share, value in ((0.05, 0.59), (0.95, 1.22)):
        se = np.sqrt(share * (1 - share) * (1 / len(campaign) + 1 / 400))
        assert np.mean(ratio < value) == pytest.approx(share, abs=3 * se)


def test_white_noise_is_found_with_the_stated_uncertainty(campaign):
    """The bias adds K^2/3 to N^2 at 1 s, 0.2 %; 4 standard errors."""
    N = np.array([r.N.value for r in campaign])
    expected = np.sqrt(AQRS[0] ** 2 + (AQRS[1] * np.sqrt(2 / AQRS[2])) ** 2 / 3)
    assert N.mean() == pytest.approx(expected, abs=4 * N.std() / np.sqrt(len(N)))
    assert campaign[0].N.sigma == pytest.approx(N.std(), rel=4 / np.sqrt(2 * len(N)))


def test_intervals_cover_the_truth(campaign):
    """At least 90 % of the 90 % intervals, less 3 standard errors; the random walk K is known to 20 %, tau to 50 %."""
    least = 0.9 - 3 * np.sqrt(0.09 / len(campaign))
    assert np.mean([r.tau.low < AQRS[2] < r.tau.high for r in campaign]) > least
    assert np.mean([r.sigma_b.low < AQRS[1] < r.sigma_b.high for r in campaign]) > least
    below = np.mean([r.tau_median < AQRS[2] for r in campaign])
    assert below == pytest.approx(0.5, abs=3 * np.sqrt(0.25 / len(campaign)) + 0.06)  # the filter lengthens tau by 5 %
    K = np.array([r.K for r in campaign])
    tau = np.array([r.tau.value for r in campaign])
    assert K.std() / K.mean() < 0.5 * tau.std() / tau.mean()


def test_the_thesis_number_has_no_upper_limit():
    """1171 s from 3 h: nothing longer can be excluded; the record would have to be days."""
    rng = np.random.default_rng(4)
    results = []
    while not results:
        x = (White(AQRS[0]) + GaussMarkov(*AQRS[1:])).sample(round(RECORD), 1.0, rng)
        r = identify_manually(x, 1.0)
        if abs(r.tau.value - 1171.0) < 60.0:
            results.append(r)
    (r,) = results
    assert np.isinf(r.tau.high)
    assert 700.0 < r.tau.low < 900.0
    assert [f.code for f in r.findings] == ["too_short"]
    assert "too short to bound it from above" in r.summary()


def test_a_long_record_pins_the_correlation_time():
    """48 h with tau = 1000 s: 90 % between 778 and 1297 s (digest), a factor of 1.7; here one record's interval."""
    x = (White(1e-4) + GaussMarkov(1e-3, 1000.0)).sample(48 * 3600, 1.0, np.random.default_rng(48))
    r = identify_manually(x, 1.0, unit="m/s^2")
    assert r.tau.low < 1000.0 < r.tau.high
    assert 1.3 < r.tau.high / r.tau.low < 2.5
    assert r.findings == ()
    assert "between" in r.summary()
    assert "m/s^2" in r.summary()


def test_humphrey_accelerometer():
    """9.5e-6 g/sqrt(Hz), 8.5e-5 g, 700 s, here 20 h at 2 Hz: each number within its own interval."""
    N, sigma, tau = 9.5e-6 * u.G0, 8.5e-5 * u.G0, 700.0
    x = 9.8 + (White(N) + GaussMarkov(sigma, tau)).sample(20 * 3600 * 2, 0.5, np.random.default_rng(7))
    r = identify_manually(x, 2.0, unit="m/s^2")
    # at 1 s the bias is not negligible: N^2 + K^2/3, 4 %
    assert r.N.low < np.sqrt(N**2 + (sigma * np.sqrt(2 / tau)) ** 2 / 3) < r.N.high
    assert r.tau.low < tau < r.tau.high
    assert r.sigma_b.low < sigma < r.sigma_b.high
    assert r.mean.value == pytest.approx(9.8, abs=4 * r.mean.sigma)
    assert r.minimum()[0] == pytest.approx(3.6, rel=0.3)


def test_kvh_5000_shows_no_bias():
    """14 h of white noise of 8.5e-4 deg/s/sqrt(Hz): N is found, and what the filter leaves is called by its name."""
    N = 8.5e-4 * u.DEG
    x = White(N).sample(14 * 3600 * 5, 0.2, np.random.default_rng(5000))
    r = identify_manually(x, 5.0)
    assert r.N.value == pytest.approx(N, abs=3 * r.N.sigma)
    assert [f.code for f in r.findings] == ["no_bias"]


def test_a_bias_as_fast_as_the_filter_is_told():
    x = (White(1e-4) + GaussMarkov(1e-2, 10.0)).sample(20000, 1.0, np.random.default_rng(3))
    r = identify_manually(x, 1.0)
    assert [f.code for f in r.findings] == ["filter"]
    assert identify_manually(x, 1.0, cutoff_hz=0.2).findings == ()


@pytest.mark.realdata
def test_adis16405_gyroscopes(shared_data):
    """2.8 h at 100 Hz: the same deviation at 1 s as published beside it, linear in log tau between 0.64 and 1.28 s.

    0.3 % for that line (the accelerometers swing at 1 Hz, no line fits there). Gyroscope x has no bias of two numbers.
    """
    folder = shared_data / "adis16405_static"
    data = np.load(folder / "adis16405_imu1.npz")
    table = np.loadtxt(folder / "imu1_oadev_reference_avar_pkg.csv", delimiter=",")
    for k in range(3):
        r = identify_manually(data["counts"][:, k] * data["lsb"][k], 100.0)
        published = np.exp(np.interp(0.0, np.log(table[:, 0]), np.log(table[:, 1 + 3 * k])))
        assert r.N.value == pytest.approx(published, rel=3e-3)
        assert r.findings, r.summary()  # none of them is taken without a remark
    assert 0.0382 < identify_manually(data["counts"][:, 0] * data["lsb"][0], 100.0).N.value / 1.05 < 0.0414


@pytest.mark.parametrize("zero_phase", [True, False])
@pytest.mark.parametrize("order", [1, 2, 4])
def test_white_noise_through_the_filter(order, zero_phase):
    """Variance 2 N^2 times the filter's noise bandwidth: 2 BT degrees of freedom, 4 standard errors."""
    x = White(1.0).sample(40000, 0.1, np.random.default_rng(order))
    r = identify_manually(x, 10.0, cutoff_hz=0.1, order=order, zero_phase=zero_phase)
    assert r.sigma_b.value == pytest.approx(r.white_left, rel=4 / np.sqrt(4 * 0.1 * 4000))


def test_the_warm_up_is_left_out():
    rng = np.random.default_rng(1)
    x = White(1e-3).sample(20000, 0.1, rng)
    drift = 1.0 * np.exp(-np.arange(20000) * 0.1 / 60.0)
    r = identify_manually(x + drift, 10.0, warmup_s=600.0)
    assert r.duration_s == pytest.approx(1400.0)
    np.testing.assert_allclose(r.mean.value, (x + drift)[6000:].mean(), rtol=1e-12)


def test_rates_that_are_no_whole_number():
    """N at 12 / 12.4 s brought to 1 s; 4 standard errors."""
    r = identify_manually(White(2.0).sample(60000, 1 / 12.4, np.random.default_rng(2)), 12.4)
    assert r.N.value == pytest.approx(2.0, abs=4 * r.N.sigma)


@pytest.mark.parametrize(
    ("x", "rate", "options", "message"),
    [
        (np.ones((2, 3)), 10.0, {}, r"x: expected shape \(n,\), got \(2, 3\)"),
        ([np.nan] * 10, 10.0, {}, "expected finite numbers"),
        (np.ones(10), 0.5, {}, "rate_hz: expected 1 Hz or more"),
        (np.ones(10), -1.0, {}, "rate_hz: expected a positive number"),
        (np.ones(10), 10.0, {"cutoff_hz": -0.1}, "cutoff_hz: expected less than half"),
        (np.ones(10), 10.0, {"cutoff_hz": 5.0}, "cutoff_hz: expected less than half the sampling rate"),
        (np.ones(100), 10.0, {"cutoff_hz": 0.1}, "expected a record of at least 100 s after the warm-up .* got 10 s"),
        (np.ones(90), 10.0, {"cutoff_hz": 4.0}, "expected a record of at least 10 s"),
        (np.ones(100), 10.0, {"warmup_s": -1.0}, "warmup_s: expected seconds, not negative"),
        (np.ones(10000), 10.0, {"order": 0}, "order: expected a whole number"),
        (np.ones(10000), 10.0, {}, "one value throughout; the sensor is stuck"),
    ],
)
def test_what_cannot_be_identified_is_said(x, rate, options, message):
    with pytest.raises(InputError, match=message):
        identify_manually(x, rate, **options)


def test_impossible_times_are_refused():
    with pytest.raises(InputError, match="tau: expected a positive time"):
        finite_record(1.0, 0.0)
