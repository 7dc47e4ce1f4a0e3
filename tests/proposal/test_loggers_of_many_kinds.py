"""Folders as loggers leave them: clocks of a zone, tables without names, a folder of the one run, heights of air."""

import functools
import operator

import numpy as np
import pytest

from schuler.diagnosis import diagnose
from schuler.exceptions import FileFormatError
from schuler.proposal import UndecidedError, propose, propose_reading, tables
from schuler.proposal.files import files_of
from schuler.recording.io import columns, dates, read, text_head
from schuler.recording.io.hints import ReadHints
from schuler.recording.io.over_ground import CIRCLE_68
from schuler.units import DEG, parse_unit

N = 1200
T = np.arange(N) / 50.0
RNG = np.random.default_rng(5)
ACCEL = np.round(RNG.normal([0.1, -0.2, 9.8], 0.05, (N, 3)), 4)
GYRO = np.round(np.sin(T / 3.0)[:, None] * [0.02, 0.03, 0.4] + RNG.normal(0.0, 1e-3, (N, 3)), 5)


def written(path, rows):
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text("\n".join(rows) + "\n")
    return path


def joined(*columns):
    return [",".join(map(str, row)) for row in zip(*columns, strict=True)]


def test_a_table_without_names_is_an_imu_beside_attitude_and_fixes_are_told_by_their_path(tmp_path):
    stamps = [1715964782000564530 + round(1e9 * t) for t in T]
    half = 0.5 * np.cumsum(GYRO[:, 2]) / 50.0
    attitude = [np.zeros(N), np.zeros(N), np.round(np.sin(half), 10), np.round(np.cos(half), 10)]
    angles = [np.round(x, 9) for x in (0.01 * np.sin(T), 0.02 * np.cos(T), 2.0 * half)]
    written(tmp_path / "imu.csv", joined(stamps, *attitude, *angles, *GYRO.T, *ACCEL.T, *RNG.normal(0, 0.5, (3, N))))
    k = np.arange(100)
    place = 48.7 + 1e-5 * k + 1e-6 * np.sin(k), 9.1 - 2e-5 * k, np.round(300.0 + np.sin(k), 3)
    written(tmp_path / "gps.csv", joined([1715964782000564530 + 10**9 * i for i in k], *place, *[[1.5] * 100] * 3))
    files = files_of([tmp_path], {})
    assert files.entries["imu"]["columns"] == "t,-,-,-,-,-,-,-,gx,gy,gz,ax,ay,az,-,-,-"
    assert files.entries["gnss"]["columns"] == "t,lat,lon,h,-,-,-"
    recording = read(files.log, **files.entries)
    np.testing.assert_array_equal(recording.need_imu().accel, ACCEL)
    np.testing.assert_allclose(recording.need_gnss().llh[:, 0], place[0] * DEG, atol=1e-15)  # rounding


@pytest.mark.parametrize("varies", [False, True])
def test_a_phones_places_without_names_have_their_accuracies_beside_the_height(tmp_path, varies):
    """Time, latitude, longitude, accuracy, altitude, its accuracy; stamps once a second count, but no rows."""
    stamps = [f"{t:.6f}" for t in T]
    written(tmp_path / "accelerometer.csv", joined(stamps, *ACCEL.T))
    written(tmp_path / "gyro.csv", joined(stamps, *GYRO.T))
    k = np.arange(24)
    radius = np.where(k % 7 == 3, 8.0, 5.0) if varies else np.full(24, 5.0)
    height = np.round(61.0 + np.sin(k), 3)
    place = 60.1 + 1e-5 * k + 1e-6 * np.sin(k), 24.8 - 2e-5 * k
    written(tmp_path / "locations.csv", joined(k + 0.5, *place, radius, height, np.full(24, 4.0)))
    files = files_of([tmp_path], {})
    assert files.entries["gnss"]["columns"] == "t,lat,lon,radius,h,sd"
    gnss = read(files.log, **files.entries).need_gnss()
    np.testing.assert_array_equal(gnss.llh[:, 2], height)
    np.testing.assert_allclose(np.sqrt(gnss.cov_r_n[:, 0, 0]), radius / CIRCLE_68, rtol=1e-12)  # rounding


