"""Correlators and discriminators of the tracking study: closed forms, then Monte Carlo in standard errors."""

import numpy as np
import pytest

from schuler.exceptions import InputError
from schuler.reproduce.stefanisko.study.deep import correlator as co
from schuler.reproduce.stefanisko.study.deep import discriminators as ts
from schuler.reproduce.stefanisko.study.deep.correlator import Correlator

SIGNAL = co.GPS_CA
BIT, HALF = SIGNAL.bit, 0.5 * SIGNAL.bit
ROUNDING = 1e-12
SPREAD = 4.5  # standard errors: 1 in 150 000 by chance, some dozens of comparisons, seeds fixed


def test_lengths_of_the_signal():
    assert pytest.approx(293.05, abs=0.01) == SIGNAL.chip  # printed digits, Groves (2013)
    assert pytest.approx(0.1903, abs=1e-4) == SIGNAL.wavelength


@pytest.mark.parametrize("f", [0.0, 7.0, 44.3, 100.0, 130.0])
def test_a_frequency_error_costs_a_sinc(f):
    assert co.coherence(f, HALF) == pytest.approx(np.sinc(f * HALF), abs=ROUNDING)
    if f == 44.3:  # half the power at 0.443 / tau
        assert abs(co.coherence(f, HALF)) ** 2 == pytest.approx(0.5, abs=1e-3)


@pytest.mark.parametrize("flip", [0.0, 0.2, 0.5, 0.9, 1.0])
@pytest.mark.parametrize("f", [0.0, 13.0, -40.0])
def test_a_data_bit_that_changes_is_the_integral(f, flip):
    nodes, weights = np.polynomial.legendre.leggauss(40)

    def integral(a, b):
        t = 0.5 * (a + b) + 0.5 * (b - a) * nodes
        return 0.5 * (b - a) * np.sum(weights * np.exp(2j * np.pi * f * t))

    edge = (flip - 0.5) * BIT
    by_hand = (integral(-0.5 * BIT, edge) - integral(edge, 0.5 * BIT)) / BIT
    assert co.coherence(f, BIT, flip) == pytest.approx(by_hand, abs=ROUNDING)


def test_a_bit_that_changes_in_the_middle_leaves_nothing():
    taps = co.expected_taps(Correlator(), 1e4, 0.0, tau=BIT, flip_at=0.5)
    assert abs(taps.prompt) < ROUNDING * 20.0


def test_two_halves_are_the_whole():
    """Phase runs on from one half to the next: a coherent sum is the accumulation over both."""
    c, e, rate = 3e3, 40.0, 3.1
    cor = Correlator()
    halves = [co.expected_taps(cor, c, e + s * rate, rate, tau=HALF, phase=0.4) for s in (-0.5 * HALF, 0.5 * HALF)]
    whole = co.expected_taps(cor, c, e, rate, tau=BIT, phase=0.4)
    both = halves[0].followed_by(halves[1])
    assert both.prompt == pytest.approx(whole.prompt, rel=1e-3)  # the code moves by 3 cm between the halves
    with_code_still = Correlator(co.Signal("long chips", 1e12, SIGNAL.wavelength, BIT))
    halves = [co.expected_taps(with_code_still, c, s * rate, rate, tau=HALF) for s in (-0.5 * HALF, 0.5 * HALF)]
    whole = co.expected_taps(with_code_still, c, 0.0, rate, tau=BIT)
    assert halves[0].followed_by(halves[1]).prompt == pytest.approx(whole.prompt, rel=ROUNDING)


@pytest.mark.parametrize("spacing", [0.1, 0.5, 1.0])
def test_noise_of_the_taps_is_correlated_as_the_code(spacing, rng):
    n = 200_000
    zero = co.Taps(*(np.zeros(n, dtype=complex),) * 3)
    taps = co.noisy(zero, Correlator(spacing=spacing), rng)
    z = np.stack((taps.early, taps.prompt, taps.late))
    expected = co.tap_covariance(spacing)
    for part in (z.real, z.imag):
        cov = part @ part.T / n
        error = np.sqrt((1.0 + expected**2) / n)
        assert np.all(np.abs(cov - expected) < SPREAD * error)
    assert np.all(np.abs(z.real @ z.imag.T / n) < SPREAD / np.sqrt(n))


