"""Messages of NovAtel's OEM receivers: binary frames with long and short headers, and ASCII lines, each with a CRC.

Headers, checksum and fields are those of NovAtel's "OEM7 Commands and Logs Reference Manual" (Messages; 32-bit CRC).
Counts of the raw IMU messages: same manual, RAWIMUSX, table "Raw IMU Scale Factors"; for types that the manual gives
per sample at a rate, at that rate. Types without an entry are refused, not guessed.
"""

from __future__ import annotations

import re
import zlib
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType

import numpy as np

from schuler import units
from schuler.arrays import FloatArray
from schuler.exceptions import FileFormatError
from schuler.recording.formats.nmea import looks_like_nmea
from schuler.recording.io.receiver_tables import floats

SYNC = b"\xaa\x44"
_LONG, _SHORT = 0x12, 0x13
_LONG_BYTES, SHORT_BYTES, _CRC_BYTES = 28, 12, 4
_RESPONSE, _SOURCE = 0x80, 0x1F  # bits of the message type: an answer to a command; another antenna than the first
_ASCII = re.compile(rb"([#%])([A-Z][A-Z0-9]{2,30})A,([!-)+-:<-~ ]{3,200});([!-)+-~ ]{1,8000})\*([0-9a-fA-F]{8})")
_RIGHT = 0xFFFFFFFF  # what zlib makes of a frame and its CRC, which NovAtel neither starts nor ends with ones

SOLUTION_STATUS = MappingProxyType({"SOL_COMPUTED": 0})
#: Position and velocity types, by their names in ASCII.
TYPES = MappingProxyType({
    "NONE": 0, "FIXEDPOS": 1, "FIXEDHEIGHT": 2, "DOPPLER_VELOCITY": 8, "SINGLE": 16, "PSRDIFF": 17, "WAAS": 18,
    "PROPAGATED": 19, "OMNISTAR": 20, "L1_FLOAT": 32, "IONOFREE_FLOAT": 33, "NARROW_FLOAT": 34, "L1_INT": 48,
    "WIDE_INT": 49, "NARROW_INT": 50, "RTK_DIRECT_INS": 51, "INS_SBAS": 52, "INS_PSRSP": 53, "INS_PSRDIFF": 54,
    "INS_RTKFLOAT": 55, "INS_RTKFIXED": 56, "INS_OMNISTAR": 57, "INS_OMNISTAR_HP": 58, "INS_OMNISTAR_XP": 59,
    "OMNISTAR_HP": 64, "OMNISTAR_XP": 65, "CDGPS": 66, "EXT_CONSTRAINED": 67, "PPP_CONVERGING": 68, "PPP": 69,
    "OPERATIONAL": 70, "WARNING": 71, "OUT_OF_BOUNDS": 72, "INS_PPP_CONVERGING": 73, "INS_PPP": 74,
    "PPP_BASIC_CONVERGING": 77, "PPP_BASIC": 78, "INS_PPP_BASIC_CONVERGING": 79, "INS_PPP_BASIC": 80,
})  # fmt: skip
#: States of the inertial solution, by their names in ASCII.
INS_STATUS = MappingProxyType({
    "INS_INACTIVE": 0, "INS_ALIGNING": 1, "INS_HIGH_VARIANCE": 2, "INS_SOLUTION_GOOD": 3, "INS_SOLUTION_FREE": 6,
    "INS_ALIGNMENT_COMPLETE": 7, "DETERMINING_ORIENTATION": 8, "WAITING_INITIALPOS": 9, "WAITING_AZIMUTH": 10,
    "INITIALIZING_BIASES": 11, "MOTION_DETECT": 12,
})  # fmt: skip

