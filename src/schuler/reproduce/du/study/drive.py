"""The drive of the kinematic tests: 2.3 km in 210 s, straights, turns, two loops, from rest to rest."""

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
