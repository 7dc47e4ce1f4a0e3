"""Every noise process against its closed forms: states and spectra exactly, samples in standard errors."""

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.signal import welch

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
    allan_minimum,
    flicker,
    quantise_increments,
)

SIGMAS = 4.5  # statistical tolerances: standard errors, seeds fixed; some tests compare hundreds of numbers
DT = 0.1

NOISY = [
    White(0.3),
    Quantisation(0.2),
    RandomWalk(0.1),
    GaussMarkov(1.3, 4.0),
    GaussMarkov(1.3, 0.05),
    GaussMarkov2(0.8, 3.0, 0.1),
    GaussMarkov2(0.8, 1.0),
    GaussMarkov2(0.8, 20.0, 5.0),
    AutoRegressive((0.5, -0.3, 0.2), 0.7, 10.0),
    AutoRegressive((-0.9,), 0.7, 10.0),
]
DRAWN_ONCE = [Sinusoid(1.5, 0.37), RandomConstant(2.0), Ramp(0.1)]
EVERY = [*NOISY, *DRAWN_ONCE, White(0.3) + GaussMarkov(1.0, 2.0) + RandomWalk(0.3)]
AT_ANY_RATE = [p for p in EVERY if not isinstance(p, AutoRegressive)]
FAST = 0.02  # s; a second rate for what is compared with samples
AR_FAST = AutoRegressive((1.2, -0.5), 0.7, 1.0 / FAST)


def at_two_rates(processes):
    """Pairs of process and interval; an autoregressive process has one rate only."""
    slow = [(p, DT) for p in processes]
    fast = [(p, FAST) for p in processes if not isinstance(p, AutoRegressive)]
    return [pytest.param(p, dt, id=f"{p}-{dt:g}") for p, dt in [*slow, *fast, (AR_FAST, FAST)]]


def overlapping_allan(x: np.ndarray, m: int) -> np.ndarray:
    """Overlapping Allan variance of every column."""
    theta = np.cumsum(np.concatenate([np.zeros_like(x[:1]), x]), axis=0)
    difference = theta[2 * m :] - 2.0 * theta[m:-m] + theta[: -2 * m]
    return 0.5 * (difference**2).mean(axis=0) / m**2


def z_scores(columns: np.ndarray, expected: np.ndarray) -> np.ndarray:
    """Mean over the last axis less its expectation, in standard errors found from the scatter."""
    error = columns.std(axis=-1, ddof=1) / np.sqrt(columns.shape[-1])
    return (columns.mean(axis=-1) - expected) / error


# ------------------------------------------------------------------------------------------------- exact laws


@pytest.mark.parametrize("process", EVERY, ids=str)
def test_discrete_allan_variance_follows_from_the_covariance(process):
    """By its definition, from the covariance matrix of the samples."""
    n = 24
    C = process.sampled(DT).covariance(n)
    for m in (1, 2, 5, 12):
        w = np.concatenate([-np.ones(m), np.ones(m), np.zeros(n - 2 * m)]) / m
        np.testing.assert_allclose(
            process.discrete_allan_variance(m, DT), 0.5 * w @ C @ w, rtol=1e-11, atol=1e-13
        )  # rounding; the quadratic form cancels


@pytest.mark.parametrize("process", EVERY, ids=str)
def test_closed_allan_variances_are_those_of_the_states(process):
    m = np.array([[1, 2, 7], [100, 12345, 10**6]])
    got = process.discrete_allan_variance(m, DT)
    assert got.shape == m.shape
    scale = got.max()
    np.testing.assert_allclose(process.sampled(DT).allan_variance(m), got, rtol=1e-9, atol=1e-13 * scale)  # rounding
    if process in AT_ANY_RATE:
        np.testing.assert_allclose(
            process.state_space().allan_variance(m * DT), process.allan_variance(m * DT), rtol=1e-9, atol=1e-13 * scale
        )  # rounding


@pytest.mark.parametrize("process", NOISY, ids=str)
def test_closed_spectra_are_those_of_the_states(process):
    f = np.array([-0.3, 0.02, 1.7, 4.9])
    np.testing.assert_allclose(process.sampled(DT).psd(f), process.discrete_psd(f, DT), rtol=1e-12)  # rounding
    if process in AT_ANY_RATE and not isinstance(process, Quantisation):
        np.testing.assert_allclose(process.state_space().psd(f), process.psd(f), rtol=1e-12)  # rounding


