"""Spread of the bias over switch-ons: closed forms, coverage of the interval, records with drift of their own."""

import numpy as np
import pytest
from scipy.stats import chi2
from scipy.stats import t as student

from schuler.characterisation.identification import identify_noise
from schuler.characterisation.trends import mean_with_sigma
from schuler.characterisation.turn_on import record_means, turn_on_bias
from schuler.exceptions import InputError
from schuler.recording.series import ImuSeries
from schuler.sensors.noise import GaussMarkov, RandomWalk, White
from schuler.units import DEG_PER_HR


def test_with_equal_uncertainties_it_is_the_textbook(rng):
    """Sample variance less s^2; bounds from chi-square of r - 1 degrees of freedom."""
    x = 3.0 + 0.5 * rng.standard_normal(12)
    total, s = x.var(ddof=1), 0.2
    spread = turn_on_bias(x, s)
    np.testing.assert_allclose(spread.mean, x.mean(), rtol=1e-12)  # rounding, here and below
    np.testing.assert_allclose(spread.sigma, np.sqrt(total - s**2), rtol=1e-9)
    np.testing.assert_allclose(spread.mean_sigma, np.sqrt(total / 12.0), rtol=1e-9)
    np.testing.assert_allclose(spread.low, np.sqrt(max(11.0 * total / chi2.ppf(0.975, 11) - s**2, 0.0)), rtol=1e-9)
    np.testing.assert_allclose(spread.high, np.sqrt(11.0 * total / chi2.ppf(0.025, 11) - s**2), rtol=1e-9)
    half = student.ppf(0.975, 11) * np.sqrt(total / 12.0)
    np.testing.assert_allclose((spread.mean_low[0], spread.mean_high[0]), (x.mean() - half, x.mean() + half), rtol=1e-9)
    assert spread.records == 12
    assert "spread" in spread.summary()


def test_without_uncertainties_it_is_the_sample_deviation(rng):
    x = rng.standard_normal((8, 3)) * (1e-6, 1.0, 1e6)
    spread = turn_on_bias(x)
    np.testing.assert_allclose(spread.sigma, x.std(axis=0, ddof=1), rtol=1e-9)  # rounding
    np.testing.assert_allclose(spread.mean, x.mean(axis=0), rtol=1e-12, atol=1e-12)


def test_unequal_uncertainties_satisfy_their_equation(rng):
    s = np.array([0.1, 0.1, 2.0, 0.3, 0.05, 1.0, 0.2])
    x = 1.0 + np.hypot(0.5, s) * rng.standard_normal(7)
    spread = turn_on_bias(x, s)
    for sigma, target in ((spread.sigma, 6.0), (spread.low, chi2.ppf(0.975, 6)), (spread.high, chi2.ppf(0.025, 6))):
        w = 1.0 / (sigma[0] ** 2 + s**2)
        assert w @ (x - w @ x / w.sum()) ** 2 == pytest.approx(target, rel=1e-8)  # rounding


def test_means_that_agree_show_no_spread():
    spread = turn_on_bias([1.0, 1.01, 0.99, 1.0], 0.5)
    assert spread.sigma[0] == 0.0
    assert spread.low[0] == 0.0
    assert turn_on_bias([2.0, 2.0, 2.0]).sigma[0] == 0.0


@pytest.mark.thinned(4)
@pytest.mark.parametrize("runs", [400, pytest.param(1000, marks=pytest.mark.campaign)])
@pytest.mark.parametrize("ratio", [0.2, 1.0])
def test_the_interval_covers_as_often_as_it_says(ratio, runs):
    """Experiments of 10 records with uncertainties that differ by a factor of 4; the estimate is not biased."""
    rng = np.random.default_rng(17)
    s = ratio * np.geomspace(0.5, 2.0, 10)
    covered, means, variances = 0, 0, []
    for _ in range(runs):
        spread = turn_on_bias(np.hypot(1.0, s) * rng.standard_normal(10), s)
        covered += spread.low[0] <= 1.0 <= spread.high[0]
        means += spread.mean_low[0] <= 0.0 <= spread.mean_high[0]
        variances.append(spread.sigma[0] ** 2)
    # statistical: 3.5 standard errors of a share of so many
    assert abs(covered / runs - 0.95) < 3.5 * np.sqrt(0.95 * 0.05 / runs)
    # unequal uncertainties and a spread clipped at zero: by Student's distribution a little on the safe side
    assert abs(means / runs - 0.95) < 3.5 * np.sqrt(0.95 * 0.05 / runs) + 0.01
    # clipping at zero pushes the variance up a little where the records are poor
    assert abs(np.mean(variances) - 1.0) < 3.5 * np.std(variances) / np.sqrt(runs) + (0.02 if ratio < 0.5 else 0.1)


