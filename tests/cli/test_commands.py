"""The commands as scripts use them: JSON on stdout, prose on stderr, exit codes, files, one-line errors."""

import json
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from command import answer, refusal, run
from places import EXAMPLES, ROOT

import schuler
from schuler.cli import main
from schuler.cli.app import COMMANDS, METHODS
from schuler.exceptions import MissingExtraError
from schuler.navigation.evaluation.errors import trajectory_errors
from schuler.navigation.sections import AidingSection
from schuler.navigation.solution_tables import read_solution
from schuler.recording import io


@pytest.fixture(scope="module")
def town(tmp_path_factory):
    """The example town drive, simulated once."""
    folder = tmp_path_factory.mktemp("town")
    path = folder / "town.parquet"
    assert main(["simulate", str(EXAMPLES / "town.toml"), "--out", str(path), "--seed", "7"]) == 0
    return path


CONFIG = EXAMPLES / "town_navigation.toml"


@pytest.fixture(scope="module")
def demo(tmp_path_factory):
    """One full demo in a process of its own, as a stranger runs it."""
    folder = tmp_path_factory.mktemp("demo")
    done = subprocess.run(
        [sys.executable, "-m", "schuler", "demo", "--json", "--out", "result"],
        cwd=folder, capture_output=True, text=True, timeout=600, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout), folder / "result", done.stderr


@pytest.mark.campaign
def test_demo_shows_an_honest_filter(demo):
    numbers, _, _ = demo
    for key in ("rms_horizontal_m", "max_horizontal_outage_m", "smoothed_rms_horizontal_m", "nees_mean", "elapsed_s"):
        assert np.isfinite(numbers[key]), key
    assert numbers["smoothed_rms_horizontal_m"] < numbers["rms_horizontal_m"]
    assert 0.8 < numbers["nees_mean"] < 1.25
    assert len(numbers["outages"]) == 1
    assert numbers["max_horizontal_outage_m"] > numbers["rms_horizontal_aided_m"]
    assert numbers["complete"]


@pytest.mark.campaign
def test_demo_writes_what_it_says(demo):
    numbers, folder, _ = demo
    for name in ("report.html", "solution.parquet", "smoothed.parquet", "track.kml"):
        assert (folder / name).stat().st_size > 1000, name
    assert all((folder.parent / path).exists() for path in numbers["files"].values())
    solution, meta = read_solution(folder / "solution.parquet")
    assert len(solution) == numbers["epochs"]
    assert meta["provenance"]["schuler"] == schuler.__version__


@pytest.mark.campaign
def test_demo_with_another_seed_is_another_drive(demo, tmp_path, capsys):
    numbers = answer(capsys, "demo", "--json", "--no-report", "--seed", 5, "--out", tmp_path)
    assert numbers["seed"] == 5
    assert numbers["rms_horizontal_m"] != demo[0]["rms_horizontal_m"]
    assert not (tmp_path / "report.html").exists()


def test_simulate_repeats_with_its_seed(town, tmp_path, capsys):
    data = answer(capsys, "simulate", EXAMPLES / "town.toml", "--out", tmp_path / "a.parquet", "--seed", 7, "--json")
    assert data["seed"] == 7
    assert np.shape(data["true_errors"]["b_g"]) == (3,)
    np.testing.assert_array_equal(io.read(tmp_path / "a.parquet").imu.gyro, io.read(town).imu.gyro)


def test_info_counts_what_is_there(town, capsys):
    code, out, err = run(capsys, "info", town, "--json")
    data, recording = json.loads(out), io.read(town)
    assert (code, err) == (0, "")
    assert data["imu"]["samples"] == len(recording.imu)
    assert data["gnss"]["epochs"] == len(recording.gnss)
    assert data["reference"]["attitude"] is True
    code, out, _ = run(capsys, "info", town)
    assert code == 0
    assert f"{len(recording.imu)} samples" in out


def test_convert_round_trip_through_text(town, tmp_path, capsys):
    code, out, _ = run(capsys, "convert", town, tmp_path / "town.csv", "--json")
    assert code == 0
    written = [Path(p) for p in json.loads(out)["files"]["written"]]
    assert {p.name for p in written} == {"town.csv", "town_gnss.csv", "town_odometer.csv", "town_reference.csv"}
    code, out, _ = run(capsys, "convert", tmp_path / "town.csv", tmp_path / "back.parquet")
    assert code == 0
    np.testing.assert_allclose(
        io.read(tmp_path / "back.parquet").imu.accel, io.read(town).imu.accel, rtol=1e-12
    )  # printed digits


