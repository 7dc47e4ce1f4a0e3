"""ROS bags and MCAP: written, read by rosbags and mcap; written by them, read; chosen, refused, fuzzed."""

import json
import shutil
import struct
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from schuler import frames, rotation
from schuler.exceptions import FileFormatError, InputError
from schuler.recording import GnssSeries, ImuSeries, Metadata, OdometerSeries, Recording, Trajectory
from schuler.recording.formats import mcap, ros_messages, ros_recording, rosbag
from schuler.recording.io import read, write
from schuler.recording.io.hints import ReadHints
from schuler.timebase import TimeBase

pytest.importorskip("rosbags")
STORES = (("a.mcap", {}), ("b.rosbag2", {}), ("c.rosbag2", {"storage": "mcap"}))
WEEK = 2374 * 604_800.0
LEAPS = 18
UNIX = 315_964_800  # of the GPS epoch


@pytest.fixture(scope="module")
def drive() -> Recording:
    rng = np.random.default_rng(41)
    n, k = 400, 20
    t = 259_200.0 + np.round(np.cumsum(rng.uniform(0.008, 0.012, n)), 6)
    imu = ImuSeries(t, 0.01 * rng.standard_normal((n, 3)), 0.01 * rng.standard_normal((n, 3)) - (0.0, 0.0, 9.8))
    A = rng.standard_normal((2, k, 3, 3))
    cov = 0.01 * (A @ np.swapaxes(A, 2, 3) + np.eye(3))
    llh = np.stack((np.linspace(0.69, 0.6901, k), np.linspace(-1.83, -1.8299, k), rng.uniform(900, 910, k)), axis=1)
    t_g = 259_200.0 + 0.25 * np.arange(k)
    gnss = GnssSeries(t_g, llh, cov[0], rng.standard_normal((k, 3)), cov[1], np.tile((5, 4, 3, 5), 5), np.full(k, 11))
    q = rng.standard_normal((k, 4))
    C_nb = rotation.dcm_from_quat(q / np.linalg.norm(q, axis=1, keepdims=True))
    reference = Trajectory.from_geodetic(t_g, llh, rng.standard_normal((k, 3)), C_nb)
    odometer = OdometerSeries(t[::10], rng.uniform(-1, 20, 40), rng.uniform(0.01, 0.2, 40))
    return Recording(imu, gnss, odometer, reference, Metadata(name="drive", time=TimeBase("gps", WEEK)))


def assert_same(a: Recording, b: Recording) -> None:
    # stamps are whole nanoseconds; doubles pass unchanged but for rounding of angles, squares and turns
    assert b.metadata.time == a.metadata.time
    assert np.abs(b.imu.t - a.imu.t).max() < 1e-9
    np.testing.assert_array_equal(b.imu.gyro, a.imu.gyro)
    np.testing.assert_array_equal(b.imu.accel, a.imu.accel)
    np.testing.assert_allclose(b.gnss.llh, a.gnss.llh, rtol=3e-16)
    np.testing.assert_allclose(b.gnss.cov_r_n, a.gnss.cov_r_n, rtol=1e-14, atol=1e-16)
    np.testing.assert_array_equal(b.gnss.v_n, a.gnss.v_n)
    np.testing.assert_allclose(b.gnss.cov_v_n, a.gnss.cov_v_n, rtol=1e-14, atol=1e-16)
    np.testing.assert_array_equal(b.gnss.quality, a.gnss.quality)
    np.testing.assert_array_equal(b.odometer.speed, a.odometer.speed)
    np.testing.assert_allclose(b.odometer.sigma, a.odometer.sigma, rtol=1e-15)
    assert np.abs(b.reference.r_eb_e - a.reference.r_eb_e).max() < 2e-8  # rounding of 6.4e6 m
    assert np.abs(b.reference.v_eb_e - a.reference.v_eb_e).max() < 1e-13
    assert np.abs(np.abs(np.sum(b.reference.q_eb * a.reference.q_eb, axis=1)) - 1.0).max() < 1e-14


@pytest.mark.parametrize(("name", "options"), STORES)
def test_round_trip(drive, tmp_path, name, options):
    files = write(drive, tmp_path / name, **options)
    assert all(file.exists() for file in files)
    assert_same(drive, read(tmp_path / name))
    assert sorted(p.name for p in tmp_path.iterdir()) == [name]  # nothing temporary is left


