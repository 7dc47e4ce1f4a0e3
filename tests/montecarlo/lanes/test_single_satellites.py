"""Runs in lanes with single satellites are the engine's, err as the filter says, and see the simulator's sky."""

from dataclasses import replace
from math import sqrt

import filter_cases as cases
import lane_cases
import numpy as np
import pytest

from schuler.exceptions import InputError
from schuler.filtering.measurements import ACCEPTED, ARC_START, CARRIER_PHASE, FORCED, GATED, PSEUDORANGE, RANGE_RATE
from schuler.filtering.measurements import REJECTED as REFUSED
from schuler.filtering.states import StateLayout, StateModel
from schuler.gnss.synthetic import EXACT
from schuler.montecarlo.lanes.aiding import LaneAiding, together, true_rests, true_satellites
from schuler.montecarlo.lanes.run import replay, run_lanes
from schuler.montecarlo.lanes.scenario import draw_run
from schuler.navigation.aids.satellite import range_measurements
from schuler.navigation.evaluation.consistency import chi_square_band
from schuler.simulation.satellites import RangeFault, prepare_sky, simulate_satellites

SEED = 11
KINDS = (PSEUDORANGE, RANGE_RATE, CARRIER_PHASE)


def assert_same(scene, number=2, states=1e-6, sigmas=1e-9):
    """One run against the engine on the same data: errors in sigmas, sigmas, and what became of measurements.

    Rounding: a range of 25,000 km has 4e-9 m, 1e-8 of what codes make of a position; 1e-8 and 1e-11 are seen.
    """
    lanes = run_lanes(scene, 8, seed=SEED)
    forward, error, sigma = lane_cases.engine_run(scene, number, SEED)
    np.testing.assert_allclose(lanes.t, forward.rec_t, rtol=0, atol=1e-9)
    assert np.abs((lanes.error[number] - error) / sigma).max() < states
    assert np.abs(lanes.sigma[number] / sigma - 1.0).max() < sigmas
    for i, kind in enumerate(KINDS):
        status = forward.status[scene.aiding.schedule.kind == kind]
        assert lanes.accepted[number, i] == np.sum((status == ACCEPTED) | (status == FORCED))
        assert lanes.rejected[number, i] == np.sum(status == REFUSED)
        nis = forward.nis[scene.aiding.schedule.kind == kind]
        if np.isfinite(nis).any():
            np.testing.assert_allclose(lanes.nis[number, i], np.nanmean(nis), rtol=1e-4)
    return lanes, forward


@pytest.mark.parametrize("states", [9, 15, 42])
def test_a_lane_is_the_engine(states):
    """Codes and range rates with a lever arm between samples, two clocks, three satellites, an outage."""
    lanes, forward = assert_same(lane_cases.sky_scenario(states))
    assert lanes.layout.size == states + 3
    assert lanes.accepted[2, 0] == lanes.accepted[2, 1] > 500
    assert np.all(forward.status == ACCEPTED)


def test_codes_alone_without_a_lever_arm_at_the_very_start():
    """No interval has been seen yet when the first epoch comes."""
    model = replace(lane_cases.SKY, first_s=0.0, rate_hz=5.0, systems="E", lever_arm_b=np.zeros(3), windows=())
    model = replace(model, errors=replace(model.errors, offsets=()))
    scene = lane_cases.sky_scenario(15, 20.0, model=model)
    assert_same(scene)
    codes = scene.aiding.schedule.kind == PSEUDORANGE
    lanes, _ = assert_same(replace(scene, aiding=scene.aiding.where(codes)))
    assert lanes.accepted[2].tolist() == [int(codes.sum()), 0, 0]


