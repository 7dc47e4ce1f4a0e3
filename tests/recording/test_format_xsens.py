"""Xsens logs: an encoder of the test's own, a packet that MT Manager decoded, what is refused."""

import datetime as dt

import encode_xsens as xs
import numpy as np
import pytest
from format_drives import WEEK, drive, same_trajectory

from schuler import frames, rotation, units
from schuler.exceptions import FileFormatError, InputError
from schuler.recording.formats import registry
from schuler.recording.io import read
from schuler.timebase import WEEK_S, calendar

FLU = np.array((1.0, -1.0, -1.0))
LEAP = 18
# a packet of an MTi-300 and what MT Manager made of it (published as a test case of an open-source driver)
PACKET = bytes.fromhex(
    "1020 02 A655 1060 04 0057472E 2010 10 3F7F7DC4BC10107D3BA15770BD7EC656 4020 0C BDA21AF8BE2A8E96411D27A2"
    "4010 0C B94FC800B9DA24003CC92880 4030 0C 3C02C89C3C35F6C83CDB0C00 8020 0C BBB17D81BB9632003C01E841"
    "8030 10 3F800000B6E33001B6C0400037264800 C020 0C BE999C243FB61B563F166AEB 3010 04 000186DE E020 04 00400003"
)


def utc_of(t):
    """Calendar fields of a time of the drive's week, and nanoseconds."""
    moment = calendar(WEEK * WEEK_S + t) - dt.timedelta(seconds=LEAP)
    fields = (moment.year, moment.month, moment.day, moment.hour, moment.minute, moment.second)
    return fields, round((t % 1.0) * 1e9)


@pytest.fixture(scope="module")
def run():
    return drive(rate=50.0)


def log_of(run, path, *, form="single", utc=True, system=0, start=7.0):
    """A drive as MTData2: IMU in every packet, temperature in each 50th, GNSS and the solution in each 10th."""
    out = [xs.message(b"", 0x30)]
    to = {0: np.array([[0, 1, 0], [1, 0, 0], [0, 0, -1.0]]), 4: np.eye(3), 8: np.diag(FLU)}[system]
    t0 = run.imu.t[0]
    for k, t in enumerate(run.imu.t):
        payload = xs.counter(k) + xs.fine(round((t - t0 + start) * 1e4))
        fields, nano = utc_of(t)
        if utc:
            payload += xs.utc(*fields, nano)
        payload += xs.vector(0x4020, run.imu.accel[k] * FLU, form) + xs.vector(0x8020, run.imu.gyro[k] * FLU, form)
        if k % 50 == 0:
            payload += xs.vector(0x0810, (20.0 + k / 100,))
        if k % 10 == 0:
            r = run.reference
            C = to @ rotation.dcm_from_quat(r.q_nb[k]) * FLU
            payload += xs.vector(0x2010, rotation.quat_from_dcm(C), "double", system)
            payload += xs.vector(0x5040, r.llh[k, :2] / units.DEG, "double")
            payload += xs.vector(0x5020, r.llh[k, 2:], "double")
            payload += xs.vector(0xD010, to @ r.v_eb_n[k], "double", system)
            g = run.gnss
            fix = int(np.searchsorted(g.t, t + 1e-6)) - 1
            itow = round(g.t[fix] * 1000)
            when = utc_of(g.t[fix] - g.t[fix] % 1.0)[0]
            payload += xs.gnss(itow, when, (*(g.llh[fix, :2] / units.DEG), g.llh[fix, 2]), g.v_n[fix], (0.5, 0.8, 0.05))
        out.append(xs.message(payload))
    path.write_bytes(b"".join(out))
    return path


