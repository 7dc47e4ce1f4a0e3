"""Weighted linear least squares with words for what is not determined."""

import numpy as np
import pytest

from schuler.calibration.bench.linear_fit import describe_confounded, from_gain, linear_fit, response_design
from schuler.exceptions import InputError


def case(rng, m=12, p=4):
    A = rng.standard_normal((m, p)) * [1.0, 1e5, 1e-5, 1.0]
    L = np.diag(rng.uniform(0.5, 2.0, m)) + 0.2 * rng.standard_normal((m, m))
    return A, rng.standard_normal(m), L @ L.T, ["b", "s", "t", "u"]


def test_normal_equations(rng):
    """The textbook solution and covariance; rounding, with columns of very different size."""
    A, y, S, names = case(rng)
    fit = linear_fit(A, y, S, names)
    W = np.linalg.inv(S)
    N = A.T @ W @ A
    np.testing.assert_allclose(fit.values, np.linalg.solve(N, A.T @ W @ y), rtol=1e-9)
    np.testing.assert_allclose(fit.covariance, np.linalg.inv(N), rtol=1e-8)
    np.testing.assert_allclose(fit.gain @ y, fit.values, rtol=1e-12)
    np.testing.assert_allclose(fit.residuals, y - A @ fit.values)
    assert fit.chi2 == pytest.approx(fit.residuals @ W @ fit.residuals)
    assert (fit.freedom, fit.confounded) == (8, ())
    d = np.sqrt(np.diag(N))
    np.testing.assert_allclose(d[:, None] * (fit.gain @ A) / d, np.eye(4), atol=1e-12)
    assert fit.condition == pytest.approx(np.linalg.cond(N / np.outer(d, d)))


def test_variances_are_a_diagonal_covariance(rng):
    A, y, S, names = case(rng)
    v = np.diag(S)
    a, b = linear_fit(A, y, v, names), linear_fit(A, y, np.diag(v), names)
    np.testing.assert_array_equal(a.values, b.values)
    np.testing.assert_array_equal(a.covariance, b.covariance)


@pytest.mark.parametrize("m", [2, 9])
def test_what_is_left_open(rng, m):
    """b and s in the ratio 1 : 2 and nothing of u, with fewer and with more data than parameters."""
    A = rng.standard_normal((m, 4))
    A[:, 1], A[:, 3] = 2.0 * A[:, 0], 0.0
    truth = np.array([1.0, 1.0, -3.0, 9.0])
    fit = linear_fit(A, A @ truth, np.full(m, 0.01), ["b", "s", "t", "u"])
    assert fit.confounded == (("b", "s"), ("u",))
    assert fit.determined.tolist() == [False, False, True, False]
    np.testing.assert_allclose(fit.values, [0.0, 0.0, -3.0, 0.0], atol=1e-12)  # rounding
    assert np.isinf(np.diag(fit.covariance)).tolist() == [True, True, False, True]
    assert np.isinf(fit.condition)
    assert describe_confounded(fit.confounded) == [
        "b and s are not determined one by one, only a combination is",
        "u is not determined: nothing in the data changes with it",
    ]
    assert fit.freedom == m - 2


def test_nuisances_are_not_spoken_of():
    assert describe_confounded([("_a", "_b"), ("_a", "b", "s", "t")]) == [
        "b, s and t are not determined one by one, only a combination is"
    ]


def test_another_estimator(rng):
    """The mean of some data instead of all of them: unbiased, noisier, the same test of the residuals."""
    A, y, S = np.ones((6, 1)), rng.standard_normal(6), np.full(6, 0.25)
    gain = np.array([[0.5, 0.5, 0.0, 0.0, 0.0, 0.0]])
    fit, best = from_gain(A, y, S, ["b"], gain), linear_fit(A, y, S, ["b"])
    assert fit.values[0] == pytest.approx(y[:2].mean())
    assert (fit.covariance[0, 0], best.covariance[0, 0]) == pytest.approx((0.125, 0.25 / 6))
    assert fit.chi2 == best.chi2


def test_three_axes_side_by_side(rng):
    reference, theta = rng.standard_normal((5, 4)), rng.standard_normal((3, 4))
    readings = reference @ theta.T
    np.testing.assert_allclose(response_design(reference) @ theta.ravel(), readings.ravel())


def test_what_cannot_be():
    with pytest.raises(InputError, match="state the noise"):
        linear_fit(np.ones((2, 1)), np.ones(2), np.zeros(2), ["b"])
    with pytest.raises(InputError, match="2 variances or a covariance"):
        linear_fit(np.ones((2, 1)), np.ones(2), np.ones(3), ["b"])
