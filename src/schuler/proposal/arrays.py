"""Arrays without names and times: which is the IMU's; rates, unit and sense of a path by turns and accelerations."""

from __future__ import annotations

import functools
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from schuler.arrays import FloatArray
from schuler.exceptions import SchulerError
from schuler.recording.formats import matlab, numpy_files, pyshoe
from schuler.recording.io import variables
from schuler.units import DEG

#: Files of arrays.
SUFFIXES = (".npy", ".npz", ".mat")
_COLUMNS = (6, 7)  # of an IMU, or with its clock
_FEWEST = 200  # fixes
_STEP = 0.02  # share of its extent that a path may go in one sample
_LENGTH = 8  # fixes over which a course is taken
_MOVES = 0.3  # of the median step: slower is no course
_SIMILAR = (
    0.6  # correlation of turns, and root of the share of accelerations, below which the two do not belong together
)
_NEAR = 0.12  # by which a rate may be off one that receivers have, as a share
_RATES = (1.0, 2.0, 4.0, 5.0, 8.0, 10.0, 20.0, 25.0, 50.0, 100.0, 200.0)
_UNITS = {"rad/s": 1.0, "deg/s": DEG}
_WHOLE = 0.02  # by which a ratio of rates may be off a whole number


@dataclass(frozen=True)
class Relation:
    """How an IMU's array and a path's belong together.

    Attributes
    ----------
    ratio : int
        Samples of the IMU to one of the path.
    rate_hz : float
        Of the path.
    unit : str
        Of angular rate.
    up : bool
        Whether the columns of the path are east, north, up instead of north, east, down.
    evidence : str
    """

    ratio: int
    rate_hz: float
    unit: str
    up: bool
    evidence: str


class Inertial(NamedTuple):
    """Rows of an IMU in a file of arrays.

    Attributes
    ----------
    rows : ndarray, shape (n, k)
    factors : str or None
        Name of the array of factors by which the columns were multiplied.
    by_name : bool
        The rows are specific force and angular rate, by the names of two arrays; else what they are is not known.
    """

    rows: FloatArray
    factors: str | None = None
    by_name: bool = False


def array(path: Path) -> FloatArray | None:
    """Rows of :func:`inertial`; None where that is. Shape (n, k)."""
    held = inertial(path)
    return None if held is None else held.rows


def inertial(path: Path) -> Inertial | None:
    """The array of a ``.npy`` file, or of a ``.npz`` or ``.mat`` file those that are called so, or may be an IMU's.

    Parameters
    ----------
    path : Path

    Returns
    -------
    Inertial or None
        None if it is no such file, or none or several of its arrays have six or seven columns.
    """
    if path.suffix.lower() not in SUFFIXES or not path.is_file():
        return None
    state = path.stat()
    return _inertial(path, state.st_mtime_ns, state.st_size)


@functools.lru_cache(maxsize=2)
def _inertial(path: Path, _changed_ns: int, _size: int) -> Inertial | None:
    """Kept for two files: a log is asked for many columns in turn."""
    kind = path.suffix.lower()
    try:
        with path.open("rb") as stream:  # MATLAB's plain text is a table like others
            if kind == ".mat" and b"\x00" not in stream.read(matlab.HEADER):
                return None
        held = (matlab.read_arrays if kind == ".mat" else numpy_files.read_arrays)(path)
    except (SchulerError, OSError):
        return None
    held = {name: a for name, a in held.items() if a.dtype.kind in "fiu" and a.size}
    if kind == ".npy":
        return _sound(Inertial(_upright(a))) if held and (a := held["array"]).ndim == 2 else None
    if pyshoe.is_pyshoe(path):
        return None
    if (triads := variables.triads_by_name(held)) is not None:
        return None if len({len(x) for x in triads}) > 1 else _sound(Inertial(np.hstack(triads), by_name=True))
    tables = [a for a in held.values() if a.ndim == 2 and min(a.shape) in _COLUMNS and max(a.shape) > min(a.shape)]
    if len(tables) != 1:
        return None
    rows = _upright(tables[0])
    scales = [name for name, a in held.items() if a.size == rows.shape[1] == max(a.shape) and np.all(a > 0.0)]
    if tables[0].dtype.kind == "f" or len(scales) != 1:
        return _sound(Inertial(rows))
    return _sound(Inertial(rows * np.asarray(held[scales[0]], dtype=np.float64).ravel(), scales[0]))


def forget() -> None:
    """Let go of the arrays that :func:`inertial` keeps."""
    _inertial.cache_clear()


def _upright(array: np.ndarray[Any, np.dtype[Any]]) -> FloatArray:
    """Samples along the first axis."""
    return np.asarray(array if array.shape[0] >= array.shape[1] else array.T, dtype=np.float64)


def _sound(held: Inertial) -> Inertial | None:
    return held if np.isfinite(held.rows).all() else None


