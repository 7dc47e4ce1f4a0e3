"""Text that Xsens' MT Manager exports: a header of ``//`` lines, then columns named in one line, separated by tabs."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

from schuler.exceptions import FileFormatError, InputError
from schuler.recording.formats import parts
from schuler.recording.formats.parts import Table
from schuler.recording.formats.receiver_tables import unwrapped
from schuler.recording.io import lines
from schuler.recording.io.hints import ReadHints
from schuler.recording.io.lines import TextTable
from schuler.recording.recording import Recording
from schuler.timebase import TimeBase

_RATE = re.compile(r"//\s*(?:Update|Sample)\s*rate\s*:\s*([0-9.]+)\s*Hz", re.IGNORECASE)
_ACCEL, _GYRO = ("Acc_X", "Acc_Y", "Acc_Z"), ("Gyr_X", "Gyr_Y", "Gyr_Z")
_TICK = 1e-4  # of SampleTimeFine [s]


def looks_like(head: bytes) -> bool:
    """Whether a file starts as MT Manager's exports do, and names columns of an IMU."""
    return (head.startswith((b"//", b"PacketCounter"))) and b"PacketCounter" in head and b"Acc_X" in head


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
        for number, text in enumerate(stream, 1):
            if (match := _RATE.match(text)) and rate is None:
                rate = float(match.group(1)) if float(match.group(1) or 0) > 0 else None
            if text.startswith("PacketCounter"):
                names = [name.strip() for name in text.rstrip("\r\n").split("\t")]
                break
            if number > 200:
                break
        first = stream.readline().rstrip("\r\n").split("\t")
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
    table = TextTable(path, number + 1, "\t", "//", "latin-1")
    values, truncated = lines.load(table, len(names), wanted, allow_truncated=hints.allows("truncated"))
    notes = [f"{path.name}: the last line was cut off and left out."] if truncated else []
    if clock == "SampleTimeFine":
        t = unwrapped(values[:, 0], 2.0**32) * _TICK
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
