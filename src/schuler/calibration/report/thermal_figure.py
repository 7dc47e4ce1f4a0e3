"""Figure of a thermal calibration: every parameter against temperature, heating and cooling apart."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from schuler.calibration.result.parameters import unit
from schuler.calibration.result.result import CalibrationResult
from schuler.calibration.thermal.correction import thermal_value
from schuler.exceptions import InputError
from schuler.plotting.drawing import draw
from schuler.plotting.figure import Band, Figure, Item, Line, Markers, Panel

if TYPE_CHECKING:
    from matplotlib.figure import Figure as MplFigure

_WAYS = ("heating", "cooling", "first")  # roles of their own


def thermal_figure(result: CalibrationResult, names: Sequence[str] | None = None) -> MplFigure:
    """Polynomial with its 3-sigma band, and the table of heating and cooling with 3-sigma bars.

    Parameters
    ----------
    result : CalibrationResult
        Of :func:`schuler.calibration.thermal.calibrate.calibrate_thermal`, not refused.
    names : sequence of str, optional
        Parameters; None: all that depend on temperature. SI.

    Returns
    -------
    matplotlib.figure.Figure

    Raises
    ------
    InputError
        If the result has no temperature dependence or not such a parameter.
    MissingExtraError
        If matplotlib is not installed (extra ``plot``).
    """
    return draw(thermal_content(result, names))


def thermal_content(result: CalibrationResult, names: Sequence[str] | None = None) -> Figure:
    """Description of :func:`thermal_figure`."""
    thermal = result.extra.get("thermal")
    if not thermal:
        raise InputError("result: expected one of calibrate_thermal that was not refused; see its verdicts")
    chosen = list(names or (n for n, d in thermal["degree"].items() if d > 0 or n in thermal["table"]))
    if not chosen:
        raise InputError("names: expected parameters that depend on temperature, found none")
    panels = tuple(_panel(result, name, thermal["table"]) for name in chosen)
    caption = (
        "Each parameter over temperature with three standard deviations; where heating and cooling part, the sensor "
        "is slower than its thermometer."
    )
    return Figure("temperature", "Parameters over temperature", caption, panels, columns=min(3, len(panels)))


def _panel(result: CalibrationResult, name: str, table: dict[str, Any]) -> Panel:
    low, high = result.extra["thermal"]["range"]
    T = np.linspace(low, high, 101)
    value, sigma = thermal_value(result, name, T)
    items: list[Item] = [
        Band(T, value - 3.0 * sigma, value + 3.0 * sigma, "axis_x_band"),
        Line(T, value, "axis_x", "polynomial, 3 sigma"),
    ]
    if name in table:
        at, entries = table["temperature"], table[name]
        ways = table.get("way") or [None] * len(at)
        for way in _WAYS:
            rows = zip(entries["value"], ways, strict=True)
            values = entries.get(way) or [v if w == way else None for v, w in rows]
            available = [(t, v, s) for t, v, s in zip(at, values, entries["sigma"], strict=True) if v is not None]
            if available:
                x, y, s = np.array(available, dtype=np.float64).T
                gap = np.full_like(x, np.nan)
                bars = np.stack([y - 3.0 * s, y + 3.0 * s, gap], axis=1).ravel()
                items += [Line(np.repeat(x, 3), bars, way), Markers(x, y, way, way)]
    return Panel("temperature [degC]", f"{name} [{unit(name)}]", tuple(items))
