"""Chapter 5: six sensors at rest, with gravity and without."""

from __future__ import annotations

from functools import cache
from math import sqrt
from typing import TYPE_CHECKING

import numpy as np

from schuler.growth import growth, second_order_vertical, spatial_bounds
from schuler.reproduce.cells import Cell, against, claimed, shown
from schuler.reproduce.flenniken.bands import ERRORS, deviation
from schuler.reproduce.flenniken.study.tables import SIX_DEGREES
from schuler.reproduce.items import Effort, Item, Outcome
from schuler.sensors.catalogue import spec
from schuler.units import DEG, G0

if TYPE_CHECKING:
    from schuler.growth import Bounds, Growth
    from schuler.plotting.figure import Figure

_SECONDS = 60.0
_CHECK_RUNS = 6000  # of the independent Monte Carlo
#: Samples of 10 Hz: 3 / k of a variance after k = 600 steps, and rounding of the check's three digits.
_SAMPLED = 0.01
_NAME = {"velocity": "m/s", "position": "m"}


@cache
def _bounds(grade: str, gravity: bool, effort: Effort) -> Bounds:
    return spatial_bounds(
        spec(f"flenniken-{grade}"), _SECONDS, rate_hz=10.0, runs=effort.runs(400, 4000), seed=effort.seed,
        gravity=G0 if gravity else 0.0,
    )  # fmt: skip


def _closed(grade: str, *, gravity: bool = True) -> Growth:
    t = np.array([_SECONDS])
    return growth(spec(f"flenniken-{grade}"), t) if gravity else growth(spec(f"flenniken-{grade}"), t, gravity=0.0)


def angles(grade: str, effort: Effort) -> Outcome:
    """Figures 5.2 and 5.3."""
    with_g, without = _bounds(grade, True, effort), _bounds(grade, False, effort)
    exact = float(_closed(grade).total("heading")[0]) / DEG
    cells: list[Cell] = []
    for name in ("roll", "pitch", "heading"):
        ours = float(with_g.sigma[name][-1]) / DEG
        cells += [
            against(f"60 s: {name}, with gravity over without", 1.0, ours / (float(without.sigma[name][-1]) / DEG),
                    absolute=1e-9, tolerance="rounding", source="gravity has no effect"),
            # rotations about several axes differ from sums of angles to second order: sigma squared
            deviation(f"60 s: {name}", exact, ours, with_g.runs, unit="deg", also=_SAMPLED + (exact * DEG) ** 2,
                      source="curve"),
        ]  # fmt: skip
    return Outcome(tuple(cells), "", (lambda: _figure(grade, ("roll", "pitch", "heading"), effort),))


