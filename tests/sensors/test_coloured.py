"""Noise of a tabulated density."""

import numpy as np
import pytest

from schuler.exceptions import InputError
from schuler.sensors import Coloured, GaussMarkov, White

RATE = 50.0
F = np.linspace(0.0, 0.5 * RATE, 1001)


def like(process) -> Coloured:
    return Coloured(F, process.discrete_psd(F, 1.0 / RATE), RATE)


@pytest.mark.parametrize("process", [White(0.3), GaussMarkov(1.2, 0.4)], ids=str)
def test_it_is_the_process_whose_density_it_has(process):
    """Discretisation: lines between 1001 frequencies."""
    m = np.array([1, 2, 7, 100, 3000])
    coloured = like(process)
    np.testing.assert_allclose(
        coloured.discrete_allan_variance(m, 1.0 / RATE), process.discrete_allan_variance(m, 1.0 / RATE), rtol=5e-3
    )
    np.testing.assert_allclose(coloured.allan_variance(m / RATE), coloured.discrete_allan_variance(m, 1.0 / RATE))
    f = np.array([0.0, 0.013, 3.3, 25.0])
    np.testing.assert_allclose(coloured.psd(f), process.discrete_psd(f, 1.0 / RATE), rtol=5e-3)
    np.testing.assert_allclose(coloured.discrete_psd(RATE - f, 1.0 / RATE), coloured.psd(f))  # rounding
    np.testing.assert_array_equal(coloured.psd([26.0]), 0.0)


@pytest.mark.parametrize("runs", [500, pytest.param(2000, marks=pytest.mark.campaign)])
def test_samples_have_the_covariance(runs):
    """Statistical, 4.5 standard errors of so many series; odd and even lengths."""
    coloured = like(GaussMarkov(1.2, 0.4))
    for n in (30, 31):
        x = coloured.sample((n, runs), 1.0 / RATE, np.random.default_rng(4))
        C = coloured.autocovariance(np.arange(n) / RATE)
        for lag in (0, 1, 10, n - 1):
            product = (x[lag:] * x[: n - lag]).mean(axis=0)
            error = product.std() / np.sqrt(runs)
            assert abs(product.mean() - C[lag]) < 4.5 * error
    np.testing.assert_allclose(C[:3], GaussMarkov(1.2, 0.4).autocovariance(np.arange(3) / RATE), rtol=5e-3)


def test_one_series_has_the_allan_variance():
    """Statistical: 5 % at 60 clusters and more."""
    coloured = like(GaussMarkov(1.2, 0.4))
    x = coloured.sample(200_000, 1.0 / RATE, np.random.default_rng(5))
    for m in (1, 10, 100):
        c = np.convolve(x, np.ones(m) / m, "valid")
        got = 0.5 * np.mean((c[m:] - c[:-m]) ** 2)
        assert got == pytest.approx(float(coloured.allan_variance(m / RATE)), rel=0.05)


def covariance_between_lines(u, S, lags):
    """Covariance at lags 0 .. ``lags`` samples, by parts over each line; ``u`` in cycles per sample, rate 1."""
    k = np.arange(1, lags + 1)[:, None]
    slope, turn = np.diff(S) / np.diff(u), 2.0 * np.pi * k
    at = S * np.sin(turn * u) / turn
    pieces = np.diff(at, axis=1) + slope * np.diff(np.cos(turn * u), axis=1) / turn**2
    return np.concatenate(([2.0 * np.trapezoid(S, u)], 2.0 * pieces.sum(axis=1)))


@pytest.mark.parametrize(
    ("u", "S"),
    [
        ([0.0, 0.5], [1.0, 0.0]),
        ([0.0, 0.003, 0.02, 0.2, 0.5], [5.0, 1.0, 2.0, 0.0, 1.0]),
        ([0.0, *np.geomspace(1e-5, 0.5, 30)], [1e3, *1e-2 / np.geomspace(1e-5, 0.5, 30)]),
    ],
    ids=["one line", "few", "1/f"],
)
def test_allan_variance_is_that_of_the_covariance(u, S):
    """Rounding, of the reference where steep lines of the last case cancel; averaging times in one call and alone."""
    u, S = np.array(u), np.array(S)
    m = np.array([1, 2, 3, 7, 32, 400, 1000])
    r = covariance_between_lines(u, S, 2 * m[-1])
    once, twice = np.cumsum([r[0], *(2.0 * r[1:])]), np.cumsum(2.0 * np.arange(len(r)) * r)
    V = {k: k * once[k - 1] - twice[k - 1] for k in (*m.tolist(), *(2 * m).tolist())}
    expected = [(4.0 * V[k] - V[2 * k]) / (2.0 * k**2) for k in m.tolist()]
    coloured = Coloured(u * RATE, S / RATE, RATE)
    got = coloured.allan_variance(m / RATE)
    np.testing.assert_allclose(got, expected, rtol=1e-8)
    np.testing.assert_allclose([coloured.allan_variance(k / RATE) for k in m], got, rtol=1e-13)
    np.testing.assert_allclose(coloured.allan_variance(2.25 / RATE), 0.75 * got[1] + 0.25 * got[2], rtol=1e-12)


def test_the_longest_averaging_time_of_a_day_needs_no_memory():
    """White noise, rounding; 5 million samples of averaging took an array of 80 million numbers."""
    import tracemalloc

    white, m = Coloured(F, np.full(len(F), 0.09), RATE), np.array([1, 1000, 5_000_000])
    tracemalloc.start()
    got = white.allan_variance(m / RATE)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    np.testing.assert_allclose(got, 0.09 * RATE / m, rtol=1e-12)
    assert peak < 10e6


def test_it_adds_to_other_terms():
    model = White(0.1) + like(White(0.3))
    assert float(model.allan_variance(1.0)) == pytest.approx(0.1, rel=1e-3)
    assert model.sample(10, 1.0 / RATE, np.random.default_rng(1)).shape == (10,)


def test_what_it_cannot_do_is_said():
    coloured = like(White(0.3))
    with pytest.raises(InputError, match=r"expected 0\.02 s"):
        coloured.sample(10, 0.01, np.random.default_rng(1))
    for attempt in (coloured.state_space, lambda: coloured.sampled(0.02)):
        with pytest.raises(InputError, match="no finite state space"):
            attempt()
    with pytest.raises(InputError, match="half the rate, 25 Hz"):
        Coloured(F[:-1], F[:-1], RATE)
    with pytest.raises(InputError, match="no negative"):
        Coloured(F, F - 1.0, RATE)