# letters: d f double and single, i I int32 and uint32, H uint16, B uint8, s four characters; in ASCII also x X
# hexadecimal uint32 and uint8, S T N uint32 that are words (status, type, INS status), W any word
_BINARY = {
    "d": "<f8", "f": "<f4", "i": "<i4", "I": "<u4", "H": "<u2", "B": "u1", "s": "S4", "x": "<u4", "X": "u1",
    "S": "<u4", "T": "<u4", "N": "<u4", "W": "<u4",
}  # fmt: skip
_WORDS = {"S": SOLUTION_STATUS, "T": TYPES, "N": INS_STATUS}
_POSITION = (
    "S:status T:type d:lat d:lon d:msl f:undulation W:datum f:slat f:slon f:sh s:station f:age f:solution_age "
    "B:tracked B:used"
)
_VELOCITY = "S:status T:type f:latency f:age d:speed d:track d:up"
_PVA = "I:week d:sow d:lat d:lon d:h d:vn d:ve d:vu d:roll d:pitch d:azimuth N:ins"
_COUNTS = "x:imu_status i:az i:minus_ay i:ax i:gz i:minus_gy i:gx"
_HEADING = "S:status T:type f:baseline f:heading f:pitch f:reserved f:sheading f:spitch"
_CORRECTED = "I:week d:sow d:wx d:wy d:wz d:fx d:fy d:fz"
_STDDEV = "f:slat f:slon f:sh f:svn f:sve f:svu f:sroll f:spitch f:sazimuth"
#: Number and fields, as far as they are used, of the messages that are read.
LAYOUTS: dict[str, tuple[int, str]] = {
    "RAWIMUSX": (1462, f"X:info B:imu H:week d:sow {_COUNTS}"),
    "RAWIMUX": (1461, f"X:info B:imu H:week d:sow {_COUNTS}"),
    "RAWIMUS": (325, f"I:week d:sow {_COUNTS}"),
    "RAWIMU": (268, f"I:week d:sow {_COUNTS}"),
    "CORRIMUDATA": (812, _CORRECTED),
    "CORRIMUDATAS": (813, _CORRECTED),
    "CORRIMUS": (2264, "I:count d:wx d:wy d:wz d:fx d:fy d:fz"),
    "IMURATECORRIMUS": (1362, _CORRECTED),
    "BESTGNSSPOS": (1429, _POSITION),
    "BESTPOS": (42, _POSITION),
    "RTKPOS": (141, _POSITION),
    "PSRPOS": (47, _POSITION),
    "BESTGNSSVEL": (1430, _VELOCITY),
    "BESTVEL": (99, _VELOCITY),
    "PSRVEL": (100, _VELOCITY),
    "INSPVAX": (
        1465,
        "N:ins T:type d:lat d:lon d:msl f:undulation d:vn d:ve d:vu d:roll d:pitch d:azimuth " + _STDDEV,
    ),
    "INSPVA": (507, _PVA),
    "INSPVAS": (508, _PVA),
    "IMURATEPVA": (1778, _PVA),
    "IMURATEPVAS": (1305, _PVA),
    "INSSTDEV": (2051, _STDDEV),
    "INSSTDEVS": (2052, _STDDEV),
    "HEADING2": (1335, _HEADING),
    "DUALANTENNAHEADING": (2042, _HEADING),
    "INSCONFIG": (1945, "W:imu"),
}
_BY_NUMBER = {number: name for name, (number, _) in LAYOUTS.items()}

Columns = dict[str, FloatArray]
_HONEYWELL = 2.0**-33  # [rad]
_FINE, _COARSE = 2.0**-27 * units.FT, 2.0**-26 * units.FT  # [m/s]


@dataclass(frozen=True)
class Messages:
    """Messages of a log.

    Attributes
    ----------
    path : Path
    columns : dict of str to dict
        Numbers of each kind of message, with ``header_week`` and ``header_sow`` [s]. Shape (n,) each.
    words : dict of str to str
        First word of fields that ASCII writes as words of many: ``INSCONFIG.imu``.
    others : dict of str to int
        Number of messages by other kinds.
    notes : list of str
        On what was left out.
    """

    path: Path
    columns: dict[str, Columns]
    words: dict[str, str]
    others: dict[str, int]
    notes: list[str]


