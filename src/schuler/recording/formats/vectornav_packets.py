"""Packets of VectorNav sensors: binary output groups and ASCII lines, as columns.

Layouts: VectorNav, "VN-300 User Manual" and its interface control documents (binary output groups; asynchronous ASCII
outputs). Groups 1 to 7 are known as far as their fields have a fixed length; packets with others are counted.
"""

from __future__ import annotations

import binascii
import re
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from types import MappingProxyType

import numpy as np

from schuler.arrays import FloatArray
from schuler.exceptions import FileFormatError
from schuler.recording.io.receiver_tables import floats

SYNC = b"\xfa"
_GROUPS = 7
HEADER = 2 + 2 * _GROUPS  # bytes of the longest header, with the sync byte
_MORE = 0x80  # of the byte of groups: another such byte follows
_LINE = re.compile(rb"\$VN(YMR|IMU|INS|GPS|DTV),([-+0-9.A-Fa-f,]{5,300})\*([0-9A-Fa-f]{4}|[0-9A-Fa-f]{2})(?=[\r\n]|$)")
#: Bytes of each field of each group; zero where the length is not fixed or not known.
_LENGTHS = (
    (8, 8, 8, 12, 16, 12, 24, 12, 12, 24, 20, 28, 2, 4, 8, 0),
    (8, 8, 8, 2, 8, 8, 8, 4, 4, 1, 0, 0, 0, 0, 0, 0),
    (2, 12, 12, 12, 4, 4, 16, 12, 12, 12, 12, 2, 0, 0, 0, 0),
    (8, 8, 2, 1, 1, 24, 24, 12, 12, 12, 4, 4, 2, 28, 0, 0),
    (2, 12, 16, 36, 12, 12, 12, 12, 12, 0, 0, 0, 0, 0, 0, 0),
    (2, 24, 24, 12, 12, 12, 12, 12, 12, 4, 4, 0, 0, 0, 0, 0),
    (8, 8, 2, 1, 1, 24, 24, 12, 12, 12, 4, 4, 2, 28, 0, 0),
)
#: Names and types of the fields that are used, by group and bit: what a field holds in order.
_FIELDS: dict[tuple[int, int], str] = {
    (0, 0): "startup:u8", (0, 1): "gps:u8", (0, 3): "yaw:f4 pitch:f4 roll:f4", (0, 4): "qx:f4 qy:f4 qz:f4 qw:f4",
    (0, 5): "comp_gx:f4 comp_gy:f4 comp_gz:f4", (0, 6): "lat:f8 lon:f8 h:f8", (0, 7): "vn:f4 ve:f4 vd:f4",
    (0, 8): "comp_ax:f4 comp_ay:f4 comp_az:f4",
    (0, 9): "raw_ax:f4 raw_ay:f4 raw_az:f4 raw_gx:f4 raw_gy:f4 raw_gz:f4", (0, 10): "mx:f4 my:f4 mz:f4 temp:f4 pres:f4",
    (0, 11): "dt:f4 dthx:f4 dthy:f4 dthz:f4 dvx:f4 dvy:f4 dvz:f4", (0, 12): "ins:u2",
    (1, 0): "startup:u8", (1, 1): "gps:u8", (1, 2): "tow:u8", (1, 3): "week:u2", (1, 9): "time_status:u1",
    (2, 2): "raw_ax:f4 raw_ay:f4 raw_az:f4", (2, 3): "raw_gx:f4 raw_gy:f4 raw_gz:f4", (2, 4): "temp:f4",
    (2, 6): "dt:f4 dthx:f4 dthy:f4 dthz:f4", (2, 7): "dvx:f4 dvy:f4 dvz:f4",
    (2, 9): "comp_ax:f4 comp_ay:f4 comp_az:f4", (2, 10): "comp_gx:f4 comp_gy:f4 comp_gz:f4",
    (3, 1): "fix_tow:u8", (3, 2): "fix_week:u2", (3, 3): "ns:u1", (3, 4): "fix:u1",
    (3, 5): "fix_lat:f8 fix_lon:f8 fix_h:f8", (3, 7): "fix_vn:f4 fix_ve:f4 fix_vd:f4", (3, 9): "sn:f4 se:f4 sd:f4",
    (3, 10): "sv:f4",
    (4, 1): "yaw:f4 pitch:f4 roll:f4", (4, 2): "qx:f4 qy:f4 qz:f4 qw:f4",
    (5, 0): "ins:u2", (5, 1): "lat:f8 lon:f8 h:f8", (5, 4): "vn:f4 ve:f4 vd:f4", (5, 9): "spos:f4", (5, 10): "svel:f4",
}  # fmt: skip
#: Fields of the ASCII lines in order.
LINES = MappingProxyType({
    "YMR": "yaw pitch roll mx my mz comp_ax comp_ay comp_az comp_gx comp_gy comp_gz",
    "IMU": "mx my mz raw_ax raw_ay raw_az raw_gx raw_gy raw_gz temp pres",
    "INS": "sow week ins yaw pitch roll lat lon h vn ve vd satt spos svel",
    "GPS": "fix_sow fix_week fix ns fix_lat fix_lon fix_h fix_vn fix_ve fix_vd sn se sd sv st",
    "DTV": "dt dthx dthy dthz dvx dvy dvz",
})  # fmt: skip
_HEX = ("ins",)
_WHOLE = ("week", "fix_week", "fix", "ns")

