"""ArduPilot's DataFlash logs (``.bin``): IMU, GNSS, barometer, and the autopilot's own estimate as reference.

Fields and units are those of ArduPilot's list of log messages (ardupilot.org, "Onboard Message Log Messages") and of
its LogStructure headers. The sensors' axes are forward-right-down already.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from schuler import rotation, units
from schuler.arrays import FloatArray
from schuler.exceptions import FileFormatError, InputError
from schuler.recording.formats.dataflash import START, DataFlash, load
from schuler.recording.io import parts
from schuler.recording.io.clock_map import on_gps_time
from schuler.recording.io.hint_texts import parse_streams
from schuler.recording.io.hints import ReadHints
from schuler.recording.io.parts import Table
from schuler.recording.io.streams import Stream, choose, stream_of
from schuler.recording.recording import Recording
from schuler.timebase import WEEK_S, TimeBase

_HINTS = parts.GNSS_HINTS | {"axes", "streams", "time", "sigma_height"}
_US, _MS = 1e-6, 1e-3
#: RTKLIB's quality of AP_GPS's status: 3D, differential, float, fixed.
QUALITY = {3: 5, 4: 4, 5: 2, 6: 1}
#: Before instances had a field of their own, their number was part of the name.
NUMBERED = {"IMU": ("IMU2", "IMU3"), "GPS": ("GPS2",), "GPA": ("GPA2",), "BARO": ("BAR2", "BAR3")}
_NO_VERTICAL_RATE = 10.0  # 1-sigma of a vertical velocity that the receiver does not give [m/s]
_UNKNOWN_HEIGHT = -2e7  # AEl is INT32_MIN centimetres where it is not known [m]
_GYRO, _ACCEL = ("GyrX", "GyrY", "GyrZ"), ("AccX", "AccY", "AccZ")


def sniff(head: bytes, path: Path) -> bool:
    """Whether a file starts with the description of descriptions, as logs of ArduPilot do."""
    return head.startswith(START + b"\x80\x80\x59FMT\x00")


def contents(path: Path) -> list[Stream]:
    """Sensors of the log that can be read, and its other messages."""
    return _streams(load(path))


def read(path: Path, hints: ReadHints) -> Recording:
    """Recording of a DataFlash log.

    Parameters
    ----------
    path : Path
    hints : ReadHints
        ``streams`` chooses where there are several: ``imu`` (``IMU:0``, or the unfiltered ``ACC+GYR:0``), ``gnss``
        (``GPS:0``), ``height`` (``BARO:0``, which needs ``sigma_height``), ``reference`` (``ATT+POS``).
        ``time="local"`` keeps the log's clock. ``height="msl"`` with ``geoid_separation`` where the log has none.

    Returns
    -------
    Recording
        On GPS time if fixes relate the clocks, see :mod:`schuler.recording.io.clock_map`.

    Raises
    ------
    FileFormatError, InputError
        If the log is damaged, holds no IMU and no fix, or several sensors could be meant.
    """
    parts.check_hints(path, hints, _HINTS, "a DataFlash log")
    if hints.time not in (None, "gps", "local"):
        raise InputError(f"time: a DataFlash log has time='gps' (by its fixes) or 'local', got {hints.time!r}")
    log = load(path)
    notes = []
    if log.lost:
        notes.append(f"{log.lost} bytes that belong to no message were passed over.")
    if log.cut:
        notes.append("The last message is incomplete, as where the power is cut; it was left out.")
    streams, chosen = _streams(log), parse_streams(hints.streams)
    taken = {part: choose(streams, part, chosen) for part in ("imu", "gnss", "reference")}
    taken["height"] = choose(streams, "height", chosen, alone=hints.sigma_height is not None)
    if taken["height"] is None and "height" not in chosen and any(s.part == "height" for s in streams):
        notes.append("The barometer was not read: it needs sigma_height=... [m].")
    tables: dict[str, Table] = {}
    if (stream := taken["imu"]) is not None:
        tables["imu"] = imu_table(log, stream.name, notes)
    if (stream := taken["gnss"]) is not None:
        tables["gnss"] = gnss_table(log, stream.name, hints, notes)
    if (stream := taken["height"]) is not None:
        tables["height"] = height_table(log, stream.name, notes)
    if taken["reference"] is not None:
        reference = reference_table(log, tables.get("gnss"), hints, notes, named="reference" in chosen)
        if reference is not None:
            tables["reference"] = reference
    if not set(tables) & {"imu", "gnss"}:
        raise FileFormatError("the log holds neither inertial measurements (IMU, ACC and GYR) nor fixes (GPS)", path)
    base = on_gps_time(tables, notes) if hints.time != "local" else TimeBase("local")
    if hints.time == "gps" and base.scale != "gps":
        raise FileFormatError("time='gps' was asked for, but no fixes relate the log's clock to GPS time", path)
    for table in tables.values():
        table.values.pop("gps", None)
    return parts.assemble(path, tables, hints, base, notes)


def _streams(log: DataFlash) -> list[Stream]:
    streams = []
    imus = instances(log, "IMU")
    raw = sorted(set(instances(log, "ACC")) & set(instances(log, "GYR")))
    streams += [_stream(log, "IMU", k, f"IMU:{k}", "imu") for k in imus]
    streams += [_stream(log, "GYR", k, f"ACC+GYR:{k}", "imu") for k in raw]
    streams += [_stream(log, "GPS", k, f"GPS:{k}", "gnss") for k in instances(log, "GPS")]
    streams += [_stream(log, "BARO", k, f"BARO:{k}", "height") for k in instances(log, "BARO")]
    if log.fields("ATT") and log.fields("POS"):
        streams.append(_stream(log, "ATT", 0, "ATT+POS", "reference"))
    for name in sorted(log.places):
        if "TimeUS" in log.fields(name):
            streams.append(stream_of(name, "message", log.columns(name, ("TimeUS",))["TimeUS"] * _US))
        else:
            streams.append(Stream(name, "message", log.count(name)))
    return streams


def _stream(log: DataFlash, kind: str, instance: int, name: str, part: str) -> Stream:
    numbered = [kind, *NUMBERED.get(kind, ())]
    fields = log.fields(kind if "I" in log.fields(kind) else numbered[instance])
    stamp = "TimeMS" if "TimeMS" in fields and "TimeUS" not in fields else "TimeUS"
    t = columns_of(log, kind, instance, (stamp,))["TimeUS"] * _US
    return stream_of(name, "sensor" if part != "reference" else "estimate", t, part)


def imu_table(log: DataFlash, name: str, notes: list[str]) -> Table:
    """IMU of a stream, ``IMU:0`` or ``ACC+GYR:0``.

    Parameters
    ----------
    log : DataFlash
    name : str
        Name of the stream.
    notes : list of str
        Takes what was done.

    Returns
    -------
    Table
        With ``t`` on the log's clock [s], axes forward-right-down.

    Raises
    ------
    FileFormatError
        If fields are missing, stamps go back, or gyro and accelerometer do not overlap.
    """
    kind, _, number = name.partition(":")
    if kind == "IMU":
        imu = columns_of(log, "IMU", int(number))
        _need(imu, (*_GYRO, *_ACCEL), "IMU", log)
        t = imu["TimeUS"] * _US
        keep = parts.later(t, name, log.path, notes)
        notes.append(f"imu: {name}, as filtered by the autopilot; stamps are those of logging.")
        gyro, accel = (np.stack([imu[f][keep] for f in fields], axis=1) for fields in (_GYRO, _ACCEL))
        values = {"t": t[keep]}
        if "T" in imu:
            values["temp"] = imu["T"][keep]
    else:
        g, a = columns_of(log, "GYR", int(number)), columns_of(log, "ACC", int(number))
        _need(g, ("SampleUS", *_GYRO), "GYR", log)
        _need(a, ("SampleUS", *_ACCEL), "ACC", log)
        t, t_a = g["SampleUS"] * _US, a["SampleUS"] * _US
        keep, keep_a = parts.later(t, "GYR", log.path, notes), parts.later(t_a, "ACC", log.path, notes)
        keep &= (t >= t_a[keep_a][0]) & (t <= t_a[keep_a][-1])
        if keep.sum() < 2:
            raise FileFormatError(f"{name}: gyro and accelerometer do not overlap in time", log.path)
        gyro = np.stack([g[f][keep] for f in _GYRO], axis=1)
        accel = np.stack([np.interp(t[keep], t_a[keep_a], a[f][keep_a]) for f in _ACCEL], axis=1)
        notes.append(f"imu: {name}; specific forces were interpolated to the gyro's stamps (linear).")
        values = {"t": t[keep]}
    values |= {f"g{axis}": gyro[:, k] for k, axis in enumerate("xyz")}
    values |= {f"a{axis}": accel[:, k] for k, axis in enumerate("xyz")}
    return Table(values)


def gnss_table(log: DataFlash, name: str, hints: ReadHints, notes: list[str]) -> Table:
    """Fixes of a receiver, ``GPS:0``, with their accuracies.

    Parameters
    ----------
    log : DataFlash
    name : str
        Name of the stream.
    hints : ReadHints
        ``height``.
    notes : list of str
        Takes what was done.

    Returns
    -------
    Table
        With ``t``, when each fix came in, on the log's clock [s], and ``gps``, its GPS time since 1980 [s].

    Raises
    ------
    FileFormatError
        If there is no fix, fields are missing, or nothing says the geoid's separation.

    Notes
    -----
    Speed and course make the horizontal velocity. A fix came in at GPA's SMS where it is logged, else GPS was logged.
    """
    instance = int(name.partition(":")[2])
    gps = columns_of(log, "GPS", instance)
    _need(gps, ("Status", "GMS", "GWk", "Lat", "Lng", "Alt", "Spd", "GCrs", "VZ"), "GPS", log)
    fix = gps["Status"] >= 3
    if not fix.all():
        notes.append(f"gnss: {int((~fix).sum())} epochs without a three-dimensional fix were left out.")
    if not fix.any():
        raise FileFormatError(
            f"{name}: no epoch has a three-dimensional fix; streams='gnss=none' leaves it out", log.path
        )
    gps_s = gps["GWk"] * WEEK_S + gps["GMS"] * _MS
    keep = np.flatnonzero(fix)
    keep = keep[parts.later(gps_s[keep], name, log.path, notes)]
    keep = keep[parts.later(gps["TimeUS"][keep] * _US, name, log.path, notes)]
    gps = {field: values[keep] for field, values in gps.items()}
    accuracy = _accuracy(log, instance, gps["TimeUS"])
    arrival = gps["TimeUS"] * _US
    if "SMS" in accuracy:
        sampled = accuracy["SMS"] * _MS
        arrival = np.where((sampled > 0.0) & (np.abs(sampled - arrival) < 1.0), sampled, arrival)
    course = gps["GCrs"] * units.DEG
    with np.errstate(invalid="ignore"):  # what is no number then is refused with its row
        north, east = gps["Spd"] * np.cos(course), gps["Spd"] * np.sin(course)
    values = {
        "t": arrival,
        "gps": gps_s[keep],
        "lat": gps["Lat"] * units.DEG,
        "lon": gps["Lng"] * units.DEG,
        "h": gps["Alt"] + _separation(log, gps["Alt"], accuracy, hints, notes),
        "vn": north,
        "ve": east,
        "vd": gps["VZ"],
        "q": np.array([QUALITY.get(int(s), 5) for s in gps["Status"]], dtype=np.float64),
    }
    if "NSats" in gps:
        values["ns"] = gps["NSats"]
    dilutions = {"hdop": gps.get("HDop"), "vdop": accuracy.get("VDop")}
    values |= {column: dop for column, dop in dilutions.items() if dop is not None}
    if {"HAcc", "VAcc", "SAcc"} <= set(accuracy):
        values |= {"sn": accuracy["HAcc"], "se": accuracy["HAcc"], "sd": accuracy["VAcc"]}
        values |= {f"sv{axis}": accuracy["SAcc"].copy() for axis in "ned"}
        if "VV" in accuracy and (without := accuracy["VV"] == 0.0).any():
            values["svd"][without] = _NO_VERTICAL_RATE
            notes.append(f"gnss: {int(without.sum())} epochs have no vertical velocity; its 1-sigma is 10 m/s.")
        notes.append(f"gnss: {name}; HAcc is taken as 1-sigma of north and of east, SAcc as that of each velocity.")
    else:
        notes.append(f"gnss: {name}, which comes without accuracies (GPA).")
    return Table(values)


def _accuracy(log: DataFlash, instance: int, time_us: FloatArray) -> dict[str, FloatArray]:
    """Columns of GPA at the epochs of GPS, of which they are written at the same time; zero where there is none."""
    if instance not in instances(log, "GPA"):
        return {}
    gpa = columns_of(log, "GPA", instance)
    order = np.argsort(gpa["TimeUS"], kind="stable")
    stamps = gpa["TimeUS"][order]
    near = order[np.clip(np.searchsorted(stamps, time_us - 500.0), 0, len(stamps) - 1)]
    same = np.abs(gpa["TimeUS"][near] - time_us) <= 500.0
    return {field: np.where(same, values[near], 0.0) for field, values in gpa.items()}


def _separation(
    log: DataFlash, alt: FloatArray, accuracy: dict[str, FloatArray], hints: ReadHints, notes: list[str]
) -> FloatArray | float:
    """Geoid separation of the log, unless a hint gives it. Shape (n,). [m]"""
    if hints.height is not None:
        return 0.0  # the hint does it, or says that there is nothing to do
    if "AEl" in accuracy and (valid := (accuracy["AEl"] > _UNKNOWN_HEIGHT) & (accuracy["AEl"] != 0.0)).any():
        separation = np.interp(np.arange(len(alt)), np.flatnonzero(valid), (accuracy["AEl"] - alt)[valid])
        source = "AEl"
    elif "Und" in accuracy and accuracy["Und"].any():
        separation, source = -accuracy["Und"], "Und"  # of the ellipsoid above the geoid, says AP_GPS.h
    else:
        raise FileFormatError(
            "heights are above mean sea level and the log does not say the geoid's separation: give height='msl' and "
            "geoid_separation=... [m]",
            log.path,
        )
    notes.append(
        f"Heights above mean sea level were made ellipsoidal with the receiver's own geoid separation (GPA.{source}, "
        f"median {np.median(separation):.2f} m)."
    )
    return np.asarray(separation, dtype=np.float64)


def height_table(log: DataFlash, name: str, notes: list[str]) -> Table:
    """Height of a barometer, ``BARO:0``, on the log's clock."""
    baro = columns_of(log, "BARO", int(name.partition(":")[2]))
    _need(baro, ("Alt",), "BARO", log)
    t = baro["TimeUS"] * _US
    keep = parts.later(t, name, log.path, notes)
    notes.append(f"height: {name}, relative to where the autopilot was switched on.")
    return Table({"t": t[keep], "h": baro["Alt"][keep]})