def test_increments_are_written_as_rates_where_they_hold(tmp_path):
    """Of a rate that grows linearly the mean over an interval is the rate in its middle, exactly."""
    t = 5.0 + 0.01 * np.arange(1, 301)
    rate = np.outer(t - 0.005, (0.01, -0.02, 0.03))
    force = np.tile((0.0, 0.0, -9.8), (300, 1))
    increments = ImuSeries(t, 0.01 * rate, 0.01 * force, "increment")
    write(Recording(imu=increments), tmp_path / "x.mcap")
    back = read(tmp_path / "x.mcap").imu
    np.testing.assert_allclose(back.t, t - 0.005, atol=1e-9)
    np.testing.assert_allclose(back.gyro, np.outer(back.t, (0.01, -0.02, 0.03)), atol=1e-9)


def test_a_local_clock_stays_local(drive, tmp_path):
    local = replace(drive.shifted(-259_190.0), metadata=Metadata(name="x", time=TimeBase("local")))
    write(local, tmp_path / "x.mcap")
    back = read(tmp_path / "x.mcap")
    assert back.metadata.time == TimeBase("local")
    np.testing.assert_allclose(back.imu.t, local.imu.t, atol=1e-9)


def test_a_level_body_that_heads_north_has_ros_yaw_of_ninety_degrees(tmp_path):
    """REP 103: yaw counts from east over north."""
    from rosbags.highlevel import AnyReader

    still = Trajectory.from_geodetic([1.0, 2.0], [[0.7, 0.2, 100.0]] * 2, [[3.0, 0.0, 0.0]] * 2, [np.eye(3)] * 2)
    write(Recording(reference=still), tmp_path / "r.rosbag2")
    with AnyReader([tmp_path / "r.rosbag2"]) as reader:
        message = next(reader.deserialize(r, c.msgtype) for c, _, r in reader.messages() if c.topic != "/schuler")
    q = message.pose.pose.orientation
    np.testing.assert_allclose(np.abs([q.w, q.x, q.y, q.z]), [0.5**0.5, 0, 0, 0.5**0.5], atol=1e-12)
    assert q.w * q.z > 0.0
    assert message.twist.twist.linear.x == pytest.approx(3.0, abs=1e-12)


# ------------------------------------------------------------------------------- written by others


def imu_fields(t: float, store, kind) -> object:
    """An Imu message of rosbags, FLU, at rest."""
    T = store.types
    v = T["geometry_msgs/msg/Vector3"]
    sec, ns = divmod(round(t * 1e9), 10**9)
    stamp = T["builtin_interfaces/msg/Time"](sec, ns)
    header = T["std_msgs/msg/Header"]
    head = header(stamp=stamp, frame_id="imu", **({"seq": 3} if kind == "ros1" else {}))
    zero = np.zeros(9)
    return T["sensor_msgs/msg/Imu"](
        head, T["geometry_msgs/msg/Quaternion"](0.0, 0.0, 0.0, 1.0), zero, v(0.01, 0.02, 0.03), zero,
        v(0.1, 0.2, 9.8), zero,
    )  # fmt: skip


@pytest.fixture(params=["none", "lz4", "bz2"])
def bag1(tmp_path, request) -> Path:
    from rosbags.rosbag1 import Writer
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS1_NOETIC)
    path = tmp_path / "one.bag"
    writer = Writer(path)
    if request.param != "none":
        writer.set_compression(Writer.CompressionFormat[request.param.upper()])
    with writer:
        connection = writer.add_connection("/imu", "sensor_msgs/msg/Imu", typestore=store)
        text = writer.add_connection("/chatter", "std_msgs/msg/String", typestore=store)
        for k in range(300):
            t = 1_700_000_000.0 + 0.01 * k
            raw = store.serialize_ros1(imu_fields(t, store, "ros1"), "sensor_msgs/msg/Imu")
            writer.write(connection, round(t * 1e9) + 500_000, raw)
        message = store.types["std_msgs/msg/String"]("hello")
        writer.write(text, round(t * 1e9), store.serialize_ros1(message, "std_msgs/msg/String"))
    return path


