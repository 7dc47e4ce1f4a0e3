"""KML as fixes: ``gx:Track`` with ``when`` and ``gx:coord``, or points with a ``TimeStamp``.

Lines without times are drawings and refused, as are the tracks that this package writes for maps, thinned and in
another order. Coordinates are longitude, latitude and, where it is meant, a height.
"""

from __future__ import annotations

import math
from pathlib import Path
from xml.etree import ElementTree

from schuler.exceptions import FileFormatError
from schuler.recording.io import lines, track_points
from schuler.recording.io.hints import ReadHints
from schuler.recording.io.track_points import Point
from schuler.recording.recording import Recording

_MOST = 64 * 1024  # where the first element of a document stands


def sniff(head: bytes, path: Path) -> bool:
    """Whether a file is KML."""
    return b"<kml" in head[:_MOST] and b"\x00" not in head[:1000]


def holds(path: Path) -> tuple[str, ...]:
    """Fixes, if there are times and it is not a track of ours."""
    head = lines.check_file(path)
    return () if _ours(head) or b"<when>" not in head else ("gnss",)


def read(path: Path, hints: ReadHints) -> Recording:
    """Fixes of a KML track.

    Parameters
    ----------
    path : Path
    hints : ReadHints
        ``height`` with ``geoid_separation``; ``sigma``, since KML states no accuracy; ``offset``, ``name``.

    Raises
    ------
    FileFormatError
        If it is damaged, has no times, or is a track of a solution of ours.
    """
    if _ours(lines.check_file(path)):
        raise FileFormatError(
            "it is a track that was written for maps, thinned and rounded: read the log, or solution.parquet beside it",
            path,
        )
    points: list[Point] = []
    for name, element in track_points.elements(path, ("Track", "Placemark")):
        points += _track(element, path) if name == "Track" else _placemark(element, path)
    return track_points.recording_of(path, points, hints, "a KML track")


def _ours(head: bytes) -> bool:
    return b"Heights are ellipsoidal." in head or b"Heights are above mean sea level (ellipsoidal less" in head


def _track(element: ElementTree.Element, path: Path) -> list[Point]:
    when = [(e.text or "").strip() for e in element if track_points.local_name(e) == "when"]
    coordinates = [(e.text or "").split() for e in element if track_points.local_name(e) == "coord"]
    if len(when) != len(coordinates):
        raise FileFormatError(f"a track has {len(when)} times and {len(coordinates)} points: it is damaged", path)
    grounded = _grounded(element)
    return [_point(time, at, path, grounded) for time, at in zip(when, coordinates, strict=True)]


def _placemark(element: ElementTree.Element, path: Path) -> list[Point]:
    inside = {track_points.local_name(e): e for e in element.iter()}
    if "Point" not in inside or "when" not in inside or "coordinates" not in inside:
        return []
    fields = (inside["coordinates"].text or "").strip().split(",")
    return [_point((inside["when"].text or "").strip(), fields, path, _grounded(inside["Point"]))]


def _grounded(element: ElementTree.Element) -> bool:
    """Whether heights are those of the ground, which is what a missing mode means."""
    modes = [(e.text or "").strip() for e in element if track_points.local_name(e) == "altitudeMode"]
    return not modes or modes[0] in ("clampToGround", "clampToSeaFloor", "relativeToGround")


def _point(time: str, fields: list[str], path: Path, grounded: bool) -> Point:
    if len(fields) not in (2, 3):
        raise FileFormatError(
            f"expected longitude, latitude and height of a point, got {' '.join(fields)[:40]!r}", path
        )
    lon, lat, *h = [track_points.number(field, path, "a coordinate") for field in fields]
    height = h[0] if h and not (grounded and h[0] == 0.0) else math.nan
    return Point(time, lat, lon, height)
