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
from schuler.timebase import UNIX_TO_GPS_S, leap_second_notes

_PAUSE_S = 0.1  # without a byte, after which a decoder is noted that what it has is complete [s]
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
        When a piece came last and the decoder was not noted of a pause since, by the machine's own counter. [s]
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
    threads = [threading.Thread(target=_pump, args=(source, inbox, stop), daemon=True) for source in sources]
    feed = _Feed(navigator, sinks, smoothed_sinks, on_message, 1.0 / rate_hz if rate_hz > 0.0 else 0.0)
    reports, savings = _Every(_COUNTED_S), _Every(every_s)
    for thread in threads:
        thread.start()
    running = len(threads)
    try:
        while running and not stop.is_set():
            arrival = _next_arrival(inbox)
            now = time.monotonic()
            if arrival is not None:
                with leap_second_notes() as late:
                    feed.take_arrival(arrival, now)
                feed.note(late)
                running -= arrival.piece is None
            feed.take_pauses(sources, now)
            if reports.is_due(now):
                feed.report_left_out(sources)
            if on_interval is not None and savings.is_due(now):
                on_interval()
            if on_idle is not None:
                on_idle(feed.newest)
    finally:
        stop.set()
        while any(thread.is_alive() for thread in threads):
            _drain(inbox)
            time.sleep(0.001)
    feed.report_left_out(sources)
    if on_interval is not None:
        on_interval()
    for source in sources:
        feed.summary.left_out.update({f"{source.name}: {k}": n for k, n in source.left_out().items()})
    return feed.summary


class _Every:
    """Something that is due once in so many seconds."""

    def __init__(self, seconds: float) -> None:
        self._seconds, self._last = seconds, time.monotonic()

    def is_due(self, now: float) -> bool:
        """Whether it is due, by the machine's own counter; it is done then."""
        if now - self._last <= self._seconds:
            return False
        self._last = now
        return True


class _Feed:
    """Messages into the navigator, its solutions and events into the sinks, all of it counted.

    Parameters
    ----------
    navigator : Navigating
    sinks, smoothed_sinks : sequence of Sink
    on_message : sequence of callable
    interval : float
        Between two solutions; 0 gives one after every sample. [s]
    """

    def __init__(
        self,
        navigator: Navigating,
        sinks: Sequence[Sink],
        smoothed_sinks: Sequence[Sink],
        on_message: Sequence[Callable[[Message], None]],
        interval: float,
    ) -> None:
        self._navigator, self._sinks, self._smoothed_sinks = navigator, sinks, smoothed_sinks
        self._on_message, self._interval = on_message, interval
        self._next_t = -math.inf
        self._noted = False
        self.newest: Solution | None = None
        self.summary = Summary()

    def take_arrival(self, arrival: _Arrival, now: float) -> None:
        """Take what came of a source: its messages, a sentence about it, its end, or the error that ended it."""
        if arrival.error is not None:
            raise arrival.error
        name = arrival.source.name
        if isinstance(arrival.piece, str):
            self._say("source", f"{name}: {arrival.piece}")
            return
        self._take(_decoded(arrival))
        arrival.source.last_s = now
        if arrival.piece is None:
            self._say("source", f"{name}: ended")

    def take_pauses(self, sources: Sequence[Source], now: float) -> None:
        """Take what decoders hold back while more may come, of sources that are silent."""
        for source in sources:
            if source.decoder is not None and now - source.last_s > _PAUSE_S:
                self._take(source.decoder.pause())
                source.last_s = math.inf

    def note(self, sentences: Sequence[str]) -> None:
        """Say what was not said before."""
        for sentence in sentences[:1] if not self._noted else ():
            self._noted = True
            self._say("clock", sentence)

    def report_left_out(self, sources: Sequence[Source]) -> None:
        """Say what decoders left out since the last time."""
        for source in sources:
            for phrase, number in (source.left_out() - source.reported).items():
                self._say("decoder", f"{source.name}: {number} {phrase}")
            source.reported = source.left_out().copy()

    def _say(self, kind: EventKind, text: str) -> None:
        self.summary.events += 1
        event = Event(math.nan if self.newest is None else self.newest.t, kind, text)
        for sink in self._sinks:
            sink.event(event)

    def _take(self, messages: Sequence[Message]) -> None:
        for message in messages:
            self.summary.messages[type(message).__name__] += 1
            for call in self._on_message:
                call(message)
            if isinstance(message, ImuBlock):
                self._take_block(message)
                continue
            self._navigator.take(message)
            if isinstance(message, ImuSample):
                self._show(message.t)

    def _take_block(self, block: ImuBlock) -> None:
        """Take samples up to each at which a solution is due."""
        while len(block.t):
            due = block.t >= self._next_t - _SAME * self._interval
            count = int(np.argmax(due)) + 1 if due.any() else len(block.t)
            part, block = parted(block, count)
            self._navigator.take(part)
            self._show(float(part.t[-1]))

    def _show(self, t: float) -> None:
        """Give the sinks the solution at a sample, if one is due."""
        interval = self._interval
        if self._next_t - 2.0 * interval <= t < self._next_t - _SAME * interval:  # earlier: the clock stepped
            return
        self._next_t = (math.floor(t / interval + _SAME) + 1.0) * interval if interval > 0.0 else -math.inf
        self.newest = self._navigator.solution()
        if self.newest is None:
            return
        self.summary.solutions += 1
        for sink in self._sinks:
            sink.solution(self.newest)
        smoothed = self._navigator.smoothed() if self._smoothed_sinks else None
        if smoothed is not None:
            for sink in self._smoothed_sinks:
                sink.solution(smoothed)


def _next_arrival(inbox: queue.Queue[_Arrival]) -> _Arrival | None:
    """What came next, or nothing for so long."""
    try:
        return inbox.get(timeout=POLL_S)
    except queue.Empty:
        return None


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
    noted = False
    try:
        for piece in source.open(stop, lambda text: inbox.put(_Arrival(source, text))):
            if piece:
                with leap_second_notes() as late:
                    inbox.put(_Arrival(source, piece, gps_now()))
                if late and not noted:
                    noted = True
                    inbox.put(_Arrival(source, f"the clock of this machine: {late[0]}"))
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
