"""PX4 logs made by an encoder of the tests: values, clocks, old and new fields, choices, damage."""

import struct
from pathlib import Path

import numpy as np
import pytest
import ulog_encoder as encoder

from schuler import rotation
from schuler.exceptions import FileFormatError, InputError
from schuler.recording.formats import px4
from schuler.recording.io import read
from schuler.timebase import TimeBase

pytest.importorskip("pyulog")

UTC = 1_700_000_000.0  # in GPS week 2288
TOW = UTC - 315_964_800.0 + 18.0 - 2288 * 604_800.0
BOOT = 25.0
DELAYS = (0.15, 0.11, 0.12, 0.14, 0.13)
Q = rotation.quat_from_rpy(np.radians((1.5, -2.5, 30.0)))

TOPICS = {
    "sensor_combined": "uint64_t timestamp;float[3] gyro_rad;uint32_t gyro_integral_dt;"
    "int32_t accelerometer_timestamp_relative;float[3] accelerometer_m_s2;uint32_t accelerometer_integral_dt",
    "vehicle_imu": "uint64_t timestamp;uint64_t timestamp_sample;float[3] delta_angle;float[3] delta_velocity;"
    "uint16_t delta_angle_dt;uint16_t delta_velocity_dt",
    "sensor_gyro": "uint64_t timestamp;uint64_t timestamp_sample;float temperature;float x;float y;float z",
    "sensor_accel": "uint64_t timestamp;uint64_t timestamp_sample;float temperature;float x;float y;float z",
    "sensor_gps": "uint64_t timestamp;uint64_t timestamp_sample;double latitude_deg;double longitude_deg;"
    "double altitude_msl_m;double altitude_ellipsoid_m;float s_variance_m_s;uint8_t fix_type;float eph;float epv;"
    "float vel_n_m_s;float vel_e_m_s;float vel_d_m_s;bool vel_ned_valid;int32_t timestamp_time_relative;"
    "uint64_t time_utc_usec;uint8_t satellites_used;float hdop;float vdop",
    "vehicle_gps_position": "uint64_t timestamp;uint64_t time_utc_usec;int32_t lat;int32_t lon;int32_t alt;"
    "int32_t alt_ellipsoid;float s_variance_m_s;float eph;float epv;float vel_n_m_s;float vel_e_m_s;float vel_d_m_s;"
    "int32_t timestamp_time_relative;uint8_t fix_type;bool vel_ned_valid;uint8_t satellites_used",
    "vehicle_air_data": "uint64_t timestamp;uint64_t timestamp_sample;float baro_alt_meter",
    "vehicle_global_position": "uint64_t timestamp;uint64_t timestamp_sample;double lat;double lon;float alt;"
    "float alt_ellipsoid",
    "vehicle_attitude": "uint64_t timestamp;uint64_t timestamp_sample;float[4] q",
    "vehicle_local_position": "uint64_t timestamp;uint64_t timestamp_sample;float vx;float vy;float vz",
    "logger_status": "uint64_t timestamp;float write_rate_kb_s",
}
GYRO, FORCE = (0.01, -0.02, 0.03), (0.1, 0.2, -9.79)


def us(t: float) -> int:
    return round(t * 1e6)


