"""RINEX clock files: clocks of satellites every 30 s or so, versions 2 and 3.

Source: Ray and Gurtner (2010), RINEX extensions to handle clock information, version 3.02; 3.04 (2017).
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from schuler.exceptions import FileFormatError, InputError
from schuler.gnss.precise import PreciseClocks
from schuler.gnss.signals import SYSTEMS, satellite
from schuler.recording.formats.rinex_unpack import unpack
from schuler.recording.formats.sp3 import SCALES, gps_times
from schuler.recording.io.lines import shorten

_END, _FIRST, _SCALE = "END OF HEADER", "RINEX VERSION / TYPE", "TIME SYSTEM ID"
_LARGEST = 0.1  # a satellite's clock is never further off [s]


def read_rinex_clock(path: Path | str) -> PreciseClocks:
    """Satellite clocks of a RINEX clock file; those of receivers are passed over.

    Parameters
    ----------
    path : Path or str
        Version 2 or 3; plain, or packed with gzip, bzip2, zip or compress.

    Returns
    -------
    PreciseClocks
        On GPS time.

    Raises
    ------
    FileFormatError
        With file and line, for what is no clock file, malformed lines, clocks that are not in seconds, unknown time
        systems, and files without satellites.
    """
    path = Path(path)
    notes: list[str] = []
    text = unpack(path, notes).decode("latin-1")
    lines = text.splitlines()
    if _FIRST not in lines[0] or not _is_clock(lines[0]):
        raise FileFormatError(f"expected a RINEX clock file (type C), got {shorten(lines[0])}", path, 1)
    end = next((k for k, line in enumerate(lines) if _END in line), None)
    if end is None:
        raise FileFormatError(f"the header has no {_END!r}: the file is cut", path)
    scale = next((line.split()[0] for line in lines[:end] if _SCALE in line), "GPS")
    if scale not in SCALES:
        raise FileFormatError(f"time system: expected one of {', '.join(SCALES)}, got {scale!r}", path)
    if text[-1:] not in "\r\n":
        notes.append(f"{path.name} ends within a line, which was left out")
        lines.pop()
    dates: list[tuple[float, ...]] = []
    rows: list[tuple[int, float]] = []
    for number, line in enumerate(lines[end + 1 :], start=end + 2):
        if not line.startswith("AS "):
            continue
        entries = line.replace("D", "E").split()
        if entries[1][:1] not in SYSTEMS:
            continue
        try:
            sat, date, bias = satellite(entries[1]), tuple(float(v) for v in entries[2:8]), float(entries[9])
        except (InputError, ValueError, IndexError):
            raise FileFormatError(
                f"expected AS, satellite, date, count, clock, got {shorten(line)}", path, number
            ) from None
        if not abs(bias) < _LARGEST:
            raise FileFormatError(f"expected a clock in seconds, got {shorten(line)}", path, number)
        dates.append(date)
        rows.append((sat, bias))
    if not rows:
        raise FileFormatError("no satellite has a clock in it", path)
    epochs, k = np.unique(np.array(dates), axis=0, return_inverse=True)
    table = np.array(rows)
    sats, s = np.unique(table[:, 0].astype(np.int64), return_inverse=True)
    clock = np.full((len(epochs), len(sats)), np.nan)
    clock[k.ravel(), s] = table[:, 1]
    return PreciseClocks(gps_times(epochs, scale, path), sats, clock, tuple(notes))


def looks_like_rinex_clock(first: bytes) -> bool:
    """Whether the first line of a file is that of RINEX clocks."""
    line = first.decode("latin-1")
    return _FIRST in line and _is_clock(line)


def _is_clock(line: str) -> bool:
    """The letter of the kind stands in column 21, from version 3.04 on in column 22."""
    return line[20:22].strip()[:1] == "C"
