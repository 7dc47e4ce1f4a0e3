"""Logs of real sensors as their makers left them; skipped where the recordings are not at hand.

Expected numbers come from the README files beside the recordings or from reading a few lines by eye.
"""

import numpy as np
import pytest
import scipy.io

from schuler import units
from schuler.exceptions import FileFormatError
from schuler.recording.io import read, write

pytestmark = pytest.mark.realdata

FLU = np.diag([1.0, -1.0, -1.0])


def test_a_log_with_a_header_that_states_units(shared_data):
    r = read(shared_data / "rtkexp_drive" / "imu_gpst.csv", time="gps-tow:2374", axes="FLU")
    imu = r.imu
    assert len(imu) == 54_858
    assert imu.rate_hz == pytest.approx(100.0, rel=1e-3)  # printed digits: stamps of 0.1 ms
    assert r.metadata.time.epoch_gps_s == 2374 * 604_800.0
    assert imu.t[0] == 243_261.854
    np.testing.assert_array_equal(imu.accel[0], (1.13757, -0.30401, -9.65955))
    np.testing.assert_array_equal(imu.gyro[0], (-0.0062657, -0.0165108, -0.0029322))
    # the unit stands still until 39.5 s; the sensor is 1.2 % off gravity
    assert np.linalg.norm(imu.between(imu.t[0], imu.t[0] + 30.0).accel.mean(axis=0)) == pytest.approx(9.93, abs=0.02)
    assert any("the mean specific force is 9.9" in note for note in r.metadata.notes)


def test_the_same_log_raw_with_a_counter_in_milliseconds(shared_data):
    path = shared_data / "rtkexp_drive" / "imu_1934.csv"
    with pytest.raises(FileFormatError, match=r"imu_1934.csv:1: there is no header, so the 7 columns are not known"):
        read(path)
    r = read(path, columns="ax,ay,az,gx,gy,gz,t", units="g,deg/s,ms", axes="FLU")
    assert r.imu.t[0] == pytest.approx(261.906, abs=1e-12)  # rounding, here and below
    np.testing.assert_allclose(r.imu.accel[0], FLU @ (0.119, 0.027, 1.013) * units.G0, rtol=1e-14)
    np.testing.assert_allclose(r.imu.gyro[0], FLU @ np.deg2rad((-0.671, 3.082, 0.198)), rtol=1e-14)
    assert r.metadata.time.scale == "local"
    # the derived file is made of these numbers from the second row on, printed to 5 and 7 decimals
    derived = read(path.with_name("imu_gpst.csv"), axes="FLU").imu
    np.testing.assert_allclose(derived.accel[:1000], r.imu.accel[1:1001], atol=6e-6)
    np.testing.assert_allclose(derived.gyro[:1000], r.imu.gyro[1:1001], atol=6e-8)
    with pytest.raises(FileFormatError, match=r"the numbers look like g, not m/s\^2"):
        read(path, columns="ax,ay,az,gx,gy,gz,t", units="m/s^2,deg/s,ms")


def test_an_rtklib_solution_with_heights_above_sea_level(shared_data):
    path = shared_data / "rtkexp_drive" / "gnss_1934_sf.pos"
    r = read(path, height="msl", geoid_separation=-17.0)
    gnss = r.gnss
    assert len(gnss) == 2197
    assert (gnss.quality == 1).sum() == 2189
    assert gnss.t[0] == pytest.approx(243_258.499, abs=1e-9)  # rounding
    np.testing.assert_allclose(np.rad2deg(gnss.llh[0, :2]), (40.0966268, -105.1474483), rtol=1e-15)  # rounding
    assert gnss.llh[0, 2] == 1601.474 - 17.0
    np.testing.assert_array_equal(gnss.v_n[0], (0.01, -0.002, -0.009))
    assert gnss.cov_r_n[0, 0, 0] == pytest.approx(0.0098995**2, rel=1e-12)  # rounding
    assert any("Heights are taken as ellipsoidal" in note for note in read(path).metadata.notes)


