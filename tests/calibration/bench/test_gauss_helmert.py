"""Adjustment of a triad from magnitudes: derivatives, exactness, statistics, what is not determined, convergence."""

import numpy as np
import pytest
from scipy.stats import chi2, kstest

from schuler.calibration.bench.gauss_helmert import _weights, adjust
from schuler.calibration.bench.magnitude import condition, ellipsoid_start, sphere_start
from schuler.calibration.bench.sensor_geometry import PARAMETERS, triad_reading
from schuler.calibration.design.plans import ATTITUDES
from schuler.exceptions import InputError

G, W = 9.801, 7.292115e-5
ACCEL = np.array([0.010] * 3 + [300e-6] * 3 + [100e-6] * 3)
GYRO = np.array([4.848e-6] * 3 + [150e-6] * 3 + [100e-6] * 3)
LARGE = np.array((0.3, -0.4, 0.2, 0.05, -0.08, 0.06, 0.05, -0.07, 0.04))


def readings(directions: np.ndarray, rho: float, x: np.ndarray) -> np.ndarray:
    return triad_reading(rho * directions, x[:3], x[3:6], x[6:])


def scattered(rng: np.random.Generator, directions: np.ndarray = ATTITUDES) -> np.ndarray:
    """Directions missed by two degrees."""
    u = directions + 0.035 * rng.standard_normal(directions.shape)
    return u / np.linalg.norm(u, axis=1, keepdims=True)


# ------------------------------------------------------------------------------------------------ derivatives


def test_condition_is_zero_at_the_truth():
    f, _, _ = condition(readings(ATTITUDES, G, LARGE), G, LARGE)
    np.testing.assert_allclose(f, 0.0, atol=1e-13 * G**2)  # rounding


def test_derivatives_are_the_numerical_ones(rng):
    Y = readings(ATTITUDES, 1.0, LARGE) + 0.1 * rng.standard_normal((26, 3))  # not on the surface
    _, A, B = condition(Y, 1.0, LARGE)
    h = 1e-6
    for i in range(9):
        d = h * np.eye(9)[i]
        numerical = (condition(Y, 1.0, LARGE + d)[0] - condition(Y, 1.0, LARGE - d)[0]) / (2 * h)
        np.testing.assert_allclose(A[:, i], numerical, atol=5e-9, err_msg=PARAMETERS[i])  # discretisation 1e-11
    for i in range(3):
        d = h * np.eye(3)[i]
        numerical = (condition(Y + d, 1.0, LARGE)[0] - condition(Y - d, 1.0, LARGE)[0]) / (2 * h)
        np.testing.assert_allclose(B[:, i], numerical, atol=5e-9)


def test_derivatives_of_fewer_parameters_are_those_of_the_source(rng):
    """(3.80) to (3.82) and (3.88), (3.89): zero angles, zero scale factors."""
    Y, x = rng.standard_normal((5, 3)), np.zeros(9)
    x[:6] = LARGE[:6]
    u = (Y - x[:3]) / (1 + x[3:6])
    f, A, B = condition(Y, 1.0, x)
    np.testing.assert_allclose(f, np.sum(u * u, axis=1) - 1.0, atol=1e-14)
    np.testing.assert_allclose(B, 2 * u / (1 + x[3:6]), atol=1e-14)
    np.testing.assert_allclose(A[:, :3], -B, atol=1e-14)
    np.testing.assert_allclose(A[:, 3:6], -2 * u**2 / (1 + x[3:6]), atol=1e-14)


# ---------------------------------------------------------------------------------------------- perfect data


@pytest.mark.parametrize("start", ["continuation", "ellipsoid", "zeros"])
@pytest.mark.parametrize(("rho", "x", "sigma"), [(G, ACCEL, 2.7e-4), (W, GYRO, 2.7e-6), (1e4 * W, GYRO, 2.7e-6)])
def test_perfect_data_returns_what_was_put_in(rng, start, rho, x, sigma):
    fit = adjust(readings(scattered(rng), rho, x), sigma, rho, start=start)
    assert fit.converged
    np.testing.assert_allclose(fit.values / ([rho] * 3 + [1] * 6), x / ([rho] * 3 + [1] * 6), atol=1e-13)
    assert fit.variance_of_unit_weight < 1e-18


@pytest.mark.parametrize("order", [3, 6, 9])
def test_every_order_returns_what_it_models(rng, order):
    x = np.where(np.arange(9) < order, LARGE, 0.0)
    fit = adjust(readings(scattered(rng), 1.0, x), 1e-5, 1.0, order)
    np.testing.assert_allclose(fit.values, x, atol=1e-13)
    assert fit.freedom == 26 - order
    assert fit.free.sum() == order
    assert not fit.cofactor[order:].any()


