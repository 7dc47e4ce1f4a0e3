"""How a log is read: cures of findings as hints, edits, and a configuration that says the same."""

import numpy as np
import pytest
from messy_folders import simulated, text_and_nmea

from schuler.diagnosis import diagnose_log
from schuler.exceptions import InputError
from schuler.navigation.config import NavigationConfig
from schuler.proposal import UndecidedError
from schuler.recording.io import read
from schuler.studio import reading
from schuler.studio.signals import Views, window


@pytest.fixture
def log(tmp_path):
    """Two minutes at rest in g and deg/s, which the header does not say."""
    rng = np.random.default_rng(3)
    n = 12_000
    accel = np.array([0.0, 0.0, -1.0]) + 0.002 * rng.standard_normal((n, 3))
    gyro = 0.05 * rng.standard_normal((n, 3))
    table = np.column_stack((np.arange(n) / 100.0, accel, gyro))
    path = tmp_path / "rest.csv"
    np.savetxt(path, table, delimiter=",", fmt="%.6f")
    return path


HINTS = {"columns": "t,ax,ay,az,gx,gy,gz", "units": "accel=m/s^2,gyro=deg/s"}


def test_the_cure_of_a_finding_mends_it(log):
    finding = next(f for f in diagnose_log(log, **HINTS).findings if f.code == "accel_unit")
    cure = reading.cure_of(log, finding, HINTS)
    assert "accel=g" in cure.hints["units"]
    assert HINTS["units"] == "accel=m/s^2,gyro=deg/s"  # the page's own hints stay
    assert all(f.code != "accel_unit" for f in diagnose_log(log, **cure.hints).findings)
    assert reading.cure_of(log, finding, cure.hints) is None


@pytest.mark.campaign
def test_the_answer_which_file_is_meant_leaves_the_others_of_the_folder(tmp_path):
    """Two IMUs beside fixes: after the answer columns, unit and fixes are recognised as without the other IMU."""
    _, recording = simulated(duration=60.0)
    text_and_nmea(recording, tmp_path)
    alone, _ = reading.completed(tmp_path, {})
    (tmp_path / "second.log").write_bytes((tmp_path / "board.log").read_bytes())
    with pytest.raises(UndecidedError, match="2 files hold an IMU") as question:
        reading.completed(tmp_path, {})
    _, entries = next(choice for choice in question.value.choices if choice[0] == "board.log")
    assert reading.completed(tmp_path, reading.answered({}, entries))[0] == alone
    assert set(alone) == {"imu", "gnss"}


def test_saved_hints_read_alike_and_the_rest_of_the_file_stays(log, tmp_path):
    hints = {**HINTS, "units": "accel=g,gyro=deg/s"}
    target = tmp_path / "drive.toml"
    target.write_text('[imu]\ncatalogue = "MPU-6000"  # mine\n')
    reading.save(target, hints, diagnose_log(log, **hints))
    assert reading.hints_of(target) == hints
    assert "# mine" in target.read_text()
    assert NavigationConfig.load(target).recording == hints
    np.testing.assert_array_equal(read(log, **hints).imu.accel, read(log, **reading.hints_of(target)).imu.accel)
    with pytest.raises(InputError, match="says units too"):
        reading.save(target, {"columns": HINTS["columns"]}, diagnose_log(log, **hints))


def test_edits():
    assert reading.edited({"imu": {"file": "a.csv"}}, "imu.offset", "0.5") == {"imu": {"file": "a.csv", "offset": 0.5}}
    assert reading.edited({"axes": "FLU", "rate": 100}, "axes", "") == {"rate": 100}
    with pytest.raises(InputError, match="nonsense: expected one of"):
        reading.edited({}, "nonsense", "1")


def test_the_command_says_the_same(log):
    assert reading.check_command("rest.csv", HINTS, "drive.toml") == (
        "schuler check rest.csv --columns t,ax,ay,az,gx,gy,gz --units 'accel=m/s^2,gyro=deg/s'"
    )
    assert reading.check_command("d", {"imu": {"file": "x"}}, "drive.toml") == "schuler check d --config drive.toml"


def test_signals_of_a_window_hold_the_extremes_of_the_log(log):
    views = Views()
    hints = {**HINTS, "units": "accel=g,gyro=deg/s"}
    seen = views.open(log, hints)
    assert views.open(log, dict(hints)) is seen  # not read again
    assert views.get(seen.key) is seen
    shown = window(seen, *seen.span, columns=200)
    assert [panel["label"] for panel in shown["panels"]] == ["specific force [m/s²]", "angular rate [deg/s]"]
    assert shown["whole"] is False
    y = np.array(shown["panels"][0]["curves"][2]["y"])
    z = read(log, **hints).imu.accel[:, 2]
    np.testing.assert_allclose([y.min(), y.max()], [z.min(), z.max()], rtol=1e-6)  # printed: six digits
    assert window(seen, 10.0, 11.0)["whole"] is True
    with pytest.raises(InputError, match="two times in seconds"):
        window(seen, np.nan, 3.0)
    with pytest.raises(InputError, match="no longer in memory"):
        views.get("none")
