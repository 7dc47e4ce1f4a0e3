"""Bit fields of navigation messages: cutting them out, checking them, and gathering them into records.

A message is a Python integer, its first transmitted bit the most significant one. A layout is a tuple of
``(name, bits, signed, scale)`` in the order of transmission, to be laid beside the table of an interface document.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import fields
from typing import Any

import numpy as np

from schuler.gnss.ephemerides import KeplerRecords, no_kepler
from schuler.timebase import WEEK_S

Field = tuple[str, int, bool, float]

#: Semicircles to radians with the value of pi all interface documents prescribe (IS-GPS-200 table 20-IV). [rad]
SEMICIRCLE = 3.1415926535898
_CRC24Q = 0x1864CFB


def bits_of(words: Iterable[int], width: int, kept: int | None = None) -> int:
    """Words put one behind the other, of each the first ``kept`` of its lowest ``width`` bits."""
    kept = width if kept is None else kept
    message = 0
    for word in words:
        message = message << kept | (int(word) & ((1 << width) - 1)) >> (width - kept)
    return message


def unpack(message: int, length: int, layout: Sequence[Field], start: int = 0) -> dict[str, float]:
    """Values of consecutive fields.

    Parameters
    ----------
    message : int
        Message of ``length`` bits.
    length : int
    layout : sequence of (str, int, bool, float)
        Name (empty for bits to skip), number of bits, whether two's complement, factor. Integers come back exact: every
        field has fewer than 53 bits.
    start : int
        Bits before the first field.
    """
    values: dict[str, float] = {}
    left = length - start
    for name, bits, signed, scale in layout:
        left -= bits
        if name:
            number = message >> left & ((1 << bits) - 1)
            if signed and number >> (bits - 1):
                number -= 1 << bits
            values[name] = number * scale
    return values


def crc24q(message: int, length: int) -> int:
    """24-bit cyclic redundancy check of Galileo, SBAS and RTCM (Galileo OS SIS ICD 2.1, 5.1.9.4)."""
    remainder = message << 24
    for bit in range(length + 23, 23, -1):
        if remainder >> bit & 1:
            remainder ^= _CRC24Q << (bit - 24)
    return remainder


def nearest(tow_s: float, near_s: float) -> float:
    """Time whose time of week is ``tow_s``, in the week that brings it nearest to ``near_s``. [s]"""
    return tow_s + WEEK_S * round((near_s - tow_s) / WEEK_S)


def weeks_off(week: float, bits: int, time_s: float) -> int:
    """Weeks between a truncated week number and the week of a time: 0 where they agree."""
    size = 1 << bits
    half = size // 2
    return (int(week) - int(time_s // WEEK_S) + half) % size - half


def accuracy_of_index(index: float) -> float:
    """1-sigma of a GPS or BeiDou user range accuracy index, infinite for "no prediction". [m]

    IS-GPS-200 20.3.3.3.1.3 and BDS-SIS-ICD B1I 5.2.4.4: ``2^(1 + N/2)`` rounded to a decimal up to N = 6,
    ``2^(N - 2)`` above.
    """
    n = int(index)
    if n >= 15:
        return float("inf")
    return round(2.0 ** (1.0 + n / 2.0), 1) if n <= 6 else 2.0 ** (n - 2)


def kepler_records(rows: Sequence[Mapping[str, Any]]) -> KeplerRecords:
    """Records of rows that hold every field by its name, but those that only newer messages have."""
    if not rows:
        return no_kepler()
    stated = [f.name for f in fields(KeplerRecords) if f.name in rows[0]]
    return KeplerRecords(**{name: np.array([row[name] for row in rows]) for name in stated})


def ionosphere_of(
    part: Mapping[str, float] | None,
) -> tuple[tuple[float, float, float, float] | None, tuple[float, float, float, float] | None]:
    """Klobuchar's coefficients, fields ``alpha0`` to ``beta3``; nothing where there is no message, or zeros."""
    if part is None:
        return None, None
    a, b = ([part[f"{name}{k}"] for k in range(4)] for name in ("alpha", "beta"))
    if not any(a) or not any(b):
        return None, None
    return (a[0], a[1], a[2], a[3]), (b[0], b[1], b[2], b[3])