@pytest.mark.parametrize("process", [p for p in NOISY if not isinstance(p, RandomWalk)], ids=str)
def test_discrete_spectrum_integrates_to_the_variance(process):
    area = 2.0 * quad(lambda f: process.discrete_psd(f, DT), 0.0, 5.0, epsrel=1e-11, limit=400)[0]
    assert area == pytest.approx(process.sampled(DT).covariance(1)[0, 0], rel=1e-9)  # quadrature


@pytest.mark.parametrize("process", [p for p in NOISY if isinstance(p, GaussMarkov2)], ids=str)
def test_second_order_spectrum_integrates_to_the_variance(process):
    area = 2.0 * quad(process.psd, 0.0, np.inf, epsrel=1e-11, limit=800)[0]
    assert area == pytest.approx(0.8**2, rel=1e-8)  # quadrature


@pytest.mark.parametrize("zeta", [0.02, 0.7, 1.0 - 1e-9, 1.0, 1.0 + 1e-9, 1.5, 30.0])
def test_second_order_covariance_is_exact(zeta):
    process = GaussMarkov2(0.8, 3.0, zeta)
    lag = DT * np.abs(np.subtract.outer(np.arange(40), np.arange(40)))
    np.testing.assert_allclose(process.sampled(DT).covariance(40), process.autocovariance(lag), atol=1e-12)  # rounding


def test_critically_damped_is_brown_and_hwangs():
    t = np.linspace(0.0, 9.0, 19)
    expected = 0.8**2 * np.exp(-t) * (1.0 + t)
    np.testing.assert_allclose(GaussMarkov2(0.8, 1.0).autocovariance(t), expected, rtol=1e-14)  # rounding


def test_strong_damping_is_a_first_order_process():
    """x' = -(omega_0 / 2 zeta) x at times long against 1 / (2 zeta omega_0)."""
    slow, tau = GaussMarkov2(1.0, 1.0, 1000.0), 2000.0
    t = np.array([10.0, 2000.0, 6000.0])
    np.testing.assert_allclose(slow.autocovariance(t), np.exp(-t / tau), rtol=1e-5)  # first order in 1 / zeta^2
    np.testing.assert_allclose(slow.allan_variance(4e3), GaussMarkov(1.0, tau).allan_variance(4e3), rtol=1e-5)


def test_autoregressive_of_first_order_is_gauss_markov():
    a = np.exp(-DT / 3.0)
    ar, gm = AutoRegressive((a,), 1.7 * np.sqrt(1.0 - a * a), 1.0 / DT), GaussMarkov(1.7, 3.0)
    np.testing.assert_allclose(ar.autocovariance([0.0, 0.3, 7.0]), gm.autocovariance([0.0, 0.3, 7.0]), rtol=1e-12)
    m = np.array([1, 4, 100])
    np.testing.assert_allclose(ar.allan_variance(m * DT), gm.discrete_allan_variance(m, DT), rtol=1e-11)
    np.testing.assert_allclose(ar.psd([0.01, 3.0]), gm.discrete_psd([0.01, 3.0], DT), rtol=1e-11)  # all rounding


def test_autoregressive_of_second_order_is_yule_and_walkers():
    a, b = 0.6, -0.5
    got = AutoRegressive((a, b), 1.0, 10.0).autocovariance([0.0, 0.1, 0.2])
    r1 = a / (1.0 - b)
    variance = 1.0 / (1.0 - a * r1 - b * (a * r1 + b))
    np.testing.assert_allclose(got, variance * np.array([1.0, r1, a * r1 + b]), rtol=1e-13)  # rounding


@pytest.mark.parametrize("h", [1e-8, 1e-3, 0.4999, 0.5001, 1.0, 30.0, 1e4])
def test_point_samples_lie_above_the_continuous_allan_variance(h):
    process = GaussMarkov(2.0, 50.0)
    assert process.discrete_allan_variance(1, 50.0 * h) == pytest.approx(-4.0 * np.expm1(-h), rel=1e-12)  # rounding
    ratio = np.sqrt(process.discrete_allan_variance([1, 4], 5e-7) / process.allan_variance([5e-7, 2e-6]))
    assert ratio[0] == pytest.approx(np.sqrt(1.5), rel=1e-7)  # 22 %
    assert 1.0 < ratio[1] < 1.02


