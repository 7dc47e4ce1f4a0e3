"""Commands keep the files that exist: others unless forced, inputs always, results may be renewed."""

import os
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from command import answer, refusal, run
from places import EXAMPLES

from schuler.calibration.freepose.simulation import hand_log
from schuler.live.sinks import _BEGINNINGS
from schuler.recording.io import write as write_recording
from schuler.recording.recording import Recording
from schuler.sensors.errors import ImuErrors

LOG = "0.0,0,0,-9.81,0,0,0\n0.1,0,0,-9.81,0,0,0\n0.2,0,0,-9.81,0,0,0\n0.3,0,0,-9.81,0,0,0\n"
HINTS = ("--columns", "t,ax,ay,az,gx,gy,gz", "--units", "m/s^2,rad/s", "--axes", "FRD", "--allow", "norm")


@pytest.fixture
def log(tmp_path):
    path = tmp_path / "my.txt"
    path.write_text(LOG)
    return path


@pytest.fixture
def town(tmp_path_factory):
    """Scenario of the first leg of the example drive."""
    text = (EXAMPLES / "town.toml").read_text(encoding="utf-8").replace("[[90.0, 110.0]]", "[]")
    path = tmp_path_factory.mktemp("scenario") / "town.toml"
    path.write_text(re.sub(r"  \{ north_m = 350.*?(?=\]\n\n\[imu\])", "", text, flags=re.DOTALL), encoding="utf-8")
    return path


@pytest.mark.parametrize("more", [(), ("--force",)])
def test_a_log_is_never_replaced_by_what_is_made_of_it(log, capsys, more):
    assert f"{log} was read by this command" in refusal_of_convert(capsys, log, log, *more)
    assert log.read_text() == LOG


def refusal_of_convert(capsys, source, target, *more):
    code, out, err = run(capsys, "convert", source, target, *HINTS, *more)
    assert (code, out) == (2, "")
    return err.splitlines()[-1]


def test_a_companion_that_exists_is_kept_and_nothing_else_is_written(tmp_path, capsys, town):
    made = answer(capsys, "simulate", town, "--out", tmp_path / "in" / "town.parquet", "--json")
    assert made["files"]["written"]
    mine = tmp_path / "t2_gnss.csv"
    mine.write_text("my notes")
    message = refusal(capsys, "convert", tmp_path / "in" / "town.parquet", tmp_path / "t2.csv", "--json")
    assert f"{mine} exists and is kept: give another name, or --force" in message
    assert sorted(p.name for p in tmp_path.iterdir()) == ["in", "t2_gnss.csv"]
    assert mine.read_text() == "my notes"
    written = answer(capsys, "convert", tmp_path / "in" / "town.parquet", tmp_path / "t2.csv", "--json", "--force")
    assert str(mine) in written["files"]["written"]
    assert mine.read_text() != "my notes"


def test_a_folder_in_place_of_a_file_is_refused_before_anything_is_written(tmp_path, capsys, town):
    (tmp_path / "town_gnss.csv").mkdir()
    for more in ((), ("--force",)):
        message = refusal(capsys, "simulate", town, "--out", tmp_path / "town.csv", "--json", *more)
        assert f"{tmp_path / 'town_gnss.csv'}: expected the name of a file to write, it is a folder" in message
        assert [p.name for p in tmp_path.iterdir()] == ["town_gnss.csv"]


def test_live_appends_to_lines_of_its_own_and_never_to_what_it_read(tmp_path, capsys, town, monkeypatch):
    answer(capsys, "simulate", town, "--out", tmp_path / "town.parquet", "--json")
    config = tmp_path / "drive.toml"
    config.write_text('[imu]\ncatalogue = "MTi-G-710"\n')
    before = {path: path.read_bytes() for path in tmp_path.iterdir()}
    call = ("live", f"replay:{tmp_path / 'town.parquet'}?speed=0", "--config", config, "--headless")
    for path in before:
        assert "expected a new file, or lines of an earlier run" in refusal(capsys, *call, "--out", f"json:{path}")
    monkeypatch.setitem(_BEGINNINGS, "json", "PAR1")  # as if the log were such lines
    assert "was read by this command" in refusal(capsys, *call, "--out", f"json:{tmp_path / 'town.parquet'}")
    assert {path: path.read_bytes() for path in tmp_path.iterdir()} == before


