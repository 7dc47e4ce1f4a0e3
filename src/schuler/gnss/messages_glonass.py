"""GLONASS navigation message: strings 1 to 4 of a frame to a satellite's state and clock.

GLONASS ICD 5.1 (2008), sections 4.4 to 4.7 and table 4.5. Numbers are sign and magnitude, times are Moscow's.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import fields
from typing import Any

import numpy as np

from schuler.arrays import ArrayLike
from schuler.exceptions import InputError
from schuler.gnss.ephemerides import Ephemerides, GlonassRecords, no_glonass, no_kepler
from schuler.gnss.message_fields import Field, bits_of, unpack
from schuler.timebase import calendar, leap_seconds

_BITS = 85
_DAY_S = 86_400.0
_MOSCOW_S = 10_800.0  # ahead of UTC
_KM = 1000.0

_COORDINATE: tuple[Field, ...] = (("v", 24, False, 1), ("a", 5, False, 1), ("r", 27, False, 1))
_STRINGS: dict[int, tuple[Field, ...]] = {
    1: (("", 4, False, 1), ("hours", 5, False, 1), ("minutes", 6, False, 1), ("half", 1, False, 30.0), *_COORDINATE),
    2: (("bn", 3, False, 1), ("", 1, False, 1), ("tb", 7, False, 900.0), ("", 5, False, 1), *_COORDINATE),
    3: (
        ("", 1, False, 1), ("gamma", 11, False, 1), ("", 3, False, 1), ("ln", 1, False, 1), *_COORDINATE,
    ),
    4: (("tau", 22, False, 1), ("", 43, False, 1), ("slot", 5, False, 1), ("", 2, False, 1)),
}  # fmt: skip
_SIGNED = {
    "v": (24, _KM * 2.0**-20), "a": (5, _KM * 2.0**-30), "r": (27, _KM * 2.0**-11), "gamma": (11, 2.0**-40),
    "tau": (22, 2.0**-30),
}  # fmt: skip


def ephemerides_of_strings(
    sat: ArrayLike, words: ArrayLike, near_gps_s: ArrayLike, channel: ArrayLike, leap: int | None = None
) -> Ephemerides:
    """States and clocks of GLONASS strings as a receiver logged them, on GPS time.

    Parameters
    ----------
    sat : array_like of int, shape (n,)
        Satellites' numbers, see :func:`schuler.gnss.signals.satellite`.
    words : array_like of int, shape (n, 4)
        Words of 32 bits: the 85 bits of a string come first; in the last word the receiver numbers the superframe (the
        16 first bits) and the frame (the 4 last ones).
    near_gps_s : array_like, shape (n,)
        GPS time of reception to within some hours: it settles the day. [s]
    channel : array_like of int, shape (n,)
        Frequency channel, -7 to 13.
    leap : int, optional
        GPS - UTC; by default from the table of :mod:`schuler.timebase`. [s]

    Returns
    -------
    Ephemerides
        Its notes count the strings and those refused.

    Raises
    ------
    InputError
        For arrays of other shapes.

    Notes
    -----
    Strings 1 to 4 are put together when they carry the same frame number. A string with any failing check sum is left
    out; single errors are not corrected.
    """
    sat, words = np.asarray(sat, dtype=np.int64), np.asarray(words, dtype=np.int64)
    near, channel = np.asarray(near_gps_s, dtype=np.float64), np.asarray(channel, dtype=np.int64)
    if words.shape != (len(sat), 4) or near.shape != sat.shape or channel.shape != sat.shape:
        raise InputError(f"GLONASS: expected n satellites, n x 4 words, n times and channels, got {words.shape}")
    parts: dict[int, dict[int, dict[str, float]]] = {}
    frame_of: dict[int, int] = {}
    rows: dict[tuple[int, float], dict[str, Any]] = {}
    wrong = 0
    for s, four, time, k in zip(sat.tolist(), words.tolist(), near.tolist(), channel.tolist(), strict=True):
        message, frame = bits_of(four, 32) >> (128 - _BITS), four[3] & 0xFFFF000F
        if not checks(message):
            wrong += 1
            continue
        number = message >> (_BITS - 5) & 0xF
        if number not in _STRINGS:
            continue
        if frame_of.get(s) != frame:
            frame_of[s], parts[s] = frame, {}
        held = parts[s]
        held[number] = _signed(unpack(message, _BITS, _STRINGS[number], 5))
        if len(held) == 4:
            seconds = leap if leap is not None else leap_seconds(calendar(time - 18.0).date())
            row = _row(s, k, held, time, seconds)
            rows.setdefault((s, row["toe"]), row)
    notes = [f"GLONASS: {len(sat)} strings, {len(rows)} ephemerides of {len({k[0] for k in rows})} satellites."]
    if wrong:
        notes.append(f"GLONASS: {wrong} strings with a wrong check sum were left out.")
    records = no_glonass()
    if rows:
        records = GlonassRecords(**{f.name: np.array([r[f.name] for r in rows.values()]) for f in fields(records)})
    return Ephemerides(no_kepler(), records, notes=tuple(notes))


def checks(message: int) -> bool:
    """Whether the check sums of a string of 85 bits all hold (GLONASS ICD 5.1, table 4.13).

    It is a Hamming code of the 77 bits b85..b9, which stand at the places that are no powers of two, with the check
    bits b1..b7 at the powers of two; b8 makes the number of ones even.
    """
    return _syndrome(message) == 0 and message.bit_count() % 2 == 0


def _syndrome(message: int) -> int:
    """Seven check sums as bits: exclusive or of the places of all ones."""
    syndrome = 0
    for bit, place in enumerate(_PLACES):
        if message >> bit & 1:
            syndrome ^= place
    return syndrome


# place in the Hamming code of b1, b2, ...: check bits, the overall parity (at none), information bits
_PLACES: Sequence[int] = (*(1 << k for k in range(7)), 0, *(p for p in range(1, 85) if p & (p - 1)))


def _signed(part: dict[str, float]) -> dict[str, float]:
    """Sign and magnitude to numbers in SI."""
    for name, (bits, scale) in _SIGNED.items():
        if name in part:
            raw = int(part[name])
            magnitude = raw & (1 << (bits - 1)) - 1
            part[name] = (-magnitude if raw >> (bits - 1) else magnitude) * scale
    return part


def _row(sat: int, channel: int, parts: dict[int, dict[str, float]], near: float, leap: int) -> dict[str, Any]:
    def gps(moscow: float) -> float:
        """Nearest GPS time to a time of day in Moscow."""
        time = moscow - _MOSCOW_S + leap
        return time + _DAY_S * round((near - time) / _DAY_S)

    return {
        "sat": sat,
        "toe": gps(parts[2]["tb"]),
        "sent": gps(parts[1]["hours"] * 3600.0 + parts[1]["minutes"] * 60.0 + parts[1]["half"]),
        "r_e": tuple(parts[k]["r"] for k in (1, 2, 3)),
        "v_e": tuple(parts[k]["v"] for k in (1, 2, 3)),
        "a_e": tuple(parts[k]["a"] for k in (1, 2, 3)),
        "clock": -parts[4]["tau"],
        "rate": parts[3]["gamma"],
        "channel": channel,
        "health": int(int(parts[2]["bn"]) >= 4 or parts[3]["ln"] > 0),
    }
