"""The compiled interval against the differential equations it solves, and its parts against their closed forms."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from schuler import earth, rotation
from schuler.mechanization import kernels
from schuler.mechanization.strapdown import NavState, derivative_ecef, mechanize
from schuler.recording.series import Increments

RATE = np.array([[2.0, -1.5, 1.8], [20.0, 30.0, -25.0], [-300.0, 200.0, 250.0]])  # and its two derivatives
FORCE = np.array([[30.0, -40.0, 20.0], [500.0, 300.0, -400.0], [-3000.0, 4000.0, 5000.0]])


def polynomial(c, t):
    return c[0] + c[1] * t + 0.5 * c[2] * t * t


def integral(c, t):
    t = t[:, None]
    return c[0] * t + c[1] * t**2 / 2.0 + c[2] * t**3 / 6.0


@pytest.mark.parametrize("uneven", [False, True])
@pytest.mark.parametrize("frame", ["ecef", "ned"])
def test_quadratic_rates_and_forces_solve_the_navigation_equations(frame, uneven):
    """From the third interval on: what is left is of fifth order in the interval, gravity and Coriolis of third."""
    h = 0.002 + 0.0006 * uneven * np.sin(np.arange(12.0) ** 2)
    t = np.concatenate(([0.0], np.cumsum(h)))
    log = Increments(t[1:], h, np.diff(integral(RATE, t), axis=0), np.diff(integral(FORCE, t), axis=0))
    start = NavState.from_geodetic(0.0, [0.8, 0.3, 5000.0], (200.0, -150.0, 30.0), (0.4, -0.5, 2.0))
    run = mechanize(log, start, frame=frame)

    def slope(s, x):
        sensed = polynomial(RATE, s), polynomial(FORCE, s)
        return np.concatenate(
            [np.ravel(d) for d in derivative_ecef(x[:9].reshape(3, 3), x[9:12], x[12:] + run.r_eb_e[2], *sensed)]
        )

    np.testing.assert_allclose(np.linalg.norm(run.q_eb, axis=1), 1.0, rtol=0.0, atol=1e-14)  # rounding
    begin = np.concatenate((rotation.dcm_from_quat(run.q_eb[2]).ravel(), run.v_eb_e[2], np.zeros(3)))
    end = solve_ivp(slope, (t[3], t[-1]), begin, method="DOP853", rtol=1e-13, atol=1e-12).y[:, -1]
    assert np.abs(rotation.dcm_from_quat(run.q_eb[-1]) - end[:9].reshape(3, 3)).max() < 1e-10
    assert np.abs(run.v_eb_e[-1] - end[9:12]).max() < 3e-9
    assert np.abs(run.r_eb_e[-1] - run.r_eb_e[2] - end[12:]).max() < 2e-8


def test_the_start_of_a_log_is_fitted_by_what_there_is():
    """One increment: constant; two: linear; three: quadratic; each gives back the increments it was made of."""
    t = np.array([-0.035, -0.022, -0.01, 0.0])
    h2, h1, h = np.diff(t)
    for given in (1, 2, 3):
        c = np.zeros((3, 6))
        c[:given] = np.hstack((RATE, FORCE))[:given]
        earlier, before, now = np.diff(integral(c, t), axis=0)
        poly = np.zeros(18)
        kernels.fit_interval.py_func(poly, now, before, earlier, h, h1 if given > 1 else 0.0, h2 if given > 2 else 0.0)
        at = polynomial(c, -h)
        expected = np.stack((at, (c[1] - h * c[2]) * h, c[2] * h * h)) * h
        np.testing.assert_allclose(
            poly.reshape(2, 3, 3), np.stack(np.split(expected, 2, axis=1)), rtol=1e-12, atol=1e-16
        )


def test_parts_of_an_interval_are_the_same_polynomial():
    """Rate and force at any time of a part, times its length, are those of the whole."""
    poly, part = np.random.default_rng(1).normal(size=18), np.zeros(18)
    for s0, s1 in ((0.0, 1.0), (0.0, 0.3), (0.3, 1.0), (0.25, 0.8)):
        kernels.cut_interval.py_func(part, poly, s0, s1)
        for x in (0.0, 0.4, 1.0):
            whole = [polynomial(p, s0 + x * (s1 - s0)) for p in poly.reshape(2, 3, 3)]
            of_part = [polynomial(p, x) for p in part.reshape(2, 3, 3)]
            np.testing.assert_allclose(of_part, np.array(whole) * (s1 - s0), rtol=0.0, atol=1e-14)  # rounding


def test_compiled_gravity_is_the_field_of_the_earth_model(rng):
    for r in rng.normal(size=(20, 3)) * 6.5e6:
        expected = earth.gravity_ecef(r)
        np.testing.assert_allclose(
            kernels.gravity_e.py_func(*r), expected, rtol=0.0, atol=1e-14 * np.linalg.norm(expected)
        )


@pytest.mark.parametrize("angle", [1e-9, 0.1, 0.49, 0.51, 3.0])
def test_turning_an_attitude_is_a_product_of_quaternions(angle):
    turn = angle * np.array([0.6, -0.48, 0.64])
    nav = np.concatenate((rotation.quat_from_rpy([0.3, -0.7, 2.0]), np.arange(6.0)))
    expected = np.concatenate((rotation.quat_multiply(rotation.quat_from_rotvec(turn), nav[:4]), np.arange(6.0)))
    kernels.rotate_by.py_func(nav, *turn)
    np.testing.assert_allclose(nav, expected, rtol=0.0, atol=1e-14)  # rounding


def test_half_the_turn_of_the_earth_has_length_one():
    """To rounding for every interval up to a minute, and a second of it is a second of Earth rate."""
    for e in (1e-7, 1e-3, 2e-3):
        cosine, sine = kernels.half_earth_turn.py_func(e)
        assert cosine == pytest.approx(np.cos(e), rel=1e-15)
        assert sine == pytest.approx(np.sin(e), rel=1e-14)


def test_integrals_turn_with_the_axes_they_are_in(rng):
    """No axis of the body is special: polynomials in other axes give the same vectors in these, all orders of them."""
    for _ in range(20):
        C, poly = rotation.dcm_from_rotvec(rng.standard_normal(3)), 0.5 * rng.standard_normal((6, 3))
        turned = kernels.body_integrals((poly @ C.T).ravel())
        expected = np.reshape(kernels.body_integrals(poly.ravel()), (3, 3)) @ C.T
        np.testing.assert_allclose(np.reshape(turned, (3, 3)), expected, atol=1e-14)  # rounding
