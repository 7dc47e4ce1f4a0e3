"""Folders: entries per series, halves of an IMU, and what is found without entries."""

import numpy as np
import pytest

from schuler.exceptions import FileFormatError, InputError
from schuler.recording.io import ReadHints, read, write
from schuler.recording.io.folder import read_folder

TOW = 243_261.0
IMU = {"file": "imu.csv", "columns": "t,ax,ay,az,gx,gy,gz", "units": "m/s^2,rad/s", "time": "gps-tow:2374"}
UNITS = "t [s],ax [m/s^2],ay [m/s^2],az [m/s^2],gx [rad/s],gy [rad/s],gz [rad/s]"


@pytest.fixture
def drive(tmp_path, still):
    """A folder with an IMU log, a GNSS table in Unix time and a reference, 3 s each."""
    folder = tmp_path / "drive"
    folder.mkdir()
    still[:, 0] += TOW
    np.savetxt(folder / "imu.csv", still, delimiter=",", fmt="%.17g")
    unix = TOW + 2374 * 604_800.0 + 315_964_800.0 - 18.0
    fixes = np.column_stack((unix + np.arange(4), np.full(4, 48.5), np.full(4, 9.25), np.full(4, 300.0)))
    np.savetxt(folder / "fix.txt", fixes, fmt="%.17g")
    fixes[:, 0] = TOW + np.arange(4)
    np.savetxt(folder / "truth.txt", fixes, fmt="%.17g")
    (folder / "README").write_text("A drive.\n")
    return folder


GNSS = {"file": "fix.txt", "columns": "t,lat,lon,h", "units": "angle=deg", "time": "unix", "sigma": (1, 1, 2)}
TRUTH = {"file": "truth.txt", "columns": "t,lat,lon,h", "units": "angle=deg", "time": "gps-tow:2374"}


def test_entries_are_read_and_brought_to_one_time_base(drive, still):
    r = read(drive, imu=IMU, gnss=GNSS, reference=TRUTH)
    np.testing.assert_allclose(r.imu.t, still[:, 0], atol=1e-9)  # rounding
    np.testing.assert_allclose(r.gnss.t, TOW + np.arange(4), atol=1e-6)  # rounding of seconds since 1970
    np.testing.assert_allclose(r.reference.t, TOW + np.arange(4), atol=1e-9)  # rounding
    assert r.metadata.time.epoch_gps_s == 2374 * 604_800.0
    assert r.metadata.name == "drive"
    assert set(r.metadata.sources) == {"imu.csv", "fix.txt", "truth.txt"}
    assert r.metadata.options["gnss"]["sigma"] == (1, 1, 2)
    assert any(note.startswith("fix.txt: Unix (UTC) stamps") for note in r.metadata.notes)


def test_clocks_without_relation_are_refused(drive):
    local = {**IMU, "time": "local"}
    with pytest.raises(InputError, match="imu runs on local time"):
        read(drive, imu=local, gnss=GNSS)


def test_series_one_week_apart_share_a_time_base(drive):
    r = read(drive, imu=IMU, reference={**TRUTH, "time": "gps-tow:2375"})
    assert r.reference.t[0] == pytest.approx(TOW + 604_800.0, abs=1e-9)  # rounding


def test_the_halves_of_an_imu_are_joined(drive, still):
    np.savetxt(drive / "acc.txt", still[:, :4], fmt="%.17g")
    np.savetxt(drive / "gyr.txt", still[:, [0, 4, 5, 6]], fmt="%.17g")
    accel = {"file": "acc.txt", "columns": "t,ax,ay,az", "units": "accel=m/s^2"}
    gyro = {"file": "gyr.txt", "columns": "t,gx,gy,gz", "units": "gyro=rad/s"}
    r = read(drive, accel=accel, gyro=gyro)
    np.testing.assert_array_equal(r.imu.accel, still[:, 1:4])
    np.testing.assert_array_equal(r.imu.gyro, still[:, 4:7])
    assert not any("zero and mean nothing" in note for note in r.metadata.notes)
    np.savetxt(drive / "gyr.txt", still[1:, [0, 4, 5, 6]], fmt="%.17g")
    with pytest.raises(InputError, match=r"are the halves of one IMU; give gyro="):
        read(drive, accel=accel)


