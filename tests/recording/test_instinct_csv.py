"""Tables of VectorNav units as INSTINCT writes them: samples, fixes, raw measurements in brackets."""

from pathlib import Path

import numpy as np
import pytest

from schuler.exceptions import FileFormatError, InputError
from schuler.gnss.signals import SPEED_OF_LIGHT, frequency_hz, satellite_name
from schuler.recording.formats.instinct_csv import looks_like_instinct_csv, read_instinct_gnss, read_instinct_imu
from schuler.recording.io import ReadHints

WEEK = 604_800.0
TIME = "Time [s],GpsCycle,GpsWeek,GpsTow [s],Time::GpsTow [ns],Time::GpsWeek"
IMU = TIME + "".join(f",IMU::UncompAccel::{c} [m/s^2]" for c in "XYZ")
IMU += "".join(f",IMU::UncompGyro::{c} [rad/s]" for c in "XYZ") + ",IMU::Temp [Celsius]"
ROW = "0,2,220,385980.778684,{ns},2268,-0.3,-0.6,-9.7,0.001,0.002,0.003,46.2"
GNSS = (
    TIME + ",GNSS1::Tow [ns],GNSS1::Week,GNSS1::NumSats,GNSS1::Fix,GNSS1::PosLla::latitude [deg],"
    "GNSS1::PosLla::longitude [deg],GNSS1::PosLla::altitude [m],GNSS1::VelNed::N [m/s],GNSS1::VelNed::E [m/s],"
    "GNSS1::VelNed::D [m/s],GNSS1::PosU::N [m],GNSS1::PosU::E [m],GNSS1::PosU::D [m],GNSS1::VelU [m/s],"
    "GNSS1::RawMeas::Tow [s],GNSS1::RawMeas::Week,GNSS1::RawMeas::Satellites"
)
FIX = "0,2,220,0,{ns},2268,{ns},2268,17,{fix},48.75,9.25,329.2,0.1,-0.2,0.3,3.8,{se},4.9,0.3,{tow},2268,{raw}"
RAW = (
    "[0|5|1|1|0|41|0|1|1|1|1|0|0|0|0|21000000.5|110000000.25|1000.0]"
    "[2|12|7|9|0|39|0|1|1|1|0|0|0|0|0|24000000|96000000|-500.0]"
    "[1|123|1|1|0|38|0|1|1|0|1|0|0|0|0|37000000|194000000|-222.0]"
    "[0|5|2|10|0|30|0|1|1|1|1|0|0|0|0|21000000|85000000|700.0]"
)


def fix(second=385_980.8, tow=385_980.794, kind=3, se=1.9, raw=RAW) -> str:
    return FIX.format(ns=round(second * 1e9), tow=tow, fix=kind, se=se, raw=raw)


@pytest.fixture
def log(tmp_path: Path):
    def write(*lines: str) -> Path:
        path = tmp_path / "vn310.csv"
        path.write_text("\n".join(lines) + "\n")
        return path

    return write


def test_samples_on_gps_time(log):
    r = read_instinct_imu(log(IMU, ROW.format(ns=385_980_778_683_662), ROW.format(ns=385_980_798_683_662)))
    np.testing.assert_allclose(r.imu.t, (385_980.778683662, 385_980.798683662), rtol=0, atol=1e-9)  # rounding
    assert r.metadata.time.epoch_gps_s == 2268 * WEEK
    assert r.imu.accel[0].tolist() == [-0.3, -0.6, -9.7]
    assert r.imu.gyro[0].tolist() == [0.001, 0.002, 0.003]
    assert r.imu.temperature.tolist() == [46.2, 46.2]


def test_faults_name_the_line(log):
    good = ROW.format(ns=1_000_000_000)
    with pytest.raises(FileFormatError, match=r"vn310.csv:3: expected increasing times"):
        read_instinct_imu(log(IMU, good, good))
    with pytest.raises(FileFormatError, match=r"vn310.csv:2: IMU::UncompGyro::Y \[rad/s\]: expected a number, got ''"):
        read_instinct_imu(log(IMU, good.replace("0.002", "")))
    with pytest.raises(FileFormatError, match=r"vn310.csv:3: expected 13 fields as in the header, got 4"):
        read_instinct_imu(log(IMU, good, "0,2,220,3"))
    with pytest.raises(FileFormatError, match="expected the column 'GNSS1::Tow"):
        read_instinct_gnss(log(IMU, good))
    with pytest.raises(FileFormatError, match="no row"):
        read_instinct_imu(log(IMU))
    with pytest.raises(InputError, match="leave out axes"):
        read_instinct_imu(log(IMU, good), ReadHints(axes="FLU"))
    with pytest.raises(InputError, match="leave out offset"):
        read_instinct_gnss(log(GNSS, fix()), ReadHints(offset=0.1))
    assert read_instinct_imu(log(IMU, good), ReadHints(offset=0.5)).imu.t.tolist() == [1.5]


