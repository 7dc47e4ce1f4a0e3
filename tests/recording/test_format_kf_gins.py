"""Text files of KF-GINS: columns by hand, round trips, what is refused."""

import re
from dataclasses import replace

import numpy as np
import pytest
from format_drives import drive

from schuler.exceptions import FileFormatError, InputError
from schuler.recording.io import read, write

IMU = "\n".join(f"{100 + 0.005 * (k + 1):.4f} 1e-5 2e-5 3e-5 0.001 0.002 -0.04905" for k in range(300)) + "\n"
FIXES = "\n".join(f"{100 + k:.1f} 30.5 114.3 22.5 0.01 0.02 0.03" for k in range(3)) + "\n"
RESULTS = "\n".join(f"2300 {100 + k:.1f} 30.5 114.3 22.5 1 2 3 1 2 359" for k in range(3)) + "\n"


@pytest.fixture
def folder(tmp_path):
    for name, text in (("imu.txt", IMU), ("gnss.txt", FIXES), ("truth.nav", RESULTS), ("readme.txt", "hello\n")):
        (tmp_path / name).write_text(text)
    return tmp_path


def test_folder(folder):
    """Each file is what its columns say; the week of the results counts for all; a readme is named."""
    run = read(folder, format="kf_gins")
    assert run.imu.kind == "increment"
    np.testing.assert_allclose(run.imu.gyro[0], (1e-5, 2e-5, 3e-5))
    np.testing.assert_allclose(run.imu.accel[0], (0.001, 0.002, -0.04905))
    np.testing.assert_allclose(np.degrees(run.gnss.llh[0, :2]), (30.5, 114.3))
    np.testing.assert_allclose(np.sqrt(np.diag(run.gnss.cov_r_n[0])), (0.01, 0.02, 0.03))
    np.testing.assert_allclose(np.degrees(run.reference.rpy_nb[0]), (1.0, 2.0, -1.0), atol=1e-9)
    np.testing.assert_allclose(run.reference.v_eb_n[0], (1.0, 2.0, 3.0), atol=1e-9)
    assert run.metadata.time.epoch_gps_s == 2300 * 604_800.0
    assert run.imu.t[0] == pytest.approx(100.005)
    assert any("readme.txt" in note for note in run.metadata.notes)


def test_a_configuration_beside_shows_the_format(folder):
    (folder / "kf-gins.yaml").write_text('imupath: "imu.txt"\ngnsspath: "gnss.txt"\n')
    assert read(folder).reference is not None


def test_velocities_of_fixes(folder):
    """In 13 columns velocities stand before the 1-sigmas."""
    (folder / "gnss.txt").write_text(
        "100 30 114 20 1 2 -3 0.1 0.2 0.3 0.4 0.5 0.6\n101 30 114 20 1 2 -3 .1 .2 .3 .4 .5 .6\n"
    )
    run = read(folder / "gnss.txt", format="kf_gins", time="gps-tow:2300")
    np.testing.assert_allclose(run.gnss.v_n[0], (1, 2, -3))
    np.testing.assert_allclose(np.sqrt(np.diag(run.gnss.cov_v_n[0])), (0.4, 0.5, 0.6))


def test_one_file_without_a_week(folder):
    run = read(folder / "imu.txt", format="kf_gins")
    assert run.metadata.time.scale == "local"
    assert any("gps-tow" in note for note in run.metadata.notes)


def test_two_imus(folder):
    (folder / "other.txt").write_text(IMU)
    with pytest.raises(InputError, match=r"imu\.txt .*other\.txt"):
        read(folder, format="kf_gins")
    assert len(read(folder, format="kf_gins", streams="imu=other.txt,gnss=none").imu) == 300


def test_seven_columns_that_could_be_either(tmp_path):
    """Near latitude and longitude zero a fix and an increment look alike."""
    file = tmp_path / "x.txt"
    file.write_text("1 0.1 0.2 0.3 1 1 2\n2 0.1 0.2 0.3 1 1 2\n")
    with pytest.raises(FileFormatError, match=r"imu or gnss: say series="):
        read(file, format="kf_gins")
    assert read(file, format="kf_gins", series="gnss").gnss is not None


def test_a_result_as_one_file(tmp_path):
    run = replace(drive(), imu=None, gnss=None)
    assert write(run, tmp_path / "out.nav", format="kf_gins") == [tmp_path / "out.nav"]
    assert read(tmp_path / "out.nav", format="kf_gins").reference is not None
    with pytest.raises(InputError, match="name a folder"):
        write(drive(), tmp_path / "all.txt", format="kf_gins")
    assert [p.name for p in tmp_path.iterdir()] == ["out.nav"]


