"""Decisions on a configuration with their evidence, and questions that a log leaves open."""

from __future__ import annotations

import json
import shlex
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from schuler.exceptions import InputError
from schuler.toml import toml_value


@dataclass(frozen=True, slots=True)
class Decision:
    """One entry of a configuration, why it is so, and the option that overrides it.

    Attributes
    ----------
    entry : str
        Name of the entry with dots, ``recording.imu.axes``.
    value : Any
        In the unit of the entry; None where the default is kept and only worth a remark.
    evidence : str
        One sentence without a full stop.
    """

    entry: str
    value: Any
    evidence: str

    @property
    def option(self) -> str:
        """The option of the command line that says it, such as ``--set imu.clock_shift_s=0.12``."""
        return option(self.entry, self.value)


class UndecidedError(InputError):
    """A question that the log does not answer, with the answers it allows.

    Attributes
    ----------
    text : str
    choices : tuple of (str, dict)
        Words, and the entries of the configuration that say so; empty where only the user knows.
    """

    def __init__(self, text: str, choices: Sequence[tuple[str, Mapping[str, Any]]] = ()) -> None:
        self.text = text
        self.choices = tuple((words, dict(entries)) for words, entries in choices)
        answers = "; ".join(f"{words}: {options(entries)}" for words, entries in self.choices)
        super().__init__(f"{text}. Answer with one of: {answers}" if answers else text)


def option(entry: str, value: Any) -> str:
    """Option of the command line for one entry.

    Parameters
    ----------
    entry : str
    value : Any
        None: the entry with a place for its value.
    """
    if value is None:
        return f"--set {entry}=..."
    if isinstance(value, str):
        # what is no TOML is taken as text, so that quotes are needed only where a shell or TOML would read it otherwise
        plain = value.replace("_", "").replace("-", "").isalnum() and not value[:1].isdigit()
        return f"--set {entry}={value if plain and value not in ('true', 'false') else json.dumps(value)!r}"
    text = toml_value(value)
    if '"' in text or ("," in text and "{" in text):  # a shell would take its quotes, or make two words of a table
        return f"--set {shlex.quote(f'{entry}={text}')}"
    return f"--set {entry}={text.replace(' ', '')}"


def options(entries: Mapping[str, Any]) -> str:
    """Options of the command line for some entries.

    Parameters
    ----------
    entries : mapping
        Values by name with dots.
    """
    return " ".join(option(entry, value) for entry, value in entries.items())
