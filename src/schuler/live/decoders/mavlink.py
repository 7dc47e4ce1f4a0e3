"""MAVLink messages of an autopilot as they come: samples of its IMU and fixes of its receiver."""

from __future__ import annotations

import struct
from collections import Counter
from pathlib import Path

import numpy as np

from schuler import units
from schuler.exceptions import InputError
from schuler.live.clock import SourceClock
from schuler.live.decoders.base import fix_of, in_order, samples, wanted
from schuler.live.mavlink import crc
from schuler.live.messages import Fix, ImuBlock, Message
from schuler.recording.io import over_ground, parts
from schuler.recording.io.hint_texts import parse_streams
from schuler.recording.io.hints import ReadHints
from schuler.recording.io.parts import Table
from schuler.recording.series import Kind
from schuler.timebase import gps_from_unix

#: Hints that mean something in a stream of MAVLink.
HINTS = ("axes", "height", "geoid_separation", "sigma", "sigma_speed", "streams", "time")
_STARTS = {0xFE: 6, 0xFD: 10}  # first byte of version 1 and 2: length of the header
_SIGNED, _SIGNATURE = 1, 13  # flag of version 2; bytes behind the checksum
_HIGHRES, _SCALED, _RAW, _GPS = 105, 26, 27, 24
_KINDS = {"highres": _HIGHRES, "scaled": _SCALED, "raw": _RAW}
# By identifier: seed of the checksum, layout with its extensions.
_MESSAGES = {
    _HIGHRES: (93, struct.Struct("<Q13fHB")),
    _SCALED: (170, struct.Struct("<I10h")),
    _RAW: (144, struct.Struct("<Q9hBh")),
    _GPS: (24, struct.Struct("<Q3i4H2Bi4IH")),
}
_OTHER: tuple[int, tuple[float, ...]] = (-1, ())  # a message that is not read
_MILLI_G, _MILLI_RAD = 1e-3 * units.G0, 1e-3  # of SCALED_IMU; ArduPilot sends RAW_IMU in them, too
_UPDATED = 0x3F  # rates and specific forces of HIGHRES_IMU are new
_UNIX_US = 1e15  # a stamp beyond is Unix time, not time since boot [us]
_UNSET = 0xFFFF
#: Types of fix with a height, by those of :data:`schuler.recording.series.QUALITY`.
QUALITY = {3: 5, 4: 4, 5: 2, 6: 1, 8: 6}


