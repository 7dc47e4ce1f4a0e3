"""Exports of the app Sensor Logger, a folder or a zip: a CSV table a sensor with ``time`` in Unix nanoseconds.

``TotalAcceleration.csv`` is what the accelerometer feels; ``Accelerometer.csv`` has gravity taken out, which
``Gravity.csv`` gives back. ``Gyroscope.csv`` [rad/s], ``Location.csv`` with accuracies of 68 %. Columns stand in any
order (the app writes z, y, x); axes are the device's, x right, y to its top, z out of its screen.
"""

from __future__ import annotations

import tempfile
from dataclasses import replace
from pathlib import Path

import numpy as np

from schuler import units
from schuler.arrays import FloatArray, IntArray
from schuler.exceptions import FileFormatError
from schuler.recording.io import clock, lines, parts, plain_text
from schuler.recording.io.hint_texts import parse_streams
from schuler.recording.io.hints import ReadHints
from schuler.recording.io.over_ground import CIRCLE_68, velocities
from schuler.recording.io.parts import Table
from schuler.recording.io.streams import joined
from schuler.recording.io.zip_tables import head_in_zip, unzipped_tables, zipped_names
from schuler.recording.recording import Recording

_HINTS = parts.GNSS_HINTS | {"axes", "streams", "time"}
_AXES = "RFU"
_LOCATION = ("latitude", "longitude", "altitude", "horizontalAccuracy", "verticalAccuracy")
_VELOCITY = ("speed", "bearing", "speedAccuracy", "bearingAccuracy")  # where there are these columns
_MADE_BY_THE_APP = ("Gyroscope", "GyroscopeUncalibrated", "Location")
_MARK, _HEAD = b"seconds_elapsed", 400  # a column of every table, in its first bytes


def sniff(head: bytes, path: Path) -> bool:
    """Whether a file is a zip with rates or places as the app writes them; a table alone is read with its folder."""
    return any(
        Path(name).stem in _MADE_BY_THE_APP and _MARK in head_in_zip(path, name, _HEAD)
        for name in zipped_names(head, path)
        if name.endswith(".csv")
    )


def holds(path: Path) -> tuple[str, ...]:
    """IMU and fixes of a zip."""
    return ("imu", "gnss")


def sniff_folder(path: Path) -> bool:
    """Whether a folder has rates or places as the app writes them."""
    return any(_MARK in plain_text.head_of(path / f"{name}.csv", _HEAD) for name in _MADE_BY_THE_APP)


def read(path: Path, hints: ReadHints) -> Recording:
    """IMU and fixes of an export.

    Parameters
    ----------
    path : Path
        A folder or a zip.
    hints : ReadHints
        ``streams="imu=GyroscopeUncalibrated,gnss=none"``; ``axes`` of the device in the vehicle, if it does not lie on
        its back with its top forward; ``time`` if stamps are not Unix time.

    Raises
    ------
    FileFormatError
        With file and line, for what is missing or malformed.
    """
    parts.check_hints(path, hints, _HINTS, "an export of Sensor Logger")
    if path.is_file() and path.suffix.lower() == ".zip":
        return _read_zip(path, hints)
    if not path.is_dir() or not sniff_folder(path):
        raise FileFormatError("expected a folder or a zip with Gyroscope.csv or Location.csv of Sensor Logger", path)
    return _read_folder(path, hints)


def _read_zip(path: Path, hints: ReadHints) -> Recording:
    """A zip is read as the folder that it unpacks to."""
    with tempfile.TemporaryDirectory(prefix="schuler-") as folder:
        for name, table in unzipped_tables(path):
            (Path(folder) / Path(name).name).write_bytes(table)
        try:
            return _read_folder(Path(folder), hints, path)
        except FileFormatError as error:
            raise FileFormatError(str(error).replace(folder, str(path))) from error


