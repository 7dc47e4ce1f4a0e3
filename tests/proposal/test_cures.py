"""Cures: what a finding proposes becomes hints, on top of those the log was read with."""

from dataclasses import replace

import numpy as np
import pytest
from command import run
from messy_folders import one_part, over_ground, phyphox, simulated, two_sensors_and_gpx

import schuler
from schuler.diagnosis.result import Diagnosis, Finding
from schuler.files import read_toml
from schuler.proposal import configuration, hints, tables
from schuler.proposal.cures import mended, proposed
from schuler.proposal.files import files_of
from schuler.recording.formats import nmea
from schuler.recording.io import columns, read, write


@pytest.mark.parametrize(
    ("code", "fix", "entry", "new"),
    [
        ("axes", "axes='BRU'", {}, {"axes": "BRU"}),
        ("gyro_unit", "units='...,deg/s' (or units='gyro=deg/s')", {"units": "accel=g,t=ms"},
         {"units": "accel=g,t=ms,gyro=deg/s"}),
        ("accel_unit", "units='g,...' (or units='accel=g')", {"units": "m/s^2,rad/s"},
         {"units": "accel=g,gyro=rad/s"}),
        ("gravity_sign", "scale='accel=-1'", {"scale": "accel=2"}, {"scale": "accel=-2"}),
        ("handedness", "scale='ay=-1,gy=-1'", {"scale": "accel=2"}, {"scale": "ax=2,ay=-2,az=2,gy=-1"}),
        ("clock_unknown", "time='gps-tow:2374', offset=242999.957 for the IMU", {},
         {"time": "gps-tow:2374", "offset": 242999.957}),
        ("leap_seconds", "time='unix' (UTC) or 'gps-unix'/'gps' for the right file, or offset=-18", {"time": "unix"},
         {"offset": -18.0}),
        ("height_level", "height='msl', geoid_separation=47.3", {}, {"height": "msl", "geoid_separation": 47.3}),
        ("height_level", "height='msl', geoid_separation=... (or height='ellipsoidal')", {}, None),
        ("handedness", "name the columns right, columns='...' (ax is ay)", {}, None),
    ],
)  # fmt: skip
def test_a_finding_becomes_hints(code, fix, entry, new):
    assert proposed(Finding(code, "error", "", 0.99, fix), entry) == new


def test_what_is_merely_likely_is_not_mended():
    assert mended(Finding("axes", "warning", "", 0.9, "axes='BRU'"), {}) is None


@pytest.mark.parametrize(("step", "unit"), [(0.01, "s"), (10.0, "ms"), (1e4, "us"), (1e7, "ns"), (5.0, "ms")])
def test_the_step_of_stamps_tells_their_unit(step, unit):
    assert tables.time_unit(step * np.arange(1.0, 51.0)) == (unit, None)


@pytest.mark.parametrize(("unit", "second"), [("s", 1.0), ("ms", 1e-3)])
def test_fixes_and_an_imu_on_unix_time_have_one_clock(tmp_path, unit, second):
    t = (1.7e9 + 0.01 * np.arange(400)) / second
    imu = np.column_stack([t, np.tile([0.0, 0.0, -9.8, 0.0, 0.0, 0.0], (400, 1))])
    fixes = np.column_stack([t[::100], np.tile([47.0, 8.0, 400.0, 1.0, 1.0, 2.0], (4, 1))])
    for name, rows, header in (
        ("imu.csv", imu, "timestamp,ax_m_s2,ay_m_s2,az_m_s2,gx_rad_s,gy_rad_s,gz_rad_s"),
        ("gnss.csv", fixes, "timestamp,lat_deg,lon_deg,height_m,sd_n_m,sd_e_m,sd_d_m"),
    ):
        np.savetxt(tmp_path / name, rows, fmt="%.4f", delimiter=",", header=header, comments="")
    files = files_of([tmp_path], {})
    assert {part: entry["time"] for part, entry in files.entries.items()} == {"imu": "unix", "gnss": "unix"}
    recording = read(tmp_path, **files.entries)
    assert recording.metadata.time.scale == "gps"
    assert recording.need_gnss().t[0] == pytest.approx(recording.need_imu().t[0], abs=1e-4)  # printed digits


