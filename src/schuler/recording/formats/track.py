"""Tracks for maps: KML with time stamps, and GeoJSON."""

from __future__ import annotations

import datetime as dt
import itertools
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any, Literal
from xml.etree import ElementTree

import numpy as np

from schuler import files, units
from schuler.arrays import ArrayLike, FloatArray, IntArray, as_floats
from schuler.exceptions import InputError
from schuler.recording.io import own
from schuler.recording.recording import Recording
from schuler.recording.series import QUALITY, GnssSeries
from schuler.recording.trajectory import Trajectory
from schuler.timebase import TimeBase, calendar, leap_second_notes, leap_seconds

Colour = Literal["quality", "sigma"]

_KML, _GX = "http://www.opengis.net/kml/2.2", "http://www.google.com/kml/ext/2.2"
_PLAIN, _OUTAGE = ("track", "#1f78b4"), ("outage", "#e31a1c")
_QUALITY_COLOURS = {1: "#33a02c", 2: "#ff7f00", 3: "#6a3d9a", 4: "#1f78b4", 5: "#b15928", 6: "#a6cee3", 7: "#999999"}
# horizontal 1-sigma up to which a class reaches [m]
_SIGMA_CLASSES = ((0.05, "#33a02c"), (0.5, "#b2df8a"), (5.0, "#ff7f00"), (np.inf, "#b15928"))


@dataclass(frozen=True, slots=True)
class _Leg:
    """A run of points drawn alike; it ends on the first point of the next one, so that lines join."""

    label: str
    colour: str
    rows: slice


def write_kml(
    path: Path | str,
    track: Trajectory | GnssSeries,
    *,
    time: TimeBase | None = None,
    name: str = "track",
    colour: Colour | None = None,
    sigma: ArrayLike | None = None,
    outages: Iterable[tuple[float, float]] = (),
    geoid_separation: float = 0.0,
    max_points: int = 20_000,
) -> Path:
    """Write a track as KML: a ``gx:Track`` that can be played, and lines.

    Parameters
    ----------
    path : Path or str
    track : Trajectory or GnssSeries
    time : TimeBase, optional
        Meaning of the times; on the GPS scale the playable track is written, in UTC.
    name : str
    colour : {"quality", "sigma"}, optional
        Colour lines by solution quality or by horizontal 1-sigma.
    sigma : array_like, shape (n,), optional
        Horizontal 1-sigma of a trajectory, for ``colour="sigma"``. [m]
    outages : iterable of (float, float)
        Start and stop of spans drawn as outages. [s]
    geoid_separation : float
        Taken off the ellipsoidal heights, since viewers of KML count from sea level. [m]
    max_points : int
        Longer tracks are thinned evenly; the description says so.

    Returns
    -------
    Path
        The file.

    Raises
    ------
    InputError
        If the colouring asked for needs what the track has not.
    """
    t, llh, legs, thinned = _prepare(track, colour, sigma, outages, max_points)
    heights = (
        "ellipsoidal"
        if geoid_separation == 0.0
        else f"above mean sea level (ellipsoidal less a geoid separation of {geoid_separation:g} m)"
    )
    llh = llh - (0.0, 0.0, geoid_separation)
    ElementTree.register_namespace("", _KML)
    ElementTree.register_namespace("gx", _GX)
    root = ElementTree.Element(f"{{{_KML}}}kml")
    document = _child(root, "Document")
    _child(document, "name", name)
    base = time or TimeBase()
    with leap_second_notes() as late:
        moments = _utc_texts(t, base) if base.scale == "gps" else []
    notes = " ".join([f"{base.describe()}. Heights are {heights}. {thinned}".strip(), *late])
    _child(document, "description", notes)
    for label, shade in dict.fromkeys((leg.label, leg.colour) for leg in legs):
        style = _child(document, "Style", id=_identifier(label))
        line = _child(style, "LineStyle")
        _child(line, "color", f"ff{shade[5:7]}{shade[3:5]}{shade[1:3]}")  # KML counts alpha, blue, green, red
        _child(line, "width", "4" if label == _OUTAGE[0] else "2")
    if base.scale == "gps":
        placemark = _child(document, "Placemark")
        _child(placemark, "name", f"{name} (time)")
        moving = ElementTree.SubElement(placemark, f"{{{_GX}}}Track")
        _child(moving, "altitudeMode", "absolute")
        for text in moments:
            _child(moving, "when", text)
        for lon, lat, h in _lon_lat_h(llh):
            ElementTree.SubElement(moving, f"{{{_GX}}}coord").text = f"{lon:.9f} {lat:.9f} {h:.3f}"
    for leg in legs:
        placemark = _child(document, "Placemark")
        _child(placemark, "name", leg.label)
        _child(placemark, "description", _span(t, leg))
        _child(placemark, "styleUrl", f"#{_identifier(leg.label)}")
        points = _lon_lat_h(llh[leg.rows])
        shape = _child(placemark, "LineString" if len(points) > 1 else "Point")
        _child(shape, "altitudeMode", "absolute")
        _child(shape, "coordinates", " ".join(f"{lon:.9f},{lat:.9f},{h:.3f}" for lon, lat, h in points))
    ElementTree.indent(root)
    with files.replacing(path) as temporary:
        ElementTree.ElementTree(root).write(temporary, encoding="utf-8", xml_declaration=True)
    return Path(path)


