"""Files of one sensor: an accelerometer's or a gyroscope's clock and three columns, by header, unit or name."""

from __future__ import annotations

import re
from pathlib import Path

from schuler.exceptions import SchulerError
from schuler.proposal import tables
from schuler.recording.io import columns, text_head
from schuler.recording.io.hints import ReadHints
from schuler.units import factor_for

_FEWEST = 20  # rows
_CALLED = {
    "accel": re.compile(r"^(?!.*(linear|user|gravity)).*acc(?!u)", re.IGNORECASE),
    "gyro": re.compile(r"gyr|(angular|rotation).?(velocity|rate)", re.IGNORECASE),
}


def half_of_imu(path: Path) -> str | None:
    """Half of an IMU that a table of a time and three columns holds, by header, unit or name of the file.

    Parameters
    ----------
    path : Path

    Returns
    -------
    {"accel", "gyro"} or None
    """
    for half in ("accel", "gyro"):
        if half_columns(path, half)[1]:
            return half
    return None


def sensor_alone(path: Path) -> tuple[dict[str, str], str] | None:
    """Hints of a file that is said to be of one sensor and calls its axes x, y, z, and how they were told.

    Parameters
    ----------
    path : Path

    Returns
    -------
    hints : dict
        ``columns``; of an accelerometer ``units``, by gravity, where the header states none.
    evidence : str
        None where the header names the sensor, or neither it, the file's name nor gravity tells which it is.
    """
    names, why = half_columns(path, "gyro")
    if names is None:
        names, why = half_columns(path, "accel", by_gravity=True)
    if names is None:
        return None
    columns_of = names.split(",")
    if "ax" not in columns_of:
        return {"columns": names}, why
    size = tables.norm(path, [columns_of.index(name) for name in columns.ACCEL])
    stated = text_head.open_text(path, ReadHints()).header
    unit = None if stated is None else columns.unit_in(stated[1][columns_of.index("ax")])
    units = {} if unit is not None else {"units": f"accel={tables.accel_unit(size)}"}
    return {"columns": names} | units, f"the norm of x, y, z is about {size:.4g}"


def half_columns(path: Path, half: str, *, by_gravity: bool = False) -> tuple[str | None, str]:
    """Hint ``columns`` of a file of one sensor (None if its header names them), and evidence; empty if it is none.

    Parameters
    ----------
    path : Path
    half : {"accel", "gyro"}
    by_gravity : bool
        Take x, y, z whose norm stays gravity's for an accelerometer's whatever the file is called.
    """
    try:
        opening = text_head.open_text(path, ReadHints())
    except SchulerError:
        return None, ""
    fields = [] if opening.header is None else [field.strip().strip("\"'") for field in opening.header[1]]
    read = [None if column is None else column[0] for column in text_head.columns_of(opening)]
    triad, other = (columns.ACCEL, columns.GYRO) if half == "accel" else (columns.GYRO, columns.ACCEL)
    if set(triad) <= set(read) and not set(other) & set(read) and "lat" not in read:
        return None, f"its header names {', '.join(triad)}"
    if opening.header is None:
        called = [name for name, pattern in _CALLED.items() if pattern.search(path.stem)]
        t = tables.column(path, 0) if called == [half] and len(opening.fields) == 4 else None
        if t is None or len(t) < _FEWEST or not tables.is_clock(t):
            return None, ""
        feels = tables.is_gravity(path, (1, 2, 3))
        return (",".join(("t", *triad)), "it is called so") if feels == (half == "accel") else (None, "")
    bare = [re.sub(r"[^a-z].*", "", field.lower()) for field in fields]
    if "t" not in read or not {"x", "y", "z"} <= set(bare):
        return None, ""
    units = {columns.unit_in(field) for field, word in zip(fields, bare, strict=True) if word in ("x", "y", "z")}
    if len(units) != 1:
        return None, ""
    unit = next(iter(units))
    quantity = {"accel": "specific force", "gyro": "angular rate"}[half]
    if unit is not None:
        try:
            factor_for(unit, quantity)
        except SchulerError:
            return None, ""
        evidence = f"its header states {unit}"
    elif _CALLED[half].search(path.stem):
        evidence = "it is called so"
    elif by_gravity and half == "accel" and _is_gravity(path, [bare.index(axis) for axis in "xyz"]):
        evidence = "its norm stays gravity's"
    else:
        return None, ""
    names = ["-"] * len(fields)
    names[read.index("t")] = "t"
    for axis, name in zip("xyz", triad, strict=True):
        names[bare.index(axis)] = name
    return ",".join(names), evidence


def _is_gravity(path: Path, at: list[int]) -> bool:
    """Whether columns of a table long enough to tell have gravity's norm."""
    x = tables.column(path, at[0])
    return x is not None and len(x) >= _FEWEST and tables.is_gravity(path, at)
