"""``schuler info`` of logs with many streams, and ``schuler convert`` between formats of the registry."""

import json

import numpy as np
import pytest
from command import answer, run

from schuler.recording import ImuSeries, Metadata, OdometerSeries, Recording
from schuler.recording.formats import registry
from schuler.recording.io import read, write
from schuler.timebase import TimeBase

pytest.importorskip("rosbags")


@pytest.fixture
def bag(tmp_path):
    rng = np.random.default_rng(3)
    t = 259_200.0 + np.arange(300) / 100.0
    imu = ImuSeries(t, 1e-3 * rng.standard_normal((300, 3)), 1e-2 * rng.standard_normal((300, 3)) - (0, 0, 9.8))
    odometer = OdometerSeries(t[::10], np.zeros(30), np.full(30, 0.1))
    recording = Recording(imu, odometer=odometer, metadata=Metadata(time=TimeBase("gps", 2374 * 604_800.0)))
    write(recording, tmp_path / "run.rosbag2")
    return tmp_path / "run.rosbag2"


def test_topics_stand_before_the_recording(bag, capsys):
    code, out, _ = run(capsys, "info", bag)
    assert code == 0
    lines = out.splitlines()
    assert lines[0].split() == ["stream", "type", "number", "rate", "from", "to", "can", "be"]
    assert lines[1].startswith("/imu/data  sensor_msgs/Imu")
    assert "100 Hz" in lines[1]
    assert any(line.startswith("  IMU   300 samples at 100 Hz") for line in lines)


def test_topics_as_json(bag, capsys):
    data = answer(capsys, "info", bag, "--json")
    assert {s["name"]: s["count"] for s in data["streams"]} == {"/imu/data": 300, "/odometer": 30, "/schuler": 1}
    assert data["streams"][0]["rate_hz"] == pytest.approx(100.0)
    assert data["imu"]["samples"] == 300
    assert data["not_read"] is None


def test_what_is_missing_stands_below_the_topics(bag, capsys):
    code, out, _ = run(capsys, "info", bag, "--streams", "imu=none,odometer=none")
    assert code == 0
    assert "not read as a recording yet: " in out
    assert "no topic of an IMU" in out
    code, out, _ = run(capsys, "info", bag, "--streams", "imu=/odometer", "--json")
    assert "candidates for imu: /imu/data" in json.loads(out)["not_read"]


def test_a_damaged_container_is_an_error(tmp_path, capsys):
    path = tmp_path / "x.mcap"
    path.write_bytes(b"\x89MCAP0\r\n" + b"\x01" + b"\xff" * 8)
    code, _, err = run(capsys, "info", path)
    assert code == 2
    assert "x.mcap" in err


def test_known_formats_are_listed(capsys):
    code, out, _ = run(capsys, "info", "--formats")
    assert code == 0
    names = [line.split()[0] for line in out.splitlines()]
    assert names[: len(registry.FORMATS)] == [name for name, _ in registry.FORMATS]
    assert {"text", "parquet", "rtklib", "rinex_observation", "ubx", "nmea", "matlab", "numpy_files"} <= set(names)
    assert run(capsys, "info")[0] == 2


def test_converting_a_bag_and_back(bag, tmp_path, capsys):
    code, out, _ = run(capsys, "convert", bag, tmp_path / "run.mcap")
    assert code == 0
    assert out.strip() == str(tmp_path / "run.mcap")
    code, out, _ = run(capsys, "convert", tmp_path / "run.mcap", tmp_path / "again", "--to", "rosbag", "--json")
    assert code == 0
    assert json.loads(out)["left_out"] == []
    np.testing.assert_array_equal(read(tmp_path / "again").imu.gyro, read(bag).imu.gyro)


def test_other_commands_take_streams(bag, capsys):
    code, _, err = run(capsys, "allan", bag, "--streams", "imu=/nothing")
    assert code == 2
    assert "'/nothing' is not in the log; candidates for imu: /imu/data" in err
