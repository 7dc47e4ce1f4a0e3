"""Names of all errors, their way to the simulator, and what stays of them."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from schuler.exceptions import InputError
from schuler.reproduce.flenniken.study.rocket import RocketErrors, all_angles, is_random, parameter_names
from schuler.sensors.catalogue import spec
from schuler.sensors.initial_errors import InitialErrors
from schuler.sensors.triads import C_FRD_FUR

RNG = np.random.default_rng(0)


def some(scale=1e-3):
    return RocketErrors.of({n: scale * (i + 1) for i, n in enumerate(parameter_names())})


def test_names():
    names = parameter_names()
    assert len(set(names)) == 54
    assert [sum(n.startswith(p) for n in names) for p in ("gyro_", "accel_", "start_")] == [21, 27, 6]
    assert sum(map(is_random, names)) == 18
    assert tuple(RocketErrors().parameters()) == names


def test_there_and_back():
    values = {n: 1e-3 * (i + 1) for i, n in enumerate(parameter_names())}
    assert some().parameters() == values
    changed = some().replaced(start_roll=0.5)
    assert changed.parameters() == values | {"start_roll": 0.5}


def test_only_one():
    alone = {k: v for k, v in some().only("accel_sigma_b_y").parameters().items() if "_tau_" not in k}
    assert {k for k, v in alone.items() if v} == {"accel_sigma_b_y"}
    assert some().only("accel_sigma_b_y").accel.tau[1] == some().accel.tau[1]


def test_fixed_has_no_noise_and_drawn_keeps_it():
    assert not any(v for k, v in some().fixed().parameters().items() if is_random(k) and "_tau_" not in k)
    drawn, given = some().drawn(RNG).parameters(), some().parameters()
    assert all((drawn[k] == given[k]) == is_random(k) for k in given)


def test_to_the_simulator():
    """Response of the linear part in axes forward, right, down; rounding."""
    values = {k: v for k, v in some().parameters().items() if not is_random(k) and "quadratic" not in k}
    errors = RocketErrors.of({k: v for k, v in values.items() if "asymmetry" not in k})
    imu, u = errors.imu_errors(), RNG.standard_normal((5, 3))
    for triad, M, b in ((errors.gyro, imu.M_g, imu.b_g), (errors.accel, imu.M_a, imu.b_a)):
        expected = (triad.respond(u @ C_FRD_FUR) + triad.bias) @ C_FRD_FUR.T
        assert_allclose(u + u @ M.T + b, expected, rtol=1e-12)
    with pytest.raises(InputError, match="linear"):
        some().fixed().imu_errors()
    assert_allclose(some().fixed().imu_errors(drop_nonlinear=True).M_a, imu.M_a)


def test_errors_of_the_start_have_the_other_sign_of_the_source():
    """Thesis: actual = assumed + error; north, east, up and roll, pitch, yaw."""
    values = dict(zip(("north", "up", "east", "roll", "yaw", "pitch"), (1.0, 2.0, 3.0, 0.1, 0.2, 0.3), strict=True))
    ours = RocketErrors.of({f"start_{k}": v for k, v in values.items()}).initial_errors()
    theirs = InitialErrors.from_flenniken([-1.0, -3.0, -2.0], [-0.1, -0.3, -0.2])
    assert_allclose(ours.dr_n, theirs.dr_n)
    assert_allclose(ours.drpy, theirs.drpy)


def test_simple_model_of_a_grade():
    e, s = RocketErrors.simple(spec("flenniken-tactical"), start="zero"), spec("flenniken-tactical")
    assert_allclose(e.gyro.N, s.gyro.random_walk)
    assert_allclose(e.accel.sigma_b, s.accel.in_run_bias)
    assert e.accel.start == "zero"
    assert sum(v != 0.0 for k, v in e.parameters().items() if "_tau_" not in k) == 12


def test_twelve_angles():
    result = {k for k, v in all_angles(1e-4).parameters().items() if v == 1e-4}
    assert len(result) == 12
    assert all_angles(1e-4, printed=True).gyro.printed


def test_unknown_names_are_refused():
    with pytest.raises(InputError, match="no such parameter"):
        RocketErrors.of({"gyro_tilt_x": 1.0})
    with pytest.raises(InputError, match="no such parameter"):
        RocketErrors().only("roll")
