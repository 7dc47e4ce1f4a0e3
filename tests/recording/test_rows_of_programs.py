"""Text as programs print it: blocks of a line for each sensor, messages without a header, rows for each satellite."""

import numpy as np
import pytest

import schuler
from schuler import frames
from schuler.exceptions import SchulerError
from schuler.recording.io import packed
from schuler.units import DEG

N = 40
ACCEL = np.array([[0.01 * k, -0.25, 9.5 + 0.02 * (k % 3)] for k in range(N)])
GYRO = np.array([[0.01, -0.02, 0.005 * k] for k in range(N)])
ADAFRUIT = (
    "\t\tTemperature 25.31 deg C",
    "\t\tAccel X: {a[0]:.2f} \tY: {a[1]:.2f} \tZ: {a[2]:.2f} m/s^2 ",
    "\t\tGyro X: {w[0]:.3f} \tY: {w[1]:.3f} \tZ: {w[2]:.3f} radians/s ",
    "",
)
MPU6050 = (
    "Acceleration X: {a[0]:.2f}, Y: {a[1]:.2f}, Z: {a[2]:.2f} m/s^2",
    "Rotation X: {w[0]:.3f}, Y: {w[1]:.3f}, Z: {w[2]:.3f} rad/s",
    "Temperature: 25.31 degC",
    "",
)


@pytest.mark.parametrize("block", [ADAFRUIT, MPU6050])
def test_blocks_of_a_line_for_each_sensor_are_one_sample(tmp_path, block):
    rows = [
        f"12:00:{0.02 * k:06.3f} -> {line.format(a=a, w=w)}"
        for k, (a, w) in enumerate(zip(ACCEL, GYRO, strict=True))
        for line in block
    ]
    path = tmp_path / "serial.txt"
    path.write_text("\n".join(rows) + "\n")
    imu = schuler.read(path, allow="norm").need_imu()
    np.testing.assert_allclose(imu.t, 43200.0 + 0.02 * np.arange(N), rtol=0, atol=1e-6)
    np.testing.assert_allclose(imu.accel, ACCEL, rtol=0, atol=1e-12)
    np.testing.assert_allclose(imu.gyro, GYRO, rtol=0, atol=1e-12)


def test_a_line_of_one_sensor_begins_a_sample_where_the_other_did_not_come(tmp_path):
    rows = [
        f"12:00:{0.02 * k:06.3f} -> {line.format(a=a, w=w)}"
        for k, (a, w) in enumerate(zip(ACCEL, GYRO, strict=True))
        for line in MPU6050[: 1 if k == 7 else 2]
    ]
    path = tmp_path / "serial.txt"
    path.write_text("\n".join(rows) + "\n")
    name = "serial.txt/Acceleration_RotationRate.csv"
    imu = schuler.read(tmp_path, imu={"file": name, "allow": "norm"}).need_imu()
    np.testing.assert_allclose(imu.accel, np.delete(ACCEL, 7, axis=0), rtol=0, atol=1e-12)
    np.testing.assert_allclose(imu.gyro, np.delete(GYRO, 7, axis=0), rtol=0, atol=1e-12)


