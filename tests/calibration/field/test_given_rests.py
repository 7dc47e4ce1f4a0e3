"""Rests that are given, and the history as a file."""

from __future__ import annotations

import csv

import numpy as np
import pytest

from schuler.calibration.field.given_rests import given_rests
from schuler.calibration.field.history import FieldHistory
from schuler.calibration.field.history_file import FORMAT, write_history
from schuler.exceptions import InputError
from schuler.recording.formats.parquet import read_table
from schuler.recording.series import ImuSeries


@pytest.fixture
def imu():
    """Ten seconds at 10 Hz from 5 s on, the x rate is its own sample number."""
    n = np.arange(100.0)
    return ImuSeries(5.0 + 0.1 * n, np.outer(n, [1.0, 0.0, 0.0]), np.tile([0.0, 0.0, -9.8], (100, 1)))


def test_spans_become_samples(imu):
    """Both ends belong to a rest; closed form."""
    rests = given_rests(imu, [(5.0, 7.0), (8.0, 10.95)])
    np.testing.assert_array_equal(rests.index, [[0, 21], [30, 60]])
    np.testing.assert_allclose(rests.start, [5.0, 8.0])
    np.testing.assert_allclose(rests.stop, [7.0, 10.9])
    assert rests.mask.sum() == 51
    assert rests.method == "given"
    gyro, accel = rests.means(imu)
    np.testing.assert_allclose(gyro[:, 0], [10.0, 44.5])
    np.testing.assert_allclose(rests.gyro_bias, [27.25, 0.0, 0.0])  # median of two
    np.testing.assert_allclose(accel[0], [0.0, 0.0, -9.8])


def test_increments_are_rates_to_it(imu):
    increments = ImuSeries(imu.t, 0.1 * imu.gyro, 0.1 * imu.accel, "increment")
    np.testing.assert_allclose(given_rests(increments, [(5.0, 7.0)]).gyro_bias, [10.0, 0.0, 0.0])


@pytest.mark.parametrize(
    ("spans", "message"),
    [
        ([], "expected a start and a stop for each rest, got none"),
        ([(5.0, 6.0)], "20 samples or more in 5.00..6.00 s, got 11; the log covers 5.00..14.90 s"),
        ([(20.0, 30.0)], "got 0"),
        ([(7.0, 5.0)], "got 0"),
        ([(5.0, 8.0), (7.5, 10.0)], "overlap"),
        ([(9.0, 12.0), (5.0, 8.0)], "one after the other"),
    ],
)
def test_spans_that_cannot_be(imu, spans, message):
    with pytest.raises(InputError, match=message):
        given_rests(imu, spans)


# ------------------------------------------------------------------------------------------------ history as a file

HISTORY = FieldHistory(
    np.array([1.0, 2.0]), ("b_a_x", "G_g_xy"), np.array([[0.1, 1e-7], [1.0 / 3.0, 2e-7]]),
    np.array([[0.4, 4e-5], [0.1, 1e-6]]), np.array([0.5, 4e-5]),
)  # fmt: skip


def test_csv_loses_no_digit(tmp_path):
    path = write_history(HISTORY, tmp_path / "deep" / "h.csv")
    rows = list(csv.reader(path.read_text(encoding="utf-8").splitlines()))
    assert rows[0] == [
        "t [s]", "b_a_x [m/s^2]", "sigma_b_a_x [m/s^2]", "left_b_a_x [-]", "G_g_xy [(rad/s)/(m/s^2)]",
        "sigma_G_g_xy [(rad/s)/(m/s^2)]", "left_G_g_xy [-]",
    ]  # fmt: skip
    assert [float(v) for v in rows[2]] == [2.0, 1.0 / 3.0, 0.1, 0.2, 2e-7, 1e-6, 1e-6 / 4e-5]


def test_parquet_says_what_it_is(tmp_path):
    columns, meta = read_table(write_history(HISTORY, tmp_path / "h.parquet"))
    assert meta["format"] == FORMAT
    assert meta["gauge"] == "upper"
    assert meta["prior_sigma"] == {"b_a_x": 0.5, "G_g_xy": 4e-5}
    np.testing.assert_array_equal(columns["sigma_G_g_xy"], HISTORY.sigma[:, 1])
    np.testing.assert_array_equal(columns["left_b_a_x"], HISTORY.normalised[:, 0])
    with pytest.raises(InputError, match=r"ends in \.csv or \.parquet"):
        write_history(HISTORY, tmp_path / "h.xlsx")


def test_when_a_parameter_was_found():
    assert HISTORY.reached(0.3) == {"b_a_x": 2.0, "G_g_xy": 2.0}
    assert HISTORY.reached(0.1) == {"b_a_x": np.inf, "G_g_xy": 2.0}
