"""Satellites and signals: their names, their numbers in arrays, their frequencies."""

from __future__ import annotations

from types import MappingProxyType

import numpy as np

from schuler.arrays import ArrayLike, FloatArray
from schuler.exceptions import InputError

#: Systems by their RINEX letters; the place in this string is the system's number in arrays.
SYSTEMS = "GRECJIS"
SYSTEM_NAMES = MappingProxyType(
    {"G": "GPS", "R": "GLONASS", "E": "Galileo", "C": "BeiDou", "J": "QZSS", "I": "NavIC", "S": "SBAS"}
)
SPEED_OF_LIGHT = 299_792_458.0  # [m/s]

_MHZ = 1e6
#: Carrier frequency by system and RINEX band. [Hz]
BANDS: MappingProxyType[tuple[str, str], float] = MappingProxyType(
    {
        **dict.fromkeys((("G", "1"), ("E", "1"), ("J", "1"), ("S", "1"), ("C", "1")), 1575.42 * _MHZ),
        **dict.fromkeys((("G", "2"), ("J", "2")), 1227.60 * _MHZ),
        **dict.fromkeys((("G", "5"), ("E", "5"), ("J", "5"), ("S", "5"), ("C", "5"), ("I", "5")), 1176.45 * _MHZ),
        **dict.fromkeys((("E", "7"), ("C", "7")), 1207.14 * _MHZ),
        ("E", "8"): 1191.795 * _MHZ,
        ("C", "8"): 1191.795 * _MHZ,
        ("E", "6"): 1278.75 * _MHZ,
        ("J", "6"): 1278.75 * _MHZ,
        ("C", "6"): 1268.52 * _MHZ,
        ("C", "2"): 1561.098 * _MHZ,
        ("I", "9"): 2492.028 * _MHZ,
        ("R", "3"): 1202.025 * _MHZ,
        ("R", "4"): 1600.995 * _MHZ,
        ("R", "6"): 1248.06 * _MHZ,
    }
)
#: GLONASS FDMA bands: frequency of channel zero and step per channel. [Hz]
GLONASS_BANDS = MappingProxyType({"1": (1602.0 * _MHZ, 0.5625 * _MHZ), "2": (1246.0 * _MHZ, 0.4375 * _MHZ)})


def satellite(name: str) -> int:
    """Number of a satellite in arrays: 100 times its system's place in :data:`SYSTEMS`, plus PRN or slot.

    Examples
    --------
    >>> satellite("G05"), satellite("E 7")
    (5, 207)
    """
    letter, number = name[:1], name[1:].strip()
    if letter not in SYSTEMS or not letter or not number.isdecimal() or not 0 < int(number) < 100:
        raise InputError(f"expected a satellite such as G05 or E12 (systems {SYSTEMS}), got {name!r}")
    return 100 * SYSTEMS.index(letter) + int(number)


def satellite_name(sat: int) -> str:
    """RINEX name of a satellite's number.

    Examples
    --------
    >>> satellite_name(207)
    'E07'
    """
    return f"{SYSTEMS[int(sat) // 100]}{int(sat) % 100:02d}"


def frequency_hz(sat: int, signal: str, glonass_channel: int | None = None) -> float:
    """Carrier frequency of a satellite's signal.

    Parameters
    ----------
    sat : int
    signal : str
        RINEX 3 band and attribute, such as ``1C``; only the band counts.
    glonass_channel : int, optional
        -7 to 13, of a GLONASS satellite's FDMA signal.

    Raises
    ------
    InputError
        For a band the system does not have, or a GLONASS FDMA signal without its channel.
    """
    system, band = SYSTEMS[int(sat) // 100], signal[:1]
    if system == "R" and band in GLONASS_BANDS:
        if glonass_channel is None:
            raise InputError(
                f"{satellite_name(sat)} {signal}: a GLONASS frequency needs its channel (ephemeris, header)"
            )
        zero, step = GLONASS_BANDS[band]
        return zero + step * glonass_channel
    if (system, band) not in BANDS:
        bands = sorted(b for s, b in BANDS if s == system)
        raise InputError(f"{SYSTEM_NAMES[system]} has no band {band!r}; it has {', '.join(bands)}")
    return BANDS[(system, band)]


def wavelengths(sat: ArrayLike, signal: str, glonass_channels: dict[int, int] | None = None) -> FloatArray:
    """Wavelength of one signal for many satellites, NaN where the GLONASS channel is unknown. Shape (n,). [m]"""
    sat = np.asarray(sat, dtype=np.int64)
    wavelength = np.full(sat.shape, np.nan)
    for s in np.unique(sat):
        channel = (glonass_channels or {}).get(int(s))
        if SYSTEMS[int(s) // 100] == "R" and signal[:1] in GLONASS_BANDS and channel is None:
            continue
        wavelength[sat == s] = SPEED_OF_LIGHT / frequency_hz(int(s), signal, channel)
    return wavelength
