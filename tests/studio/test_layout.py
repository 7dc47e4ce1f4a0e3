"""Menus of columns, units and axes: what a text log shows, and the hints that a choice makes."""

import numpy as np
import pytest

from schuler.recording.io import read
from schuler.studio.layout import axes_choices, text_columns, unit_choices, with_column, with_unit


@pytest.fixture
def log(tmp_path):
    """A log whose header names nothing that is recognised; columns: a clock in ms, specific force in g, rates."""
    rng = np.random.default_rng(1)
    rows = np.column_stack(
        (10.0 * np.arange(400), rng.standard_normal((400, 3)) * 1e-3 - (0, 0, 1), rng.standard_normal((400, 3)) * 1e-2)
    )
    path = tmp_path / "plain.csv"
    np.savetxt(path, rows, fmt="%.9g", delimiter=",", header="c1,c2,c3,c4,c5,c6,c7", comments="")
    return path


def test_columns_chosen_one_by_one_are_those_of_the_hint(log):
    hints = {}
    columns = text_columns(log, hints)
    assert [c.header for c in columns] == [f"c{k}" for k in range(1, 8)]
    assert {c.name for c in columns} == {"-"}
    assert columns[0].values == ("0", "10", "20")
    for k, name in enumerate(("t", "ax", "ay", "az", "gx", "gy", "gz")):
        hints = with_column(hints, text_columns(log, hints), k, name)
    assert hints == {"columns": "t,ax,ay,az,gx,gy,gz"}
    for group, unit in (("accel", "g"), ("gyro", "deg/s"), ("t", "ms")):
        hints = with_unit(hints, group, unit)
    assert unit_choices(hints, text_columns(log, hints))["accel"] == ("g", ("m/s^2", "g", "mg", "counts"))
    by_menus = read(log, **hints).imu
    stated = read(log, columns="t,ax,ay,az,gx,gy,gz", units="accel=g,gyro=deg/s,t=ms").imu
    assert np.array_equal(by_menus.accel, stated.accel)
    assert by_menus.t[-1] == pytest.approx(3.99)  # rounding


def test_a_name_moves_from_one_column_to_another(log):
    hints = {"columns": "t,ax,ay,az,gx,gy,gz"}
    moved = with_column(hints, text_columns(log, hints), 2, "ax")
    assert moved["columns"] == "t,-,ax,az,gx,gy,gz"
    assert with_unit({"units": "accel=g"}, "accel", "") == {}


def test_axes_are_the_24_right_handed_ones():
    axes = axes_choices()
    assert len(set(axes)) == len(axes) == 24
    assert {"FRD", "FLU", "RFU"} <= set(axes)
    assert "FRU" not in axes


def test_other_files_have_no_columns(tmp_path):
    (tmp_path / "x.bin").write_bytes(bytes(range(256)) * 50)
    assert text_columns(tmp_path / "x.bin", {}) == ()
