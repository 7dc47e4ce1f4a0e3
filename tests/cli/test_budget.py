"""``schuler budget``: text, JSON, files, errors."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from schuler.cli import main

EXAMPLES = Path(__file__).parents[2] / "examples"


def run(capsys, *arguments):
    """Exit code, stdout and stderr of a command."""
    code = main([str(a) for a in arguments])
    captured = capsys.readouterr()
    return code, captured.out, captured.err


def test_budget_of_an_imu(tmp_path, capsys):
    arguments = ("--imu", "MPU-6000", "--out", tmp_path, "--time", "140", "--json")
    code, out, _ = run(capsys, "budget", EXAMPLES / "budget_town.toml", *arguments)
    data = json.loads(out)
    assert code == 0
    budget = data["budgets"][0]["budget"]
    assert budget["time_s"] == 140.0
    assert sum(v**2 for v in budget["by_source"].values()) == pytest.approx(budget["total"] ** 2, rel=1e-9)
    assert data["choices"][0]["ranking"][0]["imu"] == "MPU-6000"
    assert data["passes"] is False
    assert {p.suffix for p in tmp_path.iterdir()} == {".csv", ".png", ".svg"}
    assert (tmp_path / "budget-MPU-6000.csv").read_text().startswith("source")


def test_catalogue_against_a_requirement(tmp_path, capsys):
    arguments = ("--require", "horizontal < 10 m @ 60 s outage", "--out", tmp_path, "--no-figures")
    code, text, _ = run(capsys, "budget", EXAMPLES / "budget_town.toml", *arguments)
    assert code == 0
    assert text.index("LN-200") < text.index("flenniken-consumer")
    assert "left out, too little is known" in text
    assert [p.name for p in tmp_path.iterdir()] == ["requirement-1.csv"]


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (("--imu", "nothing"), "nothing"),
        (("--require", "speed < 1 m"), "requirement"),
        (("--imu", "LN-200", "--time", "1e9"), "time"),
    ],
)
def test_faults_say_what_to_do(tmp_path, capsys, arguments, said):
    code, _, err = run(capsys, "budget", EXAMPLES / "budget_town.toml", *arguments, "--out", tmp_path)
    assert code != 0
    assert said in err
    assert not list(tmp_path.iterdir())
