"""Commands that write, their inputs, and runs of them in a fork: for kills, and disks that are full or read-only."""

from __future__ import annotations

import contextlib
import io
import json
import os
import shutil
import signal
import sys
import tomllib
import traceback
from pathlib import Path
from typing import NamedTuple

import numpy as np
from places import EXAMPLES
from walk_cases import noisy, rates_log, square

from schuler.calibration.freepose.simulation import hand_log
from schuler.cli import main
from schuler.files import LISTED
from schuler.recording.io import write as write_recording
from schuler.recording.recording import Recording
from schuler.recording.series import ImuSeries
from schuler.sensors.errors import ImuErrors

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
SKY = TOWN.replace("[gnss]", '[satellites]\nsystems = "GE"\n')
LAPS = TOWN.replace("lat_deg", "laps = 3\nlat_deg")
NAVIGATION = '[imu]\ncatalogue = "MTi-G-710"\n[filter]\ntune = false\n'
CAMPAIGN = """
simulation = "town.toml"
navigation = "navigation.toml"
runs = 4
[evaluation]
every_s = 2.0
settle_s = 10.0
"""
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
    "apply": "apply in/unit.yaml in/hand.parquet --out out/corrected.parquet",
    "foot": "foot in/walk.parquet --out out/walk --no-report",
    "points": "points in/sky.parquet --out out/points",
    "compare": "compare in/town.pos in/again.pos --out out/compared",
    "montecarlo": "montecarlo in/campaign.toml --batch 1 --workers 1 --engine filter --no-report --out out/runs",
    "reproduce": "reproduce flenniken text-3.7 --out out/book.html",
    "budget": f"budget {EXAMPLES / 'budget_town.toml'} --out out/budget --no-figures --no-report",
}
CHANGES = {"os.rename", "os.mkdir", "os.rmdir", "os.remove", "os.chmod", "os.truncate", "os.link", "open"}


def write_inputs(folder: Path) -> Path:
    """What the commands read."""
    for name, text in {
        "town.toml": TOWN,
        "laps.toml": LAPS,
        "sky.toml": SKY,
        "campaign.toml": CAMPAIGN,
        "navigation.toml": NAVIGATION,
        "wrong.toml": WRONG,
    }.items():
        (folder / name).write_text(text)
    for name in ("town", "laps", "sky"):
        assert main(["simulate", str(folder / f"{name}.toml"), "--out", str(folder / f"{name}.parquet")]) == 0
    rng = np.random.default_rng(0)
    hand = hand_log(ImuErrors(), rng, poses=20, rate_hz=50.0)
    write_recording(Recording(imu=hand.rates()), folder / "hand.parquet")
    t = np.arange(3000) / 50.0
    gyro, accel = 1e-4 * rng.standard_normal((2, len(t), 3))
    write_recording(Recording(imu=ImuSeries(t, gyro, accel - np.array([0.0, 0.0, 9.81]))), folder / "rest.parquet")
    motion = square()
    write_recording(Recording(imu=noisy(rates_log(motion), rng, gyro_n=1e-4, accel_n=1e-3)), folder / "walk.parquet")
    for name in ("town", "again"):
        assert main(["convert", str(folder / "town.parquet"), str(folder / f"{name}.pos")]) == 0
    calibration = ["calibrate", "freepose", str(folder / "hand.parquet"), "--no-report", "--out", str(folder / "unit")]
    assert main(calibration) == 0
    (folder / "unit" / "calibration.yaml").rename(folder / "unit.yaml")
    shutil.rmtree(folder / "unit")
    return folder


class Forked(NamedTuple):
    """How a command in a fork ended, changes of files it made, and what it said on stderr (nothing if killed)."""

    status: int
    changes: int
    message: str


def forked(folder: Path, command: str, until: int | None = None) -> Forked:
    """Run a command in a fork; it is killed before change of files number ``until``."""
    read, write = os.pipe()
    process = os.fork()
    if process == 0:
        os.close(read)
        message = io.StringIO()
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

        sys.dont_write_bytecode = True  # where files may not grow, Python 3.11 keeps cut ones
        try:
            os.chdir(folder)
            with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(message):
                sys.addaudithook(count)
                words = [str(folder / w) if w.startswith(("in/", "out/")) else w for w in command.split()]
                code = main(words)
        except BaseException:
            message.write(traceback.format_exc())
            code = 99
        with os.fdopen(write, "w") as stream:
            json.dump((made, message.getvalue()), stream)
        os._exit(code)
    os.close(write)
    with os.fdopen(read) as stream:  # read first: what is said may be more than a pipe holds
        output = stream.read()
    _, status = os.waitpid(process, 0)
    return Forked(status, *(json.loads(output) if output else (0, "")))


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
