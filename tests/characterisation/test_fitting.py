"""Fits of noise terms to Allan variances: closed forms, derivatives, coverage of the intervals."""

import numpy as np
import pytest

from schuler.characterisation import fitting, moments
from schuler.characterisation.fitting import NoFitError, fit, parameter_names, parse_terms
from schuler.characterisation.moments import Moments
from schuler.characterisation.variance import allan_variances, integrate_signal
from schuler.exceptions import InputError
from schuler.sensors.noise import Flicker, GaussMarkov, Process, Quantisation, Ramp, RandomWalk, White

DT = 0.1
PROCESSES = {"Q": Quantisation, "N": White, "B": Flicker, "K": RandomWalk, "R": Ramp}


def measured(process: Process, n: int, rng: np.random.Generator) -> Moments:
    """Allan variances at octaves of one realisation."""
    m = 2 ** np.arange(int(np.log2(n / 4)) + 1)
    variance, _ = allan_variances(integrate_signal(process.sample(n, DT, rng), "rate", DT), "overlapping", m)
    return Moments(m, variance, DT, np.array([n]))


def model_of(names: tuple[str, ...], values: np.ndarray) -> Process:
    """The same model from sensors.noise."""
    value = dict(zip(names, values, strict=True))
    terms = [PROCESSES[n](v) for n, v in value.items() if n in PROCESSES]
    terms += [GaussMarkov(v, value["tau" + n[5:]]) for n, v in value.items() if n.startswith("sigma")]
    return sum(terms[1:], terms[0])


@pytest.mark.parametrize("text", ["Q+N+B+K+R", "N+GM", "N+K+2GM", "N+B+GM"])
def test_the_model_is_that_of_the_processes(text):
    """Allan variance and spectrum here and in sensors.noise are written twice; Gauss-Markov as point samples, the
    others as they are known for long averaging times: discretisation 0.1 % from 30 samples on."""
    names = parameter_names(parse_terms(text))
    values = np.array(
        [
            {"Q": 0.02, "N": 0.3, "B": 0.1, "K": 0.01, "R": 1e-4}.get(
                n, 0.2 if n[0] == "s" else 7.0 * int(n[4:] or 1) if n[0] == "t" else 0
            )
            for n in names
        ]
    )
    process = model_of(names, values)
    m = np.array([32, 100, 1000, 30_000])
    got, _ = fitting.allan_variance(names, values, m, DT)
    np.testing.assert_allclose(got, process.discrete_allan_variance(m, DT), rtol=1e-3)
    stationary = text.replace("+R", "")
    if stationary == text and "B" not in text:
        f = np.geomspace(1e-4, 0.5 / DT * (1 - 1e-9), 50)
        np.testing.assert_allclose(
            fitting.spectrum(names, values, DT, f), process.discrete_psd(f, DT), rtol=1e-6
        )  # rounding


@pytest.mark.parametrize("step", [1e-9, 1e-4, 9e-4, 1.1e-3, 0.1, 3.0])
def test_sampled_gauss_markov_at_any_speed(step):
    """Slow and fast formulas meet: 1e-6 where the slow one is a series, rounding elsewhere."""
    m = np.array([1, 2, 16, 1024, 2**20])
    exact = GaussMarkov(1.0, 1.0).discrete_allan_variance(m, step)
    np.testing.assert_allclose(fitting.sampled_gauss_markov(m, step), exact, rtol=2e-3 if step < 1e-3 else 1e-6)


def test_filtered_white_noise_is_white_noise_in_the_long_run():
    """Discretisation 1 % at 300 time constants."""
    m = np.array([1000, 10_000])
    filtered, _ = fitting.allan_variance(("N", "tau_N"), np.array([0.3, 0.3]), m, DT)
    np.testing.assert_allclose(filtered, 0.3**2 / (m * DT), rtol=0.01)


