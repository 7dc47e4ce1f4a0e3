"""Figures of a log as it was recorded: specific force and rates sample by sample, their spectrogram, speed, height."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from schuler import units
from schuler.arrays import FloatArray
from schuler.exceptions import InputError
from schuler.plotting.drawing import draw
from schuler.plotting.figure import TIME, Figure, Item, Panel, Span, line, markers, sampled, view
from schuler.plotting.heat import RISING, time_map
from schuler.recording.io.hint_texts import COUNTS, triads_in_counts
from schuler.recording.recording import Recording
from schuler.recording.series import ImuSeries

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure as MplFigure

_COLUMNS, _ROWS = 480, 96  # of a spectrogram
_SHORTEST = 16  # samples in a stretch whose spectrum is worth drawing
#: Unit of each triad in pictures, and that unit in SI.
SHOWN_UNITS = {"accel": ("m/s²", 1.0), "gyro": ("deg/s", units.DEG)}


def log_figure(
    recording: Recording, *, rests: Sequence[tuple[float, float]] = (), ax: Sequence[Axes] | None = None
) -> MplFigure:
    """Specific force, angular rate, and speed and height where they are known, over seconds from the start.

    Parameters
    ----------
    recording : Recording
    rests : sequence of (start, stop)
        Shaded. [s]
    ax : sequence of matplotlib axes, optional
        To draw into, as many as there are panels.

    Raises
    ------
    InputError
        If there is neither an IMU nor a position to draw.
    MissingExtraError
        If matplotlib is not installed (extra ``plot``).
    """
    return draw(log_content(recording, rests=rests), ax)


def shown_units(recording: Recording) -> dict[str, tuple[str, float]]:
    """Unit of each triad of a recording in pictures, and its value in the unit of the series; counts stay counts."""
    return SHOWN_UNITS | dict.fromkeys(triads_in_counts(recording.metadata.notes), (COUNTS, 1.0))


def log_content(
    recording: Recording, *, rests: Sequence[tuple[float, float]] = (), start: float | None = None
) -> Figure:
    """Description of :func:`log_figure`; ``start`` is the time called zero, that of the recording by default. [s]"""
    zero = recording.start if start is None else start
    panels = [] if recording.imu is None else imu_panels(recording.imu, zero, rests, shown_units(recording))
    for label, items, curves in _motion(recording, zero):
        panels.append(Panel(TIME, label, tuple(items), y_limits=view(curves)))
    if not panels:
        raise InputError(f"{recording.metadata.name} has neither an IMU nor positions to draw")
    caption = "The log as it was recorded, in forward, right, down axes."
    if rests:
        caption += " Yellow: at rest."
    return Figure("log", "The log", caption, tuple(panels))


def imu_panels(
    imu: ImuSeries,
    zero: float,
    rests: Sequence[tuple[float, float]] = (),
    shown: Mapping[str, tuple[str, float]] = SHOWN_UNITS,
) -> list[Panel]:
    """Specific force and angular rate of every sample, rests shaded."""
    t = imu.t - zero
    shaded: list[Item] = [Span(a - zero, b - zero, "finding", "at rest") for a, b in rests]
    limits = (float(t[0]), float(t[-1])) if len(t) > 1 else None
    panels = []
    for triad, (words, (name, unit)) in enumerate(
        (("specific force", shown["accel"]), ("angular rate", shown["gyro"]))
    ):

        def values(k: int, triad: int = triad, unit: float = unit) -> FloatArray:
            *readings, dt = _readings(imu)  # anew: the intervals are not kept until the page is written
            column: FloatArray = readings[triad][:, k] if dt is None else readings[triad][:, k] / dt
            return column / unit

        curves = [sampled(t, partial(values, k), f"axis_{axis}", axis) for k, axis in enumerate("xyz")]
        panels.append(
            Panel(
                TIME, f"{words} [{name}]", (*shaded, *curves), x_limits=limits, y_limits=view([c.y for c in curves]),
                height=1.2,
            )
        )  # fmt: skip
    return panels


def _readings(imu: ImuSeries) -> tuple[FloatArray, FloatArray, FloatArray | None]:
    """Accelerometer, gyroscopes, and the intervals by which they have to be divided to be rates, if they are none."""
    if imu.kind == "rate":
        return imu.accel, imu.gyro, None
    inc = imu.increments()
    return inc.dv_ib_b, inc.dtheta_ib_b, inc.dt


def spectrogram_content(
    imu: ImuSeries, zero: float, shown: Mapping[str, tuple[str, float]] = SHOWN_UNITS
) -> Figure | None:
    """Density of specific force and angular rate over time and frequency; None for a log too short to have any.

    Notes
    -----
    Spectra of stretches of equal length under a Hann window, less their mean, summed over the three axes; colours go
    from what 1 % of the picture is below to what 0.1 % is above.
    """
    t = imu.t
    if len(t) < 4 * _SHORTEST:
        return None
    panels = []
    spans = (float(t[0]) - zero, float(t[-1]) - zero), (0.0, 0.5 * imu.rate_hz)
    accel, gyro, dt = _readings(imu)
    triads = (("specific force", accel, shown["accel"]), ("angular rate", gyro, shown["gyro"]))
    for triad, columns, (unit, scale) in triads:
        root = np.sqrt(_spectrogram(columns, dt, scale, imu.rate_hz))
        low, high = np.quantile(root, (0.01, 0.999))
        if not 0.0 < low < high:  # a log in steps so coarse that nothing moves
            continue
        values = np.log(np.maximum(root, low) / low) / np.log(high / low)
        text = f"{triad}, root density, all axes: dark {low:.2g}, pale {high:.2g} {unit}/√Hz"
        panels.append(time_map("frequency [Hz]", values[::-1], RISING, *spans, title=text, height=1.2))
    caption = (
        "An engine or a propeller is a line across, a bump a streak upwards; a line that bends back at the upper edge "
        "is faster than half of the sampling rate."
    )
    return Figure("spectrogram", "Spectrogram", caption, tuple(panels)) if panels else None


def _spectrogram(columns: FloatArray, dt: FloatArray | None, unit: float, rate_hz: float) -> FloatArray:
    """One-sided density summed over axes: at most ``_ROWS`` frequencies (largest of neighbours), ``_COLUMNS`` times."""
    n = len(columns)
    length = int(np.clip(1 << int(np.log2(max(2 * n / _COLUMNS, _SHORTEST))), _SHORTEST, 1024))
    count = min(_COLUMNS, max(2 * (n // length) - 1, 1))
    first = np.linspace(0, n - length, count).astype(np.int64)
    window = np.hanning(length)[:, None]
    rows = first[:, None] + np.arange(length)
    pieces = (columns[rows] if dt is None else columns[rows] / dt[rows][..., None]) / unit
    spectra = np.fft.rfft((pieces - pieces.mean(axis=1, keepdims=True)) * window, axis=1)
    density = np.sum(spectra.real**2 + spectra.imag**2, axis=2)[:, 1:].T * 2.0 / (rate_hz * np.sum(window**2))
    each = -(-len(density) // _ROWS)
    return np.maximum.reduceat(density, np.arange(0, len(density), each), axis=0)


def _motion(recording: Recording, zero: float) -> list[tuple[str, list[Item], list[FloatArray]]]:
    """Labels, items and values of speed and height, from whatever knows them."""
    speeds: list[Item] = []
    heights: list[Item] = []
    v: list[FloatArray] = []
    h: list[FloatArray] = []
    if (gnss := recording.gnss) is not None and len(gnss):
        h.append(gnss.llh[:, 2])
        heights.append(markers(gnss.t - zero, h[-1], "measured", "GNSS"))
        if gnss.v_n is not None:
            v.append(np.linalg.norm(gnss.v_n, axis=1))
            speeds.append(markers(gnss.t - zero, v[-1], "measured", "GNSS"))
    if (wheels := recording.odometer) is not None and len(wheels):
        v.append(wheels.speed)
        speeds.append(line(wheels.t - zero, v[-1], "case_3", "wheels"))
    if (reference := recording.reference) is not None and len(reference):
        h.append(reference.llh[:, 2])
        heights.append(line(reference.t - zero, h[-1], "reference", "reference"))
        if reference.v_eb_e is not None:
            v.append(np.linalg.norm(reference.v_eb_e, axis=1))
            speeds.append(line(reference.t - zero, v[-1], "reference", "reference"))
    return [
        (label, items, values)
        for label, items, values in (("speed [m/s]", speeds, v), ("height [m]", heights, h))
        if items
    ]
