"""Degrees of freedom and correlation of Allan variances that follow from a spectrum."""

import numpy as np
import pytest

from schuler.characterisation import moments
from schuler.characterisation.variance import allan_variances, integrate_signal
from schuler.sensors.noise import Flicker, GaussMarkov, Process, RandomWalk, White

DT = 0.1
M = 2 ** np.arange(10)


def variances(process: Process, n: int, runs: int, seed: int = 1) -> np.ndarray:
    """Overlapping Allan variances of ``runs`` realisations, shape (runs, len(M))."""
    rng = np.random.default_rng(seed)
    return np.array(
        [
            allan_variances(integrate_signal(process.sample(n, DT, rng), "rate", DT), "overlapping", M)[0]
            for _ in range(runs)
        ]
    )


@pytest.mark.thinned(3)
@pytest.mark.parametrize(
    "process", [White(1.0), GaussMarkov(1.0, 3.0), White(1.0) + Flicker(0.5), RandomWalk(0.3)], ids=str
)
def test_degrees_of_freedom_are_those_of_simulated_logs(process):
    """Statistical: an edf from 1500 variances is good to 2 / sqrt(1500) = 5 % for many degrees of freedom; heavier
    tails of few make it 10 %; quadrature adds up to 5 %."""
    n, runs = 4096, 1500
    v = variances(process, n, runs)
    simulated = 2.0 * v.mean(axis=0) ** 2 / v.var(axis=0)
    edf = moments.degrees_of_freedom(M, np.array([n]), DT, lambda f: process.discrete_psd(f, DT))
    np.testing.assert_allclose(edf[:-1] / simulated[:-1], 1.0, atol=0.18)
    assert abs(np.mean(edf / simulated) - 1.0) < 0.06


def test_white_noise_has_the_degrees_of_freedom_of_its_closed_form():
    """Howe, Allan and Barnes (1981) for white frequency noise: (3 (n - 1) / (2 m) - 2 (n - 2) / n) 4 m^2 / (4 m^2 + 5),
    n phases; an approximation of 5 % itself."""
    n = 100_000
    edf = moments.degrees_of_freedom(M, np.array([n]), DT, np.ones_like)
    closed = (1.5 * n / M - 2.0) * 4.0 * M**2 / (4.0 * M**2 + 5.0)
    np.testing.assert_allclose(edf, closed, rtol=0.06)


def test_two_records_have_the_degrees_of_freedom_of_both():
    psd = np.ones_like
    one = moments.degrees_of_freedom(M, np.array([5000]), DT, psd)
    np.testing.assert_allclose(moments.degrees_of_freedom(M, np.array([5000, 5000]), DT, psd), 2.0 * one, rtol=1e-12)


@pytest.mark.thinned(3)
@pytest.mark.parametrize("process", [White(1.0), RandomWalk(0.3), White(1.0) + GaussMarkov(1.0, 3.0)], ids=str)
def test_correlation_is_that_of_simulated_logs(process):
    """Statistical: a correlation from 1500 pairs is good to 0.026; the formula is that of long records, so the longest
    averaging times of this short one are left out."""
    n = 8192
    v = variances(process, n, 1500)[:, :8]
    C = moments.correlation(M[:8], DT, n * DT, lambda f: process.discrete_psd(f, DT))
    np.testing.assert_allclose(C, np.corrcoef(v.T), atol=0.1)
    assert np.allclose(np.diag(C), 1.0)  # rounding
    assert np.linalg.eigvalsh(C).min() > 0.0


def test_the_transfer_function_gives_back_the_allan_variance():
    """Discretisation: trapezoids over 20 000 frequencies."""
    process = GaussMarkov(1.3, 2.0)
    f = np.geomspace(1e-6, 0.5 / DT * (1 - 1e-12), 20_000)
    m = np.array([1, 3, 10, 100])
    H = moments.transfer(f, m, DT)
    S = process.discrete_psd(f, DT)
    got = 2.0 * np.trapezoid(S * H, f, axis=1)
    np.testing.assert_allclose(got, process.discrete_allan_variance(m, DT), rtol=2e-3)