def message(k, *values):
    return ",".join([str(1_700_000_000 + k // 50), str(20_000_000 * (k % 50)), "a_link", *map(str, values)])


def test_messages_of_ros_2_without_a_header_are_read_in_their_order(tmp_path):
    nine = [0.01, 0.0, 0.0, 0.0, 0.01, 0.0, 0.0, 0.0, 0.01]
    rows = [
        message(k, 0.0, 0.0, 0.0, 1.0, *nine, *w, *nine, *a, *nine)
        for k, (a, w) in enumerate(zip(ACCEL, GYRO, strict=True))
    ]
    (tmp_path / "imu.csv").write_text("\n".join(rows) + "\n")
    variances = [4.0, 0.0, 0.0, 0.0, 9.0, 0.0, 0.0, 0.0, 25.0]  # east, north, up
    fixes = [message(k, -1 if k == 3 else 0, 1, 48.7 + 1e-5 * k, 9.1, 300.0, *variances, 2) for k in range(12)]
    (tmp_path / "fix.csv").write_text("\n".join(fixes) + "\n")
    log = schuler.read(
        tmp_path, imu={"file": "imu.csv/imu.csv", "time": "unix", "allow": "norm"},
        gnss={"file": "fix.csv/fix.csv", "time": "unix"},
    )  # fmt: skip
    np.testing.assert_array_equal(log.imu.accel, ACCEL)
    np.testing.assert_array_equal(log.imu.gyro, GYRO)
    np.testing.assert_allclose(np.diff(log.imu.t), 0.02, atol=1e-6)
    kept = np.delete(np.arange(12), 3)
    np.testing.assert_allclose(log.gnss.llh[:, 0], (48.7 + 1e-5 * kept) * DEG, rtol=0, atol=1e-12)
    np.testing.assert_allclose(np.sqrt(np.diagonal(log.gnss.cov_r_n[0])), [3.0, 2.0, 5.0], rtol=1e-6)
    assert log.gnss.t[0] == pytest.approx(log.imu.t[0], abs=1e-6)


@pytest.mark.parametrize(
    ("place", "field"),
    [(0, "17\u00b3"), (1, "9" * 400), (3, ""), (3, "-"), (5, "nan"), (5, ""), (8, "x"), (17, "\u00b2")],
)
def test_a_damaged_message_is_left_out(tmp_path, place, field):
    nine = [4.0, 0.0, 0.0, 0.0, 4.0, 0.0, 0.0, 0.0, 4.0]
    rows = [message(k, 0, 1, 48.7, 9.1, 300.0, *nine, 2).split(",") for k in range(40)]
    rows[7][place] = field
    (tmp_path / "fix.csv").write_text("\n".join(map(",".join, rows)) + "\n")
    assert len(schuler.read(tmp_path, gnss={"file": "fix.csv/fix.csv", "time": "unix"}).gnss) == 39


def test_tables_of_as_many_numbers_are_no_messages(tmp_path):
    path = tmp_path / "numbers.csv"
    path.write_text("\n".join(",".join(str(k + j) for j in range(40)) for k in range(30)) + "\n")
    assert packed.tables(path) == ()


def test_a_place_that_all_satellites_of_an_epoch_repeat_is_one_fix(tmp_path):
    llh = np.array([[37.4 * DEG, -122.1 * DEG, 30.0 + k] for k in range(10)])
    r = frames.ecef_from_llh(llh)
    head = "MessageType,utcTimeMillis,TimeNanos,Svid,SvPositionXEcefMeters,SvPositionYEcefMeters,SvPositionZEcefMeters"
    head += ",WlsPositionXEcefMeters,WlsPositionYEcefMeters,WlsPositionZEcefMeters"
    rows = [
        f"Raw,{1_600_000_000_000 + 1000 * k},{k}000000,{sat},1.5e7,2.1e7,{sat}e6,"
        + (",," if k == 4 else "1e308,1e308,1" if k == 6 else ",".join(f"{x:.4f}" for x in r[k]))
        for k in range(10)
        for sat in range(3, 9)
    ]
    (tmp_path / "device_gnss.csv").write_text("\n".join([head, *rows]) + "\n")
    with pytest.raises(SchulerError, match="sigma"):
        schuler.read(tmp_path / "device_gnss.csv", time="unix")
    fixes = schuler.read(tmp_path / "device_gnss.csv", time="unix", sigma="5,5,7").need_gnss()
    kept = np.delete(np.arange(10), [4, 6])
    np.testing.assert_allclose(fixes.llh, llh[kept], rtol=0, atol=2e-4)  # printed digits of the height
    np.testing.assert_allclose(fixes.llh[:, :2], llh[kept, :2], rtol=0, atol=2e-11)
    np.testing.assert_allclose(np.diff(fixes.t), np.diff(kept), atol=1e-6)