def test_fixes(log):
    r = read_instinct_gnss(log(GNSS, fix(), fix(385_981.0, 385_980.994, 8), fix(385_981.2, 385_981.194, 1)))
    gnss = r.recording.gnss
    np.testing.assert_allclose(gnss.t, (385_980.8, 385_981.0), rtol=0, atol=1e-9)  # rounding
    np.testing.assert_allclose(gnss.llh[0], (*np.deg2rad((48.75, 9.25)), 329.2), rtol=1e-15)
    assert gnss.v_n[0].tolist() == [0.1, -0.2, 0.3]
    np.testing.assert_allclose(np.diag(gnss.cov_r_n[0]), (3.8**2, 1.9**2, 4.9**2), rtol=1e-15)
    np.testing.assert_allclose(gnss.cov_v_n[0], np.eye(3) * 0.09, rtol=1e-15)
    assert gnss.quality.tolist() == [5, 1]
    assert any("1 epochs without a three-dimensional fix" in note for note in r.recording.metadata.notes)
    with pytest.raises(FileFormatError, match="none of the 1 epochs"):
        read_instinct_gnss(log(GNSS, fix(se=0.0)))


def test_raw_measurements(log):
    o = read_instinct_gnss(log(GNSS, fix())).observations
    assert [satellite_name(s) for s in o.sat] == ["G05", "E12", "S23"]
    assert [o.signals[k] for k in o.signal] == ["1C", "7Q", "1C"]
    np.testing.assert_allclose(o.t, 385_980.794, rtol=0, atol=1e-9)
    assert o.pseudorange[:2].tolist() == [21_000_000.5, 24_000_000.0]
    assert np.isnan(o.pseudorange[2])  # code not locked
    assert np.isnan(o.carrier).tolist() == [False, True, False]  # phase not locked
    assert o.range_rate[0] == pytest.approx(-1000.0 * SPEED_OF_LIGHT / 1575.42e6, rel=1e-15)
    assert o.cn0.tolist() == [41.0, 39.0, 38.0]
    assert o.notes == ("Raw measurements of signals not known here were left out: G band 2 channel 10 (1).",)


def test_raw_measurements_cut_short_are_refused(log):
    with pytest.raises(FileFormatError, match=r"vn310.csv:2: expected 18 numbers between brackets, got \[0\|5\|1\]"):
        read_instinct_gnss(log(GNSS, fix(raw="[0|5|1]")))
    assert len(read_instinct_gnss(log(GNSS, fix(raw=""))).observations) == 0


def test_recognition():
    assert looks_like_instinct_csv(GNSS.encode())
    assert not looks_like_instinct_csv(b"Time [s],ax,ay\n")


@pytest.mark.realdata
def test_the_real_tables(shared_data):
    folder = shared_data / "instinct_tckf"
    r = read_instinct_imu(folder / "vn310-imu.csv")
    assert len(r.imu) == 1638
    assert r.imu.rate_hz == pytest.approx(50.0, rel=1e-3)
    np.testing.assert_allclose(r.imu.gaps()[:, 1], [0.28526], atol=1e-4)
    assert any("1 gap of more" in note for note in r.metadata.notes)
    assert np.linalg.norm(r.imu.accel.mean(axis=0)) == pytest.approx(9.81, abs=0.02)
    log = read_instinct_gnss(folder / "vn310-gnss.csv")
    assert (len(log.recording.gnss), len(log.observations)) == (166, 6355)
    o = log.observations
    # carrier over pseudorange is the frequency of every signal, and its rate is minus the Doppler
    for k, name in enumerate(o.signals):
        rows = np.flatnonzero((o.signal == k) & (o.sat // 100 != 6))
        ratio = np.median(o.carrier[rows] / o.pseudorange[rows]) * SPEED_OF_LIGHT
        assert ratio == pytest.approx(frequency_hz(int(o.sat[rows[0]]), name), rel=1e-6)
    g = np.flatnonzero((o.sat == 10) & (o.signal == o.signals.index("1C")))
    cycle = SPEED_OF_LIGHT / 1575.42e6
    from_carrier = np.diff(o.carrier[g]) * cycle / np.diff(o.t[g])
    mean_rate = 0.5 * (o.range_rate[g][1:] + o.range_rate[g][:-1])
    assert np.median(np.abs(from_carrier - mean_rate)) < 0.05  # noise of a Doppler; the rate itself is 306 m/s