@pytest.mark.parametrize("states", [15, 33])
def test_carrier_phases_are_those_of_the_engine(states):
    """Ambiguities as states; arcs begin with all correlations, after windows, outages and a lost second.

    Rounding of a range is 2e-6 of 2 mm here, and a clock known to 100 m costs digits beside them; 2e-6 and 2e-8 are
    seen.
    """
    scene = lane_cases.sky_scenario(states, carrier=True, lost=((45.0, 47.0),))
    lanes, forward = assert_same(scene, states=3e-5, sigmas=1e-6)
    kind = scene.aiding.schedule.kind
    begun = (kind == CARRIER_PHASE) & (forward.status == GATED) & (scene.aiding.schedule.gate >= 0.0)
    assert begun.sum() > 5  # after the lost second, which is no start by the receiver
    assert (kind == ARC_START).sum() > 15
    assert lanes.layout.size == states + 3 < scene.layout.size
    assert lanes.sigma[2, -1, 3:6].max() < 0.5 * run_lanes(lane_cases.sky_scenario(states), 8).sigma[2, -1, 3:6].max()


def test_rejected_codes_and_phases_are_those_of_the_engine():
    """A gate that rejects in one lane and not in another; a phase that is rejected begins its arc anew in its lane.

    Without a lock-out, so that no lane is done again by the engine.
    """
    scene = lane_cases.sky_scenario(15, carrier=True, gate=0.97, lockout=0)
    for number in (1, 4):
        lanes, _ = assert_same(scene, number, states=3e-5, sigmas=1e-6)
    assert np.all(lanes.rejected.sum(axis=0) > 20)
    assert len(np.unique(lanes.rejected[:, 2])) > 2  # every lane its own


def test_runs_that_would_force_measurements_in_are_done_by_the_engine():
    scene = lane_cases.sky_scenario(15, gate=0.9, sigma_scale=0.1)
    _, forward = assert_same(scene, 3)
    assert np.any(forward.status == FORCED)


def test_a_run_does_not_depend_on_its_company():
    scene = lane_cases.sky_scenario(15, 20.0, carrier=True)
    everything, alone = run_lanes(scene, 12, seed=SEED, threads=2), run_lanes(scene, [9], seed=SEED)
    np.testing.assert_array_equal(everything.error[9], alone.error[0])
    np.testing.assert_array_equal(everything.nis[9], alone.nis[0])
    assert np.unique(everything.error[:, -1, 0]).size == 12


def test_true_measurements_are_the_simulators_without_errors():
    scene, model = lane_cases.sky_scenario(15, 40.0, carrier=True), lane_cases.SKY
    body = lane_cases.Cut(cases.drive(40.0 / 60.0), 40.0)
    r = simulate_satellites(body, replace(model, errors=EXACT), np.random.default_rng(5)).ranges
    expected = range_measurements(r, model.lever_arm_b, gate=None)
    mine = scene.aiding.where(np.isin(scene.aiding.schedule.kind, (PSEUDORANGE, RANGE_RATE))).schedule
    np.testing.assert_allclose(mine.z, expected.z, rtol=0, atol=1e-8)  # rounding of 25,000 km
    np.testing.assert_array_equal(mine.t, expected.t)


