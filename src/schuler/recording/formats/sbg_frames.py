"""Frames of SBG Systems' sbgECom protocol: found by their CRC, their fields as columns.

Layouts: SBG Systems, "sbgECom Binary Messages" and the frame's description in the same manual.
"""

from __future__ import annotations

import binascii
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from schuler.arrays import FloatArray
from schuler.exceptions import FileFormatError
from schuler.recording.formats.receiver_tables import floats, unwrapped

_SYNC = b"\xff\x5a"
_END = 0x33
_HEAD, _TAIL = 6, 3  # sync, number, class, length; CRC and the last byte
_LOGS = 0  # class of measurements and solutions
_LONGEST = 4086
_MIRRORED = bytes(int(f"{k:08b}"[::-1], 2) for k in range(256))
#: Number and fields of the logs that are read; a later version may have more behind them.
LAYOUTS: dict[str, tuple[int, str]] = {
    "UTC_TIME": (2, "u4 t,u2 status,u2 year,u1 month,u1 day,u1 hour,u1 minute,u1 second,u4 nano,u4 tow"),
    "IMU_DATA": (3, "u4 t,u2 status,f4 ax,f4 ay,f4 az,f4 gx,f4 gy,f4 gz,f4 temp"),
    "EKF_EULER": (6, "u4 t,f4 roll,f4 pitch,f4 yaw,f4 sroll,f4 spitch,f4 syaw,u4 status"),
    "EKF_QUAT": (7, "u4 t,f4 qw,f4 qx,f4 qy,f4 qz,f4 sroll,f4 spitch,f4 syaw,u4 status"),
    "EKF_NAV": (
        8,
        "u4 t,f4 vn,f4 ve,f4 vd,f4 svn,f4 sve,f4 svd,f8 lat,f8 lon,f8 msl,f4 undulation,f4 sn,f4 se,f4 sd,u4 status",
    ),
    "GPS1_VEL": (13, "u4 t,u4 status,u4 tow,f4 vn,f4 ve,f4 vd,f4 svn,f4 sve,f4 svd"),
    "GPS1_POS": (14, "u4 t,u4 status,u4 tow,f8 lat,f8 lon,f8 msl,f4 undulation,f4 sn,f4 se,f4 sd,u1 used"),
    "GPS2_VEL": (16, "u4 t,u4 status,u4 tow,f4 vn,f4 ve,f4 vd,f4 svn,f4 sve,f4 svd"),
    "GPS2_POS": (17, "u4 t,u4 status,u4 tow,f8 lat,f8 lon,f8 msl,f4 undulation,f4 sn,f4 se,f4 sd,u1 used"),
    "IMU_SHORT": (44, "u4 t,u2 status,i4 ax,i4 ay,i4 az,i4 gx,i4 gy,i4 gz,i2 temp"),
}
_BY_NUMBER = {number: name for name, (number, _) in LAYOUTS.items()}
_US = 1e-6
_WRAP = 2.0**32 * _US  # of the stamps, 71.6 minutes [s]


@dataclass(frozen=True)
class Frames:
    """Frames of a log.

    Attributes
    ----------
    path : Path
    columns : dict of str to dict
        Fields of each log as they stand, but ``t`` in seconds since the sensor started, past the ends of its counter.
    others : dict of str to int
        How many frames of other logs there are.
    notes : list of str
    """

    path: Path
    columns: dict[str, dict[str, FloatArray]]
    others: dict[str, int]
    notes: list[str]


def crc(body: bytes) -> int:
    """CRC-CCITT with the lowest bit first (polynomial 0x8408, from zero), by the routine for the highest bit first."""
    return int(f"{binascii.crc_hqx(body.translate(_MIRRORED), 0):016b}"[::-1], 2)


def _stop(data: bytes, at: int) -> int | None:
    """Byte behind a frame with a right CRC that starts here; ``None`` if there is none."""
    if at + _HEAD > len(data):
        return None
    length = int.from_bytes(data[at + 4 : at + 6], "little")
    stop = at + _HEAD + length + _TAIL
    if length > _LONGEST or stop > len(data) or data[stop - 1] != _END:
        return None
    right = crc(data[at + 2 : stop - _TAIL]) == int.from_bytes(data[stop - 3 : stop - 1], "little")
    return stop if right else None


def looks_like(head: bytes) -> bool:
    """Whether there are two frames with right CRCs among the first bytes of a file."""
    seen = 0
    at = head.find(_SYNC)
    while at >= 0:
        stop = _stop(head, at)
        seen += stop is not None
        if seen == 2:
            return True
        at = head.find(_SYNC, at + 2 if stop is None else stop)
    return False


def load(path: Path) -> Frames:
    """Find and decode the frames of a log.

    Raises
    ------
    FileFormatError
        If there is none with a right CRC.
    """
    data = path.read_bytes()
    found: dict[str, list[tuple[int, int]]] = {}
    others: dict[str, int] = {}
    taken = 0
    at = data.find(_SYNC)
    while at >= 0:
        stop = _stop(data, at)
        if stop is None:
            at = data.find(_SYNC, at + 2)
            continue
        taken += stop - at
        name = _BY_NUMBER.get(data[at + 2]) if data[at + 3] == _LOGS else None
        if name is None:
            other = f"log {data[at + 2]} of class {data[at + 3]}"
            others[other] = others.get(other, 0) + 1
        else:
            found.setdefault(name, []).append((at + _HEAD, stop - _TAIL))
        at = data.find(_SYNC, stop)
    if not taken:
        raise FileFormatError(
            "expected frames of sbgECom with a right CRC, found none: the file is damaged or of another kind (text of "
            "sbgCenter is read as a table: say columns=.. and units=..)",
            path,
        )
    notes = []
    if len(data) - taken > 16:
        notes.append(f"{len(data) - taken} of {len(data)} bytes belong to no frame with a right CRC.")
    buffer = np.frombuffer(data, dtype=np.uint8)
    columns: dict[str, dict[str, FloatArray]] = {}
    for name, spans in found.items():
        fields = [field.split() for field in LAYOUTS[name][1].split(",")]
        dtype = np.dtype([(label, f"<{kind}") for kind, label in fields])
        first, stop_at = np.array(spans, dtype=np.int64).T
        whole = stop_at - first >= dtype.itemsize
        if not whole.all():
            notes.append(f"{name}: {int((~whole).sum())} frames are shorter than this log is and were left out.")
        if whole.any():
            rows = buffer[first[whole][:, None] + np.arange(dtype.itemsize)].view(dtype)[:, 0]
            columns[name] = {label: floats(rows[label]) for _, label in fields}
            columns[name]["place"] = first[whole].astype(np.float64)
    _count_on(columns)
    return Frames(path, columns, others, notes)


def _count_on(columns: dict[str, dict[str, FloatArray]]) -> None:
    """Stamps of all logs in seconds, counted on over the ends of the counter they share."""
    if not columns:
        return
    place = np.concatenate([rows["place"] for rows in columns.values()])
    t = np.concatenate([rows["t"] for rows in columns.values()]) * _US
    order = np.argsort(place, kind="stable")
    t[order] = unwrapped(t[order], _WRAP)
    first = 0
    for rows in columns.values():
        rows["t"] = t[first : first + len(rows["t"])]
        first += len(rows["t"])
