"""u-blox messages as they come: the solutions of NAV-PVT."""

from __future__ import annotations

from collections import Counter
from typing import Any

import numpy as np

from schuler.live.clock import SourceClock
from schuler.live.decoders.base import fixes
from schuler.live.messages import Message
from schuler.recording.formats import ubx, ubx_messages
from schuler.recording.series import Kind

_LONGEST = 1 << 14  # bytes that may still become a frame; the longest that is read has 8184


class UbxDecoder:
    """Fixes of NAV-PVT, see :mod:`schuler.recording.formats.ubx`.

    Parameters
    ----------
    clock : SourceClock

    Raises
    ------
    MissingExtraError
        If pyubx2 is not installed.
    """

    def __init__(self, clock: SourceClock) -> None:
        self.left_out: Counter[str] = Counter()
        self.kind: Kind | None = None
        self._clock, self._decode, self._rest = clock, ubx.decoder(), b""
        self._last = -np.inf

    def feed(self, data: bytes, arrival: float) -> list[Message]:
        """See :class:`~schuler.live.decoders.base.Decoder`."""
        frames = ubx.find_frames(self._rest + data)
        done = frames.spans[-1][2] if frames.spans else 0
        done = max(done, len(frames.data) - _LONGEST)
        between = ubx.find_frames(frames.data[:done])
        self._rest = frames.data[done:]
        if between.strange:
            self.left_out["bytes that belong to no frame and no NMEA sentence"] += between.strange
        messages: list[Message] = []
        for frame in between.of(ubx.PVT):
            messages += self._fix(frame)
        return messages

    def pause(self) -> list[Message]:
        """See :class:`~schuler.live.decoders.base.Decoder`."""
        return []

    def finish(self) -> list[Message]:
        """See :class:`~schuler.live.decoders.base.Decoder`."""
        return []

    def _fix(self, frame: bytes) -> list[Message]:
        try:
            pvt: dict[str, Any] = self._decode(frame)
            series, start, notes = ubx_messages.solutions([pvt])
        except Exception:  # pyubx2 does not list its errors; a payload that is shorter than its contents
            self.left_out["frames not of the length their contents call for"] += 1
            return []
        if series is None:
            self.left_out[notes[0].removeprefix("NAV-PVT: 1 ").rstrip(".")] += 1
            return []
        (fix,) = fixes(series, start - self._clock.epoch_of(start + float(series.t[0])))
        if fix.t == self._last:
            self.left_out["epochs repeated"] += 1
            return []
        self._last = fix.t
        return [fix]
