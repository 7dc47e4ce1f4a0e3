"""``schuler compare``: the table, the files, and what it refuses."""

import csv
import json

import pytest
from places import EXAMPLES

from schuler.cli.compare import compare
from schuler.exceptions import ConfigError, InputError
from schuler.recording import io
from schuler.simulation.scenario import simulate

CONFIG = EXAMPLES / "town_navigation.toml"


@pytest.fixture(scope="module")
def town(tmp_path_factory):
    path = tmp_path_factory.mktemp("compare") / "town.parquet"
    io.write(simulate(EXAMPLES / "town.toml"), path)
    return path


def test_table_statistics_and_files(town, tmp_path, capsys, drawn):
    code = compare(
        town, config=CONFIG, modes="ins,loose,loose+odometer", outage=("120:140",), lengths="5,20", smooth=False,
        set_=("filter.record_s=2.0", "filter.tune=false"), out=tmp_path, json=True,
    )  # fmt: skip
    data = json.loads(capsys.readouterr().out)
    assert code == 0
    assert data["complete"]
    assert [(r["mode"], r["outages"]) for r in data["rows"]] == [
        (m, o) for o in ("none", "configured") for m in ("ins", "loose", "loose+odometer")
    ]
    assert data["windows_s"]["configured"] == [[120.0, 140.0]]
    assert [s["rows"][1]["outage_s"] for s in data["outage_statistics"]] == [20.0, 20.0]  # of the two with GNSS
    with (tmp_path / "architectures.csv").open() as file:
        assert len(list(csv.reader(file))) == 7
    for name in ("architectures.png", "outages_loose.csv", "outages_loose_odometer.svg"):
        assert (tmp_path / name).stat().st_size > 100, name
    assert set(data["files"]) >= {"table", "outages_loose", "figure_architectures_png"}


def test_text_for_people(town, tmp_path, capsys):
    assert compare(town, config=CONFIG, modes="loose", smooth=False, figures=False, out=tmp_path) == 0
    out = capsys.readouterr().out
    assert out.startswith("town: architectures and outages\nmode")
    assert "table: " in out
    assert not list(tmp_path.glob("*.png"))


def test_what_cannot_be_used_is_said(town, tmp_path):
    with pytest.raises(InputError, match="expected one of ins, reset, loose, tight"):
        compare(town, config=CONFIG, modes="both", out=tmp_path)
    with pytest.raises(InputError, match="--lengths: expected seconds"):
        compare(town, config=CONFIG, lengths="a", out=tmp_path)
    with pytest.raises(InputError, match="--outage: expected START:STOP"):
        compare(town, config=CONFIG, outage=("90",), out=tmp_path)
    with pytest.raises(ConfigError, match="no such configuration"):
        compare(town, config=tmp_path / "none.toml", out=tmp_path)
