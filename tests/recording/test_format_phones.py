"""Logs of phones: GnssLogger and Sensor Logger."""

import re
import zipfile
from pathlib import Path

import numpy as np
import pytest
from format_drives import drive

from schuler import units
from schuler.exceptions import FileFormatError, InputError
from schuler.recording.io import read

HEAD = """# Header Description:
#
# Version: v3.0.6.4 Platform: 14 Manufacturer: Google Model: Pixel 7
#
# Raw,utcTimeMillis,TimeNanos,LeapSecond
#
# UncalAccel,utcTimeMillis,elapsedRealtimeNanos,UncalAccelXMps2,UncalAccelYMps2,UncalAccelZMps2,BiasXMps2
#
# UncalGyro,utcTimeMillis,elapsedRealtimeNanos,UncalGyroXRadPerSec,UncalGyroYRadPerSec,UncalGyroZRadPerSec,DriftX
#
# Fix,Provider,LatitudeDegrees,LongitudeDegrees,AltitudeMeters,SpeedMps,AccuracyMeters,BearingDegrees,UnixTimeMillis,\
SpeedAccuracyMps,BearingAccuracyDegrees,elapsedRealtimeNanos,VerticalAccuracyMeters
#
"""
UNIX, BOOT = 1_707_350_382_000, 500_000_000_000  # ms, ns


def gnss_logger(path, offset_ns=0, n=400):
    """A phone flat on the seat, top forward, at 50 Hz; a fix a second, every third by the network."""
    run = drive()
    rows = []
    for k in range(n):
        a, w = run.imu.accel[k], run.imu.gyro[k]
        ns = BOOT + 20_000_000 * k
        rows.append(
            f"UncalAccel,{UNIX + 20 * k},{ns + offset_ns},{a[1]!r},{a[0]!r},{-a[2]!r},0.0".replace(
                "np.float64(", ""
            ).replace(")", "")
        )
        rows.append(
            f"UncalGyro,{UNIX + 20 * k},{ns},{w[1]!r},{w[0]!r},{-w[2]!r},0.0".replace("np.float64(", "").replace(
                ")", ""
            )
        )
        if k % 50 == 0:
            lat, lon, h = run.reference.llh[k]
            provider = "NLP" if k % 150 == 100 else "GPS"
            place = f"{lat / units.DEG:.10f},{lon / units.DEG:.10f},{h:.4f}"
            v = run.reference.v_eb_n[k]
            speed, bearing = np.hypot(v[0], v[1]), np.rad2deg(np.arctan2(v[1], v[0])) % 360.0
            rows.append(f"Fix,{provider},{place},{speed:.9f},3.0,{bearing:.9f},{UNIX + 20 * k},0.2,2.0,{ns},5.0")
    rows.append("Raw,1,2,18")
    path.write_text(HEAD + "\n".join(rows) + "\n")
    return run


def test_gnss_logger(tmp_path):
    """Axes of a phone on its back, time of the boot clock brought to GPS time, the network's fixes left out."""
    run = gnss_logger(tmp_path / "log.txt")
    back = read(tmp_path / "log.txt")
    np.testing.assert_allclose(back.imu.accel, run.imu.accel[:400], atol=1e-14)
    np.testing.assert_allclose(back.imu.gyro, run.imu.gyro[:400], atol=1e-14)
    gps = back.metadata.time.epoch_gps_s + back.imu.t[0]
    assert gps == pytest.approx(UNIX / 1000 - 315_964_800 + 18, abs=1e-6)
    assert len(back.gnss) == 6
    np.testing.assert_allclose(np.sqrt(np.diag(back.gnss.cov_r_n[0])), (3 / 1.5096, 3 / 1.5096, 5.0), rtol=1e-4)
    np.testing.assert_allclose(back.gnss.llh[0], run.reference.llh[0], atol=1e-4)
    k = [0, 50, 150, 200, 300, 350]
    np.testing.assert_allclose(back.gnss.v_n[:, :2], run.reference.v_eb_n[k, :2], atol=1e-7)
    sigma = np.sqrt(np.einsum("nii->ni", back.gnss.cov_v_n))
    speed = np.hypot(*run.reference.v_eb_n[k, :2].T)  # 0.2 m/s along, 2 deg across, no vertical velocity
    np.testing.assert_allclose(np.sum(sigma[:, :2] ** 2, axis=1), 0.04 + np.maximum(0.2, speed * np.radians(2)) ** 2)
    np.testing.assert_allclose(sigma[:, 2], 10.0)
    assert any("Raw" in note for note in back.metadata.notes)
    assert len(read(tmp_path / "log.txt", streams="gnss=NLP,imu=none").gnss) == 2
    assert read(tmp_path / "log.txt", time="local").metadata.time.scale == "local"


