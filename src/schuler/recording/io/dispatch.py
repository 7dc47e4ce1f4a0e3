"""Choice of the reader or writer of a file."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np

from schuler.arguments import explains_arguments
from schuler.exceptions import FileFormatError, InputError, ReaderError, SchulerError
from schuler.recording.io import columns, lines, packed
from schuler.recording.io.gnss_table import reference_from_gnss, with_truth_fixes
from schuler.recording.io.hint_texts import SATELLITES, SERIES, parse_time
from schuler.recording.io.hints import ReadHints
from schuler.recording.io.possible import check_possible
from schuler.recording.io.satellite_files import read_satellite_file
from schuler.recording.recording import Recording
from schuler.timebase import WEEK_S, TimeBase, leap_second_notes

WRITERS = {
    ".parquet": "parquet",
    ".csv": "csv",
    ".txt": "csv",
    ".pos": "pos",
    ".kml": "kml",
    ".geojson": "geojson",
    ".json": "geojson",
}
LONGEST_S = 120.0  # processor time that any file may take, kernels compiled [s]
_PER_BYTE_S = 1e-5  # and by its size; the slowest formats take a fiftieth of it [s]
#: Formats of sensors with a clock of their own (``time="local"``).
_OWN_CLOCKS = ("ardupilot", "phyphox", "px4", "sbg", "vectornav", "xsens")
_MAGIC = {
    b"PAR1": "parquet",
    b"MATLAB 5.0": "matlab",
    b"MATLAB 7.3": "matlab",
    b"\x93NUMPY": "numpy",
    b"PK\x03\x04": "numpy",
}


@explains_arguments
def read(path: Path | str, hints: ReadHints | None = None, **more: Any) -> Recording:
    """Read a log of any known format into a recording: SI, forward-right-down, ellipsoidal heights, named time base.

    Parameters
    ----------
    path : Path or str
        A file, or a folder whose files are the series of one run.
    hints : ReadHints, optional
        Hints on what the file does not state.
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
    entries = any(isinstance(entry, Mapping) and name != "streams" for name, entry in more.items())
    given = {**({} if hints is None else hints.given()), **more}
    if path.is_file() and not {"columns", "format"} & given.keys() and packed.tables(path):
        from schuler.recording.io.folder import read_packed

        return read_packed(path, given)
    if path.is_dir():
        from schuler.recording.io.folder import read_folder

        whole = None if entries else _folder_format(path, hints, more.get("format"))
        if whole is not None:
            return read_one(path, _with(hints, more))
        if hints is not None:
            raise InputError(f"{path} is a folder: give hints per file, imu={{'file': ..., 'units': ...}}")
        return read_folder(path, more)
    return read_one(path, _with(hints, more))


def _with(hints: ReadHints | None, more: Mapping[str, Any]) -> ReadHints:
    if hints is None:
        return ReadHints.of(**more)
    return ReadHints.of(**{**hints.given(), **more}) if more else hints


def _folder_format(path: Path, hints: ReadHints | None, name: str | None) -> ModuleType | None:
    """The format of a folder that is one log, as named or by its looks."""
    from schuler.recording.formats import registry

    name = name or (None if hints is None else hints.format)
    return registry.find_folder(path) if name is None else registry.module(name)


def read_one(path: Path, hints: ReadHints, glonass_channels: Mapping[int, int] | None = None) -> Recording:
    """Read one file, see :func:`read`; ``glonass_channels`` by satellite for RINEX observations without them."""
    with guarded(path), leap_second_notes() as late:
        recording = check_possible(_read_file(path, hints, glonass_channels), path, hints.allows)
    if late:
        recording = replace(recording, metadata=recording.metadata.noting(*late))
    if hints.series == "reference" and recording.reference is None and recording.gnss is not None:
        recording = reference_from_gnss(recording)
    if hints.truth_fixes is not None:
        recording = with_truth_fixes(recording, *hints.truth_fixes)
    if hints.series is not None and getattr(recording, hints.series) is None:
        held = ", ".join(n for n in (*SERIES, *SATELLITES) if getattr(recording, n) is not None)
        raise InputError(f"{path}: series={hints.series!r} was asked for, the file holds {held}")
    return recording


@contextmanager
def guarded(path: Path) -> Iterator[None]:
    """Turn what a reader does not foresee in a damaged file into an error that names the file.

    Parameters
    ----------
    path : Path

    Raises
    ------
    ReaderError
        From the error that came. The tests on damaged files hold each reader to errors of its own.
    """
    try:
        with _limited(path), np.errstate(all="ignore"):  # what overflows is refused by the checks of the series
            yield
    except SchulerError:
        raise
    except MemoryError as error:
        raise ReaderError("there is not enough memory for what it claims to hold; is it damaged?", path) from error
    except Exception as error:
        if isinstance(error, OSError) and error.errno is not None:
            raise
        raise ReaderError(
            f"it cannot be read ({type(error).__name__}: {error}): it is damaged, or the reader has a defect; if other "
            "programs read it, please report it",
            path,
        ) from error


