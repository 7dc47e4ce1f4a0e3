"""Figures of identified noise, described once for paper and screen: Allan curves, model over curve, spectrum, log."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from schuler.arrays import FloatArray
from schuler.characterisation.report.terms import TRIADS, Unit, chosen, signal_unit, term_variances, triad_of
from schuler.characterisation.result import AxisNoise, NoiseIdentification
from schuler.plotting.figure import Band, Figure, Item, Limits, Line, Markers, Panel, Text, level

TAU = "averaging time [s]"
_DEEPEST = 30.0  # how far below the curve a panel may reach to show a point read off


def allan(
    identification: NoiseIdentification, axes: Sequence[str] | str | None = None, unit: Unit = "datasheet"
) -> Figure:
    """Allan deviation of every axis: curve with band, fitted model, each fitted term, points read off.

    Parameters
    ----------
    identification : NoiseIdentification
    axes : sequence of str, optional
        Default: all that were identified.
    unit : {"datasheet", "si"}
        deg/h and ug, or rad/s and m/s^2.

    Raises
    ------
    InputError
        If an axis was not identified.
    """
    panels_of = beside(chosen(identification, axes if axes is None or isinstance(axes, str) else list(axes)))
    return Figure(
        "allan",
        "Allan deviation",
        "Blue is measured with its 95 % band, dashed the model, grey its terms; rings are what the eye reads off: "
        "N at 1 s, the minimum, and K at 3 s if the model has one.",
        tuple(_allan_panel(axis, unit) for axis in panels_of),
        columns=1 if len(panels_of) == 1 else 2,
    )


def comparison(identification: NoiseIdentification, unit: Unit = "datasheet") -> Figure:
    """The three axes of each triad over each other: one panel for gyroscopes, one for accelerometers."""
    panels = []
    by_triad = _by_triad(chosen(identification, None))
    for triad, axes in by_triad.items():
        name, factor = signal_unit(axes[0], unit)
        items: list[Item] = []
        for axis in axes:
            letter, c = axis.axis.partition("_")[2], axis.curve
            items.append(Band(c.tau, c.low / factor, c.high / factor, f"axis_{letter}_band"))
            items.append(Line(c.tau, c.deviation / factor, f"axis_{letter}", letter))
        curves = np.concatenate([a.curve.deviation for a in axes]) / factor
        panels.append(
            Panel(
                TAU, f"Allan deviation [{name}]", tuple(items), title=TRIADS[triad], y_limits=decades(curves),
                log=True, log_x=True,
            )
        )  # fmt: skip
    return Figure(
        "allan_axes",
        "The axes compared",
        "Axes of one kind should lie on each other; one that does not has another sensor behind it, or felt something.",
        tuple(panels),
        columns=len(panels),
    )


def ratio(identification: NoiseIdentification, axes: Sequence[str] | None = None) -> Figure:
    """Measured Allan deviation over that of the model, with the band: one everywhere if the model is right."""
    panels = []
    panels_of = beside(chosen(identification, None if axes is None else list(axes)))
    for axis in panels_of:
        c = axis.curve
        model = axis.fitted(c.tau)
        model = np.where(model > 0.0, model, np.nan)
        items = (
            Band(c.tau, c.low / model, c.high / model, "allan_band", "95 % of the curve"),
            Line(c.tau, c.deviation / model, "allan", "curve over model"),
            level(_ends(c.tau), 1.0, "level", "perfect"),
        )
        shown = c.deviation / model
        top = float(np.nanmax(np.abs(shown - 1.0))) if np.isfinite(shown).any() else 0.5
        limits = (max(1.0 - 1.3 * max(top, 0.1), 0.0), 1.0 + 1.3 * max(top, 0.1))
        panels.append(Panel(TAU, "ratio [-]", items, title=axis.axis, log_x=True, y_limits=limits))
    return Figure(
        "allan_ratio",
        "Curve over model",
        "Inside the band the model explains the curve; a long stretch outside on one side is noise the model lacks.",
        tuple(panels),
        columns=1 if len(panels_of) == 1 else 2,
    )


def _allan_panel(axis: AxisNoise, unit: Unit) -> Panel:
    c, (name, factor) = axis.curve, signal_unit(axis, unit)
    limits = _ends(
        c.tau,
        *([1.0] if "N_at_1s" in axis.read_off else []),
        *([3.0] if "K_at_3s" in axis.read_off and "K" in axis.terms else []),
    )
    tau = np.unique(np.maximum(np.round(np.geomspace(*limits, 200) * axis.rate_hz), 1.0)) / axis.rate_hz
    model = axis.fitted(tau) / factor
    parts = {label: np.sqrt(v) / factor for label, v in term_variances(axis, tau).items()}
    points = _read_off(axis, factor)
    curve = c.deviation / factor
    shown = _view(np.concatenate([curve, c.low / factor, c.high / factor]), [y for _, y in points], curve)
    items: list[Item] = [Band(c.tau, c.low / factor, c.high / factor, "allan_band", "95 % band")]
    items += [Line(tau, y, "term", "fitted terms") for y in parts.values()]
    items.append(Line(c.tau, curve, "allan", "measured"))
    items.append(Line(tau, model, "model", "model"))
    points = [p for p in points if shown[0] <= p[1] <= shown[1]]
    if points:
        items.append(
            Markers(np.array([x for x, _ in points]), np.array([y for _, y in points]), "read_off", "read off")
        )
    items += _named(tau, model, parts, shown)
    return Panel(
        TAU, f"Allan deviation [{name}]", tuple(items), title=axis.axis, x_limits=limits, y_limits=shown, log=True,
        log_x=True,
    )  # fmt: skip


def _read_off(axis: AxisNoise, factor: float) -> list[tuple[float, float]]:
    """Points the eye reads off, averaging time and value."""
    read = axis.read_off
    points = [(1.0, read.get("N_at_1s")), (read.get("minimum_tau_s"), read.get("minimum"))]
    if "K" in axis.terms:
        points.append((3.0, read.get("K_at_3s")))
    return [(x, y / factor) for x, y in points if x is not None and y is not None and x > 0.0 and 0.0 < y < np.inf]


def _named(tau: FloatArray, model: FloatArray, parts: Mapping[str, FloatArray], shown: Limits) -> list[Text]:
    """The letter of each term, where its line is in view and clear of the model's."""
    words, ends = [], np.log(tau / tau[0]) / np.log(tau[-1] / tau[0])
    for label, y in parts.items():
        in_view = (y > 1.05 * shown[0]) & (y < 0.6 * shown[1]) & (ends > 0.04) & (ends < 0.96)
        if in_view.any():
            # a third of the model is far enough below it to read the letter, which stands clear of the other lines
            cost = np.abs(np.log(3.0 * y / model))
            for other in (v for name, v in parts.items() if name != label):
                cost = cost + 3.0 * np.exp(-((np.log(1.3 * y / other) / 0.5) ** 2))
            cost = np.where(in_view, cost, np.inf)
            k = int(np.argmin(cost))
            words.append(Text(float(tau[k]), float(y[k]), "0.664 B" if label == "B" else label))
    return words


