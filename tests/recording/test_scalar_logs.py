"""Logs of a compass and a barometer: units, accuracies, and what is said when they are missing."""

import numpy as np
import pytest

from schuler.exceptions import InputError
from schuler.recording.io import read
from schuler.units import DEG

HEADINGS = [(0.0, 355.0, 2.0), (0.5, 359.5, 2.0), (1.0, 3.0, 2.5)]
HEIGHTS = [(0.0, 431.5, 0.5), (0.2, 431.25, 0.5), (0.4, 432.0, 0.75)]


def test_a_heading_log_states_its_unit(table):
    path = table(HEADINGS, header="time,heading [deg],sigma_heading [deg]")
    heading = read(path).heading
    np.testing.assert_array_equal(heading.value, np.array([355.0, 359.5, 3.0]) * DEG)
    np.testing.assert_array_equal(heading.sigma, np.array([2.0, 2.0, 2.5]) * DEG)
    rad = read(table([(t, h * DEG, s * DEG) for t, h, s in HEADINGS], header="t,hdg_rad,sheading"))
    np.testing.assert_allclose(rad.heading.value, heading.value, rtol=1e-15)  # rounding
    np.testing.assert_allclose(rad.heading.sigma, heading.sigma, rtol=1e-15)  # has the unit of the heading


def test_columns_and_accuracy_by_hints(table):
    path = table([row[:2] for row in HEADINGS])
    back = read(path, columns="t,heading", units="angle=deg", sigma_heading_deg=1.5)
    np.testing.assert_allclose(back.heading.sigma, 1.5 * DEG, rtol=1e-15)
    assert "The log has no accuracy: sigma_heading_deg is used." in back.metadata.notes
    barometer = read(table([row[:2] for row in HEIGHTS]), columns="t,h", units="length=ft", sigma_height=0.5)
    np.testing.assert_allclose(barometer.height.value, np.array([431.5, 431.25, 432.0]) * 0.3048, rtol=1e-15)
    np.testing.assert_array_equal(barometer.height.sigma, 0.5)


def test_a_barometer_log_by_its_header(table):
    path = table(HEIGHTS, header="timestamp,height [m],sh [m]")
    back = read(path)
    assert back.gnss is None
    np.testing.assert_array_equal(back.height.value, [431.5, 431.25, 432.0])
    np.testing.assert_array_equal(back.height.sigma, [0.5, 0.5, 0.75])
    assert any("a bias of the barometer" in note for note in back.metadata.notes)
    msl = read(path, height="msl", geoid_separation=48.0)
    np.testing.assert_array_equal(msl.height.value, [479.5, 479.25, 480.0])


@pytest.mark.parametrize(
    ("rows", "hints", "message"),
    [
        ([(0.0, 30.0), (1.0, 31.0)], {"columns": "t,heading"}, "a 1-sigma is needed: say sigma_heading_deg="),
        ([(0.0, 30.0), (1.0, 31.0)], {"columns": "t,h"}, "a 1-sigma is needed: say sigma_height="),
        (
            [(0.0, 3.0), (1.0, 3.1)],
            {"columns": "t,heading"},
            "may be degrees or radians: say units='angle=",
        ),
        (
            [(0.0, 3.0, 1.0), (1.0, 3.1, 0.0)],
            {"columns": "t,h,sh"},
            "log.csv:2: sh: expected a positive 1-sigma",
        ),
        ([(0.0, 30.0, 5.0)], {"columns": "t,heading,h"}, "one series per table, got columns of heading and height"),
        ([(0.0, 30.0)], {"columns": "t,h", "series": "heading"}, "series='heading', but the columns are t, h"),
        ([(0.0, 30.0)], {"columns": "t,h", "sigma_height": -1}, "sigma_height: expected a positive number, got -1"),
    ],
)
def test_what_is_missing_is_asked_for(table, rows, hints, message):
    with pytest.raises(InputError, match=message):
        read(table(rows), **hints)


def test_a_heading_beside_positions_is_left_alone_unless_asked_for(table):
    rows = [(0.0, 48.0, 11.0, 500.0, 1.0, 1.0, 2.0, 90.0), (1.0, 48.0, 11.0, 500.0, 1.0, 1.0, 2.0, 91.0)]
    path = table(rows, header="t,lat [deg],lon [deg],height [m],sn,se,sd,heading [deg]")
    back = read(path)
    assert back.gnss is not None
    assert back.heading is None
    assert any("no use to the gnss series: heading" in note for note in back.metadata.notes)
    np.testing.assert_allclose(
        read(path, series="heading", sigma_heading_deg=1.0).heading.value, np.array([90.0, 91.0]) * DEG
    )
    assert read(path, series="height", sigma_height=1.0).height.value[0] == 500.0


def test_a_folder_takes_both(table, still, tmp_path):
    table(still, header="t,ax [m/s^2],ay [m/s^2],az [m/s^2],gx [rad/s],gy [rad/s],gz [rad/s]", name="imu.csv")
    table(HEADINGS, header="t,heading [deg],sheading [deg]", name="compass.csv")
    table([row[:2] for row in HEIGHTS], header="t,h", name="baro.csv")
    recording = read(tmp_path)
    assert recording.heading is not None
    assert recording.height is None  # heights without an accuracy are not taken unasked
    named = read(tmp_path, imu={"file": "imu.csv"}, height={"file": "baro.csv", "sigma_height": 0.4})
    np.testing.assert_array_equal(named.height.sigma, 0.4)
