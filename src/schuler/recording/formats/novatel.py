"""NovAtel OEM and SPAN logs, binary or ASCII: raw IMU, GNSS, and the receiver's inertial solution as reference.

Messages and units: NovAtel, "OEM7 Commands and Logs Reference Manual"; frames and scale factors in ``novatel_frames``.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from schuler import units
from schuler.arrays import BoolArray, FloatArray
from schuler.exceptions import FileFormatError, InputError
from schuler.recording.formats.novatel_frames import IMU_TYPES, TYPES, ImuType, Messages, by_name, load, looks_like
from schuler.recording.io import parts
from schuler.recording.io.hint_texts import parse_scale, parse_streams
from schuler.recording.io.hints import ReadHints
from schuler.recording.io.parts import Table
from schuler.recording.io.receiver_tables import (
    NO_VELOCITY,
    RATE_ERROR,
    Columns,
    base_of,
    keep_timed,
    pick,
    preferred,
    velocity_at,
    weeks_to_seconds,
)
from schuler.recording.io.streams import Stream, stream_of
from schuler.recording.recording import Recording

#: Positions that are read, in order of preference, and the velocity that belongs to each.
POSITIONS = {"BESTGNSSPOS": "BESTGNSSVEL", "BESTPOS": "BESTVEL", "RTKPOS": "BESTVEL", "PSRPOS": "PSRVEL"}
#: Hints that mean something here.
HINTS = {"sigma", "axes", "streams", "scale"}
#: Counts of an IMU, in order of preference.
RAW = ("RAWIMUSX", "RAWIMUX", "RAWIMUS", "RAWIMU")
_CORRECTED = ("CORRIMUDATA", "CORRIMUDATAS", "CORRIMUS", "IMURATECORRIMUS")
_INS = ("INSPVAX", "INSPVA", "INSPVAS", "IMURATEPVA", "IMURATEPVAS")
HEADINGS = ("DUALANTENNAHEADING", "HEADING2")
_PARTS = {
    **dict.fromkeys(RAW, "imu"),
    **dict.fromkeys(POSITIONS, "gnss"),
    **dict.fromkeys(_INS, "reference"),
    **dict.fromkeys(HEADINGS, "heading"),
}
_NO_SOLUTION_TYPES = (0, 1, 2)  # none, and fixed by the user
_GOOD = (2, 3, 6, 7)  # of the inertial solution: high variance, good, free, alignment complete
_THINNED = 1.5  # sample intervals of the IMU's own
#: Types of positions and velocities that come from the receiver's inertial solution.
AIDED_BY_INS = frozenset(number for name, number in TYPES.items() if name.startswith("INS_"))
# RTKLIB's quality of a position type; every other is single
_QUALITY = {
    **dict.fromkeys((48, 49, 50, 51, 56), 1),
    **dict.fromkeys((32, 33, 34, 55), 2),
    **dict.fromkeys((18, 52), 3),
    **dict.fromkeys((17, 20, 54, 57), 4),
    **dict.fromkeys((64, 65, 68, 69, 73, 74, 77, 78, 79, 80), 6),
    19: 7,
}
_WGS84 = 61.0
_STATED = "as stated"  # name of an IMU whose factors are a hint
_FARTHEST = 0.6  # of a velocity from its position: a latency of a quarter second, at 1 Hz [s]


def sniff(head: bytes, path: Path) -> bool:
    """Whether a whole message of a NovAtel receiver with a right CRC is among the first bytes."""
    return looks_like(head)


def contents(path: Path) -> list[Stream]:
    """Messages of the log that can be read, and those of other kinds."""
    return _streams(load(path))


def _streams(log: Messages) -> list[Stream]:
    made = []
    for name, rows in log.columns.items():
        week, sow = ("week", "sow") if "week" in rows else ("header_week", "header_sow")
        t = weeks_to_seconds(rows[week], rows[sow], rows[week].max())
        made.append(stream_of(name, "NovAtel", t, _PARTS.get(name, "")))
    return made + [Stream(name, "NovAtel", count) for name, count in log.others.items()]


@np.errstate(invalid="ignore", over="ignore")  # what is no number is refused by the checks of parts.assemble
def read(path: Path, hints: ReadHints) -> Recording:
    """Recording of a NovAtel log.

    Parameters
    ----------
    path : Path
    hints : ReadHints
        ``streams`` chooses where there are several: ``imu`` (``RAWIMUSX`` ..), ``gnss`` (``BESTGNSSPOS``, ``BESTPOS``
        ..), ``reference`` (``INSPVAX``, ``INSPVA`` ..), ``heading`` (``HEADING2``, only if named). ``scale`` says what
        a count is where the log does not (RAWIMU and RAWIMUS without INSCONFIG): the IMU's name, ``scale="STIM300"``,
        or ``scale="accel=..,gyro=.."`` in m/s and rad per count. ``axes`` of the IMU, default "RFU" as SPAN has them;
        ``sigma`` with six numbers for velocities.

    Returns
    -------
    Recording
        On GPS time from the start of the first message's week.

    Raises
    ------
    FileFormatError, InputError
        If the log is damaged, holds none of these messages, or no scale of its raw IMU is known.

    Notes
    -----
    CORRIMU messages are not read: gravity and the Earth's rotation have been taken out of them, so they are no
    measurements to navigate with. BESTPOS of a SPAN receiver may come from its inertial solution (types
    ``INS_...``); such epochs are left out unless the stream is named, for a filter that uses them would use the IMU
    twice.
    """
    parts.check_hints(path, hints, HINTS, "a NovAtel log")
    log = load(path)
    notes, chosen, streams = list(log.notes), parse_streams(hints.streams), _streams(log)
    orders = {"imu": RAW, "gnss": tuple(POSITIONS), "reference": _INS}
    taken = {part: preferred(streams, part, chosen, order, notes) for part, order in orders.items()}
    taken["heading"] = preferred(streams, "heading", chosen, (), notes) if "heading" in chosen else None
    if hints.series is not None:
        taken = {part: name if part == hints.series else None for part, name in taken.items()}
    clock = {"imu": ("week", "sow"), "gnss": ("header_week", "header_sow"), "heading": ("header_week", "header_sow")}
    rows: dict[str, Columns] = {}
    for part, name in taken.items():
        if name is None:
            continue
        week, sow = clock.get(part, ("week", "sow") if "week" in log.columns[name] else ("header_week", "header_sow"))
        kept = keep_timed(usable(log, part, name, notes, named=part in chosen), week, sow, name, path, notes)
        if len(kept[week]):
            rows[part] = kept | {"t_week": kept[week], "t_sow": kept[sow]}
    if not rows:
        raise FileFormatError(_nothing(log), path)
    first = min(float(r["t_week"][0]) for r in rows.values())
    tables: dict[str, Table] = {}
    for part, kept in rows.items():
        name = taken[part] or ""
        t = weeks_to_seconds(kept["t_week"], kept["t_sow"], first)
        if part == "imu":
            tables[part] = _imu(log, name, t, kept, hints, notes)
        elif part == "gnss":
            tables[part] = gnss_table(log, name, t, kept, first, hints, notes)
        elif part == "heading":
            tables[part] = heading_table(name, t, kept, notes)
        else:
            tables[part] = reference_table(log, name, t, kept, notes)
    return parts.assemble(path, tables, hints, base_of(first), notes)


def _nothing(log: Messages) -> str:
    present = ", ".join([*log.columns, *log.others]) or "no messages"
    why = ""
    if any(name in log.columns for name in _CORRECTED):
        why = "; CORRIMU messages hold no gravity and no Earth rotation and cannot be navigated with: log RAWIMUSXB"
    return f"expected {', '.join((*RAW[:1], *POSITIONS, *_INS[:2]))} with a solution, found {present}{why}"


def usable(log: Messages, part: str, name: str, notes: list[str], *, named: bool) -> Columns:
    """Rows of a message that hold a solution."""
    rows = log.columns[name]
    if part == "imu":
        return rows
    if part == "reference":
        good = np.isin(rows["ins"], _GOOD)
        if (n := int((~good).sum())) > 0:
            notes.append(f"{name}: {n} epochs while the inertial solution was not there were left out.")
        if (n := int((rows["ins"][good] == _GOOD[0]).sum())) > 0:
            notes.append(f"{name}: at {n} epochs the receiver itself calls its solution one of high variance.")
        return pick(rows, good)
    good = (rows["status"] == 0) & ~np.isin(rows["type"], _NO_SOLUTION_TYPES)
    if (n := int((~good).sum())) > 0:
        notes.append(f"{name}: {n} epochs without a solution were left out.")
    aided = good & np.isin(rows["type"], list(AIDED_BY_INS))
    if part == "gnss" and aided.any():
        if named:
            notes.append(
                f"{name}: {int(aided.sum())} epochs come from the receiver's inertial solution; kept as named."
            )
        else:
            notes.append(
                f"{name}: {int(aided.sum())} epochs come from the receiver's inertial solution, not from GNSS alone, "
                f"and were left out (log BESTGNSSPOS; streams='gnss={name}' keeps them)."
            )
            good &= ~aided
    return pick(rows, good)


def _imu(log: Messages, name: str, t: FloatArray, rows: Columns, hints: ReadHints, notes: list[str]) -> Table:
    imu_type = counts_of(log, name, rows, hints)
    if imu_type.name == _STATED:
        notes.append(f"{name}: a count is {imu_type.accel:g} m/s and {imu_type.gyro:g} rad, as stated.")
    else:
        notes.append(
            f"{name}: IMU {imu_type.name}, a count is {imu_type.accel:.6g} m/s and {imu_type.gyro:.6g} rad (NovAtel's "
            "table)."
        )
    check_not_thinned(name, t, imu_type, log.path)
    if "info" in rows and (n := int((rows["info"].astype(np.int64) & 1).sum())):
        notes.append(f"{name}: {n} samples carry the IMU's error flag; they were kept.")
    return imu_table(t, rows, imu_type)


def check_not_thinned(name: str, t: FloatArray, imu_type: ImuType, path: Path) -> None:
    """Refuse samples that are farther apart than the IMU makes them.

    Raises
    ------
    FileFormatError
        The increments in between were not logged.
    """
    interval = float(np.median(np.diff(t))) if len(t) > 1 else 0.0
    if imu_type.rate_hz is not None and interval * imu_type.rate_hz > _THINNED:
        raise FileFormatError(
            f"{name}: samples are {interval:.4g} s apart, but {imu_type.name} makes one each "
            f"{1.0 / imu_type.rate_hz:.4g} s: increments in between were not logged, and the motion in them is lost. "
            "Log RAWIMUSXB ONNEW; if the unit runs at this rate, state scale='accel=..,gyro=..'",
            path,
        )


def imu_table(t: FloatArray, rows: Columns, imu_type: ImuType) -> Table:
    """IMU series of counts."""
    values = {"t": t}
    for axis, sign in (("x", 1.0), ("y", -1.0), ("z", 1.0)):
        label = "minus_" if axis == "y" else ""
        values[f"a{axis}"] = sign * imu_type.accel * rows[f"{label}a{axis}"]
        values[f"g{axis}"] = sign * imu_type.gyro * rows[f"{label}g{axis}"]
    return Table(values, axes="RFU", kind="increment")


def counts_of(log: Messages, name: str, rows: Columns, hints: ReadHints) -> ImuType:
    """Type of the IMU, or the factors, as stated; else as the samples say, or as INSCONFIG does.

    Raises
    ------
    FileFormatError, InputError
        If it is not known what a count is.
    """
    stated = parse_scale(hints.scale)
    choices = ", ".join(kind.name for kind in IMU_TYPES.values())
    if isinstance(stated, dict):
        accel, gyro = stated.get("accel"), stated.get("gyro")
        if accel is None or gyro is None or len(stated) != 2:
            raise InputError("scale: a NovAtel IMU needs accel=.. [m/s] and gyro=.. [rad] of a count, and no other")
        return ImuType(_STATED, accel, gyro)
    if stated is not None:
        imu_type = by_name(stated)
        if imu_type is None:
            raise InputError(f"scale: {stated!r} is no IMU whose counts are known; known are {choices}")
        return imu_type
    if "imu" in rows:
        numbers = np.unique(rows["imu"])
        if len(numbers) > 1:
            raise FileFormatError(f"{name}: the IMU changes its type within the log; cut it there", log.path)
        word = f"{int(numbers[0])}"
    elif (config := log.columns.get("INSCONFIG")) is not None:
        number = config["imu"][-1]
        word = log.words.get("INSCONFIG.imu", "") if number < 0.0 else f"{int(number)}"
    else:
        raise FileFormatError(
            f"{name} does not say which IMU it counts for: log RAWIMUSX or INSCONFIG, or say scale='NAME' of "
            f"{choices}, or scale='accel=..,gyro=..' [m/s and rad of a count]",
            log.path,
        )
    imu_type = by_name(word)
    if imu_type is None:
        raise FileFormatError(
            f"{name}: the counts of IMU type {word} are not in our table: look them up in NovAtel's manual (RAWIMUSX) "
            "and say scale='accel=..,gyro=..' [m/s and rad of a count]",
            log.path,
        )
    return imu_type


def gnss_table(
    log: Messages, name: str, t: FloatArray, rows: Columns, first: float, hints: ReadHints, notes: list[str]
) -> Table:
    """GNSS series of a position message, with the velocity that belongs to it; ``first`` is the week of time zero."""
    values = {
        "t": t,
        "lat": rows["lat"] * units.DEG,
        "lon": rows["lon"] * units.DEG,
        "h": rows["msl"] + rows["undulation"],
        "sn": rows["slat"],
        "se": rows["slon"],
        "sd": rows["sh"],
        "q": np.array([_QUALITY.get(int(kind), 5) for kind in rows["type"]], dtype=np.float64),
        "ns": rows["used"],
    }
    notes.append(
        f"{name}: heights above mean sea level were made ellipsoidal with the receiver's own undulation (median "
        f"{np.median(rows['undulation']):.2f} m)."
    )
    datum = log.words.get(f"{name}.datum", "WGS84")
    if datum != "WGS84" or np.any((rows["datum"] >= 0.0) & (rows["datum"] != _WGS84)):
        notes.append(f"{name}: positions are not on WGS 84 by the receiver's own setting; they were taken as they are.")
    velocity = POSITIONS[name]
    if velocity in log.columns:
        values |= _velocity(log, velocity, t, first, hints, notes)
    notes.append(f"gnss: {name}, of the antenna.")
    return Table(values)


def velocities_alone(rows: Columns) -> BoolArray:
    """Rows of a velocity message that hold one of GNSS, without the receiver's inertial solution. Shape (n,)."""
    return np.asarray((rows["status"] == 0) & (rows["type"] > 0) & ~np.isin(rows["type"], list(AIDED_BY_INS)))