@pytest.mark.parametrize("h", [1e-9, 1e-4, 0.3, 0.9, 7.0, 400.0])
def test_gauss_markov_discretisation_against_its_closed_form(h):
    """Also with its integral: the chain of Flenniken's filters (digest, section 4.6), at any ratio of step and time."""
    sigma, tau = 1e-7, 20.0  # small, as in rad/s: the scale must not matter
    dt = h * tau
    system = GaussMarkov(sigma, tau).state_space()
    Phi, Qd = system.discrete(dt)
    np.testing.assert_allclose([Phi[0, 0], Qd[0, 0]], [np.exp(-h), -(sigma**2) * np.expm1(-2.0 * h)], rtol=1e-12)
    F = np.array([[-1.0 / tau, 0.0], [1.0, 0.0]])
    chain = type(system)(F, np.diag([system.Q[0, 0], 0.0]), [0.0, 1.0], np.zeros((2, 2)))
    Phi, Qd = chain.discrete(dt)
    assert Phi[1, 0] == pytest.approx(-tau * np.expm1(-h), rel=1e-12)
    assert Qd[1, 0] == pytest.approx(sigma**2 * tau * np.expm1(-h) ** 2, rel=1e-11)
    exact = sigma**2 * tau**2 * (2.0 * h + 2.0 * np.expm1(-h) - np.expm1(-h) ** 2)
    if h < 0.01:  # the closed form cancels: its leading terms
        exact = sigma**2 * tau**2 * (2.0 / 3.0 * h**3 - 0.5 * h**4)
    assert Qd[1, 1] == pytest.approx(exact, rel=1e-7)  # rounding, truncation


@pytest.mark.parametrize("zeta", [0.05, 1.0, 8.0])
@pytest.mark.parametrize("dt", [1e-6, 0.01, 1.0, 500.0])
def test_second_order_discretisation_keeps_the_steady_state(zeta, dt):
    system = GaussMarkov2(3.0, 0.7, zeta).state_space()
    Phi, Qd = system.discrete(dt)
    np.testing.assert_allclose(Phi @ system.P0 @ Phi.T + Qd, system.P0, rtol=1e-11, atol=1e-11)  # rounding
    assert np.linalg.eigvalsh(Qd).min() > -1e-15


@pytest.mark.parametrize("process", AT_ANY_RATE, ids=str)
def test_samples_do_not_depend_on_the_rate(process):
    """Exactly: every tenth point of 100 Hz is 10 Hz; for white noise and quantisation every mean of ten is."""
    fast, slow = process.sampled(0.01), process.sampled(0.1)
    if isinstance(process, White | Quantisation):
        A = np.kron(np.eye(6), np.full((1, 10), 0.1))
        C = A @ fast.covariance(60) @ A.T
        np.testing.assert_allclose(C, slow.covariance(6), rtol=1e-11, atol=1e-12)  # rounding
    else:
        C = fast.covariance(51)[::10, ::10] + (slow.R - fast.R) * np.eye(6)
        np.testing.assert_allclose(C, slow.covariance(6), rtol=1e-11, atol=1e-11)  # rounding


def test_models_put_their_states_side_by_side():
    a, b, c = GaussMarkov(1.0, 2.0), RandomWalk(0.3), White(0.2)
    system = (a + b + c + Quantisation(0.1)).state_space()
    assert system.F.shape == (2, 2)
    assert (system.white, system.rounding) == pytest.approx((0.2**2, 0.1**2))
    total = (a + b + c).sampled(DT).covariance(5)
    np.testing.assert_allclose(total, sum(p.sampled(DT).covariance(5) for p in (a, b, c)), rtol=1e-13)
    mixed = a + AutoRegressive((0.5,), 1.0, 10.0)
    assert mixed.sampled(DT).Phi.shape == (2, 2)
    empty = NoiseModel().sampled(DT)
    assert empty.H.shape == (0,)
    assert not empty.sample((5, 2), np.random.default_rng(0)).any()
    assert NoiseModel().state_space().allan_variance([1.0]) == 0.0


# ---------------------------------------------------------------------------------------------------- samples


