"""What is wrong with a log, as sentences with a place."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, TypeAlias

Severity: TypeAlias = Literal["note", "warning", "refused"]
#: Probability of a false finding of one kind (motion, outliers, steps, stuck values) in a clean log.
FALSE_ALARM = 0.01
#: Places named for one kind of finding.
SHOWN = 3


@dataclass(frozen=True, slots=True)
class Finding:
    """One thing about a log that its reader should know before believing a number made of it.

    Attributes
    ----------
    code : str
        Short name for scripts: ``too_short``, ``step``, ``saturated``, ``stuck``, ``motion``, ``trend``,
        ``temperature``, ``gap``, ``outliers``, ``coarse``, ``not_at_rest``, ...
    text : str
        One sentence: what was seen, what it does to the result, what to do.
    start_s, stop_s : float or None
        Where, in seconds from the start of the recording; None for all of it.
    severity : {"note", "warning", "refused"}
        ``refused``: no number is given.
    """

    code: str
    text: str
    start_s: float | None = None
    stop_s: float | None = None
    severity: Severity = "warning"


def found_at(code: str, text: str, start: float, stop: float, severity: Severity = "warning") -> Finding:
    """A finding with its place, in seconds from the start of the recording."""
    return Finding(code, text, float(start), float(stop), severity)
