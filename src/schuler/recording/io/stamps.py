"""Stamps of text tables that are dates or times of day, as times of a recording."""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Sequence

import numpy as np

from schuler.arrays import FloatArray
from schuler.exceptions import InputError
from schuler.recording.io import clock, dates, lines
from schuler.recording.io.bursts import spread_bursts
from schuler.recording.io.hints import ReadHints
from schuler.recording.io.raw import Raw
from schuler.recording.io.text_head import Opening

_LOOKED_AT, _HELD = 500, 0.4  # rows, and the share of them with the stamp of the row before, where clocks are coarse


def spread_with_all(opening: Opening, at: int, numbers: Sequence[int]) -> FloatArray | None:
    """What stamps of some rows move by as those of all rows are spread, where many rows have one stamp.

    Parameters
    ----------
    opening : Opening
    at : int
        Column of the stamps.
    numbers : sequence of int
        Lines of the rows.

    Returns
    -------
    ndarray, shape (len(numbers),), or None
        In the unit of the stamps, seconds of dates; None where stamps need not be spread.
    """
    width = len(opening.fields)
    first = [fields[at] for _, fields in itertools.islice(opening.table.rows(), _LOOKED_AT) if len(fields) == width]
    if sum(a == b for a, b in itertools.pairwise(first)) < _HELD * len(first):
        return None
    kept = [row for row in opening.table.rows() if len(row[1]) == width and _is_timed(row[1][at])]
    if kept and lines.is_number(kept[0][1][at]):
        kept = [row for row in kept if lines.is_number(row[1][at])]
        t = np.array([float(fields[at]) for _, fields in kept])
    else:
        texts = stamps_of(opening, at, [fields for _, fields in kept])
        if dates.is_clock(texts[0]):
            t, bad = dates.seconds_of_day(texts)
        else:
            ns, _, bad = dates.unix_ns(texts)
            t = (ns - ns[:1]) / dates.NS
        if bad is not None:
            return None
    if (evenly := spread_bursts(t)) is None:
        return None
    moved = dict(zip((number for number, _ in kept), evenly[0] - t, strict=True))
    return np.array([moved.get(number, 0.0) for number in numbers])  # one that is no number is refused later


def _is_timed(field: str) -> bool:
    """Whether a field is a stamp, or what ought to be one: neither empty nor nan."""
    return lines.is_number(field) or not lines.is_value(field)


def dated_column(opening: Opening, chosen: dict[str, int]) -> int | None:
    """Position of the time column if its stamps are dates or times of day; the first rows may have none."""
    k = chosen.get("t")
    if k is None:
        return None
    field = opening.fields[k]
    if not _is_timed(field):
        rows = (fields for _, fields in itertools.islice(opening.table.rows(), _LOOKED_AT) if len(fields) > k)
        field = next((row[k] for row in rows if _is_timed(row[k])), field)
    return k if dates.is_date(field) or dates.is_clock(field) else None


def stamps_of(opening: Opening, dated: int, rows: Iterable[list[str]]) -> list[str]:
    """Stamps of rows, times of day with the date of the column that has it."""
    days = [k for k, field in enumerate(opening.fields) if dates.is_day(field)]
    if len(days) != 1 or not dates.is_clock(opening.fields[dated]):
        return [fields[dated] for fields in rows]
    return [dates.joined(fields[days[0]], fields[dated]) for fields in rows]


def stamp(raw: Raw, hints: ReadHints, texts: list[str]) -> None:
    """Make the time column of dates, on GPS time, or of times of day, on the log's own clock.

    Rows without any, as those before a receiver has its time, are left out and counted.
    """
    timed = [k for k, text in enumerate(texts) if _is_timed(text)]
    if 0 < len(timed) < len(texts):
        raw.keep(np.array(timed))
        raw.notes.append(f"{len(texts) - len(timed)} of {len(texts)} rows have no time and were left out.")
        texts = [texts[k] for k in timed]
    if dates.is_clock(texts[0]):
        raw.values["t"], bad = dates.seconds_of_day(texts)
        raw.stated["t"] = "s"
        if bad is not None:
            raise raw.fault(f"t: expected a time of day such as 12:00:00.25, got {lines.shorten(texts[bad], 40)}", bad)
        raw.notes.append("Stamps are times of day, of no stated date: seconds since the first midnight.")
        return
    ns, zoned, bad = dates.unix_ns(texts)
    if bad is not None:
        raise raw.fault(f"t: expected a date such as 2024-05-01T12:00:00.25Z, got {lines.shorten(texts[bad], 40)}", bad)
    if hints.time not in (None, "unix", "utc-unix") and (zoned or hints.time != "gps-unix"):
        meant = (
            "state their zone: leave time out" if zoned else "say time='unix' if they are UTC, 'gps-unix' if GPS time"
        )
        raise raw.fault(f"time={hints.time!r}, but the stamps are dates; {meant}")
    if "received" in raw.values:
        raise raw.fault("received: expected dates as in the column t, which are not read here: skip it with -")
    notes: list[str] = []
    try:
        seconds, raw.time = clock.from_unix({"t": ns}, hints.time, notes, assumed="unix")
    except InputError as error:
        raise raw.fault(str(error)) from error
    raw.values["t"], raw.stated["t"] = seconds["t"], "s"
    if hints.time is None and not zoned:
        raw.notes.append(
            "Dates without a zone are taken as UTC (hint time='gps-unix' for GPS time, offset for others)."
        )
    raw.notes += [note.replace("Stamps are taken as Unix time (UTC)", "Stamps are dates") for note in notes]
