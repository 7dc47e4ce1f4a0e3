"""Stamps of ROS: Unix time (UTC) in nanoseconds."""

from __future__ import annotations

import datetime as dt
from typing import Any

import numpy as np

from schuler.arrays import FloatArray
from schuler.exceptions import InputError
from schuler.timebase import UNIX_TO_GPS_S, TimeBase, calendar, gps_from_calendar, leap_days

_NS = 1_000_000_000
_MOST_NS = 9.2e18  # of 63 bits [ns]


def unix_ns(t: FloatArray, base: TimeBase, name: str) -> np.ndarray[Any, np.dtype[np.int64]]:
    """Unix nanoseconds of times, or those of their own clock if that is all there is.

    Parameters
    ----------
    t : ndarray, shape (n,)
        [s]
    base : TimeBase
        Of the times.
    name : str
        For messages.

    Returns
    -------
    ndarray of int64, shape (n,)
        [ns]

    Raises
    ------
    InputError
        If a stamp would be negative, or after the year 2262.
    """
    shift = 0 if base.scale == "local" else round((base.epoch_gps_s + UNIX_TO_GPS_S) * 1e3) * 1_000_000
    rounded = np.round(t * 1e9)
    if np.abs(rounded).max(initial=0.0) + abs(shift) > _MOST_NS:
        raise InputError(f"{name}: stamps of ROS end in the year 2262, got {np.abs(t).max():.6g} s")
    ns = rounded.astype(np.int64) + shift
    if not len(ns):
        return np.asarray(ns, dtype=np.int64)
    if base.scale == "gps":
        days = leap_days(calendar(float(ns.max()) / _NS - UNIX_TO_GPS_S).date())
        steps = [
            round(gps_from_calendar(dt.datetime(*day)) + count + UNIX_TO_GPS_S) * _NS
            for count, day in enumerate(days, 1)
        ]
        ns = ns - np.searchsorted(steps, ns, side="right") * _NS
    if ns.min() < 0:
        raise InputError(f"{name}: stamps of ROS are not negative, got {ns.min() / _NS:.3f} s; shift the recording")
    return np.asarray(ns, dtype=np.int64)
