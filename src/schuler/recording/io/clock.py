"""Time stamps of a log to seconds of a named epoch.

Stamps on the GPS scale are counted from the start of the GPS week of the first one, so that they read as time of week
and keep a resolution of 1e-10 s.
"""

from __future__ import annotations

import datetime as dt
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from schuler.arrays import FloatArray, IntArray
from schuler.exceptions import InputError
from schuler.recording.io.columns import check_known
from schuler.recording.io.hint_texts import parse_time
from schuler.timebase import (
    UNIX_TO_GPS_S,
    WEEK_S,
    TimeBase,
    calendar,
    gps_from_calendar,
    gps_from_unix,
    gps_seconds,
    leap_days,
)

LATEST_S = 4.0e9  # GPS seconds of the year 2106, beyond any log [s]
LATEST_LOCAL_S = 1e12  # 30 000 years; a counter in a wrong unit [s]

Fault = Callable[[str, int | None], Exception]
NS = 1_000_000_000
_KINDS = ("unix", "utc-unix", "gps-unix", "local")


def stamps(
    t: FloatArray, time: str | None, fault: Fault, notes: list[str], offset: float = 0.0
) -> tuple[FloatArray, TimeBase]:
    """Seconds of a time base, and the time base.

    Parameters
    ----------
    t : ndarray, shape (n,)
        Stamps in seconds of whatever they count from. [s]
    time : str or None
        The hint ``time``.
    fault : callable
        Makes the error for a message and a row.
    notes : list of str
        Takes the sentence on what was done.
    offset : float
        What will be added: a counter from anywhere may become times of week by it. [s]

    Returns
    -------
    t : ndarray, shape (n,)
        Since the epoch of the time base, without the offset. [s]
    base : TimeBase

    Raises
    ------
    FileFormatError
        If a stamp is impossible for what they were said to be.
    """
    spec = parse_time(time)
    if spec.kind == "local":
        if (row := _outside(t, -LATEST_LOCAL_S, LATEST_LOCAL_S)) is not None:
            raise fault(f"time {t[row]:.6g} s is impossible: is its unit right (units='t=ns')?", row)
        if time is None:
            notes.append("Time stamps are taken as the log's own clock (hint time relates them to GPS time).")
        return t, TimeBase("local")
    if spec.kind == "gps-tow":
        return _from_tow(t, spec.week, fault, notes, offset)
    if (row := _outside(t, 0.0, LATEST_S + UNIX_TO_GPS_S)) is not None:
        raise fault(f"time {t[row]:.10g} s is impossible for time={time!r}: is its unit right (units='t=ms')?", row)
    if spec.kind == "unix":
        if (row := _outside(t, UNIX_TO_GPS_S, np.inf)) is not None:
            raise fault(
                f"Unix time {t[row]:.10g} s is before GPS time began (1980-01-06): is it time='gps' or 'local'?", row
            )
        try:
            gps = gps_from_unix(t)
        except InputError as error:
            raise fault(str(error), len(t) - 1) from error
        leaps = gps[0] - (t[0] - UNIX_TO_GPS_S)
        notes.append(f"Unix (UTC) stamps were turned to GPS time; {leaps:.0f} leap seconds were added to the first.")
    elif spec.kind == "gps-unix":
        if (row := _outside(t, UNIX_TO_GPS_S, np.inf)) is not None:
            raise fault(f"time {t[row]:.10g} s since 1970 is before GPS time began (1980-01-06)", row)
        gps = t - UNIX_TO_GPS_S
        notes.append("Stamps count seconds since 1970 on the GPS scale; no leap second was added.")
    else:
        gps = t
        notes.append("Stamps count seconds since 1980-01-06 on the GPS scale.")
    return from_gps(gps)


def from_gps(gps_s: FloatArray, rest: FloatArray | float = 0.0) -> tuple[FloatArray, TimeBase]:
    """GPS seconds since 1980, plus a rest that has more digits, to time of the first one's week. Shapes (n,). [s]"""
    start = float(np.floor((gps_s + rest)[0] / WEEK_S) * WEEK_S)
    return (gps_s - start) + rest, TimeBase("gps", start)


def _from_tow(t: FloatArray, week: int, fault: Fault, notes: list[str], offset: float) -> tuple[FloatArray, TimeBase]:
    shifted = offset != 0.0 and _outside(t + offset, 0.0, WEEK_S) is None
    if not shifted and (row := _outside(t, 0.0, WEEK_S)) is not None:
        raise fault(
            f"time of week {t[row]:.10g} s is not within 0..604800: is its unit right (units='t=ms'), "
            "or is it time='gps'?",
            row,
        )
    # the stamps of a log that runs into the next week start again at zero
    weeks = np.concatenate(([0.0], np.cumsum(np.diff(t) < -0.5 * WEEK_S)))
    if weeks[-1] > 0.0:
        notes.append(f"Time of week starts again {weeks[-1]:.0f} times; the weeks were counted on from {week}.")
    start = gps_seconds(week, 0.0)
    notes.append(f"Stamps are GPS time of week {week}, which starts on {calendar(start).date().isoformat()}.")
    return t + weeks * WEEK_S, TimeBase("gps", start)


