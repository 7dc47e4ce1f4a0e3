"""VectorNav logs: an encoder of the test's own, real lines of a VN-200, what is refused."""

import encode_vectornav as vn
import numpy as np
import pytest
from format_drives import WEEK, drive, same_trajectory

from schuler import units
from schuler.exceptions import FileFormatError, InputError
from schuler.recording.formats import registry
from schuler.recording.formats.vectornav_packets import load
from schuler.recording.io import read
from schuler.timebase import WEEK_S

NS = 1_000_000_000


def ns_of(t):
    """Nanoseconds of GPS time of a time of the drive's week."""
    return WEEK * int(WEEK_S) * NS + round(t * 1e9)


@pytest.fixture(scope="module")
def run():
    return drive()


def log_of(run, path, *, every=1):
    """A drive as one kind of packet, fixes repeated until the next, and INS packets of another kind."""
    out = []
    g, r = run.gnss, run.reference
    for k in range(0, len(run.imu), every):
        t = run.imu.t[k]
        fix = int(np.searchsorted(g.t, t + 1e-6)) - 1
        out.append(vn.packet(
            TimeStartup=round(t * 1e9) - 7 * NS, TimeGps=ns_of(t),
            UncompAccel=tuple(run.imu.accel[k]), UncompGyro=tuple(run.imu.gyro[k]), Temp=21.5,
            FixTow=round(g.t[fix] * 1e9), FixWeek=WEEK, NumSats=14, Fix=8,
            FixLla=(*(g.llh[fix, :2] / units.DEG), g.llh[fix, 2]), FixVel=tuple(g.v_n[fix]),
            FixPosU=tuple(np.sqrt(np.diag(g.cov_r_n[fix]))), FixVelU=0.05,
        ))  # fmt: skip
        roll, pitch, yaw = r.rpy_nb[k] / units.DEG
        out.append(vn.packet(
            TimeGps=ns_of(t), Ypr=(yaw, pitch, roll), Position=(*(r.llh[k, :2] / units.DEG), r.llh[k, 2]),
            Velocity=tuple(r.v_eb_n[k]), InsStatus=0x6,
        ))  # fmt: skip
    path.write_bytes(b"".join(out))
    return path


def test_whole_log_comes_back(run, tmp_path):
    """Times to the nanosecond, positions to float64, the rest to float32 (6e-8 of its size)."""
    back = read(log_of(run, tmp_path / "vn.bin"))
    assert back.metadata.time.epoch_gps_s == WEEK * WEEK_S
    np.testing.assert_allclose(back.imu.t, run.imu.t, rtol=0.0, atol=1e-9)
    np.testing.assert_allclose(back.imu.accel, run.imu.accel, rtol=1e-7)
    np.testing.assert_allclose(back.imu.gyro, run.imu.gyro, rtol=1e-7)
    np.testing.assert_array_equal(back.imu.temperature, 21.5)
    np.testing.assert_allclose(back.gnss.t, run.gnss.t, rtol=0.0, atol=1e-9)
    np.testing.assert_allclose(back.gnss.llh, run.gnss.llh, rtol=1e-14)
    np.testing.assert_allclose(back.gnss.v_n, run.gnss.v_n, rtol=1e-7, atol=1e-9)
    variances = np.einsum("nii->ni", run.gnss.cov_r_n)
    np.testing.assert_allclose(np.einsum("nii->ni", back.gnss.cov_r_n), variances, rtol=3e-7)
    np.testing.assert_allclose(back.gnss.cov_v_n[:, 0, 0], 0.0025, rtol=1e-6)
    assert set(back.gnss.quality) == {1}
    same_trajectory(back.reference, run.reference, t=1e-9, r=1e-8, v=1e-6, q=2e-7)


