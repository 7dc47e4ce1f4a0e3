"""Rows of a text table that are left out up to a stated share: garbled lines, no numbers, repeated or late stamps."""

from __future__ import annotations

import numpy as np

from schuler.arrays import BoolArray
from schuler.exceptions import FileFormatError
from schuler.recording.io import columns, dates, lines
from schuler.recording.io.raw import HUGE, Raw

_NEAR = 100  # rows by which one may be late; one of another run or after the end of a counter is later


def good_rows(
    table: lines.TextTable, n_columns: int, used: list[int], dated: int | None, share: float
) -> tuple[list[int], list[list[str]], int]:
    """Rows of a table some of whose lines are garbled: not as many fields, or no numbers.

    Parameters
    ----------
    table : TextTable
    n_columns : int
        Fields every line must have.
    used : list of int
        Columns of numbers.
    dated : int or None
        Column of dates.
    share : float
        Largest share of garbled lines.

    Returns
    -------
    numbers : list of int
        Line of each good row.
    rows : list of list of str
        Their fields.
    n_bad : int

    Raises
    ------
    FileFormatError
        With the first garbled line, if there are more of them.
    """
    numbers: list[int] = []
    rows: list[list[str]] = []
    first, n_bad = None, 0
    for number, fields in table.rows():
        fault = lines.fault_of(table, fields, n_columns, used)
        if fault is None and dated is not None and dates.unix_ns([fields[dated]])[2] is not None:
            fault = f"column {dated + 1}: expected a date, got {lines.shorten(fields[dated], 40)}"
        if fault is None:
            numbers.append(number)
            rows.append(fields)
        else:
            n_bad += 1
            first = first or (number, fault)
    if first is not None and n_bad > share * (n_bad + len(rows)):
        raise FileFormatError(
            f"{n_bad} of {n_bad + len(rows)} lines are garbled, more than bad_lines={share:g} allows; the first: "
            f"{first[1]}",
            table.path,
            first[0],
        )
    return numbers, rows, n_bad


def is_sound(raw: Raw) -> bool:
    """Whether all samples are numbers and all stamps later than those before.

    Parameters
    ----------
    raw : Raw
    """
    t = raw.values.get("t")
    return not _without_number(raw)[1].any() and (t is None or bool((t[1:] > t[:-1]).all()))


def _without_number(raw: Raw) -> tuple[list[str], BoolArray]:
    """Columns that every row needs, and rows that hold no number in one of them. Shape (n,)."""
    needed = [name for name in raw.values if name in ("t", *columns.ACCEL, *columns.GYRO)]
    bad = np.zeros(len(next(iter(raw.values.values()))), dtype=bool)
    for name in needed:
        bad |= ~(np.abs(raw.values[name]) <= HUGE)
    return needed, bad


def put_in_order(raw: Raw, share: float) -> None:
    """Leave out rows that hold no number, sort late rows in, leave out repeated stamps; in place, and noted.

    Parameters
    ----------
    raw : Raw
        A place that is no number is none of its matter: see :func:`schuler.recording.io.missing_values.settle`.
    share : float
        Largest share of each kind. With more of them, or rows that are late by more than a hundred, the table stays as
        it is, and reading it says why it is refused.
    """
    needed, bad = _without_number(raw)
    if 0 < bad.sum() <= share * len(bad):
        raw.keep(np.flatnonzero(~bad))
        raw.notes.append(f"{int(bad.sum())} of {len(bad)} rows hold no number ({', '.join(needed)}): left out.")
    if "t" not in raw.values:
        return
    t = raw.values["t"]
    order = np.argsort(t, kind="stable")
    moved = order != np.arange(len(order))
    late = int((t[1:] < t[:-1]).sum())
    if late and late <= share * len(t) and np.abs(order - np.arange(len(order))).max() <= _NEAR:
        raw.keep(order)
        raw.notes.append(f"{late} times a row came after a later one: {int(moved.sum())} rows were sorted by time.")
    t = raw.values["t"]
    again = np.concatenate(([False], t[1:] == t[:-1]))
    if 0 < again.sum() <= share * len(again):
        raw.keep(np.flatnonzero(~again))
        raw.notes.append(f"{int(again.sum())} rows repeat the time of the row before and were left out.")
