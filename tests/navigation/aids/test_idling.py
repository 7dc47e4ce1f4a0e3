"""Stops with the engine idling: found by comparison with the drive, never where something moves."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from schuler.navigation.aids.rest import SHAKEN, horizontal_speeds, rests, zero_velocities
from schuler.navigation.sections import RestSection
from schuler.simulation.scenario import prepare_mission, simulate_mission
from schuler.standstill.stationarity import static_intervals

POINTS = [
    {"north_m": 0.0, "east_m": 0.0, "speed_m_s": 10.0, "stop_s": 30.0},
    {"north_m": 250.0, "east_m": 0.0, "speed_m_s": 12.0, "stop_s": 15.0},
    {"north_m": 350.0, "east_m": 150.0, "speed_m_s": 9.0, "stop_s": 10.0},
    {"north_m": 200.0, "east_m": 380.0, "speed_m_s": 14.0},
    {"north_m": -100.0, "east_m": 350.0, "speed_m_s": 10.0},
]


MISSION = {
    "seed": 4,
    "motion": {"type": "waypoints", "lat_deg": 47.0, "lon_deg": 8.0, "height_m": 400.0, "waypoints": POINTS},
    "imu": {"rate_hz": 50.0, "kind": "rate", "catalogue": "MTi-G-710"},
    "gnss": {"rate_hz": 1.0},
}


@pytest.fixture(scope="module")
def drive():
    """Engine off for 15 s, then idling at 0.15 m/s^2, driving at 1 m/s^2; and the true speed."""
    recording = simulate_mission(prepare_mission(MISSION)).recording
    imu = recording.imu
    truth = recording.reference
    speed = np.interp(imu.t, truth.t, np.linalg.norm(truth.v_eb_e, axis=1))
    rng = np.random.default_rng(1)
    level = np.where(speed > 0.05, 1.0, np.where(imu.t - imu.t[0] < 15.0, 0.01, 0.15))[:, None]
    accel = imu.accel + level * rng.standard_normal(imu.accel.shape)
    gyro = imu.gyro + 0.05 * level * rng.standard_normal(imu.gyro.shape)
    return replace(recording, imu=replace(imu, accel=accel, gyro=gyro)), speed


def test_stops_of_an_idling_engine_are_found_and_nothing_else(drive):
    recording, speed = drive
    standing = speed < 0.01
    quiet = static_intervals(recording.imu, min_s=1.0, window_s=0.5)
    intervals = rests(recording.imu, recording.gnss, RestSection())
    assert quiet.mask[standing].mean() < 0.35  # the engine is off for a quarter of the time at rest
    assert intervals.mask[standing].mean() > 0.85
    assert not np.any(intervals.mask & (speed > 0.2))
    assert any(note.startswith(SHAKEN) for note in intervals.notes)
    assert sum(b - a for a, b in intervals.index) == intervals.mask.sum()


def test_they_are_found_in_outages_and_by_positions_alone(drive):
    recording, speed = drive
    second = recording.imu.t[0] + 50.0
    window = ((second, second + 30.0),)
    intervals = rests(recording.imu, recording.gnss, RestSection(), window)
    inside = (recording.imu.t > window[0][0]) & (recording.imu.t < window[0][1])
    assert intervals.mask[inside & (speed < 0.01)].mean() > 0.7
    assert not np.any(intervals.mask & (speed > 0.2))
    precise = replace(recording.gnss, v_n=None, cov_v_n=None, cov_r_n=recording.gnss.cov_r_n * 1e-4)
    by_positions = rests(recording.imu, precise, RestSection())
    assert not np.any(by_positions.mask & (speed > 1.0))


def test_a_calm_ride_in_an_outage_is_no_rest_where_stops_are_calmer(drive):
    """The detector alone takes it for one: its noise is that of the stops, and its margin is wide."""
    recording, speed = drive
    rng = np.random.default_rng(2)
    last = recording.imu.t[-1]
    window = ((last - 40.0, last + 1.0),)
    calm = recording.imu.t > last - 40.0
    level = np.where(speed < 0.05, 0.1, np.where(calm, 0.4, 1.0))[:, None]
    truth = simulate_mission(prepare_mission(MISSION)).recording.imu
    imu = replace(
        truth,
        accel=truth.accel + level * rng.standard_normal(truth.accel.shape),
        gyro=truth.gyro + 0.05 * level * rng.standard_normal(truth.gyro.shape),
    )
    section = RestSection(margin=8.0)
    alone = static_intervals(imu, min_s=section.min_s, window_s=section.window_s, margin=section.margin)
    assert np.any(alone.mask & (speed > 2.0))
    assert not np.any(rests(imu, recording.gnss, section, window).mask & (speed > 2.0))


def test_a_large_sigma_of_the_vertical_velocity_hides_no_motion(drive):
    """Receivers without a vertical velocity state 10 m/s for it."""
    recording, _ = drive
    cov = recording.gnss.cov_v_n.copy()
    cov[:, 2, 2] = 100.0
    intervals = rests(recording.imu, replace(recording.gnss, cov_v_n=cov), RestSection())
    assert np.array_equal(intervals.mask, rests(recording.imu, recording.gnss, RestSection()).mask)


def test_speeds_of_positions_agree_with_velocities(drive):
    recording, _ = drive
    g = recording.gnss
    t, speed, sigma = horizontal_speeds(replace(g, v_n=None, cov_v_n=None))
    with_v = np.interp(t, g.t, np.hypot(g.v_n[:, 0], g.v_n[:, 1]))
    # statistical: five sigmas of the difference of two positions, and the curvature within a second
    assert np.all(np.abs(speed - with_v) < 5.0 * sigma + 1.5)


def test_the_vibration_of_a_stop_is_in_its_zero_velocities(drive):
    recording, _ = drive
    intervals = rests(recording.imu, recording.gnss, RestSection())
    plain = zero_velocities(intervals, sigma=0.02)
    shaken = zero_velocities(intervals, sigma=0.02, imu=recording.imu)
    assert np.array_equal(plain.t, shaken.t)
    first = recording.imu.t[intervals.index[0, 0]]
    accel = recording.imu.accel[intervals.index[-1, 0] : intervals.index[-1, 1]]
    expected = 0.02**2 + accel.var(axis=0).max() / (6.0 * np.pi) ** 2
    assert shaken.R[-1, 0, 0] == pytest.approx(expected, rel=1e-12)
    assert plain.t[0] == first
