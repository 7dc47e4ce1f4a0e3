"""A run on messages of ROS: a bag replayed is the batch run; the node around it, with a stand-in for rclpy."""

import importlib.util
import sys
import xml.etree.ElementTree as ElementTree
from dataclasses import replace
from types import ModuleType, SimpleNamespace

import numpy as np
import pytest
import yaml
from format_drives import drive
from places import ROOT

import schuler
from schuler import frames
from schuler.exceptions import ConfigError, InputError
from schuler.live.ros import PARAMETERS, RosRun, columns_of, fill
from schuler.recording.formats.ros_messages import LAYOUTS

PACKAGE = ROOT / "ros2" / "schuler_ros"
CLOSE_M = 1e-8  # rounding: the same arithmetic, other blocks
CONFIG = {
    "imu.catalogue": "MTi-G-710", "alignment.method": "given", "alignment.rpy_deg": [1.146, 1.719, 28.65],
    "alignment.sigma_deg": [0.5, 0.5, 1.0], "filter.smooth": False, "filter.tune": False, "output_rate_hz": 2.0,
}  # fmt: skip
NESTED = {"imu": {}, "alignment": {}, "filter": {}}
for name, entry in CONFIG.items():
    if "." not in name:
        continue
    NESTED[name.partition(".")[0]][name.partition(".")[2]] = entry


def blank(kind):
    """A message as ROS makes it: every field there, with a value of its type."""
    message = SimpleNamespace()
    for path, form in [("header.stamp.sec", "<i4"), ("header.stamp.nanosec", "<u4"), ("header.frame_id", "string"),
                       *LAYOUTS[kind][1:]]:  # fmt: skip
        *parents, last = path.split(".")
        if last.isdecimal():  # an array of numbers
            *parents, last = parents
            value = np.zeros(36)
        else:
            value = "" if form == "string" else np.zeros(1, form)[0].item()
        place = message
        for name in parents:
            if not hasattr(place, name):
                setattr(place, name, SimpleNamespace())
            place = getattr(place, name)
        setattr(place, last, value)
    return message


@pytest.fixture(scope="module")
def bag(tmp_path_factory):
    """An MCAP bag of a drive without velocities, its messages in order as rosbags decodes them, its batch run."""
    reader = pytest.importorskip("mcap.reader")
    typesys = pytest.importorskip("rosbags.typesys")
    run = drive(64.0, 20.0)  # after a minute the start is that of the log
    run = replace(run, gnss=replace(run.gnss, v_n=None, cov_v_n=None), reference=None)
    path = tmp_path_factory.mktemp("bag") / "drive.mcap"
    schuler.write(run, path)
    store, messages = typesys.get_typestore(typesys.Stores.ROS2_HUMBLE), []
    with path.open("rb") as stream:
        for schema, _, message in reader.make_reader(stream).iter_messages():
            if schema.name != "std_msgs/msg/String":
                messages.append((schema.name, store.deserialize_cdr(message.data, schema.name)))
    return messages, schuler.navigate(schuler.read(path), NESTED).trajectory


def played(run, messages):
    sent = []
    for name, message in messages:
        if name == "sensor_msgs/msg/Imu":
            sent += run.imu(message)
        else:
            run.fix(message)
    return sent


def test_a_bag_replayed_is_the_batch_run(bag):
    messages, trajectory = bag
    run = RosRun(CONFIG)
    sent = played(run, messages)
    last = run.navigator.solution()
    at = int(np.searchsorted(trajectory.t, last.t - 1e-7))
    assert at == len(trajectory.t) - 1
    off = np.linalg.norm(frames.ecef_from_llh(last.llh[None])[0] - trajectory.r_eb_e[at])
    assert off < CLOSE_M
    assert {s.name for s in sent} == {"odometry", "fix", "transform"}
    assert run.left_out == {}
    # what was sent, as ROS would have it: degrees, east-north-up of the first solution, the tf of the odometry
    fixes = [fill(blank("sensor_msgs/NavSatFix"), s) for s in sent if s.name == "fix"]
    odometries = [fill(blank("nav_msgs/Odometry"), s) for s in sent if s.name == "odometry"]
    transforms = [fill(blank("geometry_msgs/TransformStamped"), s) for s in sent if s.name == "transform"]
    assert len(fixes) == len(odometries) == len(transforms) > 100
    llh = np.array([(np.deg2rad(f.latitude), np.deg2rad(f.longitude), f.altitude) for f in (fixes[0], fixes[-1])])
    north, east, down = frames.ned_from_ecef(frames.ecef_from_llh(llh[1:]), llh[0])[0]
    position = odometries[-1].pose.pose.position
    np.testing.assert_allclose((position.x, position.y, position.z), (east, north, -down), atol=1e-6)  # of degrees
    assert vars(transforms[-1].transform.translation) == vars(position)
    assert vars(transforms[-1].transform.rotation) == vars(odometries[-1].pose.pose.orientation)
    assert (odometries[-1].header.frame_id, odometries[-1].child_frame_id) == ("map", "imu_link")
    v = odometries[-1].twist.twist.linear
    assert np.linalg.norm((v.x, v.y, v.z)) == pytest.approx(np.linalg.norm(trajectory.v_eb_e[at]), rel=1e-3)
    stamp = fixes[-1].header.stamp
    newest = max((m.header.stamp.sec, m.header.stamp.nanosec) for name, m in messages if name.endswith("Imu"))
    assert abs((stamp.sec - newest[0]) + 1e-9 * (stamp.nanosec - newest[1])) < 0.51


