"""Recordings of named arrays, as MATLAB and NumPy files (and foreign Parquet files) hold them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from schuler.arrays import FloatArray
from schuler.exceptions import FileFormatError
from schuler.recording.io.assemble import recording_from
from schuler.recording.io.columns import ACCEL, GYRO, TRIADS
from schuler.recording.io.hint_texts import ColumnSpec, parse_columns, parse_scale
from schuler.recording.io.hints import ReadHints
from schuler.recording.io.raw import Raw
from schuler.recording.recording import Recording

Arrays = Mapping[str, np.ndarray[Any, np.dtype[Any]]]

_ACCEL_NAMES = (
    "accel", "accels", "acc", "accelerometer", "acceleration", "linear_acceleration", "acc_data", "accel_data",
    "imu_acc", "specific_force", "f", "fb", "f_b", "f_ib_b",
)  # fmt: skip
_GYRO_NAMES = (
    "gyro", "gyros", "gyr", "gyroscope", "gyr_data", "gyro_data", "imu_gyr", "omega", "w", "wb", "w_b", "omega_ib_b",
    "angular_rate", "angular_velocity", "angularvelocity",
)  # fmt: skip
_SPELLINGS = {"accel": _ACCEL_NAMES, "gyro": _GYRO_NAMES}
_TIME_NAMES = ("t", "ts", "time", "timestamp", "timestamps", "stamp")
_BOTH_ORDERS = "columns='ax,ay,az,gx,gy,gz' or columns='gx,gy,gz,ax,ay,az,t'"


def recording_of_arrays(path: Path, arrays: Arrays, hints: ReadHints, notes: list[str]) -> Recording:
    """Recording of the arrays of a file.

    Parameters
    ----------
    path : Path
    arrays : mapping of str to ndarray
        Everything numeric in the file; arrays within structures are named ``outer.inner``.
    hints : ReadHints
        ``columns`` names the columns of one array (``variable``, or the only one that fits) in order, or maps names to
        arrays: ``"t=ts,accel=acc,gyro=gyr"``; both may be mixed.
    notes : list of str
        Notes on the file so far.

    Raises
    ------
    FileFormatError
        If arrays are missing, ambiguous or of the wrong shape; the message lists what is in the file.
    """
    arrays = {name: a for name, a in arrays.items() if a.dtype.kind in "fiu" and 1 <= a.ndim <= 2 and a.size > 0}
    with np.errstate(over="ignore"):  # infinite is refused with its row
        wide = {
            name: a.astype(np.float64) for name, a in arrays.items() if a.dtype.kind == "f" and a.dtype.itemsize > 8
        }
    arrays |= wide
    if not arrays:
        raise FileFormatError("there are no arrays of real numbers with one or two axes in the file", path)
    parsed = parse_columns(hints.columns)
    values: dict[str, FloatArray] = {}
    if parsed is None:
        _recognise(path, arrays, hints, values, notes)
    else:
        specs, rest = parsed
        positional = [spec for spec in specs if spec is None or spec.source is None]
        if any(spec is not None for spec in positional):
            _from_matrix(path, arrays, hints, positional, rest, values, notes)
        for spec in specs:
            if spec is not None and spec.source is not None:
                _from_source(path, arrays, spec, values)
    if "t" not in values and hints.rate is None:
        _find_time(arrays, values, notes)
    lengths = {name: len(column) for name, column in values.items()}
    if len(set(lengths.values())) > 1:
        raise FileFormatError(f"expected columns of one length, got {lengths}; {_listing(arrays)}", path)
    if isinstance(parse_scale(hints.scale), str):
        hints = replace(hints, scale=None)
    return recording_from(Raw(path, values, notes=notes), hints)


def _from_matrix(
    path: Path,
    arrays: Arrays,
    hints: ReadHints,
    specs: list[ColumnSpec | None],
    rest: bool,
    values: dict[str, FloatArray],
    notes: list[str],
) -> None:
    """Columns in order of one array, which may lie on its side."""
    n = len(specs)

    def sides(array: np.ndarray[Any, np.dtype[Any]]) -> list[int]:
        """Axes along which the columns may lie; with a rest to skip only the shorter one can be meant."""
        if array.ndim != 2:
            return []
        if rest:
            shorter = int(np.argmin(array.shape))
            return [shorter] if array.shape[shorter] >= n and array.shape[0] != array.shape[1] else []
        return [axis for axis in (0, 1) if array.shape[axis] == n]

    if hints.variable is not None:
        name = _named(path, arrays, hints.variable)
    else:
        fitting = [name for name, array in arrays.items() if sides(array) and name != parse_scale(hints.scale)]
        if "imu" in fitting:
            fitting = ["imu"]
        if len(fitting) != 1:
            what = "no array has" if not fitting else f"{', '.join(fitting)} have"
            raise FileFormatError(
                f"columns names {n} columns, and {what} as many: say variable='...'; {_listing(arrays)}", path
            )
        name = fitting[0]
    array = arrays[name]
    axes = sides(array)
    if array.ndim == 1 and n == 1:
        table = np.asarray(array, dtype=np.float64)[:, None]
    elif len(axes) != 1:
        raise FileFormatError(
            f"{name} has the shape {array.shape}, which does not tell its {n} columns ({hints.columns}) from its rows",
            path,
        )
    else:
        table = np.asarray(array if axes[0] == 1 else array.T, dtype=np.float64)
    scale = parse_scale(hints.scale)
    if isinstance(scale, str):
        factors = np.asarray(arrays[_named(path, arrays, scale)], dtype=np.float64).ravel()
        if len(factors) != table.shape[1]:
            raise FileFormatError(
                f"scale: {scale} holds {len(factors)} factors for {table.shape[1]} columns of {name}", path
            )
        table = table * factors
        notes.append(f"The columns of {name} were multiplied by {scale}.")
    values |= {spec.name: table[:, k].copy() for k, spec in enumerate(specs) if spec is not None}


def _from_source(path: Path, arrays: Arrays, spec: ColumnSpec, values: dict[str, FloatArray]) -> None:
    """One column, or three under the names accel and gyro, of an array of their own."""
    name = _named(path, arrays, spec.source or "")
    array = np.asarray(arrays[name], dtype=np.float64)
    if spec.name in TRIADS:
        values |= dict(zip(TRIADS[spec.name], _triad(path, name, array).T.copy(), strict=True))
    elif array.size == max(array.shape):
        values[spec.name] = array.ravel()
    else:
        raise FileFormatError(f"{spec.name}={name}: expected a vector, got the shape {array.shape}", path)


def _triad(path: Path, name: str, array: FloatArray) -> FloatArray:
    if array.ndim != 2 or sum(size == 3 for size in array.shape) != 1:
        raise FileFormatError(f"{name}: expected N x 3 or 3 x N values, got the shape {array.shape}", path)
    return array if array.shape[1] == 3 else array.T


def _recognise(path: Path, arrays: Arrays, hints: ReadHints, values: dict[str, FloatArray], notes: list[str]) -> None:
    """Separate arrays of accelerometer and gyro by their names; anything else has to be said."""
    if hints.variable is not None or any(_is_imu_matrix(name, array) for name, array in arrays.items()):
        raise FileFormatError(
            f"the order of the columns of {hints.variable or 'imu'} is not known, and both are common: say "
            f"{_BOTH_ORDERS}; {_listing(arrays)}",
            path,
        )
    if len(arrays) == 1 and all(3 in a.shape and _last(n) not in _ACCEL_NAMES + _GYRO_NAMES for n, a in arrays.items()):
        raise FileFormatError(
            f"of three columns it is not known what they are: say columns='gx,gy,gz' (angular rate) or "
            f"columns='ax,ay,az' (specific force); {_listing(arrays)}",
            path,
        )
    for triad, spellings in _SPELLINGS.items():
        fitting = _called(arrays, spellings)
        if len(fitting) != 1:
            what = (
                f"no array of three columns is called {triad}" if not fitting
                else f"{triad} may be any of {', '.join(fitting)}"
            )  # fmt: skip
            raise FileFormatError(
                f"{what}: say columns='t=...,accel=...,gyro=...' with the names of arrays, or "
                f"variable='...' and {_BOTH_ORDERS}; {_listing(arrays)}",
                path,
            )
        names = ACCEL if triad == "accel" else GYRO
        array = np.asarray(arrays[fitting[0]], dtype=np.float64)
        values |= dict(zip(names, _triad(path, fitting[0], array).T.copy(), strict=True))
        notes.append(f"{triad} was taken from the array {fitting[0]}.")


def triads_by_name(arrays: Arrays) -> tuple[FloatArray, FloatArray] | None:
    """Specific force and angular rate by the names of their arrays, None unless there is one of each. Shapes (n, 3)."""
    called = [_called(arrays, spellings) for spellings in _SPELLINGS.values()]
    if any(len(names) != 1 or arrays[names[0]].shape == (3, 3) for names in called):
        return None
    accel, gyro = (np.asarray(arrays[name], dtype=np.float64) for [name] in called)
    return (accel if accel.shape[1] == 3 else accel.T), (gyro if gyro.shape[1] == 3 else gyro.T)


def _called(arrays: Arrays, spellings: Sequence[str]) -> list[str]:
    """Names of the arrays of three columns that are spelled so."""
    return [n for n, a in arrays.items() if _last(n) in spellings and a.ndim == 2 and 3 in a.shape]


def _find_time(arrays: Arrays, values: dict[str, FloatArray], notes: list[str]) -> None:
    n = len(next(iter(values.values())))
    fitting = [name for name, a in arrays.items() if _last(name) in _TIME_NAMES and a.size == n == max(a.shape)]
    if len(fitting) == 1:
        values["t"] = np.asarray(arrays[fitting[0]], dtype=np.float64).ravel()
        notes.append(f"Time was taken from the array {fitting[0]}.")


def _is_imu_matrix(name: str, array: np.ndarray[Any, np.dtype[Any]]) -> bool:
    return _last(name) == "imu" and array.ndim == 2 and any(size in (6, 7) for size in array.shape)


def _last(name: str) -> str:
    return name.rpartition(".")[2].lower()


def _named(path: Path, arrays: Arrays, name: str) -> str:
    if name not in arrays:
        raise FileFormatError(f"there is no array {name!r}; {_listing(arrays)}", path)
    return name


def _listing(arrays: Arrays) -> str:
    shapes = [f"{name} ({' x '.join(map(str, array.shape))})" for name, array in arrays.items()]
    return "the file holds " + ", ".join(shapes[:30]) + (", ..." if len(shapes) > 30 else "")
