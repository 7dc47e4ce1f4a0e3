"""Each finding on a drive in closed form: the fault is named, with its option, and nothing else is an alarm."""

from __future__ import annotations

import json
from dataclasses import replace

import diagnosis_drives as drives
import numpy as np
import pytest

from schuler.diagnosis import CODES
from schuler.diagnosis.admission import checked
from schuler.diagnosis.axes import letters, signed_permutations
from schuler.diagnosis.run import diagnose
from schuler.exceptions import InputError
from schuler.recording.recording import Metadata, Recording
from schuler.recording.series import ImuSeries
from schuler.recording.trajectory import Trajectory
from schuler.units import DEG, G0

I3 = np.eye(3)


@pytest.fixture(scope="module")
def good():
    return drives.drive()


def test_a_good_drive_raises_no_alarm_and_its_numbers_are_those_of_the_drive(good):
    diagnosis = diagnose(good)
    assert diagnosis.codes() == (), diagnosis.summary()
    assert diagnosis.ok
    # 1-sigma is 5 ms or so: statistical
    assert abs(diagnosis.estimates["time_offset_s"]) < 0.03
    assert np.abs(diagnosis.estimates["mount_deg"]).max() < 2.0
    assert {what for *_, what in diagnosis.segments} == {"static", "moving"}
    assert any("loosely coupled" in use for use in diagnosis.supports)


UNITS = [
    ("g", {"accel": 1.0 / G0}, "accel_unit", "units='g"),
    ("mg", {"accel": 1e3 / G0}, "accel_unit", "mg"),
    ("counts", {"accel": 417.3}, "accel_unit", "scale='accel="),
    ("seven per cent", {"accel": 1.07}, "accel_scale", "scale='accel=0.9"),
    ("deg/s", {"gyro": 1.0 / DEG}, "gyro_unit", "deg/s"),
    ("gyro counts", {"gyro": 2345.6}, "gyro_unit", "scale='gyro="),
    ("increments", {"accel": 0.01, "gyro": 0.01}, "kind", "increment"),
]


@pytest.mark.thinned(2)
@pytest.mark.parametrize(("name", "factors", "code", "fix"), UNITS, ids=[u[0] for u in UNITS])
def test_wrong_units(good, name, factors, code, fix):
    imu = good.imu
    bad = drives.with_imu(good, accel=imu.accel * factors.get("accel", 1.0), gyro=imu.gyro * factors.get("gyro", 1.0))
    diagnosis = diagnose(bad, quick=True)
    assert diagnosis.codes() == (code,), diagnosis.summary()
    assert fix in diagnosis.options()[0]


def test_rates_taken_for_increments(good):
    diagnosis = diagnose(drives.with_imu(good, kind="increment"), quick=True)
    assert diagnosis.codes() == ("kind",), diagnosis.summary()
    assert diagnosis.options() == ("kind='rate'",)


def test_linear_acceleration(good):
    imu = good.imu
    gravity = np.stack([np.convolve(x, np.ones(1001) / 1001, "same") for x in imu.accel.T], axis=1)
    diagnosis = diagnose(drives.with_imu(good, accel=imu.accel - gravity), quick=True)
    assert "no_gravity" in diagnosis.codes()


PROPER = [P for P in signed_permutations() if np.linalg.det(P) > 0.0 and not np.array_equal(P, I3)]


@pytest.mark.parametrize("samples", [3, 12, 39])
def test_a_handful_of_readings_without_gravity_is_too_few_to_say_so(samples):
    """Twentieths of so few samples are empty or without scatter; warnings are errors here."""
    accel = np.random.default_rng(3).normal(0.0, 5.0, (samples, 3))
    imu = ImuSeries(np.arange(samples) / 100.0, np.zeros((samples, 3)), accel - accel.mean(axis=0))
    assert "no_gravity" not in diagnose(Recording(imu=imu), quick=True).codes()


@pytest.mark.parametrize("P", PROPER, ids=[letters(P) for P in PROPER])
@pytest.mark.thinned(6)
def test_every_rotation_of_the_sensor_is_named_by_its_letters(good, P):
    diagnosis = diagnose(drives.turned(good, P, P), quick=True)
    assert diagnosis.codes() == ("axes",), diagnosis.summary()
    assert diagnosis.options() == (f"axes='{letters(P)}'",)


