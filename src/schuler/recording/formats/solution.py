"""Our own navigation results, so that they can be compared with and converted to what other programs read."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from schuler import units
from schuler.arrays import FloatArray
from schuler.exceptions import FileFormatError
from schuler.recording.io import own, parts
from schuler.recording.io.clock import stamps
from schuler.recording.io.hints import ReadHints
from schuler.recording.io.parts import Table
from schuler.recording.recording import Recording
from schuler.timebase import TimeBase

FORMAT = "schuler/solution/1"
_FOOTER = 1 << 18
_REFERENCE = {"x": "x_ecef_m", "y": "y_ecef_m", "z": "z_ecef_m", **{f"q{c}": f"q_eb_{c}" for c in "wxyz"}}
_AXES = ("north", "east", "down")


def sniff(head: bytes, path: Path) -> bool:
    """Whether the end of a Parquet file names the format of solutions."""
    if not head.startswith(b"PAR1"):
        return False
    try:
        with path.open("rb") as stream:
            stream.seek(max(0, path.stat().st_size - _FOOTER))
            return b"schuler/solution/" in stream.read()
    except OSError:
        return False


def holds(path: Path) -> tuple[str, ...]:
    """A reference."""
    return ("reference",)


def read(path: Path, hints: ReadHints) -> Recording:
    """Trajectory of a solution as reference.

    Parameters
    ----------
    path : Path
        ``solution.parquet`` or ``smoothed.parquet`` of ``schuler navigate``.
    hints : ReadHints
        ``time="gps-tow:WEEK"`` if the file does not say it (those of version 0.1 do not); ``series="gnss"`` takes
        positions and velocities with their sigmas as fixes.

    Raises
    ------
    FileFormatError
        If the file is damaged or newer than this package.
    MissingExtraError
        Without pyarrow (extra ``data``).
    """
    from schuler.recording.formats.parquet import read_table

    parts.check_hints(path, hints, parts.GNSS_HINTS | {"time"}, "a solution of schuler")
    columns, meta = read_table(path, FORMAT)
    notes = [f"A {'smoothed' if meta.get('smoothed') else 'filtered'} solution of the IMU's position."]

    def fault(message: str, row: int | None) -> FileFormatError:
        return FileFormatError(message if row is None else f"row {row + 1}: {message}", path)

    def take(names: dict[str, str], factor: float = 1.0) -> dict[str, Any]:
        if missing := [name for name in names.values() if name not in columns]:
            raise FileFormatError(f"columns are missing: {', '.join(missing)}; write the file anew", path)
        with np.errstate(invalid="ignore", over="ignore"):  # numbers of a damaged file, which are refused later
            return {short: np.asarray(columns[name], dtype=np.float64) * factor for short, name in names.items()}

    base = _base(meta, path)
    t = take({"t": "t_s"})["t"]
    if base is None:
        t, base = stamps(t, hints.time, fault, notes)
    place = take({"lat": "lat_deg", "lon": "lon_deg"}, units.DEG) | take({"h": "height_m"})
    velocity = take({f"v{axis[0]}": f"v_{axis}_m_s" for axis in _AXES})
    if hints.series == "gnss":
        sigma = take({f"s{a[0]}": f"sigma_position_{a}_m" for a in _AXES})
        sigma |= take({f"sv{a[0]}": f"sigma_velocity_{a}_m_s" for a in _AXES})
        notes.append("Fixes of a filter: correlated in time, and a filter that takes them as independent is too sure.")
        return parts.assemble(path, {"gnss": Table({"t": t, **place, **velocity, **sigma})}, hints, base, notes)
    from schuler.recording.trajectory import Trajectory

    e = take(_REFERENCE)
    llh = np.stack([place[name] for name in ("lat", "lon", "h")], axis=1)
    v_n = np.stack([velocity[name] for name in ("vn", "ve", "vd")], axis=1)
    v_e = Trajectory.from_geodetic(t, llh, v_n).v_eb_e
    assert v_e is not None
    e |= {f"v{axis}": v_e[:, k] for k, axis in enumerate("xyz")}
    return parts.assemble(path, {"reference": Table({"t": t, **e})}, replace(hints, time=None), base, notes)


def sigmas(path: Path) -> FloatArray:
    """Accuracies of a solution file at its epochs, in the order of SBET's.

    Returns
    -------
    ndarray, shape (n, 9)
        1-sigma of position [m] and velocity [m/s] north, east, down, and of roll, pitch, heading [rad]. Tilts about
        north and east are turned to the heading as if they were not correlated.

    Raises
    ------
    FileFormatError
        If the file is no solution, or has no sigmas.
    """
    from schuler.recording.formats.parquet import read_table

    columns, _ = read_table(path, FORMAT)
    names = [f"sigma_position_{a}_m" for a in _AXES] + [f"sigma_velocity_{a}_m_s" for a in _AXES]
    names += [f"sigma_attitude_{a}_deg" for a in _AXES]
    if missing := [name for name in (*names, "yaw_deg") if name not in columns]:
        raise FileFormatError(f"columns are missing: {', '.join(missing)}", path)
    sigma = np.stack([np.asarray(columns[name], dtype=np.float64) for name in names], axis=1)
    yaw = np.asarray(columns["yaw_deg"], dtype=np.float64) * units.DEG
    north, east, down = sigma[:, 6:].T * units.DEG
    c, s = np.cos(yaw), np.sin(yaw)
    sigma[:, 6:] = np.stack((np.hypot(c * north, s * east), np.hypot(s * north, c * east), down), axis=1)
    return sigma


def _base(meta: dict[str, Any], path: Path) -> TimeBase | None:
    """Time base, where the provenance has it."""
    provenance = meta.get("provenance")
    if not isinstance(provenance, dict) or "time" not in provenance:
        return None
    try:
        return own.time_from(provenance["time"])
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        raise FileFormatError(f"the time base written with the file is damaged ({error!r})", path) from error
