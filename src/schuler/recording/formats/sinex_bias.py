"""SINEX BIAS files: biases of satellites' codes, version 1.

Source: Schaer (2016), SINEX_BIAS: Solution (Software/technique) INdependent EXchange Format for GNSS Biases 1.00.
"""

from __future__ import annotations

import datetime as dt
from pathlib import Path

import numpy as np

from schuler.exceptions import FileFormatError
from schuler.gnss.code_biases import CodeBiases
from schuler.gnss.signals import SYSTEMS, satellite
from schuler.recording.formats.rinex_unpack import unpack
from schuler.recording.io.lines import shorten
from schuler.timebase import gps_from_calendar

_BEGIN, _END = "+BIAS/SOLUTION", "-BIAS/SOLUTION"
_LARGEST = 1e-6  # bias that there may be [s]
_ALWAYS = (0.0, 1e11)  # times that are left open [s]


def read_sinex_bias(path: Path | str) -> CodeBiases:
    """Biases of satellites' codes relative to their clocks.

    Parameters
    ----------
    path : Path or str
        Version 1; plain, or packed with gzip, bzip2, zip or compress.

    Returns
    -------
    CodeBiases
        Absolute ones (OSB) of codes. Those of stations and of carriers are passed over, slopes too.

    Raises
    ------
    FileFormatError
        With file and line, for what is no such file, has no absolute biases of codes (a file of differences, DSB, does
        not say what they are relative to), is cut, has malformed lines or other units, or UTC.
    """
    path = Path(path)
    lines = unpack(path, []).decode("latin-1").splitlines()
    if not lines or not lines[0].startswith("%=BIA 1."):
        raise FileFormatError(f"expected a SINEX BIAS file of version 1, got {shorten(''.join(lines[:1]))}", path, 1)
    scale = next((x.split()[-1] for x in lines if x.startswith(" TIME_SYSTEM") and x.split()[1:]), "G")
    if scale not in ("G", "GPS"):
        raise FileFormatError(f"TIME_SYSTEM: expected G, got {scale}", path)
    inside, rows, kinds = False, [], set[str]()
    for number, line in enumerate(lines, start=1):
        if line.startswith((_BEGIN, _END)):
            inside = line.startswith(_BEGIN)
        elif inside and line.startswith(" "):
            kinds.add(line[1:5].strip())
            if line[1:4] == "OSB" and line[25:26] == "C" and not line[15:24].strip() and line[11:12] in SYSTEMS:
                rows.append(_row(line, path, number))
    if inside:
        raise FileFormatError(f"cut before {_END}", path, len(lines))
    if not rows:
        raise FileFormatError(
            f"expected absolute biases (OSB) of satellites' codes, got {', '.join(sorted(kinds)) or 'none'}", path
        )
    sat, signal, begin, end, bias = zip(*rows, strict=True)
    return CodeBiases(np.array(sat), tuple(signal), np.array(begin), np.array(end), np.array(bias))


def _row(line: str, path: Path, number: int) -> tuple[int, str, float, float, float]:
    try:
        times = [_time(line[35:49], 0), _time(line[50:64], 1)]
        bias = 1e-9 * float(line[70:91])
        sat = satellite(line[11:14])
    except (ValueError, OverflowError):
        message = f"expected a satellite, two times and a bias, got {shorten(line)}"
        raise FileFormatError(message, path, number) from None
    if line[65:69].strip() != "ns" or not abs(bias) < _LARGEST:
        raise FileFormatError(f"expected a bias of a code in ns, below 1000, got {shorten(line)}", path, number)
    return sat, line[26:28], times[0], times[1], bias


def _time(text: str, which: int) -> float:
    """GPS seconds of ``YYYY:DOY:SSSSS``; zeros leave the time open."""
    year, day, second = (int(x) for x in text.split(":"))
    if year == 0:
        return _ALWAYS[which]
    return gps_from_calendar(dt.datetime(year, 1, 1)) + 86_400.0 * (day - 1) + second
