"""The head of a text log: comments, header, the first row of numbers, and what its columns are."""

from __future__ import annotations

import itertools
import math
import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from schuler.exceptions import FileFormatError, SchulerError
from schuler.recording.io import columns, dates, lines
from schuler.recording.io.hint_texts import parse_columns
from schuler.recording.io.hints import ReadHints
from schuler.recording.io.lines import TextTable
from schuler.recording.io.possible import RADII
from schuler.units import parse_unit

_COMMENTS = ("#", "%", "//")
_BANNER = 20  # lines of words above the first numbers that a logger may write
_LEAST_NS = 1e17  # of a stamp since 1970 in nanoseconds
_UNIX_S = (1e9, 2.1e9)  # the years 2001 to 2036
_WHOLE = re.compile(r"\d{10}(\.0*)?")  # seconds since 1970
_DECIMALS = re.compile(r":\d\d[.,]\d")
_LOOKED_AT = 100  # rows in which a decimal comma shows
#: How columns are said where no header tells them.
EXAMPLE = "columns='t,ax,ay,az,gx,gy,gz' (- skips one, * the rest)"


@dataclass(frozen=True, slots=True)
class Opening:
    """The head of a text log: its comments, its header if there is one, and its first row of numbers."""

    table: TextTable
    comments: tuple[tuple[int, str], ...]
    header: tuple[int, list[str]] | None
    fields: list[str]


def open_text(path: Path, hints: ReadHints) -> Opening:
    """Find the first row of numbers of a text file and what stands before it.

    Raises
    ------
    FileFormatError
        If the file is missing, empty, not text, or has no rows of numbers.
    """
    head = lines.check_file(path)
    encoding = lines.encoding_of(head, path)
    above_names, units = _settings_of_labview(head)
    skip = hints.skip or above_names
    starts = (hints.comment,) if hints.comment else _COMMENTS
    comments: list[tuple[int, str]] = []
    first: int | None = None
    raw = ""  # the header's line as it stands
    header: tuple[int, str] | None = None  # the last line of words above the numbers: those before it are a banner
    garbled: FileFormatError | None = None  # words below the header that are of another width
    sources: list[str] = []  # of each column, which a logger may name below the units
    with path.open(encoding=encoding, errors="replace", newline=None) as stream:
        for number, line in enumerate(itertools.islice(stream, skip, None), skip + 1):
            text = lines.decode(line.strip())
            if not text:
                continue
            if text.startswith(starts):
                comments.append((number, text))
                continue
            delimiter = hints.delimiter or _guess_delimiter(text)
            if delimiter == "\t" and line.rstrip("\r\n").endswith("\t"):
                text += "\t"  # the last field is empty, in all lines
            mark = hints.comment or next((s for s in _COMMENTS for _, c in comments if c.startswith(s)), "#")
            table = TextTable(path, number, delimiter, mark, encoding)
            fields = table.split(line)
            if not _has_points(fields) and any(map(lines.is_decimal_comma, fields)):
                table = replace(table, decimal=",")
                fields = table.split(line)
            numeric = any(map(lines.is_number, fields)) or all(map(lines.is_value, fields))
            if numeric and number <= _BANNER and _is_setting(fields):
                numeric = False
            above = table.split(header[1]) if header and _names_columns(table.split(header[1])) else []
            if hints.bad_lines and (len(fields) != (_width(hints) or len(above) or len(fields)) if numeric else above):
                first = first or number  # a garbled line, as the one a log begins in the middle of; it is counted later
                continue
            if numeric:
                if garbled is not None and len(fields) != len(above):
                    raise garbled
                table = replace(table, first=first or number)
                names = _header(table, header, fields) if header else _commented_header(table, comments, fields)
                if names and len(sources) == len(names[1]):
                    names = names[0], _told_apart(names[1], sources)
                if names and len(units) == len(names[1]):
                    names = names[0], [_with_unit(*pair) for pair in zip(names[1], units, strict=True)]
                if table.decimal == "." and _has_decimal_commas(table, line, stream):
                    table = replace(table, decimal=",")
                table = replace(table, header=raw if header else "")
                return Opening(table, tuple(comments), names, fields)
            whole = replace(table, comment="\n").split(line) if above else []  # a unit may be a #
            if above and len(whole) == len(above) and (units or _are_units(whole)):
                units, sources = units or whole, whole if units else sources
                continue
            if header is not None and (number > _BANNER or above):
                fault = FileFormatError(
                    f"expected numbers below the header in line {header[0]}, got {lines.shorten(text)}: pass over the "
                    f"lines before the first numbers with skip=..., and name the columns, {EXAMPLE}",
                    path,
                    number,
                )
                if number > _BANNER or len(whole) == len(above):
                    raise fault
                first, garbled = first or number, garbled or fault  # garbled if numbers as the header has them follow
                continue
            header, raw = (number, text), line.strip()
    if garbled is not None:
        raise garbled
    if header is not None:
        raise FileFormatError(
            f"there is a header ({lines.shorten(header[1])}) but no row of numbers below it", path, header[0]
        )
    raise FileFormatError("there are no rows of numbers" + (f" after skip={hints.skip}" if hints.skip else ""), path)