def reference_table(
    log: DataFlash, gnss: Table | None, hints: ReadHints, notes: list[str], *, named: bool
) -> Table | None:
    """The autopilot's own estimate: POS with the attitude of ATT, and the velocity of its filter if it is there."""
    pos, att = columns_of(log, "POS", 0), columns_of(log, "ATT", 0)
    _need(pos, ("Lat", "Lng", "Alt"), "POS", log)
    _need(att, ("Roll", "Pitch", "Yaw"), "ATT", log)
    separation = 0.0
    if hints.height is None:
        if gnss is None:
            if named:
                raise InputError(
                    f"{log.path}: the reference's heights are above sea level: say height and geoid_separation"
                )
            notes.append(
                "The autopilot's estimate was not read: its heights are above sea level, and nothing says more."
            )
            return None
        gps = columns_of(log, "GPS", instances(log, "GPS")[0])
        separation = float(np.median(gnss.values["h"]) - np.median(gps["Alt"][gps["Status"] >= 3]))
    t, t_a = pos["TimeUS"] * _US, att["TimeUS"] * _US
    keep, keep_a = parts.later(t, "POS", log.path, notes), parts.later(t_a, "ATT", log.path, notes)
    t_a = t_a[keep_a]
    keep &= (t >= t_a[0]) & (t <= t_a[-1])
    sources = [(kind, columns_of(log, kind, 0)) for kind in ("XKF1", "NKF1") if log.fields(kind)]
    velocity = None
    for kind, ekf in sources[:1]:
        if "C" in ekf:
            ekf = {field: values[ekf["C"] == ekf["C"].min()] for field, values in ekf.items()}
        _need(ekf, ("VN", "VE", "VD"), kind, log)
        t_v = ekf["TimeUS"] * _US
        keep_v = parts.later(t_v, kind, log.path, notes)
        keep &= (t >= t_v[keep_v][0]) & (t <= t_v[keep_v][-1])
        velocity = t_v[keep_v], {f: ekf[f][keep_v] for f in ("VN", "VE", "VD")}
    if keep.sum() < 2:
        notes.append("The autopilot's estimate was not read: position and attitude do not overlap in time.")
        return None
    rpy = np.stack([att[f][keep_a] for f in ("Roll", "Pitch", "Yaw")], axis=1) * units.DEG
    turned = rotation.interpolate_quat(t[keep], t_a, rotation.quat_from_rpy(rpy))
    angles = rotation.rpy_from_quat(turned)
    values = {
        "t": t[keep],
        "lat": pos["Lat"][keep] * units.DEG,
        "lon": pos["Lng"][keep] * units.DEG,
        "h": pos["Alt"][keep] + separation,
        **{name: angles[:, k] for k, name in enumerate(("roll", "pitch", "yaw"))},
    }
    if velocity is not None:
        stamps, ned = velocity
        values |= {name: np.interp(t[keep], stamps, ned[f]) for name, f in (("vn", "VN"), ("ve", "VE"), ("vd", "VD"))}
    notes.append(
        "reference: the autopilot's own estimate (POS with ATT interpolated to it), made of the same sensors: to "
        "compare with, not a truth."
    )
    return Table(values)


