"""Samples and messages of a stream that wait to be filtered together."""

from __future__ import annotations

import math

import numpy as np

from schuler.arrays import ArrayLike, FloatArray
from schuler.live.messages import Measurement

SIZE = 1000  # samples at most
_MESSAGES = 16  # fixes and readings among them at most; fewer than would make a log's contradictions


class Queue:
    """Samples in a row, and the messages that came between them.

    Attributes
    ----------
    messages : list of (int, message)
        Fixes and readings, each with the number of samples that came before.
    """

    def __init__(self) -> None:
        self.messages: list[tuple[int, Measurement]] = []
        self._rows = np.empty((SIZE, 8))  # t, gyro, accel, temperature
        self._count = 0
        self._span = (-math.inf, -math.inf)  # stamps of samples that may join [s]

    def __bool__(self) -> bool:
        return bool(self._count or self.messages)

    def put(self, t: float, gyro: ArrayLike, accel: ArrayLike, temperature: float, span_s: float) -> bool:
        """Put one sample at the end; whether it is the last of a span, so that they are to be filtered now."""
        k = self._count
        if k == 0:
            self._span = t, t + span_s
        row = self._rows[k]
        row[0], row[1:4], row[4:7], row[7] = t, gyro, accel, temperature
        self._count = k + 1
        return k + 1 == SIZE or not self._span[0] <= t < self._span[1]

    def has_room(self, count: int) -> bool:
        """Whether so many samples find a place."""
        return self._count + count <= SIZE

    def put_rows(self, t: FloatArray, gyro: ArrayLike, accel: ArrayLike, temperature: ArrayLike, span_s: float) -> bool:
        """Put samples in a row at the end, shapes (n,), (n, 3), (n, 3), () or (n,); as :meth:`put`."""
        stop = self._count + len(t)
        rows = self._rows[self._count : stop]
        rows[:, 0], rows[:, 1:4], rows[:, 4:7], rows[:, 7] = t, gyro, accel, temperature
        if not self._count:
            self._span = float(t[0]), float(t[0]) + span_s
        self._count = stop
        return stop == SIZE or not self._span[0] <= t[-1] < self._span[1]

    def put_message(self, message: Measurement) -> bool:
        """Put a fix or a reading; whether they are to be taken now."""
        self.messages.append((self._count, message))
        return len(self.messages) == _MESSAGES or not self._count

    def empty(self) -> tuple[FloatArray, list[tuple[int, Measurement]]]:
        """Take everything out: samples, shape (n, 8), time, rates, forces, temperature; and messages."""
        rows, messages = self._rows[: self._count].copy(), self.messages
        self._count, self.messages = 0, []
        return rows, messages
