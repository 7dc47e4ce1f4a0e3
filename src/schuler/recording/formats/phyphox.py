"""Exports of the app phyphox: a CSV table a sensor in a folder or a zip, and Location.csv alone.

Stamps are seconds of the experiment; ``meta/time.csv`` relates them to Unix time, pauses included. Axes are the
phone's, x right, y to its top, z out of its screen. Tables are known by their headers, in any of the app's separators,
with decimal points or commas. Linear accelerations, which gravity was taken out of, are not used.
"""

from __future__ import annotations

import io
import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from schuler import units
from schuler.arrays import FloatArray, IntArray
from schuler.exceptions import FileFormatError
from schuler.recording.io import clock, parts, plain_text
from schuler.recording.io.hints import ReadHints
from schuler.recording.io.over_ground import CIRCLE_68, velocities
from schuler.recording.io.parts import Table
from schuler.recording.io.streams import joined
from schuler.recording.io.zip_tables import MOST_TABLES, unzipped_tables, zipped_names
from schuler.recording.recording import Recording
from schuler.timebase import TimeBase

_HINTS = parts.GNSS_HINTS | {"axes", "time"}
_AXES = "RFU"
_HEAD = 400  # characters of a header
_TIMES = "meta/time.csv"
_NO_VERTICAL = 1.5  # vertical 1-sigma over the horizontal one where none is stated
_LONGEST = 1e8  # no experiment lasts so long: three years [s]


@dataclass(frozen=True)
class _Sheet:
    """A table: words of its header without units, and its text."""

    name: str
    words: tuple[str, ...]
    text: str


def sniff(head: bytes, path: Path) -> bool:
    """Whether a file is a table of places, or a zip of tables, of the app."""
    if any(name.endswith(_TIMES) for name in zipped_names(head, path)):
        return True
    words = _words(head[:_HEAD].decode("utf-8", "replace"))
    return words[:1] == ("time",) and {"latitude", "longitude", "direction"} <= set(words)


def sniff_folder(path: Path) -> bool:
    """Whether a folder has a table of rates as the app writes it."""
    headers = (_words(plain_text.head_of(p, _HEAD).decode("utf-8", "replace")) for p in _tables(path))
    return any(words[:1] == ("time",) and "gyroscope x" in words for words in headers)


def holds(path: Path) -> tuple[str, ...]:
    """Fixes of a table of places; all of a run in a zip."""
    return ("gnss",) if path.suffix.lower() != ".zip" else ("imu", "gnss")


def read(path: Path, hints: ReadHints) -> Recording:
    """IMU and fixes of an export.

    Parameters
    ----------
    path : Path
        A folder, a zip, or the table of places.
    hints : ReadHints
        ``axes`` of the phone in the vehicle, if it does not lie on its back with its top forward; ``time="local"`` for
        the clock of the experiment; ``sigma``, ``height``, ``geoid_separation``.

    Raises
    ------
    FileFormatError
        With the table, for what is missing or malformed.
    """
    parts.check_hints(path, hints, _HINTS, "an export of phyphox")
    notes: list[str] = []
    sheets, sources = _sheets(path)
    accel = next((s for s in sheets if _triad(s, "accel") is not None), None)
    gyro = next((s for s in sheets if _triad(s, "gyroscope") is not None), None)
    places = next((s for s in sheets if "latitude" in s.words and "longitude" in s.words), None)
    raw: dict[str, tuple[FloatArray, FloatArray]] = {}
    for name, sheet, columns in (
        ("accel", accel, _triad(accel, "accel") if accel else None),
        ("gyro", gyro, _triad(gyro, "gyroscope") if gyro else None),
    ):
        if sheet is not None and columns is not None:
            values = _values(sheet, path)
            finite = np.isfinite(values[:, [0, *columns]]).all(axis=1)
            if finite.any():
                raw[name] = values[finite, 0], values[finite][:, columns]
    if ("accel" in raw) != ("gyro" in raw):
        notes.append("There is only one of accelerometer (with gravity) and gyroscope: no IMU.")
        raw = {}
    if places is not None:
        values = _values(places, path)
        values = values[np.isfinite(values[:, [0, places.words.index("latitude")]]).all(axis=1)]
        if len(values):
            raw["gnss"] = values[:, 0], values
    if not raw:
        raise FileFormatError(
            "expected tables of accelerometer and gyroscope, or of places, with rows of numbers", path
        )
    base, seconds = _on_clock({name: t for name, (t, _) in raw.items()}, sheets, path, hints, notes)
    kept = {name: parts.later(t, name, path, notes) for name, t in seconds.items()}
    t = {name: seconds[name][k] for name, k in kept.items()}
    rows = {name: raw[name][1][k] for name, k in kept.items()}
    tables = {}
    if "gyro" in raw:
        tables["imu"] = Table(joined(t["accel"], rows["accel"], t["gyro"], rows["gyro"], path, notes), axes=_AXES)
        if hints.axes is None:
            notes.append("The phone is taken to lie on its back, its top forward (axes RFU); hint axes says otherwise.")
    if places is not None and "gnss" in raw:
        tables["gnss"] = _fixes(t["gnss"], rows["gnss"], places.words, hints, notes)
    return parts.assemble(path, tables, hints, base, notes, sources)


