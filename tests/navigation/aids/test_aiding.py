"""From a configuration to aids: which states and measurements follow, and what is refused."""

from __future__ import annotations

from dataclasses import replace

import aided_cases as ac
import numpy as np
import pytest
from aided_recording import drawn, parse, recorded

from schuler import units
from schuler.exceptions import ConfigError, InputError
from schuler.filtering import measurements as ms
from schuler.filtering.states import StateModel
from schuler.navigation.aids import aiding, satellite
from schuler.navigation.aids.aiding import Sources, aiding_schedule
from schuler.navigation.aids.satellite import range_measurements
from schuler.navigation.aids.vehicle import VehicleConditions, non_holonomic, smoothed_motion
from schuler.navigation.inputs.satellites import limited
from schuler.navigation.sections import RestSection
from schuler.navigation.states import aiding_models, clock_models, imu_spec, state_layout


@pytest.fixture(scope="module")
def truth():
    return drawn()


@pytest.fixture(scope="module")
def recording(truth):
    return recorded(truth)


# Models and layouts of configurations


@pytest.mark.parametrize(
    ("sections", "expected"),
    [
        ({}, {}),
        ({"gnss": {"lever_sigma_m": 0.2, "delay_sigma_s": 0.05}}, {"lever": 0.2, "delay": 0.05}),
        (
            {"aiding": {"non_holonomic": {"mount_sigma_deg": 2.0, "lever_sigma_m": 0.4}}},
            {"mount": 2.0 * units.DEG, "lever_v": 0.4},
        ),
        ({"aiding": {"non_holonomic": {"mount_sigma_deg": 0.0}}}, {}),
        ({"aiding": {"odometer": {"scale_sigma": 0.03}}}, {"odometer": 0.03}),
        (
            {"aiding": {"odometer": {"mount_sigma_deg": 1.0}, "non_holonomic": {"mount_sigma_deg": 3.0}}},
            {"mount": 3.0 * units.DEG, "odometer": 0.02},
        ),
        ({"aiding": {"heading": {"bias_sigma_deg": 4.0}}}, {"b_heading": 4.0 * units.DEG}),
        ({"aiding": {"heading": {}}}, {}),
        ({"aiding": {"barometer": {"bias_sigma_m": 10.0}}}, {"baro": 10.0}),
        ({"aiding": {"barometer": {"bias_sigma_m": 0.0}}}, {}),
        ({"gnss": {"correlated": {"position_sigma_m": 1.5}}}, {"b_r": 1.5}),
        ({"gnss": {"correlated": {"velocity_sigma_m_s": 0.1}}}, {"b_v": 0.1}),
        ({"gnss": {"coupling": "tight", "correlated": {"position_sigma_m": 1.5}}}, {}),
    ],
)
def test_states_follow_from_the_aids(sections, expected):
    models = aiding_models(parse(**sections), None)
    assert {name: m.sigma for name, m in models.items()} == pytest.approx(expected)
    assert all(m.sigma > 0.0 for m in models.values())
    lay = state_layout(parse(**sections), imu_spec(parse(**sections)))
    assert list(lay.models) == ["b_a", "b_g", *models]


def test_models_given_by_hand_come_before_those_that_follow():
    c = parse(
        aiding={"barometer": {}}, filter={"models": {"baro": {"sigma": 3.0, "noise": 0.1, "tau_s": 100.0}}}
    )  # fmt: skip
    assert state_layout(c, imu_spec(c)).models["baro"] == StateModel(3.0, 0.1, 100.0)


def test_clocks_of_a_tight_configuration(recording):
    c = parse(gnss={"coupling": "tight", "tight": {"clock_sigma_m": 50.0, "system_noise_m": 0.05}})
    models = aiding_models(c, recording.ranges)
    assert list(models) == ["clock", "clock_drift", "clock_2"]
    assert models["clock"] == StateModel.random_walk(50.0, 0.3)
    assert models["clock_2"] == StateModel.random_walk(50.0, 0.05)
    assert list(clock_models(
        replace(recording.ranges, groups=("G", "R", "E", "C")), offset_sigma=1, drift_sigma=1, offset_noise=1,
        drift_noise=1, between_sigma=1,
    )) == ["clock", "clock_drift", "clock_2", "clock_3", "clock_4"]  # fmt: skip