@pytest.mark.thinned(2)
@pytest.mark.parametrize(("process", "dt"), at_two_rates(EVERY))
def test_covariance_of_samples(process, dt):
    """From the first sample on, at short and long lags, over an ensemble of columns."""
    n, columns = 41, 20_000
    x = process.sample((n, columns), dt, np.random.default_rng(31))[[0, 1, 2, 5, 40]]
    expected = process.sampled(dt).covariance(n)[np.ix_([0, 1, 2, 5, 40], [0, 1, 2, 5, 40])]
    variance = np.diag(expected)
    # of normal variables; the uniform ones and sines scatter less
    error = np.sqrt((np.outer(variance, variance) + expected**2) / columns)
    z = (x @ x.T / columns - expected) / np.where(error == 0.0, 1.0, error)
    assert np.abs(z).max() < SIGMAS
    assert np.abs(x.mean(axis=1)).max() < SIGMAS * np.sqrt(variance.max() / columns) + 1e-12


@pytest.mark.parametrize("process", EVERY, ids=str)
def test_the_states_draw_what_the_process_draws(process):
    """Two independent generators, one matrix: the states' own recursion against the expected covariance."""
    n, columns = 21, 20_000
    system = process.sampled(DT)
    x = system.sample((n, columns), np.random.default_rng(32))[[0, 1, 20]]
    expected = system.covariance(n)[np.ix_([0, 1, 20], [0, 1, 20])]
    variance = np.diag(expected)
    error = np.sqrt((np.outer(variance, variance) + expected**2) / columns)
    assert np.abs((x @ x.T / columns - expected) / np.where(error == 0.0, 1.0, error)).max() < SIGMAS


@pytest.mark.parametrize(("process", "dt"), at_two_rates([*NOISY, Sinusoid(1.5, 0.37), *EVERY[-1:]]))
def test_allan_variance_of_samples(process, dt):
    n, columns, m = 2**12, 40, np.array([1, 2, 4, 15, 60, 250])
    x = process.sample((n, columns), dt, np.random.default_rng(33))
    avar = np.stack([overlapping_allan(x, k) for k in m])
    expected = process.discrete_allan_variance(m, dt)
    if isinstance(process, Sinusoid):  # no scatter but that of the phase
        np.testing.assert_allclose(avar.mean(axis=1), expected, rtol=0.01, atol=1e-4)
    else:
        assert np.abs(z_scores(avar, expected)).max() < SIGMAS


@pytest.mark.parametrize(("process", "dt"), at_two_rates([p for p in NOISY if not isinstance(p, RandomWalk)]))
def test_welch_spectrum_of_samples(process, dt):
    """One-sided densities from SciPy are twice ours; a Hann window leaks little where the spectrum is smooth."""
    n, columns, segment = 2**13, 24, 512
    x = process.sample((n, columns), dt, np.random.default_rng(34))
    f, S = welch(x, fs=1.0 / dt, nperseg=segment, axis=0)
    bands = [slice(k, k + 16) for k in range(8, 240, 29)]
    got = np.stack([0.5 * S[b].mean(axis=0) for b in bands])
    # what a window of four bins does to the curvature of the density
    window = np.array([0.25, 1.0, 0.25]) / 1.5
    expected = [np.convolve(process.discrete_psd(f, dt), window, "same")[b].mean() for b in bands]
    relative = np.abs(got.mean(axis=1) / expected - 1.0)
    error = got.std(axis=1, ddof=1) / np.sqrt(columns) / expected
    assert (relative < SIGMAS * error + 0.01).all()  # statistical, 1 % leakage


@pytest.mark.parametrize("process", [p for p in AT_ANY_RATE if p not in DRAWN_ONCE], ids=str)
def test_block_means_of_a_fast_series_and_a_slow_series_agree(process):
    """100 Hz averaged to 10 Hz against 10 Hz: the same Allan variance, but for what point samples are known to add."""
    columns, n, m = 40, 2000, np.array([8, 40])
    fast = process.sample((10 * n, columns), 0.01, np.random.default_rng(35)).reshape(n, 10, columns).mean(axis=1)
    slow = process.sample((n, columns), 0.1, np.random.default_rng(36))
    a = np.stack([overlapping_allan(fast, k) for k in m])
    b = np.stack([overlapping_allan(slow, k) for k in m])
    given = process.discrete_allan_variance(10 * m, 0.01) - process.discrete_allan_variance(m, 0.1)
    if not isinstance(process, GaussMarkov) or process.tau > 0.1:
        np.testing.assert_allclose(given, 0.0, atol=0.05 * process.allan_variance(m * 0.1).max())
    assert np.abs(z_scores(a - b, given)).max() < SIGMAS


