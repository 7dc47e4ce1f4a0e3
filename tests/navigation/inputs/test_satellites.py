"""Satellite measurements on their way into a filter: repeats, missing sigmas, faults, satellites that go.

A car of two minutes, an IMU with its biases, ranges made by :mod:`schuler.gnss.synthetic` whose errors are known.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from satellite_drive import BUDGET, CLOCK, EPOCH, IMU, LEVER, ORIGIN, Case

from schuler import frames
from schuler.exceptions import InputError
from schuler.filtering.initial_state import InitialState
from schuler.filtering.states import AMBIGUITIES, CHANNELS, StateLayout, StateModel
from schuler.gnss.ephemerides import Ephemerides, no_glonass
from schuler.gnss.integrity import Integrity
from schuler.gnss.point import solve_points
from schuler.gnss.signals import SPEED_OF_LIGHT
from schuler.gnss.slow_errors import slow_channels
from schuler.gnss.synthetic import Sector, synthetic_ranges
from schuler.mechanization.strapdown import NavState
from schuler.navigation.aids.satellite import range_measurements
from schuler.navigation.config import NavigationConfig
from schuler.navigation.inputs.satellite_noise import inflate_sigmas, without_reflections
from schuler.navigation.inputs.satellites import (
    Points,
    inflated,
    limited,
    once_each,
    satellites,
    with_clocks,
    with_sigmas,
    within_log,
    without_faults,
)
from schuler.navigation.run import navigate
from schuler.navigation.sections import CorrelatedSection
from schuler.navigation.states import imu_spec, state_layout
from schuler.recording.recording import Metadata, Recording
from schuler.recording.satellite_positions import gnss_series
from schuler.timebase import TimeBase


@pytest.fixture(scope="module")
def case():
    return Case()


@pytest.fixture(scope="module")
def clean(case):
    return case.made().ranges


def faulty(ranges, sat, start, stop, metres, rate=0.0):
    k = (ranges.sat == sat) & (ranges.t >= start) & (ranges.t < stop)
    return replace(
        ranges, pseudorange=ranges.pseudorange + metres * k, range_rate=ranges.range_rate + rate * k
    )  # fmt: skip


# --- one step at a time -----------------------------------------------------------------------------------------------


def test_many_detours_are_left_out_by_the_epochs_before_them(clean):
    """Five of thirteen satellites late by 25 to 65 m for 20 s: nearly all go, no other, whatever comes later."""
    many, late = clean, np.zeros(len(clean), dtype=bool)
    for k, sat in enumerate(np.unique(clean.sat)[:5].tolist()):
        many = faulty(many, sat, 40.0, 60.0, 25.0 + 10.0 * k)
        late |= (clean.sat == sat) & (clean.t >= 40.0) & (clean.t < 60.0)
    notes: list[str] = []
    kept, _ = without_reflections(many, None, notes)
    assert kept.used[late & clean.used].mean() < 0.1
    assert kept.used[~late].sum() == clean.used[~late].sum()
    assert np.isnan(kept.range_rate[clean.used & ~kept.used]).all()
    assert "suspected not to be in line of sight" in notes[-1]
    past = many.t < 50.0
    np.testing.assert_array_equal(without_reflections(many.where(past), None, [])[0].reason, kept.reason[past])


@pytest.mark.parametrize("satellites_of", [4, 13])
def test_scatter_is_not_taken_for_detours(clean, satellites_of):
    """Ranges that scatter by eight times what they say, of some satellites or all."""
    part = clean.where(clean.t < 60.0)
    spoilt = np.isin(part.sat, np.unique(part.sat)[:satellites_of])
    noise = 8.0 * part.sigma_range * np.random.default_rng(2).standard_normal(len(part))
    scattered = replace(part, pseudorange=part.pseudorange + noise * spoilt)
    failed = np.isin(solve_points(scattered, integrity=Integrity(neighbours=False)).status, (5, 6))
    assert failed.sum() > 10  # that one epoch cannot tell
    np.testing.assert_array_equal(without_reflections(scattered, None, [])[0].reason, part.reason)


def test_repeated_measurements_count_once(clean):
    k = np.sort(np.concatenate((np.arange(len(clean)), [4, 4, 9])))
    notes: list[str] = []
    once = once_each(clean.where(k), notes)
    np.testing.assert_array_equal(once.pseudorange, clean.pseudorange)
    assert notes == ["3 repeated satellite measurements were left out"]
    assert once_each(clean, notes) is clean


@pytest.mark.parametrize("bad", [0.0, np.nan, -1.0, np.inf])
def test_missing_standard_deviations_are_filled_in(clean, bad):
    first = np.arange(len(clean)) < 5
    notes: list[str] = []
    r = with_sigmas(
        replace(
            clean,
            sigma_range=np.where(first, bad, clean.sigma_range),
            sigma_rate=np.where(first, bad, clean.sigma_rate),
        ),
        notes,
    )
    assert set(r.sigma_range[first]) == {10.0}
    assert set(r.sigma_rate[first]) == {1.0}
    np.testing.assert_array_equal(r.sigma_range[~first], clean.sigma_range[~first])
    assert notes == [
        "5 ranges without a standard deviation were given 10 m",
        "5 range rates without a standard deviation were given 1 m/s",
    ]
    with pytest.raises(InputError, match="expected positive standard deviations"):
        range_measurements(replace(clean, sigma_range=np.where(first, bad, clean.sigma_range)), LEVER)


def test_ranges_outside_the_imu_log_are_not_looked_at(case, clean):
    short = case.recording(clean)
    short = replace(short, imu=case.imu.between(20.0, 60.0))
    r = within_log(clean, short)
    assert r.t[0] >= 19.0
    assert r.t[-1] <= 61.0
    assert within_log(clean, short, 30.0).t[-1] > 85.0
    with pytest.raises(InputError, match="no time in common"):
        within_log(clean, short, 1e4)


def test_true_standard_deviations_stay(case):
    """Seldomer than one window in a thousand would be enlarged by chance; none of these 288 is."""
    for seed in range(12):
        r = case.made(seed).ranges
        notes: list[str] = []
        same, _ = inflate_sigmas(r, notes)
        assert same is r, (seed, notes)


@pytest.mark.parametrize("factor", [2.0, 5.0, 300.0])
def test_too_small_standard_deviations_are_enlarged_where_they_are(clean, factor):
    late = clean.t >= 60.0  # a window begins
    wrong = replace(
        clean,
        sigma_range=np.where(late, clean.sigma_range / factor, clean.sigma_range),
        sigma_rate=np.where(late, clean.sigma_rate / factor, clean.sigma_rate),
    )
    notes: list[str] = []
    r, _ = inflate_sigmas(wrong, notes)
    for name in ("sigma_range", "sigma_rate"):
        ratio = getattr(r, name) / getattr(clean, name)
        np.testing.assert_array_equal(ratio[~late], 1.0)
        # statistical: twenty epochs of about fifteen degrees of freedom a window, and exclusions take some scatter away
        assert np.all((ratio[late] > 0.75) & (ratio[late] < 1.3)), ratio[late]
    assert len(notes) == 2
    assert notes[0].startswith(f"standard deviations of {late.sum()} ranges were enlarged")


def test_standard_deviations_do_not_depend_on_where_a_log_begins(clean):
    """Windows are those of the clock; a log without its first seven seconds has the numbers of the whole one."""
    wrong = replace(clean, sigma_range=clean.sigma_range / np.where(clean.t >= 60.0, 3.0, 1.0))
    part = wrong.t >= 7.0
    whole, cut = (inflate_sigmas(r, [])[0] for r in (wrong, wrong.where(part)))
    assert np.any(whole.sigma_range > 2.0 * wrong.sigma_range)
    np.testing.assert_array_equal(cut.sigma_range, whole.sigma_range[part])


def test_too_large_standard_deviations_stay(clean):
    """Errors that last, or that all satellites share, do not show in residuals."""
    r, _ = inflate_sigmas(replace(clean, sigma_range=4.0 * clean.sigma_range), [])
    np.testing.assert_array_equal(r.sigma_range, 4.0 * clean.sigma_range)


def test_a_fault_does_not_pass_as_noise(clean):
    """40 m on one of many satellites for 4 s: excluded there, and nobody's standard deviation grows."""
    sat = int(clean.sat[np.argmax(clean.elevation)])
    wrong = faulty(clean, sat, 40.0, 44.0, 40.0)
    r, solution = inflate_sigmas(wrong, [])
    np.testing.assert_array_equal(r.sigma_range, clean.sigma_range)
    notes: list[str] = []
    left = without_faults(r, solution, notes)
    out = left.reason == 6
    np.testing.assert_array_equal(out, (r.sat == sat) & (r.t >= 40.0) & (r.t < 44.0))
    assert np.isnan(left.range_rate[out]).all()
    assert notes == [
        "8 ranges and 8 range rates excluded by fault detection among the satellites of an epoch"
    ]  # fmt: skip