def motion(grade: str, q: str, effort: Effort) -> Outcome:
    """Figures 5.4 to 5.7."""
    with_g, without = _bounds(grade, True, effort), _bounds(grade, False, effort)
    tilted, flat = (float(_closed(grade, gravity=g).total(q)[0]) for g in (True, False))
    unit = _NAME[q]
    v, p, up, v_flat, p_flat = SIX_DEGREES[grade]
    reference, reference_flat = (v, v_flat) if q == "velocity" else (p, p_flat)
    cells: list[Cell] = []
    for axis in ("north", "east"):
        ours = float(with_g.sigma[f"{q}_{axis}"][-1])
        cells += [
            deviation(f"60 s: {q} {axis}, gravity, closed form", tilted, ours, with_g.runs, unit=unit, also=_SAMPLED,
                      source="curve"),
            deviation(f"60 s: {q} {axis}, gravity, the check's runs", float(reference or 0.0), ours, with_g.runs,
                      theirs=_CHECK_RUNS, unit=unit, also=_SAMPLED, source="curve"),
            deviation(f"60 s: {q} {axis}, no gravity", flat, float(without.sigma[f"{q}_{axis}"][-1]), without.runs,
                      unit=unit, also=_SAMPLED, source="curve"),
        ]  # fmt: skip
        if reference_flat is not None:
            cells.append(
                deviation(f"60 s: {q} {axis}, no gravity, the check's runs", float(reference_flat),
                          float(without.sigma[f"{q}_{axis}"][-1]), without.runs, theirs=_CHECK_RUNS, unit=unit,
                          also=_SAMPLED, source="curve")
            )  # fmt: skip
    vertical = float(with_g.sigma[f"{q}_down"][-1])
    if q == "velocity":
        # a sum of squares of Gauss-Markov tilts: kurtosis up to 15 where it rules, so 2.6 times the usual error
        cells.append(
            against("60 s: velocity up, gravity, the check's runs", float(up or 0.0), vertical,
                    relative=ERRORS * sqrt(3.5 / with_g.runs + 3.5 / _CHECK_RUNS) + _SAMPLED, unit=unit,
                    reference="corrected", source="curve")
        )  # fmt: skip
    cells += _claims(grade, q, tilted / flat)
    if grade == "consumer" and q == "position":
        mean = -float(with_g.mean["position_down"][-1])
        expected = float(second_order_vertical(_SECONDS, spec("flenniken-consumer").gyro.in_run_bias))
        # the form takes the bias for constant: 60 s of 300 s take a fifth at most
        error = ERRORS * vertical / sqrt(with_g.runs) + 0.2 * abs(expected)
        cells.append(against("60 s: mean position up, second order of tilts", expected, mean, absolute=error, unit="m",
                             reference="corrected", source=""))  # fmt: skip
    reason = _REASON if grade == "tactical" else ""
    names = tuple(f"{q}_{axis}" for axis in ("north", "east", "down"))
    return Outcome(tuple(cells), reason, (lambda: _figure(grade, names, effort),))


_REASON = (
    "Slightly fits Table 2.2 as printed; with the LN-200's accelerometer noise, which chapter 3 needs, gravity triples "
    "the horizontal errors of tactical grade."
)


def _claims(grade: str, q: str, ratio: float) -> list[Cell]:
    """Gravity makes horizontal errors grow slightly faster, less than twice; or much faster, more than twice."""
    name = f"60 s: horizontal {q} over vertical, closed form"
    if grade == "consumer":
        return [claimed(name, "at a much faster rate", ratio, low=2.0)]
    printed = [float(_closed("tactical-printed", gravity=g).total(q)[0]) for g in (True, False)]
    return [
        claimed(
            f"{name}, Table 2.2 as printed", "at a slightly higher rate", printed[0] / printed[1], low=1.0, high=2.0
        ),
        shown(f"{name}, as the LN-200", ratio),
    ]


def _figure(grade: str, names: tuple[str, ...], effort: Effort) -> Figure:
    from schuler.growth.figures import beside_figure

    bounds = {"with gravity": _bounds(grade, True, effort), "without": _bounds(grade, False, effort)}
    t = bounds["without"].t
    forms = {}
    for label, g in (("with gravity, closed form", True), ("without, closed form", False)):
        imu = spec(f"flenniken-{grade}")
        form = growth(imu, t) if g else growth(imu, t, gravity=0.0)
        forms[label] = {
            name: form.total("heading" if name in ("roll", "pitch", "heading") else name.partition("_")[0])
            for name in names
            if not (g and name.endswith("_down"))  # first order: as without
        }
    return beside_figure(bounds, names, forms, f"Six sensors at rest, {grade} grade")


ITEMS = (
    Item("fig-5.2", "Tactical grade, six sensors: angles", "statistical", lambda e: angles("tactical", e)),
    Item("fig-5.3", "Consumer grade, six sensors: angles", "statistical", lambda e: angles("consumer", e)),
    Item(
        "fig-5.4", "Tactical grade, six sensors: velocity", "statistical", lambda e: motion("tactical", "velocity", e)
    ),
    Item(
        "fig-5.5", "Consumer grade, six sensors: velocity", "statistical", lambda e: motion("consumer", "velocity", e)
    ),
    Item(
        "fig-5.6", "Tactical grade, six sensors: position", "statistical", lambda e: motion("tactical", "position", e)
    ),
    Item(
        "fig-5.7", "Consumer grade, six sensors: position", "statistical", lambda e: motion("consumer", "position", e)
    ),
)
