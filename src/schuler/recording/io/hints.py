"""What a user may have to say about a log that does not say it itself, and how the texts of it are read.

Everything here is pure: hints are checked when they are made, before any file is opened.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from schuler import units
from schuler.arrays import FloatArray
from schuler.exceptions import InputError
from schuler.recording.io.columns import GROUP, GROUP_QUANTITY, INCREMENT_QUANTITY, SKIPS, TRIADS, check_known

#: Checks and demands a user may lift by name, with what happens then.
ALLOWANCES = {
    "norm": "specific force at rest that is not gravity",
    "magnitude": "rates above 100 rad/s and specific forces above 200 g",
    "truncated": "a last line that was cut off is left out",
    "no-gyro": "an IMU log without a gyro; its rates are zero",
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
_DELIMITERS = {"comma": ",", "semicolon": ";", "tab": "\t", "\\t": "\t", "blank": " ", "blanks": " ", "space": " "}
_DIRECTIONS = {"F": (1, 0, 0), "B": (-1, 0, 0), "R": (0, 1, 0), "L": (0, -1, 0), "D": (0, 0, 1), "U": (0, 0, -1)}


@dataclass(frozen=True, slots=True)
class TimeSpec:
    """Meaning of the time stamps; ``week`` is used by "gps-tow" only."""

    kind: Literal["local", "gps", "gps-tow", "unix", "gps-unix"] = "local"
    week: int = 0


@dataclass(frozen=True, slots=True)
class ColumnSpec:
    """One entry of the hint ``columns``: a name, and the header or array it is mapped to, if it is."""

    name: str
    source: str | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class ReadHints:
    """What a log does not say about itself. Every hint is optional; a reader that needs one says so.

    Attributes
    ----------
    columns : str, optional
        Meaning of the columns in order, ``"t,ax,ay,az,gx,gy,gz"``; ``-`` or ``_`` skips one, a ``*`` at the end skips
        the rest. Names: t; ax ay az, gx gy gz, temp; lat lon h, vn ve vd, sn se sd, svn sve svd, q, ns, received;
        speed, sspeed; heading, sheading; h, sh (of a barometer); for references x y z, vx vy vz (Earth-fixed) and
        roll pitch yaw. ``name=header`` takes a column by its header, or an array by its name.
    units : str, optional
        ``"g,deg/s"`` (accelerometer, gyro) with an optional third for time, or by group:
        ``"accel=g,gyro=deg/s,t=ms,temp=degC,angle=deg,length=m,velocity=km/h"``. ``counts`` for uncalibrated logs.
    rate : float, optional
        Sampling rate of a log without a time column. [Hz]
    axes : str, optional
        Directions in which x, y and z of the sensor point, three letters out of F/B, R/L, U/D; default "FRD".
    kind : {"rate", "increment"}
    time : str, optional
        ``"gps-tow:WEEK"``, ``"gps"`` (seconds since 1980-01-06), ``"unix"`` or ``"utc-unix"`` (POSIX time),
        ``"gps-unix"`` (seconds since 1970 on the GPS scale) or ``"local"`` (default).
    delimiter : str, optional
        Guessed from comma, semicolon, tab and blanks if not given.
    skip : int
        Lines at the top that are not looked at.
    comment : str, optional
        Start of comments; ``#`` or ``%`` is recognised.
    scale : str or mapping, optional
        Factors applied before units, ``"accel=0.00333,gyro=0.05"`` or ``"0.00333,0.05"``, by group or column; or the
        name of an array of the file that holds one factor per column.
    height : {"ellipsoidal", "msl"}, optional
    geoid_separation : float, optional
        Height of the geoid above the ellipsoid, needed with ``height="msl"``. [m]
    sigma : str or sequence of float, optional
        1-sigma north, east, down [m] and, as three more, of velocity [m/s], where a GNSS log has none.
    sigma_speed : float, optional
        1-sigma of an odometer. [m/s]
    sigma_heading_deg : float, optional
        1-sigma of a compass or of two antennas. [deg]
    sigma_height : float, optional
        1-sigma of a barometer. [m]
    series : {"imu", "gnss", "odometer", "heading", "height", "reference", "observations", "ephemerides"}, optional
        Which one a table holds, if its columns leave that open; which one a file must hold.
    rest : float, optional
        Length of the stillness at the start used to check gravity; looked for if not given. [s]
    allow : str or set of str
        Checks to pass over with a note, see :data:`ALLOWANCES`.
    variable : str, optional
        Array of a MATLAB or NumPy file that ``columns`` describes.
    offset : float
        Added to the time stamps. [s]
    name : str, optional
        Name of the recording, default the file's.
    format : str, optional
        Name of a format of :data:`schuler.recording.formats.registry.FORMATS`, where a file does not show what it is.
    streams : str or mapping, optional
        Of a log with many streams (topics, messages, instances) the one for each part,
        ``"imu=/imu/data,gnss=/gps/fix,reference=none"``; ``none`` leaves a part out. Parts: the series, and
        ``velocity`` where that of GNSS is a stream of its own.
    origin : str or sequence of float, optional
        Where zero of a local frame is: latitude, longitude [deg], ellipsoidal height [m], ``"48.1,11.6,560"``.

    Raises
    ------
    InputError
        If a hint cannot be read; the message says what would be understood.
    """

    columns: str | None = None
    units: str | None = None
    rate: float | None = None
    axes: str | None = None
    kind: Literal["rate", "increment"] = "rate"
    time: str | None = None
    delimiter: str | None = None
    skip: int = 0
    comment: str | None = None
    scale: str | Mapping[str, float] | None = None
    height: Literal["ellipsoidal", "msl"] | None = None
    geoid_separation: float | None = None
    sigma: str | Iterable[float] | None = None
    sigma_speed: float | None = None
    sigma_heading_deg: float | None = None
    sigma_height: float | None = None
    series: str | None = None
    rest: float | None = None
    allow: str | Iterable[str] = ()
    variable: str | None = None
    offset: float = 0.0
    name: str | None = None
    format: str | None = None
    streams: str | Mapping[str, str] | None = None
    origin: str | Iterable[float] | None = None

    def __post_init__(self) -> None:
        for name in (
            "columns",
            "units",
            "axes",
            "time",
            "delimiter",
            "comment",
            "series",
            "variable",
            "name",
            "format",
        ):
            if not isinstance(value := getattr(self, name), (str, type(None))):
                raise InputError(f"{name}: expected text, got {value!r}")
        check_known(self.kind, ("rate", "increment"), "kind")
        if self.height is not None:
            check_known(self.height, ("ellipsoidal", "msl"), "height")
        if self.series is not None:
            check_known(self.series, (*SERIES, *SATELLITES), "series")
        positive = ("rate", "rest", "sigma_speed", "sigma_heading_deg", "sigma_height")
        for name, lowest in (*((name, 0.0) for name in positive), ("geoid_separation", None)):
            if (value := getattr(self, name)) is not None:
                object.__setattr__(self, name, _number(value, name, lowest))
        if self.rate is not None and not 1e-4 <= self.rate <= 1e7:
            raise InputError(f"rate: expected a sampling rate in hertz between 1e-4 and 1e7, got {self.rate:g}")
        if self.geoid_separation is not None and abs(self.geoid_separation) > 150.0:
            raise InputError(
                f"geoid_separation: the geoid is within -110..+90 m of the ellipsoid everywhere, got "
                f"{self.geoid_separation:g}; is it in feet, or the height itself?"
            )
        object.__setattr__(self, "offset", _number(self.offset, "offset", None))
        if abs(self.offset) > 1e10:
            raise InputError(f"offset: expected seconds within +-1e10, got {self.offset:g}")
        skip = _number(self.skip, "skip", None)
        if skip < 0 or skip != int(skip):
            raise InputError(f"skip: expected a number of lines, got {self.skip!r}")
        object.__setattr__(self, "skip", int(skip))
        object.__setattr__(self, "delimiter", parse_delimiter(self.delimiter))
        if self.comment is not None and not self.comment.strip():
            raise InputError("comment: expected the text that starts a comment, such as #, got blanks")
        object.__setattr__(self, "sigma", parse_sigma(self.sigma))
        object.__setattr__(self, "allow", parse_allow(self.allow))
        if self.height == "msl" and self.geoid_separation is None:
            raise InputError(
                "height='msl' needs geoid_separation, the height of the geoid above the ellipsoid at the place [m], "
                "positive where the geoid is outside (about 48 in Stuttgart, about -17 in Denver): look it up "
                "for EGM96 or EGM2008"
            )
        if self.geoid_separation is not None and self.height != "msl":
            raise InputError("geoid_separation is used with height='msl' only; give both or neither")
        parse_columns(self.columns)
        parse_units(self.units, self.kind)
        parse_scale(self.scale)
        parse_time(self.time)
        parse_streams(self.streams)
        parse_origin(self.origin)
        axes_matrix(self.axes)

    @classmethod
    def of(cls, **options: Any) -> ReadHints:
        """Hints from keyword options; an unknown name is an :class:`InputError` that lists the known ones."""
        for name in options:
            check_known(name, [f.name for f in dataclasses.fields(cls)], "hint")
        return cls(**options)

    def given(self) -> dict[str, Any]:
        """The hints that differ from their defaults, as plain values for provenance."""
        values = {f.name: getattr(self, f.name) for f in dataclasses.fields(self)}
        values = {n: v for n, v in values.items() if v != self.__dataclass_fields__[n].default and v != frozenset()}
        return {n: sorted(v) if isinstance(v, frozenset) else v for n, v in values.items()}

    def allows(self, check: str) -> bool:
        """Whether a check of :data:`ALLOWANCES` was lifted."""
        return check in self.allow

    @property
    def sigmas(self) -> tuple[float, ...] | None:
        """The hint ``sigma`` as three or six numbers."""
        return parse_sigma(self.sigma)


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
        if not (equals and name in TRIADS):
            check_known(name, [*GROUP, *SKIPS, "*"], "columns")
        specs.append(ColumnSpec(name, source if equals else None))
    names = [spec.name for spec in specs if spec is not None]
    if twice := sorted({n for n in names if names.count(n) > 1}):
        raise InputError(f"columns: {', '.join(twice)} named more than once in {text!r}; skip the other one with -")
    if not names:
        raise InputError(f"columns: {text!r} names no column")
    return specs, rest


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
    else:
        raise InputError(f"units: expected two (accel,gyro) or three (and time) units, or group=unit, got {text!r}")
    for group, unit in stated.items():
        factor(unit, group, kind)
    return stated


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
    known = list(dict.fromkeys((*GROUP_QUANTITY, *GROUP)))
    factors = {check_known(name, known, "scale"): _number(n, f"scale {name}", None) for name, n in value.items()}
    for name, number in factors.items():
        if not 1e-15 <= abs(number) <= 1e15:
            raise InputError(f"scale {name}: expected a factor between 1e-15 and 1e15, got {number:g}")
    return factors


def parse_time(text: str | None) -> TimeSpec:
    """What a ``time`` hint says of the stamps.

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
    lat, lon, h = (_number(part, "origin", None) for part in parts)
    if abs(lat) > 90.0 or abs(lon) > 360.0 or abs(h) > 1e6:
        raise InputError(f"origin: expected latitude, longitude [deg] and ellipsoidal height [m], got {value!r}")
    return lat * units.DEG, lon * units.DEG, h


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
    return tuple(_number(part, "sigma", 0.0) for part in parts)


def parse_allow(value: str | Iterable[str]) -> frozenset[str]:
    """The set of lifted checks."""
    parts = [p.strip() for p in value.split(",") if p.strip()] if isinstance(value, str) else list(value)
    return frozenset(check_known(part, ALLOWANCES, "allow") for part in parts)


def _number(value: Any, name: str, above: float | None) -> float:
    try:
        number = float(value)
    except (TypeError, ValueError):
        number = float("nan")
    if not np.isfinite(number) or (above is not None and number <= above):
        raise InputError(f"{name}: expected a {'positive ' if above == 0.0 else ''}number, got {value!r}")
    return number
