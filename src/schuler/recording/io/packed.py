"""Files that hold several tables: lines that each say what they are, JSON, labelled values, Racelogic's VBOX.

A file is unpacked to tables of text, a kind of line each, which are then read as files of a folder are: ``log.jsonl``
holds ``log.jsonl/accel.csv``. What a line means is in it alone:

- ``{"t": 1, "acc": [0.1, 0.2, 9.8]}``, a JSON object a line, one list of them in the file, or an object with
  a list a column; kinds by a key such as ``class`` or ``sensor``, or by the keys it has.
- ``{"speed": {"unit": "km/h", "values": [[t, x], ...]}, ...}``, a signal each with times of its own.
- ``t:12 ax:0.1 ay:0.2``, labels and numbers.
- ``ACCE;5.1;0.1;0.2;9.8``, a word and numbers; a comment may name the columns.
- a column of such words in a table, ``timestamp,sensor,x,y,z``.
- sentences of NMEA between rows of numbers, ``IMU,4000,0.1,...``.
- UTF-16, which is one table or several as the same text in UTF-8 is.
- VBOX: sections, minutes of latitude and of longitude to the west, times of day.
"""

from __future__ import annotations

import atexit
import csv
import re
import tempfile
from collections import Counter, defaultdict
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack
from functools import lru_cache
from pathlib import Path
from typing import TextIO, TypeAlias

from schuler.exceptions import FileFormatError, SchulerError
from schuler.recording.io import columns, json_tables, line_forms, lines, satellite_rows, topic_rows

Row: TypeAlias = dict[str, str]
_LOOKED_AT = 200  # lines by which a file is recognised
_NEARLY_ALL = 0.9  # share of lines that are of the form, and of rows that have a column
_MOST_KINDS, _LONGEST_NAME = 40, 60
_LABELLED = re.compile(r"([A-Za-z_][\w.]*)\s*[:=]\s*([+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?)")
_NMEA = re.compile(r"\$G[A-Z](GGA|RMC),[ -~]*\*[0-9A-Fa-f]{2}")
_NAMELESS = ("", "1")  # first columns of tables without names
_BETWEEN = re.compile(r"[\s,;|]*")
_BINARY = (".parquet", ".mat", ".npy", ".npz", ".zip", ".gz", ".bag", ".db3", ".mcap", ".bin", ".ubx", ".sbf")
_RECEIVER = re.compile(r"gnss|gps|location|(^|_)fix", re.IGNORECASE)  # not position, which may be local
_SUFFIX = ".csv"
_WIDE = (b"\xff\xfe", b"\xfe\xff")  # marks of UTF-16, in which Excel writes "Unicode text"


def kind_of(path: Path) -> str | None:
    """Form of a file that holds several tables, from its first lines; None if it is none.

    Parameters
    ----------
    path : Path

    Returns
    -------
    {"wide", "json", "json-list", "json-columns", "labels", "words", "column", "beside-nmea", "vbox"} or None
    """
    from schuler.recording.formats import registry
    from schuler.recording.io.satellite_files import kinds_of

    if path.suffix.lower() in _BINARY or not path.is_file():
        return None
    try:
        head = lines.check_file(path)
        if head.startswith(_WIDE) and registry.find(head, path) is None:
            return "wide"
        encoding = lines.encoding_of(head, path)
    except SchulerError:
        return None
    text = head.decode(encoding, errors="replace")
    cut = len(head) < path.stat().st_size
    if registry.find(head, path) is not None:
        return None
    if satellite_rows.has_places(text):
        return "places"
    if _is_beside_nmea(text, cut=cut):
        return "beside-nmea"
    if received := kinds_of(path, head):
        return "free" if received == ("gnss",) and line_forms.is_free(text.splitlines()) else None
    if text.lstrip("\ufeff \r\n\t[").startswith("{"):
        return json_tables.kind_of(text, cut=cut)
    if "[column names]" in text and "[data]" in text:
        return "vbox"
    rows = [
        row for row in text.splitlines()[: _LOOKED_AT + 1] if row.strip() and not row.startswith(line_forms.COMMENTS)
    ]
    rows = rows[:-1] if cut or len(rows) > _LOOKED_AT else rows
    rows = rows[1:] if rows and not _is_of_form(rows[0]) else rows  # a banner of a terminal
    if len(rows) < 3:
        return None
    if sum(map(_is_labelled, rows)) > _NEARLY_ALL * len(rows):
        return "labels"
    if line_forms.are_named(rows):
        return "named"
    if topic_rows.are_messages(rows):
        return "messages"
    if line_forms.are_triples(rows):
        return "triples"
    delimiter = line_forms.delimiter_of(rows[-1])
    fields = [line_forms.fields_of(row, delimiter) for row in rows]
    kinds = _kind_column(text.splitlines(), delimiter)
    if kinds is None and _are_kinds([row[0] for row in fields]) and all(len(row) > 3 for row in fields):
        return None if _names_series(fields[0]) else "words"
    if kinds is not None:
        return "column"
    return line_forms.form_of(rows, path)