def test_a_flat_height_before_a_speed_and_a_count_of_satellites_is_no_accuracy(tmp_path):
    k = np.arange(60)
    place = (
        48.7 + 1e-5 * k + 1e-6 * np.sin(k),
        9.1 - 2e-5 * k,
        np.round(300.0 + np.sin(k)),
        np.round(5.0 + np.cos(k), 2),
    )
    path = written(tmp_path / "gps.csv", joined(k + 0.25, *place, np.full(60, 9)))
    assert tables.fix_columns(path)[0] == "t,lat,lon,h,-,-"


def test_letters_behind_names_that_are_not_known_tell_the_axes(tmp_path):
    """Axes from z to x, rates by a name that no table has."""
    head = "GPSTime,tourne_z,tourne_y,tourne_x,accelz,accely,accelx"
    written(tmp_path / "imu.csv", [head, *joined(np.round(1.6e9 + T, 3), *GYRO.T[::-1], *ACCEL.T[::-1])])
    assert files_of([tmp_path / "imu.csv"], {}).entries["columns"] == "t,gz,gy,gx,az,ay,ax"
    head = head.replace("tourne", "angvel")
    written(tmp_path / "imu.csv", [head, *joined(np.round(1.6e9 + T, 3), *GYRO.T[::-1], *ACCEL.T[::-1])])
    imu = read(tmp_path / "imu.csv", **files_of([tmp_path / "imu.csv"], {}).entries).need_imu()
    np.testing.assert_array_equal(imu.gyro, GYRO)


@pytest.mark.parametrize("at_rest", [True, False])
def test_rates_beside_counts_of_specific_force_are_counts_too(tmp_path, at_rest):
    """An Arduino's raw MPU-6050: at rest a handful of counts, which as deg/s would be 131 times too large."""
    rates = np.round((1e-4 if at_rest else 1.0) * GYRO / DEG * 131.0 + RNG.normal(0.0, 3.0, (N, 3))).astype(int)
    counts = np.round((ACCEL if not at_rest else RNG.normal([0.1, -0.2, 9.8], 0.01, (N, 3))) / 9.80665 * 16384.0)
    head = "millis,AcX,AcY,AcZ,GyX,GyY,GyZ"
    written(tmp_path / "imu.csv", [head, *joined(np.round(1e3 * T).astype(int), *counts.astype(int).T, *rates.T)])
    with pytest.raises(UndecidedError, match="unit of angular rate") as question:
        propose_reading(tmp_path / "imu.csv", {}, {})
    assert "counts, 131 in a deg/s" in dict(question.value.choices)


def test_stamps_without_names_count_as_those_of_the_accelerometers_file(tmp_path):
    stamps = [10_000_000_000_000 + round(1e9 * t) for t in T]
    written(tmp_path / "acce.txt", joined(stamps, *ACCEL.T))
    written(tmp_path / "gyro.txt", joined(stamps, *GYRO.T))
    k = np.arange(24)
    place = 48.7 + 1e-5 * k + 1e-6 * np.sin(k), 9.1 - 2e-5 * k, np.round(300.0 + np.sin(k), 3)
    written(tmp_path / "gps.txt", joined([10_000_500_000_000 + 10**9 * i for i in k], *place, *[[1.5] * 24] * 2))
    files = files_of([tmp_path], {})
    assert files.entries["gnss"]["units"] == "t=ns"
    assert read(files.log, **files.entries).need_gnss().t[0] == pytest.approx(10_000.5, abs=1e-9)  # rounding


