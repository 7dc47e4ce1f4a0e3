"""The rule that recommends a rate, on sweeps whose answer is known."""

import numpy as np
import pytest

from schuler.exceptions import InputError
from schuler.reproduce.du.study.imus import emulation
from schuler.reproduce.du.study.rates import recommended_rate
from schuler.reproduce.du.study.static import StaticTest
from schuler.units import DEG

RATES = np.array([10.0, 20.0, 30.0, 50.0, 100.0])


def sweep(means, *, runs=200, scatter=0.3, shared=True, rates=RATES):
    """A sweep of given means; runs scatter alike at all rates or each by itself."""
    rng = np.random.default_rng(2)
    draw = 1.0 + scatter * rng.standard_normal((1 if shared else len(rates), runs))
    values = np.asarray(means)[:, None, None] * np.abs(draw)[:, :, None] * np.ones(7)
    values /= np.mean(np.abs(draw), axis=1)[:, None, None]
    one = np.ones((runs, 7))
    return StaticTest(emulation("NAV440"), 300.0, one, rates * DEG, {"I": values, "II": values}, 0)


def test_the_slowest_of_equal_rates():
    assert recommended_rate(sweep([1.0, 1.0, 1.0, 1.0, 1.0])).rate == pytest.approx(10.0 * DEG)


def test_the_knee_of_a_curve():
    """25 % above at 10 deg/s, 4 % at 20: the second; with a tolerance of 1 % a later one."""
    result = sweep([1.25, 1.04, 1.0, 1.0, 1.0])
    assert recommended_rate(result).rate == pytest.approx(20.0 * DEG)
    assert recommended_rate(result, tolerance=0.01).rate == pytest.approx(30.0 * DEG)
    assert recommended_rate(result).confidence == 1.0


def test_the_fastest_if_it_is_far_better():
    assert recommended_rate(sweep([5.0, 4.0, 3.0, 2.0, 1.0])).rate == pytest.approx(100.0 * DEG)


def test_order_and_sign_of_the_rates_do_not_matter():
    order = np.array([3, 0, 4, 1, 2])
    means = np.array([1.25, 1.04, 1.0, 1.0, 1.0])
    result = recommended_rate(sweep(means[order], rates=-RATES[order]))
    assert result.rate == pytest.approx(-20.0 * DEG)
    assert [row[0] for row in result.table().rows] == [-10.0, -20.0, -30.0, -50.0, -100.0]


def test_doubt_is_told():
    """At the edge of the rule, with runs that scatter each by themselves, resampled campaigns disagree."""
    result = recommended_rate(sweep([1.1, 1.0, 1.0, 1.0, 1.0], shared=False, scatter=0.5, runs=60))
    assert 0.2 < result.confidence < 0.9


def test_wrong_questions():
    result = sweep([1.0] * 5)
    with pytest.raises(InputError, match="tolerance"):
        recommended_rate(result, tolerance=-0.1)
    with pytest.raises(InputError, match="strategy"):
        recommended_rate(result, strategy="conventional")
    with pytest.raises(InputError, match="quantity"):
        recommended_rate(result, quantity="speed")
