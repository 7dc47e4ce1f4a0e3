"""Galileo navigation message I/NAV: words 1 to 5 to orbits and clocks, words 5 and 6 to ionosphere and leap seconds.

Galileo OS SIS ICD 2.1, sections 4.3 and 5.1. A nominal page of two seconds has an even and an odd part; 112 and 16 of
their bits make a word of 128, a check of 24 bits covers both. F/NAV (E5a) and C/NAV are not decoded.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from schuler.arrays import ArrayLike
from schuler.exceptions import InputError
from schuler.gnss.ephemerides import Ephemerides, no_glonass
from schuler.gnss.message_fields import (
    SEMICIRCLE,
    Field,
    bits_of,
    crc24q,
    kepler_records,
    nearest,
    unpack,
    weeks_off,
)
from schuler.timebase import WEEK_S

_BITS = 128
_FIRST_WEEK = 1024  # Galileo system time began with GPS week 1024
#: Where the words came from: E1-B or E5b, as the data source word of RINEX says; the clock is that for E5b and E1.
SOURCES = {"1B": 1 << 0 | 1 << 9, "7I": 1 << 2 | 1 << 9}

_ISSUE: tuple[Field, ...] = (("", 6, False, 1), ("issue", 10, False, 1))
_WORDS: dict[int, tuple[Field, ...]] = {
    1: (
        *_ISSUE, ("toe", 14, False, 60.0), ("m0", 32, True, 2.0**-31 * SEMICIRCLE), ("e", 32, False, 2.0**-33),
        ("sqrt_a", 32, False, 2.0**-19), ("", 2, False, 1),
    ),
    2: (
        *_ISSUE, ("omega0", 32, True, 2.0**-31 * SEMICIRCLE), ("i0", 32, True, 2.0**-31 * SEMICIRCLE),
        ("omega", 32, True, 2.0**-31 * SEMICIRCLE), ("idot", 14, True, 2.0**-43 * SEMICIRCLE), ("", 2, False, 1),
    ),
    3: (
        *_ISSUE, ("omega_dot", 24, True, 2.0**-43 * SEMICIRCLE), ("delta_n", 16, True, 2.0**-43 * SEMICIRCLE),
        ("cuc", 16, True, 2.0**-29), ("cus", 16, True, 2.0**-29), ("crc", 16, True, 2.0**-5),
        ("crs", 16, True, 2.0**-5), ("accuracy", 8, False, 1),
    ),
    4: (
        *_ISSUE, ("svid", 6, False, 1), ("cic", 16, True, 2.0**-29), ("cis", 16, True, 2.0**-29),
        ("toc", 14, False, 60.0), ("af0", 31, True, 2.0**-34), ("af1", 21, True, 2.0**-46), ("af2", 6, True, 2.0**-59),
        ("", 2, False, 1),
    ),
    5: (
        ("", 6, False, 1), ("ai0", 11, False, 2.0**-2), ("ai1", 11, True, 2.0**-8), ("ai2", 14, True, 2.0**-15),
        ("", 5, False, 1), ("bgd_e5a", 10, True, 2.0**-32), ("bgd_e5b", 10, True, 2.0**-32), ("hs_e5b", 2, False, 1),
        ("hs_e1b", 2, False, 1), ("dvs_e5b", 1, False, 1), ("dvs_e1b", 1, False, 1), ("week", 12, False, 1),
        ("tow", 20, False, 1.0), ("", 23, False, 1),
    ),
    6: (
        ("", 6, False, 1), ("", 56, False, 1), ("leap", 8, True, 1), ("", 16, False, 1), ("leap_week", 8, False, 1),
        ("leap_day", 3, False, 1), ("next_leap", 8, True, 1), ("tow", 20, False, 1.0), ("", 3, False, 1),
    ),
}  # fmt: skip


def ephemerides_of_inav(sat: ArrayLike, pages: ArrayLike, near_gps_s: ArrayLike, signal: str = "1B") -> Ephemerides:
    """Orbits, clocks, ionosphere and leap seconds of Galileo I/NAV pages as a receiver logged them.

    Parameters
    ----------
    sat : array_like of int, shape (n,)
        Satellites' numbers, see :func:`schuler.gnss.signals.satellite`.
    pages : array_like of int, shape (n, 8)
        Two times four words of 32 bits: 120 bits of the even part and 8 of padding, then the same of the odd part.
    near_gps_s : array_like, shape (n,)
        GPS time of reception to within some days: it settles the week. [s]
    signal : {"1B", "7I"}
        Signal of the pages, E1-B or E5b-I.

    Returns
    -------
    Ephemerides
        Health is put together as in RINEX: bit 0 data validity of E1-B, bits 1 and 2 its signal health, bit 6 and bits
        7 and 8 those of E5b. The accuracy is infinite where none is predicted (SISA 255).

    Raises
    ------
    InputError
        For arrays of other shapes or another signal.

    Notes
    -----
    Words 1 to 4 are put together when their issues of data agree. Word 5, which has none, is the last one received.
    """
    sat, pages = np.asarray(sat, dtype=np.int64), np.asarray(pages, dtype=np.int64)
    near = np.asarray(near_gps_s, dtype=np.float64)
    if pages.shape != (len(sat), 8) or near.shape != sat.shape:
        raise InputError(f"I/NAV: expected n satellites, n x 8 words and n times, got {pages.shape} and {near.shape}")
    if signal not in SOURCES:
        raise InputError(f"I/NAV comes on {' or '.join(SOURCES)}, got {signal!r}")
    parts: dict[int, dict[int, dict[str, float]]] = {}
    rows: dict[tuple[int, float, float, int], dict[str, Any]] = {}
    ai: tuple[float, float, float] | None = None
    leap_seconds: int | None = None
    wrong = other_week = 0
    for s, page, time in zip(sat.tolist(), pages.tolist(), near.tolist(), strict=True):
        word = checked_page(page)
        if word is None:
            wrong += 1
            continue
        number = word >> (_BITS - 6)
        if number not in _WORDS:
            continue
        part = unpack(word, _BITS, _WORDS[number])
        if number == 6:
            leap_seconds = _leap_seconds(part, nearest(part["tow"], time))
            continue
        held = parts.setdefault(s, {})
        if number == 5:
            part["sent"] = nearest(part["tow"], time)
            if weeks_off(part["week"] + _FIRST_WEEK, 12, part["sent"]) != 0:
                other_week += 1
                continue
            if part["ai0"] > 0.0 or part["ai1"] != 0.0 or part["ai2"] != 0.0:  # all zero: not available
                ai = (part["ai0"], part["ai1"], part["ai2"])
        held[number] = part
        if len(held) == 5 and held[1]["issue"] == held[2]["issue"] == held[3]["issue"] == held[4]["issue"]:
            row = _row(s, held, SOURCES[signal])
            rows.setdefault((s, row["toe"], row["toc"], int(row["issue"])), row)
    notes = [f"Galileo I/NAV: {len(sat)} pages, {len(rows)} ephemerides of {len({k[0] for k in rows})} satellites."]
    if wrong:
        notes.append(f"Galileo I/NAV: {wrong} pages with a wrong check or of alerts were left out.")
    if other_week:
        notes.append(f"Galileo I/NAV: {other_week} words of another week than the receiver's were left out.")
    return Ephemerides(kepler_records(list(rows.values())), no_glonass(), None, None, ai, leap_seconds, tuple(notes))


def checked_page(page: list[int]) -> int | None:
    """The word of 128 bits of a nominal page, or ``None`` if its parts or its check are wrong.

    Galileo OS SIS ICD 2.1, table 41: the check covers the 114 first bits of the even and the 82 first of the odd part.
    """
    even, odd = bits_of(page[:4], 32) >> 8, bits_of(page[4:], 32) >> 8  # 120 bits each
    if even >> 118 != 0b00 or odd >> 118 != 0b10:  # even or odd, then nominal or alert
        return None
    first, second = even >> 6, odd >> 38  # 114 and 82 bits
    check = odd >> 14 & 0xFFFFFF
    if crc24q(first << 82 | second, 196) != check:
        return None
    return (first & (1 << 112) - 1) << 16 | odd >> 102 & 0xFFFF


def sisa(index: float) -> float:
    """Signal-in-space accuracy, infinite where none is predicted (Galileo OS SIS ICD 2.1, table 89). [m]"""
    n = int(index)
    for first, last, start, step in (
        (0, 49, 0.0, 0.01),
        (50, 74, 0.5, 0.02),
        (75, 99, 1.0, 0.04),
        (100, 125, 2.0, 0.16),
    ):
        if first <= n <= last:
            return round(start + (n - first) * step, 2)
    return float("inf")


def _row(sat: int, parts: dict[int, dict[str, float]], source: int) -> dict[str, Any]:
    row: dict[str, Any] = {}
    for number in (5, 4, 3, 2, 1):
        row |= parts[number]
    sent = parts[5]["sent"]
    dvs_e1b, hs_e1b, dvs_e5b, hs_e5b = (int(row[name]) for name in ("dvs_e1b", "hs_e1b", "dvs_e5b", "hs_e5b"))
    health = dvs_e1b | hs_e1b << 1 | dvs_e5b << 6 | hs_e5b << 7
    return row | {
        "sat": sat,
        "toe": nearest(parts[1]["toe"], sent),
        "toc": nearest(parts[4]["toc"], sent),
        "group_delay": (parts[5]["bgd_e5a"], parts[5]["bgd_e5b"]),
        "accuracy": sisa(parts[3]["accuracy"]),
        "health": health,
        "source": source,
    }


def _leap_seconds(part: dict[str, float], now: float) -> int:
    week = int(now // WEEK_S)
    week += (int(part["leap_week"]) - week + 128) % 256 - 128
    return int(part["next_leap"] if now >= (week + part["leap_day"] / 7.0) * WEEK_S else part["leap"])