@pytest.mark.parametrize("system", [0, 4, 8])
def test_whole_log_comes_back(run, tmp_path, system):
    """Times to a tick (0.1 ms), IMU to float32, positions and attitude of the solution to float64."""
    back = read(log_of(run, tmp_path / "log.mtb", system=system))
    assert back.metadata.time.epoch_gps_s == WEEK * WEEK_S
    np.testing.assert_allclose(back.imu.t, run.imu.t, rtol=0.0, atol=1e-6)
    np.testing.assert_allclose(back.imu.accel, run.imu.accel, rtol=1e-7)
    np.testing.assert_allclose(back.imu.gyro, run.imu.gyro, rtol=1e-7)
    np.testing.assert_allclose(back.imu.temperature[:951], 20.0 + np.arange(951) / 100, atol=1e-4)
    every = type(run.reference)(*(getattr(run.reference, n)[::10] for n in ("t", "r_eb_e", "v_eb_e", "q_eb")))
    same_trajectory(back.reference, every, t=1e-6, r=1e-8, v=1e-12, q=1e-12)
    g = back.gnss
    assert len(g) == len(run.gnss)
    np.testing.assert_allclose(g.llh[:, :2], run.gnss.llh[:, :2], rtol=0.0, atol=1e-9)  # 1e-7 deg
    np.testing.assert_allclose(g.llh[:, 2], run.gnss.llh[:, 2], rtol=0.0, atol=5.1e-4)  # 1 mm
    np.testing.assert_allclose(g.v_n, run.gnss.v_n, atol=5.1e-4)
    np.testing.assert_allclose(g.cov_r_n[0], np.diag((0.25, 0.25, 0.64)))
    # the drive's fixes are at whole seconds and an eighth; the encoder writes no fraction of the UTC second
    np.testing.assert_allclose(g.t, np.floor(run.gnss.t), rtol=0.0, atol=1e-9)


def test_attitude_of_a_turned_sensor(tmp_path):
    """A sensor with x up, y right and z forward on a level vehicle facing east: its axes in east-north-up."""
    C_ls = np.array([[0.0, 0.0, 1.0], [0.0, -1.0, 0.0], [1.0, 0.0, 0.0]])  # columns: up, south, east
    payload = xs.fine(10_000) + xs.vector(0x2010, rotation.quat_from_dcm(C_ls), "double")
    payload += xs.vector(0x5040, (48.0, 8.0), "double") + xs.vector(0x5020, (400.0,)) + xs.vector(0xD010, (1, 2, 3))
    path = tmp_path / "turned.mtb"
    path.write_bytes(xs.message(payload) + xs.message(payload.replace(xs.fine(10_000), xs.fine(20_000))))
    back = read(path, axes="URF").reference
    np.testing.assert_allclose(back.rpy_nb[0] / units.DEG, (0.0, 0.0, 90.0), atol=1e-9)
    np.testing.assert_allclose(back.v_eb_n[0], (2.0, 1.0, -3.0), atol=1e-9)


@pytest.mark.parametrize(("form", "tolerance"), [("12.20", 2.0**-21), ("16.32", 2.0**-33), ("double", 0.0)])
def test_forms_of_numbers(run, tmp_path, form, tolerance):
    """Half a unit of the last place of each form."""
    back = read(log_of(run, tmp_path / "log.mtb", form=form, utc=False), allow="norm")
    assert back.metadata.time.scale == "local"
    assert back.gnss is None
    np.testing.assert_allclose(back.imu.accel, run.imu.accel, rtol=1e-15, atol=1.001 * tolerance)
    np.testing.assert_allclose(back.imu.gyro, run.imu.gyro, rtol=1e-15, atol=1.001 * tolerance)
    np.testing.assert_allclose(back.imu.t, run.imu.t - run.imu.t[0] + 7.0, rtol=0.0, atol=1e-9)


def test_packet_that_mt_manager_decoded(tmp_path):
    """Real bytes: the printed digits of the rates; increments at 400 Hz are the same motion."""
    path = tmp_path / "real.mtb"
    second = PACKET.replace(bytes.fromhex("0057472E"), bytes.fromhex("00574747"))  # 25 ticks later
    path.write_bytes(xs.message(PACKET) + xs.message(second))
    rates = read(path, streams="imu=rates", axes="FRD", allow="norm").imu
    np.testing.assert_allclose(rates.accel[0], (-0.07915300, -0.16655955, 9.82217598), atol=5e-9 * 10)
    np.testing.assert_allclose(rates.gyro[0], (-0.00541657, -0.00458360, 0.00792891), atol=5e-9)
    np.testing.assert_allclose(rates.t, (571.9854, 571.9879), rtol=0.0, atol=1e-9)
    delta = read(path, allow="norm").imu
    assert delta.kind == "increment"
    np.testing.assert_allclose(delta.accel[0] * 400, (-0.0792, 0.1666, -9.8222), atol=1e-3)
    # the rotation vector is twice the vector part; single precision near one leaves 1e-6 rad/s at 400 Hz
    np.testing.assert_allclose(delta.gyro[0] * 400, (-0.0054166, 0.0045836, -0.0079289), atol=2e-6)
    assert delta.accel[0, 2] < 0  # up on the case is not down


