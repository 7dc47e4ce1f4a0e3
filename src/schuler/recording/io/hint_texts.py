"""Texts of hints to values: columns, units, scales, times, streams, places, axes."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from schuler import units
from schuler.arrays import FloatArray
from schuler.exceptions import InputError, SchulerError
from schuler.recording.io.columns import GROUP, GROUP_QUANTITY, INCREMENT_QUANTITY, SIGNED, SKIPS, TRIADS, check_known

#: Checks and demands a user may lift by name, with what happens then.
ALLOWANCES = {
    "norm": "specific force at rest that is not gravity",
    "magnitude": "rates above 100 rad/s, specific forces above 200 g, and what else no vehicle and no clock has",
    "truncated": "a last line that was cut off is left out",
    "no-gyro": "an IMU log without a gyro; its rates are zero",
    "one-axis": "an IMU log without all axes of a triad; those that are missing are zero",
    "no-accel": "an IMU log without an accelerometer; its specific forces are zero",
    "no-velocity": "GNSS velocities without an accuracy are left out",
    "height": "the hint height overrules the file",
}
#: A unit of its own for raw converter counts, which have no physical unit before calibration.
COUNTS = "counts"
#: In the note on a series that has it.
COUNTS_NOTE = "raw counts, not SI"
SERIES = ("imu", "gnss", "odometer", "heading", "height", "reference")
#: What files of satellite receivers hold besides.
SATELLITES = ("observations", "ephemerides", "ranges")
#: Before what a folder whose files leave a choice is read with; commands put their own words in its place.
SAY_WHICH = "say which: "
_DELIMITERS = {"comma": ",", "semicolon": ";", "tab": "\t", "\\t": "\t", "blank": " ", "blanks": " ", "space": " "}
_DIRECTIONS = {"F": (1, 0, 0), "B": (-1, 0, 0), "R": (0, 1, 0), "L": (0, -1, 0), "D": (0, 0, 1), "U": (0, 0, -1)}


@dataclass(frozen=True, slots=True)
class TimeSpec:
    """Meaning of the time stamps; ``week`` is used by "gps-tow" only."""

    kind: Literal["local", "gps", "gps-tow", "unix", "gps-unix"] = "local"
    week: int = 0


@dataclass(frozen=True, slots=True)
class ColumnSpec:
    """One entry of the hint ``columns``: a name, its header or array if it has one, and whether its sign changes."""

    name: str
    source: str | None = None
    negated: bool = False


def parse_columns(text: str | None) -> tuple[list[ColumnSpec | None], bool] | None:
    """Entries of a ``columns`` hint, ``None`` for a skipped one, and whether a ``*`` skips the rest.

    Raises
    ------
    InputError
        For unknown, repeated or missing names.
    """
    if text is None:
        return None
    entries = [entry.strip() for entry in text.split(",")]
    rest = entries[-1] == "*"
    if rest:
        entries = entries[:-1]
    specs: list[ColumnSpec | None] = []
    for entry in entries:
        if entry in SKIPS:
            specs.append(None)
            continue
        name, equals, source = (part.strip() for part in entry.partition("="))
        if not name or (equals and not source):
            raise InputError(f"columns: cannot read {text!r}: write names with commas between, for example t,ax,ay,az")
        negated = name.startswith("-")
        name = name.removeprefix("-").strip()
        if negated:
            check_known(name, SIGNED, "columns: - before a name changes the sign of a component")
        if not (equals and name in TRIADS):
            check_known(name, [*GROUP, *SKIPS, "*"], "columns")
        specs.append(ColumnSpec(name, source if equals else None, negated))
    names = [spec.name for spec in specs if spec is not None]
    if twice := sorted({n for n in names if names.count(n) > 1}):
        raise InputError(f"columns: {', '.join(twice)} named more than once in {text!r}; skip the other one with -")
    if not names:
        raise InputError(f"columns: {text!r} names no column")
    return specs, rest


def triads_in_counts(notes: Iterable[str]) -> tuple[Literal["accel", "gyro"], ...]:
    """Triads of a log that are in converter counts, by the notes that were made on reading it."""
    sentences = [n.partition(f": {COUNTS_NOTE}")[0].rpartition(": ")[2] for n in notes if COUNTS_NOTE in n]
    triads: tuple[Literal["accel", "gyro"], ...] = ("accel", "gyro")
    return tuple(name for name in triads if any(re.search(rf"\b{name}\b", words) for words in sentences))


def parse_units(text: str | None, kind: str = "rate") -> dict[str, str]:
    """Unit of each group stated in a ``units`` hint.

    Raises
    ------
    UnitError, InputError
        For unknown groups and units, and units of another quantity.
    """
    if text is None:
        return {}
    parts = [part.strip() for part in text.split(",")]
    stated: dict[str, str] = {}
    if any("=" in part for part in parts):
        for part in parts:
            group, equals, unit = (p.strip() for p in part.partition("="))
            if not equals or not unit:
                raise InputError(f"units: expected group=unit, got {part!r}; either all are named or none")
            stated[check_known(group, GROUP_QUANTITY, "units")] = unit
    elif len(parts) in (2, 3):
        stated = dict(zip(("accel", "gyro", "t"), parts, strict=False))
    elif len(parts) == 1:
        stated = {group: parts[0] for group in ("accel", "gyro", "t") if _is_unit(parts[0], group, kind)}
    if not stated:
        raise InputError(
            "units: expected two (accel,gyro) or three (and time) units, one that tells what it is of, or group=unit, "
            f"got {text!r}"
        )
    for group, unit in stated.items():
        factor(unit, group, kind)
    return stated


def _is_unit(unit: str, group: str, kind: str) -> bool:
    try:
        factor(unit, group, kind)
    except SchulerError:
        return False
    return True


def factor(unit: str, group: str, kind: str = "rate") -> float:
    """Factor to SI of a unit stated for a group of columns; 1 for counts of a sensor."""
    if unit == COUNTS and group in TRIADS:
        return 1.0
    quantity = (INCREMENT_QUANTITY if kind == "increment" else GROUP_QUANTITY)[group]
    if quantity == "temperature" and unit == "K":
        raise InputError("temp: kelvin has another zero than degC; convert the column, or skip it")
    return units.factor_for(unit, quantity)


def parse_scale(value: str | Mapping[str, float] | None) -> dict[str, float] | str | None:
    """Factors by group or column, or the name of an array that holds them."""
    if value is None:
        return None
    if isinstance(value, str):
        parts = [part.strip() for part in value.split(",")]
        if len(parts) == 1 and parts[0].isidentifier():
            return parts[0]
        if any("=" in part for part in parts):
            pairs = [tuple(p.strip() for p in part.partition("=")[::2]) for part in parts]
        elif len(parts) == 2:
            pairs = [("accel", parts[0]), ("gyro", parts[1])]
        else:
            raise InputError(f"scale: expected accel=...,gyro=..., two numbers or the name of an array, got {value!r}")
        value = dict(pairs)  # type: ignore[arg-type]
    choices = list(dict.fromkeys((*GROUP_QUANTITY, *GROUP)))
    factors = {
        check_known(name, choices, "scale"): finite_number(n, f"scale {name}", None) for name, n in value.items()
    }
    for name, number in factors.items():
        if not 1e-15 <= abs(number) <= 1e15:
            raise InputError(f"scale {name}: expected a factor between 1e-15 and 1e15, got {number:g}")
    return factors


def parse_time(text: str | None) -> TimeSpec:
    """Meaning of the stamps by a ``time`` hint.

    Raises
    ------
    InputError
        If it is not one of the known kinds, or a week is missing or impossible.
    """
    if text is None:
        return TimeSpec()
    kind, colon, week = (part.strip() for part in text.partition(":"))
    if kind == "utc-unix":
        kind = "unix"
    check_known(kind, ("gps-tow", "gps", "unix", "utc-unix", "gps-unix", "local"), "time")
    if kind != "gps-tow":
        if colon:
            raise InputError(f"time: only gps-tow takes a week, got {text!r}")
        return TimeSpec(kind=kind)  # type: ignore[arg-type]
    if not (week.isascii() and week.isdigit()) or len(week) > 4:
        raise InputError(
            f"time: expected gps-tow:WEEK with the full week number, for example gps-tow:2374, got {text!r}"
        )
    return TimeSpec("gps-tow", int(week))


def parse_streams(value: str | Mapping[str, str] | None) -> dict[str, str | None]:
    """Stream of each part stated in a ``streams`` hint, ``None`` for a part to be left out.

    Raises
    ------
    InputError
        For unknown or repeated parts and empty names.
    """
    if value is None:
        return {}
    if isinstance(value, str):
        pairs = [tuple(p.strip() for p in part.partition("=")[::2]) for part in value.split(",")]
    elif isinstance(value, Mapping):
        pairs = [(str(part), str(name).strip()) for part, name in value.items()]
    else:
        raise InputError(f"streams: expected PART=STREAM,... or a mapping, got {value!r}")
    chosen: dict[str, str | None] = {}
    for part, name in pairs:
        if not name:
            raise InputError(f"streams: expected PART=STREAM such as imu=/imu/data, got {value!r}")
        if check_known(part, (*SERIES, "velocity"), "streams") in chosen:
            raise InputError(f"streams: {part} is named more than once in {value!r}")
        chosen[part] = None if name == "none" else name
    return chosen


def parse_origin(value: str | Iterable[float] | None) -> tuple[float, float, float] | None:
    """Latitude, longitude [rad], ellipsoidal height [m] of an ``origin`` hint in degrees and metres.

    Raises
    ------
    InputError
        If it is not three numbers on the Earth.
    """
    if value is None:
        return None
    try:
        parts: list[Any] = value.split(",") if isinstance(value, str) else list(value)
    except TypeError:
        parts = []
    if len(parts) != 3:
        raise InputError(f"origin: expected latitude, longitude [deg] and ellipsoidal height [m], got {value!r}")
    lat, lon, h = (finite_number(part, "origin", None) for part in parts)
    if abs(lat) > 90.0 or abs(lon) > 360.0 or abs(h) > 1e6:
        raise InputError(f"origin: expected latitude, longitude [deg] and ellipsoidal height [m], got {value!r}")
    return lat * units.DEG, lon * units.DEG, h


def parse_truth_fixes(value: str | Iterable[float] | None) -> tuple[float, float] | None:
    """Period [s] and 1-sigma [m] of a ``truth_fixes`` hint.

    Raises
    ------
    InputError
        If it is not two positive numbers.
    """
    if value is None:
        return None
    parts: list[Any] = value.split(",") if isinstance(value, str) else list(value)
    if len(parts) != 2:
        raise InputError(f"truth_fixes: expected a period [s] and a 1-sigma [m], such as '1,0.05', got {value!r}")
    period, sigma = (finite_number(part, "truth_fixes", 0.0) for part in parts)
    return period, sigma


def axes_matrix(axes: str | None) -> FloatArray:
    """Matrix ``C_bs`` of an ``axes`` hint: sensor components to forward, right, down. Shape (3, 3).

    Raises
    ------
    InputError
        If the letters are not one of each pair, or the axes are left-handed.
    """
    if axes is None:
        return np.eye(3)
    letters = axes.upper()
    if len(letters) != 3 or any(sum(c in pair for c in letters) != 1 for pair in ("FB", "RL", "UD")):
        raise InputError(
            f"axes: expected three letters, the directions of x, y and z, one out of each of F/B, R/L and U/D "
            f"(FRD, FLU, RFU, ...), got {axes!r}"
        )
    C_bs = np.array([_DIRECTIONS[c] for c in letters], dtype=np.float64).T
    if np.linalg.det(C_bs) < 0.0:
        raise InputError(
            f"axes: {axes!r} is left-handed (determinant -1), which no rotation makes forward-right-down; one of the "
            "directions must be the opposite one, or two columns are exchanged"
        )
    return C_bs


def parse_delimiter(text: str | None) -> str | None:
    """The character between fields: itself, or one of comma, semicolon, tab, blanks by name."""
    if text is None:
        return None
    character = _DELIMITERS.get(text, text)
    if len(character) != 1 or character.isalnum() or character in '+-."\n\r':
        raise InputError(f"delimiter: expected one character or comma, semicolon, tab, blanks; got {text!r}")
    return character


def parse_sigma(value: str | Iterable[float] | None) -> tuple[float, ...] | None:
    """Three or six positive 1-sigma values."""
    if value is None:
        return None
    parts: list[Any] = value.split(",") if isinstance(value, str) else list(value)
    if len(parts) not in (3, 6):
        raise InputError(
            f"sigma: expected 1-sigma north, east, down [m], and perhaps three more of velocity [m/s], got {value!r}"
        )
    return tuple(finite_number(part, "sigma", 0.0) for part in parts)


def parse_allow(value: str | Iterable[str]) -> frozenset[str]:
    """The set of lifted checks."""
    parts = [p.strip() for p in value.split(",") if p.strip()] if isinstance(value, str) else list(value)
    return frozenset(check_known(part, ALLOWANCES, "allow") for part in parts)


def finite_number(value: Any, name: str, above: float | None) -> float:
    """One finite number, larger than ``above`` if that is given."""
    try:
        number = float(value)
    except (TypeError, ValueError):
        number = float("nan")
    if not np.isfinite(number) or (above is not None and number <= above):
        raise InputError(f"{name}: expected a {'positive ' if above == 0.0 else ''}number, got {value!r}")
    return number