def test_errors_of_ranges_have_the_budget_of_the_simulator():
    """Of 60 runs, clock taken out by another satellite of the same system and epoch; 4.5 standard errors."""
    scene = lane_cases.sky_scenario(9, 30.0, carrier=True)
    schedule, of = scene.aiding.schedule, scene.aiding.sky
    drawn = np.array([draw_run(scene, k, SEED).ranges.error for k in range(60)])
    sine = np.sin(of.sky.elevation[of.epoch, of.satellite])
    growth = np.sqrt(0.5 * (1.0 + 1.0 / sine**2))
    for kind, sigma in ((PSEUDORANGE, 0.5), (RANGE_RATE, 0.05)):
        at = np.flatnonzero(schedule.kind == kind)
        a, b = at[:-1:2], at[1::2]
        both = (schedule.t[a] == schedule.t[b]) & (of.group[of.satellite[a]] == of.group[of.satellite[b]])
        a, b = a[both], b[both]
        z = (drawn[:, a] - drawn[:, b]) / (sigma * np.hypot(growth[a], growth[b]))
        assert abs(z.var() - 1.0) < 4.5 * sqrt(2.0 / z.size)
    # the filter's variances are those of the noise, and of the clock the truth is told
    codes = schedule.kind == PSEUDORANGE
    np.testing.assert_allclose(np.sqrt(schedule.R[codes, 0, 0]), 0.5 * growth[codes], rtol=1e-12)
    data = replay(scene, 3, seed=SEED)
    layout = scene.layout.visible
    clock = data.parameters[:, layout["clock"].start - 9]
    at = np.searchsorted(scene.ideal.t[1:], schedule.t[codes] - 1e-9)
    group = of.group[of.satellite[codes]]
    between = np.where(group > 0, data.parameters[at, layout["clock_2"].start - 9], 0.0)
    rest = (data.schedule.z[codes, 3] - schedule.z[codes, 3] - clock[at] - between) / (0.5 * growth[codes])
    # statistical; the sample after the epoch is 6.3 ms later by 30 m/s, which is taken out
    rest -= -0.0063 * 30.0 / (0.5 * growth[codes])
    assert abs(rest.mean()) < 4.5 / sqrt(rest.size) + 0.02


@pytest.mark.campaign
@pytest.mark.parametrize("carrier", [False, True])
def test_scatter_is_what_the_filter_says(carrier):
    """Everything drawn from the filter's own model, clocks and their start too: 400 runs of a minute."""
    runs = 400
    scene = lane_cases.sky_scenario(
        15, 60.0, model=replace(lane_cases.SKY, first_s=1.0), carrier=carrier,
        nees=("all", "navigation", "clock", "clock_drift", "clock_2"), attitude=np.array([0.002, 0.002, 0.01]),
    )  # fmt: skip
    records = run_lanes(scene, runs, seed=SEED)
    assert not records.diverged.any()
    for name, values in records.nees.items():
        a, b = scene.states(name)
        low, high = chi_square_band(b - a, runs, 0.9999)  # statistical: 6 looks of 5 names
        mean = values.mean(axis=0)
        assert np.all((mean > low) & (mean < high)), (name, low, mean, high)
    for i in range(3 if carrier else 2):
        count = int((records.accepted + records.rejected)[0, i])
        low, high = chi_square_band(count, runs, 0.9999)
        assert low < records.nis[:, i].mean() < high


def test_what_lanes_do_not_have_is_refused():
    scene, model = lane_cases.sky_scenario(15, 5.0), lane_cases.SKY
    body = lane_cases.Cut(cases.drive(1.0), 5.0)
    faulty = replace(model, faults=(RangeFault("highest", 1.0, 2.0, 50.0),), slips_per_hour=60.0)
    with pytest.raises(InputError, match="this receiver has faults, slips_per_hour: use the engine"):
        true_satellites(prepare_sky(body, model), faulty, lambda r: range_measurements(r, np.zeros(3)))
    with pytest.raises(InputError, match="single satellites alone"):
        together(scene.aiding, true_rests([1.0], 0.01))
    with pytest.raises(InputError, match="single satellites only"):
        LaneAiding(scene.aiding.schedule, scene.aiding.sigma)
    with pytest.raises(InputError, match=r"expected errors of \d+ measurements"):
        LaneAiding(scene.aiding.schedule, scene.aiding.sigma, scene.aiding.sky.where(scene.aiding.schedule.t < 3.0))
    with pytest.raises(InputError, match="need the receiver's clock among the states"):
        replace(scene, layout=cases.layout(15))
    lever = StateLayout({**scene.layout.models, "lever": StateModel.constant(0.1)})
    with pytest.raises(InputError, match=r"the other state blocks \(lever\)"):
        replace(scene, layout=lever)