def _velocity(
    log: Messages, name: str, t: FloatArray, first: float, hints: ReadHints, notes: list[str]
) -> dict[str, FloatArray]:
    rows = log.columns[name]
    rows = keep_timed(pick(rows, velocities_alone(rows)), "header_week", "header_sow", name, log.path, notes)
    if not len(rows["speed"]):
        notes.append(f"{name} has no velocity of GNSS alone.")
        return {}
    t_v = weeks_to_seconds(rows["header_week"], rows["header_sow"], first) - rows["latency"]
    later = parts.later(t_v, f"{name} without its latency", log.path, notes)
    rows, t_v = pick(rows, later), t_v[later]
    if not len(t_v):
        notes.append(f"{name} has no velocity at a time that is a number.")
        return {}
    track = rows["track"] * units.DEG
    v = np.stack((rows["speed"] * np.cos(track), rows["speed"] * np.sin(track), -rows["up"]), axis=1)
    velocity, near = velocity_at(t, t_v, v, _FARTHEST)
    given = hints.sigmas[3:] if hints.sigmas is not None and len(hints.sigmas) == 6 else (RATE_ERROR,) * 3
    latency = float(np.median(rows["latency"]))
    notes.append(
        f"{name}: velocities come without accuracy; 1-sigma is {given[0]:g}, {given[1]:g}, {given[2]:g} m/s (hint "
        f"sigma with six numbers replaces it). Their latency (median {latency:.3g} s) was taken off, and they were "
        "interpolated to the positions (linear)."
    )
    if not near.all():
        notes.append(
            f"{name}: {int((~near).sum())} positions have no velocity near; it was set to zero with a 1-sigma of "
            f"{NO_VELOCITY:g} m/s."
        )
    sigma = np.where(near[:, None], np.array(given), NO_VELOCITY)
    made = {label: velocity[:, k] for k, label in enumerate(("vn", "ve", "vd"))}
    return made | {label: sigma[:, k] for k, label in enumerate(("svn", "sve", "svd"))}


