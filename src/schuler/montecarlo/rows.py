"""What runs give: named numbers and arrays of one shape each, a row for every run."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from schuler.arrays import IntArray
from schuler.exceptions import InputError
from schuler.plotting.notebook import Abridged

#: Kinds of numbers that are kept, by numpy's letter, as what they are kept.
_KEPT = {"f": np.float64, "i": np.int64, "u": np.int64, "b": np.bool_}
_NAME = re.compile(r"[A-Za-z]\w*")


@dataclass(frozen=True, repr=False)
class Rows(Abridged):
    """Results of some runs.

    Attributes
    ----------
    runs : ndarray of int, shape (n,)
        Numbers of the runs that could be done, ascending.
    columns : dict of str to ndarray, shape (n, ...)
        Results: float64, int64 or bool, finite.
    failures : dict of int to str
        Runs that could not be done, and why.
    """

    runs: IntArray
    columns: Mapping[str, NDArray[Any]]
    failures: Mapping[int, str] = field(default_factory=dict)

    @property
    def shapes(self) -> dict[str, tuple[str, tuple[int, ...]]]:
        """Type and shape of what one run gives, by name; empty if no run could be done."""
        return {name: (x.dtype.name, x.shape[1:]) for name, x in self.columns.items()}

    def where(self, first: int, last: int) -> Rows:
        """Runs ``first`` to ``last``, both included."""
        a, b = np.searchsorted(self.runs, (first, last + 1))
        return Rows(
            self.runs[a:b],
            {name: x[a:b] for name, x in self.columns.items()},
            {k: why for k, why in self.failures.items() if first <= k <= last},
        )


def row(run: int, result: Any) -> Rows:
    """The row of one run; a failure if something it gave is not finite."""
    if not isinstance(result, Mapping):
        raise InputError(
            f"run {run}: the function gave {type(result).__name__}; expected a dictionary of numbers and arrays"
        )
    return batch_rows([run], {name: np.asarray(value)[None] for name, value in result.items()})


def batch_rows(runs: Sequence[int], result: Any) -> Rows:
    """Rows of a batch: arrays whose first axis are the runs; those with something not finite are failures.

    Raises
    ------
    InputError
        If it is no dictionary of such arrays, or they hold something other than numbers.
    """
    who = f"run {runs[0]}" if len(runs) == 1 else f"runs {runs[0]} to {runs[-1]}"
    if not isinstance(result, Mapping) or not result:
        raise InputError(f"{who}: the function gave {result!r:.80}; expected a dictionary of numbers and arrays")
    columns: dict[str, NDArray[Any]] = {}
    good = np.ones(len(runs), dtype=bool)
    why: dict[int, str] = {}
    for name, value in result.items():
        if not isinstance(name, str) or not _NAME.fullmatch(name) or name == "run":
            raise InputError(f"{who}: {name!r} is no name of a column: letters, digits and _, and not 'run'")
        x = np.asarray(value)
        if x.dtype.kind not in _KEPT:
            raise InputError(f"{who}: {name} is of type {x.dtype}; expected numbers (texts and objects are not kept)")
        if x.ndim < 1 or len(x) != len(runs) or x.size == 0:
            raise InputError(f"{who}: {name} has shape {x.shape}; expected ({len(runs)}, ...), nothing of it empty")
        x = np.ascontiguousarray(x, dtype=_KEPT[x.dtype.kind])
        if x.dtype.kind == "f":
            for k in np.flatnonzero(~np.isfinite(x.reshape(len(x), -1)).all(axis=1)):
                why.setdefault(int(k), f"{name} is not finite")
                good[k] = False
        columns[name] = x
    numbers = np.asarray(runs, dtype=np.int64)
    return Rows(
        numbers[good],
        columns if good.all() else {name: x[good] for name, x in columns.items()},
        {int(numbers[k]): text for k, text in why.items()},
    )


def joined(parts: Iterable[Rows]) -> Rows:
    """Rows of several parts as one, ascending.

    Raises
    ------
    InputError
        If runs gave different columns, types or shapes.
    """
    given = list(parts)
    full = [p for p in given if len(p.runs)]
    failures = {k: why for p in given for k, why in p.failures.items()}
    if not full:
        return Rows(np.zeros(0, dtype=np.int64), {}, failures)
    for p in full:
        check_alike(full[0].shapes, p)
    runs = np.concatenate([p.runs for p in full])
    order = np.argsort(runs, kind="stable")
    columns = {name: np.concatenate([p.columns[name] for p in full])[order] for name in full[0].columns}
    return Rows(runs[order], columns, dict(sorted(failures.items())))


def check_alike(expected: Mapping[str, tuple[str, tuple[int, ...]]], rows: Rows) -> None:
    """Refuse rows whose columns differ from those of other runs."""
    shapes = rows.shapes
    if not shapes or not expected or shapes == expected:
        return
    for name in dict.fromkeys((*expected, *shapes)):
        if expected.get(name) != shapes.get(name):
            a, b = (_column_text(d.get(name)) for d in (expected, shapes))
            raise InputError(
                f"run {rows.runs[0]}: {name} is {b}, but {a} in other runs; every run must give the same columns"
            )


def _column_text(what: tuple[str, tuple[int, ...]] | None) -> str:
    return "missing" if what is None else f"{what[0]} of shape {what[1]}"
