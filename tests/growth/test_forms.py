"""Closed forms of error growth against quadrature, Monte Carlo, exact covariance recursions, and each other."""

from fractions import Fraction
from math import factorial

import numpy as np
import pytest
from numpy.testing import assert_allclose

from schuler.exceptions import InputError
from schuler.growth import (
    constant,
    growth,
    horizontal,
    integral_variance,
    lateral,
    lateral_white,
    lateral_white_large,
    lateral_white_sampled,
    random_walk,
    second_order_vertical,
    vertical,
    white,
    white_sampled,
)
from schuler.growth.closed_forms import gauss_markov
from schuler.growth.schuler_loop import RADIUS, _late
from schuler.reproduce.flenniken.study.heading.linear import LinearModel
from schuler.reproduce.flenniken.study.tables import EXACT, POSITION
from schuler.sensors.catalogue import spec
from schuler.units import DEG, G0

RUNS = 20_000
FOUR = 4.0 * np.sqrt(2.0 / RUNS)  # four standard errors of a variance
SIGMA, TAU = 0.3, 20.0

#: 1-sigma of velocity and position across the track, by grade and time [s]. [m/s], [m]
LATERAL = {
    ("consumer", 30.0): (0.0183, 0.1834),
    ("consumer", 60.0): (0.0683, 1.375),
    ("automotive", 60.0): (0.0170, 0.3444),
    ("tactical-printed", 60.0): (3.743e-5, 8.692e-4),
    ("tactical", 60.0): (3.743e-6, 8.692e-5),
    ("tactical", 300.0): (3.291e-5, 3.854e-3),
}


def chain(n, sigma, tau, N=0.0):
    """b and its integrals, white noise N beside b into the first."""
    A = np.zeros((n + 1, n + 1))
    A[0, 0] = -1.0 / tau
    for i in range(n):
        A[i + 1, i] = 1.0
    Q = np.zeros((n + 1, n + 1))
    Q[0, 0] = 2.0 * sigma**2 / tau
    if n:
        Q[1, 1] = N**2
    return LinearModel(tuple(f"x{i}" for i in range(n + 1)), A, np.zeros((n + 1, 1)), np.zeros((1, n + 1)), Q, Q)


def covariance(model, t, P0):
    d = model.discrete(t)
    return d.Phi @ P0 @ d.Phi.T + d.Qd


def response(order, s):
    """Response of the n-th integral of b to an impulse of its drive, s ago, over sigma sqrt(2 / tau)."""
    z = s / TAU
    e = np.exp(-z)
    return (e, TAU * (1.0 - e), TAU**2 * (z - 1.0 + e), TAU**3 * (0.5 * z**2 - z + 1.0 - e))[order]


@pytest.mark.parametrize("order", [0, 1, 2, 3])
@pytest.mark.parametrize("t", [0.3, 6.0, 20.0, 21.0, 200.0])
def test_zero_start_is_the_integral_of_the_squared_response(order, t):
    """Gauss-Legendre quadrature, rounding; the responses themselves cancel for t << tau, hence 1e-9 there."""
    x, w = np.polynomial.legendre.leggauss(80)
    s = 0.5 * t * (x + 1.0)
    expected = 2.0 * SIGMA**2 / TAU * 0.5 * t * np.sum(w * response(order, s) ** 2)
    assert_allclose(integral_variance(order, t, SIGMA, TAU, "zero"), expected, rtol=1e-9 if t > 1.0 else 1e-6)


@pytest.mark.parametrize("start", ["stationary", "zero"])
@pytest.mark.parametrize("order", [0, 1, 2, 3])
def test_gauss_markov_agrees_with_the_covariance_recursion(order, start):
    """1e-6: what Van Loan's matrix exponential keeps of a third integral of a short time."""
    for t in (2.0, 8.0, 60.0):
        P0 = np.zeros((order + 1, order + 1))
        P0[0, 0] = SIGMA**2 if start == "stationary" else 0.0
        P = covariance(chain(order, SIGMA, TAU), t, P0)
        assert_allclose(integral_variance(order, t, SIGMA, TAU, start), P[order, order], rtol=1e-6)


