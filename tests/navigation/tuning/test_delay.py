"""A time offset of GNSS stamps that nobody stated: found with its sign, and nothing else taken for it."""

from __future__ import annotations

import re
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from schuler.filtering.measurements import VELOCITY
from schuler.filtering.states import StateLayout
from schuler.navigation.config import NavigationConfig
from schuler.navigation.evaluation.consistency import state_errors
from schuler.navigation.evaluation.evaluated import evaluate_run
from schuler.navigation.evaluation.evidence import _budgets
from schuler.navigation.run import navigate, prepared_run
from schuler.navigation.tuning import delay
from schuler.navigation.tuning.automatic import STATED_NOISE
from schuler.navigation.tuning.delay import (
    DELAY_ESTIMATED,
    delay_note,
    evidences,
    is_borne_out,
    may_have_delay,
    with_delay,
)
from schuler.simulation.scenario import prepare_mission, simulate_mission

IMU = "flenniken-tactical"
CORNERS = [(0, 0, 10), (120, -30, 12), (200, 90, 9), (80, 190, 13), (-40, 120, 10), (-30, 10, 11)]


@cache
def drive(offset=0.0, seed=1, lever=(0.0, 0.0, 0.0), imu=IMU, sigma=0.3):
    """A drive of a minute round some corners, fixes at 2 Hz whose stamps are so much late. [s]"""
    points = [
        {"north_m": float(n), "east_m": float(e), "speed_m_s": float(v)} | ({} if i else {"stop_s": 8.0})
        for i, (n, e, v) in enumerate(CORNERS)
    ]
    mission = prepare_mission(
        {
            "seed": seed,
            "motion": {"type": "waypoints", "lat_deg": 47.0, "lon_deg": 8.0, "height_m": 400.0, "waypoints": points},
            "imu": {"rate_hz": 50.0, "kind": "increment", "catalogue": imu},
            "gnss": {
                "rate_hz": 2.0, "first_s": 0.37, "sigma_position_m": [sigma, sigma, 2.0 * sigma],
                "sigma_velocity_m_s": [0.05, 0.05, 0.1], "clock_shift_s": offset, "lever_arm_m": list(lever),
            },
        }
    )  # fmt: skip
    return simulate_mission(mission).recording


def asked(imu=None, **sections):
    return {"imu": imu or {"catalogue": IMU}, "filter": {"smooth": False}, **sections}


def without_velocities(log):
    return replace(log, gnss=replace(log.gnss, v_n=None, cov_v_n=None))


def position_nees(result, log):
    _, dx, P = state_errors(result, log.need_reference())
    x, S = dx[:, 6:9], P[:, 6:9, 6:9]
    return float(np.mean(np.einsum("ki,ki->k", x, np.linalg.solve(S, x[:, :, None])[:, :, 0])) / 3.0)


def note_of(result):
    return next((note for note in result.notes if note.startswith(DELAY_ESTIMATED)), None)


@pytest.mark.campaign
@pytest.mark.parametrize(
    ("offset", "velocities"),
    [
        (-0.4, True),
        pytest.param(0.15, False, marks=pytest.mark.campaign),
        pytest.param(0.3, True, marks=pytest.mark.campaign),
        pytest.param(-0.15, False, marks=pytest.mark.campaign),
    ],
)
def test_stamps_that_are_off_are_found_and_the_note_states_the_cure(offset, velocities):
    log = drive(offset) if velocities else without_velocities(drive(offset))
    before, result = navigate(log, asked(filter={"smooth": False, "tune": False})), navigate(log, asked())
    sigma = float(result.sigma("delay")[-1, 0])
    assert abs(result.fixes_later_s + offset) < 4.0 * sigma + 0.002  # statistical; Hermite interpolation of the truth
    assert sigma < 0.03
    assert position_nees(before, log) > 5.0
    assert position_nees(result, log) < 2.5  # statistical: one error of few degrees of freedom
    note = note_of(result)
    side, shift = re.search(r"s (late|early) against", note)[1], float(re.search(r"clock_shift_s = (\S+) ", note)[1])
    assert side == ("late" if offset > 0.0 else "early")
    assert abs(shift - offset) < 4.0 * sigma + 0.002
    # the cure: on the clock of GNSS innovations are as predicted, and nothing is left to estimate
    cured = navigate(log, asked({"catalogue": IMU, "clock_shift_s": shift}))
    assert note_of(cured) is None
    assert "delay" not in cured.layout
    assert cured.innovations.mean_nis() < 1.3  # statistical
    assert cured.verdict.status == result.verdict.status == "ok"


