"""DataFlash logs of ArduPilot made by an encoder of the tests: values, clocks, heights, choices, damage."""

import sys
from pathlib import Path

import dataflash_encoder as encoder
import numpy as np
import pytest

from schuler.exceptions import FileFormatError, InputError
from schuler.recording.formats import ardupilot, dataflash
from schuler.recording.io import read
from schuler.timebase import TimeBase

message = encoder.message

WEEK, TOW = 2288, 252_000.0
BOOT = 40.0  # GPS time TOW is this many seconds after the board was switched on
NAMES = ("IMU", "GPS", "GPA", "BARO", "ATT", "POS", "XKF1", "MSG")
DELAYS = (0.20, 0.13, 0.15, 0.18, 0.16)  # of the fixes behind their time of validity [s]


def us(seconds: float) -> int:
    return round(seconds * 1e6)


def messages(
    *, seconds: float = 20.0, imus: int = 1, accuracy: str = "GPA", ppm: float = 0.0, status: int = 6, baro: bool = True
) -> list[bytes]:
    """A board that stands level and heads 30 degrees while its fixes move north-east."""
    timed = []
    for k in range(int(seconds * 50)):
        t = BOOT + k / 50
        for i in range(imus):
            body = message("IMU", us(t), i, 0.01, -0.02, 0.03, 0.1, 0.2 + i, -9.79, 0, 0, 35.5)
            timed.append((t, body))
        if k % 5 == 0 and baro:
            timed.append((t + 0.001, message("BARO", us(t + 0.001), 0, 12.5 + k, 95_000.0, 21.5)))
        if k % 2 == 0:
            timed.append((t + 0.002, message("ATT", us(t + 0.002), 0, 1.5, 0, -2.5, 0, 30.0)))
            timed.append((t + 0.003, message("POS", us(t + 0.003), 47.0, 8.0 + 1e-6 * k, 412.0)))
            timed.append((t + 0.003, message("XKF1", us(t + 0.003), 0, 1.5, -2.5, 30.0, 1.0, 2.0, -0.5)))
    for k in range(int(seconds * 5)):
        gps = TOW + k / 5
        t = BOOT + (k / 5) * (1.0 + ppm * 1e-6) + DELAYS[k % 5]
        fix = (us(t + 0.01), 0, status, round(gps * 1000), WEEK, 17, 0.8, 47.0 + 1e-6 * k, 8.0, 412.0, 5.0, 36.87, -0.5)
        timed.append((t, message("GPS", *fix, 0.0, 1)))
        if accuracy:
            last = 461.55 if accuracy == "GPA" else -49.55
            timed.append((t, message(accuracy, us(t + 0.01), 0, 1.1, 0.6, 0.9, 0.25, 0, 1, round(t * 1000), 200, last)))
    timed.append((BOOT, message("MSG", us(BOOT), b"ArduCopter V4.5.1")))
    return [body for _, body in sorted(timed, key=lambda pair: pair[0])]


def written(tmp_path: Path, *, names: tuple[str, ...] = NAMES, name: str = "1.bin", **options) -> Path:
    path = tmp_path / name
    path.write_bytes(encoder.log(messages(**options), names))
    return path


def test_values_and_times(tmp_path):
    recording = read(written(tmp_path))
    imu, gnss = recording.imu, recording.gnss
    assert recording.metadata.time == TimeBase("gps", WEEK * 604_800.0)
    assert len(imu) == 1000
    # float32 fields
    np.testing.assert_allclose(imu.gyro[3], (0.01, -0.02, 0.03), rtol=1e-7)
    np.testing.assert_allclose(imu.accel[3], (0.1, 0.2, -9.79), rtol=1e-7)
    assert imu.temperature[0] == 35.5
    np.testing.assert_allclose(gnss.t, TOW + 0.2 * np.arange(100), atol=1e-9)
    # the fastest fix, 0.13 s, is the one by which the clocks are related: stamps are early by it
    np.testing.assert_allclose(imu.t, TOW + 0.02 * np.arange(1000) - 0.13, atol=1.1e-3)
    np.testing.assert_allclose(gnss.received - gnss.t, np.tile(DELAYS, 20) - 0.13, atol=1.1e-3)
    np.testing.assert_allclose(np.degrees(gnss.llh[7, :2]), (47.000007, 8.0), atol=1e-7)
    np.testing.assert_allclose(gnss.v_n[0], (4.0, 3.0, -0.5), atol=1e-4)
    np.testing.assert_allclose(np.sqrt(np.diagonal(gnss.cov_r_n[0])), (0.6, 0.6, 0.9), rtol=1e-12)
    np.testing.assert_allclose(np.sqrt(np.diagonal(gnss.cov_v_n[0])), (0.25, 0.25, 0.25), rtol=1e-12)
    assert set(gnss.quality) == {1}
    assert set(gnss.n_satellites) == {17}
    np.testing.assert_allclose(gnss.dop, [[0.8, 1.1]] * 100, rtol=1e-15)  # HDop of GPS, VDop of GPA; rounding
    assert any("fastest message counts as not delayed" in note for note in recording.metadata.notes)