@pytest.mark.parametrize("order", [1, 2, 3])
def test_series_and_closed_form_meet(order):
    """No step at z = 1 nor, for a zero start, at 0.5: relative 1e-10, rounding after cancellation."""
    for start, z in (("stationary", 1.0), ("zero", 0.5)):
        below, above = (float(integral_variance(order, TAU * z * f, SIGMA, TAU, start)) for f in (1 - 1e-13, 1 + 1e-13))
        assert_allclose(above, below, rtol=1e-9)


def test_short_and_long_times():
    """Leading terms: short, a constant (stationary) or a walk (zero); long, white noise of sigma sqrt(2 tau)."""
    short, long = 1e-5 * TAU, 3e4 * TAU
    for n in (1, 2, 3):
        assert_allclose(
            np.sqrt(integral_variance(n, short, SIGMA, TAU)), constant(n, short, SIGMA), rtol=1e-5
        )  # fmt: skip
        walk = random_walk(n, short, SIGMA * np.sqrt(2.0 / TAU))
        assert_allclose(integral_variance(n, short, SIGMA, TAU, "zero"), walk, rtol=3e-5)
        noise = white(n, long, SIGMA * np.sqrt(2.0 * TAU))
        assert_allclose(integral_variance(n, long, SIGMA, TAU), noise, rtol=3e-4)


def samples(t, count, rng):
    return np.sqrt(t / count) * rng.standard_normal((count, RUNS))


def test_white_noise_monte_carlo():
    """t, t^3 / 3, t^5 / 20; 20,000 runs, four standard errors; 400 trapezoid steps leave 1e-5."""
    rng, t, count = np.random.default_rng(1), 40.0, 400
    h = t / count
    first = np.vstack((np.zeros(RUNS), np.cumsum(0.2 * samples(t, count, rng), axis=0)))
    second = h * np.cumsum(0.5 * (first[1:] + first[:-1]), axis=0)
    third = h * (second.sum(axis=0) - 0.5 * second[-1])
    for n, x in ((1, first[-1]), (2, second[-1]), (3, third)):
        assert abs(np.var(x) / float(white(n, t, 0.2)) - 1.0) < FOUR + 1e-3


@pytest.mark.parametrize("start", ["stationary", "zero"])
def test_gauss_markov_monte_carlo(start):
    """All integrals at z = 3 from samples of the process, trapezoid rule of 300 steps (1e-4), four standard errors."""
    rng, t, count = np.random.default_rng(2), 3.0 * TAU, 300
    h, e = t / count, np.exp(-t / count / TAU)
    b = SIGMA * rng.standard_normal(RUNS) if start == "stationary" else np.zeros(RUNS)
    x = np.zeros((3, RUNS))
    for _ in range(count):
        new = e * b + SIGMA * np.sqrt(1.0 - e * e) * rng.standard_normal(RUNS)
        last = x.copy()
        x[0] += 0.5 * h * (b + new)
        x[1] += 0.5 * h * (last[0] + x[0])
        x[2] += 0.5 * h * (last[1] + x[1])
        b = new
    for n in (1, 2, 3):
        assert abs(np.var(x[n - 1]) / float(gauss_markov(n, t, SIGMA, TAU, start)) - 1.0) < FOUR + 1e-3


def test_sampled_noise_sums_exactly():
    """Positions of samples held over a step, and products of samples and summed headings: four standard errors."""
    rng, count, h = np.random.default_rng(3), 40, 0.5
    a = 0.2 / np.sqrt(h) * rng.standard_normal((count, RUNS))
    psi = np.vstack((np.zeros(RUNS), np.cumsum(0.01 * np.sqrt(h) * rng.standard_normal((count, RUNS)), axis=0)))[:-1]

    def integrated(x):
        v = h * np.cumsum(x, axis=0)
        return v[-1], h * np.sum(v - 0.5 * h * x, axis=0)

    _, position = integrated(a)
    assert abs(np.var(position) / float(white_sampled(count * h, h, 0.2)) - 1.0) < FOUR
    for x, expected in zip(integrated(a * psi), lateral_white_sampled(count * h, h, 0.2, 0.01), strict=True):
        kurtosis = np.mean((x - x.mean()) ** 4) / np.var(x) ** 2
        assert abs(np.var(x) / float(expected) - 1.0) < 4.0 * np.sqrt((kurtosis - 1.0) / RUNS)


