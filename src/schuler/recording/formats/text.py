"""Plain text logs: any order of columns, with or without a header and a time column."""

from __future__ import annotations

import itertools
import json
from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from schuler.arrays import FloatArray
from schuler.exceptions import FileFormatError, InputError, SchulerError
from schuler.recording.io import clock, columns, dates, lines, own, own_satellites
from schuler.recording.io.assemble import CONVERTED, recording_from
from schuler.recording.io.hint_texts import ColumnSpec, factor, parse_columns, parse_units
from schuler.recording.io.hints import ReadHints
from schuler.recording.io.lines import TextTable
from schuler.recording.io.raw import Raw
from schuler.recording.recording import Recording

#: Start of the comment line by which our own CSV files are known; a JSON document follows.
OWN_MARK = "# schuler {"
OWN_FAMILY = "schuler/csv"
OWN_FORMAT = f"{OWN_FAMILY}/2"
_COMMENTS = ("#", "%", "//")
_BANNER = 20  # lines of words above the first numbers that a logger may write
_LOOKED_AT = 100  # rows in which a decimal comma shows
_EXAMPLE = "columns='t,ax,ay,az,gx,gy,gz' (- skips one, * the rest)"


@dataclass(frozen=True, slots=True)
class Opening:
    """The head of a text log: its comments, its header if there is one, and its first row of numbers."""

    table: TextTable
    comments: tuple[tuple[int, str], ...]
    header: tuple[int, list[str]] | None
    fields: list[str]


def read_text(path: Path, hints: ReadHints) -> Recording:
    """Recording of a text log.

    Parameters
    ----------
    path : Path
    hints : ReadHints
        Hints on what the file does not state.

    Returns
    -------
    Recording
        With one series; files written by :func:`schuler.recording.formats.csv.write_csv` bring all they were written
        with.

    Raises
    ------
    FileFormatError
        With the line, if anything in the file is missing, malformed or impossible.
    """
    opening = open_text(path, hints)
    for number, comment in opening.comments:
        if comment.startswith(OWN_MARK):
            return _read_own(opening, hints, _own_document(comment, path, number))
    raw = _load(opening, hints)
    return recording_from(raw, hints)


def recognised_series(path: Path) -> str | None:
    """Series a text file would be read as without hints; ``None`` if its header does not tell."""
    hints = ReadHints()
    try:
        opening = open_text(path, hints)
        for number, comment in opening.comments:
            if comment.startswith(OWN_MARK):
                return str(_own_document(comment, path, number).get("holds"))
        if opening.header is None:
            return None
        names = [series[0] for series in map(columns.recognise, opening.header[1]) if series]
    except SchulerError:
        return None
    series = columns.series_of(names)
    complete = {
        "imu": {*columns.ACCEL, *columns.GYRO},
        "gnss": set(columns.GEODETIC),
        "odometer": {"speed"},
        # a column of heights alone may be anything; one with its accuracy is meant to be used
        "heading": {"heading", "sheading"},
        "height": {"h", "sh"},
        "reference": {"x", "y", "z"},
    }
    return series[0] if len(series) == 1 and complete[series[0]] <= set(names) else None


