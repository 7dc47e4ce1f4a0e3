"""MCAP files and a Foxglove server of a live run: read back by the mcap library, by our own reader, by a client."""

import contextlib
import json
import math
import socket
import struct
import threading
import time
from dataclasses import replace

import numpy as np
import pytest
from format_drives import drive
from tests.live.test_outputs import solution

import schuler
from schuler import frames
from schuler.exceptions import InputError
from schuler.live.clock import SourceClock
from schuler.live.messages import Event, Heading, Height, Speed
from schuler.live.playback import messages
from schuler.live.publishing import FoxgloveServer, McapFile, Publisher, open_publisher
from schuler.live.topics import Topics, odometry_of
from schuler.recording.formats import mcap
from schuler.recording.series import ImuSeries
from schuler.timebase import TimeBase

WEEK = TimeBase("gps", 2300 * 604_800.0)
LONGEST_S = 20.0


@pytest.fixture
def port():
    with socket.socket() as s:
        s.bind(("127.0.0.1", 0))
        return s.getsockname()[1]


def published(publisher, recording):
    """Give a publisher what a run over a recording gives it; the number of messages."""
    count = 0
    publisher.event(Event(math.nan, "source", "wire: connected"))
    for _, message in messages(recording, 0.02):
        publisher.message(message)
        count += 1
    publisher.raw(0, b"\xb5\x62")
    publisher.raw(0, b"\x01\x07")
    for k in range(3):
        publisher.solution(solution(recording.imu.t[0] + k, 0.84 + 1e-6 * k))
    publisher.message(Heading(recording.imu.t[0], 1.5, 0.1))
    publisher.message(Height(recording.imu.t[0], 500.0))
    return count


def recorded(path, recording):
    clock = SourceClock(recording.metadata.time)
    publisher = Publisher(McapFile(path), clock, lambda: recording.imu.kind)
    published(publisher, recording)
    publisher.close()
    assert publisher.lost == 0
    return path


def test_a_recorded_run_is_read_as_the_log_that_it_was(tmp_path):
    pytest.importorskip("mcap")
    run = drive(8.0)
    log = schuler.read(recorded(tmp_path / "live.mcap", run))
    assert log.metadata.time == run.metadata.time
    np.testing.assert_array_equal(log.imu.gyro, run.imu.gyro)
    np.testing.assert_array_equal(log.imu.accel, run.imu.accel)
    np.testing.assert_allclose(log.imu.t, run.imu.t, rtol=0.0, atol=1e-9)  # stamps are nanoseconds
    np.testing.assert_allclose(log.gnss.llh, run.gnss.llh, rtol=1e-15, atol=0.0)  # degrees and back
    np.testing.assert_allclose(log.gnss.cov_r_n, run.gnss.cov_r_n, rtol=1e-15, atol=0.0)  # a root, squared
    np.testing.assert_array_equal(log.gnss.v_n, run.gnss.v_n)


def test_increments_are_recorded_as_mean_rates(tmp_path):
    pytest.importorskip("mcap")
    run = drive(8.0)
    made = ImuSeries(run.imu.t, 0.02 * run.imu.gyro, 0.02 * run.imu.accel, "increment")
    log = schuler.read(recorded(tmp_path / "live.mcap", replace(run, imu=made)))
    np.testing.assert_allclose(
        log.imu.gyro, made.gyro[1:] / np.diff(made.t)[:, None], rtol=1e-12, atol=1e-15
    )  # the first has no interval
    np.testing.assert_allclose(log.imu.t, 0.5 * (made.t[1:] + made.t[:-1]), rtol=0.0, atol=2e-9)


def test_the_mcap_library_reads_solutions_events_and_bytes(tmp_path):
    reader = pytest.importorskip("mcap.reader")
    path = recorded(tmp_path / "live.mcap", drive(8.0))
    by_topic, types = {}, {}
    with path.open("rb") as stream:
        for schema, channel, message in reader.make_reader(stream, validate_crcs=True).iter_messages():
            by_topic.setdefault(channel.topic, []).append(message)
            types[channel.topic] = (schema.name, channel.message_encoding)
    assert types["/schuler/odometry"] == ("nav_msgs/msg/Odometry", "cdr")
    assert types["/schuler/location"] == ("foxglove.LocationFix", "json")
    assert types["/source/1"] == ("schuler.Bytes", "application/octet-stream")
    assert b"".join(m.data for m in by_topic["/source/1"]) == b"\xb5\x62\x01\x07"
    assert [json.loads(m.data)["message"] for m in by_topic["/schuler/events"]] == ["wire: connected"]
    lines = [json.loads(m.data) for m in by_topic["/schuler/solution"]]
    places = [json.loads(m.data) for m in by_topic["/schuler/location"]]
    assert [p["latitude"] for p in places] == [line["lat_deg"] for line in lines]
    assert json.loads(by_topic["/height"][0].data) == {"t_s": lines[0]["t_s"], "value": 500.0, "sigma": None}


