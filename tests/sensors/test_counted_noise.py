"""Counting of pulses, and shot noise: closed forms against simulation and against what is known."""

import numpy as np
import pytest

from schuler.characterisation.variance import allan_variances, integrate_signal
from schuler.exceptions import InputError
from schuler.sensors.noise import Counted, GaussMarkov, NoiseModel, Ramp, RandomWalk, ShotNoise, White

DT = 0.01
M = np.array([1, 2, 3, 5, 8, 13, 26, 41, 106])


def simulated(process, seeds, n=100_000):
    """Allan variances of realisations. Shape (seeds, M)"""
    estimates = []
    for seed in range(seeds):
        x = process.sample(n, DT, np.random.default_rng(seed))
        estimates.append(allan_variances(integrate_signal(x, "rate", DT), "overlapping", M)[0])
    return np.array(estimates)


def assert_alike(process, seeds=8):
    """Statistical: 5 standard errors of the mean of the realisations, and 0.1 % for the tables."""
    estimates = simulated(process, seeds)
    error = estimates.std(axis=0, ddof=1) / np.sqrt(seeds)
    expected = process.discrete_allan_variance(M, DT)
    assert (np.abs(estimates.mean(axis=0) - expected) < 5.0 * error + 1e-3 * expected).all()


@pytest.mark.parametrize("read_rate_hz", [40.0, 75.0, 100.0, 125.0, 200.0])
def test_allan_variance_of_white_noise_counted(read_rate_hz):
    assert_alike(Counted(White(3e-4), NoiseModel(), 5e-3, 0.31, read_rate_hz))


@pytest.mark.parametrize(
    "jitter",
    [
        GaussMarkov(5e-4, 0.02),
        ShotNoise(4e-4, 43.0, 0.05),
        ShotNoise(1.5e-3, 3.0, 0.8, 0.3) + ShotNoise(3.5e-4, 43.0, 0.05),
    ],
    ids=["GM", "vibration", "shots"],
)
def test_allan_variance_of_jitter_counted(jitter):
    assert_alike(Counted(White(2e-4), jitter, 5e-3, 10.03, 125.0))


def test_without_noise_it_is_known_by_hand():
    """Rate of 1/4 pulse a sample: second differences are +1 or -1 in two of four phases. Rounding; 200 harmonics, to
    their remainder 1/(pi^2 200)."""
    process = Counted(NoiseModel(), NoiseModel(), 1.0, 0.25, 1.0)
    assert process.discrete_allan_variance(1, 1.0) == pytest.approx(0.25, abs=2e-3)
    x = process.sample(4000, 1.0, np.random.default_rng(1)) + 0.25
    assert set(np.unique(x)) == {0.0, 1.0}
    assert x.sum() == 1000.0  # counting loses nothing


def test_many_pulses_of_much_noise_are_rounding():
    """Where noise is as large as a pulse, ``3 Q^2 / tau^2`` with ``Q = q / sqrt(12)`` besides it. Closed form."""
    q, N = 1e-3, 1e-2
    process = Counted(White(N), NoiseModel(), q, 0.05, 100.0)
    tau = np.array([1, 4, 10]) * DT
    np.testing.assert_allclose(process.discrete_allan_variance([1, 4, 10], DT), N**2 / tau + q**2 / 4.0 / tau**2)


def test_slow_terms_rule_long_averaging_times():
    """The pulses no longer matter: rounding adds ``q^2 / (4 tau^2)``, 2 % of the random walk, at most three times."""
    process = Counted(White(1e-4) + RandomWalk(1e-4), NoiseModel(), 5e-3, 0.31, 100.0, span=1000.0)
    expected = process.discrete_allan_variance([20000], DT)
    assert expected[0] == pytest.approx(1e-8 * 200.0 / 3.0, rel=0.05)
    np.testing.assert_allclose(process.allan_variance([200.0]), expected, rtol=1e-2)  # same, at another interval


def test_spectrum_holds_the_variance():
    """Discretisation: Allan variance at one sample from the spectrum, to 1 %."""
    process = Counted(White(2e-4), ShotNoise(4e-4, 43.0, 0.05), 5e-3, 10.03, 125.0)
    f = (np.arange(20_000) + 0.5) / 20_000 * 50.0
    variance = 2.0 * np.mean(process.discrete_psd(f, DT) * 2.0 * np.sin(np.pi * f * DT) ** 2) * 50.0
    assert variance == pytest.approx(float(process.discrete_allan_variance(1, DT)), rel=0.01)


def test_shots_have_the_moments_of_the_gaussian_process_and_its_limit():
    """Statistical: 5 standard errors over 400 columns; the limit of many shots to 1e-3 (1/number)."""
    few = ShotNoise(0.5, 3.0, 0.4, 2.0)
    x = few.sample((300, 400), DT, np.random.default_rng(1))
    for lag in (0, 7, 60):
        product = x[lag:] * x[: 300 - lag]
        per_column = product.mean(axis=0)
        assert abs(per_column.mean() - few.autocovariance(lag * DT)) < 5.0 * per_column.std() / 20.0
        assert abs((x[0] * x[lag]).mean() - few.autocovariance(lag * DT)) < 5.0 * (x[0] * x[lag]).std() / 20.0
    np.testing.assert_allclose(
        few.discrete_allan_variance(M, DT), ShotNoise(0.5, 3.0, 0.4).discrete_allan_variance(M, DT)
    )
    many = ShotNoise(0.5, 3.0, 0.4, 1e5)
    k, lag = np.array([[1.0], [4.0]]), np.array([0.02, 0.1, 3.0])
    np.testing.assert_allclose(
        many.log_characteristic(k, lag), ShotNoise(0.5, 3.0, 0.4).log_characteristic(k, lag), rtol=1e-3
    )
    f = np.array([0.3, 3.0, 11.0])
    np.testing.assert_allclose(few.psd(f), few.state_space().psd(f))


def test_characteristic_function_of_shots():
    """Statistical: 5 standard errors over 4000 columns."""
    few = ShotNoise(0.5, 3.0, 0.4, 2.0)
    x = few.sample((14, 4000), DT, np.random.default_rng(2))
    wave = np.cos(5.0 * (x[13] - x[0]))
    assert abs(wave.mean() - np.exp(few.log_characteristic(5.0, 0.13))) < 5.0 * wave.std() / np.sqrt(4000.0)


def test_it_refuses_what_it_cannot_do():
    process = Counted(White(1e-4), NoiseModel(), 5e-3, 0.3, 100.0)
    for wrong in (lambda: process.psd(1.0), process.state_space, lambda: process.sampled(DT)):
        with pytest.raises(InputError, match=r"Counted"):
            wrong()
    with pytest.raises(InputError, match=r"jitter: .*Ramp.*belongs to inner"):
        Counted(White(1e-4), Ramp(1.0), 5e-3, 0.3, 100.0)
    with pytest.raises(InputError, match=r"inner: expected a noise process, NoiseModel\(\) for none"):
        Counted(None, NoiseModel(), 5e-3, 0.3, 100.0)  # type: ignore[arg-type]
    with pytest.raises(InputError, match="quantum"):
        Counted(White(1e-4), NoiseModel(), 0.0, 0.3, 100.0)
    with pytest.raises(InputError, match="mean"):
        Counted(White(1e-4), NoiseModel(), 1.0, np.nan, 100.0)
    with pytest.raises(InputError, match="shots_hz"):
        ShotNoise(1.0, 1.0, 1.0, 0.0)
