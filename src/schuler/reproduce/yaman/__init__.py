"""Yaman (2017), EKF-based multi-purpose inertial sensor field calibration: its tables and figures beside ours.

Its algorithm has two forms here: that of the package (vectors, passes until nothing moves), and the source's own
(magnitudes, one pass, ``FieldOptions.thesis()``), in which its artefacts come out again.
"""

from __future__ import annotations

from types import MappingProxyType

from schuler.reproduce.items import Item
from schuler.reproduce.yaman import drives, histograms, models, multi, single, static_tests

ITEMS: tuple[Item, ...] = (
    *models.CHAPTER_2, *single.ITEMS, *multi.ITEMS, *histograms.ITEMS, *models.LIMITS, *static_tests.ITEMS,
    *drives.ITEMS, *models.APPENDIX_A, *histograms.APPENDIX_D, *models.APPENDIX_E,
)  # fmt: skip

_SKETCH, _BLOCKS, _PHOTOGRAPH = "sketch of frames, axes or geometry", "block diagram", "photograph of the hardware"

#: Tables and figures that show no result.
NOT_RESULTS: MappingProxyType[str, str] = MappingProxyType(
    {f"fig-2.{k}": _SKETCH for k in (1, 2, 3, 4, 5, 7, 8)}
    | {"fig-2.6": _BLOCKS, "fig-3.1": _SKETCH, "fig-4.1": _BLOCKS, "fig-4.2": _BLOCKS, "fig-4.3": _BLOCKS}
    | {"fig-4.4": _BLOCKS, "fig-4.5": _SKETCH, "fig-4.6": _SKETCH, "fig-4.7": _SKETCH, "fig-5.1": _BLOCKS}
    | {f"fig-6.{k}": _PHOTOGRAPH for k in (1, 2, 3, 4, 5, 13, 14)}
    | {
        "table-3.1": "properties of GNSS and INS in words",
        "table-4.1": "equations of the Kalman filter",
        "table-5.1": "blocks of the simulation in words",
        "table-6.1": "hardware and prices",
    }
)  # fmt: skip
