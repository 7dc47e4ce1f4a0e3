"""Keywords and units of data sheets: which quantity each stands for, and its factor to SI."""

from __future__ import annotations

import difflib
import math
from collections.abc import Mapping
from typing import Annotated, Any, TypedDict, get_type_hints

from schuler import units as u
from schuler.exceptions import InputError

#: Flat part of the Allan deviation of 1/f noise over its coefficient B: sqrt(2 ln 2 / pi) = 0.664.
ALLAN_FLICKER = math.sqrt(2.0 * math.log(2.0) / math.pi)

_RTHR = math.sqrt(u.HR)
_PER_DENSITY = {"one-sided": 1.0 / math.sqrt(2.0), "two-sided": 1.0}


#: Unit by the end of a keyword.
_ENDINGS = {
    "ppm": "ppm", "percent": "%", "mrad": "mrad", "urad": "urad", "deg": "deg", "ppm_K": "ppm/K", "percent_K": "%/K",
    "s": "s", "deg_rthr": "deg/sqrt(h)", "deg_s_rthz": "deg/s/sqrt(Hz)", "deg_hr_rthz": "deg/h/sqrt(Hz)",
    "deg_hr": "deg/h", "deg_s": "deg/s", "deg_hr_rthr": "deg/h/sqrt(h)", "deg_hr_hr": "deg/h/h", "arcsec": "arcsec",
    "deg_hr_g": "deg/h/g", "deg_s_g": "deg/s/g", "deg_hr_K": "deg/h/K", "deg_s_K": "deg/s/K",
    "m_s_rthr": "m/s/sqrt(h)", "ug_rthz": "ug/sqrt(Hz)", "mg_rthz": "mg/sqrt(Hz)", "m_s2_rthz": "m/s^2/sqrt(Hz)",
    "ug": "ug", "mg": "mg", "m_s2": "m/s^2", "ug_rthr": "ug/sqrt(h)", "ug_hr": "ug/h", "m_s": "m/s",
    "mg_K": "mg/K", "ug_K": "ug/K", "g": "g",
}  # fmt: skip


class _Sheet(TypedDict, total=False):
    """Keywords that gyroscope and accelerometer share; the annotation holds the field and the factor to SI."""

    scale_ppm: Annotated[float, "scale_factor", u.PPM]
    scale_percent: Annotated[float, "scale_factor", u.PERCENT]
    misalignment_mrad: Annotated[float, "misalignment", 1e-3]
    misalignment_urad: Annotated[float, "misalignment", 1e-6]
    misalignment_deg: Annotated[float, "misalignment", u.DEG]
    misalignment_percent: Annotated[float, "misalignment", u.PERCENT]  # "cross-axis sensitivity"
    scale_temperature_ppm_K: Annotated[float, "scale_temperature", u.PPM]
    scale_temperature_percent_K: Annotated[float, "scale_temperature", u.PERCENT]
    in_run_time_s: Annotated[float, "in_run_time", 1.0]


class GyroSheet(_Sheet, total=False):
    """Keywords of :meth:`TriadSpec.gyro`."""

    arw_deg_rthr: Annotated[float, "random_walk", u.DEG_PER_RTHR]
    noise_deg_s_rthz: Annotated[float, "random_walk", u.DEG_PER_S_PER_RTHZ]
    noise_deg_hr_rthz: Annotated[float, "random_walk", u.DEG_PER_HR_PER_RTHZ]
    bias_instability_deg_hr: Annotated[float, "bias_instability", u.DEG_PER_HR]
    allan_minimum_deg_hr: Annotated[float, "bias_instability", u.DEG_PER_HR / ALLAN_FLICKER]
    rrw_deg_hr_rthr: Annotated[float, "rate_random_walk", u.DEG_PER_HR / _RTHR]
    ramp_deg_hr_hr: Annotated[float, "rate_ramp", u.DEG_PER_HR / u.HR]
    quantisation_arcsec: Annotated[float, "quantisation", u.ARCSEC]
    bias_deg_hr: Annotated[float, "turn_on_bias", u.DEG_PER_HR]
    bias_deg_s: Annotated[float, "turn_on_bias", u.DEG]
    in_run_deg_hr: Annotated[float, "in_run_bias", u.DEG_PER_HR]
    in_run_deg_s: Annotated[float, "in_run_bias", u.DEG]
    g_sensitivity_deg_hr_g: Annotated[float, "g_sensitivity", u.DEG_PER_HR_PER_G]
    g_sensitivity_deg_s_g: Annotated[float, "g_sensitivity", u.DEG / u.G0]
    bias_temperature_deg_hr_K: Annotated[float, "bias_temperature", u.DEG_PER_HR]
    bias_temperature_deg_s_K: Annotated[float, "bias_temperature", u.DEG]
    range_deg_s: Annotated[float, "range", u.DEG]
    resolution_deg_s: Annotated[float, "resolution", u.DEG]


