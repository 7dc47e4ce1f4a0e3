"""What logs of data sets hold by their looks, and a real drive through the formats that are written."""

from pathlib import Path

import numpy as np
import pytest
from tests.recording import test_format_euroc as euroc
from tests.recording import test_format_mat as mat
from tests.recording import test_format_phones as phones

import schuler
from schuler.recording.formats import registry


@pytest.fixture
def files(tmp_path, monkeypatch):
    (tmp_path / "MH_01_easy").mkdir()
    euroc.data_set(tmp_path / "MH_01_easy", "comment: VI-Sensor IMU (ADIS16448)\n")
    mat.navego(tmp_path / "navego.mat")
    phones.gnss_logger(tmp_path / "gnss_log.txt")
    monkeypatch.chdir(tmp_path)


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
    streams = {s.name: (s.part, s.count, s.rate_hz) for s in registry.module(module).contents(Path(name))}
    for stream, (part, count, rate) in expected.items():
        assert streams[stream][:2] == (part, count)
        assert streams[stream][2] == pytest.approx(rate)


@pytest.mark.realdata
def test_a_real_drive_survives_every_format(shared_data, tmp_path):
    """A real drive with fixes, written and read back in the formats that hold measurements; tolerances as printed."""
    run = schuler.read(
        shared_data / "rtkexp_drive",
        imu={"file": "imu_gpst.csv", "columns": "t,ax,ay,az,gx,gy,gz", "units": "m/s^2,rad/s", "time": "gps-tow:2374",
             "axes": "BRU"},
        gnss={"file": "gnss_1934_sf.pos", "height": "msl", "geoid_separation": -16.8},
    )  # fmt: skip
    run = run.between(run.start + 100.0, run.start + 250.0)
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
