"""From tables in SI to a recording with all the checks, for formats that say themselves what their numbers are."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any, Literal

import numpy as np

from schuler.arrays import FloatArray
from schuler.exceptions import FileFormatError
from schuler.files import hashed
from schuler.recording.io import columns
from schuler.recording.io.assemble import series_from
from schuler.recording.io.hints import ReadHints
from schuler.recording.io.raw import Raw
from schuler.recording.recording import Metadata, Recording
from schuler.timebase import TimeBase

#: Hints that mean something for every format with these series.
COMMON = frozenset({"name", "series", "format", "offset", "allow", "rest", "truth_fixes"})
GNSS_HINTS = frozenset({"height", "geoid_separation", "sigma"})
_SI = {"t": "s", "accel": "m/s^2", "gyro": "rad/s", "temp": "degC", "angle": "rad", "length": "m", "velocity": "m/s"}
_SI_INCREMENT = {**_SI, "accel": "m/s", "gyro": "rad"}
_MANY = 0.01  # share of samples out of order that is no accident


@dataclass(frozen=True)
class Table:
    """Columns of one series in SI, by the names of :data:`schuler.recording.io.columns.GROUP`.

    Attributes
    ----------
    values : dict of str to ndarray, shape (n,)
        ``t`` on the time base of the recording [s]; angles in radians. GNSS covariances may be given as ``sn se sd``
        [m] and ``cne cnd ced`` [m^2] (``svn`` .. and ``cvne`` .. of velocity). A reference takes ``lat lon h`` with
        ``vn ve vd`` and ``roll pitch yaw``, or ``x y z`` with ``vx vy vz`` and ``qw qx qy qz`` (body to Earth-fixed
        axes).
    axes : str
        Axes the IMU's columns are in, unless the hint ``axes`` says otherwise.
    kind : {"rate", "increment"}
        Kind of an IMU's samples.
    ellipsoidal : bool
        Whether heights are known to be above the ellipsoid; otherwise a note says that they are taken as such.
    """

    values: dict[str, FloatArray]
    axes: str = "FRD"
    kind: Literal["rate", "increment"] = "rate"
    ellipsoidal: bool = True


def assemble(
    path: Path,
    tables: Mapping[str, Table],
    hints: ReadHints,
    time: TimeBase,
    notes: Iterable[str] = (),
    sources: Iterable[Path] | None = None,
    root: Path | None = None,
) -> Recording:
    """Recording of tables in SI, with every check that text logs get.

    Parameters
    ----------
    path : Path
        For messages and the name.
    tables : mapping of str to Table
        By series: "imu", "gnss", "odometer", "heading", "height", "reference".
    hints : ReadHints
        ``axes``, ``height``, ``geoid_separation``, ``sigma``, ``sigma_speed``, ``sigma_height``, ``offset``, ``rest``
        and ``allow`` count.
    time : TimeBase
        Meaning of the times.
    notes : iterable of str
        Notes of the reader so far.
    sources : iterable of Path, optional
        The files read, default ``path`` itself.
    root : Path, optional
        Folder from which on they are named, where several may be called alike.

    Raises
    ------
    FileFormatError, InputError
        If there is no table, or as :func:`schuler.recording.io.assemble.recording_from` does.
    """
    if not tables:
        raise FileFormatError("the log holds none of the series that are read", path)
    made: dict[str, Any] = {}
    all_notes = list(notes)
    axes = "FRD"
    with hashed((path,) if sources is None else sources, root) as hashes:
        for series, table in tables.items():
            made[series], own_notes = series_of(path, series, table, hints, time)
            axes = axes_of(table, hints) if series == "imu" else axes
            all_notes += [note for note in own_notes if note not in all_notes]
        named = hashes()
    metadata = Metadata(
        name=hints.name or path.stem,
        time=time,
        sources=named,
        axes=axes,
        notes=tuple(all_notes),
        options=hints.given(),
    )
    return Recording(**made, metadata=metadata)


def axes_of(table: Table, hints: ReadHints) -> str:
    """Axes of an IMU: those of the hint, else those of its table."""
    return (hints.axes or table.axes).upper()


def series_of(path: Path, series: str, table: Table, hints: ReadHints, time: TimeBase) -> tuple[Any, list[str]]:
    """Series of a table in SI, and notes on what was done, with the arguments and errors of :func:`assemble`."""
    unit = _SI_INCREMENT if table.kind == "increment" else _SI
    stated = {name: unit[group] for name in table.values if (group := columns.GROUP[name]) is not None}
    values = {name: np.asarray(value, dtype=np.float64) for name, value in table.values.items()}
    raw = Raw(path, values, stated, ellipsoidal=table.ellipsoidal)
    own = replace(hints, series=series, kind=table.kind, units=None, scale=None)
    if series == "imu":
        own = replace(own, axes=axes_of(table, hints))
    made, _ = series_from(raw, own, time=time)
    return made[series], raw.notes


def check_hints(path: Path, hints: ReadHints, used: Iterable[str], what: str) -> None:
    """Refuse hints that a format answers itself.

    Parameters
    ----------
    path : Path
    hints : ReadHints
    used : iterable of str
        Hints that mean something here, beside :data:`COMMON`.
    what : str
        The format, ``"a ROS bag"``.

    Raises
    ------
    InputError
        Naming those to leave out.
    """
    used = COMMON | set(used)
    if unknown := used - {f.name for f in fields(ReadHints)}:
        raise KeyError(f"no hints: {unknown}")
    hints.check_used(path, used, what)


def later(t: FloatArray, what: str, path: Path, notes: list[str]) -> np.ndarray[Any, np.dtype[np.bool_]]:
    """Samples that are later than all before them; the others are counted in a note.

    Parameters
    ----------
    t : ndarray, shape (n,)
        [s]
    what : str
        Stream, for the messages.
    path : Path
    notes : list of str
        Takes the note.

    Returns
    -------
    ndarray of bool, shape (n,)

    Raises
    ------
    FileFormatError
        If more than one in a hundred (and more than two) is not later: the clock of such a log is not to be trusted.
    """
    if len(t) and (t[1:] > t[:-1]).all() and np.isfinite(t[[0, -1]]).all():
        return np.ones(len(t), dtype=np.bool_)
    keep = np.isfinite(t)
    highest = np.maximum.accumulate(np.where(keep, t, -np.inf)) if len(t) else t
    keep &= t > np.concatenate(([-np.inf], highest[:-1]))[: len(t)]
    dropped = len(t) - int(keep.sum())
    if dropped > max(2, _MANY * len(t)):
        first = int(np.flatnonzero(~keep)[0])
        raise FileFormatError(
            f"{what}: {dropped} of {len(t)} stamps repeat or go back, the first at message {first + 1} ({t[first]:.6f} "
            "s): two sources share the stream, or the clock was set during the log; cut or clean it",
            path,
        )
    if dropped:
        notes.append(f"{what}: {dropped} samples not later than the one before were left out.")
    return keep


def kept(keep: np.ndarray[Any, np.dtype[np.bool_]], t: FloatArray, rows: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Times and rows that :func:`later` keeps; the arrays themselves if these are all. Shapes (n,), (n, k)."""
    return (t, rows) if keep.all() else (t[keep], rows[keep])
