"""``--from --to`` in commands that read a log, and logs of walks in commands that know no walks."""

import re

import numpy as np
import pytest
from command import answer, run

from schuler.exceptions import InputError
from schuler.recording import ImuSeries, OdometerSeries, Recording
from schuler.recording.io import read, write
from schuler.recording.part import cut
from schuler.recording.trajectory import Trajectory


@pytest.fixture
def recording():
    t = np.arange(1000) / 100.0
    rng = np.random.default_rng(1)
    imu = ImuSeries(t, 1e-3 * rng.standard_normal((1000, 3)), 1e-2 * rng.standard_normal((1000, 3)) - (0, 0, 9.8))
    odometer = OdometerSeries(t[::10], np.zeros(100), np.full(100, 0.1))
    return Recording(imu, odometer=odometer, reference=Trajectory(t[::50], np.full((20, 3), 4e6)))


def test_every_series_is_cut_and_a_reference_reaches_beyond(recording):
    part = cut(recording, 2.0, 4.1)
    assert (part.imu.t[0], part.imu.t[-1]) == (2.0, 4.1)
    assert (part.odometer.t[0], part.odometer.t[-1]) == (2.0, 4.1)
    assert (part.reference.t[0], part.reference.t[-1]) == (2.0, 4.5)
    assert "Only 2 to 4.1 s" in part.metadata.notes[-1]
    with pytest.raises(InputError, match="expected 0 <= FROM < TO"):
        cut(recording, 5.0, 4.0)


def test_info_check_and_convert_take_a_part(recording, tmp_path, capsys):
    write(Recording(recording.imu), tmp_path / "log.parquet")
    some = ("--from", "2", "--to", "8")
    assert answer(capsys, "info", tmp_path / "log.parquet", *some, "--json")["imu"]["samples"] == 601
    code, out, _ = run(capsys, "check", tmp_path / "log.parquet", *some)
    assert code == 0, out
    assert re.search(r"static 5 s, moving 0 s", out), out
    run(capsys, "convert", tmp_path / "log.parquet", tmp_path / "part.parquet", "--from", "2")
    assert len(read(tmp_path / "part.parquet").imu) == 800


@pytest.mark.realdata
def test_info_and_check_open_a_pyshoe_trial(shared_data, capsys):
    trial = sorted((shared_data / "pyshoe_vicon").glob("*.mat"))[0]
    assert answer(capsys, "info", trial, "--json")["imu"]["rate_hz"] == pytest.approx(200.0, rel=1e-3)
    assert run(capsys, "check", trial)[0] == 0


def test_info_opens_an_openshoe_folder(tmp_path, capsys):
    rows = ["0x1 0.0 0.0 -1.0 0.0 0.0 0.0"] * 500
    (tmp_path / "data_inert.txt").write_text("\n".join(rows) + "\n")
    assert answer(capsys, "info", tmp_path, "--json")["imu"]["samples"] == 500
