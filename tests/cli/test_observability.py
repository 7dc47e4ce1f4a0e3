"""``schuler observability``: text, JSON, files, formulas, logs, faults."""

import pytest
from command import answer, refusal, run
from places import EXAMPLES

LEVEL = EXAMPLES / "observability_rotary_z_level.toml"


def test_text(capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    code, out, _ = run(capsys, "observability", LEVEL)
    assert code == 0
    assert "eps_N with d_E = -w eps_N, b_E = -g eps_N" in out
    assert not list(tmp_path.iterdir())  # writes only what it is asked for


@pytest.mark.campaign
def test_json_with_formulas(capsys):
    data = answer(capsys, "observability", EXAMPLES / "observability_conventional.toml", "--symbolic", "--json")
    assert data["command"] == "observability"
    assert (data["rank"], data["rank_formal"], data["rank_useful"]) == (8, 8, 8)
    assert "b_E + eps_N*g" in data["formulas"]
    assert {"text": "b_U", "factors": {"b_U": 1.0}} in data["seen"]


@pytest.mark.campaign
def test_report_and_our_axes(capsys, tmp_path):
    arguments = ("--report", "--out", tmp_path, "--axes", "ned", "--known", "dr", "--known", "b_g")
    code, out, _ = run(capsys, "observability", EXAMPLES / "observability_rotary_y.toml", *arguments)
    assert code == 0
    assert "b_a_E - g eps_N" in out or "b_a_N + g eps_E" in out
    assert {p.name for p in tmp_path.glob("[!.]*")} == {
        "report.html",
        "states.csv",
        "observability.png",
        "observability.svg",
    }
    page = (tmp_path / "report.html").read_text()
    assert "Not determined" in page


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("nothing.toml",), "no such configuration file"),
        ((LEVEL, "--known", "colour"), "no state 'colour'"),
        ((EXAMPLES / "observability_manoeuvre.toml", "--symbolic"), "at rest"),
        ((LEVEL, "--log", "x.parquet", "--symbolic"), "--symbolic"),
        ((LEVEL, "--log", "x.parquet"), "observability_rotary_z_level.toml"),
    ],
)
def test_faults_say_what_to_do(capsys, arguments, message):
    assert message in refusal(capsys, "observability", *arguments)


@pytest.mark.campaign
def test_a_log(capsys, tmp_path):
    """The run's own transitions and measurements; the configuration is that of schuler navigate."""
    pytest.importorskip("pyarrow")
    log = tmp_path / "town.parquet"
    assert run(capsys, "simulate", EXAMPLES / "town.toml", "--out", log)[0] == 0
    data = answer(capsys, "observability", EXAMPLES / "town_navigation.toml", "--log", log, "--json")
    assert data["rank_formal"] == len(data["states"])
