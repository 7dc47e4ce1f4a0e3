"""Where the solutions of ``schuler live`` go: lines, tables, publishers, what came over the wire, the status line."""

from __future__ import annotations

import gc
import itertools
import os
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from schuler import units
from schuler.cli.output import say
from schuler.exceptions import printable

if TYPE_CHECKING:
    from schuler.live.address import Address
    from schuler.live.clock import SourceClock
    from schuler.live.messages import Event, Health, Solution
    from schuler.live.publishing import Publisher
    from schuler.live.sinks import SolutionTable
    from schuler.navigation.result import NavigationResult
    from schuler.recording.series import Kind

_REDRAWN_S = 0.25  # between two drawings of the status line [s]
_SUFFIX = {"nmea": "nmea", "ubx": "ubx", "text": "txt"}
_COLOURS = {"ok": "green", "coasting": "yellow", "doubtful": "yellow", "failed": "bold red", "aligning": "cyan"}


@dataclass
class Outlets:
    """What takes the solutions, events and bytes of a run.

    Attributes
    ----------
    folder : Path or None
        Of what is recorded.
    sinks, smoothed : list of Sink
        Take the newest solutions, and the smoothed ones.
    publishers : list of Publisher
        Those of the sinks that take all input too.
    tables : dict of str to SolutionTable
        Files of the folder.
    kind : {"rate", "increment"}
        Of the IMU, once its source is connected.
    """

    folder: Path | None
    sinks: list[Any] = field(default_factory=list)
    smoothed: list[Any] = field(default_factory=list)
    publishers: list[Publisher] = field(default_factory=list)
    tables: dict[str, SolutionTable] = field(default_factory=dict)
    kind: Kind = "rate"

    def event(self, event: Event) -> None:
        """Give all sinks an event."""
        for sink in self.sinks:
            sink.event(event)
        if event.kind in ("start", "state"):
            # everything is loaded now; later collections pass it by, which took tens of milliseconds
            gc.unfreeze()
            gc.collect()
            gc.freeze()

    def keeper(self, held: ExitStack) -> Callable[[int, Address], Callable[[bytes], None] | None]:
        """Functions that keep the bytes of each source: in a file, which stays after a kill, and on its topic."""

        def keep(k: int, address: Address) -> Callable[[bytes], None] | None:
            if self.folder is None and not self.publishers:
                return None
            handle: int | None = None
            if self.folder is not None:
                suffix = _SUFFIX.get(address.options.get("format", ""), "bin")
                path = self.folder / f"source-{k + 1}.{suffix}"
                path.parent.mkdir(parents=True, exist_ok=True)
                handle = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_APPEND, 0o666)
                held.callback(os.close, handle)

            def take(data: bytes) -> None:
                if handle is not None:
                    os.write(handle, data)
                for publisher in self.publishers:
                    publisher.raw(k, data)

            return take

        return keep

    def close_tables(self) -> dict[str, Path]:
        """Complete the tables, and name their files; say what publishers left out."""
        lost = sum(publisher.lost for publisher in self.publishers)
        if lost:
            say(f"{lost} messages were left out of mcap or foxglove, which did not follow", "warning")
        return {name: path for name, table in self.tables.items() if (path := table.close()) is not None}


def open_outlets(
    out: Sequence[str],
    record: Path | None,
    clock: SourceClock,
    geoid_separation: float,
    is_smoothed: bool,
    held: ExitStack,
) -> Outlets:
    """Outlets of ``--out`` and ``--record``, closed by ``held``; tables are closed by themselves."""
    from schuler.live.mavlink import MavlinkSink
    from schuler.live.publishing import FORMATS, open_publisher
    from schuler.live.sinks import SolutionTable, open_line_sink

    outlets = Outlets(record)
    for text in out:
        if text.partition(":")[0] in FORMATS:
            outlets.publishers.append(open_publisher(text, clock, lambda: outlets.kind))
            outlets.sinks.append(outlets.publishers[-1])
        elif text.startswith("mavlink:"):
            outlets.sinks.append(MavlinkSink(text.removeprefix("mavlink:"), clock, geoid_separation))
        else:
            outlets.sinks.append(open_line_sink(text, clock, geoid_separation))
        held.callback(outlets.sinks[-1].close)
        # NMEA and MAVLink have no word for what is no longer so
        if is_smoothed and not text.startswith(("nmea:", "mavlink:")):
            outlets.smoothed.append(outlets.sinks[-1])
    if record is not None:
        outlets.tables["solution"] = SolutionTable(_free_name(record), clock)
        outlets.sinks.append(outlets.tables["solution"])
        if is_smoothed:
            outlets.tables["smoothed"] = SolutionTable(_free_name(record, "smoothed"), clock, smoothed=True)
            outlets.smoothed.append(outlets.tables["smoothed"])
    return outlets