def test_range_rates_are_inflated_to_the_long_average_of_gauss_markov_noise(clean):
    rates = inflated(clean, CorrelatedSection(velocity_sigma_m_s=0.1, velocity_tau_s=5.0))
    np.testing.assert_allclose(rates.sigma_rate**2 - clean.sigma_rate**2, 0.01 / np.tanh(0.05), rtol=1e-9)
    assert inflated(clean, CorrelatedSection(position_sigma_m=2.0)) is clean  # states of the filter


def test_satellites_are_cut_within_windows_only(clean):
    cut = limited(clean, 1, 3, ((20.0, 30.0),))
    count = np.array([np.sum(cut.t == t) for t in np.unique(clean.t)])
    full = np.array([np.sum(clean.t == t) for t in np.unique(clean.t)])
    inside = (np.unique(clean.t) >= 20.0) & (np.unique(clean.t) < 30.0)
    assert set(count[inside]) == {3}
    np.testing.assert_array_equal(count[~inside], full[~inside])


def test_the_clocks_of_the_start(case, clean):
    """The reference clock follows from another system's where the nearest epoch does not show it."""
    models = {n: StateModel.random_walk(1.0, 0.1) for n in ("b_a", "b_g", "clock", "clock_drift", "clock_2")}
    lay = StateLayout(models)
    start = InitialState.from_sigmas(
        NavState(60.0, case.r[119], case.v[119], case.truth.q_eb[3000]), lay, attitude=[1e-3] * 3, velocity=[0.1] * 3,
        position=[1.0] * 3,
    )  # fmt: skip
    made = case.made()
    k = int(np.searchsorted(case.t, 60.0))
    for hidden in (False, True):
        r = clean.where(~((clean.t == case.t[k]) & (clean.group == 0))) if hidden else clean
        s = solve_points(r)
        p = with_clocks(start, Points(s, gnss_series(s)), lay).parameters
        # statistical: solutions are good to 0.5 m and 0.05 m/s, and the clock walks 0.2 m in half a second
        assert p[lay["clock"].start - 9] == pytest.approx(made.clock[k, 0], abs=3.0)
        assert p[lay["clock_drift"].start - 9] == pytest.approx(made.drift[k], abs=0.4)
        assert p[lay["clock_2"].start - 9] == pytest.approx(15.0, abs=1.5)