def _tables(path: Path) -> list[Path]:
    return sorted(p for p in path.glob("*.csv") if p.is_file())[:MOST_TABLES] if path.is_dir() else []


def _words(text: str) -> tuple[str, ...]:
    """Fields of a header without quotes and units."""
    line = text.lstrip("\ufeff").split("\n")[0].strip()
    fields = re.split("[;\t]" if ";" in line or "\t" in line else ",", line)
    return tuple(re.sub(r"\s*\(.*", "", field.strip(' "\r')).lower() for field in fields)


def _sheets(path: Path) -> tuple[list[_Sheet], list[Path]]:
    """Tables of an export, and the files they are read from."""
    if path.is_dir():
        files = [*_tables(path), *([path / _TIMES] if (path / _TIMES).is_file() else [])]
        made = [(p.relative_to(path).as_posix(), p.read_bytes()) for p in files]
    elif path.suffix.lower() == ".zip":
        files, made = [path], unzipped_tables(path)
    else:
        files, made = [path], [(path.name, path.read_bytes())]
    texts = [(name, data.decode("utf-8", "replace")) for name, data in made]
    return [_Sheet(name, _words(text), text) for name, text in texts], files


def _triad(sheet: _Sheet, sensor: str) -> list[int] | None:
    """Columns x, y, z of a sensor; ``x (m/s^2)`` counts where the table is called after it."""
    for stem in ("acceleration", "accelerometer") if sensor == "accel" else (sensor,):
        names = [f"{stem} {axis}" for axis in "xyz"]
        if set(names) <= set(sheet.words):
            return [sheet.words.index(name) for name in names]
    called = re.match(r"(accelerometer|gyroscope)\b", Path(sheet.name).stem.lower())
    if called and called.group(1).startswith(sensor) and {"x", "y", "z"} <= set(sheet.words):
        return [sheet.words.index(axis) for axis in "xyz"]
    return None


def _values(sheet: _Sheet, path: Path) -> FloatArray:
    """Numbers below a header; empty fields are missing ones. Shape (n, columns)."""
    first, _, body = sheet.text.partition("\n")
    delimiter = ";" if ";" in first else "\t" if "\t" in first else ","
    if delimiter != ",":
        body = body.replace(",", ".")
    if not body.strip():
        return np.zeros((0, len(sheet.words)))
    try:
        if ",," in body:  # no comments either: NUL stands in no number
            values = np.genfromtxt(io.StringIO(body), delimiter=delimiter, comments="\0")
        else:
            values = np.loadtxt(io.StringIO(body), delimiter=delimiter, comments=None, ndmin=2)
    except ValueError as error:
        raise FileFormatError(f"{sheet.name}: expected numbers below the header ({error})", path) from error
    values = np.atleast_2d(values)
    if values.size and values.shape[1] != len(sheet.words):
        raise FileFormatError(f"{sheet.name}: expected {len(sheet.words)} columns, got {values.shape[1]}", path)
    return np.asarray(values.reshape(-1, len(sheet.words)), dtype=np.float64)


