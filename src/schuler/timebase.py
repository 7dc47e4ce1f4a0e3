"""Time: seconds since an epoch that has a name, GPS time to and from calendars, leap seconds.

Inside the package time is seconds (float64) since the epoch of a recording. A :class:`TimeBase` says what that epoch
is, so that two logs can be brought together without guessing.
"""

from __future__ import annotations

import datetime as dt
from dataclasses import dataclass
from typing import Literal

import numpy as np

from schuler.arrays import ArrayLike, FloatArray, as_floats
from schuler.exceptions import InputError

WEEK_S = 604_800.0
GPS_EPOCH = dt.datetime(1980, 1, 6)
UNIX_TO_GPS_S = 315_964_800.0  # Unix time of the GPS epoch [s]
_YEAR_2100_UNIX_S = 4_102_444_800.0  # later stamps are no seconds

#: Days at whose start GPS - UTC grew by one second (IERS Bulletin C; the table is complete to ``LEAP_TABLE_VALID_TO``).
LEAP_DAYS = (
    (1981, 7, 1), (1982, 7, 1), (1983, 7, 1), (1985, 7, 1), (1988, 1, 1), (1990, 1, 1), (1991, 1, 1), (1992, 7, 1),
    (1993, 7, 1), (1994, 7, 1), (1996, 1, 1), (1997, 7, 1), (1999, 1, 1), (2006, 1, 1), (2009, 1, 1), (2012, 7, 1),
    (2015, 7, 1), (2017, 1, 1),
)  # fmt: skip
LEAP_TABLE_VALID_TO = dt.date(2027, 6, 28)

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
        Before 1980-01-06, or after the last day the table is known to be complete: a newer release or the correct
        offset is needed, guessing would shift every position by hundreds of metres.
    """
    if isinstance(day, dt.datetime):
        day = day.date()
    if day < GPS_EPOCH.date():
        raise InputError(f"GPS time starts on 1980-01-06, got {day}")
    if day > LEAP_TABLE_VALID_TO:
        raise InputError(
            f"leap seconds are known to {LEAP_TABLE_VALID_TO}, got {day}: "
            "update schuler, or give times on the GPS scale"
        )
    return sum(day >= dt.date(*leap) for leap in LEAP_DAYS)


def gps_from_unix(unix_s: FloatArray) -> FloatArray:
    """GPS seconds of Unix (UTC, no leap seconds counted) time stamps. Shapes follow the input. [s]

    Raises
    ------
    InputError
        If a stamp is not finite, before the GPS epoch, or beyond the leap-second table; milliseconds taken for seconds
        are found out that way.
    """
    t = np.asarray(unix_s, dtype=np.float64)
    steps = np.array([(dt.datetime(*d) - dt.datetime(1970, 1, 1)).total_seconds() for d in LEAP_DAYS])
    if t.size:
        if not np.isfinite(t).all():
            raise InputError("Unix time stamps: expected finite numbers, got NaN or infinity")
        if t.min() < UNIX_TO_GPS_S or t.max() > _YEAR_2100_UNIX_S:
            raise InputError(
                f"Unix time stamps: expected seconds since 1970, from {UNIX_TO_GPS_S:.0f} (1980-01-06) on, "
                f"got {t.min():.6g}..{t.max():.6g}; are they milliseconds, or seconds of another epoch?"
            )
        leap_seconds((dt.datetime(1970, 1, 1) + dt.timedelta(seconds=float(t.max()))).date())  # within the table
    return t - UNIX_TO_GPS_S + np.searchsorted(steps, t, side="right")


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
    step = np.diff(t)
    if np.any(step <= 0.0):
        k = int(np.flatnonzero(step <= 0.0)[0]) + 1
        what = "repeats" if step[k - 1] == 0.0 else "goes back"
        raise InputError(
            f"{name}: expected increasing times, but sample {k} {what}: {t[k]:.6f} s after {t[k - 1]:.6f} s; "
            "remove repeated samples or sort the log"
        )
    return t
