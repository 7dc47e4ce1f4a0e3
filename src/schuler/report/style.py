"""What the roles look like: colours that the colour-blind can tell apart, on light and on dark ground.

Colours after Okabe and Ito (2008). Roles differ in width, dash or symbol too, so that grey prints stay readable.
"""

from __future__ import annotations

from dataclasses import dataclass
from types import MappingProxyType


@dataclass(frozen=True, slots=True)
class Style:
    """Look of one role.

    Attributes
    ----------
    light, dark : str
        Colour on light and dark ground, ``#rrggbb``.
    width : float
        Of lines and symbol strokes. [pt]
    dash : bool
    symbol : str
        ``dot``, ``cross``, ``triangle``, ``ring`` or ``square``.
    size : float
        Of symbols. [pt]
    alpha : float
        Of areas, and of lines that lie under others.
    """

    light: str
    dark: str
    width: float = 1.2
    dash: bool = False
    symbol: str = "dot"
    size: float = 3.0
    alpha: float = 1.0


STYLES: MappingProxyType[str, Style] = MappingProxyType(
    {
        "filtered": Style("#0072b2", "#56b4e9", width=1.2),
        "smoothed": Style("#d55e00", "#ff9a4d", width=1.2),
        "reference": Style("#202020", "#e6e6e6", width=1.1, dash=True),
        "sigma": Style("#0072b2", "#56b4e9", alpha=0.2),
        "sigma_smoothed": Style("#d55e00", "#ff9a4d", alpha=0.22),
        "expected": Style("#009e73", "#3fcf9f", alpha=0.2),
        "level": Style("#707070", "#a0a0a0", width=0.8),
        "largest": Style("#0072b2", "#56b4e9", width=1.0, dash=True),
        "largest_smoothed": Style("#d55e00", "#ff9a4d", width=1.0, dash=True),
        "mean": Style("#202020", "#e6e6e6", width=1.4),
        "measured": Style("#7a8a99", "#8fa0b0", symbol="dot", size=1.9),
        "rejected": Style("#b0307a", "#f08cc4", width=1.3, symbol="cross", size=5.0),
        "forced": Style("#9a6a00", "#f0c040", width=1.0, symbol="triangle", size=5.0),
        "withheld": Style("#a08800", "#e8d44d", width=0.6, symbol="ring", size=2.6),
        "unused": Style("#b0b0b0", "#707070", width=0.8, symbol="ring", size=3.0),
        "outage": Style("#e6c200", "#c8a800", width=6.0, alpha=0.3),
        "start": Style("#202020", "#e6e6e6", symbol="triangle", size=7.0),
        "end": Style("#202020", "#e6e6e6", symbol="square", size=6.0),
        "scale": Style("#202020", "#e6e6e6", width=2.5),
        "allan": Style("#0072b2", "#56b4e9", width=1.6),
        "allan_band": Style("#0072b2", "#56b4e9", alpha=0.25),
        "model": Style("#d55e00", "#ff9a4d", width=1.2, dash=True),
        "term": Style("#707070", "#a0a0a0", width=0.7),
        "read_off": Style("#202020", "#e6e6e6", width=1.1, symbol="ring", size=4.5),
        "finding": Style("#e6c200", "#c8a800", width=6.0, alpha=0.35),
        "axis_x": Style("#0072b2", "#56b4e9", width=1.4),
        "axis_y": Style("#d55e00", "#ff9a4d", width=1.4, dash=True),
        "axis_z": Style("#009e73", "#3fcf9f", width=0.9),
        "axis_x_band": Style("#0072b2", "#56b4e9", alpha=0.18),
        "axis_y_band": Style("#d55e00", "#ff9a4d", alpha=0.18),
        "axis_z_band": Style("#009e73", "#3fcf9f", alpha=0.18),
    }
)


def style(role: str) -> Style:
    """The look of a role; an unknown one is a defect of ours and raises KeyError."""
    return STYLES[role]
