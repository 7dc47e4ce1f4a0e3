"""SBG Systems logs (sbgECom, as sbgCenter and the unit's data logger store them): IMU, GNSS, the INS as reference.

Frames in ``sbg_frames``. The unit's axes are forward-right-down and it measures specific force.
"""

from __future__ import annotations

import datetime as dt
from pathlib import Path

import numpy as np

from schuler import rotation, units
from schuler.arrays import FloatArray
from schuler.exceptions import FileFormatError, InputError
from schuler.recording.formats import parts
from schuler.recording.formats.parts import Table
from schuler.recording.formats.receiver_tables import (
    NO_VELOCITY,
    ClockLine,
    Columns,
    clock_line,
    pick,
    preferred,
    same_time,
)
from schuler.recording.formats.sbg_frames import Frames, load, looks_like
from schuler.recording.formats.streams import Stream, stream_of
from schuler.recording.io.hint_texts import parse_streams
from schuler.recording.io.hints import ReadHints
from schuler.recording.recording import Recording
from schuler.timebase import WEEK_S, TimeBase, gps_from_calendar

_HINTS = {"axes", "streams", "time"}
_ORDERS = {"imu": ("IMU_SHORT", "IMU_DATA"), "gnss": ("GPS1_POS", "GPS2_POS"), "reference": ("EKF_NAV",)}
_PARTS = {name: part for part, names in _ORDERS.items() for name in names}
_STATUS, _TYPE_SHIFT = 0x3F, 6  # of a fix: zero is computed; its type
# RTKLIB's quality of a fix: single, pseudorange-differential, SBAS, float, fixed, PPP
_QUALITY = {1: 5, 2: 5, 3: 4, 4: 3, 5: 4, 6: 2, 7: 1, 8: 6, 9: 6}
_ACCEL, _GYRO, _GYRO_HIGH, _TEMP = 1048576.0, 67108864.0, 12304174.0, 256.0  # counts per SI unit of IMU_SHORT
_HIGH_RANGE = 1 << 10  # bit of its status
_UTC_SHIFT, _UTC_MASK = 6, 0xF  # of the status of UTC_TIME: 0 invalid, 1 leap seconds not known, 2 valid
_UTC_VALID = 2
_NAVIGATES, _MODE = 4, 0xF  # of an EKF status: position, velocity and attitude are there
_MS = 1e-3


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
    parts.check_hints(path, hints, _HINTS, "an SBG log")
    if hints.time not in (None, "gps", "local"):
        raise InputError(f"time: an SBG log has time='gps' (by UTC_TIME) or 'local', got {hints.time!r}")
    log = load(path)
    notes, chosen, streams = list(log.notes), parse_streams(hints.streams), _streams(log)
    taken = {part: preferred(streams, part, chosen, order, notes) for part, order in _ORDERS.items()}
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
        rows = _usable(part, name, log.columns[name], notes)
        rows = pick(rows, parts.later(rows["t"], name, path, notes))
        if part == "reference":
            rows = _with_attitude(log, rows, notes)
        if not len(rows["t"]):
            continue
        t = rows["t"] if line is None else line.seconds(rows["t"], epoch)
        if part == "imu":
            tables[part] = _imu(name, t, rows, notes)
        elif part == "gnss":
            tables[part] = _gnss(log, name, t, rows, notes, dated=line is not None)
        else:
            tables[part] = _reference(t, rows, notes)
    if not tables:
        there = ", ".join([*log.columns, *log.others])
        raise FileFormatError(f"expected IMU_SHORT, GPS1_POS or EKF_NAV with a solution, found {there}", path)
    base = TimeBase("local") if line is None else TimeBase("gps", epoch)
    return parts.assemble(path, tables, hints, base, notes)


def _line(log: Frames, notes: list[str]) -> ClockLine | None:
    """Relation of the unit's clock to GPS time; date and time of week tell the leap seconds between, so no table is."""
    utc = log.columns.get("UTC_TIME")
    if utc is None:
        return None
    valid = utc["status"].astype(np.int64) >> _UTC_SHIFT & _UTC_MASK == _UTC_VALID
    t, whole, rest = [], [], []
    for k in np.flatnonzero(valid):
        try:
            day = dt.datetime(int(utc["year"][k]), int(utc["month"][k]), int(utc["day"][k]))
        except ValueError:
            continue
        second = utc["hour"][k] * units.HR + utc["minute"][k] * units.MIN + utc["second"][k]
        moment = gps_from_calendar(day) + second
        leaps = round((utc["tow"][k] * _MS - moment - utc["nano"][k] * 1e-9) % WEEK_S)
        if moment > 0.0 and leaps <= 60 and utc["nano"][k] < 1e9:
            t.append(float(utc["t"][k]))
            whole.append(moment + leaps)
            rest.append(utc["nano"][k] * 1e-9)
    line = clock_line(np.array(t), np.array(whole), np.array(rest))
    if line is not None:
        notes.append(line.note("the unit's clock", "UTC_TIME"))
    return line


def _usable(part: str, name: str, rows: Columns, notes: list[str]) -> Columns:
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


def _imu(name: str, t: FloatArray, rows: Columns, notes: list[str]) -> Table:
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


def _gnss(log: Frames, name: str, t: FloatArray, rows: Columns, notes: list[str], *, dated: bool) -> Table:
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
    found = match >= 0
    if not found.any():
        return Table(values)
    if not found.all():
        notes.append(
            f"{name}: {int((~found).sum())} positions have no velocity of the same time of week; it was set to zero "
            f"with a 1-sigma of {NO_VELOCITY:g} m/s."
        )
    for axis in "ned":
        values[f"v{axis}"] = np.where(found, moved[f"v{axis}"][match], 0.0)
        values[f"sv{axis}"] = np.where(found, moved[f"sv{axis}"][match], NO_VELOCITY)
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
    norm = np.linalg.norm(q, axis=1)
    if (bad := np.flatnonzero(~(np.abs(norm - 1.0) < 1e-2))).size:
        raise FileFormatError(
            f"EKF_QUAT {bad[0] + 1}: expected a unit quaternion, got norm {norm[bad[0]]:.4g}", log.path
        )
    angles = rotation.rpy_from_quat(q / norm[:, None])
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
