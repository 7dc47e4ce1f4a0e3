"""Maps of a page: in metres about the track's origin, from files; tiles of the network where asked for, each once."""

import functools
import http.server
import io
import threading

import numpy as np
import pytest

from schuler import frames
from schuler.exceptions import InputError
from schuler.studio import maps
from schuler.studio.workspace import Workspace
from schuler.studio.workspace import maps as map_names

PIL = pytest.importorskip("PIL.Image")
ORIGIN = np.array([np.radians(47.37), np.radians(8.54), 400.0])
TRACK = np.array([-100.0, 200.0])

ROAD = """{"type": "FeatureCollection", "features": [{"type": "Feature", "properties": {"highway": "primary"},
 "geometry": {"type": "LineString", "coordinates": [[8.54, 47.37], [8.541, 47.37]]}}]}"""


def png(colour):
    out = io.BytesIO()
    PIL.new("RGB", (256, 256), colour).save(out, "png")
    return out.getvalue()


@pytest.fixture
def folder(tmp_path):
    (tmp_path / "roads.geojson").write_text(ROAD)
    (tmp_path / "picture.png").write_bytes(png("red"))
    (tmp_path / "drive.csv").write_text("1,2\n")
    return Workspace(tmp_path.resolve())


@pytest.fixture
def network(monkeypatch):
    """A server of tiles in the place of OpenStreetMap's, and what was asked of it."""
    asked = []

    class Handler(http.server.BaseHTTPRequestHandler):
        def do_GET(self):
            asked.append((self.path, self.headers["User-Agent"]))
            self.send_response(200)
            self.end_headers()
            self.wfile.write(png("green"))

        def log_message(self, *_):
            pass

    with http.server.ThreadingHTTPServer(("127.0.0.1", 0), Handler) as server:
        thread = threading.Thread(target=functools.partial(server.serve_forever, 0.05))
        thread.start()
        monkeypatch.setattr(maps, "SERVER", f"http://127.0.0.1:{server.server_port}/{{zoom}}/{{column}}/{{row}}.png")
        yield asked
        server.shutdown()
        thread.join()


def test_roads_of_a_file_lie_in_metres_about_the_origin(folder):
    assert map_names(folder) == ["roads.geojson"]  # a picture without a world file is no map
    document = maps.map_document(maps.backdrop_of(folder, "roads.geojson"), ORIGIN, TRACK, TRACK)
    (line,) = document["lines"]
    llh = np.array([[np.radians(47.37), np.radians(8.541), 400.0]])
    east = frames.ned_from_ecef(frames.ecef_from_llh(llh), ORIGIN)[0, 1]
    assert line["role"] == "road_major"
    assert max(v for v in line["x"] if v is not None) == pytest.approx(east, abs=0.05)  # printed digits
    assert document["picture"] is None


def test_a_map_of_elsewhere_says_so(folder):
    far = ORIGIN + np.array([0.1, 0.0, 0.0])
    with pytest.raises(InputError, match="nothing of roads"):
        maps.map_document(maps.backdrop_of(folder, "roads.geojson"), far, TRACK, TRACK)


def test_files_outside_are_no_maps(folder):
    for name in ("../roads.geojson", "/etc/passwd", ".schuler_studio/x.geojson"):
        with pytest.raises(InputError, match="expected a file of the folder"):
            maps.backdrop_of(folder, name)


def test_tiles_are_fetched_once_and_their_source_is_named(folder, network):
    first = maps.map_document(maps.backdrop_of(folder, maps.NETWORK), ORIGIN, TRACK, TRACK)
    fetched = len(network)
    assert 0 < fetched <= 24
    assert len({path for path, _ in network}) == fetched
    assert all(agent.startswith("schuler/") for _, agent in network)
    assert "OpenStreetMap" in first["credit"]
    assert first["picture"]["left"] < -100.0 < 200.0 < first["picture"]["right"]
    assert maps.map_document(maps.backdrop_of(folder, maps.NETWORK), ORIGIN, TRACK, TRACK) == first
    assert len(network) == fetched


def test_nothing_is_fetched_for_a_file(folder, network):
    maps.map_document(maps.backdrop_of(folder, "roads.geojson"), ORIGIN, TRACK, TRACK)
    assert network == []


def test_without_a_network_another_map_is_advised(folder, monkeypatch):
    monkeypatch.setattr(maps, "SERVER", "http://127.0.0.1:9/{zoom}/{column}/{row}")
    with pytest.raises(InputError, match="choose another map"):
        maps.map_document(maps.backdrop_of(folder, maps.NETWORK), ORIGIN, TRACK, TRACK)
