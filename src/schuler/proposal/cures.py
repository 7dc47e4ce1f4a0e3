"""Cures: what a diagnosis proves to be wrong, put into the hints that a log is read with."""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Any

from schuler.diagnosis.result import Finding
from schuler.proposal.decision import UndecidedError
from schuler.recording.io.columns import TRIADS
from schuler.recording.io.hint_texts import parse_scale, parse_units

#: Likelihood from which on a finding is mended unasked.
SURE = 0.98
#: Codes whose option mends them, in the order in which they are mended: each is judged anew after those before it.
STEPS = (
    ("position_unit", "time_unit", "height_unit", "velocity_unit"),
    ("kind", "accel_unit"),
    ("clock_unknown", "no_overlap", "leap_seconds"),
    ("gyro_unit", "gravity_sign", "gyro_sign", "vertical_sign", "longitude_sign", "latitude_sign"),
    ("handedness", "accel_axes", "gyro_axes", "axes"),
    ("height_level",),
)
_TEXT = re.compile(r"\b(units|scale|kind|axes|time|height)='([^'.]*(?:\.\d[^'.]*)*)'")
_NUMBER = re.compile(r"\b(offset|geoid_separation)=([-+]?\d[\d.]*(?:e[-+]?\d+)?)")
_GROUPS = {"accel_unit": "accel", "gyro_unit": "gyro"}


def mended(finding: Finding, entry: Mapping[str, Any]) -> dict[str, Any] | None:
    """Hints with what a finding proposes in them.

    Parameters
    ----------
    finding : Finding
    entry : mapping
        Hints that the log was read with.

    Returns
    -------
    dict
        Only the hints that change; None if the finding is not sure enough, or no hint mends it.
    """
    if finding.confidence < SURE or not any(finding.code in step for step in STEPS):
        return None
    return proposed(finding, entry)


def proposed(finding: Finding, entry: Mapping[str, Any]) -> dict[str, Any] | None:
    """The same, however sure the finding is.

    Parameters
    ----------
    finding, entry
        See :func:`mended`.
    """
    fix = finding.fix
    if "..." in fix.partition(" (or ")[0].replace("'...,", "'").replace(",...'", "'") or "columns" in fix:
        return None
    fix = fix.replace("...,", "").replace(",...", "")
    fix = re.split(r" \(| or ", fix)[0]
    if finding.code == "leap_seconds":
        shifts = [number for name, number in _NUMBER.findall(finding.fix) if name == "offset"]
        return {"offset": float(shifts[-1])} if shifts else None
    new: dict[str, Any] = {}
    for name, value in _TEXT.findall(fix):
        if name == "units":
            stated = parse_units(entry.get("units"), str(entry.get("kind", "rate")))
            if "=" in value:
                stated |= dict(pair.split("=", 1) for pair in value.split(","))
            elif finding.code in _GROUPS:
                stated[_GROUPS[finding.code]] = value
            else:
                stated |= dict(zip(("accel", "gyro"), value.split(","), strict=False))
            new["units"] = ",".join(f"{group}={unit}" for group, unit in stated.items())
        elif name == "scale":
            new["scale"] = _product(entry.get("scale"), value)
        else:
            new[name] = value
    # numbers of a finding count from nothing: what was added before is in them
    new |= {name: float(value) for name, value in _NUMBER.findall(fix)}
    return new or None


def _product(old: Any, new: str) -> str:
    """Factors of both, by group or column."""
    factors = parse_scale(new)
    before = parse_scale(old)
    if isinstance(factors, str) or isinstance(before, str):
        raise UndecidedError(
            f"the scale {new!r} would have to be put upon the array of factors {old!r}: write the factors"
        )
    out = dict(before or {})
    for group, triad in TRIADS.items():
        if group in out and any(name in triad for name in factors or {}):
            out |= dict.fromkeys(triad, out.pop(group))
    for name, factor in (factors or {}).items():
        out[name] = out.get(name, 1.0) * factor
    return ",".join(f"{name}={factor:.9g}" for name, factor in out.items())
