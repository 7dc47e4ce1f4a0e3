"""Power spectrum: conventions by closed forms, bounds by coverage."""

import numpy as np
import pytest

from schuler.characterisation.spectrum import power_spectrum
from schuler.exceptions import InputError
from schuler.sensors.noise import GaussMarkov, White


def test_white_noise_shows_its_two_sided_density():
    """N^2 at every frequency; mean over frequencies, 4 standard errors."""
    N, rate = 0.03, 50.0
    s = power_spectrum(White(N).sample(100_000, 1.0 / rate, np.random.default_rng(1)), rate, segment_s=20.0)
    assert np.mean(s.psd) == pytest.approx(N**2, rel=4.0 / np.sqrt(100_000 / 2))
    assert s.f[0] == pytest.approx(1.0 / 20.0)
    assert s.f[-1] < rate / 2.0
    assert s.segments == 199


def test_the_sum_is_the_variance():
    """Parseval: 2 sum psd df, and half of it at zero as at the first frequency, is the variance; 1.5 % statistical."""
    x = GaussMarkov(2.0, 0.5).sample(200_000, 0.01, np.random.default_rng(2))
    s = power_spectrum(x, 100.0, segment_s=100.0)
    assert (2.0 * np.sum(s.psd) + s.psd[0]) * (s.f[1] - s.f[0]) == pytest.approx(np.var(x), rel=0.015)


def test_gauss_markov_spectrum():
    """The closed form inside 4 standard errors of the estimate; below a tenth of the rate no aliasing."""
    process = GaussMarkov(1.5, 0.3)
    s = power_spectrum(process.sample(400_000, 0.01, np.random.default_rng(3)), 100.0, segment_s=40.0)
    band = (s.f > 0.1) & (s.f < 5.0)
    error = (s.psd / process.psd(s.f) - 1.0)[band]
    assert np.all(np.abs(error) < 5.0 * np.sqrt(2.0 / s.edf))
    assert abs(np.mean(error)) < 0.02


def test_bounds_cover():
    """Share of frequencies inside 95 % bounds over 40 records: 1 % (neighbouring frequencies depend on each other)."""
    rng = np.random.default_rng(4)
    inside = []
    for _ in range(40):
        s = power_spectrum(White(1.0).sample(4000, 1.0, rng), 1.0)
        inside.append(np.mean(((s.low < 1.0) & (s.high > 1.0))[2:]))
    assert s.segments == 15
    assert s.edf == pytest.approx(2 * 15 / (1.0 + 2.0 / 36.0 * 14.0 / 15.0))
    assert np.mean(inside) == pytest.approx(0.95, abs=0.01)


@pytest.mark.parametrize("n", [4000, 4001, 4007])
def test_odd_and_even_segments(n):
    s = power_spectrum(np.random.default_rng(5).standard_normal(n), 10.0, segment_s=17.1)
    assert np.all(s.psd > 0.0)
    assert np.all((s.low < s.psd) & (s.psd < s.high))
    assert 0.0 < s.f[0] < s.f[-1] < 5.0


@pytest.mark.parametrize(
    ("x", "options", "match"),
    [
        (np.r_[np.zeros(99), np.nan], {}, "NaN"),
        (np.zeros((100, 2)), {}, "shape"),
        (np.zeros(50), {}, "8 samples"),
        (np.zeros(100), {"segment_s": 200.0}, "up to the record"),
        (np.zeros(100), {"confidence": 95.0}, "between 0 and 1"),
    ],
)
def test_refusals(x, options, match):
    with pytest.raises(InputError, match=match):
        power_spectrum(x, 1.0, **options)
    with pytest.raises(InputError, match="rate_hz"):
        power_spectrum(np.zeros(100), -1.0)
