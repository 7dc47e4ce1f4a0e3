"""Sinks of a live run: lines of text to an outlet, and a table of the solution."""

from __future__ import annotations

import importlib.util
import queue
import threading
from pathlib import Path
from typing import Any

import numpy as np

from schuler import frames, rotation
from schuler.arrays import FloatArray
from schuler.exceptions import InputError, MissingExtraError
from schuler.live.clock import SourceClock
from schuler.live.messages import Event, Solution
from schuler.live.outlets import Outlet, open_outlet
from schuler.live.sentences import columns_of, json_of, nmea_of
from schuler.navigation.solution_tables import SOLUTION_FORMAT
from schuler.recording.io.columns import check_known
from schuler.recording.io.own import time_document
from schuler.timebase import TimeBase

FORMATS = ("json", "nmea")
_BEGINNINGS = {"json": '{"t_s": ', "nmea": "$IN"}  # of the first line
_ROWS = 2000  # solutions that are written together


class LineSink:
    """Solutions and events as lines to an outlet; events are left out of NMEA.

    Parameters
    ----------
    format : {"json", "nmea"}
    outlet : Outlet
    clock : SourceClock
    geoid_separation : float
        See :func:`~schuler.live.sentences.nmea_of`. [m]
    """

    def __init__(self, format: str, outlet: Outlet, clock: SourceClock, geoid_separation: float = 0.0) -> None:
        self._json = check_known(format, FORMATS, "format of lines") == "json"
        self._outlet, self._clock, self._separation = outlet, clock, geoid_separation

    def solution(self, solution: Solution) -> None:
        """Write a solution."""
        base = self._clock.base
        self._outlet.write(json_of(solution, base) + "\n" if self._json else nmea_of(solution, base, self._separation))

    def event(self, event: Event) -> None:
        """Write an event."""
        if self._json:
            self._outlet.write(json_of(event, self._clock.base) + "\n")

    def close(self) -> None:
        """Let go of the outlet."""
        self._outlet.close()


def open_line_sink(text: str, clock: SourceClock, geoid_separation: float = 0.0) -> LineSink:
    """Line sink of ``FORMAT:PLACE``, such as ``json:-``, ``nmea:udp://:10110`` or ``json:live.jsonl``.

    Raises
    ------
    InputError
        If it is not of that form, or the place cannot be opened or holds something else.
    """
    format, colon, place = text.partition(":")
    if not colon or not place or format not in FORMATS:
        raise InputError(
            f"--out {text}: expected FORMAT:PLACE with one of {', '.join(FORMATS)} and -, a file, udp://HOST:PORT, "
            "tcp://HOST:PORT or ws://HOST:PORT, such as nmea:udp://:10110; or mcap:FILE, "
            "foxglove:ws://HOST:PORT, mavlink:udp://HOST:PORT"
        )
    return LineSink(format, open_outlet(place, _BEGINNINGS[format]), clock, geoid_separation)


class SolutionTable:
    """Solutions as a file of the format of ``schuler navigate``, which takes its name when it is closed.

    Parameters
    ----------
    path : Path
    clock : SourceClock
        Its time base is written with the file.
    smoothed : bool
        What the file says of its solutions.

    Raises
    ------
    MissingExtraError
        Without pyarrow (extra ``data``).
    """

    def __init__(self, path: Path, clock: SourceClock, smoothed: bool = False) -> None:
        if importlib.util.find_spec("pyarrow") is None:  # said now, and not after days
            raise MissingExtraError("pyarrow", "data", "recording a solution")
        self._path, self._clock, self._smoothed = path, clock, smoothed
        self._rows: list[Solution] = []
        self._parts: queue.SimpleQueue[dict[str, Any] | None] = queue.SimpleQueue()
        self._thread: threading.Thread | None = None
        self._error: list[Exception] = []
        self._last = -np.inf

    def solution(self, solution: Solution) -> None:
        """Take a solution; one that is not later than the last is left out, as in every trajectory."""
        if not solution.t > self._last:
            return
        self._last = solution.t
        self._rows.append(solution)
        if len(self._rows) >= _ROWS:
            self._flush()

    def event(self, event: Event) -> None:
        """Events are not of a trajectory."""

    def close(self) -> Path | None:
        """Complete the file; ``None`` if there was no solution.

        Raises
        ------
        OSError
            If it cannot be written.
        """
        if self._rows:
            self._flush()
        if self._thread is None:
            return None
        self._parts.put(None)
        self._thread.join()
        if self._error:
            raise self._error[0]
        return self._path

    def _flush(self) -> None:
        self._parts.put(solution_columns(self._rows))
        self._rows = []
        if self._thread is None:
            self._thread = threading.Thread(target=self._run, args=(self._clock.base or TimeBase(),), daemon=True)
            self._thread.start()

    def _run(self, base: TimeBase) -> None:
        meta = {
            "format": SOLUTION_FORMAT, "smoothed": self._smoothed, "live": True,
            "provenance": {"time": time_document(base)},
        }  # fmt: skip
        parts = iter(self._parts.get, None)
        try:
            from schuler.recording.formats.parquet import write_table

            write_table(self._path, parts, meta)
        except Exception as error:  # goes on where the table is closed
            self._error.append(error)


def solution_columns(solutions: list[Solution]) -> dict[str, FloatArray]:
    """Columns of a solution file, see :func:`schuler.navigation.solution_tables.write_solution`.

    Parameters
    ----------
    solutions : list of Solution
    """
    rows = [columns_of(solution) for solution in solutions]
    columns = {"t_s": np.array([solution.t for solution in solutions])}
    columns |= {name: np.array([row[name] for row in rows]) for name in rows[0]}
    llh = np.array([solution.llh for solution in solutions])
    C_nb = rotation.dcm_from_rpy(np.array([solution.rpy_nb for solution in solutions]))
    q = rotation.quat_from_dcm(frames.C_en(llh) @ C_nb)
    columns |= {f"q_eb_{c}": q[:, i] for i, c in enumerate("wxyz")}
    r = frames.ecef_from_llh(llh)
    return columns | {f"{c}_ecef_m": r[:, i] for i, c in enumerate("xyz")}
