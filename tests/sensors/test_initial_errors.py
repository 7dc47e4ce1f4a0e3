"""Errors of the first position and attitude: sign, axes, and the way from the thesis."""

from dataclasses import replace

import numpy as np
import pytest

from schuler.earth import WGS84
from schuler.exceptions import InputError
from schuler.frames import C_en, ecef_from_llh, ned_from_ecef
from schuler.rotation import dcm_from_rpy
from schuler.sensors import InitialErrors
from schuler.sensors.triads import C_FRD_FUR

SIGMAS = 4.0  # statistical tolerances: standard errors, seeds fixed


def test_position_and_attitude_with_errors():
    """Estimate minus truth, along straight axes at the true position; and the same from the thesis' numbers."""
    llh, rpy = np.array([0.7, 0.2, 300.0]), np.array([0.01, 0.02, 1.0])
    errors = InitialErrors(np.array([30.0, -40.0, 5.0]), np.array([1e-3, 2e-3, -3e-3]))
    llh_hat, rpy_hat = errors.apply(llh, rpy)
    offset = ned_from_ecef(ecef_from_llh(llh_hat, WGS84), llh)
    np.testing.assert_allclose(offset, errors.dr_n, atol=2e-8)  # rounding of ECEF
    np.testing.assert_allclose(rpy_hat - rpy, errors.drpy, rtol=1e-12)
    # actual = assumed + error, up instead of down, yaw to the west
    thesis = InitialErrors.from_flenniken([-30.0, 40.0, 5.0], [-1e-3, -2e-3, -3e-3])
    np.testing.assert_array_equal(thesis.dr_n, errors.dr_n)
    np.testing.assert_array_equal(thesis.drpy, errors.drpy)
    none = InitialErrors().apply(llh, rpy)
    np.testing.assert_allclose(none[0], llh, rtol=1e-14, atol=1e-8)  # rounding of ECEF: 4e-9 m
    np.testing.assert_array_equal(none[1], rpy)


def test_drawn():
    """Zero mean, the deviations asked for, six independent numbers."""
    n, rng = 4000, np.random.default_rng(52)
    drawn = [InitialErrors.draw(rng, [3.0, 4.0, 0.0], 0.01) for _ in range(n)]
    dr, drpy = np.array([e.dr_n for e in drawn]), np.array([e.drpy for e in drawn])
    np.testing.assert_allclose(dr[:, :2].std(axis=0), [3.0, 4.0], rtol=SIGMAS / np.sqrt(2 * n))
    assert not dr[:, 2].any()
    np.testing.assert_allclose(drpy.std(axis=0), 0.01, rtol=SIGMAS / np.sqrt(2 * n))
    six = np.concatenate([dr, drpy], axis=1)[:, [0, 1, 3, 4, 5]]
    assert np.abs(six.mean(axis=0) / six.std(axis=0)).max() < SIGMAS / np.sqrt(n)
    assert np.abs(np.corrcoef(six.T) - np.eye(5)).max() < SIGMAS / np.sqrt(n)
    # a deviation of zero takes its number from the generator all the same
    a, b = (InitialErrors.draw(np.random.default_rng(1), sigma, 0.01) for sigma in (0.0, 5.0))
    np.testing.assert_array_equal(a.drpy, b.drpy)
    assert not a.dr_n.any()


def thesis_attitude(roll: float, pitch: float, yaw: float) -> np.ndarray:
    """Navigation to body, axes forward, up, right, from (5.34)-(5.36) in the order of an aircraft."""
    c, s = np.cos, np.sin
    R_x = np.array([[1, 0, 0], [0, c(roll), s(roll)], [0, -s(roll), c(roll)]])
    R_y = np.array([[c(yaw), 0, -s(yaw)], [0, 1, 0], [s(yaw), 0, c(yaw)]])
    R_z = np.array([[c(pitch), s(pitch), 0], [-s(pitch), c(pitch), 0], [0, 0, 1]])
    return R_x @ R_z @ R_y


def test_attitude_errors_of_the_thesis_turn_as_its_rotations_do():
    """Assumed angles plus his errors, through his matrices, are the actual attitude; all angles large to show signs."""
    assumed, error = np.array([0.2, -0.3, 0.5]), np.array([0.11, 0.13, -0.17])
    actual = thesis_attitude(*(assumed + error))
    C_nb = C_FRD_FUR @ actual.T @ C_FRD_FUR.T  # north, up, east to north, east, down by the same matrix
    ours = assumed * [1.0, 1.0, -1.0]  # yaw to the west
    errors = InitialErrors.from_flenniken(np.zeros(3), error)
    np.testing.assert_allclose(dcm_from_rpy(ours - errors.drpy), C_nb, atol=1e-15)  # estimate = truth + error; rounding


def test_position_errors_of_the_thesis():
    """Actual = assumed + rho, north, east, up: shown with the position that navigation starts from."""
    truth = np.array([0.8, -1.3, 120.0])
    estimate, _ = InitialErrors.from_flenniken([10.0, 20.0, 30.0], np.zeros(3)).apply(truth, np.zeros(3))
    actual_less_assumed = ecef_from_llh(truth, WGS84) - ecef_from_llh(estimate, WGS84)
    np.testing.assert_allclose(C_en(truth).T @ actual_less_assumed, [10.0, 20.0, -30.0], atol=2e-8)  # rounding of ECEF


def test_another_ellipsoid():
    sphere = replace(WGS84, a=6.4e6, f=0.0)
    llh, _ = InitialErrors(np.array([0.0, 0.0, -50.0])).apply([0.5, 0.1, 10.0], np.zeros(3), sphere)
    np.testing.assert_allclose(llh, [0.5, 0.1, 60.0], rtol=1e-9)
    llh, _ = InitialErrors(np.array([64.0, 0.0, 0.0])).apply([0.5, 0.1, 0.0], np.zeros(3), sphere)
    assert llh[0] - 0.5 == pytest.approx(1e-5, rel=1e-8)  # third order


def test_errors_are_frozen_and_do_not_freeze_their_source():
    source = np.zeros(3)
    errors = InitialErrors(dr_n=source)
    source[0] = 1.0
    assert not errors.dr_n.any()
    with pytest.raises(ValueError, match="read-only"):
        errors.dr_n[0] = 1.0


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda r: InitialErrors.draw(r, -1.0, 0.1), "position_sigma: expected one or three"),
        (lambda r: InitialErrors.draw(r, 1.0, [0.1, 0.2]), "attitude_sigma: expected one or three"),
        (lambda r: InitialErrors.draw(r, 1.0, [0.1, 0.2, -0.3]), "attitude_sigma: expected one or three"),
        (lambda r: InitialErrors(np.zeros(2)), r"dr_n: expected .*\(3,\)"),
        (lambda r: InitialErrors(drpy=[0.0, np.nan, 0.0]), "drpy: expected finite"),
        (lambda r: InitialErrors.from_flenniken(np.zeros(3), 1.0), "attitude: expected"),
        (lambda r: InitialErrors.from_flenniken([1.0], np.zeros(3)), "rho_neu: expected"),
        (lambda r: InitialErrors().apply([0.0, 0.0], np.zeros(3)), "llh: expected"),
        (lambda r: InitialErrors().apply(np.zeros(3), [0.0, 0.0]), "rpy_nb: expected"),
    ],
)
def test_refusals(call, message):
    with pytest.raises(InputError, match=message):
        call(np.random.default_rng(0))