def write_geojson(
    path: Path | str,
    track: Trajectory | GnssSeries,
    *,
    time: TimeBase | None = None,
    name: str = "track",
    colour: Colour | None = None,
    sigma: ArrayLike | None = None,
    outages: Iterable[tuple[float, float]] = (),
    max_points: int = 20_000,
) -> Path:
    """Write a track as GeoJSON (RFC 7946): one feature per run of points of one kind, cut at the antimeridian.

    Parameters
    ----------
    path, track, time, name, colour, sigma, outages, max_points
        See :func:`write_kml`. Heights are ellipsoidal.

    Returns
    -------
    Path
        The file.

    Raises
    ------
    InputError
        If the colouring asked for needs what the track has not.
    """
    t, llh, legs, thinned = _prepare(track, colour, sigma, outages, max_points)
    base = time or TimeBase()
    features: list[dict[str, Any]] = []
    with leap_second_notes() as late:
        for leg in legs:
            properties: dict[str, Any] = {"name": name, "kind": leg.label, "stroke": leg.colour}
            properties |= {"start_s": float(t[leg.rows][0]), "stop_s": float(t[leg.rows][-1])}
            if base.scale == "gps":
                properties["start_utc"], properties["stop_utc"] = _utc_texts(t[leg.rows][[0, -1]], base)
            features.append({"type": "Feature", "properties": properties, "geometry": _geometry(llh[leg.rows])})
    about = {"time": base.describe(), "heights": "ellipsoidal [m]", "note": " ".join([thinned, *late]).strip()}
    document = {"type": "FeatureCollection", "name": name, "about": about, "features": features}
    return files.write_text(path, own.to_json(document, indent=1) + "\n")


def write_kml_of(
    recording: Recording,
    path: Path | str,
    *,
    series: str | None = None,
    colour: Colour | None = None,
    outages: Iterable[tuple[float, float]] = (),
    geoid_separation: float = 0.0,
    max_points: int = 20_000,
) -> list[Path]:
    """:func:`write_kml` of the GNSS or, without one or with ``series="reference"``, the reference of a recording."""
    track, about = _track_of(recording, series)
    return [
        write_kml(
            path,
            track,
            **about,
            colour=colour,
            outages=outages,
            geoid_separation=geoid_separation,
            max_points=max_points,
        )
    ]


def write_geojson_of(
    recording: Recording,
    path: Path | str,
    *,
    series: str | None = None,
    colour: Colour | None = None,
    outages: Iterable[tuple[float, float]] = (),
    max_points: int = 20_000,
) -> list[Path]:
    """:func:`write_geojson` of a recording; see :func:`write_kml_of` for which series."""
    track, about = _track_of(recording, series)
    return [write_geojson(path, track, **about, colour=colour, outages=outages, max_points=max_points)]


def _track_of(recording: Recording, series: str | None) -> tuple[Trajectory | GnssSeries, dict[str, Any]]:
    about = {"time": recording.metadata.time, "name": recording.metadata.name}
    if series not in (None, "gnss", "reference"):
        raise InputError(f"series: expected 'gnss' or 'reference', got {series!r}")
    for name, track in (("gnss", recording.gnss), ("reference", recording.reference)):
        if track is not None and series in (None, name):
            return track, about
    raise InputError(f"{recording.metadata.name} has no {series or 'GNSS series or reference'} to draw")


