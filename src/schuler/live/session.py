"""A live run from the wire to the outlets: sources read in threads, decoded and navigated in one place."""

from __future__ import annotations

import math
import queue
import threading
import time
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np

from schuler.exceptions import InputError
from schuler.live.clock import SourceClock
from schuler.live.decoders.base import Decoder
from schuler.live.messages import Event, EventKind, ImuBlock, ImuSample, Message, Solution, parted
from schuler.live.sources import POLL_S, Notify
from schuler.timebase import UNIX_TO_GPS_S

_PAUSE_S = 0.1  # without a byte, after which a decoder is told that what it has is complete [s]
_COUNTED_S = 10.0  # between two looks at what decoders left out [s]
_SAME = 1e-6  # of the interval of solutions: a sample so little before its time is at it [-]
_WAITING = 1000  # pieces that wait for the filter before a source is held up

#: What a source yields: bytes for its decoder, or messages.
Piece = bytes | list[Message]


@dataclass
class Source:
    """One source of a run.

    Attributes
    ----------
    name : str
        As events call it.
    open : callable
        Called with an event that ends the source and a function that takes sentences; returns its pieces.
    decoder : Decoder, optional
        Of the bytes.
    keep : callable, optional
        Called with all bytes as they come.
    last_s : float
        When a piece came last and the decoder was not told of a pause since, by the machine's own counter. [s]
    reported, failures : Counter
        What was left out as last reported, and pieces at which the decoder gave up.
    """

    name: str
    open: Callable[[threading.Event, Notify], Iterator[Piece]]
    decoder: Decoder | None = None
    keep: Callable[[bytes], None] | None = None
    last_s: float = math.inf
    reported: Counter[str] = field(default_factory=Counter)
    failures: Counter[str] = field(default_factory=Counter)

    def left_out(self) -> Counter[str]:
        """What was of no use, by a phrase that says why."""
        return self.failures if self.decoder is None else self.decoder.left_out + self.failures


class Sink(Protocol):
    """Something that takes solutions and events."""

    def solution(self, solution: Solution) -> None:
        """Take a solution."""
        ...

    def event(self, event: Event) -> None:
        """Take an event."""
        ...


class Navigating(Protocol):
    """Something that navigates messages."""

    def take(self, message: Message) -> None:
        """Take a message."""
        ...

    def solution(self) -> Solution | None:
        """Solution at the newest sample."""
        ...

    def smoothed(self) -> Solution | None:
        """Newest smoothed solution."""
        ...


@dataclass(frozen=True)
class _Arrival:
    """A piece of a source, a sentence about it, or its end (``None``), which an error may have brought about."""

    source: Source
    piece: Piece | str | None
    gps_s: float = math.nan
    error: Exception | None = None


@dataclass
class Summary:
    """Counts of a run.

    Attributes
    ----------
    messages : Counter
        Messages by kind.
    solutions, events : int
    left_out : Counter
        What decoders left out, by source and phrase.
    """

    messages: Counter[str] = field(default_factory=Counter)
    solutions: int = 0
    events: int = 0
    left_out: Counter[str] = field(default_factory=Counter)


