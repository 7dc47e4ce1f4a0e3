"""A folder of logs of one run: each file read with its own hints, all brought to one time base."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from schuler import files
from schuler.exceptions import FileFormatError, InputError, SchulerError
from schuler.recording.formats import registry, rtklib, text
from schuler.recording.io import columns, dispatch, lines, packed, streams
from schuler.recording.io.columns import check_known
from schuler.recording.io.hint_texts import SATELLITES, SAY_WHICH, SERIES
from schuler.recording.io.hints import ReadHints
from schuler.recording.io.satellite_files import channels_of, kinds_of
from schuler.recording.recording import Recording
from schuler.recording.series import ImuSeries

#: Names of entries: the series, and the halves of an IMU whose sensors log to files of their own.
PARTS = (*SERIES, *SATELLITES, "accel", "gyro")
_FEW = 50  # files of a run that lie in folders of their own
_SAME_TIME_S = 1e-6  # stamps of the two halves of an IMU are the same if they agree to this [s]


def read_folder(path: Path | str, parts: Mapping[str, Mapping[str, Any]] | None = None) -> Recording:
    """Read the series of one run from the files of a folder.

    Parameters
    ----------
    path : Path or str
        The folder, or a file that holds several tables (:mod:`schuler.recording.io.packed`).
    parts : mapping, optional
        For each of ``imu``, ``gnss``, ``odometer``, ``reference``, ``observations``, ``ephemerides`` an entry
        ``{"file": NAME, hint: value, ...}`` (see :class:`ReadHints`). An IMU in two files is given as ``accel`` and
        ``gyro``; ephemerides may be in several, ``{"file": [NAME, NAME]}``. Without entries the folder must hold one
        file that is recognised per series, or several of ephemerides.

    Returns
    -------
    Recording
        On the time base of the first entry (ephemerides aside). An entry takes its own series out of a file that holds
        several; ``observations`` takes the ephemerides too, if they have no entry.

    Raises
    ------
    FileFormatError, InputError
        If files are missing or ambiguous, or their clocks cannot be related.
    """
    path = Path(path)
    if not path.is_dir() and not packed.tables(path):
        raise FileFormatError("expected a folder", path)
    notes: tuple[str, ...] = ()
    if not parts:
        parts, ignored = _found(path)
        notes = (f"Files of the folder not read: {', '.join(ignored)}.",) if ignored else ()
    for part in parts:
        check_known(part, PARTS, "entry of a folder")
    # ephemerides come first, since observations need GLONASS channels of them, and are merged last: they have no times
    broadcast = _ephemerides(path, parts["ephemerides"]) if "ephemerides" in parts else None
    channels = channels_of(broadcast)
    recordings = [
        (part, _read_part(path, part, entry, broadcast is None, channels))
        for part, entry in parts.items()
        if part != "ephemerides"
    ]
    if broadcast is not None:
        recordings.append(("ephemerides", broadcast))
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


def read_packed(path: Path, given: Mapping[str, Any]) -> Recording:
    """Read a file that holds several tables; hints that name no part are of its IMU, or of the one part it has.

    Parameters
    ----------
    path : Path
    given : mapping
        Entries by part as of :func:`read_folder`, and hints.

    Raises
    ------
    FileFormatError, InputError
        As :func:`read_folder`.
    """
    parts, hints = parted(given)
    entries = {part: dict(entry) for part, entry in (parts or _found(path)[0]).items()}
    meant = [part for part in ("imu", "accel", "gyro") if part in entries] or list(entries)[:1]
    for part in meant:
        entries[part] = hints | entries[part]
    return read_folder(path, entries)


def parted(given: Mapping[str, Any]) -> tuple[dict[str, Any], dict[str, Any]]:
    """Entries of parts, and hints that are of none, of a section ``[recording]``.

    Parameters
    ----------
    given : mapping
    """
    parts = {name: x for name, x in given.items() if isinstance(x, Mapping) and name not in ("streams", "scale")}
    return parts, {name: x for name, x in given.items() if name not in parts}


def _ephemerides(path: Path, entry: Mapping[str, Any]) -> Recording:
    """Ephemerides of one file or several, of which the first with a constant (ionosphere, leap seconds) counts."""
    files = entry.get("file") if isinstance(entry, Mapping) else None
    names = [files] if not isinstance(files, list | tuple) else list(files)
    if not names:
        raise InputError("ephemerides: expected the name of a file or a list of them, got an empty list")
    parts = [_read_part(path, "ephemerides", entry if files is None else {**entry, "file": name}) for name in names]
    merged = parts[0]
    for other in parts[1:]:
        merged = merged.merged_with(other)
    return merged


def _read_part(
    path: Path,
    part: str,
    entry: Mapping[str, Any],
    with_ephemerides: bool = False,
    glonass_channels: Mapping[int, int] | None = None,
) -> Recording:
    """Part that an entry names, out of its file; ``with_ephemerides`` for observations that bring their own."""
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
    recording = _read_file(file, ReadHints.of(**given), glonass_channels)
    kept_parts = {part, "ephemerides"} if part == "observations" and with_ephemerides else {part}
    surplus = [n for n in (*SERIES, *SATELLITES) if n not in kept_parts and getattr(recording, n) is not None]
    if part not in ("accel", "gyro") and surplus:
        recording = replace(
            recording,
            **dict.fromkeys(surplus),
            metadata=recording.metadata.noting(f"{file.name}: not used are its {', '.join(surplus)}."),
        )
    file_notes = recording.metadata.notes
    notes = tuple(note if note.startswith(f"{file.name}: ") else f"{file.name}: {note}" for note in file_notes)
    return replace(recording, metadata=replace(recording.metadata, notes=notes))


def _read_file(file: Path, hints: ReadHints, glonass_channels: Mapping[int, int] | None) -> Recording:
    """A file, or a table of a file that holds several, whose notes and sources are that file's."""
    table = packed.resolved(file)
    if table == file:
        return dispatch.read_one(file, hints, glonass_channels)
    try:
        recording = dispatch.read_one(table, hints)
    except SchulerError as error:
        raise type(error)(str(error).replace(str(table), str(file))) from error
    note = packed.note_on(file)
    metadata = recording.metadata.noting(*([note] if note else []))
    return replace(recording, metadata=replace(metadata, sources={file.parent.name: files.sha256(file.parent)}))


