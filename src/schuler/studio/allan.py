"""Allan curve of one axis as a page draws it: terms to switch, lines of slopes to drag, a data sheet."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from schuler.arrays import FloatArray
from schuler.characterisation.report.terms import SLOPES, allan_variances, quantities, sheet_variances
from schuler.exceptions import InputError
from schuler.sensors import catalogue

_POINTS = 160  # of a model
_DIGITS = 6


def allan_document(answer: Mapping[str, Any], axis: str, sheet: str = "") -> dict[str, Any]:
    """Curve, model and lines of one axis.

    Parameters
    ----------
    answer : mapping
        What ``schuler allan --json`` prints.
    axis : str
        Such as ``gyro_x``.
    sheet : str
        Name in the catalogue; empty for none.

    Returns
    -------
    dict
        ``tau`` [s], ``adev``, ``low``, ``high``; ``grid`` [s] and of each term on it the Allan variance; ``sheet`` on
        the grid, or None; ``slopes``: of each letter its exponent, its level at 1 s (that of the model, or where it
        touches the curve), what a level of one is of its coefficient, name and unit. Signals in data-sheet units.

    Raises
    ------
    InputError
        If the axis is none that was identified, or the sheet none of the catalogue.
    """
    entry = answer.get("axes", {}).get(axis)
    if not entry or entry.get("refused"):
        names = [name for name, one in answer.get("axes", {}).items() if not one.get("refused")]
        raise InputError(f"axis: expected one of {', '.join(names) or 'none'}, got {axis!r}")
    triad = axis.partition("_")[0]
    named = quantities(triad)
    unit = named["x"]
    tau, curve = (np.array(entry[name], dtype=np.float64) for name in ("tau_s", "adev"))
    grid = np.geomspace(tau[0], tau[-1], _POINTS)
    terms = {letter: float(entry["terms"][letter]["value"]) for letter in SLOPES if entry["terms"].get(letter)}
    markov = [(float(one["sigma"]["value"]), float(one["tau"]["value"])) for one in entry["terms"]["GM"]]
    variances = {label: v / unit.factor**2 for label, v in allan_variances(terms, markov, grid).items()}
    slopes = []
    for letter, (exponent, factor) in SLOPES.items():
        touching = float(np.min(curve / tau**exponent))
        slopes.append({
            "letter": letter, "name": named[letter].name, "unit": named[letter].sheet, "exponent": exponent,
            "level": (terms[letter] * factor if letter in terms else touching) / unit.factor,
            "scale": unit.factor / factor / named[letter].factor,
        })  # fmt: skip
    return {
        "axis": axis, "unit": unit.sheet, "tau": _rounded(tau), "grid": _rounded(grid), "slopes": slopes,
        **{name: _rounded(np.array(entry[key]) / unit.factor)
           for name, key in (("adev", "adev"), ("low", "adev_low"), ("high", "adev_high"))},
        "terms": {label: _rounded(v) for label, v in variances.items()},
        "sheet": _rounded(_sheet(sheet, triad, grid) / unit.factor) if sheet else None, "sheet_name": sheet,
    }  # fmt: skip


def _sheet(name: str, triad: str, grid: FloatArray) -> FloatArray:
    """Allan deviation of a data sheet."""
    variances = sheet_variances(getattr(catalogue.spec(name), triad), grid)
    return np.sqrt(np.sum([*variances.values()], axis=0)) if variances else np.full_like(grid, np.nan)


def _rounded(values: FloatArray) -> list[float | None]:
    texts = np.asarray(values, dtype=np.float64).tolist()
    return [float(f"{v:.{_DIGITS}g}") if np.isfinite(v) else None for v in texts]
