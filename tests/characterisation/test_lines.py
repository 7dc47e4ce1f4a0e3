"""Sines are found with their frequency and amplitude, noise of any colour has none, and their variance is exact."""

import numpy as np
import pytest

from schuler.characterisation.allan import allan_deviation
from schuler.characterisation.identification import identify_noise
from schuler.characterisation.spectrum import Line, clean_spectrum
from schuler.recording.series import ImuSeries
from schuler.sensors.noise import Flicker, RandomWalk, White

RATE = 100.0


def lines_in(x, rate_hz):
    """Lines of a log, the strongest first."""
    spectrum = clean_spectrum(x, rate_hz)
    return () if spectrum is None else spectrum.lines


def sine(n, frequency, amplitude, phase=0.3):
    return amplitude * np.sin(2.0 * np.pi * frequency * np.arange(n) / RATE + phase)


@pytest.mark.parametrize("frequency", [3.3, 12.345, 25.0, 44.4])
def test_a_sine_in_white_noise_is_found(frequency):
    n, amplitude, sigma = 100_000, 2e-3, 1e-2
    noise = [np.random.default_rng(k).standard_normal(n) * sigma for k in range(8)]
    peaks = [lines_in(x + sine(n, frequency, amplitude), RATE) for x in noise]
    assert all(len(lines) == 1 for lines in peaks)
    resolution = RATE / 4096  # of a segment
    assert all(abs(lines[0].frequency - frequency) < 0.5 * resolution for lines in peaks)
    # statistical: amplitude of a sine in white noise sigma sqrt(2 / n) from the whole log; a spectrum of segments does
    # no better than three times that, since the bins around the line bring their own noise
    assert np.mean([lines[0].amplitude for lines in peaks]) == pytest.approx(amplitude, rel=0.03)
    assert np.std([lines[0].amplitude for lines in peaks]) < 3.0 * sigma * np.sqrt(2.0 / n)


def test_the_strongest_comes_first_and_missing_samples_do_not_matter():
    n = 100_000
    x = np.random.default_rng(1).standard_normal(n) * 1e-2 + sine(n, 7.0, 2e-3) + sine(n, 31.0, 5e-3)
    x[40_000:42_000] = np.nan
    assert [round(line.frequency, 1) for line in lines_in(x, RATE)] == [31.0, 7.0]


@pytest.mark.thinned(3)
@pytest.mark.parametrize("model", [White(1e-3), White(1e-3) + Flicker(1e-3), White(1e-3) + RandomWalk(1e-2)])
def test_clean_noise_has_no_lines(model):
    """One log in a thousand is allowed one; statistical: two of 50 happen once in a thousand tests."""
    rng = np.random.default_rng(2)
    assert sum(bool(lines_in(model.sample(20_000, 1.0 / RATE, rng), RATE)) for _ in range(50)) <= 1


def test_a_log_that_is_mostly_missing_or_short_has_no_lines():
    x = np.random.default_rng(3).standard_normal(60_000)
    x[600:59_000] = np.nan
    assert lines_in(x, RATE) == ()
    assert lines_in(x[:500], RATE) == ()


@pytest.mark.parametrize("frequency", [0.77, 13.7, 49.0])
def test_the_allan_variance_is_that_of_the_sampled_sine(frequency):
    n, m = 200_000, np.array([1, 2, 3, 7, 10, 33, 100])
    measured = allan_deviation(sine(n, frequency, 0.02), RATE, taus=m / RATE, noise=0.0).deviation ** 2
    line = Line(frequency, 0.02)
    # discretisation: the phases of the differences do not fill a circle evenly to the last period
    np.testing.assert_allclose(line.allan_variance(m, 1.0 / RATE), measured, rtol=2e-3, atol=1e-9)


@pytest.mark.campaign
def test_a_strong_line_does_not_spoil_the_noise():
    """Ten times the white noise at the averaging times near its period."""
    n, rng = 120_000, np.random.default_rng(4)
    x = (White(1e-3) + RandomWalk(1e-4)).sample((n, 6), 1.0 / RATE, rng)
    x[:, 1] += sine(n, 11.3, 1e-2)
    peaks = identify_noise(
        ImuSeries(np.arange(n) / RATE, x[:, :3], x[:, 3:] + [0.0, 0.0, -9.80665]), models=("N", "N+K", "N+GM")
    )
    axis = peaks.axes["gyro_y"]
    assert axis.terms["N"].low < 1e-3 < axis.terms["N"].high
    assert axis.terms["N"].value == pytest.approx(1e-3, rel=0.02)  # statistical, and what is left of the line
    (notices,) = [f for f in axis.findings if f.code == "lines"]
    assert "11.3 Hz" in notices.text
    assert not [f for name in ("gyro_x", "gyro_z") for f in peaks.axes[name].findings if f.code == "lines"]
    # the model has the line as a sine: the shortest averaging times of curve and model agree
    tau = axis.curve.tau[:12]
    np.testing.assert_allclose(axis.fitted(tau), axis.curve.deviation[:12], rtol=0.05)