def open_text(path: Path, hints: ReadHints) -> Opening:
    """Find the first row of numbers of a text file and what stands before it.

    Raises
    ------
    FileFormatError
        If the file is missing, empty, not text, or has no rows of numbers.
    """
    encoding = lines.encoding_of(lines.check_file(path), path)
    starts = (hints.comment,) if hints.comment else _COMMENTS
    comments: list[tuple[int, str]] = []
    first: int | None = None
    header: tuple[int, str] | None = None  # the last line of words above the numbers: those before it are a banner
    with path.open(encoding=encoding, errors="replace", newline=None) as stream:
        for number, line in enumerate(itertools.islice(stream, hints.skip, None), hints.skip + 1):
            text = lines.decode(line.strip())
            if not text:
                continue
            if text.startswith(starts):
                comments.append((number, text))
                continue
            delimiter = hints.delimiter or _guess_delimiter(text)
            mark = hints.comment or next((s for s in _COMMENTS for _, c in comments if c.startswith(s)), "#")
            table = TextTable(path, number, delimiter, mark, encoding)
            fields = table.split(line)
            if not _has_points(fields) and any(map(lines.is_decimal_comma, fields)):
                table = replace(table, decimal=",")
                fields = table.split(line)
            numeric = any(map(lines.is_number, fields)) or all(map(lines.is_value, fields))
            above = table.split(header[1]) if header and any(map(columns.recognise, table.split(header[1]))) else []
            if hints.bad_lines and (len(fields) != (_width(hints) or len(above) or len(fields)) if numeric else above):
                first = first or number  # a garbled line, as the one a log begins in the middle of; it is counted later
                continue
            if numeric:
                table = replace(table, first=first or number)
                names = (header[0], table.split(header[1])) if header else _commented_header(table, comments, fields)
                if table.decimal == "." and _has_decimal_commas(table, line, stream):
                    table = replace(table, decimal=",")
                return Opening(table, tuple(comments), names, fields)
            if header is not None and (number > _BANNER or any(map(columns.recognise, table.split(header[1])))):
                raise FileFormatError(
                    f"expected numbers below the header in line {header[0]}, got {lines.shorten(text)}: pass over the "
                    f"lines before the first numbers with skip=..., and name the columns, {_EXAMPLE}",
                    path,
                    number,
                )
            header = (number, text)
    if header is not None:
        raise FileFormatError(
            f"there is a header ({lines.shorten(header[1])}) but no row of numbers below it", path, header[0]
        )
    raise FileFormatError("there are no rows of numbers" + (f" after skip={hints.skip}" if hints.skip else ""), path)


def _has_points(fields: Iterable[str]) -> bool:
    """Whether a field is a number with a decimal point."""
    return any("." in field and lines.is_number(field) for field in fields)


def _has_decimal_commas(table: TextTable, line: str, following: Iterable[str]) -> bool:
    """Whether numbers have commas for points: some of the first rows have one, none has a point."""
    rows = [table.split(row) for row in (line, *itertools.islice(following, _LOOKED_AT))]
    return any(any(map(lines.is_decimal_comma, row)) for row in rows) and not any(map(_has_points, rows))


def _width(hints: ReadHints) -> int | None:
    """Number of fields of a row, if the hint ``columns`` says it."""
    specs, rest = parse_columns(hints.columns) or ([], True)
    return None if rest or any(spec is not None and spec.source is not None for spec in specs) else len(specs)


def _load(opening: Opening, hints: ReadHints) -> Raw:
    names, indices, stated, notes, negated = _layout(opening, hints)
    n_columns = len(opening.fields)
    dated = _dated(opening, dict(zip(names, indices, strict=True)))
    if dated is not None:
        place = names.index("t")
        del names[place], indices[place]
    rows: Iterable[list[str]]
    line_of: Callable[[int], int | None] = opening.table.line_of
    if hints.bad_lines:
        numbers, rows, n_bad = lines.good_rows(opening.table, n_columns, indices, dated, hints.bad_lines)
        values = np.array([[float(fields[k]) for k in indices] for fields in rows])
        line_of = numbers.__getitem__
        if n_bad:
            notes.append(f"{n_bad} garbled lines of {n_bad + len(numbers)} were left out.")
    else:
        values, truncated = _values(opening, names, indices, hints.allows("truncated"))
        rows = (fields for _, fields in itertools.islice(opening.table.rows(), len(values)))
        if truncated:
            notes.append("The last line was cut off and left out.")
    arrays = {name: values[:, k] for k, name in enumerate(names)}
    raw = Raw(opening.table.path, arrays, stated, line_of, notes=notes, negated=negated)
    if dated is not None:
        _stamp(raw, hints, [fields[dated] for fields in rows])
    return raw


def _values(opening: Opening, names: list[str], indices: list[int], cut: bool) -> tuple[FloatArray, bool]:
    """Numbers of the used columns; NaN where a magnetometer, which may be slower than the rest, has empty fields."""
    table, n_columns = opening.table, len(opening.fields)
    slower = [k for k, name in enumerate(names) if name in columns.MAG]
    try:
        return lines.load(table, n_columns, indices, allow_truncated=cut)
    except FileFormatError:
        if not slower:
            raise
    others = [k for k in range(len(names)) if k not in slower]
    loaded, truncated = lines.load(table, n_columns, [indices[k] for k in others], allow_truncated=cut)
    values = np.full((len(loaded), len(names)), np.nan)
    values[:, others] = loaded
    for row, (_, fields) in zip(values, table.rows(), strict=False):
        for k in slower:
            if lines.is_number(fields[indices[k]]):
                row[k] = float(fields[indices[k]])
    return values, truncated


