"""Free-pose calibration of simulated logs: perfect data, covariance, derivatives, any units, what is refused."""

from dataclasses import replace

import numpy as np
import pytest

from schuler.calibration.freepose import solution
from schuler.calibration.freepose.accel import ellipsoid_start, magnitude_residuals, response, sphere_start
from schuler.calibration.freepose.bias import bias_difference, bias_in_turns
from schuler.calibration.freepose.calibrate import calibrate_freepose
from schuler.calibration.freepose.gyro import fit_gyroscopes
from schuler.calibration.freepose.rests import pose_means
from schuler.calibration.freepose.simulation import hand_log, spread_turns
from schuler.calibration.freepose.turns import Turns, vertical_residuals
from schuler.calibration.result.halves import halves_of, split
from schuler.calibration.result.parameters import BIAS_G, in_gauge, vector
from schuler.calibration.result.rest_scatter import RestScatter
from schuler.recording.series import ImuSeries
from schuler.sensors.errors import ImuErrors
from schuler.sensors.noise import GaussMarkov, NoiseModel, White
from schuler.units import G0

N_G, N_A = 3e-4, 2e-3  # a consumer IMU [rad/s/sqrt(Hz)], [m/s^2/sqrt(Hz)]


def some_errors(seed=0, size=0.02, G=0.0, **noise) -> ImuErrors:
    rng = np.random.default_rng(seed)
    return in_gauge(
        ImuErrors(
            b_g=size * rng.standard_normal(3), b_a=10 * size * rng.standard_normal(3),
            M_g=size * rng.standard_normal((3, 3)), M_a=size * rng.standard_normal((3, 3)),
            G_g=G * rng.standard_normal((3, 3)), **noise,
        ), "upper",
    )  # fmt: skip


def noisy(errors: ImuErrors) -> ImuErrors:
    return replace(errors, gyro_noise=NoiseModel((White(N_G),)), accel_noise=NoiseModel((White(N_A),)))


def log_of(errors, seed=1, n=24, **options) -> ImuSeries:
    rng = np.random.default_rng(seed)
    return hand_log(errors, rng, rotvecs=spread_turns(n, rng), **options)


@pytest.fixture(scope="module")
def perfect():
    errors = some_errors()
    return errors, log_of(errors)


def difference(result, errors):
    return result.values - vector(errors, result.names)


def test_perfect_data_return_what_was_inserted(perfect):
    """Rounding: 1e-11 of numbers of order 0.1, from sums over thousands of samples."""
    errors, imu = perfect
    result = calibrate_freepose(imu)
    assert result.status == "ok", result.verdicts
    np.testing.assert_allclose(difference(result, errors), 0.0, atol=1e-11)
    assert result.gauge == "upper"
    assert result.fixed == {"M_a_yx": 0.0, "M_a_zx": 0.0, "M_a_zy": 0.0}
    np.testing.assert_allclose(result.residuals["accel"].value, 0.0, atol=1e-11)
    np.testing.assert_allclose(result.residuals["gyro"].value, 0.0, atol=1e-11)


@pytest.mark.parametrize("gauge", ["lower", "symmetric"])
def test_perfect_data_in_other_gauges(perfect, gauge):
    errors, imu = perfect
    result = calibrate_freepose(imu).in_gauge(gauge)
    np.testing.assert_allclose(difference(result, in_gauge(errors, gauge)), 0.0, atol=1e-11)  # rounding


@pytest.mark.parametrize("options", [{"gyro_bias": "estimate"}, {"robust": False}])
def test_perfect_data_with_options(perfect, options):
    errors, imu = perfect
    result = calibrate_freepose(imu, **options)
    np.testing.assert_allclose(difference(result, errors), 0.0, atol=1e-11)  # rounding


def test_perfect_data_with_g_sensitivity():
    errors = some_errors(G=2e-4)
    result = calibrate_freepose(log_of(errors), g_sensitivity=True)
    assert len(result.names) == 30
    np.testing.assert_allclose(difference(result, errors), 0.0, atol=1e-11)  # rounding
    assert abs(result["G_g_xy"][0]) > 1e-5


def test_without_g_sensitivity_the_same_log_does_not_fit():
    """The option matters: left out, turns miss by more than rounding."""
    result = calibrate_freepose(log_of(some_errors(G=2e-4)), g_sensitivity=False)
    assert result.residuals["gyro"].rms > 1e-4