def test_rosbags_reads_the_odometry(tmp_path):
    """East, north and up of the first solution, by the definitions of ROS and not ours."""
    pytest.importorskip("mcap")
    rosbags = pytest.importorskip("rosbags.typesys")
    store = rosbags.get_typestore(rosbags.Stores.ROS2_HUMBLE)
    topics = Topics("rate")
    made = [solution(345_600.0 + k, 0.84 + 1e-6 * k, -0.147) for k in range(3)]
    posts = [p for s in made for p in topics.posts(s, WEEK) if p.topic == "/schuler/odometry"]
    last = store.deserialize_cdr(posts[-1].data, "nav_msgs/msg/Odometry")
    r = frames.ned_from_ecef(frames.ecef_from_llh(made[2].llh[None]), made[0].llh)[0]
    position = last.pose.pose.position
    np.testing.assert_allclose((position.y, position.x, -position.z), r, atol=1e-9)
    forward = np.array([np.cos(-1.0), np.sin(-1.0)]) @ made[2].v_eb_n[:2]  # but for roll and pitch of a hundredth
    assert last.twist.twist.linear.x == pytest.approx(forward, abs=0.1)
    assert last.pose.covariance[0] == pytest.approx(0.25**2, rel=1e-4)
    assert last.pose.covariance[7] == pytest.approx(0.5**2, rel=1e-4)
    assert last.pose.covariance[35] == pytest.approx(0.02**2, rel=1e-4)
    turned = np.array([last.twist.covariance[k] for k in (0, 7, 14)])
    assert turned.sum() == pytest.approx(np.sum(made[2].sigma_v_n ** 2), rel=1e-12)  # rounding: a trace
    fields = odometry_of(made[0], made[0].llh)
    assert [fields[f"pose.pose.position.{axis}"][0] for axis in "xyz"] == pytest.approx([0.0] * 3, abs=1e-8)


def test_what_was_flushed_is_there_when_the_program_is_killed(tmp_path, monkeypatch):
    pytest.importorskip("mcap")
    monkeypatch.setattr("schuler.live.publishing._FLUSHED_S", 0.05)
    run = drive(8.0)
    publisher = Publisher(McapFile(tmp_path / "live.mcap"), SourceClock(run.metadata.time), lambda: "rate")
    published(publisher, run)
    began, killed = time.monotonic(), tmp_path / "killed.mcap"
    while True:
        assert time.monotonic() - began < LONGEST_S
        time.sleep(0.05)
        killed.write_bytes((tmp_path / "live.mcap").read_bytes())
        if killed.stat().st_size and "/height" in [topic.name for topic in mcap.scan(killed, allow_truncated=True)[0]]:
            break
    publisher.close()
    log = schuler.read(tmp_path / "killed.mcap", allow="truncated")
    np.testing.assert_array_equal(log.imu.gyro, run.imu.gyro)


def test_a_file_that_exists_is_not_written_over(tmp_path):
    pytest.importorskip("mcap")
    (tmp_path / "live.mcap").write_bytes(b"kept")
    with pytest.raises(InputError, match="expected the name of a new MCAP file"):
        open_publisher(f"mcap:{tmp_path / 'live.mcap'}", SourceClock(), lambda: "rate")
    assert (tmp_path / "live.mcap").read_bytes() == b"kept"


def test_stamps_that_are_none_are_not_posted():
    topics = Topics("rate")
    for t in (math.nan, 1e30, -1e12):
        assert list(topics.posts(Speed(t, 1.0), WEEK)) == []
    assert list(topics.posts(Speed(5.0, 1.0), None)) == []
    assert [p.topic for p in topics.posts(Speed(5.0, math.nan), WEEK)] == ["/schuler", "/odometer"]


