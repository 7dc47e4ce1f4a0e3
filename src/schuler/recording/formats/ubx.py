"""Logs of u-blox receivers (``.ubx``): raw measurements, broadcast ephemerides and the receiver's own solutions.

Four messages matter: RXM-RAWX, RXM-SFRBX, NAV-PVT and, for its dilutions, NAV-DOP. pyubx2 decodes them at about fifty
times real time for a log of 4 Hz and 72 measurements an epoch (docs/gnss-receivers.md), which is fast enough to have no
decoder of our own.

pyubx2 reads frames too, but believes a length once it has seen the two bytes that start one: a single wrong byte there
swallows up to 65 kB of good frames, and what was lost is not counted. So the frames are found here and it decodes them.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from schuler.arrays import FloatArray
from schuler.exceptions import FileFormatError, MissingExtraError
from schuler.gnss.ephemerides import Ephemerides, no_glonass, no_kepler
from schuler.gnss.observations import Observations
from schuler.plotting.notebook import Abridged
from schuler.recording.formats import ubx_messages
from schuler.recording.io.assemble import metadata_of
from schuler.recording.io.hints import ReadHints
from schuler.recording.io.lines import check_file
from schuler.recording.recording import Recording
from schuler.recording.series import GnssSeries
from schuler.timebase import WEEK_S, TimeBase

RAWX, SFRBX, PVT, DOP = 0x0215, 0x0213, 0x0107, 0x0104
_SENSORS = (0x1002, 0x1003)  # ESF-MEAS, ESF-RAW
_USED = {"name", "series"}
SYNC = b"\xb5\x62"
_OVERHEAD = 8  # two bytes of start, class, identifier, two of length, two of checksum
_LATEST = 1 << 24  # bytes in which a log has its first frame, or it is none
_NMEA = re.compile(rb"[$!][ -~]{5,250}\r\n")


@dataclass(frozen=True, repr=False)
class UbxLog(Abridged):
    """Contents of a u-blox log on one time axis.

    Attributes
    ----------
    observations : Observations, optional
        ``None`` if the log has no RXM-RAWX.
    ephemerides : Ephemerides
        Empty if the log has no RXM-SFRBX.
    gnss : GnssSeries, optional
        Solutions of NAV-PVT, with dilutions of NAV-DOP; ``None`` if the log has none with a fix.
    time : TimeBase
        GPS time from the start of the first epoch's week.
    sigma_range, sigma_rate : ndarray, shape (n,)
        The receiver's own 1-sigma of each row of ``observations``. [m], [m/s]
    leap_seconds : int, optional
        GPS - UTC as the receiver (or the satellites) said. [s]
    notes : tuple of str
        On everything that was left out or assumed.
    """

    observations: Observations | None
    ephemerides: Ephemerides
    gnss: GnssSeries | None
    time: TimeBase
    sigma_range: FloatArray
    sigma_rate: FloatArray
    leap_seconds: int | None
    notes: tuple[str, ...]


def looks_like_ubx(head: bytes) -> bool:
    """Whether the first bytes of a file hold a frame of u-blox, whatever its suffix; NMEA may come before."""
    return bool(find_frames(head).spans)


def read_ubx(path: Path | str) -> UbxLog:
    """Read a u-blox log.

    Parameters
    ----------
    path : Path or str
        As logged: UBX frames, perhaps with NMEA sentences between them.

    Raises
    ------
    FileFormatError
        If the file holds none of RXM-RAWX, RXM-SFRBX and NAV-PVT, or no time.
    MissingExtraError
        If pyubx2 is not installed.

    Notes
    -----
    RXM-SFRBX has no time of its own; a message is given that of the last RXM-RAWX or NAV-PVT before it, which only has
    to be right to some days.
    """
    path = Path(path)
    if not looks_like_ubx(check_file(path)):
        with path.open("rb") as stream:  # the rest of a large file of something else would take its size several times
            start_of_it = find_frames(stream.read(_LATEST))
        if not start_of_it.spans and start_of_it.strange > _LATEST // 2:
            raise FileFormatError(
                f"expected u-blox messages, found none in the first {_LATEST >> 20} MiB: another file, or damaged",
                path,
            )
    frames = find_frames(path.read_bytes())
    decode, notes = decoder(), frames.notes()
    by_kind: dict[int, list[tuple[int, dict[str, Any]]]] = {RAWX: [], SFRBX: [], PVT: [], DOP: []}
    unreadable = 0
    for order, (kind, first, stop) in enumerate(frames.spans):
        if kind not in by_kind:
            continue
        try:
            if not is_whole(kind, frames.data[first + 6 : stop - 2]):
                raise ValueError("shorter than its contents")
            by_kind[kind].append((order, decode(frames.data[first:stop])))
        # a payload of another length than its counter says; pyubx2 does not list its errors
        except Exception:
            unreadable += 1
    if sensors := sum(kind in _SENSORS for kind, _, _ in frames.spans):
        notes.append(
            f"{sensors} frames ESF-MEAS and ESF-RAW were not read: u-blox does not say the unit of their time tags, "
            "so the samples of its IMU cannot be timed; log another IMU."
        )
    if unreadable:
        notes.append(f"{unreadable} frames were not of the length their contents call for and were left out.")
    dop = {m["iTOW"]: (m["hDOP"], m["vDOP"]) for _, m in by_kind.pop(DOP)}
    if not any(by_kind.values()):
        raise FileFormatError(
            f"expected u-blox messages RXM-RAWX, RXM-SFRBX or NAV-PVT, found {len(frames.spans)} frames of other kinds "
            f"and {frames.sentences} NMEA sentences: enable these messages, or read it as NMEA",
            path,
        )
    raw = ubx_messages.raw_epochs(m for _, m in by_kind[RAWX])
    start = None if raw is None else raw.observations.epoch_gps_s
    gnss, pvt_start, more = ubx_messages.solutions((m for _, m in by_kind[PVT]), start, dop)
    start = pvt_start if start is None else start
    notes += list(raw.observations.notes if raw is not None else ()) + more
    ephemerides = _ephemerides(by_kind)
    notes += ephemerides.notes
    if not np.isfinite(start):
        raise FileFormatError(
            "no message of the log says the time (RXM-RAWX or NAV-PVT with a fix): the log is of a receiver that had "
            "none yet, or these messages were not enabled",
            path,
        )
    leap = raw.leap_seconds if raw is not None and raw.leap_seconds is not None else ephemerides.leap_seconds
    empty = np.empty(0)
    return UbxLog(
        None if raw is None else raw.observations,
        ephemerides,
        gnss,
        TimeBase("gps", float(start)),
        empty if raw is None else raw.sigma_range,
        empty if raw is None else raw.sigma_rate,
        leap,
        tuple(notes),
    )


def is_whole(kind: int, payload: bytes) -> bool:
    """Whether a payload is as long as its counter says (UBX-22008968, 3.15.5, 3.15.14, 3.17.5, 3.17.9); no poll is."""
    if kind == RAWX:
        return len(payload) >= 16 + 32 * (payload[11] if len(payload) > 11 else 0)
    if kind == SFRBX:
        return len(payload) >= 8 + 4 * (payload[4] if len(payload) > 4 else 0)
    return len(payload) >= (18 if kind == DOP else 84)  # 92 since protocol 15


def read_ubx_recording(path: Path, hints: ReadHints) -> Recording:
    """A u-blox log as a recording: the receiver's own solutions, its raw measurements, and what was broadcast.

    Parameters
    ----------
    path : Path
    hints : ReadHints
        ``name`` only: the log says everything else itself. An ``offset`` would give the measurements a wrong time of
        reception; shift the log of the IMU instead.

    Raises
    ------
    FileFormatError
        As :func:`read_ubx`, or if the log holds subframes only.
    InputError
        If hints are given that the log answers itself.
    """
    hints.check_used(path, _USED, "a u-blox log")
    log = read_ubx(path)
    if log.gnss is None and log.observations is None:
        raise FileFormatError("the log holds neither NAV-PVT with a fix nor RXM-RAWX with measurements", path)
    broadcast = log.ephemerides if len(log.ephemerides.kepler) + len(log.ephemerides.glonass) else None
    return Recording(
        gnss=log.gnss,
        observations=log.observations,
        ephemerides=broadcast,
        metadata=metadata_of(path, hints, log.time, log.notes),
    )


def _ephemerides(by_kind: dict[int, list[tuple[int, dict[str, Any]]]]) -> Ephemerides:
    """Ephemerides of the subframes, each with the time of the solution or measurement before it."""
    timed: list[tuple[int, float]] = [
        (order, m["week"] * WEEK_S + m["rcvTow"]) for order, m in by_kind[RAWX] if m["week"] > 0
    ]
    times = ubx_messages.solution_times([m for _, m in by_kind[PVT]]).sum(axis=1)
    timed += [(order, t) for (order, _), t in zip(by_kind[PVT], times.tolist(), strict=True) if np.isfinite(t)]
    timed.sort()
    if not timed or not by_kind[SFRBX]:
        note = (f"{len(by_kind[SFRBX])} navigation messages come without any time.",) if by_kind[SFRBX] else ()
        return Ephemerides(no_kepler(), no_glonass(), notes=note)
    orders = np.array([order for order, _ in timed])
    places = np.searchsorted(orders, [order for order, _ in by_kind[SFRBX]]) - 1
    near = [timed[max(int(k), 0)][1] for k in places]
    return ubx_messages.broadcast(zip((m for _, m in by_kind[SFRBX]), near, strict=True))


@dataclass(frozen=True)
class Frames:
    """Frames of a log by their bytes, and counts of everything else.

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
        sentences_of = _NMEA.findall(piece)
        sentences += len(sentences_of)
        strange += len(piece) - sum(map(len, sentences_of))
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
