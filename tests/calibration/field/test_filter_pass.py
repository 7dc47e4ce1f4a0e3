"""One pass of the calibration filter: the prior counts once, whatever a pass started from."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from field_cases import AUTOMOTIVE, LLH, Scene, calibrated, faces, field_layout, log_of, signed

from schuler.calibration.field import filter_pass as module
from schuler.calibration.field.blocks import rest_blocks
from schuler.calibration.field.filter_pass import filter_pass, replace_start_by_prior
from schuler.calibration.field.noise_inflation import LARGEST_ERROR, LARGEST_ERROR_HELD, inflate_noise, noise_inflation
from schuler.calibration.field.options import FieldOptions
from schuler.calibration.field.problem import field_problem, wandering_parameters
from schuler.exceptions import InputError
from schuler.filtering.measurements import FIX, GRAVITY_VECTOR, ZERO_RATE, MeasurementSchedule, merged
from schuler.filtering.states import StateLayout, StateModel
from schuler.simulation.steps import Rest, Routine, Turn
from schuler.units import DEG, G0


def problem_with(prior, P0):
    """As much of a problem as the prior needs."""
    return SimpleNamespace(prior=prior, layout=SimpleNamespace(initial_variances=lambda: P0))


@pytest.mark.parametrize("width", [0.01, 1.0, 2.0, 1e4, "mixed"])
@pytest.mark.parametrize("rows", [0, 2, 5, 40])
def test_the_prior_counts_once_in_a_linear_problem(rows, width):
    """Start anywhere with any variance, measure, exchange the start for the prior: the same as starting at the prior.

    Tolerance: rounding, in units of the prior.
    """
    rng, m = np.random.default_rng([rows, 3]), 5
    P0 = np.array([1e-6, 1.0, 1e4, 1e-12, 25.0])
    unit = np.sqrt(P0)
    H = rng.normal(size=(rows, m)) / unit
    prior, start = unit * rng.normal(size=m), unit * rng.normal(size=m)
    V = P0 * (np.array([0.1, 2.0, 30.0, 1.0, 1e3]) if width == "mixed" else width)
    z = H @ (unit * rng.normal(size=m)) + 0.1 * rng.normal(size=rows)

    def posterior(mean, variance):
        N = np.diag(1.0 / variance) + H.T @ H / 0.01
        return mean + np.linalg.solve(N, H.T @ (z - H @ mean) / 0.01), np.linalg.inv(N)

    values, P = replace_start_by_prior(problem_with(prior, P0), start, V, *posterior(start, V))
    expected, C = posterior(prior, P0)
    np.testing.assert_allclose((values - expected) / unit, 0.0, atol=1e-7 if width == 0.01 else 1e-9)
    np.testing.assert_allclose((P - C) / np.outer(unit, unit), 0.0, atol=1e-7 if width == 0.01 else 1e-9)


def test_what_is_known_exactly_stays():
    P0 = np.array([1.0, 0.0, 4.0])
    P = np.array([[0.5, 0.0, 0.1], [0.0, 0.0, 0.0], [0.1, 0.0, 1.0]])
    values, C = replace_start_by_prior(
        problem_with(np.array([0.0, 2.0, 0.0]), P0), np.array([0.3, 2.0, 0.1]), 2.0 * P0, np.array([0.2, 2.0, 0.4]), P
    )
    assert values[1] == 2.0
    np.testing.assert_array_equal(C[1], 0.0)
    assert np.isfinite(C).all()


@pytest.fixture(scope="module")
def log():
    scene, spec = faces(), AUTOMOTIVE
    return scene, log_of(scene, signed(spec, 1.0, 0.02), np.random.default_rng(4))


def problem_for(scene, imu, spec, options=None, heading=(0.0, DEG)):
    options = options or FieldOptions()
    rests = scene.rests(imu)
    blocks = rest_blocks(imu, rests, options.block_s)
    layout = field_layout(spec, options)
    return field_problem(imu, spec, blocks, rests, layout, options, LLH[0], LLH[2], None, heading, None)


RPY = np.array([0.0, 0.0, 0.0])


def test_a_pass_from_elsewhere_finds_the_same(log):
    """Small errors and a prior that knows it, so that all is linear: values to 0.03 sigma, sigmas to a percent."""
    scene, imu = log
    accel, gyro = AUTOMOTIVE.accel, AUTOMOTIVE.gyro
    fields = ("turn_on_bias", "scale_factor", "misalignment")
    narrow = replace(
        AUTOMOTIVE,
        accel=replace(accel, **{name: 0.02 * getattr(accel, name) for name in fields}),
        gyro=replace(gyro, **{name: 0.02 * getattr(gyro, name) for name in (*fields, "g_sensitivity")}),
    )
    problem = problem_for(scene, imu, narrow)
    plain = filter_pass(problem, RPY)
    sigma = np.sqrt(np.diag(plain.covariance))
    rng = np.random.default_rng(1)
    for start, near in (
        (plain.values, None),
        (plain.values, sigma),
        (plain.values + sigma * rng.normal(size=30), sigma),
    ):
        again = filter_pass(problem, RPY, start, near)
        np.testing.assert_allclose(again.values / sigma, plain.values / sigma, atol=0.03)
        np.testing.assert_allclose(np.sqrt(np.diag(again.covariance)) / sigma, 1.0, atol=0.01)


def test_sigmas_do_not_shrink_from_pass_to_pass(log):
    """Ten passes over one log know what one knows: the determinant of the covariance stays, to a percent a state."""
    scene, imu = log
    few, many = (
        calibrated(scene, imu, AUTOMOTIVE, FieldOptions(passes=n, settled=1e-12, rescale=False)).calibration
        for n in (3, 10)
    )
    ratio = np.exp((np.linalg.slogdet(many.covariance)[1] - np.linalg.slogdet(few.covariance)[1]) / 60.0)
    assert abs(ratio - 1.0) < 1e-3
    np.testing.assert_allclose(many.values / few.sigma, few.values / few.sigma, atol=0.02)


@pytest.mark.parametrize("sign", [-1.0, 1.0])
def test_what_a_log_does_not_tell_keeps_its_prior(sign):
    """Turned about x only: what reads rates about y and z is not seen. After any number of passes value and sigma are
    those of the prior, to a thousandth of it: Earth rate is all that turns about other axes."""
    steps = []
    for _ in range(8):
        steps += [Rest(4.0), Turn("x", 45.0 * DEG, 1.25)]
    scene = Scene.of(Routine((*steps, Rest(4.0))), 50.0)
    imu = log_of(scene, signed(AUTOMOTIVE, sign, 0.3))
    for passes in (2, 8):
        result = calibrated(scene, imu, AUTOMOTIVE, FieldOptions(passes=passes, settled=1e-12)).calibration
        for name in ("M_g_xy", "M_g_xz", "M_g_yy", "M_g_yz", "M_g_zy", "M_g_zz"):
            value, sigma = result[name]
            assert abs(value) < 1e-3 * result.prior_sigma[name], name
            assert sigma == pytest.approx(result.prior_sigma[name], rel=1e-3), name
        assert result["M_g_xx"][1] < 0.1 * result.prior_sigma["M_g_xx"]
        assert any("not determined" in line and "M_g_yy" in line for line in result.verdicts)
        assert result.status == "warning"


def test_the_first_attitude_hardly_counts(log):
    """Levelling uses readings that count as measurements too: its 1-sigma must not say much."""
    scene, imu = log
    problem = problem_for(scene, imu, AUTOMOTIVE)
    wide, wider = filter_pass(problem, RPY), filter_pass(replace(problem, tilt_sigma=0.3), RPY)
    np.testing.assert_allclose(np.sqrt(np.diag(wide.covariance) / np.diag(wider.covariance)), 1.0, atol=5e-3)


def test_walks_are_told_from_constants():
    layout = StateLayout(
        {
            "b_a": StateModel.random_walk(0.1, 1e-6),
            "b_g": StateModel.random_walk(1e-3, 1e-4),
            "S_a": StateModel.gauss_markov(0.01, 1e4),
            "S_g": StateModel.constant(0.01),
        }
    )
    increments = SimpleNamespace(start=0.0, t=np.array([100.0]), dt=np.array([100.0]))
    mask = wandering_parameters(SimpleNamespace(layout=layout, increments=increments))
    # 1e-5 beside 0.1; 1e-3 beside 1e-3; any decay
    np.testing.assert_array_equal(mask, np.repeat([False, True, True, False], 3))


def test_noise_is_enlarged_only_as_long_as_errors_of_second_order_are_large():
    """g eta^2 over thirty sigma of a block, eta errors of direction together; nothing at automotive grade.

    Over ten where rests are held.
    """
    layout = field_layout(AUTOMOTIVE, FieldOptions())
    for share in (1.0, 1e-3):
        noise = share * AUTOMOTIVE.accel.random_walk
        s = MeasurementSchedule.of(GRAVITY_VECTOR, [1.0, 2.0], np.zeros((2, 8)), noise**2)
        problem = SimpleNamespace(layout=layout, schedule=s)
        eta = AUTOMOTIVE.accel.turn_on_bias / G0 + 4 * 0.01  # scale factors and misalignments of both triads
        expected = max(1.0, G0 * eta**2 / (LARGEST_ERROR * noise))
        assert noise_inflation(problem, np.sqrt(layout.initial_variances())) == pytest.approx(expected, rel=1e-12)
        assert noise_inflation(problem, 1e-4 * np.sqrt(layout.initial_variances())) == 1.0
    assert expected > 100.0
    held = merged(s, MeasurementSchedule.of(ZERO_RATE, [1.0, 2.0], np.zeros((2, 3)), 1e-8))
    soft = noise_inflation(SimpleNamespace(layout=layout, schedule=held), np.sqrt(layout.initial_variances()))
    assert soft == pytest.approx(expected * LARGEST_ERROR / LARGEST_ERROR_HELD, rel=1e-12)


def test_what_holds_the_place_is_not_enlarged(log):
    scene, imu = log
    problem = problem_for(scene, imu, AUTOMOTIVE)
    soft = inflate_noise(problem, 5.0)
    fix = problem.schedule.kind == FIX
    np.testing.assert_array_equal(soft.schedule.R[fix], problem.schedule.R[fix])
    vector = problem.schedule.kind == GRAVITY_VECTOR
    np.testing.assert_allclose(soft.schedule.R[vector], 25.0 * problem.schedule.R[vector], rtol=1e-15)
    np.testing.assert_allclose(soft.gyro_psd, 25.0 * problem.gyro_psd, rtol=1e-15)
    assert inflate_noise(problem, 1.0) is problem


def test_a_filter_that_diverges_says_so(log, monkeypatch):
    scene, imu = log
    problem = problem_for(scene, imu, AUTOMOTIVE)
    monkeypatch.setattr(module, "replace_start_by_prior", lambda *a: (np.full(30, np.nan), np.eye(30)))
    with pytest.raises(InputError, match="the filter diverged: the log does not fit the specification of the IMU"):
        filter_pass(problem, RPY, problem.prior)
