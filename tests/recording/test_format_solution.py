"""Navigation results read as references and converted to other formats."""

from dataclasses import replace

import numpy as np
import pytest
from format_drives import WEEK, drive, same_trajectory

from schuler import units
from schuler.exceptions import FileFormatError, InputError
from schuler.recording.formats.parquet import write_table
from schuler.recording.io import read, write


def solution(path, run, **provenance):
    """The columns that ``schuler navigate`` writes."""
    T = run.reference
    columns = {
        "t_s": T.t, "lat_deg": T.llh[:, 0] / units.DEG, "lon_deg": T.llh[:, 1] / units.DEG, "height_m": T.llh[:, 2],
        **{f"v_{a}_m_s": T.v_eb_n[:, k] for k, a in enumerate(("north", "east", "down"))},
        **{f"q_eb_{c}": T.q_eb[:, k] for k, c in enumerate("wxyz")},
        **{f"{c}_ecef_m": T.r_eb_e[:, k] for k, c in enumerate("xyz")},
        **{f"sigma_{w}_{a}_{u}": np.full(len(T), s) for w, u, s in (("position", "m", 0.5), ("velocity", "m_s", 0.1))
           for a in ("north", "east", "down")},
        "yaw_deg": T.rpy_nb[:, 2] / units.DEG, "sigma_attitude_north_deg": np.full(len(T), 0.1),
        "sigma_attitude_east_deg": np.full(len(T), 0.2), "sigma_attitude_down_deg": np.full(len(T), 0.5),
    }  # fmt: skip
    return write_table(path, columns, {"format": "schuler/solution/1", "smoothed": False, "provenance": provenance})


def test_a_solution_becomes_a_reference(tmp_path):
    run = drive()
    path = solution(tmp_path / "solution.parquet", run)
    back = read(path, time=f"gps-tow:{WEEK}")
    assert back.metadata.time == run.metadata.time
    same_trajectory(back.reference, run.reference, t=0.0, r=0.0, v=1e-12, q=1e-15)
    assert read(path).metadata.time.scale == "local"


def test_printed_quaternions_are_of_norm_1_again(tmp_path):
    """Four digits leave the norm 1e-4 off; rounding to 1e-12 is all that may be left of it."""
    run = drive()
    exact = run.reference.q_eb
    run = replace(run, reference=replace(run.reference, q_eb=np.round(exact, 4)))
    back = read(solution(tmp_path / "solution.parquet", run)).reference.q_eb
    np.testing.assert_allclose(np.linalg.norm(back, axis=1), 1.0, rtol=0.0, atol=1e-12)
    np.testing.assert_allclose(back, exact, rtol=0.0, atol=2e-4)


def test_a_time_base_in_the_file_counts(tmp_path):
    run = drive()
    time = {"scale": "gps", "epoch_gps_s": WEEK * 604_800.0}
    assert read(solution(tmp_path / "a.parquet", run, time=time)).metadata.time == run.metadata.time
    with pytest.raises(FileFormatError, match="damaged"):
        read(solution(tmp_path / "b.parquet", run, time={"scale": "moon", "epoch_gps_s": 0}))


def test_as_fixes(tmp_path):
    fixes = read(solution(tmp_path / "a.parquet", drive()), series="gnss").gnss
    np.testing.assert_allclose(np.sqrt(np.diag(fixes.cov_r_n[0])), 0.5)


def test_accuracies_go_beside_an_sbet(tmp_path):
    """0.5 deg are 30 arcmin; tilts about north and east are turned to the heading."""
    run = drive()
    path = solution(tmp_path / "a.parquet", run)
    files = write(read(path, time=f"gps-tow:{WEEK}"), tmp_path / "sbet_a.out", accuracy=str(path))
    assert [f.name for f in files] == ["sbet_a.out", "smrmsg_a.out"]
    rows = np.fromfile(tmp_path / "smrmsg_a.out").reshape(-1, 10)
    np.testing.assert_allclose(rows[:, 0], run.reference.t)
    np.testing.assert_allclose(rows[0, 1:7], (0.5, 0.5, 0.5, 0.1, 0.1, 0.1))
    yaw = run.reference.rpy_nb[0, 2]
    roll = 6.0 * np.hypot(np.cos(yaw), 2.0 * np.sin(yaw))
    pitch = 6.0 * np.hypot(np.sin(yaw), 2.0 * np.cos(yaw))
    np.testing.assert_allclose(rows[0, 7:], (roll, pitch, 30.0))
    assert any("smrmsg_a.out" in note for note in read(tmp_path / "sbet_a.out").metadata.notes)
    with pytest.raises(InputError, match="1000 epochs, the reference 250"):
        write(drive(5.0), tmp_path / "sbet_b.out", accuracy=str(path))
    assert not (tmp_path / "sbet_b.out").exists()


@pytest.mark.parametrize("name", ["out.sbet", "out.tum", "out.gpx", "out.kml", "kitti", "euroc", "kf_gins", "out.nc"])
def test_results_in_every_format(tmp_path, name):
    """What ``schuler convert solution.parquet out`` does."""
    if name == "out.nc":
        pytest.importorskip("h5netcdf")
    back = read(solution(tmp_path / "a.parquet", drive(5.0)), time=f"gps-tow:{WEEK}")
    files = write(back, tmp_path / name, format=None if "." in name else name)
    assert all(path.exists() for path in files)


def test_files_are_not_taken_for_recordings(tmp_path, run):
    write(run, tmp_path / "run.parquet")
    assert read(tmp_path / "run.parquet").imu is not None
