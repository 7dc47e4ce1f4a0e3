"""u-blox messages as they come: solutions of NAV-PVT, or raw measurements of RXM-RAWX and subframes of RXM-SFRBX."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from schuler.live.clock import SourceClock
from schuler.live.decoders.base import fixes
from schuler.live.messages import Broadcast, Message, SatelliteEpoch
from schuler.recording.formats import ubx, ubx_messages
from schuler.recording.series import Kind

_LONGEST = 1 << 14  # bytes that may still become a frame; the longest that is read has 8184
_SUBFRAMES = 50  # of a satellite that are kept: with those of 30 s an ephemeris is complete
_AGAIN_S = 6.0  # between two looks for an ephemeris among them [s]
_NOTHING = (b"", b"", b"", None)


class UbxDecoder:
    """Messages of a u-blox receiver, see :mod:`schuler.recording.formats.ubx`.

    Parameters
    ----------
    clock : SourceClock
    raw : bool
        Raw measurements and ephemerides, for tight coupling, in place of the receiver's solutions.

    Raises
    ------
    MissingExtraError
        If pyubx2 is not installed.
    """

    def __init__(self, clock: SourceClock, *, raw: bool = False) -> None:
        self.left_out: Counter[str] = Counter()
        self.kind: Kind | None = None
        self._clock, self._decode, self._rest = clock, ubx.decoder(), b""
        self._raw, self._last = raw, -np.inf
        self._gps_s = np.nan  # of the newest epoch, since 1980 [s]
        self._subframes: dict[bytes, list[dict[str, Any]]] = {}  # the newest of each satellite
        self._looked_s: dict[bytes, float] = {}  # when they were looked through
        self._content: dict[bytes, tuple[Any, ...]] = {}  # what was in them

    def feed(self, data: bytes, arrival: float) -> list[Message]:
        """See :class:`~schuler.live.decoders.base.Decoder`."""
        frames = ubx.find_frames(self._rest + data)
        done = frames.spans[-1][2] if frames.spans else 0
        done = max(done, len(frames.data) - _LONGEST)
        between = ubx.find_frames(frames.data[:done])
        self._rest = frames.data[done:]
        if between.strange:
            self.left_out["bytes that belong to no frame and no NMEA sentence"] += between.strange
        takers = {ubx.RAWX: self._epoch, ubx.SFRBX: self._subframe} if self._raw else {ubx.PVT: self._fix}
        messages: list[Message] = []
        for kind, first, stop in between.spans:
            if kind in takers:
                messages += self._taken(takers[kind], kind, between.data[first:stop])
        return messages

    def pause(self) -> list[Message]:
        """See :class:`~schuler.live.decoders.base.Decoder`."""
        return []

    def finish(self) -> list[Message]:
        """See :class:`~schuler.live.decoders.base.Decoder`."""
        return []

    def _taken(self, take: Callable[[dict[str, Any]], list[Message]], kind: int, frame: bytes) -> list[Message]:
        try:
            if not ubx.is_whole(kind, frame[6:-2]):
                raise ValueError("shorter than its contents")
            return take(self._decode(frame))
        except Exception:  # pyubx2 does not list its errors; a payload that is shorter than its contents
            self.left_out["frames not of the length their contents call for"] += 1
            return []

    def _fix(self, pvt: dict[str, Any]) -> list[Message]:
        series, start, notes = ubx_messages.solutions([pvt])
        if series is None:
            self.left_out[notes[0].removeprefix("NAV-PVT: 1 ").rstrip(".")] += 1
            return []
        (fix,) = fixes(series, start - self._clock.epoch_of(start + float(series.t[0])))
        if fix.t == self._last:
            self.left_out["epochs repeated"] += 1
            return []
        self._last = fix.t
        return [fix]

    def _epoch(self, rawx: dict[str, Any]) -> list[Message]:
        epoch = ubx_messages.raw_epochs([rawx])
        if epoch is None or not len(epoch.observations):
            self.left_out["epochs without measurements or before the receiver knew the time"] += 1
            return []
        o = epoch.observations
        self._gps_s = o.epoch_gps_s + float(o.t[0])
        start = self._clock.epoch_of(self._gps_s)
        return [SatelliteEpoch(replace(o, t=o.t + (o.epoch_gps_s - start), epoch_gps_s=start, notes=()))]

    def _subframe(self, sfrbx: dict[str, Any]) -> list[Message]:
        """The ephemeris of a satellite whose newest subframes hold one; it needs the time of an epoch before."""
        if not np.isfinite(self._gps_s):
            self.left_out["navigation messages before the first epoch"] += 1
            return []
        sat = bytes(sfrbx["_payload"][:3])  # system, satellite, signal
        kept = self._subframes.setdefault(sat, [])
        kept.append(sfrbx)
        del kept[:-_SUBFRAMES]
        if self._gps_s - self._looked_s.get(sat, -np.inf) < _AGAIN_S:
            return []
        self._looked_s[sat] = self._gps_s
        ephemerides = ubx_messages.broadcast((m, self._gps_s) for m in kept)
        kepler, glonass, klobuchar = ephemerides.kepler, ephemerides.glonass, ephemerides.klobuchar_alpha
        content = (kepler.toe.tobytes(), kepler.af0.tobytes(), glonass.toe.tobytes(), klobuchar)
        if content == self._content.get(sat, _NOTHING):
            return []
        self._content[sat] = content
        t = self._gps_s - self._clock.epoch_of(self._gps_s)
        return [Broadcast(t, ephemerides)]
