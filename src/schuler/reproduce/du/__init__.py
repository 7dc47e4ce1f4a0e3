"""Du (2015): tables and figures of the rotary INS beside ours, in the order of the thesis."""

from __future__ import annotations

from types import MappingProxyType

from schuler.reproduce.du import (
    at_rest,
    calibration,
    drives,
    fundamentals,
    integrated,
    observability,
    simulations,
    turntable,
)
from schuler.reproduce.items import Item

ITEMS: tuple[Item, ...] = (
    *fundamentals.ITEMS, *simulations.ITEMS, *calibration.ITEMS, *at_rest.ITEMS, *drives.ITEMS, *observability.ITEMS,
    *turntable.ITEMS, observability.MANOEUVRES, *integrated.ITEMS,
)  # fmt: skip

_PHOTOGRAPH = "photograph or drawing of the hardware"
_INPUT = "errors that are simulated: input of the figures of this section"
_SHEET = "data sheet of the hardware: what the emulations are made from"

#: What has a number in the thesis and is no result.
NOT_RESULTS: MappingProxyType[str, str] = MappingProxyType(
    {
        "table-1.1": "accuracy and price of marine systems, from another thesis",
        "fig-1.1": "drawing of a rotary INS",
        "fig-1.2": _PHOTOGRAPH,
        "fig-2.1": "drawing of frames",
        "fig-2.2": "flow chart of the mechanization",
        "fig-2.3": "drawing of a rotation; what it explains is text-2.3",
        "table-3.1": _INPUT,
        "table-3.2": _INPUT,
        "table-3.3": _INPUT,
        "table-4.1": _SHEET,
        "table-4.2": _SHEET,
        "table-4.6": _SHEET,
        **dict.fromkeys(("fig-4.1", "fig-4.2", "fig-4.3", "fig-4.24", "fig-4.25", "fig-4.26"), _PHOTOGRAPH),
        **dict.fromkeys(("fig-5.1", "fig-5.2", "fig-5.13", "fig-5.14"), _PHOTOGRAPH),
        "fig-6.1": "flow chart of the integrated system",
    }
)
