"""NovAtel messages as they come: fixes with the velocity of their time, counts of a SPAN receiver's IMU."""

from __future__ import annotations

from collections import Counter
from pathlib import Path

import numpy as np

from schuler.exceptions import InputError
from schuler.live.clock import SourceClock
from schuler.live.decoders.base import fix_of, heading_of, in_order, samples, wanted
from schuler.live.decoders.frames import FrameDecoder, Framing, whole_frames
from schuler.live.messages import Fix, Heading, ImuBlock, Message
from schuler.recording.formats import novatel, novatel_frames
from schuler.recording.formats.novatel_frames import ImuType, Messages
from schuler.recording.io import parts
from schuler.recording.io.columns import check_known
from schuler.recording.io.hint_texts import parse_streams
from schuler.recording.io.hints import ReadHints
from schuler.recording.io.receiver_tables import Columns, pick, timed, weeks_to_seconds
from schuler.recording.series import Kind
from schuler.timebase import WEEK_S

_FRAMING = Framing(
    novatel_frames.SYNC, novatel_frames.SHORT_BYTES, novatel_frames.stop_of, novatel_frames.is_right
)  # fmt: skip
_PATH = Path("NovAtel")
_VELOCITIES = frozenset(novatel.POSITIONS.values())
_FIRST = 20  # samples that tell the rate of the IMU
_KEPT = 4  # velocities; a position lies between the last two of them, or is later than all
_WITHOUT = 3  # positions without a velocity, after which they do not wait for one
_LONGEST_S = 2.5  # and time after which one does not wait [s]


