"""``schuler foot``: files, JSON, options, messages; on a simulated walk."""

import json

import numpy as np
import pytest

from schuler import units
from schuler.cli.foot import foot
from schuler.cli.reading import Reading
from schuler.exceptions import ConfigError, InputError
from schuler.navigation.foot.errors import walk_errors
from schuler.navigation.foot.figures import detector, overview, save_foot_figures, track
from schuler.navigation.foot.run import navigate_foot
from schuler.recording.formats.csv import write_csv
from schuler.recording.recording import Recording
from schuler.recording.series import ImuSeries
from schuler.recording.trajectory import Trajectory
from schuler.simulation.gait import walk
from schuler.simulation.motion import ideal_rates


@pytest.fixture(scope="module")
def recording():
    """Six strides with a little noise."""
    motion = walk([45.0 * units.DEG, 0.0, 0.0], strides=6, turn=0.3)
    t = np.arange(int(motion.duration * 200.0)) / 200.0
    omega, f = ideal_rates(motion, t)
    rng = np.random.default_rng(4)
    imu = ImuSeries(t, omega + 0.002 * rng.standard_normal(f.shape), f + 0.02 * rng.standard_normal(f.shape))
    return Recording(imu=imu, reference=Trajectory(t, motion.state(t).r_eb_e))


@pytest.fixture(scope="module")
def log(recording, tmp_path_factory):
    path = tmp_path_factory.mktemp("walk") / "walk.csv"
    write_csv(Recording(imu=recording.imu), path)
    return path


def test_json_and_files(log, tmp_path, capsys, drawn):
    assert foot(log, out=tmp_path, json=True, smooth="stride", heading=30.0) == 0
    numbers = json.loads(capsys.readouterr().out)
    assert numbers["command"] == "foot"
    assert numbers["strides"] == 6
    assert numbers["smoothing"] == "stride"
    assert numbers["distance_m"] == pytest.approx(7.8, abs=0.05)
    assert numbers["errors"] is None
    for name in ("solution", "strides", "figure_foot_track_png", "figure_foot_strides_svg", "figure_foot_overview_png"):
        assert name in numbers["files"]
    rows = (tmp_path / "strides.csv").read_text().splitlines()
    assert len(rows) == 7
    assert rows[0].startswith("start_s,stop_s")
    assert all(row.endswith(",1") for row in rows[1:])


def test_text_without_figures(log, tmp_path, capsys):
    assert foot(log, out=tmp_path, report=False, detector="ared", threshold="3e4", smooth="none") == 0
    out = capsys.readouterr().out
    assert "6 strides" in out
    assert "ared" in out
    assert not (tmp_path / "figures").exists()


def test_configuration_and_messages(log, tmp_path):
    config = tmp_path / "walk.toml"
    config.write_text("[filter]\nstates = 12\n")
    with pytest.raises(ConfigError, match="states"):
        foot(log, out=tmp_path, reading=Reading(config=config))
    with pytest.raises(InputError, match="no labels"):
        foot(log, out=tmp_path, labels="shoe")
    with pytest.raises(InputError, match="--threshold"):
        foot(log, out=tmp_path, threshold="high")
    with pytest.raises(InputError, match="no such file"):
        foot(tmp_path / "nothing.mat", out=tmp_path)


@pytest.mark.campaign
def test_figures_with_a_reference(recording, tmp_path):
    result = navigate_foot(recording)
    errors = walk_errors(result, recording.reference)
    assert errors.rms_horizontal < 0.05
    written = save_foot_figures(result, tmp_path, errors=errors, formats=("png",))
    assert {p.stem for p in written} == {
        "foot_overview", "foot_track", "foot_height", "foot_detector", "foot_strides", "foot_errors"
    }  # fmt: skip
    assert all(p.stat().st_size > 5000 for p in written)
    # the reference, turned into the axes of the estimate, lies on it
    drawn = {item.label: item for item in track(result, errors).panels[0].items}
    gap = np.hypot(
        drawn["reference"].x[-1] - drawn["smoothed"].x[-1], drawn["reference"].y[-1] - drawn["smoothed"].y[-1]
    )
    assert gap == pytest.approx(errors.end_horizontal, abs=1e-9)
    assert len(overview(result).axes) == 4
    assert result.plot(errors=errors) is not None
    with pytest.raises(InputError, match="formats"):
        save_foot_figures(result, tmp_path, formats=("gif",))
    with pytest.raises(InputError, match="no statistic"):
        detector(navigate_foot(recording, rest=result.rests.mask))
