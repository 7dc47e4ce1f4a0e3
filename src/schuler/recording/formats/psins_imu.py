"""IMU logs in the text form of PSINS (``.imu``): counts of increments with the weight of a count in the header.

The header is comments with ``%`` and three lines: initial attitude and velocity; latitude, longitude [deg], height [m],
start [s], interval [ms], gravity; weights of a count, gyros in arc seconds and accelerometers in micro-g seconds.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from schuler import units
from schuler.arrays import FloatArray
from schuler.exceptions import FileFormatError, InputError
from schuler.recording.io import checks
from schuler.recording.io.assemble import metadata_of
from schuler.recording.io.clock import stamps
from schuler.recording.io.hint_texts import axes_matrix
from schuler.recording.io.hints import ReadHints
from schuler.recording.io.lines import check_file, encoding_of
from schuler.recording.recording import Recording
from schuler.recording.series import ImuSeries

_TITLE = b"PSINS-format"
_USED = {"axes", "time", "offset", "name", "series", "allow"}
_AXES = "RFU"


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
    if surplus := sorted(set(hints.given()) - _USED):
        raise InputError(f"{path} is a PSINS log and says this itself; leave out {', '.join(surplus)}")
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