@pytest.mark.parametrize("text", ["Q+N+B+K+R", "N+F+K", "N+K+2GM"])
def test_derivatives_are_the_numerical_ones(text):
    """Central differences of logarithmic steps of 1e-5: 1e-7 of discretisation and rounding."""
    names = parameter_names(parse_terms(text))
    rng = np.random.default_rng(3)
    values = np.exp(rng.uniform(-2.0, 1.0, len(names)))
    m = 2 ** np.arange(14)
    v, J = fitting.allan_variance(names, values, m, DT)
    h = 1e-5
    for i in range(len(names)):
        up, down = values.copy(), values.copy()
        up[i] *= np.exp(h)
        down[i] *= np.exp(-h)
        numeric = (fitting.allan_variance(names, up, m, DT)[0] - fitting.allan_variance(names, down, m, DT)[0]) / (
            2 * h
        )
        np.testing.assert_allclose(J[:, i], numeric, rtol=1e-5, atol=1e-7 * v.max(), err_msg=names[i])


def test_flicker_has_the_density_of_its_definition():
    f = np.array([1e-3, 0.1])
    np.testing.assert_allclose(fitting.spectrum(("B",), np.array([0.2]), DT, f), Flicker(0.2).psd(f), rtol=1e-12)


def test_a_curve_of_expected_logarithms_is_fitted_exactly():
    """The logarithm of an estimate with few degrees of freedom is low in the mean; a curve that is low by just that has
    its model's parameters, to the 1e-7 at which the fit stops."""
    from scipy.special import digamma

    names, values = ("N", "B", "K"), np.array([1.0, 0.2, 0.01])
    m, n = 2 ** np.arange(16), np.array([2**17])
    v, _ = fitting.allan_variance(names, values, m, DT)
    edf = moments.degrees_of_freedom(m, n, DT, lambda f: fitting.spectrum(names, values, DT, f))
    assert edf.min() < 4.0
    low = v * np.exp(digamma(0.5 * edf) - np.log(0.5 * edf))
    solution = fit(Moments(m, low, DT, n), parse_terms("N+B+K"))
    np.testing.assert_allclose(solution.values, values, rtol=1e-4)
    assert solution.misfit < 1e-4


CASES = {
    "N+K": (White(1.0) + RandomWalk(0.02), {"N": 1.0, "K": 0.02}),
    "N+B": (White(1.0) + Flicker(0.1), {"N": 1.0, "B": 0.1}),
    "N+GM": (White(1.0) + GaussMarkov(0.3, 60.0), {"N": 1.0, "sigma_1": 0.3, "tau_1": 60.0}),
    "N+K+GM": (
        White(1.0) + GaussMarkov(0.3, 30.0) + RandomWalk(0.01),
        {"N": 1.0, "K": 0.01, "sigma_1": 0.3, "tau_1": 30.0},
    ),
    "N+B+K": (White(1.0) + Flicker(0.1) + RandomWalk(0.02), {"N": 1.0, "B": 0.1, "K": 0.02}),
}


def campaign(text: str, runs: int, n: int, weights: str = "full") -> tuple[dict[str, np.ndarray], np.ndarray, int]:
    """Normalised errors of every parameter, misfit over freedom, and how often there was no fit."""
    process, true = CASES[text]
    rng = np.random.default_rng(sum(map(ord, text)))
    z: dict[str, list[float]] = {k: [] for k in true}
    misfit, failed = [], 0
    for _ in range(runs):
        data = measured(process, n, rng)
        try:
            solution = fit(data, parse_terms(text), weights)  # type: ignore[arg-type]
        except NoFitError:
            failed += 1
            continue
        misfit.append(solution.misfit / solution.freedom)
        for name, value, sigma in zip(solution.names, solution.values, solution.sigma, strict=True):
            z[name].append(np.log(value / true[name]) / sigma)
    return {k: np.array(v) for k, v in z.items()}, np.array(misfit), failed


def binomial(share: float, runs: int) -> float:
    """Three standard errors of a share."""
    return 3.0 * float(np.sqrt(share * (1.0 - share) / runs))


