"""Figures of pages: spectra of the span that is asked for, and nothing of what is too short."""

import json

import numpy as np
import pytest

from schuler import units
from schuler.exceptions import InputError
from schuler.recording.recording import Recording
from schuler.recording.series import ImuSeries
from schuler.studio.figures import calibration_figure, figure_document, span_figure
from schuler.studio.signals import View


def seen(amplitude=0.1, rate=100.0):
    """A vibration of 20 Hz after the first 60 s of 120, on the y accelerometer."""
    rng = np.random.default_rng(2)
    t = 5.0 + np.arange(round(120.0 * rate)) / rate
    accel, gyro = rng.standard_normal((2, len(t), 3)) * np.array([1e-2, 1e-3])[:, None, None]
    accel[:, 1] += np.where(t >= 65.0, amplitude * np.sin(2.0 * np.pi * 20.0 * t), 0.0)
    return View("", Recording(imu=ImuSeries(t, gyro, accel)), None, ())


def test_a_line_stands_in_the_spectrum_of_its_span_alone():
    quiet, loud = (span_figure(seen(), "spectrum", *span) for span in ((0.0, 60.0), (60.0, 120.0)))
    for figure, ratio in ((quiet, (0.5, 2.0)), (loud, (5.0, np.inf))):
        line = next(item for item in figure.panels[0].items if item.label == "y")
        peak = line.y[np.argmin(np.abs(line.x - 20.0))] / np.median(line.y)
        assert ratio[0] < peak < ratio[1]
    # white noise is a level at its root density, here 1e-3 rad/s in 1/(100 Hz)
    level = np.median(next(item for item in quiet.panels[1].items if item.label == "x").y)
    assert level == pytest.approx(1e-3 / np.sqrt(100.0) / units.DEG, rel=0.1)  # statistical
    document = json.loads(json.dumps(figure_document(span_figure(seen(), "spectrogram", 60.0, 120.0))))
    assert len(document["panels"]) == 2


def test_what_is_too_short_or_unknown():
    assert figure_document(span_figure(seen(), "spectrum", 0.0, 0.2))["panels"] == []
    assert span_figure(View("", None, None, ()), "spectrum", 0.0, 1.0) is None
    with pytest.raises(InputError, match="spectrum or spectrogram"):
        span_figure(seen(), "colours", 0.0, 1.0)
    with pytest.raises(InputError, match="coverage"):
        calibration_figure(None, "colours")