def test_gnss_logger_two_clocks(tmp_path):
    """Specific forces between two samples are interpolated to the time of the rates."""
    run = gnss_logger(tmp_path / "log.txt", offset_ns=10_000_000)
    back = read(tmp_path / "log.txt")
    middle = 0.5 * (run.imu.accel[:399] + run.imu.accel[1:400])
    np.testing.assert_allclose(back.imu.accel, middle[: len(back.imu)], atol=1e-9)


def test_gnss_logger_refused(tmp_path):
    file = tmp_path / "log.txt"
    gnss_logger(file)
    good = file.read_text()
    file.write_text(re.sub(r"(?m)^(UncalGyro,\d+,)", r"\1x", good, count=5))
    with pytest.raises(FileFormatError, match="record 1 of UncalGyro"):
        read(file)
    file.write_text(HEAD + "Raw,1,2,18\n")
    with pytest.raises(FileFormatError, match="neither"):
        read(file)
    file.write_text(good.replace(",3.0,", ",,"))
    with pytest.raises(InputError, match="sigma"):
        read(file)


@pytest.mark.parametrize("tail", ["UncalAccel,17", "UncalGyro,1707350382000,900000000000,0.1", "Fix,GPS,4"])
def test_a_log_of_an_app_that_was_stopped(tmp_path, tail):
    """A last record that is cut off, and one damaged within, are left out and noted; the rest is as before."""
    file = tmp_path / "log.txt"
    gnss_logger(file)
    good, whole = file.read_text(), read(file)
    damaged = good.replace("UncalGyro,1707350382000,500000000000,", "UncalGyro,1707350382000,x,", 1)
    for text, kinds in ((good + tail + "\n", {tail.split(",")[0]}), (damaged, {"UncalGyro"})):
        file.write_text(text)
        back = read(file)
        assert len(back.imu) >= len(whole.imu) - 1
        assert np.isfinite(back.imu.accel).all()
        assert len(back.gnss) == len(whole.gnss)
        for kind in kinds:
            assert any(f"records {kind} are damaged and were left out" in note for note in back.metadata.notes)


@pytest.mark.realdata
def test_a_real_log(shared_data):
    """94 fixes of GPS in California, one every 6 s, with the accuracies the phone states."""
    back = read(shared_data / "gnss_nav_files" / "android_pixel6.txt", streams="imu=none")
    assert len(back.gnss) == 94
    np.testing.assert_allclose(np.degrees(back.gnss.llh[0, :2]), (37.4265, -122.1737), atol=1e-4)
    assert np.median(np.diff(back.gnss.t)) == pytest.approx(6.0, abs=0.01)


def sensor_logger(folder, total=True):
    run = drive()
    t = UNIX * 1_000_000 + 20_000_000 * np.arange(400, dtype=np.int64)

    def save(name, rows, head="time,seconds_elapsed,z,y,x"):
        lines = [head] + [
            f"{ns},{k / 50},{','.join(repr(float(x)) for x in row)}"
            for k, (ns, row) in enumerate(zip(t[: len(rows)], rows, strict=False))
        ]
        (folder / f"{name}.csv").write_text("\n".join(lines) + "\n")

    phone = np.array([[0, 0, -1], [1, 0, 0], [0, 1, 0]])  # z, y, x of the phone by forward, right, down
    f, w = run.imu.accel[:400] @ phone.T, run.imu.gyro[:400] @ phone.T
    gravity = np.tile((9.81, 0.0, 0.0), (400, 1))
    save("Gyroscope", w)
    save("Accelerometer", f - gravity)
    save("Gravity", gravity)
    if total:
        save("TotalAcceleration", f)
    place = np.column_stack((np.full(400, 5.0), np.full(400, 3.0), run.reference.llh[:400] / (units.DEG, units.DEG, 1)))
    save("Location", place[:, [0, 1, 4, 3, 2]],
         "time,seconds_elapsed,verticalAccuracy,horizontalAccuracy,altitude,longitude,latitude")  # fmt: skip
    return run