@pytest.mark.parametrize("seed", [2, pytest.param(3, marks=pytest.mark.campaign)])
def test_right_stamps_stay_and_the_run_is_the_same_to_the_last_bit(seed):
    log = drive(seed=seed)
    result, plain = navigate(log, asked()), navigate(log, asked(filter={"smooth": False, "tune": False}))
    assert note_of(result) is None
    np.testing.assert_array_equal(result.covariance_e, plain.covariance_e)


@pytest.mark.campaign
@pytest.mark.parametrize("ahead", [1.5, pytest.param(-1.5, marks=pytest.mark.campaign)])
def test_a_lever_arm_that_nobody_stated_is_no_offset(ahead):
    result = navigate(drive(lever=(ahead, 0.2, -0.5)), asked())
    assert note_of(result) is None
    assert "delay" not in result.layout


@pytest.mark.campaign
def test_an_offset_beside_a_lever_arm():
    lever, log = np.array([1.5, 0.2, -0.5]), drive(0.3, lever=(1.5, 0.2, -0.5), sigma=0.02)
    result = navigate(log, asked())
    assert abs(result.fixes_later_s + 0.3) < 4.0 * float(result.sigma("delay")[-1, 0]) + 0.002
    error, sigma = result.parameter("lever")[-1] - lever, result.sigma("lever")[-1]
    assert np.all(np.abs(error[:2]) < 4.0 * sigma[:2])  # statistical; down trades against height
    assert result.verdict.status == "ok"


def late_velocities(log, lateness):
    g, T = log.gnss, log.reference
    v = np.stack([np.interp(g.t - lateness, T.t, T.v_eb_n[:, i]) for i in range(3)], axis=1)
    noise = np.random.default_rng(5).standard_normal(v.shape) * np.sqrt(np.diag(g.cov_v_n[0]))
    return replace(log, gnss=replace(g, v_n=v + noise))


def test_velocities_that_a_receiver_filtered_are_no_offset_of_its_stamps():
    run = prepared_run(late_velocities(drive(), 0.13), with_delay(NavigationConfig.checked(asked())))
    assert np.any(run.schedule.kind == VELOCITY)
    assert not is_borne_out(run)
    assert is_borne_out(prepared_run(drive(0.15), with_delay(NavigationConfig.checked(asked()))))


#: The catalogue's numbers of it, stated by hand.
SHEET = {
    "gyro": {"arw_deg_rthr": 0.125, "in_run_deg_hr": 0.35, "in_run_time_s": 100.0, "bias_deg_hr": 20.0},
    "accel": {"vrw_m_s_rthr": 0.03, "in_run_mg": 0.05, "in_run_time_s": 60.0, "bias_mg": 1.0},
}


@pytest.mark.campaign
def test_beside_stated_noise_an_offset_is_estimated_only_where_it_is_what_contradicts():
    """Law: the noise stays as it is stated."""
    late = navigate(drive(0.3), asked(SHEET))
    assert abs(late.fixes_later_s + 0.3) < 0.03
    assert STATED_NOISE not in late.notes
    assert not any("noise tuned" in note for note in late.notes)
    small = {"gyro": {**SHEET["gyro"], "arw_deg_rthr": 0.0002}, "accel": {**SHEET["accel"], "vrw_m_s_rthr": 0.0001}}
    doubted = navigate(drive(imu="flenniken-consumer"), asked(small))
    assert STATED_NOISE in doubted.notes
    assert "delay" not in doubted.layout


@pytest.mark.parametrize(
    "stated",
    [
        {"gnss": {"delay_sigma_s": 0.0}}, {"gnss": {"delay_sigma_s": 0.1}}, {"gnss": {"coupling": "reset"}},
        {"imu": {"catalogue": IMU, "clock_shift_s": 0.0}},
    ],
)  # fmt: skip
def test_what_is_stated_is_not_tried(stated):
    config = NavigationConfig.checked(asked() | stated)
    assert not may_have_delay(config, prepared_run(drive(), config))
    assert may_have_delay(NavigationConfig.checked(asked()), prepared_run(drive(), config)) == (
        "coupling" not in stated.get("gnss", {})
    )