def test_a_clock_without_range_rates_drifts_as_its_offsets_do(case):
    """One of a part in a million; started at no drift the filter rejected eleven codes and forced one in."""
    budget = replace(BUDGET, drift=300.0)
    made = synthetic_ranges(
        case.t, case.r, case.v, case.orbits, np.random.default_rng(2), budget, epoch_gps_s=EPOCH, elevation_mask=0.2
    )
    result = case.navigated(replace(made.ranges, range_rate=np.full(len(made.ranges), np.nan)))
    counts = result.innovations.counts()["pseudorange"]
    assert counts["rejected"] + counts["accepted after lock-out"] == 0
    assert result.parameter("clock_drift")[0, 0] == pytest.approx(made.drift[0], abs=1.0)
    assert result.verdict.status == "ok"


@pytest.mark.parametrize(
    ("factor", "cause"), [(0.190294, "carriers in metres"), (1.2833, "of another band"), (-1.0, "sign")]
)
def test_carriers_of_another_unit_or_band_are_refused(case, factor, cause):
    logged = case.made().observations()
    messages = case.orbits.ephemerides(EPOCH - 60.0, EPOCH + 180.0)
    tight = {"carrier": "time-differenced", "systems": "GE"}
    config = NavigationConfig.parse({"imu": {"catalogue": IMU}, "gnss": {"coupling": "tight", "tight": tight}})

    def recording(log):
        return Recording(observations=log, ephemerides=messages, metadata=Metadata(time=TimeBase("gps", EPOCH)))

    satellites(recording(logged), config, [])
    with pytest.raises(InputError, match=f"rover: the carrier of GPS 1C changes .* look like .*{cause}"):
        satellites(recording(replace(logged, carrier=factor * logged.carrier)), config, [])


