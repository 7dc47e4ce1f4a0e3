"""Diagnosis of files: read as told, and where the reader refuses, read again with its checks lifted or rows "
"repaired.
"""

from __future__ import annotations

import itertools
import re
import tempfile
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from schuler import units
from schuler.diagnosis.diagnose import diagnose
from schuler.diagnosis.diagnosis import Diagnosis
from schuler.diagnosis.findings import Finding
from schuler.exceptions import FileFormatError, InputError, SchulerError
from schuler.recording.io import dispatch, rtklib, text
from schuler.recording.io.assemble import recording_from
from schuler.recording.io.hints import SERIES, ReadHints
from schuler.recording.io.raw import HUGE, Raw
from schuler.recording.recording import Recording

#: Refusals that are about the numbers themselves, which the diagnosis judges better than the reader can.
LIFTED = ("norm", "magnitude", "truncated")
_LATITUDE = re.compile(r"(latitude|longitude) ([-+.\deE]+) deg is beyond")


def diagnose_log(path: Path | str, hints: ReadHints | None = None, *, quick: bool = False, **more: Any) -> Diagnosis:
    """Read a log leniently and check it, see :func:`schuler.diagnosis.diagnose`.

    Parameters
    ----------
    path : Path or str
        A file, or a folder whose files are the series of one run.
    hints : ReadHints, optional
    quick : bool
        See :func:`schuler.diagnosis.diagnose`.
    **more
        As of :func:`schuler.read`.

    Returns
    -------
    Diagnosis
        Also where the log cannot be read at all: then with the code ``unreadable``.

    Raises
    ------
    InputError
        If there is no such file, or a hint is unknown.
    """
    path = Path(path)
    recording, findings = read_leniently(path, hints, **more)
    if recording is None:
        return Diagnosis(path.stem, tuple(findings))
    return diagnose(recording, findings=tuple(findings), quick=quick)


def read_leniently(path: Path, hints: ReadHints | None = None, **more: Any) -> tuple[Recording | None, list[Finding]]:
    """A recording of whatever of a log can be read, and findings on what stood in the way.

    Parameters
    ----------
    path : Path
    hints : ReadHints, optional
    **more
        As of :func:`schuler.read`.

    Returns
    -------
    recording : Recording or None
        None if nothing could be read.
    findings : list of Finding
        ``refused``, ``duplicates``, ``backward_times``, ``missing``, ``position_unit``, ``position_order``,
        ``unreadable``.
    """
    if not path.exists():
        raise InputError(f"{path}: no such file or folder")
    try:
        return dispatch.read(path, hints, **more), []
    except SchulerError as error:
        first = error
    if path.is_dir():
        entries = {n: e for n, e in more.items() if isinstance(e, Mapping) and "file" in e}
        if not entries or any(n in ("accel", "gyro", "ephemerides") for n in entries):
            return None, [_unreadable(str(first))]
        return _folder(path, entries)
    given = hints.given() if hints is not None else {}
    recording, findings = _file(path, ReadHints.of(**{**given, **more}))
    return recording, findings


def _folder(path: Path, entries: Mapping[str, Mapping[str, Any]]) -> tuple[Recording | None, list[Finding]]:
    whole: Recording | None = None
    findings: list[Finding] = []
    for part, entry in entries.items():
        given = {name: value for name, value in entry.items() if name != "file"}
        if part in SERIES:
            given.setdefault("series", part)
        recording, found = _file(path / str(entry["file"]), ReadHints.of(**given))
        findings += [replace(f, part=part) for f in found]
        if recording is None:
            continue
        if whole is None:
            whole = recording
            continue
        try:
            whole = whole.merged_with(recording)
        except SchulerError as error:
            findings.append(Finding("no_overlap", "error", str(error), 0.9, "time=... for each file", part=part))
    if whole is not None:
        options = {part: dict(entry) for part, entry in entries.items()}
        whole = replace(whole, metadata=replace(whole.metadata, name=path.resolve().name, options=options))
    return whole, findings


def _file(path: Path, hints: ReadHints) -> tuple[Recording | None, list[Finding]]:
    """One file: as it stands, with checks lifted, with rows repaired."""
    try:
        return dispatch.read_one(path, hints), []
    except SchulerError as error:
        first = error
    message = _short(first)
    refused = Finding("refused", "note", f"the reader refuses this log: {message}", 1.0)
    loose = ReadHints.of(**{**hints.given(), "allow": sorted({*hints.allow, *LIFTED})})
    try:
        return dispatch.read_one(path, loose), [refused]
    except SchulerError as error:
        second = error
    try:
        if (place := _place(str(second), path)) is not None:
            return None, [place]
        recording, findings = _repaired(path, loose)
        return recording, [refused, *findings]
    except SchulerError:
        return None, [_unreadable(_short(second))]


def _repaired(path: Path, hints: ReadHints) -> tuple[Recording, list[Finding]]:
    """A table with rows left out that have no number or whose time does not increase."""
    with path.open("rb") as stream:
        head = stream.read(65536)
    if b"\x00" in head:
        raise FileFormatError("only text can be repaired", path)
    if path.suffix.lower() == ".pos" or rtklib.looks_like_pos(head):
        return _repaired_pos(path, hints)
    raw = text._load(text.open_text(path, hints), hints)
    findings = _without_missing(raw)
    if "t" in raw.values:
        findings += _in_order(raw)
    return recording_from(raw, hints), findings


