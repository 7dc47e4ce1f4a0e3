"""Stefanisko's generator and his navigation equations against closed forms."""

import numpy as np
import pytest

from schuler import rotation
from schuler.exceptions import InputError
from schuler.reproduce.stefanisko.study.generator import GRAVITY, flat_navigation, gendata, velocity_from_samples

A = ((0.0, 0.0, 6.0), (5.0, 6.0, 4.0), (10.0, 0.0, 2.0))
B = ((0.0, 0.0, 0.0), (0.0, 0.25 * np.pi, 0.0), (0.0, 0.5 * np.pi, 0.0))
STEP = 5.0


def test_samples_are_those_of_the_closed_form():
    """a = (0, -12, 0) / step^2, pitch rate pi/4 over a step; rounding."""
    k = np.array((0, 10, 999))
    t = 0.01 * k
    samples = gendata(A, STEP, B, STEP, 0.01, k)
    pitch = 0.25 * np.pi * t / STEP
    expected = np.column_stack((GRAVITY * np.sin(pitch), np.full(3, -12.0 / STEP**2), -GRAVITY * np.cos(pitch)))
    np.testing.assert_allclose(samples[:, :3], expected, atol=1e-12)
    np.testing.assert_allclose(samples[:, 3:], np.tile((0.0, 0.25 * np.pi / STEP, 0.0), (3, 1)), atol=1e-12)
    np.testing.assert_array_equal(gendata(A, STEP, B, STEP, 0.01, 10), samples[1])


def test_in_body_axes_only_gravity_is_turned():
    """Rotation about x takes his acceleration along y with it; rounding."""
    about_x = np.array(B)[:, [1, 0, 2]]
    roll = 0.25 * np.pi * 0.999 / STEP
    f = gendata(A, STEP, about_x, STEP, 0.001, 999, accel_frame="body")[:3]
    gravity = rotation.dcm_from_rpy((roll, 0.0, 0.0)).T @ (0.0, 0.0, GRAVITY)
    np.testing.assert_allclose(f, (0.0, -12.0 / STEP**2, 0.0) - gravity, atol=1e-12)


@pytest.mark.parametrize(("place", "order"), [(0.0, 1), (0.5, 2)])
def test_the_solution_returns_the_path(place, order):
    """Samples at the start of their interval: first order in the step; at the middle: second. Discretisation."""
    off = []
    for h in (0.02, 0.01, 0.005):
        n = round(10.0 / h)
        samples = gendata(A, STEP, B, STEP, h, np.arange(n) + place)
        result = flat_navigation(samples, h, A[0], np.array((5.0, 12.0, -2.0)) / STEP, np.eye(3))
        off.append(np.linalg.norm(result.r_n[-1] - A[-1]))
        np.testing.assert_allclose(result.C_nb[-1] @ (1.0, 0.0, 0.0), (0.0, 0.0, -1.0), atol=1e-9)
    np.testing.assert_allclose(np.divide(off[:-1], off[1:]), 2.0**order, rtol=0.02)


def test_first_order_attitude_stretches():
    """A column grows by sqrt(1 + (omega tau)^2) a step; rounding."""
    samples = np.zeros((100, 6))
    samples[:, 5] = 2.0
    C = flat_navigation(samples, 0.01, np.zeros(3), np.zeros(3), np.eye(3), attitude="first order").C_nb[-1]
    assert np.linalg.norm(C[:, 0]) == pytest.approx((1.0 + 0.02**2) ** 50, rel=1e-12)


def test_velocity_from_samples_is_wrong_by_half_the_acceleration():
    t = np.array((0.0, 0.006))[:, None]
    r = t * (1.0, 2.0, 3.0) + 0.5 * t**2 * (0.0, -0.5, 0.0)
    np.testing.assert_allclose(velocity_from_samples(r, 0.006), (1.0, 2.0 - 0.0015, 3.0), atol=1e-12)


def test_what_cannot_be_done_is_said():
    with pytest.raises(InputError, match="expected 'navigation' or 'body'"):
        gendata(A, STEP, B, STEP, 0.01, 0, accel_frame="earth")
    with pytest.raises(InputError, match=r"within 0..10 s"):
        gendata(A, STEP, B, STEP, 0.01, 1001)
    with pytest.raises(InputError, match="'exact' or 'first order'"):
        flat_navigation(np.zeros((1, 6)), 0.01, np.zeros(3), np.zeros(3), np.eye(3), attitude="second")
    with pytest.raises(InputError, match="at least two positions"):
        velocity_from_samples(np.zeros((1, 3)), 0.01)