def test_what_is_missing_is_named(case, clean):
    config = NavigationConfig.parse({"imu": {"catalogue": IMU}, "gnss": {"coupling": "tight"}})
    with pytest.raises(InputError, match="there are no observations"):
        satellites(case.recording(), config, [])
    logged = case.made().observations()
    alone = Recording(observations=logged, metadata=Metadata())
    with pytest.raises(InputError, match=r"there are no ephemerides: give a RINEX or UBX file"):
        satellites(alone, config, [])
    messages = case.orbits.ephemerides(EPOCH - 60.0, EPOCH + 180.0)
    other_week = replace(alone, ephemerides=messages, observations=replace(logged, epoch_gps_s=EPOCH - 604_800.0))
    with pytest.raises(InputError, match=r"no range is usable: check systems, .*; the log begins at .* GPS, messages"):
        satellites(other_week, config, [])
    with pytest.raises(InputError, match="no range is usable"):
        satellites(case.recording(replace(clean, reason=np.full(len(clean), 2))), config, [])
    with pytest.raises(InputError, match="none has a pseudorange: log the receiver's codes"):
        satellites(case.recording(replace(clean, pseudorange=np.full(len(clean), np.nan))), config, [])
    with pytest.raises(InputError, match="at most 3 satellites were usable; check systems"):
        satellites(case.recording(limited(clean, 1, 3)), config, [])


# --- whole runs -------------------------------------------------------------------------------------------------------


def sound(case, result, largest=2.0, sigmas=5.0):
    """No error beyond ``largest`` metres, nor beyond ``sigmas`` of its own, and no jumps: returns errors."""
    error, sigma = case.error_n(result), result.sigma("dr")
    assert np.abs(error).max() < largest
    assert np.all(np.abs(error) < sigmas * sigma)
    a = result.trajectory
    step = np.diff(a.r_eb_e, axis=0) - a.v_eb_e[1:] * np.diff(a.t)[:, None]
    assert np.linalg.norm(step, axis=1).max() < largest
    return error


def test_a_clean_run(case, clean):
    result = case.navigated(clean)
    sound(case, result)
    for kind in ("pseudorange", "range_rate"):
        part = result.innovations.of(kind)
        assert len(part) > 1500
        assert 0.85 < np.nanmean(part.nis) < 1.15  # statistical: 1 +- 0.035 for each kind
    truth = case.made()
    clock = result.parameter("clock")[:, 0]
    at = np.interp(result.t, case.t, truth.clock[:, 0])
    inside = (result.t > result.t[5]) & (result.t < case.t[-1])
    assert np.abs(clock - at)[inside].max() < 5.0 * result.sigma("clock").max()


@pytest.mark.parametrize("carrier", ["off", "time-differenced"])
def test_satellites_beyond_the_room_for_states(case, clean, carrier, monkeypatch):
    """With all errors of the IMU estimated only some satellites have a state for an ambiguity, or for a slow error."""
    monkeypatch.setattr("schuler.navigation.states.MAX_STATES", 64)
    config = {
        "imu": {"catalogue": IMU},
        "gnss": {
            "coupling": "tight", "lever_arm_m": tuple(LEVER), "lever_sigma_m": 0.1,
            "tight": CLOCK | {"carrier": carrier},
            "correlated": {"position_sigma_m": 0.5, "position_tau_s": 30.0},
        },
        "filter": {"smooth": False, "states": ("b_a", "b_g", "b_a_run", "b_g_run", "S_a", "S_g", "M_a6", "M_g", "G_g")},
    }  # fmt: skip
    config["filter"]["models"] = {name: {"sigma": 1e-3} for name in config["filter"]["states"]}
    parsed = NavigationConfig.parse(config)
    layout = state_layout(parsed, imu_spec(parsed), clean)
    given, other = (CHANNELS, AMBIGUITIES) if carrier == "off" else (AMBIGUITIES, CHANNELS)
    count = sum(name in layout for name in given)
    assert layout.size == 64 == layout.visible.size + count
    assert other[0] not in layout
    assert slow_channels(clean, 30.0, len(CHANNELS)).max() > count
    result = navigate(case.recording(clean), parsed)
    sound(case, result)
    phases = result.innovations.of("carrier_phase")
    assert len(phases) == 0 or np.unique(phases.t, return_counts=True)[1].max() == count


