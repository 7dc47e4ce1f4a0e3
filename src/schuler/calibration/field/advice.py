"""What a coach says: its advice as data and in words, and how it is set up."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from schuler import rotation
from schuler.arrays import FloatArray
from schuler.calibration.field.steps import Turn, pose_in_words
from schuler.exceptions import InputError
from schuler.units import DEG

_LIES = np.sin(20.0 * DEG)  # an axis nearer to the horizontal than this is called horizontal
_LISTED = 6  # names of parameters in a sentence


@dataclass(frozen=True, slots=True)
class CoachOptions:
    """How a coach works.

    Attributes
    ----------
    target : float
        A parameter is found out when its 1-sigma is below this share of what it was before the log, by a margin of 5 %.
    rest_s, first_rest_s : float
        Length of a rest; of the first one, and of one more in the same place. [s]
    angles : tuple of float
        Turns to choose from, about the x, y and z axis both ways. [rad]
    turn_rate : float
        How fast a hand turns. [rad/s]
    reaction_s : float
        From an advice to the beginning of the turn: the sensor still rests. [s]
    ahead : int
        How many equal moves in a row are looked at, of turns up to 90 deg.
    patience_s : float
        What would not reach the target within this time is given up. [s]
    """

    target: float = 0.1
    rest_s: float = 5.0
    first_rest_s: float = 10.0
    angles: tuple[float, ...] = (45.0 * DEG, 90.0 * DEG, 180.0 * DEG, 360.0 * DEG)
    turn_rate: float = 36.0 * DEG
    reaction_s: float = 2.0
    ahead: int = 3
    patience_s: float = 300.0

    def __post_init__(self) -> None:
        if not 0.0 < self.target < 1.0:
            raise InputError(f"target: expected a share between 0 and 1, got {self.target!r}")
        if not self.rest_s >= 3.0 or not self.first_rest_s >= 6.0:
            raise InputError(
                f"expected rest_s of 3 s or more and first_rest_s of 6 s or more, got {self.rest_s:g} and "
                f"{self.first_rest_s:g}: the ends of a rest are not used, and noise is learnt from the first"
            )
        if not (self.angles and all(0.0 < a <= 2.0 * np.pi for a in self.angles)):
            raise InputError(f"angles: expected turns of up to 2 pi in radians, got {self.angles!r}")
        if not (self.turn_rate > 0.0 and self.reaction_s >= 0.0 and self.ahead >= 1 and self.patience_s > 0.0):
            raise InputError("expected positive turn_rate, ahead and patience_s, and reaction_s of zero or more")


@dataclass(frozen=True)
class Advice:
    """What a coach says.

    Attributes
    ----------
    t, elapsed : float
        Time of the log, and since its beginning. [s]
    share : dict of str to float
        1-sigma of every parameter over that before the log.
    remaining : dict of str to float
        Those above the target that can be brought down.
    out_of_reach : dict of str to float
        Those above the target that cannot within the patience of the options.
    progress : float
        0 to 1: how much of the way to the target all parameters within reach have come, in the logarithm.
    turn : Turn or None
        What to do next; None: leave it where it is.
    rest_s : float
        And then rest. [s]
    next : str
        The same in words.
    gain : float
        How much ``progress`` will grow by it.
    done : bool
        Nothing remains: stop.
    rests : int
        Rests so far.
    moving : bool
        The log does not end at rest.
    """

    t: float
    elapsed: float
    share: dict[str, float]
    remaining: dict[str, float]
    out_of_reach: dict[str, float]
    progress: float
    turn: Turn | None
    rest_s: float
    next: str
    gain: float
    done: bool
    rests: int
    moving: bool

    def line(self) -> str:
        """One line for a terminal."""
        left = f", {len(self.remaining)} to go" if self.remaining else ""
        return f"{self.elapsed:6.1f} s  {self.progress:4.0%}{left}: {self.next}"

    def summary(self) -> str:
        """A few lines for people."""
        lines = [f"{self.elapsed:.1f} s, {self.rests} rests, {self.progress:.0%} done", self.next]
        for what, values in (("not yet below the target", self.remaining), ("out of reach", self.out_of_reach)):
            if values:
                worst = sorted(values, key=lambda n: -values[n])
                lines.append(f"{what}: {', '.join(f'{n} {values[n]:.0%}' for n in worst)}")
        return "\n".join(lines)


def words_of_move(turn: Turn | None, rest_s: float, C_nb: FloatArray, helped: Sequence[str]) -> str:
    """A move for a person who holds the sensor.

    Parameters
    ----------
    turn : Turn or None
        About a body axis; None for staying.
    rest_s : float
        [s]
    C_nb : ndarray, shape (3, 3)
        Attitude before.
    helped : sequence of str
        Parameters that gain by it.
    """
    why = f" (for {_few(helped)})" if helped else ""
    if turn is None:
        return f"leave it where it is, rest {rest_s:.0f} s more{why}"
    k = int(np.argmax(np.abs(turn.unit)))
    axis, upward = "xyz"[k], -C_nb[2, k]
    lies = (
        "which is horizontal now"
        if abs(upward) < _LIES
        else f"which points {'up' if upward > 0.0 else 'down'} now"
        if abs(upward) > np.sqrt(1.0 - _LIES**2)
        else f"which slants {'up' if upward > 0.0 else 'down'} now"
    )
    way = "clockwise" if turn.angle > 0.0 else "anticlockwise"
    C = C_nb @ rotation.dcm_from_rotvec(turn.angle * turn.unit)
    return (
        f"turn {abs(turn.angle) / DEG:.0f} deg {way} about {axis} (seen along {axis}, {lies}), "
        f"to {pose_in_words(C[2])}; rest {rest_s:.0f} s{why}"
    )


def words_of_waiting(state: Literal["first", "moving", "done"], coaching: CoachOptions) -> str:
    """What is said when there is nothing to be turned."""
    if state == "first":
        return f"lay it down, any side, and let it rest {coaching.first_rest_s:.0f} s"
    if state == "moving":
        return f"hold it still where it is now, rest {coaching.rest_s:.0f} s"
    return "done: stop, nothing that can be improved soon is left"


def _few(names: Sequence[str]) -> str:
    more = len(names) - _LISTED
    return ", ".join(names[:_LISTED]) + (f" and {more} more" if more > 0 else "")