def test_a_plain_log_is_converted_with_hints(tmp_path, capsys):
    log = tmp_path / "drive.txt"
    rows = [f"{10 * k} 0.01 -0.02 {1.0 + 1e-4 * k:.4f} 0.5 -0.25 0.125" for k in range(300)]
    log.write_text("\n".join(rows), encoding="utf-8")
    hints = ("--columns", "t,ax,ay,az,gx,gy,gz", "--units", "g,deg/s,ms", "--axes", "FLU")
    code, _, err = run(capsys, "convert", log, tmp_path / "drive.parquet", *hints)
    assert code == 0, err
    imu = io.read(tmp_path / "drive.parquet").imu
    np.testing.assert_allclose(imu.t[1] - imu.t[0], 0.01)
    np.testing.assert_allclose(imu.accel[0], np.array([0.01, 0.02, -1.0]) * 9.80665)  # left and up are -right, -down
    np.testing.assert_allclose(imu.gyro[0], np.radians([0.5, 0.25, -0.125]))


@pytest.mark.campaign
def test_navigate_with_outages_on_the_command_line(town, tmp_path, capsys):
    numbers = answer(
        capsys, "navigate", town, "--config", CONFIG, "--out", tmp_path / "out", "--json", "--no-report",
        "--outage", "60:80", "--outage", "100:110", "--smooth", "--set", "filter.tune=false",
    )  # fmt: skip
    assert [(o["start_s"], o["stop_s"]) for o in numbers["outages"]] == [(60.0, 80.0), (100.0, 110.0)]
    assert numbers["smoothed"]["mean_outage_max_horizontal_m"] < numbers["mean_outage_max_horizontal_m"]
    assert numbers["measurements"]["position"]["accepted"] > 100
    assert sum(numbers["rejected"].values()) < 10
    assert {p.name for p in (tmp_path / "out").glob("[!.]*")} == {
        "solution.parquet", "smoothed.parquet", "track.kml", "resolved.toml", "metrics.json", "run.json", "run.log",
    }  # fmt: skip


@pytest.mark.campaign
def test_aids_and_entries_are_changed_on_the_command_line(town, tmp_path, capsys):
    common = (
        "navigate", town, "--config", CONFIG, "--out", tmp_path / "out", "--json", "--no-report", "--no-smooth",
        "--set", "filter.tune=false",
    )  # fmt: skip
    numbers = answer(
        capsys, *common, "--accept", "--aid", "zero_velocity", "--aid", "non_holonomic", "--set", "filter.states=9",
        "--set", "aiding.non_holonomic.max_turn_rate_deg_s=1",
    )  # fmt: skip
    assert numbers["states"] == 11  # and two mount angles
    assert {"zero_velocity", "lateral", "vertical"} <= set(numbers["measurements"])
    assert numbers["measurements"]["lateral"]["condition not met"] > 0
    code, out, _ = run(capsys, *common, "--coupling", "reset")
    assert code == 0
    assert set(json.loads(out)["measurements"]) == {"reset_position", "reset_velocity"}
    code, out, _ = run(capsys, *common, "--aid", "non_holonomic", "--without", "non_holonomic")
    assert "lateral" not in json.loads(out)["measurements"]


def test_gravity_and_earth_rate_are_aids_of_the_command_line(town, tmp_path, capsys):
    common = (
        "navigate", town, "--config", CONFIG, "--out", tmp_path / "out", "--json", "--no-report", "--no-smooth",
        "--set", "filter.tune=false",
    )  # fmt: skip
    code, out, err = run(capsys, *common, "--aid", "gravity", "--aid", "earth_rate")
    assert code == 0, err
    assert {"gravity", "earth_rate"} <= set(json.loads(out)["measurements"])
    code, out, err = run(capsys, *common, "--aid", "gravity", "--aid", "zero_velocity")
    assert (code, out) == (2, "")
    assert "give one of them" in err


def test_help_and_documents_name_every_aid(capsys):
    """But for known places, which have no defaults."""
    switched = set(AidingSection.model_fields) - {"rest", "fixes"}
    assert main(["navigate", "--help"]) == 0
    text = re.sub(r"[^\w,]+", " ", capsys.readouterr().out)
    listed = re.search(r"Switch an aid on, as configured or with its defaults (.*?) may be given", text).group(1)
    assert set(re.split(r", ?| or ", listed.strip())) == switched
    stated = (ROOT / "docs" / "commands.md").read_text(encoding="utf-8")
    stated = stated[stated.index("`--aid` switches") :].partition("on, as configured")[0]
    assert set(re.findall(r"`(\w+)`", stated)) == switched
    table = (ROOT / "docs" / "navigation.md").read_text(encoding="utf-8")
    assert set(re.findall(r"^\| `\[aiding\.(\w+)\]`", table, re.MULTILINE)) == switched | {"fixes"}


