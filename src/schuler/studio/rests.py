"""Rests of a log as a person accepts them: found by a calibration, moved or rejected by hand, kept in a file.

The file is that of ``--intervals``: a line START,STOP for each rest. Rejected ones stand in it as comments, so that a
page that is opened again shows them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from schuler.exceptions import InputError
from schuler.files import write_text

_REJECTED = "# rejected: "
_HEAD = "# Rests chosen by hand, for --intervals: START,STOP in seconds from the start of the log.\n"


@dataclass(frozen=True, order=True)
class Rest:
    """One rest.

    Attributes
    ----------
    start, stop : float
        From the first sample of the IMU. [s]
    accepted : bool
        Whether the calibration uses it.
    """

    start: float
    stop: float
    accepted: bool = True


def write_rests(path: Path, rests: Sequence[Rest]) -> None:
    """Write rests as a file for ``--intervals``.

    Raises
    ------
    InputError
        If none is accepted.
    """
    if not any(rest.accepted for rest in rests):
        raise InputError("expected rests that are accepted, got none: accept some, or let them be found again")
    lines = (f"{'' if rest.accepted else _REJECTED}{rest.start!r},{rest.stop!r}\n" for rest in rests)
    write_text(path, _HEAD + "".join(lines), at_once=True)


def read_rests(path: Path) -> list[Rest]:
    """Rests of a file that :func:`write_rests` wrote; empty if there is none any more.

    Raises
    ------
    InputError
        If a line is none of START,STOP.
    """
    if not path.is_file():
        return []
    rests = []
    for line in path.read_text(encoding="utf-8").splitlines():
        if line.startswith("#") and not line.startswith(_REJECTED):
            continue
        try:
            start, stop = (float(part) for part in line.removeprefix(_REJECTED).split(","))
        except ValueError:
            raise InputError(f"{path.name}: expected lines START,STOP in seconds, got {line[:80]!r}") from None
        rests.append(Rest(start, stop, not line.startswith("#")))
    return rests


def toggled(rests: Sequence[Rest], k: int) -> list[Rest]:
    """Rests with one of them accepted if it was rejected, and the other way round."""
    return [replace(rest, accepted=not rest.accepted) if i == k else rest for i, rest in enumerate(rests)]


def placed(rests: Sequence[Rest], k: int | None, start: float, stop: float) -> list[Rest]:
    """Rests in order of time with one of them moved, or with one more.

    Parameters
    ----------
    rests : sequence of Rest
    k : int or None
        Which; None: another, accepted.
    start, stop : float
        From the first sample of the IMU. [s]

    Raises
    ------
    InputError
        If it does not stop after it starts, or overlaps another.
    """
    if not 0.0 <= start < stop:
        raise InputError(f"a rest: expected 0 <= start < stop in seconds, got {start:g} to {stop:g}")
    others = [rest for i, rest in enumerate(rests) if i != k]
    if (other := next((r for r in others if r.start < stop and start < r.stop), None)) is not None:
        raise InputError(
            f"a rest from {start:g} to {stop:g} s: expected none there, got one from {other.start:g} to {other.stop:g} "
            "s: move its edges first"
        )
    accepted = True if k is None else rests[k].accepted
    return sorted([*others, Rest(start, stop, accepted)])