def test_a_bag_of_ros1(bag1):
    recording = read(bag1)
    assert len(recording.imu) == 300
    np.testing.assert_allclose(recording.imu.accel[5], (0.1, -0.2, -9.8), rtol=1e-15)
    np.testing.assert_allclose(recording.imu.gyro[5], (0.01, -0.02, -0.03), rtol=1e-15)
    # 1700000000 is 2023-11-14 22:13:20 UTC, in GPS week 2288
    gps = 1_700_000_000 - UNIX + LEAPS
    assert recording.metadata.time == TimeBase("gps", 2288 * 604_800.0)
    np.testing.assert_allclose(recording.imu.t, gps - 2288 * 604_800 + 0.01 * np.arange(300), atol=1e-6)
    streams = {s.name: s for s in rosbag.contents(bag1)}
    assert streams["/imu"].count == 300
    assert streams["/imu"].part == "imu"
    assert streams["/imu"].rate_hz == pytest.approx(100.0)
    assert streams["/chatter"].kind == "std_msgs/String"


def test_two_imus_are_asked_about(tmp_path):
    path = tmp_path / "two.mcap"
    json_mcap(path, ("/front", "/rear"))
    with pytest.raises(InputError, match=r"several streams can be the imu: /front .*streams='imu=/front'"):
        read(path)
    assert read(path, streams="imu=/rear").metadata.notes[0].startswith("imu: /rear")
    with pytest.raises(InputError, match="'/top' is not in the log; candidates for imu: /front"):
        read(path, streams="imu=/top")
    with pytest.raises(FileFormatError, match="no topic of an IMU"):
        read(path, streams="imu=none")


