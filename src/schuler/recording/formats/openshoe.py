"""Logs of the OpenShoe project: the matrix ``u`` of its MATLAB programs, and the text files of its MicroStrain IMU."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from schuler.arrays import FloatArray
from schuler.exceptions import FileFormatError, InputError
from schuler.files import sha256
from schuler.recording.formats import matlab
from schuler.recording.recording import Metadata, Recording
from schuler.recording.series import ImuSeries
from schuler.timebase import TimeBase
from schuler.units import G0

_COLUMNS = 7  # checksum, three accelerations, three rates; ten more are not needed


def read_openshoe_mat(path: Path | str, *, rate_hz: float, variable: str = "u") -> Recording:
    """Read a matrix of six rows: specific force [m/s^2] and angular rate [rad/s], axes forward, right, down.

    Parameters
    ----------
    path : Path or str
    rate_hz : float
        Sampling rate, which the file does not say. ``square2.mat`` was sampled at 100 Hz: the attitude of the device,
        which is in the file too, turns by 0.0102 s times the angular rate from one sample to the next, and the
        settings that came with it say 0.01 s. [Hz]
    variable : str
        Name of the matrix.

    Raises
    ------
    FileFormatError, InputError
        If there is no such matrix, or the rate is impossible.
    """
    path = Path(path)
    if not (np.isfinite(rate_hz) and 1.0 <= rate_hz <= 1e5):
        raise InputError(f"rate_hz: expected a sampling rate of 1 to 1e5 Hz, got {rate_hz!r}")
    contents = matlab.load(path)
    held = ", ".join(k for k in contents if not k.startswith("__"))
    if variable not in contents:
        raise FileFormatError(f"expected a matrix {variable!r}; the file has {held}", path)
    u = np.asarray(contents[variable], dtype=np.float64)
    if u.ndim != 2 or u.shape[0] != 6 or u.shape[1] < 2:
        raise FileFormatError(f"{variable}: expected six rows (force, rate), got the shape {u.shape}", path)
    return _recording(path, np.arange(u.shape[1]) / rate_hz, u[:3].T, u[3:].T, [f"Sampled at {rate_hz:g} Hz as said."])


def read_microstrain_text(path: Path | str, *, rate_hz: float = 250.0) -> Recording:
    """Read ``data_inert.txt`` of an OpenShoe measurement folder.

    Parameters
    ----------
    path : Path or str
        The file, or the folder it is in. Lines at the top that are no rows of numbers are passed over. Columns: a
        hexadecimal checksum, accelerations x, y, z [g], angular rates x, y, z [rad/s], and ten more (counter,
        checksum, number, three time stamps, frequency, magnetic field) that may be missing or nan.
    rate_hz : float
        Sampling rate; the stamps in the file are those of the computer and are not used. [Hz]

    Raises
    ------
    FileFormatError
        With the first line that cannot be read.
    """
    path = Path(path)
    path = path / "data_inert.txt" if path.is_dir() else path
    if not (np.isfinite(rate_hz) and 1.0 <= rate_hz <= 1e5):
        raise InputError(f"rate_hz: expected a sampling rate of 1 to 1e5 Hz, got {rate_hz!r}")
    rows: list[list[float]] = []
    try:
        lines = path.read_text(encoding="ascii", errors="replace").splitlines()
    except OSError as error:
        raise FileFormatError(f"cannot be read: {error.strerror}", path) from None
    for number, text in enumerate(lines, start=1):
        fields = text.split()
        if not fields:
            continue
        try:
            row = [float(field) for field in fields[1:_COLUMNS]]
            if len(row) < _COLUMNS - 1 or not np.isfinite(row).all():
                raise ValueError
        except ValueError:
            if rows:  # the header is over: a broken row would shift all later times
                raise FileFormatError(
                    f"expected a checksum, three accelerations and three rates, got {text[:60]!r}", path, number
                ) from None
            continue
        rows.append(row)
    if len(rows) < 2:
        raise FileFormatError("expected rows of a checksum, three accelerations [g] and three rates [rad/s]", path)
    values = np.array(rows)
    notes = ["Accelerations converted from g.", f"Time counted at {rate_hz:g} Hz; the computer's stamps are not used."]
    return _recording(path, np.arange(len(rows)) / rate_hz, values[:, :3] * G0, values[:, 3:], notes)


def _recording(path: Path, t: FloatArray, accel: FloatArray, gyro: FloatArray, notes: list[str]) -> Recording:
    if not (np.isfinite(accel).all() and np.isfinite(gyro).all()):
        raise FileFormatError("expected finite numbers; a sensor value is NaN or infinite", path)
    return Recording(
        imu=ImuSeries(t, gyro.copy(), accel.copy()),
        metadata=Metadata(
            name=path.stem if path.stem != "data_inert" else path.parent.name, time=TimeBase("local"),
            sources={path.name: sha256(path)}, notes=tuple(notes), options={"format": "openshoe"},
        ),
    )  # fmt: skip
