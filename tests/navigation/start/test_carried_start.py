"""Late first fixes: attitude, velocity and sensor errors of a rest before, carried to the fix."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import schuler
from schuler.navigation.config import NavigationConfig
from schuler.navigation.evaluation.consistency import chi_square_band, state_errors
from schuler.navigation.run import navigate, prepared_run
from schuler.simulation.scenario import prepare_mission, simulate_mission

EXAMPLES = Path(__file__).parents[3] / "examples"
IMU = {"gyro": {"arw_deg_rthr": 0.2, "bias_deg_s": 0.2}, "accel": {"vrw_m_s_rthr": 0.05, "bias_mg": 3.0}}
POINTS = [
    {"north_m": 0.0, "east_m": 0.0, "speed_m_s": 10.0, "stop_s": 20.0},
    {"north_m": 400.0, "east_m": -30.0, "speed_m_s": 12.0},
    {"north_m": 530.0, "east_m": 120.0, "speed_m_s": 9.0},
    {"north_m": 400.0, "east_m": 330.0, "speed_m_s": 13.0},
]
CARRIED = "carried from a rest"


def drive(seed):
    mission = prepare_mission(
        {
            "seed": seed,
            "motion": {"type": "waypoints", "lat_deg": 47.0, "lon_deg": 8.0, "height_m": 400.0, "waypoints": POINTS},
            "imu": {"rate_hz": 50.0, **IMU},
            "gnss": {"rate_hz": 1.0, "lever_arm_m": [0.5, 0.2, -1.0], "sigma_position_m": [0.5, 0.5, 1.0]},
        }
    )
    return simulate_mission(mission).recording


def late(first, last=1e4, **sections):
    windows = [[0.0, first], [last, 1e4]] if last < 1e4 else [[0.0, first]]
    gnss = {"lever_arm_m": [0.5, 0.2, -1.0]}
    return {"imu": IMU, "gnss": gnss, "filter": {"smooth": False, "tune": False}, "outages": {"windows_s": windows},
            **sections}  # fmt: skip


def method(prepared):
    return next(note for note in prepared.notes if note.startswith("aligned "))


@pytest.mark.parametrize("velocities", [True, pytest.param(False, marks=pytest.mark.campaign)])
def test_a_carried_start_s_claim_holds(velocities):
    """Navigation and bias errors at the first record, four drives with biases of their own, starts at two times."""
    values = []
    for seed in range(4):
        log = drive(seed)
        if not velocities:
            log = replace(log, gnss=replace(log.need_gnss(), v_n=None, cov_v_n=None))
        for first in (38.0, 57.0):
            result = navigate(log, late(first, first + 3.0))
            if not any(CARRIED in note for note in result.notes):
                continue
            _, dx, P = state_errors(result, log.reference)
            s = np.sqrt(np.diag(P[0])[:9])
            values.append((dx[0, :9] / s) @ np.linalg.solve(P[0][:9, :9] / np.outer(s, s), dx[0, :9] / s) / 9.0)
    assert len(values) >= 6  # of eight; where a few fixes make the other start likelier by chance, that is taken
    low, high = chi_square_band(9, 4, 0.9999)  # statistical: two starts of a drive share its biases
    assert low < np.mean(values) < high


def test_a_velocity_behind_a_carried_rest_shows_tilt_and_bias_together():
    """Free inertial for 15 s after two fixes: less than a third of the drift of a start levelled in motion."""
    log = drive(11)
    ratio = []
    for first in (38.0, 45.0, 57.0):
        errors = []
        for rest_s in (300.0, 0.0):
            section = {"alignment": {"rest_s": rest_s}}
            result = navigate(log, late(first, first + 2.0, **section)).errors(log.reference)
            errors.append(result.between(first, first + 17.0).rms_horizontal)
        ratio.append(errors[0] / errors[1])
    assert np.mean(ratio) < 0.3  # statistical: three starts


def test_a_steady_drive_is_no_rest():
    """The log begins on a straight road; what the IMU takes for rest contradicts the speed at the fix."""
    log = drive(4)
    begun = replace(log, imu=log.need_imu().between(27.0, log.imu.t[-1]), gnss=log.need_gnss().between(44.0, 1e4))
    prepared = prepared_run(begun, NavigationConfig.checked(late(0.001)))
    assert any("at rest" in note for note in prepared.notes)  # it does look like one
    assert CARRIED not in method(prepared)


@pytest.mark.campaign
@pytest.mark.parametrize("first", [*np.linspace(10.0, 110.0, 20).round(2).tolist(), 71.0])
def test_the_town_with_a_late_first_fix(town, first):
    """RMS within 1.3 of the run with all fixes, whole runs and from ten seconds after the first fix; NEES below 3."""
    recording, config, full = town
    result = navigate(recording, {**config, "outages": {"windows_s": [[0.0, first]]}})
    own, t = result.errors(recording.reference), result.trajectory.t[0]
    complete = full.errors(recording.reference)
    assert own.rms_horizontal < 1.3 * complete.rms_horizontal
    # the first error is that of one fix
    assert own.between(t + 10.0, 1e9).rms_horizontal < 1.3 * complete.between(t + 10.0, 1e9).rms_horizontal
    _, dx, P = state_errors(result, recording.reference)
    e = dx[:, 6:9]
    assert np.mean(np.einsum("ki,ki->k", e, np.linalg.solve(P[:, 6:9, 6:9], e[:, :, None])[:, :, 0])) < 3.0 * 3


@pytest.fixture(scope="module")
def town():
    import tomllib

    recording = schuler.simulate(EXAMPLES / "town.toml")
    config = tomllib.loads((EXAMPLES / "town_navigation.toml").read_text(encoding="utf-8"))
    config["filter"]["smooth"] = False
    return recording, config, navigate(recording, config)


def test_a_gyro_bias_is_no_turn_of_the_antenna():
    """A bias of 20 deg/s on a lever arm of 1.1 m was 0.4 m/s of the start's velocity; 5 mm/s are of the bias found."""
    log = drive(1)
    imu = log.need_imu().rates()
    logs = [replace(log, imu=replace(imu, gyro=imu.gyro + bias)) for bias in (0.0, np.array([0.1, -0.3, 0.2]))]
    loose = late(0.1, imu={**IMU, "gyro": {**IMU["gyro"], "bias_deg_s": 20.0}})
    starts = [prepared_run(x, NavigationConfig.checked(loose)).initial.nav for x in logs]
    np.testing.assert_allclose(starts[1].v_eb_e, starts[0].v_eb_e, atol=0.005)