def _dated(opening: Opening, chosen: dict[str, int]) -> int | None:
    """Position of the time column if its stamps are dates."""
    k = chosen.get("t")
    return k if k is not None and dates.is_date(opening.fields[k]) else None


def _stamp(raw: Raw, hints: ReadHints, texts: list[str]) -> None:
    """Make the time column of dates, on GPS time."""
    ns, zoned, bad = dates.unix_ns(texts)
    if bad is not None:
        raise raw.fault(f"t: expected a date such as 2024-05-01T12:00:00.25Z, got {lines.shorten(texts[bad], 40)}", bad)
    if hints.time not in (None, "unix", "utc-unix") and (zoned or hints.time != "gps-unix"):
        meant = (
            "state their zone: leave time out" if zoned else "say time='unix' if they are UTC, 'gps-unix' if GPS time"
        )
        raise raw.fault(f"time={hints.time!r}, but the stamps are dates; {meant}")
    if "received" in raw.values:
        raise raw.fault("received: expected dates as in the column t, which are not read here: skip it with -")
    notes: list[str] = []
    try:
        seconds, raw.time = clock.from_unix({"t": ns}, hints.time, notes, assumed="unix")
    except InputError as error:
        raise raw.fault(str(error)) from error
    raw.values["t"], raw.stated["t"] = seconds["t"], "s"
    if hints.time is None and not zoned:
        raw.notes.append(
            "Dates without a zone are taken as UTC (hint time='gps-unix' for GPS time, offset for others)."
        )
    raw.notes += [note.replace("Stamps are taken as Unix time (UTC)", "Stamps are dates") for note in notes]


def _layout(opening: Opening, hints: ReadHints) -> tuple[list[str], list[int], dict[str, str], list[str], set[str]]:
    """Names and positions of the columns to read, the units the header states, notes, and columns it negates."""
    notes: list[str] = []
    path, header = opening.table.path, opening.header
    parsed = parse_columns(hints.columns)
    specs = [] if parsed is None else [spec for spec in parsed[0] if spec is not None]
    in_order = parsed is not None and all(spec.source is None for spec in specs)
    fits = header is not None and len(header[1]) == len(opening.fields)
    if header is not None and not fits and not in_order:
        raise FileFormatError(
            f"the header names {len(header[1])} columns, the first row of numbers (line {opening.table.first}) has "
            f"{len(opening.fields)}: correct the file, or say {_EXAMPLE} and skip={header[0]}",
            path,
            header[0],
        )
    if parsed is None:
        chosen = _by_header(opening, hints, notes)
    elif in_order:
        chosen = _by_order(opening, hints, *parsed)
    else:
        if any(spec.source is None or spec.name in columns.TRIADS for spec in specs):
            raise FileFormatError(
                f"columns: in a text file all names are mapped to headers or none, got {hints.columns!r}", path
            )
        chosen = {spec.name: _find_header(opening, spec.source or "") for spec in specs}
    with_unit = {name: k for name, k in chosen.items() if name != "t" or _dated(opening, chosen) is None}
    stated = _stated_units(opening, hints, with_unit, notes) if fits else {}
    negated = {
        name
        for name, k in chosen.items()
        if parsed is None
        and header is not None
        and name in columns.SIGNED
        and header[1][k].strip("\"' ").startswith("-")
    }
    if header is not None and in_order:
        kept = " but for the units it states" if stated else ""
        notes.append(f"The header in line {header[0]} was passed over{kept}, since the columns were given.")
    return list(chosen), list(chosen.values()), stated, notes, negated


