"""Choice of the decoder of a stream: as it is asked for, by the columns that are given, or by what comes."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping

from schuler.live.clock import SourceClock
from schuler.live.decoders import mavlink
from schuler.live.decoders.base import Decoder
from schuler.live.decoders.nmea import NmeaDecoder
from schuler.live.decoders.novatel import NovatelDecoder
from schuler.live.decoders.sbf import SbfDecoder
from schuler.live.decoders.sbg import SbgDecoder
from schuler.live.decoders.text import TextDecoder
from schuler.live.decoders.ubx import UbxDecoder
from schuler.live.decoders.vectornav import VectorNavDecoder
from schuler.live.decoders.xsens import XsensDecoder
from schuler.live.messages import Message
from schuler.recording.formats import novatel_frames, sbf_blocks, sbg, vectornav_packets, xsens_messages
from schuler.recording.formats.nmea import looks_like_nmea
from schuler.recording.formats.ubx import looks_like_ubx
from schuler.recording.io.columns import check_known
from schuler.recording.io.hints import ReadHints
from schuler.recording.series import Kind

#: Formats of streams.
FORMATS = ("text", "nmea", "ubx", "novatel", "sbf", "vectornav", "sbg", "xsens", "mavlink")
#: Binary formats that are told by their first bytes, u-blox first; lines of NMEA may stand between their messages.
_BINARY: dict[str, Callable[[bytes], bool]] = {
    "ubx": looks_like_ubx,
    "novatel": novatel_frames.looks_like,
    "sbf": sbf_blocks.looks_like,
    "vectornav": vectornav_packets.looks_like,
    "sbg": sbg.looks_like,
    "mavlink": mavlink.looks_like,
    "xsens": xsens_messages.looks_like,  # last: its checksum is one byte
}
_SYNCS = (b"\xb5\x62", novatel_frames.SYNC, sbf_blocks.SYNC)  # of formats that are sent beside NMEA
_ENOUGH = 1 << 16  # bytes after which a stream that looks like nothing is not kept


def decoder(
    clock: SourceClock,
    hints: ReadHints,
    *,
    format: str | None = None,
    by_arrival: bool = False,
    whole: bool = False,
    raw: bool = False,
) -> Decoder:
    """Decoder of a stream.

    Parameters
    ----------
    clock : SourceClock
        Shared by all sources of a run.
    hints : ReadHints
        How a log of this source would be read. Those with ``columns`` are of lines of text.
    format : str, optional
        One of :data:`FORMATS`; by what comes if left out.
    by_arrival, whole : bool
        See :class:`~schuler.live.decoders.text.TextDecoder`.
    raw : bool
        Raw measurements of satellites in place of solutions, from formats that have both.

    Raises
    ------
    InputError
        If the format is not known, or lines of text are not described.
    """
    makers: dict[str, Callable[[], Decoder]] = {
        "text": lambda: TextDecoder(clock, hints, by_arrival=by_arrival, whole=whole),
        "nmea": lambda: NmeaDecoder(clock, hints),
        "ubx": lambda: UbxDecoder(clock, raw=raw),
        "novatel": lambda: NovatelDecoder(clock, hints, announced=format is not None),
        "sbf": lambda: SbfDecoder(clock, hints),
        "vectornav": lambda: VectorNavDecoder(clock, hints, announced=format is not None),
        "sbg": lambda: SbgDecoder(clock, hints),
        "mavlink": lambda: mavlink.MavlinkDecoder(clock, hints),
        "xsens": lambda: XsensDecoder(clock, hints, announced=format is not None),
    }
    if format is None and hints.columns is not None:
        format = "text"
    if format is None:
        return _Detection({name: makers[name] for name in (*_BINARY, "nmea")})
    return makers[check_known(format, FORMATS, "format of a stream")]()


class _Detection:
    """Decoder of a stream whose format its first whole messages show; receivers that send NMEA as well come first."""

    def __init__(self, makers: Mapping[str, Callable[[], Decoder]]) -> None:
        self._makers, self._head = makers, b""
        self._decoder: Decoder | None = None
        self._unknown: Counter[str] = Counter()
        self.kind: Kind | None = None

    @property
    def left_out(self) -> Counter[str]:
        """See :class:`~schuler.live.decoders.base.Decoder`."""
        return self._unknown if self._decoder is None else self._decoder.left_out + self._unknown

    def feed(self, data: bytes, arrival: float) -> list[Message]:
        """See :class:`~schuler.live.decoders.base.Decoder`."""
        if self._decoder is not None:
            return self._decoder.feed(data, arrival)
        self._head += data
        name = next((name for name, looks_like in _BINARY.items() if looks_like(self._head)), None)
        if name is None and looks_like_nmea(self._head) and not any(sync in self._head for sync in _SYNCS):
            name = "nmea"
        if name is not None:
            self._decoder = self._makers[name]()
        elif len(self._head) > _ENOUGH:
            self._unknown["bytes of no format that is known (lines of numbers need columns=...)"] += len(self._head)
            self._head = b""
        if self._decoder is None:
            return []
        head, self._head = self._head, b""
        return self._decoder.feed(head, arrival)

    def pause(self) -> list[Message]:
        """See :class:`~schuler.live.decoders.base.Decoder`."""
        return [] if self._decoder is None else self._decoder.pause()

    def finish(self) -> list[Message]:
        """See :class:`~schuler.live.decoders.base.Decoder`."""
        return [] if self._decoder is None else self._decoder.finish()
