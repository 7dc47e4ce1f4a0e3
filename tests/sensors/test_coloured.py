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


def test_samples_have_the_covariance():
    """Statistical, 4.5 standard errors of 2000 series; odd and even lengths."""
    coloured = like(GaussMarkov(1.2, 0.4))
    for n in (30, 31):
        x = coloured.sample((n, 2000), 1.0 / RATE, np.random.default_rng(4))
        C = coloured.autocovariance(np.arange(n) / RATE)
        for lag in (0, 1, 10, n - 1):
            product = (x[lag:] * x[: n - lag]).mean(axis=0)
            error = product.std() / np.sqrt(2000)
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
