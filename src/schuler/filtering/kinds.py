"""Names of the kinds of measurements in reports, and the units of their innovations."""

from __future__ import annotations

from types import MappingProxyType
from typing import NamedTuple

from schuler.filtering.measurements import (
    ARC_START,
    CARRIER_PHASE,
    EARTH_RATE,
    EARTH_RATE_MAGNITUDE,
    FIX,
    GNSS_HEADING,
    GRAVITY,
    GRAVITY_VECTOR,
    HEADING,
    HEIGHT,
    KINDS,
    LATERAL,
    POSITION,
    PSEUDORANGE,
    RANGE_RATE,
    RESET_POSITION,
    RESET_VELOCITY,
    SPEED,
    VELOCITY,
    VERTICAL,
    ZERO_RATE,
    ZERO_VELOCITY,
)
from schuler.units import DEG, DEG_PER_HR

_NED = ("north", "east", "down")


class Kind(NamedTuple):
    """Display of a kind of measurement.

    Attributes
    ----------
    text : str
        Name in reports.
    unit : str
    factor : float
        SI unit in the unit shown: divide by it.
    axes : tuple of str
        Names of the components.
    """

    text: str
    unit: str
    factor: float
    axes: tuple[str, ...]


#: By code of the kind.
DISPLAY: MappingProxyType[int, Kind] = MappingProxyType(
    {
        POSITION: Kind("GNSS position", "m", 1.0, _NED),
        VELOCITY: Kind("GNSS velocity", "m/s", 1.0, _NED),
        ZERO_VELOCITY: Kind("zero velocity", "m/s", 1.0, _NED),
        LATERAL: Kind("no sideways slip", "m/s", 1.0, ("to the right",)),
        VERTICAL: Kind("no vertical slip", "m/s", 1.0, ("down",)),
        SPEED: Kind("wheel speed", "m/s", 1.0, ("forward",)),
        ZERO_RATE: Kind("zero rotation", "deg/s", DEG, ("x", "y", "z")),
        PSEUDORANGE: Kind("pseudorange", "m", 1.0, ("range",)),
        RANGE_RATE: Kind("range rate", "m/s", 1.0, ("range rate",)),
        HEADING: Kind("heading", "deg", DEG, ("heading",)),
        HEIGHT: Kind("barometric height", "m", 1.0, ("height",)),
        FIX: Kind("known place", "m", 1.0, _NED),
        RESET_POSITION: Kind("position reset", "m", 1.0, _NED),
        RESET_VELOCITY: Kind("velocity reset", "m/s", 1.0, _NED),
        GNSS_HEADING: Kind("two-antenna heading", "deg", DEG, ("heading",)),
        GRAVITY: Kind("gravity", "m/s^2", 1.0, ("magnitude",)),
        GRAVITY_VECTOR: Kind("gravity direction", "m/s^2", 1.0, _NED),
        EARTH_RATE: Kind("vertical Earth rate", "deg/h", DEG_PER_HR, ("up",)),
        EARTH_RATE_MAGNITUDE: Kind("Earth rate", "deg/h", DEG_PER_HR, ("magnitude",)),
        CARRIER_PHASE: Kind("carrier phase", "m", 1.0, ("phase",)),
        ARC_START: Kind("start of an arc of carrier phases", "m", 1.0, ()),
    }
)


def kind_display(kind: str) -> Kind:
    """Display of a kind, by its name in results."""
    return DISPLAY[next(code for code, name in KINDS.items() if name == kind)]