@pytest.mark.parametrize("text", ["N+K", pytest.param("N+GM", marks=pytest.mark.campaign)])
def test_intervals_hold_what_they_promise(text):
    """Statistical, 80 logs: 95 % intervals cover 90 to 98 % within three standard errors of that many."""
    z, misfit, failed = campaign(text, 80, 20_000)
    assert failed <= 2
    for name, values in z.items():
        cover = np.mean(np.abs(values) < 1.96)
        assert cover > 0.90 - binomial(0.90, len(values)), name
        assert abs(values.mean()) < 0.5, name  # no bias worth half a sigma
    assert abs(misfit.mean() - 1.0) < 0.2


@pytest.mark.slow
@pytest.mark.parametrize("weights", ["full", "diagonal"])
@pytest.mark.parametrize("text", list(CASES))
def test_coverage_of_500_logs(text, weights):
    """95 % intervals of N, B, K, GM parameters cover 90 to 98 % (statistical: two standard errors of 500 on top)."""
    runs = 500
    # long enough for every term to show in nearly every log: where it does not, what is left is a selection
    z, misfit, failed = campaign(text, runs, 40_000 if text.count("+") == 1 else 200_000, weights)
    report = {name: float(np.mean(np.abs(v) < 1.96)) for name, v in z.items()}
    print(text, weights, report, "no fit:", failed, "misfit/freedom:", misfit.mean().round(3))
    assert failed < 0.02 * runs
    for name, cover in report.items():
        assert 0.90 - 0.027 < cover < 0.98 + 0.013, name
    if weights == "full":  # with diagonal ones it is no chi-square
        assert abs(misfit.mean() - 1.0) < 0.15


def test_the_covariance_of_diagonal_weights_is_honest_and_larger():
    rng = np.random.default_rng(8)
    data = measured(White(1.0) + RandomWalk(0.02), 40_000, rng)
    full, diagonal = fit(data, parse_terms("N+K")), fit(data, parse_terms("N+K"), "diagonal")
    assert np.all(diagonal.sigma >= full.sigma * 0.99)
    assert np.all(np.abs(np.log(full.values / diagonal.values)) < 3.0 * diagonal.sigma)


def test_two_gauss_markov_terms_come_in_order_of_their_times():
    rng = np.random.default_rng(11)
    data = measured(White(0.3) + GaussMarkov(0.3, 300.0) + GaussMarkov(0.3, 3.0), 100_000, rng)
    solution = fit(data, parse_terms("N+2GM"))
    assert solution.names == ("N", "sigma_1", "tau_1", "sigma_2", "tau_2")
    assert solution.values[2] < solution.values[4]
    np.testing.assert_array_less(np.abs(np.log(solution.values / [0.3, 0.3, 3.0, 0.3, 300.0])), 3.5 * solution.sigma)


def test_terms_that_are_not_there_are_no_fit_or_not_seen():
    """In white noise alone the others run to zero, or chance gives them a little that is not told from zero."""
    rng = np.random.default_rng(2)
    refused = 0
    for _ in range(10):
        try:
            solution = fit(measured(White(1.0), 20_000, rng), parse_terms("N+B+K+GM"))
        except NoFitError:
            refused += 1
        else:
            assert solution.sigma.max() > 0.5
    assert refused >= 5


def test_more_parameters_than_moments():
    data = Moments(np.array([1, 2]), np.array([1.0, 0.5]), DT, np.array([100]))
    with pytest.raises(NoFitError, match="5 parameters cannot be fitted to 2"):
        fit(data, parse_terms("N+2GM"))


@pytest.mark.parametrize("text", ["N+X", "N+N", "", "0GM", "2N", "F+K", "N++K"])
def test_models_that_mean_nothing(text):
    with pytest.raises(InputError, match="models: "):
        parse_terms(text)


def test_terms_come_in_one_order():
    assert parse_terms("2GM + K+N") == ("N", "K", "GM", "GM")
    assert parameter_names(parse_terms("K+F+N+GM")) == ("N", "tau_N", "K", "sigma_1", "tau_1")