class AccelerometerSheet(_Sheet, total=False):
    """Keywords of :meth:`TriadSpec.accelerometer`."""

    vrw_m_s_rthr: Annotated[float, "random_walk", u.MPS_PER_RTHR]
    noise_ug_rthz: Annotated[float, "random_walk", u.UG_PER_RTHZ]
    noise_mg_rthz: Annotated[float, "random_walk", u.MG]
    noise_m_s2_rthz: Annotated[float, "random_walk", 1.0]
    bias_instability_ug: Annotated[float, "bias_instability", u.UG]
    bias_instability_mg: Annotated[float, "bias_instability", u.MG]
    allan_minimum_ug: Annotated[float, "bias_instability", u.UG / ALLAN_FLICKER]
    rrw_ug_rthr: Annotated[float, "rate_random_walk", u.UG / _RTHR]
    ramp_ug_hr: Annotated[float, "rate_ramp", u.UG / u.HR]
    quantisation_m_s: Annotated[float, "quantisation", 1.0]
    bias_mg: Annotated[float, "turn_on_bias", u.MG]
    bias_ug: Annotated[float, "turn_on_bias", u.UG]
    bias_m_s2: Annotated[float, "turn_on_bias", 1.0]
    in_run_mg: Annotated[float, "in_run_bias", u.MG]
    in_run_ug: Annotated[float, "in_run_bias", u.UG]
    bias_temperature_mg_K: Annotated[float, "bias_temperature", u.MG]
    bias_temperature_ug_K: Annotated[float, "bias_temperature", u.UG]
    range_g: Annotated[float, "range", u.G0]
    range_m_s2: Annotated[float, "range", 1.0]
    resolution_mg: Annotated[float, "resolution", u.MG]
    resolution_ug: Annotated[float, "resolution", u.UG]


# field: label, SI unit, data-sheet unit, factor to SI
GYRO_UNITS: dict[str, tuple[str, str, str, float]] = {
    "random_walk": ("angle random walk N", "(rad/s)/sqrt(Hz)", "deg/sqrt(h)", u.DEG_PER_RTHR),
    "bias_instability": ("bias instability B", "rad/s", "deg/h", u.DEG_PER_HR),
    "rate_random_walk": ("rate random walk K", "(rad/s)*sqrt(Hz)", "deg/h/sqrt(h)", u.DEG_PER_HR / _RTHR),
    "rate_ramp": ("rate ramp R", "rad/s^2", "deg/h/h", u.DEG_PER_HR / u.HR),
    "quantisation": ("quantisation Q", "rad", "arcsec", u.ARCSEC),
    "turn_on_bias": ("turn-on bias", "rad/s", "deg/h", u.DEG_PER_HR),
    "in_run_bias": ("in-run bias (Gauss-Markov)", "rad/s", "deg/h", u.DEG_PER_HR),
    "in_run_time": ("  correlation time", "s", "s", 1.0),
    "scale_factor": ("scale factor", "", "ppm", u.PPM),
    "misalignment": ("misalignment", "rad", "mrad", 1e-3),
    "g_sensitivity": ("g-sensitivity", "(rad/s)/(m/s^2)", "deg/h/g", u.DEG_PER_HR_PER_G),
    "bias_temperature": ("bias temperature slope", "(rad/s)/K", "deg/h/K", u.DEG_PER_HR),
    "scale_temperature": ("scale temperature slope", "1/K", "ppm/K", u.PPM),
    "range": ("range", "rad/s", "deg/s", u.DEG),
    "resolution": ("resolution", "rad/s", "deg/s", u.DEG),
}
ACCEL_UNITS: dict[str, tuple[str, str, str, float]] = {
    "random_walk": ("velocity random walk N", "(m/s^2)/sqrt(Hz)", "m/s/sqrt(h)", u.MPS_PER_RTHR),
    "bias_instability": ("bias instability B", "m/s^2", "ug", u.UG),
    "rate_random_walk": ("rate random walk K", "(m/s^2)*sqrt(Hz)", "ug/sqrt(h)", u.UG / _RTHR),
    "rate_ramp": ("rate ramp R", "m/s^3", "ug/h", u.UG / u.HR),
    "quantisation": ("quantisation Q", "m/s", "m/s", 1.0),
    "turn_on_bias": ("turn-on bias", "m/s^2", "mg", u.MG),
    "in_run_bias": ("in-run bias (Gauss-Markov)", "m/s^2", "mg", u.MG),
    "in_run_time": ("  correlation time", "s", "s", 1.0),
    "scale_factor": ("scale factor", "", "ppm", u.PPM),
    "misalignment": ("misalignment", "rad", "mrad", 1e-3),
    "bias_temperature": ("bias temperature slope", "(m/s^2)/K", "mg/K", u.MG),
    "scale_temperature": ("scale temperature slope", "1/K", "ppm/K", u.PPM),
    "range": ("range", "m/s^2", "g", u.G0),
    "resolution": ("resolution", "m/s^2", "ug", u.UG),
}


