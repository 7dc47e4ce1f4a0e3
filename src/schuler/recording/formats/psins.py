"""PSINS (Yan Gongmin): MATLAB files of ``trj`` or matrices, ``.imu`` text logs, and tightly coupled data.

MATLAB matrices: ``imu`` has increments of angle [rad] and velocity [m/s] and the time, axes right-forward-up; ``avp``
pitch, roll, yaw (from north over west), velocity east, north, up, latitude, longitude [rad], height, time; ``gps``
velocity, position, time, or without velocity. By the functions trjsimu, avpfile and gpssimu of PSINS.

Text logs (``.imu``) hold counts of increments. The header is comments with ``%`` and three lines: initial attitude and
velocity; latitude, longitude [deg], height [m], start [s], interval [ms], gravity; weights of a count, gyros in arc
seconds and accelerometers in micro-g seconds.

Tightly coupled data (``.mat`` with ``imu``, ``obss`` and ``ephs``): ``imu`` as above; ``obss`` is time of week, PRN,
pseudorange [m], carrier [m], 1-sigma of the pseudorange [m] and the rate [m/s], positive for an approaching satellite
(its sum with the pseudorange's own rate is zero to centimetres per second); ``ephs`` has one GPS ephemeris a row.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from schuler import units
from schuler.arrays import FloatArray
from schuler.exceptions import FileFormatError
from schuler.gnss.ephemerides import Ephemerides, KeplerRecords, no_glonass
from schuler.gnss.observations import Observations
from schuler.gnss.signals import SPEED_OF_LIGHT, frequency_hz
from schuler.plotting.notebook import Abridged
from schuler.recording.formats import matlab
from schuler.recording.formats.matlab import variables
from schuler.recording.io import checks, parts
from schuler.recording.io.assemble import metadata_of
from schuler.recording.io.clock import stamps
from schuler.recording.io.hint_texts import axes_matrix
from schuler.recording.io.hints import ReadHints
from schuler.recording.io.lines import check_file, encoding_of
from schuler.recording.io.parts import Table
from schuler.recording.recording import Recording
from schuler.recording.series import ImuSeries
from schuler.timebase import WEEK_S, TimeBase

_HINTS = parts.GNSS_HINTS | {"axes", "time"}
_WIDTHS = {"imu": (7,), "avp": (10,), "gps": (4, 7)}
_PARTS = {"imu": "imu", "avp": "reference", "gps": "gnss"}
_TITLE = b"PSINS-format"
_USED = {"axes", "time", "offset", "name", "series", "allow"}
_AXES = "RFU"
_COLUMNS = {"imu": 7, "obss": 6, "ephs": 31}
#: Columns of ``ephs`` (as RINEX orders them); angles are radians, times seconds of the week in column 23.
_EPHEMERIS = {
    "af0": 2, "af1": 3, "af2": 4, "issue": 5, "crs": 6, "delta_n": 7, "m0": 8, "cuc": 9, "e": 10, "cus": 11,
    "sqrt_a": 12, "cic": 14, "omega0": 15, "cis": 16, "i0": 17, "crc": 18, "omega": 19, "omega_dot": 20, "idot": 21,
}  # fmt: skip
_PRN, _TOC, _TOE, _WEEK, _ACCURACY, _HEALTH, _TGD = 0, 1, 13, 23, 25, 26, 27
_LATEST = 1e7  # no time of week or number of a satellite is greater
_USUAL_ACCURACY = 2.0  # of an ephemeris whose accuracy the file does not have [m]


def sniff(head: bytes, path: Path) -> bool:
    """Whether a MATLAB file has a ``trj``, or ``imu`` and ``avp`` with 7 and 10 columns."""
    if not head.startswith(b"MATLAB 5.0"):
        return False
    by_name = variables(path)
    if "trj" in by_name:
        return {"imu", "avp"} <= set(by_name["trj"].fields)
    shapes = {name: by_name[name].shape for name in ("imu", "avp") if name in by_name}
    return len(shapes) == 2 and all(len(shape) == 2 and shape[1] in _WIDTHS[name] for name, shape in shapes.items())


def holds(path: Path) -> tuple[str, ...]:
    """Series of the matrices."""
    by_name = variables(path)
    if "trj" in by_name:
        return tuple(_PARTS[name] for name in ("imu", "avp") if name in by_name["trj"].fields)
    return tuple(part for name, part in _PARTS.items() if name in by_name)


def read(path: Path, hints: ReadHints) -> Recording:
    """IMU increments, reference and fixes of a file.

    Parameters
    ----------
    path : Path
    hints : ReadHints
        ``sigma`` for ``gps``, which has no accuracies (without it fixes are left out beside other series); ``axes`` of
        the IMU other than right-forward-up; ``time``.

    Raises
    ------
    FileFormatError
        If there is none of these matrices, or one has the wrong size.
    """
    if (described := matlab.as_arrays(path, hints)) is not None:
        return described
    parts.check_hints(path, hints, _HINTS, "a PSINS file")
    values: dict[str, Any] = matlab.load(path, ("trj", *_WIDTHS))
    notes: list[str] = []
    if isinstance(values.get("trj"), dict):
        values = values["trj"]
    matrices = {name: matlab.matrix(values[name], name, path, w) for name, w in _WIDTHS.items() if name in values}
    if not matrices:
        raise FileFormatError("expected a structure trj, or matrices imu, avp or gps", path)
    if "gps" in matrices and hints.sigma is None and len(matrices) > 1:
        del matrices["gps"]
        notes.append("The fixes (gps) come without an accuracy and were left out: hint sigma.")

    def fault(message: str, row: int | None) -> FileFormatError:
        return FileFormatError(message if row is None else f"row {row + 1}: {message}", path)

    tables, base = {}, None
    for name, rows in matrices.items():
        time_notes: list[str] = []
        t, made = stamps(rows[:, -1].copy(), hints.time, fault, time_notes)
        base = base or made
        t = t + (made.epoch_gps_s - base.epoch_gps_s)
        notes += [note for note in time_notes if note not in notes]
        keep = parts.later(t, name, path, notes)
        tables[_PARTS[name]] = _table(name, t[keep], rows[keep])
    assert base is not None
    return parts.assemble(path, tables, hints, base, notes)


def _table(name: str, t: FloatArray, rows: FloatArray) -> Table:
    if name == "imu":
        columns = dict(zip(("gx", "gy", "gz", "ax", "ay", "az"), rows[:, :6].T, strict=True))
        return Table({"t": t, **columns}, axes="RFU", kind="increment")
    place = dict(zip(("lat", "lon", "h"), rows[:, -4:-1].T, strict=True))
    values = {"t": t, **place}
    if rows.shape[1] >= 7:
        ve, vn, vu = rows[:, -7:-4].T
        values |= {"vn": vn, "ve": ve, "vd": -vu}
    if name == "avp":
        values |= {"roll": rows[:, 1], "pitch": rows[:, 0], "yaw": -rows[:, 2]}
    return Table({key: np.ascontiguousarray(value) for key, value in values.items()})


def looks_like_psins_imu(head: bytes) -> bool:
    """Whether the first bytes of a file are those of a PSINS IMU log."""
    return head.lstrip(b"\xef\xbb\xbf").startswith(b"%") and _TITLE in head[:200]


def read_psins_imu(path: Path | str, hints: ReadHints | None = None) -> Recording:
    """IMU series of a PSINS text log, as increments.

    Parameters
    ----------
    path : Path or str
    hints : ReadHints, optional
        ``axes`` (default right, forward, up, the convention the file states), ``time``, ``offset``, ``name``.

    Returns
    -------
    Recording
        Its notes have the position and time interval the header states.

    Raises
    ------
    FileFormatError
        If the three lines of the header are missing or impossible, or a row has not six numbers.
    InputError
        If a hint is given that the log answers itself.
    """
    path, hints = Path(path), hints or ReadHints()
    hints.check_used(path, _USED, "a PSINS log")
    encoding = encoding_of(check_file(path), path)
    with path.open(encoding=encoding, errors="replace") as stream:
        lines = [(number, line) for number, line in enumerate(stream, 1) if line.strip() and not line.startswith("%")]
    if len(lines) < 5:
        raise FileFormatError("expected three lines of header and at least two of counts", path)
    header = np.array([_row(path, *line) for line in lines[:3]])
    lat_deg, lon_deg, height, start, interval_ms, gravity = header[1].tolist()
    if not (abs(lat_deg) <= 90.0 and 0.0 < interval_ms <= 1000.0 and 9.7 < gravity < 9.9 and np.all(header[2] > 0.0)):
        raise FileFormatError(
            "expected 'latitude[deg] longitude[deg] height[m] start[s] interval[ms] gravity[m/s^2]' and six positive "
            f"weights of a count, got {header[1].tolist()} and {header[2].tolist()}",
            path,
            lines[1][0],
        )
    counts = _counts(path, lines[3:])
    n = len(counts)
    with np.errstate(over="ignore"):  # of impossible counts or weights: what is not finite is refused
        dtheta = counts[:, :3] * header[2, :3] * units.ARCSEC
        dv = counts[:, 3:] * header[2, 3:] * units.UG
    notes = [
        f"Increments: a count is {header[2, 0]:g} arcsec and {header[2, 3]:g} ug s; {1000.0 / interval_ms:g} Hz by the "
        "header, which has no stamps for single rows.",
        f"The header says latitude {lat_deg:.6f} deg, longitude {lon_deg:.6f} deg, height {height:g} m.",
    ]
    axes = hints.axes or _AXES
    if hints.axes is None:
        notes.append("Axes are taken as right, forward, up, as the file says is usual (hint axes says otherwise).")

    def fault(message: str, row: int | None) -> FileFormatError:
        return FileFormatError(message, path, None if row is None else lines[3 + row][0])

    t, base = stamps(start + np.arange(1, n + 1) * interval_ms * 1e-3 + hints.offset, hints.time, fault, notes)
    notes += checks.timing_notes(t)
    C_bs = axes_matrix(axes)
    with np.errstate(over="ignore", invalid="ignore"):  # of impossible weights; what overflows is no gravity
        imu = ImuSeries(t, dtheta @ C_bs.T, dv @ C_bs.T, "increment")
        level = float(np.linalg.norm(imu.rates().accel.mean(axis=0)))
    if abs(level / gravity - 1.0) > checks.NORM_TOLERANCE and not hints.allows("norm"):
        raise FileFormatError(
            f"the mean specific force is {level:.3f} m/s^2, not gravity: are the weights of the header right? If the "
            "log is of a flight, allow='norm' passes it",
            path,
        )
    metadata = replace(metadata_of(path, hints, base, notes), axes=axes.upper())
    return Recording(imu=imu, metadata=metadata)


def _row(path: Path, number: int, line: str) -> list[float]:
    fields = line.split()
    try:
        values = [float(field) for field in fields]
    except ValueError:
        values = []
    if len(values) != 6 or not np.isfinite(values).all():
        raise FileFormatError(f"expected six numbers, got {line.strip()[:60]!r}", path, number)
    return values


def _counts(path: Path, lines: list[tuple[int, str]]) -> FloatArray:
    import io

    try:
        counts = np.loadtxt(io.StringIO("".join(line for _, line in lines)), dtype=np.float64, ndmin=2)
    except ValueError:
        counts = np.empty((0, 0))
    if counts.shape == (len(lines), 6) and np.isfinite(counts).all():
        return counts
    return np.array([_row(path, *line) for line in lines])


@dataclass(frozen=True, repr=False)
class RangeLog(Abridged):
    """Increments, measurements and ephemerides of one run on one time axis.

    Attributes
    ----------
    recording : Recording
        With all of it.
    observations : Observations
    ephemerides : Ephemerides
    sigma_range : ndarray, shape (n,)
        1-sigma of each pseudorange as the file has it. [m]
    """

    recording: Recording
    observations: Observations
    ephemerides: Ephemerides
    sigma_range: FloatArray


def read_psins_ranges(path: Path | str) -> RangeLog:
    """Read a PSINS file of increments, pseudoranges and ephemerides.

    Parameters
    ----------
    path : Path or str
        ``.mat`` up to version 7 with ``imu`` (N x 7), ``obss`` (M x 6), ``ephs`` (32 x 31) and ``t0``, the time of week
        of zero seconds of ``imu``.

    Returns
    -------
    RangeLog
        On GPS time from the start of the week; increments turned from right-forward-up to forward-right-down.

    Raises
    ------
    FileFormatError
        If an array is missing or of another shape, or no ephemeris is filled in.
    """
    path = Path(path)
    check_file(path)
    arrays = _arrays(path)
    ephemerides, week = _ephemerides(path, arrays["ephs"])
    start, t0 = week * WEEK_S, float(np.ravel(arrays["t0"])[0])
    imu = arrays["imu"]
    if not 0.0 <= t0 < WEEK_S or np.any(np.diff(imu[:, 6]) <= 0.0):
        raise FileFormatError(f"expected t0 within a week and increasing times of imu, got t0 = {t0:g}", path)
    C_bs = axes_matrix("RFU")
    series = ImuSeries(t0 + imu[:, 6], imu[:, :3] @ C_bs.T, imu[:, 3:6] @ C_bs.T, "increment")
    observations, sigma = _observations(path, arrays["obss"], start)
    notes = (
        "Increments were turned from right, forward, up.",
        f"Week {week} is that of the ephemerides; zero seconds of imu is {t0:.6f} s of it.",
        "Rates of obss are positive for an approaching satellite; range rates have the opposite sign.",
        *observations.notes,
        *ephemerides.notes,
    )
    metadata = replace(metadata_of(path, ReadHints(), TimeBase("gps", start), notes), axes="RFU")
    recording = Recording(imu=series, observations=observations, ephemerides=ephemerides, metadata=metadata)
    return RangeLog(recording, observations, ephemerides, sigma)


def _arrays(path: Path) -> dict[str, FloatArray]:
    contents = matlab.load(path, {*_COLUMNS, "t0"})
    arrays = {}
    for name, columns in (*_COLUMNS.items(), ("t0", 1)):
        array = np.asarray(contents.get(name, np.empty((0, 0))))
        if array.ndim != 2 or array.shape[1] != columns or array.size == 0 or array.dtype.kind not in "fiu":
            raise FileFormatError(
                f"expected an array {name} of numbers with {columns} columns, got shape {array.shape}", path
            )
        arrays[name] = array.astype(np.float64)
    if not np.isfinite(arrays["imu"]).all():
        raise FileFormatError("expected finite numbers in imu", path)
    return arrays


def _observations(path: Path, obss: FloatArray, start: float) -> tuple[Observations, FloatArray]:
    if not np.isfinite(obss[:, :2]).all() or np.abs(obss[:, :2]).max() > _LATEST:
        raise FileFormatError("expected times of week and satellite numbers in the first columns of obss", path)
    order = np.argsort(obss[:, 0], kind="stable")
    tow, prn, pseudorange, carrier, sigma, approach = obss[order].T
    cycle = SPEED_OF_LIGHT / frequency_hz(1, "1C")
    n = len(tow)
    with np.errstate(over="ignore"):  # beyond double precision is infinite, and refused as such
        phase = carrier / cycle
    observations = Observations(
        tow, prn.astype(np.int64), np.zeros(n, dtype=np.int64), ("1C",), pseudorange, -approach, phase,
        np.full(n, np.nan), start, notes=("The file has no carrier to noise densities.",),
    )  # fmt: skip
    return observations, sigma


def _ephemerides(path: Path, ephs: FloatArray) -> tuple[Ephemerides, int]:
    """Ephemerides of the rows that are filled in, and their week."""
    needed = ephs[:, [_PRN, _TOE, _TOC, _HEALTH, _WEEK, *_EPHEMERIS.values()]]
    whole = np.isfinite(needed).all(axis=1) & (np.abs(needed) < _LATEST).all(axis=1)
    rows = ephs[whole & (ephs[:, 12] > 0.0) & (ephs[:, _WEEK] > 0.0)]
    weeks = np.unique(rows[:, _WEEK])
    if len(weeks) != 1:
        raise FileFormatError(f"expected ephemerides of one week, got weeks {weeks.astype(int).tolist()}", path)
    n, start = len(rows), float(weeks[0]) * WEEK_S
    accuracy = rows[:, _ACCURACY]
    stated = np.isfinite(accuracy) & (accuracy > 0.0)
    notes: tuple[str, ...] = (f"{len(ephs) - n} of {len(ephs)} rows of ephs are empty or damaged.",)
    if not stated.all():
        notes += (f"{int(np.sum(~stated))} ephemerides have no accuracy; it was set to {_USUAL_ACCURACY:g} m.",)
    values: dict[str, Any] = {name: rows[:, column] for name, column in _EPHEMERIS.items()}
    kepler = KeplerRecords(
        sat=rows[:, _PRN].astype(np.int64),
        toe=start + rows[:, _TOE],
        toc=start + rows[:, _TOC],
        sent=np.full(n, np.nan),
        group_delay=np.stack((rows[:, _TGD], np.full(n, np.nan)), axis=1),
        health=rows[:, _HEALTH].astype(np.int64),
        accuracy=np.where(stated, accuracy, _USUAL_ACCURACY),
        source=np.zeros(n, dtype=np.int64),
        **values,
    )
    return Ephemerides(kepler, no_glonass(), notes=notes), int(weeks[0])
