"""Frames of a u-blox log: found, checked, and what lies between them counted.

pyubx2 reads frames too, but believes a length once it has seen the two bytes that start one: a single wrong byte there
swallows up to 65 kB of good frames, and what was lost is not counted. So the frames are found here and it decodes them.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Any

import numpy as np

from schuler.exceptions import MissingExtraError

SYNC = b"\xb5\x62"
_OVERHEAD = 8  # two bytes of start, class, identifier, two of length, two of checksum
_NMEA = re.compile(rb"[$!][ -~]{5,250}\r\n")


@dataclass(frozen=True)
class Frames:
    """Where the frames of a log are, and what else is there.

    Attributes
    ----------
    data : bytes
        The log.
    spans : list of (int, int, int)
        Class times 256 plus identifier, first byte, byte behind the last one; in order.
    failed : int
        Starts of frames whose checksum was wrong.
    truncated : bool
        The last frame was cut off by the end of the log.
    sentences : int
        NMEA sentences between frames.
    strange : int
        Bytes that belong to nothing known.
    """

    data: bytes
    spans: list[tuple[int, int, int]]
    failed: int
    truncated: bool
    sentences: int
    strange: int

    def of(self, kind: int) -> list[bytes]:
        """Whole frames of one kind, such as ``0x0215``."""
        return [self.data[start:stop] for k, start, stop in self.spans if k == kind]

    def notes(self) -> list[str]:
        """Sentences on what was not read."""
        notes = []
        if self.failed:
            notes.append(f"{self.failed} frames with a wrong checksum were left out.")
        if self.truncated:
            notes.append("The last frame was cut off and left out.")
        if self.strange:
            notes.append(f"{self.strange} bytes between the frames belong to no frame and no NMEA sentence.")
        return notes


def find_frames(data: bytes) -> Frames:
    """Find the frames of a u-blox log, of any kind.

    Parameters
    ----------
    data : bytes

    Returns
    -------
    Frames

    Notes
    -----
    After a wrong checksum, or a length that reaches beyond the end, the search goes on two bytes further, so a frame
    is lost only if it is damaged itself.
    """
    spans: list[tuple[int, int, int]] = []
    between: list[bytes] = []
    failed, cut_at, done = 0, -1, 0
    buffer = np.frombuffer(data, dtype=np.uint8)
    at = data.find(SYNC)
    while at >= 0:
        stop = at + _OVERHEAD + int.from_bytes(data[at + 4 : at + 6], "little")
        if stop > len(data):
            cut_at = max(cut_at, at) if cut_at < done else cut_at
            at = data.find(SYNC, at + 2)
            continue
        if checksum(buffer[at + 2 : stop - 2]) != data[stop - 2 : stop]:
            failed += 1
            at = data.find(SYNC, at + 2)
            continue
        between.append(data[done:at])
        spans.append((data[at + 2] << 8 | data[at + 3], at, stop))
        done = stop
        at = data.find(SYNC, stop)
    truncated = cut_at >= done
    between.append(data[done : cut_at if truncated else len(data)])
    sentences = strange = 0
    for piece in between:
        found = _NMEA.findall(piece)
        sentences += len(found)
        strange += len(piece) - sum(map(len, found))
    return Frames(data, spans, failed, truncated, sentences, strange)


def checksum(body: Any) -> bytes:
    """Two bytes of Fletcher's checksum of class, identifier, length and payload (UBX-22008968, 3.4)."""
    values = np.frombuffer(body, dtype=np.uint8).astype(np.int64)
    first = int(values.sum()) & 0xFF
    second = int(np.dot(values, np.arange(len(values), 0, -1))) & 0xFF
    return bytes((first, second))


def decoder() -> Any:
    """Function of pyubx2 that decodes one frame.

    Raises
    ------
    MissingExtraError
        If pyubx2 is not installed.
    """
    try:
        from pyubx2 import VALNONE, UBXReader
    except ImportError as error:
        raise MissingExtraError("pyubx2", "gnss", "reading u-blox logs") from error

    def decode(frame: bytes) -> dict[str, Any]:
        fields: dict[str, Any] = UBXReader.parse(frame, validate=VALNONE).__dict__
        return fields

    return decode