def _by_order(opening: Opening, hints: ReadHints, specs: list[ColumnSpec | None], rest: bool) -> dict[str, int]:
    n = len(opening.fields)
    if len(specs) > n or (len(specs) < n and not rest):
        raise FileFormatError(
            f"expected {len(specs)} columns ({hints.columns}), got {n} fields between delimiters "
            f"{opening.table.delimiter!r}: add - for each column to skip or * for the rest, or give delimiter",
            opening.table.path,
            opening.table.first,
        )
    return {spec.name: k for k, spec in enumerate(specs) if spec is not None}


def _by_header(opening: Opening, hints: ReadHints, notes: list[str]) -> dict[str, int]:
    path, header = opening.table.path, opening.header
    if header is None:
        shown = lines.shorten(opening.table.delimiter.join(opening.fields))
        raise FileFormatError(
            f"there is no header, so the {len(opening.fields)} columns are not known: say {_EXAMPLE}; "
            f"the line is {shown}",
            path,
            opening.table.first,
        )
    number, fields = header
    recognised = {k: name for k, name in ((k, columns.recognise(field)) for k, field in enumerate(fields)) if name}
    names = [name for name, _ in recognised.values()]
    if set(names) & set(columns.MAG) and any(names.count(name) != 1 for name in columns.MAG):
        # raw beside corrected, or an axis alone: no one magnetometer, and nothing else needs it
        recognised = {k: column for k, column in recognised.items() if column[0] not in columns.MAG}
        names = [name for name, _ in recognised.values()]
    day = [k for k, field in enumerate(opening.fields) if dates.is_date(field)]
    if "t" not in names and len(day) == 1 and hints.rate is None and day[0] not in recognised:
        recognised[day[0]] = ("t", None)
        names.append("t")
    series = columns.series_of(names)
    if not series or ("x" in names and series == ["reference"] and not {"y", "z"} <= set(names)):
        raise FileFormatError(
            f"no sensor is recognised in the header ({_listed(fields)}): say {_EXAMPLE} or map names, "
            "columns='t=Stamp,ax=X acceleration,...'",
            path,
            number,
        )
    if twice := sorted({name for name in names if names.count(name) > 1}):
        same = [fields[k] for k, (name, _) in recognised.items() if name == twice[0]]
        raise FileFormatError(
            f"{twice[0]} may be any of {', '.join(same)}: say which with columns='{twice[0]}={same[-1]},...'",
            path,
            number,
        )
    unused = [fields[k] for k in range(len(fields)) if k not in recognised]
    if unused:
        notes.append(f"Columns not used: {', '.join(unused)}.")
    return {name: k for k, (name, _) in recognised.items()}


def _find_header(opening: Opening, source: str) -> int:
    path, header = opening.table.path, opening.header
    if header is None:
        raise FileFormatError(
            f"columns maps a name to the header {source!r}, but the file has no header: give the names in "
            f"order, {_EXAMPLE}",
            path,
        )
    plain = [field.strip().strip("\"'") for field in header[1]]
    for name, have in ((source, plain), (source.lower(), [p.lower() for p in plain])):
        if name in have:
            return have.index(name)
    raise FileFormatError(f"there is no header {source!r}; there are: {_listed(plain)}", path, header[0])


def _stated_units(opening: Opening, hints: ReadHints, chosen: dict[str, int], notes: list[str]) -> dict[str, str]:
    assert opening.header is not None
    given = parse_units(hints.units, hints.kind)
    stated = {}
    for name, k in chosen.items():
        unit = columns.unit_in(opening.header[1][k])
        group = columns.GROUP[name]
        if unit is None or group is None:
            continue
        try:
            factor(unit, group, hints.kind)
        except SchulerError as error:
            if group == "mag" and group not in given:
                continue  # by its size
            if group not in given:
                raise FileFormatError(
                    f"column {opening.header[1][k]!r}: {error}; say units='{group}=...'",
                    opening.table.path,
                    opening.header[0],
                ) from error
            notes.append(f"The unit {unit!r} in the header of {name} was passed over for the stated {given[group]}.")
            continue
        stated[name] = unit
    return stated


def _commented_header(
    table: TextTable, comments: list[tuple[int, str]], fields: list[str]
) -> tuple[int, list[str]] | None:
    """A header behind a comment mark: the last comment with as many fields as the rows and none of them a number."""
    for number, text in reversed(comments):
        names = replace(table, comment="\n").split(text.lstrip("#%/ \t"))
        if len(names) == len(fields) and not any(map(lines.is_number, names)):
            return (number, names) if any(map(columns.recognise, names)) else None
    return None


