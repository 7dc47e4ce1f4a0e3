"""Levelling, gyrocompassing, course heading: exact cases, statistics, real rest data."""

import numpy as np
import pytest

from schuler import earth, rotation, units
from schuler.exceptions import InputError
from schuler.mechanization.alignment import gyrocompass, heading_from_course, levelling

LAT = np.radians(47.0)


def at_rest(rpy, lat=LAT):
    C = rotation.dcm_from_rpy(np.asarray(rpy, dtype=float))
    return C.T @ earth.earth_rate_ned(lat), C.T @ -earth.gravity_ned(lat)


@pytest.mark.parametrize("rpy", [(0.0, 0.0, 0.0), (0.2, -0.3, 2.0), (-2.8, 1.2, -1.0), (3.0, -0.1, 0.5)])
def test_exact_data_give_the_exact_attitude(rpy):
    omega, f = at_rest(rpy)
    level = levelling(f)
    np.testing.assert_allclose(level.rpy_nb[:2], rpy[:2], atol=2e-9)  # gravity's 1e-9 north part at height zero
    attitude = gyrocompass(omega, f, LAT)
    turn = rotation.rotvec_from_dcm(attitude.C_nb @ rotation.dcm_from_rpy(np.array(rpy)).T)
    assert np.linalg.norm(turn) < 1e-8


def test_levelling_does_not_know_the_heading():
    a = levelling(at_rest((0.1, 0.2, 1.5))[1])
    assert a.rpy_nb[2] == 0.0
    assert np.sqrt(a.cov_psi_n[2, 2]) == pytest.approx(np.pi)


@pytest.mark.campaign
def test_gyrocompass_errors_are_those_it_claims():
    """Biases drawn with their sigmas: attitude errors about N, E, D have the claimed covariance and correlation."""
    rng = np.random.default_rng(1)
    rpy = np.array([0.3, -0.2, 1.1])
    sigma_g, sigma_a, runs = 0.02 * units.DEG_PER_HR, 0.02, 4000
    omega, f = at_rest(rpy)
    C = rotation.dcm_from_rpy(rpy)
    errors, b_g, b_a = (
        np.empty((runs, 3)),
        sigma_g * rng.standard_normal((runs, 3)),
        sigma_a * rng.standard_normal((runs, 3)),
    )
    for k in range(runs):
        attitude = gyrocompass(omega + b_g[k], f + b_a[k], LAT, sigma_gyro_bias=sigma_g, sigma_accel_bias=sigma_a)
        errors[k] = rotation.rotvec_from_dcm(attitude.C_nb @ C.T)
        # bias estimates were zero, so their errors are minus the biases: what the sensitivities explain is all there is
        explained = -attitude.psi_accel @ b_a[k] - attitude.psi_gyro @ b_g[k]
        np.testing.assert_allclose(errors[k], explained, atol=0.03 * np.abs(errors[k]).max())  # second order
    claimed = attitude.cov_psi_n
    sample = errors.T @ errors / runs
    # statistical: standard error of a variance is sqrt(2 / runs) = 2.2 percent; 4.5 of them
    np.testing.assert_allclose(np.diag(sample), np.diag(claimed), rtol=0.1)
    scale = np.sqrt(np.outer(np.diag(claimed), np.diag(claimed)))
    np.testing.assert_allclose(sample / scale, claimed / scale, atol=0.1)
    assert claimed[0, 2] < -0.3 * scale[0, 2]


def test_heading_replaces_heading_only():
    level = levelling(at_rest((0.1, 0.2, 0.0))[1], sigma_bias=1e-3)
    a = level.with_heading(4.0, 0.02, "a compass")
    np.testing.assert_allclose(a.rpy_nb, [level.rpy_nb[0], level.rpy_nb[1], 4.0 - 2 * np.pi])
    assert a.cov_psi_n[2, 2] == pytest.approx(4e-4)
    np.testing.assert_allclose(a.cov_psi_n[:2, :2], level.cov_psi_n[:2, :2], rtol=1e-12, atol=1e-20)
    assert a.method == "levelled, a compass"
    with pytest.raises(InputError, match="positive 1-sigma heading error"):
        level.with_heading(1.0, 0.0, "nothing")