class Stuck:
    """A station that does not answer until it is let go."""

    def __init__(self):
        self.free = threading.Event()

    def post(self, post, log_ns):
        self.free.wait(LONGEST_S)

    def flush(self):
        pass

    def close(self):
        pass


def test_a_station_that_does_not_follow_loses_messages_and_holds_up_nothing(monkeypatch):
    monkeypatch.setattr("schuler.live.publishing._WAITING", 100)
    station = Stuck()
    publisher = Publisher(station, SourceClock(WEEK), lambda: "rate")
    for k in range(500):
        publisher.message(Speed(float(k), 1.0))
    assert publisher.lost >= 399
    station.free.set()
    publisher.close()


class Failing(Stuck):
    def post(self, post, log_ns):
        raise OSError("no space left")


def test_what_went_wrong_is_said_at_the_end():
    publisher = Publisher(Failing(), SourceClock(WEEK), lambda: "rate")
    for k in range(5):
        publisher.message(Speed(float(k), 1.0))
    with pytest.raises(OSError, match="no space left"):
        publisher.close()


@contextlib.contextmanager
def client(port):
    """Client of the published protocol: what channels there are, and messages of those subscribed to."""
    connect = pytest.importorskip("websockets.sync.client").connect
    with connect(f"ws://127.0.0.1:{port}", subprotocols=["foxglove.sdk.v1"]) as connection:
        yield connection


def test_foxglove_reads_the_run(port):
    """Subscribed to by topic, decoded by the schema that the server advertises."""
    pytest.importorskip("foxglove")
    rosbags = pytest.importorskip("rosbags.typesys")
    run = drive(8.0)
    publisher = Publisher(FoxgloveServer(port=port), SourceClock(run.metadata.time), lambda: "rate")
    names, received = {}, {}
    with client(port) as connection:
        began = time.monotonic()
        publisher.solution(solution(run.imu.t[0]))
        while not {"/schuler/location", "/imu/data"} <= set(received):
            assert time.monotonic() - began < LONGEST_S, names
            published(publisher, run)
            with contextlib.suppress(TimeoutError):
                while time.monotonic() - began < LONGEST_S:
                    data = connection.recv(timeout=0.05)
                    if isinstance(data, bytes):
                        _, number, _ = struct.unpack_from("<BIQ", data)  # 1, subscription, time
                        received[names[number]["topic"]] = data[13:]
                        continue
                    new = json.loads(data).get("channels", [])
                    names |= {channel["id"]: channel for channel in new}
                    wanted = [{"id": channel["id"], "channelId": channel["id"]} for channel in new]
                    connection.send(json.dumps({"op": "subscribe", "subscriptions": wanted}))
    publisher.close()
    place = json.loads(received["/schuler/location"])
    assert place["latitude"] == pytest.approx(np.rad2deg(0.84), abs=1e-3)
    (imu,) = [channel for channel in names.values() if channel["topic"] == "/imu/data"]
    assert (imu["encoding"], imu["schemaEncoding"], imu["schemaName"]) == ("cdr", "ros2msg", "sensor_msgs/msg/Imu")
    assert "geometry_msgs/Vector3 angular_velocity" in imu["schema"]
    store = rosbags.get_typestore(rosbags.Stores.ROS2_HUMBLE)
    sample = store.deserialize_cdr(received["/imu/data"], "sensor_msgs/msg/Imu").linear_acceleration
    assert (sample.x, -sample.y, -sample.z) in map(tuple, run.imu.accel.tolist())


def test_foxglove_clients_that_say_or_read_nothing_hold_up_nothing(port, monkeypatch):
    pytest.importorskip("foxglove")
    monkeypatch.setattr("schuler.live.outlets.CLOSED_S", 0.1)
    run = drive(8.0)
    publisher = Publisher(FoxgloveServer(port=port), SourceClock(run.metadata.time), lambda: "rate")
    with socket.create_connection(("127.0.0.1", port)), client(port):
        for _ in range(3):
            published(publisher, run)
        publisher.close()
    assert publisher.lost == 0


def test_a_port_of_foxglove_that_is_taken_is_refused(port):
    pytest.importorskip("foxglove")
    with socket.create_server(("127.0.0.1", port)), pytest.raises(InputError, match="cannot listen there"):
        open_publisher(f"foxglove:ws://:{port}", SourceClock(), lambda: "rate")
