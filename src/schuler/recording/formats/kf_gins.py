"""Text files of KF-GINS and OB-GINS: IMU increments, fixes, and navigation results or truth, without headers.

Columns, between blanks. IMU: second of week [s], increments of angle [rad] and velocity [m/s], forward-right-down.
Fixes: second of week, latitude, longitude [deg], height [m], 1-sigma north, east, down [m]; with 13 columns velocity
[m/s] before it and 1-sigma of velocity after it, or, of KF-GINS-Matlab, velocity and its 1-sigma behind. Results:
week (0 if not known), second of week, latitude, longitude [deg], height [m], velocity north, east, down [m/s], roll,
pitch, yaw [deg]. By the loaders of KF-GINS (i2Nav, Wuhan University).
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from schuler import earth, files, units
from schuler.arrays import FloatArray
from schuler.exceptions import FileFormatError, InputError, SchulerError
from schuler.recording.io import parts, plain_text
from schuler.recording.io.clock import stamps
from schuler.recording.io.hint_texts import parse_streams, parse_time
from schuler.recording.io.hints import ReadHints
from schuler.recording.io.lines import TextTable
from schuler.recording.io.parts import Table
from schuler.recording.io.streams import Stream, choose
from schuler.recording.recording import Recording
from schuler.timebase import WEEK_S, TimeBase, week_tow

_WIDTHS = (7, 11, 13)
_WHAT = "7: IMU or fixes, 13: fixes with velocity, 11: navigation results"
_HINTS = parts.GNSS_HINTS | {"axes", "time", "streams"}
_SUFFIXES = (".txt", ".nav", ".imu", ".pos", ".gnss")
_SMALL = 5.0  # increments are far below, latitudes and longitudes beyond it [rad, m/s]
#: Names of the files that are written.
NAMES = {"imu": "imu.txt", "gnss": "gnss.txt", "reference": "truth.nav"}


def sniff(head: bytes, path: Path) -> bool:
    """A table of plain numbers shows nothing; ``format="kf_gins"`` says what it is."""
    return False


def sniff_folder(path: Path) -> bool:
    """Whether a folder has a configuration of KF-GINS."""
    heads = [plain_text.head_of(file) for file in sorted(path.glob("*.yaml"))[:4]]
    return any(b"imupath" in head and b"gnsspath" in head for head in heads)


def read(path: Path, hints: ReadHints) -> Recording:
    """IMU, fixes and truth of a file or of all such files of a folder.

    Parameters
    ----------
    path : Path
    hints : ReadHints
        ``time="gps-tow:WEEK"``, unless results state a week; ``series`` where seven columns leave it open; for a folder
        with several candidates ``streams="imu=ADIS16465.txt,gnss=RTK.txt"``; ``axes``, ``sigma``.

    Raises
    ------
    FileFormatError
        With file and line, for what is missing or malformed.
    InputError
        If several files could be one part.
    """
    parts.check_hints(path, hints, _HINTS, "a KF-GINS log")
    notes: list[str] = []
    loaded = _folder(path, hints, notes) if path.is_dir() else {}
    if not path.is_dir():
        part, rows = _load(path, hints, notes, hints.series)
        loaded = {part: (path, rows)}
    week = _week(loaded)
    time = hints.time or (None if week is None else f"gps-tow:{week}")
    if week is not None and hints.time is None:
        notes.append(f"The results are of GPS week {week}; so are all files.")
    elif parse_time(time).kind == "local":
        notes.append(
            "The GPS week is not known, so seconds of week are a clock of their own (hint time='gps-tow:WEEK')."
        )
    made: dict[str, tuple[FloatArray, FloatArray]] = {}
    base = TimeBase("local")
    for part, (file, rows) in loaded.items():
        column = 1 if part == "reference" else 0

        def fault(message: str, row: int | None, file: Path = file) -> FileFormatError:
            return FileFormatError(message if row is None else f"row {row + 1}: {message}", file)

        time_notes: list[str] = []
        t, base = stamps(rows[:, column].copy(), time, fault, time_notes)
        notes += [note for note in time_notes if note not in notes and time is not None]
        made[part] = t, rows[:, column + 1 :]
    tables = {}
    for part, (t, rows) in made.items():
        t, rows = parts.kept(parts.later(t, part, loaded[part][0], notes), t, rows)
        if part == "gnss" and rows.shape[1] == 12:
            rows = _velocity_first(t, rows, loaded[part][0], notes)
        tables[part] = _table(part, t, rows)
    return parts.assemble(path, tables, hints, base, notes, [file for file, _ in loaded.values()])


def _folder(path: Path, hints: ReadHints, notes: list[str]) -> dict[str, tuple[Path, FloatArray]]:
    """Files of a folder by the part they hold, those that are named or the only ones there are."""
    tables: dict[str, tuple[str, FloatArray]] = {}
    others: list[tuple[str, SchulerError]] = []
    for file in sorted(p for p in path.iterdir() if p.suffix.lower() in _SUFFIXES and p.is_file() and p.name[0] != "."):
        try:
            table = plain_text.open_table(file, _WIDTHS, _WHAT)
        except SchulerError as reason:
            others.append((file.name, reason))
            continue
        rows = _rows(table, hints, notes)  # a file that begins as one of these and goes on otherwise is damaged
        try:
            tables[file.name] = _part(file, rows, None), rows
        except SchulerError as reason:
            others.append((file.name, reason))
    streams = [Stream(name, "text", len(rows), part=part) for name, (part, rows) in tables.items()]
    chosen = parse_streams(hints.streams)
    for name, fault in others:
        if name in chosen.values():
            raise fault
    taken = {part: choose(streams, part, chosen) for part in ("imu", "gnss", "reference")}
    named = {part: stream.name for part, stream in taken.items() if stream is not None}
    if not named:
        what = f"; {others[0][1]}" if others else ""
        raise FileFormatError(f"no file of the folder has the columns of KF-GINS ({_WHAT}){what}", path)
    if others:
        notes.append(f"Not of KF-GINS and not read: {', '.join(name for name, _ in others)}.")
    return {part: (path / name, tables[name][1]) for part, name in named.items()}


def _load(path: Path, hints: ReadHints, notes: list[str], series: str | None) -> tuple[str, FloatArray]:
    rows = _rows(plain_text.open_table(path, _WIDTHS, _WHAT), hints, notes)
    return _part(path, rows, series), rows


def _rows(table: TextTable, hints: ReadHints, notes: list[str]) -> FloatArray:
    return plain_text.load(table, plain_text.width(table), allow_truncated=hints.allows("truncated"), notes=notes)


def _part(path: Path, rows: FloatArray, series: str | None) -> str:
    """Kind of table, by the number of columns and their size."""
    if rows.shape[1] != 7:
        return "reference" if rows.shape[1] == 11 else "gnss"
    degrees = bool(np.all(np.abs(rows[:, 1]) <= 90.0) and np.all(np.abs(rows[:, 2]) <= 360.0))
    can_be = [
        part
        for part, fits in (
            ("imu", bool(np.abs(rows[:, 1:]).max() < _SMALL)),
            ("gnss", degrees and bool(np.all(rows[:, 4:] >= 0.0))),
        )
        if fits
    ]
    if series in ("imu", "gnss"):
        return str(series)
    if len(can_be) != 1:
        raise FileFormatError(
            "seven columns are IMU increments (radians, metres a second) or fixes (degrees, 1-sigma), and this file "
            f"could be {' or '.join(can_be) or 'neither'}: say series='imu' or series='gnss'",
            path,
        )
    return can_be[0]


def _velocity_first(t: FloatArray, rows: FloatArray, path: Path, notes: list[str]) -> FloatArray:
    """Columns of fixes as position, velocity, 1-sigma of both; also where they stand as KF-GINS-Matlab writes them.

    A 1-sigma is positive, and a velocity agrees with the displacements.
    """
    triples = rows[:, 3:6], rows[:, 6:9]
    negative = [bool(np.any(x <= 0.0)) for x in triples]
    off = [_off_displacements(t, rows[:, :3], x) for x in triples]
    if negative[0] != negative[1]:
        swapped = negative[1]
    elif max(off) > 3.0 * min(off):
        swapped = off[1] < off[0]
    else:
        raise FileFormatError(
            "13 columns are position, velocity, 1-sigma of position and of velocity (KF-GINS, OB-GINS), or position, "
            "its 1-sigma, velocity, its 1-sigma (KF-GINS-Matlab); these numbers do not tell which: neither or both "
            "have values below zero, and both are as far from the displacements. Say "
            "columns='t,lat,lon,h,vn,ve,vd,sn,se,sd,svn,sve,svd' or "
            "columns='t,lat,lon,h,sn,se,sd,vn,ve,vd,svn,sve,svd', with units='angle=deg'",
            path,
        )
    if not swapped:
        return rows
    notes.append(
        "Fixes are position, its 1-sigma, velocity, its 1-sigma, the order of KF-GINS-Matlab: columns 5 to 7 are "
        f"positive and columns 8 to 10 are within {off[1]:.2g} m/s of the displacements (median)."
    )
    return np.concatenate((rows[:, :3], rows[:, 6:9], rows[:, 3:6], rows[:, 9:]), axis=1)


def _off_displacements(t: FloatArray, place: FloatArray, v: FloatArray) -> float:
    """Median difference of what may be velocities to what positions say; infinite of one fix. [m/s]"""
    if len(t) < 2:
        return float("inf")
    lat, lon = place[:, 0] * units.DEG, place[:, 1] * units.DEG
    meridian, normal = earth.radii_of_curvature(lat[:-1])
    steps = (meridian * np.diff(lat), normal * np.cos(lat[:-1]) * np.diff(np.unwrap(lon)), -np.diff(place[:, 2]))
    between = np.stack(steps, axis=1) / np.diff(t)[:, None]
    return float(np.median(np.linalg.norm(between - 0.5 * (v[1:] + v[:-1]), axis=1)))


def _week(loaded: dict[str, tuple[Path, FloatArray]]) -> int | None:
    if "reference" not in loaded:
        return None
    file, rows = loaded["reference"]
    week = rows[0, 0]
    if not (week == round(week) and 0.0 <= week <= 9999.0):
        raise FileFormatError(f"expected the GPS week (or 0) in the first column of results, got {week:g}", file)
    return int(week) or None


def _table(part: str, t: FloatArray, rows: FloatArray) -> Table:
    if part == "imu":
        columns = dict(zip(("gx", "gy", "gz", "ax", "ay", "az"), rows.T, strict=True))
        return Table({"t": t, **columns}, kind="increment")
    place = {"t": t, "lat": rows[:, 0] * units.DEG, "lon": rows[:, 1] * units.DEG, "h": rows[:, 2]}
    if part == "reference":
        names: tuple[str, ...] = ("vn", "ve", "vd")
        angles = dict(zip(("roll", "pitch", "yaw"), rows[:, 6:9].T * units.DEG, strict=True))
        return Table(place | dict(zip(names, rows[:, 3:6].T, strict=True)) | angles)
    names = ("sn", "se", "sd") if rows.shape[1] == 6 else ("vn", "ve", "vd", "sn", "se", "sd", "svn", "sve", "svd")
    return Table(place | dict(zip(names, rows[:, 3:].T, strict=True)))


def write(recording: Recording, path: Path) -> list[Path]:
    """Write increments, fixes and reference as ``imu.txt``, ``gnss.txt`` and ``truth.nav``.

    Parameters
    ----------
    recording : Recording
        Rates become increments. The reference of a navigation result is its trajectory.
    path : Path
        A new folder; or, with a suffix (``.txt``, ``.nav``), one file of the only part the recording has.

    Raises
    ------
    InputError
        If the folder exists, or a reference has no velocity or attitude.

    Notes
    -----
    Seconds of week count on over the end of a week; on a local clock they are its own and the week is 0. Stamps have
    nine decimals, degrees twelve (1e-7 m), heights and velocities nine, increments 17 digits.
    """
    base = recording.metadata.time
    week, shift = (0, 0.0)
    if base.scale == "gps":
        week, _ = week_tow(base.epoch_gps_s + recording.start)
        shift = base.epoch_gps_s - week * WEEK_S
    tables: dict[str, tuple[FloatArray, list[str]]] = {}
    if recording.imu is not None:
        inc = recording.imu.increments()
        rows = np.column_stack((inc.t + shift, inc.dtheta_ib_b, inc.dv_ib_b))
        tables["imu"] = rows, ["%.9f"] + ["%.17g"] * 6
    if (gnss := recording.gnss) is not None:
        columns: list[Any] = [gnss.t + shift, gnss.llh[:, :2] / units.DEG, gnss.llh[:, 2]]
        sigma = np.sqrt(np.einsum("nii->ni", gnss.cov_r_n))
        if gnss.v_n is not None and gnss.cov_v_n is not None:
            columns += [gnss.v_n, sigma, np.sqrt(np.einsum("nii->ni", gnss.cov_v_n))]
        else:
            columns.append(sigma)
        rows = np.column_stack(columns)
        tables["gnss"] = rows, ["%.9f", "%.12f", "%.12f"] + ["%.9f"] * (rows.shape[1] - 3)
    if (reference := recording.reference) is not None:
        if reference.v_eb_e is None or reference.q_eb is None:
            raise InputError("results of KF-GINS have velocity and attitude; this reference lacks them")
        rpy = reference.rpy_nb / units.DEG
        rpy[:, 2] %= 360.0
        llh = reference.llh
        n = len(reference)
        rows = np.column_stack(
            (np.full(n, week), reference.t + shift, llh[:, :2] / units.DEG, llh[:, 2], reference.v_eb_n, rpy)
        )
        tables["reference"] = rows, ["%d", "%.9f", "%.12f", "%.12f"] + ["%.9f"] * 7
    path = Path(path)
    if path.suffix:
        if len(tables) != 1:
            raise InputError(f"{path} is one file, the recording has {', '.join(tables)}: name a folder (no suffix)")
        ((rows, fmt),) = tables.values()
        with files.replacing(path) as temporary:
            plain_text.save(temporary, rows, fmt)
        return [path]
    with files.new_folder(path) as folder:
        for part, (rows, fmt) in tables.items():
            plain_text.save(folder / NAMES[part], rows, fmt)
    return [path / NAMES[part] for part in tables]
