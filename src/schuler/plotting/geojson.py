"""Lines of GeoJSON files, such as extracts of OpenStreetMap, sorted into what a map shows differently."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from schuler.arrays import FloatArray
from schuler.exceptions import FileFormatError

_MAJOR = ("motorway", "trunk", "primary", "secondary", "motorway_link", "trunk_link", "primary_link")


def read_geojson(path: Path) -> tuple[tuple[tuple[str, FloatArray], ...], str]:
    """Lines and outlines of a GeoJSON file, each with its role, and whom the file names as its source.

    Returns
    -------
    shapes : tuple of (role, points)
        Points (n, 2): longitude, latitude. [deg]
    credit : str

    Raises
    ------
    FileFormatError
        If it is not GeoJSON in degrees, or has no lines.
    """
    try:
        data = json.loads(path.read_text(encoding="utf-8"))
    except (ValueError, RecursionError) as error:
        raise FileFormatError(
            f"background: expected GeoJSON, longitude and latitude in degrees; this is not JSON: {error}", path
        ) from None
    if not isinstance(data, dict) or "type" not in data:
        raise FileFormatError(
            'background: expected GeoJSON, an object with a "type"; of Overpass results take the GeoJSON export', path
        )
    try:
        lines = [(_role(tags), kind, points) for tags, kind, x in _geometries(data) for points in _lines(kind, x)]
    except (TypeError, AttributeError, RecursionError):
        raise FileFormatError(
            "background: expected GeoJSON; its features are of other kinds or nested too deeply", path
        ) from None
    shapes = []
    for role, kind, points in lines:
        try:
            lonlat = np.array([p[:2] for p in points], dtype=np.float64).reshape(-1, 2)
        except (TypeError, ValueError, IndexError):
            raise FileFormatError(
                f"background: coordinates of a {kind} are not lists of [longitude, latitude]", path
            ) from None
        if len(lonlat) > 1:
            shapes.append((role, lonlat))
    if not shapes:
        raise FileFormatError("background: expected lines or polygons, found none", path)
    extreme = max(float(np.abs(p[:, 0]).max()) for _, p in shapes), max(float(np.abs(p[:, 1]).max()) for _, p in shapes)
    if not (extreme[0] <= 360.0 and extreme[1] <= 90.0):
        raise FileFormatError(
            f"background: expected longitude and latitude in degrees, got numbers up to {max(extreme):.0f}; "
            "convert with ogr2ogr -t_srs EPSG:4326",
            path,
        )
    credit = data.get("attribution") or data.get("copyright") or ""
    return tuple(shapes), str(credit)


def _geometries(data: dict[str, Any], tags: dict[str, Any] | None = None) -> Iterator[tuple[dict[str, Any], str, Any]]:
    """Tags, type and coordinates of everything in nested GeoJSON."""
    tags = tags or {}
    kind = data.get("type")
    if kind == "FeatureCollection":
        for feature in data.get("features") or []:
            yield from _geometries(feature, tags)
    elif kind == "Feature":
        if data.get("geometry"):
            properties = data.get("properties") or {}
            yield from _geometries(data["geometry"], {**properties, **(properties.get("tags") or {})})
    elif kind == "GeometryCollection":
        for geometry in data.get("geometries") or []:
            yield from _geometries(geometry, tags)
    elif isinstance(kind, str) and "coordinates" in data:
        yield tags, kind, data["coordinates"]


def _lines(kind: str, coordinates: Any) -> list[Any]:
    """Lists of points of a geometry; of points none."""
    if kind == "LineString":
        return [coordinates]
    if kind in ("MultiLineString", "Polygon"):
        return list(coordinates)
    if kind == "MultiPolygon":
        return [ring for polygon in coordinates for ring in polygon]
    return []


def _role(tags: dict[str, Any]) -> str:
    if "highway" in tags:
        return "road_major" if tags["highway"] in _MAJOR else "road"
    if "waterway" in tags or tags.get("natural") in ("water", "coastline"):
        return "water"
    if "building" in tags:
        return "building"
    return "land" if "landuse" in tags or "leisure" in tags or "natural" in tags else "road"
