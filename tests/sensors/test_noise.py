"""Noise processes against their closed forms: exact covariances first, then samples."""

from decimal import Decimal, getcontext

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import quad

from schuler.exceptions import InputError
from schuler.sensors import (
    Flicker,
    GaussMarkov,
    NoiseModel,
    Ramp,
    RandomWalk,
    TriadSpec,
    White,
    allan_minimum,
    flicker,
    gauss_markov,
    noise_model,
    quantise,
    quantise_increments,
    random_walk,
    white,
)

SIGMAS = 4.0  # statistical tolerances: standard errors, seeds fixed


class UnitDraws:
    """Stands in for a Generator: the columns of its draws are unit vectors, so a linear generator returns its own
    matrix L and the covariance of its output is exactly L L^T."""

    def __init__(self, columns: int) -> None:
        self.columns, self.used = columns, 0

    def standard_normal(self, shape: tuple[int, int]) -> np.ndarray:
        assert shape[1] == self.columns
        rows = np.eye(self.columns)[self.used : self.used + shape[0]]
        self.used += shape[0]
        return rows


def exact_covariance(generate, n: int, draws: int) -> np.ndarray:
    L = generate((n, draws), UnitDraws(draws))
    return L @ L.T


@pytest.mark.parametrize(("dt", "tau"), [(0.01, 100.0), (0.005, 0.3), (1.0, 0.2), (50.0, 7.0)])
def test_gauss_markov_covariance_is_exact_at_any_rate(dt, tau):
    n, sigma = 6, 1.7
    P = exact_covariance(lambda shape, rng: gauss_markov(sigma, tau, shape, dt, rng), n, n + 1)
    lag = dt * np.abs(np.subtract.outer(np.arange(n), np.arange(n)))
    np.testing.assert_allclose(P, GaussMarkov(sigma, tau).autocovariance(lag), rtol=1e-12, atol=1e-14)  # rounding


def test_appendix_B_case_has_unit_standard_deviation():
    """Flenniken B.3 (100 Hz, 100 s, sigma 1) prints a drive that leads to 0.707; the exact recursion gives 1."""
    P = exact_covariance(lambda shape, rng: gauss_markov(1.0, 100.0, shape, 0.01, rng), 400, 401)
    np.testing.assert_allclose(np.diag(P), 1.0, rtol=1e-12)  # rounding


def test_gauss_markov_from_zero():
    process = GaussMarkov(2.0, 3.0, start="zero")
    P = exact_covariance(lambda shape, rng: process.sample(shape, 0.5, rng), 8, 8)
    np.testing.assert_allclose(np.diag(P), process.variance(0.5 * np.arange(8)), rtol=1e-12, atol=1e-16)  # rounding
    np.testing.assert_allclose(process.sampled(0.5).covariance(8), P, rtol=1e-12, atol=1e-16)  # rounding


def test_random_walk_covariance_is_exact():
    K, dt, n = 0.3, 0.02, 7
    P = exact_covariance(lambda shape, rng: random_walk(K, shape, dt, rng), n, n)
    k = np.arange(n)
    np.testing.assert_allclose(P, K**2 * dt * np.minimum.outer(k, k), rtol=1e-12, atol=1e-18)  # rounding


def test_white_covariance_is_exact():
    P = exact_covariance(lambda shape, rng: white(0.2, shape, 0.01, rng), 5, 5)
    np.testing.assert_allclose(P, White(0.2).variance(0.01) * np.eye(5), rtol=1e-12, atol=1e-18)  # rounding


def test_ramp_is_linear_with_random_slope():
    x = Ramp(0.2).sample((5, 20_000), 0.5, np.random.default_rng(17))
    np.testing.assert_allclose(x, np.outer([0, 0.5, 1, 1.5, 2], x[2]), rtol=1e-13)  # rounding
    assert abs(x[2].std() / 0.2 - 1.0) < SIGMAS / np.sqrt(2 * 20_000)


