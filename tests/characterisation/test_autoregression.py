"""Burg's method recovers what was simulated; the claim that AR models predict biases better is measured."""

import numpy as np
import pytest

from schuler.characterisation.autoregression import compare_predictions, fit_ar
from schuler.exceptions import InputError
from schuler.sensors import GaussMarkov, White


def ar(coefficients, n, seed):
    from scipy.signal import lfilter

    e = np.random.default_rng(seed).standard_normal(n + 500)
    return lfilter([1.0], np.concatenate(([1.0], -np.asarray(coefficients))), e)[500:]


@pytest.mark.parametrize("true", [[0.9], [1.5, -0.8], [0.5, 0.2, -0.3]])
def test_coefficients_are_recovered(true):
    """Asymptotic covariance ``sigma^2 R^-1 / n``; 4 standard errors, variance of e to 4 sqrt(2/n)."""
    n, p = 20000, len(true)
    x = ar(true, n, 3)
    model = fit_ar(x, p, "aic")
    R = np.array([[np.mean(x[: n - abs(i - j)] * x[abs(i - j) :]) for i in range(p)] for j in range(p)])
    se = np.sqrt(np.diag(np.linalg.inv(R)) / n)
    assert model.order == p
    assert (np.abs(model.coefficients - true) < 4 * se).all()
    assert model.variance == pytest.approx(1.0, abs=4 * np.sqrt(2.0 / n))


def test_the_order_is_found():
    """BIC finds order 2 of 40 times at least 38; AIC, as it does, takes more now and then."""
    bic = [fit_ar(ar([1.5, -0.8], 2000, seed), 10).order for seed in range(40)]
    aic = [fit_ar(ar([1.5, -0.8], 2000, seed), 10, "aic").order for seed in range(40)]
    assert np.sum(np.array(bic) == 2) >= 38
    assert min(aic) >= 2
    assert np.mean(aic) >= np.mean(bic)


def test_a_gauss_markov_process_is_an_ar_1():
    """a_1 = exp(-dt/tau), innovation sigma^2 (1 - a_1^2); 4 standard errors."""
    n, dt, tau, sigma = 50000, 1.0, 20.0, 3.0
    model = fit_ar(GaussMarkov(sigma, tau).sample(n, dt, np.random.default_rng(5)))
    a = np.exp(-dt / tau)
    assert model.order == 1
    assert model.coefficients[0] == pytest.approx(a, abs=4 * np.sqrt((1 - a * a) / n))
    assert model.variance == pytest.approx(sigma**2 * (1 - a * a), rel=4 * np.sqrt(2.0 / n))


def test_the_model_is_stable_whatever_it_is_fitted_to():
    for x in (np.arange(200.0), np.cumsum(np.random.default_rng(1).standard_normal(300)), np.sin(np.arange(300.0))):
        a = fit_ar(x, 8).coefficients
        assert np.abs(np.roots(np.concatenate(([1.0], -a)))).max() < 1.0 + 1e-9


@pytest.mark.parametrize("steps", [1, 2, 5, 30])
def test_predictions_are_the_recursion_repeated(steps):
    x = ar([0.5, 0.2, -0.3], 100, 1)
    model = fit_ar(x, 3, "aic")
    p = model.order
    predicted = model.predict(x, steps)
    assert len(predicted) == len(x) - p - steps + 1
    for k in (0, 7, len(predicted) - 1):
        values = list(x[k : k + p])
        for _ in range(steps):
            values.append(float(model.coefficients @ values[: -p - 1 : -1]))
        assert predicted[k] == pytest.approx(values[-1], abs=1e-12)  # rounding


def test_one_step_errors_have_the_variance_of_the_model():
    x = ar([1.5, -0.8], 20000, 8)
    model = fit_ar(x, 2)
    error = x[2:] - model.predict(x)[: len(x) - 2]
    assert error.var() == pytest.approx(1.0, abs=4 * np.sqrt(2.0 / len(error)))


@pytest.mark.parametrize("seed", [1, 2])
def test_ar_beats_gauss_markov_only_within_the_memory_of_the_filter(seed):
    """24 h of the AQRS-104. Measured: 40 % better 10 s ahead, 3 % at 100 s (the filter's period), 0 to 1 % at 1000 s.

    Statistical, with room: the literature's "30 % and more" is a one-step figure of filtered data.
    """
    x = (White(0.0237) + GaussMarkov(0.054, 1171.0)).sample(86400, 1.0, np.random.default_rng(seed))
    r = compare_predictions(x, 1.0)
    np.testing.assert_allclose(r.horizon_s, [10.0, 100.0, 1000.0])
    assert 0.3 < r.gain[0] < 0.5
    assert -0.02 < r.gain[1] < 0.08
    assert -0.05 < r.gain[2] < 0.05
    assert r.gm_rms[2] < r.held_rms[2]  # at 0.85 tau the bias has begun to forget
    assert "10 s ahead" in r.summary()


@pytest.mark.realdata
def test_adis16405_gyroscope(shared_data):
    """A real bias, 2.8 h. Measured for y: 20 % better 10 s ahead, 7 % worse at 100 s, 16 % worse at 1000 s."""
    data = np.load(shared_data / "adis16405_static" / "adis16405_imu1.npz")
    r = compare_predictions(data["counts"][:, 1] * data["lsb"][1], 100.0)
    assert 0.1 < r.gain[0] < 0.3
    assert -0.2 < r.gain[1] < 0.05
    assert -0.3 < r.gain[2] < 0.05


def test_an_oscillating_bias_is_a_case_for_ar():
    """A heater's cycle of 400 s: a Gauss-Markov process predicts a decay, the AR model the cycle."""
    rng = np.random.default_rng(9)
    t = np.arange(40000.0)
    x = White(0.01).sample(len(t), 1.0, rng) + 0.05 * np.sin(2 * np.pi * t / 400.0 + 1.0)
    r = compare_predictions(x, 1.0, horizons_s=(100.0, 200.0))
    assert (r.gain > 0.7).all()


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: fit_ar(np.ones(100), 5), "expected a signal that varies"),
        (lambda: fit_ar(np.arange(20.0), 5), "max_order: expected 1 to 2 for 20 samples, got 5"),
        (lambda: fit_ar(np.arange(100.0), 5, "hq"), "criterion: expected 'aic' or 'bic', got 'hq'"),
        (lambda: fit_ar(np.arange(100.0), 2).predict(np.ones(10), 0), "steps: expected a whole number of 1 or more"),
        (lambda: compare_predictions(np.arange(100.0), 1.0), "x: expected 4100 s or more for orders up to 20, got 100"),
        (lambda: compare_predictions(np.arange(100.0), 1.0, cutoff_hz=0.5), "cutoff_hz: expected less than half"),
        (lambda: compare_predictions(np.arange(100.0), -1.0), "rate_hz: expected a positive number"),
        (lambda: compare_predictions(np.random.default_rng(1).standard_normal(9000), 1.0, horizons_s=(5000.0,)),
         "horizons_s: expected at most an eighth"),
    ],
)  # fmt: skip
def test_what_cannot_be_done_is_said(call, message):
    with pytest.raises(InputError, match=message):
        call()