def _on_clock(
    stamps: dict[str, FloatArray], sheets: list[_Sheet], path: Path, hints: ReadHints, notes: list[str]
) -> tuple[TimeBase, dict[str, FloatArray]]:
    """Times of a time base: of the phone's clock where ``meta/time.csv`` says how the two are related."""
    for name, t in stamps.items():
        worst = float(t[np.argmax(np.abs(t))])
        if not abs(worst) < _LONGEST:
            raise FileFormatError(f"{name}: expected stamps in seconds of the experiment, got {worst:g}", path)
    starts = _starts(next((s for s in sheets if s.name.endswith(_TIMES)), None))
    if not len(starts) or hints.time == "local":
        if hints.time not in (None, "local"):
            raise FileFormatError(
                f"time={hints.time!r}, but there is no {_TIMES} to tell when the experiment began", path
            )
        notes.append("Stamps are seconds of the experiment.")
        return TimeBase("local"), stamps
    if len(starts) > 1:
        notes.append(f"The experiment was paused {len(starts) - 1} times; stamps count on by the phone's clock.")
    ns: dict[str, IntArray] = {}
    for name, t in stamps.items():
        k = np.clip(np.searchsorted(starts[:, 0], t, side="right") - 1, 0, None)
        whole = np.floor(starts[:, 1]).astype(np.int64)
        since = t - starts[k, 0] + (starts[k, 1] - whole[k])
        ns[name] = whole[k] * clock.NS + np.round(since * clock.NS).astype(np.int64)
    seconds, base = clock.from_unix(ns, hints.time, notes, "unix")
    return base, seconds


def _starts(sheet: _Sheet | None) -> FloatArray:
    """Experiment time and Unix time of each start. Shape (n, 2). [s]"""
    rows = []
    for line in sheet.text.splitlines()[1:] if sheet is not None else ():
        fields = [field.strip(' "') for field in re.split("[;\t]" if re.search("[;\t]", line) else ",", line)]
        try:
            if fields[0] == "START":
                rows.append([float(field.replace(",", ".")) for field in fields[1:3]])
        except (ValueError, IndexError):
            continue
    return np.array([row for row in rows if len(row) == 2 and abs(row[0]) < _LONGEST and abs(row[1]) < 2e9]).reshape(
        -1, 2
    )


def _fixes(t: FloatArray, rows: FloatArray, words: tuple[str, ...], hints: ReadHints, notes: list[str]) -> Table:
    def column(*names: str) -> FloatArray | None:
        return next((rows[:, words.index(name)] for name in names if name in words), None)

    above = column("altitude wgs84")
    h = column("height", "altitude") if above is None or not np.isfinite(above).all() else above
    lat, lon = rows[:, words.index("latitude")] * units.DEG, rows[:, words.index("longitude")] * units.DEG
    values = {"t": t, "lat": lat, "lon": lon, "h": np.zeros_like(t) if h is None else h}
    horizontal, vertical = column("horizontal accuracy"), column("vertical accuracy")
    if hints.sigmas is None and horizontal is not None and np.all(horizontal > 0.0):
        sigma = horizontal / CIRCLE_68
        values |= {"sn": sigma, "se": sigma}
        notes.append("Accuracies are radii of 68 %; 1-sigma of north and east is the radius by 1.51.")
        if vertical is None or not np.all(vertical > 0.0):
            notes.append("No accuracy of heights is stated: 1-sigma is 1.5 times the horizontal radius.")
            vertical = _NO_VERTICAL * horizontal
        values["sd"] = vertical
    speed, course = column("velocity", "speed"), column("direction")
    if speed is not None and course is not None:
        course = np.where(course >= 0.0, course, np.nan) * units.DEG
        values |= velocities(t, (lat, lon), np.where(speed >= 0.0, speed, np.nan), course, (None, None), notes)
    return Table(values, ellipsoidal=h is above and above is not None)
