"""A map behind the track, of the user's own: roads as GeoJSON, a georeferenced picture, or tiles. No network.

Without one the track is drawn over lines of round latitude and longitude.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from schuler import frames, units
from schuler.arrays import FloatArray
from schuler.exceptions import InputError
from schuler.files import note_input
from schuler.plotting.figure import ByteArray, Item, Line, Markers, Picture, Text
from schuler.plotting.geojson import read_geojson
from schuler.plotting.georeference import Georeference, read_picture
from schuler.plotting.tiles import Tiles, mosaic, read_mbtiles

_VECTOR = (".geojson", ".json")
_PICTURES = (".png", ".jpg", ".jpeg", ".tif", ".tiff")
_EXPECTED = (
    "expected a GeoJSON file (.geojson, longitude and latitude in degrees), or a picture with its world file beside it "
    "(.png with .pgw, .jpg with .jgw), a GeoTIFF, or raster tiles (.mbtiles)"
)
_TILES = ".mbtiles"
_PIXELS = 1000  # across the picture that is drawn
_MARGIN = 1.3  # how far beyond the panel's limits a map is drawn: axes of equal scale may show more than their limits
_STEPS = (1.0, 2.0, 5.0, 10.0)


@dataclass(frozen=True, eq=False)
class Backdrop:
    """A map that was read.

    Attributes
    ----------
    name : str
        Name of the file.
    credit : str
        Whom the file itself names as its source; OpenStreetMap asks to be named.
    shapes : tuple of (role, points)
        Lines and outlines, points (n, 2) longitude, latitude [deg].
    pixels : ndarray of uint8, shape (h, w, 4), optional
    georeference : Georeference, optional
        Where the pixels are.
    tiles : Tiles, optional
    """

    name: str
    credit: str = ""
    shapes: tuple[tuple[str, FloatArray], ...] = field(default=(), repr=False)
    pixels: ByteArray | None = field(default=None, repr=False)
    georeference: Georeference | None = None
    tiles: Tiles | None = field(default=None, repr=False)


@dataclass(frozen=True)
class Window:
    """Square shown by a panel, in metres east and north of the track's origin."""

    origin_llh: FloatArray
    east: float
    north: float
    half: float

    def box(self, factor: float = _MARGIN) -> tuple[float, float, float, float]:
        """West, east, south, north limits, larger by a factor. [m]"""
        h = factor * self.half
        return self.east - h, self.east + h, self.north - h, self.north + h


def read_backdrop(path: Path | str) -> Backdrop:
    """Read a map.

    Parameters
    ----------
    path : Path or str
        GeoJSON (RFC 7946: degrees in WGS 84, longitude first), or a picture: PNG or JPEG with a world file (``.pgw``,
        ``.jgw``, ``.wld``, or the full name with a ``w``), or GeoTIFF. Pictures in longitude and latitude, Web
        Mercator or UTM. MBTiles of pictures.

    Raises
    ------
    InputError, FileFormatError
        If the file is missing or is not one of these.
    MissingExtraError
        For a picture without Pillow (which comes with matplotlib, extra ``plot``).

    Notes
    -----
    GeoJSON is drawn as lines: roads by the ``highway`` tag of OpenStreetMap, water by ``waterway`` or ``natural``,
    buildings by ``building``, everything else alike. Points are left out.
    """
    path = Path(path)
    note_input(path)
    if not path.is_file():
        raise InputError(f"background: {path} is no file; {_EXPECTED}")
    suffix = path.suffix.lower()
    if suffix in _VECTOR:
        shapes, credit = read_geojson(path)
        return Backdrop(path.name, credit, shapes)
    if suffix in _PICTURES:
        pixels, georeference = read_picture(path)
        return Backdrop(path.name, pixels=pixels, georeference=georeference)
    if suffix == _TILES:
        tiles = read_mbtiles(path)
        return Backdrop(path.name, tiles.credit, tiles=tiles)
    raise InputError(f"background: {_EXPECTED}; got {path.name}")


