"""Flenniken (2005): noise of inertial sensors, growth of errors, heading filters, a rocket's impact."""

from __future__ import annotations

from types import MappingProxyType

from schuler.reproduce.flenniken import (
    appendices_b_d,
    appendix_a,
    chapter_2,
    chapter_3,
    chapter_3_formulas,
    chapter_4,
    chapter_5,
    chapter_6,
    chapter_7,
    tables,
)

ITEMS = (
    *chapter_2.ITEMS, *tables.ITEMS, *chapter_3.STATIC, *chapter_3_formulas.ITEMS,
    *chapter_3.BIASES_AND_GRAVITY, *chapter_4.ITEMS, *chapter_5.ITEMS, *chapter_6.ITEMS,
    *chapter_7.ITEMS, *appendix_a.ITEMS, *appendices_b_d.ITEMS,
)  # fmt: skip

#: Figures without results.
NOT_RESULTS: MappingProxyType[str, str] = MappingProxyType(
    {
        "fig-5.1": "drawings of the six degrees of freedom",
        "fig-C.1": "flow chart of the Kalman filter",
    }
)