def _joined(path: Path, halves: Mapping[str, Recording]) -> Recording:
    """One IMU of an accelerometer's file and a gyro's, sample by sample or interpolated to the gyro's times."""
    if len(halves) != 2:
        missing = "gyro" if "accel" in halves else "accel"
        raise InputError(f"{path}: accel and gyro are the halves of one IMU; give {missing}={{'file': ...}} as well")
    accel, gyro = halves["accel"], halves["gyro"]
    if accel.metadata.time != gyro.metadata.time:
        gyro = gyro.shifted(gyro.metadata.time.epoch_gps_s - accel.metadata.time.epoch_gps_s)
    a, g = accel.need_imu(), gyro.need_imu()
    same = len(a) == len(g) and np.abs(a.t - g.t).max() <= _SAME_TIME_S
    if a.kind != g.kind or (a.kind == "increment" and not same):
        raise FileFormatError(
            f"expected accelerometer and gyro of one kind, increments at the same times, got {len(a)} samples "
            f"({a.kind}) at {a.t[0]:.6f}..{a.t[-1]:.6f} s and {len(g)} ({g.kind}) at {g.t[0]:.6f}..{g.t[-1]:.6f} s",
            path,
        )
    notes: list[str] = []
    values = {"t": a.t} if same else streams.joined(a.t, a.accel, g.t, g.gyro, path, notes)
    t = values["t"]
    accels, rates = (
        (a.accel, g.gyro)
        if same
        else (np.stack([values[name] for name in names], axis=1) for names in (columns.ACCEL, columns.GYRO))
    )
    half = a if a.temperature is not None else g
    temperature = half.temperature if half.temperature is None or same else np.interp(t, half.t, half.temperature)
    magnetometer = next((x.magnetometer for x in (a, g) if x.magnetometer is not None), None) if same else None
    no_halves = [n for n in accel.metadata.notes + gyro.metadata.notes if "its values are zero" not in n]
    metadata = replace(
        accel.metadata, sources={**accel.metadata.sources, **gyro.metadata.sources}, notes=(*no_halves, *notes)
    )
    imu = ImuSeries(t, rates, accels, a.kind, temperature, magnetometer)
    return Recording(imu=imu, metadata=metadata)


