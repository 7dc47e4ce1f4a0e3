"""SP3 files: precise satellite orbits and clocks, versions a to d.

Source: Hilla (2016), The Extended Standard Product 3 Orbit Format (SP3-d), IGS.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from schuler.arrays import FloatArray
from schuler.exceptions import FileFormatError, InputError
from schuler.gnss.precise import PreciseOrbits
from schuler.gnss.signals import SYSTEMS, satellite
from schuler.recording.formats.rinex_columns import BDT_TO_GPS_S, leap_seconds_at, whole_seconds
from schuler.recording.formats.rinex_unpack import unpack
from schuler.recording.io.lines import shorten

_KM, _MICROSECOND, _MM = 1e3, 1e-6, 1e-3
_NO_CLOCK = 999_999.0  # and what is larger [us]
_LOWEST, _HIGHEST = 6.4e6, 1e8  # distance of satellites from the Earth's centre [m]
_SLOWEST_CLOCK = 0.1  # a satellite's clock is never further off [s]
_TAI_TO_GPS_S = -19.0
#: Time systems of the files, and what makes GPS time of them; None: leap seconds of the day. [s]
SCALES = {"GPS": 0.0, "GAL": 0.0, "QZS": 0.0, "QZSS": 0.0, "BDT": BDT_TO_GPS_S, "BDS": BDT_TO_GPS_S,
          "TAI": _TAI_TO_GPS_S, "UTC": None, "GLO": None}  # fmt: skip


def read_sp3(path: Path | str) -> PreciseOrbits:
    """Precise orbits and clocks of an SP3 file.

    Parameters
    ----------
    path : Path or str
        Version a, b, c or d; plain, or packed with gzip, bzip2, zip or compress.

    Returns
    -------
    PreciseOrbits
        On GPS time. Positions of zero and clocks of 999999 are NaN; velocities, events and correlations are passed
        over. Notes say of files that end early.

    Raises
    ------
    FileFormatError
        With file and line, for what is no SP3 file, malformed lines, positions that are not in kilometres, clocks that
        are not in microseconds, epochs out of order, and unknown time systems.
    """
    path = Path(path)
    notes: list[str] = []
    text = unpack(path, notes).decode("latin-1")
    lines = text.splitlines()
    if len(lines[0]) < 32 or lines[0][0] != "#" or lines[0][1] not in "abcd" or lines[0][2] not in "PV":
        raise FileFormatError(f"expected an SP3 file, which begins with #a to #d, got {shorten(lines[0])}", path, 1)
    scale = next((line[9:12].strip() for line in lines if line.startswith("%c")), "GPS")
    scale = "GPS" if scale in ("", "ccc") else scale  # version a has none
    if scale not in SCALES:
        raise FileFormatError(f"time system: expected one of {', '.join(SCALES)}, got {scale!r}", path)
    if text[-1:] not in "\r\n" and not lines[-1].startswith("EOF"):
        lines.pop()  # cut within it
    dates: list[list[float]] = []
    rows: list[tuple[int, int, float, float, float, float]] = []
    other: set[str] = set()
    for number, line in enumerate(lines, start=1):
        if line.startswith("*"):
            dates.append([_number(v, path, number) for v in line[1:].split()])
            if len(dates[-1]) != 6:
                raise FileFormatError(f"expected a date and time, got {shorten(line)}", path, number)
        elif line.startswith("P"):
            if not dates:
                raise FileFormatError("expected an epoch (*) before the first position", path, number)
            sat = _satellite(line[1:4], path, number)
            if sat is None:
                other.add(line[1:2])
                continue
            x, y, z, bias = (_number(line[4 + 14 * k : 18 + 14 * k], path, number) for k in range(4))
            if (x, y, z) == (0.0, 0.0, 0.0):
                x = y = z = np.nan
            elif not _LOWEST < _KM * float(np.linalg.norm((x, y, z))) < _HIGHEST:
                raise FileFormatError(
                    f"expected the position of a satellite in kilometres, got {shorten(line)}", path, number
                )
            bias = np.nan if abs(bias) >= _NO_CLOCK else bias
            if abs(bias) * _MICROSECOND > _SLOWEST_CLOCK:
                raise FileFormatError(f"expected a clock in microseconds, got {shorten(line)}", path, number)
            rows.append((len(dates) - 1, sat, _KM * x, _KM * y, _KM * z, _MICROSECOND * bias))
    if not rows:
        raise FileFormatError("no satellite has a position in it", path)
    stated = lines[0][32:39].strip()
    if not lines[-1].startswith("EOF") or (stated.isdecimal() and int(stated) > len(dates)):
        notes.append(f"{path.name} ends early or was cut: {len(dates)} epochs of {stated or 'an unknown number'}")
    if other:
        notes.append(f"{path.name}: satellites of unknown systems were left out: {', '.join(sorted(other))}")
    t = gps_times(np.array(dates), scale, path)
    table = np.array(rows)
    sats = np.unique(table[:, 1]).astype(np.int64)
    k, s = table[:, 0].astype(np.int64), np.searchsorted(sats, table[:, 1])
    r_e, clock = np.full((len(t), len(sats), 3), np.nan), np.full((len(t), len(sats)), np.nan)
    r_e[k, s], clock[k, s] = table[:, 2:5], table[:, 5]
    sigma = _accuracies(lines, path)
    return PreciseOrbits(t, sats, r_e, clock, np.array([sigma.get(one, np.nan) for one in sats.tolist()]), tuple(notes))


def gps_times(dates: FloatArray, scale: str, path: Path) -> FloatArray:
    """GPS seconds of increasing dates (k, 6) in a time system of :data:`SCALES`."""
    whole, part, wrong = whole_seconds(dates)
    if wrong.any():
        raise FileFormatError(f"impossible date {dates[wrong][0].tolist()}", path)
    shift = SCALES[scale]
    t = whole + part + (leap_seconds_at(whole, None) if shift is None else shift)
    if np.any(np.diff(t) <= 0.0):
        k = int(np.flatnonzero(np.diff(t) <= 0.0)[0]) + 1
        raise FileFormatError(f"expected epochs in order of time, got {dates[k].tolist()} after those before", path)
    return np.asarray(t, dtype=np.float64)


def _accuracies(lines: list[str], path: Path) -> dict[int, float]:
    """1-sigma by satellite: the header has powers of two, in millimetres; zero is unknown."""
    names = [line[k : k + 3] for line in lines if line.startswith("+ ") for k in range(9, 60, 3)]
    powers = [line[k : k + 3].strip() for line in lines if line.startswith("++") for k in range(9, 60, 3)]
    out: dict[int, float] = {}
    for name, power in zip(names, powers, strict=False):
        if name.strip() in ("", "0") or not power.isdecimal() or int(power) == 0:
            continue
        if (sat := _satellite(name, path, 3)) is not None:
            out[sat] = _MM * 2.0 ** int(power)
    return out


def _satellite(name: str, path: Path, line: int) -> int | None:
    """Number of a satellite, GPS where there is no letter; None of a system that we do not have."""
    name = f"G{name[1:]}" if name[:1] == " " else name
    if name[:1].isalpha() and name[:1] not in SYSTEMS:
        return None
    try:
        return satellite(name)
    except InputError as error:
        raise FileFormatError(str(error), path, line) from None


def _number(text: str, path: Path, line: int) -> float:
    try:
        value = float(text)
    except ValueError:
        value = np.nan
    if not np.isfinite(value):
        raise FileFormatError(f"expected a number, got {shorten(text.strip())}", path, line)
    return value