@pytest.mark.campaign
def test_position_across_the_track_is_a_twelfth():
    """E1: the printed 1/8 is rejected by a Monte Carlo that accepts 1/12. 400 steps leave 1 %."""
    rng, count, t = np.random.default_rng(4), 400, 20.0
    h = t / count
    a = 0.2 / np.sqrt(h) * rng.standard_normal((count, RUNS))
    psi = np.cumsum(0.01 * np.sqrt(h) * rng.standard_normal((count, RUNS)), axis=0)
    v = h * np.cumsum(a * psi, axis=0)
    ratio = np.var(h * v.sum(axis=0)) / float(lateral_white(t, 0.2, 0.01)[1])
    assert abs(ratio - 1.0) < 4.0 * np.sqrt(3.5 / RUNS) + 0.01
    assert ratio * (1.0 / 12.0) / (1.0 / 8.0) < 0.75


def test_large_headings():
    """Any heading error: product with sines and cosines, four standard errors; small ones as the simple form."""
    rng, count, t, N_g = np.random.default_rng(5), 300, 30.0, 0.15
    h = t / count
    a = 0.2 * np.sqrt(h) * rng.standard_normal((count, RUNS))
    psi = np.vstack((np.zeros(RUNS), np.cumsum(N_g * np.sqrt(h) * rng.standard_normal((count, RUNS)), axis=0)))[:-1]
    for x, expected in zip((np.sin(psi), np.cos(psi)), lateral_white_large(t, 0.2, N_g), strict=True):
        assert abs(np.var((a * x).sum(axis=0)) / float(expected) - 1.0) < 4.0 * np.sqrt(3.0 / RUNS) + 0.005
    assert_allclose(lateral_white_large(t, 0.2, 1e-6)[0], lateral_white(t, 0.2, 1e-6)[0], rtol=1e-4)


def test_lateral_with_biases():
    """Limits: noise alone is the closed form (1e-10); short times t^4 / 4 and t^6 / 36 of the biases (1 %)."""
    assert_allclose(lateral(9.0, (0.2, 0.0, 1.0), (0.01, 0.0, 1.0)), lateral_white(9.0, 0.2, 0.01), rtol=1e-10)
    v, p = lateral(0.1, (0.0, SIGMA, TAU), (0.0, 0.02, TAU))
    assert_allclose([v, p], [SIGMA**2 * 0.02**2 * 1e-4 / 4.0, SIGMA**2 * 0.02**2 * 1e-6 / 36.0], rtol=1e-2)
    for (grade, t), printed in LATERAL.items():
        triads = spec(f"flenniken-{grade}")
        pairs = [(s.random_walk, s.in_run_bias, s.in_run_time) for s in (triads.accel, triads.gyro)]
        assert_allclose(np.sqrt(lateral(t, *pairs)), printed, rtol=3e-3)  # printed digits


def test_lateral_with_biases_monte_carlo():
    """Products of independent wandering acceleration and heading: four standard errors by the sample's kurtosis."""
    rng, t, count, runs = np.random.default_rng(6), 40.0, 400, 8000
    h, e_a, e_g = t / count, np.exp(-t / count / 15.0), np.exp(-t / count / 25.0)
    a, w = SIGMA * rng.standard_normal(runs), 0.02 * rng.standard_normal(runs)
    psi, v, p = np.zeros(runs), np.zeros(runs), np.zeros(runs)
    for _ in range(count):
        a_next = e_a * a + SIGMA * np.sqrt(1.0 - e_a**2) * rng.standard_normal(runs)
        w_next = e_g * w + 0.02 * np.sqrt(1.0 - e_g**2) * rng.standard_normal(runs)
        psi_next = psi + 0.5 * h * (w + w_next) + 0.01 * np.sqrt(h) * rng.standard_normal(runs)
        v_next = v + 0.5 * h * (a * psi + a_next * psi_next)
        p += 0.5 * h * (v + v_next)
        a, w, psi, v = a_next, w_next, psi_next, v_next
    expected = lateral(t, (0.0, SIGMA, 15.0), (0.01, 0.02, 25.0))
    for x, variance in zip((v, p), expected, strict=True):
        kurtosis = np.mean((x - x.mean()) ** 4) / np.var(x) ** 2
        assert abs(np.var(x) / variance - 1.0) < 4.0 * np.sqrt((kurtosis - 1.0) / runs)


