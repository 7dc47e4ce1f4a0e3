"""What the roles look like: colours that the colour-blind can tell apart, on light and on dark ground.

Colours after Okabe and Ito (2008). Roles that share a panel differ in width, dash or symbol too, so that grey prints
stay readable.
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
        Width of lines and symbol strokes. [pt]
    dash : tuple of float
        Lengths of dashes and gaps, in widths of the line; empty for a full line.
    symbol : str
        ``dot``, ``cross``, ``triangle``, ``ring`` or ``square``.
    size : float
        Size of symbols. [pt]
    alpha : float
        Opacity of areas, and of lines that lie under others.
    """

    light: str
    dark: str
    width: float = 1.2
    dash: tuple[float, ...] = ()
    symbol: str = "dot"
    size: float = 3.0
    alpha: float = 1.0


_DASH = (4.0, 2.0)
_SHORT = (2.0, 1.2)
_LONG = (7.0, 2.0)
_DOTS = (1.0, 1.8)
_DASH_DOT = (5.0, 1.5, 1.0, 1.5)
_DASH_DOTS = (6.0, 1.2, 1.0, 1.2, 1.0, 1.2)

STYLES: MappingProxyType[str, Style] = MappingProxyType(
    {
        "filtered": Style("#0072b2", "#56b4e9", width=1.5),
        "smoothed": Style("#d55e00", "#ff9a4d", width=0.9, symbol="triangle", size=3.6),
        "reference": Style("#202020", "#e6e6e6", width=1.1, dash=_LONG),
        "reference_band": Style("#202020", "#e6e6e6", alpha=0.12),
        "sigma": Style("#0072b2", "#56b4e9", alpha=0.2),
        "sigma_smoothed": Style("#d55e00", "#ff9a4d", alpha=0.22),
        "expected": Style("#009e73", "#3fcf9f", alpha=0.2),
        "level": Style("#707070", "#a0a0a0", width=0.8, dash=_DOTS),
        "largest": Style("#0072b2", "#56b4e9", width=1.0, dash=_DASH),
        "largest_smoothed": Style("#d55e00", "#ff9a4d", width=1.0, dash=_SHORT),
        "mean": Style("#202020", "#e6e6e6", width=1.9, symbol="square"),
        "measured": Style("#7a8a99", "#8fa0b0", symbol="dot", size=1.9),
        "rejected": Style("#b0307a", "#f08cc4", width=1.1, symbol="cross", size=5.0),
        "forced": Style("#9a6a00", "#f0c040", width=1.0, symbol="triangle", size=5.0),
        "withheld": Style("#a08800", "#e8d44d", width=0.6, symbol="ring", size=2.6),
        "unused": Style("#b0b0b0", "#707070", width=0.8, symbol="ring", size=3.0),
        "outage": Style("#e6c200", "#c8a800", width=6.0, alpha=0.3),
        "start": Style("#202020", "#e6e6e6", symbol="triangle", size=7.0),
        "end": Style("#202020", "#e6e6e6", symbol="square", size=6.0),
        "scale": Style("#202020", "#e6e6e6", width=2.5),
        "arrow": Style("#202020", "#e6e6e6", symbol="triangle", size=6.0),
        "graticule": Style("#c3c9d0", "#3d454c", width=0.6),
        "road_major": Style("#b9afa0", "#6a6254", width=1.8),
        "road": Style("#d3ccc1", "#4a453d", width=0.9),
        "water": Style("#9cc4e4", "#2f5573", width=1.1),
        "building": Style("#ddd5ca", "#403a33", width=0.5),
        "land": Style("#c6d3b8", "#3c4634", width=0.7),
        "gated": Style("#8c8c8c", "#8c8c8c", width=0.7, symbol="ring", size=2.4),
        "masked": Style("#b0b0b0", "#707070", symbol="dot", size=1.8),
        "weak": Style("#8c8c8c", "#8c8c8c", width=0.8, symbol="triangle", size=3.2),
        "no_message": Style("#9aa5b1", "#7d8791", width=0.7, dash=_DASH, symbol="ring", size=3.0),
        "implausible": Style("#b0307a", "#f08cc4", width=0.9, symbol="ring", size=3.6),
        "unhealthy": Style("#a08800", "#e8d44d", width=0.8, symbol="ring", size=3.4),
        "filter_range": Style("#202020", "#e6e6e6", width=1.0, symbol="cross", size=4.0),
        "filter_rate": Style("#202020", "#e6e6e6", width=0.8, symbol="ring", size=4.0),
        # satellite systems by their RINEX letters
        "system_g": Style("#0072b2", "#56b4e9", width=1.2, symbol="dot", size=2.2),
        "system_r": Style("#d55e00", "#ff9a4d", width=1.55, symbol="triangle", size=2.6),
        "system_e": Style("#009e73", "#3fcf9f", width=0.8, symbol="square", size=2.0),
        "system_c": Style("#c79000", "#f0b840", width=2.3, symbol="ring", size=2.2),
        "system_j": Style("#8a5fb5", "#c3a0e8", width=1.0, symbol="cross", size=2.6),
        "system_i": Style("#5c4630", "#c8a988", width=0.6, symbol="dot", size=3.4),
        "system_s": Style("#6d6d6d", "#b0b0b0", width=0.45, symbol="square", size=3.2),
        # things beside each other that are neither filtered nor smoothed
        "case_1": Style("#0072b2", "#56b4e9", width=1.5),
        "case_2": Style("#d55e00", "#ff9a4d", width=1.3, dash=_DASH, symbol="triangle"),
        "case_3": Style("#009e73", "#3fcf9f", width=1.1, dash=_DASH_DOT, symbol="square"),
        "case_4": Style("#c79000", "#f0b840", width=1.6, dash=_SHORT, symbol="ring"),
        "case_5": Style("#8a5fb5", "#c3a0e8", width=0.55, symbol="cross"),
        "case_6": Style("#5c4630", "#c8a988", width=1.0, dash=_DASH_DOTS, symbol="dot", size=5.0),
        "case_7": Style("#6d6d6d", "#b0b0b0", width=2.4, symbol="square", size=5.0),
        # temperature going up and down
        "heating": Style("#d55e00", "#ff9a4d", width=0.8, symbol="triangle", size=3.6),
        "cooling": Style("#009e73", "#3fcf9f", width=0.8, symbol="square", size=3.0),
        "first": Style("#202020", "#e6e6e6", width=0.8, symbol="ring", size=3.0),
        "allan": Style("#0072b2", "#56b4e9", width=1.6),
        "allan_band": Style("#0072b2", "#56b4e9", alpha=0.25),
        "model": Style("#d55e00", "#ff9a4d", width=1.2, dash=_SHORT),
        "term": Style("#707070", "#a0a0a0", width=0.7),
        "read_off": Style("#202020", "#e6e6e6", width=1.1, symbol="ring", size=4.5),
        "finding": Style("#e6c200", "#c8a800", width=6.0, alpha=0.35),
        "axis_x": Style("#0072b2", "#56b4e9", width=1.4),
        "axis_y": Style("#d55e00", "#ff9a4d", width=1.4, dash=_DASH, symbol="triangle"),
        "axis_z": Style("#009e73", "#3fcf9f", width=0.9, symbol="square"),
        "axis_x_band": Style("#0072b2", "#56b4e9", alpha=0.18),
        "axis_y_band": Style("#d55e00", "#ff9a4d", alpha=0.18),
        "axis_z_band": Style("#009e73", "#3fcf9f", alpha=0.18),
    }
)

#: Ground of a page: letters, rules, grids.
PAGE_LIGHT = MappingProxyType(
    {
        "ink": "#1c1f23", "muted": "#5b6570", "ground": "#ffffff", "raised": "#f4f6f8", "rule": "#d5dbe1",
        "grid": "#e4e8ec",
    }
)  # fmt: skip
PAGE_DARK = MappingProxyType(
    {
        "ink": "#e4e7ea", "muted": "#a3adb7", "ground": "#15181b", "raised": "#1f2428", "rule": "#3a424a",
        "grid": "#2c3238",
    }
)  # fmt: skip
#: Lines at the ticks of a printed figure.
PRINT_GRID = "#e0e0e0"


def style(role: str) -> Style:
    """The look of a role; an unknown one is a defect of ours and raises KeyError."""
    return STYLES[role]
