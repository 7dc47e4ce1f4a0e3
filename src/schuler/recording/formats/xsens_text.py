"""Text that Xsens' MT Manager exports: lines of a header, then columns named in one line, by tabs or commas."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np

from schuler import units
from schuler.exceptions import FileFormatError, InputError
from schuler.recording.formats import parts
from schuler.recording.formats.parts import Table
from schuler.recording.formats.receiver_tables import unwrapped
from schuler.recording.io import lines
from schuler.recording.io.hints import ReadHints
from schuler.recording.io.lines import TextTable
from schuler.recording.recording import Recording
from schuler.timebase import TimeBase

_NAMES = re.compile(rb"^(?:\xef\xbb\xbf)?PacketCounter[\t,;].*\bAcc_X\b", re.MULTILINE)
_RATE = re.compile(r"//\s*(?:Update|Sample)\s*rate\s*:\s*([0-9.]+)\s*Hz", re.IGNORECASE)
_ACCEL, _GYRO = ("Acc_X", "Acc_Y", "Acc_Z"), ("Gyr_X", "Gyr_Y", "Gyr_Z")
_TICK, _TICK_DOT = 1e-4, 1e-6  # of SampleTimeFine; of a Movella DOT [s]
_SLOWEST = 2000.0  # ticks: no MT Manager logs at less than 5 Hz, no DOT at more than 500


def looks_like(head: bytes) -> bool:
    """Whether one of the first lines names columns as MT Manager's exports do, of an IMU."""
    return _NAMES.search(head[:8000]) is not None


def read_text_export(path: Path, hints: ReadHints) -> Recording:
    """IMU of an export of MT Manager.

    Parameters
    ----------
    path : Path
    hints : ReadHints
        ``rate`` where the header has none and SampleTimeFine is not exported; ``axes``, default "FLU".

    Returns
    -------
    Recording
        On the sensor's clock: SampleTimeFine, or the packet counter at the rate of the header.

    Raises
    ------
    FileFormatError, InputError
        If columns are missing or there is no time.
    """
    lines.check_file(path)
    rate = hints.rate
    with path.open(encoding="utf-8", errors="replace") as stream:
        names: list[str] = []
        delimiter = "\t"
        for number, text in enumerate(stream, 1):
            if (match := _RATE.match(text)) and rate is None:
                rate = float(match.group(1)) if float(match.group(1) or 0) > 0 else None
            if text.removeprefix("\ufeff").startswith("PacketCounter"):
                delimiter = max("\t,;", key=text.count)
                names = [name.strip() for name in text.removeprefix("\ufeff").rstrip("\r\n").split(delimiter)]
                break
            if number > 200:
                break
        first = stream.readline().rstrip("\r\n").split(delimiter)
    missing = [name for name in (*_ACCEL, *_GYRO) if name not in names]
    if missing:
        raise FileFormatError(
            f"the export has no {', '.join(missing)}: export inertial data (calibrated Acc and Gyr) with MT Manager",
            path,
        )
    if len(first) < len(names):
        raise FileFormatError(
            f"the line of names has {len(names)} columns, the first of numbers {len(first)}: which is which cannot be "
            "told; export again",
            path,
            number + 1,
        )
    timed = "SampleTimeFine" in names and first[names.index("SampleTimeFine")].strip() != ""
    clock = "SampleTimeFine" if timed else "PacketCounter"
    wanted = [names.index(name) for name in (clock, *_ACCEL, *_GYRO)]
    table = TextTable(path, number + 1, delimiter, "//", "latin-1")
    values, truncated = lines.load(table, len(names), wanted, allow_truncated=hints.allows("truncated"))
    notes = [f"{path.name}: the last line was cut off and left out."] if truncated else []
    if clock == "SampleTimeFine":
        ticks = unwrapped(values[:, 0], 2.0**32)
        if len(ticks) > 1 and float(np.median(np.diff(ticks))) > _SLOWEST:
            t = ticks * _TICK_DOT
            values[:, 4:] *= units.DEG
            notes.append("Stamps in microseconds show a Movella DOT, whose rates are in deg/s.")
        else:
            t = ticks * _TICK
            notes.append("Stamps are SampleTimeFine, the sensor's own clock in units of 0.1 ms.")
    elif rate is None:
        raise InputError(f"{path}: SampleTimeFine is not exported and the header has no rate: say rate=.. [Hz]")
    else:
        count = unwrapped(values[:, 0], 65536.0)
        t = (count - count[0]) / rate
        notes.append(f"Stamps are the packet counter at {rate:g} Hz.")
    keep = parts.later(t, "export", path, notes)
    columns = {"t": t[keep]}
    for names_of, letter, shift in ((_ACCEL, "a", 1), (_GYRO, "g", 4)):
        columns |= {f"{letter}{axis}": values[keep, shift + k] for k, axis in enumerate("xyz"[: len(names_of)])}
    made = parts.assemble(
        path, {"imu": Table(columns, axes="FLU")}, replace(hints, rate=None, time=None), TimeBase("local"), notes
    )
    return replace(made, metadata=replace(made.metadata, options=hints.given()))
