"""Files of named arrays: which is the IMU's, in what order and units, with the time and factors beside it."""

import gc
import weakref

import numpy as np
import pytest
import scipy.io
from messy_folders import simulated

import schuler
from schuler.proposal import arrays, halves, propose_reading, tables
from schuler.proposal.files import files_of
from schuler.proposal.hints import table_hints
from schuler.units import DEG, G0


@pytest.fixture(scope="module")
def imu():
    return simulated()[1].imu


def saved(path, **held):
    (np.savez if path.suffix == ".npz" else lambda p, **a: scipy.io.savemat(p, a))(path, **held)
    return path


@pytest.mark.parametrize("name", ["walk.npz", "walk.mat"])
def test_the_array_of_six_columns_is_the_imu_whatever_its_name_order_and_side(imu, tmp_path, name):
    triads = {"a": imu.accel, "g": imu.gyro}
    beside = {"timestamps": imu.t, "euler": imu.gyro, "strides": np.arange(48)}
    for order in ("ag", "ga"):
        for side in (1, -1):
            data = np.concatenate([triads[x] for x in order], axis=1)
            path = saved(tmp_path / name, data=data if side == 1 else data.T, **beside)
            files = files_of([path], {})
            assert files.entries["columns"] == ",".join(f"{x}{axis}" for x in order for axis in "xyz")
            again = schuler.read(path, **files.entries).imu
            np.testing.assert_array_equal(again.accel, imu.accel)
            np.testing.assert_array_equal(again.gyro, imu.gyro)
            np.testing.assert_allclose(again.t, imu.t, rtol=0.0, atol=1e-9)  # rounding


def test_counts_are_multiplied_by_the_factors_beside_them(imu, tmp_path):
    lsb = np.repeat([0.05 * DEG, 0.00333], 3)
    counts = np.rint(np.concatenate((imu.gyro, imu.accel / G0), axis=1) / lsb).astype(np.int16)
    path = saved(tmp_path / "counts.npz", counts=counts, lsb=lsb, t=imu.t)
    files = files_of([path], {})
    assert files.entries["scale"] == "lsb"
    assert "accel=g" in files.entries["units"]
    again = schuler.read(path, **files.entries).imu
    np.testing.assert_allclose(again.accel, imu.accel, atol=0.5 * 0.00333 * G0 * (1.0 + 1e-9))  # half a count


def test_arrays_with_names_of_sensors_get_their_units_by_physics(imu, tmp_path):
    data = np.concatenate((imu.accel, imu.gyro), axis=1)
    path = saved(tmp_path / "named.npz", acc=imu.accel / G0, gyr=imu.gyro, t=imu.t, data=data)
    files = files_of([path], {})
    assert files.entries == {"units": "accel=g,gyro=rad/s"}
    np.testing.assert_allclose(schuler.read(path, **files.entries).imu.accel, imu.accel, rtol=1e-15)  # rounding


def test_several_arrays_that_fit_are_left_to_the_reader(imu, tmp_path):
    data = np.concatenate((imu.accel, imu.gyro), axis=1)
    path = saved(tmp_path / "several.npz", left=data, right=data, t=imu.t)
    assert arrays.inertial(path) is None
    assert files_of([path], {}).entries == {}


def test_what_the_user_says_of_an_array_stands(imu, tmp_path):
    path = saved(tmp_path / "walk.npz", data=np.concatenate((imu.accel, imu.gyro), axis=1), t=imu.t)
    for given in ({"columns": "gx,gy,gz,ax,ay,az"}, {"variable": "data"}):
        assert files_of([path], given).entries == given


def test_arrays_are_not_kept_once_the_reading_is_proposed(imu, tmp_path):
    path = saved(tmp_path / "drive.npz", data=np.concatenate((imu.accel, imu.gyro), axis=1), t=imu.t)
    rows = weakref.ref(arrays.inertial(path).rows)
    propose_reading(path, files_of([path], {}).entries)
    gc.collect()
    assert rows() is None


