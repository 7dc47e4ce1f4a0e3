"""Forms of lines that are no table as they stand: numbers between words, a name before each number, rows with gaps.

- ``18:53:02.106 -> a/g: 64 428 15848 -18 -32 -40``: words that stay and numbers that change, as terminals show them;
  a date, a time of day or milliseconds may stand before them. Sentences of NMEA among them are taken as they are.
- ``raw_imu,time_usec,412337000,xacc,4,yacc,-26``: a name before each number.
- ``Data,2,gps,lat,"581",deg,ms,"7",ms``: a name, a value and its unit in turn; ``1|2|3`` are samples of one line.
- ``FMT`` and ``$COL``, lines that name the columns of each kind of line (ArduPilot's text, FlySight).
- ``t, 3, x, y, z, 4, x, y, z``: numbers of sensors, each before its three values (Sensorstream).
- rows of a table in which an accelerometer, a gyroscope or a receiver have their fields, and the others none.
"""

from __future__ import annotations

import csv
import itertools
import re
from collections import Counter
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TypeAlias

from schuler.exceptions import SchulerError
from schuler.recording.io import columns, lines, text_head
from schuler.recording.io.hints import ReadHints

Row: TypeAlias = dict[str, str]
COMMENTS = ("#", "%", "//")
SENTENCES = "sentences"  # table of NMEA as it stands
PREFIX = re.compile(r"[EWIDV] \((\d+)\) [\w-]+: ")  # of ESP-IDF: level, milliseconds since the start, who says it
WORD = re.compile(r"[A-Za-z_]\w*")
_SENTENCE = re.compile(r"\$[A-Z]{5},[ -~]*\*[0-9A-Fa-f]{2}\s*$")
_STAMP = re.compile(
    r"\[?(\d{4}-\d\d-\d\d[T ]\d\d:\d\d:\d\d(?:[.,]\d+)?Z?|\d\d?:\d\d:\d\d[.,:]\d+)\]?(?:(?:\s*->|\s*[-:,;])?\s+|[,;])"
)
_LEVEL = re.compile(r"(?:(?:DEBUG|INFO|WARNING|ERROR|root)\s*[-:,;]?\s*)+")  # of a program's log
_NUMBER = re.compile(r"(?<![\w.])[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?(?!D(?:\b|_))")  # no 3D of a fix
_LABEL = re.compile(r"(?<!\w)[A-Za-z/]\w*\]?\s*[:=]\s*[(\[]?\s*[-+.\d]")
#: A sensor before its axes, with a unit or without: ``ACCEL(m/s²): X=0.06,Y=-0.20``.
_GROUP = re.compile(r"([A-Za-z]\w*)\s*(?:[(\[]([^)\]]*)[)\]])?\s*:\s*([A-Za-z]\w*)\s*=\s*[(\[]?\s*$")
#: A sensor and its first axis, the others behind it: ``Accel X: 0.12 Y: -0.20 Z: 9.81 m/s^2``.
_AXIS = re.compile(r"(?<!\w)([A-Za-z]\w*)\s+([XYZxyz])\s*[:=]\s*$")
_FIRST_AXIS = re.compile(r"(?<!\w)[A-Za-z]\w*\s+[XYZxyz]\s*[:=]\s*[-+.\d]")
_NEXT_AXIS = re.compile(r"[^\w]*([XYZxyz])\s*[:=]\s*")
_MEMBER = re.compile(r"[^\w]*([A-Za-z]\w*)\s*=\s*[(\[]?\s*")
_UNIT = re.compile(r"\s?([a-zA-Z°/^0-9]+)")
_TICKS = {"TimeUS": "time [us]", "TimeMS": "time [ms]"}
#: Sensors by their numbers in Sensorstream's lines.
_SENSORS = {"1": ("lat", "lon", "alt"), "3": columns.ACCEL, "4": columns.GYRO}
_SINGLE = ("8", "85", "86")  # of one value: time, pressure, temperature
_NAMING = re.compile(r"FMT, *\d+|\$COL,")
_MARKS = " \t,;|:=()[]{}<>-"
_LOOKED_AT = 200
_MANY = 20_000  # rows in which the clock that all sensors share is looked for
_FEWEST, _SHARE = 10, 0.3  # rows of a form, and their share of all, by which it is recognised
_TRIPLED = 0.8  # share of lines with a name, a value and a unit in turn
_PAIRED = 0.9  # share of lines with a name before each number
_MISSING = ("", "nan", "null", "none", "na", "n/a", "-")
_RECEIVER = re.compile(r"gps|gnss|loc|pos|lat", re.IGNORECASE)