@pytest.mark.thinned(2)
@pytest.mark.parametrize(
    ("a", "g", "offset"), [(1.0, 1.0, 0.0), (415.0, 4778.0, 32768.0), (0.1, 57.3, 0.0), (2e-3, 0.05, 5.0)]
)
def test_any_units(perfect, a, g, offset):
    """Counts with an offset, g and deg/s, tiny numbers: the calibrated log is the same. Rounding, of counts here."""
    _, imu = perfect
    rates = imu.rates()
    raw = ImuSeries(rates.t, rates.gyro * g + offset, rates.accel * a + offset)
    # a trapezoid through mean rates is not what they were made of: compare with the same log in SI
    reference = calibrate_freepose(ImuSeries(rates.t, rates.gyro, rates.accel))
    result = calibrate_freepose(raw)
    assert result.status == "ok", result.verdicts
    assert (result.nominal == (1.0, 1.0)) == (a == g == 1.0)
    f, f0 = result.apply(raw), reference.apply(rates)
    np.testing.assert_allclose(f.accel, f0.accel, atol=1e-9)
    np.testing.assert_allclose(f.gyro, f0.gyro, atol=1e-8)


def test_a_factor_found_and_a_factor_stated_are_the_same():
    """Values and covariance do not depend on who named the factor: to a hundredth of sigma, where iterations end."""
    rates = log_of(noisy(some_errors())).rates()
    raw = ImuSeries(rates.t, rates.gyro * 4778.0 + 32768.0, rates.accel * 415.0 + 32768.0)
    calibration = calibrate_freepose(raw, g_sensitivity=True)
    stated = calibrate_freepose(raw, g_sensitivity=True, nominal=calibration.nominal)
    assert calibration.nominal[1] != 1.0
    assert (np.abs(calibration.values - stated.values) < 0.01 * calibration.sigma).all()
    np.testing.assert_allclose(calibration.sigma, stated.sigma, rtol=1e-3)
    np.testing.assert_allclose(calibration.correlation, stated.correlation, atol=1e-3)


@pytest.mark.parametrize("nominal", [(1.0, 1.0), (1.3, 0.4), (0.5, 3.0)])
def test_any_start_converges(perfect, nominal):
    """Stated factors that are wrong by far end up in M. Rounding."""
    errors, imu = perfect
    result = calibrate_freepose(imu, nominal=nominal)
    np.testing.assert_allclose(np.eye(3) + result.errors.M_a, nominal[0] * (np.eye(3) + errors.M_a), atol=1e-10)
    np.testing.assert_allclose(np.eye(3) + result.errors.M_g, nominal[1] * (np.eye(3) + errors.M_g), atol=1e-10)


def test_apply_removes_the_errors(perfect):
    errors, imu = perfect
    result = calibrate_freepose(imu)
    clean = result.apply(imu)
    np.testing.assert_allclose(
        clean.gyro, errors.compensate_increments(imu.gyro, imu.accel, imu.interval)[0], atol=1e-12
    )
    rest = clean.accel[:1000] / imu.interval
    np.testing.assert_allclose(np.linalg.norm(rest, axis=1), G0, atol=1e-9)  # rounding


def test_derivatives_of_the_magnitude():
    """Against central differences: their error is h^2, 1e-9."""
    rng = np.random.default_rng(3)
    p = 0.05 * rng.standard_normal(9)
    y = 10.0 * rng.standard_normal((7, 3))
    _, J, w = magnitude_residuals(p, y, G0)
    h = 1e-5
    twin = np.stack([(magnitude_residuals(p + h * e, y, G0)[0] - magnitude_residuals(p - h * e, y, G0)[0]) / (2 * h)
                     for e in np.eye(9)], axis=1)  # fmt: skip
    np.testing.assert_allclose(J, twin, rtol=0.0, atol=1e-7)
    by_y = np.stack([(magnitude_residuals(p, y + h * e, G0)[0] - magnitude_residuals(p, y - h * e, G0)[0]) / (2 * h)
                     for e in np.eye(3)], axis=1)  # fmt: skip
    np.testing.assert_allclose(w, by_y, atol=1e-8)


