"""Autocorrelation: the definition, the bias of a finite record, Bartlett's scatter."""

import numpy as np
import pytest
from scipy.integrate import dblquad

from schuler.characterisation.correlation import (
    autocorrelation,
    expected_autocovariance,
    expected_variance,
    mean_sigma,
)
from schuler.exceptions import InputError
from schuler.sensors.noise import GaussMarkov, White


def test_the_definition():
    """Sums written out; rounding."""
    x = np.random.default_rng(1).standard_normal(300).cumsum()
    r = autocorrelation(x, 4.0, longest_s=20.0)
    y = x - x.mean()
    direct = [np.sum(y[k:] * y[: len(y) - k]) / 300 for k in range(81)]
    np.testing.assert_allclose(r.value, direct, atol=1e-11 * direct[0])
    np.testing.assert_allclose(r.lag, np.arange(81) / 4.0)
    assert r.normalised[0] == 1.0
    assert r.duration_s == 75.0
    assert len(autocorrelation(x, 4.0).lag) == 76


def test_white_noise():
    """Zero beyond lag zero, scatter 1 / sqrt(n); statistical."""
    n = 20_000
    r = autocorrelation(White(1.0).sample(n, 1.0, np.random.default_rng(2)), 1.0, longest_s=200.0)
    np.testing.assert_allclose(r.sigma[1:], 1.0 / np.sqrt(n), rtol=0.05)
    assert r.sigma[0] == pytest.approx(np.sqrt(2.0 / n), rel=0.05)
    assert np.mean(np.abs(r.value[1:]) < 1.96 * r.sigma[1:]) == pytest.approx(0.95, abs=0.05)


def test_sinusoid_correlates_like_a_cosine():
    """Thesis, appendix D; the biased estimator adds the factor 1 - m/n."""
    t = np.arange(10_000) / 100.0
    r = autocorrelation(np.sqrt(2.0) * np.sin(2.0 * np.pi * t), 100.0, longest_s=10.0)
    np.testing.assert_allclose(r.value, np.cos(2.0 * np.pi * r.lag) * (1.0 - r.lag / 100.0), atol=2e-3)


@pytest.mark.parametrize("ratio", [1e-4, 0.3, 3.0, 50.0])
def test_expected_variance_and_mean(ratio):
    """Variance of the mean is the double integral of the autocovariance; quadrature 1e-8."""
    g = GaussMarkov(2.0, 10.0)
    T = ratio * g.tau
    double, _ = dblquad(lambda u, v: g.sigma**2 * np.exp(-(v - u) / g.tau), 0.0, T, 0.0, lambda v: v)
    assert mean_sigma(g, T) ** 2 == pytest.approx(2.0 * double / T**2, rel=1e-7)
    assert expected_variance(g, T) + mean_sigma(g, T) ** 2 == pytest.approx(g.sigma**2, rel=1e-12)
    if ratio < 1e-3:
        assert expected_variance(g, T) == pytest.approx(g.sigma**2 * ratio / 3.0, rel=1e-3)


def test_flennikens_record():
    """Three hours of tau = 1171 s: the mean is known to 0.44 sigma, the record shows 0.90 of sigma."""
    g = GaussMarkov(1.0, 1171.0)
    assert mean_sigma(g, 10_800.0) == pytest.approx(0.4397, abs=5e-4)
    assert expected_autocovariance(g, 0.0, 10_800.0) == pytest.approx(expected_variance(g, 10_800.0), rel=1e-12)


def test_expected_autocovariance_by_simulation():
    """Mean over 400 records of eight correlation times; 4 standard errors. The bare exponential fails."""
    g = GaussMarkov(1.0, 50.0)
    rng = np.random.default_rng(3)
    n = 400
    r = np.array([autocorrelation(g.sample(n, 1.0, rng), 1.0).value for _ in range(400)])
    lag = np.arange(n // 4 + 1.0)
    mean, error = r.mean(axis=0), r.std(axis=0) / 20.0
    expected = expected_autocovariance(g, lag, float(n))
    assert np.all(np.abs(mean - expected) < 4.0 * error + 0.002)  # sampled, not continuous: 0.2 %
    assert np.any(np.abs(mean - g.autocovariance(lag)) > 10.0 * error)


def test_bartletts_sigma_by_simulation():
    """Scatter over 300 records against the mean of the stated sigma; 15 % (few correlation times in a record)."""
    g = GaussMarkov(1.0, 10.0)
    rng = np.random.default_rng(4)
    runs = [autocorrelation(g.sample(5000, 1.0, rng), 1.0, longest_s=60.0) for _ in range(300)]
    scatter = np.std([c.value for c in runs], axis=0)
    stated = np.mean([c.sigma for c in runs], axis=0)
    np.testing.assert_allclose(stated, scatter, rtol=0.15)


def test_crossing():
    """The correlation time of a long record, 4 standard errors sqrt(2 tau/T); none where it is not reached."""
    g = GaussMarkov(3.0, 20.0)
    c = autocorrelation(g.sample(400_000, 1.0, np.random.default_rng(5)), 1.0, longest_s=200.0)
    assert c.crossing() == pytest.approx(20.0, rel=4.0 * np.sqrt(2.0 * 20.0 / 400_000))
    assert autocorrelation(np.arange(100.0), 1.0, longest_s=3.0).crossing() is None


@pytest.mark.parametrize(
    ("x", "rate", "longest", "match"),
    [
        (np.r_[np.zeros(9), np.nan], 1.0, None, "NaN"),
        (np.zeros(100), 1.0, None, "stuck"),
        (np.arange(10.0), 1.0, 10.0, "up to the record"),
        (np.arange(10.0), 0.0, None, "rate_hz"),
        (np.zeros((10, 2)), 1.0, None, "shape"),
    ],
)
def test_refusals(x, rate, longest, match):
    with pytest.raises(InputError, match=match):
        autocorrelation(x, rate, longest_s=longest)


def test_lags_outside_the_record_are_refused():
    with pytest.raises(InputError, match="expected 0 to 10 s"):
        expected_autocovariance(GaussMarkov(1.0, 1.0), 11.0, 10.0)