def text_of(path: Path) -> Iterator[str]:
    """Lines of a file that are neither empty nor comments."""
    with path.open(encoding=lines.encoding_of(lines.check_file(path), path), errors="replace") as stream:
        for row in stream:
            if (text := lines.decode(row.strip())) and not text.startswith(COMMENTS):
                yield text


def delimiter_of(row: str) -> str:
    """What parts the fields of a line."""
    return next((character for character in ";\t," if character in row), " ")


def fields_of(row: str, delimiter: str) -> list[str]:
    """Fields of a line without the blanks around them."""
    return row.split() if delimiter == " " else [field.strip() for field in row.split(delimiter)]


def form_of(rows: Sequence[str], path: Path) -> str | None:
    """Which of the forms the first lines of a file have.

    Parameters
    ----------
    rows : sequence of str
    path : Path

    Returns
    -------
    {"numbered", "pairs", "gaps", "free"} or None
    """
    rows = rows[:_LOOKED_AT]
    if sum("ax" in _numbered(row) for row in rows) > _PAIRED * len(rows):
        return "numbered"
    if sum(len(_pairs(row)[1]) > 3 for row in rows) > _PAIRED * len(rows):
        return "pairs"
    if _has_gaps(rows, path):
        return "gaps"
    return "free" if is_free(rows) and not _groups(path)[1] else None  # words may stand in a table's column


def is_free(rows: Sequence[str]) -> bool:
    """Whether most lines are a few sets of words with numbers between them.

    Parameters
    ----------
    rows : sequence of str
    """
    forms = Counter(form for row in rows if _LABEL.search(_rest(row)[1]) and (form := _NUMBER.sub("#", _rest(row)[1])))
    repeated = [n for form, n in forms.items() if n >= _FEWEST and form.count("#") > 2]  # a line for each sensor
    return sum(repeated) > _SHARE * len(rows)


def are_named(rows: Sequence[str]) -> bool:
    """Whether lines name the columns of other lines.

    Parameters
    ----------
    rows : sequence of str
    """
    return any(map(_NAMING.match, rows))


def _pairs(row: str) -> tuple[str, Row]:
    """The last lone word of a line before the first of its names with a number behind each, and these."""
    kind, numbers, k = "", {}, 0
    fields = fields_of(row, delimiter_of(row))
    if fields and _STAMP.match(fields[0] + " "):
        numbers["time"] = fields[0]
        k = 1
    while k < len(fields):
        if not WORD.fullmatch(fields[k]):
            k += 1
        elif k + 1 < len(fields) and lines.is_number(fields[k + 1]):
            numbers[fields[k]] = fields[k + 1]
            k += 2
        else:
            kind, k = fields[k] if len(fields[k]) > 3 else kind, k + 1
    if any("time" in name and name != "time" for name in numbers):
        numbers.pop("time", None)  # when it arrived; the device's own is better
    return kind, numbers


def paired_rows(path: Path) -> Iterator[tuple[str, Row]]:
    """Rows by the kind that each line names.

    Parameters
    ----------
    path : Path
    """
    for text in text_of(path):
        yield _pairs(text)


def are_triples(rows: Sequence[str]) -> bool:
    """Whether most lines have a name, a value and a unit in turn.

    Parameters
    ----------
    rows : sequence of str
    """
    return sum(len(_triples(row)[1]) > 1 for row in rows) > _TRIPLED * len(rows)


