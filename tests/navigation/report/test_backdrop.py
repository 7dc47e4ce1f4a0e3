"""Maps behind the track: the right place to the metre, and errors that say what is expected."""

from __future__ import annotations

import json

import numpy as np
import pytest
from html_pages import Page

from schuler import frames
from schuler.exceptions import FileFormatError, InputError
from schuler.navigation.report import figures, track
from schuler.navigation.report.backdrop import Window, backdrop_items, clipped, graticule, read_backdrop
from schuler.navigation.report.subject import Subject
from schuler.plotting.figure import Line, Markers, Picture, Text
from schuler.plotting.georeference import Georeference, project, read_picture, utm_zone

PIL = pytest.importorskip("PIL.Image")
ORIGIN = np.array([np.radians(47.37), np.radians(8.54), 400.0])
LON, LAT = 8.54, 47.37


def window(half=500.0, origin=ORIGIN):
    return Window(origin, 0.0, 0.0, half)


def collection(*features, **more):
    return {"type": "FeatureCollection", "features": list(features), **more}


def road(points, kind="LineString", **tags):
    return {"type": "Feature", "properties": tags, "geometry": {"type": kind, "coordinates": points}}


def written(tmp_path, data, name="map.geojson"):
    path = tmp_path / name
    path.write_text(data if isinstance(data, str) else json.dumps(data))
    return path


def test_a_road_lies_where_the_track_would(tmp_path):
    points = [[LON, LAT], [LON + 0.004, LAT], [LON + 0.004, LAT + 0.003]]
    (line,) = backdrop_items(read_backdrop(written(tmp_path, collection(road(points, highway="primary")))), window())
    assert line.role == "road_major"
    llh = np.column_stack((np.radians([p[1] for p in points]), np.radians([p[0] for p in points]), np.full(3, 400.0)))
    ned = frames.ned_from_ecef(frames.ecef_from_llh(llh), ORIGIN)
    finite = np.isfinite(line.x)
    assert np.allclose(line.x[finite], ned[:, 1], atol=1e-6)  # rounding
    assert np.allclose(line.y[finite], ned[:, 0], atol=1e-6)


def test_kinds_of_osm_have_roles_and_all_geometries_are_read(tmp_path):
    a = [[LON, LAT], [LON + 0.001, LAT + 0.001]]
    ring = [[[LON, LAT], [LON + 0.001, LAT], [LON, LAT + 0.001], [LON, LAT]]]
    data = collection(
        road(a, highway="residential"), road([a], "MultiLineString", highway="motorway"),
        road(ring, "Polygon", building="yes"), road([ring], "MultiPolygon", natural="water"),
        road(ring, "Polygon", landuse="forest"), road([LON, LAT], "Point", name="stop"),
        {"type": "Feature", "properties": {"tags": {"waterway": "river"}}, "geometry": {
            "type": "GeometryCollection", "geometries": [{"type": "LineString", "coordinates": a}]}},
        {"type": "Feature", "properties": None, "geometry": None},
        copyright="© OpenStreetMap contributors",
    )  # fmt: skip
    backdrop = read_backdrop(written(tmp_path, data, "extract.json"))
    assert backdrop.credit == "© OpenStreetMap contributors"
    assert [role for role, _ in backdrop.shapes] == ["road", "road_major", "building", "water", "land", "water"]
    assert [i.role for i in backdrop_items(backdrop, window())] == ["land", "building", "water", "road", "road_major"]


def test_clipping_keeps_what_crosses_the_window():
    box = (-1.0, 1.0, -1.0, 1.0)
    through = clipped(np.array([[-5.0, 0.5], [5.0, 0.5]]), box)
    assert np.allclose(through, [[-1.0, 0.5], [1.0, 0.5]])
    assert len(clipped(np.array([[-5.0, 1.5], [5.0, 1.5], [5.0, 9.0]]), box)) == 0
    assert len(clipped(np.array([[3.0, -3.0], [3.0, 3.0]]), box)) == 0
    out_and_in = clipped(np.array([[0.0, 0.0], [0.0, 3.0], [0.5, 3.0], [0.5, 0.0]]), box)
    assert np.allclose(out_and_in[[0, 1, 3, 4]], [[0, 0], [0, 1], [0.5, 1], [0.5, 0]])
    assert np.isnan(out_and_in[2]).all()
    inside = np.random.default_rng(1).uniform(-1.0, 1.0, (50, 2))
    assert np.allclose(clipped(inside, box), inside)