class MavlinkDecoder:
    """Samples of HIGHRES_IMU, SCALED_IMU or RAW_IMU and fixes of GPS_RAW_INT, versions 1 and 2.

    The first kind of message that holds an IMU is taken for all of the run, RAW_IMU only where ``streams="imu=raw"``
    asks for it: its units are the autopilot's own, here those of ArduPilot (milli-g, mrad/s). Stamps are time since
    boot, or GPS time where they are Unix time.

    Parameters
    ----------
    clock : SourceClock
    hints : ReadHints
        As for a log; ``streams`` names the IMU: ``imu=highres``, ``scaled``, ``raw`` or ``none``.

    Raises
    ------
    InputError
        If a hint means nothing here.

    References
    ----------
    MAVLink, "Serialization" and the message set "common" (mavlink.io).
    """

    def __init__(self, clock: SourceClock, hints: ReadHints) -> None:
        parts.check_hints(Path("MAVLink"), hints, HINTS, "a stream of MAVLink")
        if hints.time not in (None, "local"):
            raise InputError(f"time: MAVLink has time='local' (since boot) or says it itself, got {hints.time!r}")
        chosen = parse_streams(hints.streams).get("imu") or ""
        if chosen not in ("", *_KINDS):
            raise InputError(f"streams: imu of MAVLink is one of {', '.join(_KINDS)} or none, got {chosen!r}")
        self.left_out: Counter[str] = Counter()
        self.kind: Kind | None = "rate" if wanted(hints, "imu") else None
        self._clock, self._hints, self._rest = clock, hints, b""
        self._imu = _KINDS.get(chosen)
        self._last: dict[int, float] = {}

    def feed(self, data: bytes, arrival: float) -> list[Message]:
        """See :class:`~schuler.live.decoders.base.Decoder`."""
        return self._messages(self._rest + data, final=False)

    def pause(self) -> list[Message]:
        """See :class:`~schuler.live.decoders.base.Decoder`."""
        return []

    def finish(self) -> list[Message]:
        """See :class:`~schuler.live.decoders.base.Decoder`."""
        return self._messages(self._rest, final=True)

    def _messages(self, data: bytes, *, final: bool) -> list[Message]:
        rows: list[tuple[float, ...]] = []
        fixes: list[Fix] = []
        at, self._rest = 0, b""
        while at < len(data):
            stop = _stop_of(data, at)
            if stop is None and not final:
                self._rest = data[at:]
                break
            payload = None if stop is None or stop == at else _payload(data[at:stop])
            if payload == _OTHER and stop == len(data) and not final:
                self._rest = data[at:]
                break
            if (
                stop is None
                or payload is None
                or (payload == _OTHER and stop < len(data) and data[stop] not in _STARTS)
            ):
                self.left_out["bytes that belong to no message with a right checksum"] += 1
                at += 1
                continue
            at = stop
            identifier, values = payload
            if identifier == _GPS:
                fixes += self._fix(values)
            elif values and (row := self._sample(identifier, values)) is not None:
                rows.append(row)
        block: ImuBlock | None = None
        if rows:
            columns = dict(zip(("t", "ax", "ay", "az", "gx", "gy", "gz", "temp"), np.array(rows).T, strict=True))
            if np.isnan(columns["temp"]).all():
                del columns["temp"]
            block = samples(Table({name: np.ascontiguousarray(x) for name, x in columns.items()}), self._hints)
        return in_order(fixes, block)

    def _sample(self, identifier: int, values: tuple[float, ...]) -> tuple[float, ...] | None:
        """Time, specific force, rate, temperature of an IMU's message; None if it is not the one that is taken."""
        if not wanted(self._hints, "imu"):
            return None
        if self._imu is None and identifier != _RAW:
            self._imu = identifier
        if identifier != self._imu:
            other = "RAW_IMU has the autopilot's own units (say streams='imu=raw')"
            self.left_out[f"messages: {other if identifier == _RAW else 'the IMU is taken from another kind'}"] += 1
            return None
        if identifier == _HIGHRES and int(values[14]) & _UPDATED != _UPDATED:
            self.left_out["HIGHRES_IMU without new rates and forces"] += 1
            return None
        t = self._time(identifier, values[0] * (1e3 if identifier == _SCALED else 1.0))
        if t is None:
            return None
        if identifier == _HIGHRES:
            return t, *values[1:7], values[13]
        force, rate = (x * _MILLI_G for x in values[1:4]), (x * _MILLI_RAD for x in values[4:7])
        temperature = values[10] if identifier == _SCALED else values[11]
        return t, *force, *rate, 0.01 * temperature if temperature else np.nan  # zero is not given

    def _fix(self, values: tuple[float, ...]) -> list[Fix]:
        """Fix of a GPS_RAW_INT, if it is a new one."""
        if not wanted(self._hints, "gnss"):
            return []
        stamp, lat, lon, msl, _, _, speed, course, kind, n, ellipsoidal, sh, sv, ss, _, _ = values
        if int(kind) not in QUALITY:
            self.left_out["epochs without a fix"] += 1
            return []
        t = self._time(_GPS, stamp)
        if t is None:
            return []
        columns = {
            "t": t, "lat": lat * 1e-7 * units.DEG, "lon": lon * 1e-7 * units.DEG,
            "h": 1e-3 * (ellipsoidal or msl), "q": QUALITY[int(kind)], "ns": n if n != 255 else 0,
        }  # fmt: skip
        if sh > 0 and sv > 0:
            columns |= {"sn": 1e-3 * sh, "se": 1e-3 * sh, "sd": 1e-3 * sv}
        table = {name: np.array([float(x)]) for name, x in columns.items()}
        if speed != _UNSET and ss > 0:
            angle = np.array([np.nan if course == _UNSET else 0.01 * course * units.DEG])
            table |= over_ground.velocities(
                table["t"], (table["lat"], table["lon"]), np.array([0.01 * speed]), angle,
                (np.array([1e-3 * ss]), None), [],
            )  # fmt: skip
        return fix_of(Table(table, ellipsoidal=bool(ellipsoidal)), self._hints, self.left_out)

    def _time(self, identifier: int, microseconds: float) -> float | None:
        """Time on the axis of the run; None if it is none, or that of the message before."""
        try:
            if microseconds > _UNIX_US and self._hints.time != "local":
                whole, rest = divmod(int(microseconds), 1_000_000)
                t = self._clock.seconds(float(gps_from_unix(np.array([float(whole)]))[0]), rest / 1e6)
            else:
                t = self._clock.local(microseconds / 1e6)
        except InputError as error:
            self.left_out[f"messages: {error}"] += 1
            return None
        if t == self._last.get(identifier):
            self.left_out["messages repeated"] += 1
            return None
        self._last[identifier] = t
        return t


def looks_like(data: bytes) -> bool:
    """Whether bytes hold a message with a checksum that is right, of those that are read."""
    at = 0
    while at < len(data):
        stop = _stop_of(data, at)
        if stop is not None and stop > at and _payload(data[at:stop]) not in (None, _OTHER):
            return True
        at += 1
    return False


def _stop_of(data: bytes, at: int) -> int | None:
    """End of the frame that begins at a byte; the byte itself if none can, None if more bytes would say."""
    header = _STARTS.get(data[at])
    if header is None:
        return at
    if len(data) < at + header:
        return None
    stop = at + header + data[at + 1] + 2
    if header == _STARTS[0xFD]:
        if data[at + 2] & ~_SIGNED:  # flags that nobody knows
            return at
        stop += _SIGNATURE if data[at + 2] & _SIGNED else 0
    return stop if stop <= len(data) else None


def _payload(frame: bytes) -> tuple[int, tuple[float, ...]] | None:
    """Identifier and fields of a frame; None if its checksum is wrong.

    The checksum of a message that is not read begins with a seed of its own: such a frame is believed where another one
    follows it.
    """
    header = _STARTS[frame[0]]
    stop = header + frame[1]
    identifier = frame[5] if header == _STARTS[0xFE] else int.from_bytes(frame[7:10], "little")
    if identifier not in _MESSAGES:
        return _OTHER
    seed, layout = _MESSAGES[identifier]
    if crc(frame[1:stop] + bytes([seed])) != int.from_bytes(frame[stop : stop + 2], "little"):
        return None
    return identifier, layout.unpack(frame[header:stop][: layout.size].ljust(layout.size, b"\0"))