def backdrop_items(backdrop: Backdrop, window: Window) -> list[Item]:
    """Parts of a map that lie in a window, in metres east and north.

    Raises
    ------
    InputError
        If no part of it does; the message has both places.
    """
    if backdrop.pixels is not None and backdrop.georeference is not None:
        return [_picture(backdrop.pixels, backdrop.georeference, window, backdrop.name)]
    west, east, south, north = window.box()
    if backdrop.tiles is not None:
        corners = _llh(np.array([[e, n] for e in (west, east) for n in (south, north)]), window.origin_llh)
        pixels, georeference = mosaic(backdrop.tiles, corners[:, 1], corners[:, 0], _PIXELS)
        return [_picture(pixels, georeference, window, backdrop.name)]
    parts: dict[str, list[FloatArray]] = {}
    for role, lonlat in backdrop.shapes:
        en = _east_north(lonlat, window.origin_llh)
        if en[:, 0].max() < west or en[:, 0].min() > east or en[:, 1].max() < south or en[:, 1].min() > north:
            continue
        inside = clipped(en, (west, east, south, north))
        if len(inside):
            parts.setdefault(role, []).append(_thinned(inside, window.half / 1500.0))
    if not parts:
        everything = np.concatenate([points for _, points in backdrop.shapes])
        low, high = everything.min(axis=0), everything.max(axis=0)
        raise InputError(
            f"background: nothing of {backdrop.name} lies near the track, which is at {_place(window.origin_llh)}; "
            f"the file covers longitude {low[0]:.4f} to {high[0]:.4f}, latitude {low[1]:.4f} to {high[1]:.4f} deg"
        )
    items: list[Item] = []
    for role in ("land", "building", "water", "road", "road_major"):
        if role in parts:
            gap = np.full((1, 2), np.nan)
            xy = np.concatenate([p for part in parts[role] for p in (part, gap)])
            items.append(Line(xy[:, 0], xy[:, 1], role))
    return items


def graticule(window: Window) -> list[Item]:
    """Lines of round latitude and longitude with their values at the left and the upper edge of the window."""
    west, east, south, north = window.box(1.0)
    corners = np.array([[west, south], [east, south], [west, north], [east, north]])
    llh = _llh(corners, window.origin_llh)
    low, high = llh[:, :2].min(axis=0) / units.DEG, llh[:, :2].max(axis=0) / units.DEG
    items: list[Item] = []
    for axis in (0, 1):
        # one to three lines are enough to place the track
        step, digits = _round_step((high[axis] - low[axis]) / 3.0)
        for value in step * np.arange(np.ceil(low[axis] / step), np.floor(high[axis] / step) + 0.5):
            along = np.linspace(low[1 - axis], high[1 - axis], 9)
            fixed = np.full(9, value)
            lonlat = np.column_stack((along, fixed) if axis == 0 else (fixed, along))
            en = clipped(_east_north(lonlat, window.origin_llh), window.box(1.0))
            if not len(en):
                continue
            items.append(Line(en[:, 0], en[:, 1], "graticule"))
            letter = ("NS" if axis == 0 else "EW")[int(value < 0.0)]
            # latitudes are written at the left edge; longitudes at the upper one, away from the scale bar
            first = en[np.nanargmin(en[:, 0])] if axis == 0 else en[np.nanargmax(en[:, 1])] - (0.0, 0.06 * window.half)
            if first[0] > window.east + 0.7 * window.half:
                continue  # its text would stand out of the frame
            items.append(Text(float(first[0]), float(first[1]), f"{abs(value):.{digits}f}° {letter}", "right"))
    return items


def north_arrow(window: Window) -> list[Item]:
    """A small arrow with an N in the upper right corner."""
    x, y, length = window.east + 0.93 * window.half, window.north + 0.76 * window.half, 0.13 * window.half
    return [
        Line(np.array([x, x]), np.array([y, y + length]), "arrow"),
        Markers(np.array([x]), np.array([y + length]), "arrow"),
        Text(x, y + length, "N"),
    ]


def clipped(xy: FloatArray, box: tuple[float, float, float, float]) -> FloatArray:
    """The parts of a line inside a rectangle, with a NaN row between them.

    Parameters
    ----------
    xy : ndarray, shape (n, 2)
    box : (west, east, south, north)

    Returns
    -------
    ndarray, shape (m, 2)
        Empty if no part of it is inside.

    References
    ----------
    Liang and Barsky (1984), ACM Trans. Graphics 3(1).
    """
    a, d = xy[:-1], np.diff(xy, axis=0)
    t0, t1 = np.zeros(len(a)), np.ones(len(a))
    with np.errstate(divide="ignore", invalid="ignore"):
        for axis, (low, high) in enumerate((box[:2], box[2:])):
            enter, leave = (low - a[:, axis]) / d[:, axis], (high - a[:, axis]) / d[:, axis]
            enter, leave = np.minimum(enter, leave), np.maximum(enter, leave)
            still = d[:, axis] == 0.0
            within = (a[:, axis] >= low) & (a[:, axis] <= high)
            enter, leave = (np.where(still, np.where(within, v, w), x) for v, w, x in ((0, 2, enter), (1, -1, leave)))
            t0, t1 = np.maximum(t0, enter), np.minimum(t1, leave)
    keep = np.flatnonzero(t0 < t1)
    out: list[FloatArray] = []
    last = -2
    for k in keep.tolist():
        if k != last + 1 or t0[k] > 0.0:  # not where the one before ended
            if out:
                out.append(np.full(2, np.nan))
            out.append(a[k] + t0[k] * d[k])
        out.append(a[k] + t1[k] * d[k])
        last = k
    return np.array(out).reshape(-1, 2)


