"""Known inertial sensors, grades and classes, from ``catalogue.toml`` beside this file."""

from __future__ import annotations

import difflib
import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from types import MappingProxyType
from typing import Any, Literal, TypeAlias

from schuler.exceptions import InputError
from schuler.files import read_toml
from schuler.sensors.sheets import (
    ACCEL_UNITS,
    GYRO_UNITS,
    AccelerometerSheet,
    GyroSheet,
    check_entries,
    sheet_keys,
    sheet_unit,
)
from schuler.sensors.spec import ImuSpec, TriadSpec

Kind: TypeAlias = Literal["imu", "gyro", "accelerometer", "grade", "class"]
#: Where to look, for both interfaces.
_LISTED = "catalogue.names() lists what there is, on the command line schuler catalogue"
_KINDS = ("imu", "gyro", "accelerometer", "grade", "class")
_SHEETS: dict[str, type[GyroSheet] | type[AccelerometerSheet]] = {"gyro": GyroSheet, "accel": AccelerometerSheet}
#: Beginnings of the names of what a thesis made for a simulation or a table of classes.
_THESES = ("flenniken-", "hayal-", "yaman-", "stefanisko-", "du-")


@dataclass(frozen=True, slots=True, kw_only=True)
class Entry:
    """One entry of the catalogue, in the units of its source.

    Attributes
    ----------
    name : str
    kind : {"imu", "gyro", "accelerometer", "grade", "class"}
        A class has no full error budget.
    source : str
        Thesis and table, data sheet.
    notes : str
        Corrections, assumptions, what is missing.
    aliases : tuple of str
    rate_hz : float or None
        [Hz]
    gyro, accel : mapping
        Keywords of :meth:`TriadSpec.gyro` and :meth:`TriadSpec.accelerometer`; empty where the source has none.
    printed : mapping
        What the source states besides; each key names its unit.
    unstated : tuple of str
        Fields of the budget, such as ``gyro.turn_on_bias``, that the source leaves out although every unit has them.
    pages : mapping of str to str
        Where the source states a field of the budget (``gyro.random_walk``) or a value printed besides
        (``printed.accel_bias_mg``): ``page 12``, a table, or ``page not seen``. Empty where ``source`` says it.
    """

    name: str
    kind: Kind
    source: str
    notes: str = ""
    aliases: tuple[str, ...] = ()
    rate_hz: float | None = None
    gyro: Mapping[str, Any] = field(default_factory=dict)
    accel: Mapping[str, Any] = field(default_factory=dict)
    printed: Mapping[str, Any] = field(default_factory=dict)
    unstated: tuple[str, ...] = ()
    pages: Mapping[str, str] = field(default_factory=dict)

    @property
    def is_device(self) -> bool:
        """Whether it is a unit somebody makes, as stated or measured; not a grade, class or set of a thesis."""
        return not (self.name.startswith(_THESES) or self.name.endswith("-emulated"))


def names(kind: Kind | None = None) -> list[str]:
    """Names of all entries, or of those of one kind, in the order of the file.

    Raises
    ------
    InputError
        If the kind is unknown.
    """
    if kind is not None and kind not in _KINDS:
        raise InputError(f"kind: expected one of {', '.join(_KINDS)}, got {kind!r}")
    return [e.name for e in _entries().values() if kind in (None, e.kind)]


def matches(part: str) -> list[str]:
    """Names of the entries with these letters in their name or an alias, in the order of the file."""
    key = plain(part)
    return list(dict.fromkeys(name for alias, name in _index().items() if key in alias))


def quantities(e: Entry, which: Literal["gyro", "accel"]) -> dict[str, tuple[float, str] | None]:
    """Quantities of an error budget as the source of an entry states them.

    Parameters
    ----------
    e : Entry
    which : {"gyro", "accel"}

    Returns
    -------
    dict of str to (value, unit) or None
        By field of :class:`TriadSpec`, in the unit of the source; None where the source states nothing.
    """
    sheet, keys = (e.gyro if which == "gyro" else e.accel), sheet_keys(_SHEETS[which])
    fields = GYRO_UNITS if which == "gyro" else ACCEL_UNITS
    stated = {keys[key][0]: (float(value), sheet_unit(key)) for key, value in sheet.items() if key in keys}
    return {name: stated.get(name) for name in fields}


def entry(name: str) -> Entry:
    """Look up an entry by name or alias; case, spaces, hyphens and underscores do not matter.

    Raises
    ------
    InputError
        If there is none; the message proposes similar names.
    """
    index = _index()
    key = plain(name)
    if key not in index:
        near = difflib.get_close_matches(key, index, n=4, cutoff=0.5) or [k for k in index if key and key in k][:4]
        proposals = list(dict.fromkeys(index[k] for k in near))
        hint = f"did you mean {' or '.join(proposals)}?" if proposals else _LISTED
        raise InputError(f"no sensor {name!r} in the catalogue; {hint}")
    return _entries()[index[key]]


