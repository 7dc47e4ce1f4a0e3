"""docs/formats-robots.md: its examples run, its tables name what is read."""

from __future__ import annotations

import importlib.util
import re
from pathlib import Path

import numpy as np
import pytest

import schuler
from schuler.recording.formats import ardupilot_tables, px4, registry, ros_messages, ros_recording

pytest.importorskip("rosbags")
pytest.importorskip("pyulog")
ROOT = Path(__file__).resolve().parents[3]
PAGE = ROOT / "docs" / "formats-robots.md"


def sibling(name: str):
    spec = importlib.util.spec_from_file_location(name, Path(__file__).with_name(f"{name}.py"))
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.fixture
def folder(tmp_path, monkeypatch) -> Path:
    """A folder with the logs that the page names."""
    from rosbags.rosbag1 import Writer
    from rosbags.typesys import Stores, get_typestore

    monkeypatch.chdir(tmp_path)
    store, ros2 = get_typestore(Stores.ROS1_NOETIC), get_typestore(Stores.ROS2_HUMBLE)
    made = sibling("test_rosbag")
    kinds = {"/imu": "sensor_msgs/Imu", "/gps/fix": "sensor_msgs/NavSatFix", "/odometry": "nav_msgs/Odometry",
             "/gps/vel": "geometry_msgs/TwistWithCovarianceStamped"}  # fmt: skip
    fields = {"/imu": made.REST, "/gps/fix": made.FIX, "/odometry": {"pose.pose.orientation.w": 1.0},
              "/gps/vel": {f"twist.covariance.{k}": 0.01 for k in (0, 7, 14)}}  # fmt: skip
    ns = 1_700_000_000 * 10**9 + np.arange(40) * 10**8
    with Writer("drive.bag") as writer:
        for topic, kind in kinds.items():
            name = kind.replace("/", "/msg/")
            connection = writer.add_connection(topic, name, typestore=store)
            texts = {"header.frame_id": "frame"} | ({"child_frame_id": "base"} if topic == "/odometry" else {})
            raw = ros_messages.encode(kind, ns, fields[topic], texts)
            for stamp, cdr in zip(ns, raw, strict=True):
                writer.write(connection, int(stamp), ros2.cdr_to_ros1(cdr, name))
    Path("flight.ulg").write_bytes(sibling("test_px4").flight(imu=("sensor_combined", "sensor_gyro")))
    flash = sibling("test_ardupilot")
    body = flash.messages()
    for k in range(100):
        t = flash.us(60.0 + k / 100)
        body += [flash.message("GYR", t, 0, t, 0, 0, 0), flash.message("ACC", t, 0, t, 0, 0, -9.8)]
    Path("flight.bin").write_bytes(flash.encoder.log(body, (*flash.NAMES, "ACC", "GYR")))
    return tmp_path


def test_the_examples_run(folder):
    names: dict = {}
    blocks = re.findall(r"```python\n(.*?)```", PAGE.read_text(encoding="utf-8"), re.DOTALL)
    assert len(blocks) == 3
    for block in blocks:
        exec(compile(block, str(PAGE), "exec"), names)
    assert names["drive"].gnss.v_n is not None
    assert names["with_poses"].reference is not None
    assert names["flight"].reference is not None
    assert len(names["unfiltered"].imu) == 100
    assert names["raw"].metadata.time.scale == "local"
    assert schuler.read(folder / "drive_ros2").imu is not None
    assert (folder / "drive.mcap").exists()


def test_the_tables_name_what_is_read():
    page = PAGE.read_text(encoding="utf-8")
    for kind in ros_recording.PARTS:
        assert kind in page or f"`{kind.partition('/')[2]}`" in page, kind
    for topic in (*px4.TOPICS, *px4.HELPERS):
        assert f"`{topic}`" in page, topic
    for name in ("mcap", "rosbag"):
        assert all(f"`{suffix}`" in page for known, found, _ in registry.WRITERS if known == name for suffix in found)
    for letters in ("IMU", "ACC+GYR", "GPS", "GPA", "BARO", "POS", "ATT", "XKF1", "NKF1", "AEl", "Und"):
        assert f"`{letters}`" in page, letters
    assert ardupilot_tables.QUALITY.keys() == {3, 4, 5, 6}
