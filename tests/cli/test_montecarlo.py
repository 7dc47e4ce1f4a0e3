"""``schuler montecarlo``: what it writes and says, going on with a store, and what it refuses."""

import json

import numpy as np
import pytest
from places import EXAMPLES

from schuler.cli.montecarlo import montecarlo
from schuler.cli.output import progress, rate_text
from schuler.exceptions import InputError
from schuler.montecarlo.job import read_job
from schuler.montecarlo.navigation import lane_runs, navigation_run, runner

FILE = """
runs = 16
seed = 4
[start]
[simulation]
name = "short"
[simulation.motion]
type = "manoeuvres"
lat_deg = 48.0
lon_deg = 11.0
speed_m_s = 10.0
manoeuvres = [{ duration_s = 20.0, turn_deg = 90.0 }, { duration_s = 10.0 }]
[simulation.imu]
rate_hz = 50.0
[simulation.imu.gyro]
arw_deg_rthr = 0.5
bias_deg_hr = 100.0
[simulation.imu.accel]
vrw_m_s_rthr = 0.1
bias_mg = 3.0
[simulation.gnss]
first_s = 1.0
"""


@pytest.fixture
def scenario(tmp_path):
    path = tmp_path / "short.toml"
    path.write_text(FILE)
    return path


def test_numbers_and_files(scenario, tmp_path, capsys, drawn):
    assert montecarlo(scenario, out=tmp_path / "out", store=tmp_path / "store", workers=1, json=True) == 0
    captured = capsys.readouterr()
    data = json.loads(captured.out)
    assert "short: 16 runs; runs go through the filter in lock-step" in captured.err
    assert {"computed", "resumed", "failed", "runs_per_s", "statistics"} <= set(data)  # scripts rely on them
    assert (data["resumed"], data["failed"]) == (0, 0)
    assert (data["engine"], data["runs"], data["computed"], data["seed"]) == ("lane_runs", 16, 16, 4)
    assert data["complete"]
    assert np.shape(data["rms"]) == (30, 9)
    assert len(data["table"]["rows"]) == 9
    assert 0.3 < data["nees"]["mean"][-1] < 2.5
    assert {p.name for p in (tmp_path / "out").iterdir()} == {"errors.csv", "tenths.csv", "report.html", "figures"}
    assert set(data["files"]) >= {"errors", "tenths", "report", "figure_scatter_png", "figure_nees_svg"}
    assert sorted(p.name for p in (tmp_path / "store").iterdir()) == [".lock", "manifest.json", "runs.parquet"]


def test_text_and_going_on(scenario, tmp_path, capsys):
    options = {"out": tmp_path / "out", "store": tmp_path / "store", "workers": 1, "report": False}
    assert montecarlo(scenario, runs=8, **options) == 0
    first = capsys.readouterr().out
    assert first.startswith("lane_runs, seed 4: 8 of 8 runs, 8 of them now")
    assert "horizontal error: 50 % of the runs below" in first
    assert "NEES" in first
    with pytest.raises(InputError, match=r"already holds 8 runs of this campaign.*--resume"):
        montecarlo(scenario, **options)
    assert montecarlo(scenario, resume=True, **options) == 0
    assert "16 of 16 runs, 8 of them now" in capsys.readouterr().out
    with pytest.raises(InputError, match=r"with another seed \(4; this one is 5\)"):
        montecarlo(scenario, resume=True, seed=5, **options)
    with pytest.raises(InputError, match="of another function"):
        montecarlo(scenario, resume=True, engine="filter", **options)


def test_what_cannot_be_used_is_said(scenario, tmp_path):
    with pytest.raises(InputError, match=r"--resume: say which store"):
        montecarlo(scenario, resume=True)
    with pytest.raises(InputError, match="runs: expected a whole number of at least 1, got 0"):
        montecarlo(scenario, runs=0)


def test_one_run_has_no_scatter(scenario, tmp_path, capsys):
    assert montecarlo(scenario, runs=1, out=tmp_path / "out", workers=1) == 1
    assert "two runs or more" in capsys.readouterr().err


def test_an_interrupted_campaign_says_how_to_go_on(scenario, tmp_path, capsys, monkeypatch):
    from contextlib import contextmanager

    @contextmanager
    def stopping(*arguments, **options):
        def stop(fraction):
            if fraction > 0.4:
                raise KeyboardInterrupt

        yield stop

    monkeypatch.setattr("schuler.cli.montecarlo.progress", stopping)
    options = {"out": tmp_path / "out", "store": tmp_path / "store", "workers": 1, "batch": 4, "report": False}
    assert montecarlo(scenario, **options) == 1
    assert f"interrupted after 8 of 16 runs: what is done stays in {tmp_path / 'store'}" in (
        capsys.readouterr().err.replace("; what", ": what")
    )
    monkeypatch.undo()
    assert montecarlo(scenario, resume=True, **options) == 0


@pytest.mark.parametrize(
    ("name", "function"),
    [
        ("montecarlo_town.toml", navigation_run),
        ("montecarlo_hour.toml", lane_runs),
        ("montecarlo_tight.toml", lane_runs),
    ],
)
def test_examples(name, function, monkeypatch):
    """They are read, and run by what their comments say; the hour is cut to one lap."""
    job, file = read_job(EXAMPLES / name)
    if name == "montecarlo_hour.toml":
        motion = job.simulation.motion.model_copy(update={"laps": 1})
        job = type(job)(job.simulation.model_copy(update={"motion": motion}), job.navigation, job.start, job.evaluation)
    assert runner(job, file.engine)[0] is function
    assert len(job.plan.t) > 5
    assert file.runs >= 200


@pytest.mark.parametrize(
    ("arguments", "text"),
    [
        ((0.0, 0.0, 0.0, 1000, "runs"), "0 of 1000 runs"),
        ((0.25, 0.5, 10.0, 1000, "runs"), "500 of 1000 runs, 25 runs/s, 0:00:20 left"),
        ((0.001, 0.001, 100.0, 1000, "runs"), "1 of 1000 runs, 0.01 runs/s, 27:45:00 left"),
    ],
)
def test_rate_and_time_left(arguments, text):
    assert rate_text(*arguments) == text


def test_rate_on_a_terminal_counts_from_what_was_there(capsys, monkeypatch):
    monkeypatch.setattr("sys.stderr.isatty", lambda: True, raising=False)
    with progress("running", total=200, unit="runs") as bar:
        bar(0.5)
        bar(1.0)
    assert "running" in capsys.readouterr().err