def spec(name: str) -> ImuSpec:
    """Error budget of an IMU or grade in SI.

    Parameters
    ----------
    name : str
        See :func:`entry`.

    Returns
    -------
    ImuSpec

    Raises
    ------
    InputError
        If the entry is unknown or lacks what an error budget needs; the message says what.
    """
    e = entry(name)
    missing = [what for what, table in (("gyroscope", e.gyro), ("accelerometer", e.accel)) if not table]
    if missing:
        raise InputError(
            f"{e.name} ({e.kind}; {e.source}) has no {' and no '.join(missing)} noise and bias figures, so it is no "
            f"full IMU; {_way_out(e)}"
        )
    return ImuSpec(e.name, gyro=triad(name, "gyro"), accel=triad(name, "accel"), rate_hz=e.rate_hz, source=e.source)


def triad(name: str, which: Literal["gyro", "accel"]) -> TriadSpec:
    """Error budget of one triad of an entry in SI; also for single gyroscopes and accelerometers.

    Parameters
    ----------
    name : str
        See :func:`entry`.
    which : {"gyro", "accel"}

    Returns
    -------
    TriadSpec

    Raises
    ------
    InputError
        If the entry is unknown or has no figures for that triad.
    """
    e = entry(name)
    if which not in ("gyro", "accel"):
        raise InputError(f"which: expected 'gyro' or 'accel', got {which!r}")
    sheet = e.gyro if which == "gyro" else e.accel
    if not sheet:
        raise InputError(f"{e.name} ({e.kind}; {e.source}) has no {which} figures; {_way_out(e)}")
    try:
        return TriadSpec.gyro(**sheet) if which == "gyro" else TriadSpec.accelerometer(**sheet)
    except InputError as error:  # a slip in the file: say where
        raise InputError(f"catalogue entry {e.name}: {error}") from error


def table(chosen: Iterable[str] | None = None) -> str:
    """Text table of entries, all by default: name, kind, white noise and bias figure as in the sources, source."""
    entries = list(_entries().values()) if chosen is None else [entry(name) for name in chosen]
    rows = [("name", "kind", "gyroscope", "accelerometer", "source")]
    rows += [(e.name, e.kind, _headline(e, "gyro"), _headline(e, "accel"), e.source) for e in entries]
    widths = [max(len(row[k]) for row in rows) for k in range(4)]
    return "\n".join("  ".join([*(c.ljust(w) for c, w in zip(row, widths, strict=False)), row[4]]) for row in rows)


def _headline(e: Entry, which: Literal["gyro", "accel"]) -> str:
    """White noise and the first bias figure; a hyphen for the triad that a single sensor does not have."""
    if (e.kind, which) in (("gyro", "accel"), ("accelerometer", "gyro")):
        return "-"
    stated = quantities(e, which)
    bias = next((k for k in ("turn_on_bias", "bias_instability", "in_run_bias") if stated[k] is not None), None)
    shown = [stated[k] for k in ("random_walk", bias) if k is not None]
    return ", ".join(f"{value:g} {unit}" for value, unit in filter(None, shown)) or "unknown"


def _way_out(e: Entry) -> str:
    emulated = f"{e.name}-emulated"
    if emulated in _entries():
        return f"{emulated} adds assumed figures"
    if e.gyro or e.accel:
        return "use triad() for the part it has and put an ImuSpec together from two entries"
    return "it only has " + (", ".join(e.printed) or "a name")


def plain(name: str) -> str:
    """A name as names are compared: lower case, without spaces, hyphens and underscores."""
    return re.sub(r"[\s_-]+", "", str(name)).lower()


@cache
def _entries() -> dict[str, Entry]:
    entries = {}
    for name, data in read_toml(Path(__file__).with_name("catalogue.toml")).items():
        data["notes"] = " ".join(data.get("notes", "").split())
        for key in ("aliases", "unstated"):
            data[key] = tuple(data.get(key, ()))
        pages: dict[str, str] = {}
        for key in ("gyro", "accel", "printed"):
            table = data.get(key, {})
            pages |= _take_pages(table, name, key)
            data[key] = MappingProxyType(table)  # read-only: every caller gets the same cached object
        data["pages"] = MappingProxyType(pages)
        entries[name] = Entry(name=name, **data)
    return entries


def _take_pages(table: dict[str, Any], name: str, which: str) -> dict[str, str]:
    """Place in the source of each value of a table, which loses ``page``, of all values, and ``pages``, of some."""
    page, some = table.pop("page", None), table.pop("pages", {})
    values = [key for key in table if key != "density"]
    check_entries(some, values, [], f"catalogue entry {name}: pages of {which}")
    keys = sheet_keys(_SHEETS[which]) if which in _SHEETS else {}
    places = {keys[key][0] if key in keys else key: some.get(key, page) for key in values}
    return {
        f"{which}.{value}": f"page {place}" if isinstance(place, int) else str(place)
        for value, place in places.items()
        if place is not None
    }


@cache
def _index() -> dict[str, str]:
    return {plain(alias): e.name for e in _entries().values() for alias in (e.name, *e.aliases)}
