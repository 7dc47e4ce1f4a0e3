"""The statistics that judge a filter: their distribution, and what they refuse."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
from scipy import stats

from schuler import rotation
from schuler.exceptions import InputError
from schuler.filtering.states import StateLayout, StateModel
from schuler.navigation.evaluation import consistency
from schuler.navigation.evaluation.consistency import chi_square_band, nees, state_errors
from schuler.recording.trajectory import Trajectory

LAYOUT = StateLayout({"b_a": StateModel.constant(1.0)})


def drawn(rng, k, scale=1.0):
    """A stand-in for a result: errors drawn from a full covariance whose elements span many orders, and the truth."""
    n = LAYOUT.size
    A = rng.standard_normal((n, n)) + 2.0 * np.eye(n)
    sigma = np.repeat([1e-4, 1e-2, 1.0, 1e-5], 3)
    P = sigma[:, None] * (A @ A.T / n) * sigma
    dx = rng.multivariate_normal(np.zeros(n), P, size=k, method="cholesky") * scale
    t = np.arange(float(k))
    truth = Trajectory(t, np.tile([6.4e6, 0.0, 0.0], (k, 1)), np.zeros((k, 3)), np.tile([1.0, 0.0, 0.0, 0.0], (k, 1)))
    states = Trajectory(
        t,
        truth.r_eb_e + dx[:, 6:9],
        dx[:, 3:6],
        rotation.quat_multiply(rotation.quat_from_rotvec(dx[:, :3]), truth.q_eb),
    )
    parameters = 0.5 + dx[:, 9:]
    covariance_e = np.broadcast_to(P, (k, n, n))
    return (
        SimpleNamespace(t=t, states=states, parameters=parameters, covariance_e=covariance_e, layout=LAYOUT),
        truth,
        dx,
    )


def test_state_errors_are_those_put_in(rng):
    result, truth, dx = drawn(rng, 200)
    t, errors, P = state_errors(result, truth, np.full(3, 0.5))
    np.testing.assert_array_equal(t, result.t)
    np.testing.assert_allclose(errors, dx, rtol=1e-6, atol=2e-9)  # rounding of 6.4e6 m
    assert P.shape == (200, 12, 12)
    assert state_errors(result, truth)[1].shape == (200, 9)


def test_nees_is_chi_square(rng):
    result, truth, _ = drawn(rng, 4000)
    values = 12.0 * nees(result, truth, np.full((4000, 3), 0.5))
    assert stats.kstest(values, stats.chi2(12).cdf).pvalue > 1e-3  # statistical
    low, high = chi_square_band(12, 4000, 0.999)
    assert low < values.mean() / 12.0 < high


def test_nees_sees_an_overconfident_filter(rng):
    result, truth, _ = drawn(rng, 500, scale=1.3)
    assert nees(result, truth, np.full(3, 0.5)).mean() > chi_square_band(12, 500, 0.999)[1]


@pytest.mark.parametrize(("degrees", "runs"), [(1, 1), (3, 50), (15, 100)])
def test_band_is_the_chi_square_quantile(degrees, runs):
    low, high = chi_square_band(degrees, runs, 0.95)
    expected = stats.chi2(degrees * runs).ppf([0.025, 0.975]) / (degrees * runs)
    np.testing.assert_allclose([low, high], expected, rtol=1e-9)  # rounding of two libraries


def test_records_outside_the_reference_are_left_out(rng):
    result, truth, _ = drawn(rng, 20)
    t, dx, P = state_errors(result, truth.between(5.0, 9.5))
    np.testing.assert_array_equal(t, np.arange(5.0, 10.0)[:5])
    assert len(dx) == len(P) == 5


def test_what_cannot_be_compared_is_refused(rng):
    result, truth, _ = drawn(rng, 5)
    with pytest.raises(InputError, match="need a reference with velocity and attitude"):
        nees(result, Trajectory(truth.t, truth.r_eb_e))
    with pytest.raises(InputError, match=r"parameters: expected shape \(3,\) or \(5, 3\), got \(2,\)"):
        nees(result, truth, np.zeros(2))


def test_the_size_of_errors_under_a_singular_covariance_is_refused_in_words(monkeypatch):
    """Two states that are one ended in numpy's LinAlgError; records with variances that are none have no number."""
    cov = np.tile(np.eye(2), (3, 1, 1))
    monkeypatch.setattr(consistency, "state_errors", lambda *_: (np.arange(3.0), np.ones((3, 2)), cov))
    np.testing.assert_array_equal(consistency.nees(None, None), 1.0)
    cov[1, 0, 0] = -1.0
    np.testing.assert_array_equal(consistency.nees(None, None), [1.0, np.nan, 1.0])
    cov[2] = 1.0
    with pytest.raises(InputError, match="can be inverted, got a singular one"):
        consistency.nees(None, None)