def oan(folder, n=400, accuracies=None, hz=50, move=1.0):
    """A phone on its back as open-aided-navigation logs it: gyro 5 ms behind the accelerometer, a fix a second."""
    run = drive()
    boot = np.int64(BOOT) + np.int64(1e9 / hz) * np.arange(n)

    def save(name, ns, rows, units):
        head = f"Sensor: S\nVendor: V\nTimestamp{name} [ns]; {name}X [{units}]; {name}Y [{units}]; {name}Z [{units}]\n"
        lines = [f"{t};{';'.join(repr(float(x)) for x in row)};" for t, row in zip(ns, rows, strict=True)]
        (folder / f"20240207_{name}.csv").write_text(head + "\n".join(lines) + "\n")

    phone = np.array([[0, 1, 0], [1, 0, 0], [0, 0, -1]])  # x right, y forward, z up by forward, right, down
    save("Acc", boot, run.imu.accel[:n] @ phone.T, "m/s^2")
    save("Gyro", boot + 5_000_000, run.imu.gyro[:n] @ phone.T, "rad/s")
    k = np.arange(0, n, hz)
    v = run.reference.v_eb_n[k] if accuracies is None else accuracies[0][: len(k)]
    llh = run.reference.llh[k] * (1 / units.DEG, 1 / units.DEG, 1.0)
    rest = np.tile((100.0, 20.0, 10.0), (len(k), 1)) if accuracies is None else accuracies[1][: len(k)]
    course = np.rad2deg(np.arctan2(v[:, 1], v[:, 0])) % 360.0
    radius = 3.0 + 0.5 * (np.arange(len(k)) % 2)
    rows = np.column_stack((llh, np.hypot(v[:, 0], v[:, 1]), course, radius, rest))
    late = 30_000_000 + 1_000_000 * (np.arange(len(k)) % 3)  # a message takes 30 to 32 ms
    lines = [
        f"{boot[i] + d};{UNIX + 1000 * j};{';'.join(repr(float(x)) for x in row)};"
        for j, (i, d, row) in enumerate(zip(k, late, rows, strict=True))
    ]
    head = (
        "TimestampGNSS [ns]; UTC time [ms]; Lat [deg]; Lon [deg]; Height [m]; Speed [m/s]; Heading [deg]; Hor Acc [m];"
    )
    (folder / "20240207_GNSS.csv").write_text(head + "\n" + "\n".join(lines) + "\n")
    return run


def test_oan(tmp_path):
    """Rates as they are, specific forces at their times; the IMU's clock is brought to that of the fixes."""
    run = oan(tmp_path, n=800)
    back = read(tmp_path)
    np.testing.assert_allclose(back.imu.gyro, run.imu.gyro[: len(back.imu)], atol=1e-14)
    between = 0.75 * run.imu.accel[:799] + 0.25 * run.imu.accel[1:800]  # 5 of 20 ms
    np.testing.assert_allclose(back.imu.accel, between[: len(back.imu)], atol=1e-9)
    assert any("interpolated to the gyro's" in note for note in back.metadata.notes)
    gps = back.metadata.time.epoch_gps_s + back.gnss.t
    np.testing.assert_allclose(gps, UNIX / 1000 + np.arange(16) - 315_964_800 + 18, atol=1e-6)
    assert back.imu.t[0] - back.gnss.t[0] == pytest.approx(0.005 - 0.030, abs=1e-6)  # the fastest took 30 ms
    np.testing.assert_allclose(back.gnss.llh, run.reference.llh[:800:50], rtol=1e-12)
    np.testing.assert_allclose(np.sqrt(back.gnss.cov_r_n[0, 0, 0]), 3.0 / 1.5096, rtol=1e-4)


def test_oan_accuracies_that_never_change_are_no_accuracies(tmp_path):
    """100 m, 20 m/s and 10 deg in every row: vertical twice horizontal, velocity by its scatter against positions."""
    oan(tmp_path, n=800)
    back = read(tmp_path)
    np.testing.assert_allclose(np.sqrt(back.gnss.cov_r_n[:2, 2, 2]), (6.0, 7.0))
    sigma = np.sqrt(np.einsum("nii->ni", back.gnss.cov_v_n))
    assert np.all(sigma[:, :2] < 1.0)
    np.testing.assert_allclose(sigma[:, 2], 10.0)  # there is no vertical velocity
    assert any("100 m in every fix" in note for note in back.metadata.notes)
    assert any("No accuracy of speed was measured" in note for note in back.metadata.notes)


