"""Run the items of a thesis."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from importlib import import_module
from textwrap import wrap
from types import MappingProxyType
from typing import Any

from schuler.exceptions import InputError
from schuler.reproduce.cells import Cell
from schuler.reproduce.items import DECIDED, VERDICTS, Effort, Item, Result
from schuler.reproduce.seeds import FLIPS

#: Author and title by the name of the command; the module has the same name.
THESES: MappingProxyType[str, str] = MappingProxyType(
    {
        "yaman": "Yaman (2017), field calibration by an extended Kalman filter",
        "du": "Du (2015), rotary INS with a low-cost IMU",
        "hayal": "Hayal (2010), static multi-position calibration",
        "flenniken": "Flenniken (2005), IMU error models and error growth",
        "stefanisko": "Štefanisko (2015), INS/GNSS integration in the Earth frame",
    }
)


@dataclass(frozen=True, eq=False)
class Reproduction:
    """Results of a thesis.

    Attributes
    ----------
    thesis : str
        Name, one of :data:`THESES`.
    results : tuple of Result
        In the order of the thesis.
    effort : Effort
    complete : bool
        False if it was interrupted: results up to then.
    """

    thesis: str
    results: tuple[Result, ...]
    effort: Effort
    complete: bool = True

    @property
    def counts(self) -> dict[str, int]:
        """Items by verdict."""
        verdicts = [r.verdict for r in self.results]
        return {v: verdicts.count(v) for v in VERDICTS}

    def summary(self) -> str:
        """Every item in a line, reasons below; last a line with the counts."""
        lines = [THESES[self.thesis] + ("" if self.complete else " (INTERRUPTED: not all items)")]
        for r in self.results:
            compared = [c for c in r.outcome.cells if c.compared]
            met = f"{sum(bool(c.agrees) for c in compared)}/{len(compared)}" if compared else ""
            sharp = f"({sum(c.decisive and not c.transcribed for c in compared)})" if compared else ""
            lines.append(f"{r.item.id:<17} {r.item.kind:<11} {r.verdict:<12} {met:>7} {sharp:<5} {r.item.title}")
            reasons = [
                *(text for text in map(_differing, compared) if text),
                r.item.flips,
                *_left_out(r.outcome.cells),
                r.outcome.reason,
            ]
            for text in filter(None, reasons):
                lines += wrap(text, 120, initial_indent=" " * 16, subsequent_indent=" " * 18)
        return "\n".join([*lines, self.headline()])

    def headline(self) -> str:
        """Counts of what could have come out otherwise, then of the rest, in a sentence."""
        decided = sum(self.counts[v] for v in DECIDED)
        of_these = ", ".join(f"{n} {v}" for v, n in self.counts.items() if v in DECIDED and n)
        others = ", ".join(f"{n} {v}" for v, n in self.counts.items() if v not in DECIDED and n)
        text = f"{decided} of {len(self.results)} items could have told: {of_these or 'none'}"
        return f"{text}; the others: {others}" if others else text

    def to_dict(self) -> dict[str, Any]:
        """Plain values."""
        return {
            "thesis": self.thesis, "title": THESES[self.thesis], "quick": self.effort.quick, "seed": self.effort.seed,
            "complete": self.complete, "counts": self.counts, "items": [r.to_dict() for r in self.results],
        }  # fmt: skip


def items_of(thesis: str) -> tuple[Item, ...]:
    """The items of a thesis, in its order.

    Parameters
    ----------
    thesis : str
        One of :data:`THESES`.

    Returns
    -------
    tuple of Item

    Raises
    ------
    InputError
        If there is no such thesis.
    """
    if thesis not in THESES:
        raise InputError(f"reproduce: expected one of {', '.join(THESES)}, got {thesis!r}")
    items: tuple[Item, ...] = import_module(f"schuler.reproduce.{thesis}").ITEMS
    return items


def reproduce(
    thesis: str,
    items: Sequence[str] = (),
    *,
    quick: bool = True,
    seed: int = 1,
    progress: Callable[[float], None] | None = None,
) -> Reproduction:
    """Tables and figures of a thesis beside ours.

    Parameters
    ----------
    thesis : str
        One of :data:`THESES`.
    items : sequence of str
        Ids; all by default.
    quick : bool
        Reduced campaigns, about a minute a thesis; otherwise as many runs as the thesis.
    seed : int
    progress : callable, optional
        Given the fraction done.

    Returns
    -------
    Reproduction
        Interrupted from the keyboard: what is done by then, not ``complete``.

    Raises
    ------
    InputError
        If there is no such thesis or item.
    """
    available = items_of(thesis)
    by_id = {name: item for item in available for name in (item.id, *item.also)}
    for name in items:
        if name not in by_id:
            raise InputError(f"reproduce {thesis}: no item {name!r}; there are {', '.join(i.id for i in available)}")
    selected = {by_id[name].id for name in items} or {item.id for item in available}
    chosen = [item for item in available if item.id in selected]
    if quick:
        chosen = [replace(item, flips=FLIPS.get((thesis, item.id), "")) for item in chosen]
    effort = Effort(quick, seed)
    results: list[Result] = []
    try:
        for k, item in enumerate(chosen):
            began = time.perf_counter()
            results.append(Result(item, item.run(effort), time.perf_counter() - began))
            if progress is not None:
                progress((k + 1) / len(chosen))
    except KeyboardInterrupt:
        return Reproduction(thesis, tuple(results), effort, complete=False)
    return Reproduction(thesis, tuple(results), effort)


def _left_out(cells: Sequence[Cell]) -> list[str]:
    """Printed numbers that are not compared, a line for every reason; those a fifth or more apart are named."""
    lines = []
    for why in dict.fromkeys(c.why for c in cells if c.uncompared):
        group = [c for c in cells if c.why == why]
        far = [f"{c.name} (printed {c.printed}, ours {c.shown()})" for c in group if c.left_out]
        apart = f"; a fifth or more apart: {'; '.join(far)}" if far else ""
        lines.append(f"{len(group)} printed not compared ({why}){apart}")
    return lines


def _differing(cell: Cell) -> str:
    if cell.agrees:
        return ""
    return f"{cell.name}: {cell.shown()} {cell.unit}".rstrip() + f", expected {cell.band()} (printed: {cell.printed})"