@pytest.mark.parametrize("dt", [0.01, 1.0])
def test_flicker_samples_are_flat_at_any_rate(dt):
    n = 5000
    m = np.array([1, 2, 3, 10, 100, 1000, 2500])
    made = Flicker(2e-4).approximation(n, dt)
    ratio = np.sqrt(made.discrete_allan_variance(m, dt)) / allan_minimum(2e-4)
    assert ratio[0] == pytest.approx(1.04, abs=0.005)  # stated accuracy
    np.testing.assert_allclose(ratio[1:], 1.0, atol=0.02)  # stated accuracy
    f = np.geomspace(1.0 / (n * dt), 0.5 / dt, 60)
    density = made.discrete_psd(f, dt) / Flicker(2e-4).psd(f)
    assert np.abs(density[f < 0.05 / dt] - 1.0).max() < 0.04  # stated accuracy
    assert np.abs(density - 1.0).max() < 0.14  # stated accuracy
    x = Flicker(2e-4).sample((n, 30), dt, np.random.default_rng(37))
    for k in (1, 10, 100):
        z = z_scores(overlapping_allan(x, k)[None], made.discrete_allan_variance(k, dt))
        assert np.abs(z).max() < SIGMAS


def test_ideal_flicker():
    B = 3.0
    np.testing.assert_allclose(Flicker(B).allan_variance([0.01, 1e5]), allan_minimum(B) ** 2, rtol=1e-14)  # rounding
    assert Flicker(B).discrete_allan_variance(7, 0.1) == pytest.approx(allan_minimum(B) ** 2)
    assert Flicker(B).psd(-2.0) == pytest.approx(B**2 / (4.0 * np.pi))
    # AVAR = 2 int S sin^4(pi f T) / (pi f T)^2 df; the cubic decay leaves 1e-6 beyond 400 lobes
    body = sum(
        quad(lambda u: np.sin(u) ** 4 / u**3, k * np.pi, (k + 1) * np.pi, epsabs=0, epsrel=1e-10)[0] for k in range(400)
    )
    assert 2.0 * B**2 / np.pi * body == pytest.approx(allan_minimum(B) ** 2, rel=1e-5)  # truncation
    states = Flicker(B).state_space()
    np.testing.assert_allclose(states.allan_variance(100.0), flicker(B).allan_variance(100.0), rtol=1e-10)
    assert len(Flicker(B, 0.1, 1e3).state_space().H) == 5
    assert len(Flicker(B, longest=0.5).state_space().H) == len(Flicker(B, 1e5).state_space().H) == 2


def test_covariance_propagated_with_the_states_is_that_of_samples():
    """Variance of an integrated signal: Lyapunov steps with Phi, Qd on one side, sums of samples on the other."""
    model = White(0.05) + GaussMarkov(0.2, 3.0) + RandomWalk(0.02) + flicker(0.05, 0.3, 30.0) + GaussMarkov2(0.1, 2.0)
    dt, n, columns = 0.02, 500, 3000
    system = model.sampled(dt)
    k = len(system.H)
    A = np.zeros((k + 1, k + 1))
    A[:k, :k], A[k, :k], A[k, k] = system.Phi, dt * system.H, 1.0
    Q = np.zeros_like(A)
    Q[:k, :k], Q[k, k] = system.Qd, system.R * dt**2
    P = np.zeros_like(A)
    P[:k, :k] = system.P0
    for _ in range(n):
        P = A @ P @ A.T + Q
    angle = model.sample((n, columns), dt, np.random.default_rng(38)).sum(axis=0) * dt
    assert abs(angle.var() / P[k, k] - 1.0) < SIGMAS * np.sqrt(2.0 / columns)
    # the sum is a rectangle rule for the terms that are points: within dt / T of the continuous integral
    F = np.zeros_like(A)
    F[:k, :k], F[k, :k] = model.state_space().F, system.H
    q = np.zeros_like(A)
    q[:k, :k], q[k, k] = model.state_space().Q, model.state_space().white
    start = np.zeros_like(A)
    start[:k, :k] = system.P0
    Phi, Qd = type(model.state_space())(F, q, np.eye(k + 1)[k], start).discrete(n * dt)
    assert (Phi @ start @ Phi.T + Qd)[k, k] == pytest.approx(P[k, k], rel=2e-3)  # discretisation


