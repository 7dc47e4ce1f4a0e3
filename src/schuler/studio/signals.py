"""Signals of a recording as a page draws them: panels with curves, decimated for the width of a window."""

from __future__ import annotations

import math
import threading
from collections import OrderedDict
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from schuler import units
from schuler.arrays import FloatArray
from schuler.diagnosis.log import diagnose_log, read_leniently
from schuler.diagnosis.result import Diagnosis
from schuler.exceptions import InputError
from schuler.plotting.figure import TIME
from schuler.recording.figures import shown_units
from schuler.recording.recording import Recording
from schuler.studio.pyramid import Pyramid, envelope, pyramid

COLUMNS, MOST = 1200, 4000  # stretches of a window that is drawn
_KEPT = 4  # logs in memory
_AXES = ("axis_x", "axis_y", "axis_z")


@dataclass(frozen=True, eq=False)
class Channel:
    """One curve.

    Attributes
    ----------
    panel : str
        Label of the panel with its unit.
    name, role : str
        Legend and look, see :mod:`schuler.plotting.style`.
    t : ndarray, shape (n,)
        From the start of the recording. [s]
    samples : Pyramid
        In the unit of the panel.
    """

    panel: str
    name: str
    role: str
    t: FloatArray
    samples: Pyramid


@dataclass(frozen=True, eq=False)
class View:
    """A log that is looked at.

    Attributes
    ----------
    key : str
        By which pages ask for it.
    recording : Recording or None
        As leniently read as possible, None if nothing could be read.
    diagnosis : Diagnosis
        Of it.
    channels : tuple of Channel
    """

    key: str
    recording: Recording | None
    diagnosis: Diagnosis
    channels: tuple[Channel, ...]

    @property
    def span(self) -> tuple[float, float]:
        """First and last time that is drawn. [s]"""
        times = [(c.t[0], c.t[-1]) for c in self.channels]
        return (float(min(a for a, _ in times)), float(max(b for _, b in times))) if times else (0.0, 1.0)


@dataclass
class Views:
    """The logs that were looked at last."""

    kept: OrderedDict[str, View] = field(default_factory=OrderedDict)
    guard: threading.Lock = field(default_factory=threading.Lock)

    def open(self, log: Path, hints: Mapping[str, Any]) -> View:
        """Read and check a log, unless it has been and did not change."""
        key = _key(log, hints)
        with self.guard:
            if key in self.kept:
                self.kept.move_to_end(key)
                return self.kept[key]
        opened = view(log, hints, key)
        with self.guard:
            self.kept[key] = opened
            while len(self.kept) > _KEPT:
                self.kept.popitem(last=False)
        return opened

    def get(self, key: str) -> View:
        """One that was opened.

        Raises
        ------
        InputError
            If it is no longer kept.
        """
        with self.guard:
            if key not in self.kept:
                raise InputError("this log is no longer in memory: open it again")
            return self.kept[key]


def view(log: Path, hints: Mapping[str, Any], key: str = "") -> View:
    """A log read with hints, checked, its signals ready to be drawn."""
    diagnosis = diagnose_log(log, **hints)
    recording, alone, _ = read_leniently(log, **hints)
    parts = [part for part in (recording, alone) if part is not None]
    # an IMU on an unknown clock is drawn from its own start on
    drawn = [c for part in parts for c in channels(part)]
    return View(key, recording, diagnosis, tuple(drawn))


def channels(recording: Recording) -> list[Channel]:
    """Specific force and angular rate as the reader gives them, motion of GNSS, and whatever else there is."""
    zero = recording.start
    out: list[Channel] = []

    def put(panel: str, name: str, role: str, t: FloatArray, y: FloatArray) -> None:
        if len(t):
            out.append(Channel(panel, name, role, t - zero, pyramid(np.ascontiguousarray(y, dtype=np.float64))))

    if recording.imu is not None:
        imu, shown = recording.imu.rates(), shown_units(recording)
        for words, triad, values in (("specific force", "accel", imu.accel), ("angular rate", "gyro", imu.gyro)):
            unit, factor = shown[triad]
            for i, axis in enumerate("xyz"):
                put(f"{words} [{unit}]", axis, _AXES[i], imu.t, values[:, i] / factor)
        if imu.temperature is not None:
            put("temperature [°C]", "IMU", "heating", imu.t, imu.temperature)
    if recording.gnss is not None and len(recording.gnss.t):
        g = recording.gnss
        if g.v_n is not None:
            put("speed [m/s]", "GNSS", "measured", g.t, np.hypot(g.v_n[:, 0], g.v_n[:, 1]))
        put("height [m]", "GNSS", "measured", g.t, g.llh[:, 2])
    if recording.odometer is not None:
        put("speed [m/s]", "odometer", "case_2", recording.odometer.t, recording.odometer.speed)
    if recording.height is not None:
        put("height [m]", "barometer", "case_2", recording.height.t, recording.height.value)
    if recording.heading is not None:
        put("heading [deg]", "heading", "measured", recording.heading.t, recording.heading.value / units.DEG)
    return out


def window(seen: View, start: float, stop: float, columns: int = COLUMNS) -> dict[str, Any]:
    """Panels of a window for the script of the page.

    Parameters
    ----------
    seen : View
    start, stop : float
        From the start of the recording. [s]
    columns : int
        Stretches, see :func:`~schuler.studio.pyramid.envelope`.

    Returns
    -------
    dict
        ``panels``, each with ``label`` and ``curves`` of ``x`` and ``y``: of a stretch its extremes, one after the
        other; ``whole``: whether every sample is drawn.
    """
    if not (math.isfinite(start) and math.isfinite(stop)):
        raise InputError(f"expected a window of two times in seconds, got {start} and {stop}")
    panels: dict[str, list[dict[str, Any]]] = {}
    whole = True
    for c in seen.channels:
        t, low, high = envelope(c.t, c.samples, start, stop, columns)
        if low is not high:
            t, y, whole = np.repeat(t, 2), np.stack((low, high), axis=1).ravel(), False
        else:
            y = low
        values = np.where(np.isfinite(y), y, np.nan).astype(np.float32)
        texts = [None if v != v else float(f"{v:.6g}") for v in values.tolist()]
        curve = {"name": c.name, "role": c.role, "x": np.round(t, 5).tolist(), "y": texts}
        panels.setdefault(c.panel, []).append(curve)
    shown = [{"label": label, "curves": curves} for label, curves in panels.items()]
    return {"time": TIME, "start": start, "stop": stop, "whole": whole, "panels": shown}


def _key(log: Path, hints: Mapping[str, Any]) -> str:
    """Name for a log as it is now, read in one way."""
    import hashlib
    import json

    files = [log] if log.is_file() else sorted(p for p in log.iterdir() if p.is_file())
    states = [(str(p), p.stat().st_size, p.stat().st_mtime_ns) for p in files]
    return hashlib.sha256(json.dumps([states, hints], sort_keys=True, default=str).encode()).hexdigest()[:24]
