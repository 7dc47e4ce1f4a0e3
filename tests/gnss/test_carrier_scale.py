"""Range rates and carriers against the codes of their signal: what contradicts them is left out, or refused."""

from dataclasses import replace

import numpy as np
import pytest

from schuler.exceptions import InputError
from schuler.gnss.carrier_scale import check_carrier_scale, without_wrong_rates
from schuler.gnss.constellation import nominal_orbits
from schuler.gnss.preparation import prepare_ranges
from schuler.gnss.synthetic import RangeErrors, synthetic_ranges

EPOCH = 1.3e9
T = np.arange(0.0, 30.0)
PLACE = np.array([4.177e6, 8.55e5, 4.727e6])


@pytest.fixture(scope="module")
def sky():
    made = synthetic_ranges(
        T, np.tile(PLACE, (len(T), 1)), np.zeros((len(T), 3)), nominal_orbits("GE"), np.random.default_rng(3),
        RangeErrors(noise=1.0), epoch_gps_s=EPOCH,
    )  # fmt: skip
    return made.observations()


def scaled(o, factor, system=None):
    mine = np.ones(len(o.t), dtype=bool) if system is None else o.sat // 100 == system
    return replace(o, range_rate=np.where(mine, factor * o.range_rate, o.range_rate))


def test_rates_that_go_with_their_codes_stay_as_they_are(sky):
    same, notes = without_wrong_rates(sky, "GE")
    assert same is sky
    assert not notes


@pytest.mark.parametrize(
    ("factor", "what"),
    [(-1.0, "of the other sign"), (0.19, "in another unit"), (-0.1903, "in m/s"), (0.78, "of another band")],
)
def test_rates_of_another_sign_or_unit_are_left_out_and_noted(sky, factor, what):
    left, notes = without_wrong_rates(scaled(sky, factor), "GE")
    assert np.isnan(left.range_rate).all()
    assert len(notes) == 2
    assert all(what in note for note in notes)


def test_only_the_system_that_is_wrong_loses_its_rates(sky):
    left, notes = without_wrong_rates(scaled(sky, -1.0, system=0), "GE")
    gps = sky.sat // 100 == 0
    assert np.isnan(left.range_rate[gps]).all()
    assert np.array_equal(left.range_rate[~gps], sky.range_rate[~gps])
    assert len(notes) == 1


def test_few_epochs_decide_nothing(sky):
    wrong = scaled(sky, -1.0)
    start = wrong.where(wrong.t < 0.5)
    assert without_wrong_rates(start, "GE")[0] is start


def test_ranges_are_prepared_without_them(sky):
    ephemerides = nominal_orbits("GE").ephemerides(EPOCH, EPOCH + 30.0)
    right = prepare_ranges(sky, ephemerides, ionosphere="none")
    wrong = prepare_ranges(scaled(sky, -1.0), ephemerides, ionosphere="none")
    assert np.isnan(wrong.range_rate).all()
    np.testing.assert_allclose(wrong.pseudorange, right.pseudorange, rtol=0.0, atol=1e-3)  # the receiver clock's drift
    assert any("of the other sign" in note for note in wrong.notes)


def fast_sky(noise):
    """Ten times a second ranges change by some 45 m."""
    t = np.arange(0.0, 20.0, 0.1)
    made = synthetic_ranges(
        t, np.tile(PLACE, (len(t), 1)), np.zeros((len(t), 3)), nominal_orbits("GE"), np.random.default_rng(4),
        RangeErrors(noise=noise), epoch_gps_s=EPOCH,
    )  # fmt: skip
    return made.observations()


@pytest.mark.parametrize("noise", [15.0, 60.0, 200.0])
def test_codes_that_scatter_as_much_as_ranges_change_blame_nothing(noise):
    o = fast_sky(noise)
    for system in "GE":
        check_carrier_scale(o, system, "1C", "rover")
    assert without_wrong_rates(o, "GE")[0] is o


def test_noisy_codes_do_not_make_the_quotient_too_small():
    """Of changes that are large by their codes, noise of 15 m made many so: the quotient would be off by a tenth."""
    o = fast_sky(15.0)
    with pytest.raises(InputError, match="carriers in metres"):
        check_carrier_scale(replace(o, carrier=0.190294 * o.carrier), "G", "1C", "rover")


def test_carriers_that_do_not_change_are_refused(sky):
    with pytest.raises(InputError, match=r"changes 0\.000 times as much"):
        check_carrier_scale(replace(sky, carrier=np.full(len(sky.t), 1e8)), "G", "1C", "rover")
