"""SBG logs: an encoder of the test's own, a published check value of the CRC, what is refused."""

import datetime as dt

import encode_sbg
import numpy as np
import pytest
from format_drives import WEEK, drive, same_trajectory

from schuler import units
from schuler.exceptions import FileFormatError, InputError
from schuler.recording.formats import registry, sbg
from schuler.recording.io import read
from schuler.timebase import WEEK_S, calendar

UNDULATION = 47.5


def utc_of(t):
    moment = calendar(WEEK * WEEK_S + t) - dt.timedelta(seconds=18)
    return (moment.year, moment.month, moment.day, moment.hour, moment.minute, moment.second), round((t % 1.0) * 1e9)


@pytest.fixture(scope="module")
def run():
    return drive(rate=50.0)


def log_of(run, path, *, start=7.0, utc=True, quaternions=False, drift=0.0, late=0.08):
    """A drive; the unit's clock starts at ``start`` and runs ``drift`` fast, fixes are stamped ``late`` by it."""
    t0 = run.imu.t[0]

    def own(t):
        return start + (t - t0) * (1.0 + drift)

    out = []
    g, r = run.gnss, run.reference
    for k, t in enumerate(run.imu.t):
        out.append(encode_sbg.imu_short(own(t), run.imu.accel[k], run.imu.gyro[k]))
        if k % 5 == 0:
            llh = (*(r.llh[k, :2] / units.DEG), r.llh[k, 2] - UNDULATION)
            out.append(encode_sbg.ekf_nav(own(t), r.v_eb_n[k], llh, UNDULATION))
            out.append(
                encode_sbg.ekf_quat(own(t), r.q_nb[k]) if quaternions else encode_sbg.ekf_euler(own(t), r.rpy_nb[k])
            )
        if k % 50 == 0:
            fix, tow = k // 50, round(t * 1000)
            if utc:
                out.append(encode_sbg.utc(own(t), *utc_of(t), tow))
            sigma = np.sqrt(np.diag(g.cov_r_n[fix]))
            llh = (*(g.llh[fix, :2] / units.DEG), g.llh[fix, 2] - UNDULATION)
            out.append(encode_sbg.gps_pos(own(t) + late, tow, llh, UNDULATION, sigma))
            out.append(encode_sbg.gps_vel(own(t) + late + 0.01, tow, g.v_n[fix], (0.05, 0.05, 0.05)))
    path.write_bytes(b"".join(out))
    return path


def test_crc_check_value():
    """The published check value of this CRC (CRC-16/KERMIT of the digits 1 to 9), of reader and encoder."""
    assert sbg.crc(b"123456789") == encode_sbg.crc16(b"123456789") == 0x2189


@pytest.mark.parametrize("quaternions", [False, True])
def test_whole_log_comes_back(run, tmp_path, quaternions):
    """Times to a microsecond, IMU to half a count, positions to float64, the rest to float32."""
    back = read(log_of(run, tmp_path / "log.bin", quaternions=quaternions))
    assert back.metadata.time.epoch_gps_s == WEEK * WEEK_S
    np.testing.assert_allclose(back.imu.t, run.imu.t, rtol=0.0, atol=1.1e-6)
    np.testing.assert_allclose(back.imu.accel, run.imu.accel, rtol=0.0, atol=0.5001 / 1048576)
    np.testing.assert_allclose(back.imu.gyro, run.imu.gyro, rtol=0.0, atol=0.5001 / 67108864)
    np.testing.assert_array_equal(back.imu.temperature, 21.5)
    np.testing.assert_allclose(back.gnss.t, run.gnss.t, rtol=0.0, atol=1e-9)  # its own time of week, not its arrival
    np.testing.assert_allclose(back.gnss.llh[:, :2], run.gnss.llh[:, :2], rtol=1e-14)
    np.testing.assert_allclose(back.gnss.llh[:, 2], run.gnss.llh[:, 2], rtol=0.0, atol=1e-9)
    np.testing.assert_allclose(back.gnss.v_n, run.gnss.v_n, rtol=1e-7, atol=1e-9)
    variances = np.einsum("nii->ni", run.gnss.cov_r_n)
    np.testing.assert_allclose(np.einsum("nii->ni", back.gnss.cov_r_n), variances, rtol=3e-7)
    assert set(back.gnss.quality) == {1}
    every = type(run.reference)(*(getattr(run.reference, n)[::5] for n in ("t", "r_eb_e", "v_eb_e", "q_eb")))
    same_trajectory(back.reference, every, t=1.1e-6, r=1e-8, v=1e-6, q=3e-7)


def test_fixes_that_the_clock_stamps_early_are_of_the_same_week(run, tmp_path):
    """The clock is the unit's own: a fix may seem to arrive before its time of week."""
    back = read(log_of(run, tmp_path / "log.bin", late=-0.001))
    np.testing.assert_allclose(back.gnss.t, run.gnss.t, rtol=0.0, atol=1e-9)  # rounding


