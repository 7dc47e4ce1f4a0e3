"""The tables and figures of five theses, each beside ours: what was printed, what comes out here, and why they differ.

One module a thesis, each a tuple ``ITEMS``; all computing is in the library below.
"""

from __future__ import annotations

from schuler.reproduce.cells import Cell, against, claimed, digits, shown
from schuler.reproduce.items import Effort, Item, Outcome, Result
from schuler.reproduce.run import THESES, Reproduction, reproduce

__all__ = [
    "THESES",
    "Cell",
    "Effort",
    "Item",
    "Outcome",
    "Reproduction",
    "Result",
    "against",
    "claimed",
    "digits",
    "reproduce",
    "shown",
]
