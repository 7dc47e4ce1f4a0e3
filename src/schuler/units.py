"""Conversion factors and a small reader of unit strings, for the edges of the package only.

Inside the package every number is SI and every angle in radians. A factor converts *to* SI by multiplication:
``rate = 3.0 * DEG_PER_HR`` is three degrees an hour in rad/s.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from fractions import Fraction
from math import inf, pi

from schuler.exceptions import UnitError

DEG = pi / 180.0  # [rad]
ARCSEC = DEG / 3600.0  # [rad]
MIN = 60.0  # [s]
HR = 3600.0  # [s]
G0 = 9.80665  # standard gravity, the "g" of data sheets, never the local gravity [m/s^2]
MG = 1e-3 * G0  # [m/s^2]
UG = 1e-6 * G0  # [m/s^2]
MGAL = 1e-5  # [m/s^2]
PPM = 1e-6  # [-]
PERCENT = 1e-2  # [-]
UT = 1e-6  # [T]
GAUSS = 1e-4  # [T]
NMI = 1852.0  # [m]
KM = 1000.0  # [m]
MILE = 1609.344  # [m]
FT = 0.3048  # [m]
KNOT = NMI / HR  # [m/s]
KMH = KM / HR  # [m/s]
DEG_PER_HR = DEG / HR  # [rad/s]
DEG_PER_RTHR = DEG / 60.0  # angle random walk, deg/sqrt(h) [rad/sqrt(s) = (rad/s)/sqrt(Hz)]
DEG_PER_S_PER_RTHZ = DEG  # [(rad/s)/sqrt(Hz)]
DEG_PER_HR_PER_RTHZ = DEG_PER_HR  # [(rad/s)/sqrt(Hz)]
MPS_PER_RTHR = 1.0 / 60.0  # velocity random walk, m/s/sqrt(h) [(m/s^2)/sqrt(Hz)]
UG_PER_RTHZ = UG  # [(m/s^2)/sqrt(Hz)]
DEG_PER_HR_PER_G = DEG_PER_HR / G0  # [(rad/s)/(m/s^2)]

# Exponents of (length, time, angle, temperature, magnetic flux density); an angle is kept as a dimension so that "1/s"
# is no angular rate.
Dimension = tuple[Fraction, Fraction, Fraction, Fraction, Fraction]


def _dim(length: int = 0, time: int = 0, angle: int = 0, temperature: int = 0, field: int = 0) -> Dimension:
    return (Fraction(length), Fraction(time), Fraction(angle), Fraction(temperature), Fraction(field))


#: What the readers may ask for; the SI unit of each is the second entry.
QUANTITIES: dict[str, tuple[Dimension, str]] = {
    "time": (_dim(time=1), "s"),
    "angle": (_dim(angle=1), "rad"),
    "angular rate": (_dim(time=-1, angle=1), "rad/s"),
    "specific force": (_dim(length=1, time=-2), "m/s^2"),
    "velocity": (_dim(length=1, time=-1), "m/s"),
    "length": (_dim(length=1), "m"),
    "temperature": (_dim(temperature=1), "degC"),
    "magnetic flux density": (_dim(field=1), "T"),
    "ratio": (_dim(), "1"),
}

_ATOMS: dict[str, tuple[float, Dimension]] = {
    "1": (1.0, _dim()),
    "rad": (1.0, _dim(angle=1)),
    "mrad": (1e-3, _dim(angle=1)),
    "urad": (1e-6, _dim(angle=1)),
    "deg": (DEG, _dim(angle=1)),
    "mdeg": (1e-3 * DEG, _dim(angle=1)),
    "arcmin": (DEG / 60.0, _dim(angle=1)),
    "arcsec": (ARCSEC, _dim(angle=1)),
    "rev": (2.0 * pi, _dim(angle=1)),
    "semicircles": (pi / 2.0**31, _dim(angle=1)),  # of 32 bits, as Garmin writes places
    "s": (1.0, _dim(time=1)),
    "ms": (1e-3, _dim(time=1)),
    "us": (1e-6, _dim(time=1)),
    "ns": (1e-9, _dim(time=1)),
    "min": (MIN, _dim(time=1)),
    "h": (HR, _dim(time=1)),
    "Hz": (1.0, _dim(time=-1)),
    "m": (1.0, _dim(length=1)),
    "cm": (1e-2, _dim(length=1)),
    "mm": (1e-3, _dim(length=1)),
    "km": (KM, _dim(length=1)),
    "ft": (FT, _dim(length=1)),
    "nmi": (NMI, _dim(length=1)),
    "mi": (MILE, _dim(length=1)),
    "kn": (KNOT, _dim(length=1, time=-1)),
    "g": (G0, _dim(length=1, time=-2)),
    "mg": (MG, _dim(length=1, time=-2)),
    "ug": (UG, _dim(length=1, time=-2)),
    "mGal": (MGAL, _dim(length=1, time=-2)),
    "ppm": (PPM, _dim()),
    "%": (PERCENT, _dim()),
    "degC": (1.0, _dim(temperature=1)),
    "T": (1.0, _dim(field=1)),
    "mT": (1e-3, _dim(field=1)),
    "uT": (UT, _dim(field=1)),
    "nT": (1e-9, _dim(field=1)),
    "gauss": (GAUSS, _dim(field=1)),
    "mgauss": (1e-7, _dim(field=1)),
    "K": (1.0, _dim(temperature=1)),  # of a difference, as in ppm/K; factor_for refuses it for temperatures themselves
}
# what g and mg mean where a magnetic flux density is asked for
_GAUSS = {"g": "gauss", "mg": "mgauss"}
# written in capitals or with a capital somewhere these still mean one thing; "Mg" and "Ms" would not
_ANY_CASE = {
    "deg", "mdeg", "rad", "mrad", "rev", "min", "arcsec", "arcmin", "km", "kn", "nmi", "ft", "hz", "degc", "g", "s",
    "h", "m",
}  # fmt: skip
_MAX_EXPONENT, _MAX_DEPTH = 9, 8
_SPELLINGS = {
    "hz": "Hz", "degc": "degC", "rpm": "rev/min", "rthz": "sqrt(Hz)", "rthr": "sqrt(h)", "rth": "sqrt(h)",
    "hr": "h", "hour": "h", "sec": "s", "second": "s", "dps": "deg/s", "mdps": "mdeg/s", "dph": "deg/h",
    "kph": "km/h", "kmh": "km/h", "mph": "mi/h",
    "knots": "kn", "knot": "kn", "gal": "cm/s^2", "degree": "deg", "degrees": "deg", "radian": "rad", "radians": "rad",
    "grad": "deg",
    "celsius": "degC", "µg": "ug", "μg": "ug", "µs": "us", "μs": "us", "µrad": "urad", "μrad": "urad", "°": "deg",
    "°C": "degC", "℃": "degC", "C": "degC", "mps": "m/s", "mps2": "m/s^2", "arcs": "arcsec", "microg": "ug",
    "mgal": "mGal",
    "ut": "uT", "µt": "uT", "μt": "uT", "nt": "nT", "tesla": "T", "microtesla": "uT", "nanotesla": "nT",
    "milligauss": "mgauss", "gs": "gauss",
}  # fmt: skip
#: Units in words: ``nanosec``, ``meters``, ``kilometre``; car makers cut them short.
_WORD = re.compile(
    r"(kilo|centi|milli|micro|nano)?(?:(met(?:er|re)s?)|(secs?|secon(?:ds?)?)|(hours?)|(degre(?:es?)?)|(radians?))"
)
_PREFIXES = {"kilo": "k", "centi": "c", "milli": "m", "micro": "u", "nano": "n"}
_SYMBOLS = ("m", "s", "h", "deg", "rad")
_HUMP = re.compile(r"(?<=[a-z])(?=[A-Z])")
_NO_WORDS = ("unit", "of", "arc")  # of "degree of arc"
_TOKEN = re.compile(r"\s*(sqrt\(|√\(?|\(|\)|\*|·|/|\^-?\d+|²|³|°C|[A-Za-zµμ°℃%]+\d?(?![\w^])|[A-Za-zµμ°℃%]+|1)")


@dataclass(frozen=True, slots=True)
class Unit:
    """A unit read from text: multiply by ``factor`` to get SI."""

    text: str
    factor: float
    dimension: Dimension


def parse_unit(text: str) -> Unit:
    """Read a unit such as ``deg/s``, ``g``, ``ug/√Hz``, ``deg/sqrt(h)`` or ``m/s^2``.

    Division applies to everything behind the stroke up to the next ``*`` or ``/``: ``deg/h/√Hz`` is
    (deg/h)/√Hz. Letters are case-sensitive only where case matters (``Hz``, ``mGal``).

    Parameters
    ----------
    text : str
        The unit. Square roots are written ``sqrt(...)``, ``√(...)`` or ``√Hz``.

    Raises
    ------
    UnitError
        If a part of the text is no unit known here; the message lists what is.
    """
    tokens, position, written = [], 0, text.strip()
    text = _with_symbols(text)
    text = re.sub(r"(?<=[A-Za-z])\.(?=[A-Za-z])", "·", text)  # m.s^-2
    while position < len(text.rstrip()):
        match = _TOKEN.match(text, position)
        if match is None:
            raise UnitError(f"cannot read the unit {text!r} at {text[position:]!r}; write for example deg/s, g, ug/√Hz")
        tokens.append(match.group(1))
        position = match.end()
    if not tokens:
        raise UnitError("expected a unit such as deg/s or m/s^2, got an empty text")
    try:
        factor, dimension, rest = _product(tokens, text, 0)
    except (OverflowError, ZeroDivisionError):
        factor, rest = inf, []
    if not 0.0 < factor < inf:
        raise UnitError(f"the unit {text[:40]!r} raises its parts to powers no number can hold")
    if rest:
        raise UnitError(f"cannot read the unit {text!r}: unexpected {rest[0]!r}")
    return Unit(text=written, factor=factor, dimension=dimension)


def _with_symbols(text: str) -> str:
    """A unit with signs for words: of ``meters per second squared`` and ``MeterPerSecondSquared`` m/s^2."""
    words = [word for word in re.split(r"[\s_]+", _HUMP.sub(" ", text).lower()) if word and word not in _NO_WORDS]
    if "per" not in words:
        return text
    signs = {"per": "/", **dict.fromkeys(("squared", "square", "squar"), "^2")}
    return "".join(signs.get(word, word) for word in words)


def factor_for(text: str, quantity: str) -> float:
    """Factor that turns numbers in the unit ``text`` into the SI unit of ``quantity``.

    Parameters
    ----------
    text : str
        The unit, see :func:`parse_unit`.
    quantity : str
        A key of :data:`QUANTITIES`, for example ``"angular rate"``.

    Raises
    ------
    UnitError
        If the unit measures something else; the message names the SI unit expected.
    """
    if quantity == "magnetic flux density":
        text = _GAUSS.get(text.strip().lower(), text)
    unit = parse_unit(text)
    dimension, si = QUANTITIES[quantity]
    if quantity == "temperature" and unit.text == "K":
        raise UnitError("no factor turns kelvin into degC: subtract 273.15 and call the column degC")
    if unit.dimension != dimension:
        raise UnitError(f"{text!r} is no unit of {quantity}; expected one such as {si}")
    return unit.factor


def _product(tokens: list[str], text: str, depth: int) -> tuple[float, Dimension, list[str]]:
    factor, dimension, rest = _power(tokens, text, depth)
    while rest and rest[0] in ("*", "·", "/"):
        sign = -1 if rest[0] == "/" else 1
        other, other_dimension, rest = _power(rest[1:], text, depth)
        factor *= other**sign
        dimension = _combine(dimension, other_dimension, sign)
    return factor, dimension, rest


def _power(tokens: list[str], text: str, depth: int) -> tuple[float, Dimension, list[str]]:
    if not tokens:
        raise UnitError(f"the unit {text!r} ends too early")
    if depth > _MAX_DEPTH:
        raise UnitError(f"the unit {text[:40]!r}... nests brackets or roots deeper than any unit does")
    head, rest = tokens[0], tokens[1:]
    if head in ("sqrt(", "√(", "("):
        factor, dimension, rest = _product(rest, text, depth + 1)
        if not rest or rest[0] != ")":
            raise UnitError(f"the unit {text!r} lacks a closing bracket")
        rest = rest[1:]
        if head != "(":
            factor, dimension = factor**0.5, _scale(dimension, Fraction(1, 2))
    elif head == "√":
        factor, dimension, rest = _power(rest, text, depth + 1)
        factor, dimension = factor**0.5, _scale(dimension, Fraction(1, 2))
    else:
        factor, dimension = _atom(head, text)
    while rest and (rest[0].startswith("^") or rest[0] in ("²", "³")):
        exponent = {"²": 2, "³": 3}.get(rest[0]) or _exponent(rest[0][1:], text)
        factor, dimension, rest = factor**exponent, _scale(dimension, Fraction(exponent)), rest[1:]
    return factor, dimension, rest


def _atom(name: str, text: str) -> tuple[float, Dimension]:
    if name in _ATOMS:
        return _ATOMS[name]
    spelling = _SPELLINGS.get(name) or _SPELLINGS.get(name.lower())
    if spelling is None and name.lower() in _ANY_CASE:
        spelling = name.lower()
    if spelling is None and name[-1] in "23" and name[:-1].isalpha():  # m/s2, as table headers have it
        spelling = f"{name[:-1]}^{name[-1]}"
    if spelling is None and (word := _WORD.fullmatch(name.lower())):
        spelling = _PREFIXES.get(word[1], "") + next(s for s, x in zip(_SYMBOLS, word.groups()[1:], strict=True) if x)
    if spelling is None:
        choices = ", ".join(sorted(_ATOMS))
        raise UnitError(
            f"unknown unit {name!r} in {text!r}; known are {choices} and their products, quotients and roots"
        )
    unit = parse_unit(spelling)
    return unit.factor, unit.dimension


def _exponent(digits: str, text: str) -> int:
    if len(digits) > 2 or abs(int(digits)) > _MAX_EXPONENT:
        raise UnitError(f"the unit {text[:40]!r} has an exponent beyond +-{_MAX_EXPONENT}, which no unit has")
    return int(digits)


def _combine(a: Dimension, b: Dimension, sign: int) -> Dimension:
    return (
        a[0] + sign * b[0], a[1] + sign * b[1], a[2] + sign * b[2], a[3] + sign * b[3], a[4] + sign * b[4]
    )  # fmt: skip


def _scale(a: Dimension, exponent: Fraction) -> Dimension:
    return (a[0] * exponent, a[1] * exponent, a[2] * exponent, a[3] * exponent, a[4] * exponent)
