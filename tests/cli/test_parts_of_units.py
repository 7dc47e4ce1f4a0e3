"""Logs of gyroscopes alone, accelerometers alone and one axis: one command gives their budget and calibration."""

import numpy as np
import pytest
from command import answer, refusal

from schuler.calibration.bench.one_axis import calibrate_axis_upright
from schuler.calibration.bench.poses import Poses
from schuler.calibration.result.result import CalibrationResult
from schuler.sensors.spec_file import read_spec
from schuler.units import DEG, DEG_PER_HR, G0

N, RATE = 1e-4, 50.0  # (rad/s)/sqrt(Hz), Hz


def write(path, **columns):
    """Columns beside the time, with a header."""
    data = np.column_stack([np.arange(len(next(iter(columns.values())))) / RATE, *columns.values()])
    np.savetxt(path, data, delimiter=",", header=",".join(("t", *columns)), comments="")
    return path


def three(prefix, x):
    return dict(zip([prefix + a for a in "xyz"], x.T, strict=True))


@pytest.mark.campaign
@pytest.mark.parametrize("axes", ["x", pytest.param("xyz", marks=pytest.mark.campaign)])
def test_gyroscopes_alone_have_a_budget(rng, tmp_path, capsys, axes):
    x = N * np.sqrt(RATE) * rng.standard_normal((4000, 3))
    log = write(tmp_path / "log.csv", **{"g" + a: x[:, i] for i, a in enumerate(axes)})
    data = answer(capsys, "allan", log, "--units", "rad/s", "--no-report", "--out", tmp_path, "--json")
    assert set(data["axes"]) == {f"gyro_{a}" for a in axes}
    assert data["refused"] == {}
    spec = read_spec(tmp_path / "imu.toml")
    assert spec.gyro.random_walk == pytest.approx(N, rel=0.05)  # statistical: 2 % of 4000 samples
    assert spec.accel.random_walk == 0.0
    assert any("has no accel: the budget states no number" in note for note in data["notes"])


@pytest.mark.campaign
@pytest.mark.parametrize("records", [3, pytest.param(11, marks=pytest.mark.campaign)])
def test_several_switch_ons_have_a_calibration_beside_the_budget(rng, tmp_path, capsys, records):
    bias = np.array([46.0, -30.0, 20.0]) * DEG_PER_HR
    logs = []
    for k in range(records):
        x = bias + 3.0 * DEG_PER_HR * rng.standard_normal(3) + 1e-6 * rng.standard_normal((1500, 3))
        logs.append(write(tmp_path / f"r{k}.csv", **three("g", x)))
    data = answer(capsys, "allan", *logs, "--units", "rad/s", "--no-report", "--out", tmp_path, "--json")
    result = CalibrationResult.from_yaml(tmp_path / "calibration.yaml")
    assert result.names == ("b_g_x", "b_g_y", "b_g_z")
    np.testing.assert_allclose(result.values, bias, atol=9.0 * DEG_PER_HR)  # statistical: five sigma of a mean of three
    assert np.all(result.sigma > 15.04 / np.sqrt(3.0) * DEG_PER_HR)  # Earth rate is in no known direction
    assert read_spec(tmp_path / "imu.toml").gyro.turn_on_bias < 12.0 * DEG_PER_HR
    assert "calibration.yaml beside this file" in (tmp_path / "imu.toml").read_text(encoding="utf-8")
    assert data["turn_on"]["gyro_x"]["records"] == records
    assert sum("has no accel: its values" in note for note in data["notes"]) == 1


def test_gyroscopes_alone_on_a_rate_table(rng, tmp_path, capsys):
    plateaus = np.repeat(np.array([0.0, 30.0, -30.0, 0.0]) * DEG, 600)
    omega = np.zeros((3 * len(plateaus), 3))
    for k in range(3):
        omega[k * len(plateaus) : (k + 1) * len(plateaus), k] = plateaus
    log = write(tmp_path / "t.csv", **three("g", 1.01 * omega + 2e-4 + 1e-3 * rng.standard_normal(omega.shape)))
    options = ("--rates", "30", "--units", "rad/s", "--no-report", "--out", tmp_path, "--json")
    data = answer(capsys, "calibrate", "ratetable", log, *options)
    assert data["status"] != "refused", data["verdicts"]
    for a in "xyz":
        entry = data["parameters"][f"M_g_{a}{a}"]
        assert abs(entry["value"] - 0.01) < 5.0 * entry["sigma"] < 5e-3
    estimated = {name[:3] for name, entry in data["parameters"].items() if not entry.get("fixed")}
    assert estimated == {"b_g", "M_g"}
    assert (tmp_path / "calibration.yaml").exists()


