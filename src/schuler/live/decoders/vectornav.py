"""VectorNav packets as they come: samples of the IMU and fixes of the receiver."""

from __future__ import annotations

from collections import Counter
from pathlib import Path

import numpy as np

from schuler.arrays import BoolArray, FloatArray
from schuler.exceptions import InputError
from schuler.live.clock import SourceClock
from schuler.live.decoders.base import fix_of, in_order, samples, wanted
from schuler.live.decoders.frames import FrameDecoder, Framing
from schuler.live.messages import Fix, ImuBlock, Message
from schuler.recording.formats import vectornav, vectornav_packets
from schuler.recording.io import parts
from schuler.recording.io.hint_texts import parse_streams
from schuler.recording.io.hints import ReadHints
from schuler.recording.io.receiver_tables import Columns, pick, timed
from schuler.recording.series import Kind
from schuler.timebase import WEEK_S

_FRAMING = Framing(
    vectornav_packets.SYNC, vectornav_packets.HEADER, vectornav_packets.stop_of, vectornav_packets.is_right
)
_ALONE = 100  # kinds of packets of which one came, by chance most of them


class VectorNavDecoder(FrameDecoder):
    """Samples and fixes of binary packets, see :mod:`schuler.recording.formats.vectornav`.

    A kind of packet counts from its second one on, which the first waits for: a checksum of 16 bits is right by chance
    now and then. The first kind that holds an IMU, and the first that holds fixes, is taken for all of the run.

    Parameters
    ----------
    clock : SourceClock
    hints : ReadHints
        As for a log; increments are read with ``streams="imu=delta"``.
    announced : bool
        The run knows :attr:`kind`; otherwise its IMU is taken to be one of rates.

    Raises
    ------
    InputError
        If a hint means nothing here.
    """

    framing = _FRAMING

    def __init__(self, clock: SourceClock, hints: ReadHints, *, announced: bool = True) -> None:
        parts.check_hints(Path("VectorNav"), hints, vectornav.HINTS - {"rate"}, "a stream of VectorNav packets")
        if hints.time not in (None, "gps", "local"):
            raise InputError(f"time: a VectorNav sensor has time='gps' or 'local', got {hints.time!r}")
        self._outputs = parse_streams(hints.streams).get("imu") or ""
        if self._outputs not in ("", *vectornav.KINDS):
            raise InputError(
                f"streams: imu of a VectorNav sensor is one of {', '.join(vectornav.KINDS)} or none, "
                f"got {self._outputs!r}"
            )
        self.left_out: Counter[str] = Counter()
        self.kind: Kind | None = None
        if wanted(hints, "imu"):
            self.kind = "increment" if self._outputs == "delta" else "rate"
        self._clock, self._hints, self._announced = clock, hints, announced
        self._alone: dict[bytes, bytes] = {}
        self._known: set[bytes] = set()
        self._of_part: dict[str, bytes] = {}
        self._before: Columns = {}

    def _messages(self, frames: list[bytes]) -> list[Message]:
        kinds: dict[bytes, list[bytes]] = {}
        for frame in frames:
            header = vectornav_packets.header_of(frame, 0)
            assert header is not None
            kinds.setdefault(header, []).append(frame)
        fixes: list[Fix] = []
        block: ImuBlock | None = None
        for header, packets in kinds.items():
            if header not in self._known:
                packets = [self._alone.pop(header), *packets] if header in self._alone else packets
                if len(packets) == 1:
                    if len(self._alone) >= _ALONE:
                        self._alone.clear()
                    self._alone[header] = packets[0]
                    continue
                self._known.add(header)
            starts = np.arange(len(packets), dtype=np.int64) * len(packets[0])
            with np.errstate(invalid="ignore", over="ignore"):  # no number: for the navigator to leave out
                rows = vectornav_packets.gather(b"".join(packets), header, starts)
                fixes += self._fixes(header, rows)
                block = self._samples(header, rows) or block
        return in_order(fixes, block)

    def _is_of(self, part: str, header: bytes, n: int) -> bool:
        """Whether packets are those that a part is taken from; the others are counted."""
        if not wanted(self._hints, part):
            return False
        if self._of_part.setdefault(part, header) == header:
            return True
        self.left_out[f"packets: there is another kind that {part} is taken from"] += n
        return False

    def _samples(self, header: bytes, rows: Columns) -> ImuBlock | None:
        present = vectornav.imu_kind(rows, self._outputs)
        if present is None or not self._is_of("imu", header, len(next(iter(rows.values())))):
            return None
        n = len(next(iter(rows.values())))
        if present == "delta" and not (self._announced and self.kind == "increment"):
            self.left_out["packets with increments of an IMU (say streams='imu=delta' and format=vectornav)"] += n
            return None
        t, good = self._times(rows, "imu")
        if not good.any():
            return None
        return samples(vectornav.imu_table(t[good], pick(rows, good), present, []), self._hints)

    def _fixes(self, header: bytes, rows: Columns) -> list[Fix]:
        if "gnss" not in vectornav.held_in(rows) or not self._is_of("gnss", header, len(rows["fix"])):
            return []
        joined = {name: np.append(self._before.get(name, np.empty(0)), values) for name, values in rows.items()}
        new = vectornav.new_fixes(joined)[len(joined["fix"]) - len(rows["fix"]) :]
        self._before = {name: values[-1:] for name, values in rows.items()}
        rows = pick(rows, new)
        good = vectornav.with_solution("gnss", "", rows, [])
        if not good.all():
            self.left_out["epochs without a fix"] += int((~good).sum())
        rows = pick(rows, good)
        t, good = self._times(rows, "gnss")
        made: list[Fix] = []
        for k in np.flatnonzero(good):
            made += fix_of(
                vectornav.gnss_table(t[k : k + 1], pick(rows, np.array([k])), self._hints, []),
                self._hints,
                self.left_out,
            )
        return made

    def _times(self, rows: Columns, part: str) -> tuple[FloatArray, BoolArray]:
        """Times of packets on the axis of the run, and which of them are times. Shape (n,). [s]"""
        n = len(next(iter(rows.values())))
        if self._hints.time == "local" or not vectornav.has_gps(rows):
            if "startup_s" in rows and n:
                t = rows["startup_s"] + rows["startup_rest"]
                self._clock.local(float(t[0]))
                return t, np.ones(n, dtype=bool)
            week_and_sow = None
        else:
            week_and_sow = vectornav.gps_time(rows, part)
        if week_and_sow is None:
            self.left_out["packets that say no time (configure TimeGps or TimeStartup)"] += n
            return np.zeros(n), np.zeros(n, dtype=bool)
        week, sow = week_and_sow
        good = timed(week, sow)
        if not good.all():
            self.left_out["packets before the sensor knew the time"] += int((~good).sum())
        if not good.any():
            return sow, good
        first = int(np.argmax(good))
        epoch = self._clock.epoch_of(float(week[first]) * WEEK_S + float(sow[first]))
        return (week * WEEK_S - epoch) + sow, good
