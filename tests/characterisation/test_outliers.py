"""Outliers are replaced, so that the noise found is that of the log without them; clean logs are left alone."""

import numpy as np
import pytest

from schuler.characterisation.allan import allan_deviation
from schuler.characterisation.identification import identify_noise
from schuler.characterisation.outlier_mixture import outlier_mixture
from schuler.characterisation.outliers import without_outliers
from schuler.characterisation.result import AXES
from schuler.exceptions import InputError
from schuler.recording.series import ImuSeries
from schuler.sensors.noise import GaussMarkov, RandomWalk, White

RATE, N = 100.0, 60_000
SIGMA = 0.01  # of a sample
MODELS = {
    "white": White(1e-3),
    "Gauss-Markov": White(1e-3) + GaussMarkov(1e-3, 20.0),
    "random walk": White(1e-3) + RandomWalk(3e-4),
}
KINDS = {  # sigmas, sides
    "5, both": (5.0, 2),
    "5, one": (5.0, 1),
    "8, one": (8.0, 1),
    "30, both": (30.0, 2),
    "1000, one": (1000.0, 1),
    "5 to 1000": (None, 2),
}


def injected(x, kind, rng, share=0.05):
    """The signal with outliers added, and where."""
    size, sides = KINDS[kind]
    where = np.zeros(len(x), dtype=bool)
    where[rng.choice(len(x), int(share * len(x)), replace=False)] = True
    k = np.count_nonzero(where)
    sizes = np.full(k, size) if size is not None else np.geomspace(5.0, 1000.0, k)
    sign = np.ones(k) if sides == 1 else rng.choice([-1.0, 1.0], k)
    y = x.copy()
    y[where] += SIGMA * rng.permutation(sizes) * sign
    return y, where


@pytest.mark.thinned(5)
@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("model", MODELS)
def test_the_allan_deviation_of_what_is_left_is_the_clean_one(model, kind):
    rng = np.random.default_rng(1)
    x = MODELS[model].sample(N, 1.0 / RATE, rng)
    y, where = injected(x, kind, rng)
    repair = without_outliers(y)
    repaired, outlier = repair.x, repair.outlier
    taus = np.array([0.01, 0.02, 0.04, 0.16, 0.64, 2.56, 10.24])
    clean = allan_deviation(x, RATE, taus=taus, noise=0.0).deviation
    ratio = allan_deviation(repaired, RATE, taus=taus, noise=0.0).deviation / clean
    # statistical: 5 % of new noise; beyond the window of the level its own error is repeated, too
    np.testing.assert_allclose(ratio[:4], 1.0, atol=0.015)
    np.testing.assert_allclose(ratio[4:], 1.0, atol=0.09)
    assert allan_deviation(y, RATE, taus=taus[:1], noise=0.0).deviation[0] > 1.4 * clean[0]
    # where noise and outliers of 5 sigma meet, as many of them stay as good samples go; a tenth: no mixture is exact
    assert np.mean(outlier[where]) > 0.94
    assert np.count_nonzero(outlier) == pytest.approx(np.count_nonzero(where), rel=0.1)
    np.testing.assert_array_equal(repaired[~outlier], y[~outlier])


def wide(sigma, share, rng, n=20_000):
    """White noise of unit size, a share of it with a normal error of ``sigma`` besides."""
    x = rng.standard_normal(n)
    k = rng.choice(n, int(share * n), replace=False)
    x[k] += sigma * rng.standard_normal(len(k))
    return x


def test_noise_is_told_from_outliers_that_hide_in_it():
    """Half of the outliers are below three sigma: statistical, ten logs, each within what its mixture claims."""
    z = []
    for seed in range(10):
        mixture = outlier_mixture(wide(4.5, 0.1, np.random.default_rng(seed)), 4.5)
        z.append(np.log(mixture.sigma[0]) / mixture.scatter)
        assert mixture.share[0] == pytest.approx(0.9, abs=0.03)
        assert mixture.scatter < 0.03
    assert 0.4 < np.sqrt(np.mean(np.square(z))) < 1.7


