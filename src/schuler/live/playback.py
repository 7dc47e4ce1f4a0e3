"""A recording as the stream that it was: messages in the order in which they came, at their pace or faster."""

from __future__ import annotations

import threading
import time
from collections.abc import Iterator
from itertools import pairwise

import numpy as np

from schuler.exceptions import InputError
from schuler.live.clock import SourceClock
from schuler.live.decoders.base import fixes
from schuler.live.messages import Broadcast, Heading, Height, ImuBlock, Message, SatelliteEpoch, Speed
from schuler.recording.recording import Recording

_PIECE_S = 0.02  # samples of an IMU come together as far as this, in time of the machine [s]
_LARGEST_S = 1.0  # and as far as this in time of the log [s]


def messages(recording: Recording, piece_s: float = _LARGEST_S) -> Iterator[tuple[float, Message]]:
    """Messages of a recording with the time at which each comes.

    Parameters
    ----------
    recording : Recording
        With an IMU. Fixes come when they were delivered (``gnss.received``), else at their own time; the other series
        at their own.
    piece_s : float
        Longest stretch of IMU samples that come together. [s]

    Yields
    ------
    t : float
        Time of the log at which the message comes. [s]
    message : Message
        IMU samples in SI, forward, right, down. A measurement comes before the sample of its time.

    Raises
    ------
    InputError
        If there is no IMU.
    """
    imu = recording.need_imu()
    slow: list[tuple[float, Message]] = []
    if recording.gnss is not None:
        received = recording.gnss.t if recording.gnss.received is None else recording.gnss.received
        slow += zip(received.tolist(), fixes(recording.gnss), strict=True)
    if (odometer := recording.odometer) is not None:
        rows = zip(odometer.t.tolist(), odometer.speed.tolist(), odometer.sigma.tolist(), strict=True)
        slow += [(row[0], Speed(*row)) for row in rows]
    for kind, series in ((Heading, recording.heading), (Height, recording.height)):
        if series is not None:
            rows = zip(series.t.tolist(), series.value.tolist(), series.sigma.tolist(), strict=True)
            slow += [(row[0], kind(*row)) for row in rows]
    measured = recording.observations if recording.ranges is None else recording.ranges
    if measured is not None:
        edges = np.flatnonzero(np.diff(measured.t, prepend=-np.inf, append=np.inf))
        rows_of = [np.arange(a, b) for a, b in pairwise(edges.tolist())]
        slow += [(float(measured.t[k[0]]), SatelliteEpoch(measured.where(k))) for k in rows_of]
    if recording.ephemerides is not None:
        # they count from when each was sent, by what it says
        slow.insert(0, (float(imu.t[0]), Broadcast(float(imu.t[0]), recording.ephemerides)))
    slow.sort(key=lambda pair: pair[0])
    at = 0
    for t, message in [*slow, (np.inf, None)]:
        before = int(np.searchsorted(imu.t, t))
        while at < before:
            stop = min(before, int(np.searchsorted(imu.t, imu.t[at] + piece_s, side="right")))
            part = slice(at, stop)
            temperature = None if imu.temperature is None else imu.temperature[part]
            yield float(imu.t[stop - 1]), ImuBlock(imu.t[part], imu.gyro[part], imu.accel[part], temperature)
            at = stop
        if message is not None:
            yield t, message


def play(
    recording: Recording, clock: SourceClock, stop: threading.Event, speed: float = 1.0
) -> Iterator[list[Message]]:
    """Messages of a recording at a pace.

    Parameters
    ----------
    recording : Recording
    clock : SourceClock
        Gets the time base of the recording; one that is settled already must have the same epoch.
    stop : Event
        Ends the stream when it is set.
    speed : float
        Seconds of the log in one of the machine; 0 does not wait.

    Raises
    ------
    InputError
        If another source settled another time base.
    """
    base = recording.metadata.time
    if base.scale == "local":
        clock.local(0.0)
    elif clock.epoch_of(base.epoch_gps_s) != base.epoch_gps_s:
        raise InputError("this log is of another week than what came before: end the run, and begin it with this log")
    began, first = time.monotonic(), None
    for t, message in messages(recording, min(_LARGEST_S, speed * _PIECE_S) if speed else _LARGEST_S):
        first = t if first is None else first
        ahead = (t - first) / speed - (time.monotonic() - began) if speed else 0.0
        if stop.is_set() or (ahead > 0.0 and stop.wait(ahead)):
            return
        yield [message]