def _view(values: FloatArray, points: Sequence[float], curve: FloatArray) -> Limits:
    """Limits with all of the curve and its band, and the points read off unless they lie far below."""
    positive = values[np.isfinite(values) & (values > 0.0)]
    lowest = curve[np.isfinite(curve) & (curve > 0.0)]
    if not len(positive) or not len(lowest):
        return 1e-3, 1.0
    near = [p for p in points if p > float(lowest.min()) / _DEEPEST]
    low = min([max(float(positive.min()), float(lowest.min()) / 3.0), *near])
    return 0.6 * low, 1.6 * max([min(float(positive.max()), 3.0 * float(lowest.max())), *near])


def decades(values: FloatArray) -> Limits | None:
    """Whole decades, so that a logarithmic axis has at least two numbers on it."""
    positive = values[np.isfinite(values) & (values > 0.0)]
    if not len(positive):
        return None
    low, high = np.floor(np.log10(positive.min())), np.ceil(np.log10(positive.max()))
    return 10.0 ** float(low), 10.0 ** float(max(high, low + 1.0))


def _ends(tau: FloatArray, *also: float) -> Limits:
    """First and last averaging time, a little apart even if there is one only."""
    both = [float(v) for v in tau] + list(also)
    return (min(both), max(both)) if max(both) > min(both) else (0.5 * both[0], 2.0 * both[0])


def beside(axes: list[AxisNoise]) -> list[AxisNoise]:
    """Gyroscopes left and accelerometers right where both have as many axes, otherwise as they come."""
    groups = list(_by_triad(axes).values())
    if len(groups) == 2 and len(groups[0]) == len(groups[1]):
        return [axis for pair in zip(*groups, strict=True) for axis in pair]
    return axes


def _by_triad(axes: Sequence[AxisNoise]) -> dict[str, list[AxisNoise]]:
    groups: dict[str, list[AxisNoise]] = {}
    for axis in axes:
        groups.setdefault(triad_of(axis), []).append(axis)
    return groups
