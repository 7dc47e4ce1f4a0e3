"""Names and gauges of calibration parameters."""

import numpy as np
import pytest

from schuler.calibration.result.parameters import LINEAR, imu_errors, in_gauge, rotation_to, unit, vector
from schuler.exceptions import InputError
from schuler.sensors.errors import ImuErrors


def some(seed: int = 1, size: float = 0.02) -> ImuErrors:
    rng = np.random.default_rng(seed)
    return imu_errors(dict(zip(LINEAR, size * rng.standard_normal(len(LINEAR)), strict=True)))


def test_names_and_vector_are_inverse():
    values = np.arange(len(LINEAR), dtype=float)
    errors = imu_errors(dict(zip(LINEAR, values, strict=True)))
    np.testing.assert_array_equal(vector(errors), values)
    np.testing.assert_array_equal(vector(errors, ("M_g_xy", "b_a_z")), [16.0, 2.0])
    assert errors.M_a[1, 2] == 8.0


@pytest.mark.parametrize(("gauge", "zero"), [("lower", np.triu_indices(3, 1)), ("upper", np.tril_indices(3, -1))])
def test_triangular_gauges(gauge, zero):
    M = in_gauge(some(), gauge).M_a
    np.testing.assert_allclose(M[zero], 0.0, atol=1e-15)  # rounding
    assert (np.diag(M) > -1.0).all()


def test_symmetric_gauge_is_nearest():
    errors = some()
    M = in_gauge(errors, "symmetric").M_a
    np.testing.assert_allclose(M, M.T, atol=1e-15)  # rounding
    near = np.linalg.norm(errors.M_a)
    assert np.linalg.norm(M) <= near + 1e-15


@pytest.mark.parametrize("gauge", ["lower", "upper", "symmetric"])
def test_the_sensor_reads_the_same(gauge):
    """What is called x, y, z turns by C, what is read does not change: rounding."""
    errors = some()
    C = rotation_to(errors.M_a, gauge)
    np.testing.assert_allclose(C @ C.T, np.eye(3), atol=1e-15)
    assert np.linalg.det(C) == pytest.approx(1.0)
    turned = in_gauge(errors, gauge)
    rng = np.random.default_rng(3)
    f, omega = rng.standard_normal(3), rng.standard_normal(3)
    before = (np.eye(3) + errors.M_g) @ omega + errors.G_g @ f, (np.eye(3) + errors.M_a) @ f
    after = (np.eye(3) + turned.M_g) @ C @ omega + turned.G_g @ C @ f, (np.eye(3) + turned.M_a) @ C @ f
    np.testing.assert_allclose(after, before, atol=1e-14)
    twice = in_gauge(turned, gauge)
    np.testing.assert_allclose(twice.M_g, turned.M_g, atol=1e-15)


def test_what_cannot_be():
    with pytest.raises(InputError, match="expected a name such as b_a_x"):
        unit("b_a_w")
    with pytest.raises(InputError, match="body axes cannot be invented"):
        rotation_to(np.zeros((3, 3)), "full")
    with pytest.raises(InputError, match="right-handed"):
        rotation_to(np.diag([-2.0, 0.0, 0.0]), "lower")