def _read_folder(path: Path, hints: ReadHints, packed: Path | None = None) -> Recording:
    """IMU and fixes of a folder, which a zip was unpacked to where one is given."""
    notes: list[str] = []
    stamps: dict[str, IntArray] = {}
    values: dict[str, FloatArray] = {}
    chosen = parse_streams(hints.streams)

    def load(name: str, columns: tuple[str, ...]) -> bool:
        if not (path / f"{name}.csv").is_file():
            return False
        stamps[name], values[name] = _table(path / f"{name}.csv", columns, hints, notes)
        return True

    gyro = chosen.get("imu", "Gyroscope")
    accel: tuple[str, ...] = ()
    if gyro is not None and load(gyro, ("x", "y", "z")):
        for names in (("TotalAcceleration",), ("AccelerometerUncalibrated",), ("Accelerometer", "Gravity")):
            if all((path / f"{name}.csv").is_file() for name in names):
                accel = names
                break
        if not accel:
            del stamps[gyro], values[gyro]
            notes.append(
                "There are rates but no TotalAcceleration.csv, nor Accelerometer.csv with Gravity.csv: no IMU."
            )
        for name in accel:
            load(name, ("x", "y", "z"))
    if chosen.get("gnss", "") is not None:
        load("Location", (*_LOCATION, *_VELOCITY) if _has(path / "Location.csv", _VELOCITY) else _LOCATION)
    if not stamps:
        raise FileFormatError("there is neither an IMU nor Location.csv", path)
    sources = [path / f"{name}.csv" for name in stamps] if packed is None else [packed]
    seconds, base = clock.from_unix(stamps, hints.time, notes, "unix")
    kept = {name: parts.later(seconds[name], name, path, notes) for name in stamps}
    t = {name: seconds[name][k] for name, k in kept.items()}
    v = {name: values[name][k] for name, k in kept.items()}
    tables = {}
    if accel and gyro is not None:
        f = v[accel[0]]
        if len(accel) == 2:
            f = f + np.stack([np.interp(t[accel[0]], t[accel[1]], v[accel[1]][:, k]) for k in range(3)], axis=1)
        notes.append(f"IMU: {' plus '.join(accel)} and {gyro}.")
        tables["imu"] = Table(joined(t[accel[0]], f, t[gyro], v[gyro], path, notes), axes=_AXES)
        if hints.axes is None:
            notes.append(
                "The device is taken to lie on its back, its top forward (axes RFU); hint axes says otherwise."
            )
    if "Location" in v:
        rows = v["Location"]
        place = {"lat": rows[:, 0] * units.DEG, "lon": rows[:, 1] * units.DEG, "h": rows[:, 2]}
        if np.all(rows[:, 3:5] > 0.0):
            sigma = rows[:, 3] / CIRCLE_68
            place |= {"sn": sigma, "se": sigma, "sd": rows[:, 4]}
            notes.append("Accuracies are radii of 68 %; 1-sigma of north and east is the radius by 1.51.")
        if rows.shape[1] > len(_LOCATION):
            # the app writes -1 where a phone has none
            speed, course, *sigma = np.where(rows[:, 5:] >= 0.0, rows[:, 5:], np.nan).T
            course, of_course = course * units.DEG, sigma[1] * units.DEG
            where = place["lat"], place["lon"]
            place |= velocities(t["Location"], where, speed, course, (sigma[0], of_course), notes)
        tables["gnss"] = Table({"t": t["Location"], **place}, ellipsoidal=False)
    return parts.assemble(packed or path, tables, replace(hints, time=None), base, notes, sources)


def _has(path: Path, columns: tuple[str, ...]) -> bool:
    """Whether the header of a table has all of the columns."""
    head = plain_text.head_of(path, 4000).split(b"\n")[0].decode("latin-1")
    return set(columns) <= {name.strip().strip('"') for name in head.split(",")}


def _table(path: Path, columns: tuple[str, ...], hints: ReadHints, notes: list[str]) -> tuple[IntArray, FloatArray]:
    """Stamps [ns] and columns of a table by the names in its header."""
    first = lines.check_file(path).split(b"\n")[0].decode("latin-1").strip().lstrip("ï»¿")
    names = [name.strip().strip('"') for name in first.split(",")]
    if missing := [name for name in ("time", *columns) if name not in names]:
        raise FileFormatError(f"expected the columns time, {', '.join(columns)}; {', '.join(missing)} missing", path, 1)
    if names[0] != "time":
        raise FileFormatError("expected time as the first column", path, 1)
    table = plain_text.open_table(path, (len(names),), first[:80], delimiter=",")
    ns, rows = plain_text.load_ns(table, len(names), allow_truncated=hints.allows("truncated"), notes=notes)
    return ns, rows[:, [names.index(name) - 1 for name in columns]]