@pytest.mark.parametrize(
    ("norm", "unit"), [(9.9, "m/s^2"), (1.02, "g"), (980.0, "mg"), (16384.0, "m/s^2"), (1670.0, "m/s^2")]
)
def test_the_norm_of_gravity_tells_the_unit(norm, unit):
    assert tables.accel_unit(norm) == unit


def test_check_writes_cures_into_a_configuration_and_keeps_the_rest(tmp_path, capsys):
    from messy_folders import arduino

    folder = tmp_path / "logs"
    folder.mkdir()
    arduino(folder)
    target = tmp_path / "drive.toml"
    target.write_text('# mine\n[imu]\ncatalogue = "MPU-6000"\n', encoding="utf-8")
    code, _, err = run(capsys, "check", folder, "--write", target)
    assert code == 0, err
    written = read_toml(target)
    assert written["recording"]["imu"]["axes"] == "RUB"
    assert written["imu"] == {"catalogue": "MPU-6000"}
    assert target.read_text(encoding="utf-8").startswith("# mine")


def test_a_folder_without_accuracies_is_recognised_checked_and_proposed(tmp_path, capsys):
    """Tables as people make them: an IMU without units, fixes and wheel speeds without accuracies."""
    _, recording = simulated(duration=60.0)
    imu, g = recording.imu, recording.gnss
    speed, course = over_ground(recording)
    tables = {
        "imu.csv": ("time,ax,ay,az,gx,gy,gz", np.column_stack((imu.t, imu.accel, imu.gyro))),
        "gps.csv": (
            "time,lat,lon,height,speed,course",
            np.column_stack((g.t, np.degrees(g.llh[:, :2]), g.llh[:, 2], speed, course)),
        ),
        "fixes.csv": (
            "time,lat,lon,height,vn,ve,vd",
            np.column_stack((g.t, np.degrees(g.llh[:, :2]), g.llh[:, 2], g.v_n)),
        ),
        "wheels.csv": ("time,speed", np.column_stack((g.t, speed))),
    }
    for name, (head, rows) in tables.items():
        np.savetxt(tmp_path / name, rows, delimiter=",", fmt="%.9f", header=head, comments="")
    code, _, err = run(capsys, "info", tmp_path / "gps.csv", "--columns", "t,lat,lon,h,speed,course")
    assert code == 2
    assert "say --sigma N,E,D [m]" in err  # as the command has it
    code, _, err = run(capsys, "info", tmp_path / "gps.csv")
    assert code == 0, err
    assert "--sigma '5,5,7.5': no column states an accuracy" in err
    assert run(capsys, "check", tmp_path / "gps.csv")[0] == 0
    with_velocities = files_of([tmp_path / "fixes.csv"], {})
    assert with_velocities.entries["sigma"] == "5,5,7.5,0.1,0.1,0.1"
    (tmp_path / "fixes.csv").unlink()
    code, out, err = run(capsys, "check", tmp_path)
    assert code == 0, out
    assert "recording.gnss.sigma = 5,5,7.5: no column states an accuracy" in err
    assert "recording.odometer.sigma_speed = 0.1" in err
    proposal = schuler.propose(tmp_path, imu="MPU-6000", trials=False)
    assert proposal.recording.need_gnss().cov_r_n[0, 0, 0] == 25.0
    assert proposal.recording.odometer.sigma[0] == 0.1


def test_check_recognises_the_files_of_two_sensors(tmp_path, capsys):
    _, recording = simulated(duration=60.0)
    two_sensors_and_gpx(recording, tmp_path)
    code, out, err = run(capsys, "check", tmp_path)
    assert code == 0, out
    assert "recording.accel.file = accel.csv: its header states g" in err
    assert 'axes = "RUB" in [recording.imu]' in out