def test_a_folder_whose_fixes_are_not_recognised_says_which_files_were_not(tmp_path):
    written(
        tmp_path / "imu.csv", ["t_s,ax_m_s2,ay_m_s2,az_m_s2,gx_rad_s,gy_rad_s,gz_rad_s", *joined(T, *ACCEL.T, *GYRO.T)]
    )
    written(tmp_path / "places.csv", joined(range(24), *RNG.normal(0.0, 1.0, (3, 24))))
    with pytest.raises(UndecidedError, match=r"places\.csv was not: .*recording\.gnss\.columns"):
        propose(tmp_path)


def test_a_time_zone_between_two_clocks_is_taken_out_as_whole_hours(tmp_path):
    from diagnosis_drives import drive

    log = drive(duration=120.0, rate=50.0, seed=3, noise=(0.02, 0.002))
    shifted = log.need_imu()
    late = type(log)(
        imu=type(shifted)(shifted.t + 7200.0, shifted.gyro, shifted.accel), gnss=log.gnss, metadata=log.metadata
    )
    finding = next(f for f in diagnose(late, quick=True).findings if f.code == "no_overlap")
    assert finding.fix.startswith("offset=-7200.000 ")


def test_a_folder_that_holds_only_the_folder_of_a_run_is_that_run(tmp_path):
    body = "GPGGA,1000{:02d}.00,4842.00{:02d},N,00906.0000,E,1,10,0.9,300.0,M,47.0,M,,"
    day = "GPZDA,1000{:02d}.00,01,05,2024,00,00"
    sentences = [text.format(k, k) for k in range(20) for text in (body, day)]
    sentences = [f"{k},${s}*{functools.reduce(operator.xor, s.encode()):02X}" for k, s in enumerate(sentences)]
    written(tmp_path / "run" / "Serial.csv", ["Timestamp (us),CSV", *sentences])
    head = "Timestamp (us)," + ",".join(
        f"{name} {axis} ({unit})" for name, unit in (("Gyroscope", "deg/s"), ("Accelerometer", "g")) for axis in "XYZ"
    )
    written(tmp_path / "run" / "Inertial.csv", [head, *joined((20_000 * np.arange(N)), *GYRO.T, *ACCEL.T)])
    files = files_of([tmp_path], {})
    assert files.entries["imu"]["file"] == "run/Inertial.csv"
    assert files.entries["gnss"]["file"] == "run/Serial.csv"
    assert len(read(tmp_path / "run" / "Serial.csv").need_gnss()) == 20


def test_the_height_of_the_air_between_two_fixes_makes_none(tmp_path):
    place = [f"{9.1 + 1e-5 * (k // 50):.7f},{48.7 + 1e-5 * (k // 50):.7f},{300 + k // 50}.0" for k in range(N)]
    air = np.round(297.0 + 0.3 * np.sin(T), 2)
    head = "Time(s),ax(g),ay(g),az(g),wx(deg/s),wy(deg/s),wz(deg/s),Altitude(m),Lon(deg),Lat(deg),GPSHeight(m)"
    path = written(tmp_path / "log.txt", [head, *joined(T, *ACCEL.T, *GYRO.T, air, place)])
    gnss = read(path, sigma="3,3,5").need_gnss()
    np.testing.assert_allclose(gnss.t, np.arange(24.0))
    np.testing.assert_array_equal(gnss.llh[:, 2], 300.0 + np.arange(24))
    head = head.replace("GPSHeight(m)", "Undulation")  # then the height is the barometer's, but not the times
    written(path, [head, *joined(T, *ACCEL.T, *GYRO.T, air, place)])
    assert len(read(path, sigma="3,3,5").need_gnss()) == 24


def test_the_receiver_is_meant_beside_a_filter_s_positions(tmp_path):
    rows = [f"{k},{48.7 + 1e-5 * k:.7f},{9.1:.7f},300.0" for k in range(60)]
    for name in ("gps_raw", "global_position"):
        written(tmp_path / f"{name}.csv", ["time (s),lat (deg),lon (deg),alt (m)", *rows])
    head = "time (s),ax (g),ay (g),az (g),gx (deg/s),gy (deg/s),gz (deg/s)"
    written(tmp_path / "imu.csv", [head, *joined(T, *ACCEL.T, *GYRO.T)])
    assert files_of([tmp_path], {}).entries["gnss"]["file"] == "gps_raw.csv"