def test_a_sample_between_two_outliers_is_one():
    """Bursts of twenty samples: those near the level in their middle go, too; alone they would stay."""
    rng = np.random.default_rng(6)
    x = rng.standard_normal(N)
    starts = 20 * rng.choice(N // 20, 40, replace=False)
    where = (starts[:, None] + np.arange(20)).ravel()
    x[where] += 6.0 * rng.standard_normal(len(where))
    near = where[np.abs(x[where]) < 2.0]
    repair = without_outliers(x)
    assert np.mean(repair.outlier[near]) > 0.7
    assert np.count_nonzero(repair.outlier) == pytest.approx(len(where), rel=0.1)


@pytest.mark.parametrize("model", MODELS)
def test_a_clean_log_loses_nothing(model):
    x = MODELS[model].sample(N, 1.0 / RATE, np.random.default_rng(2))
    repair = without_outliers(x)
    repaired, outlier = repair.x, repair.outlier
    assert np.count_nonzero(outlier) <= 6  # statistical: 0.4 expected of white noise, more of a level that moves
    assert np.std(np.diff(repaired)) == pytest.approx(np.std(np.diff(x)), rel=1e-3)


def test_an_outlier_at_either_end_does_not_become_the_level():
    x = MODELS["white"].sample(5000, 1.0 / RATE, np.random.default_rng(3))
    x[[0, -1]] += 10.0
    repair = without_outliers(x)
    repaired, outlier = repair.x, repair.outlier
    assert np.flatnonzero(outlier).tolist() == [0, 4999]
    assert np.abs(repaired[[0, -1]]).max() < 5.0 * SIGMA


def test_missing_samples_stay_missing_and_a_constant_stays():
    x = MODELS["white"].sample(5000, 1.0 / RATE, np.random.default_rng(4))
    x[100:300] = np.nan
    x[1000] += 1.0
    repair = without_outliers(x)
    repaired, outlier = repair.x, repair.outlier
    np.testing.assert_array_equal(np.isnan(repaired), np.isnan(x))
    assert np.flatnonzero(outlier).tolist() == [1000]
    for same in (np.full(500, 3.0), np.full(500, np.nan)):
        repair = without_outliers(same)
        np.testing.assert_array_equal(repair.x, same)
        assert not repair.outlier.any()


def test_the_same_seed_gives_the_same_repair(rng):
    y, _ = injected(MODELS["white"].sample(5000, 1.0 / RATE, rng), "30, both", rng)
    np.testing.assert_array_equal(without_outliers(y, seed=5).x, without_outliers(y, seed=5).x)
    assert np.any(without_outliers(y, seed=5).x != without_outliers(y, seed=6).x)


def test_more_than_one_signal_is_refused():
    with pytest.raises(InputError, match=r"x: expected one signal, got shape \(10, 3\)"):
        without_outliers(np.zeros((10, 3)))


@pytest.mark.campaign
def test_identification_with_outliers_finds_the_noise_of_the_clean_log():
    """Two axes of each model, one kind of outliers each: N within 5 % of the clean fit, and far off if not robust."""
    rng = np.random.default_rng(5)
    models = [MODELS[name] for name in MODELS for _ in range(2)]
    clean = np.stack([m.sample(N, 1.0 / RATE, rng) for m in models], axis=1)
    dirty = np.stack([injected(x, kind, rng)[0] for x, kind in zip(clean.T, KINDS, strict=True)], axis=1)

    def identified(x, robust):
        imu = ImuSeries(np.arange(N) / RATE, x[:, :3], x[:, 3:] + [0.0, 0.0, -9.80665])
        return identify_noise(imu, robust=robust, models=("N", "N+GM", "N+K"))

    truth, kept = identified(clean, False), identified(clean, True)
    repaired, spoiled = identified(dirty, True), identified(dirty, False)
    for axis in AXES:
        N_clean = truth.axes[axis].terms["N"].value
        assert kept.axes[axis].terms["N"].value == pytest.approx(N_clean, rel=0.01), axis
        assert repaired.axes[axis].terms["N"].value == pytest.approx(N_clean, rel=0.05), axis  # as asked for
        assert spoiled.axes[axis].terms["N"].value > 1.3 * N_clean, axis
        assert [f.severity for f in spoiled.axes[axis].findings if f.code == "outliers"] == ["warning"]
        notices = [f for f in repaired.axes[axis].findings if f.code == "outliers"]
        # where they were, and that they are replaced: a warning above 3 %, which leads
        assert {f.severity for f in notices} <= {"note", "warning"}
        assert sum("were replaced" in f.text for f in notices) == 1
        # nothing is said of the reach of a curve that nobody sees
        assert not [f for f in repaired.axes[axis].findings if f.code == "too_short"]
    assert repaired.provenance["robust"] is True
    assert "sigma_1" in repaired.axes["gyro_z"].names
    assert "K" in repaired.axes["accel_y"].terms
