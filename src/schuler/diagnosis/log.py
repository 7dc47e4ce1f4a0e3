"""Diagnosis of files: read with the given hints, and where the reader refuses, with checks lifted or rows repaired."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from schuler import units
from schuler.diagnosis.repair import repaired
from schuler.diagnosis.result import Diagnosis, Finding, joined
from schuler.diagnosis.run import diagnose
from schuler.diagnosis.unrelated_clocks import relate_clocks, unknown_clock
from schuler.exceptions import SchulerError
from schuler.files import check_log
from schuler.recording.io import dispatch, folder, packed
from schuler.recording.io.hint_texts import SERIES
from schuler.recording.io.hints import ReadHints
from schuler.recording.io.lines import is_binary
from schuler.recording.recording import Recording

#: Refusals that are about the numbers themselves, which the diagnosis judges better than the reader can.
LIFTED = ("norm", "magnitude", "truncated")
_LATITUDE = re.compile(r"(latitude|longitude) ([-+.\deE]+) deg is beyond")
_MAGIC = {
    b"\x1f\x8b": "compressed (gzip): unpack it",
    b"\x89PNG": "a picture",
    b"\xff\xd8\xff": "a picture",
    b"%PDF": "a PDF document",
    b"TIMETAG RTKLIB": "RTKLIB's time tags of another file: give that one, its name without .tag",
}
_DOCUMENTS = (".md", ".rst", ".html")
_WORD = re.compile(r"[A-Za-z]{2,}")
_NUMBER = re.compile(r"[-+]?\d+\.?\d*(e[-+]?\d+)?$", re.IGNORECASE)
_MOST = 65536


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
        Hints, see :func:`schuler.read`.

    Returns
    -------
    Diagnosis
        Also where the log cannot be read at all: then with the code ``unreadable``. Where the clocks of a folder's
        files are not stated (``clock_unknown``), the IMU is judged on the clock that the motion of both tells, else
        by itself.

    Raises
    ------
    InputError
        If there is no such file, or a hint is unknown.
    """
    path = Path(path)
    recording, alone, findings = read_leniently(path, hints, **more)
    if recording is None:
        return Diagnosis(path.stem, tuple(findings))
    if alone is None:
        return diagnose(recording, findings=tuple(findings), quick=quick)
    problems = relate_clocks(recording, alone)
    if problems is not None:
        merged, question = problems
        return diagnose(merged, findings=(*findings, question), quick=quick)
    parts = (diagnose(recording, quick=quick), diagnose(alone, quick=quick))
    return joined(recording.metadata.name, parts, (*findings, unknown_clock(recording, alone)))


def read_leniently(
    path: Path, hints: ReadHints | None = None, **more: Any
) -> tuple[Recording | None, Recording | None, list[Finding]]:
    """A recording of whatever of a log can be read, and findings on what stood in the way.

    Parameters
    ----------
    path : Path
    hints : ReadHints, optional
    **more
        Hints, see :func:`schuler.read`.

    Returns
    -------
    recording : Recording or None
        None if nothing could be read.
    alone : Recording or None
        The IMU of a folder, if it runs on a clock of its own that nothing was said of.
    findings : list of Finding
        ``refused``, ``duplicates``, ``backward_times``, ``missing``, ``position_unit``, ``position_order``,
        ``unreadable``.
    """
    check_log(path)
    try:
        return dispatch.read(path, hints, **more), None, []
    except SchulerError as error:
        first = error
    if path.is_dir():
        entries = {n: e for n, e in more.items() if isinstance(e, Mapping) and "file" in e}
        if not entries and not more:
            try:
                entries = dict(folder._found(path)[0])
            except SchulerError:
                entries = {}
        if not entries or any(n in ("accel", "gyro", "ephemerides") for n in entries):
            return None, None, [_unreadable(str(first))]
        return _folder(path, entries)
    given = hints.given() if hints is not None else {}
    recording, findings = _file(path, ReadHints.of(**{**given, **more}))
    return recording, None, findings


def _folder(
    path: Path, entries: Mapping[str, Mapping[str, Any]]
) -> tuple[Recording | None, Recording | None, list[Finding]]:
    findings: list[Finding] = []
    read: list[tuple[str, Recording]] = []
    for part, entry in entries.items():
        given = {name: value for name, value in entry.items() if name != "file"}
        if part in SERIES:
            given.setdefault("series", part)
        recording, problems = _file(packed.resolved(path / str(entry["file"])), ReadHints.of(**given))
        findings += [replace(f, part=part) for f in problems]
        if recording is not None:
            read.append((part, recording))
    # those on a clock that is known first: the others may be brought to it
    read.sort(key=lambda item: item[1].metadata.time.scale == "local")
    merged: Recording | None = None
    alone: Recording | None = None
    for part, recording in read:
        if merged is None:
            merged = recording
            continue
        try:
            merged = merged.merged_with(recording)
        except SchulerError as error:
            clocks = merged.metadata.time.scale != recording.metadata.time.scale
            if clocks and part == "imu" and recording.imu is not None:
                alone = recording
                continue
            code = "clock_unknown" if clocks else "no_overlap"
            findings.append(Finding(code, "error", str(error), 0.99, "time=... for each file", part=part))
    options = {part: dict(entry) for part, entry in entries.items()}

    def labelled(recording: Recording | None) -> Recording | None:
        if recording is None:
            return None
        return replace(recording, metadata=replace(recording.metadata, name=path.resolve().name, options=options))

    return labelled(merged), labelled(alone), findings


