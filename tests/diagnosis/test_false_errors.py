"""An error must be right: logs in order of every kind raise none, and what is merely likely warns."""

from __future__ import annotations

import importlib
import json
import sys
from dataclasses import replace
from types import SimpleNamespace

import diagnosis_drives as drives
import numpy as np
import pytest
from places import ROOT

from schuler.cli import main
from schuler.diagnosis import clock, diagnose_log
from schuler.diagnosis.admission import checked
from schuler.diagnosis.clock import likelihood_of_wrong_clock, wrong_clock_lead
from schuler.diagnosis.lag import Lag, covered, explained, find_lag, log_likelihood
from schuler.diagnosis.motion import WindowMeans, motion_of, position_velocity
from schuler.diagnosis.positions import check_positions
from schuler.diagnosis.result import SURE, Diagnosis, Finding, as_options
from schuler.diagnosis.run import diagnose
from schuler.diagnosis.sampling import check_times, counted_rate
from schuler.exceptions import InputError
from schuler.recording.recording import Metadata, Recording
from schuler.recording.series import ImuSeries

if str(ROOT) not in sys.path:
    sys.path.append(str(ROOT))
campaign = importlib.import_module("benchmarks.check_campaign")


@pytest.fixture(scope="module")
def good():
    return drives.drive()


def errors(recording):
    return [f"{f.code} {f.confidence:.3f}" for f in diagnose(recording).errors]


# ------------------------------------------------------------------------------------------------------- campaign


def test_drives_of_every_kind_raise_no_error():
    """One drive of each kind, and cuts of a town with positions only, where shifts of 86 s seemed to explain most."""
    table = campaign.campaign(2 * len(campaign.KINDS), 6, 0, half="even")
    assert table.kinds == {"drive": len(campaign.KINDS), "town": 3}
    assert not table.lines, table.text(0.0)


@pytest.mark.parametrize(("sigma", "offset"), [(0.02, 0.25), (0.5, 0.65), (0.05, 0.45)])
def test_poor_positions_do_not_hide_what_velocities_tell_of_the_clock(monkeypatch, sigma, offset):
    """Law: offsets by velocities, 0.25 s, and by positions, 0.65 s, weigh by what they are worth; alike, evenly."""
    by_velocity = Lag(0.25, sigma, np.full(3, 0.9), 1.0, 0.0, 1.0, np.zeros((0, 2)), np.ones(3), 50.0)
    by_position = replace(by_velocity, offset=0.65, sigma={0.02: 0.5, 0.5: 0.02, 0.05: 0.05}[sigma])
    monkeypatch.setattr(clock, "motion_of", lambda *_: SimpleNamespace(enough=True))
    monkeypatch.setattr(clock, "find_lag", lambda *_, **__: by_position)
    state = SimpleNamespace(view=SimpleNamespace(other=(), mirrored=False), gravity=9.8)
    mean, spread, gap = clock._mean_offset(state, None, by_velocity, 0.0)
    assert gap == pytest.approx(0.4)
    assert abs(mean - offset) < 0.01  # least 1-sigma of either: 0.05 s
    assert spread < (0.12 if sigma == 0.05 else 0.03)


@pytest.mark.campaign
def test_one_error_in_a_thousand_drives_at_most():
    """Measured when written: see docs/check.md."""
    table = campaign.campaign(1000, 60, 0)
    assert len(table.lines) <= 1, table.text(0.0)


@pytest.mark.campaign
@pytest.mark.realdata
def test_one_error_in_five_hundred_cuts_at_most(shared_data):
    """Measured when written: see docs/check.md."""
    table = campaign.campaign(0, 0, 500)
    assert len(table.lines) <= 1, table.text(0.0)


