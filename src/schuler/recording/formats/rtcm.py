"""RTCM 3 streams of base stations: multi-signal messages (MSM4 to MSM7), the station's place, broadcast ephemerides.

Frames are found here, by their checksums; pyrtcm cuts the fields out of them. The fields themselves: RTCM 10403.3.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from schuler.arrays import FloatArray, IntArray
from schuler.exceptions import FileFormatError, MissingExtraError
from schuler.gnss.ephemerides import Ephemerides, no_glonass
from schuler.gnss.message_fields import SEMICIRCLE, accuracy_of_index, kepler_records, nearest
from schuler.gnss.messages_galileo import sisa
from schuler.gnss.observations import Observations
from schuler.gnss.signals import BANDS, SPEED_OF_LIGHT, SYSTEMS
from schuler.recording.io.assemble import metadata_of
from schuler.recording.io.hint_texts import parse_time
from schuler.recording.io.hints import ReadHints
from schuler.recording.io.lines import check_file
from schuler.recording.recording import Recording
from schuler.timebase import WEEK_S, TimeBase

_SYNC = 0xD3
_SUFFIXES, _HEAD = (".rtcm", ".rtcm3"), 65_536
_LATEST = 1 << 20  # bytes in which a stream has its first frame, or it is none
_OVERHEAD = 6  # preamble, length, three bytes of checksum
_POLYNOMIAL = 0x1864CFB
_USED = {"name", "series", "time"}
_MS = 1e-3 * SPEED_OF_LIGHT  # [m]
#: Messages of a system, less their last digit: letter, field of the epoch, how far its time of week is behind GPS [s].
_SYSTEMS = {"107": ("G", "DF004", 0.0), "109": ("E", "DF248", 0.0), "112": ("C", "DF427", 14.0)}
_SYSTEMS |= {"111": ("J", "DF428", 0.0)}
_ANTENNA = ("1005", "1006")
_TYPES = ("1007", "1008", "1033")  # of antennas
_NO_FINE = {"DF400": -(2.0**-10), "DF401": -(2.0**-8), "DF405": -(2.0**-10), "DF406": -(2.0**-8), "DF404": -1.6384}
_GPS_ERA = 2048  # of ten bits of the week, until November 2038
_GALILEO_FIRST, _BEIDOU_FIRST = 1024, 1356  # weeks at which their counts began
_HALF_CYCLE, _LOST = 2, 1

_ANGLES = ("i0", "omega0", "omega", "m0", "delta_n", "idot", "omega_dot")
_GPS = {
    "idot": "DF079", "af2": "DF082", "af1": "DF083", "af0": "DF084", "crs": "DF086", "delta_n": "DF087", "m0": "DF088",
    "cuc": "DF089", "e": "DF090", "cus": "DF091", "sqrt_a": "DF092", "cic": "DF094", "omega0": "DF095", "cis": "DF096",
    "i0": "DF097", "crc": "DF098", "omega": "DF099", "omega_dot": "DF100", "toe": "DF093", "toc": "DF081",
    "issue": "DF071", "health": "DF102",
}  # fmt: skip
_GALILEO = {
    "idot": "DF292", "af2": "DF294", "af1": "DF295", "af0": "DF296", "crs": "DF297", "delta_n": "DF298", "m0": "DF299",
    "cuc": "DF300", "e": "DF301", "cus": "DF302", "sqrt_a": "DF303", "cic": "DF305", "omega0": "DF306", "cis": "DF307",
    "i0": "DF308", "crc": "DF309", "omega": "DF310", "omega_dot": "DF311", "toe": "DF304", "toc": "DF293",
    "issue": "DF290",
}  # fmt: skip
_BEIDOU = {
    "idot": "DF491", "af2": "DF494", "af1": "DF495", "af0": "DF496", "crs": "DF498", "delta_n": "DF499", "m0": "DF500",
    "cuc": "DF501", "e": "DF502", "cus": "DF503", "sqrt_a": "DF504", "cic": "DF506", "omega0": "DF507", "cis": "DF508",
    "i0": "DF509", "crc": "DF510", "omega": "DF511", "omega_dot": "DF512", "toe": "DF505", "toc": "DF493",
    "issue": "DF492", "health": "DF515",
}  # fmt: skip


def _crc_table() -> tuple[int, ...]:
    table = []
    for byte in range(256):
        value = byte << 16
        for _ in range(8):
            value = value << 1 ^ (_POLYNOMIAL if value & 0x800000 else 0)
        table.append(value & 0xFFFFFF)
    return tuple(table)


_TABLE = _crc_table()


@dataclass(frozen=True)
class RtcmFrames:
    """Payloads of a stream in order, and counts of everything else.

    Attributes
    ----------
    payloads : list of bytes
    failed : int
        Starts of frames with a wrong checksum.
    truncated : bool
        The stream ends within a frame.
    strange : int
        Bytes that belong to no frame.
    """

    payloads: list[bytes]
    failed: int
    truncated: bool
    strange: int


@dataclass(frozen=True)
class RtcmLog:
    """Contents of a base station's stream.

    Attributes
    ----------
    observations : Observations
        With the station's place as ``station_e``, its antenna and the height of that above the mark, if they were sent.
    ephemerides : Ephemerides
        Empty if none were sent.
    time : TimeBase
        GPS time from the start of the first epoch's week.
    notes : tuple of str
        On everything that was left out or assumed.
    """

    observations: Observations
    ephemerides: Ephemerides
    time: TimeBase
    notes: tuple[str, ...]


def looks_like_rtcm(head: bytes) -> bool:
    """Whether two whole frames of RTCM 3 with right checksums are among the first bytes."""
    return len(find_frames(head).payloads) >= 2


def is_rtcm(path: Path) -> bool:
    """Whether a file is such a stream, by its suffix or its first bytes."""
    if not path.is_file():
        return False
    with path.open("rb") as file:
        return path.suffix.lower() in _SUFFIXES or looks_like_rtcm(file.read(_HEAD))


def find_frames(data: bytes) -> RtcmFrames:
    """Find the frames of an RTCM 3 stream; a frame is lost only if it is damaged itself.

    References
    ----------
    RTCM 10403.3, section 4: preamble, six zeros, ten bits of length, CRC-24Q.
    """
    payloads, failed, strange, done, cut = [], 0, 0, 0, -1
    at = data.find(_SYNC)
    while at >= 0:
        if at + 3 > len(data):
            cut = at if cut < done else cut
            break
        length = (data[at + 1] & 0x03) << 8 | data[at + 2]
        stop = at + length + _OVERHEAD
        if data[at + 1] & 0xFC or length < 2:
            at = data.find(_SYNC, at + 1)
        elif stop > len(data):
            cut = at if cut < done else cut
            at = data.find(_SYNC, at + 1)
        elif crc24q(data[at:stop]):
            failed += 1
            at = data.find(_SYNC, at + 1)
        else:
            payloads.append(data[at + 3 : stop - 3])
            strange += at - done
            done = stop
            at = data.find(_SYNC, stop)
    truncated = cut >= done
    return RtcmFrames(payloads, failed, truncated, strange + (cut if truncated else len(data)) - done)


def crc24q(frame: bytes) -> int:
    """Remainder of CRC-24Q, 0 of a frame with its checksum."""
    value = 0
    for byte in frame:
        value = (value << 8 & 0xFFFFFF) ^ _TABLE[value >> 16 ^ byte]
    return value


def read_rtcm(path: Path | str, near_gps_s: float | None = None) -> RtcmLog:
    """Read the stream of a base station.

    Parameters
    ----------
    path : Path or str
        As it came: RTCM 3 frames, other bytes between them.
    near_gps_s : float, optional
        GPS time within half a week of the log, which says the time of week only. Ephemerides, which say the week, are
        believed first; GPS's count it to 1024, from 2019 on without this time. [s]

    Raises
    ------
    FileFormatError
        If there are no observations, or neither ``near_gps_s`` nor an ephemeris says the week.
    MissingExtraError
        If pyrtcm is not installed.

    Notes
    -----
    GPS, Galileo, BeiDou and QZSS. GLONASS, whose carriers a difference between receivers does not free of their
    frequencies, and other messages are counted. An arc of a carrier ends where its lock time is shorter than the time
    since the epoch before.
    """
    path = Path(path)
    check_file(path)
    with path.open("rb") as stream:
        data = stream.read(_LATEST)
        frames = find_frames(data)
        if frames.payloads and len(data) == _LATEST:
            frames = find_frames(data + stream.read())
    messages, notes = _decoded(frames)
    kinds = Counter(m.identity for m in messages)
    if not any(_is_observed(kind) for kind in kinds):
        raise FileFormatError(
            "expected RTCM 3 observations (1074 to 1077, 1094 to 1097, 1124 to 1127), found "
            + (
                ", ".join(f"{n} of {kind}" for kind, n in sorted(kinds.items()))
                + ": enable MSM4 or MSM7 in the base station"
                if kinds
                else f"only damaged frames ({frames.failed}): record the stream as bytes, without a text mode or an "
                "editor in between"
            ),
            path,
        )
    broadcast, week = _ephemerides(messages, near_gps_s)
    if week is None:
        raise FileFormatError(
            "RTCM 3 says the time of week only, and no ephemeris (1019, 1042, 1045, 1046) says the week: give "
            "time='gps-tow:WEEK' with the full week number, for example gps-tow:2374",
            path,
        )
    unread = {k: n for k, n in kinds.items() if not _is_observed(k) and k not in (*_ANTENNA, *_ROWS)}
    if unread:
        notes.append("messages not read: " + ", ".join(f"{n} of {kind}" for kind, n in sorted(unread.items())) + ".")
    observed = [m for m in messages if _is_observed(m.identity)]
    observations = replace(
        _observations(observed, week, _station(messages)), antenna=_antenna(messages), eccentricity_n=_height(messages)
    )
    return RtcmLog(observations, broadcast, TimeBase("gps", observations.epoch_gps_s), tuple(notes))


def read_rtcm_recording(path: Path, hints: ReadHints) -> Recording:
    """A base station's stream as a recording: observations, and ephemerides if they were sent.

    Parameters
    ----------
    path : Path
    hints : ReadHints
        ``name``, and ``time="gps-tow:WEEK"`` where no ephemeris says the week.

    Raises
    ------
    FileFormatError, InputError
        As :func:`read_rtcm`; for hints that the stream answers itself.
    """
    hints.check_used(path, _USED, "an RTCM 3 stream")
    spec = parse_time(hints.time)
    log = read_rtcm(path, (spec.week + 0.5) * WEEK_S if spec.kind == "gps-tow" else None)
    return Recording(
        observations=log.observations,
        ephemerides=log.ephemerides if len(log.ephemerides.kepler) else None,
        metadata=metadata_of(path, hints, log.time, log.notes),
    )


def _decoded(frames: RtcmFrames) -> tuple[list[Any], list[str]]:
    """Messages of frames by pyrtcm, and sentences on what is damaged."""
    try:
        from pyrtcm import RTCMMessage
    except ImportError as error:
        raise MissingExtraError("pyrtcm", "gnss", "reading RTCM 3") from error
    messages, notes, unreadable = [], [], 0
    for payload in frames.payloads:
        try:
            messages.append(RTCMMessage(payload=payload))
        except Exception:  # a payload shorter than its masks call for; pyrtcm does not list its errors
            unreadable += 1
    for count, text in (
        (frames.failed, "frames with a wrong checksum were left out."),
        (unreadable, "frames were not of the length their contents call for and were left out."),
        (frames.strange, "bytes belong to no frame."),
    ):
        if count:
            notes.append(f"{count} {text}")
    if frames.truncated:
        notes.append("The last frame was cut off and left out.")
    return messages, notes


def _is_observed(kind: str) -> bool:
    return kind[:3] in _SYSTEMS and kind[3:] in ("4", "5", "6", "7")


def _station(messages: list[Any]) -> tuple[float, float, float] | None:
    """Antenna reference point of the last 1005 or 1006. [m]"""
    places = [(m.DF025, m.DF026, m.DF027) for m in messages if m.identity in _ANTENNA]
    return places[-1] if places and any(places[-1]) else None


def _height(messages: list[Any]) -> tuple[float, float, float] | None:
    """Antenna reference point from the mark by the last 1006: north, east, down. [m]"""
    heights = [round(float(m.DF028), 4) for m in messages if m.identity == "1006"]
    return (0.0, 0.0, -heights[-1]) if heights else None


def _antenna(messages: list[Any]) -> str:
    """Type and radome of the antenna by the last message that states it."""
    stated = [m for m in messages if m.identity in _TYPES and m.DF029]
    if not stated:
        return ""
    return " ".join("".join(getattr(stated[-1], f"DF030_{k + 1:02d}") for k in range(stated[-1].DF029)).split())


def _observations(messages: list[Any], near_gps_s: float, station_e: tuple[float, float, float] | None) -> Observations:
    rows: dict[str, list[float]] = {
        name: [] for name in ("t", "sat", "signal", "range", "rate", "phase", "cn0", "lock_s", "half")
    }
    names: dict[str, int] = {}
    near = near_gps_s
    for m in messages:
        letter, epoch, behind = _SYSTEMS[m.identity[:3]]
        near = nearest(getattr(m, epoch) * 1e-3 + behind, near)
        _append(rows, names, m, letter, near)
    t = np.array(rows["t"])
    order = np.argsort(t, kind="stable")
    start = float(t[order[0]] // WEEK_S * WEEK_S) if len(t) else 0.0
    sat, signal = (np.array(rows[name], dtype=np.int64)[order] for name in ("sat", "signal"))
    cycles = np.array(rows["phase"])[order]
    lock = np.where(np.array(rows["half"])[order] > 0.0, _HALF_CYCLE, 0)
    lock |= _LOST * _lost(t[order], sat, signal, np.array(rows["lock_s"])[order])
    return Observations(
        t[order] - start, sat, signal, tuple(names), np.array(rows["range"])[order], np.array(rows["rate"])[order],
        cycles, np.array(rows["cn0"])[order], start, position_e=station_e, lock=np.where(np.isnan(cycles), 0, lock),
        station_e=station_e,
    )  # fmt: skip


def _append(rows: dict[str, list[float]], names: dict[str, int], m: Any, letter: str, t: float) -> None:
    """Put the cells of a multi-signal message into rows (RTCM 10403.3, section 3.5.16)."""
    fine = m.identity[3:] in "67"
    code, phase, lock, cn0 = ("DF405", "DF406", "DF407", "DF408") if fine else ("DF400", "DF401", "DF402", "DF403")
    rough, rates = {}, {}
    for i in range(1, m.NSat + 1):
        prn, whole = getattr(m, f"PRN_{i:02d}"), getattr(m, f"DF397_{i:02d}")
        rough[prn] = np.nan if whole == 255 else whole + getattr(m, f"DF398_{i:02d}")
        rate = getattr(m, f"DF399_{i:02d}", -8192)
        rates[prn] = np.nan if rate == -8192 else float(rate)
    for i in range(1, m.NCell + 1):
        prn, name = getattr(m, f"CELLPRN_{i:02d}"), getattr(m, f"CELLSIG_{i:02d}")
        if not str(prn).isdecimal() or (letter, name[:1]) not in BANDS:
            continue

        def value(field: str, i: int = i) -> float:
            number = getattr(m, f"{field}_{i:02d}", np.nan)
            return np.nan if number == _NO_FINE.get(field) else float(number)

        number = int(prn) - (192 if letter == "J" else 0)
        wavelength = SPEED_OF_LIGHT / BANDS[(letter, name[:1])]
        indicator = int(getattr(m, f"{lock}_{i:02d}"))
        strength = value(cn0)
        for key, x in (
            ("t", t), ("sat", 100 * SYSTEMS.index(letter) + number), ("signal", names.setdefault(name, len(names))),
            ("range", (rough[prn] + value(code)) * _MS), ("rate", rates[prn] + value("DF404")),
            ("phase", (rough[prn] + value(phase)) * _MS / wavelength), ("cn0", strength if strength > 0.0 else np.nan),
            ("lock_s", _longest_lock(indicator + 1, extended=fine)), ("half", float(getattr(m, f"DF420_{i:02d}"))),
        ):  # fmt: skip
            rows[key].append(x)


def _longest_lock(i: int, *, extended: bool) -> float:
    """Shortest lock time of an indicator (DF402, DF407), which is the longest of the one before it. [s]"""
    if not extended:
        return 0.016 * 2.0**i if i < 16 else np.inf
    if i < 64:
        return 1e-3 * i
    if i > 704:
        return np.inf
    k = (i - 64) // 32
    return 1e-3 * (64.0 * 2.0**k + 2.0 ** (k + 1) * (i - 64 - 32 * k))


def _lost(t: FloatArray, sat: IntArray, signal: IntArray, lock_s: FloatArray) -> IntArray:
    """1 where a carrier cannot have been followed since its row before, 0 elsewhere. Shape (n,)."""
    lost = np.zeros(len(t), dtype=np.int64)
    order = np.lexsort((t, signal, sat))
    same = (np.diff(sat[order]) == 0) & (np.diff(signal[order]) == 0)
    late, early = lock_s[order[1:]], lock_s[order[:-1]]
    lost[order[1:]] = same & ((late < early) | (late < np.diff(t[order])))
    return lost


def _ephemerides(messages: list[Any], near_gps_s: float | None) -> tuple[Ephemerides, float | None]:
    """Ephemerides of the messages, each once, and a GPS time within half a week of the log, if anything says it. [s]"""
    rows: dict[tuple[int, float, float, int], dict[str, Any]] = {}
    week = near_gps_s
    for m in messages:
        if m.identity in _ROWS:
            row = _ROWS[m.identity](m)
            if m.identity == "1019" and near_gps_s is not None:
                eras = round((near_gps_s - row["toe"]) / (1024 * WEEK_S)) * 1024 * WEEK_S
                row |= {"toe": row["toe"] + eras, "toc": row["toc"] + eras}
            week = row["toe"]
            key = (row["sat"], row["toe"], row["toc"], row["source"])
            rows.setdefault(key, row)
    return Ephemerides(kepler_records(list(rows.values())), no_glonass()), week


def _row(m: Any, fields: Mapping[str, str], sat: int, start: float, **more: Any) -> dict[str, Any]:
    """Fields of a message in SI, times from the start of its week."""
    row: dict[str, Any] = {name: getattr(m, field) for name, field in fields.items()}
    row |= {name: row[name] * SEMICIRCLE for name in _ANGLES}
    toe = start + row["toe"]
    return row | {"sat": sat, "toe": toe, "toc": nearest(row["toc"] + start % WEEK_S, toe), "sent": np.nan} | more


def _gps(m: Any) -> dict[str, Any]:
    return _row(
        m, _GPS, m.DF009, (_GPS_ERA + m.DF076) * WEEK_S, group_delay=(m.DF101, np.nan),
        accuracy=accuracy_of_index(m.DF077), source=0,
    )  # fmt: skip


def _beidou(m: Any) -> dict[str, Any]:
    """D1 (1042); pyrtcm has group delays in nanoseconds."""
    return _row(
        m, _BEIDOU, 100 * SYSTEMS.index("C") + m.DF488, (_BEIDOU_FIRST + m.DF489) * WEEK_S + 14.0,
        group_delay=(m.DF513 * 1e-9, m.DF514 * 1e-9), accuracy=accuracy_of_index(m.DF490), source=0,
    )  # fmt: skip


def _galileo(m: Any) -> dict[str, Any]:
    """I/NAV (1046) or F/NAV (1045); health and data source as in RINEX."""
    inav = m.identity == "1046"
    health = (m.DF288 | m.DF287 << 1 | m.DF317 << 6 | m.DF316 << 7) if inav else (m.DF315 << 3 | m.DF314 << 4)
    return _row(
        m, _GALILEO, 100 * SYSTEMS.index("E") + m.DF252, (_GALILEO_FIRST + m.DF289) * WEEK_S, health=health,
        group_delay=(m.DF312, m.DF313 if inav else np.nan), accuracy=sisa(m.DF286 if inav else m.DF291),
        source=0b1000000101 if inav else 0b0100000010,
    )  # fmt: skip


_ROWS = {"1019": _gps, "1042": _beidou, "1045": _galileo, "1046": _galileo}
