"""Part of a recording by seconds from its beginning."""

from __future__ import annotations

from dataclasses import replace

from schuler.exceptions import InputError
from schuler.recording.recording import Recording


def cut(recording: Recording, start: float | None, stop: float | None) -> Recording:
    """The recording between two times from the start of its IMU, or of what there is without one.

    Parameters
    ----------
    recording : Recording
    start, stop : float, optional
        Default: its beginning, its end. [s]

    Returns
    -------
    Recording
        With a note that says so; itself where nothing is cut.

    Raises
    ------
    InputError
        If the times do not increase from zero, or nothing lies between them.
    """
    if start is None and stop is None:
        return recording
    if recording.imu is not None:
        begin, end = float(recording.imu.t[0]), float(recording.imu.t[-1])
    else:
        begin, end = recording.start, recording.stop
    first, last = 0.0 if start is None else start, end - begin if stop is None else stop
    if not 0.0 <= first < last:
        raise InputError(
            f"part of {recording.metadata.name}: expected 0 <= FROM < TO in seconds, got {first:g} and {last:g}"
        )
    note = f"Only {first:g} to {last:g} s of {recording.metadata.name} were used, as asked for."
    return replace(recording.between(begin + first, begin + last), metadata=recording.metadata.noting(note))
