"""``schuler budget``: text, JSON, files, errors."""

import pytest
from command import answer, refusal, run
from places import EXAMPLES


def test_budget_of_an_imu(tmp_path, capsys):
    arguments = ("--imu", "MPU-6000", "--out", tmp_path, "--time", "140", "--json")
    data = answer(capsys, "budget", EXAMPLES / "budget_town.toml", *arguments)
    budget = data["budgets"][0]["budget"]
    assert budget["time_s"] == 140.0
    assert sum(v**2 for v in budget["by_source"].values()) == pytest.approx(budget["total"] ** 2, rel=1e-9)
    assert data["choices"][0]["ranking"][0]["imu"] == "MPU-6000"
    assert data["passes"] is False
    assert {p.suffix for p in tmp_path.glob("[!.]*")} == {".csv", ".png", ".svg", ".html"}
    rows = (tmp_path / "budget-MPU-6000.csv").read_text().splitlines()
    assert rows[0].startswith("source")
    assert any(row.startswith("gyro_noise_x,") for row in rows)
    assert (tmp_path / "parameters-MPU-6000.png").stat().st_size > 10_000
    assert data["files"]["report"].endswith("report.html")
    assert "MPU-6000: horizontal is" in (tmp_path / "report.html").read_text(encoding="utf-8")


def test_what_specifications_leave_out(tmp_path, capsys):
    """Asymmetry and nonlinearity are given here, misalignments by triad; noise is by axis."""
    arguments = (
        "--imu", "flenniken-tactical", "--require", "tilt < 1 deg", "--time", "140", "--asymmetry-ppm", "200",
        "--quadratic-ppm-g", "50", "--angles", "triad", "--single", "--no-figures", "--no-report", "--out", tmp_path,
    )  # fmt: skip
    code, text, _ = run(capsys, "budget", EXAMPLES / "budget_town.toml", *arguments)
    assert code == 0
    named = {line.split()[0] for line in text.splitlines() if line.split()}
    noise = [f"{t}_{n}" for t in ("gyro", "accel") for n in ("noise", "in_run_bias")]
    uneven = ["accel_asymmetry", "accel_quadratic"]
    assert {f"{n}_{a}" for n in (*noise, *uneven) for a in "xyz"} <= named
    assert sorted(p.suffix for p in tmp_path.glob("[!.]*")) == [".csv", ".csv"]


def test_catalogue_against_a_requirement(tmp_path, capsys):
    arguments = ("--require", "horizontal < 10 m @ 60 s outage", "--out", tmp_path, "--no-figures", "--no-report")
    code, text, _ = run(capsys, "budget", EXAMPLES / "budget_town.toml", *arguments)
    assert code == 0
    assert text.index("LN-200") < text.index("flenniken-consumer")
    assert "left out, too little is known" in text
    assert [p.name for p in tmp_path.glob("[!.]*")] == ["requirement-1.csv"]


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("--imu", "nothing"), "nothing"),
        (("--require", "speed < 1 m"), "requirement"),
        (("--imu", "LN-200", "--time", "1e9"), "time"),
        (("--imu", "LN-200", "--asymmetry-ppm", "-1"), "--asymmetry-ppm: expected"),
    ],
)
def test_faults_say_what_to_do(tmp_path, capsys, arguments, message):
    assert message in refusal(capsys, "budget", EXAMPLES / "budget_town.toml", *arguments, "--out", tmp_path)
    assert not list(tmp_path.iterdir())


def test_an_entry_of_the_scenario_as_an_option_is_that_of_a_file(tmp_path, capsys):
    text = (EXAMPLES / "budget_town.toml").read_text(encoding="utf-8")
    text = text.replace("outages_s = [[90.0, 150.0]]", "outages_s = [[60.0, 90.0]]").replace(
        "settle_s = 60.0", "settle_s = 30.0"
    )
    (tmp_path / "mission.toml").write_text(text, encoding="utf-8")
    arguments = ("--imu", "MPU-6000", "--no-figures", "--no-report", "--json", "--out")
    changes = ("--set", "gnss.outages_s=[[60, 90]]", "--set", "settle_s=30")
    by_file = answer(capsys, "budget", tmp_path / "mission.toml", *arguments, tmp_path / "a")
    by_option = answer(capsys, "budget", EXAMPLES / "budget_town.toml", *changes, *arguments, tmp_path / "b")
    assert by_option["budgets"] == by_file["budgets"]
    assert by_option["choices"] == by_file["choices"]
    assert by_option["budgets"][0]["budget"]["time_s"] <= 90.0
    assert by_option["sentences"][0].startswith("horizontal < 10 m @ 60 s outage: MPU-6000 reaches")


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ("states", "expected SECTION.KEY=VALUE"),
        ("start.height=1", "start.height"),
        ("name.x=1", "name is no section"),
    ],
)
def test_entries_that_a_scenario_has_not(tmp_path, capsys, change, message):
    arguments = ("--imu", "MPU-6000", "--out", tmp_path / "out", "--set", change)
    assert message in refusal(capsys, "budget", EXAMPLES / "budget_town.toml", *arguments)
