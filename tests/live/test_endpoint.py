"""Health of a live run over HTTP, and notices to systemd."""

import json
import math
import socket
import time
import urllib.error
import urllib.request

import numpy as np
import pytest
from tests.live.test_outputs import solution

from schuler.exceptions import InputError
from schuler.live import endpoint
from schuler.live.endpoint import HealthEndpoint, HealthReport, Watchdog, resident_bytes
from schuler.live.messages import Event, Fix, ImuSample

SAMPLE = ImuSample(1.0, np.zeros(3), np.zeros(3))


@pytest.fixture
def served():
    """A report whose health is that of a list's last entry, and where it is served."""
    healths = ["ok"]
    report = HealthReport(lambda: healths[-1])
    server = HealthEndpoint(":0", report)
    yield healths, report, server.port
    server.close()


def asked(port):
    """Status and document of an answer."""
    try:
        with urllib.request.urlopen(f"http://127.0.0.1:{port}/", timeout=10.0) as answer:
            return answer.status, json.load(answer)
    except urllib.error.HTTPError as error:
        with error:
            return error.code, json.load(error)


@pytest.mark.parametrize(
    ("health", "status"), [("aligning", 200), ("ok", 200), ("coasting", 200), ("doubtful", 200), ("failed", 503)]
)
def test_status_follows_health(served, health, status):
    healths, report, port = served
    report.message(SAMPLE)
    healths.append(health)
    code, document = asked(port)
    assert (code, document["health"]) == (status, health)


def test_what_is_said(served):
    _, report, port = served
    _, before = asked(port)
    assert before["age_of_sample_s"] is None
    assert "sigma_vertical_m" not in before
    report.message(SAMPLE)
    report.message(Fix.from_sigmas(1.0, (0.8, 0.1, 500.0), (1.0, 1.0, 2.0)))
    report.solution(solution())
    for _ in range(3):
        report.event(Event(math.nan, "late", "came late"))
    _, document = asked(port)
    assert document["sigma_horizontal_m"] == pytest.approx(math.hypot(0.5, 0.25))
    assert document["sigma_heading_deg"] == pytest.approx(math.degrees(0.02))
    assert (document["messages"], document["events"]) == ({"ImuSample": 1, "Fix": 1}, {"late": 3})
    assert 0.0 <= document["age_of_fix_s"] <= document["age_of_sample_s"] + 1.0
    assert document["memory_mb"] == pytest.approx(1e-6 * resident_bytes(), rel=0.5)


def test_a_run_without_samples_is_not_well(served, monkeypatch):
    _, report, port = served
    report.message(SAMPLE)
    monkeypatch.setattr(endpoint, "STALE_S", 0.05)
    time.sleep(0.1)
    code, document = asked(port)
    assert (code, document["stale"], document["health"]) == (503, True, "ok")
    report.message(SAMPLE)
    monkeypatch.setattr(endpoint, "STALE_S", 10.0)
    assert asked(port)[0] == 200


def test_clients_that_say_nothing_or_nonsense_keep_nobody_waiting(served):
    _, _, port = served
    with socket.create_connection(("127.0.0.1", port)), socket.create_connection(("127.0.0.1", port)) as other:
        other.sendall(b"\x00\xff" * 100 + b"\r\n\r\n")
        assert asked(port)[0] == 200


@pytest.mark.parametrize("place", ["8080", "127.0.0.1:http", ":70000", ":"])
def test_places_that_are_none(place):
    if place == "8080":  # a port alone is one of loopback
        HealthEndpoint("0", HealthReport(lambda: "ok")).close()
        return
    with pytest.raises(InputError, match=r"expected HOST:PORT, such as 127\.0\.0\.1:8080"):
        HealthEndpoint(place, HealthReport(lambda: "ok"))


def test_a_port_that_is_taken_is_refused(served):
    with pytest.raises(InputError, match="cannot listen there"):
        HealthEndpoint(f"127.0.0.1:{served[2]}", HealthReport(lambda: "ok"))


def test_systemd_is_told(tmp_path, monkeypatch):
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as manager:
        manager.bind(str(tmp_path / "notify"))
        manager.settimeout(10.0)
        monkeypatch.setenv("NOTIFY_SOCKET", str(tmp_path / "notify"))
        monkeypatch.setenv("WATCHDOG_USEC", "100000")
        watchdog = Watchdog()
        watchdog.alive()
        watchdog.alive()  # not again so soon
        watchdog.notify("STOPPING=1")
        assert [manager.recv(100) for _ in range(3)] == [b"READY=1", b"WATCHDOG=1", b"STOPPING=1"]


def test_without_systemd_nothing_is_said(monkeypatch):
    monkeypatch.delenv("NOTIFY_SOCKET", raising=False)
    Watchdog().alive()
    monkeypatch.setenv("NOTIFY_SOCKET", "/nowhere/notify")
    Watchdog().notify("READY=1")
