"""Tables as loggers leave them: headers with units behind strokes, restarts, wide characters, signals, triples."""

import json
from pathlib import Path

import numpy as np
import pytest

from schuler import read, units
from schuler.exceptions import FileFormatError
from schuler.proposal import hints, tables
from schuler.proposal.files import Files, files_of
from schuler.recording.io import packed

IMU = "t [s],ax [m/s^2],ay [m/s^2],az [m/s^2],gx [rad/s],gy [rad/s],gz [rad/s]"


@pytest.mark.parametrize(
    ("text", "factor", "quantity"),
    [
        ("meters per second squared", 1.0, "specific force"),
        ("Unit_MeterPerSeconSquar", 1.0, "specific force"),
        ("DegreeOfArcPerSecond", units.DEG, "angular rate"),
        ("KiloMeterPerHour", 1.0 / 3.6, "velocity"),
        ("nanosec", 1e-9, "time"),
        ("metres/second^2", 1.0, "specific force"),
        ("mph", 1609.344 / 3600.0, "velocity"),
        ("semicircles", np.pi / 2.0**31, "angle"),
        ("Grad/s", units.DEG, "angular rate"),
    ],
)
def test_units_in_words(text, factor, quantity):
    assert units.factor_for(text, quantity) == pytest.approx(factor, rel=1e-15)  # rounding
    assert units.parse_unit(text).text == text


def test_a_header_with_units_behind_strokes_that_comes_again_in_the_middle(tmp_path):
    names = [
        ("t", "s"),
        ("AccelX", "G"),
        ("AccelY", "G"),
        ("AccelZ", "G"),
        *[(x, "Deg/Sec") for x in ("Yaw", "Pitch", "Roll")],
    ]
    head = ",".join(f'"{name}"|"{unit}"|-3.0|3.0|50' for name, unit in names)
    rows = [f"{k / 50:.2f},0.0,0.0,-1.0,3.0,2.0,1.0" for k in range(60)]
    path = tmp_path / "rc_0.log"
    path.write_text("\n".join([head, *rows[:30], head, *rows[30:], ""]), newline="\r\n")
    recording = read(path)
    assert len(recording.imu) == 60
    np.testing.assert_allclose(recording.imu.gyro[0] / units.DEG, [1.0, 2.0, 3.0], rtol=1e-12)  # rounding
    assert any("comes again 1 times" in note for note in recording.metadata.notes)


def test_rates_called_roll_and_pitch_are_about_the_axes_along_and_across(tmp_path):
    path = tmp_path / "log.csv"
    path.write_text("t [s],ax [g],ay [g],az [g],Yaw [deg/s],Pitch [deg/s],Roll [deg/s]\n0,0,0,1,3,2,1\n1,0,0,1,3,2,1\n")
    assert hints.rates_by_name(path, None, "RFU") == "t,ax,ay,az,gz,gx,gy"
    assert hints.rates_by_name(path, "t,ax,ay,az,gz,gx,gy", "RFU") is None
    assert hints.rates_by_name(path, None, "FLU") is None


def test_a_wide_text_of_excel_in_german_with_stamps_held_for_a_second(tmp_path):
    head = "Datum\tUhrzeit\tBeschl X [g]\tBeschl Y [g]\tBeschl Z [g]\tDrehrate X [Grad/s]\tDrehrate Y [Grad/s]"
    head += "\tDrehrate Z [Grad/s]\tBreite\tLänge\tHöhe [m]\tTempo [km/h]\tKurs [Grad]"
    rows = []
    for k in range(1500):
        j = (k - 10) // 50  # the fix of a second comes ten samples later
        fix = f"48,{700000 + 9 * j}\t9,{100000 + 9 * j}\t300,{j % 9}\t36,0\t45,0" if j >= 0 else "0\t0\t0\t0\t0"
        rows.append(f"17.05.2024\t18:53:{k // 50:02d}\t0,0\t0,0\t-1,0\t0,{k % 7}\t0,0\t2,5\t{fix}")
    path = tmp_path / "Messung1.txt"
    path.write_bytes("\r\n".join([head, *rows, ""]).encode("utf-16"))
    assert packed.tables(path) == ("Messung1.csv",)
    recording = read(path, imu={"file": "Messung1.csv"}, gnss={"file": "Messung1.csv", "sigma": "5,5,7.5"})
    t, fixes = recording.imu.t, recording.gnss
    assert recording.imu.interval == pytest.approx(0.02, rel=1e-3)  # the line through the bursts
    np.testing.assert_allclose(recording.imu.gyro[:, 2] / units.DEG, 2.5, rtol=1e-12)  # rounding
    np.testing.assert_allclose(fixes.t, t[10::50], atol=1e-9)  # rounding: a fix has the time of its row
    assert np.hypot(*fixes.v_n[3, :2]) == pytest.approx(10.0, rel=1e-9)  # rounding


