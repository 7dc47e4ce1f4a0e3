"""What navigation and calibration ask before they begin: is this log garbage?"""

from __future__ import annotations

from dataclasses import replace

from schuler.diagnosis.diagnose import diagnose
from schuler.exceptions import InputError
from schuler.recording.recording import Recording

#: Errors that are less sure than this stop nothing.
SURE = 0.8


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
        If an error is found with a confidence of 0.8 or more: with the sentence and the option that mends it.
    """
    if recording.imu is None:
        return recording
    looked_at = recording
    if clock_shift_s:
        looked_at = replace(recording, imu=recording.imu.shifted(clock_shift_s))
    found = diagnose(looked_at, quick=True)
    errors = [f for f in found.errors if f.confidence >= SURE]
    if not errors:
        note = f"Checked before use: {', '.join(found.checked) or 'nothing'}; no error was found."
        return replace(recording, metadata=recording.metadata.noting(note))
    said = "; ".join(f"{f.code}: {f.text}" + (f" -> {f.fix}" if f.fix else "") for f in errors)
    if not unchecked:
        raise InputError(
            f"{recording.metadata.name} is not what it is said to be. {said}. See schuler check; to go on nevertheless "
            "say --unchecked"
        )
    return replace(recording, metadata=recording.metadata.noting(f"Passed over (--unchecked): {said}."))
