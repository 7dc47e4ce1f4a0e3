"""Messages of Xsens sensors (MTData2) as they come: samples of the IMU and fixes of the receiver."""

from __future__ import annotations

from collections import Counter
from pathlib import Path

import numpy as np

from schuler.exceptions import InputError
from schuler.live.clock import SourceClock
from schuler.live.decoders import sensor_clock
from schuler.live.decoders.base import fix_of, in_order, samples, wanted
from schuler.live.decoders.frames import FrameDecoder, Framing
from schuler.live.messages import Fix, ImuBlock, Message
from schuler.recording.formats import ubx_messages, xsens, xsens_messages
from schuler.recording.formats.xsens_messages import TICK, Packets
from schuler.recording.io import parts
from schuler.recording.io.hint_texts import parse_streams
from schuler.recording.io.hints import ReadHints
from schuler.recording.series import Kind
from schuler.timebase import gps_from_unix

_FRAMING = Framing(
    xsens_messages.SYNC, xsens_messages.HEADER, xsens_messages.stop_of, xsens_messages.is_right
)  # fmt: skip
_PATH = Path("Xsens")
_PERIOD = 2.0**32 * TICK


class XsensDecoder(FrameDecoder):
    """Samples and fixes of MTData2, see :mod:`schuler.recording.formats.xsens`.

    On GPS time what comes before the second UTC is left out.

    Parameters
    ----------
    clock : SourceClock
    hints : ReadHints
        As for a log; increments are read with ``streams="imu=delta"``, rates or high-rate ones if nothing is said.
    announced : bool
        The run knows :attr:`kind`; otherwise its IMU is taken to be one of rates.

    Raises
    ------
    InputError
        If a hint means nothing here.
    """

    framing = _FRAMING

    def __init__(self, clock: SourceClock, hints: ReadHints, *, announced: bool = True) -> None:
        parts.check_hints(_PATH, hints, xsens.HINTS - {"rate"}, "a stream of an Xsens sensor")
        if hints.time not in (None, "gps", "local"):
            raise InputError(f"time: an Xsens sensor has time='gps' (by its UTC) or 'local', got {hints.time!r}")
        output = parse_streams(hints.streams).get("imu") or ""
        if output not in ("", *xsens.IMUS):
            raise InputError(
                f"streams: imu of an Xsens sensor is one of {', '.join(xsens.IMUS)} or none, got {output!r}"
            )
        self.left_out: Counter[str] = Counter()
        self.kind: Kind | None = None
        self._outputs: list[str] = []
        if wanted(hints, "imu"):
            self.kind = "increment" if output == "delta" else "rate"
            self._outputs = [output] if output else ["rates", "hr"]
        if output == "delta" and not announced:
            self._outputs = []
            self.left_out["streams of increments of an IMU (say format=xsens)"] += 1
        self._hints, self._bytes = hints, 0
        self._clock = sensor_clock.SensorClock(clock, hints.time == "local")
        self._axis = clock
        self._counters = {what: sensor_clock.Counter(_PERIOD) for what in ("imu", "utc")}
        self._dated, self._temperature = False, np.nan
        self._itow: int | None = None
        self._last = -np.inf

    @np.errstate(invalid="ignore", over="ignore")  # what is no number is refused, or for the navigator to leave out
    def _messages(self, frames: list[bytes]) -> list[Message]:
        by_length: dict[int, list[int]] = {}
        at = 0
        for frame in frames:
            if xsens_messages.is_data(frame):
                span = xsens_messages.span_of(frame, 0)
                assert span is not None
                by_length.setdefault(span[1] - 1 - span[0], []).append(at + span[0])
            at += len(frame)
        packets, strange = xsens_messages.packets_of(b"".join(frames), by_length)
        if strange:
            self.left_out["messages whose items do not fill them"] += strange
        block = self._samples(packets)
        self._bytes += at
        return in_order(self._fixes(packets), block)

    def _samples(self, packets: list[Packets]) -> ImuBlock | None:
        place, clock_t, unix = xsens_messages.utc_pairs(packets)
        try:
            pairs = (self._counters["utc"].seconds(clock_t), gps_from_unix(unix[:, 0]), unix[:, 1])
        except InputError as error:
            self.left_out[f"UTC of packets: {error}"] += 1
            place, pairs = place[:0], (clock_t[:0], clock_t[:0], clock_t[:0])
        self._dated = self._dated or len(place) > 0
        output, rows = None, None
        for output in self._outputs:
            rows = xsens.joined(packets, xsens.IMUS[output])
            if rows is not None:
                self._outputs = [output]
                break
        t = np.empty(0) if rows is None or "t" not in rows else self._counters["imu"].seconds(rows["t"])
        at = np.empty(0) if rows is None or "t" not in rows else rows["place"]
        seconds, good = self._clock.times(at + self._bytes, t, place + self._bytes, pairs)
        if rows is None or output is None:
            return None
        if "t" not in rows:
            self.left_out["packets without SampleTimeFine"] += len(rows["place"])
            return None
        if not good.all():
            self.left_out["packets before the second UTC (without any say time='local')"] += int((~good).sum())
        if output == "delta":
            unit = np.abs(np.linalg.norm(rows["dq"], axis=1) - 1.0) < 1e-2
            if np.any(good & ~unit):
                self.left_out["packets whose DeltaQ is no unit quaternion"] += int((good & ~unit).sum())
            good = good & unit
        if not good.any():
            return None
        rows = {name: values[good] for name, values in rows.items()}
        if "temp" in rows:
            rows["temp"] = self._held(rows["temp"])
        elif np.isfinite(self._temperature):
            rows["temp"] = np.full(int(good.sum()), self._temperature)
        return samples(xsens.imu_table(seconds[good], rows, output, []), self._hints)

    def _held(self, temperature: np.ndarray) -> np.ndarray:
        """Temperatures, the last one where there is none. Shape (n,). [degC]"""
        values = np.append(self._temperature, temperature)
        last = np.maximum.accumulate(np.where(np.isfinite(values), np.arange(len(values)), 0))
        self._temperature = float(values[last[-1]])
        return values[last[1:]]

    def _fixes(self, packets: list[Packets]) -> list[Fix]:
        made: list[Fix] = []
        for m in xsens_messages.fixes_of(packets) if wanted(self._hints, "gnss") else []:
            if m["iTOW"] == self._itow:
                continue
            self._itow = m["iTOW"]
            if self._clock.is_local or not self._dated:
                self.left_out["fixes without the UTC that relates them to the samples"] += 1
                continue
            series, start, notes = ubx_messages.solutions([m])
            if series is None:
                self.left_out[notes[0].removeprefix("NAV-PVT: 1 ").rstrip(".")] += 1
                continue
            shift = self._axis.epoch_of(start + float(series.t[0]))
            table = xsens_messages.gnss_table(series, start - shift)
            if table.values["t"][0] <= self._last:
                self.left_out["epochs not later than the one before"] += 1
                continue
            self._last = float(table.values["t"][0])
            made += fix_of(table, self._hints, self.left_out)
        return made