def test_known_angles_need_six_poses():
    fit = adjust(
        readings(ATTITUDES[:6], 1.0, LARGE), 1e-5, 1.0, 6, fixed=dict(zip(PARAMETERS[6:], LARGE[6:], strict=True))
    )
    assert fit.converged
    np.testing.assert_allclose(fit.values, LARGE, atol=1e-13)
    assert fit.freedom == 0
    assert np.isnan(fit.variance_of_unit_weight)


def test_references_may_differ_by_pose(rng):
    rho = rng.uniform(0.5, 2.0, 26)
    Y = triad_reading(rho[:, None] * ATTITUDES, LARGE[:3], LARGE[3:6], LARGE[6:])
    np.testing.assert_allclose(adjust(Y, 1e-5, rho).values, LARGE, atol=1e-13)


# ------------------------------------------------------------------------------------------------------ laws


def test_a_wrong_reference_changes_scale_only(rng):
    """With rho (1 + kappa): b and theta as they were, 1 + s divided by 1 + kappa."""
    Y = readings(scattered(rng), G, ACCEL) + 2.7e-4 * rng.standard_normal((26, 3))
    one, other = adjust(Y, 2.7e-4, G), adjust(Y, 2.7e-4, G * 1.001)
    np.testing.assert_allclose(other.values[:3], one.values[:3], atol=1e-11)
    np.testing.assert_allclose(other.values[6:], one.values[6:], atol=1e-12)
    np.testing.assert_allclose((1 + other.values[3:6]) * 1.001, 1 + one.values[3:6], atol=1e-12)


def test_units_do_not_matter(rng):
    Y = readings(scattered(rng), 1.0, LARGE) + 1e-3 * rng.standard_normal((26, 3))
    one, small = adjust(Y, 1e-3, 1.0), adjust(Y * 1e-6, 1e-9, 1e-6)
    unit = np.array([1e-6] * 3 + [1.0] * 6)
    np.testing.assert_allclose(small.values, one.values * unit, rtol=1e-10)
    np.testing.assert_allclose(small.cofactor, one.cofactor * np.outer(unit, unit), rtol=1e-8)
    np.testing.assert_allclose(small.normal, one.normal / np.outer(unit, unit), rtol=1e-8, atol=1e-6 * one.normal.max())
    assert small.condition == pytest.approx(one.condition, rel=1e-8)
    np.testing.assert_allclose(small.misclosure, one.misclosure * 1e-6, rtol=1e-6, atol=1e-18)
    np.testing.assert_allclose(small.misclosure_sigma, one.misclosure_sigma * 1e-6, rtol=1e-8)


def test_units_of_priors_and_held_biases_do_not_matter(rng):
    Y = readings(scattered(rng), 1.0, LARGE) + 1e-3 * rng.standard_normal((26, 3))
    b_x, b_y = PARAMETERS[:2]
    one = adjust(Y, 1e-3, 1.0, prior={b_x: (0.31, 5e-4)}, fixed={b_y: -0.41})
    small = adjust(Y * 1e-6, 1e-9, 1e-6, prior={b_x: (0.31e-6, 5e-10)}, fixed={b_y: -0.41e-6})
    unit = np.array([1e-6] * 3 + [1.0] * 6)
    np.testing.assert_allclose(small.values, one.values * unit, rtol=1e-9)
    np.testing.assert_allclose(small.sigma, one.sigma * unit, rtol=1e-8)
    assert one.values[1] == -0.41
    assert abs(one.values[0] - 0.31) < abs(adjust(Y, 1e-3, 1.0, fixed={b_y: -0.41}).values[0] - 0.31)


def test_misclosures_and_condition_by_their_definitions():
    """Readings without errors: a misclosure has the readings' sigma times the root of its redundancy."""
    fit = adjust(5.0 * ATTITUDES, 2e-3, 5.0)
    np.testing.assert_allclose(fit.misclosure_sigma, 2e-3 * np.sqrt(fit.redundancy), rtol=1e-9)
    d = np.sqrt(np.diag(fit.normal))
    values = np.linalg.eigvalsh(fit.normal / np.outer(d, d))
    assert fit.condition == pytest.approx(values[-1] / values[0], rel=1e-6)


