"""Messages of a RINEX navigation file as records of orbits and clocks on GPS time."""

from __future__ import annotations

from typing import TypeVar

import numpy as np

from schuler.arrays import FloatArray
from schuler.gnss.ephemerides import GlonassRecords, KeplerRecords, no_glonass, no_kepler
from schuler.gnss.signals import SYSTEM_NAMES
from schuler.recording.formats.rinex_columns import BDT_TO_GPS_S, leap_seconds_at
from schuler.recording.formats.rinex_header import RinexFile, broadcast_leap_seconds
from schuler.recording.formats.rinex_records import Records, dates, fields
from schuler.timebase import WEEK_S

_KM = 1e3
_DAY_S = 86_400.0
_NOT_KNOWN = 0.9999e9  # what a time of transmission is said to be when it is not known
#: Where the numbers of a message stand, counted from the three of its first line (RINEX 3.05, tables A6 to A14).
_PLACES = {
    "af0": 0, "af1": 1, "af2": 2, "crs": 4, "delta_n": 5, "m0": 6, "cuc": 7, "e": 8, "cus": 9, "sqrt_a": 10,
    "cic": 12, "omega0": 13, "cis": 14, "i0": 15, "crc": 16, "omega": 17, "omega_dot": 18, "idot": 19,
}  # fmt: skip
_ISSUE, _TOE, _SOURCE, _ACCURACY, _HEALTH, _DELAY, _SENT = 3, 11, 20, 23, 24, 25, 27
_CHANNELS = (-7, 13)

T = TypeVar("T", KeplerRecords, GlonassRecords)


def kepler_records(file: RinexFile, records: Records, system: str) -> KeplerRecords:
    """Keplerian orbits of one system (G, E, C or J). Messages with a blank among their elements are left out, noted."""
    if not len(records.line):
        return no_kepler()
    values, toc = fields(file, records, 8), dates(file, records).astype(np.float64)
    offset = BDT_TO_GPS_S if system == "C" else 0.0
    elements = {name: values[:, k] for name, k in _PLACES.items()}
    toe, sent = _near(values[:, _TOE], toc, WEEK_S), _near(_known(values[:, _SENT]), toc, WEEK_S)
    # where nothing is stated: usable, of an issue that no message has, and no accuracy
    health, issue, source = (np.nan_to_num(values[:, k], nan=d) for k, d in ((_HEALTH, 0), (_ISSUE, -1), (_SOURCE, 0)))
    delay = values[:, _DELAY : _DELAY + 2].copy()
    if system in "GJ":
        delay[:, 1] = np.nan  # here stands the issue of the clock
    found = KeplerRecords(
        sat=records.sat,
        toe=toe + offset,
        toc=toc + offset,
        sent=sent + offset,
        **elements,
        group_delay=delay,
        health=np.round(health).astype(np.int64),
        accuracy=np.where(values[:, _ACCURACY] > 0.0, values[:, _ACCURACY], np.nan),
        issue=np.round(issue).astype(np.int64),
        source=np.round(source).astype(np.int64) if system == "E" else np.zeros(len(toc), dtype=np.int64),
    )
    complete = np.isfinite(np.column_stack((values[:, [*_PLACES.values(), _TOE]],))).all(axis=1)
    complete &= (found.sqrt_a > 0.0) & (found.e >= 0.0) & (found.e < 1.0)
    found = _complete(file, found, complete, system)
    if (unstated := int(np.isnan(values[complete, _HEALTH]).sum())) > 0:
        file.notes.append(f"{unstated} messages of {SYSTEM_NAMES[system]} state no health and were taken as usable.")
    key = np.column_stack((found.sat, found.toe, found.toc, found.issue, found.source, found.health))
    return _once(file, found, key, system)


def glonass_records(file: RinexFile, records: Records) -> GlonassRecords:
    """GLONASS states, on GPS time: the file's times are UTC."""
    if not len(records.line):
        return no_glonass()
    values, utc = fields(file, records, 4), dates(file, records)
    leaps = leap_seconds_at(utc, broadcast_leap_seconds(file))
    toe = utc.astype(np.float64)
    state = values[:, 3:].reshape(-1, 3, 4) * _KM
    channel = values[:, 10]
    channel = np.where(channel > 128, channel - 256, channel)  # some writers take the byte as one without a sign
    period = _DAY_S if file.version < 3.0 and not np.any(_known(values[:, 2]) >= _DAY_S) else WEEK_S
    found = GlonassRecords(
        sat=records.sat,
        toe=toe + leaps,
        sent=_near(_known(values[:, 2]), toe, period) + leaps,
        r_e=state[:, :, 0],
        v_e=state[:, :, 1],
        a_e=state[:, :, 2],
        clock=values[:, 0],
        rate=values[:, 1],
        channel=np.nan_to_num(channel, nan=99).astype(np.int64),
        health=np.nan_to_num(values[:, 6]).astype(np.int64),
    )
    complete = np.isfinite(values[:, [0, 1, 3, 4, 5, 7, 8, 9, 11, 12, 13]]).all(axis=1)
    complete &= (found.channel >= _CHANNELS[0]) & (found.channel <= _CHANNELS[1])
    found = _complete(file, found, complete, "R")
    return _once(file, found, np.column_stack((found.sat, found.toe, found.health)), "R")


def _known(sent: FloatArray) -> FloatArray:
    return np.where(np.abs(sent) < _NOT_KNOWN, sent, np.nan)


def _near(of_period: FloatArray, t: FloatArray, period: float) -> FloatArray:
    """Times known but for whole weeks or days, those next to ``t``: at the turn of a week the week's number is often
    the wrong one of two. Shapes (n,). [s]"""  # noqa: D209
    apart = of_period - np.mod(t, period)
    return t + apart - period * np.round(apart / period)


def _complete(file: RinexFile, found: T, complete: np.ndarray, system: str) -> T:
    if not complete.all():
        file.notes.append(
            f"{np.sum(~complete)} messages of {SYSTEM_NAMES[system]} lack elements or have impossible ones and were "
            "left out."
        )
    return _rows(found, np.flatnonzero(complete))


def _once(file: RinexFile, found: T, key: np.ndarray, system: str) -> T:
    """The first of messages that say the same."""
    if not len(found):
        return found
    _, first = np.unique(key, axis=0, return_index=True)
    if (twice := len(found) - len(first)) > 0:
        file.notes.append(f"{twice} messages of {SYSTEM_NAMES[system]} are there again and were left out.")
    return _rows(found, np.sort(first))


def _rows(found: T, k: np.ndarray) -> T:
    from dataclasses import fields as names

    return type(found)(**{f.name: getattr(found, f.name)[k] for f in names(found)})