def test_a_drive_is_merged_from_its_folder(shared_data, tmp_path):
    drive = shared_data / "rtkexp_drive"
    r = read(
        drive,
        imu={"file": "imu_gpst.csv", "time": "gps-tow:2374", "axes": "FLU", "offset": -0.125},
        gnss={"file": "gnss_1934_sf.pos", "height": "msl", "geoid_separation": -17.0},
    )
    assert r.start == pytest.approx(243_258.499, abs=1e-9)  # rounding
    assert abs(r.imu.t[0] - (243_261.854 - 0.125)) < 1e-9  # rounding
    for suffix in (".parquet", ".csv"):
        back = read(write(r, tmp_path / f"drive{suffix}")[0])
        np.testing.assert_array_equal(back.imu.accel, r.imu.accel)
        np.testing.assert_array_equal(back.imu.t, r.imu.t)
        np.testing.assert_allclose(back.gnss.llh, r.gnss.llh, rtol=4e-16)  # rounding of degrees
        assert back.metadata.notes == r.metadata.notes
    back = read(write(r, tmp_path / "drive.pos")[0])
    np.testing.assert_allclose(back.gnss.cov_v_n, r.gnss.cov_v_n, atol=1e-6)  # printed digits


def test_a_commented_header_and_jittering_stamps(shared_data):
    path = shared_data / "snu_staticposes" / "imu_good3.txt"
    r = read(path, columns="t,ax,ay,az,gx,gy,gz,*", units="m/s^2,rad/s", axes="FLU")
    assert len(r.imu) == 11_475
    assert r.imu.rate_hz == pytest.approx(97.6, abs=0.1)  # README
    assert any("jitter" in note for note in r.metadata.notes)
    assert any("header in line 1 was passed over" in note for note in r.metadata.notes)
    # 3.4 % off gravity before calibration: inside the tolerance that tells units apart
    assert any("mean specific force is 10.1" in note for note in r.metadata.notes)


def test_counts_of_two_sensors_in_two_ascii_files_called_mat(shared_data):
    folder = shared_data / "imu_tk_xsens"
    accel = {"file": "xsens_acc.mat", "columns": "t,ax,ay,az", "units": "accel=counts"}
    gyro = {"file": "xsens_gyro.mat", "columns": "t,gx,gy,gz", "units": "gyro=counts"}
    r = read(folder, accel=accel, gyro=gyro)
    assert len(r.imu) == 51_175
    np.testing.assert_array_equal(r.imu.accel[0], (33_108, 33_329, 36_429))
    assert r.imu.t[0] == 0.02984
    assert any("raw counts, not SI" in note for note in r.metadata.notes)
    with pytest.raises(FileFormatError, match=r"accel reaches 3\.\d+e\+04 m/s\^2 .*counts need scale"):
        read(folder / "xsens_acc.mat", columns="t,ax,ay,az", units="accel=m/s^2", allow="no-gyro")


def test_increments_right_forward_up(shared_data):
    path = shared_data / "psins_tc" / "insgpseo_tc.mat"
    hints = {"columns": "gx,gy,gz,ax,ay,az,t", "units": "m/s,rad", "axes": "RFU"}
    r = read(path, kind="increment", **hints)
    raw = scipy.io.loadmat(path)["imu"]
    assert r.imu.kind == "increment"
    np.testing.assert_array_equal(r.imu.accel, np.column_stack((raw[:, 4], raw[:, 3], -raw[:, 5])))
    np.testing.assert_array_equal(r.imu.gyro, np.column_stack((raw[:, 1], raw[:, 0], -raw[:, 2])))
    # a level vehicle; its accelerations average out to some hundredths
    assert r.imu.accel[1:, 2].sum() / (r.imu.t[-1] - r.imu.t[0]) == pytest.approx(-9.8, abs=0.03)
    with pytest.raises(FileFormatError, match=r"the numbers look like increments \(kind='increment'"):
        read(path, columns=hints["columns"], units="m/s^2,rad/s", axes="RFU")


