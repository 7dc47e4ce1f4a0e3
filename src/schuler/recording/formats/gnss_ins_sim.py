"""Folders of gnss-ins-sim: ``time.csv``, ``accel-0.csv``, ``gyro-0.csv``, ``ref_*.csv``, one table a quantity.

Headers state units in brackets. The body is forward-right-down, the navigation frame north-east-down
(Aceinna, gnss-ins-sim, ``ref_frame=0``).
"""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np

from schuler import units
from schuler.arrays import FloatArray
from schuler.exceptions import FileFormatError, InputError
from schuler.recording.io import lines, parts, plain_text
from schuler.recording.io.hint_texts import parse_streams
from schuler.recording.io.hints import ReadHints
from schuler.recording.io.parts import Table
from schuler.recording.io.streams import Stream
from schuler.recording.recording import Recording
from schuler.timebase import TimeBase

_HINTS = parts.GNSS_HINTS | {"streams"}
_FIELD = re.compile(r"\s*([A-Za-z0-9_]+)\s*(?:\(([^()]*)\))?\s*")


def sniff(head: bytes, path: Path) -> bool:
    """No file is the whole; its tables have headers that the reader of text knows."""
    return False


def sniff_folder(path: Path) -> bool:
    """Whether a folder has times, and specific forces and rates of at least one run."""
    return (path / "time.csv").is_file() and bool(_runs(path))


def contents(path: Path) -> list[Stream]:
    """The runs, for ``schuler info``."""
    return [Stream(str(run), "accel, gyro", 1, part="imu") for run in _runs(path)]


def read(path: Path, hints: ReadHints) -> Recording:
    """IMU, fixes and reference of one run.

    Parameters
    ----------
    path : Path
    hints : ReadHints
        ``streams="imu=2"`` for the run accel-2, gyro-2, gps-2 (default the first); ``sigma`` for the fixes, which have
        no accuracies and are left out without it.

    Raises
    ------
    FileFormatError
        With the file, for what is missing, malformed or of another length than the times.
    """
    parts.check_hints(path, hints, _HINTS, "a folder of gnss-ins-sim")
    if not path.is_dir() or not sniff_folder(path):
        raise FileFormatError("expected a folder with time.csv, accel-0.csv and gyro-0.csv", path)
    runs = _runs(path)
    notes: list[str] = []
    requested = parse_streams(hints.streams).get("imu", str(runs[0]))
    if requested is None or requested not in [str(run) for run in runs]:
        raise InputError(f"{path}: streams: expected imu=N with N of {', '.join(map(str, runs))}, got {requested!r}")
    notes.append(f"Run {requested} of {len(runs)} ({', '.join(map(str, runs))}).")
    sources = [path / "time.csv", path / f"accel-{requested}.csv", path / f"gyro-{requested}.csv"]
    (t,) = _columns(sources[0], ("time",), "s", hints, notes)
    n = len(t)
    f = _columns(sources[1], ("accel_x", "accel_y", "accel_z"), "m/s^2", hints, notes, n)
    w = _columns(sources[2], ("gyro_x", "gyro_y", "gyro_z"), "rad/s", hints, notes, n)
    tables = {"imu": Table({"t": t, **dict(zip(("ax", "ay", "az", "gx", "gy", "gz"), (*f, *w), strict=True))})}
    if (reference := _reference(path, t, hints, notes, sources)) is not None:
        tables["reference"] = reference
    gps, gps_time = path / f"gps-{requested}.csv", path / "gps_time.csv"
    if gps.is_file() and gps_time.is_file():
        if hints.sigma is None:
            notes.append("The fixes have no accuracies and were left out: hint sigma, 'N,E,D,VN,VE,VD'.")
        else:
            sources += [gps, gps_time]
            (t_fix,) = _columns(gps_time, ("gps_time",), "s", hints, notes)
            place = _columns(gps, ("gps_lat", "gps_lon"), "rad", hints, notes, len(t_fix))
            h = _columns(gps, ("gps_alt",), "m", hints, notes, len(t_fix))
            v = _columns(gps, ("gps_vN", "gps_vE", "gps_vD"), "m/s", hints, notes, len(t_fix))
            names = ("lat", "lon", "h", "vn", "ve", "vd")
            tables["gnss"] = Table({"t": t_fix, **dict(zip(names, (*place, *h, *v), strict=True))})
    return parts.assemble(path, tables, hints, TimeBase("local"), notes, sources)