@pytest.mark.parametrize("kind", ts.CODE_KINDS)
@pytest.mark.parametrize("spacing", [0.2, 0.5, 1.0])
def test_code_curves_are_those_of_the_taps(kind, spacing):
    """Whatever phase, data bit and power; odd; the slope is the derivative; zero beyond the outermost tap."""
    x = np.linspace(-1.8, 1.8, 73)
    taps = co.expected_taps(Correlator(spacing=spacing), 500.0, x * SIGNAL.chip, tau=BIT, phase=1.1, data=-1.0)
    result = ts.early_late_power(taps) if kind == "power" else ts.dot_product(taps)
    curve = ts.code_curve(kind, x, spacing)
    np.testing.assert_allclose(result, 2.0 * 500.0 * BIT * curve, atol=1e-11)
    np.testing.assert_allclose(curve, -curve[::-1], atol=ROUNDING)
    h = 1e-6
    slope = (ts.code_curve(kind, h, spacing) - ts.code_curve(kind, -h, spacing)) / (2.0 * h)
    # a corner of R lies at zero only for the prompt tap of the dot product: second order in h
    assert slope == pytest.approx(ts.code_slope(kind, spacing), rel=2e-6)
    assert np.all(curve[np.abs(x) > 1.0 + 0.5 * spacing] == 0.0)
    if kind == "power":
        # straight between the taps: 2 (2 - d) x
        within = np.abs(x) < 0.5 * spacing
        np.testing.assert_allclose(curve[within], 2.0 * (2.0 - spacing) * x[within], atol=ROUNDING)


def test_frequency_curve_is_that_of_the_halves():
    f = np.linspace(-120.0, 120.0, 97)
    first, second = (
        co.expected_taps(Correlator(), 800.0, s * f * SIGNAL.wavelength, f * SIGNAL.wavelength, tau=HALF).prompt
        for s in (-0.5 * HALF, 0.5 * HALF)
    )
    moved = co.code_correlation(0.5 * HALF * f * SIGNAL.wavelength / SIGNAL.chip) ** 2
    np.testing.assert_allclose(
        ts.cross_product(first, second), 2.0 * 800.0 * HALF * moved * ts.frequency_curve(f, HALF), atol=1e-11
    )
    h = 1e-4
    slope = (ts.frequency_curve(h, HALF) - ts.frequency_curve(-h, HALF)) / (2.0 * h)
    assert slope == pytest.approx(ts.frequency_slope(HALF), rel=1e-9)
    assert ts.frequency_curve(0.5 / HALF, HALF) == pytest.approx(0.0, abs=ROUNDING)


@pytest.mark.parametrize(
    ("kind", "printed"), [("power", lambda d, s: 2.0 / ((2.0 - d) * s)), ("dot", lambda d, s: 1.0 / s)]
)
def test_variances_at_zero_are_those_of_the_book(kind, printed):
    for spacing in (0.1, 0.5, 1.0):
        for cn0 in (10.0, 1e3, 1e5):
            s = cn0 * BIT
            expected = spacing / (4.0 * s) * (1.0 + printed(spacing, s))
            assert ts.code_variance(kind, cn0, BIT, spacing) == pytest.approx(expected, rel=ROUNDING)
    s = 300.0 * HALF
    expected = (1.0 + 0.5 / s) / (4.0 * np.pi**2 * HALF**2 * s)
    assert ts.frequency_variance(300.0, HALF) == pytest.approx(expected, rel=ROUNDING)