def test_large_maps_stay_small(tmp_path):
    """A street of a million kinks a millimetre apart is drawn with no more points than can be seen."""
    x = LON + np.linspace(-0.01, 0.01, 20_000)
    y = LAT + 1e-8 * np.random.default_rng(0).standard_normal(20_000)
    path = written(tmp_path, collection(road(np.column_stack((x, y)).tolist(), highway="track")))
    (line,) = backdrop_items(read_backdrop(path), window())
    assert len(line.x) < 6000


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("not json", "this is not JSON"),
        ("[1, 2]", 'an object with a "type"'),
        ('{"elements": []}', "of Overpass results take the GeoJSON export"),
        (json.dumps(collection(road([LON, LAT], "Point"))), "expected lines or polygons, found none"),
        (json.dumps(collection(road([[950_000, 6_000_000], [950_001, 6_000_000]]))), "ogr2ogr -t_srs EPSG:4326"),
        (json.dumps(collection(road([["a", 1], [2, 3]]))), "not lists of [longitude, latitude]"),
        (json.dumps(collection(road([1, 2]))), "not lists of [longitude, latitude]"),
    ],
)
def test_bad_geojson_is_refused(tmp_path, text, says):
    with pytest.raises(FileFormatError) as caught:
        read_backdrop(written(tmp_path, text))
    assert says in str(caught.value)
    assert "map.geojson" in str(caught.value)


def test_other_files_are_refused(tmp_path):
    with pytest.raises(InputError, match="is no file; expected a GeoJSON file"):
        read_backdrop(tmp_path / "nothing.geojson")
    with pytest.raises(InputError, match=r"expected a GeoJSON file .* got town\.osm\.pbf"):
        read_backdrop(written(tmp_path, "", "town.osm.pbf"))
    with pytest.raises(FileFormatError, match="this picture cannot be read"):
        read_backdrop(written(tmp_path, "no picture", "town.png"))
    PIL.new("RGB", (4, 4)).save(tmp_path / "bare.png")
    with pytest.raises(FileFormatError, match=r"expected a world file beside it \(bare\.pgw\) or a GeoTIFF"):
        read_backdrop(tmp_path / "bare.png")
    written(tmp_path, "1 2 3", "bare.pgw")
    with pytest.raises(FileFormatError, match="six numbers"):
        read_backdrop(tmp_path / "bare.png")
    written(tmp_path, "0 0 0 0 1 2", "bare.pgw")
    with pytest.raises(FileFormatError, match="no area"):
        read_backdrop(tmp_path / "bare.png")
    written(tmp_path, "1 0 0 -1 1 2", "bare.pgw")
    written(tmp_path, 'PROJCS["CH1903+ / LV95",GEOGCS["x"]]', "bare.prj")
    with pytest.raises(FileFormatError, match=r"got CH1903\+ / LV95; convert with gdalwarp"):
        read_backdrop(tmp_path / "bare.png")


def test_a_map_of_another_place_is_refused_with_both_places(tmp_path):
    elsewhere = read_backdrop(written(tmp_path, collection(road([[20.0, 10.0], [20.1, 10.0]]))))
    with pytest.raises(
        InputError, match=r"longitude 8\.5400, latitude 47\.3700 deg; the file covers longitude 20\.0000"
    ):
        backdrop_items(elsewhere, window())
    picture = stamped(tmp_path, "EPSG:3857", shift=1e6)
    with pytest.raises(InputError, match=r"nothing of .* lies near the track.*is read as"):
        backdrop_items(read_backdrop(picture), window())


@pytest.mark.parametrize("zone", ["UTM 32N", "UTM 33N", "UTM 56S", "UTM 1N", "Web Mercator"])
def test_projections_agree_with_proj(zone):
    """PROJ's series are of a higher order: 1 mm (truncation) inside a zone and a little beyond."""
    pyproj = pytest.importorskip("pyproj")
    rng = np.random.default_rng(2)
    if zone.startswith("UTM"):
        number, south = int(zone[4:-1]), zone.endswith("S")
        lon = 6.0 * number - 183.0 + rng.uniform(-4.0, 4.0, 200)
        lat = rng.uniform(-80.0, -1.0, 200) if south else rng.uniform(1.0, 84.0, 200)
        code = (32700 if south else 32600) + number
    else:
        lon, lat, code = rng.uniform(-180, 180, 200), rng.uniform(-84, 84, 200), 3857
    x, y = project(zone, np.radians(lon), np.radians(lat))
    expected = pyproj.Transformer.from_crs(4326, code, always_xy=True).transform(lon, lat)
    assert np.allclose(x, expected[0], rtol=0.0, atol=1e-3)
    assert np.allclose(y, expected[1], rtol=0.0, atol=1e-3)


