"""What a noise process does must not depend on the rate at which it is drawn, nor on how extreme its numbers are."""

from itertools import pairwise
from math import exp, log, pi, sqrt

import numpy as np
import pytest

from schuler.exceptions import InputError
from schuler.sensors import (
    AutoRegressive,
    Flicker,
    GaussMarkov,
    GaussMarkov2,
    NoiseModel,
    Quantisation,
    Ramp,
    RandomConstant,
    RandomWalk,
    Sinusoid,
    White,
)

SIGMAS = 4.5  # statistical tolerances: standard errors, seeds fixed
HOUR = 3600.0
RATES = (10.0, 200.0)


def v1(sigma: float, tau: float, T: float) -> float:
    """Variance of the integral of a Gauss-Markov process, Flenniken digest 4.5."""
    return 2.0 * sigma**2 * tau**2 * (T / tau - 1.0 + exp(-T / tau))


def second_order(sigma: float, w: float, T: float) -> float:
    """The same at critical damping: twice the integral of (T - t) (1 + w t) exp(-w t)."""
    z = w * T
    return 2.0 * (sigma / w) ** 2 * (2.0 * z - 3.0 + (z + 3.0) * exp(-z))


# process, variance of its integral over T [s] in closed form
DRIFTS = [
    (White(0.02), lambda T: 0.02**2 * T),
    (Quantisation(0.01), lambda T: 2.0 * 0.01**2),
    (RandomWalk(1e-3), lambda T: 1e-6 * T**3 / 3.0),
    (Ramp(1e-5), lambda T: 0.25e-10 * T**4),
    (GaussMarkov(0.01, 100.0), lambda T: v1(0.01, 100.0, T)),
    (GaussMarkov(0.01, 5.0), lambda T: v1(0.01, 5.0, T)),
    (GaussMarkov(0.01, 1e9), lambda T: (0.01 * T) ** 2),
    (GaussMarkov2(0.01, 0.05), lambda T: second_order(0.01, 0.05, T)),
    (Sinusoid(0.01, 0.0131), lambda T: 2.0 * (0.01 / (2.0 * pi * 0.0131) * np.sin(pi * 0.0131 * T)) ** 2),
    (RandomConstant(0.01), lambda T: (0.01 * T) ** 2),
    (
        White(0.02) + GaussMarkov(0.01, 100.0) + GaussMarkov(0.02, 1000.0) + RandomWalk(1e-4),
        lambda T: 0.02**2 * T + v1(0.01, 100.0, T) + v1(0.02, 1000.0, T) + 1e-8 * T**3 / 3.0,
    ),
]


def drift_variance(process, T: float, rate: float) -> float:
    """Of the sum of samples times dt over T, exactly, by doubling the interval."""
    dt = 1.0 / rate
    system = process.sampled(dt)
    k = len(system.H)
    Phi, Q, P = np.zeros((k + 1, k + 1)), np.zeros((k + 1, k + 1)), np.zeros((k + 1, k + 1))
    Phi[:k, :k], Phi[k, :k], Phi[k, k] = system.Phi, dt * system.H, 1.0
    Q[:k, :k], Q[k, k] = system.Qd, system.R * dt**2
    P[:k, :k] = system.P0
    n = round(T * rate)
    while n:
        if n & 1:
            P = Phi @ P @ Phi.T + Q
        Phi, Q = Phi @ Phi, Phi @ Q @ Phi.T + Q
        n >>= 1
    return float(P[k, k])


@pytest.mark.parametrize(("process", "expected"), DRIFTS, ids=[str(p) for p, _ in DRIFTS])
@pytest.mark.parametrize("rate", RATES)
def test_drift_after_an_hour_is_the_closed_form_at_any_rate(process, expected, rate):
    """Tolerance: discretisation, a rectangle rule for terms that are points, of relative order dt / T and dt / tau."""
    assert drift_variance(process, HOUR, rate) == pytest.approx(expected(HOUR), rel=0.01 * 10.0 / rate)


