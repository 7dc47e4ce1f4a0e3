"""A run folder can be run again: the same bytes, or what differs."""

import json
from dataclasses import replace

import pytest
from command import answer, refusal, run
from places import EXAMPLES

from schuler.recording import io
from schuler.simulation.scenario import simulate

CONFIG = EXAMPLES / "town_navigation.toml"


@pytest.fixture(scope="module")
def town(tmp_path_factory):
    path = tmp_path_factory.mktemp("rerun") / "town.parquet"
    io.write(simulate(EXAMPLES / "town.toml"), path)
    return path


def test_same_numbers_byte_for_byte_and_what_differs_is_said(town, tmp_path, capsys):
    first, second = tmp_path / "first", tmp_path / "second"
    data = answer(
        capsys, "navigate", town, "--config", CONFIG, "--out", first, "--no-report", "--no-smooth",
        "--outage", "50:60",
        "--set", "filter.record_s=2.0", "--from", "5", "--to", "80", "--json",
    )  # fmt: skip
    assert {"resolved", "metrics", "run", "log"} <= data["files"].keys()
    metrics = json.loads((first / "metrics.json").read_text())
    assert metrics["rms_horizontal_m"] == data["rms_horizontal_m"]
    assert "elapsed_s" not in metrics
    assert "record_s = 2.0" in (first / "resolved.toml").read_text()
    assert "horizontal error against" in (first / "run.log").read_text()
    again = answer(capsys, "rerun", first, "--out", second, "--json")
    assert again["same"]
    assert again["changed_inputs"] == []
    assert (second / "metrics.json").read_bytes() == (first / "metrics.json").read_bytes()
    message = refusal(capsys, "rerun", first, "--out", first)
    assert "was read by this command" in message
    assert (second / "metrics.json").read_bytes() == (first / "metrics.json").read_bytes()

    # another input and another number: said, exit code 1
    other = io.read(town)
    imu = other.need_imu()
    io.write(replace(other, imu=replace(imu, accel=imu.accel * 1.0001)), tmp_path / "town.parquet")
    code, out, err = run(capsys, "rerun", first, "--log", tmp_path / "town.parquet", "--out", tmp_path / "third")
    assert code == 1, err
    assert "input differs: town.parquet has other contents" in err
    assert "rms_horizontal_m:" in out


def test_what_is_no_run_is_refused(tmp_path, capsys):
    assert "expected a folder of schuler navigate with run.json" in refusal(capsys, "rerun", tmp_path)
    (tmp_path / "run.json").write_text("{}")
    assert "expected a run of format schuler/run/1" in refusal(capsys, "rerun", tmp_path)
    (tmp_path / "metrics.json").write_text("{}")
    good = {"schuler": "1", "log": "a", "sources": {}, "part": [], "unchecked": False, "config": {}}
    for key, wrong in (("log", 3), ("sources", []), ("part", 5), ("config", [])):
        (tmp_path / "run.json").write_text(json.dumps({"format": "schuler/run/1", **good, key: wrong}))
        assert f"is damaged: {key} cannot be" in refusal(capsys, "rerun", tmp_path)
    for text in ("[" * 100_000, '{"a":' * 50_000, "9" * 5000, "{"):
        (tmp_path / "run.json").write_text(text)
        assert "expected the JSON that schuler navigate wrote" in refusal(capsys, "rerun", tmp_path)


def test_a_calibration_and_a_base_station_are_inputs(town, tmp_path):
    """Besides the files of the log; what the configuration does not name is none."""
    from schuler.navigation.config import NavigationConfig
    from schuler.navigation.repetition import input_checksums

    recording = io.read(town)
    log = recording.metadata.sources
    assert list(log) == ["town.parquet"]
    for name in ("imu.yaml", "base.obs"):
        (tmp_path / name).write_text(name)
    named = {
        "imu": {"catalogue": "MPU-6000", "calibration": str(tmp_path / "imu.yaml")},
        "gnss": {"tight": {"base": {"observations": str(tmp_path / "base.obs")}}},
    }
    assert input_checksums(recording, NavigationConfig.checked({"imu": {"catalogue": "MPU-6000"}})) == log
    before = input_checksums(recording, NavigationConfig.checked(named))
    assert list(before) == ["town.parquet", "imu.yaml", "base.obs"]
    (tmp_path / "base.obs").write_text("another day")
    after = input_checksums(recording, NavigationConfig.checked(named))
    assert [name for name in before if before[name] != after[name]] == ["base.obs"]