def test_adjusted_readings_fulfil_the_conditions_and_corrections_are_the_smallest(rng):
    """A twin: the same minimum found over parameters and corrections by a general solver."""
    from scipy.optimize import least_squares

    sigma = np.array((1e-3, 2e-3, 3e-3))
    Y = readings(scattered(rng), 1.0, LARGE) + sigma * rng.standard_normal((26, 3))
    fit = adjust(Y, sigma, 1.0)
    f, _, _ = condition(Y + fit.corrections, 1.0, fit.values)
    np.testing.assert_allclose(f, 0.0, atol=1e-10)

    def misfit(z):  # corrected readings are those of directions, so the condition is built in
        e = readings(z[9:].reshape(-1, 3) / np.linalg.norm(z[9:].reshape(-1, 3), axis=1)[:, None], 1.0, z[:9]) - Y
        return (e / sigma).ravel()

    twin = least_squares(misfit, np.concatenate((LARGE, ATTITUDES.ravel())), xtol=1e-14, ftol=1e-14, gtol=1e-14)
    # the condition of the general solver's minimum allows 1e-4 sigma
    assert np.abs((fit.values - twin.x[:9]) / fit.sigma).max() < 1e-3
    assert fit.chi_square == pytest.approx(2 * twin.cost, rel=1e-7)


def test_weights_count(rng):
    """A pose said to be bad by a thousand times its noise is as good as left out."""
    u = scattered(rng)
    Y = readings(u, 1.0, LARGE) + 1e-3 * rng.standard_normal((26, 3))
    Y[7] += 0.2
    sigma = np.full((26, 3), 1e-3)
    sigma[7] = 1e3
    keep = np.arange(26) != 7
    np.testing.assert_allclose(adjust(Y, sigma, 1.0).values, adjust(Y[keep], 1e-3, 1.0).values, atol=1e-6)
    assert np.abs(adjust(Y, 1e-3, 1.0).values - LARGE).max() > 0.01


def test_redundancy_adds_up_to_freedom(rng):
    fit = adjust(readings(scattered(rng), 1.0, LARGE), 1e-3, 1.0)
    assert fit.redundancy.sum() == pytest.approx(fit.freedom)


def test_a_prior_that_says_nothing_changes_nothing_and_one_that_knows_all_is_returned(rng):
    Y = readings(scattered(rng), 1.0, LARGE) + 1e-3 * rng.standard_normal((26, 3))
    plain = adjust(Y, 1e-3, 1.0)
    weak = adjust(Y, 1e-3, 1.0, prior=dict.fromkeys(PARAMETERS, (0.0, 1000000.0)))
    np.testing.assert_allclose(weak.values, plain.values, atol=1e-10)
    strong = adjust(Y, 1e-3, 1.0, prior={"theta_zy": (0.1, 1e-9)})
    assert strong.values[8] == pytest.approx(0.1, abs=1e-8)
    assert strong.freedom == plain.freedom + 1
    held = adjust(Y, 1e-3, 1.0, fixed={"theta_zy": 0.1})
    np.testing.assert_allclose(strong.values, held.values, atol=1e-7)


def test_a_prior_is_one_more_observation(rng):
    """Cofactor with prior is the inverse of the sum of information."""
    Y = readings(scattered(rng), 1.0, LARGE) + 1e-4 * rng.standard_normal((26, 3))
    plain = adjust(Y, 1e-4, 1.0)
    sigma = 2.0 * plain.sigma
    both = adjust(Y, 1e-4, 1.0, prior={n: (v, s) for n, v, s in zip(PARAMETERS, plain.values, sigma, strict=True)})
    np.testing.assert_allclose(both.values, plain.values, atol=1e-9)
    expected = np.linalg.inv(np.linalg.inv(plain.cofactor) + np.diag(sigma**-2))
    np.testing.assert_allclose(both.cofactor, expected, rtol=1e-6, atol=1e-6 * expected.max())


# ------------------------------------------------------------------------------------------------ statistics


@pytest.mark.parametrize("runs", [100, pytest.param(300, marks=pytest.mark.campaign)])
@pytest.mark.thinned(3)
@pytest.mark.parametrize(
    ("rho", "x", "sigma"), [(G, ACCEL, 2.733e-4), (1e4 * W, GYRO, 2.71e-6)], ids=["accelerometer", "fast table"]
)
def test_predicted_covariance_is_the_scatter(rng, rho, x, sigma, runs):
    """Statistical: normalised errors squared are chi-square with 9 degrees of freedom, weighted residuals with 17."""
    nees, weight = [], []
    for _ in range(runs):
        Y = readings(scattered(rng), rho, x) + sigma * rng.standard_normal((26, 3))
        fit = adjust(Y, sigma, rho)
        error = fit.values - x
        nees.append(error @ np.linalg.solve(fit.cofactor, error))
        weight.append(fit.chi_square)
    low, high = chi2.ppf((0.001, 0.999), 9 * runs)
    assert low < np.sum(nees) < high
    assert kstest(nees, chi2(9).cdf).pvalue > 0.001
    assert kstest(weight, chi2(17).cdf).pvalue > 0.001


