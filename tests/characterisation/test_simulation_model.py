"""What stands for a log in simulation where no sum of terms does."""

import numpy as np
import pytest

from schuler.characterisation import allan_deviation
from schuler.characterisation.fitting import Fit
from schuler.characterisation.moments import Moments
from schuler.characterisation.selection import Selection, select
from schuler.characterisation.simulation_model import simulation_model, terms_of_fit
from schuler.characterisation.spectrum import clean_spectrum
from schuler.sensors.noise import Coloured, GaussMarkov, GaussMarkov2, Process, RandomWalk, White

RATE = 20.0


def model_of(x: np.ndarray):
    """Selection, model and curve of a signal."""
    clean = clean_spectrum(x, RATE)
    curve = allan_deviation(x, RATE, taus="log", noise=0.0)
    octaves = allan_deviation(x, RATE, taus="octave", noise=0.0)
    m = np.round(octaves.tau * RATE).astype(np.int64)
    keep = m <= len(x) // 4
    chosen = select(Moments(m[keep], octaves.variance[keep], 1.0 / RATE, np.array([len(x)])))
    return chosen, simulation_model(chosen, clean, curve, 1.0 / RATE), curve


def ratio(model: Process, curve) -> np.ndarray:
    """Model over curve, deviations."""
    m = np.round(curve.tau * RATE).astype(np.int64)
    return np.sqrt(model.discrete_allan_variance(m, 1.0 / RATE)) / curve.deviation


def test_terms_that_describe_everything_stay_terms():
    x = (White(1.0) + GaussMarkov(1.0, 20.0)).sample(60_000, 1.0 / RATE, np.random.default_rng(1))
    chosen, model, _ = model_of(x)
    assert chosen.departure == 0.0
    assert not any(isinstance(term, Coloured) for term in model.terms)
    assert model == terms_of_fit(chosen.fit, 1.0 / RATE)


@pytest.mark.campaign
def test_a_resonance_has_its_measured_spectrum_and_the_rest_its_terms():
    """At short times the curve comes back within 2 % (statistical: it is one log's own spectrum), with K besides."""
    process = White(1.0) + RandomWalk(0.02) + GaussMarkov2(8.0, 2.0 * np.pi * 2.0, 0.1)
    chosen, model, curve = model_of(process.sample(200_000, 1.0 / RATE, np.random.default_rng(5)))
    assert chosen.shortest > 1
    kinds = [type(term) for term in model.terms]
    assert kinds[0] is Coloured
    assert RandomWalk in kinds
    short = curve.tau < 5.0
    np.testing.assert_allclose(ratio(model, curve)[short], 1.0, atol=0.02)


@pytest.mark.campaign
def test_an_angle_that_stays_bounded_is_no_sum_of_terms():
    """Its rate has less noise at long times than any term. The measured spectrum follows within 10 % up to a tenth of
    the log and 30 % to its end (the scatter of the curve itself is larger), where the terms are off by a factor."""
    angle = GaussMarkov(1.0, 3.0).sample(100_001, 1.0 / RATE, np.random.default_rng(6))
    angle += GaussMarkov2(0.3, 2.0 * np.pi * 0.7, 0.3).sample(100_001, 1.0 / RATE, np.random.default_rng(7))
    chosen, model, curve = model_of(np.diff(angle) * RATE)
    assert chosen.departure > 0.0 or chosen.shortest > 1
    off = np.abs(np.log(ratio(model, curve)))
    assert off[curve.tau < 500.0].max() < 0.1
    assert off[curve.tau < 1200.0].max() < 0.3


def test_a_departure_puts_the_whole_curve_into_the_spectrum():
    """Even with a model that is nonsense: the density is brought to the curve."""
    x = (White(1.0) + GaussMarkov(3.0, 20.0)).sample(60_000, 1.0 / RATE, np.random.default_rng(1))
    curve = allan_deviation(x, RATE, taus="log", noise=0.0)
    nonsense = Selection(Fit(("N",), np.array([7.0]), np.eye(1), 1e6, 5), (), 1, 0.3, False)
    model = simulation_model(nonsense, clean_spectrum(x, RATE), curve, 1.0 / RATE)
    assert [type(term) for term in model.terms] == [Coloured]
    off = np.abs(np.log(ratio(model, curve)))
    assert off[curve.tau < 500.0].max() < 0.1  # beyond, the curve's own scatter is too sharp for any spectrum
    assert np.median(off) < 0.02
    with_terms = np.abs(np.log(ratio(terms_of_fit(nonsense.fit, 1.0 / RATE), curve)))
    assert np.median(with_terms) > 0.3


def test_a_log_too_short_for_a_spectrum_has_terms_only():
    x = White(1.0).sample(2000, 1.0 / RATE, np.random.default_rng(1))
    assert clean_spectrum(x, RATE) is None
    nonsense = Selection(Fit(("N",), np.array([7.0]), np.eye(1), 1e6, 5), (), 1, 0.3, False)
    curve = allan_deviation(x, RATE, taus="log", noise=0.0)
    assert simulation_model(nonsense, None, curve, 1.0 / RATE).terms == (White(7.0),)
