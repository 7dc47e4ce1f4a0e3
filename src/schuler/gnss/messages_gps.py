"""GPS and QZSS navigation message LNAV: subframes 1 to 3 to orbits and clocks, page 18 of subframe 4 to the ionosphere.

IS-GPS-200N, section 20.3.3 and figures 20-1; QZSS L1 C/A has the same subframes (IS-QZSS-PNT-005, 4.3).
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np

from schuler.arrays import ArrayLike
from schuler.exceptions import InputError
from schuler.gnss.ephemerides import Ephemerides, no_glonass
from schuler.gnss.message_fields import (
    SEMICIRCLE,
    Field,
    accuracy_of_index,
    bits_of,
    ionosphere_of,
    kepler_records,
    nearest,
    unpack,
    weeks_off,
)
from schuler.timebase import WEEK_S

_BITS = 240  # ten words of 24 bits, parity taken off
_PREAMBLE = 0x8B
_PAGE_18 = 56  # "SV id" of subframe 4, page 18
# bits d1..d24 that enter D25..D30, and whether D29* (0) or D30* (1) of the word before does (table 20-XIV)
_PARITY = ((0xEC7CD2, 0), (0x763E69, 1), (0xBB1F34, 0), (0x5D8F9A, 1), (0xAEC7CD, 1), (0x2DEA27, 0))

_HEAD: tuple[Field, ...] = (
    ("preamble", 8, False, 1), ("", 16, False, 1), ("tow", 17, False, 6.0), ("", 2, False, 1), ("id", 3, False, 1),
    ("", 2, False, 1),
)  # fmt: skip
_SUBFRAMES: dict[int, tuple[Field, ...]] = {
    1: (
        ("week", 10, False, 1), ("", 2, False, 1), ("accuracy", 4, False, 1), ("health", 6, False, 1),
        ("iodc_high", 2, False, 1), ("", 24 * 3 + 16, False, 1), ("tgd", 8, True, 2.0**-31), ("issue", 8, False, 1),
        ("toc", 16, False, 16.0), ("af2", 8, True, 2.0**-55), ("af1", 16, True, 2.0**-43), ("af0", 22, True, 2.0**-31),
        ("", 2, False, 1),
    ),
    2: (
        ("issue", 8, False, 1), ("crs", 16, True, 2.0**-5), ("delta_n", 16, True, 2.0**-43 * SEMICIRCLE),
        ("m0", 32, True, 2.0**-31 * SEMICIRCLE), ("cuc", 16, True, 2.0**-29), ("e", 32, False, 2.0**-33),
        ("cus", 16, True, 2.0**-29), ("sqrt_a", 32, False, 2.0**-19), ("toe", 16, False, 16.0), ("", 8, False, 1),
    ),
    3: (
        ("cic", 16, True, 2.0**-29), ("omega0", 32, True, 2.0**-31 * SEMICIRCLE), ("cis", 16, True, 2.0**-29),
        ("i0", 32, True, 2.0**-31 * SEMICIRCLE), ("crc", 16, True, 2.0**-5),
        ("omega", 32, True, 2.0**-31 * SEMICIRCLE), ("omega_dot", 24, True, 2.0**-43 * SEMICIRCLE),
        ("issue", 8, False, 1), ("idot", 14, True, 2.0**-43 * SEMICIRCLE), ("", 2, False, 1),
    ),
    4: (
        ("data_id", 2, False, 1), ("page", 6, False, 1), ("alpha0", 8, True, 2.0**-30), ("alpha1", 8, True, 2.0**-27),
        ("alpha2", 8, True, 2.0**-24), ("alpha3", 8, True, 2.0**-24), ("beta0", 8, True, 2.0**11),
        ("beta1", 8, True, 2.0**14), ("beta2", 8, True, 2.0**16), ("beta3", 8, True, 2.0**16), ("", 72, False, 1),
        ("leap", 8, True, 1), ("leap_week", 8, False, 1), ("leap_day", 8, False, 1), ("next_leap", 8, True, 1),
        ("", 16, False, 1),
    ),
}  # fmt: skip


def ephemerides_of_lnav(sat: ArrayLike, words: ArrayLike, near_gps_s: ArrayLike) -> Ephemerides:
    """Orbits, clocks, ionosphere and leap seconds of GPS or QZSS subframes as a receiver logged them.

    Parameters
    ----------
    sat : array_like of int, shape (n,)
        Satellites' numbers, see :func:`schuler.gnss.signals.satellite`.
    words : array_like of int, shape (n, 10)
        Words of 30 bits in the low bits, source bits first, parity last, each turned back where D30* of the word before
        is one (as u-blox does).
    near_gps_s : array_like, shape (n,)
        GPS time of reception to within some days: it settles the week. [s]

    Returns
    -------
    Ephemerides
        Its notes count the subframes and those refused.

    Raises
    ------
    InputError
        For arrays of other shapes.

    Notes
    -----
    Subframes 1, 2 and 3 are put together when their issues of data agree (IODC's low bits and both IODE), whatever
    arrived between them. A subframe with a wrong parity, or a week that is not the receiver's, is left out and counted.
    """
    sat, words = np.asarray(sat, dtype=np.int64), np.asarray(words, dtype=np.int64)
    near = np.asarray(near_gps_s, dtype=np.float64)
    if words.shape != (len(sat), 10) or near.shape != sat.shape:
        raise InputError(f"LNAV: expected n satellites, n x 10 words and n times, got {words.shape} and {near.shape}")
    parts: dict[int, dict[int, dict[str, float]]] = {}
    rows: dict[tuple[int, float, float, int], dict[str, Any]] = {}
    ionosphere: dict[str, float] | None = None
    leap_seconds: int | None = None
    wrong = other_week = 0
    for s, ten, time in zip(sat.tolist(), words.tolist(), near.tolist(), strict=True):
        data = checked_words(ten)
        if data is None:
            wrong += 1
            continue
        message = bits_of(data, 24)
        head = unpack(message, _BITS, _HEAD)
        number = int(head["id"])
        if head["preamble"] != _PREAMBLE or number not in _SUBFRAMES:
            wrong += head["preamble"] != _PREAMBLE
            continue
        part = unpack(message, _BITS, _SUBFRAMES[number], 48)
        # the hand-over word holds the beginning of the next subframe
        part["sent"] = nearest(head["tow"] - 6.0, time)
        if number == 4:
            if part["page"] == _PAGE_18:
                ionosphere, leap_seconds = part, _leap_seconds(part, part["sent"])
            continue
        if number == 1 and weeks_off(part["week"], 10, part["sent"]) != 0:
            other_week += 1
            continue
        held = parts.setdefault(s, {})
        held[number] = part
        if len(held) == 3 and held[1]["issue"] == held[2]["issue"] == held[3]["issue"]:
            row = _row(s, held)
            rows.setdefault((s, row["toe"], row["toc"], int(row["issue"])), row)
    notes = [f"LNAV: {len(sat)} subframes, {len(rows)} ephemerides of {len({k[0] for k in rows})} satellites."]
    if wrong:
        notes.append(f"LNAV: {wrong} subframes with a wrong parity or preamble were left out.")
    if other_week:
        notes.append(f"LNAV: {other_week} subframes of another week than the receiver's were left out.")
    alpha, beta = ionosphere_of(ionosphere)
    kepler = kepler_records(list(rows.values()))
    return Ephemerides(kepler, no_glonass(), alpha, beta, None, leap_seconds, tuple(notes))


def checked_words(words: Iterable[int]) -> list[int] | None:
    """The 24 source bits of each of ten words, or ``None`` if a parity is wrong (IS-GPS-200 table 20-XIV).

    Satellites turn the source bits of a word round when D30* of the word before is one. u-blox turns the whole word
    back, so its parity is what comes out the wrong way. The last two bits before a subframe are zero, so its first word
    needs no word before it.
    """
    data, before = [], 0
    for word in words:
        source, check = int(word) >> 6 & 0xFFFFFF, int(word) & 0x3F
        if before & 1:
            check ^= 0x3F
        if check != parity(source, before):
            return None
        data.append(source)
        before = check & 3
    return data


def parity(source: int, before: int) -> int:
    """Bits D25 to D30 of 24 source bits, ``before`` being D29* and D30* of the word before (table 20-XIV)."""
    bits = 0
    for mask, which in _PARITY:
        star = before >> 1 & 1 if which == 0 else before & 1
        bits = bits << 1 | ((source & mask).bit_count() + star) & 1
    return bits


def _row(sat: int, parts: dict[int, dict[str, float]]) -> dict[str, Any]:
    row: dict[str, Any] = {**parts[3], **parts[2], **parts[1]}
    sent = parts[1]["sent"]
    return row | {
        "sat": sat,
        "toe": nearest(parts[2]["toe"], sent),
        "toc": nearest(parts[1]["toc"], sent),
        "group_delay": (parts[1]["tgd"], float("nan")),
        "accuracy": accuracy_of_index(parts[1]["accuracy"]),
        "source": 0,
    }


def _leap_seconds(part: dict[str, float], now: float) -> int:
    """Leap seconds in force: the announced ones once their day has ended."""
    week = int(now // WEEK_S)
    week += (int(part["leap_week"]) - week + 128) % 256 - 128
    return int(part["next_leap"] if now >= (week + part["leap_day"] / 7.0) * WEEK_S else part["leap"])