def instances(log: DataFlash, kind: str) -> list[int]:
    """Numbers of the sensors that messages of a kind come from."""
    fields = log.fields(kind)
    if "I" in fields:
        return [int(k) for k in np.unique(log.columns(kind, ("I",))["I"])]
    present = [kind, *NUMBERED.get(kind, ())]
    return [k for k, name in enumerate(present) if log.fields(name)]


def columns_of(log: DataFlash, kind: str, instance: int, names: tuple[str, ...] = ()) -> dict[str, FloatArray]:
    """Columns of one sensor's messages, all or those wanted."""
    if "I" in log.fields(kind):
        columns = log.columns(kind, (*names, "I") if names else ())
        keep = columns["I"] == instance
        columns = {name: values[keep] for name, values in columns.items()}
    else:
        name = [kind, *NUMBERED.get(kind, ())][instance]
        columns = log.columns(name, names)
    if "TimeUS" not in columns:
        if "TimeMS" not in columns:
            raise FileFormatError(f"messages {kind} have no TimeUS", log.path)
        columns["TimeUS"] = columns["TimeMS"] * (_MS / _US)
    return columns


def _need(columns: dict[str, FloatArray], names: tuple[str, ...], kind: str, log: DataFlash) -> None:
    if missing := [name for name in names if name not in columns]:
        raise FileFormatError(f"messages {kind} have no {', '.join(missing)}; they have {', '.join(columns)}", log.path)
