"""Files of satellites' code biases: SINEX BIAS version 1, and the monthly differences of CODE (DCB).

Source: Schaer (2016), SINEX_BIAS: Solution (Software/technique) INdependent EXchange Format for GNSS Biases 1.00;
Dach et al. (2015), Bernese GNSS Software 5.2, section 24.12.
"""

from __future__ import annotations

import datetime as dt
import re
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
_CLOCKS = "SATELLITE_CLOCK_REFERENCE_OBSERVABLES"
_MONTH = re.compile(r"DCB SOLUTION,? YEAR(?: (\d{4}), MONTH (\d\d)|-MONTH:? (\d\d)-(\d\d))")
_PAIR = re.compile(r"\((\w\w)-(\w\w)\)")
_PAIRS = (("P1", "C1"), ("P1", "P2"))
#: Signals that CODE's names stand for.
_SIGNALS = {"G": {"P1": "1W", "P2": "2W", "C1": "1C"}, "R": {"P1": "1P", "P2": "2P", "C1": "1C"}}


def read_sinex_bias(path: Path | str) -> CodeBiases:
    """Biases of satellites' codes relative to their clocks.

    Parameters
    ----------
    path : Path or str
        Version 1; plain, or packed with gzip, bzip2, zip or compress.

    Returns
    -------
    CodeBiases
        Absolute ones (OSB) of codes, and differences (DSB) between codes of a satellite. Those of stations and of
        carriers are passed over, slopes too.

    Raises
    ------
    FileFormatError
        With file and line, for what is no such file, has neither absolute biases nor differences of codes, is cut,
        has malformed lines or other units, or UTC.
    """
    path = Path(path)
    lines = unpack(path, []).decode("latin-1").splitlines()
    if not lines or not lines[0].startswith("%=BIA 1."):
        raise FileFormatError(f"expected a SINEX BIAS file of version 1, got {shorten(''.join(lines[:1]))}", path, 1)
    scale = next((x.split()[-1] for x in lines if x.startswith(" TIME_SYSTEM") and x.split()[1:]), "G")
    if scale not in ("G", "GPS"):
        raise FileFormatError(f"TIME_SYSTEM: expected G, got {scale}", path)
    inside, rows, kinds, pairs = False, [], set[str](), []
    for number, line in enumerate(lines, start=1):
        if line.startswith((_BEGIN, _END)):
            inside = line.startswith(_BEGIN)
        elif inside and line.startswith(" "):
            kinds.add(line[1:5].strip())
            second = {"OSB": "", "DSB": "C"}.get(line[1:4])
            if line[25:26] == "C" and line[30:31].strip() == second and not line[15:24].strip() and line[11] in SYSTEMS:
                rows.append(_row(line, path, number))
        elif line.startswith(f" {_CLOCKS}") and len(words := line.split()) == 4 and words[2][:1] == words[3][:1] == "C":
            pairs.append((words[1], words[2][1:], words[3][1:]))
    if inside:
        raise FileFormatError(f"cut before {_END}", path, len(lines))
    if not rows:
        raise FileFormatError(
            f"expected biases (OSB) of satellites' codes or differences between them (DSB), got "
            f"{', '.join(sorted(kinds)) or 'none'}", path
        )  # fmt: skip
    return _table(rows, tuple(pairs))


def read_code_differences(path: Path | str) -> CodeBiases:
    """Differences of satellites' code biases as CODE gives them for a month: P1 less C1, or P1 less P2.

    Parameters
    ----------
    path : Path or str
        Plain, or packed with gzip, bzip2, zip or compress.

    Returns
    -------
    CodeBiases
        Of GPS (P1 is 1W, P2 2W) and GLONASS (1P, 2P), for that month. Stations are passed over.

    Raises
    ------
    FileFormatError
        With file and line, for what is no such file, another pair (P2 less C2 does not say which of L2C's codes it
        is), a solution that is not of a month, and malformed lines.
    """
    path = Path(path)
    lines = unpack(path, []).decode("latin-1").splitlines()
    title = _MONTH.search("".join(lines[:1]))
    if title is None:
        raise FileFormatError(
            "expected a monthly DCB solution of CODE (DCB SOLUTION, YEAR 2021, MONTH 04), got "
            f"{shorten(''.join(lines[:1]))}", path, 1
        )  # fmt: skip
    year, month = (int(x) for x in title.groups() if x is not None)
    year += 0 if year > 99 else 2000 if year < 80 else 1900
    if not 1 <= month <= 12:
        raise FileFormatError(f"expected a month from 01 to 12, got {shorten(lines[0])}", path, 1)
    begin, end = (gps_from_calendar(dt.datetime(year + m // 12, m % 12 + 1, 1)) for m in (month - 1, month))
    pair, rows = None, []
    for number, line in enumerate(lines, start=1):
        if line.startswith("DIFFERENTIAL"):
            match = _PAIR.search(line)
            pair = match.groups() if match else None
            if pair not in _PAIRS:
                raise FileFormatError(f"expected differences P1-C1 or P1-P2, got {shorten(line)}", path, number)
        elif pair is not None and re.match(r"[A-Z]\d\d ", line) and not line[3:26].strip():
            names = _SIGNALS.get(line[0])
            try:
                sat, bias = satellite(line[:3]), 1e-9 * float(line[26:35])
            except ValueError:
                names = None
            if names is None or not abs(bias) < _LARGEST:
                message = f"expected a satellite of GPS or GLONASS and a difference in ns, got {shorten(line)}"
                raise FileFormatError(message, path, number)
            rows.append((sat, names[pair[0]], begin, end, bias, names[pair[1]]))
    if not rows:
        raise FileFormatError("expected differences P1-C1 or P1-P2 of satellites, got none", path)
    return _table(rows, ())


def _table(
    rows: list[tuple[int, str, float, float, float, str]], pairs: tuple[tuple[str, str, str], ...]
) -> CodeBiases:
    sat, signal, begin, end, bias, against = zip(*rows, strict=True)
    return CodeBiases(np.array(sat), signal, np.array(begin), np.array(end), np.array(bias), against, pairs)


def _row(line: str, path: Path, number: int) -> tuple[int, str, float, float, float, str]:
    try:
        times = [_time(line[35:49], 0), _time(line[50:64], 1)]
        bias = 1e-9 * float(line[70:91])
        sat = satellite(line[11:14])
    except (ValueError, OverflowError):
        message = f"expected a satellite, two times and a bias, got {shorten(line)}"
        raise FileFormatError(message, path, number) from None
    if line[65:69].strip() != "ns" or not abs(bias) < _LARGEST:
        raise FileFormatError(f"expected a bias of a code in ns, below 1000, got {shorten(line)}", path, number)
    if line[26:28] == line[31:33]:
        raise FileFormatError(f"expected a difference of two codes, got {shorten(line)}", path, number)
    return sat, line[26:28], times[0], times[1], bias, line[31:33].strip()


def _time(text: str, which: int) -> float:
    """GPS seconds of ``YYYY:DOY:SSSSS``; zeros leave the time open."""
    year, day, second = (int(x) for x in text.split(":"))
    if year == 0:
        return _ALWAYS[which]
    return gps_from_calendar(dt.datetime(year, 1, 1)) + 86_400.0 * (day - 1) + second