@pytest.mark.realdata
@pytest.mark.parametrize(
    ("number", "name"),
    [(3, "euroc_imu/MH_04_difficult"), (28, "pyshoe_more/2017-12-15-18-02-28"), (18, "oan_phone_drive")],
    ids=["quadrotor", "running foot", "phone"],
)
def test_cuts_that_were_taken_for_wrong_raise_no_error(shared_data, number, name):
    assert errors(campaign.cut(number, name)[1]) == []


# ---------------------------------------------------------------------------------------------------------- clock


def test_a_wrong_clock_is_sure_where_both_halves_say_so_and_stops(good):
    late = replace(good, imu=good.imu.shifted(2.0))
    (finding,) = diagnose(late).errors
    assert finding.code == "time_offset"
    assert finding.confidence >= SURE
    assert min(finding.evidence["lead_log_likelihood"]) > 20.0
    with pytest.raises(InputError, match="time_offset"):
        checked(late)


def test_a_clock_wrong_in_one_half_only_warns(good):
    """Half of the log is moved by hand: no clock does that."""
    imu, middle = good.imu, float(np.median(good.imu.t))
    t = np.concatenate((imu.t[imu.t <= middle], imu.t[imu.t > middle] + 2.0))
    judged = diagnose(drives.with_imu(good, t=t), quick=True)
    assert not [f for f in judged.errors if f.code == "time_offset"], judged.summary()


def test_a_second_off_is_a_warning_where_a_body_sways_against_its_course(good):
    """A hand turns before or after the walker does, by as much as a second: only accelerations would show the clock."""
    late = drives.with_imu(good, t=good.imu.t + 1.0)
    assert [f.severity for f in diagnose(late, quick=True).findings if f.code == "time_offset"] == ["error"]
    phase = np.cumsum(np.random.default_rng(1).uniform(0.5, 2.0, len(good.imu.t))) * good.imu.interval
    sway = 4.0 * np.stack([np.sin(phase), np.cos(1.3 * phase), 0.0 * phase], axis=1)
    judged = diagnose(drives.with_imu(late, accel=good.imu.accel + sway), quick=True)
    (offset,) = [f for f in judged.findings if f.code == "time_offset"]
    assert offset.severity == "warning"
    assert judged.estimates["time_offset_sigma_s"] >= 0.4
    assert "1-sigma 0.4" in offset.text


def test_a_shift_with_less_in_common_explains_less(good):
    """Of no shift may the few samples that are left in common be judged by themselves."""
    motion, means = motion_of(good.gnss.t, good.gnss.v_n, 9.81), WindowMeans(good.imu)
    lag = find_lag(means, motion)
    shifts = np.array([0.0, 100.0, 170.0])
    likelihood = log_likelihood(means, motion, shifts, lag.samples)
    counted = [np.mean(means.at(motion.t[motion.moving] - s, motion.half)[1]) for s in shifts]
    assert counted[1] < 0.6
    np.testing.assert_allclose(covered(means, motion, shifts), counted, atol=0.01)  # an epoch at either end
    alone = -0.5 * np.log(1.0 - explained(means, motion, shifts)) @ lag.samples
    np.testing.assert_allclose(likelihood, counted * alone, rtol=0.02)  # the same
    assert likelihood[0] > 20.0 * max(likelihood[1:].max(), 1.0)
    assert abs(lag.offset) < 0.03
    assert max(wrong_clock_lead(means, motion, lag)) < 3.0
    assert likelihood_of_wrong_clock(wrong_clock_lead(means, motion, lag)) < SURE


def test_likeness_of_residuals_leaves_fewer_samples(good):
    """Samples of overlapping windows count once: no more than one for each second in motion."""
    motion, means = motion_of(good.gnss.t, good.gnss.v_n, 9.81), WindowMeans(good.imu)
    seconds = motion.moving.sum() * float(np.median(np.diff(motion.t)))
    assert np.all(find_lag(means, motion).samples <= seconds / (2.0 * motion.half) + 1e-9)


