"""Warm-up and temperature trends: found where they are, not where noise of any colour only looks like one."""

import numpy as np
import pytest
from scipy.stats import binom

from schuler.characterisation import likelihood, trends
from schuler.characterisation.trends import settled_from, temperature_trend, warm_up
from schuler.exceptions import InputError
from schuler.sensors.noise import GaussMarkov, RandomWalk, White, flicker

RATE = 4.0
N = 12_000  # 50 min
T = np.arange(N) / RATE
NOISE = White(1.0) + flicker(0.02) + RandomWalk(5e-4)


def noise(seed, model=NOISE, n=N):
    return model.sample(n, 1.0 / RATE, np.random.default_rng(seed))


@pytest.mark.parametrize("kind", [0, 1, 2])
def test_covariances_have_the_allan_variance_they_are_said_to_have(kind):
    """From the factors back to the covariance: unit Allan variance at sqrt(J) blocks for one kind of noise alone."""
    J, m = 100, 10
    weights = [(1e3, 1.0, 0.0), (0.0, 1.0, 0.0), (0.0, 1.0, 1e3)][kind]
    whiten, _, proportions = likelihood.whitening_factors(J)
    C = np.linalg.inv(whiten[np.flatnonzero(np.all(proportions == weights, axis=1)).item()])
    C = C @ C.T
    v = np.zeros(J)
    v[40 : 40 + m], v[40 + m : 40 + 2 * m] = -1.0 / m, 1.0 / m
    # discretisation: flicker as a sum of terms; it is a thousandth of the others
    assert 0.5 * v @ C @ v == pytest.approx(sum(weights), rel=1e-4 if kind != 1 else 0.05)


def test_the_noise_found_is_the_noise_put_in():
    """Allan deviation at a minute and at ten, median over 20 logs."""
    for model in (White(1.0), RandomWalk(0.01), White(1.0) + flicker(0.1)):
        estimates = [warm_up(noise(seed, model), RATE).noise for seed in range(20)]
        for tau in (60.0, 600.0):
            ratio = np.median([f.allan_variance(tau) for f in estimates]) / model.allan_variance(tau)
            assert 0.5 < ratio < 2.0  # statistical, and a grid of half decades


@pytest.mark.parametrize("seed", range(3))
def test_an_exponential_is_found_with_its_time_and_size(seed):
    estimates = warm_up(noise(seed) - 1.0 * np.exp(-T / 300.0), RATE, axis="gyro_z")
    assert estimates.kind == "exponential"
    assert (
        abs(estimates.value + 1.0) < 4.0 * estimates.sigma + 0.05
    )  # statistical; sigma is for the settling time as found
    assert 200.0 < estimates.tau_s < 450.0
    assert estimates.p_value < 1e-3
    assert estimates.share > 0.3
    assert estimates.findings[0].code == "trend"
    assert estimates.findings[0].text.startswith("gyro_z: settles by +")
    start = settled_from(estimates)
    assert 300.0 < start < 1800.0
    assert estimates.findings[0].stop_s == pytest.approx(start)
    left = noise(seed) - 1.0 * np.exp(-T / 300.0) - estimates.at(T)
    assert warm_up(left, RATE).kind == "none"


def test_settled_from_follows_the_tolerance():
    estimates = warm_up(noise(5) + 2.0 * np.exp(-T / 200.0), RATE)
    start = settled_from(estimates, 0.02)
    assert abs(estimates.value) * np.exp(-start / estimates.tau_s) == pytest.approx(0.02)  # rounding
    assert settled_from(estimates, 1e-9) == np.inf
    with pytest.raises(InputError, match="tolerance: expected a positive number"):
        settled_from(estimates, 0.0)


@pytest.mark.parametrize("slope", [5e-4, -5e-4])
def test_a_ramp_is_found_with_its_slope(slope):
    slopes, sigmas = [], []
    for seed in range(10):
        estimates = warm_up(noise(seed) + slope * T, RATE)
        assert estimates.kind != "none"
        if estimates.kind == "ramp":  # slow exponentials are as good on some draws
            slopes.append(estimates.value)
            sigmas.append(estimates.sigma)
            assert settled_from(estimates) == np.inf
            np.testing.assert_allclose(estimates.at([0.0, 10.0]), [0.0, 10.0 * estimates.value])
    assert len(slopes) >= 5
    # statistical: 4 standard errors
    assert abs(np.mean(slopes) - slope) < 4.0 * np.std(slopes) / np.sqrt(len(slopes)) + 1e-6
    assert 0.4 < np.mean(sigmas) / np.std(slopes) < 2.5


def test_a_step_response_of_a_random_walk_is_left_alone():
    """K = 0.02: after 50 min the walk is 1.1 off on average, nearly as much as the ramp of the test above."""
    assert warm_up(noise(1, White(1.0) + RandomWalk(0.02)), RATE).kind == "none"


COLOURS = {
    "white": White(1.0),
    "flicker": White(1.0) + flicker(0.5),
    "walk": White(1.0) + RandomWalk(0.05),
    "only walk": RandomWalk(1.0),
    "Gauss-Markov": White(1.0) + GaussMarkov(0.5, 600.0),
    "all": White(1.0) + flicker(0.3) + RandomWalk(0.02) + GaussMarkov(0.5, 200.0),
}


