"""Columns of a table: short name, quantity, and the names others give them.

The short names (``ax``, ``lat``, ``svn``, ...) are what users write in the hint ``columns`` and what our own CSV files
carry. Columns of one quantity share a unit, which is stated once per *group* (``accel``, ``gyro``, ``t``, ...).
"""

from __future__ import annotations

import difflib
import re
from collections.abc import Iterable, Sequence
from typing import cast

from schuler import units
from schuler.exceptions import InputError, SchulerError
from schuler.recording.io import header_words

#: Group of columns that share a unit and a scale, to the quantity :func:`schuler.units.factor_for` checks.
GROUP_QUANTITY = {
    "t": "time",
    "accel": "specific force",
    "gyro": "angular rate",
    "temp": "temperature",
    "mag": "magnetic flux density",
    "angle": "angle",
    "length": "length",
    "velocity": "velocity",
}
#: The same for increments: integrals over the sample interval.
INCREMENT_QUANTITY = {**GROUP_QUANTITY, "accel": "velocity", "gyro": "angle"}

ACCEL, GYRO, MAG = ("ax", "ay", "az"), ("gx", "gy", "gz"), ("mx", "my", "mz")
GEODETIC, ECEF, LOCAL = ("lat", "lon", "h"), ("x", "y", "z"), ("n", "e", "d")
VELOCITY, ECEF_VELOCITY = ("vn", "ve", "vd"), ("vx", "vy", "vz")
#: ``radius`` is that of a circle that holds 68 % of horizontal errors, as phones state it.
SIGMA, VELOCITY_SIGMA = ("sn", "se", "sd"), ("svn", "sve", "svd")
CROSS, VELOCITY_CROSS = ("cne", "cnd", "ced"), ("cvne", "cvnd", "cved")
EULER, QUATERNION = ("roll", "pitch", "yaw"), ("qw", "qx", "qy", "qz")
#: Dilution of precision, horizontal and vertical; NaN where it is not known.
DILUTION = ("hdop", "vdop")

#: Column name to its group; ``None`` where the column has no unit or, for covariances, only the SI one.
GROUP: dict[str, str | None] = {
    "t": "t",
    "received": "t",
    **dict.fromkeys(ACCEL, "accel"),
    **dict.fromkeys(GYRO, "gyro"),
    "temp": "temp",
    **dict.fromkeys(MAG, "mag"),
    "lat": "angle",
    "lon": "angle",
    **dict.fromkeys(EULER, "angle"),
    **dict.fromkeys(("heading", "sheading", "course"), "angle"),
    **dict.fromkeys(("h", "sh"), "length"),
    **dict.fromkeys((*SIGMA, "radius", *ECEF, *LOCAL), "length"),
    **dict.fromkeys((*VELOCITY, *VELOCITY_SIGMA, *ECEF_VELOCITY, "speed", "sspeed"), "velocity"),
    **dict.fromkeys((*CROSS, *VELOCITY_CROSS, *QUATERNION, "q", "ns", *DILUTION), None),
}
SKIPS = ("-", "_")
#: Columns whose sign a ``-`` before the name changes.
SIGNED = (*ACCEL, *GYRO, *MAG, *VELOCITY, *ECEF_VELOCITY, *EULER, *LOCAL, "heading", "lat", "lon", "speed")
_CLOCK = ("t",)
#: Columns that belong together where the words of a header tell them, and those that must be there.
_SENSORS = (
    (ACCEL, ACCEL), (GYRO, GYRO), (MAG, MAG), (("lat", "lon", "h", "speed", "course", *VELOCITY), ("lat", "lon")),
    (_CLOCK, _CLOCK),
)  # fmt: skip
#: Stand for three columns where a name is mapped to an N x 3 array (MATLAB and NumPy files).
TRIADS = {"accel": ACCEL, "gyro": GYRO, "mag": MAG}


