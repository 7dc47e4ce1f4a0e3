"""Xsens logs: binary ``.mtb`` (MTData2) and the text that MT Manager exports.

Messages in ``xsens_messages``. The exported text has lines of a header, then columns named in one line, by tabs or
commas. The sensor's axes are forward-left-up as printed on its case, and it measures specific force.
"""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from schuler import rotation, units
from schuler.arrays import FloatArray
from schuler.exceptions import FileFormatError, InputError
from schuler.recording.formats import ubx_messages
from schuler.recording.formats.xsens_messages import TICK, Packets, fixes_of, gnss_table, load, looks_like, utc_line
from schuler.recording.io import lines, parts
from schuler.recording.io.checks import unit_quaternions
from schuler.recording.io.hint_texts import axes_matrix, parse_streams
from schuler.recording.io.hints import ReadHints
from schuler.recording.io.lines import TextTable
from schuler.recording.io.parts import Table
from schuler.recording.io.receiver_tables import unwrapped
from schuler.recording.io.streams import Stream, stream_of
from schuler.recording.recording import Recording
from schuler.timebase import WEEK_S, TimeBase

HINTS = {"axes", "streams", "time", "rate"}
#: IMU outputs of a sensor: items of the specific force and of the angular rate.
IMUS = {"delta": ("dv", "dq"), "rates": ("a", "g"), "hr": ("hra", "hrg")}
_SOLUTION = ("q", "latlon", "h", "v")
# from the axes of a solution to north, east, down
_TO_NED = {
    "ENU": np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]]),
    "NED": np.eye(3),
    "NWU": np.diag([1.0, -1.0, -1.0]),
}
_NAMES = re.compile(rb"^(?:\xef\xbb\xbf)?PacketCounter[\t,;].*\bAcc_X\b", re.MULTILINE)
_RATE = re.compile(r"//\s*(?:Update|Sample)\s*rate\s*:\s*([0-9]+(?:\.[0-9]*)?)\s*Hz", re.IGNORECASE)
_ACCEL, _GYRO = ("Acc_X", "Acc_Y", "Acc_Z"), ("Gyr_X", "Gyr_Y", "Gyr_Z")
_PLACE = ("Latitude", "Longitude", "Altitude")  # [deg], [deg], above the ellipsoid [m]
_TICK, _TICK_DOT = 1e-4, 1e-6  # of SampleTimeFine; of a Movella DOT [s]
_SLOWEST = 2000.0  # ticks: no MT Manager logs at less than 5 Hz, no DOT at more than 500


def sniff(head: bytes, path: Path) -> bool:
    """Whether there are messages of an Xsens sensor, or the header of MT Manager's text."""
    return is_text_export(head) or looks_like(head)


def contents(path: Path) -> list[Stream]:
    """IMU outputs, GNSS and solutions of a binary log."""
    with path.open("rb") as stream:
        if is_text_export(stream.read(65536)):
            return []
    packets = load(path, [])
    made = []
    for name, items in (*IMUS.items(), ("solution", _SOLUTION)):
        rows = joined(packets, items)
        if rows is not None:
            part = "reference" if name == "solution" else "imu"
            made.append(stream_of(name, ", ".join(items), rows.get("t", np.empty(0)), part))
            made[-1] = Stream(name, made[-1].kind, len(rows["place"]), made[-1].start, made[-1].stop, part)
    if fixes := fixes_of(packets):
        made.append(Stream("GnssPvtData", "gnss", len(fixes), part="gnss"))
    return made


