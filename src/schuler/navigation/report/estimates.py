"""Estimated sensor parameters over time, in the units of data sheets."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from schuler import units
from schuler.arrays import FloatArray
from schuler.filtering.states import BLOCK_TEXT
from schuler.navigation.report.subject import Subject
from schuler.navigation.report.track import outages
from schuler.navigation.result import NavigationResult
from schuler.plotting.figure import SLOW_LIMIT, TIME, Figure, Item, Panel, band, line, view

_XYZ = ("x", "y", "z")
_PAIRS = ("xy", "xz", "yx", "yz", "zx", "zy")
_ELEMENTS = {
    "M_a": ("xy", "xz", "yz"), "M_a6": _PAIRS, "M_g": _PAIRS, "G_g": tuple(a + b for a in _XYZ for b in _XYZ),
    "lever": ("forward", "right", "down"), "lever_v": ("forward", "right", "down"), "mount": ("pitch", "yaw"),
    "b_r": ("north", "east", "down"), "b_v": ("north", "east", "down"),
    "odometer": ("scale",), "b_heading": ("heading",), "baro": ("height",), "delay": ("delay",),
    "clock": ("offset",), "clock_drift": ("drift",), "clock_2": ("second system",), "clock_3": ("third system",),
    "clock_4": ("fourth system",),
}  # fmt: skip
_UNITS = {
    "m/s^2": ("mg", units.MG), "rad/s": ("deg/h", units.DEG_PER_HR), "1": ("ppm", units.PPM), "rad": ("mrad", 1e-3),
    "(rad/s)/(m/s^2)": ("deg/h/g", units.DEG_PER_HR_PER_G), "m": ("m", 1.0), "m/s": ("m/s", 1.0),
}  # fmt: skip
#: Blocks that are usually given in other units than :data:`_UNITS` has for their SI unit.
_OWN_UNITS = {
    "mount": ("deg", units.DEG), "b_heading": ("deg", units.DEG), "odometer": ("%", 0.01), "delay": ("ms", 1e-3),
}  # fmt: skip
_NAMES = {
    "lever": "lever arm IMU to antenna", "lever_v": "lever arm IMU to axle", "mount": "mounting angle",
    "odometer": "odometer", "clock": "receiver clock", "clock_drift": "receiver clock",
    "clock_2": "receiver clock", "clock_3": "receiver clock", "clock_4": "receiver clock",
    "b_heading": "bias of the heading sensor", "baro": "bias of the barometric height",
    "b_r": "correlated GNSS position error", "b_v": "correlated GNSS velocity error", "delay": "delay of GNSS",
}  # fmt: skip
_CLOCKS = ("clock", "clock_drift", "clock_2", "clock_3", "clock_4")
_COARSE_GYRO = 0.03 * units.DEG  # from here on a gyro bias is quoted in deg/s [rad/s]


class Parameter(NamedTuple):
    """One block of parameters in data-sheet units.

    Attributes
    ----------
    block, name, unit : str
    elements : tuple of str
        ``x``, ``xy``, ``forward``, ...
    factor : float
        SI unit of the block in the unit shown: divide by it.
    """

    block: str
    name: str
    unit: str
    elements: tuple[str, ...]
    factor: float


def parameter(result: NavigationResult, block: str) -> Parameter:
    """Name, unit and elements of a block; a gyro bias in deg/s if it is that large, in deg/h otherwise."""
    text, si = BLOCK_TEXT[block]
    unit, factor = _OWN_UNITS.get(block) or _UNITS[si]
    if block in ("b_g", "b_g_run") and len(result.t) and np.abs(result.parameter(block)).max() > _COARSE_GYRO:
        unit, factor = "deg/s", units.DEG
    elements = _ELEMENTS.get(block, _XYZ)
    # BLOCK_TEXT names the elements behind the name where they are not x, y, z
    name = _NAMES.get(block) or text.split(" xy")[0].split(", row by row")[0]
    return Parameter(block, name, unit, elements, factor)


def groups(result: NavigationResult) -> list[tuple[str, ...]]:
    """Blocks by figure: the receiver's clocks share one."""
    figures: list[tuple[str, ...]] = []
    for block in result.layout.models:
        if block in _CLOCKS and figures and figures[-1][0] in _CLOCKS:
            figures[-1] = (*figures[-1], block)
        else:
            figures.append((block,))
    return figures


