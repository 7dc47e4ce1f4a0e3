"""Steps of a receiver's clock: those codes show, and those only carriers show, which a filter would take for slips."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from satellite_drive import Case

from schuler.gnss.clock_noise import clock_frequency_noise
from schuler.gnss.point import solve_points
from schuler.navigation.inputs.clock_steps import without_clock_jumps, without_clock_steps

SIGMA, NOISE = 0.003, 0.2  # of a phase [m]; of the clock, as simulated [m/sqrt(s)]


@pytest.fixture(scope="module")
def case():
    return Case()


@pytest.fixture(scope="module")
def clean(case):
    return case.made().ranges


def stepped(ranges, metres, *, codes=True, at=60.0):
    d = metres * (ranges.t >= at)
    return replace(ranges, pseudorange=ranges.pseudorange + d * codes, carrier_range=ranges.carrier_range + d)


# --- shown by codes ---------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("metres", [-3e5, -60.0, 45.0, 2.99792458e5])
def test_clock_jumps_are_taken_out(clean, metres):
    jumped = replace(clean, pseudorange=clean.pseudorange + metres * (clean.t >= 50.0))
    notes: list[str] = []
    r, s = without_clock_jumps(jumped, solve_points(jumped), notes)
    assert len(notes) == 1
    assert notes[0].startswith("the receiver clock jumped 1 times, first by")
    step = (r.pseudorange - clean.pseudorange)[r.t >= 50.0]
    assert np.ptp(step) < 1e-6  # rounding: one number for all
    assert abs(step[0]) < 2.0  # statistical: the clock's own noise and that of two solutions, about 0.4 m
    np.testing.assert_array_equal(r.pseudorange[r.t < 50.0], clean.pseudorange[r.t < 50.0])
    before, after = s.clock[s.t < 50.0][-1], s.clock[s.t >= 50.0][0]
    np.testing.assert_allclose(after - before, 0.5 * s.drift[s.t < 50.0][-1], atol=3.0)  # statistical


def test_jumps_without_range_rates_and_several_of_them(clean):
    steps = 1e4 * (clean.t >= 30.0) - 200.0 * (clean.t >= 70.0)
    no_rates = replace(clean, range_rate=np.full(len(clean), np.nan))
    jumped = replace(no_rates, pseudorange=clean.pseudorange + steps)
    notes: list[str] = []
    r, _ = without_clock_jumps(jumped, solve_points(jumped), notes)
    assert "jumped 2 times, first by +1" in notes[0]
    left = r.pseudorange - clean.pseudorange
    assert np.abs(left).max() < 4.0  # statistical: as above, without the rates


def test_a_bad_epoch_and_a_calm_clock_are_no_jumps(clean):
    notes: list[str] = []
    same, _ = without_clock_jumps(clean, solve_points(clean), notes)
    assert same is clean
    bad = replace(clean, pseudorange=clean.pseudorange + 80.0 * (clean.t == 50.0))
    same, _ = without_clock_jumps(bad, solve_points(bad), notes)
    assert same is bad
    subset = clean.where(clean.t < 1.2)
    assert without_clock_jumps(subset, solve_points(subset), notes)[0] is subset
    assert not notes


# --- shown by carriers ------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("metres", [1.0, -3.0, 12.0])
def test_a_common_step_is_the_clocks(clean, metres):
    """Taken out but for the clock's own noise, 0.14 m from one epoch to the next, of codes, carriers and points."""
    r = stepped(clean, metres)
    points = solve_points(r)
    notes: list[str] = []
    out, solution = without_clock_steps(r, points, SIGMA, NOISE, notes)
    taken = r.carrier_range - out.carrier_range
    assert np.all(taken[r.t < 60.0] == 0.0)
    assert np.ptp(taken[r.t >= 60.0]) < 1e-6  # rounding
    assert abs(taken[-1] - metres) < 0.6  # statistical, four sigma
    np.testing.assert_allclose(r.pseudorange - out.pseudorange, taken, atol=1e-6)  # rounding
    shift = points.clock - solution.clock
    np.testing.assert_allclose(shift[np.isfinite(shift)].max() if metres > 0 else shift[np.isfinite(shift)].min(),
                               taken[-1], atol=1e-6)  # fmt: skip
    assert len(notes) == 1
    assert f"at 1 epochs, first by {taken[-1]:+.2f} m at 60.000 s: taken out" in notes[0]
    assert "alone" not in notes[0]


def test_a_step_of_carriers_alone_leaves_codes(clean):
    r = stepped(clean, 5.0, codes=False)
    notes: list[str] = []
    out, _ = without_clock_steps(r, solve_points(r), SIGMA, NOISE, notes)
    np.testing.assert_array_equal(out.pseudorange, r.pseudorange)
    assert abs((r.carrier_range - out.carrier_range)[-1] - 5.0) < 0.6
    assert notes[0].endswith("taken out, 1 times of carrier phases alone")


def test_noise_few_satellites_and_missing_rates_are_no_steps(clean):
    points, notes = solve_points(clean), list[str]()
    assert without_clock_steps(clean, points, SIGMA, NOISE, notes)[0] is clean
    r = stepped(clean, 5.0)
    few = r.where(np.isin(r.sat, np.unique(r.sat)[:4]))
    assert without_clock_steps(few, points, SIGMA, NOISE, notes)[0] is few
    still = replace(r, range_rate=np.full(len(r), np.nan))
    assert without_clock_steps(still, points, SIGMA, NOISE, notes)[0] is still
    assert not notes


@pytest.mark.parametrize("noise", [0.2, "log"])
def test_a_step_costs_a_run_nothing(case, clean, noise):
    """No phase is rejected, and velocity is the same to 0.1 mm/s; left in, all thirteen were, and it was 5 mm/s off."""
    runs = [case.navigated(r, carrier="time-differenced", clock_noise_m=noise) for r in (clean, stepped(clean, -10.0))]
    for run in runs:
        assert run.innovations.rejected()["carrier_phase"] == 0
    assert np.abs(runs[0].states.v_eb_e - runs[1].states.v_eb_e).max() < 1e-3
    assert np.abs(case.error_n(runs[0]) - case.error_n(runs[1])).max() < 0.02


def test_steps_are_no_noise_of_the_clock(clean):
    assert clock_frequency_noise(stepped(clean, 20.0), SIGMA) == pytest.approx(
        clock_frequency_noise(clean, SIGMA), rel=0.05
    )
