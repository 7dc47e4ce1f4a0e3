"""BeiDou navigation message D1: subframes 1 to 3 of the medium and inclined orbits to orbits and clocks.

BDS-SIS-ICD B1I 3.0, section 5.2; the same message is on B2I and B3I. D2 of the geostationary satellites is not decoded.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from schuler.arrays import ArrayLike
from schuler.exceptions import InputError
from schuler.gnss.ephemerides import Ephemerides, no_glonass
from schuler.gnss.message_fields import (
    SEMICIRCLE,
    Field,
    accuracy_of_index,
    ionosphere_of,
    kepler_records,
    nearest,
    unpack,
    weeks_off,
)
from schuler.timebase import WEEK_S

#: BeiDou time is behind GPS time by the leap seconds of 2006. [s]
BEHIND_GPS_S = 14.0
_FIRST_WEEK = 1356  # BeiDou time began with GPS week 1356
_BITS = 224  # 26 and nine times 22 bits, parity taken off
_PREAMBLE = 0b11100010010
_BCH = 0b10011  # x^4 + x + 1

_HEAD: tuple[Field, ...] = (
    ("preamble", 11, False, 1), ("", 4, False, 1), ("id", 3, False, 1), ("sow", 20, False, 1.0),
)  # fmt: skip
_SUBFRAMES: dict[int, tuple[Field, ...]] = {
    1: (
        ("health", 1, False, 1), ("aodc", 5, False, 1), ("accuracy", 4, False, 1), ("week", 13, False, 1),
        ("toc", 17, False, 8.0), ("tgd1", 10, True, 1e-10), ("tgd2", 10, True, 1e-10),
        ("alpha0", 8, True, 2.0**-30), ("alpha1", 8, True, 2.0**-27), ("alpha2", 8, True, 2.0**-24),
        ("alpha3", 8, True, 2.0**-24), ("beta0", 8, True, 2.0**11), ("beta1", 8, True, 2.0**14),
        ("beta2", 8, True, 2.0**16), ("beta3", 8, True, 2.0**16),
        ("af2", 11, True, 2.0**-66), ("af0", 24, True, 2.0**-33), ("af1", 22, True, 2.0**-50), ("issue", 5, False, 1),
    ),
    2: (
        ("delta_n", 16, True, 2.0**-43 * SEMICIRCLE), ("cuc", 18, True, 2.0**-31),
        ("m0", 32, True, 2.0**-31 * SEMICIRCLE), ("e", 32, False, 2.0**-33), ("cus", 18, True, 2.0**-31),
        ("crc", 18, True, 2.0**-6), ("crs", 18, True, 2.0**-6), ("sqrt_a", 32, False, 2.0**-19),
        ("toe_high", 2, False, 8.0 * 2**15),
    ),
    3: (
        ("toe_low", 15, False, 8.0), ("i0", 32, True, 2.0**-31 * SEMICIRCLE), ("cic", 18, True, 2.0**-31),
        ("omega_dot", 24, True, 2.0**-43 * SEMICIRCLE), ("cis", 18, True, 2.0**-31),
        ("idot", 14, True, 2.0**-43 * SEMICIRCLE), ("omega0", 32, True, 2.0**-31 * SEMICIRCLE),
        ("omega", 32, True, 2.0**-31 * SEMICIRCLE), ("", 1, False, 1),
    ),
}  # fmt: skip


def ephemerides_of_d1(sat: ArrayLike, words: ArrayLike, near_gps_s: ArrayLike) -> Ephemerides:
    """Orbits and clocks of BeiDou D1 subframes as a receiver logged them, on GPS time.

    Parameters
    ----------
    sat : array_like of int, shape (n,)
        Satellites' numbers, see :func:`schuler.gnss.signals.satellite`.
    words : array_like of int, shape (n, 10)
        Words of 30 bits in the low bits: 22 of information, 4 and 4 of parity, the interleaving undone as by u-blox.
    near_gps_s : array_like, shape (n,)
        GPS time of reception to within some days: it settles the week. [s]

    Returns
    -------
    Ephemerides
        With the ionosphere's eight parameters that came last.

    Raises
    ------
    InputError
        For arrays of other shapes.

    Notes
    -----
    The subframes carry no common issue of data (AODE is in the first only), and the reference time of the orbit is
    spread over the second and third. So only three that followed each other, six seconds apart, are put together.
    """
    sat, words = np.asarray(sat, dtype=np.int64), np.asarray(words, dtype=np.int64)
    near = np.asarray(near_gps_s, dtype=np.float64)
    if words.shape != (len(sat), 10) or near.shape != sat.shape:
        raise InputError(f"D1: expected n satellites, n x 10 words and n times, got {words.shape} and {near.shape}")
    parts: dict[int, dict[int, dict[str, float]]] = {}
    rows: dict[tuple[int, float, float, int], dict[str, Any]] = {}
    ionosphere: dict[str, float] | None = None
    wrong = other_week = 0
    for s, ten, time in zip(sat.tolist(), words.tolist(), near.tolist(), strict=True):
        message = checked_message(ten)
        if message is None:
            wrong += 1
            continue
        head = unpack(message, _BITS, _HEAD)
        number = int(head["id"])
        if head["preamble"] != _PREAMBLE:
            wrong += 1
            continue
        if number not in _SUBFRAMES:
            continue
        part = unpack(message, _BITS, _SUBFRAMES[number], 38)
        part["sent"] = nearest(head["sow"] + BEHIND_GPS_S, time)
        if number == 1 and weeks_off(part["week"] + _FIRST_WEEK, 13, part["sent"] - BEHIND_GPS_S) != 0:
            other_week += 1
            continue
        if number == 1:
            ionosphere = part
        held = parts.setdefault(s, {})
        held[number] = part
        first = held.get(1, {}).get("sent", -WEEK_S)
        if all(k in held and held[k]["sent"] - first == 6.0 * (k - 1) for k in (1, 2, 3)):
            row = _row(s, held)
            rows.setdefault((s, row["toe"], row["toc"], int(row["issue"])), row)
    notes = [f"BeiDou D1: {len(sat)} subframes, {len(rows)} ephemerides of {len({k[0] for k in rows})} satellites."]
    if wrong:
        notes.append(f"BeiDou D1: {wrong} subframes with a wrong parity or preamble were left out.")
    if other_week:
        notes.append(f"BeiDou D1: {other_week} subframes of another week than the receiver's were left out.")
    alpha, beta = ionosphere_of(ionosphere)
    return Ephemerides(
        kepler_records(list(rows.values())), no_glonass(), notes=tuple(notes), beidou_alpha=alpha, beidou_beta=beta
    )


def checked_message(words: Sequence[int]) -> int | None:
    """The 224 information bits of a subframe, or ``None`` if a parity is wrong.

    Each half word of 11 bits has 4 bits of parity (BDS-SIS-ICD B1I 3.0, 5.1.3); the first half of the first word has
    none. u-blox undoes the interleaving: two halves, then the parity of the first, then of the second.
    """
    first = int(words[0])
    if bch_remainder(first & 0x7FFF):
        return None
    message = first >> 4 & 0x3FFFFFF
    for word in map(int, words[1:]):
        one, two = word >> 15 & 0x7FF0 | word >> 4 & 0xF, word >> 4 & 0x7FF0 | word & 0xF
        if bch_remainder(one) or bch_remainder(two):
            return None
        message = message << 22 | word >> 8 & 0x3FFFFF
    return message


def bch_remainder(code: int) -> int:
    """Remainder of 15 bits by ``x^4 + x + 1``, zero for a code word."""
    for bit in range(14, 3, -1):
        if code >> bit & 1:
            code ^= _BCH << (bit - 4)
    return code


def _row(sat: int, parts: dict[int, dict[str, float]]) -> dict[str, Any]:
    row: dict[str, Any] = {**parts[3], **parts[2], **parts[1]}
    sent = parts[1]["sent"]
    toe = parts[2]["toe_high"] + parts[3]["toe_low"]
    return row | {
        "sat": sat,
        "toe": nearest(toe + BEHIND_GPS_S, sent),
        "toc": nearest(parts[1]["toc"] + BEHIND_GPS_S, sent),
        "group_delay": (parts[1]["tgd1"], parts[1]["tgd2"]),
        "accuracy": accuracy_of_index(parts[1]["accuracy"]),
        "source": 0,
    }
