"""All cases of the corpus."""

from __future__ import annotations

from . import calibration, foot, navigation, noise, points
from .case import Case, halves

CASES: list[Case] = sorted(
    [*navigation.CASES, *foot.CASES, *calibration.CASES, *noise.CASES, *points.CASES], key=lambda case: case.name
)

#: "choosing" or "reporting" by the name of a case.
HALVES = halves(CASES)
