"""Statistics of a campaign in one pass: runs are seen once, in any order, and not kept.

Runs are gathered in blocks of :data:`BLOCK` (0 to 63, 64 to 127, ...); a complete block is reduced in the order of its
runs, and blocks are put together two by two along a tree that depends on their numbers alone. So the result is the same
to the last bit whatever the order in which runs finish, and what is held at a time is a handful of blocks.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from schuler.exceptions import InputError
from schuler.montecarlo.column import ColumnStatistics
from schuler.montecarlo.moments import Moments, Products, merged, merged_products, moments, products
from schuler.montecarlo.rows import Rows, check_alike, joined
from schuler.montecarlo.sketch import QuantileSketch
from schuler.plotting.notebook import Abridged

#: Runs that are reduced together; part of the result's last digits, so it is not an option.
BLOCK = 64


@dataclass(frozen=True, repr=False)
class Statistics(Abridged):
    """Which statistics are kept. Mean, sigma, skewness, kurtosis, smallest and largest always are.

    Attributes
    ----------
    quantiles : bool or tuple of str
        For all columns, none, or those named. They take most of the memory: up to some thousand counters for each
        number of a run.
    accuracy : float
        Largest error of a quantile as a share of its distance from what the first run gave, so of less than the range.
    covariance : tuple of str
        Columns whose covariance over their last axis is kept, such as a position error of shape (times, 3).
    """

    quantiles: bool | tuple[str, ...] = True
    accuracy: float = 0.005
    covariance: tuple[str, ...] = ()

    def keeps_quantiles(self, name: str) -> bool:
        """Whether a column's quantiles are kept."""
        return self.quantiles if isinstance(self.quantiles, bool) else name in self.quantiles


@dataclass(frozen=True)
class _Node:
    """Reduced runs; empty where none could be done."""

    columns: Mapping[str, Moments] = field(default_factory=dict)
    covariances: Mapping[str, Products] = field(default_factory=dict)

    def __add__(self, other: _Node) -> _Node:
        if not self.columns or not other.columns:
            return self if self.columns else other
        return _Node(
            {name: merged(m, other.columns[name]) for name, m in self.columns.items()},
            {name: merged_products(c, other.covariances[name]) for name, c in self.covariances.items()},
        )


class Accumulator:
    """Takes the rows of runs as they come and has the statistics of those it has seen.

    Parameters
    ----------
    keep : Statistics
    """

    def __init__(self, keep: Statistics | None = None) -> None:
        self.keep = keep or Statistics()
        self.shapes: dict[str, tuple[str, tuple[int, ...]]] = {}
        self.failures: dict[int, str] = {}
        self.done = 0
        self._open: dict[int, list[Rows]] = {}
        self._tree: dict[tuple[int, int], _Node] = {}
        self._sketches: dict[str, QuantileSketch] = {}
        # quantiles are kept of deviations from the first run that could be done; until it is known, runs wait
        self._first = 0
        self._centre: Rows | None = None
        self._early: list[Rows] = []

    def add(self, rows: Rows) -> None:
        """Take runs that were not seen before.

        Raises
        ------
        InputError
            If they gave other columns than those before, or a statistic is asked for of a column that is not there.
        """
        if len(rows.runs):
            if not self.shapes:
                self._begin(rows)
            check_alike(self.shapes, rows)
        self.failures |= rows.failures
        numbers = [*rows.runs.tolist(), *rows.failures]
        self.done += len(numbers)
        self._sketch(rows)
        for block in sorted({k // BLOCK for k in numbers}):
            waiting = self._open.setdefault(block, [])
            waiting.append(rows.where(block * BLOCK, block * BLOCK + BLOCK - 1))
            if sum(len(r.runs) + len(r.failures) for r in waiting) == BLOCK:
                self._close(block)

    def _begin(self, rows: Rows) -> None:
        self.shapes = rows.shapes
        named = () if isinstance(self.keep.quantiles, bool) else self.keep.quantiles
        for name in (*named, *self.keep.covariance):
            if name not in self.shapes:
                raise InputError(f"statistics: there is no column {name!r}; the runs give {', '.join(self.shapes)}")
        for name in self.keep.covariance:
            if not self.shapes[name][1]:
                raise InputError(f"statistics: {name} is one number; a covariance is of the last axis of an array")
        self._sketches = self._new_sketches()

    def _new_sketches(self) -> dict[str, QuantileSketch]:
        return {
            name: QuantileSketch(int(np.prod(shape)), self.keep.accuracy)
            for name, (_, shape) in self.shapes.items()
            if self.keep.keeps_quantiles(name)
        }

    def _sketch(self, rows: Rows) -> None:
        """Count values for quantiles, as soon as the first run is known."""
        if self._centre is None:
            self._early.append(rows)
            while self._first in self.failures:
                self._first += 1
            holding = [r for r in self._early if self._first in r.runs]
            if not holding:
                return
            self._centre = holding[0].where(self._first, self._first)
            for early in self._early:
                _count(self._sketches, early, self._centre)
            self._early = []
        else:
            _count(self._sketches, rows, self._centre)

    def _close(self, block: int) -> None:
        node, level, index = self._reduced(self._open.pop(block)), 0, block
        while (level, index ^ 1) in self._tree:
            other = self._tree.pop((level, index ^ 1))
            node = other + node if index & 1 else node + other
            level, index = level + 1, index >> 1
        self._tree[level, index] = node

    def _reduced(self, parts: list[Rows]) -> _Node:
        rows = joined(parts)
        if not len(rows.runs):
            return _Node()
        return _Node(
            {name: moments(_flat(rows, name)) for name in self.shapes},
            {name: products(rows.columns[name].astype(np.float64)) for name in self.keep.covariance},
        )

    def statistics(self) -> dict[str, ColumnStatistics]:
        """Statistics of the runs seen so far, by column; empty if none could be done."""
        nodes = {index << level: node for (level, index), node in self._tree.items()}
        nodes |= {block: self._reduced(parts) for block, parts in self._open.items()}
        total = _Node()
        for first in sorted(nodes):
            total = total + nodes[first]
        sketches, centre = self._sketches, self._centre
        if centre is None and total.columns:
            # interrupted before the first run was done: from the first of those that are there
            early = joined(self._early)
            sketches, centre = self._new_sketches(), early.where(int(early.runs[0]), int(early.runs[0]))
            _count(sketches, early, centre)
        columns = {}
        for name, m in total.columns.items():
            middle = None if centre is None else _flat(centre, name)[0]
            columns[name] = ColumnStatistics(
                name, self.shapes[name][1], m, sketches.get(name), middle, total.covariances.get(name)
            )
        return columns


def _flat(rows: Rows, name: str) -> np.ndarray[tuple[int, int], np.dtype[np.float64]]:
    """A column as float64 in one order of memory, in which sums are always taken alike. Shape (n, e)."""
    x = rows.columns[name]
    return np.ascontiguousarray(x, dtype=np.float64).reshape(len(x), -1)


def _count(sketches: Mapping[str, QuantileSketch], rows: Rows, centre: Rows) -> None:
    for name, sketch in sketches.items() if len(rows.runs) else ():
        sketch.add(_flat(rows, name) - _flat(centre, name))
