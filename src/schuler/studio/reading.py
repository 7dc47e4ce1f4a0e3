"""How a log is read, put together on a page: hints, open questions, cures, and the file that keeps them."""

from __future__ import annotations

import shlex
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from schuler.diagnosis.result import Diagnosis, Finding
from schuler.exceptions import InputError
from schuler.files import read_toml, write_text
from schuler.proposal import Decision, UndecidedError, propose_reading
from schuler.proposal.cures import proposed
from schuler.proposal.files import Files
from schuler.proposal.setup import nested
from schuler.proposal.toml import toml_of
from schuler.recording.io.hints import ReadHints
from schuler.toml import merged, toml_with

SECTION = "recording"


@dataclass(frozen=True)
class Cure:
    """Hints that a finding proposes.

    Attributes
    ----------
    words : str
        What changes: ``units = accel=g,gyro=deg/s``.
    hints : dict
        All hints with the change in them.
    """

    words: str
    hints: dict[str, Any]


def cure_of(log: Path, finding: Finding, hints: Mapping[str, Any]) -> Cure | None:
    """Cure of a finding, None where no hint mends it, or the hints have it already."""
    files = Files(log, _copied(hints))
    entry = files.entry(finding.part)
    if entry is None:
        return None
    try:
        new = proposed(finding, entry)
    except UndecidedError:
        return None
    if new is None or all(entry.get(name) == value for name, value in new.items()):
        return None
    files.put(finding.part, new)
    return Cure(", ".join(f"{name} = {value}" for name, value in new.items()), files.entries)


def completed(log: Path, answers: Mapping[str, Any]) -> tuple[dict[str, Any], list[Decision]]:
    """Answers to questions, and what the header and the physics of the log tell beside them, with the evidence.

    Raises
    ------
    UndecidedError
        If a question is open.
    InputError
        If it is no log.
    """
    return propose_reading(log, _copied(answers), _copied(answers), complete=False)


def answered(hints: Mapping[str, Any], entries: Mapping[str, Any]) -> dict[str, Any]:
    """Hints with the answer to a question, whose entries are named as in a configuration."""
    return merged(hints, nested(dict(entries)).get(SECTION, {}))


def edited(hints: Mapping[str, Any], name: str, text: str) -> dict[str, Any]:
    """Hints with one of them as typed; an empty text takes it out.

    Parameters
    ----------
    hints : mapping
    name : str
        With a dot between part and hint, where the log has parts.
    text : str

    Raises
    ------
    InputError
        If there is no such hint.
    """
    out = _copied(hints)
    part, _, key = name.rpartition(".")
    if key != "file" and key not in ReadHints.__dataclass_fields__:
        raise InputError(f"{key}: expected one of {', '.join(ReadHints.__dataclass_fields__)}")
    at = out.setdefault(part, {}) if part else out
    if text.strip():
        at[key] = _number(text.strip())
    else:
        at.pop(key, None)
    return out


def listed(hints: Mapping[str, Any]) -> list[tuple[str, Any]]:
    """Hints by name, with a dot between part and hint."""
    out: list[tuple[str, Any]] = []
    for name, value in hints.items():
        if isinstance(value, Mapping):
            out += [(f"{name}.{key}", one) for key, one in value.items()]
        else:
            out.append((name, value))
    return out


def check_command(log: str, hints: Mapping[str, Any], config: str) -> str:
    """The command that checks a log as the page does."""
    if any(isinstance(value, Mapping) for value in hints.values()):
        return shlex.join(["schuler", "check", log, "--config", config])
    options = [part for name, value in hints.items() for part in (f"--{name.replace('_', '-')}", str(value))]
    return shlex.join(["schuler", "check", log, *options])


def save(target: Path, hints: Mapping[str, Any], diagnosis: Diagnosis) -> Path:
    """Write hints as the section ``[recording]`` of a configuration; the rest of one that exists stays.

    Raises
    ------
    InputError
        If the file has it in a form that cannot be changed.
    """
    if target.exists():
        stated = read_toml(target).get(SECTION, {})
        text = target.read_text(encoding="utf-8")
        gone = [name for name, _ in listed(stated) if name not in dict(listed(hints))]
        if gone:
            raise InputError(
                f"{target.name} says {', '.join(gone)} too, which this page does not: save under another name"
            )
        return write_text(target, toml_with(text, {SECTION: dict(hints)}), at_once=True)
    head = f"# How {diagnosis.name} is read, as schuler studio was told.\n"
    return write_text(target, head + toml_of({SECTION: dict(hints)}, {}), at_once=True)


def hints_of(config: Path | None) -> dict[str, Any]:
    """Section ``[recording]`` of a configuration; empty without one."""
    return {} if config is None else dict(read_toml(config).get(SECTION, {}))


def _number(text: str) -> Any:
    try:
        return float(text) if any(c in text for c in ".eE") else int(text)
    except ValueError:
        return text


def _copied(hints: Mapping[str, Any]) -> dict[str, Any]:
    """The same, nested sections copied: what proposes hints changes them in place."""
    return {name: dict(value) if isinstance(value, Mapping) else value for name, value in hints.items()}
