"""PX4's logs (``.ulg``): IMU, GNSS, barometer, and the autopilot's own estimate as reference.

The container is read by pyulog; sizes its formats claim are checked before. Fields and units are those of PX4's
message definitions (docs.px4.io, "uORB Message Reference"). Axes are forward-right-down and north-east-down already,
quaternions have the scalar first and turn body to navigation axes.
"""

from __future__ import annotations

import contextlib
import io
from pathlib import Path
from typing import Any

from schuler.exceptions import FileFormatError, InputError
from schuler.recording.formats.px4_tables import Log, field_of, gnss_table, imu_table, reference_table, stamps
from schuler.recording.formats.registry import check_installed
from schuler.recording.io import child, parts
from schuler.recording.io.clock_map import on_gps_time
from schuler.recording.io.hint_texts import parse_streams
from schuler.recording.io.hints import ReadHints
from schuler.recording.io.parts import Table
from schuler.recording.io.streams import Stream, choose, stream_of
from schuler.recording.recording import Recording
from schuler.timebase import TimeBase

MAGIC = b"ULog\x01\x12\x35"
_HINTS = parts.GNSS_HINTS | {"axes", "streams", "time", "sigma_height"}
_LARGEST = 65535  # a message has its length in two bytes
_MS = 1e-3
#: Topics that are read, the part each can be, and those that PX4 itself chose, which are taken unasked.
TOPICS = {
    "sensor_combined": "imu", "vehicle_imu": "imu", "sensor_gyro": "imu", "vehicle_gps_position": "gnss",
    "sensor_gps": "gnss", "vehicle_air_data": "height", "vehicle_global_position": "reference",
}  # fmt: skip
_CHOSEN = {"imu": "sensor_combined:0", "gnss": "vehicle_gps_position:0"}
HELPERS = ("sensor_accel", "vehicle_attitude", "vehicle_local_position")


def sniff(head: bytes, path: Path) -> bool:
    """Whether a file starts as ULog does."""
    return head.startswith(MAGIC)


def contents(path: Path) -> list[Stream]:
    """Topics of the log by instance."""
    return _streams(load(path, None)[0])


def read(path: Path, hints: ReadHints) -> Recording:
    """Recording of a PX4 log.

    Parameters
    ----------
    path : Path
    hints : ReadHints
        ``streams`` chooses the topic and instance for ``imu`` (default ``sensor_combined:0``, the one PX4 flew with;
        else ``vehicle_imu:0`` or ``sensor_gyro:0``, which takes the accelerometer of the same number), ``gnss``
        (default ``vehicle_gps_position:0``, else ``sensor_gps:0``), ``height`` (``vehicle_air_data:0``, which needs
        ``sigma_height``), ``reference`` (``vehicle_global_position:0``). ``time="local"`` keeps the log's clock.

    Returns
    -------
    Recording
        On GPS time if fixes relate the clocks, see :mod:`schuler.recording.io.clock_map`.

    Raises
    ------
    FileFormatError, InputError
        If the log is damaged, or holds no IMU and no fix.
    MissingExtraError
        Without pyulog.
    """
    parts.check_hints(path, hints, _HINTS, "a PX4 log")
    if hints.time not in (None, "gps", "local"):
        raise InputError(f"time: a PX4 log has time='gps' (by its fixes) or 'local', got {hints.time!r}")
    log, notes = load(path, [*TOPICS, *HELPERS])
    streams, chosen = _streams(log), parse_streams(hints.streams)
    names = {s.name for s in streams}
    names_of = {**{part: name for part, name in _CHOSEN.items() if name in names}, **chosen}
    taken = {part: choose(streams, part, names_of) for part in ("imu", "gnss", "reference")}
    taken["height"] = choose(streams, "height", names_of, alone=hints.sigma_height is not None)
    if taken["height"] is None and "height" not in chosen and any(s.part == "height" for s in streams):
        notes.append("The barometer was not read: it needs sigma_height=... [m].")
    tables: dict[str, Table] = {}
    if (stream := taken["imu"]) is not None:
        tables["imu"] = imu_table(path, log, stream.name, notes)
    if (stream := taken["gnss"]) is not None:
        tables["gnss"] = gnss_table(path, log, stream.name, hints, notes)
    if (stream := taken["height"]) is not None:
        baro = log[stream.name]
        t = stamps(baro)
        keep = parts.later(t, stream.name, path, notes)
        tables["height"] = Table({"t": t[keep], "h": field_of(path, baro, "baro_alt_meter", stream.name)[keep]})
    if (stream := taken["reference"]) is not None:
        reference = reference_table(path, log, stream.name, hints, notes)
        if reference is not None:
            tables["reference"] = reference
    if not set(tables) & {"imu", "gnss"}:
        raise FileFormatError(
            f"the log holds neither inertial measurements nor fixes; topics: {', '.join(sorted(names))}", path
        )
    base = on_gps_time(tables, notes) if hints.time != "local" else TimeBase("local")
    if hints.time == "gps" and base.scale != "gps":
        raise FileFormatError("time='gps' was asked for, but no fixes relate the log's clock to GPS time", path)
    for table in tables.values():
        table.values.pop("gps", None)
    return parts.assemble(path, tables, hints, base, notes)


