"""Raw IMU files of Waypoint Inertial Explorer (``.imr``): a header of 512 bytes and records of 32.

The header begins with ``$IMURAW``; it says byte order, whether counts are rates or increments, their scales (degrees,
metres), the rate and which time the stamps are. Records: second of week, three gyro counts, three accelerometer counts.
Layout by NovAtel's Waypoint manual, appendix IMR File (OM-20000166).
"""

from __future__ import annotations

from pathlib import Path
from typing import Any, Literal

import numpy as np

from schuler import files, units
from schuler.arrays import FloatArray
from schuler.exceptions import FileFormatError, InputError
from schuler.recording.io import checks, lines, parts
from schuler.recording.io.clock import stamps
from schuler.recording.io.hint_texts import axes_matrix, parse_time
from schuler.recording.io.hints import ReadHints
from schuler.recording.io.parts import Table
from schuler.recording.recording import Recording
from schuler.timebase import WEEK_S, calendar, leap_seconds, week_tow

_MAGIC = b"$IMURAW"
_FIELDS = [
    ("magic", "S8"), ("big", "i1"), ("version", "f8"), ("delta_theta", "i4"), ("delta_velocity", "i4"), ("rate", "f8"),
    ("gyro_scale", "f8"), ("accel_scale", "f8"), ("utc_or_gps", "i4"), ("receiver_time", "i4"), ("bias", "f8"),
    ("imu", "S32"), ("reserved1", "V4"), ("program", "S32"), ("created", "V12"), ("lever_valid", "i1"),
    ("lever_mm", "i4", (3,)), ("reserved2", "V354"),
]  # fmt: skip
_HEADER = np.dtype(_FIELDS)
_RECORD = np.dtype([("t", "f8"), ("gyro", "i4", (3,)), ("accel", "i4", (3,))])
_HINTS = {"axes", "time"}
_AXES = "RFU"
_BLOCK = 65_536  # records


def sniff(head: bytes, path: Path) -> bool:
    """Whether a file begins with the mark of the format."""
    return head.startswith(_MAGIC)


def holds(path: Path) -> tuple[str, ...]:
    """An IMU."""
    return ("imu",)


def read(path: Path, hints: ReadHints) -> Recording:
    """IMU series of an IMR file.

    Parameters
    ----------
    path : Path
    hints : ReadHints
        ``time="gps-tow:WEEK"`` (the file has no week; stamps in UTC seconds of week get the leap seconds of it);
        ``axes`` other than right-forward-up.

    Raises
    ------
    FileFormatError
        If the header is impossible, or the file was cut off.
    """
    parts.check_hints(path, hints, _HINTS, "an IMR file")
    lines.check_file(path)
    size = path.stat().st_size
    if size < _HEADER.itemsize:
        raise FileFormatError(f"expected a header of {_HEADER.itemsize} bytes, got {size}: the file was cut off", path)
    with path.open("rb") as stream:
        raw = stream.read(_HEADER.itemsize)
    if raw[8] not in (0, 1):
        raise FileFormatError(f"expected byte order 0 or 1 at offset 8, got {raw[8]}", path)
    order: Literal["<", ">"] = ">" if raw[8] else "<"
    header = np.frombuffer(raw, dtype=_HEADER.newbyteorder(order))[0]
    _check(header, path)
    records, rest = divmod(size - _HEADER.itemsize, _RECORD.itemsize)
    notes: list[str] = []
    if rest and not hints.allows("truncated"):
        raise FileFormatError(
            f"{rest} bytes are left over after {records} records: the file was cut off; allow='truncated' passes", path
        )
    if rest:
        notes.append("The last record was cut off and left out.")
    if not records:
        raise FileFormatError("there are no records behind the header", path)
    dtype = _RECORD.newbyteorder(order)
    rows = np.fromfile(path, dtype=dtype, count=records, offset=_HEADER.itemsize)

    def fault(message: str, row: int | None) -> FileFormatError:
        return FileFormatError(message if row is None else f"record {row + 1}: {message}", path)

    t = rows["t"].astype(np.float64)
    if not checks.largest(t) < 1e9:
        bad = np.flatnonzero(~(np.abs(t) < 1e9))
        raise fault(f"impossible time {t[bad[0]]:g}", int(bad[0]))
    if header["bias"]:
        notes.append(f"The header's time-tag bias of {header['bias']:g} s was not applied (hint offset does).")
    t, base = stamps(t, hints.time, fault, notes)
    if header["utc_or_gps"] == 1:
        if parse_time(hints.time).kind == "gps-tow":
            leaps = leap_seconds(calendar(base.epoch_gps_s + float(t[0])).date())
            t = t + leaps
            notes.append(f"Stamps are UTC seconds of week; {leaps} leap seconds were added.")
        else:
            notes.append("Stamps are UTC seconds of week, without the week.")
    keep = parts.later(t, "records", path, notes)
    rate = float(header["rate"])
    if not keep.all():
        t, rows = t[keep], rows[keep]
    w = _scaled(rows["gyro"], float(header["gyro_scale"]) * units.DEG)
    f = _scaled(rows["accel"], float(header["accel_scale"]))
    increments = bool(header["delta_theta"]), bool(header["delta_velocity"])
    if increments[0] != increments[1]:
        which = ("rates", "specific forces") if increments[1] else ("specific forces", "rates")
        w = w if increments[0] else w / rate
        f = f if increments[1] else f / rate
        notes.append(f"The file has {which[0]} beside increments; they were made increments at {rate:g} Hz too.")
    notes.append(
        f"{_text(header['imu']) or 'IMU'}: {rate:g} Hz, a gyro count is {float(header['gyro_scale']):.6g} deg"
        f"{'' if increments[0] else '/s'}, an accelerometer count {float(header['accel_scale']):.6g} m/s"
        f"{'' if increments[1] else '^2'}; written by {_text(header['program']) or 'an unnamed program'}."
    )
    if header["lever_valid"]:
        arm = (header["lever_mm"].astype(float) / 1000.0).tolist()
        notes.append(f"The header's lever arm to the antenna is {arm} m in axes of the IMU.")
    if hints.axes is None:
        notes.append("Axes are taken as right, forward, up, as Waypoint has them (hint axes says otherwise).")
    kind = "increment" if any(increments) else "rate"
    columns = dict(zip(("gx", "gy", "gz", "ax", "ay", "az"), (*w.T, *f.T), strict=True))
    table = Table({"t": t, **columns}, axes=_AXES, kind=kind)  # type: ignore[arg-type]
    return parts.assemble(path, {"imu": table}, hints, base, notes)


