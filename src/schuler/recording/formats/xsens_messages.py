"""Messages of Xsens MTi sensors (Xbus, MTData2): found by their checksum, their data items as columns.

Layouts: Xsens, "MT Low Level Communication Protocol Documentation" (message structure; MTData2).
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np

from schuler import units
from schuler.arrays import BoolArray, FloatArray
from schuler.exceptions import FileFormatError, InputError
from schuler.recording.io.parts import Table
from schuler.recording.io.receiver_tables import ClockLine, clock_line, floats, unwrapped
from schuler.recording.series import GnssSeries
from schuler.timebase import gps_from_unix

_START = 0xFA
SYNC = bytes([_START])
HEADER = 7  # bytes after which the length of any message is known
_MASTER = 0xFF
_MTDATA2 = 0x36
_LONG = 0xFF  # of the length: it follows in two bytes
_KIND, _FORMAT, _SYSTEM = 0xFFF0, 0x3, 0xC
#: Data items with numbers in one of four formats: name and how many.
ITEMS = MappingProxyType({
    0x0810: ("temp", 1), 0x2010: ("q", 4), 0x4010: ("dv", 3), 0x4020: ("a", 3), 0x4040: ("hra", 3), 0x5020: ("h", 1),
    0x5040: ("latlon", 2), 0x8020: ("g", 3), 0x8030: ("dq", 4), 0x8040: ("hrg", 3), 0xD010: ("v", 3),
})  # fmt: skip
#: Data items of whole numbers: their fields, big-endian.
WHOLE = MappingProxyType({
    0x1010: ("utc", ">u4 nano >u2 year u1 month u1 day u1 hour u1 minute u1 second u1 flags"),
    0x1020: ("counter", ">u2 value"),
    0x1060: ("fine", ">u4 value"),
    0x7010: (
        "gnss",
        ">u4 iTOW >u2 year u1 month u1 day u1 hour u1 min u1 second u1 valid >u4 tAcc >i4 nano u1 fixType u1 flags "
        "u1 numSV u1 reserved >i4 lon >i4 lat >i4 height >i4 hMSL >u4 hAcc >u4 vAcc >i4 velN >i4 velE >i4 velD "
        ">i4 gSpeed >i4 headMot >u4 sAcc",
    ),
})  # fmt: skip
#: Axes of orientations and velocities, by their bits: x, y, z are.
SYSTEMS = MappingProxyType({0x0: "ENU", 0x4: "NED", 0x8: "NWU"})
TICK = 1e-4  # of SampleTimeFine [s]
_RESOLVED = 0x7  # of UTC: date, time of day, and leap seconds are known


@dataclass(frozen=True)
class Packets:
    """Packets of one layout.

    Attributes
    ----------
    order : ndarray of int, shape (n,)
        Place of each in the file.
    numbers : dict of str to ndarray, shape (n, k)
        Items of numbers.
    fields : dict of str to dict
        Items of whole numbers. Shape (n,) each.
    systems : dict of str to str
        Axes of the items that have them.
    """

    order: np.ndarray[Any, np.dtype[np.int64]]
    numbers: dict[str, FloatArray]
    fields: dict[str, dict[str, FloatArray]]
    systems: dict[str, str]


def span_of(data: bytes, at: int) -> tuple[int, int] | None:
    """First byte of the payload and byte behind a message that may start here, by its length; ``None`` if none can."""
    if at + 5 > len(data) or data[at + 1] != _MASTER:
        return None
    first, length = at + 4, data[at + 3]
    if length == _LONG:
        if at + 7 > len(data):
            return None
        first, length = at + 6, int.from_bytes(data[at + 4 : at + 6], "big")
    return first, first + length + 1


def stop_of(data: bytes, at: int) -> int | None:
    """Byte behind a message that may start here; ``None`` if none can."""
    span = span_of(data, at)
    return None if span is None else span[1]


def is_right(data: bytes, at: int, stop: int) -> bool:
    """Whether a message has the checksum that it must have."""
    return sum(data[at + 1 : stop]) & 0xFF == 0


def is_data(message: bytes) -> bool:
    """Whether a message is MTData2."""
    return message[2] == _MTDATA2


def _whole(data: bytes, at: int) -> tuple[int, int] | None:
    """First byte of the payload and byte behind the checksum of a message that starts here; ``None`` if none does."""
    span = span_of(data, at)
    return span if span is not None and span[1] <= len(data) and is_right(data, at, span[1]) else None


def looks_like(head: bytes) -> bool:
    """Whether there are two messages with right checksums, one of them MTData2 with whole items."""
    seen = data2 = 0
    at = head.find(_START)
    while at >= 0:
        span = _whole(head, at)
        if span is None:
            at = head.find(_START, at + 1)
            continue
        seen += 1
        data2 += head[at + 2] == _MTDATA2 and span[1] - span[0] > 4 and bool(_items(head[span[0] : span[1] - 1]))
        if seen > 1 and data2:
            return True
        at = head.find(_START, span[1])
    return False


def _items(payload: bytes) -> tuple[tuple[int, int, int], ...]:
    """Identifier, place and length of each item; empty if they do not fill the payload."""
    items, at = [], 0
    while at + 3 <= len(payload):
        length = payload[at + 2]
        items.append((int.from_bytes(payload[at : at + 2], "big"), at + 3, length))
        at += 3 + length
    return tuple(items) if at == len(payload) else ()


def load(path: Path, notes: list[str]) -> list[Packets]:
    """Find and decode the MTData2 messages of a log, by layout.

    Parameters
    ----------
    path : Path
    notes : list of str
        Takes what was left out.

    Raises
    ------
    FileFormatError
        If there is none with a right checksum.
    """
    data = path.read_bytes()
    by_length: dict[int, list[int]] = {}
    others = taken = 0
    at = data.find(_START)
    while at >= 0:
        span = _whole(data, at)
        if span is None:
            at = data.find(_START, at + 1)
            continue
        first, stop = span
        if data[at + 2] == _MTDATA2:
            by_length.setdefault(stop - 1 - first, []).append(first)
        else:
            others += 1
        taken += stop - at
        at = data.find(_START, stop)
    if not by_length:
        raise FileFormatError(
            f"expected messages MTData2 of an Xsens sensor, found {others} others: set the output configuration to "
            "MTData2 items, or export as text with MT Manager",
            path,
        )
    if len(data) - taken > 16:
        notes.append(f"{len(data) - taken} of {len(data)} bytes belong to no message with a right checksum.")
    made, strange = packets_of(data, by_length)
    if strange:
        notes.append(f"{strange} messages whose items do not fill them were left out.")
    return made


def packets_of(data: bytes, by_length: dict[int, list[int]]) -> tuple[list[Packets], int]:
    """Decode MTData2 messages, by layout.

    Parameters
    ----------
    data : bytes
    by_length : dict of int to list of int
        First bytes of the payloads of each length.

    Returns
    -------
    packets : list of Packets
    strange : int
        Number of messages whose items do not fill them.
    """
    buffer = np.frombuffer(data, dtype=np.uint8)
    made = []
    strange = 0
    for length, starts in by_length.items():
        rest = np.array(starts, dtype=np.int64)
        for _ in range(64):  # layouts of one length; more are damage
            if not len(rest):
                break
            items = _items(data[rest[0] : rest[0] + length])
            if not items:
                strange += 1
                rest = rest[1:]
                continue
            heads = np.array([place + k for _, place, _ in items for k in (-3, -2, -1)])
            rows = buffer[rest[:, None] + heads]
            same = np.all(rows == rows[0], axis=1)
            made.append(_decode(buffer, rest[same], items))
            rest = rest[~same]
        strange += len(rest)
    return made, strange


def _decode(
    buffer: np.ndarray[Any, np.dtype[np.uint8]],
    first: np.ndarray[Any, np.dtype[np.int64]],
    items: tuple[tuple[int, int, int], ...],
) -> Packets:
    numbers: dict[str, FloatArray] = {}
    fields: dict[str, dict[str, FloatArray]] = {}
    systems: dict[str, str] = {}
    for identifier, place, length in items:
        kind = identifier & _KIND
        if kind in ITEMS:
            name, n = ITEMS[kind]
            values = _numbers(buffer, first + place, identifier & _FORMAT, n, length)
            if values is not None:
                numbers[name] = values
                systems[name] = SYSTEMS.get(identifier & _SYSTEM, "")
        elif kind in WHOLE:
            name, layout = WHOLE[kind]
            words = layout.split()
            dtype = np.dtype(list(zip(words[1::2], words[::2], strict=True)))
            if length >= dtype.itemsize:
                rows = buffer[(first + place)[:, None] + np.arange(dtype.itemsize)].view(dtype)[:, 0]
                fields[name] = {label: rows[label].astype(np.float64) for label in words[1::2]}
    return Packets(first, numbers, fields, systems)


def _numbers(
    buffer: np.ndarray[Any, np.dtype[np.uint8]],
    place: np.ndarray[Any, np.dtype[np.int64]],
    form: int,
    n: int,
    length: int,
) -> FloatArray | None:
    """Numbers of one item: single, fixed point 12.20, fixed point 16.32 or double. Shape (m, n)."""
    size = (4, 4, 6, 8)[form]
    if length != n * size:
        return None
    raw = buffer[place[:, None] + np.arange(length)]
    if form == 2:  # the fraction first, then the signed whole part
        six = raw.reshape(-1, n, 6)
        fraction = np.ascontiguousarray(six[:, :, :4]).view(">u4")[:, :, 0].astype(np.float64)
        whole = np.ascontiguousarray(six[:, :, 4:]).view(">i2")[:, :, 0].astype(np.float64)
        return np.asarray(whole + fraction * 2.0**-32)
    values = floats(raw.view((">f4", ">i4", "", ">f8")[form]))
    return values * 2.0**-20 if form == 1 else values


def utc_line(packets: list[Packets], notes: list[str]) -> ClockLine | None:
    """Relation of the sensor's clock to GPS time by the UTC in its packets; ``None`` without."""
    t, unix = utc_pairs(packets)[1:]
    if len(t) < 2:
        return None
    t = unwrapped(t, 2.0**32 * TICK)
    try:
        gps = gps_from_unix(unix[:, 0])
    except InputError as error:
        notes.append(f"UTC of the packets was not used: {error}")
        return None
    line = clock_line(t, gps, unix[:, 1])
    if line is not None:
        notes.append(line.note("SampleTimeFine", "the packets' UTC"))
    return line


