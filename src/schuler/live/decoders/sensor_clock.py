"""A sensor's own clock, which pairs of its times and GPS times relate to the axis of the run as they come."""

from __future__ import annotations

import numpy as np

from schuler.arrays import BoolArray, FloatArray
from schuler.live.clock import SourceClock
from schuler.recording.io.receiver_tables import ClockLine, clock_line

_EVERY_S = 0.9  # between two pairs that are kept: sensors pair every sample, or every second [s]
_SPAN_S = 600.0  # of pairs that the line is made of [s]
_CONTRADICTS_S = 1.0  # a pair that is so far off is of another count of the sensor, or wrong [s]
_BELIEVED = 3  # pairs in a row that contradict all before them and are believed


class Counter:
    """A counter of a sensor that falls back to zero, in seconds.

    Parameters
    ----------
    period : float
        After which it falls. [s]
    """

    def __init__(self, period: float) -> None:
        self._period, self._falls, self._last = period, 0, 0.0

    def seconds(self, value: FloatArray) -> FloatArray:
        """The next values, counted on; only falls by more than half of the period are such. Shape (n,). [s]"""
        falls = self._falls + np.cumsum(np.diff(value, prepend=self._last) < -0.5 * self._period)
        if len(value):
            self._falls, self._last = int(falls[-1]), float(value[-1])
        return np.asarray(value + self._period * falls)


class SensorClock:
    """Times of a sensor on the axis of the run.

    Parameters
    ----------
    clock : SourceClock
    is_local : bool
        The sensor's clock is the axis of the run.
    """

    def __init__(self, clock: SourceClock, is_local: bool) -> None:
        self.is_local = is_local
        self._clock = clock
        self._pairs: list[tuple[float, float, float]] = []
        self._strange: list[tuple[float, float, float]] = []
        self._line: ClockLine | None = None

    def times(
        self,
        place: FloatArray,
        t: FloatArray,
        pair_place: FloatArray,
        pairs: tuple[FloatArray, FloatArray, FloatArray],
    ) -> tuple[FloatArray, BoolArray]:
        """Times of some rows on the axis of the run, and which have one.

        Parameters
        ----------
        place, t : ndarray, shape (n,)
            Places in the stream, and times on the sensor's clock. [s]
        pair_place : ndarray, shape (m,)
            Places of the pairs; each counts from its own on, so that pieces of any length give the same.
        pairs : tuple of ndarray, shape (m,) each
            Times of the sensor's clock, GPS time since 1980 in whole seconds, and the rest. [s]
        """
        if self.is_local:
            if len(t):
                self._clock.local(float(t[0]))
            return t, np.ones(len(t), dtype=bool)
        made, good = np.zeros(len(t)), np.zeros(len(t), dtype=bool)
        steps = [(-np.inf, self._line)]
        for at, *pair in zip(pair_place.tolist(), *(part.tolist() for part in pairs), strict=True):
            if self._takes((pair[0], pair[1], pair[2])):
                steps.append((at, self._line))
        for (at, line), (stop, _) in zip(steps, [*steps[1:], (np.inf, None)], strict=True):
            rows = (place >= at) & (place < stop)
            if line is not None and rows.any():
                epoch = self._clock.epoch_of(line.gps_at_zero + float(t[rows][0]) - line.zero)
                made[rows], good[rows] = line.seconds(t[rows], epoch), True
        return made, good

    def _takes(self, pair: tuple[float, float, float]) -> bool:
        """Take a pair into the line, unless one of the last second is in it."""
        t, whole, rest = pair
        newest = self._strange or self._pairs
        if newest and 0.0 <= t - newest[-1][0] < _EVERY_S:
            return False
        if self._line is not None:
            off = float(self._line.seconds(np.array([t]), whole)[0]) - rest
            if not abs(off) < _CONTRADICTS_S:
                self._strange.append(pair)
                if len(self._strange) < _BELIEVED:
                    return False
                self._pairs, self._strange = self._strange, []
        if not self._strange:
            self._pairs = [p for p in self._pairs if t - _SPAN_S <= p[0] < t]
        self._strange = []
        if not self._pairs or self._pairs[-1] != pair:
            self._pairs.append(pair)
        self._line = clock_line(*(np.array(column) for column in zip(*self._pairs, strict=True)))
        return self._line is not None