def test_a_receiver_s_time_held_over_samples_is_not_their_clock(tmp_path):
    """Of clocks that run together that called the IMU's, ``ms_today_imu`` of VESC Tool beside ``gnss_posTime``."""
    path, n = tmp_path / "log.csv", 400
    rng = np.random.default_rng(1)
    a, ms = 9.81 * np.array([0.0, 0.0, 1.0]) + rng.normal(0.0, 0.1, (n, 3)), 1000 + 20 * np.arange(n)
    rows = [f"{m},{m - 3},{x:.4f},{y:.4f},{z:.4f},0,0,0,{m // 1000 * 1000}" for m, (x, y, z) in zip(ms, a, strict=True)]
    fields = ["ms_today", "ms_today_imu", "accX", "accY", "accZ", "gyroX", "gyroY", "gyroZ", "gnss_posTime"]
    path.write_text("\n".join([",".join(fields), *rows]) + "\n", encoding="utf-8")
    names = ["-" if column is None else column[0] for column in columns.recognise_all(fields)]
    assert names.index("t") == 8
    assert tables.clock_column(path, names) == 1
    assert tables.clock_column(path, ["-", "t", *names[2:8], "-"]) is None


def test_a_format_that_states_its_axes_is_not_asked_about_them(tmp_path):
    _, recording = simulated(duration=60.0)
    phyphox(recording, tmp_path)
    files = files_of([tmp_path], {})
    likely = Finding("gyro_axes", "warning", "x shows -x", 0.6, "scale='gx=-1'", grave=True)
    diagnosis = Diagnosis("log", (likely,), {}, (), {}, (), "imu")
    assert configuration._question(files, diagnosis) is None  # either answer would be refused
    (tmp_path / "table").mkdir()
    rows = "".join(f"{0.01 * k:.2f},0,0.{k % 3},-9.8,0,0.00{k % 5},0\n" for k in range(500))
    (tmp_path / "table" / "imu.csv").write_text("t (s),ax (m/s^2),ay,az,gx (rad/s),gy,gz\n" + rows)
    question = configuration._question(files_of([tmp_path / "table"], {}), diagnosis)
    assert "gx=-1" in str(question)


def test_velocities_without_an_accuracy_get_one_and_positions_keep_theirs(tmp_path):
    rows = "".join(f"{k},48.7,9.1,300,1.5,1.5,3,1,0\n" for k in range(20))
    path = tmp_path / "gps.csv"
    path.write_text("t,lat,lon,h,sn,se,sd,vn,ve\n" + rows)
    sigma, (decision,) = hints.accuracy_hints(path, "recording.gnss", "gnss")
    assert "of velocity" in decision.evidence
    fixes = read(path, **sigma).need_gnss()
    np.testing.assert_allclose(np.diag(fixes.cov_r_n[0]), [2.25, 2.25, 9.0], rtol=1e-14)  # rounding
    np.testing.assert_allclose(np.diag(fixes.cov_v_n[0])[:2], nmea.RATE_ERROR**2, rtol=1e-14)
    path.write_text(path.read_text().replace(",vn,ve", ",vn,ve,svn,sve").replace(",1,0\n", ",1,0,0.1,0.1\n"))
    assert hints.accuracy_hints(path, "recording.gnss", "gnss") == ({}, [])


def test_axes_of_which_several_are_possible_are_noted_with_their_entry(tmp_path):
    """An IMU whose z points up, and places alone: FLU or RFU, which no rest and no course decides."""
    _, recording = simulated(duration=60.0)
    write(one_part(recording, "imu"), tmp_path / "imu.csv")
    write(one_part(recording, "gnss"), tmp_path / "watch.gpx")
    files = files_of([tmp_path], {})
    up = Finding("axes", "warning", "z points up", 0.7, "axes='FLU' or 'RFU'", part="imu")
    diagnosis = Diagnosis("log", (up, replace(up, severity="note")), {}, (), {}, (), "imu")
    assert configuration._question(files, diagnosis) is None
    entry = files.names_of("imu", "axes")[0]
    (remark,) = configuration._remarks(files, diagnosis)
    assert remark == f"z points up (70 % likely); it is read as it stands, --set {entry}=... says otherwise"
