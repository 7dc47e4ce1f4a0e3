"""KML and GeoJSON: valid files, longitudes, the antimeridian, outages, time stamps."""

import itertools
import json
from dataclasses import replace
from xml.etree import ElementTree

import numpy as np
import pytest

from schuler.exceptions import InputError
from schuler.recording import GnssSeries, Recording, Trajectory
from schuler.recording.formats.track import write_geojson, write_kml
from schuler.recording.io import write
from schuler.recording.io.over_ground import velocity_scatter
from schuler.timebase import TimeBase

NS = {"k": "http://www.opengis.net/kml/2.2", "gx": "http://www.google.com/kml/ext/2.2"}
GPS = TimeBase("gps", 2374 * 604_800.0)


def path_of(llh_deg, t=None, **series) -> GnssSeries:
    llh = np.array(llh_deg, dtype=float) * (np.pi / 180.0, np.pi / 180.0, 1.0)
    n = len(llh)
    t = np.arange(n, dtype=float) if t is None else np.asarray(t, dtype=float)
    return GnssSeries(t, llh, np.tile(np.eye(3), (n, 1, 1)), **series)


def features(path) -> list[dict]:
    document = json.loads(path.read_text(), parse_constant=lambda word: pytest.fail(f"{word} is not JSON"))
    assert document["type"] == "FeatureCollection"
    for feature in document["features"]:
        assert feature["type"] == "Feature"
        kind, coordinates = feature["geometry"]["type"], feature["geometry"]["coordinates"]
        lines = {"Point": [[coordinates, coordinates]], "LineString": [coordinates], "MultiLineString": coordinates}[
            kind
        ]
        for line in lines:
            assert len(line) >= 2
            for lon, lat, _ in line:
                assert -180.0 <= lon <= 180.0
                assert -90.0 <= lat <= 90.0
    return document["features"]


def test_geojson_is_longitude_latitude_height(tmp_path):
    path = write_geojson(
        tmp_path / "a.geojson", path_of([[48.5, 9.25, 300.0], [48.6, 9.35, 301.5]]), time=GPS, name="ü"
    )
    [feature] = features(path)
    assert feature["geometry"] == {"type": "LineString", "coordinates": [[9.25, 48.5, 300.0], [9.35, 48.6, 301.5]]}
    assert feature["properties"]["name"] == "ü"
    assert feature["properties"]["start_utc"] == "2025-07-05T23:59:42.000Z"  # 18 leap seconds before the week


@pytest.mark.parametrize(
    ("lons", "parts"),
    [
        ([179.0, -179.0], [[179.0, 180.0], [-180.0, -179.0]]),
        ([-179.0, 179.0], [[-179.0, -180.0], [180.0, 179.0]]),
        ([179.5, -179.5, 179.5], [[179.5, 180.0], [-180.0, -179.5, -180.0], [180.0, 179.5]]),
        ([179.0, 180.0, -179.0], [[179.0, 180.0, 180.0], [-180.0, -179.0]]),
        ([10.0, 20.0], [[10.0, 20.0]]),
    ],
)
def test_geojson_is_cut_at_the_antimeridian(tmp_path, lons, parts):
    points = [[10.0 + k, lon, 100.0 * k] for k, lon in enumerate(lons)]
    [feature] = features(write_geojson(tmp_path / "a.geojson", path_of(points)))
    geometry = feature["geometry"]
    lines = geometry["coordinates"] if geometry["type"] == "MultiLineString" else [geometry["coordinates"]]
    assert [[p[0] for p in line] for line in lines] == parts


def test_the_cut_is_where_the_line_crosses(tmp_path):
    [feature] = features(write_geojson(tmp_path / "a.json", path_of([[10.0, 179.0, 0.0], [14.0, -177.0, 40.0]])))
    first, second = feature["geometry"]["coordinates"]
    assert first[-1] == [180.0, 11.0, 10.0]
    assert second[0] == [-180.0, 11.0, 10.0]