def test_extended_length_and_wrap(tmp_path):
    """Messages longer than 254 bytes; the fine counter starts anew after 4.97 days."""
    path = tmp_path / "long.mtb"
    filler = xs.item(0xA010, bytes(120))
    out = []
    for k in range(200):
        payload = (
            xs.fine(2**32 - 5000 + 100 * k)
            + filler * 2
            + xs.vector(0x4020, (0, 0, 9.81))
            + xs.vector(0x8020, (0, 0, 0))
        )
        out.append(xs.message(payload))
    path.write_bytes(b"".join(out))
    imu = read(path).imu
    assert len(imu) == 200
    np.testing.assert_allclose(np.diff(imu.t), 0.01, rtol=0.0, atol=1e-9)
    np.testing.assert_allclose(imu.accel[0], (0, 0, -9.81), rtol=1e-7)


def test_counter_needs_a_rate(tmp_path):
    path = tmp_path / "c.mtb"
    still = xs.vector(0x4020, (0, 0, 9.81)) + xs.vector(0x8020, (0, 0, 0))
    rows = [xs.message(xs.counter(65500 + k + (k >= 150)) + still) for k in range(200)]
    path.write_bytes(b"".join(rows))
    with pytest.raises(InputError, match="rate"):
        read(path)
    imu = read(path, rate=100.0).imu
    assert imu.t[-1] == pytest.approx(2.0)  # one packet was lost and the counter says so
    assert len(imu) == 200


TEXT = "\n".join((
    "// Start Time: Unknown", "// Update Rate: 100.0Hz", "// Filter Profile: human (46.1)", "// Firmware: 4.6.0",
    "PacketCounter\tSampleTimeFine\tAcc_X\tAcc_Y\tAcc_Z\tGyr_X\tGyr_Y\tGyr_Z\tMag_X\tMag_Y\tMag_Z",
))  # fmt: skip


def test_places_of_a_text_export_are_the_sensors_own_solution(tmp_path):
    path = tmp_path / "MT_02.txt"
    names = TEXT.replace("Mag_X\tMag_Y\tMag_Z", "Latitude\tLongitude\tAltitude\tVel_X\tVel_Y\tVel_Z")
    places = [("0.0", "0.0", "0.0") if k < 5 else (f"{48.0 + 1e-6 * k:.6f}", "9.1", "300.5") for k in range(200)]
    rows = [
        f"{k:05d}\t{100 * k}\t0.1\t0.2\t9.8\t.01\t.02\t.03\t" + "\t".join((*place, "1", "2", "3"))
        for k, place in enumerate(places)
    ]
    path.write_text("\n".join([names, *rows]) + "\n")
    log = read(path)
    assert len(log.imu) == 200
    assert log.gnss is None
    assert log.reference.v_eb_e is None or not np.abs(log.reference.v_eb_e).max() > 1.0
    llh = frames.llh_from_ecef(log.reference.r_eb_e)
    np.testing.assert_allclose(log.reference.t, 0.01 * np.arange(5, 200), rtol=0.0, atol=1e-9)
    np.testing.assert_allclose(np.rad2deg(llh[:, 0]), 48.0 + 1e-6 * np.arange(5, 200), rtol=0.0, atol=1e-9)
    np.testing.assert_allclose(llh[:, 2], 300.5, rtol=0.0, atol=1e-6)
    assert any("the sensor's own solution" in note for note in log.metadata.notes)
    path.write_text(path.read_text().replace("\t48.000150\t9.1\t300.5\t", "\t\t\t\t"))
    log = read(path)  # the IMU is complete where a place is not
    assert log.reference is None
    assert len(log.imu) == 200


