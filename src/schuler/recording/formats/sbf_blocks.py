"""Blocks of the Septentrio Binary Format: found by their CRC, and their fields as columns.

Layouts: Septentrio, "SBF Reference Guide" (block header, PVTGeodetic, DOP, PosCovGeodetic, VelCovGeodetic,
AttEuler, AttCovEuler, INSNavGeod, ExtSensorMeas).
"""

from __future__ import annotations

import binascii
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from schuler.arrays import FloatArray, IntArray
from schuler.exceptions import FileFormatError
from schuler.recording.formats.nmea import looks_like_nmea
from schuler.recording.io.receiver_tables import floats

SYNC = b"$@"
HEADER = 14  # sync, CRC, number, length, time of week [ms], week
_NUMBER = 0x1FFF  # the upper three bits are the revision
NOT_USED = -1e10  # floating-point numbers below are "do not use", -2e10
_COVARIANCE = "u1 mode,u1 error,f4 nn,f4 ee,f4 uu,f4 bb,f4 ne,f4 nu,f4 nb,f4 eu,f4 eb,f4 ub"
#: Number and fields behind the time of the blocks that are read; a field of a later revision may be missing.
LAYOUTS: dict[str, tuple[int, str]] = {
    "PVTGeodetic": (
        4007,
        "u1 mode,u1 error,f8 lat,f8 lon,f8 h,f4 undulation,f4 vn,f4 ve,f4 vu,f4 course,f8 clock,f4 drift,"
        "u1 system,u1 datum,u1 satellites",
    ),
    "DOP": (4001, "u1 satellites,u1 reserved,u2 pdop,u2 tdop,u2 hdop,u2 vdop"),
    "PosCovGeodetic": (5906, _COVARIANCE),
    "VelCovGeodetic": (5908, _COVARIANCE),
    "AttEuler": (5938, "u1 satellites,u1 error,u2 mode,u2 reserved,f4 heading,f4 pitch,f4 roll"),
    "AttCovEuler": (5939, "u1 reserved,u1 error,f4 heading,f4 pitch,f4 roll"),
    "INSNavGeod": (
        4226,
        "u1 mode,u1 error,u2 info,u2 age,f8 lat,f8 lon,f8 h,f4 undulation,u2 accuracy,u2 latency,u1 datum,"
        "u1 reserved,u2 parts",
    ),
    "ExtSensorMeas": (4050, "u1 n,u1 size"),
}
_BY_NUMBER = {number: name for name, (number, _) in LAYOUTS.items()}
_SUB = 12  # bytes of each part of INSNavGeod
_ATTITUDE, _VELOCITY = 2, 8  # bits of its list of parts
_MEASUREMENT = 28  # bytes of a measurement of ExtSensorMeas
_ACCELERATION, _RATE = 0, 1

Bytes = np.ndarray[Any, np.dtype[np.uint8]]


@dataclass(frozen=True)
class Blocks:
    """Blocks of a log.

    Attributes
    ----------
    path : Path
    data : ndarray of uint8
        The file.
    places : dict of str to ndarray of int, shape (n, 2)
        First byte and byte behind the last of each block, by name.
    others : dict of int to int
        Number of blocks by other block numbers.
    notes : list of str
    """

    path: Path
    data: Bytes
    places: dict[str, IntArray]
    others: dict[int, int]
    notes: list[str]

    def columns(self, name: str) -> dict[str, FloatArray]:
        """Fields of all blocks of a kind, with ``week`` and ``tow_ms``; ``at`` and ``stop`` are their places. (n,)"""
        spans = self.places.get(name, np.empty((0, 2), dtype=np.int64))
        at, stop = spans.T
        fields = [("ms", "<u4"), ("week", "<u2")]
        fields += [(label, f"<{kind}") for kind, label in (f.split() for f in LAYOUTS[name][1].split(","))]
        dtype = np.dtype(fields)
        whole = stop - at >= 8 + dtype.itemsize
        at, stop = at[whole], stop[whole]
        rows = self.data[at[:, None] + np.arange(8, 8 + dtype.itemsize)].view(dtype)[:, 0]
        made = {label: floats(rows[label]) for label, _ in fields}
        return made | {"at": at.astype(np.float64), "stop": stop.astype(np.float64)}

    def vectors(self, at: IntArray, kind: str) -> FloatArray:
        """Three numbers of a kind, ``<f4`` or ``<f8``, at each of the places. Shape (n, 3)."""
        size = 3 * np.dtype(kind).itemsize
        return floats(self.data[at[:, None] + np.arange(size)].view(kind))


def looks_like(head: bytes) -> bool:
    """Whether a block that is read, with a right CRC, is among the first bytes of a file; without NMEA, any block."""
    other = False
    at = head.find(SYNC)
    while at >= 0:
        stop = stop_of(head, at)
        if stop is not None and stop <= len(head) and is_right(head, at, stop):
            if name_of(head, at) is not None:
                return True
            other = True
        else:
            stop = at + 1
        at = head.find(SYNC, stop)
    return other and not looks_like_nmea(head)