def looks_like(head: bytes) -> bool:
    """Whether a message that is read, with a right CRC, is among the first bytes of a file; without NMEA, any message.

    Receivers that log NMEA often put a line or two of their own before it.
    """
    other = False
    at = head.find(SYNC)
    while at >= 0:
        stop = stop_of(head, at)
        if stop is not None and stop <= len(head) and is_right(head, at, stop):
            if int.from_bytes(head[at + 4 : at + 6], "little") in _BY_NUMBER:
                return True
            other = True
        else:
            stop = at + 1
        at = head.find(SYNC, stop)
    for line in _ASCII.finditer(head):
        if _line_is_right(line):
            if line.group(2).decode() in LAYOUTS:
                return True
            other = True
    return other and not looks_like_nmea(head)


def stop_of(data: bytes, at: int) -> int | None:
    """Byte behind a frame by what its header says; ``None`` if it cannot be a header."""
    if at + SHORT_BYTES > len(data):
        return None
    if data[at + 2] == _SHORT:
        return at + SHORT_BYTES + data[at + 3] + _CRC_BYTES
    if data[at + 2] == _LONG and data[at + 3] >= _LONG_BYTES:
        return at + data[at + 3] + int.from_bytes(data[at + 8 : at + 10], "little") + _CRC_BYTES
    return None


def is_right(data: bytes, at: int, stop: int) -> bool:
    """Whether a frame between two places has the CRC it says."""
    return zlib.crc32(data[at:stop], _RIGHT) == _RIGHT


def name_of(data: bytes, at: int) -> str:
    """Kind of the message in the frame that starts here; one of :data:`LAYOUTS` if it is read."""
    number = int.from_bytes(data[at + 4 : at + 6], "little")
    name = _BY_NUMBER.get(number, f"message {number}")
    if data[at + 2] == _LONG and data[at + 6] & (_RESPONSE | _SOURCE):
        name += ", answer or other antenna"
    return name


def _line_is_right(line: re.Match[bytes]) -> bool:
    body = line.group()[1:-9]
    return zlib.crc32(body, _RIGHT) ^ _RIGHT == int(line.group(5), 16)


def load(path: Path) -> Messages:
    """Find and decode the messages of a log.

    Raises
    ------
    FileFormatError
        If no message has a right CRC, or more have a wrong one.

    Notes
    -----
    After a wrong CRC or a length beyond the end the search goes on behind the two bytes that start a frame, so a
    message is lost only if it is damaged itself.
    """
    data = path.read_bytes()
    notes: list[str] = []
    spans: dict[str, list[tuple[int, int]]] = {}
    others: dict[str, int] = {}
    failed = total = 0
    beyond = -1
    done = 0
    at = data.find(SYNC)
    while at >= 0:
        stop = stop_of(data, at)
        if stop is None or stop > len(data):
            beyond = at if stop is not None and beyond < done else beyond
            at = data.find(SYNC, at + 2)
            continue
        if not is_right(data, at, stop):
            failed += 1
            at = data.find(SYNC, at + 2)
            continue
        total += 1
        name = name_of(data, at)
        if name in LAYOUTS:
            spans.setdefault(name, []).append((at, stop))
        else:
            others[name] = others.get(name, 0) + 1
        done = stop
        at = data.find(SYNC, stop)
    columns = {name: gather(data, name, places, notes) for name, places in spans.items()}
    lines, words, lines_failed = _lines(data, others, notes)
    failed += lines_failed
    for name, rows in lines.items():
        if name not in columns or len(rows["header_week"]) > len(columns[name]["header_week"]):
            columns[name] = rows
        if name in spans:
            notes.append(f"{name} is in the log in binary and in ASCII; the one with more messages was read.")
    columns = {name: rows for name, rows in columns.items() if len(rows["header_week"])}
    total += sum(len(rows["header_week"]) for rows in lines.values())
    if not total or (failed > total and failed > 10):
        raise FileFormatError(
            f"expected messages of a NovAtel receiver, found {total} with a right and {failed} with a wrong CRC: the "
            "file is damaged or of another kind",
            path,
        )
    if failed:
        notes.append(f"{failed} messages with a wrong CRC were left out.")
    if beyond >= done and beyond >= 0:
        notes.append("The last message was cut off and left out.")
    return Messages(path, columns, words, others, notes)