LABVIEW = """LabVIEW Measurement\t
Separator\tTab
Date\t2024/05/17
***End_of_Header***\t
\t
Channels\t6\t\t\t\t\t\t
Samples\t1\t1\t1\t1\t1\t1\t
Y_Unit_Label\tg\tg\tg\tdeg/s\tdeg/s\tdeg/s\t
Delta_X\t0.02\t0.02\t0.02\t0.02\t0.02\t0.02\t
***End_of_Header***\t\t\t\t\t\t\t
X_Value\tAccel_X\tAccel_Y\tAccel_Z\tRate_X\tRate_Y\tRate_Z\tComment
"""


def test_units_of_a_labview_measurement(tmp_path):
    rows = ["\t".join(row.split(",")) for row in joined(T, *ACCEL.T, *GYRO.T)]
    path = tmp_path / "test.lvm"
    path.write_text(LABVIEW + "\n".join(rows) + "\n")
    imu = read(path).need_imu()
    np.testing.assert_allclose(imu.gyro, GYRO * DEG, rtol=1e-14)
    np.testing.assert_allclose(imu.t, T)


def opened(tmp_path, text):
    path = tmp_path / "log.txt"
    path.write_text(text)
    opening = text_head.open_text(path, ReadHints())
    return text_head.columns_of(opening)


@pytest.mark.parametrize(
    ("head", "units"),
    [
        ("timestamp\tstatus\taccelX\taccelY\taccelZ", "(us)\t(na)\t(m.s^-2)\t(m.s^-2)\t(m.s^-2)"),
        ("T_Timestamp\tstatus\tAccel_LN_X\tAccel_LN_Y\tAccel_LN_Z\t", "us\tlocal\tm/(s^2)\tm/(s^2)\tm/(s^2)\t"),
    ],
)
def test_units_in_a_line_of_their_own(head, units, tmp_path):
    tail = "\t" if head.endswith("\t") else ""
    read_as = opened(
        tmp_path, f"{head}\n{units}\n" + "".join(f"{20000 * k}\t1\t0.1\t0.2\t9.8{tail}\n" for k in range(9))
    )
    assert [column and column[0] for column in read_as[:5]] == ["t", None, "ax", "ay", "az"]
    assert parse_unit(read_as[2][1]).dimension == parse_unit("m/s^2").dimension
    assert read_as[0][1] == "us"


@pytest.mark.parametrize(
    ("head", "row", "clock"),
    [
        ("epoc (ms),timestamp (+0200),elapsed (s),ax (g),ay (g),az (g)", "1715964782000,2024,0.0,0,0,1", 0),
        ("time,timestamp_ms,lat,lon,elevation", "2024-05-17T16:53:02.300Z,1715964782300,48.7,9.1,300.0", 0),
        (
            "field.seq,%time,field.header.stamp,ax (g),ay (g),az (g)",
            "1,1715964782005579934,1715964782000000000,0,0,1",
            2,
        ),
        ("T [ms],AccX [mg],AccY [mg],AccZ [mg],P [mB],T ['C],H [%]", "5120,4,26,967,977.98,30.0,39", 0),
    ],
)
def test_the_clock_is_the_first_of_several_columns_where_it_is_sure_to_be_one(head, row, clock, tmp_path):
    read_as = opened(tmp_path, f"{head}\n{row}\n{row}\n")
    assert [k for k, column in enumerate(read_as) if column and column[0] == "t"] == [clock]
    assert not any(column and column[0] == "h" for column in read_as if column != ("h", None))


