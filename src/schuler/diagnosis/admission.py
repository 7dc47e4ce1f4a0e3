"""Admission of a log to use: quick checks that stop commands, and ``schuler.check``."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

from schuler.arguments import explains_arguments
from schuler.diagnosis.log import diagnose_log
from schuler.diagnosis.result import Diagnosis
from schuler.diagnosis.run import diagnose
from schuler.recording.recording import Recording

#: How the notes begin by which a result says what was checked.
CHECKED, PASSED_OVER = "Checked before use", "Passed over (--unchecked)"


@explains_arguments
def check(log: Recording | Path | str, *, quick: bool = False, **more: Any) -> Diagnosis:
    """Find what is wrong with a recording or a log, by physics.

    Parameters
    ----------
    log : Recording, Path or str
        A recording as read, or a file or folder, which is then read leniently.
    quick : bool
        Only what can make results garbage, as :func:`schuler.diagnosis.diagnose` says.
    **more
        Hints for a file or folder, see :func:`schuler.read`.

    Returns
    -------
    Diagnosis
        ``schuler.check(recording).require()`` raises :class:`schuler.exceptions.InputError` if an error is sure.

    Raises
    ------
    InputError
        If there is no such file, or a hint is unknown.

    Examples
    --------
    >>> recording = schuler.read("drive.parquet")  # doctest: +SKIP
    >>> schuler.check(recording).require()  # doctest: +SKIP
    >>> result = schuler.navigate(recording, config)  # doctest: +SKIP
    """
    if isinstance(log, Recording):
        return diagnose(log, quick=quick)
    return diagnose_log(log, quick=quick, **more)


def checked(recording: Recording, *, unchecked: bool = False, clock_shift_s: float = 0.0) -> Recording:
    """The recording with a note on the quick checks it passed.

    Parameters
    ----------
    recording : Recording
        As read.
    unchecked : bool
        Do not stop; the note says what was passed over.
    clock_shift_s : float
        What will be added to the IMU's stamps before use. [s]

    Returns
    -------
    Recording
        The same series. Its notes go into the results made of it.

    Raises
    ------
    InputError
        If there is an error, which is all but certain: with its sentence and the option that mends it. What is merely
        likely stands in the note.
    """
    return diagnosed(recording, unchecked=unchecked, clock_shift_s=clock_shift_s)[0]


def diagnosed(
    recording: Recording, *, unchecked: bool = False, clock_shift_s: float = 0.0
) -> tuple[Recording, Diagnosis | None]:
    """The same as :func:`checked`, and what was found; None of a recording without an IMU.

    Parameters
    ----------
    recording, unchecked, clock_shift_s
        See :func:`checked`.
    """
    if recording.imu is None:
        return recording, None
    shifted = recording
    if clock_shift_s:
        shifted = replace(recording, imu=recording.imu.shifted(clock_shift_s))
    diagnosis = diagnose(shifted, quick=True)
    if not unchecked:
        diagnosis.require(advice="See schuler check; to go on nevertheless say --unchecked")
    problems = diagnosis.describe(diagnosis.sure_errors())
    if problems:
        note = f"{PASSED_OVER}: {problems}."
    else:
        note = f"{CHECKED}: {', '.join(diagnosis.checked) or 'nothing'}; no error was found."
        if likely := tuple(f for f in diagnosis.warnings if f.grave):
            note += f" Not sure, but likely enough to look at (schuler check): {diagnosis.describe(likely)}."
    return replace(recording, metadata=recording.metadata.noting(note)), diagnosis


def notes_of(recording: Recording) -> tuple[str, ...]:
    """Notes of a recording on checks before its use.

    Parameters
    ----------
    recording : Recording
    """
    return tuple(note for note in recording.metadata.notes if note.startswith((CHECKED, PASSED_OVER)))