def test_end_of_a_week(tmp_path):
    """Seconds of week that start again at zero count on."""
    file = tmp_path / "gnss.txt"
    file.write_text("604799 30 114 20 1 1 1\n0 30 114 20 1 1 1\n1 30 114 20 1 1 1\n")
    run = read(file, format="kf_gins", time="gps-tow:2300")
    np.testing.assert_allclose(run.gnss.t, (604_799.0, 604_800.0, 604_801.0))


def test_faults_name_the_line(folder):
    file = folder / "imu.txt"
    file.write_text(IMU.replace("100.5000 1e-5", "100.5000 x", 1))
    with pytest.raises(FileFormatError, match=r"imu\.txt:100: column 2: expected a number"):
        read(file, format="kf_gins")
    file.write_text(IMU[:-20])
    with pytest.raises(FileFormatError, match="cut off"):
        read(file, format="kf_gins")
    assert len(read(file, format="kf_gins", allow="truncated").imu) == 299


def test_a_damaged_file_of_a_folder_is_no_other_kind_of_file(folder):
    """One bad line far down does not leave out the whole IMU."""
    lines = (folder / "imu.txt").read_text().splitlines()
    (folder / "imu.txt").write_text("\n".join([*lines[:200], "100 x 0 0 0 0 0", *lines[200:]]) + "\n")
    with pytest.raises(FileFormatError, match=r"imu\.txt:201"):
        read(folder, format="kf_gins")
    (folder / "imu.txt").write_text("\n".join(lines)[:-12])
    with pytest.raises(FileFormatError, match="truncated"):
        read(folder, format="kf_gins")
    assert len(read(folder, format="kf_gins", allow="truncated").imu) == 299


def thirteen(v, sigma, order, dt=1.0):
    """Fixes of a steady flight with velocities ``v`` and 1-sigmas, in one of the two orders."""
    n = 20
    t = 1000.0 + dt * np.arange(n)
    move = (t - t[0])[:, None] * v
    lat, lon = 30.0 + np.rad2deg(move[:, 0] / 6.35e6), 114.0 + np.rad2deg(move[:, 1] / 6.38e6 / np.cos(np.deg2rad(30)))
    place = np.column_stack((t, lat, lon, 20.0 - move[:, 2]))
    s_r, s_v = np.tile(sigma, (n, 1)), np.full((n, 3), 0.05)
    v = np.tile(v, (n, 1))
    return np.hstack((place, v, s_r, s_v) if order == "first" else (place, s_r, v, s_v))


@pytest.mark.parametrize("v", [(12.0, -3.0, 0.2), (-12.0, 3.0, 0.2), (12.0, 3.0, 0.2)])
@pytest.mark.parametrize("order", ["first", "after"])
def test_velocities_before_or_after_the_sigmas_of_position(tmp_path, v, order):
    """KF-GINS and OB-GINS put them before, KF-GINS-Matlab after; also where all are positive: a law, exact."""
    rows = thirteen(np.array(v), (0.02, 0.03, 0.05), order)
    np.savetxt(tmp_path / "gnss.txt", rows, "%.10f")
    r = read(tmp_path / "gnss.txt", format="kf_gins")
    np.testing.assert_allclose(r.gnss.v_n, np.tile(v, (20, 1)), atol=1e-9)  # printed digits
    np.testing.assert_allclose(np.sqrt(r.gnss.cov_r_n[:, [0, 1, 2], [0, 1, 2]]), [[0.02, 0.03, 0.05]] * 20, atol=1e-9)
    assert any("KF-GINS-Matlab" in note for note in r.metadata.notes) == (order == "after")


def test_thirteen_columns_that_could_be_either(tmp_path):
    """At rest with positive numbers of one size: refused, with both ways to say it; one of them is then read."""
    rows = thirteen(np.array([0.02, 0.03, 0.02]), (0.03, 0.02, 0.02), "first")
    rows[:, 1:4] = rows[0, 1:4]
    np.savetxt(tmp_path / "gnss.txt", rows, "%.10f")
    with pytest.raises(FileFormatError, match="do not tell which") as caught:
        read(tmp_path / "gnss.txt", format="kf_gins")
    columns = re.search(r"columns='(t,lat,lon,h,sn[^']*)'", str(caught.value)).group(1)
    r = read(tmp_path / "gnss.txt", columns=columns, units="angle=deg")
    np.testing.assert_allclose(r.gnss.v_n[0], [0.03, 0.02, 0.02])
