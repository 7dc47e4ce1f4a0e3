"""Hayal (2010), static multi-position calibration of tactical IMUs: every table and figure of its results."""

from __future__ import annotations

from types import MappingProxyType

from schuler.reproduce.hayal import adjustment, field, geometry, outages, simulation, theory
from schuler.reproduce.items import Item

_PARTS = (theory, geometry, simulation, adjustment, field, outages)
_CHAPTERS = (
    "table-2.1", "text-2.4.1.1", "table-3.1", "text-3.2", "text-3.4.3", "fig-3.3", "fig-4.1", "text-4.1.2",
    "text-4.2", "table-4.1", "table-4.2", "table-4.3", "table-4.4", "text-4.4", "fig-4.2", "fig-4.3", "table-4.5",
    "text-4.4.2", "text-4.5", "fig-5.3", "table-5.2", "table-5.3", "table-5.4", "text-5.3", "table-5.5", "table-5.6",
    "table-5.7", "text-5.5", "text-6", "table-A.1", "table-A.2", "table-A.3", "table-A.4", "table-A.5", "table-A.6",
    "table-B.1", "table-B.2", "table-B.3",
)  # fmt: skip
_BY_ID = {item.id: item for part in _PARTS for item in part.ITEMS}
#: In the order of the thesis.
ITEMS: tuple[Item, ...] = tuple(_BY_ID[name] for name in _CHAPTERS)

_SKETCH = "sketch of axes, no result"
#: Tables and figures of the thesis that show no result, and why.
NOT_RESULTS: MappingProxyType[str, str] = MappingProxyType(
    {
        **{f"fig-2.{k}": _SKETCH for k in range(1, 6)},
        "fig-2.6": "block diagram of a strapdown system",
        "fig-2.7": "schematic of a gimballed platform",
        "fig-3.1": "sketch of the angles between gravity and the axes",
        "fig-3.2": "sketch of the non-orthogonality angles",
        "table-5.1": "list of equipment",
        "fig-5.1": "photograph of the cart",
        "fig-5.2": "block diagram of the logging hardware",
        "fig-5.4": "sketch that defines the position error in an outage",
    }
)