@pytest.mark.campaign
def test_misclosures_have_the_scatter_they_are_said_to_have(rng):
    w = []
    u = scattered(rng)
    for _ in range(200):
        fit = adjust(readings(u, 1.0, LARGE) + 1e-3 * rng.standard_normal((26, 3)), 1e-3, 1.0)
        w.append(fit.misclosure / fit.misclosure_sigma)
    # statistical: 200 draws of each of 26, standard deviation known to 5 %
    np.testing.assert_allclose(np.std(w, axis=0), 1.0, atol=0.2)
    assert np.std(w) == pytest.approx(1.0, abs=0.03)


def test_pope(rng):
    """Leaving his term out matters where noise is a large part of the reference, and nowhere else."""
    u = scattered(rng)
    noise = rng.standard_normal((26, 3))
    for rho, sigma, low, high in ((1e4 * W, 2.71e-6, 0.0, 1e-3), (W, 2.71e-6, 0.02, 2.0)):
        Y = readings(u, rho, GYRO) + sigma * noise
        right, naive = adjust(Y, sigma, rho), adjust(Y, sigma, rho, pope=False)
        difference = np.abs((right.values - naive.values) / right.sigma).max()
        assert low <= difference < high
        left = [np.abs(condition(Y + fit.corrections, rho, fit.values)[0]).max() / rho**2 for fit in (right, naive)]
        assert left[0] < 1e-10
        assert left[1] > 10 * left[0]


# ------------------------------------------------------------------------------------------ what is determined

DESIGNS = {  # poses, rank (Hayal digest 3.8), parameters lost
    "faces": (ATTITUDES[:6], 6, {"theta_yz", "theta_zx", "theta_zy"}),
    "corners": (ATTITUDES[18:], 7, {"s_x", "s_y", "s_z"}),
    "edges": (ATTITUDES[6:18], 9, set()),
    "faces and corners": (np.vstack((ATTITUDES[:6], ATTITUDES[18:])), 9, set()),
    "faces and xy, xz edges": (np.vstack((ATTITUDES[:8], ATTITUDES[10:12])), 8, {"theta_zx"}),
    "yz edges and corners": (ATTITUDES[16:], 8, {"s_y", "s_z"}),
}


@pytest.mark.parametrize("noise", [0.0, 1e-5], ids=["perfect", "noisy"])
@pytest.mark.parametrize(("poses", "rank", "lost"), DESIGNS.values(), ids=DESIGNS)
def test_what_poses_determine(rng, poses, rank, lost, noise):
    Y = poses + noise * rng.standard_normal(poses.shape)
    fit = adjust(Y, 1e-5, 1.0)
    assert {n for n, bad in zip(PARAMETERS, fit.undetermined, strict=True) if bad} == lost
    assert fit.null_space.shape[1] == 9 - rank
    assert fit.freedom == len(poses) - rank
    assert np.isinf(fit.sigma[fit.undetermined]).all()
    assert not fit.cofactor[np.ix_(fit.undetermined, ~fit.undetermined)].any()
    assert np.isfinite(fit.sigma[~fit.undetermined]).all()
    assert np.isinf(fit.condition) == (rank < 9)
    assert fit.converged


@pytest.mark.parametrize(
    ("poses", "b", "s", "theta"),
    [
        (ATTITUDES[6:18], 0.500, 0.866, 1.000),
        (ATTITUDES[:18], 0.408, 0.527, 1.000),
        (ATTITUDES, 0.340, 0.511, 0.728),
        (np.vstack((ATTITUDES[:6], ATTITUDES[18:])), 0.463, 0.636, 1.061),
        (ATTITUDES[6:], 0.387, 0.847, 0.728),
    ],
    ids=["12 E", "18 F+E", "26", "14 F+C", "20 E+C"],
)
def test_uncertainty_of_the_usual_designs(poses, b, s, theta):
    """The digest's table 3.8, printed to three digits."""
    np.testing.assert_allclose(adjust(poses, 1e-6, 1.0).sigma * 1e6, [b] * 3 + [s] * 3 + [theta] * 3, atol=6e-4)


def test_a_weak_design_is_not_an_undetermined_one(rng):
    """Two degrees of scatter determine theta_zx forty times worse than sigma/g, which is still something."""
    poses = scattered(rng, np.vstack((ATTITUDES[:8], ATTITUDES[10:12])))
    fit = adjust(poses + 1e-5 * rng.standard_normal(poses.shape), 1e-5, 1.0)
    assert not fit.undetermined.any()
    assert fit.sigma[7] > 10 * fit.sigma[6]


