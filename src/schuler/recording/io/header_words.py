"""Headers of several words, as apps and loggers write them: which column each is, told by all of a header.

``accelerometerAccelerationX(G)`` beside ``motionUserAccelerationX(G)``, ``IMU_ATTI(0):gyroZ``, ``GPS_coord[1]``: the
words tell the quantity and the axis, those left over tell one sensor of a table from another.
"""

from __future__ import annotations

import re
import unicodedata
from collections import defaultdict
from collections.abc import Sequence

_HUMP = re.compile(r"([a-z0-9]{2})([A-Z])|([A-Z])([A-Z][a-z])")
#: Quantities by the words that name them; the first word is that of a sensor, which counts more than a general one.
_SENSORS = {
    "a": ("acc", "accel", "accelerometer", "acceleration", "gforce", "gf", "beschl", "beschleunigung", "aceleracion"),
    "g": ("gyr", "gyro", "gyroscope", "angvel", "pqr", "drehrate", "winkelgeschwindigkeit"),
    "m": ("mag", "magn", "magnetometer"),
}
_GENERAL = {
    "a": (("specific", "force"), ("g", "force")),
    "g": (("rotation", "rate"), ("angular", "rate"), ("angle", "rate"), ("angular", "velocity"), ("rate",)),
}
_AXES = {"x": 0, "y": 1, "z": 2}
#: Axes of a vehicle: of its accelerations, and of its rates.
_VEHICLE = {
    "a": {
        **dict.fromkeys(("inline", "longitudinal", "forward", "long"), 0),
        **dict.fromkeys(("lateral", "lat"), 1),
        **dict.fromkeys(("vertical", "vert", "down"), 2),
    },
    "g": {"roll": 0, "pitch": 1, "yaw": 2},
}
_TURNING = ("vel", "velocity", "speed")  # of a roll, pitch or yaw
_PLACES = {
    "lat": ("lat", "latitude", "latit", "latitud", "breite", "breitengrad"),
    "lon": ("lon", "long", "lng", "longitude", "longitud", "lange", "laenge", "langengrad"),
    "h": ("alt", "altitude", "height", "elevation", "ele", "hmsl", "altitud", "hohe", "hoehe"),
    "speed": ("speed", "geschwindigkeit", "tempo", "vitesse", "velocidad"),
    "course": ("course", "heading", "bearing", "cog", "track", "dir", "kurs", "rumbo"),
}
#: Beginnings of words of a height, words that make it one above the ellipsoid, and one that is no receiver's.
_HIGH = ("alt", "heigh", "hgt", "elev", "hohe", "hoehe", "haut", "hmsl", "ellip", "hae")
_ELLIPSOID = frozenset(("ellipsoid", "ellipsoidal", "ellips", "ellip", "hae", "wgs"))
_LENGTHS = {"ft": "ft", "feet": "ft", "foot": "ft", "mm": "mm", "cm": "cm", "m": "m", "km": "km"}
_NO_HEIGHT = frozenset((
    "baro", "barometer", "barometric", "pressure", "relative", "rel", "geoid", "separation", "sep", "undulation",
    "agl", "terrain", "radar", "sonar", "lidar", "antenna", "change", "gain", "rate", "speed", "velocity", "vel",
    "alternate", "alternator", "satellite", "sat", "sun", "mask", "azimuth", "acc", "type",
    "mode", "count", "min", "max", "diff",
))  # fmt: skip
#: Places in one array, ``GPS_coord[1]``, ``lla[2]``.
_COORDINATES = {"coord 0": "lat", "coord 1": "lon"} | {
    f"{word} {k}": name for word in ("lla", "llh") for k, name in enumerate(("lat", "lon", "h"))
}
_VELOCITY = {"n": "vn", "e": "ve", "d": "vd", "north": "vn", "east": "ve", "down": "vd"}
_TIME = ("time", "timestamp", "cts", "clock", "millis", "micros")
#: Words of a sensor or a receiver, which do not tell one from another of their kind.
_RECEIVER = frozenset(("gps", "gnss", "location"))
#: Words that tell nothing: of a speed over ground in two dimensions, of a place in two numbers, of the first receiver.
_FILLERS = frozenset(
    (
        "ground",
        "over",
        "2",
        "d",
        "coord",
        "0",
        "1",
        "degrees",
        "deg",
        "meters",
        "metres",
        "mps",
        "pos",
        "position",
        "enhanced",
    )
)
#: Words that make another quantity of what they stand beside: motion without gravity, attitudes, claims, commands.
_OTHERS = frozenset((
    "linear", "user", "free", "gravity", "world", "earth", "global", "enu", "ned", "bias", "offset", "std", "sigma",
    "stddev", "var", "variance", "err", "error", "sd", "composite", "norm", "total", "magnitude", "angle", "angles",
    "euler", "roll", "pitch", "yaw", "cmd", "command", "setpoint", "target", "ref", "reference", "home", "accuracy",
    "uncertainty", "dop", "hdop", "vdop", "pdop", "fix", "status", "temp", "temperature", "delta",
    "vertical", "direction", "gt", "truth", "true", "ekf", "kf", "filtered", "estimated", "est", "fused", "ins",
))  # fmt: skip
_RATES = {"rad": "rad/s", "rads": "rad/s", "deg": "deg/s", "dps": "deg/s", "mdps": "mdps"}
_TIME_UNITS = {"ms": "ms", "msec": "ms", "millis": "ms", "us": "us", "micros": "us", "ns": "ns", "s": "s", "sec": "s"}


