"""Calibration parameters for people: what each is called, and its value in the units of data sheets."""

from __future__ import annotations

import math
from dataclasses import dataclass

from schuler import units as u
from schuler.calibration.result.parameters import unit

_SENSORS = {"a": "accelerometer", "g": "gyroscope", "m": "magnetometer"}


@dataclass(frozen=True, slots=True)
class Sheet:
    """How a parameter is shown.

    Attributes
    ----------
    meaning : str
        Such as ``"scale factor of the z accelerometer"``.
    family : str
        What several of them are called together: ``"scale factors of the accelerometers"``.
    unit : str
        Of data sheets.
    factor : float
        SI units in one of them.
    si : str
        SI unit.
    """

    meaning: str
    family: str
    unit: str
    factor: float
    si: str


def sheet(name: str) -> Sheet:
    """How the parameter of this name is shown.

    Biases in mg and deg/h, scale factors in ppm, cross-coupling in mrad, sensitivity to specific force in deg/h/g,
    quadratic terms in ug/g^2, places in mm, delays in ms.

    Raises
    ------
    InputError
        If there is no parameter of this name.
    """
    si = unit(name)
    if name == "delay":
        return Sheet("delay of the gyroscopes behind the accelerometers", "delay", "ms", 1e-3, si)
    kind, sensor = name[0], _SENSORS[name[2]]
    row, column = name[4], name[-1]
    match kind:
        case "b" if name[2] == "m":
            return Sheet(f"hard iron along {row}", "hard iron of the magnetometer", "uT", u.UT, si)
        case "b":
            text, factor = ("mg", u.MG) if name[2] == "a" else ("deg/h", u.DEG_PER_HR)
            return Sheet(f"bias of the {row} {sensor}", f"biases of the {sensor}s", text, factor, si)
        case "M" if row == column:
            return Sheet(f"scale factor of the {row} {sensor}", f"scale factors of the {sensor}s", "ppm", u.PPM, si)
        case "M":
            text = f"what the {row} {sensor} feels of {column}"
            return Sheet(text, f"cross-coupling of the {sensor}s", "mrad", 1e-3, si)
        case "G":
            text = f"what the {row} gyroscope feels of specific force along {column}"
            return Sheet(text, "sensitivity of the gyroscopes to specific force", "deg/h/g", u.DEG_PER_HR_PER_G, si)
        case "Q":
            text = f"quadratic term of the {row} accelerometer"
            return Sheet(text, "quadratic terms of the accelerometers", "ug/g^2", u.UG / u.G0**2, si)
        case _:
            text = f"place of the {row} accelerometer along {column}"
            return Sheet(text, "places of the accelerometers", "mm", 1e-3, si)


def rounded(value: float, sigma: float) -> tuple[str, str]:
    """Value and uncertainty as text, both to the second digit of the uncertainty.

    An infinite uncertainty gives ``"not determined"``, and a vanishing one ``"held"``.
    """
    if not math.isfinite(sigma):
        return "-", "not determined"
    if sigma <= 0.0:
        return f"{value:+.6g}", "held"
    places = 1 - math.floor(math.log10(sigma))
    if not -3 <= places <= 9:
        return f"{value:+.6g}", f"{sigma:.2g}"
    places = max(places, 0)
    return f"{value:+.{places}f}", f"{sigma:.{places}f}"


def probability(p: float) -> str:
    """``"p = 0.042"``, or that it is below a millionth, where nobody knows a distribution's tail."""
    return f"p = {p:.2g}" if p >= 1e-6 else "p below 1e-6"


def shown(name: str, value: float, sigma: float) -> str:
    """Value and uncertainty in data-sheet units: ``"+1.25 +- 0.02 mg"``."""
    s = sheet(name)
    text, spread = rounded(value / s.factor, sigma / s.factor)
    if spread == "not determined":
        return spread
    return f"{text} {s.unit}" if spread == "held" else f"{text} +- {spread} {s.unit}"
