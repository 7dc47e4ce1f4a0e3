"""``schuler studio`` before it serves: what it refuses, in one line."""

import socket

import pytest
from command import refusal

pytest.importorskip("nicegui", reason="the workbench needs the extra studio")


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