def _is_beside_nmea(text: str, *, cut: bool) -> bool:
    """Whether lines are NMEA or rows of as many numbers each, with a word before them or none."""
    rows = text.splitlines()
    rows = [row.strip() for row in (rows[1:-1] if cut else rows[1:]) if row.strip()]  # a log may begin within a line
    others = [line_forms.fields_of(row, line_forms.delimiter_of(row)) for row in rows if not row.startswith("$")]
    if not others or len(others) == len(rows) or len(others) < 0.3 * len(rows):
        return False
    width = Counter(map(len, others)).most_common(1)[0][0]
    good = sum(len(row) == width and all(map(lines.is_number, row[1:])) for row in others)
    return width > 5 and good > _NEARLY_ALL * len(others) and any(map(_NMEA.fullmatch, rows))


def _beside_nmea(path: Path) -> Iterator[tuple[str, Row]]:
    """Sentences as they are, and rows of numbers without names."""
    for text in line_forms.text_of(path):
        fields = line_forms.fields_of(text, line_forms.delimiter_of(text))
        first = [] if line_forms.WORD.fullmatch(fields[0]) else fields[:1]
        numbers = [*first, *fields[1:]]
        if text.startswith("$"):
            yield line_forms.SENTENCES, {"": text}
        else:
            is_row = len(numbers) > 5 and all(map(lines.is_number, numbers))
            yield f"{len(numbers)} columns", {str(k): x for k, x in enumerate(numbers, 1)} if is_row else {}


def _is_of_form(row: str) -> bool:
    return (
        _is_labelled(row)
        or line_forms.WORD.fullmatch(line_forms.fields_of(row, line_forms.delimiter_of(row))[0]) is not None
    )


@lru_cache(maxsize=64)
def _unpacked(path: Path, stamp: tuple[int, int]) -> tuple[tuple[str, ...], Path, int]:
    """Names of the tables of a file, the folder they are in, and lines of no table.

    The file is gone through twice, for the columns that nearly all rows of a table have, and to write them.
    """
    kind = str(kind_of(path))
    if kind == "wide":
        return _unpacked_narrow(path)
    rows = _ROWS[kind]
    counts: defaultdict[str, Counter[str]] = defaultdict(Counter)
    sizes: Counter[str] = Counter()
    for name, row in rows(path):
        if row:
            table = _table_name(name, row)
            counts[table].update(row.keys())
            sizes[table] += 1
    keys = {
        name: [key for key, count in counts[name].items() if count >= _NEARLY_ALL * size]
        for name, size in sizes.items()
        if size > 2
    }
    holder = tempfile.TemporaryDirectory(prefix="schuler-")
    atexit.register(holder.cleanup)
    left_out = 0
    with ExitStack() as stack:
        files: dict[str, TextIO] = {}
        for name, row in rows(path):
            table = _table_name(name, row)
            if not row or not keys.get(table) or not all(key in row for key in keys[table]):
                left_out += 1
                continue
            if table not in files:
                file = (Path(holder.name) / f"{table}{_SUFFIX}").open("w", encoding="utf-8", newline="")
                files[table] = stack.enter_context(file)
                if keys[table][0] not in _NAMELESS:
                    csv.writer(file, lineterminator="\n").writerow(_places(table, keys[table], row))
            values = [row[key] for key in keys[table]]
            if table == line_forms.SENTENCES:
                files[table].write(f"{values[0]}\n")
            else:
                csv.writer(files[table], lineterminator="\n").writerow(values)
    return tuple(sorted(f"{name}{_SUFFIX}" for name in files)), Path(holder.name), left_out


