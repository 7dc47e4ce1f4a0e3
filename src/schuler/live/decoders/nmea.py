"""NMEA 0183 as it comes: an epoch is complete when the next one begins, or when the receiver pauses."""

from __future__ import annotations

from collections import Counter
from pathlib import Path

import numpy as np

from schuler.exceptions import InputError
from schuler.live.clock import SourceClock
from schuler.live.decoders.base import fixes
from schuler.live.messages import Message
from schuler.recording.formats.nmea import Epoch, add_sentences, date_of, series_of
from schuler.recording.io.hints import ReadHints
from schuler.recording.series import Kind

_LONGEST = 1024  # bytes without a line feed that may still become a sentence


class NmeaDecoder:
    """Fixes of the sentences GGA, GST, GSA, RMC, VTG and ZDA, see :mod:`schuler.recording.formats.nmea`.

    A log gives each epoch the nearest date; a stream the one before, so epochs before the first date are left out.

    Parameters
    ----------
    clock : SourceClock
    hints : ReadHints
        As for a log.
    """

    def __init__(self, clock: SourceClock, hints: ReadHints) -> None:
        self.left_out: Counter[str] = Counter()
        self.kind: Kind | None = None
        self._clock, self._hints = clock, hints
        self._rest = b""
        self._epochs = [Epoch()]
        self._dated: Epoch | None = None
        self._last = -np.inf
        self._given: Epoch | None = None

    def feed(self, data: bytes, arrival: float) -> list[Message]:
        """See :class:`~schuler.live.decoders.base.Decoder`."""
        lines, feed, rest = (self._rest + data).rpartition(b"\n")
        self._rest = rest[-_LONGEST:]
        if feed:
            add_sentences(self._epochs, lines + feed, self.left_out)
        messages = [m for epoch in self._epochs[:-1] for m in self._fix(epoch)]
        del self._epochs[:-1]
        return messages

    def pause(self) -> list[Message]:
        """See :class:`~schuler.live.decoders.base.Decoder`."""
        return self._fix(self._epochs[-1]) if self._epochs[-1].has_position else []

    def finish(self) -> list[Message]:
        """See :class:`~schuler.live.decoders.base.Decoder`."""
        return [*self.feed(b"\n", 0.0), *self.pause()]

    def _fix(self, epoch: Epoch) -> list[Message]:
        """The fix of an epoch that is complete, if it has one; nothing if it was given already."""
        if epoch is self._given or epoch.second is None:
            return []
        self._given = epoch
        if date_of(epoch.sentences) is not None:
            self._dated = epoch
        if not epoch.has_position:
            return []
        if not epoch.has_fix:
            self.left_out["epochs without a fix"] += 1
            return []
        if self._dated is None:
            self.left_out["epochs before the receiver said the date (RMC or ZDA)"] += 1
            return []
        try:
            dated = [epoch] if self._dated is epoch else [self._dated, epoch]
            series, base = series_of(Path("NMEA"), dated, [epoch], self._hints, [])
        except InputError as error:
            self.left_out[f"epochs: {error}"] += 1
            return []
        shift = base.epoch_gps_s - self._clock.epoch_of(base.epoch_gps_s + float(series.t[0]))
        fix = next(fixes(series, shift))
        if fix.t == self._last:
            self.left_out["epochs repeated"] += 1
            return []
        self._last = fix.t
        return [fix]