def utc_pairs(packets: list[Packets]) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Places of packets with valid UTC in order, SampleTimeFine as it stands, and Unix time in two parts.

    Shapes (n,), (n,) [s], (n, 2) [s].
    """
    clock, utc = [], []
    for p in packets:
        if "utc" not in p.fields or "fine" not in p.fields:
            continue
        f = p.fields["utc"]
        good = _valid_utc(f)
        clock.append(np.stack((p.order[good], p.fields["fine"]["value"][good] * TICK), axis=1))
        utc.append(_unix(f, good))
    pairs = np.concatenate(clock) if clock else np.empty((0, 2))
    unix = np.concatenate(utc) if utc else np.empty((0, 2))
    order = np.argsort(pairs[:, 0], kind="stable")
    return pairs[order, 0], pairs[order, 1], unix[order]


def _valid_utc(f: dict[str, FloatArray]) -> BoolArray:
    good = (f["flags"].astype(np.int64) & _RESOLVED == _RESOLVED) & (f["year"] >= 1981) & (f["year"] < 2100)
    good &= (f["month"] >= 1) & (f["month"] <= 12) & (f["day"] >= 1) & (f["day"] <= 31)
    return np.asarray(good & (f["hour"] < 24) & (f["minute"] < 60) & (f["second"] < 61) & (f["nano"] < 1e9))


def _unix(f: dict[str, FloatArray], good: BoolArray) -> FloatArray:
    """Unix time in whole seconds and the rest. Shape (n, 2). [s]"""
    y, m, d = (f[name][good].astype(np.int64) for name in ("year", "month", "day"))
    months = ((y - 1970) * 12 + m - 1).astype("datetime64[M]")
    days = months.astype("datetime64[D]").astype(np.int64) + d - 1
    seconds = days * 86_400 + (f["hour"][good] * units.HR + f["minute"][good] * units.MIN + f["second"][good])
    return np.stack((seconds, f["nano"][good] * 1e-9), axis=1)


def fixes_of(packets: list[Packets]) -> list[dict[str, Any]]:
    """GnssPvtData as the fields of UBX-NAV-PVT, of which it is a copy, in order; repeated ones once."""
    placed = []
    for p in packets:
        if "gnss" not in p.fields:
            continue
        f = p.fields["gnss"]
        for k, place in enumerate(p.order):
            m = {name: int(values[k]) for name, values in f.items()}
            placed.append((int(place), m))
    placed.sort(key=lambda entry: entry[0])
    made: list[dict[str, Any]] = []
    last = None
    for _, m in placed:
        if m["iTOW"] == last:
            continue
        last = m["iTOW"]
        made.append(m | {
            "validDate": m["valid"] & 1, "validTime": m["valid"] >> 1 & 1, "gnssFixOk": m["flags"] & 1, "invalidLlh": 0,
            "carrSoln": m["flags"] >> 6 & 3, "diffSoln": m["flags"] >> 1 & 1, "lat": m["lat"] * 1e-7,
            "lon": m["lon"] * 1e-7,
        })  # fmt: skip
    return made


def gnss_table(gnss: GnssSeries, shift: float) -> Table:
    """The series as a table with times ``shift`` later. [s]"""
    assert gnss.cov_v_n is not None
    sigma, sigma_v = (np.sqrt(np.einsum("nii->ni", C)) for C in (gnss.cov_r_n, gnss.cov_v_n))
    values = {"t": gnss.t + shift}
    for names, columns in (
        (("lat", "lon", "h"), gnss.llh),
        (("vn", "ve", "vd"), gnss.v_n),
        (("sn", "se", "sd"), sigma),
        (("svn", "sve", "svd"), sigma_v),
    ):
        assert columns is not None
        values |= {name: columns[:, k] for k, name in enumerate(names)}
    assert gnss.quality is not None
    assert gnss.n_satellites is not None
    return Table(values | {"q": gnss.quality.astype(np.float64), "ns": gnss.n_satellites.astype(np.float64)})
