"""All cases of the corpus."""

from __future__ import annotations

from . import foot, navigation
from .case import Case

CASES: list[Case] = sorted([*navigation.CASES, *foot.CASES], key=lambda case: case.name)