@pytest.mark.parametrize(
    ("sections", "message"),
    [
        ({"gnss": {"coupling": "deep"}}, "coupling"),
        ({"aiding": {"zupt": {}}}, "zupt"),
        ({"aiding": {"zero_velocity": {"sigma_m_s": 0.0}}}, "sigma_m_s"),
        ({"aiding": {"odometer": {"gate": 1.5}}}, "gate"),
        ({"aiding": {"fixes": {"t_s": [1.0]}}}, "llh_deg"),
        ({"gnss": {"tight": {"min_satellites": 0}}}, "min_satellites"),
        ({"gnss": {"tight": {"clock_noise_m": -1.0}}}, "clock_noise_m"),
        ({"gnss": {"correlated": {"position_tau_s": 0.0}}}, "position_tau_s"),
    ],
)
def test_impossible_configurations_are_refused_with_their_place(sections, message):
    with pytest.raises(ConfigError, match=message):
        parse(**sections)


# Measurements of configurations


def sources(recording, **more):
    return Sources(recording.imu, recording.gnss, None, recording.odometer, recording.heading, recording.height, **more)


def test_schedule_begins_after_the_start_and_is_in_order(recording):
    c = parse(
        gnss={"lever_arm_m": list(ac.LEVER)},
        aiding={"non_holonomic": {}, "odometer": {}, "heading": {}, "barometer": {}, "zero_velocity": {}},
    )  # fmt: skip
    s, notes = aiding_schedule(sources(recording), c, imu_spec(c), 10.0, 0.0)
    assert s.t.min() > 10.0
    assert np.all(np.diff(s.t) >= 0.0)
    assert len(notes) == 1
    assert {ms.KINDS[k] for k in s.kind} == {
        "position", "velocity", "lateral", "vertical", "speed", "heading", "height", "zero_velocity",
    }  # fmt: skip


def test_known_places_count_their_time_from_the_start_of_the_recording(recording):
    c = parse(aiding={"fixes": {"t_s": [30.0, 20.0], "llh_deg": [[47.0, 8.0, 450.0], [47.1, 8.0, 450.0]]}})
    s, _ = aiding_schedule(Sources(recording.imu), c, imu_spec(c), 100.0, 100.0)
    assert s.t.tolist() == [120.0, 130.0]
    assert s.kind.tolist() == [ms.FIX, ms.FIX]


def test_sigmas_of_a_configuration_replace_those_of_the_series(recording):
    c = parse(
        gnss={"coupling": "off"},
        aiding={"odometer": {"sigma_m_s": 0.5}, "heading": {"sigma_deg": 2.0}, "barometer": {"sigma_m": 3.0}},
    )  # fmt: skip
    s, _ = aiding_schedule(sources(recording), c, imu_spec(c), 0.0, 0.0)
    for kind, sigma in ((ms.SPEED, 0.5), (ms.HEADING, 2.0 * units.DEG), (ms.HEIGHT, 3.0)):
        np.testing.assert_allclose(s.R[s.kind == kind, 0, 0], sigma**2)


def test_gnss_is_thinned_to_a_least_spacing(recording):
    thin = satellite.thinned(recording.gnss, 3.0)
    assert np.diff(thin.t).min() == pytest.approx(3.0)
    assert satellite.thinned(recording.gnss, 0.0) is recording.gnss