def _runs(path: Path) -> list[int]:
    matches = (re.fullmatch(r"accel-(\d{1,6})\.csv", p.name) for p in path.glob("accel-*.csv"))
    return sorted(int(m[1]) for m in matches if m is not None and (path / f"gyro-{m[1]}.csv").is_file())


def _reference(path: Path, t: FloatArray, hints: ReadHints, notes: list[str], sources: list[Path]) -> Table | None:
    files = {name: path / f"ref_{name}.csv" for name in ("pos", "vel", "att_euler")}
    if not files["pos"].is_file():
        return None
    if "ref_pos_lat" not in _header(files["pos"]):
        notes.append("The reference is in a frame of its own (ref_frame=1), not on the Earth, and was left out.")
        return None
    n = len(t)
    sources.append(files["pos"])
    place = _columns(files["pos"], ("ref_pos_lat", "ref_pos_lon"), "rad", hints, notes, n)
    (h,) = _columns(files["pos"], ("ref_pos_alt",), "m", hints, notes, n)
    values = {"t": t, "lat": place[0], "lon": place[1], "h": h}
    if files["vel"].is_file():
        sources.append(files["vel"])
        v = _columns(files["vel"], ("ref_vel_x", "ref_vel_y", "ref_vel_z"), "m/s", hints, notes, n)
        values |= dict(zip(("vn", "ve", "vd"), v, strict=True))
    if files["att_euler"].is_file():
        sources.append(files["att_euler"])
        angles = _columns(files["att_euler"], ("ref_Roll", "ref_Pitch", "ref_Yaw"), "rad", hints, notes, n)
        values |= dict(zip(("roll", "pitch", "yaw"), angles, strict=True))
    return Table(values)


def _header(path: Path) -> dict[str, tuple[int, str | None]]:
    """Position and unit of each column by its name."""
    first = lines.check_file(path).split(b"\n")[0].decode("latin-1")
    fields = (_FIELD.fullmatch(field) for field in first.split(","))
    return {m[1]: (k, m[2] or None) for k, m in enumerate(fields) if m is not None}


def _columns(
    path: Path, names: tuple[str, ...], unit: str, hints: ReadHints, notes: list[str], n: int | None = None
) -> list[FloatArray]:
    """Columns of a table in an SI unit, ``n`` long if that is known."""
    header = _header(path)
    if missing := [name for name in names if name not in header]:
        raise FileFormatError(f"expected the header {', '.join(names)}, {', '.join(missing)} missing", path, 1)
    table = plain_text.open_table(path, range(1, 100), ", ".join(header), delimiter=",")
    width = plain_text.width(table)
    rows = plain_text.load(table, width, allow_truncated=hints.allows("truncated"), notes=notes)
    if n is not None and len(rows) != n:
        raise FileFormatError(f"expected {n} rows, as many as there are times, got {len(rows)}", path)
    quantity = {"s": "time", "m/s^2": "specific force", "rad/s": "angular rate", "rad": "angle", "m": "length"}
    tables = []
    for name in names:
        k, stated = header[name]
        if k >= width:
            raise FileFormatError(f"the header names {name} beyond the {width} columns of the rows", path, 1)
        stated = {"sec": "s"}.get(stated or unit, stated or unit)
        tables.append(rows[:, k] * units.factor_for(stated, quantity.get(unit, "velocity")))
    return [np.ascontiguousarray(column) for column in tables]
