"""The range budget: limits, monotony, parts that add in squares."""

import numpy as np
import pytest

from schuler.exceptions import InputError
from schuler.gnss.weighting import SIGNAL_IN_SPACE, Weighting, noise_scale, range_sigmas
from schuler.units import DEG

UP = 90.0 * DEG


def test_a_strong_satellite_overhead_has_scale_one():
    for scheme in ("elevation", "cn0", "elevation+cn0", "equal"):
        assert noise_scale(UP, 50.0, scheme) == pytest.approx(1.0)


def test_scales():
    E = np.array([90.0, 30.0, 10.0]) * DEG
    assert np.allclose(noise_scale(E, 45.0, "elevation"), np.sqrt(0.5 + 0.5 / np.sin(E) ** 2), rtol=1e-14)
    assert np.allclose(noise_scale(E, [45.0, 39.0, 25.0], "cn0"), [1.0, 10.0**0.3, 10.0], rtol=1e-14)
    assert np.allclose(noise_scale(E, [25.0, 45.0, 45.0], "elevation+cn0")[:2], [10.0, np.sqrt(2.5)], rtol=1e-14)
    assert np.array_equal(noise_scale(E, 20.0, "equal"), np.ones(3))


def test_unknown_strength_counts_as_strong_and_below_the_horizon_is_finite():
    assert noise_scale(UP, np.nan, "cn0") == 1.0
    assert noise_scale(-0.2, 45.0, "elevation") == noise_scale(2.0 * DEG, 45.0, "elevation")


def test_sigmas_grow_towards_the_horizon_and_with_weakness():
    E = np.linspace(3.0, 90.0, 50) * DEG
    sigma, rate = range_sigmas(Weighting(), np.full(50, 5), E, 45.0)
    assert np.all(np.diff(sigma) < 0.0)
    assert np.all(np.diff(rate) < 0.0)
    sigma, rate = range_sigmas(Weighting(), np.full(31, 5), np.full(31, UP), np.linspace(15.0, 45.0, 31))
    assert np.all(np.diff(sigma) < 0.0)
    assert np.all(np.diff(rate) < 0.0)


def test_the_parts_add_in_squares():
    w = Weighting("equal", code=0.4, rate=0.03, ionosphere_share=0.5, zenith_troposphere=0.1)
    sigma, rate = range_sigmas(
        w, [1], [30.0 * DEG], [45.0], accuracy=2.0, ionosphere=1.5, noise_factor=2.5, unknown_delay=1.0
    )
    parts = [0.4 * 2.5, SIGNAL_IN_SPACE["G"], 1.5, 0.1 / 0.5, 1.0]
    assert sigma[0] == pytest.approx(np.sqrt(np.sum(np.square(parts))), rel=1e-14)
    assert rate[0] == 0.03
    alone, _ = range_sigmas(w, [1], [30.0 * DEG], [45.0], troposphere=False)
    assert alone[0] == pytest.approx(np.hypot(0.4, 0.6), rel=1e-14)


def test_a_message_that_claims_little_accuracy_is_believed():
    w = Weighting("equal", zenith_troposphere=0.0)
    usual, poor, unknown = (range_sigmas(w, [1], [UP], [45.0], accuracy=a)[0][0] for a in (2.0, 96.0, np.nan))
    assert usual == unknown == pytest.approx(np.hypot(0.5, 0.6))
    assert poor == pytest.approx(np.hypot(0.5, 24.0))


def test_systems_differ():
    sigma, _ = range_sigmas(Weighting("equal", zenith_troposphere=0.0), [1, 105, 211], [UP] * 3, [45.0] * 3)
    assert sigma[1] > sigma[0] > sigma[2]


@pytest.mark.parametrize(
    "options",
    [{"scheme": "sine"}, {"code": 0.0}, {"rate": -1.0}, {"ionosphere_share": -0.1}, {"zenith_troposphere": np.nan}],
)
def test_impossible_budgets_are_refused(options):
    with pytest.raises(InputError, match="weighting"):
        Weighting(**options)