def _picture(pixels: ByteArray, georeference: Georeference, window: Window, name: str) -> Picture:
    """The part of a picture in the window, turned north up and to metres by looking up every point of a grid."""
    west, east, south, north = window.box()
    x, y = (low + (np.arange(_PIXELS) + 0.5) * (high - low) / _PIXELS for low, high in ((west, east), (south, north)))
    grid = np.column_stack([g.ravel() for g in np.meshgrid(x, y[::-1])])
    llh = _llh(grid, window.origin_llh)
    column, row = georeference.pixel(llh[:, 1], llh[:, 0], window.origin_llh, pixels.shape)
    inside = (column >= 0) & (column < pixels.shape[1]) & (row >= 0) & (row < pixels.shape[0])
    if not inside.any():
        raise InputError(
            f"background: nothing of {name} lies near the track, which is at {_place(window.origin_llh)}; "
            f"the picture is read as {georeference.describe(window.origin_llh, pixels.shape)}"
        )
    # a picture finer than the grid is averaged over what falls into one of its points, or it would glitter
    step = float(np.median(np.abs(np.diff(column.reshape(_PIXELS, _PIXELS), axis=1))))
    every = max(1, int(step))
    small = pixels
    if every > 1:
        h, w = (n // every * every for n in pixels.shape[:2])
        small = pixels[:h, :w].reshape(h // every, every, w // every, every, 4).mean(axis=(1, 3)).astype(np.uint8)
    k, j = (
        np.minimum((v[inside] // every).astype(np.int64), n - 1)
        for v, n in ((row, len(small)), (column, small.shape[1]))
    )
    out = np.zeros((len(grid), 4), dtype=np.uint8)
    out[inside] = small[k, j]
    return Picture(west, east, south, north, out.reshape(_PIXELS, _PIXELS, 4))


def _east_north(lonlat: FloatArray, origin: FloatArray) -> FloatArray:
    llh = np.column_stack((lonlat[:, 1] * units.DEG, lonlat[:, 0] * units.DEG, np.full(len(lonlat), origin[2])))
    ned = frames.ned_from_ecef(frames.ecef_from_llh(llh), origin)
    return ned[:, [1, 0]]


def _llh(east_north: FloatArray, origin: FloatArray) -> FloatArray:
    ned = np.column_stack((east_north[:, 1], east_north[:, 0], np.zeros(len(east_north))))
    return frames.llh_from_ecef(frames.ecef_from_ned(ned, origin))


def _thinned(xy: FloatArray, least: float) -> FloatArray:
    """Without points closer than can be seen to the one kept before them; the last of a part stays."""
    keep = np.ones(len(xy), dtype=bool)
    last = xy[0]
    for k in range(1, len(xy) - 1):
        near = abs(xy[k, 0] - last[0]) < least and abs(xy[k, 1] - last[1]) < least
        if near and not np.isnan(xy[k + 1, 0]):
            keep[k] = False
        else:
            last = xy[k]
    return xy[keep]


def _round_step(size: float) -> tuple[float, int]:
    """Smallest of 1, 2, 5 times a power of ten not below a size, and the decimals it needs."""
    power = int(np.floor(np.log10(size)))
    factor = min(f for f in _STEPS if f * 10.0**power >= size * (1.0 - 1e-9))
    power, factor = (power + 1, 1.0) if factor == 10.0 else (power, factor)
    return factor * 10.0**power, max(0, -power)


def _place(llh: FloatArray) -> str:
    return f"longitude {llh[1] / units.DEG:.4f}, latitude {llh[0] / units.DEG:.4f} deg"
