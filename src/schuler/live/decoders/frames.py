"""Frames of binary streams: a sync word, a header that says the length, a checksum."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from typing import ClassVar

from schuler.live.messages import Message

_LONGEST = 1 << 14  # bytes of a frame; a header that says more is taken for damage, not waited for


@dataclass(frozen=True)
class Framing:
    """How frames of a format are found.

    Attributes
    ----------
    sync : bytes
        What every frame starts with.
    header : int
        Bytes after which the length is known.
    stop_of : callable
        Byte behind the frame that may start at a place of some bytes, ``None`` if none can.
    is_right : callable
        Whether a frame between two places has the checksum it says.
    """

    sync: bytes
    header: int
    stop_of: Callable[[bytes, int], int | None]
    is_right: Callable[[bytes, int, int], bool]


def whole_frames(
    data: bytes, framing: Framing, left_out: Counter[str], *, final: bool = False
) -> tuple[list[bytes], bytes]:
    """Frames with right checksums, found as in a file.

    Parameters
    ----------
    data : bytes
        What was kept of the stream, and what came.
    framing : Framing
    left_out : Counter
        Counts bytes that belong to no frame.
    final : bool
        Nothing more will come.

    Returns
    -------
    frames : list of bytes
    rest : bytes
        What may become a frame with more bytes.
    """
    frames: list[bytes] = []
    taken = 0
    at = data.find(framing.sync)
    while at >= 0:
        if not final and at + framing.header > len(data):
            break
        stop = framing.stop_of(data, at)
        fits = stop is not None and stop - at <= _LONGEST
        if fits and stop is not None and stop > len(data) and not final:
            break
        if fits and stop is not None and stop <= len(data) and framing.is_right(data, at, stop):
            frames.append(data[at:stop])
            taken += stop - at
            at = data.find(framing.sync, stop)
        else:
            at = data.find(framing.sync, at + len(framing.sync))
    if at < 0:
        begun = [n for n in range(1, len(framing.sync)) if data.endswith(framing.sync[:n]) and not final]
        at = len(data) - max(begun, default=0)
    if strange := at - taken:
        left_out["bytes that belong to no message with a right checksum"] += strange
    return frames, data[at:]


class FrameDecoder(ABC):
    """Decoder of a stream of frames: a format has its framing, and makes messages of whole frames."""

    framing: ClassVar[Framing]
    left_out: Counter[str]
    _rest = b""

    def feed(self, data: bytes, arrival: float) -> list[Message]:
        """See :class:`~schuler.live.decoders.base.Decoder`."""
        frames, self._rest = whole_frames(self._rest + data, self.framing, self.left_out)
        return self._messages(frames)

    def pause(self) -> list[Message]:
        """See :class:`~schuler.live.decoders.base.Decoder`."""
        return []

    def finish(self) -> list[Message]:
        """See :class:`~schuler.live.decoders.base.Decoder`."""
        frames, self._rest = whole_frames(self._rest, self.framing, self.left_out, final=True)
        return [*self._messages(frames), *self.pause()]

    @abstractmethod
    def _messages(self, frames: list[bytes]) -> list[Message]:
        """Messages of whole frames."""