# ------------------------------------------------------------------------------------------------ convergence


@pytest.mark.thinned(3)
@pytest.mark.parametrize("size", [0.5, 1.13, 3.0, 1000.0])
@pytest.mark.parametrize("start", ["continuation", "ellipsoid"])
def test_converges_for_a_bias_of_any_size(rng, size, start):
    """The plain iteration from zeros fails from one Earth rate on (HG1900: 17 deg/h, 1.13 Earth rates)."""
    x = GYRO.copy()
    x[:3] = size * W
    done = 0
    for _ in range(20):
        Y = readings(scattered(rng), W, x) + 2.71e-6 * rng.standard_normal((26, 3))
        fit = adjust(Y, 2.71e-6, W, start=start)
        done += fit.converged and bool((np.abs((fit.values - x) / fit.sigma) < 6).all())
    assert done == 20


def test_the_plain_iteration_fails_for_a_large_bias(rng):
    x = GYRO.copy()
    x[:3] = 2.0 * W
    Y = readings(scattered(rng), W, x)
    fit = adjust(Y, 2.71e-6, W, start="zeros", step_limit=None, largest_sigma=np.inf)
    assert not (fit.converged and np.allclose(fit.values, x, atol=1e-3))


def test_iterations_are_few(rng):
    for rho, x, sigma, most in ((G, ACCEL, 2.7e-4, 6), (1e4 * W, GYRO, 2.7e-6, 6), (W, GYRO, 2.7e-6, 30)):
        fit = adjust(readings(scattered(rng), rho, x) + sigma * rng.standard_normal((26, 3)), sigma, rho)
        assert fit.converged
        assert fit.iterations <= most
        assert len(fit.history) >= fit.iterations
        np.testing.assert_array_equal(fit.history[-1], fit.values)


def test_first_guesses_are_exact_for_what_they_model(rng):
    x = np.where(np.arange(9) < 3, 50 * LARGE, 0.0)
    np.testing.assert_allclose(sphere_start(readings(ATTITUDES, 1.0, x), 1.0), x[:3], atol=1e-12)
    rho = np.linspace(0.5, 1.5, 26)
    Y = rho[:, None] * ATTITUDES + x[:3]
    np.testing.assert_allclose(sphere_start(Y, rho), x[:3], atol=1e-12)
    np.testing.assert_allclose(ellipsoid_start(readings(ATTITUDES, 1.0, LARGE), 1.0), LARGE, atol=1e-12)
    on_the_surface = LARGE.copy()
    on_the_surface[:3] = (1.05, 0, 0)  # the origin is nearly a point of the ellipsoid
    np.testing.assert_allclose(
        ellipsoid_start(readings(ATTITUDES, 1.0, on_the_surface), 1.0), on_the_surface, atol=1e-11
    )


# ----------------------------------------------------------------------------------------------------- errors


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ({"order": 7}, "3, 6 or 9"),
        ({"start": "anywhere"}, "continuation"),
        ({"fixed": {"theta_xy": 0.0}}, "theta_yz"),
        ({"fixed": {"s_x": 0.0}, "prior": {"s_x": (0.0, 1.0)}}, "both"),
        ({"prior": {"s_x": (0.0, 0.0)}}, "positive sigma"),
        ({"sigma": -1.0}, "positive"),
        ({"rho": np.ones(25)}, "shape"),
        ({"order": 3, "fixed": {"b_x": 0, "b_y": 0, "b_z": 0}}, "left to estimate"),
        ({"Y": np.ones((0, 3))}, "one attitude"),
    ],
)
def test_input_that_makes_no_sense(arguments, words):
    with pytest.raises(InputError, match=words):
        adjust(**({"Y": ATTITUDES, "sigma": 1e-3, "rho": 1.0} | arguments))


def test_ellipsoid_start_says_when_it_cannot():
    with pytest.raises(InputError, match="nine"):
        ellipsoid_start(ATTITUDES[:8], 1.0)
    with pytest.raises(InputError, match="nine"):
        ellipsoid_start(ATTITUDES, np.linspace(1.0, 2.0, 26))


def test_a_sigma_that_is_not_positive_is_named():
    with pytest.raises(InputError, match=r"sigma: expected positive numbers .*, got shape \(3,\), smallest -2"):
        adjust(ATTITUDES, [1.0, -2.0, 1.0], 1.0)


