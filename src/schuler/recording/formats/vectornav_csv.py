"""Tables (CSV) of VectorNav's programs: columns by the names of the sensor's outputs, in the sensor's units.

Control Center and the exporters of VectorNav's libraries write a column for each number of an output, in an order that
depends on what was logged and with names that differ in punctuation: ``UncompAccX``, ``Imu.UncompAccel.X [m/s^2]``.
They become the columns that packets have, see ``vectornav_packets``.
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from schuler import units
from schuler.exceptions import FileFormatError
from schuler.recording.formats.vectornav_packets import Columns, Packets
from schuler.recording.io import lines
from schuler.recording.io.lines import TextTable

_NAME = re.compile(r"^\s*\"?([^\[\(\"]*)[\[\(]?([^\]\)\"]*)")
_GROUPS = ("imu", "time", "common", "attitude", "ins", "gnss1", "gnss", "gps1", "gps", "vn")
_NS = {"ns": 1.0, "us": 1e3, "ms": 1e6, "s": 1e9}  # clocks are kept in whole nanoseconds
_UNITS: dict[str, dict[str, float]] = {
    "clock": {"": 1.0, **_NS}, "accel": {"": 1.0, "m/s^2": 1.0, "m/s2": 1.0, "m/s/s": 1.0},
    "gyro": {"": 1.0, "rad/s": 1.0, "deg/s": units.DEG}, "second": {"": 1.0, "s": 1.0},
    "degree": {"": 1.0, "deg": 1.0, "degrees": 1.0}, "metre": {"": 1.0, "m": 1.0}, "speed": {"": 1.0, "m/s": 1.0},
    "any": {"": 1.0, "c": 1.0, "celsius": 1.0, "degc": 1.0},
}  # fmt: skip


def _known() -> dict[str, tuple[str, str]]:
    """Column and kind of unit by a name without punctuation and group."""
    names = {
        "timestartup": ("startup", "clock"), "startup": ("startup", "clock"), "timegps": ("gps", "clock"),
        "gpstow": ("tow", "clock"), "timegpstow": ("tow", "clock"), "tow": ("tow", "clock"),
        "gpsweek": ("week", "any"), "timegpsweek": ("week", "any"), "week": ("week", "any"),
        "temp": ("temp", "any"), "temperature": ("temp", "any"),
        "deltatime": ("dt", "second"), "deltathetatime": ("dt", "second"),
        "latitude": ("lat", "degree"), "lat": ("lat", "degree"),
        "longitude": ("lon", "degree"), "lon": ("lon", "degree"),
        "altitude": ("h", "metre"), "alt": ("h", "metre"), "insstatus": ("ins", "any"),
        "yaw": ("yaw", "degree"), "pitch": ("pitch", "degree"), "roll": ("roll", "degree"),
    }  # fmt: skip
    for k, axis in enumerate("xyz"):
        for end in (axis, str(k)):
            names |= {f"{name}{end}": (f"raw_a{axis}", "accel") for name in ("uncompacc", "uncompaccel")}
            names |= {f"{name}{end}": (f"raw_g{axis}", "gyro") for name in ("uncompgyro", "uncompangularrate")}
            names |= {f"{name}{end}": (f"comp_a{axis}", "accel") for name in ("acc", "accel")}
            names |= {f"{name}{end}": (f"comp_g{axis}", "gyro") for name in ("gyro", "angularrate", "rate")}
            names |= {f"deltatheta{end}": (f"dth{axis}", "degree"), f"deltavel{end}": (f"dv{axis}", "speed")}
    for axis in "ned":
        names |= {f"{name}{axis}": (f"v{axis}", "speed") for name in ("velned", "vel", "velocity")}
    return names


_KNOWN = _known()


@dataclass(frozen=True)
class _Header:
    delimiter: str
    width: int
    #: Place, and factor to the unit of packets, by column.
    columns: dict[str, tuple[int, float]]


def looks_like(head: bytes) -> bool:
    """Whether the first line names outputs of a VectorNav sensor: its clock since startup, or uncompensated triads.

    Their units are looked at when the table is read.
    """
    if b"\x00" in head[:4000] or b"Time::GpsTow [ns]" in head[:4000]:  # INSTINCT has a reader of its own
        return False
    first = head[:4000].removeprefix(b"\xef\xbb\xbf").partition(b"\n")[0].decode("latin-1")
    header = _header(first, any_unit=True)
    triads = [{f"{kind}_{letter}{axis}" for letter in "ag" for axis in "xyz"} for kind in ("raw", "comp")]
    names = set(header.columns)
    return (
        triads[0] <= names
        or (triads[1] <= names and bool({"startup", "gps"} & names))
        or {"dt", "dthx", "dvx"} <= names
    )


def _header(first: str, *, any_unit: bool = False) -> _Header:
    """Columns of a line of names. Raises ValueError for a unit that the sensor's outputs do not have, unless told."""
    delimiter = max(",;\t", key=first.count)
    columns: dict[str, tuple[int, float]] = {}
    fields = first.rstrip("\r\n").split(delimiter)
    for place, field in enumerate(fields):
        match = _NAME.match(field)
        words = [w for w in re.split(r"[^a-z0-9]+", (match.group(1) if match else "").lower()) if w]
        whole = "".join(words)
        while whole not in _KNOWN and len(words) > 1 and words[0] in _GROUPS:
            words = words[1:]
            whole = "".join(words)
        if match is None or whole not in _KNOWN:
            continue
        name, kind = _KNOWN[whole]
        unit = match.group(2).strip().lower()
        if unit not in _UNITS[kind] and not any_unit:
            raise ValueError(f"{field.strip()}: expected {' or '.join(u for u in _UNITS[kind] if u)}")
        columns.setdefault(name, (place, _UNITS[kind].get(unit, math.nan)))
    return _Header(delimiter, len(fields), columns)


def load(path: Path, *, allow_truncated: bool) -> Packets:
    """Columns of a table, as of one kind of packet called ``CSV``.

    Raises
    ------
    FileFormatError
        For a unit that is not the sensor's, or a line that does not fit the names.
    """
    encoding = lines.encoding_of(lines.check_file(path), path)
    with path.open(encoding=encoding, errors="replace") as stream:
        first = stream.readline(100_000).removeprefix("\ufeff")
    try:
        header = _header(first)
    except ValueError as error:
        raise FileFormatError(f"{error}; read the table with columns=.. and units=..", path, 1) from error
    table = TextTable(path, 2, header.delimiter, "#", encoding)
    places = [place for place, _ in header.columns.values()]
    values, truncated = lines.load(table, header.width, places, allow_truncated=allow_truncated)
    rows: Columns = {}
    notes = [f"Columns by their names: {', '.join(header.columns)}."]
    for k, (name, (_, factor)) in enumerate(header.columns.items()):
        column = values[:, k] * factor
        if name in ("startup", "gps", "tow"):
            with np.errstate(invalid="ignore"):  # of infinite stamps, which are refused as times
                rows[f"{name}_s"] = column // 1e9
                rows[f"{name}_rest"] = column % 1e9 * 1e-9
        else:
            rows[name] = column
    if "tow_s" in rows and "week" in rows:  # has more digits than nanoseconds since 1980 in float64
        for name in ("gps_s", "gps_rest"):
            rows.pop(name, None)
    elif "gps_s" in rows:
        notes.append("Nanoseconds since 1980 were read as floating-point numbers, which tell 256 ns apart.")
    if truncated:
        notes.append(f"{path.name}: the last line was cut off and left out.")
    return Packets(path, {"CSV": rows}, {}, notes)
