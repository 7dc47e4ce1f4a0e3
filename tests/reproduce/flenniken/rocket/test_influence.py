"""Sensitivities: closed forms, an independent simulation's table, flights, brute-force covariances, the engine."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from schuler.budget import linear_covariance, linearised_mission
from schuler.exceptions import InputError
from schuler.filtering.measurements import MeasurementSchedule
from schuler.reproduce.flenniken.study.rocket import (
    RocketErrors,
    RocketProfile,
    all_angles,
    impact_budget,
    impact_scatter,
    influence,
    parameter_names,
    rocket_motion,
    rocket_trajectory,
)
from schuler.reproduce.flenniken.study.rocket.errors import is_random
from schuler.reproduce.flenniken.study.tables import sensitivity_table
from schuler.sensors.catalogue import spec
from schuler.units import G0

T1R = rocket_trajectory()
WEIGHTS = {v: influence(T1R, v) for v in ("thesis", "strapdown")}
CONSTANTS = [n for n in parameter_names() if not is_random(n)]


def test_sensitivities_are_those_of_an_independent_simulation():
    """Within 1 %, or half of the last printed digit where that is more."""
    table = sensitivity_table(T1R)
    for row in table.rows:
        assert_allclose(row[6:], row[3:6], rtol=0.01, atol=0.0051, err_msg=str(row[:3]))
    assert len(table) == 40


def test_closed_forms():
    """A misaligned accelerometer senses 8 g for 12.5 s and the error coasts; a bias grows with t^2 / 2; rounding."""
    end, w = T1R.t[-1], WEIGHTS["strapdown"]
    east = w.effect(RocketErrors.of({"accel_misalignment_y": 1e-6}))[2]
    assert_allclose(east, 8.0 * G0 * 1e-6 * 12.5 * (end - 6.25), rtol=1e-9)
    for v in WEIGHTS.values():
        assert_allclose(v.effect(RocketErrors.of({"accel_bias_z": 1e-3}))[2], 0.5e-3 * end**2, rtol=1e-6)
        assert_allclose(v.effect(RocketErrors.of({"start_up": 2.0})), [0.0, 2.0, 0.0])
        assert_allclose(sum(v.white("accel")), end**3 / 3.0 * np.eye(3), rtol=1e-6, atol=1e-6)
    # a heading error to the left turns all that is sensed: the thrust's 85 km, not what gravity did to height
    west = w.effect(RocketErrors.of({"start_yaw": 1e-4}))
    assert_allclose(west, [0.0, 0.0, -1e-4 * T1R.r[-1, 0]], rtol=1e-6, atol=1e-9)


def test_print_flips_two_angles_in_the_roll_row():
    w = WEIGHTS["thesis"]
    for name in CONSTANTS:
        plain, printed = (RocketErrors.of({name: 1e-5}, printed=p) for p in (False, True))
        factor = -1.0 if name == "gyro_misalignment_y" else 1.0  # z acts on roll by yaw rate, of which there is none
        assert_allclose(w.effect(printed), factor * w.effect(plain), atol=1e-12)


@pytest.mark.parametrize("variant", ["thesis", "strapdown"])
def test_linear_is_the_limit_of_flights(variant):
    """Small constants, 5 Hz, a rocket that turns while it burns so that every rotation counts.

    Second order in the size (central difference), discretisation of the turn in steps of 0.2 s: 1e-3.
    """
    T = rocket_trajectory(RocketProfile(turn_start=6.0), rate_hz=5.0)
    w, size = influence(T, variant), 1e-5
    scale = {"start_north": 1.0, "start_up": 1.0, "start_east": 1.0}
    for name in ("gyro_bias_x", "gyro_bias_y", "gyro_bias_z", "gyro_misalignment_y", "gyro_scale_factor_z",
                 "accel_quadratic_x", "accel_asymmetry_x", "accel_non_orthogonality_z",
                 "start_east", "start_roll", "start_yaw", "start_pitch"):  # fmt: skip
        h = scale.get(name, size)
        plus, minus = (
            impact_scatter(T, RocketErrors.of({name: s * h}), runs=2, variant=variant).position[0] for s in (1, -1)
        )
        linear = w.effect(RocketErrors.of({name: h}))
        assert_allclose(0.5 * (plus - minus), linear, atol=1e-3 * np.linalg.norm(linear) + 1e-6, err_msg=name)


@pytest.mark.parametrize("start", ["stationary", "zero"])
@pytest.mark.parametrize("triad", ["gyro", "accel"])
def test_covariance_of_moving_biases_is_the_double_sum(triad, start):
    """Rounding."""
    T = rocket_trajectory(RocketProfile(turn_start=6.0), rate_hz=2.0)
    w, tau = influence(T), np.array([5.0, 60.0, 1000.0])
    W = getattr(w, triad) * T.dt[:, None, None]
    for axis in range(3):
        lag = np.abs(T.middle[:, None] - T.middle)
        R = np.exp(-lag / tau[axis])
        if start == "zero":
            R = R - np.exp(-(T.middle[:, None] + T.middle) / tau[axis])
        expected = W[:, :, axis].T @ R @ W[:, :, axis]
        assert_allclose(w.moving(triad, tau, start)[axis], expected, rtol=1e-10, atol=1e-12 * np.trace(expected))


def test_a_bias_that_hardly_moves_is_a_constant():
    """tau of 1e9 s; to first order in T / tau."""
    w = WEIGHTS["strapdown"]
    P = w.moving("gyro", np.full(3, 1e9))
    for i, axis in enumerate("xyz"):
        d = w.effect(RocketErrors.of({f"gyro_bias_{axis}": 1e-6})) / 1e-6
        assert_allclose(P[i], np.outer(d, d), rtol=1e-5, atol=1e-6 * np.trace(P[i]) + 1e-12)


def test_ranking_of_the_source_and_why():
    """As printed in section 7.4 with kinematic accelerations; with specific force gyroscope angles do nothing."""
    thesis, strapdown = (impact_budget(WEIGHTS[v], all_angles(5e-4)) for v in ("thesis", "strapdown"))
    assert list(thesis.names[:4:2]) == ["gyro_misalignment_y", "accel_misalignment_y"]
    assert_allclose(thesis.contribution[:4:2], [115.5, 109.8], rtol=0.01)
    assert set(strapdown.names[:4]) == {f"accel_{k}_{a}" for k in ("misalignment", "non_orthogonality") for a in "yz"}
    assert_allclose(strapdown.contribution[:4], 74.1, rtol=0.01)
    assert strapdown.contribution[4:].max() < 1e-9


def test_mean_east_of_the_source():
    """450 m with (6.7) as printed and 500 urad, 219 m corrected; printed digits."""
    for printed, east in ((True, 450.5), (False, 219.0)):
        budget = impact_budget(WEIGHTS["thesis"], all_angles(5e-4, printed=printed))
        assert_allclose(budget.mean[2], east, rtol=5e-3)
        assert_allclose(budget.together, np.linalg.norm(budget.mean), rtol=1e-12)


def test_budget_adds_up():
    """Variances of all parameters are the variance in all, within rounding; shares are one."""
    errors = RocketErrors.simple(spec("flenniken-tactical")).replaced(
        gyro_bias_z=5e-6, accel_quadratic_x=1e-6, accel_misalignment_y=3e-4, start_up=5.0, start_yaw=1e-4
    )
    w = WEIGHTS["strapdown"]
    budget = impact_budget(w, errors)
    fixed = errors.fixed()
    P = w.noise_covariance(errors)
    for name in CONSTANTS:
        d = w.effect(fixed.only(name))
        P = P + np.outer(d, d)
    assert_allclose(budget.P.sum(axis=0), P, rtol=1e-12, atol=1e-9)
    assert_allclose(budget.shares.sum(), 1.0, rtol=1e-12)
    assert_allclose(budget.sigma**2, np.trace(P), rtol=1e-12)
    assert list(budget.contribution) == sorted(budget.contribution, reverse=True)
    assert_allclose(budget.mean, w.effect(errors), rtol=1e-4, atol=1e-6)
    assert_allclose(budget.ellipse.P, T1R.ground @ P @ T1R.ground.T, rtol=1e-12)
    assert len(budget.table()) == len(budget.names) + 2 == 19
    assert "all on as they are" in budget.summary()
    assert budget.to_dict()["ellipse"]["cep"] > 0.0


def test_the_engine_agrees_on_the_rotating_earth():
    """Sources of the engine's covariance, nine states, no aids.

    The flight is 1.2 % longer there: 2.5 % of t^2, and 0.6 % by gravity in height.
    """
    mission = linearised_mission(
        rocket_motion(), MeasurementSchedule.empty(), [1e-3] * 3 + [1e-9] * 6, states=9, every_s=20.0
    )
    engine = linear_covariance(mission, spec("flenniken-tactical"))
    result = dict(zip(engine.names, engine.parts[:, -1, 6:9], strict=True))
    w, e = WEIGHTS["strapdown"], RocketErrors.simple(spec("flenniken-tactical"))
    for part, of in (("noise", "N"), ("in_run_bias", "sigma_b")):
        for triad in ("gyro", "accel"):
            P = sum(w.covariance(e, f"{triad}_{of}_{axis}") for axis in "xyz")
            north, up, east = np.sqrt(np.diag(P))
            assert_allclose(result[f"{triad}_{part}"], [north, east, up], rtol=0.04)
    yaw, pitch = (w.effect(RocketErrors.of({n: 1e-3})) for n in ("start_yaw", "start_pitch"))
    assert_allclose(result["attitude_down"][1], abs(yaw[2]), rtol=0.02)
    assert_allclose(result["attitude_east"][[0, 2]], np.abs(pitch[:2]), rtol=0.02)


def test_refusals():
    with pytest.raises(InputError, match="variant"):
        influence(T1R, "other")
    with pytest.raises(InputError, match="triad"):
        WEIGHTS["thesis"].white("magnetometer")
    with pytest.raises(InputError, match="all parameters are zero"):
        impact_budget(WEIGHTS["thesis"], RocketErrors())
