"""Applanix SBET (smoothed best estimate of trajectory): records of 17 little-endian doubles, no header.

Second of week [s]; latitude, longitude [rad], altitude [m]; velocity x, y, z in wander-azimuth axes [m/s]; roll, pitch,
platform heading, wander angle [rad]; body acceleration [m/s^2]; body rate [rad/s]. The heading is platform heading
minus wander angle. Beside it ``smrmsg_*.out`` holds accuracies: 10 doubles, second of week, 1-sigma of position north,
east, down [m], of velocity [m/s], of roll, pitch, heading [arcmin].

Other programs write east, north, up, or axes along north whatever the wander angle; which it is shows in the positions.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np

from schuler import files, frames, units
from schuler.arrays import FloatArray
from schuler.exceptions import FileFormatError, InputError
from schuler.recording.io import checks, lines, parts
from schuler.recording.io.clock import stamps
from schuler.recording.io.hints import ReadHints
from schuler.recording.io.parts import Table
from schuler.recording.recording import Recording
from schuler.timebase import WEEK_S, week_tow

_N, _N_ACCURACY = 17, 10
_RECORD, _ACCURACY = 8 * _N, 8 * _N_ACCURACY
_HINTS = parts.GNSS_HINTS | {"time", "axes"}
_ARCMIN = units.DEG / 60.0
_MOVING = 1.0  # slower than this, positions do not tell the axes of the velocity [m/s]
_MANY = 50_000  # samples that are enough to tell


def sniff(head: bytes, path: Path) -> bool:
    """Whether a file is whole records of plausible positions at increasing times, or named like its accuracies."""
    try:
        size = path.stat().st_size
    except OSError:
        return False
    if path.name.lower().startswith("smrmsg") and size % _ACCURACY == 0 and b"\x00" in head:
        return True
    if size < 2 * _RECORD or (size % _RECORD and path.suffix.lower() not in (".sbet", ".out")):
        return False
    return _plausible(_records(head[: len(head) // _RECORD * _RECORD]))


def holds(path: Path) -> tuple[str, ...]:
    """A reference; the accuracies hold no series of their own."""
    return () if path.name.lower().startswith("smrmsg") else ("reference",)


def read(path: Path, hints: ReadHints) -> Recording:
    """Reference of an SBET file.

    Parameters
    ----------
    path : Path
    hints : ReadHints
        ``time="gps-tow:WEEK"`` (the file has no week); ``series="imu"`` takes its accelerations and rates, which are
        smoothed, and ``series="gnss"`` its positions as fixes, with the accuracies of ``smrmsg_*.out`` beside it;
        ``height``.

    Raises
    ------
    FileFormatError
        If it is cut off (``allow="truncated"`` leaves the rest out), or numbers are missing or impossible.
    """
    parts.check_hints(path, hints, _HINTS, "an SBET file")
    head = lines.check_file(path)
    if path.name.lower().startswith("smrmsg"):
        raise FileFormatError(
            "these are the accuracies of an SBET file and no log: read the sbet_*.out beside it", path
        )
    notes: list[str] = []
    rows = _all(path, _RECORD, hints, notes)
    if not _plausible(_records(head[: len(head) // _RECORD * _RECORD])):
        raise FileFormatError("expected records of 17 doubles: second of week, latitude, longitude [rad], ...", path)

    def fault(message: str, row: int | None) -> FileFormatError:
        return FileFormatError(message if row is None else f"record {row + 1}: {message}", path)

    if not checks.largest(rows) < 1e12:
        bad = np.flatnonzero(~(np.abs(rows) < 1e12).all(axis=1))
        raise fault("a number is missing or impossibly large", int(bad[0]))
    if hints.time is None:
        notes.append("The file has no GPS week: seconds of week are a clock of their own (hint time='gps-tow:WEEK').")
    t, base = stamps(rows[:, 0].copy(), hints.time, fault, notes if hints.time else [])
    t, rows = parts.kept(parts.later(t, "records", path, notes), t, rows)
    values = {"t": t, **_columns(("lat", "lon", "h"), rows[:, 1:4])}
    if hints.series == "imu":
        notes.append("Accelerations and rates of an SBET file are smoothed and corrected, not those of the sensor.")
        columns = dict(zip(("ax", "ay", "az", "gx", "gy", "gz"), rows[:, 11:17].T, strict=True))
        return parts.assemble(path, {"imu": Table({"t": t, **columns})}, hints, base, notes)
    if np.abs(rows[:, 1]).max() > 0.5 * np.pi:
        raise fault("latitude beyond +-90 deg", int(np.argmax(np.abs(rows[:, 1]) > 0.5 * np.pi)))
    values |= _columns(("vn", "ve", "vd"), _velocity(t, rows, notes))
    sources = [path]
    accuracy = _accuracy_beside(path)
    sigma = None
    if accuracy is not None:
        sources.append(accuracy)
        sigma = _sigma(accuracy, rows[:, 0], hints, notes)
    if hints.series == "gnss":
        notes.append(
            "The fixes are a smoothed solution of GNSS and IMU: their errors are correlated in time, and a filter that "
            "takes them as independent is too sure of itself."
        )
        if sigma is not None:
            values |= dict(zip(("sn", "se", "sd", "svn", "sve", "svd"), sigma[:, :6].T, strict=True))
        return parts.assemble(path, {"gnss": Table(values)}, hints, base, notes, sources)
    values |= _columns(("roll", "pitch", "yaw"), rows[:, 7:10])
    values["yaw"] -= rows[:, 10]
    notes.append("The heading is platform heading minus wander angle; heights are taken as ellipsoidal, as is usual.")
    return parts.assemble(path, {"reference": Table(values)}, hints, base, notes, sources)


def _columns(names: tuple[str, str, str], triads: FloatArray) -> dict[str, FloatArray]:
    """Columns of an array of their own, which later steps need not put together again. Shape (n, 3)."""
    return dict(zip(names, triads.copy().T, strict=True))


def _records(data: bytes) -> FloatArray:
    return np.frombuffer(data, dtype="<f8").reshape(-1, _N)


def _plausible(rows: FloatArray) -> bool:
    """Whether records can be of a vehicle on Earth; the first 64 KiB are looked at."""
    if not len(rows) or not np.isfinite(rows).all():
        return False
    t, lat, lon, h = rows[:, :4].T
    limits = (np.abs(t) < 1e7, np.abs(lat) <= 1.5708, np.abs(lon) <= 6.2832, np.abs(h) < 1e6)
    if not all(limit.all() for limit in limits):
        return False
    still = rows[:, 1:4]
    moved = np.abs(np.diff(still, axis=0)).max(initial=0.0) < 1e4
    increasing = np.count_nonzero(np.diff(t) > 0.0) >= 0.9 * (len(t) - 1)
    angles = np.abs(rows[:, 7:11]).max() < 13.0
    return bool(moved and increasing and angles and np.abs(rows[:, 4:7]).max() < 1e5 and np.any(rows[:, 1:3]))


def _all(path: Path, record: int, hints: ReadHints, notes: list[str]) -> FloatArray:
    size = path.stat().st_size
    rest = size % record
    if rest and not hints.allows("truncated"):
        raise FileFormatError(
            f"{size} bytes are {size // record} records of {record} and {rest} more: the file was cut off; "
            "allow='truncated' leaves the rest out",
            path,
        )
    if size < record:
        raise FileFormatError(f"expected records of {record} bytes, got {size} bytes", path)
    if rest:
        notes.append(f"{path.name}: the last record was cut off and left out.")
    rows = np.fromfile(path, dtype="<f8", count=size // record * (record // 8))
    return rows.reshape(-1, record // 8).astype(float, copy=False)


def _velocity(t: FloatArray, rows: FloatArray, notes: list[str]) -> FloatArray:
    """Velocity north, east, down: of the ways to read x, y, z the one that fits the positions. Shape (n, 3)."""
    level: dict[str, Callable[[FloatArray], FloatArray]] = {
        "wander-azimuth axes, x at minus the wander angle": lambda rows: _turned(rows, -1.0),
        "wander-azimuth axes, x at the wander angle": lambda rows: _turned(rows, 1.0),
        "north, east": lambda rows: rows[:, 4:7],
        "east, north": lambda rows: rows[:, [5, 4, 6]],
    }
    first = next(iter(level))
    if len(t) < 3:
        return level[first](rows)
    step = max(1, len(t) // _MANY)
    k = np.arange(step, len(t) - step, step)
    dt = (t[k + step] - t[k - step])[:, None]
    moved = frames.ecef_from_llh(rows[k + step, 1:4]) - frames.ecef_from_llh(rows[k - step, 1:4])
    v_n = np.einsum("nji,nj->ni", frames.C_en(rows[k, 1:4]), moved / dt)
    speed = np.hypot(v_n[:, 0], v_n[:, 1])
    moving = (speed > _MOVING) & (dt[:, 0] < 2.5 * step * np.median(np.diff(t)) + 1e-9)
    if moving.sum() < 10:
        notes.append(f"The vehicle hardly moves: its velocities are taken in {first}; the positions cannot confirm it.")
        return level[first](rows)
    some = rows[k]
    misfit = {}
    for name, turned in level.items():
        off = turned(some) - v_n
        misfit[name] = float(np.median(np.hypot(off[:, 0], off[:, 1])[moving] / speed[moving]))
    best = min(misfit, key=lambda name: (round(misfit[name], 3), list(level).index(name)))
    if misfit[best] > 0.2:
        notes.append(
            f"Velocities fit the positions in no known axes (misfit {misfit[best]:.0%} at best): taken in {first}."
        )
        return level[first](rows)
    z = some[:, 6]
    up = float(np.abs(z - v_n[:, 2])[moving].mean()) > float(np.abs(z + v_n[:, 2])[moving].mean())
    notes.append(f"Velocities are in {best}, z {'up' if up else 'down'}: so they fit the positions.")
    velocity = level[best](rows)
    return velocity * (1.0, 1.0, -1.0) if up else velocity


def _turned(rows: FloatArray, sign: float) -> FloatArray:
    """Velocities north, east, z of those along axes at the wander angle, or at minus it. Shape (n, 3)."""
    wander = rows[:, 10]
    if not wander.any():
        return rows[:, 4:7]
    c, s = np.cos(wander), sign * np.sin(wander)
    x, y = rows[:, 4], rows[:, 5]
    return np.stack((c * x - s * y, c * y + s * x, rows[:, 6]), axis=1)


def _accuracy_beside(path: Path) -> Path | None:
    name = path.name
    for old, new in (("sbet", "smrmsg"), ("SBET", "SMRMSG"), ("sbet", "SMRMSG")):
        if name.startswith(old) and (beside := path.with_name(new + name[len(old) :])).is_file():
            return beside
    return None


def _sigma(path: Path, tow: FloatArray, hints: ReadHints, notes: list[str]) -> FloatArray:
    rows = _all(path, _ACCURACY, hints, notes)
    if not np.isfinite(rows).all() or np.any(np.diff(rows[:, 0]) <= 0.0) or np.any(rows[:, 1:] < 0.0):
        raise FileFormatError("expected increasing times and accuracies that are not negative", path)
    if tow[0] < rows[0, 0] - 1.5 or tow[-1] > rows[-1, 0] + 1.5:
        raise FileFormatError(
            f"accuracies run {rows[0, 0]:.3f}..{rows[-1, 0]:.3f} s, not those of the trajectory", path
        )
    sigma = np.stack([np.interp(tow, rows[:, 0], rows[:, k]) for k in range(1, _N_ACCURACY)], axis=1)
    middle = np.median(sigma, axis=0)
    notes.append(
        f"{path.name}: 1-sigma (median) {np.hypot(middle[0], middle[1]):.3f} m horizontal, {middle[2]:.3f} m vertical, "
        f"{middle[6]:.2f}, {middle[7]:.2f}, {middle[8]:.2f} arcmin in roll, pitch, heading."
    )
    return sigma


def write(recording: Recording, path: Path, accuracy: str | None = None) -> list[Path]:
    """Write the reference as SBET.

    Parameters
    ----------
    recording : Recording
        With a reference that has velocity and attitude. Specific forces and rates of its IMU, if it has one, are
        interpolated to the times of the reference; otherwise they are zero.
    path : Path
    accuracy : str, optional
        Solution file (``solution.parquet``) the recording was read from, whose sigmas go to ``smrmsg_*.out`` beside.

    Returns
    -------
    list of Path
        The file, and the accuracies.

    Raises
    ------
    InputError
        If there is no such reference, or the solution has another number of epochs.

    Notes
    -----
    The wander angle is zero, so velocities are north, east, down and the heading is true. Seconds of week count on over
    the end of a week; a local clock is written as it is. All digits are kept.
    """
    reference = recording.reference
    if reference is None or reference.v_eb_e is None or reference.q_eb is None:
        raise InputError("an SBET file holds a reference with velocity and attitude, and this recording has none")
    base = recording.metadata.time
    shift = 0.0
    if base.scale == "gps":
        week, _ = week_tow(base.epoch_gps_s + float(reference.t[0]))
        shift = base.epoch_gps_s - week * WEEK_S
    rows = np.zeros((len(reference), _N))
    rows[:, 0] = reference.t + shift
    rows[:, 1:4], rows[:, 4:7], rows[:, 7:10] = reference.llh, reference.v_eb_n, reference.rpy_nb
    if recording.imu is not None:
        imu = recording.imu.rates()
        inside = (reference.t >= imu.t[0] - 1e-6) & (reference.t <= imu.t[-1] + 1e-6)
        for at, series in ((11, imu.accel), (14, imu.gyro)):
            for k in range(3):
                rows[:, at + k] = np.where(inside, np.interp(reference.t, imu.t, series[:, k]), 0.0)
    written = [Path(path)]
    if accuracy is not None:
        from schuler.recording.formats.solution import sigmas

        sigma = sigmas(Path(accuracy))
        if len(sigma) != len(rows):
            raise InputError(f"accuracy: {accuracy} has {len(sigma)} epochs, the reference {len(rows)}")
        name = Path(path).name
        beside = f"smrmsg{name[4:]}" if name.lower().startswith("sbet") else f"smrmsg_{Path(path).stem}.out"
        written.append(
            write_accuracy(Path(path).with_name(beside), rows[:, 0], sigma[:, :3], sigma[:, 3:6], sigma[:, 6:])
        )
    with files.replacing(path) as temporary:
        rows.astype("<f8").tofile(temporary)
    return written


def write_accuracy(
    path: Path | str, tow: FloatArray, sigma_r_n: FloatArray, sigma_v_n: FloatArray, sigma_rpy: FloatArray
) -> Path:
    """Write accuracies as ``smrmsg_*.out``.

    Parameters
    ----------
    path : Path or str
    tow : ndarray, shape (n,)
        Second of week, as in the SBET file. [s]
    sigma_r_n, sigma_v_n : ndarray, shape (n, 3)
        1-sigma of position [m] and velocity [m/s], north, east, down.
    sigma_rpy : ndarray, shape (n, 3)
        1-sigma of roll, pitch, heading. [rad]
    """
    rows = np.column_stack((tow, sigma_r_n, sigma_v_n, np.asarray(sigma_rpy) / _ARCMIN))
    with files.replacing(path) as temporary:
        rows.astype("<f8").tofile(temporary)
    return Path(path)