def test_text_export(tmp_path):
    """Columns by their names; the fine clock where it is exported, else the counter at the header's rate."""
    path = tmp_path / "MT_01.txt"
    counts = [(65530 + k) % 65536 for k in range(200)]
    end = "0\t0\t0"
    rows = [f"{n:05d}\t\t0.1\t0.2\t9.8\t.01\t.02\t{0.03 + k / 1000}\t{end}" for k, n in enumerate(counts)]
    path.write_text(TEXT + "\n" + "\n".join(rows) + "\n")
    imu = read(path).imu
    np.testing.assert_allclose(imu.t, np.arange(200) / 100, rtol=0.0, atol=1e-9)
    np.testing.assert_allclose(imu.accel[0], (0.1, -0.2, -9.8))
    np.testing.assert_allclose(imu.gyro[7], (0.01, -0.02, -0.037))
    path.write_text(TEXT + "\n" + "\n".join(r.replace("\t\t", f"\t{100 * k}\t") for k, r in enumerate(rows)) + "\n")
    np.testing.assert_allclose(read(path).imu.t, np.arange(200) / 100, rtol=0.0, atol=1e-9)
    path.write_text(TEXT + "\n" + "\n".join(r.replace("\t\t", "\t") for r in rows) + "\n")
    with pytest.raises(FileFormatError, match="which is which"):
        read(path)
    path.write_text((TEXT + "\n" + "\n".join(rows) + "\n").replace("// Update Rate: 100.0Hz\n", ""))
    with pytest.raises(InputError, match="rate"):
        read(path)
    path.write_text(TEXT.replace("Gyr_Z", "Gyr_W") + "\n" + "\n".join(rows) + "\n")
    with pytest.raises(FileFormatError, match="Gyr_Z"):
        read(path)


def test_hints_streams_and_damage(run, tmp_path):
    path = log_of(run, tmp_path / "log.mtb")
    with pytest.raises(InputError, match="one of delta"):
        read(path, streams="imu=raw")
    with pytest.raises(InputError, match="no IMU output 'hr'"):
        read(path, streams="imu=hr")
    with pytest.raises(InputError, match="leave out"):
        read(path, units="g,deg/s")
    streams = {s.name: s for s in registry.module("xsens").contents(path)}
    assert streams["rates"].rate_hz == pytest.approx(50.0)
    assert streams["GnssPvtData"].part == "gnss"
    assert read(path, time="local").imu.t[0] == pytest.approx(7.0)
    assert read(path, series="imu").reference is None
    data = bytearray(path.read_bytes())
    data[200] ^= 1
    path.write_bytes(bytes(data[:-4]))
    back = read(path)
    assert len(run.imu) - 3 <= len(back.imu) <= len(run.imu) - 2
    assert any("no message with a right checksum" in note for note in back.metadata.notes)
    path.write_bytes(xs.message(b"", 0x30) * 3)
    with pytest.raises(FileFormatError, match="MTData2"):
        read(path, format="xsens")


@pytest.mark.parametrize("delimiter", [",", ";"])
def test_text_with_commas_and_another_header(tmp_path, delimiter):
    """Newer exports separate by commas and begin with lines of their own."""
    path = tmp_path / "a.csv"
    names = "PacketCounter,SampleTimeFine,Acc_X,Acc_Y,Acc_Z,Gyr_X,Gyr_Y,Gyr_Z,Status"
    rows = [f"{k},{100 * k},0.1,0.2,9.8,.01,.02,0.03,0" for k in range(100)]
    text = "\n".join(["DeviceTag:,mt,", names, *rows, ""]).replace(",", delimiter)
    path.write_text(text)
    imu = read(path).imu
    np.testing.assert_allclose(imu.t, np.arange(100) / 100, rtol=0.0, atol=1e-9)
    np.testing.assert_allclose(imu.gyro[0], (0.01, -0.02, -0.03))


def test_text_of_a_dot(tmp_path):
    """A Movella DOT counts microseconds and exports deg/s under the same names."""
    path = tmp_path / "dot.csv"
    names = "PacketCounter,SampleTimeFine,Acc_X,Acc_Y,Acc_Z,Gyr_X,Gyr_Y,Gyr_Z"
    rows = [f"{k},{192856375 + 16667 * k},0.1,0.2,9.8,1.0,2.0,3.0" for k in range(100)]
    path.write_text("\n".join([names, *rows, ""]))
    back = read(path)
    assert np.median(np.diff(back.imu.t)) == pytest.approx(0.016667, abs=1e-9)
    np.testing.assert_allclose(back.imu.gyro[0], np.radians((1.0, -2.0, -3.0)))
    assert any("Movella DOT" in note for note in back.metadata.notes)