def _unpacked_narrow(path: Path) -> tuple[tuple[str, ...], Path, int]:
    """The same of a file of UTF-16: what the same text in UTF-8 holds."""
    holder = tempfile.TemporaryDirectory(prefix="schuler-")
    atexit.register(holder.cleanup)
    narrow = Path(holder.name) / f"{path.stem}{_SUFFIX}"
    narrow.write_text(path.read_text(encoding="utf-16", errors="replace"), encoding="utf-8")
    return ((narrow.name,), narrow.parent, 0) if kind_of(narrow) is None else _unpacked(narrow, _stamp(narrow))


def _table_name(kind: str, row: Row) -> str:
    return re.sub(r"\W+", "_", kind).strip("_")[:_LONGEST_NAME] or _series(tuple(row))


@lru_cache(maxsize=256)
def _series(keys: tuple[str, ...]) -> str:
    """Name of a table by what its columns are: those of one series are one table."""
    held = {column[0] for column in columns.recognise_all(keys) if column is not None}
    halves = [half for half, triad in (("accel", columns.ACCEL), ("gyro", columns.GYRO)) if set(triad) <= held]
    series = columns.series_of(held)
    return halves[0] if len(halves) == 1 and len(series) == 1 else "_".join(series) or "others"


def tables(path: Path) -> tuple[str, ...]:
    """Names of the tables that a file holds; none of other files.

    Parameters
    ----------
    path : Path

    Raises
    ------
    FileFormatError
        If what began as such a file goes on as something else.
    """
    return () if kind_of(path) is None else _unpacked(path, _stamp(path))[0]


def resolved(path: Path) -> Path:
    """Where a table is read from: ``log.jsonl/accel.csv`` in a file's unpacked tables, other files where they are.

    Parameters
    ----------
    path : Path
    """
    if path.exists() or not path.parent.is_file() or kind_of(path.parent) is None:
        return path
    names, folder, _ = _unpacked(path.parent, _stamp(path.parent))
    if path.name not in names:
        raise FileFormatError(f"expected one of its tables {', '.join(names) or '(it has none)'}", path)
    return folder / path.name


def note_on(path: Path) -> str:
    """Note on lines that no table of a file takes; empty if there are none.

    Parameters
    ----------
    path : Path
        As ``resolved`` takes it.
    """
    count = 0 if path.exists() else _unpacked(path.parent, _stamp(path.parent))[2]
    return f"{count} lines of {path.parent.name} are of no table, or lack columns of theirs." if count else ""


def _stamp(path: Path) -> tuple[int, int]:
    stat = path.stat()
    return stat.st_mtime_ns, stat.st_size


def _places(name: str, keys: list[str], row: Row) -> list[str]:
    """Names of columns, latitude, longitude and height where a receiver's are called x, y, z."""
    if not _RECEIVER.search(name) or not {"x", "y", "z"} <= set(keys):
        return keys
    place = [row[key] for key in ("x", "y")]
    if not all(map(lines.is_number, place)) or abs(float(place[0])) > 90.0 or abs(float(place[1])) > 180.0:
        return keys
    return [{"x": "lat", "y": "lon", "z": "alt"}.get(key, key) for key in keys]


def _is_labelled(row: str) -> bool:
    """Whether a line is labels with numbers, at least four, and nothing else."""
    pairs = list(_LABELLED.finditer(row))
    if len(pairs) < 4:
        return False
    start = prefix.end() if (prefix := line_forms.PREFIX.match(row)) else 0
    ends = [start, *(match.end() for match in pairs)]
    between = [row[a : match.start()] for a, match in zip(ends, pairs, strict=False)]
    return all(map(_BETWEEN.fullmatch, (*between, row[ends[-1] :])))


