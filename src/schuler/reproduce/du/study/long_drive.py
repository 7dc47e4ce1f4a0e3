"""The drive of the integrated tests: 33 minutes of rectangles, circles and straights, with three long outages."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from schuler.units import DEG

if TYPE_CHECKING:
    from schuler.simulation.profiles import ManoeuvreMotion

#: Latitude, longitude [rad], height [m]: Calgary.
PLACE = np.array([51.08 * DEG, -114.13 * DEG, 1100.0])
REST_S, LAP_S = 30.0, 540.0
#: Length: 30 s at rest, 32.5 min driving. [s]
LENGTH_S = 1980.0
#: GNSS is lost three times for 300 s, at the same place of three laps. [s]
OUTAGES_S = ((360.0, 660.0), (900.0, 1200.0), (1440.0, 1740.0))


def long_drive(length_s: float = LENGTH_S) -> ManoeuvreMotion:
    """Rest, then laps: a rectangle of 1.8 km by 0.6 km, two circles, a straight, changes of speed.

    Parameters
    ----------
    length_s : float
        Shorter for tests; the drive ends with the manoeuvre that reaches it. [s]

    References
    ----------
    Du (2015), section 6.3.1: lengths and shapes; the map is lost and start times of outages are not stated.
    """
    from schuler.simulation.profiles import Manoeuvre, ManoeuvreMotion

    quarter = 0.5 * np.pi
    lap = [
        Manoeuvre(duration=20.0, speed=14.0),
        Manoeuvre(duration=60.0),
        Manoeuvre(duration=8.0, turn=quarter),
        Manoeuvre(duration=34.0),
        Manoeuvre(duration=8.0, turn=quarter),
        Manoeuvre(duration=60.0, speed=16.0),
        Manoeuvre(duration=20.0, speed=12.0),
        Manoeuvre(duration=8.0, turn=quarter),
        Manoeuvre(duration=42.0),
        Manoeuvre(duration=8.0, turn=quarter),
        Manoeuvre(duration=12.0),
        Manoeuvre(duration=40.0, turn=2.0 * np.pi),
        Manoeuvre(duration=10.0, speed=10.0),
        Manoeuvre(duration=40.0, turn=-2.0 * np.pi),
        Manoeuvre(duration=20.0, speed=15.0),
        Manoeuvre(duration=80.0),
        Manoeuvre(duration=20.0, speed=8.0),
        Manoeuvre(duration=10.0, turn=2.0 * quarter),
        Manoeuvre(duration=30.0, speed=14.0),
        Manoeuvre(duration=10.0, turn=-2.0 * quarter),
    ]
    commands = [Manoeuvre(duration=REST_S)]
    while sum(c.duration for c in commands) < length_s + 1.0:
        commands += lap
    kept, total = [], 0.0
    for c in commands:
        if total >= length_s:
            break
        kept.append(c)
        total += c.duration
    return ManoeuvreMotion.of(kept, PLACE, heading=0.3, bank=0.0)
