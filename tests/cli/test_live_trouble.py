"""What may go wrong between wires and clients of ``schuler live``: the solution stays that of the good messages."""

import contextlib
import json
import socket
import sys
import time

import numpy as np
import pytest
from command import refusal, run
from tests.cli.test_live import CONFIG, compare, log, read_lines  # noqa: F401  fixtures
from tests.live.test_decoders import novatel_log, sbf_log, vectornav_log

import schuler
from schuler.files import write_text

LONGEST_S = 20.0


LOGS = {"vectornav": vectornav_log, "novatel": novatel_log, "sbf": sbf_log}


@pytest.mark.campaign
@pytest.mark.thinned(3)
@pytest.mark.parametrize("format", list(LOGS))
def test_garbage_and_half_messages_between_good_ones_change_nothing(tmp_path, capsys, monkeypatch, format):
    """Random bytes, beginnings of messages and messages with a byte changed, each before a good one."""
    rng, good = np.random.default_rng(3), LOGS[format]()
    made = []
    for packet in good:
        kind = rng.integers(0, 12)
        if kind == 0:
            made.append(rng.bytes(int(rng.integers(1, 300))))
        elif kind == 1:
            made.append(packet[: int(rng.integers(1, len(packet)))])
        elif kind == 2:
            at = int(rng.integers(0, len(packet)))
            made.append(packet[:at] + bytes([packet[at] ^ 0x10]) + packet[at + 1 :])
        made.append(packet)
    (tmp_path / "good.bin").write_bytes(b"".join(good))
    (tmp_path / "bad.bin").write_bytes(b"".join(made))
    config = write_text(tmp_path / "drive.toml", CONFIG.partition("[recording.imu]")[0])
    trajectory = schuler.navigate(schuler.read(tmp_path / "good.bin"), config).trajectory
    out = tmp_path / "live.jsonl"
    with (tmp_path / "bad.bin").open("rb") as file:
        monkeypatch.setattr(sys, "stdin", file)
        code, _, err = run(capsys, "live", f"stdin:?format={format}", "--config", config, "--out", f"json:{out}")
    assert code == 0, err
    assert compare(read_lines(out), trajectory, in_time=False) > 40
    assert "bytes that belong to no message with a right checksum" in err


@pytest.fixture
def more_ports():
    sockets = [socket.socket() for _ in range(4)]
    for s in sockets:
        s.bind(("127.0.0.1", 0))
    numbers = [s.getsockname()[1] for s in sockets]
    for s in sockets:
        s.close()
    return numbers


def patient(port):
    """A connection to a port that is listened to soon."""
    began = time.monotonic()
    while True:
        try:
            return socket.create_connection(("127.0.0.1", port))
        except ConnectionRefusedError:
            assert time.monotonic() - began < LONGEST_S
            time.sleep(0.01)


@pytest.mark.campaign
@pytest.mark.parametrize("rate", [10, pytest.param(0, marks=pytest.mark.campaign)])
def test_clients_that_say_or_read_nothing_hold_up_nothing(log, tmp_path, capsys, monkeypatch, more_ports, rate):  # noqa: F811
    """At every outlet one connects and says nothing; at TCP one that reads nothing, too: the run is the batch run."""
    pytest.importorskip("foxglove")
    monkeypatch.setattr("schuler.live.outlets.CLOSED_S", 0.1)
    folder, config, trajectory = log
    out = tmp_path / "live.jsonl"
    tcp, ws, foxglove, health = more_ports
    clients = []

    def connected(*_, **__):
        clients.extend(patient(port) for port in (tcp, tcp, ws, foxglove, health))

    from schuler.live import session

    begin = session.Summary
    monkeypatch.setattr(session, "Summary", lambda: (connected(), begin())[1])
    with contextlib.ExitStack() as held:
        held.callback(lambda: [client.close() for client in clients])
        code, printed, err = run(
            capsys, "live", f"replay:{folder}?speed=0", "--config", config, "--output-rate", rate, "--json", "--out",
            f"json:{out}", "--out", f"json:tcp://:{tcp}", "--out", f"json:ws://:{ws}", "--out",
            f"foxglove:ws://:{foxglove}", "--health", f":{health}",
        )  # fmt: skip
    assert len(clients) == 5
    assert code == 0, err
    assert compare(read_lines(out), trajectory) == json.loads(printed)["solutions"] > 100
    assert json.loads(printed)["elapsed_s"] < 60.0


@pytest.mark.parametrize("place", ["json:tcp", "json:ws", "foxglove:ws", "health"])
def test_ports_that_are_taken_are_refused(log, capsys, more_ports, place):  # noqa: F811
    pytest.importorskip("foxglove" if place.startswith("foxglove") else "websockets")
    option = ["--health", f":{more_ports[0]}"] if place == "health" else ["--out", f"{place}://:{more_ports[0]}"]
    with socket.create_server(("127.0.0.1", more_ports[0])):
        assert "cannot listen there" in refusal(capsys, "live", f"replay:{log[0]}", "--config", log[1], *option)