def _settings_of_labview(head: bytes) -> tuple[int, list[str]]:
    """Lines above the names of a LabVIEW measurement (.lvm), some of them numbers behind a word, and units in them."""
    above, mark, _ = head.rpartition(b"***End_of_Header***")
    if not mark or not head.startswith(b"LabVIEW"):
        return 0, []
    units = re.findall(rb"^Y_Unit_Label[\t,](.*?)[\t,\r]*$", above, re.MULTILINE)
    return above.count(b"\n") + 1, ["s", *re.split("[\t,]", units[-1].decode("latin-1"))] if units else []


def _names_columns(fields: list[str]) -> bool:
    """Whether a line of words is a header: a field names a column, or all together name more than a time.

    Of two fields both have to: ``Time,10:11 AM`` and ``Driver,X`` are settings.
    """
    if len(fields) == 2:
        return all(map(columns.recognise, fields))
    together = columns.recognise_all(fields)
    return any(map(columns.recognise, fields)) or any(column is not None and column[0] != "t" for column in together)


def _is_setting(fields: Sequence[str]) -> bool:
    """Whether a line is words and their values, some with units: ``Sample Rate,50,Hz,,Laps,1``, ``Build 7 serial 42``.

    A row of a log that begins with a word has more entries, dates among them, than words.
    """
    filled = [field for field in fields if field]
    if _is_entry(fields[0]):
        return False
    numbers, entries = (sum(map(is_such, filled)) for is_such in (lines.is_number, _is_entry))
    return len(filled) == 2 or 2 * numbers < len(filled) or 2 * entries <= len(filled)


def _is_entry(field: str) -> bool:
    """Whether a field is one of a row: a number, nothing, or a date or time."""
    return lines.is_value(field) or dates.is_date(field) or dates.is_clock(field) or dates.is_day(field)


def _are_units(fields: list[str]) -> bool:
    """Whether a line below a header states units: most of its fields are some, but for those without any."""
    stated = [field for field in fields if field.strip("\"'[]() ").lower() not in ("", "na", "n/a", "-", "none")]
    return 2 * sum(map(is_unit, fields)) > len(stated)


def is_unit(field: str) -> bool:
    """Whether a field is a unit, in brackets or quotes or without."""
    try:
        parse_unit(field.strip("\"'[] "))
    except SchulerError:
        return False
    return True


def _with_unit(name: str, unit: str) -> str:
    """A column's name with the unit below it, if it is one."""
    bare = unit[1:-1] if unit.startswith("(") and unit.endswith(")") else unit
    return f"{name} [{bare}]" if is_unit(unit) else name


def _told_apart(names: list[str], sources: Sequence[str]) -> list[str]:
    """Names of columns that come again with their sources before them, but those of the latitude's."""
    receiver = next((s for name, s in zip(names, sources, strict=True) if name.lower().startswith("lat")), None)
    return [
        f"{source} {name}" if names.count(name) > 1 and source != receiver else name
        for name, source in zip(names, sources, strict=True)
    ]


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


def columns_of(opening: Opening) -> list[tuple[str, str | None] | None]:
    """What the header says of each column: name and unit, or None.

    A lone date is the time whatever it is called, unless another column is surely it.
    """
    names = [] if opening.header is None else opening.header[1]
    read = columns.recognise_all(names)
    if len(read) == len(opening.fields):  # 0000-00-00 is a time by its name alone
        called = [k for k, column in enumerate(read) if column is not None and column[0] == "t"]
        if empty := [k for k in called if not _is_entry(opening.fields[k])]:
            others = columns.recognise_all(["" if k in empty else name for k, name in enumerate(names)])
            read = others if any(column is not None and column[0] == "t" for column in others) else read
    read = _without_decimals(read, opening)
    clock = next((k for k, column in enumerate(read) if column is not None and column[0] == "t"), None)
    if clock is not None and columns.recognise(names[clock]) is None and columns.unit_in(names[clock]) is None:
        dated = [k for k, field in enumerate(opening.fields) if dates.is_date(field)]
        if len(dated) == 1 and len(read) == len(opening.fields) and read[dated[0]] is None:
            read[clock] = None
    if len(read) == len(opening.fields) and not any(column is not None and column[0] == "t" for column in read):
        stamps = [k for k, field in enumerate(opening.fields) if dates.is_date(field)]
        stamps = stamps or [k for k, field in enumerate(opening.fields) if dates.is_clock(field)]
        if len(stamps) == 1 and read[stamps[0]] is None:
            read[stamps[0]] = ("t", None)
    return _first_clock(_of_one_instant(read, opening), opening)