def drifts(process, T: float, rate: float, columns: int, seed: int) -> np.ndarray:
    """Sums of samples times dt, a few columns at a time."""
    rng = np.random.default_rng(seed)
    n = round(T * rate)
    at_once = max(1, min(columns, 2_000_000 // n))
    parts = [process.sample((n, at_once), 1.0 / rate, rng).sum(axis=0) / rate for _ in range(-(-columns // at_once))]
    return np.concatenate(parts)


def check_drifts(process, expected: float, T: float, columns: dict[float, int]) -> None:
    drift = {rate: drifts(process, T, rate, k, seed=60) for rate, k in columns.items()}
    # a sine of random phase scatters less than a normal variable
    square = {rate: np.mean(x**2) / expected for rate, x in drift.items()}
    error = {rate: sqrt(2.0 / len(x)) for rate, x in drift.items()}
    for rate in columns:
        assert abs(square[rate] - 1.0) < SIGMAS * error[rate] + 0.01  # statistical; 1 % discretisation
    slow, fast = columns
    assert abs(square[slow] - square[fast]) < SIGMAS * np.hypot(error[slow], error[fast]) + 0.01


@pytest.mark.thinned(3)
@pytest.mark.parametrize(("process", "expected"), DRIFTS, ids=[str(p) for p, _ in DRIFTS])
def test_drift_of_samples_at_10_and_200_hz(process, expected):
    """One minute; the full hour below."""
    T = 60.0
    check_drifts(process, expected(T), T, {10.0: 1000, 200.0: 300})


@pytest.mark.slow
@pytest.mark.parametrize(("process", "expected"), DRIFTS, ids=[str(p) for p, _ in DRIFTS])
def test_drift_of_samples_after_an_hour(process, expected):
    check_drifts(process, expected(HOUR), HOUR, {10.0: 1000, 200.0: 150})


@pytest.mark.parametrize("T", [60.0, 600.0, HOUR, 14 * HOUR])
@pytest.mark.parametrize("rate", [1.0, 10.0, 50.0, 125.0, 200.0, 1000.0])
def test_mean_of_a_flicker_record_has_the_deviation_B(T, rate):
    """At every rate and duration: stated accuracy 1 %, and 0.3 % between rates where a record has 600 samples."""
    made = Flicker(2.0).approximation(round(T * rate), 1.0 / rate)
    mean = sum(v1(p.sigma, p.tau, T) for p in made.terms) / T**2
    assert sqrt(mean) == pytest.approx(2.0, rel=0.003 if T * rate >= 600 else 0.01)


@pytest.mark.parametrize("runs", [100, pytest.param(300, marks=pytest.mark.campaign)])
def test_drift_of_flicker_samples_at_10_and_200_hz(runs):
    check_drifts(Flicker(0.01), (0.01 * 60.0) ** 2, 60.0, {10.0: 1000, 200.0: runs})


@pytest.mark.parametrize("n", [1, 2, 7, 1000, 1001, 123_456])
def test_flicker_processes_fill_the_band(n):
    """Each stands for the times half a step around it: together B^2 / pi for every unit of ln(tau), and no more."""
    dt, step = 0.01, sqrt(10.0)
    made = Flicker(3.0).approximation(n, dt).terms
    band = log(5.0 * n / 0.72) + log(step)
    assert sum(p.sigma**2 for p in made) == pytest.approx(9.0 / pi * band, rel=1e-9)  # rounding
    assert made[0].tau == pytest.approx(0.72 * dt)
    # the last stands in the middle of what is left of a step
    edge, end = made[-2].tau * sqrt(step), 5.0 * n * dt * sqrt(step)
    assert made[-1].tau == pytest.approx(sqrt(edge * end))
    ratio = [b.tau / a.tau for a, b in pairwise(made)]
    np.testing.assert_allclose(ratio[:-1], step, rtol=1e-12)


def test_states_of_flicker():
    """One process per decade from 1 s to 1e4 s, or within the band given."""
    for process, taus in (
        (Flicker(1.0), [1.0, 10.0, 100.0, 1e3, 1e4]),
        (Flicker(1.0, longest=0.5), [0.05, 0.5]),
        (Flicker(1.0, 1e5), [1e5, 1e6]),
    ):
        np.testing.assert_allclose(-1.0 / np.diag(process.state_space().F), taus, rtol=1e-12)  # rounding


def test_flicker_of_a_given_band():
    made = Flicker(1.0, 1.0, 100.0).approximation(50, 0.1).terms
    np.testing.assert_allclose([p.tau for p in made], [1.0, sqrt(10.0), 10.0, 1000.0**0.5, 100.0], rtol=1e-9)
    (only,) = Flicker(1.0, shortest=100.0).approximation(50, 0.1).terms  # longer than five records
    assert (only.tau, only.sigma) == pytest.approx((100.0, sqrt(log(sqrt(10.0)) / pi)))


NOTHING = [
    White(0.0),
    Quantisation(0.0),
    RandomWalk(0.0),
    Ramp(0.0),
    Ramp(0.0, fixed=True),
    Flicker(0.0),
    GaussMarkov(0.0, 3.0),
    GaussMarkov2(0.0, 3.0),
    AutoRegressive((0.5, -0.2), 0.0, 10.0),
    Sinusoid(0.0, 3.0),
    RandomConstant(0.0),
]


@pytest.mark.parametrize("process", NOTHING, ids=str)
def test_no_noise_is_zero_everywhere(process):
    """Also at f = 0, where others have a pole: no NaN of 0/0 (warnings are errors here)."""
    rng = np.random.default_rng(61)
    f, m = np.array([0.0, 0.3, 4.0]), np.array([1, 10, 1000])
    assert not process.sample((20, 2), 0.1, rng).any()
    assert not process.allan_variance([0.1, 100.0]).any()
    assert not process.discrete_allan_variance(m, 0.1).any()
    assert not process.discrete_psd(f, 0.1).any()
    assert not process.sampled(0.1).covariance(3).any()
    assert not process.sampled(0.1).sample((5, 2), rng).any()
    if not isinstance(process, Quantisation):
        assert not process.psd(f).any()
    both = White(0.3) + process
    np.testing.assert_allclose(both.discrete_allan_variance(m, 0.1), White(0.3).discrete_allan_variance(m, 0.1))


@pytest.mark.parametrize("h", [1e-300, 1e-150, 1e-12, 1e6, 1e12, 1e300])
def test_correlation_times_far_from_the_interval(h):
    """h = dt / tau: a constant at one end, white samples at the other, finite numbers between."""
    sigma, dt, m = 1.7, 0.01, np.array([1, 10, 10**6])
    process = GaussMarkov(sigma, dt / h)
    x = process.sample((50, 4000), dt, np.random.default_rng(62))
    assert abs(x[0].var() / sigma**2 - 1.0) < SIGMAS * sqrt(2.0 / 4000)
    got, states = process.discrete_allan_variance(m, dt), process.sampled(dt).allan_variance(m)
    np.testing.assert_allclose(process.sampled(dt).covariance(1), sigma**2, rtol=1e-12)
    assert np.isfinite(process.allan_variance(m * dt)).all()
    if h < 1.0:
        np.testing.assert_allclose(x[-1], x[0], atol=20.0 * sigma * sqrt(2.0 * 49.0 * h))
        # a random walk of K^2 = 2 sigma^2 / tau: next order m h
        walk = sigma**2 * h * (2.0 * m**2 + 1.0) / (3.0 * m)
        np.testing.assert_allclose(got, walk, rtol=1e-5)
        np.testing.assert_allclose(states, walk, rtol=1e-5)
    else:
        assert abs((x[0] * x[-1]).mean()) < SIGMAS * sigma**2 / sqrt(4000)
        np.testing.assert_allclose(got, sigma**2 / m, rtol=1e-12)  # rounding
        np.testing.assert_allclose(states, sigma**2 / m, rtol=1e-12)


@pytest.mark.parametrize("tau", [1e-8, 1e9])
def test_second_order_and_extreme_times(tau):
    process = GaussMarkov2(1.7, 1.0 / tau)
    x = process.sample((20, 4000), 0.01, np.random.default_rng(63))
    assert abs(x[0].var() / 1.7**2 - 1.0) < SIGMAS * sqrt(2.0 / 4000)
    assert abs(x[-1].var() / 1.7**2 - 1.0) < SIGMAS * sqrt(2.0 / 4000)
    expected = 1.7**2 / np.array([1, 100]) if tau < 1.0 else 0.0
    # white samples, or a smooth curve: K'' (m dt)^2 / 2 of size (dt / tau)^2
    np.testing.assert_allclose(process.discrete_allan_variance([1, 100], 0.01), expected, rtol=1e-9, atol=1e-15)


ALL = (
    White(0.3)
    + Quantisation(0.02)
    + Flicker(0.1)
    + RandomWalk(0.1)
    + Ramp(0.1)
    + GaussMarkov(1.0, 1.0)
    + GaussMarkov(0.5, 200.0)
    + GaussMarkov2(1.0, 2.0)
    + AutoRegressive((0.5, 0.2), 1.0, 100.0)
    + Sinusoid(1.0, 2.0)
    + RandomConstant(1.0)
)


def test_every_process_can_be_added():
    dt, m, f = 0.01, np.array([1, 3, 50]), np.array([0.3, 7.0])
    assert len(ALL.terms) == 11
    total = sum((t.discrete_allan_variance(m, dt) for t in ALL.terms), np.zeros(3))
    np.testing.assert_allclose(ALL.discrete_allan_variance(m, dt), total, rtol=1e-13)  # rounding
    np.testing.assert_allclose(ALL.discrete_psd(f, dt), sum(t.discrete_psd(f, dt) for t in ALL.terms), rtol=1e-13)
    np.testing.assert_allclose(
        ALL.sampled(dt).covariance(4), sum(t.sampled(dt).covariance(4) for t in ALL.terms), rtol=1e-12
    )
    children = np.random.default_rng(64).spawn(11)
    parts = sum(t.sample((6, 3), dt, child) for t, child in zip(ALL.terms, children, strict=True))
    np.testing.assert_allclose(ALL.sample((6, 3), dt, np.random.default_rng(64)), parts, atol=1e-14)  # rounding
    with pytest.raises(InputError, match="defined at its samples only"):
        ALL.state_space()


@pytest.mark.parametrize("process", [Sinusoid(1.5, 0.37), AutoRegressive((0.5, -0.3), 0.7, 10.0)], ids=str)
def test_autocovariance_is_that_of_the_states(process):
    C = process.sampled(0.1).covariance(30)
    np.testing.assert_allclose(process.autocovariance(0.1 * np.arange(30)), C[0], atol=1e-13)  # rounding
    np.testing.assert_allclose(process.autocovariance(-0.5), C[5, 0], atol=1e-13)


def test_lines_and_their_aliases():
    np.testing.assert_array_equal(RandomConstant(2.0).discrete_psd([0.0, 4.0, -8.0, 0.25], 0.25), [np.inf] * 3 + [0.0])


def test_state_space_of_a_zero_start():
    process = GaussMarkov(2.0, 3.0, "zero")
    assert not process.state_space().P0.any()
    assert process.variance([0.0, 1e9]).tolist() == [0.0, 4.0]


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: White(1.0).allan_variance(0.0), "tau: expected positive finite times in seconds, got 0.0"),
        (lambda: GaussMarkov(1.0, 1.0).allan_variance([1.0, -1.0]), "tau: expected positive"),
        (lambda: GaussMarkov2(1.0, 1.0).allan_variance(np.inf), "tau: expected positive"),
        (lambda: RandomWalk(1.0).allan_variance(-1.0), "tau: expected positive"),
        (lambda: Ramp(1.0).allan_variance(np.nan), "tau: expected positive"),
        (lambda: Flicker(1.0).allan_variance(-1.0), "tau: expected positive"),
        (lambda: Quantisation(1.0).allan_variance(0.0), "tau: expected positive"),
        (lambda: Sinusoid(1.0, 1.0).allan_variance(0.0), "tau: expected positive"),
        (lambda: RandomConstant(1.0).allan_variance(0.0), "tau: expected positive"),
        (lambda: AutoRegressive((0.5,), 1.0, 10.0).allan_variance(0.0), "tau: expected positive"),
        (lambda: ALL.allan_variance(0.0), "tau: expected positive"),
        (lambda: NoiseModel().allan_variance(0.0), "tau: expected positive"),
        (lambda: NoiseModel().discrete_allan_variance(0, 0.1), "m: expected whole numbers"),
        (lambda: NoiseModel().sample(3, -0.1, np.random.default_rng(0)), "dt: expected one positive"),
        (lambda: NoiseModel((1.0,)), r"terms: expected noise processes such as White\(N\), got 1.0"),
        (lambda: White(1.0).psd([np.nan]), "f: expected finite frequencies"),
        (lambda: GaussMarkov2(1.0, 1.0).discrete_psd(np.inf, 0.1), "f: expected finite frequencies"),
        (lambda: White(1.0).variance(0.0), "dt: expected one positive"),
        (lambda: Quantisation(1.0).variance(-1.0), "dt: expected one positive"),
        (lambda: RandomWalk(1.0).variance(-1.0), "t: expected finite times in seconds since the start"),
        (lambda: GaussMarkov(1.0, 1.0, "zero").variance(-1.0), "t: expected finite times"),
        (lambda: Flicker(1.0, 1.0).approximation(10, -1.0), "dt: expected one positive"),
        (lambda: RandomConstant(1.0).sample(5, 0.0, np.random.default_rng(0)), "dt: expected one positive"),
    ],
)
def test_refusals(call, message):
    with pytest.raises(InputError, match=message):
        call()