def test_logs_shorter_than_a_comparison_needs_are_of_one_time(good):
    """22 s in common, a second of it lost to windows at either end, is no missing overlap."""
    imu, gnss = good.imu.between(30.0, 50.5), good.gnss.where((good.gnss.t > 30.0) & (good.gnss.t < 50.5))
    assert "no_overlap" not in diagnose(replace(good, imu=imu, gnss=gnss)).codes()


def test_fixes_that_are_held_delay_nothing(good):
    """Held for a second, a fix is half a second late in the mean: only the first of each counts."""
    g = good.gnss
    k = np.arange(len(g)) // 5 * 5
    held = replace(g, llh=g.llh[k], v_n=g.v_n[k])
    judged = diagnose(replace(good, gnss=held))
    assert judged.codes() == ("gnss_repeated",), judged.summary()
    assert abs(judged.estimates["time_offset_s"]) < 0.1  # delays of 0.4 s if all were used
    assert len(position_velocity(held)[0]) == len(np.unique(k)) - 1


# ------------------------------------------------------------------------------------------------------ positions


def _fixes(v_n, seconds=120.0, sigma_r=0.5, sigma_v=0.05, seed=1):
    rng = np.random.default_rng(seed)
    t = np.arange(0.0, seconds, 1.0)
    v = np.array([v_n(x) for x in t])
    r = np.cumsum(v, axis=0) + rng.normal(0.0, sigma_r, v.shape)
    return campaign._fixes_of(t, r, sigma_r, v + rng.normal(0.0, sigma_v, v.shape))


def test_a_straight_road_accuses_no_velocity():
    """Across the road nothing is seen: any matrix does the same."""
    for course in np.linspace(0.1, 6.0, 9):
        along = np.array([np.cos(course), np.sin(course), 0.0])
        assert check_positions(_fixes(lambda t, a=along: (12.0 + np.sin(0.3 * t)) * a))[0] == []


def test_a_receiver_at_rest_accuses_no_velocity():
    for seed in range(8):
        assert check_positions(_fixes(lambda t: np.zeros(3), sigma_r=2.0, sigma_v=0.4, seed=seed))[0] == []


@pytest.mark.parametrize(
    ("change", "code"),
    [
        (lambda v: v * 3.6, "velocity_unit"),
        (lambda v: v[:, [1, 0, 2]] * [1, 1, -1], "velocity_axes"),
        (lambda v: v[::-1], "velocity_wrong"),
        (lambda v: v @ np.array([[0.6, 0.8, 0], [-0.8, 0.6, 0], [0, 0, 1]]), "velocity_wrong"),
    ],
    ids=["km/h", "ENU", "another run", "axes of its own"],
)
def test_velocities_that_are_wrong_are_named(change, code):
    gnss = _fixes(lambda t: 10.0 * np.array([np.cos(0.05 * t), np.sin(0.05 * t), 0.1 * np.sin(0.1 * t)]))
    assert [f.code for f in check_positions(replace(gnss, v_n=change(gnss.v_n)))[0]] == [code]


# ----------------------------------------------------------------------------------------------- units and sensors


def _log(f, w, rate=100.0, name="log"):
    return Recording(imu=ImuSeries(np.arange(len(f)) / rate, w, f), metadata=Metadata(name))


def _running(seconds=60.0, rate=200.0):
    """Specific force and rate of a foot that never rests: it swings about the hip, 20 m/s^2 and more."""
    rng = np.random.default_rng(2)
    phase = 2.0 * np.pi * 1.4 * np.arange(0.0, seconds, 1.0 / rate)
    w = 8.0 * np.sin(phase)
    pitch = -8.0 / (2.0 * np.pi * 1.4) * np.cos(phase)
    f = np.stack((9.8 * np.sin(pitch), 0.0 * phase, -9.8 * np.cos(pitch) - 0.35 * w**2), axis=1)
    f += rng.normal(0.0, 3.0, f.shape)
    return f, np.stack((0.0 * w, w, 0.0 * w), axis=1) + rng.normal(0.0, 0.01, f.shape)


