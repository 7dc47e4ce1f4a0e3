"""Columns of numbers that grow at the end and are dropped from the front, in memory that is used again."""

from __future__ import annotations

from typing import Any

import numpy as np

from schuler.arrays import FloatArray


class Columns:
    """Arrays of equally many rows with names.

    Rows that are appended cost no allocation, except where more are kept than ever before.

    Parameters
    ----------
    **widths : int
        Width of each column's rows; 0 for single numbers.

    Examples
    --------
    ``fixes = Columns(t=0, llh=3)``, ``fixes.append(t=[1.0], llh=[[0.7, 0.1, 300.0]])``, ``fixes["t"]``.
    """

    def __init__(self, **widths: int) -> None:
        self.widths = widths
        self._arrays = {name: np.empty((256, width) if width else 256) for name, width in widths.items()}
        self._first = self._stop = 0

    def __len__(self) -> int:
        return self._stop - self._first

    def __getitem__(self, name: str) -> FloatArray:
        """The rows of a column, a view. Shape (n,) or (n, width)."""
        return self._arrays[name][self._first : self._stop]

    def append(self, **rows: Any) -> None:
        """Append rows of all columns."""
        m = len(rows["t"])
        self._make_room(m)
        for name, array in self._arrays.items():
            array[self._stop : self._stop + m] = rows[name]
        self._stop += m

    def drop(self, count: int) -> None:
        """Drop the first rows."""
        self._first = min(self._first + count, self._stop)

    def drop_before(self, t: float) -> None:
        """Drop the rows whose column ``t``, which increases, is smaller."""
        self.drop(int(np.searchsorted(self["t"], t)))

    def document(self) -> dict[str, FloatArray]:
        """The rows by name, for files."""
        return {name: self[name].copy() for name in self.widths}

    def restore(self, document: dict[str, FloatArray]) -> None:
        """Take the rows of a :meth:`document`, and none else."""
        self.drop(len(self))
        self.append(**document)

    def _make_room(self, m: int) -> None:
        n, size = len(self), len(self._arrays["t"])
        if self._stop + m <= size:
            return
        for name, array in self._arrays.items():
            kept = array[self._first : self._stop]
            if 2 * (n + m) > size:
                array = np.empty((2 * (n + m), *array.shape[1:]))
            array[:n] = kept.copy()
            self._arrays[name] = array
        self._first, self._stop = 0, n
