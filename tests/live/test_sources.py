"""Sources of bytes on this machine: UDP, TCP, a serial line through a pseudo-terminal, WebSockets; and what is lost."""

import os
import socket
import threading
import time

import pytest

from schuler.exceptions import InputError
from schuler.live import sources
from schuler.live.sources import chunks, parse_source

LONGEST_S = 20.0


class Listener:
    """A source that is read in a thread: what came, and what was said."""

    def __init__(self, text):
        self.data, self.sentence, self.error = b"", [], None
        self.stop = threading.Event()
        self.thread = threading.Thread(target=self._run, args=(parse_source(text),))
        self.thread.start()

    def _run(self, address):
        try:
            for piece in chunks(address, self.stop, self.sentence.append):
                self.data += piece
        except Exception as error:
            self.error = error

    def wait_for(self, condition):
        began = time.monotonic()
        while not condition(self):
            assert time.monotonic() - began < LONGEST_S, (self.data, self.sentence, self.error)
            time.sleep(0.01)

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.stop.set()
        self.thread.join(LONGEST_S)
        assert not self.thread.is_alive()


@pytest.fixture
def port():
    with socket.socket() as s:
        s.bind(("127.0.0.1", 0))
        return s.getsockname()[1]


@pytest.fixture(autouse=True)
def short_waits(monkeypatch):
    monkeypatch.setattr(sources, "SHORTEST_WAIT_S", 0.02)
    monkeypatch.setattr(sources, "LONGEST_WAIT_S", 0.1)


def test_udp(port):
    with Listener(f"udp://:{port}") as received, socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
        received.wait_for(lambda s: s.sentence)
        assert received.sentence == [f"listening on 127.0.0.1:{port}"]
        for piece in (b"a", b"b" * 1400, b"c"):
            sender.sendto(piece, ("127.0.0.1", port))
        received.wait_for(lambda s: len(s.data) == 1402)
    assert received.data == b"a" + b"b" * 1400 + b"c"


def test_a_port_that_is_taken_is_refused(port):
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as other:
        other.bind(("127.0.0.1", port))
        with pytest.raises(InputError, match=r"cannot listen on 127\.0\.0\.1"):
            next(chunks(parse_source(f"udp://:{port}"), threading.Event(), print))


def test_tcp_is_connected_again_when_the_other_side_comes_back(port):
    with Listener(f"tcp://localhost:{port}") as received:
        received.wait_for(lambda s: s.sentence)  # nobody is there yet
        for text in (b"first", b"second"):
            with socket.create_server(("127.0.0.1", port)) as server:
                client, _ = server.accept()
                with client:
                    client.sendall(text)
                    received.wait_for(lambda s, text=text: s.data.endswith(text))
    assert received.data == b"firstsecond"
    assert [sentence.partition(":")[0] for sentence in received.sentence][:4] == ["lost", "connected again"] * 2


def test_tcp_that_is_not_to_be_tried_again_ends(port):
    with Listener(f"tcp://127.0.0.1:{port}?retry=0") as received:
        received.wait_for(lambda s: not s.thread.is_alive())
    assert received.sentence == ["ended: Connection refused"]


def test_a_serial_line_whose_cable_is_pulled(tmp_path):
    pytest.importorskip("serial")
    link, ends = tmp_path / "ttyTEST", []
    with Listener(f"serial:{link}?baud=230400") as received:
        received.wait_for(lambda s: s.sentence)
        for text in (b"one\n", b"two\n"):
            ends = os.openpty()
            os.symlink(os.ttyname(ends[1]), link)
            time.sleep(0.3)
            os.write(ends[0], text)
            received.wait_for(lambda s, text=text: s.data.replace(b"\r", b"").endswith(text))
            link.unlink()
            for end in ends:
                os.close(end)
    assert received.data.replace(b"\r", b"") == b"one\ntwo\n"
    assert [sentence.partition(":")[0] for sentence in received.sentence][:4] == ["lost", "connected again"] * 2


def test_a_websocket(port):
    pytest.importorskip("websockets")
    from websockets.sync.server import serve

    def handle(connection):
        connection.send("text ")
        connection.send(b"\x00bytes")

    with serve(handle, "127.0.0.1", port) as server:
        thread = threading.Thread(target=server.serve_forever)
        thread.start()
        with Listener(f"ws://127.0.0.1:{port}/imu?retry=0") as received:
            received.wait_for(lambda s: not s.thread.is_alive())
        server.shutdown()
        thread.join(LONGEST_S)
    assert received.data == b"text \x00bytes"


def broker(server, payloads, topics):
    """A broker of MQTT 3.1.1 with one client: takes its connection and subscription, and publishes."""
    client, _ = server.accept()
    with client:
        client.recv(1000)  # CONNECT
        client.sendall(b"\x20\x02\x00\x00")
        packet = client.recv(1000)  # SUBSCRIBE: type, length, identifier (2), length of the topic (2), topic, quality
        topics.append(packet[6:-1].decode())
        client.sendall(b"\x90\x03" + packet[2:4] + b"\x00")
        for payload in payloads:
            body = packet[4:-1] + payload
            client.sendall(bytes((0x30, len(body))) + body)
        client.recv(1000)  # until it goes


def test_a_topic_of_mqtt(port):
    pytest.importorskip("paho.mqtt")
    topics = []
    with socket.create_server(("127.0.0.1", port)) as server:
        thread = threading.Thread(target=broker, args=(server, [b"one", b"two"], topics))
        thread.start()
        with Listener(f"mqtt://127.0.0.1:{port}/vehicle/imu") as received:
            received.wait_for(lambda s: s.data == b"onetwo")
        thread.join(LONGEST_S)
    assert topics == ["vehicle/imu"]
    assert received.sentence == ["connected"]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("drive.csv", r"expected an address that begins with .* a log is replayed with replay:drive.csv"),
        ("udp://5000", "expected SCHEME://HOST:PORT"),
        ("tcp://:0", "a port from 1 to 65535"),
        ("serial:", "expected serial: and a file or device"),
        ("serial:/dev/x?bauds=3", "'bauds' is not known; did you mean 'baud'"),
        ("udp://:5000?", "expected NAME=VALUE after the question mark"),
    ],
)
def test_addresses_that_are_none(text, message):
    with pytest.raises(InputError, match=message):
        parse_source(text)


def test_a_baud_rate_that_is_none():
    pytest.importorskip("serial")
    with pytest.raises(InputError, match="baud: expected a number from 0 on, got 'fast'"):
        chunks(parse_source("serial:/dev/ttyUSB0?baud=fast"), threading.Event(), print)


def test_hosts_ports_and_options():
    address = parse_source("mqtt://broker.local:1883/vehicle/imu?format=text&columns=t,ax")
    assert (address.host, address.port, address.path) == ("broker.local", 1883, "vehicle/imu")
    assert address.options == {"format": "text", "columns": "t,ax"}
    assert parse_source("udp://:5000").host == "127.0.0.1"
    assert parse_source("udp://0.0.0.0:5000").host == "0.0.0.0"
    assert parse_source("-").scheme == "stdin"