@pytest.mark.parametrize("kind", ts.CODE_KINDS)
@pytest.mark.parametrize("cn0_dbhz", [10.0, 20.0, 30.0, 45.0])
@pytest.mark.parametrize("x", [0.0, -0.2, 0.4])
def test_monte_carlo_of_means_and_variances(kind, cn0_dbhz, x):
    """Means and variances of both discriminators and of the power, in standard errors of the sample moments."""
    rng = np.random.default_rng([int(cn0_dbhz), int(10 * x) + 10, kind == "dot"])
    cor, c, n, rate = Correlator(spacing=0.5), float(co.ratio_from_dbhz(cn0_dbhz)), 60_000, 1.5
    out = ts.bit_outputs(cor, kind, c, np.full(n, x * SIGNAL.chip), rate, rng)
    f = rate / SIGNAL.wavelength
    kept = np.sinc(f * BIT) ** 2  # a frequency error lowers the C/N0 that the code sees
    code = ts.code_error(cor, kind, out.code, c) / SIGNAL.chip
    slope = ts.code_slope(kind, 0.5)
    variance = ts.code_variance(kind, c * kept, BIT, 0.5, x) * kept**2
    check_mean(code, kept * ts.code_curve(kind, x, 0.5) / slope, variance)
    check_variance(code, variance)
    at_prompt = co.code_correlation(x) ** 2
    hertz = ts.rate_error(cor, out.cross, c) / SIGNAL.wavelength
    variance = ts.frequency_variance(c * at_prompt, HALF, f) * at_prompt**2
    check_mean(hertz, at_prompt * ts.frequency_curve(f, HALF) / ts.frequency_slope(HALF), variance)
    check_variance(hertz, variance)
    power = 2.0 * c * BIT * kept * at_prompt
    check_mean(out.power, power + 2.0, 4.0 * power + 4.0)
    if x == 0.0:  # code and frequency together, both off, share the noise of the power
        assert abs(np.corrcoef(out.code, out.cross)[0, 1]) < SPREAD / np.sqrt(n)


def check_mean(sample, expected, variance):
    assert abs(sample.mean() - expected) < SPREAD * np.sqrt(variance / len(sample))


def check_variance(sample, variance):
    """Standard error from the sample's own fourth moment: products of Gaussian variables have heavier tails."""
    squares = (sample - sample.mean()) ** 2
    assert abs(squares.mean() - variance) < SPREAD * squares.std() / np.sqrt(len(sample))


@pytest.mark.parametrize("cn0_dbhz", [15.0, 25.0, 45.0])
def test_measured_cn0(cn0_dbhz, rng):
    c, n = co.ratio_from_dbhz(cn0_dbhz), 50_000
    out = ts.bit_outputs(Correlator(), "dot", c, np.zeros(n), 0.0, rng)
    power = 2.0 * c * BIT
    error = np.sqrt((4.0 * power + 4.0) / n) / (2.0 * BIT)
    assert abs(ts.measured_cn0(out.power.mean(), BIT) - c) < SPREAD * error


def test_exact_signals_give_exact_errors(rng):
    """Without noise, C/N0 known: early minus late power is straight, the cross product falls with the prompt power."""
    cor = Correlator()
    e, rate = np.array([-60.0, -1.0, 0.0, 2.0, 70.0]), np.array([0.01, -0.1, 0.0, 0.2, 0.0])
    out = ts.bit_outputs(cor, "power", 100.0, e, rate, rng, scale=0.0)
    seen = co.code_correlation(e / SIGNAL.chip) ** 2
    # the sine and the sinc of 1 Hz, and the code's 2 mm in a bit: below a per mille
    np.testing.assert_allclose(ts.code_error(cor, "power", out.code, 100.0), e, rtol=2e-3, atol=1e-12)
    np.testing.assert_allclose(ts.rate_error(cor, out.cross, 100.0), seen * rate, rtol=2e-3, atol=1e-12)
    np.testing.assert_allclose(ts.measured_cn0(out.power, BIT), 100.0 * seen, rtol=2e-3)


def test_decibels():
    assert co.ratio_from_dbhz([0.0, 10.0, 45.0]) == pytest.approx([1.0, 10.0, 31622.7766], rel=1e-9)


def test_refusals():
    with pytest.raises(InputError, match="spacing"):
        Correlator(spacing=1.5)
    with pytest.raises(InputError, match="tau"):
        co.expected_taps(Correlator(), 1.0, 0.0, tau=0.0)
    with pytest.raises(InputError, match="dot or power"):
        ts.code_slope("envelope", 0.5)
