"""Hints of a single table: columns, units, clock and accuracy, as far as header and numbers tell them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from schuler.arrays import FloatArray
from schuler.exceptions import FileFormatError, SchulerError
from schuler.proposal import arrays, halves, tables
from schuler.proposal.decision import Decision
from schuler.recording.formats import nmea, registry, rtklib, text
from schuler.recording.io import columns, lines, text_head
from schuler.recording.io.hints import ReadHints

#: End of the evidence of a unit that only motion can tell.
UNTIL = "rad/s until the motion says otherwise"
_MOST_DEG = 180.0
#: Factors of a u-blox receiver's whole numbers (NAV-PVT): degrees, metres, metres a second.
_UBLOX = {"lat": 1e-7, "lon": 1e-7, "h": 1e-3, "speed": 1e-3, "course": 1e-5, "heading": 1e-5}
_AT_ZERO = 0.05  # of latitude or longitude, beside which a log was made up at zero in degrees
_SPEED_SIGMA = 0.1  # of wheels that do not say theirs [m/s]


def half_hints(path: Path, part: str) -> tuple[dict[str, Any], list[Decision]]:
    """Hints of a file of an accelerometer or a gyroscope alone."""
    columns, evidence = halves.half_columns(path, part)
    entry: dict[str, Any] = {} if columns is None else {"columns": columns}
    decisions = [Decision(f"recording.{part}.file", path.name, evidence)]
    names, stated = _layout(path, columns)
    triad = "ax" if part == "accel" else "gx"
    if triad not in stated:
        unit = UNTIL.partition(" ")[0]
        if part == "accel":
            unit = tables.accel_unit(tables.norm(path, [names.index(name) for name in ("ax", "ay", "az")]))
        entry["units"] = f"{part}={unit}"
    t = tables.column(path, names.index("t")) if "t" in names else None
    if t is not None and "t" in stated:
        return (entry, decisions) if tables.unix_unit(t) is None else (entry | {"time": "unix"}, decisions)
    if t is not None and (clock := tables.time_unit(t)) is not None:
        if clock[0] != "s":
            entry["units"] = ",".join(filter(None, (entry.get("units"), f"t={clock[0]}")))
        if clock[1] is not None:
            entry["time"] = clock[1]
    return entry, decisions


def table_hints(path: Path, section: str, part: str | None) -> tuple[dict[str, Any] | None, list[Decision]]:
    """Hints of a plain table: columns where no header names them, the unit of time; None if it cannot be match."""
    entry: dict[str, Any] = {}
    decisions: list[Decision] = []
    match: tuple[str, str] | None = None
    held = arrays.inertial(path)
    if part is None and not (held is not None and held.by_name):
        match = tables.imu_columns(path)
        if match is None and (match := tables.fix_columns(path)) is not None:
            part = "gnss"
        if match is None:
            return None, []
        entry["columns"] = match[0]
        decisions.append(Decision(f"{section}.columns", match[0], match[1]))
        if held is not None and held.factors is not None:
            entry["scale"] = held.factors
            decisions.append(Decision(f"{section}.scale", held.factors, "as many numbers as the counts have columns"))
    if part not in (None, "imu"):
        names = _layout(path, None)[0] if "columns" not in entry else []
        if (at := tables.clock_column(path, names)) is not None:
            entry["columns"] = _with_clock(names, at)  # as of its IMU
        of_clock, more = _clock(path, section, entry.get("columns"))
        entry, decisions = entry | of_clock, decisions + more
        if match is not None and "time" not in entry and (week := tables.gps_week(path)) is not None:
            entry["time"] = f"gps-tow:{week[1]}"
            decisions.append(Decision(f"{section}.time", entry["time"], f"column {week[0]} holds weeks of GPS"))
        if part == "gnss" and (scale := _whole_units(path)):
            entry["scale"] = scale
            why = "whole numbers beyond 180: u-blox's units, 1e-7 deg, mm, mm/s and 1e-5 deg"
            decisions.append(Decision(f"{section}.scale", scale, why))
        if part in ("gnss", "reference") and _in_radians(path, entry.get("columns")):
            entry["units"] = ",".join(filter(None, (entry.get("units"), "angle=rad")))
            decisions = [d for d in decisions if d.entry != f"{section}.units"]
            why = "latitudes and longitudes within 3.2 of zero: no land lies there, if they were degrees"
            decisions.append(Decision(f"{section}.units", entry["units"], why))
        accuracy, more = (
            ({}, []) if section.endswith("reference") else accuracy_hints(path, section, part, entry.get("columns"))
        )
        return entry | accuracy, decisions + more
    names, stated = _layout(path, entry.get("columns")) if held is None else (
        [*columns.ACCEL, *columns.GYRO] if held.by_name else str(entry["columns"]).split(","), set()
    )  # fmt: skip
    if (at := tables.clock_column(path, names)) is not None:
        entry["columns"] = _with_clock(names, at)
        names = entry["columns"].split(",")
        decisions.append(Decision(f"{section}.columns", entry["columns"], f"column {at + 1} increases like a clock"))
    units: dict[str, str] = {}
    why = ""
    accel = [names.index(name) for name in columns.ACCEL if name in names]
    if len(accel) == 3 and "ax" not in stated:
        norm = tables.norm(path, accel)
        units["accel"] = tables.accel_unit(norm)
        why = f"the norm of specific force is about {norm:.4g}"
    if "gx" in names and "gx" not in stated:
        units["gyro"] = "rad/s"
        why = f"{why}; {UNTIL}" if why else UNTIL
    if units:
        decisions.append(Decision(f"{section}.units", "", why))
    t = tables.column(path, names.index("t")) if "t" in names else None
    clock = None if t is None or "t" in stated else tables.time_unit(t)
    if t is not None and "t" in stated and (unit := tables.unix_unit(t)) is not None:
        dated, more = _dated(section, t, unit)
        entry, decisions = entry | dated, decisions + more
    if t is not None and clock is not None:
        if clock[0] != "s":
            units["t"] = clock[0]
            step = float(np.median(np.diff(t)))
            stamps = f"stamps step by {step:g}, which is no other unit of an IMU's"
            why = f"{stamps}; {why}" if why else stamps
            decisions = [d for d in decisions if d.entry != f"{section}.units"]
            decisions.append(Decision(f"{section}.units", "", why))
        if clock[1] is not None:
            entry["time"] = clock[1]
            decisions.append(
                Decision(f"{section}.time", clock[1], f"stamps of {t[0]:.6g} {clock[0]} are of this century")
            )
    if units:
        entry["units"] = ",".join(f"{group}={unit}" for group, unit in units.items())
        decisions = [replace(d, value=entry["units"]) if d.entry == f"{section}.units" else d for d in decisions]
    return entry, decisions


def _with_clock(names: Sequence[str], at: int) -> str:
    """Hint ``columns`` with the time at a position."""
    return ",".join("t" if k == at else "-" if name == "t" else name for k, name in enumerate(names))


def _clock(path: Path, section: str, given: str | None) -> tuple[dict[str, Any], list[Decision]]:
    """Hints of a table's clock where its stamps are Unix time, as those of an IMU's beside it are then told."""
    names, stated = _layout(path, given)
    t = tables.column(path, names.index("t")) if "t" in names else None
    unit = None if t is None else tables.unix_unit(t)
    if t is not None and "t" in stated:
        return _dated(section, t, unit) if unit is not None else ({}, [])
    counted = None if t is None or "ax" not in names else tables.time_unit(t)  # those of the IMU in the same table
    if t is not None and unit is None and counted is not None and counted[0] != "s":
        unit = counted[0]
        return {"units": f"t={unit}"}, [Decision(f"{section}.units", f"t={unit}", "as of the IMU in the same rows")]
    if t is None or unit is None:
        return {}, []
    entry = {"time": "unix"} | ({} if unit == "s" else {"units": f"t={unit}"})
    why = f"stamps of {t[0]:.6g} {unit} are of this century"
    return entry, [Decision(f"{section}.{name}", value, why) for name, value in entry.items()]


def _whole_units(path: Path) -> str:
    """Hint ``scale`` of fixes in whole numbers, as a u-blox receiver has them; empty if they are none."""
    names, stated = _layout(path, None)
    if not {"lat", "lon"} <= set(names) or {"lat", "lon"} & stated:
        return ""
    values = {name: tables.column(path, names.index(name)) for name in _UBLOX if name in names and name not in stated}
    whole = {name: x for name, x in values.items() if x is not None and len(x) and (x == np.round(x)).all()}
    if not {"lat", "lon"} <= set(whole) or max(np.abs(whole["lat"]).max(), np.abs(whole["lon"]).max()) <= _MOST_DEG:
        return ""
    return ",".join(f"{name}={_UBLOX[name]:g}" for name in whole)


def _in_radians(path: Path, given: str | None) -> bool:
    """Whether latitudes and longitudes without a unit are radians: degrees would lie in the Gulf of Guinea."""
    names, stated = _layout(path, given)
    if not {"lat", "lon"} <= set(names) or {"lat", "lon"} & stated:
        return False
    angles = {n: tables.column(path, names.index(n)) for n in ("lat", "lon", "course", "heading") if n in names}
    largest = {name: float(np.nanmax(np.abs(x))) for name, x in angles.items() if x is not None and len(x)}
    if not {"lat", "lon"} <= set(largest) or {"course", "heading"} & stated:
        return False
    place = max(largest["lat"], largest["lon"])
    return _AT_ZERO < place <= np.pi and largest["lat"] <= 0.5 * np.pi and max(largest.values()) <= 2.0 * np.pi


def _dated(section: str, t: FloatArray, unit: str) -> tuple[dict[str, Any], list[Decision]]:
    """Hint that stamps whose unit the header states are Unix time."""
    return {"time": "unix"}, [Decision(f"{section}.time", "unix", f"stamps of {t[0]:.6g} {unit} are of this century")]


def accuracy_hints(
    path: Path, section: str, part: str, given: str | None = None
) -> tuple[dict[str, Any], list[Decision]]:
    """Accuracy of a table's fixes or speeds where no column states it: rules of thumb, as for NMEA without GST."""
    names, _ = _layout(path, given)
    if part == "odometer" and "speed" in names and "sspeed" not in names:
        why = f"no column states an accuracy; {_SPEED_SIGMA:g} m/s is typical of wheels"
        return {"sigma_speed": _SPEED_SIGMA}, [Decision(f"{section}.sigma_speed", _SPEED_SIGMA, why)]
    if part != "gnss" or not {"lat", "n", "x"} & set(names):
        return {}, []
    of_velocity = set(columns.VELOCITY[:2]) <= set(names) and not set(columns.VELOCITY_SIGMA[:2]) <= set(names)
    radius = tables.column(path, names.index("radius")) if "radius" in names else None
    of_position = not (set(columns.SIGMA) <= set(names) or (radius is not None and bool(np.all(radius > 0.0))))
    if not of_position and not of_velocity:
        return {}, []
    level = nmea.RANGE_ERROR[1]
    numbers = [level, level, nmea.VERTICAL * level] + [nmea.RATE_ERROR] * (3 if of_velocity else 0)
    sigma = ",".join(f"{number:g}" for number in numbers)
    of = "" if of_position else " of velocity"
    why = f"no column states an accuracy{of}; that of a receiver by itself, from which filter.tune finds the log's own"
    return {"sigma": sigma}, [Decision(f"{section}.sigma", sigma, why)]


