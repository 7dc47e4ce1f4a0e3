"""KITTI drives: numbers placed by hand, round trips, what is refused."""

from dataclasses import replace

import numpy as np
import pytest
from format_drives import drive

from schuler import rotation
from schuler.exceptions import FileFormatError, InputError
from schuler.recording.io import read, write


def kitti(folder, n=30, **changes):
    """A drive at rest that looks 30 degrees north of east, front 2 degrees down, left side 1 degree up."""
    (folder / "oxts" / "data").mkdir(parents=True)
    row = [49.0, 8.4, 115.0, np.radians(1), np.radians(2), np.radians(30), 3.0, 2.0, 3.2, 1.6, 0.5]
    row += [-0.342, 0.171, 9.8, 0, 0, 9.81, 0.01, 0.02, 0.03, 0, 0, 0, 0.05, 0.02, 4, 9, 6, 6, 6]
    row = [changes.get(f"c{k}", value) for k, value in enumerate(row)]
    for k in range(n):
        (folder / "oxts" / "data" / f"{k:010d}.txt").write_text(" ".join(map(str, row)) + "\n")
    stamps = [f"2011-09-26 13:02:{25 + k // 10:02d}.{k % 10}94360375" for k in range(n)]
    (folder / "oxts" / "timestamps.txt").write_text("\n".join(stamps) + "\n\n")
    return folder


def test_numbers_and_signs(tmp_path):
    """East-north-up with pitch down and yaw from east becomes north-east-down with pitch up and yaw from north."""
    run = read(kitti(tmp_path / "drive"))
    np.testing.assert_allclose(np.degrees(run.reference.rpy_nb[0]), (1.0, -2.0, 60.0), atol=1e-9)
    np.testing.assert_allclose(run.reference.v_eb_n[0], (3.0, 2.0, -0.5), atol=1e-9)
    np.testing.assert_allclose(run.imu.accel[0], (-0.342, -0.171, -9.8), atol=1e-12)
    np.testing.assert_allclose(run.imu.gyro[0], (0.01, -0.02, -0.03), atol=1e-12)
    # gravity seen by the accelerometer agrees with the attitude: the two conventions fit each other (rounded numbers)
    expected = rotation.dcm_from_rpy(run.reference.rpy_nb[0]).T @ (0.0, 0.0, -9.807)
    np.testing.assert_allclose(run.imu.accel[0], expected, atol=2e-3)
    np.testing.assert_allclose(np.diff(run.imu.t), 0.1, atol=1e-9)
    assert run.metadata.name == "drive"
    assert run.metadata.time.scale == "local"
    assert any("(30 files)" in source for source in run.metadata.sources)


def test_utc(tmp_path):
    """13:02:25 UTC on 2011-09-26 with the 15 leap seconds of that year, from the start of GPS week 1655."""
    run = read(kitti(tmp_path), time="unix")
    assert run.metadata.time.epoch_gps_s == 1655 * 604_800.0
    assert run.imu.t[0] == pytest.approx(86_400 + 13 * 3600 + 2 * 60 + 25 + 15 + 0.094360375, abs=1e-9)


def test_as_fixes(tmp_path):
    run = read(kitti(tmp_path), series="gnss")
    assert run.reference is None
    assert np.sqrt(run.gnss.cov_r_n[0, 0, 0]) == pytest.approx(0.05)
    assert any("fused" in note for note in run.metadata.notes)


def test_fixes_only(tmp_path):
    """Without reference and IMU: fixes with their accuracy, no IMU invented on the way back."""
    run = replace(drive(), imu=None, reference=None)
    write(run, tmp_path / "drive", format="kitti")
    back = read(tmp_path / "drive", series="gnss", time="unix")
    assert back.imu is None
    np.testing.assert_allclose(back.gnss.llh, run.gnss.llh, rtol=0, atol=1e-14)
    np.testing.assert_allclose(
        np.trace(back.gnss.cov_r_n, axis1=1, axis2=2), np.trace(run.gnss.cov_r_n, axis1=1, axis2=2)
    )


def test_missing_samples_keep_their_times(tmp_path):
    folder = kitti(tmp_path)
    (folder / "oxts" / "data" / "0000000003.txt").unlink()
    run = read(folder)
    assert len(run.imu) == 29
    assert run.imu.t[3] - run.imu.t[2] == pytest.approx(0.2)


def test_refused(tmp_path):
    folder = kitti(tmp_path / "a")
    (folder / "oxts" / "data" / "0000000030.txt").write_text("0\n")
    with pytest.raises(FileFormatError, match=r"0000000030\.txt: expected a file numbered 0\.\.29"):
        read(folder)
    with pytest.raises(FileFormatError, match=r"0000000000\.txt:1: expected 30 numbers, got 30 fields, field 4"):
        read(kitti(tmp_path / "b", c3="x"))
    folder = kitti(tmp_path / "c")
    (folder / "oxts" / "timestamps.txt").write_text("2011-09-26 13:02:25.5\n26.9.2011\n")
    with pytest.raises(FileFormatError, match=r"timestamps.txt:2: expected a date"):
        read(folder)
    run = drive()
    with pytest.raises(InputError, match="velocities"):
        write(
            replace(run, reference=None, gnss=replace(run.gnss, v_n=None, cov_v_n=None)), tmp_path / "d", format="kitti"
        )
    with pytest.raises(InputError, match="IMU runs"):
        write(replace(run, imu=replace(run.imu, t=run.imu.t + 5.0)), tmp_path / "d", format="kitti")
    assert not (tmp_path / "d").exists()