def test_a_running_foot_has_the_unit_it_is_said_to_have():
    f, w = _running()
    assert np.median(np.linalg.norm(f, axis=1)) > 1.5 * 9.8
    assert diagnose(_log(f, w, 200.0)).codes("error") == ()
    assert "accel_unit" not in diagnose(_log(f, w, 200.0)).codes()


@pytest.mark.parametrize("factor", [1 / 9.80665, 1000 / 9.80665, 800.0])
def test_a_running_foot_in_other_units_is_named(factor):
    f, w = _running()
    judged = diagnose(_log(f * factor, w, 200.0))
    assert "accel_unit" in judged.codes(), judged.summary()
    assert not any("scale='accel=0" in fix or "scale='accel=1" in fix for fix in judged.options())


def test_a_log_turned_by_hand_is_not_upside_down():
    """It lies on its back once, and is turned for the rest of the log."""
    rng = np.random.default_rng(3)
    t = np.arange(0.0, 80.0, 0.01)
    angle = np.where(t < 15.0, 0.0, 1.5 * np.sin(0.9 * (t - 15.0)) + 0.8 * np.sin(2.3 * (t - 15.0)))
    rate = np.gradient(angle, 0.01)
    f = 9.81 * np.stack((np.zeros_like(t), np.sin(angle), np.cos(angle)), axis=1) + rng.normal(0, 0.01, (len(t), 3))
    w = np.stack((rate, 0.0 * t, 0.0 * t), axis=1) + rng.normal(0.0, 0.001, (len(t), 3))
    assert "axes" not in diagnose(_log(f, w)).codes()
    still = t < 15.0
    assert diagnose(_log(f[still], w[still])).codes() == ("axes",)


@pytest.mark.parametrize("size", [3.0, 40.0])
def test_a_knock_that_stops_all_axes_is_no_spike(good, size):
    f, w = good.imu.accel.copy(), good.imu.gyro.copy()
    for k in (6000, 9000, 14000):
        f[k] += size * 10.0 * np.array([1.0, -0.7, 0.8])
        w[k] += size * 0.5 * np.array([-1.0, 0.6, 0.9])
    assert "spikes" not in diagnose(drives.with_imu(good, accel=f, gyro=w)).codes()
    f[11000, 1] += 90.0
    judged = diagnose(drives.with_imu(good, accel=f, gyro=w))
    spikes = next(x for x in judged.warnings if x.code == "spikes")
    assert spikes.evidence["samples"] == 1
    assert "delete" not in spikes.fix


@pytest.mark.realdata
@pytest.mark.parametrize("unit", [0, 1])
def test_knocks_of_a_rig_turned_by_hand_are_no_spikes(shared_data, unit):
    judged = diagnose(campaign._loaders()[f"mikoff_mpu9150/{unit}"]())
    assert not {"spikes", "axes"} & set(judged.codes()), judged.summary()
    assert judged.ok


# ----------------------------------------------------------------------------------------------------------- stamps


def _jittered(n=20_000, rate=97.6, seed=0):
    t = np.arange(n) / rate
    return np.sort(t + np.random.default_rng(seed).uniform(-0.45, 0.45, n) / rate)


def test_the_rate_offered_for_stamps_that_jitter_is_the_true_one():
    """Statistical: stamps off by a quarter of an interval give it to 1e-6 over 20 000 samples."""
    t = _jittered()
    (finding,) = check_times(t)
    assert finding.code == "jitter"
    assert finding.evidence["rate_hz"] == pytest.approx(97.6, rel=1e-5)
    assert f"say rate={finding.evidence['rate_hz']:.6g}" in finding.fix


@pytest.mark.parametrize("lost", [3, 50])
def test_no_rate_is_offered_that_would_hide_a_gap(lost):
    t = np.delete(_jittered(), np.arange(9000, 9000 + lost))
    assert counted_rate(t)[0] is None
    finding = next(f for f in check_times(t) if f.code == "jitter")
    assert "rate=" not in finding.fix