@pytest.mark.campaign
def test_noise_alone_is_seldom_called_a_trend():
    calls = sum(
        warm_up(model.sample(2400, 1.25, np.random.default_rng(seed)), 0.8).kind != "none"
        for model in COLOURS.values()
        for seed in range(30)
    )
    # statistical: beyond this once in a thousand with the stated probability
    assert calls <= binom.isf(1e-3, 30 * len(COLOURS), trends.FALSE_ALARM)


@pytest.mark.slow
@pytest.mark.parametrize("name", COLOURS)
def test_noise_alone_is_seldom_called_a_trend_at_full_size(name):
    calls = sum(warm_up(noise(seed, COLOURS[name]), RATE).kind != "none" for seed in range(400))
    assert calls <= binom.isf(1e-3, 400, trends.FALSE_ALARM)  # statistical


def day(seed):
    """A temperature that wanders by some kelvin."""
    return 25.0 + np.cumsum(np.random.default_rng(1000 + seed).standard_normal(N)) * 0.03


def test_a_temperature_coefficient_is_found_within_its_uncertainty():
    z = []
    for seed in range(12):
        estimates = temperature_trend(noise(seed) + 0.3 * (day(seed) - 25.0), day(seed), RATE)
        assert estimates.kind == "temperature"
        assert estimates.findings[0].code == "temperature"
        assert estimates.share > 0.5
        z.append((estimates.value - 0.3) / estimates.sigma)
    assert np.max(np.abs(z)) < 4.5  # statistical, with a noise that is itself estimated
    assert 0.4 < np.std(z) < 2.0
    np.testing.assert_allclose(estimates.at(estimates.reference + 2.0), 2.0 * estimates.value)


@pytest.mark.campaign
def test_two_walks_are_no_cause_and_effect():
    """Ordinary least squares finds a relation in nearly every pair of random walks (spurious regression)."""
    calls = naive = 0
    for seed in range(60):
        x = noise(seed, White(1.0) + RandomWalk(0.05))
        calls += temperature_trend(x, day(seed), RATE).kind != "none"
        y, d = x[::100], day(seed)[::100] - day(seed).mean()
        slope = d @ y / (d @ d)
        naive += abs(slope) > 2.58 * np.std(y - slope * d) / np.sqrt(d @ d)
    assert naive > 20  # of 60, where 1 % is promised
    assert calls <= binom.isf(1e-3, 60, trends.FALSE_ALARM)  # statistical


def test_missing_samples_do_not_matter():
    x, temperature = noise(3) - 1.0 * np.exp(-T / 300.0), day(3)
    holes = x.copy()
    holes[np.random.default_rng(0).random(N) < 0.1] = np.nan
    assert warm_up(holes, RATE).value == pytest.approx(warm_up(x, RATE).value, rel=0.1)  # statistical
    whole, part = temperature_trend(x, temperature, RATE), temperature_trend(holes, temperature, RATE)
    assert part.value == pytest.approx(whole.value, abs=whole.sigma)


def test_units_scale():
    x = noise(4) - 1.0 * np.exp(-T / 300.0)
    a, b = warm_up(x, RATE), warm_up(3e-6 * x + 9.8, RATE)
    assert b.value == pytest.approx(3e-6 * a.value, rel=1e-6)  # rounding of 9.8
    assert b.sigma == pytest.approx(3e-6 * a.sigma, rel=1e-6)
    assert b.tau_s == a.tau_s


@pytest.mark.parametrize(
    ("call", "match"),
    [
        (lambda: warm_up(np.zeros(100), 1.0), "expected one axis with at least 200 samples"),
        (lambda: warm_up(np.zeros(1000), 1.0), "expected noise, but every sample reads 0"),
        (lambda: warm_up(noise(0), 0.0), "rate_hz: expected a positive number"),
        (lambda: temperature_trend(noise(0), np.zeros(5), RATE), "expected 12000 finite numbers"),
        (lambda: temperature_trend(noise(0), np.full(N, 20.0), RATE), "it is 20 degC all the time"),
        (lambda: warm_up(np.where(T < 2000.0, noise(0), np.nan), RATE), "all are missing from 2000.0 s on"),
    ],
)
def test_wrong_arguments_are_named(call, match):
    with pytest.raises(InputError, match=match):
        call()


@pytest.mark.realdata
def test_adis16405_is_warm_when_its_log_begins(shared_data):
    archive = np.load(shared_data / "adis16405_static" / "adis16405_imu1.npz")
    x = archive["counts"] * archive["lsb"]
    assert [warm_up(axis, 100.0).kind for axis in x.T] == ["none"] * 6


@pytest.mark.realdata
def test_thermal_chamber(shared_data):
    """Gyro y follows the temperature with 5.9e-4 rad/s/K (line through all samples), gyro x and z hardly in a line."""
    log = np.genfromtxt(shared_data / "imu_thermal" / "imu_raw_data.csv", delimiter="\t", skip_header=1)
    estimates = temperature_trend(log[:, 2], log[:, 8], 1.0)  # the rate is not known
    assert estimates.kind == "temperature"
    assert estimates.value == pytest.approx(
        np.polyfit(log[:, 8], log[:, 2], 1)[0], rel=0.15
    )  # curvature and hysteresis
    assert estimates.share > 0.8
    assert temperature_trend(log[:, 1], log[:, 8], 1.0).kind == "none"
