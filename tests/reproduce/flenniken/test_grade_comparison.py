"""A log laid over its noise model: right models pass at the stated rate, wrong ones are found where they are wrong."""

import numpy as np
import pytest

from schuler.exceptions import InputError
from schuler.reproduce.flenniken.study.grade_comparison import _correlations, _deviations, overlay
from schuler.sensors import GaussMarkov, NoiseModel, RandomWalk, White, flicker

MODEL = White(1e-3) + GaussMarkov(3e-4, 60.0)
RATE = 2.0


def log(model, seed, n=6000):
    return 0.1 + model.sample(n, 1.0 / RATE, np.random.default_rng(seed))


def test_a_right_model_passes_at_the_stated_rate():
    """60 logs: each p uniform on 1/40 .. 1, at most 5 % rejected; binomial, 3 standard errors. Shares near 0.95."""
    results = [overlay(MODEL, log(MODEL, seed, 2000), RATE, np.random.default_rng(1000 + seed)) for seed in range(60)]
    assert np.mean([not r.agrees for r in results]) < 0.05 + 3 * np.sqrt(0.05 * 0.95 / 60)
    p = np.array([r.allan.p for r in results])
    assert np.mean(p) == pytest.approx(0.51, abs=3 * np.sqrt(1 / 12 / 60))
    share = np.array([r.allan.share for r in results])
    assert share.mean() == pytest.approx(0.95, abs=3 * share.std() / np.sqrt(60) + 0.01)


@pytest.mark.parametrize(
    ("wrong", "near"),
    [
        (White(1.15e-3) + GaussMarkov(3e-4, 60.0), (0.4, 12.0)),  # N 15 % off: seen where white noise rules
        (White(1e-3) + GaussMarkov(9e-4, 60.0), (10.0, 800.0)),
        (NoiseModel((White(1e-3),)), (10.0, 800.0)),
        (White(1e-3) + GaussMarkov(3e-4, 60.0) + RandomWalk(5e-5), (50.0, 800.0)),
    ],
)
def test_a_wrong_model_is_found_where_it_is_wrong(wrong, near):
    r = overlay(wrong, log(MODEL, 3), RATE, np.random.default_rng(4))
    assert not r.agrees
    assert r.allan.p == pytest.approx(1 / 40)
    assert near[0] <= r.allan.at[r.allan.worst] <= near[1]
    assert r.allan.share < 0.9
    assert "does not reproduce" in r.summary()


def test_flicker_and_random_walk_are_models_too():
    model = White(1e-3) + flicker(1e-4) + RandomWalk(1e-6)
    r = overlay(model, log(model, 5), RATE, np.random.default_rng(6), runs=79)
    assert r.agrees
    assert r.runs == 79
    assert r.summary().startswith("the model reproduces the log (79 realisations)\nAllan deviation: ")


def test_the_mean_of_the_log_does_not_matter():
    a = overlay(MODEL, log(MODEL, 1), RATE, np.random.default_rng(2))
    b = overlay(MODEL, log(MODEL, 1) + 9.8, RATE, np.random.default_rng(2))
    np.testing.assert_allclose(a.allan.measured, b.allan.measured, rtol=1e-9)  # rounding of a mean 1e4 times larger
    np.testing.assert_allclose(a.correlation.measured, b.correlation.measured, atol=1e-9)


def test_curves_by_definition():
    """Loops over clusters and lags, as the definitions have them; rounding."""
    rng = np.random.default_rng(0)
    x, dt = rng.standard_normal(40), 0.5
    for m in (1, 3, 7):
        means = np.array([x[k : k + m].mean() for k in range(len(x) - m + 1)])
        expected = np.sqrt(0.5 * np.mean([(means[k + m] - means[k]) ** 2 for k in range(len(means) - m)]))
        np.testing.assert_allclose(_deviations(x, dt, np.array([m])), expected, rtol=1e-12)
    y = x.reshape(-1, 4).mean(axis=1)
    y -= y.mean()
    expected = [sum(y[k] * y[k + j] for k in range(10 - j)) / sum(y**2) for j in (1, 2)]
    np.testing.assert_allclose(_correlations(x, 4, np.array([1, 2])), expected, rtol=1e-12)


@pytest.mark.parametrize(
    ("model", "x", "rate", "runs", "message"),
    [
        (MODEL, np.ones(100), 1.0, 39, "x: expected 200 samples or more, got 100"),
        (MODEL, np.full(300, np.nan), 1.0, 39, "expected finite numbers"),
        (MODEL, np.ones(300), 0.0, 39, "rate_hz: expected a positive number"),
        (MODEL, np.ones(300), 1.0, 20, "runs: expected 39 or more, fewer cannot bound 95 %, got 20"),
        ({"N": 1.0}, np.ones(300), 1.0, 39, "model: expected an AxisNoise or a noise model, got dict"),
    ],
)
def test_what_cannot_be_compared_is_said(model, x, rate, runs, message):
    with pytest.raises(InputError, match=message):
        overlay(model, x, rate, np.random.default_rng(0), runs=runs)


def test_what_does_not_move_cannot_be_compared():
    with pytest.raises(InputError, match="x: expected a noisy signal, got one value"):
        overlay(MODEL, np.ones(300), 1.0, np.random.default_rng(0))
    with pytest.raises(InputError, match="model: expected noise, got one without any"):
        overlay(NoiseModel(()), log(MODEL, 1, 300), 1.0, np.random.default_rng(0))


@pytest.mark.realdata
def test_two_terms_by_hand_do_not_make_an_adis16405(shared_data):
    """The verdict can be no: measured 43 % of averaging times inside, worst at one sample, where the sensor filters."""
    from schuler.characterisation.manual import identify_manually

    data = np.load(shared_data / "adis16405_static" / "adis16405_imu1.npz")
    x = data["counts"][:, 1] * data["lsb"][1]
    r = overlay(identify_manually(x, 100.0).model, x, 100.0, np.random.default_rng(0))
    assert not r.agrees
    assert r.allan.share < 0.7
