"""Tables between data classes and frames of other libraries: columns in SI, their units, a document of the rest.

A recording becomes one table for each of its parts (imu, gnss, ...), with the columns of our files
(:mod:`schuler.recording.io.own`). :mod:`schuler.navigation.solution_tables` does the same for navigation results.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from schuler.exceptions import InputError
from schuler.recording.io import own, own_satellites
from schuler.recording.io.own import Columns
from schuler.recording.recording import Metadata, Recording
from schuler.timebase import TimeBase
from schuler.units import parse_unit

FORMAT = "schuler/tables/1"
_HERE = Path("tables")  # in messages of what is shared with files


@dataclass(frozen=True)
class Tables:
    """Named tables with units.

    Attributes
    ----------
    columns : dict of str to dict of str to ndarray
        Columns, shapes (n,), of each table.
    units : dict of str to dict of str to str
        Unit of each column, as ``m/s^2``; a column that is not named is in SI.
    document : dict
        Entries that are in no column, as plain values that JSON can hold; empty for tables made by others.
    """

    columns: dict[str, Columns]
    units: dict[str, dict[str, str]] = field(default_factory=dict)
    document: dict[str, Any] = field(default_factory=dict)

    def attributes(self, name: str) -> dict[str, Any]:
        """Attributes of the table ``name``: its name, units and the document's text."""
        return {"part": name, "units": dict(self.units.get(name, {})), "schuler": own.to_json(self.document)}


def tables_of(data: Recording | Tables) -> Tables:
    """Tables of a recording; tables stay what they are.

    Returns
    -------
    Tables
        One table for each part that has rows.

    Raises
    ------
    InputError
        If it is something else, or no part has rows.
    """
    if isinstance(data, Tables):
        return data
    if not isinstance(data, Recording):
        raise InputError(
            f"expected a Recording or Tables, got {type(data).__name__}; a series goes into one with "
            "Recording(imu=series), a navigation result with schuler.navigation.solution_tables.tables_of(result)"
        )
    flat = own.flatten(data)
    si = _si(data.imu.kind if data.imu is not None else "rate")
    units = {name: {column: si.get(column, "1") for column in table} for name, table in flat.items()}
    return Tables(flat, units, {"format": FORMAT, **own.document(data, flat)})


def recording_of(
    tables: Tables, *, kind: str | None = None, time: TimeBase | None = None, name: str | None = None
) -> Recording:
    """Recording of tables, the inverse of :func:`tables_of`, bit for bit.

    Parameters
    ----------
    tables : Tables
        Also made by others: columns by the names of docs/interop.md. Columns in other units than SI are converted,
        tables and columns of other names are left out; both are noted.
    kind : {"rate", "increment"}, optional
        Kind of the IMU's samples; default that of the document, else rates.
    time : TimeBase, optional
        Default that of the document, else a local clock.
    name : str, optional

    Raises
    ------
    InputError
        If a column that is needed is missing, has another dimension than its quantity, or holds what is no number; or
        no table is one of a recording.
    """
    document = _checked(tables.document)
    own_tables = {n: t for n, t in tables.columns.items() if n in own.TABLES}
    if not own_tables:
        raise InputError(
            f"none of the tables ({', '.join(tables.columns)}) is part of a recording: {', '.join(own.TABLES)}"
        )
    if kind is None:
        kind = str(document["series"].get("imu", {}).get("kind", "rate"))
    notes = [
        f"The table {n} is no part of a recording; it was left out." for n in tables.columns if n not in own_tables
    ]
    made: dict[str, Any] = {}
    satellites: dict[str, Columns] = {}
    for part, table in own_tables.items():
        flat = _in_si(part, table, tables.units.get(part, {}), kind, notes)
        if part in own_satellites.TABLES:
            satellites[part] = flat
            continue
        if part == "gnss":
            _from_sigmas(flat, "c", ("sn", "se", "sd"))
            _from_sigmas(flat, "cv", ("svn", "sve", "svd"))
        try:
            made[part] = own.unflatten(part, flat, kind)
        except KeyError as error:
            raise InputError(f"the table {part} needs a column {error}, it has: {', '.join(table)}") from error
        except ValueError as error:  # ours, or columns of different lengths
            raise InputError(f"the table {part}: {error}") from error
    if satellites and not document["satellites"]:
        raise InputError(f"{', '.join(satellites)}: satellite parts come back only from tables that schuler made")
    made |= own.satellite_parts(satellites, document, _HERE)
    return Recording(**made, metadata=_metadata(document, time, name).noting(*notes))


