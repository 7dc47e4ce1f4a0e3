"""What ``schuler calibrate`` asks before it begins: the checks of ``schuler check``, and ``--unchecked``."""

import json
from dataclasses import replace

import numpy as np
import pytest
from command import run

from schuler.calibration.freepose.simulation import hand_log
from schuler.calibration.result.result import CalibrationResult
from schuler.cli.app import METHODS
from schuler.recording import io
from schuler.recording.recording import Metadata, Recording
from schuler.sensors.errors import ImuErrors
from schuler.sensors.noise import White
from schuler.units import DEG

ERRORS = ImuErrors(
    b_a=np.array([0.05, -0.03, 0.02]), M_a=np.diag([0.004, -0.003, 0.002]), b_g=np.array([0.004, -0.002, 0.001]),
    M_g=np.diag([0.005, -0.004, 0.003]), gyro_noise=White(1e-4) + White(0.0), accel_noise=White(1e-3) + White(0.0),
)  # fmt: skip


@pytest.fixture(scope="module")
def imu():
    return hand_log(ERRORS, np.random.default_rng(1)).rates()


@pytest.fixture
def write(tmp_path):
    def to_file(imu, name="hand"):
        path = tmp_path / f"{name}.parquet"
        io.write(Recording(imu=imu, metadata=Metadata(name=name)), path)
        return path

    return to_file


def calibrated(capsys, method, log, *options):
    folder = log.parent / "out"
    return run(capsys, "calibrate", method, log, *options, "--out", folder, "--no-report", "--json")


def test_a_good_log_is_noted_as_checked(imu, write, capsys):
    code, out, err = calibrated(capsys, "freepose", write(imu))
    assert code == 0, err
    assert err == ""
    data = json.loads(out)
    assert data["provenance"]["checks"] == [
        "Checked before use: unit of specific force, unit of angular rate (turns of gravity); no error was found."
    ]
    again = CalibrationResult.from_yaml(data["files"]["calibration"])
    assert again.provenance["checks"] == data["provenance"]["checks"]


def test_degrees_taken_for_radians_stop_it(imu, write, capsys):
    log = write(replace(imu, gyro=imu.gyro / DEG))
    code, out, err = calibrated(capsys, "freepose", log)
    assert (code, out) == (2, "")
    assert err.startswith("schuler: hand is not what it is said to be. gyro_unit: ")
    assert "--units ...,deg/s" in err
    assert err.rstrip().endswith("to go on nevertheless say --unchecked")


def test_unchecked_goes_on_and_the_result_says_so(imu, write, capsys):
    """The accelerometers can be calibrated whatever the gyroscopes show."""
    log = write(replace(imu, gyro=-imu.gyro))
    code, out, err = calibrated(capsys, "multiposition", log, "--gyro-order", "0", "--unchecked")
    assert code == 0, err
    assert "error gyro_sign: " in err
    data = json.loads(out)
    (stated,) = data["provenance"]["checks"]
    assert stated.startswith("Passed over (--unchecked): gyro_sign: ")
    assert stated in CalibrationResult.from_yaml(data["files"]["calibration"]).provenance["checks"]


@pytest.mark.parametrize("method", [m for m in METHODS if m not in ("ratetable", "field", "poses")])
def test_every_method_asks_first(imu, write, capsys, method):
    code, out, err = calibrated(capsys, method, write(replace(imu, gyro=-imu.gyro)))
    assert (code, out) == (2, "")
    assert "gyro_sign" in err


def test_the_methods_with_options_of_their_own_ask_first(imu, write, capsys):
    log = write(replace(imu, gyro=-imu.gyro))
    for method, *more in (("ratetable", "--rates", "30"), ("field", "--imu", "MPU-6000", "--latitude", "40")):
        code, out, err = calibrated(capsys, method, log, *more)
        assert (code, out) == (2, "")
        assert "gyro_sign" in err