def words_of(text: str) -> list[str]:
    """Words of a field without its unit, in lower case and without accents: ``gyroADC[0]`` is gyro, adc, 0."""
    plain = text if text.isascii() else unicodedata.normalize("NFKD", text).encode("ascii", "ignore").decode()
    spaced = _HUMP.sub(lambda m: f"{m[1] or m[3]} {m[2] or m[4]}", plain)
    return [word for part in re.findall(r"[A-Za-z]+|\d+", spaced) if (word := part.lower())]


def by_words(texts: Sequence[str]) -> dict[int, str]:
    """Columns that the words of a header name, each at most once.

    Parameters
    ----------
    texts : sequence of str
        Fields of the header without their units.

    Returns
    -------
    dict of int to str
        Short names by position. A triad is named where one sensor has all of its axes and no other is as likely, a
        place where latitude and longitude are; what is left open is not named.
    """
    words = [words_of(text) for text in texts]
    named: dict[int, str] = {}
    for stem in "agm":
        named |= _triad(words, stem)
    named |= _fix(words)
    clock = _clock(words)
    return named if clock is None else named | {clock: "t"}


def time_unit(text: str) -> str | None:
    """Unit of a time that stands behind it in words, ``Time since start in ms``; None if there is none."""
    words = words_of(text)
    return _TIME_UNITS.get(words[-1]) if set(_TIME) & set(words[:-1]) else None


def sensor_unit(text: str) -> str | None:
    """Unit among the words of a name, ``gyro_rad[0]``, ``accelerometer_m_s2[0]``, ``alt_ft``; None if there is none."""
    words = words_of(text)
    if any(word.startswith(_HIGH) for word in words):
        return _LENGTHS.get(words[-1])
    if set(_SENSORS["g"]) & set(words):
        return next((unit for word, unit in _RATES.items() if word in words), None)
    metres = any(words[k : k + 3] == ["m", "s", "2"] for k in range(len(words)))
    return "m/s^2" if metres and set(_SENSORS["a"]) & set(words) else None


def _triad(words: Sequence[list[str]], stem: str) -> dict[int, str]:
    """Axes of the one sensor of a kind that has all three; the more telling its words, the likelier."""
    families: defaultdict[tuple[str, ...], dict[int, int]] = defaultdict(dict)
    for k, field in enumerate(words):
        split = _sensor_and_axis(field, stem)
        turns = {"rate", *_TURNING, *_SENSORS["g"]} & set(field)
        others = _OTHERS - {"angle", "roll", "pitch", "yaw"} if turns else _OTHERS - {"vertical"}
        if split is not None and not others & set(field):
            families[split[0]].setdefault(split[1], k)
    whole = {family: axes for family, axes in families.items() if len(axes) == 3}
    likely = [axes for family, axes in whole.items() if _is_sensor(family, stem)] or list(whole.values())
    # axes turned from the sensor's, and rates with their biases in them, only where there are no others
    for word in ("vehicle", "uncalibrated"):
        rest = [axes for family, axes in whole.items() if axes in likely and word not in family]
        likely = rest if len(likely) > 1 else likely
    if len(likely) != 1:
        return {}
    return {k: f"{stem}{'xyz'[axis]}" for axis, k in likely[0].items()}


