"""Plain text logs: any order of columns, with or without a header and a time column."""

from __future__ import annotations

import itertools
import json
from collections.abc import Callable, Iterable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from schuler.exceptions import FileFormatError, SchulerError
from schuler.recording.io import columns, header_words, lines, missing_values, own, own_satellites, stamps
from schuler.recording.io.assemble import CONVERTED, recording_from
from schuler.recording.io.garbled import good_rows, put_in_order
from schuler.recording.io.held_rows import new_rows
from schuler.recording.io.hint_texts import ColumnSpec, factor, parse_columns, parse_units
from schuler.recording.io.hints import ReadHints
from schuler.recording.io.raw import Raw
from schuler.recording.io.text_head import EXAMPLE, Opening, columns_of, is_in_space, open_text
from schuler.recording.recording import Recording

#: Start of the comment line by which our own CSV files are known; a JSON document follows.
OWN_MARK = "# schuler {"
OWN_FAMILY = "schuler/csv"
OWN_FORMAT = f"{OWN_FAMILY}/2"
_AS_RATE = "The header states angular rates in"
_ONE_CLOCK = "are taken to run on one clock of unknown epoch."


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
    return joined([recording_from(raw, own) for raw, own in tables(opening, hints)], hints)


def tables(opening: Opening, hints: ReadHints) -> list[tuple[Raw, ReadHints]]:
    """Columns of a text log with the hints that go with them: of both series of a table that holds two.

    Parameters
    ----------
    opening : Opening
    hints : ReadHints

    Raises
    ------
    FileFormatError
        As :func:`read_text`.
    """
    names = _layout(opening, hints)[0]
    held = _several(columns.series_of(names), opening) if hints.series is None else ()
    return [(_load(opening, own), own) for own in ([replace(hints, series=name) for name in held] or [hints])]


def joined(parts: list[Recording], hints: ReadHints) -> Recording:
    """One recording of the series of one table.

    Parameters
    ----------
    parts : list of Recording
    hints : ReadHints
        As they were given.
    """
    if len(parts) == 1:
        return parts[0]
    merged = parts[0].merged_with(parts[1])
    notes = [note for note in merged.metadata.notes if not note.endswith(_ONE_CLOCK)]
    return replace(merged, metadata=replace(merged.metadata, notes=tuple(notes), options=hints.given()))


def _several(series: list[str], opening: Opening | None = None) -> tuple[str, ...]:
    """Series of a table that holds an IMU and what came with some of its samples: fixes or a speed of wheels.

    Coordinates beside an IMU are what it makes of itself, but for those about the centre of the Earth.
    """
    if series == ["imu", "reference"] and opening is not None and not is_in_space(opening):
        return ("imu",)
    return tuple(series) if series in (["imu", "gnss"], ["imu", "odometer"]) else ()


def recognised_series(path: Path) -> tuple[str, ...]:
    """Series a text file would be read as without hints; none if its header does not tell."""
    hints = ReadHints()
    try:
        opening = open_text(path, hints)
        for number, comment in opening.comments:
            if comment.startswith(OWN_MARK):
                return (str(_own_document(comment, path, number).get("holds")),)
        names = [column[0] for column in columns_of(opening) if column]
    except SchulerError:
        return ()
    series = columns.series_of(names)
    complete = {
        "imu": {*columns.ACCEL, *columns.GYRO},
        "gnss": {"lat", "lon"},
        "odometer": {"speed"},
        # a column of heights alone may be anything; one with its accuracy is meant to be used
        "heading": {"heading", "sheading"},
        "height": {"h", "sh"},
        "reference": {"x", "y", "z"},
    }
    held = _several(series, opening) or (tuple(series) if len(series) == 1 else ())
    whole = tuple(name for name in held if complete[name] <= set(names))
    if whole[:1] != held[:1] or (whole == ("reference",) and not is_in_space(opening)):
        return ()
    return whole


def _load(opening: Opening, hints: ReadHints) -> Raw:
    names, indices, stated, notes, negated = _layout(opening, hints)
    n_columns, beside = len(opening.fields), bool(_several(columns.series_of(names)))
    if beside and hints.series is not None:
        of_it = columns.BELONGS[hints.series] | ({"heading"} if hints.series == "gnss" else set())
        own = [k for k, name in enumerate(names) if name in of_it]
        names, indices = [names[k] for k in own], [indices[k] for k in own]
    dated = stamps.dated_column(opening, dict(zip(names, indices, strict=True)))
    if dated is not None:
        place = names.index("t")
        del names[place], indices[place]
    if beside and hints.series in ("gnss", "odometer"):
        return _rarer(opening, hints, names, indices, (stated, notes, negated), dated)
    rows: Iterable[list[str]]
    line_of: Callable[[int], int | None] = opening.table.line_of
    if hints.bad_lines:
        numbers, rows, n_bad = good_rows(opening.table, n_columns, indices, dated, hints.bad_lines)
        values = np.array([[float(fields[k]) for k in indices] for fields in rows])
        line_of = numbers.__getitem__
        if n_bad:
            what = "1 garbled line of {} was" if n_bad == 1 else f"{n_bad} garbled lines of {{}} were"
            notes.append(f"{what.format(n_bad + len(numbers))} left out.")
    else:
        values, truncated = missing_values.load(opening, names, indices, allow_truncated=hints.allows("truncated"))
        rows = (fields for _, fields in itertools.islice(opening.table.rows(), len(values)))
        if truncated:
            notes.append("The last line was cut off and left out.")
    if repeats := lines.repeated_headers(opening.table):
        notes.append(
            f"The header comes again {repeats} times, where the log was begun anew: those lines were left out."
        )
    arrays = {name: values[:, k] for k, name in enumerate(names)}
    raw = Raw(opening.table.path, arrays, stated, line_of, notes=notes, negated=negated)
    if dated is not None:
        stamps.stamp(raw, hints, stamps.stamps_of(opening, dated, rows))
    if hints.bad_lines:
        put_in_order(raw, hints.bad_lines)
    return raw


