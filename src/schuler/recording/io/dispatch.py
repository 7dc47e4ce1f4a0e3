"""Which reader or writer a file calls for."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from schuler.exceptions import InputError
from schuler.recording.io import columns, lines
from schuler.recording.io.gnss_table import reference_from_gnss
from schuler.recording.io.hints import SATELLITES, SERIES, ReadHints
from schuler.recording.io.satellite_files import read_satellite_file
from schuler.recording.recording import Recording

WRITERS = {
    ".parquet": "parquet",
    ".csv": "csv",
    ".txt": "csv",
    ".pos": "pos",
    ".kml": "kml",
    ".geojson": "geojson",
    ".json": "geojson",
}
_MAGIC = {
    b"PAR1": "parquet",
    b"MATLAB 5.0": "matlab",
    b"MATLAB 7.3": "matlab",
    b"\x93NUMPY": "numpy",
    b"PK\x03\x04": "numpy",
}


def read(path: Path | str, hints: ReadHints | None = None, **more: Any) -> Recording:
    """Read a log of any known format into a recording: SI, forward-right-down, ellipsoidal heights, named time base.

    Parameters
    ----------
    path : Path or str
        A file, or a folder whose files are the series of one run.
    hints : ReadHints, optional
        What the file does not say itself.
    **more
        Single hints by name (see :class:`ReadHints`), over those in ``hints``. For a folder instead the entries of
        :func:`schuler.recording.io.folder.read_folder`: ``imu={"file": "imu.csv", "units": "g,deg/s"}``.

    Returns
    -------
    Recording
        Its ``metadata.notes`` say what was converted and assumed.

    Raises
    ------
    FileFormatError
        If the file cannot be read as what it was said to be; with the line where there is one.
    InputError
        If a hint is unknown, contradictory or missing.

    Examples
    --------
    >>> read("drive.csv", columns="ax,ay,az,gx,gy,gz,t", units="g,deg/s,ms", axes="FLU")  # doctest: +SKIP
    """
    path = Path(path)
    if path.is_dir():
        from schuler.recording.io.folder import read_folder

        if hints is not None:
            raise InputError(f"{path} is a folder: give hints per file, imu={{'file': ..., 'units': ...}}")
        return read_folder(path, more)
    if hints is None:
        hints = ReadHints.of(**more)
    elif more:
        hints = ReadHints.of(**{**hints.given(), **more})
    return read_one(path, hints)


def read_one(path: Path, hints: ReadHints, glonass_channels: Mapping[int, int] | None = None) -> Recording:
    """Read one file, see :func:`read`; ``glonass_channels`` by satellite for RINEX observations without them."""
    recording = _read_file(path, hints, glonass_channels)
    if hints.series == "reference" and recording.reference is None and recording.gnss is not None:
        recording = reference_from_gnss(recording)
    if hints.series is not None and getattr(recording, hints.series) is None:
        held = ", ".join(n for n in (*SERIES, *SATELLITES) if getattr(recording, n) is not None)
        raise InputError(f"{path}: series={hints.series!r} was asked for, the file holds {held}")
    return recording


def write(recording: Recording, path: Path | str, **options: Any) -> list[Path]:
    """Write a recording in the format its suffix names.

    Parameters
    ----------
    recording : Recording
    path : Path or str
        ``.parquet`` and ``.csv`` keep everything; ``.pos`` holds the GNSS series, ``.kml`` and ``.geojson`` one track
        (:func:`left_out` says what is not in them).
    **options
        Of the writer, see ``write_csv``, ``write_parquet``, ``write_pos``, ``write_kml`` and ``write_geojson``.

    Returns
    -------
    list of Path
        The files written.

    Raises
    ------
    InputError
        If the suffix or an option is not known, or the series asked for is not there.
    """
    import inspect

    path = Path(path)
    suffix = path.suffix.lower()
    if suffix not in WRITERS:
        raise InputError(
            f"{path}: cannot tell the format from {suffix or 'no suffix'!r}; write to {', '.join(WRITERS)}"
        )
    writer = _writer(WRITERS[suffix])
    for name in options:
        columns.check_known(name, list(inspect.signature(writer).parameters)[2:], f"option of {suffix}")
    written: list[Path] = writer(recording, path, **options)
    return written


def left_out(recording: Recording, path: Path | str) -> str:
    """Parts of a recording that the format of a file does not hold, separated by commas; empty if it holds all.

    Parameters
    ----------
    recording : Recording
    path : Path or str
        Its suffix names the format. Of KML and GeoJSON the track written is not named: GNSS, or the reference.
    """
    held = {"pos": {"gnss"}, "kml": {"gnss", "reference"}, "geojson": {"gnss", "reference"}}.get(
        WRITERS.get(Path(path).suffix.lower(), "")
    )
    parts = [name for name in (*SERIES, *SATELLITES) if getattr(recording, name) is not None]
    return "" if held is None else ", ".join(name for name in parts if name not in held)


def _read_file(path: Path, hints: ReadHints, glonass_channels: Mapping[int, int] | None = None) -> Recording:
    from schuler.recording.io import matlab, numpy_files, parquet, rtklib, text

    head = lines.check_file(path)
    received = read_satellite_file(path, head, hints, glonass_channels)
    if received is not None:
        return received
    kind = next((kind for magic, kind in _MAGIC.items() if head.startswith(magic)), None)
    if kind is None:
        suffix = path.suffix.lower()
        kind = {".parquet": "parquet", ".npy": "numpy", ".npz": "numpy", ".pos": "pos"}.get(suffix)
        if suffix == ".mat" and b"\x00" in head:
            kind = "matlab"  # version 4 has no magic; a .mat file without zero bytes is MATLAB's plain text form
        elif kind is None and rtklib.looks_like_pos(head):
            kind = "pos"
    readers = {
        "parquet": parquet.read_parquet,
        "matlab": matlab.read_matlab,
        "numpy": numpy_files.read_numpy,
        "pos": rtklib.read_pos,
    }
    return readers.get(kind or "", text.read_text)(path, hints)


def _writer(kind: str) -> Any:
    from schuler.recording.io import csv, parquet, rtklib, track

    return {
        "parquet": parquet.write_parquet,
        "csv": csv.write_csv,
        "pos": rtklib.write_pos,
        "kml": track.write_kml_of,
        "geojson": track.write_geojson_of,
    }[kind]
