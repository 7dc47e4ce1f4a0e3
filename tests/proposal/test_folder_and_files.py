"""A folder with files beside it: those given by name come before those of the folder."""

from pathlib import Path

import numpy as np
import pytest

import schuler
from schuler.exceptions import InputError
from schuler.proposal.files import files_of

HEADS = {"imu": "t_s,ax,ay,az,gx_rad_s,gy_rad_s,gz_rad_s", "fixes": "t_s,lat_deg,lon_deg,h_m,sn_m,se_m,sd_m"}


def table(path: Path, kind: str, height: float = 300.0) -> Path:
    """Twenty seconds at rest."""
    path.parent.mkdir(parents=True, exist_ok=True)
    row = {"imu": "0.01,0.02,-9.81,0.0,0.001,0.0", "fixes": f"48.7,9.1,{height},1.5,1.5,2.5"}[kind]
    step = {"imu": 0.01, "fixes": 1.0}[kind]
    path.write_text("\n".join([HEADS[kind], *(f"{k * step:.2f},{row}" for k in range(int(20.0 / step)))]) + "\n")
    return path


@pytest.mark.parametrize("inside", [False, True])
@pytest.mark.parametrize("order", [1, -1])
def test_fixes_given_by_name_are_taken_with_the_imu_of_a_folder(tmp_path, inside, order):
    table(tmp_path / "run" / "imu.csv", "imu")
    table(tmp_path / "run" / "gps.csv", "fixes")
    fixes = table(tmp_path / ("run" if inside else "base") / "fixes.csv", "fixes", height=400.0)
    given = [tmp_path / "run", fixes][::order]
    files = files_of(given, {})
    imu, gps = ("imu.csv", "gps.csv") if inside else ("run/imu.csv", "run/gps.csv")
    assert files.log == (tmp_path / "run" if inside else tmp_path).resolve()
    assert files.entries["imu"]["file"] == imu
    assert (files.log / files.entries["gnss"]["file"]).samefile(fixes)
    assert files.ignored == [gps]
    log = schuler.propose(given, imu="phone", trials=False).recording
    np.testing.assert_allclose(log.gnss.llh[:, 2], 400.0, rtol=0, atol=1e-9)
    assert len(log.imu) == 2000


def test_a_folder_that_is_one_log_is_the_imu_beside_fixes(tmp_path):
    data = tmp_path / "flight" / "mav0" / "imu0" / "data.csv"
    data.parent.mkdir(parents=True)
    head = "#timestamp [ns]," + ",".join(f"w_RS_S_{c} [rad s^-1]" for c in "xyz")
    head += "," + ",".join(f"a_RS_S_{c} [m s^-2]" for c in "xyz")
    rows = [f"{1403636579758555392 + 5_000_000 * k},0.0,0.001,0.0,0.02,0.01,9.81" for k in range(400)]
    data.write_text("\n".join([head, *rows]) + "\n")
    fixes = table(tmp_path / "fixes.csv", "fixes")
    files = files_of([tmp_path / "flight", fixes], {})
    assert files.entries["imu"] == {"file": "flight"}
    assert files.entries["gnss"]["file"] == "fixes.csv"
    imu = schuler.read(files.log, **{name: {"file": e["file"]} for name, e in files.entries.items()}).imu
    assert len(imu) == 400


def test_two_folders_are_not_one_run(tmp_path):
    for name in ("a", "b"):
        table(tmp_path / name / "imu.csv", "imu")
    with pytest.raises(InputError, match=r"expected one folder and files of its run, got the folders .*a, .*b"):
        files_of([tmp_path / "a", tmp_path / "b"], {})
