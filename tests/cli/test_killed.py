"""``kill -9`` of every command that writes: no half file, no lost input, and the next run removes what is hidden.

Each run is a fork of this process, killed just before a change of the file system (an audit hook counts those below the
test's folder; which one is drawn), so that no moment between two of them is left out for being short.
"""

from __future__ import annotations

import contextlib
import hashlib
import json
import os
import shutil
import signal
import sys
import tomllib
import traceback
from pathlib import Path

import numpy as np
import pytest
from places import EXAMPLES

from schuler.calibration.freepose.simulation import hand_log
from schuler.cli import main
from schuler.files import LISTED
from schuler.recording import io
from schuler.recording.recording import Recording
from schuler.recording.series import ImuSeries
from schuler.sensors.errors import ImuErrors

pytestmark = pytest.mark.skipif(not sys.platform.startswith("linux"), reason="forks, and counts changes of files")

TOWN = """
name = "short"
seed = 1
[motion]
type = "manoeuvres"
lat_deg = 48.0
lon_deg = 11.0
manoeuvres = [{ duration_s = 10.0 }, { duration_s = 10.0, speed_m_s = 10.0 }, { duration_s = 20.0, turn_deg = 90.0 }]
[imu]
rate_hz = 50.0
catalogue = "MTi-G-710"
[gnss]
"""
LAPS = TOWN.replace("lat_deg", "laps = 3\nlat_deg")
NAVIGATION = '[imu]\ncatalogue = "MTi-G-710"\n[filter]\ntune = false\n'
WRONG = '[imu]\ncatalogue = "MTi-G-710"\n[gnss]\nsigma_scale = 5.0\n'  # only a better configuration is written
#: Arguments; ``in/`` is what is read, ``out/`` what is written.
COMMANDS = {
    "convert": "convert in/town.parquet out/town.csv",
    "convert into a folder that has files": "convert in/town.parquet in/more.csv",
    "simulate": "simulate in/town.toml --out out/new.parquet",
    "check": "check in/town.parquet --report out/check.html",
    "navigate": "navigate in/town.parquet --config in/navigation.toml --out out/run --no-report",
    "init": "init in/town.parquet --out out/drive.toml --no-trials --set imu.catalogue=MTi-G-710",
    "tune": "tune in/laps.parquet --config in/wrong.toml --out out/tuned.toml",
    "allan": "allan in/rest.parquet --out out/noise --export kalibr --no-report",
    "calibrate": "calibrate freepose in/hand.parquet --out out/unit --no-report",
    "budget": f"budget {EXAMPLES / 'budget_town.toml'} --out out/budget --no-figures --no-report",
}
CHANGES = {"os.rename", "os.mkdir", "os.rmdir", "os.remove", "os.chmod", "os.truncate", "os.link", "open"}


@pytest.fixture(scope="module")
def inputs(tmp_path_factory):
    folder = tmp_path_factory.mktemp("inputs")
    for name, text in {
        "town.toml": TOWN,
        "laps.toml": LAPS,
        "navigation.toml": NAVIGATION,
        "wrong.toml": WRONG,
    }.items():
        (folder / name).write_text(text)
    for name in ("town", "laps"):
        assert main(["simulate", str(folder / f"{name}.toml"), "--out", str(folder / f"{name}.parquet")]) == 0
    rng = np.random.default_rng(0)
    hand = hand_log(ImuErrors(), rng, poses=20, rate_hz=50.0)
    io.write(Recording(imu=hand.rates()), folder / "hand.parquet")
    t = np.arange(3000) / 50.0
    gyro, accel = 1e-4 * rng.standard_normal((2, len(t), 3))
    io.write(Recording(imu=ImuSeries(t, gyro, accel - np.array([0.0, 0.0, 9.81]))), folder / "rest.parquet")
    return folder