def parameters(subject: Subject, *blocks: str) -> Figure:
    """Estimate, 3-sigma band and truth of every element of one block, or of several in one figure."""
    panels = [panel for block in blocks for panel in _panels(subject, block)]
    p = parameter(subject.result, blocks[0])
    elements = [e for block in blocks for e in parameter(subject.result, block).elements]
    caption = f"Estimate of the {p.name}"
    if len(elements) > 1:
        caption += f" ({', '.join(elements)})"
    caption += (
        " with three standard deviations: the band narrows as far as the motion makes the parameter visible"
        if blocks[0] not in _CLOCKS
        else " with three standard deviations; it wanders, so the band reaches a level and stays there"
    )
    if subject.truth is not None:
        caption += ", and should hold the true value."
    else:
        caption += "." if blocks[0] in _CLOCKS else ", and a parameter that stays as wide was not seen."
    columns = 3 if len(panels) > 2 else 1
    title = f"{p.name[0].upper()}{p.name[1:]}"
    return Figure(f"parameters_{blocks[0]}", title, caption, tuple(panels), columns=columns)


def _panels(subject: Subject, block: str) -> list[Panel]:
    p = parameter(subject.result, block)
    part = subject.result.layout[block]
    t = subject.seconds(subject.result.t)
    panels = []
    for i, element in enumerate(_elements(subject, p)):
        items: list[Item] = [*outages(subject)]
        estimates: list[FloatArray] = []
        edges: list[FloatArray] = []
        values = [result.parameter(block)[:, i] / p.factor for _, result in subject.solutions]
        # a clock runs away by kilometres, and what matters of it are metres: seen without its straight line
        slope, start = np.polyfit(t, values[-1], 1) if block == "clock" and len(t) > 2 else (0.0, 0.0)
        trend = start + slope * t
        for value, (role, result) in zip(values, subject.solutions, strict=True):
            sigma = subject.sigma(result, block)[:, i] / p.factor
            low, high = value - trend - 3.0 * sigma, value - trend + 3.0 * sigma
            own = "sigma" if result is subject.result else "sigma_smoothed"
            items.append(band(t, low, high, own, f"{role} ±3 sigma"))
            edges += [low, high]
            estimates.append(value - trend)
        items += [
            line(t, v, role, role, limit=SLOW_LIMIT) for v, (role, _) in zip(estimates, subject.solutions, strict=True)
        ]
        if subject.truth is not None:
            true = subject.truth[:, part.start - 9 + i] / p.factor - trend
            items.append(line(t, true, "reference", "true", limit=SLOW_LIMIT))
            estimates.append(true)
        title = f"less {start:.0f} m {'+' if slope >= 0.0 else '-'} {abs(slope):.2f} m/s × time" if trend.any() else ""
        # a clock is found with the first satellites, from anywhere: that step must not flatten all the rest
        first = len(t) // 20 if block in _CLOCKS else 0
        limits = view([v[first:] for v in estimates], [v[first:] for v in edges])
        label = f"{element} [{p.unit}]"
        panels.append(Panel(TIME, label, tuple(items), title=title, x_limits=subject.span, y_limits=limits))
    return panels


def _elements(subject: Subject, p: Parameter) -> tuple[str, ...]:
    """Names of the elements; of the clocks between systems with the systems' letters where they are known."""
    systems = subject.ranges.groups if subject.ranges is not None else ()
    if p.block.startswith("clock_") and p.block[6:].isdigit() and int(p.block[6:]) <= len(systems):
        return (f"{systems[int(p.block[6:]) - 1]} against {systems[0]}",)
    return p.elements


def parameter_rows(subject: Subject) -> list[tuple[str, str, str, str]]:
    """Rows of a table: name with unit, last estimate with 1-sigma, true value or nothing, share of first sigma left."""
    result = subject.result
    if not len(result.t):
        return []
    rows = []
    for block, model in result.layout.models.items():
        p = parameter(result, block)
        value, sigma = result.parameter(block)[-1] / p.factor, subject.sigma(result, block)[-1] / p.factor
        for i, element in enumerate(_elements(subject, p)):
            true = ""
            if subject.truth is not None:
                true = _like(subject.truth[-1, result.layout[block].start - 9 + i] / p.factor, sigma[i])
            left = f"{100.0 * sigma[i] * p.factor / model.sigma:.0f} %" if model.sigma > 0.0 else "-"
            rows.append(
                (
                    f"{p.name}{'' if element in p.name.split() else ' ' + element} [{p.unit}]",
                    f"{_like(value[i], sigma[i])} ± {_like(sigma[i], sigma[i])}",
                    true,
                    left,
                )
            )
    return rows


def _like(value: float, sigma: float) -> str:
    """Number with the decimals of its uncertainty's two leading digits."""
    if not (np.isfinite(sigma) and sigma > 0.0):
        return f"{value:.4g}"
    places = int(np.clip(1 - np.floor(np.log10(sigma)), 0, 9))
    return f"{value:.{places}f}"