def sheet_keys(sheet: type[GyroSheet] | type[AccelerometerSheet]) -> dict[str, tuple[str, float]]:
    """Keyword -> (field of :class:`TriadSpec`, factor to SI) of a constructor."""
    hints = get_type_hints(sheet, include_extras=True)
    return {key: (hint.__metadata__[0], hint.__metadata__[1]) for key, hint in hints.items()}


def sheet_unit(key: str) -> str:
    """Unit that a keyword of a data sheet names at its end, as text; empty where it names none.

    Parameters
    ----------
    key : str
        Such as ``noise_ug_rthz``, whose unit is ug/sqrt(Hz).
    """
    endings = (suffix for suffix in _ENDINGS if key.endswith(f"_{suffix}"))
    return _ENDINGS.get(max(endings, key=len, default=""), "")


def read_sheet(
    sheet: type[GyroSheet] | type[AccelerometerSheet], given: Mapping[str, Any], density: str | None, what: str
) -> dict[str, float]:
    """Fields of :class:`~schuler.sensors.spec.TriadSpec` from a constructor's keywords; SI.

    Raises
    ------
    InputError
        If a keyword is unknown, a quantity is given twice, or it is not clear what a noise figure means.
    """
    keys = sheet_keys(sheet)
    check_entries(given, list(keys), [], what)
    values: dict[str, float] = {}
    origin: dict[str, str] = {}
    for key, value in given.items():
        field, factor = keys[key]
        if field in origin:
            raise InputError(f"{what}: {origin[field]} and {key} are the same quantity; give one of them")
        origin[field], values[field] = key, magnitude(value, key) * factor
    noise = origin.get("random_walk")
    if noise is None:
        names = ", ".join(key for key, (field, _) in keys.items() if field == "random_walk")
        raise InputError(f"{what}: expected one noise figure out of {names}; got none")
    if noise.startswith("noise_"):
        if density not in _PER_DENSITY:
            raise InputError(
                f"{what}: {noise} needs density='one-sided' or 'two-sided', got {density!r}. N**2 is the two-sided "
                "density; a one-sided figure d (spectrum analyser, positive frequencies only) means N = d/sqrt(2), "
                "a two-sided one N = d. If the sheet does not say, compare with its random walk or rms noise"
            )
        values["random_walk"] *= _PER_DENSITY[density]
    elif density is not None:
        raise InputError(f"{what}: {noise} is a random walk and equals N by definition; leave density={density!r} out")
    return values


def check_entries(data: Mapping[str, Any], entries: list[str], needed: list[str], what: str) -> None:
    """Refuse entries that are unknown, with the nearest known name, or missing."""
    for key in data:
        if key not in entries:
            near = difflib.get_close_matches(str(key), entries, n=3, cutoff=0.5)
            hint = f"did you mean {' or '.join(near)}?" if near else "known are " + ", ".join(entries)
            raise InputError(f"{what}: unknown entry {key!r}; {hint}")
    missing = [key for key in needed if key not in data]
    if missing:
        raise InputError(f"{what}: expected the entry {missing[0]!r}, got {', '.join(map(repr, data)) or 'none'}")


def magnitude(value: Any, name: str) -> float:
    """One finite number, not negative."""
    try:
        number = float(value)
    except (TypeError, ValueError) as error:
        raise InputError(f"{name}: expected one number, got {value!r}") from error
    if not (math.isfinite(number) and number >= 0.0):
        raise InputError(f"{name}: expected a finite 1-sigma value, not negative, got {value!r}")
    return number