def test_signals_of_json_with_times_of_their_own_are_tables_of_those_side_by_side(tmp_path):
    def signal(unit, t, x):
        return {"unit": unit, "values": [[int(a), float(b)] for a, b in zip(t, x, strict=True)]}

    t = 1_715_964_782_000_000 + 10_000 * np.arange(200)
    slow = t[::20]
    slow = np.concatenate((slow, slow + 2_000_000, slow + 4_000_000))
    document = {
        f"acceleration_{c}": signal("Unit_MeterPerSeconSquar", t + 100 * k, np.full(200, k))
        for k, c in enumerate("xyz")
    }
    document |= {
        f"angular_velocity_omega_{c}": signal("Unit_DegreOfArcPerSecon", t, np.full(200, k))
        for k, c in enumerate("xyz")
    }
    document |= {"latitude_degree": signal("Unit_DegreOfArc", slow, 48.7 + 1e-5 * np.arange(30)),
                 "longitude_degree": signal("Unit_DegreOfArc", slow, 9.1 + 1e-5 * np.arange(30)),
                 "latitude_direction": signal("null", slow, np.zeros(30))}  # fmt: skip
    path = tmp_path / "bus.json"
    path.write_text(json.dumps(document))
    assert packed.tables(path) == ("signals_1.csv", "signals_2.csv")
    hint = {"file": "signals_1.csv", "units": "t=us", "time": "unix", "allow": "norm"}
    recording = read(path, imu=hint, gnss={"file": "signals_2.csv", "units": "t=us", "time": "unix", "sigma": "5,5,7"})
    np.testing.assert_allclose(recording.imu.accel[0], [0.0, 1.0, 2.0], atol=0.0)
    np.testing.assert_allclose(recording.imu.gyro[0] / units.DEG, [0.0, 1.0, 2.0], rtol=1e-12)  # rounding
    assert len(recording.gnss) == 30


def test_lines_of_names_values_and_units_with_samples_joined_by_strokes(tmp_path):
    rows = ["Type,Local Number,Message,Field 1,Value 1,Units 1,Field 2,Value 2,Units 2,"]
    rows.append("Definition,2,accelerometer_data,timestamp,1,,timestamp_ms,1,,sample_time_offset,3,,accel_x,3,,")
    for k in range(20):
        time = f'timestamp,"{37 + k // 5}",s,timestamp_ms,"{200 * (k % 5)}",ms,sample_time_offset,"0|50|100|150",ms'
        for message, stem, unit in (("accelerometer_data", "accel", "g"), ("gyroscope_data", "gyro", "deg/s")):
            axes = [f'{stem}_{c},"1|2|3|4",counts' for c in "xyz"]
            axes += [
                f'calibrated_{stem}_{c},"{v}",{unit}'
                for c, v in zip("xyz", ("0|0|0|0", "0|0|0|0", "-1|-1|-1|-1"), strict=True)
            ]
            rows.append(f"Data,2,{message},{time},{','.join(axes)},")
        place = f'position_lat,"581052407",semicircles,position_long,"{108570000 + k}",semicircles'
        time = f'timestamp,"{37 + k}",s,timestamp_ms,"130",ms'
        rows.append(f'Data,4,gps_metadata,{time},{place},enhanced_altitude,"300.2",m,velocity,"1.0|2.0|0.0",m/s,')
    path = tmp_path / "ride.csv"
    path.write_text("\n".join(rows) + "\n")
    assert set(packed.tables(path)) == {"accelerometer_data.csv", "gyroscope_data.csv", "gps_metadata.csv"}
    parts = {"accel": {"file": "accelerometer_data.csv"}, "gyro": {"file": "gyroscope_data.csv"}}
    recording = read(path, **parts, gnss={"file": "gps_metadata.csv", "sigma": "5,5,7"})
    np.testing.assert_allclose(recording.imu.t, 37.0 + 0.05 * np.arange(80), atol=1e-9)  # rounding
    np.testing.assert_allclose(recording.imu.gyro[:, 2] / units.DEG, -1.0, rtol=1e-12)  # rounding
    assert recording.gnss.llh[0, 0] / units.DEG == pytest.approx(581052407 * 180.0 / 2.0**31, rel=1e-12)  # rounding
    assert recording.gnss.llh[0, 2] == 300.2