def test_oan_accuracies_that_change_are_used(tmp_path):
    """Speed to 0.5 m/s along the course, the course's accuracy across it: to the north, east sigma is v times it."""
    v = np.tile((20.0, 0.0), (16, 1))
    accuracy = np.column_stack((4.0 + np.arange(16) % 2, 0.5 + 0.1 * (np.arange(16) % 2), 3.0 + np.arange(16) % 2))
    oan(tmp_path, n=800, accuracies=(v, accuracy))
    back = read(tmp_path)
    np.testing.assert_allclose(back.gnss.v_n, np.column_stack((v, np.zeros(16))), atol=1e-12)
    sigma = np.sqrt(np.einsum("nii->ni", back.gnss.cov_v_n))
    np.testing.assert_allclose(sigma[0], (0.5, 20.0 * np.radians(3.0), 10.0), rtol=1e-9)
    np.testing.assert_allclose(np.sqrt(back.gnss.cov_r_n[0, 2, 2]), 4.0)


def test_oan_parts(tmp_path):
    """A folder without one sensor has fixes only; a sensor alone is refused; fixes alone are read."""
    oan(tmp_path)
    assert read(tmp_path, streams="imu=none").imu is None
    assert read(tmp_path, streams="gnss=none").gnss is None
    assert read(tmp_path / "20240207_GNSS.csv").imu is None
    with pytest.raises(FileFormatError, match="a sensor is read with its folder"):
        read(tmp_path / "20240207_Acc.csv")
    (tmp_path / "20240207_Acc.csv").unlink()
    assert read(tmp_path).imu is None


@pytest.mark.realdata
def test_a_real_drive_of_oan(shared_data):
    """Three files as they are: 49 913 samples, 998 fixes a second apart; the phone stands upright (axes by check)."""
    back = read(shared_data / "oan_phone_drive", axes="RUB")
    assert (len(back.imu), len(back.gnss)) == (49_913, 998)
    assert np.median(np.diff(back.gnss.t)) == pytest.approx(1.0, abs=1e-9)
    assert back.imu.accel[:, 2].mean() == pytest.approx(-9.8, abs=0.1)


@pytest.mark.parametrize("total", [True, False])
def test_sensor_logger(tmp_path, total):
    """Columns by their names, gravity put back where it was taken out."""
    run = sensor_logger(tmp_path, total)
    back = read(tmp_path)
    np.testing.assert_allclose(back.imu.accel, run.imu.accel[:400], atol=1e-14)
    np.testing.assert_allclose(back.imu.gyro, run.imu.gyro[:400], atol=1e-14)
    np.testing.assert_allclose(back.gnss.llh, run.reference.llh[:400], rtol=1e-14)
    assert back.metadata.time.scale == "gps"
    np.testing.assert_allclose(np.diff(back.imu.t), 0.02, atol=1e-9)


def test_sensor_logger_refused(tmp_path):
    sensor_logger(tmp_path)
    (tmp_path / "TotalAcceleration.csv").unlink()
    (tmp_path / "Gravity.csv").unlink()
    back = read(tmp_path)
    assert back.imu is None
    assert any("Gravity.csv" in note for note in back.metadata.notes)
    (tmp_path / "Location.csv").unlink()
    with pytest.raises(FileFormatError, match="neither"):
        read(tmp_path)


def test_sensor_logger_zip_is_its_folder(tmp_path):
    """As the app shares a log, its tables in a zip; whatever is wrong with one is said of the zip."""
    folder = tmp_path / "a"
    folder.mkdir()
    sensor_logger(folder)
    packed = tmp_path / "a.zip"
    pack(folder, packed)
    one, two = read(folder), read(packed)
    assert np.array_equal(one.imu.accel, two.imu.accel)
    assert np.array_equal(one.gnss.llh, two.gnss.llh)
    assert [Path(name).name for name in two.metadata.sources] == ["a.zip"]
    lines = (folder / "Gyroscope.csv").read_text().splitlines()
    (folder / "Gyroscope.csv").write_text("\n".join([*lines[:9], "1,2,three,4,5", *lines[10:]]))
    pack(folder, packed)
    with pytest.raises(FileFormatError, match=re.escape(f"{packed}/Gyroscope.csv:10: ")):
        read(packed)
    packed.write_bytes(packed.read_bytes()[:-60])
    with pytest.raises(FileFormatError):
        read(packed)


def pack(folder, path):
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        for file in folder.glob("*.csv"):
            archive.write(file, file.name)