@pytest.mark.thinned(3)
@pytest.mark.parametrize(
    ("model", "largest"), [(White(1.0), 1.6), (RandomWalk(0.05), 1.3), (White(1.0) + GaussMarkov(0.3, 20.0), 3.5)]
)
def test_the_uncertainty_of_a_mean_is_that_of_its_noise(model, largest):
    """Against the scatter of means over 100 records; white noise alone would be wrong by far for the walk."""
    rng = np.random.default_rng(23)
    pairs = np.array([mean_with_sigma(model.sample(1200, 0.5, rng), 2.0) for _ in range(100)])
    scatter, claimed = pairs[:, 0].std(), np.sqrt(np.mean(pairs[:, 1] ** 2))
    # statistical 7 % for the scatter; the rest is what 10 minutes tell about slow noise. Gauss-Markov noise is none of
    # the kinds that are fitted and is taken for a random walk: too large, never too small
    assert 0.8 < claimed / scatter < largest


def test_records_give_the_spread_that_was_put_in():
    rng = np.random.default_rng(29)
    records, bias = [], np.array([1e-3, 2e-3, 5e-4, 0.05, 0.02, 0.1])
    for _ in range(12):
        turn_on = bias * rng.standard_normal(6)
        gyro = turn_on[:3] + (White(5e-4) + RandomWalk(2e-5)).sample((2000, 3), 0.1, rng)
        accel = np.array((0.0, 0.0, -9.81)) + turn_on[3:] + White(2e-3).sample((2000, 3), 0.1, rng)
        records.append(ImuSeries(np.arange(2000) * 0.1, gyro, accel))
    means, sigmas = record_means(records)
    assert means.shape == sigmas.shape == (12, 6)
    spread = turn_on_bias(means, sigmas)
    assert np.all((spread.low < bias) & (bias < spread.high))  # statistical: 95 % each, fixed seed
    assert np.all(spread.within[:3] > 5e-4 / np.sqrt(200.0))


@pytest.mark.campaign
def test_a_budget_of_several_switch_ons_has_their_spread_and_not_their_mean(tmp_path):
    """Closed form: root mean square over the axes of the sample deviation and of the uncertainty of the mean."""
    rng = np.random.default_rng(31)
    turn_on = np.array([46.0, -30.0, 20.0]) + rng.uniform(-8.0, 8.0, (3, 3))  # deg/h
    logs = []
    for bias in turn_on * DEG_PER_HR:
        gyro = bias + 1e-7 * rng.standard_normal((2000, 3))
        logs.append(ImuSeries(np.arange(2000) * 0.02, gyro, np.zeros((2000, 3))))  # gyroscopes alone
    several, fewer = (identify_noise(part, models=("N",)) for part in (logs, logs[:2]))
    sigma = np.sqrt(np.mean(4.0 / 3.0 * turn_on.var(axis=0, ddof=1)))
    assert several.spec.gyro.turn_on_bias / DEG_PER_HR == pytest.approx(sigma, rel=1e-3)  # noise of the means: 1e-4
    assert several.spec_sigma["gyro"]["turn_on_bias"] == pytest.approx(1.0 / np.sqrt(2.0 * 6.0))
    spread = several.turn_on["gyro_x"]
    assert spread.mean[0] / DEG_PER_HR == pytest.approx(turn_on[:, 0].mean(), rel=1e-3)
    assert "gyro_x over 3 switch-ons [deg/h]: mean" in several.summary()
    page = several.report(tmp_path / "noise.html").read_text(encoding="utf-8")
    assert f"{spread.mean[0] / DEG_PER_HR:.4g} (" in page.partition("Switch-ons</h2>")[2]
    assert fewer.turn_on == {}
    assert fewer.spec.gyro.turn_on_bias > 20.0 * DEG_PER_HR


@pytest.mark.parametrize(
    ("means", "sigmas", "match"),
    [
        ([1.0, 2.0], 0.0, "expected at least 3 records"),
        (np.zeros((4, 2, 2)), 0.0, "expected at least 3 records"),
        ([1.0, 2.0, 3.0], -0.1, "sigmas: expected none below zero"),
        ([1.0, 2.0, 3.0], [0.1, 0.2], r"sigmas: expected one for each of the means, shape \(3, 1\), got \(2,\)"),
    ],
)
def test_wrong_arguments_are_named(means, sigmas, match):
    with pytest.raises(InputError, match=match):
        turn_on_bias(means, sigmas)
