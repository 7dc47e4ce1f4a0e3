"""Segments of comma2k19: folders of NumPy arrays ``t`` and ``value`` under ``processed_log``, poses in ``global_pose``.

IMU axes are forward-right-down, stamps seconds since boot. Poses are those of the camera, Earth-fixed. By the data
set's README (Schafer et al., A Commute in Data: The comma2k19 Dataset, arXiv:1812.05752).
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from schuler import rotation, units
from schuler.arrays import FloatArray
from schuler.exceptions import FileFormatError
from schuler.recording.io import parts
from schuler.recording.io.checks import unit_quaternions
from schuler.recording.io.clock import from_gps
from schuler.recording.io.hint_texts import parse_streams
from schuler.recording.io.hints import ReadHints
from schuler.recording.io.over_ground import velocities
from schuler.recording.io.parts import Table
from schuler.recording.io.streams import Stream, choose, joined
from schuler.recording.recording import Recording
from schuler.timebase import WEEK_S, TimeBase

_HINTS = parts.GNSS_HINTS | {"axes", "streams", "sigma_speed"}
_ACCELS = ("accelerometer", "acceleration")
_GYROS = ("gyro", "gyro_uncalibrated")
_FIXES = ("live_gnss_ublox", "live_gnss_qcom")


def sniff(head: bytes, path: Path) -> bool:
    """No file is a segment."""
    return False


def sniff_folder(path: Path) -> bool:
    """Whether a folder has specific forces where a segment has them."""
    return any((path / "processed_log" / "IMU" / name / "value").is_file() for name in _ACCELS)


def read(path: Path, hints: ReadHints) -> Recording:
    """IMU, fixes, wheel speed and poses of a segment.

    Parameters
    ----------
    path : Path
        The segment, which holds ``processed_log``.
    hints : ReadHints
        ``sigma`` for the fixes and ``sigma_speed`` for the wheels: they have no accuracies and are left out without;
        ``streams="imu=gyro_uncalibrated,gnss=live_gnss_qcom"``; ``height``.

    Raises
    ------
    FileFormatError
        If an array is missing, damaged or of the wrong shape.
    """
    parts.check_hints(path, hints, _HINTS, "a segment of comma2k19")
    log, pose = path / "processed_log", path / "global_pose"
    if not pose.is_dir():
        pose = path / "global_pos"
    accel = next((log / "IMU" / name for name in _ACCELS if (log / "IMU" / name / "value").is_file()), None)
    if accel is None:
        raise FileFormatError("expected processed_log/IMU/accelerometer with the arrays t and value", path)
    notes: list[str] = []
    sources: list[Path] = []
    chosen = parse_streams(hints.streams)
    gyro = _choose(log / "IMU", _GYROS, "imu", chosen)
    if gyro is None:
        raise FileFormatError("expected processed_log/IMU/gyro with the arrays t and value", path)
    t_a, f = _pair(accel, 3, notes, sources)
    t_g, w = _pair(log / "IMU" / gyro, 3, notes, sources)
    notes.append(f"Rates are {gyro}" + (", with the bias that Android estimated taken out." if gyro == "gyro" else "."))
    tables = {"imu": Table(joined(t_a, f, t_g, w, path, notes))}
    fixes = _choose(log / "GNSS", _FIXES, "gnss", chosen)
    if fixes is not None and hints.sigma is None:
        notes.append(f"{fixes} has no accuracies and was left out: hint sigma, 'N,E,D' in metres.")
    elif fixes is not None:
        t, rows = _pair(log / "GNSS" / fixes, 6, notes, sources)
        place = {"lat": rows[:, 0] * units.DEG, "lon": rows[:, 1] * units.DEG, "h": rows[:, 4]}
        notes.append(f"Fixes are {fixes}.")
        course = rows[:, 5] * units.DEG
        place |= velocities(t, (place["lat"], place["lon"]), rows[:, 2], course, (None, None), notes)
        tables["gnss"] = Table({"t": t, **place}, ellipsoidal=False)
    speed = log / "CAN" / "speed"
    if (speed / "value").is_file() and chosen.get("odometer", "") is not None:
        if hints.sigma_speed is None:
            notes.append("The wheel speed has no accuracy and was left out: hint sigma_speed [m/s].")
        else:
            t, rows = _pair(speed, 1, notes, sources)
            tables["odometer"] = Table({"t": t, "speed": rows[:, 0]})
    if (pose / "frame_positions").is_file() and chosen.get("reference", "") is not None:
        tables["reference"] = _poses(pose, notes, sources)
    base = TimeBase("local")
    if (pose / "frame_gps_times").is_file():
        base, shift = _gps(pose, notes, sources)
        for name, table in tables.items():
            tables[name] = replace(table, values={**table.values, "t": table.values["t"] + shift})
    else:
        notes.append("Stamps are seconds since the device was switched on.")
    return parts.assemble(path, tables, hints, base, notes, sources, path)


def _choose(folder: Path, names: tuple[str, ...], part: str, chosen: dict[str, str | None]) -> str | None:
    present = [Stream(name, "array", 1, part=part) for name in names if (folder / name / "value").is_file()]
    stream = choose(present if part in chosen else present[:1], part, chosen)
    return None if stream is None else stream.name


def _pair(folder: Path, columns: int, notes: list[str], sources: list[Path]) -> tuple[FloatArray, FloatArray]:
    """Increasing times and values of a quantity, rows that are not numbers left out."""
    t, value = _load(folder / "t", sources), _load(folder / "value", sources)
    value = value.reshape(len(value), -1) if value.ndim else value.reshape(0, 1)
    if t.ndim != 1 or len(t) != len(value) or value.shape[1] != columns:
        raise FileFormatError(
            f"expected n times and n x {columns} values, got the shapes {t.shape} and {value.shape}", folder
        )
    if not len(t):
        raise FileFormatError("the arrays are empty", folder)
    keep = parts.later(t, folder.name, folder, notes)
    return t[keep], value[keep]


def _load(path: Path, sources: list[Path]) -> FloatArray:
    """Array of a NumPy file whose size fits its header, which is checked before anything is allocated."""
    try:
        size = path.stat().st_size
        with path.open("rb") as stream:
            version = np.lib.format.read_magic(stream)
            reader: Any = {(1, 0): np.lib.format.read_array_header_1_0, (2, 0): np.lib.format.read_array_header_2_0}
            shape, fortran, dtype = reader[version](stream)
            count = 1
            for length in shape:
                count *= int(length)
            if dtype.hasobject or dtype.kind not in "fiu" or len(shape) > 2 or count < 0:
                raise ValueError(f"an array of {dtype} with the shape {shape}")
            if size - stream.tell() != count * dtype.itemsize:
                raise ValueError(f"{size - stream.tell()} bytes for {count} numbers of {dtype.itemsize}")
            values = np.frombuffer(stream.read(), dtype=dtype).reshape(shape, order="F" if fortran else "C")
    except Exception as error:  # a damaged header makes NumPy's parser fail in ways that are not listed anywhere
        raise FileFormatError(f"cannot be read as a NumPy array ({error}); is it complete?", path) from error
    sources.append(path)
    return np.asarray(values, dtype=np.float64)


def _poses(folder: Path, notes: list[str], sources: list[Path]) -> Table:
    t = _load(folder / "frame_times", sources)
    r = _load(folder / "frame_positions", sources)
    if t.ndim != 1 or r.shape != (len(t), 3) or not len(t):
        raise FileFormatError(f"expected n times and n x 3 positions, got {t.shape} and {r.shape}", folder)
    values = {"t": t, **dict(zip("xyz", r.T, strict=True))}
    v = _load(folder / "frame_velocities", sources) if (folder / "frame_velocities").is_file() else None
    if v is not None and v.shape == r.shape:
        values |= dict(zip(("vx", "vy", "vz"), v.T, strict=True))
    q = _load(folder / "frame_orientations", sources) if (folder / "frame_orientations").is_file() else None
    if q is not None and q.shape == (len(t), 4) and v is not None and v.shape == r.shape:
        q = unit_quaternions(q, lambda row, text: FileFormatError(f"frame_orientations {row + 1}: {text}", folder))
        # documented as Earth-fixed to camera, used as camera to Earth-fixed: a car drives forward
        both = (rotation.quat_conjugate(q), q)
        forward = [float(rotation.rotate(turn, v)[:, 0].sum()) for turn in both]
        if forward[1] > forward[0]:
            q = rotation.quat_conjugate(q)
            notes.append("Orientations are turns from Earth-fixed to camera axes: so the car drives forward.")
        values |= dict(zip(("qw", "qx", "qy", "qz"), q.T, strict=True))
    keep = parts.later(t, "poses", folder, notes)
    notes.append("The reference is the path of the camera, not of the IMU.")
    return Table({name: np.ascontiguousarray(column[keep]) for name, column in values.items()})


def _gps(folder: Path, notes: list[str], sources: list[Path]) -> tuple[TimeBase, float]:
    """Time base and the seconds to add to stamps since boot, from the pairs of both that the poses have."""
    t, pairs = _load(folder / "frame_times", sources), _load(folder / "frame_gps_times", sources)
    if t.ndim != 1 or pairs.shape != (len(t), 2) or not len(t) or not np.isfinite(pairs).all():
        raise FileFormatError(f"frame_gps_times: expected n x 2 (week, second), got the shape {pairs.shape}", folder)
    gps = pairs[:, 0] * WEEK_S + pairs[:, 1]
    if not 0.0 < gps.min() <= gps.max() < 4.0e9:
        raise FileFormatError("frame_gps_times: expected GPS weeks and seconds of week", folder)
    relative, base = from_gps(gps)
    offsets = relative - t
    shift = float(np.median(offsets))
    notes.append(
        f"Stamps since boot were brought to GPS time by the poses' own pairs, which differ by up to "
        f"{np.abs(offsets - shift).max() * 1e3:.3g} ms from one offset."
    )
    return base, shift