MOTEC = """"Format","MoTeC CSV File",,,"Workbook","Untitled"
"Comment","",,,"Session","2"
"Sample Rate","50.000","Hz",,"End Time","199.980","s"

"Time","Ground Speed","G Force Lat","G Force Long","G Force Vert","Gyro Yaw Velocity","Gyro Roll Velocity",\
"Gyro Pitch Velocity","GPS Latitude","GPS Longitude","GPS Altitude","GPS Speed"
"s","km/h","G","G","G","deg/s","deg/s","deg/s","deg","deg","m","km/h"

"0.000","0.3","0.026","0.004","0.967","-0.30","-0.14","-0.24","48.7","9.1","300.0","0.1"
"0.020","0.3","0.026","0.004","0.967","-0.30","-0.14","-0.24","48.7","9.1","300.0","0.1"
"""


def test_axes_of_a_vehicle_below_settings_with_units_and_the_speed_of_the_receiver(tmp_path):
    names = [column and column[0] for column in opened(tmp_path, MOTEC)]
    assert names == ["t", None, "ay", "ax", "az", "gz", "gx", "gy", "lat", "lon", "h", "speed"]


def test_rates_with_their_biases_are_a_gyroscope_s_where_there_are_no_others():
    head = [f"/gyroscope/gyro{word}/v/{k}" for word in ("Uncalibrated", "") for k in range(3)]
    assert [c and c[0] for c in columns.recognise_all(head[:3])] == ["gx", "gy", "gz"]
    assert [c and c[0] for c in columns.recognise_all(head)] == [None, None, None, "gx", "gy", "gz"]


def test_months_in_letters():
    ns, zoned, bad = dates.unix_ns(["17-May-2024 18:53:02.001", "1-jan-2024 00:00:00", "17-Foo-2024 18:53:02"])
    assert ns[0] == 1715971982001000000
    assert not zoned
    assert bad == 2


def test_a_temperature_that_is_read_once_a_second_lies_between_its_readings(tmp_path):
    warm = [f"{20 + k / 50:.1f}" if k % 50 == 0 else "" for k in range(N)]
    head = "time (s),ax (g),ay (g),az (g),gx (deg/s),gy (deg/s),gz (deg/s),temperature (degC)"
    imu = read(written(tmp_path / "log.csv", [head, *joined(T, *ACCEL.T, *GYRO.T, warm)])).need_imu()
    np.testing.assert_allclose(imu.temperature[:1151], 20.0 + T[:1151], atol=1e-9)


def test_a_temperature_of_words_is_refused_and_one_of_nothing_is_none(tmp_path):
    head = "time (s),ax (g),ay (g),az (g),gx (deg/s),gy (deg/s),gz (deg/s),temperature (degC)"

    def table(*warm):
        rows = joined(T, *ACCEL.T, *GYRO.T, [warm[k % len(warm)] for k in range(N)])
        return written(tmp_path / "log.csv", [head, *rows])

    with pytest.raises(FileFormatError, match="column 8: expected a number"):
        read(table("20.0", "hot", ""))
    recording = read(table(""))
    assert recording.need_imu().temperature is None
    assert any("temperature has no readings" in note for note in recording.metadata.notes)


def test_a_fix_may_be_without_course_and_says_so_but_not_with_a_word(tmp_path):
    def table(course):
        rows = [f"{k},{48.7 + 2e-5 * k:.6f},9.1,300.0,2.2,{course(k)}" for k in range(40)]
        return written(tmp_path / "gps.csv", ["time (s),lat (deg),lon (deg),alt (m),speed (m/s),course (deg)", *rows])

    recording = read(table(lambda k: "" if k < 5 else "0.0"), sigma="3,3,5")
    assert any("5 rows have no course" in note for note in recording.metadata.notes)
    north = recording.need_gnss().v_n[:, 0]
    np.testing.assert_array_equal(north[:5], 0.0)  # anywhere, with a 1-sigma of the speed
    np.testing.assert_allclose(north[5:], 2.2)
    with pytest.raises(FileFormatError, match="column 6: expected a number or nothing, got 'N'"):
        read(table(lambda k: "N" if k == 30 else "0.0"), sigma="3,3,5")