@pytest.mark.parametrize("metres", [-3e5, 70.0])
def test_a_clock_jump_does_not_move_the_solution(case, clean, metres):
    before = case.navigated(clean)
    after = case.navigated(replace(clean, pseudorange=clean.pseudorange + metres * (clean.t >= 50.0)))
    assert any("clock jumped 1 times" in note for note in after.notes)
    sound(case, after)
    moved = np.linalg.norm(after.states.r_eb_e - before.states.r_eb_e, axis=1)
    assert moved.max() < before.sigma("dr").max()  # the estimate of the jump is wrong by some decimetres
    assert sum(after.innovations.rejected().values()) <= sum(before.innovations.rejected().values()) + 3


def test_whole_milliseconds_through_observations(case):
    """A receiver that sets its clock: stamps and ranges move together, and the chain puts both right."""
    made = case.made()
    o = made.observations()
    late = made.ranges.t >= 60.0
    jump = 1e-3 * late
    o = replace(o, t=o.t + jump, pseudorange=o.pseudorange + SPEED_OF_LIGHT * jump)
    parts = {"observations": o, "ephemerides": case.orbits.ephemerides(EPOCH, EPOCH + 120.0)}
    result = case.navigated(parts=parts, ionosphere="none", troposphere="none")
    assert any("whole milliseconds 1 times" in note for note in result.notes)
    sound(case, result, 3.0)


def test_satellites_rise_set_and_hide(case):
    """A house in the east and a wall in the south come and go; half of the sky is gone for half a minute."""
    free, walls = case.made().ranges, case.made(blocked=[Sector(0.3, 3.6, below=1.2)]).ranges
    hidden = (free.t >= 40.0) & (free.t < 70.0) & ~np.isin(
        free.sat + 1000 * np.round(2 * free.t), walls.sat + 1000 * np.round(2 * walls.t)
    )  # fmt: skip
    assert hidden.sum() > 200
    sound(case, case.navigated(free.where(~hidden)), 3.0)


def test_a_change_of_ephemerides_does_not_show(case):
    """Messages for every minute whose clocks differ by a metre and more from one to the next."""
    eph = case.orbits.ephemerides(EPOCH, EPOCH + 120.0, interval_s=60.0)
    wander = 1.0 / SPEED_OF_LIGHT * np.random.default_rng(6).standard_normal(len(eph.kepler))
    eph = Ephemerides(replace(eph.kepler, af0=eph.kepler.af0 + wander), no_glonass())
    assert np.sum((np.unique(eph.kepler.toe) >= EPOCH) & (np.unique(eph.kepler.toe) < EPOCH + 100.0)) == 2
    parts = {"observations": case.made().observations(), "ephemerides": eph}
    result = case.navigated(parts=parts, ionosphere="none", troposphere="none")
    error = sound(case, result, 3.0, sigmas=20.0)  # errors that last, which the filter takes as white
    assert np.abs(np.diff(error, axis=0)).max() < 0.6  # a metre on each of twelve ranges, and gently


def test_a_receiver_that_claims_a_centimetre(case, clean):
    """All satellites claim 1 cm and 1 mm/s with errors of half a metre and 5 cm/s."""
    wrong = replace(clean, sigma_range=np.full(len(clean), 0.01), sigma_rate=np.full(len(clean), 0.001))
    result = case.navigated(wrong)
    assert sum("were enlarged" in note for note in result.notes) == 2
    sound(case, result)
    assert not any(result.innovations.rejected().values()) or result.innovations.mean_nis() < 1.3


@pytest.mark.parametrize("metres", [-20.0, 20.0])
def test_a_satellite_that_claims_a_centimetre_and_is_wrong_by_twenty_metres(case, clean, metres):
    sat = int(clean.sat[np.argmax(clean.elevation)])
    k = clean.sat == sat
    wrong = faulty(clean, sat, 50.0, 80.0, metres)
    wrong = replace(wrong, sigma_range=np.where(k, 0.01, wrong.sigma_range))
    result = case.navigated(wrong)
    assert any("excluded by fault detection" in note for note in result.notes)
    sound(case, result, 3.0)


@pytest.mark.parametrize("metres", [pytest.param(-20.0, marks=pytest.mark.campaign), 20.0])
def test_a_fault_among_three_satellites_is_left_to_the_filter(case, clean, metres):
    """Nothing is redundant within an epoch then: the innovation test finds it, and counts."""
    cut = limited(clean, 1, 3, ((48.0, 70.0),))
    sat = int(np.unique(cut.sat[(cut.t > 52.0) & (cut.t < 60.0)])[0])
    wrong = faulty(cut, sat, 52.0, 60.0, metres)
    at_fault = (wrong.sat == sat) & (wrong.t >= 52.0) & (wrong.t < 60.0)
    assert at_fault.sum() == 16
    good, bad = case.navigated(cut), case.navigated(wrong)
    extra = bad.innovations.rejected()["pseudorange"] - good.innovations.rejected()["pseudorange"]
    assert extra >= 13
    sound(case, bad, 4.0)


