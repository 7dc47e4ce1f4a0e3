"""Claims in minutes without fixes: stretches made beside fixes find wheels that err for long, and only these."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from schuler.filtering.measurements import POSITION, VELOCITY, gnss_measurements, merged
from schuler.navigation.config import NavigationConfig
from schuler.navigation.inputs.gnss_faults import UNAIDED_UNTESTED, UNAIDED_WRONG
from schuler.navigation.prepared import longest_without_fixes
from schuler.navigation.run import navigate, prepared_run
from schuler.navigation.tuning import unaided
from schuler.navigation.tuning.noise import WANDERS
from schuler.navigation.tuning.tuning import tune
from schuler.navigation.tuning.unaided import Withheld, as_sure_as_withheld
from schuler.rotation import dcm_from_rpy
from schuler.simulation.scenario import prepare_mission, simulate_mission
from schuler.units import DEG

IMU = {
    "gyro": {"arw_deg_rthr": 3.0, "bias_deg_hr": 100.0, "in_run_deg_hr": 20.0, "in_run_time_s": 300.0},
    "accel": {"vrw_m_s_rthr": 1.0, "bias_mg": 3.0, "in_run_mg": 0.3, "in_run_time_s": 300.0},
}
#: Three times round a block of 1.2 km.
CORNERS = [(0, 0, 10), *[(300, -30, 12), (330, 250, 9), (60, 300, 13), (0, 0, 11)] * 3]
POINTS = [
    {"north_m": float(n), "east_m": float(e), "speed_m_s": float(v)} | ({} if i else {"stop_s": 10.0})
    for i, (n, e, v) in enumerate(CORNERS)
]
PERIOD = 10.0
ENDS = 240.0  # fixes, of a drive of 350 s


def driven(swing_deg=0.0, seed=1):
    """A car whose IMU swings in its mount about down in ten seconds, and whose fixes end; and those left out."""
    mission = prepare_mission(
        {
            "seed": seed,
            "motion": {"type": "waypoints", "lat_deg": 47.0, "lon_deg": 8.0, "height_m": 400.0, "waypoints": POINTS},
            "imu": {"rate_hz": 20.0, "kind": "rate", **IMU},
            "gnss": {
                "rate_hz": 1.0,
                "lever_arm_m": [0.0] * 3,
                "sigma_position_m": [0.3, 0.3, 0.5],
                "sigma_velocity_m_s": [0.05] * 3,
            },
        }
    )
    recording = simulate_mission(mission).recording
    imu, gnss = recording.need_imu(), recording.need_gnss()
    phase = 2.0 * np.pi * imu.t / PERIOD
    yaw = swing_deg * DEG * np.sin(phase)
    turned = dcm_from_rpy(np.column_stack((0.0 * yaw, 0.0 * yaw, yaw))).swapaxes(1, 2)
    gyro, accel = (np.einsum("nij,nj->ni", turned, x) for x in (imu.gyro, imu.accel))
    gyro[:, 2] += swing_deg * DEG * np.cos(phase) * 2.0 * np.pi / PERIOD
    recording = replace(recording, imu=replace(imu, gyro=gyro, accel=accel), reference=None)
    return replace(recording, gnss=gnss.where(gnss.t <= ENDS)), gnss.where(gnss.t > ENDS)


def config(**wheels):
    return NavigationConfig.checked(
        {"imu": IMU, "filter": {"smooth": False, "tune": False}, "aiding": {"non_holonomic": wheels}}
    )


@pytest.fixture(scope="module")
def steady():
    recording, left = driven()
    return prepared_run(recording, config()), left


def normalised(run, left):
    """Mean square of horizontal errors beside claims in the last third of the time without fixes."""
    at = left.where(left.t > ENDS + 0.67 * (left.t[-1] - ENDS))
    offered = merged(run.schedule, gnss_measurements(at, (0.0, 0.0, 0.0), use_velocity=False))
    judge = (offered.kind == POSITION) & (offered.t > ENDS)
    offered = replace(offered, gate=np.where(judge, 1e-300, offered.gate))  # predicted, compared and not used
    forward = replace(run, schedule=offered).run()
    return float(np.mean(forward.innovation[judge, :2] ** 2 / forward.variance[judge, :2]))


@pytest.mark.parametrize("swing", [1.0, -1.0])
def test_wheels_that_swing_are_less_sure_long_after_the_last_fix(swing):
    recording, left = driven(swing)
    run = prepared_run(recording, config())
    chosen, weaker, (note,) = as_sure_as_withheld(config(), run)
    factor = chosen.aiding.non_holonomic.unaided_factor
    assert 4.0 <= factor <= 16.0  # 8 and 16 for two seeds of either sign
    assert f"{factor:g} times less surely" in note
    assert Withheld(run).errors().nees > 16.0  # seen 24, 26
    assert Withheld(run).errors(factor).nees < 2.0  # seen 0.6, 0.8; twelve stretches, of which three do not overlap
    assert normalised(run, left) > 3.0  # seen 4.4, 4.6
    assert normalised(weaker, left) < 2.0  # seen 0.2, 0.8
    again = prepared_run(recording, chosen)
    np.testing.assert_array_equal(again.schedule.R, weaker.schedule.R)
    stated = as_sure_as_withheld(config(unaided_factor=2.0), run)[0]
    assert stated.aiding.non_holonomic.unaided_factor == 2.0  # said by hand


def test_a_mount_that_gives_way_is_doubted(monkeypatch):
    """What no factor makes good."""
    monkeypatch.setattr(unaided, "_FACTORS", (2.0,))
    recording, _ = driven(2.0)
    notes = as_sure_as_withheld(config(), prepared_run(recording, config()))[2]
    assert notes[-1].startswith(UNAIDED_WRONG)
    result = navigate(recording, config())
    judged = replace(result, notes=(*result.notes, *notes)).verdict
    assert judged.status == "doubtful"
    assert notes[-1] in judged.reasons
    assert any("mount that gives way" in cause for cause in judged.causes)


def test_wheels_that_do_not_slip_stay_as_sure_as_they_are(steady):
    run, left = steady
    chosen, same, notes = as_sure_as_withheld(config(), run)
    assert chosen == config()
    assert same is run
    assert notes == []
    assert normalised(run, left) < 3.0  # seen 0.3


def test_a_stretch_is_the_run_of_a_log_whose_fixes_end_there(steady):
    run, _ = steady
    withheld = Withheld(run)
    made = withheld.errors().residuals
    start = float(made.t[4])
    usual = run.schedule.t <= start
    kept = usual | ~np.isin(run.schedule.kind, (POSITION, VELOCITY))
    result = replace(run, schedule=run.schedule.where(kept)).run()
    at = np.searchsorted(run.schedule.t, start + withheld.length_s - 1e-6)
    k = at + int(np.flatnonzero(run.schedule.kind[at:] == POSITION)[0])
    i = int(np.argmin(np.abs(result.t - run.schedule.t[k])))
    distance = np.linalg.norm(result.r[i] - run.schedule.z[k, :3])
    assert np.linalg.norm(made.innovation[4]) == pytest.approx(distance, rel=0.01)  # rounding, and half a sample
    assert made.variance[4, 0] > run.schedule.R[k, 0, 0]


def test_short_stretches_and_stated_noise_are_left(steady):
    run, _ = steady
    t = run.schedule.t
    fixed = replace(run, increments=run.increments.between(run.increments.start, ENDS + 20.0))
    assert longest_without_fixes(fixed) == pytest.approx(20.0, abs=1.1)
    assert as_sure_as_withheld(config(), fixed) == (config(), fixed, [])
    assert longest_without_fixes(run) == pytest.approx(t[-1] - ENDS, abs=1.1)


def test_a_time_far_beyond_what_was_tested_is_doubted_of_an_unknown_imu(steady, monkeypatch):
    run, _ = steady
    grade, part = (NavigationConfig.checked({"imu": {"catalogue": name}}) for name in ("consumer", "MPU-6000"))
    assert as_sure_as_withheld(grade, run)[2] == []
    monkeypatch.setattr(unaided, "_BEYOND", 1.5)
    (note,) = as_sure_as_withheld(grade, run)[2]
    assert note.startswith(UNAIDED_UNTESTED)
    assert as_sure_as_withheld(part, run)[2] == []
    assert as_sure_as_withheld(config(), run)[2] == []


@pytest.mark.campaign
@pytest.mark.parametrize("larger", [1.0, 10.0])
def test_wander_that_counts_in_minutes_is_not_tuned_away_unless_the_fixes_exclude_it(larger):
    """White noise is stated five times too small; wander right, or ten times too large, as its own interval allows."""
    imu = {"gyro": {**IMU["gyro"], "arw_deg_rthr": 0.6}, "accel": {**IMU["accel"], "vrw_m_s_rthr": 0.2}}
    imu["gyro"]["in_run_deg_hr"] *= larger
    imu["accel"]["in_run_mg"] *= larger
    stated = NavigationConfig.checked({"imu": imu, "filter": {"smooth": False, "tune": False}})
    run = prepared_run(driven(seed=2)[0], stated)
    short = replace(run, increments=run.increments.between(run.increments.start, ENDS + 20.0))
    usual, minutes = tune(short), tune(run)
    assert minutes.better
    assert set(WANDERS) <= set(usual.factors)
    assert all(usual.factors[name] < 1.0 < usual.intervals[name][1] for name in WANDERS)
    if larger == 1.0:
        assert set(minutes.factors) == set(usual.factors) - set(WANDERS)
    else:
        assert minutes.factors == usual.factors
