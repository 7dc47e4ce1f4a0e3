"""Gravity at rest gives away wrong units; what looks like rest and what does not."""

import re

import numpy as np
import pytest

from schuler import units
from schuler.exceptions import FileFormatError
from schuler.recording.io import checks, read

COLUMNS = "t,ax,ay,az,gx,gy,gz"


@pytest.mark.parametrize(
    ("factor", "stated", "kind", "cause"),
    [
        (1.0 / units.G0, "m/s^2,rad/s", "rate", r"got 0\.998\d* m/s\^2: the numbers look like g, not m/s\^2"),
        (1.0, "g,rad/s", "rate", "the numbers look like m/s.2, not g"),
        (1000.0 / units.G0, "ug,rad/s", "rate", "the numbers look like mg, not ug"),
        (1.0, "mg,rad/s", "rate", "the numbers look like m/s.2, not mg"),
        (1.0 / units.FT, "m/s^2,rad/s", "rate", "the numbers look like ft/s.2, not m/s.2"),
        (0.01, "m/s^2,rad/s", "rate", r"the numbers look like increments \(kind='increment'"),
        (0.01 / units.G0, "g,rad/s", "rate", r"the numbers look like increments \(kind='increment'"),
        (1.0, "m/s,rad", "increment", r"the numbers look like rates, not increments \(kind='rate'\)"),
        (1.07, "m/s^2,rad/s", "rate", "an unknown scale, or a sensor that needs calibration"),
        (0.93, "m/s^2,rad/s", "rate", "an unknown scale, or a sensor that needs calibration"),
    ],
)
def test_wrong_units_are_recognised_by_gravity(table, still, factor, stated, kind, cause):
    still[:, 1:4] *= factor
    path = table(still)
    message = rf"^{re.escape(str(path))}:1: expected the specific force at rest .* to be gravity.*{cause}"
    with pytest.raises(FileFormatError, match=message + ".*pass allow='norm' if it is right"):
        read(path, columns=COLUMNS, units=stated, kind=kind)
    notes = read(path, columns=COLUMNS, units=stated, kind=kind, allow="norm").metadata.notes
    assert any("Passed over: expected the specific force at rest" in note for note in notes)


@pytest.mark.parametrize("factor", [0.955, 1.045])
def test_an_uncalibrated_sensor_within_five_percent_passes(table, still, factor):
    still[:, 1:4] *= factor * 9.81 / np.linalg.norm(still[:, 1:4], axis=1).mean()
    notes = read(table(still), columns=COLUMNS, units="m/s^2,rad/s").metadata.notes
    assert any(note.startswith("At rest (0.000..1.") for note in notes)


def test_gravity_is_checked_in_any_attitude(table, still, rng):
    direction = rng.standard_normal(3)
    still[:, 1:4] += 8.0 * direction / np.linalg.norm(direction) - still[:, 1:4].mean(axis=0)
    with pytest.raises(FileFormatError, match=r"got 7.99\d* m/s\^2"):
        read(table(still), columns=COLUMNS, units="m/s^2,rad/s")


def test_a_log_without_gravity_is_refused(table, still):
    still[:, 3] += 9.79  # what phones call linear acceleration
    with pytest.raises(FileFormatError, match=r"expected gravity in the log, got a median .*: gravity was taken out"):
        read(table(still), columns=COLUMNS, units="m/s^2,rad/s")
    assert len(read(table(still), columns=COLUMNS, units="m/s^2,rad/s", allow="norm").imu) == 300


def test_rest_is_found_after_motion_and_only_there(table, rng):
    """Ten seconds at 100 Hz: shaking, two seconds of rest with a wrong norm, shaking again."""
    n = 1000
    rows = np.zeros((n, 7))
    rows[:, 0] = np.arange(n) / 100.0
    rows[:, 1:4] = (0.0, 0.0, -9.81) + 3.0 * rng.standard_normal((n, 3))
    rows[:, 4:7] = rng.standard_normal((n, 3))
    rest = slice(400, 650)
    rows[rest, 1:4] = (0.0, 0.0, -8.0) + 0.01 * rng.standard_normal((250, 3))
    rows[rest, 4:7] = 0.001 * rng.standard_normal((250, 3))
    path = table(rows)
    with pytest.raises(FileFormatError, match=r":\d+: expected the specific force at rest \(4\."):
        read(path, columns=COLUMNS, units="m/s^2,rad/s")
    window = checks.find_rest(rows[:, 0], rows[:, 1:4], rows[:, 4:7])
    assert rest.start <= window.start < window.stop <= rest.stop
    assert checks.find_rest(rows[:400, 0], rows[:400, 1:4], rows[:400, 4:7]) is None
    notes = read(table(rows[:400]), columns=COLUMNS, units="m/s^2,rad/s").metadata.notes
    assert any("No second of rest was found" in note for note in notes)