def _sensor_and_axis(field: list[str], stem: str) -> tuple[tuple[str, ...], int] | None:
    """Words of a sensor of a kind without its axis, and the axis: a letter or a number behind them, or between."""
    general = _GENERAL.get(stem, ())
    for word, along in _VEHICLE.get(stem, {}).items():
        rest = [other for other in field if other != word]
        of_it = bool({*_SENSORS[stem], *(_TURNING if stem == "g" else ())} & set(rest)) or any(
            set(phrase) <= set(rest) for phrase in general
        )
        if word in field and of_it:
            return (*rest, "vehicle"), along
    for k in range(len(field) - 1, -1, -1):
        word, rest = field[k], [*field[:k], *field[k + 1 :]]
        for letter, sensor in ((word[-1:], word[:-1]), (word[:1], word[1:])):  # accx, xacc
            if letter in _AXES and sensor in _SENSORS[stem]:
                return (*field[:k], sensor, *field[k + 1 :]), _AXES[letter]
        if k and k == len(field) - 1 and word[:1] == stem and word[1:] in _AXES:  # mpu_ax
            return (*field[:k], stem), _AXES[word[1:]]
        axis = _AXES.get(word, int(word) if word in ("0", "1", "2") and k == len(field) - 1 else None)
        if axis is None:
            continue
        if set(_SENSORS[stem]) & set(rest) or any(set(phrase) <= set(rest) for phrase in general):
            return tuple(rest), axis
    return None


def is_g_force(text: str) -> bool:
    """Whether a field is of specific force in g by its words; apps write motion without gravity as ``ax`` beside it."""
    words = words_of(text)
    return {"g", "force"} <= set(words) or any(word in ("gforce", "gfx", "gfy", "gfz") for word in words)


def is_foreign(words: Sequence[str]) -> bool:
    """Whether words are of a receiver: its time is that of its fixes."""
    return bool(_RECEIVER & set(words))


def _is_sensor(family: tuple[str, ...], stem: str) -> bool:
    return bool(set(_SENSORS[stem]) & set(family))


def _fix(words: Sequence[list[str]]) -> dict[int, str]:
    """Columns of the one receiver with a latitude and a longitude, and what else it has."""
    families: defaultdict[frozenset[str], dict[str, int]] = defaultdict(dict)
    for k, field in enumerate(words):
        if _OTHERS & set(field):
            continue
        coordinate = _COORDINATES.get(" ".join(field[-2:]))
        for name, spelled in _PLACES.items():
            if (coordinate == name) or set(spelled) & set(field):
                rest = frozenset(field) - set(spelled) - _FILLERS - {"lla", "llh"}
                families[rest].setdefault(name, k)
                break
        else:
            if field[-1:] and field[-1] in _VELOCITY and set(field) & {"vel", "velocity"}:
                rest = frozenset(field) - {field[-1], "vel", "velocity"} - _FILLERS
                families[rest].setdefault(_VELOCITY[field[-1]], k)
    whole = {family: receiver for family, receiver in families.items() if {"lat", "lon"} <= set(receiver)}
    likely = [family for family in whole if _RECEIVER & family] or list(whole)
    if len(likely) != 1:
        return {}
    receiver = dict(whole[likely[0]])
    # a height above the sea, or words of the receiver that only some of its columns have
    for family, more in families.items():
        if _RECEIVER & family and family - {"msl", "amsl", "sea", "level"} <= likely[0] | _RECEIVER:
            of_it = {name: k for name, k in more.items() if name not in ("lat", "lon")}
            receiver = more | receiver if _RECEIVER & likely[0] else receiver | of_it
    if "h" not in receiver and (height := _height(words)) is not None:
        receiver["h"] = height
    return {k: name for name, k in receiver.items()}


def may_be_height(words: Sequence[str]) -> bool:
    """Whether the words of a field may be those of a height of fixes."""
    return any(word.startswith(_HIGH) for word in words) and not (_OTHERS | _NO_HEIGHT) & set(words)


def _height(words: Sequence[list[str]]) -> int | None:
    """The one column that may be a height of fixes, of two that above the ellipsoid."""
    likely = [k for k, field in enumerate(words) if may_be_height(field)]
    likely = [k for k in likely if _ELLIPSOID & set(words[k])] or likely
    return likely[0] if len(likely) == 1 else None


def _clock(words: Sequence[list[str]]) -> int | None:
    """The likeliest time of an IMU's samples, None if two are as likely."""
    scores: dict[int, int] = {}
    for k, field in enumerate(words):
        if set(_TIME) & set(field):
            sensor = any(set(spelled) & set(field) for spelled in _SENSORS.values())
            foreign = is_foreign(field) or bool({"heading", "utc", "local", "zone", "chip"} & set(field))
            scores[k] = 2 * sensor - 3 * foreign - ("clock" in field and "time" not in field)
    best = [k for k, score in scores.items() if score == max(scores.values())]
    accel = [k for k in best if set(_SENSORS["a"]) & set(words[k])]  # of two sensors' the first
    return best[0] if len(best) == 1 else accel[0] if len(accel) == 1 else None