def loop(Q_v=0.0, Q_phi=0.0):
    """Velocity, position, tilt, accelerometer bias, gyroscope bias."""
    A = np.zeros((5, 5))
    A[0, 2], A[0, 3], A[1, 0], A[2, 0], A[2, 4] = -G0, 1.0, 1.0, 1.0 / RADIUS, 1.0
    Q = np.diag([Q_v, 0.0, Q_phi, 0.0, 0.0])
    return LinearModel(tuple("vptab"), A, np.zeros((5, 1)), np.zeros((1, 5)), Q, np.zeros((5, 5)))


@pytest.mark.parametrize(
    ("cause", "state"),
    [("initial velocity", 0), ("initial position", 1), ("initial tilt", 2), ("accel bias", 3), ("gyro bias", 4)],
)
def test_schuler_responses_solve_the_loop(cause, state):
    """Against the matrix exponential; 1e-6 of the largest value, its rounding for times from a second to a day."""
    for t in (1.0, 60.0, 1500.0, 5064.0, 20000.0):
        P0 = np.zeros((5, 5))
        P0[state, state] = 1e-4**2
        P = covariance(loop(), t, P0)
        v, p = horizontal(cause, t, 1e-4)
        assert_allclose([v, p], np.sqrt([P[0, 0], P[1, 1]]), rtol=1e-6, atol=1e-9 * max(float(p), 1e-12))


@pytest.mark.parametrize(("cause", "Q_v", "Q_phi"), [("accel noise", 1.0, 0.0), ("gyro noise", 0.0, 1.0)])
def test_schuler_noise_solves_the_loop(cause, Q_v, Q_phi):
    """Against Van Loan's recursion in steps of a minute (its rounding: 1e-6)."""
    d = loop(1e-8 * Q_v, 1e-12 * Q_phi).discrete(60.0)
    P = np.zeros((5, 5))
    for _ in range(120):
        P = d.Phi @ P @ d.Phi.T + d.Qd
    v, p = horizontal(cause, 7200.0, 1e-4 if Q_v else 1e-6)
    assert_allclose([v, p], np.sqrt([P[0, 0], P[1, 1]]), rtol=1e-6)


def test_schuler_forms_begin_as_the_flat_ones():
    """After 30 s feedback is 1e-4 of the whole; white noise and constants."""
    t = 30.0
    assert_allclose(horizontal("accel bias", t, 1e-3), (constant(1, t, 1e-3), constant(2, t, 1e-3)), rtol=3e-4)
    flat = (G0 * constant(2, t, 1e-6), G0 * constant(3, t, 1e-6))
    assert_allclose(horizontal("gyro bias", t, 1e-6), flat, rtol=3e-4)
    assert_allclose(horizontal("accel noise", t, 1e-3), np.sqrt([white(1, t, 1e-3), white(2, t, 1e-3)]), rtol=5e-4)
    noise = (G0 * np.sqrt(white(2, t, 1e-6)), G0 * np.sqrt(white(3, t, 1e-6)))
    assert_allclose(horizontal("gyro noise", t, 1e-6), noise, rtol=5e-4)


