"""Maps in square tiles of Web Mercator, as MBTiles files hold them: those of an area put together to one picture."""

from __future__ import annotations

import io
import math
import sqlite3
from collections.abc import Callable
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from typing import TypeAlias

import numpy as np

from schuler.arrays import FloatArray
from schuler.earth import WGS84
from schuler.exceptions import FileFormatError, MissingExtraError
from schuler.plotting.figure import ByteArray
from schuler.plotting.georeference import Georeference, project

#: Picture of a tile, or None where the map has none: zoom, column from the west, row from the north.
Tile: TypeAlias = Callable[[int, int, int], bytes | None]
_SIDE = 256  # pixels of a tile as its map means it; some are drawn with more
_MOST = 24  # tiles of a picture
_CRS = "Web Mercator"
_WORLD = 2.0 * math.pi * WGS84.a  # side of the square that is the world [m]


@dataclass(frozen=True)
class Tiles:
    """A map in tiles.

    Attributes
    ----------
    name, credit : str
        Of the map, and whom it names as its source.
    zooms : (int, int)
        Least and largest zoom; the world is one tile at zoom 0.
    tile : callable
    """

    name: str
    credit: str
    zooms: tuple[int, int]
    tile: Tile


def read_mbtiles(path: Path) -> Tiles:
    """Map of an MBTiles file with pictures as tiles.

    Raises
    ------
    FileFormatError
        If it is none, or holds vector tiles.

    References
    ----------
    MBTiles specification 1.3: rows are counted from the south.
    """
    try:
        with closing(_opened(path)) as file:
            stated = {str(name): str(value) for name, value in file.execute("SELECT name, value FROM metadata")}
            least, largest = file.execute("SELECT min(zoom_level), max(zoom_level) FROM tiles").fetchone()
    except sqlite3.Error as error:
        raise FileFormatError(f"background: expected MBTiles, a database of tiles ({error})", path) from None
    if least is None or stated.get("format", "png") not in ("png", "jpg", "jpeg", "webp"):
        raise FileFormatError(
            f"background: expected pictures as tiles (png, jpg, webp), got {stated.get('format', 'none')}; export "
            "the map as a raster", path,
        )  # fmt: skip

    def tile(zoom: int, column: int, row: int) -> bytes | None:
        with closing(_opened(path)) as file:
            given = file.execute(
                "SELECT tile_data FROM tiles WHERE zoom_level = ? AND tile_column = ? AND tile_row = ?",
                (zoom, column, (1 << zoom) - 1 - row),
            ).fetchone()
        return None if given is None else bytes(given[0])

    return Tiles(path.name, stated.get("attribution", ""), (int(least), int(largest)), tile)


def mosaic(tiles: Tiles, lon: FloatArray, lat: FloatArray, pixels: int) -> tuple[ByteArray, Georeference]:
    """Picture of the area of some places, as fine as it may be.

    Parameters
    ----------
    tiles : Tiles
    lon, lat : ndarray, shape (n,)
        Places; the picture has all of the rectangle around them. [rad]
    pixels : int
        Across the area that are enough.

    Returns
    -------
    pixels : ndarray of uint8, shape (h, w, 4)
        Transparent where the map has no tile.
    georeference : Georeference

    Raises
    ------
    FileFormatError
        If a tile is no picture.
    MissingExtraError
        Without Pillow (extra ``plot``).
    """
    x, y = project(_CRS, lon, lat)
    left, top = (x.min() / _WORLD + 0.5, 0.5 - y.max() / _WORLD)
    right, bottom = (x.max() / _WORLD + 0.5, 0.5 - y.min() / _WORLD)
    zoom = tiles.zooms[0]
    for finer in range(tiles.zooms[0] + 1, tiles.zooms[1] + 1):
        area = _area(left, right, top, bottom, finer)
        fine = (right - left) * 2**zoom * _SIDE >= pixels
        if fine or len(area[0]) * len(area[1]) > _MOST:
            break
        zoom = finer
    columns, rows = _area(left, right, top, bottom, zoom)
    given = {(i, j): tiles.tile(zoom, i, j) for j in rows for i in columns}
    side = _SIDE
    out: ByteArray = np.zeros((len(rows) * side, len(columns) * side, 4), dtype=np.uint8)
    for (i, j), data in given.items():
        if data is not None:
            v, u = (j - rows[0]) * side, (i - columns[0]) * side
            out[v : v + side, u : u + side] = _picture(data, tiles.name)
    scale = _WORLD / (2**zoom * side)
    corner = (columns[0] / 2**zoom - 0.5) * _WORLD, (0.5 - rows[0] / 2**zoom) * _WORLD
    return out, Georeference((scale, 0.0, corner[0], 0.0, -scale, corner[1]), _CRS)


def _area(left: float, right: float, top: float, bottom: float, zoom: int) -> tuple[range, range]:
    """Columns and rows of the tiles of an area in shares of the world."""
    n = 2**zoom
    column, row = ((max(int(a * n), 0), min(int(b * n), n - 1)) for a, b in ((left, right), (top, bottom)))
    return range(column[0], column[1] + 1), range(row[0], row[1] + 1)


def _picture(data: bytes, name: str) -> ByteArray:
    try:
        from PIL import Image, UnidentifiedImageError
    except ImportError:
        raise MissingExtraError("Pillow", "plot", "a picture as background") from None
    try:
        with Image.open(io.BytesIO(data)) as image:
            return np.asarray(image.convert("RGBA").resize((_SIDE, _SIDE)))
    except (UnidentifiedImageError, Image.DecompressionBombError, OSError, SyntaxError) as error:
        raise FileFormatError(f"background: a tile of {name} is no picture ({error})") from None


def _opened(path: Path) -> sqlite3.Connection:
    return sqlite3.connect(f"{path.resolve().as_uri()}?mode=ro", uri=True)
