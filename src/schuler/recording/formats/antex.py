"""ANTEX files: phase centres of antennas of receivers and satellites.

Source: Rothacher and Schmid (2010), ANTEX: The Antenna Exchange Format, version 1.4.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from schuler.arrays import FloatArray
from schuler.exceptions import FileFormatError, InputError
from schuler.gnss.antennas import Antenna
from schuler.gnss.signals import SYSTEMS, satellite
from schuler.recording.formats.rinex_columns import whole_seconds
from schuler.recording.formats.rinex_unpack import unpack
from schuler.recording.io.lines import shorten
from schuler.units import DEG

_MM = 1e-3
_FARTHEST = 10.0  # phase centre from reference point or centre of mass [m]


def read_antex(path: Path | str) -> tuple[Antenna, ...]:
    """Antennas of an ANTEX file, in its order.

    Parameters
    ----------
    path : Path or str
        Version 1.3 or 1.4; plain or packed.

    Returns
    -------
    tuple of Antenna
        Of satellites of systems that are unknown here none.

    Raises
    ------
    FileFormatError
        With file and line, for what is no ANTEX file, is cut within an antenna, or has malformed or impossible values
        (units other than millimetres).
    """
    path = Path(path)
    lines = unpack(path, []).decode("latin-1").splitlines()
    if not lines[0][60:].startswith("ANTEX VERSION"):
        raise FileFormatError(f"expected an ANTEX file, got {shorten(lines[0])}", path, 1)
    antennas: list[Antenna] = []
    begin: int | None = None
    for k, line in enumerate(lines):
        label = line[60:].strip()
        if label == "START OF ANTENNA":
            begin = k
        elif label == "END OF ANTENNA" and begin is not None:
            if (antenna := _antenna(lines, begin, k, path)) is not None:
                antennas.append(antenna)
            begin = None
    if begin is not None:
        raise FileFormatError("the file is cut within this antenna", path, begin + 1)
    if not antennas:
        raise FileFormatError("no antenna is in it", path)
    return tuple(antennas)


def _antenna(lines: list[str], begin: int, end: int, path: Path) -> Antenna | None:
    name, serial, valid = "", "", {"VALID FROM": -np.inf, "VALID UNTIL": np.inf}
    step = 0.0
    zenith = np.zeros(0)
    offset: dict[str, FloatArray] = {}
    variation: dict[str, FloatArray] = {}
    k = begin + 1
    while k < end:
        line, label = lines[k], lines[k][60:].strip()
        if label == "TYPE / SERIAL NO":
            name, serial = line[:20].rstrip(), line[20:40].strip()
        elif label == "DAZI":
            step = _numbers(line[:60], 1, path, k)[0]
        elif label == "ZEN1 / ZEN2 / DZEN":
            first, last, width = _numbers(line[:60], 3, path, k)
            if not (width > 0.0 and last > first):
                raise FileFormatError(f"expected angles from the zenith that grow, got {shorten(line)}", path, k + 1)
            zenith = DEG * np.linspace(first, last, round((last - first) / width) + 1)
        elif label in valid:
            whole, part, wrong = whole_seconds(np.array([_numbers(line[:60], 6, path, k)]))
            if wrong.any():
                raise FileFormatError(f"impossible date {shorten(line)}", path, k + 1)
            valid[label] = float(whole[0] + part[0])
        elif label == "START OF FREQUENCY":
            stop = next((i for i in range(k, end) if lines[i][60:].strip() == "END OF FREQUENCY"), end)
            code = line[3:6].replace(" ", "0")
            offset[code], variation[code] = _pattern(lines, k + 1, stop, len(zenith), step, path)
            k = stop
        elif label == "START OF FREQ RMS":
            k = next((i for i in range(k, end) if lines[i][60:].strip() == "END OF FREQ RMS"), end)
        k += 1
    sat = 0
    if serial[:1].isalpha() and len(serial) == 3 and serial[1:].isdecimal():
        if serial[0] not in SYSTEMS:
            return None
        try:
            sat = satellite(serial)
        except InputError as error:
            raise FileFormatError(str(error), path, begin + 2) from None
    azimuth = DEG * step * np.arange(round(360.0 / step) + 1 if step > 0.0 else 0, dtype=np.float64)
    return Antenna(name, sat, valid["VALID FROM"], valid["VALID UNTIL"], offset, zenith, azimuth, variation)


def _pattern(
    lines: list[str], begin: int, end: int, angles: int, step: float, path: Path
) -> tuple[FloatArray, FloatArray]:
    """Offset (3,) and variations (z,) or (a, z) of one frequency. [m]"""
    offset: FloatArray | None = None
    mean: FloatArray | None = None
    rows: list[FloatArray] = []
    for k in range(begin, end):
        line = lines[k]
        if line[60:].strip() == "NORTH / EAST / UP":
            offset = _MM * _numbers(line[:60], 3, path, k)
        elif line[3:8] == "NOAZI":
            mean = _MM * _numbers(line[8:], angles, path, k)
        else:
            rows.append(_MM * _numbers(line[8:], angles, path, k))
    if offset is None or mean is None or not np.linalg.norm(offset) < _FARTHEST:
        raise FileFormatError(
            "expected the offset and variations of a frequency in millimetres, which begin here", path, begin
        )
    if step > 0.0 and len(rows) != round(360.0 / step) + 1:
        raise FileFormatError(f"expected variations every {step:g} degrees of azimuth, got {len(rows)}", path, begin)
    return offset, np.stack(rows) if step > 0.0 else mean


def _numbers(text: str, count: int, path: Path, line: int) -> FloatArray:
    try:
        values = np.array([float(v) for v in text.split()])
    except ValueError:
        values = np.zeros(0)
    if len(values) != count or not np.isfinite(values).all():
        raise FileFormatError(f"expected {count} numbers, got {shorten(text.strip())}", path, line + 1)
    return values