def test_vertical_channel():
    """Against the matrix exponential and recursion of dv/dt = 2 g / R h + f; grows e-fold in 9.5 minutes."""
    A = np.zeros((3, 3))
    A[0, 1], A[0, 2], A[1, 0] = 2.0 * G0 / RADIUS, 1.0, 1.0
    for cause, state in (("initial velocity", 0), ("initial position", 1), ("accel bias", 2)):
        model = LinearModel(tuple("vpb"), A, np.zeros((3, 1)), np.zeros((1, 3)), np.zeros((3, 3)), np.zeros((3, 3)))
        for t in (1.0, 300.0, 1800.0):
            P0 = np.zeros((3, 3))
            P0[state, state] = 1e-6
            P = covariance(model, t, P0)
            assert_allclose(vertical(cause, t, 1e-3), np.sqrt([P[0, 0], P[1, 1]]), rtol=1e-6)
    model = LinearModel(tuple("vpb"), A, np.zeros((3, 1)), np.zeros((1, 3)), np.diag([1e-6, 0, 0]), np.zeros((3, 3)))
    for t in (5.0, 20.0, 40.0, 900.0):
        P = covariance(model, t, np.zeros((3, 3)))
        assert_allclose(vertical("accel noise", t, 1e-3), np.sqrt([P[0, 0], P[1, 1]]), rtol=1e-6)
    growth_rate = np.log(vertical("accel bias", 6000.0, 1.0)[1] / vertical("accel bias", 5430.0, 1.0)[1])
    assert abs(float(growth_rate) - 1.0) < 0.01


@pytest.mark.parametrize("x", [1e-4, 0.01, 0.035, 0.049, 0.051, 0.2])
def test_short_times_lose_no_digits(x):
    """Closed forms cancel there: against their power series in rational numbers, on both sides of the change of forms.

    Rounding and the series' own rest: 1e-9 of the 1-sigma, less beyond the change (cancellation of x^2, 1e-16 / x^2).
    """
    w = np.sqrt(G0 / RADIUS)
    t, z = x / w, Fraction(x)

    def series(sign, term):
        return float(sum(Fraction(sign) ** k * term(k) for k in range(1, 14)))

    late = series(-1, lambda k: -(z ** (2 * k + 1)) / factorial(2 * k + 1)) / w  # t - sin(w t) / w
    # the integral of sin^2: half of t, less a quarter of sin(2 x) / w
    squares = series(-1, lambda k: -(2 ** (2 * k + 1) * z ** (2 * k + 1)) / (4 * factorial(2 * k + 1))) / w
    assert_allclose(horizontal("gyro bias", t, 1.0)[1], RADIUS * late, rtol=1e-9)
    assert_allclose(horizontal("accel noise", t, 1.0)[1], np.sqrt(squares) / w, rtol=1e-9)
    # the integral of (1 - cos)^2
    squares = series(1, lambda k: (-1) ** k * (2 ** (2 * k - 1) - 2) * z ** (2 * k + 1) / factorial(2 * k + 1)) / w
    assert_allclose(horizontal("gyro noise", t, 1.0)[1], RADIUS * np.sqrt(squares), rtol=1e-9)
    k, y = np.sqrt(2.0) * w, np.sqrt(2.0) * x
    z = Fraction(float(y))
    squares = series(1, lambda k: (2 ** (2 * k + 1) * z ** (2 * k + 1)) / (4 * factorial(2 * k + 1))) / k
    assert_allclose(vertical("accel noise", t, 1.0)[1], np.sqrt(squares) / k, rtol=1e-9)


def test_exact_table():
    """Eleven worked cases to their printed digits (three or four)."""
    for (grade, t, start), printed in EXACT.items():
        flat = growth(spec(f"flenniken-{grade}"), [t], gravity=0.0, start=start)
        tilted = growth(spec(f"flenniken-{grade}"), [t], start=start)
        ours = [flat.total("heading")[0] / DEG, flat.total("velocity")[0], flat.total("position")[0]]
        ours += [tilted.total("velocity")[0], tilted.total("position")[0]]
        assert_allclose(ours, printed, rtol=1e-3)