def json_mcap(path: Path, topics: tuple[str, ...] = ("/imu",), n: int = 50, compression: str = "none") -> None:
    """Imu messages as JSON, as Foxglove bridges log them, written by the mcap library."""
    library = pytest.importorskip("mcap.writer")
    with path.open("wb") as stream:
        writer = library.Writer(stream, chunk_size=4096, compression=library.CompressionType[compression.upper()])
        writer.start(profile="", library="test")
        schema = writer.register_schema("sensor_msgs/Imu", "jsonschema", b"{}")
        channels = [writer.register_channel(t, "json", schema) for t in topics]
        axes = ("x", "y", "z")
        for k in range(n):
            ns = 1_700_000_000 * 10**9 + k * 10**7
            message = {
                "header": {"stamp": {"sec": ns // 10**9, "nsec": ns % 10**9}, "frame_id": "imu"},
                "orientation": {"x": 0, "y": 0, "z": 0, "w": 1}, "orientation_covariance": [0] * 9,
                "angular_velocity": dict(zip(axes, (0.01, 0.02, 0.03), strict=True)),
                "angular_velocity_covariance": [0] * 9,
                "linear_acceleration": dict(zip(axes, (0.1, 0.2, 9.8), strict=True)),
                "linear_acceleration_covariance": [0] * 9,
            }  # fmt: skip
            for channel in channels:
                writer.add_message(channel, ns, json.dumps(message).encode(), ns)
        writer.finish()


@pytest.mark.parametrize("compression", ["none", "lz4", "zstd"])
def test_mcap_of_json_messages(tmp_path, compression):
    json_mcap(tmp_path / "j.mcap", compression=compression)
    recording = read(tmp_path / "j.mcap")
    np.testing.assert_allclose(recording.imu.accel, np.tile((0.1, -0.2, -9.8), (50, 1)), rtol=1e-15)
    assert recording.imu.rate_hz == pytest.approx(100.0, rel=1e-6)


def test_messages_equal_rosbags_own_for_every_type():
    """Every layout against the serialiser of rosbags, CDR and ROS 1, with texts of odd lengths."""
    from rosbags.typesys import Stores, get_typestore

    for kind, layout in ros_messages.LAYOUTS.items():
        if kind == "std_msgs/String":
            continue
        name = kind.replace("/", "/msg/")
        for stores, encoding in ((Stores.ROS2_HUMBLE, "cdr"), (Stores.ROS1_NOETIC, "ros1")):
            store = get_typestore(stores)
            for frame in ("", "a", "base", "left_imu"):
                count = iter(range(1, 200))
                message = filled(store, name, frame, count)
                raw = bytes(
                    store.serialize_cdr(message, name) if encoding == "cdr" else store.serialize_ros1(message, name)
                )
                decoded = ros_messages.decode(kind, [raw, raw], [1, 2], encoding, "/t", Path("x"))
                for field, form in layout:
                    if form in ("header", "string"):
                        continue
                    value = message
                    for part in field.split("."):
                        value = value[int(part)] if part.isdigit() else getattr(value, part)
                    assert (decoded.values[field] == value).all(), (kind, encoding, field)
                assert decoded.stamp_ns[1] == message.header.stamp.sec * 10**9 + message.header.stamp.nanosec
                assert decoded.texts.get("header.frame_id", [""]) == [frame]
                if encoding == "cdr":
                    again = ros_messages.encode(kind, decoded.stamp_ns, decoded.values, texts_of(layout, frame))[0]
                    assert raw.startswith(again)  # but for padding at the end
                    assert not any(raw[len(again) :])


def texts_of(layout, frame):
    texts = {"header.frame_id": frame}
    return texts | {name: frame for name, form in layout if form == "string"}


def filled(store, name, frame, count):
    """A message of a type with different numbers in all its fields."""
    fields = store.get_msgdef(name).fields if hasattr(store, "get_msgdef") else store.fielddefs[name][1]
    values = {}
    for field, (kind, what) in fields:
        if kind == 1:  # a basic type
            basic = what[0] if isinstance(what, tuple) else what
            values[field] = frame if basic == "string" else float(next(count)) if "float" in basic else next(count)
        elif kind == 2:
            values[field] = filled(store, what, frame, count)
        else:
            length = what[1]
            values[field] = np.array([float(next(count)) for _ in range(length)])
    return store.types[name](**values)


# --------------------------------------------------------------------------------- what is in them


def bag_of(tmp_path: Path, topics: dict[str, tuple[str, np.ndarray, dict, str]]) -> Path:
    """A bag of ROS 2 with messages of our encoder, which the tests above compare with that of rosbags."""
    from rosbags.rosbag2 import StoragePlugin, Writer
    from rosbags.typesys import Stores, get_typestore

    store, path = get_typestore(Stores.ROS2_HUMBLE), tmp_path / "made"
    with Writer(path, version=9, storage_plugin=StoragePlugin.SQLITE3) as writer:
        for topic, (kind, ns, values, frame) in topics.items():
            connection = writer.add_connection(topic, kind.replace("/", "/msg/"), typestore=store)
            texts = {"header.frame_id": frame, "child_frame_id": "body"}
            layout = dict(ros_messages.LAYOUTS[kind])
            texts = {k: v for k, v in texts.items() if k in layout or k == "header.frame_id"}
            for stamp, raw in zip(ns, ros_messages.encode(kind, ns, values, texts), strict=True):
                writer.write(connection, int(stamp) + 10**6, raw)
    return path


NS = 1_700_000_000 * 10**9 + np.arange(40) * 10**8
FIX = {
    "latitude": 48.0, "longitude": 11.0, "altitude": 560.0 + np.arange(40), "position_covariance.0": 1.0,
    "position_covariance.4": 4.0, "position_covariance.8": 9.0, "position_covariance_type": 2,
}  # fmt: skip
REST = {"linear_acceleration.z": 9.8, "linear_acceleration.x": 0.01}


def test_fixes_without_fix_and_without_covariance(tmp_path):
    status = np.where(np.arange(40) % 4 == 0, -1, 0)
    path = bag_of(tmp_path, {"/fix": ("sensor_msgs/NavSatFix", NS, {**FIX, "status.status": status}, "gps")})
    recording = read(path)
    assert len(recording.gnss) == 30
    assert "gnss: 10 messages without a fix were left out." in recording.metadata.notes
    np.testing.assert_allclose(np.diagonal(recording.gnss.cov_r_n[0]), (4.0, 1.0, 9.0))
    assert recording.gnss.llh[0, 2] == 561.0
    shutil.rmtree(path)
    unknown = bag_of(tmp_path, {"/fix": ("sensor_msgs/NavSatFix", NS, {**FIX, "position_covariance_type": 0}, "gps")})
    with pytest.raises(FileFormatError, match="expected a positive 1-sigma of position, got 0: say sigma"):
        read(unknown)
    np.testing.assert_allclose(np.diagonal(read(unknown, sigma="1,2,3").gnss.cov_r_n[0]), (1.0, 4.0, 9.0))
    high = read(unknown, sigma="1,2,3", height="msl", geoid_separation=46.0)
    assert high.gnss.llh[0, 2] == 560.0 + 46.0


def test_a_velocity_topic_joins_the_fixes(tmp_path):
    twist = {"twist.twist.linear.x": 3.0, "twist.twist.linear.y": 4.0, "twist.twist.linear.z": 0.5,
             "twist.covariance.0": 0.01, "twist.covariance.7": 0.04, "twist.covariance.14": 0.09}  # fmt: skip
    topics = {
        "/fix": ("sensor_msgs/NavSatFix", NS, FIX, "gps"),
        "/fix_velocity": ("geometry_msgs/TwistWithCovarianceStamped", NS[:30], twist, "gps"),
        "/cmd": ("geometry_msgs/TwistStamped", NS[:10] + 4 * 10**7, {}, "base"),
    }
    path = bag_of(tmp_path, topics)
    assert read(path).gnss.v_n is None  # a twist may be anything; it is taken when named
    recording = read(path, streams="velocity=/fix_velocity")
    np.testing.assert_allclose(recording.gnss.v_n[0], (4.0, 3.0, -0.5))
    np.testing.assert_allclose(np.diagonal(recording.gnss.cov_v_n[0]), (0.04, 0.01, 0.09))
    np.testing.assert_allclose(np.diagonal(recording.gnss.cov_v_n[35]), 1e6)
    assert any("10 fixes have none" in note for note in recording.metadata.notes)
    with pytest.raises(FileFormatError, match="only 0 of 40 fixes have a velocity of the same stamp"):
        read(path, streams="velocity=/cmd")


def test_poses_become_a_reference_when_the_origin_is_said(tmp_path):
    pose = {"pose.position.x": 10.0, "pose.position.y": 20.0, "pose.position.z": 5.0, "pose.orientation.w": 1.0}
    topics = {
        "/imu": ("sensor_msgs/Imu", NS, REST, "imu"),
        "/pose": ("geometry_msgs/PoseStamped", NS, pose, "map"),
    }
    path = bag_of(tmp_path, topics)
    recording = read(path)
    assert recording.reference is None
    assert any("Poses were not read: /pose" in note for note in recording.metadata.notes)
    with pytest.raises(InputError, match="say where its zero is, origin="):
        read(path, streams="reference=/pose")
    recording = read(path, streams="reference=/pose", origin="48,11,560")
    ned = frames.ned_from_ecef(recording.reference.r_eb_e, np.array((*np.radians((48.0, 11.0)), 560.0)))
    np.testing.assert_allclose(ned, np.tile((20.0, 10.0, -5.0), (40, 1)), atol=1e-8)
    # no turn in ROS is facing east; at 10 m east north is turned by a microradian
    np.testing.assert_allclose(recording.reference.rpy_nb[0], (0.0, 0.0, np.pi / 2), atol=1e-5)
    with pytest.raises(InputError, match="holds 40 messages of geometry_msgs/PoseStamped; candidates for imu: /imu"):
        read(path, streams="imu=/pose")


def test_a_damaged_pose_is_refused_without_a_warning(tmp_path):
    pose = {"pose.position.x": np.where(np.arange(40) == 7, np.inf, 10.0), "pose.orientation.w": 1.0}
    path = bag_of(tmp_path, {"/pose": ("geometry_msgs/PoseStamped", NS, pose, "map")})
    with pytest.raises(FileFormatError, match="row 8"):
        read(path, streams="reference=/pose", origin="48,11,560")
    shutil.rmtree(path)
    pose = {"pose.orientation.w": np.where(np.arange(40) == 7, 1.3, 1.0)}
    path = bag_of(tmp_path, {"/pose": ("geometry_msgs/PoseStamped", NS, pose, "map")})
    with pytest.raises(FileFormatError, match=r"reference 8: expected a unit quaternion, got norm 1\.3; is the topic"):
        read(path, streams="reference=/pose", origin="48,11,560")


def test_an_empty_channel_of_the_same_topic_is_passed_over(tmp_path):
    """Containers may open a topic twice; a damaged one counts the same name for a channel without messages."""
    raw = ros_messages.encode("sensor_msgs/Imu", NS, REST, {"header.frame_id": "imu"})
    full = ros_recording.Topic("/imu", "sensor_msgs/Imu", "cdr", True, list(raw), NS.tolist())
    empty = ros_recording.Topic("/imu", "sensor_msgs/Imu", "cdr", True)
    path = tmp_path / "a.mcap"
    path.touch()
    for topics in ([full, empty], [empty, full]):
        assert len(ros_recording.recording_of(path, topics, ReadHints(), [], "a bag").imu) == len(NS)


def test_a_twist_as_odometer(tmp_path):
    twist = {"twist.linear.x": np.linspace(0, 5, 40)}
    topics = {"/imu": ("sensor_msgs/Imu", NS, REST, "imu"), "/wheel": ("geometry_msgs/TwistStamped", NS, twist, "base")}
    path = bag_of(tmp_path, topics)
    with pytest.raises(FileFormatError, match="sigma_speed"):
        read(path, streams="odometer=/wheel")
    recording = read(path, streams="odometer=/wheel", sigma_speed=0.1)
    np.testing.assert_allclose(recording.odometer.speed, np.linspace(0, 5, 40))


def test_headers_without_stamps_fall_back_on_the_times_of_recording(tmp_path):
    path = bag_of(tmp_path, {"/imu": ("sensor_msgs/Imu", NS, {**REST, "sec": 0, "nanosec": 0}, "imu")})
    recording = read(path)
    assert any("no stamps" in note for note in recording.metadata.notes)
    assert recording.imu.t[1] - recording.imu.t[0] == pytest.approx(0.1)


def test_wrong_hints_are_refused(tmp_path):
    path = bag_of(tmp_path, {"/imu": ("sensor_msgs/Imu", NS, REST, "imu")})
    for options, message in (
        ({"units": "g,deg/s"}, "says this itself; leave out units"),
        ({"time": "gps-tow:2374"}, "stamps of ROS are unix, gps-unix or local"),
        ({"streams": "imu"}, "expected PART=STREAM"),
        ({"streams": "imu=/a,imu=/b"}, "named more than once"),
        ({"streams": "imo=/a"}, "did you mean 'imu'"),
        ({"origin": "48,11"}, "origin: expected latitude"),
        ({"origin": "148,11,0"}, "origin: expected latitude"),
    ):
        with pytest.raises(InputError, match=message):
            read(path, **options)
    assert read(path, time="gps-unix").imu.t[0] == read(path).imu.t[0] - LEAPS
    assert read(path, axes="FRD", allow="norm").imu.accel[0, 2] == 9.8


def test_acceleration_in_g_is_found_out(tmp_path):
    path = bag_of(tmp_path, {"/imu": ("sensor_msgs/Imu", NS, {"linear_acceleration.z": 1.0}, "imu")})
    with pytest.raises(FileFormatError, match="look like g"):
        read(path)


def test_a_bag_is_not_written_over_and_nothing_is_left_behind(drive, tmp_path):
    write(drive, tmp_path / "b.rosbag2")
    with pytest.raises(InputError, match="exists"):
        write(drive, tmp_path / "b.rosbag2")
    early = replace(drive, imu=drive.imu.shifted(-3e9))
    with pytest.raises(InputError, match="not negative"):
        write(early, tmp_path / "c.mcap")
    assert sorted(p.name for p in tmp_path.iterdir()) == ["b.rosbag2"]
    with pytest.raises(InputError, match=r"option of \.mcap"):
        write(drive, tmp_path / "d.mcap", colour=1)
    with pytest.raises(InputError, match="storage"):
        write(drive, tmp_path / "d.rosbag2", storage="bag")


# --------------------------------------------------------------------------------------- damaged


def test_a_cut_mcap_is_refused_with_the_byte_or_read_up_to_it(tmp_path):
    json_mcap(tmp_path / "j.mcap", n=300)
    whole = (tmp_path / "j.mcap").read_bytes()
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(whole[: len(whole) // 2])
    with pytest.raises(FileFormatError, match=r"cut off or is damaged at byte \d+ of \d+: pass allow='truncated'"):
        read(cut)
    recording = read(cut, allow="truncated")
    assert 0 < len(recording.imu) < 300
    assert any("what stands before was read" in note for note in recording.metadata.notes)


@pytest.mark.parametrize("size", [2**31, 2**63 - 1, 2**64 - 1])
def test_sizes_that_mcap_claims_are_checked_first(tmp_path, size):
    import tracemalloc

    header = struct.pack("<BQ", 1, 8) + bytes(8)
    claims = (
        mcap.MAGIC + header + struct.pack("<BQ", 5, size) + bytes(100),
        mcap.MAGIC + header + struct.pack("<BQ", 6, 60) + struct.pack("<QQQI", 0, 0, size, 0)
        + struct.pack("<I4s", 4, b"zstd") + struct.pack("<Q", 16) + bytes(8),
        mcap.MAGIC + header + struct.pack("<BQ", 6, 60) + struct.pack("<QQQI", 0, 0, size, 0)
        + struct.pack("<I", 0) + struct.pack("<Q", min(size, 2**63)) + bytes(20),
    )  # fmt: skip
    for data in claims:
        path = tmp_path / "claim.mcap"
        path.write_bytes(data)
        tracemalloc.start()
        with pytest.raises(FileFormatError):
            read(path)
        assert tracemalloc.get_traced_memory()[1] < 2e7
        tracemalloc.stop()


@pytest.mark.parametrize("size", [21, 200, 2**40])
def test_a_record_beyond_its_chunk_is_refused(tmp_path, size):
    """The chunk is whole, a message in it claims more than is left (or less than its own head)."""
    inner = struct.pack("<BQ", 5, size) + bytes(50)
    chunk = struct.pack("<QQQI", 0, 0, len(inner), 0) + struct.pack("<I", 0) + struct.pack("<Q", len(inner)) + inner
    path = tmp_path / "x.mcap"
    path.write_bytes(mcap.MAGIC + struct.pack("<BQ", 1, 8) + bytes(8) + struct.pack("<BQ", 6, len(chunk)) + chunk)
    with pytest.raises(FileFormatError, match="the record at byte 25 is damaged"):
        read(path)


def test_sizes_that_a_ros1_bag_claims_are_checked_first(tmp_path):
    import tracemalloc

    path = tmp_path / "claim.bag"
    for data in (
        rosbag.MAGIC + struct.pack("<I", 2**32 - 1) + bytes(50),
        rosbag.MAGIC + struct.pack("<I", 9) + struct.pack("<I", 5) + b"op=\x03\x00" + struct.pack("<I", 2**31),
        rosbag.MAGIC + struct.pack("<I", 8) + struct.pack("<I", 2**31) + b"op=\x03" + struct.pack("<I", 0),
    ):
        path.write_bytes(data)
        tracemalloc.start()
        with pytest.raises(FileFormatError, match="damaged at byte 13"):
            read(path)
        assert tracemalloc.get_traced_memory()[1] < 2e7
        tracemalloc.stop()


def test_a_cut_bag_of_ros1_is_refused(bag1):
    whole = bag1.read_bytes()
    bag1.write_bytes(whole[: len(whole) * 2 // 3])
    with pytest.raises(FileFormatError, match="cut off or is damaged"):
        read(bag1)
    bag1.write_bytes(b"#ROSBAG V1.2\n" + whole[13:])
    with pytest.raises(FileFormatError, match="only version 2"):
        read(bag1)


def test_a_message_that_is_not_what_its_type_says(tmp_path):
    raw = ros_messages.encode("sensor_msgs/Imu", NS[:1], {}, {"header.frame_id": "imu"})[0]
    for bad in (raw[:-60], raw + bytes(60), b"\x00\x00" + raw[2:], raw[:12] + b"\xff\xff\xff\x7f" + raw[16:], b""):
        with pytest.raises(FileFormatError, match=r"/t: message 1 of \d+ bytes is no sensor_msgs/Imu"):
            ros_messages.decode("sensor_msgs/Imu", [bad], [0], "cdr", "/t", Path("x"))


@pytest.mark.parametrize("stamp", [None, 2**70, "late"])
def test_a_message_without_a_time_of_the_log_is_refused(stamp):
    """Tables of a damaged rosbag2 file hold what they hold."""
    with pytest.raises(FileFormatError, match="/t: a message has no time at which it was logged"):
        ros_messages.decode("sensor_msgs/Imu", [b"", b""], [0, stamp], "cdr", "/t", Path("x"))