def _of_one_instant(read: list[tuple[str, str | None] | None], opening: Opening) -> list[tuple[str, str | None] | None]:
    """Columns with one of two times: a date, or Unix time beside a counter, where it is finer than seconds."""
    times = [k for k, column in enumerate(read) if column is not None and column[0] == "t"]
    if len(times) != 2 or len(read) != len(opening.fields):
        return read
    fields = [opening.fields[k] for k in times]
    dated = [dates.is_date(field) for field in fields]
    absolute = [is_date or _is_unix(field) for is_date, field in zip(dated, fields, strict=True)]
    if not any(absolute) or not all(a or lines.is_number(field) for a, field in zip(absolute, fields, strict=True)):
        return read
    first = dated.index(True) if any(dated) else absolute.index(True)
    whole = _WHOLE.fullmatch(fields[first]) if lines.is_number(fields[first]) else not _DECIMALS.search(fields[first])
    kept = times[1 - first if whole else first]
    return [None if k in times and k != kept else column for k, column in enumerate(read)]


def _is_unix(field: str) -> bool:
    """Whether a field is a time of this century in seconds or a thousandth, millionth, billionth of one."""
    stamp = float(field) if lines.is_number(field) else 0.0
    return any(_UNIX_S[0] <= stamp * second <= _UNIX_S[1] for second in (1.0, 1e-3, 1e-6, 1e-9))


def _without_decimals(
    read: list[tuple[str, str | None] | None], opening: Opening
) -> list[tuple[str, str | None] | None]:
    """Columns with a date as the time, where the time was one that holds the microseconds of that date."""
    dated = [k for k, field in enumerate(opening.fields) if dates.is_date(field)]
    times = [k for k, column in enumerate(read) if column is not None and column[0] == "t"]
    if len(dated) != 1 or len(times) != 1 or dated == times or len(read) != len(opening.fields):
        return read
    micros = re.search(r"[.,](\d{6})\D*$", opening.fields[dated[0]])
    field = opening.fields[times[0]]
    if micros is None or not field.isdigit() or int(field) != int(micros[1]):
        return read
    return [("t", None) if k == dated[0] else None if k == times[0] else column for k, column in enumerate(read)]


def _first_clock(read: list[tuple[str, str | None] | None], opening: Opening) -> list[tuple[str, str | None] | None]:
    """Columns with one clock, where the first of all is one for sure: a date, or of a stated unit.

    Of ROS's topics as tables it is the stamp of the message, not when it came.
    """
    names = [] if opening.header is None else opening.header[1]
    stamps = [k for k, name in enumerate(names) if name.lower().endswith("header.stamp")]
    if len(stamps) == 1:
        read = [None if column is not None and column[0] == "t" else column for column in read]
        field = opening.fields[stamps[0]] if stamps[0] < len(opening.fields) else ""
        read[stamps[0]] = ("t", "ns" if lines.is_number(field) and float(field) > _LEAST_NS else None)
        return read
    first = read[0] if read else None
    if first is None or first[0] != "t" or (first[1] is None and not dates.is_date(opening.fields[0])):
        return read
    return [None if k and column is not None and column[0] == "t" else column for k, column in enumerate(read)]


def is_in_space(opening: Opening) -> bool:
    """Whether x, y, z of the first row are as far from the centre of the Earth as a vehicle is; or of some sensor."""
    names = [column and column[0] for column in columns_of(opening)]
    place = [field for name, field in zip(names, opening.fields, strict=False) if name in columns.ECEF]
    size = math.hypot(*map(float, place)) if all(map(lines.is_number, place)) else 0.0
    return RADII[0] <= size <= RADII[1]


def _header(table: TextTable, header: tuple[int, str], fields: list[str]) -> tuple[int, list[str]]:
    """Names of a header's columns, of which one may have the mark of comments in it, such as ``Tick#``."""
    names, whole = table.split(header[1]), replace(table, comment="\n").split(header[1])
    if len(names) == len(fields) + 1 and names[-1] == "Comment":  # of LabVIEW, which few rows have
        names = names[:-1]
    names = whole if len(names) != len(fields) == len(whole) else names
    return header[0], _behind_strokes(names) if all("|" in name for name in names) else names


def _behind_strokes(names: list[str]) -> list[str]:
    """Names with the units behind them: of RaceCapture's ``"AccelX"|"G"|-3.0|3.0|50`` AccelX [G]."""
    cells = [[part.strip("\"' ") for part in name.split("|")] for name in names]
    return [_with_unit(name, unit) for name, unit, *_ in cells]


def _commented_header(
    table: TextTable, comments: list[tuple[int, str]], fields: list[str]
) -> tuple[int, list[str]] | None:
    """A header behind a comment mark: the last comment with as many fields as the rows and none of them a number."""
    for number, text in reversed(comments):
        for delimiter in dict.fromkeys((table.delimiter, *",;\t")):  # numpy's header beside numbers with blanks
            names = replace(table, comment="\n", delimiter=delimiter).split(text.lstrip("#%/ \t"))
            if len(names) == len(fields) and not any(map(lines.is_number, names)):
                return (number, names) if _names_columns(names) else None
    return None


def _guess_delimiter(line: str) -> str:
    return next((character for character in ";\t,|" if character in line), " ")
