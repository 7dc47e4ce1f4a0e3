"""Yaman's tables of navigation performance by mode, as printed."""

from __future__ import annotations

from itertools import combinations
from typing import Literal

import numpy as np

Gps = Literal["None", "Full", "Partial"]
#: GPS, calibrated IMU, ZUPT and NHC: the rows of tables 6.2 and 6.3.
MODES: tuple[tuple[Gps, bool, bool], ...] = (
    ("None", True, False), ("None", True, True), ("None", False, False), ("None", False, True), ("Full", False, False),
    ("Partial", True, False), ("Partial", True, True), ("Partial", False, False), ("Partial", False, True),
)  # fmt: skip
#: Columns of the tables.
QUANTITIES = (
    "position_horizontal_m", "position_vertical_m", "velocity_horizontal_m_s", "velocity_vertical_m_s", "roll_deg",
    "pitch_deg", "yaw_deg",
)  # fmt: skip
#: Table 6.2 (drive 1) and 6.3 (drive 2), in the order of MODES.
PUBLISHED = {
    1: (
        (6188.15, 315.94, 37.64, 1.06, 0.49, 0.52, 2.49), (18.33, 71.94, 0.69, 0.43, 0.19, 0.30, 1.75),
        (6978.13, 71771.49, 32.21, 343.22, 0.80, 0.96, 7.73), (66.27, 101.90, 1.35, 0.61, 0.34, 1.34, 4.38),
        (1.61, 4.19, 0.37, 0.87, 0.31, 0.36, 1.06), (34.31, 10.41, 1.38, 0.19, 0.11, 0.08, 0.60),
        (27.74, 8.88, 1.11, 0.23, 0.11, 0.11, 1.13), (159.43, 803.34, 7.35, 32.82, 0.32, 0.65, 1.54),
        (19.22, 17.42, 1.05, 1.01, 0.24, 0.46, 1.44),
    ),
    2: (
        (6811.25, 1275.34, 40.08, 5.73, 0.69, 0.62, 1.33), (27.12, 16.63, 0.86, 0.08, 0.09, 0.10, 1.26),
        (8559.36, 84280.23, 70.39, 379.38, 1.08, 1.11, 10.01), (32.55, 21.41, 1.03, 0.34, 0.24, 0.40, 5.44),
        (1.609, 4.45, 0.38, 0.92, 0.31, 0.31, 2.04), (95.94, 41.34, 2.65, 0.94, 0.22, 0.16, 0.48),
        (28.73, 5.99, 0.99, 0.09, 0.08, 0.08, 0.31), (450.49, 2223.17, 11.56, 56.91, 0.95, 0.91, 2.13),
        (30.05, 19.62, 1.73, 0.81, 0.28, 0.49, 2.57),
    ),
}  # fmt: skip


def mode_name(gps: Gps, calibrated: bool, aided: bool) -> str:
    """As in the source: ``Partial, INS+CIMU+NG``."""
    return f"{gps}, INS{'+CIMU' if calibrated else ''}{'+NG' if aided else ''}"


def agreed_order(column: str = "position_horizontal_m") -> list[tuple[int, int]]:
    """Pairs of modes (better, worse) on whose order both tables of the source agree by more than a fifth."""
    k = QUANTITIES.index(column)
    first, second = (np.array(PUBLISHED[n])[:, k] for n in (1, 2))
    pairs = []
    for i, j in combinations(range(len(MODES)), 2):
        for a, b in ((i, j), (j, i)):
            if first[b] > 1.2 * first[a] and second[b] > 1.2 * second[a]:
                pairs.append((a, b))
    return pairs