def _outside(t: FloatArray, low: float, high: float) -> int | None:
    rows = np.flatnonzero(~((t >= low) & (t <= high)))
    return int(rows[0]) if len(rows) else None


def from_unix(
    stamps_ns: Mapping[str, IntArray], stated: str | None, notes: list[str], assumed: str = "local"
) -> tuple[dict[str, FloatArray], TimeBase]:
    """Seconds of a time base of stamps in nanoseconds.

    Parameters
    ----------
    stamps_ns : mapping of str to ndarray of int64, shape (n,)
        Stamps of each series, not empty. [ns]
    stated : str or None
        The hint ``time``: "unix" (UTC), "gps-unix" (no leap seconds) or "local".
    notes : list of str
        Takes a sentence.
    assumed : str
        Meaning where nothing is stated.

    Returns
    -------
    seconds : dict of str to ndarray
        Since the start of the GPS week of the first stamp; for "local" since its whole second if it is after 1980.
    base : TimeBase

    Raises
    ------
    InputError
        If the hint means something else, or stamps are no dates of GPS time.
    """
    kind = check_known(stated or assumed, _KINDS, "time")
    first = min(int(values.min()) for values in stamps_ns.values())
    last = max(int(values.max()) for values in stamps_ns.values())
    dated = first >= int(UNIX_TO_GPS_S) * NS
    if kind == "local":
        zero = first // NS if dated else 0
        if zero:
            notes.append(
                f"Stamps are taken as the log's own clock; {zero} s were taken off all (hint time='unix' if they are "
                "Unix time)."
            )
        return {name: (values - zero * NS) / NS for name, values in stamps_ns.items()}, TimeBase("local")
    if not dated:
        raise InputError(f"time={kind!r}, but the first stamp, {first} ns, is before GPS time began (1980-01-06)")
    # a leap second within the log would be a step back of Unix time, which the readers refuse as such
    ends = np.array([first // NS, last // NS], dtype=np.float64)
    gps = gps_from_unix(ends) if kind != "gps-unix" else ends - UNIX_TO_GPS_S
    added = int(gps[0] - ends[0] + UNIX_TO_GPS_S)
    if gps[1] - ends[1] != gps[0] - ends[0]:
        raise InputError("a leap second was introduced within the log: cut it there, or say time='gps-unix'")
    if kind == "gps-unix":
        notes.append("Stamps count time since 1970 on the GPS scale; no leap second was added.")
    else:
        notes.append(f"Stamps are taken as Unix time (UTC); {added} leap seconds were added.")
    start = int(gps[0] // WEEK_S * WEEK_S)
    zero = start + int(UNIX_TO_GPS_S) - added
    return {name: (values - zero * NS) / NS for name, values in stamps_ns.items()}, TimeBase("gps", float(start))


def to_unix(t: FloatArray, base: TimeBase) -> IntArray:
    """Unix time of times of a time base; of a local clock the time itself. Shapes (n,). [s] to [ns]

    Raises
    ------
    InputError
        If a stamp would be before 1970, or in more than 200 years.
    """
    if base.scale == "local":
        zero = 0
    else:
        gps = base.epoch_gps_s + float(t[0])
        zero = int(np.floor(base.epoch_gps_s)) + int(UNIX_TO_GPS_S) - (leaps_at(gps) if base.scale == "gps" else 0)
    part = base.epoch_gps_s - np.floor(base.epoch_gps_s) if base.scale != "local" else 0.0
    if zero + t.min() < 0.0 or zero + t.max() > 6.3e9:
        raise InputError(f"stamps from {t.min():.6g} s cannot be nanoseconds since 1970: shift the recording")
    whole = np.floor(t)
    ns = np.round((t - whole + part) * NS).astype(np.int64)
    return np.asarray((whole.astype(np.int64) + zero) * NS + ns)


def leaps_at(gps_s: float) -> int:
    """GPS time minus UTC at a GPS time. [s]"""
    days = leap_days(calendar(min(max(gps_s, 0.0), LATEST_S)).date())
    return sum(gps_s >= gps_from_calendar(dt.datetime(*day)) + count for count, day in enumerate(days, 1))


def seconds_text(stamps_ns: IntArray) -> Any:
    """Stamps as text of seconds with nine decimals, without loss. Shape (n,)."""
    return np.array([f"{int(ns) // NS}.{int(ns) % NS:09d}" for ns in stamps_ns])
