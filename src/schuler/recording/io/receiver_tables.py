"""GPS time in weeks and seconds, and columns of a solution, in logs of receivers and inertial units."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from schuler.arrays import BoolArray, FloatArray, IntArray
from schuler.recording.io import parts
from schuler.recording.io.streams import Stream, choose
from schuler.timebase import WEEK_S, TimeBase

NO_VELOCITY = 1000.0  # 1-sigma of a velocity that is missing at single epochs [m/s]
RATE_ERROR = 0.1  # 1-sigma of a receiver's velocity that comes without one; a rule of thumb [m/s]
_LONG_ENOUGH = 120.0  # span from which the rate of a clock can be told [s]
_WILD = 1.0  # a pair of times that differs by more from the rest is wrong [s]
_LAST_WEEK = 6000  # GPS weeks beyond are no weeks (2094)

Columns = dict[str, FloatArray]


def floats(values: np.ndarray[Any, np.dtype[Any]]) -> FloatArray:
    """Numbers of any kind as float64; a signalling not-a-number stays one without a warning. Shape as given."""
    with np.errstate(invalid="ignore"):
        return values.astype(np.float64)


def weeks_to_seconds(week: FloatArray, sow: FloatArray, start_week: float) -> FloatArray:
    """Seconds from the start of a GPS week, without the digits lost in seconds since 1980. Shape (n,). [s]"""
    return (week - start_week) * WEEK_S + sow


def timed(week: FloatArray, sow: FloatArray) -> BoolArray:
    """Whether a week and its seconds can be a time of GPS: receivers write zeros until they know it. Shape (n,)."""
    return (week >= 1.0) & (week < _LAST_WEEK) & (sow >= 0.0) & (sow < WEEK_S + 1.0)


def base_of(week: float) -> TimeBase:
    """GPS time from the start of a week."""
    return TimeBase("gps", float(week) * WEEK_S)


def pick(rows: Mapping[str, FloatArray], keep: FloatArray | BoolArray) -> Columns:
    """The rows selected of every column."""
    return {name: values[keep] for name, values in rows.items()}


def keep_timed(rows: Columns, week: str, sow: str, what: str, path: Path, notes: list[str]) -> Columns:
    """Rows with a time that is later than all before them; the others are counted in notes."""
    good = timed(rows[week], rows[sow])
    if not good.all():
        notes.append(f"{what}: {int((~good).sum())} messages before the receiver knew the time were left out.")
    rows = pick(rows, good)
    if not len(rows[week]):
        return rows
    t = weeks_to_seconds(rows[week], rows[sow], rows[week][0])
    return pick(rows, parts.later(t, what, path, notes))


def preferred(
    streams: list[Stream], part: str, chosen: dict[str, str | None], order: Iterable[str], notes: list[str]
) -> str | None:
    """Stream of a part: as the hint says, else the first of an order that is there, with a note on the others."""
    if part in chosen:
        stream = choose(streams, part, chosen)
        return None if stream is None else stream.name
    present = [name for name in order if any(s.name == name and s.part == part and s.count > 0 for s in streams)]
    if not present:
        return None
    if len(present) > 1:
        notes.append(
            f"{part}: {present[0]} was read, {', '.join(present[1:])} too could be (streams='{part}={present[1]}')."
        )
    return present[0]


def velocity_at(t: FloatArray, t_v: FloatArray, v: FloatArray, farthest: float) -> tuple[FloatArray, BoolArray]:
    """Velocities at other times, straight between their own, and whether one is near enough.

    Parameters
    ----------
    t : ndarray, shape (n,)
        [s]
    t_v : ndarray, shape (m,)
        Increasing. [s]
    v : ndarray, shape (m, 3)
        [m/s]
    farthest : float
        From the nearest velocity. [s]

    Returns
    -------
    v : ndarray, shape (n, 3)
        Zero where none is near.
    near : ndarray of bool, shape (n,)
    """
    if not len(t_v):
        return np.zeros((len(t), 3)), np.zeros(len(t), dtype=bool)
    after = np.clip(np.searchsorted(t_v, t), 0, len(t_v) - 1)
    before = np.clip(after - 1, 0, None)
    near = np.minimum(np.abs(t_v[after] - t), np.abs(t_v[before] - t)) <= farthest
    velocity = np.stack([np.interp(t, t_v, v[:, k]) for k in range(3)], axis=1)
    return np.where(near[:, None], velocity, 0.0), near


@dataclass(frozen=True, slots=True)
class ClockLine:
    """GPS time of a clock's time: ``gps = gps_at_zero + (1 + rate) (t - zero)``.

    Attributes
    ----------
    gps_at_zero, zero : float
        [s]
    rate : float
        Rate of GPS time against the clock, minus one. [-]
    worst : float
        Largest difference of a pair from the line. [s]
    """

    gps_at_zero: float
    zero: float
    rate: float
    worst: float

    def seconds(self, t: FloatArray, epoch: float) -> FloatArray:
        """GPS time since an epoch of times of the clock. Shape (n,). [s]"""
        return np.asarray((self.gps_at_zero - epoch) + (t - self.zero) + self.rate * (t - self.zero))

    def note(self, clock: str, by: str) -> str:
        """Sentence on the fitted line for the notes."""
        drift = f" and their rate ({self.rate / 1e-6:+.1f} ppm)" if self.rate else ""
        return (
            f"Samples are timed by {clock}, which {by} relates to GPS time by its offset{drift}; single pairs differ "
            f"from that by up to {self.worst * 1e3:.2g} ms."
        )


def clock_line(t: FloatArray, gps_whole: FloatArray, gps_rest: FloatArray) -> ClockLine | None:
    """Line through pairs of a clock's times and GPS times that belong to the same instants.

    Parameters
    ----------
    t : ndarray, shape (n,)
        [s]
    gps_whole, gps_rest : ndarray, shape (n,)
        Seconds since 1980 in two parts, which together have the digits. [s]

    Returns
    -------
    ClockLine or None
        ``None`` for fewer than two pairs. The rate is estimated from two minutes on.
    """
    if len(t) < 2:
        return None
    zero, whole = float(t[0]), float(gps_whole[0])
    lead = (gps_whole - whole) + gps_rest - (t - zero)
    at_zero, rate = float(np.median(lead)), 0.0
    good = np.abs(lead - at_zero) < _WILD
    if not good.any():  # the middle of two that contradict each other is near neither
        return None
    if t[good][-1] - t[good][0] >= _LONG_ENOUGH:
        rate, at_zero = (float(c) for c in np.polyfit(t[good] - zero, lead[good], 1))
    rest = lead[good] - at_zero - rate * (t[good] - zero)
    return ClockLine(whole + at_zero, zero, rate, float(np.abs(rest).max()))


def unwrapped(value: FloatArray, period: float) -> FloatArray:
    """A counter without its falls back to zero; only falls by more than half of its period are such. Shape (n,)."""
    falls = np.concatenate(([0.0], np.cumsum(np.diff(value) < -0.5 * period)))
    return np.asarray(value + period * falls[: len(value)])


def same_time(key: IntArray, of: IntArray) -> IntArray:
    """Row of ``of`` with each key, -1 where there is none; ``of`` need not be in order. Shapes (n,), (m,)."""
    if not len(of):
        return np.full(len(key), -1, dtype=np.int64)
    order = np.argsort(of, kind="stable")
    place = np.clip(np.searchsorted(of[order], key), 0, len(of) - 1)
    return np.where(of[order][place] == key, order[place], -1)