@pytest.mark.parametrize("before", [0.0, 0.5])
@pytest.mark.parametrize("speed", [0.3, 40.0])
def test_derivatives_of_turns(before, speed):
    """The kernel's one-pass derivatives by M_g, b_g and G_g against central differences of its rotations.

    At 40 rad/s the rotation vector of a step is 0.4 rad and both branches of the coefficients are used.
    """
    rng = np.random.default_rng(4)
    n = 60
    t = np.cumsum(0.01 + 0.001 * rng.standard_normal(n))
    gyro, accel = speed * rng.standard_normal((n, 3)), 10.0 * rng.standard_normal((n, 3))
    up = rng.standard_normal((3, 3))
    up /= np.linalg.norm(up, axis=1, keepdims=True)
    turns = Turns(
        t, gyro, accel, before, np.array([[0, 30], [33, 59]]), np.array([[0, 1], [1, 2]]), up, up,
        np.eye(3) + 0.01 * rng.standard_normal((3, 3)), 0.1 * rng.standard_normal(3),
    )  # fmt: skip
    x = 0.05 * rng.standard_normal(21)

    def residual(x):
        return vertical_residuals(turns, 1.02, x[:9].reshape(3, 3), x[9:12], x[12:].reshape(3, 3))

    _, J, C, seconds = residual(x)
    assert J.shape == (2, 3, 21)
    np.testing.assert_allclose(C @ C.swapaxes(1, 2), np.tile(np.eye(3), (2, 1, 1)), atol=1e-13)  # rounding
    np.testing.assert_allclose(seconds, [t[30] - t[0], t[59] - t[33]])
    h = 1e-6
    twin = np.stack([(residual(x + h * e)[0] - residual(x - h * e)[0]) / (2 * h) for e in np.eye(21)], axis=2)
    np.testing.assert_allclose(J, twin, rtol=1e-6, atol=2e-7)  # rounding of the difference: 1e-16/1e-6 times its size
    without = vertical_residuals(turns, 1.02, x[:9].reshape(3, 3), x[9:12], None)
    with_zero = vertical_residuals(turns, 1.02, x[:9].reshape(3, 3), x[9:12], np.zeros((3, 3)))
    np.testing.assert_allclose(without[0], with_zero[0], atol=1e-14)
    np.testing.assert_allclose(without[1], with_zero[1][:, :, :12], atol=1e-12)


def test_rotation_is_the_exponential():
    """Constant rate, 1 s: closed form."""
    from schuler.rotation import dcm_from_rotvec

    t = np.linspace(0.0, 1.0, 101)
    omega = np.array([0.4, -1.1, 0.8])
    gyro = np.tile(omega, (101, 1))
    up = np.array([[0.0, 0.0, 1.0], dcm_from_rotvec(omega).T @ [0.0, 0.0, 1.0]])
    turns = Turns(t, gyro, gyro, 0.5, np.array([[0, 100]]), np.array([[0, 1]]), up, up, np.eye(3), np.zeros(3))
    for stride in (1, 7):
        r, _, C, _ = vertical_residuals(turns, 1.0, np.zeros((3, 3)), np.zeros(3), None, stride)
        np.testing.assert_allclose(C[0], dcm_from_rotvec(omega), atol=1e-14)
        np.testing.assert_allclose(r, 0.0, atol=1e-14)


def test_ellipsoid_start_is_exact_without_noise():
    rng = np.random.default_rng(5)
    p = np.concatenate((rng.standard_normal(3), 0.1 * rng.standard_normal(6)))
    u = rng.standard_normal((12, 3))
    y = p[:3] + G0 * (u / np.linalg.norm(u, axis=1, keepdims=True)) @ response(p).T
    np.testing.assert_allclose(ellipsoid_start(y, G0), p, atol=1e-11)  # rounding
    assert ellipsoid_start(y[:8], G0) is None
    assert ellipsoid_start(y * [1.0, 1.0, 0.0], G0) is None
    p[3:] = [0.1, 0.0, 0.0, 0.1, 0.0, 0.1]
    y = p[:3] + G0 * (u / np.linalg.norm(u, axis=1, keepdims=True)) @ response(p).T
    np.testing.assert_allclose(sphere_start(y, G0), p, atol=1e-11)  # rounding


# the bias of two seconds is as uncertain as the turns are: its share of the covariance is seen
OPTIONS = [
    {},
    {"gyro_bias": "estimate", "robust": False},
    {"g_sensitivity": True},
    {"initial_rest_s": 2.0},
    {"initial_rest_s": 10.0, "rests": "tedaldi"},
]