def _prepare(
    track: Trajectory | GnssSeries,
    colour: Colour | None,
    sigma: ArrayLike | None,
    outages: Iterable[tuple[float, float]],
    max_points: int,
) -> tuple[FloatArray, FloatArray, list[_Leg], str]:
    """Thinned times and positions, the legs to draw, and a sentence on the thinning."""
    if max_points < 2:
        raise InputError(f"max_points: expected at least 2, got {max_points}")
    n = len(track)
    step = -(-n // max_points)
    rows = np.unique(np.append(np.arange(0, n, step), n - 1))
    t, llh = track.t[rows], track.llh[rows]
    kinds, styles = _kinds(track, colour, sigma)
    kinds = kinds[rows]
    for start, stop in outages:
        if not start < stop:
            raise InputError(f"outages: expected start before stop, got {start} and {stop}")
        kinds = np.where((t >= start) & (t <= stop), -1, kinds)
    starts = [0, *(np.flatnonzero(np.diff(kinds)) + 1).tolist()]
    stops = [*(k + 1 for k in starts[1:]), len(t)]
    if len(starts) > 1 and starts[-1] == len(t) - 1:
        starts, stops = starts[:-1], stops[:-1]  # the leg before ends on the last point
    legs = [
        _Leg(*(_OUTAGE if kinds[a] == -1 else styles[int(kinds[a])]), slice(a, b))
        for a, b in zip(starts, stops, strict=True)
    ]
    return t, llh, legs, f"Every {step}th of {n} points is drawn." if step > 1 else ""


def _kinds(
    track: Trajectory | GnssSeries, colour: Colour | None, sigma: ArrayLike | None
) -> tuple[IntArray, dict[int, tuple[str, str]]]:
    """Class of each point, and the label and colour of each class."""
    if colour is None:
        return np.zeros(len(track), dtype=np.int64), {0: _PLAIN}
    if colour == "quality":
        if not isinstance(track, GnssSeries) or track.quality is None:
            raise InputError("colour='quality' needs a GNSS series with quality")
        kinds = {k: (label, _QUALITY_COLOURS[k]) for k, label in QUALITY.items()}
        other = {int(k): (f"quality {k}", "#999999") for k in np.unique(track.quality) if int(k) not in kinds}
        return track.quality, {**kinds, **other}
    if colour != "sigma":
        raise InputError(f"colour: expected 'quality' or 'sigma', got {colour!r}")
    if sigma is not None:
        horizontal = as_floats(sigma, "sigma", (len(track),))
    elif isinstance(track, GnssSeries):
        horizontal = np.sqrt(track.cov_r_n[:, 0, 0] + track.cov_r_n[:, 1, 1])
    else:
        raise InputError("colour='sigma' of a trajectory needs its horizontal 1-sigma (argument sigma)")
    limits = [limit for limit, _ in _SIGMA_CLASSES]
    labels = [f"1-sigma up to {limit:g} m" for limit in limits[:-1]] + [f"1-sigma above {limits[-2]:g} m"]
    styles = {k: (labels[k], shade) for k, (_, shade) in enumerate(_SIGMA_CLASSES)}
    return np.searchsorted(limits[:-1], horizontal).astype(np.int64), styles


def _lon_lat_h(llh: FloatArray) -> list[list[float]]:
    """Rounded longitude and latitude in degrees, and height; longitudes in (-180, 180]."""
    lon = np.round(llh[:, 1] / units.DEG, 9)
    lon = np.where(lon <= -180.0, lon + 360.0, lon)
    lat = np.round(llh[:, 0] / units.DEG, 9)
    points: list[list[float]] = np.stack((lon, lat, np.round(llh[:, 2], 4)), axis=1).tolist()
    return points


def _geometry(llh: FloatArray) -> dict[str, Any]:
    points = _lon_lat_h(llh)
    if len(points) == 1:
        return {"type": "Point", "coordinates": points[0]}
    parts = [part for part in _cut(points) if len(part) > 1]
    if len(parts) == 1:
        return {"type": "LineString", "coordinates": parts[0]}
    return {"type": "MultiLineString", "coordinates": parts}


def _cut(points: Sequence[list[float]]) -> Iterator[list[list[float]]]:
    """Parts of a line that do not cross the antimeridian; each cut ends at +-180 and goes on at -+180."""
    part = [points[0]]
    for a, b in itertools.pairwise(points):
        if abs(b[0] - a[0]) > 180.0:
            side = 180.0 if a[0] > 0.0 else -180.0
            span = b[0] + 2.0 * side - a[0]
            share = (side - a[0]) / span if span else 0.0
            crossing = [round(a[k] + share * (b[k] - a[k]), 9) for k in (1, 2)]
            # RFC 7946 closes both halves on the line itself, hence the one -180
            yield [*part, [side, *crossing]]
            part = [[-side, *crossing]]
        part.append(b)
    yield part


def _utc_texts(t: FloatArray, base: TimeBase) -> list[str]:
    """UTC of times on the GPS scale, to the millisecond."""
    texts, leap = [], cache(leap_seconds)  # one day has thousands of times
    for seconds in t.tolist():
        moment = calendar(base.epoch_gps_s + seconds)
        utc = moment - dt.timedelta(seconds=leap(moment.date()))
        if utc.date() != moment.date():
            utc = moment - dt.timedelta(seconds=leap(utc.date()))
        texts.append(f"{utc.isoformat(timespec='milliseconds')}Z")
    return texts


def _span(t: FloatArray, leg: _Leg) -> str:
    return f"{t[leg.rows][0]:.3f}..{t[leg.rows][-1]:.3f} s"


def _child(parent: ElementTree.Element, tag: str, text: str | None = None, **attributes: str) -> ElementTree.Element:
    element = ElementTree.SubElement(parent, f"{{{_KML}}}{tag}", attributes)
    element.text = text
    return element


def _identifier(label: str) -> str:
    return "".join(c if c.isalnum() else "-" for c in label)
