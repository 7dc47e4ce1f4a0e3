"""Folders of an Android phone as open-aided-navigation has them: ``*_Acc.csv``, ``*_Gyro.csv`` and ``*_GNSS.csv``.

Tables with semicolons: three header lines and ``t [ns since boot];x;y;z;`` of the sensors [m/s^2], [rad/s]; one header
line and boot time [ns], UTC [ms], latitude, longitude [deg], height [m], speed [m/s], course [deg] and their accuracies
(horizontal, vertical [m], speed [m/s], course [deg]) of the fixes. Axes are the phone's, x right, y to its top, z out
of its screen. Accelerometer and gyroscope are not sampled together. (github fedorbaklanov/open-aided-navigation, data.)
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from schuler import units
from schuler.arrays import FloatArray
from schuler.exceptions import FileFormatError
from schuler.recording.io import clock, clock_map, parts, plain_text
from schuler.recording.io.hint_texts import parse_streams
from schuler.recording.io.hints import ReadHints
from schuler.recording.io.over_ground import CIRCLE_68, measured, velocities
from schuler.recording.io.parts import Table
from schuler.recording.io.streams import Stream, joined, stream_of
from schuler.recording.recording import Recording
from schuler.timebase import UNIX_TO_GPS_S, TimeBase

_HINTS = parts.GNSS_HINTS | {"axes", "streams", "time"}
_AXES = "RFU"
#: Suffix of a file's name: what its header begins its columns with, numbers in a row (a last one is empty).
_TABLES = {"Acc": (b"TimestampAcc [ns]", 4), "Gyro": (b"TimestampGyro [ns]", 4), "GNSS": (b"TimestampGNSS [ns]", 11)}
_PARTS = {"Gyro": "imu", "GNSS": "gnss"}


def sniff(head: bytes, path: Path) -> bool:
    """Whether a file is one of the tables; the sensors' are read with their folder."""
    return any(mark in head[:1000] for mark, _ in _TABLES.values())


def sniff_folder(path: Path) -> bool:
    """Whether a folder has fixes, or both sensors."""
    files = _files(path)
    return "GNSS" in files or {"Acc", "Gyro"} <= files.keys()


def contents(path: Path) -> list[Stream]:
    """The tables with their times since boot, for ``schuler info``."""
    streams = []
    for name, file in (_files(path) if path.is_dir() else _of_file(path)).items():
        rows = _load(file, name, ReadHints(allow="truncated"), [])
        streams.append(stream_of(file.name, "csv", rows[:, 0] / clock.NS, _PARTS.get(name, "")))
    return streams


def read(path: Path, hints: ReadHints) -> Recording:
    """IMU and fixes of a folder, or the fixes of a file.

    Parameters
    ----------
    path : Path
    hints : ReadHints
        ``axes`` of the phone in the vehicle, if it does not lie on its back with its top forward; ``height``;
        ``streams="imu=none"``; ``time="local"`` keeps the time since boot; ``sigma`` where there is no accuracy.

    Raises
    ------
    FileFormatError
        With file and line, for what is missing or malformed.
    """
    parts.check_hints(path, hints, _HINTS, "a phone's folder of open-aided-navigation")
    files = _files(path) if path.is_dir() else _of_file(path)
    chosen = parse_streams(hints.streams)
    if chosen.get("imu", "") is None or not {"Acc", "Gyro"} <= files.keys():
        files = {name: file for name, file in files.items() if name == "GNSS"}
    if chosen.get("gnss", "") is None:
        files.pop("GNSS", None)
    if not files:
        raise FileFormatError(
            "expected *_Acc.csv with *_Gyro.csv, or *_GNSS.csv: a sensor is read with its folder", path
        )
    notes: list[str] = []
    tables: dict[str, Table] = {}
    rows: dict[str, tuple[FloatArray, FloatArray]] = {}
    for name, file in files.items():
        table = _load(file, name, hints, notes)
        t, values = table[:, 0] / clock.NS, table[:, 1:]
        rows[name] = t, values
        if name != "GNSS":
            keep = parts.later(t, file.name, path, notes)
            rows[name] = t[keep], values[keep]
    if "Gyro" in rows:
        tables["imu"] = Table(joined(*rows["Acc"], *rows["Gyro"], path, notes), axes=_AXES)
        if hints.axes is None:
            notes.append("The phone is taken to lie on its back, its top forward (axes RFU); hint axes says otherwise.")
    if "GNSS" in rows:
        tables["gnss"] = _fixes(*rows["GNSS"], hints, notes)
    if hints.time == "local" or "gnss" not in tables:
        base = TimeBase("local")
        notes.append("Stamps are seconds since the phone was switched on.")
    else:
        base = clock_map.on_gps_time(tables, notes)
    if "gnss" in tables:
        gnss = tables["gnss"].values
        gnss.pop("gps")
        keep = parts.later(gnss["t"], "fixes", path, notes)
        tables["gnss"] = replace(tables["gnss"], values={name: column[keep] for name, column in gnss.items()})
    name = hints.name or path.stem
    return parts.assemble(path, tables, replace(hints, time=None, name=name), base, notes, files.values())