def test_text_called_mat_is_a_table_like_others(imu, tmp_path):
    path = tmp_path / "text.mat"
    np.savetxt(path, np.column_stack((imu.t - imu.t[0], imu.accel, imu.gyro)))
    files = files_of([path], {})
    assert files.entries["columns"] == "t,ax,ay,az,gx,gy,gz"
    np.testing.assert_allclose(schuler.read(path, **files.entries).imu.gyro, imu.gyro, atol=1e-15)


def test_two_files_of_a_clock_and_three_columns_are_a_sensor_each_by_name_and_gravity(imu, tmp_path):
    t = imu.t - imu.t[0]
    np.savetxt(tmp_path / "log_acc.txt", np.column_stack((t, imu.accel)))
    np.savetxt(tmp_path / "log_gyro.txt", np.column_stack((t + 0.002, imu.gyro)))
    files = files_of([tmp_path], {})
    assert {part: e["file"] for part, e in files.entries.items()} == {"accel": "log_acc.txt", "gyro": "log_gyro.txt"}
    again = schuler.read(tmp_path, **files.entries).imu  # at the stamps of one, the other between its own
    for stamps, values, read in ((t, imu.accel, again.accel), (t + 0.002, imu.gyro, again.gyro)):
        expected = np.stack([np.interp(again.t, stamps, x) for x in values.T], axis=1)
        np.testing.assert_allclose(read, expected, atol=1e-9)  # rounding
    (tmp_path / "log_acc.txt").write_text((tmp_path / "log_gyro.txt").read_text())  # feels no gravity
    assert halves.half_of_imu(tmp_path / "log_acc.txt") is None


def test_seconds_behind_a_gps_week_are_the_clock_of_fixes_without_a_header(tmp_path):
    n = 100
    t = 604750.0 + np.arange(n)
    week = 2051 + (t >= 604800.0)
    place = np.column_stack((22.3 + 1.1e-5 * np.arange(n), 114.2 - 0.7e-5 * np.arange(n), 6.0 + np.sin(0.1 * t)))
    path = tmp_path / "truth.csv"
    np.savetxt(
        path, np.column_stack((week, t % 604800.0, place)), delimiter=",", fmt=["%d", "%d", "%.8f", "%.8f", "%.4f"]
    )
    hints, _ = table_hints(path, "reference", None)
    assert hints == {"columns": "-,t,lat,lon,h", "time": "gps-tow:2051"}
    run = schuler.read(path, series="reference", **hints)
    assert run.metadata.time.epoch_gps_s == 2051 * 604800.0
    np.testing.assert_array_equal(run.reference.t, t)
    np.savetxt(path, np.column_stack((week - 2000, t % 604800.0, place)), delimiter=",", fmt="%.8f")
    assert tables.gps_week(path) is None  # of the year 1981: a number of something else


@pytest.mark.realdata
def test_walks_in_files_of_many_arrays_need_no_hint(shared_data):
    for path in sorted((shared_data / "llio_foot").glob("*.mat")):
        assert files_of([path], {}).entries == {"columns": "ax,ay,az,gx,gy,gz", "units": "accel=m/s^2,gyro=rad/s"}


def test_columns_in_metres_are_no_specific_forces(imu, tmp_path):
    t, n = imu.t - imu.t[0], len(imu.t)
    path, names = tmp_path / "places.csv", "{0} X{1},{0} Y{1},{0} Z{1}"
    place = 4.1e6 + np.cumsum(imu.accel, axis=0)
    table = np.column_stack((t, place, np.diff(place, axis=0, prepend=0.0) * np.linspace(-1.0, 1.0, n)[:, None]))
    for units, taken in ((("", ""), True), ((" [m]", " [m/s]"), False), ((" [counts]", " [counts]"), True)):
        header = f"time [s],{names.format('Pos', units[0])},{names.format('Vel', units[1])}"
        np.savetxt(path, table, delimiter=",", header=header, comments="")
        assert (tables.imu_columns(path) is not None) == taken
