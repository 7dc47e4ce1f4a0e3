"""Lines of solutions: NMEA that readers of NMEA read back, JSON, and the places they go to."""

import json
import socket
import time

import numpy as np
import pytest

from schuler import read
from schuler.exceptions import InputError
from schuler.live.clock import SourceClock
from schuler.live.messages import Event, Solution
from schuler.live.outlets import open_outlet
from schuler.live.sentences import json_of, nmea_of, sentence
from schuler.live.sinks import open_line_sink
from schuler.timebase import TimeBase

WEEK = TimeBase("gps", 2300 * 604_800.0)


def solution(t=345_600.25, lat=0.84, lon=-0.147, health="ok", velocity=(3.0, -4.0, 0.5)):
    return Solution(
        t, np.array([lat, lon, 523.4567]), np.array(velocity), np.array([0.01, -0.02, -1.0]),
        np.array([0.5, 0.25, 1.0]), np.array([0.05, 0.06, 0.07]), np.array([0.001, 0.002, 0.02]), health,
    )  # fmt: skip


@pytest.mark.parametrize("separation", [0.0, 47.5, -20.0])
def test_nmea_is_read_back(tmp_path, separation):
    pytest.importorskip("pynmeagps")
    made = [solution(345_600.0 + 0.1 * k, 0.84 + 1e-7 * k, -0.147 - 1e-7 * k) for k in range(20)]
    (tmp_path / "live.nmea").write_text("".join(nmea_of(s, WEEK, separation) for s in made), newline="")
    log = read(tmp_path / "live.nmea")
    assert log.metadata.time == WEEK
    np.testing.assert_allclose(log.gnss.t, [s.t for s in made], atol=1e-6)  # printed digits
    llh = np.array([s.llh for s in made])
    np.testing.assert_allclose(log.gnss.llh[:, :2], llh[:, :2], rtol=0.0, atol=2e-11)  # 1e-7 minutes
    np.testing.assert_allclose(log.gnss.llh[:, 2], llh[:, 2], atol=1e-4)
    np.testing.assert_allclose(np.sqrt(np.einsum("nii->ni", log.gnss.cov_r_n)), np.tile((0.5, 0.25, 1.0), (20, 1)))
    np.testing.assert_allclose(log.gnss.v_n[:, :2], np.tile((3.0, -4.0), (20, 1)), atol=1e-3)


def test_health_is_in_the_sentences():
    assert ",6,," in nmea_of(solution(health="coasting"), WEEK).splitlines()[0]
    failed = nmea_of(solution(health="failed"), WEEK).splitlines()
    assert ",0,," in failed[0]
    assert ",V," in failed[1]
    assert failed[4].startswith("$PSCH,235942.250,failed,0.500,0.250,1.000,0.050,0.060,0.070,0.057,0.115,1.146*")
    assert nmea_of(solution(), TimeBase("local")).startswith("$INGGA,,4807.")


def test_the_checksum_of_a_sentence_of_the_standard():
    body = "GPGGA,123519,4807.038,N,01131.000,E,1,08,0.9,545.4,M,46.9,M,,"
    assert sentence(body) == f"${body}*47\r\n"


def test_angles_are_carried_over():
    line = nmea_of(solution(lat=np.deg2rad(-47.99999999999), lon=np.deg2rad(179.9999999999)), WEEK).splitlines()[0]
    assert ",4800.0000000,S,18000.0000000,E," in line


def test_json_lines():
    line = json.loads(json_of(solution(), WEEK))
    assert line["t_s"] == 345_600.25
    assert line["gps_s"] == 2300 * 604_800.0 + 345_600.25
    assert line["health"] == "ok"
    assert line["lat_deg"] == pytest.approx(np.rad2deg(0.84), abs=1e-12)
    assert line["sigma_attitude_down_deg"] == pytest.approx(np.rad2deg(0.02), abs=1e-12)
    event = json.loads(json_of(Event(float("nan"), "source", "udp://:5000: lost"), None))
    assert event == {"t_s": None, "event": "source", "text": "udp://:5000: lost"}