class NovatelDecoder(FrameDecoder):
    """Fixes, headings and samples of binary messages, see :mod:`schuler.recording.formats.novatel`.

    A position waits for the first velocity that is not before it, since velocities have a latency: it gets what is
    between two of them. After three without a velocity positions no longer wait, until one comes. The most preferred
    position that has come is taken, and the first message of counts.

    Parameters
    ----------
    clock : SourceClock
    hints : ReadHints
        As for a log.
    announced : bool
        The run knows :attr:`kind`; otherwise its IMU is taken to be one of rates, and counts are left out.

    Raises
    ------
    InputError
        If a hint means nothing here.
    """

    framing = _FRAMING

    def __init__(self, clock: SourceClock, hints: ReadHints, *, announced: bool = True) -> None:
        parts.check_hints(_PATH, hints, novatel.HINTS, "a stream of NovAtel messages")
        self.left_out: Counter[str] = Counter()
        self.kind: Kind | None = "increment" if wanted(hints, "imu") else None
        chosen = parse_streams(hints.streams)
        messages_of = {"imu": novatel.RAW, "gnss": tuple(novatel.POSITIONS), "heading": novatel.HEADINGS}
        self._named = {
            part: check_known(name, names, f"streams: {part} of a NovAtel receiver")
            for part, names in messages_of.items()
            if (name := chosen.get(part)) is not None
        }
        self._clock, self._hints, self._announced = clock, hints, announced
        self._counts = self._named.get("imu")
        self._config: Columns = {}
        self._imu_type: ImuType | None = None
        self._waiting: list[bytes] = []
        self._position = self._named.get("gnss")
        self._pending: list[Columns] = []
        self._without = 0
        self._velocities: dict[str, Columns] = {}
        self._last = dict.fromkeys(messages_of, -np.inf)
        if hints.scale is not None:
            novatel.counts_of(_log({}), "", {}, hints)

    def pause(self) -> list[Message]:
        """See :class:`~schuler.live.decoders.base.Decoder`; positions go on waiting where velocities come."""
        return [] if self._velocities else [*self._ready(at_once=True)]

    def finish(self) -> list[Message]:
        """See :class:`~schuler.live.decoders.base.Decoder`."""
        frames, self._rest = whole_frames(self._rest, self.framing, self.left_out, final=True)
        return [*self._messages(frames, final=True), *self._ready(at_once=True)]

    @np.errstate(invalid="ignore", over="ignore")  # what is no number is refused, or for the navigator to leave out
    def _messages(self, frames: list[bytes], *, final: bool = False) -> list[Message]:
        made: list[Fix | Heading] = []
        imu: list[bytes] = []
        for frame in frames:
            name = novatel_frames.name_of(frame, 0)
            if name in novatel.RAW and wanted(self._hints, "imu"):
                self._counts = self._counts or name
                if name == self._counts:
                    imu.append(frame)
            elif name == "INSCONFIG":
                self._config = self._rows(name, [frame]) or self._config
            elif name in novatel.POSITIONS and wanted(self._hints, "gnss"):
                made += self._on_position(name, self._rows(name, [frame]))
            elif name in _VELOCITIES and wanted(self._hints, "gnss"):
                made += self._on_velocity(name, self._rows(name, [frame]))
            elif name == self._named.get("heading") and wanted(self._hints, "heading"):
                made += self._on_heading(name, self._rows(name, [frame]))
        return in_order(made, self._samples(imu, final=final) if imu or (final and self._waiting) else None)

    def _rows(self, name: str, frames: list[bytes]) -> Columns:
        """Columns of messages of one kind; empty if there is none that is long enough and has a time."""
        stops = np.cumsum([len(frame) for frame in frames]).tolist()
        places = list(zip([0, *stops[:-1]], stops, strict=True))
        rows = novatel_frames.gather(b"".join(frames), name, places, [])
        if short := len(frames) - len(rows["header_week"]):
            self.left_out[f"messages {name} that are shorter than this kind is"] += short
        week, sow = ("week", "sow") if name in novatel.RAW else ("header_week", "header_sow")
        good = timed(rows[week], rows[sow])
        if not good.all():
            self.left_out["messages before the receiver knew the time"] += int((~good).sum())
        return pick(rows, good) if good.any() else {}

    def _is_new(self, part: str, rows: Columns) -> bool:
        """Whether a message has another time than the one before it."""
        t = float(rows["header_week"][0] * WEEK_S + rows["header_sow"][0])
        if t == self._last[part]:
            self.left_out["epochs repeated"] += 1
            return False
        self._last[part] = t
        return True

    def _usable(self, part: str, name: str, rows: Columns) -> Columns:
        """Rows that hold a solution; empty without."""
        kept = novatel.usable(_log({name: rows}), part, name, [], named=part in self._named)
        if not len(kept["status"]):
            self.left_out[f"epochs of {name} without a solution of GNSS alone"] += 1
            return {}
        return kept

    def _on_position(self, name: str, rows: Columns) -> list[Fix]:
        order = list(novatel.POSITIONS)
        if self._position is None or ("gnss" not in self._named and order.index(name) < order.index(self._position)):
            self._position, self._without = name, 0
            self._pending.clear()
            self._last["gnss"] = -np.inf
        if name != self._position or not rows or not self._is_new("gnss", rows):
            return []
        rows = self._usable("gnss", name, rows)
        if not rows:
            return []
        self._pending.append(rows)
        self._without += 1
        return self._ready()

    def _on_velocity(self, name: str, rows: Columns) -> list[Fix]:
        if not rows or not (novatel.velocities_alone(rows) & np.isfinite(rows["latency"])).all():
            return []
        before = self._velocities.get(name)
        if before is not None:
            if _seconds(rows, -1) <= _seconds(before, -1):
                self._velocities.pop(name)  # the clock stepped
            else:
                rows = {label: np.append(before[label], values)[-_KEPT:] for label, values in rows.items()}
        self._velocities[name] = rows
        if self._position is not None and name == novatel.POSITIONS[self._position]:
            self._without = 0
        return self._ready()

    def _ready(self, *, at_once: bool = False) -> list[Fix]:
        """Fixes of the positions that need not wait any longer."""
        made: list[Fix] = []
        while self._pending and self._position is not None:
            t = _seconds(self._pending[0], 0)
            v = self._velocities.get(novatel.POSITIONS[self._position])
            waits = v is None or _seconds(v, -1) - v["latency"][-1] < t
            waits &= self._without <= _WITHOUT and abs(_seconds(self._pending[-1], 0) - t) <= _LONGEST_S
            if waits and not at_once:
                break
            made += self._fix(self._position, self._pending.pop(0))
        return made

    @np.errstate(invalid="ignore", over="ignore")
    def _fix(self, name: str, rows: Columns) -> list[Fix]:
        first, t, shift = self._times(rows, "header_week", "header_sow")
        velocity = novatel.POSITIONS[name]
        log = _log({name: rows} | ({velocity: v} if (v := self._velocities.get(velocity)) else {}))
        try:
            table = novatel.gnss_table(log, name, t, rows, first, self._hints, [])
        except InputError as error:
            self.left_out[f"epochs: {error}"] += 1
            return []
        table.values["t"] = table.values["t"] + shift
        return list(fix_of(table, self._hints, self.left_out))

    def _on_heading(self, name: str, rows: Columns) -> list[Heading]:
        if not rows or not self._is_new("heading", rows) or not (rows := self._usable("heading", name, rows)):
            return []
        _, t, shift = self._times(rows, "header_week", "header_sow")
        return list(heading_of(novatel.heading_table(name, t + shift, rows, []), self._hints, self.left_out))

    def _samples(self, frames: list[bytes], *, final: bool) -> ImuBlock | None:
        """Samples of an IMU; the first ones wait until their rate is known."""
        if not self._announced:
            self.left_out["samples of an IMU, which are increments (say format=novatel)"] += len(frames)
            return None
        frames, self._waiting = self._waiting + frames, []
        if self._imu_type is None and len(frames) < _FIRST and not final:
            self._waiting = frames
            return None
        name = self._counts or ""
        rows = self._rows(name, frames)
        if not rows:
            return None
        log = _log({"INSCONFIG": self._config} if self._config else {})
        _, t, shift = self._times(rows, "week", "sow")
        try:
            imu_type = novatel.counts_of(log, name, rows, self._hints)
            if self._imu_type not in (None, imu_type):
                raise InputError(f"{name}: the IMU changes its type within the stream: end the run, and begin it again")
            if self._imu_type is None:
                novatel.check_not_thinned(name, t, imu_type, _PATH)
        except InputError as error:
            self.left_out[f"samples: {error}"] += len(t)
            return None
        self._imu_type = imu_type
        return samples(novatel.imu_table(t + shift, rows, imu_type), self._hints)

    def _times(self, rows: Columns, week: str, sow: str) -> tuple[float, np.ndarray, float]:
        """A week, seconds since its start, and what makes them times of the run. [weeks], [s] (n,), [s]"""
        epoch = self._clock.epoch_of(_seconds(rows, 0, week, sow))
        first = epoch // WEEK_S
        return first, weeks_to_seconds(rows[week], rows[sow], first), first * WEEK_S - epoch


def _seconds(rows: Columns, k: int, week: str = "header_week", sow: str = "header_sow") -> float:
    """GPS time of a row since 1980. [s]"""
    return float(rows[week][k] * WEEK_S + rows[sow][k])


def _log(columns: dict[str, Columns]) -> Messages:
    """Messages of a stream as those of a file."""
    return Messages(_PATH, columns, {}, {}, [])