def _spellings() -> dict[str, str]:
    table = {name: name for name in GROUP if name not in LOCAL}  # an n alone is a counter
    table |= {word: word[0] for word in ("north", "east", "down")}
    for axis in "xyz":
        # linear_acceleration is ROS's specific force; a phone's, without gravity, is refused for what it shows at rest
        for stem in ("acc", "accel", "accelerometer", "acceleration", "linear_acceleration", "specific_force", "f"):
            table |= {f"{stem}_{axis}": f"a{axis}", f"{stem}{axis}": f"a{axis}"}
        for stem in ("gyr", "gyro", "gyroscope", "omega", "w", "angular_rate", "angular_velocity"):
            table |= {f"{stem}_{axis}": f"g{axis}", f"{stem}{axis}": f"g{axis}"}
        for stem in ("mag", "magn", "magnetometer", "magnetic_field", "b_field"):
            table |= {f"{stem}_{axis}": f"m{axis}", f"{stem}{axis}": f"m{axis}"}
        table |= {f"a_{axis}": f"a{axis}", f"g_{axis}": f"g{axis}", f"m_{axis}": f"m{axis}"}
        table |= {f"ac{axis}": f"a{axis}", f"gy{axis}": f"g{axis}"}  # AcX, GyX of Arduino sketches
    for axis in "ned":
        table |= {f"pos_{axis}": axis, f"v_{axis}": f"v{axis}", f"vel_{axis}": f"v{axis}", f"sigma_{axis}": f"s{axis}"}
        table |= {f"sigma_v{axis}": f"sv{axis}", f"sd_{axis}": f"s{axis}"}
    for word in ("time", "timestamp", "stamp", "tow", "gps_tow", "gpstow", "gps_time", "seconds", "ts"):
        table[word] = "t"
    table |= {"temperature": "temp", "tmp": "temp", "latitude": "lat", "longitude": "lon", "lng": "lon", "height": "h"}
    table |= dict.fromkeys(("altitude", "alt"), "h")
    for word in ("accuracy", "horizontal_accuracy"):  # of phones
        table[word] = "radius"
    table |= {"vertical_accuracy": "sd", "speed_accuracy": "sspeed"}
    table |= {"quality": "q", "n_satellites": "ns", "nsat": "ns"}
    table |= dict.fromkeys(("sats", "satellites", "num_sv", "numsv", "num_sats", "nsats"), "ns")
    table |= dict.fromkeys(_LATE_CLOCKS, "t")
    for word in ("cog", "course_over_ground", "bearing"):
        table[word] = "course"
    for word in ("sog", "speed_over_ground", "ground_speed", "groundspeed"):
        table[word] = "speed"
    table |= {"height_above_wgs84_ellipsoid": "h", "hdg": "heading", "sigma_heading": "sheading", "sigma_height": "sh"}
    return table


