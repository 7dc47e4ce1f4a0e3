"""Advice of a coach, as data and in words."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from schuler import rotation
from schuler.arrays import FloatArray
from schuler.calibration.field.options import CoachOptions
from schuler.plotting.notebook import Displayed
from schuler.simulation.steps import Turn, pose_in_words
from schuler.units import DEG

_HORIZONTAL = np.sin(20.0 * DEG)  # largest slope of an axis that is called horizontal
_LISTED = 6  # names of parameters in a sentence


@dataclass(frozen=True, repr=False)
class Advice(Displayed):
    """The next move, and what is still uncertain.

    Attributes
    ----------
    t, elapsed : float
        Time of the log, and since its beginning. [s]
    share : dict of str to float
        1-sigma of every parameter over that before the log.
    remaining : dict of str to float
        Parameters above the target that can reach it.
    out_of_reach : dict of str to float
        Parameters above the target that cannot reach it within the patience of the options.
    progress : float
        0 to 1: share of the way to the target of the parameters within reach, in the logarithm.
    turn : Turn or None
        The next turn; None: leave the unit where it is.
    rest_s : float
        Length of the rest after it. [s]
    next : str
        The same in words.
    gain : float
        Growth of ``progress`` by it.
    done : bool
        Nothing remains to be done.
    rests : int
        Number of rests so far.
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


def move_sentence(turn: Turn | None, rest_s: float, C_nb: FloatArray, helped: Sequence[str]) -> str:
    """A move as a sentence for a person who holds the sensor.

    Parameters
    ----------
    turn : Turn or None
        About a body axis; None for staying.
    rest_s : float
        [s]
    C_nb : ndarray, shape (3, 3)
        Attitude before the move.
    helped : sequence of str
        Parameters that become more certain by it.
    """
    why = f" (for {_listed(helped)})" if helped else ""
    if turn is None:
        return f"leave it where it is, rest {rest_s:.0f} s more{why}"
    k = int(np.argmax(np.abs(turn.unit)))
    axis, upward = "xyz"[k], -C_nb[2, k]
    slope = (
        "which is horizontal now"
        if abs(upward) < _HORIZONTAL
        else f"which points {'up' if upward > 0.0 else 'down'} now"
        if abs(upward) > np.sqrt(1.0 - _HORIZONTAL**2)
        else f"which slants {'up' if upward > 0.0 else 'down'} now"
    )
    way = "clockwise" if turn.angle > 0.0 else "anticlockwise"
    C = C_nb @ rotation.dcm_from_rotvec(turn.angle * turn.unit)
    return (
        f"turn {abs(turn.angle) / DEG:.0f} deg {way} about {axis} (seen along {axis}, {slope}), "
        f"to {pose_in_words(C[2])}; rest {rest_s:.0f} s{why}"
    )


def waiting_sentence(state: Literal["first", "moving", "done"], coaching: CoachOptions) -> str:
    """A sentence where nothing is to be turned."""
    if state == "first":
        return f"lay it down, any side, and let it rest {coaching.first_rest_s:.0f} s"
    if state == "moving":
        return f"hold it still where it is now, rest {coaching.rest_s:.0f} s"
    return "done: stop, nothing that can be improved soon is left"


def _listed(names: Sequence[str]) -> str:
    more = len(names) - _LISTED
    return ", ".join(names[:_LISTED]) + (f" and {more} more" if more > 0 else "")
