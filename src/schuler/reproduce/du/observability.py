"""Sections 5.1 to 5.3 and 6.2: what velocity determines, as formulas and in numbers."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import TYPE_CHECKING, Any

import numpy as np

from schuler.exceptions import MissingExtraError
from schuler.reproduce.cells import Cell, claimed, digits, shown
from schuler.reproduce.items import Effort, Item, Outcome
from schuler.units import DEG, DEG_PER_HR

if TYPE_CHECKING:
    from schuler.observability import LinearSystem
    from schuler.plotting.figure import Figure

_RATE, _LAT, _TIME_S = 10.0 * DEG, 45.75 * DEG, 300.0
#: Prior of attitude, velocity, accelerometer and gyroscope biases: NAV440.
_SIGMA = np.repeat([DEG, 0.01, 0.2, 400.0 * DEG_PER_HR], 3)
_SWAP = {"X": (0.0, 1.0, 0.0), "Y": (1.0, 0.0, 0.0), "Z": (0.0, 0.0, -1.0)}

#: Axis, roll, pitch, azimuth [deg]; ranks of an independent check without and with the Earth's rate.
_RANKS = (
    (None, 0.0, 0.0, 0.0, 8, 9), ("X", 0.0, 0.0, 0.0, 10, 10), ("X", 0.0, 30.0, 0.0, 10, 10),
    ("X", 0.0, 0.0, 40.0, 10, 11), ("X", 30.0, 0.0, 0.0, 11, 12), ("Y", 0.0, 0.0, 0.0, 10, 12),
    ("Y", 30.0, 0.0, 0.0, 10, 12), ("Y", 0.0, 30.0, 0.0, 11, 12), ("Z", 0.0, 0.0, 0.0, 8, 10),
    ("Z", 0.0, 30.0, 0.0, 11, 12), ("Z", 5.0, 0.0, 40.0, 11, 12),
)  # fmt: skip


def _symbolic(run: Callable[[Effort], Outcome]) -> Callable[[Effort], Outcome]:
    """Without SymPy there is nothing to show, but the other items are not lost."""

    def guarded(effort: Effort) -> Outcome:
        try:
            return run(effort)
        except MissingExtraError as error:
            return Outcome((shown("not computed", float("nan")),), str(error))

    return guarded


def _table_5_1(effort: Effort) -> Outcome:
    from schuler.observability import symbolic
    from schuler.reproduce.du.study.observability_tables import table_5_1

    model = symbolic.rotary_model(None, biases="navigation")
    combinations, table = symbolic.observable_combinations(model), table_5_1(model)
    inside = [symbolic.same_span(model, combinations, [*combinations, c]) for c in table]
    cells = (
        digits("combinations of the table that velocity determines", "9", float(sum(inside))),
        digits("all combinations that it determines", "9", float(symbolic.symbolic_rank(model))),
        digits("states determined by themselves", "4", float(len(symbolic.observable_states(model)))),
    )
    return Outcome(
        cells,
        "Our observability matrix has its blocks below each other; the source writes them side by side, and the sign "
        "of (5.7) reversed.",
        (lambda: _singular_figure(None, 0.0),),
    )


def _table_5_2(effort: Effort) -> Outcome:
    from schuler.observability import symbolic
    from schuler.reproduce.du.study.observability_tables import closed, table_5_2

    cells: list[Cell] = []
    axes: tuple[Any, ...] = ("z",) if effort.quick else ("x", "y", "z")
    for axis in axes:
        title = f"about {axis.upper()}"
        model = symbolic.rotary_model(axis, biases="navigation")
        combinations, table = symbolic.observable_combinations(model), table_5_2(model)
        inside = [symbolic.same_span(model, combinations, [*combinations, c]) for c in table]
        spans_all = symbolic.same_span(model, combinations, closed(model, table))
        cells += [
            digits(f"{title}: combinations of the table that velocity determines", "8", float(sum(inside))),
            claimed(f"{title}: with their derivatives they are all there is", "not in the thesis",
                 float(spans_all), low=0.5, tolerance="rounding", reference="corrected"),
        ]  # fmt: skip
    return Outcome(
        tuple(cells),
        "b_U(t) in the table stands for its derivatives too: the eight combinations alone are not all, with their "
        "derivatives they are. Three unknowns need b_U and two derivatives, where the text says one.",
        (lambda: _singular_figure("Z", 30.0),),
    )


@cache
def _system(
    axis: str | None, roll: float, pitch: float, azimuth: float = 0.0, *, earth: bool = False, step: float = 0.5
) -> LinearSystem:
    from schuler.earth import WGS84
    from schuler.observability import RotaryModel, in_du_axes, model_system

    model = RotaryModel(
        axis=_SWAP[axis] if axis else None, rate=_RATE, rpy_nb=(roll * DEG, pitch * DEG, azimuth * DEG), lat=_LAT,
        earth_rate=WGS84.omega_ie if earth else 0.0,
    )  # fmt: skip
    return in_du_axes(model_system(model, duration=_TIME_S, rate_hz=1.0, sigma=_SIGMA, step=step))


def _step(effort: Effort) -> float:
    """Step of the transitions, sixth order: 5 deg of rotation are enough for every rank. [s]"""
    return 0.5 if effort.quick else 0.1


def _verdict(
    axis: str, pitch: float, roll: float, unseen: set[str], rank: int, effort: Effort
) -> tuple[list[Cell], set[str]]:
    from schuler.observability import spectrum

    singular = spectrum(_system(axis, roll, pitch, step=_step(effort)))
    names = {n for n, yes in zip(singular.names, singular.observable(), strict=True) if not yes}
    title = f"about {axis}, roll {roll:g}, pitch {pitch:g} deg"
    return [
        digits(f"{title}: combinations determined", str(rank), float(singular.rank)),
        digits(f"{title}: states not determined by themselves", str(len(unseen)), float(len(names))),
        claimed(f"{title}: of these, others than the thesis names", ", ".join(sorted(unseen)),
             float(len(names - unseen)), high=0.5, tolerance="rounding"),
    ], names  # fmt: skip


#: Axis, roll, pitch [deg]; states the thesis says stay unobservable; combinations that leaves of twelve.
_VERDICTS: dict[str, tuple[tuple[float, float, set[str], int], ...]] = {
    # roll zero: b_X and the tilt coupled to it, together one direction
    "X": ((0.0, 0.0, {"eps_U", "b_x", "eps_N"}, 10), (30.0, 0.0, {"eps_U"}, 11)),
    "Y": ((0.0, 0.0, {"eps_U", "b_y", "eps_E"}, 10), (0.0, 30.0, {"eps_U"}, 11)),
    "Z": (
        (0.0, 0.0, {"eps_E", "eps_N", "eps_U", "b_x", "b_y", "d_x", "d_y", "d_z"}, 8), (0.0, 30.0, {"eps_U"}, 11),
        (30.0, 0.0, {"eps_U"}, 11),
    ),
}  # fmt: skip


def _axis(axis: str, effort: Effort) -> Outcome:
    cells: list[Cell] = []
    for roll, pitch, unseen, rank in _VERDICTS[axis]:
        cells += _verdict(axis, pitch, roll, unseen, rank, effort)[0]
    text = "Without the Earth's rate, as gyroscopes of low cost see it; with it the azimuth is seen too, weakly. "
    if axis == "Z":
        text += "Level, as many combinations are seen as without rotation, but horizontal biases and tilts are mixed."
    return Outcome(tuple(cells), text + _ERRATA.get(axis, ""), (lambda: _singular_figure(axis, 0.0),))


_ERRATA = {
    "X": "The text cites (2.18) for the azimuth; it is (2.17).",
    "Z": " (5.19) has the second row of the attitude matrix for the third.",
}


def _ranks(effort: Effort) -> Outcome:
    from schuler.observability import spectrum

    cells: list[Cell] = []
    for axis, roll, pitch, azimuth, without, with_earth in _RANKS:
        title = f"{'conventional' if axis is None else f'about {axis}'}, {roll:g}, {pitch:g}, {azimuth:g} deg"
        for earth, expected in ((False, without), (True, with_earth)):
            rank = spectrum(_system(axis, roll, pitch, azimuth, earth=earth, step=_step(effort))).rank
            cells.append(
                digits(f"{title}{': Earth rate' if earth else ''}", str(expected), float(rank), reference="corrected")
            )
    return Outcome(
        tuple(cells),
        "Ranks of the Gramian over 300 s, twelve states, roll, pitch and azimuth as named. The thesis gives verdicts "
        "in words; the numbers are those of an independent check.",
    )


def _singular_figure(axis: str | None, pitch: float) -> Figure:
    from schuler.reproduce.du.study.figures import singular_values

    title = "not turning" if axis is None else f"about {axis}, pitch {pitch:g} deg"
    return singular_values(_system(axis, 0.0, pitch), title)


def _manoeuvres(effort: Effort) -> Outcome:
    from schuler.observability import symbolic

    cells = []
    for axis, name in ((None, "conventional"), ("z", "about Z, level")):
        model = symbolic.rotary_model(axis, manoeuvre=True, earth=False)  # type: ignore[arg-type]
        cells.append(digits(f"{name}: combinations of twelve determined", "12", float(symbolic.symbolic_rank(model))))
    return Outcome(tuple(cells), "A horizontal acceleration whose direction changes; without the Earth's rate.")


ITEMS = (
    Item("table-5.1", "Combinations that velocity determines, conventional", "exact", _symbolic(_table_5_1)),
    Item("table-5.2", "Combinations that velocity determines, rotating", "exact", _symbolic(_table_5_2)),
    Item("text-5.3.1", "Rotation about X: what stays unobservable", "exact", lambda e: _axis("X", e)),
    Item("text-5.3.2", "Rotation about Y: what stays unobservable", "exact", lambda e: _axis("Y", e)),
    Item("text-5.3.3", "Rotation about Z: what stays unobservable", "exact", lambda e: _axis("Z", e)),
    Item("text-5.3", "Ranks of all schemes, with the Earth's rate and without", "exact", _ranks),
)
MANOEUVRES = Item("text-6.2", "Manoeuvres make everything observable", "exact", _symbolic(_manoeuvres))
