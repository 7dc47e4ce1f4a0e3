"""Figure of what a triad says before and after its calibration, along a log."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Literal, TypeAlias

import numpy as np

from schuler.arrays import FloatArray
from schuler.exceptions import InputError
from schuler.plotting.drawing import draw, save_all
from schuler.plotting.figure import TIME, Figure, Panel, level, line, view
from schuler.plotting.parts import number
from schuler.recording.series import ImuSeries
from schuler.units import DEG, MG

if TYPE_CHECKING:
    from matplotlib.figure import Figure as MplFigure

Triad: TypeAlias = Literal["accel", "gyro"]

_SHOWN = {
    "accel": ("specific force", "m/s^2", 1.0, "mg", MG),
    "gyro": ("angular rate", "deg/s", DEG, "deg/s", DEG),
}
_AXES = "xyz"
_TRIADS: tuple[Triad, ...] = ("accel", "gyro")
_LEAST = 1e-6  # height of a panel of errors that are all zero
_ROLES = {"before": "smoothed", "after": "filtered", "true": "reference"}


def output_figure(
    before: ImuSeries,
    after: ImuSeries,
    triad: Triad = "accel",
    *,
    truth: ImuSeries | None = None,
    mean_s: float = 1.0,
) -> MplFigure:
    """What the sensors of a triad say before and after a calibration.

    Parameters
    ----------
    before : ImuSeries
        As recorded, SI.
    after : ImuSeries
        The same log with the errors taken out: :meth:`.CalibrationResult.apply`.
    triad : {"accel", "gyro"}
    truth : ImuSeries, optional
        What a perfect IMU would say, in the axes of the calibration, at the times of the log.
    mean_s : float
        Readings are averaged over this: a bias is smaller than the noise of a sample. [s]

    Returns
    -------
    matplotlib.figure.Figure

    Raises
    ------
    InputError
        If the logs are not sampled together, or shorter than two means.
    MissingExtraError
        If matplotlib is not installed (extra ``plot``).

    References
    ----------
    Yaman (2017), Fig. 5.10. Departure: errors have panels of their own, beside the output they cannot be seen.
    """
    return draw(outputs(before, after, triad, truth=truth, mean_s=mean_s))


def save_output_figures(
    before: ImuSeries,
    after: ImuSeries,
    folder: Path | str,
    formats: Sequence[str] = ("png", "svg"),
    *,
    truth: ImuSeries | None = None,
) -> list[Path]:
    """Write ``output_accel`` and ``output_gyro`` in each format (``png``, ``svg``, ``pdf``) to a folder.

    Parameters as of :func:`output_figure`; files of the same name are replaced.
    """
    figures = [outputs(before, after, triad, truth=truth) for triad in _TRIADS]
    return save_all(figures, folder, formats)


def outputs(
    before: ImuSeries, after: ImuSeries, triad: Triad = "accel", *, truth: ImuSeries | None = None, mean_s: float = 1.0
) -> Figure:
    """Description of the figure: output of each axis, and beside it its errors (or, without truth, what was taken out).

    Parameters as of :func:`output_figure`.
    """
    if triad not in _SHOWN:
        raise InputError(f"triad: expected accel or gyro, got {triad!r}")
    if not mean_s > 0.0:
        raise InputError(f"mean_s: expected a positive time, got {mean_s!r} s")
    for name, other in (("after", after), ("truth", truth)):
        if other is not None and (
            len(other) != len(before) or np.abs(other.t - before.t).max() > 0.1 * before.interval
        ):
            raise InputError(f"{name}: expected the samples of the log before, {len(before)} of them, got {len(other)}")
    logs = {"before": before, "after": after} | ({} if truth is None else {"true": truth})
    shown = {label: _means(log, triad, mean_s) for label, log in logs.items()}
    what, unit, factor, small, small_factor = _SHOWN[triad]
    t = shown["before"][0]
    panels = []
    for i, axis in enumerate(_AXES):
        y = {label: values[:, i] for label, (_, values) in shown.items()}
        lines = tuple(line(t, y[label] / factor, role, label) for label, role in _ROLES.items() if label in y)
        panels.append(Panel(TIME, f"[{unit}]", lines, title=f"{what} {axis}", x_limits=_ends(t)))
        if truth is None:
            off = {"before less after": (y["before"] - y["after"]) / small_factor}
            title = f"{axis}: up to {number(float(np.abs(off['before less after']).max()), small)} taken out"
        else:
            off = {label: (y[label] - y["true"]) / small_factor for label in ("before", "after")}
            rms = [number(float(np.sqrt(np.mean(e**2))), small) for e in off.values()]
            title = f"{axis}: rms {rms[0]} before, {rms[1]} after"
        items = [level(_ends(t), 0.0, "level"), *(line(t, e, _ROLES.get(n, "mean"), n) for n, e in off.items())]
        label = f"{'taken out' if truth is None else 'error'} [{small}]"
        limits = view([*off.values(), np.zeros(1)], least=_LEAST)
        panels.append(Panel(TIME, label, tuple(items), title=title, x_limits=_ends(t), y_limits=limits))
    right = "what the calibration took out of it" if truth is None else "the same less the truth"
    return Figure(
        f"output_{triad}",
        f"Output of the {'accelerometers' if triad == 'accel' else 'gyroscopes'} before and after",
        f"Means over {mean_s:g} s: left what the sensors say, right {right}.",
        tuple(panels),
        columns=2,
    )


def _ends(t: FloatArray) -> tuple[float, float]:
    return float(t[0]), float(t[-1])


def _means(imu: ImuSeries, triad: Triad, mean_s: float) -> tuple[FloatArray, FloatArray]:
    """Middles (k,) [s] of stretches of ``mean_s`` and means (k, 3) over them; what is left at the end is left out."""
    rates = imu.rates()
    m = max(1, round(mean_s / rates.interval))
    n = len(rates) // m
    if n < 2:
        raise InputError(f"mean_s: expected two stretches or more in the log, got {mean_s:g} s of {len(rates)} samples")
    values = rates.accel if triad == "accel" else rates.gyro
    t = rates.t[: n * m].reshape(n, m).mean(axis=1)
    return np.asarray(t), np.asarray(values[: n * m].reshape(n, m, 3).mean(axis=1))