def _triples(row: str) -> tuple[str, dict[str, list[str]]]:
    """Kind of a line, the last word before its names, and samples by names with units; no names if it is no such."""
    try:
        fields = next(csv.reader([row]), [])
    except csv.Error:  # a field of more than its limit
        return "", {}
    start = next((k for k in range(1, len(fields) - 1) if WORD.fullmatch(fields[k]) and _samples(fields[k + 1])), 0)
    if not start:
        return "", {}
    out: dict[str, list[str]] = {}
    for k in range(start, len(fields) - 2, 3):
        name, unit = fields[k], fields[k + 2]
        samples = _samples(fields[k + 1])
        if not name or not fields[k + 1]:
            continue
        if not WORD.fullmatch(name) or lines.is_number(unit):
            return "", {}
        if samples:
            out[f"{name} [{unit}]" if unit and text_head.is_unit(unit) else name] = samples
        if samples and unit == "counts":
            out[f"{name} [{unit}]"] = out.pop(name)
    return next((field for field in reversed(fields[:start]) if WORD.fullmatch(field)), ""), out


def _samples(field: str) -> list[str]:
    samples = field.split("|")
    return samples if all(map(lines.is_number, samples)) else []


def triple_rows(path: Path) -> Iterator[tuple[str, Row]]:
    """Samples by the kind of their line, with one time: whole seconds, thousandths and offsets of samples added.

    Parameters
    ----------
    path : Path
    """
    for text in text_of(path):
        kind, samples = _triples(text)
        raw = [name for name in samples if name.endswith("[counts]")]
        if len(raw) < len([name for name in samples if len(samples[name]) > 1]):  # the same in a unit stands beside
            samples = {name: x for name, x in samples.items() if name not in raw}
        lengths = {len(x) for name, x in samples.items() if len(x) > 1}
        if lengths == {3} and sum(len(x) == 3 for x in samples.values()) == 1:  # a vector
            name, x = next((name, x) for name, x in samples.items() if len(x) == 3)
            samples.pop(name)
            samples |= {f"{name.partition(' [')[0]}_{axis}": [value] for axis, value in zip("xyz", x, strict=True)}
            lengths = set()
        if len(lengths) > 1 or not samples:
            yield kind, {}
            continue
        for k in range(max(lengths, default=1)):
            yield kind, _with_one_time({name: x[k] if len(x) > 1 else x[0] for name, x in samples.items()})


def _with_one_time(row: Row) -> Row:
    """A row with thousandths and offsets put to the time of whole seconds that they are beside."""
    base = next((name for name in row if name in ("timestamp [s]", "time [s]")), None)
    if base is None:
        return row
    stem = base.partition(" ")[0]
    more = [name for name in row if name.startswith(f"{stem}_ms ") or re.match(r"(sample_)?time_offset \[ms\]", name)]
    if not more or not row[base].isdigit() or not all(row[name].isdigit() for name in more):
        return row
    ms = 1000 * int(row[base]) + sum(int(row[name]) for name in more)
    return {f"{stem} [s]": f"{ms // 1000}.{ms % 1000:03d}"} | {n: x for n, x in row.items() if n not in (base, *more)}


def named_rows(path: Path) -> Iterator[tuple[str, Row]]:
    """Rows by their kind, and by the number of the unit where there are several, with the columns that lines name.

    Parameters
    ----------
    path : Path
    """
    names: dict[str, list[str]] = {}
    units: dict[str, list[str]] = {}
    for text in text_of(path):
        fields = fields_of(text, ",")
        if fields[0] == "FMT" and len(fields) > 6:
            names[fields[3]] = [_TICKS.get(name, name) for name in fields[5:]]
        elif fields[0] in ("$COL", "$UNIT") and len(fields) > 3:
            (names if fields[0] == "$COL" else units)[f"${fields[1]}"] = fields[2:]
        elif (columns_of := names.get(fields[0])) is not None:
            if len(fields) != len(columns_of) + 1:
                yield "", {}
                continue
            stated = [*units.get(fields[0], []), *[""] * len(columns_of)]
            row = {
                f"{name} [{unit}]" if unit and text_head.is_unit(unit) else name: x
                for name, unit, x in zip(columns_of, stated, fields[1:], strict=False)
            }
            yield f"{fields[0]}{row.get('I', '0').strip('0')}", row


def _numbered(text: str) -> Row:
    """Values of a line by the numbers of their sensors; nothing if it is no such line."""
    fields = fields_of(text, ",")
    if len(fields) < 5 or not all(map(lines.is_number, fields)):
        return {}
    row, k = {"time": fields[0]}, 1
    while k < len(fields):
        if not (fields[k].isdigit() and len(fields[k]) < 3):
            return {}
        row |= dict(zip(_SENSORS.get(fields[k], ()), fields[k + 1 : k + 4], strict=False))
        k += 2 if fields[k] in _SINGLE else 4
    return row if k == len(fields) else {}