def test_sdk_lengths(tmp_path):
    """Fields that are not read are passed over by their lengths; a wrong one would break the checksum."""
    path = tmp_path / "vn.bin"
    one = {"Quaternion": (0, 0, 0, 1), "Imu": (0, 0, -9.81, 1e-3, 0, 0), "MagPres": (1, 2, 3, 20.5, 100),
           "TimeStatus": 7, "ImuStatus": 0, "VpeStatus": 0, "Dcm": (0,) * 9}  # fmt: skip
    path.write_bytes(b"".join(vn.packet(**one | {"TimeStartup": 5 * NS + k * 10_000_000}) for k in range(200)))
    back = read(path)
    assert back.metadata.time.scale == "local"
    np.testing.assert_allclose(back.imu.t, 5.0 + 0.01 * np.arange(200), rtol=0.0, atol=1e-9)
    np.testing.assert_allclose(back.imu.accel[7], (0, 0, -9.81), rtol=1e-7)
    assert back.imu.temperature[0] == 20.5


def test_outputs_of_the_imu(tmp_path):
    """Uncompensated before increments before compensated; each by name."""
    path = tmp_path / "vn.bin"
    one = {"Accel": (0, 0, -9.81), "AngularRate": (0.5, 0, 0), "Imu": (0, 0, -9.80, 0.4, 0, 0)}
    one["Deltas"] = (0.01, 0.3, 0, 0, 0, 0, -0.0982)
    rows = [vn.packet(TimeGps=ns_of(0.01 * k), **one) for k in range(1, 300)]
    path.write_bytes(b"".join(rows))
    assert read(path).imu.accel[0, 2] == pytest.approx(-9.80)
    assert read(path, streams="imu=compensated").imu.gyro[0, 0] == pytest.approx(0.5)
    delta = read(path, streams="imu=delta").imu
    assert delta.kind == "increment"
    np.testing.assert_allclose(delta.gyro[0], (0.3 * units.DEG, 0, 0), rtol=1e-6)
    np.testing.assert_allclose(delta.accel[0], (0, 0, -0.0982), rtol=1e-6)
    with pytest.raises(InputError, match="uncompensated"):
        read(path, streams="imu=raw")
    path.write_bytes(b"".join(vn.packet(TimeGps=ns_of(0.01 * k), Accel=(0, 0, -9.81), AngularRate=(0, 0, 0))
                              for k in range(1, 300)))  # fmt: skip
    assert any("bias estimates off" in note for note in read(path).metadata.notes)
    with pytest.raises(InputError, match="no delta"):
        read(path, streams="imu=delta")


def test_time_not_yet_known(tmp_path):
    """Packets before the sensor knew GPS time are left out, unless its own clock is asked for."""
    path = tmp_path / "vn.bin"
    rows = [vn.packet(TimeStartup=k * 10_000_000, TimeGps=k * 10_000_000 if k < 100 else ns_of(0.01 * k),
                      Imu=(0, 0, -9.8, 0, 0, 0)) for k in range(1, 300)]  # fmt: skip
    path.write_bytes(b"".join(rows))
    back = read(path)
    assert len(back.imu) == 200
    assert any("99 messages before" in note for note in back.metadata.notes)
    assert len(read(path, time="local").imu) == 299
    week = [vn.packet(GpsTow=round(((604_799.5 + 0.01 * k) % 604_800) * 1e9), GpsWeek=WEEK + (k >= 50),
                      Imu=(0, 0, -9.8, 0, 0, 0)) for k in range(200)]  # fmt: skip
    path.write_bytes(b"".join(week))
    np.testing.assert_allclose(np.diff(read(path).imu.t), 0.01, rtol=0.0, atol=1e-9)