Columns = dict[str, FloatArray]


@dataclass(frozen=True)
class Packets:
    """Packets of a log.

    Attributes
    ----------
    path : Path
    columns : dict of str to dict
        Numbers of each kind of packet: ``binary FA..`` by its header, ``VNIMU`` and so on. Times of 64 bits are split
        in whole seconds (``gps_s``) and the rest (``gps_rest``). Shape (n,) each.
    others : dict of str to int
        Packets that were not read.
    notes : list of str
    """

    path: Path
    columns: dict[str, Columns]
    others: dict[str, int]
    notes: list[str]


@lru_cache(maxsize=256)
def _layout(header: bytes) -> tuple[int, tuple[tuple[int, int, int], ...]] | None:
    """Bytes of the payload, and group, bit and place of each field; ``None`` if a field's length is not known."""
    fields = []
    length = k = 0
    for group in range(_GROUPS):
        if not header[0] >> group & 1:
            continue
        bits = int.from_bytes(header[1 + 2 * k : 3 + 2 * k], "little")
        k += 1
        for bit in range(16):
            if bits >> bit & 1:
                if _LENGTHS[group][bit] == 0:
                    return None
                fields.append((group, bit, length))
                length += _LENGTHS[group][bit]
    return length, tuple(fields)


def header_of(data: bytes, at: int) -> bytes | None:
    """Groups and fields of a packet that may start here; ``None`` if none can."""
    if at + 4 > len(data) or data[at + 1] == 0 or data[at + 1] & _MORE:
        return None
    stop = at + 2 + 2 * data[at + 1].bit_count()
    return data[at + 1 : stop] if stop <= len(data) else None


def _whole(data: bytes, at: int, header: bytes) -> int | None:
    """Byte behind a packet with a right CRC; ``None`` if there is none."""
    stop = _end(at, header)
    return stop if stop is not None and stop <= len(data) and is_right(data, at, stop) else None


def _end(at: int, header: bytes) -> int | None:
    """Byte behind a packet by its header; ``None`` if the length of a field is not known."""
    layout = _layout(header)
    return None if layout is None or layout[0] == 0 else at + 1 + len(header) + layout[0] + 2


def stop_of(data: bytes, at: int) -> int | None:
    """Byte behind a packet that may start here, by its header; ``None`` if none can."""
    header = header_of(data, at)
    return None if header is None else _end(at, header)


def is_right(data: bytes, at: int, stop: int) -> bool:
    """Whether a packet between two places has the CRC it says."""
    return binascii.crc_hqx(data[at + 1 : stop], 0) == 0


def looks_like(head: bytes) -> bool:
    """Whether there are two packets of one kind, or two lines, with right checksums among the first bytes."""
    seen: set[bytes] = set()
    at = head.find(SYNC)
    while at >= 0:
        header = header_of(head, at)
        stop = None if header is None else _whole(head, at, header)
        if stop is not None and header is not None:
            if header in seen:
                return True
            seen.add(header)
        at = head.find(SYNC, at + 1 if stop is None else stop)
    lines = [m for m in _LINE.finditer(head) if _line_is_right(m)]
    return len(lines) >= 2