AXES = [
    ("gravity sign", -I3, I3, {"gravity_sign"}),
    ("gyro sign", I3, -I3, {"gyro_sign"}),
    ("x reversed", np.diag([-1.0, 1, 1]), np.diag([-1.0, 1, 1]), {"handedness"}),
    ("z reversed", np.diag([1.0, 1, -1]), np.diag([1.0, 1, -1]), {"handedness"}),
    ("x and y exchanged", drives.SWAP_XY, drives.SWAP_XY, {"handedness"}),
    ("accelerometer's y reversed", np.diag([1.0, -1, 1]), I3, {"accel_axes", "handedness"}),
    ("accelerometer's x and y exchanged", drives.SWAP_XY, I3, {"accel_axes", "handedness"}),
    ("gyro's x reversed", I3, np.diag([-1.0, 1, 1]), {"gyro_axes"}),
    ("gyro's z reversed", I3, np.diag([1.0, 1, -1]), {"gyro_axes", "gyro_sign"}),
    ("gyro's x and y exchanged", I3, drives.SWAP_XY, {"gyro_axes"}),
    ("gravity sign, turned", -np.diag([1.0, -1, -1]), np.diag([1.0, -1, -1]), {"gravity_sign", "axes"}),
]


@pytest.mark.thinned(4)
@pytest.mark.parametrize(("name", "A", "G", "codes"), AXES, ids=[a[0] for a in AXES])
def test_wrong_axes_and_signs(good, name, A, G, codes):
    diagnosis = diagnose(drives.turned(good, A, G), quick=True)
    assert set(diagnosis.codes()) <= codes, diagnosis.summary()
    assert diagnosis.codes()


def test_the_letters_are_those_of_the_log_not_of_what_the_reader_made_of_it(good):
    """A log in FLU read as FRD after the reader turned it from RFU: the letters undo what the reader did."""
    C = np.array([[0.0, 1, 0], [1, 0, 0], [0, 0, -1]])  # RFU to FRD
    raw = np.diag([1.0, -1, -1])  # FRD to FLU
    bad = drives.turned(good, C @ raw, C @ raw)
    bad = replace(bad, metadata=replace(bad.metadata, axes="RFU"))
    assert diagnose(bad, quick=True).options() == ("axes='FLU'",)


CLOCKS = [
    (0.25, "time_offset"), (-0.4, "time_offset"), (1.0, "time_offset"), (18.0, "leap_seconds"),
    (-18.0, "leap_seconds"), (60.0, "time_offset"), (86400.0, "no_overlap"),
]  # fmt: skip


@pytest.mark.thinned(2)
@pytest.mark.parametrize(("seconds", "code"), CLOCKS)
def test_clocks(good, seconds, code):
    bad = replace(good, imu=good.imu.shifted(seconds))
    diagnosis = diagnose(bad, quick=True)
    assert diagnosis.codes() == (code,), diagnosis.summary()
    offset = diagnosis.estimates.get("time_offset_s", diagnosis.findings[0].evidence.get("offset_s"))
    assert offset == pytest.approx(-seconds, abs=0.03)  # statistical, about 1 sigma of 8 ms


def test_a_clock_of_another_rate(good):
    imu = good.imu
    diagnosis = diagnose(drives.with_imu(good, t=imu.t * 1.01), quick=True)
    assert "clock_drift" in diagnosis.codes()
    assert diagnosis.estimates["clock_drift_ppm"] == pytest.approx(-1e4, rel=0.05)


def test_milliseconds_taken_for_seconds(good):
    diagnosis = diagnose(drives.with_imu(good, t=good.imu.t * 1e3), quick=True)
    assert diagnosis.codes() == ("time_unit",)
    assert diagnosis.options() == ("units='t=ms'",)


