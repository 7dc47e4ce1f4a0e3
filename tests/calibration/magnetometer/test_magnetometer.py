"""Magnetometer in the poses of the accelerometers: exact without noise, laws of rotation and units, coverage."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from schuler.calibration.bench.ferraris import SECTIONS, calibrate_ferraris
from schuler.calibration.bench.multiposition import calibrate_multiposition
from schuler.calibration.bench.poses import poses_of
from schuler.calibration.freepose.calibrate import calibrate_freepose
from schuler.calibration.freepose.simulation import hand_log, spread_turns
from schuler.calibration.magnetometer.fit import _SYMMETRIC, _jacobian, _moved, _residuals, _State, fit_magnetometer
from schuler.calibration.result.result import CalibrationResult
from schuler.exceptions import InputError
from schuler.recording.series import ImuSeries
from schuler.rotation import dcm_from_quat, dcm_from_rotvec
from schuler.sensors.errors import ImuErrors
from schuler.sensors.noise import NoiseModel, White
from schuler.units import G0

FIELD, DIP = 48e-6, 1.13
FIELD_N = FIELD * np.array([np.cos(DIP), 0.0, np.sin(DIP)])
MAG_NOISE = 0.3e-6


def attitudes(n, rng):
    q = rng.standard_normal((n, 4))
    return dcm_from_quat(q / np.linalg.norm(q, axis=1, keepdims=True))


def sensor(rng, turn=1.5, soft=0.05):
    """Hard iron, soft iron with eigenvalues of mean 1, rotation of the axes."""
    S = rng.standard_normal((3, 3))
    S = np.eye(3) + soft * (S + S.T) / 2.0
    return 20e-6 * rng.standard_normal(3), S * 3.0 / np.trace(S), dcm_from_rotvec(turn * rng.standard_normal(3))


def means(rng, n, b, S, C, dip=DIP, noise=0.0):
    R = attitudes(n, rng)
    m_n = FIELD * np.array([np.cos(dip), 0.0, np.sin(dip)])
    readings = np.einsum("nji,j->ni", R, m_n) @ (S @ C).T + b
    return R[:, 2, :], readings + noise * rng.standard_normal((n, 3))


@pytest.mark.parametrize("field", [None, FIELD])
@pytest.mark.parametrize("dip", [-1.3, 0.0, 0.4, 1.2])
@pytest.mark.parametrize("n", [9, 20])
def test_poses_without_noise_give_the_sensor_to_rounding(field, dip, n):
    rng = np.random.default_rng([n, int(10 * (dip + 2))])
    b, S, C = sensor(rng)
    down, y = means(rng, n, b, S, C, dip)
    fit = fit_magnetometer(down, y, np.full(n, 1e-12), field=field)
    # rounding, of least squares with a condition of some hundreds
    np.testing.assert_allclose(fit.b, b, atol=1e-9 * FIELD)
    np.testing.assert_allclose(fit.S, S, atol=1e-9)
    np.testing.assert_allclose(fit.C, C, atol=1e-9)
    assert fit.field[0] == pytest.approx(FIELD, rel=1e-9)
    assert fit.dip[0] == pytest.approx(dip, abs=1e-9)


def test_six_poses_without_noise_give_hard_iron_and_alignment_to_rounding():
    rng = np.random.default_rng(4)
    b, _, C = sensor(rng)
    down, y = means(rng, 6, b, np.eye(3), C)
    fit = fit_magnetometer(down, y, np.full(6, 1e-12), soft_iron=False)
    np.testing.assert_allclose(fit.b, b, atol=1e-9 * FIELD)
    np.testing.assert_allclose(fit.C, C, atol=1e-9)


def test_turning_the_body_axes_turns_the_alignment_and_nothing_else():
    rng = np.random.default_rng(5)
    b, S, C = sensor(rng)
    down, y = means(rng, 15, b, S, C, noise=MAG_NOISE)
    turn = dcm_from_rotvec(rng.standard_normal(3))
    one = fit_magnetometer(down, y, np.full(15, 1e-8))
    two = fit_magnetometer(down @ turn.T, y, np.full(15, 1e-8))
    np.testing.assert_allclose(two.C, one.C @ turn.T, atol=1e-6)  # where iterations end
    np.testing.assert_allclose(two.b, one.b, atol=1e-6 * FIELD)
    np.testing.assert_allclose(two.covariance[:3, :3], one.covariance[:3, :3], rtol=1e-4)


def test_turning_the_magnetometer_turns_hard_iron_and_soft_iron():
    rng = np.random.default_rng(6)
    b, S, C = sensor(rng)
    down, y = means(rng, 15, b, S, C, noise=MAG_NOISE)
    turn = dcm_from_rotvec(rng.standard_normal(3))
    one = fit_magnetometer(down, y, np.full(15, 1e-8))
    two = fit_magnetometer(down, y @ turn.T, np.full(15, 1e-8))
    np.testing.assert_allclose(two.b, turn @ one.b, atol=1e-6 * FIELD)
    np.testing.assert_allclose(two.S, turn @ one.S @ turn.T, atol=1e-6)
    np.testing.assert_allclose(two.C, turn @ one.C, atol=1e-6)


def test_the_unit_of_readings_changes_only_what_has_one():
    rng = np.random.default_rng(7)
    b, S, C = sensor(rng)
    down, y = means(rng, 15, b, S, C, noise=MAG_NOISE)
    one, two = (fit_magnetometer(down, k * y, np.full(15, k * 1e-8)) for k in (1.0, 1e7))
    np.testing.assert_allclose(two.b, 1e7 * one.b, rtol=1e-6)
    np.testing.assert_allclose(two.S, one.S, atol=1e-8)
    assert two.field[0] == pytest.approx(1e7 * one.field[0], rel=1e-8)


def test_a_pose_in_another_field_is_left_out():
    rng = np.random.default_rng(8)
    b, S, C = sensor(rng)
    down, y = means(rng, 18, b, S, C, noise=0.1 * MAG_NOISE)
    y[7] += 5e-6
    fit = fit_magnetometer(down, y, np.full(18, 1e-8))
    assert np.flatnonzero(~fit.used).tolist() == [7]
    assert np.abs(fit.b - b).max() < 5.0 * np.sqrt(np.diag(fit.covariance)[:3]).max()  # statistical


def test_poses_of_one_side_are_refused():
    rng = np.random.default_rng(9)
    b, S, C = sensor(rng)
    R = dcm_from_rotvec(0.05 * rng.standard_normal((12, 3)))
    y = np.einsum("nji,j->ni", R, FIELD_N) @ (S @ C).T + b + MAG_NOISE * rng.standard_normal((12, 3))
    with pytest.raises(InputError, match="all sides"):
        fit_magnetometer(R[:, 2, :], y, np.full(12, 1e-8))


def test_poses_that_no_one_field_fits_name_that_as_the_reason():
    """All sides were turned up; iron beside every pose leaves nothing to fit."""
    rng = np.random.default_rng(10)
    b, S, C = sensor(rng)
    down, y = means(rng, 20, b, S, C, noise=0.7 * FIELD)
    with pytest.raises(InputError, match="no one field fits all poses"):
        fit_magnetometer(down, y, np.full(20, 1e-8))


def test_an_axis_that_reads_nothing_is_named():
    rng = np.random.default_rng(11)
    b, S, C = sensor(rng)
    down, y = means(rng, 20, b, S, C)
    y[:, 1] = 1e-8 * rng.standard_normal(20)
    with pytest.raises(InputError, match="axis y reads the same"):
        fit_magnetometer(down, y, np.full(20, 1e-8))


@pytest.mark.parametrize("strength", [None, 1.0])
@pytest.mark.parametrize("soft", [True, False])
def test_the_jacobian_is_that_of_the_residuals(strength, soft):
    rng = np.random.default_rng(12)
    down, y = means(rng, 9, *sensor(rng), noise=0.01 * FIELD)
    y = y / FIELD
    last = 6 if strength else 5
    basis = _SYMMETRIC[:last] if soft else _SYMMETRIC[5:last]
    b, S, C = sensor(rng)
    state = _State(b / FIELD, S, C, strength or 0.9, 0.7)
    p = 7 + len(basis) + (strength is None)
    J, h = _jacobian(state, down, y, basis, p), 1e-6
    steps = h * np.eye(p)
    twin = [
        (_residuals(_moved(state, e, basis), down, y) - _residuals(_moved(state, -e, basis), down, y)) for e in steps
    ]
    np.testing.assert_allclose(J, np.stack([d.ravel() for d in twin], axis=1) / (2.0 * h), atol=1e-8)  # discretisation


def test_errors_of_both_signs_have_a_nees_of_one():
    """Hard iron, soft iron and alignment of either sign and 25 poses; noise as stated."""
    squared, n, runs = [], 25, 16
    for k in range(runs):
        rng = np.random.default_rng([13, k])
        hard, soft, turn = (np.sign((k >> i & 1) - 0.5) for i in range(3))
        S = np.eye(3) + 0.05 * soft * np.array([[1.0, 0.4, -0.6], [0.4, -1.5, 0.8], [-0.6, 0.8, 0.5]])
        truth = 30e-6 * hard * np.array([1.0, -0.5, 0.7]), S, dcm_from_rotvec(0.1 * turn * np.array([1.0, 2.0, -1.0]))
        down, y = means(rng, n, *truth, noise=MAG_NOISE)
        fit = fit_magnetometer(down, y, np.full(n, MAG_NOISE), field=FIELD)
        e = np.concatenate((fit.b - truth[0], (fit.S @ fit.C - truth[1] @ truth[2]).ravel()))
        squared.append(e @ np.linalg.solve(fit.covariance, e))
    # chi-square of 12 each; claims follow the scatter of the poses: 4 standard errors, that widens them by 10 %
    assert abs(np.mean(squared) / 12.0 - 1.0) < 4.0 * 1.1 * np.sqrt(2.0 / (12.0 * runs)), np.mean(squared) / 12.0


def coverage(runs, n, soft=True, field=None):
    inside, squares = [], []
    for k in range(runs):
        rng = np.random.default_rng([n, k])
        b, S, C = sensor(rng, soft=0.05 if soft else 0.0)
        down, y = means(rng, n, b, S, C, noise=MAG_NOISE)
        fit = fit_magnetometer(down, y, np.full(n, 0.1 * MAG_NOISE), soft_iron=soft, field=field)
        truth = np.concatenate((b, (S @ C - np.eye(3)).ravel()))
        z = (np.concatenate((fit.b, (fit.S @ fit.C - np.eye(3)).ravel())) - truth) / np.sqrt(np.diag(fit.covariance))
        inside.append((np.abs(z) < 1.96).mean())
        squares.append((z[:3] ** 2).mean())
    return np.array(inside), np.array(squares)


def test_intervals_of_95_percent_cover_though_the_field_is_uneven():
    inside, _ = coverage(12, 14)
    # runs are independent, parameters of one are not: 4 standard errors of their mean
    assert abs(inside.mean() - 0.95) < 4.0 * max(inside.std() / np.sqrt(len(inside)), 0.01), inside.mean()


@pytest.mark.campaign
@pytest.mark.parametrize(("n", "soft", "field"), [(12, True, None), (24, True, FIELD), (10, False, None)])
def test_intervals_of_95_percent_cover_93_to_97(n, soft, field):
    inside, _ = coverage(100, n, soft, field)
    assert 0.93 < inside.mean() < 0.97 or abs(inside.mean() - 0.95) < 2.5 * inside.std() / 10.0, inside.mean()


@pytest.fixture(scope="module")
def nine_axes():
    """A log of 24 poses and the truth of its magnetometer."""
    rng = np.random.default_rng(20)
    errors = ImuErrors(
        b_a=np.array([0.1, -0.2, 0.05]), M_a=np.array([[0.01, 0.004, -0.002], [0.0, -0.01, 0.003], [0.0, 0.0, 0.005]]),
        b_g=np.array([0.01, -0.02, 0.005]), M_g=0.01 * rng.standard_normal((3, 3)),
        gyro_noise=NoiseModel((White(3e-4),)), accel_noise=NoiseModel((White(2e-3),)),
    )  # fmt: skip
    log = hand_log(errors, rng, rotvecs=spread_turns(24, rng), rate_hz=50.0, turn_s=1.5, field_n=FIELD_N)
    b, S, C = sensor(rng)
    y = log.magnetometer @ (S @ C).T + b + MAG_NOISE * rng.standard_normal((len(log), 3))
    y = y[np.arange(len(y)) // 5 * 5]  # a tenth of a second, held
    return replace(log, magnetometer=y), np.concatenate((b, (S @ C - np.eye(3)).ravel()))


@pytest.fixture(scope="module")
def calibrated(nine_axes):
    return calibrate_freepose(nine_axes[0], field_strength=FIELD)


def magnetic(result):
    at = [i for i, n in enumerate(result.names) if n[2] == "m"]
    return result.values[at], result.covariance[np.ix_(at, at)]


def test_a_free_pose_calibrates_its_magnetometer_in_the_same_poses(nine_axes, calibrated):
    values, P = magnetic(calibrated)
    e = values - nine_axes[1]
    assert (np.abs(e) < 4.5 * np.sqrt(np.diag(P))).all()  # statistical, twelve of them
    assert float(e @ np.linalg.solve(P, e)) < 40.0  # chi-square of 12, 1e-4
    assert np.sqrt(np.diag(P))[:3].max() < 0.3e-6
    facts = calibrated.extra["magnetometer"]
    assert facts["soft_iron_estimated"]
    assert facts["dip_deg"] == pytest.approx(np.rad2deg(DIP), abs=5.0 * facts["dip_sigma_deg"])
    assert "magnetometer: field 48" in calibrated.summary()
    splits = calibrated.extra["halves"]["splits"]
    assert all({"b_m", "M_m"} <= set(blocks) for blocks in splits.values())
    assert all(blocks[m] < 2.0 for blocks in splits.values() for m in ("b_m", "M_m"))


def test_the_calibrated_magnetometer_reads_the_field_in_every_pose(nine_axes, calibrated):
    log = calibrated.apply(nine_axes[0])
    for a, b in calibrated.extra["intervals"]:
        rest = log.between(a, b)
        m, f = rest.magnetometer.mean(axis=0), rest.rates().accel.mean(axis=0)
        assert np.linalg.norm(m) == pytest.approx(FIELD, rel=0.02)  # noise of a rest
        assert -(m @ f) / np.linalg.norm(f) == pytest.approx(FIELD * np.sin(DIP), rel=0.02)


def test_another_gauge_turns_the_magnetometer_with_the_body(nine_axes, calibrated):
    other = calibrated.in_gauge("symmetric")
    one, two = (r.apply(nine_axes[0]) for r in (calibrated, other))
    assert np.abs(two.magnetometer - one.magnetometer).max() > 1e-3 * FIELD
    vertical = [np.einsum("ni,ni->n", x.magnetometer, x.rates().accel) for x in (one, two)]
    np.testing.assert_allclose(vertical[1], vertical[0], rtol=1e-9, atol=1e-12)  # rounding


def test_a_file_keeps_the_magnetometer(nine_axes, calibrated, tmp_path):
    again = CalibrationResult.from_yaml(calibrated.to_yaml(tmp_path / "calibration.yaml"))
    np.testing.assert_array_equal(again.covariance, calibrated.covariance)
    np.testing.assert_array_equal(again.apply(nine_axes[0]).magnetometer, calibrated.apply(nine_axes[0]).magnetometer)


def test_counts_are_calibrated_like_tesla(nine_axes, calibrated):
    log = replace(nine_axes[0], magnetometer=nine_axes[0].magnetometer / 0.15e-6)  # 0.15 uT a count
    result = calibrate_freepose(log, field_strength=FIELD, halves=False)
    np.testing.assert_allclose(
        result.apply(log).magnetometer, calibrated.apply(nine_axes[0]).magnetometer, atol=1e-4 * FIELD
    )


def test_poses_of_a_bench_calibrate_it_too(nine_axes, calibrated, tmp_path):
    result = calibrate_multiposition(
        poses_of(nine_axes[0].rates()), gravity=G0, gyro_order=0, field_strength=FIELD
    )  # fmt: skip
    one, two = calibrated.in_gauge("lower"), result
    for name in ("b_m_x", "b_m_y", "b_m_z", "M_m_xx", "M_m_xy", "M_m_zz"):
        assert abs(one[name][0] - two[name][0]) < 3.0 * one[name][1]  # nearly the same readings
    again = CalibrationResult.from_yaml(two.to_yaml(tmp_path / "unit.yaml"))
    np.testing.assert_array_equal(again.history, two.history)


def test_a_still_magnetometer_is_left_out_with_a_sentence(nine_axes):
    log = replace(nine_axes[0], magnetometer=np.full((len(nine_axes[0]), 3), 2e-5))
    result = calibrate_freepose(log, halves=False)
    assert not [n for n in result.names if n[2] == "m"]
    assert any("magnetometer is not calibrated" in v for v in result.verdicts)


def test_a_field_that_no_pose_shares_is_a_warning(nine_axes):
    log, rng = nine_axes[0], np.random.default_rng(14)
    disturbed = log.magnetometer.copy()
    for part in np.array_split(np.arange(len(log)), 60):
        disturbed[part] += FIELD * rng.standard_normal(3)
    result = calibrate_freepose(replace(log, magnetometer=disturbed), halves=False)
    assert result.status == "warning"
    assert any("magnetometer is not calibrated: no one field" in v for v in result.verdicts)


def test_faces_and_turns_calibrate_it_too():
    """Six faces as of Ferraris: hard iron and alignment, of which faces alone leave a second one."""
    rng, hz = np.random.default_rng(15), 50.0
    sections, omega, f, m = {}, [], [], []
    C = dcm_from_rotvec([0.02, -0.03, 0.05])
    b = np.array([12e-6, -8e-6, 5e-6])
    for k, name in enumerate(SECTIONS):
        axis, turning = np.eye(3)["xyz".index(name[0])], name.endswith("rot")
        up = -axis if name.endswith("a") else axis
        n = 200
        rate = np.outer(np.full(n, 2.0 * np.pi / (n / hz)) if turning else np.zeros(n), axis)
        level = np.cross(up, np.roll(axis, 1))
        heading = rng.uniform(0.0, 2.0 * np.pi)
        north = np.cos(heading) * level + np.sin(heading) * np.cross(up, level)
        omega.append(rate)
        f.append(np.tile(G0 * up, (n, 1)))
        m.append(np.tile(FIELD * (np.cos(DIP) * north - np.sin(DIP) * up) @ C.T + b, (n, 1)))
        sections[name] = (k * n / hz, ((k + 1) * n - 1) / hz)
    shape = (len(SECTIONS) * 200, 3)
    noisy = [np.concatenate(x) + s * rng.standard_normal(shape) for x, s in ((omega, 1e-4), (f, 1e-3), (m, 1e-7))]
    log = ImuSeries(np.arange(shape[0]) / hz, noisy[0], noisy[1] / 0.01, magnetometer=noisy[2])  # forces in counts
    result = calibrate_ferraris(log, sections, nominal=(0.01, 1.0), field_strength=FIELD)
    values, P = magnetic(result)
    assert not result.extra["magnetometer"]["soft_iron_estimated"]
    assert (np.abs(values[:3] - b) < 4.5 * np.sqrt(np.diag(P)[:3])).all()  # statistical
    assert (np.abs(values[3:] - (C - np.eye(3)).ravel()) < 4.5 * np.sqrt(np.diag(P)[3:]) + 1e-3).all()  # and the faces'
    assert np.sqrt(np.diag(P)).max() < 0.01
