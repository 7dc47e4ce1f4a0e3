"""Štefanisko (2015), INS/GNSS integration in the Earth frame: every table and figure of its results."""

from __future__ import annotations

from types import MappingProxyType

from schuler.reproduce.items import Item
from schuler.reproduce.stefanisko import biases, equations, generator, inertial, integration

_ORDER = (
    "table-1.1", "text-1.3", "text-1.4.4", "text-1.5", "text-3.3", "fig-4.1", "fig-4.3", "fig-4.5", "text-4.3",
    "fig-4.6", "fig-4.7", "fig-4.8", "fig-4.9", "text-4.4", "fig-4.10", "text-4.6", "fig-4.12", "fig-4.16", "text-5",
    "fig-B.1",
)  # fmt: skip
_PARTS = (equations, generator, inertial, biases, integration)
_BY_ID = {item.id: item for part in _PARTS for item in part.ITEMS}
#: In the order of the thesis.
ITEMS: tuple[Item, ...] = tuple(_BY_ID[name] for name in _ORDER)

#: Tables and figures of the thesis that show no result, and why.
NOT_RESULTS: MappingProxyType[str, str] = MappingProxyType(
    {
        "fig-1.1": "block diagram of an inertial navigation system",
        "fig-1.2": "block diagram of an IMU",
        "fig-1.3": "principle of an accelerometer",
        "fig-1.4": "sketch of the frames",
        "fig-1.5": "block diagram of the navigation equations",
        "fig-1.6": "photograph of the board",
        "table-3.1": "order of prediction and correction in words",
        "fig-3.1": "block diagram of an integration",
        "fig-3.2": "block diagram of loose coupling",
        "fig-3.3": "block diagram of tight coupling",
        "fig-3.4": "block diagram of deep integration",
        "fig-3.5": "steps of the Kalman filter",
        "fig-3.6": "flow of the fusion",
    }
)