def run_session(
    sources: Sequence[Source],
    navigator: Navigating,
    clock: SourceClock,
    sinks: Sequence[Sink],
    *,
    smoothed_sinks: Sequence[Sink] = (),
    on_message: Sequence[Callable[[Message], None]] = (),
    stop: threading.Event,
    rate_hz: float = 10.0,
    every_s: float = 60.0,
    on_interval: Callable[[], None] | None = None,
    on_idle: Callable[[Solution | None], None] | None = None,
) -> Summary:
    """Navigate what the sources send until all have ended, or until a stop.

    Parameters
    ----------
    sources : sequence of Source
    navigator : LiveNavigator or LiveFoot
        Takes messages in SI, forward, right, down; its events must come to ``sinks`` by its own ``on_event``.
    clock : SourceClock
        That of the decoders.
    sinks : sequence of Sink
    smoothed_sinks : sequence of Sink
        Take the smoothed solution whenever ``sinks`` take the newest one, if the navigator has a smoother.
    on_message : sequence of callable
        Called with every message before the navigator takes it.
    stop : Event
        Ends the run when it is set.
    rate_hz : float
        Solutions for the sinks in a second of the IMU's clock; 0 gives one after every sample. Each is at the first
        sample from its time on.
    every_s : float
        Between two calls of ``on_interval``. [s]
    on_interval : callable, optional
        Called once in so long and at the end, to save the state.
    on_idle : callable, optional
        Called with the newest solution whenever there was something or nothing for :data:`POLL_S`.

    Raises
    ------
    InputError, MissingExtraError
        If a source can never work: a port that is taken, a library that is not installed, clocks that do not fit.

    Notes
    -----
    Nothing that comes over the wire ends the run: what cannot be used is counted and said as an event.
    """
    inbox: queue.Queue[_Arrival] = queue.Queue(_WAITING)
    summary = Summary()
    threads = [threading.Thread(target=_pump, args=(source, inbox, stop), daemon=True) for source in sources]
    newest: Solution | None = None
    interval = 1.0 / rate_hz if rate_hz > 0.0 else 0.0
    next_t, counted, saved = -math.inf, time.monotonic(), time.monotonic()

    def say(kind: EventKind, text: str) -> None:
        summary.events += 1
        event = Event(math.nan if newest is None else newest.t, kind, text)
        for sink in sinks:
            sink.event(event)

    def take(messages: Sequence[Message]) -> None:
        for message in messages:
            summary.messages[type(message).__name__] += 1
            for call in on_message:
                call(message)
            if isinstance(message, ImuSample):
                navigator.take(message)
                show(message.t)
            elif isinstance(message, ImuBlock):
                while len(message.t):
                    due = message.t >= next_t - _SAME * interval
                    count = int(np.argmax(due)) + 1 if due.any() else len(message.t)
                    part, message = parted(message, count)
                    navigator.take(part)
                    show(float(part.t[-1]))
            else:
                navigator.take(message)

    def show(t: float) -> None:
        nonlocal newest, next_t
        if next_t - 2.0 * interval <= t < next_t - _SAME * interval:  # earlier: the clock stepped
            return
        next_t = (math.floor(t / interval + _SAME) + 1.0) * interval if interval > 0.0 else -math.inf
        newest = navigator.solution()
        if newest is not None:
            summary.solutions += 1
            for sink in sinks:
                sink.solution(newest)
            smoothed = navigator.smoothed() if smoothed_sinks else None
            if smoothed is not None:
                for sink in smoothed_sinks:
                    sink.solution(smoothed)

    def count() -> None:
        for source in sources:
            for phrase, number in (source.left_out() - source.reported).items():
                say("decoder", f"{source.name}: {number} {phrase}")
            source.reported = source.left_out().copy()

    for thread in threads:
        thread.start()
    running = len(threads)
    try:
        while running and not stop.is_set():
            try:
                arrival = inbox.get(timeout=POLL_S)
            except queue.Empty:
                arrival = None
            now = time.monotonic()
            if arrival is not None and arrival.error is not None:
                raise arrival.error
            if arrival is not None:
                if isinstance(arrival.piece, str):
                    say("source", f"{arrival.source.name}: {arrival.piece}")
                else:
                    take(_decoded(arrival))
                    arrival.source.last_s = now
                if arrival.piece is None:
                    running -= 1
                    say("source", f"{arrival.source.name}: ended")
            for source in sources:
                if source.decoder is not None and now - source.last_s > _PAUSE_S:
                    take(source.decoder.pause())
                    source.last_s = math.inf
            if now - counted > _COUNTED_S:
                count()
                counted = now
            if on_interval is not None and now - saved > every_s:
                on_interval()
                saved = now
            if on_idle is not None:
                on_idle(newest)
    finally:
        stop.set()
        while any(thread.is_alive() for thread in threads):
            _drain(inbox)
            time.sleep(0.001)
    count()
    if on_interval is not None:
        on_interval()
    for source in sources:
        summary.left_out.update({f"{source.name}: {k}": n for k, n in source.left_out().items()})
    return summary


def _decoded(arrival: _Arrival) -> Sequence[Message]:
    """Messages of a piece, or of the end of a source."""
    source, piece = arrival.source, arrival.piece
    if isinstance(piece, list):
        return piece
    if source.decoder is None:
        return []
    if piece is None:
        return source.decoder.finish()
    assert isinstance(piece, bytes)
    if source.keep is not None:
        source.keep(piece)
    try:
        return source.decoder.feed(piece, arrival.gps_s)
    except InputError:
        raise
    except Exception as error:  # libraries that decode do not list theirs; the run goes on
        source.failures[f"pieces at which the decoder gave up ({type(error).__name__})"] += 1
        return []


def _pump(source: Source, inbox: queue.Queue[_Arrival], stop: threading.Event) -> None:
    """Put the pieces of a source into the inbox with the time at which they came."""
    try:
        for piece in source.open(stop, lambda text: inbox.put(_Arrival(source, text))):
            if piece:
                inbox.put(_Arrival(source, piece, gps_now()))
            if stop.is_set():
                break
        inbox.put(_Arrival(source, None))
    except Exception as error:  # goes on in the thread of the run
        inbox.put(_Arrival(source, None, error=error))


def _drain(inbox: queue.Queue[_Arrival]) -> None:
    with suppress(queue.Empty):
        while True:
            inbox.get_nowait()


def gps_now() -> float:
    """GPS time by the clock of this machine. [s]

    Raises
    ------
    InputError
        If the clock is before 1980.
    """
    from schuler.recording.io.clock import leaps_at

    utc = time.time() - UNIX_TO_GPS_S
    if utc < 0.0:
        raise InputError("the clock of this machine is before 1980: set it")
    return utc + leaps_at(utc)
