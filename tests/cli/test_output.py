"""What commands share: times of outages, JSON without NaN, progress on terminals only."""

import json
import re

import numpy as np
import pytest
from command import refusal, run

from schuler.cli.configuration import check_entries, configuration, entries, period, window
from schuler.cli.output import print_json, print_verdict, progress, writable
from schuler.exceptions import ConfigError, InputError
from schuler.navigation.evaluation.verdict import Verdict


@pytest.mark.parametrize(("text", "expected"), [("50:90", (50.0, 90.0)), ("0:1.5", (0.0, 1.5))])
def test_windows(text, expected):
    assert window(text) == expected


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("45:15", {"every_s": 45.0, "length_s": 15.0}),
        ("45:15:40", {"every_s": 45.0, "length_s": 15.0, "first_s": 40.0}),
    ],
)
def test_periods(text, expected):
    assert period(text) == expected


@pytest.mark.parametrize("text", ["", "5", "5:5", "9:5", "a:b", "1:2:3", "1:nan", "0:inf", ":"])
def test_faulty_windows_are_refused(text):
    with pytest.raises(InputError, match=f"--outage: expected START:STOP in seconds, such as 50:90, got '{text}'"):
        window(text)


@pytest.mark.parametrize(
    "text", ["", "45", "15:45", "45:0", "45:-1", "x:y", "1:2:3:4", "45:15:x", "nan:15", "45:15:nan"]
)
def test_faulty_periods_are_refused(text):
    with pytest.raises(InputError, match="--outage-every: expected PERIOD:LENGTH"):
        period(text)


@pytest.mark.parametrize("where", ["schuler.cli.output.silenced", "schuler.cli.explain.read_toml"])
def test_an_interrupt_ends_with_one_line_and_code_1(where, monkeypatch, capsys):
    def interrupted(*_):
        raise KeyboardInterrupt

    monkeypatch.setattr(where, interrupted)
    assert run(capsys, "explain", "ARW") == (1, "", "schuler: interrupted\n")


def test_a_default_folder_that_cannot_be_made_is_refused_before_the_work(tmp_path):
    (tmp_path / "log-solution").write_text("a file of the user's")
    with pytest.raises(InputError, match=r"Expected a folder, .*log-solution is a file: give another name"):
        writable(tmp_path / "log-solution" / "figures")
    assert writable(tmp_path / "new") == tmp_path / "new"
    assert not (tmp_path / "new").exists()


def test_json_holds_numbers_or_null(capsys):
    print_json({"a": np.float64(1.5), "b": np.nan, "c": np.array([1.0, np.inf]), "d": np.int64(3), "e": np.bool_(True)})
    assert json.loads(capsys.readouterr().out) == {"a": 1.5, "b": None, "c": [1.0, None], "d": 3, "e": True}


@pytest.mark.parametrize(
    ("terminal", "environment", "coloured"),
    [(True, {}, True), (False, {}, False), (True, {"NO_COLOR": "1"}, False), (True, {"TERM": "dumb"}, False)],
)
def test_verdicts_have_colours_on_terminals_that_want_them(capsys, monkeypatch, terminal, environment, coloured):
    monkeypatch.delenv("NO_COLOR", raising=False)
    monkeypatch.setenv("TERM", "xterm")
    for name, value in environment.items():
        monkeypatch.setenv(name, value)
    monkeypatch.setattr("sys.stdout.isatty", lambda: terminal)
    print_verdict(Verdict("failed", ("reason",), ("cause",)))
    assert ("\x1b[1;31mverdict: FAILED\x1b[0m" in capsys.readouterr().out) is coloured


def test_no_progress_where_nobody_looks(capsys):
    with progress("working") as bar:
        assert bar is None
    assert capsys.readouterr().err == ""


def test_progress_on_a_terminal(capsys, monkeypatch):
    monkeypatch.setattr("sys.stderr.isatty", lambda: True, raising=False)
    with progress("working") as bar:
        bar(0.5)
        bar(1.0)
    assert "working" in capsys.readouterr().err


def test_too_little_memory_is_one_sentence(tmp_path, capsys):
    """A mission of thirty million years."""
    motion = 'type = "manoeuvres"\nlat_deg = 48.0\nlon_deg = 11.0\nmanoeuvres = [{ duration_s = 1e15 }]\n'
    (tmp_path / "long.toml").write_text(f'[motion]\n{motion}[imu]\nrate_hz = 100.0\ncatalogue = "MTi-G-710"\n')
    message = refusal(capsys, "simulate", tmp_path / "long.toml", "--out", tmp_path / "long.parquet")
    assert "expected enough memory for what was asked" in message
    assert [p.name for p in tmp_path.iterdir()] == ["long.toml"]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("filter.record_s=" + "[" * 3000, "nested too deeply"),
        ("filter.record_s=" + "9" * 5000, "Exceeds the limit"),
        ("filter.record_s=0x" + "f" * 5000, "an integer has more than 64 bits"),
        ("a" + ".a" * 5000 + "=1", "expected SECTION.KEY=VALUE"),
    ],
)
def test_entries_that_no_configuration_has_are_refused(text, message):
    with pytest.raises(InputError, match=f"--set.*{message}"):
        entries((text,))


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("gnss.lever_arm_m=abc", "expected a list, got 'abc'"),
        ("gnss.lever_arm_m=[1, 2]", "expected more values, got [1, 2]"),
        ("outages.windows_s=[[1, 2, 3]]", ".0: expected at most 2 values, got [1, 2, 3]"),
        ("alignment.rest_s=-1", "expected at least 0, got -1"),
        ("filter.tune='perhaps'", "expected true or false, or 'auto', got 'perhaps'"),
        ("filter.states=16", "expected 9, 15, 21, 27, 33, 39 or 42, or a list, got 16"),
        ("imu.catalogue=true", "expected a text, got true"),
        ("gnss.coupling='mixed'", "expected 'loose', 'tight', 'reset' or 'off', got 'mixed'"),
        ("gnss.tight=3", "expected a section, got 3"),
    ],
)
def test_a_wrong_value_is_told_what_was_expected(text, message):
    name = text.partition("=")[0]
    with pytest.raises(ConfigError, match=re.escape(f"--set: {name}") + ".*" + re.escape(message)):
        check_entries(entries((text,)))


def test_what_is_wrong_on_the_command_line_is_not_said_of_the_file(tmp_path):
    config = tmp_path / "drive.toml"
    config.write_text('[imu]\ncatalogue = "consumer"\n[gnss]\nlever_arm_m = [0, 0]\n', encoding="utf-8")
    changes = entries(("filter.states=16", "alignment.rest_s=3"))
    with pytest.raises(ConfigError) as refused:
        configuration(config, changes, (), None)
    of_the_command, of_the_file = str(refused.value).split(f"; {config}: ")
    assert of_the_command.startswith("--set: filter.states: expected 9")
    assert of_the_file.startswith("gnss.lever_arm_m: expected more values")
