"""From the clock of an autopilot, which counts since it was switched on, to GPS time by the fixes it logged."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from schuler.arrays import FloatArray
from schuler.recording.io.parts import Table
from schuler.timebase import WEEK_S, TimeBase

_BLOCKS = 20
_SHORTEST_BLOCK = 10.0  # [s]
_LONG_ENOUGH = 120.0  # span from which a rate of the clock can be told from the jitter of messages [s]
_WILD = 1.0  # a fix whose clocks differ by more from the rest has a wrong time [s]
_FASTEST = 5e-4  # rate beyond any quartz [-]


@dataclass(frozen=True, slots=True)
class ClockMap:
    """GPS time of a log's clock: ``gps = boot + offset + rate (boot - zero)``.

    Attributes
    ----------
    zero : float
        [s]
    offset : float
        [s]
    rate : float
        Rate of GPS time against the log's clock, minus one. [-]
    jitter : float
        Median delay of the messages behind the fastest of them. [s]
    """

    zero: float
    offset: float
    rate: float
    jitter: float

    def gps(self, boot: FloatArray, start: float = 0.0) -> FloatArray:
        """GPS time, counted from ``start``, of times of the log's clock. Shape (n,). [s]

        The start is taken off first: seconds since 1980 have no digits left for the intervals of an IMU.
        """
        return boot + ((self.offset - start) + self.rate * (boot - self.zero))

    def note(self) -> str:
        """Sentence on the fitted line for the notes."""
        drift = f" and its rate ({self.rate / 1e-6:+.1f} ppm)" if self.rate else ""
        return (
            f"The log's clock was related to GPS time by the times of its fixes{drift}: the fastest message counts as "
            f"not delayed, the median one came {self.jitter * 1e3:.0f} ms later. What delay the fastest has is not "
            "known (a tenth of a second is usual): the IMU's stamps are early by it."
        )


def relate(boot: FloatArray, gps: FloatArray) -> ClockMap | None:
    """Relation of two clocks from messages that come late by unknown, changing amounts.

    Parameters
    ----------
    boot : ndarray, shape (n,)
        When each fix came in, on the log's clock. [s]
    gps : ndarray, shape (n,)
        Time of validity of the fix. [s]

    Returns
    -------
    ClockMap or None
        ``None`` if no two fixes agree on the relation to a second.

    Notes
    -----
    A message never comes before its fix, so the log's clock is behind GPS time by the smallest difference seen. With
    two minutes or more the smallest differences of blocks of time give the clock's rate, by a straight line.
    """
    lead = gps - boot
    good = np.flatnonzero(np.isfinite(lead))
    if len(good) < 2:
        return None
    good = good[np.abs(lead[good] - np.median(lead[good])) < _WILD]
    if len(good) < 2:
        return None
    t, y = boot[good], lead[good]
    zero, base = float(t[0]), float(np.median(y))
    y = y - base
    rate = 0.0
    span = float(t[-1] - t[0])
    if span >= _LONG_ENOUGH:
        width = max(_SHORTEST_BLOCK, span / _BLOCKS)
        block = ((t - zero) // width).astype(int)
        firsts = [np.flatnonzero(block == k)[np.argmax(y[block == k])] for k in np.unique(block)]
        if len(firsts) >= 4:
            slope = float(np.polyfit(t[firsts] - zero, y[firsts], 1)[0])
            rate = slope if abs(slope) < _FASTEST else 0.0
    rest = y - rate * (t - zero)
    highest = float(rest.max())
    return ClockMap(zero, base + highest, rate, float(np.median(highest - rest)))


def on_gps_time(tables: dict[str, Table], notes: list[str]) -> TimeBase:
    """Bring all tables to GPS time by the fixes; the log's own clock if there are none.

    Parameters
    ----------
    tables : dict of str to Table
        With ``t`` on the log's clock [s]; that of "gnss" also with ``gps``, the GPS time of each fix, NaN where it is
        not known [s]. Changed in place: ``t`` becomes time of the first fix's week, that of GNSS the fixes' own with
        ``received`` as the time they came in.
    notes : list of str
        Takes what was done.
    """
    gnss = tables.get("gnss")
    clocks = None if gnss is None else relate(gnss.values["t"], gnss.values["gps"])
    if gnss is None or clocks is None:
        notes.append("Nothing relates the log's clock (seconds since it was switched on) to GPS time.")
        return TimeBase("local")
    notes.append(clocks.note())
    gps = gnss.values["gps"]
    gps = np.where(np.isfinite(gps), gps, clocks.gps(gnss.values["t"]))
    start = float(gps[0] // WEEK_S * WEEK_S)
    for series, table in tables.items():
        on_gps = clocks.gps(table.values["t"], start)
        if series == "gnss":
            table.values["received"] = on_gps
            table.values["t"] = gps - start
        else:
            table.values["t"] = on_gps
    return TimeBase("gps", start)
