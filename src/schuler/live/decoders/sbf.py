"""Septentrio blocks as they come: fixes and headings with the covariances of their epoch, samples of the IMU."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from schuler.arrays import BoolArray, FloatArray
from schuler.exceptions import InputError
from schuler.live.clock import SourceClock
from schuler.live.decoders.base import fix_of, heading_of, in_order, samples, wanted
from schuler.live.decoders.frames import FrameDecoder, Framing
from schuler.live.messages import Fix, Heading, ImuBlock, Message
from schuler.recording.formats import sbf, sbf_blocks
from schuler.recording.formats.sbf_blocks import Blocks
from schuler.recording.io import parts
from schuler.recording.io.hints import ReadHints
from schuler.recording.io.receiver_tables import Columns, pick, timed
from schuler.recording.series import Kind
from schuler.timebase import WEEK_S

_FRAMING = Framing(sbf_blocks.SYNC, sbf_blocks.HEADER, sbf_blocks.stop_of, sbf_blocks.is_right)
_PATH = Path("SBF")
_TIME = slice(8, 14)  # bytes of a block that say its time
#: Blocks of an epoch, by part; the first holds the solution.
_OF_PART = {"gnss": ("PVTGeodetic", "PosCovGeodetic", "VelCovGeodetic"), "heading": ("AttEuler", "AttCovEuler")}
_PART_OF = {name: part for part, names in _OF_PART.items() for name in names}
_LEARNT = 3  # epochs after which the blocks that an epoch has are known


@dataclass
class _Epoch:
    """Blocks of one time of a part, and those that epochs have had so far."""

    time: bytes = b""
    blocks: dict[str, bytes] = field(default_factory=dict)
    usual: set[str] = field(default_factory=set)
    count: int = 0
    given: bool = True


class SbfDecoder(FrameDecoder):
    """Fixes, headings and samples of blocks, see :mod:`schuler.recording.formats.sbf`.

    An epoch is complete when it has all kinds of blocks that came before, when the next one begins, or when the
    receiver pauses.

    Parameters
    ----------
    clock : SourceClock
    hints : ReadHints
        As for a log.

    Raises
    ------
    InputError
        If a hint means nothing here.
    """

    framing = _FRAMING

    def __init__(self, clock: SourceClock, hints: ReadHints) -> None:
        parts.check_hints(_PATH, hints, sbf.HINTS, "a stream of SBF blocks")
        self.left_out: Counter[str] = Counter()
        self.kind: Kind | None = "rate" if wanted(hints, "imu") else None
        self._clock, self._hints = clock, hints
        self._epochs = {part: _Epoch() for part in _OF_PART if wanted(hints, part)}
        self._last = dict.fromkeys(self._epochs, -np.inf)
        self._lone: list[bytes] = []

    def pause(self) -> list[Message]:
        """See :class:`~schuler.live.decoders.base.Decoder`."""
        return [measurement for part in self._epochs for measurement in self._complete(part)]

    @np.errstate(invalid="ignore", over="ignore")  # what is no number is refused, or for the navigator to leave out
    def _messages(self, frames: list[bytes]) -> list[Message]:
        made: list[Fix | Heading] = []
        imu: list[bytes] = []
        for frame in frames:
            name = sbf_blocks.name_of(frame, 0)
            if name == "ExtSensorMeas":
                imu.append(frame)
            elif name in _PART_OF and _PART_OF[name] in self._epochs:
                made += self._collect(_PART_OF[name], name, frame)
        return in_order(made, self._samples(imu) if imu and self.kind else None)

    def _collect(self, part: str, name: str, frame: bytes) -> list[Fix | Heading]:
        """Add a block to its epoch; what that completes."""
        epoch = self._epochs[part]
        made: list[Fix | Heading] = []
        if frame[_TIME] != epoch.time:
            made = self._complete(part)
            epoch.time, epoch.blocks, epoch.given = frame[_TIME], {}, False
            epoch.count += 1
        epoch.blocks.setdefault(name, frame)
        if epoch.count > _LEARNT and epoch.usual <= set(epoch.blocks):
            made += self._complete(part)
        epoch.usual.add(name)
        return made

    @np.errstate(invalid="ignore", over="ignore")
    def _complete(self, part: str) -> list[Fix | Heading]:
        """The fix or heading of an epoch; nothing if it was given already."""
        epoch = self._epochs[part]
        name = _OF_PART[part][0]
        if epoch.given or name not in epoch.blocks:
            return []
        epoch.given = True
        log = _blocks(list(epoch.blocks.values()))
        rows = sbf.solutions(log, part, name, [])
        if not len(rows["week"]):
            self.left_out[f"epochs of {name} without a solution"] += 1
            return []
        t, good = self._times(rows)
        if not good.all():
            return []
        if t[0] == self._last[part]:
            self.left_out["epochs repeated"] += 1
            return []
        self._last[part] = float(t[0])
        make = sbf.gnss_table if part == "gnss" else sbf.heading_table
        try:
            table = make(log, t, rows, self._hints, [])
        except InputError as error:
            self.left_out[f"epochs: {error}"] += 1
            return []
        if table is None:
            self.left_out["headings without an accuracy (AttCovEuler, or sigma_heading_deg=..)"] += 1
            return []
        return list((fix_of if part == "gnss" else heading_of)(table, self._hints, self.left_out))

    def _samples(self, frames: list[bytes]) -> ImuBlock | None:
        """Samples of blocks; the newest may have its specific force and its angular rate in two of them."""
        frames = self._lone + frames
        rows = sbf.imu_rows(_blocks(frames), [])
        newest = frames[-1][_TIME]
        ms, week = int.from_bytes(newest[:4], "little"), int.from_bytes(newest[4:], "little")
        whole = np.any((rows["ms"] == ms) & (rows["week"] == week))
        self._lone = [] if whole else [frame for frame in frames if frame[_TIME] == newest][-2:]
        t, good = self._times(rows)
        if not good.any():
            return None
        return samples(sbf.imu_table(_blocks(frames), t[good], pick(rows, good), self._hints, []), self._hints)

    def _times(self, rows: Columns) -> tuple[FloatArray, BoolArray]:
        """Times of blocks on the axis of the run, and which of them are times. Shape (n,). [s]"""
        week, sow = rows["week"], rows["ms"] * 1e-3
        good = timed(week, sow)
        if not good.all():
            self.left_out["blocks before the receiver knew the time"] += int((~good).sum())
        if not good.any():
            return sow, good
        first = int(np.argmax(good))
        epoch = self._clock.epoch_of(float(week[first]) * WEEK_S + float(sow[first]))
        return (week * WEEK_S - epoch) + sow, good


def _blocks(frames: list[bytes]) -> Blocks:
    """Blocks of a stream as those of a file."""
    spans: dict[str, list[tuple[int, int]]] = {}
    at = 0
    for frame in frames:
        spans.setdefault(sbf_blocks.name_of(frame, 0) or "", []).append((at, at + len(frame)))
        at += len(frame)
    places = {name: np.array(of_name, dtype=np.int64) for name, of_name in spans.items()}
    return Blocks(_PATH, np.frombuffer(b"".join(frames), dtype=np.uint8), places, {}, [])
