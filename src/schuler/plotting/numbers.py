"""Numbers as people read them."""

from __future__ import annotations

import numpy as np


def number(value: float | None, unit: str = "") -> str:
    """Three significant digits without exponents, with the unit; a dash for what is not known."""
    if value is None or not np.isfinite(value):
        return "-"
    size = abs(value)
    digits = 0 if size >= 100.0 else 1 if size >= 10.0 else 2 if size >= 1.0 else 3
    text = f"{value:.{digits}f}" if size >= 1e-3 or value == 0.0 else f"{value:.2g}"
    return f"{text} {unit}".strip()
