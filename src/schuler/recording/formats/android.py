"""Logs of GnssLogger (Google): lines that begin with the kind of their record, described by comments at the top.

``UncalAccel`` or ``Accel`` [m/s^2] and ``UncalGyro`` or ``Gyro`` [rad/s] of the device (x right, y to its top, z out
of its screen), ``Fix`` with latitude, longitude [deg], height above the ellipsoid and accuracies of 68 %. All have the
time since boot in nanoseconds. ``Raw`` are measurements of satellites
(:mod:`schuler.recording.formats.android_raw`); they, or else the fixes' Unix time, tie the time since boot to GPS time.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from schuler import units
from schuler.arrays import FloatArray, IntArray
from schuler.exceptions import FileFormatError, InputError, SchulerError
from schuler.recording.formats import android_raw
from schuler.recording.io import clock, lines, parts
from schuler.recording.io.assemble import metadata_of
from schuler.recording.io.hint_texts import parse_streams
from schuler.recording.io.hints import ReadHints
from schuler.recording.io.over_ground import CIRCLE_68, velocities
from schuler.recording.io.parts import Table
from schuler.recording.io.streams import Stream, choose, joined, stream_of
from schuler.recording.recording import Recording
from schuler.timebase import UNIX_TO_GPS_S, TimeBase, gps_from_unix

_HINTS = parts.GNSS_HINTS | {"axes", "streams", "time"}
_AXES = "RFU"
_FIELDS = {
    "UncalAccel": ("UncalAccelXMps2", "UncalAccelYMps2", "UncalAccelZMps2"),
    "Accel": ("AccelXMps2", "AccelYMps2", "AccelZMps2"),
    "UncalGyro": ("UncalGyroXRadPerSec", "UncalGyroYRadPerSec", "UncalGyroZRadPerSec"),
    "Gyro": ("GyroXRadPerSec", "GyroYRadPerSec", "GyroZRadPerSec"),
    "Fix": (
        "LatitudeDegrees", "LongitudeDegrees", "AltitudeMeters", "AccuracyMeters", "VerticalAccuracyMeters", "SpeedMps",
        "BearingDegrees", "SpeedAccuracyMps", "BearingAccuracyDegrees",
    ),
}  # fmt: skip
_FIRST_VERSIONS = {
    "Latitude": "LatitudeDegrees", "Longitude": "LongitudeDegrees", "Altitude": "AltitudeMeters", "Speed": "SpeedMps",
    "Accuracy": "AccuracyMeters",
}  # fmt: skip
_BOOT, _UNIX = ("elapsedRealtimeNanos", "ElapsedRealtimeNanos"), ("UnixTimeMillis", "(UTC)TimeInMs")
_STAMPS = (*_BOOT, "ChipsetElapsedRealtimeNanos")


def sniff(head: bytes, path: Path) -> bool:
    """Whether the comments at the top describe records of GnssLogger."""
    named = any(
        name in head[:20_000] for name in (b"# Fix,Provider,", b"# Raw,utcTimeMillis,", b"# Raw,ElapsedRealtime")
    )
    return named and head.lstrip(b"\xef\xbb\xbf").startswith(b"#")


def holds(path: Path) -> tuple[str, ...]:
    """Series of the kinds that are there."""
    try:
        return tuple(dict.fromkeys(stream.part for stream in contents(path) if stream.part and stream.count))
    except SchulerError:  # said when it is read
        return ()


def contents(path: Path) -> list[Stream]:
    """Kinds of records, fixes by provider, for ``schuler info``."""
    rows, names = _rows(path)
    groups: dict[tuple[str, str], list[list[str]]] = {}
    for kind, fields in rows:
        groups.setdefault((fields[1] if kind == "Fix" and len(fields) > 1 else kind, kind), []).append(fields)
    streams = []
    for (name, kind), records in sorted(groups.items()):
        part = {"Fix": "gnss", "UncalGyro": "imu", "Gyro": "imu"}.get(kind, "")
        if kind == "Raw" and set(android_raw.REQUIRED) <= set(names.get("Raw", ())):
            part = "observations"
        t = np.full(len(records), np.nan)
        place = next((names[kind].index(n) for n in _STAMPS if n in names.get(kind, [])), None)
        if place is not None:
            texts = [fields[place] if place < len(fields) else "" for fields in records]
            t = np.array(
                [
                    int(text) / clock.NS if text.isascii() and text.isdigit() and len(text) < 20 else np.nan
                    for text in texts
                ]
            )
        streams.append(stream_of(name, kind, t, part))
    return streams


def read(path: Path, hints: ReadHints) -> Recording:
    """IMU, fixes and raw measurements of satellites of a log.

    Parameters
    ----------
    path : Path
    hints : ReadHints
        ``streams="gnss=FLP,imu=Gyro"``: fixes of another provider than GPS, rates with Android's bias taken out; their
        accelerometer goes with them. ``axes`` of the device in the vehicle, if it does not lie on its back with its top
        forward. ``time="local"`` keeps the time since boot, and leaves raw measurements out. An IMU that nothing ties
        to raw measurements is left out, and noted, unless it is asked for (``series="imu"``).

    Raises
    ------
    FileFormatError
        With the line, for records that are no numbers.
    """
    parts.check_hints(path, hints, _HINTS, "a log of GnssLogger")
    rows, names = _rows(path)
    chosen = parse_streams(hints.streams)
    notes: list[str] = []
    boot: dict[str, IntArray] = {}
    values: dict[str, FloatArray] = {}
    if any(kind in ("UncalGyro", "Gyro") for kind, _ in rows) and chosen.get("imu", "") is not None:
        gyros = [k for k in ("UncalGyro", "Gyro") if any(kind == k for kind, _ in rows)]
        streams = [Stream(k, k, 1, part="imu") for k in gyros]
        picked = choose(streams if "imu" in chosen else streams[:1], "imu", chosen)
        assert picked is not None
        accel = picked.name.replace("Gyro", "Accel")
        if not any(kind == accel for kind, _ in rows):
            accel = "Accel" if accel != "Accel" else "UncalAccel"
        if any(kind == accel for kind, _ in rows):
            for kind in (accel, picked.name):
                _, boot[kind], values[kind] = _table(path, [r for k, r in rows if k == kind], names, kind, notes)
            notes.append(f"IMU: {accel} and {picked.name}.")
        else:
            notes.append(f"There are rates ({picked.name}) but no accelerations: no IMU.")
    providers = sorted({fields[1] for kind, fields in rows if kind == "Fix" and len(fields) > 1})
    unix: IntArray | None = None
    if providers and chosen.get("gnss", "") is not None:
        streams = [Stream(name, "Fix", 1, part="gnss") for name in providers]
        if "gnss" not in chosen and "GPS" in providers:
            streams = [s for s in streams if s.name == "GPS"]
        picked = choose(streams, "gnss", chosen)
        assert picked is not None
        some = [fields for kind, fields in rows if kind == "Fix" and fields[1:2] == [picked.name]]
        kept, boot["Fix"], values["Fix"] = _table(path, some, names, "Fix", notes)
        unix = _unix(path, [some[k] for k in kept], names)
        notes.append(f"Fixes of the provider {picked.name} out of {', '.join(providers)}.")
    raw = _raw(path, rows, names, hints, notes)
    if raw is not None and not boot:
        metadata = metadata_of(path, hints, TimeBase("gps", raw.observations.epoch_gps_s), notes)
        return Recording(observations=raw.observations, metadata=metadata)
    if not boot:
        raise FileFormatError("there are neither fixes nor an IMU nor raw measurements of satellites", path)
    if raw is not None and len(raw.boot_ns):
        seconds, base = _tied(boot, _utc_ns(raw.gps_ns) - raw.boot_ns, "raw measurements", hints, notes)
    else:
        seconds, base = _times(boot, unix, hints, notes)
    tables = {}
    imu = [kind for kind in boot if kind != "Fix"]
    if imu:
        keep = [parts.later(seconds[kind], kind, path, notes) for kind in imu]
        (t_a, f), (t_g, w) = ((seconds[kind][k], values[kind][k]) for kind, k in zip(imu, keep, strict=True))
        tables["imu"] = Table(joined(t_a, f, t_g, w, path, notes), axes=_AXES)
        if hints.axes is None:
            notes.append(
                "The device is taken to lie on its back, its top forward (axes RFU); hint axes says otherwise."
            )
    if "Fix" in boot:
        tables["gnss"] = _fixes(seconds["Fix"], values["Fix"], path, hints, notes)
    recording = parts.assemble(path, tables, replace(hints, time=None), base, notes)
    if raw is None:
        return recording
    if base.scale != "gps":
        untied = "nothing ties the time since boot to the raw measurements (no ChipsetElapsedRealtimeNanos, no fixes)"
        if hints.series in (None, "observations"):
            notes.append(f"The IMU was left out: {untied}; time='local' reads it alone.")
            metadata = metadata_of(path, hints, TimeBase("gps", raw.observations.epoch_gps_s), notes)
            return Recording(observations=raw.observations, metadata=metadata)
        raise InputError(f"{untied}: read either, with streams='imu=none' or time='local'")
    weeks = raw.observations.epoch_gps_s - recording.metadata.time.epoch_gps_s
    observations = replace(
        raw.observations, t=raw.observations.t + weeks, epoch_gps_s=recording.metadata.time.epoch_gps_s
    )
    return replace(recording, observations=observations)


def _raw(
    path: Path, rows: list[tuple[str, list[str]]], names: dict[str, list[str]], hints: ReadHints, notes: list[str]
) -> android_raw.RawMeasurements | None:
    """Raw measurements, if there are any with all fields, and GPS time is asked for."""
    records = [fields for kind, fields in rows if kind == "Raw"]
    if not records:
        return None
    missing = [name for name in android_raw.REQUIRED if name not in names.get("Raw", ())]
    if missing or hints.time == "local":
        why = f"their comment does not name {missing[0]}" if missing else "the time since boot was asked for"
        notes.append(f"Raw measurements of satellites (Raw) were not read: {why}.")
        return None
    raw = android_raw.raw_measurements(path, names["Raw"], records)
    notes.extend(raw.observations.notes)
    return raw


def _rows(path: Path) -> tuple[list[tuple[str, list[str]]], dict[str, list[str]]]:
    """Records as fields, and the names of the fields of each kind by the comments."""
    encoding = lines.encoding_of(lines.check_file(path), path)
    rows, names = [], {}
    with path.open(encoding=encoding, errors="replace", newline=None) as stream:
        for line in stream:
            if line.startswith("#"):
                fields = [field.strip() for field in line[1:].strip().split(",")]
                if len(fields) > 3:
                    names[fields[0]] = fields
                continue
            kind, comma, _ = line.partition(",")
            if comma and (kind in _FIELDS or kind == "Raw"):
                fields = line.strip().split(",")
                if kind == "Fix":
                    fields[1] = fields[1].upper()  # the first version writes gps
                rows.append((kind, fields))
    names = {kind: [_FIRST_VERSIONS.get(name, name) for name in fields] for kind, fields in names.items()}
    return rows, names


def _places(path: Path, names: dict[str, list[str]], kind: str, required: tuple[str, ...]) -> list[int | None]:
    if kind not in names:
        raise FileFormatError(f"expected a comment at the top that names the fields of {kind}", path)
    return [names[kind].index(name) if name in names[kind] else None for name in required]


def _table(
    path: Path,
    records: Sequence[Sequence[str]],
    names: dict[str, list[str]],
    kind: str,
    notes: list[str],
) -> tuple[list[int], IntArray, FloatArray]:
    """Places of the records of a kind that hold numbers, their times since boot [ns] and fields, NaN if not written."""
    required = _FIELDS[kind]
    stamp = next((k for k in _places(path, names, kind, _BOOT) if k is not None), None)
    places = _places(path, names, kind, required)
    if stamp is None and kind != "Fix":
        raise FileFormatError(
            f"{kind} has no elapsedRealtimeNanos: logs of GnssLogger before version 2 are not read", path
        )

    def parse(fields: Sequence[str]) -> tuple[int, list[float]]:
        ns = 0 if stamp is None else int(fields[stamp])
        if abs(ns) > 4_000_000_000_000_000_000:
            raise ValueError(f"impossible time {ns} ns")
        values = [float(fields[k] or "nan") if k is not None and k < len(fields) else np.nan for k in places]
        if kind != "Fix" and not np.isfinite(values).all():
            raise ValueError("an IMU measures every axis")
        return ns, values

    kept, parsed = android_raw.sound_records(path, kind, records, parse, notes)
    table = np.array([row[1] for row in parsed], dtype=np.float64).reshape(len(parsed), len(required))
    return kept, np.array([row[0] for row in parsed], dtype=np.int64), table


def _unix(path: Path, records: Sequence[Sequence[str]], names: dict[str, list[str]]) -> IntArray:
    columns = [k for k in _places(path, names, "Fix", _UNIX) if k is not None]
    if not columns:
        raise FileFormatError("the fixes have no UnixTimeMillis", path)
    try:
        ms = [int(float(fields[columns[0]])) for fields in records]
    except (ValueError, IndexError, OverflowError):
        raise FileFormatError("Fix: expected whole milliseconds in UnixTimeMillis", path) from None
    if max(map(abs, ms), default=0) > 4_000_000_000_000:
        raise FileFormatError("Fix: impossible UnixTimeMillis", path)
    return np.array(ms, dtype=np.int64) * 1_000_000


def _times(
    boot: dict[str, IntArray], unix: IntArray | None, hints: ReadHints, notes: list[str]
) -> tuple[dict[str, FloatArray], TimeBase]:
    """Seconds on GPS time where fixes tie the time since boot to Unix time, else since boot."""
    stamps = dict(boot)
    if "Fix" in stamps and not stamps["Fix"].any() and unix is not None:
        if len(stamps) > 1:
            raise InputError(
                "the fixes have no elapsedRealtimeNanos, so they cannot be related to the IMU: leave one out, "
                "streams='gnss=none' or 'imu=none'"
            )
        stamps["Fix"] = unix
        return clock.from_unix(stamps, hints.time, notes, "unix")
    if unix is None or hints.time == "local":
        notes.append("Stamps are seconds since boot.")
        return {kind: ns / clock.NS for kind, ns in stamps.items()}, TimeBase("local")
    return _tied(stamps, unix - stamps["Fix"], "fixes", hints, notes)


def _tied(
    stamps: dict[str, IntArray], offset: IntArray, by: str, hints: ReadHints, notes: list[str]
) -> tuple[dict[str, FloatArray], TimeBase]:
    """Seconds on GPS time, by Unix time less time since boot [ns]."""
    shift = int(np.median(offset))
    spread = float(np.abs(offset - shift).max()) / clock.NS
    delay = "; the delay of a fix is part of it" if by == "fixes" else ""
    notes.append(
        f"Stamps since boot were brought to Unix time by the {by}, which differ by up to {spread * 1e3:.3g} ms from "
        f"one offset{delay}."
    )
    return clock.from_unix({kind: ns + shift for kind, ns in stamps.items()}, hints.time, notes, "unix")


def _utc_ns(gps_ns: IntArray) -> IntArray:
    """Unix time of GPS time since 1980. Shapes (n,). [ns]"""
    to_unix = int(UNIX_TO_GPS_S)
    first = float(gps_ns.min() // clock.NS)
    leap = round(float(gps_from_unix(np.array([first + to_unix]))[0]) - first)
    return gps_ns + (to_unix - leap) * clock.NS


def _fixes(t: FloatArray, rows: FloatArray, path: Path, hints: ReadHints, notes: list[str]) -> Table:
    good = np.isfinite(rows[:, :3]).all(axis=1)
    if not good.all():
        notes.append(f"{int((~good).sum())} fixes without latitude, longitude or height were left out.")
    t, rows = t[good], rows[good]
    if not len(t):
        raise FileFormatError("no fix has latitude, longitude and height", path)
    keep = parts.later(t, "fixes", path, notes)
    t, rows = t[keep], rows[keep]
    values = {"t": t, "lat": rows[:, 0] * units.DEG, "lon": rows[:, 1] * units.DEG, "h": rows[:, 2]}
    radius, vertical = rows[:, 3], rows[:, 4]
    if np.isfinite(radius).all():
        if not np.isfinite(vertical).all():
            vertical = np.where(np.isfinite(vertical), vertical, 2.0 * radius)
            notes.append("Where a fix has no vertical accuracy, twice the horizontal one is taken.")
        sigma = radius / CIRCLE_68
        values |= {"sn": sigma, "se": sigma, "sd": vertical}
        notes.append("Accuracies are radii of 68 %; 1-sigma of north and east is the radius by 1.51.")
    speed, course, of_speed, of_course = rows[:, 5], rows[:, 6] * units.DEG, rows[:, 7], rows[:, 8] * units.DEG
    values |= velocities(t, (values["lat"], values["lon"]), speed, course, (of_speed, of_course), notes)
    return Table(values)