def numbered_rows(path: Path) -> Iterator[tuple[str, Row]]:
    """Samples of the IMU, and rows of fixes where a line has one.

    Parameters
    ----------
    path : Path
    """
    for text in text_of(path):
        row = _numbered(text)
        place = {name: row.pop(name) for name in _SENSORS["1"] if name in row}
        yield "imu", row
        if place:
            yield "gnss", {"time": row["time"]} | place


def _has_gaps(rows: Sequence[str], path: Path) -> bool:
    """Whether a table's rows are one sensor's each: its own fields filled, another's empty."""
    opening, groups = _groups(path)
    if opening is None or len(groups) < 2:
        return False
    patterns = Counter(
        tuple(_are_filled(fields, group) for group in groups)
        for row in rows
        if len(fields := opening.table.split(row)) == len(opening.fields)
    )
    alone = [pattern for pattern, n in patterns.items() if any(pattern) and not all(pattern) and n > 1]
    return not all(pattern[0] for pattern in alone)


def _groups(path: Path) -> tuple[text_head.Opening | None, list[list[int]]]:
    """Head of a table, and places of each sensor's columns, of the quickest first."""
    try:
        opening = text_head.open_text(path, ReadHints())
    except SchulerError:
        return None, []
    names = [column and column[0] for column in text_head.columns_of(opening)]
    if len(names) != len(opening.fields):
        return None, []
    triads = [
        [names.index(name) for name in triad] for triad in (columns.ACCEL, columns.GYRO) if set(triad) <= set(names)
    ]
    place = [[names.index("lat"), names.index("lon")]] if {"lat", "lon"} <= set(names) else []
    return opening, triads + place


def _are_filled(fields: Sequence[str], group: Sequence[int]) -> bool:
    return all(fields[k].lower() not in _MISSING for k in group)


def rows_with_gaps(path: Path) -> Iterator[tuple[str, Row]]:
    """Fields of each row that are filled, by the names of the header.

    Parameters
    ----------
    path : Path
    """
    opening, groups = _groups(path)
    assert opening is not None
    assert opening.header is not None
    names = list(opening.header[1])
    for k, name in enumerate(names):
        if names.count(name) > 1:
            names[k] = f"{name}.{k}"
    times, others = _clocks(opening, groups)
    for _, fields in opening.table.rows():
        if len(fields) != len(names):
            yield "", {}
            continue
        kept = {k for k, field in enumerate(fields) if field.lower() not in _MISSING} - others
        whole = {k for group in groups if _are_filled(fields, group) for k in group}
        yield ("", {names[k]: fields[k] for k in sorted(kept)}) if whole and times <= kept else ("", {})


def _clocks(opening: text_head.Opening, groups: list[list[int]]) -> tuple[set[int], set[int]]:
    """Places of the clocks that rows of all sensors have, and of those that are one sensor's own, of no use beside."""
    times = {k for k, column in enumerate(text_head.columns_of(opening)) if column is not None and column[0] == "t"}
    everywhere = set(times)
    for _, fields in itertools.islice(opening.table.rows(), _MANY):
        if len(fields) == len(opening.fields) and any(_are_filled(fields, group) for group in groups):
            everywhere = {k for k in everywhere if fields[k].lower() not in _MISSING}
    return (everywhere, times - everywhere) if everywhere else (times, set())


def _rest(row: str) -> tuple[Row, str]:
    """Stamp before a line, and the line without it."""
    if prefix := PREFIX.match(row):
        return {"millis": prefix[1]}, row[prefix.end() :]
    stamp = _STAMP.match(row)
    rest = row[stamp.end() :] if stamp else row
    level = _LEVEL.match(rest)
    return ({"time": stamp[1].replace(",", ".")} if stamp else {}), rest[level.end() :] if level else rest


