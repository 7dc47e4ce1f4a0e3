"""``schuler export c``: what it writes, what it refuses."""

from __future__ import annotations

import os
import subprocess

import c_programs
import pytest
from command import answer, refusal, run

CONFIG = """
[imu]
catalogue = "MTi-G-710"
[gnss]
lever_arm_m = [0.8, 0.0, -1.2]
[aiding.zero_velocity]
[aiding.non_holonomic]
lever_m = [-1.0, 0.0, 0.5]
[aiding.odometer]
"""
MADE = {"schuler_config.h", "schuler_config.c", "vector.csv"}


@pytest.fixture
def config(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    path = tmp_path / "drive.toml"
    path.write_text(CONFIG)
    return path


@pytest.mark.campaign
def test_without_a_log_a_simulated_drive_makes_the_vector(config, capsys):
    """The folder compiles and checks itself by make, in both precisions."""
    data = answer(capsys, "export", "c", "--config", config, "--out", "nav", "--seconds", "20", "--json")
    assert data["states"] == 18
    assert data["rate_hz"] == pytest.approx(100.0)
    assert data["samples_to_a_propagation"] == 10
    assert set(data["files"]) > MADE
    assert {p.name for p in (config.parent / "nav").iterdir()} - {".schuler.json"} == set(data["files"])
    c_programs.compiler("cc")
    make = c_programs.compiler("make")
    environment = {**os.environ, "CFLAGS": "-O0"}
    made = subprocess.run([make, "check"], cwd=config.parent / "nav", env=environment, capture_output=True, text=True)
    assert made.returncode == 0, made.stdout + made.stderr
    assert made.stdout.count("0 judged differently; 20 states compared") == 2


def test_a_log_makes_the_vector(config, capsys):
    """A log of 50 Hz: its rate, its start; the same C files, other tables."""
    town = config.parent / "town.toml"
    town.write_text(
        '[motion]\ntype = "waypoints"\nlat_deg = 48.0\nlon_deg = 11.0\nheight_m = 500.0\n'
        "waypoints = [{north_m = 0.0, east_m = 0.0, speed_m_s = 10.0, stop_s = 10.0}, "
        "{north_m = 300.0, east_m = 0.0, speed_m_s = 10.0}]\n"
        '[imu]\nrate_hz = 50.0\ncatalogue = "MTi-G-710"\n[gnss]\nlever_arm_m = [0.8, 0.0, -1.2]\n[odometer]\n'
    )
    assert run(capsys, "simulate", town, "--out", "town.parquet")[0] == 0
    data = answer(capsys, "export", "c", "town.parquet", "--config", config, "--out", "nav", "--seconds", "5", "--json")
    assert (data["rate_hz"], data["samples_to_a_propagation"]) == (pytest.approx(50.0), 5)
    c_programs.replay(c_programs.program(config.parent / "nav"))
    refused = refusal(capsys, "export", "c", "town.parquet", "--config", config, "--out", "b", "--rate-hz", "100")
    assert "the log says the sample rate" in refused


@pytest.mark.parametrize(
    ("entry", "named"),
    [
        ("gnss.coupling=tight", 'gnss.coupling = "tight"'),
        ("gnss.coupling=reset", 'gnss.coupling = "reset"'),
        ("aiding.zero_rate={}", "aiding.zero_rate"),
        ("aiding.earth_rate={}", "aiding.earth_rate"),
        ("aiding.barometer={}", "aiding.barometer"),
        ("aiding.heading={}", "aiding.heading"),
        ("filter.models.baro={sigma=10.0}", "state block baro"),
        ("filter.tune=true", "filter.tune"),
    ],
)
def test_what_it_does_not_carry_is_refused_before_anything_is_written(config, capsys, entry, named):
    message = refusal(capsys, "export", "c", "--config", config, "--out", "nav", "--set", entry)
    assert named in message
    assert "leave" in message
    assert not (config.parent / "nav").exists()


def test_aids_that_are_not_configured_are_not_there(config, capsys):
    answer(
        capsys, "export", "c", "--config", config, "--out", "nav", "--seconds", "2", "--json", "--set",
        "gnss.velocity=false", "--set", "filter.adaptive=false", "--without", "odometer", "--without", "non_holonomic",
    )  # fmt: skip
    header = (config.parent / "nav" / "schuler_config.h").read_text()
    flags = {line.split()[1][4:]: line.split()[2] for line in header.splitlines() if line.startswith("#define SCH_")}
    aids = ("HAS_POSITION", "HAS_VELOCITY", "HAS_ZUPT", "HAS_NON_HOLONOMIC", "HAS_ODOMETER", "ADAPTIVE", "N")
    assert [flags[name] for name in aids] == ["1", "0", "1", "0", "0", "0", "15"]


def test_a_length_of_nothing_is_refused(config, capsys):
    assert "positive length" in refusal(capsys, "export", "c", "--config", config, "--out", "nav", "--seconds", "0")


@pytest.mark.realdata
@pytest.mark.campaign
def test_a_car_on_the_road(shared_data, tmp_path, capsys):
    """Two minutes of the recorded drive of the documentation, in double.

    Rounding of 1e-9 m in Earth-fixed coordinates is 1e-7 of its fixes, which are good to a centimetre: 1e-6 sigma.
    """
    example = c_programs.ROOT / "examples" / "rtkexp_drive.toml"
    data = answer(
        capsys, "export", "c", shared_data / "rtkexp_drive", "--config", example, "--out", tmp_path / "nav",
        "--without", "zero_rate", "--seconds", "120", "--json",
    )  # fmt: skip
    assert data["states"] == 29
    replayed = c_programs.replay(c_programs.program(tmp_path / "nav", "-O2"), 1e-6)
    assert (replayed["compared"], replayed["judged_differently"]) == (120, 0)
