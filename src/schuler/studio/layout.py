"""Columns, units and axes of a text log as menus offer them, and the hints that a choice makes."""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from schuler.exceptions import InputError, SchulerError
from schuler.recording.io.columns import GROUP, SKIPS, recognise
from schuler.recording.io.hint_texts import axes_matrix, parse_columns, parse_units
from schuler.recording.io.hints import ReadHints
from schuler.recording.io.text_head import open_text

#: Left out of a log.
SKIPPED = SKIPS[0]
_ROWS = 3  # that are shown
_UNITS = {
    "accel": ("m/s^2", "g", "mg", "counts"), "gyro": ("rad/s", "deg/s", "deg/h", "counts"),
    "t": ("s", "ms", "us", "ns"), "temp": ("degC",),
    "mag": ("uT", "T", "counts"), "angle": ("rad", "deg"), "length": ("m", "km", "ft"),
    "velocity": ("m/s", "km/h", "kn"),
}  # fmt: skip
_INCREMENTS = {"accel": ("m/s", "mm/s"), "gyro": ("rad", "deg", "arcsec")}
#: What columns may be.
NAMES = (SKIPPED, *(name for name in GROUP))
#: Stamps a log may have that a menu can offer; a week of GPS is typed.
TIMES = ("local", "gps", "unix", "utc-unix", "gps-unix")


@dataclass(frozen=True)
class TextColumn:
    """One column of a text log.

    Attributes
    ----------
    header : str
        Its word above the numbers, empty without.
    values : tuple of str
        Its first fields.
    name : str
        What it is read as, :data:`SKIPPED` if it is not.
    """

    header: str
    values: tuple[str, ...]
    name: str


def text_columns(path: Path, hints: Mapping[str, Any]) -> tuple[TextColumn, ...]:
    """Columns of a text log and what the hints, or else its header, say that they are; none of another log.

    Parameters
    ----------
    path : Path
    hints : mapping
        Of this file, not of the parts of a folder.
    """
    try:
        opening = open_text(path, ReadHints.of(**{k: v for k, v in hints.items() if k != "columns"}))
        rows = [fields for _, fields in itertools.islice(opening.table.rows(), _ROWS)]
    except (SchulerError, OSError, TypeError):
        return ()
    width = len(opening.fields)
    header = list(opening.header[1]) if opening.header is not None else []
    header += [""] * (width - len(header))
    names = _stated(hints.get("columns"), header)
    if names is None:
        words = [recognise(word) for word in header]
        names = [SKIPPED if word is None else word[0] for word in words]
    names = [*names, *[SKIPPED] * width][:width]
    return tuple(TextColumn(header[k], tuple(row[k] for row in rows if k < len(row)), names[k]) for k in range(width))


def _stated(text: Any, header: Sequence[str]) -> list[str] | None:
    """Names by place that a hint ``columns`` gives; None without one, or one that cannot be read."""
    try:
        parsed = parse_columns(text if isinstance(text, str) else None)
    except InputError:
        return None
    if parsed is None:
        return None
    specs, _ = parsed
    if any(spec is not None and spec.source is not None for spec in specs):
        by_header = {spec.source: ("-" if spec.negated else "") + spec.name for spec in specs if spec is not None}
        return [by_header.get(word, SKIPPED) for word in header]
    return [SKIPPED if spec is None else ("-" if spec.negated else "") + spec.name for spec in specs]


def with_column(hints: Mapping[str, Any], columns: Sequence[TextColumn], k: int, name: str) -> dict[str, Any]:
    """Hints with one column read as another; the column that was this before is left out.

    Parameters
    ----------
    hints : mapping
    columns : sequence of TextColumn
        As they are read now.
    k : int
        Which.
    name : str
    """
    names = [SKIPPED if column.name == name else column.name for column in columns]
    names[k] = name
    return {**hints, "columns": ",".join(names)} if set(names) != {SKIPPED} else dict(hints)


def unit_choices(hints: Mapping[str, Any], columns: Sequence[TextColumn]) -> dict[str, tuple[str, tuple[str, ...]]]:
    """Unit of each group of the columns that are read as hints state it, empty if they do not, and what it may be."""
    groups = dict.fromkeys(GROUP.get(column.name.removeprefix("-")) for column in columns if column.name != SKIPPED)
    kind = str(hints.get("kind", "rate"))
    stated = _units(hints)
    offered = _UNITS if kind == "rate" else {**_UNITS, **_INCREMENTS}
    return {
        group: (stated.get(group, ""), tuple(dict.fromkeys((*offered[group], stated.get(group, offered[group][0])))))
        for group in groups
        if group in offered
    }


def with_unit(hints: Mapping[str, Any], group: str, unit: str) -> dict[str, Any]:
    """Hints with the unit of a group of columns; an empty one takes it out."""
    stated = {**_units(hints), group: unit}
    text = ",".join(f"{name}={one}" for name, one in stated.items() if one)
    others = {name: value for name, value in hints.items() if name != "units"}
    return {**others, "units": text} if text else others


def axes_choices() -> tuple[str, ...]:
    """Directions in which x, y and z of a right-handed sensor may point."""
    every = (
        "".join(letters)
        for pairs in itertools.permutations(("FB", "RL", "UD"))
        for letters in itertools.product(*pairs)
    )
    return tuple(sorted(axes for axes in every if _right_handed(axes)))


def _right_handed(axes: str) -> bool:
    try:
        axes_matrix(axes)
    except InputError:
        return False
    return True


def _units(hints: Mapping[str, Any]) -> dict[str, str]:
    try:
        return parse_units(hints.get("units"), str(hints.get("kind", "rate")))
    except SchulerError:
        return {}