@np.errstate(invalid="ignore", over="ignore")  # what is no number is refused by the checks of parts.assemble
def read(path: Path, hints: ReadHints) -> Recording:
    """Recording of an Xsens log.

    Parameters
    ----------
    path : Path
    hints : ReadHints
        ``streams="imu=.."`` with ``delta`` (DeltaV and DeltaQ, default where they are logged), ``rates``
        (Acceleration and RateOfTurn) or ``hr``; ``gnss=none`` and ``reference=none`` leave these out. ``axes``, default
        "FLU" as printed on the case. ``time="local"`` keeps the sensor's clock. ``rate`` where packets have a counter
        and no time.

    Returns
    -------
    Recording
        On GPS time where UTC is logged and resolved, else on the sensor's own clock.

    Raises
    ------
    FileFormatError, InputError
        If the log is damaged, or holds no IMU, or no time and no ``rate`` is given.
    """
    parts.check_hints(path, hints, HINTS, "an Xsens log")
    if hints.time not in (None, "gps", "local"):
        raise InputError(f"time: an Xsens log has time='gps' (by its UTC) or 'local', got {hints.time!r}")
    with path.open("rb") as stream:
        if is_text_export(stream.read(65536)):
            return read_text_export(path, hints)
    notes: list[str] = []
    packets, chosen = load(path, notes), parse_streams(hints.streams)
    requested = chosen.get("imu", "")
    if requested and requested not in IMUS:
        raise InputError(f"streams: imu of an Xsens log is one of {', '.join(IMUS)} or none, got {requested!r}")
    columns_of: dict[str, dict[str, FloatArray]] = {}
    kind = ""
    if not ("imu" in chosen and requested is None) and hints.series in (None, "imu"):
        for kind in (requested,) if requested else IMUS:
            rows = joined(packets, IMUS[kind])
            if rows is not None:
                columns_of["imu"] = rows
                break
        else:
            if requested:
                raise InputError(f"streams: the log has no IMU output {requested!r}")
    solution = joined(packets, _SOLUTION) if hints.series in (None, "reference") else None
    if solution is not None and not ("reference" in chosen and chosen["reference"] is None):
        columns_of["reference"] = solution
    fixes = fixes_of(packets) if hints.series in (None, "gnss") and chosen.get("gnss", "") is not None else []
    if not columns_of and not fixes:
        raise FileFormatError("the log holds no IMU outputs (DeltaV with DeltaQ, Acceleration with RateOfTurn)", path)
    gnss, start, fix_notes = ubx_messages.solutions(fixes)
    notes += [note.replace("NAV-PVT", "GnssPvtData") for note in fix_notes]
    line = None if hints.time == "local" else utc_line(packets, notes)
    tables: dict[str, Table] = {}
    if line is None:
        if gnss is not None:
            notes.append("GnssPvtData was left out: the packets' UTC, which relates it to the samples, is not logged.")
        base = TimeBase("local")
        shift = 0.0
    else:
        shift = float(line.gps_at_zero // WEEK_S * WEEK_S)
        base = TimeBase("gps", shift)
        if gnss is not None:
            tables["gnss"] = gnss_table(gnss, start - shift)
    for part, rows in columns_of.items():
        t = _times(path, rows, hints, notes)
        keep = parts.later(t, part, path, notes)
        t, rows = t[keep], {name: values[keep] for name, values in rows.items()}
        if line is not None:
            t = line.seconds(t, shift)
        tables[part] = imu_table(t, rows, kind, notes) if part == "imu" else _reference(t, rows, packets, hints, notes)
    made = parts.assemble(path, tables, replace(hints, rate=None), base, notes)
    return replace(made, metadata=replace(made.metadata, options=hints.given()))


def joined(packets: list[Packets], items: tuple[str, ...]) -> dict[str, FloatArray] | None:
    """Packets that have all of these items, in order of the file, with their times; ``None`` if none has."""
    having = [p for p in packets if all(item in p.numbers for item in items)]
    if not having:
        return None
    place = np.concatenate([p.order for p in having])
    order = np.argsort(place, kind="stable")
    rows: dict[str, Any] = {"place": place[order].astype(np.float64)}
    for item in items:
        rows[item] = np.concatenate([p.numbers[item] for p in having])[order]
    if all("fine" in p.fields for p in having):
        rows["t"] = np.concatenate([p.fields["fine"]["value"] for p in having])[order] * TICK
    elif all("counter" in p.fields for p in having):
        rows["counter"] = np.concatenate([p.fields["counter"]["value"] for p in having])[order]
    temperatures = [p.numbers.get("temp") for p in having]
    if any(t is not None for t in temperatures):
        pairs = zip(having, temperatures, strict=True)
        columns = [np.full(len(p.order), np.nan) if t is None else t[:, 0] for p, t in pairs]
        rows["temp"] = np.concatenate(columns)[order]
    return rows


def _times(path: Path, rows: dict[str, FloatArray], hints: ReadHints, notes: list[str]) -> FloatArray:
    """Times on the sensor's clock, over the ends of its counters. Shape (n,). [s]"""
    if "t" in rows:
        if hints.rate is not None:
            raise InputError(f"{path}: the packets have times (SampleTimeFine); leave out rate")
        return unwrapped(rows["t"], 2.0**32 * TICK)
    if "counter" not in rows or hints.rate is None:
        raise InputError(
            f"{path}: the packets have no SampleTimeFine: log it, or say the rate, such as rate=100 [Hz] (with "
            f"PacketCounter, which is {'there' if 'counter' in rows else 'not there either'})"
        )
    notes.append(f"Stamps are the packet counter at {hints.rate:g} Hz.")
    count = unwrapped(rows["counter"], 65536.0)
    return np.asarray((count - count[0]) / hints.rate)


def imu_table(t: FloatArray, rows: dict[str, FloatArray], kind: str, notes: list[str]) -> Table:
    """Samples of one of :data:`IMUS` at times. [s]"""
    force, turn = (rows[item] for item in IMUS[kind])
    if kind == "delta":
        turn = unit_quaternions(turn, lambda row, text: FileFormatError(f"DeltaQ {row + 1}: {text}"))
        turn = rotation.rotvec_from_quat(turn)
        notes.append("imu: DeltaV and DeltaQ (as rotation vectors), increments over the interval before each packet.")
    else:
        notes.append(
            "imu: Acceleration and RateOfTurn." if kind == "rates" else "imu: AccelerationHR and RateOfTurnHR."
        )
    values = {"t": t}
    values |= {f"a{axis}": force[:, k] for k, axis in enumerate("xyz")}
    values |= {f"g{axis}": turn[:, k] for k, axis in enumerate("xyz")}
    if "temp" in rows and np.isfinite(rows["temp"]).any():
        measured = np.flatnonzero(np.isfinite(rows["temp"]))
        values["temp"] = np.interp(np.arange(len(t)), measured, rows["temp"][measured])
        if len(measured) < len(t):
            notes.append("Temperatures, which come less often than samples, were interpolated.")
    return Table(values, axes="FLU", kind="increment" if kind == "delta" else "rate")


def _reference(
    t: FloatArray, rows: dict[str, FloatArray], packets: list[Packets], hints: ReadHints, notes: list[str]
) -> Table:
    """The sensor's own solution, from its axes (ENU, NED or NWU) to north, east, down."""
    first = next(p for p in packets if all(item in p.numbers for item in _SOLUTION))
    axes, axes_v = first.systems["q"] or "ENU", first.systems["v"] or "ENU"
    q = unit_quaternions(rows["q"], lambda row, text: FileFormatError(f"attitude {row + 1}: {text}"))
    C_bs = axes_matrix(hints.axes or "FLU")
    C_nb = _TO_NED[axes] @ rotation.dcm_from_quat(q) @ C_bs.T
    angles = rotation.rpy_from_quat(rotation.quat_from_dcm(C_nb))
    v = rows["v"] @ _TO_NED[axes_v].T
    values = {"t": t, "lat": rows["latlon"][:, 0] * units.DEG, "lon": rows["latlon"][:, 1] * units.DEG}
    values["h"] = rows["h"][:, 0]
    values |= {name: v[:, k] for k, name in enumerate(("vn", "ve", "vd"))}
    values |= {name: angles[:, k] for k, name in enumerate(("roll", "pitch", "yaw"))}
    notes.append(
        f"reference: the sensor's own solution ({axes}), made of the same sensors: to compare with, not a truth; its "
        "heading may count from magnetic north."
    )
    return Table(values)


def is_text_export(head: bytes) -> bool:
    """Whether one of the first lines names columns as MT Manager's exports do, of an IMU."""
    return _NAMES.search(head[:8000]) is not None


def read_text_export(path: Path, hints: ReadHints) -> Recording:
    """IMU of an export of MT Manager, and where it has places the sensor's own solution as reference.

    Parameters
    ----------
    path : Path
    hints : ReadHints
        ``rate`` where the header has none and SampleTimeFine is not exported; ``axes``, default "FLU".

    Returns
    -------
    Recording
        On the sensor's clock: SampleTimeFine, or the packet counter at the rate of the header.

    Raises
    ------
    FileFormatError, InputError
        If columns are missing or there is no time.
    """
    lines.check_file(path)
    rate = hints.rate
    with path.open(encoding="utf-8", errors="replace") as stream:
        names: list[str] = []
        delimiter = "\t"
        for number, text in enumerate(stream, 1):
            if (match := _RATE.match(text)) and rate is None:
                rate = float(match.group(1)) if float(match.group(1) or 0) > 0 else None
            if text.removeprefix("\ufeff").startswith("PacketCounter"):
                delimiter = max("\t,;", key=text.count)
                names = [name.strip() for name in text.removeprefix("\ufeff").rstrip("\r\n").split(delimiter)]
                break
            if number > 200:
                break
        first = stream.readline().rstrip("\r\n").split(delimiter)
    missing = [name for name in ("PacketCounter", *_ACCEL, *_GYRO) if name not in names]
    if missing:
        raise FileFormatError(
            f"the export has no {', '.join(missing)}: export inertial data (calibrated Acc and Gyr) with MT Manager",
            path,
        )
    if len(first) < len(names):
        raise FileFormatError(
            f"the line of names has {len(names)} columns, the first of numbers {len(first)}: which is which cannot be "
            "told; export again",
            path,
            number + 1,
        )
    timed = "SampleTimeFine" in names and first[names.index("SampleTimeFine")].strip() != ""
    clock = "SampleTimeFine" if timed else "PacketCounter"
    placed = all(name in names and lines.is_number(first[names.index(name)].strip()) for name in _PLACE)
    used, place = (
        [names.index(name) for name in some] for some in ((clock, *_ACCEL, *_GYRO), _PLACE if placed else ())
    )
    table = TextTable(path, number + 1, delimiter, "//", "latin-1")
    try:
        values, truncated = lines.load(table, len(names), used + place, allow_truncated=hints.allows("truncated"))
    except FileFormatError:  # places may be in some rows only
        place = []
        values, truncated = lines.load(table, len(names), used, allow_truncated=hints.allows("truncated"))
    notes = [f"{path.name}: the last line was cut off and left out."] if truncated else []
    if clock == "SampleTimeFine":
        ticks = unwrapped(values[:, 0], 2.0**32)
        if len(ticks) > 1 and float(np.median(np.diff(ticks))) > _SLOWEST:
            t = ticks * _TICK_DOT
            values[:, 4:7] *= units.DEG
            notes.append("Stamps in microseconds show a Movella DOT, whose rates are in deg/s.")
        else:
            t = ticks * _TICK
            notes.append("Stamps are SampleTimeFine, the sensor's own clock in units of 0.1 ms.")
    elif rate is None:
        raise InputError(f"{path}: SampleTimeFine is not exported and the header has no rate: say it, as rate=100 [Hz]")
    else:
        count = unwrapped(values[:, 0], 65536.0)
        t = (count - count[0]) / rate
        notes.append(f"Stamps are the packet counter at {rate:g} Hz.")
    keep = parts.later(t, "export", path, notes)
    columns = {"t": t[keep]}
    for names_of, letter, shift in ((_ACCEL, "a", 1), (_GYRO, "g", 4)):
        columns |= {f"{letter}{axis}": values[keep, shift + k] for k, axis in enumerate("xyz"[: len(names_of)])}
    tables = {"imu": Table(columns, axes="FLU")}
    if place and (located := keep & (values[:, 7:9] != 0.0).any(axis=1)).any():
        lat, lon, h = values[located, 7:].T
        tables["reference"] = Table({"t": t[located], "lat": lat * units.DEG, "lon": lon * units.DEG, "h": h})
        notes.append(
            "reference: the places of the export are the sensor's own solution, made of the same sensors: to compare "
            "with, no fixes and not a truth; its velocities, whose axes the export does not state, are left out."
        )
    made = parts.assemble(path, tables, replace(hints, rate=None, time=None), TimeBase("local"), notes)
    return replace(made, metadata=replace(made.metadata, options=hints.given()))
