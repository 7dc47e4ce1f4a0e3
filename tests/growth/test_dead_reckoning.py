"""Dead reckoning in the plane and in space: true readings return the truth, Monte Carlo meets the closed forms."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from schuler import rotation
from schuler.exceptions import InputError
from schuler.growth import growth, lateral, planar_bounds, planar_reckoning, spatial_bounds, spatial_reckoning
from schuler.growth.dead_reckoning import upright_bounds, upright_reckoning
from schuler.reproduce.flenniken.study.tables import SIX_DEGREES
from schuler.sensors.catalogue import spec
from schuler.units import DEG, G0


def test_planar_circle_returns():
    """Full circle with centripetal-free forward acceleration zero: heading 360 deg, no displacement; rounding."""
    heading, velocity, position = planar_reckoning(np.full((100, 1), 2.0 * np.pi / 10.0), np.zeros((100, 1)), 0.1)
    assert_allclose(heading[-1], 2.0 * np.pi, rtol=1e-12)
    assert_allclose(velocity, 0.0)
    assert_allclose(position, 0.0)


def test_planar_converges_with_first_order():
    """Inputs held over a step: error of a turning, accelerating platform falls with the step (discretisation)."""

    def end(step):
        count = round(10.0 / step)
        return planar_reckoning(np.full((count, 1), 0.2), np.full((count, 1), 1.0), step)[1][-1, 0]

    exact = np.array([np.sin(2.0) / 0.2, (1.0 - np.cos(2.0)) / 0.2])
    coarse, fine = (np.linalg.norm(end(step) - exact) for step in (0.1, 0.05))
    assert 1.9 < coarse / fine < 2.1


def test_sum_is_runge_kutta_with_held_inputs():
    """Position after one step is v T + a T^2 / 2, which Flenniken reaches by four evaluations; rounding."""
    _, velocity, position = planar_reckoning(np.zeros((2, 1)), np.array([[1.0], [3.0]]), 0.5)
    assert_allclose(velocity[:, 0, 0], [0.5, 2.0])
    assert_allclose(position[:, 0, 0], [0.125, 0.125 + 0.25 + 0.375])


def test_gravity_goes_to_the_channel_it_belongs_to():
    """A pitch error nose up decelerates north by g theta; as printed it is the upward channel. Up: second order."""
    rate, accel = np.zeros((100, 1)), np.zeros((100, 1))
    rate[0] = 0.01 / 0.1
    _, v, _ = upright_reckoning(rate, accel, 0.1)
    assert_allclose(v[-1, 0, 0], -G0 * 0.01 * 9.9, rtol=1e-4)
    assert_allclose(v[-1, 0, 1], -0.5 * G0 * 0.01**2 * 9.9, rtol=1e-4)
    _, printed, _ = upright_reckoning(rate, accel, 0.1, gravity_model="thesis")
    assert_allclose(printed[-1, 0], [0.0, -G0 * 0.01 * 9.9], atol=1e-4)
    with pytest.raises(InputError, match="gravity_model"):
        upright_reckoning(rate, accel, 0.1, gravity_model="other")


def test_true_readings_return_the_truth_in_space():
    """At rest and tilted, six sensors without errors stay where they are; rounding."""
    rpy = (0.3, -0.2, 1.0)
    force = np.broadcast_to(rotation.dcm_from_rpy(np.array(rpy)).T @ [0.0, 0.0, -G0], (50, 2, 3))
    for attitude in ("strapdown", "thesis"):
        angles, v, p = spatial_reckoning(np.zeros((50, 2, 3)), force, 0.1, attitude=attitude, rpy=rpy)
        assert_allclose(angles[-1], [rpy, rpy], rtol=1e-12)
        assert_allclose(v, 0.0, atol=1e-12)
        assert_allclose(p, 0.0, atol=1e-12)
    with pytest.raises(InputError, match="attitude"):
        spatial_reckoning(np.zeros((5, 2, 3)), force[:5], 0.1, attitude="other")


def test_summed_angles_are_wrong_for_large_turns():
    """Roll by 80 deg, then pitch about the body: sums of rates know nothing of the order (E21)."""
    rate = np.zeros((20, 1, 3))
    rate[:10, 0, 0] = rate[10:, 0, 1] = 80.0 * DEG
    force = np.zeros((20, 1, 3))
    right = spatial_reckoning(rate, force, 0.1, gravity=0.0)[0][-1, 0]
    summed = spatial_reckoning(rate, force, 0.1, gravity=0.0, attitude="thesis")[0][-1, 0]
    turned = np.linalg.norm(rotation.dcm_from_rpy(right) - rotation.dcm_from_rpy(summed))
    assert turned > 0.5


@pytest.mark.thinned(3)
@pytest.mark.parametrize("grade", ["consumer", "tactical"])
@pytest.mark.parametrize("start", ["zero", "stationary"])
def test_planar_monte_carlo_meets_the_closed_forms(grade, start):
    """5,000 runs, four standard errors; samples of 10 Hz leave 3 / k = 1 % of a variance at 30 s."""
    result = planar_bounds(spec(f"flenniken-{grade}"), 30.0, rate_hz=10.0, runs=5000, start=start, seed=7)
    exact = growth(spec(f"flenniken-{grade}"), result.t, gravity=0.0, start=start)
    for k in (149, 299):
        for name, quantity in (("heading", "heading"), ("velocity_north", "velocity"), ("position_north", "position")):
            ratio = result.sigma[name][k] / exact.total(quantity)[k]
            assert abs(ratio - 1.0) < 4.0 * result.uncertainty + 0.01
    if start == "stationary":
        pairs = [(s.random_walk, s.in_run_bias, s.in_run_time) for s in (spec(f"flenniken-{grade}").accel,)]
        g = spec(f"flenniken-{grade}").gyro
        v, p = np.sqrt(lateral(30.0, pairs[0], (g.random_walk, g.in_run_bias, g.in_run_time)))
        assert abs(result.sigma["velocity_east"][-1] / v - 1.0) < 0.05
        assert abs(result.sigma["position_east"][-1] / p - 1.0) < 0.05


@pytest.mark.campaign
@pytest.mark.parametrize("grade", ["consumer", "tactical"])
@pytest.mark.thinned(2)
def test_upright_monte_carlo_meets_the_closed_forms(grade):
    """North with gravity; as printed, upwards what gravity alone adds; without gravity as in the plane. 4 errors."""
    imu = spec(f"flenniken-{grade}")
    with_g, printed, without = (
        upright_bounds(imu, 30.0, rate_hz=10.0, runs=4000, seed=11, **options)
        for options in ({}, {"gravity_model": "thesis"}, {"gravity": 0.0})
    )
    t = with_g.t[[-1]]
    exact, flat = growth(imu, t, start="zero"), growth(imu, t, start="zero", gravity=0.0)
    for q in ("velocity", "position"):
        whole, part = float(exact.total(q)[0]), float(flat.total(q)[0])
        tilt = np.sqrt(whole**2 - part**2)
        for result, expected in (
            (with_g.sigma[f"{q}_north"], whole), (printed.sigma[f"{q}_up"], tilt), (without.sigma[f"{q}_north"], part),
        ):  # fmt: skip
            assert abs(result[-1] / expected - 1.0) < 4.0 * with_g.uncertainty + 0.01
    plane = planar_bounds(imu, 30.0, rate_hz=10.0, runs=4000, seed=11)
    assert_allclose(without.sigma["pitch"], plane.sigma["heading"])
    assert with_g.index(15.0) == 149


def test_moving_platform_errs_across_its_acceleration():
    """A heading error turns the true acceleration: across the track far more than at rest."""
    still = planar_bounds(spec("flenniken-tactical"), 20.0, runs=300, seed=8)
    moving = planar_bounds(spec("flenniken-tactical"), 20.0, runs=300, seed=8, acceleration=2.0)
    assert moving.sigma["position_east"][-1] > 20.0 * still.sigma["position_east"][-1]
    assert_allclose(moving.sigma["heading"], still.sigma["heading"], rtol=1e-9)


@pytest.mark.parametrize("runs", [500, pytest.param(1500, marks=pytest.mark.campaign)])
@pytest.mark.parametrize("grade", ["consumer", "tactical"])
@pytest.mark.thinned(2)
def test_six_sensors_at_rest(grade, runs):
    """Flenniken, chapter 5: closed form and its own Monte Carlo; four standard errors and 1 %."""
    with_g = spatial_bounds(spec(f"flenniken-{grade}"), 60.0, rate_hz=10.0, runs=runs, seed=9)
    without = spatial_bounds(spec(f"flenniken-{grade}"), 60.0, rate_hz=10.0, runs=runs, seed=9, gravity=0.0)
    tolerance = 4.0 * with_g.uncertainty + 0.02
    exact = growth(spec(f"flenniken-{grade}"), [60.0])
    flat = growth(spec(f"flenniken-{grade}"), [60.0], gravity=0.0)
    v, p, up, *_ = SIX_DEGREES[grade]
    for axis in ("north", "east"):
        assert abs(with_g.sigma[f"velocity_{axis}"][-1] / exact.total("velocity")[0] - 1.0) < tolerance
        assert abs(with_g.sigma[f"position_{axis}"][-1] / p - 1.0) < tolerance
        assert abs(without.sigma[f"velocity_{axis}"][-1] / flat.total("velocity")[0] - 1.0) < tolerance
    assert abs(with_g.sigma["velocity_north"][-1] / v - 1.0) < tolerance
    assert abs(with_g.sigma["velocity_down"][-1] / up - 1.0) < tolerance + 0.05
    assert abs(with_g.sigma["heading"][-1] / (exact.total("heading")[0]) - 1.0) < tolerance
    assert with_g.sigma["roll"][-1] / DEG < 12.0
