"""A magnetometer in the log of a field calibration: the six axes stay as they were, hard and soft iron come out."""

from dataclasses import replace

import numpy as np
import pytest
from command import answer
from field_cases import AUTOMOTIVE, LLH, calibrated, drawn, log_of, thesis
from scipy.stats import chi2

from schuler.calibration.field.options import FieldOptions
from schuler.calibration.freepose.calibrate import calibrate_freepose
from schuler.calibration.result.parameters import BIAS_M, MATRIX_M
from schuler.calibration.result.result import CalibrationResult
from schuler.earth import gravity_somigliana
from schuler.rotation import dcm_from_rotvec
from schuler.units import DEG, UT

FIELD_N = np.array([20.0, 2.0, 44.0]) * UT
NAMES = (*BIAS_M, *MATRIX_M)


def nine_axes(imu, scene, rng, noise=0.3 * UT):
    """The log with a magnetometer beside, and its hard iron and ``I + M_m``."""
    S = rng.standard_normal((3, 3))
    S = np.eye(3) + 0.03 * (S + S.T)
    A = 3.0 * S / np.trace(S) @ dcm_from_rotvec(0.1 * rng.standard_normal(3))
    b = 20.0 * UT * rng.standard_normal(3)
    C_nb = scene.motion.state(imu.t).C_nb
    m = np.einsum("nji,j->ni", C_nb, FIELD_N) @ A.T + b + noise * rng.standard_normal((len(imu), 3))
    return replace(imu, magnetometer=m), np.concatenate((b, (A - np.eye(3)).ravel()))


def unit(seed, repeats=1, rate_hz=50.0):
    """Log, truth of the magnetometer, heading, and how it was moved."""
    scene = thesis(repeats, rate_hz)
    errors, rng, heading = drawn(AUTOMOTIVE, seed)
    imu, truth = nine_axes(log_of(scene, errors, rng), scene, rng)
    return scene, imu, truth, heading


def errors_of(result, truth):
    """Errors in T and 1, and their covariance."""
    k = [result.names.index(n) for n in NAMES]
    return result.values[k] - truth, result.covariance[np.ix_(k, k)]


def test_the_six_axes_stay_as_they_were_and_the_magnetometer_is_that_of_free_pose():
    scene, imu, truth, heading = unit(1)
    nine = calibrated(scene, imu, AUTOMOTIVE, heading=heading)
    result = nine.calibration
    six = calibrated(scene, replace(imu, magnetometer=None), AUTOMOTIVE, heading=heading).calibration
    n = len(six.names)
    assert result.names == (*six.names, *NAMES)
    np.testing.assert_array_equal(result.values[:n], six.values)
    np.testing.assert_array_equal(result.covariance[:n, :n], six.covariance)
    assert nine.last_move < 0.05
    e, P = errors_of(result, truth)
    assert np.abs(e / np.sqrt(np.diag(P))).max() < 4.0  # statistical
    # twin: the same rests put down by hand; discretisation, the accelerometers differ by some 0.3 mrad
    rests = scene.rests(imu)
    spans = list(zip(rests.start, rests.stop, strict=True))
    gravity = float(gravity_somigliana(LLH[0], LLH[2]))
    twin = calibrate_freepose(imu, gravity=gravity, intervals=spans, halves=False)
    other, _ = errors_of(twin, truth)
    assert np.abs(e[:3] - other[:3]).max() < 0.01 * UT
    assert np.abs(e[3:] - other[3:]).max() < 1e-3


def test_halves_have_a_magnetometer_each():
    scene, imu, _, heading = unit(2, repeats=2, rate_hz=25.0)
    result = calibrated(scene, imu, AUTOMOTIVE, heading=heading, halves=True).calibration
    assert {"b_m", "M_m"} <= set(result.extra["halves"]["splits"]["first and second half"])


@pytest.mark.parametrize("runs", [8, pytest.param(80, marks=pytest.mark.campaign)])
def test_claims_of_the_magnetometer_hold(runs):
    """Statistical: mean NEES of eleven determined numbers (the scale is relative), probability 1e-4 a side."""
    total, numbers = 0.0, 0
    for seed in range(10, 10 + runs):
        scene, imu, truth, heading = unit(seed, rate_hz=25.0)
        e, P = errors_of(calibrated(scene, imu, AUTOMOTIVE, heading=heading).calibration, truth)
        s = np.sqrt(np.diag(P))
        values, Q = np.linalg.eigh(P / np.outer(s, s))
        keep = values > 1e-9
        total += float(np.sum((Q.T @ (e / s))[keep] ** 2 / values[keep]))
        numbers += int(keep.sum())
    assert numbers == 11 * runs
    assert chi2.ppf(1e-4, numbers) < total < chi2.isf(1e-4, numbers)


def test_an_accelerometer_left_out_leaves_the_magnetometer_out():
    scene, imu, _, heading = unit(3, rate_hz=25.0)
    options = FieldOptions(blocks=("b_g", "S_g"))
    result = calibrated(scene, imu, AUTOMOTIVE, options, heading=heading).calibration
    assert not set(NAMES) & set(result.names)


@pytest.mark.campaign
@pytest.mark.parametrize("counts", [False, pytest.param(True, marks=pytest.mark.campaign)])
def test_by_command(tmp_path, capsys, counts):
    """Statistical: five sigma; and what is written is read again, as the prior of the same command."""
    _, imu, truth, _ = unit(4)
    options = ("--columns", "t,ax,ay,az,gx,gy,gz,mx,my,mz", "--units", "m/s2,rad/s")
    rates = imu.rates()
    values = np.column_stack((rates.accel, rates.gyro, rates.magnetometer / UT))
    if counts:
        values[:, :6] = np.rint(values[:, :6] / np.repeat((6e-4, 1.3e-4), 3))
        options = (*options[:3], "counts,counts")
    log = tmp_path / "turned.csv"
    np.savetxt(log, np.column_stack((imu.t, values)), delimiter=",", fmt="%.9g")
    strength = float(np.linalg.norm(FIELD_N)) / UT
    command = ("calibrate", "field", log, *options, "--imu", "yaman-automotive", "--latitude", LLH[0] / DEG)
    out = ("--heading", "0,1", "--field-strength", strength, "--no-report", "--out", tmp_path, "--json")
    data = answer(capsys, *command, *out)
    assert data["status"] == "ok", data["verdicts"]
    assert set(NAMES) <= set(data["parameters"])
    result = CalibrationResult.from_yaml(tmp_path / "calibration.yaml")
    e, P = errors_of(result, truth)
    np.testing.assert_array_less(np.abs(e[:3]), 5.0 * np.sqrt(np.diag(P))[:3])
    earlier = ("--prior", tmp_path / "calibration.yaml", "--no-report", "--out", tmp_path / "again", "--json")
    again = answer(capsys, *command, "--heading", "0,1", *earlier)
    assert set(NAMES) <= set(again["parameters"])