def forked(folder: Path, command: str, until: int | None = None) -> tuple[int, int]:
    """Status of a command run in a fork, and changes of files it made; killed before change number ``until``."""
    read, write = os.pipe()
    process = os.fork()
    if process == 0:
        try:
            made, here = 0, str(folder)

            def count(event, arguments):
                nonlocal made
                if event not in CHANGES or not str(arguments[0]).startswith(here):
                    return
                if event == "open" and not (arguments[2] or 0) & (os.O_WRONLY | os.O_RDWR):
                    return
                made += 1
                if made == until:
                    os.kill(os.getpid(), signal.SIGKILL)

            os.chdir(folder)
            with open(os.devnull, "w") as quiet, contextlib.redirect_stdout(quiet), contextlib.redirect_stderr(quiet):
                sys.addaudithook(count)
                words = [str(folder / w) if w.startswith(("in/", "out/")) else w for w in command.split()]
                code = main(words)
            os.write(write, str(made).encode())
        except BaseException:
            traceback.print_exc()
            code = 99
        os._exit(code)
    os.close(write)
    _, status = os.waitpid(process, 0)
    with os.fdopen(read) as stream:
        made = int(stream.read() or 0)
    return status, made


def content(folder: Path) -> dict[str, bytes]:
    return {p.name: p.read_bytes() for p in folder.iterdir() if p.is_file()}


def visible(folder: Path) -> set[str]:
    """Files that a user sees, by their place."""
    places = {p.relative_to(folder) for p in folder.rglob("*") if p.is_file()}
    return {str(p) for p in places if not any(part.startswith(".") for part in p.parts)}


def check_complete(path: Path) -> None:
    """A file is as its kind ends."""
    raw = path.read_bytes()
    assert raw, path
    match path.suffix:
        case ".parquet":
            assert raw[:4] == raw[-4:] == b"PAR1", path
        case ".json" | ".geojson":
            json.loads(raw)
        case ".toml":
            tomllib.loads(raw.decode())
        case ".html":
            assert raw.rstrip().endswith(b"</html>"), path
        case ".csv":
            assert raw.endswith(b"\n"), path
            assert len({line.count(b",") for line in raw.splitlines() if not line.startswith(b"#")}) == 1, path
        case ".kml":
            assert raw.rstrip().endswith(b"</kml>"), path
        case _:
            assert raw.endswith(b"\n"), path


def hidden(folder: Path) -> list[Path]:
    return [p for p in folder.rglob(".*") if p.name != LISTED]


#: Kills of the commands that take seconds; five of the others. ``-m slow`` kills each ten times, a hundred in all.
FEW = {"tune": 2, "allan": 2, "budget": 2}


@pytest.mark.parametrize(
    ("name", "kills"),
    [
        *(pytest.param(name, FEW.get(name, 5), marks=pytest.mark.campaign) for name in COMMANDS),
        *(pytest.param(name, 10, marks=pytest.mark.slow) for name in COMMANDS),
    ],
)
def test_kill_9_at_any_change_of_files(name, kills, inputs, tmp_path):
    """All files of a command are there, or none; those of folders that exist one after the other, each complete."""
    command = COMMANDS[name]

    def fresh(place: str) -> Path:
        shutil.copytree(inputs, tmp_path / place / "in")
        return tmp_path / place

    folder = fresh("complete")
    status, changes = forked(folder, command)
    assert status == 0
    assert changes > 1
    expected, before = visible(folder), {f"in/{n}" for n in content(inputs)}
    assert expected > before
    digests = {n: hashlib.sha256(x).hexdigest() for n, x in content(inputs).items()}
    rng = np.random.default_rng(int.from_bytes(hashlib.sha256(name.encode()).digest()[:4], "big"))
    moments = sorted(rng.permutation(np.arange(1, changes + 1))[:kills])
    folder, killed = fresh("killed"), 0
    for moment in moments:
        status, _ = forked(folder, command, int(moment))
        killed += os.WIFSIGNALED(status) and os.WTERMSIG(status) == signal.SIGKILL
        assert {n: hashlib.sha256(x).hexdigest() for n, x in content(folder / "in").items() if n in digests} == digests
        made = visible(folder) - before
        assert made <= expected
        new = [p for p in (folder / "out").glob("*") if p.is_dir() and not p.name.startswith(".")]
        for top in new:  # a folder that a command makes is complete when it appears
            assert visible(top) == visible(tmp_path / "complete" / "out" / top.name)
        for one in made:
            check_complete(folder / one)
        if made:  # it was as good as done: begin again, so that it has something to do
            shutil.rmtree(folder)
            folder = fresh("killed")
    assert killed == len(moments)
    status, _ = forked(folder, command)
    assert status == 0
    assert visible(folder) == expected
    assert hidden(folder) == []
    print(f"{name}: killed {killed} times at {changes} changes of files")
