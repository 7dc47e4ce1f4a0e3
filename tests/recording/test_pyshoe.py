"""Readers of foot-mounted logs: PyShoe's trials, OpenShoe's matrices and text files; and what they refuse."""

import numpy as np
import pytest
from command import refusal
from scipy.io import savemat

from schuler import frames
from schuler.exceptions import FileFormatError, InputError
from schuler.recording.formats.openshoe import read_microstrain_text, read_openshoe_mat
from schuler.recording.formats.pyshoe import DETECTORS, is_pyshoe, read_pyshoe

N = 50


def contents(**changes):
    rng = np.random.default_rng(3)
    t = np.arange(N) * 0.005
    data = {
        "imu": np.concatenate((np.tile([0.1, 0.2, -9.8], (N, 1)), rng.standard_normal((N, 3))), axis=1),
        "ts": t[None, :] + 1e-4 * np.concatenate(([0.0], rng.standard_normal(N - 2), [0.0])),
        "gt": np.stack((t + 1.0, 2.0 * t + 2.0, 3.0 * t + 3.0), axis=1),
        "trial_error": np.array([[0.01, 0.02, 0.03, 0.04, 0.05]]),
        "best_error": 0.01,
        "best_detector": "shoe",
    }
    for k, name in enumerate(DETECTORS):
        data[f"zv_{name}_opt"] = (np.arange(N) % (k + 2) == 0).astype(np.int64)[None, :]
        data[f"G_{name}_opt"] = np.array([[10.0 * (k + 1)]])
    data.update(changes)
    return {k: v for k, v in data.items() if v is not None}


def written(tmp_path, **changes):
    path = tmp_path / "2017-11-22-11-22-03.mat"
    savemat(path, contents(**changes))
    return path


def test_a_trial(tmp_path):
    path = written(tmp_path)
    trial = read_pyshoe(path)
    data = contents()
    imu = trial.recording.imu
    np.testing.assert_array_equal(imu.accel, data["imu"][:, :3])
    np.testing.assert_array_equal(imu.gyro, data["imu"][:, 3:])
    np.testing.assert_allclose(np.diff(imu.t), 0.005, rtol=1e-9)  # rounding
    np.testing.assert_array_equal(trial.position_n, data["gt"] * [1.0, 1.0, -1.0])
    # the reference is the motion capture with its x axis to the north, from its first sample
    reference = trial.recording.reference
    moved = frames.ned_from_ecef(reference.r_eb_e, frames.llh_from_ecef(reference.r_eb_e[0]))
    np.testing.assert_allclose(moved, trial.position_n - trial.position_n[0], atol=1e-8)
    assert trial.thresholds["ared"] == 20.0
    assert trial.errors == dict(zip(DETECTORS, [0.01, 0.02, 0.03, 0.04, 0.05], strict=True))
    assert trial.labels["amvd"].sum() == 13
    assert trial.best == "shoe"
    assert trial.recording.metadata.name == "2017-11-22-11-22-03"
    assert path.name in trial.recording.metadata.sources
    assert is_pyshoe(path)


def test_navigate_says_which_command_a_trial_is_for(tmp_path, capsys):
    assert "schuler foot" in refusal(capsys, "navigate", written(tmp_path), "--out", tmp_path / "out")


def test_the_stamps_as_they_are(tmp_path):
    path = written(tmp_path)
    np.testing.assert_array_equal(read_pyshoe(path, uniform_clock=False).recording.imu.t, contents()["ts"].ravel())


