"""Logs of SBG units (sbgECom) as they come: samples of the IMU, fixes with the velocity of their time."""

from __future__ import annotations

from collections import Counter
from pathlib import Path

import numpy as np

from schuler.arrays import BoolArray, FloatArray
from schuler.exceptions import InputError
from schuler.live.clock import SourceClock
from schuler.live.decoders import sensor_clock
from schuler.live.decoders.base import fix_of, in_order, samples, wanted
from schuler.live.decoders.frames import FrameDecoder, Framing
from schuler.live.messages import Fix, ImuBlock, Message
from schuler.recording.formats import sbg
from schuler.recording.io import parts
from schuler.recording.io.hint_texts import parse_streams
from schuler.recording.io.hints import ReadHints
from schuler.recording.io.receiver_tables import Columns, pick
from schuler.recording.series import Kind

_FRAMING = Framing(sbg.SYNC, sbg.HEAD, sbg.stop_of, sbg.is_right)
_PATH = Path("SBG")
_ALONE = 20  # frames of a log that come alone before it is taken in place of a preferred one
_LEARNT = 3  # fixes after which it is known whether velocities come, too


class SbgDecoder(FrameDecoder):
    """Samples and fixes of logs, see :mod:`schuler.recording.formats.sbg`.

    A fix waits for the velocity of its time where velocities come. On GPS time what comes before the second UTC_TIME
    is left out.

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
        parts.check_hints(_PATH, hints, sbg.HINTS, "a stream of an SBG unit")
        if hints.time not in (None, "gps", "local"):
            raise InputError(f"time: an SBG unit has time='gps' (by UTC_TIME) or 'local', got {hints.time!r}")
        chosen = parse_streams(hints.streams)
        for part in ("imu", "gnss"):
            if chosen.get(part) not in (None, *sbg.ORDERS[part]):
                raise InputError(
                    f"streams: {part} of an SBG unit is one of {', '.join(sbg.ORDERS[part])} or none, "
                    f"got {chosen[part]!r}"
                )
        self.left_out: Counter[str] = Counter()
        self.kind: Kind | None = "rate" if wanted(hints, "imu") else None
        self._hints, self._bytes = hints, 0
        self._wanted = [part for part in ("imu", "gnss") if wanted(hints, part)]
        self._taken = {part: chosen.get(part) for part in self._wanted}
        self._counter = sensor_clock.Counter(sbg.WRAP)
        self._clock = sensor_clock.SensorClock(clock, hints.time == "local")
        self._position: Columns | None = None
        self._moves, self._fixes_count = False, 0

    def pause(self) -> list[Message]:
        """See :class:`~schuler.live.decoders.base.Decoder`."""
        return list(self._complete(None))

    @np.errstate(invalid="ignore", over="ignore")  # what is no number is refused, or for the navigator to leave out
    def _messages(self, frames: list[bytes]) -> list[Message]:
        columns = self._columns(frames)
        utc = columns.get("UTC_TIME")
        place, *pairs = np.empty((4, 0)) if utc is None else sbg.utc_pairs(utc)
        names = [name for name in columns if name != "UTC_TIME"]
        rows_at = np.concatenate([columns[name]["place"] for name in names]) if names else np.empty(0)
        t = np.concatenate([columns[name]["t"] for name in names]) if names else np.empty(0)
        seconds, good = self._clock.times(rows_at, t, place, (pairs[0], pairs[1], pairs[2]))
        if not good.all():
            self.left_out["frames before the second UTC_TIME (without any say time='local')"] += int((~good).sum())
        timed: dict[str, tuple[FloatArray, BoolArray]] = {}
        first = 0
        for name in names:
            stop = first + len(columns[name]["t"])
            timed[name] = seconds[first:stop], good[first:stop]
            first = stop
        block: ImuBlock | None = None
        imu = self._name("imu", columns)
        if imu is not None and imu in columns and timed[imu][1].any():
            at, good = timed[imu]
            block = samples(sbg.imu_table(imu, at[good], pick(columns[imu], good), []), self._hints)
        return in_order(self._fixes(columns, timed), block)

    def _columns(self, frames: list[bytes]) -> dict[str, Columns]:
        """Fields of frames by log, their stamps counted on, their places those in the stream."""
        places: dict[str, list[tuple[int, int]]] = {}
        at = 0
        for frame in frames:
            name = sbg.name_of(frame, 0)
            if name is not None:
                places.setdefault(name, []).append((at, at + len(frame)))
            at += len(frame)
        short: list[str] = []
        columns = sbg.fields_of(b"".join(frames), places, short)
        if short:
            self.left_out["kinds of frames that are shorter than they should be"] += len(short)
        if columns:
            place = np.concatenate([rows["place"] for rows in columns.values()])
            t = np.concatenate([rows["t"] for rows in columns.values()]) * sbg.US
            order = np.argsort(place, kind="stable")
            t[order] = self._counter.seconds(t[order])
            first = 0
            for rows in columns.values():
                rows["t"] = t[first : first + len(rows["t"])]
                rows["place"] = rows["place"] + self._bytes
                first += len(rows["t"])
        self._bytes += at
        return columns

    def _name(self, part: str, columns: dict[str, Columns]) -> str | None:
        """Log that a part is taken from: the preferred one, or another that comes alone for a while."""
        if part not in self._wanted:
            return None
        if self._taken[part] is None:
            preferred, other = sbg.ORDERS[part]
            if preferred in columns:
                self._taken[part] = preferred
            elif other in columns:
                phrase = f"frames of {other} before it was clear that {preferred} does not come"
                self.left_out[phrase] += len(columns[other]["t"])
                if self.left_out[phrase] >= _ALONE:
                    self._taken[part] = other
                return None
        return self._taken[part]

    def _fixes(self, columns: dict[str, Columns], timed: dict[str, tuple[FloatArray, BoolArray]]) -> list[Fix]:
        name = self._name("gnss", columns)
        if name is None:
            return []
        moved = name.replace("POS", "VEL")
        entries: list[tuple[float, str, int]] = []
        for log in (name, moved):
            if log in columns:
                entries += [(at, log, k) for k, at in enumerate(columns[log]["place"].tolist())]
        made: list[Fix] = []
        for _, log, k in sorted(entries):
            row = pick(columns[log], np.array([k]))
            if log == moved:
                self._moves = True
                made += self._complete(row)
                continue
            made += self._complete(None)
            at, good = timed[log]
            if not good[k]:
                continue
            row["t"] = at[k : k + 1]
            row = sbg.usable("gnss", name, row, [])
            if not len(row["t"]):
                self.left_out[f"epochs of {name} without a solution"] += 1
                continue
            self._fixes_count += 1
            self._position = row
            if not self._moves and self._fixes_count > _LEARNT:
                made += self._complete(None)
        return made

    def _complete(self, moved: Columns | None) -> list[Fix]:
        """The fix that waits, with a velocity if it is of its time; one of another time leaves it waiting."""
        row = self._position
        if row is None or (moved is not None and moved["tow"][0] != row["tow"][0]):
            return []
        self._position = None
        name = self._taken["gnss"]
        assert name is not None
        columns = {} if moved is None else {name.replace("POS", "VEL"): moved}
        log = sbg.Frames(_PATH, columns, {}, [])
        table = sbg.gnss_table(log, name, row["t"], row, [], dated=not self._clock.is_local)
        return fix_of(table, self._hints, self.left_out)