def _line_is_right(line: re.Match[bytes]) -> bool:
    body, stated = line.group()[1 : -1 - len(line.group(3))], line.group(3)
    if len(stated) == 4:
        return binascii.crc_hqx(body, 0) == int(stated, 16)
    checksum = 0
    for byte in body:
        checksum ^= byte
    return checksum == int(stated, 16)


def load(path: Path) -> Packets:
    """Find and decode the packets of a log.

    Raises
    ------
    FileFormatError
        If there is none with a right checksum.
    """
    data = path.read_bytes()
    places: dict[bytes, list[int]] = {}
    unknown: dict[str, int] = {}
    taken = 0
    at = data.find(SYNC)
    while at >= 0:
        header = header_of(data, at)
        stop = None if header is None else _whole(data, at, header)
        if stop is None or header is None:
            at = data.find(SYNC, at + 1)
            continue
        places.setdefault(header, []).append(at)
        taken += stop - at
        at = data.find(SYNC, stop)
    notes: list[str] = []
    columns = {}
    for header, starts in places.items():
        if len(starts) == 1 and len(data) > 10_000:
            continue  # a checksum of 16 bits is right by chance once in 65536
        made = gather(data, header, np.array(starts, dtype=np.int64))
        if made:
            columns[f"binary {header.hex()}"] = made
        else:
            unknown[f"binary {header.hex()}"] = len(starts)
    failed = 0
    rows: dict[str, list[list[float]]] = {}
    for line in _LINE.finditer(data):
        taken += len(line.group()) + 2
        name = line.group(1).decode()
        if not _line_is_right(line):
            failed += 1
            continue
        labels = LINES[name].split()
        texts = line.group(2).decode().split(",")
        try:
            if len(texts) != len(labels):
                raise ValueError
            row = [_number(label, t) for label, t in zip(labels, texts, strict=True)]
        except ValueError:
            failed += 1
            continue
        rows.setdefault(name, []).append(row)
    for name, table in rows.items():
        columns[f"VN{name}"] = dict(zip(LINES[name].split(), np.array(table).T.copy(), strict=True))
    if failed:
        notes.append(f"{failed} lines with a wrong checksum or fields that are no numbers were left out.")
    if not columns and not unknown:
        raise FileFormatError(
            "expected packets of a VectorNav sensor with right checksums, found none: the file is damaged or of "
            "another kind (or has binary groups whose fields have no fixed length, such as raw measurements)",
            path,
        )
    strange = len(data) - taken
    if strange > 64:
        notes.append(f"{strange} of {len(data)} bytes belong to no packet that was understood.")
    return Packets(path, columns, unknown, notes)


def _number(label: str, text: str) -> float:
    """A field; those that are no whole numbers have a point, which a serial line may have lost. Raises ValueError."""
    if label in _HEX:
        return float(int(text, 16))
    if label not in _WHOLE and "." not in text:
        raise ValueError
    return float(text)


def gather(data: bytes, header: bytes, starts: np.ndarray) -> Columns:
    """Columns of packets with one header, by their first bytes; the first of two fields of one name counts."""
    layout = _layout(header)
    assert layout is not None
    buffer = np.frombuffer(data, dtype=np.uint8)
    first = starts + 1 + len(header)
    made: Columns = {}
    for group, bit, place in layout[1]:
        if (group, bit) not in _FIELDS:
            continue
        offset = place
        for field in _FIELDS[group, bit].split():
            name, kind = field.split(":")
            size = int(kind[1])
            values = buffer[(first + offset)[:, None] + np.arange(size)].view(f"<{kind}")[:, 0]
            offset += size
            if kind == "u8":
                if f"{name}_s" not in made:
                    made[f"{name}_s"] = (values // 1_000_000_000).astype(np.float64)
                    made[f"{name}_rest"] = (values % 1_000_000_000).astype(np.float64) * 1e-9
            elif name not in made:
                made[name] = floats(values)
    return made