def test_longitudes_are_within_minus_180_and_180(tmp_path):
    track = path_of([[0.0, 180.0, 0.0], [0.0, -180.0, 0.0], [0.0, -179.9999999999, 0.0]])
    [feature] = features(write_geojson(tmp_path / "a.json", track))
    assert [p[0] for p in feature["geometry"]["coordinates"]] == [180.0, 180.0, 180.0]


def test_a_single_point_is_a_point(tmp_path):
    [feature] = features(write_geojson(tmp_path / "a.json", path_of([[1.0, 2.0, 3.0]])))
    assert feature["geometry"] == {"type": "Point", "coordinates": [2.0, 1.0, 3.0]}
    write_kml(tmp_path / "a.kml", path_of([[1.0, 2.0, 3.0]]))


def test_outages_are_features_of_their_own_and_lines_stay_joined(tmp_path):
    track = path_of([[k, k, 0.0] for k in range(10)])
    parts = features(write_geojson(tmp_path / "a.json", track, outages=[(3.0, 5.0), (8.0, 20.0)]))
    assert [p["properties"]["kind"] for p in parts] == ["track", "outage", "track", "outage"]
    assert [(p["properties"]["start_s"], p["properties"]["stop_s"]) for p in parts] == [(0, 3), (3, 6), (6, 8), (8, 9)]
    for a, b in itertools.pairwise(parts):
        assert a["geometry"]["coordinates"][-1] == b["geometry"]["coordinates"][0]
    with pytest.raises(InputError, match="expected start before stop, got 5 and 3"):
        write_geojson(tmp_path / "a.json", track, outages=[(5, 3)])


def test_colours_follow_quality_or_accuracy(tmp_path):
    quality = np.array([1, 1, 2, 5, 9, 9])
    track = path_of([[k, k, 0.0] for k in range(6)], quality=quality)
    parts = features(write_geojson(tmp_path / "a.json", track, colour="quality"))
    assert [p["properties"]["kind"] for p in parts] == ["fixed", "float", "single", "quality 9"]
    track = replace(track, cov_r_n=np.array([s**2 * np.eye(3) for s in (0.01, 0.1, 1.0, 1.0, 10.0, 10.0)]))
    parts = features(write_geojson(tmp_path / "a.json", track, colour="sigma"))
    assert [p["properties"]["kind"] for p in parts] == [
        "1-sigma up to 0.05 m", "1-sigma up to 0.5 m", "1-sigma up to 5 m", "1-sigma above 5 m",
    ]  # fmt: skip
    trajectory = Trajectory.from_geodetic(track.t, track.llh)
    assert len(features(write_geojson(tmp_path / "a.json", trajectory, colour="sigma", sigma=[0, 0, 9, 9, 9, 9]))) == 2
    with pytest.raises(InputError, match="colour='sigma' of a trajectory needs"):
        write_geojson(tmp_path / "a.json", trajectory, colour="sigma")
    with pytest.raises(InputError, match="colour='quality' needs a GNSS series with quality"):
        write_geojson(tmp_path / "a.json", trajectory, colour="quality")
    with pytest.raises(InputError, match="colour: expected 'quality' or 'sigma', got 'speed'"):
        write_geojson(tmp_path / "a.json", trajectory, colour="speed")


