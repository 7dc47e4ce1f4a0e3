"""MATLAB files of PSINS: ``trj`` (a generated trajectory) or matrices ``imu``, ``avp``, ``gps``.

``imu`` has increments of angle [rad] and velocity [m/s] and the time, axes right-forward-up; ``avp`` pitch, roll, yaw
(from north over west), velocity east, north, up, latitude, longitude [rad], height, time; ``gps`` velocity, position,
time, or without velocity. By the functions trjsimu, avpfile and gpssimu of PSINS (Yan Gongmin).
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from schuler.arrays import FloatArray
from schuler.exceptions import FileFormatError
from schuler.recording.formats import mat_tables, parts
from schuler.recording.formats.mat_peek import variables
from schuler.recording.formats.parts import Table
from schuler.recording.io.clock import stamps
from schuler.recording.io.hints import ReadHints
from schuler.recording.recording import Recording

_HINTS = parts.GNSS_HINTS | {"axes", "time"}
_WIDTHS = {"imu": (7,), "avp": (10,), "gps": (4, 7)}
_PARTS = {"imu": "imu", "avp": "reference", "gps": "gnss"}


def sniff(head: bytes, path: Path) -> bool:
    """Whether a MATLAB file has a ``trj``, or ``imu`` and ``avp`` with 7 and 10 columns."""
    if not head.startswith(b"MATLAB 5.0"):
        return False
    found = variables(path)
    if "trj" in found:
        return {"imu", "avp"} <= set(found["trj"].fields)
    return all(name in found and found[name].shape[-1] in _WIDTHS[name] for name in ("imu", "avp"))


def holds(path: Path) -> tuple[str, ...]:
    """Series of the matrices."""
    found = variables(path)
    if "trj" in found:
        return tuple(_PARTS[name] for name in ("imu", "avp") if name in found["trj"].fields)
    return tuple(part for name, part in _PARTS.items() if name in found)


def read(path: Path, hints: ReadHints) -> Recording:
    """IMU increments, reference and fixes of a file.

    Parameters
    ----------
    path : Path
    hints : ReadHints
        ``sigma`` for ``gps``, which has no accuracies (without it fixes are left out beside other series); ``axes`` of
        the IMU other than right-forward-up; ``time``.

    Raises
    ------
    FileFormatError
        If there is none of these matrices, or one has the wrong size.
    """
    if (described := mat_tables.as_arrays(path, hints)) is not None:
        return described
    parts.check_hints(path, hints, _HINTS, "a PSINS file")
    values: dict[str, Any] = mat_tables.load(path, ("trj", *_WIDTHS))
    notes: list[str] = []
    if isinstance(values.get("trj"), dict):
        values = values["trj"]
    found = {name: mat_tables.matrix(values[name], name, path, w) for name, w in _WIDTHS.items() if name in values}
    if not found:
        raise FileFormatError("expected a structure trj, or matrices imu, avp or gps", path)
    if "gps" in found and hints.sigma is None and len(found) > 1:
        del found["gps"]
        notes.append("The fixes (gps) come without an accuracy and were left out: hint sigma.")

    def fault(message: str, row: int | None) -> FileFormatError:
        return FileFormatError(message if row is None else f"row {row + 1}: {message}", path)

    tables, base = {}, None
    for name, rows in found.items():
        said: list[str] = []
        t, made = stamps(rows[:, -1].copy(), hints.time, fault, said)
        base = base or made
        t = t + (made.epoch_gps_s - base.epoch_gps_s)
        notes += [note for note in said if note not in notes]
        keep = parts.later(t, name, path, notes)
        tables[_PARTS[name]] = _table(name, t[keep], rows[keep])
    assert base is not None
    return parts.assemble(path, tables, hints, base, notes)


def _table(name: str, t: FloatArray, rows: FloatArray) -> Table:
    if name == "imu":
        columns = dict(zip(("gx", "gy", "gz", "ax", "ay", "az"), rows[:, :6].T, strict=True))
        return Table({"t": t, **columns}, axes="RFU", kind="increment")
    place = dict(zip(("lat", "lon", "h"), rows[:, -4:-1].T, strict=True))
    values = {"t": t, **place}
    if rows.shape[1] >= 7:
        ve, vn, vu = rows[:, -7:-4].T
        values |= {"vn": vn, "ve": ve, "vd": -vu}
    if name == "avp":
        values |= {"roll": rows[:, 1], "pitch": rows[:, 0], "yaw": -rows[:, 2]}
    return Table({key: np.ascontiguousarray(value) for key, value in values.items()})