@pytest.mark.parametrize("offset", [-0.3, 0.3])
def test_the_cause_in_a_verdict_agrees_with_the_estimate_in_sign_and_size(offset):
    left = navigate(drive(offset), asked(filter={"smooth": False, "tune": False}))
    cause = next(cause for cause in left.verdict.causes if cause.startswith("clocks that differ"))
    size, side = re.search(r"were some (\S+) s (late|early)", cause).groups()
    assert side == ("late" if offset > 0.0 else "early")
    assert 0.5 * abs(offset) < float(size) < 2.0 * abs(offset)  # a filter has followed some of it


@pytest.mark.campaign
def test_fixes_are_compared_where_they_belong():
    """Without another reference errors are against the fixes: at their true times, not metres ahead of them."""
    log = replace(drive(0.4), reference=None)
    result = navigate(log, asked())
    assert (
        evaluate_run(log, result, smooth=False).numbers["rms_horizontal_m"] < 0.6
    )  # 1-sigma of fixes 0.42, statistical


def test_the_evidence_of_a_run_does_not_depend_on_the_clock_it_is_told_on():
    """Law: moved later together with its fixes, a log tells the same, to rounding."""
    log, config = drive(), NavigationConfig.checked(asked())
    moved = replace(log, imu=log.imu.shifted(0.25), gnss=replace(log.gnss, t=log.gnss.t + 0.25))
    run = replace(prepared_run(moved, config), fixes_later_s=0.25)
    one, other = evidences([prepared_run(log, config), run])
    assert len(one.innovations.t) == len(other.innovations.t)
    assert abs(one.loss - other.loss) < 1e-4 * abs(one.loss)


@pytest.mark.campaign
def test_no_offset_is_noted_where_velocities_are_late():
    assert note_of(navigate(late_velocities(drive(), 0.13), asked())) is None


def parabola(*places, sigma=0.02):
    """Losses of runs whose fixes are likeliest later by one of these times. [s]"""
    return lambda laters, prepare, noises: np.min([0.5 * ((laters - at) / sigma) ** 2 for at in places], axis=0)


@pytest.mark.parametrize("at", [0.0, -0.1, -0.17, 0.73])
def test_the_likeliest_offset_is_found_from_several_places(monkeypatch, at):
    """Law: the minimum of a parabola and its width, with the 10 ms that the filter leaves; 0.73 s is beyond the first
    set."""
    monkeypatch.setattr(delay, "_losses", parabola(at))
    offset = delay.likeliest_offset(None)
    assert abs(offset.later_s - at) < 1e-9  # rounding
    assert abs(offset.sigma_s - np.hypot(0.02, 0.01)) < 1e-5  # what is left of other optima
    assert offset.is_apart == (at != 0.0)
    near = delay.offset_near(at + 0.05, None)
    assert abs(near.later_s - at) < 1e-9


def test_an_offset_is_as_uncertain_as_others_that_are_as_likely(monkeypatch):
    monkeypatch.setattr(delay, "_losses", parabola(-0.2, 0.2))
    offset = delay.likeliest_offset(None)
    assert offset.sigma_s > 0.2
    assert not offset.is_apart
    monkeypatch.setattr(delay, "_losses", lambda laters, prepare, noises: np.abs(laters - 0.2) - (laters == 0.2))
    assert abs(delay.likeliest_offset(None).later_s - 0.2) < 1e-9


def test_an_offset_that_was_searched_for_is_within_what_the_search_allows():
    result = navigate(
        drive(-0.4).between(0.0, 30.0), asked(gnss={"delay_sigma_s": 0.3}, filter={"smooth": False, "tune": False})
    )
    model = result.layout.models["delay"]
    result = replace(result, layout=StateLayout({**result.layout.models, "delay": replace(model, sigma=0.01)}))
    assert any(finding.key == "budget delay" for finding in _budgets(result))
    result = replace(result, provenance={**result.provenance, "fixes_moved_s": 0.4})
    assert not any(finding.key == "budget delay" for finding in _budgets(result))


def test_a_note_states_the_offset_with_the_other_sign():
    assert delay_note(-0.1524, 0.004).startswith("GNSS stamps are 0.152 +- 0.004 s late")
    assert "imu.clock_shift_s = 0.152 " in delay_note(-0.1524, 0.004)
    assert "0.300 +- 0.010 s early" in delay_note(0.3, 0.01)
    assert "imu.clock_shift_s = -0.300 " in delay_note(0.3, 0.01)