def campaign(runs, options, **simulation):
    """Squared normalised errors, and errors over sigma, of runs with new noise on the same turns."""
    errors = noisy(some_errors(G=2e-4 if options.get("g_sensitivity") else 0.0))
    d2, z, unit = [], [], []
    for k in range(runs):
        rng = np.random.default_rng(100)
        rotvecs = spread_turns(20, rng)
        imu = hand_log(errors, np.random.default_rng([7, k]), rotvecs=rotvecs, rest_s=3.0, turn_s=1.5, **simulation)
        r = calibrate_freepose(imu, noise=(N_G, N_A), **options)
        e = difference(r, errors)
        d2.append(float(e @ np.linalg.solve(r.covariance, e)))
        z.append(e / r.sigma)
        unit.append(r.variance_of_unit_weight)
    return np.array(d2), np.array(z), np.array(unit), r


def check_campaign(runs, options, z_limit):
    d2, z, unit, r = campaign(runs, options)
    p = len(r.names)
    # means of a chi-square: standard error sqrt(2 p / runs); limits in standard errors, seeds fixed
    assert abs(d2.mean() - p) < z_limit * np.sqrt(2.0 * p / runs), d2.mean()
    assert abs(unit.mean() - 1.0) < z_limit * np.sqrt(2.0 / (r.freedom * runs)) + 0.03, unit.mean()
    scale = np.sqrt((z**2).mean(axis=0))
    assert (np.abs(scale - 1.0) < 4.5 / np.sqrt(2.0 * runs)).all(), dict(zip(r.names, scale.round(2), strict=True))
    assert (np.abs(z.mean(axis=0)) < 4.5 / np.sqrt(runs)).all()  # no bias


@pytest.mark.campaign
@pytest.mark.parametrize("runs", [20, pytest.param(60, marks=pytest.mark.campaign)])
@pytest.mark.thinned(8)
@pytest.mark.parametrize("options", OPTIONS)
def test_covariance_is_the_scatter(options, runs):
    check_campaign(runs, options, 4.0)


@pytest.mark.slow
@pytest.mark.parametrize("options", OPTIONS)
def test_covariance_is_the_scatter_in_full(options):
    check_campaign(1000, options, 4.0)


@pytest.mark.parametrize("options", [*OPTIONS[:3], {"initial_rest_s": 2.0, "robust": False}])
def test_covariance_of_gyroscopes_is_the_inverse_of_their_normal_matrix(monkeypatch, options):
    """Law: with weights that are the inverse of what the residuals scatter, the propagated covariance (poses, turns,
    bias, rates at rest, term by term) is the inverse of the normal matrix. To what weights change in the last steps."""
    fits = []

    def keep(*arguments, **keywords):
        fits.append(fit_gyroscopes(*arguments, **keywords))
        return fits[-1]

    monkeypatch.setattr(solution, "fit_gyroscopes", keep)
    calibrate_freepose(log_of(noisy(some_errors())), noise=(N_G, N_A), **options)
    sigma = np.sqrt(np.diag(fits[-1].covariance))
    scale = np.outer(sigma, sigma)
    np.testing.assert_allclose(fits[-1].covariance / scale, np.linalg.inv(fits[-1].normal) / scale, atol=1e-3)


def coverage(runs, *, G, wander, **options):
    """Share of errors within 1.96 sigma, by block: bias instability on, and g-sensitivity that is not estimated."""
    bias = NoiseModel((White(N_G), GaussMarkov(wander, 15.0)))
    inside: dict[str, list[float]] = {}
    for k in range(runs):
        rng = np.random.default_rng([11, k])
        errors = replace(noisy(some_errors(k, G=G)), gyro_noise=bias)
        imu = hand_log(errors, rng, rotvecs=spread_turns(24, rng), rest_s=4.0, turn_s=1.5, initial_rest_s=4.0)
        r = calibrate_freepose(imu, **options)
        for name, z in zip(r.names, difference(r, errors) / r.sigma, strict=True):
            inside.setdefault(name[:3], []).append(abs(z) < 1.96)
    return {block: float(np.mean(values)) for block, values in inside.items()}