def flight(
    *, gps: tuple[str, ...] = ("vehicle_gps_position",), seconds: float = 10.0,
    imu: tuple[str, ...] = ("sensor_combined",), fix: int = 3, valid: bool = True, ellipsoidal: bool = True,
    extra: bool = True, decimate: int = 1, before: bool = False, lost: tuple[int, ...] = (),
) -> bytes:  # fmt: skip
    timed: list[tuple[float, str, dict]] = []
    for k in range(int(seconds * 100)):
        t, stamp = BOOT + 0.01 * k, {"timestamp": us(BOOT + 0.01 * k)}
        both = stamp | {"timestamp_sample": us(t - 0.0002)}
        if "sensor_combined" in imu:
            more = {"gyro_rad": GYRO, "accelerometer_m_s2": FORCE, "gyro_integral_dt": 10_000,
                    "accelerometer_timestamp_relative": 0x7FFFFFFF if k in lost else 0}  # fmt: skip
            timed.append((t, "sensor_combined", stamp | more))
        if "vehicle_imu" in imu and k % decimate == 0:
            more = {"delta_angle": [0.01 * w for w in GYRO], "delta_velocity": [0.01 * f for f in FORCE],
                    "delta_angle_dt": 10_000, "delta_velocity_dt": 10_000}  # fmt: skip
            timed.append((t, "vehicle_imu", both | more))
        if "sensor_gyro" in imu:
            timed.append((t, "sensor_gyro", both | {"temperature": 41.5, "x": 0.01, "y": -0.02, "z": 0.03}))
            late = {"timestamp": us(t + 0.001), "timestamp_sample": us(t + 0.0008)}
            timed.append((t, "sensor_accel", late | {"x": 0.001 * k, "y": 0.2, "z": -9.79}))
        if extra and k % 10 == 0:
            place = {"lat": 47.0, "lon": 8.0, "alt": 412.0, "alt_ellipsoid": 461.5}
            timed.append((t, "vehicle_global_position", both | place))
            timed.append((t, "vehicle_attitude", both | {"q": list(Q)}))
            timed.append((t, "vehicle_local_position", both | {"vx": 1.0, "vy": 2.0, "vz": -0.5}))
            timed.append((t, "vehicle_air_data", both | {"baro_alt_meter": 410.0 + k}))
            timed.append((t, "logger_status", stamp | {"write_rate_kb_s": 55.0}))
    for k in range(int(seconds * 5)):
        t = BOOT + 0.2 * k + DELAYS[k % 5]
        common = {
            "timestamp": us(t), "fix_type": fix, "eph": 0.6, "epv": 0.9, "s_variance_m_s": 0.25, "vel_n_m_s": 4.0,
            "vel_e_m_s": 3.0, "vel_d_m_s": -0.5, "vel_ned_valid": valid, "time_utc_usec": us(UTC + 0.2 * (k - before)),
            "timestamp_time_relative": -us(0.2 + DELAYS[k % 5] - DELAYS[(k - 1) % 5]) if before else 900,
            "satellites_used": 17,
        }  # fmt: skip
        h = 461.55 if ellipsoidal else 0.0
        if "sensor_gps" in gps:
            new = {
                "latitude_deg": 47.0 + 1e-6 * k,
                "longitude_deg": 8.0,
                "altitude_msl_m": 412.0,
                "altitude_ellipsoid_m": h,
            }
            timed.append((t, "sensor_gps", common | new | {"timestamp_sample": us(t), "hdop": 0.75, "vdop": 1.25}))
        if "vehicle_gps_position" in gps:
            old = {"lat": 470_000_000 + 10 * k, "lon": 80_000_000, "alt": 412_000, "alt_ellipsoid": round(h * 1000)}
            timed.append((t, "vehicle_gps_position", common | old))
    timed.sort(key=lambda entry: entry[0])
    used = {name for _, name, _ in timed}
    instances = {name: (name, 0) for name in TOPICS if name in used}
    return encoder.ulog({n: TOPICS[n] for n in instances}, [(n, v) for _, n, v in timed], instances)


def written(tmp_path: Path, **options) -> Path:
    path = tmp_path / "log.ulg"
    path.write_bytes(flight(**options))
    return path