#: Names of a time where no other column is one.
_LATE_CLOCKS = ("unix_time", "unixtime", "unix", "datetime", "date_time", "epoch", "epoc", "x_value", "timpstemp")
_SPELLINGS = _spellings()
_ACCURACIES = {"hacc": "radius", "vacc": "sd", "sacc": "sspeed"}
#: What stands before a name in tables of several sensors.
_PREFIXES = ("imu_", "gps_", "gnss_", "field_")
#: Names of a time that say its unit.
_CLOCKS = {
    "ms": "ms", "msec": "ms", "millis": "ms", "milliseconds": "ms", "us": "us", "usec": "us", "micros": "us",
    "microseconds": "us", "nanoseconds": "ns",
}  # fmt: skip
# what follows an underscore in names such as ax_m_s2; longer endings are tried first
_ENDINGS = {
    "m_s2": "m/s^2", "mps2": "m/s^2", "ms2": "m/s^2", "mg": "mg", "g": "g", "rad_s": "rad/s", "rads": "rad/s",
    "rps": "rad/s", "radps": "rad/s", "degps": "deg/s",
    "deg_s": "deg/s", "dps": "deg/s", "mdps": "mdps", "degs": "deg/s", "deg_h": "deg/h",
    "s": "s", "sec": "s", "ms": "ms", "us": "us", "ns": "ns", "rad": "rad", "deg": "deg", "m_s": "m/s", "mps": "m/s",
    "km_h": "km/h", "kmh": "km/h", "kmph": "km/h", "kph": "km/h", "kn": "kn", "kt": "kn",
    "knots": "kn", "m": "m", "degc": "degC", "c": "degC", "ut": "uT", "nt": "nT", "gauss": "gauss",
    "mgauss": "mgauss",
}  # fmt: skip
_NO_UNITS = re.compile(
    r"|wgs84|txt|utc|gmt|local|ts|0?x[\da-f]+|[+-]?\d\d:\d\d|[+-]\d{4}"
)  # what apps write in brackets besides
_DEGREES = ("C", "°C", "degC")  # of a T that is a temperature for sure
_LONGEST = 200  # characters of a name worth looking at
_HUMP = re.compile(r"([a-z0-9])([A-Z])")
_BRACKETED = re.compile(r"^(.*?)\s*(?:\[\s*([^\]]*?)\s*\]|\(\s*([^)]*?)\s*\))\s*$")


def recognise(header: str) -> tuple[str, str | None] | None:
    """Column that a header field names, and the unit it states.

    Parameters
    ----------
    header : str
        For example ``"ax"``, ``"acc_x_m_s2"``, ``"imu.gyro.z"`` or ``"IMU::Accel::X [m/s^2]"``.

    Returns
    -------
    tuple of str and str or None, or None
        The column's short name and the text of the unit if there is one; ``None`` if the name is not known.
    """
    if len(header) > _LONGEST:
        return None
    text, unit = _text_and_unit(header)
    for word in dict.fromkeys((_plain(text), _plain(_HUMP.sub(r"\1_\2", text)))):  # speedKmph as speed_kmph
        for name in dict.fromkeys((word, *(word.removeprefix(prefix) for prefix in _PREFIXES))):
            if name in _SPELLINGS:
                return _turning(_SPELLINGS[name], unit), unit
            if name in _CLOCKS:
                return "t", unit or _CLOCKS[name]
            if unit is None and (ending := _ending(name)) is not None:
                return _SPELLINGS[name.removesuffix(f"_{ending}")], _ENDINGS[ending]
    return None


def _turning(name: str, unit: str | None) -> str:
    """A roll, pitch or yaw as the rate about that axis where its unit is one; other names as they are."""
    if name not in EULER or unit is None:
        return name
    try:
        units.factor_for(unit, GROUP_QUANTITY["gyro"])
    except SchulerError:
        return name
    return GYRO[EULER.index(name)]


def recognise_all(headers: Sequence[str]) -> list[tuple[str, str | None] | None]:
    """Columns that the fields of a header name, one time among them where only one is sure to be it.

    Parameters
    ----------
    headers : sequence of str

    Notes
    -----
    A ``T`` beside another time is a temperature; ``datetime``, ``unix`` and the like are times where nothing else is.
    Where no spelling that is known tells a sensor, the words of all fields together do
    (:mod:`schuler.recording.io.header_words`).
    """
    read = _recognised(headers)
    texts = ["" if len(header) > _LONGEST else _text_and_unit(header)[0] for header in headers]
    by_words = header_words.by_words(texts)
    held = [None if column is None else column[0] for column in read]
    for group, needed in _SENSORS:
        named = {k: name for k, name in by_words.items() if name in group and held[k] in (None, *group)}
        if not set(needed) <= set(named.values()):
            continue
        times = {name: held.count(name) for name in needed}
        if set(times.values()) == {1} and not _better(group, named, held, texts):
            if any(held[k] != name for k, name in named.items() if name in needed):
                continue
            named = {k: name for k, name in named.items() if name not in held}
        elif group == _CLOCK and times["t"] > 1:
            continue  # which is meant is to be asked
        else:
            read = [None if name in group else column for name, column in zip(held, read, strict=True)]
        for k, name in named.items():
            read[k] = (name, unit_in(headers[k]))
        held = [None if column is None else column[0] for column in read]
    if {"lat", "lon"} <= set(held):  # of two heights or speeds the receiver's is the fix's
        for name in ("h", "speed", "course"):
            twice = [k for k, other in enumerate(held) if other == name]
            received = [k for k in twice if header_words.is_foreign(header_words.words_of(texts[k]))]
            if len(received) == 1:
                read = [None if k in twice and k not in received else column for k, column in enumerate(read)]
        read = _with_accuracies(read, headers)
    return read