def _found(path: Path) -> tuple[dict[str, dict[str, Any]], list[str]]:
    """One file per series where that is all there is, and the names of the others."""
    candidates: dict[str, list[str]] = {}
    ignored = []
    for name in names_in(path):
        held = recognised(packed.resolved(path / name))
        for series in held:
            candidates.setdefault(series, []).append(name)
        if not held:
            ignored.append(name)
    listing = "; ".join(f"{series}: {', '.join(names)}" for series, names in candidates.items()) or "nothing recognised"
    advice = f"{SAY_WHICH}imu={{'file': 'NAME', 'units': 'g,deg/s'}}, gnss={{'file': 'NAME'}}"
    if not candidates or any(len(names) > 1 for series, names in candidates.items() if series != "ephemerides"):
        others = f"; not recognised: {listed(ignored)}" if ignored else ""
        inside = "" if candidates else folders_in(path)
        raise FileFormatError(f"expected one file per series, found {listing}{others}; {inside or advice}", path)
    return {series: {"file": names if len(names) > 1 else names[0]} for series, names in candidates.items()}, ignored


def names_in(path: Path) -> list[str]:
    """Files of a folder, or the tables of a file that holds several; those of such a file of a folder beside it.

    Parameters
    ----------
    path : Path
    """
    if path.is_file():
        return list(packed.tables(path))
    entries = [p for p in sorted(path.iterdir()) if not p.name.startswith(".")]
    if len(entries) == 1 and entries[0].is_dir() and registry.find_folder(entries[0]) is None:
        return [f"{entries[0].name}/{name}" for name in names_in(entries[0])]  # a recorder's folder of the one run
    if entries and all(map(Path.is_dir, entries)):
        return _of_one_run(path, entries)
    names = []
    for file in filter(Path.is_file, entries):
        try:
            names += [f"{file.name}/{table}" for table in packed.tables(file)] or [file.name]
        except FileFormatError:  # it may be none of the run's
            names.append(file.name)
    return names


def _of_one_run(path: Path, folders: Sequence[Path]) -> list[str]:
    """Files of folders that hold a sensor each, ``imu_logs`` beside ``gps_logs``; none if each may be a run."""
    if any(registry.find_folder(folder) is not None for folder in folders):
        return []
    names = [f"{folder.name}/{name}" for folder in folders for name in names_in(folder)]
    if len(names) > _FEW:
        return []
    held = [recognised(packed.resolved(path / name)) for name in names]
    return names if sum("imu" in parts for parts in held) == 1 and len(held) > 1 else []


def folders_in(path: Path) -> str:
    """Advice to give one of the folders in a folder that has no readable files of its own; empty if it has none.

    Parameters
    ----------
    path : Path
    """
    names = sorted(
        p.name for p in (path.iterdir() if path.is_dir() else ()) if p.is_dir() and not p.name.startswith(".")
    )
    return f"give one of the folders in it: {listed(names)}" if names else ""


def listed(names: Sequence[str]) -> str:
    """The first eight of some names, in a sentence."""
    return ", ".join(names[:8]) + (", ..." if len(names) > 8 else "")


def recognised(file: Path) -> tuple[str, ...]:
    """Series a file holds by its looks; our own Parquet files hold all of a run and are read by themselves."""
    try:
        head = lines.check_file(file)
    except SchulerError:
        return ()
    if (held := registry.held_by(head, file)) is not None:
        return held
    if received := kinds_of(file, head):
        return received
    if rtklib.looks_like_pos(head):
        return ("gnss",)
    if file.suffix.lower() in (".md", ".json", ".yaml", ".toml", ".html", ".kml", ".geojson"):
        return ()
    return text.recognised_series(file)