def test_utm_zones():
    for lon, lat, zone in ((8.54, 47.4, "UTM 32N"), (-105.15, 40.1, "UTM 13N"), (151.2, -33.9, "UTM 56S"),
                           (-180.0, 1.0, "UTM 1N"), (179.9, 1.0, "UTM 60N")):  # fmt: skip
        assert utm_zone(np.radians([lat, lon, 0.0])) == zone


def stamped(tmp_path, crs, *, tagged=False, shift=0.0, size=400):
    """A picture of 1.6 km with a red cross of 3 pixels at the origin, black elsewhere."""
    pyproj = pytest.importorskip("pyproj")
    x, y = pyproj.Transformer.from_crs(4326, crs, always_xy=True).transform(LON, LAT)
    metre = 1.0 if crs != "EPSG:4326" else 1.0 / 111_000.0
    step = 4.0 * metre / (np.cos(np.radians(LAT)) if crs == "EPSG:3857" else 1.0)
    left, top = x - 0.4 * size * step + shift, y + 0.6 * size * step
    pixels = np.zeros((size, size, 3), dtype=np.uint8)
    row, column = int((top - y) / step), int((x + shift - left) / step)
    pixels[row - 1 : row + 2, column - 1 : column + 2, 0] = 255
    image = PIL.fromarray(pixels)
    if not tagged:
        path = tmp_path / f"{crs[5:]}.png"
        image.save(path)
        path.with_suffix(".pgw").write_text(f"{step}\n0\n0\n{-step}\n{left + step / 2}\n{top - step / 2}\n")
        return path
    from PIL.TiffImagePlugin import ImageFileDirectory_v2

    code = int(crs[5:])
    kind = (1024, 0, 1, 2), (2048, 0, 1, code)
    keys = kind if code == 4326 else ((1024, 0, 1, 1), (3072, 0, 1, code))
    tags = ImageFileDirectory_v2()
    tags.tagtype = {33550: 12, 33922: 12, 34735: 3}
    tags[33550], tags[33922] = (step, step, 0.0), (0.0, 0.0, 0.0, left, top, 0.0)
    tags[34735] = (1, 1, 0, len(keys), *(v for key in keys for v in key))
    path = tmp_path / f"{code}.tif"
    image.save(path, tiffinfo=tags)
    return path