def _with_accuracies(
    read: list[tuple[str, str | None] | None], headers: Sequence[str]
) -> list[tuple[str, str | None] | None]:
    """Columns of fixes with the accuracies that receivers call hAcc, vAcc, sAcc; elsewhere these are accelerations."""
    read = list(read)
    for k, header in enumerate(headers):
        text, unit = _text_and_unit(header)
        word = _plain(text).removesuffix("_m").removesuffix("_m_s").replace("_", "")
        name = _ACCURACIES.get(word.removeprefix("gps").removeprefix("gnss"))
        if name is None or read[k] is not None or any(column is not None and column[0] == name for column in read):
            continue
        try:
            if unit is not None:
                units.factor_for(unit, GROUP_QUANTITY[str(GROUP[name])])
        except SchulerError:
            continue
        read[k] = (name, unit)
    return read


def _is_other_letter(column: tuple[str, str | None] | None, header: str) -> bool:
    """Whether an ``H`` has a unit that is none of height, as that of humidity."""
    if column is None or column[0] != "h" or column[1] is None or len(_plain(_text_and_unit(header)[0])) > 1:
        return False
    try:
        units.factor_for(column[1], GROUP_QUANTITY["length"])
    except SchulerError:
        return True
    return False


def _better(group: Sequence[str], named: dict[int, str], held: Sequence[str | None], texts: Sequence[str]) -> bool:
    """Whether columns named by their words are likelier than those named by spellings that are known."""
    if group == ACCEL:  # a phone's linear_acceleration, without gravity, has its accelerometer beside it
        spelled = header_words.words_of(texts[held.index("ax")])
        return any(header_words.is_g_force(texts[k]) for k in named) or "linear" in spelled
    if "lat" in group:  # a height beside the receiver's own is a barometer's
        foreign = {name: header_words.is_foreign(header_words.words_of(texts[k])) for k, name in named.items()}
        return any(
            held.count(name) == 1
            and of_it
            and not header_words.is_foreign(header_words.words_of(texts[held.index(name)]))
            for name, of_it in foreign.items()
        )
    return group == _CLOCK and header_words.is_foreign(header_words.words_of(texts[held.index("t")]))


def _recognised(headers: Sequence[str]) -> list[tuple[str, str | None] | None]:
    """Columns that fields of a header name by spellings that are known."""
    read = [
        None if _is_other_letter(column, header) else column for header in headers for column in (recognise(header),)
    ]
    times = [k for k, column in enumerate(read) if column is not None and column[0] == "t"]
    words = {k: headers[k].strip().strip("\"'") for k in times}
    warm = [k for k in times if re.fullmatch(r"T\s*([\[(].*)?", words[k])]
    warm = [k for k in warm if cast(tuple[str, str | None], read[k])[1] in _DEGREES] or warm
    late = [k for k in times if k not in warm and _plain(_HUMP.sub(r"\1_\2", words[k])) in _LATE_CLOCKS]
    late = [k for k in late if k > 0 or unit_in(headers[k]) is None]  # the first of a table with a unit is the clock
    sure = len(times) - len(warm) - len(late)
    if len(times) > 1 and sure <= 1 and (sure or late):
        named = any(column is not None and column[0] == "temp" for column in read)
        for k in warm:
            read[k] = None if named or len(warm) > 1 else ("temp", cast(tuple[str, str | None], read[k])[1])
        for k in late if sure else late[1:]:
            read[k] = None
    return read


