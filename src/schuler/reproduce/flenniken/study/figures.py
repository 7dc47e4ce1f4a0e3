"""Charts of single logs: raw and filtered, Allan curves of several, autocorrelations, a log among its simulations."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from schuler.plotting import figure as content
from schuler.plotting.figure import Band, Figure, Item, Line, Panel

if TYPE_CHECKING:
    from schuler.arrays import FloatArray
    from schuler.characterisation.allan import AllanCurve
    from schuler.characterisation.correlation import Correlation
    from schuler.reproduce.flenniken.study.grade_comparison import Overlay

_ROLES = ("case_1", "case_2", "case_3", "case_4", "case_5", "case_6", "case_7")
_AVERAGING = "averaging time [s]"

#: Averaging times or lags, and values at them.
Curve = tuple["FloatArray", "FloatArray"]


def log_figure(t: FloatArray, raw: FloatArray, filtered: FloatArray, unit: str) -> Figure:
    """A log above, the same low-passed below on its own scale (figures 2.1, 2.3 and 2.10 of Flenniken).

    Parameters
    ----------
    t : ndarray, shape (n,)
        [s]
    raw, filtered : ndarray, shape (n,)
        In ``unit``.
    unit : str
    """
    panels = (
        Panel("time [s]", f"raw [{unit}]", (content.line(t, raw, "measured"),)),
        Panel("time [s]", f"filtered [{unit}]", (content.line(t, filtered, "filtered"),)),
    )
    return Figure("log", "A log at rest", "Scales differ: white noise hides the moving bias above.", panels)


def allan_figure(
    curves: Mapping[str, AllanCurve], models: Sequence[Curve], unit: str, *, model: str = "model", scale: float = 1.0
) -> Figure:
    """Allan deviations of several logs with their confidence bands, and of models.

    Parameters
    ----------
    curves : mapping of str to AllanCurve
        By label.
    models : sequence of (ndarray, ndarray)
        Averaging times and deviations in the unit of the curves; drawn dashed.
    unit : str
    model : str
        Label of all models.
    scale : float
        One ``unit`` in that of the curves.
    """
    items: list[Item] = []
    for k, (label, c) in enumerate(curves.items()):
        items.append(Band(c.tau, c.low / scale, c.high / scale, "allan_band", "95 % bounds" if k == 0 else ""))
        items.append(Line(c.tau, c.deviation / scale, _ROLES[k % len(_ROLES)], label))
    for k, (tau, deviation) in enumerate(models):
        items.append(Line(tau, deviation / scale, "model", model if k == 0 else ""))
    panel = Panel(_AVERAGING, f"Allan deviation [{unit}]", tuple(items), log=True, log_x=True)
    return Figure("allan_chart", "Allan deviation", "", (panel,))


def correlation_figure(
    correlations: Mapping[str, Correlation], models: Mapping[str, Curve], x_label: str = "lag [s]"
) -> Figure:
    """Normalised autocorrelations with two standard deviations, and models beside.

    Parameters
    ----------
    correlations : mapping of str to Correlation
    models : mapping of str to (ndarray, ndarray)
        Lags and coefficients.
    x_label : str
    """
    items: list[Item] = []
    for k, (label, r) in enumerate(correlations.items()):
        y, s = r.normalised, r.sigma / r.value[0]
        items.append(
            content.band(r.lag, y - 2.0 * s, y + 2.0 * s, "sigma", "two standard deviations" if k == 0 else "")
        )
        items.append(content.line(r.lag, y, _ROLES[k % len(_ROLES)], label))
    items += [Line(lag, y, "model", label) for label, (lag, y) in models.items()]
    panel = Panel(x_label, "autocorrelation [-]", tuple(items))
    return Figure("autocorrelation", "Autocorrelation", "", (panel,))


def overlay_figure(overlays: Mapping[str, Overlay], unit: str, scale: float = 1.0) -> Figure:
    """A log among simulations of a model, Allan deviation and autocorrelation, a row of panels for each model."""
    panels = []
    for label, o in overlays.items():
        for c, name, factor, log in (
            (o.allan, f"Allan deviation [{unit}]", scale, True),
            (o.correlation, "autocorrelation [-]", 1.0, False),
        ):
            items = (
                Band(c.at, c.low / factor, c.high / factor, "expected", "95 % of simulations"),
                Line(c.at, c.median / factor, "model", "their median"),
                Line(c.at, c.measured / factor, "allan", "log"),
            )
            x = _AVERAGING if log else "lag [s]"
            panels.append(Panel(x, name, items, f"{label}, p = {min(c.p, 1.0):.2g}", log=log, log_x=True))
    caption = "A right model has the log inside the band at 95 % of the points; p below 0.025 rejects it."
    return Figure("overlay", "A log and its model", caption, tuple(panels), columns=2, linked=False)


def series_figure(t: FloatArray, series: Mapping[str, FloatArray], x_label: str, y_label: str, title: str) -> Figure:
    """Several series over one axis in one panel."""
    items = tuple(content.line(t, x, _ROLES[k % len(_ROLES)], label) for k, (label, x) in enumerate(series.items()))
    return Figure("series", title, "", (Panel(x_label, y_label, items),))


def sweep_figure(
    specified: FloatArray,
    deviations: Mapping[str, tuple[FloatArray, FloatArray]],
    x_label: str,
    y_label: str,
    title: str,
) -> Figure:
    """Values wanted and found with two standard errors, both axes logarithmic (figure B.3 of Flenniken).

    Parameters
    ----------
    specified : ndarray, shape (k,)
    deviations : mapping of str to (ndarray, ndarray)
        Values and their standard errors, shape (k,).
    """
    items: list[Item] = [Line(specified, specified, "reference", "as wanted")]
    for k, (label, (value, error)) in enumerate(deviations.items()):
        role = _ROLES[k % len(_ROLES)]
        items.append(content.Markers(specified, value, role, label))
        items += [
            Line(np.array([x, x]), np.array([y - 2.0 * e, y + 2.0 * e]), role)
            for x, y, e in zip(specified, value, error, strict=True)
        ]
    panel = Panel(x_label, y_label, tuple(items), log=True, log_x=True)
    return Figure("sweep", title, "Bars: two standard errors.", (panel,))
