"""Time: seconds since an epoch that has a name, GPS time to and from calendars, leap seconds.

Inside the package time is seconds (float64) since the epoch of a recording. A :class:`TimeBase` says what that epoch
is, so that two logs can be brought together without guessing.
"""

from __future__ import annotations

import datetime as dt
import functools
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np

from schuler.arrays import ArrayLike, FloatArray, as_floats
from schuler.exceptions import InputError

WEEK_S = 604_800.0
GPS_EPOCH = dt.datetime(1980, 1, 6)
UNIX_TO_GPS_S = 315_964_800.0  # Unix time of the GPS epoch [s]
_YEAR_2100_UNIX_S = 4_102_444_800.0  # later stamps are no seconds

#: Days at whose start GPS - UTC grew by one second (IERS Bulletin C). Beyond ``LEAP_TABLE_VALID_TO``
#: a newer list of the system is read.
LEAP_DAYS: tuple[tuple[int, int, int], ...] = (
    (1981, 7, 1), (1982, 7, 1), (1983, 7, 1), (1985, 7, 1), (1988, 1, 1), (1990, 1, 1), (1991, 1, 1), (1992, 7, 1),
    (1993, 7, 1), (1994, 7, 1), (1996, 1, 1), (1997, 7, 1), (1999, 1, 1), (2006, 1, 1), (2009, 1, 1), (2012, 7, 1),
    (2015, 7, 1), (2017, 1, 1),
)  # fmt: skip
LEAP_TABLE_VALID_TO = dt.date(2027, 6, 28)
_SYSTEM_LIST = Path("/usr/share/zoneinfo/leap-seconds.list")  # as IERS publishes it
_NTP_EPOCH = dt.date(1900, 1, 1)
_TAI_MINUS_GPS = 19  # [s]


class LeapSecondWarning(UserWarning):
    """A UTC time later than any table of leap seconds at hand: one announced meanwhile is not counted."""


_COLLECTED: ContextVar[list[str] | None] = ContextVar("notes on leap seconds beyond the table", default=None)


@contextmanager
def leap_second_notes() -> Iterator[list[str]]:
    """Collect what is to be said of leap seconds beyond the table, as notes of a result, instead of warning of it.

    Yields
    ------
    list of str
        One sentence once a time beyond the table was converted.
    """
    notes: list[str] = []
    token = _COLLECTED.set(notes)
    try:
        yield notes
    finally:
        _COLLECTED.reset(token)


Scale = Literal["gps", "utc", "local"]
#: Stamps closer than this are one. [s]
SAME_TIME = 1e-6


@dataclass(frozen=True, slots=True)
class TimeBase:
    """Meaning of zero seconds.

    Attributes
    ----------
    scale : {"gps", "utc", "local"}
        ``local`` is a clock of unknown relation to the others (seconds since boot, a counter).
    epoch_gps_s : float
        GPS time of zero seconds, in seconds since 1980-01-06; 0 and without meaning for ``local``. [s]
    """

    scale: Scale = "local"
    epoch_gps_s: float = 0.0

    def describe(self) -> str:
        """One phrase for summaries."""
        if self.scale == "local":
            return "seconds of the log's own clock"
        if not abs(self.epoch_gps_s) < 1e11:
            return f"seconds since {self.epoch_gps_s:.6g} s of GPS time, which is no date"
        epoch = round(self.epoch_gps_s, 3)
        week, tow = week_tow(epoch)
        moment = calendar(epoch) + dt.timedelta(microseconds=500)  # isoformat cuts, it does not round
        return f"seconds since {moment.isoformat(timespec='milliseconds')} GPS (week {week}, {tow:.3f} s)"


def gps_seconds(week: int, tow_s: float) -> float:
    """Seconds since the GPS epoch of a week number (no rollover) and time of week. [s]"""
    return week * WEEK_S + tow_s