def _without_missing(raw: Raw) -> list[Finding]:
    names = list(raw.values)
    bad = np.zeros(len(raw.values[names[0]]), dtype=bool)
    where = []
    for name in names:
        wrong = ~(np.abs(raw.values[name]) <= HUGE)
        if wrong.any():
            where.append(name)
        bad |= wrong
    if not bad.any():
        return []
    _keep(raw, ~bad)
    text_ = f"{int(bad.sum())} rows hold values that are no numbers ({', '.join(where)}); they were left out here"
    evidence = {"rows": int(bad.sum()), "columns": where}
    return [Finding("missing", "error", text_, 1.0, "fill or delete these rows", evidence)]


def _in_order(raw: Raw) -> list[Finding]:
    t = raw.values["t"]
    findings = []
    step = np.diff(t)
    same = int(np.count_nonzero(step == 0.0))
    back = np.flatnonzero(step < 0.0)
    if len(back):
        k = int(back[0])
        text_ = (
            f"time stamps go back {len(back)} times, first after {t[k]:.6f} s (to {t[k + 1]:.6f} s): rows were "
            f"swapped, two "
            "runs were joined, or a counter wrapped around"
        )
        evidence = {"times": len(back), "at_s": float(t[k]), "by_s": float(-step[k])}
        findings.append(Finding("backward_times", "error", text_, 1.0, "sort the log, or cut it there", evidence))
    order = np.argsort(t, kind="stable")
    _keep(raw, order)
    t = raw.values["t"]
    first = np.concatenate(([True], np.diff(t) > 0.0))
    again = int(np.count_nonzero(~first))
    if again:
        same = again
    if same:
        k = int(np.flatnonzero(~first)[0])
        text_ = (
            f"{same} rows repeat the time of another one, first {t[k]:.6f} s: rows were written twice, or the "
            f"clock is too "
            "coarse for the rate"
        )
        fix = "delete the repeated rows; or leave the stamps out and say rate=..."
        findings.append(Finding("duplicates", "error", text_, 1.0, fix, {"rows": same, "at_s": float(t[k])}))
    _keep(raw, first)
    return findings


def _keep(raw: Raw, rows: Any) -> None:
    raw.values = {name: values[rows] for name, values in raw.values.items()}


def _repaired_pos(path: Path, hints: ReadHints) -> tuple[Recording, list[Finding]]:
    """An RTKLIB solution with its rows sorted and repeated ones left out."""
    lines = path.read_text(encoding="latin-1").splitlines()
    head = [line for line in lines if line.startswith("%")]
    rows = [line for line in lines if line.strip() and not line.startswith("%")]
    keys = [" ".join(row.split()[:2]) for row in rows]
    order = sorted(range(len(rows)), key=lambda k: keys[k])
    findings = []
    back = sum(b < a for a, b in itertools.pairwise(keys))
    if back:
        text_ = f"the epochs of the solution go back {back} times"
        findings.append(Finding("backward_times", "error", text_, 1.0, "sort the log", {"times": back}, "gnss"))
    kept: list[int] = []
    again = 0
    for k in order:
        if kept and keys[kept[-1]] == keys[k]:
            again += 1
        else:
            kept.append(k)
    if again:
        text_ = f"{again} epochs of the solution are there twice"
        fix = "delete the repeated rows"
        findings.append(Finding("duplicates", "error", text_, 1.0, fix, {"rows": again}, "gnss"))
    with tempfile.TemporaryDirectory() as folder:
        copy = Path(folder) / path.name
        copy.write_text("\n".join([*head, *(rows[k] for k in kept)]) + "\n", encoding="latin-1")
        return dispatch.read_one(copy, hints), findings


def _place(message: str, path: Path) -> Finding | None:
    """What an impossible latitude tells."""
    found = _LATITUDE.search(message)
    if found is None:
        return None
    value = float(found.group(2))
    number = value * units.DEG
    evidence = {"value_deg": value}
    if abs(value) > 1e5 and abs(value * 1e-7) <= 180.0:
        text_ = f"{found.group(1)} {value:.6g} deg: the numbers are degrees times 10^7, as u-blox receivers write them"
        return Finding("position_unit", "error", text_, 0.95, "scale='lat=1e-7,lon=1e-7'", evidence, "gnss")
    if abs(value) > 360.0 and abs(number) <= 360.0:
        text_ = f"{found.group(1)} {value:.6g} deg: the numbers are degrees and were read as radians"
        return Finding("position_unit", "error", text_, 0.9, "units='angle=deg'", evidence, "gnss")
    if found.group(1) == "latitude" and abs(value) <= 180.0:
        text_ = f"a latitude of {value:.6g} deg is none: latitude and longitude are exchanged"
        fix = "columns='...,lon,lat,...' exchanged"
        return Finding("position_order", "error", text_, 0.95, fix, evidence, "gnss")
    return Finding("position_unit", "error", _clean(message), 0.6, "units='angle=...'", evidence, "gnss")


def _unreadable(message: str) -> Finding:
    return Finding("unreadable", "error", _clean(message), 1.0, part="log")


def _short(error: SchulerError) -> str:
    return _clean(str(error))


def _clean(message: str) -> str:
    return " ".join(message.split())
