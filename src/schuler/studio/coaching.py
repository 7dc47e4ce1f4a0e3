"""What the coach of ``schuler calibrate field --coach`` has said so far, for a page that follows it."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, TypeAlias

Motion: TypeAlias = Literal["", "turning", "resting"]

# as Advice.line and the events between two of them
_ADVICE = re.compile(r"\s*([\d.]+) s\s+(\d+)%(?:, \d+ to go)?: (.*)")
_EVENT = re.compile(r"\s*([\d.]+) s  (turning|resting|no rest.*?)(?:: .*)?$")


@dataclass(frozen=True)
class CoachState:
    """The latest advice, and what the unit does.

    Attributes
    ----------
    elapsed_s : float
        Of the log, at the last line. [s]
    percent : int
        Share of the way to the target.
    move : str
        What to do.
    reason : str
        What for; empty if nothing is said of it.
    motion : {"", "turning", "resting"}
        Since the last advice; empty if nothing was said.
    """

    elapsed_s: float
    percent: int
    move: str
    reason: str
    motion: Motion


def coach_state(lines: Sequence[str]) -> CoachState | None:
    """State after these lines of the coach, None if there is no advice in them."""
    state: CoachState | None = None
    for line in lines:
        if match := _ADVICE.fullmatch(line.rstrip("\a").lstrip("\a")):
            move, _, reason = match[3].partition(" (for ")
            state = CoachState(float(match[1]), int(match[2]), move, reason.removesuffix(")"), "")
        elif state is not None and (match := _EVENT.fullmatch(line)):
            motion: Motion = "resting" if match[2] == "resting" else "turning"
            state = CoachState(float(match[1]), state.percent, state.move, state.reason, motion)
    return state