def _labels(path: Path) -> Iterator[tuple[str, Row]]:
    for text in line_forms.text_of(path):
        row = dict(_LABELLED.findall(text)) if _is_labelled(text) else {}
        if row and (prefix := line_forms.PREFIX.match(text)):
            row = {"millis": prefix[1]} | row
        yield "", row


def _are_kinds(words: list[str]) -> bool:
    """Whether words are names of a few kinds, each of which comes again."""
    kinds = Counter(words)
    return (
        all(map(line_forms.WORD.fullmatch, kinds)) and 1 < len(kinds) <= _MOST_KINDS and len(kinds) < 0.3 * len(words)
        and not any(lines.is_value(word) for word in kinds)
    )  # fmt: skip


def _words(path: Path) -> Iterator[tuple[str, Row]]:
    headers = _commented_headers(path)
    delimiter = ""
    for text in line_forms.text_of(path):
        delimiter = delimiter or line_forms.delimiter_of(text)
        kind, *fields = line_forms.fields_of(text, delimiter)
        names = headers.get((kind, len(fields))) or _guessed(kind, fields)
        yield kind, dict(zip(names, fields, strict=True)) if line_forms.WORD.fullmatch(kind) else {}


def _guessed(kind: str, fields: list[str]) -> list[str]:
    """Names of a kind's columns where no comment states them: a time, then an axis each or a place."""
    axes = ("lat", "lon", "alt") if _RECEIVER.search(kind) else ("x", "y", "z")
    return ["t", *axes, *(f"column_{k}" for k in range(5, len(fields) + 1))][: len(fields)]


def _commented_headers(path: Path) -> dict[tuple[str, int], list[str]]:
    """Columns of kinds as comments name them, one time among them."""
    headers = {}
    for row in lines.check_file(path).decode("latin-1").splitlines():
        text = row.lstrip("#%/ ").strip()
        kind, *names = line_forms.fields_of(text, line_forms.delimiter_of(text)) or [""]
        if row.startswith(line_forms.COMMENTS) and len(names) > 3 and line_forms.WORD.fullmatch(kind):
            times = [k for k, name in enumerate(names) if "time" in name.lower()]
            for k in times[1:]:
                names[k] = f"other_{k}"
            if times:
                unit = re.search(r"[\[(].*", names[times[0]])
                names[times[0]] = f"t {unit[0] if unit else ''}".strip()
            headers[kind, len(names)] = [_axis_name(kind, name) for name in names]
    return headers


def _axis_name(kind: str, name: str) -> str:
    """A column's name without what stands before an axis: of ``Acc_X(m/s^2)`` the ``x (m/s^2)``."""
    match = re.fullmatch(r"[A-Za-z]+[_ ]([XYZxyz])\s*([\[(].*)?", name)
    unit = "" if match is None or match[2] is None else f" {match[2]}"
    return name if match is None or _RECEIVER.search(kind) else match[1].lower() + unit


def _names_series(head: list[str]) -> bool:
    """Whether a header names whole samples, beside which words are remarks; x, y, z alone may be any sensor's."""
    named = (column[0] for column in columns.recognise_all(head) if column is not None)
    return columns.series_of(named) not in ([], ["reference"])


def _kind_column(rows: Sequence[str], delimiter: str) -> int | None:
    """The column of a table with a header that names the kind of each row; None if there is none."""
    table = [
        line_forms.fields_of(row, delimiter) for row in rows if row.strip() and not row.startswith(line_forms.COMMENTS)
    ][:_LOOKED_AT]
    if len(table) < 10 or delimiter == " " or any(map(lines.is_value, table[0])):
        return None
    body = [row for row in table[1:] if len(row) == len(table[0])]
    if len(body) < _NEARLY_ALL * (len(table) - 1) - 1 or len(table[0]) < 4:
        return None
    if _names_series(table[0]):
        return None
    kinds = [k for k, name in enumerate(table[0]) if _is_kind_key(name) and _are_kinds([r[k] for r in body])]
    return kinds[0] if len(kinds) == 1 else None


