"""Examples in the docstrings of ``schuler.*`` are programs: they run, and give what stands below them."""

import doctest
import inspect

import numpy as np
import pytest
from places import EXAMPLES

import schuler
from schuler.cli import main

FUNCTIONS = [name for name in schuler.__all__ if inspect.isfunction(getattr(schuler, name))]
EXAMPLES_OF = [name for name in FUNCTIONS if ">>>" in (getattr(schuler, name).__doc__ or "")]
#: Functions behind a command of several; each has an example of its own.
NEEDED = {
    "apply_calibration", "calibrate_field", "calibration_certificate", "calibration_history", "campaign", "choose_imu",
    "compare_rotary", "compare_runs", "error_budget", "identify_noise", "linear_covariance", "navigate",
    "navigate_foot", "navigate_rotary", "prepare_budget", "propose", "rerun", "search_schemes", "simulate",
    "solve_points", "tune_noise",
}  # fmt: skip


#: Examples of seconds; the functions have tests of their own.
LONG = ("search_schemes", "calibrate_field", "identify_noise", "tune_noise", "navigate_rotary", "solve_points")


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """The examples, a simulated log and a run of it."""
    path = tmp_path_factory.mktemp("examples")
    (path / "examples").symlink_to(EXAMPLES, target_is_directory=True)
    schuler.write(schuler.simulate(EXAMPLES / "town.toml"), path / "town.parquet")
    config = str(EXAMPLES / "town_navigation.toml")
    options = ("--no-report", "--no-smooth", "--out", str(path / "town-solution"))
    assert main(["navigate", str(path / "town.parquet"), "--config", config, *options]) == 0
    return path


@pytest.mark.thinned(2)
@pytest.mark.parametrize("name", [pytest.param(n, marks=pytest.mark.campaign) if n in LONG else n for n in EXAMPLES_OF])
def test_example_runs_and_gives_what_it_says(name, folder, monkeypatch):
    monkeypatch.chdir(folder)
    function = getattr(schuler, name)
    parser = doctest.DocTestParser()
    globs = {"schuler": schuler, "np": np, name: function}
    example = parser.get_doctest(inspect.getdoc(function), globs, name, inspect.getsourcefile(function), 0)
    runner = doctest.DocTestRunner(optionflags=doctest.ELLIPSIS)
    report: list[str] = []
    assert runner.run(example, out=report.append).failed == 0, "".join(report)


def test_functions_behind_commands_have_examples():
    assert not NEEDED.difference(EXAMPLES_OF)