def test_a_prior_that_is_wrong_shows_in_the_unit_weight(rng):
    """Data that know better: three sigmas of prior misfit are nine of chi-square, one more degree of freedom."""
    Y = readings(scattered(rng), 1.0, LARGE)
    fit = adjust(Y, 1e-6, 1.0, prior={"b_x": (LARGE[0] + 3e-2, 1e-2), "s_y": (LARGE[4], 1e-2)})
    assert fit.freedom == 26 + 2 - 9
    assert fit.chi_square == pytest.approx(9.0, rel=1e-3)  # the prior pulls by 1e-8 of its sigma
    assert fit.variance_of_unit_weight == pytest.approx(9.0 / 19.0, rel=1e-3)


@pytest.mark.parametrize(("sigma", "lost"), [(0.29, False), (0.31, True)])
def test_biases_beyond_three_tenths_of_rho_are_not_determined(sigma, lost):
    """The linearised condition does not hold over more: opposite poses on three axes give each bias by two readings."""
    Y = readings(np.concatenate((np.eye(3), -np.eye(3))), 1.0, np.zeros(9))
    fit = adjust(Y, sigma * np.sqrt(2.0), 1.0, 3)
    assert fit.undetermined[:3].all() == lost
    assert fit.undetermined[:3].any() == lost


def test_no_step_of_scale_or_angle_exceeds_the_limit(rng):
    """From zeros to an error beyond it: at least one step is as long as the limit, none is longer."""
    x = np.zeros(9)
    x[3:] = 0.45, -0.3, 0.4, 0.3, -0.2, 0.2
    fit = adjust(readings(scattered(rng), 1.0, x), 1e-4, 1.0, start="zeros")
    steps = np.abs(np.diff(np.vstack((np.zeros(9), fit.history)), axis=0))[:, 3:].max(axis=1)
    assert fit.converged
    assert steps.max() == pytest.approx(0.3, abs=1e-12)


# ---------------------------------------------------------------------------------------------- closed forms
# One axis turned up and down, references of several sizes: the condition is that of a straight line.

AXIS = np.array((1.0, -1.0, 1.0, -1.0, 1.0, -1.0))
SIZES = 5.0 * np.array((1.0, 1.0, 0.8, 0.6, 1.4, 1.2))
SIGMA = np.array((1.0, 2.0, 3.0, 1.5, 0.5, 2.5)) * 1e-3


def on_one_axis(values, free, sigma=SIGMA, **more):
    """Adjustment of readings along x of which only these parameters are estimated."""
    Y = np.zeros((len(values), 3))
    Y[:, 0] = values
    fixed = {name: 0.0 for name in PARAMETERS if name not in free}
    return adjust(Y, np.repeat(sigma[:, None], 3, axis=1), SIZES, fixed=fixed, **more)


def test_a_bias_is_the_weighted_mean(rng):
    """Of what is left without the reference; its misclosures have the scatter of residuals from a mean; rounding."""
    left = 0.02 + SIGMA * rng.standard_normal(6)
    fit, w = on_one_axis(SIZES * AXIS + left, ["b_x"]), SIGMA**-2
    mean = w @ left / w.sum()
    assert fit.converged
    assert fit.values[0] == pytest.approx(mean, rel=1e-10)
    assert fit.cofactor[0, 0] == pytest.approx(1.0 / w.sum(), rel=1e-9)
    assert fit.normal[0, 0] == pytest.approx(w.sum(), rel=1e-9)
    assert (fit.freedom, fit.free.sum()) == (5, 1)
    assert fit.variance_of_unit_weight == pytest.approx(w @ (left - mean) ** 2 / 5, rel=1e-8)
    np.testing.assert_allclose(fit.corrections[:, 0], mean - left, atol=1e-11)
    np.testing.assert_allclose(fit.misclosure, AXIS * (left - mean), atol=1e-11)
    np.testing.assert_allclose(fit.redundancy, 1.0 - w / w.sum(), rtol=1e-9)
    # linearised at the readings, not at what they should be
    np.testing.assert_allclose(fit.misclosure_sigma, SIGMA * np.sqrt(1.0 - w / w.sum()), rtol=2e-3)


def test_a_prior_on_a_bias_is_one_more_reading(rng):
    left = 0.02 + SIGMA * rng.standard_normal(6)
    fit = on_one_axis(SIZES * AXIS + left, ["b_x"], prior={"b_x": (0.021, 4e-4)})
    w, values = np.append(SIGMA, 4e-4) ** -2, np.append(left, 0.021)
    mean = w @ values / w.sum()
    assert fit.values[0] == pytest.approx(mean, rel=1e-10)
    assert fit.cofactor[0, 0] == pytest.approx(1.0 / w.sum(), rel=1e-9)
    assert fit.freedom == 6
    assert fit.variance_of_unit_weight == pytest.approx(w @ (values - mean) ** 2 / 6, rel=1e-8)
    np.testing.assert_allclose(fit.redundancy, 1.0 - w[:6] / w.sum(), rtol=1e-9)


