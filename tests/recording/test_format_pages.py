"""Every Python example on the pages of data sets and of exchange files runs, on files the other tests make."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
import test_format_euroc as euroc
import test_format_kf_gins as kf_gins
import test_format_kitti as kitti
import test_format_mat as mat
import test_format_phones as phones
import test_format_sbet as sbet
import test_format_simulators as simulators
import test_format_solution as solution
import test_format_tum_gpx as tum
import test_format_waypoint as waypoint
from format_drives import drive

import schuler
from schuler.recording.formats import registry

DOCS = Path(__file__).resolve().parents[2] / "docs"
PAGES = ("formats-datasets.md", "formats-exchange.md")


def examples() -> list:
    found = []
    for page in PAGES:
        text = (DOCS / page).read_text(encoding="utf-8")
        for section in re.split(r"^## ", text, flags=re.MULTILINE)[1:]:
            blocks = re.findall(r"```python\n(.*?)```", section, re.DOTALL)
            found += [pytest.param("".join(blocks), id=section.splitlines()[0])] if blocks else []
    return found


@pytest.fixture
def files(tmp_path, monkeypatch):
    """All the files that the pages name, in the working folder."""
    pytest.importorskip("h5netcdf")
    import h5py

    for name in ("MH_01_easy", "dataset", "segment", "results", "phone"):
        (tmp_path / name).mkdir()
    euroc.data_set(tmp_path / "MH_01_easy", "comment: VI-Sensor IMU (ADIS16448)\n")
    kitti.kitti(tmp_path / "2011_09_26_drive_0005_sync")
    (tmp_path / "groundtruth.txt").write_text(tum.HEAD + tum.ROWS)
    (tmp_path / "dataset" / "imu.txt").write_text(kf_gins.IMU)
    (tmp_path / "dataset" / "gnss.txt").write_text(kf_gins.FIXES)
    mat.navego(tmp_path / "navego.mat")
    mat.psins(tmp_path / "trj.mat")
    simulators.comma2k19(tmp_path / "segment")
    simulators.gnss_ins_sim(tmp_path / "results")
    phones.gnss_logger(tmp_path / "gnss_log.txt")
    phones.sensor_logger(tmp_path / "phone")
    solution.solution(tmp_path / "smoothed.parquet", drive(8.0))
    (tmp_path / "sbet_mission.out").write_bytes(sbet.records()[0])
    schuler.write(drive(), tmp_path / "span.imr")
    waypoint.export(tmp_path / "export.txt")
    schuler.write(drive(), tmp_path / "drive.nc")
    with h5py.File(tmp_path / "log.h5", "w") as file:
        imu = drive().imu
        for name, values in {"imu/time": imu.t, "imu/acc": imu.accel, "imu/gyr": imu.gyro}.items():
            file[name] = np.asarray(values)
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.mark.parametrize("code", examples())
def test_examples_run(files, code):
    exec(compile(code, "<example>", "exec"), {"schuler": schuler})


def test_every_format_is_on_a_page():
    """Formats of this group are named where they are described."""
    text = "".join((DOCS / page).read_text(encoding="utf-8") for page in PAGES).lower()
    words = {
        "euroc": "euroc", "kitti": "kitti", "kf_gins": "kf-gins", "sbet": "sbet", "netcdf": "netcdf", "tum": "tum",
        "solution": "solution.parquet", "navego": "navego", "psins": "psins", "gnss_ins_sim": "gnss-ins-sim",
        "comma2k19": "comma2k19", "imr": "imr", "waypoint": "waypoint", "android": "gnsslogger",
        "sensor_logger": "sensor logger",
    }  # fmt: skip
    assert words.keys() <= {name for name, _ in registry.FORMATS}
    assert all(word in text for word in words.values())


@pytest.mark.parametrize(
    ("name", "module", "expected"),
    [
        ("MH_01_easy", "euroc", {"imu0": ("imu", 400, 200.0), "state_groundtruth_estimate0": ("reference", 40, 20.0)}),
        ("navego.mat", "navego", {"imu1": ("imu", 1000, 50.0), "gnss": ("gnss", 20, 1.0)}),
        ("gnss_log.txt", "android", {"UncalGyro": ("imu", 400, 50.0), "NLP": ("gnss", 2, 1 / 3)}),
    ],
)  # fmt: skip
def test_contents(files, name, module, expected):
    """What ``schuler info`` lists: parts, numbers, rates."""
    found = {s.name: (s.part, s.count, s.rate_hz) for s in registry.module(module).contents(Path(name))}
    for stream, (part, count, rate) in expected.items():
        assert found[stream][:2] == (part, count)
        assert found[stream][2] == pytest.approx(rate)


@pytest.mark.realdata
def test_a_real_drive_survives_every_format(shared_data, tmp_path):
    """A real drive with fixes, written and read back in the formats that hold measurements; tolerances as printed."""
    run = schuler.read(
        shared_data / "rtkexp_drive",
        imu={"file": "imu_gpst.csv", "columns": "t,ax,ay,az,gx,gy,gz", "units": "m/s^2,rad/s", "time": "gps-tow:2374",
             "axes": "BRU"},
        gnss={"file": "gnss_1934_sf.pos", "height": "msl", "geoid_separation": -16.8},
    )  # fmt: skip
    inc = run.imu.increments()
    schuler.write(run, tmp_path / "a.nc")
    schuler.write(run, tmp_path / "kf", format="kf_gins")
    schuler.write(run, tmp_path / "euroc", format="euroc")
    schuler.write(run, tmp_path / "a.imr")
    np.testing.assert_array_equal(schuler.read(tmp_path / "a.nc").imu.gyro, run.imu.gyro)
    back = schuler.read(tmp_path / "kf", format="kf_gins", time="gps-tow:2374")
    np.testing.assert_allclose(back.imu.t, inc.t, rtol=0, atol=1e-9)
    np.testing.assert_allclose(back.imu.accel, inc.dv_ib_b, rtol=0, atol=1e-15)
    np.testing.assert_allclose(back.gnss.llh[:, :2], run.gnss.llh[:, :2], rtol=0, atol=2e-14)
    back = schuler.read(tmp_path / "euroc")
    np.testing.assert_allclose(back.imu.t, run.imu.t, rtol=0, atol=2e-9)
    np.testing.assert_allclose(back.imu.accel, run.imu.accel, rtol=0, atol=1e-14)
    back = schuler.read(tmp_path / "a.imr", time="gps-tow:2374")
    count = np.abs(inc.dtheta_ib_b).max() / 2**30
    np.testing.assert_allclose(back.imu.gyro, inc.dtheta_ib_b, rtol=0, atol=0.51 * count)
