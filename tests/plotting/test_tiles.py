"""Tiles behind a track: the ones of an area at their places, zooms that a map has, what is no map of tiles."""

import io
import sqlite3

import numpy as np
import pytest

from schuler import frames
from schuler.exceptions import FileFormatError
from schuler.navigation.report.backdrop import Window, backdrop_items, read_backdrop
from schuler.plotting.tiles import mosaic, read_mbtiles

PIL = pytest.importorskip("PIL.Image")
LAT, LON = np.radians(47.37), np.radians(8.54)


def place(zoom):
    """Column, row from the north of the tile at the place, with fractions; the definition of slippy maps."""
    n = 2**zoom
    return n * (LON / (2 * np.pi) + 0.5), n * (1.0 - np.log(np.tan(LAT) + 1.0 / np.cos(LAT)) / np.pi) / 2.0


def tiles_at(path, zooms=(12, 16), kind="png", *, north_west=(255, 0, 0)):
    """An MBTiles file around the place: every tile has its place's pixel in blue, all else another colour."""
    with sqlite3.connect(path) as file:
        file.execute("CREATE TABLE metadata (name TEXT, value TEXT)")
        file.execute("CREATE TABLE tiles (zoom_level INT, tile_column INT, tile_row INT, tile_data BLOB)")
        file.executemany("INSERT INTO metadata VALUES (?, ?)", [("format", kind), ("attribution", "a map of ours")])
        for zoom in range(*zooms):
            x, y = place(zoom)
            for i in range(int(x) - 3, int(x) + 4):
                for j in range(int(y) - 3, int(y) + 4):
                    pixels = np.full((256, 256, 3), north_west, dtype=np.uint8)
                    if (i, j) == (int(x), int(y)):
                        v, u = int(256 * (y - j)), int(256 * (x - i))
                        pixels[max(v - 2, 0) : v + 3, max(u - 2, 0) : u + 3] = (0, 0, 255)
                    out = io.BytesIO()
                    PIL.fromarray(pixels).save(out, "png")
                    file.execute("INSERT INTO tiles VALUES (?, ?, ?, ?)", (zoom, i, 2**zoom - 1 - j, out.getvalue()))
    file.close()
    return path


@pytest.mark.thinned(2)
@pytest.mark.parametrize("half", [80.0, 400.0])
def test_the_tile_of_a_place_lies_at_the_place(tmp_path, half):
    origin = np.array([LAT, LON, 400.0])
    backdrop = read_backdrop(tiles_at(tmp_path / "town.mbtiles"))
    assert backdrop.credit == "a map of ours"
    (picture,) = backdrop_items(backdrop, Window(origin, 0.0, 0.0, half))
    blue = np.argwhere(picture.pixels[..., 2] > picture.pixels[..., 0])
    h, w = picture.pixels.shape[:2]
    north = picture.top - (blue[:, 0].mean() + 0.5) / h * (picture.top - picture.bottom)
    east = picture.left + (blue[:, 1].mean() + 0.5) / w * (picture.right - picture.left)
    metres = 40_075_017.0 * np.cos(LAT) / 2**15 / 256  # of a pixel at the finest zoom
    assert abs(north) < 4 * metres  # half of the blue square, and the pixel within it
    assert abs(east) < 4 * metres


def test_zooms_end_with_the_map(tmp_path):
    tiles = read_mbtiles(tiles_at(tmp_path / "town.mbtiles", (12, 14)))
    assert tiles.zooms == (12, 13)
    span = np.array([-1e-5, 1e-5])
    pixels, georeference = mosaic(tiles, LON + span, LAT + span, 1000)
    assert pixels.shape[0] % 256 == 0
    column, row = georeference.pixel(np.array([LON]), np.array([LAT]), np.array([LAT, LON, 0.0]), pixels.shape)
    assert 0 <= column[0] < pixels.shape[1]
    assert 0 <= row[0] < pixels.shape[0]
    assert georeference.affine[0] == pytest.approx(40_075_016.7 / 2**13 / 256, rel=1e-6)  # printed digits


def test_a_place_that_the_map_has_not_is_transparent(tmp_path):
    tiles = read_mbtiles(tiles_at(tmp_path / "town.mbtiles"))
    llh = frames.llh_from_ecef(frames.ecef_from_llh(np.array([[0.1, 0.2, 0.0]])))
    pixels, _ = mosaic(tiles, llh[:, 1], llh[:, 0], 100)
    assert not pixels.any()


@pytest.mark.parametrize("how", ["text", "vector", "empty"])
def test_what_is_no_map_of_tiles(tmp_path, how):
    path = tmp_path / "x.mbtiles"
    if how == "text":
        path.write_text("no database")
    else:
        tiles_at(path, (12, 13) if how == "vector" else (12, 12), "pbf" if how == "vector" else "png")
    with pytest.raises(FileFormatError, match="background: expected"):
        read_backdrop(path)