@pytest.mark.parametrize("x", [1e-6, 1e-3, 0.05, 0.0999, 0.1001, 0.5, 1.893, 10.0, 1e3])
def test_allan_variance_of_gauss_markov(x):
    """From the variance of the integral, v1(t) = 2 s^2 tau^2 (z - 1 + exp(-z)), in 60-digit arithmetic."""
    getcontext().prec = 60
    z = Decimal(x)

    def v1(z):
        return 2 * (z - 1 + (-z).exp())

    expected = float((4 * v1(z) - v1(2 * z)) / (2 * z * z))
    sigma, tau = 0.7, 300.0
    got = GaussMarkov(sigma, tau).allan_variance(float(z) * tau)
    np.testing.assert_allclose(got, sigma**2 * expected, rtol=2e-12)  # rounding


def test_allan_deviation_peak_and_slopes_of_gauss_markov():
    process = GaussMarkov(1.0, 100.0)
    tau = np.linspace(150.0, 230.0, 8001)
    adev = np.sqrt(process.allan_variance(tau))
    assert adev.max() == pytest.approx(0.6174, abs=5e-5)  # printed digits
    assert tau[adev.argmax()] / 100.0 == pytest.approx(1.893, abs=1e-3)  # printed digits
    K = np.sqrt(2.0 / 100.0)
    assert process.allan_variance(1e-3) == pytest.approx(K**2 * 1e-3 / 3.0, rel=1e-5)  # short times: a random walk
    assert process.allan_variance(1e6) == pytest.approx(2.0 * 100.0 / 1e6, rel=2e-4)  # long times: white noise


@pytest.mark.parametrize("process", [White(0.3), RandomWalk(0.2), GaussMarkov(1.5, 4.0)])
def test_allan_variance_follows_from_the_spectrum(process):
    """AVAR = 2 int_-inf^inf S(f) sin^4(pi f T) / (pi f T)^2 df, S two-sided."""
    T = 3.0

    def integrand(u):
        return process.psd(u / (np.pi * T)) * np.sin(u) ** 4 / u**2

    body = sum(quad(integrand, k * np.pi, (k + 1) * np.pi, epsabs=0, epsrel=1e-10)[0] for k in range(400))
    tail = process.psd(400.5 / T) * 3 / 8 / (400 * np.pi)  # mean of sin^4 is 3/8
    np.testing.assert_allclose(4.0 / (np.pi * T) * (body + tail), process.allan_variance(T), rtol=1e-4)  # truncation


def test_flicker_is_flat_at_0664_B():
    tau = np.geomspace(10.0, 4e3, 100)
    adev = np.sqrt(flicker(2e-4).allan_variance(tau))
    np.testing.assert_allclose(adev, allan_minimum(2e-4), rtol=0.03)  # stated accuracy of the approximation
    edges = np.sqrt(flicker(1.0).allan_variance([1.0, 1e4])) / allan_minimum(1.0)
    np.testing.assert_allclose(edges, [0.82, 0.93], atol=0.01)  # stated accuracy at the ends of the band
    f = np.geomspace(1e-4, 1e-2, 50)
    np.testing.assert_allclose(flicker(1.0).psd(f), 1.0 / (2.0 * np.pi * f), rtol=0.06)  # stated accuracy


def test_ramp_formulas():
    assert Ramp(2e-6).allan_variance(10.0) == pytest.approx(0.5 * (2e-6 * 10.0) ** 2)
    assert Ramp(2.0).psd(1.0 / (2.0 * np.pi)) == pytest.approx(4.0)


def test_noise_terms_add_up():
    a, b, c = White(3.0), GaussMarkov(1.0, 10.0), White(4.0)
    model = a + b + c
    assert model == NoiseModel((a, b, c)) == a + (b + c)
    assert model.white == White(5.0)
    assert model.in_run == NoiseModel((b,))
    tau = np.array([0.1, 10.0])
    np.testing.assert_allclose(model.allan_variance(tau), 25.0 / tau + b.allan_variance(tau), rtol=1e-14)  # rounding
    np.testing.assert_allclose(model.psd(tau), 25.0 + b.psd(tau), rtol=1e-14)  # rounding
    assert not NoiseModel().sample((4, 3), 0.1, np.random.default_rng(0)).any()


