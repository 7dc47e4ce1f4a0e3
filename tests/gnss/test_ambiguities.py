"""LAMBDA: a published example, brute force, laws of the transformation, success rates against counting."""

import numpy as np
import pytest

from schuler.exceptions import InputError
from schuler.gnss.ambiguities import decorrelate, fix_ambiguities, integer_least_squares, success_rate

# de Jonge and Tiberius (1996), section 3: three ambiguities
A = np.array([5.450, 3.100, 2.970])
Q = np.array([[6.290, 5.978, 0.544], [5.978, 6.292, 2.340], [0.544, 2.340, 6.288]])


def problem(rng, n):
    """Correlated as after a short time: three position components make most of it."""
    U = rng.normal(size=(n, min(n, 3)))
    S = rng.uniform(0.05, 1.0) * U @ U.T + rng.uniform(0.001, 0.1) * np.eye(n)
    return rng.uniform(-1000.0, 1000.0, n), S


def brute_force(a, S, limit):
    """Smallest two squared norms among all integer vectors within the ellipsoid of the given norm."""
    reach = np.ceil(np.sqrt(limit * np.diag(S))).astype(int) + 1
    axes = [np.arange(-m, m + 1) + np.rint(x) for m, x in zip(reach, a, strict=True)]
    grid = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, len(a))
    norms = np.einsum("ij,jk,ik->i", a - grid, np.linalg.inv(S), a - grid)
    order = np.argsort(norms)[:2]
    return grid[order], norms[order]


def test_the_published_example():
    z, norms = integer_least_squares(A, Q)
    assert z.tolist() == [[5, 3, 4], [6, 4, 4]]
    np.testing.assert_allclose(norms, [0.2183, 0.3073], atol=5e-5)  # printed digits


def test_the_published_decorrelation():
    Z, L, d = decorrelate(Q)
    S = Z.T @ Q @ Z
    np.testing.assert_allclose(L.T @ np.diag(d) @ L, S, atol=1e-12)  # rounding
    assert abs(round(np.linalg.det(Z))) == 1
    assert np.max(np.abs(np.tril(L, -1))) <= 0.5
    np.testing.assert_allclose(np.sort(np.diag(S)), [0.626, 1.146, 4.476], atol=5e-4)  # printed digits


def _against_brute_force(seed, count):
    rng = np.random.default_rng(seed)
    tried = 0
    while tried < count:
        a, S = problem(rng, rng.integers(1, 5))
        z, norms = integer_least_squares(a, S)
        if np.prod(2.0 * np.sqrt(norms[1] * np.diag(S)) + 5.0) > 2e5:
            continue
        grid, expected = brute_force(a, S, norms[1])
        np.testing.assert_allclose(norms, expected, rtol=1e-6)  # rounding of an ill-conditioned inverse
        assert np.array_equal(z[0], grid[0])
        tried += 1


def test_no_vector_is_nearer():
    _against_brute_force(1, 300)


@pytest.mark.campaign
def test_no_vector_is_nearer_in_ten_thousand_problems():
    _against_brute_force(2, 10_000)


def test_more_candidates_come_in_order():
    z, norms = integer_least_squares(A, Q, candidates=6)
    assert np.all(np.diff(norms) >= 0.0)
    assert len(np.unique(z, axis=0)) == 6
    np.testing.assert_allclose(norms, np.einsum("ij,jk,ik->i", A - z, np.linalg.inv(Q), A - z), rtol=1e-9)  # rounding


def test_thirty_ambiguities_of_two_bands():
    rng = np.random.default_rng(3)
    U = rng.normal(size=(30, 3))
    S, truth = 5.0 * U @ U.T + 1e-4 * np.eye(30), rng.integers(-(10**6), 10**6, 30)
    z, _ = integer_least_squares(truth + np.linalg.cholesky(S) @ rng.standard_normal(30), S)
    assert np.array_equal(z[0], truth)


def test_the_success_rate_is_how_often_bootstrapping_is_right():
    d = np.array([0.04, 0.09, 0.02])
    rng = np.random.default_rng(4)
    right = np.all(np.rint(np.sqrt(d) * rng.standard_normal((20_000, 3))) == 0.0, axis=1)
    p = success_rate(d)  # independent ambiguities: rounding is bootstrapping
    assert abs(np.mean(right) - p) < 4.0 * np.sqrt(p * (1.0 - p) / 20_000)  # statistical


def test_a_part_is_fixed_where_all_cannot_be():
    S = np.diag([4.0, 0.001, 0.002, 9.0, 0.0005])
    truth = np.array([7, -3, 12, 5, 100])
    fix = fix_ambiguities(truth + np.array([0.4, 0.01, -0.02, 0.3, 0.005]), S)
    assert fix.accepted
    assert len(fix.integers) == 3
    assert np.array_equal(fix.integers, fix.Z[:, 2:].T @ truth)
    assert fix.success_rate >= 0.999
    assert not fix_ambiguities(truth, S, partial=False).accepted
    nothing = fix_ambiguities(truth, np.eye(5))
    assert not nothing.accepted
    assert len(nothing.integers) == 0


def test_halfway_between_integers_is_refused():
    fix = fix_ambiguities([0.5, 3.0], 1e-3 * np.eye(2))
    assert not fix.accepted
    assert fix.ratio == pytest.approx(1.0)


@pytest.mark.parametrize(
    ("S", "message"),
    [
        (np.ones((2, 2)), "positive definite"),
        ([[1.0, 0.5], [0.0, 1.0]], "symmetric"),
        (np.ones((2, 3)), "square"),
        ([[np.nan]], "Q"),
    ],
)
def test_what_is_no_covariance(S, message):
    with pytest.raises(InputError, match=message):
        decorrelate(S)


def test_options_that_make_no_sense():
    for wrong in ({"ratio": 0.5}, {"least_success": 1.0}):
        with pytest.raises(InputError, match=next(iter(wrong))):
            fix_ambiguities(A, Q, **wrong)
    with pytest.raises(InputError, match="candidates"):
        integer_least_squares(A, Q, candidates=0)
    with pytest.raises(InputError, match="d: expected positive"):
        success_rate([0.1, 0.0])