def _file(path: Path, hints: ReadHints) -> tuple[Recording | None, list[Finding]]:
    """One file: as it stands, with checks lifted, with rows repaired, with positions as they must be meant."""
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
        if (place := _place(str(second))) is not None:
            mended = _mended(loose, place)
            try:
                return (None if mended is None else dispatch.read_one(path, mended)), [refused, place]
            except SchulerError:
                return None, [refused, place]
        recording, findings = repaired(path, loose)
        return recording, [refused, *findings]
    except SchulerError:
        what = not_a_log(path)
        return None, [_unreadable(_short(second) if what is None else f"{path}: this is no log but {what}")]


def _place(message: str) -> Finding | None:
    """Finding on an impossible latitude or longitude in a reader's message."""
    problems = _LATITUDE.search(message)
    if problems is None:
        return None
    value = float(problems.group(2))
    number = value * units.DEG
    evidence = {"value_deg": value}
    if abs(value) > 1e5 and abs(value * 1e-7) <= 180.0:
        text_ = (
            f"{problems.group(1)} {value:.6g} deg: the numbers are degrees times 10^7, as u-blox receivers write them"
        )
        return Finding("position_unit", "error", text_, 0.99, "scale='lat=1e-7,lon=1e-7'", evidence, "gnss")
    if abs(value) > 360.0 and abs(number) <= 360.0:
        text_ = f"{problems.group(1)} {value:.6g} deg: the numbers are degrees and were read as radians"
        return Finding("position_unit", "error", text_, 0.99, "units='angle=deg'", evidence, "gnss")
    if problems.group(1) == "latitude" and abs(value) <= 180.0:
        text_ = f"a latitude of {value:.6g} deg is none: latitude and longitude are exchanged"
        fix = "columns='...,lon,lat,...' exchanged"
        return Finding("position_order", "error", text_, 0.99, fix, evidence, "gnss")
    return Finding("position_unit", "error", _clean(message), 0.99, "units='angle=...'", evidence, "gnss")


def _mended(hints: ReadHints, place: Finding) -> ReadHints | None:
    """Hints with which positions of a table become possible, so that the rest of it can be judged."""
    given = hints.given()
    if place.code == "position_order":
        if hints.columns is None:
            return None
        other = {"lat": "lon", "lon": "lat"}
        names = [name.strip() for name in hints.columns.split(",")]
        return ReadHints.of(**{**given, "columns": ",".join(other.get(name, name) for name in names)})
    if place.fix.startswith("scale=") and hints.scale is None:
        return ReadHints.of(**{**given, "scale": "lat=1e-7,lon=1e-7"})
    stated = [part for part in (hints.units or "").split(",") if part and not part.strip().startswith("angle")]
    if place.fix == "units='angle=deg'" and all("=" in part for part in stated):
        return ReadHints.of(**{**given, "units": ",".join([*stated, "angle=deg"])})
    return None


def _unreadable(message: str) -> Finding:
    return Finding("unreadable", "error", _clean(message), 1.0, part="log")


def _short(error: SchulerError) -> str:
    return _clean(str(error))


def _clean(message: str) -> str:
    return " ".join(message.split())


def not_a_log(path: Path) -> str | None:
    """Kind of a file that is no log, in words; None if it may be one.

    Parameters
    ----------
    path : Path
        That no reader took.
    """
    if not path.is_file() or packed.tables(path):
        return None
    with path.open("rb") as stream:
        head = stream.read(_MOST)
    if not head.strip():
        return "empty"
    for magic, what in _MAGIC.items():
        if head.startswith(magic):
            return what
    if is_binary(head):
        return None
    if path.suffix.lower() in _DOCUMENTS or path.name.upper() in ("README", "LICENSE"):
        return "text for people to read, not numbers"
    text = head.decode("utf-8", errors="replace").strip()
    if text[0] in "{[" and _is_json(text, complete=len(head) < _MOST):
        return "a JSON file: settings, labels or results, not samples"
    lines = [line for line in text.splitlines() if line.strip()][:60]
    prose = sum(map(_is_prose, lines))
    table = sum(map(_is_numbers, lines))
    if prose > 0 and table < 3 and prose >= 0.5 * len(lines):
        return "text for people to read, not numbers"
    return None


def _is_json(text: str, *, complete: bool) -> bool:
    try:
        json.loads(text)
    except json.JSONDecodeError:
        return not complete and text[:2].strip() in ("{", '{"', "[", "[{")
    except (ValueError, RecursionError):  # numbers of thousands of digits, deep nesting
        return True
    return True


def _is_prose(line: str) -> bool:
    """Words with blanks between them, more than anything else."""
    parts = line.split()
    words = sum(bool(_WORD.search(part)) for part in parts)
    return words >= 3 and words > 0.6 * len(parts) and line.count(",") < 0.5 * len(parts)


def _is_numbers(line: str) -> bool:
    parts = [part for part in re.split(r"[,;\s]+", line.strip()) if part]
    return len(parts) > 0 and all(_NUMBER.match(part) for part in parts)
