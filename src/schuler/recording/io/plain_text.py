"""Tables of numbers in text files of known formats: the rows, and errors that name the line."""

from __future__ import annotations

import itertools
import warnings
from collections.abc import Collection
from pathlib import Path

import numpy as np

from schuler.arrays import FloatArray, IntArray
from schuler.exceptions import FileFormatError
from schuler.recording.io import lines
from schuler.recording.io.lines import TextTable


def open_table(path: Path, widths: Collection[int], what: str, delimiter: str = " ") -> TextTable:
    """The table of a file from its first row of numbers on.

    Parameters
    ----------
    path : Path
    widths : collection of int
        Numbers of columns the format may have.
    what : str
        Contents of a row, for messages.
    delimiter : str
        See :class:`schuler.recording.io.lines.TextTable`.

    Raises
    ------
    FileFormatError
        If there is no row of numbers, or it has another number of columns.
    """
    encoding = lines.encoding_of(lines.check_file(path), path)
    table = TextTable(path, 1, delimiter, encoding=encoding)
    for number, fields in itertools.islice(table.rows(), 200):
        if all(map(lines.is_value, fields)):
            if len(fields) not in widths:
                counts = " or ".join(map(str, sorted(widths)))
                raise FileFormatError(f"expected {counts} columns ({what}), got {len(fields)}", path, number)
            return TextTable(path, number, delimiter, encoding=encoding)
    raise FileFormatError(f"there are no rows of numbers ({what})", path)


def width(table: TextTable) -> int:
    """Number of columns of the first row."""
    return len(next(table.rows())[1])


def load(table: TextTable, n: int, *, allow_truncated: bool, notes: list[str], fields: int | None = None) -> FloatArray:
    """All numbers of a table of ``n`` columns, or the first ``n`` of ``fields``; errors name the line. Shape (m, n)."""
    values, truncated = lines.load(table, fields or n, list(range(n)), allow_truncated=allow_truncated)
    if truncated:
        notes.append(f"{table.path.name}: the last line was cut off and left out.")
    if not np.isfinite(values).all():
        row = int(np.flatnonzero(~np.isfinite(values).all(axis=1))[0])
        column = int(np.flatnonzero(~np.isfinite(values[row]))[0])
        raise FileFormatError(
            f"column {column + 1}: expected a finite number; correct or delete the line", table.path, table.line_of(row)
        )
    return values


def load_ns(table: TextTable, n: int, *, allow_truncated: bool, notes: list[str]) -> tuple[IntArray, FloatArray]:
    """The first column as whole nanoseconds, without loss, and the others. Shapes (m,), (m, n - 1)."""
    loaded = lines.load_stamps(table, n, 0, allow_truncated=allow_truncated)
    if loaded is not None and np.isfinite(loaded[1]).all() and _sane(loaded[0]):
        if loaded[2]:
            notes.append(f"{table.path.name}: the last line was cut off and left out.")
        return loaded[0], loaded[1]
    dtype = np.dtype([("ns", np.int64), ("values", np.float64, (n - 1,))])
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        try:
            rows = np.loadtxt(
                table.path,
                dtype=dtype,
                delimiter=None if table.delimiter == " " else table.delimiter,
                comments=table.comment,
                skiprows=table.first - 1,
                ndmin=1,
                encoding=table.encoding,
            )
        except (ValueError, TypeError, OverflowError, RuntimeError, Warning):
            rows = None
    if rows is not None and len(rows) and np.isfinite(rows["values"]).all() and _sane(rows["ns"]):
        return np.ascontiguousarray(rows["ns"]), np.ascontiguousarray(rows["values"])
    values = load(table, n, allow_truncated=allow_truncated, notes=notes)  # names the line at fault
    if np.abs(values[:, 0]).max() > 4.0e18:
        raise FileFormatError("stamps are beyond nanoseconds of this century: is the file in this format?", table.path)
    rounded = np.round(values[:, 0])
    if not np.array_equal(rounded, values[:, 0]) or np.abs(rounded).max() > 2.0**53:
        notes.append("Stamps are not written as whole nanoseconds and have the resolution of a floating-point number.")
    return rounded.astype(np.int64), values[:, 1:]


def _sane(ns: IntArray) -> bool:
    return bool(ns.min() > -4_000_000_000_000_000_000 and ns.max() < 4_000_000_000_000_000_000)


def head_of(path: Path, n: int = 20_000) -> bytes:
    """First bytes of a file; none if it cannot be opened."""
    try:
        with path.open("rb") as stream:
            return stream.read(n)
    except OSError:
        return b""


def save(
    path: Path, rows: FloatArray, fmt: str | list[str], header: str = "", comments: str = "", sep: str = " "
) -> None:
    """Write rows of numbers with LF endings; missing folders are made."""
    path.parent.mkdir(parents=True, exist_ok=True)
    with path.open("w", encoding="utf-8", newline="\n") as stream:
        if header:
            stream.write(f"{comments}{header}\n")
        pattern = sep.join(fmt) if isinstance(fmt, list) else sep.join([fmt] * rows.shape[1])
        for start in range(0, len(rows), 8192):  # a block at a time, by one format
            block = rows[start : start + 8192].tolist()
            stream.write("\n".join([pattern % tuple(row) for row in block]) + "\n")