def test_steady_rotation_is_no_rest(table, still):
    """On a rate table the specific force is steady and may be far from gravity."""
    turning = still.copy()
    turning[:, 1] += 5.0
    turning[:, 6] += 3.0
    still[:, 0] += 3.0
    rows = np.vstack((turning, still))
    assert checks.find_rest(rows[:, 0], rows[:, 1:4], rows[:, 4:7]).start >= 300
    assert any("At rest (3." in n for n in read(table(rows), columns=COLUMNS, units="m/s^2,rad/s").metadata.notes)


@pytest.mark.parametrize("per_attitude", [400, 4000])  # NumPy, and the compiled statistics of long logs
def test_a_large_zero_rate_output_is_rest(rng, per_attitude):
    """Three attitudes at rest with 20 deg/s on each axis, as cheap gyroscopes have, and turns of 60 deg/s between."""
    n = 2 * per_attitude
    turning = np.arange(n) % per_attitude >= per_attitude // 2
    f = 9.81 * np.repeat(-np.eye(3), n // 2, axis=0) + 0.01 * rng.standard_normal((3 * n // 2, 3))
    w = np.radians(20.0) + 0.001 * rng.standard_normal((3 * n // 2, 3))
    moved = np.tile(turning[:per_attitude], 3)
    f[moved] += rng.standard_normal((moved.sum(), 3))
    w[moved] += np.radians(60.0) * rng.standard_normal((moved.sum(), 3))
    t = np.arange(len(f)) / 100.0
    window = checks.find_rest(t, f, w)
    assert window is not None
    assert not moved[window].any()
    one = slice(0, per_attitude)  # gravity along one axis does not tell a bias from a turntable
    assert checks.find_rest(t[one], f[one], w[one]) is None


def test_finding_rest_trusts_no_unit(still):
    t, f, w = still[:, 0], still[:, 1:4], still[:, 4:7]
    assert checks.find_rest(t, f, w) == checks.find_rest(t, 1e-3 * f, 57.3 * w) == slice(0, 101)


def test_a_window_with_a_gap_is_no_rest(still):
    t = still[:, 0] + 100.0 * (np.arange(300) >= 50)
    assert checks.find_rest(t, still[:, 1:4], still[:, 4:7]) == slice(101, 202)


def test_stated_rest_is_used_instead_of_a_search(table, still, rng):
    still[:, 1:4] += 0.5 * rng.standard_normal((300, 3))  # too much vibration to be found
    still[:, 1:4] *= 1.1
    path = table(still)
    assert any("No second of rest" in n for n in read(path, columns=COLUMNS, units="m/s^2,rad/s").metadata.notes)
    with pytest.raises(FileFormatError, match=r"specific force at rest \(0.000..2.000 s\)"):
        read(path, columns=COLUMNS, units="m/s^2,rad/s", rest=2.0)


def test_impossible_magnitudes_may_be_allowed(table, still):
    still[150, 4] = 150.0
    path = table(still)
    with pytest.raises(FileFormatError, match=r":151: gyro reaches 150 rad/s.*pass allow='magnitude'"):
        read(path, columns=COLUMNS, units="m/s^2,rad/s")
    notes = read(path, columns=COLUMNS, units="m/s^2,rad/s", allow="magnitude").metadata.notes
    assert any("Passed over: gyro reaches 150 rad/s" in note for note in notes)


def test_magnitudes_of_increments_are_those_of_their_mean_rates(table, still):
    still[:, 1:] *= 0.01
    still[10, 4] = 1.5  # 150 rad/s over 10 ms
    with pytest.raises(FileFormatError, match=r":11: gyro reaches 150 rad/s"):
        read(table(still), columns=COLUMNS, units="m/s,rad", kind="increment")


def test_short_logs_are_read_without_a_search(table, still):
    for n in (1, 2, 9):
        assert len(read(table(still[:n]), columns=COLUMNS, units="m/s^2,rad/s").imu) == n
