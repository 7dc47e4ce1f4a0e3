"""Discretisation, observability and steady state of the small models."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from schuler.exceptions import InputError
from schuler.reproduce.flenniken.study.heading import constant_bias, gauss_markov_bias, position_filter, split_bias
from schuler.reproduce.flenniken.study.heading.linear import steady_covariance

N, SIGMA, TAU = 0.05, 0.1, 300.0


def both(**changed):
    return split_bias(N, SIGMA, TAU, sigma_heading=0.2, sigma_constant=1.0, **changed)


def plane(**changed):
    given = {"sigma_constant": 0.1, "sigma_velocity": 0.05, "sigma_position": 1.0} | changed
    return position_filter(0.03, 0.024, 100.0, 0.6, **given)


@pytest.mark.parametrize("step", [0.1, 10.0, 300.0])
def test_gauss_markov_discretisation_is_the_closed_form(step):
    """Tolerance: the closed form cancels for a short step, to 1e-16 / (step / tau)^3 of its terms; else rounding."""
    d = gauss_markov_bias(N, SIGMA, TAU, sigma_heading=1.0).discrete(step)
    z, e = step / TAU, np.exp(-step / TAU)
    h1, v1 = TAU * (1.0 - e), 2.0 * SIGMA**2 * TAU**2 * (z - 1.0 + e)
    assert_allclose(d.Phi, [[1.0, -h1], [0.0, e]], rtol=1e-12, atol=1e-15)
    assert_allclose(d.Qd[1], [-(SIGMA**2) * TAU * (1.0 - e) ** 2, SIGMA**2 * (1.0 - e**2)], rtol=1e-9)
    wander = v1 - SIGMA**2 * h1**2
    assert_allclose(d.Qd[0, 0], N**2 * step + wander, rtol=1e-9 + 1e-14 / z**3 * wander / (N**2 * step))


@pytest.mark.parametrize("model", [both(walk=1e-4), plane(walk=1e-4)])
def test_two_half_steps_are_one(model):
    """Rounding."""
    one, half = model.discrete(2.0), model.discrete(1.0)
    assert_allclose(half.Phi @ half.Phi, one.Phi, atol=1e-13)
    assert_allclose(half.Phi @ half.Qd @ half.Phi.T + half.Qd, one.Qd, rtol=1e-10, atol=1e-16)
    assert_allclose(half.Phi @ half.Bd + half.Bd, one.Bd, atol=1e-12)


def test_input_is_held_over_the_step():
    """A reading of 0.1 rad/s against a bias estimate of 0.02 rad/s turns the heading by 0.08 rad a second."""
    d = constant_bias(N, sigma_heading=1.0, sigma_bias=1.0).discrete(2.0)
    assert_allclose(d.Phi @ [0.0, 0.02] + d.Bd[:, 0] * 0.1, [0.16, 0.02], rtol=1e-12)


def test_all_states_are_observable_while_the_bias_wanders():
    assert both().observability_rank() == 3
    assert plane().observability_rank() == 6
    frozen = split_bias(N, SIGMA, np.inf, sigma_heading=0.2, sigma_constant=1.0)
    assert frozen.observability_rank() == 2  # two constants cannot be told apart


def test_steady_state_is_where_the_recursion_ends():
    """Rounding of a recursion of 3000 updates."""
    model, R = gauss_markov_bias(N, SIGMA, TAU, sigma_heading=1.0), np.array([[0.2**2]])
    prior, posterior = steady_covariance(model, R, 1.0)
    d, P = model.discrete(1.0), model.P0
    for _ in range(3000):
        before = d.Phi @ P @ d.Phi.T + d.Qd
        K = before @ model.C.T / (model.C @ before @ model.C.T + R)
        P = before - K @ model.C @ before
    assert_allclose(before, prior, rtol=1e-8)
    assert_allclose(P, posterior, rtol=1e-8)


def test_no_steady_state_without_observation():
    model = gauss_markov_bias(N, SIGMA, TAU, sigma_heading=1.0)
    blind = type(model)(model.names, model.A, model.B, np.zeros((1, 2)), model.Q, model.P0)
    with pytest.raises(InputError, match="no steady state"):
        steady_covariance(blind, np.eye(1), 1.0)


def test_impossible_arguments_are_refused():
    with pytest.raises(InputError, match="positive correlation time"):
        gauss_markov_bias(N, SIGMA, 0.0, sigma_heading=1.0)
    with pytest.raises(InputError, match="positive duration"):
        both().discrete(0.0)


def test_remedy_for_the_velocity_across_the_track():
    """Without it the filter believes its velocity across the track to about a millimetre a second."""
    R, across = np.diag([0.05**2, 0.05**2, 1.0, 1.0]), np.array([-np.sin(0.6), np.cos(0.6)])
    sigma = []
    for model in (plane(walk=1e-5), plane(walk=1e-5, heading_sigma=0.02, acceleration=1.0)):
        d, P = model.discrete(1.0), model.P0
        for _ in range(300):
            P = d.Phi @ P @ d.Phi.T + d.Qd
            K = np.linalg.solve(model.C @ P @ model.C.T + R, model.C @ P).T
            P = P - K @ model.C @ P
        sigma.append(np.sqrt(across @ P[:2, :2] @ across))
    assert sigma[0] < 0.003
    assert sigma[1] > 0.015
