"""Figures of pages: spectra of the span that is asked for, and nothing of what is too short."""

import json
from types import SimpleNamespace

import numpy as np
import pytest

from schuler import units
from schuler.calibration.result.result import Residuals
from schuler.exceptions import InputError
from schuler.recording.figures import log_content
from schuler.recording.recording import Metadata, Recording
from schuler.recording.series import ImuSeries
from schuler.studio.figures import calibration_figure, figure_document, span_figure, sphere_document
from schuler.studio.signals import View, channels


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


def test_poses_on_the_sphere_have_their_residuals():
    """Five faces up: the middle of the gap is the sixth; what is beyond 3 sigma has a colour of its own."""
    faces = np.vstack((np.eye(3), -np.eye(3)[:2]))
    value, sigma = np.array([0.01, -0.02, 0.0, 0.04, 0.02]), np.full(5, 0.01)
    labels = tuple(f"pose {k + 1}" for k in range(5))
    left = {
        "accel": Residuals(labels, value, sigma, "m/s^2", None, faces),
        "norm": Residuals((), value[:0], sigma[:0], ""),
    }
    document = json.loads(json.dumps(sphere_document(SimpleNamespace(residuals=left))))
    assert np.array_equal([pose["v"] for pose in document["poses"]], faces)
    assert [pose["role"] for pose in document["poses"]] == ["filtered"] * 3 + ["rejected", "filtered"]
    assert document["poses"][1]["text"] == "pose 2, accel: -0.02 m/s^2, -2.0 sigma"
    assert np.arccos(-document["gap"]["v"][2]) < np.radians(2.5)  # discretisation
    assert sphere_document(SimpleNamespace(residuals={})) == {"poses": []}


def test_counts_are_drawn_as_counts():
    """Neither a label of m/s^2 nor a factor of degrees for what has no unit yet."""
    t = np.arange(200) / 100.0
    readings = np.random.default_rng(1).integers(30000, 34000, (200, 6)).astype(np.float64)
    imu = ImuSeries(t, readings[:, :3], readings[:, 3:])
    for note, labels in (
        ("accel and gyro: raw counts, not SI; calibrate before any other use.", ("counts", "counts")),
        ("imu.csv: gyro: raw counts, not SI; calibrate before any other use.", ("m/s²", "counts")),
        ("", ("m/s²", "deg/s")),
    ):
        recording = Recording(imu=imu, metadata=Metadata(notes=(note,)))
        drawn = {channel.panel: channel for channel in channels(recording)}
        assert list(drawn) == [f"specific force [{labels[0]}]", f"angular rate [{labels[1]}]"]
        factor = 1.0 if labels[1] == "counts" else units.DEG
        assert np.array_equal(drawn[f"angular rate [{labels[1]}]"].samples.y, readings[:, 2] / factor)
        assert [panel.y_label for panel in log_content(recording).panels] == list(drawn)
        spectrum = span_figure(View("", recording, None, ()), "spectrum", 0.0, 2.0)
        assert [panel.y_label for panel in spectrum.panels] == [f"root density [{unit}/√Hz]" for unit in labels]


def test_what_is_too_short_or_unknown():
    assert figure_document(span_figure(seen(), "spectrum", 0.0, 0.2))["panels"] == []
    assert span_figure(View("", None, None, ()), "spectrum", 0.0, 1.0) is None
    with pytest.raises(InputError, match="spectrum or spectrogram"):
        span_figure(seen(), "colours", 0.0, 1.0)
    with pytest.raises(InputError, match="residuals, correlations"):
        calibration_figure(None, "colours")
