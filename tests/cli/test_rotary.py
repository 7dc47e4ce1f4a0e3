"""``schuler rotary``: text, JSON, files, page, interruption, errors."""

import _thread
import re
import tomllib

import pytest
from command import answer, run
from places import EXAMPLES

from schuler.cli.app import COMMANDS
from schuler.rotary.search.scenario import RotaryScenario

SHORT = """
name = "a minute"
runs = 1
[imu]
name = "NAV440-emulated"
rate_hz = 20.0
gyro_instability_deg_h = 0.0
[motion]
type = "static"
lat_deg = 45.0
lon_deg = 0.0
duration_s = 60.0
[rotary.schedule]
type = "dwell"
axis = "z"
positions = 4
dwell_s = 2.0
rate_deg_s = 30.0
[rotary.limits]
rate_deg_s = 60.0
axes = 2
[search]
axes = ["x", "z"]
"""


@pytest.fixture
def short(tmp_path):
    path = tmp_path / "short.toml"
    path.write_text(SHORT)
    return path


def test_without_a_search(short, capsys):
    code, out, _ = run(capsys, "rotary", short)
    assert code == 0
    assert "simulated_rotary" in out
    assert "predicted RMS against the rate" in out
    assert "best of" not in out
    assert [p.name for p in short.parent.iterdir()] == ["short.toml"]


@pytest.mark.campaign
def test_search_with_everything_written(short, tmp_path, capsys):
    folder = tmp_path / "out"
    arguments = ("--search", "--evaluations", 60, "--seed", 2, "--out", folder, "--json")
    data = answer(capsys, "rotary", short, *arguments)
    assert data["complete"] is True
    assert data["search"]["seed"] == 2
    names = {c["name"] for c in data["search"]["named"]}
    assert {"conventional", "the scenario's own", "continuous z", "dual axis 8 positions xz"} <= names
    best = data["search"]["best"]["2"]["objective"]
    assert all(best <= c["objective"] for c in data["search"]["named"] if not c["refused"])
    stems = {p.stem for p in folder.iterdir()}
    assert stems - {".schuler"} == {"errors", "rates", "schemes", "front", "best", "report", "scheme", "modulation"}
    assert all((folder / f"{name}.png").stat().st_size > 5000 for name in ("scheme", "modulation", "errors", "rates"))
    # what was found can be pasted and run
    section = tomllib.loads((folder / "best.toml").read_text())["rotary"]["schedule"]
    again = tomllib.loads(SHORT)
    again["rotary"]["schedule"] = section
    assert RotaryScenario.parse(again).rotary.schedule.build().axes.shape[0] in (1, 2)
    page = (folder / "report.html").read_text(encoding="utf-8")
    for word in ("Scheme", "Modulation", "Errors", "Rates", "Search", "times less", "For a scenario", "Options"):
        assert word in page
    assert not re.search(r'<(script|link|img)[^>]+(src|href)="http', page)


def test_a_report_alone(short, tmp_path, capsys):
    code, out, _ = run(capsys, "rotary", short, "--report", tmp_path / "page.html", "--runs", 2)
    assert code == 0
    assert "page.html" in out
    text = (tmp_path / "page.html").read_text(encoding="utf-8")
    assert "2 simulated runs" in text
    assert 'id="search"' not in text


@pytest.mark.campaign
def test_interrupted_search_is_said_and_kept(short, capsys, monkeypatch):
    import schuler.cli.rotary as command

    class Stops:
        def __init__(self, *args, **kwargs):
            self.calls = 0

        def __enter__(self):
            return self

        def __exit__(self, *args):
            return False

        def __call__(self, fraction):
            self.calls += 1
            if self.calls == 150:
                _thread.interrupt_main()

    monkeypatch.setattr(command, "progress", Stops)
    code, out, err = run(capsys, "rotary", short, "--search", "--evaluations", 300)
    assert code == 1
    assert "INTERRUPTED" in out
    assert "best of 2 axes" in out
    assert "interrupted" in err


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (("axes = 2", "axes = 3"), "give 1 or 2"),
        (("rate_deg_s = 60.0", "rate_deg_s = -60.0"), "rotary.limits.rate_deg_s"),
        (('name = "NAV440-emulated"', 'name = "NAV441"'), "NAV441"),
        (("positions = 4", "positons = 4"), "positions"),
    ],
)
def test_faults_are_one_line(short, capsys, change, message):
    short.write_text(SHORT.replace(*change, 1))
    code, _, err = run(capsys, "rotary", short, "--search", "--evaluations", 60)
    assert code != 0
    assert message in err
    assert "Traceback" not in err


def test_examples_are_checked_scenarios():
    for path in sorted(EXAMPLES.glob("rotary_*.toml")):
        scenario = RotaryScenario.load(path)
        assert scenario.space().duration == pytest.approx(scenario.motion.build().duration)
    assert COMMANDS["rotary"][2].split()[2] in {f"examples/{p.name}" for p in EXAMPLES.glob("rotary_*.toml")}