def test_kml_has_a_playable_track_and_lines(tmp_path):
    track = path_of([[48.5, 9.25, 300.0], [48.6, 9.35, 301.5], [48.7, 9.45, 303.0]], t=[18.0, 18.25, 19.0])
    path = write_kml(tmp_path / "a.kml", track, time=GPS, name="a < b & c", outages=[(18.2, 18.5)])
    root = ElementTree.parse(path).getroot()
    assert root.tag == f"{{{NS['k']}}}kml"
    assert root.findtext("k:Document/k:name", namespaces=NS) == "a < b & c"
    when = [e.text for e in root.iterfind(".//gx:Track/k:when", NS)]
    assert when == ["2025-07-06T00:00:00.000Z", "2025-07-06T00:00:00.250Z", "2025-07-06T00:00:01.000Z"]
    coord = [e.text for e in root.iterfind(".//gx:Track/gx:coord", NS)]
    assert coord[0] == "9.250000000 48.500000000 300.000"
    assert len(coord) == len(when)
    lines = root.findall(".//k:LineString/k:coordinates", NS)
    assert lines[0].text == "9.250000000,48.500000000,300.000 9.350000000,48.600000000,301.500"
    assert {e.text for e in root.iterfind(".//k:altitudeMode", NS)} == {"absolute"}
    styles = {e.get("id"): e.findtext("k:LineStyle/k:color", namespaces=NS) for e in root.iterfind(".//k:Style", NS)}
    assert styles == {"track": "ffb4781f", "outage": "ff1c1ae3"}
    urls = [e.text for e in root.iterfind(".//k:styleUrl", NS)]
    assert urls == ["#track", "#outage"]


def test_kml_of_a_local_clock_has_no_time_stamps(tmp_path):
    path = write_kml(tmp_path / "a.kml", path_of([[1, 2, 3], [2, 3, 4]]))
    root = ElementTree.parse(path).getroot()
    assert root.find(".//gx:Track", NS) is None
    assert root.find(".//k:LineString", NS) is not None


def test_kml_heights_may_be_made_those_of_sea_level(tmp_path):
    path = write_kml(tmp_path / "a.kml", path_of([[1, 2, 100.0], [2, 3, 100.0]]), geoid_separation=47.5)
    root = ElementTree.parse(path).getroot()
    assert root.find(".//k:coordinates", NS).text.split(" ")[0] == "2.000000000,1.000000000,52.500"
    assert "less a geoid separation of 47.5 m" in root.findtext(".//k:description", namespaces=NS)


def test_long_tracks_are_thinned_and_say_so(tmp_path):
    track = path_of([[0.0, 1e-4 * k, 0.0] for k in range(1000)])
    path = write_geojson(tmp_path / "a.json", track, max_points=100)
    [feature] = features(path)
    points = feature["geometry"]["coordinates"]
    assert len(points) <= 101
    assert points[-1][0] == pytest.approx(0.0999)
    assert json.loads(path.read_text())["about"]["note"] == "Every 10th of 1000 points is drawn."
    with pytest.raises(InputError, match="max_points: expected at least 2, got 1"):
        write_kml(tmp_path / "a.kml", track, max_points=1)


def test_recordings_are_drawn_by_suffix(run, tmp_path):
    [path] = write(run, tmp_path / "a.geojson", colour="quality")
    assert len(features(path)) > 1
    write(run, tmp_path / "a.kml", outages=[(run.gnss.t[3], run.gnss.t[5])])
    truth = Trajectory.from_geodetic(run.gnss.t, run.gnss.llh)
    [path] = write(Recording(reference=truth, metadata=run.metadata), tmp_path / "b.geojson")
    assert features(path)[0]["geometry"]["coordinates"][0][1] == pytest.approx(np.rad2deg(run.gnss.llh[0, 0]), abs=1e-9)
    with pytest.raises(InputError, match="has no reference to draw"):
        write(replace(run, reference=None), tmp_path / "a.kml", series="reference")
    with pytest.raises(InputError, match="expected 'gnss' or 'reference', got 'imu'"):
        write(run, tmp_path / "a.kml", series="imu")
    with pytest.raises(InputError, match="has no GNSS series or reference to draw"):
        write(Recording(imu=run.imu), tmp_path / "a.kml")


def test_velocities_of_damaged_places_are_judged_without_a_warning():
    """A latitude or a speed beyond double precision in metres: a number, or none, and the gate names the row."""
    t, zero = np.arange(40.0), np.zeros(40)
    for lat, speed in ((1e305, 1.0), (0.0, 1e305)):
        spoilt = np.where(t == 7.0, lat, 0.0)
        scatter = velocity_scatter(t, spoilt, zero, np.where(t == 7.0, speed, 1.0), zero)
        assert scatter > 0.0 or np.isnan(scatter)