@pytest.mark.thinned(3)
@pytest.mark.parametrize("tagged", [False, True])
@pytest.mark.parametrize("crs", ["EPSG:4326", "EPSG:3857", "EPSG:32632", "EPSG:25832"])
def test_a_picture_lies_where_it_belongs(tmp_path, crs, tagged):
    """The red cross at the origin, to a pixel of the picture (4 m); which coordinates are meant is found alone."""
    backdrop = read_backdrop(stamped(tmp_path, crs, tagged=tagged))
    (picture,) = backdrop_items(backdrop, window())
    assert isinstance(picture, Picture)
    h, w = picture.pixels.shape[:2]
    rows, columns = np.nonzero(picture.pixels[:, :, 0] > 200)
    x = picture.left + (columns.mean() + 0.5) * (picture.right - picture.left) / w
    y = picture.top - (rows.mean() + 0.5) * (picture.top - picture.bottom) / h
    assert np.hypot(x, y) < 6.0
    # it ends 640 m to the west of the origin, within the window of 650 m; degrees of longitude are shorter
    west = -640.0 * (np.cos(np.radians(LAT)) if crs == "EPSG:4326" else 1.0)
    shown = picture.pixels[h // 2, :, 3] > 0
    assert picture.left + np.argmax(shown) * (picture.right - picture.left) / w == pytest.approx(west, abs=8.0)


def test_geotiff_of_another_projection_is_refused(tmp_path):
    with pytest.raises(FileFormatError, match=r"got EPSG:2056; convert with gdalwarp -t_srs EPSG:3857"):
        read_picture(stamped(tmp_path, "EPSG:2056", tagged=True))


def test_pixel_is_the_inverse_of_the_affine():
    g = Georeference((2.0, 0.5, 100.0, 0.3, -2.0, 900.0), "longitude and latitude")
    column, row = g.pixel(
        np.radians([100.0 + 2.0 * 7 + 0.5 * 3]), np.radians([900.0 + 0.3 * 7 - 2.0 * 3]), ORIGIN, (9, 9)
    )
    assert (column[0], row[0]) == pytest.approx((7.0, 3.0))


@pytest.mark.parametrize("half", [3.0, 80.0, 2500.0, 60_000.0])
@pytest.mark.parametrize("lat", [47.37, -33.9, 0.0])
def test_graticule_has_round_values_at_their_places(half, lat):
    origin = np.array([np.radians(lat), np.radians(-8.54), 100.0])
    items = graticule(window(half, origin))
    lines, texts = ([i for i in items if isinstance(i, kind)] for kind in (Line, Text))
    assert 2 <= len(lines) <= 8
    for line in lines:
        assert np.abs(line.x).max() <= half * (1 + 1e-9)
        assert np.abs(line.y).max() <= half * (1 + 1e-9)
    for text in texts:
        value = float(text.text.split("°")[0]) * (-1.0 if text.text[-1] in "SW" else 1.0)
        llh = frames.llh_from_ecef(frames.ecef_from_ned([text.y, text.x, 0.0], origin))
        place = np.degrees(llh[0 if text.text[-1] in "NS" else 1])
        # curvature of a parallel drawn by eight pieces: far below what is seen
        assert place == pytest.approx(value, abs=1e-3 * half / 111_000.0 + 1e-9)


def test_track_is_drawn_on_the_map_with_its_name(full, tmp_path):
    llh = full.result.trajectory.llh[::500, :2]
    points = np.degrees(llh[:, ::-1]).tolist()
    path = written(tmp_path, collection(road(points, highway="primary"), attribution="© somebody."))
    figure = track.track(Subject(full.result, background=path))
    (panel,) = figure.panels
    assert "Background: map.geojson (© somebody)." in figure.caption
    (major,) = [i for i in panel.items if isinstance(i, Line) and i.role == "road_major"]
    filtered = next(i for i in panel.items if isinstance(i, Line) and i.role == "filtered")
    finite = np.isfinite(major.x)
    distance = np.hypot(major.x[finite][:, None] - filtered.x, major.y[finite][:, None] - filtered.y).min(axis=1)
    # corners of the road are points of the track, which is thinned
    assert distance.max() < 3.0
    assert panel.x_limits[1] - panel.x_limits[0] == pytest.approx(panel.y_limits[1] - panel.y_limits[0])
    assert any(isinstance(i, Markers) and i.role == "arrow" for i in panel.items)
    assert not any(i.role == "graticule" for i in panel.items if isinstance(i, Line))
    html = full.result.report(tmp_path / "r.html", background=path).read_text(encoding="utf-8")
    assert "© somebody" in html
    with pytest.raises(InputError, match="is no file"):
        full.result.report(tmp_path / "r.html", background=tmp_path / "missing.png")


@pytest.mark.campaign
def test_a_picture_is_put_into_the_page_and_the_figure(full, tmp_path):
    pixels = np.random.default_rng(0).integers(0, 255, (300, 300, 3), dtype=np.uint8)
    T = full.result.trajectory
    lat, lon = np.degrees(T.llh[:, 0]), np.degrees(T.llh[:, 1])
    step = 1.3 * max(np.ptp(lat), np.ptp(lon)) / 300
    PIL.fromarray(pixels).save(tmp_path / "photo.jpg")
    corner = lon.mean() - 150 * step, lat.mean() + 150 * step
    (tmp_path / "photo.jgw").write_text(f"{step} 0 0 {-step} {corner[0]} {corner[1]}")
    path = full.result.report(tmp_path / "r.html", background=tmp_path / "photo.jpg")
    data = Page(path.read_text(encoding="utf-8")).unpacked("figures")
    assert data.count("data:image/png;base64,") == 1
    assert "http" not in data
    drawn = figures.plot_track(full.result, background=tmp_path / "photo.jpg")
    assert len(drawn.axes[0].images) == 1


@pytest.mark.parametrize(
    "text",
    [
        '{"type": "FeatureCollection", "features": 3}',
        '{"type": "FeatureCollection", "features": [3]}',
        '{"type": "GeometryCollection", "geometries": 3}',
        '{"type": "MultiPolygon", "coordinates": [3]}',
        '{"type": "Feature", "properties": [1], "geometry": {"type": "LineString", "coordinates": [[1, 2], [3, 4]]}}',
        "[" * 100_000,
        "9" * 5000,
    ],
)
def test_geojson_of_other_kinds_is_refused(tmp_path, text):
    path = tmp_path / "map.geojson"
    path.write_text(text)
    with pytest.raises(FileFormatError, match=r"map\.geojson: background: expected GeoJSON"):
        read_backdrop(path)