def rates_by_name(path: Path, given: str | None, axes: str) -> str | None:
    """Hint ``columns`` in which rates called roll and pitch are about the axes along and across.

    Parameters
    ----------
    path : Path
        Table of an IMU.
    given : str or None
        Hint ``columns`` so far.
    axes : str
        Where x, y, z of the accelerometer point.

    Returns
    -------
    str or None
        None where the rates are called otherwise, or are about these axes already.
    """
    names, _ = _layout(path, given)
    if not {"gx", "gy"} <= set(names) or "=" in (given or ""):
        return None
    opening = text_head.open_text(path, ReadHints())
    fields = [] if opening.header is None else opening.header[1]
    called = {name: fields[names.index(name)].lower() for name in ("gx", "gy") if names.index(name) < len(fields)}
    along = next((name for name, field in called.items() if "roll" in field and "pitch" not in field), None)
    across = next((name for name, field in called.items() if "pitch" in field and "roll" not in field), None)
    if along is None or across is None or axes[("gx", "gy").index(along)] not in "RL" or axes[2] not in "UD":
        return None
    return ",".join({"gx": "gy", "gy": "gx"}.get(name, name) for name in names)


def missing_half(path: Path) -> tuple[str, str, str] | None:
    """What a table has of an IMU, what it lacks, and the sensor of that; None if its header names both or neither.

    Parameters
    ----------
    path : Path
    """
    try:
        named = set(_layout(path, None)[0])
    except SchulerError:
        return None
    accel, gyro = set(columns.ACCEL) <= named, set(columns.GYRO) <= named
    if accel == gyro:
        return None
    return (
        ("accelerations", "angular rates", "gyroscope")
        if accel
        else ("angular rates", "accelerations", "accelerometer")
    )


