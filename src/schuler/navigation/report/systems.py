"""Names and looks of satellite systems."""

from __future__ import annotations

import numpy as np

from schuler.arrays import IntArray
from schuler.gnss.signals import SYSTEM_NAMES, SYSTEMS


def systems_of(sat: IntArray) -> list[str]:
    """Letters of the systems among satellites' numbers, in the order of :data:`~schuler.gnss.signals.SYSTEMS`."""
    return [SYSTEMS[i] for i in np.unique(sat // 100).tolist()]


def system_index(letter: str) -> int:
    """What a satellite's number is divided by 100."""
    return SYSTEMS.index(letter)


def system_role(letter: str) -> str:
    """Role of a system in figures."""
    return f"system_{letter.lower()}"


def system_label(letter: str) -> str:
    """Name of a system."""
    return SYSTEM_NAMES[letter]