def test_jumps_of_the_motion_capture_are_counted(tmp_path):
    gt = contents()["gt"]
    gt[20:23, 0] += 0.5
    notes = " ".join(read_pyshoe(written(tmp_path, gt=gt)).recording.metadata.notes)
    assert "2 times" in notes


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"gt": None}, "an array 'gt'"),
        ({"zv_ared_opt": None}, "zv_ared_opt"),
        ({"imu": np.zeros((N, 5))}, "shape"),
        ({"gt": np.full((N, 3), np.nan)}, "finite"),
        ({"ts": np.zeros((1, N))}, "increasing"),
        ({"trial_error": np.zeros((1, 4))}, "5 values"),
        ({"zv_shoe_opt": np.ones((1, 7))}, "labels"),
    ],
)
def test_files_that_are_no_trials(tmp_path, changes, message):
    with pytest.raises(FileFormatError, match=message):
        read_pyshoe(written(tmp_path, **changes))


def test_a_file_of_something_else(tmp_path):
    path = tmp_path / "log.mat"
    path.write_bytes(b"not a MATLAB file at all")
    assert not is_pyshoe(path)
    with pytest.raises(FileFormatError, match="cannot be read"):
        read_pyshoe(path)
    with pytest.raises(FileFormatError, match="cannot be read"):
        read_openshoe_mat(path, rate_hz=100.0)


def test_a_matrix_of_six_rows(tmp_path):
    u = np.arange(60.0).reshape(6, 10)
    savemat(tmp_path / "square.mat", {"u": u, "quat": np.zeros((4, 10))})
    imu = read_openshoe_mat(tmp_path / "square.mat", rate_hz=100.0).imu
    np.testing.assert_array_equal(imu.accel, u[:3].T)
    np.testing.assert_array_equal(imu.gyro, u[3:].T)
    np.testing.assert_allclose(imu.t, np.arange(10) / 100.0)
    with pytest.raises(FileFormatError, match="six rows"):
        read_openshoe_mat(tmp_path / "square.mat", rate_hz=100.0, variable="quat")
    with pytest.raises(FileFormatError, match="the file has u, quat"):
        read_openshoe_mat(tmp_path / "square.mat", rate_hz=100.0, variable="v")
    with pytest.raises(InputError, match="rate_hz"):
        read_openshoe_mat(tmp_path / "square.mat", rate_hz=0.0)


HEADER = (
    "MicroStrain log\nHeader a_x [g] a_y [g] a_z [g] ar_x [rad/s]\nmore words of a header that mean nothing here\n\n"
)
ROW = "c3  0.01 -0.02 -1.0  0.1 0.2 0.3  {k} 4f  {k}  1.3e9 1.3e9 1.3e9  250.0  +nan +nan +nan\n"


def test_a_text_file_of_the_microstrain(tmp_path):
    folder = tmp_path / "Measurement_100521_44"
    folder.mkdir()
    (folder / "data_inert.txt").write_text(HEADER + "".join(ROW.format(k=k) for k in range(20)))
    recording = read_microstrain_text(folder)
    np.testing.assert_allclose(recording.imu.accel[7], [0.0980665, -0.196133, -9.80665], rtol=1e-12)
    np.testing.assert_array_equal(recording.imu.gyro[7], [0.1, 0.2, 0.3])
    assert recording.imu.rate_hz == pytest.approx(250.0)
    assert recording.metadata.name == "Measurement_100521_44"
    assert len(read_microstrain_text(folder / "data_inert.txt", rate_hz=100.0).imu) == 20


def test_a_broken_row_is_named(tmp_path):
    path = tmp_path / "data_inert.txt"
    path.write_text(HEADER + ROW.format(k=1) + ROW.format(k=2) + "c3 0.01 x -1.0 0.1 0.2 0.3\n")
    with pytest.raises(FileFormatError, match=r"data_inert.txt:7: "):
        read_microstrain_text(path)
    path.write_text(HEADER + ROW.format(k=1) + "c3 0.01 nan -1.0 0.1 0.2 0.3\n")
    with pytest.raises(FileFormatError, match="three rates"):
        read_microstrain_text(path)
    path.write_text(HEADER)
    with pytest.raises(FileFormatError, match="expected rows"):
        read_microstrain_text(path)
    with pytest.raises(FileFormatError, match="cannot be read"):
        read_microstrain_text(tmp_path / "nowhere.txt")