def feels_gravity(path: Path) -> bool:
    """Whether the specific forces of a table have the norm of gravity in some unit; true where that cannot be told.

    Parameters
    ----------
    path : Path
    """
    if not is_plain(path):
        return True
    names, _ = _layout(path, None)
    accel = [names.index(name) for name in columns.ACCEL if name in names]
    return len(accel) < 3 or tables.is_gravity(path, accel)


def unit_of(entry: Mapping[str, Any] | None, group: str) -> str | None:
    """Unit that an entry states of a group of columns."""
    pairs = str((entry or {}).get("units", "")).split(",")
    return next((pair.partition("=")[2] for pair in pairs if pair.startswith(f"{group}=")), None)


def span_of(path: Path, given: str | None = None) -> tuple[float, float] | None:
    """First and last stamp of a table's first rows, as written and where no unit is stated; None if it has none.

    Parameters
    ----------
    path : Path
    given : str, optional
        Hint ``columns``.
    """
    if not path.is_file() or not is_plain(path):
        return None
    names, stated = _layout(path, given)
    t = tables.column(path, names.index("t")) if "t" in names and "t" not in stated else None
    return None if t is None or not len(t) else (float(t[0]), float(t[-1]))


def _layout(path: Path, given: str | None) -> tuple[list[str], set[str]]:
    """Names of a table's columns, and those whose unit its header states."""
    opening = text_head.open_text(path, ReadHints())
    fields = [] if opening.header is None else opening.header[1]
    read = text_head.columns_of(opening)
    names = given.split(",") if given is not None else [column[0] if column else "-" for column in read]
    units = [columns.unit_in(field) for field in fields]
    return names, {name for name, unit in zip(names, units, strict=False) if unit is not None}


def is_plain(path: Path) -> bool:
    """Whether a file is a table of text that no format claims."""
    head = head_of(path)
    if not head or lines.is_binary(head) or head.startswith(b"PAR1"):
        return False
    if registry.find(head, path) is not None or rtklib.looks_like_pos(head) or path.suffix.lower() == ".pos":
        return False
    if text.OWN_MARK.encode() in head:
        return False
    from schuler.recording.io.satellite_files import kinds_of

    return not kinds_of(path, head)


def head_of(path: Path) -> bytes:
    """First bytes of a file; nothing where it cannot be read."""
    try:
        return lines.check_file(path)
    except FileFormatError:
        return b""
