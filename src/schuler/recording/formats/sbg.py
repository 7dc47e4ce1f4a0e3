"""SBG Systems logs (sbgECom, as sbgCenter and the unit's data logger store them): IMU, GNSS, the INS as reference.

Layouts: SBG Systems, "sbgECom Binary Messages" and the frame's description in the same manual. Frames are found by
their CRC. The unit's axes are forward-right-down and it measures specific force.
"""

from __future__ import annotations

import binascii
import datetime as dt
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from schuler import rotation, units
from schuler.arrays import FloatArray
from schuler.exceptions import FileFormatError, InputError
from schuler.recording.io import parts
from schuler.recording.io.checks import unit_quaternions
from schuler.recording.io.hint_texts import parse_streams
from schuler.recording.io.hints import ReadHints
from schuler.recording.io.parts import Table
from schuler.recording.io.receiver_tables import (
    NO_VELOCITY,
    ClockLine,
    Columns,
    clock_line,
    floats,
    pick,
    preferred,
    same_time,
    unwrapped,
)
from schuler.recording.io.streams import Stream, stream_of
from schuler.recording.recording import Recording
from schuler.timebase import WEEK_S, TimeBase, gps_from_calendar

HINTS = {"axes", "streams", "time"}
ORDERS = {"imu": ("IMU_SHORT", "IMU_DATA"), "gnss": ("GPS1_POS", "GPS2_POS"), "reference": ("EKF_NAV",)}
_PARTS = {name: part for part, names in ORDERS.items() for name in names}
_STATUS, _TYPE_SHIFT = 0x3F, 6  # of a fix: zero is computed; its type
# RTKLIB's quality of a fix: single, pseudorange-differential, SBAS, float, fixed, PPP
_QUALITY = {1: 5, 2: 5, 3: 4, 4: 3, 5: 4, 6: 2, 7: 1, 8: 6, 9: 6}
_ACCEL, _GYRO, _GYRO_HIGH, _TEMP = 1048576.0, 67108864.0, 12304174.0, 256.0  # counts per SI unit of IMU_SHORT
_HIGH_RANGE = 1 << 10  # bit of its status
_UTC_SHIFT, _UTC_MASK = 6, 0xF  # of the status of UTC_TIME: 0 invalid, 1 leap seconds not known, 2 valid
_UTC_VALID = 2
_NAVIGATES, _MODE = 4, 0xF  # of an EKF status: position, velocity and attitude are there
_MS = 1e-3
SYNC = b"\xff\x5a"
_END = 0x33
HEAD, _TAIL = 6, 3  # sync, number, class, length; CRC and the last byte
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
US = 1e-6  # of stamps [s]
WRAP = 2.0**32 * US  # of the stamps, 71.6 minutes [s]


def sniff(head: bytes, path: Path) -> bool:
    """Whether there are two frames of sbgECom with right CRCs among the first bytes."""
    return looks_like(head)


def contents(path: Path) -> list[Stream]:
    """Logs of the file that can be read, and those of other kinds."""
    return _streams(load(path))


def _streams(log: Frames) -> list[Stream]:
    made = [stream_of(name, "sbgECom", rows["t"], _PARTS.get(name, "")) for name, rows in log.columns.items()]
    return made + [Stream(name, "sbgECom", count) for name, count in log.others.items()]


