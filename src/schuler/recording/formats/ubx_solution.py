"""Solutions of u-blox receivers: UBX-NAV-PVT to a GNSS series."""

from __future__ import annotations

import datetime as dt
from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np

from schuler import units
from schuler.arrays import FloatArray
from schuler.recording.series import GnssSeries
from schuler.timebase import WEEK_S, gps_from_calendar

_MM = 1e-3
_TWO_D, _DEAD_RECKONING = 2, (1, 4)
_ASSUMED_HEIGHT = 100.0  # 1-sigma of the height of a two-dimensional fix, which is held, not measured [m]


def solution_times(messages: Sequence[dict[str, Any]]) -> FloatArray:
    """GPS time of each NAV-PVT message since 1980, NaN while the receiver does not know it. Shape (n, 2). [s]

    Whole seconds and the rest, which together have more digits than one number.

    The date and time are UTC; time of week tells the leap seconds between, so no table is needed. UTC carries the
    nanoseconds of the epoch, time of week is rounded to milliseconds.
    """
    times = np.full((len(messages), 2), np.nan)
    for k, m in enumerate(messages):
        if not (m["validDate"] and m["validTime"]):
            continue
        try:
            day = gps_from_calendar(dt.datetime(m["year"], m["month"], m["day"]))
        except ValueError:  # a date that is none
            continue
        utc, rest = day + m["hour"] * units.HR + m["min"] * units.MIN + m["second"], 1e-9 * m["nano"]
        leaps = round((m["iTOW"] * 1e-3 - utc - rest) % WEEK_S)
        if leaps <= 60:  # else date and time of week contradict each other
            times[k] = utc + leaps, rest
    return times


def solutions(
    messages: Iterable[dict[str, Any]], start: float | None = None
) -> tuple[GnssSeries | None, float, list[str]]:
    """GNSS series of decoded NAV-PVT messages.

    Parameters
    ----------
    messages : iterable of dict
        Fields of each message by pyubx2's names, in order of the log.
    start : float, optional
        GPS time of zero seconds, default the start of the first epoch's week. [s]

    Returns
    -------
    series : GnssSeries or None
        ``None`` if there is no epoch with a fix.
    start : float
        GPS time of zero seconds. [s]
    notes : list of str

    Notes
    -----
    Left out are epochs without a valid fix (``gnssFixOK``, ``invalidLlh``, fix types 0 and 5), without a date or
    without accuracies. Of a two-dimensional fix the height is given 100 m. ``hAcc`` is taken as the 1-sigma of north
    and of east, ``sAcc`` as that of each component of velocity: u-blox does not say whether they are radial, and if
    they are the components are better by up to 1.4 and 1.7.
    """
    rows = list(messages)
    parts = solution_times(rows)
    times = parts.sum(axis=1)
    notes: list[str] = []
    fix = np.array([bool(m["gnssFixOk"]) and not m["invalidLlh"] and m["fixType"] in (1, 2, 3, 4) for m in rows], bool)
    accuracy = np.array([[m["hAcc"], m["vAcc"], m["sAcc"]] for m in rows], dtype=np.float64).reshape(-1, 3) * _MM
    # not known is all ones
    known = np.all((accuracy > 0.0) & (accuracy < (2**32 - 1) * _MM), axis=1)
    dated = np.isfinite(times)
    # a running maximum leaves out what was repeated or went back
    highest = np.maximum.accumulate(np.where(fix & known & dated, times, -np.inf)) if rows else times
    later = times > np.concatenate(([-np.inf], highest[:-1]))
    for wrong, text in (
        (~fix, "epochs without a fix were left out"),
        (fix & ~dated, "epochs before the receiver knew the date were left out"),
        (fix & dated & ~known, "epochs without an accuracy were left out"),
        (fix & dated & known & ~later, "epochs not later than the one before were left out"),
    ):
        if wrong.any():
            notes.append(f"NAV-PVT: {int(wrong.sum())} {text}.")
    keep = np.flatnonzero(fix & known & dated & later)
    if len(keep) == 0:
        return None, float("nan") if start is None else start, notes
    start = float(times[keep[0]] // WEEK_S * WEEK_S) if start is None else start
    kept = [rows[k] for k in keep]
    llh = np.array([(m["lat"] * units.DEG, m["lon"] * units.DEG, m["height"] * _MM) for m in kept])
    v_n = np.array([(m["velN"], m["velE"], m["velD"]) for m in kept], dtype=np.float64) * _MM
    sigma, flat = accuracy[keep], np.array([m["fixType"] == _TWO_D for m in kept])
    if flat.any():
        notes.append(
            f"NAV-PVT: {int(flat.sum())} fixes are two-dimensional; their height got {_ASSUMED_HEIGHT:g} m 1-sigma."
        )
    vertical = np.where(flat, np.maximum(sigma[:, 1], _ASSUMED_HEIGHT), sigma[:, 1])
    cov_r, cov_v = np.zeros((len(kept), 3, 3)), np.zeros((len(kept), 3, 3))
    cov_r[:, [0, 1, 2], [0, 1, 2]] = np.stack((sigma[:, 0], sigma[:, 0], vertical), axis=1) ** 2
    cov_v[:, [0, 1, 2], [0, 1, 2]] = sigma[:, 2:] ** 2
    series = GnssSeries(
        (parts[keep, 0] - start) + parts[keep, 1], llh, cov_r, v_n, cov_v, np.array([_quality(m) for m in kept]),
        np.array([m["numSV"] for m in kept]),
    )  # fmt: skip
    return series, start, notes


def _quality(m: dict[str, Any]) -> int:
    """RTKLIB's number: fixed, float, differential, single, or dead reckoning."""
    if m["carrSoln"] in (1, 2):
        return 3 - int(m["carrSoln"])
    if m["fixType"] in _DEAD_RECKONING:
        return 7
    return 4 if m["diffSoln"] else 5
