"""Tracks as GPX, for maps and phones; track points with times are read as fixes."""

from __future__ import annotations

from pathlib import Path
from xml.sax.saxutils import escape

import numpy as np

from schuler import files, units
from schuler.exceptions import FileFormatError, InputError
from schuler.recording.io import columns, lines, track_points
from schuler.recording.io.clock import to_unix
from schuler.recording.io.hints import ReadHints
from schuler.recording.io.track_points import Point
from schuler.recording.recording import Recording
from schuler.recording.series import GnssSeries
from schuler.recording.trajectory import Trajectory

_FIX = {1: "dgps", 2: "dgps", 3: "dgps", 4: "dgps", 5: "3d", 6: "3d"}
_NUMBERS = ("ele", "speed", "course", "hdop", "vdop")
_PAUSE = 5.0  # sample intervals; a longer one, if of 2 s at least, starts a new segment
_NAMESPACE = "http://www.topografix.com/GPX/1/1"


def sniff(head: bytes, path: Path) -> bool:
    """Whether a file is GPX."""
    return b"<gpx" in head and b"\x00" not in head[:1000]


def holds(path: Path) -> tuple[str, ...]:
    """Fixes, if there are track points with times."""
    head = lines.check_file(path)
    return ("gnss",) if b"<trkpt" in head and b"<time>" in head else ()


def read(path: Path, hints: ReadHints) -> Recording:
    """Fixes of the track points of a GPX file, of version 1.0 or 1.1.

    Parameters
    ----------
    path : Path
    hints : ReadHints
        ``height`` with ``geoid_separation``, since GPX counts from the sea; ``sigma``, since it states no accuracy;
        ``offset``, ``name``.

    Raises
    ------
    FileFormatError
        If it is damaged or has no track points with times.

    Notes
    -----
    ``hdop`` and ``vdop`` multiply a range error typical of the kind of fix; ``speed`` and ``course`` of GPX 1.0, or of
    extensions of these names, become velocities.
    """
    points: list[Point] = []
    for _, element in track_points.elements(path, ("trkpt",)):
        text = {track_points.local_name(e): (e.text or "").strip() for e in element.iter() if e is not element}
        if element.get("lat") is None or element.get("lon") is None:
            raise FileFormatError(f"point {len(points) + 1}: expected the attributes lat and lon", path)
        lat, lon = (track_points.number(element.get(name), path, name) for name in ("lat", "lon"))
        h, speed, course, hdop, vdop = (track_points.number(text.get(name), path, name) for name in _NUMBERS)
        better = text.get("fix") in ("dgps", "pps")
        points.append(Point(text.get("time", ""), lat, lon, h, speed, course, hdop, vdop, better))
    return track_points.recording_of(path, points, hints, "a GPX track")


def write(
    recording: Recording,
    path: Path,
    series: str | None = None,
    max_points: int = 20_000,
    geoid_separation: float | None = None,
) -> list[Path]:
    """Write the fixes or the reference as one track.

    Parameters
    ----------
    recording : Recording
    path : Path
    series : {"gnss", "reference"}, optional
        Default the fixes if there are any.
    max_points : int
        Every k-th point is written if there are more.
    geoid_separation : float, optional
        Height of the geoid above the ellipsoid at the place: GPX has heights above the sea. Without it heights are
        ellipsoidal, which the description says. [m]

    Returns
    -------
    list of Path
        The file.

    Raises
    ------
    InputError
        If there is no such series.

    Notes
    -----
    Degrees have nine decimals (0.1 mm), heights and seconds three. Times are UTC, and left out on a local clock. Fixes
    carry their kind, number of satellites and dilutions of precision.
    """
    if series not in (None, "gnss", "reference"):
        raise InputError(f"series: expected gnss or reference, got {series!r}")
    if max_points < 2:
        raise InputError(f"max_points: expected two or more, got {max_points}")
    reference = recording.reference
    source: Trajectory | GnssSeries
    if series == "gnss" or (series is None and (recording.gnss is not None or reference is None)):
        source, tags = recording.need_gnss(), _tags(recording)
    elif reference is not None:
        source, tags = reference, None
    else:
        raise InputError(f"{recording.metadata.name} has no {series} to write as a track")
    k = np.arange(0, len(source), -(-len(source) // max_points))
    t, llh = source.t[k], source.llh[k]
    lift = 0.0 if geoid_separation is None else geoid_separation
    times: list[str] = [""] * len(k)
    if recording.metadata.time.scale != "local":
        ms = np.round(to_unix(t, recording.metadata.time) / 1e6).astype(np.int64).astype("M8[ms]")
        times = [f"<time>{text}Z</time>" for text in np.datetime_as_string(ms).tolist()]
    step = np.diff(t)
    breaks: set[int] = (
        set() if not len(step) else set((np.flatnonzero(step > max(_PAUSE * np.median(step), 2.0)) + 1).tolist())
    )
    kind = "above the ellipsoid" if geoid_separation is None else "above mean sea level"
    with files.replacing(path) as temporary, temporary.open("w", encoding="utf-8", newline="\n") as stream:
        stream.write(
            f'<?xml version="1.0" encoding="UTF-8"?>\n<gpx version="1.1" creator="schuler" xmlns="{_NAMESPACE}">\n'
        )
        stream.write(f"<trk><name>{_text(recording.metadata.name)}</name><desc>Heights are {kind}.</desc><trkseg>\n")
        for i, (lat, lon, h) in enumerate(llh.tolist()):
            if i in breaks:
                stream.write("</trkseg><trkseg>\n")
            tail = "" if tags is None else tags[int(k[i])]
            place = f'lat="{lat / units.DEG:.9f}" lon="{lon / units.DEG:.9f}"'
            stream.write(f"<trkpt {place}><ele>{h - lift:.3f}</ele>{times[i]}{tail}</trkpt>\n")
        stream.write("</trkseg></trk>\n</gpx>\n")
    return [Path(path)]


def _tags(recording: Recording) -> list[str] | None:
    gnss = recording.need_gnss()
    quality = [""] * len(gnss)
    if gnss.quality is not None:
        quality = [f"<fix>{_FIX[q]}</fix>" if q in _FIX else "" for q in gnss.quality.tolist()]
    if gnss.n_satellites is not None:
        quality = [f"{a}<sat>{n}</sat>" for a, n in zip(quality, gnss.n_satellites.tolist(), strict=True)]
    for column, name in enumerate(columns.DILUTION if gnss.dop is not None else ()):
        dop = np.asarray(gnss.dop)[:, column].tolist()
        quality = [f"{a}<{name}>{d:.2f}</{name}>" if d > 0.0 else a for a, d in zip(quality, dop, strict=True)]
    return quality


def _text(text: str) -> str:
    """Text for XML, without the characters it cannot have."""
    return escape("".join(c if c.isprintable() else " " for c in text))
