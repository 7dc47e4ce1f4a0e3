"""Dates and clock times of ISO 8601 to nanoseconds since 1970."""

from __future__ import annotations

import re
from collections.abc import Iterable

import numpy as np

from schuler.arrays import IntArray

NS = 1_000_000_000
_ISO = re.compile(
    r"((?:19[89]|20\d)\d-\d\d-\d\d)[T ](\d\d:\d\d:\d\d)(?:[.,](\d+))?\s*(Z|UTC|([+-])(\d\d)(?::?(\d\d))?)?",
    re.IGNORECASE,
)


def is_date(field: str) -> bool:
    """Whether a field is a date with a clock time, ``2024-05-01T12:00:00.25+02:00`` or with a blank for the T."""
    return _ISO.fullmatch(field) is not None


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
        match = _ISO.fullmatch(field)
        if match is None:
            bad = row
            break
        day, clock, decimals, zone, sign, hours, minutes = match.groups()
        days.append(f"{day}T{clock}")
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
