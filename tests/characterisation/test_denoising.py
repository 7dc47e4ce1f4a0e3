"""Wavelet transform by its laws; de-noising helps samples and not bias estimates, by how much is measured."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from schuler.characterisation.denoising import choose_level, decompose, denoise, recompose
from schuler.exceptions import InputError
from schuler.sensors import GaussMarkov, White

WAVELETS = ("haar", "db2")
MODEL = White(0.0237) + GaussMarkov(0.054, 1171.0)  # AQRS-104 in deg/s


@settings(max_examples=40, deadline=None)
@given(st.integers(0, 7), st.integers(1, 5), st.sampled_from(WAVELETS), st.integers(0, 2**32 - 1))
def test_what_was_split_is_put_together_again(level, factor, wavelet, seed):
    """Perfect reconstruction and the same energy; rounding."""
    x = np.random.default_rng(seed).standard_normal(factor * 2**level)
    parts = decompose(x, level, wavelet)
    assert [len(p) for p in parts] == [len(x) >> level] + [len(x) >> k for k in range(level, 0, -1)]
    np.testing.assert_allclose(recompose(parts, wavelet), x, atol=1e-12)
    assert sum(float(p @ p) for p in parts) == pytest.approx(float(x @ x), rel=1e-12)


def test_haar_is_sums_and_differences():
    rest, detail = decompose([1.0, 3.0, 5.0, 9.0], 1, "haar")
    np.testing.assert_allclose(rest, np.array([4.0, 14.0]) / np.sqrt(2.0))
    np.testing.assert_allclose(np.abs(detail), np.array([2.0, 4.0]) / np.sqrt(2.0))


def test_daubechies_does_not_see_straight_lines():
    """Two vanishing moments: a line has no details but where the period closes; the Haar wavelet sees its slope."""
    line = np.arange(64.0)
    for detail in decompose(line, 2)[1:]:
        assert np.abs(detail[:-2]).max() < 1e-12  # rounding
    assert np.abs(decompose(line, 2, "haar")[-1]).min() > 0.1


def test_white_noise_spreads_evenly_over_the_bands():
    """Every coefficient has the variance of a sample; 4 standard errors."""
    for part in decompose(np.random.default_rng(1).standard_normal(2**14), 5):
        assert part.var() == pytest.approx(1.0, abs=4 * np.sqrt(2.0 / len(part)))


def test_shifting_scaling_and_a_constant():
    """The threshold follows the noise; a constant passes untouched."""
    x = MODEL.sample(3001, 0.1, np.random.default_rng(2))
    a, b = denoise(x, 10.0, 5), denoise(100.0 + 3.0 * x, 10.0, 5)
    np.testing.assert_allclose(b.x, 100.0 + 3.0 * a.x, atol=1e-10)
    assert b.sigma == pytest.approx(3.0 * a.sigma)


def test_details_are_shrunk_softly():
    """Toward zero by the threshold, none below it left: Haar, and a length that is its own period's half."""
    x = MODEL.sample(1024, 0.1, np.random.default_rng(8))
    x[500:] += 3.0  # something large for the details to hold
    d = denoise(x, 10.0, 4, wavelet="haar")
    threshold = d.sigma * np.sqrt(2.0 * np.log(1024))
    for before, after in zip(decompose(x, 4, "haar")[1:], decompose(d.x, 4, "haar")[1:], strict=True):
        np.testing.assert_allclose(after, np.sign(before) * np.maximum(np.abs(before) - threshold, 0.0), atol=1e-12)
    assert any(np.abs(part).max() > 0.1 for part in decompose(d.x, 4, "haar")[1:])


def test_sigma_is_that_of_the_white_noise():
    """0.0237 sqrt(10 Hz), whatever the bias does; 4 standard errors of a median of 2^15 values (1.17 times larger than
    of a mean square)."""
    x = MODEL.sample(2**16, 0.1, np.random.default_rng(3))
    expected = 0.0237 * np.sqrt(10.0)
    assert denoise(x, 10.0, 4).sigma == pytest.approx(expected, rel=4 * 1.17 / np.sqrt(2**15))


def test_samples_get_better_and_bias_estimates_do_not():
    """3 h of the AQRS: samples scatter 40 to 65 % less (literature: 34 to 63 %), 9 min means just the same."""
    x = MODEL.sample(108000, 0.1, np.random.default_rng(4))
    for level in (4, 6, 8):
        d = denoise(x, 10.0, level)
        assert 0.4 < 1.0 - d.std[1] / d.std[0] < 0.65
        assert d.wander[1] == pytest.approx(d.wander[0], rel=0.01)
        assert d.mean[1] == pytest.approx(d.mean[0], abs=1e-4)
        assert d.average_s == pytest.approx(540.0)
    assert d.cutoff_hz == pytest.approx(10.0 / 2**9)
    assert "of means over 540 s" in d.summary()


@pytest.mark.parametrize("sigma_b", [0.02, 0.054, 0.2])
def test_the_level_ends_where_the_bias_begins(sigma_b):
    """White noise of the slow rest, N sqrt(rate / 2^level), has come down to about the bias; a law, to 1.5 octaves."""
    x = (White(0.0237) + GaussMarkov(sigma_b, 1171.0)).sample(2**17, 0.1, np.random.default_rng(5))
    level = choose_level(x)
    # less than 5 % to gain: a further level takes half the white variance, w/2 < 0.0975 (w + b)
    white = 0.0237**2 * 10.0
    equal = max(1.0, np.log2(white / (0.0975 / 0.4025 * (x.var() - white))))
    assert level == pytest.approx(equal, abs=1.5)


def test_white_noise_alone_takes_all_levels():
    assert choose_level(np.random.default_rng(6).standard_normal(4096)) >= 8
    assert choose_level(np.cumsum(np.random.default_rng(7).standard_normal(4096))) == 1


@pytest.mark.parametrize("n", [64, 100, 257, 1001])
def test_any_length(n):
    d = denoise(np.random.default_rng(n).standard_normal(n), 1.0, 3)
    assert d.x.shape == (n,)


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: decompose(np.ones(10), 2), r"expected a multiple of 2\*\*level samples, got 10 samples and level 2"),
        (lambda: decompose(np.ones(8), 1, "db8"), "wavelet: expected one of haar, db2, got 'db8'"),
        (lambda: denoise(np.ones(10), 1.0), "x: expected 64 samples or more, got 10"),
        (lambda: denoise(np.full(100, np.nan), 1.0), "expected finite numbers"),
        (lambda: denoise(np.ones(100), 0.0), "rate_hz: expected a positive number"),
        (lambda: denoise(np.arange(100.0), 1.0, 9), "level: expected 1 to 3 for 100 samples, got 9"),
        (lambda: denoise(np.arange(100.0), 1.0, 2, average_s=80.0), "average_s: expected between one sample and half"),
        (lambda: choose_level(np.ones(5)), "x: expected 16 samples or more"),
    ],
)
def test_what_cannot_be_done_is_said(call, message):
    with pytest.raises(InputError, match=message):
        call()