def test_lines(tmp_path):
    """INS and GPS lines on GPS time; both kinds of checksum; VNIMU beside them has no time."""
    path = tmp_path / "vn.txt"
    out = []
    for k in range(20):
        tow = 345600.0 + 0.25 * k
        out.append(vn.line(f"VNINS,{tow:.6f},{WEEK},0006,+090.000,+002.000,-001.000,+48.00000000,+008.00000000,+00400.123,"
                           "+001.000,+002.000,-000.500,01.0,01.5,0.05", long=k % 2 == 1))  # fmt: skip
        out.append(vn.line(f"VNGPS,{tow:.6f},{WEEK},3,12,+48.00000000,+008.00000000,+00401.000,+001.000,+002.000,-000.500,"
                           "+002.0,+003.0,+004.0,+0.500,2.0E-08"))  # fmt: skip
        out.append(vn.line("VNIMU,-00.2382,+00.7281,+00.2867,+00.099,-00.017,-09.637,+00.005113,+00.000607,-00.008175,"
                           "+26.8,+096.559"))  # fmt: skip
    path.write_bytes(b"".join(out))
    back = read(path)
    np.testing.assert_allclose(back.reference.rpy_nb[0] / units.DEG, (-1.0, 2.0, 90.0), atol=1e-9)
    np.testing.assert_allclose(back.reference.v_eb_n[0], (1.0, 2.0, -0.5), atol=1e-12)
    assert back.reference.llh[0, 2] == pytest.approx(400.123)
    np.testing.assert_allclose(np.sqrt(np.diag(back.gnss.cov_r_n[0])), (2.0, 3.0, 4.0))
    np.testing.assert_allclose(np.sqrt(np.diag(back.gnss.cov_v_n[0])), 0.5)
    assert back.gnss.t[0] == 345600.0
    assert back.imu is None
    assert any("has no time" in note for note in back.metadata.notes)
    alone = read(path, series="imu", rate=40.0, allow="norm")
    np.testing.assert_allclose(alone.imu.accel[0], (0.099, -0.017, -9.637))
    assert alone.imu.temperature[0] == 26.8
    with pytest.raises(InputError, match="rate"):
        read(path, series="imu")


def test_unreadable_packets(tmp_path):
    """Fields of unknown length are counted, not guessed; one packet in a large file is chance."""
    path = tmp_path / "vn.bin"
    path.write_bytes(vn.packet(Ypr=(1, 2, 3)) * 20)
    with pytest.raises(FileFormatError, match="without them"):
        read(path)
    path.write_bytes(vn.packet(TimeGps=1, RawMeas=b"x" * 12) * 3)
    with pytest.raises(FileFormatError, match="no fixed length"):
        read(path, format="vectornav")
    rng = np.random.default_rng(1)
    noise = rng.integers(0, 256, 65536, dtype=np.uint8).tobytes()
    assert not registry.module("vectornav").sniff(noise, path)


def test_ins_modes(tmp_path):
    """Packets of an INS that is not tracking are left out; quaternions have their scalar last."""
    path = tmp_path / "vn.bin"
    half = np.sqrt(0.5)
    path.write_bytes(b"".join(
        vn.packet(TimeGps=ns_of(k), Quaternion=(0, 0, half, half), InsLla=(48.0, 8.0, 400.0), InsVel=(1, 2, 3),
                  Ins=mode, InsPosU=1.5) for k, mode in enumerate((0, 1, 2, 3))
    ))  # fmt: skip
    back = read(path)
    np.testing.assert_allclose(back.reference.t, (2.0, 3.0), rtol=0.0, atol=1e-9)
    np.testing.assert_allclose(back.reference.rpy_nb[0] / units.DEG, (0, 0, 90), atol=1e-5)
    assert any("1.5 m" in note for note in back.metadata.notes)


def test_hints_damage_and_contents(run, tmp_path):
    path = log_of(run, tmp_path / "vn.bin", every=4)
    with pytest.raises(InputError, match="leave out"):
        read(path, units="g,deg/s")
    with pytest.raises(InputError, match="leave out rate"):
        read(path, rate=50.0)
    streams = registry.module("vectornav").contents(path)
    assert [s.part for s in streams] == ["imu", "reference"]
    assert streams[0].rate_hz == pytest.approx(12.5)
    good = path.read_bytes()
    data = bytearray(good)
    data[30] ^= 1
    path.write_bytes(bytes(data[:-3]))
    back = read(path)
    assert len(back.imu) == len(next(c["temp"] for c in load(path).columns.values() if "temp" in c))
    assert any("bytes belong to no packet" in note for note in back.metadata.notes)
    assert read(path, streams="gnss=none,reference=none").gnss is None