def week_tow(gps_s: float) -> tuple[int, float]:
    """GPS week (no rollover) and time of week [s] of seconds since the GPS epoch."""
    week = int(gps_s // WEEK_S)
    tow = gps_s - week * WEEK_S
    return (week + 1, 0.0) if tow >= WEEK_S else (week, tow)


def gps_from_calendar(moment: dt.datetime, *, utc: bool = False) -> float:
    """GPS seconds of a calendar date and time.

    Parameters
    ----------
    moment : datetime
        Without time zone. Read as GPS time, or as UTC if ``utc``.
    utc : bool
        Add the leap seconds between UTC and GPS time.

    Returns
    -------
    float
        Seconds since 1980-01-06 00:00 GPS time. [s]
    """
    if moment.tzinfo is not None:
        raise InputError(
            f"expected a date and time without time zone, got {moment}; convert it to UTC or GPS time first"
        )
    seconds = (moment - GPS_EPOCH).total_seconds()
    return seconds + leap_seconds(moment.date()) if utc else seconds


def calendar(gps_s: float) -> dt.datetime:
    """Calendar date and time of GPS seconds, on the GPS time scale (not UTC)."""
    return GPS_EPOCH + dt.timedelta(seconds=gps_s)


def leap_seconds(day: dt.date) -> int:
    """GPS time minus UTC on a UTC day. [s]

    Raises
    ------
    InputError
        Before 1980-01-06.

    Warns
    -----
    LeapSecondWarning
        After the last day for which leap seconds are known, see :func:`leap_days`.
    """
    if isinstance(day, dt.datetime):
        day = day.date()
    if day < GPS_EPOCH.date():
        raise InputError(f"GPS time starts on 1980-01-06, got {day}")
    return sum(day >= dt.date(*leap) for leap in leap_days(day))


def leap_days(to: dt.date) -> tuple[tuple[int, int, int], ...]:
    """Days at whose start GPS - UTC grew by one second, all up to a day.

    Beyond the package's own table the system's list is read where there is a newer one.

    Parameters
    ----------
    to : date

    Warns
    -----
    LeapSecondWarning
        If neither reaches so far. None has been introduced since 2017, so none being counted is the likeliest; one that
        was missed would shift UTC times against GPS by a second. A note where :func:`leap_second_notes` collects them.
    """
    if to <= LEAP_TABLE_VALID_TO:
        return LEAP_DAYS
    days, valid_to = _system_leap_days(_SYSTEM_LIST)
    if to > valid_to:
        sentence = (
            f"leap seconds are known to {valid_to}, got {to}: {len(days)} s are taken; update schuler or the system's "
            f"{_SYSTEM_LIST}, or give times on the GPS scale"
        )
        notes = _COLLECTED.get()
        if notes is None:
            warnings.warn(sentence, LeapSecondWarning, stacklevel=3)
        elif not notes:
            notes.append(f"{sentence[0].upper()}{sentence[1:]}.")
    return days


@functools.cache
def _system_leap_days(path: Path) -> tuple[tuple[tuple[int, int, int], ...], dt.date]:
    """Leap days of a list as IERS publishes it and the day it expires; our own if it is older, none, or another's."""
    own = LEAP_DAYS, LEAP_TABLE_VALID_TO
    try:
        lines = path.read_text(encoding="utf-8")[:100_000].splitlines()
        expires = next(int(line[2:].split()[0]) for line in lines if line.startswith("#@"))
        rows = [line.split() for line in lines if line.strip() and not line.startswith("#")]
        steps = [(_NTP_EPOCH + dt.timedelta(seconds=int(row[0])), int(row[1]) - _TAI_MINUS_GPS) for row in rows]
        valid_to = _NTP_EPOCH + dt.timedelta(seconds=expires)
    except (OSError, ValueError, IndexError, StopIteration, OverflowError):
        return own
    later = [(day, count) for day, count in steps if count > 0]
    days = tuple((day.year, day.month, day.day) for day, _ in later)
    grows = [count for _, count in later] == list(range(1, len(later) + 1)) and list(days) == sorted(days)
    return (days, valid_to) if grows and days[: len(LEAP_DAYS)] == LEAP_DAYS and valid_to > own[1] else own


def gps_from_unix(unix_s: FloatArray) -> FloatArray:
    """GPS seconds of Unix (UTC, no leap seconds counted) time stamps. Shapes follow the input. [s]

    Raises
    ------
    InputError
        If a stamp is not finite, before the GPS epoch or after 2100; milliseconds taken for seconds are found out that
        way.

    Warns
    -----
    LeapSecondWarning
        As :func:`leap_seconds`.
    """
    t = np.asarray(unix_s, dtype=np.float64)
    days = LEAP_DAYS
    if t.size:
        if not np.isfinite(t).all():
            raise InputError("Unix time stamps: expected finite numbers, got NaN or infinity")
        if t.min() < UNIX_TO_GPS_S or t.max() > _YEAR_2100_UNIX_S:
            raise InputError(
                f"Unix time stamps: expected seconds since 1970, from {UNIX_TO_GPS_S:.0f} (1980-01-06) on, "
                f"got {t.min():.6g}..{t.max():.6g}; are they milliseconds, or seconds of another epoch?"
            )
        days = leap_days((dt.datetime(1970, 1, 1) + dt.timedelta(seconds=float(t.max()))).date())
    steps = np.array([(dt.datetime(*d) - dt.datetime(1970, 1, 1)).total_seconds() for d in days])
    return t - UNIX_TO_GPS_S + np.searchsorted(steps, t, side="right")


_BLOCK = 1 << 17  # stamps that are compared at a time
_SAME_S = 1e-12  # stamps so close are one stamp: increments over less are rates beyond double precision


def check_times(t: ArrayLike, name: str) -> FloatArray:
    """Strictly increasing finite times; the message names the first that is not.

    Raises
    ------
    InputError
        If there is no time, or one is not greater than the one before it.
    """
    t = as_floats(t, name, (None,))
    if len(t) == 0:
        raise InputError(f"{name}: expected at least one sample, got none")
    for first in range(0, len(t) - 1, _BLOCK):
        step = np.diff(t[first : first + _BLOCK + 1])
        if np.any(step < _SAME_S):
            k = int(np.flatnonzero(step < _SAME_S)[0]) + 1
            what = "repeats" if step[k - 1] >= 0.0 else "goes back"
            k += first
            raise InputError(
                f"{name}: expected increasing times, but sample {k} {what}: {t[k]:.6f} s after {t[k - 1]:.6f} s; "
                "remove repeated samples or sort the log"
            )
    return t