def test_a_file_is_appended_to(tmp_path):
    for text in ("one\n", "two\n"):
        outlet = open_outlet(str(tmp_path / "folder" / "live.jsonl"))
        outlet.write(text)
        outlet.close()
    assert (tmp_path / "folder" / "live.jsonl").read_text() == "one\ntwo\n"
    with pytest.raises(InputError, match="it is a folder"):
        open_outlet(str(tmp_path))


@pytest.mark.parametrize("format", ["json", "nmea"])
def test_a_file_of_something_else_is_not_appended_to(tmp_path, format):
    lines, notes = tmp_path / "lines", tmp_path / "notes.json"
    for k in (1, 2):
        sink = open_line_sink(f"{format}:{lines}", SourceClock())
        sink.solution(solution())
        sink.close()
        assert len(lines.read_text().split("health" if format == "json" else "$PSCH")) == k + 1
    notes.write_text('{"mine": 1}\n')
    with pytest.raises(InputError, match=r"lines of an earlier run .* it is kept as it is"):
        open_line_sink(f"{format}:{notes}", SourceClock())
    assert notes.read_text() == '{"mine": 1}\n'


def test_udp_with_and_without_a_listener():
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as listener:
        listener.bind(("127.0.0.1", 0))
        outlet = open_outlet(f"udp://:{listener.getsockname()[1]}")
        outlet.write("line\n")
        assert listener.recv(100) == b"line\n"
    for _ in range(3):
        outlet.write("nobody\n")
    outlet.close()


def wait_for(condition):
    began = time.monotonic()
    while not condition():
        assert time.monotonic() - began < 10.0
        time.sleep(0.01)


def test_clients_of_a_websocket_come_and_go_and_slow_ones_are_let_go(monkeypatch):
    connect = pytest.importorskip("websockets.sync.client").connect
    monkeypatch.setattr("schuler.live.outlets._WAITING", 20)
    monkeypatch.setattr("schuler.live.outlets.CLOSED_S", 1.5)  # a handshake takes long on a busy machine
    with socket.socket() as s:
        s.bind(("127.0.0.1", 0))
        port = s.getsockname()[1]
    outlet = open_outlet(f"ws://:{port}")
    outlet.write("before anybody\n")
    with (
        socket.create_connection(("127.0.0.1", port)),  # says nothing
        connect(f"ws://127.0.0.1:{port}") as reader,
        connect(f"ws://127.0.0.1:{port}", max_queue=1, close_timeout=0.1),  # reads nothing
    ):
        wait_for(lambda: len(outlet._waiting) == 2)
        outlet.write("hello\n")
        assert reader.recv(timeout=10.0) == "hello\n"
        began = time.monotonic()
        for _ in range(200):
            outlet.write("x" * 100_000 + "\n")
            assert len(reader.recv(timeout=10.0)) == 100_001
        assert time.monotonic() - began < 10.0
        wait_for(lambda: len(outlet._waiting) == 1)
        with pytest.raises(InputError, match="cannot listen there"):
            open_outlet(f"ws://:{port}")
        outlet.write("last\n")
        assert reader.recv(timeout=10.0) == "last\n"
        outlet.close()


def test_clients_come_and_go_and_slow_ones_are_let_go():
    with socket.socket() as s:
        s.bind(("127.0.0.1", 0))
        port = s.getsockname()[1]
    outlet = open_outlet(f"tcp://:{port}")
    outlet.write("before anybody\n")
    with socket.create_connection(("127.0.0.1", port)) as reader, socket.create_connection(("127.0.0.1", port)) as slow:
        outlet.write("hello\n")
        assert reader.recv(100) == b"hello\n"
        began = time.monotonic()
        for _ in range(5000):
            outlet.write("x" * 1000 + "\n")
            reader.recv(100_000)
        assert time.monotonic() - began < 10.0
        assert slow.recv(6) == b"hello\n"
    outlet.write("after\n")
    with pytest.raises(InputError, match="cannot listen there"):
        open_outlet(f"tcp://:{port}")
    outlet.close()