def _scaled(counts: np.ndarray, unit: float) -> FloatArray:
    """Counts, in whatever byte order, times their unit, without a copy of them all. Shape (n, 3)."""
    values = np.empty(counts.shape)
    for start in range(0, len(counts), _BLOCK):
        np.multiply(counts[start : start + _BLOCK], unit, out=values[start : start + _BLOCK])
    return values


def _check(header: Any, path: Path) -> None:
    rate, gyro, accel = (float(header[name]) for name in ("rate", "gyro_scale", "accel_scale"))
    if not (0.1 <= rate <= 1e5 and 0.0 < abs(gyro) < 1e3 and 0.0 < abs(accel) < 1e3):
        raise FileFormatError(
            f"expected a rate and two scales, got {rate:g} Hz, {gyro:g} and {accel:g}: the header is damaged", path
        )
    if not (header["delta_theta"] in (0, 1) and header["delta_velocity"] in (0, 1) and abs(header["bias"]) < 1e6):
        raise FileFormatError("expected 0 or 1 for rates or increments: the header is damaged", path)


def _text(raw: bytes) -> str:
    return "".join(c for c in raw.split(b"\x00")[0].decode("latin-1") if c.isprintable()).strip()


def write(recording: Recording, path: Path) -> list[Path]:
    """Write the IMU as increments, right-forward-up, for Inertial Explorer.

    Parameters
    ----------
    recording : Recording
        On GPS time (stamps are seconds of week) or a local clock.
    path : Path

    Returns
    -------
    list of Path
        The file.

    Raises
    ------
    InputError
        If there is no IMU.

    Notes
    -----
    Counts are chosen so that the largest increment takes 2^30 of them: the resolution is a billionth of it.
    """
    inc = recording.need_imu().increments()
    C_bs = axes_matrix(_AXES)
    header = np.zeros(1, dtype=_HEADER.newbyteorder("<"))
    rows = np.zeros(len(inc), dtype=_RECORD.newbyteorder("<"))
    base = recording.metadata.time
    shift = 0.0
    if base.scale == "gps":
        shift = base.epoch_gps_s - week_tow(base.epoch_gps_s + float(inc.t[0]))[0] * WEEK_S
    rows["t"] = inc.t + shift
    for name, scale, values in (
        ("gyro", "gyro_scale", inc.dtheta_ib_b @ C_bs / units.DEG), ("accel", "accel_scale", inc.dv_ib_b @ C_bs),
    ):  # fmt: skip
        count = max(float(np.abs(values).max()), 1e-12) / 2.0**30
        header[scale] = count
        rows[name] = np.round(values / count).astype(np.int32)
    rate = 1.0 / float(np.median(inc.dt))
    if not np.isfinite(rate):
        raise InputError("the IMU has no sampling rate")
    header["magic"], header["version"], header["delta_theta"], header["delta_velocity"] = _MAGIC, 8.8, 1, 1
    header["rate"], header["utc_or_gps"] = rate, 2 if base.scale == "gps" else 0
    header["imu"], header["program"] = recording.metadata.name.encode("ascii", "replace")[:31], b"schuler"
    with files.replacing(path) as temporary, temporary.open("wb") as stream:
        stream.write(header.tobytes())
        stream.write(rows.tobytes())
    return [Path(path)]
