"""Rows of JSON: an object a line, a list of objects, lists as columns, signals as lists of pairs."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any, TypeAlias

from schuler.exceptions import FileFormatError
from schuler.recording.io import line_forms, text_head
from schuler.recording.io.raw import HUGE

Row: TypeAlias = dict[str, str]
_LOOKED_AT = 200  # lines by which a file is recognised
_NEARLY_ALL = 0.9  # share of lines that are objects
_LEAST_ROWS = 20  # of lists in a document that are a log's, and no matrix
_LARGEST_LIST = 1 << 30  # of a JSON list, which is read as a whole [bytes]
#: Keys whose word says what kind of record an object is.
KIND_KEYS = ("sensor", "class", "type", "kind", "topic", "msg", "message", "name", "event")


def kind_of(text: str, *, cut: bool) -> str | None:
    """Whether text begins as a list of objects, has an object a line, or is one object with columns as lists."""
    if text.lstrip("\ufeff \r\n\t").startswith("["):
        try:
            first, _ = json.JSONDecoder().raw_decode(text.lstrip("\ufeff \r\n\t[").lstrip())
        except (ValueError, RecursionError):
            return None
        return "json-list" if isinstance(first, dict) else None
    rows = [row for row in text.splitlines() if row.strip()]
    rows = rows[:-1] if cut else rows
    good = 0
    for row in rows[:_LOOKED_AT]:
        try:
            good += isinstance(json.loads(row), dict)
        except (ValueError, RecursionError):
            continue
    if (good == 0 or len(rows) < 3) and re.search(r'"\w+"\s*:\s*\[\s*(\[?\s*[-+\d.]|\{)', text):
        return "json-columns"
    return "json" if len(rows) > 2 and good > _NEARLY_ALL * min(len(rows), _LOOKED_AT) else None


def object_lines(path: Path) -> Iterator[tuple[str, Row]]:
    """An object a line, by what it says it is."""
    for text in line_forms.text_of(path):
        try:
            value = json.loads(text)
        except (ValueError, RecursionError):
            value = None
        yield _object(value) if isinstance(value, dict) else ("", {})


def list_of_objects(path: Path) -> Iterator[tuple[str, Row]]:
    """The objects of one list, by what they say they are."""
    for value in _document(path):
        yield _object(value) if isinstance(value, dict) else ("", {})


def lists(path: Path) -> Iterator[tuple[str, Row]]:
    """Rows of each object whose lists are of one length, in a document with lists as long as a log's."""
    document = _document(path)
    if isinstance(document, dict) and (signals := _signals(document)):
        yield from _together(signals)
        return
    for name, entry in document.items() if isinstance(document, dict) else ():
        if isinstance(entry, list) and len(entry) >= _LEAST_ROWS and all(isinstance(x, dict) for x in entry):
            yield from ((name, _object(x)[1]) for x in entry)
    tables = []
    for name, entry in [("", document), *(document.items() if isinstance(document, dict) else ())]:
        lists = {key: x for key, x in entry.items() if isinstance(x, list) and x} if isinstance(entry, dict) else {}
        if len({len(x) for x in lists.values()}) == 1 and not any(isinstance(x[0], dict) for x in lists.values()):
            tables.append((name, lists))
    if max((len(x) for _, lists in tables for x in lists.values()), default=0) >= _LEAST_ROWS:
        for name, lists in tables:
            for values in zip(*lists.values(), strict=True):
                yield name, _object(dict(zip(lists, values, strict=True)))[1]


def _signals(document: dict[str, Any]) -> dict[str, list[Any]]:
    """Signals of a document by name, with the unit behind it: lists of pairs of a time and a number."""
    out = {}
    for name, entry in document.items():
        fields = entry if isinstance(entry, dict) else {"": entry}
        pairs = [x for x in fields.values() if isinstance(x, list) and len(x) >= _LEAST_ROWS and all(map(_is_pair, x))]
        unit = next((x for key, x in fields.items() if key.lower() in ("unit", "units") and isinstance(x, str)), "")
        if len(pairs) == 1:
            out[f"{name} [{unit}]" if unit and text_head.is_unit(unit) else name] = pairs[0]
    return out


def _is_pair(x: Any) -> bool:
    return isinstance(x, list) and len(x) == 2 and all(isinstance(v, int | float) and abs(v) < HUGE for v in x)


def _together(signals: dict[str, list[Any]]) -> Iterator[tuple[str, Row]]:
    """Rows of signals that go side by side, as many and each within half a step of the first, a table each."""
    tables: list[tuple[list[Any], float, dict[str, list[Any]]]] = []
    for name, pairs in signals.items():
        for first, half, table in tables:
            if len(pairs) == len(first) and all(abs(a[0] - b[0]) < half for a, b in zip(pairs, first, strict=True)):
                table[name] = pairs
                break
        else:
            half = 0.5 * (pairs[-1][0] - pairs[0][0]) / (len(pairs) - 1)
            tables.append((pairs, half, {name: pairs}))
    for k, (first, _, table) in enumerate(tables, 1):
        for row, (t, _) in enumerate(first):
            yield f"signals_{k}", {"t": repr(t), **{name: repr(pairs[row][1]) for name, pairs in table.items()}}


def _document(path: Path) -> Any:
    if path.stat().st_size > _LARGEST_LIST:
        raise FileFormatError("expected a JSON document of 1 GiB at most; write an object a line", path)
    try:
        return json.loads(path.read_text(encoding="utf-8-sig"))
    except (ValueError, RecursionError) as error:
        raise FileFormatError(f"begins as a JSON document and is none: {error}; was it cut off?", path) from error


def _object(value: dict[str, Any]) -> tuple[str, Row]:
    """Kind of an object and its numbers and words; a list of three numbers is a triad."""
    kind = next((str(value[key]) for key in KIND_KEYS if isinstance(value.get(key), str)), "")
    row: Row = {}
    _flatten("", value, row)
    return kind, row


def _flatten(prefix: str, value: Any, row: Row) -> None:
    if isinstance(value, dict):
        for key, entry in value.items():
            _flatten(f"{prefix}.{key}".strip("."), entry, row)
    elif isinstance(value, list) and len(value) == 3 and all(isinstance(x, int | float) for x in value):
        row.update({f"{prefix}_{axis}": repr(x) for axis, x in zip("xyz", value, strict=True)})
    elif isinstance(value, bool):
        row[prefix] = str(int(value))
    elif isinstance(value, int | float | str) and value != "":
        row[prefix] = " ".join(value.split()) if isinstance(value, str) else repr(value)
