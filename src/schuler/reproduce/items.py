"""A table or figure of a thesis: how it is computed here, and the verdict."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Literal, TypeAlias

from schuler.reproduce.cells import Cell

if TYPE_CHECKING:
    from schuler.plotting.figure import Figure

#: exact: formulas and printed digits. statistical: random numbers. hardware: recorded by sensors we do not have, and
#: emulated by simulated ones of the same parameters.
Kind: TypeAlias = Literal["exact", "statistical", "hardware"]

#: What an item shows, from its numbers and bands alone. See docs/reproduction.md. agrees: every number that is compared
#: is met, and of those the thesis prints one at least, which was not put in, within a factor of two. in part: the same,
#: but a printed number that is not compared is a fifth or more off. differs: a number is outside its band. These three
#: could have come out otherwise (:data:`DECIDED`); the others could not, or hardly: within noise: other seeds give the
#: other verdict. weak: met, but no band is narrower than a factor of two. pattern only: an ordering or a shape is met,
#: no number. transcribed: every number is one that was put in. corrected: the thesis's equations after their errors
#: are mended are met, not (or not comparably) what it prints. shown: the thesis prints nothing to compare with.
Verdict: TypeAlias = Literal[
    "agrees", "in part", "differs", "within noise", "weak", "pattern only", "transcribed", "corrected", "shown"
]
VERDICTS: tuple[Verdict, ...] = (
    "agrees", "in part", "differs", "within noise", "weak", "pattern only", "transcribed", "corrected", "shown"
)  # fmt: skip
#: Verdicts that could have been others; only these make a headline.
DECIDED: tuple[Verdict, ...] = ("agrees", "in part", "differs")


@dataclass(frozen=True)
class Effort:
    """Amount of work to put in; modules cache what several items need by it.

    Attributes
    ----------
    quick : bool
        Reduced runs, the bands wider as their statistics ask for.
    seed : int
    """

    quick: bool = True
    seed: int = 1

    def runs(self, quick: int, full: int) -> int:
        """Runs of a campaign."""
        return quick if self.quick else full


@dataclass(frozen=True, eq=False)
class Outcome:
    """Outcome of one item.

    Attributes
    ----------
    cells : tuple of Cell
        At least one.
    reason : str
        Why cells differ from the thesis: an error of the source, a parameter it leaves out, hardware. Needed where one
        differs or is compared with corrected equations only.
    figures : tuple of callable
        Each gives a figure for page and paper, called only where one is asked for.
    """

    cells: tuple[Cell, ...]
    reason: str = ""
    figures: tuple[Callable[[], Figure], ...] = field(default=(), repr=False)


@dataclass(frozen=True)
class Item:
    """A table, figure or claim of a thesis.

    Attributes
    ----------
    id : str
        Such as ``table-5.3``, ``fig-3.7``, ``text-4.2``; unique in its thesis. One item may stand for several figures
        of one experiment: ``fig-3.10`` with ``also`` naming the others.
    title : str
        What it shows, in our words.
    kind : str
        ``exact``, ``statistical`` or ``hardware`` (which is emulated).
    run : callable
        Effort to outcome.
    also : tuple of str
        Ids of others that this one covers.
    flips : str
        Which of some seeds agree and which differ, where they do not all say the same; empty otherwise. Such an item
        decides nothing.
    """

    id: str
    title: str
    kind: Kind
    run: Callable[[Effort], Outcome]
    also: tuple[str, ...] = ()
    flips: str = ""


@dataclass(frozen=True, eq=False)
class Result:
    """An item and what it gave.

    Attributes
    ----------
    item : Item
    outcome : Outcome
    elapsed_s : float
    """

    item: Item
    outcome: Outcome
    elapsed_s: float

    @property
    def verdict(self) -> Verdict:
        """From the cells alone; see :data:`Verdict`."""
        cells = self.outcome.cells
        compared = [c for c in cells if c.compared]
        if not compared:
            return "shown"
        if self.item.flips:
            return "within noise"
        if not all(c.agrees for c in compared):
            return "differs"
        theirs = [c for c in compared if c.reference == "thesis"]
        if not theirs:
            return "corrected"
        free = [c for c in theirs if not c.transcribed]
        if not free:
            return "transcribed"
        if not any(c.decisive for c in free):
            return "weak" if any(c.numeric for c in free) else "pattern only"
        return "in part" if any(c.left_out for c in cells) else "agrees"

    def to_dict(self) -> dict[str, Any]:
        """Plain values; ``printed`` and ``ours`` by the name of each cell."""
        cells = self.outcome.cells
        return {
            "id": self.item.id, "title": self.item.title, "class": self.item.kind, "also": self.item.also,
            "printed": {c.name: c.printed for c in cells if c.printed}, "ours": {c.name: c.ours for c in cells},
            "verdict": self.verdict, "reason": self.outcome.reason, "flips": self.item.flips,
            "not_compared": {c.name: c.why for c in cells if c.uncompared}, "cells": [c.to_dict() for c in cells],
            "elapsed_s": self.elapsed_s,
        }  # fmt: skip
