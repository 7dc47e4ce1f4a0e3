"""Figures of the reports and pictures of platforms as pages draw them: data for the scripts, colours by their roles."""

from __future__ import annotations

from typing import Any

import numpy as np

from schuler import units
from schuler.calibration.report.panels import OUTLIER, correlation_map, largest_gap, residuals
from schuler.calibration.result.result import CalibrationResult
from schuler.characterisation.report.spectra import log_spectra, log_spectrum
from schuler.exceptions import InputError
from schuler.plotting.figure import Figure
from schuler.plotting.interactive import panel_data
from schuler.recording.figures import shown_units, spectrogram_content
from schuler.rotary import gimbals
from schuler.rotary.report import cycle, projected
from schuler.rotary.schedule import Schedule
from schuler.studio.signals import View

_PLATFORM_FRAMES, _PLATFORM_DIGITS = 360, 4  # of one cycle of a platform
_CALIBRATION = {"residuals": residuals, "correlations": correlation_map}


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
    name : {"residuals", "correlations"}

    Raises
    ------
    InputError
        If there is no such figure.
    """
    if name not in _CALIBRATION:
        raise InputError(f"expected a figure out of {', '.join(_CALIBRATION)}, got {name!r}")
    return _CALIBRATION[name](result)


def sphere_document(result: CalibrationResult) -> dict[str, Any]:
    """Directions of a calibration's poses on a sphere for the script of the page, with what the fit leaves of each.

    Parameters
    ----------
    result : CalibrationResult

    Returns
    -------
    dict
        ``poses``, each with ``v``: where the reference pointed, a unit vector in body axes, ``role``: its colour,
        ``ring``: whether it is of the second condition, such as turns, and ``text``; ``gap``: the middle of the largest
        region without poses likewise. Without poses that have directions there are none.
    """
    poses: list[dict[str, Any]] = []
    shown = {name: r for name, r in result.residuals.items() if r.direction is not None and len(r.direction)}
    for i, (name, r) in enumerate(shown.items()):
        assert r.direction is not None
        for k, v in enumerate(r.direction):
            value, sigma = float(r.value[k]), float(r.sigma[k])
            role = "rejected" if abs(value) > OUTLIER * sigma else "filtered" if i == 0 else "read_off"
            sigmas = f", {value / sigma:+.1f} sigma" if sigma > 0.0 else ""
            text = f"{r.label[k]}, {name}: {value:+.3g} {r.unit}{sigmas}"
            poses.append({"v": v.tolist(), "role": role, "ring": i > 0, "text": text})
    if not poses:
        return {"poses": []}
    angle, where = largest_gap(np.array([pose["v"] for pose in poses]))
    text = f"middle of the largest gap, {angle / units.DEG:.0f} degrees from the nearest pose"
    return {"poses": poses, "gap": {"v": where.tolist(), "role": "unused", "text": text}}


def platform_document(schedule: Schedule, duration: float) -> dict[str, Any]:
    """Frames of one cycle for the script of the page.

    Parameters
    ----------
    schedule : Schedule
    duration : float
        Of the mission. [s]

    Returns
    -------
    dict
        ``name``; ``t`` [s]; ``C``: of each frame the attitude of the IMU in the vehicle, nine numbers by rows;
        ``axes``: of each frame the directions of the platform's axes, outermost first; ``view``: what forward, right
        and down of the vehicle are on the page, to the right, up and towards the viewer.
    """
    t = np.linspace(0.0, cycle(schedule, duration), _PLATFORM_FRAMES)
    angles = schedule.angles(t)
    axes = [
        gimbals.C_bs(schedule.axes[:k], angles[:, :k], np.eye(3)) @ schedule.axes[k] if k else
        np.broadcast_to(schedule.axes[0], (len(t), 3)) for k in range(len(schedule.axes))
    ]  # fmt: skip
    seen, depth = projected(np.eye(3))
    return {
        "name": schedule.name, "t": np.round(t, 3).tolist(),
        "C": np.round(schedule.C_bs(t).reshape(-1, 9), _PLATFORM_DIGITS).tolist(),
        "axes": np.round(np.stack(axes, axis=1), _PLATFORM_DIGITS).tolist(),
        "view": np.round(np.column_stack((seen, depth)), 6).tolist(),
    }  # fmt: skip


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
    shown = shown_units(seen.recording)
    return spectrogram_content(imu, zero, shown) if name == "spectrogram" else log_spectrum(log_spectra(imu), shown)
