"""Tables INSTINCT exports of VectorNav units (``.csv``): an IMU's samples, or a receiver's fixes and raw measurements.

The header names device, quantity and unit, as in ``IMU::UncompAccel::X [m/s^2]``. Raw measurements of one epoch stand
in one field, ``[system|satellite|band|channel|slot|C/N0|nine flags|pseudorange|carrier|Doppler]`` for each signal.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType

import numpy as np

from schuler import units
from schuler.arrays import FloatArray
from schuler.exceptions import FileFormatError
from schuler.gnss.observations import Observations
from schuler.gnss.signals import SYSTEMS, wavelengths
from schuler.recording.io import checks
from schuler.recording.io.assemble import metadata_of
from schuler.recording.io.clock import from_gps
from schuler.recording.io.hints import ReadHints
from schuler.recording.io.lines import check_file, encoding_of
from schuler.recording.io.raw import Raw, check_increasing
from schuler.recording.recording import Recording
from schuler.recording.series import GnssSeries, ImuSeries
from schuler.timebase import WEEK_S

_TIME = ("Time::GpsTow [ns]", "Time::GpsWeek")
_GYRO = tuple(f"IMU::UncompGyro::{c} [rad/s]" for c in "XYZ")
_ACCEL = tuple(f"IMU::UncompAccel::{c} [m/s^2]" for c in "XYZ")
_TEMPERATURE = "IMU::Temp [Celsius]"
_MAG = tuple(f"IMU::UncompMag::{c} [Gauss]" for c in "XYZ")
_FIX = (
    "GNSS1::Tow [ns]", "GNSS1::Week", "GNSS1::NumSats", "GNSS1::Fix", "GNSS1::PosLla::latitude [deg]",
    "GNSS1::PosLla::longitude [deg]", "GNSS1::PosLla::altitude [m]", "GNSS1::VelNed::N [m/s]",
    "GNSS1::VelNed::E [m/s]", "GNSS1::VelNed::D [m/s]", "GNSS1::PosU::N [m]", "GNSS1::PosU::E [m]",
    "GNSS1::PosU::D [m]", "GNSS1::VelU [m/s]",
)  # fmt: skip
_RAW = ("GNSS1::RawMeas::Tow [s]", "GNSS1::RawMeas::Week", "GNSS1::RawMeas::Satellites")
_MOST_SATELLITES, _MOST_SIGMA = 1e4, 1e10  # beyond any receiver's; 2**32 mm stands for "unknown" [1], [m]
_LARGEST = 1e30  # of any column: what is larger is damage, and products of it overflow
#: VectorNav's kinds of fix to RTKLIB's numbers; 0 none, 1 time only and 2 two-dimensional are no fixes here.
_QUALITY = MappingProxyType({3: 5, 4: 3, 5: 5, 7: 2, 8: 1})
_SYSTEMS = MappingProxyType({0: "G", 1: "S", 2: "E", 3: "C", 5: "J", 6: "R"})
#: System, band and channel to RINEX signals, as far as recordings confirm them by the ratio of carrier to pseudorange.
_SIGNALS = MappingProxyType({
    ("G", 1, 1): "1C", ("G", 2, 11): "2L", ("S", 1, 1): "1C", ("E", 1, 1): "1C", ("E", 7, 9): "7Q",
})  # fmt: skip
_FIELDS, _CODE_LOCK, _PHASE_LOCK = 18, 9, 10  # places in an entry
_ENTRY = re.compile(r"\[([^\[\]]*)\]")


@dataclass(frozen=True)
class ReceiverTable:
    """Fixes and raw measurements of one table on one time axis.

    Attributes
    ----------
    recording : Recording
        With all of it.
    observations : Observations, optional
        ``None`` if the table has no raw measurements.
    """

    recording: Recording
    observations: Observations | None


def looks_like_instinct_csv(head: bytes) -> bool:
    """Whether the first bytes of a file are the header of an INSTINCT table of a VectorNav unit."""
    return head.lstrip(b"\xef\xbb\xbf").startswith(b"Time [s],GpsCycle,") and b"Time::GpsTow [ns]" in head


def read_instinct_imu(path: Path | str, hints: ReadHints | None = None) -> Recording:
    """IMU series of an INSTINCT table.

    Parameters
    ----------
    path : Path or str
    hints : ReadHints, optional
        ``offset`` and ``name``.

    Returns
    -------
    Recording
        On GPS time, axes forward, right, down as the unit's own. Taken are the columns ``UncompAccel`` and
        ``UncompGyro``: calibrated, but without the corrections of the unit's own navigation filter, which move.

    Raises
    ------
    FileFormatError
        If a column is missing, a field is no number, or times do not increase; with the line.
    """
    path, hints = Path(path), _checked(Path(path), hints, ("offset",))
    header, rows = _table(path)
    names = [*_TIME, *_GYRO, *_ACCEL, *((_TEMPERATURE,) if _TEMPERATURE in header else ())]
    magnetic = set(_MAG) <= set(header)
    names += _MAG if magnetic else ()
    values = _numbers(path, header, rows, names)
    t, base = from_gps(values[:, 1] * WEEK_S, values[:, 0] * 1e-9)
    raw = Raw(path, {}, line_of=lambda row: row + 2)
    check_increasing(raw, t)
    notes = ["Columns UncompGyro and UncompAccel were taken, without the corrections of the unit's own filter."]
    if hints.offset:
        notes.append(f"{hints.offset:g} s was added to every time stamp.")
        t = t + hints.offset
    notes += checks.timing_notes(t)
    temperature = values[:, 8] if _TEMPERATURE in header else None
    magnetometer = values[:, -3:] * units.GAUSS if magnetic else None
    imu = ImuSeries(t, values[:, 2:5], values[:, 5:8], "rate", temperature, magnetometer)
    return Recording(imu=imu, metadata=metadata_of(path, hints, base, notes))


def read_instinct_gnss(path: Path | str, hints: ReadHints | None = None) -> ReceiverTable:
    """Fixes and raw measurements of an INSTINCT table.

    Parameters
    ----------
    path : Path or str
    hints : ReadHints, optional
        ``name`` only: an ``offset`` would give the measurements a wrong time of reception.

    Returns
    -------
    ReceiverTable
        ``PosU`` and ``VelU`` are taken as 1-sigmas of each component. Observations have the receiver's own time, which
        may be milliseconds off; fixes have GPS time.

    Raises
    ------
    FileFormatError
        If a column is missing, a field is no number, there is no fix, or times do not increase; with the line.
    """
    path, hints = Path(path), _checked(Path(path), hints, ())
    header, rows = _table(path)
    values = _numbers(path, header, rows, _FIX)
    notes: list[str] = []
    fixed = np.isin(values[:, 3], list(_QUALITY)) & np.all(values[:, 10:14] > 0.0, axis=1)
    if not fixed.any():
        raise FileFormatError(f"none of the {len(values)} epochs has a three-dimensional fix with an accuracy", path)
    if not fixed.all():
        notes.append(f"{int(np.sum(~fixed))} epochs without a three-dimensional fix or an accuracy were left out.")
    lines = np.flatnonzero(fixed)
    kept = values[fixed]
    t, base = from_gps(kept[:, 1] * WEEK_S, kept[:, 0] * 1e-9)
    check_increasing(Raw(path, {}, line_of=lambda row: int(lines[row]) + 2), t)
    wrong = np.flatnonzero(~(np.abs(kept[:, 2]) < _MOST_SATELLITES) | ~(kept[:, 10:14] < _MOST_SIGMA).all(axis=1))
    if len(wrong):
        row = kept[wrong[0]]
        raise FileFormatError(
            f"expected a number of satellites and accuracies in metres, got {row[2]:g}, {row[10:14].tolist()}: the "
            "line is damaged; correct or delete it",
            path,
            int(lines[wrong[0]]) + 2,
        )
    cov_r, cov_v = np.zeros((len(t), 3, 3)), np.zeros((len(t), 3, 3))
    cov_r[:, [0, 1, 2], [0, 1, 2]] = kept[:, 10:13] ** 2
    cov_v[:, [0, 1, 2], [0, 1, 2]] = kept[:, 13:14] ** 2
    llh = np.column_stack((kept[:, 4:6] * units.DEG, kept[:, 6]))
    quality = np.array([_QUALITY[int(q)] for q in kept[:, 3]])
    gnss = GnssSeries(t, llh, cov_r, kept[:, 7:10], cov_v, quality, kept[:, 2].astype(np.int64))
    observations = None
    if all(name in header for name in _RAW):
        observations = _observations(path, header, rows, base.epoch_gps_s)
        notes += observations.notes
    notes += checks.timing_notes(t)
    metadata = metadata_of(path, hints, base, notes)
    return ReceiverTable(Recording(gnss=gnss, observations=observations, metadata=metadata), observations)


def _checked(path: Path, hints: ReadHints | None, used: tuple[str, ...]) -> ReadHints:
    hints = hints or ReadHints()
    hints.check_used(path, {*used, "name", "series"}, "a table of INSTINCT")
    return hints


def _table(path: Path) -> tuple[list[str], list[list[str]]]:
    """Header and rows of fields; raw measurements hold no commas."""
    encoding = encoding_of(check_file(path), path)
    text = path.read_text(encoding=encoding, errors="replace").splitlines()
    header = [name.strip() for name in text[0].lstrip("\ufeff").split(",")]
    rows = [line.split(",") for line in text[1:] if line.strip()]
    if not rows:
        raise FileFormatError("there is a header but no row", path)
    for number, row in enumerate(rows, 2):
        if len(row) != len(header):
            raise FileFormatError(f"expected {len(header)} fields as in the header, got {len(row)}", path, number)
    return header, rows


def _numbers(path: Path, header: list[str], rows: list[list[str]], names: Sequence[str]) -> FloatArray:
    """Columns as numbers. Shape (n, k)."""
    if missing := [name for name in names if name not in header]:
        raise FileFormatError(f"expected the column {missing[0]!r}; is it a table of another device?", path, 1)
    places = [header.index(name) for name in names]
    try:
        values = np.array([[_number(row[k]) for k in places] for row in rows])
    except ValueError:
        values = np.full((1, 1), np.nan)
    if (np.abs(values) < _LARGEST).all():
        return values
    for number, row in enumerate(rows, 2):
        for name, k in zip(names, places, strict=True):
            try:
                good = abs(_number(row[k])) < _LARGEST
            except ValueError:
                good = False
            if not good:
                raise FileFormatError(f"{name}: expected a number, got {row[k]!r}", path, number)
    raise AssertionError("a field that is no number was not found again")


def _number(text: str) -> float:
    """A number as other programs write it: Python itself would take underscores between digits."""
    if "_" in text:
        raise ValueError(text)
    return float(text)


def _observations(path: Path, header: list[str], rows: list[list[str]], start: float) -> Observations:
    time = _numbers(path, header, rows, _RAW[:2])
    t = (time[:, 1] * WEEK_S - start) + time[:, 0]
    check_increasing(Raw(path, {}, line_of=lambda row: row + 2), t)
    column = header.index(_RAW[2])
    measurements: list[tuple[float, ...]] = []
    names: list[str] = []
    others: Counter[str] = Counter()
    for number, (row, when) in enumerate(zip(rows, t.tolist(), strict=True), 2):
        for entry in _ENTRY.findall(row[column]):
            fields = entry.split("|")
            try:
                v = [_number(field) for field in fields]
            except ValueError:
                v = []
            if len(v) != _FIELDS or not np.isfinite(v[:4]).all():
                raise FileFormatError(f"expected {_FIELDS} numbers between brackets, got [{entry}]", path, number)
            letter = _SYSTEMS.get(int(v[0]), "")
            name = _SIGNALS.get((letter, int(v[2]), int(v[3])))
            satellite = int(v[1]) - (100 if letter == "S" else 0)
            if name is None or not 0 < satellite < 100:
                others[f"{letter or int(v[0])} band {int(v[2])} channel {int(v[3])}"] += 1
                continue
            if name not in names:
                names.append(name)
            pseudorange = v[15] if v[_CODE_LOCK] else np.nan
            carrier = v[16] if v[_PHASE_LOCK] else np.nan
            measurements.append(
                (when, 100 * SYSTEMS.index(letter) + satellite, names.index(name), pseudorange, v[17], carrier, v[5])
            )
    table = np.array(measurements).reshape(-1, 7)
    sat, signal = table[:, 1].astype(np.int64), table[:, 2].astype(np.int64)
    cycle = np.full(len(table), np.nan)
    for k, name in enumerate(names):
        cycle[signal == k] = wavelengths(sat[signal == k], name)
    notes: tuple[str, ...] = ()
    if others:
        listed = ", ".join(f"{name} ({count})" for name, count in sorted(others.items()))
        notes = (f"Raw measurements of signals not known here were left out: {listed}.",)
    # Doppler is positive for an approaching satellite
    return Observations(
        table[:, 0], sat, signal, tuple(names), table[:, 3], -table[:, 4] * cycle, table[:, 5], table[:, 6], start,
        notes=notes,
    )  # fmt: skip
