"""Columns as they stand in a file, and errors that name the line of a row."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from schuler.arrays import FloatArray, IntArray
from schuler.exceptions import FileFormatError
from schuler.timebase import TimeBase

#: Numbers after which a counter of 32 bits begins again.
COUNTER = 2.0**32
HUGE = 1e30  # no quantity in any unit is as large; keeps later products finite


@dataclass
class Raw:
    """Columns as they stand in a file, what is known of their units, and how to name a row in a message.

    Attributes
    ----------
    path : Path
    values : dict
        Short column name to numbers. Shape (n,) each.
    stated : dict
        Column name to the unit the file states for it.
    line_of : callable
        Line of the file that holds a row, or ``None`` if it has no lines.
    unit : dict
        The unit in effect, filled in on the way.
    notes : list of str
    ellipsoidal : bool
        The file itself says that its heights are ellipsoidal.
    interval : float
        Median spacing of the stamps, filled in on the way. [s]
    time : TimeBase, optional
        Meaning of the stamps where the file states it, as dates do.
    negated : set of str
        Columns of the opposite sign, by the file's header.
    """

    path: Path
    values: dict[str, FloatArray]
    stated: dict[str, str] = field(default_factory=dict)
    line_of: Callable[[int], int | None] = lambda _row: None
    unit: dict[str, str] = field(default_factory=dict)
    notes: list[str] = field(default_factory=list)
    ellipsoidal: bool = False
    interval: float = float("nan")
    time: TimeBase | None = None
    negated: set[str] = field(default_factory=set)

    def fault(self, message: str, row: int | None = None) -> FileFormatError:
        """An error that names the row by its line, or in a file without lines by its number."""
        line = None if row is None else self.line_of(row)
        if row is not None and line is None:
            message = f"row {row + 1}: {message}"
        return FileFormatError(message, self.path, line)

    def has(self, names: Iterable[str]) -> bool:
        """Whether all of these columns are there."""
        return all(name in self.values for name in names)

    def keep(self, rows: IntArray) -> None:
        """Keep rows, in the order given; errors name their lines."""
        line_of = self.line_of
        self.values = {name: values[rows] for name, values in self.values.items()}
        self.line_of = lambda row: line_of(int(rows[row]))

    def stack(self, names: tuple[str, ...]) -> FloatArray:
        """Columns side by side; the array they are the columns of, if that is so. Shape (n, k)."""
        arrays = [self.values[name] for name in names]
        whole = arrays[0].base
        if (
            isinstance(whole, np.ndarray)
            and whole.shape == (len(arrays[0]), len(names))
            and whole.flags.c_contiguous
            and whole.dtype == np.float64
            and all(a.base is whole and a.ctypes.data == whole[:, k].ctypes.data for k, a in enumerate(arrays))
        ):
            return whole
        return np.stack(arrays, axis=1)


def reject_not_finite(raw: Raw, values: FloatArray) -> None:
    """Raise at the first row that holds NaN, infinity or an impossibly large number. Shape (n, k)."""
    if values.size and not (values.max() <= HUGE and values.min() >= -HUGE):
        row = int(np.flatnonzero(~np.all(np.abs(values) <= HUGE, axis=1))[0])
        column = int(np.flatnonzero(~(np.abs(values[row]) <= HUGE))[0])
        raise raw.fault(
            f"column {column + 1}: expected a number, got {values[row, column]:g}; correct or delete the line", row
        )


def check_increasing(raw: Raw, t: FloatArray) -> None:
    """Raise at the first row whose time is not above that of the row before."""
    if not (t[1:] > t[:-1]).all() and np.any((step := np.diff(t)) <= 0.0):
        row = int(np.flatnonzero(step <= 0.0)[0]) + 1
        what = "repeats the time of" if step[row - 1] == 0.0 else "is earlier than"
        raise raw.fault(
            f"expected increasing times, but {t[row]:.6f} s {what} the row before ({t[row - 1]:.6f} s): delete "
            "repeated rows or sort the log",
            row,
        )
