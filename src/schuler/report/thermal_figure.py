"""Figure of a thermal calibration: every parameter against temperature, heating and cooling apart."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from schuler.calibration.parameters import unit
from schuler.calibration.result import CalibrationResult
from schuler.calibration.thermal_correction import thermal_value
from schuler.exceptions import InputError, MissingExtraError
from schuler.report.style import style

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_FONT = 7.0  # [pt]


def thermal_figure(result: CalibrationResult, names: Sequence[str] | None = None) -> Figure:
    """Polynomial with its 3-sigma band, and the table of heating and cooling with 3-sigma bars.

    Parameters
    ----------
    result : CalibrationResult
        Of :func:`schuler.calibration.thermal.calibrate_thermal`, not refused.
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
    thermal = result.extra.get("thermal")
    if not thermal:
        raise InputError("result: expected one of calibrate_thermal that was not refused; see its verdicts")
    try:
        from matplotlib.backends.backend_agg import FigureCanvasAgg
        from matplotlib.figure import Figure as MplFigure
    except ImportError:
        raise MissingExtraError("matplotlib", "plot", "drawing figures") from None
    chosen = list(names or (n for n, d in thermal["degree"].items() if d > 0 or n in thermal["table"]))
    if not chosen:
        raise InputError("names: expected parameters that depend on temperature, found none")
    rows = -(-len(chosen) // 3)
    canvas = MplFigure(figsize=(6.8, 0.5 + 1.7 * rows), layout="constrained")
    FigureCanvasAgg(canvas)
    axes = canvas.subplots(rows, 3, squeeze=False)
    for ax, name in zip(axes.flat, chosen, strict=False):
        _panel(ax, result, name, thermal["table"])
    for ax in axes.flat[len(chosen) :]:
        ax.set_visible(False)
    for ax in axes[-1]:
        ax.set_xlabel("temperature [degC]", fontsize=_FONT)
    handles: dict[str, Any] = {}
    for ax in axes.flat:
        for handle, label in zip(*ax.get_legend_handles_labels(), strict=True):
            handles.setdefault(label, handle)
    canvas.legend(
        handles.values(), handles.keys(), loc="outside upper center", ncols=4, fontsize=_FONT, frameon=False
    )  # fmt: skip
    return canvas


def _panel(ax: Axes, result: CalibrationResult, name: str, table: dict[str, Any]) -> None:
    low, high = result.extra["thermal"]["range"]
    T = np.linspace(low, high, 101)
    value, sigma = thermal_value(result, name, T)
    look = style("axis_x")
    ax.fill_between(T, value - 3.0 * sigma, value + 3.0 * sigma, color=look.light, alpha=0.2, lw=0)
    ax.plot(T, value, color=look.light, lw=1.2, label="polynomial, 3 sigma")
    if name in table:
        at, entries = table["temperature"], table[name]
        ways = table.get("way") or [None] * len(at)
        for way, role, marker in (
            ("heating", "smoothed", "^"),
            ("cooling", "axis_z", "v"),
            ("first", "reference", "o"),
        ):
            rows = zip(entries["value"], ways, strict=True)
            values = entries.get(way) or [v if w == way else None for v, w in rows]
            known = [(t, v, s) for t, v, s in zip(at, values, entries["sigma"], strict=True) if v is not None]
            if known:
                x, y, s = np.array(known).T
                ax.errorbar(
                    x, y, 3.0 * s, ls="none", marker=marker, ms=3.0, lw=0.8, color=style(role).light, label=way
                )  # fmt: skip
    ax.set_title(f"{name} [{unit(name)}]", fontsize=_FONT, loc="left", pad=3)
    ax.tick_params(labelsize=_FONT - 1.0, length=2.5)
    ax.ticklabel_format(axis="y", scilimits=(-2, 3))
    ax.yaxis.get_offset_text().set_fontsize(_FONT - 1.0)
    ax.grid(True, color="0.9", lw=0.5)
