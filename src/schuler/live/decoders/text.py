"""Lines of numbers as they come, in the columns, units and axes that the hints of a log name.

Samples of an IMU are made here, number by number, since they come hundreds of times a second; lines of the slower
series go through the reader of tables.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import replace
from pathlib import Path

import numpy as np

from schuler.exceptions import InputError
from schuler.live.clock import SourceClock
from schuler.live.decoders.base import fixes
from schuler.live.messages import Heading, Height, ImuSample, Message, Speed
from schuler.recording.io import columns
from schuler.recording.io.assemble import series_from
from schuler.recording.io.clock import LATEST_S
from schuler.recording.io.hint_texts import (
    ColumnSpec,
    axes_matrix,
    factor,
    parse_columns,
    parse_scale,
    parse_time,
    parse_units,
)
from schuler.recording.io.hints import ReadHints
from schuler.recording.io.lines import is_number
from schuler.recording.io.raw import HUGE, Raw
from schuler.recording.series import GnssSeries, Kind, OdometerSeries
from schuler.timebase import UNIX_TO_GPS_S, WEEK_S, TimeBase, gps_from_unix, gps_seconds

_LONGEST = 4096  # bytes without a line feed that may still become a line
#: Series that lines can hold.
STREAMED = ("imu", "gnss", "odometer", "heading", "height")


class TextDecoder:
    """Messages of lines of text, one row each.

    Parameters
    ----------
    clock : SourceClock
    hints : ReadHints
        As for a log; ``columns`` in order, ``units`` of an IMU. Without a column ``t`` either ``rate`` counts the
        samples or ``by_arrival`` stamps them.
    by_arrival : bool
        Stamp every row by the clock of this machine when it comes, whatever its own stamp is.
    whole : bool
        Each piece that is fed ends a line, as datagrams do.

    Raises
    ------
    InputError
        If the hints do not say how a line is read.
    """

    def __init__(self, clock: SourceClock, hints: ReadHints, *, by_arrival: bool = False, whole: bool = False) -> None:
        self.left_out: Counter[str] = Counter()
        self._clock, self._hints, self._by_arrival, self._whole = clock, hints, by_arrival, whole
        self._columns, self._more = _columns_in_order(hints)
        self._delimiter = hints.delimiter
        self._comments = (hints.comment,) if hints.comment else ("#", "%", "//")
        names = [spec.name for spec in self._columns if spec is not None]
        self.series = _series_of(hints, names)
        self.kind: Kind | None = hints.kind if self.series == "imu" else None
        if "t" not in names and not by_arrival and hints.rate is None:
            raise InputError(
                "columns: there is no time: name it (t), or say stamp=arrival to stamp lines as they come, or rate=..."
            )
        self._time = parse_time(hints.time)
        self._factors = _factors(hints, self._columns, self.series)
        self._turn = _turn(hints)
        self._table_hints = _without_time(hints)
        self._rest, self._rows, self._weeks = b"", 0, 0
        self._previous = -np.inf

    def feed(self, data: bytes, arrival: float) -> list[Message]:
        """See :class:`~schuler.live.decoders.base.Decoder`."""
        *lines, rest = (self._rest + data + (b"\n" if self._whole else b"")).split(b"\n")
        if len(rest) > _LONGEST:
            self.left_out["pieces without a line feed"] += 1
            rest = b""
        self._rest = rest
        return [message for line in lines for message in self._row(line, arrival)]

    def pause(self) -> list[Message]:
        """See :class:`~schuler.live.decoders.base.Decoder`."""
        return []

    def finish(self) -> list[Message]:
        """See :class:`~schuler.live.decoders.base.Decoder`."""
        rest, self._rest = self._rest, b""
        return [] if self._by_arrival else self._row(rest, 0.0)

    def _row(self, line: bytes, arrival: float) -> list[Message]:
        values = self._values(line)
        if values is None:
            return []
        t = self._stamp(values.pop("t", None), arrival)
        if t is None:
            return []
        messages = self._sample(t, values) if self.series == "imu" else self._slower(t, values)
        self._rows += len(messages)
        return messages

    def _values(self, line: bytes) -> dict[str, float] | None:
        """Numbers of a line by their column; ``None`` for blank lines, comments and what is no row."""
        text = line.decode("ascii", "replace").strip(" \r\n" if self._delimiter == "\t" else None)
        if not text or text.startswith(self._comments):
            return None
        delimiter = self._delimiter or next((c for c in ";\t," if c in text), " ")
        fields = text.split() if delimiter == " " else [field.strip() for field in text.split(delimiter)]
        if len(fields) == len(self._columns) or (self._more and len(fields) > len(self._columns)):
            used = [(spec.name, f) for spec, f in zip(self._columns, fields, strict=False) if spec is not None]
            if all(is_number(field) for _, field in used):
                values = {name: float(field) for name, field in used}
                if all(abs(value) <= HUGE for value in values.values()):
                    self._delimiter = delimiter  # guessed anew until a line is a row: a stream may begin with garbage
                    return values
        self.left_out[f"lines that are no rows of {self._hints.columns}"] += 1
        return None

    def _stamp(self, t: float | None, arrival: float) -> float | None:
        """Time of a row on the axis of the run; ``None`` if its own stamp is impossible. [s]"""
        if self._by_arrival:
            return self._clock.seconds(float(np.floor(arrival)), arrival % 1.0) + self._hints.offset
        if t is None:
            t = (self._rows + (self._hints.kind == "increment")) / (self._hints.rate or np.nan)
        else:
            t *= self._factors["t"]
        seconds = self._on_axis(t)
        if seconds is None:
            self.left_out[f"lines whose stamp is impossible for time={self._hints.time!r}"] += 1
            return None
        return seconds + self._hints.offset

    def _on_axis(self, t: float) -> float | None:
        """A stamp as seconds of the run, ``None`` if it cannot be what the hint ``time`` says. [s]"""
        kind = self._time.kind
        if kind == "local":
            return self._clock.local(t)
        if kind == "gps-tow":
            if not 0.0 <= t <= WEEK_S:
                return None
            # the stamps of a stream that runs into the next week start again at zero
            self._weeks += t - self._previous < -0.5 * WEEK_S
            self._previous = t
            week = gps_seconds(self._time.week + self._weeks, 0.0)
            return (week - self._clock.epoch_of(week + t)) + t
        if kind == "unix":
            try:
                t = float(gps_from_unix(np.array([t]))[0])
            except InputError:
                return None
        elif kind == "gps-unix":
            t -= UNIX_TO_GPS_S
        return self._clock.seconds(t) if 0.0 <= t <= LATEST_S else None

    def _sample(self, t: float, values: dict[str, float]) -> list[Message]:
        """A sample of an IMU in SI units, forward, right, down."""
        si = {name: value * self._factors[name] for name, value in values.items()}
        gyro, accel = (
            np.array([si[names[k]] if forward else 0.0 - si[names[k]] for k, forward in self._turn])
            for names in (columns.GYRO, columns.ACCEL)
        )
        return [ImuSample(t, gyro, accel, si.get("temp"))]

    def _slower(self, t: float, values: dict[str, float]) -> list[Message]:
        """A fix, a speed, a heading or a height, made by the reader of tables."""
        raw = Raw(Path("line"), {name: np.array([value]) for name, value in {"t": t, **values}.items()})
        try:
            made, _ = series_from(raw, self._table_hints, time=TimeBase("local"))
        except InputError as error:
            self.left_out[f"lines: {error}"] += 1
            return []
        series = made[self.series]
        if isinstance(series, GnssSeries):
            return list(fixes(series))
        if isinstance(series, OdometerSeries):
            return [Speed(t, float(series.speed[0]), float(series.sigma[0]))]
        kind = Heading if self.series == "heading" else Height
        return [kind(t, float(series.value[0]), float(series.sigma[0]))]


def _columns_in_order(hints: ReadHints) -> tuple[list[ColumnSpec | None], bool]:
    """Columns of a line, ``None`` where it is of no use, and whether more may follow."""
    parsed = parse_columns(hints.columns)
    if parsed is None:
        raise InputError("lines of text: the columns are not known: say columns='t,ax,ay,az,gx,gy,gz'")
    specs, more = parsed
    if any(spec is not None and spec.source is not None for spec in specs):
        raise InputError(f"columns: a stream has no header: name its columns in their order, got {hints.columns!r}")
    useless = (*columns.MAG, "received", *columns.DILUTION)
    return [None if spec is None or spec.name in useless else spec for spec in specs], more


def _series_of(hints: ReadHints, names: list[str]) -> str:
    """The one series that the columns are of."""
    recognised = [hints.series] if hints.series is not None else columns.series_of(names)
    if len(recognised) != 1 or recognised[0] not in STREAMED:
        what = " and ".join(recognised) or "no series"
        raise InputError(
            f"columns: expected one of {', '.join(STREAMED)} in each line, got {what} in {hints.columns!r}"
        )
    series = recognised[0]
    if series == "imu" and (missing := [name for name in (*columns.ACCEL, *columns.GYRO) if name not in names]):
        raise InputError(f"columns: expected ax, ay, az, gx, gy and gz of an IMU, {', '.join(missing)} missing")
    return series


def _factors(hints: ReadHints, specs: list[ColumnSpec | None], series: str) -> dict[str, float]:
    """Factors to SI units of the time and the columns of an IMU; others are seen to by the reader of tables."""
    stated, scale = {"t": "s", "temp": "degC", **parse_units(hints.units, hints.kind)}, parse_scale(hints.scale) or {}
    if isinstance(scale, str):
        raise InputError(f"scale={scale!r} names an array of a file: give numbers")
    factors = {}
    for spec in specs:
        if spec is None or (spec.name != "t" and series != "imu"):
            continue
        group = columns.GROUP[spec.name] or ""
        if group not in stated:
            raise InputError(f"the unit of {spec.name} is not known: say units='g,deg/s' (accelerometer, gyro)")
        number = scale.get(spec.name, scale.get(group, 1.0)) * (-1.0 if spec.negated else 1.0)
        factors[spec.name] = number * factor(stated[group], group, hints.kind)
    return factors


def _turn(hints: ReadHints) -> list[tuple[int, bool]]:
    """For forward, right and down the sensor's axis, and whether it points that way."""
    return [(int(np.argmax(np.abs(row))), bool(row.max() > 0.0)) for row in axes_matrix(hints.axes)]


def _without_time(hints: ReadHints) -> ReadHints:
    """Hints for the reader of tables, which gets times that are made already."""
    units, scale = parse_units(hints.units, hints.kind), parse_scale(hints.scale)
    kept = ",".join(f"{group}={unit}" for group, unit in units.items() if group != "t") or None
    factors = {name: f for name, f in scale.items() if name != "t"} if isinstance(scale, dict) else scale
    return replace(hints, units=kept, scale=factors or None, time=None, offset=0.0, rate=None)
