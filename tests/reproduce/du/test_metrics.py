"""Swings in errors that drift: closed forms, noise, faults."""

import numpy as np
import pytest

from schuler.exceptions import InputError
from schuler.reproduce.du.study.floor import noise_floor, noise_growth
from schuler.reproduce.du.study.metrics import swing_period, swing_size

T = np.arange(0.0, 300.0, 0.25)


@pytest.mark.parametrize("period", [12.0, 18.0, 36.0])
def test_a_swing_on_a_drift_is_found(period):
    """Period to half a bin, size to rounding of the fit: the drift is a cubic."""
    x = 1e-3 * T**2 - 2e-6 * T**3 + 0.3 * np.cos(2.0 * np.pi * T / period + 0.4)
    assert swing_period(T, x) == pytest.approx(period, abs=period**2 / 600.0)
    assert swing_size(T, x, period) == pytest.approx(0.3, rel=1e-9)
    assert swing_size(T, 1e-3 * T**2, period) < 1e-9


def test_a_random_walk_does_not_hide_it():
    """Its rate is white: of 50 walks as large as the swing none hides it; fixed seed."""
    rng = np.random.default_rng(4)
    for _ in range(50):
        walk = np.cumsum(0.02 * rng.standard_normal(len(T)))
        assert swing_period(T, np.sin(2.0 * np.pi * T / 18.0) + walk) == pytest.approx(18.0, abs=0.54)


def test_growth_of_noise_ends_in_the_floor():
    """Means over time of the squares are those of the floor; quadrature with 12000 points."""
    t = np.linspace(0.0, 300.0, 12001)
    attitude, velocity, position = noise_growth(1e-3, t)
    floor = noise_floor(1e-3, 300.0)
    for one, whole, axes in ((attitude, floor.attitude, 1), (velocity, floor.horizontal_velocity, 2),
                             (position, floor.horizontal_position, 2)):  # fmt: skip
        assert np.sqrt(axes * np.mean(one**2)) == pytest.approx(whole, rel=1e-3)


def test_what_has_no_swing_is_refused():
    with pytest.raises(InputError, match="16 samples"):
        swing_size(T[:5], T[:5], 10.0)
    with pytest.raises(InputError, match="evenly"):
        swing_period(T**2, T)
    with pytest.raises(InputError, match="as short as"):
        swing_period(T, T, longest=0.1)
    with pytest.raises(InputError, match="above zero"):
        swing_size(T, T, 0.0)
