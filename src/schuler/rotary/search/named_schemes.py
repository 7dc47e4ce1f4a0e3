"""The schemes that the literature names, on a given platform: they start every search, and are its yardstick.

The thesis lists them in its first chapter without all their numbers. Every scheme is there at Levinson's 10 deg/s and
at the platform's largest rate; where a dwell is not given it is such that the mission holds two cycles.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from schuler.rotary.gimbals import axis_vector
from schuler.rotary.search.families import Entries, SchemeSpace
from schuler.units import DEG

RATE = 10.0 * DEG  # Levinson and Majure (1987), and Du's
DWELL = 660.0  # of the same, eleven minutes [s]
_CYCLES = 2


class NamedScheme(NamedTuple):
    """A scheme of the literature.

    Attributes
    ----------
    name : str
    source : str
        Who proposed it, as the thesis says.
    axes : int
    entries : dict
        Entries of ``[rotary.schedule]``.
    """

    name: str
    source: str
    axes: int
    entries: Entries


def named_schemes(space: SchemeSpace, axes: int = 1) -> list[NamedScheme]:
    """Every scheme the thesis names that a platform of so many axes can be told, about each of its axes.

    Parameters
    ----------
    space : SchemeSpace
        Whether its limits of angle allow a scheme is not asked here.
    axes : int

    References
    ----------
    Du (2015), section 1.2: Geller (1968), Levinson and Majure (1987), Giovanni and Levinson (1981), Yuan et al. (2012),
    Sun et al. (2009, 2011), Ishibashi et al. (2006); chapter 3 for rotation about X, Y and Z. Zha et al. (2012) turn
    pairs of opposite sensors, which is no schedule.
    """
    limit = space.limits.rate
    schemes = [NamedScheme("conventional", "no rotation", 1, {"type": "fixed"})]
    schemes += _at(space, axes, float(min(RATE, limit) / DEG), "")
    if limit > RATE:
        schemes += _at(space, axes, float(limit / DEG), ", at the limit")
    return schemes


def _at(space: SchemeSpace, axes: int, rate: float, suffix: str) -> list[NamedScheme]:
    """All schemes at one rate. [deg/s]"""
    usual = space.usual
    schemes: list[NamedScheme] = []

    def add(name: str, source: str, entries: Entries, needs: int = 1) -> None:
        schemes.append(NamedScheme(name + suffix, source, needs, {**entries, **usual}))

    for axis in space.axes:
        turning = {"type": "continuous", "axis": axis, "rate_deg_s": rate}
        add(f"continuous {axis}", "Geller 1968, Du 2015", turning)
        opposite = axis[1:] if axis.startswith("-") else f"-{axis}"
        add(f"continuous {opposite}", "Du 2015", {**turning, "axis": opposite})
        stroke = {"type": "reciprocating", "axis": axis, "rate_deg_s": rate, "turn_deg": 360.0}
        add(f"reciprocating 360 {axis}", "Sun 2009, Ishibashi 2006", stroke)
        add(f"reciprocating +-360 {axis}", "Sun 2009, Ishibashi 2006", {**stroke, "both_sides": True})
        for positions, source in ((4, "Levinson, Giovanni"), (2, "Yuan"), (4, "Yuan, Sun 2011"), (16, "Sun 2011")):
            for back in (False, True):
                way = "and back" if back else "onwards"
                visits = positions * (2 if back else 1)
                name = f"{positions} positions {way} {axis}"
                seconds = _fitted(space, visits, 360.0 / positions / rate)
                if source.startswith("Levinson"):
                    name, seconds = f"{name}, 660 s", DWELL
                stops = {"positions": positions, "dwell_s": seconds, "back": back}
                add(name, source, {"type": "dwell", "axis": axis, "rate_deg_s": rate, **stops})
    if axes > 1:
        for outer in space.axes:
            for inner in space.axes:
                if abs(float(axis_vector(outer) @ axis_vector(inner))) < 1e-9:
                    for positions in (4, 8, 16):
                        seconds = _fitted(space, positions, 180.0 / rate)
                        both = {"type": "dual_axis", "axes": (outer, inner), "rate_deg_s": rate}
                        name = f"dual axis {positions} positions {outer}{inner}"
                        add(name, "Yuan 2012, Levinson and Majure",
                            {**both, "positions": positions, "dwell_s": seconds}, 2)  # fmt: skip
    return schemes


def _fitted(space: SchemeSpace, visits: int, moving: float) -> float:
    """Dwell with which two cycles of so many moves of a time [s] fill the mission; at least half a move."""
    return float(np.maximum(space.duration / (_CYCLES * visits) - moving, 0.5 * moving))
