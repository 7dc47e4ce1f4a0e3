"""Text exports of Waypoint Inertial Explorer and GrafNav: a header with the names of the columns and, below, units.

Which columns there are the user chose. Known are Week, GPSTime, Latitude, Longitude, H-Ell, VEast, VNorth, VUp, Roll,
Pitch, Heading and 1-sigmas of positions and velocities; the others are passed over. Roll is right side down, pitch nose
up, heading from north over east. Names by NovAtel's Waypoint manual, appendix Output Variables (OM-20000166).
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from schuler import units
from schuler.arrays import FloatArray
from schuler.exceptions import FileFormatError
from schuler.recording.io import lines, parts
from schuler.recording.io.clock import stamps
from schuler.recording.io.hints import ReadHints
from schuler.recording.io.lines import TextTable
from schuler.recording.io.parts import Table
from schuler.recording.recording import Recording

_HINTS = parts.GNSS_HINTS | {"time"}
_NAMES = {
    "week": "week", "gpstime": "t", "corrtime": "t", "latitude": "lat", "longitude": "lon", "h-ell": "h",
    "h-msl": "h-msl", "undulation": "undulation", "veast": "ve", "vnorth": "vn", "vup": "vu", "roll": "roll",
    "pitch": "pitch", "heading": "yaw", "sdnorth": "sn", "sdeast": "se", "sdheight": "sd", "sd-vn": "svn",
    "sd-ve": "sve", "sd-vh": "svd", "vnorthsd": "svn", "veastsd": "sve", "vupsd": "svd", "sdvnorth": "svn",
    "sdveast": "sve", "sdvup": "svd", "ns": "ns", "nsats": "ns",
}  # fmt: skip
_ANGLES = ("lat", "lon", "roll", "pitch", "yaw")
_DMS = "dms"
_UNIT = re.compile(r"\([^()]*\)|\S+")
_FARTHEST = 400  # lines of header


@dataclass(frozen=True, slots=True)
class _Layout:
    """Columns of an export: name, unit as written in lower case, and position of the (first) field of each."""

    columns: dict[str, tuple[int, str]]
    fields: int
    first: int


def sniff(head: bytes, path: Path) -> bool:
    """Whether the top names a program of Waypoint, or columns as only they are called."""
    top = head[:30_000]
    if b"\x00" in top:
        return False
    if any(
        word in top[:2000] for word in (b"Inertial Explorer Version", b"GrafNav Version", b"GrafNav/GrafNet Version")
    ):
        return True
    return any(b"GPSTime" in line and b"H-Ell" in line and b"Latitude" in line for line in top.split(b"\n")[:100])


def holds(path: Path) -> tuple[str, ...]:
    """A reference with attitude, otherwise fixes; nothing if the header cannot be read."""
    try:
        layout = _layout(path, lines.encoding_of(lines.check_file(path), path))
    except FileFormatError:
        return ()
    return ("reference",) if "yaw" in layout.columns else ("gnss",)


def read(path: Path, hints: ReadHints) -> Recording:
    """Reference (with attitude) or fixes of an export.

    Parameters
    ----------
    path : Path
    hints : ReadHints
        ``time="gps-tow:WEEK"`` where the week was not exported; ``series="gnss"`` or ``"reference"`` instead of what
        the columns suggest; ``sigma``; ``height`` and ``geoid_separation`` where only H-MSL was exported.

    Raises
    ------
    FileFormatError
        With file and line; if time or position were not exported, or in a form that is not read.
    """
    parts.check_hints(path, hints, _HINTS, "a Waypoint export")
    encoding = lines.encoding_of(lines.check_file(path), path)
    layout = _layout(path, encoding)
    table = TextTable(path, layout.first, " ", "\n", encoding)
    used = {name: place for name, (place, _) in layout.columns.items()}
    wide = {name for name, (_, unit) in layout.columns.items() if unit == _DMS}
    order = [place + k for name, place in used.items() for k in range(3 if name in wide else 1)]
    values, truncated = lines.load(table, layout.fields, order, allow_truncated=hints.allows("truncated"))
    notes = ["The last line was cut off and left out."] if truncated else []
    bad = np.flatnonzero(~np.isfinite(values).all(axis=1))
    if len(bad):
        raise FileFormatError("a number is missing; correct or delete the line", path, table.line_of(int(bad[0])))
    columns: dict[str, FloatArray] = {}
    at = 0
    for name in used:
        n = 3 if name in wide else 1
        columns[name] = _degrees(table, at, order, values[:, at : at + 3]) if n == 3 else values[:, at]
        at += n
    return _recording(path, columns, table, hints, notes)


def _degrees(table: TextTable, at: int, order: list[int], dms: FloatArray) -> FloatArray:
    """Degrees of degrees, minutes, seconds; the sign stands at the degrees, also where they are zero."""
    negative = dms[:, 0] < 0.0
    zero = np.flatnonzero(dms[:, 0] == 0.0)
    if len(zero):
        rows = table.rows()
        signs = [fields[order[at]].startswith("-") for _, fields in rows]
        negative[zero] = np.array(signs[: len(dms)])[zero]
    return np.where(negative, -1.0, 1.0) * (np.abs(dms[:, 0]) + dms[:, 1] / 60.0 + dms[:, 2] / 3600.0)


def _layout(path: Path, encoding: str) -> _Layout:
    """The line of names, the line of units below it, and the first line of numbers."""
    names: list[str] | None = None
    ends: list[int] = []
    stated: list[str] | None = None
    with path.open(encoding=encoding, errors="replace", newline=None) as stream:
        for number, line in enumerate(stream, 1):
            text = line.strip()
            if not text:
                continue
            words = text.split()
            lower = [word.lower() for word in words]
            if names is None:
                if "latitude" in lower and "longitude" in lower:
                    names = lower
                    ends = [match.end() for match in re.finditer(r"\S+", line.rstrip())]
                elif number > _FARTHEST:
                    break
                continue
            if stated is None and any(word.startswith("(") for word in words):
                stated = _stated(line.rstrip(), ends)
                continue
            if any(map(lines.is_number, words)):
                return _placed(path, names, stated, len(words), number)
    what = "a line with the columns Latitude, Longitude, ..." if names is None else "rows of numbers below the header"
    raise FileFormatError(f"expected {what}; export from Inertial Explorer with a header", path)


def _stated(line: str, ends: list[int]) -> list[str]:
    """Unit of each name: in order if there are as many, else of the name that ends nearest, for some have none."""
    matches = [(match.end(), match.group().lower().strip("()")) for match in _UNIT.finditer(line)]
    if len(matches) == len(ends):
        return [unit for _, unit in matches]
    stated = ["" for _ in ends]
    for end, unit in matches:
        stated[int(np.argmin([abs(end - place) for place in ends]))] = unit
    return stated


def _placed(path: Path, names: list[str], stated: list[str] | None, fields: int, first: int) -> _Layout:
    stated = ["" for _ in names] if stated is None else stated
    columns: dict[str, tuple[int, str]] = {}
    at = 0
    for name, unit in zip(names, stated, strict=True):
        compact = re.sub(r"[^a-z0-9/^2]", "", unit).removeprefix("/")
        meaning = _NAMES.get(name)
        unit = _DMS if compact == _DMS else compact
        if meaning is not None and meaning not in columns:
            columns[meaning] = (at, unit)
        at += 3 if unit == _DMS else 1
    if at != fields:
        raise FileFormatError(
            f"the header names {len(names)} columns of {at} fields, the first row has {fields}: export with the units "
            "below the names, and dates and times as single numbers",
            path,
            first,
        )
    for name, (_, unit) in columns.items():
        expected = ("deg", "", _DMS) if name in _ANGLES else ("sec", "s", "") if name == "t" else None
        if expected is not None and unit not in expected:
            raise FileFormatError(
                f"{name} is in ({unit}): export angles in degrees and GPSTime in seconds of the week", path, first - 1
            )
        if name not in (*_ANGLES, "t", "week", "ns") and unit not in ("m", "m/s", "mps", ""):
            raise FileFormatError(f"{name} is in ({unit}): export metres and metres a second", path, first - 1)
    missing = [
        word for word, name in (("GPSTime", "t"), ("Latitude", "lat"), ("Longitude", "lon")) if name not in columns
    ]
    if missing or not columns.keys() & {"h", "h-msl"}:
        raise FileFormatError(
            f"{', '.join(missing) or 'H-Ell'} was not exported: add it to the profile", path, first - 1
        )
    return _Layout(columns, fields, first)


def _recording(
    path: Path, columns: dict[str, FloatArray], table: TextTable, hints: ReadHints, notes: list[str]
) -> Recording:
    def fault(message: str, row: int | None) -> FileFormatError:
        return FileFormatError(message, path, None if row is None else table.line_of(row))

    time = hints.time
    if "week" in columns and time is None:
        week = columns["week"][0]
        if not (week == round(week) and 0.0 <= week <= 9999.0):
            raise fault(f"impossible GPS week {week:g}", 0)
        time = f"gps-tow:{int(week)}"
    t, base = stamps(columns["t"].copy(), time, fault, notes)
    keep = parts.later(t, "epochs", path, notes)
    values = {name: columns[name] * units.DEG for name in ("lat", "lon")}
    if "h" in columns:
        values["h"] = columns["h"]
    elif "undulation" in columns:
        values["h"] = columns["h-msl"] + columns["undulation"]
        notes.append("Heights above the ellipsoid are H-MSL plus the exported undulation.")
    else:
        values["h"] = columns["h-msl"]
        if hints.height is None:
            raise fault("only H-MSL was exported: say height='msl' and geoid_separation=... [m], or export H-Ell", None)
    if {"vn", "ve", "vu"} <= columns.keys():
        values |= {"vn": columns["vn"], "ve": columns["ve"], "vd": -columns["vu"]}
    euler = {"roll", "pitch", "yaw"} <= columns.keys()
    series = hints.series or ("reference" if euler else "gnss")
    if series == "reference":
        if euler:
            values |= {name: columns[name] * units.DEG for name in ("roll", "pitch", "yaw")}
    else:
        for group in (("sn", "se", "sd"), ("svn", "sve", "svd")):
            if set(group) <= columns.keys():
                values |= {name: columns[name] for name in group}
        if "ns" in columns:
            values["ns"] = columns["ns"]
        if euler:
            notes.append("The fixes are a solution of GNSS and IMU: their errors are correlated in time.")
    ellipsoidal = "h" in columns or "undulation" in columns
    picked = {"t": t[keep]} | {name: np.ascontiguousarray(column[keep]) for name, column in values.items()}
    return parts.assemble(path, {series: Table(picked, ellipsoidal=ellipsoidal)}, hints, base, notes)