def test_heights_are_made_ellipsoidal_by_the_log_or_by_a_hint(tmp_path):
    by_ael = read(written(tmp_path, accuracy="GPA"))
    np.testing.assert_allclose(by_ael.gnss.llh[:, 2], 461.55, atol=1e-9)
    by_und = read(written(tmp_path, names=(*NAMES[:2], "GPAU", *NAMES[3:]), accuracy="GPAU"))
    # "height that WGS84 is above AMSL": -49.55 m where the geoid is 49.55 m above the ellipsoid
    np.testing.assert_allclose(by_und.gnss.llh[:, 2], 461.55, atol=1e-5)
    bare = written(tmp_path, accuracy="")
    with pytest.raises(FileFormatError, match="does not say the geoid's separation"):
        read(bare, sigma="1,1,2,0.1,0.1,0.2")
    stated = read(bare, sigma="1,1,2,0.1,0.1,0.2", height="msl", geoid_separation=48.0)
    np.testing.assert_allclose(stated.gnss.llh[:, 2], 460.0)
    np.testing.assert_allclose(stated.reference.llh[:, 2], 460.0)
    with pytest.raises(FileFormatError, match="there is no accuracy of position"):
        read(bare, height="msl", geoid_separation=48.0)


def test_the_autopilots_estimate_is_the_reference(tmp_path):
    recording = read(written(tmp_path))
    reference = recording.reference
    assert len(reference) > 490
    np.testing.assert_allclose(np.degrees(reference.rpy_nb[9]), (1.5, -2.5, 30.0), atol=1e-9)
    np.testing.assert_allclose(reference.v_eb_n[9], (1.0, 2.0, -0.5), atol=1e-7)
    np.testing.assert_allclose(reference.llh[:, 2], 461.55, atol=1e-6)
    assert any("not a truth" in note for note in recording.metadata.notes)
    assert read(tmp_path / "1.bin", streams="reference=none").reference is None


def test_the_rate_of_the_clock_is_found_on_longer_logs(tmp_path):
    recording = read(written(tmp_path, seconds=200.0, ppm=80.0, baro=False), streams="reference=none")
    np.testing.assert_allclose(recording.gnss.t, TOW + 0.2 * np.arange(1000), atol=1e-9)
    # a fix 180 s in is stamped 14 ms late by the fast clock; mapped back it is within the fixes' milliseconds
    delays = np.tile(DELAYS, 200)
    np.testing.assert_allclose(recording.gnss.received - recording.gnss.t, delays - 0.13, atol=1.5e-3)
    (note,) = [n for n in recording.metadata.notes if "ppm" in n]
    assert "(-80." in note or "(-79." in note


def test_a_log_without_fixes_keeps_its_own_clock(tmp_path):
    path = written(tmp_path, status=1)
    with pytest.raises(FileFormatError, match="no epoch has a three-dimensional fix"):
        read(path)
    recording = read(path, streams="gnss=none")
    assert recording.metadata.time == TimeBase("local")
    np.testing.assert_allclose(recording.imu.t[0], BOOT)
    with pytest.raises(FileFormatError, match="no fixes relate"):
        read(path, streams="gnss=none", time="gps")
    local = read(written(tmp_path), time="local")
    assert local.metadata.time == TimeBase("local")
    np.testing.assert_allclose(local.gnss.t[0], BOOT + DELAYS[0], atol=1e-3)  # as it came in


def test_several_imus_are_asked_about(tmp_path):
    path = written(tmp_path, imus=2)
    with pytest.raises(InputError, match=r"several streams can be the imu: IMU:0 .*IMU:1 .*streams='imu=IMU:0'"):
        read(path)
    np.testing.assert_allclose(read(path, streams="imu=IMU:1").imu.accel[:, 1], 1.2, rtol=1e-6)
    listed = {s.name: s for s in ardupilot.contents(path)}
    assert listed["IMU:1"].count == 1000
    assert listed["IMU:0"].rate_hz == pytest.approx(50.0)
    assert listed["GPS:0"].part == "gnss"
    assert listed["MSG"].count == 1


