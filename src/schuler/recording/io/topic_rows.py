"""Messages of ROS 2 as ``ros2 topic echo --csv`` prints them: every field of a message in its order, and no header.

sensor_msgs/Imu: seconds, nanoseconds, frame; orientation x, y, z, w, covariance; angular velocity [rad/s], covariance;
linear acceleration [m/s^2], covariance. sensor_msgs/NavSatFix: seconds, nanoseconds, frame; status, service; latitude,
longitude [deg], altitude above the ellipsoid [m]; covariance along east, north, up [m^2], and its kind.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from pathlib import Path

from schuler.recording.io import line_forms, lines

_GYRO, _ACCEL = range(16, 19), range(28, 31)
_PLACE, _VARIANCES, _KIND = range(5, 8), (12, 8, 16), 17  # north, east, up
_IMU, _FIX = 40, 18  # fields
_NEARLY_ALL = 0.9


def are_messages(rows: Sequence[str]) -> bool:
    """Whether nearly all lines are such messages of one kind.

    Parameters
    ----------
    rows : sequence of str
    """
    fields = [line_forms.fields_of(row, ",") for row in rows]
    widths = [len(row) for row in fields if _is_message(row)]
    return len(widths) > _NEARLY_ALL * len(rows) and len(set(widths)) == 1


def _is_message(fields: Sequence[str]) -> bool:
    if len(fields) not in (_IMU, _FIX) or lines.is_number(fields[2]) or not all(map(_is_count, fields[:2])):
        return False
    counts = (
        _is_count(fields[3].removeprefix("-")) and all(_is_count(fields[k]) for k in (4, _KIND))
        if len(fields) == _FIX
        else True
    )
    return int(fields[1]) < 10**9 and counts and all(map(lines.is_number, fields[3:]))


def _is_count(field: str) -> bool:
    """Whether a field is a whole number of as many digits as seconds and nanoseconds have, or fewer."""
    return field.isascii() and field.isdigit() and len(field) < 12


def message_rows(path: Path) -> Iterator[tuple[str, line_forms.Row]]:
    """Samples and fixes with one stamp; fixes have 1-sigma where their covariance is known.

    Parameters
    ----------
    path : Path
    """
    for text in line_forms.text_of(path):
        fields = line_forms.fields_of(text, ",")
        if not _is_message(fields):
            yield "", {}
            continue
        row = {"timestamp [ns]": f"{int(fields[0])}{int(fields[1]):09d}"}
        if len(fields) == _IMU:
            names = (*(f"gyro_{c} [rad/s]" for c in "xyz"), *(f"accel_{c} [m/s^2]" for c in "xyz"))
            yield "imu", row | dict(zip(names, (fields[k] for k in (*_GYRO, *_ACCEL)), strict=True))
            continue
        row |= dict(zip(("lat [deg]", "lon [deg]", "h [m]"), (fields[k] for k in _PLACE), strict=True))
        if fields[_KIND] != "0":
            sigmas = (math.sqrt(max(float(fields[k]), 0.0)) for k in _VARIANCES)
            row |= {f"{name} [m]": f"{sigma:.6g}" for name, sigma in zip(("sn", "se", "sd"), sigmas, strict=True)}
        yield "fix", row if int(fields[3]) >= 0 else {}  # -1: no fix
