"""Health of a live run for those who watch over it: an HTTP endpoint, and the watchdog of systemd."""

from __future__ import annotations

import json
import math
import os
import socket
import threading
import time
from collections import Counter
from collections.abc import Callable
from contextlib import suppress
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any

from schuler import units
from schuler.exceptions import InputError
from schuler.live.address import LOOPBACK
from schuler.live.messages import Event, Fix, Health, ImuBlock, ImuSample, Message, Solution

STALE_S = 10.0  # without a sample of the IMU, after which a run is not well whatever its solution was [s]
_SLOWEST_S = 5.0  # for a client to say what it wants [s]


class HealthReport:
    """Sink that remembers what there is to say about a run.

    Parameters
    ----------
    health : callable
        Health of the run now.
    """

    def __init__(self, health: Callable[[], Health]) -> None:
        self._health = health
        self._newest: Solution | None = None
        self._sample_s = self._fix_s = math.nan  # when the last ones came, by the machine's own counter [s]
        self._began_s = time.monotonic()
        self._events: Counter[str] = Counter()
        self._messages: Counter[str] = Counter()

    def solution(self, solution: Solution) -> None:
        """Take a solution."""
        self._newest = solution

    def event(self, event: Event) -> None:
        """Count an event."""
        self._events[event.kind] += 1

    def message(self, message: Message) -> None:
        """Remember when a message came."""
        self._messages[type(message).__name__] += 1
        if isinstance(message, ImuSample | ImuBlock):
            self._sample_s = time.monotonic()
        elif isinstance(message, Fix):
            self._fix_s = time.monotonic()

    def document(self) -> tuple[bool, dict[str, Any]]:
        """Whether the run is well, and what is said of it in JSON.

        Returns
        -------
        well : bool
            Not failed, and not without a sample for :data:`STALE_S`, counted from the beginning.
        document : dict
            ``health``, ``age_of_sample_s``, ``age_of_fix_s`` (since they came; None before), 1-sigmas, counts, memory.
        """
        now, health, newest = time.monotonic(), self._health(), self._newest
        silent = now - (self._began_s if math.isnan(self._sample_s) else self._sample_s)
        stale = silent > STALE_S
        document: dict[str, Any] = {
            "health": health, "stale": stale, "running_s": now - self._began_s,
            "age_of_sample_s": now - self._sample_s, "age_of_fix_s": now - self._fix_s,
        }  # fmt: skip
        if newest is not None:
            document |= {
                "t_s": newest.t, "sigma_horizontal_m": math.hypot(*newest.sigma_r_n[:2].tolist()),
                "sigma_vertical_m": float(newest.sigma_r_n[2]),
                "sigma_heading_deg": float(newest.sigma_psi_n[2]) / units.DEG,
            }  # fmt: skip
        document |= {
            "messages": dict(self._messages), "events": dict(self._events), "memory_mb": resident_bytes() * 1e-6
        }  # fmt: skip
        return health != "failed" and not stale, {
            k: None if isinstance(v, float) and not math.isfinite(v) else v for k, v in document.items()
        }


class HealthEndpoint:
    """HTTP server of a report, in threads of its own: 200 while the run is well, 503 otherwise.

    Parameters
    ----------
    place : str
        ``HOST:PORT``; loopback if the host is left out.
    report : HealthReport

    Raises
    ------
    InputError
        If the place is none, or taken.
    """

    def __init__(self, place: str, report: HealthReport) -> None:
        host, _, port = place.rpartition(":")
        if not port.isdecimal() or int(port) > 65_535:
            raise InputError(f"--health {place}: expected HOST:PORT, such as 127.0.0.1:8080")
        try:
            self._server = _Server((host or LOOPBACK, int(port)), _Handler)
        except OSError as error:
            raise InputError(f"--health {place}: cannot listen there: {error.strerror}; name another port") from None
        self._server.report = report
        threading.Thread(target=self._server.serve_forever, kwargs={"poll_interval": 0.1}, daemon=True).start()

    @property
    def port(self) -> int:
        """Port that is listened to."""
        return int(self._server.server_address[1])

    def close(self) -> None:
        """Let go of the port."""
        self._server.shutdown()
        self._server.server_close()


class _Server(ThreadingHTTPServer):
    daemon_threads = True
    block_on_close = False
    report: HealthReport


class _Handler(BaseHTTPRequestHandler):
    timeout = _SLOWEST_S
    server: _Server

    def do_GET(self) -> None:
        """Answer with the report."""
        well, document = self.server.report.document()
        body = json.dumps(document).encode() + b"\n"
        self.send_response(200 if well else 503)
        self.send_header("Content-Type", "application/json")
        self.send_header("Content-Length", str(len(body)))
        self.end_headers()
        self.wfile.write(body)

    def log_message(self, format: str, *args: Any) -> None:
        """Requests are not said."""


class Watchdog:
    """Notices to systemd, where it asks for them (``Type=notify``, ``WatchdogSec=``); otherwise nothing."""

    def __init__(self) -> None:
        self._place = os.environ.get("NOTIFY_SOCKET", "")
        microseconds = os.environ.get("WATCHDOG_USEC", "")
        self._every_s = 0.5e-6 * int(microseconds) if microseconds.isdecimal() else math.inf
        self._next_s = time.monotonic()
        self.notify("READY=1")

    def alive(self) -> None:
        """Say that the run goes on, twice as often as it is asked for."""
        if (now := time.monotonic()) >= self._next_s and self._every_s < math.inf:
            self._next_s = now + self._every_s
            self.notify("WATCHDOG=1")

    def notify(self, text: str) -> None:
        """Send one notice; nobody listening is no error."""
        if not self._place or not hasattr(socket, "AF_UNIX"):
            return
        place = "\0" + self._place[1:] if self._place.startswith("@") else self._place
        with suppress(OSError), socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as notices:
            notices.setblocking(False)
            notices.sendto(text.encode(), place)


def resident_bytes() -> float:
    """Memory of this process that is in use now; NaN where the system has no /proc. [byte]"""
    with suppress(OSError):
        return float(Path("/proc/self/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE")
    return math.nan