def test_bias_and_scale_factor_are_a_straight_line(rng):
    """Reading over reference, weighted least squares: slope less one, and the intercept."""
    x, w = SIZES * AXIS, SIGMA**-2
    y = 0.02 + 1.03 * x + SIGMA * rng.standard_normal(6)
    fit = on_one_axis(y, ["b_x", "s_x"])
    A = np.column_stack((np.ones(6), x))
    N = A.T @ (A * w[:, None])
    line = np.linalg.solve(N, A.T @ (w * y))
    np.testing.assert_allclose(fit.values[[0, 3]], line - [0.0, 1.0], rtol=1e-8)
    np.testing.assert_allclose(fit.cofactor[np.ix_([0, 3], [0, 3])], np.linalg.inv(N), rtol=1e-7)
    assert fit.variance_of_unit_weight == pytest.approx(w @ (y - A @ line) ** 2 / 4, rel=1e-7)
    d = np.sqrt(np.diag(N))
    low, high = np.linalg.eigvalsh(N / np.outer(d, d))
    assert fit.condition == pytest.approx(high / low, rel=1e-6)


# ------------------------------------------------------------------------------------------------ invariance


def test_order_of_poses_and_names_of_axes_do_not_matter(rng):
    """Poses in another order; x, y, z called y, z, x, which biases and scale factors follow; rounding."""
    x = np.where(np.arange(9) < 6, LARGE, 0.0)
    Y = readings(scattered(rng), 1.0, x) + 1e-3 * rng.standard_normal((26, 3))
    sigma = rng.uniform(1e-3, 3e-3, (26, 3))
    one, order = adjust(Y, sigma, 1.0, 6), rng.permutation(26)
    shuffled = adjust(Y[order], sigma[order], 1.0, 6)
    np.testing.assert_allclose(shuffled.values, one.values, atol=1e-11)
    np.testing.assert_allclose(shuffled.corrections, one.corrections[order], atol=1e-11)
    np.testing.assert_allclose(shuffled.redundancy, one.redundancy[order], atol=1e-9)
    renamed = adjust(Y[:, [1, 2, 0]], sigma[:, [1, 2, 0]], 1.0, 6)
    np.testing.assert_allclose(renamed.values[:6], one.values[[1, 2, 0, 4, 5, 3]], atol=1e-11)
    np.testing.assert_allclose(renamed.sigma[:6], one.sigma[[1, 2, 0, 4, 5, 3]], rtol=1e-8)


def test_all_sigmas_by_a_factor_are_a_factor(rng):
    """Estimates stay, to what the iteration leaves; cofactors by its square, chi-square by its inverse."""
    Y = readings(scattered(rng), 1.0, LARGE) + 1e-3 * rng.standard_normal((26, 3))
    one, three = adjust(Y, 1e-3, 1.0), adjust(Y, 3e-3, 1.0)
    np.testing.assert_allclose(three.values, one.values, atol=1e-10)
    np.testing.assert_allclose(three.cofactor, 9.0 * one.cofactor, rtol=1e-6, atol=1e-12)
    assert three.chi_square == pytest.approx(one.chi_square / 9.0, rel=1e-6)


# -------------------------------------------------------------------------------------- what is too weak to tell


def opposite(factor):
    """Poses up and down on three axes, those of z read so many times worse."""
    sigma = np.full((6, 3), 1e-9)
    sigma[[2, 5]] *= factor
    return readings(np.concatenate((np.eye(3), -np.eye(3))), 1.0, np.zeros(9)), sigma


@pytest.mark.parametrize(
    ("factor", "keywords", "lost"),
    [
        (999.5, {}, False),
        (1000.5, {}, True),  # a thousand times worse than the best
        (1100.0, {"prior": {"b_x": (0.0, 1.0)}}, False),  # what is known of one may be the best
        (1100.0, {"largest_sigma": np.inf}, False),
        (1e9, {"largest_sigma": np.inf}, False),
        (1e11, {"largest_sigma": np.inf}, True),  # rounding of the scaled design
    ],
)
def test_a_bias_that_is_far_worse_than_the_best_is_not_determined(factor, keywords, lost):
    Y, sigma = opposite(factor)
    fit = adjust(Y, sigma, 1.0, 3, **keywords)
    assert list(fit.undetermined[:3]) == [False, False, lost]
    assert fit.freedom == 6 - 3 + lost + len(keywords.get("prior", ()))