def stop_of(data: bytes, at: int) -> int | None:
    """Byte behind a block that may start here, by its header; ``None`` if none can."""
    length = int.from_bytes(data[at + 6 : at + 8], "little")
    return at + length if length >= HEADER and length % 4 == 0 else None


def is_right(data: bytes, at: int, stop: int) -> bool:
    """Whether a block between two places has the CRC it says (CCITT, over all behind it)."""
    return binascii.crc_hqx(data[at + 4 : stop], 0) == int.from_bytes(data[at + 2 : at + 4], "little")


def name_of(data: bytes, at: int) -> str | None:
    """Name of the block that starts here; ``None`` for one that is not read."""
    return _BY_NUMBER.get(number_of(data, at))


def number_of(data: bytes, at: int) -> int:
    """Number of the block that starts here, without its revision."""
    return int.from_bytes(data[at + 4 : at + 6], "little") & _NUMBER


def load(path: Path) -> Blocks:
    """Find the blocks of a log.

    Raises
    ------
    FileFormatError
        If there is none with a right CRC, or more have a wrong one.

    Notes
    -----
    After a wrong CRC the search goes on behind the two bytes that start a block, so one is lost only if it is damaged
    itself.
    """
    data = path.read_bytes()
    block_spans: dict[str, list[tuple[int, int]]] = {}
    others: dict[int, int] = {}
    failed = total = done = 0
    beyond = -1
    at = data.find(SYNC)
    while at >= 0:
        stop = stop_of(data, at)
        if stop is not None and stop <= len(data) and is_right(data, at, stop):
            number, name = number_of(data, at), name_of(data, at)
            total += 1
            if name is not None:
                block_spans.setdefault(name, []).append((at, stop))
            else:
                others[number] = others.get(number, 0) + 1
            done = stop
            at = data.find(SYNC, stop)
            continue
        if stop is not None:
            if stop <= len(data):
                failed += 1
            elif beyond < done:
                beyond = at
        at = data.find(SYNC, at + 2)
    if not total or (failed > total and failed > 10):
        raise FileFormatError(
            f"expected blocks of SBF, found {total} with a right and {failed} with a wrong CRC: the file is damaged or "
            "of another kind",
            path,
        )
    notes = []
    if failed:
        notes.append(f"{failed} blocks with a wrong CRC were left out.")
    if beyond >= done and beyond >= 0:
        notes.append("The last block was cut off and left out.")
    places = {name: np.array(spans, dtype=np.int64) for name, spans in block_spans.items()}
    return Blocks(path, np.frombuffer(data, dtype=np.uint8), places, others, notes)


def inertial(log: Blocks) -> dict[str, FloatArray]:
    """Columns of INSNavGeod with attitude [deg] and velocity [m/s], for the blocks that have both. Shape (n,)."""
    rows = log.columns("INSNavGeod")
    bits = rows["parts"].astype(np.int64)
    counts = np.array([bin(k).count("1") for k in range(256)])
    first = rows["at"].astype(np.int64) + 56
    attitude = first + _SUB * counts[bits & (_ATTITUDE - 1)]
    velocity = first + _SUB * counts[bits & (_VELOCITY - 1)]
    both = (bits & _ATTITUDE > 0) & (bits & _VELOCITY > 0) & (velocity + _SUB <= rows["stop"])
    rows = {name: values[both] for name, values in rows.items()}
    turned, moved = log.vectors(attitude[both], "<f4"), log.vectors(velocity[both], "<f4")
    rows |= {name: turned[:, k] for k, name in enumerate(("heading", "pitch", "roll"))}
    return rows | {name: moved[:, k] for k, name in enumerate(("ve", "vn", "vu"))}


def sensor(log: Blocks, kind: int) -> dict[str, FloatArray]:
    """Measurements of one kind in ExtSensorMeas: 0 specific force [m/s^2], 1 angular rate [deg/s].

    Returns
    -------
    dict of str to ndarray, shape (n,)
        ``x y z``, ``source``, ``model``, ``week``, ``ms``; in order of the file.
    """
    rows = log.columns("ExtSensorMeas")
    at, stop = rows["at"].astype(np.int64), rows["stop"].astype(np.int64)
    size, n = rows["size"].astype(np.int64), rows["n"].astype(np.int64)
    pieces = []
    for k in range(int(n.max(initial=0))):
        place = at + 16 + k * size
        present = np.flatnonzero((n > k) & (size >= _MEASUREMENT) & (place + _MEASUREMENT <= stop))
        present = present[log.data[place[present] + 2] == kind]
        pieces.append(np.stack((present, place[present]), axis=1))
    pairs = np.concatenate(pieces) if pieces else np.empty((0, 2), dtype=np.int64)
    row, place = pairs[np.argsort(pairs[:, 1], kind="stable")].T
    xyz = log.vectors(place + 4, "<f8")
    made = {name: rows[name][row] for name in ("week", "ms")}
    made |= {axis: xyz[:, k] for k, axis in enumerate("xyz")}
    return made | {"source": log.data[place].astype(np.float64), "model": log.data[place + 1].astype(np.float64)}
