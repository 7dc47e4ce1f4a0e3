"""Columns of a magnetometer: read in any unit, held where slower, kept by parts and by files."""

from __future__ import annotations

import numpy as np
import pytest

import schuler
from schuler.exceptions import UnitError
from schuler.recording.io.columns import recognise
from schuler.units import factor_for

T = np.arange(200) / 50.0
FIELD = np.array([21.0, -3.0, 43.0])  # [uT]
IMU = "ax_m_s2,ay_m_s2,az_m_s2,gx_rad_s,gy_rad_s,gz_rad_s"


def write(path, header, magnetic, blank=None):
    lines = [f"t_s,{IMU},{header}"]
    for k, t in enumerate(T):
        m = ["" if blank is not None and k % blank else f"{x:.6f}" for x in magnetic + 0.001 * k]
        lines.append(f"{t:.3f},0.01,-0.02,-9.81,{1e-4 * (k % 3):.5f},0.0,0.0,{','.join(m)}")
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return path


@pytest.mark.parametrize(
    ("header", "scale"),
    [
        ("mag_x_ut,mag_y_ut,mag_z_ut", 1.0), ("Mag X [mG],Mag Y [mG],Mag Z [mG]", 10.0),
        ("magX (nT),magY (nT),magZ (nT)", 1e3), ("mx [G],my [G],mz [G]", 0.01), ("mx,my,mz", 1.0), ("mx,my,mz", 0.01),
        ("mx [counts],my [counts],mz [counts]", 1.0),
    ],
)  # fmt: skip
def test_a_unit_is_read_from_the_header_or_from_the_size_of_the_field(tmp_path, header, scale):
    log = schuler.read(write(tmp_path / "a.csv", header, scale * FIELD))
    if "counts" not in header:
        np.testing.assert_allclose(log.imu.magnetometer[0], 1e-6 * FIELD, rtol=1e-9)
    assert "magnetometer" in log.summary()


def test_g_is_gauss_only_for_a_field():
    assert factor_for("G", "magnetic flux density") == pytest.approx(1e-4)
    assert factor_for("mG", "magnetic flux density") == pytest.approx(1e-7)
    assert factor_for("G", "specific force") == pytest.approx(9.80665)
    with pytest.raises(UnitError):
        factor_for("uT", "specific force")
    assert recognise("magnetometer.x [nT]") == ("mx", "nT")


def test_a_slower_magnetometer_is_held_and_a_note_says_so(tmp_path):
    log = schuler.read(write(tmp_path / "a.csv", "mag_x_ut,mag_y_ut,mag_z_ut", FIELD, blank=5))
    m = log.imu.magnetometer
    np.testing.assert_array_equal(m[5:10], np.tile(m[5], (5, 1)))
    assert any("readings in 40 of 200 rows" in note for note in log.metadata.notes)


def test_an_axis_alone_is_no_magnetometer(tmp_path):
    log = schuler.read(write(tmp_path / "a.csv", "mag_x_ut,other,another", FIELD))
    assert log.imu.magnetometer is None


def test_axes_and_parts_keep_it(tmp_path):
    path = write(tmp_path / "a.csv", "mag_x_ut,mag_y_ut,mag_z_ut", FIELD)
    turned = schuler.read(path, axes="FLU", allow="norm").imu
    np.testing.assert_allclose(turned.magnetometer[0], 1e-6 * FIELD * [1.0, -1.0, -1.0], rtol=1e-9)
    imu = schuler.read(path).imu
    np.testing.assert_array_equal(imu.between(1.0, 2.0).magnetometer, imu.magnetometer[50:101])
    np.testing.assert_array_equal(imu.shifted(3.0).magnetometer, imu.magnetometer)
    C = np.array([[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    np.testing.assert_allclose(imu.rotated(C).magnetometer, imu.magnetometer @ C.T)


@pytest.mark.parametrize("suffix", [".csv", ".parquet", ".nc"])
def test_files_of_ours_keep_it_bit_for_bit(tmp_path, suffix):
    log = schuler.read(write(tmp_path / "a.csv", "mag_x_ut,mag_y_ut,mag_z_ut", FIELD))
    schuler.write(log, tmp_path / f"b{suffix}")
    again = schuler.read(tmp_path / f"b{suffix}")
    np.testing.assert_array_equal(again.imu.magnetometer, log.imu.magnetometer)


def test_arrays_are_named_by_the_hint_columns(tmp_path):
    m = np.tile(FIELD, (200, 1))
    f = np.tile([0.0, 0.0, -9.81], (200, 1))
    np.savez(tmp_path / "a.npz", acc=f, gyr=1e-3 * f, compass=m)
    log = schuler.read(
        tmp_path / "a.npz", columns="accel=acc,gyro=gyr,mag=compass", units="accel=m/s^2,gyro=rad/s,mag=uT", rate=50.0
    )
    np.testing.assert_allclose(log.imu.magnetometer, 1e-6 * m)
