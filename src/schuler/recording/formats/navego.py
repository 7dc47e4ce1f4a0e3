"""MATLAB structures of NaveGo: ``imu`` (t, fb, wb), ``gnss`` (t, lat, lon, h, vel, stdm, stdv), ``ref``.

Units are SI and radians, the body is forward-right-down, velocities are north, east, down. By the comments in NaveGo's
examples (Gonzalez et al., NaveGo: a simulation framework for low-cost integrated navigation systems, CEAI 17(2), 2015).
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from schuler.arrays import FloatArray
from schuler.exceptions import FileFormatError
from schuler.recording.formats import matlab
from schuler.recording.formats.matlab import variables
from schuler.recording.io import parts
from schuler.recording.io.clock import stamps
from schuler.recording.io.hint_texts import parse_streams
from schuler.recording.io.hints import ReadHints
from schuler.recording.io.parts import Table
from schuler.recording.io.streams import Stream, choose, stream_of
from schuler.recording.recording import Recording

_HINTS = parts.GNSS_HINTS | {"axes", "time", "streams"}
_PLACE = {"t", "lat", "lon", "h"}
_EULER = ("roll", "pitch", "yaw")


def sniff(head: bytes, path: Path) -> bool:
    """Whether a MATLAB file has structures with the fields of NaveGo."""
    return head.startswith(b"MATLAB 5.0") and bool(_streams(path))


def holds(path: Path) -> tuple[str, ...]:
    """Series of the structures."""
    return tuple(dict.fromkeys(stream.part for stream in _streams(path)))


def contents(path: Path) -> list[Stream]:
    """The structures of a file with their times, for ``schuler info``."""
    streams = _streams(path)
    values = matlab.load(path, [stream.name for stream in streams])
    return [
        stream_of(s.name, s.kind, matlab.vector(values[s.name]["t"], f"{s.name}.t", path), s.part)
        for s in streams
        if isinstance(values.get(s.name), dict) and "t" in values[s.name]
    ]


def read(path: Path, hints: ReadHints) -> Recording:
    """IMU, fixes and reference of the structures of a file.

    Parameters
    ----------
    path : Path
    hints : ReadHints
        ``streams="imu=imu2,reference=none"`` where several structures could be one part (a ``ref`` is preferred to
        navigation results); ``time`` if the times are GPS times; ``sigma`` if the fixes have no ``stdm``; ``axes``.

    Raises
    ------
    FileFormatError
        If a field is missing or of the wrong size.
    InputError
        If several structures could be meant.
    """
    if (described := matlab.as_arrays(path, hints)) is not None:
        return described
    parts.check_hints(path, hints, _HINTS, "a NaveGo file")
    streams = _streams(path)
    if not streams:
        raise FileFormatError("expected structures with the fields t, fb, wb, or t, lat, lon, h", path)
    chosen = parse_streams(hints.streams)
    taken = {}
    for part in ("imu", "gnss", "reference"):
        candidates = streams
        if part == "reference" and part not in chosen and any(s.name == "ref" for s in streams):
            candidates = [s for s in streams if s.name == "ref"]
        if (stream := choose(candidates, part, chosen)) is not None:
            taken[part] = stream.name
    values = matlab.load(path, taken.values())
    notes = [f"Structures of NaveGo: {', '.join(f'{name} as {part}' for part, name in taken.items())}."]

    def fault(message: str, row: int | None) -> FileFormatError:
        return FileFormatError(message if row is None else f"sample {row + 1}: {message}", path)

    tables, base = {}, None
    for part, name in taken.items():
        fields = values.get(name)
        needed = {"imu": ("t", "fb", "wb"), "gnss": ("t", *_PLACE), "reference": ("t", *_PLACE, *_EULER)}[part]
        if not isinstance(fields, dict) or not fields.keys() >= set(needed):
            raise FileFormatError(f"{name}: expected one structure with the fields {', '.join(needed)}", path)
        time_notes: list[str] = []
        t, own_base = stamps(matlab.vector(fields["t"], f"{name}.t", path), hints.time, fault, time_notes)
        base = base or own_base
        t = t + (own_base.epoch_gps_s - base.epoch_gps_s)
        notes += [note for note in time_notes if note not in notes]
        keep = parts.later(t, name, path, notes)
        columns = _imu(fields, name, len(t), path) if part == "imu" else _place(fields, name, len(t), path, part)
        tables[part] = Table({"t": t[keep]} | {key: column[keep] for key, column in columns.items()})
    assert base is not None
    return parts.assemble(path, tables, hints, base, notes)


def _streams(path: Path) -> list[Stream]:
    streams = []
    for name, variable in variables(path).items():
        fields = set(variable.fields)
        part = ""
        if fields >= {"t", "fb", "wb"}:
            part = "imu"
        elif fields >= {*_PLACE, *_EULER}:
            part = "reference"
        elif fields >= {*_PLACE, "vel"} or fields >= {*_PLACE, "stdm"}:
            part = "gnss"
        if part:
            streams.append(Stream(name, f"struct ({', '.join(variable.fields)})", 1, part=part))
    return streams


def _imu(fields: dict[str, Any], name: str, n: int, path: Path) -> dict[str, FloatArray]:
    f = matlab.matrix(fields["fb"], f"{name}.fb", path, (3,), n)
    w = matlab.matrix(fields["wb"], f"{name}.wb", path, (3,), n)
    return dict(zip(("ax", "ay", "az", "gx", "gy", "gz"), np.column_stack((f, w)).T, strict=True))


def _place(fields: dict[str, Any], name: str, n: int, path: Path, part: str) -> dict[str, FloatArray]:
    values = {key: matlab.vector(fields[key], f"{name}.{key}", path, n) for key in ("lat", "lon", "h")}
    if "vel" in fields and np.size(fields["vel"]):
        v = matlab.matrix(fields["vel"], f"{name}.vel", path, (3,), n)
        values |= dict(zip(("vn", "ve", "vd"), v.T, strict=True))
    if part == "reference":
        values |= {key: matlab.vector(fields[key], f"{name}.{key}", path, n) for key in _EULER}
        return values
    for key, columns in (("stdm", ("sn", "se", "sd")), ("stdv", ("svn", "sve", "svd"))):
        if key in fields and (key != "stdv" or "vn" in values):
            sigma = matlab.vector(fields[key], f"{name}.{key}", path, 3)
            values |= {column: np.full(n, value) for column, value in zip(columns, sigma, strict=True)}
    return values