def test_a_clock_of_another_rate_is_offered_the_rate_of_its_samples(good):
    """100 Hz whose stamps run one per cent fast and jitter, so that the median step is not the mean."""
    rng = np.random.default_rng(5)
    t = np.sort(good.imu.t + 0.01 * rng.choice([-0.4, 0.0, 0.3], len(good.imu)))
    judged = diagnose(drives.with_imu(good, t=t * 1.01))
    drift = next(f for f in judged.warnings if f.code == "clock_drift")
    assert float(drift.fix.split()[0].partition("=")[2]) == pytest.approx(100.0, rel=1e-3)  # of a drift to 1e-3


# ---------------------------------------------------------------------------------------- likelihood and severity


def test_what_is_merely_likely_warns_and_says_what_it_would_do():
    likely = Finding("gyro_sign", "error", "maybe", 0.9, "scale='gyro=-1'")
    sure = Finding("gyro_unit", "error", "surely", 0.99)
    worse = Finding("jitter", "warning", "a little", 0.9)
    finding = Diagnosis("log", (worse, likely, sure))
    assert [f.code for f in finding.errors] == ["gyro_unit"]
    assert [(f.code, f.consequence) for f in finding.warnings] == [("gyro_sign", "garbage"), ("jitter", "worse")]
    assert "warning gyro_sign [90 % likely; garbage if so]" in finding.summary()
    assert "error gyro_unit [99 % likely]" in finding.summary()
    assert "warning jitter [90 % likely]" in finding.summary()
    data = {f["code"]: f for f in json.loads(finding.to_json())["findings"]}
    assert (data["gyro_sign"]["severity"], data["gyro_sign"]["if_so"], data["gyro_sign"]["confidence"]) == (
        "warning", "garbage", 0.9,
    )  # fmt: skip
    assert Diagnosis("log", (likely,)).require().ok
    with pytest.raises(InputError, match="surely"):
        finding.require()


@pytest.mark.parametrize(
    ("fix", "option"),
    [
        ("axes='BRU'", "--axes BRU"),
        ("offset=-0.139 for the IMU", "--offset=-0.139 for the IMU"),
        ("units='g,...' (or units='accel=g')", "--units g,... (or --units accel=g)"),
        ("height='msl', geoid_separation=47.0", "--height msl, --geoid-separation=47.0"),
        ("kind='increment', units='m/s,rad' (or their units)", "--kind increment, --units m/s,rad (or their units)"),
        ("columns='...,lon,lat,...' exchanged", "--columns ...,lon,lat,... exchanged"),
        ("pass over them with skip=..., please", "pass over them with --skip=..., please"),
        ("a clock of its own (hint time='gps-tow:WEEK')", "a clock of its own (--time gps-tow:WEEK)"),
        ("axes RFU; hint axes says otherwise", "axes RFU; --axes says otherwise"),
        ("a hint replaces it, hint nothing does not", "a hint replaces it, hint nothing does not"),
    ],
)
def test_options_are_spelled_for_the_command_line(fix, option):
    assert as_options(fix) == option


def test_the_command_says_options_and_a_folder_entries(tmp_path, good, capsys):
    i = good.imu
    np.savetxt(tmp_path / "imu.csv", np.column_stack((i.t, i.accel / 9.80665, i.gyro)), delimiter=",", fmt="%.9f")
    options = {"columns": "t,ax,ay,az,gx,gy,gz", "units": "m/s^2,rad/s"}
    assert main(["check", str(tmp_path / "imu.csv"), *(x for k, v in options.items() for x in (f"--{k}", v))]) == 2
    assert "-> --units g,..." in capsys.readouterr().out
    assert "-> units='g,..." in diagnose_log(tmp_path / "imu.csv", **options).summary()
