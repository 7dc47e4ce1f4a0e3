"""``schuler studio`` before it serves: what it refuses, in one line."""

import socket
from importlib.util import find_spec

import pytest
from command import refusal

from schuler.cli import demo
from schuler.cli.studio import studio
from schuler.navigation.config import NavigationConfig
from schuler.navigation.evaluation.evaluated import evaluate_run
from schuler.navigation.run import navigate
from schuler.recording.io import read

if find_spec("nicegui") is None:  # imported by the server alone, not by every process that collects tests
    pytest.skip("the workbench needs the extra studio", allow_module_level=True)


def test_other_addresses_need_a_token_of_the_user(capsys, tmp_path):
    assert "expected --token-file" in refusal(capsys, "studio", tmp_path, "--no-browser", "--host", "0.0.0.0")
    (tmp_path / "short").write_text("abc")
    short = refusal(capsys, "studio", tmp_path, "--host", "0.0.0.0", "--token-file", tmp_path / "short")
    assert "expected 16 or more letters" in short


def test_ports_that_are_taken_and_folders_that_are_not_there(capsys, tmp_path):
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        message = refusal(capsys, "studio", tmp_path, "--no-browser", "--port", taken.getsockname()[1])
    assert "say another --port" in message
    assert "expected 0 to 65535" in refusal(capsys, "studio", tmp_path, "--port", "70000")
    assert "no such file or folder" in refusal(capsys, "studio", tmp_path / "none")


def test_without_nicegui_the_extra_is_named(capsys, tmp_path, monkeypatch):
    import sys

    monkeypatch.setitem(sys.modules, "nicegui", None)
    assert "pip install 'schuler[studio]'" in refusal(capsys, "studio", tmp_path, "--no-browser")


@pytest.mark.campaign
def test_the_folder_of_the_demo_navigates_as_schuler_demo(tmp_path, monkeypatch):
    monkeypatch.setattr(demo, "_RUNS", 1)
    shown = {}
    monkeypatch.setattr("schuler.studio.serve", lambda workspace, **_: shown.update(folder=workspace.root))
    studio(tmp_path / "tour", demo=True, browser=False)
    assert shown["folder"] == tmp_path / "tour"
    assert {path.name for path in shown["folder"].iterdir()} == {"demo.parquet", "drive.toml", "mission.toml"}
    config = NavigationConfig.load(tmp_path / "tour" / "drive.toml", [("outages.windows_s", [[300.0, 340.0]])])
    recording = read(tmp_path / "tour" / "demo.parquet")
    again = evaluate_run(recording, navigate(recording, config), True).numbers
    once, _, _ = demo.run_demo(None)
    # rounding: increments become rates in the file and increments again
    assert again["rms_horizontal_m"] == pytest.approx(once.numbers["rms_horizontal_m"], rel=1e-6)
    assert again["outages"][0]["max_horizontal_m"] == pytest.approx(
        once.numbers["outages"][0]["max_horizontal_m"], rel=1e-6
    )


def test_the_demo_keeps_what_is_there_and_takes_one_folder(capsys, tmp_path):
    for name in ("demo.parquet", "drive.toml"):
        (tmp_path / name).write_text("mine")
    demo.write_demo_drive(tmp_path)
    assert (tmp_path / "demo.parquet").read_text() == (tmp_path / "drive.toml").read_text() == "mine"
    assert "expected one folder or none" in refusal(capsys, "studio", tmp_path / "drive.toml", "--demo")
    assert "expected one folder or none" in refusal(capsys, "studio", tmp_path / "a", tmp_path / "b", "--demo")