def test_rests_are_the_stops(recording, truth):
    """A simulated ride without vibration is as quiet as rest: GNSS vetoes it, but is not asked in an outage."""
    alone = aiding.rests(recording.imu, None, RestSection())
    intervals = aiding.rests(recording.imu, recording.gnss, RestSection())
    speed = np.linalg.norm(truth.drive.motion.state(recording.imu.t).v_eb_e, axis=1)
    assert len(alone) > len(intervals)
    assert not np.any(intervals.mask & (speed > 0.5))
    assert np.mean(intervals.mask[ac.at_rest(truth, recording.imu.t)]) > 0.8
    for mask, part in ((alone.mask, alone), (intervals.mask, intervals)):
        assert sum(b - a for a, b in part.index) == mask.sum()
    quiet = alone.start[~np.isin(alone.start, intervals.start)][0] - 1.0
    blind = aiding.rests(recording.imu, recording.gnss, RestSection(), windows=((quiet, 1e9),))
    assert len(blind) == len(alone)
    by_positions = aiding.rests(recording.imu, replace(recording.gnss, v_n=None, cov_v_n=None), RestSection())
    assert not np.any(by_positions.mask & (speed > 4.0))  # positions of metres see a slow ride late


def test_conditions_of_non_slipping(recording, truth):
    """Sharp turns are marked for the lateral, hard braking for the vertical, and neither for the other."""
    strict = VehicleConditions(max_turn_rate=0.2, max_forward_acceleration=1.5)
    s = non_holonomic(recording.imu, conditions=strict)
    lateral, vertical = s.where(s.kind == ms.LATERAL), s.where(s.kind == ms.VERTICAL)
    state = truth.drive.motion.state(lateral.t)
    turn = np.abs(state.omega_eb_b[:, 2])
    along = np.abs(np.einsum("ni,ni->n", state.C_eb[:, :, 0], state.a_eb_e))
    assert np.all(lateral.gate[turn > 0.25] < 0.0)
    assert np.all(lateral.gate[(turn < 0.15) & (along > 1.6)] > 0.0)
    assert np.all(vertical.gate[along > 1.9] < 0.0)
    assert np.all(vertical.gate[along < 1.0] > 0.0)
    assert np.all(s.z[:, 7] == strict.min_speed)
    assert np.isfinite(smoothed_motion(recording.imu, lateral.t)[0]).all()
    assert len(non_holonomic(recording.imu, start=1e6)) == 0
    with pytest.raises(InputError, match="expected positive rate_hz and sigmas"):
        non_holonomic(recording.imu, sigma_lateral=0.0)


def test_ranges_that_may_not_be_used_are_left_out(recording):
    r = recording.ranges
    reason = np.zeros(len(r), dtype=int)
    reason[::3] = 4
    holes = replace(r, reason=reason, range_rate=np.where(np.arange(len(r)) % 2, np.nan, r.range_rate))
    s = range_measurements(holes, ac.LEVER, sigma_scale=2.0)
    used = reason == 0
    assert np.sum(s.kind == ms.PSEUDORANGE) == used.sum()
    assert np.sum(s.kind == ms.RANGE_RATE) == np.sum(used & np.isfinite(holes.range_rate))
    np.testing.assert_allclose(s.R[s.kind == ms.PSEUDORANGE, 0, 0], 4.0 * ac.SIGMA_RANGE**2)
    assert not np.any(range_measurements(r, ac.LEVER, use_rates=False).kind == ms.RANGE_RATE)
    with pytest.raises(InputError, match="at most 4 receiver clocks"):
        range_measurements(replace(r, groups=tuple("GRECJ")), ac.LEVER)


def test_only_the_highest_satellites_and_no_thin_epochs(recording):
    r = recording.ranges
    top = limited(r, 1, 3)
    for t in np.unique(r.t)[:5]:
        best = np.sort(r.elevation[r.t == t])[-3:]
        np.testing.assert_array_equal(np.sort(top.elevation[top.t == t]), best)
    first = r.t == r.t[0]
    thin = replace(r, reason=np.where(first & (np.arange(len(r)) > 1), 3, 0))
    assert not np.any(limited(thin, 3, None).t == r.t[0])
    assert np.sum(limited(thin, 2, None).t == r.t[0]) == 2
