"""Course and mount: the heading of a turned IMU is as uncertain as its mount, and both come out together."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from schuler import rotation
from schuler.filtering.initial_state import InitialState
from schuler.filtering.states import StateLayout, StateModel
from schuler.mechanization.strapdown import NavState
from schuler.navigation.run import navigate
from schuler.navigation.start.alignment import with_mount_in_heading
from schuler.simulation.scenario import prepare_mission, simulate_mission

IMU = {
    "gyro": {"noise_deg_s_rthz": 0.1, "density": "two-sided", "bias_deg_s": 0.1},
    "accel": {"noise_ug_rthz": 1350.0, "density": "two-sided", "bias_mg": 20.0},
}
POINTS = [
    {"north_m": 0.0, "east_m": 0.0, "speed_m_s": 10.0, "stop_s": 25.0},
    {"north_m": 200.0, "east_m": -30.0, "speed_m_s": 12.0},
    {"north_m": 330.0, "east_m": 120.0, "speed_m_s": 9.0},
    {"north_m": 200.0, "east_m": 330.0, "speed_m_s": 13.0},
    {"north_m": -60.0, "east_m": 300.0, "speed_m_s": 10.0},
]


def initial_state(models, lever_sigma=0.0):
    layout = StateLayout(models)
    nav = NavState.from_geodetic(0.0, [0.8, 0.2, 400.0], [1.0, 2.0, 0.0], [0.0, 0.0, 0.7])
    return layout, InitialState.from_sigmas(
        nav, layout, attitude=[0.01, 0.01, 0.02], velocity=[0.1] * 3, position=[1.0] * 3
    )


def test_the_variance_of_the_mount_is_in_the_heading_and_their_correlation_too():
    # closed form: heading = course + yaw of the mount
    layout, initial = initial_state({"mount": StateModel.constant(0.05)})
    P = with_mount_in_heading(initial, layout, np.zeros(3)).P
    yaw = layout["mount"].start + 1
    assert P[2, 2] == pytest.approx(0.02**2 + 0.05**2, rel=1e-12)
    assert P[2, yaw] == pytest.approx(0.05**2, rel=1e-12)
    # the heading of the vehicle, body less mount, is as uncertain as before
    u = np.zeros(layout.size)
    u[2], u[yaw] = 1.0, -1.0
    assert u @ P @ u == pytest.approx(0.02**2, rel=1e-12)


def test_the_antenna_stays_at_its_fix():
    layout, initial = initial_state({"mount": StateModel.constant(0.05)})
    lever = np.array([1.5, 0.3, -1.0])
    P = with_mount_in_heading(initial, layout, lever).P
    arm = rotation.rotate(initial.nav.q_nb, lever)
    A = np.hstack((-rotation.skew(arm), np.zeros((3, 3)), np.eye(3), np.zeros((3, 2))))  # error of the antenna
    before = A @ initial.P @ A.T
    assert np.allclose(A @ P @ A.T, before, rtol=0.0, atol=1e-12)


def test_without_a_mount_nothing_changes():
    layout, initial = initial_state({"b_g": StateModel.constant(1e-4)})
    assert with_mount_in_heading(initial, layout, np.ones(3)) is initial


def turned_drive(seed, yaw_deg):
    mission = {
        "seed": seed,
        "motion": {"type": "waypoints", "lat_deg": 47.0, "lon_deg": 8.0, "height_m": 400.0, "waypoints": POINTS},
        "imu": {"rate_hz": 50.0, "kind": "rate", **IMU},
        "gnss": {"rate_hz": 1.0, "first_s": 0.37, "lever_arm_m": [0.0, 0.0, -1.0]},
    }
    recording = simulate_mission(prepare_mission(mission)).recording
    C = rotation.dcm_from_rpy(np.radians([0.0, 0.0, yaw_deg]))
    imu = recording.imu
    return replace(recording, imu=replace(imu, gyro=imu.gyro @ C, accel=imu.accel @ C))


@pytest.mark.thinned(2)
@pytest.mark.parametrize("yaw_deg", [-4.6, 4.6])
def test_a_turned_mount_comes_out_within_its_claim(yaw_deg):
    z, heading = [], []
    for seed in range(1, 7):
        recording = turned_drive(seed, yaw_deg)
        config = {
            "imu": IMU, "gnss": {"lever_arm_m": [0.0, 0.0, -1.0]}, "filter": {"smooth": False, "tune": False},
            "aiding": {"non_holonomic": {"mount_sigma_deg": 5.0}}, "alignment": {"min_speed_m_s": 5.0},
        }  # fmt: skip
        result = navigate(recording, config)
        mount, sigma = result.parameter("mount")[:, 1], result.sigma("mount")[:, 1]
        z.append((mount[-1] - np.radians(yaw_deg)) / sigma[-1])
        early = slice(0, 8)  # while accelerations have not shown it yet
        truth = recording.reference.at(result.t[early]).full()
        error = result.states.rpy_nb[early, 2] - truth.rpy_nb[:, 2] - np.radians(yaw_deg)
        error = (error + np.pi) % (2.0 * np.pi) - np.pi
        heading.append(np.mean((error / result.sigma("dpsi")[early, 2]) ** 2))
    # statistical: six values of one degree of freedom each; 99.9 % of chi-square(6) / 6
    assert np.mean(np.square(z)) < 3.75
    assert np.mean(heading) < 3.75
