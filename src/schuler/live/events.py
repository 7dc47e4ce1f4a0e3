"""Events of a live run: the newest, and repeated ones counted."""

from __future__ import annotations

import math
from collections import deque

from schuler.live.messages import Event, EventKind

_REPEATED_S = 10.0  # events of one sort are given once in so long, with their number [s]
_KEPT = 1000
_COUNTED: tuple[EventKind, ...] = ("imu", "measurement", "late", "clock")


class EventLog:
    """The newest thousand events.

    Attributes
    ----------
    newest : deque of Event
    """

    def __init__(self) -> None:
        self.newest: deque[Event] = deque(maxlen=_KEPT)
        self._repeated: dict[str, tuple[float, int]] = {}  # by sort: time of the last one, and more since

    def add(self, t: float, kind: EventKind, text: str, sort: str) -> Event | None:
        """Add an event; None for one of a sort that was given just before, which is counted for the next."""
        last, count = self._repeated.get(sort, (-math.inf, 0))
        if abs(t - last) < _REPEATED_S and kind in _COUNTED:
            self._repeated[sort] = (last, count + 1)
            return None
        if len(self._repeated) > _KEPT:
            self._repeated.clear()
        self._repeated[sort] = (t, 0)
        event = Event(t, kind, text + (f" ({count} more like the last one since)" if count else ""))
        self.newest.append(event)
        return event