def test_a_run_saved_goes_on(bag, tmp_path):
    messages, trajectory = bag
    parameters = CONFIG | {"state": str(tmp_path / "live.state")}
    half = len(messages) // 2
    first = RosRun(parameters)
    played(first, messages[:half])
    first.save()
    second = RosRun(parameters)
    played(second, messages[half:])
    last = frames.ecef_from_llh(second.navigator.solution().llh[None])[0]
    assert np.linalg.norm(last - trajectory.r_eb_e[-1]) < CLOSE_M
    with pytest.raises(InputError, match="saved with another configuration"):
        RosRun(parameters | {"lag_s": 5.0})


def test_messages_of_no_use_are_counted():
    run = RosRun(CONFIG)
    message = blank("sensor_msgs/NavSatFix")
    run.fix(message)
    message.header.stamp.sec = 1_700_000_000
    message.status.status = -1
    run.fix(message)
    message.status.status, message.latitude = 0, 48.0
    run.fix(message)  # without a covariance
    message = blank("sensor_msgs/Imu")
    message.header.stamp.sec = 5
    assert run.imu(message) == []
    assert run.left_out["messages without a stamp"] == 1
    assert run.left_out["messages of a receiver without a fix"] == 1
    assert run.left_out["messages on another clock than those before"] == 1
    assert sum(run.left_out.values()) == 4
    level, text, values = run.diagnostics()
    assert (level, text) == (1, "aligning")
    assert "left_out" in values


def test_wheels_are_an_odometer():
    run, taken = RosRun(CONFIG), []
    run.navigator.take = taken.append
    message = blank("nav_msgs/Odometry")
    message.header.stamp.sec, message.twist.twist.linear.x = 1_700_000_000, 3.0
    run.odometry(message)
    message.twist.covariance[0] = 0.04
    run.odometry(message)
    assert [(m.speed, m.sigma) for m in taken] == [(3.0, None), (3.0, pytest.approx(0.2))]


def test_simulated_time_is_the_clock_of_the_run():
    run = RosRun(CONFIG)
    message = blank("sensor_msgs/Imu")
    message.header.stamp.sec, message.header.stamp.nanosec = 12, 500_000_000
    taken = []
    run.navigator.take = taken.append
    run.imu(message)
    assert taken[0].t == 12.5


def test_parameters_are_the_configuration(tmp_path):
    (tmp_path / "drive.toml").write_text('[imu]\ncatalogue = "MTi-G-710"\n[filter]\nsmooth = false\n')
    run = RosRun({"config": str(tmp_path / "drive.toml"), "filter.states": 21, "use_sim_time": False})
    assert (run.navigator.config.filter.states, run.navigator.config.filter.smooth) == (21, False)
    assert run.options == {**PARAMETERS, "config": str(tmp_path / "drive.toml")}
    with pytest.raises(InputError, match="parameter 'lag': expected one of config"):
        RosRun(CONFIG | {"lag": 1.0})
    with pytest.raises(ConfigError, match="stats"):
        RosRun(CONFIG | {"filter.stats": 15})
    with pytest.raises(InputError, match="output_rate_hz"):
        RosRun(CONFIG | {"output_rate_hz": 0.0})


def test_the_parameters_of_the_launch_file_are_right():
    document = yaml.safe_load((PACKAGE / "config" / "live.yaml").read_text())
    run = RosRun(document["live"]["ros__parameters"])
    assert run.options["output_rate_hz"] == 50.0
    assert run.navigator.config.imu.catalogue == "MTi-G-710"


def test_columns_are_those_of_the_bag(bag):
    """Every number of a message finds its way by the layout with which files are read."""
    message = next(m for name, m in bag[0] if name.endswith("NavSatFix"))
    columns = columns_of("sensor_msgs/NavSatFix", message).values
    assert columns["latitude"][0] == message.latitude
    assert [columns[f"position_covariance.{k}"][0] for k in range(9)] == message.position_covariance.tolist()


