"""Proposed configurations on the command line: what was decided is printed, what is open is asked on a terminal."""

from __future__ import annotations

import sys
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
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
    from schuler.cli.configuration import check_entries
    from schuler.proposal import UndecidedError, propose

    check_entries(changes)
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


def proposed_hints(log: Path, given: Mapping[str, Any], notify: Callable[[str], None]) -> dict[str, Any] | None:
    """Hints proposed for a log that was not read with those given: columns, units and clock by header and physics.

    What is open is asked on a terminal.

    Parameters
    ----------
    log : Path
    given : mapping
        Hints of the user, which stand.
    notify : callable
        Called with a sentence on each decision.

    Returns
    -------
    dict or None
        By part for a folder; None if the log is no table of an IMU, or no folder with one.

    Raises
    ------
    UndecidedError
        If a question is open and nobody is there to answer it.
    """
    from schuler.exceptions import SchulerError
    from schuler.proposal import UndecidedError, propose_reading

    if "columns" in given or "format" in given or (given and log.is_dir()):
        return None
    if log.is_dir():
        return _read_folder(log, notify)
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
        except SchulerError:  # reading says what is missing
            return recognised_files(log, given, notify=notify) or None
        for d in decisions:
            if d.value is not None:
                name = d.entry.rpartition(".")[2]
                notify(f"{log.name}: --{name.replace('_', '-')} {d.value!r}: {d.evidence}")
        return entries
    raise AssertionError("a question was asked again although it was answered")


def _read_folder(log: Path, notify: Callable[[str], None]) -> dict[str, Any] | None:
    """Entries of a folder's files with every sure cure in them, its clocks' among them; None where there is no IMU."""
    from schuler.exceptions import SchulerError
    from schuler.proposal import UndecidedError, propose_reading

    try:
        entries, decisions = propose_reading(log, {}, {})
    except UndecidedError as question:
        files = [value for _, answer in question.choices for name, value in answer.items() if name.endswith(".file")]
        if files:
            raise InputError(f"{question.text}: give one by itself, such as {log / files[0]}") from None
        return recognised_files(log, notify=notify) or None
    except SchulerError:
        return recognised_files(log, notify=notify) or None
    for d in decisions:
        if d.value is not None:
            notify(f"{d.entry} = {d.value}: {d.evidence}")
    return entries


def recognised_files(
    log: Path, given: Mapping[str, Any] = MappingProxyType({}), *, notify: Callable[[str], None] = say
) -> dict[str, Any]:
    """Files, columns and units of a log as ``schuler navigate`` recognises them; empty where it does not.

    Parameters
    ----------
    log : Path
        File or folder.
    given : mapping, optional
        Hints of the user on a file, which stand.
    notify : callable
        Called with a sentence on each decision.

    Returns
    -------
    dict
        Hints, by part for a folder.

    Raises
    ------
    InputError
        If two files of a folder could be the same part; options answer.
    """
    from schuler.exceptions import SchulerError
    from schuler.proposal import UndecidedError
    from schuler.proposal.files import files_of

    try:
        files = files_of([log], given)
    except UndecidedError as question:
        words = " or ".join(f"--{k.split('.')[1]} {v}" for _, answer in question.choices for k, v in answer.items())
        if log.is_dir() and words:
            raise InputError(f"{question.text}: say {words}") from None
        return {}
    except SchulerError:
        return {}  # the diagnosis says why
    for d in files.decisions:
        option = f"--{d.entry.rpartition('.')[2].replace('_', '-')}"
        notify(f"{f'{d.entry} =' if log.is_dir() else option} {d.value}: {d.evidence}")
    return files.entries


def in_options_of_reading(question: UndecidedError) -> InputError:
    """A question on how a log is read, answered by options of the command instead of entries of a configuration."""
    answers = []
    for words, entries in question.choices:
        option = " ".join(f"--{name.rpartition('.')[2].replace('_', '-')} {value}" for name, value in entries.items())
        answers.append(option if words in option else f"{option} ({words})")
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