def load(path: Path, topics: list[str] | None) -> tuple[Log, list[str]]:
    """Columns of the topics of a log by ``name:instance``, and notes.

    Raises
    ------
    FileFormatError
        If it is no log, or what it says of its messages cannot be.
    MissingExtraError
        Without pyulog.
    """
    check_installed("pyulog", "px4", "reading PX4 logs")
    return child.call(extract, path, topics)


def extract(path: Path, topics: list[str] | None) -> tuple[Log, list[str]]:
    """What :func:`load` returns: everything that pyulog has to do with a log."""
    from pyulog import ULog

    notes: list[str] = []
    messages = io.StringIO()
    try:
        with contextlib.redirect_stdout(messages):
            with path.open("rb") as stream:  # pyulog leaves a file of its own open when it fails
                formats = ULog(stream, parse_header_only=True).message_formats
            for name in formats:
                _size(name, formats, ())
            with path.open("rb") as stream:
                log = ULog(stream, message_name_filter_list=topics)
    except FileFormatError:
        raise
    # pyulog raises whatever comes of damaged bytes
    except Exception as error:
        text = str(error).splitlines()[0] if str(error) else type(error).__name__
        raise FileFormatError(f"cannot be read as a PX4 log ({text[:200]}); is it complete?", path) from error
    if log.file_corruption:
        notes.append("The log is damaged in places; pyulog passed over them.")
    lost = sum(dropout.duration for dropout in log.dropouts)
    if lost:
        notes.append(f"PX4 says that it could not write for {lost * _MS:.3f} s in all ({len(log.dropouts)} dropouts).")
    data = {
        f"{d.name}:{d.multi_id}": d.data for d in log.data_list if "timestamp" in d.data and len(d.data["timestamp"])
    }
    if not data:
        raise FileFormatError("the log holds no messages of the topics that are read", path)
    return data, notes


def _size(name: str, formats: dict[str, Any], above: tuple[str, ...]) -> int:
    """Bytes of a message; an error if it holds itself or more than a message can. [byte]"""
    from pyulog import ULog

    total = 0
    for kind, number, _ in formats[name].fields:
        if kind in above or kind == name:
            raise ValueError(f"the message {name} holds itself")
        basic = kind in ULog._UNPACK_TYPES
        total += max(number, 1) * (ULog.get_field_size(kind) if basic else _size(kind, formats, (*above, name)))
        if total > _LARGEST:
            raise ValueError(f"the message {name} is longer than messages can be")
    return max(total, 1)  # messages without fields inside one another multiply without growing


def _streams(log: Log) -> list[Stream]:
    streams = []
    for name, data in sorted(log.items()):
        topic, _, instance = name.partition(":")
        part = TOPICS.get(topic, "")
        if topic == "sensor_gyro" and f"sensor_accel:{instance}" not in log:
            part = ""
        streams.append(stream_of(name, "topic", stamps(data), part))
    return streams