def test_a_sensor_mounted_askew(good):
    from schuler import rotation

    C = rotation.dcm_from_rpy(np.array([[0.0, 0.0, 30.0 * DEG]]))[0].T
    diagnosis = diagnose(drives.turned(good, C, C), quick=True)
    assert diagnosis.codes() == ("mount",)
    assert diagnosis.estimates["mount_deg"] == pytest.approx(
        [0.0, 0.0, 30.0], abs=2.0
    )  # roads are level to a degree or so


@pytest.mark.thinned(2)
@pytest.mark.parametrize(("lx", "ly"), [(4.0, 1.0), (2.0, -1.0), (-1.5, 0.0), (0.0, 3.0)])
def test_an_antenna_far_from_the_imu(good, lx, ly):
    """Its lever arm is rough, within three of its sigmas; it is not taken for a clock that is lx / V wrong."""
    g = good.gnss
    _, heading, *_ = drives.motion(g.t)
    h = 1e-3
    rate = (drives.motion(g.t + h)[1] - drives.motion(g.t - h)[1]) / (2 * h)
    forward = np.stack((np.cos(heading), np.sin(heading)), axis=1)
    right = np.stack((-np.sin(heading), np.cos(heading)), axis=1)
    offset = lx * forward + ly * right
    llh = g.llh.copy()
    llh[:, :2] += offset / [6.37e6, 6.39e6 * np.cos(drives.LAT)]
    v_n = g.v_n.copy()
    v_n[:, :2] += rate[:, None] * (lx * right - ly * forward)
    diagnosis = diagnose(drives.with_gnss(good, llh=llh, v_n=v_n), quick=True)
    arm, sigma = (np.array(diagnosis.estimates[k]) for k in ("lever_arm_m", "lever_arm_sigma_m"))
    assert diagnosis.codes() == ()
    assert np.all(np.abs(arm - [lx, ly]) < 3.0 * sigma), (arm, sigma)
    assert np.all(sigma < 0.5)
    assert diagnosis.estimates["antenna_ahead_of_axle_m"] == pytest.approx(lx, abs=0.5)  # statistical


def test_navigation_stops_at_garbage_or_notes_it(good):
    assert "no error was found" in checked(good).metadata.notes[-1]
    bad = drives.with_imu(good, gyro=-good.imu.gyro)
    with pytest.raises(InputError, match=r"gyro_sign.*scale='gyro=-1'.*--unchecked"):
        checked(bad)
    assert "Passed over" in checked(bad, unchecked=True).metadata.notes[-1]
    late = replace(good, imu=good.imu.shifted(2.0))
    with pytest.raises(InputError, match="time_offset"):
        checked(late)
    assert "no error" in checked(late, clock_shift_s=-2.0).metadata.notes[-1]


def test_axes_unit_and_clock_wrong_together(good):
    P = np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]])
    bad = drives.turned(replace(good, imu=good.imu.shifted(0.5)), P, P)
    bad = drives.with_imu(bad, gyro=bad.imu.gyro / DEG, accel=bad.imu.accel / G0)
    diagnosis = diagnose(bad, quick=True)
    assert set(diagnosis.codes()) == {"axes", "gyro_unit", "accel_unit", "time_offset"}


GNSS = [
    ("enu", lambda g: {"v_n": g.v_n[:, [1, 0, 2]] * [1, 1, -1]}, "velocity_axes"),
    ("up", lambda g: {"v_n": g.v_n * [1, 1, -1]}, "vertical_sign"),
    ("km/h", lambda g: {"v_n": g.v_n * 3.6}, "velocity_unit"),
    ("knots", lambda g: {"v_n": g.v_n / 0.514444}, "velocity_unit"),
    ("west", lambda g: {"llh": g.llh * [1, -1, 1]}, "longitude_sign"),
    ("vw", lambda g: {"v_n": g.v_n * [1, -1, 1]}, "longitude_sign"),
    ("south", lambda g: {"llh": g.llh * [-1, 1, 1]}, "latitude_sign"),
    ("exchanged", lambda g: {"llh": g.llh[:, [1, 0, 2]]}, "position_order"),
    ("radians", lambda g: {"llh": g.llh * [DEG, DEG, 1]}, "position_unit"),
    ("radians alone", lambda g: {"llh": g.llh * [DEG, DEG, 1], "v_n": None, "cov_v_n": None}, "position_unit"),
    ("mm", lambda g: {"llh": g.llh * [1, 1, 1e3]}, "height_unit"),
    ("ft", lambda g: {"llh": g.llh / [1, 1, 0.3048]}, "height_unit"),
]