def unit_in(header: str) -> str | None:
    """Unit that a header field states, in brackets or as a known ending of a known name; ``None`` if there is none."""
    if len(header) > _LONGEST:
        return None
    if (column := recognise(header)) is not None:
        return column[1]
    text, unit = _text_and_unit(header)
    return unit or header_words.time_unit(text) or header_words.sensor_unit(text)


def _text_and_unit(header: str) -> tuple[str, str | None]:
    """A field of a header without quotes, and the unit in brackets behind it."""
    text = header.strip().strip("\"'")
    match = _BRACKETED.match(text)
    unit = "" if match is None else (match[2] or match[3] or "").strip("'\"")
    if match is None or unit.isdigit():
        return text, None
    return match[1], None if _NO_UNITS.fullmatch(unit.lower()) else unit


def _plain(text: str) -> str:
    return re.sub(r"[^a-z0-9]+", "_", text.lower()).strip("_")


def _ending(word: str) -> str | None:
    for ending in sorted(_ENDINGS, key=len, reverse=True):
        if word.endswith(f"_{ending}") and word.removesuffix(f"_{ending}") in _SPELLINGS:
            return ending
    return None


def check_known(word: str, choices: Iterable[str], what: str) -> str:
    """The word itself if it is one of those known.

    Raises
    ------
    InputError
        Otherwise; the message lists what is known and proposes the nearest.
    """
    choices = list(choices)
    if word in choices:
        return word
    near = difflib.get_close_matches(word, choices, n=1)
    suggestion = f"; did you mean {near[0]!r}?" if near else "."
    raise InputError(f"{what}: {word!r} is not known{suggestion} Known are: {', '.join(choices)}")


#: Velocity of a fix as receivers, phones and cars state it, and the 1-sigma of the speed.
OVER_GROUND = ("speed", "course", "sspeed")
#: Columns that make up each series.
BELONGS = {
    "imu": {"t", *ACCEL, *GYRO, "temp", *MAG},
    "gnss": {
        "t",
        *GEODETIC,
        *LOCAL,
        *VELOCITY,
        *SIGMA,
        "radius",
        *VELOCITY_SIGMA,
        *CROSS,
        *VELOCITY_CROSS,
        "q",
        "ns",
        "received",
        *DILUTION,
        *OVER_GROUND,
    },
    "odometer": {"t", "speed", "sspeed"},
    "heading": {"t", "heading", "sheading"},
    "height": {"t", "h", "sh"},
    "reference": {"t", *GEODETIC, *LOCAL, *VELOCITY, *ECEF, *ECEF_VELOCITY, *EULER, *QUATERNION},
}


#: Series of one number, and the column that holds it.
NUMBER_OF = {"heading": "heading", "height": "h"}


def series_of(names: Iterable[str]) -> list[str]:
    """Series that a set of columns holds something of: "imu", "gnss", "odometer", "heading", "height", "reference".

    A heading or a height among other series' columns is nothing of its own: many a receiver writes one beside its
    positions. Alone they are a compass's and a barometer's.
    """
    present = set(names)
    kinds = []
    if present & {*ACCEL, *GYRO}:
        kinds.append("imu")
    if present & {"lat", "lon"}:
        kinds.append("gnss")
    if "speed" in present and not present >= {"lat", "lon"}:  # beside a position it is the receiver's
        kinds.append("odometer")
    if present & set(ECEF) or (present >= set(LOCAL) and "lat" not in present):
        kinds.append("reference")
    return kinds or [series for series, column in NUMBER_OF.items() if column in present]