def test_quantisation_is_what_rounding_makes():
    """A rate in motion, rounded as increments: error with the variance, density and Allan variance of the process."""
    rng, q, dt, n = np.random.default_rng(39), 0.01, 0.1, 200_000
    true = rng.uniform(0.0, 1.0, n)
    error = (quantise_increments(true * dt, q) / dt) - true
    process = Quantisation(q / np.sqrt(12.0))
    assert error.var() == pytest.approx(process.variance(dt), rel=0.02)  # 4 standard errors
    for m in (1, 5, 50):
        assert overlapping_allan(error[:, None], m)[0] == pytest.approx(process.allan_variance(m * dt), rel=0.02)
    f = 0.01
    assert process.discrete_psd(f, dt) == pytest.approx(process.Q**2 * dt * (2.0 * np.pi * f) ** 2, rel=1e-4)


def test_drawn_once():
    rng = np.random.default_rng(40)
    x = RandomConstant(2.0).sample((4, 20_000), DT, rng)
    assert (x == x[0]).all()
    assert x[0].std() == pytest.approx(2.0, rel=SIGMAS / np.sqrt(40_000))
    np.testing.assert_array_equal(RandomConstant(2.0).psd([0.0, 1.0]), [np.inf, 0.0])
    np.testing.assert_allclose(Ramp(-0.3, fixed=True).sample((3, 2), DT, rng)[:, 1], [0.0, -0.03, -0.06])
    s = Sinusoid(1.5, 2.5).sample((5, 1000), DT, rng)  # four samples a period
    np.testing.assert_allclose(s[4], s[0], atol=1e-12)
    np.testing.assert_allclose(s[0] ** 2 + s[1] ** 2, 1.5**2)
    np.testing.assert_array_equal(Sinusoid(1.5, 2.5).psd([-2.5, 2.4]), [np.inf, 0.0])
    np.testing.assert_array_equal(Sinusoid(1.5, 7.5).discrete_psd([2.5, 7.5, 2.4], DT), [np.inf, np.inf, 0.0])
    assert Sinusoid(1.5, 10.0).discrete_allan_variance(3, DT) == 0.0  # always the same phase
    assert Sinusoid(1.5, 10.0).allan_variance(0.03) > 0.0


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: Quantisation(0.1).psd(1.0), "discrete_psd"),
        (lambda: AutoRegressive((1.0,), 1.0, 10.0), "inside the unit circle, got one of magnitude 1;"),
        (lambda: AutoRegressive((), 1.0, 10.0), "expected at least one"),
        (lambda: AutoRegressive((0.5,), 1.0, 10.0).sample(5, 0.01, np.random.default_rng(0)), "expected 0.1 s"),
        (lambda: AutoRegressive((0.5,), 1.0, 10.0).state_space(), "defined at its samples only"),
        (lambda: AutoRegressive((0.5,), 1.0, 10.0).allan_variance(0.15), "tau: expected whole multiples"),
        (lambda: AutoRegressive((0.5,), 1.0, 10.0).psd(6.0), "at most 5 Hz"),
        (lambda: GaussMarkov2(1.0, 0.0), "omega_0: expected one positive"),
        (lambda: GaussMarkov2(1.0, 1.0, 0.0), "zeta: expected one positive"),
        (lambda: Flicker(1.0, 10.0, 1.0), "longest: expected more than shortest"),
        (lambda: Flicker(1.0, -1.0), "shortest: expected one positive"),
        (lambda: Sinusoid(1.0, 0.0), "frequency: expected one positive"),
        (lambda: GaussMarkov(1.0, 1.0).discrete_allan_variance(0, 0.1), "m: expected whole numbers"),
        (lambda: GaussMarkov2(1.0, 1.0).discrete_allan_variance(1.5, 0.1), "m: expected a whole number"),
        (lambda: White(1.0).sampled(-0.1), "dt: expected one positive"),
        (lambda: Ramp(-1.0), "R: expected one finite number, not negative"),
    ],
)
def test_refusals(call, message):
    with pytest.raises(InputError, match=message):
        call()
