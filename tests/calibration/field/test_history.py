"""History of a calibration: as a file, and the times from which parameters are calibrated."""

import csv

import numpy as np
import pytest

from schuler.calibration.field.history import FORMAT, FieldHistory, write_history
from schuler.exceptions import InputError
from schuler.recording.formats.parquet import read_table

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


def test_parquet_states_its_format_and_gauge(tmp_path):
    columns, meta = read_table(write_history(HISTORY, tmp_path / "h.parquet"))
    assert meta["format"] == FORMAT
    assert meta["gauge"] == "upper"
    assert meta["prior_sigma"] == {"b_a_x": 0.5, "G_g_xy": 4e-5}
    np.testing.assert_array_equal(columns["sigma_G_g_xy"], HISTORY.sigma[:, 1])
    np.testing.assert_array_equal(columns["left_b_a_x"], HISTORY.normalised[:, 0])
    with pytest.raises(InputError, match=r"ends in \.csv or \.parquet"):
        write_history(HISTORY, tmp_path / "h.xlsx")


def test_time_from_which_a_sigma_stays_below_a_share():
    assert HISTORY.reached(0.3) == {"b_a_x": 2.0, "G_g_xy": 2.0}
    assert HISTORY.reached(0.1) == {"b_a_x": np.inf, "G_g_xy": 2.0}