@pytest.mark.campaign
def test_a_wreck_has_exit_code_one_unless_it_is_accepted(town, tmp_path, capsys):
    wreck = (
        "navigate", town, "--config", CONFIG, "--out", tmp_path, "--no-report", "--no-smooth",
        "--set", "alignment.method='given'", "--set", "alignment.rpy_deg=[0.0, 0.0, 150.0]",
    )  # fmt: skip
    code, out, err = run(capsys, *wreck)
    assert code == 1, err
    assert out.startswith("verdict: FAILED")
    assert "heading at the start" in out
    assert run(capsys, *wreck, "--accept")[0] == 0
    code, out, _ = run(capsys, *wreck, "--json")
    verdict = json.loads(out)["verdict"]
    assert (code, verdict["status"]) == (1, "failed")
    assert verdict["reasons"]
    assert verdict["causes"]


def test_navigate_writes_a_report_and_prose(town, tmp_path, capsys):
    code, out, err = run(capsys, "navigate", town, "--config", CONFIG, "--out", tmp_path, "--outage-every", "50:10:60")
    assert code == 0
    assert "horizontal error against true trajectory" in out
    assert "mean normalised innovation squared" in out
    assert "report: " in out
    assert "samples at 100 Hz" in err
    assert (tmp_path / "report.html").read_text(encoding="utf-8").lstrip().startswith("<!DOCTYPE html>")
    assert not (tmp_path / "figures").exists()


@pytest.fixture
def plain(monkeypatch):
    """An installation without extras, as far as commands ask before their work."""
    monkeypatch.setattr("schuler.cli.output.missing_extra", MissingExtraError)


def test_without_extras_a_run_has_track_and_report_and_what_is_left_out_is_said_first(town, tmp_path, capsys, plain):
    options = ("--config", CONFIG, "--out", tmp_path / "o", "--no-smooth", "--figures")
    code, out, err = run(capsys, "navigate", town, *options)
    assert code == 0
    lines = err.splitlines()
    assert "no figures as files: drawing them needs matplotlib" in lines[0]
    assert "no table of the solution: writing Parquet needs pyarrow" in lines[1]
    assert "pip install 'schuler[data]'" in lines[1]
    assert {p.name for p in (tmp_path / "o").iterdir()} >= {"report.html", "track.kml"}
    assert "solution.parquet" not in out
    assert not (tmp_path / "o" / "figures").exists()


def test_without_extras_figures_that_nobody_asked_for_are_left_out(tmp_path, capsys, plain):
    files = answer(capsys, "observability", EXAMPLES / "observability_conventional.toml", "--out", tmp_path, "--json")
    assert {Path(f).suffix for f in files["files"].values()} == {".csv", ".html"}


@pytest.mark.campaign
def test_figures_are_files_where_they_are_asked_for(town, tmp_path, capsys, monkeypatch):
    # one figure of nineteen; that all of them are drawn is tests/navigation/report/test_figures.py
    monkeypatch.setattr("schuler.navigation.report.figures.save_all", lambda *_: [])
    command = ("navigate", town, "--config", CONFIG, "--out", tmp_path, "--no-report", "--figures", "--json")
    written = answer(capsys, *command, "--outage", "60:90", "--set", "filter.tune=false")["files"]
    assert not (tmp_path / "report.html").exists()
    assert (tmp_path / "figures" / "overview.png").stat().st_size > 1000
    assert {"figure_overview_png", "figure_overview_svg"} <= set(written)


def test_without_a_reference_the_antenna_is_compared_with_the_fixes(town, tmp_path, capsys):
    from dataclasses import replace

    recording = replace(io.read(town), reference=None)
    io.write(recording, tmp_path / "town.parquet")
    numbers = answer(
        capsys, "navigate", tmp_path / "town.parquet", "--config", CONFIG, "--out", tmp_path, "--json", "--no-report",
        "--smooth", "--set", "filter.tune=false",
    )  # fmt: skip
    assert numbers["reference"] == "GNSS fixes at the antenna"
    assert numbers["nees_mean"] is None
    g = recording.gnss
    fixes = schuler.Trajectory.from_geodetic(g.t, g.llh, g.v_n)
    for key, file in ((numbers, "solution"), (numbers["smoothed"], "smoothed")):
        track, meta = read_solution(tmp_path / f"{file}.parquet")
        lever = meta["provenance"]["config"]["gnss"]["lever_arm_m"]
        assert np.linalg.norm(lever) > 1.0
        rms = trajectory_errors(track.moved_by(np.array(lever)), fixes).rms_horizontal
        assert key["rms_horizontal_m"] == pytest.approx(rms, rel=1e-9)  # rounding