def test_position_that_the_source_prints_and_shares_of_its_causes():
    """Read off a figure: 5 %."""
    at_start = growth(spec("flenniken-tactical"), [30.0], gravity=0.0, start="zero")
    assert_allclose(at_start.total("position")[0], POSITION["tactical", 30.0], rtol=0.05)
    result = growth(spec("flenniken-tactical"), np.linspace(0.0, 60.0, 7))
    assert_allclose(result.share("position")[:, -1].sum(), 1.0, rtol=1e-12)
    assert "gyro noise" in result.summary()
    assert np.all(result.share("position")[:, 0] == 0.0)


def test_impossible_arguments_are_refused():
    with pytest.raises(InputError, match="at least one"):
        white(0, 1.0, 1.0)
    with pytest.raises(InputError, match="zero or positive"):
        integral_variance(1, -1.0, SIGMA, TAU)
    with pytest.raises(InputError, match="start"):
        integral_variance(1, 1.0, SIGMA, TAU, "late")
    with pytest.raises(InputError, match="cause"):
        horizontal("wind", 1.0, 1.0)
    with pytest.raises(InputError, match="quantity"):
        growth(spec("flenniken-tactical"), [1.0]).total("height")


def test_schuler_monte_carlo():
    """Two hours of both noises and both biases in one loop, 20,000 runs from exact steps: four standard errors."""
    rng, t = np.random.default_rng(10), 7200.0
    d = loop(1e-8, 1e-14).discrete(120.0)
    root = np.linalg.cholesky(d.Qd[:3, :3] + 1e-30 * np.eye(3))
    x = np.zeros((5, RUNS))
    x[3], x[4] = 1e-4 * rng.standard_normal(RUNS), 1e-9 * rng.standard_normal(RUNS)
    for _ in range(60):
        x = d.Phi @ x
        x[:3] += root @ rng.standard_normal((3, RUNS))
    parts = [("accel noise", 1e-4), ("gyro noise", 1e-7), ("accel bias", 1e-4), ("gyro bias", 1e-9)]
    v, p = np.sum([np.square(horizontal(cause, t, size)) for cause, size in parts], axis=0)
    assert abs(np.var(x[0]) / v - 1.0) < FOUR
    assert abs(np.var(x[1]) / p - 1.0) < FOUR


def test_second_order_of_tilts():
    """Mean of the exact integral over 20,000 pairs of constant biases: four standard errors, and 1 % of large tilts."""
    rng, t, sigma = np.random.default_rng(11), 60.0, 1e-3
    rate = np.hypot(*(sigma * rng.standard_normal((2, RUNS))))
    # double integral of -g (1 - cos(rate t))
    position = -G0 * (0.5 * t**2 - (1.0 - np.cos(rate * t)) / rate**2)
    expected = float(second_order_vertical(t, sigma))
    assert abs(position.mean() / expected - 1.0) < 4.0 * position.std() / abs(expected) / np.sqrt(RUNS) + 0.01


def test_sampled_sums_are_the_sums():
    """Samples held over a step: each adds its step times the time that is left from its middle. Rounding."""
    step, N_a, N_g = 0.1, 0.3, 0.02
    for k in (1, 2, 3, 10, 57):
        i = np.arange(k)
        left = k - i - 0.5
        heading = i * N_g**2 * step
        assert white_sampled(k * step, step, N_a) == pytest.approx(N_a**2 * step**3 * np.sum(left**2), rel=1e-12)
        v, r = lateral_white_sampled(k * step, step, N_a, N_g)
        assert v == pytest.approx(N_a**2 * step * np.sum(heading), rel=1e-12, abs=1e-18)
        assert r == pytest.approx(N_a**2 * step**3 * np.sum(left**2 * heading), rel=1e-12, abs=1e-18)


def test_the_series_of_what_is_late_is_the_sine_s():
    """By fractions, at the end of the series' range, where its terms count most; ours ends with the seventh power."""
    x = Fraction(49, 1000)
    exact = sum((-1) ** (k + 1) * x ** (2 * k + 1) / factorial(2 * k + 1) for k in range(1, 9))
    assert_allclose(_late(1.0, np.array([0.049])), float(exact), rtol=1e-12)