def stride_sender(sinks: Sequence[Any], rate_hz: float) -> Callable[[NavigationResult, Health, float], None]:
    """Function that sends the smoothed solutions of a stride to sinks, so many in a second."""
    from schuler.live.foot import stride_solutions

    sent = -np.inf

    def send(stride: NavigationResult, health: Health, newest: float) -> None:
        nonlocal sent
        for solution in stride_solutions(stride, health, newest) if sinks else ():
            if rate_hz > 0.0 and solution.t < sent + (1.0 - 1e-6) / rate_hz:
                continue
            sent = solution.t
            for sink in sinks:
                sink.solution(solution)

    return send


def _free_name(folder: Path, table: str = "solution") -> Path:
    """Name of the next table of a folder, which a service that is started again goes on to fill."""
    names = (folder / f"{table}{'' if k == 1 else f'-{k}'}.parquet" for k in itertools.count(1))
    return next(path for path in names if not path.exists())


class StatusLine:
    """Line of the newest solution on a terminal, and events above it; without a terminal events only."""

    def __init__(self, line: Any | None) -> None:
        self._line, self._drawn = line, 0.0

    def solution(self, solution: Solution) -> None:
        """Solutions are drawn when there is time."""

    def event(self, event: Event) -> None:
        """Print an event."""
        when = f"{event.t:.3f} s: " if np.isfinite(event.t) else ""
        kind = "warning" if event.kind in ("health", "decoder", "late", "clock") else ""
        text = printable(f"{when}{event.text}")
        if self._line is None:
            say(text, kind)
        else:
            self._line.console.print(text, style="yellow" if kind else None, markup=False, highlight=False)

    def draw(self, solution: Solution | None, health: Health) -> None:
        """Draw the line anew, not too often."""
        now = time.monotonic()
        if self._line is None or now - self._drawn < _REDRAWN_S:
            return
        from rich.text import Text

        self._drawn = now
        text = Text(health, style=_COLOURS[health])
        self._line.update(text if solution is None else text.append(status_text(solution), style="default"))
        self._line.refresh()


def status_text(solution: Solution) -> str:
    """Time, place, speed, heading and their 1-sigma in one line."""
    lat, lon = (solution.llh[:2] / units.DEG).tolist()
    north, east, _ = solution.v_eb_n.tolist()
    horizontal = float(np.hypot(*solution.sigma_r_n[:2]))
    return (
        f"  {solution.t:.1f} s  {lat:.7f} {lon:.7f} {solution.llh[2]:.1f} m ±{horizontal:.2f} m"
        f"  {np.hypot(north, east):.2f} m/s  heading {solution.rpy_nb[2] / units.DEG % 360.0:.1f}°"
        f" ±{solution.sigma_psi_n[2] / units.DEG:.1f}°"
    )


@contextmanager
def status_line(wanted: bool) -> Iterator[StatusLine]:
    """Status line of the terminal, if it is wanted and there is one."""
    import sys

    from schuler.cli.output import is_quiet

    if not wanted or is_quiet() or not sys.stderr.isatty():
        yield StatusLine(None)
        return
    from rich.console import Console
    from rich.live import Live

    with Live(console=Console(stderr=True), auto_refresh=False, transient=True) as line:
        yield StatusLine(line)