def _files(folder: Path) -> dict[str, Path]:
    """The tables of a folder by kind; none of a kind of which there are several."""
    files: dict[str, Path] = {}
    try:
        for name, (mark, _) in _TABLES.items():
            fitting = [f for f in sorted(folder.glob(f"*{name}.csv")) if mark in plain_text.head_of(f, 1000)]
            if len(fitting) == 1:
                files[name] = fitting[0]
    except OSError:
        return {}
    return files


def _of_file(path: Path) -> dict[str, Path]:
    head = plain_text.head_of(path, 1000)
    return {name: path for name, (mark, _) in _TABLES.items() if mark in head}


def _load(path: Path, name: str, hints: ReadHints, notes: list[str]) -> FloatArray:
    """Rows of a table; 104 days since boot are whole nanoseconds in a floating-point number. Shape (m, n)."""
    n = _TABLES[name][1]
    what = "stamp, x, y, z" if n == 4 else "stamp, UTC, latitude, longitude, height, speed, course, four accuracies"
    table = plain_text.open_table(path, (n, n + 1), what, delimiter=";")
    fields = plain_text.width(table)  # lines end in a delimiter
    return plain_text.load(table, n, allow_truncated=hints.allows("truncated"), notes=notes, fields=fields)


def _fixes(boot: FloatArray, rows: FloatArray, hints: ReadHints, notes: list[str]) -> Table:
    """Fixes with ``gps``, the GPS time of each. [s]"""
    utc, lat, lon, height, speed, course, radius, vertical, of_speed, of_course = rows.T
    lat, lon, course = lat * units.DEG, lon * units.DEG, course * units.DEG
    unix = utc * 1e-3
    gps = unix - UNIX_TO_GPS_S
    gps = gps + clock.leaps_at(float(gps[0]))
    values = {"t": boot, "gps": gps, "lat": lat, "lon": lon, "h": height}
    if np.all(radius > 0.0):
        if not measured(vertical, radius):
            notes.append(
                f"The vertical accuracy is {vertical[0]:g} m in every fix and was not measured: twice the "
                "horizontal one is taken."
            )
            vertical = 2.0 * radius
        values |= {"sn": radius / CIRCLE_68, "se": radius / CIRCLE_68, "sd": vertical}
        notes.append("Accuracies are radii of 68 %; 1-sigma of north and east is the radius by 1.51.")
    sigma = (
        of_speed if measured(of_speed, radius) else None,
        of_course * units.DEG if measured(of_course, radius) else None,
    )
    values |= velocities(gps, (lat, lon), speed, course, sigma, notes)
    return Table(values, ellipsoidal=False)