@pytest.mark.parametrize("topic", ["vehicle_gps_position", "sensor_gps"])
def test_values_and_times(tmp_path, topic):
    recording = read(written(tmp_path, gps=(topic,)))
    imu, gnss = recording.imu, recording.gnss
    assert recording.metadata.time == TimeBase("gps", 2288 * 604_800.0)
    np.testing.assert_allclose(imu.gyro[3], GYRO, rtol=1e-7)  # float32
    np.testing.assert_allclose(imu.accel[3], FORCE, rtol=1e-7)
    np.testing.assert_allclose(gnss.t, TOW + 0.2 * np.arange(50), atol=1e-6)
    # means over 10 ms belong 5 ms before their stamps; the clocks are related by the fastest fix
    np.testing.assert_allclose(imu.t, TOW + 0.01 * np.arange(1000) - 0.11 - 0.005, atol=2e-6)
    np.testing.assert_allclose(gnss.received - gnss.t, np.tile(DELAYS, 10) - 0.11, atol=2e-6)
    np.testing.assert_allclose(np.degrees(gnss.llh[7, :2]), (47.000007, 8.0), atol=1e-10)
    np.testing.assert_allclose(gnss.llh[:, 2], 461.55, atol=1e-9)
    np.testing.assert_allclose(gnss.v_n[0], (4.0, 3.0, -0.5))
    np.testing.assert_allclose(np.sqrt(np.diagonal(gnss.cov_r_n[0])), (0.6, 0.6, 0.9), rtol=1e-7)
    np.testing.assert_allclose(np.sqrt(np.diagonal(gnss.cov_v_n[0])), 0.25, rtol=1e-7)
    assert set(gnss.quality) == {5}
    assert set(gnss.n_satellites) == {17}
    if topic == "sensor_gps":
        np.testing.assert_array_equal(gnss.dop, [[0.75, 1.25]] * len(gnss))  # exact in float32
    else:  # of a firmware that does not log them
        assert gnss.dop is None


def test_samples_without_a_specific_force_are_left_out(tmp_path):
    recording = read(written(tmp_path, lost=(0, 5, 999)))
    assert len(recording.imu) == 997
    assert "imu: 3 samples without a valid specific force were left out." in recording.metadata.notes
    with pytest.raises(FileFormatError, match="no sample has a valid specific force"):
        read(written(tmp_path, lost=tuple(range(1000))))


def test_the_time_of_the_fix_before_is_moved_on(tmp_path):
    """Receivers that send the time in a message of its own: it came 0.2 s and a bit before the fix."""
    gnss = read(written(tmp_path, before=True)).gnss
    # right but for the difference of the two delays, at most 0.04 s
    np.testing.assert_allclose(gnss.t, TOW + 0.2 * np.arange(50), atol=0.041)


def test_the_autopilots_estimate_is_the_reference(tmp_path):
    recording = read(written(tmp_path))
    np.testing.assert_allclose(np.degrees(recording.reference.rpy_nb[5]), (1.5, -2.5, 30.0), atol=1e-5)
    np.testing.assert_allclose(recording.reference.v_eb_n[5], (1.0, 2.0, -0.5), atol=1e-9)
    np.testing.assert_allclose(recording.reference.llh[:, 2], 461.5, atol=1e-8)
    assert any("not a truth" in note for note in recording.metadata.notes)
    assert read(tmp_path / "log.ulg", streams="reference=none").reference is None


def test_increments_that_follow_each_other_and_those_that_do_not(tmp_path):
    every = read(written(tmp_path, imu=("vehicle_imu",)))
    assert every.imu.kind == "increment"
    np.testing.assert_allclose(every.imu.rates().gyro[9], GYRO, rtol=1e-6)
    np.testing.assert_allclose(np.diff(every.imu.t), 0.01, atol=2e-6)
    some = read(written(tmp_path, imu=("vehicle_imu",), decimate=4))
    assert some.imu.kind == "rate"
    np.testing.assert_allclose(some.imu.accel[9], FORCE, rtol=1e-6)
    assert some.imu.t[0] == pytest.approx(every.imu.t[0] - 0.005, abs=2e-6)
    assert any("not all were logged" in note for note in some.metadata.notes)


