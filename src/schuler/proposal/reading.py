"""Logs read as a proposal has it so far, and with an answer to a question put in."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from schuler.exceptions import InputError
from schuler.proposal import setup
from schuler.proposal.files import Files
from schuler.recording.io import dispatch, packed, plain_text
from schuler.recording.recording import Recording
from schuler.toml import merged

_HEAD = 2000  # characters of a file in which its IMU may be named
_PARTS = ("gnss", "reference", "observations", "odometer")


def read_files(files: Files) -> Recording:
    """Recording of a log with its hints so far.

    Parameters
    ----------
    files : Files

    Raises
    ------
    InputError
        If there is no IMU in it.
    """
    recording = dispatch.read(files.log, **files.entries)
    if recording.imu is None:
        held = ", ".join(name for name in _PARTS if getattr(recording, name) is not None)
        raise InputError(f"{files.log}: expected a log of an IMU, got {held}")
    return recording


def read_with(files: Files, answer: Mapping[str, Any]) -> Recording:
    """The same with other entries.

    Parameters
    ----------
    files : Files
    answer : mapping
        Values by name with dots, ``recording.imu.axes``.
    """
    more = setup.nested(dict(answer)).get("recording", {})
    return dispatch.read(files.log, **merged(files.entries, more))


def takes(files: Files, answer: Mapping[str, Any]) -> bool:
    """Whether the log is read with an answer: a format that says this itself refuses it.

    Parameters
    ----------
    files, answer
        See :func:`read_with`.
    """
    try:
        read_with(files, answer)
    except InputError as error:
        return "leave out" not in str(error)
    return True


def heads(files: Files) -> list[str]:
    """First characters of the files that the IMU is read from.

    Parameters
    ----------
    files : Files
    """
    entry = files.entries.get("imu") if files.by_part else None
    if isinstance(entry, dict) and "file" in entry:
        paths = [packed.resolved(files.log / str(entry["file"]))]
    elif files.log.is_file():
        paths = [files.log]
    else:
        paths = sorted(p for p in files.log.iterdir() if p.is_file() and p.suffix.lower() in (".csv", ".txt", ".yaml"))
    return [plain_text.head_of(path, _HEAD).decode("latin-1") for path in paths]