def gather(data: bytes, name: str, places: list[tuple[int, int]], notes: list[str]) -> Columns:
    """Columns of binary frames between places of the file, all of them with one gather from it."""
    fields = [field.split(":") for field in LAYOUTS[name][1].split()]
    dtype = np.dtype([(label, _BINARY[letter]) for letter, label in fields])
    buffer = np.frombuffer(data, dtype=np.uint8)
    at, stop = np.array(places, dtype=np.int64).T
    is_long = buffer[at + 2] == _LONG
    begin = at + np.where(is_long, buffer[at + 3].astype(np.int64), SHORT_BYTES)
    whole = stop - _CRC_BYTES - begin >= dtype.itemsize
    if not whole.all():
        notes.append(f"{name}: {int((~whole).sum())} messages are shorter than this kind is and were left out.")
    at, begin, is_long = at[whole], begin[whole], is_long[whole]
    rows = buffer[begin[:, None] + np.arange(dtype.itemsize)].view(dtype)[:, 0]
    place = at + np.where(is_long, 14, 6)  # week; milliseconds follow
    week = buffer[place[:, None] + np.arange(2)].view("<u2")[:, 0]
    ms = buffer[place[:, None] + np.arange(2, 6)].view("<u4")[:, 0]
    made = {label: floats(rows[label]) for letter, label in fields if letter != "s"}
    return made | {"header_week": week.astype(np.float64), "header_sow": ms * 1e-3}


def _lines(data: bytes, others: dict[str, int], notes: list[str]) -> tuple[dict[str, Columns], dict[str, str], int]:
    """Columns of ASCII lines, words, and the number of lines with a wrong CRC."""
    rows: dict[str, list[list[float]]] = {}
    words: dict[str, str] = {}
    failed = strange = 0
    for line in _ASCII.finditer(data):
        if not _line_is_right(line):
            failed += 1
            continue
        name = line.group(2).decode()
        if name not in LAYOUTS:
            others[name] = others.get(name, 0) + 1
            continue
        head = line.group(3).decode().split(",")
        body = line.group(4).decode().split(",")
        try:
            week, sow = (head[4], head[5]) if line.group(1) == b"#" else (head[0], head[1])
            row = [float(week), float(sow)]
            for letter, label, text in _fields_of(name, body):
                if letter == "W":
                    words.setdefault(f"{name}.{label}", text.strip())
                    row.append(float(text) if text.isdecimal() else -1.0)
                else:
                    row.append(_number(letter, text))
        except (ValueError, IndexError, OverflowError):
            strange += 1
            continue
        rows.setdefault(name, []).append(row)
    if strange:
        notes.append(f"{strange} ASCII messages could not be read in spite of a right CRC and were left out.")
    made = {}
    for name, table in rows.items():
        labels = ["header_week", "header_sow"]
        labels += [f.split(":")[1] for f in LAYOUTS[name][1].split() if not f.startswith("s:")]
        made[name] = dict(zip(labels, np.array(table, dtype=np.float64).T.copy(), strict=True))
    return made, words, failed


def _fields_of(name: str, body: list[str]) -> list[tuple[str, str, str]]:
    """Letter, label and text of the fields of a line that are numbers."""
    fields = [field.split(":") for field in LAYOUTS[name][1].split()]
    if len(body) < len(fields):
        raise ValueError
    return [(f[0], f[1], text) for f, text in zip(fields, body, strict=False) if f[0] != "s"]


