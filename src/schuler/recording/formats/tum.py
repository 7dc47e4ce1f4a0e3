"""TUM trajectories: ``timestamp tx ty tz qx qy qz qw`` a line, as the tools that compare trajectories read them.

Stamps are seconds, positions metres in a local frame, attitudes the body's in that frame, scalar last. Sturm et al., A
benchmark for the evaluation of RGB-D SLAM systems, IROS 2012.
"""

from __future__ import annotations

from dataclasses import replace
from decimal import Decimal, InvalidOperation
from pathlib import Path

import numpy as np

from schuler import files
from schuler.arrays import FloatArray, IntArray
from schuler.exceptions import FileFormatError, InputError
from schuler.recording.io import clock, lines, local_frame, parts, plain_text
from schuler.recording.io.hint_texts import axes_matrix, parse_origin
from schuler.recording.io.hints import ReadHints
from schuler.recording.io.lines import TextTable
from schuler.recording.io.parts import Table
from schuler.recording.recording import Recording
from schuler.recording.trajectory import Trajectory

_HINTS = {"axes", "time", "origin"}
_OWN = "# schuler-tum "
_OWN_WORDS = ("origin", "axes", "time", "attitude")


def sniff(head: bytes, path: Path) -> bool:
    """Whether a comment at the top names the columns; without one ``format="tum"`` says what it is."""
    for line in head[:2000].split(b"\n")[:10]:
        words = line.strip().removeprefix(b"#").replace(b",", b" ").split()
        if line.startswith(b"#") and len(words) == 8 and words[1:] == [b"tx", b"ty", b"tz", b"qx", b"qy", b"qz", b"qw"]:
            return True
    return False


def holds(path: Path) -> tuple[str, ...]:
    """A reference."""
    return ("reference",)


def read(path: Path, hints: ReadHints) -> Recording:
    """Reference of a TUM trajectory.

    Parameters
    ----------
    path : Path
    hints : ReadHints
        ``origin`` of the local frame (x east, y north, z up), ``time`` ("unix" or "gps-unix" if stamps are dates),
        ``axes`` of the body, forward-left-up if not given. Files of this package say all of it themselves.

    Raises
    ------
    FileFormatError
        With file and line, for what is missing or malformed.
    InputError
        Without an origin.
    """
    parts.check_hints(path, hints, _HINTS, "a TUM trajectory")
    notes: list[str] = []
    own = _own(path)
    origin = hints.origin or own.get("origin")
    place = local_frame.need_origin(parse_origin(origin), path, "TUM trajectories")
    axes = hints.axes or own.get("axes") or "FLU"
    table = plain_text.open_table(path, (8,), "timestamp tx ty tz qx qy qz qw")
    stamps, poses = _load(table, hints, notes)
    seconds, base = clock.from_unix({"reference": stamps}, hints.time or own.get("time"), notes)
    t, poses = parts.kept(parts.later(seconds["reference"], "poses", path, notes), seconds["reference"], poses)
    q = None if own.get("attitude") == "none" else poses[:, [6, 3, 4, 5]]
    notes.append("The local frame is taken as east, north, up of the origin.")
    if not own and hints.axes is None:
        notes.append("Axes of the body are not stated; taken as forward, left, up.")
    values = local_frame.earth_fixed(place, poses[:, :3], q, None, axes_matrix(axes), path)
    hints = replace(hints, axes=None, origin=origin)
    return parts.assemble(path, {"reference": Table({"t": t, **values})}, hints, base, notes)


def _own(path: Path) -> dict[str, str]:
    """Metadata in a comment of a trajectory written by this package; empty for others."""
    for line in plain_text.head_of(path, 2000).decode("latin-1").splitlines()[:10]:
        if line.startswith(_OWN):
            words = dict(word.partition("=")[::2] for word in line[len(_OWN) :].split())
            return {name: value for name, value in words.items() if name in _OWN_WORDS}
    return {}


def _load(table: TextTable, hints: ReadHints, notes: list[str]) -> tuple[IntArray, FloatArray]:
    """Stamps [ns] and poses; stamps may have more digits than a floating-point number. Shapes (n,), (n, 7)."""
    loaded = lines.load_stamps(table, 8, 9, rounded=True, allow_truncated=hints.allows("truncated"))
    if loaded is None or not np.isfinite(loaded[1]).all():
        rows = plain_text.load(table, 8, allow_truncated=hints.allows("truncated"), notes=notes)
        return _stamps(table, rows[:, 0]), rows[:, 1:]
    if loaded[2]:
        notes.append(f"{table.path.name}: the last line was cut off and left out.")
    return loaded[0], loaded[1]


def _stamps(table: TextTable, values: np.ndarray) -> IntArray:
    """Nanoseconds by the text, which may have more digits than a floating-point number."""
    if np.abs(values).max() > 4.0e9:
        raise FileFormatError("stamps are beyond seconds of this century: are they nanoseconds?", table.path)
    ns = []
    for (number, fields), _ in zip(table.rows(), range(len(values)), strict=False):
        try:
            ns.append(int((Decimal(fields[0]) * clock.NS).to_integral_value()))
        except InvalidOperation:
            raise FileFormatError(f"expected a number of seconds, got {fields[0]!r}", table.path, number) from None
    return np.array(ns, dtype=np.int64)


def write(recording: Recording, path: Path, origin: str | None = None, series: str | None = None) -> list[Path]:
    """Write the reference, or the fixes, as a TUM trajectory.

    Parameters
    ----------
    recording : Recording
    path : Path
    origin : str, optional
        ``"LAT,LON,HEIGHT"`` [deg, m] of the local frame, default the first position. Give the same to two trajectories
        that are to be compared without aligning them.
    series : {"reference", "gnss"}, optional
        Default the reference if there is one.

    Returns
    -------
    list of Path
        The file.

    Notes
    -----
    Poses are those of a body forward-left-up in east-north-up axes, stamps Unix time or the recording's own clock to a
    nanosecond; a comment says so, and the origin. Velocities are not part of the format. Where there is no attitude the
    identity is written.
    """
    if series not in (None, "reference", "gnss"):
        raise InputError(f"series: expected reference or gnss, got {series!r}")
    trajectory = recording.reference if series != "gnss" else None
    if trajectory is None and recording.gnss is not None and series != "reference":
        trajectory = Trajectory.from_geodetic(recording.gnss.t, recording.gnss.llh)
    if trajectory is None:
        raise InputError(f"{recording.metadata.name} has no {series or 'reference'} to write as a trajectory")
    place = local_frame.origin_of(trajectory, origin)
    r, q, _ = local_frame.local(trajectory, place, local_frame.FLU)
    if q is None:
        q = np.tile((1.0, 0.0, 0.0, 0.0), (len(r), 1))
    base = recording.metadata.time
    stamps = clock.seconds_text(clock.to_unix(trajectory.t, base))
    kind = "local" if base.scale == "local" else "unix"
    attitude = "none" if trajectory.q_eb is None else "body"
    with files.replacing(path) as temporary, temporary.open("w", encoding="utf-8", newline="\n") as stream:
        stream.write("# timestamp tx ty tz qx qy qz qw\n")
        stream.write(f"{_OWN}origin={local_frame.origin_text(place)} axes=FLU time={kind} attitude={attitude}\n")
        for stamp, row in zip(stamps.tolist(), np.column_stack((r, q[:, [1, 2, 3, 0]])).tolist(), strict=True):
            stream.write(f"{stamp} " + " ".join([f"{value:.17g}" for value in row]) + "\n")
    return [Path(path)]
