"""Carriers of two bands: what they part by is a slip, of the only satellite too, and nothing else parts them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from schuler import frames
from schuler.gnss.carrier import carrier_changes
from schuler.gnss.constellation import nominal_orbits
from schuler.gnss.cycle_slips import without_slips
from schuler.gnss.observations import Observations
from schuler.gnss.preparation import prepare_ranges
from schuler.gnss.signals import frequency_hz
from schuler.gnss.synthetic import RangeErrors, synthetic_ranges
from schuler.navigation.inputs.satellites import limited
from schuler.recording.io.own_satellites import constants, flatten, unflatten
from schuler.recording.recording import Recording

EPOCH, SIGMA = 1.3e9, 0.003
T = np.arange(0.0, 60.0)
R = frames.ecef_from_llh(np.array([0.85, 0.16, 320.0]))
RATIO = frequency_hz(1, "2W") / frequency_hz(1, "1C")
CYCLE = 299_792_458.0 / frequency_hz(1, "1C")


def observed(first=0.0, second=0.0, lock=0):
    """GPS on two bands at rest, a clock of 0.2 m a root second; cycles added to all carriers of a band from 30 s on."""
    still = np.tile(R, (len(T), 1))
    made = synthetic_ranges(
        T, still, 0.0 * still, nominal_orbits("G"), np.random.default_rng(5), RangeErrors(clock_psd=0.04),
        epoch_gps_s=EPOCH, elevation_mask=0.2,
    )  # fmt: skip
    o, late = made.observations(), made.ranges.t >= 30.0
    noise = SIGMA / CYCLE * np.random.default_rng(6).standard_normal(len(o))
    both = [
        replace(o, carrier=o.carrier + first * late, signals=("1C", "2W")),
        replace(
            o, carrier=RATIO * (o.carrier + noise) + 1e5 + second * late, signal=o.signal + 1, signals=("1C", "2W"),
            lock=np.where(made.ranges.t == 40.0, lock, 0),
        ),
    ]  # fmt: skip
    order = np.argsort(np.concatenate((o.t, o.t)), kind="stable")
    rows = ("t", "sat", "signal", "pseudorange", "range_rate", "carrier", "cn0", "lock")
    merged = {n: np.concatenate([getattr(x, n) for x in both])[order] for n in rows}
    log = Observations(**merged, signals=("1C", "2W"), epoch_gps_s=o.epoch_gps_s)
    messages = nominal_orbits("G").ephemerides(EPOCH - 60.0, EPOCH + 120.0)
    return prepare_ranges(log, messages, position_e=R, ionosphere="none", troposphere="none", elevation_mask=0.0)


@pytest.fixture(scope="module")
def clean():
    return observed()


def ended(ranges):
    """Times at which arcs end by :func:`without_slips`, and how many changes there were."""
    out = without_slips(ranges, np.tile(R, (len(ranges), 1)), SIGMA, [])
    c = carrier_changes(ranges, SIGMA)
    return ranges.t[c.now][out.arc[c.now] != out.arc[c.before]], len(c.now)


def test_what_bands_part_by_is_neither_place_nor_clock(clean):
    """Statistical: noise of one phase at two epochs, 5 sigma of 600."""
    c = carrier_changes(clean, SIGMA)
    parted = clean.bands_apart[c.now] - clean.bands_apart[c.before]
    assert np.isfinite(parted).all()
    assert np.std(parted) == pytest.approx(np.sqrt(2.0) * SIGMA, rel=0.15)
    doubtful = observed(lock=2)
    np.testing.assert_array_equal(np.isnan(doubtful.bands_apart), np.abs(doubtful.t - 40.0) < 0.1)


@pytest.mark.parametrize("most", [1, 2, 4])
@pytest.mark.parametrize("cycles", [0.5, -0.5, 1.0, -3.0])
def test_a_slip_of_few_satellites_is_found(clean, cycles, most):
    """Of the only satellite too, where the clock hides it from everything else; nothing else is."""
    assert not len(ended(limited(clean, most=most))[0])
    slipped = limited(observed(first=cycles), most=most)
    times, changes = ended(slipped)
    np.testing.assert_allclose(times, np.full(most, 30.0), atol=0.1)
    assert changes >= 50 * most
    without = ended(replace(slipped, bands_apart=np.full(len(slipped), np.nan)))[0]
    assert len(without) == 0


def test_a_slip_of_the_other_band_costs_nothing_where_satellites_are_many():
    assert not len(ended(observed(second=1.0))[0])
    assert len(ended(limited(observed(second=1.0), most=2))[0]) == 2  # which band it was is not told


def test_files_keep_them_and_older_ones_are_read_without(clean):
    recording = Recording(ranges=clean)
    columns, more = flatten(recording)["ranges"], constants(recording)["ranges"]
    np.testing.assert_array_equal(unflatten("ranges", columns, more).bands_apart, clean.bands_apart)
    columns.pop("bands_apart")
    assert np.isnan(unflatten("ranges", columns, more).bands_apart).all()