def heading_table(name: str, t: FloatArray, rows: Columns, notes: list[str]) -> Table:
    """Heading of two antennas."""
    notes.append(f"heading: {name}, of the line between two antennas, which need not be the body's x axis.")
    return Table({"t": t, "heading": rows["heading"] * units.DEG, "sheading": rows["sheading"] * units.DEG})


def reference_table(log: Messages, name: str, t: FloatArray, rows: Columns, notes: list[str]) -> Table:
    """Reference of an inertial solution. SPAN's roll, pitch and azimuth are those of axes forward-right-down."""
    if "msl" in rows:
        height = rows["msl"] + rows["undulation"]
        notes.append(f"{name}: heights above mean sea level were made ellipsoidal with the receiver's undulation.")
    else:
        height = rows["h"]
    values = {
        "t": t,
        "lat": rows["lat"] * units.DEG,
        "lon": rows["lon"] * units.DEG,
        "h": height,
        "vn": rows["vn"],
        "ve": rows["ve"],
        "vd": -rows["vu"],
        "roll": rows["roll"] * units.DEG,
        "pitch": rows["pitch"] * units.DEG,
        "yaw": rows["azimuth"] * units.DEG,
    }
    sigma = rows if "slat" in rows else log.columns.get("INSSTDEVS", log.columns.get("INSSTDEV"))
    own = ""
    if sigma is not None:
        at = np.median(
            np.stack([sigma[f"s{axis}"] for axis in ("lat", "lon", "h", "roll", "pitch", "azimuth")]), axis=1
        )
        own = (
            f" By its own account it is good to {np.hypot(at[0], at[1]):.3g} m horizontally, {at[2]:.3g} m vertically, "
            f"{at[3]:.3g}, {at[4]:.3g}, {at[5]:.3g} deg in roll, pitch, azimuth (medians)."
        )
    notes.append(
        f"reference: {name}, the receiver's own inertial solution, made of the same sensors: to compare with, not a "
        f"truth; at the IMU, or where SETINSTRANSLATION USER put it.{own}"
    )
    return Table(values)