def test_unfiltered_samples_are_brought_to_the_gyros_stamps(tmp_path):
    body = []
    for k in range(400):
        t, t_a = 10.0 + k / 400, 10.0004 + k / 400
        body.append(message("GYR", us(t), 0, us(t), 0.01, 0.0, 0.1))
        body.append(message("ACC", us(t_a), 0, us(t_a), 0.001 * k, 0.0, -9.8))
    path = tmp_path / "raw.bin"
    path.write_bytes(encoder.log(body, ("ACC", "GYR")))
    recording = read(path, time="local", streams="imu=ACC+GYR:0")
    # a linear ramp is interpolated exactly, to the microseconds of the stamps
    k = (recording.imu.t - 10.0004) * 400
    np.testing.assert_allclose(recording.imu.accel[:, 0], 0.001 * k, atol=1e-6)
    assert len(recording.imu) == 399


def test_the_barometer_needs_an_accuracy(tmp_path):
    path = written(tmp_path)
    assert read(path).height is None
    height = read(path, sigma_height=0.5).height
    np.testing.assert_allclose(height.value[:3], (12.5, 17.5, 22.5))
    assert set(height.sigma) == {0.5}


def test_hints_without_meaning_are_refused(tmp_path):
    path = written(tmp_path)
    with pytest.raises(InputError, match="leave out kind, units"):
        read(path, units="m/s,rad", kind="increment")
    with pytest.raises(InputError, match="time='gps'"):
        read(path, time="unix")
    # axes of a board that is mounted backwards, which the autopilot was not told
    np.testing.assert_allclose(read(path, axes="BLD").imu.accel[0], (-0.1, -0.2, -9.79), rtol=1e-6)


def test_a_cut_log_and_stray_bytes_are_read_with_notes(tmp_path):
    path = written(tmp_path)
    whole = path.read_bytes()
    path.write_bytes(whole[:-5])
    notes = read(path).metadata.notes
    assert "The last message is incomplete, as where the power is cut; it was left out." in notes
    path.write_bytes(whole[:3000] + b"\x00\xa3\x95\xff" * 10 + whole[3000:])
    # 3000 is inside of a message, which is lost with the stray bytes
    assert any("bytes that belong to no message" in note for note in read(path).metadata.notes)
    path.write_bytes(whole[:3000] + bytes(len(whole) // 20) + whole[3000:])
    with pytest.raises(FileFormatError, match="belong to no message: the log is damaged"):
        read(path)


def test_old_logs_have_numbers_in_names(tmp_path, monkeypatch):
    old = {
        "IMU": (133, "Qffffff", "TimeUS,GyrX,GyrY,GyrZ,AccX,AccY,AccZ"),
        "IMU2": (134, "Qffffff", "TimeUS,GyrX,GyrY,GyrZ,AccX,AccY,AccZ"),
    }
    monkeypatch.setattr(encoder, "MESSAGES", encoder.MESSAGES | old)
    body = [
        message(name, us(1 + k / 50), 0, 0, 0, 0, f, -9.8) for k in range(100) for name, f in (("IMU", 0), ("IMU2", 1))
    ]
    path = tmp_path / "old.bin"
    path.write_bytes(encoder.log(body, ("IMU", "IMU2")))
    np.testing.assert_allclose(read(path, streams="imu=IMU:1").imu.accel[:, 1], 1.0)


def test_pymavlink_reads_the_same(tmp_path):
    """The encoder against ArduPilot's own reader, and that against ours."""
    module = pytest.importorskip("pymavlink.DFReader", reason="pymavlink (LGPL, large) is not among the test extras")
    path = written(tmp_path, seconds=2.0)
    log = dataflash.load(path)
    reader = module.DFReader_binary(str(path))
    rows: dict[str, list] = {}
    while (m := reader.recv_msg()) is not None:
        rows.setdefault(m.get_type(), []).append(m)
    assert {n: len(r) for n, r in rows.items() if n != "FMT"} == {n: log.count(n) for n in log.places if n != "FMT"}
    for name in ("IMU", "GPS", "GPA", "ATT", "POS", "BARO"):
        for field, values in log.columns(name).items():
            np.testing.assert_allclose(values, [getattr(m, field) for m in rows[name]], rtol=1e-12, err_msg=field)
    reader.close()
    sys.stderr.flush()