def test_late_and_repeated_epochs(case, clean):
    """A log out of order cannot become Ranges; one put in order, with an epoch twice, gives the same as without."""
    k = np.sort(np.concatenate((np.arange(len(clean)), np.flatnonzero(clean.t == 33.0))))
    twice, once = case.navigated(clean.where(k)), case.navigated(clean)
    np.testing.assert_array_equal(twice.trajectory.r_eb_e, once.trajectory.r_eb_e)
    with pytest.raises(InputError, match="in order of time"):
        clean.where(np.r_[1000, np.arange(10)])


def test_gaps_in_the_ranges_are_bridged(case, clean):
    gap = clean.where((clean.t < 60.0) | (clean.t > 72.0))
    result = case.navigated(gap)
    error, sigma = case.error_n(result), result.sigma("dr")
    assert np.all(np.abs(error) < 5.0 * sigma)
    assert np.abs(error[result.t > 75.0]).max() < 2.0


# --- carrier phases ---------------------------------------------------------------------------------------------------


def test_carriers_make_velocity_surer_and_slips_do_no_harm(case, clean):
    """What is claimed is true of both runs; a slip of a cycle every 20 s is found before the filter."""
    slips = np.where(clean.sat == clean.sat[0], 0.1903 * np.floor(clean.t / 20.0), 0.0)
    codes = case.navigated(clean)
    carriers = case.navigated(clean, carrier="time-differenced")
    slipped = case.navigated(replace(clean, carrier_range=clean.carrier_range + slips), carrier="time-differenced")
    assert np.all(carriers.sigma("dv")[-1] < 0.8 * codes.sigma("dv")[-1])
    assert np.all(np.abs(case.error_n(carriers)[10:]) < 5.0 * carriers.sigma("dr")[10:])
    moved = slipped.states.v_eb_e - carriers.states.v_eb_e
    assert np.abs(moved).max() < 0.005
    assert any("5 of " in note and "cycle slips" in note for note in slipped.notes), slipped.notes
    assert slipped.innovations.rejected().get("carrier_phase", 0) == 0
    assert carriers.layout.blocks == codes.layout.blocks


def test_carriers_that_are_not_there_are_refused(case, clean):
    bare = replace(clean, carrier_range=np.full(len(clean), np.nan))
    with pytest.raises(InputError, match="needs carrier phases of a satellite at two epochs in a row"):
        case.navigated(bare, carrier="time-differenced")


def test_a_base_makes_it_centimetres(case):
    """The whole way: aligned from single points, 20 s without satellites, integers fixed again."""
    budget = replace(BUDGET, carrier_walk=0.0)  # the base shares it
    k, rng = len(case.t), np.random.default_rng(8)
    base_e = frames.ecef_from_llh(ORIGIN) + 200.0
    at_rest = np.tile(base_e, (k, 1)), np.zeros((k, 3))
    base = synthetic_ranges(case.t, *at_rest, case.orbits, rng, budget, epoch_gps_s=EPOCH, elevation_mask=0.2).ranges
    rover = synthetic_ranges(
        case.t, case.r, case.v, case.orbits, np.random.default_rng(9), budget, epoch_gps_s=EPOCH, elevation_mask=0.2
    )
    gone = rover.ranges.where((rover.ranges.t < 60.0) | (rover.ranges.t >= 80.0))
    llh = tuple(frames.llh_from_ecef(base_e) * (180.0 / np.pi, 180.0 / np.pi, 1.0))
    result = case.navigated(gone, base=base, carrier="rtk", base_station=llh)
    error = np.linalg.norm(case.error_n(result), axis=1)
    assert np.all(error[(result.t > 50.0) & (result.t < 60.0)] < 0.06)
    assert np.all(error[(result.t > 100.0) & (result.t < 119.5)] < 0.06)
    assert np.all(np.abs(case.error_n(result)[10:]) < 5.0 * result.sigma("dr")[10:])
    assert not result.innovations.rejected()["position"]
