"""Figure of the nine modes: errors of units calibrated in the field, beside the source's."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from schuler.exceptions import InputError
from schuler.plotting.drawing import draw
from schuler.plotting.figure import Figure, Item, Line, Markers, Panel
from schuler.reproduce.yaman.study.yaman_tables import MODES, PUBLISHED, QUANTITIES, mode_name

if TYPE_CHECKING:
    from matplotlib.figure import Figure as MplFigure

    from schuler.reproduce.yaman.study.field_drive import FieldDrives

_STEP = 0.2  # of a row: the source's mark stands below ours
_UNITS = {"m": "m", "s": "m/s", "deg": "deg"}  # by the last word of a quantity


def modes_figure(found: FieldDrives, quantities: Sequence[str] = QUANTITIES[:2]) -> MplFigure:
    """Errors by mode, a panel for each quantity.

    Parameters
    ----------
    found : FieldDrives
    quantities : sequence of str
        Out of :data:`schuler.reproduce.yaman.study.yaman_tables.QUANTITIES`.

    Returns
    -------
    matplotlib.figure.Figure

    Raises
    ------
    InputError
        If a quantity is not known.
    MissingExtraError
        If matplotlib is not installed (extra ``plot``).

    References
    ----------
    Yaman (2017), tables 6.2 and 6.3.
    """
    return draw(modes(found, quantities))


def modes(found: FieldDrives, quantities: Sequence[str] = QUANTITIES[:2]) -> Figure:
    """Description of the figure: median and 16 to 84 % of the units, and the source's. Parameters as above."""
    unknown = [name for name in quantities if name not in QUANTITIES]
    if unknown or not quantities:
        raise InputError(f"quantities: expected some of {', '.join(QUANTITIES)}, got {list(quantities)}")
    low, high = found.between()
    published = np.array(PUBLISHED[found.number])
    rows = np.arange(len(MODES), dtype=np.float64)[::-1]  # the first mode on top
    panels = []
    for name in quantities:
        k = QUANTITIES.index(name)
        spread: list[Item] = [
            Line(np.array([low[i, k], high[i, k]]), np.array([y, y]), "filtered") for i, y in enumerate(rows)
        ]
        items = (
            *spread,
            Markers(found.median[:, k], rows, "filtered", f"{len(found)} units, median and 16 to 84 %"),
            Markers(published[:, k], rows - _STEP, "rejected", "Yaman (2017)"),
        )
        words = name.split("_")
        label = f"{' '.join(w for w in words if w not in _UNITS)} [{_UNITS[words[-1]]}]"
        ticks = tuple((float(y), mode_name(*mode)) for y, mode in zip(rows, MODES, strict=True))
        panels.append(Panel(label, "", items, log_x=True, y_ticks=ticks, y_limits=(-0.7, len(MODES) - 0.4), height=1.3))
    against = "the calibrated solution with full GPS" if found.against == "full" else "the truth"
    return Figure(
        "field_drive",
        f"Drive {found.number}, nine modes",
        f"RMS against {against}, of partial GPS over the outage.",
        tuple(panels),
        linked=False,
    )