@pytest.mark.thinned(4)
@pytest.mark.parametrize(("name", "change", "code"), GNSS, ids=[g[0] for g in GNSS])
def test_wrong_positions_and_velocities(good, name, change, code):
    diagnosis = diagnose(drives.with_gnss(good, **change(good.gnss)), quick=True)
    assert diagnosis.codes() == (code,), diagnosis.summary()
    assert diagnosis.options()


def test_heights_above_sea_level_beside_a_reference(good):
    g = good.gnss
    reference = Trajectory.from_geodetic(g.t, g.llh)
    assert diagnose(replace(good, reference=reference)).codes() == ()
    low = replace(drives.with_gnss(good, llh=g.llh - [0, 0, 47.0]), reference=reference)
    diagnosis = diagnose(low)
    assert diagnosis.codes() == ("height_level",)
    assert diagnosis.options() == ("height='msl', geoid_separation=47.0",)


def _stuck(i):
    w = i.gyro.copy()
    w[9000:9300, 1] = w[9000, 1]
    return {"gyro": w}


def _spikes(i):
    f = i.accel.copy()
    f[[5000, 9000, 14000], 1] += 90.0
    return {"accel": f}


def _gaps(i):
    k = np.ones(len(i), dtype=bool)
    k[8000:8200] = k[13000:13100] = False
    return {"t": i.t[k], "gyro": i.gyro[k], "accel": i.accel[k]}


def _resampled(i):
    t = np.arange(i.t[0], i.t[-1], 1.0 / 260.0)
    at = [np.stack([np.interp(t, i.t, x) for x in y.T], axis=1) for y in (i.gyro, i.accel)]
    return {"t": t, "gyro": at[0], "accel": at[1]}


def _held(i):
    k = np.arange(len(i)) // 3 * 3
    return {"gyro": i.gyro[k], "accel": i.accel[k]}


def _jitter(i):
    return {"t": i.t + np.random.default_rng(1).uniform(-0.0045, 0.0045, len(i))}


def _noise(i):
    rng = np.random.default_rng(2)
    return {"gyro": i.gyro + rng.normal(0, 0.3, i.gyro.shape), "accel": i.accel + rng.normal(0, 3.0, i.accel.shape)}


SAMPLING = [
    ("stuck", _stuck), ("spikes", _spikes), ("gaps", _gaps), ("resampled", _resampled), ("repeated", _held),
    ("jitter", _jitter), ("imu_noise", _noise),
    ("saturated", lambda i: {"gyro": np.clip(i.gyro, -0.25, 0.25)}),
    ("quantised", lambda i: {"accel": np.round(i.accel / 0.2) * 0.2, "gyro": np.round(i.gyro / 0.02) * 0.02}),
    ("dead_axis", lambda i: {"gyro": i.gyro * [1, 0, 1]}),
]  # fmt: skip


@pytest.mark.thinned(2)
@pytest.mark.parametrize(("code", "change"), SAMPLING, ids=[s[0] for s in SAMPLING])
def test_sampling(good, code, change):
    diagnosis = diagnose(drives.with_imu(good, **change(good.imu)))
    assert diagnosis.codes() == (code,), diagnosis.summary()