def test_the_coach_asks_first_too(imu, write, capsys):
    log = write(replace(imu, gyro=-imu.gyro))
    options = ("--imu", "MPU-6000", "--latitude", "40", "--coach")
    code, out, err = calibrated(capsys, "field", log, *options)
    assert (code, out) == (2, "")
    assert "gyro_sign" in err
    assert "resting: hold it" not in err


def test_what_is_no_error_is_said_in_a_sentence(imu, write, capsys):
    code, out, err = calibrated(capsys, "freepose", write(replace(imu, accel=imu.accel * 1.08)))
    assert code == 0, err
    assert err.startswith("hand: warning accel_scale: the norm of specific force is ")
    assert "-> --scale accel=0.9" in err
    assert json.loads(out)["status"] != "refused"


def test_a_unit_upside_down_on_the_bench_is_no_fault(write, capsys, rng):
    """At rest with z up, as a thermal chamber or one face of six may hold it: the checks of a drive would say so."""
    from schuler.cli.reading import Checking
    from schuler.recording.series import ImuSeries

    f = np.array([0.0, 0.0, 9.81]) + rng.normal(0.0, 0.02, (3000, 3))
    imu = ImuSeries(np.arange(3000) / 100.0, rng.normal(0.0, 1e-3, (3000, 3)), f)
    Checking().passed(Recording(imu=imu, metadata=Metadata(name="up")))
    assert capsys.readouterr().err == ""


@pytest.mark.realdata
def test_raw_counts_turned_by_hand_raise_no_alarm(shared_data, tmp_path, capsys):
    log = shared_data / "imu_tk_xsens"
    config = tmp_path / "xsens.toml"
    config.write_text(
        '[recording.accel]\nfile = "xsens_acc.mat"\ncolumns = "t,ax,ay,az"\nunits = "accel=counts"\n'
        '[recording.gyro]\nfile = "xsens_gyro.mat"\ncolumns = "t,gx,gy,gz"\nunits = "gyro=counts"\n',
        encoding="utf-8",
    )
    options = ("--config", config, "--gravity", "9.81744", "--out", tmp_path, "--no-report", "--json")
    code, out, err = run(capsys, "calibrate", "freepose", log, *options)
    assert (code, err) == (0, "")
    (stated,) = json.loads(out)["provenance"]["checks"]
    assert stated.endswith("no error was found.")


@pytest.mark.realdata
@pytest.mark.parametrize(
    ("name", "method", "options"),
    [
        ("snu_staticposes/imu_good3.txt", "freepose",
         ("--columns", "t,ax,ay,az,gx,gy,gz,*", "--units", "m/s^2,rad/s", "--gravity", "9.79871")),
        ("imucal_ferraris/example_ferraris_session.csv", "ferraris",
         ("--columns", "-,gx,gy,gz,ax,ay,az", "--units", "m/s^2,deg/s", "--rate", "102.4")),
        ("imucal_ferraris/annotated_session.csv", "ferraris",
         ("--columns", "-,-,ax,ay,az,gx,gy,gz", "--units", "counts,counts", "--rate", "204.8", "--skip", "1")),
        ("imu_thermal/imu_raw_data.csv", "thermal",
         ("--columns", "t,gx,gy,gz,ax,ay,az,-,temp", "--units", "accel=m/s^2,gyro=rad/s,t=ns", "--delimiter", "tab")),
    ],
    ids=["snu", "ferraris", "ferraris counts", "thermal"],
)  # fmt: skip
def test_sessions_of_others_are_not_stopped(shared_data, tmp_path, capsys, name, method, options):
    code, out, err = run(
        capsys, "calibrate", method, shared_data / name, *options, "--out", tmp_path, "--no-report", "--json"
    )
    # whether the method can use it is another matter
    assert "not what it is said to be" not in err
    if code == 0:
        assert json.loads(out)["provenance"]["checks"][0].endswith("no error was found.")
