"""Figures of the reports as pages draw them: panels with traces and layouts for plotly, colours by their roles."""

from __future__ import annotations

from typing import Any

from schuler.calibration.report.panels import correlation_map, coverage, residuals
from schuler.calibration.result.result import CalibrationResult
from schuler.characterisation.report.spectra import log_spectra, log_spectrum
from schuler.exceptions import InputError
from schuler.plotting.figure import Figure
from schuler.plotting.interactive import panel_data
from schuler.recording.figures import spectrogram_content
from schuler.studio.signals import View

_CALIBRATION = {"coverage": coverage, "residuals": residuals, "correlations": correlation_map}


def figure_document(figure: Figure | None) -> dict[str, Any]:
    """Title, caption and panels of a figure for the script of the page; no panels of one that has nothing to show."""
    if figure is None:
        return {"title": "", "caption": "", "panels": []}
    panels = [{"title": panel.title, "height": panel.height, **panel_data(figure, panel)} for panel in figure.panels]
    return {"title": figure.title, "caption": figure.caption, "panels": panels}


def calibration_figure(result: CalibrationResult, name: str) -> Figure | None:
    """Figure of a calibration, None if it has nothing for it.

    Parameters
    ----------
    result : CalibrationResult
    name : {"coverage", "residuals", "correlations"}

    Raises
    ------
    InputError
        If there is no such figure.
    """
    if name not in _CALIBRATION:
        raise InputError(f"expected a figure out of {', '.join(_CALIBRATION)}, got {name!r}")
    return _CALIBRATION[name](result)


def span_figure(seen: View, name: str, start: float, stop: float) -> Figure | None:
    """Spectrum or spectrogram of the IMU over a span, None of a span too short for one.

    Parameters
    ----------
    seen : View
    name : {"spectrum", "spectrogram"}
    start, stop : float
        From the start of the recording. [s]

    Raises
    ------
    InputError
        If there is no such figure.
    """
    if name not in ("spectrum", "spectrogram"):
        raise InputError(f"expected spectrum or spectrogram, got {name!r}")
    if seen.recording is None or seen.recording.imu is None:
        return None
    zero = seen.recording.start
    imu = seen.recording.imu.between(zero + start, zero + stop)
    if len(imu) < 64:
        return None
    return spectrogram_content(imu, zero) if name == "spectrogram" else log_spectrum(log_spectra(imu))