def _smooth(g, n=25):
    kernel = np.ones(n) / n

    def mean(x):
        return np.stack([np.convolve(np.pad(c, n // 2, mode="edge"), kernel, "valid") for c in x.T], axis=1)

    return {"llh": mean(g.llh), "v_n": mean(g.v_n)}


def _jumps(g):
    llh = g.llh.copy()
    llh[300:310, 0] += 40.0 / 6.4e6
    return {"llh": llh}


def _noisy(g):
    return {"llh": g.llh + np.random.default_rng(1).normal(0, 1, g.llh.shape) * [1.5 / 6.4e6, 1.5 / 4.2e6, 1.5]}


RECEIVER = [
    ("gnss_smoothed", _smooth), ("gnss_jumps", _jumps), ("gnss_noise", _noisy),
    ("gnss_repeated", lambda g: {"llh": g.llh[np.arange(len(g)) // 5 * 5]}),
    ("gnss_fused", lambda g: {"quality": np.full(len(g), 7)}),
]  # fmt: skip


@pytest.mark.thinned(2)
@pytest.mark.parametrize(("code", "change"), RECEIVER, ids=[r[0] for r in RECEIVER])
def test_receivers(good, code, change):
    diagnosis = diagnose(drives.with_gnss(good, **change(good.gnss)))
    assert diagnosis.codes() == (code,), diagnosis.summary()


def test_an_outage(good):
    g = good.gnss
    diagnosis = diagnose(replace(good, gnss=g.where((g.t < 100.0) | (g.t > 125.0))))
    assert diagnosis.codes() == ("gnss_gaps",)


def _poses(rng, wrong=I3, scale=1.0):
    """Twelve attitudes by hand with turns between, no GNSS."""
    from schuler import rotation

    rate, q, f, w = 100.0, np.array([1.0, 0, 0, 0]), [], []
    for _ in range(12):
        axis = rng.normal(size=3)
        axis *= rng.uniform(0.6, 1.8) / np.linalg.norm(axis)
        n_turn, n_rest = 120, 300
        for turning, n in ((True, n_turn), (False, n_rest)):
            step = axis / n_turn if turning else np.zeros(3)
            for _ in range(n):
                q = rotation.quat_multiply(q, rotation.quat_from_rotvec(step))
                f.append(rotation.rotate(rotation.quat_conjugate(q), np.array([0.0, 0, -9.81])))
                w.append(step * rate)
    f, w = np.array(f), np.array(w)
    f += rng.normal(0, 0.02, f.shape)
    w += rng.normal(0, 0.002, w.shape) + 0.01
    imu = ImuSeries(np.arange(len(f)) / rate, scale * w @ wrong.T, f)
    return Recording(imu=imu, metadata=Metadata("poses"))


POSES = [
    ("good", I3, 1.0, set()),
    ("deg/s", I3, 1.0 / DEG, {"gyro_unit"}),
    ("sign", -I3, 1.0, {"gyro_sign"}),
    ("exchanged", drives.SWAP_XY, 1.0, {"handedness", "gyro_axes"}),
    ("rotated", np.diag([1.0, -1, -1]), 1.0, {"gyro_axes"}),
]


@pytest.mark.thinned(2)
@pytest.mark.parametrize(("name", "wrong", "scale", "codes"), POSES, ids=[p[0] for p in POSES])
def test_turns_of_gravity_between_rests_tell_the_gyro_without_gnss(name, wrong, scale, codes):
    diagnosis = diagnose(_poses(np.random.default_rng(5), wrong, scale))
    assert set(diagnosis.codes()) <= codes, diagnosis.summary()
    assert bool(diagnosis.codes()) == bool(codes)
    assert any("freepose" in use for use in diagnosis.supports)


def test_a_log_upside_down_without_motion():
    rng = np.random.default_rng(1)
    f = np.array([0.0, 0, 9.81]) + rng.normal(0, 0.02, (6000, 3))
    imu = ImuSeries(np.arange(6000) / 100.0, rng.normal(0, 0.001, (6000, 3)), f)
    diagnosis = diagnose(Recording(imu=imu))
    assert diagnosis.codes() == ("axes",)
    assert diagnose(Recording(imu=replace(imu, accel=-f))).codes() == ()


def test_json_and_summary(good):
    diagnosis = diagnose(drives.with_imu(good, accel=good.imu.accel / G0))
    data = json.loads(diagnosis.to_json())
    assert data["findings"][0]["code"] == "accel_unit"
    assert data["findings"][0]["evidence"]["factor"] == pytest.approx(
        G0, rel=0.01
    )  # the accelerometer's noise and bias
    assert not data["ok"]
    assert "units='g" in diagnosis.summary()
    assert {f["code"] for f in data["findings"]} <= set(CODES)