class Node:
    """What the node asks of rclpy's."""

    parameters = CONFIG

    def __init__(self, name, **options):
        assert options == {"automatically_declare_parameters_from_overrides": True}
        self.subscribed, self.published, self.timers = {}, {}, []

    def get_parameters_by_prefix(self, prefix):
        assert prefix == ""
        return {name: SimpleNamespace(value=value) for name, value in self.parameters.items()}

    def create_publisher(self, kind, topic, queue):
        return SimpleNamespace(publish=self.published.setdefault(topic, []).append)

    def create_subscription(self, kind, topic, call, qos):
        self.subscribed[topic] = call

    def create_timer(self, period, call):
        self.timers.append((period, call))

    def get_logger(self):
        return SimpleNamespace(info=self.published.setdefault("log", []).append)

    def get_clock(self):
        return SimpleNamespace(now=lambda: SimpleNamespace(to_msg=lambda: "now"))

    def destroy_node(self):
        pass


@pytest.fixture
def node_module(monkeypatch):
    """The node's module over stand-ins for rclpy, tf2_ros and the packages of messages."""
    header = lambda: SimpleNamespace(header=SimpleNamespace(), status=[])  # noqa: E731
    modules = {
        "rclpy": {"init": lambda: None, "spin": lambda node: None, "try_shutdown": lambda: None},
        "rclpy.node": {"Node": Node},
        "rclpy.executors": {"ExternalShutdownException": type("ExternalShutdownException", (Exception,), {})},
        "rclpy.qos": {"qos_profile_sensor_data": None},
        "diagnostic_msgs": {},
        "diagnostic_msgs.msg": {
            "DiagnosticArray": header, "DiagnosticStatus": lambda: SimpleNamespace(values=[]),
            "KeyValue": SimpleNamespace,
        },
        "sensor_msgs": {},
        "sensor_msgs.msg": {"Imu": None, "NavSatFix": lambda: blank("sensor_msgs/NavSatFix")},
        "nav_msgs": {},
        "nav_msgs.msg": {"Odometry": lambda: blank("nav_msgs/Odometry")},
        "geometry_msgs": {},
        "geometry_msgs.msg": {"TransformStamped": lambda: blank("geometry_msgs/TransformStamped")},
        "tf2_ros": {
            "TransformBroadcaster": lambda node: SimpleNamespace(
                sendTransform=node.published.setdefault("/tf", []).append
            )
        },
    }  # fmt: skip
    for name, members in modules.items():
        module = ModuleType(name)
        vars(module).update(members)
        monkeypatch.setitem(sys.modules, name, module)
    spec = importlib.util.spec_from_file_location("schuler_ros_node", PACKAGE / "schuler_ros" / "node.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_the_node_hands_on_what_comes_and_what_is_to_be_sent(bag, node_module, monkeypatch, tmp_path):
    messages, _ = bag
    monkeypatch.setattr(Node, "parameters", CONFIG | {"state": str(tmp_path / "live.state")})
    node = node_module.LiveNode()
    topics = {"sensor_msgs/msg/Imu": "imu/data", "sensor_msgs/msg/NavSatFix": "gnss/fix"}
    for name, message in messages:
        node.subscribed[topics[name]](message)
    for _, call in node.timers:
        call()
    assert len(node.published["~/odometry"]) == len(node.published["~/fix"]) == len(node.published["/tf"]) > 100
    (array,) = node.published["/diagnostics"]
    assert (array.status[0].level, array.status[0].message) == (b"\0", "ok")
    assert {entry.key for entry in array.status[0].values} == {"health", "sigma_horizontal_m", "sigma_vertical_m"}
    assert node.published["log"]
    assert (tmp_path / "live.state").is_file()


def test_the_program_saves_its_state_when_it_is_stopped(node_module, monkeypatch, tmp_path):
    monkeypatch.setattr(Node, "parameters", CONFIG | {"state": str(tmp_path / "live.state")})

    def stopped(node):
        raise KeyboardInterrupt

    monkeypatch.setattr(node_module.rclpy, "spin", stopped)
    node_module.main()
    assert (tmp_path / "live.state").is_file()


def test_the_package_names_what_its_node_imports():
    source = (PACKAGE / "schuler_ros" / "node.py").read_text()
    named = {entry.text for entry in ElementTree.parse(PACKAGE / "package.xml").iter("exec_depend")}  # our own file
    imported = {name for name in ("rclpy", "sensor_msgs", "nav_msgs", "geometry_msgs", "diagnostic_msgs", "tf2_ros")
                if f"from {name}" in source or f"import {name}" in source}  # fmt: skip
    assert imported <= named
    assert len(imported) == 6
    assert (PACKAGE / "resource" / "schuler_ros").is_file()
    for text in ("launch/live.launch.py", "config/live.yaml", "schuler_ros/node.py"):
        assert (PACKAGE / text).is_file()