def test_clock_of_the_unit(run, tmp_path):
    """The counter of microseconds starts anew after 71.6 minutes; without UTC times stay on it."""
    path = log_of(run, tmp_path / "log.bin", start=4290.0, utc=False)
    back = read(path)
    assert back.metadata.time.scale == "local"
    np.testing.assert_allclose(back.imu.t, 4290.0 + run.imu.t - run.imu.t[0], rtol=0.0, atol=1.1e-6)
    np.testing.assert_allclose(back.gnss.t, 4290.08 + run.gnss.t - run.gnss.t[0], rtol=0.0, atol=1.1e-6)
    assert any("no valid UTC_TIME" in note for note in back.metadata.notes)
    path = log_of(run, path, start=4290.0)
    np.testing.assert_allclose(read(path).imu.t, run.imu.t, rtol=0.0, atol=1.1e-6)
    assert read(path, time="local").metadata.time.scale == "local"


def test_rate_of_the_clock(tmp_path):
    """Over minutes the clock's rate (20 ppm here) is found; the bound is the resolution of the stamps."""
    out = []
    for k in range(3000):
        t = 345_600.0 + 0.1 * k
        out.append(encode_sbg.imu_short(5.0 + 0.1 * k * (1 + 20e-6), (0, 0, -9.81), (0, 0, 0)))
        if k % 10 == 0:
            out.append(encode_sbg.utc(5.0 + 0.1 * k * (1 + 20e-6), *utc_of(t), round(t * 1000)))
    (tmp_path / "log.bin").write_bytes(b"".join(out))
    back = read(tmp_path / "log.bin")
    np.testing.assert_allclose(back.imu.t, 345_600.0 + 0.1 * np.arange(3000), rtol=0.0, atol=2e-6)
    assert any("-20.0 ppm" in note for note in back.metadata.notes)


def test_high_range_and_legacy_imu(tmp_path):
    """Bit 10 of the status changes what a count of the gyro is; IMU_DATA is read where IMU_SHORT is not."""
    path = tmp_path / "log.bin"
    out = [
        encode_sbg.imu_short(0.005 * k, (0, 0, -9.81), (0.5, 0, 40.0 if k > 250 else 1.0), high=k > 250)
        for k in range(300)
    ]
    path.write_bytes(b"".join(out))
    imu = read(path).imu
    np.testing.assert_allclose(imu.gyro[[0, -1]], [(0.5, 0, 1.0), (0.5, 0, 40.0)], atol=1e-7)
    path.write_bytes(b"".join(encode_sbg.imu_data(0.005 * k, (0, 0, -9.81), (0.5, 0, 0)) for k in range(300)))
    back = read(path)
    np.testing.assert_allclose(back.imu.accel[0], (0, 0, -9.81), rtol=1e-7)
    assert any("IMU_DATA, filtered" in note for note in back.metadata.notes)


def test_solutions_left_out(tmp_path):
    path = tmp_path / "log.bin"
    where = (48.0, 8.0, 352.5)
    out = [encode_sbg.gps_pos(k, 1000 * k, where, UNDULATION, (1, 1, 2), kind=kind, status=status)
           for k, (kind, status) in enumerate(((2, 0), (0, 0), (7, 1), (6, 0), (10, 0)))]  # fmt: skip
    out.append(encode_sbg.gps_vel(3.0, 3000, (1, 2, 3), (0.1, 0.2, 0.3)))
    out += [encode_sbg.ekf_nav(k, (1, 2, 3), where, UNDULATION, mode=mode) for k, mode in enumerate((4, 2, 4))]
    path.write_bytes(b"".join(out))
    back = read(path)
    assert list(back.gnss.quality) == [5, 2]
    np.testing.assert_array_equal(back.gnss.v_n, ((0, 0, 0), (1, 2, 3)))
    np.testing.assert_allclose(np.diag(back.gnss.cov_v_n[1]), (0.01, 0.04, 0.09), rtol=1e-6)
    assert back.gnss.cov_v_n[0, 0, 0] == 1e6
    np.testing.assert_allclose(back.reference.llh[:, 2], 400.0, atol=1e-9)
    assert len(back.reference) == 2
    assert back.reference.q_eb is None
    assert any("no attitude" in note for note in back.metadata.notes)


def test_hints_streams_and_damage(run, tmp_path):
    path = log_of(run, tmp_path / "log.bin")
    with pytest.raises(InputError, match="leave out"):
        read(path, height="msl", geoid_separation=47.0)
    names = {s.name: s for s in registry.module("sbg").contents(path)}
    assert names["IMU_SHORT"].rate_hz == pytest.approx(50.0, rel=1e-4)
    assert names["EKF_NAV"].part == "reference"
    assert read(path, streams="imu=none").imu is None
    assert read(path, series="imu").gnss is None
    data = bytearray(path.read_bytes())
    data[50] ^= 1
    path.write_bytes(bytes(data[:-4]))
    back = read(path)
    assert len(run.imu) - 2 <= len(back.imu) <= len(run.imu) - 1
    assert any("no frame with a right CRC" in note for note in back.metadata.notes)
    path.write_bytes(encode_sbg.frame(1, bytes(27)) * 3)
    with pytest.raises(FileFormatError, match="log 1 of class 0"):
        read(path)
    path.write_bytes(b"time,accel\n1,2\n")
    with pytest.raises(FileFormatError, match="sbgCenter"):
        read(path, format="sbg")