def _rarer(
    opening: Opening,
    hints: ReadHints,
    names: list[str],
    indices: list[int],
    stated_notes_negated: tuple[dict[str, str], list[str], set[str]],
    dated: int | None,
) -> Raw:
    """Rows of a table of an IMU that bring a fix or a speed of wheels.

    See :func:`schuler.recording.io.held_rows.new_rows`.
    """
    stated, notes, negated = stated_notes_negated
    fixes = hints.series == "gnss"
    numbers, rows, counted = new_rows(opening, names, indices, fixes=fixes)
    if not rows:
        raise FileFormatError(f"no row has a number in {', '.join(names)}", opening.table.path, opening.table.first)
    values = np.array([[float(f[k]) if lines.is_number(f[k]) else -1.0 for k in indices] for f in rows])
    if fixes:
        notes.append(f"{len(rows)} rows bring a new fix; those between repeat the last one or have none.")
    arrays = {name: values[:, k] for k, name in enumerate(names)}
    if "t" in names:
        arrays["t"] = arrays["t"] + counted
    raw = Raw(opening.table.path, arrays, stated, numbers.__getitem__, notes=notes, negated=negated)
    if dated is not None:
        stamps.stamp(raw, hints, stamps.stamps_of(opening, dated, rows))
    at = dated if dated is not None else indices[names.index("t")] if "t" in names else None
    if at is not None and (moved := stamps.spread_with_all(opening, at, numbers)) is not None:
        raw.values["t"] = raw.values["t"] + moved
    return raw


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
            f"{len(opening.fields)}: correct the file, or say {EXAMPLE} and skip={header[0]}",
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
    with_unit = {name: k for name, k in chosen.items() if name != "t" or stamps.dated_column(opening, chosen) is None}
    stated = _stated_units(opening, hints, with_unit, notes) if fits else {}
    chosen = {name: k for name, k in chosen.items() if name in with_unit or name == "t"}
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
            f"there is no header, so the {len(opening.fields)} columns are not known: say {EXAMPLE}; it is {shown}",
            path,
            opening.table.first,
        )
    number, fields = header
    recognised = {k: column for k, column in enumerate(columns_of(opening)) if column}
    names = [name for name, _ in recognised.values()]
    if set(names) & set(columns.MAG) and any(names.count(name) != 1 for name in columns.MAG):
        # raw beside corrected, or an axis alone: no one magnetometer, and nothing else needs it
        recognised = {k: column for k, column in recognised.items() if column[0] not in columns.MAG}
        names = [name for name, _ in recognised.values()]
    stamps = [k for k, (name, _) in recognised.items() if name == "t"]
    if hints.rate is not None and stamps and columns.recognise(fields[stamps[0]]) is None:
        del recognised[stamps[0]]  # a date that nothing calls a time
        names.remove("t")
    series = columns.series_of(names)
    if not series or ("x" in names and series == ["reference"] and not {"y", "z"} <= set(names)):
        raise FileFormatError(
            f"no sensor is recognised in the header ({_listed(fields)}): say {EXAMPLE} or map names, "
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
    high = [field for field in unused if header_words.may_be_height(header_words.words_of(field))]
    if high and "lat" in names and "h" not in names:
        notes.append(f"One of {', '.join(high)} may be the height of the fixes: columns='...,h={high[0]}' takes it.")
    return {name: k for k, (name, _) in recognised.items()}


def _find_header(opening: Opening, source: str) -> int:
    path, header = opening.table.path, opening.header
    if header is None:
        raise FileFormatError(
            f"columns maps a name to the header {source!r}, but the file has no header: give the names in "
            f"order, {EXAMPLE}",
            path,
        )
    plain = [field.strip().strip("\"'") for field in header[1]]
    for name, have in ((source, plain), (source.lower(), [p.lower() for p in plain])):
        if name in have:
            return have.index(name)
    raise FileFormatError(f"there is no header {source!r}; there are: {_listed(plain)}", path, header[0])


def _stated_units(opening: Opening, hints: ReadHints, chosen: dict[str, int], notes: list[str]) -> dict[str, str]:
    """Units by column, in the header's words; a temperature whose unit is not known is taken out of ``chosen``."""
    assert opening.header is not None
    given = parse_units(hints.units, hints.kind)
    stated = {}
    for name, k in list(chosen.items()):
        unit = columns.unit_in(opening.header[1][k])
        group = columns.GROUP[name]
        if unit is None or group is None:
            continue
        try:
            factor(unit, group, hints.kind)
        except SchulerError as error:
            if group == "mag" and group not in given:
                continue  # by its size
            beside = columns.unit_in(opening.header[1][chosen["ax"]]) if "ax" in chosen else None
            if (
                group == "gyro"
                and group not in given
                and _is_factor(f"{unit}/s", group)
                and _is_factor(beside, "accel")
            ):
                stated[name] = f"{unit}/s"  # increments have a velocity beside them
                note = f"{_AS_RATE} {unit}; taken as {unit}/s."
                notes += [note] if note not in notes else []
                continue
            if name == "temp" and group not in given:
                notes.append(f"The temperature was left out, whose unit is not known: {opening.header[1][k]}.")
                del chosen[name]
                continue
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


def _is_factor(unit: str | None, group: str) -> bool:
    """Whether a unit is stated, and is one of a group's rates."""
    if unit is None:
        return False
    try:
        factor(unit, group, "rate")
    except SchulerError:
        return False
    return True


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
