"""ArduPilot's DataFlash logs (``.bin``): IMU, GNSS, barometer, and the autopilot's own estimate as reference.

Fields and units are those of ArduPilot's list of log messages (ardupilot.org, "Onboard Message Log Messages") and of
its LogStructure headers. The sensors' axes are forward-right-down already.
"""

from __future__ import annotations

from pathlib import Path

from schuler.exceptions import FileFormatError, InputError
from schuler.recording.formats import parts
from schuler.recording.formats.ardupilot_tables import (
    NUMBERED,
    columns_of,
    gnss_table,
    height_table,
    imu_table,
    instances,
    reference_table,
)
from schuler.recording.formats.clock_map import on_gps_time
from schuler.recording.formats.dataflash import START, DataFlash, load
from schuler.recording.formats.parts import Table
from schuler.recording.formats.streams import Stream, choose, stream_of
from schuler.recording.io.hint_texts import parse_streams
from schuler.recording.io.hints import ReadHints
from schuler.recording.recording import Recording
from schuler.timebase import TimeBase

_HINTS = parts.GNSS_HINTS | {"axes", "streams", "time", "sigma_height"}
_US = 1e-6


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
        On GPS time if fixes relate the clocks, see :mod:`schuler.recording.formats.clock_map`.

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
    found = []
    imus = instances(log, "IMU")
    raw = sorted(set(instances(log, "ACC")) & set(instances(log, "GYR")))
    found += [_stream(log, "IMU", k, f"IMU:{k}", "imu") for k in imus]
    found += [_stream(log, "GYR", k, f"ACC+GYR:{k}", "imu") for k in raw]
    found += [_stream(log, "GPS", k, f"GPS:{k}", "gnss") for k in instances(log, "GPS")]
    found += [_stream(log, "BARO", k, f"BARO:{k}", "height") for k in instances(log, "BARO")]
    if log.fields("ATT") and log.fields("POS"):
        found.append(_stream(log, "ATT", 0, "ATT+POS", "reference"))
    for name in sorted(log.places):
        if "TimeUS" in log.fields(name):
            found.append(stream_of(name, "message", log.columns(name, ("TimeUS",))["TimeUS"] * _US))
        else:
            found.append(Stream(name, "message", log.count(name)))
    return found


def _stream(log: DataFlash, kind: str, instance: int, name: str, part: str) -> Stream:
    numbered = [kind, *NUMBERED.get(kind, ())]
    fields = log.fields(kind if "I" in log.fields(kind) else numbered[instance])
    stamp = "TimeMS" if "TimeMS" in fields and "TimeUS" not in fields else "TimeUS"
    t = columns_of(log, kind, instance, (stamp,))["TimeUS"] * _US
    return stream_of(name, "sensor" if part != "reference" else "estimate", t, part)
