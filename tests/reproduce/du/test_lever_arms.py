"""Lever arms that turn, and an IMU off the axis: nothing is left of them if they are modelled."""

from functools import cache

import numpy as np
import pytest

from schuler.exceptions import InputError
from schuler.navigation.evaluation.consistency import chi_square_band
from schuler.reproduce.du.study.imus import NAV440
from schuler.reproduce.du.study.lever_arms import VARIANTS, LeverCase, lever_study
from schuler.units import DEG

RUNS = 6


@cache
def study(reverses):
    case = LeverCase(NAV440, 60.0 * DEG if reverses else 20.0 * DEG, reverses, offset_m=(0.1, 0.0, 0.0), length_s=150.0)
    return lever_study(case, RUNS, seed=2, workers=2)


@pytest.mark.parametrize("reverses", [False, True], ids=["continuous", "reciprocating"])
def test_what_is_modelled_is_removed(reverses):
    result = study(reverses)
    low, high = chi_square_band(15, RUNS, 0.999)
    # statistical; biases do not wander here, so the filter is a little too careful
    assert 0.8 * low < result.of("modelled", "nees").mean() < high
    fixes = 2 * 3 * 149 * RUNS
    low, high = chi_square_band(fixes, 1, 0.9999)
    assert low < result.of("modelled", "nis").mean() < high


def test_what_is_not_modelled_is_seen():
    steady, rocking = study(False), study(True)
    # a steady offset is a bias of rate^2 offset = 12 mm/s^2; with reversals of 60 deg/s it is 110 and comes and goes
    assert steady.of("no offset", "accel_bias_m_s2").mean() == pytest.approx((20.0 * DEG) ** 2 * 0.1, rel=0.5)
    assert np.all(rocking.of("no offset", "nis") > 1.5)
    assert np.all(rocking.of("no offset", "nees") > 20.0)
    for result in (steady, rocking):
        for variant in VARIANTS[2:]:
            assert np.all(result.of(variant, "nis") > 1.5)
            assert np.all(result.of(variant, "horizontal_m") > 3.0 * result.of("modelled", "horizontal_m").mean())


def test_table_and_errors():
    result = study(False)
    assert [row[0] for row in result.table().rows] == list(VARIANTS)
    assert "continuous at 20 deg/s" in result.summary()
    assert result.to_dict()["rows"][0]["nis"] == pytest.approx(result.of("modelled", "nis").mean())
    with pytest.raises(InputError, match="no lever rate"):
        result.of("nothing", "nis")