@contextmanager
def _limited(path: Path) -> Iterator[None]:
    """Stop a reader, our own or another program's, that a damaged file sends round in circles.

    The limit is one of processor time, and far above what any file of that size takes. It holds in the main thread of
    systems that have such a clock, for loops in Python.
    """
    import signal
    import threading

    usable = hasattr(signal, "SIGVTALRM") and threading.current_thread() is threading.main_thread() and path.is_file()
    if not usable or signal.getsignal(signal.SIGVTALRM) != signal.SIG_DFL:
        yield
        return

    def stop(*_: Any) -> None:
        raise FileFormatError("reading it came to no end: it is damaged, or the reader has a defect", path)

    signal.signal(signal.SIGVTALRM, stop)
    signal.setitimer(signal.ITIMER_VIRTUAL, LONGEST_S + _PER_BYTE_S * path.stat().st_size)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_VIRTUAL, 0.0)
        signal.signal(signal.SIGVTALRM, signal.SIG_DFL)


@explains_arguments
def write(recording: Recording, path: Path | str, *, format: str | None = None, **options: Any) -> list[Path]:
    """Write a recording in the format its suffix names.

    Parameters
    ----------
    recording : Recording
    path : Path or str
        ``.parquet`` and ``.csv`` keep everything; ``.pos`` holds the GNSS series, ``.kml`` and ``.geojson`` one track
        (:func:`left_out` says what is not in them). For others see ``schuler.recording.formats.registry.WRITERS``.
    format : str, optional
        Name of one of these, where the suffix does not tell (two formats share it, or it is a folder).
    **options
        Options of the writer, see ``write_csv``, ``write_parquet``, ``write_pos``, ``write_kml`` and ``write_geojson``.

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

    from schuler.recording.formats import registry

    path = Path(path)
    suffix = path.suffix.lower()
    if format is None and suffix in WRITERS:
        writer = _writer(WRITERS[suffix])
    elif (writes := registry.find_writer(path, format)) is not None:
        writer = writes[0].write
        if not any(getattr(recording, name) is not None for name in writes[1]):
            raise InputError(f"{path}: this format holds {', '.join(writes[1])}; the recording has none of them")
    else:
        choices = ", ".join((*WRITERS, *registry.suffixes()))
        raise InputError(
            f"{path}: cannot tell the format from {repr(suffix) if suffix else 'a name without suffix'}; write to "
            f"{choices}, or name the format"
        )
    for name in options:
        columns.check_known(name, list(inspect.signature(writer).parameters)[2:], f"option of {format or suffix}")
    written: list[Path] = writer(recording, path, **options)
    return written


def left_out(recording: Recording, path: Path | str, format: str | None = None) -> str:
    """Parts of a recording that the format of a file does not hold, separated by commas; empty if it holds all.

    Parameters
    ----------
    recording : Recording
    path : Path or str
        Its suffix names the format. Of KML and GeoJSON the track written is not named: GNSS, or the reference.
    format : str, optional
        As of :func:`write`.
    """
    from schuler.recording.formats import registry

    held: set[str] | None
    suffix = Path(path).suffix.lower()
    if format is None and suffix in WRITERS:
        held = {"pos": {"gnss"}, "kml": {"gnss", "reference"}, "geojson": {"gnss", "reference"}}.get(WRITERS[suffix])
    else:
        writer = registry.find_writer(Path(path), format)
        held = None if writer is None else set(writer[1])
    parts = [name for name in (*SERIES, *SATELLITES) if getattr(recording, name) is not None]
    missing = [] if held is None else [name for name in parts if name not in held]
    e = recording.ephemerides
    if e is not None and (e.precise_orbits is not None or e.precise_clocks is not None):
        missing.append("precise orbits and clocks")  # no format of ours has them; the files themselves do
    return ", ".join(missing)


def _format_of(path: Path, hints: ReadHints) -> ModuleType | None:
    """The format of the registry that a file or folder is read as: the one named, or the one that claims it."""
    from schuler.recording.formats import registry

    if hints.format is not None:
        return registry.module(hints.format)
    if path.is_dir():
        return registry.find_folder(path)
    head = lines.check_file(path)
    if hints.columns is not None and not lines.is_binary(head):
        return None  # a table, as the user says
    return registry.find(head, path)


def _read_file(path: Path, hints: ReadHints, glonass_channels: Mapping[int, int] | None = None) -> Recording:
    from schuler.recording.formats import matlab, numpy_files, parquet, rtklib, text

    if (module := _format_of(path, hints)) is not None:
        return _read_format(module, path, hints)
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


def _read_format(module: ModuleType, path: Path, hints: ReadHints) -> Recording:
    """Recording of a format; ``time="gps-tow:WEEK"`` says what a sensor's own clock means once ``offset`` is added."""
    spec = parse_time(hints.time)
    if spec.kind != "gps-tow" or module.__name__.rpartition(".")[2] not in _OWN_CLOCKS:
        recording: Recording = module.read(path, hints)
        return recording
    recording = module.read(path, replace(hints, time="local"))
    metadata = replace(recording.metadata, time=TimeBase("gps", spec.week * WEEK_S), options=hints.given())
    note = f"The sensor's own clock was taken for seconds of GPS week {spec.week}, as the hint time says."
    return replace(recording, metadata=metadata.noting(note))


def _writer(kind: str) -> Any:
    from schuler.recording.formats import csv, parquet, rtklib, track

    return {
        "parquet": parquet.write_parquet,
        "csv": csv.write_csv,
        "pos": rtklib.write_pos,
        "kml": track.write_kml_of,
        "geojson": track.write_geojson_of,
    }[kind]