@pytest.mark.campaign
@pytest.mark.parametrize(("G", "wander"), [(0.0, 0.0), (0.0, 3e-4), (5e-5, 3e-4)])
def test_intervals_cover_with_a_bias_that_wanders_and_g_sensitivity_that_is_not_estimated(G, wander):
    """95 % intervals hold the truth in 93 to 97 % of 150 logs, with two standard errors (0.5 % to 0.9 %) beside.
    Without wander that of `b_g` allows for one that so few rests do not refute."""
    share = coverage(150, G=G, wander=wander, g_sensitivity=False)
    for block, value in share.items():
        error = 0.01 if block == "M_g" else 0.018
        assert 0.93 - error < value < 0.97 + (error if wander or block != "b_g" else 0.02), share


def test_what_the_held_bias_misses_in_turns_is_what_drawn_biases_miss():
    """Biases that drift and scatter, rests that measure them: covariances of 20000 draws (statistical, 4 sigma;
    a bridge of 24 steps lacks 0.2 %). What all rests have in common is in the bias of the log, not in the turns."""
    rng, m, draws = np.random.default_rng(8), 7, 20_000
    t, white = np.arange(m), np.full((m, 3), 0.5)
    S = np.exp(-np.abs(t[:, None] - t) / 3.0) + 2.0
    V = S + np.diag(white[:, 0] ** 2)
    pair = np.array([(0, 1), (1, 2), (2, 3), (4, 5), (5, 6)])  # a turn is left out
    bias = np.linalg.cholesky(S) @ rng.standard_normal((m, draws))
    w = np.linalg.solve(V, np.ones(m))
    held = (w / w.sum()) @ (bias + 0.5 * rng.standard_normal((m, draws)))
    way = np.cumsum(rng.standard_normal((24, len(pair), draws)), axis=0) / np.sqrt(24.0)
    bridge = (way - np.arange(1, 25)[:, None, None] / 24.0 * way[-1]).mean(axis=0)
    step = np.sqrt(2.0 - 2.0 * np.exp(-1.0 / 3.0))  # of the bias from a rest to the next
    missed = held - bias[pair].mean(axis=1) - step * bridge
    empty = np.zeros((m, 3))
    scatter = RestScatter(empty[:1], np.zeros((3, 1, 1)), np.array([V] * 3), empty, empty[0], empty[0], 0.0, 1)
    turns = bias_in_turns(scatter, white, pair)
    spread = np.cov(np.vstack((missed, held)))
    tolerance = 4.0 * np.sqrt(np.outer(np.diag(spread), np.diag(spread)) * 2.0 / draws)
    for i in range(3):
        assert (np.abs(turns.covariance[i] - spread[:-1, :-1]) < tolerance[:-1, :-1]).all()
        assert (np.abs(turns.cross[:, i] - spread[:-1, -1]) < tolerance[:-1, -1]).all()
    assert turns.covariance[0].max() < 1.0 < 2.0 < spread[-1, -1]


@pytest.mark.campaign
def test_a_few_logs_with_a_bias_that_wanders():
    """The same of twelve logs, in the default suite: no block below 85 %."""
    share = coverage(12, G=5e-5, wander=3e-4, g_sensitivity=False)
    assert min(share.values()) > 0.85, share


def test_halves_are_what_each_half_gives_from_nothing():
    """Parts start from the solution of all rests: within the hundredth of a sigma where their steps end. Gyroscopes
    that are not linear make turns scatter, so that weights are found step by step too."""
    imu = log_of(noisy(some_errors(3)), seed=4)
    imu = replace(imu, gyro=imu.gyro + 0.1 * imu.gyro**2)
    whole = calibrate_freepose(imu, g_sensitivity=False)
    assert whole.extra["spread_gyro"] > 0.0
    spans, rates = whole.extra["intervals"], imu.rates()
    for name, parts in halves_of(len(spans)).items():
        alone = [
            calibrate_freepose(imu, intervals=spans[k], nominal=whole.nominal, g_sensitivity=False, halves=False)
            for k in parts
        ]
        stated = None
        if name.startswith("odd"):  # what drifts is common to both
            index = np.searchsorted(rates.t, np.array(spans))
            variance = bias_difference(rates, pose_means(rates, imu.interval, index, 0), np.arange(len(spans)) % 2 == 0)
            stated = dict(zip(BIAS_G, whole.nominal[1] ** 2 * variance, strict=True))
        expected = split(name, *alone, (), stated)
        assert whole.extra["halves"]["splits"][name] == pytest.approx(expected.rms, abs=0.02)