def test_counts_with_an_array_of_factors(shared_data):
    r = read(
        shared_data / "adis16405_static" / "adis16405_imu1.npz",
        columns="gx,gy,gz,ax,ay,az",
        units="g,deg/s",
        scale="lsb",
        rate=100,
    )
    assert r.imu.accel.shape == (1_000_000, 3)
    counts = np.load(shared_data / "adis16405_static" / "adis16405_imu1.npz")["counts"]
    np.testing.assert_allclose(r.imu.gyro[:100], np.deg2rad(counts[:100, :3] * 0.05), rtol=1e-14)  # rounding, and below
    np.testing.assert_allclose(r.imu.accel[:100], counts[:100, 3:] * 0.00333 * units.G0, rtol=1e-14)
    assert r.imu.t[-1] == pytest.approx(9999.99)


def test_tabs_nanoseconds_and_temperature(shared_data):
    path = shared_data / "imu_thermal" / "imu_raw_data.csv"
    with pytest.raises(FileFormatError, match="the unit of gx is not known"):
        read(path)
    r = read(path, units="m/s^2,rad/s,ns")
    assert len(r.imu) == 8400
    assert r.imu.t[0] == pytest.approx(256_551.281491968, abs=1e-9)  # rounding
    np.testing.assert_array_equal(r.imu.accel[0], (0.1787716895, -0.1075842828, -9.55327034))
    assert r.imu.temperature[0] == 51.61518097
    assert (r.imu.temperature.min(), r.imu.temperature.max()) == pytest.approx((-17.6, 74.0), abs=0.1)  # README
    assert any("Columns not used: imu.status" in note for note in r.metadata.notes)


def test_a_matrix_with_its_times_in_another_array(shared_data):
    paths = sorted((shared_data / "pyshoe_vicon").glob("*.mat"))
    assert len(paths) == 8
    for path in paths:
        r = read(path, columns="ax,ay,az,gx,gy,gz", units="m/s^2,rad/s")
        raw = scipy.io.loadmat(path)
        np.testing.assert_array_equal(r.imu.accel, raw["imu"][:, :3])
        np.testing.assert_array_equal(r.imu.t, raw["ts"].ravel())
        assert r.imu.rate_hz == pytest.approx(200.0, rel=0.01)  # README
        assert "Time was taken from the array ts." in r.metadata.notes


def test_scaled_increments_below_a_preamble(shared_data):
    r = read(
        shared_data / "psins_lasergyro" / "lasergyro.imu",
        columns="gx,gy,gz,ax,ay,az",
        units="ug*s,arcsec",
        scale="gyro=0.1,accel=125",
        kind="increment",
        rate=100,
        axes="RFU",
        skip=13,
    )
    assert len(r.imu) == 184_719
    rate = r.imu.gyro.mean(axis=0) / 0.01
    # Earth rate about the down axis, -15.04 sin 34.246 deg; the parked vehicle turns by less than 0.1 deg
    assert rate[2] / units.DEG_PER_HR == pytest.approx(-8.465, abs=0.2)


def test_mapped_headers_words_among_numbers_and_an_uncalibrated_sensor(shared_data):
    path = shared_data / "instinct_tckf" / "vn310-imu.csv"
    accel = ",".join(f"a{k.lower()}=IMU::Accel::{k} [m/s^2]" for k in "XYZ")
    gyro = "gx=IMU::AngularRate::X,gy=IMU::AngularRate::Y [rad/s],gz=IMU::AngularRate::Z [rad/s]"
    r = read(path, columns=f"t=GpsTow [s],{accel},{gyro}", units="gyro=rad/s", time="gps-tow:2268")
    assert r.imu.t[0] == pytest.approx(385_980.778684, abs=1e-9)  # rounding
    assert any("1 gap of more" in note for note in r.metadata.notes)

    sessions = shared_data / "imucal_ferraris"
    with pytest.raises(FileFormatError, match=r":2: expected the specific force at rest .* needs calibration"):
        read(sessions / "example_ferraris_session.csv", units="m/s^2,deg/s", rate=102.4)
    r = read(sessions / "example_ferraris_session.csv", units="m/s^2,deg/s", rate=102.4, allow="norm")
    assert len(r.imu) == 10_376
    r = read(sessions / "annotated_session.csv", units="counts,counts", rate=204.8)
    assert len(r.imu) == 9414
