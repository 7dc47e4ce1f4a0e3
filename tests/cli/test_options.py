"""Options of all commands: each is explained, and a place that cannot be written to is refused before any work."""

import os
from pathlib import Path

import pytest

from schuler.cli import main
from schuler.cli.app import COMMANDS, METHODS, app

CALLS = [[name] for name in COMMANDS if name != "calibrate"] + [["calibrate", name] for name in METHODS]
#: Commands that write a folder; what they read does not exist, so that a late check would say so.
FOLDERS = ["demo", "allan", "budget", "observability", "rotary", "montecarlo", "foot", "navigate", "points", "compare"]
FOLDERS_OF_METHODS = [f"calibrate {name}" for name in METHODS]


def arguments(call):
    """All arguments of a command, as its help would show them."""
    result = app
    for name in call:
        result = result[name]
    return result.assemble_argument_collection(parse_docstring=True)


@pytest.mark.parametrize("call", CALLS, ids=" ".join)
def test_every_option_is_explained(call):
    shown = [a for a in arguments(call) if a.parameter.parse is not False and not a.children]
    assert shown
    assert [a.name for a in shown if not a.parameter.help] == []


def test_options_of_reading_mean_the_same_in_all_commands():
    meant = {}
    for call in CALLS:
        for a in arguments(call):
            if a.name in ("--columns", "--units", "--scale", "--rate", "--kind", "--allow", "--json", "--unchecked"):
                meant.setdefault(a.name, {}).setdefault(a.parameter.help, []).append(" ".join(call))
    assert {name: texts for name, texts in meant.items() if len(texts) > 1} == {}


@pytest.mark.parametrize("command", FOLDERS + FOLDERS_OF_METHODS)
def test_a_file_in_the_place_of_the_folder_is_refused_first(command, tmp_path, capsys):
    taken = tmp_path / "taken"
    taken.write_text("mine", encoding="utf-8")
    call = command.split() + ([] if command == "demo" else [str(tmp_path / "missing")])
    call += ["--rates", "30"] if command.endswith("ratetable") else []
    call += ["--config", str(tmp_path / "missing.toml")] if command in ("navigate", "compare") else []
    assert main([*call, "--out", str(taken)]) == 2
    stated = capsys.readouterr().err
    assert "for --out. Expected a folder" in stated
    assert f"{taken} is a file: give another name" in stated
    assert taken.read_text(encoding="utf-8") == "mine"
    for other, named in ((taken / "in it", taken), (Path(os.devnull), os.devnull)):
        assert main([*call, "--out", str(other)]) == 2
        assert f"{named} is a file: give another name" in capsys.readouterr().err


@pytest.mark.parametrize("call", ["simulate x.toml --out", "check x.csv --report", "reproduce du --out"])
def test_a_folder_in_the_place_of_the_file_is_refused_first(call, tmp_path, capsys):
    assert main([*call.split(), str(tmp_path)]) == 2
    assert f"Expected the name of a file; {tmp_path} is a folder" in capsys.readouterr().err


def test_what_the_system_refuses_is_one_line(tmp_path, monkeypatch, capsys):
    """A file in the place of the default folder is seen before the work; what turns up meanwhile is one line too."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(
        "schuler.cli.demo.run_demo", lambda *_: (_ for _ in ()).throw(FileExistsError(17, "File exists", "demo"))
    )
    assert main(["demo"]) == 2
    assert capsys.readouterr().err.splitlines()[-1].startswith("schuler: demo: expected a path to read or write")
    (tmp_path / "demo").write_text("mine", encoding="utf-8")
    assert main(["demo"]) == 2
    assert "Expected a folder" in capsys.readouterr().err
