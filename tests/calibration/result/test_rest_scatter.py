"""Bias between rests: the scatter is in the sigma, and its cause is found."""

import numpy as np
import pytest

from schuler.calibration.result.rest_causes import rest_causes
from schuler.calibration.result.rest_scatter import rest_scatter
from schuler.exceptions import InputError


def rests(rng, n=20, scatter=0.0, force=0.0, drift=0.0):
    """Readings of three axes with white noise 1, in n poses ten seconds apart."""
    t = 10.0 * np.arange(n) + 5.0
    f = rng.standard_normal((n, 3))
    f *= 9.8 / np.linalg.norm(f, axis=1, keepdims=True)
    means = (1.0 * rng.standard_normal((n, 3))) + scatter * rng.standard_normal((n, 3))
    means += f @ (force * np.array([[1.0, 0.2, 0.0], [0.0, -1.0, 0.3], [0.4, 0.0, 1.0]])).T
    return t, means + drift * (t - t.mean())[:, None], np.ones((n, 3)), f


@pytest.mark.thinned(2)
@pytest.mark.parametrize("scatter", [0.0, 1.0, 5.0])
@pytest.mark.parametrize("n", [9, 20])
def test_sigma_of_the_mean_holds_whatever_the_scatter(n, scatter):
    """Statistical: 95 % of 300 axes within 1.96 sigma, or more: few rests could hide a memory of the scatter."""
    rng = np.random.default_rng(5)
    z = []
    for _ in range(100):
        t, means, white, _ = rests(rng, n, scatter)
        fit = rest_scatter(t, means, white)
        z.append(fit.values[0] / np.sqrt(fit.covariance[:, 0, 0]))
    assert np.mean(np.abs(z) < 1.96) > 0.95 - 3.0 * 0.013
    assert np.sqrt(np.mean(np.square(z))) > 0.6


@pytest.mark.parametrize(
    ("tau", "logs"), [(15.0, 25), *(pytest.param(t, 150, marks=pytest.mark.campaign) for t in (0.0, 60.0, 400.0))]
)
def test_the_difference_of_interleaved_rests_scatters_as_stated(tau, logs):
    """Statistical: rms of odd less even over its sigma is 1, by two constants with one scatter, whatever its memory."""
    rng = np.random.default_rng(8)
    t, z = 5.5 * np.arange(24), []
    odd = np.arange(24) % 2 == 0
    memory = np.exp(-np.abs(t[:, None] - t) / tau) if tau else np.eye(24)
    root = np.linalg.cholesky(memory + 1e-9 * np.eye(24))
    for _ in range(logs):
        means = root @ rng.standard_normal((24, 3)) + 0.3 * rng.standard_normal((24, 3))
        fit = rest_scatter(t, means, np.full((24, 3), 0.3), np.column_stack((odd, ~odd)).astype(float))
        variance = fit.covariance[:, 0, 0] + fit.covariance[:, 1, 1] - 2.0 * fit.covariance[:, 0, 1]
        z.append((fit.values[0] - fit.values[1]) / np.sqrt(variance))
    assert np.sqrt(np.mean(np.square(z))) == pytest.approx(1.0, abs=0.15 if logs > 100 else 0.3)


def test_equal_readings_have_the_sigma_of_white_noise(rng):
    """Closed form for no scatter at all: 1/sqrt(n), and a tenth for what small a scatter could hide."""
    t, _, white, _ = rests(rng)
    fit = rest_scatter(t, np.zeros((20, 3)), white)
    np.testing.assert_allclose(np.sqrt(fit.covariance[:, 0, 0]), 1.0 / np.sqrt(20.0), rtol=0.1)
    np.testing.assert_allclose(fit.values, 0.0, atol=1e-12)


def test_the_scale_of_the_readings_does_not_matter(rng):
    t, means, white, _ = rests(rng, scatter=2.0)
    one, other = rest_scatter(t, means, white), rest_scatter(t, 1e-5 * means + 3.0, 1e-5 * white)
    np.testing.assert_allclose(1e-5 * one.sigma, other.sigma, rtol=1e-4)  # rounding of 3 + 1e-5
    np.testing.assert_allclose(1e-10 * one.covariance, other.covariance, rtol=1e-4)


@pytest.mark.parametrize(("name", "options"), [("g-sensitivity", {"force": 1.0}), ("drift", {"drift": 0.1})])
def test_the_cause_is_found(rng, name, options):
    t, means, white, f = rests(rng, **options)
    causes = rest_causes(t, means, white, rest_scatter(t, means, white), f=f)
    assert causes[0].name == name
    assert causes[0].decisive
    assert causes[0].after < 2.0


@pytest.mark.parametrize("scatter", [0.0, 3.0])
def test_no_cause_where_there_is_none(scatter):
    """Statistical: one in a thousand, three causes of 50 logs."""
    rng = np.random.default_rng(8)
    seen = 0
    for _ in range(50):
        t, means, white, f = rests(rng, scatter=scatter)
        fit = rest_scatter(t, means, white)
        seen += sum(c.decisive for c in rest_causes(t, means, white, fit, f=f, temperature=20.0 + 0.01 * t))
    assert seen <= 2


def test_least_squares_with_the_covariance_of_the_rests_is_as_uncertain_as_the_integral(rng):
    """Closed form for a constant: ``1 / sum(inv(rests))`` is the variance of the mean, or more."""
    t, means, white, _ = rests(rng, scatter=2.0)
    fit = rest_scatter(t, means, white)
    by_rests = [1.0 / np.linalg.inv(V).sum() for V in fit.rests]
    assert np.all(np.array(by_rests) > (1.0 - 1e-9) * fit.covariance[:, 0, 0])


def test_too_few_rests():
    with pytest.raises(InputError, match="rests: expected more than 1, got 1"):
        rest_scatter(np.zeros(1), np.zeros((1, 3)), np.ones((1, 3)))