def test_an_imu_beside_the_plumb_line_and_motion_without_it_is_told_by_its_numbers(tmp_path):
    rng, n = np.random.default_rng(1), 4000
    angle = np.cumsum(np.where(np.arange(n) // 500 % 2, 0.3, 0.0)) / 100.0
    down = 9.80665 * np.stack((0.1 * np.sin(angle), np.cos(0.1 * np.sin(angle)), np.full(n, 0.0)), axis=1)
    down *= 9.80665 / np.linalg.norm(down, axis=1)[:, None]
    linear = rng.normal(0.0, 0.3, (n, 3))
    gyro = np.stack((rng.normal(0, 0.01, n), np.gradient(angle) * 100.0, rng.normal(0, 0.01, n)), axis=1)
    mag = 30.0 * np.stack((np.sin(angle), np.full(n, 1.2), np.cos(angle)), axis=1) + rng.normal(0, 0.4, (n, 3))
    q = np.stack((np.cos(angle / 2), np.zeros(n), np.sin(angle / 2), np.zeros(n)), axis=1)
    others = [
        down,
        linear,
        978.0 + rng.normal(0, 0.02, (n, 1)),
        300.0 + rng.normal(0, 1, (n, 1)),
        np.full((n, 1), 31.0),
    ]
    x = np.hstack([1e12 + 10.0 * np.arange(n)[:, None], down + linear, gyro, mag, q, *others])
    np.savetxt(tmp_path / "motion.txt", x, fmt=["%d", *["%.7f"] * (x.shape[1] - 1)])
    proposed = tables.imu_columns(tmp_path / "motion.txt")
    assert proposed is not None
    assert proposed[0].startswith("t,ax,ay,az,gx,gy,gz,-")


def test_a_date_is_the_time_where_its_microseconds_stand_beside_it(tmp_path):
    head = "Human Timestamp,Unix Time,Microseconds,Latitude,Longitude,Height\n"
    rows = "".join(f"2024/05/17 16:53:{k:02d}.300000,{1715964782 + k},300000,48.7,9.1{k},300\n" for k in range(9))
    path = tmp_path / "RawGNSS.csv"
    path.write_text(head + rows)
    np.testing.assert_allclose(np.diff(read(path, sigma="1,1,1").need_gnss().t), 1.0, atol=1e-9)  # rounding


def test_of_two_tables_of_an_imu_the_one_that_feels_gravity_is_read(tmp_path):
    for name, down in (("RawSensors.csv", -9.8), ("State.csv", 0.02)):
        rows = [f"{k / 50:.2f},0.0,0.{k % 3},{down},0.0,0.0{k % 5},0.0" for k in range(300)]
        (tmp_path / name).write_text("\n".join(["t [s],ax,ay,az,gx,gy,gz", *rows]) + "\n")
    assert files_of([tmp_path], {}).entries["imu"]["file"] == "RawSensors.csv"


def test_lists_of_objects_in_a_document_are_tables_by_their_names(tmp_path):
    samples = [{"timestamp": 1715964782000 + 20 * k, "x": -0.9, "y": 0.01 * k, "z": 0.02} for k in range(40)]
    places = [{"timestamp": 1715964782000 + 1000 * k, "latitude": 48.7, "longitude": 9.1 + 1e-5 * k} for k in range(20)]
    path = tmp_path / "ride.json"
    path.write_text(json.dumps({"id": "b1", "accelerometer": samples, "gyro": samples, "gps": places}, indent=4))
    assert packed.tables(path) == ("accelerometer.csv", "gps.csv", "gyro.csv")


def test_a_sign_of_an_accelerometer_in_a_file_of_its_own_is_none_of_the_gyroscope():
    halves = Files(Path(), {"accel": {"file": "a.csv"}, "gyro": {"file": "g.csv"}})
    halves.put("imu", {"scale": "accel=-1"})
    assert halves.entries == {"accel": {"file": "a.csv", "scale": "accel=-1"}, "gyro": {"file": "g.csv"}}


def test_fixes_written_twice_are_left_out_and_counted(tmp_path):
    path = tmp_path / "gps.csv"
    rows = [f"{k},48.7,{9.1 + 1e-5 * k:.6f},300.0" for k in range(9)]
    path.write_text("\n".join(["t,lat,lon,h", *(row for row in rows for _ in range(2))]) + "\n")
    recording = read(path, sigma="3,3,5")
    assert len(recording.need_gnss()) == 9
    assert any("9 rows that are the same as the one before" in note for note in recording.metadata.notes)
    path.write_text("\n".join(["t,lat,lon,h", *rows[:5], rows[4].replace("48.7", "48.8"), *rows[5:]]) + "\n")
    with pytest.raises(FileFormatError, match="repeats the time"):
        read(path, sigma="3,3,5")