def free_rows(path: Path) -> Iterator[tuple[str, Row]]:
    """Numbers by the words before them; sentences of NMEA as they are; lines of a sensor each in turn as one row.

    Parameters
    ----------
    path : Path
    """
    block: dict[str, Row] = {}  # of sensors that have a line each, by their names
    for text in text_of(path):
        if sentence := _SENTENCE.search(text):
            yield SENTENCES, {"": sentence[0].strip()}
            continue
        row, rest = _rest(text)
        numbers = _labelled(rest)
        clocks = [n for n in numbers if (c := columns.recognise(n)) is not None and c[0] == "t"]
        if any(name.split()[0] != "T" for name in clocks):  # a T beside a stamp is a temperature
            row = {}  # when it arrived; the device's own is better
        if _FIRST_AXIS.search(rest) and (named := _one_sensor(numbers)):
            if named in block:
                yield _joined(block)
                block = {}
            block[named] = row | numbers
            continue
        grouped = _GROUP.search(rest[: number.start()]) if (number := _NUMBER.search(rest)) else None
        kind = " ".join(numbers) if grouped else _NUMBER.sub("", rest).strip()  # words of a state may change
        yield kind if numbers else "", row | numbers
    if block:
        yield _joined(block)


def _one_sensor(numbers: Row) -> str:
    """Sensor whose three axes are all that a line has; empty if it is no such line."""
    names = [name.partition(" [")[0] for name in numbers]
    stems = {name[:-2] for name in names}
    return stems.pop() if len(stems) == 1 and sorted(name[-2:].upper() for name in names) == ["_X", "_Y", "_Z"] else ""


def _joined(block: dict[str, Row]) -> tuple[str, Row]:
    """One row of the lines of several sensors, at the time of the first."""
    row: Row = {}
    for one in block.values():
        row = one | row
    return " ".join(block), row


def _labelled(text: str) -> Row:
    """Numbers of a line: three of one label are its axes, two of a place latitude and longitude, six two sensors'."""
    values: dict[str, list[str]] = {}
    label, group, of_group, sensor, at = "", "", "", "", 0
    for number in _NUMBER.finditer(text):
        if number.start() < at:  # the 2 of m/s^2
            continue
        between = text[at : number.start()]
        if opened := _GROUP.search(between):
            group, of_group, label, sensor = opened[1], opened[2] or "", f"{opened[1]}_{opened[3]}", ""
        elif opened := _AXIS.search(between):
            sensor, label, group = opened[1], f"{opened[1]}_{opened[2]}", ""
        elif sensor and (axis := _NEXT_AXIS.fullmatch(between)):
            label = f"{sensor}_{axis[1]}"
        elif group and (member := _MEMBER.fullmatch(between)):
            label = f"{group}_{member[1]}"
        elif re.search(r"[A-Za-z]", between.strip(_MARKS)):
            label, group, sensor = re.split(r"[\s,;|]+", between.strip(_MARKS))[-1].strip(_MARKS), "", ""
        unit = _UNIT.match(text, number.end())
        at = unit.end() if unit and text_head.is_unit(unit[1]) else number.end()
        stated = unit[1] if unit and at > number.end() else of_group if group and text_head.is_unit(of_group) else ""
        if sensor and stated:  # of all three, behind the last
            stem = "RotationRate" if sensor == "Rotation" and stated.endswith("/s") else sensor
            label = f"{stem}_{label[-1]}"
            values = {
                f"{stem}_{n[-1]} [{stated}]" if re.fullmatch(f"{sensor}_.", n) else n: x for n, x in values.items()
            }
        values.setdefault(f"{label} [{stated}]" if stated else label, []).append(number[0])
    row: Row = {}
    for name, numbers in values.items():
        row.update(zip(_names(name, len(numbers)), numbers, strict=True))
    return row


def _names(label: str, count: int) -> list[str]:
    stem, bracket, unit = label.partition(" [")
    sensors = stem.split("/")
    if count == 1:
        return [label]
    if count == 2 and _RECEIVER.search(stem):
        return ["lat", "lon"]
    if count == 3:
        return ["lat", "lon", "alt"] if _RECEIVER.search(stem) else [f"{stem}_{x}{bracket}{unit}" for x in "xyz"]
    if count == 3 * len(sensors):
        return [f"{sensor}_{axis}" for sensor in sensors for axis in "xyz"]
    return [f"{stem}_{k}" for k in range(1, count + 1)]
