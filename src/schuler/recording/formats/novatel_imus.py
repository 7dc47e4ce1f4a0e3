"""What a count of NovAtel's raw IMU messages is, by type of IMU.

Numbers: NovAtel, "OEM7 Commands and Logs Reference Manual", RAWIMUSX, table "Raw IMU Scale Factors"; for types that the
manual gives per sample at a rate, at that rate. Types without an entry are refused, not guessed.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType

from schuler import units


@dataclass(frozen=True, slots=True)
class ImuType:
    """An IMU that a SPAN receiver reads.

    Attributes
    ----------
    name : str
        As INSCONFIG writes it.
    accel : float
        Velocity increment of one count. [m/s]
    gyro : float
        Angle increment of one count. [rad]
    rate_hz : float, optional
        Output rate, if it is sure. [Hz]
    """

    name: str
    accel: float
    gyro: float
    rate_hz: float | None = None


_HONEYWELL = 2.0**-33  # [rad]
_FINE, _COARSE = 2.0**-27 * units.FT, 2.0**-26 * units.FT  # [m/s]


def _epson(name: str, accel_mg: float, gyro_deg_s: float, rate_hz: float) -> ImuType:
    """Epson's units count rates, in 1/65536 of their own step; increments follow from their rate."""
    return ImuType(name, accel_mg * units.MG / 65536.0 / rate_hz, gyro_deg_s * units.DEG / 65536.0 / rate_hz, rate_hz)


#: Types by the number in RAWIMUX, RAWIMUSX and INSCONFIG.
IMU_TYPES: Mapping[int, ImuType] = MappingProxyType({
    1: ImuType("HG1700_AG11", _FINE, _HONEYWELL, 100.0),
    4: ImuType("HG1700_AG17", _COARSE, _HONEYWELL, 100.0),
    5: ImuType("HG1900_CA29", _FINE, _HONEYWELL, 100.0),
    8: ImuType("LN200", 2.0**-14, 2.0**-19, 200.0),
    11: ImuType("HG1700_AG58", _FINE, _HONEYWELL, 100.0),
    12: ImuType("HG1700_AG62", _COARSE, _HONEYWELL, 100.0),
    13: ImuType("IMAR_FSAS", 0.05 * 2.0**-15, 0.1 * 2.0**-8 * units.ARCSEC, 200.0),
    16: ImuType("KVH_COTS", 0.05 * 2.0**-15, 0.1 / (3600.0 * 256.0)),
    20: ImuType("HG1930_AA99", _FINE, _HONEYWELL, 100.0),
    26: ImuType("ISA100C", 2.0e-8, 1.0e-9, 200.0),
    27: ImuType("HG1900_CA50", _FINE, _HONEYWELL, 100.0),
    28: ImuType("HG1930_CA50", _FINE, _HONEYWELL, 100.0),
    31: ImuType("ADIS16488", 200.0 * 2.0**-31, 720.0 * 2.0**-31 * units.DEG, 200.0),
    32: ImuType("STIM300", 2.0**-22, 2.0**-21 * units.DEG, 125.0),
    33: ImuType("KVH_1750", 0.05 * 2.0**-15, 0.1 / (3600.0 * 256.0), 200.0),
    41: _epson("EPSON_G320", 0.2, 0.008, 125.0),
    52: ImuType("LITEF_MICROIMU", 2.0e-8, 1.0e-9, 200.0),
    56: ImuType("STIM300D", 2.0**-22, 2.0**-21 * units.DEG, 125.0),
    58: ImuType("HG4930_AN01", 2.0**-29, _HONEYWELL, 100.0),
    61: _epson("EPSON_G370", 0.4, 0.0151515, 200.0),
    62: _epson("EPSON_G320_200HZ", 0.2, 0.008, 200.0),
    68: ImuType("HG4930_AN04", 2.0**-29, _HONEYWELL, 100.0),
    69: ImuType("HG4930_AN04_400HZ", 2.0**-29, _HONEYWELL, 400.0),
})  # fmt: skip


def by_name(name: str) -> ImuType | None:
    """The type of a name, with or without ``IMU_`` before it, or of a number as text; ``None`` if it is not known."""
    word = name.upper().removeprefix("IMU_")
    if word.isdecimal():
        return IMU_TYPES.get(int(word))
    return next((kind for kind in IMU_TYPES.values() if kind.name == word), None)