def test_accelerometers_alone_on_six_faces(rng, tmp_path, capsys):
    f = 9.81 * np.repeat(np.vstack((np.eye(3), -np.eye(3))), 600, axis=0)
    log = write(tmp_path / "s.csv", **three("a", 1.002 * f + 0.03 + 0.01 * rng.standard_normal(f.shape)))
    options = ("--gravity", "9.81", "--units", "m/s2", "--no-report", "--out", tmp_path, "--json")
    data = answer(capsys, "calibrate", "sixposition", log, *options)
    assert {name[:3] for name in data["parameters"]} == {"b_a", "M_a"}
    assert data["parameters"]["M_a_xx"]["value"] == pytest.approx(0.002, abs=5e-4)


def test_one_axis_is_sent_where_it_gives_something(rng, tmp_path, capsys):
    log = write(tmp_path / "z.csv", gz=1e-3 * rng.standard_normal(2000))
    for method in ("freepose", "sixposition"):
        message = refusal(capsys, "calibrate", method, log, "--units", "rad/s")
        assert "a gyroscope turned both ways (schuler calibrate ratetable)" in message
        assert "schuler calibrate poses" in message
    log = write(tmp_path / "up.csv", az=9.81 + 1e-2 * rng.standard_normal(2000))
    message = refusal(capsys, "calibrate", "sixposition", log, "--units", "m/s2", "--gravity", "9.81")
    assert "az: expected rests with the axis up and rests with it down, got 1 and 0" in message


def test_one_gyroscope_turned_both_ways(rng, tmp_path, capsys):
    """Statistical, and the Earth's rate: five sigma."""
    rate = np.repeat(np.array([0.0, 30.0, -30.0, 0.0, 30.0, -30.0]) * DEG, 600)
    log = write(tmp_path / "z.csv", gz=1.01 * rate + 2e-4 + 1e-3 * rng.standard_normal(len(rate)))
    options = ("--rates", "30", "--units", "rad/s", "--no-report", "--out", tmp_path, "--json")
    data = answer(capsys, "calibrate", "ratetable", log, *options)
    result = CalibrationResult.from_yaml(tmp_path / "calibration.yaml")
    assert (result.names, result.status, data["status"]) == (("b_g_z", "M_g_zz"), "ok", "ok")
    for name, true in (("b_g_z", 2e-4), ("M_g_zz", 0.01)):
        value, sigma = result[name]
        assert abs(value - true) < 5.0 * sigma
    assert result["b_g_z"][1] > 15.04 / np.sqrt(3.0) * DEG_PER_HR
    assert 1.5e-4 < result["M_g_zz"][1] < 5e-4
    assert "One axis, gz: its bias and scale factor" in data["verdicts"][0]
    assert "other axes are not in the log" in data["verdicts"][1]


def test_one_accelerometer_up_and_down(rng, tmp_path, capsys):
    f = 9.81 * np.repeat([1.0, 0.0, -1.0, 1.0, -1.0], 400)
    log = write(tmp_path / "x.csv", ax=1.002 * f + 0.03 + 0.01 * rng.standard_normal(len(f)))
    options = ("--gravity", "9.81", "--units", "m/s2", "--no-report", "--out", tmp_path, "--json")
    data = answer(capsys, "calibrate", "sixposition", log, *options)
    result = CalibrationResult.from_yaml(tmp_path / "calibration.yaml")
    assert result.names == ("b_a_x", "M_a_xx")
    assert abs(result["b_a_x"][0] - 0.03) < 3.0 * result["b_a_x"][1] < 0.01
    assert abs(result["M_a_xx"][0] - 0.002) < 3.0 * result["M_a_xx"][1] < 1e-3
    assert "2 poses up, 2 down" in data["verdicts"][0]
    assert "1 rests in between were left out" in data["verdicts"][0]


def test_two_readings_of_one_axis_are_a_line_with_their_noise():
    """Closed form, rounding: half the difference and half the sum over gravity, sigma by the stated noise and 1 deg."""
    up = np.array([[0.0, 0.0, G0 * 1.01 + 0.1], [0.0, 0.0, -G0 * 1.01 + 0.1]])
    t = np.array([0.0, 10.0])
    poses = Poses(up, np.zeros((2, 3)), np.full((2, 3), 1e-3), np.ones((2, 3)), t, t + 5.0)
    result = calibrate_axis_upright(poses, "az")
    lost = 1.0 - np.cos(DEG)
    np.testing.assert_allclose(result.values, [0.1, 0.01], rtol=1e-9)
    np.testing.assert_allclose(result.sigma, np.hypot(1e-3 / np.sqrt(2.0) / np.array([1.0, G0]), [G0 * lost, lost]))
    assert result.status == "warning"
