"""Range of temperatures of a thermal calibration: where it refers to, and refusal where there is too little of it."""

from __future__ import annotations

import numpy as np

from schuler.calibration.result.result import CalibrationResult
from schuler.exceptions import InputError

#: Below this span of temperatures nothing is fitted; below the second the result carries a warning. [K]
SMALLEST_SPAN, NARROW_SPAN = 5.0, 20.0


def reference_of(wanted: float | None, low: float, high: float) -> float:
    """Reference temperature: as wanted, or 25 degC, or the middle of the range if that is outside. [degC]"""
    if wanted is None:
        return 25.0 if low <= 25.0 <= high else float(round(0.5 * (low + high)))
    if not low <= wanted <= high:
        raise InputError(
            f"reference_temperature: expected a temperature of the data, {low:.1f} to {high:.1f} degC, got {wanted}"
        )
    return float(wanted)


def refused(names: tuple[str, ...], verdicts: list[str]) -> CalibrationResult:
    """A result without values, that says why."""
    p = len(names)
    return CalibrationResult(
        "thermal", names, np.zeros(p), np.diag(np.full(p, np.inf)), "full", status="refused", verdicts=tuple(verdicts),
    )  # fmt: skip