def _number(letter: str, text: str) -> float:
    if letter in "xX":
        return float(int(text, 16))
    if letter in _WORDS and not text.isdecimal():
        return float(_WORDS[letter].get(text.strip(), -1))
    return float(text)


@dataclass(frozen=True, slots=True)
class ImuType:
    """An IMU that a SPAN receiver reads.

    Attributes
    ----------
    name : str
        As INSCONFIG writes it.
    accel : float
        Velocity increment of one count. [m/s]
    gyro : float
        Angle increment of one count. [rad]
    rate_hz : float, optional
        Output rate, if it is sure. [Hz]
    """

    name: str
    accel: float
    gyro: float
    rate_hz: float | None = None


def _epson(name: str, accel_mg: float, gyro_deg_s: float, rate_hz: float) -> ImuType:
    """Epson's units count rates, in 1/65536 of their own step; increments follow from their rate."""
    return ImuType(name, accel_mg * units.MG / 65536.0 / rate_hz, gyro_deg_s * units.DEG / 65536.0 / rate_hz, rate_hz)


#: Types by the number in RAWIMUX, RAWIMUSX and INSCONFIG.
IMU_TYPES: Mapping[int, ImuType] = MappingProxyType({
    1: ImuType("HG1700_AG11", _FINE, _HONEYWELL, 100.0),
    4: ImuType("HG1700_AG17", _COARSE, _HONEYWELL, 100.0),
    5: ImuType("HG1900_CA29", _FINE, _HONEYWELL, 100.0),
    8: ImuType("LN200", 2.0**-14, 2.0**-19, 200.0),
    11: ImuType("HG1700_AG58", _FINE, _HONEYWELL, 100.0),
    12: ImuType("HG1700_AG62", _COARSE, _HONEYWELL, 100.0),
    13: ImuType("IMAR_FSAS", 0.05 * 2.0**-15, 0.1 * 2.0**-8 * units.ARCSEC, 200.0),
    16: ImuType("KVH_COTS", 0.05 * 2.0**-15, 0.1 / (3600.0 * 256.0)),
    20: ImuType("HG1930_AA99", _FINE, _HONEYWELL, 100.0),
    26: ImuType("ISA100C", 2.0e-8, 1.0e-9, 200.0),
    27: ImuType("HG1900_CA50", _FINE, _HONEYWELL, 100.0),
    28: ImuType("HG1930_CA50", _FINE, _HONEYWELL, 100.0),
    31: ImuType("ADIS16488", 200.0 * 2.0**-31, 720.0 * 2.0**-31 * units.DEG, 200.0),
    32: ImuType("STIM300", 2.0**-22, 2.0**-21 * units.DEG, 125.0),
    33: ImuType("KVH_1750", 0.05 * 2.0**-15, 0.1 / (3600.0 * 256.0), 200.0),
    41: _epson("EPSON_G320", 0.2, 0.008, 125.0),
    52: ImuType("LITEF_MICROIMU", 2.0e-8, 1.0e-9, 200.0),
    56: ImuType("STIM300D", 2.0**-22, 2.0**-21 * units.DEG, 125.0),
    58: ImuType("HG4930_AN01", 2.0**-29, _HONEYWELL, 100.0),
    61: _epson("EPSON_G370", 0.4, 0.0151515, 200.0),
    62: _epson("EPSON_G320_200HZ", 0.2, 0.008, 200.0),
    68: ImuType("HG4930_AN04", 2.0**-29, _HONEYWELL, 100.0),
    69: ImuType("HG4930_AN04_400HZ", 2.0**-29, _HONEYWELL, 400.0),
})  # fmt: skip


def by_name(name: str) -> ImuType | None:
    """The type of a name, with or without ``IMU_`` before it, or of a number as text; ``None`` if it is not known."""
    word = name.upper().removeprefix("IMU_")
    if word.isdecimal():
        return IMU_TYPES.get(int(word))
    return next((kind for kind in IMU_TYPES.values() if kind.name == word), None)
