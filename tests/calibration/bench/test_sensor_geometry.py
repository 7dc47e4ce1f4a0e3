"""Scale factors and angles of a triad as a lower triangular matrix, and back."""

import numpy as np
import pytest

from schuler.calibration.bench.sensor_geometry import (
    triad_derivative,
    triad_inverse,
    triad_matrix,
    triad_parameters,
    triad_reading,
    triad_truth,
)
from schuler.exceptions import InputError

ROUNDING = 1e-14


def active(axis: int, angle: float) -> np.ndarray:
    """Active rotation of a vector about a coordinate axis."""
    c, s = np.cos(angle), np.sin(angle)
    R = np.eye(3)
    i, j = [(1, 2), (2, 0), (0, 1)][axis]
    R[i, i], R[i, j], R[j, i], R[j, j] = c, -s, s, c
    return R


def test_the_axes_are_the_rotated_axes():
    """Hayal (3.6) to (3.9): y turned about z, z turned about y and then about x."""
    yz, zx, zy = 0.3, -0.2, 0.5
    T = triad_matrix(np.zeros(3), (yz, zx, zy))
    np.testing.assert_allclose(T[0], (1, 0, 0), atol=ROUNDING)
    np.testing.assert_allclose(T[1], active(2, yz) @ (0, 1, 0), atol=ROUNDING)
    np.testing.assert_allclose(T[2], active(0, zx) @ active(1, zy) @ (0, 0, 1), atol=ROUNDING)


def test_axes_are_unit_vectors_and_scale_multiplies_them():
    s = np.array((0.1, -0.05, 0.2))
    M = triad_matrix(s, (0.3, -0.2, 0.5))
    np.testing.assert_allclose(np.linalg.norm(M, axis=1), 1 + s, atol=ROUNDING)
    assert not np.triu(M, 1).any()


def test_small_angles_agree_to_second_order():
    s, theta = np.array((1e-4, 2e-4, -3e-4)), np.array((1e-4, -2e-4, 3e-4))
    exact, small = triad_matrix(s, theta), triad_matrix(s, theta, small_angle=True)
    # discretisation: products of two 3e-4
    np.testing.assert_allclose(exact, small, atol=2 * (3e-4) ** 2)
    assert np.abs(exact - small).max() > 1e-9
    np.testing.assert_array_equal(
        small, [[1 + 1e-4, 0, 0], [-1e-4, 1 + 2e-4, 0], [3e-4, 2e-4, 1 - 3e-4]]
    )  # signs of the corrected (3.15)


def test_inverse_is_the_closed_form_of_the_source():
    s, theta = np.array((0.1, -0.05, 0.2)), np.array((0.3, -0.2, 0.5))
    Y, b = np.array((1.3, -0.4, 2.2)), np.array((0.1, 0.2, -0.3))
    yz, zx, zy = theta
    u = (Y - b) / (1 + s)
    v_y = u[0] * np.tan(yz) + u[1] / np.cos(yz)
    v_z = -u[0] * np.tan(zy) / np.cos(zx) + v_y * np.tan(zx) + u[2] / (np.cos(zx) * np.cos(zy))
    np.testing.assert_allclose(triad_truth(Y, b, s, theta), (u[0], v_y, v_z), rtol=ROUNDING)
    np.testing.assert_allclose(triad_inverse(s, theta) @ triad_matrix(s, theta), np.eye(3), atol=ROUNDING)


def test_round_trips(rng):
    for _ in range(20):
        s, theta = rng.uniform(-0.3, 0.3, 3), rng.uniform(-0.8, 0.8, 3)
        back = triad_parameters(triad_matrix(s, theta))
        np.testing.assert_allclose(np.concatenate(back), np.concatenate((s, theta)), atol=ROUNDING)
    v = rng.normal(size=(7, 3))
    np.testing.assert_allclose(triad_truth(triad_reading(v, s, s, theta), s, s, theta), v, atol=10 * ROUNDING)


def test_many_triads_at_once_are_each_alone(rng):
    s, theta = rng.uniform(-0.1, 0.1, (4, 3)), rng.uniform(-0.1, 0.1, (4, 3))
    for function in (triad_matrix, triad_inverse):
        np.testing.assert_array_equal(function(s, theta), [function(a, b) for a, b in zip(s, theta, strict=True)])


def test_derivative_is_the_numerical_one():
    x = np.array((0.1, -0.05, 0.2, 0.3, -0.2, 0.5))
    J = triad_derivative(x[:3], x[3:])
    for i in range(6):
        h = np.zeros(6)
        h[i] = 1e-6
        up, down = (triad_matrix((x + d)[:3], (x + d)[3:]) for d in (h, -h))
        np.testing.assert_allclose(J[:, :, i], (up - down) / 2e-6, atol=1e-9)  # discretisation 1e-12, rounding 1e-10


@pytest.mark.parametrize(
    "M", [np.eye(3) + 1e-6 * np.triu(np.ones((3, 3)), 1), np.diag((1.0, -1.0, 1.0))], ids=["upper", "mirrored"]
)
def test_other_gauges_are_refused(M):
    with pytest.raises(InputError, match="in_gauge"):
        triad_parameters(M)


def test_an_impossible_triad_is_refused():
    with pytest.raises(InputError, match="right angle"):
        triad_inverse(np.zeros(3), (2.0, 0.0, 0.0))
    with pytest.raises(InputError, match="shape"):
        triad_matrix(np.zeros(2), np.zeros(3))