def _guess_delimiter(line: str) -> str:
    return next((character for character in ";\t," if character in line), " ")


def _listed(names: list[str]) -> str:
    return ", ".join(names[:40]) + (f", ... ({len(names)} in all)" if len(names) > 40 else "")


def _own_document(comment: str, path: Path, number: int) -> dict[str, Any]:
    try:
        document = json.loads(comment[len(OWN_MARK) - 1 :])
    except (ValueError, RecursionError) as error:
        raise FileFormatError(
            f"the line that describes this file is damaged ({error}); write it anew", path, number
        ) from error
    if not isinstance(document, dict):
        raise FileFormatError("the line that describes this file is damaged; write it anew", path, number)
    own.check_format(document.get("format"), OWN_FORMAT, path, document.get("package"))
    return document


def _read_own(opening: Opening, hints: ReadHints, document: dict[str, Any], *, alone: bool = False) -> Recording:
    """One of our own CSV files and, from its first one, the others written beside it unless it is read alone."""
    path = opening.table.path
    own.refuse_hints(hints, path)
    series = own.check_series(document, path)
    metadata = own.metadata_from(document, path)
    name = document.get("holds")
    if not isinstance(name, str) or name not in series:
        raise FileFormatError("the line that describes this file is damaged; write it anew", path)
    tables = {name: _load_satellites(opening, name)} if name in own_satellites.TABLES else {}
    if tables:
        own.check_rows(name, series[name], own.rows(tables[name]), path)
    parts = own.satellite_parts(tables, document, path, alone=alone)
    if tables:
        recording = Recording(**parts, metadata=metadata)
    else:
        kind = str(series[name].get("kind", "rate"))
        inner = ReadHints.of(kind=kind, series=name)
        raw = _load(opening, inner)
        own.check_rows(name, series[name], own.rows(raw.values), path)
        raw.ellipsoidal = True
        recording = replace(recording_from(raw, inner, trusted=True, time=metadata.time), **parts)
        metadata = metadata.noting(*(note for note in raw.notes if not note.startswith(CONVERTED)))
    if hints.name:
        metadata = replace(metadata, name=hints.name)
    recording = replace(recording, metadata=metadata)
    beside = document.get("beside", {})
    for other in beside.values() if isinstance(beside, dict) and not alone else ():
        companion = path.parent / Path(str(other)).name
        if companion.is_file():
            part = _read_companion(companion)
            recording = recording.merged_with(part)
        else:
            missing = f"{companion.name}, written with this file, is not beside it and was not read."
            recording = replace(recording, metadata=recording.metadata.noting(missing))
    return recording


def _load_satellites(opening: Opening, name: str) -> own.Columns:
    """Columns of one of our tables of satellite measurements, by the names in its header; NaN is a value here."""
    path, header = opening.table.path, opening.header
    names = [] if header is None else [field.partition("[")[0].strip() for field in header[1]]
    columns = [c for c in own_satellites.TABLES[name] if c in names or c not in own_satellites.LATER]
    missing = [column for column in columns if column not in names]
    if missing or len(names) != len(opening.fields):
        what = f"{', '.join(missing)} missing" if missing else f"{len(opening.fields)} fields below them"
        raise FileFormatError(
            f"expected the columns of {name} in the header, got {what}; write the file anew",
            path,
            None if header is None else header[0],
        )
    used = [names.index(column) for column in columns]
    values, _ = lines.load(opening.table, len(names), used)
    return {column: values[:, k] for k, column in enumerate(columns)}


def _read_companion(path: Path) -> Recording:
    opening = open_text(path, ReadHints())
    own_mark = next(((number, c) for number, c in opening.comments if c.startswith(OWN_MARK)), None)
    if own_mark is None:
        raise FileFormatError("expected a table written by schuler with the file that names it", path)
    document = _own_document(own_mark[1], path, own_mark[0])
    part = _read_own(opening, ReadHints(), document, alone=True)
    written = len(own.metadata_from(document, path).notes)  # those that the first file has, too
    return replace(part, metadata=replace(part.metadata, notes=part.metadata.notes[written:], options={}))