def test_sensors_with_stamps_of_their_own_are_joined_at_those_of_the_gyro(tmp_path):
    """A specific force that changes evenly is interpolated exactly; rates are left as they are. Headers of phyphox."""
    t_a, t_g = np.arange(400) * 0.01 + 0.003, np.arange(200) * 0.02
    accel = np.column_stack((t_a, 0.1 * t_a, -0.05 * t_a, np.full(400, 9.81)))
    gyro = np.column_stack((t_g, 0.1 * np.sin(t_g), 0.0 * t_g, 0.2 * np.cos(t_g)))
    for name, rows, what in (("Accelerometer", accel, "Acceleration"), ("Gyroscope", gyro, "Gyroscope")):
        unit = "m/s^2" if what == "Acceleration" else "rad/s"
        header = ",".join(['"Time (s)"', *(f'"{what} {axis} ({unit})"' for axis in "xyz")])
        np.savetxt(tmp_path / f"{name}.csv", rows, "%.17g", delimiter=",", header=header, comments="")
    halves = {"accel": {"file": "Accelerometer.csv", "axes": "FLU"}, "gyro": {"file": "Gyroscope.csv", "axes": "FLU"}}
    log = read(tmp_path, **halves)
    t = t_g[1:]  # the first rate is before the first specific force
    np.testing.assert_array_equal(log.imu.t, t)
    turn = np.array([1.0, -1.0, -1.0])
    np.testing.assert_array_equal(log.imu.gyro, gyro[1:, 1:] * turn)
    expected = np.column_stack((0.1 * t, -0.05 * t, np.full(t.size, 9.81))) * turn
    np.testing.assert_allclose(log.imu.accel, expected, atol=1e-13)  # rounding
    assert any("were interpolated to the gyro's" in note for note in log.metadata.notes)
    halves["accel"] |= {"kind": "increment", "units": "accel=m/s", "allow": "norm,magnitude"}
    with pytest.raises(FileFormatError, match="increments at the same times"):
        read(tmp_path, **halves)


def test_mistakes_in_entries_are_explained(drive):
    with pytest.raises(InputError, match="entry of a folder: 'gps' is not known"):
        read(drive, gps=GNSS)
    with pytest.raises(InputError, match=r"imu: expected an entry such as \{'file': 'NAME'"):
        read(drive, imu={"units": "g,deg/s"})
    with pytest.raises(InputError, match="imu: expected an entry such as"):
        read(drive, imu="imu.csv")
    with pytest.raises(FileFormatError, match=r"absent.csv: there is no such file"):
        read(drive, imu={"file": "absent.csv"})
    with pytest.raises(InputError, match="series='gnss', but the columns are t, ax"):
        read(drive, gnss={**IMU, "file": "imu.csv"})
    with pytest.raises(InputError, match="is a folder: give hints per file"):
        read(drive, ReadHints(units="g,deg/s"))
    with pytest.raises(FileFormatError, match="expected a folder"):
        read_folder(drive / "imu.csv")


def test_a_folder_without_entries_lists_what_it_has(drive):
    with pytest.raises(FileFormatError, match=r"found nothing recognised; not recognised: README, fix.txt, imu.csv"):
        read(drive)


def test_one_recognised_file_per_series_is_read(drive, still, run):
    (drive / "log.csv").write_text(UNITS + "\n" + (drive / "imu.csv").read_text())
    r = read(drive)
    assert len(r.imu) == 300
    assert "Files of the folder not read: README, fix.txt, imu.csv, truth.txt." in r.metadata.notes
    (drive / "log2.csv").write_text(UNITS + "\n" + (drive / "imu.csv").read_text())
    with pytest.raises(
        FileFormatError, match=r"expected one file per series, found imu: log.csv, log2.csv.* say which"
    ):
        read(drive)


def test_a_folder_of_our_own_files_is_read_without_entries(run, tmp_path):
    folder = tmp_path / "run"
    write(run, folder / "imu_gnss.csv")
    r = read(folder)
    assert len(r.imu) == len(run.imu)
    assert len(r.gnss) == len(run.gnss)
    np.testing.assert_array_equal(r.odometer.speed, run.odometer.speed)
    np.testing.assert_array_equal(r.reference.t, run.reference.t)


def test_one_series_may_be_taken_out_of_a_file_of_ours(run, drive):
    write(run, drive / "all.parquet")
    write(run, drive / "fix.pos")
    r = read(drive, imu={"file": "all.parquet"}, gnss={"file": "fix.pos"}, reference={"file": "all.parquet"})
    np.testing.assert_array_equal(r.imu.accel, run.imu.accel)
    assert r.odometer is None
    assert any("all.parquet: not used are its gnss, odometer, reference." in note for note in r.metadata.notes)
    r = read(drive, reference={"file": "fix.pos"})
    np.testing.assert_allclose(r.reference.llh, run.gnss.llh, atol=1e-6)  # printed digits
