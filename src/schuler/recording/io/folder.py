"""A folder of logs of one run: each file read with its own hints, all brought to one time base."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from schuler.exceptions import FileFormatError, InputError, SchulerError
from schuler.recording.io import dispatch, lines, rtklib, text
from schuler.recording.io.columns import check_known
from schuler.recording.io.hints import SERIES, ReadHints
from schuler.recording.recording import Recording
from schuler.recording.series import ImuSeries

#: Names of entries: the series, and the halves of an IMU whose sensors log to files of their own.
PARTS = (*SERIES, "accel", "gyro")
_SAME_TIME_S = 1e-6  # stamps of the two halves of an IMU are the same if they agree to this [s]


def read_folder(path: Path | str, parts: Mapping[str, Mapping[str, Any]] | None = None) -> Recording:
    """Read the series of one run from the files of a folder.

    Parameters
    ----------
    path : Path or str
        The folder.
    parts : mapping, optional
        For each of ``imu``, ``gnss``, ``odometer``, ``reference`` an entry ``{"file": NAME, hint: value, ...}`` (see
        :class:`ReadHints`). An IMU in two files is given as ``accel`` and ``gyro``. Without entries the folder must
        hold one file that is recognised per series.

    Returns
    -------
    Recording
        On the time base of the first entry.

    Raises
    ------
    FileFormatError, InputError
        If files are missing or ambiguous, or their clocks cannot be related.
    """
    path = Path(path)
    if not path.is_dir():
        raise FileFormatError("expected a folder", path)
    notes: tuple[str, ...] = ()
    if not parts:
        parts, ignored = _found(path)
        notes = (f"Files of the folder not read: {', '.join(ignored)}.",) if ignored else ()
    recordings = []
    for part, entry in parts.items():
        check_known(part, PARTS, "entry of a folder")
        recordings.append((part, _read_part(path, part, entry)))
    halves = {part: recording for part, recording in recordings if part in ("accel", "gyro")}
    whole = [recording for part, recording in recordings if part not in halves]
    if halves:
        whole.insert(0, _joined(path, halves))
    merged = whole[0]
    for other in whole[1:]:
        merged = merged.merged_with(other)
    metadata = replace(merged.metadata, name=path.resolve().name, notes=merged.metadata.notes + notes)
    metadata = replace(metadata, options={part: dict(entry) for part, entry in parts.items()})
    return replace(merged, metadata=metadata)


def _read_part(path: Path, part: str, entry: Mapping[str, Any]) -> Recording:
    if not isinstance(entry, Mapping) or "file" not in entry:
        raise InputError(f"{part}: expected an entry such as {{'file': 'NAME', 'units': 'g,deg/s'}}, got {entry!r}")
    given = {name: value for name, value in entry.items() if name != "file"}
    if part in ("accel", "gyro"):
        other = "no-gyro" if part == "accel" else "no-accel"
        allowed = ReadHints.of(**given).allow
        given |= {"series": "imu", "allow": [*allowed, other]}
    else:
        given.setdefault("series", part)
    file = path / str(entry["file"])
    recording = dispatch.read(file, ReadHints.of(**given))
    surplus = [name for name in SERIES if name != part and getattr(recording, name) is not None]
    if part in SERIES and surplus:
        recording = replace(
            recording,
            **dict.fromkeys(surplus),
            metadata=recording.metadata.noting(f"{file.name}: not used are its {', '.join(surplus)}."),
        )
    said = recording.metadata.notes
    notes = tuple(note if note.startswith(f"{file.name}: ") else f"{file.name}: {note}" for note in said)
    return replace(recording, metadata=replace(recording.metadata, notes=notes))


def _joined(path: Path, halves: Mapping[str, Recording]) -> Recording:
    """One IMU of an accelerometer's file and a gyro's, sample by sample."""
    if len(halves) != 2:
        missing = "gyro" if "accel" in halves else "accel"
        raise InputError(f"{path}: accel and gyro are the halves of one IMU; give {missing}={{'file': ...}} as well")
    accel, gyro = halves["accel"], halves["gyro"]
    if accel.metadata.time != gyro.metadata.time:
        gyro = gyro.shifted(gyro.metadata.time.epoch_gps_s - accel.metadata.time.epoch_gps_s)
    a, g = accel.need_imu(), gyro.need_imu()
    if len(a) != len(g) or np.abs(a.t - g.t).max() > _SAME_TIME_S or a.kind != g.kind:
        raise FileFormatError(
            f"expected accelerometer and gyro sampled together, got {len(a)} samples at {a.t[0]:.6f}..{a.t[-1]:.6f} s "
            f"and {len(g)} at {g.t[0]:.6f}..{g.t[-1]:.6f} s: interpolate one to the other's times first",
            path,
        )
    temperature = a.temperature if a.temperature is not None else g.temperature
    no_halves = [n for n in accel.metadata.notes + gyro.metadata.notes if "its values are zero" not in n]
    metadata = replace(
        accel.metadata, sources={**accel.metadata.sources, **gyro.metadata.sources}, notes=tuple(no_halves)
    )
    imu = ImuSeries(a.t, g.gyro, a.accel, a.kind, temperature)
    return Recording(imu=imu, metadata=metadata)


def _found(path: Path) -> tuple[dict[str, dict[str, Any]], list[str]]:
    """One file per series where that is all there is, and the names of the others."""
    candidates: dict[str, list[str]] = {}
    ignored = []
    for file in sorted(p for p in path.iterdir() if p.is_file() and not p.name.startswith(".")):
        series = _recognised(file)
        if series is None:
            ignored.append(file.name)
        else:
            candidates.setdefault(series, []).append(file.name)
    listing = "; ".join(f"{series}: {', '.join(names)}" for series, names in candidates.items()) or "nothing recognised"
    advice = "say which: imu={'file': 'NAME', 'units': 'g,deg/s'}, gnss={'file': 'NAME'}"
    if not candidates or any(len(names) > 1 for names in candidates.values()):
        others = f"; not recognised: {', '.join(ignored)}" if ignored else ""
        raise FileFormatError(f"expected one file per series, found {listing}{others}; {advice}", path)
    return {series: {"file": names[0]} for series, names in candidates.items()}, ignored


def _recognised(file: Path) -> str | None:
    """Series a file holds by its looks; our own Parquet files hold all of a run and are read by themselves."""
    try:
        head = lines.check_file(file)
    except SchulerError:
        return None
    if rtklib.looks_like_pos(head):
        return "gnss"
    if file.suffix.lower() in (".md", ".json", ".yaml", ".toml", ".html", ".kml", ".geojson"):
        return None
    return text.recognised_series(file)
