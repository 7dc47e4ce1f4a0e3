"""Hints of the user on what a log does not state.

Everything here is pure: hints are checked when they are made, before any file is opened.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from schuler.exceptions import InputError
from schuler.recording.io.columns import check_known
from schuler.recording.io.hint_texts import (
    SATELLITES,
    SERIES,
    axes_matrix,
    finite_number,
    parse_allow,
    parse_columns,
    parse_delimiter,
    parse_origin,
    parse_scale,
    parse_sigma,
    parse_streams,
    parse_time,
    parse_truth_fixes,
    parse_units,
)


@dataclass(frozen=True, slots=True, kw_only=True)
class ReadHints:
    """Hints on what a log does not state. Every hint is optional; a reader that needs one says so.

    Attributes
    ----------
    columns : str, optional
        Meaning of the columns in order, ``"t,ax,ay,az,gx,gy,gz"``; ``-`` or ``_`` skips one, a ``*`` at the end skips
        the rest, ``-ax`` changes the sign.
        Names: t; ax ay az, gx gy gz, temp; lat lon h, vn ve vd, sn se sd, svn sve svd, q, ns, received;
        speed, sspeed (and course, of fixes; radius, that holds 68 % of their horizontal errors); heading, sheading;
        h, sh (of a barometer); for references x y z, vx vy vz (Earth-fixed) and roll pitch yaw; n e d of a local frame
        (with ``origin``).
        ``name=header`` takes a column by its header, or an array by its name.
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
        Series that a table holds, if its columns leave that open, or that a file must hold.
    rest : float, optional
        Length of the stillness at the start used to check gravity; looked for if not given. [s]
    bad_lines : float
        Largest share of the lines of a text log that may be garbled, hold no number, repeat a stamp or come late, each,
        below one half: they are left out, late ones sorted in, and counted.
    allow : str or set of str
        Checks to pass over with a note, see :data:`~schuler.recording.io.hint_texts.ALLOWANCES`.
    variable : str, optional
        Array of a MATLAB or NumPy file that ``columns`` describes.
    offset : float
        Added to the time stamps. [s]
    name : str, optional
        Name of the recording, default the file's.
    format : str, optional
        Name of a format of :data:`schuler.recording.formats.registry.FORMATS`, where a file does not show what it is.
    streams : str or mapping, optional
        Stream for each part, in a log with many (topics, messages, instances),
        ``"imu=/imu/data,gnss=/gps/fix,reference=none"``; ``none`` leaves a part out. Parts: the series, and
        ``velocity`` where that of GNSS is a stream of its own.
    origin : str or sequence of float, optional
        Origin of a local frame: latitude, longitude [deg], ellipsoidal height [m], ``"48.1,11.6,560"``.
    truth_fixes : str or sequence of float, optional
        Fixes made of the reference, of a log that has no others: period [s] and 1-sigma [m] of the noise that is added,
        ``"1,0.05"``.

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
    bad_lines: float = 0.0
    allow: str | Iterable[str] = ()
    variable: str | None = None
    offset: float = 0.0
    name: str | None = None
    format: str | None = None
    streams: str | Mapping[str, str] | None = None
    origin: str | Iterable[float] | None = None
    truth_fixes: str | Iterable[float] | None = None

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
                object.__setattr__(self, name, finite_number(value, name, lowest))
        if self.rate is not None and not 1e-4 <= self.rate <= 1e7:
            raise InputError(f"rate: expected a sampling rate in hertz between 1e-4 and 1e7, got {self.rate:g}")
        if self.geoid_separation is not None and abs(self.geoid_separation) > 150.0:
            raise InputError(
                f"geoid_separation: the geoid is within -110..+90 m of the ellipsoid everywhere, got "
                f"{self.geoid_separation:g}; is it in feet, or the height itself?"
            )
        object.__setattr__(self, "offset", finite_number(self.offset, "offset", None))
        if abs(self.offset) > 1e10:
            raise InputError(f"offset: expected seconds within +-1e10, got {self.offset:g}")
        skip = finite_number(self.skip, "skip", None)
        if skip < 0 or skip != int(skip):
            raise InputError(f"skip: expected a number of lines, got {self.skip!r}")
        object.__setattr__(self, "skip", int(skip))
        object.__setattr__(self, "bad_lines", finite_number(self.bad_lines, "bad_lines", None))
        if not 0.0 <= self.bad_lines < 0.5:
            raise InputError(f"bad_lines: expected a share from 0 to 0.5, such as 0.01 for 1 %, got {self.bad_lines:g}")
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
        object.__setattr__(self, "truth_fixes", parse_truth_fixes(self.truth_fixes))
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

    def check_used(self, path: Path, used: Iterable[str], what: str) -> None:
        """Refuse hints that a file answers itself: an :class:`InputError` names those that are not in ``used``."""
        if surplus := sorted(set(self.given()) - set(used)):
            raise InputError(f"{path} is {what} and says this itself; leave out {', '.join(surplus)}")

    def allows(self, check: str) -> bool:
        """Whether a check of :data:`~schuler.recording.io.hint_texts.ALLOWANCES` was lifted."""
        return check in self.allow

    @property
    def sigmas(self) -> tuple[float, ...] | None:
        """The hint ``sigma`` as three or six numbers."""
        return parse_sigma(self.sigma)