def test_the_weight_of_a_reading_near_the_bias_is_bounded():
    """Variance of a misclosure is (2 u sigma)^2 from a hundredth of the reference on, and there what it is at it."""
    sizes = np.array((1.0, 0.02, 0.0101, 0.0099, 1e-3, 0.0))
    B, sigma = np.outer(2.0 * sizes, (0.6, 0.0, 0.8)), np.array((2e-3, 1e-4, 2e-3))
    expected = (2.0 * np.maximum(sizes, 0.01) * 2e-3) ** 2
    expected[3:] = (2.0 * 0.01 * 1e-4) ** 2  # of the best axis
    weights = _weights(B, np.tile(sigma**2, (6, 1)))
    np.testing.assert_allclose(weights[[0, 1, 5]], expected[[0, 1, 5]], rtol=1e-12)
    np.testing.assert_allclose(
        _weights(B, np.full((6, 3), 4e-6)), (2.0 * np.maximum(sizes, 0.01) * 2e-3) ** 2, rtol=1e-12
    )


# ------------------------------------------------------------------------------------------------ how it ends


def test_a_stage_that_frees_nothing_new_is_left_out(rng):
    """With all but biases held, nine parameters are three: the same steps."""
    Y = readings(scattered(rng), 1.0, LARGE) + 1e-3 * rng.standard_normal((26, 3))
    held = dict(zip(PARAMETERS[3:], LARGE[3:], strict=True))
    nine, three = (adjust(Y, 1e-3, 1.0, order, fixed=held) for order in (9, 3))
    np.testing.assert_array_equal(nine.history, three.history)
    assert nine.iterations == len(nine.history)


def test_sigmas_of_three_axes_are_those_of_every_reading(rng):
    Y, sigma = (
        readings(scattered(rng), 1.0, LARGE) + 1e-3 * rng.standard_normal((26, 3)),
        np.array([1.0, 2.0, 3.0]) * 1e-3,
    )
    axes, all_readings = (adjust(Y, s, 1.0) for s in (sigma, np.tile(sigma, (26, 1))))
    np.testing.assert_array_equal(axes.values, all_readings.values)


def test_iterations_are_counted_and_end_where_told(rng):
    Y = readings(scattered(rng), 1.0, LARGE) + 1e-3 * rng.standard_normal((26, 3))
    fit = adjust(Y, 1e-3, 1.0, start="zeros")
    assert fit.converged
    assert len(fit.history) == fit.iterations
    for most in (1, 2):
        cut = adjust(Y, 1e-3, 1.0, start="zeros", max_iterations=most)
        assert (cut.converged, cut.iterations, len(cut.history)) == (False, most, most)
        np.testing.assert_allclose(cut.history, fit.history[:most], atol=1e-14)
    done = adjust(Y, 1e-3, 1.0, start="zeros", max_iterations=fit.iterations)
    assert done.converged
    unit = 1.0 / np.sqrt(np.diag(fit.normal))  # uncorrelated sigma
    assert (np.abs(fit.history[-1] - fit.history[-2]) / unit).max() < 1e-8
    coarse, fine = (adjust(Y, 1e-3, 1.0, start="zeros", tolerance=tolerance) for tolerance in (1e-5, 1e-11))
    assert coarse.iterations <= fit.iterations < fine.iterations


@pytest.mark.parametrize("sigma", [1e-12, 1e-18])
def test_it_ends_however_small_sigma_is(rng, sigma):
    """Nothing but rounding is left long before a step is a part of so small an uncertainty."""
    fit = adjust(readings(scattered(rng), 1.0, LARGE), sigma, 1.0)
    assert fit.converged
    np.testing.assert_allclose(fit.values, LARGE, atol=1e-13)


@pytest.mark.parametrize("rho", [1.0, G])
def test_the_truth_as_a_start_is_the_end(rng, rho):
    x = LARGE * ([rho] * 3 + [1.0] * 6)
    Y = readings(scattered(rng), rho, x)
    fit = adjust(Y, 1e-5, rho, start=x)
    assert fit.iterations <= 2
    np.testing.assert_allclose(fit.history[0], x, atol=1e-12)


def test_a_triad_that_became_impossible_is_not_returned(rng):
    """A step to a scale factor below -1 ends it: what is returned is where it began."""
    x = GYRO.copy()
    x[:3] = 2.0 * W
    for _ in range(20):
        Y = readings(scattered(rng), W, x)
        fit = adjust(Y, 2.71e-6, W, start="zeros", step_limit=None, largest_sigma=np.inf)
        if not fit.converged and len(fit.history) < 100:
            np.testing.assert_array_equal(fit.values, 0.0)
            assert not fit.corrections.any()
            assert fit.iterations == len(fit.history)
            return
    raise AssertionError("no start of twenty led to an impossible triad")
