"""Keys of JSON output that scripts rely on: never renamed. Allan, calibrate, check, montecarlo: in their own files."""

import json

import pytest
from places import EXAMPLES

from schuler.cli import main


def keys_of(capsys, *arguments, code=0):
    assert main([str(a) for a in arguments]) == code
    return json.loads(capsys.readouterr().out)


@pytest.mark.campaign
def test_demo(capsys, tmp_path):
    data = keys_of(capsys, "demo", "--json", "--out", tmp_path / "demo", "--no-report")
    assert {
        "epochs", "elapsed_s", "rms_horizontal_m", "max_horizontal_m", "nees_mean", "outages",
        "mean_outage_max_horizontal_m", "rejected", "smoothed", "files",
    } <= set(data)  # fmt: skip
    assert {"start_s", "stop_s", "max_horizontal_m"} <= set(data["outages"][0])
    assert {"rms_horizontal_m", "max_horizontal_m", "nees_mean", "outages"} <= set(data["smoothed"])


def test_budget(capsys, tmp_path):
    data = keys_of(
        capsys, "budget", EXAMPLES / "budget_town.toml", "--imu", "MPU-6000", "--json", "--out", tmp_path,
        "--no-report", "--no-figures",
    )  # fmt: skip
    squares = sum(c["value"] ** 2 for c in data["contributions"])
    assert squares == pytest.approx(data["total"] ** 2, rel=1e-9)  # sources are independent; rounding
    assert sum(c["share"] for c in data["contributions"]) == pytest.approx(1.0, rel=1e-9)
    assert {"parameter", "value", "share"} <= set(data["contributions"][0])
    assert {"imu", "passes", "value", "bottleneck"} <= set(data["ranking"][0])


def test_observability(capsys):
    data = keys_of(capsys, "observability", EXAMPLES / "observability_rotary_z_tilted.toml", "--json")
    assert {"rank", "states", "observable", "combinations", "degree"} <= set(data)
    assert sum(c["observable"] for c in data["combinations"]) == data["rank"]
    assert set(data["degree"]) == set(data["states"])
