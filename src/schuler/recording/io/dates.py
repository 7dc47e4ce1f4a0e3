"""Dates and clock times of ISO 8601 to nanoseconds since 1970, and times of day."""

from __future__ import annotations

import re
from collections.abc import Iterable
from typing import cast

import numpy as np

from schuler.arrays import FloatArray, IntArray

NS = 1_000_000_000
_ISO = re.compile(
    r"((?:19[89]|20\d)\d[-/]\d\d[-/]\d\d)[T ](\d\d:\d\d:\d\d)(?:[.,:](\d+))?\s*(Z|UTC|([+-])(\d\d)(?::?(\d\d))?)?",
    re.IGNORECASE,
)

#: ``17-May-2024 18:53:02.001`` of MATLAB.
_NAMED = re.compile(r"(\d\d?)-([A-Za-z]{3})-((?:19[89]|20\d)\d)([T ].*)")
#: ``Wed Dec 22 21:09:46 2021`` of C, Python and Unix.
_OF_C = re.compile(
    r"(?:[A-Za-z]{3},? +)?([A-Za-z]{3}) +(\d\d?),? +(\d\d:\d\d:\d\d(?:[.,]\d+)?) +(?:(UTC|GMT) +)?((?:19[89]|20\d)\d)"
)
_MONTHS = ("jan", "feb", "mar", "apr", "may", "jun", "jul", "aug", "sep", "oct", "nov", "dec")
_CLOCK = re.compile(r"([01]?\d|2[0-3]):([0-5]\d):([0-5]\d)(?:[.,:](\d+))?")
_DAY = re.compile(r"((?:19[89]|20\d)\d)[-/.](\d\d?)[-/.](\d\d?)|(\d\d?)\.(\d\d?)\.((?:19[89]|20\d)\d)")
_DAY_S = 86_400.0


def is_clock(field: str) -> bool:
    """Whether a field is a time of day, ``16:53:02.25``."""
    return _CLOCK.fullmatch(field) is not None


def is_day(field: str) -> bool:
    """Whether a field is a date without a clock time, ``2024-05-17``, ``2024/05/17`` or ``17.05.2024``.

    With strokes the day may come before or after the month, so that only the year at the front is read.
    """
    return _DAY.fullmatch(field) is not None


def joined(day: str, clock: str) -> str:
    """A date in two fields as one; whatever it is if they are none, for the error to show."""
    match = _DAY.fullmatch(day)
    if match is None or not is_clock(clock):
        return f"{day} {clock}"
    y, m, d = (match[1], match[2], match[3]) if match[1] else (match[6], match[5], match[4])
    return f"{y}-{int(m):02d}-{int(d):02d}T{_clock(clock)}"


def _clock(field: str) -> str:
    """A time of day as ISO 8601 has it."""
    h, m, s, decimals = cast(re.Match[str], _CLOCK.fullmatch(field)).groups()
    return f"{int(h):02d}:{m}:{s}" + (f".{decimals}" if decimals else "")


def seconds_of_day(fields: Iterable[str]) -> tuple[FloatArray, int | None]:
    """Seconds since the first midnight of times of day, which begin again at each midnight.

    Parameters
    ----------
    fields : iterable of str

    Returns
    -------
    t : ndarray, shape (n,)
        Up to the first that is no time of day. [s]
    bad : int or None
        Row of that one.
    """
    values, bad = [], None
    for row, field in enumerate(fields):
        match = _CLOCK.fullmatch(field)
        if match is None:
            bad = row
            break
        h, m, s, decimals = match.groups()
        values.append(3600 * int(h) + 60 * int(m) + float(f"{s}.{decimals or 0}"))
    t = np.array(values)
    return t + _DAY_S * np.concatenate(([0.0], np.cumsum(np.diff(t) < -0.5 * _DAY_S)))[: len(t)], bad


def is_date(field: str) -> bool:
    """Whether a field is a date with a clock time, ``2024-05-01T12:00:00.25+02:00`` or with a blank for the T."""
    return _iso(field) is not None


def _iso(field: str) -> re.Match[str] | None:
    """A date as ISO 8601 has it, or with the month in letters, taken apart."""
    if (match := _ISO.fullmatch(field)) is not None or not field[:1].isalnum():
        return match
    if named := _NAMED.fullmatch(field):
        d, name, y, clock = named.groups()
    elif named := _OF_C.fullmatch(field):
        name, d, clock, zone, y = named.groups()
        clock = f"T{clock}{'Z' if zone else ''}"
    else:
        return None
    month = _MONTHS.index(name.lower()) + 1 if name.lower() in _MONTHS else 0
    return _ISO.fullmatch(f"{y}-{month:02d}-{int(d):02d}{clock}")


def unix_ns(fields: Iterable[str]) -> tuple[IntArray, bool, int | None]:
    """Unix time of dates of the years 1980 to 2099, without loss to the nanosecond.

    Parameters
    ----------
    fields : iterable of str
        Further decimals are cut off. Without a zone they are taken as UTC.

    Returns
    -------
    ns : ndarray of int64, shape (n,)
        Up to the first that is no date. [ns]
    zoned : bool
        Whether all state their zone.
    bad : int or None
        Row of the first that is no date, or one no calendar has.
    """
    days, parts, zoned, bad = [], [], True, None
    for row, field in enumerate(fields):
        match = _iso(field)
        if match is None:
            bad = row
            break
        day, clock, decimals, zone, sign, hours, minutes = match.groups()
        days.append(f"{day.replace('/', '-')}T{clock}")
        east = 0 if sign is None else int(f"{sign}1") * (3600 * int(hours) + 60 * int(minutes or 0))
        parts.append(int((decimals or "").ljust(9, "0")[:9]) - east * NS)
        zoned = zoned and zone is not None
    try:
        whole = np.array(days, dtype="M8[s]")
    except ValueError:
        row = next(k for k, day in enumerate(days) if not _in_calendar(day))
        whole, bad = np.array(days[:row], dtype="M8[s]"), row
    return whole.astype(np.int64) * NS + np.array(parts[: len(whole)], dtype=np.int64), zoned, bad


def _in_calendar(day: str) -> bool:
    try:
        np.datetime64(day, "s")
    except ValueError:
        return False
    return True
