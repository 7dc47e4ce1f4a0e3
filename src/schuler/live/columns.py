"""Columns of numbers that grow at the end and are dropped from the front, in memory that is used again."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from schuler.arrays import FloatArray, IntArray


class Columns:
    """Arrays of equally many rows with names.

    Rows that are appended cost no allocation, except where more are kept than ever before.

    Parameters
    ----------
    integers : sequence of str
        Columns of whole numbers.
    **widths : int
        Width of each column's rows; 0 for single numbers.

    Examples
    --------
    ``fixes = Columns(t=0, llh=3)``, ``fixes.append(t=[1.0], llh=[[0.7, 0.1, 300.0]])``, ``fixes["t"]``.
    """

    def __init__(self, integers: Sequence[str] = (), **widths: int) -> None:
        self.widths = widths
        #: All of the memory by name, and not the rows alone; see :meth:`room`.
        self.memory: dict[str, Any] = {
            name: np.empty((256, width) if width else 256, np.int64 if name in integers else np.float64)
            for name, width in widths.items()
        }
        self._first = self._stop = 0

    def __len__(self) -> int:
        return self._stop - self._first

    def __getitem__(self, name: str) -> Any:
        """The rows of a column, a view. Shape (n,) or (n, width)."""
        return self.memory[name][self._first : self._stop]

    def append(self, **rows: Any) -> None:
        """Append rows of all columns."""
        m = len(rows["t"])
        self.room(m)
        for name, array in self.memory.items():
            array[self._stop : self._stop + m] = rows[name]
        self._stop += m

    def room(self, m: int) -> int:
        """Place in :attr:`memory` of the next row, with room for m, which are not appended yet: :meth:`grow`."""
        self._make_room(m)
        return self._stop

    def grow(self, m: int) -> None:
        """Append m rows that were written into the memory."""
        self._stop += m

    def drop(self, count: int) -> None:
        """Drop the first rows."""
        self._first = min(self._first + count, self._stop)

    def drop_before(self, t: float) -> None:
        """Drop the rows whose column ``t``, which increases, is smaller."""
        self.drop(int(self["t"].searchsorted(t)))

    def document(self) -> dict[str, FloatArray | IntArray]:
        """The rows by name, for files."""
        return {name: self[name].copy() for name in self.widths}

    def restore(self, document: dict[str, Any]) -> None:
        """Take the rows of a :meth:`document`, and none else."""
        self.drop(len(self))
        self.append(**document)

    def _make_room(self, m: int) -> None:
        n, size = len(self), len(self.memory["t"])
        if self._stop + m <= size:
            return
        for name, array in self.memory.items():
            kept = array[self._first : self._stop]
            if 2 * (n + m) > size:
                array = np.empty((2 * (n + m), *array.shape[1:]), array.dtype)
            array[:n] = kept.copy()
            self.memory[name] = array
        self._first, self._stop = 0, n