def _axis_of_value(name: str) -> str:
    """The axis that a value of any sensor is: x for ``Value 1``, ``values[0]``, ``MeasurementX``; or its name."""
    if axis := re.fullmatch(r"(?:val(?:ue)?|measurement|reading|data)s?[ _]?([xyz])", name.lower()):
        return axis[1]
    match = re.fullmatch(r"val(?:ue)?s?[ _\[]?([0-3])\]?", name.lower())
    return name if match is None else f"value{match[1]}"


def _is_kind_key(name: str) -> bool:
    word = name.strip("\"' ").lower()
    return word in json_tables.KIND_KEYS or re.sub(r"[ _]?(type|name)$", "", word) in json_tables.KIND_KEYS


def _column(path: Path) -> Iterator[tuple[str, Row]]:
    rows = line_forms.text_of(path)
    first = next(rows)
    delimiter = line_forms.delimiter_of(first)
    head = [_axis_of_value(name.strip("\"'")) for name in line_forms.fields_of(first, delimiter)]
    at = _kind_column(lines.check_file(path).decode("latin-1").splitlines(), delimiter)
    assert at is not None
    values = [name for name in head if name in ("value0", "value1", "value2", "value3")][:3]
    head = ["xyz"[values.index(name)] if name in values else name for name in head]
    for text in rows:
        fields = line_forms.fields_of(text, delimiter)
        if len(fields) != len(head):
            yield "", {}
            continue
        yield fields[at], {name: x for k, (name, x) in enumerate(zip(head, fields, strict=True)) if k != at and x}


#: Names of VBOX's columns, others as they are; latitude and longitude are in minutes, the latter to the west.
_VBOX = {
    "velocity": "speed [km/h]", "velocity kmh": "speed [km/h]", "heading": "course [deg]", "height": "alt [m]",
    "sats": "ns", "satellites": "ns", "vert-vel": "-", "vertical velocity m/s": "-", "x_accel": "ax [g]",
    "y_accel": "ay [g]", "z_accel": "az [g]", "roll_rate": "gx [deg/s]", "pitch_rate": "gy [deg/s]",
    "yaw_rate": "gz [deg/s]",
}  # fmt: skip


def _vbox(path: Path) -> Iterator[tuple[str, Row]]:
    """Rows of a VBOX file with the date of its first line (day before month) and times of day, UTC."""
    section, names, day = "", [], ""
    for text in line_forms.text_of(path):
        if created := re.match(r"File created on (\d\d)/(\d\d)/(\d{4})", text):
            day = f"{created[3]}-{created[2]}-{created[1]}T"
        if text.startswith("["):
            section = text.strip("[] ").lower()
        elif section == "column names":
            names = text.lower().split()
        elif section == "data":
            yield "vbox", _vbox_row(names, text.split(), day)


def _vbox_row(names: list[str], fields: list[str], day: str) -> Row:
    raw = dict(zip(names, fields, strict=False))
    clock, lat, lon = raw.pop("time", ""), raw.pop("lat", ""), raw.pop("long", "")
    if len(names) != len(fields) or not re.fullmatch(r"\d{6}(\.\d*)?", clock):
        return {}
    row = {"time": f"{day}{clock[:2]}:{clock[2:4]}:{clock[4:]}{'Z' if day else ''}"}
    if lines.is_number(lat) and lines.is_number(lon):
        row |= {"lat": f"{float(lat) / 60.0:.9f}", "lon": f"{-float(lon) / 60.0:.9f}"}
    return row | {_VBOX.get(name, name): field.lstrip("+") for name, field in raw.items() if _VBOX.get(name) != "-"}


_ROWS: dict[str, Callable[[Path], Iterator[tuple[str, Row]]]] = {
    "json": json_tables.object_lines, "json-list": json_tables.list_of_objects, "json-columns": json_tables.lists,
    "labels": _labels, "words": _words,
    "column": _column, "beside-nmea": _beside_nmea, "vbox": _vbox,
    "named": line_forms.named_rows, "numbered": line_forms.numbered_rows,
    "triples": line_forms.triple_rows, "pairs": line_forms.paired_rows, "gaps": line_forms.rows_with_gaps,
    "free": line_forms.free_rows, "messages": topic_rows.message_rows,
    "places": satellite_rows.place_rows,
}  # fmt: skip
