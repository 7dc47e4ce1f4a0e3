"""A run of sources that misbehave: decoders that give up are counted, sources that cannot work end it."""

import threading
from collections import Counter

import numpy as np
import pytest

from schuler import timebase
from schuler.exceptions import InputError
from schuler.live.clock import SourceClock
from schuler.live.session import Source, run_session


class Refusing:
    """A decoder that gives up at every piece."""

    def __init__(self):
        self.left_out = Counter({"lines of no use": 3})

    def feed(self, data, arrival):
        raise KeyError(data)

    def pause(self):
        return []

    def finish(self):
        return []


class Listening:
    def __init__(self):
        self.events = []

    def solution(self, solution):
        raise AssertionError("there is none")

    def event(self, event):
        self.events.append((event.kind, event.text))


def pieces(stop, notify):
    notify("connected")
    yield from (b"one", b"", b"two")


def test_a_decoder_that_gives_up_is_counted():
    sink, saved = Listening(), []
    source = Source("wire", pieces, Refusing())
    summary = run_session(
        [source], None, SourceClock(), [sink], stop=threading.Event(), on_interval=lambda: saved.append(1)
    )
    assert summary.left_out == {
        "wire: lines of no use": 3, "wire: pieces at which the decoder gave up (KeyError)": 2
    }  # fmt: skip
    assert sink.events[:2] == [("source", "wire: connected"), ("source", "wire: ended")]
    assert sorted(kind for kind, _ in sink.events[2:]) == ["decoder", "decoder"]
    assert saved == [1]


@pytest.mark.filterwarnings("error")
def test_leap_seconds_beyond_the_table_are_an_event_said_once(monkeypatch):
    monkeypatch.setattr(timebase, "_system_leap_days", lambda _: (timebase.LEAP_DAYS, timebase.LEAP_TABLE_VALID_TO))

    class Late(Refusing):
        def feed(self, data, arrival):
            timebase.gps_from_unix(np.array([1.9e9]))
            return []

    sink = Listening()
    run_session([Source("wire", pieces, Late())], None, SourceClock(), [sink], stop=threading.Event())
    notes = [(kind, text) for kind, text in sink.events if "eap seconds" in text]
    assert len(notes) == 1
    assert notes[0][0] == "clock"
    assert notes[0][1].startswith("Leap seconds are known to")


def test_a_source_that_can_never_work_ends_the_run():
    def refused(stop, notify):
        raise InputError("the port is taken")
        yield b""

    def silent(stop, notify):
        while not stop.wait(0.01):
            yield b""

    endless = Source("other", silent, Refusing())
    with pytest.raises(InputError, match="the port is taken"):
        run_session(
            [endless, Source("wire", refused, Refusing())], None, SourceClock(), [Listening()], stop=threading.Event()
        )