def is_path(rows: FloatArray) -> bool:
    """Whether three columns go on from sample to sample as positions do.

    Parameters
    ----------
    rows : ndarray, shape (n, k)
    """
    if rows.shape[1] != 3 or len(rows) < _FEWEST:
        return False
    extent = float(np.linalg.norm(np.ptp(rows, axis=0)))
    step = np.linalg.norm(np.diff(rows, axis=0), axis=1)
    return bool(extent > 0.0 and np.quantile(step, 0.99) < _STEP * extent)


def scatter(rows: FloatArray) -> FloatArray:
    """White noise of positions by their fourth differences, which a smooth path has none of. [m], shape (3,)"""
    return np.asarray(1.4826 * np.median(np.abs(np.diff(rows, n=4, axis=0)), axis=0) / np.sqrt(70.0))


def relation(imu: FloatArray, path: FloatArray) -> Relation | None:
    """Relation of an IMU's rows to a path's that begin and end together.

    Parameters
    ----------
    imu : ndarray, shape (n, 6)
        Specific force [m/s^2] and angular rate, in whatever unit and axes.
    path : ndarray, shape (m, 3)
        Positions in a local frame, the third one down or up. [m]

    Returns
    -------
    Relation or None
        None if turns and accelerations of the two do not agree.

    Notes
    -----
    Turns: the course changes by the rate about the plumb line over the sampling rate. Accelerations: second
    differences are specific forces over the sampling rate squared. Both together tell rate and unit.
    """
    ratio = len(imu) / len(path)
    m = round(ratio)
    if m < 1 or abs(ratio - m) > _WHOLE:
        return None
    n = min(len(path), len(imu) // m)
    f, w = imu[: n * m, :3], imu[: n * m, 3:]
    gravity = np.median(f, axis=0)
    down = -gravity / np.linalg.norm(gravity)
    turn = (w @ down).reshape(n, m).mean(axis=1)
    level = (f - np.outer(f @ down, down)).reshape(n, m, 3).mean(axis=1)
    box = np.convolve(np.ones(_LENGTH) / _LENGTH, np.ones(_LENGTH) / _LENGTH)
    p = path[:n, :2]
    going = (p[_LENGTH:] - p[:-_LENGTH]) / _LENGTH
    step = np.linalg.norm(going, axis=1)
    course = np.unwrap(np.arctan2(going[:, 1], going[:, 0]))
    bend = (course[_LENGTH:] - course[:-_LENGTH]) / _LENGTH
    accel = (going[_LENGTH:] - going[:-_LENGTH]) / _LENGTH
    size = len(bend)
    first = slice(1, 1 + size)  # both kernels are centred on the same samples
    w_mean = np.convolve(turn, box, "valid")[first]
    f_mean = np.stack([np.convolve(level[:, k], box, "valid")[first] for k in range(3)], axis=1)
    size = min(size, len(w_mean))
    middle = slice(_LENGTH // 2, _LENGTH // 2 + size)
    moves = step[middle] > _MOVES * np.median(step)
    if moves.sum() < _FEWEST or not np.ptp(bend) or not np.ptp(w_mean):
        return None
    u = going[middle][moves] / step[middle][moves, None]
    a, b, w_mean, f_mean = accel[:size][moves], bend[:size][moves], w_mean[:size][moves], f_mean[:size][moves]
    similar = float(np.corrcoef(w_mean, b)[0, 1])
    design = np.stack((a[:, 1] * u[:, 0] - a[:, 0] * u[:, 1], np.sum(a * u, axis=1), np.ones(len(a))), axis=1)
    fit = np.linalg.lstsq(design, f_mean, rcond=None)[0]
    left = f_mean - design @ fit
    explained = 1.0 - float((left**2).sum() / ((f_mean - f_mean.mean(axis=0)) ** 2).sum())
    if abs(similar) < _SIMILAR or explained < _SIMILAR**2:
        return None
    by_turns = abs(float(w_mean @ w_mean / (w_mean @ b)))  # sampling rate over unit
    by_forces = float(np.sqrt(np.linalg.norm(fit[0])))
    unit = min(_UNITS, key=lambda name: abs(np.log(by_turns * _UNITS[name] / by_forces)))
    rate = min(_RATES, key=lambda hz: abs(np.log(hz / by_forces)))
    if max(abs(np.log(rate / by_forces)), abs(np.log(rate / (by_turns * _UNITS[unit])))) > np.log1p(_NEAR):
        return None
    evidence = (
        f"accelerations of the path are the specific forces at {by_forces:.3g} Hz, its turns the rates at "
        f"{by_turns * _UNITS[unit]:.3g} Hz in {unit} (correlation {abs(similar):.2f})"
    )
    return Relation(m, rate, unit, similar < 0.0, evidence)
