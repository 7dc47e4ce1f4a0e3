"""Proposed configurations on the command line: what was decided is printed, what is open is asked on a terminal."""

from __future__ import annotations

import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from schuler.cli.output import say
from schuler.cli.reading import Part
from schuler.exceptions import InputError

if TYPE_CHECKING:
    from schuler.proposal import Proposal, UndecidedError

_MOST = 8  # questions in a row
_ALL = Part()


def proposed(
    logs: Sequence[Path],
    imu: str | None,
    changes: Sequence[tuple[str, Any]],
    without: Sequence[str] = (),
    *,
    trials: bool = True,
    part: Part = _ALL,
) -> Proposal:
    """The configuration proposed for files, printed to stderr with its evidence.

    Parameters
    ----------
    logs : sequence of Path
    imu : str, optional
    changes : sequence of (str, value)
        Entries that the user gave.
    without : sequence of str
        Aids not to be used.
    trials : bool
        Also decide what takes trial runs of the filter.
    part : Part
        Of the log that is proposed for.

    Raises
    ------
    UndecidedError
        If a question is open and nobody is there to answer it.
    """
    from schuler.proposal import UndecidedError, propose

    given = dict(changes) | {f"aiding.{name}": None for name in without}
    for _ in range(_MOST):
        try:
            proposal = propose(logs, imu=imu, given=given, trials=trials, part=(part.start, part.stop))
        except UndecidedError as question:
            if not question.choices or not (sys.stdin.isatty() and sys.stderr.isatty()):
                raise
            given |= answer(question)
            continue
        say(proposal.summary())
        return proposal
    raise AssertionError("a question was asked again although it was answered")


def proposed_hints(log: Path, given: Mapping[str, Any]) -> dict[str, Any] | None:
    """Hints proposed for a text log that was not read with those given: columns, units and clock by header and physics.

    What is decided is said on stderr; what is open is asked on a terminal.

    Parameters
    ----------
    log : Path
    given : mapping
        Hints of the user, which stand.

    Returns
    -------
    dict or None
        None if the log is no table of an IMU.

    Raises
    ------
    UndecidedError
        If a question is open and nobody is there to answer it.
    """
    from schuler.exceptions import SchulerError
    from schuler.proposal import UndecidedError, propose_reading

    if not log.is_file() or "columns" in given or "format" in given:
        return None
    hints = dict(given)
    for _ in range(_MOST):
        try:
            entries, decisions = propose_reading(log, hints, hints)
        except UndecidedError as question:
            if not question.choices:
                return None
            if not (sys.stdin.isatty() and sys.stderr.isatty()):
                raise in_options_of_reading(question) from None
            hints |= {name.rpartition(".")[2]: value for name, value in answer(question).items()}
            continue
        except SchulerError:
            return None
        for d in decisions:
            if d.value is not None:
                name = d.entry.rpartition(".")[2]
                say(f"{log.name}: --{name.replace('_', '-')} {d.value!r}: {d.evidence}")
        return entries
    raise AssertionError("a question was asked again although it was answered")


def in_options_of_reading(question: UndecidedError) -> InputError:
    """A question on how a log is read, answered by options of the command instead of entries of a configuration."""
    answers = [
        " ".join(f"--{name.rpartition('.')[2].replace('_', '-')} {value}" for name, value in entries.items())
        for _, entries in question.choices
    ]
    return InputError(f"{question.text}: say {', or '.join(answers)}")


def answer(question: UndecidedError) -> dict[str, Any]:
    """Entries of the answer that the user chooses on the terminal."""
    say(question.text)
    for k, (words, entries) in enumerate(question.choices, 1):
        shown = ", ".join(f"{name} = {value}" for name, value in entries.items())
        say(f"  {k}  {words} ({shown})")
    while True:
        text = input(f"1 to {len(question.choices)}: ").strip()
        if text.isdigit() and 1 <= int(text) <= len(question.choices):
            return question.choices[int(text) - 1][1]
