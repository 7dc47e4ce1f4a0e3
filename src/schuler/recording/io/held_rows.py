"""Rows of an IMU's table that bring a fix or a speed of wheels: loggers leave the fields empty or repeat the last."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from schuler.arrays import FloatArray
from schuler.recording.io import columns, lines
from schuler.recording.io.raw import COUNTER
from schuler.recording.io.text_head import Opening

_BLANK = ("speed", "course", "sspeed", "heading", "q", "ns", *columns.DILUTION)  # a fix may be without
_PLACE = ("lat", "lon", "n", "e")
_OFTEN, _MOSTLY = 3, 0.3  # changes over those of the place, and over all rows, of another sensor's: a barometer's


def new_rows(
    opening: Opening, names: Sequence[str], indices: Sequence[int], *, fixes: bool
) -> tuple[list[int], list[list[str]], FloatArray]:
    """Rows with the fields of a fix, other than those of the row before; of a speed, which may stay, all with one.

    Parameters
    ----------
    opening : Opening
    names, indices : sequence
        Of the columns of the series.
    fixes : bool
        Zeros of the place, which loggers write until the first fix, are none.

    Returns
    -------
    numbers : list of int
        Lines of the file.
    rows : list of list of str
    counted : ndarray, shape (n,)
        What a counter of 32 bits that began again before a row is to be counted on by.
    """
    needed = [k for name, k in zip(names, indices, strict=True) if name != "t" and not (fixes and name in _BLANK)]
    place = [k for name, k in zip(names, indices, strict=True) if name in _PLACE]
    watched = [k for name, k in zip(names, indices, strict=True) if name != "t"]
    if fixes and place:
        changes, count = _changes(opening, watched, needed)
        most = max(_OFTEN * max(changes[k] for k in place), _MOSTLY * count)
        watched = [k for k in watched if changes[k] <= most]
    numbers, rows, counted, last = [], [], [], [""] * len(watched)
    clock = next((k for name, k in zip(names, indices, strict=True) if name == "t"), None)
    before, wraps = -np.inf, 0.0  # of all rows: a counter may begin again before the first fix
    for number, fields in opening.table.rows():
        if clock is not None and len(fields) > clock and lines.is_number(fields[clock]):
            now = float(fields[clock])
            wraps += before - now > 0.5 * COUNTER
            before = now
        if len(fields) != len(opening.fields) or not all(lines.is_number(fields[k]) for k in needed):
            continue
        new = [fields[k] for k in watched]
        if not fixes or (new != last and not (place and all(float(fields[k]) == 0.0 for k in place))):
            numbers.append(number)
            rows.append(fields)
            counted.append(wraps)
        last = new
    return numbers, rows, COUNTER * np.array(counted)


def _changes(opening: Opening, watched: Sequence[int], needed: Sequence[int]) -> tuple[dict[int, int], int]:
    """How often the fields of each column change from one row with a fix to the next, and how many rows have one."""
    changes, count = dict.fromkeys(watched, 0), 0
    last: list[str] | None = None
    for _, fields in opening.table.rows():
        if len(fields) == len(opening.fields) and all(lines.is_number(fields[k]) for k in needed):
            if last is not None:
                for k in watched:
                    changes[k] += fields[k] != last[k]
            last = fields
            count += 1
    return changes, count
