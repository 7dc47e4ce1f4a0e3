"""Timed points of XML tracks (GPX, KML) as fixes, with accuracies typical of their kind, since none are stated."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from xml.etree import ElementTree

import numpy as np

from schuler import units
from schuler.exceptions import FileFormatError
from schuler.recording.io import clock, columns, dates, lines, parts
from schuler.recording.io.hints import ReadHints
from schuler.recording.io.over_ground import NO_HEIGHT, velocities
from schuler.recording.io.parts import Table
from schuler.recording.recording import Recording

HINTS = parts.GNSS_HINTS
# 1-sigma of a range, which HDOP and VDOP multiply: of a phone or a hand-held receiver, and differential [m]
_RANGE_ERROR, _DIFFERENTIAL = 5.0, 2.0
_VERTICAL = 1.5  # VDOP over HDOP, typical of an open sky


@dataclass(slots=True)
class Point:
    """A point as it is written; NaN for what it does not state.

    Attributes
    ----------
    time : str
        Date of ISO 8601; empty where there is none.
    lat, lon : float
        [deg]
    h : float
        [m]
    speed, course : float
        [m/s], [deg]
    hdop, vdop : float
        Dilutions of precision.
    differential : bool
    """

    time: str
    lat: float
    lon: float
    h: float = math.nan
    speed: float = math.nan
    course: float = math.nan
    hdop: float = math.nan
    vdop: float = math.nan
    differential: bool = False


_DEEPEST = 100  # elements inside one another; folders in folders of KML are a dozen


def elements(path: Path, ends: Iterable[str]) -> Iterator[tuple[str, ElementTree.Element]]:
    """Elements of some names as they close, by name without namespace; what they held is freed.

    Parameters
    ----------
    path : Path
    ends : iterable of str

    Raises
    ------
    FileFormatError
        If it is no XML, declares entities, which tracks have not, or has elements inside each other without an end.
    """
    if b"<!" in lines.check_file(path).replace(b"<!--", b"").replace(b"<![CDATA[", b""):
        raise FileFormatError("it declares a document type or entities, which no track needs; remove them", path)
    wanted, depth = set(ends), 0
    try:
        for event, element in ElementTree.iterparse(path, ("start", "end")):  # noqa: S314 - entities are refused above
            depth += 1 if event == "start" else -1
            if depth > _DEEPEST:
                raise FileFormatError(
                    f"its elements stand more than {_DEEPEST} deep in each other: it is no track", path
                )
            if event == "start":
                continue
            name = local_name(element)
            if name in wanted:
                yield name, element
                element.clear()
    except FileFormatError:
        raise
    except (ElementTree.ParseError, LookupError, ValueError) as error:  # the last two: a declared encoding of no name
        raise FileFormatError(f"it is not complete XML ({error}): it is damaged or was cut off", path) from error


def local_name(element: ElementTree.Element) -> str:
    """Name of an element without its namespace."""
    return str(element.tag).rpartition("}")[2]


def number(text: str | None, path: Path, what: str) -> float:
    """A number of a point, NaN where there is none."""
    if text is None or not text.strip():
        return math.nan
    if not lines.is_number(text.strip()):
        raise FileFormatError(f"expected a number as {what}, got {lines.shorten(text.strip(), 40)}", path)
    return float(text)


def recording_of(path: Path, points: list[Point], hints: ReadHints, what: str) -> Recording:
    """Recording of the points that have a time.

    Parameters
    ----------
    path : Path
    points : list of Point
    hints : ReadHints
        ``height``, ``geoid_separation``, ``sigma``, ``offset``, ``allow``, ``name``.
    what : str
        The format, ``"a GPX track"``.

    Raises
    ------
    FileFormatError
        If points have no times: such a track is a drawing.
    """
    parts.check_hints(path, hints, HINTS, what)
    timed = [p for p in points if p.time]
    if len(timed) < 2:
        raise FileFormatError(
            f"expected points with times, got {len(points)} points and {len(timed)} times: {what} without times is a "
            "drawing, no log of fixes",
            path,
        )
    notes: list[str] = []
    if len(timed) < len(points):
        notes.append(f"{len(points) - len(timed)} points without a time were left out.")
    ns, zoned, bad = dates.unix_ns(p.time for p in timed)
    if bad is not None:
        shown = lines.shorten(timed[bad].time, 40)
        raise FileFormatError(f"point {bad + 1}: expected a date such as 2024-05-01T12:00:00Z, got {shown}", path)
    if not zoned:
        notes.append("Dates without a zone are taken as UTC.")
    seconds, base = clock.from_unix({"t": ns}, None, notes, "unix")
    keep = parts.later(seconds["t"], what, path, notes)
    t = seconds["t"][keep]
    rows = np.array([[p.lat, p.lon, p.h, p.speed, p.course, p.hdop, p.vdop, p.differential] for p in timed])[keep].T
    lat, lon = rows[0] * units.DEG, rows[1] * units.DEG
    no_height = not np.isfinite(rows[2]).all()
    h = np.zeros_like(lat) if no_height else rows[2]
    values = {"t": t, "lat": lat, "lon": lon, "h": h}
    if hints.sigmas is None:
        hdop = np.where(rows[5] > 0.0, rows[5], 1.0)
        error = np.where(rows[7] > 0.0, _DIFFERENTIAL, _RANGE_ERROR)
        horizontal = error * hdop / np.sqrt(2.0)
        vertical = error * np.where(rows[6] > 0.0, rows[6], _VERTICAL * hdop)
        values |= {"sn": horizontal, "se": horizontal, "sd": vertical}
        notes.append(
            f"{what[0].upper()}{what[1:]} states no accuracy: 1-sigma is what phones and hand-held receivers typically "
            f"have, {np.median(horizontal):.2g} m north and east (hint sigma replaces it)."
        )
    if no_height:
        values["sd" if hints.sigmas is None else "h"] = np.full_like(lat, NO_HEIGHT if hints.sigmas is None else 0.0)
        notes.append("Points without a height: heights are zero" + (
            f" with a 1-sigma of {NO_HEIGHT:g} m." if hints.sigmas is None else "."
        ))  # fmt: skip
    values |= dict(zip(columns.DILUTION, rows[5:7], strict=True))
    if np.isfinite(rows[3]).any():
        speed = np.where(rows[3] >= 0.0, rows[3], np.nan)
        values |= velocities(t, (lat, lon), speed, rows[4] * units.DEG, (None, None), notes)
    return parts.assemble(path, {"gnss": Table(values, ellipsoidal=no_height)}, hints, base, notes)
