"""A start whose heading no fixes fit, found among those of a full circle, and one that fits left alone."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from schuler import frames, rotation
from schuler.exceptions import InputError
from schuler.filtering.initial_state import InitialState
from schuler.mechanization.strapdown import NavState
from schuler.navigation.config import NavigationConfig
from schuler.navigation.prepared import PreparedRun
from schuler.navigation.run import navigate, prepared_run
from schuler.navigation.start.heading import log_likelihood
from schuler.navigation.tuning import automatic, headings
from schuler.navigation.tuning.headings import fitting_turn, turn_note, with_turn
from schuler.navigation.tuning.lever import with_lever
from schuler.simulation.scenario import prepare_mission, simulate_mission
from schuler.units import DEG

IMU = {"gyro": {"arw_deg_rthr": 0.5, "bias_deg_s": 3.0}, "accel": {"vrw_m_s_rthr": 0.3, "bias_mg": 10.0}}
CORNERS = [(0, 0, 6), (40, -10, 7), (60, 30, 5), (20, 60, 8), (-20, 40, 6)]
POINTS = [{"north_m": float(n), "east_m": float(e), "speed_m_s": float(v)} for n, e, v in CORNERS]


@pytest.fixture(scope="module")
def drive():
    """Half a minute of a car under way, its gyroscopes biased by degrees per second, fixes of 5 cm without velocity."""
    mission = prepare_mission(
        {
            "seed": 2,
            "motion": {"type": "waypoints", "lat_deg": 47.0, "lon_deg": 8.0, "height_m": 400.0, "waypoints": POINTS},
            "imu": {"rate_hz": 50.0, "kind": "increment", **IMU},
            "gnss": {"rate_hz": 1.0, "lever_arm_m": [0.0, 0.0, 0.0], "sigma_position_m": [0.05, 0.05, 0.08]},
        }
    )
    recording = simulate_mission(mission).recording
    return replace(recording, gnss=replace(recording.need_gnss(), v_n=None, cov_v_n=None))


@pytest.fixture(scope="module")
def run(drive):
    return prepared_run(drive, NavigationConfig.checked({"imu": IMU, "filter": {"smooth": False}}))


def started(run, drive, off_deg):
    """The run from the truth with its heading off, and headings turned from that one."""
    t = run.initial.nav.t
    at = drive.reference.at(np.array([t]))

    def turned(angle):
        nav = NavState.from_geodetic(t, at.llh[0], at.v_eb_n[0], at.rpy_nb[0] + [0.0, 0.0, off_deg * DEG + angle])
        attitude = np.array([3.0, 3.0, 15.0]) * DEG
        return InitialState.from_sigmas(
            nav, run.layout, attitude=attitude, velocity=[0.3] * 3, position=[0.05, 0.05, 0.1]
        )

    return replace(run, initial=turned(0.0), headings=turned)


def heading_off_deg(run, drive):
    at = drive.reference.at(np.array([run.initial.nav.t]))
    return abs(float(frames.wrap_angle(run.initial.nav.rpy_nb[2] - at.rpy_nb[0, 2]))) / DEG


@pytest.mark.parametrize("component", [0, 1])
def test_a_run_that_broke_down_is_not_judged_by_what_it_did_before(run, component, monkeypatch):
    """Variances below zero in one row: wild estimates of 33 states do so. No warning either."""
    good = log_likelihood(run, run.initial, 60.0)
    forward = run.run()
    variance = forward.variance.copy()
    variance[-3, component] *= -1.0
    nowhere = np.vstack((forward.r[:-1], np.full(3, np.nan)))
    for broken in (replace(forward, variance=variance), replace(forward, r=nowhere)):
        monkeypatch.setattr(PreparedRun, "run", lambda self, broken=broken: broken)
        assert log_likelihood(run, run.initial, 60.0) == (-np.inf, np.inf)
    assert np.isfinite(good).all()


@pytest.mark.parametrize("off_deg", [130.0, pytest.param(-160.0, marks=pytest.mark.campaign)])
def test_a_heading_that_no_noise_explains_is_found_around_the_circle(run, drive, off_deg):
    wrong = started(run, drive, off_deg)
    turn, gain = fitting_turn(wrong)
    assert abs(float(frames.wrap_angle(turn + off_deg * DEG))) < 35.0 * DEG
    assert gain > 25.0
    right = with_turn(wrong, turn)
    # statistical; seen 0.2 and 0.3 deg, claimed to 4.1 and 9.5
    assert heading_off_deg(right, drive) < 2.0
    assert heading_off_deg(right, drive) * DEG < 4.0 * np.sqrt(right.initial.P[2, 2])
    assert "do from a heading some 1" in turn_note(turn, gain)
    assert "do once it is smoothed" in turn_note(0.0, gain)


def test_a_start_found_once_stays_where_smaller_noise_smooths_to_a_wrong_one(run, drive, monkeypatch):
    """Made ready again with tuned noise, the search from 30 deg off ends in a gyro bias of 30 deg/s."""
    right, wrong = started(run, drive, 0.0), started(run, drive, 130.0)
    before = replace(right, initial=replace(right.initial, P=right.initial.P * 0.9))
    monkeypatch.setattr(headings, "_smoothed", lambda prepared: prepared)
    assert heading_off_deg(with_turn(wrong, 0.0), drive) > 125.0
    kept = with_turn(wrong, 0.0, before)
    assert heading_off_deg(kept, drive) < 0.1
    np.testing.assert_allclose(kept.initial.P, before.initial.P, rtol=1e-12)
    assert kept.schedule.t[0] > kept.initial.nav.t >= kept.increments.start - 1e-9
    again = automatic._prepared_at(lambda config, later: wrong, 0.0, before, None, 0.0)
    assert heading_off_deg(again, drive) < 0.1
    # one that fits as well is taken as it comes out, and one of fixes moved in time is no start of this run
    assert with_turn(right, 0.0, before).initial is not before.initial
    np.testing.assert_allclose(with_turn(right, 0.0, before).initial.P, right.initial.P, rtol=1e-12)
    assert heading_off_deg(with_turn(replace(wrong, fixes_later_s=0.1), 0.0, before), drive) > 125.0


def test_a_start_that_stays_has_new_states_as_its_prior_has_them(run, drive):
    """A lever arm that is estimated: the antenna is where it was, the IMU as unsure as the arm."""
    before = started(run, drive, 0.0)
    estimated = np.arange(run.layout.size - 9) * 1e-3
    before = replace(before, initial=replace(before.initial, parameters=estimated))
    config = with_lever(NavigationConfig.checked({"imu": IMU, "filter": {"smooth": False}}))
    free = prepared_run(drive, config)
    start = headings._carried(before.initial, before.layout, free.initial, free.layout)
    assert start.nav is before.initial.nav
    lever = free.layout["lever"]
    H = np.zeros((3, free.layout.size))
    H[:, 6:9], H[:, lever] = np.eye(3), rotation.dcm_from_rpy(start.nav.rpy_nb)
    np.testing.assert_allclose(H @ start.P @ H.T, before.initial.P[6:9, 6:9], atol=1e-12)
    np.testing.assert_allclose(start.P[lever, lever], 0.25 * np.eye(3), rtol=1e-12)
    assert start.P[6, 6] > 0.25
    for name in run.layout.models:
        np.testing.assert_array_equal(
            start.parameters[free.layout[name].start - 9 : free.layout[name].stop - 9],
            estimated[run.layout[name].start - 9 : run.layout[name].stop - 9],
        )
        np.testing.assert_allclose(
            start.P[free.layout[name], free.layout[name]], before.initial.P[run.layout[name], run.layout[name]]
        )


@pytest.mark.campaign
def test_a_run_begins_there_if_noise_may_be_tuned(run, drive, monkeypatch):
    monkeypatch.setattr("schuler.navigation.run.prepared_run", lambda *_, **__: started(run, drive, 130.0))
    for tune, begins in ((True, True), ("auto", False), (False, False)):
        stated = {"imu": {**IMU, "clock_shift_s": 0.0}, "gnss": {"lever_arm_m": [0.0, 0.0, 0.0]}}
        notes = navigate(drive, {**stated, "filter": {"smooth": False, "tune": tune}}).notes
        assert any("do from a heading some" in note for note in notes) == begins, tune  # noise stated by hand stays


def test_a_heading_that_fits_stays(run, drive):
    assert fitting_turn(started(run, drive, 10.0)) is None


def test_without_a_choice_of_headings_there_is_none(run, drive):
    def none(angle):
        raise InputError("no level")

    assert fitting_turn(replace(started(run, drive, 130.0), headings=None)) is None
    assert fitting_turn(replace(started(run, drive, 130.0), headings=none)) is None