def document_of(text: Any) -> dict[str, Any]:
    """The document of its text; an :class:`InputError` if it is damaged, nothing if there is none."""
    if text is None:
        return {}
    try:
        document = json.loads(text)
    except (TypeError, ValueError, RecursionError) as error:
        raise InputError(f"the attribute schuler is damaged ({error}); delete it, or make the frame anew") from error
    if not isinstance(document, dict):
        raise InputError("the attribute schuler is damaged: expected a JSON object; delete it, or make the frame anew")
    return document


def numbers(values: Any, where: str, whole: bool) -> np.ndarray[Any, np.dtype[Any]]:
    """Values of a column as int64 or float64, or an :class:`InputError` that names it."""
    try:
        array = np.asarray(values)
        if array.dtype == object:  # None and NA
            array = array.astype(np.float64)
        if array.dtype.kind not in "fiub":
            raise TypeError(f"it holds {array.dtype}")
        if not whole:
            return array.astype(np.float64)
        if array.dtype.kind == "f" and not np.array_equal(array, np.trunc(array)):
            raise ValueError("expected whole numbers")
        return array.astype(np.int64)
    except (TypeError, ValueError, OverflowError) as error:
        raise InputError(f"{where}: expected numbers ({error}); convert the column first") from error


def _si(kind: str) -> Mapping[str, str]:
    return own.INCREMENT_UNITS if kind == "increment" else own.UNITS


def _checked(document: Mapping[str, Any]) -> dict[str, Any]:
    """The document with all that is looked up in it."""
    series, satellites = document.get("series", {}), document.get("satellites", {})
    if not isinstance(series, Mapping) or not isinstance(satellites, Mapping):
        raise InputError("the document with the tables is damaged; delete it, or make the tables anew")
    return {**document, "series": series, "satellites": satellites}


def _in_si(part: str, table: Columns, units: Mapping[str, str], kind: str, notes: list[str]) -> Columns:
    si = _si(kind)
    flat: Columns = {}
    surplus = [str(column) for column in table if column not in own.COLUMNS[part]]
    if surplus:
        notes.append(f"Columns of {part} without a place in a recording were left out: {', '.join(surplus)}.")
    for column, values in table.items():
        if column in surplus:
            continue
        given, si_unit = units.get(column) or si.get(column, "1"), si.get(column, "1")
        if column in own.INTEGERS or given == si_unit:
            flat[column] = numbers(values, f"{part}.{column}", column in own.INTEGERS)
            continue
        unit, target = parse_unit(given), parse_unit(si_unit)
        if unit.dimension != target.dimension:
            raise InputError(f"{part}.{column}: expected a unit such as {si_unit}, got {given!r}")
        flat[column] = numbers(values, f"{part}.{column}", False) * (unit.factor / target.factor)
        notes.append(f"The column {column} of {part} was converted from {given} to {si_unit}.")
    return flat


def _from_sigmas(flat: Columns, stem: str, names: tuple[str, str, str]) -> None:
    """Covariances of 1-sigma values where only these are given, as in frames of others."""
    if f"{stem}nn" in flat or not all(name in flat for name in names):
        return
    flat |= {f"{stem}{axis}": flat[name] ** 2 for axis, name in zip(("nn", "ee", "dd"), names, strict=True)}
    for cross in ("ne", "nd", "ed"):
        flat.setdefault(f"{stem}{cross}", np.zeros_like(flat[names[0]]))


def _metadata(document: Mapping[str, Any], time: TimeBase | None, name: str | None) -> Metadata:
    if "metadata" not in document:
        notes = ("From tables without metadata: taken as SI and forward-right-down axes where they do not say.",)
        return Metadata(name or "tables", time or TimeBase(), notes=notes)
    try:
        m = document["metadata"]
        return Metadata(
            name or str(m["name"]),
            time or own.time_from(m["time"]),
            {str(k): str(v) for k, v in m["sources"].items()},
            str(m["axes"]),
            tuple(str(note) for note in m["notes"]),
            dict(m["options"]),
        )
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        raise InputError(f"the metadata with the tables is damaged ({error!r}); make the tables anew") from error