@pytest.mark.campaign
def test_a_run_may_be_repeated_into_its_folder(tmp_path, capsys):
    call = ("budget", EXAMPLES / "budget_town.toml", "--out", tmp_path / "run", "--no-figures", "--no-report", "--json")
    for _ in range(2):
        answer(capsys, *call)
    table = next((tmp_path / "run").glob("*.csv"))
    table.write_text("edited")
    assert f"{table} exists and is kept" in refusal(capsys, *call)
    assert table.read_text() == "edited"
    answer(capsys, *call, "--force")
    assert table.read_text() != "edited"


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="devices and limits of Linux")
def test_full_devices_are_one_sentence(log, town, tmp_path):
    call = [sys.executable, "-B", "-m", "schuler"]  # Python itself leaves cut bytecode of what it imports first here
    with open("/dev/full", "w") as full:
        done = subprocess.run(
            [*call, "info", str(log), *HINTS], stdout=full, stderr=subprocess.PIPE, text=True, check=False
        )
    assert (done.returncode, done.stderr.count("\n")) == (2, 1)
    assert "cannot be written: No space left on device" in done.stderr
    small = ["bash", "-c", 'ulimit -f 1; exec "$0" "$@"', *call, "simulate", str(town), "--out"]
    done = subprocess.run([*small, str(tmp_path / "town.csv")], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr.count("\n")) == (2, 1)
    assert "town_reference.csv: cannot be written: File too large; nothing was changed" in done.stderr
    assert sorted(p.name for p in tmp_path.iterdir()) == ["my.txt"]


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="devices and streams of Linux")
@pytest.mark.parametrize(
    ("ends", "code"), [("explain ARW >&-", 0), ("explain nothing 2>&-", 2), ("explain nothing 2>/dev/full", 2)]
)
def test_streams_that_are_closed_or_full_change_no_exit_code(ends, code):
    call = ["bash", "-c", f'"$0" -m schuler {ends}', sys.executable]
    done = subprocess.run(call, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout, done.stderr) == (code, "", "")


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="pipes with names")
@pytest.mark.parametrize("command", ["info", "check", "navigate"])
def test_a_pipe_is_refused_at_once(tmp_path, capsys, command):
    os.mkfifo(tmp_path / "pipe.csv")
    assert "expected a file or folder, it is a pipe" in refusal(capsys, command, tmp_path / "pipe.csv")


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="a folder that nobody can write to")
def test_a_place_that_cannot_be_written_is_refused_before_the_work(tmp_path, capsys):
    message = refusal(capsys, "montecarlo", tmp_path / "missing.toml", "--out", "/proc/results")
    assert "Expected a place to write to; /proc/results cannot be written" in message


def test_a_calibration_that_is_read_is_never_replaced(tmp_path, capsys):
    """The folder of an earlier calibration may be written again, but not by a command that compares with it."""
    imu = hand_log(ImuErrors(), np.random.default_rng(0), poses=20, rate_hz=50.0).rates()
    log = write_recording(Recording(imu=imu), tmp_path / "hand.parquet")[0]
    call = ("calibrate", "freepose", log, "--out", tmp_path / "unit", "--no-report", "--json")
    before = Path(answer(capsys, *call)["files"]["calibration"])
    text = before.read_text()
    for more in ((), ("--force",)):
        sentence = refusal(capsys, *call, "--previous", before, "--date", "2026-01-01", *more)
        assert f"{before} was read by this command" in sentence
    assert before.read_text() == text
