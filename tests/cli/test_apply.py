"""``schuler apply`` and the certificate of ``schuler calibrate``: files, JSON, refusals."""

import numpy as np
import pytest
from command import answer, refusal, run

from schuler.calibration.freepose.simulation import hand_log
from schuler.recording import io
from schuler.recording.recording import Metadata, Recording
from schuler.sensors.errors import ImuErrors
from schuler.sensors.noise import White

ERRORS = ImuErrors(
    b_a=np.array([0.05, -0.03, 0.02]), b_g=np.array([0.004, -0.002, 0.001]), M_a=np.diag([0.004, -0.003, 0.002]),
    gyro_noise=White(1e-4) + White(0.0), accel_noise=White(1e-3) + White(0.0),
)  # fmt: skip


@pytest.fixture(scope="module")
def logs(tmp_path_factory):
    """Two hand-held logs of one unit."""
    folder = tmp_path_factory.mktemp("logs")
    for k, name in enumerate(("first", "second")):
        imu = hand_log(ERRORS, np.random.default_rng(k)).rates()
        io.write(Recording(imu=imu, metadata=Metadata(name=name)), folder / f"{name}.parquet")
    return folder


@pytest.fixture(scope="module")
def calibrated(logs):
    from schuler.cli import main

    arguments = (
        "calibrate", "freepose", logs / "first.parquet", "--serial", "SN 7", "--operator", "A. M.", "--place", "lab",
        "--date", "2025-03-31", "--latitude", "47.4", "--out", logs / "cal", "--no-report", "--certificate",
        logs / "cal" / "certificate.html",
    )  # fmt: skip
    assert main([str(a) for a in arguments]) == 0
    return logs / "cal" / "calibration.yaml"


def test_certificate_and_session_are_written(calibrated):
    text = (calibrated.parent / "certificate.html").read_text()
    assert "SN 7" in text
    assert "normal gravity (WGS 84)" in text
    assert "serial: SN 7" in calibrated.read_text()


def test_certificate_and_date_are_looked_at_before_the_work(logs, tmp_path, capsys):
    common = ("calibrate", "freepose", logs / "first.parquet", "--out", tmp_path)
    assert "(--serial), got none" in refusal(capsys, *common, "--certificate", tmp_path / "c.html")
    assert "date: expected YYYY-MM-DD" in refusal(capsys, *common, "--date", "31.3.25")


def test_log_is_corrected_and_said_to_be(logs, calibrated, tmp_path, capsys):
    out = tmp_path / "c.parquet"
    data = answer(
        capsys, "apply", calibrated, logs / "second.parquet", "--out", out, "--serial", "SN 7", "--latitude", 47.4,
        "--json",
    )  # fmt: skip
    assert data["applied"]["serial"] == "SN 7"
    assert data["rests"]["norm_error_after_m_s2"] < 0.1 * data["rests"]["norm_error_before_m_s2"]
    assert data["metadata_kept"]
    assert (tmp_path / "c-applied.html").is_file()
    sources = io.read(out).metadata.sources
    assert {"calibration.yaml", "second.parquet"} <= sources.keys()
    assert "corrected already" in refusal(capsys, "apply", calibrated, out, "--out", tmp_path / "d.parquet")


def test_refusals_name_the_option(logs, calibrated, tmp_path, capsys):
    log, out = logs / "second.parquet", tmp_path / "c.parquet"
    other = refusal(capsys, "apply", calibrated, log, "--out", out, "--serial", "SN 8")
    assert "expected a log of the calibrated unit SN 7, got one of SN 8" in other
    assert "say --allow serial" in other
    code, _, err = run(
        capsys, "apply", calibrated, log, "--out", out, "--serial", "SN 8", "--allow", "serial", "--no-report"
    )
    assert code == 0, err
    assert "holds an IMU" in refusal(capsys, "apply", calibrated, log, "--out", tmp_path / "c.kml")
    assert not (tmp_path / "c.kml").exists()
