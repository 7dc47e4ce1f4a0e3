"""What methods of ``schuler calibrate`` read besides logs: rests, sections, lists of numbers."""

from __future__ import annotations

import csv
import re
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from schuler.cli.options import Sensor, Site
from schuler.cli.output import progress
from schuler.exceptions import InputError
from schuler.recording.io.hint_texts import COUNTS_NOTE
from schuler.recording.recording import Recording
from schuler.recording.series import ImuSeries

if TYPE_CHECKING:
    from schuler.calibration.bench.counts import Triad
    from schuler.calibration.bench.poses import Poses

_TRIADS: tuple[Triad, ...] = ("accel", "gyro")


def poses_in(
    recordings: Sequence[Recording], sensor: Sensor, site: Site, min_rest: float, intervals: Path | None
) -> Poses:
    """Rests of all logs, one after the other."""
    from schuler.calibration.bench.poses import joined, poses_of

    poses = []
    with progress("looking for rests") as bar:
        for i, recording in enumerate(recordings):
            imu = recording.need_imu()
            spans = None if intervals is None else spans_of(intervals, imu)
            poses.append(poses_of(imu, spans, min_s=min_rest, noise=sensor.noise, gravity=site.g))
            if bar is not None:
                bar((i + 1) / len(recordings))
    return joined(poses)


def spans_of(path: Path, imu: ImuSeries) -> list[tuple[float, float]]:
    """Rests of a CSV file with lines START,STOP in seconds from the start of the log, in the time of the log."""
    return [(start, stop) for _, start, stop in _table(path, imu, named=False)]


def counted(recording: Recording) -> tuple[Triad, ...]:
    """Which triads of a log are in converter counts, as was said on reading it."""
    notes = recording.metadata.notes
    sentences = [n.partition(f": {COUNTS_NOTE}")[0].rpartition(": ")[2] for n in notes if COUNTS_NOTE in n]
    return tuple(name for name in _TRIADS if any(re.search(rf"\b{name}\b", words) for words in sentences))


def sections_of(path: Path, imu: ImuSeries) -> dict[str, tuple[float, float]]:
    """Named sections of a CSV file with lines NAME,START,STOP, likewise."""
    return {name: (start, stop) for name, start, stop in _table(path, imu, named=True)}


def _table(path: Path, imu: ImuSeries, named: bool) -> list[tuple[str, float, float]]:
    """Lines of (NAME,)START,STOP in seconds from the start of the log, in the time of the log."""
    shape = "NAME,START,STOP" if named else "START,STOP"
    try:
        lines = list(csv.reader(path.read_text(encoding="utf-8").splitlines()))
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(f"{path}: expected a CSV file with lines {shape}: {error}") from None
    rows = []
    for number, line in enumerate(lines, 1):
        if not line or line[0].startswith("#"):
            continue
        try:
            name = line[0].strip() if named else ""
            start, stop = (float(cell) for cell in line[int(named) :])
        except ValueError:
            if number == 1:
                continue  # a header
            raise InputError(f"{path}, line {number}: expected {shape} in seconds, got {','.join(line)!r}") from None
        if not 0.0 <= start < stop:
            raise InputError(f"{path}, line {number}: expected 0 <= START < STOP in seconds, got {start:g}, {stop:g}")
        rows.append((name, start + float(imu.t[0]), stop + float(imu.t[0])))
    if not rows:
        raise InputError(f"{path}: expected lines {shape}, got none")
    return rows


def numbers_of(option: str, text: str) -> list[float]:
    """Numbers with commas between them."""
    try:
        return [float(part) for part in text.split(",")]
    except ValueError:
        raise InputError(f"{option}: expected numbers with commas between them, got {text!r}") from None
