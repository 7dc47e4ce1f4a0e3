"""Estimated sensor parameters over time, in the units of data sheets."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from schuler import units
from schuler.arrays import FloatArray
from schuler.filtering.result import NavigationResult
from schuler.filtering.states import BLOCK_TEXT
from schuler.report.content import Figure, Item, Panel, band, line, view
from schuler.report.subject import Subject
from schuler.report.track import TIME, outages

_XYZ = ("x", "y", "z")
_PAIRS = ("xy", "xz", "yx", "yz", "zx", "zy")
_ELEMENTS = {
    "M_a": ("xy", "xz", "yz"), "M_a6": _PAIRS, "M_g": _PAIRS, "G_g": tuple(a + b for a in _XYZ for b in _XYZ),
    "lever": ("forward", "right", "down"),
}  # fmt: skip
_UNITS = {
    "m/s^2": ("mg", units.MG), "rad/s": ("deg/h", units.DEG_PER_HR), "1": ("ppm", units.PPM), "rad": ("mrad", 1e-3),
    "(rad/s)/(m/s^2)": ("deg/h/g", units.DEG_PER_HR_PER_G), "m": ("m", 1.0),
}  # fmt: skip
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
    """How a block is shown; a gyro bias in deg/s if it is that large, in deg/h otherwise."""
    text, si = BLOCK_TEXT[block]
    unit, factor = _UNITS[si]
    if si == "rad/s" and len(result.t) and np.abs(result.parameter(block)).max() > _COARSE_GYRO:
        unit, factor = "deg/s", units.DEG
    elements = _ELEMENTS.get(block, _XYZ)
    # BLOCK_TEXT names the elements behind the name where they are not x, y, z
    name = text.split(" xy")[0].split(", row by row")[0].split(", body axes")[0]
    return Parameter(block, name, unit, elements, factor)


def parameters(subject: Subject, block: str) -> Figure:
    """Estimate, 3-sigma band and truth of every element of a block."""
    p = parameter(subject.result, block)
    part = subject.result.layout[block]
    t = subject.seconds(subject.result.t)
    panels = []
    for i, element in enumerate(p.elements):
        items: list[Item] = [*outages(subject)]
        estimates: list[FloatArray] = []
        edges: list[FloatArray] = []
        for role, result in subject.solutions:
            value, sigma = result.parameter(block)[:, i] / p.factor, subject.sigma(result, block)[:, i] / p.factor
            own = "sigma" if result is subject.result else "sigma_smoothed"
            items.append(band(t, value - 3.0 * sigma, value + 3.0 * sigma, own, f"{role} ±3 sigma"))
            edges += [value - 3.0 * sigma, value + 3.0 * sigma]
            estimates.append(value)
        items += [line(t, v, role, role) for v, (role, _) in zip(estimates, subject.solutions, strict=True)]
        if subject.truth is not None:
            true = subject.truth[:, part.start - 9 + i] / p.factor
            items.append(line(t, true, "reference", "true"))
            estimates.append(true)
        limits = view(estimates, edges)
        panels.append(Panel(TIME, f"{element} [{p.unit}]", tuple(items), x_limits=subject.span, y_limits=limits))
    caption = (
        f"Estimate of the {p.name} ({', '.join(p.elements)}) with three standard deviations: the band narrows as far "
        "as the motion makes the parameter visible"
        + (
            ", and should hold the true value."
            if subject.truth is not None
            else ", and a parameter that stays as wide was not seen."
        )
    )
    return Figure(f"parameters_{block}", f"{p.name[0].upper()}{p.name[1:]}", caption, tuple(panels), columns=3)


def parameter_rows(subject: Subject) -> list[tuple[str, str, str, str]]:
    """Rows of a table: name with unit, last estimate with 1-sigma, true value or nothing, share of first sigma left."""
    result = subject.result
    if not len(result.t):
        return []
    rows = []
    for block, model in result.layout.models.items():
        p = parameter(result, block)
        value, sigma = result.parameter(block)[-1] / p.factor, subject.sigma(result, block)[-1] / p.factor
        for i, element in enumerate(p.elements):
            true = ""
            if subject.truth is not None:
                true = _like(subject.truth[-1, result.layout[block].start - 9 + i] / p.factor, sigma[i])
            left = f"{100.0 * sigma[i] * p.factor / model.sigma:.0f} %" if model.sigma > 0.0 else "-"
            rows.append(
                (
                    f"{p.name} {element} [{p.unit}]",
                    f"{_like(value[i], sigma[i])} ± {_like(sigma[i], sigma[i])}",
                    true,
                    left,
                )
            )
    return rows


def _like(value: float, sigma: float) -> str:
    """A number with as many digits as its uncertainty deserves: two of the sigma."""
    if not (np.isfinite(sigma) and sigma > 0.0):
        return f"{value:.4g}"
    places = int(np.clip(1 - np.floor(np.log10(sigma)), 0, 9))
    return f"{value:.{places}f}"