@np.errstate(invalid="ignore", over="ignore")  # what is no number is refused by the checks of parts.assemble
def read(path: Path, hints: ReadHints) -> Recording:
    """Recording of an SBG log.

    Parameters
    ----------
    path : Path
    hints : ReadHints
        ``streams`` chooses where there are several: ``imu`` (``IMU_SHORT``, ``IMU_DATA``), ``gnss`` (``GPS1_POS``,
        ``GPS2_POS``), ``reference`` (``EKF_NAV``); ``none`` leaves a part out. ``time="local"`` keeps the unit's clock.
        ``axes`` where the unit's alignment was not set to the vehicle.

    Returns
    -------
    Recording
        On GPS time where UTC_TIME relates the unit's clock to it, else on that clock.

    Raises
    ------
    FileFormatError, InputError
        If the log is damaged or holds none of these.
    """
    parts.check_hints(path, hints, HINTS, "an SBG log")
    if hints.time not in (None, "gps", "local"):
        raise InputError(f"time: an SBG log has time='gps' (by UTC_TIME) or 'local', got {hints.time!r}")
    log = load(path)
    notes, chosen, streams = list(log.notes), parse_streams(hints.streams), _streams(log)
    taken = {part: preferred(streams, part, chosen, order, notes) for part, order in ORDERS.items()}
    if hints.series is not None:
        taken = {part: name if part == hints.series else None for part, name in taken.items()}
    line = None if hints.time == "local" else _line(log, notes)
    if line is None and hints.time != "local":
        notes.append("The log has no valid UTC_TIME: stamps are those of the unit's own clock.")
    epoch = 0.0 if line is None else float(line.gps_at_zero // WEEK_S * WEEK_S)
    tables: dict[str, Table] = {}
    for part, name in taken.items():
        if name is None:
            continue
        rows = usable(part, name, log.columns[name], notes)
        rows = pick(rows, parts.later(rows["t"], name, path, notes))
        if part == "reference":
            rows = _with_attitude(log, rows, notes)
        if not len(rows["t"]):
            continue
        t = rows["t"] if line is None else line.seconds(rows["t"], epoch)
        if part == "imu":
            tables[part] = imu_table(name, t, rows, notes)
        elif part == "gnss":
            tables[part] = gnss_table(log, name, t, rows, notes, dated=line is not None)
        else:
            tables[part] = _reference(t, rows, notes)
    if not tables:
        present = ", ".join([*log.columns, *log.others])
        raise FileFormatError(f"expected IMU_SHORT, GPS1_POS or EKF_NAV with a solution, found {present}", path)
    base = TimeBase("local") if line is None else TimeBase("gps", epoch)
    return parts.assemble(path, tables, hints, base, notes)


def _line(log: Frames, notes: list[str]) -> ClockLine | None:
    """Relation of the unit's clock to GPS time; date and time of week tell the leap seconds between, so no table is."""
    utc = log.columns.get("UTC_TIME")
    if utc is None:
        return None
    line = clock_line(*utc_pairs(utc)[1:])
    if line is not None:
        notes.append(line.note("the unit's clock", "UTC_TIME"))
    return line


def utc_pairs(utc: Columns) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Places of valid UTC_TIME, times of the unit's clock, GPS times since 1980 in whole seconds and the rest. [s]"""
    valid = utc["status"].astype(np.int64) >> _UTC_SHIFT & _UTC_MASK == _UTC_VALID
    place, t, whole, rest = [], [], [], []
    for k in np.flatnonzero(valid):
        try:
            day = dt.datetime(int(utc["year"][k]), int(utc["month"][k]), int(utc["day"][k]))
        except ValueError:
            continue
        second = utc["hour"][k] * units.HR + utc["minute"][k] * units.MIN + utc["second"][k]
        moment = gps_from_calendar(day) + second
        leaps = round((utc["tow"][k] * _MS - moment - utc["nano"][k] * 1e-9) % WEEK_S)
        if moment > 0.0 and leaps <= 60 and utc["nano"][k] < 1e9:
            place.append(float(utc["place"][k]))
            t.append(float(utc["t"][k]))
            whole.append(moment + leaps)
            rest.append(utc["nano"][k] * 1e-9)
    return np.array(place), np.array(t), np.array(whole), np.array(rest)


def usable(part: str, name: str, rows: Columns, notes: list[str]) -> Columns:
    """Rows of a log that hold a solution."""
    if part == "imu":
        return rows
    status = rows["status"].astype(np.int64)
    if part == "gnss":
        good = (status & _STATUS == 0) & np.isin(status >> _TYPE_SHIFT & _STATUS, list(_QUALITY))
    else:
        good = status & _MODE == _NAVIGATES
    if not good.all():
        notes.append(f"{name}: {int((~good).sum())} epochs without a solution were left out.")
    return pick(rows, good)


def imu_table(name: str, t: FloatArray, rows: Columns, notes: list[str]) -> Table:
    """Samples of IMU_SHORT or IMU_DATA in SI at times. [s]"""
    accel = np.stack([rows[f"a{axis}"] for axis in "xyz"], axis=1)
    gyro = np.stack([rows[f"g{axis}"] for axis in "xyz"], axis=1)
    temp = rows["temp"]
    if name == "IMU_SHORT":
        high = rows["status"].astype(np.int64) & _HIGH_RANGE > 0
        accel, temp = accel / _ACCEL, temp / _TEMP
        gyro = gyro / np.where(high, _GYRO_HIGH, _GYRO)[:, None]
        notes.append("imu: IMU_SHORT, mean specific force and angular rate over the interval before each stamp.")
    else:
        notes.append(
            "imu: IMU_DATA, filtered by the unit for its output rate; log IMU_SHORT for navigation of your own."
        )
    values = {"t": t, "temp": temp}
    values |= {f"a{axis}": accel[:, k] for k, axis in enumerate("xyz")}
    return Table(values | {f"g{axis}": gyro[:, k] for k, axis in enumerate("xyz")})


def gnss_table(log: Frames, name: str, t: FloatArray, rows: Columns, notes: list[str], *, dated: bool) -> Table:
    """Fixes of a log of positions, with the velocities of their time of week; dated ones at that time. [s]"""
    if dated:  # the fix has its own time of week, to a millisecond; the clock tells the week
        sow = rows["tow"] * _MS
        t = sow + WEEK_S * np.round((t - sow) / WEEK_S)
        if len(t) > 1 and (np.diff(t) <= 0.0).any():
            later = parts.later(t, f"{name} by time of week", log.path, notes)
            t, rows = t[later], pick(rows, later)
    kind = rows["status"].astype(np.int64) >> _TYPE_SHIFT & _STATUS
    values = {
        "t": t,
        "lat": rows["lat"] * units.DEG,
        "lon": rows["lon"] * units.DEG,
        "h": rows["msl"] + rows["undulation"],
        "q": np.array([_QUALITY[int(k)] for k in kind], dtype=np.float64),
        "ns": np.where(rows["used"] < 255.0, rows["used"], 0.0),
    }
    values |= {axis: rows[axis] for axis in ("sn", "se", "sd")}
    notes.append(
        f"gnss: {name}, of the antenna; heights above mean sea level were made ellipsoidal with the receiver's own "
        f"undulation (median {np.median(rows['undulation']):.2f} m)."
    )
    moved = log.columns.get(name.replace("POS", "VEL"))
    if moved is None:
        return Table(values)
    good = moved["status"].astype(np.int64) & _STATUS == 0
    moved = pick(moved, good & (moved["svn"] > 0.0) & (moved["sve"] > 0.0) & (moved["svd"] > 0.0))
    match = same_time(rows["tow"].astype(np.int64), moved["tow"].astype(np.int64))
    matched = match >= 0
    if not matched.any():
        return Table(values)
    if not matched.all():
        notes.append(
            f"{name}: {int((~matched).sum())} positions have no velocity of the same time of week; it was set to zero "
            f"with a 1-sigma of {NO_VELOCITY:g} m/s."
        )
    for axis in "ned":
        values[f"v{axis}"] = np.where(matched, moved[f"v{axis}"][match], 0.0)
        values[f"sv{axis}"] = np.where(matched, moved[f"sv{axis}"][match], NO_VELOCITY)
    return Table(values)


def _with_attitude(log: Frames, rows: Columns, notes: list[str]) -> Columns:
    """EKF_NAV with the attitude of EKF_EULER or EKF_QUAT of the same stamp; without either, without attitude."""
    name = "EKF_EULER" if "EKF_EULER" in log.columns else "EKF_QUAT"
    attitude = log.columns.get(name)
    if attitude is None:
        notes.append("EKF_NAV comes without EKF_EULER or EKF_QUAT: the reference has no attitude.")
        return rows
    match = same_time(np.round(rows["t"] * 1e6).astype(np.int64), np.round(attitude["t"] * 1e6).astype(np.int64))
    if not (match >= 0).any():
        notes.append(f"{name} has no stamps of EKF_NAV: the reference has no attitude.")
        return rows
    if not (match >= 0).all():
        notes.append(f"EKF_NAV: {int((match < 0).sum())} epochs without {name} were left out.")
    rows, match = pick(rows, match >= 0), match[match >= 0]
    if name == "EKF_EULER":
        return rows | {angle: attitude[angle][match] for angle in ("roll", "pitch", "yaw")}
    q = np.stack([attitude[part][match] for part in ("qw", "qx", "qy", "qz")], axis=1)
    q = unit_quaternions(q, lambda row, text: FileFormatError(f"EKF_QUAT {row + 1}: {text}", log.path))
    angles = rotation.rpy_from_quat(q)
    return rows | {angle: angles[:, k] for k, angle in enumerate(("roll", "pitch", "yaw"))}


def _reference(t: FloatArray, rows: Columns, notes: list[str]) -> Table:
    values = {"t": t, "lat": rows["lat"] * units.DEG, "lon": rows["lon"] * units.DEG}
    values["h"] = rows["msl"] + rows["undulation"]
    values |= {name: rows[name] for name in ("vn", "ve", "vd", "roll", "pitch", "yaw") if name in rows}
    good_to = np.hypot(np.median(rows["sn"]), np.median(rows["se"]))
    notes.append(
        "reference: EKF_NAV, the unit's own solution, made of the same sensors: to compare with, not a truth; of the "
        f"point its settings name. By its own account it is good to {good_to:.3g} m horizontally (median)."
    )
    return Table(values)


@dataclass(frozen=True)
class Frames:
    """Frames of a log.

    Attributes
    ----------
    path : Path
    columns : dict of str to dict
        Fields of each log as they stand, but ``t`` in seconds since the sensor started, past the ends of its counter.
    others : dict of str to int
        Number of frames by other logs.
    notes : list of str
    """

    path: Path
    columns: dict[str, dict[str, FloatArray]]
    others: dict[str, int]
    notes: list[str]


def crc(body: bytes) -> int:
    """CRC-CCITT with the lowest bit first (polynomial 0x8408, from zero), by the routine for the highest bit first."""
    return int(f"{binascii.crc_hqx(body.translate(_MIRRORED), 0):016b}"[::-1], 2)


def stop_of(data: bytes, at: int) -> int | None:
    """Byte behind a frame that may start here, by the length it says; ``None`` if none can."""
    if at + HEAD > len(data):
        return None
    length = int.from_bytes(data[at + 4 : at + 6], "little")
    return None if length > _LONGEST else at + HEAD + length + _TAIL


def is_right(data: bytes, at: int, stop: int) -> bool:
    """Whether a frame has the last byte and the CRC that it must have."""
    if data[stop - 1] != _END:
        return False
    return crc(data[at + 2 : stop - _TAIL]) == int.from_bytes(data[stop - 3 : stop - 1], "little")


def _stop(data: bytes, at: int) -> int | None:
    """Byte behind a frame with a right CRC that starts here; ``None`` if there is none."""
    stop = stop_of(data, at)
    return stop if stop is not None and stop <= len(data) and is_right(data, at, stop) else None


def name_of(data: bytes, at: int) -> str | None:
    """Log of the frame that starts here; ``None`` if it is none of those that are read."""
    return _BY_NUMBER.get(data[at + 2]) if data[at + 3] == _LOGS else None


def looks_like(head: bytes) -> bool:
    """Whether there are two frames with right CRCs among the first bytes of a file."""
    seen = 0
    at = head.find(SYNC)
    while at >= 0:
        stop = _stop(head, at)
        seen += stop is not None
        if seen == 2:
            return True
        at = head.find(SYNC, at + 2 if stop is None else stop)
    return False


def load(path: Path) -> Frames:
    """Find and decode the frames of a log.

    Raises
    ------
    FileFormatError
        If there is none with a right CRC.
    """
    data = path.read_bytes()
    places: dict[str, list[tuple[int, int]]] = {}
    others: dict[str, int] = {}
    taken = 0
    at = data.find(SYNC)
    while at >= 0:
        stop = _stop(data, at)
        if stop is None:
            at = data.find(SYNC, at + 2)
            continue
        taken += stop - at
        name = name_of(data, at)
        if name is None:
            other = f"log {data[at + 2]} of class {data[at + 3]}"
            others[other] = others.get(other, 0) + 1
        else:
            places.setdefault(name, []).append((at, stop))
        at = data.find(SYNC, stop)
    if not taken:
        raise FileFormatError(
            "expected frames of sbgECom with a right CRC, found none: the file is damaged or of another kind (text of "
            "sbgCenter is read as a table: say columns=.. and units=..)",
            path,
        )
    notes = []
    if len(data) - taken > 16:
        notes.append(f"{len(data) - taken} of {len(data)} bytes belong to no frame with a right CRC.")
    columns = fields_of(data, places, notes)
    _count_on(columns)
    return Frames(path, columns, others, notes)


def fields_of(data: bytes, places: dict[str, list[tuple[int, int]]], notes: list[str]) -> dict[str, Columns]:
    """Fields of frames by log as they stand, and the place of each frame.

    Parameters
    ----------
    data : bytes
    places : dict of str to list
        First byte of each frame and the byte behind it.
    notes : list of str
        Takes what was left out.
    """
    buffer = np.frombuffer(data, dtype=np.uint8)
    columns: dict[str, Columns] = {}
    for name, spans in places.items():
        fields = [field.split() for field in LAYOUTS[name][1].split(",")]
        dtype = np.dtype([(label, f"<{kind}") for kind, label in fields])
        first, stop_at = np.array(spans, dtype=np.int64).T + np.array([[HEAD], [-_TAIL]])
        whole = stop_at - first >= dtype.itemsize
        if not whole.all():
            notes.append(f"{name}: {int((~whole).sum())} frames are shorter than this log is and were left out.")
        if whole.any():
            rows = buffer[first[whole][:, None] + np.arange(dtype.itemsize)].view(dtype)[:, 0]
            columns[name] = {label: floats(rows[label]) for _, label in fields}
            columns[name]["place"] = first[whole].astype(np.float64)
    return columns


def _count_on(columns: dict[str, dict[str, FloatArray]]) -> None:
    """Stamps of all logs in seconds, counted on over the ends of the counter they share."""
    if not columns:
        return
    place = np.concatenate([rows["place"] for rows in columns.values()])
    t = np.concatenate([rows["t"] for rows in columns.values()]) * US
    order = np.argsort(place, kind="stable")
    t[order] = unwrapped(t[order], WRAP)
    first = 0
    for rows in columns.values():
        rows["t"] = t[first : first + len(rows["t"])]
        first += len(rows["t"])
