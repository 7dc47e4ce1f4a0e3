"""Carrier phases from epoch to epoch: arcs, changes against the model, slips of either sign found and nothing else."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from schuler import frames
from schuler.exceptions import InputError
from schuler.gnss.carrier import begin_arcs, carrier_changes
from schuler.gnss.constellation import nominal_orbits
from schuler.gnss.cycle_slips import without_slips
from schuler.gnss.preparation import prepare_ranges
from schuler.gnss.ranges import predicted_ranges
from schuler.gnss.synthetic import EXACT, RangeErrors, synthetic_ranges

EPOCH = 1.3e9
CYCLE = 299_792_458.0 / 1.57542e9
T = np.arange(0.0, 60.0)
V = np.array([3.0, -8.0, 5.0])
R = frames.ecef_from_llh(np.array([0.85, 0.16, 320.0])) + T[:, None] * V


def sky(errors=None, seed: int = 1, systems: str = "GE"):
    return synthetic_ranges(
        T, R, np.tile(V, (len(T), 1)), nominal_orbits(systems), np.random.default_rng(seed), errors, epoch_gps_s=EPOCH,
        elevation_mask=0.2,
    )  # fmt: skip


@pytest.fixture(scope="module")
def made():
    return sky()


def test_arcs_end_where_the_receiver_says_so():
    sat = np.array([1, 2, 1, 2, 1, 2, 1, 2, 1, 1])
    carrier = np.where(np.arange(10) == 3, np.nan, 5.0)
    signal = np.where(np.arange(10) >= 8, 1, 0)
    lock = np.array([1, 0, 0, 0, 1, 0, 2, 0, 2, 2])
    arc = begin_arcs(sat, carrier, signal, lock)
    mine = arc[sat == 1]  # rows 0, 2, 4 (lock lost), 6 (half a cycle in doubt), 8 (another signal), 9
    np.testing.assert_array_equal(np.diff(mine), [0, 1, 1, 1, 0])
    np.testing.assert_array_equal(np.diff(arc[sat == 2]), [0, 1, 0])  # the row without a carrier ends one


def test_exact_changes_are_the_motion_and_the_clock():
    """Without noise: range now less range then, and nothing of the ambiguity (rounding of 2e7 m)."""
    made = sky(EXACT)
    r = made.ranges
    c = carrier_changes(r, 0.003)
    rho, _ = predicted_ranges(r.r_sat_e, R[made.epoch])
    np.testing.assert_allclose(c.change, rho[c.now] - rho[c.before], atol=2e-7)
    assert np.all(r.t[c.now] - r.t[c.before] == 1.0)
    assert np.abs(r.carrier_range - rho).max() > 1e4


def test_changes_keep_to_arcs_epochs_and_satellites_in_use(made):
    r = made.ranges
    whole = carrier_changes(r, 0.003)
    sat = r.sat[0]
    left_out = replace(r, reason=np.where((r.sat == sat) & (r.t == 10.0), 8, 0))
    assert len(whole.now) - len(carrier_changes(left_out, 0.003).now) == 2
    other = replace(r, arc=r.arc + 1000 * ((r.sat == sat) & (r.t >= 10.0)))
    assert len(whole.now) - len(carrier_changes(other, 0.003).now) == 1
    paused = r.where((r.t < 20.0) | (r.t > 32.0))
    c = carrier_changes(paused, 0.003)
    assert np.all(paused.t[c.now] - paused.t[c.before] == 1.0)  # 13 s are too long
    assert np.all(c.sigma >= 0.003 * np.sqrt(2.0))
    with pytest.raises(InputError, match="positive standard deviation"):
        carrier_changes(r, 0.0)


def test_slips_of_either_sign_are_found_and_nothing_else(made):
    """Half a cycle to five on every satellite in turn; an error of 20 m of the approximate position does no harm."""
    r = made.ranges
    rng = np.random.default_rng(3)
    sats = np.unique(r.sat)
    jump, slipped = np.zeros(len(r)), np.zeros(len(r), dtype=bool)
    for k, t in enumerate(np.arange(5.0, 58.0)):
        row = np.flatnonzero((r.sat == sats[k % len(sats)]) & (r.t == t))
        slipped[row] = True
        jump[row] = rng.choice((-1, 1)) * 0.5 * CYCLE * rng.integers(1, 11)
    order = np.lexsort((r.t, r.sat))
    total = np.empty(len(r))
    total[order] = np.cumsum(jump[order])
    spoiled = replace(r, carrier_range=r.carrier_range + total)
    notes: list[str] = []
    near = R[made.epoch] + (12.0, -12.0, 10.0)
    x = without_slips(spoiled, near, 0.003, notes)
    c = carrier_changes(r, 0.003)
    np.testing.assert_array_equal(x.arc[c.now] != x.arc[c.before], slipped[c.now])
    assert f"{int(slipped[c.now].sum())} of {len(c.now)} changes of carrier phases are cycle slips" in notes[0]
    notes.clear()
    assert np.all(np.diff(without_slips(r, near, 0.003, notes).arc[order])[np.diff(r.sat[order]) == 0] == 0)
    assert notes == []


def test_a_clock_that_only_codes_follow_ends_all_arcs(made):
    r = made.ranges
    notes: list[str] = []
    x = without_slips(replace(r, pseudorange=r.pseudorange + 3e5 * (r.t >= 30.0)), R[made.epoch], 0.003, notes)
    c = carrier_changes(x, 0.003)
    assert not np.any(r.t[c.now] == 30.0)
    assert len(c.now) == len(carrier_changes(r, 0.003).now) - np.sum(r.t == 30.0)
    assert "apart together at 1 epochs" in notes[0]


def test_carriers_come_through_observations_and_their_preparation():
    """In cycles and back, with satellite clocks, receiver clock and arcs; 1 um of the stamps is 1 mm of the orbit."""
    made = sky(RangeErrors(noise=0.0, multipath=0.0, atmosphere=0.0))
    orbits = nominal_orbits("GE").ephemerides(EPOCH - 60.0, EPOCH + 120.0)
    r = prepare_ranges(
        made.observations(), orbits, position_e=R[0], ionosphere="none", troposphere="none", elevation_mask=0.0
    )
    a, b = carrier_changes(made.ranges, 0.003), carrier_changes(r, 0.003)
    assert len(a.now) == len(b.now)
    moved = [
        np.sort(
            c.change - (predicted_ranges(x.r_sat_e[c.now], R[0])[0] - predicted_ranges(x.r_sat_e[c.before], R[0])[0])
        )
        for c, x in ((a, made.ranges), (b, r))
    ]
    np.testing.assert_allclose(moved[0], moved[1], atol=5e-3)
