"""Satellites and signals of u-blox receivers: gnssId, svId and sigId to RINEX names.

u-blox F9 HPG 1.32 interface description UBX-22008968, section 1.5 ("GNSS, satellite, and signal identifiers").
"""

from __future__ import annotations

from types import MappingProxyType

from schuler.gnss.signals import SYSTEMS

#: gnssId to the system's letter; 4 (IMES) is no satellite.
SYSTEM_OF_GNSS_ID = MappingProxyType({0: "G", 1: "S", 2: "E", 3: "C", 5: "J", 6: "R", 7: "I"})

#: (gnssId, sigId) to the RINEX 3 band and attribute. Logs of version 0 (M8) have sigId 0 everywhere.
SIGNAL_OF_SIG_ID = MappingProxyType(
    {
        (0, 0): "1C", (0, 3): "2L", (0, 4): "2S", (0, 6): "5I", (0, 7): "5Q",
        (1, 0): "1C",
        (2, 0): "1C", (2, 1): "1B", (2, 3): "5I", (2, 4): "5Q", (2, 5): "7I", (2, 6): "7Q", (2, 8): "6B",
        (2, 9): "6C", (2, 10): "6A",
        # D1 and D2 are the same signal with another message
        (3, 0): "2I", (3, 1): "2I", (3, 2): "7I", (3, 3): "7I", (3, 4): "6I", (3, 10): "6I", (3, 5): "1P",
        (3, 6): "1D", (3, 7): "5P", (3, 8): "5D",
        (5, 0): "1C", (5, 1): "1Z", (5, 4): "2S", (5, 5): "2L", (5, 8): "5I", (5, 9): "5Q", (5, 12): "1E",
        (6, 0): "1C", (6, 2): "2C",
        (7, 0): "5A",
    }
)  # fmt: skip

_SBAS_OFFSET = 100  # PRN 133 is S33


def satellite_of(gnss_id: int, sv_id: int) -> int | None:
    """Number of a satellite (:func:`schuler.gnss.signals.satellite`), ``None`` for one without a number of its own.

    GLONASS satellites not identified yet have svId 255.
    """
    letter = SYSTEM_OF_GNSS_ID.get(gnss_id)
    number = sv_id - _SBAS_OFFSET if letter == "S" else sv_id
    if letter is None or not 0 < number < 100:
        return None
    return 100 * SYSTEMS.index(letter) + number
