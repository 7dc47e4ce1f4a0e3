"""A table of a campaign: rows of numbers with units in the column names, as text, Markdown, CSV or dictionary."""

from __future__ import annotations

import csv
import io
import math
from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeAlias

from schuler.exceptions import InputError
from schuler.files import write_text
from schuler.plotting.notebook import Displayed

Cell: TypeAlias = "str | int | float | bool | None"


@dataclass(frozen=True, repr=False)
class ResultTable(Displayed):
    """What a campaign found, one row a case.

    Attributes
    ----------
    title : str
    columns : tuple of str
        Names with their unit as suffix, such as ``rms_horizontal_m``.
    rows : tuple of tuple
        Text, numbers, or None where there is nothing to say.
    notes : tuple of str
        Sentences below the table.
    complete : bool
        False if the campaign was interrupted: rows up to then.
    """

    title: str
    columns: tuple[str, ...]
    rows: tuple[tuple[Cell, ...], ...]
    notes: tuple[str, ...] = ()
    complete: bool = True

    def __post_init__(self) -> None:
        for row in self.rows:
            if len(row) != len(self.columns):
                raise InputError(f"{self.title}: expected {len(self.columns)} entries in a row, got {len(row)}: {row}")

    def __len__(self) -> int:
        return len(self.rows)

    def _headline(self) -> str:
        return f"{self.title}, {len(self)} row{'s' * (len(self) != 1)}"

    def _facts(self) -> tuple[Sequence[str], Sequence[Sequence[str]]]:
        return self.columns, [[shown(v) for v in row] for row in self.rows]

    def column(self, name: str) -> list[Any]:
        """Entries of one column, by name."""
        if name not in self.columns:
            raise InputError(f"{self.title}: no column {name!r}; there are {', '.join(self.columns)}")
        k = self.columns.index(name)
        return [row[k] for row in self.rows]

    def row(self, **where: Cell) -> dict[str, Any]:
        """The first row whose entries are as given, as a dictionary."""
        for row in self.rows:
            entries = dict(zip(self.columns, row, strict=True))
            if all(entries.get(key) == value for key, value in where.items()):
                return entries
        raise InputError(f"{self.title}: no row with {where}; columns are {', '.join(self.columns)}")

    def summary(self, digits: int = 3) -> str:
        """The table in columns of equal width, notes below."""
        text = [self.columns, *(tuple(shown(v, digits) for v in row) for row in self.rows)]
        widths = [max(len(line[k]) for line in text) for k in range(len(self.columns))]
        numeric = [any(_is_number(row[k]) for row in self.rows) for k in range(len(self.columns))]
        lines = [self.title + ("" if self.complete else " (INTERRUPTED: not all rows)")]
        for line in text:
            cells = zip(line, widths, numeric, strict=True)
            lines += ["  ".join(v.rjust(w) if n else v.ljust(w) for v, w, n in cells).rstrip()]
        return "\n".join([*lines, *(f"- {note}" for note in self.notes)])

    def to_dict(self) -> dict[str, Any]:
        """Plain data for JSON."""
        return {
            "title": self.title,
            "rows": [dict(zip(self.columns, row, strict=True)) for row in self.rows],
            "notes": list(self.notes),
            "complete": self.complete,
        }

    def to_csv(self, path: Path | str) -> Path:
        """Write rows with a header line; all digits, empty where there is nothing.

        Text that a spreadsheet would take for a formula (``= + - @`` first) gets an apostrophe before it.
        """
        buffer = io.StringIO()
        writer = csv.writer(buffer, lineterminator="\n")
        writer.writerow(self.columns)
        writer.writerows([[_cell(v) for v in row] for row in self.rows])
        return write_text(path, buffer.getvalue())


def _cell(value: Any) -> Any:
    if isinstance(value, str) and value.startswith(("=", "+", "-", "@", "\t", "\r")):
        return f"'{value}"
    return "" if value is None else value


class TabularResult(Displayed, ABC):
    """A result that people see as a table: its rows as text, for JSON and as CSV."""

    @abstractmethod
    def table(self) -> ResultTable:
        """What was found, one row a case."""

    def summary(self) -> str:
        """The table as text."""
        return self.table().summary()

    def to_dict(self) -> dict[str, Any]:
        """Plain data for JSON."""
        return self.table().to_dict()

    def to_csv(self, path: Path | str) -> Path:
        """Write the table."""
        return self.table().to_csv(path)


def shown(value: Cell, digits: int = 3) -> str:
    """One entry for people: ``digits`` significant digits, no exponents between 1e-3 and 1e6."""
    if value is None:
        return "-"
    if not _is_number(value):
        return str(value)
    number = float(value)
    if isinstance(value, int) or not math.isfinite(number):
        return str(value)
    if number != 0.0 and not 1e-3 <= abs(number) < 1e6:
        return f"{number:.{digits - 1}e}"
    after = max(digits - 1 - math.floor(math.log10(abs(number))), 0) if number else digits - 1
    return f"{number:.{after}f}"


def joined(tables: Sequence[ResultTable], title: str) -> ResultTable:
    """Tables with the same columns below each other."""
    if not tables or any(t.columns != tables[0].columns for t in tables):
        raise InputError(f"{title}: tables to be joined need the same columns")
    return ResultTable(
        title,
        tables[0].columns,
        tuple(row for t in tables for row in t.rows),
        tuple(dict.fromkeys(note for t in tables for note in t.notes)),
        all(t.complete for t in tables),
    )


def _is_number(value: Any) -> bool:
    return isinstance(value, (int, float)) and not isinstance(value, bool)