@pytest.mark.campaign
@pytest.mark.realdata
def test_real_lines_of_a_vn200(shared_data):
    """Two static recordings of VNIMU lines: gravity to the sensor's 3 %, all but damaged lines read."""
    for unit in (0, 1):
        path = shared_data / "vn200_ratetable" / f"static_z-_z+_IMU{unit}.csv"
        back = read(path, rate=50.0)
        with path.open("rb") as stream:
            lines = sum(1 for _ in stream)
        assert len(back.imu) > 0.98 * lines  # the serial line lost or added characters in one of sixty
        assert np.median(np.linalg.norm(back.imu.accel, axis=1)) == pytest.approx(9.81, rel=0.03)
        assert np.abs(np.median(back.imu.gyro, axis=0)).max() < 0.02


@pytest.mark.parametrize(
    ("time", "triads", "delimiter"),
    [
        ("TimeStartup,GpsTow,GpsWeek", "UncompAcc{0},UncompGyro{0}", ","),
        ("Time.TimeStartup [ns],Time.GpsTow [ns],Time.GpsWeek",
         "Imu.UncompAccel.{0} [m/s^2],Imu.UncompGyro.{0} [rad/s]", ";"),
        ("Time Startup (ns),Gps Tow (ns),Gps Week", "Accel_{0} (m/s/s),Angular Rate_{0} (deg/s)", ","),
    ],
)  # fmt: skip
def test_csv(run, tmp_path, time, triads, delimiter):
    """Columns in any order by their names and units, on GPS time where the table has it."""
    path = tmp_path / "vn.csv"
    parts = [[part.format(axis) for axis in "XYZ"] for part in triads.split(",")]
    names = [*time.split(","), *parts[1], "Pressure", *parts[0]]
    scale = 1.0 / units.DEG if "deg/s" in triads else 1.0
    rows = []
    for k in range(300):
        t = run.imu.t[k]
        w, f = run.imu.gyro[k] * scale, run.imu.accel[k]
        rows.append([round(t * 1e9) - 7 * NS, round(t * 1e9), WEEK, *map(repr, map(float, w)), 101.3,
                     *map(repr, map(float, f))])  # fmt: skip
    path.write_text("\n".join(delimiter.join(map(str, row)) for row in [names, *rows]) + "\n")
    back = read(path)
    np.testing.assert_allclose(back.imu.t, run.imu.t[:300], rtol=0.0, atol=1e-9)
    np.testing.assert_allclose(back.imu.accel, run.imu.accel[:300], rtol=0.0, atol=1e-14)
    np.testing.assert_allclose(back.imu.gyro, run.imu.gyro[:300], rtol=0.0, atol=1e-15)
    assert back.metadata.time.epoch_gps_s == WEEK * WEEK_S
    assert read(path, time="local").metadata.time.scale == "local"


def test_csv_refused(tmp_path):
    """A unit the sensor does not have; a table of somebody else is not claimed."""
    path = tmp_path / "vn.csv"
    names = "TimeStartup,UncompAccX [g],UncompAccY [g],UncompAccZ [g],UncompGyroX,UncompGyroY,UncompGyroZ"
    path.write_text(names + "\n1,2,3,4,5,6,7\n")
    with pytest.raises(FileFormatError, match=r"vn\.csv:1: UncompAccX \[g\]: expected m/s\^2"):
        read(path)
    vectornav = registry.module("vectornav")
    for line in (
        b"t,ax,ay,az,gx,gy,gz\n", b"time,accel_x,accel_y,accel_z,gyro_x,gyro_y,gyro_z\n1,2,3,4,5,6,7\n",
        b"timestamp,acc_x [g],acc_y [g],acc_z [g],gyr_x [dps],gyr_y [dps],gyr_z [dps]\n",
    ):  # fmt: skip
        assert not vectornav.sniff(line, path)
