"""Proposed configurations on the command line: what was decided is printed, what is open is asked on a terminal."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from schuler.cli.output import say

if TYPE_CHECKING:
    from schuler.proposal import Proposal, UndecidedError

_MOST = 8  # questions in a row


def proposed(
    logs: Sequence[Path],
    imu: str | None,
    changes: Sequence[tuple[str, Any]],
    without: Sequence[str] = (),
    *,
    trials: bool = True,
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

    Raises
    ------
    UndecidedError
        If a question is open and nobody is there to answer it.
    """
    from schuler.proposal import UndecidedError, propose

    given = dict(changes) | {f"aiding.{name}": None for name in without}
    for _ in range(_MOST):
        try:
            proposal = propose(logs, imu=imu, given=given, trials=trials)
        except UndecidedError as question:
            if not question.choices or not (sys.stdin.isatty() and sys.stderr.isatty()):
                raise
            given |= answer(question)
            continue
        say(proposal.summary())
        return proposal
    raise AssertionError("a question was asked again although it was answered")


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