def test_an_interrupted_run_keeps_what_was_done(town, tmp_path, capsys, monkeypatch):
    from schuler.filtering import engine

    original, calls = engine.FilterState, []

    class Interrupting(original):
        @property
        def arrays(self):
            if self.options.smoother:  # the run itself, not one that tries a heading
                calls.append(1)
            if len(calls) == 4:  # once before the first chunk, then with each
                raise KeyboardInterrupt
            return super().arrays

    monkeypatch.setattr(engine, "_CHUNK", 3000)
    monkeypatch.setattr(engine, "FilterState", Interrupting)
    code, out, _ = run(
        capsys, "navigate", town, "--config", CONFIG, "--out", tmp_path, "--json", "--no-report", "--smooth"
    )
    numbers = json.loads(out)
    assert code == 1
    assert not numbers["complete"]
    assert numbers["epochs"] == 6000
    assert "interrupted at" in numbers["notes"][-1]
    assert len(read_solution(tmp_path / "solution.parquet")[0]) == 6000


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("navigate", "{town}", "--config", "missing.toml"), r"missing\.toml: no such"),
        (("navigate", "missing.csv", "--config", "{config}"), r"missing\.csv: no such file or folder"),
        (("navigate",), "expected a file or folder"),
        (
            ("navigate", "{town}", "--config", "{config}", "--outage", "80:60"),
            r"--outage: expected START:STOP in seconds",
        ),
        (("navigate", "{town}", "--config", "{config}", "--set", "states=21"), r"--set: expected SECTION\.KEY=VALUE"),
        (("navigate", "{town}", "--config", "{config}", "--set", "filter.state=21"), r"filter\.state\b"),
        (("navigate", "{town}", "--config", "{config}", "--aid", "nonsense"), r"aiding\.nonsense"),
        (("navigate", "{town}", "--config", "{config}", "--aid", "heading"), r"heading series"),
        (("navigate", "{town}", "--config", "{config}", "--coupling", "tight"), r"raw satellite measurements"),
        (("navigate", "{town}", "--config", "{config}", "--outage-every", "15:45"), r"expected PERIOD:LENGTH"),
        (("navigate", "{town}", "--config", "{config}", "--outage-every", "a:b"), r"expected PERIOD:LENGTH"),
        (("info", "{config}"), r"town_navigation\.toml"),
        (("convert", "{town}", "town.xyz"), r"\.xyz"),
        (("simulate", "{config}"), r"motion"),
        (("nonsense",), r"nonsense"),
        (("info", "{town}", "--nonsense"), r"--nonsense"),
    ],
)
def test_what_cannot_be_done_is_one_line_and_exit_code_2(arguments, message, town, capsys, monkeypatch):
    monkeypatch.chdir(town.parent)
    assert re.search(message, refusal(capsys, *(a.format(town=town, config=CONFIG) for a in arguments)))


def test_a_broken_configuration_is_shown_with_its_place(town, tmp_path, capsys):
    config = tmp_path / "c.toml"
    config.write_text('[imu]\ncatalogue = "MPU-6000"\n[gnss]\nleverarm_m = [0, 0, 0]\n', encoding="utf-8")
    code, _, err = run(capsys, "navigate", town, "--config", config)
    assert code == 2
    assert "gnss.leverarm_m: unknown entry; did you mean lever_arm_m?" in err


def test_help_lists_every_command(capsys):
    assert main(["--help"]) == 0
    text = capsys.readouterr().out
    assert all(re.search(rf"^\W*{name}\b", text, re.MULTILINE) for name in COMMANDS)


@pytest.mark.parametrize("name", COMMANDS)
def test_every_command_has_help_with_an_example(name, capsys):
    assert main([name, "--help"]) == 0
    text = capsys.readouterr().out
    assert f"schuler {name}" in text
    assert "Example:" in text


def options(name, capsys):
    """Long options a command has, or all of its methods, as its help shows them."""
    for call in [[name, method] for method in METHODS] if name == "calibrate" else [[name]]:
        assert main([*call, "--help"]) == 0
    return set(re.findall(r"(?<!\S)--[a-z][a-z-]*", capsys.readouterr().out))


@pytest.mark.parametrize("name", COMMANDS)
def test_documents_have_every_command_and_no_option_that_does_not_exist(name, capsys):
    text = (ROOT / "docs" / "commands.md").read_text(encoding="utf-8")
    section = text.partition(f"## `schuler {name}`")[2].partition("\n## ")[0]
    assert section, f"docs/commands.md has no section on {name}"
    assert set(re.findall(r"--[a-z][a-z-]*", section)) <= options(name, capsys) | {"--no-report"}


def test_version_is_that_of_the_package(capsys):
    assert main(["--version"]) == 0
    assert capsys.readouterr().out.strip() == schuler.__version__