def test_single_sensors_are_brought_to_the_gyros_stamps(tmp_path):
    path = written(tmp_path, imu=("sensor_combined", "sensor_gyro"))
    assert read(path).imu.temperature is None  # PX4's choice is taken unasked
    recording = read(path, streams="imu=sensor_gyro:0", time="local")
    k = (recording.imu.t - BOOT - 0.0008) / 0.01
    np.testing.assert_allclose(recording.imu.accel[:, 0], 0.001 * k, atol=1e-6)  # a ramp
    assert recording.imu.temperature[0] == 41.5


def test_heights_above_sea_level_need_the_geoid(tmp_path):
    path = written(tmp_path, ellipsoidal=False)
    with pytest.raises(FileFormatError, match="give height='msl'"):
        read(path)
    recording = read(path, height="msl", geoid_separation=48.0)
    np.testing.assert_allclose(recording.gnss.llh[:, 2], 460.0)
    np.testing.assert_allclose(recording.reference.llh[:, 2], 460.0)


def test_invalid_velocities_and_missing_fixes(tmp_path):
    recording = read(written(tmp_path, valid=False))
    np.testing.assert_allclose(np.diagonal(recording.gnss.cov_v_n[0]), 1e6)
    with pytest.raises(FileFormatError, match="no message has a three-dimensional fix"):
        read(written(tmp_path, fix=0))
    alone = read(tmp_path / "log.ulg", streams="gnss=none")
    assert alone.metadata.time == TimeBase("local")
    np.testing.assert_allclose(alone.imu.t[0], BOOT - 0.005)
    assert any("Nothing relates" in note for note in alone.metadata.notes)


def test_the_barometer_needs_an_accuracy(tmp_path):
    path = written(tmp_path)
    assert read(path).height is None
    np.testing.assert_allclose(read(path, sigma_height=0.5).height.value[:2], (410.0, 420.0))


def test_contents_and_hints(tmp_path):
    path = written(tmp_path, imu=("sensor_combined", "vehicle_imu"))
    listed = {s.name: s for s in px4.contents(path)}
    assert listed["vehicle_imu:0"].rate_hz == pytest.approx(100.0)
    assert listed["logger_status:0"].part == ""
    assert listed["vehicle_air_data:0"].part == "height"
    with pytest.raises(InputError, match="'sensor_gyro:3' is not in the log; candidates for imu: sensor_combined:0"):
        read(path, streams="imu=sensor_gyro:3")
    with pytest.raises(InputError, match="leave out units"):
        read(path, units="g,deg/s")


def test_a_cut_log_is_read_up_to_the_cut(tmp_path):
    """A ULog has no end to miss: PX4 leaves such logs whenever power is cut."""
    path = written(tmp_path, seconds=4.0)
    whole = path.read_bytes()
    path.write_bytes(whole[: len(whole) * 3 // 4])
    assert 200 < len(read(path).imu) < 350
    path.write_bytes(whole[:300])
    with pytest.raises(FileFormatError, match="no messages of the topics that are read"):
        read(path)
    path.write_bytes(whole[:10])
    with pytest.raises(FileFormatError, match="cannot be read as a PX4 log"):
        read(path)


@pytest.mark.parametrize(
    "formats",
    [
        {"a": "uint64_t timestamp;a again"},
        {"a": "b[60000] x", "b": "c[60000] x", "c": "uint64_t[60000] x"},
        {"a": "nothing x"},
    ],
)
def test_formats_that_cannot_be_are_refused_before_anything_is_made_of_them(tmp_path, formats):
    import tracemalloc

    path = tmp_path / "bad.ulg"
    records = [encoder.record("F", f"{name}:{text};".encode()) for name, text in formats.items()]
    records.append(encoder.record("A", struct.pack("<BH", 0, 0) + b"a"))
    path.write_bytes(encoder.header() + b"".join(records))
    tracemalloc.start()
    with pytest.raises(FileFormatError):
        read(path)
    assert tracemalloc.get_traced_memory()[1] < 2e7
    tracemalloc.stop()
