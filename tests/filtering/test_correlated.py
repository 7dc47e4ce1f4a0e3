"""GNSS solutions with slow errors: honest with Gauss-Markov states for them, over-confident without."""

from __future__ import annotations

import aided_cases as ac
import numpy as np
import pytest

from schuler.filtering.states import StateModel
from schuler.navigation.evaluation.consistency import chi_square_band

RUNS = [16, pytest.param(40, marks=pytest.mark.campaign), pytest.param(400, marks=pytest.mark.slow)]


@pytest.fixture(scope="module")
def drive():
    return ac.Drive.of(ac.town(2.0), 120.0)


@pytest.mark.parametrize("runs", RUNS)
@pytest.mark.parametrize("blocks", [("b_r",), ("b_v",), ("b_r", "b_v")])
def test_honest_with_states_for_them(drive, blocks, runs):
    ac.Campaign.of(drive, ac.layout(*blocks), [ac.gnss], range(runs)).check()


@pytest.mark.parametrize("runs", RUNS)
def test_nees_with_wheels_and_surveyed_places_is_in_band(drive, runs):
    lay = ac.layout("b_r", "b_v", "mount", "lever_v")
    ac.Campaign.of(drive, lay, [ac.gnss, ac.wheels, ac.known_places], range(runs)).check()


@pytest.mark.parametrize(("blocks", "nees", "nis"), [(("b_r",), 5.0, 1.05), (("b_v",), 4.0, 1.5)])
def test_over_confident_without_them(drive, blocks, nees, nis):
    """The same errors taken for white: NEES far above one; of positions the innovations hardly show it."""
    lay = ac.layout(*blocks)
    c = ac.Campaign.of(drive, lay, [ac.gnss], range(10), filter_layout=ac.layout())
    assert c.nees[:, [30, 60, 90, 115]].mean() > nees, c.nees[:, [30, 60, 90, 115]].mean()
    assert c.nis.mean() > nis, c.nis.mean()


def test_larger_white_noise_is_not_the_same(drive):
    """Inflated to the whole variance, an error of a minute still averages out in the filter but not in truth.

    Position claims are then up to the root of the samples per correlation time too small.
    """
    from dataclasses import replace

    def inflated(truth):
        s = ac.gnss(truth)
        extra = np.where(s.kind[:, None, None] == 1, 4.0 * np.eye(3), 0.0)
        return replace(s, R=s.R + extra)

    c = ac.Campaign.of(drive, ac.layout("b_r"), [inflated], range(20), filter_layout=ac.layout())
    assert c.nees[:, [60, 90, 115]].mean() > 1.5
    right = ac.Campaign.of(drive, ac.layout("b_r"), [ac.gnss], range(20))
    assert right.nees[:, [60, 90, 115]].mean() < 1.3


def test_uncertainty_does_not_average_below_the_slow_error(drive):
    """With the states the position stays as uncertain as its start (0.8 m), without them a fraction is claimed."""
    lay = ac.layout("b_r")
    honest = ac.filtered(drive, lay, [ac.gnss], 0).result.sigma("dr")[-1]
    naive = ac.filtered(drive, lay, [ac.gnss], 0, filter_layout=ac.layout()).result.sigma("dr")[-1]
    slow = lay.models["b_r"].sigma
    assert np.all(honest > 0.4 * slow)
    assert np.all(naive < 0.4 * honest)


@pytest.mark.parametrize("sign", [-1.0, 1.0])
def test_surveyed_places_show_a_long_lasting_error(drive, sign):
    """The slow error of positions is observable against fixes of 0.3 m, with either sign."""
    lay = ac.layout(b_r=StateModel.gauss_markov(2.0, 2000.0))
    given = {"b_a": 0.0, "b_g": 0.0, "b_r": sign * np.array([2.0, -2.0, 2.0])}
    one = ac.filtered(drive, lay, [ac.gnss, ac.known_places], 0, given=given)
    error = one.result.parameter("b_r")[-1] - one.parameters[-1, 6:9]
    sigma = one.result.sigma("b_r")[-1]
    assert np.all(sigma < 0.5)
    assert np.all(np.abs(error) < 4.5 * sigma)  # statistical


def test_estimates_decay_in_an_outage(drive):
    """Nothing is learned after 60 s: the estimates go to zero with their correlation times, sigmas to stationary."""
    lay = ac.layout("b_r", "b_v")
    one = ac.filtered(drive, lay, [lambda truth: ac.gnss(truth, keep=lambda t: t < 60.0)], 3)
    t = one.result.t[60:, None]
    for name in ("b_r", "b_v"):
        model, values = lay.models[name], one.result.parameter(name)[60:]
        np.testing.assert_allclose(values, values[0] * np.exp(-(t - t[0]) / model.tau), rtol=1e-9)  # rounding
        assert np.abs(values[0]).max() > 0.1 * model.sigma
        spread = one.result.sigma(name)[60:]
        left = model.sigma**2 - spread[0] ** 2
        # discretisation of the driving noise over steps of 0.1 s
        expected = np.sqrt(model.sigma**2 - left * np.exp(-2.0 * (t - t[0]) / model.tau))
        np.testing.assert_allclose(spread, expected, rtol=1e-3)


def test_smoothed_solution_is_honest_too(drive):
    from schuler.navigation.evaluation.consistency import nees

    lay = ac.layout("b_r", "b_v")
    values = []
    for seed in range(25):
        one = ac.filtered(drive, lay, [ac.gnss], seed, smoother=True)
        values.append(nees(one.result.smooth(), one.truth.reference, one.parameters))
    low, high = chi_square_band(lay.size, 25, 0.9999)
    at = np.array(values)[:, [5, 30, 60, 90, 115]].mean(axis=0)
    assert np.all((at > low) & (at < high)), (low, at, high)
