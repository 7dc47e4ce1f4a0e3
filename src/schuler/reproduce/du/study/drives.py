"""Drives of the kinematic tests (2.3 km in 210 s) and of the integrated tests (33 minutes, three long outages)."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from schuler.arrays import ArrayLike
from schuler.units import DEG

if TYPE_CHECKING:
    from schuler.simulation.profiles import ManoeuvreMotion


#: Length of the drive itself. [s]
DRIVE_S = 210.0
_SPEED = 11.7  # [m/s]


def drive(llh: ArrayLike, *, rest_s: float) -> ManoeuvreMotion:
    """A car that rests, then drives; heading north at first.

    Parameters
    ----------
    llh : array_like, shape (3,)
        Start: latitude, longitude [rad], height [m].
    rest_s : float
        Before the drive. [s]

    References
    ----------
    Du (2015), section 4.2 and figure 4.27, lost in the source: length and duration are the thesis's, the order of the
    manoeuvres is ours.
    """
    from schuler.simulation.profiles import Manoeuvre, ManoeuvreMotion

    turn, loop = 90.0 * DEG, 2.0 * np.pi
    commands = [
        Manoeuvre(duration=rest_s, speed=0.0),
        Manoeuvre(duration=12.0, speed=_SPEED),
        Manoeuvre(duration=28.0),
        Manoeuvre(duration=8.0, turn=turn),
        Manoeuvre(duration=20.0),
        Manoeuvre(duration=24.0, turn=loop),
        Manoeuvre(duration=20.0),
        Manoeuvre(duration=8.0, turn=-turn),
        Manoeuvre(duration=24.0),
        Manoeuvre(duration=24.0, turn=-loop),
        Manoeuvre(duration=14.0),
        Manoeuvre(duration=12.0, turn=2.0 * turn),
        Manoeuvre(duration=16.0, speed=0.0),
    ]
    return ManoeuvreMotion.of(commands, llh, bank=0.0)


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