@pytest.mark.parametrize("scale", [0.5, 9.80665, 1.0 / 9.80665])
def test_levelling_refuses_what_is_no_rest(scale):
    with pytest.raises(InputError, match=r"needs the specific force of a body at rest, about 9\.81"):
        levelling(at_rest((0.0, 0.0, 0.0))[1] * scale)


def test_gyrocompassing_refuses_poor_gyros_and_poles():
    omega, f = at_rest((0.0, 0.0, 0.3))
    with pytest.raises(InputError, match="would leave the heading unknown"):
        gyrocompass(omega, f, LAT, sigma_gyro_bias=20.0 * units.DEG_PER_HR)
    with pytest.raises(InputError, match="would leave the heading unknown"):
        gyrocompass(*at_rest((0, 0, 0), np.radians(89.99)), np.radians(89.99), sigma_gyro_bias=0.01 * units.DEG_PER_HR)


def test_course_gives_heading_with_its_uncertainty():
    heading, sigma = heading_from_course([3.0, -4.0, 0.5], 0.05, sigma_sideslip=0.01)
    assert heading == pytest.approx(np.arctan2(-4.0, 3.0))
    assert sigma == pytest.approx(np.hypot(0.01, 0.01))
    with pytest.raises(InputError, match=r"got 0\.100 m/s with sigma 0\.050"):
        heading_from_course([0.1, 0.0, 0.0], 0.05)


@pytest.mark.campaign
@pytest.mark.realdata
def test_parked_laser_gyro_finds_earth_rate_and_north(shared_data):
    """Ring-laser IMU, quasi-static for half an hour at 34.246 deg N: Earth rate, and the heading its header states."""
    text = (shared_data / "psins_lasergyro" / "lasergyro.imu").read_text("latin-1")
    rows = [line.split() for line in text.splitlines() if not line.startswith("%")]
    counts = np.array([row[:6] for row in rows[3:] if len(row) >= 6], dtype=float)
    C_bs = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])  # right-forward-up to forward-right-down
    omega = counts[:, :3].mean(axis=0) * 0.1 * units.ARCSEC * 100.0 @ C_bs.T
    f = counts[:, 3:].mean(axis=0) * 125.0 * units.UG * 100.0 @ C_bs.T
    lat = np.radians(34.246)
    # printed digits of the data's README: 8.42..8.47 deg/h about gravity against 8.465 expected
    vertical = omega @ f / np.linalg.norm(f) / units.DEG_PER_HR
    assert vertical == pytest.approx(15.041 * np.sin(lat), abs=0.1)
    assert np.linalg.norm(omega) / units.DEG_PER_HR == pytest.approx(15.041, abs=0.6)
    attitude = gyrocompass(omega, f, lat, sigma_gyro_bias=0.05 * units.DEG_PER_HR, sigma_accel_bias=1e-3)
    # its header says yaw -90.6 deg counted anticlockwise, "maybe inaccurate"; an east gyro bias of 0.5 deg/h, the
    # amount by which the total rate is short, turns the heading by 2.4 deg
    assert attitude.rpy_nb[2] / units.DEG == pytest.approx(90.6, abs=3.0)


def test_a_bias_within_its_sigma_is_no_fault_of_units():
    f = [0.0, 0.0, -9.81 + 1.2]  # 12 % off g
    with pytest.raises(InputError, match="levelling needs"):
        levelling(f, sigma_bias=0.05, sigma_noise=0.01)
    assert levelling(f, sigma_bias=0.8, sigma_noise=0.01) is not None
    with pytest.raises(InputError, match="levelling needs"):
        levelling([0.0, 0.0, -1.0], sigma_bias=0.8, sigma_noise=0.01)  # in g