def test_a_further_term_leaves_the_others_as_they_were():
    a, b = White(1.0), RandomWalk(0.5)
    one = NoiseModel((a,)).sample(100, 0.1, np.random.default_rng(3))
    both = (a + b).sample(100, 0.1, np.random.default_rng(3))
    walk = both - one
    assert walk[0] == 0.0
    assert np.std(np.diff(walk)) == pytest.approx(0.5 * np.sqrt(0.1), rel=SIGMAS / np.sqrt(2 * 99))
    # an exchanged first term, with another number of draws
    c = GaussMarkov(1.0, 3.0)
    alone = c.sample(100, 0.1, np.random.default_rng(3).spawn(1)[0])
    other = (c + b).sample(100, 0.1, np.random.default_rng(3)) - alone
    np.testing.assert_allclose(other, walk, atol=1e-14)  # rounding


def test_noise_model_of_a_budget():
    triad = TriadSpec(
        random_walk=1e-3,
        bias_instability=2e-4,
        rate_random_walk=3e-5,
        rate_ramp=1e-9,
        in_run_bias=4e-4,
        in_run_time=60.0,
    )
    model = noise_model(triad, start="zero")
    assert model.white == White(1e-3)
    assert model.terms[1:4] == (GaussMarkov(4e-4, 60.0, "zero"), RandomWalk(3e-5), Ramp(1e-9))
    assert model.terms[4:] == (Flicker(2e-4),)
    assert noise_model(TriadSpec(random_walk=1.0)) == NoiseModel((White(1.0),))


@settings(deadline=None)  # a busy machine is no fault
@given(
    st.lists(st.floats(-50.0, 50.0), min_size=1, max_size=40),
    st.sampled_from([1.0, 0.3, 7.0]),
)
def test_quantised_increments_never_drift(x, lsb):
    x = np.array(x)
    out = quantise_increments(x, lsb)
    assert np.abs(np.cumsum(out) - np.cumsum(x)).max() <= 0.5 * lsb + 1e-9  # half a pulse and rounding
    np.testing.assert_allclose(out / lsb, np.round(out / lsb), atol=1e-6)  # whole pulses, rounding


def test_quantisation_with_and_without_memory():
    x = np.full((1000, 2), 0.3)
    assert not quantise(x, 1.0).any()  # a rate below half a bit disappears
    assert quantise_increments(x, 1.0).sum(axis=0) == pytest.approx([300.0, 300.0])
    np.testing.assert_array_equal(quantise([0.26, -0.26, 0.24], 0.5), [0.5, -0.5, 0.0])


def test_quantisation_noise_is_q_over_sqrt12():
    x = np.random.default_rng(19).uniform(0.0, 40.0, 100_000)
    remainder = np.cumsum(quantise_increments(x, 1.0)) - np.cumsum(x)
    assert abs(remainder.std() * np.sqrt(12.0) - 1.0) < SIGMAS * np.sqrt(0.2 / len(x))  # kurtosis of a uniform is 1.8


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda r: white(-1.0, 3, 0.1, r), "N: expected one finite number, not negative, got -1.0"),
        (lambda r: white(1.0, 3, 0.0, r), "dt: expected one positive finite number"),
        (lambda r: white(1.0, 2.5, 0.1, r), "n: expected a number of samples"),
        (lambda r: gauss_markov(1.0, 0.0, 3, 0.1, r), "tau: expected one positive"),
        (lambda r: gauss_markov(1.0, 1.0, 3, 0.1, r, "warm"), "start: expected 'stationary' or 'zero', got 'warm'"),
        (lambda r: GaussMarkov(1.0, 1.0, "warm"), "start: expected"),
        (lambda r: RandomWalk(float("nan")), "K: expected one finite"),
        (lambda r: quantise([1.0], 0.0), "lsb: expected one positive"),
        (lambda r: quantise_increments([1.0], -1.0), "lsb: expected one positive"),
        (lambda r: flicker(1.0, 10.0, 10.0), "longest: expected more than shortest"),
        (lambda r: GaussMarkov([1.0, 2.0], 1.0), "sigma: expected one finite number"),
    ],
)
def test_refusals(call, message, rng):
    with pytest.raises(InputError, match=message):
        call(rng)


def test_sum_with_something_else_is_refused():
    with pytest.raises(TypeError):
        White(1.0) + 1.0
